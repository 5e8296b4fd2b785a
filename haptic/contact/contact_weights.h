/// @file contact_weights.h  Weights Phi of surface nodes at a point of the rest surface (private).
///
/// Displacement at a surface point x is u(x) = sum_j phi_j(x) u_j, and a force f at x acts on the
/// nodes as phi_j f (virtual work). Moving least squares on the surface: nodes in the tangent plane
/// at x, basis (1, xi, eta), weight
///
///     w_j = (1 - r_j^2 / rho^2)^p,    r_j = |x - X_j| 2 / (1 + n(x) . n_j) < rho
///
/// rho = the larger of the (K+1)-th smallest r_j and the radius asked for.
/// The (K+1)-th distance is continuous in x and the node at that distance has weight 0, so nodes
/// enter and leave smoothly: phi is continuous in x all over the surface. The factor takes a node
/// of the other side of a thin lobe out of reach continuously (n: fan normals, continuous across
/// sharp edges too); besides, candidates are connected along the surface. sum_j phi_j = 1 always;
/// linear fields of the tangent plane are reproduced wherever the stencil is not almost on a line
/// (there, as at a single node, a ridge turns the basis smoothly into the constant).
///
/// Candidates per triangle are precomputed. Real-time safe after init, immutable, any thread.
#ifndef PALPATE_HAPTIC_CONTACT_WEIGHTS_H
#define PALPATE_HAPTIC_CONTACT_WEIGHTS_H

#include "haptic/contact/contact_surface.h"

/// Defaults by `make bench-ripple` (near field, four bodies; ripple of a point's compliance, worst
/// of all windows at p = 2): 0.5 % at K = 5, 0.41 % at 7, 0.24 % at 9, 0.23 % at 12,
/// 0.29 % at 19; p makes little difference. Each node more costs a column of the working set.
enum {
    PALPATE_WEIGHTS_MAX = 40,       ///< nodes of one point at most
    PALPATE_WEIGHTS_NODES = 9,      ///< default K
    PALPATE_WEIGHTS_POWER = 2,      ///< default p
    PALPATE_WEIGHTS_CANDIDATES = 96 ///< per triangle at most
};

typedef struct pal_weights {
    int32_t count;                       ///< 0 .. PALPATE_WEIGHTS_MAX
    int32_t column[PALPATE_WEIGHTS_MAX]; ///< indices into model->column_node, ascending
    double phi[PALPATE_WEIGHTS_MAX];     ///< sum 1 (when count > 0)
    double sigma;  ///< width of the kernel: sqrt of the mean of xi^2 (= that of eta^2) under w [m]
    double radius; ///< support radius rho in use [m]
} pal_weights;

typedef struct pal_weights_table {
    const pal_rest_surface *surface;
    const pal_model *model;
    int32_t nodes;      ///< K
    int32_t power;      ///< p
    int32_t *list;      ///< a triangle's list of candidates, -1: none near; shape [triangle_count]
    int32_t *near;      ///< candidates that K nodes need, per list
    int32_t *count;     ///< all candidates, per list
    int32_t *candidate; ///< columns, nearest first, shape [lists, PALPATE_WEIGHTS_CANDIDATES]
    float *away;        ///< of the candidates from the triangle's middle, at most [m], as candidate
} pal_weights_table;

/// Bytes that pal_weights_init needs (a multiple of 64).
size_t pal_weights_bytes(const pal_model *model);

/// Build in `memory` (64-byte aligned, pal_weights_bytes() long). Surface, model must outlive it.
/// @param nodes  K, 3 .. PALPATE_WEIGHTS_MAX - 1; PALPATE_WEIGHTS_NODES
/// @param power  p, 1 .. 4; PALPATE_WEIGHTS_POWER
void pal_weights_init(pal_weights_table *table, const pal_model *model,
                      const pal_rest_surface *surface, int32_t nodes, int32_t power, void *memory);

/// Weights at a surface point.
/// @param radius  support radius wanted at least [m], for points that stand for a cell wider than
/// the
///                node spacing; 0: as K gives it. Cut to what PALPATE_WEIGHTS_MAX nodes can carry
///                (continuously).
/// @return count (0 where no touchable node is near: at points with inside < 0 far enough out)
/// Cost: about 15 nodes looked at, 0.3 us; O(candidates), 1 us, where a radius is asked for.
/// Continuous in the point and in radius.
int32_t pal_weights_at(const pal_weights_table *table, const pal_surface_point *at, double radius,
                       pal_weights *out);

/// Ask for a triangle's candidates to be in the cache.
void pal_weights_fetch(const pal_weights_table *table, int32_t triangle);

#endif
