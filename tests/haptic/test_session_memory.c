/// Every allocation of a recorded session fails once, from the device to the converted file: a
/// clean error, nothing leaked, no file left where there should be none, and no recorded tick lost.
///
/// Calls of Palpate's own code fail, and those of libraries on its behalf (streams, locales,
/// threads) up to the session's start; HDF5's are let through: what it does without memory is not
/// ours to mend.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/session.h>

#include "tests/support/failing_allocator.h"
#include "tests/support/synthetic_model.h"

static pal_model *model;
static char folder[64], path[128], dump[128], csv[128];
enum { TICKS = 80 };

static int set_up(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    model = synthetic_model(&p);
    (void)snprintf(folder, sizeof folder, "/tmp/palpate-memory-XXXXXX");
    if (model == NULL || mkdtemp(folder) == NULL) {
        return 1;
    }
    (void)snprintf(path, sizeof path, "%s/run.h5", folder);
    (void)snprintf(dump, sizeof dump, "%s/dump.h5", folder);
    (void)snprintf(csv, sizeof csv, "%s/t.csv", folder);
    FILE *file = fopen(csv, "w");
    if (file == NULL) {
        return 1;
    }
    fputs("time,x,y,z,qw,qx,qy,qz,button\n0,0,0,0.004,1,0,0,0,0\n0.08,0,0,0.002,1,0,0,0,0\n", file);
    return fclose(file);
}

static int tear_down(void **state) {
    (void)state;
    char command[128];
    pal_model_free(model);
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

static int exists(const char *suffix) {
    char name[160];
    (void)snprintf(name, sizeof name, "%s%s", path, suffix);
    return access(name, F_OK) == 0;
}

/// The whole life of a session. @param[out] stage  how far it came: 3 is all the way
static pal_status live_through(int *stage, pal_error *error) {
    pal_tool_def tool = pal_model_runtime(model)->tools[0];
    tool.device.kind = PALPATE_DEVICE_REPLAY;
    (void)snprintf(tool.device.path, sizeof tool.device.path, "%s", csv);
    pal_session_def def = pal_session_default_def();
    pal_session *session = NULL;
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.duration = TICKS * 1e-3;
    def.freewheel = 1;
    def.record_path = path;
    def.dump_path = dump; // the device refuses nothing: no fault, no dump
    def.ring_ticks = 64;
    *stage = 0;
    pal_status status = pal_device_create(&tool, 1e-3, &def.devices[0], error);
    if (status != PALPATE_OK) {
        return status;
    }
    status = pal_session_create(model, &def, &session, error);
    if (status != PALPATE_OK) {
        def.devices[0].close(def.devices[0].self);
        return status;
    }
    *stage = 1;
    status = pal_session_start(session, error);
    if (status == PALPATE_OK) {
        *stage = 2;
        failing_callers = FAILING_OWN;
        status = pal_session_finish(session, error);
    }
    *stage += status == PALPATE_OK;
    pal_session_free(session);
    return status;
}

static void every_allocation_may_fail(void **state) {
    (void)state;
    failing_or_skip();
    int stage, failed_at_stage[4] = {0, 0, 0, 0};
    pal_error warm = {0};
    assert_int_equal(live_through(&stage, &warm), PALPATE_OK); // libraries set themselves up once
    long n = 0;
    for (int hit = 1; hit;) {
        pal_error error = {0};
        (void)unlink(path);
        n++;
        failing_watch(n, FAILING_ANY);
        pal_status status = live_through(&stage, &error);
        failing_stop();
        hit = failing_calls >= n;
        int lost = failing_leaked(FAILING_OWN);
        if (lost != 0) {
            fail_msg("allocation %ld: %d blocks leaked at stage %d (%s)", n, lost, stage,
                     error.message);
        }
        if (status == PALPATE_OK) { // not reached, or done without
            assert_int_equal(stage, 3);
            assert_true(exists("") && !exists(".ticks") && !exists(".frames"));
            continue;
        }
        assert_true(hit);
        failed_at_stage[stage]++;
        if (status != PALPATE_ERROR_MEMORY && status != PALPATE_ERROR_SYSTEM &&
            status != PALPATE_ERROR_IO) {
            fail_msg("allocation %ld: %s: %s", n, pal_status_name(status), error.message);
        }
        assert_true(error.message[0] != 0);
        assert_false(exists(".part"));
        if (stage < 2) { // it never ran: nothing may be left
            assert_false(exists(".ticks") || exists(".frames") || exists(""));
        } else { // it ran: every tick is still there
            pal_recording_summary s;
            assert_true(exists(".ticks"));
            if (pal_recording_convert(path, &s, &error) != PALPATE_OK) {
                fail_msg("allocation %ld: %s", n, error.message);
            }
            assert_int_equal(s.records, TICKS);
            assert_int_equal(s.complete, 1);
        }
    }
    // device and session, threads, conversion: all were reached
    assert_true(failed_at_stage[0] > 10);
    assert_true(failed_at_stage[2] > 20);
    print_message(
        "%ld allocations: %d failures before the session, %d at its start, %d in its finish\n", n,
        failed_at_stage[0], failed_at_stage[1], failed_at_stage[2]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_allocation_may_fail)};
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
