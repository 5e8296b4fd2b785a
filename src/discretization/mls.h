/// @file mls.h  Moving least squares shape functions and their derivatives, singular weights
/// included.
///
/// h_J(x) = W_J(x) p(x)^T A(x)^-1 p(x_J),  A(x) = sum_J W_J(x) p(x_J) p(x_J)^T  (paper 1, Eqs.
/// 39-40) with complete polynomials p of degree 1, 2 or 3 in space (4, 10, 20 monomials) and the
/// weight W_J(x) = w(s) / s^2p, s = |x - x_J| / radius. For p >= 1 the shape functions interpolate:
/// h_J(x_K) = delta_JK. Mathematics of the evaluation: mls.c.
///
/// Thread: a pal_mls belongs to one thread at a time; everything else is read only.
#ifndef PALPATE_SRC_MLS_H
#define PALPATE_SRC_MLS_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/discretization/discretization.h"
#include "src/discretization/neighbours.h"

typedef enum pal_weight {
    PALPATE_WEIGHT_QUARTIC = 0, ///< paper 1, Eq. 1: w = 1 - 6 s^2 + 8 s^3 - 3 s^4, zero from s = 1
    PALPATE_WEIGHT_GAUSSIAN = 1 ///< w = exp(-(s / 0.4)^2), cut at s = 1 (0.002)
} pal_weight;

typedef struct pal_mls_options {
    pal_basis basis;
    pal_weight weight;
    int32_t exponent;            ///< p of s^-2p, 0..8; 0: regular weight (no interpolation)
    int32_t order;               ///< highest derivative wanted: 0, 1, 2
    pal_derivatives derivatives; ///< _DIFFUSE: the weights are held still while differentiating
    int32_t accept_deficient; ///< 1: use what basis the stencil supports (values at points within
                              ///< the stencil's own line or plane stay exact), never grow
} pal_mls_options;

/// What one evaluation met.
typedef struct pal_mls_info {
    int32_t rank;       ///< of the weighted monomials without the constant
    int32_t columns;    ///< full rank: 3, 9, 19
    double condition;   ///< of the scaled moment matrix (Frobenius, >= 1; 1 is perfect)
    int32_t centre;     ///< stencil index of the node nearest to x
    int32_t coincident; ///< stencil index of a node that coincides with the centre's; -1: none
} pal_mls_info;

/// Workspace of evaluations and result of pal_mls_stencil. Zero-initialise; grows as needed.
typedef struct pal_mls {
    int32_t capacity;
    void *block;
    double *work;
    // result of pal_mls_stencil
    int32_t count;     ///< nodes of the stencil
    int32_t *node;     ///< (count) their indices, nearest first
    double *distance2; ///< (count)
    double *position;  ///< (count x 3)
    double *phi;       ///< (count)
    double *dphi;      ///< (count x 3)
    double *d2phi;     ///< (count x 6) xx xy xz yy yz zz
    double radius;     ///< support radius used
    pal_mls_info info;
} pal_mls;

/// Number of monomials of a basis: 4, 10, 20.
int32_t pal_basis_size(pal_basis basis);
/// The basis in effect's usual stencil: 24, 60, 100 nodes.
int32_t pal_basis_neighbours(pal_basis basis);

/// Make room for stencils of up to `count` nodes. @return PALPATE_OK or _MEMORY (unchanged)
pal_status pal_mls_reserve(pal_mls *mls, int32_t count);
void pal_mls_clear(pal_mls *mls);

/// Shape functions of a given stencil at x, any point: a node, 1e-300 away from one, or between.
/// The derivatives of PALPATE_DERIVATIVES_FULL are those of h_J with stencil and radius held.
/// @param radius    support radius; a node at or beyond it has weight zero
/// @param position  the stencil's nodes, shape [count, 3]
/// @param[out] phi   values, shape [count]
/// @param[out] dphi  [1/length], shape [count, 3]; NULL allowed when order is 0
/// @param[out] d2phi [1/length^2] xx xy xz yy yz zz, shape [count, 6]; NULL allowed below order 2
/// @param[out] info  may be NULL; filled also on failure
/// @return PALPATE_OK; _STENCIL: deficient, or two nodes coincide at x (outputs undefined);
///         _MEMORY; _ARGUMENT. Cost: about 30 count columns^2 flops at order 2.
pal_status pal_mls_shape(pal_mls *mls, const pal_mls_options *options, const double x[3],
                         double radius, int32_t count, const double *position, double *phi,
                         double *dphi, double *d2phi, pal_mls_info *info);

/// Shape functions at x on its nearest `neighbours` nodes (ties at the last distance included, so
/// that the stencil does not depend on node numbering). A deficient stencil grows by half until the
/// basis is supported; the result is in `mls` (count, node, phi, dphi, d2phi, radius, info).
/// @param neighbours  0: pal_basis_neighbours()
/// @param[in,out] report  updated; may be NULL
/// @return PALPATE_OK; _STENCIL (located; coordinates as given), _MEMORY, _ARGUMENT
pal_status pal_mls_stencil(pal_mls *mls, const pal_neighbours *nodes,
                           const pal_mls_options *options, const double x[3], int32_t neighbours,
                           pal_stencil_report *report, pal_error *error);

#endif
