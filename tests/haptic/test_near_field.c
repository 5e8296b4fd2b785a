/// The regular compliance between neighbours: none on a half-space, symmetric, skew kept on raw
/// models.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>

#include "haptic/contact/near_field.h"
#include "tests/support/engine_rig.h"

typedef struct near_rig {
    rig r;
    pal_rest_surface surface;
    pal_near_field near;
    void *surface_memory, *near_memory;
} near_rig;

static void make(near_rig *q, double skew) {
    rig_model(&q->r, 12, PALPATE_PRECISION_SINGLE, skew);
    q->surface_memory = aligned_alloc(64, pal_rest_bytes(q->r.model));
    q->near_memory = aligned_alloc(64, pal_near_bytes(q->r.model));
    assert_true(q->surface_memory != NULL && q->near_memory != NULL);
    pal_rest_init(&q->surface, q->r.model, q->surface_memory);
    pal_near_init(&q->near, q->r.model, &q->surface, 1, q->near_memory);
}

static void release(near_rig *q) {
    free(q->surface_memory);
    free(q->near_memory);
    rig_free(&q->r);
}

/// On a half-space C is Boussinesq's all over, so nothing regular is left of the normal compliance
/// but the rounding of 1/r: 1e-12 of n / h. (Across, Cerruti's differs by direction: the mean over
/// a square ring is 0 for it too.)
static void half_space_has_no_regular_part(void **state) {
    (void)state;
    near_rig q;
    make(&q, 0.0);
    int inner = 0;
    for (int32_t a = 0; a < q.r.model->info.column_count; a++) {
        double r[9], scale = q.near.normal / 0.002;
        assert_int_equal(pal_near_pair(&q.near, a, a, r), 1);
        assert_true(fabs(r[8]) < 1e-12 * scale);
        assert_true(r[1] == r[3] && r[2] == r[6] && r[5] == r[7]);
        int32_t i = a % 12, j = a / 12;
        if (i > 1 && i < 10 && j > 1 && j < 10) {
            inner++;
            assert_true(fabs(q.near.spacing[a] - 0.002 * (4 + 2 * sqrt(2)) / 6) < 1e-12);
            assert_true(fabs(r[2]) < 1e-12 * scale && fabs(r[5]) < 1e-12 * scale);
        }
    }
    assert_int_equal(inner, 64);
    release(&q);
}

/// Neighbours are the nodes one edge away, from both sides alike.
static void pairs_are_neighbours(void **state) {
    (void)state;
    near_rig q;
    make(&q, 0.0);
    for (int32_t a = 0; a < 144; a++) {
        for (int32_t b = 0; b < 144; b++) {
            int di = abs(a % 12 - b % 12), dj = abs(a / 12 - b / 12);
            double r[9], s[9];
            int pair = pal_near_pair(&q.near, a, b, r);
            assert_int_equal(pair, pal_near_pair(&q.near, b, a, s));
            if (di + dj <= 1) {
                assert_int_equal(pair, 1); // along edges; of the diagonals, one of two
            }
            if (di > 1 || dj > 1) {
                assert_int_equal(pair, 0);
            }
            for (int k = 0; k < 9 && pair; k++) {
                assert_true(r[k] == s[k / 3 + 3 * (k % 3)]);
            }
        }
    }
    release(&q);
}

static void kernel_is_that_of_a_half_space(void **state) {
    (void)state;
    near_rig q;
    make(&q, 0.0);
    const pal_model_info *info = &q.r.model->info;
    double g[9], pi = 3.14159265358979324;
    pal_near_kernel(&q.near, 60, 65, g); // 10 mm apart along x
    double normal = (1 - info->poisson * info->poisson) / (pi * info->young) / 0.01;
    double along = (1 + info->poisson) / (pi * info->young) / 0.01,
           across = along * (1 - info->poisson);
    assert_true(fabs(g[8] - normal) < 1e-12 * normal);
    assert_true(fabs(g[0] - 0.5 * (along + across)) < 1e-12 * along); // Cerruti, mean of directions
    assert_true(g[2] == 0.0 && g[1] == 0.0);
    release(&q);
}

/// A raw model stays as far from passive as it is.
static void raw_models_keep_their_skew(void **state) {
    (void)state;
    near_rig q;
    make(&q, 0.1);
    const double *c = q.r.model->c_tt;
    size_t ld = 3 * 144;
    double largest = 0.0;
    for (int32_t a = 48; a < 59; a++) {
        double r[9], s[9];
        assert_int_equal(pal_near_pair(&q.near, a, a + 1, r), 1);
        assert_int_equal(pal_near_pair(&q.near, a + 1, a, s), 1);
        for (size_t k = 0; k < 9; k++) {
            size_t i = 3 * (size_t)a + k % 3, j = 3 * (size_t)a + 3 + k / 3;
            double skew = c[i + j * ld] - c[j + i * ld];
            largest = fmax(largest, fabs(skew));
            assert_true(fabs(r[k] - s[k / 3 + 3 * (k % 3)] - skew) < 1e-12 * fabs(c[0]));
        }
    }
    assert_true(largest > 1e-3 * c[0]);
    release(&q);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(half_space_has_no_regular_part),
        cmocka_unit_test(pairs_are_neighbours),
        cmocka_unit_test(kernel_is_that_of_a_half_space),
        cmocka_unit_test(raw_models_keep_their_skew),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
