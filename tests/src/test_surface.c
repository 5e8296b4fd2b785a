/// Surface files: formats, welding, every refusal with its message, repairs, and triangle
/// crossings.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/geometry/surface.h"
#include "src/geometry/triangle_cross.h"
#include "tests/support/surfaces.h"

static void check(const char *path, double unit, pal_status status, const char *const *words) {
    pal_surface s;
    pal_error e = {0};
    pal_status got = pal_surface_read(path, &s, &e);
    if (got == PALPATE_OK) {
        got = pal_surface_check(&s, unit, NULL, &e);
    }
    if (got != status) {
        fail_msg("status %d, message '%s', wanted %d", got, e.message, status);
    }
    for (; *words != NULL; words++) {
        if (strstr(e.message, *words) == NULL) {
            fail_msg("message '%s' lacks '%s'", e.message, *words);
        }
    }
    pal_surface_clear(&s);
    (void)unlink(path);
}

#define REFUSED(path, ...)                                                                         \
    check(path, 1.0, PALPATE_ERROR_GEOMETRY, (const char *const[]){__VA_ARGS__, NULL})

static void every_format_gives_the_same_welded_surface(void **state) {
    (void)state;
    static const char *const kind[] = {"obj", "stl", "stlb", "ply"};
    for (size_t i = 0; i < sizeof kind / sizeof kind[0]; i++) {
        test_surface t;
        test_surface_sphere(&t, 2, 1.0);
        char path[64];
        test_surface_write(&t, kind[i], path);
        pal_surface s;
        pal_error e = {0};
        if (pal_surface_read(path, &s, &e) != PALPATE_OK) {
            fail_msg("%s: %s", kind[i], e.message);
        }
        assert_int_equal(s.triangle_count, t.triangle_count);
        assert_int_equal(s.vertex_count, t.vertex_count); // STL stores every corner: welded
        int32_t repaired = -1;
        assert_int_equal(pal_surface_check(&s, 1.0, &repaired, &e), PALPATE_OK);
        assert_int_equal(repaired, 0);
        for (int32_t k = 0; k < s.vertex_count; k++) { // single precision on the way
            double r = sqrt(s.x[3 * k] * s.x[3 * k] + s.x[3 * k + 1] * s.x[3 * k + 1] +
                            s.x[3 * k + 2] * s.x[3 * k + 2]);
            assert_true(fabs(r - 1.0) < 1e-6);
        }
        pal_surface_clear(&s);
        (void)unlink(path);
    }
}

static void files_that_are_no_surface_are_refused(void **state) {
    (void)state;
    char path[64];
    check("/nonexistent/organ.obj", 1.0, PALPATE_ERROR_IO,
          (const char *const[]){"/nonexistent/organ.obj: No such file", NULL});
    test_surface_text("", "obj", path);
    check(path, 1.0, PALPATE_ERROR_IO, (const char *const[]){"not a readable surface", path, NULL});
    test_surface_text("", "stl", path);
    check(path, 1.0, PALPATE_ERROR_IO, (const char *const[]){"not a readable surface", NULL});
    test_surface_text("ply\nformat ascii 1.0\nelement vertex 3\n", "ply", path);
    check(path, 1.0, PALPATE_ERROR_IO, (const char *const[]){"not a readable surface", NULL});
    test_surface_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4000000000\n", "obj", path);
    check(path, 1.0, PALPATE_ERROR_IO, (const char *const[]){"not a readable surface", NULL});
    // a file cut off in the middle
    test_surface t;
    test_surface_sphere(&t, 2, 1.0);
    test_surface_write(&t, "stlb", path);
    assert_int_equal(truncate(path, 1000), 0);
    check(path, 1.0, PALPATE_ERROR_IO, (const char *const[]){"not a readable surface", NULL});
}

static void bad_numbers_are_refused(void **state) {
    (void)state;
    test_surface t;
    char path[64];
    test_surface_sphere(&t, 1, 1.0);
    t.x[3] = NAN;
    test_surface_write(&t, "stlb", path);
    REFUSED(path, "not a finite number");
    t.x[3] = HUGE_VAL;
    test_surface_write(&t, "stlb", path);
    REFUSED(path, "not a finite number");
}

static void open_surfaces_are_refused_with_the_place(void **state) {
    (void)state;
    test_surface t;
    char path[64];
    test_surface_sphere(&t, 1, 1.0);
    t.triangle_count--;
    test_surface_write(&t, "obj", path);
    check(path, 0.001, PALPATE_ERROR_GEOMETRY,
          (const char *const[]){"the surface is open: 3 edges have only one triangle, at (",
                                "m: close the holes", "0.000353553",
                                NULL}); // metres: the file is in millimetres
}

static void non_manifold_surfaces_are_refused(void **state) {
    (void)state;
    test_surface t;
    char path[64];
    // two cubes that share one edge
    test_surface_cube(&t, 0.0, 0.0, 0.0);
    test_surface_cube_more(&t, 1.0, 1.0, 0.0);
    test_surface_write(&t, "stl", path);
    REFUSED(path, "not a manifold: 1 edge is shared by more than two triangles, at (1, 1, 0.5) m");
    // two cubes that touch in a corner
    test_surface_cube(&t, 0.0, 0.0, 0.0);
    test_surface_cube_more(&t, 1.0, 1.0, 1.0);
    test_surface_write(&t, "stl", path);
    REFUSED(path,
            "not a manifold: 1 vertex where two parts of it touch in a point, at (1, 1, 1) m");
}

static void separate_parts_are_refused(void **state) {
    (void)state;
    test_surface t;
    char path[64];
    test_surface_cube(&t, 0.0, 0.0, 0.0);
    test_surface_cube_more(&t, 3.0, 0.0, 0.0);
    test_surface_write(&t, "obj", path);
    REFUSED(path, "2 separate parts", "keep one part or join them");
}

static void self_intersections_are_counted_and_placed(void **state) {
    (void)state;
    test_surface t;
    char path[64];
    test_surface_sphere(&t, 2, 1.0);
    // pull the top through the bottom
    int32_t top = 0;
    for (int32_t i = 0; i < t.vertex_count; i++) {
        top = t.x[3 * i + 2] > t.x[3 * top + 2] ? i : top;
    }
    t.x[3 * top + 2] = -1.3;
    test_surface_write(&t, "ply", path);
    // a spike of valence 4 through the four triangles around the bottom vertex
    REFUSED(path, "intersects itself", "pairs of triangles", "at (", "separate them");
}

static void degenerate_and_flat_surfaces_are_refused(void **state) {
    (void)state;
    test_surface t;
    char path[64];
    test_surface_cube(&t, 0.0, 0.0, 0.0);
    // a vertex in the middle of an edge, with a triangle of no area to close the gap
    int32_t a = t.v[0], b = t.v[1], c = t.v[2], n = t.vertex_count++;
    for (int d = 0; d < 3; d++) {
        t.x[3 * n + d] = 0.5 * (t.x[3 * a + d] + t.x[3 * b + d]);
    }
    const int32_t fresh[9] = {a, n, c, n, b, c, a, b, n};
    memcpy(t.v, fresh, 3 * sizeof *fresh);
    memcpy(t.v + 3 * t.triangle_count, fresh + 3, 6 * sizeof *fresh);
    t.triangle_count += 2;
    test_surface_write(&t, "obj", path);
    REFUSED(path, "1 degenerate triangle (three corners on a line)", "collapse short edges");
    test_surface_sphere(&t, 1, 1.0);
    for (int32_t i = 0; i < t.vertex_count; i++) {
        t.x[3 * i + 2] = 0.0;
    }
    test_surface_write(&t, "obj", path);
    REFUSED(path, "20 edges are shared by more than two triangles"); // the halves coincide
    test_surface_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0.3 0.3 0\n"
                      "f 1 2 4\nf 2 3 4\nf 3 1 4\nf 1 3 2\n",
                      "obj", path);
    REFUSED(path, "encloses no volume", "flat or folded");
    test_surface_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "obj", path);
    REFUSED(path, "too few to close a body");
}

static double volume_of(const pal_surface *s) {
    double sum = 0.0;
    for (int32_t t = 0; t < s->triangle_count; t++) {
        const double *a = s->x + 3 * s->v[3 * t], *b = s->x + 3 * s->v[3 * t + 1],
                     *c = s->x + 3 * s->v[3 * t + 2];
        sum += (a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
                a[2] * (b[0] * c[1] - b[1] * c[0])) /
               6.0;
    }
    return sum;
}

static void orientation_is_repaired_and_counted(void **state) {
    (void)state;
    for (int turned = 1; turned <= 128; turned += 127) { // one triangle; all of them (inside out)
        test_surface t;
        char path[64];
        test_surface_sphere(&t, 2, 1.0);
        assert_int_equal(t.triangle_count, 128);
        for (int32_t i = 0; i < turned; i++) {
            int32_t keep = t.v[3 * i];
            t.v[3 * i] = t.v[3 * i + 1];
            t.v[3 * i + 1] = keep;
        }
        test_surface_write(&t, "obj", path);
        pal_surface s;
        pal_error e = {0};
        int32_t repaired = 0;
        assert_int_equal(pal_surface_read(path, &s, &e), PALPATE_OK);
        assert_int_equal(pal_surface_check(&s, 1.0, &repaired, &e), PALPATE_OK);
        assert_int_equal(repaired, turned);
        assert_true(volume_of(&s) > 3.5);
        pal_surface_clear(&s);
        (void)unlink(path);
    }
}

static void one_sided_surfaces_are_refused(void **state) {
    (void)state;
    // the smallest projective plane: six vertices, ten triangles, every edge shared by two
    static const int32_t v[10][3] = {{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 1},
                                     {1, 2, 4}, {2, 3, 5}, {3, 4, 1}, {4, 5, 2}, {5, 1, 3}};
    static const double x[18] = {0,   0,   0, 1, 0, 0.1, 0,   1,   0.2,
                                 0.3, 0.1, 1, 1, 1, 0.4, 0.2, 0.9, 1.1};
    pal_surface s = {6, 10, malloc(sizeof x), malloc(sizeof v)};
    pal_error e = {0};
    assert_non_null(s.x);
    assert_non_null(s.v);
    memcpy(s.x, x, sizeof x);
    memcpy(s.v, v, sizeof v);
    assert_int_equal(pal_surface_check(&s, 1.0, NULL, &e), PALPATE_ERROR_GEOMETRY);
    assert_non_null(strstr(e.message, "one side only"));
    pal_surface_clear(&s);
}

static void crossings_are_exact(void **state) {
    (void)state;
    // triangle 0 1 2 in z = 0; others against it
    static const double x[] = {0, 0,  0,    4, 0, 0, 0, 4, 0,  // 0 1 2
                               1, 1,  -1,   1, 1, 1, 5, 5, 0,  // 3 4 5: pierces
                               1, 1,  1e-7, 2, 1, 1, 1, 2, 1,  // 6 7 8: hovers above
                               1, 1,  0,    2, 1, 0, 1, 2, 0,  // 9 10 11: coplanar, inside
                               5, 5,  0,    6, 5, 0, 5, 6, 0,  // 12 13 14: coplanar, beside
                               2, 2,  0,    3, 3, 1, 3, 3, -1, // 15 16 17: touches the long edge
                               2, -1, 0};                      // 18: beyond edge 0 1
    static const struct {
        int32_t b[3];
        int crosses;
    } pair[] = {
        {{3, 4, 5}, 1},    {{6, 7, 8}, 0},    {{9, 10, 11}, 1},
        {{12, 13, 14}, 0}, {{15, 16, 17}, 1}, {{0, 3, 4}, 1}, // shares a corner, pierces
        {{0, 7, 8}, 0},                                       // shares a corner, leans away
        {{0, 10, 11}, 1},                                     // shares a corner, lies in it
        {{1, 0, 18}, 0},                                      // the neighbour over an edge
        {{1, 0, 9}, 1},                                       // folded back onto it
        {{1, 0, 8}, 0},                                       // folded up
        {{2, 0, 1}, 1},                                       // the same triangle
    };
    const int32_t a[3] = {0, 1, 2};
    for (size_t i = 0; i < sizeof pair / sizeof pair[0]; i++) {
        if (pal_triangles_cross(x, a, pair[i].b) != pair[i].crosses ||
            pal_triangles_cross(x, pair[i].b, a) != pair[i].crosses) {
            fail_msg("pair %zu", i);
        }
    }
}

static void the_reference_livers(void **state) {
    (void)state;
    char path[1024];
    if (!test_shared("data/liver-smooth.obj", path, sizeof path)) {
        skip();
    }
    pal_surface s;
    pal_error e = {0};
    assert_int_equal(pal_surface_read(path, &s, &e), PALPATE_OK);
    assert_int_equal(pal_surface_check(&s, 0.1, NULL, &e), PALPATE_ERROR_GEOMETRY);
    assert_non_null(strstr(e.message, "intersects itself: 5 pairs of triangles"));
    assert_non_null(strstr(e.message, "(-0.20984, 0.410326, -0.0988233)"));
    pal_surface_clear(&s);
    assert_true(test_shared("data/liver2.obj", path, sizeof path));
    assert_int_equal(pal_surface_read(path, &s, &e), PALPATE_OK);
    assert_int_equal(pal_surface_check(&s, 0.1, NULL, &e), PALPATE_OK);
    pal_surface_clear(&s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_format_gives_the_same_welded_surface),
        cmocka_unit_test(files_that_are_no_surface_are_refused),
        cmocka_unit_test(bad_numbers_are_refused),
        cmocka_unit_test(open_surfaces_are_refused_with_the_place),
        cmocka_unit_test(non_manifold_surfaces_are_refused),
        cmocka_unit_test(separate_parts_are_refused),
        cmocka_unit_test(self_intersections_are_counted_and_placed),
        cmocka_unit_test(degenerate_and_flat_surfaces_are_refused),
        cmocka_unit_test(orientation_is_repaired_and_counted),
        cmocka_unit_test(one_sided_surfaces_are_refused),
        cmocka_unit_test(crossings_are_exact),
        cmocka_unit_test(the_reference_livers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
