/// The mesh that a host draws: read in its file's own order (OBJ, PLY), one normal at a seam, moved
/// by interpolation between surface nodes (exact at nodes, on edges and for linear fields on
/// planes), part of the content hash, refused with a place and a remedy.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/engine.h>
#include <palpate/precompute.h>

#include "haptic/model/model.h"
#include "src/cloud/skin.h"
#include "src/geometry/surface.h"
#include "tests/support/scene_text.h"
#include "tests/support/surfaces.h"

static const char BOX[] = "palpate: 1\n"
                          "body:\n"
                          "  geometry: {box: {size: [0.04, 0.05, 0.02], center: [0, 0, -0.01]}}\n"
                          "  spacing: 0.008\n"
                          "  material: {young: 10e3, poisson: 0.3}\n"
                          "  fixed: [{below: {z: -0.02}}]\n"
                          "  touchable: [{ball: {center: [0, 0, 0], radius: 0.01}}]\n";

static const char HEMISPHERE[] =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {hemisphere: {radius: 0.05}}\n"
    "  spacing: 0.015\n"
    "  material: {young: 10e3, poisson: 0.3}\n"
    "  fixed: [{below: {z: 0}}]\n"
    "  touchable: [{ball: {center: [0, 0, 0.05], radius: 0.02}}]\n"
    "tools: [{shape: {sphere: {radius: 0.01}}, start: [0, 0, 0.06]}]\n";

/// A scene with a skin, loaded. @param set  a further override, or NULL
static pal_status load(const char *text, const char *skin, const char *set, pal_scene **out,
                       pal_error *e) {
    char file[128];
    (void)snprintf(file, sizeof file, "skin.file=%s", skin);
    const char *const list[] = {file, set, NULL};
    return test_scene_load(text, list, out, e);
}

static pal_model *precompute(const char *text, const char *skin, const char *set) {
    pal_error e = {0};
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    pal_status status =
        skin != NULL ? load(text, skin, set, &scene, &e) : test_scene_load(text, NULL, &scene, &e);
    if (status == PALPATE_OK) {
        status = pal_precompute(scene, NULL, &model, &e);
    }
    if (status != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_scene_free(scene);
    return model;
}

static pal_surface read_text(const char *text, const char *extension) {
    char path[64];
    pal_surface s;
    pal_error e = {0};
    test_surface_text(text, extension, path);
    if (pal_surface_read_in_order(path, &s, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    (void)unlink(path);
    return s;
}

#define SAME_INDICES(actual, count, ...)                                                           \
    do {                                                                                           \
        const int32_t expected_[] = {__VA_ARGS__};                                                 \
        assert_int_equal(count, sizeof expected_ / sizeof *expected_);                             \
        assert_memory_equal(actual, expected_, sizeof expected_);                                  \
    } while (0)

static void obj_vertices_keep_their_numbers(void **state) {
    (void)state;
    // 3 is used by no face, 5 is 1 again (a seam), the faces use every way to name a vertex
    pal_surface s =
        read_text("# a comment\nmtllib no.mtl\no part\n"
                  "v 0 0 0\nv 1.5e0 0 0 1.0\n\tv 9 9 9\nv 0 1 0 0.5 0.5 0.5\r\nv 0 0 0\n"
                  "vt 0 0\nvt 1 0\nvn 0 0 1\n"
                  "f 1/1/1 2/2/1 4//1\n"
                  "v 1 \\\n 1 \\\n -1e-3\n"
                  "usemtl red\ns 1\nl 1 2\np 3\n"
                  "f -2 4/2 -1\nf 1 2 6 4 \n",
                  "obj");
    assert_int_equal(s.vertex_count, 6);
    const double x[] = {0, 0, 0, 1.5, 0, 0, 9, 9, 9, 0, 1, 0, 0, 0, 0, 1, 1, -1e-3};
    for (size_t i = 0; i < sizeof x / sizeof *x; i++) {
        assert_true(fabs(s.x[i] - x[i]) <= 0.0); // read in double precision
    }
    SAME_INDICES(s.v, 3 * s.triangle_count, 0, 1, 3, 4, 3, 5, 0, 1, 5, 0, 5, 3);
    int32_t twin[6];
    assert_int_equal(pal_surface_twins(&s, twin, NULL), PALPATE_OK);
    SAME_INDICES(twin, 6, 0, 1, 2, 3, 0, 5);
    pal_surface_clear(&s);
}

static void obj_numbers_have_a_point_in_any_locale(void **state) {
    (void)state;
    const char *const names[] = {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8"};
    locale_t comma = (locale_t)0;
    for (size_t i = 0; i < 3 && comma == (locale_t)0; i++) {
        comma = newlocale(LC_ALL_MASK, names[i], (locale_t)0);
    }
    if (comma == (locale_t)0) {
        skip(); // none installed
    }
    locale_t before = uselocale(comma);
    pal_surface s = read_text("v 0.5 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "obj");
    (void)uselocale(before);
    freelocale(comma);
    assert_true(s.x[0] > 0.4);
    pal_surface_clear(&s);
}

static void ply_vertices_keep_their_numbers(void **state) {
    (void)state;
    pal_surface s =
        read_text("ply\nformat ascii 1.0\nelement vertex 6\nproperty float x\nproperty float y\n"
                  "property float z\nproperty float s\nproperty float t\nelement face 2\n"
                  "property list uchar int vertex_indices\nend_header\n"
                  "0 0 0 0 0\n1 0 0 1 0\n9 9 9 0 0\n0 1 0 0 1\n0 0 0 0.5 0\n1 1 0 1 1\n"
                  "3 5 3 4\n4 0 1 5 3\n",
                  "ply");
    assert_int_equal(s.vertex_count, 6);
    assert_true(fabs(s.x[6] - 9.0) <= 0.0);
    assert_true(fabs(s.x[15] - 1.0) <= 0.0 && fabs(s.x[16] - 1.0) <= 0.0);
    assert_int_equal(s.triangle_count, 3); // the quadrilateral is cut
    assert_int_equal(s.v[0], 5);
    assert_int_equal(s.v[1], 3);
    assert_int_equal(s.v[2], 4);
    pal_surface_clear(&s);
}

static void stl_has_no_numbers_and_is_welded(void **state) {
    (void)state;
    test_surface cube;
    char path[64];
    pal_surface s;
    test_surface_cube(&cube, 0, 0, 0);
    test_surface_write(&cube, "stlb", path);
    assert_int_equal(pal_surface_read_in_order(path, &s, NULL), PALPATE_OK);
    assert_int_equal(s.vertex_count, 8);
    assert_int_equal(s.triangle_count, 12);
    pal_surface_clear(&s);
    (void)unlink(path);
}

static void bad_meshes_are_refused_with_their_line(void **state) {
    (void)state;
    static const struct {
        const char *text, *message;
    } bad[] = {
        {"v 0 0 0\nv 1 0\n", ".obj: line 2: a vertex needs three finite coordinates"},
        {"v 0 0 nan\n", ".obj: line 1: a vertex needs three finite coordinates"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\n# \\\n\nf 1 2 0\n",
         ".obj: line 6: a face names a vertex that is not there"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 -4\n",
         ".obj: line 4: a face names a vertex that is not there"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 99999999999999999999\n", ".obj: line 4: a face names"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 4\n", ".obj: a face names vertex 4, there are 3"},
        {"v 0 0 0\nv 1 0 0\nv 0 1 0\nl 1 2 3\n", ".obj: it holds no triangle"},
        {"", ".obj: it holds no triangle"},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        char path[64];
        pal_surface s;
        pal_error e = {0};
        test_surface_text(bad[i].text, "obj", path);
        assert_int_equal(pal_surface_read_in_order(path, &s, &e), PALPATE_ERROR_GEOMETRY);
        if (strstr(e.message, bad[i].message) == NULL) {
            fail_msg("'%s' is not in '%s'", bad[i].message, e.message);
        }
        assert_null(s.x);
        assert_null(s.v);
        (void)unlink(path);
    }
}

/// Displacements and normals at the skin under rows u(x) = A x + b.
static void linear_field(const pal_model *model, double a[3][3], const double b[3], float **u,
                         float **n) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    float *rows = calloc(3 * (size_t)info.row_count, sizeof *rows);
    *u = calloc(3 * (size_t)info.skin_count, sizeof **u);
    *n = calloc(3 * (size_t)info.skin_count, sizeof **n);
    assert_true(rows != NULL && *u != NULL && *n != NULL);
    for (int32_t r = 0; r < info.row_count; r++) {
        const double *x = pal_model_positions(model) + 3 * (size_t)pal_model_rows(model)[r];
        for (int c = 0; c < 3; c++) {
            rows[3 * r + c] = (float)(a[c][0] * x[0] + a[c][1] * x[1] + a[c][2] * x[2] + b[c]);
        }
    }
    pal_frame frame = {.row_count = info.row_count, .displacement = rows};
    assert_int_equal(pal_model_skin(model, &frame, *u, *n), PALPATE_OK);
    free(rows);
}

/// A grid of 11 x 11 vertices over the box's top in millimetres, cut along its middle column, whose
/// vertices are there twice (121..131), with a vertex that no triangle uses (132).
static void write_top(char path[64], double height) {
    static char text[20000];
    size_t n = 0;
#define PUT(...) n += (size_t)snprintf(text + n, sizeof text - n, __VA_ARGS__)
    for (int j = 0; j < 11; j++) {
        for (int i = 0; i < 11; i++) {
            PUT("v %d %d %g\n", -20 + 4 * i, -25 + 5 * j, height);
        }
    }
    for (int j = 0; j < 11; j++) {
        PUT("v 0 %d %g\n", -25 + 5 * j, height);
    }
    PUT("v 20 1 -7\n");
    for (int j = 0; j < 10; j++) {
        for (int i = 0; i < 10; i++) {
            int low = i == 5 ? 121 + j : 11 * j + i, high = i == 5 ? 122 + j : 11 * (j + 1) + i;
            PUT("f %d %d %d %d\n", low + 1, 11 * j + i + 2, 11 * (j + 1) + i + 2, high + 1);
        }
    }
#undef PUT
    assert_true(n < sizeof text);
    test_surface_text(text, "obj", path);
}

static void linear_fields_are_exact_on_planes(void **state) {
    (void)state;
    char path[64];
    write_top(path, 0.0);
    pal_model *model = precompute(BOX, path, "skin.scale=0.001");
    pal_model_info info;
    pal_model_get_info(model, &info);
    assert_int_equal(info.skin_count, 133);
    int32_t triangles;
    const int32_t *v = pal_model_skin_triangles(model, &triangles);
    assert_int_equal(triangles, 200);
    const double *x = pal_model_skin_positions(model);
    assert_true(fabs(x[3 * 131 + 1] - 0.025) < 1e-15 &&
                fabs(x[3 * 132] - 0.02) < 1e-15); // the file's order
    double a[3][3] = {{0.01, 0.02, 0.0}, {0.0, -0.03, 0.01}, {0.5, 0.0, 0.02}};
    const double b[3] = {1e-3, -2e-3, 5e-4};
    float *u, *n;
    linear_field(model, a, b, &u, &n);
    for (int i = 0; i < 133; i++) {
        for (int c = 0; c < 3; c++) {
            const double *y = x + 3 * i;
            double expected = a[c][0] * y[0] + a[c][1] * y[1] + a[c][2] * y[2] + b[c];
            // values up to 0.01 m, single precision, three products
            assert_true(fabs((double)u[3 * i + c] - expected) < 5e-9);
        }
    }
    // the deformed top is spanned by (1.01, 0, 0.5) and (0.02, 0.97, 0): its normal everywhere,
    // also at the cut and at both of its twins; none where there is no triangle
    double normal[3] = {-0.5 * 0.97, 0.5 * 0.02, 1.01 * 0.97};
    double length = sqrt(normal[0] * normal[0] + normal[1] * normal[1] + normal[2] * normal[2]);
    for (int i = 0; i < 133; i++) {
        for (int c = 0; c < 3; c++) {
            assert_true(fabs((double)n[3 * i + c] - (i < 132 ? normal[c] / length : 0.0)) < 1e-5);
        }
    }
    for (int j = 0; j < 11; j++) { // triangles name one vertex of each place
        assert_int_equal(model->skin_twin[121 + j], 11 * j + 5);
        assert_int_equal(model->skin_twin[11 * j + 5], 11 * j + 5);
    }
    for (int i = 0; i < 3 * triangles; i++) {
        assert_true(v[i] < 121);
    }
    free(u), free(n);
    pal_model_free(model);
    (void)unlink(path);
}

/// Vertices at nodes, then at middles of edges of the model's surface.
static void write_nodes_and_middles(const pal_model *model, char path[64]) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    size_t size = 100 * (size_t)(info.surface_count + 4 * info.triangle_count), n = 0;
    char *text = malloc(size);
    assert_non_null(text);
    const double *x = pal_model_positions(model);
    const int32_t *t = pal_model_triangles(model);
    for (int32_t i = 0; i < info.surface_count; i++) {
        n += (size_t)snprintf(text + n, size - n, "v %.17g %.17g %.17g\n", x[3 * i], x[3 * i + 1],
                              x[3 * i + 2]);
    }
    for (int32_t i = 0; i < info.triangle_count; i++) {
        const double *a = x + 3 * (size_t)t[3 * i], *b = x + 3 * (size_t)t[3 * i + 1];
        n += (size_t)snprintf(text + n, size - n, "v %.17g %.17g %.17g\n", 0.5 * (a[0] + b[0]),
                              0.5 * (a[1] + b[1]), 0.5 * (a[2] + b[2]));
    }
    for (int32_t i = 0; i < info.triangle_count; i++) {
        n += (size_t)snprintf(text + n, size - n, "f %d %d %d\n", t[3 * i] + 1, t[3 * i + 1] + 1,
                              t[3 * i + 2] + 1);
    }
    test_surface_text(text, "obj", path);
    free(text);
}

static void the_skin_follows_a_pressed_surface(void **state) {
    (void)state;
    char path[64];
    pal_model *bare = precompute(HEMISPHERE, NULL, NULL);
    write_nodes_and_middles(bare, path);
    pal_model *model = precompute(HEMISPHERE, path, NULL);
    pal_model_info info;
    pal_model_get_info(bare, &info);
    int32_t nodes = info.surface_count, triangles = info.triangle_count;
    pal_model_get_info(model, &info);
    assert_int_equal(info.surface_count, nodes); // the skin has no say in the physics
    assert_memory_equal(bare->c_tt, model->c_tt,
                        sizeof(double) * 9 * (size_t)info.column_count * (size_t)info.column_count);
    assert_int_equal(info.skin_count, nodes + triangles);
    pal_engine_def def = pal_engine_default_def();
    def.tools = pal_model_runtime(model)->tools;
    def.tool_count = 1;
    pal_engine *engine = NULL;
    assert_int_equal(pal_engine_create(model, &def, &engine, NULL), PALPATE_OK);
    pal_tool_state in = {.position = {0.001, 0.002, 0.057}, .orientation = {1, 0, 0, 0}};
    pal_tool_force out;
    (void)pal_engine_tick(engine, &in, &out);
    pal_frame frame;
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(engine, 0), &frame), 1);
    float *u = calloc(6 * (size_t)info.skin_count, sizeof *u), *n = u + 3 * (size_t)info.skin_count;
    assert_non_null(u);
    assert_int_equal(pal_model_skin(model, &frame, u, n), PALPATE_OK);
    double largest = 0.0;
    for (int32_t i = 0; i < 3 * nodes; i++) {
        // rows of `surface` are the surface nodes; the weights of a node are (1, 0, 0) to rounding
        assert_true(fabs((double)u[i] - (double)frame.displacement[i]) < 1e-9);
        largest = fmax(largest, fabs((double)u[i]));
    }
    assert_true(largest > 1e-3 && largest < 0.004);
    const int32_t *t = pal_model_triangles(model);
    for (int32_t i = 0; i < triangles; i++) {
        for (int c = 0; c < 3; c++) {
            double middle = 0.5 * ((double)frame.displacement[3 * t[3 * i] + c] +
                                   (double)frame.displacement[3 * t[3 * i + 1] + c]);
            assert_true(fabs((double)u[3 * (nodes + i) + c] - middle) < 1e-9);
        }
    }
    // the surface itself, drawn as a skin, has the normals that the model without a skin gives
    float *own = calloc(6 * (size_t)nodes, sizeof *own);
    assert_non_null(own);
    assert_int_equal(pal_model_skin(bare, &frame, own, own + 3 * (size_t)nodes), PALPATE_OK);
    for (int32_t i = 0; i < 3 * nodes; i++) {
        assert_true(fabs((double)n[i] - (double)own[3 * nodes + i]) < 1e-5);
    }
    free(own), free(u);
    pal_engine_free(engine);
    pal_model_free(model);
    pal_model_free(bare);
    (void)unlink(path);
}

static void a_body_from_a_file_is_drawn_in_its_order(void **state) {
    (void)state;
    test_surface sphere;
    char path[64], text[700];
    test_surface_sphere(&sphere, 3, 1.0);
    for (int32_t t = 0; t < sphere.triangle_count;
         t++) { // inside out: the body is turned, and so is its skin
        int32_t swap = sphere.v[3 * t];
        sphere.v[3 * t] = sphere.v[3 * t + 1];
        sphere.v[3 * t + 1] = swap;
    }
    test_surface_write(&sphere, "obj", path);
    (void)snprintf(text, sizeof text,
                   "palpate: 1\nbody:\n  geometry: {file: %s, scale: 0.03}\n  spacing: 0.011\n"
                   "  material: {young: 10e3, poisson: 0.3}\n  fixed: [{below: {z: -0.02}}]\n"
                   "  touchable: [{above: {z: 0.027}}]\n",
                   path);
    pal_model *model = precompute(text, NULL, NULL);
    pal_model_info info;
    pal_model_get_info(model, &info);
    assert_int_equal(info.skin_count, sphere.vertex_count);
    const double *x = pal_model_skin_positions(model);
    for (int32_t i = 0; i < 3 * sphere.vertex_count; i++) {
        assert_true(fabs(x[i] - 0.03 * sphere.x[i]) < 1e-9); // written with nine digits
    }
    double a[3][3] = {{0}}, b[3] = {1e-3, 0, 0};
    float *u, *n;
    linear_field(model, a, b, &u, &n);
    for (int32_t i = 0; i < sphere.vertex_count; i++) {
        assert_true(fabs((double)u[3 * i] - 1e-3) < 1e-9); // weights sum to 1
        double out = 0.0;
        for (int c = 0; c < 3; c++) {
            out += (double)n[3 * i + c] * sphere.x[3 * i + c];
        }
        assert_true(out > 0.98); // outward; vertex normals of 512 triangles are within 0.1 rad
    }
    free(u), free(n);
    pal_model_free(model);
    (void)unlink(path);
}

static void the_hash_covers_the_skins_content_not_its_path(void **state) {
    (void)state;
    char path[3][64], hex[5][65];
    write_top(path[0], 0.0);
    write_top(path[1], 0.0);
    write_top(path[2], 0.1);
    const char *const scale[] = {"skin.scale=0.001", "skin.scale=0.001", "skin.scale=0.001",
                                 "skin.scale=0.002"};
    const int file[] = {0, 1, 2, 0};
    for (int i = 0; i < 4; i++) {
        pal_scene *scene = NULL;
        pal_error e = {0};
        assert_int_equal(load(BOX, path[file[i]], scale[i], &scene, &e), PALPATE_OK);
        assert_int_equal(pal_scene_hash(scene, hex[i], &e), PALPATE_OK);
        pal_scene_free(scene);
    }
    pal_scene *scene = NULL;
    assert_int_equal(test_scene_load(BOX, NULL, &scene, NULL), PALPATE_OK);
    assert_int_equal(pal_scene_hash(scene, hex[4], NULL), PALPATE_OK);
    pal_scene_free(scene);
    assert_string_equal(hex[0], hex[1]);
    for (int i = 2; i < 5; i++) {
        assert_string_not_equal(hex[0], hex[i]);
    }
    for (int i = 0; i < 3; i++) {
        (void)unlink(path[i]);
    }
}

static void wrong_skins_are_refused_and_far_ones_mentioned(void **state) {
    (void)state;
    char path[64];
    pal_scene *scene = NULL;
    pal_error e = {0};
    assert_int_equal(load(BOX, "/nonexistent/mesh.obj", NULL, &scene, &e), PALPATE_ERROR_SCENE);
    assert_non_null(strstr(e.message, "skin.file: found /nonexistent/mesh.obj"));
    write_top(path, 15.0);
    assert_int_equal(load(BOX, path, "store.displacement=none", &scene, &e), PALPATE_ERROR_SCENE);
    assert_non_null(strstr(e.message, "displacement: surface or all"));
    assert_int_equal(load(BOX, path, NULL, &scene, &e), PALPATE_OK); // millimetres taken for metres
    pal_model *model = NULL;
    assert_int_equal(pal_precompute(scene, NULL, &model, &e), PALPATE_ERROR_SCENE);
    assert_null(model);
    assert_non_null(strstr(e.message, "skin.scale"));
    pal_scene_free(scene);
    // 15 mm above the top, nodes 8 mm apart: 132 of the vertices are told of, the one on the side
    // is not
    assert_int_equal(load(BOX, path, "skin.scale=0.001", &scene, &e), PALPATE_OK);
    assert_int_equal(pal_precompute(scene, NULL, &model, &e), PALPATE_OK);
    int said = 0;
    for (int i = 0; i < pal_scene_warning_count(scene); i++) {
        said += strstr(pal_scene_warning(scene, i), "132 of 133 vertices") != NULL;
    }
    assert_int_equal(said, 1);
    pal_scene_free(scene);
    pal_model_free(model);
    (void)unlink(path);
    test_surface_text("v 0 0 0\n", "obj", path);
    assert_int_equal(load(BOX, path, NULL, &scene, &e), PALPATE_OK);
    assert_int_equal(pal_precompute(scene, NULL, &model, &e), PALPATE_ERROR_GEOMETRY);
    assert_non_null(strstr(e.message, "it holds no triangle"));
    pal_scene_free(scene);
    (void)unlink(path);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(obj_vertices_keep_their_numbers),
        cmocka_unit_test(obj_numbers_have_a_point_in_any_locale),
        cmocka_unit_test(ply_vertices_keep_their_numbers),
        cmocka_unit_test(stl_has_no_numbers_and_is_welded),
        cmocka_unit_test(bad_meshes_are_refused_with_their_line),
        cmocka_unit_test(linear_fields_are_exact_on_planes),
        cmocka_unit_test(the_skin_follows_a_pressed_surface),
        cmocka_unit_test(a_body_from_a_file_is_drawn_in_its_order),
        cmocka_unit_test(the_hash_covers_the_skins_content_not_its_path),
        cmocka_unit_test(wrong_skins_are_refused_and_far_ones_mentioned),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
