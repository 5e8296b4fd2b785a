/// @file tet_improve.h  After filling: no cell between surface nodes only, rounder cells.
#ifndef PALPATE_SRC_TET_IMPROVE_H
#define PALPATE_SRC_TET_IMPROVE_H

#include "src/cloud/mesher_client.h"

/// Split inner edges between two surface nodes where a tetrahedron has all four nodes on the
/// surface (ears in convex edges, bridges in thin places), then move inside nodes to where their
/// worst tetrahedron is best. Tetrahedra keep their volume's sign; the surface is not touched.
/// Deterministic.
/// @param surface  (surface_count x 3) positions of nodes [0, surface_count)
/// @return PALPATE_OK; PALPATE_ERROR_MEMORY
pal_status pal_tets_improve(const double *surface, int32_t surface_count, const int32_t *triangle,
                            int32_t triangle_count, pal_mesh_fill *fill, pal_error *error);

#endif
