/// @file cell_patches.c  Joining surface cells to interior ones (see cell_patches.h).
#include "src/cell_patches.h"

#include <stdlib.h>
#include <string.h>

#include "haptic/error.h"

/// The node whose patch each node belongs to.
static void choose_masters(const pal_cloud *cloud, const pal_cell_faces *faces, int32_t *master,
                           double *shared) {
    for (int32_t i = 0; i < cloud->node_count; i++) {
        master[i] = i;
        shared[i] = 0.0;
    }
    for (int32_t q = 0; q < faces->pair_count; q++) { // pairs ascend: the first of equals wins
        for (int end = 0; end < 2; end++) {
            int32_t a = faces->pair[2 * (size_t)q + (size_t)end];
            int32_t b = faces->pair[2 * (size_t)q + (size_t)(1 - end)];
            if (a < cloud->surface_count && b >= cloud->surface_count &&
                faces->volume[q] > shared[a]) {
                shared[a] = faces->volume[q];
                master[a] = b;
            }
        }
    }
}

/// Mean gradient over one patch: its nodes' gradients weighted by their volumes.
static pal_status join(const pal_cloud *cloud, const pal_gradients *nodal, const pal_lists *members,
                       int32_t i, int32_t patch, pal_scatter *sum, double *weight,
                       pal_gradients *out, double *volume, pal_error *error) {
    double total = 0.0;
    for (int64_t u = members->start[i]; u < members->start[i + 1]; u++) {
        int32_t j = members->item[u];
        total += cloud->volume[j];
        for (int64_t k = nodal->start[j]; k < nodal->start[j + 1]; k++) {
            double *s = pal_scatter_at(sum, nodal->node[k]);
            for (int c = 0; c < 3; c++) {
                s[c] += cloud->volume[j] * nodal->weight[3 * k + c];
            }
        }
    }
    for (int32_t k = 0; k < sum->count; k++) {
        for (size_t c = 0; c < 3; c++) {
            weight[3 * (size_t)k + c] = sum->value[3 * (size_t)sum->node[k] + c] / total;
        }
    }
    *volume = total;
    pal_status status = pal_gradients_append(out, patch, sum->count, sum->node, weight, error);
    pal_scatter_empty(sum);
    return status;
}

pal_status pal_cell_patches(const pal_cloud *cloud, const pal_cell_faces *faces,
                            const pal_gradients *nodal, pal_gradients *out, double **volume,
                            pal_error *error) {
    size_t n = (size_t)cloud->node_count;
    int32_t *master = malloc((n + 1) * sizeof *master);
    double *work = malloc(3 * (n + 1) * sizeof *work);
    pal_lists members = {0};
    pal_scatter sum = {0};
    pal_status status = PALPATE_OK;
    memset(out, 0, sizeof *out);
    *volume = malloc((n + 1) * sizeof **volume);
    if (master == NULL || work == NULL || *volume == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "dilatation patches: out of memory");
    }
    int32_t count = 0;
    if (status == PALPATE_OK) {
        choose_masters(cloud, faces, master, work);
        status = pal_lists_invert(master, cloud->node_count, 1, cloud->node_count, &members, error);
    }
    if (status == PALPATE_OK) {
        for (size_t i = 0; i < n; i++) {
            count += members.start[i + 1] > members.start[i];
        }
        status = pal_gradients_create(out, count, nodal->start[n], error);
    }
    if (status == PALPATE_OK) {
        status = pal_scatter_create(&sum, cloud->node_count, 3, error);
    }
    for (int32_t i = 0, patch = 0; status == PALPATE_OK && i < cloud->node_count; i++) {
        if (members.start[i + 1] > members.start[i]) {
            status = join(cloud, nodal, &members, i, patch, &sum, work, out, &(*volume)[patch], error);
            patch++;
        }
    }
    pal_scatter_clear(&sum);
    pal_lists_clear(&members);
    free(work);
    free(master);
    if (status != PALPATE_OK) {
        pal_gradients_clear(out);
        free(*volume);
        *volume = NULL;
    }
    return status;
}
