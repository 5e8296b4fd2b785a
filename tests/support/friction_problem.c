#include "tests/support/friction_problem.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <math.h>

#include <cmocka.h>

#include "tests/support/random_problems.h"

void friction_random_matrix(friction_problem *p, int points, double condition, double skew,
                            int cone) {
    p->points = points;
    p->n = 3 * points;
    p->symmetric = skew <= 0;
    for (int i = 0; i < points; i++) {
        p->row[i] = 3 * i;
    }
    random_matrix(p->n, condition, skew, cone, p->m);
}

void friction_random_vector(friction_problem *p, double mu_least, double mu_most) {
    for (int i = 0; i < p->n; i++) {
        p->q[i] = random_uniform();
    }
    for (int i = 0; i < p->points; i++) {
        p->mu[i] = mu_least + (mu_most - mu_least) * random_positive();
    }
}

void friction_drop_idle_rows(friction_problem *p) {
    int kept[MAX], n = 0;
    for (int i = 0; i < p->points; i++) {
        p->row[i] = n;
        for (int k = 0; k < 3; k++) {
            if (k == 0 || p->mu[i] != 0) {
                kept[n++] = 3 * i + k;
            }
        }
    }
    for (int j = 0; j < n; j++) { // kept[i] >= i: in place
        for (int i = 0; i < n; i++) {
            p->m[i + j * n] = p->m[kept[i] + kept[j] * p->n];
        }
    }
    for (int i = 0; i < n; i++) {
        p->q[i] = p->q[kept[i]];
    }
    p->n = n;
}

void friction_gaps(const friction_problem *p, const double *f, double *w) {
    for (int i = 0; i < p->n; i++) {
        w[i] = p->q[i];
    }
    for (int j = 0; j < p->n; j++) {
        for (int i = 0; i < p->n; i++) {
            w[i] += p->m[i + j * p->n] * f[j];
        }
    }
}

double friction_natural(const friction_problem *p, const double *f) {
    double w[MAX], sum = 0, norm = 0;
    friction_gaps(p, f, w);
    for (int i = 0; i < p->points; i++) {
        const double *a = f + p->row[i], *b = w + p->row[i];
        if (p->mu[i] < 0) {
            sum += b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
            continue;
        }
        double r = fmin(a[0], b[0]);
        sum += r * r;
        if (p->mu[i] > 0) {
            double y1 = a[1] - b[1], y2 = a[2] - b[2], y = hypot(y1, y2);
            double radius = p->mu[i] * fmax(a[0], 0), s = y > radius ? radius / y : 1;
            sum += pow(a[1] - s * y1, 2) + pow(a[2] - s * y2, 2);
        }
    }
    for (int i = 0; i < p->n; i++) {
        norm += p->q[i] * p->q[i];
    }
    return norm > 0 ? sqrt(sum / norm) : sqrt(sum);
}

void friction_assert_in_cones(const friction_problem *p, const double *f) {
    for (int i = 0; i < p->points; i++) {
        const double *a = f + p->row[i];
        assert_true(isfinite(a[0]) && (p->mu[i] < 0 || a[0] >= 0));
        assert_true(p->mu[i] <= 0 || hypot(a[1], a[2]) <= p->mu[i] * a[0] * (1 + 4e-16));
    }
}

pal_friction_result friction_solve(const friction_problem *p, int iterations, uint8_t *state,
                                   double *f, double *w) {
    static double work[12 * POINTS * POINTS + 70 * POINTS];
    assert_true(pal_friction_bytes(POINTS) <= sizeof work);
    pal_friction friction = {p->points, p->n, p->m, p->n, p->symmetric, p->q, p->mu};
    return pal_friction_solve(&friction, iterations, state, f, w, work);
}

double friction_distance(int n, const double *a, const double *b) {
    double sum = 0, norm = 0;
    for (int i = 0; i < n; i++) {
        sum += (a[i] - b[i]) * (a[i] - b[i]);
        norm += b[i] * b[i];
    }
    return norm > 0 ? sqrt(sum / norm) : sqrt(sum);
}
