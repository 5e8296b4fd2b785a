/// MLS shape functions: interpolation, reproduction, invariance, deficient stencils.
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

/// ---- Interpolation -------------------------------------------------------------------------

static void shape_functions_are_delta_at_nodes(void **state) {
    (void)state;
    double *x = malloc(3 * NODES * sizeof *x);
    for (int jittered = 0; jittered < 2; jittered++) {
        lattice(jittered ? 0.3 : 0.0, x);
        pal_neighbours tree;
        tree_of(x, NODES, &tree);
        pal_mls m = {0};
        pal_error e = {0};
        for (int basis = 1; basis <= 3; basis++) {
            for (int p = 1; p <= 4; p++) {
                for (int place = 0; place < 8; place++) {
                    // at the node, and a hair beside it: one ulp of the coordinates
                    int k = places[place % 4];
                    double at[3] = {x[3 * k], x[3 * k + 1], x[3 * k + 2]};
                    at[1] += place < 4 ? 0.0 : 1e-15;
                    pal_mls_options o = {.basis = (pal_basis)basis, .exponent = p, .order = 0};
                    assert_int_equal(pal_mls_stencil(&m, &tree, &o, at, 0, NULL, &e), PALPATE_OK);
                    assert_int_equal(m.node[0], k);
                    for (int32_t j = 0; j < m.count; j++) {
                        assert_true(fabs(m.phi[j] - (j == 0)) < 1e-12);
                    }
                }
            }
        }
        pal_mls_clear(&m);
        pal_neighbours_clear(&tree);
    }
    free(x);
}

/// ---- Reproduction --------------------------------------------------------------------------

static double monomial(const int n[3], const int take[3], const double x[3]) {
    double v = 1.0;
    for (int a = 0; a < 3; a++) {
        int e = n[a];
        for (int t = 0; t < take[a]; t++) {
            v *= e--;
        }
        for (; e > 0; e--) {
            v *= x[a];
        }
    }
    return v;
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

/// Worst error of any monomial of the basis (about `at`) in any term; lengths in units of `h`.
static double reproduction_error(const pal_mls *m, int degree, int order, const double at[3],
                                 double h) {
    double worst = 0.0;
    int terms = order == 2 ? 10 : order == 1 ? 4 : 1;
    for (int i = 0; i <= degree; i++) {
        for (int j = 0; i + j <= degree; j++) {
            for (int k = 0; i + j + k <= degree; k++) {
                int n[3] = {i, j, k};
                for (int t = 0; t < terms; t++) {
                    int take[3], none[3] = {0, 0, 0};
                    take_of(t, take);
                    double sum = 0.0;
                    for (int32_t s = 0; s < m->count; s++) {
                        double y[3];
                        for (int a = 0; a < 3; a++) {
                            y[a] = (m->position[3 * s + a] - at[a]) / h;
                        }
                        sum += term(m, s, t) * pow(h, scale_of[t]) * monomial(n, none, y);
                    }
                    double zero[3] = {0, 0, 0};
                    double e = fabs(sum - monomial(n, take, zero));
                    worst = e > worst ? e : worst;
                }
            }
        }
    }
    return worst;
}

static void every_monomial_and_its_derivatives_are_reproduced(void **state) {
    (void)state;
    double *x = malloc(3 * NODES * sizeof *x);
    double worst[4] = {0};
    for (int jittered = 0; jittered < 2; jittered++) {
        lattice(jittered ? 0.3 : 0.0, x);
        pal_neighbours tree;
        tree_of(x, NODES, &tree);
        pal_mls m = {0};
        pal_error e = {0};
        for (int basis = 1; basis <= 3; basis++) {
            for (int p = 0; p <= 3; p++) {
                for (int place = 0; place < 24; place++) {
                    int k = places[place % 4];
                    double at[3];
                    for (int a = 0; a < 3; a++) { // nodes, points between, points beside a node
                        double far = place < 4 ? 0.0 : place < 16 ? 0.5 : 1e-6;
                        at[a] = x[3 * k + a] + far * uniform();
                    }
                    for (int mode = 0; mode < 4; mode++) {
                        pal_mls_options o = {.basis = (pal_basis)basis,
                                             .exponent = p,
                                             .order = 2,
                                             .derivatives = (pal_derivatives)(mode % 2),
                                             .weight = (pal_weight)(mode / 2)};
                        assert_int_equal(pal_mls_stencil(&m, &tree, &o, at, 0, NULL, &e),
                                         PALPATE_OK);
                        double err = reproduction_error(&m, basis, 2, at, 1.0);
                        worst[basis] = err > worst[basis] ? err : worst[basis];
                    }
                }
            }
        }
        pal_mls_clear(&m);
        pal_neighbours_clear(&tree);
    }
    print_message("# worst reproduction error: linear %.1e quadratic %.1e cubic %.1e\n", worst[1],
                  worst[2], worst[3]);
    // rounding times the stencils' amplification (sum |d2h_J|, up to a few hundred for cubic
    // corners)
    assert_true(worst[1] < 1e-12);
    assert_true(worst[2] < 1e-11);
    assert_true(worst[3] < 1e-10);
    free(x);
}

/// ---- Invariance ----------------------------------------------------------------------------

static void results_do_not_depend_on_frame_or_scale(void **state) {
    (void)state;
    // a rotation about (1, 2, 3) by 1 rad
    double axis[3] = {1 / sqrt(14.0), 2 / sqrt(14.0), 3 / sqrt(14.0)}, rot[3][3];
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            double cross = i == j ? 0.0 : ((j - i + 3) % 3 == 1 ? -1.0 : 1.0) * axis[3 - i - j];
            rot[i][j] =
                (i == j) * cos(1.0) + (1.0 - cos(1.0)) * axis[i] * axis[j] + sin(1.0) * cross;
        }
    }
    double *x = malloc(3 * NODES * sizeof *x), *y = malloc(3 * NODES * sizeof *y);
    double *ref = malloc(10 * NODES * sizeof *ref);
    pal_mls m = {0};
    pal_error e = {0};
    for (int jittered = 0; jittered < 2; jittered++) {
        lattice(jittered ? 0.3 : 0.0, x);
        for (int basis = 1; basis <= 3; basis++) {
            for (int place = 0; place < 8; place++) {
                int k = places[place % 4];
                double off = place < 4 ? 0.0 : 0.3;
                double at[3] = {x[3 * k] + off, x[3 * k + 1] + 0.5 * off,
                                x[3 * k + 2] + 0.25 * off};
                pal_mls_options o = {.basis = (pal_basis)basis, .exponent = 2, .order = 2};
                pal_neighbours tree;
                tree_of(x, NODES, &tree);
                assert_int_equal(pal_mls_stencil(&m, &tree, &o, at, 0, NULL, &e), PALPATE_OK);
                int32_t count = m.count;
                for (int i = 0; i < 10 * NODES; i++) {
                    ref[i] = 0.0;
                }
                for (int32_t j = 0; j < m.count; j++) {
                    for (int t = 0; t < 10; t++) {
                        ref[10 * m.node[j] + t] = term(&m, j, t);
                    }
                }
                pal_neighbours_clear(&tree);
                static const double scales[] = {1e-6, 1e-3, 0x1p-20, 0x1p30, 10.0, 1e6, 1.0, 1.0};
                for (int c = 0; c < 8; c++) {
                    double s = scales[c];
                    int rotated = c == 6, moved = c == 7;
                    double to[3];
                    for (int i = -1; i < NODES; i++) {
                        const double *from = i < 0 ? at : x + 3 * i;
                        double *into = i < 0 ? to : y + 3 * i;
                        for (int a = 0; a < 3; a++) {
                            into[a] = s * from[a];
                            if (rotated) {
                                into[a] =
                                    rot[a][0] * from[0] + rot[a][1] * from[1] + rot[a][2] * from[2];
                            } else if (moved) {
                                into[a] += 100.0 * (a + 1);
                            }
                        }
                    }
                    tree_of(y, NODES, &tree);
                    assert_int_equal(pal_mls_stencil(&m, &tree, &o, to, 0, NULL, &e), PALPATE_OK);
                    assert_int_equal(m.count, count);
                    for (int32_t j = 0; j < m.count; j++) {
                        const double *want = ref + 10 * m.node[j];
                        double got[10], d[3], h[3][3];
                        for (int t = 0; t < 10; t++) {
                            got[t] = term(&m, j, t) * pow(s, scale_of[t]);
                        }
                        if (c == 2 || c == 3) { // a power of two changes nothing, not even rounding
                            assert_memory_equal(got, want, sizeof got);
                            continue;
                        }
                        if (rotated) { // back into the first frame
                            static const int at_of[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
                            static const int first[6] = {0, 0, 0, 1, 1, 2};
                            static const int second[6] = {0, 1, 2, 1, 2, 2};
                            for (int a = 0; a < 3; a++) {
                                d[a] = rot[0][a] * got[1] + rot[1][a] * got[2] + rot[2][a] * got[3];
                                for (int b = 0; b < 3; b++) {
                                    h[a][b] = 0.0;
                                    for (int i = 0; i < 3; i++) {
                                        for (int l = 0; l < 3; l++) {
                                            h[a][b] += rot[i][a] * rot[l][b] * got[4 + at_of[i][l]];
                                        }
                                    }
                                }
                            }
                            memcpy(got + 1, d, sizeof d);
                            for (int q = 0; q < 6; q++) {
                                got[4 + q] = h[first[q]][second[q]];
                            }
                        }
                        // coordinates of order 300 carry 6e-14; cubic stencils amplify rounding
                        double tolerance = (moved ? 300.0 : 1.0) * (basis == 3 ? 1e-11 : 1e-12);
                        for (int t = 0; t < 10; t++) {
                            assert_true(fabs(got[t] - want[t]) < tolerance);
                        }
                    }
                    pal_neighbours_clear(&tree);
                }
            }
        }
    }
    pal_mls_clear(&m);
    free(x);
    free(y);
    free(ref);
}

/// ---- Deficient stencils --------------------------------------------------------------------

static void deficient_stencils_grow_and_are_counted(void **state) {
    (void)state;
    double *x = malloc(3 * NODES * sizeof *x);
    lattice(0.0, x);
    for (int i = 0; i < NODES; i++) { // layers four spacings apart: 49 coplanar nodes come first
        x[3 * i + 2] *= 4.0;
    }
    pal_neighbours tree;
    tree_of(x, NODES, &tree);
    pal_mls m = {0};
    pal_error e = {0};
    for (int basis = 1; basis <= 2; basis++) {
        pal_stencil_report report = {0};
        pal_mls_options o = {.basis = (pal_basis)basis, .exponent = 2, .order = 2};
        const double *node = x + 3 * places[0];
        assert_int_equal(pal_mls_stencil(&m, &tree, &o, node, 12, &report, &e), PALPATE_OK);
        assert_int_equal(report.count, 1);
        assert_int_equal(report.grown, 1);
        assert_true(m.count > 25 && report.max_neighbours == m.count);
        assert_true(reproduction_error(&m, basis, 2, node, 1.0) < 1e-9);
        assert_int_equal(pal_mls_stencil(&m, &tree, &o, node, 150, &report, &e), PALPATE_OK);
        assert_int_equal(report.count, 2);
        assert_int_equal(report.grown, 1);
        assert_true(report.worst_condition >= 1.0 && isfinite(report.worst_condition));
    }
    pal_neighbours_clear(&tree);

    // nothing to grow into: a plane, tilted so that rounding hides it; a line; one point many times
    for (int shape = 0; shape < 3; shape++) {
        for (int i = 0; i < NODES; i++) {
            double u = shape == 2 ? 0.0 : uniform(), v = shape == 0 ? uniform() : 0.0;
            x[3 * i] = 3.0 + u + 0.3 * v;
            x[3 * i + 1] = 4.0 + 0.5 * u - v;
            x[3 * i + 2] = 5.0 + 0.7 * u + 0.1 * v;
        }
        tree_of(x, NODES, &tree);
        pal_mls_options o = {.basis = PALPATE_BASIS_LINEAR, .exponent = 2, .order = 1};
        memset(&e, 0, sizeof e);
        assert_int_equal(pal_mls_stencil(&m, &tree, &o, x, 0, NULL, &e), PALPATE_ERROR_STENCIL);
        assert_non_null(strstr(e.message, shape == 2 ? "coincide" : "rank"));
        char where[64];
        snprintf(where, sizeof where, "(%g, %g, %g)", x[0], x[1], x[2]);
        assert_non_null(strstr(e.message, where));
        if (shape < 2) { // values within the plane or line are still to be had
            o.accept_deficient = 1;
            o.order = 0;
            double at[3];
            for (int a = 0; a < 3; a++) {
                at[a] = 0.5 * (x[a] + x[3 + a]);
            }
            assert_int_equal(pal_mls_stencil(&m, &tree, &o, at, 8, NULL, &e), PALPATE_OK);
            assert_int_equal(m.info.rank, 2 - shape);
            // the plane is flat to rounding only: 1e-15 of coordinates of order 5
            assert_true(reproduction_error(&m, 1, 0, at, 1.0) < 1e-13);
        }
        pal_neighbours_clear(&tree);
    }

    // two nodes in one place: no shape function can tell them apart
    lattice(0.2, x);
    int k = places[0];
    memcpy(x + 3 * (k + 1), x + 3 * k, 3 * sizeof *x);
    tree_of(x, NODES, &tree);
    pal_mls_options o = {.basis = PALPATE_BASIS_QUADRATIC, .exponent = 2, .order = 2};
    assert_int_equal(pal_mls_stencil(&m, &tree, &o, x + 3 * k, 0, NULL, &e), PALPATE_ERROR_STENCIL);
    assert_non_null(strstr(e.message, "coincide; remove one"));
    // other nodes' stencils do not mind
    assert_int_equal(pal_mls_stencil(&m, &tree, &o, x + 3 * (k + EDGE), 0, NULL, &e), PALPATE_OK);
    assert_true(reproduction_error(&m, 2, 2, x + 3 * (k + EDGE), 1.0) < 1e-10);
    pal_neighbours_clear(&tree);

    // nearly so (1e-6 of the spacing): still interpolating, still reproducing
    x[3 * (k + 1)] += 1e-6;
    tree_of(x, NODES, &tree);
    for (int basis = 1; basis <= 3; basis++) {
        o.basis = (pal_basis)basis;
        o.order = 1;
        assert_int_equal(pal_mls_stencil(&m, &tree, &o, x + 3 * k, 0, NULL, &e), PALPATE_OK);
        assert_true(m.phi[0] == 1.0 && m.phi[1] == 0.0);
        // derivatives difference values 1e-6 apart: 1e-16 / 1e-6, with room for the basis
        assert_true(reproduction_error(&m, basis, 1, x + 3 * k, 1.0) < 1e-8);
    }
    pal_neighbours_clear(&tree);
    pal_mls_clear(&m);
    free(x);
}

static void arguments_are_checked(void **state) {
    (void)state;
    pal_mls m = {0};
    double x[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1}, phi[4];
    pal_mls_options o = {.basis = PALPATE_BASIS_LINEAR, .exponent = 2, .order = 1};
    pal_mls_info info;
    assert_int_equal(pal_mls_shape(&m, &o, x, 2.0, 4, x, phi, NULL, NULL, &info),
                     PALPATE_ERROR_ARGUMENT);
    o.order = 0;
    assert_int_equal(pal_mls_shape(&m, &o, x, 0.0, 4, x, phi, NULL, NULL, &info),
                     PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_mls_shape(&m, &o, x, NAN, 4, x, phi, NULL, NULL, &info),
                     PALPATE_ERROR_ARGUMENT);
    double far[3] = {50, 0, 0}; // outside every node's sphere
    assert_int_equal(pal_mls_shape(&m, &o, far, 2.0, 4, x, phi, NULL, NULL, &info),
                     PALPATE_ERROR_STENCIL);
    assert_int_equal(pal_mls_shape(&m, &o, x, 2.0, 4, x, phi, NULL, NULL, &info), PALPATE_OK);
    assert_int_equal(info.rank, 3);
    pal_mls_clear(&m);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(shape_functions_are_delta_at_nodes),
        cmocka_unit_test(every_monomial_and_its_derivatives_are_reproduced),
        cmocka_unit_test(results_do_not_depend_on_frame_or_scale),
        cmocka_unit_test(deficient_stencils_grow_and_are_counted),
        cmocka_unit_test(arguments_are_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
