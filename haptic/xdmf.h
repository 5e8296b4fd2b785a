/// @file xdmf.h  The XDMF companion of a recording: what ParaView opens (private).
///
/// XDMF 3 text that names datasets of the HDF5 file beside it: one temporal collection "surface"
/// (deformed positions, displacement at the nodes) and one "tools" (a point per tool with its
/// force).
#ifndef PALPATE_HAPTIC_XDMF_H
#define PALPATE_HAPTIC_XDMF_H

#include <stdint.h>

#include <palpate/status.h>

#include "haptic/recording.h"

typedef struct pal_xdmf_series {
    const char *h5_path; ///< only its last component is written: both files move together
    int64_t frames;
    const double *time; ///< [s], shape [frames]
    int32_t rows, triangles, tools;
} pal_xdmf_series;

/// "run.h5" -> "run.xdmf"; any other name gets ".xdmf" appended. @return _OK, _ARGUMENT
pal_status pal_xdmf_name(const char *h5_path, char out[PALPATE_RECORDING_PATH], pal_error *error);

/// Write the file (to a temporary name, then renamed). @return _OK, _IO, _ARGUMENT
pal_status pal_xdmf_write(const char *name, const pal_xdmf_series *series, pal_error *error);

#endif
