/// @file cloud_build.c  From a scene to its node cloud.
///
/// (A) a closed triangulation of the body whose edges follow sharp edges and patch rims, with the
/// spacing wanted (remesh.c); (B) tetrahedra inside it (palpate-mesher), improved (tet_improve.c).
/// Nodes are then put into a fixed order: surface first, both parts along a Morton curve, so that
/// near nodes are near in memory and the order does not depend on how the mesh came about. Thread:
/// one scene, one thread.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/geometry/geometry.h"
#include "src/cloud/mesher_client.h"
#include "src/cloud/rims.h"
#include "src/scene/scene_size.h"
#include "src/cloud/skin.h"
#include "src/geometry/surface.h"
#include "src/cloud/tet_improve.h"
#include "haptic/base/vec.h"

typedef struct node_key {
    uint64_t key;
    int32_t node;
} node_key;

static int key_compare(const void *pa, const void *pb) {
    const node_key *a = pa, *b = pb;
    if (a->key != b->key) {
        return a->key < b->key ? -1 : 1;
    }
    return (a->node > b->node) - (a->node < b->node);
}

/// Spread the low 21 bits: two zero bits after each.
static uint64_t spread(uint64_t x) {
    uint64_t out = 0;
    for (int b = 0; b < 21; b++) {
        out |= ((x >> b) & 1u) << (3 * b);
    }
    return out;
}

static uint64_t morton(const double x[3], const double low[3], double scale) {
    uint64_t key = 0;
    for (int c = 0; c < 3; c++) {
        double u = fmin(2097151.0, fmax(0.0, floor((x[c] - low[c]) * scale)));
        key |= spread((uint64_t)u) << c;
    }
    return key;
}

/// Fill order[] with the nodes: surface nodes first, each part along the curve.
static pal_status order_nodes(const pal_cloud *c, int32_t *order, pal_error *error) {
    node_key *key = malloc((size_t)c->node_count * sizeof *key);
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, extent = 0.0;
    if (key == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for %d nodes",
                        c->node_count);
    }
    for (int d = 0; d < 3; d++) {
        double high = -HUGE_VAL;
        for (size_t i = 0; i < (size_t)c->node_count; i++) {
            low[d] = fmin(low[d], c->position[3 * i + (size_t)d]);
            high = fmax(high, c->position[3 * i + (size_t)d]);
        }
        extent = fmax(extent, high - low[d]);
    }
    for (int32_t i = 0; i < c->node_count; i++) {
        uint64_t inside = i < c->surface_count ? 0u : 1u;
        key[i].key = inside << 63 | morton(c->position + 3 * (size_t)i, low, 2097151.0 / extent);
        key[i].node = i;
    }
    qsort(key, (size_t)c->node_count, sizeof *key, key_compare);
    for (int32_t i = 0; i < c->node_count; i++) {
        order[i] = key[i].node;
    }
    free(key);
    return PALPATE_OK;
}

static pal_status renumber(pal_cloud *c, pal_error *error) {
    size_t n = (size_t)c->node_count;
    int32_t *order = calloc(2 * n, sizeof *order);
    double *position = malloc(3 * n * sizeof *position);
    if (order == NULL || position == NULL) {
        free(order);
        free(position);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for %zu nodes", n);
    }
    pal_status status = order_nodes(c, order, error);
    if (status == PALPATE_OK) {
        int32_t *number = order + n;
        for (int32_t i = 0; i < c->node_count; i++) {
            number[order[i]] = i;
            v3_copy(c->position + 3 * (size_t)order[i], position + 3 * (size_t)i);
        }
        memcpy(c->position, position, 3 * n * sizeof *position);
        for (size_t i = 0; i < 3 * (size_t)c->triangle_count; i++) {
            c->triangle[i] = number[c->triangle[i]];
        }
        for (size_t i = 0; i < 4 * (size_t)c->tet_count; i++) {
            c->tet[i] = number[c->tet[i]];
        }
    }
    free(order);
    free(position);
    return status;
}

/// Six times the signed volume.
static double tet_determinant(const double *x, const int32_t t[4]) {
    double n[3], w[3];
    v3_normal(x + 3 * (size_t)t[0], x + 3 * (size_t)t[1], x + 3 * (size_t)t[2], n);
    v3_sub(x + 3 * (size_t)t[3], x + 3 * (size_t)t[0], w);
    return v3_dot(n, w);
}

/// Surface mesh + filling -> cloud.
static pal_status assemble(const pal_body *body, const pal_mesh_fill *fill, pal_cloud *c,
                           pal_error *error) {
    const pal_surface_mesh *m = &body->mesh;
    size_t s = (size_t)m->vertex_count, n = s + (size_t)fill->inside_count;
    c->length = body->length;
    c->surface_count = m->vertex_count;
    c->node_count = (int32_t)n;
    c->triangle_count = m->triangle_count;
    c->tet_count = fill->tet_count;
    c->position = calloc(3 * n, sizeof *c->position);
    c->triangle = calloc(3 * (size_t)c->triangle_count, sizeof *c->triangle);
    c->tet = calloc(4 * (size_t)c->tet_count, sizeof *c->tet);
    if (c->position == NULL || c->triangle == NULL || c->tet == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for %zu nodes", n);
    }
    for (size_t i = 0; i < 3 * s; i++) {
        c->position[i] = m->x[i];
    }
    for (size_t i = 3 * s; i < 3 * n; i++) {
        c->position[i] = pal_grid(fill->inside[i - 3 * s]);
    }
    memcpy(c->triangle, m->v, 3 * (size_t)c->triangle_count * sizeof *c->triangle);
    memcpy(c->tet, fill->tet, 4 * (size_t)c->tet_count * sizeof *c->tet);
    for (size_t t = 0; t < (size_t)c->tet_count; t++) {
        if (tet_determinant(c->position, c->tet + 4 * t) < 0.0) {
            int32_t swap = c->tet[4 * t];
            c->tet[4 * t] = c->tet[4 * t + 1];
            c->tet[4 * t + 1] = swap;
        }
    }
    return PALPATE_OK;
}

static pal_status check_spacing(const pal_scene *scene, const pal_body *body, pal_error *error) {
    double spacing = scene->spacing / body->length;
    if (!(spacing > 0.0) || !(spacing <= 0.6 * body->least_extent)) {
        char place[1400];
        return pal_fail(error, PALPATE_ERROR_GEOMETRY,
                        "%s: %g m is too coarse for a body %g m thick: at most 0.6 of that",
                        pal_place_text(scene, &scene->spacing_place, place, sizeof place),
                        scene->spacing, body->least_extent * body->length);
    }
    return PALPATE_OK;
}

/// About how many nodes the spacing asks for: the body's box over h^3, refined balls besides (they
/// may hide between the samples), the surface over h^2.
static double estimate_nodes(const pal_surface_mesh *m, const pal_size_field *size) {
    enum { SAMPLES = 24 };
    double low[3] = {HUGE_VAL, HUGE_VAL, HUGE_VAL}, step[3], sum = 0.0, cell = 1.0;
    for (int d = 0; d < 3; d++) {
        double high = -HUGE_VAL;
        for (size_t i = 0; i < (size_t)m->vertex_count; i++) {
            low[d] = fmin(low[d], m->x[3 * i + (size_t)d]);
            high = fmax(high, m->x[3 * i + (size_t)d]);
        }
        step[d] = (high - low[d]) / SAMPLES;
        cell *= step[d];
    }
    for (int i = 0; i < SAMPLES * SAMPLES * SAMPLES; i++) {
        int a = i % SAMPLES, b = i / SAMPLES % SAMPLES, c = i / SAMPLES / SAMPLES;
        const double x[3] = {low[0] + step[0] * (a + 0.5), low[1] + step[1] * (b + 0.5),
                             low[2] + step[2] * (c + 0.5)};
        double h = pal_size_at(size, x);
        sum += cell / (h * h * h);
    }
    for (int32_t i = 0; i < size->count; i++) {
        double ratio = fmin(size->source[i].radius, 1.0) / size->source[i].spacing;
        sum += ratio * ratio * ratio;
    }
    for (int32_t t = 0; t < m->triangle_count; t++) {
        double n[3], h = pal_size_at(size, m->x + 3 * (size_t)m->v[3 * (size_t)t]);
        sum += 0.5 * pal_smesh_normal(m, t, -1, NULL, n) / (h * h);
    }
    return sum;
}

static pal_status check_count(const pal_scene *scene, const pal_body *body,
                              const pal_size_field *size, pal_error *error) {
    static const double MOST = 1e7;
    double nodes = estimate_nodes(&body->mesh, size);
    if (!(nodes <= MOST)) {
        char place[1400];
        return pal_fail(
            error, PALPATE_ERROR_CLOUD,
            "%s: with its refinements it asks for about %.2g nodes, at most %.2g are built; use "
            "a coarser spacing or smaller refined zones",
            pal_place_text(scene, &scene->spacing_place, place, sizeof place), nodes, MOST);
    }
    return PALPATE_OK;
}

/// Surface files: refuse spacings that ask for absurdly many nodes (the scene did it for
/// primitives).
static pal_status check_size(pal_scene *scene, const pal_body *body, pal_error *error) {
    double low[3] = {INFINITY, INFINITY, INFINITY};
    double high[3] = {-INFINITY, -INFINITY, -INFINITY};
    double volume = 0.0;
    const double *x = body->mesh.x;
    for (int32_t t = 0; t < body->mesh.triangle_count && body->is_file; t++) {
        const double *a = x + 3 * (size_t)body->mesh.v[3 * (size_t)t];
        const double *b = x + 3 * (size_t)body->mesh.v[3 * (size_t)t + 1];
        const double *c = x + 3 * (size_t)body->mesh.v[3 * (size_t)t + 2];
        for (int i = 0; i < 3; i++) {
            int j = (i + 1) % 3;
            int k = (i + 2) % 3;
            low[i] = fmin(low[i], body->length * fmin(a[i], fmin(b[i], c[i])));
            high[i] = fmax(high[i], body->length * fmax(a[i], fmax(b[i], c[i])));
            volume += a[i] * (b[j] * c[k] - b[k] * c[j]) / 6.0;
        }
    }
    double unit = body->length * body->length * body->length;
    return body->is_file ? pal_scene_check_size(scene, low, high, volume * unit, error)
                         : PALPATE_OK;
}

static int cancelled(const pal_progress *progress, double fraction) {
    return progress != NULL && progress->call != NULL &&
           progress->call(progress->user, "cloud", fraction, -1.0) != 0;
}

static pal_status build(pal_scene *scene, const pal_progress *progress, pal_body *body,
                        pal_size_field *size, pal_mesh_fill *fill, pal_cloud *cloud,
                        pal_error *error) {
    pal_status status = pal_body_make(scene, body, error);
    if (status == PALPATE_OK) {
        status = check_spacing(scene, body, error);
    }
    if (status == PALPATE_OK) {
        status = check_size(scene, body, error);
    }
    if (status == PALPATE_OK) {
        status = pal_size_from_scene(scene, body->length, size, error);
    }
    if (status == PALPATE_OK) {
        status = check_count(scene, body, size, error);
    }
    if (status == PALPATE_OK) {
        status = pal_rims_imprint(scene, body, size, error);
    }
    if (status == PALPATE_OK) {
        status = check_count(scene, body, size, error); // with the rims
    }
    if (status == PALPATE_OK && cancelled(progress, 0.05)) {
        status = pal_fail(error, PALPATE_ERROR_CANCELLED, "cloud: cancelled");
    }
    if (status == PALPATE_OK) {
        status = body->is_file
                     ? pal_surface_remesh(scene, body, size, progress, error)
                     : pal_smesh_remesh(&body->mesh, &body->shape, size, 8, progress, error);
    }
    if (status == PALPATE_OK && cancelled(progress, 0.2)) {
        status = pal_fail(error, PALPATE_ERROR_CANCELLED, "cloud: cancelled");
    }
    if (status == PALPATE_OK) {
        for (size_t i = 0; i < 3 * (size_t)body->mesh.vertex_count; i++) {
            body->mesh.x[i] = pal_grid(body->mesh.x[i]);
        }
        status = pal_mesher_fill(body->mesh.x, body->mesh.vertex_count, body->mesh.v,
                                 body->mesh.triangle_count, size, progress, fill, error);
    }
    if (status == PALPATE_OK) {
        status = pal_tets_improve(body->mesh.x, body->mesh.vertex_count, body->mesh.v,
                                  body->mesh.triangle_count, fill, error);
    }
    if (status == PALPATE_OK) {
        status = assemble(body, fill, cloud, error);
    }
    if (status == PALPATE_OK) {
        status = renumber(cloud, error);
    }
    return status == PALPATE_OK ? pal_cloud_complete(cloud, error) : status;
}

pal_status pal_cloud_build(pal_scene *scene, const pal_progress *progress, pal_cloud *cloud,
                           pal_skin_source *skin, pal_error *error) {
    pal_body body = {0};
    pal_size_field size = {0};
    pal_mesh_fill fill = {0};
    memset(cloud, 0, sizeof *cloud);
    if (skin != NULL) {
        memset(skin, 0, sizeof *skin);
    }
    pal_status status = PALPATE_OK;
    int own = skin != NULL && scene->skin.path[0] != '\0';
    if (own) { // before the long work: its file may be no mesh
        status = pal_skin_read(scene, NULL, skin, error);
    }
    if (status == PALPATE_OK) {
        status = build(scene, progress, &body, &size, &fill, cloud, error);
    }
    if (status == PALPATE_OK && skin != NULL && !own) {
        status = pal_skin_read(scene, &body, skin, error);
    }
    pal_body_clear(&body);
    pal_size_clear(&size);
    pal_mesh_fill_clear(&fill);
    if (status != PALPATE_OK) {
        pal_cloud_clear(cloud);
    }
    if (status != PALPATE_OK && skin != NULL) {
        pal_skin_clear(skin);
    }
    return status;
}
