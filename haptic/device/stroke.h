/// @file stroke.h  Scripted strokes: press, slide, circle, palpation, with tremor (private).
///
/// d(t) = depth c(t / ramp) along the tool's axis, c the raised cosine (1 - cos(pi s)) / 2 held at
/// 0 and 1 outside 0..1. Then, with u, v perpendicular to the axis, p = period, t' = t - ramp and
/// a(t) = amplitude c(t' / ramp):
///     slide      a(t) sin(2 pi t' / p) u
///     circle     a(t) (cos(2 pi t' / p) u + sin(2 pi t' / p) v)
///     palpation  depth (1 - cos(2 pi t / p)) / 2 along the axis in place of d(t)
/// Tremor adds to each coordinate three sines at 0.87, 1 and 1.16 times its frequency (8.7, 10 and
/// 11.6 Hz for 10 Hz, the 8 to 12 Hz band of physiological tremor: Elble and Koller, Tremor, 1990)
/// with weights that sum to 1, so no coordinate leaves +-tremor_amplitude; it fades in over the
/// ramp. All is a function of time alone: the same time gives the same pose bit for bit.
#ifndef PALPATE_HAPTIC_STROKE_H
#define PALPATE_HAPTIC_STROKE_H

#include <palpate/engine.h>

#include "haptic/device/trajectory.h"

/// A stroke bound to a tool's start and axis.
typedef struct pal_stroke_path {
    pal_stroke stroke;
    double start[3];    ///< [m]
    double frame[3][3]; ///< u, v, axis: orthonormal, right-handed
    double
        orientation[4]; ///< turns the tool's own axis, local -z, onto the axis by the shortest way
} pal_stroke_path;

/// Check the parameters and bind them. `name` stands for the tool in messages.
/// @return PALPATE_OK; _ARGUMENT with the key, the value and what is allowed
PALPATE_API pal_status pal_stroke_bind(const char *name, const pal_stroke *stroke,
                                       const double start[3], const double axis[3],
                                       pal_stroke_path *out, pal_error *error);

/// Pose at `time` [s]; before 0 as at 0. No allocation. Thread: any.
PALPATE_API void pal_stroke_at(const pal_stroke_path *path, double time, pal_tool_state *state);

/// Sample a stroke into a trajectory: `rate` [Hz], from 0 to `duration` [s] inclusive.
/// @return PALPATE_OK; _ARGUMENT, _MEMORY
PALPATE_API pal_status pal_stroke_sample(const pal_stroke_path *path, double duration, double rate,
                                         pal_trajectory *out, pal_error *error);

#endif
