/// The watchdog: what is stale, stalled or jumping is felt as nothing, comes back gently, and
/// latches.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/engine/engine.h"
#include "haptic/safety/watchdog.h"
#include "tests/support/synthetic_model.h"

static pal_engine *engine;
static pal_model *model;
static pal_tool_def tool;
static pal_tool_state state_in;
static pal_tool_force out;
static double steady; ///< force of the press without a fault [N]

static uint32_t tick(void) {
    state_in.time_ns += state_in.time_ns != 0 ? 1000000 : 0;
    return pal_engine_force(engine, &state_in, &out);
}

static double size(void) {
    return sqrt(out.force[0] * out.force[0] + out.force[1] * out.force[1] +
                out.force[2] * out.force[2]);
}

static int set_up(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    model = synthetic_model(&p);
    tool = pal_model_runtime(model)->tools[0];
    tool.limits = (pal_tool_limits){INFINITY, INFINITY, INFINITY}; // the watchdog alone
    pal_engine_def def = pal_engine_default_def();
    def.tool_count = 1;
    def.tools = &tool;
    if (pal_engine_create(model, &def, &engine, NULL) != PALPATE_OK) {
        return -1;
    }
    state_in = (pal_tool_state){.orientation = {1, 0, 0, 0}, .time_ns = 5000000};
    memcpy(state_in.position, tool.start, sizeof state_in.position);
    state_in.position[2] -= 0.002;
    for (int i = 0; i < 5; i++) {
        if (tick() != 0) {
            return -1;
        }
    }
    steady = size();
    return steady > 0.0 ? 0 : -1;
}

static int tear_down(void **state) {
    (void)state;
    pal_engine_free(engine);
    pal_model_free(model);
    return 0;
}

/// The press is felt as before. 1e-9: a tool that left and came back meets the nodes in another
/// order, which rounds otherwise.
static void expect_steady(void) {
    assert_true(fabs(size() - steady) <= 1e-9 * steady);
}

/// Force is `steady` again after the ramp, which rises by a hundredth a tick. 1e-9: the ramp's
/// sums.
static void expect_ramp_up(void) {
    for (int i = 0; i < 200; i++) {
        double before = size();
        uint32_t fault = tick();
        assert_true(size() - before <= steady * (0.01 + 1e-9));
        if (fault == 0) {
            assert_true(i >= 95);
            expect_steady();
            return;
        }
        assert_int_equal(fault, PALPATE_FAULT_RAMP);
    }
    fail();
}

static void expect_latched(void) {
    pal_engine_counts counts;
    for (int i = 0; i < 300; i++) {
        assert_true(tick() & PALPATE_FAULT_LATCHED);
        assert_true(i < 10 || size() == 0.0);
    }
    pal_engine_get_counts(engine, &counts);
    assert_true(counts.fault[11] >= 300);
    pal_engine_reset(engine);
    assert_int_equal(tick(), 0);
    expect_steady();
}

static void frozen_stamp_fades_and_comes_back(void **state) {
    (void)state;
    for (int i = 1; i <= 60; i++) {
        state_in.time_ns -= 1000000; // stands still
        uint32_t fault = tick();
        assert_int_equal(fault, i >= 20 ? PALPATE_FAULT_STALE : 0);
        assert_true(i >= 20 || size() == steady);
        assert_true(i < 31 || size() == 0.0);
    }
    pal_engine_counts counts;
    pal_engine_get_counts(engine, &counts);
    assert_int_equal(counts.fault[8], 41);
    assert_true(counts.fault_value[8] == 60.0);
    assert_int_equal(counts.fault_tick[8], counts.ticks - 1);
    state_in.time_ns += 60000000;
    expect_ramp_up();
}

static void time_out_of_order_is_stale(void **state) {
    (void)state;
    state_in.time_ns = 1000; // before what was
    uint32_t fault = 0;
    for (int i = 0; i < 20; i++) {
        state_in.time_ns = 1000 - i - 1000000;
        fault = tick();
    }
    assert_int_equal(fault, PALPATE_FAULT_STALE);
}

static void refused_reads_recover_or_latch(void **state) {
    (void)state;
    state_in.flags = PALPATE_STATE_STALE;
    for (int i = 0; i < 500; i++) {
        (void)tick();
    }
    assert_true(size() == 0.0);
    state_in.flags = 0;
    expect_ramp_up();
    state_in.flags = PALPATE_STATE_STALE;
    for (int i = 0; i < 1000; i++) {
        assert_int_equal((tick() & PALPATE_FAULT_LATCHED) != 0, i == 999);
    }
    state_in.flags = 0;
    expect_latched();
}

static void nonsense_is_stale_too(void **state) {
    (void)state;
    double good = state_in.position[0];
    for (int k = 0; k < 2; k++) {
        state_in.position[0] = k == 0 ? (double)NAN : (double)INFINITY;
        uint32_t fault = 0;
        for (int i = 0; i < 40; i++) {
            fault = tick();
            assert_true(isfinite(size()));
        }
        assert_int_equal(fault, PALPATE_FAULT_STALE | PALPATE_FAULT_INPUT);
        assert_true(size() == 0.0);
        state_in.position[0] = good;
        expect_ramp_up();
    }
}

static void teleport_starts_from_zero_and_twice_latches(void **state) {
    (void)state;
    state_in.position[2] += 0.3; // 300 m/s
    assert_int_equal(tick(), PALPATE_FAULT_JUMP);
    for (int i = 0; i < 150; i++) {
        (void)tick();
    }
    state_in.position[2] -= 0.3; // into the body
    assert_int_equal(tick(), PALPATE_FAULT_JUMP);
    assert_true(size() == 0.0);
    expect_ramp_up();
    state_in.position[2] += 0.3;
    assert_int_equal(tick(), PALPATE_FAULT_JUMP);
    state_in.position[2] -= 0.3;
    assert_true(tick() & PALPATE_FAULT_LATCHED);
    expect_latched();
}

static void missed(uint32_t periods) {
    state_in.flags = periods << PALPATE_STATE_MISSED_SHIFT;
}

static void overrun_of_1_10_100_1000_periods(void **state) {
    (void)state;
    missed(1);
    assert_int_equal(tick(), 0);
    missed(10);
    assert_int_equal(tick(), 0);
    assert_true(size() == steady);
    missed(100);
    assert_int_equal(tick(), PALPATE_FAULT_STALL);
    assert_true(size() == 0.0);
    missed(0);
    expect_ramp_up();
    missed(1000);
    assert_int_equal(tick(), PALPATE_FAULT_STALL | PALPATE_FAULT_LATCHED);
    missed(0);
    expect_latched();
}

/// Speed is judged over the time that passed, missed periods included: what a hand did meanwhile is
/// no jump, and what no hand could do still is.
static void motion_over_missed_periods_is_no_jump(void **state) {
    (void)state;
    for (int i = 0; i < 8; i++) { // to and fro at 10 m/s: half of what is a jump
        missed(9);
        state_in.position[2] += i % 2 == 0 ? 0.1 : -0.1;
        assert_int_equal(tick(), 0);
    }
    missed(9);
    state_in.position[2] += 0.3; // 30 m/s
    assert_int_equal(tick(), PALPATE_FAULT_JUMP);
}

/// PALPATE_STATE_UNLATCH lets go what is latched, as long as its cause is over; from zero.
static void a_latch_is_let_go_on_order_only(void **state) {
    (void)state;
    missed(1000);
    assert_true(tick() & PALPATE_FAULT_LATCHED);
    missed(0);
    for (int i = 0; i < 50; i++) {
        assert_true(tick() & PALPATE_FAULT_LATCHED);
    }
    state_in.flags = PALPATE_STATE_UNLATCH;
    assert_int_equal(tick(), PALPATE_FAULT_RAMP);
    assert_true(size() <= steady * (0.01 + 1e-9)); // a hundredth in the first tick
    state_in.flags = 0;
    expect_ramp_up();
    // still stale: latched again in the same tick
    state_in.flags = PALPATE_STATE_STALE;
    for (int i = 0; i < 1100; i++) {
        (void)tick();
    }
    state_in.flags = PALPATE_STATE_STALE | PALPATE_STATE_UNLATCH;
    assert_true(tick() & PALPATE_FAULT_LATCHED);
    state_in.flags = 0;
    assert_true(tick() & PALPATE_FAULT_LATCHED);
    state_in.flags = PALPATE_STATE_UNLATCH;
    assert_int_equal(tick(), PALPATE_FAULT_RAMP);
    // the order does nothing to what is not latched
    state_in.flags = 0;
    expect_ramp_up();
    state_in.flags = PALPATE_STATE_UNLATCH;
    assert_int_equal(tick(), 0);
    expect_steady();
}

/// After a force that was no number (the output stage made it zero and trips the watchdog).
static void no_number_starts_from_zero_and_twice_latches(void **state) {
    (void)state;
    pal_watchdog_trip(&engine->watchdog[0]);
    assert_int_equal(tick(), PALPATE_FAULT_RAMP);
    assert_true(size() <= steady * (0.01 + 1e-9)); // a hundredth in the first tick
    expect_ramp_up();
    pal_watchdog_trip(&engine->watchdog[0]);
    (void)tick();
    pal_watchdog_trip(&engine->watchdog[0]);
    expect_latched();
}

/// Every onset is an event with its tick, tool and value.
static void onsets_are_listed(void **state) {
    (void)state;
    pal_engine_counts c;
    pal_engine_get_counts(engine, &c);
    assert_int_equal(c.events, 0);
    uint64_t at = c.ticks;
    missed(150);
    (void)tick();
    missed(0);
    expect_ramp_up();
    pal_engine_get_counts(engine, &c);
    assert_int_equal(c.events, 2); // stall, ramp: onsets, not ticks
    assert_true(c.event[0].bit == 10 && c.event[0].tick == at && c.event[0].value == 150.0);
    assert_true(c.event[1].bit == 12 && c.event[1].tick == at + 1 && c.event[1].tool == 0);
    assert_true(c.fault[12] > 90);
    for (int i = 0; i < 100; i++) { // more than are kept: the newest stay
        missed(200 + (uint32_t)i);
        (void)tick();
        missed(0);
        (void)tick();
    }
    pal_engine_get_counts(engine, &c);
    assert_int_equal(c.events, 202);
    assert_true(c.event[(c.events - 2) % PALPATE_EVENTS_KEPT].value == 299.0);
}

/// Thresholds are what the definition says, within the device's speed, and bounded.
static void thresholds_are_the_definitions(void **state) {
    (void)state;
    pal_engine_def def = *pal_engine_get_def(engine);
    assert_true(def.watchdog.stale == 0.02 && def.watchdog.stall == 0.1 &&
                def.watchdog.latch == 1.0);
    assert_true(def.watchdog.speed == 20.0 && def.watchdog.ramp_down == 0.01 &&
                def.watchdog.ramp_up == 0.1);
    pal_engine_free(engine);
    engine = NULL;
    tool.spec.max_speed = 1.5;
    def.tools = &tool;
    def.watchdog = (pal_watchdog_def){
        .stale = 0.005, .stall = 0.01, .latch = 0.05, .speed = 3.0, .ramp_up = 0.02};
    assert_int_equal(pal_engine_create(model, &def, &engine, NULL), PALPATE_OK);
    for (int i = 0; i < 5; i++) {
        assert_int_equal(tick(), 0);
    }
    state_in.flags = PALPATE_STATE_STALE;
    for (int i = 1; i <= 50; i++) {
        uint32_t expect =
            (i >= 5 ? PALPATE_FAULT_STALE : 0u) | (i == 50 ? PALPATE_FAULT_LATCHED : 0u);
        assert_int_equal(tick(), expect);
    }
    state_in.flags = PALPATE_STATE_UNLATCH;
    int ramp = 0;
    while (tick() == PALPATE_FAULT_RAMP) {
        state_in.flags = 0;
        ramp++;
    }
    assert_true(ramp == 20 ||
                ramp == 21); // 20 ms; one more where the sum of twentieths rounds down
    missed(10);
    assert_int_equal(tick(), PALPATE_FAULT_STALL);
    missed(0);
    while (tick() == PALPATE_FAULT_RAMP) {
    }
    state_in.position[0] += 1.4e-3;
    assert_int_equal(tick(), 0);
    state_in.position[0] += 1.6e-3; // the device cannot move at 1.6 m/s
    assert_int_equal(tick(), PALPATE_FAULT_JUMP);
    pal_engine_counts c;
    pal_engine_get_counts(engine, &c);
    assert_true(fabs(c.fault_value[9] - 1.6) < 1e-9);

    static const double bad[] = {-1.0, 1e-4, 1e9, INFINITY, NAN};
    for (int k = 0; k < 6 * 5; k++) {
        pal_engine *none = NULL;
        pal_error error = {0};
        def.watchdog = (pal_watchdog_def){0};
        double *field[] = {&def.watchdog.stale, &def.watchdog.stall,     &def.watchdog.latch,
                           &def.watchdog.speed, &def.watchdog.ramp_down, &def.watchdog.ramp_up};
        if (k / 5 == 4 && k % 5 == 1) {
            continue; // a tenth of a millisecond to fade is allowed
        }
        *field[k / 5] = bad[k % 5];
        assert_int_equal(pal_engine_create(model, &def, &none, &error), PALPATE_ERROR_ARGUMENT);
        assert_non_null(strstr(error.message, "watchdog."));
    }
    tool.spec.max_speed = 0.0;
}

int main(void) {
#define CASE(f) cmocka_unit_test_setup_teardown(f, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        CASE(frozen_stamp_fades_and_comes_back),
        CASE(time_out_of_order_is_stale),
        CASE(refused_reads_recover_or_latch),
        CASE(nonsense_is_stale_too),
        CASE(teleport_starts_from_zero_and_twice_latches),
        CASE(overrun_of_1_10_100_1000_periods),
        CASE(motion_over_missed_periods_is_no_jump),
        CASE(a_latch_is_let_go_on_order_only),
        CASE(no_number_starts_from_zero_and_twice_latches),
        CASE(onsets_are_listed),
        CASE(thresholds_are_the_definitions),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
