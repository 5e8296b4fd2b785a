/// @file session.c  A session's life: create, start, finish, report. The threads' loops are in
/// servo.c, render_thread.c and record.c.
///
/// All memory exists before the servo starts: the servo thread is created first, sets itself up
/// (realtime.h) and waits; the other threads follow; memory is locked; then the servo may go.
#include <palpate/session.h>

#include <math.h>
#include <pthread.h>
#include <semaphore.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "haptic/session/dump.h"
#include "haptic/base/error.h"
#include "haptic/safety/output.h"
#include "haptic/session/record.h"
#include "haptic/session/render_thread.h"
#include "haptic/session/servo.h"

enum { SESSION_COOKIE = 0x5e551081, STACK_BYTES = 1 << 20, QUEUE_SECONDS = 8, LEAST_READERS = 2 };

/// FAILED: the start was refused; nothing runs and nothing was recorded.
typedef enum session_stage { CREATED, STARTED, FINISHED, FAILED } session_stage;

struct pal_session {
    pal_servo servo;
    pal_render render;
    pal_recorder recorder;
    pal_dumper dumper;
    pal_ring ring;
    pal_queue queue;
    pal_engine *engine;
    pal_device device[PALPATE_TOOLS_MAX];
    int32_t tool_count;
    pal_rt_request request;
    pal_rt_grant grant;
    int32_t strict; ///< realtime: 2
    session_stage stage;
    pthread_t servo_thread, render_thread, record_thread, dump_thread;
    int has_servo, has_render, has_record, has_dump; ///< threads to join
    int want_render, want_record, want_dump;
    pal_field_by field_by;
    sem_t entered, go; ///< servo has set itself up; servo may start
    int latency_fd;
    pal_ticks_header header; ///< for dumps
    pal_engine_counts counts;
    char scheduling[512];
};

pal_session_def pal_session_default_def(void) {
    pal_session_def def;
    memset(&def, 0, sizeof def);
    def.cookie = SESSION_COOKIE;
    def.engine = pal_engine_default_def();
    def.realtime = 1;
    def.cpu = -1;
    def.priority = 80;
    def.render_rate = 30.0;
    def.ring_ticks = 8192;
    def.dump_faults = PALPATE_DUMP_FAULTS;
    return def;
}

static pal_status check_def(const pal_session_def *def, pal_error *error) {
    const struct {
        const char *name;
        double value, low, high;
    } range[] = {
        {"engine.tool_count", def->engine.tool_count, 1, PALPATE_TOOLS_MAX},
        {"engine.period [s]", def->engine.period, 1e-5, 10.0},
        {"duration [s]", def->duration, 0.0, 1e9},
        {"render_rate [Hz]", def->render_rate, 0.0, 1000.0},
        {"priority", def->priority, 1, 99},
        {"cpu", def->cpu, -1, 4095},
        {"realtime", def->realtime, 0, 2},
        {"ring_ticks", def->ring_ticks, 1, 1 << 24},
        {"reference_slice [s]", def->reference_slice, 0.0, 1e6},
    };
    if (def->cookie != SESSION_COOKIE) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "session definition: make it with pal_session_default_def()");
    }
    for (size_t i = 0; i < sizeof range / sizeof *range; i++) {
        if (!(range[i].value >= range[i].low && range[i].value <= range[i].high)) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "session definition: %s is %g, allowed: %g to %g", range[i].name,
                            range[i].value, range[i].low, range[i].high);
        }
    }
    if (def->engine.tools == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "session definition: engine.tools is NULL");
    }
    for (int32_t i = 0; i < def->engine.tool_count; i++) {
        const pal_device *d = &def->devices[i];
        if (d->abi != PALPATE_DEVICE_ABI || d->read == NULL) {
            return pal_fail(
                error, PALPATE_ERROR_ARGUMENT,
                "session definition: device of tool '%s' has ABI %u (this library: %u) and %s "
                "read function; make it with pal_device_create or pal_device_host_create",
                def->engine.tools[i].name, (unsigned)d->abi, PALPATE_DEVICE_ABI,
                d->read == NULL ? "no" : "a");
        }
    }
    return PALPATE_OK;
}

static uint64_t whole_periods(double seconds, double period) {
    return (uint64_t)llround(seconds / period);
}

/// Periods between two frames of the render rate; at least one.
static uint64_t frame_periods(double rate, double period) {
    uint64_t n = rate > 0.0 ? (uint64_t)(1.0 / (rate * period) + 1e-9) : 0;
    return rate > 0.0 && n == 0 ? 1 : n;
}

static pal_status build(pal_session *s, const pal_model *model, const pal_session_def *asked,
                        pal_error *error) {
    pal_session_def own = *asked, *def = &own;
    pal_engine_def engine_def = def->engine;
    pal_tool_def tool[PALPATE_TOOLS_MAX];
    for (int32_t i = 0; i < engine_def.tool_count; i++) {
        tool[i] = engine_def.tools[i];
        tool[i].spec = pal_spec_merge(&tool[i].spec, &def->devices[i].spec);
    }
    engine_def.tools = tool;
    if (engine_def.reader_count < LEAST_READERS) {
        engine_def.reader_count = LEAST_READERS; // render and recorder; the host's own come after
    }
    pal_status status = pal_engine_create(model, &engine_def, &s->engine, error);
    if (status != PALPATE_OK) {
        return status;
    }
    def->engine = *pal_engine_get_def(s->engine); // limits and watchdog in effect
    s->tool_count = def->engine.tool_count;
    s->want_render = def->render_rate > 0.0;
    s->want_record = def->record_path != NULL;
    s->field_by = def->engine.field_by;
    s->strict = def->realtime == 2 && !def->freewheel;
    s->request = (pal_rt_request){
        .want = def->realtime != 0 && !def->freewheel, .cpu = def->cpu, .priority = def->priority};
    pal_ticks_header_fill(&s->header, model, def);

    pal_servo *servo = &s->servo;
    servo->engine = s->engine;
    servo->device = s->device;
    servo->tool_count = s->tool_count;
    servo->freewheel = def->freewheel != 0;
    servo->period_ns = llround(def->engine.period * 1e9);
    servo->periods = whole_periods(def->duration, def->engine.period);
    servo->frame_periods = frame_periods(def->render_rate, def->engine.period);
    servo->slice_periods = whole_periods(def->reference_slice, def->engine.period);
    servo->frames = pal_frames_make(&def->engine.body_pose, &def->engine.device_to_world,
                                    def->engine.device_scale);
    servo->ring = &s->ring;
    if (def->duration > 0.0 && servo->periods == 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "session definition: duration %g s is shorter than half a period of %g s",
                        def->duration, def->engine.period);
    }
    int64_t queued = (int64_t)(QUEUE_SECONDS / def->engine.period) * s->tool_count;
    queued = queued < 8192 ? 8192 : queued;
    queued = queued > 1 << 20 ? 1 << 20 : queued;
    if (pal_servo_init(servo) != PALPATE_OK ||
        pal_ring_init(&s->ring, def->ring_ticks) != PALPATE_OK ||
        (s->want_record && pal_queue_init(&s->queue, queued) != PALPATE_OK)) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "session: no memory for rings of %d ticks",
                        (int)def->ring_ticks);
    }
    s->render.servo = servo;
    s->render.reader = pal_engine_reader(s->engine, 0);
    s->render.period_ns = def->render_rate > 0.0 ? (int64_t)(1e9 / def->render_rate) : 0;
    s->render.call = def->render;
    s->render.user = def->render_user;
    s->want_dump = def->dump_path != NULL;
    if (s->want_dump) {
        uint64_t second = (uint64_t)(1.0 / def->engine.period),
                 quarter = (uint64_t)def->ring_ticks / 4;
        quarter /= (uint64_t)s->tool_count; // the ring holds a record per tool and tick
        s->dumper = (pal_dumper){.servo = servo, .ring = &s->ring, .header = &s->header};
        servo->dump_mask = def->dump_faults;
        servo->dump_after = quarter < second ? quarter : second;
        status = pal_dumper_init(&s->dumper, def->dump_path, error);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    if (s->want_record) {
        servo->queue = &s->queue;
        s->recorder.servo = servo;
        s->recorder.queue = &s->queue;
        s->recorder.reader = def->render_rate > 0.0 ? pal_engine_reader(s->engine, 1) : NULL;
        status = pal_recorder_open(&s->recorder, model, def, error);
    }
    return status;
}

/// Free all but the devices.
static void tear_down(pal_session *s) {
    pal_dumper_clear(&s->dumper);
    pal_recorder_close(&s->recorder, s->stage == CREATED || s->stage == FAILED);
    pal_queue_clear(&s->queue);
    pal_ring_clear(&s->ring);
    pal_servo_clear(&s->servo);
    pal_engine_free(s->engine);
    sem_destroy(&s->entered);
    sem_destroy(&s->go);
    free(s);
}

pal_status pal_session_create(const pal_model *model, const pal_session_def *def, pal_session **out,
                              pal_error *error) {
    if (model == NULL || def == NULL || out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_session_create: NULL argument");
    }
    *out = NULL;
    pal_status status = check_def(def, error);
    if (status != PALPATE_OK) {
        return status;
    }
    // the queue keeps its two ends on cache lines of their own
    size_t size = (sizeof(pal_session) + 63) / 64 * 64;
    pal_session *s = aligned_alloc(64, size);
    if (s == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "session: no memory");
    }
    memset(s, 0, size);
    s->latency_fd = -1;
    s->recorder.ticks.fd = s->recorder.frames.fd = -1;
    (void)sem_init(&s->entered, 0, 0);
    (void)sem_init(&s->go, 0, 0);
    status = build(s, model, def, error);
    if (status != PALPATE_OK) {
        tear_down(s);
        return status;
    }
    memcpy(s->device, def->devices, sizeof s->device);
    *out = s;
    return PALPATE_OK;
}

static void *servo_main(void *arg) {
    pal_session *s = arg;
    pal_rt_enter(&s->request, &s->grant);
    sem_post(&s->entered);
    while (sem_wait(&s->go) != 0) {
    }
    pal_servo_run(&s->servo);
    return NULL;
}

static void *render_main(void *arg) {
    pal_session *s = arg;
    if (s->field_by == PALPATE_FIELD_BY_READER) { // to have the servo's bits, tiny ones included
        (void)pal_rt_flush_denormals();
    }
    pal_render_run(&s->render);
    return NULL;
}

static void *record_main(void *arg) {
    pal_session *s = arg;
    if (s->field_by == PALPATE_FIELD_BY_READER) {
        (void)pal_rt_flush_denormals();
    }
    pal_recorder_run(&s->recorder);
    return NULL;
}

static void *dump_main(void *arg) {
    pal_dumper_run(&((pal_session *)arg)->dumper);
    return NULL;
}

/// A thread with ordinary scheduling whatever the host's is, and no signal: those are the host's.
static int spawn(pthread_t *thread, void *(*body)(void *), pal_session *s) {
    pthread_attr_t attributes;
    sigset_t all;
    const struct sched_param param = {.sched_priority = 0};
    sigfillset(&all);
    int failed = pthread_attr_init(&attributes);
    if (failed != 0) {
        return failed;
    }
    if (body == servo_main) { // others run the host's drawing code: default stack
        (void)pthread_attr_setstacksize(&attributes, STACK_BYTES);
    }
    (void)pthread_attr_setinheritsched(&attributes, PTHREAD_EXPLICIT_SCHED);
    (void)pthread_attr_setschedpolicy(&attributes, SCHED_OTHER);
    (void)pthread_attr_setschedparam(&attributes, &param);
    (void)pthread_attr_setsigmask_np(&attributes, &all);
    failed = pthread_create(thread, &attributes, body, s);
    (void)pthread_attr_destroy(&attributes);
    return failed;
}

static void join_threads(pal_session *s) {
    if (s->has_servo) {
        pthread_join(s->servo_thread, NULL);
    }
    if (s->has_render) {
        pthread_join(s->render_thread, NULL);
    }
    if (s->has_record) {
        pthread_join(s->record_thread, NULL);
    }
    if (s->has_dump) {
        pthread_join(s->dump_thread, NULL);
    }
    s->has_servo = s->has_render = s->has_record = s->has_dump = 0;
    if (s->latency_fd >= 0) {
        close(s->latency_fd);
        s->latency_fd = -1;
    }
}

/// Start the servo thread and let it set itself up, then the others. @return 0 or errno
static int start_threads(pal_session *s) {
    int failed = spawn(&s->servo_thread, servo_main, s);
    s->has_servo = failed == 0;
    if (failed != 0) {
        return failed;
    }
    while (sem_wait(&s->entered) != 0) {
    }
    atomic_store(&s->servo.gate.open[PALPATE_TAKER_RENDER], s->want_render);
    atomic_store(&s->servo.gate.open[PALPATE_TAKER_RECORD],
                 s->want_record && s->recorder.reader != NULL);
    if (s->want_render) {
        failed = spawn(&s->render_thread, render_main, s);
        s->has_render = failed == 0;
    }
    if (failed == 0 && s->want_record) {
        failed = spawn(&s->record_thread, record_main, s);
        s->has_record = failed == 0;
    }
    if (failed == 0 && s->want_dump) {
        failed = spawn(&s->dump_thread, dump_main, s);
        s->has_dump = failed == 0;
    }
    return failed;
}

pal_status pal_session_start(pal_session *s, pal_error *error) {
    if (s == NULL || s->stage != CREATED) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_session_start: the session was started before");
    }
    for (int32_t i = 0; i < s->tool_count; i++) {
        if (s->device[i].open != NULL) {
            pal_status status = s->device[i].open(s->device[i].self, error);
            if (status != PALPATE_OK) {
                s->stage = FAILED;
                return pal_fail_prefix(error, status, "device '%.*s'", PALPATE_NAME_MAX,
                                       s->device[i].spec.name);
            }
        }
    }
    s->stage = STARTED;
    atomic_store(&s->servo.running, 1); // before any thread looks
    int failed = start_threads(s);
    if (failed == 0 && s->request.want) {
        pal_rt_lock_memory(&s->grant);
        s->latency_fd = pal_rt_hold_latency(&s->grant);
    }
    if (s->servo.freewheel) {
        (void)snprintf(
            s->scheduling, sizeof s->scheduling, "freewheel: no deadlines, ordinary scheduling; %s",
            s->grant.denormals == 0 ? "denormals flushed" : "denormals not flushed (unknown CPU)");
    } else {
        pal_rt_describe(&s->request, &s->grant, s->scheduling, sizeof s->scheduling);
    }
    int refused = s->strict && !pal_rt_granted(&s->grant);
    if (failed != 0 || refused) {
        atomic_store(&s->servo.stop, 1);
        if (!s->has_servo) {
            atomic_store(&s->servo.running, 0);
        }
        sem_post(&s->go);
        join_threads(s);
        s->stage = FAILED;
        return failed != 0
                   ? pal_fail(error, PALPATE_ERROR_SYSTEM,
                              "session: a thread could not be started: %s", strerror(failed))
                   : pal_fail(error, PALPATE_ERROR_SYSTEM, "strict real time was asked for: %s",
                              s->scheduling);
    }
    sem_post(&s->go);
    return PALPATE_OK;
}

void pal_session_request_stop(pal_session *session) {
    atomic_store_explicit(&session->servo.stop, 1, memory_order_relaxed);
}

void pal_session_unlatch(pal_session *session) {
    atomic_store_explicit(&session->servo.unlatch, 1, memory_order_relaxed);
}

void pal_session_request_dump(pal_session *session) {
    atomic_store(&session->dumper.requested, 1);
}

int pal_session_running(const pal_session *session) {
    return session->stage == STARTED &&
           atomic_load_explicit(&session->servo.running, memory_order_acquire);
}

static void close_devices(pal_session *s) {
    for (int32_t i = 0; i < s->tool_count; i++) {
        if (s->device[i].close != NULL) {
            s->device[i].close(s->device[i].self);
        }
        memset(&s->device[i], 0, sizeof s->device[i]);
    }
}

pal_status pal_session_finish(pal_session *s, pal_error *error) {
    if (s == NULL || s->stage != STARTED) {
        return PALPATE_OK;
    }
    join_threads(s);
    pal_engine_get_counts(s->engine, &s->counts);
    s->stage = FINISHED;
    close_devices(s);
    pal_status status = PALPATE_OK;
    if (s->want_record) {
        pal_recorder_close(&s->recorder, 0);
        status = pal_recording_convert(s->recorder.path, NULL, error);
    }
    pal_status dumped = s->want_dump
                            ? pal_dumper_convert(&s->dumper, status == PALPATE_OK ? error : NULL)
                            : PALPATE_OK;
    return status != PALPATE_OK ? status : dumped;
}

void pal_session_free(pal_session *s) {
    if (s == NULL) {
        return;
    }
    if (s->stage == STARTED) {
        pal_session_request_stop(s);
        (void)pal_session_finish(s, NULL);
    }
    close_devices(s);
    tear_down(s);
}

pal_engine *pal_session_engine(pal_session *session) {
    return session->engine;
}

void pal_session_get_report(const pal_session *s, pal_session_report *out) {
    const pal_servo *v = &s->servo;
    memset(out, 0, sizeof *out);
    out->ticks = atomic_load_explicit(&v->ticks, memory_order_relaxed);
    out->missed = atomic_load_explicit(&v->missed, memory_order_relaxed);
    out->frames = atomic_load_explicit(&s->render.frames, memory_order_relaxed);
    out->field_skipped = atomic_load_explicit(&v->field_skipped, memory_order_relaxed);
    out->device_errors = atomic_load_explicit(&v->device_errors, memory_order_relaxed);
    out->page_faults = atomic_load_explicit(&v->page_faults, memory_order_relaxed);
    out->seconds = 1e-9 * (double)v->period_ns * (double)(out->ticks + out->missed);
    out->compute_us = pal_histogram_us(&v->times.compute);
    out->cpu_us = pal_histogram_us(&v->times.cpu);
    out->lateness_us = pal_histogram_us(&v->times.lateness);
    out->device_us = pal_histogram_us(&v->times.device);
    out->force_us = pal_histogram_us(&v->times.force);
    out->field_us = pal_histogram_us(&v->times.field);
    out->pose_to_force_us = pal_histogram_us(&v->times.pose_to_force);
    out->peak_force = atomic_load_explicit(&v->peak_force, memory_order_relaxed);
    out->peak_depth = atomic_load_explicit(&v->peak_depth, memory_order_relaxed);
    for (int k = 0; k < 3; k++) {
        out->peak_force_vector[k] = atomic_load_explicit(&v->peak_vector[k], memory_order_relaxed);
    }
    for (int32_t t = 0; t < v->tool_count; t++) {
        out->port[t].given = atomic_load_explicit(&v->energy[t][0], memory_order_relaxed);
        out->port[t].taken = atomic_load_explicit(&v->energy[t][1], memory_order_relaxed);
        out->port[t].worst = atomic_load_explicit(&v->energy[t][2], memory_order_relaxed);
    }
    out->counts = s->counts;
    out->latched = atomic_load_explicit(&v->latched, memory_order_relaxed);
    out->fault = atomic_load_explicit(&v->fault, memory_order_relaxed);
    out->tool_count = s->tool_count;
    for (int32_t i = 0; i < s->tool_count; i++) {
        out->limits[i] = pal_engine_get_def(s->engine)->tools[i].limits;
    }
    out->bare.ticks = atomic_load_explicit(&v->bare_ticks, memory_order_relaxed);
    out->bare.missed = atomic_load_explicit(&v->bare_missed, memory_order_relaxed);
    out->bare.lateness_us = pal_histogram_us(&v->bare_lateness);
    if (s->want_record) {
        const pal_recorder *r = &s->recorder;
        out->records = atomic_load_explicit(&r->records, memory_order_relaxed);
        out->records_lost = atomic_load_explicit(&r->records_lost, memory_order_relaxed) +
                            atomic_load_explicit(&v->records_lost, memory_order_relaxed);
        out->record_frames = atomic_load_explicit(&r->frames_done, memory_order_relaxed);
        out->record_frames_lost = atomic_load_explicit(&r->frames_lost, memory_order_relaxed);
        int why = atomic_load_explicit(&r->first_errno, memory_order_relaxed);
        if (why != 0) {
            char text[96];
            (void)snprintf(out->record_error, sizeof out->record_error, "%.128s: %s", r->path,
                           strerror_r(why, text, sizeof text));
        }
    }
    out->dumps = atomic_load_explicit(&s->dumper.count, memory_order_acquire);
    out->dumps_lost = atomic_load_explicit(&s->dumper.skipped, memory_order_relaxed);
    if (out->dumps > 0) {
        char name[PALPATE_RECORDING_PATH];
        (void)pal_dump_name(s->dumper.path, s->dumper.number[out->dumps - 1], name);
        (void)snprintf(out->dump_path, sizeof out->dump_path, "%.255s", name);
    }
    memcpy(out->scheduling, s->scheduling, sizeof out->scheduling);
}

int32_t pal_session_ring(const pal_session *session, pal_tick_record *out, int32_t capacity) {
    return pal_ring_copy(&session->ring, out, capacity);
}

pal_status pal_session_dump(const pal_session *s, const char *path, pal_error *error) {
    pal_tick_record *record = malloc(s->ring.capacity * sizeof *record);
    if (record == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory for %llu records", path,
                        (unsigned long long)s->ring.capacity);
    }
    pal_status status = pal_dump_ring(&s->ring, &s->header, path, record, error);
    free(record);
    return status == PALPATE_OK ? pal_recording_convert(path, NULL, error) : status;
}
