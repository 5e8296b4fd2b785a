/// @file command_recover.c  palpate recover FILE: the recording of a run that was killed.
#include "haptic/program/program.h"

#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include <palpate/session.h>

#include "haptic/base/error.h"

typedef struct options {
    common_options common;
    const char *path;
} options;

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    default:
        return parse_recording(key, arg, state, &o->path);
    }
}

static const char doc[] = "Make the recording of a run that was killed: FILE (HDF5) and its XDMF "
                          "companion, out of FILE.ticks and "
                          "FILE.frames, which are then removed.\v"
                          "A run that ends in order does this itself. Damaged or half-written "
                          "records are left out and counted.\n\n"
                          "Example:\n  palpate recover press.h5";

/// Nothing to recover is no damage: say which it is.
static pal_status look_for_raw(const char *path, pal_error *error) {
    static const char *const raw[] = {".ticks", ".frames"};
    char name[PATH_MAX];
    size_t length = strlen(path);
    for (size_t k = 0; k < sizeof raw / sizeof *raw; k++) {
        size_t n = strlen(raw[k]);
        if (length > n && strcmp(path + length - n, raw[k]) == 0) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "%.500s: a raw file; give the name of the recording: %.*s", path,
                            (int)(length - n < 300 ? length - n : 300), path);
        }
    }
    if (path[0] == '\0' || (size_t)snprintf(name, sizeof name, "%s.ticks", path) >= sizeof name ||
        access(name, F_OK) == 0) {
        return PALPATE_OK; // the library has the better word
    }
    return access(path, F_OK) == 0
               ? pal_fail(error, PALPATE_ERROR_NOT_FOUND,
                          "%.400s: nothing to recover: no raw file %.400s beside it", path, name)
               : pal_fail(
                     error, PALPATE_ERROR_NOT_FOUND,
                     "%.400s: nothing to recover: neither it nor its raw file %.400s is there; "
                     "give the name that `palpate run --record` was given",
                     path, name);
}

int command_recover(int argc, char **argv) {
    options o = {
        .common = {.command = "palpate recover", .no_set = "a recording is recovered as it is"}};
    const struct argp_child children[] = {{&plain_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {NULL, parse, "FILE", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    pal_recording_summary s;
    pal_status status = look_for_raw(o.path, &error);
    interrupt_install(); // the raw files stay until the recording is whole
    if (status == PALPATE_OK) {
        status = pal_recording_convert(o.path, &s, &error);
    }
    if (status != PALPATE_OK) {
        return report_error(&o.common, status, &error);
    }
    if (o.common.json) {
        print_json(json_pack("{s:o,s:I,s:I,s:I,s:I,s:f,s:b}", "file", json_text(o.path), "records",
                             (json_int_t)s.records, "frames", (json_int_t)s.frames, "bad_records",
                             (json_int_t)s.bad_records, "bad_frames", (json_int_t)s.bad_frames,
                             "seconds", s.seconds, "complete", s.complete));
    } else {
        (void)printf(
            "%s: %llu records and %llu frames of %.3f s%s; %llu and %llu damaged ones left out\n",
            o.path, (unsigned long long)s.records, (unsigned long long)s.frames, s.seconds,
            s.complete ? "" : " (the run was killed)", (unsigned long long)s.bad_records,
            (unsigned long long)s.bad_frames);
    }
    return interrupt_signal() != 0 ? 128 + interrupt_signal() : 0;
}
