/// @file triangle_cross.h  Do two triangles of a surface intersect?
#ifndef PALPATE_SRC_TRIANGLE_CROSS_H
#define PALPATE_SRC_TRIANGLE_CROSS_H

#include <stdint.h>

/// 1 when triangles a and b (vertex numbers into x) have a point in common besides the vertices and
/// the edge that they share. Touching counts. Exact for coordinates that come from single
/// precision. Pure function; any thread.
int pal_triangles_cross(const double *x, const int32_t a[3], const int32_t b[3]);

#endif
