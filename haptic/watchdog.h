/// @file watchdog.h  The latching watchdog in front of the output stage (private, pure logic).
///
/// Judges the input of each tick and scales the force accordingly; all it knows is in the tool
/// state, so a replay gives the same bits.
///   stale   the device refuses, gives nonsense, or its time stamp (where it has one) stands still
///   or
///           runs backwards, for 20 ms: the force goes to zero within 10 ms while it lasts
///   stall   100 ms of periods passed without a tick: the force starts from zero
///   jump    the pose moved faster than 20 m/s since the last good one: the force starts from zero
/// Then the force comes back over 100 ms (PALPATE_FAULT_RAMP). A stale pose or a stall of 1 s, or a
/// jump while the force is still coming back from an earlier event, latches: the force stays zero,
/// PALPATE_FAULT_LATCHED is raised each tick, until pal_engine_reset. Slew limit and caps come
/// after. 20 m/s is twice what a hand reaches in a throw; 20 ms lets a 100 Hz tracker feed a 1 kHz
/// servo.
#ifndef PALPATE_HAPTIC_WATCHDOG_H
#define PALPATE_HAPTIC_WATCHDOG_H

#include <palpate/engine.h>

#define PALPATE_WATCH_STALE 0.02     ///< [s]
#define PALPATE_WATCH_STALL 0.1      ///< [s]
#define PALPATE_WATCH_LATCH 1.0      ///< stale or stalled this long latches [s]
#define PALPATE_WATCH_SPEED 20.0     ///< [m/s]
#define PALPATE_WATCH_RAMP_DOWN 0.01 ///< [s]
#define PALPATE_WATCH_RAMP_UP 0.1    ///< [s]

typedef struct pal_watchdog {
    double period;
    double scale;       ///< of force and torque, 0 to 1
    double position[3]; ///< last good one, body frame [m]
    double since;       ///< periods since then
    int64_t stamp;
    int32_t has_pose, latched;
    uint32_t stale; ///< ticks in a row
} pal_watchdog;

void pal_watchdog_init(pal_watchdog *w, double period);

/// Judge one tick. @param position  of the tool, body frame; NULL: the pose was not usable
/// @param[out] value  offending value of each bit raised: stale ticks, missed periods, speed [m/s]
/// @return fault bits; w->scale is to be applied
uint32_t pal_watchdog_step(pal_watchdog *w, const pal_tool_state *in, const double position[3],
                           double value[32]);

#endif
