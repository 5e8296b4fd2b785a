/// Contact stiffness, energy around closed tool paths, and the nearest positive block.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>
#include <lapacke.h>

#include "src/certificate/certificate.h"
#include "src/certificate/contact_stiffness.h"
#include "src/certificate/repair.h"

static void closed_paths_return_the_skew_part(void **state) {
    (void)state;
    // F = k u + a e_z x u: a circle in the xy plane does the work 2 pi a, the energy is k / 2
    const double k = 500.0, a = 20.0;
    double stiffness[9] = {k, -a, 0, a, k, 0, 0, 0, k};
    // 360 chords enclose a little less than the circle: (sin x)/x at x = 2 pi / 360
    assert_true(fabs(pal_loop_energy(stiffness) / (2 * M_PI * a / (k / 2)) - 1) < 1e-4);
    double symmetric[9] = {k, a, 0, a, k, 3, 0, 3, 2 * k};
    assert_true(pal_loop_energy(symmetric) < 1e-14);
    // the folded figure eight sees skew parts of two planes even where circles cancel none
    double other[9] = {k, 0, a, 0, k, 0, -a, 0, k};
    assert_true(pal_loop_energy(other) > 0.9 * 2 * M_PI * a / (k / 2));
}

static void contact_stiffness_sums_the_inverse_block(void **state) {
    (void)state;
    enum { T = 5, N = 3 * T };
    double c[N * N];
    for (int j = 0; j < N; j++) {
        for (int i = 0; i < N; i++) {
            c[j * N + i] = (i == j ? 4.0 : 0.0) + sin(1.0 + i + 3.0 * j); // nonsymmetric
        }
    }
    const int32_t set[2] = {3, 1};
    double a[9], block[36], inverse[36];
    assert_int_equal(pal_contact_stiffness(c, T, set, 2, a), PALPATE_OK);
    for (int j = 0; j < 6; j++) {
        for (int i = 0; i < 6; i++) {
            block[j * 6 + i] = c[(3 * set[j / 3] + j % 3) * N + 3 * set[i / 3] + i % 3];
        }
    }
    lapack_int pivot[6];
    memcpy(inverse, block, sizeof inverse);
    assert_int_equal(LAPACKE_dgetrf(LAPACK_COL_MAJOR, 6, 6, inverse, 6, pivot), 0);
    assert_int_equal(LAPACKE_dgetri(LAPACK_COL_MAJOR, 6, inverse, 6, pivot), 0);
    for (int r = 0; r < 3; r++) {
        for (int k = 0; k < 3; k++) {
            double sum = 0;
            for (int i = r; i < 6; i += 3) {
                for (int j = k; j < 6; j += 3) {
                    sum += inverse[j * 6 + i];
                }
            }
            assert_true(fabs(a[3 * r + k] - sum) < 1e-12 * (1 + fabs(sum)));
        }
    }
    memset(c, 0, sizeof c);
    assert_int_equal(pal_contact_stiffness(c, T, set, 2, a), PALPATE_ERROR_SINGULAR);
}

static void clipping_gives_the_nearest_positive_block(void **state) {
    (void)state;
    enum { N = 40 };
    double v[N], vv = 0, w[N], *c = malloc(sizeof *c * N * N), *sym = malloc(sizeof *sym * N * N);
    for (int i = 0; i < N; i++) {
        v[i] = cos(0.7 * i);
        vv += v[i] * v[i];
        w[i] = i < 3 ? -0.1 * (i + 1) : 0.5 + i;
    }
    for (int j = 0; j < N; j++) { // Q diag(w) Q^T, Q a reflection, plus a skew part
        for (int i = 0; i < N; i++) {
            double s = 0;
            for (int k = 0; k < N; k++) {
                s += ((i == k) - 2 * v[i] * v[k] / vv) * w[k] * ((j == k) - 2 * v[j] * v[k] / vv);
            }
            c[j * N + i] = s + (i < j ? 0.3 : i > j ? -0.3 : 0.0);
            sym[j * N + i] = s;
        }
    }
    double norm = 0, change = 0, off = 0, lo, hi;
    for (int i = 0; i < N * N; i++) {
        norm += c[i] * c[i];
    }
    assert_int_equal(pal_repair_positive(c, N, 1e-3, &change, NULL), PALPATE_OK);
    double least = 1e-3 * w[N - 1], expect = 0;
    for (int k = 0; k < 3; k++) {
        expect += (least - w[k]) * (least - w[k]);
    }
    assert_true(fabs(change - sqrt(expect / norm)) < 1e-12);
    for (int i = 0; i < N * N; i++) {
        off += (c[i] - sym[i]) * (c[i] - sym[i]);
    }
    assert_true(fabs(off - expect) <
                1e-10); // no symmetric block with that floor is nearer (Higham 1988)
    int positive = 0;
    assert_true(pal_reciprocity_error(c, N) == 0.0);
    assert_int_equal(pal_extreme_eigenvalues(c, N, &lo, &hi, &positive, NULL), PALPATE_OK);
    assert_true(positive && fabs(lo - least) < 1e-12 * w[N - 1]);
    // a positive block keeps its bits
    memcpy(sym, c, sizeof *c * N * N);
    assert_int_equal(pal_repair_positive(c, N, 1e-4, &change, NULL), PALPATE_OK);
    assert_memory_equal(sym, c, sizeof *c * N * N);
    assert_true(change == 0.0);
    pal_error e = {0};
    assert_int_equal(pal_repair_positive(c, PALPATE_REPAIR_MAX + 1, 1e-3, &change, &e),
                     PALPATE_ERROR_UNSUPPORTED);
    assert_non_null(strstr(e.message, "repair: symmetrize"));
    for (int i = 0; i < N * N; i++) {
        c[i] = -(i % (N + 1) == 0);
    }
    assert_int_equal(pal_repair_positive(c, N, 1e-3, &change, NULL), PALPATE_ERROR_SINGULAR);
    free(c);
    free(sym);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_paths_return_the_skew_part),
        cmocka_unit_test(contact_stiffness_sums_the_inverse_block),
        cmocka_unit_test(clipping_gives_the_nearest_positive_block),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
