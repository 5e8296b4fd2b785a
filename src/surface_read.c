/// @file surface_read.c  Surface files through Assimp (the only file that includes it), welded.
///
/// Assimp keeps coordinates in single precision and gives every (position, normal, texture) triple its
/// own vertex, STL even every corner: vertices closer than 1e-6 of the extent are one. Thread: any.
#include <assimp/cimport.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <unistd.h>

#include "haptic/error.h"
#include "src/surface.h"
#include "src/vec.h"

static const double WELD = 1e-6;

typedef struct sorted {
    double x;
    int32_t vertex;
} sorted;

static int sorted_compare(const void *pa, const void *pb) {
    const sorted *a = pa, *b = pb;
    if (a->x != b->x) {
        return a->x < b->x ? -1 : 1;
    }
    return (a->vertex > b->vertex) - (a->vertex < b->vertex);
}

void pal_surface_clear(pal_surface *s) {
    free(s->x);
    free(s->v);
    memset(s, 0, sizeof *s);
}

/// Count what a scene holds. @return 0 when a count does not fit
static int count_scene(const struct aiScene *scene, size_t *vertices, size_t *triangles) {
    *vertices = *triangles = 0;
    for (unsigned i = 0; i < scene->mNumMeshes; i++) {
        const struct aiMesh *mesh = scene->mMeshes[i];
        *vertices += mesh->mNumVertices;
        for (unsigned f = 0; f < mesh->mNumFaces; f++) {
            *triangles += mesh->mFaces[f].mNumIndices == 3;
        }
    }
    return *vertices < INT32_MAX / 8 && *triangles < INT32_MAX / 8;
}

static pal_status copy_scene(const struct aiScene *scene, pal_surface *out, pal_error *error) {
    size_t vertices, triangles, vertex = 0, triangle = 0;
    if (!count_scene(scene, &vertices, &triangles) || triangles == 0) {
        return pal_fail(error, PALPATE_ERROR_GEOMETRY, triangles == 0
                                                           ? "it holds no triangle"
                                                           : "it holds too many triangles");
    }
    out->x = malloc(3 * vertices * sizeof *out->x);
    out->v = malloc(3 * triangles * sizeof *out->v);
    if (out->x == NULL || out->v == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for %zu triangles", triangles);
    }
    for (unsigned i = 0; i < scene->mNumMeshes; i++) {
        const struct aiMesh *mesh = scene->mMeshes[i];
        for (unsigned f = 0; f < mesh->mNumFaces; f++) {
            if (mesh->mFaces[f].mNumIndices != 3) {
                continue; // points and lines
            }
            for (int k = 0; k < 3; k++) {
                unsigned index = mesh->mFaces[f].mIndices[k];
                if (index >= mesh->mNumVertices) {
                    return pal_fail(error, PALPATE_ERROR_GEOMETRY,
                                    "triangle %zu names vertex %u, there are %u", triangle, index,
                                    mesh->mNumVertices);
                }
                out->v[3 * triangle + (size_t)k] = (int32_t)(vertex + index);
            }
            triangle++;
        }
        for (unsigned k = 0; k < mesh->mNumVertices; k++, vertex++) {
            const struct aiVector3D *p = mesh->mVertices + k;
            const double x[3] = {(double)p->x, (double)p->y, (double)p->z};
            if (!isfinite(x[0]) || !isfinite(x[1]) || !isfinite(x[2])) {
                return pal_fail(error, PALPATE_ERROR_GEOMETRY,
                                "vertex %zu of part %u has a coordinate that is not a finite number",
                                (size_t)k + 1, i + 1);
            }
            v3_copy(x, out->x + 3 * vertex);
        }
    }
    out->vertex_count = (int32_t)vertices;
    out->triangle_count = (int32_t)triangles;
    return PALPATE_OK;
}

pal_status pal_surface_twins(const pal_surface *s, int32_t *same, pal_error *error) {
    size_t n = (size_t)s->vertex_count;
    sorted *order = malloc(n * sizeof *order);
    if (order == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to weld %zu vertices", n);
    }
    double extent = 0.0;
    for (int c = 0; c < 3; c++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (size_t i = 0; i < n; i++) {
            low = fmin(low, s->x[3 * i + (size_t)c]);
            high = fmax(high, s->x[3 * i + (size_t)c]);
        }
        extent = fmax(extent, high - low);
    }
    for (size_t i = 0; i < n; i++) {
        order[i] = (sorted){s->x[3 * i], (int32_t)i};
        same[i] = (int32_t)i;
    }
    qsort(order, n, sizeof *order, sorted_compare);
    for (size_t i = 0; i < n; i++) {
        int32_t a = order[i].vertex;
        if (same[a] != a) {
            continue;
        }
        for (size_t j = i + 1; j < n && order[j].x - order[i].x <= WELD * extent; j++) {
            int32_t b = order[j].vertex;
            if (same[b] == b &&
                v3_distance(s->x + 3 * (size_t)a, s->x + 3 * (size_t)b) <= WELD * extent) {
                same[b] = a;
            }
        }
    }
    free(order);
    return PALPATE_OK;
}

/// Give vertices at the same place one number, in the order of first use; drop unused ones.
static pal_status weld(pal_surface *s, pal_error *error) {
    size_t n = (size_t)s->vertex_count;
    int32_t *same = malloc(n * sizeof *same);
    int32_t *number = malloc(n * sizeof *number);
    double *x = malloc(3 * n * sizeof *x);
    if (same == NULL || number == NULL || x == NULL) {
        free(same);
        free(number);
        free(x);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to weld %zu vertices", n);
    }
    pal_status status = pal_surface_twins(s, same, error);
    if (status != PALPATE_OK) {
        free(same);
        free(number);
        free(x);
        return status;
    }
    int32_t count = 0;
    for (size_t i = 0; i < n; i++) {
        number[i] = -1;
    }
    for (size_t i = 0; i < 3 * (size_t)s->triangle_count; i++) {
        int32_t a = same[s->v[i]];
        if (number[a] < 0) {
            v3_copy(s->x + 3 * (size_t)a, x + 3 * (size_t)count);
            number[a] = count++;
        }
        s->v[i] = number[a];
    }
    free(s->x);
    s->x = x;
    s->vertex_count = count;
    free(number);
    free(same);
    return PALPATE_OK;
}

static int has_extension(const char *path, const char *extension) {
    const char *dot = strrchr(path, '.');
    return dot != NULL && strcasecmp(dot + 1, extension) == 0;
}

/// Assimp 5.2 reads a PLY header without end for ever, and believes any count: look first.
static const char *look_at_ply(FILE *in, long size) {
    char line[256];
    for (int i = 0; i < 1000 && fgets(line, sizeof line, in) != NULL; i++) {
        long count;
        if (sscanf(line, "element %*s %ld", &count) == 1 && (count < 0 || count > size)) {
            return "its header announces more elements than the file can hold";
        }
        if (strncmp(line, "end_header", 10) == 0) {
            return NULL;
        }
    }
    return "its header has no end";
}

/// What can be told before Assimp parses anything. @return NULL when it may try
static const char *look_at(const char *path) {
    if (!has_extension(path, "stl") && !has_extension(path, "obj") && !has_extension(path, "ply")) {
        return "its name does not end in .stl, .obj or .ply";
    }
    FILE *in = fopen(path, "rb");
    if (in == NULL) {
        return strerror(errno);
    }
    const char *why = NULL;
    long size = fseek(in, 0, SEEK_END) == 0 ? ftell(in) : -1;
    if (size <= 0) {
        why = size == 0 ? "it is empty" : "it is not a regular file";
    } else if (has_extension(path, "ply")) {
        rewind(in);
        why = look_at_ply(in, size);
    }
    (void)fclose(in);
    return why;
}

/// @param welding  1: one vertex per place; 0: as the importer numbers them
static pal_status import(const char *path, int welding, pal_surface *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    if (access(path, R_OK) != 0) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: %s", path, strerror(errno));
    }
    const char *why = look_at(path);
    if (why != NULL) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: not a readable surface (STL, OBJ or PLY): %s", path,
                        why);
    }
    struct aiPropertyStore *options = aiCreatePropertyStore();
    unsigned flags = aiProcess_Triangulate | (welding ? aiProcess_PreTransformVertices : 0u);
    const struct aiScene *scene = aiImportFileExWithProperties(path, flags, NULL, options);
    pal_status status;
    if (scene == NULL) {
        status = pal_fail(error, PALPATE_ERROR_IO,
                          "%s: not a readable surface (STL, OBJ or PLY): %s", path, aiGetErrorString());
    } else {
        status = copy_scene(scene, out, error);
        if (status == PALPATE_OK && welding) {
            status = weld(out, error);
        }
        if (status != PALPATE_OK) {
            status = pal_fail_prefix(error, status, "%s", path);
        }
        aiReleaseImport(scene);
    }
    if (options != NULL) {
        aiReleasePropertyStore(options);
    }
    if (status != PALPATE_OK) {
        pal_surface_clear(out);
    }
    return status;
}

pal_status pal_surface_read(const char *path, pal_surface *out, pal_error *error) {
    return import(path, 1, out, error);
}

pal_status pal_surface_read_in_order(const char *path, pal_surface *out, pal_error *error) {
    if (has_extension(path, "obj")) {
        return pal_obj_read(path, out, error);
    }
    return import(path, !has_extension(path, "ply"), out, error);
}
