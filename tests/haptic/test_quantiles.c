/// Quantiles by histogram: exact below 8192 ns, bounded error above, against a sort.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>

#include <cmocka.h>

#include "haptic/base/quantiles.h"

static int ascending(const void *a, const void *b) {
    int64_t x = *(const int64_t *)a, y = *(const int64_t *)b;
    return (x > y) - (x < y);
}

static uint64_t next_random(uint64_t *s) { // xorshift64*
    *s ^= *s >> 12;
    *s ^= *s << 25;
    *s ^= *s >> 27;
    return *s * UINT64_C(2685821657736338717);
}

enum { SAMPLES = 20011 };

static int64_t nearest_rank(const int64_t *sorted, int64_t n, double p) {
    int64_t rank = (int64_t)(p * (double)n);
    if ((double)rank < p * (double)n) {
        rank++;
    }
    return sorted[(rank < 1 ? 1 : rank) - 1];
}

/// Samples spread over `octaves` powers of two: small ones must be exact, large within 1/4096.
static void compare_with_sort(int octaves) {
    int64_t *x = malloc(SAMPLES * sizeof *x);
    assert_non_null(x);
    pal_histogram h = {0};
    assert_int_equal(pal_histogram_init(&h), PALPATE_OK);
    uint64_t seed = 88172645463325252u;
    for (int i = 0; i < SAMPLES; i++) {
        uint64_t r = next_random(&seed);
        x[i] = (int64_t)(r >> (64 - (int)(1 + r % (uint64_t)octaves)));
        pal_histogram_add(&h, x[i]);
    }
    qsort(x, SAMPLES, sizeof *x, ascending);
    const double ps[] = {0.0, 0.001, 0.1, 0.25, 0.5, 0.9, 0.99, 0.999, 1.0};
    for (size_t k = 0; k < sizeof ps / sizeof *ps; k++) {
        int64_t want = nearest_rank(x, SAMPLES, ps[k]);
        int64_t got = pal_histogram_quantile(&h, ps[k]);
        if (want < 8192) {
            assert_int_equal(got, want);
        } else {
            assert_true(got >= want); // never better than the truth
            assert_true(got - want <= want / 4096);
        }
    }
    assert_int_equal(pal_histogram_quantile(&h, 1.0), x[SAMPLES - 1]); // max is exact
    pal_histogram_clear(&h);
    free(x);
}

static void small_values_are_exact(void **state) {
    (void)state;
    compare_with_sort(13);
}

static void large_values_are_within_the_bound(void **state) {
    (void)state;
    compare_with_sort(20);
    compare_with_sort(39);
}

static void extremes_do_not_fall_out(void **state) {
    (void)state;
    pal_histogram h = {0};
    assert_int_equal(pal_histogram_init(&h), PALPATE_OK);
    assert_int_equal(pal_histogram_quantile(&h, 0.5), 0);
    pal_histogram_add(&h, -5);
    assert_int_equal(pal_histogram_quantile(&h, 0.5), 0);
    pal_histogram_add(&h, INT64_MAX);
    pal_histogram_add(&h, (INT64_C(1) << 40) - 1);
    pal_histogram_add(&h, INT64_C(1) << 40);
    assert_true(pal_histogram_quantile(&h, 1.0) == INT64_MAX);
    pal_quantiles q = pal_histogram_us(&h);
    assert_true(q.max == 1e-3 * (double)INT64_MAX);
    pal_histogram_clear(&h);
}

/// Every power of two and its neighbours: bucket borders are where an off-by-one would sit.
static void bucket_borders_hold(void **state) {
    (void)state;
    for (int e = 0; e < 40; e++) {
        for (int64_t d = -1; d <= 1; d++) {
            int64_t v = (INT64_C(1) << e) + d;
            pal_histogram h = {0};
            assert_int_equal(pal_histogram_init(&h), PALPATE_OK);
            pal_histogram_add(&h, v);
            pal_histogram_add(&h, INT64_C(1)
                                      << 42); // so that the clamp to max does not hide the bucket
            int64_t got = pal_histogram_quantile(&h, 0.5);
            if (v < (INT64_C(1) << 40) - (INT64_C(1) << 28)) {
                assert_true(got >= v && got - v <= v / 4096);
            }
            pal_histogram_clear(&h);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_values_are_exact),
        cmocka_unit_test(large_values_are_within_the_bound),
        cmocka_unit_test(extremes_do_not_fall_out),
        cmocka_unit_test(bucket_borders_hold),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
