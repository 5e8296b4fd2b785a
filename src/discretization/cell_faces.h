/// @file cell_faces.h  Median-dual cells of a cloud: walls between neighbours, shares of volume.
///
/// The cell of node I is the part of the body nearer to I than to the other corners in barycentric
/// coordinates of each tetrahedron. With g_a the gradient of corner a's barycentric coordinate in a
/// tetrahedron of volume V, the wall between the cells of corners a and b inside it has the area
/// vector V (g_b - g_a) / 4 (from a to b; a short calculation with the quadrilateral edge midpoint,
/// two face centroids, centroid), so that S . (x_b - x_a) = V / 2 whatever the shape.
#ifndef PALPATE_SRC_CELL_FACES_H
#define PALPATE_SRC_CELL_FACES_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/cloud/cloud.h"
#include "src/discretization/gradients.h"

typedef struct pal_cell_faces {
    int32_t pair_count;
    int32_t *pair; ///< (pair_count x 2) the two nodes, ascending
    double *wall;  ///< (pair_count x 3) area vector between their cells, first to second
    double
        *volume; ///< (pair_count) a sixth of the tetrahedra around the pair; adds up to the body's
    int32_t tet_count;
    int32_t *tet_pair;  ///< (tet_count x 6) pairs 01 02 03 12 13 23 of each tetrahedron
    double *hat;        ///< (tet_count x 4 x 3) gradients of the barycentric coordinates
    double *tet_volume; ///< (tet_count)
    double worst_shape; ///< largest condition number of a tetrahedron's edge matrix (Frobenius)
    double worst_point[3];
} pal_cell_faces;

/// @return PALPATE_OK; _STENCIL: a tetrahedron without volume (located); _MEMORY
pal_status pal_cell_faces_create(const pal_cloud *cloud, pal_cell_faces *out, pal_error *error);
void pal_cell_faces_clear(pal_cell_faces *faces);

/// Mean gradient over the tetrahedra around each pair (weights: their volumes).
pal_status pal_cell_pair_gradients(const pal_cloud *cloud, const pal_cell_faces *faces,
                                   pal_gradients *out, pal_error *error);

/// Mean gradient over each node's cell (the tetrahedra around it, weights: their volumes).
pal_status pal_cell_node_gradients(const pal_cloud *cloud, const pal_cell_faces *faces,
                                   pal_gradients *out, pal_error *error);

#endif
