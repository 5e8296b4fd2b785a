/// pal_model_press and pal_model_skin on half-space models: Eqs. 52-53 by an independent LAPACK
/// solve, statics (moments, reciprocity of work), known contact mechanics, refusals.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include "haptic/model/model.h"
#include "tests/support/synthetic_model.h"

#include <palpate/engine.h>

static pal_model *build(synthetic_params p) {
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    return model;
}

static void check_against_lapack(pal_model *model, const char *name, int index) {
    static const double by[3] = {0.3e-3, -0.2e-3, -1e-3};
    pal_error error = {0};
    pal_press press;
    assert_int_equal(pal_model_press(model, name, by, &press, &error), PALPATE_OK);
    const pal_patch *patch = &model->patch[index];
    int m = patch->count, n = 3 * m, ld = 3 * model->info.column_count;
    assert_int_equal(press.patch_nodes, m);
    double *a = calloc((size_t)(n * n), sizeof *a), *f = calloc((size_t)n, sizeof *f);
    lapack_int *pivot = calloc((size_t)n, sizeof *pivot);
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++) {
            a[i + j * n] = model->c_tt[3 * patch->column[i / 3] + i % 3 +
                                       (3 * patch->column[j / 3] + j % 3) * ld];
        }
        f[j] = by[j % 3];
    }
    assert_int_equal(LAPACKE_dgesv(LAPACK_COL_MAJOR, n, 1, a, n, pivot, f, n), 0);
    // condition of these blocks is below 1e3, so both solutions agree to 1e3 n eps ~ 3e-11
    double force[3] = {0}, scale = 0;
    for (int i = 0; i < n; i++) {
        scale = fmax(scale, fabs(f[i]));
    }
    for (int i = 0; i < n; i++) {
        assert_true(fabs(press.node_force[i] - f[i]) < 1e-10 * scale);
        force[i % 3] += f[i];
    }
    double moment[3] = {0}, center[3] = {0};
    for (int i = 0; i < m; i++) {
        for (int c = 0; c < 3; c++) {
            center[c] += model->position[3 * model->column_node[patch->column[i]] + c] / m;
        }
    }
    for (int i = 0; i < m; i++) {
        const double *x = model->position + 3 * model->column_node[patch->column[i]];
        double d[3] = {x[0] - center[0], x[1] - center[1], x[2] - center[2]};
        moment[0] += d[1] * f[3 * i + 2] - d[2] * f[3 * i + 1];
        moment[1] += d[2] * f[3 * i] - d[0] * f[3 * i + 2];
        moment[2] += d[0] * f[3 * i + 1] - d[1] * f[3 * i];
    }
    for (int c = 0; c < 3; c++) {
        assert_true(fabs(press.force[c] - force[c]) < 1e-9 * scale * m);
        assert_true(fabs(press.moment[c] - moment[c]) < 1e-9 * scale * m * 0.01);
        assert_true(fabs(press.center[c] - center[c]) < 1e-16);
    }
    // rows that are patch nodes move by exactly what was asked, to the rows' precision
    double eps = model->info.precision == PALPATE_PRECISION_DOUBLE   ? 1e-12
                 : model->info.precision == PALPATE_PRECISION_SINGLE ? 1e-6
                                                                     : 5e-3;
    for (int r = 0; press.displacement != NULL && r < model->info.row_count; r++) {
        for (int i = 0; i < m; i++) {
            if (model->row_node[r] == model->column_node[patch->column[i]] &&
                model->info.certificate.symmetrized) {
                for (int c = 0; c < 3; c++) {
                    assert_true(fabs(press.displacement[3 * r + c] - by[c]) < eps * 1e-3);
                }
            }
        }
    }
    // probes: Eq. 53 with the Green function itself
    for (int k = 0; k < model->info.probe_count; k++) {
        double u[3] = {0};
        for (int i = 0; i < n; i++) {
            double g[3];
            synthetic_green(model->info.young, model->info.poisson, model->probe[k].position,
                            model->position + 3 * model->column_node[patch->column[i / 3]], i % 3,
                            4e-6, g);
            for (int c = 0; c < 3; c++) {
                u[c] += g[c] * f[i];
            }
        }
        for (int c = 0; c < 3; c++) {
            assert_true(fabs(press.probe[3 * k + c] - u[c]) < 1e-13);
        }
    }
    pal_press_clear(&press);
    assert_null(press.node_force);
    free(a), free(f), free(pivot);
}

static void forces_and_displacements_match_a_direct_solve(void **state) {
    (void)state;
    for (int precision = 0; precision < 4; precision++) {
        for (int skewed = 0; skewed < 2; skewed++) {
            synthetic_params p = synthetic_default_params();
            p.precision = (pal_precision)precision;
            p.skew = skewed ? 0.1 : 0;
            pal_model *model = build(p);
            check_against_lapack(model, "centre", 0);
            check_against_lapack(model, "all", 1);
            pal_model_free(model);
        }
    }
}

/// A force-only model has no rows: no displacement, everything else the same.
static void force_only_models_press(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    pal_model *with = build(p);
    p.rows = SYNTHETIC_ROWS_NONE;
    pal_model *without = build(p);
    double by[3] = {0, 0, -1e-3};
    pal_press a, b;
    assert_int_equal(pal_model_press(with, "centre", by, &a, NULL), PALPATE_OK);
    assert_int_equal(pal_model_press(without, "centre", by, &b, NULL), PALPATE_OK);
    assert_non_null(a.displacement);
    assert_null(b.displacement);
    assert_memory_equal(a.force, b.force, sizeof a.force);
    pal_press_clear(&a);
    pal_press_clear(&b);
    pal_model_free(with);
    pal_model_free(without);
}

/// Sign and size: pushing down needs a downward force on the body. A rigid flat punch on a half
/// space is the electrostatics of a charged plate: F = pi E/(1-nu^2) d C with C the plate's
/// capacitance as a length; for a square of side L, C = 0.36679 L (Read 1997), so F = 2.305 a E
/// d/(1-nu^2), a = L/2.
static void pushing_down_pushes_down(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    p.n = 16;
    p.rows = SYNTHETIC_ROWS_NONE;
    p.poisson = 0.499; // near incompressible: bonded and frictionless agree within a few per mille
    pal_model *model = build(p);
    double by[3] = {0, 0, -1e-3};
    pal_press press;
    assert_int_equal(pal_model_press(model, "all", by, &press, NULL), PALPATE_OK);
    // n nodes stand for n tributary squares: side n h; nodal forces on 16 x 16 cells come within 2
    // %
    double a = 16 * 0.002 / 2, expected = 2.305 * a * 10e3 * 1e-3 / (1 - 0.499 * 0.499);
    assert_true(press.force[2] < 0);
    assert_true(fabs(-press.force[2] - expected) < 0.02 * expected);
    assert_true(fabs(press.force[0]) < 1e-9 && fabs(press.force[1]) < 1e-9);
    assert_true(fabs(press.moment[0]) + fabs(press.moment[1]) + fabs(press.moment[2]) < 1e-10);
    pal_press_clear(&press);
    pal_model_free(model);
}

static void refusals_name_the_thing(void **state) {
    (void)state;
    pal_model *model = build(synthetic_default_params());
    double by[3] = {0, 0, -1e-3}, bad[3] = {0, (double)NAN, 0};
    pal_press press;
    pal_error error = {0};
    memset(&press, 1, sizeof press);
    assert_int_equal(pal_model_press(model, "center", by, &press, &error), PALPATE_ERROR_NOT_FOUND);
    assert_non_null(strstr(error.message, "\"center\""));
    assert_non_null(strstr(error.message, "centre, all"));
    assert_null(press.node_force);
    assert_int_equal(pal_model_press(model, "all", bad, &press, &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_model_press(NULL, "all", by, &press, &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_model_press(model, NULL, by, &press, &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_model_press(model, "all", by, NULL, &error), PALPATE_ERROR_ARGUMENT);
    // a zero row and column: neither positive nor regular
    int n = 3 * model->info.column_count;
    for (int i = 0; i < n; i++) {
        model->c_tt[i + 4 * n] = model->c_tt[4 + i * n] = 0;
    }
    assert_int_equal(pal_model_press(model, "all", by, &press, &error), PALPATE_ERROR_SINGULAR);
    assert_non_null(strstr(error.message, "unknown"));
    assert_null(press.node_force);
    // symmetric but indefinite (kept by certify: warn): LU answers
    model->c_tt[4 + 4 * n] = -0.01;
    assert_int_equal(pal_model_press(model, "all", by, &press, &error), PALPATE_OK);
    assert_true(isfinite(press.force[2]));
    pal_press_clear(&press);
    pal_press_clear(NULL);
    pal_model_free(model);
}

// ---- skin ---------------------------------------------------------------------------------------

static void skin_follows_the_rows(void **state) {
    (void)state;
    for (int skin = 0; skin < 2; skin++) {
        synthetic_params p = synthetic_default_params();
        p.skin = skin;
        pal_model *model = build(p);
        pal_model_info info;
        pal_model_get_info(model, &info);
        assert_int_equal(info.skin_count, skin ? 15 * 15 : info.surface_count);
        // u = A x + b is reproduced by any weights that reproduce linear functions (bilinear do)
        float *rows = calloc((size_t)info.row_count, 3 * sizeof *rows);
        float *u = calloc((size_t)info.skin_count, 3 * sizeof *u);
        float *n = calloc((size_t)info.skin_count, 3 * sizeof *n);
        for (int r = 0; r < info.row_count; r++) {
            const double *x = model->position + 3 * model->row_node[r];
            rows[3 * r] = (float)(0.1 * x[2]);
            rows[3 * r + 1] = (float)(0.2 * x[0] - 1e-3);
            rows[3 * r + 2] = (float)(0.5 * x[0]); // tilts the top by atan(0.5) about y
        }
        pal_frame frame = {.row_count = info.row_count, .displacement = rows};
        assert_int_equal(pal_model_skin(model, &frame, u, n), PALPATE_OK);
        int32_t triangles;
        const double *x = pal_model_skin_positions(model);
        assert_non_null(pal_model_skin_triangles(model, &triangles));
        assert_int_equal(triangles, skin ? 2 * 14 * 14 : info.triangle_count);
        int checked = 0;
        for (int i = 0; i < info.skin_count; i++) {
            int fixed = x[3 * i + 2] < -0.0039;
            assert_true(fabs((double)u[3 * i + 2] - (fixed ? 0 : 0.5 * x[3 * i])) < 1e-9);
            double length = sqrt((double)(n[3 * i] * n[3 * i] + n[3 * i + 1] * n[3 * i + 1] +
                                          n[3 * i + 2] * n[3 * i + 2]));
            assert_true(fabs(length - 1) < 1e-6);
            if (x[3 * i + 2] == 0 && fabs(x[3 * i]) < 0.0065 && fabs(x[3 * i + 1]) < 0.0065) {
                // the plane z = 0.5 x: normal (-0.5, 0, 1)/sqrt(1.25)
                assert_true(fabs((double)n[3 * i] + 0.5 / sqrt(1.25)) < 1e-4);
                assert_true(fabs((double)n[3 * i + 2] - 1 / sqrt(1.25)) < 1e-4);
                checked++;
            }
        }
        assert_true(checked >= 36);
        assert_int_equal(pal_model_skin(model, &frame, u, NULL), PALPATE_OK);
        frame.row_count--;
        assert_int_equal(pal_model_skin(model, &frame, u, n), PALPATE_ERROR_ARGUMENT);
        assert_int_equal(pal_model_skin(NULL, &frame, u, n), PALPATE_ERROR_ARGUMENT);
        assert_null(pal_model_skin_positions(NULL));
        assert_null(pal_model_skin_triangles(NULL, &triangles));
        assert_int_equal(triangles, 0);
        free(rows), free(u), free(n);
        pal_model_free(model);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(forces_and_displacements_match_a_direct_solve),
        cmocka_unit_test(force_only_models_press),
        cmocka_unit_test(pushing_down_pushes_down),
        cmocka_unit_test(refusals_name_the_thing),
        cmocka_unit_test(skin_follows_the_rows),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
