/// @file command_precompute.c  palpate precompute SCENE [-o MODEL]
#include "haptic/program/budget.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/program/targets.h"

enum { ROUNDS_MAX = 6 };

typedef struct options {
    common_options common;
    const char *scene;
    const char *output;
    int rebuild;
    double target; ///< of the estimated error; 0: none
    budget budget;
    int has_budget;
} options;

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    case 'o':
        o->output = arg;
        return 0;
    case 'r':
        o->rebuild = 1;
        return 0;
    case 't':
        if (parse_numbers(arg, &o->target, 1) != 1 || !(o->target >= 1e-4 && o->target <= 1.0)) {
            argp_error(state, "--target-error %s: a relative error from 0.0001 to 1, e.g. 0.03",
                       arg);
        }
        return 0;
    case 'b':
        o->has_budget = budget_parse(arg, &o->budget);
        if (!o->has_budget) {
            argp_error(
                state,
                "--budget %s: a time per tick (300us, 0.3ms), bytes (200MB) or an error (2%%)",
                arg);
        }
        return 0;
    default:
        return parse_path(key, arg, state, &o->scene, "SCENE",
                          "e.g. palpate precompute scenes/hemisphere.yaml");
    }
}

static const struct argp_option list[] = {
    {"output", 'o', "MODEL", 0, "Write the model file here as well (default: only the cache)", 1},
    {"target-error", 't', "E", 0,
     "Refine all spacings until the estimated error of the patches' forces is at most E (e.g. "
     "0.03)",
     1},
    {"budget", 'b', "B", 0,
     "Pick method, spacing, stored rows, precision and who computes the field so that a tick "
     "(300us), the "
     "model (200MB) or its error (2%) keeps to B; may be given once of each kind. Of all that is "
     "predicted to keep to it, it takes " BUDGET_RULE "; with an error alone, " BUDGET_RULE_ERROR,
     1},
    {"rebuild", 'r', NULL, 0, "Build even when the cache has the model", 1},
    {0}};
static const char doc[] =
    "Build and certify the model of a scene.\v"
    "The stages: node cloud (Gmsh), moving-least-squares stencils and assembly, sparse "
    "factorization, "
    "one solve per touchable degree of freedom, certificate. The model is kept in the cache "
    "directory "
    "($PALPATE_CACHE, else $XDG_CACHE_HOME/palpate, else ~/.cache/palpate) under a hash of all "
    "that "
    "determines it: any change of physics rebuilds, nothing else does. A model that fails its "
    "certificate is not written unless the scene says `certify: warn`.\n\n"
    "Example:\n  palpate precompute scenes/hemisphere.yaml -o hemisphere.palpate \\\n"
    "    --set body.material.poisson=0.45\n"
    "  palpate precompute scenes/organ.yaml --budget 300us --budget 200MB";

/// Refine until the estimate meets the target. The error goes with the spacing, which sets the
/// steps.
static pal_status refine(source *s, options *o, pal_error *error) {
    const offline_api *offline = offline_open(error);
    for (int round = 0;; round++) {
        pal_model_info info;
        pal_model_get_info(s->model, &info);
        double estimate = info.certificate.estimated_error;
        if (estimate < 0.0) {
            return pal_fail(error, PALPATE_ERROR_SCENE,
                            "--target-error: nothing was estimated: the scene needs body.patches "
                            "and estimate: true");
        }
        if (!o->common.quiet) {
            (void)fprintf(stderr, "round %d: %d nodes, estimated error %.2f %% (target %.2f %%)\n",
                          round + 1, info.node_count, 100.0 * estimate, 100.0 * o->target);
        }
        if (estimate <= o->target) {
            return PALPATE_OK;
        }
        if (round == ROUNDS_MAX) {
            return pal_fail(
                error, PALPATE_ERROR_CERTIFICATE,
                "--target-error %g: still %.2g after %d refinements (%d nodes): ask for less",
                o->target, estimate, ROUNDS_MAX, info.node_count);
        }
        double factor = fmin(0.9, fmax(0.6, 0.9 * o->target / estimate));
        pal_model_free(s->model);
        s->model = NULL;
        pal_status status = offline->scene_scale_spacing(s->scene, factor, error);
        pal_progress progress = progress_line(&o->common);
        if (status == PALPATE_OK) {
            status =
                offline->precompute_cached(s->scene, &progress, &s->model, &s->was_cached, error);
        }
        progress_end();
        if (status != PALPATE_OK) {
            return status;
        }
    }
}

int command_precompute(int argc, char **argv) {
    options o = {.common = {.command = "palpate precompute"}};
    const struct argp_child children[] = {{&common_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {list, parse, "SCENE", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    source s = {0};
    interrupt_install();
    pal_status status = source_must_be_scene(o.scene, &error);
    if (status == PALPATE_OK) {
        status = target_check("--output", o.output, NULL, o.scene, &error);
    }
    const offline_api *offline = status == PALPATE_OK ? offline_open(&error) : NULL;
    if (offline == NULL) {
        return report_error(&o.common, status == PALPATE_OK ? PALPATE_ERROR_SYSTEM : status,
                            &error);
    }
    if (o.rebuild) {
        status = offline->scene_load(o.scene, o.common.overrides, o.common.override_count, &s.scene,
                                     &error);
        char path[4096];
        if (status == PALPATE_OK &&
            offline->cache_path(s.scene, path, sizeof path, NULL) == PALPATE_OK) {
            (void)remove(path);
        }
        source_close(&s);
        if (status != PALPATE_OK) {
            return report_error(&o.common, status, &error);
        }
    }
    json_t *account = NULL;
    if (o.has_budget) {
        status = budget_build(o.scene, &o.budget, &o.common, &s, &account, &error);
    } else {
        status = source_open(o.scene, &o.common, 0, &s, &error);
    }
    if (status == PALPATE_OK && o.target > 0.0) {
        status = refine(&s, &o, &error);
    }
    if (status == PALPATE_OK && o.output != NULL) {
        status = pal_model_save(s.model, o.output, &error);
    }
    if (status != PALPATE_OK) {
        json_decref(account);
        source_close(&s);
        return report_error(&o.common, status, &error);
    }
    source_print_warnings(&s, &o.common);
    char cached[4096] = "";
    (void)offline->cache_path(s.scene, cached, sizeof cached, NULL);
    const char *path = o.output != NULL ? o.output : cached;
    if (o.common.json) {
        json_t *object = json_info(s.model);
        json_object_set_new(object, "model", json_text(path));
        json_object_set_new(object, "cached", json_boolean(s.was_cached));
        json_object_set_new(object, "warnings", source_warnings_json(&s));
        if (account != NULL) {
            json_object_set(object, "budget", account);
        }
        print_json(object);
    } else {
        print_info(s.model);
        if (account != NULL) {
            budget_print(account);
        }
        (void)printf("model          %s%s\n", path, s.was_cached ? " (was in the cache)" : "");
    }
    json_decref(account);
    source_close(&s);
    return 0;
}
