/// Coulomb friction on random and on contact-like problems: the conditions themselves, an
/// independent slow solver (De Saxce's cone and small steps), every solution of one point,
/// pal_lcp_solve without friction, sliding and sticking patches over many ticks, early stop,
/// repeatability.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cmocka.h>

#include "haptic/solver/complementarity.h"
#include "haptic/base/dense.h"
#include "haptic/solver/friction.h"

enum { POINTS = 37, MAX = 3 * POINTS };

static uint64_t seed;
static double uniform(void) { // in (-1, 1), splitmix64
    seed += 0x9E3779B97F4A7C15u;
    uint64_t z = seed;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    z ^= z >> 31;
    return (double)(int64_t)z / 9223372036854775808.0;
}

static double positive(void) {
    return 0.5 + 0.5 * uniform();
}

typedef struct problem {
    int points, n, symmetric;
    int row[POINTS]; ///< first of each point
    double m[MAX * MAX], q[MAX], mu[POINTS];
} problem;

static double frobenius(int n, const double *a) {
    double sum = 0;
    for (int i = 0; i < n * n; i++) {
        sum += a[i] * a[i];
    }
    return sqrt(sum);
}

/// Symmetric part V diag(root^2) V^T of the given condition, eigenvalues spread logarithmically in
/// random directions (V: Householder reflections); skew part of `skew` times its norm, of random
/// entries or (cone) V root K root V^T, whose numerical range is a proper cone.
static void random_matrix(problem *p, int points, double condition, double skew, int cone) {
    static double v[MAX * MAX], k[MAX * MAX], t[MAX * MAX];
    double root[MAX];
    int n = 3 * points;
    p->points = points;
    p->n = n;
    p->symmetric = skew <= 0;
    for (int i = 0; i < points; i++) {
        p->row[i] = 3 * i;
    }
    for (int i = 0; i < n * n; i++) {
        v[i] = i % (n + 1) == 0;
    }
    for (int l = 0; l < n; l++) {
        double h[MAX], norm = 0;
        for (int i = 0; i < n; i++) {
            h[i] = uniform();
            norm += h[i] * h[i];
        }
        for (int j = 0; j < n; j++) {
            double dot = 0;
            for (int i = 0; i < n; i++) {
                dot += h[i] * v[i + j * n];
            }
            for (int i = 0; i < n; i++) {
                v[i + j * n] -= 2 * dot / norm * h[i];
            }
        }
    }
    for (int i = 0; i < n; i++) {
        double u = i == 0 ? 0 : i == n - 1 ? 1 : positive();
        root[i] = sqrt(pow(condition, -u));
    }
    for (int j = 0; j < n; j++) {
        for (int i = 0; i <= j; i++) {
            double a = i == j ? 0 : uniform() * (cone ? root[i] * root[j] : 1);
            k[i + j * n] = a;
            k[j + i * n] = -a;
        }
    }
    if (cone) {
        for (int j = 0; j < n; j++) {
            for (int i = 0; i < n; i++) {
                double sum = 0;
                for (int l = 0; l < n; l++) {
                    sum += v[i + l * n] * k[l + j * n];
                }
                t[i + j * n] = sum;
            }
        }
        for (int j = 0; j < n; j++) {
            for (int i = 0; i <= j; i++) {
                double sum = 0;
                for (int l = 0; l < n; l++) {
                    sum += t[i + l * n] * v[j + l * n];
                }
                k[i + j * n] = i == j ? 0 : sum;
                k[j + i * n] = -k[i + j * n];
            }
        }
    }
    for (int j = 0; j < n; j++) {
        for (int i = 0; i <= j; i++) {
            double sum = 0;
            for (int l = 0; l < n; l++) {
                sum += v[i + l * n] * root[l] * root[l] * v[j + l * n];
            }
            p->m[i + j * n] = p->m[j + i * n] = sum;
        }
    }
    double norm = frobenius(n, k), scale = norm > 0 ? skew * frobenius(n, p->m) / norm : 0;
    for (int i = 0; i < n * n; i++) {
        p->m[i] += scale * k[i];
    }
}

static void random_vector(problem *p, double mu_least, double mu_most) {
    for (int i = 0; i < p->n; i++) {
        p->q[i] = uniform();
    }
    for (int i = 0; i < p->points; i++) {
        p->mu[i] = mu_least + (mu_most - mu_least) * positive();
    }
}

/// Drop the tangential rows of points with mu = 0.
static void without_idle_rows(problem *p) {
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

static void multiply(const problem *p, const double *f, double *w) {
    for (int i = 0; i < p->n; i++) {
        w[i] = p->q[i];
    }
    for (int j = 0; j < p->n; j++) {
        for (int i = 0; i < p->n; i++) {
            w[i] += p->m[i + j * p->n] * f[j];
        }
    }
}

/// Natural map of all conditions, unit step (M of the tests has norm about 1), over || q ||.
/// Written from the conditions, not from the solver.
static double natural(const problem *p, const double *f) {
    double w[MAX], sum = 0, norm = 0;
    multiply(p, f, w);
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

static void assert_in_cones(const problem *p, const double *f) {
    for (int i = 0; i < p->points; i++) {
        const double *a = f + p->row[i];
        assert_true(isfinite(a[0]) && (p->mu[i] < 0 || a[0] >= 0));
        // one rounding: the solver squares and sums
        assert_true(p->mu[i] <= 0 || hypot(a[1], a[2]) <= p->mu[i] * a[0] * (1 + 4e-16));
    }
}

static pal_friction_result solve(const problem *p, int iterations, uint8_t *state, double *f,
                                 double *w) {
    static double work[12 * POINTS * POINTS + 70 * POINTS];
    assert_true(pal_friction_bytes(POINTS) <= sizeof work);
    pal_friction friction = {p->points, p->n, p->m, p->n, p->symmetric, p->q, p->mu};
    return pal_friction_solve(&friction, iterations, state, f, w, work);
}

static double distance(int n, const double *a, const double *b) {
    double sum = 0, norm = 0;
    for (int i = 0; i < n; i++) {
        sum += (a[i] - b[i]) * (a[i] - b[i]);
        norm += b[i] * b[i];
    }
    return norm > 0 ? sqrt(sum / norm) : sqrt(sum);
}

/// Independent and slow: f <- P_K(f - step (w + mu |w_t| n)), P_K onto the second-order cone itself
/// (De Saxce, Feng 1998), with the extragradient's second evaluation.
static int slow(const problem *p, double *f) {
    double step = 0.4 / (frobenius(p->n, p->m)), g[MAX], w[MAX];
    memset(f, 0, (size_t)p->n * sizeof *f);
    for (int k = 0; k < 200000; k++) {
        double change = 0;
        memcpy(g, f, (size_t)p->n * sizeof *f);
        for (int half = 0; half < 2; half++) {
            multiply(p, g, w);
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
    return natural(p, f) < 1e-10;
}

/// Moderate coupling, where the law has one solution: the forces themselves must agree.
static void agrees_with_small_steps(void **state) {
    (void)state;
    seed = 3;
    enum { COUNT = 2000 };
    double worst = 0;
    int compared = 0;
    for (int i = 0; i < COUNT; i++) {
        static problem p;
        double f[MAX] = {0}, w[MAX], other[MAX];
        uint8_t kind[POINTS] = {0};
        random_matrix(&p, 1 + i % 12, i % 2 ? 3 : 10, i % 3 ? 0 : 0.3, i % 2);
        random_vector(&p, 0, i % 4 < 2 ? 0.3 : 0.6);
        pal_friction_result r = solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        assert_in_cones(&p, f);
        assert_true(natural(&p, f) < 1e-6);
        if (slow(&p, other)) {
            compared++;
            worst = fmax(worst, distance(p.n, f, other));
        }
    }
    print_message("  %d of %d problems against small steps: forces agree to %.1e\n", compared,
                  COUNT, worst);
    assert_true(compared > COUNT * 9 / 10);
    assert_true(worst < 1e-7); // residual 1e-9 x condition 10, relative to forces smaller than q
}

/// Every solution of one point: open, stick, and the roots of the slip condition over the angle.
static int all_of_one_point(const problem *p, double found[][3]) {
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
    seed = 17;
    int several = 0, kinds[3] = {0}, least_several = 0;
    double worst = 0;
    for (int i = 0; i < 400; i++) {
        static problem p;
        double f[MAX] = {0}, w[MAX], found[10][3];
        uint8_t kind[POINTS] = {0};
        random_matrix(&p, 1, i % 2 ? 10 : 100, i % 3 ? 0 : 0.3, i % 2);
        random_vector(&p, 0.05, 1.5);
        pal_friction_result r = solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        int count = all_of_one_point(&p, found);
        assert_true(count >= 1);
        double nearest = INFINITY;
        for (int k = 0; k < count; k++) {
            nearest = fmin(nearest, distance(3, f, found[k]));
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

static int compare_int(const void *a, const void *b) {
    return *(const int *)a - *(const int *)b;
}
static int compare_double(const void *a, const void *b) {
    double d = *(const double *)a - *(const double *)b;
    return d > 0 ? 1 : (d < 0 ? -1 : 0);
}

static double microseconds(const struct timespec *a, const struct timespec *b) {
    return 1e6 * (double)(b->tv_sec - a->tv_sec) + 1e-3 * (double)(b->tv_nsec - a->tv_nsec);
}

static void thousands_of_random_problems(void **state) {
    (void)state;
    enum { COUNT = 6000 };
    static int iterations[COUNT];
    static double us[COUNT];
    seed = 2026;
    int flagged = 0;
    double worst = 0;
    for (int i = 0; i < COUNT; i++) {
        static problem p;
        double f[MAX] = {0}, w[MAX];
        uint8_t kind[POINTS] = {0};
        double condition = pow(10, 6 * positive()), skew = uniform() > 0 ? 0.3 * positive() : 0;
        if (i % 4 == 0) { // a quarter at the far end
            condition = 1e6;
            skew = i % 8 == 0 ? 0.3 : 0;
        }
        random_matrix(&p, 1 + (int)(15.999 * positive()), condition, skew, i % 2);
        random_vector(&p, 0, 1.5);
        for (int k = 0; k < p.points; k++) {
            // frictionless tools beside it, and held points
            p.mu[k] = (i + k) % 9 == 0 ? 0 : (i + k) % 23 == 0 ? -1 : p.mu[k];
        }
        without_idle_rows(&p);
        struct timespec a, b;
        clock_gettime(CLOCK_MONOTONIC, &a);
        pal_friction_result r = solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        clock_gettime(CLOCK_MONOTONIC, &b);
        us[i] = microseconds(&a, &b);
        iterations[i] = r.iterations;
        assert_in_cones(&p, f);
        if (r.state == PALPATE_FRICTION_SOLVED) {
            worst = fmax(worst, natural(&p, f));
        } else {
            flagged++;
            print_message("  flagged: m %d, condition %.1e, skew %.2f, residual %.1e\n", p.points,
                          condition, skew, r.residual);
        }
    }
    qsort(iterations, COUNT, sizeof *iterations, compare_int);
    qsort(us, COUNT, sizeof *us, compare_double);
    print_message("  %d problems, m <= 16, mu <= 1.5: residual <= %.1e, %d flagged\n", COUNT, worst,
                  flagged);
    print_message(
        "  iterations p50 %d, p99 %d, worst %d; time p50 %.1f us, p99 %.1f us, worst %.1f us\n",
        iterations[COUNT / 2], iterations[COUNT - COUNT / 100], iterations[COUNT - 1],
        us[COUNT / 2], us[COUNT - COUNT / 100], us[COUNT - 1]);
    assert_true(worst < 1e-6);
    assert_true(flagged <= COUNT / 1000);
}

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
static void patch(problem *p, int points, double poisson, double soft, double x[][2]) {
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
static double condition_of(const problem *p) {
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
            v[i] = uniform();
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
static rolled roll(problem *p, int points, double poisson, double soft, double mu, double skew,
                   int *iterations, double *us) {
    double x[POINTS][2], f[MAX] = {0}, w[MAX], u[MAX] = {0}, last[3] = {0};
    uint8_t kind[POINTS] = {0};
    rolled r = {0};
    patch(p, points, poisson, soft, x);
    r.condition = condition_of(p);
    for (int j = 0; j < p->n && skew > 0; j++) { // |K| to `skew` of the diagonal
        for (int i = 0; i < j; i++) {
            double k = skew * p->m[0] * uniform() / sqrt(p->n);
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
        struct timespec a, b;
        clock_gettime(CLOCK_MONOTONIC, &a);
        pal_friction_result result = solve(p, 60, kind, f, w);
        clock_gettime(CLOCK_MONOTONIC, &b);
        us[k] = microseconds(&a, &b);
        iterations[k] = result.iterations;
        r.ticks++;
        r.flagged += result.state != PALPATE_FRICTION_SOLVED;
        if (result.state == PALPATE_FRICTION_SOLVED) {
            r.worst = fmax(r.worst, result.residual);
        }
        assert_in_cones(p, f);
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
    static problem p;
    static int iterations[40000];
    static double us[40000];
    static const int points[] = {16, 19, 37};
    static const double mu[] = {0.1, 0.3, 0.6, 1.0, 1.5}, soft[] = {0.4, 0.8, 1.2};
    seed = 4;
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
                                (b + c) % 4 == 3 ? 0.2 : 0, iterations + ticks, us + ticks);
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
        qsort(iterations + first, (size_t)count, sizeof *iterations, compare_int);
        qsort(us + first, (size_t)count, sizeof *us, compare_double);
        print_message("  %d points, %d ticks: %d flagged; iterations p50 %d, p99 %d, worst %d; "
                      "time p50 %.1f, "
                      "p99 %.1f, p99.9 %.1f us\n",
                      points[a], count, flagged - bad, iterations[first + count / 2],
                      iterations[first + count - count / 100], iterations[ticks - 1],
                      us[first + count / 2], us[first + count - count / 100],
                      us[first + count - count / 1000]);
    }
    print_message("  condition %.0f to %.1e; residual <= %.1e; %d sticking, %d slipping\n",
                  least_condition, most_condition, worst, sticking, slipping);
    assert_true(flagged <= ticks / 1000);
    assert_true(sticking > ticks && slipping > ticks); // both were seen, a point per tick and more
    assert_true(most_condition > 1e5);
}

static void without_friction_is_the_lcp(void **state) {
    (void)state;
    seed = 8;
    for (int i = 0; i < 300; i++) {
        static problem p;
        static double work[POINTS * (POINTS + 10)];
        double f[MAX] = {0}, w[MAX], z[POINTS], gaps[POINTS];
        uint8_t kind[POINTS] = {0}, active[POINTS] = {0};
        random_matrix(&p, 1 + i % 16, 1e4, i % 2 ? 0.3 : 0, i % 4 < 2);
        random_vector(&p, 0, 0);
        int m = p.points;
        without_idle_rows(&p);
        assert_int_equal(p.n, m);
        pal_lcp lcp = {m, p.m, m, p.symmetric, p.q};
        assert_true(pal_lcp_bytes(m) <= sizeof work);
        pal_lcp_result a = pal_lcp_solve(&lcp, PALPATE_LCP_ITERATIONS, active, z, gaps, work);
        pal_friction_result b = solve(&p, PALPATE_LCP_ITERATIONS, kind, f, w);
        assert_int_equal(a.state, PALPATE_LCP_SOLVED);
        assert_int_equal(b.state, PALPATE_FRICTION_SOLVED);
        assert_int_equal(a.iterations, b.iterations);
        assert_memory_equal(f, z, (size_t)m * sizeof *z);
        assert_memory_equal(w, gaps, (size_t)m * sizeof *z);
        for (int j = 0; j < m; j++) {
            assert_int_equal(kind[j], z[j] > 0 ? PALPATE_POINT_SLIP : PALPATE_POINT_OPEN);
        }
        // one point with friction, far away: the others by Newton's method, the same forces
        static problem far;
        random_matrix(&far, 1 + i % 16, 100, i % 2 ? 0.3 : 0, i % 4 < 2);
        random_vector(&far, 0, 0);
        far.q[0] = 10;
        p = far;
        without_idle_rows(&p);
        far.mu[0] = 0.5;
        without_idle_rows(&far);
        double g[MAX] = {0};
        uint8_t other[POINTS] = {0};
        memset(kind, 0, sizeof kind);
        memset(f, 0, sizeof f);
        solve(&p, PALPATE_LCP_ITERATIONS, kind, f, w);
        pal_friction_result c = solve(&far, PALPATE_FRICTION_ITERATIONS, other, g, w);
        assert_int_equal(c.state, PALPATE_FRICTION_SOLVED);
        memmove(g + 1, g + 3, sizeof g - 3 * sizeof *g);
        if (f[0] <= 0) { // as it is where the others' forces do not draw it in
            assert_true(distance(p.n, g, f) < 1e-6); // 1e-9 of || q || 10 x condition 100
        }
    }
}

/// All held: the linear system. One held beside sliding ones: its gap is closed whatever pulls.
static void held_points_are_bonded(void **state) {
    (void)state;
    seed = 12;
    for (int i = 0; i < 100; i++) {
        static problem p;
        static double lu[MAX * MAX];
        double f[MAX] = {0}, w[MAX], x[MAX];
        int32_t pivot[MAX];
        uint8_t kind[POINTS] = {0};
        random_matrix(&p, 1 + i % 12, 100, i % 2 ? 0.3 : 0, 0);
        random_vector(&p, 0.3, 0.6);
        for (int k = 0; k < p.points; k++) {
            p.mu[k] = -1;
        }
        memcpy(lu, p.m, sizeof lu);
        for (int k = 0; k < p.n; k++) {
            x[k] = -p.q[k];
        }
        assert_int_equal(pal_dense_lu(p.n, lu, p.n, pivot), 0);
        pal_dense_lu_solve(p.n, lu, p.n, pivot, 1, x, p.n);
        pal_friction_result r = solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        assert_int_equal(r.iterations, 1);
        assert_true(distance(p.n, f, x) < 1e-11); // condition 100
        for (int k = 1; k < p.points; k++) {
            p.mu[k] = 0.4;
        }
        r = solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        assert_int_equal(r.state, PALPATE_FRICTION_SOLVED);
        assert_true(natural(&p, f) < 1e-6);
        assert_int_equal(kind[0], PALPATE_POINT_STICK);
    }
}

/// Solved again from its own answer: no step, the same bits. From last tick's: fewer steps.
static void starts_warm_and_repeats(void **state) {
    (void)state;
    seed = 21;
    long warm_sum = 0, cold_sum = 0;
    for (int i = 0; i < 300; i++) {
        static problem p;
        double f[MAX] = {0}, w[MAX], g[MAX], cold[MAX] = {0}, again[MAX] = {0};
        uint8_t kind[POINTS] = {0}, fresh[POINTS] = {0}, second[POINTS] = {0};
        random_matrix(&p, 12, 100, i % 2 ? 0.2 : 0, 0);
        random_vector(&p, 0.1, 0.8);
        assert_int_equal(solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w).state,
                         PALPATE_FRICTION_SOLVED);
        memcpy(g, f, sizeof g);
        assert_int_equal(solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w).iterations, 0);
        assert_memory_equal(f, g, (size_t)p.n * sizeof *f);
        for (int k = 0; k < p.n; k++) {
            p.q[k] += 0.02 * uniform();
        }
        pal_friction_result a = solve(&p, PALPATE_FRICTION_ITERATIONS, kind, f, w);
        pal_friction_result b = solve(&p, PALPATE_FRICTION_ITERATIONS, fresh, cold, w);
        pal_friction_result c = solve(&p, PALPATE_FRICTION_ITERATIONS, second, again, w);
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
    seed = 9;
    int cut = 0;
    for (int i = 0; i < 200; i++) {
        static problem p;
        random_matrix(&p, 16, 1e6, i % 2 ? 0.3 : 0, 0);
        random_vector(&p, 0, 1.5);
        double zero[MAX] = {0};
        for (int k = 1; k <= 8; k++) {
            double f[MAX], w[MAX], own[MAX];
            uint8_t kind[POINTS];
            for (int j = 0; j < p.n; j++) {
                f[j] = 10 * uniform(); // any finite start
                kind[j / 3] = (uint8_t)(j % 3);
            }
            pal_friction_result r = solve(&p, k, kind, f, w);
            assert_true(r.iterations <= k);
            assert_in_cones(&p, f);
            // the header's residual weighs forces by d <= 1: no worse than f = 0 there, so at most
            // 1 / d of it here; zero's is the norm of the violated part
            assert_true(r.residual <= natural(&p, zero) * (1 + 1e-12));
            multiply(&p, f, own);
            for (int j = 0; j < p.n; j++) {
                assert_true(fabs(own[j] - w[j]) <= 1e-12 * (1 + fabs(f[0])) * p.n);
            }
            cut += r.state != PALPATE_FRICTION_SOLVED;
            assert_true(r.state != PALPATE_FRICTION_SOLVED || natural(&p, f) < 1e-6);
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
        cmocka_unit_test(contacts_rolled_over_ticks),
        cmocka_unit_test(without_friction_is_the_lcp),
        cmocka_unit_test(held_points_are_bonded),
        cmocka_unit_test(starts_warm_and_repeats),
        cmocka_unit_test(early_stop_is_usable_and_flagged),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
