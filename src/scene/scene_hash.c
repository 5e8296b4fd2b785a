/// Canonical text and content hash of a scene.
///
/// The hash names a cached model, so it covers all that determines one: the canonical text
/// (defaults filled in, numbers by value and not by spelling), the surface and skin files' content
/// (not their paths), the program's version and a digest of the sources that build models. Tools
/// and rates are not part of it.
#include <errno.h>
#include <fcntl.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/base/hash.h"
#include "src/scene/scene_hash.h"

/// Raise it when the same scene gives a different model (cloud, discretization, solution, storage).
#define PALPATE_PHYSICS_REVISION 4
/// Digest of the offline library's and the mesher's sources, from the Makefile: a revision that has
/// to be raised by hand is forgotten, and then the old model answers out of the cache.
#ifndef PALPATE_SOURCES_DIGEST
#define PALPATE_SOURCES_DIGEST "unknown"
#endif

/// Text that grows; once an allocation has failed nothing more is written.
typedef struct text {
    char *start;
    size_t size, room;
    int failed;
} text;

static void put(text *t, const char *format, ...) __attribute__((format(printf, 2, 3)));

static void put(text *t, const char *format, ...) {
    char line[512]; // the longest line has 17 digits of nine numbers
    va_list args;
    va_start(args, format);
    int n = vsnprintf(line, sizeof line, format, args);
    va_end(args);
    if (n < 0 || (size_t)n >= sizeof line) {
        t->failed = 1;
    }
    if (!t->failed && t->size + (size_t)n + 1 > t->room) {
        size_t room = 2 * t->room + sizeof line;
        char *grown = realloc(t->start, room);
        t->failed = grown == NULL;
        if (grown != NULL) {
            t->start = grown;
            t->room = room;
        }
    }
    if (!t->failed) {
        memcpy(t->start + t->size, line, (size_t)n + 1);
        t->size += (size_t)n;
    }
}

static void vector(text *f, const char *name, const double v[3]) {
    put(f, "%s%.17g %.17g %.17g\n", name, v[0], v[1], v[2]);
}

static void selectors(text *f, const char *name, const pal_selector_list *list) {
    put(f, "%s %d\n", name, (int)list->count);
    for (int32_t i = 0; i < list->count; i++) {
        const pal_selector *s = &list->item[i];
        switch (s->kind) {
        case PALPATE_SELECT_ALL:
            put(f, "  all\n");
            break;
        case PALPATE_SELECT_BALL:
            put(f, "  ball %.17g ", s->radius);
            vector(f, "", s->center);
            break;
        case PALPATE_SELECT_BOX:
            vector(f, "  box ", s->low);
            vector(f, "   to ", s->high);
            break;
        case PALPATE_SELECT_BELOW:
        case PALPATE_SELECT_ABOVE:
            put(f, "  %s %c %.17g\n", s->kind == PALPATE_SELECT_BELOW ? "below" : "above",
                "xyz"[s->axis], s -> value);
            break;
        }
    }
}

static void geometry(text *f, const pal_geometry *g) {
    switch (g->kind) {
    case PALPATE_GEOMETRY_BOX:
        vector(f, "geometry box ", g->size);
        vector(f, "  center ", g->center);
        break;
    case PALPATE_GEOMETRY_SPHERE:
        put(f, "geometry sphere %.17g\n", g->radius);
        vector(f, "  center ", g->center);
        break;
    case PALPATE_GEOMETRY_HEMISPHERE:
        put(f, "geometry hemisphere %.17g\n", g->radius);
        break;
    case PALPATE_GEOMETRY_FILE:
        put(f, "geometry file scale %.17g\n", g->scale);
        break;
    }
}

static void body(text *f, const pal_scene *scene) {
    geometry(f, &scene->geometry);
    put(f, "spacing %.17g\ngrading %.17g\n", scene->spacing, scene->grading);
    for (int32_t i = 0; i < scene->refine_count; i++) {
        const pal_refine *z = &scene->refine[i];
        if (z->kind == PALPATE_REFINE_RIM) {
            put(f, "refine %.17g rim %s\n", z->spacing, z->rim);
        } else {
            put(f, "refine %.17g ball %.17g ", z->spacing, z->radius);
            vector(f, "", z->center);
        }
    }
    put(f, "young %.17g\npoisson %.17g\ndensity %.17g\n", scene->young, scene->poisson,
        scene->density);
    selectors(f, "fixed", &scene->fixed);
    selectors(f, "touchable", &scene->touchable);
    for (int32_t i = 0; i < scene->patch_count; i++) {
        const pal_scene_patch *p = &scene->patch[i];
        put(f, "patch %s rim_spacing %.17g ", p->name, p->rim_spacing);
        selectors(f, "", &p->where);
    }
    for (int32_t i = 0; i < scene->probe_count; i++) {
        put(f, "probe %s ", scene->probe[i].name);
        vector(f, "", scene->probe[i].position);
    }
}

pal_status pal_scene_write_canonical(pal_scene *scene, pal_error *error) {
    text out = {0};
    text *f = &out;
    const pal_method *m = &scene->method;
    put(f, "palpate %d\n", (int)scene->version);
    body(f, scene);
    put(f,
        "method %d basis %d derivatives %d neighbours %d exponent %d fictitious %d "
        "volumetric %d form %d stabilization %.17g integration %d\n",
        (int)m->kind, (int)m->basis, (int)m->derivatives, (int)m->neighbours, (int)m->exponent,
        (int)m->fictitious, (int)m->volumetric, (int)m->form, m->stabilization,
        (int)m->integration);
    put(f, "estimate %d\nrepair %d\ncertify %d\nstore %d precision %d tolerance %.17g\n",
        (int)scene->estimate, (int)scene->symmetrize, (int)scene->certify_warn,
        (int)scene->store_rows, (int)scene->precision, scene->store_tolerance);
    if (scene->skin.path[0] != '\0') {
        put(f, "skin scale %.17g\n", scene->skin.scale);
    }
    if (out.failed) {
        free(out.start);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%.300s: out of memory", scene->shown);
    }
    free(scene->canonical);
    scene->canonical = out.start;
    return PALPATE_OK;
}

/// Add a file's content to a hash.
static pal_status hash_file(pal_hash *hash, const pal_scene *scene, const char *path,
                            const pal_place *place, pal_error *error) {
    char where[1400];
    (void)pal_place_text(scene, place, where, sizeof where);
    // opened without waiting: a pipe's other end may never come
    struct stat found;
    int fd = open(path, O_RDONLY | O_NONBLOCK | O_CLOEXEC);
    if (fd >= 0 && fstat(fd, &found) == 0 && !S_ISREG(found.st_mode)) {
        (void)close(fd);
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%.300s: %.400s is %s; give an STL, OBJ or PLY file", where, path,
                        S_ISDIR(found.st_mode) ? "a folder" : "not a regular file");
    }
    FILE *file = fd >= 0 ? fdopen(fd, "rb") : NULL;
    if (file == NULL) {
        if (fd >= 0) {
            (void)close(fd);
        }
        return pal_fail(error, errno == ENOMEM ? PALPATE_ERROR_MEMORY : PALPATE_ERROR_IO,
                        "%.300s: %.400s cannot be read (%s)", where, path, strerror(errno));
    }
    unsigned char buffer[8192];
    size_t n;
    while ((n = fread(buffer, 1, sizeof buffer, file)) > 0) {
        pal_hash_update(hash, buffer, n);
    }
    int bad = ferror(file);
    (void)fclose(file);
    if (bad) {
        return pal_fail(error, PALPATE_ERROR_IO, "%.300s: %.400s cannot be read", where, path);
    }
    return PALPATE_OK;
}

pal_status pal_scene_hash(const pal_scene *scene, char hex[65], pal_error *error) {
    if (scene == NULL || hex == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_scene_hash: scene or hex is NULL");
    }
    char head[200];
    (void)snprintf(head, sizeof head, "palpate %s physics %d sources %s\n", pal_version(),
                   PALPATE_PHYSICS_REVISION, PALPATE_SOURCES_DIGEST);
    pal_hash hash;
    uint8_t digest[PALPATE_HASH_BYTES];
    pal_hash_init(&hash, PALPATE_HASH_BYTES);
    pal_hash_update(&hash, head, strlen(head));
    pal_hash_update(&hash, scene->canonical, strlen(scene->canonical) + 1);
    if (scene->geometry.kind == PALPATE_GEOMETRY_FILE) {
        pal_status status =
            hash_file(&hash, scene, scene->geometry.path, &scene->geometry.place, error);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    if (scene->skin.path[0] != '\0') {
        const char *dot = strrchr(scene->skin.path, '.'); // the extension chooses the reader
        pal_hash_update(&hash, dot != NULL ? dot : "", dot != NULL ? strlen(dot) + 1 : 1);
        pal_status status = hash_file(&hash, scene, scene->skin.path, &scene->skin.place, error);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    pal_hash_final(&hash, digest);
    pal_hash_to_hex(digest, PALPATE_HASH_BYTES, hex);
    return PALPATE_OK;
}
