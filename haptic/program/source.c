/// @file source.c  SCENE or MODEL: what the commands work on.
#include "haptic/program/program.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>

#include "haptic/base/error.h"

/// A scene is text; a model file has zero bytes in its first block.
static pal_status is_model_file(const char *path, int *model, pal_error *error) {
    char head[512];
    FILE *f = fopen(path, "rbe");
    if (f == NULL) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: cannot be opened: %s", path, strerror(errno));
    }
    size_t n = fread(head, 1, sizeof head, f);
    int failed = ferror(f);
    (void)fclose(f);
    if (failed) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: cannot be read (is it a directory?)", path);
    }
    *model = memchr(head, 0, n) != NULL;
    return PALPATE_OK;
}

static pal_status open_scene(const char *path, const common_options *options, int allow_failing,
                             source *out, pal_error *error) {
    const offline_api *offline = offline_open(error);
    if (offline == NULL) {
        return PALPATE_ERROR_SYSTEM;
    }
    pal_status status =
        offline->scene_load(path, options->overrides, options->override_count, &out->scene, error);
    if (status != PALPATE_OK) {
        return status;
    }
    pal_progress progress = progress_line(options);
    status =
        offline->precompute_cached(out->scene, &progress, &out->model, &out->was_cached, error);
    progress_end();
    if (status == PALPATE_ERROR_CERTIFICATE && allow_failing && out->model != NULL) {
        out->passed = 0;
        if (error != NULL) {
            (void)snprintf(out->certificate_message, sizeof out->certificate_message, "%s",
                           error->message);
        }
        return PALPATE_OK;
    }
    return status;
}

pal_status source_open(const char *path, const common_options *options, int allow_failing,
                       source *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    out->passed = 1;
    int model = 0;
    pal_status status = is_model_file(path, &model, error);
    if (status == PALPATE_OK && !model) {
        status = open_scene(path, options, allow_failing, out, error);
    } else if (status == PALPATE_OK) {
        if (options->override_count > 0) {
            status = pal_fail(error, PALPATE_ERROR_ARGUMENT,
                              "%s: --set %s: a model is fixed once built; give the scene instead",
                              path, options->overrides[0]);
        } else {
            status = pal_model_load(path, &out->model, error);
        }
    }
    if (status == PALPATE_OK && out->passed) {
        pal_model_info info;
        pal_model_get_info(out->model, &info);
        out->passed = info.certificate.pass;
        (void)snprintf(out->certificate_message, sizeof out->certificate_message,
                       "the model does not pass its certificate: %s", info.certificate.reason);
    }
    if (status != PALPATE_OK) {
        source_close(out);
    }
    return status;
}

void source_close(source *s) {
    pal_model_free(s->model);
    if (s->scene != NULL) {
        offline_open(NULL)->scene_free(s->scene);
    }
    s->model = NULL;
    s->scene = NULL;
}

void source_print_warnings(const source *s, const common_options *options) {
    int count = s->scene == NULL ? 0 : offline_open(NULL)->scene_warning_count(s->scene);
    for (int i = 0; i < count && !options->quiet; i++) {
        (void)fprintf(stderr, "warning: %s\n", offline_open(NULL)->scene_warning(s->scene, i));
    }
    if (!s->passed) {
        (void)fprintf(stderr, "warning: %s\n", s->certificate_message);
    }
}

json_t *source_warnings_json(const source *s) {
    json_t *list = json_array();
    int count = s->scene == NULL ? 0 : offline_open(NULL)->scene_warning_count(s->scene);
    for (int i = 0; i < count; i++) {
        json_array_append_new(list, json_string(offline_open(NULL)->scene_warning(s->scene, i)));
    }
    if (!s->passed) {
        json_array_append_new(list, json_string(s->certificate_message));
    }
    return list;
}
