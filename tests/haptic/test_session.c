/// A session: periods add up, stop is prompt, freewheel is exact, force goes first, nothing is
/// silent.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <pthread.h>
#include <sched.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/session.h>

#include "haptic/base/hash.h"
#include "haptic/base/realtime.h"
#include "haptic/session/servo.h"
#include "tests/support/synthetic_model.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

static pal_model *model;
static pal_tool_def tool; ///< the synthetic model's sphere, pressing 3 mm

static int set_up(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    model = synthetic_model(&p);
    if (model == NULL) {
        return 1;
    }
    tool = pal_model_runtime(model)->tools[0];
    tool.device.kind = PALPATE_DEVICE_SCRIPTED;
    tool.device.stroke = (pal_stroke){.kind = PALPATE_STROKE_PALPATION,
                                      .depth = 0.003,
                                      .ramp = 0.1,
                                      .period = 0.5,
                                      .tremor_amplitude = 1e-4,
                                      .tremor_frequency = 10};
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    pal_model_free(model);
    return 0;
}

// ---- A device that watches the session from inside
// -----------------------------------------------

typedef struct watcher {
    pal_device inner; ///< where poses come from
    pal_session *session;
    pal_reader *reader; ///< when set, write() looks at what has been published
    int64_t reads, writes, closes, opens;
    int64_t stop_at;                ///< request a stop in this read (from 1)
    int64_t refuse_from, refuse_to; ///< reads refused
    double burn;                    ///< seconds each read takes
    int64_t burn_at;                ///< only this read; 0: all
    int64_t early_fields;           ///< fields published before their force was written
    int64_t first_time, last_time;
    int order_broken; ///< write without its read
    int open_fails;
    long rss[2]; ///< pages at 10 % and at the end
    int64_t rss_at[2];
    pal_hash hash; ///< of all forces
} watcher;

static long resident_pages(void) {
    long size = 0, resident = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (f != NULL) {
        if (fscanf(f, "%ld %ld", &size, &resident) != 2) {
            resident = -1;
        }
        fclose(f);
    }
    return resident;
}

static pal_status watch_open(void *self, pal_error *error) {
    watcher *w = self;
    w->opens++;
    if (w->open_fails) {
        error->status = PALPATE_ERROR_DEVICE;
        (void)snprintf(error->message, sizeof error->message, "no such arm");
        return PALPATE_ERROR_DEVICE;
    }
    return PALPATE_OK;
}

static pal_status watch_read(void *self, int64_t time_ns, pal_tool_state *state) {
    watcher *w = self;
    w->reads++;
    if (w->reads == 1) {
        w->first_time = time_ns;
    }
    w->last_time = time_ns;
    for (int k = 0; k < 2; k++) {
        if (w->rss_at[k] == w->reads) {
            w->rss[k] = resident_pages();
        }
    }
    if (w->burn > 0.0 && (w->burn_at == 0 || w->burn_at == w->reads)) {
        int64_t until = pal_rt_now() + (int64_t)(w->burn * 1e9);
        while (pal_rt_now() < until) {
        }
    }
    if (w->stop_at == w->reads) {
        pal_session_request_stop(w->session);
    }
    if (w->reads >= w->refuse_from && w->reads < w->refuse_to) {
        return PALPATE_ERROR_DEVICE;
    }
    return w->inner.read(w->inner.self, time_ns, state);
}

static pal_status watch_write(void *self, int64_t time_ns, const pal_tool_force *force) {
    watcher *w = self;
    w->writes++;
    w->order_broken |= w->writes != w->reads || time_ns != w->last_time;
    pal_hash_update(&w->hash, force, sizeof *force);
    pal_frame frame;
    if (w->reader != NULL && pal_engine_snapshot(w->reader, &frame) >= 0) {
        w->early_fields += frame.tick >= (uint64_t)(w->writes - 1);
    }
    return PALPATE_OK;
}

static void watch_close(void *self) {
    watcher *w = self;
    w->closes++;
    if (w->inner.close != NULL) {
        w->inner.close(w->inner.self);
    }
    memset(&w->inner, 0, sizeof w->inner);
}

static pal_device watch(watcher *w) {
    pal_error e = {0};
    if (pal_device_create(&tool, 1e-3, &w->inner, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_hash_init(&w->hash, PALPATE_HASH_BYTES);
    return (pal_device){.abi = PALPATE_DEVICE_ABI,
                        .self = w,
                        .spec = {.name = "watcher"},
                        .open = watch_open,
                        .read = watch_read,
                        .write = watch_write,
                        .close = watch_close};
}

static pal_session_def base_def(double duration, int freewheel) {
    pal_session_def def = pal_session_default_def();
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.engine.reader_count = 3;
    def.duration = duration;
    def.freewheel = freewheel;
    def.ring_ticks = 512;
    return def;
}

static pal_session *create(const pal_session_def *def, watcher *w) {
    pal_session_def d = *def;
    pal_session *session = NULL;
    pal_error e = {0};
    d.devices[0] = watch(w);
    if (pal_session_create(model, &d, &session, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    w->session = session;
    return session;
}

/// Run to the end; the report.
static pal_session_report run(const pal_session_def *def, watcher *w) {
    pal_session *session = create(def, w);
    pal_error e = {0};
    pal_session_report report;
    if (pal_session_start(session, &e) != PALPATE_OK ||
        pal_session_finish(session, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    assert_int_equal(pal_session_running(session), 0);
    pal_session_get_report(session, &report);
    pal_session_free(session);
    assert_int_equal(w->opens, 1);
    assert_int_equal(w->closes, 1);
    return report;
}

// ---- Periods ------------------------------------------------------------------------------------

static void ticks_and_missed_make_up_the_time(void **state) {
    (void)state;
    pal_session_def def = base_def(2.0, 0);
    watcher w = {0};
    pal_session_report r = run(&def, &w);
    assert_int_equal(r.ticks + r.missed, 2000);
    assert_true(fabs(r.seconds - 2.0) < 1e-12);
    assert_int_equal(w.reads, r.ticks);
    assert_int_equal(w.writes, r.ticks);
    assert_false(w.order_broken);
    assert_int_equal(r.counts.ticks, r.ticks);
    assert_true(w.last_time <= 1999 * INT64_C(1000000));
    assert_int_equal(w.last_time % 1000000, 0); // session time lies on the grid of periods
    assert_true(r.frames >= 1 && r.frames <= 62);
    assert_true(r.scheduling[0] != 0);
    assert_true(r.peak_force > 0 && r.peak_force_vector[2] > 0); // pressed down, pushed up
    assert_true(r.compute_us.p50 <= r.compute_us.p99 && r.compute_us.p99 <= r.compute_us.p999);
    assert_true(r.compute_us.p999 <= r.compute_us.max && r.compute_us.p50 > 0);
}

static void a_period_that_passes_is_counted_not_caught_up(void **state) {
    (void)state;
    pal_session_def def = base_def(0.2, 0);
    watcher w = {.burn = 0.0105, .burn_at = 50}; // ten periods and a half in one tick
    pal_session_report r = run(&def, &w);
    assert_int_equal(r.ticks + r.missed, 200);
    assert_true(r.missed >= 9); // more where the machine itself is late
    assert_true(r.lateness_us.max >= 9000);
}

static void odd_periods_add_up_too(void **state) {
    (void)state;
    static const double period[] = {1.0 / 3000, 0.0007, 1.0 / 333};
    for (int i = 0; i < 3; i++) {
        pal_session_def def = base_def(0.3, 0);
        def.engine.period = period[i];
        watcher w = {0};
        pal_session_report r = run(&def, &w);
        assert_int_equal(r.ticks + r.missed, llround(0.3 / period[i]));
    }
}

static void a_stop_is_obeyed_in_the_same_tick(void **state) {
    (void)state;
    for (int freewheel = 0; freewheel < 2; freewheel++) {
        pal_session_def def = base_def(0.0, freewheel); // endless
        watcher w = {.stop_at = 57};
        pal_session_report r = run(&def, &w);
        assert_int_equal(r.ticks, 57);  // not one more
        assert_int_equal(w.writes, 57); // and that tick's force still reached the device
    }
}

static void a_stop_from_outside_ends_an_endless_run(void **state) {
    (void)state;
    pal_session_def def = base_def(0.0, 0);
    watcher w = {0};
    pal_session *session = create(&def, &w);
    assert_int_equal(pal_session_running(session), 0);
    assert_int_equal(pal_session_start(session, NULL), PALPATE_OK);
    pal_session_report r;
    pal_tick_record ring[64];
    do { // the report and the ring may be read meanwhile
        assert_int_equal(pal_session_running(session), 1);
        pal_session_get_report(session, &r);
        int32_t n = pal_session_ring(session, ring, 64);
        for (int32_t i = 1; i < n; i++) {
            assert_true(ring[i].tick == ring[i - 1].tick + 1);
        }
        usleep(2000);
    } while (r.ticks < 100);
    pal_session_request_stop(session);
    assert_int_equal(pal_session_finish(session, NULL), PALPATE_OK);
    assert_int_equal(pal_session_finish(session, NULL), PALPATE_OK); // again: nothing happens
    pal_error e = {0};
    assert_int_equal(pal_session_start(session, &e), PALPATE_ERROR_ARGUMENT); // a session runs once
    pal_session_free(session);
    assert_int_equal(w.closes, 1);
}

// ---- Freewheel ----------------------------------------------------------------------------------

static void freewheel_evaluates_every_tick_and_repeats_bit_for_bit(void **state) {
    (void)state;
    uint8_t digest[3][PALPATE_HASH_BYTES];
    for (int k = 0; k < 2; k++) {
        pal_session_def def = base_def(10.0, 1);
        watcher w = {0};
        pal_session_report r = run(&def, &w);
        assert_int_equal(r.ticks, 10000);
        assert_int_equal(r.missed, 0);
        assert_int_equal(r.field_skipped, 0);
        assert_int_equal(w.writes, 10000);
        assert_int_equal(w.last_time, 9999 * INT64_C(1000000));
        assert_true(r.lateness_us.max == 0);
        assert_true(r.counts.contact_ticks > 5000);
        pal_hash_final(&w.hash, digest[k]);
    }
    assert_memory_equal(digest[0], digest[1], PALPATE_HASH_BYTES);

    // the same engine driven by the host itself: the threads add nothing to the forces
    pal_session_def def = base_def(10.0, 1);
    pal_engine *engine = NULL;
    watcher w = {0};
    pal_device d = watch(&w);
    assert_int_equal(pal_engine_create(model, &def.engine, &engine, NULL), PALPATE_OK);
    for (int64_t n = 0; n < 10000; n++) {
        pal_tool_state in;
        pal_tool_force out;
        d.read(d.self, n * 1000000, &in);
        (void)pal_engine_tick(engine, &in, &out);
        d.write(d.self, n * 1000000, &out);
    }
    pal_engine_free(engine);
    d.close(d.self);
    pal_hash_final(&w.hash, digest[2]);
    assert_memory_equal(digest[0], digest[2], PALPATE_HASH_BYTES);
}

typedef struct frame_log {
    uint64_t tick[256];
    int count, ends; ///< frames; calls with NULL
} frame_log;

static void log_frame(void *user, const pal_frame *frame) {
    frame_log *log = user;
    if (frame == NULL) {
        log->ends++;
        return;
    }
    assert_int_equal(log->ends, 0); // the end comes last
    if (log->count < 256) {
        log->tick[log->count] = frame->tick;
    }
    log->count++;
}

static void freewheel_frames_come_at_the_render_rate_of_session_time(void **state) {
    (void)state;
    frame_log log = {0};
    pal_session_def def = base_def(1.0, 1);
    def.render = log_frame;
    def.render_user = &log;
    watcher w = {0};
    pal_session_report r = run(&def, &w);
    // one every 33 periods from tick 0 on, and the last tick's
    assert_int_equal(log.count, 32);
    assert_int_equal(log.ends, 1);
    assert_int_equal(r.frames, 32);
    for (int i = 0; i < 31; i++) {
        assert_int_equal(log.tick[i], 33 * i);
    }
    assert_true(log.tick[31] > 990);
    def.render_rate = 0.0; // no render thread
    memset(&log, 0, sizeof log);
    memset(&w, 0, sizeof w);
    r = run(&def, &w);
    assert_int_equal(log.count, 0);
    assert_int_equal(r.frames, 0);
}

static void a_long_run_needs_no_more_memory(void **state) {
    (void)state;
    if (SANITIZED) {
        skip(); // sanitizers keep their own growing books
    }
    enum { TICKS = 150000 };
    pal_session_def def = base_def(TICKS * 1e-3, 1);
    watcher w = {.rss_at = {TICKS / 10, TICKS}};
    pal_session_report r = run(&def, &w);
    assert_int_equal(r.ticks, TICKS);
    // reading /proc and histogram pages touched late: 64 pages at most, against 36 000 000 bytes of
    // records that went through
    assert_true(w.rss[0] > 0 && w.rss[1] - w.rss[0] <= 64);
}

// ---- Order, overload, faults
// ----------------------------------------------------------------------

static void the_force_goes_out_before_the_field(void **state) {
    (void)state;
    pal_session_def def = base_def(0.5, 1);
    watcher w = {0};
    pal_session *session = create(&def, &w);
    w.reader = pal_engine_reader(pal_session_engine(session), 2); // the host's own reader
    assert_non_null(w.reader);
    assert_int_equal(pal_session_start(session, NULL), PALPATE_OK);
    assert_int_equal(pal_session_finish(session, NULL), PALPATE_OK);
    pal_session_free(session);
    assert_int_equal(w.writes, 500);
    assert_int_equal(w.early_fields, 0);
    assert_false(w.order_broken);
}

static void overload_skips_the_field_never_the_force(void **state) {
    (void)state;
    pal_session_def def = base_def(0.3, 0);
    def.engine.period = 0.01;
    watcher w = {.burn = 0.0099}; // 99 % of each period is gone when the force is out
    pal_session_report r = run(&def, &w);
    assert_int_equal(r.ticks + r.missed, 30);
    assert_int_equal(w.writes, r.ticks);
    assert_int_equal(r.field_skipped, r.ticks);
}

static void a_device_that_refuses_is_counted_and_marked(void **state) {
    (void)state;
    pal_session_def def = base_def(0.2, 1);
    watcher w = {.refuse_from = 101, .refuse_to = 111};
    pal_session *session = create(&def, &w);
    assert_int_equal(pal_session_start(session, NULL), PALPATE_OK);
    assert_int_equal(pal_session_finish(session, NULL), PALPATE_OK);
    pal_session_report r;
    static pal_tick_record ring[512];
    pal_session_get_report(session, &r);
    assert_int_equal(pal_session_ring(session, ring, 512), 200);
    assert_int_equal(r.device_errors, 10);
    assert_int_equal(r.ticks, 200);
    for (int i = 0; i < 200; i++) {
        assert_int_equal(ring[i].tick, i);
        assert_int_equal(ring[i].time_ns, i * INT64_C(1000000));
        int refused = i >= 100 && i < 110;
        assert_int_equal((ring[i].fault & PALPATE_FAULT_STALE) != 0, refused);
        if (refused) { // the last good pose stands in
            pal_tool_state stood_in = ring[99].state;
            stood_in.flags = PALPATE_STATE_STALE; // so says the servo to the engine
            assert_memory_equal(&ring[i].state, &stood_in, sizeof stood_in);
        }
    }
    pal_session_free(session);
}

// ---- Definition, scheduling, reference
// --------------------------------------------------------------

static void impossible_definitions_are_refused(void **state) {
    (void)state;
    pal_device null_device;
    pal_tool_def still = tool;
    still.device.kind = PALPATE_DEVICE_NULL;
    assert_int_equal(pal_device_create(&still, 1e-3, &null_device, NULL), PALPATE_OK);
    for (int i = 0; i < 16; i++) {
        pal_session_def d = base_def(1.0, 1);
        d.devices[0] = null_device;
        const char *word = "";
        switch (i) {
        case 0:
            d.cookie = 0;
            word = "pal_session_default_def";
            break;
        case 1:
            d.engine.tool_count = 0;
            word = "tool_count";
            break;
        case 2:
            d.engine.tool_count = PALPATE_TOOLS_MAX + 1;
            word = "tool_count";
            break;
        case 3:
            d.engine.period = 0;
            word = "period";
            break;
        case 4:
            d.engine.period = NAN;
            word = "period";
            break;
        case 5:
            d.duration = -1;
            word = "duration";
            break;
        case 6:
            d.duration = 1e-4;
            word = "duration";
            break;
        case 7:
            d.render_rate = -30;
            word = "render_rate";
            break;
        case 8:
            d.priority = 100;
            word = "priority";
            break;
        case 9:
            d.cpu = -2;
            word = "cpu";
            break;
        case 10:
            d.realtime = 3;
            word = "realtime";
            break;
        case 11:
            d.ring_ticks = 0;
            word = "ring_ticks";
            break;
        case 12:
            d.devices[0].abi = 99;
            word = "ABI";
            break;
        case 13:
            d.devices[0].read = NULL;
            word = "read";
            break;
        case 14:
            d.engine.tools = NULL;
            word = "tools";
            break;
        case 15:
            d.engine.cookie = 0;
            word = "";
            break;
        }
        pal_session *session = NULL;
        pal_error e = {0};
        pal_status status = pal_session_create(model, &d, &session, &e);
        if (status != PALPATE_ERROR_ARGUMENT || strstr(e.message, word) == NULL ||
            session != NULL) {
            fail_msg("case %d: %s: '%s'", i, pal_status_name(status), e.message);
        }
    }
    assert_int_equal(pal_session_create(NULL, NULL, NULL, NULL), PALPATE_ERROR_ARGUMENT);
    null_device.close(null_device.self); // still the caller's
    pal_session_free(NULL);
}

static void a_device_that_does_not_open_stops_the_start(void **state) {
    (void)state;
    pal_session_def def = base_def(1.0, 1);
    watcher w = {.open_fails = 1};
    pal_session *session = create(&def, &w);
    pal_error e = {0};
    assert_int_equal(pal_session_start(session, &e), PALPATE_ERROR_DEVICE);
    assert_non_null(strstr(e.message, "no such arm"));
    assert_non_null(strstr(e.message, "watcher"));
    assert_int_equal(pal_session_running(session), 0);
    pal_session_free(session);
    assert_int_equal(w.reads, 0);
    assert_int_equal(w.closes, 1);
}

static void sessions_may_be_dropped_at_any_stage(void **state) {
    (void)state;
    for (int stage = 0; stage < 2; stage++) {
        pal_session_def def = base_def(0.0, 0);
        watcher w = {0};
        pal_session *session = create(&def, &w);
        if (stage > 0) {
            assert_int_equal(pal_session_start(session, NULL), PALPATE_OK);
        }
        pal_session_free(session);
        assert_int_equal(w.closes, 1);
        assert_int_equal(w.writes, w.reads); // no tick is left half done
    }
}

/// In a child without privileges: best effort runs and says so, strict refuses and says why.
static void refused_real_time_is_said_not_hidden(void **state) {
    (void)state;
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        const struct rlimit none = {0, 0};
        int ok = setrlimit(RLIMIT_RTPRIO, &none) == 0 && setrlimit(RLIMIT_MEMLOCK, &none) == 0;
        ok = ok && (geteuid() != 0 || setuid(65534) == 0);
        pal_session_def def = base_def(0.05, 0);
        watcher w = {0};
        def.devices[0] = watch(&w);
        pal_session *session = NULL;
        pal_error e = {0};
        pal_session_report r;
        ok = ok && pal_session_create(model, &def, &session, &e) == PALPATE_OK &&
             pal_session_start(session, &e) == PALPATE_OK &&
             pal_session_finish(session, &e) == PALPATE_OK;
        if (!ok) {
            _exit(1);
        }
        pal_session_get_report(session, &r);
        pal_session_free(session);
        ok = r.ticks + r.missed == 50 &&
             strstr(r.scheduling, "SCHED_FIFO priority 80 was refused") != NULL &&
             strstr(r.scheduling, "RLIMIT_RTPRIO") != NULL &&
             // sanitizers turn mlockall into nothing and call it granted
             (SANITIZED || strstr(r.scheduling, "memory not locked") != NULL);
        if (!ok) {
            _exit(2);
        }
        watcher strict = {0};
        def.devices[0] = watch(&strict);
        def.realtime = 2;
        ok = pal_session_create(model, &def, &session, &e) == PALPATE_OK &&
             pal_session_start(session, &e) == PALPATE_ERROR_SYSTEM &&
             strstr(e.message, "SCHED_FIFO") != NULL && strict.reads == 0;
        pal_session_free(session);
        _exit(ok && strict.closes == 1 ? 0 : 3);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
}

static void granted_real_time_is_free_of_page_faults(void **state) {
    (void)state;
    pal_session_def def = base_def(0.5, 0);
    watcher w = {0};
    pal_session_report r = run(&def, &w);
    if (strstr(r.scheduling, "; memory locked") == NULL || SANITIZED) {
        skip(); // not privileged, or shadow memory faults
    }
    assert_non_null(strstr(r.scheduling, "SCHED_FIFO priority 80; pinned to core"));
    assert_int_equal(r.page_faults, 0);
}

static void only_the_servo_thread_is_touched(void **state) {
    (void)state;
    struct sched_param before, after;
    int policy_before, policy_after;
    cpu_set_t cores_before, cores_after;
    pthread_getschedparam(pthread_self(), &policy_before, &before);
    sched_getaffinity(0, sizeof cores_before, &cores_before);
    pal_session_def def = base_def(0.02, 0);
    watcher w = {0};
    (void)run(&def, &w);
    pthread_getschedparam(pthread_self(), &policy_after, &after);
    sched_getaffinity(0, sizeof cores_after, &cores_after);
    assert_int_equal(policy_before, policy_after);
    assert_true(CPU_EQUAL(&cores_before, &cores_after));
    volatile double tiny = 1e-308; // the host's arithmetic still has denormals
    assert_true(tiny * 0.5 > 0.0);
}

static void the_bare_reference_counts_by_the_same_rules(void **state) {
    (void)state;
    pal_session_def def = base_def(0.4, 0);
    def.reference_slice = 0.1;
    watcher w = {0};
    pal_session_report r = run(&def, &w);
    assert_int_equal(r.ticks + r.missed, 400); // session time stands still meanwhile
    assert_int_equal(r.bare.ticks + r.bare.missed, 300);
    assert_true(w.last_time <= 399 * INT64_C(1000000));

    pal_bare_report bare;
    const pal_rt_request request = {.want = 1, .cpu = -1, .priority = 80};
    char sentence[512] = "";
    pal_error e = {0};
    assert_int_equal(
        pal_servo_bare_loop(200, 1000000, &request, &bare, sentence, sizeof sentence, &e),
        PALPATE_OK);
    assert_int_equal(bare.ticks + bare.missed, 200);
    assert_true(sentence[0] != 0 && bare.lateness_us.max > 0);
    assert_int_equal(pal_servo_bare_loop(0, 1000000, &request, &bare, NULL, 0, &e),
                     PALPATE_ERROR_ARGUMENT);
}

static void two_sessions_share_a_model(void **state) {
    (void)state;
    pal_session_def def = base_def(1.0, 1);
    watcher w[2];
    memset(w, 0, sizeof w);
    pal_session *s[2] = {create(&def, &w[0]), create(&def, &w[1])};
    uint8_t digest[2][PALPATE_HASH_BYTES];
    for (int k = 0; k < 2; k++) {
        assert_int_equal(pal_session_start(s[k], NULL), PALPATE_OK);
    }
    for (int k = 0; k < 2; k++) {
        assert_int_equal(pal_session_finish(s[k], NULL), PALPATE_OK);
        pal_session_free(s[k]);
        pal_hash_final(&w[k].hash, digest[k]);
    }
    assert_memory_equal(digest[0], digest[1], PALPATE_HASH_BYTES);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ticks_and_missed_make_up_the_time),
        cmocka_unit_test(a_period_that_passes_is_counted_not_caught_up),
        cmocka_unit_test(odd_periods_add_up_too),
        cmocka_unit_test(a_stop_is_obeyed_in_the_same_tick),
        cmocka_unit_test(a_stop_from_outside_ends_an_endless_run),
        cmocka_unit_test(freewheel_evaluates_every_tick_and_repeats_bit_for_bit),
        cmocka_unit_test(freewheel_frames_come_at_the_render_rate_of_session_time),
        cmocka_unit_test(a_long_run_needs_no_more_memory),
        cmocka_unit_test(the_force_goes_out_before_the_field),
        cmocka_unit_test(overload_skips_the_field_never_the_force),
        cmocka_unit_test(a_device_that_refuses_is_counted_and_marked),
        cmocka_unit_test(impossible_definitions_are_refused),
        cmocka_unit_test(a_device_that_does_not_open_stops_the_start),
        cmocka_unit_test(sessions_may_be_dropped_at_any_stage),
        cmocka_unit_test(refused_real_time_is_said_not_hidden),
        cmocka_unit_test(granted_real_time_is_free_of_page_faults),
        cmocka_unit_test(only_the_servo_thread_is_touched),
        cmocka_unit_test(the_bare_reference_counts_by_the_same_rules),
        cmocka_unit_test(two_sessions_share_a_model),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
