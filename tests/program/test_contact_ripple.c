/// Contact anywhere on real models: a ball slid along circles over more than 100 node spacings of a
/// block and of a half ball at constant depth feels a constant force, whatever its size; and that
/// force is Hertz's. A model kept raw feels nearly the same.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "haptic/engine/engine.h"
#include "tests/support/program.h"

enum { BLOCK, DOME, RAW, MODELS };
static const double SPACING = 0.0022, BALL = 0.05, PI = 3.14159265358979324;
static char folder[] = "/tmp/palpate-ripple-XXXXXX";
static pal_model *model[MODELS];

/// Slow: three models. Made once.
static int setup(void **state) {
    (void)state;
    static const char *const body[MODELS] = {
        "geometry: {box: {size: [0.09, 0.09, 0.035], center: [0, 0, -0.0175]}}\n"
        "  fixed: [{below: {z: -0.035}}]\n",
        "geometry: {hemisphere: {radius: 0.05}}\n  fixed: [{below: {z: 0}}]\n",
        "geometry: {hemisphere: {radius: 0.05}}\n  fixed: [{below: {z: 0}}]\n"};
    if (mkdtemp(folder) == NULL) {
        return 1;
    }
    for (int k = 0; k < MODELS; k++) {
        char scene[64], file[64];
        double top = k == BLOCK ? 0 : BALL;
        (void)snprintf(scene, sizeof scene, "%s/%d.yaml", folder, k);
        (void)snprintf(file, sizeof file, "%s/%d.palpate", folder, k);
        FILE *f = fopen(scene, "w");
        if (f == NULL) {
            return 1;
        }
        fprintf(f,
                "palpate: 1\nbody:\n  %s  spacing: 0.009\n"
                "  refine: [{center: [0, 0, %g], radius: 0.017, spacing: %g}]\n"
                "  material: {young: 10e3, poisson: 0.45}\n"
                "  touchable: [{ball: {center: [0, 0, %g], radius: 0.021}}]\n"
                "store: {displacement: none}\nestimate: false\n%s",
                body[k], top, SPACING, top,
                k == RAW ? "repair: none\nmethod: {form: collocated}\n" : "");
        if (fclose(f) != 0) {
            return 1;
        }
        char arguments[256];
        (void)snprintf(arguments, sizeof arguments, "precompute %s -q -o %s", scene, file);
        program_result r = program_run(arguments);
        pal_error e = {0};
        if (r.status != 0 || pal_model_load(file, &model[k], &e) != PALPATE_OK) {
            print_error("%s%s\n", r.error, e.message);
            return 1;
        }
        program_clear(&r);
        (void)remove(scene);
        (void)remove(file);
    }
    return 0;
}

static int teardown(void **state) {
    (void)state;
    for (int k = 0; k < MODELS; k++) {
        pal_model_free(model[k]);
    }
    return rmdir(folder);
}

typedef struct slide {
    double mean, ripple; ///< of the force along the surface's normal [N], (max - min) / mean
    double worst;        ///< largest force change of a tick / (stiffness x motion)
    double sideways;     ///< largest force across the normal / mean
    double nodes;        ///< mean number with a force
} slide;

/// Circles of radius 5, 9 and 13 mm: 0.17 m, 77 spacings; and a spiral of 4 turns between: 40 more.
static slide around(const pal_model *m, int dome, double radius, double depth) {
    pal_tool_def tool = {.shape = radius > 0 ? PALPATE_SHAPE_SPHERE : PALPATE_SHAPE_POINT,
                         .radius = radius,
                         .limits = {.force = 1e6, .slew = 1e6, .torque = 1e6}};
    pal_engine_def def = pal_engine_default_def();
    pal_engine *engine;
    pal_error e = {0};
    def.tools = &tool;
    def.tool_count = 1;
    def.reader_count = 0;
    if (pal_engine_create(m, &def, &engine, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    enum { PRESS = 100, TICKS = 8000 };
    double least = INFINITY, most = 0, last[3] = {0}, at[3] = {0};
    slide s = {0};
    double modulus = m->info.young / (1 - m->info.poisson * m->info.poisson);
    double stiffness = 2 * modulus * fmax(sqrt(radius * depth), 0.3 * SPACING);
    for (int k = -PRESS; k < TICKS; k++) {
        double u = k < 0 ? 0 : (double)k / TICKS, d = k < 0 ? depth * (k + PRESS) / PRESS : depth;
        double turn = 2 * PI * 7 * u; // three circles joined by widening turns
        double grow = 3 * u - floor(3 * u), ring = floor(3 * u);
        double rho = 0.005 + 0.004 * fmin(2, ring + (grow > 0.7 ? (grow - 0.7) / 0.3 : 0));
        double x[3] = {rho * cos(turn), rho * sin(turn), radius - d}, n[3] = {0, 0, 1};
        if (dome) {
            double polar = rho / BALL;
            n[0] = sin(polar) * cos(turn);
            n[1] = sin(polar) * sin(turn);
            n[2] = cos(polar);
            for (int i = 0; i < 3; i++) {
                x[i] = (BALL + radius - d) * n[i];
            }
        }
        pal_tool_state in = {.position = {x[0], x[1], x[2]}, .orientation = {1, 0, 0, 0}};
        pal_tool_force out;
        assert_int_equal(pal_engine_force(engine, &in, &out), 0);
        double along = 0, size = 0, change = 0, moved = 0;
        for (int i = 0; i < 3; i++) {
            along += out.force[i] * n[i];
            size += out.force[i] * out.force[i];
            change += (out.force[i] - last[i]) * (out.force[i] - last[i]);
            moved += (x[i] - at[i]) * (x[i] - at[i]);
            last[i] = out.force[i];
            at[i] = x[i];
        }
        if (k > -PRESS) {
            s.worst = fmax(s.worst, sqrt(change / moved) / stiffness);
        }
        if (k >= 0) {
            least = fmin(least, along);
            most = fmax(most, along);
            s.mean += along / TICKS;
            s.sideways = fmax(s.sideways, sqrt(fmax(0, size - along * along)));
            s.nodes += engine->result.dof_count / 3.0 / TICKS;
        }
    }
    s.ripple = (most - least) / s.mean;
    s.sideways /= s.mean;
    pal_engine_free(engine);
    return s;
}

static void slides_do_not_feel_the_nodes(void **state) {
    (void)state;
    static const double tip[][2] = {{0, 2e-4},    {5e-4, 1e-4},   {2e-3, 3e-4},
                                    {8e-3, 3e-4}, {4e-3, 1.5e-3}, {0.01, 2e-3}};
    for (int k = 0; k < MODELS; k++) {
        for (int i = 0; i < 6; i++) {
            double r = tip[i][0], d = tip[i][1];
            slide s = around(model[k], k != BLOCK, r, d);
            double modulus = 10e3 / (1 - 0.45 * 0.45),
                   both = k == BLOCK ? r : r * BALL / (r + BALL);
            double hertz = 4.0 / 3.0 * modulus * sqrt(both) * pow(d, 1.5);
            print_message(
                "%s, R %g mm, depth %g mm (contact radius %.2f spacings): ripple %.2f %%, sideways "
                "%.2f %%, jump %.2f, %.1f nodes, %.3f of Hertz\n",
                k == BLOCK  ? "block"
                : k == DOME ? "half ball"
                            : "half ball, raw",
                1e3 * r, 1e3 * d, sqrt(r * d) / SPACING, 100 * s.ripple, 100 * s.sideways, s.worst,
                s.nodes, r > 0 ? s.mean / hertz : 0);
            // the issue asks for 3 %, and of smooth changes over the body itself there are some
            assert_true(s.ripple < (k == RAW ? 0.03 : 0.015));
            assert_true(s.worst < 1.5); // a point tool has no contact radius: 0.3 spacings
            assert_true(s.sideways < 0.01);
            if (r > 0 && sqrt(r * d) < SPACING && k != RAW) {
                // tips below the spacing: Hertz, with a percent or two for the body's finite size
                // and, at depths of 0.2 R, for the ball not being a paraboloid
                assert_true(fabs(s.mean / hertz - 1) < 0.05);
            }
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(slides_do_not_feel_the_nodes)};
    return cmocka_run_group_tests(tests, setup, teardown);
}
