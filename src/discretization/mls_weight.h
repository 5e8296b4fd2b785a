/// @file mls_weight.h  Radial weights of moving least squares and their derivatives (private to
/// MLS).
#ifndef PALPATE_SRC_MLS_WEIGHT_H
#define PALPATE_SRC_MLS_WEIGHT_H

#include <stdint.h>

#include "src/discretization/mls.h"

/// A radial function f(s): value, slope = f'/s, bend = f'' - f'/s. With delta = (x - x_J) / radius,
/// |delta| = s, n = delta / s:  d_i f = slope delta_i / radius,
/// d_ij f = (slope delta_ij + bend n_i n_j) / radius^2.
typedef struct pal_radial {
    double value, slope, bend;
} pal_radial;

/// W = w(s) / s^2p for s > 0 (zero from s = 1 on). @param exponent  p >= 0
pal_radial pal_weight_at(pal_weight kind, int32_t exponent, double s);

/// 1 / W = s^2p / w(s), smooth at s = 0. Needs 0 <= s < 1.
pal_radial pal_weight_inverse(pal_weight kind, int32_t exponent, double s);

/// Value, gradient and second derivatives (xx xy xz yy yz zz) by scaled coordinates.
/// @param order  terms wanted: 0, 1 or 2 @param[out] out  shape [1, 4 or 10]
void pal_radial_terms(pal_radial f, const double delta[3], double s, int order, double *out);

#endif
