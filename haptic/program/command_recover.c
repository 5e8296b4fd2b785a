/// @file command_recover.c  palpate recover FILE: the recording of a run that was killed.
#include "haptic/program/program.h"

#include <stdio.h>

#include <palpate/session.h>

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

int command_recover(int argc, char **argv) {
    options o = {.common = {.command = "palpate recover"}};
    const struct argp_child children[] = {{&common_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {NULL, parse, "FILE", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    pal_recording_summary s;
    pal_status status = pal_recording_convert(o.path, &s, &error);
    if (status != PALPATE_OK) {
        return report_error(&o.common, status, &error);
    }
    if (o.common.json) {
        print_json(json_pack("{s:s,s:I,s:I,s:I,s:I,s:f,s:b}", "file", o.path, "records",
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
    return 0;
}
