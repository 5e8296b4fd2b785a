/// How many nodes a scene asks for, before a mesher is started on it.
///
/// A volume mesh of edge length h has about 1.1 V / h^3 nodes, surface included (measured on the
/// shipped scenes; a close packing would have sqrt(2)). A zone with spacing h_z grows outwards as
/// h = h_z + g d, so a ball zone of radius r adds the integral of 4 pi s^2 (1/h^3 - 1/h0^3) up to
/// where h reaches h0, and a rim of length L that of pi s L over its half disc inside the body.
/// Balls are taken half inside the body (they stand on its surface) and never larger than it. Good
/// to a factor of 2 or so: it decides what is absurd, no more.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/scene/scene_size.h"

static const double PI = 3.14159265358979323846;
static const double DENSITY = 1.1;

/// Nodes that a zone adds to a body of spacing h0 and volume V.
/// @param radius  of the ball; 0 for a rim
/// @param length  of the rim
static double zone_nodes(double h0, double growth, double volume, double radius, double length,
                         double h) {
    enum { STEPS = 400 };
    if (!(h < h0)) {
        return 0.0;
    }
    double density0 = 1.0 / (h0 * h0 * h0);
    double inside = length > 0.0 ? 0.0 : fmin(2.0 / 3.0 * PI * radius * radius * radius, volume);
    double nodes = inside * (1.0 / (h * h * h) - density0);
    double step = (h0 - h) / growth / STEPS;
    for (int i = 0; i < STEPS; i++) {
        double d = ((double)i + 0.5) * step;
        double local = h + growth * d;
        double shell = length > 0.0 ? PI * d * length : 2.0 * PI * (radius + d) * (radius + d);
        double part = fmin(shell * step, volume - inside);
        if (!(part > 0.0)) {
            break;
        }
        inside += part;
        nodes += part * (1.0 / (local * local * local) - density0);
    }
    return nodes;
}

/// Rim length of a patch, from its balls (other selectors: unknown, 0).
static double rim_length(const pal_scene_patch *patch, double *radius) {
    double length = 0.0;
    *radius = 0.0;
    for (int32_t i = 0; i < patch->where.count; i++) {
        if (patch->where.item[i].kind == PALPATE_SELECT_BALL) {
            length += 2.0 * PI * patch->where.item[i].radius;
            *radius = fmax(*radius, patch->where.item[i].radius);
        }
    }
    return length;
}

double pal_scene_predict_nodes(const pal_scene *scene, double volume) {
    double h0 = scene->spacing;
    double nodes = volume / (h0 * h0 * h0);
    for (int32_t i = 0; i < scene->refine_count; i++) {
        const pal_refine *z = &scene->refine[i];
        double radius = z->radius;
        double length = 0.0;
        for (int32_t p = 0; p < scene->patch_count && z->kind == PALPATE_REFINE_RIM; p++) {
            if (strcmp(scene->patch[p].name, z->rim) == 0) {
                length = rim_length(&scene->patch[p], &radius);
            }
        }
        if (z->kind == PALPATE_REFINE_BALL || length > 0.0) {
            nodes += zone_nodes(h0, scene->grading, volume, radius, length, z->spacing);
        }
    }
    for (int32_t p = 0; p < scene->patch_count; p++) {
        double radius;
        double length = rim_length(&scene->patch[p], &radius);
        double rim = scene->patch[p].rim_spacing;
        if (length > 0.0 && rim != 0.0) {
            nodes += zone_nodes(h0, scene->grading, volume, radius, length,
                                rim > 0.0 ? rim : -rim * radius / 14.0);
        }
    }
    return DENSITY * nodes;
}

pal_status pal_scene_check_size(pal_scene *scene, const double low[3], const double high[3],
                                double volume, pal_error *error) {
    char where[1400];
    double largest = 0.0;
    double smallest = INFINITY;
    for (int i = 0; i < 3; i++) {
        largest = fmax(largest, high[i] - low[i]);
        smallest = fmin(smallest, high[i] - low[i]);
    }
    (void)pal_place_text(scene, &scene->spacing_place, where, sizeof where);
    if (scene->spacing > 0.5 * largest) {
        return pal_fail(
            error, PALPATE_ERROR_SCENE,
            "%.500s: found %g m for a body of %g m; allowed: at most half the body; use about "
            "%.2g m (lengths are in metres)",
            where, scene->spacing, largest, largest / 15.0);
    }
    double nodes = pal_scene_predict_nodes(scene, volume);
    if (nodes > PALPATE_SCENE_NODES_MAX) {
        return pal_fail(
            error, PALPATE_ERROR_SCENE,
            "%.500s: found %g m and zones that ask for about %.2g nodes in a body of %g m; "
            "allowed: at most %d nodes; use coarser spacings (body.spacing %.2g m alone gives "
            "about 3000)",
            where, scene->spacing, nodes, largest, PALPATE_SCENE_NODES_MAX,
            cbrt(DENSITY * volume / 3000.0));
    }
    if (scene->spacing > 0.5 * smallest &&
        pal_scene_warn(
            scene, &scene->spacing_place,
            "%g m leaves fewer than two layers across the body's %g m; forces will be rough",
            scene->spacing, smallest) != PALPATE_OK) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%.300s: out of memory", scene->shown);
    }
    return PALPATE_OK;
}

pal_status pal_scene_check_primitive(pal_scene *scene, pal_error *error) {
    const pal_geometry *g = &scene->geometry;
    double r = g->radius;
    double low[3] = {-r, -r, -r};
    double high[3] = {r, r, r};
    double volume = 4.0 / 3.0 * PI * r * r * r;
    switch (g->kind) {
    case PALPATE_GEOMETRY_FILE:
        return PALPATE_OK; // once the surface is read
    case PALPATE_GEOMETRY_BOX:
        for (int i = 0; i < 3; i++) {
            low[i] = -g->size[i] / 2.0;
            high[i] = g->size[i] / 2.0;
        }
        volume = g->size[0] * g->size[1] * g->size[2];
        break;
    case PALPATE_GEOMETRY_HEMISPHERE:
        low[2] = 0.0;
        volume /= 2.0;
        break;
    case PALPATE_GEOMETRY_SPHERE:
        break;
    }
    return pal_scene_check_size(scene, low, high, volume, error);
}
