/// @file surface_body.c  A body from a surface file: read, check, normalise, keep sharp edges.
///
/// Thread: one scene.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/geometry/surface.h"
#include "haptic/base/vec.h"

static const double SHARP_COSINE = 0.5; // normals more than 60 degrees apart: an edge to keep
static const double FARTHEST = 65536.0; // sizes from the origin, as for primitives

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
                        "it lies %g of its own sizes from the origin; move it closer",
                        farthest / extent);
    }
    body->length = extent * scene->geometry.scale;
    body->input_vertices = s->vertex_count;
    body->input_triangles = s->triangle_count;
    body->input_x = malloc(3 * (size_t)s->vertex_count * sizeof *body->input_x);
    body->input_v = malloc(3 * (size_t)s->triangle_count * sizeof *body->input_v);
    if (body->input_x == NULL || body->input_v == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for %d triangles",
                        s->triangle_count);
    }
    for (size_t i = 0; i < 3 * (size_t)s->vertex_count; i++) {
        body->input_x[i] = pal_grid(s->x[i] / extent);
    }
    memcpy(body->input_v, s->v, 3 * (size_t)s->triangle_count * sizeof *body->input_v);
    return pal_bvh_build(&body->input_tree, body->input_x, body->input_v, body->input_triangles,
                         error);
}

pal_status pal_surface_sharpen(pal_body *body, double cosine, pal_error *error) {
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
        sharp[e] = v3_dot(a, b) < cosine;
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
        m->sharp = id;
        free(body->shape.segment);
        body->shape.segment_count = 0;
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
    return status == PALPATE_OK ? status
                                : pal_fail(error, status, "no memory for %zu edges", edges);
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
        status = pal_surface_sharpen(body, SHARP_COSINE, error);
    }
    if (status == PALPATE_OK && repaired > 0) {
        status =
            pal_scene_warn(scene, &scene->geometry.place,
                           "%d of %d triangles of the surface were turned over or dropped to make "
                           "it consistent and outward",
                           repaired, s.triangle_count);
    }
    pal_surface_clear(&s);
    return status == PALPATE_OK ? status : pal_fail_prefix(error, status, "%s", place);
}
