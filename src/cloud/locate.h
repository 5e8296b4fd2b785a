/// @file locate.h  Points against the cloud's surface: inside or outside, nearest triangle,
/// weights.
#ifndef PALPATE_SRC_LOCATE_H
#define PALPATE_SRC_LOCATE_H

#include <stdint.h>

#include "src/cloud/cloud.h"

/// Generalised winding number of the surface triangles around x: 1 inside, 0 outside.
/// Source: Van Oosterom, Strackee 1983 (solid angle of a triangle).
double pal_cloud_winding(const pal_cloud *cloud, const double x[3]);

/// Nearest point of a triangle to x.
/// @param[out] weight  barycentric weights of the nearest point, >= 0, sum 1
/// @return squared distance
double pal_triangle_nearest(const double a[3], const double b[3], const double c[3],
                            const double x[3], double weight[3]);

/// Triangles around each surface node (compressed lists).
typedef struct pal_triangle_ring {
    int32_t *start; ///< (surface_count + 1)
    int32_t *item;  ///< triangle indices
} pal_triangle_ring;
pal_status pal_triangle_ring_build(const pal_cloud *cloud, pal_triangle_ring *out,
                                   pal_error *error);
void pal_triangle_ring_clear(pal_triangle_ring *ring);

/// Nearest surface triangle to x among the rings of the given surface nodes.
/// @return its index; *distance and weight[3] as in pal_triangle_nearest
int32_t pal_cloud_nearest_triangle(const pal_cloud *cloud, const pal_triangle_ring *ring,
                                   const int32_t *candidates, int32_t count, const double x[3],
                                   double *distance, double weight[3]);

#endif
