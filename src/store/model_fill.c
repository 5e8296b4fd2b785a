/// @file model_fill.c  From scene, cloud and node sets to the model's tables (see model_fill.h).
#include "src/store/model_fill.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/cloud/locate.h"
#include "src/discretization/neighbours.h"
#include "src/solution/memory_plan.h"

enum { SURFACE_CANDIDATES = 8 };

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the model's tables");
}

/// Nodes, normals, areas and triangles in metres.
static pal_status fill_geometry(const pal_cloud *cloud, const pal_node_sets *sets, pal_model *m,
                                pal_error *error) {
    pal_model_info *info = &m->info;
    size_t n = (size_t)cloud->node_count, s = (size_t)cloud->surface_count;
    size_t t = (size_t)cloud->triangle_count;
    double length = cloud->length;
    info->node_count = cloud->node_count;
    info->surface_count = cloud->surface_count;
    info->triangle_count = cloud->triangle_count;
    info->fixed_count = sets->fixed_count;
    info->touchable_count = sets->touchable_count;
    m->position = malloc(3 * n * sizeof *m->position);
    m->normal = malloc(3 * s * sizeof *m->normal);
    m->area_vector = malloc(3 * s * sizeof *m->area_vector);
    m->triangle = malloc(3 * t * sizeof *m->triangle);
    m->node_flags = malloc(n);
    if (!m->position || !m->normal || !m->area_vector || !m->triangle || !m->node_flags) {
        return no_memory(error);
    }
    for (size_t i = 0; i < 3 * n; i++) {
        m->position[i] = length * cloud->position[i];
    }
    memcpy(m->normal, cloud->normal, 3 * s * sizeof *m->normal);
    for (size_t i = 0; i < 3 * s; i++) {
        m->area_vector[i] = length * length * cloud->area_vector[i];
    }
    memcpy(m->triangle, cloud->triangle, 3 * t * sizeof *m->triangle);
    memcpy(m->node_flags, sets->flags, n);
    pal_cloud_report report;
    pal_cloud_measure(cloud, &report);
    info->spacing_min = report.spacing_min;
    info->spacing_mean = report.spacing_mean;
    info->spacing_max = report.spacing_max;
    info->volume = report.volume;
    for (int d = 0; d < 3; d++) {
        info->bounds_min[d] = INFINITY;
        info->bounds_max[d] = -INFINITY;
    }
    for (size_t i = 0; i < n; i++) {
        for (int d = 0; d < 3; d++) {
            // NOLINTNEXTLINE(*.CallAndMessage): all 3 n positions are set above
            info->bounds_min[d] = fmin(info->bounds_min[d], m->position[3 * i + (size_t)d]);
            info->bounds_max[d] = fmax(info->bounds_max[d], m->position[3 * i + (size_t)d]);
        }
    }
    return PALPATE_OK;
}

/// Columns: touchable and patch nodes. Rows: what the scene wants stored.
static pal_status fill_sets(const pal_scene *scene, const pal_node_sets *sets, pal_model *m,
                            pal_error *error) {
    pal_model_info *info = &m->info;
    int32_t n = info->node_count;
    int32_t *index = malloc((size_t)n * sizeof *index); // column of each node, -1: none
    if (index == NULL) {
        return no_memory(error);
    }
    for (int32_t i = 0; i < n; i++) {
        index[i] = sets->flags[i] & PALPATE_NODE_TOUCHABLE ? 0 : -1;
    }
    for (int32_t e = 0; e < sets->patch_start[sets->patch_count]; e++) {
        index[sets->patch_node[e]] = 0;
    }
    int32_t columns = 0;
    for (int32_t i = 0; i < n; i++) {
        if (index[i] == 0) {
            index[i] = columns++;
        }
    }
    info->column_count = columns;
    info->row_count = scene->store_rows == PALPATE_STORE_NONE      ? 0
                      : scene->store_rows == PALPATE_STORE_SURFACE ? info->surface_count
                                                                   : n;
    // a tolerance chooses the form of the rows itself, from rows that are more exact
    info->field_tolerance = info->row_count > 0 ? scene->store_tolerance : 0;
    info->precision = pal_memory_plan_precision(scene->store_tolerance, scene->precision);
    info->patch_count = sets->patch_count;
    m->column_node = malloc(((size_t)columns + 1) * sizeof *m->column_node);
    m->row_node = malloc(((size_t)info->row_count + 1) * sizeof *m->row_node);
    m->patch = calloc((size_t)sets->patch_count + 1, sizeof *m->patch);
    pal_status status = PALPATE_OK;
    if (m->column_node == NULL || m->row_node == NULL || m->patch == NULL) {
        status = no_memory(error);
        info->patch_count = 0;
    }
    for (int32_t i = 0; status == PALPATE_OK && i < n; i++) {
        if (index[i] >= 0) {
            m->column_node[index[i]] = i;
        }
    }
    for (int32_t i = 0; status == PALPATE_OK && i < info->row_count; i++) {
        m->row_node[i] = i;
    }
    for (int32_t p = 0; status == PALPATE_OK && p < sets->patch_count; p++) {
        pal_patch *patch = &m->patch[p];
        int32_t first = sets->patch_start[p], count = sets->patch_start[p + 1] - first;
        (void)snprintf(patch->name, sizeof patch->name, "%s", scene->patch[p].name);
        patch->column = malloc(((size_t)count + 1) * sizeof *patch->column);
        if (patch->column == NULL) {
            status = no_memory(error);
            break;
        }
        patch->count = count;
        for (int32_t k = 0; k < count; k++) {
            patch->column[k] = index[sets->patch_node[first + k]];
        }
    }
    free(index);
    if (status == PALPATE_OK && columns == 0) {
        char place[1400];
        status =
            pal_fail(error, PALPATE_ERROR_SCENE,
                     "%s: no surface node is touchable and there is no patch, so there is nothing "
                     "to press; let body.touchable or body.patches select free surface nodes",
                     pal_place_text(scene, &scene->touchable_place, place, sizeof place));
    }
    return status;
}

/// Interpolation weights of the probes; each must lie in the body (or within half a spacing of it:
/// points of a curved surface lie outside the triangles that approximate it).
static pal_status fill_probes(const pal_scene *scene, const pal_cloud *cloud, pal_model *m,
                              pal_probe_weights *probes, pal_error *error) {
    pal_neighbours near = {0};
    m->probe = calloc((size_t)scene->probe_count + 1, sizeof *m->probe);
    if (m->probe == NULL) {
        return no_memory(error);
    }
    m->info.probe_count = scene->probe_count;
    pal_status status = PALPATE_OK;
    pal_triangle_ring ring = {0};
    if (scene->probe_count > 0) {
        status = pal_neighbours_create(&near, cloud->position, cloud->surface_count, error);
    }
    if (status == PALPATE_OK) {
        status = pal_triangle_ring_build(cloud, &ring, error);
    }
    for (int32_t p = 0; status == PALPATE_OK && p < scene->probe_count; p++) {
        double x[3], weight[3], square[SURFACE_CANDIDATES], distance = 0.0;
        int32_t node[SURFACE_CANDIDATES];
        char place[1400];
        (void)snprintf(m->probe[p].name, sizeof m->probe[p].name, "%s", scene->probe[p].name);
        for (int d = 0; d < 3; d++) {
            m->probe[p].position[d] = scene->probe[p].position[d];
            x[d] = scene->probe[p].position[d] / cloud->length;
        }
        if (pal_cloud_winding(cloud, x) < 0.5) {
            int32_t count = pal_neighbours_nearest(&near, x, SURFACE_CANDIDATES, node, square);
            (void)pal_cloud_nearest_triangle(cloud, &ring, node, count, x, &distance, weight);
            double allowed = 0.5 * cloud->spacing[node[0]];
            if (distance > allowed) {
                status =
                    pal_fail(error, PALPATE_ERROR_SCENE,
                             "%s: the probe at (%g, %g, %g) lies outside the body, %.3g m from its "
                             "surface; move it inside",
                             pal_place_text(scene, &scene->probe[p].place, place, sizeof place),
                             scene->probe[p].position[0], scene->probe[p].position[1],
                             scene->probe[p].position[2], distance * cloud->length);
                break;
            }
        }
        int32_t used =
            pal_interpolate(cloud, x, PALPATE_PROBE_NODES, probes[p].node, probes[p].weight);
        if (used < 0) {
            status =
                pal_fail(error, (pal_status)used, "%s: the solution cannot be interpolated there",
                         pal_place_text(scene, &scene->probe[p].place, place, sizeof place));
        }
        probes[p].count = used;
    }
    pal_triangle_ring_clear(&ring);
    pal_neighbours_clear(&near);
    return status;
}

pal_status pal_model_fill(const pal_scene *scene, const pal_cloud *cloud, const pal_node_sets *sets,
                          pal_model *model, pal_probe_weights *probes, pal_error *error) {
    static const char *const method_name[] = {"point", "cell", "galerkin"};
    pal_status status = fill_geometry(cloud, sets, model, error);
    if (status == PALPATE_OK) {
        status = fill_sets(scene, sets, model, error);
    }
    if (status == PALPATE_OK) {
        status = fill_probes(scene, cloud, model, probes, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    pal_model_info *info = &model->info;
    info->young = scene->young;
    info->poisson = scene->poisson;
    info->density = scene->density;
    (void)snprintf(info->method, sizeof info->method, "%s", method_name[scene->method.kind]);
    model->runtime = scene->runtime;
    if (scene->canonical != NULL) {
        model->scene_text = strdup(scene->canonical);
        if (model->scene_text == NULL) {
            return no_memory(error);
        }
    }
    return PALPATE_OK;
}
