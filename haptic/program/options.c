/// @file options.c  Options and arguments that several commands take, and the one parser of each
/// kind of value. A value that cannot be is refused by argp_error: exit status 2, nothing done.
#include "haptic/program/program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { KEY_JSON = 0x100, KEY_SET = 0x101 };

static error_t parse_output(int key, char *arg, struct argp_state *state) {
    common_options *o = state->input;
    (void)arg;
    switch (key) {
    case KEY_JSON:
        o->json = 1;
        return 0;
    case 'q':
        o->quiet = 1;
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static error_t parse_set(int key, char *arg, struct argp_state *state) {
    common_options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = o;
        return 0;
    case KEY_SET:
        if (o->no_set != NULL) {
            argp_error(state, "--set %s: %s", arg, o->no_set);
        }
        if (o->override_count == OVERRIDES_MAX) {
            argp_error(state, "more than %d --set", OVERRIDES_MAX);
        }
        o->overrides[o->override_count++] = arg;
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp_option set_options[] = {
    {"set", KEY_SET, "KEY=VALUE", 0,
     "Override a key of the scene by its dotted path, e.g. body.material.poisson=0.3 "
     "(`palpate schema` lists the keys); may be repeated",
     90},
    {0}};
/// Where no scene is built --set is known, to be refused in words.
static const struct argp_option no_set_options[] = {
    {"set", KEY_SET, "KEY=VALUE", OPTION_HIDDEN, NULL, 90}, {0}};
static const struct argp_option output_options[] = {
    {"json", KEY_JSON, NULL, 0, "One JSON object on standard output, nothing else there", 90},
    {"quiet", 'q', NULL, 0, "No progress line", 90},
    {0}};

static const struct argp output_argp = {.options = output_options, .parser = parse_output};
static const struct argp_child output_child[] = {{&output_argp, 0, NULL, 0}, {0}};
const struct argp common_argp = {
    .options = set_options, .parser = parse_set, .children = output_child};
const struct argp plain_argp = {
    .options = no_set_options, .parser = parse_set, .children = output_child};

// ---- Values -------------------------------------------------------------------------------------

int parse_numbers(const char *text, double *v, int max) {
    for (int count = 0; count < max; count++) {
        char *end = NULL;
        double value = strtod(text, &end);
        if (end == text || !isfinite(value) || (*end != ',' && *end != '\0')) {
            return 0;
        }
        v[count] = value;
        if (*end == '\0') {
            return count + 1;
        }
        text = end + 1;
    }
    return 0; // more than there is room for
}

int parse_vector(const char *text, double v[3]) {
    return parse_numbers(text, v, 3) == 3;
}

double parse_time(const char *text, const char *option, int signed_too, struct argp_state *state) {
    double v = 0.0;
    int ok = parse_numbers(text, &v, 1) == 1;
    if (signed_too && !ok) {
        argp_error(state, "%s %s: a time in seconds", option, text);
    }
    if (!signed_too && !(ok && v > 0.0 && v <= 1e7)) {
        argp_error(state, "%s %s: a number of seconds, more than 0, up to 1e7", option, text);
    }
    return v;
}

int parse_integer(const char *text, int low, int high, int *v) {
    char *end = NULL;
    long value = strtol(text, &end, 10);
    if (end == text || *end != '\0' || value < low || value > high) {
        return 0;
    }
    *v = (int)value;
    return 1;
}

void parse_size(const char *text, int *width, int *height, struct argp_state *state) {
    char extra;
    if (sscanf(text, "%4dx%4d%c", width, height, &extra) != 2 || *width < 64 || *width > 4096 ||
        *height < 64 || *height > 4096) {
        argp_error(state, "--size %s: WIDTHxHEIGHT, 64 to 4096", text);
    }
}

// ---- Arguments ----------------------------------------------------------------------------------

error_t parse_path(int key, char *arg, struct argp_state *state, const char **path,
                   const char *what, const char *hint) {
    switch (key) {
    case ARGP_KEY_ARG:
        if (*path != NULL) {
            argp_error(state, "one %s at a time, not '%s' as well", what, arg);
        }
        *path = arg;
        return 0;
    case ARGP_KEY_END:
        if (*path == NULL) {
            argp_error(state, "which %s? %s", what, hint);
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

error_t parse_recording(int key, char *arg, struct argp_state *state, const char **path) {
    return parse_path(key, arg, state, path, "FILE",
                      "The one that was given to `palpate run --record`");
}
