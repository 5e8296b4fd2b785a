/// Winding numbers and nearest triangles against the known box.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>

#include <cmocka.h>

#include "src/cloud/locate.h"
#include "src/discretization/neighbours.h"

static void inside_is_one_and_outside_zero(void **state) {
    (void)state;
    pal_cloud box = {0};
    const double size[3] = {1.0, 0.5, 0.25};
    const int n[3] = {4, 3, 2};
    assert_int_equal(pal_cloud_box(&box, size, n, 0.2, 3, NULL), PALPATE_OK);
    const double in[3] = {0.3, 0.2, 0.1}, out[3] = {0.3, 0.2, 0.27}, far[3] = {9, 9, 9};
    assert_true(fabs(pal_cloud_winding(&box, in) - 1.0) < 1e-12);
    assert_true(fabs(pal_cloud_winding(&box, out)) < 1e-12);
    assert_true(fabs(pal_cloud_winding(&box, far)) < 1e-12);
    pal_cloud_clear(&box);
}

static void nearest_points_of_a_triangle(void **state) {
    (void)state;
    const double a[3] = {0, 0, 0}, b[3] = {1, 0, 0}, c[3] = {0, 1, 0};
    const struct {
        double x[3], w[3], d;
    } t[] = {
        {{0.25, 0.25, 2}, {0.5, 0.25, 0.25}, 4}, // above the face
        {{-1, -1, 0}, {1, 0, 0}, 2},             // vertex a
        {{3, 0, 0}, {0, 1, 0}, 4},               // vertex b
        {{0, 2, 1}, {0, 0, 1}, 2},               // vertex c
        {{0.5, -1, 0}, {0.5, 0.5, 0}, 1},        // edge ab
        {{-1, 0.5, 0}, {0.5, 0, 0.5}, 1},        // edge ac
        {{1, 1, 0}, {0, 0.5, 0.5}, 0.5},         // edge bc
    };
    for (size_t i = 0; i < sizeof t / sizeof t[0]; i++) {
        double w[3], d = pal_triangle_nearest(a, b, c, t[i].x, w);
        assert_true(fabs(d - t[i].d) < 1e-14);
        for (int k = 0; k < 3; k++) {
            assert_true(fabs(w[k] - t[i].w[k]) < 1e-14);
        }
    }
}

static void nearest_triangle_of_the_box_gives_the_distance_to_its_face(void **state) {
    (void)state;
    pal_cloud box = {0};
    const double size[3] = {1, 1, 1};
    const int n[3] = {5, 5, 5};
    assert_int_equal(pal_cloud_box(&box, size, n, 0.2, 3, NULL), PALPATE_OK);
    pal_triangle_ring ring;
    pal_neighbours near;
    assert_int_equal(pal_triangle_ring_build(&box, &ring, NULL), PALPATE_OK);
    assert_int_equal(pal_neighbours_create(&near, box.position, box.surface_count, NULL),
                     PALPATE_OK);
    for (int i = 0; i < 50; i++) {
        double x[3] = {0.5 + 0.4 * sin(i), 0.5 + 0.4 * cos(3.0 * i), 1.3}, d, w[3], square[6];
        int32_t node[6];
        pal_neighbours_nearest(&near, x, 6, node, square);
        int32_t t = pal_cloud_nearest_triangle(&box, &ring, node, 6, x, &d, w);
        assert_true(t >= 0 && fabs(d - 0.3) < 1e-12);
        for (int k = 0; k < 3; k++) {
            double p = 0;
            for (int v = 0; v < 3; v++) {
                p += w[v] * box.position[3 * box.triangle[3 * t + v] + k];
            }
            assert_true(fabs(p - (k == 2 ? 1.0 : x[k])) < 1e-12);
        }
    }
    pal_triangle_ring_clear(&ring);
    pal_neighbours_clear(&near);
    pal_cloud_clear(&box);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(inside_is_one_and_outside_zero),
        cmocka_unit_test(nearest_points_of_a_triangle),
        cmocka_unit_test(nearest_triangle_of_the_box_gives_the_distance_to_its_face),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
