/// The scenes that are shipped: they load without complaint, their clouds build, their selectors
/// find nodes, their tools just touch; and the organ's surface is what make_organ.c says.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/cloud/scene_check.h"
#include "src/scene/scene_size.h"

static void shipped(const char *name, char *path, size_t size) {
    const char *source = getenv("PALPATE_SOURCE");
    (void)snprintf(path, size, "%s/scenes/%s", source != NULL ? source : ".", name);
}

/// Distance of a tool's surface from the nearest node, negative when it overlaps.
static double gap(const pal_tool_def *tool, const pal_cloud *cloud) {
    double best = INFINITY;
    for (int32_t n = 0; n < cloud->surface_count; n++) {
        double d = 0.0;
        for (size_t i = 0; i < 3; i++) {
            d = hypot(d, cloud->length * cloud->position[3 * (size_t)n + i] - tool->start[i]);
        }
        best = fmin(best, d - tool->radius);
    }
    return best;
}

static void check_scene(const char *name, int32_t fewest, int32_t most, int32_t touchable) {
    char path[1024];
    pal_scene *scene;
    pal_cloud cloud = {0};
    pal_node_sets sets = {0};
    pal_error error = {0};
    shipped(name, path, sizeof path);
    if (pal_scene_load(path, NULL, 0, &scene, &error) != PALPATE_OK ||
        pal_cloud_build(scene, NULL, &cloud, NULL, &error) != PALPATE_OK ||
        pal_scene_select_nodes(scene, &cloud, &sets, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    double volume = 0.0;
    for (int32_t n = 0; n < cloud.node_count; n++) {
        volume += cloud.volume[n] * pow(cloud.length, 3.0);
    }
    double predicted = pal_scene_predict_nodes(scene, volume);
    print_message(
        "%s: %d nodes (predicted %.0f), %d touchable, %d fixed, %d in patch 0, gap %.2g m\n", name,
        (int)cloud.node_count, predicted, (int)sets.touchable_count, (int)sets.fixed_count,
        sets.patch_count > 0 ? (int)sets.patch_start[1] : 0, gap(&scene->runtime.tools[0], &cloud));
    for (int i = 0; i < pal_scene_warning_count(scene); i++) {
        print_message("%s\n", pal_scene_warning(scene, i));
    }
    assert_int_equal(pal_scene_warning_count(scene), 0);
    assert_in_range(cloud.node_count, fewest, most);
    assert_true(sets.touchable_count >= touchable);
    // what scene_size.c promises
    assert_true(predicted > 0.5 * cloud.node_count && predicted < 2.0 * cloud.node_count);
    // just touching: within a tenth of the spacing of the nearest node's (curved surfaces lie
    // between)
    assert_true(fabs(gap(&scene->runtime.tools[0], &cloud)) < 0.1 * scene->spacing);
    pal_node_sets_clear(&sets);
    pal_cloud_clear(&cloud);
    pal_scene_free(scene);
}

static void the_hemisphere_builds(void **state) {
    (void)state;
    check_scene("hemisphere.yaml", 900, 2500, 150);
}

static void the_block_builds(void **state) {
    (void)state;
    check_scene("block.yaml", 800, 3000, 100);
}

static void the_organ_builds(void **state) {
    (void)state;
    check_scene("organ.yaml", 1200, 4000, 100);
}

/// A spacing that would ask for millions of nodes is refused before any mesher starts.
static void an_absurd_spacing_on_a_surface_file_is_refused(void **state) {
    (void)state;
    char path[1024];
    pal_scene *scene;
    pal_cloud cloud = {0};
    pal_error error = {0};
    const char *const set[] = {"body.spacing=0.0005"};
    shipped("organ.yaml", path, sizeof path);
    assert_int_equal(pal_scene_load(path, set, 1, &scene, &error), PALPATE_OK);
    assert_int_equal(pal_cloud_build(scene, NULL, &cloud, NULL, &error), PALPATE_ERROR_SCENE);
    assert_non_null(
        strstr(error.message, "--set body.spacing=0.0005: body.spacing: found 0.0005 m"));
    assert_non_null(strstr(error.message, "allowed: at most 200000 nodes"));
    pal_scene_free(scene);
    pal_cloud_clear(&cloud);
}

/// Reads an OBJ with "v x y z" and "f a b c" lines only.
static int read_obj(const char *path, double (**v)[3], int (**f)[3], int *vertices, int *faces) {
    FILE *file = fopen(path, "r");
    char line[256];
    int capacity = 4096;
    *v = calloc((size_t)capacity, sizeof **v);
    *f = calloc((size_t)capacity, sizeof **f);
    *vertices = *faces = 0;
    if (file == NULL || *v == NULL || *f == NULL) {
        return -1;
    }
    while (fgets(line, sizeof line, file) != NULL && *vertices < capacity && *faces < capacity) {
        double *p = (*v)[*vertices];
        int *t = (*f)[*faces];
        if (sscanf(line, "v %lf %lf %lf", &p[0], &p[1], &p[2]) == 3) {
            ++*vertices;
        } else if (sscanf(line, "f %d %d %d", &t[0], &t[1], &t[2]) == 3) {
            ++*faces;
        }
    }
    return fclose(file);
}

static void the_organ_is_closed_outward_and_even(void **state) {
    (void)state;
    char path[1024];
    double(*v)[3];
    int(*f)[3];
    int vertices;
    int faces;
    shipped("organ.obj", path, sizeof path);
    assert_int_equal(read_obj(path, &v, &f, &vertices, &faces), 0);
    assert_in_range(faces, 1500, 3000);
    assert_int_equal(vertices - faces * 3 / 2 + faces, 2); // Euler: one sphere
    unsigned char *seen = calloc((size_t)vertices * (size_t)vertices, 1);
    assert_non_null(seen);
    double volume = 0.0;
    double worst = 1.0;
    for (int t = 0; t < faces; t++) {
        double e[3][3];
        double l2 = 0.0;
        double n[3];
        const double *p[3];
        for (int k = 0; k < 3; k++) {
            int a = f[t][k] - 1;
            int b = f[t][(k + 1) % 3] - 1;
            assert_true(a >= 0 && a < vertices && a != b);
            unsigned char *edge = &seen[(size_t)a * (size_t)vertices + (size_t)b];
            assert_int_equal(*edge, 0); // each direction of an edge once: consistently oriented
            *edge = 1;
            p[k] = v[a];
            for (int i = 0; i < 3; i++) {
                e[k][i] = v[b][i] - v[a][i];
                l2 += e[k][i] * e[k][i];
            }
        }
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3;
            int k = (i + 2) % 3;
            n[i] = e[0][j] * e[1][k] - e[0][k] * e[1][j];
            volume += p[0][i] * (p[1][j] * p[2][k] - p[1][k] * p[2][j]) / 6.0;
        }
        double area = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2.0;
        worst = fmin(worst, 4.0 * sqrt(3.0) * area / l2); // 1: equilateral
    }
    for (int t = 0; t < faces; t++) {
        for (int k = 0; k < 3; k++) { // ... and both directions: closed
            size_t a = (size_t)(f[t][k] - 1);
            size_t b = (size_t)(f[t][(k + 1) % 3] - 1);
            assert_int_equal(seen[b * (size_t)vertices + a], 1);
        }
    }
    print_message("organ: %d triangles, volume %.3e m^3, worst triangle %.2f\n", faces, volume,
                  worst);
    assert_true(volume > 1.0e-3 && volume < 1.3e-3); // outward, and the size of a small liver
    assert_true(worst > 0.4);
    free(seen);
    free(v);
    free(f);
}

/// make_organ.c makes organ.obj (to 1e-6 m and one digit: another C library may round differently).
static void the_generator_makes_the_organ(void **state) {
    (void)state;
    char source[1024];
    char path[1024];
    char command[3000];
    char directory[] = "/tmp/palpate-organ-XXXXXX";
    const char *cc = getenv("CC");
    shipped("make_organ.c", source, sizeof source);
    shipped("organ.obj", path, sizeof path);
    assert_non_null(mkdtemp(directory));
    (void)snprintf(command, sizeof command,
                   "%s -O1 -ffp-contract=off '%s' -lm -o %s/make && %s/make > %s/organ.obj",
                   cc != NULL && cc[0] != 0 ? cc : "cc", source, directory, directory, directory);
    assert_int_equal(system(command), 0);
    double(*v[2])[3];
    int(*f[2])[3];
    int vertices[2];
    int faces[2];
    assert_int_equal(read_obj(path, &v[0], &f[0], &vertices[0], &faces[0]), 0);
    (void)snprintf(path, sizeof path, "%s/organ.obj", directory);
    assert_int_equal(read_obj(path, &v[1], &f[1], &vertices[1], &faces[1]), 0);
    assert_int_equal(vertices[0], vertices[1]);
    assert_int_equal(faces[0], faces[1]);
    assert_memory_equal(f[0], f[1], (size_t)faces[0] * sizeof *f[0]);
    for (int i = 0; i < vertices[0]; i++) {
        for (int k = 0; k < 3; k++) {
            assert_true(fabs(v[0][i][k] - v[1][i][k]) < 1.1e-6);
        }
    }
    for (int i = 0; i < 2; i++) {
        free(v[i]);
        free(f[i]);
    }
    (void)snprintf(command, sizeof command, "rm -rf %s", directory);
    assert_int_equal(system(command), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_organ_is_closed_outward_and_even),
        cmocka_unit_test(the_generator_makes_the_organ),
        cmocka_unit_test(the_hemisphere_builds),
        cmocka_unit_test(the_block_builds),
        cmocka_unit_test(the_organ_builds),
        cmocka_unit_test(an_absurd_spacing_on_a_surface_file_is_refused),
    };
    return cmocka_run_group_tests_name("scene_shipped", tests, NULL, NULL);
}
