/// Friction on a curved organ: a ball pressed on the pole of a hemisphere, then dragged along great
/// circles in 16 directions, sticks first and then slides at mu times the normal force; symmetrized
/// and raw model.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <palpate/engine.h>
#include <palpate/precompute.h>
#include <palpate/scene.h>

#include "haptic/contact/contact_anywhere.h"
#include "haptic/engine/engine.h"
#include "tests/support/scene_text.h"

static const double PI = 3.14159265358979324, BODY = 0.05, BALL = 0.004;

static const char *const SCENE =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {hemisphere: {radius: 0.05}}\n"
    "  spacing: 0.01\n"
    "  refine: [{center: [0, 0, 0.05], radius: 0.014, spacing: 0.003}]\n"
    "  material: {young: 10e3, poisson: 0.45}\n"
    "  fixed: [{below: {z: 0}}]\n"
    "  touchable: [{ball: {center: [0, 0, 0.05], radius: 0.018}}]\n"
    "store: {displacement: none}\n"
    "certify: warn\n"
    "tools:\n"
    "  - name: probe\n"
    "    shape: {sphere: {radius: 0.004}}\n"
    "    friction: 0.4\n";

static double dot3(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/// Sum of the points' friction over that of their normal forces, as vectors.
static double friction_over_normal(const pal_engine *engine) {
    const anywhere_law *law = engine->contact;
    double normal[3] = {0}, friction[3] = {0};
    for (int32_t i = 0; i < law->points; i++) {
        const anywhere_point *p = &law->point[i];
        for (int c = 0; c < 3; c++) {
            const double *z = law->z + p->first;
            normal[c] += z[0] * p->along[0][c];
            friction[c] += z[1] * p->along[1][c] + z[2] * p->along[2][c];
        }
    }
    return sqrt(dot3(friction, friction) / dot3(normal, normal));
}

static void drag(const char *repair, double stiffness, double most_aside) {
    // a raw model is that of the collocated form, which is not symmetric
    const char *const set[] = {
        repair, strcmp(repair, "repair=none") == 0 ? "method={kind: cell, form: collocated}" : NULL,
        NULL};
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    pal_engine *engine = NULL;
    pal_error e = {0};
    pal_tool_def tool = {.name = "probe",
                         .shape = PALPATE_SHAPE_SPHERE,
                         .radius = BALL,
                         .friction = 0.4,
                         .coupling_stiffness = stiffness,
                         .coupling_damping = stiffness / 1000,
                         .limits = {INFINITY, INFINITY, INFINITY}};
    if (test_scene_load(SCENE, set, &scene, &e) != PALPATE_OK ||
        pal_precompute(scene, NULL, &model, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_engine_def def = pal_engine_default_def();
    def.tool_count = 1;
    def.tools = &tool;
    if (pal_engine_create(model, &def, &engine, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    double worst = 0, exact = 0, aside = 0, depth = 0.0012, leap = 0;
    for (int k = 0; k < 16; k++) {
        double a = 2 * PI * k / 16 + 0.1, way[3] = {cos(a), sin(a), 0},
               across[3] = {-sin(a), cos(a), 0};
        int stuck = 0;
        pal_tool_force f = {0}, last = {0};
        pal_engine_reset(engine);
        for (int i = 0; i <= 600; i++) {
            double down = depth * fmin(1, i / 100.0), along = 1e-5 * fmax(0, i - 100) / BODY;
            double r = BODY + BALL - down;
            pal_tool_state in = {
                .position = {r * sin(along) * way[0], r * sin(along) * way[1], r * cos(along)},
                .orientation = {1, 0, 0, 0}};
            (void)pal_engine_tick(engine, &in, &f);
            assert_true((f.fault & (PALPATE_FAULT_CUTOFF | PALPATE_FAULT_SINGULAR)) == 0);
            double n = dot3(f.force, f.normal), t[3];
            for (int c = 0; c < 3; c++) {
                t[c] = f.force[c] - n * f.normal[c];
                last.force[c] -= f.force[c];
            }
            if (i > 101) {
                leap = fmax(leap, sqrt(dot3(last.force, last.force)));
            }
            last = f;
            double ratio = n > 0 ? sqrt(dot3(t, t)) / n : 0;
            stuck += i > 100 && ratio < 0.35;
            if (i > 450) {
                worst = fmax(worst, fabs(ratio / 0.4 - 1));
                aside = fmax(aside, fabs(dot3(t, across)) / sqrt(dot3(t, t)));
                assert_true(dot3(t, way) < 0);
                exact = fmax(exact, fabs(friction_over_normal(engine) / 0.4 - 1));
            }
        }
        assert_true(stuck > 10);
    }
    print_message(
        "  %s, coupling %.0f N/m: within %.1e of mu f_n in 16 directions (across the tool's "
        "normal; the points' sums: %.1e), %.1e aside, %.1f N/m at most\n",
        repair, stiffness, worst, exact, aside, leap / 1e-5);
    assert_true(worst < 0.01); // issue 5
    // every point slides at mu: what is left is that they do not slide in quite the same direction
    assert_true(exact < 5e-4);
    assert_true(aside < most_aside);
    assert_true(leap < 1e-5 * 80); // normal stiffness 60 N/m: no tick changes the force by more
    pal_engine_free(engine);
    pal_model_free(model);
    pal_scene_free(scene);
}

static void slides_on_a_hemisphere(void **state) {
    (void)state;
    drag("repair=symmetrize", 0, 0.05); // the mesh is not quite isotropic
    drag("repair=symmetrize", 1000, 0.05);
}

static void slides_on_a_raw_model(void **state) {
    (void)state;
    drag("repair=none", 0, 0.1); // skew turns the slip
}

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

/// Pressed deep into lobes as wide as the ball itself, moved aside and held: the force comes to
/// rest. The pattern lies where the last tick's drag was, and the drag depends on where it lies.
static void held_still_in_a_lobe_it_settles(void **state) {
    (void)state;
    static const char *const liver = "palpate: 1\n"
                                     "body:\n"
                                     "  geometry: {file: %s, scale: 0.1}\n"
                                     "  spacing: 0.012\n"
                                     "  material: {young: 5e3, poisson: 0.45}\n"
                                     "  fixed: [{below: {x: -0.12}}]\n"
                                     "  touchable: [{above: {x: -0.09}}]\n"
                                     "store: {displacement: none}\nestimate: false\n";
    char *file = realpath("../shared/data/liver2.obj", NULL), text[4600];
    if (file == NULL) {
        skip();
    }
    (void)snprintf(text, sizeof text, liver, file);
    free(file);
    pal_scene *scene = NULL;
    pal_model *m = NULL;
    pal_error e = {0};
    if (test_scene_load(text, NULL, &scene, &e) != PALPATE_OK ||
        pal_precompute(scene, NULL, &m, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    uint64_t random = 9;
    int restless = 0, held = 0;
    double worst = 0;
    for (int k = 0; k < 120; k++) {
        double r = 0.009 * (0.6 + 3 * uniform(&random)), depth = r * (0.4 + 1.1 * uniform(&random));
        pal_tool_def tool = {.shape = PALPATE_SHAPE_SPHERE,
                             .radius = r,
                             .friction = 0.1 + 1.2 * uniform(&random),
                             .coupling_stiffness = uniform(&random) < 0.4 ? 0 : 500,
                             .limits = {INFINITY, INFINITY, INFINITY}};
        tool.coupling_damping = tool.coupling_stiffness / 1000;
        int32_t node = m->column_node[(int)(uniform(&random) * m->info.column_count)];
        const double *x = m->position + 3 * (size_t)node, *n = m->normal + 3 * (size_t)node;
        double aside[3], far = r * uniform(&random), last[3] = {0}, moved = 0, force = 0;
        for (int c = 0; c < 3; c++) {
            aside[c] = uniform(&random) - 0.5;
        }
        double up = dot3(aside, n);
        for (int c = 0; c < 3; c++) {
            aside[c] = 2 * far * (aside[c] - up * n[c]);
        }
        pal_engine_def def = pal_engine_default_def();
        pal_engine *engine = NULL;
        def.tool_count = 1;
        def.tools = &tool;
        if (pal_engine_create(m, &def, &engine, &e) != PALPATE_OK) {
            fail_msg("%s", e.message);
        }
        for (int i = 0; i < 700; i++) {
            double down = fmin(1, i / 200.0), over = fmin(1, fmax(0, i - 200) / 150.0);
            pal_tool_state in = {.orientation = {1, 0, 0, 0}};
            pal_tool_force f;
            for (int c = 0; c < 3; c++) {
                in.position[c] =
                    x[c] + n[c] * (r + 0.001 - down * (depth + 0.001)) + over * aside[c];
            }
            (void)pal_engine_force(engine, &in, &f);
            double change = 0;
            for (int c = 0; c < 3; c++) {
                change += pow(f.force[c] - last[c], 2);
                last[c] = f.force[c];
            }
            moved = i > 680 ? fmax(moved, sqrt(change)) : 0;
            force = sqrt(dot3(f.force, f.force));
        }
        held += force > 0.01;
        restless += force > 0.01 && moved > 1e-4 * force;
        worst = fmax(worst, force > 0.01 ? moved / force : 0);
        pal_engine_free(engine);
    }
    print_message(
        "  %d presses held for 0.35 s: %d restless, at most %.1e of the force each tick\n", held,
        restless, worst);
    assert_true(held > 60);
    assert_true(restless <= 5); // 3; the whole drag taken each tick: 20
    pal_model_free(m);
    pal_scene_free(scene);
}

/// A shaft with friction behind a coupling, across sharp edges of a box, held still: where its
/// stations lie depends on how the coupling gives, and that on where they lie.
static void held_still_across_an_edge_it_settles(void **state) {
    (void)state;
    static const char *const box = "palpate: 1\n"
                                   "body:\n"
                                   "  geometry: {box: {size: [0.04, 0.04, 0.04]}}\n"
                                   "  spacing: 0.005\n"
                                   "  material: {young: 10e3, poisson: 0.45}\n"
                                   "  fixed: [{below: {z: -0.02}}]\n"
                                   "store: {displacement: none}\nestimate: false\n";
    pal_scene *scene = NULL;
    pal_model *m = NULL;
    pal_engine *engine = NULL;
    pal_error e = {0};
    if (test_scene_load(box, NULL, &scene, &e) != PALPATE_OK ||
        pal_precompute(scene, NULL, &m, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    const double r = 0.006;
    pal_tool_def tool = {.shape = PALPATE_SHAPE_CAPSULE,
                         .radius = r,
                         .length = 4 * r,
                         .friction = 0.3,
                         .coupling_stiffness = 200,
                         .coupling_damping = 0.2,
                         .limits = {INFINITY, INFINITY, INFINITY}};
    pal_engine_def def = pal_engine_default_def();
    def.tool_count = 1;
    def.tools = &tool;
    def.reader_count = 0;
    if (pal_engine_create(m, &def, &engine, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    uint64_t random = 99;
    int restless = 0, held = 0;
    for (int k = 0; k < 60; k++) {
        pal_engine_reset(engine);
        const double *x, *n;
        do { // a node at an edge or corner
            size_t node = (size_t)m->column_node[(int)(uniform(&random) * m->info.column_count)];
            x = m->position + 3 * node;
            n = m->normal + 3 * node;
        } while (fmax(fabs(n[0]), fmax(fabs(n[1]), fabs(n[2]))) > 0.9);
        pal_tool_state in = {.flags = 0};
        double length = 0, depth = r * (0.1 + 0.8 * uniform(&random)), low[3], high[3], most = 0;
        for (int c = 0; c < 4; c++) {
            in.orientation[c] = uniform(&random) - 0.5;
            length += in.orientation[c] * in.orientation[c];
        }
        for (int c = 0; c < 4; c++) {
            in.orientation[c] /= sqrt(length);
        }
        for (int tick = 0; tick < 430; tick++) {
            double away = 3.2 * r - (2.2 * r + depth) * fmin(1, tick / 150.0);
            pal_tool_force out;
            for (int c = 0; c < 3; c++) {
                in.position[c] = x[c] + away * n[c];
            }
            (void)pal_engine_force(engine, &in, &out);
            for (int c = 0; c < 3 && tick >= 400; c++) {
                low[c] = tick == 400 ? out.force[c] : fmin(low[c], out.force[c]);
                high[c] = tick == 400 ? out.force[c] : fmax(high[c], out.force[c]);
                most = fmax(most, fabs(out.force[c]));
            }
        }
        double swing = fmax(high[0] - low[0], fmax(high[1] - low[1], high[2] - low[2]));
        held += most > 0;
        restless += most > 0 && swing > 0.005 * most;
    }
    print_message("  of %d shafts held still across an edge %d do not settle\n", held, restless);
    pal_engine_free(engine);
    pal_model_free(m);
    pal_scene_free(scene);
    assert_true(held > 50);
    assert_true(restless < held / 3); // the coupling's give taken whole: over half of them
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(slides_on_a_hemisphere),
        cmocka_unit_test(slides_on_a_raw_model),
        cmocka_unit_test(held_still_in_a_lobe_it_settles),
        cmocka_unit_test(held_still_across_an_edge_it_settles),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
