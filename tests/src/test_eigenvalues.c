/// Reciprocity, symmetrizing and extreme eigenvalues of compliance blocks.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/certificate/certificate.h"

/// Q diag(w) Q^T with Q a Householder reflection: eigenvalues known exactly.
static double *known_spectrum(int n, const double *w) {
    double *v = malloc((size_t)n * sizeof *v), *a = malloc((size_t)n * (size_t)n * sizeof *a),
           vv = 0;
    for (int i = 0; i < n; i++) {
        v[i] = sin(1.7 * i + 0.3);
        vv += v[i] * v[i];
    }
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < n; i++) {
            double s = 0;
            for (int k = 0; k < n; k++) {
                double qi = (i == k) - 2 * v[i] * v[k] / vv, qj = (j == k) - 2 * v[j] * v[k] / vv;
                s += qi * w[k] * qj;
            }
            a[j * n + i] = s;
        }
    }
    free(v);
    return a;
}

static void check(int n, double smallest, int expect_positive) {
    double *w = malloc((size_t)n * sizeof *w), lo, hi;
    for (int i = 0; i < n; i++) {
        w[i] = smallest + (3.0 - smallest) * i / (n - 1.0) * i / (n - 1.0);
    }
    double *a = known_spectrum(n, w);
    // a skew part must not matter: eigenvalues are those of the symmetric part
    for (int j = 0; j < n; j++) {
        for (int i = 0; i < j; i++) {
            a[j * n + i] += 0.1;
            a[i * n + j] -= 0.1;
        }
    }
    int positive = -1;
    assert_int_equal(pal_extreme_eigenvalues(a, n, &lo, &hi, &positive, NULL), PALPATE_OK);
    assert_true(fabs(hi - 3.0) < 3e-6); // Lanczos tolerance 1e-6 relative
    assert_true(fabs(lo - smallest) <
                2e-6 * fmax(fabs(smallest), 1e-3) + (smallest < 0 ? 1e-6 : 0));
    assert_int_equal(positive, expect_positive);
    free(a);
    free(w);
}

static void extremes_are_found_dense_and_by_lanczos(void **state) {
    (void)state;
    check(30, 0.5, 1);
    check(200, 0.5, 1);
    check(200, 1e-5, 1);
}

static void indefinite_matrices_are_told(void **state) {
    (void)state;
    check(30, -0.2, 0);
    check(200, -0.2, 0);
}

static void reciprocity_and_symmetrizing(void **state) {
    (void)state;
    double c[9] = {2, 1, 0, 3, 2, 0, 0, 0, 2}; // C01 = 3, C10 = 1
    // ||C - C^T|| = sqrt(2 * 2^2), ||C|| = sqrt(4+1+9+4+4)
    assert_true(fabs(pal_reciprocity_error(c, 3) - sqrt(8.0 / 22.0)) < 1e-15);
    pal_symmetrize(c, 3);
    assert_true(c[1] == 2.0 && c[3] == 2.0 && c[0] == 2.0 && c[2] == 0.0);
    assert_true(pal_reciprocity_error(c, 3) == 0.0);
    enum { N = 75 }; // more than two tiles
    double *a = malloc(sizeof *a * N * N);
    for (int i = 0; i < N * N; i++) {
        a[i] = sin(i * 0.37);
    }
    double *b = malloc(sizeof *b * N * N);
    memcpy(b, a, sizeof *b * N * N);
    pal_symmetrize(b, N);
    for (int j = 0; j < N; j++) {
        for (int i = 0; i < N; i++) {
            assert_true(b[j * N + i] ==
                        (i == j ? a[j * N + i] : 0.5 * (a[j * N + i] + a[i * N + j])));
        }
    }
    free(a);
    free(b);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(extremes_are_found_dense_and_by_lanczos),
        cmocka_unit_test(indefinite_matrices_are_told),
        cmocka_unit_test(reciprocity_and_symmetrizing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
