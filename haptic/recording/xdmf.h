/// @file xdmf.h  The XDMF companion of a recording: what ParaView opens (private).
///
/// XDMF 3 text that names datasets of the HDF5 file beside it: one temporal collection "surface"
/// (deformed positions, displacement at the nodes) and one "tools" (a point per tool with its
/// force).
#ifndef PALPATE_HAPTIC_XDMF_H
#define PALPATE_HAPTIC_XDMF_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

#include "haptic/recording/recording.h"

typedef struct pal_xdmf_series {
    const char *h5_path; ///< only its last component is written: both files move together
    int64_t frames;
    const double *time;          ///< [s], shape [frames]
    const double *tool_position; ///< [m], shape [frames, tools, 3]
    const double *tool_force;    ///< [N], shape [frames, tools, 3]
    int32_t rows, triangles, tools;
} pal_xdmf_series;

/// Path of a frame's dataset in the HDF5 file: "/frames/position/000012".
void pal_xdmf_dataset(const char *name, int64_t frame, char *out, size_t size);

/// "run.h5" -> "run.xdmf"; any other name gets ".xdmf" appended. @return _OK, _ARGUMENT
pal_status pal_xdmf_name(const char *h5_path, char out[PALPATE_RECORDING_PATH], pal_error *error);

/// Write the file (to a temporary name, then renamed). @return _OK, _IO, _ARGUMENT
pal_status pal_xdmf_write(const char *name, const pal_xdmf_series *series, pal_error *error);

#endif
