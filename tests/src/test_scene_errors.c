/// Scenes that must be refused: each with its place, key, what was found, what is allowed, a
/// remedy.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/scene/scene.h"
#include "tests/support/scene_text.h"

/// A good scene; each case replaces one of its lines.
static const char *const LINES[] = {
    "palpate: 1",
    "body:",
    "  geometry: {hemisphere: {radius: 0.05}}",
    "  spacing: 0.007",
    "  material: {young: 10e3, poisson: 0.45}",
    "  fixed: [{below: {z: 0}}]",
    "  patches: {pole: {ball: {center: [0, 0, 0.05], radius: 0.01}}}",
    "  probes: {mid: [0, 0, 0.025]}",
    "method: {kind: cell}",
    "store: {precision: single}",
    "tools: [{name: probe, shape: {sphere: {radius: 0.004}}, start: [0, 0, 0.054]}]",
    "servo: {rate: 1000}",
};
enum { LINE_COUNT = sizeof LINES / sizeof LINES[0] };

typedef struct bad {
    int line;           ///< replaced, 1-based
    const char *text;   ///< by this
    const char *where;  ///< "line:column: key: found ..." must be in the message
    const char *advice; ///< and so must this
} bad;

static const bad CASES[] = {
    // YAML itself
    {4, "  spacing: [0.007", "5:", "not valid YAML"},
    {4, "\tspacing: 0.007", "4:1: not valid YAML", "found a tab: indent with spaces"},
    {4, "  spacing: 0.007: 3", "4:17: not valid YAML", "check indentation"},
    {4, "  spacing: \"0.007", "4:12: not valid YAML", "check"},
    {4, "  spacing: *h", "4:12: not valid YAML: found undefined alias", "check"},
    {4, "  spacing: !metres 0.007", "4:12: found tag !metres", "remove it"},
    {12, "servo: {rate: 1000}\n---\npalpate: 1", "14:1: found a second document",
     "remove the '---'"},
    {4, "  spacing: 0.007\n  spacing: 0.006", "5:3: spacing: found a second time (first at line 4",
     "remove one"},
    {4, "  ? [a, b]\n  : 1\n  spacing: 0.007", "4:5: found a key that is a list", "a name"},
    {4, "  spacing: 0.007 # \x01", "4:20: found control character 0x01", "remove it"},
    {4, "  spacing: 0.007 # \xff", "4:20: found byte 0xFF", "save the file as UTF-8"},
    {4, "  spacing: 0.007 # \xc0\xaf", "4:20: found byte 0xC0", "UTF-8"},
    {4, "  spacing: \"\\0\"", "4:12: found a zero byte", "remove it"},
    {4, "  spacing: &a [*a]", "found values nested deeper than 32", "alias inside itself"},
    {4, "  <<: {spacing: 0.007}", "4:3: body.<<: found an unknown key",
     "allowed: geometry, spacing"},

    // keys
    {4, "  spaceing: 0.007", "4:3: body.spaceing: found an unknown key", "did you mean spacing?"},
    {4, "  young: 0.007", "4:3: body.young: found an unknown key",
     "did you mean body.material.young?"},
    {4, "  store: {displacement: none}", "4:3: body.store: found an unknown key",
     "did you mean store at the top level?"},
    {4, "  xyzzy: 0.007",
     "4:3: body.xyzzy: found an unknown key; allowed: geometry, spacing, grading", "remove it"},
    {9, "methods: {kind: cell}", "9:1: methods: found an unknown key", "did you mean method?"},
    {9, "\"\": 3", "9:1: \"\": found an unknown key", "remove it"},
    {9, "body.x: 3", "9:1: body.x: found an unknown key", "did you mean body?"},
    {4, "", "3:3: body.spacing: found nothing, but it is required", "add spacing: node spacing"},
    {4, "  spacing:", "4:3: body.spacing: found nothing, but it is required", "a number in m"},
    {1, "", "2:1: palpate: found nothing, but it is required", "add palpate"},
    {1, "palpate: 2", "1:10: palpate: found 2; allowed: a whole number, 1", "newer Palpate"},
    {5, "  material: {young: 10e3}", "5:13: body.material.poisson: found nothing",
     "Poisson's ratio"},
    {6, "", "3:3: body.fixed: found nothing, but it is required", "held at u = 0"},
    {5, "  material: {}", "5:13: body.material.young: found nothing", "add young"},
    {5, "  material:", "5:3: body.material: found nothing, but it is required", "a mapping"},

    // types
    {4, "  spacing: 0.5x", "4:12: body.spacing: found 0.5x; allowed: a number in m, more than 0",
     "write the digits alone"},
    {4, "  spacing: .nan", "4:12: body.spacing: found .nan", "write it like"},
    {4, "  spacing: nan", "4:12: body.spacing: found nan", "write it like"},
    {4, "  spacing: .inf", "4:12: body.spacing: found .inf", "write it like"},
    {4, "  spacing: 1e999", "4:12: body.spacing: found 1e999", "does not fit"},
    {4, "  spacing: 0x10", "4:12: body.spacing: found 0x10", "digits alone"},
    {4, "  spacing: 7 mm", "4:12: body.spacing: found 7 mm", "units are SI"},
    {4, "  spacing: 0,007", "4:12: body.spacing: found 0,007", "like 0.007"},
    {4, "  spacing: '0.007'", "4:12: body.spacing: found \"0.007\"", "remove the quotes"},
    {4, "  spacing: [0.007]", "4:12: body.spacing: found a list of 1", "a number in m"},
    {4, "  spacing: {m: 0.007}", "4:12: body.spacing: found a mapping", "a number in m"},
    {4, "  spacing: 1e", "4:12: body.spacing: found 1e", "like"},
    {4, "  spacing: +", "4:12: body.spacing: found +", "like"},
    {5, "  material: soft", "5:13: body.material: found soft; allowed: a mapping", "a mapping"},
    {3, "  geometry: 3",
     "3:13: body.geometry: found 3; allowed: one of hemisphere, box, sphere, file", "one of"},
    {6, "  fixed: 3", "6:10: body.fixed[0]: found 3; allowed: one of ball, box", "below"},
    {6, "  fixed: [3]", "6:11: body.fixed[0]: found 3", "one of ball, box"},
    {6, "  fixed: [~]", "6:11: body.fixed[0]: found nothing", "write it or remove it"},
    {8, "  probes: [0, 0, 1]",
     "8:11: body.probes: found a list of 3; allowed: a mapping, name: [x, y, z]", "name"},
    {8, "  probes: {mid: [0, 0]}", "8:17: body.probes.mid: found a list of 2; allowed: [x, y, z]",
     "three numbers"},
    {8, "  probes: {mid: [0, a, 0]}", "8:21: body.probes.mid[1]: found a; allowed: a number in m",
     "write it like"},
    {8, "  probes: {mid: }", "8:17: body.probes.mid: found nothing", "write it or remove it"},
    {8, "  probes: {a.b: [0, 0, 0]}", "8:12: body.probes: found a.b; allowed: names", "rename it"},
    {8, "  probes: {'': [0, 0, 0]}", "8:12: body.probes: found \"\"; allowed: names", "rename it"},
    {9, "method: {kind: sell}", "9:16: method.kind: found sell; allowed: point | cell | galerkin",
     "did you mean cell?"},
    {9, "method: {kind: 7}", "9:16: method.kind: found 7; allowed: point | cell | galerkin",
     "allowed"},
    {9, "method: {kind: point, fictitious: 2}",
     "9:35: method.fictitious: found 2; allowed: true | false", "true"},
    {9, "method: {kind: point, neighbours: 24.5}",
     "9:35: method.neighbours: found 24.5; allowed: a whole number, 4 to 400", "whole"},

    // values
    {4, "  spacing: 0", "4:12: body.spacing: found 0; allowed: a number in m, more than 0",
     "allowed"},
    {4, "  spacing: -0.007", "4:12: body.spacing: found -0.007", "more than 0"},
    {4, "  spacing: 7", "4:12: body.spacing: found 7 m for a body of 0.1 m; allowed: at most half",
     "lengths are in metres"},
    {4, "  spacing: 0.00007", "4:12: body.spacing: found 7e-05 m", "at most 200000 nodes"},
    {5, "  material: {young: 10e3, poisson: 0.5}",
     "5:36: body.material.poisson: found 0.5; allowed: a number, "
     "more than -1, less than 0.5",
     "use 0.49 to 0.499 with method: {kind: cell}"},
    {5, "  material: {young: 10e3, poisson: -1}", "5:36: body.material.poisson: found -1",
     "more than -1"},
    {5, "  material: {young: 0, poisson: 0.3}",
     "5:21: body.material.young: found 0; allowed: a number in Pa", "more than 0"},
    {5, "  material: {young: -5, poisson: 0.3}", "5:21: body.material.young: found -5",
     "more than 0"},
    {5, "  material: {young: 5, poisson: 0.3, density: 0}", "5:47: body.material.density: found 0",
     "kg/m^3"},
    {3, "  geometry: {hemisphere: {radius: 0}}", "3:35: body.geometry.hemisphere.radius: found 0",
     "more than 0"},
    {3, "  geometry: {hemisphere: {}}", "3:26: body.geometry.hemisphere.radius: found nothing",
     "add radius"},
    {3, "  geometry: {}", "3:13: body.geometry: found nothing; allowed: one of hemisphere",
     "add one"},
    {3, "  geometry: {sphere: {radius: 1}, box: {size: [1, 1, 1]}}",
     "3:35: body.geometry: found sphere and box; allowed: one of", "keep one"},
    {3, "  geometry: {box: {size: [1, 0, 1]}}", "3:30: body.geometry.box.size[1]: found 0",
     "more than 0"},
    {3, "  geometry: {sphere: {radius: 1}, scale: 2}", "3:35: body.geometry.scale: found a scale",
     "with file only"},
    {3, "  geometry: {file: none.obj}", "3:20: body.geometry.file: found none.obj, but /tmp/",
     "relative to the scene file"},
    {3, "  geometry: {file: [a]}", "3:20: body.geometry.file: found a list of 1",
     "STL, OBJ or PLY"},
    {6, "  fixed: []", "6:10: body.fixed: found an empty list", "hold the body somewhere"},
    {6, "  fixed: [{below: {w: 0}}]", "6:20: body.fixed[0].below.w: found an unknown key",
     "x, y, z"},
    {6, "  fixed: [{below: {x: 0, z: 0}}]", "6:26: body.fixed[0].below: found x and z", "keep one"},
    {6, "  fixed: [{below: {z: 0}, above: {z: 1}}]", "6:27: body.fixed[0]: found below and above",
     "keep one"},
    {6, "  fixed: [{ball: {radius: 1}}]", "6:18: body.fixed[0].ball.center: found nothing",
     "add center"},
    {6, "  fixed: [{ball: {center: [0, 0, 0], radius: -1}}]",
     "6:46: body.fixed[0].ball.radius: found -1", "more than 0"},
    {6, "  fixed: [{box: {min: [0, 0, 1], max: [1, 1, 0]}}]",
     "6:23: body.fixed[0].box: found min 1 above max 0", "exchange"},
    {6, "  fixed: [{box: {min: [0, 0, 1]}}]", "6:17: body.fixed[0].box: found an incomplete",
     "min and max, or center and size"},
    {6, "  fixed: [{box: {}}]", "6:17: body.fixed[0].box: found nothing", "min and max"},
    {6, "  fixed: [{below: {z: 0}}]\n  touchable: []\n  patches: {}\n  grading: 0.4",
     "found a second time", "remove one"},
    {7, "  touchable: []", "7:14: body.touchable: found an empty list and no patches", "touch all"},
    {7, "  patches: {pole: {rim_spacing: auto}}", "7:19: body.patches.pole: found none of them",
     "ball"},
    {7, "  patches: {pole: {ball: {center: [0, 0, 0.05], radius: 0.01}, rim_spacing: fine}}",
     "7:77: body.patches.pole.rim_spacing: found fine; allowed: a number in m, more than 0, or "
     "auto, or none",
     "like"},
    {7, "  patches: {pole: {ball: {center: [0, 0, 0.05], radius: 0.01}}, pole: {all: }}",
     "7:65: pole: found a second time", "remove one"},
    {7, "  refine: [{rim: pole, spacing: 0.001}]", "7:18: body.refine[0].rim: found pole",
     "a name from body.patches"},
    {8, "  refine: [{rim: pol, spacing: 0.001}]",
     "8:18: body.refine[0].rim: found pol; allowed: pole", "name a patch"},
    {8, "  refine: [{spacing: 0.001}]", "8:12: body.refine[0]: found only a spacing", "or rim"},
    {8, "  refine: [{center: [0, 0, 0], spacing: 0.001}]",
     "8:12: body.refine[0]: found center without radius", "write one of the two"},
    {8, "  refine: [{center: [0, 0, 0], radius: 1, rim: pole, spacing: 0.001}]",
     "8:12: body.refine[0]: found rim and a ball", "write one of the two"},
    {8, "  refine: [{center: [0, 0, 0], radius: 1}]", "8:12: body.refine[0].spacing: found nothing",
     "add"},
    {8, "  grading: 0", "8:12: body.grading: found 0", "more than 0, up to 2"},
    {9, "method: {kind: cell, fictitious: true}",
     "9:22: method.fictitious: found an option that kind: cell", "with kind: point"},
    {9, "method: {kind: point, volumetric: nodal}",
     "9:23: method.volumetric: found an option that kind: point", "kind: galerkin"},
    {9, "method: {basis: quadratic}",
     "9:10: method.basis: found an option that kind: cell with form: symmetric does not have",
     "with kind: point, or kind: cell with form: collocated"},
    {9, "method: {volumetric: mixed}",
     "9:22: method.volumetric: found mixed; allowed: plain, nodal or patch",
     "leave it out, or kind: galerkin"},
    {9, "method: {form: collocated, stabilization: 2}",
     "9:43: method.stabilization: found 2; allowed: 0 to 1 for form: collocated", "blended in"},
    {9, "method: {stabilization: 0.1, volumetric: plain}",
     "9:10: method.stabilization: found a factor of nothing; allowed: with volumetric: patch",
     "remove"},
    {9, "method: {kind: galerkin, stabilization: 1, volumetric: nodal}",
     "9:26: method.stabilization: found a factor of nothing; allowed: with volumetric: mixed",
     "remove"},
    {10, "store: {tolerance: 0.6}",
     "10:20: store.tolerance: found 0.6; allowed: a number, 0 to 0.5", "0.5"},
    {10, "store: {displacement: some}",
     "10:23: store.displacement: found some; allowed: none | surface | all", "all"},
    {11, "tools: [{shape: ball}]",
     "11:17: tools[0].shape: found ball; allowed: one of point, sphere, capsule", "one of"},
    {11, "tools: [{shape: {sphere: {radius: 0.1, length: 1}}}]",
     "11:40: tools[0].shape.sphere.length: found an unknown key", "capsule.length"},
    {11, "tools: [{axis: [0, 0, 0]}]", "11:16: tools[0].axis: found a direction of length 0",
     "[0, 0, -1]"},
    {11, "tools: [{name: a}, {name: a}]", "11:27: tools[1].name: found a, the name of tools[0]",
     "rename"},
    {11, "tools: [{name: a b}]", "11:16: tools[0].name: found a b; allowed: a name", "rename"},
    {11, "tools: [{}, {}, {}, {}, {}, {}, {}, {}, {}]", "11:8: tools: found a list of 9",
     "at most 8"},
    {11, "tools: [{limits: {force: 0}}]",
     "11:26: tools[0].limits.force: found 0; allowed: a number in N", "more than 0, up to 1000"},
    {11, "tools: [{limits: {force: 2000}}]",
     "11:26: tools[0].limits.force: found 2000; allowed: a number in N", "auto, or none"},
    {11, "tools: [{device_spec: {max_force: 0}}]",
     "11:35: tools[0].device_spec.max_force: found 0; allowed: a number in N", "more than 0"},
    {12, "watchdog: {stale: none}", "12:19: watchdog.stale: found none; allowed: a number in s",
     "0.001 to 1"},
    {12, "watchdog: {latch: 0.05}",
     "12:11: watchdog.latch: found a time shorter than stale or stall", "raise"},
    {11, "tools: [{device: {}}]", "11:18: tools[0].device: found nothing; allowed: one of replay",
     "add one"},
    {11, "tools: [{device: {scripted: {depth: 0.01}}}]",
     "11:29: tools[0].device.scripted: found a scripted device, but no start", "start: [x, y, z]"},
    {11, "tools: [{device: {simulated: {}}}]",
     "11:30: tools[0].device.simulated: found a simulated device, but no start",
     "start: [x, y, z]"},
    {11, "tools: [{start: [0, 0, 1], device: {simulated: {mass: 0}}}]",
     "11:55: tools[0].device.simulated.mass: found 0; allowed: a number in kg, 0.001 to 100", ""},
    {11, "tools: [{start: [0, 0, 1], device: {simulated: {hand: {grip: tight}}}}]",
     "11:62: tools[0].device.simulated.hand.grip: found tight; allowed: firm | light | none", ""},
    {11, "tools: [{start: [0, 0, 1], device: {simulated: {hand: {grip: none, mass: 1}}}}]",
     "11:74: tools[0].device.simulated.hand.mass: found a hand's figure with grip: none",
     "grip: firm"},
    {11, "tools: [{start: [0, 0, 1], device: {simulated: {mass: 0.001, damping: 1e4}}}]",
     "11:48: tools[0].device.simulated: found damping and stiffness over mass of 1e+07 1/s",
     "more mass"},
    {11, "tools: [{start: [0, 0, 1], device: {simulated: {motion: {direction: [0, 0, 2]}}}}]",
     "11:69: tools[0].device.simulated.motion.direction: found a direction of length 0 or along",
     "choose another"},
    {11, "tools: [{start: [0, 0, 1], device: {scripted: {depth: 1, direction: [0, 0, 2]}}}]",
     "11:69: tools[0].device.scripted.direction: found a direction of length 0 or along",
     "another"},
    {11, "tools: {name: a}", "11:8: tools: found a mapping; allowed: a list of mappings",
     "begin each item"},
    {12, "servo: {rate: 1}", "12:15: servo.rate: found 1; allowed: a number in Hz, 10 to 20000",
     "10"},
    {12, "max_contacts: 0", "12:15: max_contacts: found 0; allowed: a whole number, 1 to 1024",
     "1"},
    {12, "certify: maybe", "12:10: certify: found maybe; allowed: strict | warn", "warn"},
};

/// Features that are not built yet: refused as such.
static const bad NOT_BUILT[] = {
    {9, "method: {kind: galerkin, integration: 4}", "9:39: method.integration: found 4",
     "not built yet"},
};

static void compose(char *out, size_t size, int line, const char *text) {
    size_t n = 0;
    for (int i = 1; i <= LINE_COUNT; i++) {
        n += (size_t)snprintf(out + n, size - n, "%s\n", i == line ? text : LINES[i - 1]);
        assert_true(n < size);
    }
}

static void check(const bad *b, size_t count, pal_status expected) {
    int bad_count = 0; // all are shown before the test fails
    for (size_t i = 0; i < count; i++) {
        char text[4096];
        pal_scene *scene = (pal_scene *)&text; // must be set to NULL on errors
        pal_error error = {0};
        compose(text, sizeof text, b[i].line, b[i].text);
        pal_status status = test_scene_load(text, NULL, &scene, &error);
        const char *at = strstr(error.message, "scene.yaml:");
        if (status != expected || error.status != expected || scene != NULL || at == NULL ||
            strstr(at, b[i].where) == NULL || strstr(at, b[i].advice) == NULL) {
            bad_count++;
            print_error("line %d: %s\n  expected: %s ... %s\n  found:    %s: %s\n", b[i].line,
                        b[i].text, b[i].where, b[i].advice, pal_status_name(status), error.message);
        }
    }
    assert_int_equal(bad_count, 0);
}

static void every_bad_scene_is_located(void **state) {
    (void)state;
    assert_true(sizeof CASES / sizeof CASES[0] >= 60);
    check(CASES, sizeof CASES / sizeof CASES[0], PALPATE_ERROR_SCENE);
}

static void the_unchanged_scene_loads(void **state) {
    (void)state;
    char text[4096];
    pal_scene *scene;
    pal_error error = {0};
    compose(text, sizeof text, 0, "");
    if (test_scene_load(text, NULL, &scene, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(pal_scene_warning_count(scene), 0);
    pal_scene_free(scene);
}

static void unbuilt_features_are_refused_as_such(void **state) {
    (void)state;
    check(NOT_BUILT, sizeof NOT_BUILT / sizeof NOT_BUILT[0], PALPATE_ERROR_UNSUPPORTED);
}

static void bad_overrides_name_themselves(void **state) {
    (void)state;
    static const struct {
        const char *set[3];
        const char *message; ///< its beginning
        const char *advice;
    } cases[] = {
        {{"body.material.poisson=0.6"},
         "--set body.material.poisson=0.6: body.material.poisson: found 0.6",
         "0.49 to 0.499"},
        {{"body.material.poison=0.3"},
         "--set body.material.poison=0.3: body.material.poison: found an unknown",
         "did you mean poisson?"},
        {{"nonsense"}, "--set nonsense: found no path", "dotted.path=value"},
        {{"=3"}, "--set =3: found no path", "dotted.path=value"},
        {{"body..spacing=3"}, "--set body..spacing=3: found no path", "dotted.path=value"},
        {{"body.spacing.=3"}, "--set body.spacing.=3: found no path", "dotted.path=value"},
        {{"tools[x].friction=0"}, "--set tools[x].friction=0: found no path", "dotted.path=value"},
        {{"tools[0.friction=0"}, "--set tools[0.friction=0: found no path", "dotted.path=value"},
        {{"body.spacing=[1"}, "--set body.spacing=[1: not valid YAML", "check"},
        {{"body.spacing=0.5x"},
         "--set body.spacing=0.5x: body.spacing: found 0.5x",
         "digits alone"},
        {{"body.spacing="},
         "--set body.spacing=: body.spacing: found nothing, but it is required",
         "add"},
        {{"body.spacing.m=3"},
         "--set body.spacing.m=3: found that body.spacing is a single value",
         "mapping"},
        {{"tools.3.friction=0"},
         "--set tools.3.friction=0: found no item 3 in a list of 1",
         "0 to 1"},
        {{"tools.hook.friction=0"},
         "--set tools.hook.friction=0: found no item hook",
         "an item's name"},
        {{"tools.probe.friction=20"},
         "--set tools.probe.friction=20: tools[0].friction: found 20",
         "0 to 10"},
        {{"method.kind=point", "method.volumetric=nodal"},
         "--set method.volumetric=nodal: method.volumetric: found an option that kind: point does "
         "not have",
         "change the method"},
        {{"body.geometry.sphere.radius=1"}, "", "body.geometry: found hemisphere and sphere"},
        {{"body.geometry={file: here.obj}"},
         "--set body.geometry={file: here.obj}: body.geometry.file: found",
         "relative to the working directory"},
        {{"a.b.c.d.e.f.g.h.i.j.k.l.m.n.o.p.q.r=1"}, "--set a.b", "found no path"},
        {{"body.probes={a: [0,0,0], a: [0,0,1]}"},
         "--set body.probes={a: [0,0,0], a: [0,0,1]}: a: found a second",
         "remove one"},
    };
    char text[4096];
    compose(text, sizeof text, 0, "");
    for (size_t i = 0; i < sizeof cases / sizeof cases[0]; i++) {
        pal_scene *scene;
        pal_error error = {0};
        pal_status status = test_scene_load(text, cases[i].set, &scene, &error);
        if (status == PALPATE_OK ||
            strncmp(error.message, cases[i].message, strlen(cases[i].message)) != 0 ||
            strstr(error.message, cases[i].advice) == NULL) {
            fail_msg("%s\n  expected: %s ... %s\n  found:    %s", cases[i].set[0], cases[i].message,
                     cases[i].advice, error.message);
        }
    }
}

/// An option of another kind that stands in the file, when --set changes the kind.
static void options_of_another_kind_are_an_error(void **state) {
    (void)state;
    char text[4096];
    compose(text, sizeof text, 9, "method: {kind: cell, volumetric: nodal}");
    pal_scene *scene;
    pal_error error = {0};
    const char *set[] = {"method.kind=point", NULL};
    assert_int_equal(test_scene_load(text, set, &scene, &error), PALPATE_ERROR_SCENE);
    assert_non_null(strstr(error.message,
                           "scene.yaml:9:22: method.volumetric: found an option that kind: "
                           "point does not have; allowed: with kind: cell, or kind: galerkin"));
    const char *both[] = {"method={kind: point}", NULL};
    assert_int_equal(test_scene_load(text, both, &scene, &error), PALPATE_OK);
    pal_scene_free(scene);
}

static void expect_file(const char *text, size_t size, pal_status expected, const char *message) {
    char path[64];
    pal_scene *scene;
    pal_error error = {0};
    test_scene_put(text, size, path);
    pal_status status = pal_scene_load(path, NULL, 0, &scene, &error);
    test_scene_remove(path);
    if (status != expected || strstr(error.message, message) == NULL) {
        fail_msg("expected %s, found %s", message, error.message);
    }
}

static void whole_files_that_are_no_scene(void **state) {
    (void)state;
    expect_file("", 0, PALPATE_ERROR_SCENE, "scene.yaml:1:1: found nothing; allowed: a scene");
    expect_file("# only a comment\n", 17, PALPATE_ERROR_SCENE, ":1:1: found nothing");
    expect_file("~\n", 2, PALPATE_ERROR_SCENE, ":1:1: found nothing");
    expect_file("[1, 2]", 6, PALPATE_ERROR_SCENE,
                "scene.yaml:1:1: found a list of 2; allowed: a mapping");
    expect_file("hello", 5, PALPATE_ERROR_SCENE, "scene.yaml:1:1: found hello; allowed: a mapping");
    expect_file("pal\0pate", 8, PALPATE_ERROR_SCENE,
                "scene.yaml:1:4: found control character 0x00");
    // UTF-16, as some editors save it
    expect_file("\xff\xfep\0a\0", 6, PALPATE_ERROR_SCENE, "scene.yaml:1:1: found byte 0xFF");
    // a Latin-1 e with acute accent, on the second line, after a two-byte UTF-8 letter: column
    // counts letters
    expect_file("a: 1\n\"\xc3\xa9\xe9\"", 9, PALPATE_ERROR_SCENE,
                "scene.yaml:2:3: found byte 0xE9");

    pal_scene *scene;
    pal_error error = {0};
    assert_int_equal(pal_scene_load("/nonexistent/x.yaml", NULL, 0, &scene, &error),
                     PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, "/nonexistent/x.yaml: cannot be read (No such file"));
    assert_int_equal(pal_scene_load("/tmp", NULL, 0, &scene, &error), PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, "not a regular file"));
    assert_int_equal(pal_scene_load(NULL, NULL, 0, &scene, &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_scene_load("x", NULL, 1, &scene, &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_scene_load("x", NULL, 0, NULL, &error), PALPATE_ERROR_ARGUMENT);
    const char *none[] = {NULL};
    assert_int_equal(pal_scene_load("x", none, 1, &scene, &error), PALPATE_ERROR_ARGUMENT);
}

/// Nine levels of nine aliases each would be 387 million values.
static void an_alias_bomb_is_refused(void **state) {
    (void)state;
    char text[2048] = "a0: &a0 [x, x, x, x, x, x, x, x, x]\n";
    for (int i = 1; i < 9; i++) {
        size_t n = strlen(text);
        n += (size_t)snprintf(text + n, sizeof text - n, "a%d: &a%d [", i, i);
        for (int k = 0; k < 9; k++) {
            n += (size_t)snprintf(text + n, sizeof text - n, "%s*a%d", k > 0 ? ", " : "", i - 1);
        }
        (void)snprintf(text + n, sizeof text - n, "]\n");
    }
    expect_file(text, strlen(text), PALPATE_ERROR_SCENE, "found more than 20000 values");
}

static void depth_and_size_are_limited(void **state) {
    (void)state;
    enum { SIZE = (1 << 20) + 1 };
    char *text = malloc(SIZE);
    assert_non_null(text);
    memset(text, '[', SIZE);
    // libyaml needs a time quadratic in the nesting of brackets and in the number of anchors
    expect_file(text, 100000, PALPATE_ERROR_SCENE,
                "scene.yaml:1:201: found brackets nested deeper");
    expect_file(text, SIZE, PALPATE_ERROR_SCENE, "found more than 1 MiB");
    memset(text, ' ', SIZE);
    size_t n = 0;
    for (int i = 0; i < 40; i++) { // block style, nested 40 deep
        n += (size_t)snprintf(text + n, SIZE - n, "%*sa:\n", i, "");
    }
    expect_file(text, n, PALPATE_ERROR_SCENE, "found values nested deeper than 32 levels");
    n = (size_t)snprintf(text, SIZE, "a: ");
    memset(text + n, 'x', 2000);
    expect_file(text, n + 2000, PALPATE_ERROR_SCENE,
                "scene.yaml:1:4: found a value longer than 1023 bytes");
    n = 0;
    for (int i = 0; i < 25000; i++) {
        n += (size_t)snprintf(text + n, SIZE - n, "- 1\n");
    }
    expect_file(text, n, PALPATE_ERROR_SCENE, "scene.yaml:20000:3: found more than 20000 values");
    n = 0;
    for (int i = 0; i < 2000; i++) {
        n += (size_t)snprintf(text + n, SIZE - n, "- &a%d 1\n", i);
    }
    expect_file(text, n, PALPATE_ERROR_SCENE, "scene.yaml:1001:3: found more than 1000 anchors");
    n = 0;
    for (int i = 0; i < 500000; i++) { // nested lists of one item, in one line
        n += (size_t)snprintf(text + n, SIZE - n, "- ");
    }
    expect_file(text, n, PALPATE_ERROR_SCENE, "found values nested deeper than 32 levels");
    free(text);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_unchanged_scene_loads),
        cmocka_unit_test(every_bad_scene_is_located),
        cmocka_unit_test(unbuilt_features_are_refused_as_such),
        cmocka_unit_test(bad_overrides_name_themselves),
        cmocka_unit_test(options_of_another_kind_are_an_error),
        cmocka_unit_test(whole_files_that_are_no_scene),
        cmocka_unit_test(an_alias_bomb_is_refused),
        cmocka_unit_test(depth_and_size_are_limited),
    };
    return cmocka_run_group_tests_name("scene_errors", tests, NULL, NULL);
}
