/// Dense kernels against LAPACK (sizes 1..400, ill-conditioned ones), against the textbook loops
/// bit for bit, and their refusals.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <float.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include "haptic/base/dense.h"
#include "haptic/base/hash.h"

// the same source without its AVX2 copy, under other names
#define PALPATE_DENSE_BASELINE
#define pal_dense_cholesky baseline_cholesky
#define pal_dense_lu baseline_lu
#define pal_dense_cholesky_solve baseline_cholesky_solve
#define pal_dense_lu_solve baseline_lu_solve
#define pal_dense_lower_solve baseline_lower_solve
#define pal_dense_lower_solve_transposed baseline_lower_solve_transposed
#define pal_dense_cholesky_remove baseline_cholesky_remove
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wmissing-prototypes"
#include "haptic/base/dense.c"
#pragma GCC diagnostic pop
#undef pal_dense_cholesky
#undef pal_dense_lu
#undef pal_dense_cholesky_solve
#undef pal_dense_lu_solve
#undef pal_dense_lower_solve
#undef pal_dense_lower_solve_transposed
#undef pal_dense_cholesky_remove

static uint64_t seed = 1;
static double uniform(void) { // in (-1, 1), splitmix64
    seed += 0x9E3779B97F4A7C15u;
    uint64_t z = seed;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    z ^= z >> 31;
    return (double)(int64_t)z / 9223372036854775808.0;
}

static double *random_matrix(int n, int ld) {
    double *a = calloc((size_t)ld * (size_t)n, sizeof *a);
    assert_non_null(a);
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++) {
            a[i + j * ld] = uniform();
        }
    }
    return a;
}

/// B B^T + shift I
static double *random_spd(int n, int ld, double shift) {
    double *b = random_matrix(n, n), *a = calloc((size_t)ld * (size_t)n, sizeof *a);
    assert_non_null(a);
    for (int j = 0; j < n; j++) {
        for (int k = 0; k < n; k++) {
            double s = b[j + k * n];
            for (int i = 0; i < n; i++) {
                a[i + j * ld] += b[i + k * n] * s;
            }
        }
        a[j + j * ld] += shift;
    }
    free(b);
    return a;
}

static double norm_difference(int n, const double *a, const double *b) {
    double worst = 0;
    for (int i = 0; i < n; i++) {
        worst = fmax(worst, fabs(a[i] - b[i]));
    }
    return worst;
}

static double norm(int n, const double *a) {
    double worst = 0;
    for (int i = 0; i < n; i++) {
        worst = fmax(worst, fabs(a[i]));
    }
    return worst;
}

static const int sizes[] = {1,  2,  3,  4,  5,  6,  7,  8,   9,   11,  12,  13,  15,  16,
                            17, 23, 31, 32, 33, 48, 96, 127, 128, 129, 191, 255, 333, 400};
enum { SIZE_COUNT = sizeof sizes / sizeof *sizes };

/// Backward stability: |A x - b| <= c n eps |A| |x| (Higham, Accuracy and Stability, Theorem 10.4
/// and 9.4 with modest growth); c = 8 leaves room over the few seen.
static double residual(int n, int ld, const double *a, const double *x, const double *b) {
    double worst = 0, scale = 0;
    for (int i = 0; i < n; i++) {
        double sum = 0, row = 0;
        for (int j = 0; j < n; j++) {
            sum += a[i + j * ld] * x[j];
            row += fabs(a[i + j * ld]);
        }
        worst = fmax(worst, fabs(sum - b[i]));
        scale = fmax(scale, row);
    }
    return worst / (n * DBL_EPSILON * (scale * norm(n, x) + norm(n, b)));
}

static void cholesky_matches_lapack(void **state) {
    (void)state;
    for (int s = 0; s < SIZE_COUNT; s++) {
        int n = sizes[s], ld = n + s % 5;
        double *a = random_spd(n, ld, 1.0), *ours = malloc(sizeof *a * (size_t)(ld * n)),
               *theirs = malloc(sizeof *a * (size_t)(ld * n));
        memcpy(ours, a, sizeof *a * (size_t)(ld * n));
        memcpy(theirs, a, sizeof *a * (size_t)(ld * n));
        assert_int_equal(pal_dense_cholesky(n, 0, ours, ld), 0);
        assert_int_equal(LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', n, theirs, ld), 0);
        for (int j = 0; j < n; j++) {
            for (int i = 0; i < n; i++) {
                double d = fabs(ours[i + j * ld] - theirs[i + j * ld]);
                // both are backward stable; the factor of a matrix with cond <= 1e5 (shift 1, norm
                // <= n^2) moves by at most cond n eps
                assert_true(i < j ? ours[i + j * ld] == a[i + j * ld] : d <= 1e-9 * sqrt(n));
            }
        }
        double *b = malloc(sizeof *b * (size_t)n * 3), *x = malloc(sizeof *b * (size_t)n * 3);
        for (int i = 0; i < 3 * n; i++) {
            x[i] = b[i] = uniform();
        }
        pal_dense_cholesky_solve(n, ours, ld, 3, x, n);
        for (int c = 0; c < 3; c++) {
            assert_true(residual(n, ld, a, x + c * n, b + c * n) < 8);
        }
        free(a), free(ours), free(theirs), free(b), free(x);
    }
}

static void lu_matches_lapack(void **state) {
    (void)state;
    for (int s = 0; s < SIZE_COUNT; s++) {
        int n = sizes[s], ld = n + s % 3;
        double *a = random_matrix(n, ld), *ours = malloc(sizeof *a * (size_t)(ld * n)),
               *theirs = malloc(sizeof *a * (size_t)(ld * n));
        int32_t pivot[400];
        lapack_int their_pivot[400];
        memcpy(ours, a, sizeof *a * (size_t)(ld * n));
        memcpy(theirs, a, sizeof *a * (size_t)(ld * n));
        assert_int_equal(pal_dense_lu(n, ours, ld, pivot), 0);
        assert_int_equal(LAPACKE_dgetrf(LAPACK_COL_MAJOR, n, n, theirs, ld, their_pivot), 0);
        for (int i = 0; i < n; i++) { // random entries: no ties, so the pivots are the same
            assert_int_equal(pivot[i] + 1, their_pivot[i]);
        }
        double *b = malloc(sizeof *b * (size_t)n * 2), *x = malloc(sizeof *b * (size_t)n * 2);
        for (int i = 0; i < 2 * n; i++) {
            x[i] = b[i] = uniform();
        }
        pal_dense_lu_solve(n, ours, ld, pivot, 2, x, n);
        for (int c = 0; c < 2; c++) {
            assert_true(residual(n, ld, a, x + c * n, b + c * n) < 8);
        }
        free(a), free(ours), free(theirs), free(b), free(x);
    }
}

/// Hilbert-like and graded matrices: the residual stays at rounding level however bad the
/// condition, and the error stays within a few times LAPACK's own.
static void ill_conditioned_systems_stay_backward_stable(void **state) {
    (void)state;
    for (int n = 4; n <= 60; n += 4) {
        for (int kind = 0; kind < 2; kind++) {
            double *a = calloc((size_t)(n * n), sizeof *a), x[60], b[60], truth[60];
            for (int j = 0; j < n; j++) {
                for (int i = 0; i < n; i++) {
                    // kind 0: Hilbert plus 1e-13 on the diagonal (condition 1e13); kind 1: rows and
                    // columns scaled over twelve decades
                    a[i + j * n] = kind == 0 ? 1.0 / (i + j + 1) + (i == j ? 1e-13 : 0)
                                             : pow(10, -6.0 * (i + j) / n) *
                                                   (i == j ? 2 : 0.5 / (1 + abs(i - j)));
                }
                truth[j] = uniform();
            }
            for (int i = 0; i < n; i++) {
                b[i] = 0;
                for (int j = 0; j < n; j++) {
                    b[i] += a[i + j * n] * truth[j];
                }
            }
            double *l = malloc(sizeof *l * (size_t)(n * n));
            memcpy(l, a, sizeof *l * (size_t)(n * n));
            assert_int_equal(pal_dense_cholesky(n, 0, l, n), 0);
            memcpy(x, b, sizeof x);
            pal_dense_cholesky_solve(n, l, n, 1, x, n);
            assert_true(residual(n, n, a, x, b) < 8);

            int32_t pivot[60];
            memcpy(l, a, sizeof *l * (size_t)(n * n));
            assert_int_equal(pal_dense_lu(n, l, n, pivot), 0);
            memcpy(x, b, sizeof x);
            pal_dense_lu_solve(n, l, n, pivot, 1, x, n);
            assert_true(residual(n, n, a, x, b) < 8);
            free(a), free(l);
        }
    }
}

/// The textbook loops, one element at a time, in ascending k: the blocked kernels must give the
/// very same bits (this is what makes them independent of vector width).
static void blocking_does_not_change_a_bit(void **state) {
    (void)state;
    for (int s = 0; s < SIZE_COUNT; s++) {
        int n = sizes[s];
        double *a = random_spd(n, n, 0.5), *plain = malloc(sizeof *a * (size_t)(n * n));
        memcpy(plain, a, sizeof *a * (size_t)(n * n));
        for (int j = 0; j < n; j++) {
            for (int i = j; i < n; i++) {
                volatile double sum = plain[i + j * n];
                for (int k = 0; k < j; k++) {
                    volatile double product = plain[i + k * n] * plain[j + k * n];
                    sum = sum - product;
                }
                plain[i + j * n] = i == j ? sqrt(sum) : sum / plain[j + j * n];
            }
        }
        double *appended = malloc(sizeof *a * (size_t)(n * n));
        memcpy(appended, a, sizeof *a * (size_t)(n * n));
        assert_int_equal(pal_dense_cholesky(n, 0, a, n), 0);
        assert_memory_equal(a, plain, sizeof *a * (size_t)(n * n));

        // appending: factor the leading half, then the rest. Its trailing rows need their columns
        // left of `half` factored, which a whole factorization of the leading rows does not give;
        // so solve them first, as a caller does.
        int half = n / 2;
        assert_int_equal(pal_dense_cholesky(half, 0, appended, n), 0);
        for (int i = half; i < n; i++) {
            double row[400];
            for (int k = 0; k < half; k++) {
                row[k] = appended[i + k * n];
            }
            pal_dense_lower_solve(half, appended, n, row);
            for (int k = 0; k < half; k++) {
                appended[i + k * n] = row[k];
            }
        }
        assert_int_equal(pal_dense_cholesky(n, half, appended, n), 0);
        assert_memory_equal(a, appended, sizeof *a * (size_t)(n * n));
        free(a), free(plain), free(appended);

        double *m = random_matrix(n, n);
        plain = malloc(sizeof *m * (size_t)(n * n));
        memcpy(plain, m, sizeof *m * (size_t)(n * n));
        int32_t pivot[400];
        assert_int_equal(pal_dense_lu(n, m, n, pivot), 0);
        for (int k = 0; k < n; k++) { // right-looking, outer products
            for (int j = 0; j < n; j++) {
                double t = plain[k + j * n];
                plain[k + j * n] = plain[pivot[k] + j * n];
                plain[pivot[k] + j * n] = t;
            }
            for (int i = k + 1; i < n; i++) {
                plain[i + k * n] /= plain[k + k * n];
                for (int j = k + 1; j < n; j++) {
                    volatile double product = plain[i + k * n] * plain[k + j * n];
                    plain[i + j * n] = plain[i + j * n] - product;
                }
            }
        }
        assert_memory_equal(m, plain, sizeof *m * (size_t)(n * n));
        free(m), free(plain);
    }
}

static void both_instruction_sets_give_the_same_bits(void **state) {
    (void)state;
    for (int s = 0; s < SIZE_COUNT; s++) {
        int n = sizes[s];
        size_t bytes = sizeof(double) * (size_t)(n * n);
        double *a = random_spd(n, n, 0.5), *b = malloc(bytes), *c = malloc(bytes);
        int32_t p[400], q[400];
        memcpy(b, a, bytes), memcpy(c, a, bytes);
        assert_int_equal(pal_dense_cholesky(n, 0, b, n), 0);
        assert_int_equal(baseline_cholesky(n, 0, c, n), 0);
        assert_memory_equal(b, c, bytes);
        double x[400], y[400];
        for (int i = 0; i < n; i++) {
            x[i] = y[i] = uniform();
        }
        pal_dense_cholesky_solve(n, b, n, 1, x, n);
        baseline_cholesky_solve(n, c, n, 1, y, n);
        assert_memory_equal(x, y, sizeof *x * (size_t)n);
        memcpy(b, a, bytes), memcpy(c, a, bytes);
        assert_int_equal(pal_dense_lu(n, b, n, p), 0);
        assert_int_equal(baseline_lu(n, c, n, q), 0);
        assert_memory_equal(b, c, bytes);
        assert_memory_equal(p, q, sizeof *p * (size_t)n);
        pal_dense_lu_solve(n, b, n, p, 1, x, n);
        baseline_lu_solve(n, c, n, q, 1, y, n);
        assert_memory_equal(x, y, sizeof *x * (size_t)n);
        free(a), free(b), free(c);
    }
}

/// One hash over factors and solutions of 88 systems, the same for gcc 12 and clang 14 at -O0, -O2
/// and -O3 -march=native: a compiler flag that fuses or reorders fails here.
static void results_have_their_golden_hash(void **state) {
    (void)state;
    pal_hash h;
    pal_hash_init(&h, 32);
    uint64_t s = 1;
    for (int n = 1; n <= 130; n += 3) {
        size_t bytes = sizeof(double) * (size_t)(n * n);
        double *a = malloc(bytes), b[130];
        int32_t pivot[130];
        for (int k = 0; k < 2; k++) {
            for (int i = 0; i < n * n; i++) {
                s = s * 6364136223846793005u + 1442695040888963407u;
                a[i] = (double)(int64_t)s / 9e18;
            }
            for (int i = 0; i < n; i++) {
                b[i] = i - 3.3;
            }
            if (k == 0) {
                for (int i = 0; i < n; i++) {
                    for (int j = 0; j < i; j++) {
                        a[j + i * n] = a[i + j * n];
                    }
                    a[i + i * n] += n;
                }
                assert_int_equal(pal_dense_cholesky(n, 0, a, n), 0);
                pal_dense_cholesky_solve(n, a, n, 1, b, n);
                if (n > 2) {
                    pal_dense_cholesky_remove(n, 1, a, n);
                }
            } else {
                assert_int_equal(pal_dense_lu(n, a, n, pivot), 0);
                pal_dense_lu_solve(n, a, n, pivot, 1, b, n);
            }
            pal_hash_update(&h, a, bytes);
            pal_hash_update(&h, b, (size_t)n * sizeof *b);
        }
        free(a);
    }
    uint8_t digest[32];
    char hex[PALPATE_HASH_HEX];
    pal_hash_final(&h, digest);
    pal_hash_to_hex(digest, 32, hex);
    assert_string_equal(hex, "658ab52fe128f1ff2842fe77e9de388c7965d9dfa2740fffd2e7f5ee240a3d85");
}

static void refuses_what_is_not_positive_or_singular(void **state) {
    (void)state;
    for (int n = 1; n <= 40; n++) {
        for (int bad = 0; bad < n; bad += 3) {
            double *a = random_spd(n, n, 1.0), keep = a[bad + bad * n];
            a[bad + bad * n] = -1;
            assert_int_equal(pal_dense_cholesky(n, 0, a, n), bad + 1);
            a[bad + bad * n] = keep;
            free(a);
            a = random_spd(n, n, 1.0);
            a[bad + bad * n] = NAN;
            assert_int_equal(pal_dense_cholesky(n, 0, a, n), bad + 1);
            free(a);
            a = random_spd(n, n, 1.0);
            a[bad + bad * n] = INFINITY;
            assert_int_equal(pal_dense_cholesky(n, 0, a, n), bad + 1);
            free(a);

            int32_t pivot[40];
            a = random_matrix(n, n);
            for (int i = 0; i < n; i++) {
                a[i + bad * n] = 0; // a zero column stays exactly zero
            }
            assert_int_equal(pal_dense_lu(n, a, n, pivot), bad + 1);
            free(a);
            a = random_matrix(n, n);
            a[n - 1 + bad * n] = NAN;
            assert_int_not_equal(pal_dense_lu(n, a, n, pivot), 0);
            free(a);
        }
    }
    assert_int_equal(pal_dense_cholesky(0, 0, NULL, 1), 0);
    assert_int_equal(pal_dense_lu(0, NULL, 1, NULL), 0);
}

static void removing_an_unknown_gives_the_smaller_factor(void **state) {
    (void)state;
    for (int n = 1; n <= 40; n += 3) {
        for (int k = 0; k < n; k++) {
            double *a = random_spd(n, n, 1.0), *small = calloc((size_t)(n * n), sizeof *a);
            for (int j = 0, q = 0; j < n; j++) {
                if (j == k) {
                    continue;
                }
                for (int i = 0, p = 0; i < n; i++) {
                    if (i != k) {
                        small[p++ + q * n] = a[i + j * n];
                    }
                }
                q++;
            }
            assert_int_equal(pal_dense_cholesky(n, 0, a, n), 0);
            assert_int_equal(pal_dense_cholesky(n - 1, 0, small, n), 0);
            pal_dense_cholesky_remove(n, k, a, n);
            for (int j = 0; j < n - 1; j++) {
                // cond <= 1e4 here; rotations are orthogonal, so the error is cond n eps
                assert_true(norm_difference(n - 1 - j, a + j + j * n, small + j + j * n) < 1e-10);
            }
            free(a), free(small);
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(cholesky_matches_lapack),
        cmocka_unit_test(lu_matches_lapack),
        cmocka_unit_test(ill_conditioned_systems_stay_backward_stable),
        cmocka_unit_test(blocking_does_not_change_a_bit),
        cmocka_unit_test(both_instruction_sets_give_the_same_bits),
        cmocka_unit_test(results_have_their_golden_hash),
        cmocka_unit_test(refuses_what_is_not_positive_or_singular),
        cmocka_unit_test(removing_an_unknown_gives_the_smaller_factor),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
