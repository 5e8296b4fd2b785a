/// @file servo.c  The servo loop (timing rules: servo.h).
#include "haptic/session/servo.h"

#include <math.h>
#include <pthread.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "haptic/base/error.h"

enum { YIELD_NS = 50000 };

/// Deadlines on the grid anchor + n period, and where the loop stands on it.
typedef struct clock_grid {
    int64_t anchor, period;
    uint64_t next, end; ///< next period; end: one past the last, 0: endless
} clock_grid;

static uint64_t get(_Atomic uint64_t *x) {
    return atomic_load_explicit(x, memory_order_relaxed);
}

static void add(_Atomic uint64_t *x, uint64_t n) { // one writer: no locked instruction needed
    atomic_store_explicit(x, get(x) + n, memory_order_relaxed);
}

static int32_t clamp32(int64_t ns) {
    return ns > INT32_MAX ? INT32_MAX : (int32_t)ns;
}

static void nap(int64_t ns) {
    const struct timespec t = {.tv_nsec = (long)ns};
    (void)clock_nanosleep(CLOCK_MONOTONIC, 0, &t, NULL);
}

/// Wait for the next period; skip those that have wholly passed and count them.
/// @param[out] wake      when the loop woke [ns]
/// @param[out] lateness  behind the deadline it slept for [ns]
/// @return 1: a tick of period grid->next is due, 0: the last period has passed
static int await_period(clock_grid *grid, int64_t *wake, int64_t *lateness, uint64_t *missed) {
    int64_t deadline = grid->anchor + (int64_t)grid->next * grid->period;
    int64_t now = pal_rt_now();
    if (now < deadline) {
        pal_rt_sleep_until(deadline);
        now = pal_rt_now();
    }
    *wake = now;
    *lateness = now > deadline ? now - deadline : 0;
    uint64_t passed = (uint64_t)(*lateness / grid->period);
    if (grid->end != 0 && passed >= grid->end - grid->next) {
        *missed = grid->end - grid->next;
        grid->next = grid->end;
        return 0;
    }
    *missed = passed;
    grid->next += passed;
    return 1;
}

static int stopped(pal_servo *servo) {
    return atomic_load_explicit(&servo->stop, memory_order_relaxed) != 0;
}

// ---- Gate for frames in freewheel
// ----------------------------------------------------------------

int pal_gate_poll(pal_servo *servo, uint64_t *seen) {
    uint64_t step = atomic_load_explicit(&servo->gate.step, memory_order_acquire);
    int news = step != *seen;
    *seen = step;
    return news;
}

int pal_gate_wait(pal_servo *servo, uint64_t *seen) {
    for (;;) {
        int alive = atomic_load_explicit(&servo->running, memory_order_acquire);
        if (pal_gate_poll(servo, seen)) {
            return 1;
        }
        if (!alive) {
            return 0;
        }
        nap(YIELD_NS);
    }
}

void pal_gate_done(pal_servo *servo, int taker, uint64_t seen) {
    atomic_store_explicit(&servo->gate.done[taker], seen, memory_order_release);
}

/// One step: raise it and wait for the takers (who may block for long; a stop ends the wait).
static void gate_step(pal_servo *servo) {
    uint64_t step = atomic_load_explicit(&servo->gate.step, memory_order_relaxed) + 1;
    atomic_store_explicit(&servo->gate.step, step, memory_order_release);
    for (int t = 0; t < 2; t++) {
        while (atomic_load_explicit(&servo->gate.open[t], memory_order_relaxed) &&
               atomic_load_explicit(&servo->gate.done[t], memory_order_acquire) < step &&
               !stopped(servo)) {
            nap(YIELD_NS);
        }
    }
}

// ---- One tick
// ------------------------------------------------------------------------------------

/// @param missed  periods that passed before this tick; the engine learns of them by the state
static uint32_t read_devices(pal_servo *servo, int64_t time_ns, uint64_t missed,
                             pal_tool_state in[]) {
    const uint64_t most = UINT32_MAX >> PALPATE_STATE_MISSED_SHIFT;
    uint32_t gap = (uint32_t)(missed < most ? missed : most) << PALPATE_STATE_MISSED_SHIFT;
    uint32_t stale = 0;
    if (atomic_load_explicit(&servo->unlatch, memory_order_relaxed) != 0) {
        atomic_store_explicit(&servo->unlatch, 0, memory_order_relaxed);
        gap |= PALPATE_STATE_UNLATCH;
    }
    for (int32_t i = 0; i < servo->tool_count; i++) {
        pal_device *d = &servo->device[i];
        memset(&in[i], 0, sizeof in[i]);
        if (d->read(d->self, time_ns, &in[i]) == PALPATE_OK) {
            servo->last[i] = in[i];
            in[i].flags = gap;
        } else { // the last pose it gave stands in, and the tick says so
            in[i] = servo->last[i];
            in[i].flags = gap | PALPATE_STATE_STALE;
            stale |= 1u << i;
            add(&servo->device_errors, 1);
        }
    }
    return stale;
}

/// Refused writes are counted; returns a bit per tool whose force did not arrive.
static uint32_t write_devices(pal_servo *servo, int64_t time_ns, const pal_tool_force out[]) {
    uint32_t lost = 0;
    for (int32_t i = 0; i < servo->tool_count; i++) {
        pal_device *d = &servo->device[i];
        if (d->write != NULL && d->write(d->self, time_ns, &out[i]) != PALPATE_OK) {
            lost |= 1u << i;
            add(&servo->device_errors, 1);
        }
    }
    return lost;
}

static void keep_energy(pal_servo *servo, int32_t tool, const pal_tool_state *in,
                        const pal_tool_force *out) {
    pal_passivity *p = &servo->port[tool];
    (void)pal_passivity_tick(p, in->position, out->force);
    const double value[3] = {p->given, p->taken, p->worst};
    for (int k = 0; k < 3; k++) {
        atomic_store_explicit(&servo->energy[tool][k], value[k], memory_order_relaxed);
    }
}

static void keep_peaks(pal_servo *servo, const pal_tool_force *f) {
    double size =
        sqrt(f->force[0] * f->force[0] + f->force[1] * f->force[1] + f->force[2] * f->force[2]);
    if (size > atomic_load_explicit(&servo->peak_force, memory_order_relaxed)) {
        double body[3];
        pal_frames_vector_to_body(&servo->frames, f->force, body);
        atomic_store_explicit(&servo->peak_force, size, memory_order_relaxed);
        for (int k = 0; k < 3; k++) {
            atomic_store_explicit(&servo->peak_vector[k], body[k], memory_order_relaxed);
        }
    }
    if (f->depth > atomic_load_explicit(&servo->peak_depth, memory_order_relaxed)) {
        atomic_store_explicit(&servo->peak_depth, f->depth, memory_order_relaxed);
    }
}

/// The field, unless the period is too short for it. @param limit  it must be over by then [ns]; 0:
/// no limit. @return 1 when it ran
static int run_field(pal_servo *servo, int64_t start, int64_t limit, int64_t *end) {
    *end = start;
    if (limit != 0 && !pal_pace_allows(&servo->pace, limit - start)) {
        return 0;
    }
    pal_engine_field(servo->engine);
    *end = pal_rt_now();
    if (limit != 0) {
        pal_pace_ran(&servo->pace, *end - start, limit - start);
    }
    return 1;
}

static void push_record(pal_servo *servo, const pal_tick_record *record) {
    pal_ring_push(servo->ring, record);
    if (servo->queue == NULL) {
        return;
    }
    int pushed = pal_queue_push(servo->queue, record);
    while (!pushed && servo->freewheel && !stopped(servo)) { // nobody is waiting for the servo
        nap(YIELD_NS);
        pushed = pal_queue_push(servo->queue, record);
    }
    if (!pushed) {
        add(&servo->records_lost, 1);
    }
}

/// @param limit  the field must be over by then [ns]; 0: no limit
static void tick(pal_servo *servo, uint64_t period, uint64_t missed, int64_t wake, int64_t lateness,
                 int64_t limit) {
    pal_tool_state in[PALPATE_TOOLS_MAX];
    pal_tool_force out[PALPATE_TOOLS_MAX];
    int64_t time_ns = (int64_t)period * servo->period_ns;
    uint64_t number = get(&servo->ticks);
    int64_t cpu = pal_rt_cpu_now();
    uint32_t stale = read_devices(servo, time_ns, missed, in);
    int64_t posed = pal_rt_now();
    (void)pal_engine_force(servo->engine, in, out);
    int64_t forced = pal_rt_now();
    uint32_t lost = write_devices(servo, time_ns, out);
    int64_t written = pal_rt_now();
    int64_t end = written;
    int has_field = run_field(servo, written, limit, &end);
    cpu = pal_rt_cpu_now() - cpu;

    pal_servo_times *t = &servo->times;
    pal_histogram_add(&t->compute, end - wake);
    pal_histogram_add(&t->cpu, cpu);
    pal_histogram_add(&t->lateness, lateness);
    pal_histogram_add(&t->device, (posed - wake) + (written - forced));
    pal_histogram_add(&t->force, forced - posed);
    pal_histogram_add(&t->pose_to_force, written - posed);
    if (has_field) {
        pal_histogram_add(&t->field, end - written);
    } else {
        add(&servo->field_skipped, 1);
    }
    uint32_t latched = 0, now = 0, seen = atomic_load_explicit(&servo->fault, memory_order_relaxed);
    for (int32_t i = 0; i < servo->tool_count; i++) {
        keep_peaks(servo, &out[i]);
        keep_energy(servo, i, &in[i], &out[i]);
        const pal_tick_record record = {
            .tick = number,
            .time_ns = time_ns,
            .lateness_ns = lateness,
            .device_ns = clamp32((posed - wake) + (written - forced)),
            .force_ns = clamp32(forced - posed),
            .field_ns = clamp32(end - written),
            .compute_ns = clamp32(end - wake),
            .cpu_ns = clamp32(cpu),
            .field_skipped = !has_field,
            .fault = out[i].fault | ((stale >> i) & 1u ? PALPATE_FAULT_STALE : 0u) |
                     ((lost >> i) & 1u ? PALPATE_FAULT_STALL : 0u),
            .tool = i,
            .state = in[i],
            .force = out[i],
        };
        push_record(servo, &record);
        now |= record.fault;
        latched |= (record.fault & PALPATE_FAULT_LATCHED) != 0 ? 1u << i : 0u;
    }
    if ((now & ~servo->last_fault & servo->dump_mask) != 0 &&
        atomic_load_explicit(&servo->dump_due, memory_order_acquire) == 0) {
        atomic_store_explicit(&servo->dump_due, number + 1 + servo->dump_after,
                              memory_order_release);
    }
    servo->last_fault = now;
    atomic_store_explicit(&servo->fault, seen | now, memory_order_relaxed);
    atomic_store_explicit(&servo->latched, latched, memory_order_relaxed);
    add(&servo->ticks, 1);
}

// ---- The loop
// ------------------------------------------------------------------------------------

/// Sleep and wake for `periods` periods, counting as the servo counts.
static void bare_run(uint64_t periods, int64_t period, _Atomic int32_t *stop,
                     _Atomic uint64_t *ticks, _Atomic uint64_t *missed, pal_histogram *late) {
    clock_grid grid = {.anchor = pal_rt_now() + period, .period = period, .end = periods};
    int64_t wake, lateness;
    uint64_t lost;
    while (grid.next < grid.end && !atomic_load_explicit(stop, memory_order_relaxed)) {
        int due = await_period(&grid, &wake, &lateness, &lost);
        add(missed, lost);
        if (due) {
            pal_histogram_add(late, lateness);
            add(ticks, 1);
            grid.next++;
        }
    }
}

static uint64_t page_faults(void) {
    struct rusage usage;
    return getrusage(RUSAGE_THREAD, &usage) == 0 ? (uint64_t)(usage.ru_minflt + usage.ru_majflt)
                                                 : 0;
}

static void run_realtime(pal_servo *servo) {
    clock_grid grid = {.anchor = pal_rt_now() + servo->period_ns,
                       .period = servo->period_ns,
                       .end = servo->periods};
    uint64_t slice_end = servo->slice_periods;
    uint64_t faults = 0;
    while ((grid.end == 0 || grid.next < grid.end) && !stopped(servo)) {
        if (slice_end != 0 && grid.next >= slice_end) {
            // session time stands still: the grid moves by what the slice took
            bare_run(servo->slice_periods, servo->period_ns, &servo->stop, &servo->bare_ticks,
                     &servo->bare_missed, &servo->bare_lateness);
            slice_end = grid.next + servo->slice_periods;
            grid.anchor = pal_rt_now() + servo->period_ns - (int64_t)grid.next * servo->period_ns;
            continue;
        }
        int64_t wake, lateness;
        uint64_t missed;
        int due = await_period(&grid, &wake, &lateness, &missed);
        add(&servo->missed, missed);
        if (!due || stopped(servo)) {
            break;
        }
        int64_t over = grid.anchor + (int64_t)(grid.next + 1) * grid.period;
        tick(servo, grid.next, missed, wake, lateness, over - grid.period / 32);
        grid.next++;
        if (get(&servo->ticks) == 1) {
            faults = page_faults();
        }
    }
    atomic_store_explicit(&servo->page_faults, page_faults() - faults, memory_order_relaxed);
}

static void run_freewheel(pal_servo *servo) {
    for (uint64_t n = 0; (servo->periods == 0 || n < servo->periods) && !stopped(servo); n++) {
        int frame = servo->frame_periods != 0 && n % servo->frame_periods == 0;
        if (frame) {
            gate_step(servo); // takers drain what is old
        }
        tick(servo, n, 0, pal_rt_now(), 0, 0);
        for (uint64_t due = atomic_load(&servo->dump_due);
             due != 0 && get(&servo->ticks) >= due && !stopped(servo);
             due = atomic_load(&servo->dump_due)) {
            nap(YIELD_NS); // the ring holds what the dump is for
        }
        if (frame) {
            gate_step(servo); // takers take this tick's
        }
    }
}

void pal_servo_run(pal_servo *servo) {
    atomic_store_explicit(&servo->running, 1, memory_order_release);
    pal_pace_init(&servo->pace, servo->period_ns);
    for (int32_t i = 0; i < servo->tool_count; i++) {
        servo->last[i].orientation[0] = 1.0;
    }
    if (servo->freewheel) {
        run_freewheel(servo);
    } else {
        run_realtime(servo);
    }
    atomic_store_explicit(&servo->running, 0, memory_order_release);
}

pal_status pal_servo_init(pal_servo *servo) {
    enum { HISTOGRAMS = 8 };
    pal_histogram *all[HISTOGRAMS] = {&servo->times.compute,       &servo->times.cpu,
                                      &servo->times.lateness,      &servo->times.device,
                                      &servo->times.force,         &servo->times.field,
                                      &servo->times.pose_to_force, &servo->bare_lateness};
    for (int i = 0; i < HISTOGRAMS; i++) {
        if (pal_histogram_init(all[i]) != PALPATE_OK) {
            pal_servo_clear(servo);
            return PALPATE_ERROR_MEMORY;
        }
    }
    return PALPATE_OK;
}

void pal_servo_clear(pal_servo *servo) {
    pal_histogram_clear(&servo->times.compute);
    pal_histogram_clear(&servo->times.cpu);
    pal_histogram_clear(&servo->times.lateness);
    pal_histogram_clear(&servo->times.device);
    pal_histogram_clear(&servo->times.force);
    pal_histogram_clear(&servo->times.field);
    pal_histogram_clear(&servo->times.pose_to_force);
    pal_histogram_clear(&servo->bare_lateness);
}

// ---- The bare loop
// -------------------------------------------------------------------------------

typedef struct bare_thread {
    const pal_rt_request *request;
    pal_rt_grant grant;
    uint64_t periods;
    int64_t period_ns;
    _Atomic int32_t stop;
    _Atomic uint64_t ticks, missed;
    pal_histogram lateness;
} bare_thread;

static void *bare_main(void *arg) {
    bare_thread *b = arg;
    pal_rt_enter(b->request, &b->grant);
    bare_run(b->periods, b->period_ns, &b->stop, &b->ticks, &b->missed, &b->lateness);
    return NULL;
}

pal_status pal_servo_bare_loop(uint64_t periods, int64_t period_ns, const pal_rt_request *request,
                               pal_bare_report *out, char *scheduling, size_t scheduling_size,
                               pal_error *error) {
    if (out == NULL || request == NULL || periods == 0 || period_ns <= 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "bare loop: %llu periods of %lld ns",
                        (unsigned long long)periods, (long long)period_ns);
    }
    memset(out, 0, sizeof *out);
    bare_thread b = {.request = request, .periods = periods, .period_ns = period_ns};
    if (pal_histogram_init(&b.lateness) != PALPATE_OK) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "bare loop: no memory for its histogram");
    }
    pthread_t thread;
    int failed = pthread_create(&thread, NULL, bare_main, &b);
    if (failed == 0) {
        pthread_join(thread, NULL);
        out->ticks = get(&b.ticks);
        out->missed = get(&b.missed);
        out->lateness_us = pal_histogram_us(&b.lateness);
        if (scheduling != NULL) {
            pal_rt_describe(request, &b.grant, scheduling, scheduling_size);
        }
    }
    pal_histogram_clear(&b.lateness);
    return failed == 0
               ? PALPATE_OK
               : pal_fail(error, PALPATE_ERROR_SYSTEM, "bare loop: no thread (error %d)", failed);
}
