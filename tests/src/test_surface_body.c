/// Bodies from surface files: sharp edges kept, rims on the input surface, the same bits at any
/// scale, volume and distance held, the input's own triangles as a fallback, and the reference
/// liver.
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

#include "src/geometry/bvh.h"
#include "src/cloud/cloud.h"
#include "src/cloud/skin.h"
#include "tests/support/clouds.h"
#include "tests/support/surfaces.h"

static void file_scene(test_scene *t, const char *path, double scale, double spacing) {
    test_scene_init(t, PALPATE_GEOMETRY_FILE, spacing);
    (void)snprintf(t->scene.geometry.path, sizeof t->scene.geometry.path, "%s", path);
    t->scene.geometry.scale = scale;
}

static pal_cloud build(test_scene *t, pal_skin_source *skin) {
    pal_cloud c;
    pal_error e = {0};
    if (pal_cloud_build(&t->scene, NULL, &c, skin, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    return c;
}

static void a_cube_keeps_its_edges_and_corners(void **state) {
    (void)state;
    test_surface cube;
    char path[64];
    test_surface_cube(&cube, 2.0, 3.0, 4.0);
    test_surface_write(&cube, "stl", path);
    test_scene t;
    file_scene(&t, path, 0.1, 0.022);
    pal_skin_source skin;
    pal_cloud c = build(&t, &skin);
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_int_equal(t.scene.warning_count, 0);
    // flat faces, straight edges: exact but for the grid of 1.5e-11 and projections to 1e-11
    assert_true(fabs(r.volume / 1e-3 - 1.0) < 1e-8);
    assert_true(fabs(r.area / 0.06 - 1.0) < 1e-8);
    int corners = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        int ends = 0;
        for (int d = 0; d < 3; d++) {
            double u = c.position[3 * (size_t)i + (size_t)d] * c.length / 0.1 - 2.0 - d;
            ends += fabs(u) < 1e-9 || fabs(u - 1.0) < 1e-9;
        }
        assert_true(ends >= 1);
        corners += ends == 3;
    }
    assert_int_equal(corners, 8);
    assert_int_equal(skin.triangle_count, 12);
    assert_int_equal(skin.vertex_count, 8);
    assert_true(fabs(skin.position[0] - 0.2) < 1e-12 || fabs(skin.position[0] - 0.3) < 1e-12);
    pal_skin_clear(&skin);
    pal_cloud_clear(&c);
    test_scene_clear(&t);
    (void)unlink(path);
}

static void a_curve_that_turns_sharply_keeps_its_corner(void **state) {
    (void)state;
    // a flat pyramid: the base's edges are sharp, the four others are not, so the base's corners
    // lie on one closed curve
    char path[64];
    test_surface_text("v 0 0 0\nv 1 0 0\nv 1 0.6 0\nv 0 0.6 0\nv 0.5 0.3 0.2\n"
                      "f 1 3 2\nf 1 4 3\nf 1 2 5\nf 2 3 5\nf 3 4 5\nf 4 1 5\n",
                      "obj", path);
    test_scene t;
    file_scene(&t, path, 1.0, 0.09);
    pal_cloud c = build(&t, NULL);
    int corners = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        const double *x = c.position + 3 * (size_t)i;
        corners += fabs(x[2]) < 1e-9 && fabs(fabs(x[0] - 0.5) - 0.5) < 1e-9 &&
                   fabs(fabs(x[1] - 0.3) - 0.3) < 1e-7;
    }
    assert_int_equal(corners, 4);
    assert_int_equal(t.scene.warning_count, 0);
    assert_true(c.surface_count > 100);
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(fabs(r.volume / 0.04 - 1.0) < 0.01);
    pal_cloud_clear(&c);
    test_scene_clear(&t);
    (void)unlink(path);
}

static void a_sphere_file_has_its_rim_and_the_same_bits_at_any_scale(void **state) {
    (void)state;
    test_surface sphere;
    char path[64];
    test_surface_sphere(&sphere, 4, 1.0);
    test_surface_write(&sphere, "ply", path);
    static const double scale[] = {0.05, 1e-6, 271.8281828};
    pal_cloud first = {0};
    for (int i = 0; i < 3; i++) {
        test_scene t;
        file_scene(&t, path, scale[i], 0.22 * scale[i]);
        const double center[3] = {0.6 * scale[i], 0.0, 0.8 * scale[i]};
        test_scene_patch_ball(&t, "patch", center, 0.3 * scale[i], -1.0);
        pal_skin_source skin;
        pal_cloud c = build(&t, &skin);
        assert_int_equal(t.scene.warning_count, 0);
        pal_cloud_report r;
        pal_cloud_measure(&c, &r);
        assert_true(r.dihedral_min > 5.0 && r.quality_min > 0.2);
        pal_bvh tree;
        for (int32_t k = 0; k < 3 * skin.vertex_count; k++) {
            skin.position[k] /= c.length;
        }
        assert_int_equal(
            pal_bvh_build(&tree, skin.position, skin.triangle, skin.triangle_count, NULL),
            PALPATE_OK);
        int32_t on = 0, crossing = 0;
        for (int32_t k = 0; k < c.surface_count; k++) {
            double distance;
            (void)pal_bvh_closest(&tree, c.position + 3 * (size_t)k, NULL, &distance);
            assert_true(distance < 1e-9); // nodes lie on the input's triangles
        }
        pal_bvh_clear(&tree);
        int8_t *side = malloc((size_t)c.surface_count);
        assert_non_null(side);
        for (int32_t k = 0; k < c.surface_count; k++) {
            double d = 0.0;
            for (int a = 0; a < 3; a++) {
                double u = c.position[3 * (size_t)k + (size_t)a] - center[a] / c.length;
                d += u * u;
            }
            d = sqrt(d) - 0.3 * scale[i] / c.length;
            side[k] = fabs(d) < 1e-9 ? 0 : (d > 0.0 ? 1 : -1);
            on += side[k] == 0;
        }
        for (int32_t k = 0; k < c.triangle_count; k++) {
            const int32_t *v = c.triangle + 3 * k;
            int in = side[v[0]] < 0 || side[v[1]] < 0 || side[v[2]] < 0;
            int out = side[v[0]] > 0 || side[v[1]] > 0 || side[v[2]] > 0;
            crossing += in && out;
        }
        free(side);
        assert_int_equal(crossing, 0);
        assert_in_range(on, 70, 105); // 2 pi 14 = 88
        if (i == 0) {
            first = c;
        } else {
            assert_int_equal(c.node_count, first.node_count);
            assert_int_equal(c.tet_count, first.tet_count);
            assert_memory_equal(c.position, first.position,
                                3 * (size_t)c.node_count * sizeof(double));
            assert_memory_equal(c.tet, first.tet, 4 * (size_t)c.tet_count * sizeof(int32_t));
            pal_cloud_clear(&c);
        }
        pal_skin_clear(&skin);
        test_scene_clear(&t);
    }
    pal_cloud_clear(&first);
    (void)unlink(path);
}

static void an_input_of_the_right_spacing_is_kept(void **state) {
    (void)state;
    test_surface sphere;
    char path[64];
    test_surface_sphere(&sphere, 3, 1.0);
    test_surface_write(&sphere, "obj", path);
    test_scene t;
    file_scene(&t, path, 1.0, 0.2);
    pal_cloud c = build(&t, NULL);
    assert_int_equal(c.surface_count, sphere.vertex_count);
    assert_int_equal(c.triangle_count, sphere.triangle_count);
    pal_cloud_clear(&c);
    test_scene_clear(&t);
    (void)unlink(path);
}

static void what_remeshing_would_lose_keeps_the_input_with_a_warning(void **state) {
    (void)state;
    test_surface sphere;
    char path[64];
    test_surface_sphere(&sphere, 4, 1.0);
    for (int32_t i = 0; i < sphere.vertex_count; i++) { // a needle: one vertex far out
        if (sphere.x[3 * i + 2] == 1.0) {
            sphere.x[3 * i + 2] = 2.0;
        }
    }
    test_surface_write(&sphere, "obj", path);
    test_scene t;
    file_scene(&t, path, 1.0, 0.5);
    pal_cloud c = build(&t, NULL);
    // whichever way, the needle's tip is not lost by more than a quarter of the spacing
    double top = 0.0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        top = fmax(top, c.position[3 * i + 2] * c.length);
    }
    assert_true(top > 2.0 - 0.125);
    if (t.scene.warning_count > 0) {
        assert_non_null(strstr(t.scene.warning[0], "keeps its own triangles"));
        assert_true(c.surface_count >= sphere.vertex_count);
    }
    pal_cloud_clear(&c);
    test_scene_clear(&t);
    (void)unlink(path);
}

static void inside_out_is_repaired_with_a_warning(void **state) {
    (void)state;
    test_surface sphere;
    char path[64];
    test_surface_sphere(&sphere, 3, 1.0);
    for (int32_t i = 0; i < sphere.triangle_count; i++) {
        int32_t keep = sphere.v[3 * i];
        sphere.v[3 * i] = sphere.v[3 * i + 1];
        sphere.v[3 * i + 1] = keep;
    }
    test_surface_write(&sphere, "obj", path);
    test_scene t;
    file_scene(&t, path, 1.0, 0.2);
    pal_cloud c = build(&t, NULL);
    assert_int_equal(t.scene.warning_count, 1);
    assert_non_null(strstr(t.scene.warning[0], "body.geometry: 512 of 512 triangles"));
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(r.volume > 4.0);
    pal_cloud_clear(&c);
    test_scene_clear(&t);
    (void)unlink(path);
}

static void refusals_name_scene_file_and_place(void **state) {
    (void)state;
    test_surface sphere;
    char path[64];
    test_surface_sphere(&sphere, 2, 1.0);
    sphere.triangle_count--;
    test_surface_write(&sphere, "obj", path);
    test_scene t;
    file_scene(&t, path, 1.0, 0.3);
    pal_cloud c;
    pal_error e = {0};
    assert_int_equal(pal_cloud_build(&t.scene, NULL, &c, NULL, &e), PALPATE_ERROR_GEOMETRY);
    assert_non_null(strstr(e.message, "test.yaml: body.geometry: /tmp/palpate-surface-"));
    assert_non_null(strstr(e.message, "the surface is open"));
    assert_null(c.position);
    test_scene_clear(&t);
    (void)unlink(path);
}

static void the_liver_meshes_at_three_spacings(void **state) {
    (void)state;
    char path[1024];
    if (!test_shared("data/liver2.obj", path, sizeof path)) {
        skip();
    }
    static const struct {
        double spacing;
        int low, high;
    } at[] = {{0.0125, 700, 1600}, {0.0075, 2700, 3300}, {0.005, 8000, 10000}};
    for (int i = 0; i < 3; i++) {
        test_scene t;
        file_scene(&t, path, 0.1, at[i].spacing);
        pal_cloud c = build(&t, NULL);
        pal_cloud_report r;
        pal_cloud_measure(&c, &r);
        assert_int_equal(t.scene.warning_count, 0);
        assert_in_range(c.node_count, at[i].low, at[i].high);
        assert_true(fabs(r.volume / 1.14711e-3 - 1.0) < 0.01); // the input's volume, 1 %
        assert_true(r.dihedral_min > 5.0 && r.dihedral_max < 170.0);
        assert_true(r.quality_min > 0.15 && r.edge_min > 0.3);
        pal_cloud_clear(&c);
        test_scene_clear(&t);
    }
}

static void the_liver_takes_a_patch(void **state) {
    (void)state;
    char path[1024];
    if (!test_shared("data/liver2.obj", path, sizeof path)) {
        skip();
    }
    test_scene t;
    const double center[3] = {0.0019882 * 10, -0.0352431, 1.55588}; // a vertex of the file x 0.1
    file_scene(&t, path, 0.1, 0.0075);
    test_scene_patch_ball(&t, "patch", center, 0.02, 0.003);
    test_scene_refine_ball(&t, center, 0.03, 0.005);
    pal_cloud c = build(&t, NULL);
    int32_t on = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        double d = 0.0;
        for (int a = 0; a < 3; a++) {
            double u = c.position[3 * (size_t)i + (size_t)a] - center[a] / c.length;
            d += u * u;
        }
        on += fabs(sqrt(d) - 0.02 / c.length) < 1e-9;
    }
    assert_in_range(on, 30, 60); // a circle would take 2 pi 20 / 3 = 42
    assert_int_equal(t.scene.warning_count, 0);
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(r.dihedral_min > 4.0 && r.quality_min > 0.15);
    pal_cloud_clear(&c);
    test_scene_clear(&t);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_cube_keeps_its_edges_and_corners),
        cmocka_unit_test(a_curve_that_turns_sharply_keeps_its_corner),
        cmocka_unit_test(a_sphere_file_has_its_rim_and_the_same_bits_at_any_scale),
        cmocka_unit_test(an_input_of_the_right_spacing_is_kept),
        cmocka_unit_test(what_remeshing_would_lose_keeps_the_input_with_a_warning),
        cmocka_unit_test(inside_out_is_repaired_with_a_warning),
        cmocka_unit_test(refusals_name_scene_file_and_place),
        cmocka_unit_test(the_liver_meshes_at_three_spacings),
        cmocka_unit_test(the_liver_takes_a_patch),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
