/// @file discretization.c  Which method builds a system; clearing; interpolation of a solution.
#include "src/discretization/discretization.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/discretization/mls.h"

void pal_system_clear(pal_system *system) {
    free(system->dof_unknown);
    free(system->fixed_node);
    pal_sparse_clear(&system->matrix);
    pal_sparse_clear(&system->load);
    pal_sparse_clear(&system->reaction);
    memset(system, 0, sizeof *system);
}

/// The `count` nodes of [0, node_count) nearest to x, ascending in (squared distance, index).
static int32_t nearest_nodes(const double *position, int32_t node_count, const double x[3],
                             int32_t count, int32_t *node, double *distance2) {
    int32_t found = 0;
    for (int32_t i = 0; i < node_count; i++) {
        const double *p = position + 3 * (int64_t)i;
        double dx = p[0] - x[0], dy = p[1] - x[1], dz = p[2] - x[2];
        double d2 = dx * dx + dy * dy + dz * dz;
        if (found == count && d2 >= distance2[found - 1]) {
            continue; // equal distance: the smaller index, which came first, stays
        }
        int32_t at = found < count ? found++ : count - 1;
        for (; at > 0 && distance2[at - 1] > d2; at--) {
            node[at] = node[at - 1];
            distance2[at] = distance2[at - 1];
        }
        node[at] = i;
        distance2[at] = d2;
    }
    return found;
}

int32_t pal_interpolate_nodes(const double *position, int32_t node_count, const double x[3],
                              int32_t capacity, int32_t *node, double *weight) {
    enum { WANTED = 16 };
    int32_t index[WANTED];
    double distance2[WANTED], gathered[3 * WANTED] = {0}, phi[WANTED];
    if (position == NULL || node_count <= 0 || capacity <= 0 || node == NULL || weight == NULL ||
        !isfinite(x[0]) || !isfinite(x[1]) || !isfinite(x[2])) {
        return PALPATE_ERROR_ARGUMENT;
    }
    int32_t wanted = capacity < WANTED ? capacity : WANTED;
    int32_t count = nearest_nodes(position, node_count, x, wanted, index, distance2);
    // on a node (or nothing but one place to go by): that node
    double last = distance2[count - 1];
    if (distance2[0] <= 1e-24 * last || last == 0.0 || count <= 1) {
        node[0] = index[0];
        weight[0] = 1.0;
        return 1;
    }
    for (int32_t j = 0; j < count; j++) {
        memcpy(gathered + 3 * j, position + 3 * (int64_t)index[j], 3 * sizeof *gathered);
    }
    pal_mls mls = {0};
    pal_mls_options options = {
        .basis = PALPATE_BASIS_LINEAR, .exponent = 2, .order = 0, .accept_deficient = 1};
    pal_status status =
        pal_mls_shape(&mls, &options, x, 1.2 * sqrt(last), count, gathered, phi, NULL, NULL, NULL);
    pal_mls_clear(&mls);
    if (status != PALPATE_OK) {
        return status;
    }
    for (int32_t j = 0; j < count; j++) {
        node[j] = index[j];
        weight[j] = phi[j];
    }
    return count;
}

int32_t pal_interpolate(const pal_cloud *cloud, const double x[3], int32_t capacity, int32_t *node,
                        double *weight) {
    return pal_interpolate_nodes(cloud->position, cloud->node_count, x, capacity, node, weight);
}

pal_status pal_discretize(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                          const pal_method *method, const pal_progress *progress, pal_system *out,
                          pal_error *error) {
    if (out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "discretization: no system to build into");
    }
    memset(out, 0, sizeof *out);
    if (cloud == NULL || cloud->node_count <= 0 || fixed == NULL || method == NULL) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "discretization: a cloud with nodes, the fixed flags and a method are needed");
    }
    if (!(poisson > -1.0 && poisson < 0.5)) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "discretization: Poisson's ratio %g must lie between -1 and 0.5; for a nearly "
            "incompressible body use 0.49 to 0.4999 with method: {kind: galerkin}",
            poisson);
    }
    switch (method->kind) {
    case PALPATE_METHOD_POINT:
        return pal_method_point(cloud, fixed, poisson, method, progress, out, error);
    case PALPATE_METHOD_CELL:
        return pal_method_cell(cloud, fixed, poisson, method, progress, out, error);
    case PALPATE_METHOD_GALERKIN:
        return pal_method_galerkin(cloud, fixed, poisson, method, progress, out, error);
    }
    return pal_fail(error, PALPATE_ERROR_ARGUMENT, "discretization: no method has number %d",
                    (int)method->kind);
}
