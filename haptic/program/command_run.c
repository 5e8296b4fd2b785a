/// @file command_run.c  palpate run SCENE|MODEL: the servo, the render thread, the devices, a
/// report.
#include "haptic/program/program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <palpate/session.h>

#include "haptic/base/error.h"
#include "haptic/program/painter.h"
#include "haptic/program/targets.h"

typedef struct options {
    common_options common;
    const char *path;
    double seconds; ///< 0: as long as the devices move
    int freewheel;
    int realtime;
    int cpu;
    double reference; ///< slice of the bare loop [s]
    const char *record, *dump, *snapshot, *gif;
    int width, height;
    int draw;
    int pictured; ///< a snapshot or an animation was asked for
} options;

enum {
    KEY_FOR = 0x200,
    KEY_FREEWHEEL,
    KEY_RECORD,
    KEY_SNAPSHOT,
    KEY_GIF,
    KEY_STRICT,
    KEY_NORT,
    KEY_CPU,
    KEY_REFERENCE,
    KEY_SIZE,
    KEY_NODRAW,
    KEY_DUMP
};

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    case KEY_FOR:
        o->seconds = parse_time(arg, "--for", 0, state);
        return 0;
    case KEY_FREEWHEEL:
        o->freewheel = 1;
        return 0;
    case KEY_RECORD:
        o->record = arg;
        return 0;
    case KEY_DUMP:
        o->dump = arg;
        return 0;
    case KEY_SNAPSHOT:
        o->snapshot = arg;
        return 0;
    case KEY_GIF:
        o->gif = arg;
        return 0;
    case KEY_STRICT:
        o->realtime = 2;
        return 0;
    case KEY_NORT:
        o->realtime = 0;
        return 0;
    case KEY_CPU:
        if (!parse_integer(arg, 0, 4095, &o->cpu)) {
            argp_error(state, "--cpu %s: the number of a core, 0 to 4095", arg);
        }
        return 0;
    case KEY_REFERENCE:
        o->reference = parse_time(arg, "--reference", 0, state);
        return 0;
    case KEY_SIZE:
        parse_size(arg, &o->width, &o->height, state);
        return 0;
    case KEY_NODRAW:
        o->draw = 0;
        return 0;
    default:
        return parse_path(key, arg, state, &o->path, "SCENE or MODEL",
                          "e.g. palpate run scenes/organ.yaml --snapshot organ.png");
    }
}

static const struct argp_option list[] = {
    {"for", KEY_FOR, "SECONDS", 0,
     "Session time to run (default: as long as the devices move, else 10 s)", 1},
    {"freewheel", KEY_FREEWHEEL, NULL, 0, "No waiting: every tick is evaluated, as fast as it goes",
     1},
    {"record", KEY_RECORD, "FILE.h5", 0,
     "Record every tick and the deformed surface (HDF5 + XDMF for ParaView)", 1},
    {"dump", KEY_DUMP, "FILE.h5", 0,
     "Keep the last ticks in memory and write them here when a fault occurs, and on SIGUSR1 "
     "(FILE-2.h5 and so on "
     "for the next ones; `palpate replay` opens them)",
     1},
    {"snapshot", KEY_SNAPSHOT, "FILE.png", 0, "Picture of the moment with the largest force", 1},
    {"gif", KEY_GIF, "FILE.gif", 0, "Short animation, 10 pictures a second", 1},
    {"size", KEY_SIZE, "WxH", 0, "Size of the pictures (default 960x640)", 1},
    {"no-draw", KEY_NODRAW, NULL, 0, "The render thread takes frames and draws nothing", 1},
    {"strict", KEY_STRICT, NULL, 0,
     "Fail when real-time scheduling is refused (default: go on and say so)", 2},
    {"no-realtime", KEY_NORT, NULL, 0, "Do not ask for real-time scheduling", 2},
    {"cpu", KEY_CPU, "N", 0, "Core of the servo thread (default: the last one)", 2},
    {"reference", KEY_REFERENCE, "SECONDS", 0,
     "Alternate slices of the session with slices of a bare real-time loop, which shows what the "
     "machine itself "
     "misses",
     2},
    {0}};
static const char doc[] =
    "Drive the tools' devices through the engine at the servo rate and report.\v"
    "Ticks + missed is the number of periods that passed. Compute is the engine's time per tick, "
    "lateness how "
    "late the thread woke up: the first judges Palpate, the second the machine (`palpate doctor`). "
    "Forces are "
    "those on the tool. A MODEL file needs neither the scene nor any GPL library.\n\n"
    "Example:\n  palpate run scenes/hemisphere.yaml --for 10 --snapshot hemisphere.png \\\n"
    "    --record press.h5";

/// Devices of the tools; a tool without one cannot be run.
static pal_status create_devices(const pal_runtime_config *runtime, pal_session_def *def,
                                 double *longest, pal_error *error) {
    *longest = 0.0;
    for (int32_t t = 0; t < runtime->tool_count; t++) {
        pal_status status =
            pal_device_create(&runtime->tools[t], def->engine.period, &def->devices[t], error);
        if (status != PALPATE_OK) {
            for (int32_t k = 0; k < t; k++) {
                def->devices[k].close(def->devices[k].self);
            }
            return pal_fail_prefix(error, status, "tools.%s", runtime->tools[t].name);
        }
        double duration = pal_device_duration(&def->devices[t]);
        if (duration < 0.0 || *longest < 0.0) {
            *longest = -1.0;
        } else {
            *longest = fmax(*longest, duration);
        }
    }
    return PALPATE_OK;
}

static json_t *json_quantiles(const pal_quantiles *q) {
    return json_pack("{s:f,s:f,s:f,s:f}", "p50", q->p50, "p99", q->p99, "p999", q->p999, "max",
                     q->max);
}

static void print_quantiles(const char *name, const pal_quantiles *q) {
    (void)printf("  %-16s %9.1f %9.1f %9.1f %9.1f\n", name, q->p50, q->p99, q->p999, q->max);
}

/// null: no limit.
static json_t *json_limit(double limit) {
    return isfinite(limit) ? json_real(limit) : json_null();
}

static json_t *json_limits(const pal_session_report *r) {
    json_t *array = json_array();
    for (int32_t t = 0; t < r->tool_count; t++) {
        const pal_tool_limits *l = &r->limits[t];
        json_array_append_new(array,
                              json_pack("{s:o,s:o,s:o}", "force", json_limit(l->force), "slew",
                                        json_limit(l->slew), "torque", json_limit(l->torque)));
    }
    return array;
}

/// The newest onsets of faults, oldest first.
static json_t *json_events(const pal_engine_counts *c, const char *const name[32]) {
    json_t *array = json_array();
    uint64_t first = c->events > PALPATE_EVENTS_KEPT ? c->events - PALPATE_EVENTS_KEPT : 0;
    for (uint64_t n = first; n < c->events; n++) {
        const pal_fault_event *e = &c->event[n % PALPATE_EVENTS_KEPT];
        json_array_append_new(array, json_pack("{s:I,s:i,s:s,s:o}", "tick", (json_int_t)e->tick,
                                               "tool", (int)e->tool, "fault",
                                               name[e->bit] + strlen("PALPATE_FAULT_"), "value",
                                               json_limit(e->value)));
    }
    return array;
}

static void print_limit(const char *name, double limit, const char *unit) {
    if (isfinite(limit)) {
        (void)printf(" %s %g %s", name, limit, unit);
    } else {
        (void)printf(" %s NOT LIMITED", name);
    }
}

static void print_limits(const pal_session_report *r) {
    for (int32_t t = 0; t < r->tool_count; t++) {
        (void)printf("limits         tool %d:", (int)t);
        print_limit("force", r->limits[t].force, "N,");
        print_limit("slew", r->limits[t].slew, "N/ms,");
        print_limit("torque", r->limits[t].torque, "N m");
        (void)printf("%s\n", r->latched >> t & 1u ? "; its watchdog is LATCHED" : "");
    }
}

/// Work at each tool's device: {name: {given, taken, worst}} [J].
static json_t *json_energy(const pal_session_report *r, const pal_runtime_config *runtime) {
    json_t *j = json_object();
    for (int32_t t = 0; t < runtime->tool_count; t++) {
        json_object_set_new(j, runtime->tools[t].name,
                            json_pack("{s:f,s:f,s:f}", "given", r->port[t].given, "taken",
                                      r->port[t].taken, "worst", r->port[t].worst));
    }
    return j;
}

static void print_energy(const pal_session_report *r, const pal_runtime_config *runtime) {
    for (int32_t t = 0; t < runtime->tool_count; t++) {
        const pal_port_energy *e = &r->port[t];
        (void)printf("energy         %s: %.3g mJ taken from the device, %.3g mJ given back, at "
                     "most %.3g mJ in "
                     "excess\n",
                     runtime->tools[t].name, 1e3 * e->taken, 1e3 * e->given, 1e3 * e->worst);
    }
}

static json_t *json_report(const pal_session_report *r, const options *o) {
#define FAULT_NAME(name, bit, text) [bit] = #name,
    static const char *const fault_name[32] = {PALPATE_FAULT_LIST(FAULT_NAME)};
#undef FAULT_NAME
    json_t *j = json_object(), *faults = json_object();
    json_object_set_new(j, "ticks", json_integer((json_int_t)r->ticks));
    json_object_set_new(j, "missed", json_integer((json_int_t)r->missed));
    json_object_set_new(j, "frames", json_integer((json_int_t)r->frames));
    json_object_set_new(j, "seconds", json_real(r->seconds));
    json_object_set_new(j, "field_skipped", json_integer((json_int_t)r->field_skipped));
    json_object_set_new(j, "compute_us", json_quantiles(&r->compute_us));
    json_object_set_new(j, "cpu_us", json_quantiles(&r->cpu_us));
    json_object_set_new(j, "lateness_us", json_quantiles(&r->lateness_us));
    json_object_set_new(j, "device_us", json_quantiles(&r->device_us));
    json_object_set_new(j, "force_us", json_quantiles(&r->force_us));
    json_object_set_new(j, "field_us", json_quantiles(&r->field_us));
    json_object_set_new(j, "pose_to_force_us", json_quantiles(&r->pose_to_force_us));
    json_object_set_new(j, "peak_force", json_real(r->peak_force));
    json_object_set_new(j, "peak_force_vector", json_vector3(r->peak_force_vector));
    json_object_set_new(j, "peak_depth", json_real(r->peak_depth));
    json_object_set_new(j, "contact_ticks", json_integer((json_int_t)r->counts.contact_ticks));
    json_object_set_new(j, "contacts_dropped",
                        json_integer((json_int_t)r->counts.contacts_dropped));
    for (int i = 0; i < 32; i++) {
        if (r->counts.fault[i] > 0 && fault_name[i] != NULL) {
            json_object_set_new(
                faults, fault_name[i] + strlen("PALPATE_FAULT_"),
                json_pack("{s:I,s:I,s:f}", "count", (json_int_t)r->counts.fault[i], "last_tick",
                          (json_int_t)r->counts.fault_tick[i], "value",
                          isfinite(r->counts.fault_value[i]) ? r->counts.fault_value[i] : -1.0));
        }
    }
    json_object_set_new(j, "faults", faults);
    json_object_set_new(j, "events", json_events(&r->counts, fault_name));
    json_object_set_new(j, "limits", json_limits(r));
    json_object_set_new(j, "latched", json_integer(r->latched));
    json_object_set_new(j, "device_errors", json_integer((json_int_t)r->device_errors));
    json_object_set_new(j, "page_faults", json_integer((json_int_t)r->page_faults));
    if (o->record != NULL) {
        json_object_set_new(
            j, "recording",
            json_pack("{s:o,s:I,s:I,s:I,s:o}", "file", json_text(o->record), "records",
                      (json_int_t)r->records, "lost", (json_int_t)r->records_lost, "frames",
                      (json_int_t)r->record_frames, "error", json_text(r->record_error)));
    }
    if (o->dump != NULL) {
        json_object_set_new(j, "dumps",
                            json_pack("{s:i,s:i,s:o}", "written", (int)r->dumps, "lost",
                                      (int)r->dumps_lost, "newest", json_text(r->dump_path)));
    }
    if (o->reference > 0.0) {
        json_object_set_new(j, "bare",
                            json_pack("{s:I,s:I,s:o}", "ticks", (json_int_t)r->bare.ticks, "missed",
                                      (json_int_t)r->bare.missed, "lateness_us",
                                      json_quantiles(&r->bare.lateness_us)));
    }
    json_object_set_new(j, "scheduling", json_string(r->scheduling));
    if (o->snapshot != NULL) {
        json_object_set_new(j, "snapshot", json_text(o->snapshot));
    }
    return j;
}

static void print_report(const pal_session_report *r, const options *o, const painter *p) {
#define FAULT_TEXT(name, bit, text) [bit] = text,
    static const char *const fault_text[32] = {PALPATE_FAULT_LIST(FAULT_TEXT)};
#undef FAULT_TEXT
    (void)printf("ticks          %llu evaluated, %llu missed, of %.3f s\n",
                 (unsigned long long)r->ticks, (unsigned long long)r->missed, r->seconds);
    if (o->reference > 0.0) {
        (void)printf("bare loop      %llu ticks, %llu missed: what the machine itself misses\n",
                     (unsigned long long)r->bare.ticks, (unsigned long long)r->bare.missed);
    }
    (void)printf("scheduling     %s\n", o->freewheel ? "freewheel: no waiting" : r->scheduling);
    (void)printf("times [us]             p50       p99     p99.9       max\n");
    print_quantiles("compute", &r->compute_us);
    print_quantiles("  cpu time of it", &r->cpu_us);
    print_quantiles("  force", &r->force_us);
    print_quantiles("  field", &r->field_us);
    print_quantiles("pose to force", &r->pose_to_force_us);
    if (!o->freewheel) {
        print_quantiles("lateness", &r->lateness_us);
        if (o->reference > 0.0) {
            print_quantiles("  bare loop's", &r->bare.lateness_us);
        }
    }
    (void)printf("peak force     %.4f N on the tool (%.4f, %.4f, %.4f), deepest %.2f mm\n",
                 r->peak_force, r->peak_force_vector[0], r->peak_force_vector[1],
                 r->peak_force_vector[2], 1e3 * r->peak_depth);
    print_limits(r);
    double mean = 0.0;
    unsigned long drawn = p != NULL ? painter_count(p, &mean) : 0;
    (void)printf("frames         %llu", (unsigned long long)r->frames);
    if (drawn > 0) {
        (void)printf(", drawn in %.1f ms each", 1e3 * mean);
    }
    (void)printf("; %llu ticks without a field for lack of time\n",
                 (unsigned long long)r->field_skipped);
    for (int i = 0; i < 32; i++) {
        if (r->counts.fault[i] > 0 && fault_text[i] != NULL) {
            (void)printf("fault          %llu x %s (last in tick %llu, value %g)\n",
                         (unsigned long long)r->counts.fault[i], fault_text[i],
                         (unsigned long long)r->counts.fault_tick[i], r->counts.fault_value[i]);
        }
    }
    if (r->device_errors > 0) {
        (void)printf("device         %llu refused reads or writes\n",
                     (unsigned long long)r->device_errors);
    }
    if (o->record != NULL) {
        (void)printf("recording      %s: %llu records, %llu frames, %llu lost%s%s\n", o->record,
                     (unsigned long long)r->records, (unsigned long long)r->record_frames,
                     (unsigned long long)(r->records_lost + r->record_frames_lost),
                     r->record_error[0] ? "; " : "", r->record_error);
    }
    if (r->dumps + r->dumps_lost > 0) {
        (void)printf("dumps          %d of the last ticks, the newest %s; %d not written\n",
                     (int)r->dumps, r->dump_path, (int)r->dumps_lost);
    }
    if (o->snapshot != NULL) {
        (void)printf("picture        %s\n", o->snapshot);
    }
}

/// Wait for the servo with a progress line; pass an interrupt on.
static void wait_for_end(pal_session *session, const options *o, double seconds) {
    pal_progress progress = progress_line(&o->common);
    while (pal_session_running(session)) {
        struct timespec pause = {0, 50000000};
        (void)nanosleep(&pause, NULL);
        if (interrupt_signal() != 0) {
            pal_session_request_stop(session);
        }
        if (o->dump != NULL && dump_signal()) {
            pal_session_request_dump(session);
        }
        pal_session_report now;
        pal_session_get_report(session, &now);
        double f = seconds > 0.0 ? now.seconds / seconds : -1.0;
        (void)progress.call(progress.user, "run", f,
                            seconds > 0.0 && !o->freewheel ? seconds - now.seconds : -1.0);
    }
    progress_end();
}

static pal_status run(const source *s, options *o, pal_session_report *report, painter **paint,
                      pal_error *error) {
    const pal_runtime_config *runtime = pal_model_runtime(s->model);
    if (runtime->tool_count == 0) {
        return pal_fail(error, PALPATE_ERROR_SCENE,
                        "%s: no tools: `run` needs `tools` with a device each", o->path);
    }
    pal_session_def def = pal_session_default_def();
    def.engine.tools = runtime->tools;
    def.engine.tool_count = runtime->tool_count;
    def.engine.max_contacts = runtime->max_contacts;
    def.engine.field_by = runtime->field_by;
    def.engine.watchdog = runtime->watchdog;
    def.engine.contact_law = runtime->contact_law;
    def.engine.contact_points = runtime->contact_points;
    def.engine.period = 1.0 / runtime->servo_rate;
    def.freewheel = o->freewheel;
    def.realtime = o->realtime;
    def.cpu = o->cpu;
    def.render_rate = runtime->render_rate;
    def.record_path = o->record;
    def.dump_path = o->dump;
    def.reference_slice = o->freewheel ? 0.0 : o->reference;
    double longest = 0.0;
    pal_status status = create_devices(runtime, &def, &longest, error);
    if (status != PALPATE_OK) {
        return status;
    }
    def.duration = o->seconds > 0.0 ? o->seconds : longest > 0.0 ? longest : 10.0;
    char title[256];
    const char *base = strrchr(o->path, '/');
    (void)snprintf(title, sizeof title, "%s", base != NULL ? base + 1 : o->path);
    if (o->draw || o->snapshot != NULL || o->gif != NULL) {
        painter_def p = {.model = s->model,
                         .runtime = runtime,
                         .title = title,
                         .width = o->width,
                         .height = o->height,
                         .snapshot_path = o->snapshot,
                         .gif_path = o->gif,
                         .gif_period = 0.1};
        status = painter_create(&p, paint, error);
        def.render = painter_frame;
        def.render_user = *paint;
    }
    pal_session *session = NULL;
    if (status == PALPATE_OK) {
        status = pal_session_create(s->model, &def, &session, error);
    }
    if (status != PALPATE_OK) {
        for (int32_t t = 0; t < runtime->tool_count; t++) {
            def.devices[t].close(def.devices[t].self);
        }
        return status;
    }
    status = pal_session_start(session, error);
    if (status == PALPATE_OK) {
        wait_for_end(session, o, def.duration);
        status = pal_session_finish(session, error);
        pal_session_get_report(session, report);
    }
    pal_session_free(session);
    if (status == PALPATE_OK && *paint != NULL && o->pictured) {
        status = painter_status(*paint, error);
    }
    return status;
}

/// Where the results will go, before a model is built and a session has run for nothing.
static pal_status check_targets(const options *o, pal_error *error) {
    pal_status status = target_check("--snapshot", o->snapshot, ".png", o->path, error);
    if (status == PALPATE_OK) {
        status = target_check("--gif", o->gif, ".gif", o->path, error);
    }
    if (status == PALPATE_OK) {
        status = target_check("--record", o->record, ".h5 .hdf5", o->path, error);
    }
    if (status == PALPATE_OK) {
        status = target_check("--dump", o->dump, ".h5 .hdf5", o->path, error);
    }
    if (status == PALPATE_OK && o->record != NULL && o->dump != NULL &&
        strcmp(o->record, o->dump) == 0) {
        status = pal_fail(error, PALPATE_ERROR_ARGUMENT,
                          "--dump %.300s: the recording goes there; give it another name", o->dump);
    }
    return status;
}

/// Drawing for nobody that failed is no failure of the run: why it did, into error.
static int painter_failed(const options *o, const painter *paint, pal_error *error) {
    return paint != NULL && !o->pictured && painter_status(paint, error) != PALPATE_OK;
}

/// The report, with the error that came at the end if one did.
static void finish_report(const source *s, const options *o, const pal_session_report *report,
                          const painter *paint, pal_status status, const pal_error *error) {
    const pal_runtime_config *runtime = pal_model_runtime(s->model);
    if (status != PALPATE_OK) {
        (void)fprintf(stderr, "%s: %s\n", o->common.command, error->message);
    }
    pal_error undrawn = {0};
    if (painter_failed(o, paint, &undrawn) && !o->common.quiet) {
        (void)fprintf(stderr, "warning: %s\n", undrawn.message);
    }
    if (!o->common.json) {
        print_report(report, o, paint);
        print_energy(report, runtime);
        return;
    }
    json_t *object = json_report(report, o);
    json_object_set_new(object, "energy", json_energy(report, runtime));
    json_t *warnings = source_warnings_json(s);
    if (painter_failed(o, paint, &undrawn)) {
        json_array_append_new(warnings, json_text(undrawn.message));
    }
    json_object_set_new(object, "warnings", warnings);
    if (status != PALPATE_OK) {
        json_object_set_new(object, "error", json_error(status, error));
    }
    print_json(object);
}

int command_run(int argc, char **argv) {
    options o = {.common = {.command = "palpate run"},
                 .realtime = 1,
                 .cpu = -1,
                 .width = 960,
                 .height = 640,
                 .draw = 1};
    const struct argp_child children[] = {{&common_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {list, parse, "SCENE|MODEL", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    source s;
    interrupt_install();
    if (o.dump != NULL) {
        dump_install();
    }
    o.pictured = o.snapshot != NULL || o.gif != NULL;
    pal_status status = check_targets(&o, &error);
    if (status == PALPATE_OK) {
        status = source_open(o.path, &o.common, 0, &s, &error);
    }
    if (status != PALPATE_OK) {
        return report_error(&o.common, status, &error);
    }
    source_print_warnings(&s, &o.common);
    pal_session_report report;
    memset(&report, 0, sizeof report);
    painter *paint = NULL;
    status = run(&s, &o, &report, &paint, &error);
    int exit_status = status != PALPATE_OK;
    if (paint != NULL && painter_status(paint, NULL) != PALPATE_OK) {
        o.snapshot = o.gif = NULL; // they are not there
    }
    if (report.ticks == 0 && status != PALPATE_OK) {
        exit_status = report_error(&o.common, status, &error);
    } else { // a picture or a recording that failed does not lose what was measured
        finish_report(&s, &o, &report, paint, status, &error);
    }
    if (exit_status == 0 && interrupt_signal() != 0) {
        exit_status = 128 + interrupt_signal();
    }
    painter_free(paint);
    source_close(&s);
    return exit_status;
}
