/// The cloud's derived quantities against exact values on structured boxes, and its refusals.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>
#include <stdlib.h>
#include <math.h>

#include <cmocka.h>

#include "src/cloud/cloud.h"

static const double SIZE[3] = {1.0, 0.5, 0.25};
static const int CELLS[3] = {6, 4, 3};

static void make_box(pal_cloud *c, double jitter, uint64_t seed) {
    pal_error e = {0};
    if (pal_cloud_box(c, SIZE, CELLS, jitter, seed, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
}

static void box_has_exact_volume_area_and_closed_surface(void **state) {
    (void)state;
    for (int k = 0; k < 3; k++) {
        pal_cloud c;
        make_box(&c, 0.15 * k, 7);
        assert_int_equal(c.node_count, 7 * 5 * 4);
        assert_int_equal(c.surface_count, 7 * 5 * 4 - 5 * 3 * 2);
        pal_cloud_report r;
        pal_cloud_measure(&c, &r);
        // rounding of a few hundred sums
        assert_true(fabs(r.volume - 0.125) < 1e-14);
        assert_true(fabs(r.area - 2 * (0.5 + 0.125 + 0.25)) < 1e-13);
        double sum[3] = {0}, moment = 0;
        for (int32_t i = 0; i < c.surface_count; i++) {
            double n2 = 0, outward = 0;
            for (int d = 0; d < 3; d++) {
                sum[d] += c.area_vector[3 * i + d];
                moment += c.area_vector[3 * i + d] * c.position[3 * i + d] / 3;
                n2 += c.normal[3 * i + d] * c.normal[3 * i + d];
                outward += c.normal[3 * i + d] * (c.position[3 * i + d] - SIZE[d] / 2);
            }
            assert_true(fabs(n2 - 1) < 1e-14);
            assert_true(outward > 0);
        }
        for (int d = 0; d < 3; d++) {
            assert_true(fabs(sum[d]) < 1e-15 * c.surface_count);
        }
        // divergence theorem with nodal area vectors: exact on flat faces
        assert_true(fabs(moment - 0.125) < 1e-13);
        // cells are 1/6 x 1/8 x 1/12: the flattest cut makes atan((1/12) / (1/6)); jitter only
        // worsens
        double flattest = atan(0.5) * 57.29577951308232;
        assert_true(k ? r.dihedral_min < flattest : fabs(r.dihedral_min - flattest) < 1e-9);
        assert_true(r.dihedral_min > 1.0 && r.dihedral_max < 179.0);
        pal_cloud_clear(&c);
        assert_null(c.position);
    }
}

static void jitter_is_deterministic_and_stays_on_faces(void **state) {
    (void)state;
    pal_cloud a, b, other;
    make_box(&a, 0.3, 11);
    make_box(&b, 0.3, 11);
    make_box(&other, 0.3, 12);
    size_t bytes = 3 * (size_t)a.node_count * sizeof(double);
    assert_memory_equal(a.position, b.position, bytes);
    assert_true(memcmp(a.position, other.position, bytes) != 0);
    for (int32_t i = 0; i < a.node_count; i++) {
        int on = 0;
        for (int d = 0; d < 3; d++) {
            on |= a.position[3 * i + d] == 0.0 || a.position[3 * i + d] == SIZE[d];
        }
        assert_int_equal(on, i < a.surface_count);
    }
    pal_cloud_clear(&a);
    pal_cloud_clear(&b);
    pal_cloud_clear(&other);
}

static void spacing_of_a_unit_grid(void **state) {
    (void)state;
    pal_cloud c;
    pal_error e = {0};
    const double size[3] = {4, 4, 4};
    const int n[3] = {4, 4, 4};
    assert_int_equal(pal_cloud_box(&c, size, n, 0.0, 1, &e), PALPATE_OK);
    // inside: 6 axis edges, 6 face diagonals, 2 body diagonals of the Kuhn cut
    double expect = (6 + 6 * sqrt(2) + 2 * sqrt(3)) / 14;
    assert_true(fabs(c.spacing[c.node_count - 1] - expect) < 1e-14);
    assert_true(fabs(c.volume[c.node_count - 1] - 1.0) < 1e-14);
    pal_cloud_clear(&c);
}

static void expect_refused(pal_cloud *c, const char *word) {
    pal_error e = {0};
    assert_int_equal(pal_cloud_complete(c, &e), PALPATE_ERROR_CLOUD);
    if (strstr(e.message, word) == NULL) {
        fail_msg("message '%s' lacks '%s'", e.message, word);
    }
}

static void broken_clouds_are_refused(void **state) {
    (void)state;
    pal_cloud c;
    make_box(&c, 0.1, 3);
    int32_t keep = c.tet[0];
    c.tet[0] = c.tet[1];
    c.tet[1] = keep;
    expect_refused(&c, "has volume"); // inside out
    c.tet[1] = c.tet[0];
    c.tet[0] = c.node_count;
    expect_refused(&c, "names node");
    c.tet[0] = keep;
    int32_t swap = c.triangle[0];
    c.triangle[0] = c.triangle[1];
    c.triangle[1] = swap;
    expect_refused(&c, "not shared"); // a triangle turned over
    c.triangle[1] = c.triangle[0];
    c.triangle[0] = swap;
    c.triangle_count--;
    expect_refused(&c, "not shared"); // a hole
    c.triangle_count++;
    c.surface_count++;
    expect_refused(&c, "no outward direction"); // an inside node declared on the surface
    c.surface_count--;
    double x = c.position[5];
    c.position[5] = NAN;
    expect_refused(&c, "finite");
    c.position[5] = x;
    pal_error e = {0};
    assert_int_equal(pal_cloud_complete(&c, &e), PALPATE_OK);
    pal_cloud_clear(&c);
    pal_cloud_clear(NULL);
    const int none[3] = {0, 1, 1};
    assert_int_equal(pal_cloud_box(&c, SIZE, none, 0.0, 1, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_cloud_box(&c, SIZE, CELLS, 0.5, 1, &e), PALPATE_ERROR_ARGUMENT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(box_has_exact_volume_area_and_closed_surface),
        cmocka_unit_test(jitter_is_deterministic_and_stays_on_faces),
        cmocka_unit_test(spacing_of_a_unit_grid),
        cmocka_unit_test(broken_clouds_are_refused),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
