/// Scenes that must load: the design's example key by key, defaults, --set, hashes.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/scene.h"

static const char *const EXAMPLE =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {hemisphere: {radius: 0.05}}    # flat face at z = 0, pole at +z\n"
    "  spacing: 0.007\n"
    "  refine:\n"
    "    - {center: [0, 0, 0.05], radius: 0.015, spacing: 0.0022}\n"
    "    - {rim: pole, spacing: 0.0007}\n"
    "  material: {young: 10e3, poisson: 0.45, density: 1000}\n"
    "  fixed:\n"
    "    - {below: {z: 0.0}}\n"
    "  touchable:\n"
    "    - {ball: {center: [0, 0, 0.05], radius: 0.03}}\n"
    "  patches:\n"
    "    pole: {ball: {center: [0, 0, 0.05], radius: 0.009983}, rim_spacing: auto}\n"
    "  probes: {mid: [0, 0, 0.025]}\n"
    "method: {kind: cell}\n"
    "repair: symmetrize\n"
    "store: {displacement: surface, precision: single}\n"
    "tools:\n"
    "  - name: probe\n"
    "    shape: {sphere: {radius: 0.004}}\n"
    "    device: {replay: press.csv}\n"
    "    friction: 0.0\n"
    "    limits: {force: 3.3, slew: 100}\n"
    "    start: [0, 0, 0.054]\n"
    "    axis: [0, 0, -1]\n"
    "servo: {rate: 1000}\n"
    "render: {rate: 30}\n";

static const char *const MINIMAL = "palpate: 1\n"
                                   "body:\n"
                                   "  geometry: {sphere: {radius: 0.05}}\n"
                                   "  spacing: 0.01\n"
                                   "  material: {young: 1000, poisson: 0.3}\n"
                                   "  fixed: [{below: {z: -0.04}}]\n";

static char directory[64];

static int make_directory(void **state) {
    (void)state;
    (void)snprintf(directory, sizeof directory, "/tmp/palpate-scene-XXXXXX");
    return mkdtemp(directory) == NULL;
}

static int remove_directory(void **state) {
    (void)state;
    char command[100];
    (void)snprintf(command, sizeof command, "rm -rf %s", directory);
    return system(command);
}

/// Write a file into the test's directory; the returned path lives until the next call.
static const char *put(const char *name, const char *text) {
    static char path[160];
    (void)snprintf(path, sizeof path, "%s/%s", directory, name);
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(text, 1, strlen(text), f), strlen(text));
    assert_int_equal(fclose(f), 0);
    return path;
}

static pal_scene *load(const char *text, int count, const char *const set[]) {
    pal_scene *scene = NULL;
    pal_error error = {0};
    pal_status status = pal_scene_load(put("scene.yaml", text), set, count, &scene, &error);
    if (status != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    return scene;
}

static void the_designs_example_fills_every_field(void **state) {
    (void)state;
    put("press.csv", "time,x,y,z,qw,qx,qy,qz,button\n");
    pal_scene *s = load(EXAMPLE, 0, NULL);
    assert_int_equal(pal_scene_warning_count(s), 0);
    assert_int_equal(s->geometry.kind, PALPATE_GEOMETRY_HEMISPHERE);
    assert_true(s->geometry.radius == 0.05 && s->spacing == 0.007 && s->grading == 0.45);
    assert_int_equal(s->refine_count, 2);
    assert_int_equal(s->refine[0].kind, PALPATE_REFINE_BALL);
    assert_true(s->refine[0].center[2] == 0.05 && s->refine[0].radius == 0.015 &&
                s->refine[0].spacing == 0.0022);
    assert_int_equal(s->refine[1].kind, PALPATE_REFINE_RIM);
    assert_string_equal(s->refine[1].rim, "pole");
    assert_true(s->young == 10000 && s->poisson == 0.45 && s->density == 1000);
    assert_int_equal(s->fixed.count, 1);
    assert_int_equal(s->fixed.item[0].kind, PALPATE_SELECT_BELOW);
    assert_int_equal(s->fixed.item[0].axis, 2);
    assert_true(s->fixed.item[0].value == 0.0);
    assert_int_equal(s->touchable.count, 1);
    assert_int_equal(s->touchable.item[0].kind, PALPATE_SELECT_BALL);
    assert_true(s->touchable.item[0].radius == 0.03 && s->touchable.item[0].center[2] == 0.05);
    assert_int_equal(s->patch_count, 1);
    assert_string_equal(s->patch[0].name, "pole");
    assert_true(s->patch[0].rim_spacing < 0);
    assert_int_equal(s->patch[0].where.count, 1);
    assert_int_equal(s->patch[0].where.item[0].kind, PALPATE_SELECT_BALL);
    assert_true(s->patch[0].where.item[0].radius == 0.009983);
    assert_int_equal(s->patch[0].place.line, 14);
    assert_int_equal(s->patch[0].place.column, 11);
    assert_string_equal(s->patch[0].place.key, "body.patches.pole");
    assert_int_equal(s->probe_count, 1);
    assert_string_equal(s->probe[0].name, "mid");
    assert_true(s->probe[0].position[2] == 0.025);
    assert_int_equal(s->method.kind, PALPATE_METHOD_CELL);
    assert_int_equal(s->method.volumetric, PALPATE_VOLUMETRIC_NODAL);
    assert_int_equal(s->method.basis, PALPATE_BASIS_LINEAR);
    assert_true(s->method.stabilization < 0);
    assert_int_equal(s->symmetrize, 1);
    assert_int_equal(s->certify_warn, 0);
    assert_int_equal(s->store_rows, PALPATE_STORE_SURFACE);
    assert_int_equal(s->precision, PALPATE_PRECISION_SINGLE);
    const pal_runtime_config *r = pal_scene_runtime(s);
    assert_int_equal(r->tool_count, 1);
    const pal_tool_def *t = &r->tools[0];
    assert_string_equal(t->name, "probe");
    assert_int_equal(t->shape, PALPATE_SHAPE_SPHERE);
    assert_int_equal(t->device.kind, PALPATE_DEVICE_REPLAY);
    char path[128];
    (void)snprintf(path, sizeof path, "%s/press.csv", directory);
    assert_string_equal(t->device.path, path);
    assert_true(t->radius == 0.004 && t->limits.force == 3.3 && t->limits.slew == 100);
    assert_true(t->has_start && t->start[2] == 0.054 && t->axis[2] == -1);
    assert_true(r->servo_rate == 1000 && r->render_rate == 30 && r->max_contacts == 32);
    pal_scene_free(s);
}

static void a_minimal_scene_gets_the_documented_defaults(void **state) {
    (void)state;
    pal_scene *s = load(MINIMAL, 0, NULL);
    assert_true(s->density == 1000 && s->grading == 0.45);
    assert_int_equal(s->touchable.count, 1);
    assert_int_equal(s->touchable.item[0].kind, PALPATE_SELECT_ALL);
    assert_int_equal(s->method.kind, PALPATE_METHOD_CELL);
    assert_int_equal(s->method.volumetric, PALPATE_VOLUMETRIC_NODAL);
    assert_int_equal(s->symmetrize, 1);
    assert_int_equal(s->store_rows, PALPATE_STORE_SURFACE);
    assert_int_equal(s->runtime.tool_count, 0);
    assert_true(s->runtime.servo_rate == 1000 && s->runtime.render_rate == 30);
    pal_scene_free(s);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_designs_example_fills_every_field),
        cmocka_unit_test(a_minimal_scene_gets_the_documented_defaults),
    };
    return cmocka_run_group_tests_name("scene", tests, make_directory, remove_directory);
}
