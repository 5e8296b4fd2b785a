/// Scenes: load, free, warn, and the accessors of scene.h.
#include <errno.h>
#include <locale.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "haptic/base/error.h"
#include "src/scene/scene_hash.h"
#include "src/scene/scene_schema.h"

char *pal_place_text(const pal_scene *scene, const pal_place *place, char *out, size_t size) {
    const pal_place nowhere = {0};
    if (place == NULL) {
        place = &nowhere;
    }
    const char *colon = place->key[0] != 0 ? ": " : "";
    if (place->set > 0 && place->set <= scene->override_count) {
        (void)snprintf(out, size, "--set %s%s%s", scene->override[place->set - 1], colon,
                       place->key);
    } else if (place->line > 0) {
        (void)snprintf(out, size, "%s:%d:%d%s%s", scene->shown, (int)place->line,
                       (int)place->column, colon, place->key);
    } else {
        (void)snprintf(out, size, "%s%s%s", scene->shown, colon, place->key);
    }
    return out;
}

pal_status pal_scene_warn(pal_scene *scene, const pal_place *place, const char *format, ...) {
    char where[1400];
    char text[600];
    va_list args;
    va_start(args, format);
    (void)vsnprintf(text, sizeof text, format, args);
    va_end(args);
    (void)pal_place_text(scene, place, where, sizeof where);
    size_t size = strlen(where) + strlen(text) + 3;
    char *line = malloc(size);
    char **grown = realloc(scene->warning, ((size_t)scene->warning_count + 1) * sizeof *grown);
    if (grown != NULL) {
        scene->warning = grown;
    }
    if (line == NULL || grown == NULL) {
        free(line);
        return PALPATE_ERROR_MEMORY;
    }
    (void)snprintf(line, size, "%s: %s", where, text);
    scene->warning[scene->warning_count++] = line;
    return PALPATE_OK;
}

void pal_scene_free(pal_scene *scene) {
    if (scene == NULL) {
        return;
    }
    for (int32_t i = 0; i < scene->patch_count; i++) {
        free(scene->patch[i].where.item);
    }
    for (int i = 0; i < scene->warning_count; i++) {
        free(scene->warning[i]);
    }
    for (int32_t i = 0; i < scene->override_count; i++) {
        free(scene->override[i]);
    }
    free(scene->patch);
    free(scene->warning);
    free(scene->override);
    free(scene->refine);
    free(scene->fixed.item);
    free(scene->touchable.item);
    free(scene->probe);
    free(scene->canonical);
    free(scene);
}

const pal_runtime_config *pal_scene_runtime(const pal_scene *scene) {
    return scene != NULL ? &scene->runtime : NULL;
}

int pal_scene_warning_count(const pal_scene *scene) {
    return scene != NULL ? scene->warning_count : 0;
}

const char *pal_scene_warning(const pal_scene *scene, int index) {
    return scene != NULL && index >= 0 && index < scene->warning_count ? scene->warning[index]
                                                                       : NULL;
}

/// The whole file in memory, at most PALPATE_SCENE_BYTES_MAX.
static pal_status read_file(const char *path, char **out, size_t *size, pal_error *error) {
    struct stat st;
    if (stat(path, &st) == 0 && !S_ISREG(st.st_mode)) {
        return pal_fail(error, PALPATE_ERROR_IO, "%.400s: not a regular file; give a scene file",
                        path);
    }
    FILE *file = fopen(path, "rb");
    if (file == NULL) {
        return pal_fail(error, errno == ENOMEM ? PALPATE_ERROR_MEMORY : PALPATE_ERROR_IO,
                        "%.400s: cannot be read (%s)", path, strerror(errno));
    }
    pal_status status = PALPATE_OK;
    char *text = malloc(PALPATE_SCENE_BYTES_MAX + 1);
    if (text == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "%.400s: out of memory", path);
    } else {
        *size = fread(text, 1, PALPATE_SCENE_BYTES_MAX + 1, file);
        if (ferror(file)) {
            status = pal_fail(error, PALPATE_ERROR_IO, "%.400s: cannot be read (%s)", path,
                              strerror(errno));
        } else if (*size > PALPATE_SCENE_BYTES_MAX) {
            status = pal_fail(error, PALPATE_ERROR_SCENE,
                              "%.400s: found more than 1 MiB; allowed: a scene of at most 1 MiB; "
                              "put surfaces into files of their own",
                              path);
        }
    }
    (void)fclose(file);
    if (status != PALPATE_OK) {
        free(text);
        return status;
    }
    *out = text;
    return PALPATE_OK;
}

/// Names that messages and relative paths need: as given, absolute, and the overrides.
static pal_status keep_names(pal_scene *scene, const char *path, const char *const overrides[],
                             int count, pal_error *error) {
    char *real = realpath(path, NULL);
    if (real == NULL) {
        return pal_fail(error, errno == ENOMEM ? PALPATE_ERROR_MEMORY : PALPATE_ERROR_IO,
                        "%.400s: cannot be read (%s)", path, strerror(errno));
    }
    int fits = strlen(real) < sizeof scene->path && strlen(path) < sizeof scene->shown;
    if (fits) {
        memcpy(scene->path, real, strlen(real) + 1);
        memcpy(scene->shown, path, strlen(path) + 1);
    }
    free(real);
    if (!fits) {
        return pal_fail(error, PALPATE_ERROR_IO, "%.400s: the path is longer than 1023 bytes",
                        path);
    }
    scene->override = count > 0 ? calloc((size_t)count, sizeof *scene->override) : NULL;
    for (int i = 0; i < count && scene->override != NULL; i++) {
        scene->override[i] = strdup(overrides[i]);
        if (scene->override[i] == NULL) {
            break;
        }
        scene->override_count = i + 1;
    }
    if (scene->override_count < count) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%.400s: out of memory", path);
    }
    return PALPATE_OK;
}

static pal_status load(pal_reading *r, const char *path, const char *const overrides[], int count) {
    pal_scene *scene = r->scene;
    pal_status status = keep_names(scene, path, overrides, count, r->error);
    if (status != PALPATE_OK) {
        return status;
    }
    r->tree.file = scene->shown;
    r->tree.override = (const char *const *)scene->override;
    r->tree.override_count = scene->override_count;
    char *text = NULL;
    size_t size = 0;
    status = read_file(path, &text, &size, r->error);
    if (status != PALPATE_OK) {
        return status;
    }
    pal_value *root = NULL;
    status = pal_yaml_parse(&r->tree, text, size, 0, &root, r->error);
    free(text);
    if (status == PALPATE_OK && pal_value_is_null(root)) {
        status = pal_fail(r->error, PALPATE_ERROR_SCENE,
                          "%.300s:1:1: found nothing; allowed: a scene; begin it with 'palpate: 1'",
                          path);
    }
    for (int i = 0; i < count && status == PALPATE_OK; i++) {
        status = pal_tree_set(&r->tree, root, i, pal_schema_is_list, r->error);
    }
    if (status == PALPATE_OK) {
        status = pal_scene_read(r, root);
    }
    if (status == PALPATE_OK) {
        status = pal_scene_write_canonical(scene, r->error);
    }
    return status;
}

pal_status pal_scene_load(const char *path, const char *const overrides[], int override_count,
                          pal_scene **out, pal_error *error) {
    if (out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_scene_load: out is NULL");
    }
    *out = NULL;
    if (path == NULL || override_count < 0 || (override_count > 0 && overrides == NULL)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_scene_load: no path or no overrides");
    }
    for (int i = 0; i < override_count; i++) {
        if (overrides[i] == NULL) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_scene_load: override %d is NULL",
                            i);
        }
    }
    // numbers are written with a point whatever the host's locale; this thread only
    locale_t c = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    pal_scene *scene = calloc(1, sizeof *scene);
    pal_status status = PALPATE_ERROR_MEMORY;
    if (c != (locale_t)0 && scene != NULL) {
        locale_t before = uselocale(c);
        pal_reading r = {.scene = scene, .error = error};
        status = load(&r, path, overrides, override_count);
        pal_tree_clear(&r.tree);
        (void)uselocale(before);
    } else {
        (void)pal_fail(error, status, "%.400s: out of memory", path);
    }
    if (c != (locale_t)0) {
        freelocale(c);
    }
    if (status != PALPATE_OK) {
        pal_scene_free(scene);
        return status;
    }
    *out = scene;
    return PALPATE_OK;
}
