/// @file cell_faces.c  See cell_faces.h for the geometry. Loops run in element order:
/// deterministic.
#include "src/discretization/cell_faces.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

static const int EDGE[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};

void pal_cell_faces_clear(pal_cell_faces *f) {
    if (f != NULL) {
        free(f->pair);
        free(f->wall);
        free(f->volume);
        free(f->tet_pair);
        free(f->hat);
        free(f->tet_volume);
        memset(f, 0, sizeof *f);
    }
}

/// Barycentric gradients and volume of one tetrahedron.
/// @return condition number of its edge matrix (Frobenius, >= 3), or 0 when it has no volume
static double tet_hats(const pal_cloud *cloud, int32_t t, double hat[12], double *volume) {
    const int32_t *v = &cloud->tet[4 * (size_t)t];
    double e[3][3], norm2 = 0, inverse2 = 0;
    for (int k = 0; k < 3; k++) {
        for (int c = 0; c < 3; c++) {
            e[k][c] = cloud->position[3 * (size_t)v[k + 1] + (size_t)c] -
                      cloud->position[3 * (size_t)v[0] + (size_t)c];
            norm2 += e[k][c] * e[k][c];
        }
    }
    double n[3][3];
    v3_cross(e[1], e[2], n[0]);
    v3_cross(e[2], e[0], n[1]);
    v3_cross(e[0], e[1], n[2]);
    double six = e[0][0] * n[0][0] + e[0][1] * n[0][1] + e[0][2] * n[0][2];
    *volume = six / 6;
    // below this the difference of the coordinates has no correct digit left
    if (!(six > 1e-15 * norm2 * sqrt(norm2))) {
        return 0;
    }
    for (int c = 0; c < 3; c++) {
        for (int k = 0; k < 3; k++) {
            hat[3 * (k + 1) + c] = n[k][c] / six;
            inverse2 += hat[3 * (k + 1) + c] * hat[3 * (k + 1) + c];
        }
        hat[c] = -(hat[3 + c] + hat[6 + c] + hat[9 + c]);
    }
    return sqrt(norm2 * inverse2);
}

/// Number the pairs in order of first appearance. head/next: chains of pairs by their lower node.
static void number_pairs(const pal_cloud *cloud, pal_cell_faces *f, int32_t *head, int32_t *next) {
    for (int32_t i = 0; i < cloud->node_count; i++) {
        head[i] = -1;
    }
    for (int32_t t = 0; t < cloud->tet_count; t++) {
        for (int k = 0; k < 6; k++) {
            int32_t a = cloud->tet[4 * (size_t)t + (size_t)EDGE[k][0]];
            int32_t b = cloud->tet[4 * (size_t)t + (size_t)EDGE[k][1]];
            int32_t low = a < b ? a : b, high = a < b ? b : a, p = head[low];
            while (p >= 0 && f->pair[2 * (size_t)p + 1] != high) {
                p = next[p];
            }
            if (p < 0) {
                p = f->pair_count++;
                f->pair[2 * (size_t)p] = low;
                f->pair[2 * (size_t)p + 1] = high;
                next[p] = head[low];
                head[low] = p;
            }
            f->tet_pair[6 * (size_t)t + (size_t)k] = p;
        }
    }
}

static pal_status measure_tets(const pal_cloud *cloud, pal_cell_faces *f, pal_error *error) {
    for (int32_t t = 0; t < f->tet_count; t++) {
        const int32_t *v = &cloud->tet[4 * (size_t)t];
        double *hat = &f->hat[12 * (size_t)t], centre[3], volume;
        for (int c = 0; c < 3; c++) {
            centre[c] = 0;
            for (int k = 0; k < 4; k++) {
                centre[c] += cloud->position[3 * (size_t)v[k] + (size_t)c] / 4;
            }
        }
        double shape = tet_hats(cloud, t, hat, &volume);
        if (!(shape > 0)) {
            return pal_fail(
                error, PALPATE_ERROR_STENCIL,
                "node cells: tetrahedron %d (nodes %d %d %d %d) at (%.6g, %.6g, %.6g) m "
                "has no volume (%.3g); use another spacing so that the cloud is remade",
                t, v[0], v[1], v[2], v[3], cloud->length * centre[0], cloud->length * centre[1],
                cloud->length * centre[2], volume);
        }
        if (shape > f->worst_shape) {
            f->worst_shape = shape;
            memcpy(f->worst_point, centre, sizeof centre);
        }
        f->tet_volume[t] = volume;
        for (int k = 0; k < 6; k++) {
            int32_t p = f->tet_pair[6 * (size_t)t + (size_t)k];
            int a = EDGE[k][0], b = EDGE[k][1];
            double sign = v[a] < v[b] ? 0.25 : -0.25;
            f->volume[p] += volume / 6;
            for (int c = 0; c < 3; c++) {
                f->wall[3 * (size_t)p + (size_t)c] +=
                    sign * volume * (hat[3 * b + c] - hat[3 * a + c]);
            }
        }
    }
    return PALPATE_OK;
}

pal_status pal_cell_faces_create(const pal_cloud *cloud, pal_cell_faces *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    size_t tets = (size_t)cloud->tet_count, nodes = (size_t)cloud->node_count;
    if (cloud->tet_count < 1 || cloud->tet_count > INT32_MAX / 12) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "node cells: %d tetrahedra, allowed 1 to %d",
                        cloud->tet_count, INT32_MAX / 12);
    }
    out->tet_count = cloud->tet_count;
    out->pair = malloc(12 * tets * sizeof *out->pair);
    out->tet_pair = malloc(6 * tets * sizeof *out->tet_pair);
    out->hat = malloc(12 * tets * sizeof *out->hat);
    out->tet_volume = malloc(tets * sizeof *out->tet_volume);
    int32_t *head = malloc((nodes + 1) * sizeof *head), *next = malloc(6 * tets * sizeof *next);
    pal_status status = PALPATE_ERROR_MEMORY;
    if (out->pair != NULL && out->tet_pair != NULL && out->hat != NULL && out->tet_volume != NULL &&
        head != NULL && next != NULL) {
        number_pairs(cloud, out, head, next);
        size_t pairs = (size_t)out->pair_count;
        int32_t *shrunk = realloc(out->pair, 2 * pairs * sizeof *shrunk);
        if (shrunk != NULL) {
            out->pair = shrunk;
        }
        out->wall = calloc(3 * pairs, sizeof *out->wall);
        out->volume = calloc(pairs, sizeof *out->volume);
        if (out->wall != NULL && out->volume != NULL) {
            status = measure_tets(cloud, out, error);
        }
    }
    free(head);
    free(next);
    if (status == PALPATE_ERROR_MEMORY) {
        pal_fail(error, status,
                 "node cells: out of memory for %d tetrahedra; use a coarser spacing",
                 cloud->tet_count);
    }
    if (status != PALPATE_OK) {
        pal_cell_faces_clear(out);
    }
    return status;
}

/// Volume-weighted mean of the hat gradients over each group of tetrahedra.
static pal_status average(const pal_cloud *cloud, const pal_cell_faces *f, const int32_t *table,
                          int32_t per_tet, int32_t groups, pal_gradients *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_lists tets = {0};
    pal_scatter sum = {0};
    double *weight = NULL;
    pal_status status = pal_lists_invert(table, f->tet_count, per_tet, groups, &tets, error);
    if (status == PALPATE_OK) {
        status = pal_scatter_create(&sum, cloud->node_count, 3, error);
    }
    if (status == PALPATE_OK) {
        status = pal_gradients_create(out, groups, 12 * (int64_t)groups, error);
    }
    if (status == PALPATE_OK) {
        weight = malloc(3 * ((size_t)cloud->node_count + 1) * sizeof *weight);
        if (weight == NULL) {
            status = pal_fail(error, PALPATE_ERROR_MEMORY, "mean gradients: out of memory");
        }
    }
    for (int32_t q = 0; q < groups && status == PALPATE_OK; q++) {
        double volume = 0;
        for (int64_t k = tets.start[q]; k < tets.start[q + 1]; k++) {
            int32_t t = tets.item[k];
            double v = f->tet_volume[t];
            volume += v;
            for (int a = 0; a < 4; a++) {
                double *s = pal_scatter_at(&sum, cloud->tet[4 * (size_t)t + (size_t)a]);
                for (int c = 0; c < 3; c++) {
                    s[c] += v * f->hat[12 * (size_t)t + (size_t)(3 * a + c)];
                }
            }
        }
        for (int32_t k = 0; k < sum.count; k++) {
            for (int c = 0; c < 3; c++) {
                weight[3 * k + c] = sum.value[3 * (size_t)sum.node[k] + (size_t)c] / volume;
            }
        }
        status = pal_gradients_append(out, q, sum.count, sum.node, weight, error);
        pal_scatter_empty(&sum);
    }
    free(weight);
    pal_scatter_clear(&sum);
    pal_lists_clear(&tets);
    if (status != PALPATE_OK) {
        pal_gradients_clear(out);
    }
    return status;
}

pal_status pal_cell_pair_gradients(const pal_cloud *cloud, const pal_cell_faces *faces,
                                   pal_gradients *out, pal_error *error) {
    return average(cloud, faces, faces->tet_pair, 6, faces->pair_count, out, error);
}

pal_status pal_cell_node_gradients(const pal_cloud *cloud, const pal_cell_faces *faces,
                                   pal_gradients *out, pal_error *error) {
    return average(cloud, faces, cloud->tet, 4, cloud->node_count, out, error);
}
