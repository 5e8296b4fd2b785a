/// The watchdog: what is stale, stalled or jumping is felt as nothing, comes back gently, and
/// latches.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/engine.h"
#include "haptic/watchdog.h"
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
    tool.limits = (pal_tool_limits){0.0, 0.0, 0.0}; // the watchdog alone
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

int main(void) {
#define CASE(f) cmocka_unit_test_setup_teardown(f, set_up, tear_down)
    const struct CMUnitTest tests[] = {
        CASE(frozen_stamp_fades_and_comes_back),
        CASE(time_out_of_order_is_stale),
        CASE(refused_reads_recover_or_latch),
        CASE(nonsense_is_stale_too),
        CASE(teleport_starts_from_zero_and_twice_latches),
        CASE(overrun_of_1_10_100_1000_periods),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
