/// @file reader.c  palpate-reader: triangles of an STL, OBJ or PLY file (Assimp).
///
/// A process of its own because surface files come from strangers and libassimp 5.2 aborts or never
/// ends on some of them. This is the only file that includes Assimp. It gives itself limits of
/// memory and time before it parses, opens no file (the caller's descriptor is read), and tells
/// what it found; the library checks all of it. Protocol: protocol.h. Single-threaded.
#include <assimp/cimport.h>
#include <assimp/postprocess.h>
#include <assimp/scene.h>

#include <errno.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <unistd.h>

#include "src/base/helper.h"
#include "src/base/pipe.h"
#include "src/reader/protocol.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SHADOWED 1
#elif defined(__has_feature)
#if __has_feature(address_sanitizer) || __has_feature(thread_sanitizer)
#define SHADOWED 1
#endif
#endif
#ifndef SHADOWED
#define SHADOWED 0 ///< 1: sanitizers reserve terabytes of addresses, which cannot be limited
#endif

typedef struct answer {
    pal_reader_reply reply;
    double *x;
    int32_t *v;
} answer;

static int limit(int what, rlim_t most) {
    const struct rlimit both = {most, most};
    return setrlimit((__rlimit_resource_t)what, &both) == 0;
}

/// No more memory and time than asked for, no file written, no core dumped.
static int confine(const pal_reader_request *r) {
    long pages = 0;
    FILE *in = fopen("/proc/self/statm", "r");
    int known = in != NULL && fscanf(in, "%ld", &pages) == 1;
    if (in != NULL) {
        (void)fclose(in);
    }
    rlim_t now = (rlim_t)pages * (rlim_t)sysconf(_SC_PAGESIZE);
    return known && limit(RLIMIT_CORE, 0) && limit(RLIMIT_FSIZE, 0) &&
           limit(RLIMIT_CPU, (rlim_t)r->cpu_seconds) &&
           (SHADOWED || limit(RLIMIT_AS, now + (rlim_t)r->memory_bytes));
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

#define REFUSE(a, why, ...)                                                                        \
    ((void)snprintf((a)->reply.message, sizeof(a)->reply.message, __VA_ARGS__),                    \
     (a)->reply.verdict = (why), 0)

/// One mesh of the scene behind what is there already.
static int copy_mesh(const struct aiMesh *mesh, unsigned part, size_t *vertex, size_t *triangle,
                     answer *a) {
    for (unsigned f = 0; f < mesh->mNumFaces; f++) {
        if (mesh->mFaces[f].mNumIndices != 3) {
            continue; // points and lines
        }
        for (size_t k = 0; k < 3; k++) {
            unsigned index = mesh->mFaces[f].mIndices[k];
            if (index >= mesh->mNumVertices) {
                return REFUSE(a, PALPATE_READER_BAD_GEOMETRY,
                              "triangle %zu names vertex %u, there are %u", *triangle, index,
                              mesh->mNumVertices);
            }
            a->v[3 * *triangle + k] = (int32_t)(*vertex + index);
        }
        ++*triangle;
    }
    for (unsigned k = 0; k < mesh->mNumVertices; k++, ++*vertex) {
        const struct aiVector3D *p = mesh->mVertices + k;
        double *x = a->x + 3 * *vertex;
        x[0] = (double)p->x;
        x[1] = (double)p->y;
        x[2] = (double)p->z;
        if (!isfinite(x[0]) || !isfinite(x[1]) || !isfinite(x[2])) {
            return REFUSE(a, PALPATE_READER_BAD_GEOMETRY,
                          "vertex %zu of part %u has a coordinate that is not a finite number",
                          (size_t)k + 1, part);
        }
    }
    return 1;
}

static int copy_scene(const struct aiScene *scene, answer *a) {
    size_t vertices, triangles, vertex = 0, triangle = 0;
    if (!count_scene(scene, &vertices, &triangles) || triangles == 0) {
        return REFUSE(a, PALPATE_READER_BAD_GEOMETRY, "%s",
                      triangles == 0 ? "it holds no triangle" : "it holds too many triangles");
    }
    a->x = malloc((3 * vertices + 1) * sizeof *a->x);
    a->v = malloc(3 * triangles * sizeof *a->v);
    if (a->x == NULL || a->v == NULL) {
        return REFUSE(a, PALPATE_READER_NO_MEMORY, "no memory for %zu triangles", triangles);
    }
    for (unsigned i = 0; i < scene->mNumMeshes; i++) {
        if (!copy_mesh(scene->mMeshes[i], i + 1, &vertex, &triangle, a)) {
            return 0;
        }
    }
    a->reply.vertex_count = (int32_t)vertices;
    a->reply.triangle_count = (int32_t)triangles;
    return 1;
}

static int import(const pal_reader_request *r, answer *a) {
    static const char *const hint[] = {"obj", "stl", "ply"};
    char *text = malloc((size_t)r->file_bytes);
    if (text == NULL) {
        return REFUSE(a, PALPATE_READER_NO_MEMORY, "no memory for its %lld bytes",
                      (long long)r->file_bytes);
    }
    if (!pal_pipe_read(PALPATE_HELPER_FILE, text, (size_t)r->file_bytes)) {
        free(text);
        return REFUSE(a, PALPATE_READER_NO_SURFACE, "it changed while it was read");
    }
    // a PLY file in order has one vertex per element as it is; PreTransform numbers anew
    unsigned flags = aiProcess_Triangulate | (r->in_order ? 0u : aiProcess_PreTransformVertices);
    const struct aiScene *scene =
        aiImportFileFromMemory(text, (unsigned)r->file_bytes, flags, hint[r->format]);
    int done = scene != NULL ? copy_scene(scene, a)
                             : REFUSE(a, PALPATE_READER_NO_SURFACE, "%s", aiGetErrorString());
    aiReleaseImport(scene);
    free(text);
    return done;
}

static int check_request(const pal_reader_request *r, answer *a) {
    if (r->magic != PALPATE_READER_MAGIC || r->version != PALPATE_READER_VERSION ||
        r->size != sizeof *r) {
        return REFUSE(a, PALPATE_READER_NO_SURFACE, "the request is not of version %d",
                      PALPATE_READER_VERSION);
    }
    if (r->format < PALPATE_READER_OBJ || r->format > PALPATE_READER_PLY || r->file_bytes < 1 ||
        r->file_bytes > INT32_MAX || r->memory_bytes < 1 || r->cpu_seconds < 1) {
        return REFUSE(a, PALPATE_READER_NO_SURFACE, "the request is impossible");
    }
    if (!confine(r)) {
        return REFUSE(a, PALPATE_READER_NO_SURFACE, "its limits cannot be set: %s",
                      strerror(errno));
    }
    return 1;
}

int main(void) {
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL); // never outlive the one who asked
    // whatever a library prints goes to the log: keep the reply's channel to ourselves
    int out = dup(STDOUT_FILENO);
    if (out < 0 || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) {
        return 2;
    }
    pal_reader_request request;
    answer a = {.reply = {.magic = PALPATE_READER_MAGIC,
                          .version = PALPATE_READER_VERSION,
                          .size = sizeof a.reply}};
    if (!pal_pipe_read(STDIN_FILENO, &request, sizeof request)) {
        return 2;
    }
    int done = check_request(&request, &a) && import(&request, &a);
    int sent = pal_pipe_write(out, &a.reply, sizeof a.reply);
    if (sent && done) {
        sent = pal_pipe_write(out, a.x, 3 * (size_t)a.reply.vertex_count * sizeof *a.x) &&
               pal_pipe_write(out, a.v, 3 * (size_t)a.reply.triangle_count * sizeof *a.v);
    }
    free(a.x);
    free(a.v);
    return sent ? 0 : 1;
}
