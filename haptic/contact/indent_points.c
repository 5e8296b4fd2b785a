/// @file indent_points.c  Where a pressed tool may touch the surface.
///
/// Nodes: touchable, with a compliance column, facing the tool (normal . axis < 0) and under it
/// (nearer to its axis than its radius). A tip so fine that no node is under it, the point tool
/// first of all, touches the point where its axis meets the surface: its displacement is
/// interpolated linearly over the triangle, and its force shared by the same weights (virtual
/// work). Thread: any; the model is only read.
#include "haptic/contact/indent.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

static double dot3(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void cross3(const double a[3], const double b[3], double c[3]) {
    c[0] = a[1] * b[2] - a[2] * b[1];
    c[1] = a[2] * b[0] - a[0] * b[2];
    c[2] = a[0] * b[1] - a[1] * b[0];
}

double pal_tool_extent(const pal_tool_def *tool, double r) {
    if (tool->shape == PALPATE_SHAPE_POINT) {
        return r > 0 ? (double)NAN : 0;
    }
    double half = tool->shape == PALPATE_SHAPE_CAPSULE ? 0.5 * tool->length : 0;
    return r < tool->radius ? half + sqrt((tool->radius - r) * (tool->radius + r)) : (double)NAN;
}

/// Distance of x from the line through `start` along `axis`.
static double distance_from_axis(const double x[3], const double start[3], const double axis[3]) {
    double d[3], c[3];
    for (int k = 0; k < 3; k++) {
        d[k] = x[k] - start[k];
    }
    cross3(d, axis, c);
    return sqrt(dot3(c, c));
}

static int is_touchable(const pal_model *model, int32_t node) {
    return (model->node_flags[node] & PALPATE_NODE_TOUCHABLE) != 0 &&
           (model->node_flags[node] & PALPATE_NODE_FIXED) == 0;
}

/// Column of a node, or -1.
static int32_t column_of(const pal_model *model, int32_t node) {
    int32_t low = 0, high = model->info.column_count;
    while (low < high) {
        int32_t middle = low + (high - low) / 2;
        if (model->column_node[middle] < node) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    return low < model->info.column_count && model->column_node[low] == node ? low : -1;
}

/// The triangle the tool's axis meets nearest to its start, as a point with weights. @return 1 when
/// found
static int find_foot(const pal_model *model, const double start[3], const double axis[3],
                     indent_point *foot) {
    double nearest = INFINITY;
    for (int32_t t = 0; t < model->info.triangle_count; t++) {
        const int32_t *v = model->triangle + 3 * (size_t)t;
        double e1[3], e2[3], s[3], p[3], n[3], b[3];
        for (int k = 0; k < 3; k++) {
            e1[k] = model->position[3 * (size_t)v[1] + (size_t)k] -
                    model->position[3 * (size_t)v[0] + (size_t)k];
            e2[k] = model->position[3 * (size_t)v[2] + (size_t)k] -
                    model->position[3 * (size_t)v[0] + (size_t)k];
            s[k] = start[k] - model->position[3 * (size_t)v[0] + (size_t)k];
        }
        cross3(e1, e2, n);
        double facing = dot3(n, axis);
        if (facing >= 0) {
            continue;
        }
        cross3(axis, e2, p); // Moeller and Trumbore
        double inverse = 1 / dot3(e1, p);
        b[1] = dot3(s, p) * inverse;
        cross3(s, e1, p);
        b[2] = dot3(axis, p) * inverse;
        b[0] = 1 - b[1] - b[2];
        double along = dot3(e2, p) * inverse;
        if (b[0] < -1e-9 || b[1] < -1e-9 || b[2] < -1e-9 || fabs(along) >= nearest) {
            continue;
        }
        nearest = fabs(along);
        *foot = (indent_point){.nodes = 3, .chosen = -1};
        for (int k = 0; k < 3; k++) {
            foot->column[k] = is_touchable(model, v[k]) ? column_of(model, v[k]) : -1;
            foot->weight[k] = b[k];
            foot->x[k] = start[k] + along * axis[k];
        }
    }
    return isfinite(nearest) && foot->column[0] >= 0 && foot->column[1] >= 0 &&
           foot->column[2] >= 0;
}

pal_status pal_indent_points(const pal_model *model, const pal_tool_def *tool, const double axis[3],
                             indent_point **out, int32_t *count, pal_error *error) {
    *out = NULL;
    *count = 0;
    indent_point *point = calloc((size_t)model->info.column_count + 1, sizeof *point);
    if (point == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "tool '%s': no memory for %d contact points",
                        tool->name, (int)model->info.column_count);
    }
    int32_t n = 0;
    for (int32_t c = 0; c < model->info.column_count && tool->shape != PALPATE_SHAPE_POINT; c++) {
        int32_t node = model->column_node[c];
        if (node >= model->info.surface_count || !is_touchable(model, node) ||
            dot3(model->normal + 3 * (size_t)node, axis) >= 0) {
            continue;
        }
        const double *x = model->position + 3 * (size_t)node;
        if (!isfinite(pal_tool_extent(tool, distance_from_axis(x, tool->start, axis)))) {
            continue;
        }
        indent_point *p = &point[n++];
        p->nodes = 1;
        p->column[0] = c;
        p->weight[0] = 1;
        p->chosen = -1;
        p->area = -dot3(model->area_vector + 3 * (size_t)node, axis);
        memcpy(p->x, x, sizeof p->x);
    }
    if (n == 0 && find_foot(model, tool->start, axis, &point[0])) {
        n = 1;
    }
    if (n == 0) {
        free(point);
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "tool '%s': pressed from (%g, %g, %g) along (%g, %g, %g) it meets no touchable place "
            "of the surface; correct its start and axis, or body.touchable",
            tool->name, tool->start[0], tool->start[1], tool->start[2], axis[0], axis[1], axis[2]);
    }
    *out = point;
    *count = n;
    return PALPATE_OK;
}
