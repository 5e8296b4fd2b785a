/// @file options.c  Options that every command takes.
#include "haptic/program/program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>

enum { KEY_JSON = 0x100, KEY_SET = 0x101 };

static error_t parse_common(int key, char *arg, struct argp_state *state) {
    common_options *o = state->input;
    switch (key) {
    case KEY_JSON:
        o->json = 1;
        return 0;
    case 'q':
        o->quiet = 1;
        return 0;
    case KEY_SET:
        if (o->override_count == OVERRIDES_MAX) {
            argp_error(state, "more than %d --set", OVERRIDES_MAX);
        }
        o->overrides[o->override_count++] = arg;
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}

static const struct argp_option common_options_list[] = {
    {"json", KEY_JSON, NULL, 0, "One JSON object on standard output, nothing else there", 90},
    {"set", KEY_SET, "KEY=VALUE", 0,
     "Override a key of the scene by its dotted path, e.g. body.material.poisson=0.3 "
     "(`palpate schema` lists the keys); may be repeated",
     90},
    {"quiet", 'q', NULL, 0, "No progress line", 90},
    {0}};

const struct argp common_argp = {.options = common_options_list, .parser = parse_common};

int parse_vector(const char *text, double v[3]) {
    for (int d = 0; d < 3; d++) {
        char *end = NULL;
        v[d] = strtod(text, &end);
        if (end == text || !isfinite(v[d]) || *end != (d < 2 ? ',' : '\0')) {
            return 0;
        }
        text = end + 1;
    }
    return 1;
}

int parse_size(const char *text, int *width, int *height) {
    char extra;
    return sscanf(text, "%dx%d%c", width, height, &extra) == 2 && *width >= 64 && *width <= 4096 &&
           *height >= 64 && *height <= 4096;
}

error_t parse_recording(int key, char *arg, struct argp_state *state, const char **path) {
    switch (key) {
    case ARGP_KEY_ARG:
        if (*path != NULL) {
            argp_error(state, "one FILE at a time");
        }
        *path = arg;
        return 0;
    case ARGP_KEY_END:
        if (*path == NULL) {
            argp_error(state, "which FILE? The one that was given to `palpate run --record`");
        }
        return 0;
    default:
        return ARGP_ERR_UNKNOWN;
    }
}
