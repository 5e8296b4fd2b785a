/// The stored compliance against dense LAPACK on the same system, end to end from a scene's text:
/// Eqs. 52-53 equal a direct solve with the tool's rows replaced by Dirichlet rows, every column
/// and row is the right one, in every precision, at every unit, and nothing hangs on what was
/// skipped.
#include <float.h>
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include <palpate/precompute.h>

#include "haptic/model/model.h"
#include "src/solution/compliance.h"
#include "src/solution/factor.h"
#include "src/scene/scene.h"
#include "src/cloud/scene_check.h"
#include "tests/support/scene_text.h"

/// Clamped at its base, a cap to press, two probes: one inside, one at a surface node (the pole).
static const char HEMISPHERE[] =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {hemisphere: {radius: 0.05}}\n"
    "  spacing: 0.014\n"
    "  material: {young: 10e3, poisson: 0.4}\n"
    "  fixed: [{below: {z: 0.0}}]\n"
    "  touchable: [{ball: {center: [0, 0, 0.05], radius: 0.04}}]\n"
    "  patches:\n"
    "    cap: {ball: {center: [0, 0, 0.05], radius: 0.018}, rim_spacing: 0.008}\n"
    "    side: {ball: {center: [0.035, 0, 0.035], radius: 0.016}, rim_spacing: none}\n"
    "  probes: {inside: [0.004, 0.007, 0.03], low: [-0.01, 0.01, 0.012]}\n"
    "repair: none\n"
    "certify: warn\n"
    "store: {displacement: all, precision: double}\n";

/// A scene, its cloud, system and node sets, and the model built from the same text.
typedef struct rig {
    pal_scene *scene;
    pal_cloud cloud;
    pal_node_sets sets;
    pal_system system;
    pal_model *model;
    double unit; ///< 1 / (E L) of metres per newton
    lapack_int n;
    double *k, *lu; ///< K dense and its LU factors, column-major
    lapack_int *pivot;
    double cond; ///< of K, 1-norm
} rig;

static void *need(void *p) {
    assert_non_null(p);
    return p;
}

static double *zeros(int64_t n) {
    return need(calloc((size_t)n + 1, sizeof(double)));
}

#define OK(call)                                                                                   \
    do {                                                                                           \
        pal_error error = {0};                                                                     \
        if ((call) != PALPATE_OK) {                                                                \
            fail_msg("line %d: %s", __LINE__, error.message);                                      \
        }                                                                                          \
    } while (0)

static void rig_system(rig *r, const char *text, const char *const set[]) {
    memset(r, 0, sizeof *r);
    OK(test_scene_load(text, set, &r->scene, &error));
    OK(pal_cloud_build(r->scene, NULL, &r->cloud, NULL, &error));
    OK(pal_scene_select_nodes(r->scene, &r->cloud, &r->sets, &error));
    uint8_t *fixed = need(calloc((size_t)r->cloud.node_count, 1));
    for (int32_t i = 0; i < r->cloud.node_count; i++) {
        fixed[i] = (r->sets.flags[i] & PALPATE_NODE_FIXED) != 0;
    }
    OK(pal_discretize(&r->cloud, fixed, r->scene->poisson, &r->scene->method, NULL, &r->system,
                      &error));
    free(fixed);
    r->unit = 1.0 / (r->scene->young * r->cloud.length);
}

static double *dense(const pal_sparse *a) {
    double *d = zeros(a->rows * a->columns);
    for (int64_t j = 0; j < a->columns; j++) {
        for (int64_t e = a->start[j]; e < a->start[j + 1]; e++) {
            d[j * a->rows + a->row[e]] += a->value[e];
        }
    }
    return d;
}

static void rig_dense(rig *r) {
    size_t nn = (size_t)r->system.unknown_count * (size_t)r->system.unknown_count;
    r->n = r->system.unknown_count;
    r->k = dense(&r->system.matrix);
    r->lu = zeros((int64_t)nn);
    memcpy(r->lu, r->k, nn * sizeof *r->lu);
    r->pivot = need(malloc((size_t)r->n * sizeof *r->pivot));
    double norm = LAPACKE_dlange(LAPACK_COL_MAJOR, '1', r->n, r->n, r->lu, r->n), rcond = 0.0;
    assert_int_equal(LAPACKE_dgetrf(LAPACK_COL_MAJOR, r->n, r->n, r->lu, r->n, r->pivot), 0);
    assert_int_equal(LAPACKE_dgecon(LAPACK_COL_MAJOR, '1', r->n, r->lu, r->n, norm, &rcond), 0);
    r->cond = 1.0 / rcond;
}

static void rig_open(rig *r, const char *text, const char *const set[]) {
    rig_system(r, text, set);
    rig_dense(r);
    OK(pal_precompute(r->scene, NULL, &r->model, &error));
}

static void rig_close(rig *r) {
    free(r->k);
    free(r->lu);
    free(r->pivot);
    pal_model_free(r->model);
    pal_system_clear(&r->system);
    pal_node_sets_clear(&r->sets);
    pal_cloud_clear(&r->cloud);
    pal_scene_free(r->scene);
}

/// U (n) of the unit nodal force in direction c at surface node `node`, by LAPACK.
static void column_of(const rig *r, int32_t node, int c, double *x) {
    const pal_sparse *b = &r->system.load;
    int64_t j = 3 * (int64_t)node + c;
    memset(x, 0, (size_t)r->n * sizeof *x);
    for (int64_t e = b->start[j]; e < b->start[j + 1]; e++) {
        x[b->row[e]] = b->value[e];
    }
    assert_int_equal(LAPACKE_dgetrs(LAPACK_COL_MAJOR, 'N', r->n, 1, r->lu, r->n, r->pivot, x, r->n),
                     0);
}

/// Displacement [m] of a node's component in a solution; zero where the node is held.
static double at(const rig *r, const double *x, int32_t node, int c) {
    int32_t q = r->system.dof_unknown[3 * (int64_t)node + c];
    return q < 0 ? 0.0 : r->unit * x[q];
}

/// ---- Eqs. 52-53 ------------------------------------------------------------------------------

typedef struct method_case {
    const char *set[4];
    double tolerance; ///< 0: 1e-12 x cond
} method_case;

static const method_case METHODS[] = {
    {{"method.kind=cell", "body.material.poisson=0.3", NULL}, 1e-8},
    {{"method.kind=cell", "method.form=collocated", NULL}, 1e-8},
    {{"method.kind=galerkin", NULL}, 1e-8},
    {{"method.kind=point", "body.material.poisson=0.3", NULL}, 0.0},
    {{"method.kind=point", "method.basis=linear", NULL}, 0.0},
};
enum { METHOD_COUNT = sizeof METHODS / sizeof *METHODS };

static void pressing_equals_a_direct_solve_with_dirichlet_rows(void **state) {
    (void)state;
    const double by[3] = {0.0007, -0.0004, -0.005};
    for (int k = 0; k < METHOD_COUNT; k++) {
        rig r;
        rig_open(&r, HEMISPHERE, METHODS[k].set);
        double tolerance = METHODS[k].tolerance > 0.0 ? METHODS[k].tolerance : 1e-12 * r.cond;
        assert_in_range((int64_t)(1e15 * tolerance), 0, (int64_t)(1e15 * 1e-3)); // says something
        const pal_model *m = r.model;
        const pal_patch *patch = &m->patch[0];
        pal_press press;
        OK(pal_model_press(m, "cap", by, &press, &error));
        // the touched nodes' equations give way to u = by: K with those rows replaced, one solve
        int64_t n = r.n, count = patch->count;
        assert_true(count >= 6);
        double *a = zeros(n * n), *u = zeros(n), *f = zeros(n);
        lapack_int *pivot = need(malloc((size_t)n * sizeof *pivot));
        memcpy(a, r.k, (size_t)(n * n) * sizeof *a);
        for (int64_t i = 0; i < 3 * count; i++) {
            const pal_sparse *b = &r.system.load;
            int32_t node = m->column_node[patch->column[i / 3]];
            int64_t j = 3 * (int64_t)node + i % 3, row = b->row[b->start[j]];
            assert_int_equal(b->start[j + 1] - b->start[j], 1); // its force acts in one row
            for (int64_t c = 0; c < n; c++) {
                a[c * n + row] = 0.0;
            }
            a[r.system.dof_unknown[j] * n + row] = 1.0;
            u[row] = by[i % 3];
        }
        assert_int_equal(LAPACKE_dgesv(LAPACK_COL_MAJOR, r.n, 1, a, r.n, pivot, u, r.n), 0);
        pal_sparse_multiply(&r.system.matrix, 1.0 / r.unit, u, f); // f = K u
        double total[3] = {0, 0, 0}, worst_force = 0.0, size_force = 0.0, worst = 0.0;
        double center[3] = {0, 0, 0}, moment[3] = {0, 0, 0}; // about the patch's mean position
        for (int64_t i = 0; i < 3 * count; i++) {
            int64_t node = m->column_node[patch->column[i / 3]];
            center[i % 3] += r.cloud.length * r.cloud.position[3 * node + i % 3] / (double)count;
        }
        for (int64_t i = 0; i < 3 * count; i++) {
            const pal_sparse *b = &r.system.load;
            int64_t j = 3 * (int64_t)m->column_node[patch->column[i / 3]] + i % 3;
            double nodal = f[b->row[b->start[j]]] / b->value[b->start[j]];
            total[i % 3] += nodal;
            int p = (int)(i + 1) % 3, q = (int)(i + 2) % 3; // arm x e_c = arm_q e_p - arm_p e_q
            const double *x = r.cloud.position + 3 * (j / 3);
            moment[p] += nodal * (r.cloud.length * x[q] - center[q]);
            moment[q] -= nodal * (r.cloud.length * x[p] - center[p]);
            worst_force = fmax(worst_force, fabs(nodal - press.node_force[i]));
            size_force = fmax(size_force, fabs(nodal));
        }
        for (int c = 0; c < 3; c++) {
            assert_true(fabs(total[c] - press.force[c]) <= tolerance * fabs(total[2]));
            assert_true(fabs(moment[c] - press.moment[c]) <= tolerance * 0.05 * fabs(total[2]));
        }
        if (!(worst_force <= tolerance * size_force)) {
            fail_msg("method %d: nodal forces off by %g of %g N (cond %g)", k, worst_force,
                     size_force, r.cond);
        }
        assert_int_equal(m->info.row_count, m->info.node_count);
        for (int64_t i = 0; i < 3 * (int64_t)m->info.node_count; i++) {
            int32_t q = r.system.dof_unknown[i];
            worst = fmax(worst, fabs(press.displacement[i] - (q < 0 ? 0.0 : u[q])));
        }
        if (!(worst <= tolerance * 0.005)) {
            fail_msg("method %d: displacements off by %g m (cond %g)", k, worst, r.cond);
        }
        print_message(
            "method %d: %d nodes, F_z %.4f N, cond %.1e, force error %.1e, field error %.1e\n", k,
            (int)m->info.node_count, press.force[2], r.cond, worst_force / size_force,
            worst / 0.005);
        pal_press_clear(&press);
        free(a);
        free(u);
        free(f);
        free(pivot);
        rig_close(&r);
    }
}

/// ---- Columns, rows, probes -------------------------------------------------------------------

static void every_column_is_lapacks(void **state) {
    (void)state;
    for (int k = 0; k < METHOD_COUNT; k++) {
        rig r;
        rig_open(&r, HEMISPHERE, METHODS[k].set);
        const pal_model *m = r.model;
        int64_t t = 3 * (int64_t)m->info.column_count, rows = 3 * (int64_t)m->info.row_count;
        double *x = zeros(r.n), *stored = zeros(rows), tolerance = 1e-13 * r.cond;
        for (int64_t j = 0; j < t; j++) {
            column_of(&r, m->column_node[j / 3], (int)(j % 3), x);
            OK(pal_model_load_column(m, j, stored));
            double size = 0.0, off = 0.0;
            for (int64_t i = 0; i < t; i++) {
                double want = at(&r, x, m->column_node[i / 3], (int)(i % 3));
                off = fmax(off, fabs(m->c_tt[j * t + i] - want));
            }
            for (int64_t i = 0; i < rows; i++) {
                double want = at(&r, x, m->row_node[i / 3], (int)(i % 3));
                size = fmax(size, fabs(want));
                off = fmax(off, fabs(stored[i] - want));
            }
            for (int32_t p = 0; p < m->info.probe_count; p++) {
                int32_t node[PALPATE_PROBE_NODES];
                double weight[PALPATE_PROBE_NODES], y[3];
                for (int d = 0; d < 3; d++) {
                    y[d] = m->probe[p].position[d] / r.cloud.length;
                }
                int32_t used = pal_interpolate(&r.cloud, y, PALPATE_PROBE_NODES, node, weight);
                assert_true(used > 0);
                for (int d = 0; d < 3; d++) {
                    double want = 0.0;
                    for (int32_t q = 0; q < used; q++) {
                        want += weight[q] * at(&r, x, node[q], d);
                    }
                    off = fmax(off,
                               fabs(m->probe_row[j * 3 * m->info.probe_count + 3 * p + d] - want));
                }
            }
            if (!(off <= tolerance * size)) {
                fail_msg("method %d, column %d: off by %g of %g m/N", k, (int)j, off, size);
            }
        }
        free(x);
        free(stored);
        rig_close(&r);
    }
}

/// What is stored decides which unknowns the solves may skip, never what the others become.
static void skipping_unwanted_unknowns_changes_no_bit(void **state) {
    (void)state;
    static const char *const stores[] = {"store.displacement=all", "store.displacement=surface",
                                         "store.displacement=none"};
    for (int k = 0; k < 3; k++) { // cell (LU), galerkin (Cholesky), point
        static const char *const kinds[] = {"method.kind=cell", "method.kind=galerkin",
                                            "method.kind=point"};
        pal_model *m[3];
        for (int s = 0; s < 3; s++) {
            pal_scene *scene;
            OK(test_scene_load(HEMISPHERE, (const char *const[]){kinds[k], stores[s], NULL}, &scene,
                               &error));
            OK(pal_precompute(scene, NULL, &m[s], &error));
            pal_scene_free(scene);
        }
        size_t t = 3 * (size_t)m[0]->info.column_count;
        assert_int_equal(m[0]->info.row_count, m[0]->info.node_count);
        assert_int_equal(m[1]->info.row_count, m[1]->info.surface_count);
        assert_int_equal(m[2]->info.row_count, 0);
        double *all = zeros(3 * m[0]->info.row_count), *some = zeros(3 * m[1]->info.row_count);
        for (int s = 1; s < 3; s++) {
            assert_memory_equal(m[0]->c_tt, m[s]->c_tt, t * t * sizeof(double));
            assert_memory_equal(m[0]->probe_row, m[s]->probe_row,
                                t * 3 * (size_t)m[0]->info.probe_count * sizeof(double));
        }
        for (size_t j = 0; j < t; j++) {
            OK(pal_model_load_column(m[0], (int64_t)j, all));
            OK(pal_model_load_column(m[1], (int64_t)j, some));
            assert_memory_equal(all, some, 3 * (size_t)m[1]->info.row_count * sizeof *all);
        }
        free(all);
        free(some);
        for (int s = 0; s < 3; s++) {
            pal_model_free(m[s]);
        }
    }
}

/// Every patch is its own ball's surface nodes, all of them.
static void patches_are_what_their_selectors_say(void **state) {
    (void)state;
    static const double center[2][3] = {{0, 0, 0.05}, {0.035, 0, 0.035}},
                        radius[2] = {0.018, 0.016};
    rig r;
    rig_open(&r, HEMISPHERE, NULL);
    assert_int_equal(r.model->info.patch_count, 2);
    for (int p = 0; p < 2; p++) {
        const pal_patch *patch = &r.model->patch[p];
        int32_t inside = 0;
        for (int32_t i = 0; i < r.model->info.surface_count; i++) {
            double d = 0.0;
            for (int c = 0; c < 3; c++) {
                d = hypot(d, r.model->position[3 * i + c] - center[p][c]);
            }
            if (d <= radius[p] + 1e-6 * 0.1 && !(r.model->node_flags[i] & PALPATE_NODE_FIXED)) {
                assert_true(inside < patch->count);
                assert_int_equal(r.model->column_node[patch->column[inside]], i);
                inside++;
            }
        }
        assert_int_equal(inside, patch->count);
        assert_true(inside > 2);
    }
    rig_close(&r);
}

/// Symmetrizing: the mean of the raw block and its transpose, and nothing else changes.
static void symmetrizing_takes_the_mean(void **state) {
    (void)state;
    pal_model *m[2];
    for (int s = 0; s < 2; s++) {
        pal_scene *scene;
        OK(test_scene_load(HEMISPHERE,
                           (const char *const[]){"method.kind=point",
                                                 s ? "repair=symmetrize" : "repair=none", NULL},
                           &scene, &error));
        OK(pal_precompute(scene, NULL, &m[s], &error));
        pal_scene_free(scene);
    }
    int64_t t = 3 * (int64_t)m[0]->info.column_count;
    double skew = 0.0, all = 0.0;
    for (int64_t j = 0; j < t; j++) {
        for (int64_t i = 0; i < t; i++) {
            double a = m[0]->c_tt[j * t + i], b = m[0]->c_tt[i * t + j];
            assert_true(m[1]->c_tt[j * t + i] == 0.5 * (a + b));
            skew += (a - b) * (a - b);
            all += a * a;
        }
    }
    for (int s = 0; s < 2; s++) { // both report what the raw block was
        assert_true(fabs(m[s]->info.certificate.reciprocity - sqrt(skew / all)) < 1e-10);
    }
    assert_true(m[0]->info.certificate.reciprocity > 0.01); // point: there is something to repair
    assert_int_equal(m[0]->info.certificate.symmetrized, 0);
    assert_int_equal(m[0]->info.certificate.passive, 0);
    assert_int_equal(m[1]->info.certificate.symmetrized, 1);
    pal_model_free(m[0]);
    pal_model_free(m[1]);
}

/// What the certificate says about forces, asked of the forces themselves.
static void the_certificate_tells_what_forces_do(void **state) {
    (void)state;
    static const char *const kinds[] = {"method.kind=cell", "method.kind=galerkin",
                                        "method.kind=point"};
    for (int k = 0; k < 3; k++) {
        pal_model *m[2];
        for (int s = 0; s < 2; s++) {
            pal_scene *scene;
            OK(test_scene_load(
                HEMISPHERE,
                (const char *const[]){kinds[k], s ? "repair=symmetrize" : "repair=none", NULL},
                &scene, &error));
            OK(pal_precompute(scene, NULL, &m[s], &error));
            pal_scene_free(scene);
        }
        const pal_certificate *c = &m[1]->info.certificate;
        double worst = 0.0;
        for (int d = 0; d < 3; d++) { // the patch moved along each axis is among what is sampled
            const double by[3] = {d == 0, d == 1, d == 2};
            pal_press a, b;
            OK(pal_model_press(m[0], "cap", by, &a, &error));
            OK(pal_model_press(m[1], "cap", by, &b, &error));
            double off = hypot(hypot(b.force[0] - a.force[0], b.force[1] - a.force[1]),
                               b.force[2] - a.force[2]);
            worst = fmax(worst, off / hypot(hypot(a.force[0], a.force[1]), a.force[2]));
            pal_press_clear(&a);
            pal_press_clear(&b);
        }
        assert_true(c->force_change >= worst * (1.0 - 1e-6) - 1e-12);
        assert_true(k < 2 || worst > 0.01); // point: symmetrizing moves forces, and it says so
        for (int s = 0; s < 2; s++) {
            c = &m[s]->info.certificate;
            assert_true(c->solve_residual >= 0.0 && c->solve_residual < 1e-10);
            assert_true(c->rcond > 0.0 && c->rcond <= 1.0 && c->mls_worst_condition >= 1.0);
            // supports push back with just the force applied (equilibrium of the whole body)
            assert_true(k == 2 || (c->force_balance >= 0.0 && c->force_balance < 1e-9));
        }
        assert_int_equal(m[0]->info.certificate.passive, 0);
        assert_true(k == 2 || m[1]->info.certificate.passive);
        pal_model_free(m[0]);
        pal_model_free(m[1]);
    }
}

/// ---- Precision -------------------------------------------------------------------------------

/// Every stored element is the double one to its format's rounding, however stiff the body: half
/// precision has 5 exponent bits and must be scaled (1e15 Pa: compliances of 1e-13 m/N).
static void rows_are_rounded_once(void **state) {
    (void)state;
    static const char *const young[] = {"body.material.young=1e-3", "body.material.young=10e3",
                                        "body.material.young=1e15"};
    static const char *const precision[] = {"store.precision=double", "store.precision=single",
                                            "store.precision=half"};
    for (int e = 0; e < 3; e++) {
        pal_model *m[3];
        for (int p = 0; p < 3; p++) {
            pal_scene *scene;
            OK(test_scene_load(HEMISPHERE, (const char *const[]){young[e], precision[p], NULL},
                               &scene, &error));
            OK(pal_precompute(scene, NULL, &m[p], &error));
            pal_scene_free(scene);
        }
        int64_t rows = 3 * (int64_t)m[0]->info.row_count;
        double *exact = zeros(rows), *rounded = zeros(rows);
        // relative rounding, and half the step of the smallest numbers (half: 2^-25 of the scale)
        const double relative[3] = {0.0, 0x1p-24, 0x1p-11}, step[3] = {0.0, 0x1p-150, 0x1p-25};
        for (int p = 1; p < 3; p++) {
            for (int64_t j = 0; j < 3 * (int64_t)m[0]->info.column_count; j++) {
                double size = 0.0;
                OK(pal_model_load_column(m[0], j, exact));
                OK(pal_model_load_column(m[p], j, rounded));
                for (int64_t i = 0; i < rows; i++) {
                    double allowed = fmax(relative[p] * fabs(exact[i]), step[p] * m[p]->row_scale);
                    size = fmax(size, fabs(exact[i]));
                    assert_true(fabs(rounded[i] - exact[i]) <= allowed);
                }
                // the scale leaves the format's precision to what matters: 1e-5 of a column's
                // largest is still a normal number
                assert_true(p == 1 || 1e-5 * size > 0x1p-14 * m[p]->row_scale);
            }
        }
        free(exact);
        free(rounded);
        for (int p = 0; p < 3; p++) {
            pal_model_free(m[p]);
        }
    }
}

/// A model by hand on a rig's system: `columns` from all free surface nodes, rows of all nodes.
static pal_model *hand_model(const rig *r, pal_precision precision) {
    pal_model *m = need(pal_model_new());
    m->info.precision = precision;
    m->info.row_count = r->cloud.node_count;
    m->row_node = need(malloc((size_t)r->cloud.node_count * sizeof *m->row_node));
    m->column_node = need(malloc((size_t)r->cloud.node_count * sizeof *m->column_node));
    for (int32_t i = 0; i < r->cloud.node_count; i++) {
        m->row_node[i] = i;
        if (i < r->cloud.surface_count && !(r->sets.flags[i] & PALPATE_NODE_FIXED)) {
            m->column_node[m->info.column_count++] = i;
        }
    }
    return m;
}

/// A column far larger than all that were sampled is found out and the scale grown.
static void half_rows_make_room_for_unsampled_columns(void **state) {
    (void)state;
    rig r;
    rig_system(&r, HEMISPHERE, NULL);
    pal_model *m[2] = {hand_model(&r, PALPATE_PRECISION_DOUBLE),
                       hand_model(&r, PALPATE_PRECISION_HALF)};
    int32_t big =
        3 * m[0]->column_node[1] + 2; // 12 evenly spaced columns are sampled, not column 5
    for (int64_t e = r.system.load.start[big]; e < r.system.load.start[big + 1]; e++) {
        r.system.load.value[e] *= 0x1p14;
    }
    pal_factor *factor;
    OK(pal_factor_create(&r.system.matrix, r.system.positive, NULL, &factor, NULL, &error));
    double size = 0.0, scale = 0.0;
    double *exact = zeros(3 * r.cloud.node_count), *rounded = zeros(3 * r.cloud.node_count);
    for (int p = 0; p < 2; p++) {
        pal_compliance_report report;
        OK(pal_compliance_solve(&r.system, factor, 1e4, r.cloud.length, NULL, NULL, m[p], &report,
                                &error));
    }
    scale = m[1]->row_scale;
    for (int64_t j = 0; j < 3 * (int64_t)m[0]->info.column_count; j++) {
        OK(pal_model_load_column(m[0], j, exact));
        OK(pal_model_load_column(m[1], j, rounded));
        for (int32_t i = 0; i < 3 * r.cloud.node_count; i++) {
            size = fmax(size, fabs(exact[i]));
            assert_true(fabs(rounded[i] - exact[i]) <=
                        fmax(0x1p-11 * fabs(exact[i]), 0x1p-25 * scale));
        }
    }
    assert_true(size <= 65504.0 * scale && size > 0x1p-14 * scale);
    free(exact);
    free(rounded);
    pal_factor_free(factor);
    pal_model_free(m[0]);
    pal_model_free(m[1]);
    rig_close(&r);
}

/// ---- Refinement ------------------------------------------------------------------------------

/// The factor of a matrix off by 1e-6: the sampled residual shows it, every column gets its step of
/// refinement, which squares the error.
static void a_poor_factor_is_refined(void **state) {
    (void)state;
    for (int k = 0; k < 2; k++) {
        rig r;
        rig_system(&r, HEMISPHERE,
                   (const char *const[]){k ? "method.kind=galerkin" : "method.kind=cell", NULL});
        rig_dense(&r);
        const double off = 1e-6;
        pal_factor *factor;
        pal_sparse *a = &r.system.matrix;
        double *good = need(malloc((size_t)a->start[a->columns] * sizeof *good));
        memcpy(good, a->value, (size_t)a->start[a->columns] * sizeof *good);
        for (int64_t e = 0; e < a->start[a->columns]; e++) {
            a->value[e] *= 1.0 + off;
        }
        OK(pal_factor_create(a, r.system.positive, NULL, &factor, NULL, &error));
        memcpy(a->value, good, (size_t)a->start[a->columns] * sizeof *good);
        pal_model *m = hand_model(&r, PALPATE_PRECISION_DOUBLE);
        pal_compliance_report report;
        OK(pal_compliance_solve(&r.system, factor, 1.0 / r.unit, 1.0, NULL, NULL, m, &report,
                                &error));
        assert_int_equal(report.refined, 1);
        assert_true(report.residual < 1e-10); // as delivered, after the step
        double *x = zeros(r.n), *stored = zeros(3 * r.cloud.node_count);
        for (int64_t j = 0; j < 3 * (int64_t)m->info.column_count; j += 7) {
            double size = 0.0, worst = 0.0;
            column_of(&r, m->column_node[j / 3], (int)(j % 3), x);
            OK(pal_model_load_column(m, j, stored));
            for (int32_t i = 0; i < 3 * r.cloud.node_count; i++) {
                double want = at(&r, x, i / 3, i % 3);
                size = fmax(size, fabs(want));
                worst = fmax(worst, fabs(stored[i] - want));
            }
            assert_true(worst <= (2.0 * off * off + 1e-14 * r.cond) * size);
        }
        free(x);
        free(stored);
        free(good);
        pal_model_free(m);
        pal_factor_free(factor);
        rig_close(&r);
    }
}

/// ---- Units -----------------------------------------------------------------------------------

static pal_model *scaled_box(const char *kind, double size, double young) {
    char text[1200];
    (void)snprintf(text, sizeof text,
                   "palpate: 1\n"
                   "body:\n"
                   "  geometry: {box: {size: [%.17g, %.17g, %.17g], center: [0, 0, %.17g]}}\n"
                   "  spacing: %.17g\n"
                   "  material: {young: %.17g, poisson: 0.45}\n"
                   "  fixed: [{below: {z: %.17g}}]\n"
                   "  touchable: [{above: {z: 0}}]\n"
                   "  probes: {p: [0, %.17g, %.17g]}\n"
                   "repair: none\n"
                   "certify: warn\n"
                   "store: {displacement: surface, precision: single}\n"
                   "method: {kind: %s}\n",
                   size, 0.8 * size, 0.6 * size, -0.3 * size, 0.25 * size, young, -0.6 * size,
                   0.1 * size, -0.2 * size, kind);
    pal_scene *scene;
    pal_model *m;
    OK(test_scene_load(text, NULL, &scene, &error));
    OK(pal_precompute(scene, NULL, &m, &error));
    pal_scene_free(scene);
    return m;
}

/// C E L does not depend on E or L. Tolerance 1e-8 as promised; rounding alone is left.
static void units_scale_out(void **state) {
    (void)state;
    static const char *const kinds[] = {"cell", "galerkin", "point"};
    static const double sizes[] = {1e-6, 1e3}, young[] = {1e-3, 1e15};
    for (int k = 0; k < 3; k++) {
        pal_model *reference = scaled_box(kinds[k], 1.0, 1.0);
        for (int v = 0; v < 4; v++) {
            double size = sizes[v % 2], e = young[v / 2];
            pal_model *m = scaled_box(kinds[k], size, e);
            assert_int_equal(m->info.node_count, reference->info.node_count);
            assert_int_equal(m->info.column_count, reference->info.column_count);
            int64_t t = 3 * (int64_t)m->info.column_count, p = 3 * (int64_t)m->info.probe_count;
            double largest = 0.0, worst = 0.0;
            for (int64_t i = 0; i < t * t; i++) {
                largest = fmax(largest, fabs(reference->c_tt[i]));
                worst = fmax(worst, fabs(m->c_tt[i] * e * size - reference->c_tt[i]));
            }
            for (int64_t i = 0; i < t * p; i++) {
                worst = fmax(worst, fabs(m->probe_row[i] * e * size - reference->probe_row[i]));
            }
            assert_true(largest > 0.1 && worst <= 1e-8 * largest);
            // what else has a unit: volumes, areas, places
            assert_true(fabs(m->info.volume / (0.48 * size * size * size) - 1.0) <
                        1e-5); // the grid of nodes
            double area = 0.0;
            for (int32_t i = 0; i < m->info.surface_count; i++) {
                for (int d = 0; d < 3; d++) {
                    area += m->area_vector[3 * i + d] * m->position[3 * i + d];
                }
            }
            assert_true(fabs(area / (3.0 * m->info.volume) - 1.0) <
                        0.1); // divergence theorem, lumped
            assert_true(fabs(m->info.bounds_max[0] / (0.5 * size) - 1.0) < 1e-5);
            assert_true(fabs(m->info.spacing_mean / size / reference->info.spacing_mean - 1.0) <
                        1e-8);
            assert_true(fabs(m->info.certificate.max_eigenvalue * e * size /
                                 reference->info.certificate.max_eigenvalue -
                             1.0) < 1e-5);
            assert_int_equal(m->info.certificate.pass, reference->info.certificate.pass);
            pal_model_free(m);
        }
        pal_model_free(reference);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(pressing_equals_a_direct_solve_with_dirichlet_rows),
        cmocka_unit_test(every_column_is_lapacks),
        cmocka_unit_test(skipping_unwanted_unknowns_changes_no_bit),
        cmocka_unit_test(patches_are_what_their_selectors_say),
        cmocka_unit_test(symmetrizing_takes_the_mean),
        cmocka_unit_test(the_certificate_tells_what_forces_do),
        cmocka_unit_test(rows_are_rounded_once),
        cmocka_unit_test(half_rows_make_room_for_unsampled_columns),
        cmocka_unit_test(a_poor_factor_is_refined),
        cmocka_unit_test(units_scale_out),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
