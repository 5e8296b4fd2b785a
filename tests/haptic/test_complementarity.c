/// The contact solver against enumeration (every active set tried) and Lemke's pivoting on random
/// problems, ill-conditioned, skew and degenerate ones included; warm start, early stop,
/// repeatability.
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

#include "haptic/solver/complementarity.h"
#include "tests/support/random_problems.h"

enum { MAX = 40 };

typedef struct problem {
    int n;
    double m[MAX * MAX], q[MAX], condition, skew;
} problem;

static void random_positive_matrix(problem *p, int n, double condition, double skew, int cone) {
    p->n = n;
    p->condition = condition;
    p->skew = skew;
    random_matrix(n, condition, skew, cone, p->m);
}

/// q of random entries, or from a known solution of which a third is degenerate (z_i = w_i = 0).
static void random_vector(problem *p, int degenerate) {
    for (int i = 0; i < p->n; i++) {
        p->q[i] = random_uniform();
    }
    for (int i = 0; degenerate && i < p->n; i++) {
        double z = random_uniform();
        p->q[i] = i % 3 == 0 ? fabs(z) : 0; // w of the solution
    }
    for (int j = 0; degenerate && j < p->n; j++) {
        double z = j % 3 == 1 ? 0.5 + 0.5 * fabs(random_uniform()) : 0;
        for (int i = 0; i < p->n; i++) {
            p->q[i] -= p->m[i + j * p->n] * z;
        }
    }
}

static void random_problem(problem *p, int n) {
    int kind = (int)(16 * (0.5 + 0.5 * random_uniform()));
    double condition = pow(10, 3 + 3 * random_uniform()), skew = 0.15 + 0.15 * random_uniform();
    if (kind & 8) { // half of them at the far end
        condition = 1e6;
        skew = 0.3;
    }
    random_positive_matrix(p, n, condition, kind & 1 ? skew : 0, (kind & 2) != 0);
    random_vector(p, (kind & 4) != 0 && n > 3);
}

/// The measure of issue 5: || min(z, M z + q) || / || q ||, and the worst of z below 0.
static double natural(const problem *p, const double *z) {
    double sum = 0, norm = 0;
    for (int i = 0; i < p->n; i++) {
        double w = p->q[i];
        for (int j = 0; j < p->n; j++) {
            w += p->m[i + j * p->n] * z[j];
        }
        double r = fmin(z[i], w);
        sum += r * r;
        norm += p->q[i] * p->q[i];
    }
    return norm > 0 ? sqrt(sum / norm) : sqrt(sum);
}

static pal_lcp_result solve(const problem *p, int iterations, uint8_t *active, double *z,
                            double *w) {
    static double work[MAX * (MAX + 10)];
    assert_true(pal_lcp_bytes(MAX) <= sizeof work);
    pal_lcp lcp = {.n = p->n, .m = p->m, .ld = p->n, .symmetric = p->skew <= 0, .q = p->q};
    return pal_lcp_solve(&lcp, iterations, active, z, w, work);
}

/// Every active set: keep the one whose violation is least. Independent of any pivoting rule.
static void enumerate(const problem *p, double *z) {
    double best = INFINITY;
    for (unsigned set = 0; set < 1u << p->n; set++) {
        double a[MAX * MAX], b[MAX], trial[MAX] = {0};
        int index[MAX], k = 0;
        for (int i = 0; i < p->n; i++) {
            if (set >> i & 1) {
                index[k++] = i;
            }
        }
        for (int j = 0; j < k; j++) {
            b[j] = -p->q[index[j]];
            for (int i = 0; i < k; i++) {
                a[i + j * k] = p->m[index[i] + index[j] * p->n];
            }
        }
        lapack_int pivot[MAX];
        if (k > 0 && LAPACKE_dgesv(LAPACK_COL_MAJOR, k, 1, a, k, pivot, b, k) != 0) {
            continue;
        }
        for (int j = 0; j < k; j++) {
            trial[index[j]] = b[j];
        }
        double r = natural(p, trial);
        if (r < best) {
            best = r;
            memcpy(z, trial, sizeof trial);
        }
    }
}

/// Lemke's complementary pivoting on the tableau w - M z - e z0 = q, ties broken by the larger
/// pivot.
/// @return 0 when it ended on a ray or took too many pivots
static int lemke(const problem *p, double *z) {
    enum { WIDTH = 2 * MAX + 2 };
    static double t[MAX][WIDTH];
    int n = p->n, z0 = 2 * n, rhs = 2 * n + 1, basis[MAX];
    int row = 0;
    for (int i = 0; i < n; i++) {
        memset(t[i], 0, sizeof t[i]);
        t[i][i] = 1;
        for (int j = 0; j < n; j++) {
            t[i][n + j] = -p->m[i + j * n];
        }
        t[i][z0] = -1;
        t[i][rhs] = p->q[i];
        basis[i] = i;
        row = p->q[i] < p->q[row] ? i : row;
        z[i] = 0;
    }
    if (p->q[row] >= 0) {
        return 1;
    }
    int entering = z0;
    for (int pivots = 0; pivots < 50 * n + 50; pivots++) {
        int leaving = basis[row];
        double d = t[row][entering];
        for (int j = 0; j <= rhs; j++) {
            t[row][j] /= d;
        }
        for (int i = 0; i < n; i++) {
            double f = t[i][entering];
            for (int j = 0; i != row && f != 0 && j <= rhs; j++) {
                t[i][j] -= f * t[row][j];
            }
        }
        basis[row] = entering;
        if (leaving == z0) {
            for (int i = 0; i < n; i++) {
                if (basis[i] >= n) {
                    z[basis[i] - n] = fmax(t[i][rhs], 0);
                }
            }
            return 1;
        }
        entering = leaving < n ? leaving + n : leaving - n;
        row = -1;
        double least = INFINITY;
        for (int i = 0; i < n; i++) {
            if (t[i][entering] > 1e-11) {
                double ratio = fmax(t[i][rhs], 0) / t[i][entering];
                if (ratio < least || (ratio <= least && basis[i] == z0)) {
                    least = ratio;
                    row = i;
                }
            }
        }
        if (row < 0) {
            return 0;
        }
    }
    return 0;
}

/// Distance of two solutions in the gaps they leave, relative to q: M may have a condition of 1e6,
/// so the forces themselves are known to 1e6 rounding errors only.
static double gap_distance(const problem *p, const double *a, const double *b) {
    double sum = 0, norm = 0;
    for (int i = 0; i < p->n; i++) {
        double d = 0;
        for (int j = 0; j < p->n; j++) {
            d += p->m[i + j * p->n] * (a[j] - b[j]);
        }
        sum += d * d;
        norm += p->q[i] * p->q[i];
    }
    return sqrt(sum / norm);
}

static void agrees_with_enumeration(void **state) {
    (void)state;
    random_seed(11);
    double worst = 0;
    for (int i = 0; i < 600; i++) {
        problem p;
        double z[MAX], w[MAX], exact[MAX];
        uint8_t active[MAX] = {0};
        random_problem(&p, 1 + i % 9);
        pal_lcp_result r = solve(&p, PALPATE_LCP_ITERATIONS, active, z, w);
        assert_int_equal(r.state, PALPATE_LCP_SOLVED);
        enumerate(&p, exact);
        worst = fmax(worst, gap_distance(&p, z, exact));
        assert_true(natural(&p, z) < 1e-6);
    }
    print_message("  600 problems against enumeration: gaps agree to %.1e\n", worst);
    // rounding: condition 1e6 x a few units of the last place x n
    assert_true(worst < 1e-8);
}

/// Issue 5: m to 40, condition to 1e6, skew to 0.3.
static void ten_thousand_random_problems(void **state) {
    (void)state;
    enum { COUNT = 10000 };
    static int iterations[COUNT];
    random_seed(2026);
    int flagged = 0, refused = 0, compared = 0;
    double worst = 0, worst_gap = 0;
    for (int i = 0; i < COUNT; i++) {
        problem p;
        double z[MAX], w[MAX], other[MAX];
        uint8_t active[MAX] = {0};
        random_problem(&p, 1 + (int)(MAX * (0.5 + 0.499999 * random_uniform())));
        pal_lcp_result r = solve(&p, PALPATE_LCP_ITERATIONS, active, z, w);
        iterations[i] = r.iterations;
        flagged += r.state != PALPATE_LCP_SOLVED;
        double residual = natural(&p, z);
        worst = fmax(worst, residual);
        for (int k = 0; k < p.n; k++) {
            assert_true(z[k] >= 0 && isfinite(z[k]));
        }
        // Lemke keeps a tableau that gathers rounding: compare where its answer is one
        if (lemke(&p, other) && natural(&p, other) < 1e-9) {
            compared++;
            worst_gap = fmax(worst_gap, gap_distance(&p, z, other));
        } else {
            refused++;
        }
    }
    qsort(iterations, COUNT, sizeof *iterations, rising_int);
    print_message("  %d problems, m <= %d: residual <= %.1e, %d flagged\n", COUNT, MAX, worst,
                  flagged);
    print_message("  iterations p50 %d, p99 %d, worst %d\n", iterations[COUNT / 2],
                  iterations[COUNT - COUNT / 100], iterations[COUNT - 1]);
    print_message("  Lemke answered %d of them (%d lost to rounding): gaps agree to %.1e\n",
                  compared, refused, worst_gap);
    assert_true(worst < 1e-6);
    assert_true(flagged <= COUNT / 1000);
    assert_true(compared > COUNT * 9 / 10); // the comparison is one
    assert_true(worst_gap < 1e-6);          // both residuals are below 1e-6
}

/// A tick later: q has moved a little. The last set is a start that saves iterations, not a
/// constraint.
static void warm_start_saves_iterations(void **state) {
    (void)state;
    random_seed(5);
    long cold_sum = 0, warm_sum = 0;
    for (int i = 0; i < 500; i++) {
        problem p;
        double z[MAX], w[MAX], again[MAX];
        uint8_t active[MAX] = {0}, cold[MAX] = {0};
        random_positive_matrix(&p, 30, 1e3, i % 2 ? 0.2 : 0, 0);
        random_vector(&p, 0);
        assert_int_equal(solve(&p, PALPATE_LCP_ITERATIONS, active, z, w).state, PALPATE_LCP_SOLVED);
        assert_int_equal(solve(&p, PALPATE_LCP_ITERATIONS, active, again, w).iterations, 1);
        assert_memory_equal(z, again, (size_t)p.n * sizeof *z);
        for (int k = 0; k < p.n; k++) {
            p.q[k] += 0.03 * random_uniform();
        }
        pal_lcp_result warm = solve(&p, PALPATE_LCP_ITERATIONS, active, z, w);
        pal_lcp_result fresh = solve(&p, PALPATE_LCP_ITERATIONS, cold, again, w);
        assert_int_equal(warm.state, PALPATE_LCP_SOLVED);
        assert_int_equal(fresh.state, PALPATE_LCP_SOLVED);
        assert_memory_equal(z, again, (size_t)p.n * sizeof *z); // the same set: the same bits
        assert_memory_equal(active, cold, (size_t)p.n);
        warm_sum += warm.iterations;
        cold_sum += fresh.iterations;
    }
    print_message("  mean iterations: warm %.2f, cold %.2f\n", (double)warm_sum / 500,
                  (double)cold_sum / 500);
    assert_true(2 * warm_sum < cold_sum);
}

/// Cut off after k iterations: flagged, z >= 0, w of that z, never worse than k - 1 iterations or z
/// = 0.
static void early_stop_is_usable_and_flagged(void **state) {
    (void)state;
    random_seed(9);
    int cut = 0;
    for (int i = 0; i < 300; i++) {
        problem p;
        double z[MAX], w[MAX], before = INFINITY;
        random_positive_matrix(&p, 40, 1e6, i % 2 ? 0.3 : 0, 0);
        random_vector(&p, 0);
        double zero = 0, norm = 0;
        for (int k = 0; k < p.n; k++) {
            zero += pow(fmin(p.q[k], 0), 2);
            norm += pow(p.q[k], 2);
        }
        before = sqrt(zero / norm) * (1 + 1e-14);
        for (int k = 1; k <= 12; k++) {
            uint8_t active[MAX] = {0};
            pal_lcp_result r = solve(&p, k, active, z, w);
            assert_true(r.iterations <= k);
            assert_true(r.residual <= before);
            before = r.residual;
            cut += r.state == PALPATE_LCP_CUT_OFF;
            for (int a = 0; a < p.n; a++) {
                double gap = p.q[a], size = fabs(p.q[a]);
                for (int b = 0; b < p.n; b++) {
                    gap += p.m[a + b * p.n] * z[b];
                    size += fabs(p.m[a + b * p.n] * z[b]);
                }
                assert_true(z[a] >= 0);
                assert_true(fabs(gap - w[a]) <= 100 * DBL_EPSILON * size);
            }
            if (r.state == PALPATE_LCP_SOLVED) {
                assert_true(r.residual < 1e-6);
                break;
            }
        }
    }
    assert_true(cut > 300); // it was cut off indeed
}

/// Block pivoting alone cycles here (the last problem); Lemke's pivots must take over and end.
static void lemke_ends_where_block_pivots_cycle(void **state) {
    (void)state;
    // Murty's exponential example, lower triangular with 2 below the diagonal: a P-matrix
    problem p = {.n = 8, .condition = 1, .skew = 1};
    for (int j = 0; j < 8; j++) {
        p.q[j] = -1;
        for (int i = 0; i < 8; i++) {
            p.m[i + j * 8] = i == j ? 1 : i < j ? 2 : 0;
        }
    }
    double z[MAX], w[MAX], exact[MAX];
    for (unsigned start = 0; start < 256; start++) {
        uint8_t active[MAX] = {0};
        for (int i = 0; i < 8; i++) {
            active[i] = start >> i & 1;
        }
        pal_lcp_result r = solve(&p, 1000, active, z, w);
        assert_int_equal(r.state, PALPATE_LCP_SOLVED);
        assert_true(natural(&p, z) < 1e-12);
    }
    enumerate(&p, exact);
    assert_true(gap_distance(&p, z, exact) < 1e-12);
    // cyclic P-matrix on which exchanging all wrong unknowns returns to the start
    problem c = {
        .n = 3, .condition = 1, .skew = 1, .m = {1, 0, 2, 2, 1, 0, 0, 2, 1}, .q = {-1, -1, -1}};
    for (unsigned start = 0; start < 8; start++) {
        uint8_t active[MAX] = {start & 1, start >> 1 & 1, start >> 2 & 1};
        pal_lcp_result r = solve(&c, 1000, active, z, w);
        assert_int_equal(r.state, PALPATE_LCP_SOLVED);
        for (int i = 0; i < 3; i++) {
            assert_true(fabs(z[i] - 1.0 / 3) < 1e-14);
        }
    }
}

static void refuses_what_is_not_positive(void **state) {
    (void)state;
    problem p = {.n = 2, .condition = 1, .skew = 1, .m = {0, 0, 0, 0}, .q = {-1, 2}};
    double z[MAX], w[MAX];
    uint8_t active[MAX] = {1, 1};
    pal_lcp_result r = solve(&p, 10, active, z, w);
    assert_int_equal(r.state, PALPATE_LCP_SINGULAR);
    assert_true(z[0] == 0 && z[1] == 0 && w[0] == -1 && w[1] == 2);
    assert_false(active[0] || active[1]);
    // nothing touched, nothing to do
    problem free = {
        .n = 3, .condition = 1, .skew = 0, .m = {1, 0, 0, 0, 1, 0, 0, 0, 1}, .q = {1, 0, 2}};
    uint8_t none[MAX] = {0};
    r = solve(&free, 10, none, z, w);
    assert_int_equal(r.state, PALPATE_LCP_SOLVED);
    assert_true(z[0] == 0 && z[1] == 0 && z[2] == 0 && r.residual == 0);
    pal_lcp empty = {0};
    assert_int_equal(pal_lcp_solve(&empty, 10, none, z, w, z).state, PALPATE_LCP_SOLVED);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(agrees_with_enumeration),
        cmocka_unit_test(ten_thousand_random_problems),
        cmocka_unit_test(warm_start_saves_iterations),
        cmocka_unit_test(early_stop_is_usable_and_flagged),
        cmocka_unit_test(lemke_ends_where_block_pivots_cycle),
        cmocka_unit_test(refuses_what_is_not_positive),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
