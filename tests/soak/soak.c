/// @file soak.c  `make soak MINUTES=n`: hours of random but physical use with random faults.
///
/// Episode after episode, each from one seed: a model, one to four tools of random shape, coupling,
/// friction, contact law and limits, hands that press, slide, circle and tremble, or a simulated
/// device in closed loop, and devices that lie (soak_hand.c). Three of four run as a whole session
/// in freewheel, with render and recorder threads, some recorded and replayed bit for bit; the
/// others drive the engine alone, with missed periods. Every tick is checked (soak_check.c); after
/// every episode the heap, the open files and the mappings must be what they were. The first
/// violation ends it with the seed that shows it again:
///     build/soak --seed S --episodes 1
#include <errno.h>
#include <dirent.h>
#include <malloc.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <palpate/precompute.h>

#include "haptic/model/model.h"
#include "haptic/recording/replay.h"
#include "tests/soak/soak.h"
#include "tests/support/synthetic_model.h"

enum { MODELS = 5, WARM = 40 };

typedef struct bench_model {
    const char *name;
    pal_model *model;
} bench_model;

typedef struct totals {
    uint64_t episodes, sessions, replays, ticks, tool_ticks, contact_ticks, frames, excursions,
        refused_defs;
    uint64_t injected[SOAK_FAULTS], latched, fault[32];
    uint64_t retraced;
    double worst, largest, given, taken;
    char worst_where[128];
} totals;

static const char *source_folder(void) {
    const char *s = getenv("PALPATE_SOURCE");
    return s != NULL ? s : ".";
}

static double seconds_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

// ---- Models
// -----------------------------------------------------------------------------------------

static pal_model *build(const char *file, const char *const set[]) {
    char path[512];
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    pal_error e = {0};
    int count = 0;
    while (set[count] != NULL) {
        count++;
    }
    (void)snprintf(path, sizeof path, "%s/scenes/%s", source_folder(), file);
    if (pal_scene_load(path, set, count, &scene, &e) != PALPATE_OK ||
        pal_precompute_cached(scene, NULL, &model, NULL, &e) != PALPATE_OK) {
        (void)fprintf(stderr, "soak: %s\n", e.message);
        exit(2);
    }
    pal_scene_free(scene);
    return model;
}

static void build_models(bench_model out[MODELS]) {
    static const char *const coarse[] = {"estimate=false",
                                         "body.refine=[]",
                                         "body.spacing=0.01",
                                         "body.patches.pole.rim_spacing=0.004",
                                         "body.touchable=[{above: {z: 0.01}}]",
                                         NULL};
    static const char *const raw[] = {"estimate=false",
                                      "body.refine=[]",
                                      "body.spacing=0.01",
                                      "body.patches.pole.rim_spacing=0.004",
                                      "body.touchable=[{above: {z: 0.01}}]",
                                      "method.form=collocated",
                                      "repair=none",
                                      "certify=warn",
                                      "store.precision=half",
                                      NULL};
    static const char *const organ[] = {"estimate=false", "body.refine=[]", "body.spacing=0.012",
                                        "body.patches.lobe.rim_spacing=0.006", NULL};
    static const char *const fine[] = {
        "estimate=false", "body.patches.pole.rim_spacing=0.002",
        "body.refine=[{center: [0, 0, 0.05], radius: 0.015, spacing: 0.004}]", NULL};
    synthetic_params p = synthetic_default_params();
    p.n = 14;
    out[0] = (bench_model){"hemisphere", build("hemisphere.yaml", coarse)};
    out[1] = (bench_model){"hemisphere, graded", build("hemisphere.yaml", fine)};
    out[2] = (bench_model){"organ", build("organ.yaml", organ)};
    out[3] = (bench_model){"hemisphere, raw compliance", build("hemisphere.yaml", raw)};
    out[4] = (bench_model){"half space", synthetic_model(&p)};
    for (int i = 0; i < MODELS; i++) {
        pal_model_info info;
        if (out[i].model == NULL) {
            (void)fprintf(stderr, "soak: no memory for a model\n");
            exit(2);
        }
        pal_model_get_info(out[i].model, &info);
        (void)printf("model %-28s %5d nodes, %4d touchable\n", out[i].name, (int)info.node_count,
                     (int)info.touchable_count);
    }
}

// ---- One episode
// ------------------------------------------------------------------------------------

static void choose_tool(soak_episode *e, int t) {
    soak_rng *r = &e->rng;
    pal_tool_def *tool = &e->tool[t];
    memset(tool, 0, sizeof *tool);
    double spacing =
        e->model->info.spacing_mean > 0.0 ? e->model->info.spacing_mean : 0.05 * e->size;
    (void)snprintf(tool->name, sizeof tool->name, "tool%d", t);
    tool->shape = (pal_shape_kind)soak_below(r, 3);
    tool->radius = tool->shape == PALPATE_SHAPE_POINT ? 0.0 : soak_uniform(r, 0.2, 2.0) * spacing;
    tool->length = tool->shape == PALPATE_SHAPE_CAPSULE ? soak_uniform(r, 0.5, 6.0) * spacing : 0.0;
    tool->friction = soak_chance(r, 0.5) ? soak_uniform(r, 0.05, 0.8) : 0.0;
    tool->coupling_stiffness = soak_chance(r, 0.5) ? soak_uniform(r, 100.0, 1500.0) : 0.0;
    tool->coupling_damping = tool->coupling_stiffness > 0.0 ? soak_uniform(r, 0.0, 2.0) : 0.0;
    tool->limits.force = soak_chance(r, 0.3) ? 0.0 : pow(10.0, soak_uniform(r, -1.0, 1.0));
    tool->limits.slew = soak_chance(r, 0.5) ? 0.0 : pow(10.0, soak_uniform(r, -2.0, 1.0));
    tool->limits.torque = soak_chance(r, 0.5) ? 0.0 : pow(10.0, soak_uniform(r, -3.0, 0.0));
    tool->spec.max_force = soak_chance(r, 0.3) ? soak_uniform(r, 0.5, 8.0) : 0.0;
    tool->has_start = 1;
}

static void choose_engine(soak_episode *e) {
    soak_rng *r = &e->rng;
    pal_engine_def *def = &e->def.engine;
    e->def = pal_session_default_def();
    def->tools = e->tool;
    def->tool_count = 1 + (int32_t)soak_below(r, soak_chance(r, 0.5) ? 1 : SOAK_TOOLS);
    for (int t = 0; t < def->tool_count; t++) {
        choose_tool(e, t);
    }
    def->contact_law = soak_chance(r, 0.2) ? PALPATE_CONTACT_NODES : PALPATE_CONTACT_SURFACE;
    def->contact_points = soak_chance(r, 0.5) ? 0 : 1 + (int32_t)soak_below(r, 32);
    def->max_contacts = soak_chance(r, 0.5) ? 32 : 4 + (int32_t)soak_below(r, 80);
    def->field_by = soak_chance(r, 0.5) ? PALPATE_FIELD_BY_SERVO : PALPATE_FIELD_BY_READER;
    def->frame_age = 1 + (int32_t)soak_below(r, 6);
    if (soak_chance(r, 0.3)) {
        def->watchdog = (pal_watchdog_def){.stale = soak_uniform(r, 0.002, 0.1),
                                           .stall = soak_uniform(r, 0.01, 0.5),
                                           .latch = soak_uniform(r, 0.5, 3.0),
                                           .ramp_down = soak_uniform(r, 0.001, 0.05),
                                           .ramp_up = soak_uniform(r, 0.01, 0.5)};
    }
    if (def->contact_law == PALPATE_CONTACT_NODES) { // has neither
        for (int t = 0; t < def->tool_count; t++) {
            e->tool[t].friction = e->tool[t].coupling_stiffness = e->tool[t].coupling_damping = 0.0;
        }
    }
}

static void after_tick(soak_episode *e, int64_t n, const pal_tool_force out[]) {
    for (int t = 0; t < e->effective.tool_count; t++) {
        soak_check_force(e, t, n, &out[t]);
    }
    soak_check_tick(e, n, out);
}

/// The devices of a session: tool 0's read begins a tick, the last tool's write ends it.
typedef struct port {
    soak_episode *e;
    soak_hand *hand;
    pal_tool_force *out; ///< shape [SOAK_TOOLS], shared
    int64_t tick;
} port;

static pal_status port_read(void *self, int64_t time_ns, pal_tool_state *state) {
    port *p = self;
    soak_episode *e = p->e;
    if (p->hand->index == 0 && soak_chance(&e->rng, 2e-4)) {
        pal_session_unlatch(e->session);
    }
    return soak_hand_read(p->hand, time_ns, state);
}

static pal_status port_write(void *self, int64_t time_ns, const pal_tool_force *force) {
    port *p = self;
    int t = p->hand->index;
    p->out[t] = *force;
    pal_status status = soak_hand_write(p->hand, time_ns, force);
    if (t == p->e->effective.tool_count - 1) {
        after_tick(p->e, p->tick, p->out);
    }
    p->tick++;
    return status;
}

static void on_frame(void *user, const pal_frame *frame) {
    if (frame != NULL) {
        soak_check_frame(user, frame);
    }
}

static void check_replay(soak_episode *e, const char *path) {
    pal_error error = {0};
    pal_recording *recording = NULL;
    pal_replay_report r = {0};
    if (pal_recording_open(path, &recording, &error) != PALPATE_OK ||
        pal_replay(recording, e->model, 0, &r, &error) != PALPATE_OK) {
        soak_fail(e, "replay: %.300s", error.message);
    } else if (r.differences != 0 || r.ticks != (uint64_t)e->ticks) {
        soak_fail(e, "replay: %llu differences in %llu ticks, the first in tick %llu (%s)",
                  (unsigned long long)r.differences, (unsigned long long)r.ticks,
                  (unsigned long long)r.first.tick, r.first.what != NULL ? r.first.what : "-");
    }
    pal_recording_close(recording);
}

/// @return 0 when the definition is refused (coupling beyond a simulated device, say)
static int run_session(soak_episode *e, const char *folder, totals *sum) {
    char path[160] = "";
    pal_tool_force out[SOAK_TOOLS];
    port ports[SOAK_TOOLS];
    pal_error error = {0};
    memset(out, 0, sizeof out);
    int recorded = soak_chance(&e->rng, 0.25);
    if (recorded) {
        (void)snprintf(path, sizeof path, "%s/soak.h5", folder);
        (void)unlink(path);
        e->def.record_path = path;
    }
    e->def.duration = (double)e->ticks * e->def.engine.period;
    e->def.freewheel = 1;
    e->def.realtime = 0;
    e->def.ring_ticks = 512;
    e->def.render = on_frame;
    e->def.render_user = e;
    for (int t = 0; t < e->def.engine.tool_count; t++) {
        ports[t] = (port){.e = e, .hand = &e->hand[t], .out = out};
        e->def.devices[t] = (pal_device){
            .abi = PALPATE_DEVICE_ABI, .self = &ports[t], .read = port_read, .write = port_write};
    }
    if (pal_session_create(e->model, &e->def, &e->session, &error) != PALPATE_OK) {
        return 0;
    }
    e->effective = *pal_engine_get_def(pal_session_engine(e->session));
    pal_session_report r = {0};
    if (pal_session_start(e->session, &error) != PALPATE_OK ||
        pal_session_finish(e->session, &error) != PALPATE_OK) {
        soak_fail(e, "session: %.300s", error.message);
    }
    pal_session_get_report(e->session, &r);
    uint64_t refused = 0, expected = (uint64_t)e->ticks * (uint64_t)e->effective.tool_count;
    for (int t = 0; t < e->effective.tool_count; t++) {
        refused += e->hand[t].refused;
        sum->latched += (r.latched >> t & 1u);
    }
    if (e->failure[0] == 0) {
        if (r.ticks != (uint64_t)e->ticks || r.missed != 0 || r.device_errors != refused ||
            r.frames != e->frames) {
            soak_fail(
                e,
                "report: %llu ticks, %llu missed, %llu device errors (%llu refused), %llu frames",
                (unsigned long long)r.ticks, (unsigned long long)r.missed,
                (unsigned long long)r.device_errors, (unsigned long long)refused,
                (unsigned long long)r.frames);
        }
        if (recorded && (r.records != expected || r.records_lost != 0 || r.record_error[0] != 0)) {
            soak_fail(e, "recording: %llu of %llu records", (unsigned long long)r.records,
                      (unsigned long long)expected);
        }
        soak_check_counts(e, &r.counts);
    }
    sum->contact_ticks += r.counts.contact_ticks;
    for (int b = 0; b < 32; b++) {
        sum->fault[b] += r.counts.fault[b];
    }
    pal_session_free(e->session); // the effective definition's tools go with it
    e->session = NULL;
    if (recorded && e->failure[0] == 0) {
        check_replay(e, path);
        sum->replays++;
    }
    sum->sessions++;
    return 1;
}

static int run_engine(soak_episode *e, totals *sum) {
    pal_engine *engine = NULL;
    pal_tool_state in[SOAK_TOOLS], last[SOAK_TOOLS];
    pal_tool_force out[SOAK_TOOLS];
    memset(last, 0, sizeof last);
    if (pal_engine_create(e->model, &e->def.engine, &engine, NULL) != PALPATE_OK) {
        return 0;
    }
    e->effective = *pal_engine_get_def(engine);
    int32_t tools = e->effective.tool_count;
    for (int64_t n = 0; n < e->ticks && e->failure[0] == 0; n++) {
        int64_t time_ns = llround((double)n * e->effective.period * 1e9);
        uint32_t flags = 0;
        for (int t = 0; t < tools; t++) {
            if (soak_hand_read(&e->hand[t], time_ns, &in[t]) == PALPATE_OK) {
                last[t] = in[t];
            } else {
                in[t] = last[t];
                in[t].flags = PALPATE_STATE_STALE;
            }
            soak_hand *h = &e->hand[t];
            if (h->fault == SOAK_MISSED && soak_chance(&h->rng, 0.1)) {
                flags = (uint32_t)soak_below(&h->rng, 2000) << PALPATE_STATE_MISSED_SHIFT;
            }
        }
        flags |= soak_chance(&e->rng, 2e-4) ? PALPATE_STATE_UNLATCH : 0u;
        for (int t = 0; t < tools; t++) {
            in[t].flags |= flags;
            e->in[t].flags = in[t].flags;
        }
        (void)pal_engine_force(engine, in, out);
        after_tick(e, n, out);
        for (int t = 0; t < tools; t++) {
            (void)soak_hand_write(&e->hand[t], time_ns, &out[t]);
        }
        pal_engine_field(engine);
        pal_frame frame;
        if (n % 37 == 0 && pal_engine_snapshot(pal_engine_reader(engine, 0), &frame) == 1) {
            soak_check_frame(e, &frame);
        }
    }
    pal_engine_counts counts;
    pal_engine_get_counts(engine, &counts);
    if (e->failure[0] == 0) {
        soak_check_counts(e, &counts);
    }
    sum->contact_ticks += counts.contact_ticks;
    for (int b = 0; b < 32; b++) {
        sum->fault[b] += counts.fault[b];
    }
    pal_engine_free(engine);
    return 1;
}

/// A simulated device instead of a hand that knows where it goes: the loop is closed.
static void maybe_simulate(soak_episode *e, int t) {
    soak_rng *r = &e->rng;
    soak_hand *h = &e->hand[t];
    pal_tool_def tool = e->tool[t];
    if (!soak_chance(r, 0.2)) {
        return;
    }
    tool.device.kind = PALPATE_DEVICE_SIMULATED;
    tool.device.stroke = (pal_stroke){.kind = (pal_stroke_kind)soak_below(r, 4),
                                      .depth = h->clearance + fmax(0.0, h->depth) + tool.radius,
                                      .ramp = soak_uniform(r, 0.2, 1.0),
                                      .period = soak_uniform(r, 0.5, 3.0),
                                      .amplitude = h->slide[0]};
    memcpy(tool.device.stroke.direction, h->tangent, sizeof h->tangent);
    tool.device.simulated = pal_simulated_default((pal_simulated_model)soak_below(r, 2),
                                                  (pal_simulated_grip)soak_below(r, 2));
    for (int i = 0; i < 3; i++) {
        tool.start[i] = h->origin[i] + h->clearance * h->normal[i];
        tool.axis[i] = -h->normal[i];
    }
    h->simulated = pal_device_create(&tool, e->def.engine.period, &h->inner, NULL) == PALPATE_OK;
    if (h->simulated && h->inner.open != NULL) {
        (void)h->inner.open(h->inner.self, NULL);
    }
}

/// @return 1 when all held
static int run_episode(uint64_t seed, const bench_model models[MODELS], const char *folder,
                       int only, totals *sum) {
    soak_episode *e = calloc(1, sizeof *e);
    if (e == NULL) {
        return 0;
    }
    e->seed = e->rng.state = seed;
    int m = (int)soak_below(&e->rng, MODELS);
    m = only >= 0 ? only : m;
    e->model = models[m].model;
    e->model_name = models[m].name;
    e->size = cbrt(fmax(e->model->info.volume, 1e-9));
    e->ticks = 500 + soak_below(&e->rng, soak_chance(&e->rng, 0.1) ? 20000 : 4000);
    e->by_session = soak_chance(&e->rng, 0.75);
    choose_engine(e);
    pal_error refusal = {0};
    pal_engine *probe = NULL;
    if (pal_engine_create(e->model, &e->def.engine, &probe, &refusal) ==
        PALPATE_ERROR_UNSUPPORTED) {
        for (int t = 0; t < e->def.engine.tool_count; t++) { // what a law has not is left out
            e->tool[t].friction = e->tool[t].coupling_stiffness = e->tool[t].coupling_damping = 0.0;
        }
    }
    pal_engine_free(probe);
    for (int t = 0; t < e->def.engine.tool_count; t++) {
        soak_hand_init(&e->hand[t], e, t);
        maybe_simulate(e, t);
    }
    // paper 1's law prescribes displacements of nodes that come and go: which do depends on the way
    // there
    e->retraces = e->def.engine.tool_count == 1 && e->hand[0].retraces && !e->hand[0].simulated &&
                  e->def.engine.contact_law == PALPATE_CONTACT_SURFACE;
    int ran = e->by_session ? run_session(e, folder, sum) : run_engine(e, sum);
    const soak_energy *g = &e->energy;
    if (ran && e->retraces && g->beyond > 0.0) {
        soak_fail(e,
                  "energy: an excursion returned %.3g of what it had stored, %.3g J more than "
                  "sampling explains",
                  -g->worst, g->beyond);
    }
    int tools = e->def.engine.tool_count;
    for (int t = 0; t < tools; t++) {
        for (int k = 0; k < SOAK_FAULTS; k++) {
            sum->injected[k] += e->hand[t].injected[k];
        }
        if (e->hand[t].simulated && e->hand[t].inner.close != NULL) {
            e->hand[t].inner.close(e->hand[t].inner.self);
        }
    }
    sum->episodes++;
    sum->refused_defs += !ran;
    if (ran) {
        sum->ticks += (uint64_t)e->ticks;
        sum->tool_ticks += (uint64_t)(e->ticks * tools);
        sum->frames += e->frames;
        sum->excursions += g->excursions;
        sum->largest = fmax(sum->largest, g->largest);
        sum->given += g->given;
        sum->taken += g->taken;
        sum->retraced += e->retraces ? g->excursions : 0;
        if (e->retraces && g->worst < sum->worst) {
            sum->worst = g->worst;
            (void)snprintf(sum->worst_where, sizeof sum->worst_where, "seed %llu, %s",
                           (unsigned long long)seed, e->model_name);
        }
    }
    int held = e->failure[0] == 0;
    if (!held) {
        (void)printf("\nFAILED seed %llu (%s, %d tools, law %d, %s): %s\n",
                     (unsigned long long)seed, e->model_name, tools, (int)e->def.engine.contact_law,
                     e->by_session ? "session" : "engine", e->failure);
        for (int t = 0; t < tools; t++) {
            const pal_tool_def *d = &e->tool[t];
            (void)printf("  tool %d: shape %d, radius %g, length %g, friction %g, coupling %g N/m "
                         "%g N s/m, limits %g N "
                         "%g N/ms %g N m%s\n",
                         t, (int)d->shape, d->radius, d->length, d->friction, d->coupling_stiffness,
                         d->coupling_damping, d->limits.force, d->limits.slew, d->limits.torque,
                         e->hand[t].simulated ? ", simulated device" : "");
        }
        (void)printf("  again: build/soak --seed %llu --episodes 1\n", (unsigned long long)seed);
    }
    free(e);
    return held;
}

// ---- Leaks
// --------------------------------------------------------------------------------------------

typedef struct footprint {
    double heap, resident; ///< [MB]
    int files;
} footprint;

static footprint measure(void) {
    footprint f = {0};
    struct mallinfo2 info = mallinfo2();
    f.heap = 1e-6 * (double)(info.uordblks + info.hblkhd);
    long size = 0, resident = 0;
    FILE *file = fopen("/proc/self/statm", "r");
    if (file != NULL) {
        if (fscanf(file, "%ld %ld", &size, &resident) == 2) {
            f.resident = 1e-6 * (double)resident * (double)sysconf(_SC_PAGESIZE);
        }
        (void)fclose(file);
    }
    DIR *d = opendir("/proc/self/fd");
    while (d != NULL && readdir(d) != NULL) {
        f.files++;
    }
    if (d != NULL) {
        (void)closedir(d);
    }
    return f;
}

static void print_line(const totals *s, double elapsed, const footprint *f) {
    uint64_t faults = 0;
    for (int k = 0; k < SOAK_FAULTS; k++) {
        faults += s->injected[k];
    }
    (void)printf("%7.0f s  %6llu episodes  %6.1f M ticks of %6.1f M tools  %6llu faults  %6llu "
                 "excursions, worst %+.4f"
                 "  heap %.2f MB, resident %.1f MB\n",
                 elapsed, (unsigned long long)s->episodes, 1e-6 * (double)s->ticks,
                 1e-6 * (double)s->tool_ticks, (unsigned long long)faults,
                 (unsigned long long)s->excursions, s->worst, f->heap, f->resident);
    (void)fflush(stdout);
}

static void print_summary(const totals *s, double elapsed, const footprint *first,
                          const footprint *last) {
    static const char *const kind[SOAK_FAULTS] = {
        "",          "not a number", "refused read",  "frozen stamp",
        "backwards", "teleport",     "refused write", "missed periods"};
#define FAULT_NAME(name, bit, text) [bit] = #name,
    static const char *const fault_name[32] = {PALPATE_FAULT_LIST(FAULT_NAME)};
#undef FAULT_NAME
    (void)printf("\n%.1f min: %llu episodes (%llu sessions, %llu recorded and replayed, %llu "
                 "definitions refused), "
                 "%llu ticks, %llu tool-ticks, %llu in contact, %llu frames\n",
                 elapsed / 60.0, (unsigned long long)s->episodes, (unsigned long long)s->sessions,
                 (unsigned long long)s->replays, (unsigned long long)s->refused_defs,
                 (unsigned long long)s->ticks, (unsigned long long)s->tool_ticks,
                 (unsigned long long)s->contact_ticks, (unsigned long long)s->frames);
    (void)printf("injected:");
    for (int k = 1; k < SOAK_FAULTS; k++) {
        (void)printf(" %llu %s%s", (unsigned long long)s->injected[k], kind[k],
                     k + 1 < SOAK_FAULTS ? "," : "\n");
    }
    (void)printf("raised (ticks):");
    for (int b = 0; b < 32; b++) {
        if (s->fault[b] > 0) {
            (void)printf(" %s %llu",
                         fault_name[b] != NULL ? fault_name[b] + strlen("PALPATE_FAULT_") : "?",
                         (unsigned long long)s->fault[b]);
        }
    }
    (void)printf(
        "\nenergy: %llu retraced excursions, the worst ended at %+.5f of what it had stored (%s)\n",
        (unsigned long long)s->retraced, s->worst, s->worst_where);
    (void)printf("all %llu excursions took %.4g J and gave %.4g J\n",
                 (unsigned long long)s->excursions, s->taken, s->given);
    (void)printf(
        "largest force %.4g N; heap %.3f -> %.3f MB, resident %.1f -> %.1f MB, files %d -> %d\n",
        s->largest, first->heap, last->heap, first->resident, last->resident, first->files,
        last->files);
}

int main(int argc, char **argv) {
    double minutes = 1.0;
    uint64_t seed = (uint64_t)time(NULL), episodes = 0;
    int only = -1;
    for (int i = 1; i + 1 < argc; i += 2) {
        if (strcmp(argv[i], "--minutes") == 0) {
            minutes = strtod(argv[i + 1], NULL);
        } else if (strcmp(argv[i], "--seed") == 0) {
            seed = strtoull(argv[i + 1], NULL, 10);
        } else if (strcmp(argv[i], "--episodes") == 0) {
            episodes = strtoull(argv[i + 1], NULL, 10);
        } else if (strcmp(argv[i], "--model") == 0) {
            only = atoi(argv[i + 1]) % MODELS;
        } else {
            (void)fprintf(stderr, "soak [--minutes M] [--seed S] [--episodes N] [--model 0..%d]\n",
                          MODELS - 1);
            return 2;
        }
    }
    char folder[] = "/tmp/palpate-soak-XXXXXX";
    if (mkdtemp(folder) == NULL) {
        return 2;
    }
    static bench_model models[MODELS];
    static totals sum;
    build_models(models);
    (void)printf("seeds from %llu\n", (unsigned long long)seed);
    double begin = seconds_now(), shown = begin;
    footprint first = measure(), last = first;
    int held = 1;
    for (uint64_t n = 0;
         held && (episodes > 0 ? n < episodes : seconds_now() - begin < 60.0 * minutes); n++) {
        held = run_episode(seed + n, models, folder, only, &sum);
        last = measure();
        if (n + 1 == WARM) { // libraries have set themselves up, the allocator has its arenas
            first = last;
        }
        // recordings leave what HDF5 caches: a bound, not a trend; a leaked engine would be 1 MB
        // each
        if (n > WARM && (last.heap > first.heap + 8.0 || last.resident > first.resident + 160.0 ||
                         last.files != first.files)) {
            (void)printf("\nFAILED seed %llu: heap %.2f -> %.2f MB, resident %.1f -> %.1f MB, open "
                         "files %d -> %d\n",
                         (unsigned long long)(seed + n), first.heap, last.heap, first.resident,
                         last.resident, first.files, last.files);
            held = 0;
        }
        if (seconds_now() - shown > 10.0) {
            shown = seconds_now();
            print_line(&sum, shown - begin, &last);
        }
    }
    print_summary(&sum, seconds_now() - begin, &first, &last);
    (void)printf("%s\n", held ? "all held" : "FAILED");
    for (int i = 0; i < MODELS; i++) {
        pal_model_free(models[i].model);
    }
    char command[64];
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command) == 0 && held ? 0 : 1; // NOLINT(cert-env33-c): our own folder
}
