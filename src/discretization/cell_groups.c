/// @file cell_groups.c  See cell_groups.h; what the groups are for: method_cell.c.
///
/// A constraint should come with freedoms. Interior nodes bring three each and keep a group of
/// their own; surface nodes, prescribed or not, are joined to the interior neighbour they share
/// most volume with. What has no interior neighbour joins a neighbour that has (edges, corners) or,
/// where there is no interior at all (thin parts), gathers around seeds: a maximal independent set,
/// so that no two seeds are neighbours and every other node has one beside it. Everything goes in
/// node order.
#include "src/discretization/cell_groups.h"

#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

enum { NO_GROUP = -1 };

/// The neighbour of node i with the largest shared volume among those flagged, or -1.
static int32_t strongest(const pal_cell_faces *f, const pal_lists *own, int32_t i,
                         const uint8_t *flag, uint8_t wanted) {
    int32_t best = -1;
    double volume = 0;
    for (int64_t u = own->start[i]; u < own->start[i + 1]; u++) {
        int32_t p = own->item[u];
        const int32_t *ends = &f->pair[2 * (size_t)p];
        int32_t other = ends[0] == i ? ends[1] : ends[0];
        if (flag[other] == wanted && f->volume[p] > volume) {
            volume = f->volume[p];
            best = other;
        }
    }
    return best;
}

/// One round: every node without a group joins that of its strongest neighbour flagged `wanted`;
/// the nodes that joined get flag `joined`.
static void join(const pal_cell_faces *f, const pal_lists *own, int32_t node_count, int32_t *group,
                 uint8_t *flag, uint8_t wanted, uint8_t joined) {
    for (int32_t i = 0; i < node_count; i++) {
        int32_t to = group[i] == NO_GROUP ? strongest(f, own, i, flag, wanted) : -1;
        if (to >= 0) {
            group[i] = group[to];
            flag[i] = joined;
        }
    }
}

pal_status pal_cell_groups(const pal_cloud *cloud, const pal_cell_faces *f, int32_t *group,
                           int32_t *group_count, pal_error *error) {
    enum { NONE, INTERIOR, BESIDE, BEYOND, SEED, GATHERED };
    int32_t n = cloud->node_count, count = 0;
    pal_lists own = {0};
    pal_status status = pal_lists_invert(f->pair, f->pair_count, 2, n, &own, error);
    if (status != PALPATE_OK) {
        return status;
    }
    uint8_t *flag = calloc((size_t)n + 1, 1);
    if (flag == NULL) {
        pal_lists_clear(&own);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cell groups: out of memory");
    }
    for (int32_t i = 0; i < n; i++) {
        group[i] = i < cloud->surface_count ? NO_GROUP : count++;
        flag[i] = i < cloud->surface_count ? NONE : INTERIOR;
    }
    join(f, &own, n, group, flag, INTERIOR, BESIDE);
    join(f, &own, n, group, flag, BESIDE, BEYOND);
    for (int32_t i = 0; i < n; i++) { // seeds among the rest, in node order
        if (group[i] == NO_GROUP && strongest(f, &own, i, flag, SEED) < 0) {
            group[i] = count++;
            flag[i] = SEED;
        }
    }
    join(f, &own, n, group, flag, SEED, GATHERED);
    *group_count = count;
    free(flag);
    pal_lists_clear(&own);
    return PALPATE_OK;
}

pal_status pal_cell_group_gradients(const pal_cloud *cloud, const pal_gradients *nodal,
                                    const int32_t *group, int32_t group_count, double *volume,
                                    pal_gradients *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_lists members = {0};
    pal_scatter sum = {0};
    double *weight = malloc(3 * ((size_t)cloud->node_count + 1) * sizeof *weight);
    pal_status status =
        weight != NULL ? PALPATE_OK
                       : pal_fail(error, PALPATE_ERROR_MEMORY, "group gradients: out of memory");
    if (status == PALPATE_OK) {
        status = pal_lists_invert(group, cloud->node_count, 1, group_count, &members, error);
    }
    if (status == PALPATE_OK) {
        status = pal_scatter_create(&sum, cloud->node_count, 3, error);
    }
    if (status == PALPATE_OK) {
        status = pal_gradients_create(out, group_count, 40 * (int64_t)group_count, error);
    }
    for (int32_t g = 0; g < group_count && status == PALPATE_OK; g++) {
        volume[g] = 0;
        for (int64_t u = members.start[g]; u < members.start[g + 1]; u++) {
            int32_t i = members.item[u];
            volume[g] += cloud->volume[i];
            for (int64_t k = nodal->start[i]; k < nodal->start[i + 1]; k++) {
                double *s = pal_scatter_at(&sum, nodal->node[k]);
                for (int c = 0; c < 3; c++) {
                    s[c] += cloud->volume[i] * nodal->weight[3 * k + c];
                }
            }
        }
        for (int32_t k = 0; k < sum.count; k++) {
            for (size_t c = 0; c < 3; c++) {
                weight[3 * (size_t)k + c] = sum.value[3 * (size_t)sum.node[k] + c] / volume[g];
            }
        }
        status = pal_gradients_append(out, g, sum.count, sum.node, weight, error);
        pal_scatter_empty(&sum);
    }
    free(weight);
    pal_lists_clear(&members);
    pal_scatter_clear(&sum);
    if (status != PALPATE_OK) {
        pal_gradients_clear(out);
    }
    return status;
}
