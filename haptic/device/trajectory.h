/// @file trajectory.h  A recorded motion: CSV reader and writer, interpolation in time (private).
///
/// File: header line `time,x,y,z,qw,qx,qy,qz,button`, then one sample a line: seconds from the
/// start of the session (strictly increasing, >= 0), metres, a quaternion w first (normalised on
/// reading; its length must be within 1e-3 of 1), an unsigned button mask. Blank lines and lines
/// that start with '#' are skipped. Numbers are read in the C locale whatever the host's is.
/// Between samples the position is linear in time and the orientation a spherical interpolation on
/// the shorter arc (Shoemake 1985); buttons keep the earlier sample's value. Before the first and
/// after the last sample the tool stands still.
#ifndef PALPATE_HAPTIC_TRAJECTORY_H
#define PALPATE_HAPTIC_TRAJECTORY_H

#include <stdint.h>
#include <stdio.h>

#include <palpate/engine.h>

typedef struct pal_sample {
    double time;           ///< [s]
    double position[3];    ///< [m]
    double orientation[4]; ///< w, x, y, z; unit
    uint32_t buttons;
} pal_sample;

typedef struct pal_trajectory {
    int64_t count;
    pal_sample *sample; ///< shape [count], time ascending
} pal_trajectory;

/// Read a CSV file.
/// @return PALPATE_OK; _IO (cannot be read), _SCENE with "file:line:column: field: found ...,
/// allowed
/// ...", _MEMORY. Nothing is allocated on failure.
PALPATE_API pal_status pal_trajectory_load(const char *path, pal_trajectory *out, pal_error *error);

/// The same from text in memory; `name` stands for the file in messages.
PALPATE_API pal_status pal_trajectory_parse(const char *name, const char *text, size_t size,
                                            pal_trajectory *out, pal_error *error);
PALPATE_API void pal_trajectory_clear(pal_trajectory *trajectory);

/// Pose at `time` [s]. Cost: O(log count), no allocation. Thread: any.
PALPATE_API void pal_trajectory_at(const pal_trajectory *trajectory, double time,
                                   pal_tool_state *state);

/// Write header and samples (positions to 0.01 um, times to 1 us). @return _OK, _IO
PALPATE_API pal_status pal_trajectory_write(const pal_trajectory *trajectory, FILE *file,
                                            pal_error *error);

#endif
