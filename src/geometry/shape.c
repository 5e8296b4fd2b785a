/// @file shape.c  Projection onto constraint surfaces, and the spacing field.
///
/// Projection: x <- x + s with s the least-norm solution of grad f_i . s = -f_i, solved by
/// orthogonalising the gradients one after the other (Gram-Schmidt); a gradient that adds no new
/// direction is skipped. The input triangulation enters as the plane of the closest triangle, found
/// again in every step.
#include "src/geometry/shape.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/vec.h"

int pal_shape_add(pal_shape *shape, const pal_constraint *constraint) {
    for (int32_t i = 0; i < shape->count; i++) {
        const pal_constraint *c = shape->constraint + i;
        if (c->kind == constraint->kind && c->value == constraint->value &&
            c->vector[0] == constraint->vector[0] && c->vector[1] == constraint->vector[1] &&
            c->vector[2] == constraint->vector[2]) {
            return i;
        }
    }
    if (shape->count == INT16_MAX) {
        return PALPATE_ERROR_UNSUPPORTED;
    }
    if (shape->count == shape->capacity) {
        int32_t capacity = shape->capacity ? 2 * shape->capacity : 16;
        pal_constraint *grown = realloc(shape->constraint, (size_t)capacity * sizeof *grown);
        if (grown == NULL) {
            return PALPATE_ERROR_MEMORY;
        }
        shape->constraint = grown;
        shape->capacity = capacity;
    }
    shape->constraint[shape->count] = *constraint;
    return shape->count++;
}

void pal_shape_clear(pal_shape *shape) {
    free(shape->constraint);
    free(shape->segment);
    memset(shape, 0, sizeof *shape);
}

pal_constraint_set pal_set_none(void) {
    return (pal_constraint_set){{-1, -1, -1, -1}};
}

pal_constraint_set pal_set_one(int id) {
    return (pal_constraint_set){{(int16_t)id, -1, -1, -1}};
}

pal_constraint_set pal_set_union(pal_constraint_set a, pal_constraint_set b) {
    pal_constraint_set out = pal_set_none();
    for (int i = 0, j = 0, n = 0; n < 4; n++) {
        int16_t p = i < 4 ? a.id[i] : -1, q = j < 4 ? b.id[j] : -1;
        if (p < 0 && q < 0) {
            break;
        }
        int16_t least = p < 0 ? q : (q < 0 ? p : (p < q ? p : q));
        out.id[n] = least;
        i += p == least;
        j += q == least;
    }
    return out;
}

pal_constraint_set pal_set_common(pal_constraint_set a, pal_constraint_set b) {
    pal_constraint_set out = pal_set_none();
    for (int i = 0, n = 0; i < 4 && a.id[i] >= 0; i++) {
        if (pal_set_has(b, a.id[i])) {
            out.id[n++] = a.id[i];
        }
    }
    return out;
}

int pal_set_equal(pal_constraint_set a, pal_constraint_set b) {
    return memcmp(a.id, b.id, sizeof a.id) == 0;
}

int pal_set_has(pal_constraint_set a, int id) {
    return a.id[0] == id || a.id[1] == id || a.id[2] == id || a.id[3] == id;
}

double pal_constraint_value(const pal_constraint *c, const double x[3], double gradient[3]) {
    if (c->kind == PALPATE_CONSTRAINT_PLANE) {
        if (gradient != NULL) {
            v3_copy(c->vector, gradient);
        }
        return v3_dot(c->vector, x) - c->value;
    }
    double d[3];
    v3_sub(x, c->vector, d);
    double r = v3_norm(d);
    if (gradient != NULL) {
        for (int k = 0; k < 3; k++) {
            gradient[k] = r > 0.0 ? d[k] / r : (k == 2 ? 1.0 : 0.0);
        }
    }
    return r - c->value;
}

/// One more equation gradient . s = -f for the step s, given the orthonormal directions used so
/// far.
/// @return 0 when it adds no new direction (it is then left out)
static int add_equation(const double gradient[3], double f, double q[3][3], int *used,
                        double s[3]) {
    double n[3];
    v3_copy(gradient, n);
    for (int k = 0; k < *used; k++) {
        v3_add(n, -v3_dot(gradient, q[k]), q[k], n);
    }
    double norm = v3_norm(n);
    if (*used == 3 || norm < 1e-4) {
        return 0;
    }
    for (int c = 0; c < 3; c++) {
        q[*used][c] = n[c] / norm;
    }
    v3_add(s, (-f - v3_dot(gradient, s)) / v3_dot(gradient, q[*used]), q[*used], s);
    (*used)++;
    return 1;
}

/// Put x on the closest sharp edge and use up the two directions across it.
static void snap_to_edges(const pal_shape *shape, double x[3], double q[3][3], int *used) {
    double best = HUGE_VAL, point[3] = {x[0], x[1], x[2]}, along[3] = {1.0, 0.0, 0.0};
    for (int32_t i = 0; i < shape->segment_count; i++) {
        const double *a = shape->segment + 6 * (size_t)i, *b = a + 3;
        double t = v3_segment_parameter(x, a, b), u[3], p[3];
        v3_sub(b, a, u);
        v3_add(a, t, u, p);
        double d = v3_distance(x, p);
        if (d < best) {
            best = d;
            v3_copy(p, point);
            double length = v3_norm(u);
            for (int c = 0; c < 3; c++) {
                along[c] = length > 0.0 ? u[c] / length : 0.0;
            }
        }
    }
    v3_copy(point, x);
    int axis = fabs(along[0]) < 0.6 ? 0 : 1;
    double e[3] = {axis == 0, axis == 1, 0.0};
    v3_cross(along, e, q[0]);
    double norm = v3_norm(q[0]);
    for (int c = 0; c < 3; c++) {
        q[0][c] /= norm;
    }
    v3_cross(along, q[0], q[1]);
    *used = 2;
}

static void snap_to_mesh(const pal_shape *shape, const double *side, double x[3], double q[3][3],
                         int *used) {
    double point[3];
    int32_t t = side != NULL ? pal_bvh_closest_side(shape->mesh, x, side, point, NULL) : -1;
    t = t < 0 ? pal_bvh_closest(shape->mesh, x, point, NULL) : t;
    if (t < 0) {
        return;
    }
    v3_copy(point, x);
    const int32_t *v = shape->mesh->v + 3 * (size_t)t;
    v3_normal(shape->mesh->x + 3 * (size_t)v[0], shape->mesh->x + 3 * (size_t)v[1],
              shape->mesh->x + 3 * (size_t)v[2], q[0]);
    double norm = v3_norm(q[0]);
    if (norm > 0.0) {
        for (int c = 0; c < 3; c++) {
            q[0][c] /= norm;
        }
        *used = 1;
    }
}

int pal_shape_project(const pal_shape *shape, pal_constraint_set set, const double *side,
                      double x[3]) {
    int kind_mesh = 0, kind_edges = 0;
    for (int i = 0; i < 4 && set.id[i] >= 0; i++) {
        kind_mesh |= shape->constraint[set.id[i]].kind == PALPATE_CONSTRAINT_MESH;
        kind_edges |= shape->constraint[set.id[i]].kind == PALPATE_CONSTRAINT_EDGES;
    }
    double last = 0.0;
    for (int pass = 0; pass < 40; pass++) {
        double q[3][3] = {{0}}, s[3] = {0}, worst = 0.0;
        int used = 0;
        if (kind_edges) {
            snap_to_edges(shape, x, q, &used);
        } else if (kind_mesh) {
            snap_to_mesh(shape, side, x, q, &used);
        }
        for (int i = 0; i < 4 && set.id[i] >= 0; i++) {
            const pal_constraint *c = shape->constraint + set.id[i];
            if (c->kind == PALPATE_CONSTRAINT_PLANE || c->kind == PALPATE_CONSTRAINT_SPHERE) {
                double gradient[3], f = pal_constraint_value(c, x, gradient);
                if (add_equation(gradient, f, q, &used, s)) {
                    worst = fmax(worst, fabs(f));
                }
            }
        }
        v3_add(x, 1.0, s, x);
        if (worst < 1e-12) {
            return 1;
        }
        last = worst;
    }
    return last < 1e-11;
}

pal_status pal_size_add(pal_size_field *field, const pal_size_source *source) {
    if (field->count == field->capacity) {
        int32_t capacity = field->capacity ? 2 * field->capacity : 64;
        pal_size_source *grown = realloc(field->source, (size_t)capacity * sizeof *grown);
        if (grown == NULL) {
            return PALPATE_ERROR_MEMORY;
        }
        field->source = grown;
        field->capacity = capacity;
    }
    field->source[field->count++] = *source;
    return PALPATE_OK;
}

void pal_size_clear(pal_size_field *field) {
    free(field->source);
    memset(field, 0, sizeof *field);
}

double pal_size_at(const pal_size_field *field, const double x[3]) {
    double h = field->cap;
    for (int32_t i = 0; i < field->count; i++) {
        const pal_size_source *s = field->source + i;
        double u[3], p[3];
        v3_sub(s->b, s->a, u);
        v3_add(s->a, v3_segment_parameter(x, s->a, s->b), u, p);
        h = fmin(h, s->spacing + field->grading * fmax(0.0, v3_distance(x, p) - s->radius));
    }
    return h;
}
