/// @file bvh.h  A tree of axis-aligned boxes over triangles: closest point, box overlap.
/// Built by median splits along the longest side of the centroids' box; ties are broken by the
/// triangle's number, so the tree is deterministic. Thread: any, read-only after pal_bvh_build.
#ifndef PALPATE_SRC_BVH_H
#define PALPATE_SRC_BVH_H

#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_bvh_box {
    double low[3], high[3];
    int32_t first, count; ///< leaf: triangles order[first .. first+count); inner: count = 0
    int32_t right;        ///< inner: second child; the first one follows its parent
} pal_bvh_box;

typedef struct pal_bvh {
    int32_t triangle_count, box_count;
    const double *x;  ///< (vertices x 3), borrowed
    const int32_t *v; ///< (triangle_count x 3), borrowed
    int32_t *order;   ///< (triangle_count)
    pal_bvh_box *box;
} pal_bvh;

pal_status pal_bvh_build(pal_bvh *bvh, const double *x, const int32_t *v, int32_t triangle_count,
                         pal_error *error);
void pal_bvh_clear(pal_bvh *bvh);

/// Closest point of the triangles to x.
/// @param[out] point  may be NULL. @return the triangle's number (smallest among equally close
/// ones)
int32_t pal_bvh_closest(const pal_bvh *bvh, const double x[3], double point[3], double *distance);

/// The same among the triangles whose normal is less than 90 degrees from `side`: near a sharp edge
/// or in a thin sheet the other side may be closer. @return -1 when there is none
int32_t pal_bvh_closest_side(const pal_bvh *bvh, const double x[3], const double side[3],
                             double point[3], double *distance);

/// Call `visit` for every triangle whose box overlaps [low, high]; stops when it returns non-zero.
void pal_bvh_overlap(const pal_bvh *bvh, const double low[3], const double high[3],
                     int (*visit)(void *user, int32_t triangle), void *user);

#endif
