/// @file vec.h  Three-vectors (private).
#ifndef PALPATE_HAPTIC_VEC_H
#define PALPATE_HAPTIC_VEC_H

#include <math.h>

static inline double v3_dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static inline void v3_sub(const double a[3], const double b[3], double out[3]) {
    for (int c = 0; c < 3; c++) {
        out[c] = a[c] - b[c];
    }
}

/// out = a + s b; out may be a
static inline void v3_add(const double a[3], double s, const double b[3], double out[3]) {
    for (int c = 0; c < 3; c++) {
        out[c] = a[c] + s * b[c];
    }
}

static inline void v3_cross(const double a[3], const double b[3], double out[3]) {
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

static inline double v3_norm(const double a[3]) {
    return sqrt(v3_dot(a, a));
}

static inline double v3_distance(const double a[3], const double b[3]) {
    double d[3];
    v3_sub(a, b, d);
    return v3_norm(d);
}

static inline void v3_copy(const double a[3], double out[3]) {
    out[0] = a[0];
    out[1] = a[1];
    out[2] = a[2];
}

/// Area vector of triangle abc times two.
static inline void v3_normal(const double a[3], const double b[3], const double c[3],
                             double out[3]) {
    double u[3], v[3];
    v3_sub(b, a, u);
    v3_sub(c, a, v);
    v3_cross(u, v, out);
}

/// Closest point of segment ab to x: its parameter in [0, 1].
static inline double v3_segment_parameter(const double x[3], const double a[3], const double b[3]) {
    double u[3], w[3];
    v3_sub(b, a, u);
    v3_sub(x, a, w);
    double uu = v3_dot(u, u);
    return uu > 0.0 ? fmin(1.0, fmax(0.0, v3_dot(u, w) / uu)) : 0.0;
}

#endif
