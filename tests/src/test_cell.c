/// The cell method: exactness on linear fields, conservation, positivity, order of convergence.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include "src/discretization/cell_faces.h"
#include "src/discretization/discretization.h"
#include "tests/support/cell_rig.h"

static const double UNIT[3] = {1, 1, 1};
static const pal_method SYMMETRIC = {
    .kind = PALPATE_METHOD_CELL, .volumetric = PALPATE_VOLUMETRIC_PATCH, .stabilization = -1};
static const pal_method NODAL = {
    .kind = PALPATE_METHOD_CELL, .volumetric = PALPATE_VOLUMETRIC_NODAL, .stabilization = -1};
static const pal_method COLLOCATED = {.kind = PALPATE_METHOD_CELL,
                                      .volumetric = PALPATE_VOLUMETRIC_NODAL,
                                      .form = PALPATE_CELL_COLLOCATED,
                                      .stabilization = -1};

/// f = K u of a system that holds no node.
static void apply(const pal_system *s, const double *u, double *f) {
    memset(f, 0, (size_t)s->unknown_count * sizeof *f);
    pal_sparse_multiply(&s->matrix, 1, u, f);
}

// ---- Cells -----------------------------------------------------------------------------------

static void walls_close_every_cell_and_share_the_volume(void **state) {
    (void)state;
    pal_cloud c;
    pal_cell_faces f;
    pal_error e = {0};
    rig_box(&c, UNIT, 4, 5, 3, 0.25);
    assert_int_equal(pal_cell_faces_create(&c, &f, &e), PALPATE_OK);
    double *sum = rig_zeros(3 * (size_t)c.node_count), volume = 0;
    for (int32_t p = 0; p < f.pair_count; p++) {
        const int32_t *ends = &f.pair[2 * p];
        assert_true(ends[0] < ends[1]);
        double along = 0;
        for (int d = 0; d < 3; d++) {
            sum[3 * ends[0] + d] += f.wall[3 * p + d];
            sum[3 * ends[1] + d] -= f.wall[3 * p + d];
            along +=
                f.wall[3 * p + d] * (c.position[3 * ends[1] + d] - c.position[3 * ends[0] + d]);
        }
        // S . e / 3 is the pair's share of volume, whatever the shapes
        assert_true(fabs(along / 3 - f.volume[p]) < 1e-15);
        volume += f.volume[p];
    }
    assert_true(fabs(volume - 1) < 1e-13);
    // walls and the surface's thirds close every cell
    for (int32_t i = 0; i < c.node_count; i++) {
        for (int d = 0; d < 3; d++) {
            double s = sum[3 * i + d] + (i < c.surface_count ? c.area_vector[3 * i + d] : 0);
            assert_true(fabs(s) < 1e-15 * 10);
        }
    }
    free(sum);
    pal_cell_faces_clear(&f);
    pal_cloud_clear(&c);
}

// ---- Linear fields -----------------------------------------------------------------------------

/// With no node held, K u of a linear field must equal sigma . area_vector at every node: edges and
/// corners, all Poisson's ratios.
static void operator_is_exact_on_linear_fields(void **state) {
    (void)state;
    const double g[3][3] = {{0.3, -0.2, 0.5}, {0.1, 0.4, -0.6}, {0.7, 0.2, -0.1}};
    const pal_method *methods[3] = {&SYMMETRIC, &NODAL, &COLLOCATED};
    const double nus[] = {-0.5, 0.0, 0.3, 0.49, 0.4999};
    pal_cloud c;
    rig_box(&c, UNIT, 5, 4, 6, 0.25);
    size_t n = 3 * (size_t)c.node_count;
    uint8_t *fixed = rig_flags(c.node_count);
    double *u = rig_zeros(n), *f = rig_zeros(n);
    for (int m = 0; m < 3; m++) {
        for (int k = 0; k < 5; k++) {
            double sigma[3][3], stiff = 1 / (1 - 2 * nus[k]);
            rig_stress(nus[k], g, sigma);
            pal_system s;
            rig_build(&c, fixed, nus[k], methods[m], &s);
            assert_int_equal(s.unknown_count, (int)n);
            for (size_t i = 0; i < n; i++) {
                const double *x = &c.position[3 * (i / 3)], *row = g[i % 3];
                u[i] = 0.5 + row[0] * x[0] + row[1] * x[1] + row[2] * x[2];
            }
            apply(&s, u, f);
            for (size_t i = 0; i < n; i++) {
                double want = 0;
                for (size_t d = 0; d < 3 && i < 3 * (size_t)c.surface_count; d++) {
                    want += sigma[i % 3][d] * c.area_vector[3 * (i / 3) + d];
                }
                // forces are sums of a few hundred terms of size `stiff`
                assert_true(fabs(f[i] - want) < 1e-13 * stiff);
            }
            pal_system_clear(&s);
        }
    }
    free(u);
    free(f);
    free(fixed);
    pal_cloud_clear(&c);
}

/// Patch test through a solve: z = 0 held, and a linear field that vanishes there (shear and
/// stretch along z), loaded by sigma . area_vector on all free surface nodes: mixed supports.
static void solved_patch_test(void **state) {
    (void)state;
    const double g[3][3] = {{0, 0, 0.5}, {0, 0, -0.3}, {0, 0, -0.2}};
    const pal_method *methods[3] = {&SYMMETRIC, &NODAL, &COLLOCATED};
    pal_cloud c;
    rig_box(&c, UNIT, 5, 5, 5, 0.25);
    uint8_t *fixed = rig_flags(c.node_count);
    for (int32_t i = 0; i < c.surface_count; i++) {
        fixed[i] = c.position[3 * i + 2] < 1e-9;
    }
    for (int m = 0; m < 3; m++) {
        // issue 2; rounding times the condition number is 1e-12
        assert_true(rig_patch_error(&c, fixed, 0.3, methods[m], g) < 1e-9);
        assert_true(rig_patch_error(&c, fixed, 0.45, methods[m], g) < 1e-9);
    }
    free(fixed);
    pal_cloud_clear(&c);
}

static void rigid_motion_gives_no_force(void **state) {
    (void)state;
    const pal_method *methods[3] = {&SYMMETRIC, &NODAL, &COLLOCATED};
    pal_cloud c;
    rig_box(&c, UNIT, 4, 4, 4, 0.3);
    size_t n = 3 * (size_t)c.node_count;
    uint8_t *fixed = rig_flags(c.node_count);
    double *u = rig_zeros(n), *f = rig_zeros(n);
    for (int m = 0; m < 3; m++) {
        pal_system s;
        rig_build(&c, fixed, 0.4, methods[m], &s);
        for (int mode = 0; mode < 6; mode++) {
            for (int32_t i = 0; i < c.node_count; i++) {
                const double *x = &c.position[3 * i];
                int a = mode % 3, b = (a + 1) % 3;
                u[3 * i] = u[3 * i + 1] = u[3 * i + 2] = 0;
                if (mode < 3) {
                    u[3 * i + mode] = 1;
                } else {
                    u[3 * i + a] = -x[b];
                    u[3 * i + b] = x[a];
                }
            }
            apply(&s, u, f);
            for (size_t i = 0; i < n; i++) {
                assert_true(fabs(f[i]) < 1e-13);
            }
        }
        pal_system_clear(&s);
    }
    free(u);
    free(f);
    free(fixed);
    pal_cloud_clear(&c);
}

// ---- Conservation ------------------------------------------------------------------------------

static void supports_balance_any_load_exactly(void **state) {
    (void)state;
    const pal_method *methods[3] = {&SYMMETRIC, &NODAL, &COLLOCATED};
    pal_cloud c;
    rig_box(&c, (const double[3]){1, 0.5, 0.5}, 6, 4, 4, 0.2);
    uint8_t *fixed = rig_flags(c.node_count);
    for (int32_t i = 0; i < c.surface_count; i++) {
        fixed[i] = c.position[3 * i] < 1e-9;
    }
    for (int m = 0; m < 3; m++) {
        pal_system s;
        rig_build(&c, fixed, 0.45, methods[m], &s);
        double *load = rig_zeros((size_t)s.load.columns), *x = rig_zeros((size_t)s.unknown_count);
        double *support = rig_zeros(3 * (size_t)s.fixed_count), total[3] = {0, 0, 0};
        for (int64_t j = 0; j < s.load.columns; j++) {
            if (s.dof_unknown[j] >= 0) {
                load[j] = sin(1.0 + 7.0 * (double)j); // uneven, no symmetry
                total[j % 3] += load[j];
            }
        }
        pal_sparse_multiply(&s.load, 1, load, x);
        rig_solve(&s, x);
        pal_sparse_multiply(&s.reaction, 1, x, support);
        for (int32_t i = 0; i < 3 * s.fixed_count; i++) {
            total[i % 3] += support[i];
        }
        for (int d = 0; d < 3; d++) {
            assert_true(fabs(total[d]) < 1e-9); // the loads are of size 1; solve residual 1e-12
        }
        if (methods[m] != &COLLOCATED) { // the energy form conserves moments too
            double moment[3] = {0, 0, 0};
            for (int32_t i = 0; i < c.surface_count; i++) {
                double f[3];
                for (int d = 0; d < 3; d++) {
                    f[d] = load[3 * i + d];
                }
                for (int32_t k = 0; k < s.fixed_count; k++) {
                    for (int d = 0; d < 3 && s.fixed_node[k] == i; d++) {
                        f[d] += support[3 * k + d];
                    }
                }
                for (int d = 0; d < 3; d++) {
                    int a = (d + 1) % 3, b = (d + 2) % 3;
                    moment[d] += c.position[3 * i + a] * f[b] - c.position[3 * i + b] * f[a];
                }
            }
            assert_true(fabs(moment[0]) + fabs(moment[1]) + fabs(moment[2]) < 1e-9);
        }
        free(load);
        free(x);
        free(support);
        pal_system_clear(&s);
    }
    free(fixed);
    pal_cloud_clear(&c);
}

// ---- Bending: a linear stress state with sharp edges -----------------------------------------

/// Pure bending of a box about y: sigma_xx = -z' / (h/2), all else zero (z' from mid height).
/// u_x = -x z', u_z = (x^2 + nu (z'^2 - y'^2)) / 2, u_y = nu y' z'. Loaded by consistent nodal
/// forces on x = 1 (integral of hat times sigma); x = 0 is held in the exact field's values.
/// @return root mean square error of the displacement over its root mean square
static double bending_error(const pal_method *method, double nu, int n) {
    pal_cloud c;
    rig_box(&c, UNIT, n, n, n, 0.2);
    uint8_t *fixed = rig_flags(c.node_count);
    // the system holds x = 0 at u = 0: bring the exact values in by superposition
    for (int32_t i = 0; i < c.surface_count; i++) {
        fixed[i] = c.position[3 * i] < 1e-9;
    }
    pal_system s, all;
    uint8_t *none = rig_flags(c.node_count);
    rig_build(&c, none, nu, method, &all);
    rig_build(&c, fixed, nu, method, &s);
    size_t size = 3 * (size_t)c.node_count;
    double *exact = rig_zeros(size), *lift = rig_zeros(size), *force = rig_zeros(size);
    for (int32_t i = 0; i < c.node_count; i++) {
        double x = c.position[3 * i], y = c.position[3 * i + 1] - 0.5,
               z = c.position[3 * i + 2] - 0.5;
        exact[3 * i] = -x * z;
        exact[3 * i + 1] = nu * y * z;
        exact[3 * i + 2] = 0.5 * (x * x + nu * (z * z - y * y));
        for (int d = 0; d < 3 && fixed[i]; d++) {
            lift[3 * i + d] = exact[3 * i + d];
        }
    }
    // traction -z on x = 1: over each triangle, integral of hat_a (-z) = area/12 (sum z + z_a)
    for (int32_t t = 0; t < c.triangle_count; t++) {
        const int32_t *v = &c.triangle[3 * t];
        double a[3], b[3], z = 0;
        int at_end = 1;
        for (int k = 0; k < 3; k++) {
            at_end = at_end && c.position[3 * v[k]] > 1 - 1e-9;
            z += c.position[3 * v[k] + 2] - 0.5;
            a[k] = c.position[3 * v[1] + k] - c.position[3 * v[0] + k];
            b[k] = c.position[3 * v[2] + k] - c.position[3 * v[0] + k];
        }
        double area = 0.5 * fabs(a[1] * b[2] - a[2] * b[1]);
        for (int k = 0; k < 3 && at_end; k++) {
            force[3 * v[k]] -= area / 12 * (z + c.position[3 * v[k] + 2] - 0.5);
        }
    }
    pal_sparse_multiply(&all.matrix, -1, lift, force);
    double *x = rig_zeros((size_t)s.unknown_count), error = 0, norm = 0;
    for (size_t i = 0; i < size; i++) {
        if (s.dof_unknown[i] >= 0) {
            x[s.dof_unknown[i]] = force[i];
        }
    }
    rig_solve(&s, x);
    for (size_t i = 0; i < size; i++) {
        double d = s.dof_unknown[i] >= 0 ? x[s.dof_unknown[i]] - exact[i] : 0;
        error += d * d * c.volume[i / 3];
        norm += exact[i] * exact[i] * c.volume[i / 3];
    }
    free(x);
    free(exact);
    free(lift);
    free(force);
    free(none);
    free(fixed);
    pal_system_clear(&s);
    pal_system_clear(&all);
    pal_cloud_clear(&c);
    return sqrt(error / norm);
}

static void bending_converges_at_second_order(void **state) {
    (void)state;
    // measured at 10 cells a side, in the order below: 0.59, 0.57, 0.59 %; 0.59, 0.71 %; 1.5, 1.7
    // %. Orders 1.9 to 2.3: below 1.7 something has become inconsistent.
    static const struct {
        const pal_method *method;
        const char *name;
        double nu, allowed;
    } cases[] = {{&SYMMETRIC, "patch", 0.3, 0.008},       {&SYMMETRIC, "patch", 0.49, 0.008},
                 {&SYMMETRIC, "patch", 0.4999, 0.008},    {&NODAL, "nodal", 0.3, 0.009},
                 {&NODAL, "nodal", 0.49, 0.011},          {&COLLOCATED, "collocated", 0.3, 0.022},
                 {&COLLOCATED, "collocated", 0.49, 0.025}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        double coarse = bending_error(cases[k].method, cases[k].nu, 5);
        double fine = bending_error(cases[k].method, cases[k].nu, 10);
        print_message("# %s bending nu %g: %.3e %.3e order %.2f\n", cases[k].name, cases[k].nu,
                      coarse, fine, log2(coarse / fine));
        assert_true(log2(coarse / fine) > 1.7);
        assert_true(fine < cases[k].allowed);
    }
}

// ---- Symmetry and positivity -----------------------------------------------------------------

static void symmetric_form_is_symmetric_to_the_bit_and_positive(void **state) {
    (void)state;
    const double nus[] = {-0.5, 0.0, 0.3, 0.45, 0.49, 0.499, 0.4999};
    pal_cloud c;
    rig_box(&c, UNIT, 5, 5, 5, 0.3);
    uint8_t *fixed = rig_flags(c.node_count);
    for (int32_t i = 0; i < c.surface_count; i++) {
        fixed[i] = c.position[3 * i + 2] < 1e-9;
    }
    for (int k = 0; k < 7; k++) {
        pal_system s;
        rig_build(&c, fixed, nus[k], &SYMMETRIC, &s);
        assert_true(s.symmetric && s.positive);
        const pal_sparse *a = &s.matrix;
        double *dense = rig_zeros((size_t)(a->rows * a->rows));
        for (int64_t j = 0; j < a->columns; j++) {
            for (int64_t e = a->start[j]; e < a->start[j + 1]; e++) {
                assert_true(e == a->start[j] || a->row[e] > a->row[e - 1]);
                dense[a->row[e] + a->rows * j] = a->value[e];
            }
        }
        for (int64_t j = 0; j < a->columns; j++) {
            for (int64_t i = 0; i < j; i++) {
                assert_true(dense[i + a->rows * j] == dense[j + a->rows * i]);
            }
        }
        // Cholesky exists: positive definite, so every compliance block is too
        assert_int_equal(LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', (int)a->rows, dense, (int)a->rows),
                         0);
        free(dense);
        pal_system_clear(&s);
    }
    free(fixed);
    pal_cloud_clear(&c);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(walls_close_every_cell_and_share_the_volume),
        cmocka_unit_test(operator_is_exact_on_linear_fields),
        cmocka_unit_test(solved_patch_test),
        cmocka_unit_test(rigid_motion_gives_no_force),
        cmocka_unit_test(supports_balance_any_load_exactly),
        cmocka_unit_test(bending_converges_at_second_order),
        cmocka_unit_test(symmetric_form_is_symmetric_to_the_bit_and_positive),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
