/// @file imprint.c  Cutting the surface along a constraint, so that a rim is a chain of edges.
///
/// Vertices close to the cut are moved onto it (along their own face or curve), then every edge
/// whose ends lie strictly on two sides is split where it crosses. Splitting one edge after the
/// other joins the new vertices by edges: the cut ends up a union of edges. Thread: one.
#include <math.h>
#include <stdlib.h>

#include "haptic/base/error.h"
#include "src/geometry/surface_mesh.h"
#include "haptic/base/vec.h"

/// Closer than this (normalised) to the cut counts as on it: the tolerance of selectors.
static const double ON = 1e-6;

static const double *at(const pal_surface_mesh *m, int32_t vertex) {
    return m->x + 3 * (size_t)vertex;
}

/// Could the vertex move to x without turning a triangle over?
static int safe(const pal_surface_mesh *m, int32_t vertex, const double x[3]) {
    int32_t e = m->out[vertex];
    do {
        double before[3], after[3];
        double area = pal_smesh_normal(m, e / 3, -1, NULL, before);
        double moved = pal_smesh_normal(m, e / 3, vertex, x, after);
        if (!(moved > 0.2 * area) || v3_dot(before, after) < 0.9) {
            return 0;
        }
        e = pal_smesh_around(m, e);
    } while (e != m->out[vertex]);
    return 1;
}

/// Move vertices next to the cut onto it.
static void snap(pal_surface_mesh *m, const pal_shape *shape, int id) {
    const pal_constraint *cut = shape->constraint + id;
    for (int32_t i = 0; i < m->vertex_count; i++) {
        double f = pal_constraint_value(cut, at(m, i), NULL), shortest = HUGE_VAL;
        int32_t e = m->out[i];
        if (e < 0) {
            continue;
        }
        do {
            shortest = fmin(shortest, v3_distance(at(m, i), at(m, pal_smesh_head(m, e))));
            e = pal_smesh_around(m, e);
        } while (e != m->out[i]);
        pal_constraint_set set = pal_set_union(m->set[i], pal_set_one(id));
        int on = fabs(f) <= ON, corner = pal_smesh_kind(m, i, NULL) == PALPATE_VERTEX_CORNER;
        double x[3], side[3];
        v3_copy(at(m, i), x);
        pal_smesh_vertex_normal(m, i, side);
        if (!corner && fabs(f) <= 0.15 * shortest && pal_shape_project(shape, set, side, x) &&
            fabs(pal_constraint_value(cut, x, NULL)) <= ON &&
            v3_distance(x, at(m, i)) < 0.25 * shortest && safe(m, i, x)) {
            v3_copy(x, m->x + 3 * (size_t)i);
            on = 1;
        }
        if (on) {
            m->set[i] = set;
        }
    }
}

/// Where the segment from a to b crosses the cut: bisection, to rounding.
static void crossing(const pal_constraint *cut, const double a[3], const double b[3], double x[3]) {
    double low = 0.0, high = 1.0, d[3];
    int sign = pal_constraint_value(cut, a, NULL) > 0.0;
    v3_sub(b, a, d);
    for (int i = 0; i < 60; i++) {
        double middle = 0.5 * (low + high);
        v3_add(a, middle, d, x);
        if ((pal_constraint_value(cut, x, NULL) > 0.0) == sign) {
            low = middle;
        } else {
            high = middle;
        }
    }
    v3_add(a, 0.5 * (low + high), d, x);
}

pal_status pal_smesh_cut(pal_surface_mesh *m, const pal_shape *shape, int id, pal_error *error) {
    const pal_constraint *cut = shape->constraint + id;
    snap(m, shape, id);
    // splitting moves edges to new, higher numbers; the edges it makes do not cross
    for (int32_t e = 0; e < 3 * m->triangle_count; e++) {
        if (m->v[e] < 0 || e > m->twin[e]) {
            continue;
        }
        int32_t a = m->v[e], b = pal_smesh_head(m, e);
        int has_a = pal_set_has(m->set[a], id), has_b = pal_set_has(m->set[b], id);
        double fa = has_a ? 0.0 : pal_constraint_value(cut, at(m, a), NULL);
        double fb = has_b ? 0.0 : pal_constraint_value(cut, at(m, b), NULL);
        if (!((fa > 0.0 && fb < 0.0) || (fa < 0.0 && fb > 0.0))) {
            continue;
        }
        double x[3], moved[3];
        crossing(cut, at(m, a), at(m, b), x);
        int32_t n = pal_smesh_split(m, e, x);
        if (n < 0) {
            return pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory to cut %d edges",
                            3 * m->triangle_count);
        }
        // an earlier cut's edge stays on that cut: where two cuts meet is a corner of the rim
        m->set[n] = pal_set_union(m->set[n], pal_set_common(m->set[a], m->set[b]));
        m->set[n] = pal_set_union(m->set[n], pal_set_one(id));
        v3_copy(x, moved);
        // onto the body's face again, still on the cut
        double side[3];
        pal_smesh_vertex_normal(m, n, side);
        if (pal_shape_project(shape, m->set[n], side, moved) &&
            fabs(pal_constraint_value(cut, moved, NULL)) <= ON &&
            v3_distance(moved, x) < 0.5 * v3_distance(at(m, a), at(m, b))) {
            v3_copy(moved, m->x + 3 * (size_t)n);
        }
    }
    return PALPATE_OK;
}
