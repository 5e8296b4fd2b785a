/// Point collocation: patch test, linear stress, rigid motion, reactions, convergence, refusals.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/solution/factor.h"
#include "src/discretization/method_point.h"

/// ---- Fields: displacement, gradient g[c][i] = d_i u_c, second derivatives ------------------

typedef void (*field)(const double x[3], double u[3], double g[3][3], double h[3][3][3]);

static void linear_field(const double x[3], double u[3], double g[3][3], double h[3][3][3]) {
    static const double a[3] = {0.1, -0.2, 0.3};
    static const double m[3][3] = {{0.5, -0.3, 0.8}, {0.7, -0.4, 0.2}, {-0.6, 0.9, 0.35}};
    memset(h, 0, 27 * sizeof(double));
    for (int c = 0; c < 3; c++) {
        u[c] = a[c];
        for (int i = 0; i < 3; i++) {
            g[c][i] = m[c][i];
            u[c] += m[c][i] * x[i];
        }
    }
}

/// Vanishes on z = 0: what a model with u = 0 there can represent.
static void held_linear_field(const double x[3], double u[3], double g[3][3], double h[3][3][3]) {
    static const double a[3] = {0.4, -0.7, 0.5};
    memset(h, 0, 27 * sizeof(double));
    memset(g, 0, 9 * sizeof(double));
    for (int c = 0; c < 3; c++) {
        u[c] = a[c] * x[2];
        g[c][2] = a[c];
    }
}

/// A small rotation and a translation.
static void rigid_field(const double x[3], double u[3], double g[3][3], double h[3][3][3]) {
    static const double m[3][3] = {{0, -0.3, 0.8}, {0.3, 0, -0.5}, {-0.8, 0.5, 0}};
    memset(h, 0, 27 * sizeof(double));
    for (int c = 0; c < 3; c++) {
        u[c] = 0.1 + 0.2 * c;
        for (int i = 0; i < 3; i++) {
            g[c][i] = m[c][i];
            u[c] += m[c][i] * x[i];
        }
    }
}

static const double nu = 0.3;

/// Pure bending: sigma_zz = x (E = 1), all else zero; quadratic displacement.
static void bending_field(const double x[3], double u[3], double g[3][3], double h[3][3][3]) {
    memset(h, 0, 27 * sizeof(double));
    u[0] = -0.5 * (x[2] * x[2] + nu * (x[0] * x[0] - x[1] * x[1]));
    u[1] = -nu * x[0] * x[1];
    u[2] = x[0] * x[2];
    const double gradient[3][3] = {
        {-nu * x[0], nu * x[1], -x[2]}, {-nu * x[1], -nu * x[0], 0}, {x[2], 0, x[0]}};
    memcpy(g, gradient, sizeof gradient);
    h[0][2][2] = -1;
    h[0][0][0] = -nu;
    h[0][1][1] = nu;
    h[1][0][1] = h[1][1][0] = -nu;
    h[2][0][2] = h[2][2][0] = 1;
}

/// u_c = a_c z cos(k_c . x + b_c): smooth, zero on z = 0, needs a body force.
static void wave_field(const double x[3], double u[3], double g[3][3], double h[3][3][3]) {
    static const double a[3] = {1, -0.7, 0.8}, b[3] = {0.3, 1.1, -0.4};
    static const double k[3][3] = {{1.3, 0.7, -0.9}, {-0.6, 1.5, 0.8}, {0.9, -1.1, 1.2}};
    for (int c = 0; c < 3; c++) {
        double t = b[c] + k[c][0] * x[0] + k[c][1] * x[1] + k[c][2] * x[2];
        double co = a[c] * cos(t), si = a[c] * sin(t), z = x[2];
        u[c] = z * co;
        for (int i = 0; i < 3; i++) {
            g[c][i] = (i == 2) * co - z * k[c][i] * si;
            for (int j = 0; j < 3; j++) {
                h[c][i][j] =
                    -(i == 2) * k[c][j] * si - (j == 2) * k[c][i] * si - z * k[c][i] * k[c][j] * co;
            }
        }
    }
}

/// The gradient of a harmonic function: smooth, no body force, not zero anywhere in particular.
static void harmonic_field(const double x[3], double u[3], double g[3][3], double h[3][3][3]) {
    double d[3][4]; // derivatives of the three factors: 1.3^2 = 0.5^2 + 1.2^2
    for (int n = 0; n < 4; n++) {
        d[0][n] = pow(0.5, n) * cos(0.5 * x[0] + 0.3 + n * 1.5707963267948966);
        d[1][n] = pow(1.2, n) * cos(1.2 * x[1] - 0.2 + n * 1.5707963267948966);
        d[2][n] = pow(1.3, n) * exp(1.3 * x[2] - 1.0);
    }
    for (int c = 0; c < 3; c++) {
        int n[3] = {c == 0, c == 1, c == 2};
        u[c] = d[0][n[0]] * d[1][n[1]] * d[2][n[2]];
        for (int i = 0; i < 3; i++) {
            n[i]++;
            g[c][i] = d[0][n[0]] * d[1][n[1]] * d[2][n[2]];
            for (int j = 0; j < 3; j++) {
                n[j]++;
                h[c][i][j] = d[0][n[0]] * d[1][n[1]] * d[2][n[2]];
                n[j]--;
            }
            n[i]--;
        }
    }
}

static void stress(double g[3][3], double s[3][3]) {
    double mu = 0.5 / (1 + nu), lambda = nu / ((1 + nu) * (1 - 2 * nu));
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            s[i][j] = mu * (g[i][j] + g[j][i]) + (i == j) * lambda * (g[0][0] + g[1][1] + g[2][2]);
        }
    }
}

static double div_stress(double h[3][3][3], int c) {
    double mu = 0.5 / (1 + nu), lambda = nu / ((1 + nu) * (1 - 2 * nu)), sum = 0;
    for (int i = 0; i < 3; i++) {
        sum += mu * h[c][i][i] + (lambda + mu) * h[i][c][i];
    }
    return sum;
}

/// ---- A jittered box held at z = 0 ----------------------------------------------------------

typedef struct problem {
    pal_cloud cloud;
    uint8_t *fixed;
    pal_system system;
    pal_point_detail detail;
} problem;

static void make(problem *p, const int n[3], double jitter, uint64_t seed,
                 const pal_method *method) {
    const double size[3] = {n[0] * 1.0 / n[2], n[1] * 1.0 / n[2], 1.0};
    pal_error e = {0};
    assert_int_equal(pal_cloud_box(&p->cloud, size, n, jitter, seed, &e), PALPATE_OK);
    p->fixed = calloc((size_t)p->cloud.node_count, 1);
    for (int32_t i = 0; i < p->cloud.surface_count; i++) {
        p->fixed[i] = p->cloud.position[3 * i + 2] == 0.0;
    }
    pal_status status =
        pal_point_build(&p->cloud, p->fixed, nu, method, NULL, &p->system, &p->detail, &e);
    if (status != PALPATE_OK) {
        print_message("# %s\n", e.message);
    }
    assert_int_equal(status, PALPATE_OK);
}

static void drop(problem *p) {
    pal_point_detail_clear(&p->detail);
    pal_system_clear(&p->system);
    free(p->fixed);
    pal_cloud_clear(&p->cloud);
}

/// Nodal forces sigma S of a field at the free surface nodes (3 surface_count).
static double *nodal_forces(const problem *p, field f) {
    double *force = calloc(3 * (size_t)p->cloud.surface_count, sizeof *force);
    for (int32_t i = 0; i < p->cloud.surface_count; i++) {
        double u[3], g[3][3], h[3][3][3], s[3][3];
        f(p->cloud.position + 3 * i, u, g, h);
        stress(g, s);
        for (int c = 0; c < 3 && !p->fixed[i]; c++) {
            for (int d = 0; d < 3; d++) {
                force[3 * i + c] += s[c][d] * p->cloud.area_vector[3 * i + d];
            }
        }
    }
    return force;
}

/// x -= (columns of the fixed dofs) u.
static void move_supports(const problem *p, field f, double *x) {
    double *u = calloc(3 * (size_t)p->system.fixed_count + 1, sizeof *u);
    for (int32_t i = 0; i < p->system.fixed_count; i++) {
        double g[3][3], h[3][3][3];
        f(p->cloud.position + 3 * p->system.fixed_node[i], u + 3 * i, g, h);
    }
    pal_sparse_multiply(&p->detail.held, -1.0, u, x);
    free(u);
}

static void solve(const problem *p, int32_t count, double *x) {
    pal_factor *factor;
    pal_error e = {0};
    assert_int_equal(pal_factor_create(&p->system.matrix, 0, NULL, &factor, NULL, &e), PALPATE_OK);
    pal_factor_workspace *w = pal_factor_workspace_new(factor);
    assert_int_equal(pal_factor_solve(factor, w, count, x, &e), PALPATE_OK);
    pal_factor_workspace_free(w);
    pal_factor_free(factor);
}

/// Relative error (root mean square and largest over largest) of the nodal displacements.
static void errors(const problem *p, field f, const double *x, double *rms, double *worst) {
    double off = 0, all = 0, most = 0, size = 0;
    for (int32_t i = 0; i < p->cloud.node_count; i++) {
        double u[3], g[3][3], h[3][3][3];
        f(p->cloud.position + 3 * i, u, g, h);
        for (int c = 0; c < 3; c++) {
            int32_t k = p->system.dof_unknown[3 * i + c];
            double d = k < 0 ? 0.0 : x[k] - u[c];
            off += d * d;
            all += u[c] * u[c];
            most = fmax(most, fabs(d));
            size = fmax(size, fabs(u[c]));
        }
    }
    *rms = sqrt(off / all);
    *worst = most / size;
}

/// Solve for a field from its nodal forces and supports; worst error.
static double reproduce(const problem *p, field f) {
    double *x = calloc((size_t)p->system.unknown_count, sizeof *x);
    double *force = nodal_forces(p, f);
    pal_sparse_multiply(&p->system.load, 1.0, force, x);
    move_supports(p, f, x);
    solve(p, 1, x);
    double rms, worst;
    errors(p, f, x, &rms, &worst);
    free(force);
    free(x);
    return worst;
}

/// ---- Tests ---------------------------------------------------------------------------------

static void linear_and_bending_states_pass_to_rounding(void **state) {
    (void)state;
    static const int boxes[2][3] = {{5, 4, 4}, {3, 7, 4}};
    double worst = 0.0, bending = 0.0;
    for (int basis = 1; basis <= 3; basis++) {
        for (int mode = 0; mode < 4; mode++) {
            if (basis == 1 && mode % 2 == 1) {
                continue; // a linear basis has no diffuse second derivative: nothing to solve
            }
            pal_method m = {.basis = (pal_basis)basis,
                            .derivatives = (pal_derivatives)(mode % 2),
                            .fictitious = mode / 2};
            problem p;
            make(&p, boxes[mode % 2], 0.25, 11, &m);
            worst = fmax(worst, reproduce(&p, linear_field));
            worst = fmax(worst, reproduce(&p, held_linear_field));
            worst = fmax(worst, reproduce(&p, rigid_field));
            if (basis > 1) { // stress linear in x, six faces, twelve sharp edges
                bending = fmax(bending, reproduce(&p, bending_field));
            }
            drop(&p);
        }
    }
    print_message("# worst error: linear field %.1e, bending %.1e\n", worst, bending);
    // rounding times the condition of small, badly jittered systems (up to about 1e6)
    assert_true(worst < 1e-9);
    assert_true(bending < 1e-9);
}

static void plates_and_needles_pass_or_are_refused_with_the_place(void **state) {
    (void)state;
    // one cell through the thickness: z^2 cannot be told from z without nodes outside
    const double sizes[2][3] = {{1, 1, 0.05}, {0.05, 0.05, 1}};
    const int cells[2][3] = {{12, 12, 1}, {1, 1, 16}};
    for (int shape = 0; shape < 2; shape++) {
        for (int fictitious = 0; fictitious < 2; fictitious++) {
            problem p = {0};
            pal_error e = {0};
            pal_method m = {.basis = PALPATE_BASIS_QUADRATIC, .fictitious = fictitious};
            assert_int_equal(pal_cloud_box(&p.cloud, sizes[shape], cells[shape], 0.0, 1, &e),
                             PALPATE_OK);
            p.fixed = calloc((size_t)p.cloud.node_count, 1);
            for (int32_t i = 0; i < p.cloud.surface_count; i++) {
                p.fixed[i] = p.cloud.position[3 * i + 2 - 2 * (shape == 0)] == 0.0;
            }
            pal_status status =
                pal_point_build(&p.cloud, p.fixed, nu, &m, NULL, &p.system, &p.detail, &e);
            if (!fictitious) {
                assert_int_equal(status, PALPATE_ERROR_STENCIL);
                assert_non_null(strstr(e.message, "rank"));
                assert_non_null(strstr(e.message, "node 0"));
            } else {
                assert_int_equal(status, PALPATE_OK);
                // the needle's bending is (20)^4 softer than its stretching, and its stencils
                // (condition 5e6) leave 1e-12 in the entries
                double tolerance = shape == 0 ? 1e-9 : 1e-5;
                assert_true(reproduce(&p, linear_field) < tolerance);
                assert_true(reproduce(&p, rigid_field) < tolerance);
            }
            drop(&p);
        }
    }
}

static void nearly_coincident_nodes_do_no_harm(void **state) {
    (void)state;
    pal_method m = {.basis = PALPATE_BASIS_QUADRATIC, .fictitious = 1};
    const double size[3] = {1, 1, 1};
    const int n[3] = {6, 6, 6};
    problem p = {0};
    pal_error e = {0};
    assert_int_equal(pal_cloud_box(&p.cloud, size, n, 0.2, 3, &e), PALPATE_OK);
    // two inner nodes 1e-6 spacings apart
    int32_t a = p.cloud.surface_count + 60;
    memcpy(p.cloud.position + 3 * (a + 1), p.cloud.position + 3 * a, 3 * sizeof(double));
    p.cloud.position[3 * a + 4] += 1e-6 / 6;
    p.fixed = calloc((size_t)p.cloud.node_count, 1);
    for (int32_t i = 0; i < p.cloud.surface_count; i++) {
        p.fixed[i] = p.cloud.position[3 * i + 2] == 0.0;
    }
    assert_int_equal(pal_point_build(&p.cloud, p.fixed, nu, &m, NULL, &p.system, &p.detail, &e),
                     PALPATE_OK);
    double linear = reproduce(&p, linear_field), bending = reproduce(&p, bending_field);
    print_message("# nearly coincident nodes: linear %.1e, bending %.1e\n", linear, bending);
    // second differences over 1e-6 of the spacing carry 1e-16 / 1e-12 in those nodes' rows
    assert_true(linear < 1e-4);
    assert_true(bending < 1e-4);
    drop(&p);
}

static void diffuse_linear_is_refused(void **state) {
    (void)state;
    pal_method m = {.basis = PALPATE_BASIS_LINEAR, .derivatives = PALPATE_DERIVATIVES_DIFFUSE};
    pal_cloud cloud;
    pal_error e = {0};
    const double size[3] = {1, 1, 1};
    const int n[3] = {3, 3, 3};
    assert_int_equal(pal_cloud_box(&cloud, size, n, 0.1, 1, &e), PALPATE_OK);
    uint8_t *fixed = calloc((size_t)cloud.node_count, 1);
    fixed[0] = 1;
    pal_system s;
    assert_int_equal(pal_method_point(&cloud, fixed, nu, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "diffuse"));
    free(fixed);
    pal_cloud_clear(&cloud);
}

static void rigid_motion_needs_no_force_and_supports_react(void **state) {
    (void)state;
    for (int fictitious = 0; fictitious < 2; fictitious++) {
        pal_method m = {.basis = PALPATE_BASIS_QUADRATIC, .fictitious = fictitious};
        problem p;
        make(&p, (const int[3]){5, 5, 5}, 0.25, 3, &m);
        int32_t n = p.system.unknown_count;
        double *x = calloc((size_t)n, sizeof *x), *r = calloc((size_t)n, sizeof *r);
        // the rigid field's unknowns by its own solve: the fictitious nodes follow it too
        move_supports(&p, rigid_field, x);
        memcpy(r, x, (size_t)n * sizeof *r); // K u = -held u: no nodal force on the right
        solve(&p, 1, x);
        double rms, worst;
        errors(&p, rigid_field, x, &rms, &worst);
        assert_true(worst < 1e-10);
        pal_sparse_multiply(&p.system.matrix, -1.0, x, r);
        for (int32_t i = 0; i < n; i++) {
            assert_true(fabs(r[i]) < 1e-12); // rows are scaled to one
        }
        // uniform stress: every fixed node's reaction is sigma S, so the total balances the load
        memset(x, 0, (size_t)n * sizeof *x);
        double *force = nodal_forces(&p, held_linear_field);
        pal_sparse_multiply(&p.system.load, 1.0, force, x);
        solve(&p, 1, x);
        int32_t fixed = p.system.fixed_count;
        double *reaction = calloc(3 * (size_t)fixed, sizeof *reaction);
        pal_sparse_multiply(&p.system.reaction, 1.0, x, reaction);
        double u[3], g[3][3], h[3][3][3], s[3][3], total[3] = {0}, size = 0;
        held_linear_field(p.cloud.position, u, g, h);
        stress(g, s);
        for (int32_t i = 0; i < fixed; i++) {
            const double *a = p.cloud.area_vector + 3 * p.system.fixed_node[i];
            for (int c = 0; c < 3; c++) {
                double want = s[c][0] * a[0] + s[c][1] * a[1] + s[c][2] * a[2];
                assert_true(fabs(reaction[3 * i + c] - want) < 1e-10);
                total[c] += reaction[3 * i + c];
            }
        }
        for (int32_t i = 0; i < 3 * p.cloud.surface_count; i++) {
            total[i % 3] += force[i];
            size += fabs(force[i]);
        }
        for (int c = 0; c < 3; c++) {
            assert_true(fabs(total[c]) < 1e-10 * size);
        }
        free(reaction);
        free(force);
        free(x);
        free(r);
        drop(&p);
    }
}

/// Right-hand side of a field from its own differential operator, row by row.
static void operator_side(const problem *p, field f, double *b) {
    for (int32_t r = 0; r < p->system.unknown_count; r++) {
        const pal_point_row *row = p->detail.rows + r;
        double u[3], g[3][3], h[3][3][3], s[3][3];
        f(p->cloud.position + 3 * row->node, u, g, h);
        stress(g, s);
        const double *n = p->cloud.normal + 3 * row->node;
        const double *t = s[row->component];
        b[r] = row->scale * (row->kind == PALPATE_ROW_BALANCE
                                 ? div_stress(h, row->component)
                                 : t[0] * n[0] + t[1] * n[1] + t[2] * n[2]);
    }
    move_supports(p, f, b);
}

/// Slope of log error over log spacing, least squares.
static double order_of(const int *n, const double *error, int count) {
    double sx = 0, sy = 0, sxx = 0, sxy = 0;
    for (int i = 0; i < count; i++) {
        double x = -log(n[i]), y = log(error[i]);
        sx += x;
        sy += y;
        sxx += x * x;
        sxy += x * y;
    }
    return (count * sxy - sx * sy) / (count * sxx - sx * sx);
}

static void quadratic_with_fictitious_nodes_converges_in_second_order(void **state) {
    (void)state;
    static const int cells[4] = {6, 8, 10, 13}; // N = 343, 729, 1331, 2744
    double wave[4], harmonic[4], linear[4];
    for (int i = 0; i < 4; i++) {
        const int n[3] = {cells[i], cells[i], cells[i]};
        for (int basis = 1; basis <= 2; basis++) {
            pal_method m = {.basis = (pal_basis)basis, .fictitious = basis == 2};
            problem p;
            make(&p, n, 0.2, 1, &m);
            assert_int_equal(p.system.stencils.grown, 0);
            size_t unknowns = (size_t)p.system.unknown_count;
            double *x = calloc(2 * unknowns, sizeof *x), worst;
            operator_side(&p, wave_field, x);
            operator_side(&p, harmonic_field, x + unknowns);
            solve(&p, 2, x);
            errors(&p, wave_field, x, &wave[i], &worst);
            errors(&p, harmonic_field, x + unknowns, basis == 1 ? &linear[i] : &harmonic[i],
                   &worst);
            free(x);
            drop(&p);
        }
        print_message("# N %5d: quadratic, body force %.2e, none %.2e; linear, none %.2e\n",
                      (cells[i] + 1) * (cells[i] + 1) * (cells[i] + 1), wave[i], harmonic[i],
                      linear[i]);
    }
    // the jitter is drawn anew at every size, which scatters single errors by a third or so: the
    // order is that of the fitted line
    assert_true(order_of(cells, wave, 4) > 1.8);
    assert_true(order_of(cells, harmonic, 4) > 1.8);
    assert_true(wave[3] < 7e-3 && harmonic[0] < 7e-3 && harmonic[3] < 1.2e-3);
    // a linear basis' second derivatives are inconsistent: it does not converge (design section 2)
    assert_true(linear[3] > 0.1);
}

static int cancel_late(void *user, const char *stage, double fraction, double left) {
    (void)left;
    int *calls = user;
    assert_string_equal(stage, "assemble");
    assert_true(fraction >= 0.0 && fraction <= 1.0);
    return ++*calls > 1;
}

static void refusals_are_clear_and_leave_nothing(void **state) {
    (void)state;
    pal_cloud cloud;
    pal_error e = {0};
    const double size[3] = {1, 1, 1};
    const int n[3] = {7, 7, 7};
    assert_int_equal(pal_cloud_box(&cloud, size, n, 0.2, 5, &e), PALPATE_OK);
    uint8_t *fixed = calloc((size_t)cloud.node_count, 1);
    fixed[0] = fixed[1] = fixed[9] = 1;
    pal_method m = {.basis = PALPATE_BASIS_QUADRATIC};
    pal_system s;
    assert_int_equal(pal_method_point(&cloud, fixed, 0.5, &m, NULL, &s, &e),
                     PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "0.5"));
    assert_int_equal(pal_method_point(&cloud, fixed, NAN, &m, NULL, &s, &e),
                     PALPATE_ERROR_ARGUMENT);
    int calls = 0;
    pal_progress progress = {cancel_late, &calls};
    assert_int_equal(pal_method_point(&cloud, fixed, nu, &m, &progress, &s, &e),
                     PALPATE_ERROR_CANCELLED);
    assert_int_equal(calls, 2);
    assert_null(s.matrix.value);
    assert_null(s.dof_unknown);
    // two nodes in one place
    memcpy(cloud.position + 3 * 300, cloud.position + 3 * 301, 3 * sizeof(double));
    assert_int_equal(pal_method_point(&cloud, fixed, nu, &m, NULL, &s, &e), PALPATE_ERROR_STENCIL);
    assert_non_null(strstr(e.message, "300"));
    assert_null(s.matrix.value);
    free(fixed);
    pal_cloud_clear(&cloud);
}

static void assembly_repeats_to_the_last_bit(void **state) {
    (void)state;
    pal_method m = {.basis = PALPATE_BASIS_QUADRATIC, .fictitious = 1};
    problem p, q;
    make(&p, (const int[3]){6, 5, 5}, 0.2, 9, &m);
    make(&q, (const int[3]){6, 5, 5}, 0.2, 9, &m);
    int64_t count = p.system.matrix.start[p.system.matrix.columns];
    assert_memory_equal(p.system.matrix.value, q.system.matrix.value,
                        (size_t)count * sizeof(double));
    assert_memory_equal(p.system.matrix.row, q.system.matrix.row, (size_t)count * sizeof(int64_t));
    assert_string_equal(p.system.options, "basis=quadratic, derivatives=full, neighbours=60, "
                                          "exponent=2, fictitious=yes");
    assert_int_equal(p.system.stencils.count, p.cloud.node_count);
    assert_true(p.system.stencils.worst_condition > 1.0);
    // the contract's load: a unit nodal force on a free node is one over its area vector's length
    int32_t node = 0;
    while (p.fixed[node]) {
        node++;
    }
    int64_t at = p.system.load.start[3 * node + 1];
    assert_int_equal(p.system.load.start[3 * node + 2] - at, 1);
    const double *a = p.cloud.area_vector + 3 * node;
    double scale = p.detail.rows[p.system.load.row[at]].scale;
    assert_true(
        fabs(p.system.load.value[at] / scale * sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]) -
             1.0) < 1e-14);
    drop(&p);
    drop(&q);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(linear_and_bending_states_pass_to_rounding),
        cmocka_unit_test(plates_and_needles_pass_or_are_refused_with_the_place),
        cmocka_unit_test(nearly_coincident_nodes_do_no_harm),
        cmocka_unit_test(diffuse_linear_is_refused),
        cmocka_unit_test(rigid_motion_needs_no_force_and_supports_react),
        cmocka_unit_test(quadratic_with_fictitious_nodes_converges_in_second_order),
        cmocka_unit_test(refusals_are_clear_and_leave_nothing),
        cmocka_unit_test(assembly_repeats_to_the_last_bit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
