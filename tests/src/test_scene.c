/// Scenes that must load: the design's example key by key, defaults, --set, hashes.
#include <locale.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/scene/scene.h"
#include "tests/support/scene_text.h"

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

/// Load a scene in a directory of its own that also holds press.csv and surface.obj.
static pal_status loading(const char *text, const char *const set[], pal_scene **scene,
                          char directory[64], pal_error *error) {
    char path[64];
    char csv[80];
    char obj[80];
    int count = 0;
    while (set != NULL && set[count] != NULL) {
        count++;
    }
    test_scene_put(text, strlen(text), path);
    (void)snprintf(directory, 64, "%s", path);
    *strrchr(directory, '/') = 0;
    (void)snprintf(csv, sizeof csv, "%s/press.csv", directory);
    (void)snprintf(obj, sizeof obj, "%s/surface.obj", directory);
    FILE *f = fopen(csv, "w");
    FILE *g = fopen(obj, "w");
    assert_non_null(f);
    assert_non_null(g);
    assert_true(fprintf(f, "time,x,y,z,qw,qx,qy,qz,button\n") > 0);
    assert_int_equal(fclose(f) + fclose(g), 0);
    pal_status status = pal_scene_load(path, set, count, scene, error);
    assert_int_equal(unlink(csv) + unlink(obj), 0);
    test_scene_remove(path);
    return status;
}

static pal_scene *load(const char *text, const char *const set[]) {
    pal_scene *scene = NULL;
    pal_error error = {0};
    char directory[64];
    if (loading(text, set, &scene, directory, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    return scene;
}

static void the_designs_example_fills_every_field(void **state) {
    (void)state;
    pal_scene *s;
    char directory[64];
    assert_int_equal(loading(EXAMPLE, NULL, &s, directory, NULL), PALPATE_OK);
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
    assert_int_equal(s->method.volumetric, PALPATE_VOLUMETRIC_PATCH);
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
    assert_true(r->contact_law == PALPATE_CONTACT_SURFACE && r->contact_points == 16);
    pal_scene_free(s);
}

static void a_minimal_scene_gets_the_documented_defaults(void **state) {
    (void)state;
    pal_scene *s = load(MINIMAL, NULL);
    assert_true(s->density == 1000 && s->grading == 0.45);
    assert_int_equal(s->touchable.count, 1);
    assert_int_equal(s->touchable.item[0].kind, PALPATE_SELECT_ALL);
    assert_int_equal(s->method.kind, PALPATE_METHOD_CELL);
    assert_int_equal(s->method.volumetric, PALPATE_VOLUMETRIC_PATCH);
    assert_int_equal(s->symmetrize, 1);
    assert_int_equal(s->store_rows, PALPATE_STORE_SURFACE);
    assert_int_equal(s->runtime.tool_count, 0);
    assert_true(s->runtime.servo_rate == 1000 && s->runtime.render_rate == 30);
    pal_scene_free(s);
}

// ---- Every key of the schema
// -----------------------------------------------------------------------

/// Two values of a key that must make different scenes: no key is ignored.
typedef struct pair {
    const char *path;  ///< of the schema
    const char *a, *b; ///< overrides on the design's example
} pair;

static const pair PAIRS[] = {
    {"body.geometry.hemisphere.radius", "body.geometry.hemisphere.radius=0.04",
     "body.geometry.hemisphere.radius=0.041"},
    {"body.geometry.box.size", "body.geometry={box: {size: [0.1, 0.1, 0.1]}}",
     "body.geometry={box: {size: [0.1, 0.1, 0.2]}}"},
    {"body.geometry.box.center", "body.geometry={box: {size: [0.1, 0.1, 0.1]}}",
     "body.geometry={box: {size: [0.1, 0.1, 0.1], center: [0, 0, 1]}}"},
    {"body.geometry.sphere.radius", "body.geometry={sphere: {radius: 0.05}}",
     "body.geometry={sphere: {radius: 0.051}}"},
    {"body.geometry.sphere.center", "body.geometry={sphere: {radius: 0.05}}",
     "body.geometry={sphere: {radius: 0.05, center: [1, 0, 0]}}"},
    {"body.geometry.file", "body.geometry.hemisphere.radius=0.04",
     "body.geometry={file: /proc/self/exe}"},
    {"body.geometry.scale", "body.geometry={file: /proc/self/exe}",
     "body.geometry={file: /proc/self/exe, scale: 0.1}"},
    {"body.spacing", "body.spacing=0.006", "body.spacing=6.5e-3"},
    {"body.grading", "body.grading=0.5", "body.grading=0.6"},
    {"body.refine[].center", "body.refine.0.center=[0, 0, 0.05]",
     "body.refine.0.center=[0, 0, 0.04]"},
    {"body.refine[].radius", "body.refine[0].radius=0.02", "body.refine[0].radius=0.03"},
    {"body.refine[].rim", "body.refine=[{center: [0, 0, 0], radius: 0.01, spacing: 0.001}]",
     "body.refine=[{rim: pole, spacing: 0.001}]"},
    {"body.refine[].spacing", "body.refine.1.spacing=0.0007", "body.refine.1.spacing=0.0008"},
    {"body.material.young", "body.material.young=1e4", "body.material.young=1e5"},
    {"body.material.poisson", "body.material.poisson=0", "body.material.poisson=-0.5"},
    {"body.material.density", "body.material.density=1000", "body.material.density=1001"},
    {"body.patches.*.rim_spacing", "body.patches.pole.rim_spacing=auto",
     "body.patches.pole.rim_spacing=none"},
    {"body.probes.*", "body.probes.mid=[0, 0, 0.025]", "body.probes.mid=[0, 0, 0.02]"},
    {"skin.file", "palpate=1", "skin={file: /proc/self/exe}"},
    {"skin.scale", "skin={file: /proc/self/exe}", "skin={file: /proc/self/exe, scale: 0.1}"},
    {"method.kind", "method.kind=point", "method.kind=galerkin"},
    {"method.basis", "method={kind: point, basis: linear}", "method={kind: point, basis: cubic}"},
    {"method.derivatives", "method={kind: point}", "method={kind: point, derivatives: diffuse}"},
    {"method.neighbours", "method={form: collocated, neighbours: 24}",
     "method={form: collocated, neighbours: 25}"},
    {"method.exponent", "method={form: collocated}", "method={form: collocated, exponent: 3}"},
    {"method.fictitious", "method={kind: point, fictitious: true}",
     "method={kind: point, fictitious: false}"},
    {"method.volumetric", "method.volumetric=plain", "method.volumetric=nodal"},
    {"method.form", "method.form=symmetric", "method.form=collocated"},
    {"method.stabilization", "method.stabilization=0", "method.stabilization=0.1"},
    {"repair", "repair=none", "repair=symmetrize"},
    {"certify", "certify=warn", "certify=strict"},
    {"estimate", "estimate=false", "estimate=true"},
    {"store.displacement", "store.displacement=none", "store.displacement=all"},
    {"store.precision", "store.precision=double", "store.precision=half"},
    {"store.tolerance", "store.tolerance=0", "store.tolerance=1e-3"},
    {"tools[].name", "tools.0.name=a", "tools.0.name=b"},
    {"tools[].shape.point", "tools.0.shape=point", "tools.0.shape={sphere: {radius: 1}}"},
    {"tools[].shape.sphere.radius", "tools.probe.shape.sphere.radius=1",
     "tools.probe.shape.sphere.radius=2"},
    {"tools[].shape.capsule.radius", "tools.0.shape={capsule: {radius: 1, length: 1}}",
     "tools.0.shape={capsule: {radius: 2, length: 1}}"},
    {"tools[].shape.capsule.length", "tools.0.shape={capsule: {radius: 1, length: 1}}",
     "tools.0.shape={capsule: {radius: 1, length: 2}}"},
    {"tools[].device.replay", "tools.0.device=", "tools.0.device={replay: press.csv}"},
    {"tools[].device.scripted.kind", "tools.0.device={scripted: {depth: 1, kind: slide}}",
     "tools.0.device={scripted: {depth: 1, kind: circle}}"},
    {"tools[].device.scripted.depth", "tools.0.device={scripted: {depth: 1}}",
     "tools.0.device={scripted: {depth: 2}}"},
    {"tools[].device.scripted.ramp", "tools.0.device={scripted: {depth: 1}}",
     "tools.0.device={scripted: {depth: 1, ramp: 2}}"},
    {"tools[].device.scripted.period", "tools.0.device={scripted: {depth: 1}}",
     "tools.0.device={scripted: {depth: 1, period: 3}}"},
    {"tools[].device.scripted.amplitude", "tools.0.device={scripted: {depth: 1}}",
     "tools.0.device={scripted: {depth: 1, amplitude: 3}}"},
    {"tools[].device.scripted.direction", "tools.0.device={scripted: {depth: 1}}",
     "tools.0.device={scripted: {depth: 1, direction: [0, 1, 0]}}"},
    {"tools[].device.scripted.tremor_amplitude", "tools.0.device={scripted: {depth: 1}}",
     "tools.0.device={scripted: {depth: 1, tremor_amplitude: 1}}"},
    {"tools[].device.scripted.tremor_frequency", "tools.0.device={scripted: {depth: 1}}",
     "tools.0.device={scripted: {depth: 1, tremor_frequency: 8}}"},
    {"tools[].device.simulated.model", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {model: premium}}"},
    {"tools[].device.simulated.mass", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {mass: 1}}"},
    {"tools[].device.simulated.damping", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {damping: 1}}"},
    {"tools[].device.simulated.friction", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {friction: 1}}"},
    {"tools[].device.simulated.resolution", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {resolution: 0}}"},
    {"tools[].device.simulated.force", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {force: 1}}"},
    {"tools[].device.simulated.reach", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {reach: 1}}"},
    {"tools[].device.simulated.push", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {push: 1}}"},
    {"tools[].device.simulated.kick", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {kick: 1}}"},
    {"tools[].device.simulated.grasp", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {grasp: 1}}"},
    {"tools[].device.simulated.hand.grip", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {hand: {grip: light}}}"},
    {"tools[].device.simulated.hand.mass", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {hand: {mass: 1}}}"},
    {"tools[].device.simulated.hand.damping", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {hand: {damping: 1}}}"},
    {"tools[].device.simulated.hand.stiffness", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {hand: {stiffness: 1}}}"},
    {"tools[].device.simulated.hand.release", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {hand: {release: 1}}}"},
    {"tools[].device.simulated.motion.kind", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {kind: slide}}}"},
    {"tools[].device.simulated.motion.depth", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {depth: 1}}}"},
    {"tools[].device.simulated.motion.ramp", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {ramp: 2}}}"},
    {"tools[].device.simulated.motion.period", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {period: 3}}}"},
    {"tools[].device.simulated.motion.amplitude", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {amplitude: 3}}}"},
    {"tools[].device.simulated.motion.direction", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {direction: [0, 1, 0]}}}"},
    {"tools[].device.simulated.motion.tremor_amplitude", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {tremor_amplitude: 1}}}"},
    {"tools[].device.simulated.motion.tremor_frequency", "tools.0.device={simulated: {}}",
     "tools.0.device={simulated: {motion: {tremor_frequency: 8}}}"},
    {"tools[].friction", "tools.0.friction=0.3", "tools.0.friction=0.4"},
    {"tools[].coupling.stiffness", "tools.0.coupling={stiffness: 500}",
     "tools.0.coupling={stiffness: 400}"},
    {"tools[].coupling.damping", "tools.0.coupling={stiffness: 500}",
     "tools.0.coupling={stiffness: 500, damping: 1}"},
    {"tools[].limits.force", "tools.0.limits.force=1", "tools.0.limits.force=2"},
    {"tools[].limits.slew", "tools.0.limits.slew=1", "tools.0.limits.slew=2"},
    {"tools[].limits.torque", "tools.0.limits.torque=1", "tools.0.limits.torque=2"},
    {"tools[].device_spec.max_force", "tools.0.device_spec.max_force=4",
     "tools.0.device_spec.max_force=5"},
    {"tools[].device_spec.max_torque", "tools.0.device_spec.max_torque=4",
     "tools.0.device_spec.max_torque=5"},
    {"tools[].device_spec.max_stiffness", "tools.0.device_spec.max_stiffness=4",
     "tools.0.device_spec.max_stiffness=5"},
    {"tools[].device_spec.max_damping", "tools.0.device_spec.max_damping=4",
     "tools.0.device_spec.max_damping=5"},
    {"tools[].device_spec.max_speed", "tools.0.device_spec.max_speed=4",
     "tools.0.device_spec.max_speed=5"},
    {"tools[].start", "tools.0.start=[0, 0, 1]", "tools.0.start=[0, 0, 2]"},
    {"tools[].axis", "tools.0.axis=[0, 0, 1]", "tools.0.axis=[0, 1, 1]"},
    {"servo.rate", "servo.rate=1000", "servo.rate=500"},
    {"render.rate", "render.rate=0", "render.rate=60"},
    {"render.field", "render.field=servo", "render.field=render"},
    {"watchdog.stale", "watchdog.stale=0.01", "watchdog.stale=0.03"},
    {"watchdog.stall", "watchdog.stall=0.01", "watchdog.stall=0.03"},
    {"watchdog.latch", "watchdog.latch=2", "watchdog.latch=3"},
    {"watchdog.speed", "watchdog.speed=auto", "watchdog.speed=3"},
    {"watchdog.ramp_down", "watchdog.ramp_down=0.01", "watchdog.ramp_down=0.03"},
    {"watchdog.ramp_up", "watchdog.ramp_up=0.01", "watchdog.ramp_up=0.03"},
    {"contact.law", "contact.law=surface", "contact.law=nodes"},
    {"contact.points", "contact.points=1", "contact.points=2"},
    {"max_contacts", "max_contacts=1", "max_contacts=2"},
};

/// The same below every key that takes a selector.
static const pair SELECTOR_PAIRS[] = {
    {".ball.center", "{ball: {center: [0, 0, 0], radius: 1}}",
     "{ball: {center: [0, 0, 1], radius: 1}}"},
    {".ball.radius", "{ball: {center: [0, 0, 0], radius: 1}}",
     "{ball: {center: [0, 0, 0], radius: 2}}"},
    {".box.min", "{box: {min: [0, 0, 0], max: [1, 1, 1]}}",
     "{box: {min: [0, 0, 0.5], max: [1, 1, 1]}}"},
    {".box.max", "{box: {min: [0, 0, 0], max: [1, 1, 1]}}",
     "{box: {min: [0, 0, 0], max: [1, 1, 2]}}"},
    {".box.center", "{box: {center: [0, 0, 0], size: [1, 1, 1]}}",
     "{box: {center: [0, 1, 0], size: [1, 1, 1]}}"},
    {".box.size", "{box: {center: [0, 0, 0], size: [1, 1, 1]}}",
     "{box: {center: [0, 0, 0], size: [1, 1, 2]}}"},
    {".below.x", "{below: {x: 0}}", "{below: {x: 1}}"},
    {".below.y", "{below: {y: 0}}", "{below: {x: 0}}"},
    {".below.z", "{below: {z: 0}}", "{above: {z: 0}}"},
    {".above.x", "{above: {x: 0}}", "{above: {x: 1}}"},
    {".above.y", "{above: {y: 0}}", "{above: {z: 0}}"},
    {".above.z", "{above: {z: 0}}", "{above: {z: 1}}"},
    {".all", "{all: {}}", "{below: {x: 0}}"},
};

static const char *const SELECTOR_PLACES[][2] = {
    {"body.fixed[]", "body.fixed.0="},
    {"body.touchable[]", "body.touchable.0="},
    {"body.patches.*", "body.patches.pole="},
    {"body.patches.*.any[]",
     "body.patches={pole: {below: {z: 0}}, other: {any: [{above: {y: 0}}, %s]}}"},
};

/// Not built yet, or with one value only.
static const char *const EXEMPT[] = {"palpate", "method.integration"};

static int differ(const char *a, const char *b) {
    const char *set_a[] = {a, NULL};
    const char *set_b[] = {b, NULL};
    pal_scene *one = load(EXAMPLE, set_a);
    pal_scene *two = load(EXAMPLE, set_b);
    // a replayed path lies in a directory of its own per load: compare what it ends with
    for (int i = 0; i < one->runtime.tool_count; i++) {
        (void)memmove(one->runtime.tools[i].device.path, "x", 2);
    }
    for (int i = 0; i < two->runtime.tool_count; i++) {
        (void)memmove(two->runtime.tools[i].device.path, "x", 2);
    }
    int differs = strcmp(one->canonical, two->canonical) != 0;
    for (int i = 0; i < one->runtime.tool_count && i < two->runtime.tool_count; i++) {
        const pal_tool_def *t = &one->runtime.tools[i];
        const pal_tool_def *u = &two->runtime.tools[i];
        differs |=
            strcmp(t->name, u->name) != 0 || t->shape != u->shape || t->radius != u->radius ||
            t->length != u->length || t->device.kind != u->device.kind ||
            memcmp(&t->limits, &u->limits, sizeof t->limits) != 0 || t->friction != u->friction ||
            t->coupling_stiffness != u->coupling_stiffness ||
            t->coupling_damping != u->coupling_damping ||
            memcmp(&t->spec, &u->spec, sizeof t->spec) != 0 ||
            memcmp(t->start, u->start, sizeof t->start) != 0 ||
            memcmp(t->axis, u->axis, sizeof t->axis) != 0 ||
            memcmp(&t->device.stroke, &u->device.stroke, sizeof t->device.stroke) != 0 ||
            memcmp(&t->device.simulated, &u->device.simulated, sizeof t->device.simulated) != 0;
    }
    differs |=
        one->runtime.servo_rate != two->runtime.servo_rate ||
        one->runtime.render_rate != two->runtime.render_rate ||
        one->runtime.field_by != two->runtime.field_by ||
        one->runtime.max_contacts != two->runtime.max_contacts ||
        memcmp(&one->runtime.watchdog, &two->runtime.watchdog, sizeof one->runtime.watchdog) != 0 ||
        one->runtime.contact_law != two->runtime.contact_law ||
        one->runtime.contact_points != two->runtime.contact_points;
    pal_scene_free(one);
    pal_scene_free(two);
    return differs;
}

static int has_children(const pal_scene_key *keys, int count, int row) {
    size_t n = strlen(keys[row].path);
    return n == 0 || (row + 1 < count && strncmp(keys[row + 1].path, keys[row].path, n) == 0 &&
                      strchr(".[", keys[row + 1].path[n]) != NULL);
}

static void no_key_of_the_schema_is_ignored(void **state) {
    (void)state;
    const pal_scene_key *keys;
    int count = pal_scene_schema(&keys);
    int tested = 0;
    for (int i = 0; i < count; i++) {
        int done = has_children(keys, count, i);
        for (size_t k = 0; k < sizeof EXEMPT / sizeof EXEMPT[0]; k++) {
            done |= strcmp(keys[i].path, EXEMPT[k]) == 0;
        }
        for (size_t k = 0; k < sizeof PAIRS / sizeof PAIRS[0] && !done; k++) {
            if (strcmp(keys[i].path, PAIRS[k].path) == 0) {
                if (!differ(PAIRS[k].a, PAIRS[k].b)) {
                    fail_msg("%s and %s make the same scene", PAIRS[k].a, PAIRS[k].b);
                }
                done = 1;
                tested++;
            }
        }
        for (size_t p = 0; p < 4 && !done; p++) {
            size_t n = strlen(SELECTOR_PLACES[p][0]);
            if (strncmp(keys[i].path, SELECTOR_PLACES[p][0], n) != 0) {
                continue;
            }
            for (size_t k = 0; k < sizeof SELECTOR_PAIRS / sizeof SELECTOR_PAIRS[0]; k++) {
                const pair *s = &SELECTOR_PAIRS[k];
                char a[200];
                char b[200];
                if (strcmp(keys[i].path + n, s->path) != 0) {
                    continue;
                }
                const char *place = SELECTOR_PLACES[p][1];
                const char *hole = strstr(place, "%s");
                int head = hole != NULL ? (int)(hole - place) : (int)strlen(place);
                const char *tail = hole != NULL ? hole + 2 : "";
                (void)snprintf(a, sizeof a, "%.*s%s%s", head, place, s->a, tail);
                (void)snprintf(b, sizeof b, "%.*s%s%s", head, place, s->b, tail);
                if (!differ(a, b)) {
                    fail_msg("%s and %s make the same scene", a, b);
                }
                done = 1;
                tested++;
            }
        }
        if (!done) {
            fail_msg("no test sets %s", keys[i].path);
        }
        assert_true(keys[i].path[0] == 0 || keys[i].help[0] != 0);
    }
    assert_int_equal(tested, (int)(sizeof PAIRS / sizeof PAIRS[0]) + 4 * 13);
}

// ---- Numbers, words, --set
// --------------------------------------------------------------------------

static void numbers_are_those_of_yaml_1_2(void **state) {
    (void)state;
    static const struct {
        const char *set;
        double value;
    } cases[] = {{"body.material.young=10e3", 1e4},     {"body.material.young=+5.", 5},
                 {"body.material.young=.5", 0.5},       {"body.material.young=1E+3", 1e3},
                 {"body.material.young=007", 7},        {"body.material.young=1e-3", 1e-3},
                 {"body.material.young=1.5e15", 1.5e15}};
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        const char *set[] = {cases[i].set, NULL};
        pal_scene *s = load(MINIMAL, set);
        assert_true(s->young == cases[i].value);
        pal_scene_free(s);
    }
}

static void a_locale_with_decimal_commas_changes_nothing(void **state) {
    (void)state;
    char *before = strdup(setlocale(LC_NUMERIC, NULL));
    static const char *const names[] = {"de_DE.UTF-8", "de_DE.utf8", "fr_FR.UTF-8", "de_DE"};
    int found = 0;
    for (size_t i = 0; i < sizeof names / sizeof names[0] && !found; i++) {
        found = setlocale(LC_NUMERIC, names[i]) != NULL;
    }
    if (!found) {
        free(before);
        print_message("no locale with decimal commas is installed\n");
        skip();
    }
    pal_scene *s = load(MINIMAL, NULL);
    double spacing = s->spacing;
    int has_comma = strchr(s->canonical, ',') != NULL;
    pal_scene_free(s);
    assert_non_null(setlocale(LC_NUMERIC, before));
    free(before);
    assert_true(spacing == 0.01);
    assert_false(has_comma);
}

static void set_makes_missing_mappings_and_appends(void **state) {
    (void)state;
    const char *set[] = {"tools.0.name=a",
                         "tools.0.limits.force=1",
                         "tools.1={name: b}",
                         "tools.b.limits.force=2",
                         "body.refine.0={center: [0, 0, 0], radius: 0.01, spacing: 0.005}",
                         "body.probes.p=[0, 0, 0]",
                         "body.patches.q.any.0={above: {z: 0.04}}",
                         "body.patches.q.any.1={above: {x: 0.04}}",
                         "store.precision=half",
                         "body.spacing=0.02",
                         "body.spacing=0.015",
                         NULL};
    pal_scene *s = load(MINIMAL, set);
    assert_int_equal(s->runtime.tool_count, 2);
    assert_string_equal(s->runtime.tools[0].name, "a");
    assert_string_equal(s->runtime.tools[1].name, "b");
    assert_true(s->runtime.tools[0].limits.force == 1 && s->runtime.tools[1].limits.force == 2);
    assert_true(s->runtime.tools[0].axis[2] == -1); // defaults of a tool made by --set
    assert_int_equal(s->refine_count, 1);
    assert_int_equal(s->probe_count, 1);
    assert_int_equal(s->patch[0].where.count, 2);
    assert_int_equal(s->precision, PALPATE_PRECISION_HALF);
    assert_true(s->spacing == 0.015); // the later one wins
    pal_scene_free(s);
}

static void set_on_an_aliased_mapping_changes_one_place(void **state) {
    (void)state;
    static const char *const text = "palpate: 1\n"
                                    "body:\n"
                                    "  geometry: {sphere: {radius: 0.05}}\n"
                                    "  spacing: 0.01\n"
                                    "  material: {young: 1000, poisson: 0.3}\n"
                                    "  fixed: &low [{below: {z: -0.04}}]\n"
                                    "  touchable: *low\n";
    const char *set[] = {"body.touchable.0.below.z=0.01", NULL};
    pal_scene *s = load(text, set);
    assert_true(s->fixed.item[0].value == -0.04 && s->touchable.item[0].value == 0.01);
    pal_scene_free(s);
}

static void paths_are_relative_to_the_scene_and_on_the_command_line_to_the_directory(void **state) {
    (void)state;
    pal_scene *s = NULL;
    char directory[64];
    char path[1024];
    pal_error error = {0};
    const char *in_file = "palpate: 1\nbody:\n  geometry: {file: surface.obj}\n  spacing: 0.01\n"
                          "  material: {young: 1, poisson: 0}\n  fixed: [all]\n";
    assert_int_equal(loading(in_file, NULL, &s, directory, &error), PALPATE_OK);
    (void)snprintf(path, sizeof path, "%s/surface.obj", directory);
    assert_string_equal(s->geometry.path, path);
    pal_scene_free(s);
    const char *set[] = {"body.geometry={file: Makefile}",
                         NULL}; // tests run in the source directory
    char cwd[900];
    assert_non_null(getcwd(cwd, sizeof cwd));
    if (access("Makefile", R_OK) == 0) {
        s = load(MINIMAL, set);
        (void)snprintf(path, sizeof path, "%s/Makefile", cwd);
        assert_string_equal(s->geometry.path, path);
        pal_scene_free(s);
    }
}

static void words_and_single_items_stand_for_longer_forms(void **state) {
    (void)state;
    const char *words[] = {"body.touchable=all", "body.fixed={below: {z: 0}}",
                           "body.patches={p: all, q: {all: true}, r: {all: }}",
                           "tools=[{shape: point}]", NULL};
    const char *forms[] = {"body.touchable=[{all: {}}]", "body.fixed=[{below: {z: 0}}]",
                           "body.patches={p: {all: {}}, q: {all: {}}, r: {all: {}}}",
                           "tools=[{shape: {point: {}}}]", NULL};
    pal_scene *a = load(MINIMAL, words);
    pal_scene *b = load(MINIMAL, forms);
    // `p: all` has no room for a rim spacing and no rim either; the others say auto
    assert_int_equal(a->patch_count, 3);
    for (int32_t i = 0; i < 3; i++) {
        assert_int_equal(a->patch[i].where.item[0].kind, PALPATE_SELECT_ALL);
        a->patch[i].rim_spacing = b->patch[i].rim_spacing;
    }
    assert_int_equal(a->touchable.item[0].kind, b->touchable.item[0].kind);
    assert_int_equal(a->fixed.item[0].kind, PALPATE_SELECT_BELOW);
    assert_int_equal(a->runtime.tools[0].shape, b->runtime.tools[0].shape);
    pal_scene_free(a);
    pal_scene_free(b);
}

static void an_explicit_null_device_is_not_an_absent_one(void **state) {
    (void)state;
    const char *set[] = {"tools=[{name: a, device: null}, {name: b}]", NULL};
    pal_scene *s = load(MINIMAL, set);
    assert_int_equal(s->runtime.tools[0].device.kind, PALPATE_DEVICE_NULL);
    assert_int_equal(s->runtime.tools[1].device.kind, PALPATE_DEVICE_NONE);
    pal_scene_free(s);
}

static void warnings_are_located(void **state) {
    (void)state;
    const char *set[] = {"body.refine=[{center: [0, 0, 0], radius: 0.01, spacing: 0.02}]",
                         "tools=[{device: {replay: nowhere.csv}}]", NULL};
    pal_scene *s = load(MINIMAL, set);
    assert_int_equal(pal_scene_warning_count(s), 2);
    assert_non_null(strstr(pal_scene_warning(s, 0), "body.refine[0]: spacing 0.02 m is coarser"));
    assert_non_null(strstr(pal_scene_warning(s, 1), "tools[0].device.replay: "));
    assert_non_null(strstr(pal_scene_warning(s, 1), "nowhere.csv cannot be read"));
    assert_null(pal_scene_warning(s, 2));
    assert_int_equal(pal_scene_warn(s, NULL, "all of it: %d", 3), PALPATE_OK);
    assert_non_null(strstr(pal_scene_warning(s, 2), "scene.yaml: all of it: 3"));
    assert_null(pal_scene_warning(s, 3));
    assert_null(pal_scene_warning(s, -1));
    pal_scene_free(s);
}

// ---- Hashes
// -------------------------------------------------------------------------------------------

static void hash_of(const char *text, const char *set, char hex[65]) {
    const char *sets[] = {set, NULL};
    pal_scene *s = load(text, set != NULL ? sets : NULL);
    pal_error error = {0};
    if (pal_scene_hash(s, hex, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(strlen(hex), 64);
    pal_scene_free(s);
}

static void the_hash_follows_the_physics_and_nothing_else(void **state) {
    (void)state;
    char base[65];
    char hex[65];
    hash_of(EXAMPLE, NULL, base);
    static const char *const same[] = {
        "body.material.young=10000",
        "body.material.young=1.0e+4",
        "body.grading=0.45",
        "tools.0.limits.force=1",
        "tools=[]",
        "servo.rate=500",
        "render.rate=10",
        "max_contacts=8",
        "method.volumetric=patch",
        "body.geometry={hemisphere: {radius: 5e-2}}",
        "body.patches.pole.rim_spacing=auto",
        "body.fixed.0.below.z=-0.0",
    };
    for (size_t i = 0; i < sizeof same / sizeof same[0]; i++) {
        hash_of(EXAMPLE, same[i], hex);
        if (strcmp(hex, base) != 0) {
            fail_msg("%s changes the hash", same[i]);
        }
    }
    static const char *const other[] = {
        "body.material.young=10001",
        "body.material.poisson=0.46",
        "body.spacing=0.0071",
        "body.grading=0.5",
        "body.refine.0.spacing=0.002",
        "body.refine=[]",
        "body.fixed.0.below.z=0.001",
        "body.touchable=[all]",
        "body.patches={other: all}",
        "body.probes={}",
        "method.kind=galerkin",
        "repair=none",
        "store.precision=double",
        "store.displacement=all",
        "body.probes.mid=[0, 0, 0.0250001]",
        "body.geometry={sphere: {radius: 0.05}}",
    };
    for (size_t i = 0; i < sizeof other / sizeof other[0]; i++) {
        const char *set[] = {other[i], i == 8 ? "body.refine=[]" : NULL, NULL};
        pal_scene *s = load(EXAMPLE, set);
        assert_int_equal(pal_scene_hash(s, hex, NULL), PALPATE_OK);
        pal_scene_free(s);
        if (strcmp(hex, base) == 0) {
            fail_msg("%s does not change the hash", other[i]);
        }
    }
}

static void put_file(const char *path, const char *text) {
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(text, 1, strlen(text), f), strlen(text));
    assert_int_equal(fclose(f), 0);
}

static void the_hash_covers_the_surface_files_content_not_its_path(void **state) {
    (void)state;
    char directory[] = "/tmp/palpate-hash-XXXXXX";
    assert_non_null(mkdtemp(directory));
    char path[2][64];
    char hex[4][65];
    for (int i = 0; i < 4; i++) { // a: text 1; b: text 1; b: text 2; b: missing
        char set[200];
        (void)snprintf(path[i > 0], sizeof path[0], "%s/%s.obj", directory, i > 0 ? "b" : "a");
        put_file(path[i > 0], i < 2 ? "v 0 0 0\n" : "v 0 0 1\n");
        (void)snprintf(set, sizeof set, "body.geometry={file: %s}", path[i > 0]);
        if (i < 3) {
            hash_of(MINIMAL, set, hex[i]);
            continue;
        }
        const char *sets[] = {set, NULL};
        pal_scene *s = load(MINIMAL, sets);
        pal_error error = {0};
        assert_int_equal(unlink(path[1]), 0); // between loading and hashing
        assert_int_equal(pal_scene_hash(s, hex[3], &error), PALPATE_ERROR_IO);
        assert_non_null(strstr(error.message, "b.obj cannot be read"));
        pal_scene_free(s);
    }
    assert_string_equal(hex[0], hex[1]);
    assert_string_not_equal(hex[1], hex[2]);
    assert_int_equal(unlink(path[0]), 0);
    assert_int_equal(rmdir(directory), 0);
    assert_int_equal(pal_scene_hash(NULL, hex[0], NULL), PALPATE_ERROR_ARGUMENT);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_designs_example_fills_every_field),
        cmocka_unit_test(a_minimal_scene_gets_the_documented_defaults),
        cmocka_unit_test(no_key_of_the_schema_is_ignored),
        cmocka_unit_test(numbers_are_those_of_yaml_1_2),
        cmocka_unit_test(a_locale_with_decimal_commas_changes_nothing),
        cmocka_unit_test(set_makes_missing_mappings_and_appends),
        cmocka_unit_test(set_on_an_aliased_mapping_changes_one_place),
        cmocka_unit_test(paths_are_relative_to_the_scene_and_on_the_command_line_to_the_directory),
        cmocka_unit_test(words_and_single_items_stand_for_longer_forms),
        cmocka_unit_test(an_explicit_null_device_is_not_an_absent_one),
        cmocka_unit_test(warnings_are_located),
        cmocka_unit_test(the_hash_follows_the_physics_and_nothing_else),
        cmocka_unit_test(the_hash_covers_the_surface_files_content_not_its_path),
    };
    return cmocka_run_group_tests_name("scene", tests, NULL, NULL);
}
