/// The field computed by whoever takes the frame: the servo's bits, whole frames, nothing for the
/// servo to do (run it in TSan), and the scene's choice carried by the model file.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <palpate/session.h>

#include "haptic/base/hash.h"
#include "tests/support/engine_rig.h"

/// A press that goes on as a slide: the contact set changes all the time.
static pal_tool_state pose(int k) {
    double depth = 0.0025 * fmin(1.0, k / 50.0);
    return rig_state(0.003 * sin(0.02 * k), 0.002 * cos(0.03 * k) - 0.002, 0.004 - depth);
}

static void make(rig *r, pal_precision precision, pal_field_by by) {
    rig_model(r, 11, precision, 0.0);
    r->def.reader_count = 2;
    r->def.frame_age = 1;
    r->def.field_by = by;
    rig_engine(r);
}

static void the_reader_sums_the_servos_bits(void **state) {
    (void)state;
    for (int p = PALPATE_PRECISION_DOUBLE; p <= PALPATE_PRECISION_HALF; p++) {
        rig servo, reader;
        make(&servo, (pal_precision)p, PALPATE_FIELD_BY_SERVO);
        make(&reader, (pal_precision)p, PALPATE_FIELD_BY_READER);
        size_t bytes = 3 * (size_t)servo.model->info.row_count * sizeof(float);
        int moved = 0;
        for (int k = 0; k < 300; k++) {
            pal_tool_state in = pose(k);
            pal_tool_force a, b;
            pal_frame fa, fb, again;
            (void)pal_engine_tick(servo.engine, &in, &a);
            (void)pal_engine_tick(reader.engine, &in, &b);
            assert_memory_equal(&a, &b, sizeof a);
            for (int r = 0; r < 2; r++) {
                assert_int_equal(pal_engine_snapshot(pal_engine_reader(servo.engine, r), &fa), 1);
                assert_int_equal(pal_engine_snapshot(pal_engine_reader(reader.engine, r), &fb), 1);
                assert_int_equal(fa.tick, fb.tick);
                assert_int_equal(fa.row_count, fb.row_count);
                assert_memory_equal(fa.tool_force, fb.tool_force, sizeof fa.tool_force);
                assert_memory_equal(fa.displacement, fb.displacement, bytes);
                moved += fb.displacement[3 * (servo.model->info.row_count / 2) + 2] != 0.0f;
                // asked again without a tick: the same frame, the same field
                assert_int_equal(pal_engine_snapshot(pal_engine_reader(reader.engine, r), &again),
                                 0);
                assert_ptr_equal(again.displacement, fb.displacement);
            }
        }
        assert_true(moved > 400);
        rig_free(&servo);
        rig_free(&reader);
    }
}

static void the_work_is_done_at_taking(void **state) {
    (void)state;
    rig r;
    make(&r, PALPATE_PRECISION_DOUBLE, PALPATE_FIELD_BY_READER);
    pal_reader *reader = pal_engine_reader(r.engine, 0);
    pal_frame frame;
    assert_int_equal(pal_engine_snapshot(reader, &frame), -1); // nothing yet
    pal_tool_force out;
    pal_tool_state in = pose(100);
    in.position[2] = 0.0035;
    (void)pal_engine_tick(r.engine, &in, &out);
    assert_true(out.contact_count > 0);
    assert_int_equal(pal_engine_snapshot(reader, &frame), 1);
    double held = (double)frame.displacement[2], deepest = 0.0;
    for (int32_t i = 0; i < 3 * frame.row_count; i++) {
        deepest = fmax(deepest, fabs((double)frame.displacement[i]));
    }
    assert_true(deepest > 1e-5);
    // the stored rows are touched between tick and taking: only a sum made at taking can show it
    (void)pal_engine_tick(r.engine, &in, &out);
    assert_true((double)frame.displacement[2] == held); // the frame in hand stays
    memset(r.model->c_st, 0, (size_t)r.model->row_ld * 3 * (size_t)r.model->info.column_count * 8);
    assert_int_equal(pal_engine_snapshot(reader, &frame), 1);
    for (int32_t i = 0; i < 3 * frame.row_count; i++) {
        assert_true(frame.displacement[i] == 0.0f);
    }
    // ticks that nobody took are not kept: the newest comes
    for (int k = 0; k < 7; k++) {
        (void)pal_engine_tick(r.engine, &in, &out);
    }
    assert_int_equal(pal_engine_snapshot(reader, &frame), 1);
    assert_int_equal(frame.tick, 8);
    rig_free(&r);
}

enum { TICKS = 4000 };

typedef struct racer {
    pal_engine *engine;
    _Atomic int done;
    uint64_t want[TICKS]; ///< digest of the field after each tick, from an engine of its own
    int taken, wrong;
} racer;

static uint64_t digest(const pal_frame *frame) {
    uint8_t hash[PALPATE_HASH_BYTES];
    uint64_t short_hash;
    pal_hash h;
    pal_hash_init(&h, PALPATE_HASH_BYTES);
    pal_hash_update(&h, frame->displacement, 3 * (size_t)frame->row_count * sizeof(float));
    pal_hash_update(&h, frame->tool_force, sizeof *frame->tool_force);
    pal_hash_final(&h, hash);
    memcpy(&short_hash, hash, sizeof short_hash);
    return short_hash;
}

static void *take_frames(void *arg) {
    racer *race = arg;
    pal_reader *reader = pal_engine_reader(race->engine, 1);
    pal_frame frame;
    while (!atomic_load(&race->done)) {
        if (pal_engine_snapshot(reader, &frame) == 1) {
            race->taken++;
            race->wrong += digest(&frame) != race->want[frame.tick];
        }
    }
    return NULL;
}

static void frames_are_whole_beside_a_racing_servo(void **state) {
    (void)state;
    static racer race;
    rig reference, r;
    make(&reference, PALPATE_PRECISION_SINGLE, PALPATE_FIELD_BY_SERVO);
    make(&r, PALPATE_PRECISION_SINGLE, PALPATE_FIELD_BY_READER);
    for (int k = 0; k < TICKS; k++) {
        pal_tool_state in = pose(k);
        pal_tool_force out;
        pal_frame frame;
        (void)pal_engine_tick(reference.engine, &in, &out);
        assert_int_equal(pal_engine_snapshot(pal_engine_reader(reference.engine, 0), &frame), 1);
        race.want[k] = digest(&frame);
    }
    race.engine = r.engine;
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, take_frames, &race), 0);
    for (int k = 0; k < TICKS; k++) {
        pal_tool_state in = pose(k);
        pal_tool_force out;
        (void)pal_engine_tick(r.engine, &in, &out);
        if (k % 16 == 0) {
            usleep(50); // let the reader in on one core too
        }
    }
    atomic_store(&race.done, 1);
    pthread_join(thread, NULL);
    assert_int_equal(race.wrong, 0);
    assert_true(race.taken > 10);
    rig_free(&r);
    rig_free(&reference);
}

typedef struct log_of_frames {
    pal_hash hash;
    int count;
    double deepest;
} log_of_frames;

static void log_frame(void *user, const pal_frame *frame) {
    log_of_frames *log = user;
    if (frame == NULL) {
        return;
    }
    log->count++;
    pal_hash_update(&log->hash, &frame->tick, sizeof frame->tick);
    pal_hash_update(&log->hash, frame->displacement, 3 * (size_t)frame->row_count * sizeof(float));
    for (int32_t i = 0; i < 3 * frame->row_count; i++) {
        log->deepest = fmax(log->deepest, fabs((double)frame->displacement[i]));
    }
}

static pal_session_report run(const pal_model *model, pal_field_by by, int freewheel,
                              double seconds, double period, log_of_frames *log) {
    pal_error error = {0};
    pal_session *session = NULL;
    pal_session_report report;
    pal_tool_def tool = pal_model_runtime(model)->tools[0];
    tool.device.kind = PALPATE_DEVICE_SCRIPTED;
    tool.device.stroke =
        (pal_stroke){.kind = PALPATE_STROKE_PALPATION, .depth = 0.003, .ramp = 0.1, .period = 0.5};
    pal_session_def def = pal_session_default_def();
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.engine.field_by = by;
    def.engine.period = period;
    def.duration = seconds;
    def.freewheel = freewheel;
    def.realtime = 0;
    def.render = log_frame;
    def.render_user = log;
    *log = (log_of_frames){0};
    pal_hash_init(&log->hash, PALPATE_HASH_BYTES);
    if (pal_device_create(&tool, period, &def.devices[0], &error) != PALPATE_OK ||
        pal_session_create(model, &def, &session, &error) != PALPATE_OK ||
        pal_session_start(session, &error) != PALPATE_OK ||
        pal_session_finish(session, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    pal_session_get_report(session, &report);
    pal_session_free(session);
    return report;
}

static void a_session_draws_the_same_frames_either_way(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    uint8_t hash[2][PALPATE_HASH_BYTES];
    for (int by = 0; by < 2; by++) {
        log_of_frames log;
        pal_session_report r = run(model, (pal_field_by)by, 1, 1.0, 1e-3, &log);
        assert_int_equal(r.ticks, 1000);
        assert_int_equal(log.count, 32);
        assert_true(log.deepest > 1e-3);
        pal_hash_final(&log.hash, hash[by]);
    }
    assert_memory_equal(hash[0], hash[1], PALPATE_HASH_BYTES);
    pal_model_free(model);
}

static void a_field_too_large_for_the_period_costs_frames_not_forces(void **state) {
    (void)state;
    // 4400 stored nodes under 32 and more contacts, swept in double, do not fit 100 us
    synthetic_params p = synthetic_default_params();
    p.n = 19;
    p.layers = 11;
    p.rows = SYNTHETIC_ROWS_ALL;
    p.precision = PALPATE_PRECISION_DOUBLE;
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    model->runtime.tools[0].radius = 0.012;
    model->runtime.tools[0].start[2] = 0.012;
    log_of_frames log;
    pal_session_report r = run(model, PALPATE_FIELD_BY_SERVO, 0, 0.5, 1e-4, &log);
    assert_int_equal(r.ticks + r.missed, 5000);
    assert_true(r.ticks > 0);
    assert_true(r.counts.contact_ticks > 0);
    // every tick of the servo answered; what gave way is the field, and the report says by how much
    assert_int_equal(r.counts.ticks, r.ticks);
    assert_true(r.field_skipped > r.ticks / 4);
    assert_true(r.field_skipped <= r.ticks);
    // by the render thread the same body needs nothing of the period
    // (a frame of the pressed body in 0.5 s, or longer where a sanitizer or a busy machine is slow)
    for (double seconds = 0.5;; seconds *= 4) {
        pal_session_report q = run(model, PALPATE_FIELD_BY_READER, 0, seconds, 1e-4, &log);
        assert_int_equal(q.ticks + q.missed, lround(seconds * 1e4));
        if (log.count >= 1 && log.deepest > 1e-4) {
            break;
        }
        assert_true(seconds < 30);
    }
    pal_model_free(model);
}

static void the_choice_is_checked_and_travels_with_the_model(void **state) {
    (void)state;
    rig r;
    make(&r, PALPATE_PRECISION_SINGLE, PALPATE_FIELD_BY_READER);
    pal_engine_def def = r.def;
    pal_engine *engine = NULL;
    pal_error error = {0};
    def.tools = r.tools;
    assert_true(pal_engine_bytes(r.model, &def) > 0);
    def.field_by = (pal_field_by)7;
    assert_int_equal(pal_engine_create(r.model, &def, &engine, &error), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "field_by"));
    char path[64];
    (void)snprintf(path, sizeof path, "/tmp/palpate-field-%ld.palpate", (long)getpid());
    r.model->runtime.field_by = PALPATE_FIELD_BY_READER;
    assert_int_equal(pal_model_save(r.model, path, &error), PALPATE_OK);
    pal_model *back = NULL;
    assert_int_equal(pal_model_load(path, &back, &error), PALPATE_OK);
    (void)unlink(path);
    assert_int_equal(pal_model_runtime(back)->field_by, PALPATE_FIELD_BY_READER);
    pal_model_free(back);
    rig_free(&r);
}

static void a_model_without_rows_gives_frames_without_a_field(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    p.rows = SYNTHETIC_ROWS_NONE;
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    pal_engine_def def = pal_engine_default_def();
    pal_engine *engine = NULL;
    def.tools = model->runtime.tools;
    def.tool_count = 1;
    def.field_by = PALPATE_FIELD_BY_READER;
    assert_int_equal(pal_engine_create(model, &def, &engine, NULL), PALPATE_OK);
    pal_tool_state in = rig_state(0, 0, 0.003);
    pal_tool_force out;
    pal_frame frame;
    (void)pal_engine_tick(engine, &in, &out);
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(engine, 0), &frame), 1);
    assert_null(frame.displacement);
    assert_int_equal(frame.row_count, 0);
    pal_engine_free(engine);
    pal_model_free(model);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_reader_sums_the_servos_bits),
        cmocka_unit_test(the_work_is_done_at_taking),
        cmocka_unit_test(frames_are_whole_beside_a_racing_servo),
        cmocka_unit_test(a_session_draws_the_same_frames_either_way),
        cmocka_unit_test(a_field_too_large_for_the_period_costs_frames_not_forces),
        cmocka_unit_test(the_choice_is_checked_and_travels_with_the_model),
        cmocka_unit_test(a_model_without_rows_gives_frames_without_a_field),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
