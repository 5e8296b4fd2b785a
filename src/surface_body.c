/// @file surface_body.c  A body from a surface file: normalise, keep sharp edges, remesh, verify.
///
/// Remeshing moves nodes along the input surface (closest point), so nothing is lost but what the
/// spacing cannot resolve. Verified afterwards: no self-intersection, enclosed volume within 1 %,
/// every input vertex within a quarter of the local spacing. When that fails, the spacing is made finer
/// where the mesh is furthest from the input (ridges thinner than the spacing) and the remeshing is
/// repeated; if it still fails the input's own triangles are used, with a warning. (Gmsh's own remeshing of discrete surfaces
/// loses 1.6 % of the liver's volume at 12.5 mm and cannot place nodes on a rim.) Thread: one scene.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/error.h"
#include "src/surface.h"
#include "src/vec.h"

static const double SHARP_COSINE = 0.5; // normals more than 60 degrees apart: an edge to keep
static const double VOLUME_TOLERANCE = 0.01, DISTANCE_TOLERANCE = 0.25;
static const double FARTHEST = 65536.0;
enum { ATTEMPTS = 8, ROUNDS = 8 };

/// Normalise the checked surface into body->input_*.
static pal_status take_input(const pal_scene *scene, const pal_surface *s, pal_body *body,
                             pal_error *error) {
    double extent = 0.0, farthest = 0.0;
    body->least_extent = HUGE_VAL;
    double size[3];
    for (int c = 0; c < 3; c++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (int32_t i = 0; i < s->vertex_count; i++) {
            double x = s->x[3 * (size_t)i + (size_t)c];
            low = fmin(low, x);
            high = fmax(high, x);
        }
        size[c] = high - low;
        extent = fmax(extent, size[c]);
        farthest = fmax(farthest, fmax(fabs(low), fabs(high)));
    }
    for (int c = 0; c < 3; c++) {
        body->least_extent = fmin(body->least_extent, size[c] / extent);
    }
    if (!(farthest <= FARTHEST * extent)) {
        return pal_fail(error, PALPATE_ERROR_GEOMETRY,
                        "it lies %g of its own sizes from the origin; move it closer", farthest / extent);
    }
    body->length = extent * scene->geometry.scale;
    body->input_vertices = s->vertex_count;
    body->input_triangles = s->triangle_count;
    body->input_x = malloc(3 * (size_t)s->vertex_count * sizeof *body->input_x);
    body->input_v = malloc(3 * (size_t)s->triangle_count * sizeof *body->input_v);
    if (body->input_x == NULL || body->input_v == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for %d triangles", s->triangle_count);
    }
    for (size_t i = 0; i < 3 * (size_t)s->vertex_count; i++) {
        body->input_x[i] = pal_grid(s->x[i] / extent);
    }
    memcpy(body->input_v, s->v, 3 * (size_t)s->triangle_count * sizeof *body->input_v);
    return pal_bvh_build(&body->input_tree, body->input_x, body->input_v, body->input_triangles, error);
}

/// Mark sharp edges that form closed networks (ends that fade out are dropped, they would only pin
/// single nodes) and hand their segments to the shape.
static pal_status keep_sharp_edges(pal_body *body, pal_error *error) {
    pal_surface_mesh *m = &body->mesh;
    size_t edges = 3 * (size_t)m->triangle_count, count = 0;
    uint8_t *sharp = calloc(edges, 1);
    int32_t *degree = calloc((size_t)m->vertex_count, sizeof *degree);
    pal_status status = PALPATE_OK;
    if (sharp == NULL || degree == NULL) {
        status = PALPATE_ERROR_MEMORY;
    }
    for (int32_t e = 0; status == PALPATE_OK && e < (int32_t)edges; e++) {
        double a[3], b[3];
        pal_smesh_normal(m, e / 3, -1, NULL, a);
        pal_smesh_normal(m, m->twin[e] / 3, -1, NULL, b);
        sharp[e] = v3_dot(a, b) < SHARP_COSINE;
        degree[m->v[e]] += sharp[e];
    }
    for (int changed = status == PALPATE_OK; changed;) {
        changed = 0;
        for (int32_t e = 0; e < (int32_t)edges; e++) {
            int32_t o = m->twin[e];
            if (sharp[e] && (degree[m->v[e]] == 1 || degree[m->v[o]] == 1)) {
                sharp[e] = sharp[o] = 0;
                degree[m->v[e]]--;
                degree[m->v[o]]--;
                changed = 1;
            }
        }
    }
    for (size_t e = 0; status == PALPATE_OK && e < edges; e++) {
        count += sharp[e] && (int32_t)e < m->twin[e];
    }
    if (status == PALPATE_OK && count > 0) {
        pal_constraint c = {PALPATE_CONSTRAINT_EDGES, {0.0, 0.0, 0.0}, 0.0};
        int id = pal_shape_add(&body->shape, &c);
        body->shape.segment = malloc(6 * count * sizeof *body->shape.segment);
        if (id < 0 || body->shape.segment == NULL) {
            status = PALPATE_ERROR_MEMORY;
        }
        for (int32_t e = 0; status == PALPATE_OK && e < (int32_t)edges; e++) {
            if (sharp[e] && e < m->twin[e]) {
                double *segment = body->shape.segment + 6 * (size_t)body->shape.segment_count++;
                v3_copy(m->x + 3 * (size_t)m->v[e], segment);
                v3_copy(m->x + 3 * (size_t)pal_smesh_head(m, e), segment + 3);
                pal_smesh_mark(m, e, pal_set_one(id));
            }
        }
    }
    free(sharp);
    free(degree);
    return status == PALPATE_OK ? status : pal_fail(error, status, "no memory for %zu edges", edges);
}

pal_status pal_surface_body(pal_scene *scene, pal_body *body, pal_error *error) {
    pal_surface s = {0};
    char place[1400];
    int32_t repaired = 0;
    double unit = scene->geometry.scale;
    body->is_file = 1;
    (void)pal_place_text(scene, &scene->geometry.place, place, sizeof place);
    pal_status status = pal_surface_read(scene->geometry.path, &s, error);
    if (status == PALPATE_OK) {
        status = pal_surface_check(&s, unit, &repaired, error);
        if (status == PALPATE_OK) {
            status = take_input(scene, &s, body, error);
        }
        if (status != PALPATE_OK) {
            status = pal_fail_prefix(error, status, "%s", scene->geometry.path);
        }
    }
    if (status == PALPATE_OK) {
        pal_constraint face = {PALPATE_CONSTRAINT_MESH, {0.0, 0.0, 0.0}, 0.0};
        body->shape.mesh = &body->input_tree;
        status = pal_shape_add(&body->shape, &face) == 0 ? PALPATE_OK : PALPATE_ERROR_MEMORY;
    }
    if (status == PALPATE_OK) {
        status = pal_smesh_build(&body->mesh, body->input_x, body->input_vertices, body->input_v,
                                 body->input_triangles, NULL, error);
    }
    if (status == PALPATE_OK) {
        status = keep_sharp_edges(body, error);
    }
    if (status == PALPATE_OK && repaired > 0) {
        status = pal_scene_warn(scene, &scene->geometry.place,
                                "%d of %d triangles of the surface were turned over or dropped to make "
                                "it consistent and outward",
                                repaired, s.triangle_count);
    }
    pal_surface_clear(&s);
    return status == PALPATE_OK ? status : pal_fail_prefix(error, status, "%s", place);
}

/// Does the mesh intersect itself?
static pal_status crosses_itself(const pal_surface_mesh *m, pal_error *error) {
    pal_surface copy = {m->vertex_count, m->triangle_count, NULL, NULL};
    copy.x = malloc(3 * (size_t)m->vertex_count * sizeof *copy.x);
    copy.v = malloc(3 * (size_t)m->triangle_count * sizeof *copy.v);
    pal_status status = PALPATE_ERROR_MEMORY;
    if (copy.x != NULL && copy.v != NULL) {
        memcpy(copy.x, m->x, 3 * (size_t)m->vertex_count * sizeof *copy.x);
        memcpy(copy.v, m->v, 3 * (size_t)m->triangle_count * sizeof *copy.v);
        status = pal_surface_check(&copy, 1.0, NULL, error);
    }
    pal_surface_clear(&copy);
    return status;
}

/// The input vertices' distances to the mesh over the spacing that the scene asks for there (the
/// first `sources` of the field). @return the worst through *worst
static pal_status measure_distance(const pal_body *body, const pal_size_field *size, int32_t sources,
                                   double *distance, double *worst, pal_error *error) {
    pal_size_field scene = *size;
    scene.count = sources;
    pal_bvh tree;
    pal_status status = pal_bvh_build(&tree, body->mesh.x, body->mesh.v, body->mesh.triangle_count, error);
    *worst = 0.0;
    for (int32_t i = 0; i < body->input_vertices && status == PALPATE_OK; i++) {
        const double *x = body->input_x + 3 * (size_t)i;
        (void)pal_bvh_closest(&tree, x, NULL, distance + i);
        distance[i] /= pal_size_at(&scene, x);
        *worst = fmax(*worst, distance[i]);
    }
    pal_bvh_clear(&tree);
    return status;
}

/// Ask for `factor` of the present spacing at input vertices further from the mesh than `limit`.
static pal_status refine_distant(const pal_body *body, const double *distance, double limit,
                                 double factor, pal_size_field *size, pal_error *error) {
    int32_t present = size->count;
    for (int32_t i = 0; i < body->input_vertices; i++) {
        if (distance[i] > limit) {
            const double *x = body->input_x + 3 * (size_t)i;
            pal_size_field now = *size;
            now.count = present;
            pal_size_source s = {.radius = 0.0, .spacing = pal_grid(factor * pal_size_at(&now, x))};
            v3_copy(x, s.a);
            v3_copy(x, s.b);
            if (pal_size_add(size, &s) != PALPATE_OK) {
                return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for the spacing field");
            }
        }
    }
    return PALPATE_OK;
}

/// One attempt: remesh `body->mesh` and verify. *why is NULL when it is good; else `size` is finer
/// where the mesh lies far from the input.
static pal_status attempt(pal_body *body, pal_size_field *size, int32_t sources, double limit,
                          double *distance, const char **why, const pal_progress *progress,
                          pal_error *error) {
    double before = pal_smesh_volume(&body->mesh), worst, factor = 0.6;
    *why = NULL;
    pal_status status = pal_smesh_remesh(&body->mesh, &body->shape, size, ROUNDS, progress, error);
    if (status != PALPATE_OK) {
        return status;
    }
    status = measure_distance(body, size, sources, distance, &worst, error);
    if (status != PALPATE_OK) {
        return status;
    }
    pal_error found = {0};
    status = crosses_itself(&body->mesh, &found);
    if (status == PALPATE_ERROR_MEMORY) {
        return pal_fail(error, status, "cloud: no memory to check the remeshed surface");
    }
    if (status != PALPATE_OK) {
        *why = "intersects itself";
    } else if (worst > DISTANCE_TOLERANCE) {
        *why = "leaves the input by more than a quarter of the spacing";
    } else if (fabs(pal_smesh_volume(&body->mesh) - before) > VOLUME_TOLERANCE * before) {
        *why = "changes the volume by more than 1 %";
        // every vertex is close enough: chords lose volume where the surface bends most
        limit = fmin(0.5 * worst, 0.6 * limit);
        factor = 0.7;
    }
    return *why == NULL ? PALPATE_OK : refine_distant(body, distance, limit, factor, size, error);
}

/// Is every edge already within a factor of the spacing wanted?
static int spacing_fits(pal_surface_mesh *m, const pal_size_field *size) {
    for (int32_t e = 0; e < 3 * m->triangle_count; e++) {
        const double *a = m->x + 3 * (size_t)m->v[e], *b = m->x + 3 * (size_t)pal_smesh_head(m, e);
        double length = v3_distance(a, b), h = 0.5 * (pal_size_at(size, a) + pal_size_at(size, b));
        if (length < 0.5 * h || length > 1.6 * h) {
            return 0;
        }
    }
    return 1;
}

pal_status pal_surface_remesh(pal_scene *scene, pal_body *body, pal_size_field *size,
                              const pal_progress *progress, pal_error *error) {
    if (spacing_fits(&body->mesh, size)) {
        return PALPATE_OK;
    }
    pal_surface_mesh input = {0};
    const char *why = NULL;
    int32_t sources = size->count;
    double limit = 0.8 * DISTANCE_TOLERANCE;
    double *distance = malloc((size_t)body->input_vertices * sizeof *distance);
    pal_status status = pal_smesh_copy(&input, &body->mesh, error);
    if (status == PALPATE_OK && distance == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory to check the surface");
    }
    for (int i = 0; i < ATTEMPTS && status == PALPATE_OK; i++, limit *= 0.8) {
        status = attempt(body, size, sources, limit, distance, &why, progress, error);
        if (status != PALPATE_OK || why == NULL) {
            break;
        }
        pal_smesh_clear(&body->mesh);
        status = pal_smesh_copy(&body->mesh, &input, error);
    }
    free(distance);
    pal_smesh_clear(&input);
    if (status == PALPATE_OK && why != NULL) {
        size->count = sources;
        status = pal_scene_warn(scene, &scene->spacing_place,
                                "the surface keeps its own triangles: remeshing it to %g m %s",
                                scene->spacing, why);
    }
    return status;
}
