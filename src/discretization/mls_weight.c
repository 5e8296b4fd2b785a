/// @file mls_weight.c  Radial weights of moving least squares, singular and inverted, with
/// derivatives.
///
/// The quartic spline of paper 1, Eq. 1, is (1 - s)^3 (1 + 3 s); in this form nothing cancels near
/// s = 1, and W'/s = -12 (1 - s)^2, W'' - W'/s = 24 s (1 - s) have no division left. Powers of s
/// are handled the same way, so that 1 / W = s^2p / w(s) is exact down to s = 0.
#include "src/discretization/mls_weight.h"

#include <math.h>

static const double gaussian_width = 0.4;

/// Second derivative m is d_first d_second: xx xy xz yy yz zz.
static const int8_t pair_first[6] = {0, 0, 0, 1, 1, 2};
static const int8_t pair_second[6] = {0, 1, 2, 1, 2, 2};

static pal_radial window(pal_weight kind, double s) {
    pal_radial f = {0.0, 0.0, 0.0};
    if (s >= 1.0) {
        return f;
    }
    if (kind == PALPATE_WEIGHT_GAUSSIAN) {
        double a = 1.0 / (gaussian_width * gaussian_width);
        f.value = exp(-a * s * s);
        f.slope = -2.0 * a * f.value;
        f.bend = 4.0 * a * a * s * s * f.value;
        return f;
    }
    double t = 1.0 - s; // 1 - 6 s^2 + 8 s^3 - 3 s^4 = (1 - s)^3 (1 + 3 s)
    f.value = t * t * t * (1.0 + 3.0 * s);
    f.slope = -12.0 * t * t;
    f.bend = 24.0 * s * t;
    return f;
}

static double power_of(double s, int32_t n) {
    double value = 1.0;
    for (int32_t i = 0; i < n; i++) {
        value *= s;
    }
    return value;
}

static pal_radial product(pal_radial f, pal_radial h, double s) {
    pal_radial r;
    r.value = f.value * h.value;
    r.slope = f.value * h.slope + f.slope * h.value;
    r.bend = f.value * h.bend + f.bend * h.value + 2.0 * (s * f.slope) * (s * h.slope);
    return r;
}

pal_radial pal_weight_at(pal_weight kind, int32_t exponent, double s) {
    pal_radial f = window(kind, s);
    if (exponent == 0 || s >= 1.0) {
        return f;
    }
    double n = 2.0 * exponent;
    pal_radial pole;
    pole.value = 1.0 / power_of(s, 2 * exponent);
    double over = pole.value / (s * s);
    pole.slope = -n * over;
    pole.bend = n * (n + 2.0) * over;
    return product(f, pole, s);
}

pal_radial pal_weight_inverse(pal_weight kind, int32_t exponent, double s) {
    pal_radial w = window(kind, s);
    double ds = s * w.slope; // w'
    pal_radial inverse;
    inverse.value = 1.0 / w.value;
    double square = inverse.value * inverse.value;
    inverse.slope = -w.slope * square;
    inverse.bend = -w.bend * square + 2.0 * ds * ds * square * inverse.value;
    if (exponent == 0) {
        return inverse;
    }
    double n = 2.0 * exponent;
    pal_radial pole;
    double below = power_of(s, 2 * exponent - 2);
    pole.value = below * s * s;
    pole.slope = n * below;
    pole.bend = n * (n - 2.0) * below;
    return product(pole, inverse, s);
}

void pal_radial_terms(pal_radial f, const double delta[3], double s, int order, double *out) {
    out[0] = f.value;
    if (order < 1) {
        return;
    }
    double n[3] = {0.0, 0.0, 0.0};
    for (int i = 0; i < 3; i++) {
        out[1 + i] = f.slope * delta[i];
        n[i] = s > 0.0 ? delta[i] / s : 0.0;
    }
    if (order < 2) {
        return;
    }
    for (int m = 0; m < 6; m++) {
        int i = pair_first[m], j = pair_second[m];
        out[4 + m] = (i == j ? f.slope : 0.0) + f.bend * n[i] * n[j];
    }
}
