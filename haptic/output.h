/// @file output.h  The output stage: what the physics computed -> what a motor may get (private).
///
/// Outside the physics and applied to every tool every tick, in this order:
///   finite check   a force or torque that is not a number becomes zero
///   slew limit     the force changes by at most slew x period per tick (vector difference)
///   force cap      |force| <= limits.force, direction kept
///   torque cap     |torque| <= limits.torque, direction kept
/// A limit of zero means none. When slew or cap shorten the force, torque is left to its own cap:
/// it is about the tool's origin and not a function of the force alone. Thread: servo. No
/// allocation, lock, log or system call.
#ifndef PALPATE_HAPTIC_OUTPUT_H
#define PALPATE_HAPTIC_OUTPUT_H

#include <palpate/engine.h>

typedef struct pal_output {
    pal_tool_limits limits;
    double step;     ///< largest change of force per tick [N]; 0: no limit
    double force[3]; ///< last force given out [N]
} pal_output;

/// @param period  tick period [s]; limits.slew is in newtons per millisecond
void pal_output_init(pal_output *output, const pal_tool_limits *limits, double period);

/// Forget the last force (the next one starts from zero).
void pal_output_reset(pal_output *output);

/// Limit force and torque in place and or the fault bits into force->fault.
/// @param[out] value  the offending value of each bit raised here, indexed by bit number
/// @return the bits raised here
uint32_t pal_output_apply(pal_output *output, pal_tool_force *force, double value[32]);

#endif
