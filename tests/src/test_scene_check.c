/// Selectors on a cloud: node sets, warnings, and the located errors that need the cloud.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/cloud/scene_check.h"
#include "tests/support/scene_text.h"

/// A 0.1 m cube at the origin's corner: 5 x 5 nodes a face at 0, 0.025, ... 0.1.
static const char *const CUBE =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {box: {size: [0.1, 0.1, 0.1], center: [0.05, 0.05, 0.05]}}\n"
    "  spacing: 0.025\n"
    "  material: {young: 1000, poisson: 0.3}\n"
    "  fixed:\n"
    "    - {below: {z: 0}}\n"
    "  patches:\n"
    "    top: {above: {z: 0.1}}\n";

static void cube(pal_cloud *cloud) {
    // normalised: the unit cube, length 0.1 m
    const double size[3] = {1, 1, 1};
    const int n[3] = {4, 4, 4};
    assert_int_equal(pal_cloud_box(cloud, size, n, 0.0, 1, NULL), PALPATE_OK);
    cloud->length = 0.1;
}

/// Load the cube's scene with overrides and select its nodes.
static pal_status selecting(const char *const set[], pal_cloud *cloud, pal_scene **scene,
                            pal_node_sets *sets, pal_error *error) {
    *scene = NULL;
    *sets = (pal_node_sets){0};
    pal_status status = test_scene_load(CUBE, set, scene, error);
    if (status != PALPATE_OK) {
        fail_msg("%s", error->message);
    }
    return pal_scene_select_nodes(*scene, cloud, sets, error);
}

static void faces_are_selected_node_for_node(void **state) {
    (void)state;
    pal_cloud cloud = {0};
    pal_scene *scene;
    pal_node_sets sets;
    pal_error error = {0};
    cube(&cloud);
    assert_int_equal(selecting(NULL, &cloud, &scene, &sets, &error), PALPATE_OK);
    assert_int_equal(sets.fixed_count, 25);
    assert_int_equal(sets.touchable_count, cloud.surface_count - 25);
    assert_int_equal(sets.patch_count, 1);
    assert_int_equal(sets.patch_start[0], 0);
    assert_int_equal(sets.patch_start[1], 25);
    for (int32_t i = 0; i < 25; i++) {
        assert_true(cloud.position[3 * sets.patch_node[i] + 2] == 1.0);
        assert_true(i == 0 || sets.patch_node[i] > sets.patch_node[i - 1]);
    }
    for (int32_t n = 0; n < cloud.node_count; n++) {
        int bottom = n < cloud.surface_count && cloud.position[3 * n + 2] == 0.0;
        int top = n < cloud.surface_count && !bottom;
        assert_int_equal(sets.flags[n], bottom ? PALPATE_NODE_FIXED
                                        : top  ? PALPATE_NODE_TOUCHABLE
                                               : 0);
    }
    assert_int_equal(pal_scene_warning_count(scene), 0); // the default `all` is no conflict
    pal_node_sets_clear(&sets);
    pal_scene_free(scene);
    pal_cloud_clear(&cloud);
}

static void fixed_wins_with_a_warning(void **state) {
    (void)state;
    pal_cloud cloud = {0};
    pal_scene *scene;
    pal_node_sets sets;
    pal_error error = {0};
    cube(&cloud);
    // the side x = 0: 25 nodes, 5 of them on the fixed face
    const char *set[] = {"body.touchable=[{below: {x: 0}}]", "body.patches.side={below: {x: 0}}",
                         NULL};
    assert_int_equal(selecting(set, &cloud, &scene, &sets, &error), PALPATE_OK);
    assert_int_equal(sets.touchable_count, 20);
    assert_int_equal(sets.patch_start[2] - sets.patch_start[1], 20);
    assert_int_equal(pal_scene_warning_count(scene), 2);
    assert_non_null(strstr(pal_scene_warning(scene, 0),
                           "--set body.touchable=[{below: {x: 0}}]: "
                           "body.touchable: 5 of its 25 nodes are fixed"));
    assert_non_null(
        strstr(pal_scene_warning(scene, 1), "body.patches.side: 5 of its 25 nodes are fixed"));
    pal_node_sets_clear(&sets);
    pal_scene_free(scene);
    pal_cloud_clear(&cloud);
}

static void each_kind_of_selector_is_inclusive(void **state) {
    (void)state;
    static const struct {
        const char *set;
        int count;
    } cases[] = {
        {"body.patches.top={below: {x: 0.0}}", 20},
        {"body.patches.top={above: {y: 0.1}}", 20},
        {"body.patches.top={above: {y: 0.100000099}}", 20}, // within 1e-6 of 0.1 m
        {"body.patches.top={ball: {center: [0, 0, 0.1], radius: 0.025}}", 4},
        {"body.patches.top={ball: {center: [0, 0, 0.1], radius: 0.0249999001}}", 4},
        {"body.patches.top={ball: {center: [0, 0, 0.1], radius: 0.0249998}}", 1},
        {"body.patches.top={box: {min: [0, 0, 0.1], max: [0.05, 0.025, 0.2]}}", 6},
        {"body.patches.top={box: {center: [0.025, 0.0125, 0.1], size: [0.05, 0.025, 0]}}", 6},
        {"body.patches.top={any: [{ball: {center: [0, 0, 0.1], radius: 0.01}}, "
         "{ball: {center: [0.1, 0, 0.1], radius: 0.01}}]}",
         2},
    };
    pal_cloud cloud = {0};
    cube(&cloud);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        pal_scene *scene;
        pal_node_sets sets;
        pal_error error = {0};
        const char *set[] = {cases[i].set, NULL};
        pal_status status = selecting(set, &cloud, &scene, &sets, &error);
        if (status != PALPATE_OK || sets.patch_start[1] != cases[i].count) {
            fail_msg("%s: %s, %d nodes", cases[i].set, error.message,
                     status == PALPATE_OK ? (int)sets.patch_start[1] : -1);
        }
        pal_node_sets_clear(&sets);
        pal_scene_free(scene);
    }
    pal_cloud_clear(&cloud);
}

static void errors_are_located_and_say_what_to_do(void **state) {
    (void)state;
    static const struct {
        const char *set;
        const char *where;
        const char *what;
    } cases[] = {
        {"body.patches.top={ball: {center: [0.05, 0.05, 0.2], radius: 0.01}}",
         "body.patches.top: found no", "nearest of 98 is at [0.05, 0.05, 0.1], 0.09 m outside"},
        {"body.fixed=[{below: {z: -0.1}}]", "body.fixed: found no surface node", "0.1 m outside"},
        {"body.touchable=[{above: {x: 0.2}}]", "body.touchable: found no surface node", "nearest"},
        {"body.touchable=[{below: {z: 0}}]", "body.touchable: found only fixed nodes",
         "fixed wins"},
        {"body.patches.top={below: {z: 0}}", "body.patches.top: found only fixed nodes",
         "fixed wins"},
        {"body.fixed=[all]", "body.fixed: found every surface node", "narrow"},
        {"body.fixed=[{ball: {center: [0, 0, 0], radius: 0.01}}]",
         "body.fixed: found the body held at one", "place only, [0, 0, 0]"},
        {"body.fixed=[{box: {min: [0, 0, 0], max: [0.1, 0, 0]}}]",
         "body.fixed: found the body held on one", "line only"},
        {"body.fixed=[{ball: {center: [0, 0, 0], radius: 0.01}}, {ball: {center: [0.1, 0.1, 0.1], "
         "radius: 0.01}}]",
         "body.fixed: found the body held on one", "three fixed nodes off one line"},
        {"body.probes.p=[0.05, 0.05, 0.13]", "body.probes.p: found a point 0.03 m outside",
         "move it inside"},
        {"body.probes.p=[0.2, 0.2, 0.2]", "body.probes.p: found a point 0.173 m outside",
         "move it inside"},
    };
    pal_cloud cloud = {0};
    cube(&cloud);
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        pal_scene *scene;
        pal_node_sets sets;
        pal_error error = {0};
        const char *set[] = {cases[i].set, NULL};
        pal_status status = selecting(set, &cloud, &scene, &sets, &error);
        if (status != PALPATE_ERROR_SCENE || strstr(error.message, cases[i].where) == NULL ||
            strstr(error.message, cases[i].what) == NULL) {
            fail_msg("%s: %s", cases[i].set, error.message);
        }
        assert_int_equal(strncmp(error.message, "--set ", 6), 0);
        assert_null(sets.flags);
        pal_scene_free(scene);
    }
    pal_cloud_clear(&cloud);
}

static void an_error_from_the_file_names_its_line(void **state) {
    (void)state;
    pal_cloud cloud = {0};
    pal_scene *scene;
    pal_node_sets sets;
    pal_error error = {0};
    cube(&cloud);
    cloud.length = 0.05; // half the size: nothing is left at z = 0.1
    assert_int_equal(selecting(NULL, &cloud, &scene, &sets, &error), PALPATE_ERROR_SCENE);
    assert_non_null(
        strstr(error.message, "scene.yaml:9:10: body.patches.top: found no surface node"));
    pal_scene_free(scene);
    pal_cloud_clear(&cloud);
}

static void three_nodes_hold_a_body(void **state) {
    (void)state;
    pal_cloud cloud = {0};
    pal_scene *scene;
    pal_node_sets sets;
    pal_error error = {0};
    cube(&cloud);
    const char *set[] = {
        "body.fixed=[{ball: {center: [0, 0, 0], radius: 0.01}}, {ball: {center: [0.1, 0, "
        "0], radius: 0.01}}, {ball: {center: [0, 0.1, 0], radius: 0.01}}]",
        NULL};
    assert_int_equal(selecting(set, &cloud, &scene, &sets, &error), PALPATE_OK);
    assert_int_equal(sets.fixed_count, 3);
    pal_node_sets_clear(&sets);
    pal_scene_free(scene);
    pal_cloud_clear(&cloud);
}

static void a_loose_second_part_is_found(void **state) {
    (void)state;
    // the cube's tetrahedra cut in two through the middle nodes would still touch: take two cubes
    pal_cloud one = {0};
    cube(&one);
    pal_cloud two = {.length = 0.1};
    int32_t n = one.node_count;
    int32_t s = one.surface_count;
    two.node_count = 2 * n;
    two.surface_count = 2 * s;
    two.tet_count = 2 * one.tet_count;
    two.position = calloc(6 * (size_t)n, sizeof *two.position);
    two.tet = calloc(8 * (size_t)one.tet_count, sizeof *two.tet);
    assert_non_null(two.position);
    assert_non_null(two.tet);
    int32_t *map[2] = {calloc((size_t)n, sizeof **map), calloc((size_t)n, sizeof **map)};
    for (int copy = 0; copy < 2; copy++) {
        assert_non_null(map[copy]);
        for (int32_t i = 0; i < n; i++) {
            int32_t to = i < s ? copy * s + i : 2 * s + copy * (n - s) + (i - s);
            map[copy][i] = to;
            memcpy(&two.position[3 * to], &one.position[3 * i], 3 * sizeof(double));
            two.position[3 * to] += 2.0 * copy;     // the second one stands beside the first ...
            two.position[3 * to + 2] += 0.5 * copy; // ... and above the fixed plane
        }
        for (int32_t t = 0; t < 4 * one.tet_count; t++) {
            two.tet[4 * copy * one.tet_count + t] = map[copy][one.tet[t]];
        }
        free(map[copy]);
    }
    pal_scene *scene;
    pal_node_sets sets;
    pal_error error = {0};
    assert_int_equal(selecting(NULL, &two, &scene, &sets, &error), PALPATE_ERROR_SCENE);
    assert_non_null(
        strstr(error.message, "found no fixed node on the part of the body with node ["));
    assert_non_null(strstr(error.message, "(of 2 separate parts)"));
    pal_scene_free(scene);
    const char *set[] = {"body.fixed=[{below: {z: 0.05}}]", NULL};
    assert_int_equal(selecting(set, &two, &scene, &sets, &error), PALPATE_OK);
    pal_node_sets_clear(&sets);
    pal_scene_free(scene);
    pal_cloud_clear(&two);
    pal_cloud_clear(&one);
}

static void probes_inside_and_on_the_surface_pass(void **state) {
    (void)state;
    pal_cloud cloud = {0};
    pal_scene *scene;
    pal_node_sets sets;
    pal_error error = {0};
    cube(&cloud);
    const char *set[] = {"body.probes.inside=[0.03, 0.06, 0.07]",
                         "body.probes.face=[0.05, 0.05, 0.1]", "body.probes.corner=[0.1, 0.1, 0.1]",
                         "body.probes.slack=[0.05, 0.05, 0.105]", NULL};
    assert_int_equal(selecting(set, &cloud, &scene, &sets, &error), PALPATE_OK);
    pal_node_sets_clear(&sets);
    pal_scene_free(scene);
    pal_cloud_clear(&cloud);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(faces_are_selected_node_for_node),
        cmocka_unit_test(fixed_wins_with_a_warning),
        cmocka_unit_test(each_kind_of_selector_is_inclusive),
        cmocka_unit_test(errors_are_located_and_say_what_to_do),
        cmocka_unit_test(an_error_from_the_file_names_its_line),
        cmocka_unit_test(three_nodes_hold_a_body),
        cmocka_unit_test(a_loose_second_part_is_found),
        cmocka_unit_test(probes_inside_and_on_the_surface_pass),
    };
    return cmocka_run_group_tests_name("scene_check", tests, NULL, NULL);
}
