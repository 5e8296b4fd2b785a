/// @file command_replay.c  palpate replay FILE: a recording felt again, on its model or on another.
#include "haptic/program/program.h"

#include <stdio.h>

#include "haptic/base/error.h"
#include "haptic/recording/replay.h"

enum { KEY_MODEL = 0x200, KEY_AGAINST, EXIT_DIFFERS = 1 };

typedef struct options {
    common_options common;
    const char *path, *model;
    int against; ///< 1: another model is meant to be felt
} options;

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    case KEY_MODEL:
    case KEY_AGAINST:
        if (o->model != NULL) {
            argp_error(state, "one of --model and --against, once");
        }
        o->model = arg;
        o->against = key == KEY_AGAINST;
        return 0;
    default:
        return parse_recording(key, arg, state, &o->path);
    }
}

static const struct argp_option list[] = {
    {"model", KEY_MODEL, "SCENE|MODEL", 0,
     "What was run (default: the cache is asked for it); refused when its content hash is another "
     "one",
     1},
    {"against", KEY_AGAINST, "SCENE|MODEL", 0, "Another model: what would it have felt?", 1},
    {0}};
static const char doc[] =
    "Feed the inputs of a recording to the engine again, tick by tick with its recorded "
    "definition, and compare "
    "all that it gives with what was recorded, bit for bit.\v"
    "Exit status 0: no difference (or --against); 1: a difference, of which the first is shown. "
    "The same build "
    "on the same model gives none, also of a run that missed periods.\n\n"
    "Example:\n  palpate run scenes/hemisphere.yaml --for 5 --record press.h5\n"
    "  palpate replay press.h5\n"
    "  palpate precompute scenes/hemisphere.yaml --set body.material.young=5e3 \\\n"
    "    -o soft.palpate\n"
    "  palpate replay press.h5 --against soft.palpate";

static json_t *json_force(const pal_tool_force *f) {
    return json_pack("{s:o,s:o,s:i,s:I,s:f}", "force", json_vector3(f->force), "torque",
                     json_vector3(f->torque), "contacts", (int)f->contact_count, "fault",
                     (json_int_t)f->fault, "depth", f->depth);
}

static void print_json_report(const options *o, const pal_replay_report *r) {
    json_t *j = json_pack("{s:o,s:o,s:b,s:I,s:I,s:I,s:I,s:I,s:f,s:f,s:I,s:f,s:f}", "file",
                          json_text(o->path), "model", json_text(o->model), "same_model",
                          (int)r->hash_matches, "ticks", (json_int_t)r->ticks, "records",
                          (json_int_t)r->records, "start", (json_int_t)r->start, "holes",
                          (json_int_t)r->holes, "differences", (json_int_t)r->differences,
                          "peak_difference", r->peak_difference, "rms_difference",
                          r->rms_difference, "peak_tick", (json_int_t)r->peak_tick, "recorded_peak",
                          r->recorded_peak, "replayed_peak", r->replayed_peak);
    if (r->first.what != NULL) {
        json_object_set_new(j, "first",
                            json_pack("{s:s,s:I,s:f,s:i,s:o,s:o}", "what", r->first.what, "tick",
                                      (json_int_t)r->first.tick, "time",
                                      1e-9 * (double)r->first.time_ns, "tool", (int)r->first.tool,
                                      "recorded", json_force(&r->first.recorded), "replayed",
                                      json_force(&r->first.replayed)));
    }
    print_json(j);
}

static void print_side(const char *name, const pal_tool_force *f) {
    (void)printf(
        "  %-9s force (%.17g, %.17g, %.17g) N, torque (%.17g, %.17g, %.17g) N m, %d contacts, "
        "depth %.17g m, fault 0x%x\n",
        name, f->force[0], f->force[1], f->force[2], f->torque[0], f->torque[1], f->torque[2],
        (int)f->contact_count, f->depth, (unsigned)f->fault);
}

static void print_report(const options *o, const pal_recording_info *info,
                         const pal_replay_report *r) {
    (void)printf("%s: %llu ticks, %llu records by %s, replayed on %s%s\n", o->path,
                 (unsigned long long)r->ticks, (unsigned long long)r->records, info->program,
                 o->model, r->hash_matches ? "" : " (another model)");
    if (r->start > 0 || r->holes > 0) {
        (void)printf("not whole: it starts at tick %llu and has %llu holes; what the engine "
                     "remembered of the "
                     "missing ticks may differ\n",
                     (unsigned long long)r->start, (unsigned long long)r->holes);
    }
    (void)printf("differences: %llu of %llu records; force: peak %.6g N (tick %llu), rms %.6g N; "
                 "largest force "
                 "%.6g N recorded, %.6g N replayed\n",
                 (unsigned long long)r->differences, (unsigned long long)r->records,
                 r->peak_difference, (unsigned long long)r->peak_tick, r->rms_difference,
                 r->recorded_peak, r->replayed_peak);
    if (r->first.what != NULL) {
        (void)printf("first difference: %s of tool %d in tick %llu (%.6f s)\n", r->first.what,
                     (int)r->first.tool, (unsigned long long)r->first.tick,
                     1e-9 * (double)r->first.time_ns);
        print_side("recorded", &r->first.recorded);
        print_side("replayed", &r->first.replayed);
    }
}

static pal_status replay(options *o, pal_recording *recording, pal_replay_report *report,
                         pal_error *error) {
    const pal_recording_info *info = pal_recording_get_info(recording);
    source s = {.passed = 1};
    pal_status status;
    if (o->model == NULL && o->common.override_count > 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "--set %s: needs a scene to change; give it with --model",
                        o->common.overrides[0]);
    }
    if (o->model == NULL) { // the cache has it by the hash that the recording names
        const offline_api *offline = offline_open(error);
        status = offline != NULL ? offline->cache_find(info->model_hash, &s.model, error)
                                 : PALPATE_ERROR_SYSTEM;
        if (status != PALPATE_OK) {
            return pal_fail_prefix(
                error, status,
                "%s: it was recorded on the model with hash %s (%s), which the cache does not "
                "give; give it, or its scene, with --model; or another one with --against",
                o->path, info->model_hash, info->model_method);
        }
        o->model = "the cached model";
    } else {
        status = source_open(o->model, &o->common, 1, &s, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    source_print_warnings(&s, &o->common);
    interrupt_restore();
    pal_model_info found;
    pal_model_get_info(s.model, &found);
    status = pal_replay(recording, s.model, 0, report, error);
    if (status == PALPATE_OK && !report->hash_matches && !o->against) {
        status = pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "%s: the model's hash is %s, the recording %s was made on %s; give that model, or use "
            "--against to compare",
            o->model, found.hash, o->path, info->model_hash);
    }
    source_close(&s);
    return status;
}

int command_replay(int argc, char **argv) {
    options o = {.common = {.command = "palpate replay"}};
    const struct argp_child children[] = {{&common_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {list, parse, "FILE", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    pal_recording *recording = NULL;
    pal_replay_report report = {0};
    interrupt_install();
    pal_status status = pal_recording_open(o.path, &recording, &error);
    if (status == PALPATE_OK) {
        status = replay(&o, recording, &report, &error);
    }
    int exit_status = 0;
    if (status != PALPATE_OK) {
        exit_status = report_error(&o.common, status, &error);
    } else {
        exit_status = report.differences > 0 && !o.against ? EXIT_DIFFERS : 0;
        if (o.common.json) {
            print_json_report(&o, &report);
        } else {
            print_report(&o, pal_recording_get_info(recording), &report);
        }
    }
    pal_recording_close(recording);
    return exit_status;
}
