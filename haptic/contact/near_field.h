/// @file near_field.h  The regular part of the compliance between neighbouring nodes (private).
///
/// Under a point load at the surface, displacement is the half-space's own,
///
///     G_ab = (t I + (n - t) n_a n_b^T) / |X_a - X_b|     (n_a: outward normals)
///     n = (1 - nu^2) / (pi E) (Boussinesq), t = (1 + nu)(1 - nu/2) / (pi E) (Cerruti, mean of
///     directions)
///
/// plus what the body's shape and supports add, R = C - G, which varies slowly. A mesh cannot
/// resolve 1/r between a node and its neighbours: there (cell method, measured on four bodies by
/// bench-ripple) C_aa - R is 6.7 to 7.2 n / h instead of 4.2 n / h for the node's share of the
/// surface, and C_ab - R is 0.5 to 0.7 of n / r. The sums agree, so loads spread over many nodes
/// are right, but a load on a few feels where the nodes are: the compliance at a point slid over
/// the surface rises and falls by 20 % of itself. Two edges away R is right in the mean but still
/// scatters by 0.25 n / h, which a pattern of points feels as a ripple of 3 %; farther out it is
/// smooth. So, with m = 1 or 2 edges taken for near,
///
///     R_aa = mean over the nodes c next beyond (2; or 3 and 4 edges away) of R_ac,
///     R_ab = (R_aa + R_bb) / 2 within m edges,
///
/// and 1/r is put back where loads act, with their own areas. The ripple is then below 0.3 %
/// (median), that of a ball's force below 1 %.
///
/// Symmetric, so that forces stay those of an energy; a raw model's skew part is kept.
/// Immutable after init; any thread; queries are real-time safe.
#ifndef PALPATE_HAPTIC_NEAR_FIELD_H
#define PALPATE_HAPTIC_NEAR_FIELD_H

#include <stddef.h>
#include <stdint.h>

#include "haptic/contact/contact_surface.h"

/// Compliance of a node with itself over n, times the root of its share of the surface: the
/// constant that makes sum_b A_b / r_ab the quadrature of the integral of 1/r on lattices
/// (square 3.9002, hexagonal 3.9210).
#define PALPATE_NEAR_SELF 3.91

typedef struct pal_near_field {
    const pal_model *model;
    double normal, tangent; ///< n, t [m^2/N]; 0 when the model has no material
    double *regular;        ///< R_aa, symmetric, shape [column_count, 3, 3] [m/N]
    double *spacing;        ///< mean length of a node's edges [m], shape [column_count]
    int32_t *start;         ///< neighbours of each column, shape [column_count + 1]
    int32_t *neighbour;     ///< columns within m edges, ascending per node
    int32_t *edge_start;    ///< the same for those one edge away
    int32_t *edge;
} pal_near_field;

/// Bytes that pal_near_init needs (a multiple of 64).
size_t pal_near_bytes(const pal_model *model);

/// Build in `memory` (64-byte aligned). The model must outlive it; the surface is only read here.
/// Cost: O(column_count) accesses to C_TT around its diagonal, at creation.
/// @param edges  m: 1, or 2
void pal_near_init(pal_near_field *near, const pal_model *model, const pal_rest_surface *surface,
                   int32_t edges, void *memory);

/// R_ab of columns a, b where the mesh does not resolve it.
/// @param[out] r  column-major 3 x 3 [m/N]: displacement at a per force at b
/// @return 1: a == b or within m edges; 0: farther (r unchanged; R_ab = C_ab - G_ab)
int pal_near_pair(const pal_near_field *near, int32_t a, int32_t b, double r[9]);

/// G_ab of columns a != b, column-major 3 x 3 [m/N].
void pal_near_kernel(const pal_near_field *near, int32_t a, int32_t b, double g[9]);

#endif
