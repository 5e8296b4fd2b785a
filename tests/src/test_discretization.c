/// Dispatch to the methods, interpolation of a solution at any point.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/discretization/discretization.h"

static void make_box(pal_cloud *cloud, int n, double jitter) {
    const double size[3] = {1, 1, 1};
    const int cells[3] = {n, n, n};
    pal_error e = {0};
    assert_int_equal(pal_cloud_box(cloud, size, cells, jitter, 3, &e), PALPATE_OK);
}

static void every_kind_reaches_its_method(void **state) {
    (void)state;
    pal_cloud cloud;
    make_box(&cloud, 4, 0.2);
    uint8_t *fixed = calloc((size_t)cloud.node_count, 1);
    for (int32_t i = 0; i < cloud.surface_count; i++) {
        fixed[i] = cloud.position[3 * i + 2] == 0.0;
    }
    pal_error e = {0};
    static const pal_method_kind kinds[3] = {PALPATE_METHOD_POINT, PALPATE_METHOD_CELL,
                                             PALPATE_METHOD_GALERKIN};
    for (int k = 0; k < 3; k++) {
        pal_method m = {.kind = kinds[k], .stabilization = -1.0};
        pal_system s;
        assert_int_equal(pal_discretize(&cloud, fixed, 0.3, &m, NULL, &s, &e), PALPATE_OK);
        assert_int_equal(s.node_count, cloud.node_count);
        assert_int_equal(s.matrix.rows, s.unknown_count);
        assert_int_equal(s.load.columns, 3 * cloud.surface_count);
        assert_int_equal(s.fixed_count, 25);
        assert_int_equal(s.reaction.rows, 3 * 25);
        for (int32_t i = 0; i < 3 * cloud.node_count; i++) {
            assert_true(fixed[i / 3] ? s.dof_unknown[i] == -1
                                     : s.dof_unknown[i] >= 0 && s.dof_unknown[i] < s.unknown_count);
        }
        pal_system_clear(&s);
        assert_null(s.dof_unknown);
    }
    pal_method m = {.kind = (pal_method_kind)7};
    pal_system s;
    assert_int_equal(pal_discretize(&cloud, fixed, 0.3, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "7"));
    m.kind = PALPATE_METHOD_POINT;
    assert_int_equal(pal_discretize(&cloud, fixed, 0.5, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_discretize(&cloud, fixed, -1.0, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_discretize(NULL, fixed, 0.3, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_discretize(&cloud, NULL, 0.3, &m, NULL, &s, &e), PALPATE_ERROR_ARGUMENT);
    free(fixed);
    pal_cloud_clear(&cloud);
}

static double linear(const double x[3]) {
    return 0.3 - 1.2 * x[0] + 0.7 * x[1] + 2.0 * x[2];
}

static void interpolation_is_exact_for_linear_fields(void **state) {
    (void)state;
    pal_cloud cloud;
    make_box(&cloud, 5, 0.25);
    int32_t node[16];
    double weight[16];
    uint64_t seed = 1;
    for (int i = 0; i < 300; i++) {
        double x[3];
        for (int a = 0; a < 3; a++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            x[a] = (double)(seed >> 11) * 0x1p-53;
        }
        int32_t capacity = i % 2 ? 16 : 8;
        int32_t first = i % 3 == 2 ? cloud.surface_count : cloud.node_count;
        if (i % 3 == 1) {
            x[2] = 1.0; // on a face: with 8 nodes they may all lie in it
        }
        // surface nodes alone: ask on the surface
        if (first == cloud.surface_count) {
            x[0] = 0.0;
        }
        int32_t count = pal_interpolate_nodes(cloud.position, first, x, capacity, node, weight);
        assert_in_range(count, 1, capacity);
        double sum = 0.0, one = 0.0;
        for (int32_t j = 0; j < count; j++) {
            assert_in_range(node[j], 0, first - 1);
            sum += weight[j] * linear(cloud.position + 3 * node[j]);
            one += weight[j];
        }
        assert_true(fabs(one - 1.0) < 1e-13);
        assert_true(fabs(sum - linear(x)) < 1e-12);
    }
    for (int32_t i = 0; i < cloud.node_count; i++) { // at a node: the node
        int32_t count = pal_interpolate(&cloud, cloud.position + 3 * i, 16, node, weight);
        assert_int_equal(count, 1);
        assert_int_equal(node[0], i);
        assert_true(weight[0] == 1.0);
    }
    // a hair beside a node: nearly its value, no jump
    double x[3] = {cloud.position[300], cloud.position[301] + 1e-9, cloud.position[302]};
    int32_t count = pal_interpolate(&cloud, x, 16, node, weight);
    assert_true(count > 1 && node[0] == 100 && fabs(weight[0] - 1.0) < 1e-6);
    x[0] = NAN;
    assert_int_equal(pal_interpolate(&cloud, x, 16, node, weight), PALPATE_ERROR_ARGUMENT);
    x[0] = 0.5;
    assert_int_equal(pal_interpolate(&cloud, x, 0, node, weight), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_interpolate(&cloud, x, 1, node, weight), 1);
    pal_cloud_clear(&cloud);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_kind_reaches_its_method),
        cmocka_unit_test(interpolation_is_exact_for_linear_fields),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
