/// Coulomb friction as the contact law meets it: patches of points on a half-space that slide,
/// stick, lift and come back over thousands of ticks, each starting from the last one's answer.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/base/dense.h"
#include "tests/support/friction_problem.h"
#include "tests/support/random_problems.h"

enum { NODES = 90 };
static const double spacing = 0.7e-3; // of nodes and points [m]

/// The i-th place of a near-uniform pattern (sunflower).
static void place(int i, double x[2]) {
    double r = spacing * sqrt(0.9 * i / 3.141592653589793), a = 2.399963229728653 * i;
    x[0] = r * cos(a);
    x[1] = r * sin(a);
}

/// Half-space (Boussinesq, Cerruti; Johnson, Contact Mechanics, 3.2 and 3.6) from a force at d[]
/// away, averaged over a node's own cell by a width of 0.4 spacings.
static void half_space(double poisson, const double d[2], double c[3][3]) {
    const double young = 10e3, width = 0.4 * spacing,
                 g = (1 + poisson) / (3.141592653589793 * young);
    double r = sqrt(d[0] * d[0] + d[1] * d[1] + width * width);
    c[0][0] = g / r * (1 - poisson);
    for (int a = 0; a < 2; a++) {
        c[0][a + 1] = -0.5 * g * (1 - 2 * poisson) * d[a] / (r * (r + width));
        c[a + 1][0] = -c[0][a + 1];
        for (int b = 0; b < 2; b++) {
            double same = a == b ? 1 - poisson + poisson * width * width / (2 * r * r) : 0;
            c[a + 1][b + 1] = g / r * (same + poisson * d[a] * d[b] / (r * r));
        }
    }
}

/// M = Phi C Phi' as in the contact law: points with Gaussian weights `soft` spacings wide on nodes
/// of a half-space. Wide weights make neighbours alike and M ill-conditioned.
static void patch(friction_problem *p, int points, double poisson, double soft, double x[][2]) {
    static double phi[POINTS][NODES], half[MAX][3 * NODES];
    p->points = points;
    p->n = 3 * points;
    p->symmetric = 1;
    for (int i = 0; i < points; i++) {
        double sum = 0;
        p->row[i] = 3 * i;
        place(i, x[i]);
        for (int k = 0; k < NODES; k++) {
            double y[2], width = soft * spacing;
            place(k, y);
            phi[i][k] =
                exp(-(pow(x[i][0] - y[0], 2) + pow(x[i][1] - y[1], 2)) / (2 * width * width));
            sum += phi[i][k];
        }
        for (int k = 0; k < NODES; k++) {
            phi[i][k] /= sum;
        }
    }
    memset(half, 0, sizeof half);
    for (int k = 0; k < NODES; k++) {
        for (int l = 0; l < NODES; l++) {
            double a[2], b[2], c[3][3];
            place(k, a);
            place(l, b);
            double d[2] = {a[0] - b[0], a[1] - b[1]};
            half_space(poisson, d, c);
            for (int i = 0; i < points * 9; i++) {
                half[i / 9 * 3 + i / 3 % 3][3 * l + i % 3] += phi[i / 9][k] * c[i / 3 % 3][i % 3];
            }
        }
    }
    for (int i = 0; i < p->n; i++) {
        for (int j = 0; j < p->n; j++) {
            double sum = 0;
            for (int l = 0; l < NODES; l++) {
                sum += half[i][3 * l + j % 3] * phi[j / 3][l];
            }
            p->m[i + j * p->n] = sum;
        }
    }
}

/// Largest over smallest eigenvalue, by power iterations on M and on its Cholesky factor; 0: not
/// positive definite.
static double condition_of(const friction_problem *p) {
    static double l[MAX * MAX];
    double v[MAX], most = 0, least = 0;
    int n = p->n;
    memcpy(l, p->m, (size_t)(n * n) * sizeof *l);
    if (pal_dense_cholesky(n, 0, l, n) != 0) {
        return 0;
    }
    for (int inverse = 0; inverse < 2; inverse++) {
        double size = 0;
        for (int i = 0; i < n; i++) {
            v[i] = random_uniform();
        }
        for (int k = 0; k < 60; k++) {
            double w[MAX] = {0};
            if (inverse) {
                memcpy(w, v, sizeof w);
                pal_dense_cholesky_solve(n, l, n, 1, w, n);
            } else {
                for (int j = 0; j < n; j++) {
                    for (int i = 0; i < n; i++) {
                        w[i] += p->m[i + j * n] * v[j];
                    }
                }
            }
            size = 0;
            for (int i = 0; i < n; i++) {
                size += w[i] * w[i];
            }
            size = sqrt(size);
            for (int i = 0; i < n; i++) {
                v[i] = w[i] / size;
            }
        }
        *(inverse ? &least : &most) = inverse ? 1 / size : size;
    }
    return most / least;
}

typedef struct rolled {
    int flagged, ticks, slipping, sticking;
    double worst, work, condition;
} rolled;

/// A sphere comes in, is dragged to and fro while it turns about its normal, lifts and comes back,
/// 1000 ticks of 1 ms; forces and states of the last tick start the next, as in the law.
static rolled roll(friction_problem *p, int points, double poisson, double soft, double mu,
                   double skew, int *iterations) {
    double x[POINTS][2], f[MAX] = {0}, w[MAX], u[MAX] = {0}, last[3] = {0};
    uint8_t kind[POINTS] = {0};
    rolled r = {0};
    patch(p, points, poisson, soft, x);
    r.condition = condition_of(p);
    for (int j = 0; j < p->n && skew > 0; j++) { // |K| to `skew` of the diagonal
        for (int i = 0; i < j; i++) {
            double k = skew * p->m[0] * random_uniform() / sqrt(p->n);
            p->m[i + j * p->n] += k;
            p->m[j + i * p->n] -= k;
        }
        p->symmetric = 0;
    }
    for (int i = 0; i < points; i++) {
        p->mu[i] = mu;
    }
    for (int k = 0; k < 1000; k++) {
        double t = k / 1000.0,
               depth = 1.2e-3 * fmin(1, 3 * fabs(sin(6.3 * t))) + 1e-4 * sin(50 * t);
        double swing = k % 400 < 200 ? 1.5e-3 : 0.15e-3; // slides, then mostly sticks
        double at[3] = {swing * sin(31 * t), 0.6 * swing * sin(45 * t), 400 * swing * sin(20 * t)};
        for (int i = 0; i < points; i++) {
            double rr = x[i][0] * x[i][0] + x[i][1] * x[i][1];
            p->q[3 * i] = rr / (2 * 4e-3) - depth;
            p->q[3 * i + 1] = -u[3 * i + 1] - (at[0] - last[0] - (at[2] - last[2]) * x[i][1]);
            p->q[3 * i + 2] = -u[3 * i + 2] - (at[1] - last[1] + (at[2] - last[2]) * x[i][0]);
        }
        memcpy(last, at, sizeof last);
        pal_friction_result result = friction_solve(p, 60, kind, f, w);
        iterations[k] = result.iterations;
        r.ticks++;
        r.flagged += result.state != PALPATE_FRICTION_SOLVED;
        if (result.state == PALPATE_FRICTION_SOLVED) {
            r.worst = fmax(r.worst, result.residual);
        }
        friction_assert_in_cones(p, f);
        for (int i = 0; i < p->n; i++) {
            u[i] = w[i] - p->q[i];
        }
        for (int i = 0; i < points; i++) {
            r.slipping += kind[i] == PALPATE_POINT_SLIP;
            r.sticking += kind[i] == PALPATE_POINT_STICK;
            double work = f[3 * i + 1] * w[3 * i + 1] + f[3 * i + 2] * w[3 * i + 2];
            assert_true(work <= 1e-12 * mu); // friction never feeds the slip; f_n 1 N, slip 1e-3 m
            r.work += work;
        }
    }
    return r;
}

static void contacts_rolled_over_ticks(void **state) {
    (void)state;
    static friction_problem p;
    static int iterations[40000];
    static const int points[] = {16, 19, 37};
    static const double mu[] = {0.1, 0.3, 0.6, 1.0, 1.5}, soft[] = {0.4, 0.8, 1.2};
    random_seed(4);
    int ticks = 0, flagged = 0, sticking = 0, slipping = 0;
    double worst = 0, least_condition = HUGE_VAL, most_condition = 0;
    for (int a = 0; a < 3; a++) {
        int first = ticks, bad = flagged;
        for (int b = 0; b < 5; b++) {
            for (int c = 0; c < 3 && ticks + 1000 <= 40000; c++) {
                if (points[a] == 37 && c == 1) {
                    continue;
                }
                rolled r = roll(&p, points[a], b % 2 ? 0.49 : 0.3, soft[c], mu[b],
                                (b + c) % 4 == 3 ? 0.2 : 0, iterations + ticks);
                assert_true(r.condition > 1);
                ticks += r.ticks;
                flagged += r.flagged;
                sticking += r.sticking;
                slipping += r.slipping;
                worst = fmax(worst, r.worst);
                least_condition = fmin(least_condition, r.condition);
                most_condition = fmax(most_condition, r.condition);
                assert_true(r.work < 0);
            }
        }
        int count = ticks - first;
        qsort(iterations + first, (size_t)count, sizeof *iterations, rising_int);
        print_message("  %d points, %d ticks: %d flagged; iterations p50 %d, p99 %d, worst %d\n",
                      points[a], count, flagged - bad, iterations[first + count / 2],
                      iterations[first + count - count / 100], iterations[ticks - 1]);
    }
    print_message("  condition %.0f to %.1e; residual <= %.1e; %d sticking, %d slipping\n",
                  least_condition, most_condition, worst, sticking, slipping);
    assert_true(flagged <= ticks / 1000);
    assert_true(sticking > ticks && slipping > ticks); // both were seen, a point per tick and more
    assert_true(most_condition > 1e5);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(contacts_rolled_over_ticks)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
