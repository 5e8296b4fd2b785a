/// @file watchdog.h  The latching watchdog in front of the output stage (private, pure logic).
///
/// Judges the input of each tick and scales the force accordingly; all it knows is in the tool
/// state, so a replay gives the same bits. Thresholds are pal_watchdog_def's; defaults in
/// parentheses.
///   stale   the device refuses, gives nonsense, or its time stamp (where it has one) stands still
///           or runs backwards, for `stale` (20 ms): the force goes to zero within `ramp_down` (10
///           ms) while it lasts
///   stall   `stall` (100 ms) of periods passed without a tick: the force starts from zero
///   jump    the pose moved faster than `speed` (20 m/s) since the last good one: the force starts
///           from zero
///   force   the physics gave no number (the output stage made it zero): the force starts from zero
/// Then the force comes back over `ramp_up` (100 ms; PALPATE_FAULT_RAMP). A stale pose or a stall
/// of `latch` (1 s), or a jump or a force that is no number while the force is still coming back
/// from an earlier event, latches: the force stays zero, PALPATE_FAULT_LATCHED is raised each tick,
/// until PALPATE_STATE_UNLATCH (pal_session_unlatch) or pal_engine_reset. Slew limit and caps come
/// after. 20 m/s is twice what a hand reaches in a throw; 20 ms lets a 100 Hz tracker feed a 1 kHz
/// servo.
#ifndef PALPATE_HAPTIC_WATCHDOG_H
#define PALPATE_HAPTIC_WATCHDOG_H

#include <palpate/engine.h>

typedef struct pal_watchdog {
    pal_watchdog_def def; ///< resolved
    double period;
    double scale;       ///< of force and torque, 0 to 1
    double position[3]; ///< last good one, body frame [m]
    double since;       ///< periods since then
    int64_t stamp;
    int32_t has_pose, latched;
    uint32_t stale; ///< ticks in a row
} pal_watchdog;

/// Thresholds in effect: 0 becomes the default, `speed` never exceeds the device's.
pal_watchdog_def pal_watchdog_resolve(const pal_watchdog_def *def, const pal_device_spec *spec);
/// @return PALPATE_OK, or _ARGUMENT for a value out of range; zeros are allowed
PALPATE_API pal_status pal_watchdog_check(const pal_watchdog_def *def, pal_error *error);

/// @param def  resolved
void pal_watchdog_init(pal_watchdog *w, const pal_watchdog_def *def, double period);

/// Judge one tick. @param position  of the tool, body frame; NULL: the pose was not usable
/// @param[out] value  offending value of each bit raised: stale ticks, missed periods, speed [m/s]
/// @return fault bits; w->scale is to be applied
uint32_t pal_watchdog_step(pal_watchdog *w, const pal_tool_state *in, const double position[3],
                           double value[32]);

/// The physics gave no number in this tick: from zero, and latched when it was not over a fault
/// yet.
void pal_watchdog_trip(pal_watchdog *w);

#endif
