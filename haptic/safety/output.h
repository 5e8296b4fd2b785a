/// @file output.h  The output stage: what the physics computed -> what a motor may get (private).
///
/// Outside the physics and applied to every tool every tick, in this order:
///   finite check   a force or torque that is not a number becomes zero
///   slew limit     the force changes by at most slew x period per tick (vector difference)
///   force cap      |force| <= limits.force, direction kept
///   torque cap     |torque| <= limits.torque, direction kept
/// A limit is never absent by omission: pal_limits_resolve turns 0 into the device's maximum or a
/// default, and only INFINITY, written on purpose, is none. When slew or cap shorten the force,
/// torque is left to its own cap: it is about the tool's origin and not a function of the force
/// alone. Thread: servo. No allocation, lock, log or system call.
#ifndef PALPATE_HAPTIC_OUTPUT_H
#define PALPATE_HAPTIC_OUTPUT_H

#include <palpate/engine.h>

typedef struct pal_output {
    pal_tool_limits limits;
    double step;     ///< largest change of force per tick [N]; INFINITY: no limit
    double force[3]; ///< last force given out [N]
} pal_output;

/// The lesser of two specs, number by number; 0 is unknown. Name, damping and resolution are
/// `own`'s where it has them.
pal_device_spec pal_spec_merge(const pal_device_spec *scene, const pal_device_spec *own);

/// Limits in effect: 0 becomes the spec's maximum or the default, nothing exceeds the spec.
pal_tool_limits pal_limits_resolve(const pal_tool_limits *limits, const pal_device_spec *spec);

/// @param limits  resolved ones, all positive
/// @param period  tick period [s]; limits.slew is in newtons per millisecond
void pal_output_init(pal_output *output, const pal_tool_limits *limits, double period);

/// Forget the last force (the next one starts from zero).
void pal_output_reset(pal_output *output);

/// Limit force and torque in place and or the fault bits into force->fault.
/// @param[out] value  the offending value of each bit raised here, indexed by bit number
/// @return the bits raised here
uint32_t pal_output_apply(pal_output *output, pal_tool_force *force, double value[32]);

#endif
