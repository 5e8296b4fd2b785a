/// @file contact_surface.h  The smooth rest surface: closest point, line intersection (private).
///
/// The model's surface triangles, all of them (also those no tool may touch: a tool under the body
/// must find the underside), carry a smooth geometry:
///
///     position  x(b) = sum_i b_i p_i + sum_{i<j} b_i b_j c_ij
///
///     normal    n(b) = sum_i b_i n_i, made unit
///
/// (Phong tessellation with alpha = 1/2, Boubekeur and Alexa 2008) with n_i the normal of the
/// corner's smooth sector (weights of Max 1999, exact on spheres; the fan of triangles around a
/// node is cut at edges that bend by more than 40 degrees, so boxes keep flat faces and sharp
/// edges) and c_ij from n_i, n_j alone, the same from both sides: the surface has no gaps, and
/// normals are continuous except across sharp edges. On a sphere the error is O(h^4) along edges.
///
/// How a point is projected. `closest` finds x with p = x + s n(x): the line through p along the
/// *interpolated* normal (Phong projection; Kobbelt et al. 1998, Panozzo et al. 2013), not the foot
/// of the shortest distance to triangles. n is continuous, so x, n and s are continuous in p right
/// across edges, on both sides of the surface and at any depth less than the radius of curvature;
/// the shortest distance would click at every edge as seen from inside. At a sharp edge the normals
/// between those of its two sides belong to the edge (from outside a convex one; a corner
/// likewise), so that a ball rolls over it continuously; inside a convex edge two sides are equally
/// near (medial axis): there `track` stays on its side where `closest` changes over.
///
/// Real-time safe after init: no allocation, bounded by counts, same input same bits. Immutable
/// after init; any number of threads.
#ifndef PALPATE_HAPTIC_CONTACT_SURFACE_H
#define PALPATE_HAPTIC_CONTACT_SURFACE_H

#include <stddef.h>
#include <stdint.h>

#include "haptic/model/model.h"

/// Node of the tree of boxes around the patches. count > 0: a leaf of order[first ..]; count 0: its
/// children are the next box and box `first`.
typedef struct pal_rest_box {
    double low[3], high[3]; ///< [m]
    int32_t first, count;
} pal_rest_box;

typedef struct pal_rest_surface {
    int32_t triangle_count;
    int32_t node_count;      ///< surface nodes
    const int32_t *triangle; ///< the model's (triangle_count x 3)
    const double *position;  ///< the model's (node_count x 3) [m]
    double *corner_normal;   ///< unit, shape [triangle_count, 3 corners, 3]
    double *bend;    ///< c_ij of edge e = (corner e, corner e+1) [m], shape [triangle_count, 3, 3]
    int32_t *across; ///< 3 t' + e' of the edge on the other side; -1: none; [triangle_count, 3]
    double *node_normal; ///< unit, over the whole fan (no sectors), shape [node_count, 3]
    int32_t *fan_start;  ///< corners around each node, shape [node_count + 1]
    int32_t *fan;        ///< 3 t + corner by node, shape [3 triangle_count]
    double *inside;      ///< see pal_surface_point.inside, at nodes [m], shape [node_count]
    uint8_t *touchable;  ///< all three nodes are touchable columns, shape [triangle_count]
    uint8_t *sharp;      ///< bit e: edge e is sharp, shape [triangle_count]
    pal_rest_box *box;   ///< tree of boxes; 0 is the root
    int32_t box_count;
    int32_t *order; ///< triangles by leaf, shape [triangle_count]
} pal_rest_surface;

/// A point of the smooth surface.
typedef struct pal_surface_point {
    int32_t triangle;   ///< index of the model's triangle; -1: none
    double weight[3];   ///< barycentric, >= 0, sum 1
    double position[3]; ///< [m]
    double normal[3];   ///< unit, outward; at a sharp edge or corner, the one that points to p
    /// closest, track: signed height of p above the surface along `normal` (negative: inside the
    /// body); project: distance of the hit along the direction, signed [m].
    double distance;
    /// How far inside the touchable region: distance to its boundary [m], positive inside, 0 on the
    /// boundary, negative outside. Exact at nodes, linear over triangles, so continuous, with slope
    /// about 1. Where there is no boundary, the body's size. A law lets a contact fade over some
    /// width of this (0 at inside <= 0): then tools glide off the region instead of clicking.
    double inside;
} pal_surface_point;

/// Bytes that pal_rest_init needs for a model (a multiple of 64).
size_t pal_rest_bytes(const pal_model *model);

/// Build in `memory` (64-byte aligned, pal_rest_bytes() long). The model must outlive the surface.
/// Cost: O(n log n), at creation.
void pal_rest_init(pal_rest_surface *surface, const pal_model *model, void *memory);

/// The point whose normal goes through p and that is nearest to p.
/// @param reach  look no farther than this [m]
/// @param hint   a triangle to start from (that of the last tick), or -1: only speeds the search
/// up,
///               the answer does not depend on it
/// @param[out] out  triangle = -1 when none is within reach (beyond the rim of an open surface)
/// @return 1 found, 0 not
/// Cost: up to PALPATE_REST_TESTS triangles, boxes twice that; typically 2 to 10. When the count
/// runs out (p near the centre of a sphere: all of it is equally near) the nearest so far is
/// returned.
int pal_rest_closest(const pal_rest_surface *surface, const double p[3], double reach, int32_t hint,
                     pal_surface_point *out);
enum { PALPATE_REST_TESTS = 256 };

/// The same branch as at `from` (the last tick's point, on the same object): follows the surface
/// from there across at most PALPATE_REST_STEPS edges, so that a tool pressed past the middle of a
/// thin organ keeps the side it came from. Continuous in p as long as p stays within the radius of
/// curvature.
/// @param[in] from  may be `out`
/// @return 1 found; 0 lost (out->triangle = -1): use pal_rest_closest
int pal_rest_track(const pal_rest_surface *surface, const double p[3], double reach,
                   const pal_surface_point *from, pal_surface_point *out);
enum { PALPATE_REST_STEPS = 32 };

/// A hit of the line origin + t direction whose normal has normal . direction > min_cosine: give
/// the *outward* direction (normal at the contact's foot). Fade a contact as normal . direction
/// falls to min_cosine: there the surface turns away from the line and hits come and go.
/// @param direction  unit, outward
/// @param reach      |t| at most [m]
/// @param hint       a triangle (that of the contact's foot): the hit is the one that a walk over
/// the
///                   surface from there towards the line comes to, so never on another fold; when
///                   there is none, or for -1, the hit with |t| least
/// @return 1 hit, 0 none (out->triangle = -1)
/// Cost: one triangle per edge crossed, PALPATE_REST_STEPS at most; else PALPATE_REST_TESTS
/// triangles.
int pal_rest_project(const pal_rest_surface *surface, const double origin[3],
                     const double direction[3], double reach, double min_cosine, int32_t hint,
                     pal_surface_point *out);

/// A direction for many lines.
typedef struct pal_rest_aim {
    double direction[3], across[2][3], over[3];
} pal_rest_aim;

/// @return 1; 0: `direction` is not of length 1
int pal_rest_aim_at(const double direction[3], pal_rest_aim *out);

/// The walk of pal_rest_project alone, from a place near the hit (that of the last tick, or the
/// contact's foot): two or three Newton steps where it is in the same triangle.
/// @param[in] from  triangle and weight are read; -1: none; may be `out`
/// @return 1 hit; 0: the walk came to none (out->triangle = -1)
int pal_rest_follow(const pal_rest_surface *surface, const pal_rest_aim *aim,
                    const double origin[3], double reach, double min_cosine,
                    const pal_surface_point *from, pal_surface_point *out);

/// Fill position, normal and inside at triangle, weight (>= 0, sum 1); distance is set to 0.
void pal_rest_point(const pal_rest_surface *surface, int32_t triangle, const double weight[3],
                    pal_surface_point *out);

#endif
