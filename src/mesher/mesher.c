/// @file mesher.c  palpate-mesher: fills a closed triangle surface with tetrahedra (Gmsh).
///
/// A process of its own because Gmsh (GPL) drags in 92 libraries and must never live in the process
/// that is locked into memory. This is the only file that includes Gmsh. Protocol: protocol.h.
/// Single-threaded and seeded: the same request gives the same reply, bit for bit.
#include <gmshc.h>

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <unistd.h>

#include "src/mesher/protocol.h"
#include "src/base/pipe.h"

typedef struct request {
    pal_mesher_request head;
    double *position;
    int32_t *triangle;
    pal_mesher_source *source;
} request;

static void progress(double fraction) {
    (void)fprintf(stderr, "progress %.3f\n", fraction);
    (void)fflush(stderr);
}

/// Same field as pal_size_at (src/geometry/shape.c), which must not be linked here.
static double spacing_at(int dim, int tag, double x, double y, double z, void *data) {
    (void)dim;
    (void)tag;
    const request *r = data;
    double h = r->head.cap;
    for (int32_t i = 0; i < r->head.source_count; i++) {
        const pal_mesher_source *s = r->source + i;
        double u[3] = {s->b[0] - s->a[0], s->b[1] - s->a[1], s->b[2] - s->a[2]};
        double w[3] = {x - s->a[0], y - s->a[1], z - s->a[2]};
        double uu = u[0] * u[0] + u[1] * u[1] + u[2] * u[2];
        double t = uu > 0.0 ? (u[0] * w[0] + u[1] * w[1] + u[2] * w[2]) / uu : 0.0;
        t = fmin(1.0, fmax(0.0, t));
        for (int c = 0; c < 3; c++) {
            w[c] -= t * u[c];
        }
        double d = sqrt(w[0] * w[0] + w[1] * w[1] + w[2] * w[2]) - s->radius;
        h = fmin(h, s->spacing + r->head.grading * fmax(0.0, d));
    }
    return h;
}

static int read_request(request *r, char *message, size_t size) {
    if (!pal_pipe_read(STDIN_FILENO, &r->head, sizeof r->head)) {
        (void)snprintf(message, size, "the request ended early");
        return 0;
    }
    if (r->head.magic != PALPATE_MESHER_MAGIC || r->head.version != PALPATE_MESHER_VERSION ||
        r->head.size != sizeof r->head) {
        (void)snprintf(message, size, "the request is not of version %d", PALPATE_MESHER_VERSION);
        return 0;
    }
    if (r->head.vertex_count < 4 || r->head.vertex_count > PALPATE_MESHER_COUNT_MAX ||
        r->head.triangle_count < 4 || r->head.triangle_count > PALPATE_MESHER_COUNT_MAX ||
        r->head.source_count < 0 || r->head.source_count > PALPATE_MESHER_COUNT_MAX ||
        !(r->head.cap > 0.0) || !(r->head.grading >= 0.0)) {
        (void)snprintf(message, size, "the request has impossible counts");
        return 0;
    }
    size_t n = (size_t)r->head.vertex_count, m = (size_t)r->head.triangle_count,
           k = (size_t)r->head.source_count;
    r->position = malloc(3 * n * sizeof *r->position);
    r->triangle = malloc(3 * m * sizeof *r->triangle);
    r->source = malloc((k + 1) * sizeof *r->source);
    if (r->position == NULL || r->triangle == NULL || r->source == NULL) {
        (void)snprintf(message, size, "out of memory for %zu triangles", m);
        return 0;
    }
    if (!pal_pipe_read(STDIN_FILENO, r->position, 3 * n * sizeof *r->position) ||
        !pal_pipe_read(STDIN_FILENO, r->triangle, 3 * m * sizeof *r->triangle) ||
        !pal_pipe_read(STDIN_FILENO, r->source, k * sizeof *r->source)) {
        (void)snprintf(message, size, "the request ended early");
        return 0;
    }
    for (size_t i = 0; i < 3 * m; i++) {
        if (r->triangle[i] < 0 || (size_t)r->triangle[i] >= n) {
            (void)snprintf(message, size, "a triangle names vertex %d of %zu", r->triangle[i], n);
            return 0;
        }
    }
    return 1;
}

static int gmsh_failed(int ierr, const char *what, char *message, size_t size) {
    if (ierr == 0) {
        return 0;
    }
    char *text = NULL;
    int ignore = 0;
    gmshLoggerGetLastError(&text, &ignore);
    (void)snprintf(message, size, "Gmsh could not %s: %s", what,
                   text != NULL && text[0] ? text : "no reason given");
    return 1;
}

static void set_options(void) {
    static const struct {
        const char *name;
        double value;
    } option[] = {
        {"General.Terminal", 0},
        {"General.NumThreads", 1},
        {"General.AbortOnError", 0},
        {"Mesh.RandomSeed", 1},
        {"Mesh.RandomFactor3D", 1e-12},
        {"Mesh.Algorithm3D", 1}, // Delaunay
        {"Mesh.MeshSizeExtendFromBoundary", 0},
        {"Mesh.MeshSizeFromPoints", 0},
        {"Mesh.MeshSizeFromCurvature", 0},
        {"Mesh.Optimize", 1},
        {"Mesh.OptimizeThreshold", 0.4},
        {"Mesh.MaxNumThreads3D", 1},
    };
    for (size_t i = 0; i < sizeof option / sizeof option[0]; i++) {
        int ierr = 0;
        gmshOptionSetNumber(option[i].name, option[i].value, &ierr);
    }
}

static int add_surface(const request *r, char *message, size_t size) {
    int ierr = 0;
    size_t n = (size_t)r->head.vertex_count, m = (size_t)r->head.triangle_count;
    size_t *tag = malloc((n + m + 3 * m) * sizeof *tag);
    if (tag == NULL) {
        (void)snprintf(message, size, "out of memory for %zu triangles", m);
        return 0;
    }
    size_t *element = tag + n, *corner = element + m;
    for (size_t i = 0; i < n; i++) {
        tag[i] = i + 1;
    }
    for (size_t i = 0; i < m; i++) {
        element[i] = i + 1;
        for (size_t k = 0; k < 3; k++) {
            corner[3 * i + k] = (size_t)r->triangle[3 * i + k] + 1;
        }
    }
    int bad = 0;
    gmshModelAdd("palpate", &ierr);
    gmshModelAddDiscreteEntity(2, 1, NULL, 0, &ierr);
    bad = gmsh_failed(ierr, "add the surface", message, size);
    if (!bad) {
        gmshModelMeshAddNodes(2, 1, tag, n, r->position, 3 * n, NULL, 0, &ierr);
        bad = gmsh_failed(ierr, "take the nodes", message, size);
    }
    if (!bad) {
        gmshModelMeshAddElementsByType(1, 2, element, m, corner, 3 * m, &ierr);
        bad = gmsh_failed(ierr, "take the triangles", message, size);
    }
    if (!bad) {
        int surface = 1, loop = gmshModelGeoAddSurfaceLoop(&surface, 1, 1, &ierr);
        bad = gmsh_failed(ierr, "close the surface", message, size);
        if (!bad) {
            gmshModelGeoAddVolume(&loop, 1, 1, &ierr);
            bad = gmsh_failed(ierr, "make the volume", message, size);
        }
        if (!bad) {
            gmshModelGeoSynchronize(&ierr);
            bad = gmsh_failed(ierr, "make the volume", message, size);
        }
    }
    free(tag);
    return !bad;
}

/// Collect inside nodes (in tag order) and tetrahedra. Nodes of the surface keep their numbers.
static int collect(const request *r, pal_mesher_reply *reply, double **inside, int32_t **tet) {
    int ierr = 0;
    size_t *node = NULL, node_n = 0, *element = NULL, element_n = 0, *corner = NULL, corner_n = 0;
    double *coord = NULL, *parametric = NULL;
    size_t coord_n = 0, parametric_n = 0, surface = (size_t)r->head.vertex_count, largest = 0;
    gmshModelMeshGetNodes(&node, &node_n, &coord, &coord_n, &parametric, &parametric_n, -1, -1, 0,
                          0, &ierr);
    if (gmsh_failed(ierr, "return the nodes", reply->message, sizeof reply->message)) {
        return 0;
    }
    gmshModelMeshGetElementsByType(4, &element, &element_n, &corner, &corner_n, -1, 0, 1, &ierr);
    if (gmsh_failed(ierr, "return the cells", reply->message, sizeof reply->message)) {
        return 0;
    }
    if (element_n == 0 || corner_n != 4 * element_n || element_n > PALPATE_MESHER_COUNT_MAX) {
        char *text = NULL;
        gmshLoggerGetLastError(&text, &ierr);
        (void)snprintf(reply->message, sizeof reply->message, "Gmsh filled nothing: %s",
                       text != NULL && text[0] ? text : "no reason given");
        return 0;
    }
    for (size_t i = 0; i < node_n; i++) {
        largest = node[i] > largest ? node[i] : largest;
    }
    int32_t *number = malloc((largest + 1) * sizeof *number);
    size_t *by_tag = malloc((largest + 1) * sizeof *by_tag);
    *inside = malloc((3 * node_n + 1) * sizeof **inside);
    *tet = malloc(corner_n * sizeof **tet);
    if (number == NULL || by_tag == NULL || *inside == NULL || *tet == NULL) {
        (void)snprintf(reply->message, sizeof reply->message, "out of memory for %zu cells",
                       element_n);
        free(number);
        free(by_tag);
        return 0;
    }
    for (size_t i = 0; i <= largest; i++) {
        number[i] = -1;
        by_tag[i] = 0;
    }
    for (size_t i = 0; i < node_n; i++) {
        by_tag[node[i]] = i;
    }
    for (size_t i = 0; i < corner_n; i++) {
        number[corner[i]] = 0; // used by a cell
    }
    int32_t count = 0;
    for (size_t t = 1; t <= largest; t++) {
        if (t <= surface) {
            number[t] = (int32_t)t - 1;
        } else if (number[t] == 0) {
            memcpy(*inside + 3 * (size_t)count, coord + 3 * by_tag[t], 3 * sizeof **inside);
            number[t] = (int32_t)surface + count++;
        }
    }
    for (size_t i = 0; i < corner_n; i++) {
        (*tet)[i] = number[corner[i]];
    }
    reply->inside_count = count;
    reply->tet_count = (int32_t)element_n;
    free(number);
    free(by_tag);
    gmshFree(node);
    gmshFree(coord);
    gmshFree(parametric);
    gmshFree(element);
    gmshFree(corner);
    return 1;
}

static int fill(request *r, pal_mesher_reply *reply, double **inside, int32_t **tet) {
    int ierr = 0;
    char *message = reply->message;
    size_t size = sizeof reply->message;
    gmshInitialize(0, NULL, 0, &ierr);
    if (gmsh_failed(ierr, "start", message, size)) {
        return 0;
    }
    set_options();
    progress(0.02);
    if (!add_surface(r, message, size)) {
        return 0;
    }
    gmshModelMeshSetSizeCallback(spacing_at, r, &ierr);
    progress(0.05);
    gmshModelMeshGenerate(3, &ierr);
    if (gmsh_failed(ierr, "fill the surface", message, size)) {
        return 0;
    }
    progress(0.7);
    gmshModelMeshOptimize("", 0, 1, NULL, 0, &ierr);
    gmshModelMeshOptimize("Relocate3D", 0, 3, NULL, 0, &ierr);
    gmshModelMeshOptimize("", 0, 1, NULL, 0, &ierr);
    progress(0.9);
    return collect(r, reply, inside, tet);
}

int main(void) {
    (void)prctl(PR_SET_PDEATHSIG, SIGKILL); // never outlive the one who asked
    // Gmsh may print: keep the reply's channel to ourselves
    int out = dup(STDOUT_FILENO);
    if (out < 0 || dup2(STDERR_FILENO, STDOUT_FILENO) < 0) {
        return 2;
    }
    request r = {0};
    pal_mesher_reply reply = {.magic = PALPATE_MESHER_MAGIC,
                              .version = PALPATE_MESHER_VERSION,
                              .size = sizeof reply,
                              .status = 1};
    double *inside = NULL;
    int32_t *tet = NULL;
    if (read_request(&r, reply.message, sizeof reply.message) && fill(&r, &reply, &inside, &tet)) {
        reply.status = 0;
    }
    int sent = pal_pipe_write(out, &reply, sizeof reply);
    if (sent && reply.status == 0) {
        sent = pal_pipe_write(out, inside, 3 * (size_t)reply.inside_count * sizeof *inside) &&
               pal_pipe_write(out, tet, 4 * (size_t)reply.tet_count * sizeof *tet);
    }
    progress(1.0);
    _exit(sent ? 0 : 1); // Gmsh's own clean-up takes longer than it is worth
}
