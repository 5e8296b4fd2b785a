/// The force of a frictionless tool is the gradient of an energy: closed paths (press, slide over
/// tissue that grows stiffer or softer, release, return through the air) give back what they took,
/// force is the energy's slope in every direction, a ball has no torque, and it is not pushed aside
/// where tissue is the same all around. On a hemisphere, a block near its clamped foot and rim, and
/// an organ.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <palpate/precompute.h>

#include "haptic/base/pose.h"
#include "haptic/contact/contact_anywhere.h"
#include "haptic/engine/engine.h"
#include "tests/support/scene_text.h"

enum { DOME, BLOCK, ORGAN, BODIES };
static const char *const NAME[BODIES] = {"hemisphere", "block", "organ"};
static pal_model *model[BODIES];

static const char *const DOME_SCENE =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {hemisphere: {radius: 0.05}}\n"
    "  spacing: 0.006\n"
    "  material: {young: 10e3, poisson: 0.45}\n"
    "  fixed: [{below: {z: 0}}]\n"
    "  touchable: [{above: {z: 0.008}}]\n" // down to 8 mm above the clamped foot
    "store: {displacement: none}\nestimate: false\n";
static const char *const BLOCK_SCENE =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {box: {size: [0.06, 0.05, 0.02], center: [0, 0, -0.01]}}\n"
    "  spacing: 0.006\n"
    "  refine: [{center: [0, 0, 0], radius: 0.016, spacing: 0.0027}]\n"
    "  material: {young: 8e3, poisson: 0.3}\n"
    "  fixed: [{below: {z: -0.02}}, {below: {x: -0.01}}]\n" // clamped beside the touchable region,
                                                            // too
    "  touchable: [{ball: {center: [0, 0, 0], radius: 0.021}}]\n"
    "store: {displacement: none}\nestimate: false\n";

static int setup(void **state) {
    (void)state;
    static const char *const coarse[] = {"estimate=false", "store.displacement=none"};
    for (int k = 0; k < BODIES; k++) {
        pal_scene *scene = NULL;
        pal_error e = {0};
        pal_status s =
            k == ORGAN ? pal_scene_load("scenes/organ.yaml", coarse, 2, &scene, &e)
                       : test_scene_load(k == DOME ? DOME_SCENE : BLOCK_SCENE, NULL, &scene, &e);
        if (s != PALPATE_OK || pal_precompute(scene, NULL, &model[k], &e) != PALPATE_OK) {
            print_error("%s: %s\n", NAME[k], e.message);
            return 1;
        }
        pal_scene_free(scene);
    }
    return 0;
}

static int teardown(void **state) {
    (void)state;
    for (int k = 0; k < BODIES; k++) {
        pal_model_free(model[k]);
    }
    return 0;
}

/// A tool on a path; work on the body by the trapezoidal rule.
typedef struct hand {
    pal_engine *engine;
    pal_tool_def tool;
    double at[3], turn[4], force[3], torque[3];
    double work, stored; ///< now and the largest [J]
    double most_torque;
} hand;

static void take(hand *h, const pal_model *m, double radius, double length, double coupling) {
    pal_engine_def def = pal_engine_default_def();
    pal_error e = {0};
    *h = (hand){.turn = {1, 0, 0, 0}};
    h->tool = (pal_tool_def){.shape = length > 0 ? PALPATE_SHAPE_CAPSULE : PALPATE_SHAPE_SPHERE,
                             .radius = radius,
                             .length = length,
                             .coupling_stiffness = coupling,
                             .coupling_damping = coupling / 1000,
                             .limits = {INFINITY, INFINITY, INFINITY}};
    def.tools = &h->tool;
    def.tool_count = 1;
    def.reader_count = 0;
    if (pal_engine_create(m, &def, &h->engine, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
}

static const anywhere_law *law_of(const hand *h) {
    return h->engine->contact;
}

/// Contact's energy where the tool is: z.h / 2 (contact_touch.c).
static double energy(const hand *h) {
    const anywhere_law *law = law_of(h);
    double sum = 0;
    for (int32_t i = 0; i < law->rows; i++) {
        sum -= 0.5 * law->q[i] * law->z[i];
    }
    return sum;
}

/// @param spun  how it turned since the last place [rad]
static void place(hand *h, const double x[3], const double spun[3], int fresh) {
    pal_tool_state in = {.position = {x[0], x[1], x[2]}};
    pal_tool_force out;
    memcpy(in.orientation, h->turn, sizeof h->turn);
    assert_int_equal(pal_engine_force(h->engine, &in, &out) &
                         (PALPATE_FAULT_CUTOFF | PALPATE_FAULT_SINGULAR | PALPATE_FAULT_JUMP),
                     0);
    for (int i = 0; i < 3 && !fresh; i++) { // the force on the tool is the negative of its own
        h->work -= 0.5 * (out.force[i] + h->force[i]) * (x[i] - h->at[i]);
        h->work -= 0.5 * (out.torque[i] + h->torque[i]) * spun[i];
    }
    h->stored = fmax(h->stored, h->work);
    h->most_torque = fmax(h->most_torque, sqrt(v3_dot(out.torque, out.torque)));
    memcpy(h->at, x, sizeof h->at);
    memcpy(h->force, out.force, sizeof h->force);
    memcpy(h->torque, out.torque, sizeof h->torque);
}

/// To `to` on a line, turning by `spin` [rad].
static void go(hand *h, const double to[3], const double spin[3], int ticks) {
    double from[3] = {h->at[0], h->at[1], h->at[2]}, a = sqrt(v3_dot(spin, spin)) / ticks;
    double step[3] = {spin[0] / ticks, spin[1] / ticks, spin[2] / ticks};
    for (int k = 1; k <= ticks; k++) {
        double x[3], u = (double)k / ticks, q[4] = {cos(0.5 * a)};
        for (int i = 0; i < 3; i++) {
            q[i + 1] = a > 0 ? sin(0.5 * a) * step[i] / a : 0;
        }
        pal_quat_multiply(q, h->turn, q);
        memcpy(h->turn, q, sizeof q);
        for (int i = 0; i < 3; i++) {
            x[i] = from[i] + u * (to[i] - from[i]);
        }
        place(h, x, step, 0);
    }
}

/// v + s n
static void along(const double v[3], double s, const double n[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        out[i] = v[i] + s * n[i];
    }
}

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

/// Two touchable nodes 2 to 8 spacings apart that face the same way, anywhere: at supports and rims
/// too.
static void two_places(const pal_model *m, double spacing, uint64_t *random, const double *x[2],
                       const double *n[2]) {
    for (int tries = 0; tries < 100000; tries++) {
        for (int k = 0; k < 2; k++) {
            int32_t node = m->column_node[(int)(uniform(random) * m->info.column_count)];
            x[k] = m->position + 3 * (size_t)node;
            n[k] = m->normal + 3 * (size_t)node;
        }
        double d[3] = {x[0][0] - x[1][0], x[0][1] - x[1][1], x[0][2] - x[1][2]};
        double far = sqrt(v3_dot(d, d)) / spacing;
        if (far > 2 && far < 8 && v3_dot(n[0], n[1]) > 0.85) {
            return;
        }
    }
    fail_msg("no two places");
}

enum { BALL, COUPLED, SHAFT, VARIANTS };
static const double STILL[3] = {0, 0, 0};

/// Turned so that its axis lies along t.
static void lay(hand *h, const double t[3]) {
    double q[4] = {1 + t[2], -t[1], t[0], 0}, l = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2]);
    for (int i = 0; i < 4; i++) {
        h->turn[i] = l > 1e-6 ? q[i] / l : i == 1;
    }
}

static void closed_paths_return_what_they_took(void **state) {
    (void)state;
    static const char *const kind[VARIANTS] = {"ball", "ball behind 500 N/m", "turning shaft"};
    for (int variant = 0; variant < VARIANTS * BODIES; variant++) {
        const pal_model *m = model[variant / VARIANTS];
        int what = variant % VARIANTS, paths = 0;
        double mean = 0, sum = 0, worst = 0;
        uint64_t random = 7;
        for (int k = 0; k < 40; k++) {
            hand h;
            const double *x[2], *n[2];
            take(&h, m, 0.004, 0, 0);
            double spacing = law_of(&h)->spacing, out[2][3], in[2][3];
            two_places(m, spacing, &random, x, n);
            double radius = spacing * (0.7 + 3 * uniform(&random));
            double depth = radius * (0.1 + 0.5 * uniform(&random));
            pal_engine_free(h.engine);
            take(&h, m, radius, what == SHAFT ? 3 * spacing : 0, what == COUPLED ? 500 : 0);
            double t[3], spin[3] = {0, 0, 0}, back[3];
            for (int p = 0; p < 2; p++) {
                along(x[p], radius + 0.7 * spacing, n[p], out[p]);
                along(x[p], radius - depth, n[p], in[p]);
            }
            if (what == SHAFT) { // lies across the normal; tilts by 0.15, turns by 0.5 on its way
                along(x[1], -v3_dot(n[0], x[1]) + v3_dot(n[0], x[0]), n[0], t);
                along(t, -1, x[0], t);
                double l = sqrt(v3_dot(t, t));
                for (int i = 0; i < 3; i++) {
                    t[i] /= l;
                }
                lay(&h, t);
                along(STILL, 0.5, n[0], spin);
                for (int i = 0; i < 3; i++) {
                    spin[i] += 0.15 * (n[0][(i + 1) % 3] * t[(i + 2) % 3] -
                                       n[0][(i + 2) % 3] * t[(i + 1) % 3]);
                }
            }
            along(STILL, -1, spin, back);
            place(&h, out[0], STILL, 1);
            go(&h, in[0], STILL, 150);
            double first = sqrt(v3_dot(h.force, h.force));
            go(&h, in[1], spin, 300);
            double second = sqrt(v3_dot(h.force, h.force));
            go(&h, out[1], STILL, 150);
            if (first > 0 && second > 0) {
                double part = h.work / h.stored;
                mean += fabs(part);
                sum += part;
                worst = fabs(part) > fabs(worst) ? part : worst;
                paths++;
            }
            assert_true(what == SHAFT || h.most_torque == 0); // all forces go through the centre
            pal_engine_free(h.engine);
        }
        print_message("  %s, %s: %d closed paths end at %+.2f %% of the stored energy in the mean, "
                      "%.2f %% without sign, the worst %+.1f %%\n",
                      NAME[variant / VARIANTS], kind[what], paths, 100 * sum / paths,
                      100 * mean / paths, 100 * worst);
        assert_true(paths > 20);
        // with forces along the body's normals: 13 to 33 % in the mean, the worst 150 to 300 %; a
        // shaft 21 to 27 %. What is left is the error of 16 points, and of the single ones that a
        // shaft has between its ends: they know nothing of what lies across it
        assert_true(mean / paths < (what == SHAFT ? 0.14 : 0.035));
        assert_true(fabs(worst) < (what == SHAFT ? 0.6 : 0.14));
    }
}

/// Over one spacing in eight directions along the surface and one across it: work against the
/// change of contact's energy z.h / 2.
static void force_is_the_slope_of_an_energy(void **state) {
    (void)state;
    for (int b = 0; b < BODIES; b++) {
        const pal_model *m = model[b];
        double aside = 0, worst = 0, slope = 0, across = 0;
        uint64_t random = 3;
        int count = 0;
        for (int k = 0; k < 12; k++) {
            hand h;
            take(&h, m, 0.004, 0, 0);
            double spacing = law_of(&h)->spacing, radius = spacing * (1 + 2 * uniform(&random));
            double depth = radius * (0.1 + 0.3 * uniform(&random)), out[3], in[3], e[2][3];
            pal_engine_free(h.engine);
            take(&h, m, radius, 0, 0);
            const double *x[2], *n[2];
            two_places(m, spacing, &random, x, n);
            along(x[0], radius + 0.5 * spacing, n[0], out);
            along(x[0], radius - depth, n[0], in);
            along(STILL, 1, n[0], e[1]);
            int c = fabs(n[0][0]) < 0.6 ? 0 : 1;
            memset(e[0], 0, sizeof e[0]);
            e[0][c] = 1;
            along(e[0], -n[0][c], n[0], e[0]);
            double l = sqrt(v3_dot(e[0], e[0]));
            for (int i = 0; i < 3; i++) {
                e[0][i] /= l;
            }
            for (int i = 0; i < 3; i++) {
                e[1][i] =
                    n[0][(i + 1) % 3] * e[0][(i + 2) % 3] - n[0][(i + 2) % 3] * e[0][(i + 1) % 3];
            }
            for (int d = 0; d < 9; d++) {
                double a = 0.785398 * d, to[3], done;
                pal_engine_reset(h.engine);
                place(&h, out, STILL, 1);
                go(&h, in, STILL, 100);
                double before = energy(&h), force = sqrt(v3_dot(h.force, h.force));
                if (!(force > 0)) {
                    continue;
                }
                for (int i = 0; i < 3; i++) {
                    to[i] = d < 8 ? in[i] + spacing * (cos(a) * e[0][i] + sin(a) * e[1][i])
                                  : in[i] + 0.2 * depth * n[0][i];
                }
                h.work = 0;
                go(&h, to, STILL, 100);
                done = energy(&h) - before;
                if (d == 8) {
                    across = fmax(across, fabs(h.work / done - 1));
                    continue;
                }
                double error = fabs(h.work - done) / (spacing * force);
                aside += error;
                slope += fabs(done) / (spacing * force);
                worst = fmax(worst, error);
                count++;
            }
            pal_engine_free(h.engine);
        }
        print_message(
            "  %s: sideways the energy rises by %.2f %% of the force in the mean; the "
            "force is off that by %.2f %%, at most %.2f %%; across the surface by %.1f %%\n",
            NAME[b], 100 * slope / count, 100 * aside / count, 100 * worst, 100 * across);
        assert_true(count > 60);
        assert_true(aside / count < 0.006); // before: 3.98 % on the block, 1.86 % on the organ
        assert_true(worst < 0.07);          // points that fade at the rim; before: 8, 38, 26 %
        assert_true(across <
                    0.05); // the calibrated points' force is Hertz's, their z.h / 2 2 % off
    }
}

/// A ball around the whole body cannot be felt; it says so in every tick, and no more once it came
/// in from outside.
static void a_tool_that_began_inside_says_so(void **state) {
    (void)state;
    for (int b = 0; b < BODIES; b++) {
        const pal_model *m = model[b];
        hand h;
        pal_tool_force out;
        pal_engine_counts counts;
        take(&h, m, 0.3, 0, 0);
        for (int k = 0; k < 5; k++) {
            pal_tool_state in = {.orientation = {1, 0, 0, 0}};
            for (int i = 0; i < 3; i++) {
                in.position[i] = 0.5 * (m->info.bounds_min[i] + m->info.bounds_max[i]);
            }
            (void)pal_engine_force(h.engine, &in, &out);
            assert_true(v3_dot(out.force, out.force) == 0);
            assert_true(out.fault == PALPATE_FAULT_UNFELT);
        }
        pal_engine_get_counts(h.engine, &counts);
        assert_int_equal(counts.fault[13], 5);
        assert_int_equal(counts.events, 1);
        pal_engine_free(h.engine);
        take(&h, m, 0.004, 0, 0);
        const double *x = m->position + 3 * (size_t)m->column_node[m->info.column_count / 2],
                     *n = m->normal + 3 * (size_t)m->column_node[m->info.column_count / 2];
        for (int k = 0; k <= 40; k++) {
            pal_tool_state in = {.orientation = {1, 0, 0, 0}};
            along(x, 0.005 - 1e-4 * k, n, in.position);
            (void)pal_engine_force(h.engine, &in, &out);
            assert_true((out.fault & PALPATE_FAULT_UNFELT) == 0);
        }
        pal_engine_free(h.engine);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(closed_paths_return_what_they_took),
        cmocka_unit_test(force_is_the_slope_of_an_energy),
        cmocka_unit_test(a_tool_that_began_inside_says_so),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
