/// @file source.c  SCENE or MODEL: what the commands work on.
#include "haptic/program/program.h"

#include <errno.h>
#include <fcntl.h>
#include <stdint.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "haptic/base/error.h"

/// What a file holds that is neither a scene nor a model, and what to do with it.
typedef struct mistaken {
    const char *what, *remedy;
} mistaken;
static const mistaken surface = {"a surface, not a scene",
                                 "name it in a scene (body.geometry.file), with spacing, material "
                                 "and supports: scenes/organ.yaml "
                                 "is one to start from"};
static const mistaken trajectory = {"a trajectory, not a scene",
                                    "name it in a scene: tools, device: {replay: FILE}"};
static const mistaken companion = {"the companion of a recording, for ParaView",
                                   "give the scene or the model"};
static const mistaken picture = {"a picture", "give the scene or the model"};

/// Ends `name` in `ending`, in capitals or not?
static int ends_in(const char *name, const char *ending) {
    size_t n = strlen(name), k = strlen(ending);
    return n > k && strcasecmp(name + n - k, ending) == 0;
}

/// The first line that is no comment of a Wavefront OBJ: a keyword and a space, never a colon.
static int is_obj(const char *text, size_t size) {
    static const char *const keyword[] = {"v ", "vn ", "vt ",     "o ",
                                          "g ", "s ",  "mtllib ", "usemtl "};
    for (size_t i = 0; i < size;) {
        const char *line = text + i;
        const char *end = memchr(line, '\n', size - i);
        size_t length = end != NULL ? (size_t)(end - line) : size - i;
        i += length + 1;
        if (length == 0 || line[0] == '#' || line[0] == '\r') {
            continue;
        }
        for (size_t k = 0; k < sizeof keyword / sizeof *keyword; k++) {
            size_t n = strlen(keyword[k]);
            if (length >= n && memcmp(line, keyword[k], n) == 0) {
                return memchr(line, ':', length) == NULL;
            }
        }
        return 0;
    }
    return 0;
}

/// @param size  bytes of the file, of which `have` are in head. @return NULL: a scene or a model
static const mistaken *recognise(const char *path, const char *head, size_t have, off_t size) {
    static const struct {
        const char *start;
        const mistaken *is;
    } known[] = {{"ply\n", &surface},   {"ply\r", &surface},   {"solid ", &surface},
                 {"<?xml", &companion}, {"\x89PNG", &picture}, {"GIF8", &picture},
                 {"time,", &trajectory}};
    for (size_t k = 0; k < sizeof known / sizeof *known; k++) {
        size_t n = strlen(known[k].start);
        if (have >= n && memcmp(head, known[k].start, n) == 0) {
            return known[k].is;
        }
    }
    uint32_t triangles = 0; // binary STL: 80 bytes, the number of triangles, 50 bytes each
    if (have > 84) {
        memcpy(&triangles, head + 80, sizeof triangles);
        if (size == 84 + 50 * (off_t)triangles) {
            return &surface;
        }
    }
    if (have > 0 && (ends_in(path, ".obj") || ends_in(path, ".stl") || ends_in(path, ".ply") ||
                     is_obj(head, have))) {
        return &surface;
    }
    return ends_in(path, ".csv") ? &trajectory : NULL;
}

/// A scene is text; a model file has zero bytes in its first block.
static pal_status is_model_file(const char *path, int *model, pal_error *error) {
    char head[4096];
    struct stat found;
    if (path[0] == '\0') {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "'': not the name of a scene or a model");
    }
    // opened without waiting: a pipe's other end may never come
    int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd < 0 || fstat(fd, &found) != 0) {
        int why = errno;
        if (fd >= 0) {
            (void)close(fd);
        }
        return pal_fail(error, PALPATE_ERROR_IO, "%.500s: cannot be opened: %s", path,
                        strerror(why));
    }
    if (!S_ISREG(found.st_mode)) {
        (void)close(fd);
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s: %s; give the file of a scene (YAML) or of a model", path,
                        S_ISDIR(found.st_mode) ? "a folder" : "not a regular file");
    }
    ssize_t n = read(fd, head, sizeof head);
    int why = errno;
    (void)close(fd);
    if (n < 0) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: cannot be read: %s", path, strerror(why));
    }
    const mistaken *other = recognise(path, head, (size_t)n, found.st_size);
    if (other != NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "%s: %s; %s", path, other->what,
                        other->remedy);
    }
    *model = memchr(head, 0, n < 512 ? (size_t)n : 512) != NULL;
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

pal_status source_must_be_scene(const char *path, pal_error *error) {
    int model = 0;
    pal_status status = is_model_file(path, &model, error);
    return status == PALPATE_OK && model
               ? pal_fail(error, PALPATE_ERROR_ARGUMENT,
                          "%s: no scene but a model, or another binary file; a model is built "
                          "already, `palpate info` shows it",
                          path)
               : status;
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

/// Is it one of the scene's own warnings, that is, was the model built just now?
static int scene_warns(const source *s, const char *text) {
    int count = s->scene == NULL ? 0 : offline_open(NULL)->scene_warning_count(s->scene);
    for (int i = 0; i < count; i++) {
        if (strcmp(text, offline_open(NULL)->scene_warning(s->scene, i)) == 0) {
            return 1;
        }
    }
    return 0;
}

json_t *source_warnings_json(const source *s) {
    json_t *list = json_array();
    int count = s->scene == NULL ? 0 : offline_open(NULL)->scene_warning_count(s->scene);
    for (int i = 0; i < count; i++) {
        json_array_append_new(list, json_text(offline_open(NULL)->scene_warning(s->scene, i)));
    }
    // what was warned of when the model was built, perhaps long ago
    pal_model_info info = {0};
    if (s->model != NULL) {
        pal_model_get_info(s->model, &info);
    }
    char *rest = info.warnings;
    for (char *line; (line = strtok_r(rest, "\n", &rest)) != NULL;) {
        if (!scene_warns(s, line)) {
            json_array_append_new(list, json_text(line));
        }
    }
    if (!s->passed) {
        json_array_append_new(list, json_text(s->certificate_message));
    }
    return list;
}

void source_print_warnings(const source *s, const common_options *options) {
    json_t *list = source_warnings_json(s);
    for (size_t i = 0; i < json_array_size(list) && !options->quiet; i++) {
        (void)fprintf(stderr, "warning: %s\n", json_string_value(json_array_get(list, i)));
    }
    if (!s->passed && options->quiet) { // never silent
        (void)fprintf(stderr, "warning: %s\n", s->certificate_message);
    }
    json_decref(list);
}
