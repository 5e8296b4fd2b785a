/// Coulomb friction on random and on contact-like problems: the conditions themselves, an
/// independent slow solver (De Saxce's cone and small steps), every solution of one point,
/// pal_lcp_solve without friction, early stop, repeatability. (Patches over many ticks:
/// test_friction_rolled.c.)
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/solver/complementarity.h"
#include "haptic/base/dense.h"
#include "tests/support/friction_problem.h"
#include "tests/support/random_problems.h"

/// Independent and slow: f <- P_K(f - step (w + mu |w_t| n)), P_K onto the second-order cone itself
/// (De Saxce, Feng 1998), with the extragradient's second evaluation.
static int slow(const friction_problem *p, double *f) {
    double step = 0.4 / (matrix_norm(p->n, p->m)), g[MAX], w[MAX];
    memset(f, 0, (size_t)p->n * sizeof *f);
    for (int k = 0; k < 200000; k++) {
        double change = 0;
        memcpy(g, f, (size_t)p->n * sizeof *f);
        for (int half = 0; half < 2; half++) {
            friction_gaps(p, g, w);
            for (int i = 0; i < p->points; i++) {
                const double *a = f + 3 * i, *b = w + 3 * i;
                double mu = p->mu[i], n = a[0] - step * (b[0] + mu * hypot(b[1], b[2]));
                double t1 = a[1] - step * b[1], t2 = a[2] - step * b[2], t = hypot(t1, t2);
                double *to = g + 3 * i;
                if (t > mu * n) {
                    double on = mu * t <= -n ? 0 : (n + mu * t) / (1 + mu * mu);
                    n = on;
                    t1 = t > 0 ? t1 * mu * on / t : 0;
                    t2 = t > 0 ? t2 * mu * on / t : 0;
                }
                to[0] = n;
                to[1] = t1;
                to[2] = t2;
            }
        }
        for (int i = 0; i < p->n; i++) {
            change = fmax(change, fabs(g[i] - f[i]));
        }
        memcpy(f, g, (size_t)p->n * sizeof *f);
        if (change < 1e-14) {
            break;
        }
    }
    return friction_natural(p, f) < 1e-10;
}

/// Moderate coupling, where the law has one solution: the forces themselves must agree.
static void agrees_with_small_steps(void **state) {
    (void)state;
    random_seed(3);
    enum { COUNT = 2000 };
    double worst = 0;
    int compared = 0;
    for (int i = 0; i < COUNT; i++) {
        static friction_problem p;
        double f[MAX] = {0}, w[MAX], other[MAX];
        uint8_t kind[POINTS] = {0};
        friction_random_matrix(&p, 1 + i % 12, i % 2 ? 3 : 10, i % 3 ? 0 : 0.3, i % 2);
        friction_random_vector(&p, 0, i % 4 < 2 ? 0.3 : 0.6);
        pal_friction_result r = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        friction_assert_in_cones(&p, f);
        assert_true(friction_natural(&p, f) < 1e-6);
        if (slow(&p, other)) {
            compared++;
            worst = fmax(worst, friction_distance(p.n, f, other));
        }
    }
    print_message("  %d of %d problems against small steps: forces agree to %.1e\n", compared,
                  COUNT, worst);
    assert_true(compared > COUNT * 9 / 10);
    assert_true(worst < 1e-7); // residual 1e-9 x condition 10, relative to forces smaller than q
}

/// Every solution of one point: open, stick, and the roots of the slip condition over the angle.
static int all_of_one_point(const friction_problem *p, double found[][3]) {
    const double *m = p->m, *q = p->q;
    double mu = p->mu[0];
    int count = 0;
    if (q[0] >= 0) {
        memset(found[count++], 0, sizeof found[0]);
    }
    // stick: Cramer's rule
    double c[3][3], det = 0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            int a = (i + 1) % 3, b = (i + 2) % 3, d = (j + 1) % 3, e = (j + 2) % 3;
            c[i][j] = m[a + 3 * d] * m[b + 3 * e] - m[a + 3 * e] * m[b + 3 * d];
        }
    }
    for (int j = 0; j < 3; j++) {
        det += m[3 * j] * c[0][j];
    }
    for (int j = 0; j < 3; j++) {
        found[count][j] = -(c[0][j] * q[0] + c[1][j] * q[1] + c[2][j] * q[2]) / det;
    }
    count += found[count][0] > 0 && hypot(found[count][1], found[count][2]) <= mu * found[count][0];
    // slip: f = n (1, mu d), w_n = 0; w_t across d must vanish and be against it
    enum { ANGLES = 20000 };
    double before = 0, across, along, n = 0;
    for (int k = 0; k <= ANGLES; k++) {
        double angle = 6.283185307179586 * k / ANGLES, low = angle - 6.283185307179586 / ANGLES,
               high = angle;
        for (int pass = 0; pass < 60; pass++) {
            double d[2] = {cos(angle), sin(angle)};
            double slope = m[0] + mu * (m[3] * d[0] + m[6] * d[1]), w[2];
            for (int i = 0; i < 2; i++) {
                w[i] =
                    q[i + 1] * slope - q[0] * (m[i + 1] + mu * (m[i + 4] * d[0] + m[i + 7] * d[1]));
            }
            across = d[0] * w[1] - d[1] * w[0];
            along = (d[0] * w[0] + d[1] * w[1]) / slope;
            n = -q[0] / slope;
            if (pass == 0) {
                if (k == 0 || across * before > 0) {
                    break;
                }
            } else if (across * before > 0) {
                low = angle;
            } else {
                high = angle;
            }
            if (pass == 59 && n > 0 && along < 0 && count < 8) {
                found[count][0] = n;
                found[count][1] = mu * n * d[0];
                found[count++][2] = mu * n * d[1];
            }
            angle = 0.5 * (low + high);
        }
        double d[2] = {cos(6.283185307179586 * k / ANGLES), sin(6.283185307179586 * k / ANGLES)};
        double slope = m[0] + mu * (m[3] * d[0] + m[6] * d[1]), w[2];
        for (int i = 0; i < 2; i++) {
            w[i] = q[i + 1] * slope - q[0] * (m[i + 1] + mu * (m[i + 4] * d[0] + m[i + 7] * d[1]));
        }
        before = d[0] * w[1] - d[1] * w[0];
    }
    return count;
}

static void one_point_is_one_of_its_solutions(void **state) {
    (void)state;
    random_seed(17);
    int several = 0, kinds[3] = {0}, least_several = 0;
    double worst = 0;
    for (int i = 0; i < 400; i++) {
        static friction_problem p;
        double f[MAX] = {0}, w[MAX], found[10][3];
        uint8_t kind[POINTS] = {0};
        friction_random_matrix(&p, 1, i % 2 ? 10 : 100, i % 3 ? 0 : 0.3, i % 2);
        friction_random_vector(&p, 0.05, 1.5);
        pal_friction_result r = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        int count = all_of_one_point(&p, found);
        assert_true(count >= 1);
        double nearest = INFINITY;
        for (int k = 0; k < count; k++) {
            nearest = fmin(nearest, friction_distance(3, f, found[k]));
        }
        several += count > 1;
        least_several += count > 1 && p.mu[0] < 0.3;
        worst = fmax(worst, nearest);
        kinds[kind[0]]++;
    }
    print_message(
        "  400 points: nearest solution within %.1e; %d open, %d stick, %d slip; %d with several "
        "solutions (%d of them below mu = 0.3)\n",
        worst, kinds[0], kinds[1], kinds[2], several, least_several);
    assert_true(worst < 1e-6); // residual 1e-9 x condition 100
    assert_true(kinds[0] > 20 && kinds[1] > 20 && kinds[2] > 20);
}

static void thousands_of_random_problems(void **state) {
    (void)state;
    enum { COUNT = 6000 };
    static int iterations[COUNT];
    random_seed(2026);
    int flagged = 0;
    double worst = 0;
    for (int i = 0; i < COUNT; i++) {
        static friction_problem p;
        double f[MAX] = {0}, w[MAX];
        uint8_t kind[POINTS] = {0};
        double condition = pow(10, 6 * random_positive()),
               skew = random_uniform() > 0 ? 0.3 * random_positive() : 0;
        if (i % 4 == 0) { // a quarter at the far end
            condition = 1e6;
            skew = i % 8 == 0 ? 0.3 : 0;
        }
        friction_random_matrix(&p, 1 + (int)(15.999 * random_positive()), condition, skew, i % 2);
        friction_random_vector(&p, 0, 1.5);
        for (int k = 0; k < p.points; k++) {
            // frictionless tools beside it, and held points
            p.mu[k] = (i + k) % 9 == 0 ? 0 : (i + k) % 23 == 0 ? -1 : p.mu[k];
        }
        friction_drop_idle_rows(&p);
        pal_friction_result r = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        iterations[i] = r.iterations;
        friction_assert_in_cones(&p, f);
        if (r.state == PALPATE_FRICTION_SOLVED) {
            worst = fmax(worst, friction_natural(&p, f));
        } else {
            flagged++;
            print_message("  flagged: m %d, condition %.1e, skew %.2f, residual %.1e\n", p.points,
                          condition, skew, r.residual);
        }
    }
    qsort(iterations, COUNT, sizeof *iterations, rising_int);
    print_message("  %d problems, m <= 16, mu <= 1.5: residual <= %.1e, %d flagged\n", COUNT, worst,
                  flagged);
    print_message("  iterations p50 %d, p99 %d, worst %d\n", iterations[COUNT / 2],
                  iterations[COUNT - COUNT / 100], iterations[COUNT - 1]);
    assert_true(worst < 1e-6);
    assert_true(flagged <= COUNT / 1000);
}

static void without_friction_is_the_lcp(void **state) {
    (void)state;
    random_seed(8);
    for (int i = 0; i < 300; i++) {
        static friction_problem p;
        static double work[POINTS * (POINTS + 10)];
        double f[MAX] = {0}, w[MAX], z[POINTS], gaps[POINTS];
        uint8_t kind[POINTS] = {0}, active[POINTS] = {0};
        friction_random_matrix(&p, 1 + i % 16, 1e4, i % 2 ? 0.3 : 0, i % 4 < 2);
        friction_random_vector(&p, 0, 0);
        int m = p.points;
        friction_drop_idle_rows(&p);
        assert_int_equal(p.n, m);
        pal_lcp lcp = {m, p.m, m, p.symmetric, p.q};
        assert_true(pal_lcp_bytes(m) <= sizeof work);
        pal_lcp_result a = pal_lcp_solve(&lcp, PALPATE_LCP_ITERATIONS, active, z, gaps, work);
        pal_friction_result b = friction_solve(&p, PALPATE_LCP_ITERATIONS, kind, f, w);
        assert_int_equal(a.state, PALPATE_LCP_SOLVED);
        assert_int_equal(b.state, PALPATE_FRICTION_SOLVED);
        assert_int_equal(a.iterations, b.iterations);
        assert_memory_equal(f, z, (size_t)m * sizeof *z);
        assert_memory_equal(w, gaps, (size_t)m * sizeof *z);
        for (int j = 0; j < m; j++) {
            assert_int_equal(kind[j], z[j] > 0 ? PALPATE_POINT_SLIP : PALPATE_POINT_OPEN);
        }
        // one point with friction, far away: the others by Newton's method, the same forces
        static friction_problem far;
        friction_random_matrix(&far, 1 + i % 16, 100, i % 2 ? 0.3 : 0, i % 4 < 2);
        friction_random_vector(&far, 0, 0);
        far.q[0] = 10;
        p = far;
        friction_drop_idle_rows(&p);
        far.mu[0] = 0.5;
        friction_drop_idle_rows(&far);
        double g[MAX] = {0};
        uint8_t other[POINTS] = {0};
        memset(kind, 0, sizeof kind);
        memset(f, 0, sizeof f);
        friction_solve(&p, PALPATE_LCP_ITERATIONS, kind, f, w);
        pal_friction_result c = friction_solve(&far, PALPATE_FRICTION_ITERATIONS, other, g, w);
        assert_int_equal(c.state, PALPATE_FRICTION_SOLVED);
        memmove(g + 1, g + 3, sizeof g - 3 * sizeof *g);
        if (f[0] <= 0) { // as it is where the others' forces do not draw it in
            assert_true(friction_distance(p.n, g, f) < 1e-6); // 1e-9 of || q || 10 x condition 100
        }
    }
}

/// All held: the linear system. One held beside sliding ones: its gap is closed whatever pulls.
static void held_points_are_bonded(void **state) {
    (void)state;
    random_seed(12);
    for (int i = 0; i < 100; i++) {
        static friction_problem p;
        static double lu[MAX * MAX];
        double f[MAX] = {0}, w[MAX], x[MAX];
        int32_t pivot[MAX];
        uint8_t kind[POINTS] = {0};
        friction_random_matrix(&p, 1 + i % 12, 100, i % 2 ? 0.3 : 0, 0);
        friction_random_vector(&p, 0.3, 0.6);
        for (int k = 0; k < p.points; k++) {
            p.mu[k] = -1;
        }
        memcpy(lu, p.m, sizeof lu);
        for (int k = 0; k < p.n; k++) {
            x[k] = -p.q[k];
        }
        assert_int_equal(pal_dense_lu(p.n, lu, p.n, pivot), 0);
        pal_dense_lu_solve(p.n, lu, p.n, pivot, 1, x, p.n);
        pal_friction_result r = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        assert_int_equal(r.iterations, 1);
        assert_true(friction_distance(p.n, f, x) < 1e-11); // condition 100
        for (int k = 1; k < p.points; k++) {
            p.mu[k] = 0.4;
        }
        r = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        assert_true(friction_natural(&p, f) < 1e-6);
        assert_int_equal(kind[0], PALPATE_POINT_STICK);
    }
}

/// Solved again from its own answer: no step, the same bits. From last tick's: fewer steps.
static void starts_warm_and_repeats(void **state) {
    (void)state;
    random_seed(21);
    long warm_sum = 0, cold_sum = 0;
    for (int i = 0; i < 300; i++) {
        static friction_problem p;
        double f[MAX] = {0}, w[MAX], g[MAX], cold[MAX] = {0}, again[MAX] = {0};
        uint8_t kind[POINTS] = {0}, fresh[POINTS] = {0}, second[POINTS] = {0};
        friction_random_matrix(&p, 12, 100, i % 2 ? 0.2 : 0, 0);
        friction_random_vector(&p, 0.1, 0.8);
        assert_int_equal(friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w).state,
                         PALPATE_FRICTION_SOLVED);
        memcpy(g, f, sizeof g);
        assert_int_equal(friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w).iterations, 0);
        assert_memory_equal(f, g, (size_t)p.n * sizeof *f);
        for (int k = 0; k < p.n; k++) {
            p.q[k] += 0.02 * random_uniform();
        }
        pal_friction_result a = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        pal_friction_result b = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, fresh, cold, w);
        pal_friction_result c = friction_solve(&p, PALPATE_FRICTION_ITERATIONS, second, again, w);
        assert_int_equal(a.state, PALPATE_FRICTION_SOLVED);
        assert_int_equal(b.state, PALPATE_FRICTION_SOLVED);
        assert_int_equal(b.iterations, c.iterations);
        assert_memory_equal(cold, again, (size_t)p.n * sizeof *f);
        assert_memory_equal(fresh, second, (size_t)p.points);
        warm_sum += a.iterations;
        cold_sum += b.iterations;
    }
    print_message("  mean iterations: warm %.2f, cold %.2f\n", (double)warm_sum / 300,
                  (double)cold_sum / 300);
    assert_true(4 * warm_sum < 3 * cold_sum);
}

/// Cut off after k iterations: flagged, in the cones, w of that f, no worse than f = 0.
static void early_stop_is_usable_and_flagged(void **state) {
    (void)state;
    random_seed(9);
    int cut = 0;
    for (int i = 0; i < 200; i++) {
        static friction_problem p;
        friction_random_matrix(&p, 16, 1e6, i % 2 ? 0.3 : 0, 0);
        friction_random_vector(&p, 0, 1.5);
        double zero[MAX] = {0};
        for (int k = 1; k <= 8; k++) {
            double f[MAX], w[MAX], own[MAX];
            uint8_t kind[POINTS];
            for (int j = 0; j < p.n; j++) {
                f[j] = 10 * random_uniform(); // any finite start
                kind[j / 3] = (uint8_t)(j % 3);
            }
            pal_friction_result r = friction_solve(&p, k, kind, f, w);
            assert_true(r.iterations <= k);
            friction_assert_in_cones(&p, f);
            // the header's residual weighs forces by d <= 1: no worse than f = 0 there, so at most
            // 1 / d of it here; zero's is the norm of the violated part
            assert_true(r.residual <= friction_natural(&p, zero) * (1 + 1e-12));
            friction_gaps(&p, f, own);
            for (int j = 0; j < p.n; j++) {
                assert_true(fabs(own[j] - w[j]) <= 1e-12 * (1 + fabs(f[0])) * p.n);
            }
            cut += r.state != PALPATE_FRICTION_SOLVED;
            assert_true(r.state != PALPATE_FRICTION_SOLVED || friction_natural(&p, f) < 1e-6);
        }
    }
    print_message("  %d of 1600 were cut off\n", cut);
    assert_true(cut > 300);
}

static void small_cases(void **state) {
    (void)state;
    pal_friction empty = {0};
    double f[6] = {0}, w[6], work[400];
    uint8_t kind[2] = {0};
    assert_int_equal(pal_friction_solve(&empty, 10, kind, f, w, work).state,
                     PALPATE_FRICTION_SOLVED);
    // a block on a table: pressed 2, dragged by 1 through unit springs; mu decides
    double m[9] = {1, 0, 0, 0, 1, 0, 0, 0, 1}, q[3] = {-2, 0.6, 0.8}, mu = 0.4;
    pal_friction block = {1, 3, m, 3, 1, q, &mu};
    assert_true(pal_friction_bytes(1) <= sizeof work);
    assert_int_equal(pal_friction_solve(&block, 10, kind, f, w, work).state,
                     PALPATE_FRICTION_SOLVED);
    assert_int_equal(kind[0], PALPATE_POINT_SLIP);
    assert_true(fabs(f[0] - 2) < 1e-8 && fabs(f[1] + 0.48) < 1e-8 && fabs(f[2] + 0.64) < 1e-8);
    assert_true(fabs(w[1] - 0.12) < 1e-8 && fabs(w[2] - 0.16) < 1e-8);
    mu = 0.6;
    assert_int_equal(pal_friction_solve(&block, 10, kind, f, w, work).state,
                     PALPATE_FRICTION_SOLVED);
    assert_int_equal(kind[0], PALPATE_POINT_STICK);
    assert_true(fabs(f[1] + 0.6) < 1e-8 && fabs(f[2] + 0.8) < 1e-8 && fabs(w[1]) < 1e-8);
    q[0] = 0.1;
    assert_int_equal(pal_friction_solve(&block, 10, kind, f, w, work).state,
                     PALPATE_FRICTION_SOLVED);
    assert_true(kind[0] == PALPATE_POINT_OPEN && f[0] == 0 && f[1] == 0 && f[2] == 0);
    // nothing to stand on: flagged, nothing pushed
    double none[9] = {0};
    q[0] = -1;
    block.m = none;
    assert_int_equal(pal_friction_solve(&block, 10, kind, f, w, work).state,
                     PALPATE_FRICTION_SINGULAR);
    assert_true(f[0] == 0 && w[0] == -1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(small_cases),
        cmocka_unit_test(agrees_with_small_steps),
        cmocka_unit_test(one_point_is_one_of_its_solutions),
        cmocka_unit_test(thousands_of_random_problems),
        cmocka_unit_test(without_friction_is_the_lcp),
        cmocka_unit_test(held_points_are_bonded),
        cmocka_unit_test(starts_warm_and_repeats),
        cmocka_unit_test(early_stop_is_usable_and_flagged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
