/// Factorization and block solves: against the library's own solve, dense LAPACK, and each other.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include "src/solution/factor.h"

/// A convection-diffusion operator on an n^3 grid: 7-point Laplacian plus `skew` times a central
/// difference in x (nonsymmetric with a positive symmetric part), diagonal shifted by `shift`.
static pal_sparse operator3(int n, double skew, double shift) {
    pal_sparse a = {.rows = (int64_t)n * n * n, .columns = (int64_t)n * n * n};
    a.start = calloc((size_t)a.columns + 1, sizeof *a.start);
    a.row = calloc((size_t)a.columns * 7, sizeof *a.row);
    a.value = calloc((size_t)a.columns * 7, sizeof *a.value);
    int64_t at = 0;
    for (int64_t j = 0; j < a.columns; j++) {
        int64_t x = j % n, y = j / n % n, z = j / n / n;
        int64_t step[7] = {-(int64_t)n * n, -n, -1, 0, 1, n, (int64_t)n * n};
        int ok[7] = {z > 0, y > 0, x > 0, 1, x < n - 1, y < n - 1, z < n - 1};
        double v[7] = {-1, -1, -1 + skew, 6 + shift, -1 - skew, -1, -1};
        a.start[j] = at;
        for (int e = 0; e < 7; e++) {
            if (ok[e]) {
                a.row[at] = j + step[e];
                a.value[at++] = v[e];
            }
        }
    }
    a.start[a.columns] = at;
    return a;
}

static double random_unit(uint64_t *s) {
    *s = *s * 6364136223846793005u + 1442695040888963407u;
    return (double)(*s >> 11) / 9007199254740992.0 - 0.5;
}

static double residual(const pal_sparse *a, const double *x, const double *b) {
    double worst = 0, size = 0;
    double *r = malloc((size_t)a->rows * sizeof *r);
    memcpy(r, b, (size_t)a->rows * sizeof *r);
    for (int64_t j = 0; j < a->columns; j++) {
        for (int64_t e = a->start[j]; e < a->start[j + 1]; e++) {
            r[a->row[e]] -= a->value[e] * x[j];
        }
    }
    for (int64_t i = 0; i < a->rows; i++) {
        worst = fmax(worst, fabs(r[i]));
        size = fmax(size, fabs(b[i]));
    }
    free(r);
    return worst / size;
}

static void clear(pal_sparse *a) {
    free(a->start);
    free(a->row);
    free(a->value);
}

static void solve_and_check(double skew, int positive, int count) {
    pal_sparse a = operator3(9, skew, 0.0);
    size_t n = (size_t)a.columns;
    pal_factor *f = NULL;
    pal_factor_report report = {0};
    pal_error e = {0};
    assert_int_equal(pal_factor_create(&a, positive, NULL, &f, &report, &e), PALPATE_OK);
    assert_true(report.rcond > 1e-6 && report.rcond <= 1.0);
    assert_true(report.nonzeros >= a.start[n] / 2);
    assert_non_null(strstr(report.kind, "METIS"));
    pal_factor_workspace *w = pal_factor_workspace_new(f);
    double *b = malloc(n * (size_t)count * sizeof *b), *x = malloc(n * (size_t)count * sizeof *x);
    double *y = malloc(n * sizeof *y);
    uint64_t seed = 7;
    for (size_t i = 0; i < n * (size_t)count; i++) {
        b[i] = random_unit(&seed);
    }
    // one column is a unit vector: its zeros are skipped, the answer must not care
    memset(b, 0, n * sizeof *b);
    b[n / 2] = 1.0;
    memcpy(x, b, n * (size_t)count * sizeof *x);
    assert_int_equal(pal_factor_solve(f, w, count, x, &e), PALPATE_OK);
    for (int c = 0; c < count; c++) {
        // backward stable solves of a matrix of norm 12: a few hundred ulps
        assert_true(residual(&a, x + (size_t)c * n, b + (size_t)c * n) < 1e-13);
        assert_int_equal(pal_factor_solve_reference(f, &a, 2, b + (size_t)c * n, y, &e),
                         PALPATE_OK);
        for (size_t i = 0; i < n; i++) {
            assert_true(fabs(y[i] - x[(size_t)c * n + i]) < 1e-12);
        }
    }
    free(b);
    free(x);
    free(y);
    pal_factor_workspace_free(w);
    pal_factor_free(f);
    clear(&a);
}

static void nonsymmetric_blocks_equal_umfpacks_own_solve(void **state) {
    (void)state;
    solve_and_check(0.4, 0, 1);
    solve_and_check(0.4, 0, 16);
    solve_and_check(0.4, 0, 37);
}

static void positive_blocks_have_small_residuals(void **state) {
    (void)state;
    solve_and_check(0.0, 1, 1);
    solve_and_check(0.0, 1, 37);
}

static void solution_equals_dense_lapack(void **state) {
    (void)state;
    pal_sparse a = operator3(5, 0.7, 0.1);
    int n = (int)a.columns;
    double *dense = calloc((size_t)n * (size_t)n, sizeof *dense), *b = calloc((size_t)n, sizeof *b);
    double *x = calloc((size_t)n, sizeof *x);
    lapack_int *pivot = calloc((size_t)n, sizeof *pivot);
    for (int j = 0; j < n; j++) {
        for (int64_t k = a.start[j]; k < a.start[j + 1]; k++) {
            dense[(int64_t)j * n + a.row[k]] = a.value[k];
        }
    }
    for (int i = 0; i < n; i++) {
        b[i] = x[i] = sin(i + 1.0);
    }
    assert_int_equal(LAPACKE_dgesv(LAPACK_COL_MAJOR, n, 1, dense, n, pivot, b, n), 0);
    pal_factor *f = NULL;
    assert_int_equal(pal_factor_create(&a, 0, NULL, &f, NULL, NULL), PALPATE_OK);
    pal_factor_workspace *w = pal_factor_workspace_new(f);
    assert_int_equal(pal_factor_solve(f, w, 1, x, NULL), PALPATE_OK);
    for (int i = 0; i < n; i++) {
        assert_true(fabs(x[i] - b[i]) < 1e-13);
    }
    pal_factor_workspace_free(w);
    pal_factor_free(f);
    free(dense);
    free(b);
    free(x);
    free(pivot);
    clear(&a);
}

static void needed_unknowns_are_bitwise_those_of_the_full_solve(void **state) {
    (void)state;
    pal_sparse a = operator3(9, 0.4, 0.0);
    size_t n = (size_t)a.columns;
    pal_factor *f = NULL;
    assert_int_equal(pal_factor_create(&a, 0, NULL, &f, NULL, NULL), PALPATE_OK);
    pal_factor_workspace *w = pal_factor_workspace_new(f);
    double *full = calloc(n, sizeof *full), *part = calloc(n, sizeof *part);
    uint8_t *need = calloc(n, 1);
    full[3] = part[3] = 1.0;
    assert_int_equal(pal_factor_solve(f, w, 1, full, NULL), PALPATE_OK);
    for (size_t i = 0; i < n; i += 97) {
        need[i] = 1;
    }
    assert_int_equal(pal_factor_need(f, need, NULL), PALPATE_OK);
    assert_int_equal(pal_factor_solve(f, w, 1, part, NULL), PALPATE_OK);
    int differs = 0;
    for (size_t i = 0; i < n; i++) {
        if (need[i]) {
            assert_true(full[i] == part[i]);
        } else {
            differs += full[i] != part[i];
        }
    }
    assert_true(differs > 0); // something was skipped indeed
    free(full);
    free(part);
    free(need);
    pal_factor_workspace_free(w);
    pal_factor_free(f);
    clear(&a);
}

static void singular_matrices_are_refused(void **state) {
    (void)state;
    pal_error e = {0};
    pal_factor *f = NULL;
    // pure Neumann Laplacian: constants are in the null space
    pal_sparse a = operator3(4, 0.0, 0.0);
    for (int64_t j = 0; j < a.columns; j++) {
        double sum = 0;
        int64_t diagonal = -1;
        for (int64_t k = a.start[j]; k < a.start[j + 1]; k++) {
            if (a.row[k] == j) {
                diagonal = k;
            } else {
                sum += a.value[k];
            }
        }
        a.value[diagonal] = -sum;
    }
    assert_int_equal(pal_factor_create(&a, 0, NULL, &f, NULL, &e), PALPATE_ERROR_SINGULAR);
    assert_non_null(strstr(e.message, "body.fixed"));
    assert_null(f);
    assert_int_equal(pal_factor_create(&a, 1, NULL, &f, NULL, &e), PALPATE_ERROR_SINGULAR);
    a.value[0] = NAN;
    assert_int_equal(pal_factor_create(&a, 0, NULL, &f, NULL, &e), PALPATE_ERROR_SINGULAR);
    clear(&a);
}

static void factors_that_will_not_fit_are_refused_before_they_are_made(void **state) {
    (void)state;
    pal_sparse a = operator3(6, 0.0, 0.0);
    for (int positive = 0; positive < 2; positive++) {
        pal_error e = {0};
        pal_factor *f = NULL;
        assert_int_equal(pal_factor_create_beside(&a, positive, 1ull << 60, NULL, &f, NULL, &e),
                         PALPATE_ERROR_MEMORY);
        assert_null(f);
        assert_non_null(strstr(e.message, "body.spacing"));
        assert_int_equal(pal_factor_create_beside(&a, positive, 1, NULL, &f, NULL, &e), PALPATE_OK);
        pal_factor_free(f);
    }
    clear(&a);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nonsymmetric_blocks_equal_umfpacks_own_solve),
        cmocka_unit_test(positive_blocks_have_small_residuals),
        cmocka_unit_test(solution_equals_dense_lapack),
        cmocka_unit_test(needed_unknowns_are_bitwise_those_of_the_full_solve),
        cmocka_unit_test(singular_matrices_are_refused),
        cmocka_unit_test(factors_that_will_not_fit_are_refused_before_they_are_made),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
