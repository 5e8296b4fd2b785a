/// The cover's spheres: paper 1's rules where they suffice, and always a cover.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/cloud/cover.h"
#include "src/discretization/neighbours.h"

static uint64_t seed = 5;
static double uniform(void) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (double)(seed >> 11) * 0x1p-53;
}

static void spheres_cover_the_body(void **state) {
    (void)state;
    static const double sizes[3][3] = {{1, 1, 1}, {1, 1, 0.05}, {0.1, 0.1, 2}};
    static const int cells[3][3] = {{6, 6, 6}, {9, 9, 2}, {2, 2, 12}};
    for (int shape = 0; shape < 3; shape++) {
        for (int jittered = 0; jittered < 2; jittered++) {
            pal_cloud c;
            pal_error e = {0};
            assert_int_equal(pal_cloud_box(&c, sizes[shape], cells[shape], jittered * 0.3, 8, &e),
                             PALPATE_OK);
            pal_cover cover;
            assert_int_equal(pal_cover_build(&c, &cover, &e), PALPATE_OK);
            assert_true(cover.min > 0.0 && cover.min <= cover.mean && cover.mean <= cover.max);
            // spheres stay local: no wider than the factor says
            assert_true(cover.largest_enlargement >= 1.0 && cover.max < 8.0);
            for (int i = 0; i < 20000; i++) { // any point of the body is in some sphere
                double x[3];
                for (int a = 0; a < 3; a++) {
                    x[a] = sizes[shape][a] * uniform();
                }
                int inside = 0;
                for (int32_t j = 0; j < c.node_count && !inside; j++) {
                    double d2 = 0.0;
                    for (int a = 0; a < 3; a++) {
                        d2 += (x[a] - c.position[3 * j + a]) * (x[a] - c.position[3 * j + a]);
                    }
                    inside = d2 < cover.radius[j] * cover.radius[j];
                }
                assert_true(inside);
            }
            pal_cover_clear(&cover);
            assert_null(cover.radius);
            pal_cloud_clear(&c);
        }
    }
}

static void radii_follow_the_rules_where_they_suffice(void **state) {
    (void)state;
    const double size[3] = {1, 1, 1};
    const int n[3] = {8, 8, 8};
    pal_cloud c, big;
    pal_error e = {0};
    assert_int_equal(pal_cloud_box(&c, size, n, 0.0, 1, &e), PALPATE_OK);
    pal_cover cover, scaled;
    assert_int_equal(pal_cover_build(&c, &cover, &e), PALPATE_OK);
    // deep inside a Kuhn lattice a node has 14 edges: 6 of h, 6 of sqrt(2) h, 2 of sqrt(3) h
    const double h = 0.125, mean = h * (6.0 + 6.0 * sqrt(2.0) + 2.0 * sqrt(3.0)) / 14.0;
    int checked = 0;
    for (int32_t i = c.surface_count; i < c.node_count; i++) {
        int deep = 1;
        for (int a = 0; a < 3; a++) {
            deep &= fabs(c.position[3 * i + a] - 0.5) < 0.2;
        }
        if (deep) {
            assert_true(fabs(cover.radius[i] - mean) < 1e-14);
            checked++;
        }
    }
    assert_true(checked > 20);
    // scale-free: the same body, 2^-20 as large
    const double small[3] = {0x1p-20, 0x1p-20, 0x1p-20};
    assert_int_equal(pal_cloud_box(&big, small, n, 0.0, 1, &e), PALPATE_OK);
    assert_int_equal(pal_cover_build(&big, &scaled, &e), PALPATE_OK);
    for (int32_t i = 0; i < c.node_count; i++) {
        assert_true(scaled.radius[i] == cover.radius[i] * 0x1p-20);
    }
    pal_cover_clear(&cover);
    pal_cover_clear(&scaled);
    pal_cloud_clear(&c);
    pal_cloud_clear(&big);
}

static void a_node_without_a_tetrahedron_is_named(void **state) {
    (void)state;
    const double size[3] = {1, 1, 1};
    const int n[3] = {4, 4, 4};
    pal_cloud c;
    pal_error e = {0};
    assert_int_equal(pal_cloud_box(&c, size, n, 0.0, 1, &e), PALPATE_OK);
    int32_t lonely = c.surface_count, kept = 0;
    while (c.position[3 * lonely] != 0.5 || c.position[3 * lonely + 1] != 0.5 ||
           c.position[3 * lonely + 2] != 0.5) {
        lonely++; // the middle of the box
    }
    for (int32_t t = 0; t < c.tet_count; t++) {
        int32_t *v = c.tet + 4 * t;
        if (v[0] != lonely && v[1] != lonely && v[2] != lonely && v[3] != lonely) {
            memmove(c.tet + 4 * kept++, v, 4 * sizeof *v);
        }
    }
    c.tet_count = kept;
    pal_cover cover;
    assert_int_equal(pal_cover_build(&c, &cover, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "(0.5, 0.5, 0.5)"));
    assert_null(cover.radius);
    pal_cloud_clear(&c);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(spheres_cover_the_body),
        cmocka_unit_test(radii_follow_the_rules_where_they_suffice),
        cmocka_unit_test(a_node_without_a_tetrahedron_is_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
