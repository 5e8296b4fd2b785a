/// @file contact_surface.c  Queries of the smooth rest surface.
///
/// Phong projection onto a patch: Newton's method on  x(b) + s N(b) = p  in (b1, b2, s), N = sum
/// b_i n_i not made unit (only s is scaled by that). Only solutions with a positive determinant
/// count: there the map (b, s) -> p preserves orientation, p is nearer than the centre of
/// curvature. At a sharp edge with normals n, m of its sides: x(t) + s ((1 - f) n(t) + f m(t)) = p
/// in (t, f, s), 0 <= t, f <= 1; at its ends, p - x in the cone of n, m and the node's mean normal.
/// All agree where they meet. Intersection with a line: Newton on the two components of x(b) -
/// origin across the direction. Patches come from the tree of boxes, nearest first, and are left
/// out once a box is farther than the best answer; equal answers (on shared edges) go to the lower
/// triangle.
#include <math.h>
#include <string.h>

#include "haptic/contact/contact_surface.h"
#include "haptic/base/vec.h"

enum { NEWTON = 10, STACK = 64, VISITS = 2 * PALPATE_REST_TESTS };
static const double LAST = 1e-6;      // of barycentrics: a step after which Newton is done
static const double TOLERANCE = 1e-9; // of barycentrics: shared edges belong to both sides

// ---- Small helpers ------------------------------------------------------------------------------

/// Solve x a + y b + z c = r. @return the determinant; 0: singular, out unchanged
static double solve3(const double a[3], const double b[3], const double c[3], const double r[3],
                     double out[3]) {
    double bc[3] = {b[1] * c[2] - b[2] * c[1], b[2] * c[0] - b[0] * c[2],
                    b[0] * c[1] - b[1] * c[0]};
    double ra[3] = {r[1] * a[2] - r[2] * a[1], r[2] * a[0] - r[0] * a[2],
                    r[0] * a[1] - r[1] * a[0]};
    double det = v3_dot(a, bc);
    out[0] = out[1] = out[2] = 0.0;
    if (!(fabs(det) > 0.0) || !isfinite(1.0 / det)) {
        return 0.0;
    }
    out[0] = v3_dot(r, bc) / det;
    out[1] = -v3_dot(c, ra) / det;
    out[2] = v3_dot(b, ra) / det;
    return det;
}

typedef struct patch {
    const double *p[3]; ///< corners
    const double *n;    ///< corner normals, shape [3, 3]
    const double *c;    ///< bends, shape [3, 3]
} patch;

static patch patch_of(const pal_rest_surface *s, int32_t t) {
    const int32_t *v = s->triangle + 3 * (size_t)t;
    return (patch){.p = {s->position + 3 * (size_t)v[0], s->position + 3 * (size_t)v[1],
                         s->position + 3 * (size_t)v[2]},
                   .n = s->corner_normal + 9 * (size_t)t,
                   .c = s->bend + 9 * (size_t)t};
}

static void patch_position(const patch *k, const double b[3], double x[3]) {
    double b01 = b[0] * b[1], b12 = b[1] * b[2], b20 = b[2] * b[0];
    for (int i = 0; i < 3; i++) {
        x[i] = b[0] * k->p[0][i] + b[1] * k->p[1][i] + b[2] * k->p[2][i] + b01 * k->c[i] +
               b12 * k->c[3 + i] + b20 * k->c[6 + i];
    }
}

static void patch_normal(const patch *k, const double b[3], double n[3]) {
    for (int i = 0; i < 3; i++) {
        n[i] = b[0] * k->n[i] + b[1] * k->n[3 + i] + b[2] * k->n[6 + i];
    }
}

/// Derivatives of the position by b1 and b2 (b0 = 1 - b1 - b2).
static void patch_slopes(const patch *k, const double b[3], double u[3], double v[3]) {
    for (int i = 0; i < 3; i++) {
        double c01 = k->c[i], c12 = k->c[3 + i], c20 = k->c[6 + i];
        u[i] = k->p[1][i] - k->p[0][i] + (b[0] - b[1]) * c01 + b[2] * (c12 - c20);
        v[i] = k->p[2][i] - k->p[0][i] + (b[0] - b[2]) * c20 + b[1] * (c12 - c01);
    }
}

// not fmin(), fmax(): calls into libm
static double larger(double a, double b) {
    return a > b ? a : b;
}

/// NaN when b[0] is: comparisons with it fail.
static double lowest(const double b[3]) {
    double low = b[1] < b[0] ? b[1] : b[0];
    return b[2] < low ? b[2] : low;
}

static void clip(double b[3]) {
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        b[i] = larger(b[i], 0.0);
        sum += b[i];
    }
    for (int i = 0; i < 3; i++) {
        b[i] /= sum;
    }
}

void pal_rest_point(const pal_rest_surface *surface, int32_t triangle, const double weight[3],
                    pal_surface_point *out) {
    patch k = patch_of(surface, triangle);
    const int32_t *v = surface->triangle + 3 * (size_t)triangle;
    out->triangle = triangle;
    out->inside = 0.0;
    for (int i = 0; i < 3; i++) {
        out->weight[i] = weight[i];
        out->inside += weight[i] * surface->inside[v[i]];
    }
    patch_position(&k, out->weight, out->position);
    patch_normal(&k, out->weight, out->normal);
    double length = sqrt(v3_dot(out->normal, out->normal));
    for (int i = 0; i < 3 && length > 0.0; i++) {
        out->normal[i] /= length;
    }
    out->distance = 0.0;
}

// ---- One patch ----------------------------------------------------------------------------------

/// Newton from (b, s): x(b) + s N(b) = p. @return 1: b inside the patch, on the near side of the
/// centre of curvature; 0: outside (b tells where to) or no convergence; -1: converged inside but
/// beyond it
static int solve_patch(const patch *k, const double p[3], double b[3], double *s, int patient) {
    double det = 0.0;
    for (int n = 0; n < NEWTON; n++) {
        double x[3], normal[3], u[3], v[3], r[3], step[3];
        patch_position(k, b, x);
        patch_normal(k, b, normal);
        patch_slopes(k, b, u, v);
        for (int i = 0; i < 3; i++) {
            r[i] = p[i] - x[i] - *s * normal[i];
            u[i] += *s * (k->n[3 + i] - k->n[i]);
            v[i] += *s * (k->n[6 + i] - k->n[i]);
        }
        det = solve3(u, v, normal, r, step);
        if (det == 0.0) {
            return 0;
        }
        b[1] += step[0];
        b[2] += step[1];
        b[0] = 1.0 - b[1] - b[2];
        *s += step[2];
        double moved = larger(fabs(step[0]), fabs(step[1])), low = lowest(b);
        if (moved < 1e-8) {
            return !(low >= -TOLERANCE) ? 0 : det > 0.0 ? 1 : -1;
        }
        // far outside and not coming back
        if (n > 0 && !patient && (low < -2.0 || moved < -0.5 * (low + 0.2))) {
            return 0;
        }
        if (!(low > -10.0)) {
            return 0;
        }
    }
    return 0;
}

/// A place for the best answer so far.
typedef struct search {
    const pal_rest_surface *surface;
    double p[3];
    double least; ///< squared distance of the best answer
    pal_surface_point *out;
} search;

static int better(const search *q, double r2, int32_t t) {
    return r2 < q->least || (r2 == q->least && (q->out->triangle < 0 || t < q->out->triangle));
}

static void offer_patch(search *q, int32_t t) {
    patch k = patch_of(q->surface, t);
    double b[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3}, x[3], n[3], d[3];
    patch_position(&k, b, x);
    patch_normal(&k, b, n);
    double length = v3_dot(n, n), s = 0.0;
    for (int i = 0; i < 3; i++) {
        d[i] = q->p[i] - x[i];
    }
    s = length > 0.0 ? v3_dot(d, n) / length : 0.0;
    if (solve_patch(&k, q->p, b, &s, 0) != 1) {
        return;
    }
    clip(b);
    patch_position(&k, b, x);
    for (int i = 0; i < 3; i++) {
        d[i] = q->p[i] - x[i];
    }
    if (better(q, v3_dot(d, d), t)) {
        q->least = v3_dot(d, d);
        pal_rest_point(q->surface, t, b, q->out);
        q->out->distance = v3_dot(d, q->out->normal);
    }
}

// ---- Sharp edges and corners --------------------------------------------------------------------

/// The answer: the point of the edge (weight b of triangle t) with the normal that points to p (s >
/// 0) or away from it.
static void offer_point(search *q, int32_t t, const double b[3], double side) {
    patch k = patch_of(q->surface, t);
    double x[3], d[3];
    patch_position(&k, b, x);
    for (int i = 0; i < 3; i++) {
        d[i] = q->p[i] - x[i];
    }
    if (!better(q, v3_dot(d, d), t)) {
        return;
    }
    double length = sqrt(v3_dot(d, d));
    q->least = v3_dot(d, d);
    pal_rest_point(q->surface, t, b, q->out);
    q->out->distance = side < 0.0 ? -length : length;
    for (int i = 0; i < 3 && length > 0.0; i++) {
        q->out->normal[i] = d[i] / q->out->distance;
    }
}

/// p - x(corner) inside the cone of the normals n, m and the node's mean normal. @param turn  1: n,
/// m follow each other counter-clockwise around the node, -1: clockwise
static void offer_corner(search *q, int32_t t, int c, const double n[3], const double m[3],
                         double turn) {
    int32_t node = q->surface->triangle[3 * (size_t)t + (size_t)c];
    const double *x = q->surface->position + 3 * (size_t)node;
    double d[3] = {q->p[0] - x[0], q->p[1] - x[1], q->p[2] - x[2]}, w[3];
    double det = solve3(n, m, q->surface->node_normal + 3 * (size_t)node, d, w);
    if (fabs(det) < 1e-6) {
        return; // two sectors only: their edges say it all
    }
    double size = fabs(w[0]) + fabs(w[1]) + fabs(w[2]);
    double side = w[0] + w[1] + w[2] < 0.0 ? -1.0 : 1.0;
    double least = fmin(side * w[0], fmin(side * w[1], side * w[2]));
    if (least >= -TOLERANCE * size && det * side * turn > 0.0) { // the open side of the corner
        double b[3] = {0.0, 0.0, 0.0};
        b[c] = 1.0;
        offer_point(q, t, b, side);
    }
}

/// Edge e of triangle t, once per edge (by its lower triangle).
static void offer_edge(search *q, int32_t t, int e) {
    const pal_rest_surface *s = q->surface;
    int32_t other = s->across[3 * t + e], u = other / 3, f = other - 3 * u;
    int next = (e + 1) % 3;
    patch k = patch_of(s, t), l = patch_of(s, u);
    const double *a = k.p[e], *c = k.p[next], *bend = k.c + 3 * e;
    const double *na = k.n + 3 * e, *nc = k.n + 3 * next;
    const double *ma = l.n + 3 * ((f + 1) % 3), *mc = l.n + 3 * f;
    double at = 0.5, share = 0.5, height = 0.0, det = 0.0;
    int found = 0;
    for (int n = 0; n < NEWTON && !found; n++) {
        double r[3], u_at[3], u_share[3], normal[3], step[3];
        for (int i = 0; i < 3; i++) {
            double here = (1.0 - at) * na[i] + at * nc[i], there = (1.0 - at) * ma[i] + at * mc[i];
            normal[i] = (1.0 - share) * here + share * there;
            double x = (1.0 - at) * a[i] + at * c[i] + at * (1.0 - at) * bend[i];
            r[i] = q->p[i] - x - height * normal[i];
            u_share[i] = height * (there - here);
            u_at[i] = c[i] - a[i] + (1.0 - 2.0 * at) * bend[i] +
                      height * ((1.0 - share) * (nc[i] - na[i]) + share * (mc[i] - ma[i]));
        }
        if (n == 0) { // height first: at 0 the share is undetermined
            height = v3_dot(r, normal) / fmax(v3_dot(normal, normal), 1e-12);
            for (int i = 0; i < 3; i++) {
                u_share[i] = height * 0.5 * (ma[i] + mc[i] - na[i] - nc[i]);
                r[i] -= height * normal[i];
            }
        }
        det = solve3(u_at, u_share, normal, r, step);
        if (det == 0.0) {
            break;
        }
        at += step[0];
        share += step[1];
        height += step[2];
        if (!(fabs(at) < 10.0) || !(fabs(share) < 100.0)) {
            break;
        }
        found = fmax(fabs(step[0]), fabs(step[1])) < 1e-8;
    }
    // det < 0: the side where the normals spread (outside a convex edge, inside a concave one)
    if (found && det < 0.0 && at >= -TOLERANCE && at <= 1.0 + TOLERANCE && share >= -TOLERANCE &&
        share <= 1.0 + TOLERANCE) {
        double b[3] = {0.0, 0.0, 0.0};
        b[next] = fmin(fmax(at, 0.0), 1.0);
        b[e] = 1.0 - b[next];
        offer_point(q, t, b, height);
    }
    offer_corner(q, t, e, na, ma, -1.0);
    offer_corner(q, t, next, nc, mc, 1.0);
}

static void offer_triangle(search *q, int32_t t) {
    offer_patch(q, t);
    for (int e = 0; e < 3 && q->surface->sharp[t] != 0; e++) {
        if ((q->surface->sharp[t] >> e) & 1 && t < q->surface->across[3 * t + e] / 3) {
            offer_edge(q, t, e);
        }
    }
}

// ---- Closest ------------------------------------------------------------------------------------

static double box_distance(const pal_rest_box *box, const double p[3]) {
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        double d = larger(larger(box->low[i] - p[i], p[i] - box->high[i]), 0.0);
        sum += d * d;
    }
    return sum;
}

/// Boxes to visit, nearest first (a binary heap; ties by index): a search that went down the nearer
/// half first would try all of it when the answer is just across the cut.
typedef struct heap {
    int32_t count;
    int32_t box[VISITS + 2];
    double far[VISITS + 2];
} heap;

static int above(const heap *h, int32_t i, int32_t j) {
    return h->far[i] < h->far[j] || (h->far[i] == h->far[j] && h->box[i] < h->box[j]);
}

static void heap_swap(heap *h, int32_t i, int32_t j) {
    double far = h->far[i];
    int32_t box = h->box[i];
    h->far[i] = h->far[j];
    h->box[i] = h->box[j];
    h->far[j] = far;
    h->box[j] = box;
}

static void heap_push(heap *h, int32_t box, double far) {
    int32_t i = h->count++;
    h->box[i] = box;
    h->far[i] = far;
    while (i > 0 && above(h, i, (i - 1) / 2)) {
        heap_swap(h, i, (i - 1) / 2);
        i = (i - 1) / 2;
    }
}

/// Remove the top, which the caller has read.
static void heap_pop(heap *h) {
    heap_swap(h, 0, --h->count);
    for (int32_t i = 0, child = 1; child < h->count; child = 2 * i + 1) {
        child += child + 1 < h->count && above(h, child + 1, child);
        if (!above(h, child, i)) {
            break;
        }
        heap_swap(h, i, child);
        i = child;
    }
}

int pal_rest_closest(const pal_rest_surface *surface, const double p[3], double reach, int32_t hint,
                     pal_surface_point *out) {
    search q = {.surface = surface, .p = {p[0], p[1], p[2]}, .least = reach * reach, .out = out};
    heap h;
    *out = (pal_surface_point){.triangle = -1};
    if (surface->triangle_count == 0 || !isfinite(p[0] + p[1] + p[2]) || !(reach > 0.0)) {
        return 0;
    }
    if (hint >= 0 && hint < surface->triangle_count) { // a good bound first
        pal_surface_point near = {.triangle = hint, .weight = {1.0 / 3, 1.0 / 3, 1.0 / 3}};
        if (pal_rest_track(surface, p, reach, &near, &near)) {
            offer_triangle(&q, near.triangle);
        }
    }
    h.count = 0;
    heap_push(&h, 0, box_distance(&surface->box[0], p));
    for (int32_t visit = 0, tests = 0; visit < VISITS && tests < PALPATE_REST_TESTS; visit++) {
        if (h.count == 0 || h.far[0] > q.least) {
            break; // all that is left is farther
        }
        int32_t self = h.box[0];
        const pal_rest_box *box = &surface->box[self];
        heap_pop(&h);
        if (box->count > 0) {
            for (int32_t k = box->first; k < box->first + box->count; k++) {
                offer_triangle(&q, surface->order[k]);
            }
            tests += box->count;
            continue;
        }
        int32_t child[2] = {self + 1, box->first};
        for (int k = 0; k < 2; k++) {
            double far = box_distance(&surface->box[child[k]], p);
            if (far <= q.least) {
                heap_push(&h, child[k], far);
            }
        }
    }
    return out->triangle >= 0;
}

// ---- Track --------------------------------------------------------------------------------------

int pal_rest_track(const pal_rest_surface *surface, const double p[3], double reach,
                   const pal_surface_point *from, pal_surface_point *out) {
    search q = {.surface = surface, .p = {p[0], p[1], p[2]}, .least = reach * reach};
    pal_surface_point point = {.triangle = -1};
    int32_t t = from->triangle, last = -1;
    double b[3] = {from->weight[0], from->weight[1], from->weight[2]}, s = from->distance;
    q.out = &point;
    for (int n = 0; n < PALPATE_REST_STEPS && t >= 0 && t < surface->triangle_count; n++) {
        patch k = patch_of(surface, t);
        int result = solve_patch(&k, p, b, &s, 1);
        if (result != 0) {
            if (result == 1) {
                clip(b);
                pal_rest_point(surface, t, b, &point);
                double d[3] = {p[0] - point.position[0], p[1] - point.position[1],
                               p[2] - point.position[2]};
                point.distance = v3_dot(d, point.normal);
                if (!(v3_dot(d, d) <= reach * reach)) {
                    point.triangle = -1;
                }
            }
            break;
        }
        if (!isfinite(b[0] + b[1] + b[2] + s)) {
            break;
        }
        int worst = b[1] < b[0] ? 1 : 0;
        worst = b[2] < b[worst] ? 2 : worst;
        int e = (worst + 1) % 3; // the edge opposite to that corner
        int32_t other = surface->across[3 * t + e];
        if (b[worst] >= 0.0 || other < 0) {
            break; // no convergence, or over the rim
        }
        if ((surface->sharp[t] >> e) & 1) {
            int32_t u = other / 3;
            offer_edge(&q, t < u ? t : u, t < u ? e : other - 3 * u);
            if (point.triangle >= 0) {
                break;
            }
        }
        if (other / 3 == last) {
            break; // both sides of an edge disown it
        }
        last = t;
        t = other / 3;
        b[0] = b[1] = b[2] = 1.0 / 3;
    }
    *out = point;
    return point.triangle >= 0;
}

// ---- Line ---------------------------------------------------------------------------------------

typedef struct line {
    const pal_rest_surface *surface;
    const pal_rest_aim *aim;
    const double *origin;
    double least; ///< |t| of the best hit
    double min_cosine;
    pal_surface_point *out;
} line;

/// Part of the line inside the box, cut to |t| <= least. @return least |t| there; -1: none
static double box_entry(const line *q, const pal_rest_box *box) {
    double from = -q->least, to = q->least;
    for (int i = 0; i < 3; i++) {
        double low = box->low[i] - q->origin[i], high = box->high[i] - q->origin[i];
        if (q->aim->over[i] == HUGE_VAL) {
            if (low > 0.0 || high < 0.0) {
                return -1.0;
            }
            continue;
        }
        double a = low * q->aim->over[i], b = high * q->aim->over[i];
        from = fmax(from, fmin(a, b));
        to = fmin(to, fmax(a, b));
    }
    if (!(from <= to)) {
        return -1.0;
    }
    return from > 0.0 ? from : to < 0.0 ? -to : 0.0;
}

static void across(const double d[3], double u[3], double v[3]) {
    int i = fabs(d[1]) < fabs(d[0]) ? 1 : 0;
    i = fabs(d[2]) < fabs(d[i]) ? 2 : i;
    double e[3] = {0.0, 0.0, 0.0};
    e[i] = 1.0;
    for (int c = 0; c < 3; c++) {
        u[c] = e[c] - d[i] * d[c];
    }
    double length = sqrt(v3_dot(u, u));
    for (int c = 0; c < 3; c++) {
        u[c] /= length;
    }
    v[0] = d[1] * u[2] - d[2] * u[1];
    v[1] = d[2] * u[0] - d[0] * u[2];
    v[2] = d[0] * u[1] - d[1] * u[0];
}

/// A patch as the line sees it: corners and bends across the direction, from the origin.
typedef struct flat {
    double p[3][2], c[3][2];
} flat;

static inline flat flat_of(const line *q, const patch *k) {
    const double *e = q->aim->across[0], *f = q->aim->across[1];
    flat out;
    for (int c = 0; c < 3; c++) {
        double d[3] = {k->p[c][0] - q->origin[0], k->p[c][1] - q->origin[1],
                       k->p[c][2] - q->origin[2]};
        out.p[c][0] = v3_dot(d, e);
        out.p[c][1] = v3_dot(d, f);
        out.c[c][0] = v3_dot(k->c + 3 * c, e);
        out.c[c][1] = v3_dot(k->c + 3 * c, f);
    }
    return out;
}

/// Newton from b: where the line meets the patch continued beyond its edges. Quadratic: after a
/// step below LAST what is left is below rounding. @return 1: inside; 0: outside (b tells where
/// to), or no convergence
static int solve_line(const line *q, const patch *k, double b[3]) {
    const flat g = flat_of(q, k);
    for (int n = 0; n < NEWTON; n++) {
        double x[2], u[2], v[2], b01 = b[0] * b[1], b12 = b[1] * b[2], b20 = b[2] * b[0];
        for (int i = 0; i < 2; i++) {
            double c01 = g.c[0][i], c12 = g.c[1][i], c20 = g.c[2][i];
            x[i] = b[0] * g.p[0][i] + b[1] * g.p[1][i] + b[2] * g.p[2][i] + b01 * c01 + b12 * c12 +
                   b20 * c20;
            u[i] = g.p[1][i] - g.p[0][i] + (b[0] - b[1]) * c01 + b[2] * (c12 - c20);
            v[i] = g.p[2][i] - g.p[0][i] + (b[0] - b[2]) * c20 + b[1] * (c12 - c01);
        }
        double det = u[0] * v[1] - v[0] * u[1];
        if (!(fabs(det) > 0.0)) {
            return 0;
        }
        double s1 = (v[0] * x[1] - x[0] * v[1]) / det, s2 = (x[0] * u[1] - u[0] * x[1]) / det;
        b[1] += s1;
        b[2] += s2;
        b[0] = 1.0 - b[1] - b[2];
        double moved = larger(fabs(s1), fabs(s2)), low = lowest(b);
        if (moved < LAST) {
            return low >= -TOLERANCE;
        }
        if (n > 0 && !(low > -2.0 && moved > -0.5 * (low + 0.2))) {
            return 0;
        }
    }
    return 0;
}

/// The hit at b of triangle t, if it faces the direction within reach. @return 1 or 0
static int take_hit(line *q, int32_t t, double b[3]) {
    pal_surface_point point;
    clip(b);
    pal_rest_point(q->surface, t, b, &point);
    double d[3] = {point.position[0] - q->origin[0], point.position[1] - q->origin[1],
                   point.position[2] - q->origin[2]};
    point.distance = v3_dot(d, q->aim->direction);
    double far = fabs(point.distance);
    if (v3_dot(point.normal, q->aim->direction) > q->min_cosine &&
        (far < q->least || (far == q->least && (q->out->triangle < 0 || t < q->out->triangle)))) {
        q->least = far;
        *q->out = point;
        return 1;
    }
    return 0;
}

static void hit_triangle(line *q, int32_t t) {
    patch k = patch_of(q->surface, t);
    double b[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3};
    if (solve_line(q, &k, b)) {
        (void)take_hit(q, t, b);
    }
}

/// From b of triangle t across the edges towards the line. @return 1: a hit was found that way
static int walk_to_line(line *q, int32_t t, const double from[3]) {
    int32_t last = -1;
    double b[3] = {from[0], from[1], from[2]};
    for (int n = 0; n < PALPATE_REST_STEPS; n++) {
        patch k = patch_of(q->surface, t);
        if (solve_line(q, &k, b)) {
            return take_hit(q, t, b);
        }
        int worst = b[1] < b[0] ? 1 : 0;
        worst = b[2] < b[worst] ? 2 : worst;
        int32_t other = q->surface->across[3 * t + (worst + 1) % 3];
        if (!(b[worst] < 0.0) || other < 0 || other / 3 == last) {
            return 0; // no convergence, over the rim, or turned away from the line
        }
        last = t;
        t = other / 3;
        b[0] = b[1] = b[2] = 1.0 / 3;
    }
    return 0;
}

int pal_rest_aim_at(const double direction[3], pal_rest_aim *out) {
    memcpy(out->direction, direction, sizeof out->direction);
    if (!(fabs(v3_dot(direction, direction) - 1.0) < 1e-6)) {
        return 0;
    }
    across(direction, out->across[0], out->across[1]);
    for (int i = 0; i < 3; i++) {
        out->over[i] = fabs(direction[i]) < 1e-12 ? HUGE_VAL : 1.0 / direction[i];
    }
    return 1;
}

int pal_rest_follow(const pal_rest_surface *surface, const pal_rest_aim *aim,
                    const double origin[3], double reach, double min_cosine,
                    const pal_surface_point *from, pal_surface_point *out) {
    line q = {.surface = surface,
              .aim = aim,
              .origin = origin,
              .least = reach,
              .min_cosine = min_cosine,
              .out = out};
    int32_t t = from->triangle;
    double b[3] = {from->weight[0], from->weight[1], from->weight[2]};
    *out = (pal_surface_point){.triangle = -1};
    return t >= 0 && t < surface->triangle_count && walk_to_line(&q, t, b);
}

int pal_rest_project(const pal_rest_surface *surface, const double origin[3],
                     const double direction[3], double reach, double min_cosine, int32_t hint,
                     pal_surface_point *out) {
    pal_rest_aim aim;
    line q = {.surface = surface,
              .aim = &aim,
              .origin = origin,
              .least = reach,
              .min_cosine = min_cosine,
              .out = out};
    int32_t stack[STACK], depth = 1, tests = 0;
    const double third[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3};
    *out = (pal_surface_point){.triangle = -1};
    if (surface->triangle_count == 0 || !isfinite(origin[0] + origin[1] + origin[2]) ||
        !pal_rest_aim_at(direction, &aim) || !(reach > 0.0)) {
        return 0;
    }
    if (hint >= 0 && hint < surface->triangle_count && walk_to_line(&q, hint, third)) {
        return 1;
    }
    stack[0] = 0;
    while (depth > 0 && tests < PALPATE_REST_TESTS) {
        int32_t self = stack[--depth];
        const pal_rest_box *box = &surface->box[self];
        if (box_entry(&q, box) < 0.0) {
            continue; // again: the best hit may be nearer by now
        }
        if (box->count > 0) {
            for (int32_t k = box->first; k < box->first + box->count; k++) {
                hit_triangle(&q, surface->order[k]);
            }
            tests += box->count;
            continue;
        }
        int32_t child[2] = {self + 1, box->first};
        double r[2] = {box_entry(&q, &surface->box[child[0]]),
                       box_entry(&q, &surface->box[child[1]])};
        int near = r[1] < r[0];
        for (int k = 0; k < 2; k++) {
            int c = k == 0 ? !near : near;
            if (r[c] >= 0.0 && depth < STACK) {
                stack[depth++] = child[c];
            }
        }
    }
    return out->triangle >= 0;
}
