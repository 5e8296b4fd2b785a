/// The output stage: finite check, slew, cap and torque cap, on vectors, with counters' values.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <float.h>
#include <math.h>
#include <string.h>

#include "haptic/safety/output.h"

static pal_tool_force make(double x, double y, double z, double torque) {
    return (pal_tool_force){.force = {x, y, z}, .torque = {0, torque, 0}};
}

static double norm(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/// 0 is never "no limit": it is the device's maximum, or the default where that is unknown.
static void limits_come_from_the_device_and_are_never_absent_by_omission(void **state) {
    (void)state;
    const pal_device_spec unknown = {.max_force = 0};
    const pal_device_spec touch = {.max_force = 2.5, .max_torque = 0.05};
    const pal_tool_limits zero = {0}, some = {.force = 1.0, .slew = 0.5, .torque = 0.01};
    const pal_tool_limits much = {.force = 50.0, .slew = 1e4, .torque = 10.0};
    const pal_tool_limits none = {INFINITY, INFINITY, INFINITY};
    const struct {
        const pal_tool_limits *asked;
        const pal_device_spec *spec;
        pal_tool_limits expect;
    } t[] = {
        {&zero, &unknown, {PALPATE_DEFAULT_FORCE, PALPATE_DEFAULT_SLEW, PALPATE_DEFAULT_TORQUE}},
        {&zero, &touch, {2.5, PALPATE_DEFAULT_SLEW, 0.05}},
        {&some, &unknown, {1.0, 0.5, 0.01}},
        {&some, &touch, {1.0, 0.5, 0.01}},
        {&much, &unknown, {50.0, 1e4, 10.0}},
        {&much, &touch, {2.5, 1e4, 0.05}}, // the device's, whatever the scene asks
        {&none, &unknown, {INFINITY, INFINITY, INFINITY}},
        {&none, &touch, {2.5, INFINITY, 0.05}},
    };
    for (size_t i = 0; i < sizeof t / sizeof *t; i++) {
        pal_tool_limits l = pal_limits_resolve(t[i].asked, t[i].spec);
        assert_true(l.force == t[i].expect.force && l.slew == t[i].expect.slew &&
                    l.torque == t[i].expect.torque);
    }
    const pal_device_spec a = {.name = "scene", .max_force = 3.0, .max_speed = 2.0, .damping = 0.1};
    const pal_device_spec b = {.max_force = 5.0, .max_stiffness = 900.0, .max_damping = 2.0};
    pal_device_spec m = pal_spec_merge(&a, &b);
    assert_string_equal(m.name, "scene");
    assert_true(m.max_force == 3.0 && m.max_speed == 2.0 && m.max_stiffness == 900.0 &&
                m.max_damping == 2.0 && m.max_torque == 0.0 && m.damping == 0.1);
}

static void no_limit_changes_nothing(void **state) {
    (void)state;
    pal_output o;
    pal_tool_limits none = {INFINITY, INFINITY, INFINITY};
    double value[32] = {0};
    pal_output_init(&o, &none, 1e-3);
    pal_tool_force f = make(1e5, -2e5, 3e5, 1e4), g = f;
    assert_int_equal(pal_output_apply(&o, &f, value), 0);
    assert_memory_equal(&f, &g, sizeof f);
}

static void not_a_number_becomes_zero(void **state) {
    (void)state;
    static const double bad[] = {NAN, INFINITY, -INFINITY};
    for (int k = 0; k < 12; k++) {
        pal_output o;
        pal_tool_limits limits = {.force = 3.3, .slew = 100, .torque = 0.1};
        double value[32] = {0};
        pal_output_init(&o, &limits, 1e-3);
        pal_tool_force f = make(1, 2, 3, 0.01);
        if (k < 9) {
            f.force[k / 3] = bad[k % 3];
        } else {
            f.torque[k % 3] = bad[k % 3];
        }
        assert_int_equal(pal_output_apply(&o, &f, value), PALPATE_FAULT_FORCE);
        assert_int_equal(f.fault, PALPATE_FAULT_FORCE);
        assert_true(norm(f.force) == 0.0 && norm(f.torque) == 0.0);
    }
}

static void cap_keeps_the_direction_even_of_the_largest_number(void **state) {
    (void)state;
    static const double size[] = {3.4, 1e3, 1e200, DBL_MAX / 2};
    for (int k = 0; k < 4; k++) {
        pal_output o;
        pal_tool_limits limits = {.force = 3.3, .slew = INFINITY, .torque = 0.1};
        double value[32] = {0};
        pal_output_init(&o, &limits, 1e-3);
        pal_tool_force f = make(0.6 * size[k], 0, -0.8 * size[k], -size[k]);
        assert_int_equal(pal_output_apply(&o, &f, value),
                         PALPATE_FAULT_CAP | PALPATE_FAULT_TORQUE_CAP);
        assert_true(fabs(norm(f.force) - 3.3) < 1e-12);
        assert_true(fabs(f.force[0] - 0.6 * 3.3) < 1e-12 && fabs(f.force[2] + 0.8 * 3.3) < 1e-12);
        assert_true(fabs(f.torque[1] + 0.1) < 1e-14);
        assert_true(fabs(value[4] / size[k] - 1.0) < 1e-12); // what it would have been
        assert_true(fabs(value[7] / size[k] - 1.0) < 1e-12);
    }
}

static void slew_limits_the_vector_change(void **state) {
    (void)state;
    pal_output o;
    pal_tool_limits limits = {.force = 3.3, .slew = 0.1, .torque = INFINITY};
    double value[32] = {0}, last[3] = {0};
    pal_output_init(&o, &limits, 2e-3); // 0.1 N/ms over 2 ms: 0.2 N a tick
    for (int k = 0; k < 60; k++) {      // jumps to and fro, beyond the cap
        double x = (k / 20) % 2 ? -5.0 : 5.0;
        pal_tool_force f = make(x, 0.3 * x, 0, 0);
        uint32_t fault = pal_output_apply(&o, &f, value);
        double change[3];
        for (int i = 0; i < 3; i++) {
            change[i] = f.force[i] - last[i];
            last[i] = f.force[i];
        }
        // cutting at the cap moves two points closer, never apart
        assert_true(norm(change) <= 0.2 * (1 + 1e-12));
        assert_true(norm(f.force) <= 3.3 * (1 + 1e-12));
        assert_true(fault & PALPATE_FAULT_SLEW); // 5.2 N is never within 0.2 N of the cap
    }
    pal_output_reset(&o);
    pal_tool_force f = make(0.15, 0, 0, 0);
    assert_int_equal(pal_output_apply(&o, &f, value), 0); // from zero again
    assert_true(f.force[0] == 0.15);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(limits_come_from_the_device_and_are_never_absent_by_omission),
        cmocka_unit_test(no_limit_changes_nothing),
        cmocka_unit_test(not_a_number_becomes_zero),
        cmocka_unit_test(cap_keeps_the_direction_even_of_the_largest_number),
        cmocka_unit_test(slew_limits_the_vector_change),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
