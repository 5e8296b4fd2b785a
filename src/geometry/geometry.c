/// @file geometry.c  Bodies: box, sphere, hemisphere and surface files in normalised coordinates.
///
/// Unit of length: the radius of spheres and hemispheres, the longest side of boxes, the longest
/// extent of surface files. Every number that comes from the scene is divided by it and rounded to
/// a grid of 2^-36, far above the rounding of that division: the same shape at any absolute size
/// enters the mesher with the same bits. Thread: one scene, one thread.
#include "src/geometry/geometry.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/geometry/surface.h"
#include "haptic/base/vec.h"

/// Further than this many sizes from the origin, double coordinates on the grid lose their meaning.
static const double FARTHEST = 65536.0;

double pal_grid(double x) {
    return nearbyint(x * 0x1p36) * 0x1p-36;
}

void pal_body_clear(pal_body *body) {
    pal_shape_clear(&body->shape);
    pal_smesh_clear(&body->mesh);
    pal_bvh_clear(&body->input_tree);
    free(body->input_x);
    free(body->input_v);
    memset(body, 0, sizeof *body);
}

static int add_plane(pal_shape *shape, int axis, double sign, double value) {
    pal_constraint c = {PALPATE_CONSTRAINT_PLANE, {0.0, 0.0, 0.0}, sign * value};
    c.vector[axis] = sign;
    return pal_shape_add(shape, &c);
}

static int add_sphere(pal_shape *shape, const double center[3], double radius) {
    pal_constraint c = {PALPATE_CONSTRAINT_SPHERE, {center[0], center[1], center[2]}, radius};
    return pal_shape_add(shape, &c);
}

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "body.geometry: no memory for its faces");
}

/// Center over length, on the grid; refused when far away.
static pal_status place_center(const pal_scene *scene, const double center[3], double length,
                               double out[3], pal_error *error) {
    for (int c = 0; c < 3; c++) {
        out[c] = pal_grid(center[c] / length);
        if (!(fabs(out[c]) <= FARTHEST)) {
            char place[256];
            return pal_fail(
                error, PALPATE_ERROR_GEOMETRY,
                "%s: the center lies %g body sizes from the origin: at most %g keep their "
                "precision; move the body closer to the origin",
                pal_place_text(scene, &scene->geometry.place, place, sizeof place), fabs(out[c]),
                FARTHEST);
        }
    }
    return PALPATE_OK;
}

static pal_status make_box(const pal_scene *scene, pal_body *body, pal_error *error) {
    static const int32_t quad[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                       {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    const double *size = scene->geometry.size;
    double center[3] = {0.0, 0.0, 0.0}, low[3], high[3], x[24];
    int32_t v[36];
    int16_t face[12];
    body->length = fmax(size[0], fmax(size[1], size[2]));
    pal_status status = place_center(scene, scene->geometry.center, body->length, center, error);
    if (status != PALPATE_OK) {
        return status;
    }
    body->least_extent = HUGE_VAL;
    for (int c = 0; c < 3; c++) {
        double half = 0.5 * size[c] / body->length;
        low[c] = pal_grid(center[c] - half);
        high[c] = pal_grid(center[c] + half);
        body->least_extent = fmin(body->least_extent, high[c] - low[c]);
    }
    for (int i = 0; i < 8; i++) {
        x[3 * i] = i & 1 ? high[0] : low[0];
        x[3 * i + 1] = i & 2 ? high[1] : low[1];
        x[3 * i + 2] = i & 4 ? high[2] : low[2];
    }
    for (int f = 0; f < 6; f++) {
        int side = f & 1, axis = f / 2;
        int id = add_plane(&body->shape, axis, side ? 1.0 : -1.0, side ? high[axis] : low[axis]);
        if (id < 0) {
            return no_memory(error);
        }
        static const int corner[6] = {0, 1, 2, 0, 2, 3};
        for (int k = 0; k < 6; k++) {
            v[6 * f + k] = quad[f][corner[k]];
        }
        face[2 * f] = face[2 * f + 1] = (int16_t)id;
    }
    return pal_smesh_build(&body->mesh, x, 8, v, 12, face, error);
}

/// An octahedron for the sphere; its upper half and a four-triangle base for the hemisphere.
static pal_status make_ball(const pal_scene *scene, pal_body *body, int half, pal_error *error) {
    static const double corner[6][3] = {{1, 0, 0},  {0, 1, 0}, {-1, 0, 0},
                                        {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    double x[18], center[3] = {0.0, 0.0, 0.0};
    int32_t v[24];
    int16_t face[8];
    body->length = scene->geometry.radius;
    body->least_extent = half ? 1.0 : 2.0;
    pal_status status =
        half ? PALPATE_OK
             : place_center(scene, scene->geometry.center, body->length, center, error);
    if (status != PALPATE_OK) {
        return status;
    }
    int dome = add_sphere(&body->shape, center, 1.0);
    int base = half ? add_plane(&body->shape, 2, -1.0, 0.0) : dome;
    if (dome < 0 || base < 0) {
        return no_memory(error);
    }
    for (int i = 0; i < 6; i++) {
        for (int c = 0; c < 3; c++) {
            x[3 * i + c] = half && i == 5 ? 0.0 : center[c] + corner[i][c];
        }
    }
    for (int i = 0; i < 4; i++) {
        int32_t top[3] = {i, (i + 1) % 4, 4}, low[3] = {(i + 1) % 4, i, 5};
        memcpy(v + 6 * i, top, sizeof top);
        memcpy(v + 6 * i + 3, low, sizeof low);
        face[2 * i] = (int16_t)dome;
        face[2 * i + 1] = (int16_t)base;
    }
    return pal_smesh_build(&body->mesh, x, 6, v, 8, face, error);
}

pal_status pal_body_make(pal_scene *scene, pal_body *body, pal_error *error) {
    memset(body, 0, sizeof *body);
    pal_status status = PALPATE_ERROR_GEOMETRY;
    switch (scene->geometry.kind) {
    case PALPATE_GEOMETRY_BOX:
        status = make_box(scene, body, error);
        break;
    case PALPATE_GEOMETRY_SPHERE:
        status = make_ball(scene, body, 0, error);
        break;
    case PALPATE_GEOMETRY_HEMISPHERE:
        status = make_ball(scene, body, 1, error);
        break;
    case PALPATE_GEOMETRY_FILE:
        status = pal_surface_body(scene, body, error);
        break;
    }
    if (status != PALPATE_OK) {
        pal_body_clear(body);
    }
    return status;
}
