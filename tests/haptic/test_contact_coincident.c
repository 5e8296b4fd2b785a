/// Law "surface" where contact points coincide: tools in one place, a capsule on end. Two points at
/// one place have the same row in the half-space's part of the compliance, which alone would be
/// singular.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>

#include <cmocka.h>

#include "tests/support/engine_rig.h"

static const double RADIUS = 0.004;
static const uint32_t SOLVER = PALPATE_FAULT_SINGULAR | PALPATE_FAULT_CUTOFF;

static void tools_in_one_place_share_the_force(void **state) {
    (void)state;
    static const struct {
        double mu, stiffness;
        int closes;
    } cases[] = {{0, 0, 0}, {0, 500, 0}, {0.4, 0, 0}, {0.4, 500, 0}, {0, 0, 1}, {0.4, 500, 1}};
    for (size_t c = 0; c < sizeof cases / sizeof cases[0]; c++) {
        double force[3][3] = {{0}};
        for (int count = 1; count <= 2; count++) {
            rig r;
            rig_model(&r, 15, PALPATE_PRECISION_SINGLE, 0);
            r.tools[0].friction = cases[c].mu;
            // of two couplings side by side each has half the stiffness, to press as deep
            r.tools[0].coupling_stiffness = cases[c].stiffness / count;
            r.tools[0].coupling_damping = cases[c].stiffness > 0 ? 1.0 / count : 0;
            r.tools[1] = r.tools[0];
            r.def.tool_count = count;
            rig_engine(&r);
            pal_tool_force out[2];
            for (int k = 0; k <= 150; k++) { // pressed, then moved aside
                double depth = k < 100 ? 1e-5 * k : 1e-3, x = k < 100 ? 0 : 1e-6 * (k - 100);
                pal_tool_state in[2] = {rig_state(x + 0.0003, 0.0002, RADIUS - depth),
                                        rig_state(x + 0.0003, 0.0002, RADIUS - depth)};
                in[0].buttons = in[1].buttons = cases[c].closes && k >= 100;
                uint32_t fault = pal_engine_tick(r.engine, in, out);
                assert_int_equal(fault & SOLVER, 0);
            }
            for (int i = 0; i < 3; i++) {
                force[count][i] = out[0].force[i] + (count > 1 ? out[1].force[i] : 0);
            }
            rig_free(&r);
        }
        print_message("  mu %.1f, coupling %3.0f N/m, %s: one tool %.4f N, two %.4f N\n",
                      cases[c].mu, cases[c].stiffness, cases[c].closes ? "closed" : "open",
                      force[1][2], force[2][2]);
        assert_true(force[1][2] > 0.01);
        // two in one place press as one: the points' own compliance differs by half of 1 %
        assert_true(fabs(force[2][2] / force[1][2] - 1) < 0.01);
    }
}

/// All its stations stand over one place; the deepest, its tip, presses like a ball.
static void a_capsule_on_end_presses_like_its_tip(void **state) {
    (void)state;
    for (int c = 0; c < 8; c++) {
        double length = c % 4 * 0.002, force[2];
        for (int capsule = 0; capsule < 2; capsule++) {
            rig r;
            rig_model(&r, 15, PALPATE_PRECISION_SINGLE, 0);
            r.tools[0].shape = capsule ? PALPATE_SHAPE_CAPSULE : PALPATE_SHAPE_SPHERE;
            r.tools[0].length = capsule ? length : 0;
            r.tools[0].friction = c < 4 ? 0 : 0.4;
            r.def.contact_points = capsule ? 16 : 6; // 6 at either end
            rig_engine(&r);
            pal_tool_force out = {0};
            for (int k = 0; k <= 400; k++) {
                out = rig_tick(&r, 0, 0, RADIUS + capsule * length / 2 - 1e-5 * k);
                assert_int_equal(out.fault & SOLVER, 0);
            }
            force[capsule] = out.force[2];
            rig_free(&r);
        }
        print_message("  %.0f mm long: %.4f N, a ball %.4f N\n", 1e3 * length, force[1], force[0]);
        // the stations above the tip carry a little where they overlap the body too
        assert_true(force[1] > 0.97 * force[0] && force[1] < 1.1 * force[0]);
    }
}

/// Lying, all its stations touch; on end in the next tick, those deeper than the clip of the
/// pattern's radius are one point several times.
static void a_capsule_turned_on_end_keeps_its_force(void **state) {
    (void)state;
    for (int c = 0; c < 2; c++) {
        rig r;
        rig_model(&r, 15, PALPATE_PRECISION_SINGLE, 0);
        r.tools[0].shape = PALPATE_SHAPE_CAPSULE;
        r.tools[0].radius = 0.002;
        r.tools[0].length = 0.006;
        r.tools[0].friction = c * 0.4;
        rig_engine(&r);
        pal_tool_force out = {0};
        for (int k = 0; k < 100; k++) {
            pal_tool_state in = rig_state(0, 0, 0.001);
            if (k < 50) {
                in.orientation[0] = in.orientation[1] = sqrt(0.5); // z onto -y
            }
            (void)pal_engine_tick(r.engine, &in, &out);
            assert_int_equal(out.fault & SOLVER, 0);
            assert_true(out.force[2] > 0.05);
        }
        rig_free(&r);
    }
}

/// Pressed deep and aslant, dragged, then at rest: a station may lose its force to its neighbours.
static void a_stuck_capsule_at_rest_has_a_constant_force(void **state) {
    (void)state;
    for (int c = 0; c < 12; c++) {
        rig r;
        double half = 0.1 + 0.1 * (c % 4), radius = 0.004, deep = (1.1 + 0.15 * (c / 4)) * radius;
        rig_model(&r, 15, PALPATE_PRECISION_SINGLE, 0);
        r.tools[0].shape = PALPATE_SHAPE_CAPSULE;
        r.tools[0].radius = radius;
        r.tools[0].length = 0.005;
        r.tools[0].friction = 0.85;
        rig_engine(&r);
        pal_tool_force out = {0}, last;
        double worst = 0;
        for (int k = 0; k < 500; k++) {
            double u = k < 300 ? k / 300.0 : 1;
            pal_tool_state in = rig_state(0.001 * u, 0.0015 * u, radius - deep * u);
            in.orientation[0] = cos(half);
            in.orientation[1] = sin(half);
            last = out;
            (void)pal_engine_tick(r.engine, &in, &out);
            for (int i = 0; i < 3 && k >= 450; i++) {
                worst = fmax(worst, fabs(out.force[i] - last.force[i]));
            }
        }
        print_message("  %.1f rad, %.1f mm deep: %.4f N, changes by %.1e N\n", 2 * half, 1e3 * deep,
                      out.force[2], worst);
        assert_true(out.force[2] > 0.1);
        assert_true(worst < 1e-6 * out.force[2]); // the layout has settled in the 150 ticks before
        rig_free(&r);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(tools_in_one_place_share_the_force),
        cmocka_unit_test(a_capsule_on_end_presses_like_its_tip),
        cmocka_unit_test(a_capsule_turned_on_end_keeps_its_force),
        cmocka_unit_test(a_stuck_capsule_at_rest_has_a_constant_force),
    };
    return cmocka_run_group_tests_name("contact_coincident", tests, rig_surface_law, rig_nodes_law);
}
