/// @file surface_mesh.c  Corners of the deformed surface for drawing (see surface_mesh.h).
#include "haptic/view/surface_mesh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

/// Faces whose rest normals differ by more than this are separated by a crease.
static const float CREASE_COSINE = 0.70F;

static void face_normals(pal_surface_mesh *m) {
    for (int32_t t = 0; t < m->triangle_count; t++) {
        float x[3][3];
        for (int k = 0; k < 3; k++) {
            int32_t v = m->triangle[3 * t + k];
            for (int d = 0; d < 3; d++) {
                x[k][d] = (float)m->rest[3 * v + d] + m->displacement[3 * v + d];
            }
        }
        float a[3], b[3];
        for (int d = 0; d < 3; d++) {
            a[d] = x[1][d] - x[0][d];
            b[d] = x[2][d] - x[0][d];
        }
        float *n = m->face_normal + 3 * t;
        n[0] = a[1] * b[2] - a[2] * b[1];
        n[1] = a[2] * b[0] - a[0] * b[2];
        n[2] = a[0] * b[1] - a[1] * b[0];
    }
}

static float cosine(const float *a, const float *b) {
    float ab = a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
    float aa = a[0] * a[0] + a[1] * a[1] + a[2] * a[2],
          bb = b[0] * b[0] + b[1] * b[1] + b[2] * b[2];
    return aa > 0.0F && bb > 0.0F ? ab / sqrtf(aa * bb) : 1.0F;
}

/// For each corner, the faces around its vertex on the same side of every crease (rest shape).
static pal_status group_corners(pal_surface_mesh *m, pal_error *error) {
    size_t corners = 3 * (size_t)m->triangle_count;
    int32_t *start = calloc((size_t)m->vertex_count + 2, sizeof *start);
    int32_t *item = malloc((corners + 1) * sizeof *item);
    pal_status status = PALPATE_OK;
    m->group_start = malloc((corners + 1) * sizeof *m->group_start);
    if (start == NULL || item == NULL || m->group_start == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the picture's mesh");
    }
    for (int pass = 0; status == PALPATE_OK && pass < 2; pass++) {
        if (pass == 0) {
            for (size_t c = 0; c < corners; c++) {
                start[m->triangle[c] + 2]++;
            }
            for (int32_t v = 1; v <= m->vertex_count + 1; v++) {
                start[v] += start[v - 1];
            }
            for (size_t c = 0; c < corners; c++) {
                item[start[m->triangle[c] + 1]++] = (int32_t)(c / 3);
            }
        } else {
            m->group_face = malloc(((size_t)m->group_start[corners] + 1) * sizeof *m->group_face);
            if (m->group_face == NULL) {
                status =
                    pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the picture's mesh");
                break;
            }
        }
        int32_t at = 0;
        for (size_t c = 0; c < corners; c++) {
            int32_t v = m->triangle[c];
            m->group_start[c] = at;
            for (int32_t e = start[v]; e < start[v + 1]; e++) {
                if (cosine(m->face_normal + 3 * (c / 3), m->face_normal + 3 * (size_t)item[e]) >
                    CREASE_COSINE) {
                    if (pass == 1) {
                        m->group_face[at] = item[e];
                    }
                    at++;
                }
            }
        }
        m->group_start[corners] = at;
    }
    free(item);
    free(start);
    return status;
}

pal_status pal_surface_mesh_create(const pal_model *model, pal_surface_mesh *out,
                                   pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_model_info info;
    pal_model_get_info(model, &info);
    out->model = model;
    if (info.skin_count > 0) {
        out->vertex_count = info.skin_count;
        out->rest = pal_model_skin_positions(model);
        out->triangle = pal_model_skin_triangles(model, &out->triangle_count);
    } else {
        out->vertex_count = info.surface_count;
        out->rest = pal_model_positions(model);
        out->triangle = pal_model_triangles(model);
        out->triangle_count = info.triangle_count;
    }
    size_t v = (size_t)out->vertex_count, t = (size_t)out->triangle_count;
    out->displacement = calloc(3 * v + 1, sizeof *out->displacement);
    out->face_normal = calloc(3 * t + 1, sizeof *out->face_normal);
    out->corner = calloc(3 * t * PALPATE_CORNER_FLOATS + 1, sizeof *out->corner);
    pal_status status = PALPATE_OK;
    if (!out->displacement || !out->face_normal || !out->corner) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the picture's mesh");
    }
    if (status == PALPATE_OK) {
        face_normals(out);
        status = group_corners(out, error);
    }
    if (status != PALPATE_OK) {
        pal_surface_mesh_clear(out);
    }
    return status;
}

void pal_surface_mesh_clear(pal_surface_mesh *m) {
    free(m->displacement);
    free(m->face_normal);
    free(m->group_start);
    free(m->group_face);
    free(m->corner);
    memset(m, 0, sizeof *m);
}

static void take_displacement(pal_surface_mesh *m, const pal_frame *frame) {
    memset(m->displacement, 0, 3 * (size_t)m->vertex_count * sizeof *m->displacement);
    if (frame == NULL || frame->displacement == NULL) {
        return;
    }
    if (m->rest == pal_model_skin_positions(m->model)) {
        (void)pal_model_skin(m->model, frame, m->displacement, NULL);
        return;
    }
    const int32_t *row = pal_model_rows(m->model);
    for (int32_t i = 0; i < frame->row_count; i++) {
        if (row[i] < m->vertex_count) {
            memcpy(m->displacement + 3 * row[i], frame->displacement + 3 * i, 3 * sizeof(float));
        }
    }
}

void pal_surface_mesh_update(pal_surface_mesh *m, const pal_frame *frame) {
    take_displacement(m, frame);
    face_normals(m);
    m->largest = 0.0F;
    for (int32_t c = 0; c < 3 * m->triangle_count; c++) {
        int32_t v = m->triangle[c];
        const float *u = m->displacement + 3 * v;
        float *out = m->corner + (size_t)c * PALPATE_CORNER_FLOATS;
        float n[3] = {0.0F, 0.0F, 0.0F};
        for (int32_t e = m->group_start[c]; e < m->group_start[c + 1]; e++) {
            const float *f = m->face_normal + 3 * (size_t)m->group_face[e];
            n[0] += f[0];
            n[1] += f[1];
            n[2] += f[2];
        }
        float size = sqrtf(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (int d = 0; d < 3; d++) {
            out[d] = (float)m->rest[3 * v + d] + u[d];
            out[3 + d] = size > 0.0F ? n[d] / size : 0.0F;
        }
        out[6] = sqrtf(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
        m->largest = out[6] > m->largest ? out[6] : m->largest;
    }
}
