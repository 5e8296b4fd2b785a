/// @file command_press.c  palpate press SCENE|MODEL --patch NAME --by X,Y,Z
#include "haptic/program/program.h"

#include <math.h>
#include <stdio.h>

#include "haptic/base/error.h"

typedef struct options {
    common_options common;
    const char *path;
    const char *patch;
    double by[3];
    int has_by;
} options;

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    case 'p':
        o->patch = arg;
        return 0;
    case 'b':
        if (!parse_vector(arg, o->by)) {
            argp_error(state, "--by %s: three numbers X,Y,Z in metres, e.g. --by 0,0,-0.005", arg);
        }
        o->has_by = 1;
        return 0;
    case ARGP_KEY_SUCCESS:
        if (o->patch == NULL || !o->has_by) {
            argp_error(state, "give --patch and --by, e.g.\n  palpate press "
                              "scenes/hemisphere.yaml --patch pole --by 0,0,-0.005");
        }
        return 0;
    default:
        return parse_path(key, arg, state, &o->path, "SCENE or MODEL",
                          "e.g. palpate press scenes/hemisphere.yaml --patch pole --by 0,0,-0.005");
    }
}

static const struct argp_option list[] = {
    {"patch", 'p', "NAME", 0, "Patch of the scene (body.patches) that is bonded to the tool", 1},
    {"by", 'b', "X,Y,Z", 0, "Displacement of every node of the patch [m]", 1},
    {0}};
static const char doc[] =
    "Press a bonded patch and report force, moment and probe displacements.\v"
    "All nodes of the patch are displaced by the same vector; the force is the one the tool "
    "applies to "
    "the body [N], the moment is about the mean rest position of the patch's nodes [N m], the "
    "probes' "
    "displacements are in metres. A model that fails its certificate is pressed all the same, with "
    "a "
    "warning.\n\n"
    "Example:\n  palpate press scenes/hemisphere.yaml --patch pole --by 0,0,-0.005 --json";

static void print_result(const source *s, const pal_press *press, const options *o) {
    pal_model_info info;
    pal_model_get_info(s->model, &info);
    (void)printf("force          (%.6g, %.6g, %.6g) N on the body\n", press->force[0],
                 press->force[1], press->force[2]);
    (void)printf("moment         (%.6g, %.6g, %.6g) N m about (%.4g, %.4g, %.4g)\n",
                 press->moment[0], press->moment[1], press->moment[2], press->center[0],
                 press->center[1], press->center[2]);
    (void)printf("patch          %s: %d nodes of %d, moved by (%g, %g, %g) m\n", o->patch,
                 press->patch_nodes, info.node_count, o->by[0], o->by[1], o->by[2]);
    for (int32_t p = 0; p < info.probe_count; p++) {
        double x[3];
        const char *name = pal_model_probe(s->model, p, x);
        const double *u = press->probe + 3 * p;
        (void)printf("probe          %s: (%.6g, %.6g, %.6g) mm\n", name, 1e3 * u[0], 1e3 * u[1],
                     1e3 * u[2]);
    }
    const pal_certificate *c = &info.certificate;
    (void)printf("certificate    %s; method %s, reciprocity %.1e, %s\n",
                 c->pass ? "passes" : "DOES NOT PASS", info.method, c->reciprocity,
                 c->passive ? "passive" : "not passive");
}

int command_press(int argc, char **argv) {
    options o = {.common = {.command = "palpate press"}};
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
    pal_press press = {0};
    interrupt_restore();
    status = pal_model_press(s.model, o.patch, o.by, &press, &error);
    for (int d = 0; status == PALPATE_OK && d < 3; d++) {
        if (!isfinite(press.force[d]) || !isfinite(press.moment[d])) {
            pal_press_clear(&press);
            status = pal_fail(&error, PALPATE_ERROR_ARGUMENT,
                              "--by %g,%g,%g: the force is beyond all numbers; give metres",
                              o.by[0], o.by[1], o.by[2]);
        }
    }
    if (status != PALPATE_OK) {
        source_close(&s);
        return report_error(&o.common, status, &error);
    }
    char large[256];
    int warn =
        large_move(s.model, "--by", hypot(hypot(o.by[0], o.by[1]), o.by[2]), large, sizeof large);
    source_print_warnings(&s, &o.common);
    if (warn) {
        (void)fprintf(stderr, "warning: %s\n", large);
    }
    if (o.common.json) {
        pal_model_info info;
        pal_model_get_info(s.model, &info);
        json_t *object = json_object(), *probes = json_object();
        json_object_set_new(object, "force", json_vector3(press.force));
        json_object_set_new(object, "moment", json_vector3(press.moment));
        json_object_set_new(object, "center", json_vector3(press.center));
        for (int32_t p = 0; p < info.probe_count; p++) {
            json_object_set_new(probes, pal_model_probe(s.model, p, NULL),
                                json_vector3(press.probe + 3 * p));
        }
        json_object_set_new(object, "probes", probes);
        json_object_set_new(object, "patch_nodes", json_integer(press.patch_nodes));
        json_object_set_new(object, "nodes", json_integer(info.node_count));
        json_object_set_new(object, "method", json_string(info.method));
        json_object_set_new(object, "certificate", json_certificate(&info.certificate));
        json_t *warnings = source_warnings_json(&s);
        if (warn) {
            json_array_append_new(warnings, json_string(large));
        }
        json_object_set_new(object, "warnings", warnings);
        print_json(object);
    } else {
        print_result(&s, &press, &o);
    }
    pal_press_clear(&press);
    source_close(&s);
    return 0;
}
