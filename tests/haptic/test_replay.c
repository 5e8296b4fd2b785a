/// Replay: a recording felt again gives the same bits, and only then.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <hdf5.h>

#include <palpate/session.h>

#include "haptic/model/model.h"
#include "haptic/base/realtime.h"
#include "haptic/model/file_header.h"
#include "haptic/recording/replay.h"
#include "tests/support/synthetic_model.h"

static pal_model *model;
static pal_tool_def tool[2];
static char folder[64], path[128];

static int set_up(void **state) {
    (void)state;
    (void)snprintf(folder, sizeof folder, "/tmp/palpate-replay-XXXXXX");
    synthetic_params p = synthetic_default_params();
    model = synthetic_model(&p);
    if (model == NULL || mkdtemp(folder) == NULL) {
        return 1;
    }
    (void)snprintf(model->info.hash, sizeof model->info.hash, "soft"); // synthetic ones have none
    (void)snprintf(path, sizeof path, "%s/felt.h5", folder);
    tool[0] = pal_model_runtime(model)->tools[0];
    tool[0].device.kind = PALPATE_DEVICE_SCRIPTED;
    tool[0].device.stroke = (pal_stroke){.kind = PALPATE_STROKE_PALPATION,
                                         .depth = 0.003,
                                         .ramp = 0.1,
                                         .period = 0.5,
                                         .tremor_amplitude = 1e-4,
                                         .tremor_frequency = 10};
    tool[1] = tool[0];
    tool[1].start[0] += 0.003;
    tool[1].device.stroke.period = 0.3;
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[128];
    pal_model_free(model);
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

// ---- A device with faults: refuses reads, gives NaN, and once holds the servo up
// ------------------

typedef struct faulty {
    pal_device inner;
    int64_t reads;
    double hold; ///< seconds that read 300 takes
} faulty;

static pal_status faulty_read(void *self, int64_t time_ns, pal_tool_state *state) {
    faulty *d = self;
    d->reads++;
    if (d->reads == 300 && d->hold > 0.0) {
        int64_t until = pal_rt_now() + (int64_t)(d->hold * 1e9);
        while (pal_rt_now() < until) {
        }
    }
    if (d->reads % 97 == 0) {
        return PALPATE_ERROR_DEVICE;
    }
    pal_status status = d->inner.read(d->inner.self, time_ns, state);
    if (d->reads % 131 == 0) {
        state->position[1] = (double)NAN;
    }
    return status;
}

static void faulty_close(void *self) {
    faulty *d = self;
    d->inner.close(d->inner.self);
}

static void record(double seconds, int freewheel, double period, faulty *device,
                   pal_session_report *report) {
    pal_error e = {0};
    pal_session_def def = pal_session_default_def();
    pal_session *session = NULL;
    def.engine.tool_count = 2;
    def.engine.tools = tool;
    def.engine.period = period;
    // frames that are not the identity: replay must restore them exactly
    def.engine.device_scale = 1.5;
    def.engine.body_pose.position[0] = 0.1;
    def.engine.device_to_world.position[0] = 0.1;
    def.duration = seconds;
    def.freewheel = freewheel;
    def.realtime = 0;
    def.record_path = path;
    for (int t = 0; t < 2; t++) {
        tool[t].limits.slew = 0.003; // within reach, so that the engine's memory matters
        assert_int_equal(pal_device_create(&tool[t], period, &def.devices[t], &e), PALPATE_OK);
    }
    device->inner = def.devices[0];
    def.devices[0].self = device;
    def.devices[0].read = faulty_read;
    def.devices[0].close = faulty_close;
    (void)unlink(path);
    assert_int_equal(pal_session_create(model, &def, &session, &e), PALPATE_OK);
    assert_int_equal(pal_session_start(session, &e), PALPATE_OK);
    assert_int_equal(pal_session_finish(session, &e), PALPATE_OK);
    pal_session_get_report(session, report);
    pal_session_free(session);
}

static void replay(const pal_model *on, pal_replay_report *r) {
    pal_error e = {0};
    pal_recording *recording = NULL;
    assert_int_equal(pal_recording_open(path, &recording, &e), PALPATE_OK);
    assert_int_equal(pal_replay(recording, on, 0, r, &e), PALPATE_OK);
    pal_recording_close(recording);
}

/// Change one element of a dataset of the recording, in place, and seal it again.
static void doctor(const char *dataset, hsize_t row, int width, int column, hid_t type,
                   const void *value) {
    hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    hid_t set = H5Dopen2(file, dataset, H5P_DEFAULT);
    hid_t space = H5Dget_space(set), one = H5Screate(H5S_SCALAR);
    const hsize_t start[2] = {row, (hsize_t)column}, count[2] = {1, 1};
    (void)width;
    assert_true(H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, count, NULL) >= 0);
    assert_true(H5Dwrite(set, type, one, space, H5P_DEFAULT, value) >= 0);
    H5Sclose(one);
    H5Sclose(space);
    H5Dclose(set);
    H5Fclose(file);
    pal_error e = {0};
    pal_recording *recording = NULL; // the seal is broken, and seen
    assert_int_equal(pal_recording_open(path, &recording, &e), PALPATE_ERROR_CHECKSUM);
    assert_non_null(strstr(e.message, "corrupted"));
    assert_int_equal(pal_file_seal_path(PALPATE_FILE_RECORDING, 2, path, &e), PALPATE_OK);
}

static void freewheel_has_no_difference(void **state) {
    (void)state;
    // 5 s, a period whose nanoseconds are not whole: it must come back as it was
    pal_session_report s;
    pal_replay_report r;
    record(5.0, 1, 1.0 / 900.0, &(faulty){0}, &s);
    replay(model, &r);
    assert_int_equal(r.ticks, 4500);
    assert_int_equal(r.records, 9000);
    assert_int_equal(r.differences, 0);
    assert_null(r.first.what);
    assert_true(r.hash_matches);
    assert_true(r.peak_difference == 0.0 && r.rms_difference == 0.0); // exact by the claim
    assert_true(r.replayed_peak > 0.0 && r.replayed_peak == r.recorded_peak);
    assert_int_equal(r.holes, 0);
    // the faults were in it
    assert_true(s.device_errors > 40 && s.counts.fault[0] > 30 && s.counts.fault[5] > 0);
}

static void real_time_with_missed_periods_has_no_difference(void **state) {
    (void)state;
    pal_session_report s;
    pal_replay_report r;
    record(2.0, 0, 1e-3, &(faulty){.hold = 0.0234}, &s);
    assert_true(s.missed >= 23); // periods that passed while the device held the servo up
    replay(model, &r);
    assert_int_equal(r.ticks, s.ticks);
    assert_int_equal(r.differences, 0);
    assert_true(r.replayed_peak > 0.0);
}

static void a_doctored_record_is_found(void **state) {
    (void)state;
    pal_session_report s;
    pal_replay_report r;
    record(0.5, 1, 1e-3, &(faulty){0}, &s);
    replay(model, &r);
    assert_int_equal(r.differences, 0);
    // the last bit of one output
    pal_error e = {0};
    pal_recording *recording = NULL;
    pal_tick_record row;
    assert_int_equal(pal_recording_open(path, &recording, &e), PALPATE_OK);
    assert_int_equal(pal_recording_rows(recording, 2 * 200 + 1, 1, &row, &e), PALPATE_OK);
    pal_recording_close(recording);
    assert_int_equal(row.tick, 200);
    assert_int_equal(row.tool, 1);
    assert_true(row.force.force[2] != 0.0);
    double changed = nextafter(row.force.force[2], 1e9);
    doctor("/ticks/force", 2 * 200 + 1, 3, 2, H5T_NATIVE_DOUBLE, &changed);
    replay(model, &r);
    assert_int_equal(r.differences, 1);
    assert_int_equal(r.first.tick, 200);
    assert_int_equal(r.first.tool, 1);
    assert_string_equal(r.first.what, "force");
    assert_true(r.first.recorded.force[2] == changed);
    assert_true(r.first.replayed.force[2] == row.force.force[2]);
    doctor("/ticks/force", 2 * 200 + 1, 3, 2, H5T_NATIVE_DOUBLE, &row.force.force[2]);
    // an input: what follows from it differs from there on
    double moved = row.state.position[2] - 1e-5;
    doctor("/ticks/position", 2 * 200 + 1, 3, 2, H5T_NATIVE_DOUBLE, &moved);
    replay(model, &r);
    assert_true(r.differences >= 1);
    assert_int_equal(r.first.tick, 200);
    assert_true(r.peak_difference > 0.0 && r.rms_difference > 0.0);
}

/// Every output counts, and its difference is named.
static void every_output_is_compared(void **state) {
    (void)state;
    static const struct {
        const char *dataset, *what;
        int width;
    } outputs[] = {{"/ticks/torque", "torque", 3},     {"/ticks/contacts", "contacts", 1},
                   {"/ticks/tool_fault", "fault", 1},  {"/ticks/depth", "depth", 1},
                   {"/ticks/centroid", "centroid", 3}, {"/ticks/normal", "normal", 3}};
    pal_session_report s;
    pal_replay_report r;
    for (size_t k = 0; k < sizeof outputs / sizeof *outputs; k++) {
        record(0.1, 1, 1e-3, &(faulty){0}, &s);
        int whole =
            strcmp(outputs[k].what, "contacts") == 0 || strcmp(outputs[k].what, "fault") == 0;
        const int32_t number = 1 << 20;
        const double value = 12345.0;
        doctor(outputs[k].dataset, 2 * 60, outputs[k].width, 0,
               whole ? H5T_NATIVE_INT32 : H5T_NATIVE_DOUBLE,
               whole ? (const void *)&number : (const void *)&value);
        replay(model, &r);
        assert_int_equal(r.differences, 1);
        assert_int_equal(r.first.tick, 60);
        assert_string_equal(r.first.what, outputs[k].what);
        assert_int_equal(r.holes, 0);
    }
    // ticks that were lost on the way to the disk
    const uint64_t later = 106;
    record(0.1, 1, 1e-3, &(faulty){0}, &s);
    doctor("/ticks/tick", 2 * 99, 1, 0, H5T_NATIVE_UINT64, &later);
    doctor("/ticks/tick", 2 * 99 + 1, 1, 0, H5T_NATIVE_UINT64, &later);
    replay(model, &r);
    assert_int_equal(r.holes, 1);
}

static void nonsense_is_refused(void **state) {
    (void)state;
    pal_session_report s;
    pal_error e = {0};
    pal_recording *recording = NULL;
    pal_replay_report r;
    record(0.1, 1, 1e-3, &(faulty){0}, &s);
    const int32_t far = 7;
    doctor("/ticks/tool", 50, 1, 0, H5T_NATIVE_INT32, &far);
    assert_int_equal(pal_recording_open(path, &recording, &e), PALPATE_OK);
    assert_int_equal(pal_replay(recording, model, 0, &r, &e), PALPATE_ERROR_FORMAT);
    assert_non_null(strstr(e.message, "/ticks/tool"));
    pal_recording_close(recording);
    const int32_t again = 1; // a tick with tool 1 twice
    doctor("/ticks/tool", 50, 1, 0, H5T_NATIVE_INT32, &again);
    assert_int_equal(pal_recording_open(path, &recording, &e), PALPATE_OK);
    assert_int_equal(pal_replay(recording, model, 0, &r, &e), PALPATE_ERROR_FORMAT);
    pal_recording_close(recording);
    const double bad = -1.0;
    doctor("/tool/1/limits", 0, 1, 0, H5T_NATIVE_DOUBLE, &bad);
    assert_int_equal(pal_recording_open(path, &recording, &e), PALPATE_OK);
    assert_int_equal(pal_replay(recording, model, 0, &r, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_recording_rows(recording, 1, INT64_MAX, NULL, &e), PALPATE_ERROR_ARGUMENT);
    pal_recording_close(recording);
    assert_int_equal(pal_recording_open("/nonexistent", &recording, &e), PALPATE_ERROR_IO);
    assert_null(recording);
}

static void another_model_feels_otherwise(void **state) {
    (void)state;
    pal_session_report s;
    pal_replay_report same, other;
    record(0.5, 1, 1e-3, &(faulty){0}, &s);
    synthetic_params p = synthetic_default_params();
    p.young *= 2.0;
    pal_model *stiff = synthetic_model(&p);
    assert_non_null(stiff);
    (void)snprintf(stiff->info.hash, sizeof stiff->info.hash, "stiff");
    replay(model, &same);
    replay(stiff, &other);
    assert_int_equal(same.differences, 0);
    assert_false(other.hash_matches);
    assert_true(other.differences > 0 && other.peak_difference > 0.0);
    assert_true(other.rms_difference > 0.0 && other.rms_difference < other.peak_difference);
    assert_true(other.replayed_peak > other.recorded_peak); // stiffer
    pal_model_free(stiff);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(freewheel_has_no_difference),
        cmocka_unit_test(real_time_with_missed_periods_has_no_difference),
        cmocka_unit_test(a_doctored_record_is_found),
        cmocka_unit_test(every_output_is_compared),
        cmocka_unit_test(nonsense_is_refused),
        cmocka_unit_test(another_model_feels_otherwise),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
