/// The field of a model: columns without a force are not read, and leave the same bits.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/engine/field_model.h"
#include "tests/support/synthetic_model.h"

enum { DOFS_MAX = 600 };

typedef struct forces {
    int32_t count;
    int32_t dof[DOFS_MAX];
    double f[DOFS_MAX];
    float f32[DOFS_MAX];
} forces;

static void add(const pal_model *m, forces *x, int32_t dof, double f) {
    x->dof[x->count] = dof;
    x->f[x->count] = f;
    x->f32[x->count++] = (float)(f * pal_model_unit(m, dof));
}

static float *field_of(const pal_model *m, const forces *x) {
    size_t bytes = ((size_t)pal_field_floats(m) * sizeof(float) + 63) / 64 * 64;
    float *out = aligned_alloc(64, bytes);
    assert_non_null(out);
    memset(out, 0xff, bytes);
    pal_field_compute(pal_field_best(), m, x->count, x->dof, x->f, x->f32, NULL, out);
    return out;
}

/// Normal forces on a face along an axis: every first and second dof of a node is zero (once -0).
static void make_forces(const pal_model *m, int32_t nodes, forces *all, forces *pressed) {
    all->count = pressed->count = 0;
    for (int32_t k = 0; k < nodes; k++) {
        double f = 0.01 * (1 + k % 7);
        add(m, all, 3 * k, 0.0);
        add(m, all, 3 * k + 1, k % 2 == 0 ? 0.0 : -0.0);
        add(m, all, 3 * k + 2, f);
        add(m, pressed, 3 * k + 2, f);
    }
}

static void columns_without_a_force_are_not_read(void **state) {
    (void)state;
    static const int32_t nodes[] = {1, 16, 45, 150}; // 450 dofs are more than are looked through
    for (int p = PALPATE_PRECISION_DOUBLE; p <= PALPATE_PRECISION_SCALED; p++) {
        synthetic_params params = synthetic_default_params();
        params.n = 13;
        params.layers = 3;
        params.rows = SYNTHETIC_ROWS_ALL;
        params.precision = (pal_precision)p;
        pal_model *m = synthetic_model(&params);
        assert_non_null(m);
        assert_true(m->info.column_count >= 150);
        size_t element = pal_precision_size(m->info.precision);
        for (size_t k = 0; k < sizeof nodes / sizeof *nodes; k++) {
            forces all, pressed;
            make_forces(m, nodes[k], &all, &pressed);
            float *a = field_of(m, &all), *b = field_of(m, &pressed);
            assert_memory_equal(a, b, (size_t)pal_field_floats(m) * sizeof *a);
            assert_true(fabsf(a[2]) > 0);
            free(a);
            free(b);
        }
        // what is there cannot be seen
        forces all, pressed;
        make_forces(m, 45, &all, &pressed);
        float *before = field_of(m, &all);
        for (int32_t k = 0; k < all.count; k++) {
            if (all.f[k] == 0.0) { // NaN, or other integers
                memset((char *)m->c_st + (size_t)all.dof[k] * (size_t)m->row_ld * element, 0x7f,
                       (size_t)m->row_ld * element);
            }
        }
        float *after = field_of(m, &all);
        assert_memory_equal(before, after, (size_t)pal_field_floats(m) * sizeof *before);
        free(before);
        free(after);
        pal_model_free(m);
    }
}

static void no_force_at_all_gives_zero(void **state) {
    (void)state;
    synthetic_params params = synthetic_default_params();
    params.rows = SYNTHETIC_ROWS_ALL;
    pal_model *m = synthetic_model(&params);
    assert_non_null(m);
    forces none = {.count = 0};
    add(m, &none, 0, 0.0);
    add(m, &none, 4, 0.0);
    float *out = field_of(m, &none);
    for (int64_t i = 0; i < pal_field_floats(m); i++) {
        assert_true(out[i] == 0.0f);
    }
    free(out);
    pal_model_free(m);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(columns_without_a_force_are_not_read),
        cmocka_unit_test(no_force_at_all_gives_zero),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
