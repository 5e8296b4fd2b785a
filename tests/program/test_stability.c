/// The closed loop over 10 s of 1 kHz ticks without a clock: the default coupling does not grow on
/// soft and on stiff organs, with and without a hand, on devices with and without friction; without
/// a coupling a stiff organ does; a raw, non-passive compliance feeds the loop that its repaired
/// twin lets decay. bench/stability measures the same on a finer grid.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <palpate/precompute.h>
#include <palpate/scene.h>

#include "src/scene/scene.h"
#include "tests/support/closed_loop.h"
#include "tests/support/scene_text.h"
#include "tests/support/synthetic_model.h"

static const char *const SCENE = "palpate: 1\n"
                                 "body:\n"
                                 "  geometry: {hemisphere: {radius: 0.05}}\n"
                                 "  spacing: 0.01\n"
                                 "  material: {young: 10e3, poisson: 0.45}\n"
                                 "  fixed: [{below: {z: 0}}]\n"
                                 "tools:\n"
                                 "  - name: probe\n"
                                 "    shape: {sphere: {radius: 0.004}}\n"
                                 "    start: [0.0003, 0.0002, 0.004]\n"
                                 "    device: {simulated: {}}\n";

static pal_tool_def tool_of(const char *const set[]) {
    pal_scene *scene = NULL;
    pal_error e = {0};
    if (test_scene_load(SCENE, set, &scene, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_tool_def tool = scene->runtime.tools[0];
    pal_scene_free(scene);
    return tool;
}

/// Which coupling a scene gets that says nothing, and what it makes of what is said.
static void the_default_is_the_measured_one(void **state) {
    (void)state;
    static const struct {
        const char *set[4];
        double stiffness, damping;
    } cases[] = {
        {{NULL}, 1000, 1},
        {{"tools.0.device=", NULL}, 0, 0}, // null: stays at start
        {{"tools.0.device={scripted: {depth: 0.001}}", NULL}, 0, 0},
        {{"servo.rate=2000", NULL}, 1000, 0.5},
        {{"contact.law=nodes", NULL}, 0, 0},
        {{"tools.0.coupling={stiffness: 0}", NULL}, 0, 0},
        {{"tools.0.coupling={stiffness: 300}", NULL}, 300, 0.3},
        {{"tools.0.coupling={stiffness: 300, damping: 0}", NULL}, 300, 0},
        {{"tools.0.device_spec={max_stiffness: 500, max_damping: 0.2}", NULL}, 500, 0.2},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        pal_tool_def t = tool_of(cases[i].set);
        assert_true(fabs(t.coupling_stiffness - cases[i].stiffness) < 1e-12);
        assert_true(fabs(t.coupling_damping - cases[i].damping) < 1e-12);
    }
    pal_scene *scene = NULL;
    pal_error e = {0};
    const char *const bad[] = {"tools.0.coupling={damping: 1}", NULL};
    assert_int_equal(test_scene_load(SCENE, bad, &scene, &e), PALPATE_ERROR_SCENE);
    assert_non_null(
        strstr(e.message, "tools[0].coupling.damping: found a damping without a stiffness"));
}

static pal_model *half_space(double young, double skew) {
    synthetic_params p = synthetic_default_params();
    p.n = 9;
    p.young = young;
    p.skew = skew;
    p.rows = SYNTHETIC_ROWS_NONE;
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    return model;
}

/// A tap of 0.2 m/s on a tool pushed 2 mm into the organ, or with 1 N. @param device  0: no
/// friction, exact encoders; 1: Touch; 2: Premium
static loop_result tap(const pal_model *model, pal_tool_def tool, int device, int grip,
                       int coupled) {
    pal_simulated *s = &tool.device.simulated;
    *s = pal_simulated_default(device == 2 ? PALPATE_SIMULATED_PREMIUM : PALPATE_SIMULATED_TOUCH,
                               (pal_simulated_grip)grip);
    if (device == 0) {
        s->friction = s->resolution = 0.0;
    }
    if (!coupled) {
        tool.coupling_stiffness = tool.coupling_damping = 0.0;
    }
    s->push = fmin(1.0, loop_press(model, &tool, 2e-3));
    s->kick = 0.2;
    loop_def def = {.model = model,
                    .tool = tool,
                    .seconds = 10,
                    .period = 1e-3,
                    .points = 7,
                    .stop_when_still = device != 0};
    loop_result r;
    pal_error e = {0};
    if (loop_run(&def, &r, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    return r;
}

static void the_default_coupling_does_not_grow(void **state) {
    (void)state;
    static const char *const names[] = {"bare", "touch", "premium"};
    pal_tool_def tool = tool_of(NULL);
    for (double young = 1e3; young < 2e6; young *= 10) {
        pal_model *model = half_space(young, 0.0);
        for (int device = 0; device < 3; device++) {
            for (int grip = PALPATE_GRIP_FIRM; grip <= PALPATE_GRIP_NONE; grip++) {
                loop_result r = tap(model, tool, device, grip, 1);
                double step = device == 0 ? 0.0 : device == 1 ? 5.5e-5 : 3e-5;
                if (!loop_calms(&r, step) || (grip == PALPATE_GRIP_NONE && r.touching == 0)) {
                    fail_msg("E %g, %s, grip %d: swing %g mm at first, %g mm at last, %d contacts",
                             young, names[device], grip, 1e3 * r.swing[0],
                             1e3 * r.swing[LOOP_WINDOWS - 1], r.touching);
                }
            }
        }
        pal_model_free(model);
    }
}

/// The same tap, nothing between device and organ: 1 MPa is some 7 kN/m, and 0.1 N s/m calm 200
/// N/m.
static void without_a_coupling_a_stiff_organ_grows(void **state) {
    (void)state;
    pal_tool_def tool = tool_of(NULL);
    pal_model *stiff = half_space(1e6, 0.0), *soft = half_space(1e4, 0.0);
    loop_result r = tap(stiff, tool, 0, PALPATE_GRIP_NONE, 0);
    assert_false(loop_calms(&r, 0.0));
    assert_true(r.given - r.taken > 1e-3); // a multiple of the tap's 0.9 mJ
    r = tap(soft, tool, 0, PALPATE_GRIP_NONE, 0);
    assert_true(loop_calms(&r, 0.0));
    pal_model_free(stiff);
    pal_model_free(soft);
}

/// Forceps let go while they circle: a skew part s of the stiffness k turns a circle of frequency w
/// faster when s k / w > b (less what sampling takes); without it the circle dies as exp(-b t / 2
/// m).
static void feeds(const pal_model *raw, const pal_model *repaired) {
    int32_t column = loop_worst_column(raw);
    double skew, k;
    pal_error e = {0};
    loop_result r;
    const double b = 0.1, m = 0.045;
    loop_def def = {.model = raw, .seconds = 10, .period = 1e-3, .nodes = 1};
    def.tool = loop_forceps(raw, column, b, &skew, &k);
    print_message("raw: %.0f N/m, skew %.1f %%, feeds circles below b = %.3f N s/m\n", k,
                  100 * skew, skew * sqrt(k * m));
    assert_true(skew * sqrt(k * m) > 1.3 * b && 0.5 * k * 1e-3 < 0.5 * b);
    assert_int_equal(loop_run(&def, &r, &e), PALPATE_OK);
    assert_true(r.swing[19] > 10.0 * r.swing[3]); // grown, here into the device's stops
    assert_true(r.given - r.taken > 0.01);        // on energy out of the model
    assert_false(loop_calms(&r, 0.0));

    def.model = repaired;
    def.tool = loop_forceps(repaired, column, b, &skew, NULL);
    assert_true(skew < 1e-9);
    assert_int_equal(loop_run(&def, &r, &e), PALPATE_OK);
    assert_true(loop_calms(&r, 0.0));
    assert_true(r.swing[19] < 0.01 * r.swing[3]); // exp(-8 s x 0.1 / 2 / 0.045) = 1e-4
    assert_true(r.given - r.taken < 1e-4);        // what sampling adds
}

static void a_raw_half_space_feeds_the_loop(void **state) {
    (void)state;
    pal_model *raw = half_space(1e4, 0.4), *repaired = half_space(1e4, 0.0);
    feeds(raw, repaired);
    pal_model_free(raw);
    pal_model_free(repaired);
}

static pal_model *collocated(const char *repair) {
    const char *const set[] = {"method={kind: cell, form: collocated}",
                               repair,
                               "body.material.poisson=0.3",
                               "store={displacement: none}",
                               "body.touchable=[{ball: {center: [0, 0, 0.05], radius: 0.02}}]",
                               "body.patches={pole: {ball: {center: [0, 0, 0.05], radius: 0.01}, "
                               "rim_spacing: 0.0025}}",
                               NULL};
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    pal_error e = {0};
    if (test_scene_load(SCENE, set, &scene, &e) != PALPATE_OK ||
        pal_precompute(scene, NULL, &model, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_scene_free(scene);
    return model;
}

static void a_raw_collocated_model_feeds_the_loop(void **state) {
    (void)state;
    pal_model *raw = collocated("repair=none"), *repaired = collocated("repair=symmetrize");
    feeds(raw, repaired);
    pal_model_free(raw);
    pal_model_free(repaired);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_default_is_the_measured_one),
        cmocka_unit_test(the_default_coupling_does_not_grow),
        cmocka_unit_test(without_a_coupling_a_stiff_organ_grows),
        cmocka_unit_test(a_raw_half_space_feeds_the_loop),
        cmocka_unit_test(a_raw_collocated_model_feeds_the_loop),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
