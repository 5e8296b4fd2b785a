/// Triplets into compressed columns: against a dense sum, order, duplicates, errors.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/discretization/sparse.h"

static uint64_t next(uint64_t *s) {
    *s = *s * 6364136223846793005u + 1442695040888963407u;
    return *s >> 33;
}

static void compression_equals_a_dense_sum_in_order(void **state) {
    (void)state;
    enum { ROWS = 13, COLUMNS = 9, COUNT = 3000 };
    double dense[COLUMNS][ROWS];
    int seen[COLUMNS][ROWS];
    memset(dense, 0, sizeof dense);
    memset(seen, 0, sizeof seen);
    pal_triplets t = {0};
    uint64_t s = 7;
    for (int k = 0; k < COUNT; k++) {
        int32_t r = (int32_t)(next(&s) % (ROWS - 1)); // the last row stays empty
        int32_t c = (int32_t)(next(&s) % COLUMNS);
        if (c == 4) {
            continue; // so does column 4
        }
        double v = (double)(next(&s) % 2001) * 1e-3 - 1.0;
        dense[c][r] += v;
        seen[c][r] = 1;
        assert_int_equal(pal_triplets_add(&t, r, c, v), PALPATE_OK);
    }
    pal_sparse a;
    pal_error e = {0};
    assert_int_equal(pal_sparse_from_triplets(&t, ROWS, COLUMNS, &a, &e), PALPATE_OK);
    assert_int_equal(a.rows, ROWS);
    assert_int_equal(a.columns, COLUMNS);
    assert_int_equal(a.start[0], 0);
    assert_int_equal(a.start[5], a.start[4]);
    for (int c = 0; c < COLUMNS; c++) {
        int64_t k = a.start[c];
        for (int r = 0; r < ROWS; r++) {
            if (seen[c][r]) {
                assert_true(k < a.start[c + 1]);
                assert_int_equal(a.row[k], r);
                // the same additions in the same order: equal to the last bit
                assert_memory_equal(&a.value[k], &dense[c][r], sizeof(double));
                k++;
            }
        }
        assert_int_equal(k, a.start[c + 1]);
    }
    double x[COLUMNS], y[ROWS], want[ROWS];
    for (int c = 0; c < COLUMNS; c++) {
        x[c] = 0.25 * c - 1.0;
    }
    for (int r = 0; r < ROWS; r++) {
        y[r] = want[r] = 0.5 * r;
        for (int c = 0; c < COLUMNS; c++) {
            want[r] += -2.0 * dense[c][r] * x[c];
        }
    }
    pal_sparse_multiply(&a, -2.0, x, y);
    for (int r = 0; r < ROWS; r++) {
        // sums of a few hundred numbers of order one
        assert_true(y[r] - want[r] < 1e-12 && want[r] - y[r] < 1e-12);
    }
    pal_sparse_clear(&a);
    assert_null(a.start);
    pal_triplets_clear(&t);
    assert_null(t.row);
}

static void empty_and_out_of_range(void **state) {
    (void)state;
    pal_triplets t = {0};
    pal_sparse a;
    pal_error e = {0};
    assert_int_equal(pal_sparse_from_triplets(&t, 3, 2, &a, &e), PALPATE_OK);
    assert_int_equal(a.start[2], 0);
    pal_sparse_clear(&a);
    assert_int_equal(pal_triplets_add(&t, 3, 0, 1.0), PALPATE_OK);
    assert_int_equal(pal_sparse_from_triplets(&t, 3, 2, &a, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "(3, 0)"));
    assert_null(a.start);
    t.row[0] = 0;
    t.column[0] = -1;
    assert_int_equal(pal_sparse_from_triplets(&t, 3, 2, &a, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_sparse_from_triplets(&t, -1, 2, &a, &e), PALPATE_ERROR_ARGUMENT);
    pal_triplets_clear(&t);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(compression_equals_a_dense_sum_in_order),
        cmocka_unit_test(empty_and_out_of_range),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
