/// @file mesher_client.h  Start palpate-mesher, send it a surface, get tetrahedra back.
#ifndef PALPATE_SRC_MESHER_CLIENT_H
#define PALPATE_SRC_MESHER_CLIENT_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

#include "src/base/helper.h"
#include "src/mesher/protocol.h"
#include "src/geometry/shape.h"

typedef struct pal_mesh_fill {
    int32_t inside_count;
    double *inside; ///< (inside_count x 3)
    int32_t tet_count;
    int32_t *tet; ///< (tet_count x 4) below vertex_count: the surface's vertices; then `inside`
} pal_mesh_fill;

/// Fill a closed, outward surface with tetrahedra of the spacing wanted. The surface's vertices and
/// triangles are kept. Deterministic.
/// @param progress  called from this thread, at least five times a second; non-zero cancels: the
///                  process is killed
/// @return PALPATE_OK; PALPATE_ERROR_CLOUD (the mesher says why, or it died), _CANCELLED, _SYSTEM
///         (it could not be started), _MEMORY
pal_status pal_mesher_fill(const double *x, int32_t vertex_count, const int32_t *triangle,
                           int32_t triangle_count, const pal_size_field *size,
                           const pal_progress *progress, pal_mesh_fill *out, pal_error *error);
void pal_mesh_fill_clear(pal_mesh_fill *fill);

/// The whole exchange on a running child (for tests: on anything that answers).
/// @param[out] out  cleared by the caller, also on failure. @return as pal_helper_receive; _CLOUD
pal_status pal_mesher_converse(pal_helper *h, const pal_mesher_request *head, const double *x,
                               const int32_t *triangle, const pal_mesher_source *source,
                               const pal_progress *progress, pal_mesh_fill *out, pal_error *error);

#endif
