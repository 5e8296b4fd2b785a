/// @file indent.c  A rigid, frictionless tool pressed into the body along its axis: statics.
///
/// At every place i of the surface that the tool may touch, with rest position x_i, displacement
/// u_i and a force z_i n_i on the body, contact is unilateral: it pushes (z_i >= 0), the surface
/// stays outside the tool (w_i >= 0), and one of the two is zero. With the compliance C of the
/// model,
///     w_i = n_i . u_i + c_i,    u_i = sum_j C_ij n_j z_j,
/// a linear complementarity problem (complementarity.h) with M_ij = n_i^T C_ij n_j and q = c. For a
/// node with itself and those within two edges, C is that of near_field.h: what the mesh knows of
/// the body, and the half-space's own 1/r in place of what a mesh makes of it. Nodal forces then
/// are a quadrature of the pressure; on Hertz's block (bench/hertz) the bias of plain nodal
/// contact, 1.3 to 2.1 % too soft at 1184 nodes, becomes 0.4 to 0.9 %, and the methods cell and
/// galerkin agree within 0.1 % from 2421 nodes on.
///  - PALPATE_INDENT_REST, linearised about the rest shape: n_i is the axis a; c_i = g_i - depth,
///  with
///    the gap g_i = a.(x_i - start) - extent(r_i), for the sphere R - sqrt(R^2 - r^2) on a flat
///    top. This is the law of the finite-element table for Hertz's problem.
///  - PALPATE_INDENT_FULL, on the deformed shape: n_i points from the tool's nearest centre p_i
///    (sphere centre, or the point of the capsule's segment) to x_i + u_i, and
///    c_i = n_i.(x_i - p_i) - R. n depends on u: solved as a sequence of such problems (Newton on
///    the complementarity, n_i taken from the iterate before) until u moves less than 1e-10 R.
/// The system holds the places whose gap the tool closes; after each solve all others are checked
/// and violated ones added, so the answer is that of the whole surface.
/// Thread: any; the model is only read. Cost: O(k^3) for k touched places, O(k^2) memory.
#include "haptic/contact/indent.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/solver/complementarity.h"
#include "haptic/base/error.h"
#include "haptic/contact/near_field.h"

enum { ROUNDS = 20, FULL_ITERATIONS = 100 };

typedef struct press_system {
    const pal_model *model;
    const pal_tool_def *tool;
    pal_near_field near;
    void *near_memory; ///< of near
    pal_indent_law law;
    double axis[3];
    indent_point *point; ///< shape [points]
    int32_t points;
    indent_point **chosen; ///< places in the system, shape [count]
    int32_t count;
    double *m, *q, *z, *w;
    uint8_t *active;
    void *work;
    int built; ///< m is that of the directions now in force
    int32_t iterations, cut_off;
} press_system;

static double dot3(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void release(press_system *s) {
    free(s->chosen);
    free(s->m);
    free(s->q);
    free(s->active);
    free(s->work);
    s->chosen = NULL;
    s->m = s->q = s->z = s->w = NULL;
    s->active = NULL;
    s->work = NULL;
    s->built = 0;
}

/// The system's arrays for the places marked in `point[].chosen` (any value >= 0).
static pal_status assemble(press_system *s, pal_error *error) {
    release(s);
    s->count = 0;
    for (int32_t i = 0; i < s->points; i++) {
        s->count += s->point[i].chosen >= 0;
    }
    size_t n = s->count > 0 ? (size_t)s->count : 1;
    s->chosen = calloc(n, sizeof *s->chosen);
    s->m = calloc(n, n * sizeof *s->m);
    s->q = calloc(n, 3 * sizeof *s->q);
    s->active = calloc(n, 1);
    s->work = malloc(pal_lcp_bytes((int32_t)n));
    if (s->chosen == NULL || s->m == NULL || s->q == NULL || s->active == NULL || s->work == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "tool '%s': no memory for %zu contact points",
                        s->tool->name, n);
    }
    s->z = s->q + n;
    s->w = s->z + n;
    for (int32_t i = 0, k = 0; i < s->points; i++) {
        if (s->point[i].chosen >= 0) {
            s->chosen[k] = &s->point[i];
            s->active[k] = s->point[i].z > 0;
            s->point[i].chosen = k++;
        }
    }
    return PALPATE_OK;
}

/// What replaces C_ab between neighbours, minus C_ab (near_field.h). @return 0: nothing
static int near_change(const press_system *s, int32_t a, int32_t b, double change[9]) {
    const pal_near_field *near = &s->near;
    if (!(near->normal > 0.0) || !pal_near_pair(near, a, b, change)) {
        return 0;
    }
    size_t ld = 3 * (size_t)s->model->info.column_count;
    double g[9];
    if (a == b) {
        size_t node = (size_t)s->model->column_node[a];
        const double *v = s->model->area_vector + 3 * node, *n = s->model->normal + 3 * node;
        double self = PALPATE_NEAR_SELF / sqrt(sqrt(dot3(v, v)));
        for (int k = 0; k < 9; k++) {
            g[k] = self * ((near->normal - near->tangent) * n[k % 3] * n[k / 3] +
                           (k % 3 == k / 3 ? near->tangent : 0.0));
        }
    } else {
        pal_near_kernel(near, a, b, g);
    }
    for (int k = 0; k < 9; k++) {
        change[k] += g[k] - s->model->c_tt[3 * (size_t)a + (size_t)(k % 3) +
                                           (3 * (size_t)b + (size_t)(k / 3)) * ld];
    }
    return 1;
}

/// u += C_ij f, all weights included.
static void add_displacement(const press_system *s, const indent_point *i, const indent_point *j,
                             const double f[3], double u[3]) {
    const pal_model *model = s->model;
    size_t ld = 3 * (size_t)model->info.column_count;
    for (int b = 0; b < j->nodes; b++) {
        for (int a = 0; a < i->nodes; a++) {
            double delta[9];
            if (near_change(s, i->column[a], j->column[b], delta)) {
                for (int k = 0; k < 9; k++) {
                    u[k % 3] += i->weight[a] * j->weight[b] * delta[k] * f[k / 3];
                }
            }
        }
        for (size_t c = 0; c < 3; c++) {
            const double *column = model->c_tt + (3 * (size_t)j->column[b] + c) * ld;
            double scaled = j->weight[b] * f[c];
            for (int a = 0; a < i->nodes; a++) {
                for (size_t k = 0; k < 3; k++) {
                    u[k] += i->weight[a] * column[3 * (size_t)i->column[a] + k] * scaled;
                }
            }
        }
    }
}

/// The constraint of place p at this depth: w = n . u + c, n in p->direction. @return c
static double constraint(const press_system *s, indent_point *p, double depth) {
    const pal_tool_def *tool = s->tool;
    double x[3], along = 0, r2 = 0;
    if (s->law == PALPATE_INDENT_REST) {
        for (int k = 0; k < 3; k++) {
            x[k] = p->x[k] - tool->start[k];
        }
        along = dot3(x, s->axis);
        for (int k = 0; k < 3; k++) {
            double d = x[k] - along * s->axis[k];
            r2 += d * d;
        }
        memcpy(p->direction, s->axis, sizeof s->axis);
        // a place that stands for the whole tip lies on its axis
        return along - pal_tool_extent(tool, p->nodes == 1 ? sqrt(r2) : 0) - depth;
    }
    double half = tool->shape == PALPATE_SHAPE_CAPSULE ? 0.5 * tool->length : 0;
    for (int k = 0; k < 3; k++) {
        x[k] = p->x[k] + p->u[k] - tool->start[k] - depth * s->axis[k];
    }
    along = fmin(fmax(dot3(x, s->axis), -half), half);
    for (int k = 0; k < 3; k++) {
        p->direction[k] = x[k] - along * s->axis[k];
    }
    double length = sqrt(dot3(p->direction, p->direction));
    for (int k = 0; k < 3; k++) {
        p->direction[k] = length > 0 ? p->direction[k] / length : s->axis[k];
    }
    return length - tool->radius - dot3(p->direction, p->u);
}

static void build_matrix(press_system *s) {
    size_t n = (size_t)s->count;
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < n; i++) {
            double u[3] = {0, 0, 0};
            add_displacement(s, s->chosen[i], s->chosen[j], s->chosen[j]->direction, u);
            s->m[i + j * n] = dot3(s->chosen[i]->direction, u);
        }
    }
    s->built = 1;
}

/// u of a place under the forces of the last solve.
static void displacement(const press_system *s, const indent_point *p, double u[3]) {
    u[0] = u[1] = u[2] = 0;
    for (int32_t j = 0; j < s->count; j++) {
        const indent_point *from = s->chosen[j];
        if (from->z > 0) {
            double f[3] = {from->z * from->direction[0], from->z * from->direction[1],
                           from->z * from->direction[2]};
            add_displacement(s, p, from, f, u);
        }
    }
}

/// One linear complementarity problem with the directions of now. @return largest change of a
/// chosen u
static double solve_once(press_system *s, double depth) {
    for (int32_t i = 0; i < s->count; i++) {
        s->q[i] = constraint(s, s->chosen[i], depth);
    }
    if (!s->built || s->law == PALPATE_INDENT_FULL) {
        build_matrix(s);
    }
    pal_lcp problem = {.n = s->count,
                       .m = s->m,
                       .ld = s->count,
                       .q = s->q,
                       .symmetric = s->model->info.certificate.symmetrized};
    pal_lcp_result r = pal_lcp_solve(&problem, PALPATE_LCP_ITERATIONS + 4 * s->count, s->active,
                                     s->z, s->w, s->work);
    s->iterations += r.iterations;
    s->cut_off |= r.state != PALPATE_LCP_SOLVED;
    for (int32_t i = 0; i < s->count; i++) {
        s->chosen[i]->z = s->z[i];
    }
    double change = 0;
    for (int32_t i = 0; i < s->count; i++) {
        double u[3];
        displacement(s, s->chosen[i], u);
        for (int k = 0; k < 3; k++) {
            change = fmax(change, fabs(u[k] - s->chosen[i]->u[k]));
        }
        memcpy(s->chosen[i]->u, u, sizeof u);
    }
    return change;
}

static void solve_law(press_system *s, double depth) {
    if (s->law == PALPATE_INDENT_REST) {
        (void)solve_once(s, depth);
        return;
    }
    for (int i = 0; i < FULL_ITERATIONS; i++) {
        if (solve_once(s, depth) <= 1e-10 * s->tool->radius) {
            return;
        }
    }
    s->cut_off = 1;
}

/// Mark the places outside the system that the solution enters. @return how many
static int32_t add_violated(press_system *s, double depth) {
    int32_t added = 0;
    for (int32_t i = 0; i < s->points; i++) {
        indent_point *p = &s->point[i];
        if (p->chosen < 0) {
            displacement(s, p, p->u);
            double c = constraint(s, p, depth);
            if (dot3(p->direction, p->u) + c < -1e-12 * depth) {
                p->chosen = 0;
                added++;
            }
        }
    }
    return added;
}

static pal_status solve_depth(press_system *s, double depth, pal_indent_result *out,
                              pal_error *error) {
    s->iterations = s->cut_off = 0;
    for (int round = 0; round < ROUNDS; round++) {
        if (s->count > 0) {
            solve_law(s, depth);
        }
        if (add_violated(s, depth) == 0) {
            break;
        }
        pal_status status = assemble(s, error);
        if (status != PALPATE_OK) {
            return status;
        }
        s->cut_off |= round == ROUNDS - 1;
    }
    *out = (pal_indent_result){.depth = depth, .iterations = s->iterations, .cut_off = s->cut_off};
    double area = 0;
    for (int32_t i = 0; i < s->count; i++) {
        const indent_point *p = s->chosen[i];
        if (p->z > 0) {
            out->contacts++;
            area += p->area;
            for (int k = 0; k < 3; k++) {
                out->force_vector[k] += p->z * p->direction[k];
            }
        }
    }
    out->force = sqrt(dot3(out->force_vector, out->force_vector));
    out->radius = area > 0 ? sqrt(area / 3.14159265358979323846) : 0;
    return PALPATE_OK;
}

/// The compliance between neighbours that the mesh does not resolve.
static pal_status find_near(press_system *s, pal_error *error) {
    pal_rest_surface surface;
    void *memory = aligned_alloc(64, pal_rest_bytes(s->model));
    s->near_memory = aligned_alloc(64, pal_near_bytes(s->model));
    pal_status status = PALPATE_OK;
    if (memory == NULL || s->near_memory == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY,
                          "tool '%s': no memory for the surface of %d nodes", s->tool->name,
                          (int)s->model->info.surface_count);
    } else {
        pal_rest_init(&surface, s->model, memory);
        pal_near_init(&s->near, s->model, &surface, 2, s->near_memory);
    }
    free(memory);
    return status;
}

static pal_status check(const pal_model *model, const pal_tool_def *tool, pal_indent_law law,
                        const double *depths, int32_t count, const pal_indent_result *out,
                        pal_error *error) {
    if (model == NULL || tool == NULL || (count > 0 && (depths == NULL || out == NULL)) ||
        count < 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "indent: needs a model, a tool, depths and a place for the results");
    }
    if (!tool->has_start) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "tool '%s': indent needs its start (the tool's origin when it just touches) and axis",
            tool->name);
    }
    double length = sqrt(dot3(tool->axis, tool->axis));
    if (!isfinite(length) || length <= 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tool '%s': its axis (%g, %g, %g) has no direction", tool->name,
                        tool->axis[0], tool->axis[1], tool->axis[2]);
    }
    if (tool->shape != PALPATE_SHAPE_POINT && !(tool->radius > 0)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "tool '%s': its radius %g must be above 0",
                        tool->name, tool->radius);
    }
    if (law == PALPATE_INDENT_FULL && tool->shape == PALPATE_SHAPE_POINT) {
        return pal_fail(error, PALPATE_ERROR_UNSUPPORTED,
                        "tool '%s': a point has no surface to slide on: the full contact law is "
                        "for spheres and "
                        "capsules; use the rest law",
                        tool->name);
    }
    for (int32_t i = 0; i < count; i++) {
        if (!isfinite(depths[i]) || depths[i] < 0) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "indent: depth %d is %g m; it must be 0 or more", (int)i + 1,
                            depths[i]);
        }
    }
    return PALPATE_OK;
}

pal_status pal_model_indent(const pal_model *model, const pal_tool_def *tool, pal_indent_law law,
                            const double *depths, int32_t count, pal_indent_result *out,
                            pal_error *error) {
    pal_status status = check(model, tool, law, depths, count, out, error);
    if (status != PALPATE_OK) {
        return status;
    }
    press_system s = {.model = model, .tool = tool, .law = law};
    double length = sqrt(dot3(tool->axis, tool->axis)), deepest = 0;
    for (int k = 0; k < 3; k++) {
        s.axis[k] = tool->axis[k] / length;
    }
    for (int32_t i = 0; i < count; i++) {
        deepest = fmax(deepest, depths[i]);
    }
    status = pal_indent_points(model, tool, s.axis, &s.point, &s.points, error);
    if (status != PALPATE_OK) {
        return status;
    }
    for (int32_t i = 0; i < s.points; i++) {
        s.point[i].chosen = constraint(&s, &s.point[i], deepest) < 0 ? 0 : -1;
    }
    status = find_near(&s, error);
    status = status == PALPATE_OK ? assemble(&s, error) : status;
    for (int32_t i = 0; i < count && status == PALPATE_OK; i++) {
        status = solve_depth(&s, depths[i], &out[i], error);
    }
    release(&s);
    free(s.near_memory);
    free(s.point);
    return status;
}
