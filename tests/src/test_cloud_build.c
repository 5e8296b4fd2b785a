/// Clouds of primitives: exactness on surface and rim, second-order volume and area, spacing, bits
/// that do not depend on the absolute size, and the helper process's ways to fail.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/cloud/cloud.h"
#include "src/cloud/rims.h"
#include "src/cloud/tet_improve.h"
#include "tests/support/clouds.h"

static const double PI = 3.14159265358979324;

static pal_cloud build(test_scene *t) {
    pal_cloud c;
    pal_error e = {0};
    if (pal_cloud_build(&t->scene, NULL, &c, NULL, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    test_scene_clear(t);
    return c;
}

/// A coarse hemisphere with a rim and a refined ball, every length times `scale`.
static void coarse_hemisphere(test_scene *t, double scale) {
    const double pole[3] = {0.0, 0.0, 0.05 * scale}, side[3] = {0.03 * scale, 0.01 * scale, 0.0};
    test_scene_init(t, PALPATE_GEOMETRY_HEMISPHERE, 0.013 * scale);
    t->scene.geometry.radius = 0.05 * scale;
    test_scene_refine_ball(t, side, 0.006 * scale, 0.005 * scale);
    test_scene_patch_ball(t, "pole", pole, 0.015 * scale, 0.0027 * scale);
}

static double distance(const double *a, const double *b) {
    return sqrt((a[0] - b[0]) * (a[0] - b[0]) + (a[1] - b[1]) * (a[1] - b[1]) +
                (a[2] - b[2]) * (a[2] - b[2]));
}

static void same_bits_at_any_size(void **state) {
    (void)state;
    static const double scale[] = {1.0, 1e-6 / 0.05, 0.37, 1e3 / 0.05, 271.8281828};
    test_scene t;
    coarse_hemisphere(&t, scale[0]);
    pal_cloud first = build(&t);
    for (size_t i = 0; i < sizeof scale / sizeof scale[0]; i++) { // i = 0: the same once more
        coarse_hemisphere(&t, scale[i]);
        pal_cloud c = build(&t);
        assert_int_equal(c.node_count, first.node_count);
        assert_int_equal(c.surface_count, first.surface_count);
        assert_int_equal(c.tet_count, first.tet_count);
        assert_memory_equal(c.position, first.position, 3 * (size_t)c.node_count * sizeof(double));
        assert_memory_equal(c.triangle, first.triangle,
                            3 * (size_t)c.triangle_count * sizeof(int32_t));
        assert_memory_equal(c.tet, first.tet, 4 * (size_t)c.tet_count * sizeof(int32_t));
        assert_memory_equal(c.spacing, first.spacing, (size_t)c.node_count * sizeof(double));
        // one rounding of the scene's own number
        assert_true(fabs(c.length / (0.05 * scale[i]) - 1.0) < 1e-15);
        pal_cloud_clear(&c);
    }
    pal_cloud_clear(&first);
}

/// Check that the rim |x - center| = radius is a closed chain of edges, nodes exactly on it, that
/// no triangle crosses it, and that the chain's edges are near `spacing`.
static void check_rim(const pal_cloud *c, const double center[3], double radius, double spacing) {
    int32_t on_count = 0, rim_edges = 0;
    double length = 0.0, shortest = HUGE_VAL, longest = 0.0;
    int8_t *side = malloc((size_t)c->surface_count);
    assert_non_null(side);
    for (int32_t i = 0; i < c->surface_count; i++) {
        double d = distance(c->position + 3 * (size_t)i, center) - radius;
        side[i] = fabs(d) < 1e-9 ? 0 : (d > 0.0 ? 1 : -1); // the grid is 1.5e-11
        on_count += side[i] == 0;
    }
    for (int32_t t = 0; t < c->triangle_count; t++) {
        int in = 0, out = 0;
        for (int k = 0; k < 3; k++) {
            in |= side[c->triangle[3 * t + k]] < 0;
            out |= side[c->triangle[3 * t + k]] > 0;
        }
        assert_false(in && out);
        for (int k = 0; k < 3 && in; k++) {
            int32_t a = c->triangle[3 * t + k], b = c->triangle[3 * t + (k + 1) % 3];
            if (side[a] == 0 && side[b] == 0) {
                double d = distance(c->position + 3 * (size_t)a, c->position + 3 * (size_t)b);
                length += d;
                shortest = fmin(shortest, d);
                longest = fmax(longest, d);
                rim_edges++;
            }
        }
    }
    free(side);
    assert_int_equal(rim_edges, on_count); // a closed chain has as many edges as nodes
    assert_true(on_count >= 8);
    // remeshing keeps edges between 4/5 and 4/3 of the spacing and evens them out
    assert_true(fabs(length / rim_edges / spacing - 1.0) < 0.2);
    assert_true(shortest > 0.6 * spacing && longest < 1.5 * spacing);
}

static void rim_nodes_are_exact_and_edges_follow_it(void **state) {
    (void)state;
    test_scene t;
    coarse_hemisphere(&t, 1.0);
    pal_cloud c = build(&t);
    const double pole[3] = {0, 0, 1};
    check_rim(&c, pole, 0.3, 0.054);
    int32_t edge_nodes = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        const double *x = c.position + 3 * (size_t)i, *n = c.normal + 3 * (size_t)i;
        double r = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
        int on_dome = fabs(r - 1.0) < 1e-9, on_base = x[2] == 0.0;
        assert_true(on_dome || on_base);
        edge_nodes += on_dome && on_base;
        if (on_dome && !on_base) {
            assert_true(n[0] * x[0] + n[1] * x[1] + n[2] * x[2] > 0.95);
        } else if (!on_dome) {
            assert_true(n[2] < -1.0 + 1e-12);
        }
    }
    // the sharp edge carries nodes at the spacing: 2 pi / 0.26 = 24
    assert_in_range(edge_nodes, 20, 36);
    pal_cloud_clear(&c);
}

static void auto_rim_spacing_is_a_fourteenth_of_the_radius(void **state) {
    (void)state;
    test_scene t;
    const double pole[3] = {0.0, 0.0, 0.05};
    test_scene_init(&t, PALPATE_GEOMETRY_HEMISPHERE, 0.013);
    t.scene.geometry.radius = 0.05;
    test_scene_patch_ball(&t, "pole", pole, 0.02, -1.0);
    pal_cloud c = build(&t);
    const double center[3] = {0, 0, 1};
    check_rim(&c, center, 0.4, 0.4 / 14);
    pal_cloud_clear(&c);
}

static void a_refined_rim_overrides_auto_and_zero_means_none(void **state) {
    (void)state;
    test_scene t;
    const double pole[3] = {0.0, 0.0, 0.05}, center[3] = {0, 0, 1};
    test_scene_init(&t, PALPATE_GEOMETRY_HEMISPHERE, 0.013);
    t.scene.geometry.radius = 0.05;
    test_scene_patch_ball(&t, "pole", pole, 0.02, -1.0);
    t.refine[0] = (pal_refine){.kind = PALPATE_REFINE_RIM, .spacing = 0.004};
    (void)snprintf(t.refine[0].rim, sizeof t.refine[0].rim, "pole");
    t.scene.refine_count = 1;
    pal_cloud c = build(&t);
    check_rim(&c, center, 0.4, 0.08);
    pal_cloud_clear(&c);
    t.scene.refine_count = 0;
    t.patch[0].rim_spacing = 0.0;
    c = build(&t);
    for (int32_t i = 0; i < c.surface_count; i++) {
        assert_true(fabs(distance(c.position + 3 * (size_t)i, center) - 0.4) > 1e-9);
    }
    pal_cloud_clear(&c);
}

static void box_patch_on_an_edge_has_its_rim(void **state) {
    (void)state;
    test_scene t;
    const double center[3] = {0, 0, 0};
    test_scene_box(&t, 1.0, 0.6, 0.5, center, 0.11);
    t.selector[0] = (pal_selector){.kind = PALPATE_SELECT_BOX,
                                   .low = {0.1, -0.2, 0.1},
                                   .high = {0.7, 0.15, 0.9}}; // on the top and the right face
    t.patch[0].where = (pal_selector_list){1, t.selector};
    t.patch[0].rim_spacing = 0.06;
    (void)snprintf(t.patch[0].name, sizeof t.patch[0].name, "corner");
    t.scene.patch_count = 1;
    pal_cloud c = build(&t);
    double area = 0.0;
    for (int32_t i = 0; i < c.triangle_count; i++) {
        double inside = 1.0, p[3][3], middle[3] = {0};
        for (int k = 0; k < 3; k++) {
            for (int d = 0; d < 3; d++) {
                p[k][d] = c.position[3 * (size_t)c.triangle[3 * i + k] + (size_t)d];
                middle[d] += p[k][d] / 3;
            }
        }
        for (int d = 0; d < 3; d++) {
            inside *= middle[d] > t.selector[0].low[d] && middle[d] < t.selector[0].high[d];
        }
        double u[3], v[3];
        for (int d = 0; d < 3; d++) {
            u[d] = p[1][d] - p[0][d];
            v[d] = p[2][d] - p[0][d];
        }
        double n[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                       u[0] * v[1] - u[1] * v[0]};
        area += inside * 0.5 * sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    }
    // top: 0.4 x 0.35, right face (z from 0.1 to 0.25): 0.35 x 0.15; exact because the rim conforms
    assert_true(fabs(area - (0.4 * 0.35 + 0.35 * 0.15)) < 1e-9);
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(fabs(r.volume - 0.3) < 1e-9); // flat faces stay flat: only the grid's rounding
    assert_true(r.dihedral_min > 5.0 && r.dihedral_max < 170.0);
    pal_cloud_clear(&c);
}

static void a_box_patch_on_a_sphere_has_four_exact_corners(void **state) {
    (void)state;
    test_scene t;
    test_scene_init(&t, PALPATE_GEOMETRY_SPHERE, 0.3);
    t.scene.geometry.radius = 1.0;
    t.selector[0] = (pal_selector){
        .kind = PALPATE_SELECT_BOX, .low = {-0.43, -0.31, 0.5}, .high = {0.37, 0.29, 1.5}};
    t.patch[0].where = (pal_selector_list){1, t.selector};
    t.patch[0].rim_spacing = 0.08;
    (void)snprintf(t.patch[0].name, sizeof t.patch[0].name, "window");
    t.scene.patch_count = 1;
    pal_cloud c = build(&t);
    const double *low = t.selector[0].low, *high = t.selector[0].high;
    int corners = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        const double *x = c.position + 3 * (size_t)i;
        int on_x = fabs(x[0] - low[0]) < 1e-9 || fabs(x[0] - high[0]) < 1e-9;
        int on_y = fabs(x[1] - low[1]) < 1e-9 || fabs(x[1] - high[1]) < 1e-9;
        corners += on_x && on_y && x[2] > 0.0;
    }
    assert_int_equal(corners, 4);
    for (int32_t k = 0; k < c.triangle_count; k++) { // no triangle crosses the rim
        int in = 0, out = 0;
        for (int j = 0; j < 3; j++) {
            const double *x = c.position + 3 * (size_t)c.triangle[3 * k + j];
            double d = -HUGE_VAL; // signed distance to the box in x, y: negative inside
            for (int a = 0; a < 2; a++) {
                d = fmax(d, fmax(low[a] - x[a], x[a] - high[a]));
            }
            in |= d < -1e-9 && x[2] > 0.0;
            out |= d > 1e-9;
        }
        assert_false(in && out);
    }
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(r.dihedral_min > 8.0 && r.quality_min > 0.3 && r.edge_min > 0.2);
    pal_cloud_clear(&c);
}

static void a_patch_that_ends_on_a_sharp_edge_keeps_it(void **state) {
    (void)state;
    test_scene t;
    test_scene_init(&t, PALPATE_GEOMETRY_HEMISPHERE, 0.3);
    t.scene.geometry.radius = 1.0;
    t.selector[0] = (pal_selector){.kind = PALPATE_SELECT_BELOW, .axis = 2, .value = 1e-9};
    t.patch[0].where = (pal_selector_list){1, t.selector};
    t.patch[0].rim_spacing = 0.15;
    (void)snprintf(t.patch[0].name, sizeof t.patch[0].name, "base");
    t.scene.patch_count = 1;
    pal_cloud c = build(&t);
    int32_t edge_nodes = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        const double *x = c.position + 3 * (size_t)i;
        edge_nodes += fabs(x[2]) < 1e-6 && fabs(hypot(x[0], x[1]) - 1.0) < 1e-6;
    }
    assert_in_range(edge_nodes, 36, 50); // 2 pi / 0.15 = 42
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(r.edge_min > 0.2); // no slivers between the edge and a cut beside it
    pal_cloud_clear(&c);
}

static void sphere_volume_and_area_converge_at_second_order(void **state) {
    (void)state;
    double error_v[3], error_a[3];
    for (int i = 0; i < 3; i++) {
        test_scene t;
        test_scene_init(&t, PALPATE_GEOMETRY_SPHERE, 0.4 / (1 << i));
        t.scene.geometry.radius = 1.0;
        t.scene.geometry.center[0] = 2.0;
        pal_cloud c = build(&t);
        pal_cloud_report r;
        pal_cloud_measure(&c, &r);
        error_v[i] = 1.0 - r.volume / (4.0 / 3.0 * PI);
        error_a[i] = 1.0 - r.area / (4.0 * PI);
        assert_true(error_v[i] > 0.0 && error_a[i] > 0.0); // inscribed
        pal_cloud_clear(&c);
    }
    for (int i = 0; i < 2;
         i++) { // halving the spacing: a quarter; node counts are not exactly fourfold
        assert_true(error_v[i] / error_v[i + 1] > 3.2 && error_v[i] / error_v[i + 1] < 5.0);
        assert_true(error_a[i] / error_a[i + 1] > 3.2 && error_a[i] / error_a[i + 1] < 5.0);
    }
    assert_true(error_v[2] < 5e-3);
}

static void spacing_follows_the_field(void **state) {
    (void)state;
    test_scene t;
    const double center[3] = {0, 0, -1}, top[3] = {0, 0, 0};
    test_scene_box(&t, 2, 2, 2, center, 0.4);
    test_scene_refine_ball(&t, top, 0.3, 0.09);
    t.scene.grading = 0.3;
    pal_size_field field;
    assert_int_equal(pal_size_from_scene(&t.scene, 2.0, &field, NULL), PALPATE_OK);
    pal_cloud c = build(&t);
    double sum = 0.0, lowest = HUGE_VAL, highest = 0.0;
    int32_t count = 0;
    for (int32_t i = 0; i < c.triangle_count; i++) {
        for (int k = 0; k < 3; k++) {
            const double *a = c.position + 3 * (size_t)c.triangle[3 * i + k];
            const double *b = c.position + 3 * (size_t)c.triangle[3 * i + (k + 1) % 3];
            double ratio = distance(a, b) * 2.0 / (pal_size_at(&field, a) + pal_size_at(&field, b));
            lowest = fmin(lowest, ratio);
            highest = fmax(highest, ratio);
            sum += ratio;
            count++;
        }
    }
    // surface edges: 1 in the mean, all within a factor of two
    assert_true(fabs(sum / count - 1.0) < 0.15);
    assert_true(lowest > 0.5 && highest < 1.9);
    // inside: Delaunay refinement leaves edges up to about twice the spacing
    for (int32_t i = 0; i < c.node_count; i++) {
        double ratio = c.spacing[i] / pal_size_at(&field, c.position + 3 * (size_t)i);
        assert_true(ratio > 0.5 && ratio < 2.0);
    }
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(r.spacing_max / r.spacing_min > 3.0); // graded at all
    assert_true(r.dihedral_min > 12.0 && r.quality_min > 0.4 && r.edge_min > 0.3);
    pal_size_clear(&field);
    pal_cloud_clear(&c);
}

static void the_design_hemisphere_has_good_cells(void **state) {
    (void)state;
    test_scene t;
    test_scene_hemisphere(&t, 1.0, 1.0, 0);
    pal_cloud c = build(&t);
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_in_range(r.node_count, 1500, 1900);
    assert_true(fabs(r.volume / (2.0 / 3.0 * PI * 0.05 * 0.05 * 0.05) - 1.0) < 0.01);
    // 17 degrees and 0.5 measured; no cell between surface nodes only
    assert_true(r.dihedral_min > 12.0 && r.dihedral_max < 160.0 && r.quality_min > 0.4);
    assert_int_equal(r.surface_tets, 0);
    const double pole[3] = {0, 0, 1};
    check_rim(&c, pole, 0.009983 / 0.05, 0.0007 / 0.05);
    pal_cloud_clear(&c);
}

static void bridges_between_surface_nodes_are_split(void **state) {
    (void)state;
    pal_cloud c;
    pal_error e = {0};
    const double size[3] = {4, 3, 1};
    const int n[3] = {4, 3, 1}; // one cell thick: every node is on the surface
    assert_int_equal(pal_cloud_box(&c, size, n, 0.1, 5, &e), PALPATE_OK);
    assert_int_equal(c.node_count, c.surface_count);
    pal_mesh_fill fill = {0, malloc(sizeof(double)), c.tet_count, c.tet};
    assert_non_null(fill.inside);
    assert_int_equal(
        pal_tets_improve(c.position, c.surface_count, c.triangle, c.triangle_count, &fill, &e),
        PALPATE_OK);
    assert_true(fill.inside_count >= 4 * 3); // one in each cell at least
    double *x = malloc(3 * (size_t)(c.surface_count + fill.inside_count) * sizeof *x);
    assert_non_null(x);
    memcpy(x, c.position, 3 * (size_t)c.surface_count * sizeof *x);
    memcpy(x + 3 * c.surface_count, fill.inside, 3 * (size_t)fill.inside_count * sizeof *x);
    free(c.position);
    free(fill.inside);
    c.position = x;
    c.node_count += fill.inside_count;
    c.tet = fill.tet;
    c.tet_count = fill.tet_count;
    if (pal_cloud_complete(&c, &e) != PALPATE_OK) { // conforming, positive, same surface
        fail_msg("%s", e.message);
    }
    pal_cloud_report r;
    pal_cloud_measure(&c, &r);
    assert_true(fabs(r.volume - 12.0) < 1e-12);
    assert_int_equal(r.surface_tets, 0);
    assert_true(r.quality_min > 0.1);
    pal_cloud_clear(&c);
}

static void expect_failure(test_scene *t, const pal_progress *progress, pal_status status,
                           const char *words) {
    pal_cloud c;
    pal_error e = {0};
    pal_status got = pal_cloud_build(&t->scene, progress, &c, NULL, &e);
    if (got != status || strstr(e.message, words) == NULL) {
        fail_msg("status %d, message '%s'; wanted %d and '%s'", got, e.message, status, words);
    }
    assert_null(c.position);
    assert_int_equal(c.node_count, 0);
    test_scene_clear(t);
}

static void impossible_spacings_and_places_are_refused(void **state) {
    (void)state;
    test_scene t;
    const double center[3] = {0, 0, 0};
    test_scene_box(&t, 0.2, 0.04, 0.04, center, 0.03);
    expect_failure(&t, NULL, PALPATE_ERROR_GEOMETRY, "body.spacing: 0.03 m is too coarse");
    test_scene_box(&t, 0.2, 0.04, 0.04, center, 1e-5);
    expect_failure(&t, NULL, PALPATE_ERROR_CLOUD,
                   "body.spacing: with its refinements it asks for about");
    test_scene_box(&t, 0.2, 0.04, 0.04, center, 0.01);
    test_scene_refine_ball(&t, center, 0.002, 1e-6); // between the samples of the estimate
    expect_failure(&t, NULL, PALPATE_ERROR_CLOUD, "smaller refined zones");
    const double far[3] = {1e6, 0, 0};
    test_scene_box(&t, 0.2, 0.04, 0.04, far, 0.01);
    expect_failure(&t, NULL, PALPATE_ERROR_GEOMETRY, "body sizes from the origin");
}

/// Put a shell script in place of the mesher.
static void fake_mesher(const char *body) {
    char path[] = "/tmp/palpate-fake-XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    char text[512];
    int n = snprintf(text, sizeof text, "#!/bin/sh\n%s\n", body);
    assert_int_equal(write(fd, text, (size_t)n), n);
    assert_int_equal(fchmod(fd, 0700), 0);
    assert_int_equal(close(fd), 0);
    assert_int_equal(setenv("PALPATE_MESHER", path, 1), 0);
}

static void real_mesher(void) {
    const char *path = getenv("PALPATE_MESHER");
    if (path != NULL && strstr(path, "/tmp/palpate-fake-") == path) {
        (void)unlink(path);
    }
    (void)unsetenv("PALPATE_MESHER");
}

static int cancel_at_once(void *user, const char *stage, double fraction, double left) {
    (void)left;
    assert_string_equal(stage, "cloud");
    assert_true(fraction >= 0.0 && fraction <= 1.0);
    return fraction >= *(double *)user;
}

static void a_mesher_that_dies_is_a_clear_error(void **state) {
    (void)state;
    static const struct {
        const char *script;
        pal_status status;
        const char *words;
    } fate[] = {
        {"kill -9 $$", PALPATE_ERROR_CLOUD, "signal 9"},
        {"head -c 100 >/dev/null; echo progress 0.5 >&2; kill -11 $$", PALPATE_ERROR_CLOUD,
         "signal 11"},
        {"echo no licence >&2; exit 3", PALPATE_ERROR_CLOUD, "exit status 3): no licence"},
        {"cat >/dev/null & head -c 4096 /dev/zero; exit 0", PALPATE_ERROR_CLOUD, "same build"},
    };
    test_scene t;
    for (size_t i = 0; i < sizeof fate / sizeof fate[0]; i++) {
        coarse_hemisphere(&t, 1.0);
        fake_mesher(fate[i].script);
        expect_failure(&t, NULL, fate[i].status, fate[i].words);
        real_mesher();
    }
    coarse_hemisphere(&t, 1.0);
    assert_int_equal(setenv("PALPATE_MESHER", "/nonexistent/mesher", 1), 0);
    expect_failure(&t, NULL, PALPATE_ERROR_SYSTEM, "PALPATE_MESHER: /nonexistent/mesher");
    real_mesher();
}

static void cancelling_stops_at_every_stage(void **state) {
    (void)state;
    test_scene t;
    double at = 0.0;
    pal_progress progress = {cancel_at_once, &at};
    coarse_hemisphere(&t, 1.0);
    expect_failure(&t, &progress, PALPATE_ERROR_CANCELLED, "cancelled");
    at = 0.1;
    coarse_hemisphere(&t, 1.0);
    expect_failure(&t, &progress, PALPATE_ERROR_CANCELLED, "cancelled while meshing the surface");
    at = 0.2;
    coarse_hemisphere(&t, 1.0);
    expect_failure(&t, &progress, PALPATE_ERROR_CANCELLED, "cancelled");
    // a mesher that hangs is killed: the test would time out otherwise
    at = 0.21;
    coarse_hemisphere(&t, 1.0);
    fake_mesher("echo progress 0.5 >&2; exec sleep 1000");
    expect_failure(&t, &progress, PALPATE_ERROR_CANCELLED, "cancelled while filling");
    real_mesher();
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(same_bits_at_any_size),
        cmocka_unit_test(rim_nodes_are_exact_and_edges_follow_it),
        cmocka_unit_test(auto_rim_spacing_is_a_fourteenth_of_the_radius),
        cmocka_unit_test(a_refined_rim_overrides_auto_and_zero_means_none),
        cmocka_unit_test(box_patch_on_an_edge_has_its_rim),
        cmocka_unit_test(a_box_patch_on_a_sphere_has_four_exact_corners),
        cmocka_unit_test(a_patch_that_ends_on_a_sharp_edge_keeps_it),
        cmocka_unit_test(sphere_volume_and_area_converge_at_second_order),
        cmocka_unit_test(spacing_follows_the_field),
        cmocka_unit_test(the_design_hemisphere_has_good_cells),
        cmocka_unit_test(bridges_between_surface_nodes_are_split),
        cmocka_unit_test(impossible_spacings_and_places_are_refused),
        cmocka_unit_test(a_mesher_that_dies_is_a_clear_error),
        cmocka_unit_test(cancelling_stops_at_every_stage),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
