/// @file cover.h  The open cover of the body: one sphere per node (paper 1, section 2.2, in 3D).
#ifndef PALPATE_SRC_COVER_H
#define PALPATE_SRC_COVER_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/cloud/cloud.h"

typedef struct pal_cover {
    int32_t node_count;
    double *radius;             ///< (node_count) radius of each node's sphere
    int32_t enlarged;           ///< spheres that the rules left too small to cover their tetrahedra
    double largest_enlargement; ///< factor, >= 1
    double min, mean, max;      ///< radii over the node's spacing
} pal_cover;

/// Sphere radii from the cloud's edges, then enlarged where needed, so that the union of the
/// spheres contains the body: every point of a tetrahedron lies in the sphere of one of its own
/// vertices.
/// @return PALPATE_OK; _ARGUMENT (a node without a tetrahedron: located), _MEMORY
/// Cost: O(tetrahedra). Thread: any. Source: De, Hong, Bathe 2003, section 2.2.
pal_status pal_cover_build(const pal_cloud *cloud, pal_cover *out, pal_error *error);
void pal_cover_clear(pal_cover *cover);

#endif
