/// The simulated device's mechanics against closed forms, the passivity observer against analytic
/// energies, and the two together against the sampled-data bound b > K T / 2 + |B|.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <palpate/session.h>

#include "haptic/safety/passivity.h"
#include "haptic/device/simulated.h"

static const double pi = 3.14159265358979323846;

// ---- One axis ----------------------------------------------------------------------------------

/// Damped oscillator towards a moving reference r = r0 + s t under a constant force: the particular
/// solution is a straight line, the rest decays; underdamped, critical and overdamped.
static void an_axis_follows_the_closed_form(void **state) {
    (void)state;
    const double m = 0.6, k = 135.0, force = 0.7, r0 = 0.02, s = 0.05;
    const double damping[] = {0.5, 6.0, 2.0 * sqrt(0.6 * 135.0), 60.0};
    for (size_t i = 0; i < 4; i++) {
        double b = damping[i], bh = 0.9 * b;
        pal_axis a = {.mass = m, .damping = b, .stiffness = k, .hand_damping = bh};
        double x[2] = {0.01, -0.1};
        double line0 = r0 + (force + (bh - b) * s) / k; // k (x - r) = F + b_h s - b s
        double y0 = x[0] - line0, v0 = x[1] - s, g = 0.5 * b / m, w2 = k / m - g * g, t = 0.0;
        for (int n = 0; n < 400; n++) {
            pal_axis_advance(&a, 1e-3, force, r0 + s * t, s, x);
            t = (n + 1) * 1e-3;
            double c, sn;
            if (fabs(w2) < 1e-9) {
                c = 1.0;
                sn = t;
            } else if (w2 > 0) {
                c = cos(sqrt(w2) * t);
                sn = sin(sqrt(w2) * t) / sqrt(w2);
            } else {
                c = cosh(sqrt(-w2) * t);
                sn = sinh(sqrt(-w2) * t) / sqrt(-w2);
            }
            double y = exp(-g * t) * (y0 * (c + g * sn) + v0 * sn);
            double v = exp(-g * t) * (v0 * (c - g * sn) - k / m * y0 * sn);
            // 400 steps, each exact to some 1e-16 of 0.1 m and 1 m/s
            assert_true(fabs(x[0] - (line0 + s * t + y)) < 1e-14);
            assert_true(fabs(x[1] - (s + v)) < 1e-13);
        }
    }
}

/// One long step is as good as many short ones, and a free mass flies straight.
static void steps_add_up(void **state) {
    (void)state;
    pal_axis a = {.mass = 0.05, .damping = 20.0, .stiffness = 900.0, .hand_damping = 5.0};
    double one[2] = {0.0, 0.3}, many[2] = {0.0, 0.3};
    pal_axis_advance(&a, 0.2, -1.0, 0.01, 0.2, one);
    for (int n = 0; n < 1000; n++) {
        pal_axis_advance(&a, 2e-4, -1.0, 0.01 + 0.2 * n * 2e-4, 0.2, many);
    }
    assert_true(fabs(one[0] - many[0]) < 1e-15 && fabs(one[1] - many[1]) < 1e-13);
    pal_axis free_mass = {.mass = 0.05};
    double x[2] = {1.0, 2.0};
    pal_axis_advance(&free_mass, 0.5, 0.1, 0.0, 0.0, x);
    assert_true(fabs(x[0] - (1.0 + 1.0 + 0.5 * 2.0 * 0.25)) < 1e-15 && fabs(x[1] - 3.0) < 1e-15);
}

/// Coulomb friction: a sliding mass stops at v^2 m / 2 c, and stays; a spring's swing loses 2 c / k
/// per half turn and ends inside the dead band |k x| <= c; a pulled one starts when the spring
/// reaches c.
static void friction_stops_and_holds(void **state) {
    (void)state;
    pal_axis sliding = {.mass = 0.05, .friction = 0.26};
    double x[2] = {0.0, 0.5};
    for (int n = 0; n < 200; n++) {
        pal_axis_advance(&sliding, 1e-3, 0.0, 0.0, 0.0, x);
    }
    assert_true(fabs(x[0] - 0.5 * 0.05 * 0.25 / 0.26) < 1e-15); // rounding of 25 mm
    assert_true(x[1] == 0.0);
    pal_axis_advance(&sliding, 1e-3, 0.259, 0.0, 0.0, x);
    assert_true(x[1] == 0.0); // held
    pal_axis_advance(&sliding, 1e-3, -0.3, 0.0, 0.0, x);
    assert_true(fabs(x[1] - -0.04 / 0.05 * 1e-3) < 1e-17);

    // the swing of a spring: centre shifts by c / k against the motion
    const double k = 200.0, c = 0.26, m = 0.05;
    pal_axis swing = {.mass = m, .stiffness = k, .friction = c};
    double y[2] = {0.02, 0.0}, half = pi * sqrt(m / k), amplitude = 0.02;
    for (int turn = 0; turn < 6; turn++) {
        pal_axis_advance(&swing, half, 0.0, 0.0, 0.0, y);
        amplitude -= 2.0 * c / k;
        assert_true(fabs(fabs(y[0]) - amplitude) < 1e-14); // rounding of a few steps
        assert_true(fabs(y[1]) < 1e-13);
    }
    pal_axis_advance(&swing, 5.0, 0.0, 0.0, 0.0, y);
    assert_true(y[1] == 0.0 && fabs(k * y[0]) <= c);

    pal_axis pulled = {.mass = m, .stiffness = k, .friction = c};
    double p[2] = {0.0, 0.0}; // reference leaves at 0.1 m/s: breaks away at c / (k 0.1) = 13 ms
    double wait = c / (k * 0.1), w = sqrt(k / m), t = 0.05;
    for (int n = 0; n < 50; n++) {
        pal_axis_advance(&pulled, 1e-3, 0.0, 0.1 * n * 1e-3, 0.1, p);
        assert_true(n * 1e-3 + 1e-3 > wait || p[0] == 0.0);
    }
    // m x'' + k x = k 0.1 t - c from rest at t = wait: x = 0.1 (tau - sin(w tau) / w)
    assert_true(fabs(p[0] - 0.1 * ((t - wait) - sin(w * (t - wait)) / w)) < 1e-14);
}

// ---- The device ---------------------------------------------------------------------------------

static pal_tool_def make_tool(pal_simulated simulated) {
    pal_tool_def t = {.name = "probe",
                      .shape = PALPATE_SHAPE_SPHERE,
                      .radius = 0.004,
                      .has_start = 1,
                      .axis = {0, 0, -1}};
    t.device.kind = PALPATE_DEVICE_SIMULATED;
    t.device.stroke = (pal_stroke){.ramp = 0.5, .period = 1.0, .direction = {1, 0, 0}};
    t.device.simulated = simulated;
    return t;
}

static pal_device make(const pal_tool_def *tool, double period) {
    pal_device d;
    pal_error e = {0};
    if (pal_device_create(tool, period, &d, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    return d;
}

static pal_tool_state at(const pal_device *d, int64_t tick, double period) {
    pal_tool_state s;
    assert_int_equal(d->read(d->self, llround((double)tick * period * 1e9), &s), PALPATE_OK);
    return s;
}

static void push(const pal_device *d, double x, double y, double z) {
    pal_tool_force f = {.force = {x, y, z}};
    assert_int_equal(d->write(d->self, 0, &f), PALPATE_OK);
}

/// A mass without friction under a held force, read after gaps of any length: v t + F t^2 / 2m.
static void the_force_is_held_between_ticks(void **state) {
    (void)state;
    pal_simulated s = pal_simulated_default(PALPATE_SIMULATED_TOUCH, PALPATE_GRIP_NONE);
    s.damping = s.friction = s.resolution = 0.0;
    s.kick = -0.1; // upwards: the axis points down
    pal_tool_def t = make_tool(s);
    pal_device d = make(&t, 1e-3);
    assert_true(at(&d, 0, 1e-3).position[2] == 0.0);
    push(&d, 0.0, 0.09, 0.0);
    assert_true(fabs(at(&d, 7, 1e-3).position[2] - 7e-4) < 1e-17); // six periods were missed
    assert_true(fabs(at(&d, 7, 1e-3).position[1] - 0.5 * 2.0 * 49e-6) < 1e-17);
    push(&d, 0.0, -40.0, 0.0); // actuators give 3.3 N
    double y1 = 49e-6, v1 = 2.0 * 7e-3;
    assert_true(fabs(at(&d, 17, 1e-3).position[1] - (y1 + v1 * 0.01 - 0.5 * 3.3 / 0.045 * 1e-4)) <
                1e-15);
    push(&d, 0.0, NAN, 0.0); // no force at all
    double before = at(&d, 17, 1e-3).position[1], v2 = v1 - 3.3 / 0.045 * 0.01;
    assert_true(fabs(at(&d, 18, 1e-3).position[1] - (before + v2 * 1e-3)) < 1e-15);
    assert_true(at(&d, 4000, 1e-3).position[2] == 0.08); // flew to its stop
    assert_true(at(&d, 0, 1e-3).position[2] == 0.0);     // time began anew
    d.close(d.self);
}

static void encoders_have_steps(void **state) {
    (void)state;
    pal_simulated s = pal_simulated_default(PALPATE_SIMULATED_TOUCH, PALPATE_GRIP_NONE);
    s.kick = 0.1;
    pal_tool_def t = make_tool(s);
    pal_device d = make(&t, 1e-3);
    int seen = 0;
    for (int n = 0; n < 50; n++) {
        double z = at(&d, n, 1e-3).position[2], count = z / 5.5e-5;
        assert_true(fabs(count - nearbyint(count)) < 1e-9);
        seen += z < 0.0;
    }
    assert_true(seen > 40);
    assert_true(d.spec.resolution == 5.5e-5 && d.spec.max_force == 3.3 && d.spec.damping == 0.1);
    d.close(d.self);
}

/// The hand brings the device where it intends to within what friction holds back, and lets go.
static void the_hand_follows_and_lets_go(void **state) {
    (void)state;
    pal_simulated s = pal_simulated_default(PALPATE_SIMULATED_TOUCH, PALPATE_GRIP_FIRM);
    s.release = 3.0;
    s.grasp = 2.5;
    pal_tool_def t = make_tool(s);
    t.device.stroke.depth = 0.01;
    pal_device d = make(&t, 1e-3);
    pal_tool_state p = {0};
    for (int n = 0; n <= 2900; n++) {
        p = at(&d, n, 1e-3);
        assert_int_equal(p.buttons, n >= 2500);
    }
    assert_true(fabs(p.position[2] + 0.01) <= s.friction / s.hand_stiffness + s.resolution);
    double held = p.position[2];
    push(&d, 0, 0, 0.5); // 0.24 N above friction: 1.8 mm against the spring, then free
    for (int n = 2901; n <= 2999; n++) {
        p = at(&d, n, 1e-3);
    }
    assert_true(p.position[2] > held && p.position[2] < held + 0.004);
    for (int n = 3000; n <= 3300; n++) {
        p = at(&d, n, 1e-3);
    }
    assert_true(p.position[2] > held + 0.05); // 5 m/s^2 for 0.3 s
    d.close(d.self);
}

static void what_cannot_be_simulated_is_refused(void **state) {
    (void)state;
    pal_device d;
    for (int i = 0; i < 12; i++) {
        pal_simulated s = pal_simulated_default(PALPATE_SIMULATED_PREMIUM, PALPATE_GRIP_FIRM);
        double *value[] = {&s.mass,  &s.mass,         &s.damping,        &s.friction,
                           &s.force, &s.reach,        &s.resolution,     &s.hand_mass,
                           &s.kick,  &s.hand_damping, &s.hand_stiffness, &s.push};
        const double wrong[] = {0.0, NAN,  -1.0, INFINITY, -1.0, 0.0,
                                1.0, -0.1, 99.0, -1.0,     1e7,  NAN};
        *value[i] = wrong[i];
        pal_tool_def t = make_tool(s);
        pal_error e = {0};
        assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
        assert_non_null(strstr(e.message, "probe"));
    }
    pal_simulated s = pal_simulated_default(PALPATE_SIMULATED_TOUCH, PALPATE_GRIP_NONE);
    s.mass = 1e-3;
    s.damping = 1e3; // 1e6 1/s at 1 kHz
    pal_tool_def t = make_tool(s);
    pal_error e = {0};
    assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "damping"));
    t = make_tool(pal_simulated_default(PALPATE_SIMULATED_TOUCH, PALPATE_GRIP_NONE));
    t.has_start = 0;
    assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
}

// ---- The observer -------------------------------------------------------------------------------

/// What damping of the device just covers what a wall F = -K x - B (x - x_before) / T returns, when
/// the device moves linearly between samples of a sine (the least it can dissipate): Colgate and
/// Schenkel's b(w) = T Re{(1 - z^-1) H} / (2 (1 - cos w T)) = K T / 2 - B cos w T.
static double damping_needed(double K, double B, double T, double wT, int ticks) {
    pal_passivity p = {0};
    double moved = 0.0, before = sin(-wT);
    for (int n = 0; n <= ticks; n++) {
        double x[3] = {sin(wT * n), 0.0, 0.0};
        double f[3] = {-K * x[0] - B * (x[0] - before) / T, 0.0, 0.0};
        (void)pal_passivity_tick(&p, x, f);
        moved += n > 0 ? (x[0] - before) * (x[0] - before) : 0.0;
        before = x[0];
    }
    return (p.given - p.taken) / (moved / T);
}

static void the_observer_finds_colgates_damping(void **state) {
    (void)state;
    const double K = 800.0, T = 1e-3;
    const double dampings[] = {0.0, 0.15, -0.2};
    for (size_t i = 0; i < 3; i++) {
        double B = dampings[i], worst = -INFINITY;
        for (int n = 1; n <= 32; n++) { // whole turns: 64 ticks hold n of them
            double wT = pi * n / 32.0;
            if (n == 32) {
                wT -= pi / 64.0; // at pi every sample of the sine is 0
            }
            int ticks = n == 32 ? 128 : 64;
            double b = damping_needed(K, B, T, wT, ticks);
            // 64 terms of size K A^2, divided by a sum that is at least 1e-2 of theirs
            assert_true(fabs(b - (0.5 * K * T - B * cos(wT))) < 1e-11);
            worst = fmax(worst, b);
        }
        double bound = 0.5 * K * T + fabs(B);
        assert_true(worst <= bound + 1e-11); // never above the bound
        assert_true(worst > bound - fabs(B) * (1.0 - cos(pi / 32.0)) - 1e-11); // and it is reached
    }
}

static void the_observer_keeps_the_books(void **state) {
    (void)state;
    pal_passivity p = {0};
    const double x0[3] = {0, 0, 0}, x1[3] = {0.01, 0, 0}, bad[3] = {NAN, 0, 0};
    const double up[3] = {2, 0, 0}, down[3] = {-3, 0, 0};
    assert_true(pal_passivity_tick(&p, x0, up) == 0.0);
    assert_true(fabs(pal_passivity_tick(&p, x1, up) - 0.02) < 1e-17);
    assert_true(fabs(pal_passivity_tick(&p, x0, down) + 0.02) < 1e-17);
    assert_true(fabs(pal_passivity_mark(&p)) < 1e-17);
    assert_true(fabs(pal_passivity_tick(&p, x1, down) + 0.03) < 1e-17);
    assert_true(fabs(p.worst - 0.02) < 1e-17 && fabs(p.taken - 0.05) < 1e-17);
    assert_true(fabs(pal_passivity_mark(&p) + 0.03) < 1e-17);
    assert_true(pal_passivity_tick(&p, bad, down) == 0.0);
    assert_true(pal_passivity_tick(&p, x0, down) == 0.0); // the jump over it is not counted
    assert_true(isfinite(p.given) && isfinite(p.taken));
}

// ---- Both: the bound ----------------------------------------------------------------------------

/// 1 when a device without friction, kicked at a bilateral wall of stiffness K, calms down.
static int calms(double K, double m, double b, double T) {
    pal_simulated s = {.mass = m, .damping = b, .force = 1e4, .reach = 1e3, .kick = 0.1};
    pal_tool_def t = make_tool(s);
    pal_device d = make(&t, T);
    // near the limit the swing changes by 1 part in 1e5 over a turn: long enough to tell
    const int ticks = (int)(400.0 * m / b / T);
    double early = 0.0, late = 0.0;
    for (int n = 0; n < ticks && late < 0.1; n++) { // 0.1 m: it flies
        double z = at(&d, n, T).position[2];
        late = fabs(z) >= 0.1 ? fabs(z) : late;
        push(&d, 0.0, 0.0, -K * z);
        early = n < ticks / 4 ? fmax(early, fabs(z)) : early;
        late = n >= ticks - ticks / 4 ? fmax(late, fabs(z)) : late;
    }
    d.close(d.self);
    return late < early;
}

static double largest_stiffness(double m, double b, double T) {
    double low = 0.0, high = 8.0 * b / T;
    assert_false(calms(high, m, b, T));
    for (int i = 0; i < 16; i++) {
        double K = 0.5 * (low + high);
        if (calms(K, m, b, T)) {
            low = K;
        } else {
            high = K;
        }
    }
    return 0.5 * (low + high);
}

/// Largest stable stiffness without a hand: where the determinant of the tick's map reaches 1,
///     K [(1 - e)^2 / (a b) - e g] = 1 - e,   a = b / m, e = exp(-a T), g = (T - (1 - e) / a) / b,
/// which tends to the bound 2 b / T with order 1 in T.
static void the_largest_stiffness_tends_to_the_bound(void **state) {
    (void)state;
    const double m = 0.05, b = 2.0;
    double error[3];
    for (int i = 0; i < 3; i++) {
        double T = 2e-3 / (1 << i), a = b / m, e = exp(-a * T), g = (T - (1.0 - e) / a) / b;
        double exact = (1.0 - e) / ((1.0 - e) * (1.0 - e) / (a * b) - e * g);
        double K = largest_stiffness(m, b, T);
        print_message("T %.2g ms: K %.1f N/m, determinant says %.1f, 2 b / T = %.1f\n", 1e3 * T, K,
                      exact, 2.0 * b / T);
        // the search ends at 8 (2 b / T) / 2^17 and stops telling swings that change by 1e-5
        assert_true(fabs(K / exact - 1.0) < 1e-3);
        error[i] = fabs(K * T / (2.0 * b) - 1.0);
    }
    for (int i = 0; i < 2; i++) {
        double order = log2(error[i] / error[i + 1]);
        print_message("order %.3f\n", order);
        assert_true(order > 0.9 && order < 1.1);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_axis_follows_the_closed_form),
        cmocka_unit_test(steps_add_up),
        cmocka_unit_test(friction_stops_and_holds),
        cmocka_unit_test(the_force_is_held_between_ticks),
        cmocka_unit_test(encoders_have_steps),
        cmocka_unit_test(the_hand_follows_and_lets_go),
        cmocka_unit_test(what_cannot_be_simulated_is_refused),
        cmocka_unit_test(the_observer_finds_colgates_damping),
        cmocka_unit_test(the_observer_keeps_the_books),
        cmocka_unit_test(the_largest_stiffness_tends_to_the_bound),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
