/// Neighbour search against brute force: random, graded, lattice (ties), duplicates, collinear.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/discretization/neighbours.h"

typedef struct entry {
    double d2;
    int32_t index;
} entry;

static int compare(const void *a, const void *b) {
    const entry *x = a, *y = b;
    if (x->d2 != y->d2) {
        return x->d2 < y->d2 ? -1 : 1;
    }
    return x->index < y->index ? -1 : 1;
}

static uint64_t seed = 1;
static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

static void check(const double *x, int32_t n, int queries) {
    pal_neighbours tree;
    pal_error e = {0};
    assert_int_equal(pal_neighbours_create(&tree, x, n, &e), PALPATE_OK);
    entry *all = malloc((size_t)n * sizeof *all);
    int32_t *index = malloc((size_t)n * sizeof *index);
    double *d2 = malloc((size_t)n * sizeof *d2);
    for (int i = 0; i < queries; i++) {
        double p[3];
        const double *node = x + 3 * (int64_t)(uniform() * n);
        for (int a = 0; a < 3; a++) { // every second query at a node itself, where ties abound
            p[a] = i % 2 ? node[a] : 1.4 * uniform() - 0.2;
        }
        for (int32_t j = 0; j < n; j++) {
            double a = x[3 * j] - p[0], b = x[3 * j + 1] - p[1], c = x[3 * j + 2] - p[2];
            all[j] = (entry){a * a + b * b + c * c, j};
        }
        qsort(all, (size_t)n, sizeof *all, compare);
        int32_t k = 1 + (int32_t)(uniform() * 70);
        int32_t found = pal_neighbours_nearest(&tree, p, k, index, d2);
        assert_int_equal(found, k < n ? k : n);
        for (int32_t j = 0; j < found; j++) {
            assert_int_equal(index[j], all[j].index);
            assert_true(d2[j] == all[j].d2);
        }
        double r = 0.5 * uniform();
        int32_t inside = 0, total = -1;
        while (inside < n && all[inside].d2 <= r * r) {
            inside++;
        }
        found = pal_neighbours_within(&tree, p, r, n, index, d2, &total);
        assert_int_equal(found, inside);
        assert_int_equal(total, inside);
        for (int32_t j = 0; j < found; j++) {
            assert_int_equal(index[j], all[j].index);
        }
        found = pal_neighbours_within(&tree, p, r, 5, index, d2, &total);
        assert_int_equal(total, inside);
        assert_int_equal(found, inside < 5 ? inside : 5);
        for (int32_t j = 0; j < found; j++) {
            assert_int_equal(index[j], all[j].index);
        }
    }
    free(all);
    free(index);
    free(d2);
    pal_neighbours_clear(&tree);
}

static void equals_brute_force(void **state) {
    (void)state;
    enum { N = 1331 };
    double *x = malloc(3 * N * sizeof *x);
    for (int i = 0; i < 3 * N; i++) {
        x[i] = uniform();
    }
    check(x, N, 200);
    check(x, 5, 20);
    check(x, 1, 4);
    for (int i = 0; i < N; i++) { // graded strongly towards a corner
        double g = pow(uniform(), 6.0);
        for (int a = 0; a < 3; a++) {
            x[3 * i + a] = g * uniform();
        }
    }
    check(x, N, 200);
    for (int i = 0; i < N; i++) { // lattice: ties everywhere
        x[3 * i] = (i % 11) * 0.125;
        x[3 * i + 1] = (i / 11 % 11) * 0.125;
        x[3 * i + 2] = (i / 121) * 0.125;
    }
    check(x, N, 200);
    for (int i = 0; i < N; i++) { // every point three times, on a line
        x[3 * i] = (i / 3) * 0.01;
        x[3 * i + 1] = x[3 * i + 2] = 0.0;
    }
    check(x, N, 100);
    for (int i = 0; i < 3 * N; i++) {
        x[i] = 0.5;
    }
    check(x, N, 4);
    free(x);
}

static void refuses_what_is_not_a_cloud(void **state) {
    (void)state;
    double x[6] = {0, 0, 0, 1, NAN, 0};
    pal_neighbours tree;
    pal_error e = {0};
    assert_int_equal(pal_neighbours_create(&tree, x, 2, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "node 1"));
    assert_int_equal(pal_neighbours_create(&tree, x, 0, &e), PALPATE_ERROR_ARGUMENT);
    pal_neighbours_clear(&tree);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(equals_brute_force),
        cmocka_unit_test(refuses_what_is_not_a_cloud),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
