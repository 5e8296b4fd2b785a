/// The model in memory: the synthetic builder's physics, storage precision, checks, accessors.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/base/dense.h"
#include "haptic/model/model.h"
#include "tests/support/synthetic_model.h"

static pal_model *build(synthetic_params p) {
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    pal_error error = {0};
    pal_status status = pal_model_check(model, &error);
    if (status != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    return model;
}

/// Hertz's integral: a unit force spread evenly over the disc of radius a displaces its mean by
/// 16 (1 - nu^2) / (3 pi^2 E a), and far away a point force displaces the surface by
/// (1 - nu^2)/(pi E r) (Johnson, Contact Mechanics, 3.2 and 3.4).
static void green_functions_have_johnsons_values(void **state) {
    (void)state;
    double E = 2e3, nu = 0.3, area = 4e-6, u[3], zero[3] = {0, 0, 0}, x[3] = {0.03, 0.04, 0};
    double a = sqrt(area / 3.14159265358979323846);
    synthetic_green(E, nu, zero, zero, 2, area, u);
    double expected = 16 * (1 - nu * nu) / (3 * 9.869604401089358 * E * a);
    assert_true(fabs(u[2] - expected) < 1e-12 * expected);
    assert_true(u[0] == 0 && u[1] == 0);
    synthetic_green(E, nu, x, zero, 2, area, u);
    expected = (1 - nu * nu) / (3.14159265358979323846 * E * 0.05);
    assert_true(fabs(u[2] - expected) < 1e-12 * expected);
    // Navier's equation inside: (1/(1-2nu)) grad div u + lap u = 0, by central differences (h =
    // 1e-4 of the distance: truncation 1e-8, rounding 1e-16/1e-8 = 1e-8 of u/r^2; 1e-5 is loose)
    for (int direction = 0; direction < 3; direction++) {
        double y[3] = {0.01, -0.02, -0.03}, h = 1e-4, lap[3] = {0, 0, 0}, grad_div[3] = {0, 0, 0};
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) {
                double value[4][3];
                for (int k = 0; k < 4; k++) {
                    double z[3] = {y[0], y[1], y[2]};
                    z[i] += k & 1 ? h : -h;
                    z[j] += k & 2 ? h : -h;
                    synthetic_green(E, nu, z, zero, direction, area, value[k]);
                }
                // d_i d_j u_j, mixed central difference (i == j: step 2h)
                grad_div[i] +=
                    (value[3][j] - value[2][j] - value[1][j] + value[0][j]) / (4 * h * h);
                if (i == j) {
                    for (int c = 0; c < 3; c++) {
                        lap[c] +=
                            (value[3][c] - value[2][c] - value[1][c] + value[0][c]) / (4 * h * h);
                    }
                }
            }
        }
        synthetic_green(E, nu, y, zero, direction, area, u);
        double scale = sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]) / 1.4e-3;
        for (int c = 0; c < 3; c++) {
            assert_true(fabs(grad_div[c] / (1 - 2 * nu) + lap[c]) < 1e-3 * scale);
        }
    }
}

static void synthetic_models_are_physical(void **state) {
    (void)state;
    static const double poisson[] = {0.0, 0.3, 0.45, 0.499};
    for (int k = 0; k < 4; k++) {
        synthetic_params p = synthetic_default_params();
        p.poisson = poisson[k];
        pal_model *model = build(p);
        pal_model_info info;
        pal_model_get_info(model, &info);
        assert_int_equal(info.column_count, 36);
        assert_int_equal(info.node_count, 8 * 8 * 3);
        assert_int_equal(info.surface_count, 8 * 8 * 3 - 36);
        assert_true(info.certificate.pass && info.certificate.passive);
        assert_true(info.certificate.min_eigenvalue > 0);
        assert_true(info.certificate.reciprocity == 0);
        // closed surface: area vectors sum to zero, and V = sum x . A / 3 over nodes of flat faces
        double sum[3] = {0, 0, 0};
        for (int i = 0; i < info.surface_count; i++) {
            for (int c = 0; c < 3; c++) {
                sum[c] += model->area_vector[3 * i + c];
            }
        }
        assert_true(fabs(sum[0]) + fabs(sum[1]) + fabs(sum[2]) < 1e-18);
        for (int t = 0; t < info.column_count; t++) {
            assert_true(pal_model_normals(model)[3 * pal_model_columns(model)[t] + 2] == 1);
        }
        // rows of column nodes agree with C_TT to single precision
        double column[3 * 8 * 8 * 3];
        for (int dof = 0; dof < 3 * info.column_count; dof++) {
            assert_int_equal(pal_model_load_column(model, dof, column), PALPATE_OK);
            for (int t = 0; t < info.column_count; t++) {
                for (int r = 0; r < info.row_count; r++) {
                    if (pal_model_rows(model)[r] == pal_model_columns(model)[t]) {
                        for (int c = 0; c < 3; c++) {
                            double exact = model->c_tt[3 * t + c + dof * 3 * info.column_count];
                            assert_true(fabs(column[3 * r + c] - exact) <= 1.2e-7 * fabs(exact));
                        }
                    }
                }
            }
        }
        pal_model_free(model);
    }
}

static void skew_models_have_the_skew_asked_for(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    p.skew = 0.1;
    pal_model *model = build(p);
    assert_true(fabs(model->info.certificate.reciprocity - 0.1) <
                0.002); // |C + skew|^2 = |C|^2 (1 + 0.05^2)
    assert_false(model->info.certificate.passive);
    assert_false(model->info.certificate.symmetrized);
    pal_model_free(model);
    p.n = 1;
    assert_null(synthetic_model(&p));
}

// ---- half ---------------------------------------------------------------------------------------

/// Reference: nearest of the two neighbouring halves by exact comparison of doubles, ties to even.
static uint16_t nearest_half(double x) {
    uint16_t sign = signbit(x) ? 0x8000 : 0;
    double a = fabs(x);
    if (a >= 65520) {
        return sign | 0x7C00;
    }
    int low = 0, high = 0x7C00; // largest half <= a
    while (high - low > 1) {
        int middle = (low + high) / 2;
        if ((double)pal_half_to_float((uint16_t)middle) <= a) {
            low = middle;
        } else {
            high = middle;
        }
    }
    double below = (double)pal_half_to_float((uint16_t)low);
    double above = low == 0x7BFF ? 65536 : (double)pal_half_to_float((uint16_t)(low + 1));
    double to_below = a - below, to_above = above - a; // exact: all multiples of 2^-24 or close by
    int up = to_above < to_below || (to_above == to_below && (low & 1));
    return (uint16_t)(sign | (low + up));
}

static void halves_load_exactly_and_round_once(void **state) {
    (void)state;
    // values by definition: (-1)^s 2^(e-15) (1 + f/1024), subnormal 2^-14 f/1024
    for (uint32_t h = 0; h < 65536; h++) {
        uint32_t e = (h >> 10) & 31, f = h & 1023;
        float x = pal_half_to_float((uint16_t)h);
        assert_int_equal(signbit(x) != 0, h >> 15);
        if (e == 31) {
            assert_true(f == 0 ? isinf(x) : isnan(x));
            assert_int_equal(pal_half_from_double((double)x) & 0xFC00, h & 0xFC00);
            continue;
        }
        double value = e == 0 ? ldexp(f, -24) : ldexp(1024 + f, (int)e - 25);
        assert_true(fabs((double)x) == value);
        assert_int_equal(pal_half_from_double((double)x), h);
        // just around, and exactly on, the midpoint to the next one
        double step = e == 0 ? ldexp(1, -24) : ldexp(1, (int)e - 25), sign = h >> 15 ? -1 : 1;
        double middle = sign * (value + step / 2);
        assert_int_equal(pal_half_from_double(middle), nearest_half(middle));
        assert_int_equal(pal_half_from_double(nextafter(middle, 0)), h);
        assert_int_equal(pal_half_from_double(nextafter(middle, sign * (double)INFINITY)), h + 1);
    }
    uint64_t seed = 7;
    for (int i = 0; i < 20000; i++) {
        seed = seed * 6364136223846793005u + 1442695040888963407u;
        double x = ldexp((double)(int64_t)seed / 9.2e18, (int)(seed >> 5) % 24 - 16);
        assert_int_equal(pal_half_from_double(x), nearest_half(x));
    }
    assert_int_equal(pal_half_from_double(5e-324), 0);
    assert_int_equal(pal_half_from_double(-ldexp(1, -25)), 0x8000);
    assert_int_equal(pal_half_from_double(1e300), 0x7C00);
}

static void vector_conversion_agrees_with_software(void **state) {
    (void)state;
    uint16_t *half = malloc(65536 * sizeof *half);
    double *out = malloc(65536 * sizeof *out);
    for (int h = 0; h < 65536; h++) {
        half[h] = (uint16_t)h;
    }
    for (int offset = 0; offset < 9; offset++) { // odd starts and tails
        int count = 65536 - 2 * offset;
        pal_precision_load(PALPATE_PRECISION_HALF, half + offset, count, out);
        for (int i = 0; i < count; i++) {
            double expected = (double)pal_half_to_float(half[offset + i]);
            assert_memory_equal(&out[i], &expected, sizeof expected);
        }
    }
    free(half);
    free(out);
}

static void precisions_store_and_refuse_overflow(void **state) {
    (void)state;
    double in[3] = {1.0 / 3, -2e-3, 0}, out[3];
    char raw[24];
    assert_int_equal(pal_precision_store(PALPATE_PRECISION_DOUBLE, in, 3, raw), PALPATE_OK);
    pal_precision_load(PALPATE_PRECISION_DOUBLE, raw, 3, out);
    assert_memory_equal(in, out, sizeof in);
    assert_int_equal(pal_precision_store(PALPATE_PRECISION_SINGLE, in, 3, raw), PALPATE_OK);
    pal_precision_load(PALPATE_PRECISION_SINGLE, raw, 3, out);
    assert_true(out[0] == (double)(float)in[0]);
    in[2] = 1e39;
    assert_int_equal(pal_precision_store(PALPATE_PRECISION_SINGLE, in, 3, raw),
                     PALPATE_ERROR_ARGUMENT);
    in[2] = 65519.99;
    assert_int_equal(pal_precision_store(PALPATE_PRECISION_HALF, in, 3, raw), PALPATE_OK);
    in[2] = 65520;
    assert_int_equal(pal_precision_store(PALPATE_PRECISION_HALF, in, 3, raw),
                     PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_precision_store((pal_precision)9, in, 3, raw), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_precision_size((pal_precision)9), 0);
}

/// Half keeps eleven significant bits of every entry within 2^-27 of the largest, whatever the
/// body's stiffness: the scale brings the largest to 2^13..2^14, and 2^-14 is the smallest normal.
static void half_rows_are_scaled_to_the_body(void **state) {
    (void)state;
    static const double young[] = {1e-3, 1e3, 1e6, 1e12};
    for (int k = 0; k < 4; k++) {
        synthetic_params p = synthetic_default_params();
        p.precision = PALPATE_PRECISION_HALF;
        p.young = young[k];
        pal_model *model = build(p);
        int n = 3 * model->info.column_count, rows = 3 * model->info.row_count;
        double *column = malloc(sizeof *column * (size_t)rows), u[3];
        for (int dof = 0; dof < n; dof++) {
            assert_int_equal(pal_model_load_column(model, dof, column), PALPATE_OK);
            for (int r = 0; r < rows / 3; r++) {
                synthetic_green(p.young, p.poisson, model->position + 3 * model->row_node[r],
                                model->position + 3 * model->column_node[dof / 3], dof % 3,
                                p.spacing * p.spacing, u);
                for (int c = 0; c < 3; c++) {
                    double floor_ = ldexp(model->row_scale, -25); // half of the subnormal step
                    assert_true(fabs(column[3 * r + c] - u[c]) <=
                                fmax(fabs(u[c]) * ldexp(1, -11), floor_));
                }
            }
        }
        assert_int_equal(pal_model_store_column(model, 3 * model->info.column_count, column),
                         PALPATE_ERROR_ARGUMENT);
        assert_int_equal(pal_model_load_column(model, -1, column), PALPATE_ERROR_ARGUMENT);
        column[0] = INFINITY;
        column[1] = 1e30 * model->row_scale;
        assert_int_equal(pal_model_store_column(model, 0, column), PALPATE_ERROR_ARGUMENT);
        free(column);
        pal_model_free(model);
    }
}

/// Scaled rows are within half a step, 2^-16 of the column's largest entry, whatever the body's
/// stiffness; a column of zeros, of one number, of subnormals, of numbers that are none.
static void scaled_rows_are_within_half_a_step(void **state) {
    (void)state;
    static const double young[] = {1e-3, 1e3, 1e12};
    for (int k = 0; k < 3; k++) {
        synthetic_params p = synthetic_default_params();
        p.young = young[k];
        p.precision = PALPATE_PRECISION_DOUBLE;
        pal_model *exact = build(p);
        p.precision = PALPATE_PRECISION_SCALED;
        pal_model *model = build(p);
        int n = 3 * model->info.column_count, rows = 3 * model->info.row_count;
        double *a = malloc(sizeof *a * (size_t)rows), *b = malloc(sizeof *b * (size_t)rows);
        for (int dof = 0; dof < n; dof++) {
            double largest = 0;
            assert_int_equal(pal_model_load_column(exact, dof, a), PALPATE_OK);
            assert_int_equal(pal_model_load_column(model, dof, b), PALPATE_OK);
            for (int r = 0; r < rows; r++) {
                largest = fmax(largest, fabs(a[r]));
            }
            for (int r = 0; r < rows; r++) {
                // 1e-12: the division by the scale and the product with it are rounded
                assert_true(fabs(a[r] - b[r]) <= 0.5 * (1 + 1e-10) * largest / PALPATE_SCALED_MAX);
            }
        }
        memset(a, 0, sizeof *a * (size_t)rows);
        static const double lone[] = {0, -3e-5, 1e-320, 1e300};
        for (int i = 0; i < 4; i++) {
            a[2] = lone[i];
            assert_int_equal(pal_model_store_column(model, 1, a), PALPATE_OK);
            assert_int_equal(pal_model_load_column(model, 1, b), PALPATE_OK);
            assert_int_equal(pal_model_check(model, NULL), PALPATE_OK);
            double want = fabs(lone[i]) < 1e-300 ? 0 : lone[i]; // below the normal range: 0
            for (int r = 0; r < rows; r++) {
                assert_true(fabs(b[r] - (r == 2 ? want : 0)) <= 1e-15 * fabs(want));
            }
        }
        a[2] = NAN;
        assert_int_equal(pal_model_store_column(model, 1, a), PALPATE_ERROR_ARGUMENT);
        a[2] = INFINITY;
        assert_int_equal(pal_model_store_column(model, 1, a), PALPATE_ERROR_ARGUMENT);
        free(a);
        free(b);
        pal_model_free(exact);
        pal_model_free(model);
    }
}

// ---- check --------------------------------------------------------------------------------------

#define REFUSED(change, undo)                                                                      \
    do {                                                                                           \
        pal_error error = {0};                                                                     \
        change;                                                                                    \
        assert_int_equal(pal_model_check(m, &error), PALPATE_ERROR_ARGUMENT);                      \
        assert_true(strlen(error.message) > 10);                                                   \
        assert_int_equal(pal_model_check(m, NULL), PALPATE_ERROR_ARGUMENT);                        \
        undo;                                                                                      \
        assert_int_equal(pal_model_check(m, &error), PALPATE_OK);                                  \
    } while (0)

/// Change one value, expect refusal, put it back.
#define REFUSED_VALUE(place, value)                                                                \
    do {                                                                                           \
        __auto_type old_ = (place);                                                                \
        REFUSED((place) = (value), (place) = old_);                                                \
    } while (0)

static void check_finds_every_kind_of_damage(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    p.skin = 1;
    pal_model *m = build(p);
    assert_true(m->row_ld > 3 * m->info.row_count); // so that there is padding to check
    assert_int_equal(pal_model_check(NULL, NULL), PALPATE_ERROR_ARGUMENT);
    REFUSED_VALUE(m->info.node_count, 0);
    REFUSED_VALUE(m->info.node_count, INT32_MAX);
    REFUSED_VALUE(m->info.surface_count, m->info.node_count + 1);
    REFUSED_VALUE(m->info.triangle_count, -1);
    REFUSED_VALUE(m->info.touchable_count, 35);
    REFUSED_VALUE(m->info.column_count, m->info.surface_count + 1);
    REFUSED_VALUE(m->info.column_count, 35);
    REFUSED_VALUE(m->info.row_count, -1);
    REFUSED_VALUE(m->info.row_count, 1);
    REFUSED_VALUE(m->info.fixed_count, 0);
    REFUSED_VALUE(m->info.patch_count, -1);
    REFUSED_VALUE(m->info.probe_count, -1);
    REFUSED_VALUE(m->info.skin_count, -1);
    REFUSED_VALUE(m->info.precision, (pal_precision)4);
    REFUSED_VALUE(m->info.young, NAN);
    REFUSED_VALUE(m->info.bounds_max[2], INFINITY);
    REFUSED_VALUE(m->info.seconds.factor, NAN);
    REFUSED_VALUE(m->info.certificate.rcond, NAN);
    REFUSED_VALUE(m->info.hash[0], 'x');
    REFUSED(memset(m->info.hash, 'a', 65), memset(m->info.hash, 0, 65));
    REFUSED(memset(m->info.method, 'a', 32), memset(m->info.method, 0, 32));
    REFUSED_VALUE(m->runtime.tool_count, 9);
    REFUSED_VALUE(m->runtime.max_contacts, -1);
    REFUSED_VALUE(m->runtime.field_by, (pal_field_by)2);
    REFUSED_VALUE(m->runtime.contact_law, (pal_contact_kind)2);
    REFUSED_VALUE(m->runtime.contact_points, 65);
    REFUSED_VALUE(m->runtime.servo_rate, NAN);
    REFUSED_VALUE(m->runtime.tools[0].name[0], 0);
    REFUSED_VALUE(m->runtime.tools[0].shape, (pal_shape_kind)7);
    REFUSED_VALUE(m->runtime.tools[0].device.kind, (pal_device_kind)7);
    REFUSED_VALUE(m->runtime.tools[0].device.stroke.kind, (pal_stroke_kind)7);
    REFUSED_VALUE(m->runtime.tools[0].radius, -1);
    REFUSED_VALUE(m->runtime.tools[0].axis[1], NAN);
    REFUSED_VALUE(m->position[5], NAN);
    REFUSED_VALUE(m->normal[7], 0.5);
    REFUSED_VALUE(m->area_vector[1], INFINITY);
    REFUSED_VALUE(m->triangle[4], m->info.surface_count);
    REFUSED_VALUE(m->triangle[4], -1);
    REFUSED_VALUE(m->node_flags[m->column_node[0]], PALPATE_NODE_FIXED);
    REFUSED_VALUE(m->node_flags[m->column_node[0]], 4);
    REFUSED_VALUE(m->node_flags[m->info.node_count - 1], PALPATE_NODE_TOUCHABLE);
    REFUSED_VALUE(m->column_node[1], m->column_node[0]);
    REFUSED_VALUE(m->column_node[35], m->info.surface_count);
    REFUSED_VALUE(m->column_node[0], 0); // not touchable: a touchable node lost its columns
    REFUSED_VALUE(m->row_node[1], m->row_node[0]);
    REFUSED_VALUE(m->row_node[m->info.row_count - 1], m->info.node_count);
    REFUSED_VALUE(m->c_tt[12], NAN);
    REFUSED_VALUE(m->c_tt[12], m->c_tt[12] * 1.5);
    REFUSED_VALUE(((float *)m->c_st)[100], NAN);
    REFUSED_VALUE(((float *)m->c_st)[m->row_ld - 1], 1.0f); // padding
    REFUSED_VALUE(m->row_ld, m->row_ld + 1);
    REFUSED_VALUE(m->row_ld, 16);
    REFUSED_VALUE(m->row_scale, 3.0);
    REFUSED_VALUE(m->row_scale, 0.0);
    REFUSED_VALUE(m->row_scale, NAN);
    REFUSED_VALUE(m->probe_row[3], NAN);
    REFUSED_VALUE(m->patch[0].name[0], 0);
    REFUSED_VALUE(m->patch[0].count, 0);
    REFUSED_VALUE(m->patch[0].column[0], 36);
    REFUSED_VALUE(m->probe[1].name[0], 0);
    REFUSED_VALUE(m->probe[1].position[0], NAN);
    REFUSED_VALUE(m->skin_position[2], NAN);
    REFUSED_VALUE(m->skin_triangle[0], m->info.skin_count);
    REFUSED_VALUE(m->skin_triangle_count, -1);
    REFUSED_VALUE(m->skin_twin[0], m->info.skin_count);
    REFUSED_VALUE(m->skin_twin[0], -1);
    m->skin_twin[2] = 1;
    REFUSED_VALUE(m->skin_twin[1], 0);
    m->skin_twin[2] = 2;
    REFUSED_VALUE(m->skin_row[0], m->info.row_count);
    REFUSED_VALUE(m->skin_row[0], -2);
    REFUSED_VALUE(m->skin_weight[0], NAN);
    REFUSED_VALUE(m->position, NULL);
    REFUSED_VALUE(m->triangle, NULL);
    REFUSED_VALUE(m->node_flags, NULL);
    REFUSED_VALUE(m->c_st, NULL);
    REFUSED_VALUE(m->patch, NULL);
    REFUSED_VALUE(m->skin_row, NULL);
    pal_model_free(m);

    p.precision = PALPATE_PRECISION_SCALED;
    m = build(p);
    REFUSED_VALUE(m->column_scale, NULL);
    REFUSED_VALUE(m->column_scale[5], 0.0);
    REFUSED_VALUE(m->column_scale[5], -1.0);
    REFUSED_VALUE(m->column_scale[5], NAN);
    REFUSED_VALUE(((int16_t *)m->c_st)[m->row_ld - 1], 1);    // padding
    REFUSED_VALUE(m->info.precision, PALPATE_PRECISION_HALF); // as many bytes, but no scales
    pal_model_free(m);
}

static void accessors_answer_and_survive_nonsense(void **state) {
    (void)state;
    pal_model *m = build(synthetic_default_params());
    const int32_t *columns;
    int32_t count;
    double x[3];
    assert_string_equal(pal_model_patch(m, 0, &columns, &count), "centre");
    assert_ptr_equal(columns, m->patch[0].column);
    assert_int_equal(count, 12); // (+-1, +-1)/2 and (+-3, +-1)/2, (+-1, +-3)/2 spacings
    assert_string_equal(pal_model_patch(m, 1, NULL, NULL), "all");
    assert_null(pal_model_patch(m, 2, &columns, &count));
    assert_null(columns);
    assert_int_equal(count, 0);
    assert_null(pal_model_patch(m, -1, NULL, NULL));
    assert_string_equal(pal_model_probe(m, 0, x), "deep");
    assert_true(x[2] == m->probe[0].position[2]);
    assert_null(pal_model_probe(m, 2, x));
    assert_ptr_equal(pal_model_positions(m), m->position);
    assert_ptr_equal(pal_model_triangles(m), m->triangle);
    assert_ptr_equal(pal_model_compliance(m), m->c_tt);
    assert_ptr_equal(pal_model_runtime(m), &m->runtime);
    assert_null(pal_model_positions(NULL));
    assert_null(pal_model_normals(NULL));
    assert_null(pal_model_triangles(NULL));
    assert_null(pal_model_rows(NULL));
    assert_null(pal_model_columns(NULL));
    assert_null(pal_model_compliance(NULL));
    assert_null(pal_model_runtime(NULL));
    pal_model_info info;
    memset(&info, 1, sizeof info);
    pal_model_get_info(NULL, &info);
    assert_int_equal(info.node_count, 0);
    pal_model_get_info(m, NULL);
    pal_model_free(NULL);

    pal_error error = {0};
    m->info.row_count = -1;
    assert_int_equal(pal_model_alloc_rows(m, &error), PALPATE_ERROR_ARGUMENT);
    m->info.row_count = m->info.column_count = PALPATE_COUNT_MAX; // 3.6e16 bytes
    assert_int_equal(pal_model_alloc_rows(m, &error), PALPATE_ERROR_MEMORY);
    m->info.row_count = 0;
    assert_int_equal(pal_model_alloc_rows(m, &error), PALPATE_OK);
    assert_null(m->c_st);
    pal_model_free(m);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(green_functions_have_johnsons_values),
        cmocka_unit_test(synthetic_models_are_physical),
        cmocka_unit_test(skew_models_have_the_skew_asked_for),
        cmocka_unit_test(halves_load_exactly_and_round_once),
        cmocka_unit_test(vector_conversion_agrees_with_software),
        cmocka_unit_test(precisions_store_and_refuse_overflow),
        cmocka_unit_test(half_rows_are_scaled_to_the_body),
        cmocka_unit_test(scaled_rows_are_within_half_a_step),
        cmocka_unit_test(check_finds_every_kind_of_damage),
        cmocka_unit_test(accessors_answer_and_survive_nonsense),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
