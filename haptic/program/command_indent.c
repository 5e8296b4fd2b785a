/// @file command_indent.c  palpate indent SCENE|MODEL --tool NAME --depths D1,D2,...
#include "haptic/program/program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

enum { DEPTHS_MAX = 1024, FEW_CONTACTS = 4, REMARKS_MAX = 4, REMARK = 256 };

typedef struct options {
    common_options common;
    const char *path;
    const char *tool;
    int32_t depth_count;
    double depths[DEPTHS_MAX];
    pal_indent_law law;
} options;

/// "D1,D2,..." into o->depths. @return 0 when it is not a list of 1 to DEPTHS_MAX numbers >= 0
static int parse_depths(const char *text, options *o) {
    o->depth_count = parse_numbers(text, o->depths, DEPTHS_MAX);
    for (int32_t i = 0; i < o->depth_count; i++) {
        if (o->depths[i] < 0) {
            return 0;
        }
    }
    return o->depth_count > 0;
}

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    case 't':
        o->tool = arg;
        return 0;
    case 'd':
        if (!parse_depths(arg, o)) {
            argp_error(state,
                       "--depths %s: numbers of 0 or more in metres, e.g. --depths 0.01,0.02", arg);
        }
        return 0;
    case 'c':
        if (strcmp(arg, "rest") != 0 && strcmp(arg, "full") != 0) {
            argp_error(state, "--contact %s: rest or full", arg);
        }
        o->law = strcmp(arg, "full") == 0 ? PALPATE_INDENT_FULL : PALPATE_INDENT_REST;
        return 0;
    case ARGP_KEY_SUCCESS:
        if (o->tool == NULL || o->depth_count == 0) {
            argp_error(state, "give --tool and --depths, e.g.\n  palpate indent "
                              "scenes/block.yaml --tool ball --depths 0.02,0.05,0.1");
        }
        return 0;
    default:
        return parse_path(key, arg, state, &o->path, "SCENE or MODEL",
                          "e.g. palpate indent scenes/block.yaml --tool ball --depths 0.02,0.05");
    }
}

static const struct argp_option list[] = {
    {"tool", 't', "NAME", 0, "Tool of the scene; it needs start and axis, no device", 1},
    {"depths", 'd', "D1,D2,...", 0, "Travel from the tool's start along its axis [m]", 1},
    {"contact", 'c', "LAW", 0,
     "rest (default): contact linearised about the rest shape, along the tool's axis; "
     "full: on the deformed shape, along the tool's normals",
     1},
    {0}};
static const char doc[] =
    "Press a rigid, frictionless tool along its axis and report force against depth.\v"
    "Contact is unilateral at the touchable nodes. The force is the magnitude of the one the tool "
    "applies "
    "to the body [N]; the radius is that of the circle with the area of contact [m]. The tool's "
    "limits and "
    "coupling play no part.\n\n"
    "Example:\n  palpate indent scenes/block.yaml --tool ball --depths 0.02,0.05,0.1 --json";

static const pal_tool_def *find_tool(const pal_runtime_config *runtime, const char *name,
                                     pal_error *error) {
    char names[PALPATE_TOOLS_MAX * (PALPATE_NAME_MAX + 2)] = "none";
    size_t at = 0;
    for (int32_t i = 0; i < runtime->tool_count; i++) {
        if (strcmp(runtime->tools[i].name, name) == 0) {
            return &runtime->tools[i];
        }
        int n = snprintf(names + at, sizeof names - at, "%s%s", i > 0 ? ", " : "",
                         runtime->tools[i].name);
        at += n > 0 ? (size_t)n : 0;
    }
    (void)pal_fail(error, PALPATE_ERROR_NOT_FOUND,
                   "tool \"%.64s\": there is no such tool; the tools are: %s", name, names);
    return NULL;
}

/// What the reader should know about the curve, each in a text of its own. @return how many
static int remarks(const source *s, const options *o, const pal_tool_def *tool,
                   const pal_indent_result *curve, char text[REMARKS_MAX][REMARK]) {
    int n = 0, cut_off = 0, few = 0;
    double deepest = 0.0;
    for (int32_t i = 0; i < o->depth_count; i++) {
        cut_off |= curve[i].cut_off;
        few |= curve[i].contacts > 0 && curve[i].contacts < FEW_CONTACTS;
        deepest = fmax(deepest, curve[i].depth);
    }
    if (cut_off) {
        (void)snprintf(
            text[n++], REMARK,
            "the contact solver was stopped early at some depth: its force is an estimate");
    }
    if (few) {
        (void)snprintf(
            text[n++], REMARK,
            tool->shape == PALPATE_SHAPE_POINT
                ? "a point's force depends on the node spacing: an elastic body does not "
                  "resist a point"
                : "fewer than 4 nodes carry the force at some depth: refine the cloud "
                  "under the tool");
    }
    if (tool->friction > 0.0) {
        (void)snprintf(
            text[n++], REMARK,
            "tool %.64s: its friction of %g plays no part here: `indent` presses without "
            "friction, `run` with it",
            tool->name, tool->friction);
    }
    n += large_move(s->model, "the largest depth", deepest, text[n], REMARK);
    return n;
}

static void print_json_curve(const source *s, const options *o, const pal_indent_result *curve,
                             char note[REMARKS_MAX][REMARK], int notes) {
    pal_model_info info;
    pal_model_get_info(s->model, &info);
    json_t *object = json_object(), *list_json = json_array(), *warnings = source_warnings_json(s);
    for (int32_t i = 0; i < o->depth_count; i++) {
        const pal_indent_result *r = &curve[i];
        json_t *entry = json_object();
        json_object_set_new(entry, "depth", json_real(r->depth));
        json_object_set_new(entry, "force", json_real(r->force));
        json_object_set_new(entry, "contacts", json_integer(r->contacts));
        json_object_set_new(entry, "radius", json_real(r->radius));
        json_object_set_new(entry, "force_vector", json_vector3(r->force_vector));
        json_object_set_new(entry, "iterations", json_integer(r->iterations));
        json_object_set_new(entry, "cut_off", json_boolean(r->cut_off));
        json_array_append_new(list_json, entry);
    }
    for (int k = 0; k < notes; k++) {
        json_array_append_new(warnings, json_string(note[k]));
    }
    json_object_set_new(object, "curve", list_json);
    json_object_set_new(object, "tool", json_string(o->tool));
    json_object_set_new(object, "contact",
                        json_string(o->law == PALPATE_INDENT_FULL ? "full" : "rest"));
    json_object_set_new(object, "nodes", json_integer(info.node_count));
    json_object_set_new(object, "method", json_string(info.method));
    json_object_set_new(object, "certificate", json_certificate(&info.certificate));
    json_object_set_new(object, "warnings", warnings);
    print_json(object);
}

static void print_curve(const options *o, const pal_indent_result *curve) {
    (void)printf("tool %s, contact law %s\n%12s %12s %10s %12s\n", o->tool,
                 o->law == PALPATE_INDENT_FULL ? "full" : "rest", "depth [m]", "force [N]",
                 "contacts", "radius [m]");
    for (int32_t i = 0; i < o->depth_count; i++) {
        (void)printf("%12.6g %12.6g %10d %12.4g%s\n", curve[i].depth, curve[i].force,
                     curve[i].contacts, curve[i].radius,
                     curve[i].cut_off ? "  (stopped early)" : "");
    }
}

int command_indent(int argc, char **argv) {
    static options o = {.common = {.command = "palpate indent"}};
    static pal_indent_result curve[DEPTHS_MAX];
    const struct argp_child children[] = {{&common_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {list, parse, "SCENE|MODEL", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    source s;
    interrupt_install();
    pal_status status = source_open(o.path, &o.common, 1, &s, &error);
    if (status != PALPATE_OK) {
        return report_error(&o.common, status, &error);
    }
    interrupt_restore();
    const pal_tool_def *tool = find_tool(pal_model_runtime(s.model), o.tool, &error);
    status = tool == NULL
                 ? PALPATE_ERROR_NOT_FOUND
                 : pal_model_indent(s.model, tool, o.law, o.depths, o.depth_count, curve, &error);
    if (status != PALPATE_OK) {
        source_close(&s);
        return report_error(&o.common, status, &error);
    }
    source_print_warnings(&s, &o.common);
    static char note[REMARKS_MAX][REMARK];
    int notes = remarks(&s, &o, tool, curve, note);
    for (int k = 0; k < notes && !o.common.quiet; k++) {
        (void)fprintf(stderr, "warning: %s\n", note[k]);
    }
    if (o.common.json) {
        print_json_curve(&s, &o, curve, note, notes);
    } else {
        print_curve(&o, curve);
    }
    source_close(&s);
    return 0;
}
