/// @file command_schema.c  palpate schema: every key of a scene, from the table that drives the
/// loader.
#include "haptic/program/program.h"

#include <stdio.h>

static error_t parse(int key, char *arg, struct argp_state *state) {
    (void)arg;
    if (key == ARGP_KEY_INIT) {
        state->child_inputs[0] = state->input;
        return 0;
    }
    return ARGP_ERR_UNKNOWN;
}

static const char doc[] =
    "List every key of a scene: type, unit, what is allowed, default, meaning.\v"
    "Example:\n  palpate schema | grep -A2 spacing";

int command_schema(int argc, char **argv) {
    common_options o = {.command = "palpate schema",
                        .no_set = "no scene is used: all keys are listed"};
    const struct argp_child children[] = {{&plain_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {NULL, parse, "", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    const offline_api *offline = offline_open(&error);
    if (offline == NULL) {
        return report_error(&o, PALPATE_ERROR_SYSTEM, &error);
    }
    const pal_scene_key *keys = NULL;
    int count = offline->scene_schema(&keys);
    json_t *list = json_array();
    for (int i = 0; i < count; i++) {
        const pal_scene_key *k = &keys[i];
        if (o.json) {
            json_array_append_new(list,
                                  json_pack("{s:s,s:s,s:s,s:s,s:s,s:s}", "key", k->path, "type",
                                            k->type, "unit", k->unit, "allowed", k->allowed,
                                            "default", k->default_text, "help", k->help));
        } else {
            (void)printf("%s\n    %s%s%s%s; %s; default: %s\n    %s\n",
                         k->path[0] ? k->path : "(all of it)", k->type, k->unit[0] ? " [" : "",
                         k->unit, k->unit[0] ? "]" : "", k->allowed, k->default_text, k->help);
        }
    }
    if (o.json) {
        print_json(json_pack("{s:o}", "keys", list));
    } else {
        json_decref(list);
    }
    return 0;
}
