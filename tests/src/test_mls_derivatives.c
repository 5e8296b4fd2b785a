/// MLS derivatives: the definition in quadruple precision, design 2.1 at nodes, the limit at nodes.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/discretization/mls.h"

__extension__ typedef __float128 quad;

/// ---- Clouds: 7 x 7 x 7 nodes of unit spacing -----------------------------------------------

enum { EDGE = 7, NODES = EDGE * EDGE * EDGE };

static uint64_t seed = 42;
static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

static void lattice(double jitter, double *x) {
    for (int i = 0; i < NODES; i++) {
        int at[3] = {i % EDGE, i / EDGE % EDGE, i / (EDGE * EDGE)};
        for (int a = 0; a < 3; a++) {
            int inside = at[a] > 0 && at[a] < EDGE - 1; // faces stay flat, corners stay put
            x[3 * i + a] = at[a] + (inside ? jitter * (2.0 * uniform() - 1.0) : 0.0);
        }
    }
}

/// Nodes to look at: deep inside, on a face, an edge, a corner.
static const int places[4] = {3 + 3 * EDGE + 3 * EDGE * EDGE, 3 + 2 * EDGE, 3, 0};

static void tree_of(const double *x, int32_t n, pal_neighbours *tree) {
    pal_error e = {0};
    assert_int_equal(pal_neighbours_create(tree, x, n, &e), PALPATE_OK);
}

static const double scale_of[10] = {0, 1, 1, 1, 2, 2, 2, 2, 2, 2};

/// Term t (value, 3 first, 6 second derivatives) of node j of the last stencil.
static double term(const pal_mls *m, int32_t j, int t) {
    return t == 0 ? m->phi[j] : t < 4 ? m->dphi[3 * j + t - 1] : m->d2phi[6 * j + t - 4];
}

static void take_of(int t, int take[3]) {
    static const int first[6] = {0, 0, 0, 1, 1, 2}, second[6] = {0, 1, 2, 1, 2, 2};
    take[0] = take[1] = take[2] = 0;
    if (t >= 4) {
        take[first[t - 4]]++;
        take[second[t - 4]]++;
    } else if (t > 0) {
        take[t - 1]++;
    }
}

/// ---- The definition, in quadruple precision ------------------------------------------------

static quad quad_sqrt(quad v) {
    quad r = (quad)sqrt((double)v);
    for (int i = 0; i < 3 && r > 0; i++) {
        r = (r + v / r) / 2;
    }
    return r;
}

static quad quad_weight(quad s, int p) {
    if (s >= 1) {
        return 0;
    }
    quad w = 1 - 6 * s * s + 8 * s * s * s - 3 * s * s * s * s;
    for (int i = 0; i < 2 * p; i++) {
        w /= s;
    }
    return w;
}

/// All monomials of the degree at y, constant first.
static int quad_monomials(int degree, const quad y[3], quad *out) {
    int n = 0;
    for (int i = 0; i <= degree; i++) {
        for (int j = 0; i + j <= degree; j++) {
            for (int k = 0; i + j + k <= degree; k++) {
                quad v = 1;
                for (int e = 0; e < i; e++) {
                    v *= y[0];
                }
                for (int e = 0; e < j; e++) {
                    v *= y[1];
                }
                for (int e = 0; e < k; e++) {
                    v *= y[2];
                }
                out[n++] = v;
            }
        }
    }
    return n;
}

/// Solve A x = b by elimination with partial pivoting, b overwritten.
static void quad_solve(int n, quad a[20][20], quad *b) {
    for (int k = 0; k < n; k++) {
        int best = k;
        for (int i = k + 1; i < n; i++) {
            quad u = a[i][k] < 0 ? -a[i][k] : a[i][k],
                 v = a[best][k] < 0 ? -a[best][k] : a[best][k];
            best = u > v ? i : best;
        }
        for (int j = 0; j < n && best != k; j++) {
            quad t = a[k][j];
            a[k][j] = a[best][j];
            a[best][j] = t;
        }
        quad t = b[k];
        b[k] = b[best];
        b[best] = t;
        for (int i = k + 1; i < n; i++) {
            quad f = a[i][k] / a[k][k];
            for (int j = k; j < n; j++) {
                a[i][j] -= f * a[k][j];
            }
            b[i] -= f * b[k];
        }
    }
    for (int k = n - 1; k >= 0; k--) {
        for (int j = k + 1; j < n; j++) {
            b[k] -= a[k][j] * b[j];
        }
        b[k] /= a[k][k];
    }
}

/// h_J(x) by Eqs. 39-40 themselves; monomials about `origin` (any point gives the same).
static void quad_shape(int degree, int p, double radius, int count, const double *position,
                       const double origin[3], const quad x[3], quad *phi) {
    quad a[20][20], c[20], q[20];
    memset(a, 0, sizeof a);
    int n = 0;
    for (int j = 0; j < count; j++) {
        quad y[3], d2 = 0;
        for (int i = 0; i < 3; i++) {
            y[i] = ((quad)position[3 * j + i] - origin[i]) / radius;
            quad d = ((quad)position[3 * j + i] - x[i]) / radius;
            d2 += d * d;
        }
        quad w = quad_weight(quad_sqrt(d2), p);
        n = quad_monomials(degree, y, q);
        for (int i = 0; i < n; i++) {
            for (int k = 0; k < n; k++) {
                a[i][k] += w * q[i] * q[k];
            }
        }
    }
    quad y[3];
    for (int i = 0; i < 3; i++) {
        y[i] = (x[i] - origin[i]) / radius;
    }
    quad_monomials(degree, y, c);
    quad_solve(n, a, c);
    for (int j = 0; j < count; j++) {
        quad d2 = 0;
        for (int i = 0; i < 3; i++) {
            y[i] = ((quad)position[3 * j + i] - origin[i]) / radius;
            quad d = ((quad)position[3 * j + i] - x[i]) / radius;
            d2 += d * d;
        }
        quad_monomials(degree, y, q);
        phi[j] = 0;
        for (int i = 0; i < n; i++) {
            phi[j] += q[i] * c[i];
        }
        phi[j] *= quad_weight(quad_sqrt(d2), p);
    }
}

/// Central differences of the definition: all ten terms of each stencil node.
static void quad_differences(int degree, int p, const pal_mls *m, const double at[3], quad step,
                             quad *f, quad (*d)[10]) {
    static const int8_t go[19][3] = {{0, 0, 0},   {1, 0, 0},  {-1, 0, 0}, {0, 1, 0},  {0, -1, 0},
                                     {0, 0, 1},   {0, 0, -1}, {1, 1, 0},  {1, -1, 0}, {-1, 1, 0},
                                     {-1, -1, 0}, {1, 0, 1},  {1, 0, -1}, {-1, 0, 1}, {-1, 0, -1},
                                     {0, 1, 1},   {0, 1, -1}, {0, -1, 1}, {0, -1, -1}};
    static const int own[3] = {4, 7, 9}, mixed[3] = {5, 6, 8};
    for (int s = 0; s < 19; s++) {
        quad y[3];
        for (int a = 0; a < 3; a++) {
            y[a] = at[a] + go[s][a] * step;
        }
        quad_shape(degree, p, m->radius, m->count, m->position, at, y, f + 200 * s);
    }
    for (int32_t j = 0; j < m->count; j++) {
        d[j][0] = f[j];
        for (int a = 0; a < 3; a++) {
            quad plus = f[200 * (1 + 2 * a) + j], minus = f[200 * (2 + 2 * a) + j];
            const quad *g = f + 200 * (7 + 4 * a) + j;
            d[j][1 + a] = (plus - minus) / (2 * step);
            d[j][own[a]] = (plus - 2 * f[j] + minus) / (step * step);
            d[j][mixed[a]] = (g[0] - g[200] - g[400] + g[600]) / (4 * step * step);
        }
    }
}

static void full_derivatives_are_those_of_the_definition(void **state) {
    (void)state;
    double *x = malloc(3 * NODES * sizeof *x);
    quad *f = malloc(19 * 200 * sizeof *f);
    quad(*d1)[10] = malloc(200 * sizeof *d1), (*d2)[10] = malloc(200 * sizeof *d2);
    double worst = 0.0;
    lattice(0.3, x);
    pal_neighbours tree;
    tree_of(x, NODES, &tree);
    pal_mls m = {0};
    pal_error e = {0};
    for (int basis = 1; basis <= 3; basis++) {
        for (int p = 0; p <= 3; p++) {
            for (int place = 0; place < 3; place++) {
                int k = places[place]; // inside, face, edge
                double far[3] = {0.4, 0.1, 0.01};
                double at[3];
                for (int a = 0; a < 3; a++) {
                    at[a] = x[3 * k + a] + far[place] * (0.5 + 0.5 * uniform());
                }
                pal_mls_options o = {.basis = (pal_basis)basis, .exponent = p, .order = 2};
                assert_int_equal(pal_mls_stencil(&m, &tree, &o, at, 0, NULL, &e), PALPATE_OK);
                assert_true(m.count <= 200);
                // differences at two steps, extrapolated: truncation and quadruple rounding (times
                // the 1e12 of the weights beside the node) both stay below 1e-12
                quad fine = (quad)2e-6;
                quad_differences(basis, p, &m, at, fine, f, d1);
                quad_differences(basis, p, &m, at, 2 * fine, f, d2);
                double size[3] = {0, 0, 0}, off[3] = {0, 0, 0};
                for (int32_t j = 0; j < m.count; j++) {
                    quad d[10];
                    for (int t = 0; t < 10; t++) {
                        d[t] = (4 * d1[j][t] - d2[j][t]) / 3;
                    }
                    for (int t = 0; t < 10; t++) {
                        int level = (int)scale_of[t];
                        size[level] = fmax(size[level], fabs((double)d[t]));
                        off[level] = fmax(off[level], fabs((double)(d[t] - (quad)term(&m, j, t))));
                    }
                }
                for (int level = 0; level < 3; level++) {
                    double err = off[level] / size[level];
                    worst = err > worst ? err : worst;
                }
            }
        }
    }
    print_message("# worst difference to the definition: %.1e of the largest\n", worst);
    assert_true(worst < 1e-11); // double rounding (1e-13 seen) and the differences' 1e-12
    pal_mls_clear(&m);
    pal_neighbours_clear(&tree);
    free(x);
    free(f);
    free(d1);
    free(d2);
}

/// The constrained local fit of design 2.1, in quadruple precision: terms of every stencil node.
static void node_formulas(int degree, int p, double radius, int count, const double *position,
                          const double *node, int diffuse, quad out[][10]) {
    static const int first[6] = {0, 0, 0, 1, 1, 2}, second[6] = {0, 1, 2, 1, 2, 2};
    quad mat[20][20], dm[3][20][20], copy[20][20];
    memset(mat, 0, sizeof mat);
    memset(dm, 0, sizeof dm);
    memset(out, 0, (size_t)count * sizeof *out);
    int power_of[20][3], n = 0;
    for (int i = 0; i <= degree; i++) {
        for (int j = 0; i + j <= degree; j++) {
            for (int k = 0; i + j + k <= degree; k++) {
                power_of[n][0] = i;
                power_of[n][1] = j;
                power_of[n++][2] = k;
            }
        }
    }
    quad q[200][20], w[200], dw[200][3];
    for (int j = 0; j < count; j++) {
        quad y[3], d2 = 0;
        for (int i = 0; i < 3; i++) {
            y[i] = ((quad)position[3 * j + i] - node[i]) / radius;
            d2 += y[i] * y[i];
        }
        quad_monomials(degree, y, q[j]);
        quad s = quad_sqrt(d2);
        w[j] = d2 > 0 ? quad_weight(s, p) : 0;
        for (int i = 0; i < 3; i++) {
            // dW/dx_i = W'(s) (x - x_J)_i / (s r); W' by its own formula
            quad spline = 1 - 6 * s * s + 8 * s * s * s - 3 * s * s * s * s;
            quad slope = -12 * s + 24 * s * s - 12 * s * s * s;
            quad pole = 1;
            for (int e = 0; e < 2 * p; e++) {
                pole /= s > 0 ? s : 1;
            }
            dw[j][i] = d2 > 0 && s < 1 ? (slope - 2 * p * spline / s) * pole * -y[i] / s : 0;
        }
        for (int a = 1; a < n; a++) {
            for (int b = 1; b < n; b++) {
                mat[a - 1][b - 1] += w[j] * q[j][a] * q[j][b];
                for (int i = 0; i < 3; i++) {
                    dm[i][a - 1][b - 1] += dw[j][i] * q[j][a] * q[j][b];
                }
            }
        }
    }
    for (int j = 0; j < count; j++) {
        quad b[20], db[3][20];
        memcpy(copy, mat, sizeof mat);
        for (int a = 1; a < n; a++) {
            b[a - 1] = w[j] * q[j][a];
        }
        quad_solve(n - 1, copy, b);
        for (int i = 0; i < 3; i++) {
            for (int a = 0; a < n - 1; a++) {
                db[i][a] = dw[j][i] * q[j][a + 1];
                for (int c = 0; c < n - 1; c++) {
                    db[i][a] -= dm[i][a][c] * b[c];
                }
            }
            memcpy(copy, mat, sizeof mat);
            quad_solve(n - 1, copy, db[i]);
        }
        for (int t = 1; t < 10; t++) {
            int take[3];
            take_of(t, take);
            for (int a = 1; a < n; a++) {
                if (power_of[a][0] == take[0] && power_of[a][1] == take[1] &&
                    power_of[a][2] == take[2]) {
                    int twice = take[0] == 2 || take[1] == 2 || take[2] == 2;
                    out[j][t] = b[a - 1] * (twice ? 2 : 1);
                }
            }
        }
        for (int m = 0; m < 6 && !diffuse; m++) {
            for (int side = 0; side < 2; side++) {
                int i = side ? second[m] : first[m], along = side ? first[m] : second[m];
                for (int a = 1; a < n; a++) {
                    if (power_of[a][i] == 1 &&
                        power_of[a][0] + power_of[a][1] + power_of[a][2] == 1) {
                        out[j][4 + m] += db[along][a - 1];
                    }
                }
            }
        }
        for (int t = 1; t < 10; t++) {
            out[j][t] /= t < 4 ? (quad)radius : (quad)radius * radius;
        }
    }
}

static void node_values_follow_the_constrained_fit_and_are_the_limit(void **state) {
    (void)state;
    double *x = malloc(3 * NODES * sizeof *x);
    quad(*want)[10] = malloc(200 * sizeof *want);
    double *at_node = malloc(10 * 200 * sizeof *at_node);
    lattice(0.3, x);
    pal_neighbours tree;
    tree_of(x, NODES, &tree);
    pal_mls m = {0};
    pal_error e = {0};
    double worst = 0.0;
    for (int basis = 1; basis <= 3; basis++) {
        for (int p = 1; p <= 4; p++) {
            for (int place = 0; place < 4; place++) {
                const double *node = x + 3 * places[place];
                pal_mls_options o = {.basis = (pal_basis)basis, .exponent = p, .order = 2};
                double size = 0.0;
                for (int diffuse = 1; diffuse >= 0; diffuse--) {
                    o.derivatives = (pal_derivatives)diffuse;
                    assert_int_equal(pal_mls_stencil(&m, &tree, &o, node, 0, NULL, &e), PALPATE_OK);
                    assert_true(m.count <= 200);
                    node_formulas(basis, p, m.radius, m.count, m.position, node, diffuse, want);
                    size = 0.0;
                    for (int32_t j = 1; j < m.count; j++) {
                        for (int t = 1; t < 10; t++) {
                            size = fmax(size, fabs((double)want[j][t]));
                        }
                    }
                    // p = 1: the weight's own curvature adds to the full second derivative
                    for (int32_t j = 1; j < m.count && (p > 1 || diffuse); j++) {
                        for (int t = 1; t < 10; t++) {
                            double err = fabs((double)(want[j][t] - (quad)term(&m, j, t))) / size;
                            worst = err > worst ? err : worst;
                        }
                    }
                }
                for (int32_t j = 0; j < m.count; j++) {
                    for (int t = 0; t < 10; t++) {
                        at_node[10 * j + t] = term(&m, j, t);
                    }
                }
                // beside the node, on the same stencil: the full derivatives are continuous there
                double last = 1e300;
                for (int step = 2; step <= 12; step += 2) {
                    double d = pow(10.0, -step), off = 0.0;
                    double beside[3] = {node[0] + d, node[1] + 0.7 * d, node[2] + 0.3 * d};
                    double phi[200], dphi[600], d2phi[1200];
                    pal_mls_info info;
                    assert_int_equal(pal_mls_shape(&m, &o, beside, m.radius, m.count, m.position,
                                                   phi, dphi, d2phi, &info),
                                     PALPATE_OK);
                    assert_int_equal(info.centre, 0);
                    for (int32_t j = 0; j < m.count; j++) {
                        for (int t = 0; t < 10; t++) {
                            double got = t == 0  ? phi[j]
                                         : t < 4 ? dphi[3 * j + t - 1]
                                                 : d2phi[6 * j + t - 4];
                            off = fmax(off, fabs(got - at_node[10 * j + t]));
                        }
                    }
                    // falls with the distance (at least linearly) down to rounding
                    assert_true(off < 0.05 * last || off < 1e-9 * size);
                    last = off;
                }
                assert_true(last < 1e-9 * size);
            }
        }
    }
    print_message("# worst difference to design 2.1: %.1e of the largest\n", worst);
    assert_true(worst < 1e-11); // double rounding on stencils of condition up to 1e6
    pal_mls_clear(&m);
    pal_neighbours_clear(&tree);
    free(x);
    free(want);
    free(at_node);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(full_derivatives_are_those_of_the_definition),
        cmocka_unit_test(node_values_follow_the_constrained_fit_and_are_the_limit),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
