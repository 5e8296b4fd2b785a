/// The fault table (tests/README.md), rows of the device, the servo and the render thread: each
/// fault is injected into a whole session by a device that lies; what is felt, counted, recorded
/// and dumped is what the table says, the recording replays bit for bit, and so does the dump.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/session.h>

#include "haptic/base/realtime.h"
#include "haptic/recording/recording_read.h"
#include "haptic/recording/replay.h"
#include "tests/support/synthetic_model.h"

enum { AT = 300, TICKS = 2400, MS = 1000000 }; ///< first bad tick

static pal_model *model;
static pal_tool_def tool;
static char folder[64], record_path[128], dump_path[128];

static int set_up(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    model = synthetic_model(&p);
    (void)snprintf(folder, sizeof folder, "/tmp/palpate-faults-XXXXXX");
    if (model == NULL || mkdtemp(folder) == NULL) {
        return 1;
    }
    (void)snprintf(record_path, sizeof record_path, "%s/run.h5", folder);
    (void)snprintf(dump_path, sizeof dump_path, "%s/dump.h5", folder);
    tool = pal_model_runtime(model)->tools[0];
    tool.limits = (pal_tool_limits){.force = 0.3, .slew = 0.5};
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[128];
    pal_model_free(model);
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command); // NOLINT(cert-env33-c): our own folder
}

// ---- A device that lies -------------------------------------------------------------------------

typedef enum lie {
    HONEST,
    NOT_A_NUMBER,
    INFINITE_TURN,
    FROZEN_STAMP,
    FROZEN_UNSTAMPED,
    TELEPORT,
    BACKWARDS,
    REFUSED,
    REFUSED_WRITE
} lie;

typedef struct liar {
    lie what;
    int64_t length;     ///< ticks
    int64_t unlatch_at; ///< tick before which the session is told to let go; 0: never
    int64_t hold_at;    ///< this read takes hold_ns; 0: none
    int64_t hold_ns;
    pal_session *session;
    int64_t reads, writes;
    double last[3], steady; ///< force of the tick before; |force| of tick AT - 1
    double before_bad[3];
    int64_t zero_from, zero_to; ///< ticks without force among the bad ones and after
    int64_t steady_from;        ///< force is steady from here to the end
    int broken;                 ///< a force that broke a limit
} liar;

static pal_status liar_read(void *self, int64_t time_ns, pal_tool_state *state) {
    liar *d = self;
    int64_t n = d->reads++;
    int bad = n >= AT && n < AT + d->length;
    if (d->unlatch_at != 0 && n == d->unlatch_at - 1) {
        pal_session_unlatch(d->session); // the next tick's input carries it
    }
    if (d->hold_at != 0 && n == d->hold_at) {
        int64_t until = pal_rt_now() + d->hold_ns;
        while (pal_rt_now() < until) {
        }
    }
    *state = (pal_tool_state){.orientation = {1, 0, 0, 0}, .time_ns = time_ns + MS};
    memcpy(state->position, tool.start, sizeof state->position);
    double press = n < 250 ? (double)n / 250.0 : 1.0;
    state->position[2] += 0.0005 - 0.0025 * press;
    if (!bad) {
        return PALPATE_OK;
    }
    switch (d->what) {
    case NOT_A_NUMBER:
        state->position[n % 3] = (double)NAN;
        break;
    case INFINITE_TURN:
        state->orientation[n % 4] = (double)INFINITY;
        break;
    case FROZEN_STAMP:
        state->time_ns = (int64_t)AT * MS;
        break;
    case FROZEN_UNSTAMPED:
        state->time_ns = 0;
        break;
    case TELEPORT:
        state->position[0] += 1.0;
        break;
    case BACKWARDS:
        state->time_ns = ((int64_t)AT - (n - AT)) * MS;
        break;
    case REFUSED:
        return PALPATE_ERROR_DEVICE;
    case HONEST:
    case REFUSED_WRITE:
        break;
    }
    return PALPATE_OK;
}

static pal_status liar_write(void *self, int64_t time_ns, const pal_tool_force *force) {
    liar *d = self;
    (void)time_ns;
    int64_t n = d->writes++;
    double size = 0.0, change = 0.0, torque = 0.0;
    for (int i = 0; i < 3; i++) {
        double f = force->force[i];
        size += f * f;
        change += (f - d->last[i]) * (f - d->last[i]);
        torque += force->torque[i] * force->torque[i];
        d->last[i] = f;
    }
    size = sqrt(size);
    // the default torque cap; rounding of the vectors' lengths
    d->broken |= !(size <= 0.3 * (1 + 1e-12)) || !(sqrt(change) <= 0.5 * (1 + 1e-9)) ||
                 !(sqrt(torque) <= PALPATE_DEFAULT_TORQUE * (1 + 1e-12));
    if (n == AT - 1) {
        d->steady = size;
    }
    if (n >= AT && size == 0.0) {
        d->zero_from = d->zero_from == 0 ? n : d->zero_from;
        d->zero_to = n;
    }
    // a tool that left and came back meets the nodes in another order, which rounds otherwise
    if (n >= AT && fabs(size - d->steady) > 1e-9 * d->steady) {
        d->steady_from = n + 1;
    }
    int bad = n >= AT && n < AT + d->length;
    return d->what == REFUSED_WRITE && bad ? PALPATE_ERROR_DEVICE : PALPATE_OK;
}

static pal_session *open_session(liar *d, int freewheel, double seconds) {
    pal_error e = {0};
    pal_session_def def = pal_session_default_def();
    pal_session *session = NULL;
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.duration = seconds;
    def.freewheel = freewheel;
    def.realtime = 0;
    def.record_path = record_path;
    def.dump_path = dump_path;
    def.devices[0] =
        (pal_device){.abi = PALPATE_DEVICE_ABI, .self = d, .read = liar_read, .write = liar_write};
    (void)unlink(record_path);
    (void)unlink(dump_path);
    if (pal_session_create(model, &def, &session, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    d->session = session;
    return session;
}

static pal_session_report finish(pal_session *session) {
    pal_error e = {0};
    pal_session_report r;
    if (pal_session_finish(session, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_session_get_report(session, &r);
    pal_session_free(session);
    return r;
}

static pal_session_report run(liar *d) {
    pal_session *session = open_session(d, 1, TICKS * 1e-3);
    assert_int_equal(pal_session_start(session, NULL), PALPATE_OK);
    return finish(session);
}

/// The recording replays without a difference. @return fault bits of tick `tick` in it
static uint32_t check_recording(const char *path, int64_t tick, uint64_t *start) {
    pal_error e = {0};
    pal_recording *recording = NULL;
    pal_replay_report r;
    pal_tick_record row;
    if (pal_recording_open(path, &recording, &e) != PALPATE_OK ||
        pal_replay(recording, model, 0, &r, &e) != PALPATE_OK) {
        fail_msg("%s: %s", path, e.message);
    }
    if (r.differences != 0) {
        fail_msg("%s: %llu differences, first in tick %llu", path,
                 (unsigned long long)r.differences, (unsigned long long)r.first.tick);
    }
    assert_int_equal(r.holes, 0);
    *start = r.start;
    assert_int_equal(pal_recording_rows(recording, tick - (int64_t)r.start, 1, &row, &e),
                     PALPATE_OK);
    pal_recording_close(recording);
    assert_int_equal(row.tick, tick);
    return row.fault;
}

// ---- The rows -----------------------------------------------------------------------------------

typedef struct expectation {
    const char *name;
    lie what;
    int64_t length;
    uint32_t faults;            ///< all the bits the run raises, no others
    uint32_t counted;           ///< those the engine counts (a device's own are not the engine's)
    int64_t onset;              ///< tick of the first event of the engine; 0: none
    uint32_t at_onset;          ///< bits of that tick
    int64_t zero_from, zero_to; ///< first and last tick without force; 0: it never goes to zero
    int64_t steady_from;        ///< as before from here on; -1: not any more
    int64_t unlatch_at;
} expectation;

#define STALE PALPATE_FAULT_STALE
#define RAMP PALPATE_FAULT_RAMP
#define LATCHED PALPATE_FAULT_LATCHED
#define INPUT PALPATE_FAULT_INPUT
#define JUMP PALPATE_FAULT_JUMP
// 20 bad ticks make a pose stale, it fades over 10 more (the first one counts) and comes back over
// 100
static const expectation rows[] = {
    {"nothing", HONEST, 0, 0, 0, 0, 0, 0, 0, 0, 0},
    {"not a number, one tick: the last pose stands in", NOT_A_NUMBER, 1, INPUT, INPUT, AT, INPUT, 0,
     0, 0, 0},
    {"not a number, 60 ticks: fades, comes back", NOT_A_NUMBER, 60, INPUT | STALE | RAMP,
     INPUT | STALE | RAMP, AT, INPUT, AT + 29, AT + 59, AT + 159, 0},
    {"infinity, 60 ticks: fades, comes back", INFINITE_TURN, 60, INPUT | STALE | RAMP,
     INPUT | STALE | RAMP, AT, INPUT, AT + 29, AT + 59, AT + 159, 0},
    {"frozen time stamp, 60 ticks: fades, comes back", FROZEN_STAMP, 60, STALE | RAMP, STALE | RAMP,
     AT + 19, STALE, AT + 29, AT + 59, AT + 159, 0},
    {"frozen pose of a device without time stamps: a hand at rest", FROZEN_UNSTAMPED, 60, 0, 0, 0,
     0, 0, 0, 0, 0},
    {"time out of order, 60 ticks: fades, comes back", BACKWARDS, 60, STALE | RAMP, STALE | RAMP,
     AT + 19, STALE, AT + 29, AT + 59, AT + 159, 0},
    {"teleport and back within the ramp: latched", TELEPORT, 1, JUMP | LATCHED, JUMP | LATCHED, AT,
     JUMP, AT, TICKS - 1, -1, 0},
    {"teleport and back after the ramp: from zero, twice", TELEPORT, 500, JUMP | RAMP, JUMP | RAMP,
     AT, JUMP, AT, AT + 500, AT + 600, 0},
    {"disconnect of 500 ticks, reconnect: fades, comes back", REFUSED, 500, STALE | RAMP,
     STALE | RAMP, AT + 19, STALE, AT + 29, AT + 499, AT + 599, 0},
    {"disconnect of 1500 ticks: latched, whatever comes then", REFUSED, 1500, STALE | LATCHED,
     STALE | LATCHED, AT + 19, STALE, AT + 29, TICKS - 1, -1, 0},
    {"disconnect of 1500 ticks, then let go: comes back", REFUSED, 1500, STALE | LATCHED | RAMP,
     STALE | LATCHED | RAMP, AT + 19, STALE, AT + 29, AT + 1699, AT + 1799, AT + 1700},
    {"force refused by the device: counted, in the records", REFUSED_WRITE, 60, PALPATE_FAULT_STALL,
     0, 0, 0, 0, 0, 0, 0},
};

static void every_lie_of_the_device_ends_as_the_table_says(void **state) {
    (void)state;
    for (size_t i = 0; i < sizeof rows / sizeof *rows; i++) {
        const expectation *t = &rows[i];
        liar d = {.what = t->what, .length = t->length, .unlatch_at = t->unlatch_at};
        pal_session_report r = run(&d);
        uint32_t counted = 0;
        for (int bit = 0; bit < 32; bit++) {
            counted |= r.counts.fault[bit] > 0 ? 1u << bit : 0u;
        }
        int latched = r.latched == 1;
        if (d.broken || r.ticks != TICKS || r.fault != t->faults || counted != t->counted) {
            fail_msg("%s: broken %d, ticks %llu, faults 0x%x, counted 0x%x", t->name, d.broken,
                     (unsigned long long)r.ticks, r.fault, counted);
        }
        if (d.zero_from != t->zero_from || d.zero_to != t->zero_to ||
            (t->steady_from >= 0 && d.steady_from > t->steady_from + 1) ||
            (t->steady_from < 0 && d.steady_from != TICKS)) {
            fail_msg("%s: no force from %lld to %lld, steady from %lld", t->name,
                     (long long)d.zero_from, (long long)d.zero_to, (long long)d.steady_from);
        }
        assert_int_equal(latched, (t->faults & LATCHED) != 0 && t->unlatch_at == 0);
        assert_int_equal(r.device_errors,
                         t->what == REFUSED || t->what == REFUSED_WRITE ? t->length : 0);
        assert_true(d.steady > 0.01);
        // counted with tick and value, in the recording, and the ring was dumped
        uint64_t start = 0;
        uint32_t bits = check_recording(record_path, t->onset != 0 ? t->onset : AT, &start);
        if (t->counted != 0) {
            assert_true(r.counts.events > 0 && r.counts.event[0].tick == (uint64_t)t->onset);
            assert_int_equal(bits & t->counted, t->at_onset);
        } else {
            assert_int_equal(r.counts.events, 0);
            assert_int_equal(bits, t->what == REFUSED_WRITE ? PALPATE_FAULT_STALL : 0);
        }
        int dumps = (t->faults & PALPATE_DUMP_FAULTS) != 0;
        assert_int_equal(r.dumps > 0, dumps);
        assert_int_equal(access(dump_path, F_OK) == 0, dumps);
        if (dumps) { // the ring reaches back to the start, so that the engine's memory is whole
            bits = check_recording(dump_path, t->onset != 0 ? t->onset : AT, &start);
            assert_true(start == 0 && bits != 0);
        }
        for (int n = 2; n <= 16; n++) {
            char more[160];
            (void)snprintf(more, sizeof more, "%s/dump-%d.h5", folder, n);
            assert_int_equal(access(more, F_OK) == 0, n <= r.dumps);
            (void)unlink(more);
        }
    }
}

/// A tick that takes 1, 10, 1000 periods: all of them are counted as missed, nothing is caught up,
/// and the records' own numbers of missed periods say when force starts from zero and when it
/// latches.
static void an_overrun_of_1_10_1000_periods_is_counted_and_judged(void **state) {
    (void)state;
    static const int64_t periods[] = {1, 10, 1000};
    for (int k = 0; k < 3; k++) {
        liar d = {.hold_at = 20,
                  .hold_ns = periods[k] * MS}; // early: a busy machine may grant few ticks
        pal_session *session = open_session(&d, 0, 0.6 + 1e-3 * (double)periods[k]);
        assert_int_equal(pal_session_start(session, NULL), PALPATE_OK);
        pal_session_report r = finish(session);
        assert_int_equal(r.ticks + r.missed, 600 + periods[k]);
        assert_true(r.missed >= (uint64_t)periods[k] - 1); // it may wake anywhere within its period
        assert_false(d.broken);
        pal_error e = {0};
        pal_recording *recording = NULL;
        assert_int_equal(pal_recording_open(record_path, &recording, &e), PALPATE_OK);
        int64_t most = 0, latched = 0, n = pal_recording_get_info(recording)->records;
        assert_int_equal(n, r.ticks);
        for (int64_t i = 0; i < n; i++) {
            pal_tick_record row;
            assert_int_equal(pal_recording_rows(recording, i, 1, &row, &e), PALPATE_OK);
            int64_t missed = row.state.flags >> PALPATE_STATE_MISSED_SHIFT;
            most = missed > most ? missed : most;
            latched |= missed >= 1000;
            assert_int_equal((row.fault & PALPATE_FAULT_STALL) != 0, missed >= 100);
            assert_int_equal((row.fault & LATCHED) != 0, latched);
        }
        pal_recording_close(recording);
        assert_true(most >= periods[k] - 1);
        uint64_t start;
        (void)check_recording(record_path, 10, &start); // bit for bit all the same
        char more[160];
        for (int i = 2; i <= 16; i++) {
            (void)snprintf(more, sizeof more, "%s/dump-%d.h5", folder, i);
            (void)unlink(more);
        }
    }
}

// ---- The render thread
// ----------------------------------------------------------------------------

typedef struct stalled {
    pal_session *volatile session;
    int64_t nap_ns; ///< 0: until the servo has ended
    int frames;
} stalled;

static void stall(void *user, const pal_frame *frame) {
    stalled *s = user;
    const struct timespec t = {.tv_nsec = (long)(s->nap_ns != 0 ? s->nap_ns : 5 * MS)};
    s->frames += frame != NULL;
    do {
        (void)nanosleep(&t, NULL);
    } while (s->nap_ns == 0 && frame != NULL && pal_session_running(s->session));
}

static void a_stalled_render_thread_stalls_nothing_else(void **state) {
    (void)state;
    for (int k = 0; k < 3; k++) {
        pal_error e = {0};
        stalled s = {.nap_ns = k == 1 ? 20 * MS : 0};
        liar d = {.what = HONEST};
        pal_session_def def = pal_session_default_def();
        pal_session *session = NULL;
        def.engine.tool_count = 1;
        def.engine.tools = &tool;
        def.duration = k == 2 ? 0.0 : 0.5;
        def.freewheel = k > 0;
        def.realtime = 0;
        def.render = stall;
        def.render_user = &s;
        def.devices[0] = (pal_device){
            .abi = PALPATE_DEVICE_ABI, .self = &d, .read = liar_read, .write = liar_write};
        assert_int_equal(pal_session_create(model, &def, &session, &e), PALPATE_OK);
        s.session = session;
        assert_int_equal(pal_session_start(session, &e), PALPATE_OK);
        if (k == 2) { // endless, freewheel, the picture never ends: a stop is obeyed
            const struct timespec t = {.tv_nsec = 50 * MS};
            (void)nanosleep(&t, NULL);
            pal_session_request_stop(session);
        }
        assert_int_equal(pal_session_finish(session, &e), PALPATE_OK);
        pal_session_report r;
        pal_session_get_report(session, &r);
        pal_session_free(session);
        if (k < 2) {
            assert_int_equal(r.ticks + r.missed,
                             500); // freewheel waits for the picture and misses nothing
            assert_true(k == 0 || r.missed == 0);
        }
        assert_true(s.frames >= (k == 1 ? 15 : 1));
        assert_false(d.broken);
        assert_int_equal(r.field_skipped * (k > 0), 0);
    }
}

static void put_file(const char *path) {
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    assert_true(fputs("another's", f) >= 0);
    assert_int_equal(fclose(f), 0);
}

static void expect_untouched(const char *path) {
    char text[16] = "";
    FILE *f = fopen(path, "r");
    assert_non_null(f);
    assert_non_null(fgets(text, sizeof text, f));
    assert_int_equal(fclose(f), 0);
    assert_string_equal(text, "another's");
    assert_int_equal(unlink(path), 0);
}

/// On demand the ring is dumped at once, while the session goes on; files that are there stay, a
/// finished recording as well as what a killed run left.
static void the_ring_is_dumped_on_demand(void **state) {
    (void)state;
    liar d = {.what = HONEST};
    pal_session *session = open_session(&d, 0, 0.0);
    char left[sizeof folder + 32], first[sizeof folder + 32];
    (void)snprintf(left, sizeof left, "%s/dump-2.h5.ticks", folder);
    (void)snprintf(first, sizeof first, "%s/dump-3.h5", folder);
    put_file(dump_path);
    put_file(left);
    assert_int_equal(pal_session_start(session, NULL), PALPATE_OK);
    pal_session_report r = {0};
    const struct timespec t = {.tv_nsec = 10 * MS};
    for (int i = 0; i < 1000 && r.ticks < 20; i++) {
        (void)nanosleep(&t, NULL);
        pal_session_get_report(session, &r);
    }
    for (int n = 1; n <= 2; n++) {
        pal_session_request_dump(session);
        for (int i = 0; i < 1000 && r.dumps < n; i++) {
            (void)nanosleep(&t, NULL);
            pal_session_get_report(session, &r);
        }
        assert_true(r.dumps >= n);
        assert_true(pal_session_running(session));
    }
    pal_session_request_stop(session);
    r = finish(session);
    assert_true(r.dumps >= 2 && r.dumps_lost == 0);
    assert_true(strstr(r.dump_path, "/dump-") != NULL);
    expect_untouched(dump_path);
    expect_untouched(left);
    uint64_t start;
    (void)check_recording(first, 0, &start);
    // where nothing can be written the run goes on, and says so
    liar f = {.what = NOT_A_NUMBER, .length = 60};
    char kept[sizeof dump_path];
    memcpy(kept, dump_path, sizeof kept);
    (void)snprintf(dump_path, sizeof dump_path, "/nonexistent/dump.h5");
    r = run(&f);
    memcpy(dump_path, kept, sizeof kept);
    assert_true(r.ticks == TICKS && r.dumps == 0 && r.dumps_lost > 0 && r.dump_path[0] == 0);
}

/// A device that says what it bears is obeyed, whatever the tool's definition asks for.
static void the_devices_own_spec_holds(void **state) {
    (void)state;
    const pal_tool_def kept = tool;
    pal_error e = {0};
    for (int k = 0; k < 4; k++) {
        liar d = {.what = TELEPORT, .length = k == 1 ? 1 : 0};
        pal_session_def def = pal_session_default_def();
        pal_session *session = NULL;
        tool.limits = k == 3 ? (pal_tool_limits){INFINITY, INFINITY, 0.0} : kept.limits;
        tool.coupling_stiffness = k == 2 ? 800.0 : 0.0;
        def.engine.tool_count = 1;
        def.engine.tools = &tool;
        def.duration = 0.6;
        def.freewheel = 1;
        def.realtime = 0;
        def.devices[0] = (pal_device){
            .abi = PALPATE_DEVICE_ABI, .self = &d, .read = liar_read, .write = liar_write};
        pal_device_spec *spec = &def.devices[0].spec;
        spec->max_force = k == 3 ? 0.0 : 0.02;
        spec->max_speed = k == 1 ? 0.5 : 0.0;
        spec->max_stiffness = 500.0;
        pal_status status = pal_session_create(model, &def, &session, &e);
        if (k == 2) {
            assert_int_equal(status, PALPATE_ERROR_ARGUMENT);
            assert_non_null(strstr(e.message, "bears 500"));
            tool = kept;
            continue;
        }
        assert_int_equal(status, PALPATE_OK);
        assert_int_equal(pal_session_start(session, &e), PALPATE_OK);
        pal_session_report r = finish(session);
        assert_int_equal(r.tool_count, 1);
        if (k == 3) { // no limit, by choice: said so; the one left out has its default
            assert_true(isinf(r.limits[0].force) && isinf(r.limits[0].slew));
            assert_true(r.limits[0].torque == PALPATE_DEFAULT_TORQUE);
            assert_int_equal(r.fault, 0);
        } else {
            assert_true(r.limits[0].force == 0.02 && r.limits[0].slew == kept.limits.slew);
            assert_true(r.peak_force <= 0.02 * (1 + 1e-12) && (r.fault & PALPATE_FAULT_CAP));
            assert_int_equal((r.fault & JUMP) != 0, k == 1);
        }
        tool = kept;
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_lie_of_the_device_ends_as_the_table_says),
        cmocka_unit_test(an_overrun_of_1_10_1000_periods_is_counted_and_judged),
        cmocka_unit_test(a_stalled_render_thread_stalls_nothing_else),
        cmocka_unit_test(the_ring_is_dumped_on_demand),
        cmocka_unit_test(the_devices_own_spec_holds),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
