/// @file skin.c  Displacement and normals at the vertices of the mesh a host draws.
///
/// u(vertex) = sum_k weight_k u(row_k) with stored weights (barycentric at the nearest point of the
/// cloud's surface, made offline by src/cloud/skin.c). A model without such a mesh serves its own
/// surface nodes and triangles. Normals: sum of the deformed triangles' area vectors around a
/// vertex and all others at the same place (twins, where textures are cut), made unit. Thread: any
/// (the reader's); the model and the frame are only read. No allocation.
#include <math.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/model/model.h"

#include <palpate/engine.h>

static void add_row(const pal_frame *frame, int32_t row, float weight, float *u) {
    for (int c = 0; c < 3; c++) {
        u[c] += weight * frame->displacement[3 * (size_t)row + (size_t)c];
    }
}

static void skin_normals(const double *position, const int32_t *triangle, int32_t triangle_count,
                         int32_t count, const float *u, float *normal) {
    memset(normal, 0, (size_t)count * 3 * sizeof *normal);
    for (int32_t t = 0; t < triangle_count; t++) {
        const int32_t *v = triangle + 3 * (size_t)t;
        double x[3][3];
        for (int k = 0; k < 3; k++) {
            for (int c = 0; c < 3; c++) {
                size_t at = 3 * (size_t)v[k] + (size_t)c;
                x[k][c] = position[at] + (double)u[at];
            }
        }
        for (int c = 0; c < 3; c++) {
            int p = (c + 1) % 3, q = (c + 2) % 3;
            float area = (float)((x[1][p] - x[0][p]) * (x[2][q] - x[0][q]) -
                                 (x[1][q] - x[0][q]) * (x[2][p] - x[0][p]));
            for (int k = 0; k < 3; k++) {
                normal[3 * (size_t)v[k] + (size_t)c] += area;
            }
        }
    }
    for (int32_t i = 0; i < count; i++) {
        float *n = normal + 3 * (size_t)i;
        // lengths in double: areas of fine meshes in metres are below 1e-10, squared below float
        double x = (double)n[0], y = (double)n[1], z = (double)n[2];
        double length = sqrt(x * x + y * y + z * z);
        for (int c = 0; c < 3; c++) {
            n[c] = length > 0 ? (float)((double)n[c] / length) : 0.0f;
        }
    }
}

pal_status pal_model_skin(const pal_model *model, const pal_frame *frame, float *displacement,
                          float *normal) {
    if (model == NULL || frame == NULL || displacement == NULL ||
        frame->row_count != model->info.row_count ||
        (frame->row_count > 0 && frame->displacement == NULL)) {
        return PALPATE_ERROR_ARGUMENT;
    }
    int32_t stored = model->info.skin_count;
    int32_t count = stored > 0 ? stored : model->info.surface_count;
    memset(displacement, 0, (size_t)count * 3 * sizeof *displacement);
    if (stored > 0) {
        for (int32_t i = 0; i < count; i++) {
            for (int k = 0; k < PALPATE_SKIN_WEIGHTS; k++) {
                size_t at = (size_t)i * PALPATE_SKIN_WEIGHTS + (size_t)k;
                if (model->skin_row[at] >= 0) {
                    add_row(frame, model->skin_row[at], model->skin_weight[at],
                            displacement + 3 * (size_t)i);
                }
            }
        }
    } else {
        for (int32_t row = 0; row < model->info.row_count; row++) { // rows ascend by node
            if (model->row_node[row] >= count) {
                break;
            }
            add_row(frame, row, 1, displacement + 3 * (size_t)model->row_node[row]);
        }
    }
    if (normal != NULL) {
        int32_t triangles;
        const int32_t *triangle = pal_model_skin_triangles(model, &triangles);
        skin_normals(pal_model_skin_positions(model), triangle, triangles, count, displacement,
                     normal);
        for (size_t i = 0; i < (size_t)stored; i++) { // triangles name one vertex of each place
            memmove(normal + 3 * i, normal + 3 * (size_t)model->skin_twin[i], 3 * sizeof *normal);
        }
    }
    return PALPATE_OK;
}

const double *pal_model_skin_positions(const pal_model *model) {
    if (model == NULL) {
        return NULL;
    }
    return model->info.skin_count > 0 ? model->skin_position : model->position;
}

const int32_t *pal_model_skin_triangles(const pal_model *model, int32_t *count) {
    int stored = model != NULL && model->info.skin_count > 0;
    if (count != NULL) {
        *count = model == NULL ? 0
                 : stored      ? model->skin_triangle_count
                               : model->info.triangle_count;
    }
    if (model == NULL) {
        return NULL;
    }
    return stored ? model->skin_triangle : model->triangle;
}
