/// @file skin.c  The mesh a host draws (see skin.h).
///
/// A vertex x moves with the nearest point p of the cloud's surface: u(x) = sum_k w_k u(node_k), w
/// the barycentric coordinates of p in its triangle (pal_bvh_closest, exact). They are positive and
/// sum to one, so rigid motions of a triangle's nodes are followed exactly, and linear fields where
/// x lies on the cloud's surface. The file's numbering is kept because texture coordinates and
/// everything else that the host knows about a vertex are addressed by it. Exporters write a vertex
/// twice where textures are cut; those twins share one normal, so that no cut shows. Thread: one.
#include "src/cloud/skin.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/geometry/bvh.h"
#include "src/cloud/locate.h"
#include "src/geometry/surface.h"
#include "haptic/base/vec.h"

void pal_skin_clear(pal_skin_source *skin) {
    free(skin->position);
    free(skin->triangle);
    free(skin->twin);
    memset(skin, 0, sizeof *skin);
}

/// Turn triangles over whose normal is opposite to the body's at the nearest point.
static void turn_outward(const pal_body *body, pal_skin_source *skin) {
    for (size_t t = 0; t < (size_t)skin->triangle_count; t++) {
        int32_t *v = skin->triangle + 3 * t;
        double center[3], n[3], out[3], distance;
        for (size_t d = 0; d < 3; d++) {
            center[d] =
                (skin->position[3 * (size_t)v[0] + d] + skin->position[3 * (size_t)v[1] + d] +
                 skin->position[3 * (size_t)v[2] + d]) /
                (3.0 * body->length);
        }
        const int32_t *b =
            body->input_v + 3 * (size_t)pal_bvh_closest(&body->input_tree, center, NULL, &distance);
        v3_normal(skin->position + 3 * (size_t)v[0], skin->position + 3 * (size_t)v[1],
                  skin->position + 3 * (size_t)v[2], n);
        v3_normal(body->input_x + 3 * (size_t)b[0], body->input_x + 3 * (size_t)b[1],
                  body->input_x + 3 * (size_t)b[2], out);
        if (v3_dot(n, out) < 0.0) {
            int32_t swap = v[1];
            v[1] = v[2];
            v[2] = swap;
        }
    }
}

pal_status pal_skin_read(const pal_scene *scene, const pal_body *body, pal_skin_source *skin,
                         pal_error *error) {
    memset(skin, 0, sizeof *skin);
    int own = scene->skin.path[0] != '\0';
    if (!own && (body == NULL || !body->is_file)) {
        return PALPATE_OK;
    }
    double scale = own ? scene->skin.scale : scene->geometry.scale;
    pal_surface s;
    pal_status status =
        pal_surface_read_in_order(own ? scene->skin.path : scene->geometry.path, &s, error);
    if (status == PALPATE_OK) {
        skin->twin = malloc((size_t)s.vertex_count * sizeof *skin->twin);
        status = skin->twin != NULL
                     ? pal_surface_twins(&s, skin->twin, error)
                     : pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for the skin");
        skin->vertex_count = s.vertex_count;
        skin->triangle_count = s.triangle_count;
        skin->position = s.x;
        skin->triangle = s.v;
        for (size_t i = 0; i < 3 * (size_t)s.vertex_count; i++) {
            skin->position[i] *= scale;
        }
    }
    if (status != PALPATE_OK) {
        char place[1400];
        pal_skin_clear(skin);
        return pal_fail_prefix(error, status, "%s",
                               pal_place_text(scene,
                                              own ? &scene->skin.place : &scene->geometry.place,
                                              place, sizeof place));
    }
    if (!own) {
        turn_outward(body, skin);
    }
    return PALPATE_OK;
}

/// Where vertices lie far from the body's surface.
typedef struct far_report {
    int32_t count, vertex; ///< how many, and the worst
    double worst;          ///< its distance [m]
} far_report;

/// Row and weight of every vertex. @return the farthest vertex and how many lie off the surface
static far_report weigh(const pal_skin_source *skin, const pal_cloud *cloud, const pal_bvh *tree,
                        pal_model *model) {
    far_report far = {0};
    for (size_t i = 0; i < (size_t)skin->vertex_count; i++) {
        double x[3], weight[3], distance, h = 0.0;
        for (size_t d = 0; d < 3; d++) {
            x[d] = skin->position[3 * i + d] / cloud->length;
        }
        const int32_t *v = cloud->triangle + 3 * (size_t)pal_bvh_closest(tree, x, NULL, &distance);
        (void)pal_triangle_nearest(cloud->position + 3 * (size_t)v[0],
                                   cloud->position + 3 * (size_t)v[1],
                                   cloud->position + 3 * (size_t)v[2], x, weight);
        for (size_t k = 0; k < PALPATE_SKIN_WEIGHTS; k++) {
            // rows of `surface` and `all` start with the surface nodes in order: row = node
            model->skin_row[PALPATE_SKIN_WEIGHTS * i + k] = k < 3 ? v[k] : -1;
            model->skin_weight[PALPATE_SKIN_WEIGHTS * i + k] = k < 3 ? (float)weight[k] : 0.0F;
            h = fmax(h, k < 3 ? cloud->spacing[v[k]] : 0.0);
        }
        far.count += distance > h;
        if (distance * cloud->length > far.worst) {
            far.worst = distance * cloud->length;
            far.vertex = (int32_t)i;
        }
    }
    return far;
}

static pal_status judge(pal_scene *scene, const pal_skin_source *skin, const pal_model *model,
                        const far_report *far, pal_error *error) {
    const double *x = skin->position + 3 * (size_t)far->vertex;
    double size = 0.0;
    for (int d = 0; d < 3; d++) {
        size = fmax(size, model->info.bounds_max[d] - model->info.bounds_min[d]);
    }
    if (far->worst > 0.5 * size) {
        char place[1400];
        return pal_fail(
            error, PALPATE_ERROR_SCENE,
            "%s: vertex %d lies at (%.3g, %.3g, %.3g) m, %.3g m from the surface of a body of %.3g "
            "m; "
            "allowed: half the body's size; give skin.scale, the metres per unit of the file, and "
            "the mesh in the body's frame",
            pal_place_text(scene, &scene->skin.place, place, sizeof place), (int)far->vertex + 1,
            x[0], x[1], x[2], far->worst, size);
    }
    if (far->count > 0) {
        pal_status status = pal_scene_warn(
            scene, &scene->skin.place,
            "%d of %d vertices lie further from the body's surface than the node spacing, up to "
            "%.3g m (vertex "
            "%d at %.3g, %.3g, %.3g); they move with the surface point nearest to them",
            (int)far->count, (int)skin->vertex_count, far->worst, (int)far->vertex + 1, x[0], x[1],
            x[2]);
        return status == PALPATE_OK ? status : pal_fail(error, status, "no memory for the skin");
    }
    return PALPATE_OK;
}

pal_status pal_skin_fill(pal_scene *scene, const pal_skin_source *skin, const pal_cloud *cloud,
                         pal_model *model, pal_error *error) {
    if (skin->vertex_count == 0 || model->info.row_count < model->info.surface_count) {
        return PALPATE_OK;
    }
    size_t v = (size_t)skin->vertex_count, f = (size_t)skin->triangle_count;
    model->skin_position = malloc(3 * v * sizeof *model->skin_position);
    model->skin_triangle = malloc((3 * f + 1) * sizeof *model->skin_triangle);
    model->skin_twin = malloc(v * sizeof *model->skin_twin);
    model->skin_row = malloc(PALPATE_SKIN_WEIGHTS * v * sizeof *model->skin_row);
    model->skin_weight = malloc(PALPATE_SKIN_WEIGHTS * v * sizeof *model->skin_weight);
    if (!model->skin_position || !model->skin_triangle || !model->skin_twin || !model->skin_row ||
        !model->skin_weight) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for a skin of %zu vertices", v);
    }
    pal_bvh tree;
    pal_status status =
        pal_bvh_build(&tree, cloud->position, cloud->triangle, cloud->triangle_count, error);
    if (status == PALPATE_OK) {
        memcpy(model->skin_position, skin->position, 3 * v * sizeof *skin->position);
        memcpy(model->skin_twin, skin->twin, v * sizeof *skin->twin);
        for (size_t c = 0; c < 3 * f; c++) {
            model->skin_triangle[c] = skin->twin[skin->triangle[c]];
        }
        far_report far = weigh(skin, cloud, &tree, model);
        model->info.skin_count = skin->vertex_count;
        model->skin_triangle_count = skin->triangle_count;
        if (scene->skin.path[0] != '\0') {
            status = judge(scene, skin, model, &far, error);
        }
    }
    pal_bvh_clear(&tree);
    return status;
}
