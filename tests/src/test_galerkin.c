/// The Galerkin method: exact on linear fields and rigid motion, symmetric, passive up to nu =
/// 0.4999, no locking, a stable pressure (numerical inf-sup), the same answer at any scale.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include "src/discretization/discretization.h"
#include "src/solution/factor.h"
#include "src/discretization/galerkin_inf_sup.h"

static const double UNIT[3] = {1, 1, 1};
static const double RATIOS[] = {-0.5, 0.0, 0.3, 0.45, 0.49, 0.499, 0.4999};
enum { RATIO_COUNT = sizeof RATIOS / sizeof *RATIOS };

/// Every form of the method; the last one with MLS trial functions on overlapping spheres.
enum { FORM_COUNT = 4 };
static pal_method form(int k) {
    return (pal_method){.kind = PALPATE_METHOD_GALERKIN,
                        .volumetric = k < 3 ? (pal_volumetric)k : PALPATE_VOLUMETRIC_MIXED,
                        .stabilization = -1,
                        .neighbours = k == 3 ? 18 : 0};
}

static pal_method method_of(pal_volumetric volumetric, double stabilization) {
    return (pal_method){
        .kind = PALPATE_METHOD_GALERKIN, .volumetric = volumetric, .stabilization = stabilization};
}

static void box(pal_cloud *c, const double size[3], int nx, int ny, int nz, double jitter) {
    pal_error e = {0};
    if (pal_cloud_box(c, size, (const int[3]){nx, ny, nz}, jitter, 5, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
}

static void build(const pal_cloud *c, const uint8_t *fixed, double nu, pal_method m,
                  pal_system *s) {
    pal_error e = {0};
    if (pal_method_galerkin(c, fixed, nu, &m, NULL, s, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
}

#define assert_near(value, want, tolerance) near_at(value, want, tolerance, __LINE__)
static void near_at(double value, double want, double tolerance, int line) {
    if (!(fabs(value - want) <= tolerance)) {
        fail_msg("line %d: %.17g, want %.17g within %g", line, value, want, tolerance);
    }
}

static double *zeros(size_t n) {
    double *x = calloc(n > 0 ? n : 1, sizeof *x);
    assert_non_null(x);
    return x;
}

/// Flags of the nodes with coordinate `axis` at 0; axis < 0: none; axis 3: all surface nodes.
static uint8_t *hold(const pal_cloud *c, int axis) {
    uint8_t *f = calloc((size_t)c->node_count, 1);
    assert_non_null(f);
    for (int32_t i = 0; i < c->surface_count && axis >= 0; i++) {
        f[i] = axis == 3 || fabs(c->position[3 * i + axis]) < 1e-12;
    }
    return f;
}

static void solve(const pal_sparse *k, int positive, int32_t count, double *x) {
    pal_error e = {0};
    pal_factor *factor = NULL;
    if (pal_factor_create(k, positive, NULL, &factor, NULL, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_factor_workspace *w = pal_factor_workspace_new(factor);
    assert_non_null(w);
    assert_int_equal(pal_factor_solve(factor, w, count, x, &e), PALPATE_OK);
    pal_factor_workspace_free(w);
    pal_factor_free(factor);
}

/// a dense, column-major
static double *dense(const pal_sparse *a) {
    double *d = zeros((size_t)(a->rows * a->columns));
    for (int64_t j = 0; j < a->columns; j++) {
        for (int64_t k = a->start[j]; k < a->start[j + 1]; k++) {
            d[a->row[k] + a->rows * j] = a->value[k];
        }
    }
    return d;
}

static double largest(const double *x, int64_t n) {
    double m = 0.0;
    for (int64_t i = 0; i < n; i++) {
        m = fmax(m, fabs(x[i]));
    }
    return m;
}

/// ---- Structure -----------------------------------------------------------------------------

static void matrix_is_exactly_symmetric(void **state) {
    (void)state;
    for (int f = 0; f < FORM_COUNT; f++) {
        pal_cloud c;
        box(&c, (const double[3]){1.0, 0.7, 0.6}, 4, 3, 3, 0.25);
        uint8_t *fixed = hold(&c, 2);
        pal_system s;
        build(&c, fixed, 0.45, form(f), &s);
        assert_int_equal(s.symmetric, 1);
        double *k = dense(&s.matrix);
        int32_t n = s.unknown_count;
        for (int32_t j = 0; j < n; j++) {
            for (int32_t i = 0; i < j; i++) { // same products in the same order: no tolerance
                assert_true(k[i + (int64_t)n * j] == k[j + (int64_t)n * i]);
            }
            for (int64_t e = s.matrix.start[j] + 1; e < s.matrix.start[j + 1]; e++) {
                assert_true(s.matrix.row[e] > s.matrix.row[e - 1]);
            }
        }
        free(k);
        free(fixed);
        pal_system_clear(&s);
        pal_cloud_clear(&c);
    }
}

/// Linear field u = A x + b with its constant pressure; the force it must give at every node is
/// sigma times the node's area vector, zero inside: the patch test, rigid motion (A skew) included.
static void linear_residual(double nu, pal_method method, const double a[9]) {
    pal_volumetric v = method.volumetric;
    pal_cloud c;
    box(&c, (const double[3]){1.0, 0.8, 0.6}, 5, 4, 3, 0.3);
    uint8_t *fixed = hold(&c, -1);
    pal_system s;
    build(&c, fixed, nu, method, &s);
    double mu = 0.5 / (1 + nu), bulk = 1 / (3 * (1 - 2 * nu)), trace = a[0] + a[4] + a[8];
    double *u = zeros((size_t)s.unknown_count), *r = zeros((size_t)s.unknown_count);
    for (int32_t k = 0; k < c.node_count; k++) {
        for (int i = 0; i < 3; i++) {
            double *x = c.position + 3 * k;
            u[3 * k + i] = a[3 * i] * x[0] + a[3 * i + 1] * x[1] + a[3 * i + 2] * x[2] + 0.3 * i;
        }
        if (v == PALPATE_VOLUMETRIC_MIXED) {
            u[3 * c.node_count + k] = bulk * trace * cbrt(c.volume[k]); // p is stored times V^(1/3)
        }
    }
    pal_sparse_multiply(&s.matrix, 1.0, u, r);
    double scale = (mu + bulk) * largest(a, 9);
    for (int32_t k = 0; k < c.node_count; k++) {
        for (int i = 0; i < 3; i++) {
            double t = 0.0;
            for (int j = 0; j < 3 && k < c.surface_count; j++) {
                double sigma =
                    mu * (a[3 * i + j] + a[3 * j + i]) + (i == j) * (bulk - 2 * mu / 3) * trace;
                t += sigma * c.area_vector[3 * k + j];
            }
            assert_near(r[3 * k + i], t, 1e-14 * scale); // rounding of ~200 terms of size h
        }
        if (v == PALPATE_VOLUMETRIC_MIXED) {
            assert_near(r[3 * c.node_count + k], 0.0, 1e-14 * scale);
        }
    }
    free(u);
    free(r);
    free(fixed);
    pal_system_clear(&s);
    pal_cloud_clear(&c);
}

static void linear_fields_and_rigid_motions_are_exact(void **state) {
    (void)state;
    const double stretch[9] = {0.3, -0.2, 0.5, 0.1, -0.4, 0.2, 0.6, 0.7, 0.25};
    const double rotation[9] = {0, -0.3, 0.2, 0.3, 0, -0.5, -0.2, 0.5, 0};
    for (int f = 0; f < FORM_COUNT; f++) {
        for (int k = 0; k < RATIO_COUNT; k++) {
            linear_residual(RATIOS[k], form(f), stretch);
            linear_residual(RATIOS[k], form(f), rotation);
        }
    }
}

/// The patch test as a solve: the surface moves with a linear field, the inside must follow.
static void patch_test_solved(void **state) {
    (void)state;
    const double a[9] = {0.3, -0.2, 0.5, 0.1, -0.4, 0.2, 0.6, 0.7, 0.25};
    for (int k = 0; k < RATIO_COUNT; k++) {
        pal_cloud c;
        box(&c, UNIT, 5, 5, 5, 0.3);
        uint8_t *fixed = hold(&c, 3);
        pal_system s;
        build(&c, fixed, RATIOS[k], method_of(PALPATE_VOLUMETRIC_MIXED, -1), &s);
        // the reaction rows are the coupling K_fixed,free; K is symmetric: right-hand side -K_cf^T
        // u_c
        double *b = zeros((size_t)s.unknown_count);
        for (int32_t j = 0; j < s.unknown_count; j++) {
            for (int64_t e = s.reaction.start[j]; e < s.reaction.start[j + 1]; e++) {
                int64_t row = s.reaction.row[e];
                const double *x = c.position + 3 * s.fixed_node[row / 3];
                const double *ai = a + 3 * (row % 3);
                b[j] -= s.reaction.value[e] * (ai[0] * x[0] + ai[1] * x[1] + ai[2] * x[2]);
            }
        }
        solve(&s.matrix, s.positive, 1, b);
        for (int32_t i = c.surface_count; i < c.node_count; i++) {
            const double *x = c.position + 3 * i;
            for (int j = 0; j < 3; j++) {
                double want = a[3 * j] * x[0] + a[3 * j + 1] * x[1] + a[3 * j + 2] * x[2];
                assert_near(b[s.dof_unknown[3 * i + j]], want, 1e-9); // issue 2
            }
        }
        free(b);
        free(fixed);
        pal_system_clear(&s);
        pal_cloud_clear(&c);
    }
}

/// ---- Compliance ----------------------------------------------------------------------------

/// C on all free surface dofs; *size its order.
static double *compliance(const pal_cloud *c, const pal_system *s, int32_t *size) {
    int32_t n = s->unknown_count, m = 0, *dof = malloc(3 * (size_t)c->surface_count * sizeof *dof);
    assert_non_null(dof);
    for (int32_t j = 0; j < 3 * c->surface_count; j++) {
        if (s->dof_unknown[j] >= 0) {
            dof[m++] = j;
        }
    }
    double *x = zeros((size_t)n * (size_t)m), *out = zeros((size_t)m * (size_t)m);
    for (int32_t j = 0; j < m; j++) {
        for (int64_t e = s->load.start[dof[j]]; e < s->load.start[dof[j] + 1]; e++) {
            x[s->load.row[e] + (int64_t)n * j] = s->load.value[e];
        }
    }
    solve(&s->matrix, s->positive, m, x);
    for (int32_t j = 0; j < m; j++) {
        for (int32_t i = 0; i < m; i++) {
            out[i + (int64_t)m * j] = x[s->dof_unknown[dof[i]] + (int64_t)n * j];
        }
    }
    free(x);
    free(dof);
    *size = m;
    return out;
}

static void compliance_is_reciprocal_and_positive(void **state) {
    (void)state;
    for (int v = 0; v < FORM_COUNT; v++) {
        for (int k = 0; k < RATIO_COUNT; k++) {
            pal_cloud c;
            box(&c, UNIT, 4, 4, 4, 0.3);
            uint8_t *fixed = hold(&c, 2);
            pal_system s;
            build(&c, fixed, RATIOS[k], form(v), &s);
            int32_t m;
            double *a = compliance(&c, &s, &m);
            double skew = 0.0, norm = 0.0;
            for (int64_t j = 0; j < m; j++) {
                for (int64_t i = 0; i < m; i++) {
                    skew += pow(a[i + m * j] - a[j + m * i], 2);
                    norm += pow(a[i + m * j], 2);
                }
            }
            // exact in exact arithmetic; eps x condition (1e4 x kappa/mu at most): issue 4 asks
            // 1e-8
            assert_true(sqrt(skew / norm) < 1e-10);
            double *w = zeros((size_t)m);
            assert_int_equal(LAPACKE_dsyev(LAPACK_COL_MAJOR, 'N', 'U', m, a, m, w), 0);
            // the softest mode of C is uniform pressure, 1 / kappa; anything far below would be a
            // hourglass (measured: 0.7 to 1.6 % of min(1, 1 / kappa) of the largest)
            assert_true(w[0] > 4e-3 * fmin(1, 3 * (1 - 2 * RATIOS[k])) * w[m - 1]);
            free(w);
            free(a);
            free(fixed);
            pal_system_clear(&s);
            pal_cloud_clear(&c);
        }
    }
}

/// Support reactions balance the load, forces and moments: rigid motions do no work.
static void reactions_balance_force_and_moment(void **state) {
    (void)state;
    pal_cloud c;
    box(&c, UNIT, 4, 4, 4, 0.3);
    uint8_t *fixed = hold(&c, 2);
    pal_system s;
    build(&c, fixed, 0.49, method_of(PALPATE_VOLUMETRIC_MIXED, -1), &s);
    int32_t node = -1;
    for (int32_t i = 0; i < c.surface_count && node < 0; i++) {
        node = c.position[3 * i + 2] > 0.99 && c.position[3 * i] > 0.4 ? i : -1;
    }
    assert_true(node >= 0);
    const double force[3] = {0.3, -0.7, 1.1}, *at = c.position + 3 * node;
    double *u = zeros((size_t)s.unknown_count), *r = zeros(3 * (size_t)s.fixed_count);
    for (int i = 0; i < 3; i++) {
        u[s.dof_unknown[3 * node + i]] = force[i];
    }
    solve(&s.matrix, s.positive, 1, u);
    pal_sparse_multiply(&s.reaction, 1.0, u, r);
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        double sum = force[i], moment = at[j] * force[k] - at[k] * force[j];
        for (int32_t f = 0; f < s.fixed_count; f++) {
            const double *x = c.position + 3 * s.fixed_node[f], *rf = r + 3 * f;
            sum += rf[i];
            moment += x[j] * rf[k] - x[k] * rf[j];
        }
        assert_near(sum, 0.0, 1e-11); // rounding of a solve with condition ~1e4
        assert_near(moment, 0.0, 1e-11);
    }
    free(u);
    free(r);
    free(fixed);
    pal_system_clear(&s);
    pal_cloud_clear(&c);
}

/// ---- Accuracy ------------------------------------------------------------------------------

/// Mean end deflection of a 5 x 1 x 1 cantilever under unit uniform end shear traction (E = 1).
static double tip(double nu, pal_volumetric v, int cells) {
    pal_cloud c;
    box(&c, (const double[3]){5, 1, 1}, 5 * cells, cells, cells, 0.2);
    uint8_t *fixed = hold(&c, 0);
    pal_system s;
    build(&c, fixed, nu, method_of(v, -1), &s);
    double *load = zeros((size_t)c.node_count), *u = zeros((size_t)s.unknown_count), mean = 0.0;
    for (int32_t t = 0; t < c.triangle_count; t++) {
        const int32_t *n = c.triangle + 3 * t;
        const double *a = c.position + 3 * n[0], *b = c.position + 3 * n[1],
                     *d = c.position + 3 * n[2];
        double area = 0.5 * ((b[1] - a[1]) * (d[2] - a[2]) - (b[2] - a[2]) * (d[1] - a[1]));
        for (int k = 0; k < 3 && a[0] > 4.99 && b[0] > 4.99 && d[0] > 4.99; k++) {
            load[n[k]] += area / 3;
        }
    }
    for (int32_t i = 0; i < c.surface_count; i++) {
        if (!fixed[i]) {
            u[s.dof_unknown[3 * i + 2]] = load[i];
        }
    }
    solve(&s.matrix, s.positive, 1, u);
    for (int32_t i = 0; i < c.surface_count; i++) {
        mean += fixed[i] ? 0.0 : load[i] * u[s.dof_unknown[3 * i + 2]];
    }
    free(load);
    free(u);
    free(fixed);
    pal_system_clear(&s);
    pal_cloud_clear(&c);
    return mean;
}

/// reference/cantilever.json in units of the height: 0.203524 m E / (100 Pa 0.04 m) = 508.81.
static void cantilever_converges_to_the_reference(void **state) {
    (void)state;
    const double reference = 0.203524 * 1e4 / (100 * 0.04);
    double coarse = fabs(tip(0.3, PALPATE_VOLUMETRIC_MIXED, 4) / reference - 1);
    double fine = fabs(tip(0.3, PALPATE_VOLUMETRIC_MIXED, 8) / reference - 1);
    assert_true(coarse < 0.03); // 525 nodes, 4 across the height: errors measured 2.0 and 0.6 %
    assert_true(fine < 0.01);   // 3321 nodes; issue 4 asks 2 %
    assert_true(coarse / fine > 2.5); // second order (4) within the scatter of two clouds
}

static void nearly_incompressible_bodies_do_not_lock(void **state) {
    (void)state;
    // A slender beam hardly cares about nu (3 % from 0.3 to 0.4999 on the finer cloud, through the
    // clamped end), so what 4 cells across lose against 8 is discretization error, locking
    // included.
    double relaxed = tip(0.3, PALPATE_VOLUMETRIC_MIXED, 4);
    double mixed = tip(0.4999, PALPATE_VOLUMETRIC_MIXED, 4);
    double fine = tip(0.4999, PALPATE_VOLUMETRIC_MIXED, 8);
    double plain = tip(0.4999, PALPATE_VOLUMETRIC_PLAIN, 4) / relaxed;
    assert_near(mixed / fine, 1.0, 0.02);
    assert_near(mixed / relaxed, 0.97, 0.03);
    assert_true(plain < 0.7); // the test can fail: without the pressures the beam locks
}

/// Wider trial functions converge to the same solution: the forms differ by discretization error
/// only.
static void wide_trial_functions_agree(void **state) {
    (void)state;
    double answer[2];
    for (int wide = 0; wide < 2; wide++) {
        pal_cloud c;
        box(&c, UNIT, 6, 6, 6, 0.2);
        uint8_t *fixed = hold(&c, 2);
        pal_system s;
        build(&c, fixed, 0.49, form(wide ? 3 : 2), &s);
        double *u = zeros((size_t)s.unknown_count), sum = 0.0;
        for (int32_t i = 0; i < c.surface_count; i++) {
            if (c.position[3 * i + 2] > 1 - 1e-9) {
                u[s.dof_unknown[3 * i]] = c.area[i];
            }
        }
        solve(&s.matrix, s.positive, 1, u);
        for (int32_t i = 0; i < c.surface_count; i++) {
            if (c.position[3 * i + 2] > 1 - 1e-9) {
                sum += c.area[i] * u[s.dof_unknown[3 * i]];
            }
        }
        answer[wide] = sum;
        free(u);
        free(fixed);
        pal_system_clear(&s);
        pal_cloud_clear(&c);
    }
    assert_true(answer[1] != answer[0]); // the option does something
    assert_near(answer[1] / answer[0], 1.0, 0.02);
}

/// ---- Stability -----------------------------------------------------------------------------

/// Numerical inf-sup of a cube held all round, n cells a side.
static pal_inf_sup inf_sup(int n, double stabilization) {
    pal_cloud c;
    box(&c, UNIT, n, n, n, 0.0);
    uint8_t *fixed = hold(&c, 3);
    pal_method m = method_of(PALPATE_VOLUMETRIC_MIXED, stabilization);
    pal_inf_sup out;
    pal_error e = {0};
    if (pal_galerkin_inf_sup(&c, fixed, &m, &out, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    free(fixed);
    pal_cloud_clear(&c);
    return out;
}

static void pressure_is_stable(void **state) {
    (void)state;
    pal_inf_sup four = inf_sup(4, -1), six = inf_sup(6, -1), bare = inf_sup(4, 0);
    print_message("inf-sup: %.3f, %.3f (4, 6 cells); unstabilised %.3f, %d modes unseen\n",
                  four.beta, six.beta, bare.beta, (int)bare.zero_modes);
    assert_int_equal(four.zero_modes, 1); // the constant: a clamped body has no mean divergence
    assert_int_equal(six.zero_modes, 1);
    assert_true(six.beta > 0.2);
    assert_true(six.beta > 0.85 * four.beta); // does not fall with refinement
    assert_true(bare.zero_modes > 1);         // the check sees the unstable pair
}

/// ---- Extreme bodies ------------------------------------------------------------------------

/// End compliance (direction z, far corner) of a box held at x = 0 or at three of its nodes there;
/// with `squeeze` > 0 one inner node is put that close to a neighbour, relative to their distance.
static double end_compliance(const double size[3], int nx, int ny, int nz, int three,
                             double squeeze) {
    pal_cloud c;
    pal_error e = {0};
    box(&c, size, nx, ny, nz, 0.0);
    if (squeeze > 0) {
        int32_t a = c.surface_count, b = -1;
        for (int32_t t = 0; t < c.tet_count && b < 0; t++) {
            for (int k = 0; k < 4; k++) {
                if (c.tet[4 * t + k] == a) {
                    b = c.tet[4 * t + (k + 1) % 4];
                }
            }
        }
        for (int i = 0; i < 3; i++) {
            double *x = c.position + 3 * a + i, y = c.position[3 * b + i];
            *x = y + squeeze * (*x - y);
        }
        pal_cloud again = {.length = c.length,
                           .node_count = c.node_count,
                           .surface_count = c.surface_count,
                           .triangle_count = c.triangle_count,
                           .tet_count = c.tet_count,
                           .position = c.position,
                           .triangle = c.triangle,
                           .tet = c.tet};
        c.position = NULL;
        c.triangle = c.tet = NULL;
        pal_cloud_clear(&c);
        assert_int_equal(pal_cloud_complete(&again, &e), PALPATE_OK);
        c = again;
    }
    uint8_t *fixed = hold(&c, three ? -1 : 0);
    int32_t far = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        const double *x = c.position + 3 * i;
        int y = x[1] > size[1] / 2, z = x[2] > size[2] / 2; // corners of x = 0 but one
        int corner = fabs(x[1] - y * size[1]) + fabs(x[2] - z * size[2]) < 1e-9 * size[0];
        fixed[i] |= three && corner && x[0] < 1e-9 * size[0] && !(y && z);
        far = corner && y && z && x[0] > (1 - 1e-9) * size[0] ? i : far;
    }
    pal_system s;
    build(&c, fixed, 0.49, method_of(PALPATE_VOLUMETRIC_MIXED, -1), &s);
    double *u = zeros((size_t)s.unknown_count);
    u[s.dof_unknown[3 * far + 2]] = 1.0;
    solve(&s.matrix, s.positive, 1, u);
    double out = u[s.dof_unknown[3 * far + 2]];
    free(u);
    free(fixed);
    pal_system_clear(&s);
    pal_cloud_clear(&c);
    return out;
}

static void extreme_bodies_give_sensible_answers(void **state) {
    (void)state;
    // needle: length 1, two cells across 0.02: beam theory L^3 / 3 I, measured 2.9 % soft
    double needle = end_compliance((const double[3]){1, 0.02, 0.02}, 100, 2, 2, 0, 0);
    print_message("needle / beam theory %.3f\n", needle / (1.0 / (3 * pow(0.02, 4) / 12)));
    assert_near(needle / (1.0 / (3 * pow(0.02, 4) / 12)), 1.0, 0.06);
    // plate, a corner pulled: between the clamped strip of its width and twice that (twist added)
    double plate = end_compliance((const double[3]){1, 1, 0.05}, 20, 20, 2, 0, 0);
    double strip = 1.0 / (3 * pow(0.05, 3) / 12);
    print_message("plate / strip %.3f\n", plate / strip);
    assert_true(plate > strip && plate < 4 * strip);
    // held at three nodes only: softer than held on the face, not singular
    double held = end_compliance(UNIT, 4, 4, 4, 0, 0), three = end_compliance(UNIT, 4, 4, 4, 1, 0);
    assert_true(three > held && three < 100 * held);
    // one inner node nearly on another: the answer hardly changes
    double squeezed = end_compliance(UNIT, 4, 4, 4, 0, 1e-6);
    print_message("squeezed / regular %.4f\n", squeezed / held);
    assert_near(squeezed / held, 1.0, 0.02);
}

/// ---- Scale, options, refusals --------------------------------------------------------------

static void answer_does_not_depend_on_scale(void **state) {
    (void)state;
    double at[3];
    const double scales[3] = {1.0, 1e-3, 1e3};
    for (int k = 0; k < 3; k++) {
        pal_cloud c;
        box(&c, (const double[3]){scales[k], scales[k], scales[k]}, 4, 4, 4, 0.2);
        uint8_t *fixed = calloc((size_t)c.node_count, 1);
        assert_non_null(fixed);
        int32_t node = 0;
        for (int32_t i = 0; i < c.surface_count; i++) {
            fixed[i] = c.position[3 * i + 2] < 1e-6 * scales[k];
            double *x = c.position + 3 * i;
            node = fabs(x[0] / scales[k] - 1) + fabs(x[1] / scales[k] - 1) +
                               fabs(x[2] / scales[k] - 1) <
                           1e-6
                       ? i
                       : node;
        }
        pal_system s;
        build(&c, fixed, 0.49, method_of(PALPATE_VOLUMETRIC_MIXED, -1), &s);
        double *u = zeros((size_t)s.unknown_count);
        u[s.dof_unknown[3 * node + 2]] = 1.0;
        solve(&s.matrix, s.positive, 1, u);
        at[k] = u[s.dof_unknown[3 * node + 2]] * scales[k]; // C ~ 1 / (E length)
        free(u);
        free(fixed);
        pal_system_clear(&s);
        pal_cloud_clear(&c);
    }
    assert_near(at[1] / at[0], 1.0, 1e-11);
    assert_near(at[2] / at[0], 1.0, 1e-11);
}

static int cancel(void *user, const char *stage, double fraction, double seconds_left) {
    (void)user;
    (void)stage;
    (void)fraction;
    (void)seconds_left;
    return 1;
}

static void bad_input_is_refused(void **state) {
    (void)state;
    pal_cloud c;
    box(&c, UNIT, 2, 2, 2, 0.0);
    uint8_t *fixed = hold(&c, 2);
    pal_method m = method_of(PALPATE_VOLUMETRIC_MIXED, -1);
    pal_system s;
    pal_error e = {0};
    assert_int_equal(pal_method_galerkin(&c, fixed, 0.5, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "0.5"));
    assert_int_equal(pal_method_galerkin(&c, fixed, NAN, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_method_galerkin(&c, fixed, -1.0, &m, NULL, &s, &e),
                     PALPATE_ERROR_ARGUMENT);
    m.basis = PALPATE_BASIS_QUADRATIC;
    assert_int_equal(pal_method_galerkin(&c, fixed, 0.3, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "quadratic"));
    m.basis = PALPATE_BASIS_LINEAR;
    m.neighbours = 3;
    assert_int_equal(pal_method_galerkin(&c, fixed, 0.3, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    m.neighbours = 0;
    pal_progress p = {cancel, NULL};
    assert_int_equal(pal_method_galerkin(&c, fixed, 0.3, &m, &p, &s, &e), PALPATE_ERROR_CANCELLED);
    int32_t t = c.tet[0];
    c.tet[0] = c.tet[1];
    c.tet[1] = t;
    assert_int_equal(pal_method_galerkin(&c, fixed, 0.3, &m, NULL, &s, &e), PALPATE_ERROR_CLOUD);
    assert_non_null(strstr(e.message, "tetrahedron 0"));
    c.tet[1] = c.tet[0];
    c.tet[0] = t;
    int32_t kept = c.tet_count; // the last cell's nodes lose a tetrahedron, a corner its only ones
    c.tet_count = 1;
    assert_int_equal(pal_method_galerkin(&c, fixed, 0.3, &m, NULL, &s, &e), PALPATE_ERROR_CLOUD);
    assert_non_null(strstr(e.message, "belongs to no cell"));
    c.tet_count = kept;
    free(fixed);
    pal_cloud_clear(&c);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(matrix_is_exactly_symmetric),
        cmocka_unit_test(linear_fields_and_rigid_motions_are_exact),
        cmocka_unit_test(patch_test_solved),
        cmocka_unit_test(compliance_is_reciprocal_and_positive),
        cmocka_unit_test(reactions_balance_force_and_moment),
        cmocka_unit_test(cantilever_converges_to_the_reference),
        cmocka_unit_test(nearly_incompressible_bodies_do_not_lock),
        cmocka_unit_test(wide_trial_functions_agree),
        cmocka_unit_test(pressure_is_stable),
        cmocka_unit_test(extreme_bodies_give_sensible_answers),
        cmocka_unit_test(answer_does_not_depend_on_scale),
        cmocka_unit_test(bad_input_is_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
