/// @file obj_read.c  Vertices and faces of a Wavefront OBJ file, numbered as the file numbers them.
///
/// Assimp, which reads surfaces for the body, gives each corner of each face a vertex of its own
/// and does not tell which `v` line it came from; a host addresses its textures by that line. Of
/// the format only `v` and `f` matter here: "f a/b/c ..." with any of b and c left out, negative
/// numbers counted from the last vertex, a backslash at the end of a line continuing it. Polygons
/// become fans. Source: Wavefront, Advanced Visualizer manual, appendix B1 (1993). Thread: any.
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <errno.h>

#include "haptic/base/error.h"
#include "src/geometry/surface.h"

enum { COUNT_MAX = INT32_MAX / 8 };

typedef struct reading {
    pal_surface *out;
    size_t x_room, v_room; ///< numbers that fit
    long line;
    pal_error *error;
} reading;

static pal_status grow(reading *r, void **data, size_t *room, size_t needed, size_t element) {
    if (needed > 3 * (size_t)COUNT_MAX) {
        return pal_fail(r->error, PALPATE_ERROR_GEOMETRY,
                        "line %ld: more than %d vertices or triangles", r->line, COUNT_MAX);
    }
    if (needed > *room) {
        size_t larger = 2 * needed + 1024;
        void *grown = realloc(*data, larger * element);
        if (grown == NULL) {
            return pal_fail(r->error, PALPATE_ERROR_MEMORY, "no memory for %zu numbers", larger);
        }
        *data = grown;
        *room = larger;
    }
    return PALPATE_OK;
}

static pal_status read_vertex(reading *r, const char *p) {
    pal_surface *s = r->out;
    size_t at = 3 * (size_t)s->vertex_count;
    void *data = s->x;
    pal_status status = grow(r, &data, &r->x_room, at + 3, sizeof *s->x);
    s->x = data;
    for (size_t d = 0; status == PALPATE_OK && d < 3; d++) {
        char *end;
        s->x[at + d] = strtod(p, &end);
        if (end == p || !isfinite(s->x[at + d])) {
            return pal_fail(r->error, PALPATE_ERROR_GEOMETRY,
                            "line %ld: a vertex needs three finite coordinates", r->line);
        }
        p = end;
    }
    s->vertex_count += status == PALPATE_OK;
    return status;
}

static pal_status read_face(reading *r, const char *p) {
    pal_surface *s = r->out;
    int32_t first = -1, last = -1;
    for (;;) {
        char *end;
        errno = 0;
        long n = strtol(p, &end, 10);
        if (end == p) {
            return PALPATE_OK; // points and lines have fewer than three corners: no triangle
        }
        n = n < 0 ? s->vertex_count + n : n - 1;
        if (errno != 0 || n < 0 || n >= COUNT_MAX) {
            return pal_fail(r->error, PALPATE_ERROR_GEOMETRY,
                            "line %ld: a face names a vertex that is not there", r->line);
        }
        p = end + strcspn(end, " \t\r\n");
        int32_t corner = (int32_t)n;
        if (first >= 0 && last >= 0) {
            size_t at = 3 * (size_t)s->triangle_count;
            void *data = s->v;
            pal_status status = grow(r, &data, &r->v_room, at + 3, sizeof *s->v);
            s->v = data;
            if (status != PALPATE_OK) {
                return status;
            }
            s->v[at] = first;
            s->v[at + 1] = last;
            s->v[at + 2] = corner;
            s->triangle_count++;
        }
        last = first < 0 ? -1 : corner;
        first = first < 0 ? corner : first;
    }
}

/// The next line without its end, continued lines joined. @return 1; 0 at the end of the file, -1:
/// memory
static int next_line(reading *r, FILE *in, char **line, size_t *room, char **more,
                     size_t *more_room) {
    ssize_t n = getline(line, room, in);
    r->line++;
    while (n >= 0) {
        while (n > 0 && ((*line)[n - 1] == '\n' || (*line)[n - 1] == '\r')) {
            (*line)[--n] = '\0';
        }
        if (n == 0 || (*line)[n - 1] != '\\') {
            return 1;
        }
        (*line)[--n] = '\0';
        ssize_t m = getline(more, more_room, in);
        if (m < 0) {
            return ferror(in) || errno == ENOMEM ? -1 : 1;
        }
        r->line++;
        if (*room < (size_t)n + (size_t)m + 1) {
            char *grown = realloc(*line, (size_t)n + (size_t)m + 1);
            if (grown == NULL) {
                return -1;
            }
            *line = grown;
            *room = (size_t)n + (size_t)m + 1;
        }
        memcpy(*line + n, *more, (size_t)m + 1);
        n += m;
    }
    return feof(in) ? 0 : -1;
}

static pal_status read_lines(reading *r, FILE *in) {
    char *line = NULL, *more = NULL;
    size_t room = 0, more_room = 0;
    pal_status status = PALPATE_OK;
    int got = 0;
    errno = 0;
    while (status == PALPATE_OK && (got = next_line(r, in, &line, &room, &more, &more_room)) > 0) {
        const char *p = line + strspn(line, " \t");
        if (p[0] == 'v' && (p[1] == ' ' || p[1] == '\t')) {
            status = read_vertex(r, p + 1);
        } else if (p[0] == 'f' && (p[1] == ' ' || p[1] == '\t')) {
            status = read_face(r, p + 1);
        }
    }
    if (status == PALPATE_OK && got < 0) {
        status =
            ferror(in)
                ? pal_fail(r->error, PALPATE_ERROR_IO, "line %ld: %s", r->line, strerror(errno))
                : pal_fail(r->error, PALPATE_ERROR_MEMORY, "no memory for line %ld", r->line);
    }
    free(line);
    free(more);
    return status;
}

pal_status pal_obj_read(const char *path, pal_surface *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    FILE *in = fopen(path, "rb");
    if (in == NULL) {
        return pal_fail(error, errno == ENOMEM ? PALPATE_ERROR_MEMORY : PALPATE_ERROR_IO, "%s: %s",
                        path, strerror(errno));
    }
    reading r = {.out = out, .error = error};
    locale_t c =
        newlocale(LC_ALL_MASK, "C", (locale_t)0); // 0.5 is 0.5 whatever the host's language
    pal_status status = PALPATE_ERROR_MEMORY;
    if (c == (locale_t)0) {
        (void)pal_fail(error, status, "no memory");
    } else {
        locale_t before = uselocale(c);
        status = read_lines(&r, in);
        (void)uselocale(before);
        freelocale(c);
    }
    (void)fclose(in);
    if (status == PALPATE_OK && out->triangle_count == 0) {
        status = pal_fail(error, PALPATE_ERROR_GEOMETRY, "it holds no triangle");
    }
    for (size_t i = 0; status == PALPATE_OK && i < 3 * (size_t)out->triangle_count; i++) {
        if (out->v[i] >= out->vertex_count) {
            status = pal_fail(error, PALPATE_ERROR_GEOMETRY, "a face names vertex %d, there are %d",
                              (int)out->v[i] + 1, (int)out->vertex_count);
        }
    }
    if (status != PALPATE_OK) {
        pal_surface_clear(out);
        return pal_fail_prefix(error, status, "%s", path);
    }
    return PALPATE_OK;
}
