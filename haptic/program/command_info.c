/// @file command_info.c  palpate info MODEL
#include "haptic/program/program.h"

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
        return parse_path(key, arg, state, &o->path, "MODEL",
                          "`palpate precompute SCENE -o MODEL` makes one");
    }
}

static const char doc[] =
    "Show what is in a model file: nodes, method, cost, certificate.\v"
    "Reciprocity is ||C - C^T|| / ||C|| of the touchable compliance before it is symmetrized: it "
    "informs, "
    "it does not gate. A passive model is symmetric and positive definite: it never feeds energy "
    "into "
    "the hand. A SCENE may be given too; it is then built or taken from the cache.\n\n"
    "Example:\n  palpate info hemisphere.palpate --json";

int command_info(int argc, char **argv) {
    options o = {.common = {.command = "palpate info"}};
    const struct argp_child children[] = {{&common_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {NULL, parse, "MODEL", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    source s;
    interrupt_install();
    pal_status status = source_open(o.path, &o.common, 1, &s, &error);
    if (status != PALPATE_OK) {
        return report_error(&o.common, status, &error);
    }
    interrupt_restore();
    source_print_warnings(&s, &o.common);
    if (o.common.json) {
        json_t *object = json_info(s.model);
        json_object_set_new(object, "warnings", source_warnings_json(&s));
        print_json(object);
    } else {
        print_info(s.model);
    }
    source_close(&s);
    return 0;
}
