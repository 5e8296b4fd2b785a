/// @file remesh.c  Isotropic remeshing with features and a graded size field.
///
/// Botsch, Kobbelt: A remeshing approach to multiresolution modeling (SGP 2004): split edges longer
/// than 4/3, collapse edges shorter than 4/5 of the spacing wanted, flip towards larger smallest
/// angles, relax tangentially. Here the lengths are measured relative to a graded spacing, the
/// relaxation moves to the centroid of the triangles around, each weighted by area / h^2 (its area
/// in the metric of the spacing; measured at a rim graded by 0.45: mean triangle quality 0.945,
/// against 0.91 with h^-1 or h^-3 and 0.88 with the h^-4 of centroidal tessellations), and every
/// vertex is put back on its constraints (shape.h) after every move, so that curve vertices slide
/// along their curve and corners stay. Everything runs in index order with total orders for ties:
/// deterministic.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/geometry/surface_mesh.h"
#include "haptic/base/vec.h"

static const double LONG = 4.0 / 3.0, SHORT = 4.0 / 5.0;

typedef struct candidate {
    double length;
    int32_t e;
} candidate;

static int longest_first(const void *pa, const void *pb) {
    const candidate *a = pa, *b = pb;
    if (a->length != b->length) {
        return a->length > b->length ? -1 : 1;
    }
    return (a->e > b->e) - (a->e < b->e);
}

static int shortest_first(const void *pa, const void *pb) {
    const candidate *a = pa, *b = pb;
    if (a->length != b->length) {
        return a->length < b->length ? -1 : 1;
    }
    return (a->e > b->e) - (a->e < b->e);
}

static const double *at(const pal_surface_mesh *m, int32_t vertex) {
    return m->x + 3 * (size_t)vertex;
}

/// Length of an edge over the spacing wanted along it.
static double relative_length(const pal_surface_mesh *m, int32_t a, int32_t b) {
    return v3_distance(at(m, a), at(m, b)) * 0.5 * (1.0 / m->h[a] + 1.0 / m->h[b]);
}

static void fill_size(pal_surface_mesh *m, const pal_size_field *size) {
    for (int32_t i = 0; i < m->vertex_count; i++) {
        if (m->out[i] >= 0) {
            m->h[i] = pal_size_at(size, at(m, i));
        }
    }
}

/// Living edges (one half each) beyond a limit, sorted.
static pal_status gather(const pal_surface_mesh *m, double limit, int want_long, candidate **out,
                         size_t *count, pal_error *error) {
    *count = 0;
    *out = malloc((3 * (size_t)m->triangle_count / 2 + 1) * sizeof **out);
    if (*out == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory to sort its edges");
    }
    for (int32_t e = 0; e < 3 * m->triangle_count; e++) {
        if (m->v[e] >= 0 && e < m->twin[e]) {
            double length = relative_length(m, m->v[e], pal_smesh_head(m, e));
            if (want_long ? length > limit : length < limit) {
                (*out)[(*count)++] = (candidate){length, e};
            }
        }
    }
    qsort(*out, *count, sizeof **out, want_long ? longest_first : shortest_first);
    return PALPATE_OK;
}

/// One sweep of splits. @return the number split through `done`
static pal_status split_long(pal_surface_mesh *m, const pal_shape *shape,
                             const pal_size_field *size, int project, int32_t *done,
                             pal_error *error) {
    candidate *list;
    size_t count;
    pal_status status = gather(m, LONG, 1, &list, &count, error);
    *done = 0;
    for (size_t i = 0; i < count && status == PALPATE_OK; i++) {
        int32_t e = list[i].e, a = m->v[e], b = pal_smesh_head(m, e);
        if (relative_length(m, a, b) <= LONG) {
            continue; // shortened by an earlier split
        }
        double x[3];
        for (int c = 0; c < 3; c++) {
            x[c] = 0.5 * (at(m, a)[c] + at(m, b)[c]);
        }
        int32_t n = pal_smesh_split(m, e, x);
        if (n < 0) {
            status = pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory for %d vertices",
                              m->vertex_count + 1);
            break;
        }
        if (project) {
            double side[3];
            pal_smesh_vertex_normal(m, n, side);
            (void)pal_shape_project(shape, m->set[n], side, m->x + 3 * (size_t)n);
        }
        m->h[n] = pal_size_at(size, at(m, n));
        (*done)++;
    }
    free(list);
    return status;
}

/// Would every triangle around `vertex` but those with `skip` keep its side if it moved to x?
static int move_is_safe(const pal_surface_mesh *m, int32_t vertex, const double x[3], int32_t skip,
                        double least_cosine) {
    int32_t e = m->out[vertex];
    do {
        int32_t t = e / 3;
        if (m->v[3 * t] != skip && m->v[3 * t + 1] != skip && m->v[3 * t + 2] != skip) {
            double before[3], after[3];
            double area = pal_smesh_normal(m, t, -1, NULL, before);
            double moved = pal_smesh_normal(m, t, vertex, x, after);
            if (!(moved > 1e-3 * area) || v3_dot(before, after) < least_cosine) {
                return 0;
            }
        }
        e = pal_smesh_around(m, e);
    } while (e != m->out[vertex]);
    return 1;
}

/// May the tail a of e be merged into its head b, making no edge longer than `longest`?
static int collapse_allowed(const pal_surface_mesh *m, int32_t e, double longest) {
    int32_t a = m->v[e], b = pal_smesh_head(m, e), along[2];
    int kind = pal_smesh_kind(m, a, along);
    if (kind == PALPATE_VERTEX_CORNER) {
        return 0;
    }
    if (kind == PALPATE_VERTEX_CURVE) {
        if (!m->feature[e]) {
            return 0;
        }
        // the triangle beside must not fold two features onto each other
        int32_t o = m->twin[e];
        if (m->feature[pal_smesh_prev(e)] || m->feature[pal_smesh_next(o)]) {
            return 0;
        }
    }
    int32_t f = m->out[a];
    do {
        if (relative_length(m, b, pal_smesh_head(m, f)) > longest) {
            return 0;
        }
        f = pal_smesh_around(m, f);
    } while (f != m->out[a]);
    return move_is_safe(m, a, at(m, b), b, 0.5);
}

static pal_status collapse_short(pal_surface_mesh *m, int32_t *done, pal_error *error) {
    candidate *list;
    size_t count;
    pal_status status = gather(m, SHORT, 0, &list, &count, error);
    *done = 0;
    for (size_t i = 0; i < count && status == PALPATE_OK; i++) {
        int32_t e = list[i].e;
        if (m->v[e] < 0 || relative_length(m, m->v[e], pal_smesh_head(m, e)) >= SHORT) {
            continue;
        }
        // merge the less bound end into the other
        if (collapse_allowed(m, e, LONG)) {
            *done += pal_smesh_collapse(m, e);
        } else if (collapse_allowed(m, m->twin[e], LONG)) {
            *done += pal_smesh_collapse(m, m->twin[e]);
        }
    }
    free(list);
    return status == PALPATE_OK ? pal_smesh_compact(m, error) : status;
}

/// The chain of feature half-edges through e, from corner to corner or once around a loop.
/// @return its length, 0 when out of memory; *list grows
static int32_t walk_curve(const pal_surface_mesh *m, int32_t e, int32_t **list, int32_t *capacity) {
    int32_t along[2], first = e, count = 0;
    for (;;) { // back to the start of the chain
        if (pal_smesh_kind(m, m->v[first], along) != PALPATE_VERTEX_CURVE) {
            break;
        }
        int32_t back = m->twin[along[0] == first ? along[1] : along[0]];
        if (back == e) {
            break;
        }
        first = back;
    }
    for (int32_t f = first;;) {
        if (count == *capacity) {
            int32_t *grown = realloc(*list, (2 * (size_t)count + 64) * sizeof *grown);
            if (grown == NULL) {
                return 0;
            }
            *list = grown;
            *capacity = 2 * count + 64;
        }
        (*list)[count++] = f;
        if (pal_smesh_kind(m, pal_smesh_head(m, f), along) != PALPATE_VERTEX_CURVE) {
            break;
        }
        f = along[0] == m->twin[f] ? along[1] : along[0];
        if (f == first) {
            break;
        }
    }
    return count;
}

/// Give one chain as many edges as its length asks for: split the longest or merge the shortest.
static pal_status balance_chain(pal_surface_mesh *m, const pal_shape *shape,
                                const pal_size_field *size, const int32_t *list, int32_t count,
                                pal_error *error) {
    double total = 0.0;
    candidate extreme = {0.0, -1};
    for (int32_t i = 0; i < count; i++) {
        total += relative_length(m, m->v[list[i]], pal_smesh_head(m, list[i]));
    }
    int more = total > count + 0.5, fewer = total < count - 0.5;
    for (int32_t i = 0; i < count && (more || fewer); i++) {
        double length = relative_length(m, m->v[list[i]], pal_smesh_head(m, list[i]));
        int ok =
            more || collapse_allowed(m, list[i], 2.0) || collapse_allowed(m, m->twin[list[i]], 2.0);
        if (ok && (extreme.e < 0 || (more ? length > extreme.length : length < extreme.length))) {
            extreme = (candidate){length, list[i]};
        }
    }
    int32_t e = extreme.e;
    if (e >= 0 && more) {
        double x[3];
        for (int c = 0; c < 3; c++) {
            x[c] = 0.5 * (at(m, m->v[e])[c] + at(m, pal_smesh_head(m, e))[c]);
        }
        int32_t n = pal_smesh_split(m, e, x);
        if (n < 0) {
            return pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory for %d vertices",
                            m->vertex_count + 1);
        }
        double side[3];
        pal_smesh_vertex_normal(m, n, side);
        (void)pal_shape_project(shape, m->set[n], side, m->x + 3 * (size_t)n);
        m->h[n] = pal_size_at(size, at(m, n));
    } else if (e >= 0 && !(collapse_allowed(m, e, 2.0) && pal_smesh_collapse(m, e)) &&
               collapse_allowed(m, m->twin[e], 2.0)) {
        (void)pal_smesh_collapse(m, m->twin[e]);
    }
    return PALPATE_OK;
}

/// One step of balance_chain for every chain (each is found through its smallest half-edge).
static pal_status balance_curves(pal_surface_mesh *m, const pal_shape *shape,
                                 const pal_size_field *size, pal_error *error) {
    int32_t *list = NULL, capacity = 0, edges = 3 * m->triangle_count;
    pal_status status = PALPATE_OK;
    for (int32_t e = 0; e < edges && status == PALPATE_OK; e++) {
        if (m->v[e] < 0 || !m->feature[e]) {
            continue;
        }
        int32_t count = walk_curve(m, e, &list, &capacity), smallest = e;
        for (int32_t i = 0; i < count; i++) {
            int32_t o = m->twin[list[i]];
            smallest = list[i] < smallest ? list[i] : (o < smallest ? o : smallest);
        }
        if (count == 0) {
            status = pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory to walk its curves");
        } else if (smallest == e) {
            status = balance_chain(m, shape, size, list, count, error);
        }
    }
    free(list);
    return status == PALPATE_OK ? pal_smesh_compact(m, error) : status;
}

/// Cosine of the largest angle of triangle abc: the smaller, the worse (-1 is flat).
static double worst_cosine(const double a[3], const double b[3], const double c[3]) {
    double u[3], v[3], w[3];
    v3_sub(b, a, u);
    v3_sub(c, b, v);
    v3_sub(a, c, w);
    double lu = v3_norm(u), lv = v3_norm(v), lw = v3_norm(w);
    if (!(lu > 0.0 && lv > 0.0 && lw > 0.0)) {
        return -1.0;
    }
    return fmin(-v3_dot(u, w) / (lu * lw),
                fmin(-v3_dot(u, v) / (lu * lv), -v3_dot(v, w) / (lv * lw)));
}

/// Flip e when that shrinks the largest angle of its two triangles and keeps the surface's side.
static int flip_if_better(pal_surface_mesh *m, int32_t e) {
    int32_t o = m->twin[e];
    if (m->feature[e]) {
        return 0;
    }
    const double *a = at(m, m->v[e]), *b = at(m, m->v[o]);
    const double *c = at(m, m->v[pal_smesh_prev(e)]), *d = at(m, m->v[pal_smesh_prev(o)]);
    double now = fmin(worst_cosine(a, b, c), worst_cosine(b, a, d));
    double then = fmin(worst_cosine(a, d, c), worst_cosine(d, b, c));
    if (then <= now + 1e-9) {
        return 0;
    }
    double n1[3], n2[3], f1[3], f2[3];
    pal_smesh_normal(m, e / 3, -1, NULL, n1);
    pal_smesh_normal(m, o / 3, -1, NULL, n2);
    v3_normal(a, d, c, f1);
    v3_normal(d, b, c, f2);
    double l1 = v3_norm(f1), l2 = v3_norm(f2), mean[3];
    v3_add(n1, 1.0, n2, mean);
    double flat = v3_dot(n1, n2), turned = v3_dot(f1, f2) / fmax(l1 * l2, 1e-300);
    if (v3_dot(f1, mean) <= 0.0 || v3_dot(f2, mean) <= 0.0) {
        return 0;
    }
    // needles may be removed whatever the fold; otherwise the fold may sharpen only a little
    if (now > -0.985 && turned < fmin(flat, 0.95) - 0.05) {
        return 0;
    }
    return pal_smesh_flip(m, e);
}

static int32_t flip_all(pal_surface_mesh *m) {
    int32_t total = 0;
    for (int pass = 0; pass < 8; pass++) {
        int32_t done = 0;
        for (int32_t e = 0; e < 3 * m->triangle_count; e++) {
            if (m->v[e] >= 0 && e < m->twin[e]) {
                done += flip_if_better(m, e);
            }
        }
        total += done;
        if (done == 0) {
            break;
        }
    }
    return total;
}

/// Where a smooth vertex wants to be: density-weighted centroid of its triangles, in its tangent
/// plane.
static void smooth_target(const pal_surface_mesh *m, int32_t vertex, double x[3]) {
    double sum[3] = {0}, normal[3] = {0}, weight = 0.0;
    int32_t e = m->out[vertex];
    do {
        int32_t p = pal_smesh_head(m, e), q = m->v[pal_smesh_prev(e)];
        double n[3], h = (m->h[vertex] + m->h[p] + m->h[q]) / 3.0;
        v3_normal(at(m, vertex), at(m, p), at(m, q), n);
        double w = v3_norm(n) / (h * h);
        for (int c = 0; c < 3; c++) {
            sum[c] += w * (at(m, vertex)[c] + at(m, p)[c] + at(m, q)[c]) / 3.0;
        }
        v3_add(normal, 1.0, n, normal);
        weight += w;
        e = pal_smesh_around(m, e);
    } while (e != m->out[vertex]);
    double step[3], norm = v3_norm(normal);
    for (int c = 0; c < 3; c++) {
        step[c] = weight > 0.0 ? sum[c] / weight - at(m, vertex)[c] : 0.0;
        normal[c] = norm > 0.0 ? normal[c] / norm : 0.0;
    }
    v3_add(step, -v3_dot(step, normal), normal, step);
    v3_add(at(m, vertex), 1.0, step, x);
}

/// Where a curve vertex wants to be: where both its edges have the same relative length.
static void curve_target(const pal_surface_mesh *m, int32_t vertex, const int32_t along[2],
                         double x[3]) {
    int32_t p = pal_smesh_head(m, along[0]), q = pal_smesh_head(m, along[1]);
    double lp = relative_length(m, vertex, p), lq = relative_length(m, vertex, q);
    const double *to = lp > lq ? at(m, p) : at(m, q);
    double t = 0.5 * fabs(lp - lq) / fmax(lp, lq), d[3];
    v3_sub(to, at(m, vertex), d);
    v3_add(at(m, vertex), t, d, x);
}

static void relax(pal_surface_mesh *m, const pal_shape *shape, const pal_size_field *size) {
    for (int32_t i = 0; i < m->vertex_count; i++) {
        int32_t along[2];
        int kind = pal_smesh_kind(m, i, along);
        if (kind == PALPATE_VERTEX_CORNER) {
            continue;
        }
        double target[3], x[3], side[3];
        pal_smesh_vertex_normal(m, i, side);
        if (kind == PALPATE_VERTEX_CURVE) {
            curve_target(m, i, along, target);
        } else {
            smooth_target(m, i, target);
        }
        double step = kind == PALPATE_VERTEX_CURVE ? 1.0 : 0.8;
        for (int halving = 0; halving < 4; halving++, step *= 0.5) {
            for (int c = 0; c < 3; c++) {
                x[c] = at(m, i)[c] + step * (target[c] - at(m, i)[c]);
            }
            if (pal_shape_project(shape, m->set[i], side, x) && move_is_safe(m, i, x, -1, 0.7)) {
                v3_copy(x, m->x + 3 * (size_t)i);
                m->h[i] = pal_size_at(size, x);
                break;
            }
        }
    }
}

/// Split (or collapse) and flip until nothing changes, at most `passes` times.
static pal_status adapt(pal_surface_mesh *m, const pal_shape *shape, const pal_size_field *size,
                        int split, int passes, pal_error *error) {
    for (int pass = 0; pass < passes; pass++) {
        int32_t done = 0;
        pal_status status =
            split ? split_long(m, shape, size, 1, &done, error) : collapse_short(m, &done, error);
        if (status != PALPATE_OK) {
            return status;
        }
        flip_all(m);
        if (done == 0) {
            break;
        }
    }
    return PALPATE_OK;
}

static pal_status report(const pal_progress *progress, int step, int steps, pal_error *error) {
    if (progress != NULL && progress->call != NULL &&
        progress->call(progress->user, "cloud", 0.05 + 0.15 * step / steps, -1.0) != 0) {
        return pal_fail(error, PALPATE_ERROR_CANCELLED,
                        "cloud: cancelled while meshing the surface");
    }
    return PALPATE_OK;
}

pal_status pal_smesh_remesh(pal_surface_mesh *m, const pal_shape *shape, const pal_size_field *size,
                            int rounds, const pal_progress *progress, pal_error *error) {
    enum { FINISHING = 20 };
    int steps = 3 * rounds + FINISHING;
    fill_size(m, size);
    pal_status status = PALPATE_OK;
    for (int round = 0; round < rounds && status == PALPATE_OK; round++) {
        // the first round may have far to go
        status = adapt(m, shape, size, 1, round == 0 ? 12 : 1, error);
        if (status == PALPATE_OK) {
            status = adapt(m, shape, size, 0, round == 0 ? 12 : 2, error);
        }
        for (int pass = 0; pass < 3 && status == PALPATE_OK; pass++) {
            status = balance_curves(m, shape, size, error);
            if (status == PALPATE_OK) {
                relax(m, shape, size);
                flip_all(m);
                status = report(progress, 3 * round + pass, steps, error);
            }
        }
    }
    for (int pass = 0; pass < FINISHING && status == PALPATE_OK; pass++) {
        relax(m, shape, size);
        flip_all(m);
        status = report(progress, 3 * rounds + pass, steps, error);
    }
    return status;
}

pal_status pal_smesh_refine(pal_surface_mesh *m, const pal_shape *shape, const pal_size_field *size,
                            pal_error *error) {
    fill_size(m, size);
    for (int pass = 0; pass < 24; pass++) {
        int32_t done;
        pal_status status = split_long(m, shape, size, 0, &done, error);
        if (status != PALPATE_OK || done == 0) {
            return status;
        }
    }
    return PALPATE_OK;
}
