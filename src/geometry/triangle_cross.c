/// @file triangle_cross.c  Exact triangle-triangle intersection by signs of determinants.
///
/// orient3d = det(b - a, c - a, d - a) is evaluated in double with a forward error bound (Shewchuk
/// 1997, the static part) and, when that cannot decide the sign, in 113-bit arithmetic: differences
/// of singles of similar size have at most some 30 bits, so their triple products fit.
#include "src/geometry/triangle_cross.h"

#include <math.h>
#include <stddef.h>

__extension__ typedef __float128 quad;

static int sign_of(quad value) {
    return (value > 0) - (value < 0);
}

static int orient3d(const double *a, const double *b, const double *c, const double *d) {
    double m[3][3], q[3][3];
    const double *row[3] = {b, c, d};
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            m[i][k] = row[i][k] - a[k];
            q[i][k] = fabs(m[i][k]);
        }
    }
    double value = m[0][0] * (m[1][1] * m[2][2] - m[1][2] * m[2][1]) +
                   m[0][1] * (m[1][2] * m[2][0] - m[1][0] * m[2][2]) +
                   m[0][2] * (m[1][0] * m[2][1] - m[1][1] * m[2][0]);
    double bound = q[0][0] * (q[1][1] * q[2][2] + q[1][2] * q[2][1]) +
                   q[0][1] * (q[1][2] * q[2][0] + q[1][0] * q[2][2]) +
                   q[0][2] * (q[1][0] * q[2][1] + q[1][1] * q[2][0]);
    if (fabs(value) > 1e-14 * bound) {
        return value > 0.0 ? 1 : -1;
    }
    quad e[3][3];
    for (int i = 0; i < 3; i++) {
        for (int k = 0; k < 3; k++) {
            e[i][k] = (quad)row[i][k] - (quad)a[k];
        }
    }
    return sign_of(e[0][0] * (e[1][1] * e[2][2] - e[1][2] * e[2][1]) +
                   e[0][1] * (e[1][2] * e[2][0] - e[1][0] * e[2][2]) +
                   e[0][2] * (e[1][0] * e[2][1] - e[1][1] * e[2][0]));
}

/// Orientation of abc seen along an axis (coordinates u, v are kept).
static int orient2d(const double *a, const double *b, const double *c, int u, int v) {
    quad x1 = (quad)b[u] - (quad)a[u], y1 = (quad)b[v] - (quad)a[v];
    quad x2 = (quad)c[u] - (quad)a[u], y2 = (quad)c[v] - (quad)a[v];
    return sign_of(x1 * y2 - y1 * x2);
}

/// Axes to keep for a triangle: drop the largest component of its normal.
static void plane_axes(const double *a, const double *b, const double *c, int *u, int *v) {
    double n[3], best = -1.0;
    int drop = 0;
    for (int k = 0; k < 3; k++) {
        int i = (k + 1) % 3, j = (k + 2) % 3;
        n[k] = fabs((b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]));
        if (n[k] > best) {
            best = n[k];
            drop = k;
        }
    }
    *u = (drop + 1) % 3;
    *v = (drop + 2) % 3;
}

static int between(const double *p, const double *a, const double *b, int u, int v) {
    return p[u] >= fmin(a[u], b[u]) && p[u] <= fmax(a[u], b[u]) && p[v] >= fmin(a[v], b[v]) &&
           p[v] <= fmax(a[v], b[v]);
}

static int segments_cross_2d(const double *p, const double *q, const double *a, const double *b,
                             int u, int v) {
    int o1 = orient2d(p, q, a, u, v), o2 = orient2d(p, q, b, u, v);
    int o3 = orient2d(a, b, p, u, v), o4 = orient2d(a, b, q, u, v);
    if (o1 * o2 < 0 && o3 * o4 < 0) {
        return 1;
    }
    return (o1 == 0 && between(a, p, q, u, v)) || (o2 == 0 && between(b, p, q, u, v)) ||
           (o3 == 0 && between(p, a, b, u, v)) || (o4 == 0 && between(q, a, b, u, v));
}

static int inside_2d(const double *p, const double *a, const double *b, const double *c, int u,
                     int v) {
    int s1 = orient2d(a, b, p, u, v), s2 = orient2d(b, c, p, u, v), s3 = orient2d(c, a, p, u, v);
    return (s1 >= 0 && s2 >= 0 && s3 >= 0) || (s1 <= 0 && s2 <= 0 && s3 <= 0);
}

/// Segment pq against triangle abc, both closed.
static int segment_crosses(const double *p, const double *q, const double *a, const double *b,
                           const double *c) {
    int sp = orient3d(a, b, c, p), sq = orient3d(a, b, c, q);
    if (sp * sq > 0) {
        return 0;
    }
    if (sp == 0 && sq == 0) {
        int u, v;
        plane_axes(a, b, c, &u, &v);
        return inside_2d(p, a, b, c, u, v) || inside_2d(q, a, b, c, u, v) ||
               segments_cross_2d(p, q, a, b, u, v) || segments_cross_2d(p, q, b, c, u, v) ||
               segments_cross_2d(p, q, c, a, u, v);
    }
    int s1 = orient3d(p, q, a, b), s2 = orient3d(p, q, b, c), s3 = orient3d(p, q, c, a);
    return (s1 >= 0 && s2 >= 0 && s3 >= 0) || (s1 <= 0 && s2 <= 0 && s3 <= 0);
}

int pal_triangles_cross(const double *x, const int32_t a[3], const int32_t b[3]) {
    int shared = 0, ia = 0, ib = 0, other_a = 3, other_b = 3;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            if (a[i] == b[j]) {
                shared++;
                ia = i;
                ib = j;
                other_a -= i;
                other_b -= j;
            }
        }
    }
    const double *pa[3], *pb[3];
    for (int k = 0; k < 3; k++) {
        pa[k] = x + 3 * (size_t)a[k];
        pb[k] = x + 3 * (size_t)b[k];
    }
    if (shared == 0) {
        for (int k = 0; k < 3; k++) {
            if (segment_crosses(pa[k], pa[(k + 1) % 3], pb[0], pb[1], pb[2]) ||
                segment_crosses(pb[k], pb[(k + 1) % 3], pa[0], pa[1], pa[2])) {
                return 1;
            }
        }
        return 0;
    }
    if (shared == 1) { // only the edges opposite the shared vertex can reach the other triangle
        return segment_crosses(pa[(ia + 1) % 3], pa[(ia + 2) % 3], pb[0], pb[1], pb[2]) ||
               segment_crosses(pb[(ib + 1) % 3], pb[(ib + 2) % 3], pa[0], pa[1], pa[2]);
    }
    if (shared == 2) { // folded flat onto each other?
        const double *c = pa[other_a], *d = pb[other_b];
        const double *p = pa[(other_a + 1) % 3], *q = pa[(other_a + 2) % 3];
        if (orient3d(pa[0], pa[1], pa[2], d) != 0) {
            return 0;
        }
        int u, v;
        plane_axes(pa[0], pa[1], pa[2], &u, &v);
        return orient2d(p, q, c, u, v) * orient2d(p, q, d, u, v) > 0;
    }
    return 1; // the same three vertices
}
