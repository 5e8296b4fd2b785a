/// A scene's selectors applied to its cloud, and the checks that only the cloud can answer.
///
/// - Every selection must hold a node; an empty one is an error that names the nearest node.
/// - Held against rigid motion: u = a + b x r must vanish on the fixed nodes only for a = b = 0.
/// One
///   fixed place leaves three rotations about it, fixed places on one line leave the rotation about
///   that line, three places off a line leave nothing. Checked for every connected part of the
///   body.
/// - Probes lie in the body: winding number of the surface (Van Oosterom and Strackee, The solid
///   angle of a plane triangle, IEEE Trans. Biomed. Eng. 1983, Eq. 8), with half a spacing of slack
///   where the chords of the triangles cut off a curved body.
#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/cloud/scene_check.h"
#include "haptic/base/vec.h"

/// Fixed nodes nearer to a line than this many body sizes count as on it.
static const double LINE = 1e-4;

typedef struct checking {
    pal_scene *scene;
    const pal_cloud *cloud;
    double size; ///< largest extent of the body [m]
    pal_node_sets *sets;
    pal_error *error;
} checking;

void pal_node_sets_clear(pal_node_sets *sets) {
    free(sets->flags);
    free(sets->patch_start);
    free(sets->patch_node);
    *sets = (pal_node_sets){0};
}

static void node_position(const checking *c, int32_t node, double x[3]) {
    for (int i = 0; i < 3; i++) {
        x[i] = c->cloud->length * c->cloud->position[3 * (size_t)node + (size_t)i];
    }
}

static double distance(const double a[3], const double b[3]) {
    return hypot(hypot(a[0] - b[0], a[1] - b[1]), a[2] - b[2]);
}

static double body_size(const pal_cloud *cloud) {
    double size = 0.0;
    for (size_t i = 0; i < 3; i++) {
        double low = DBL_MAX;
        double high = -DBL_MAX;
        for (int32_t n = 0; n < cloud->surface_count; n++) {
            low = fmin(low, cloud->position[3 * (size_t)n + i]);
            high = fmax(high, cloud->position[3 * (size_t)n + i]);
        }
        size = fmax(size, high - low);
    }
    return cloud->length * size;
}

static pal_status fail_at(const checking *c, const pal_place *place, const char *text) {
    char where[1400];
    (void)pal_place_text(c->scene, place, where, sizeof where);
    return pal_fail(c->error, PALPATE_ERROR_SCENE, "%.500s: %s", where, text);
}

static pal_status fail_memory(const checking *c) {
    return pal_fail(c->error, PALPATE_ERROR_MEMORY, "%.300s: out of memory", c->scene->shown);
}

// ---- Selections
// ----------------------------------------------------------------------------------

/// Mark the surface nodes of a list. @return how many
static int32_t mark(const checking *c, const pal_selector_list *list, uint8_t *marks) {
    int32_t count = 0;
    for (int32_t n = 0; n < c->cloud->surface_count; n++) {
        double x[3];
        node_position(c, n, x);
        marks[n] = (uint8_t)pal_select(list, x, c->size);
        count += marks[n];
    }
    return count;
}

/// "selects no surface node": where the nearest one is.
static pal_status fail_empty(const checking *c, const pal_place *place,
                             const pal_selector_list *list) {
    double best = DBL_MAX;
    double at[3] = {0.0, 0.0, 0.0};
    for (int32_t n = 0; n < c->cloud->surface_count; n++) {
        double x[3];
        node_position(c, n, x);
        double d = pal_select_distance(list, x);
        if (d < best) {
            best = d;
            memcpy(at, x, sizeof at);
        }
    }
    char text[400];
    (void)snprintf(
        text, sizeof text,
        "found no surface node in it (the nearest of %d is at [%.6g, %.6g, %.6g], %.3g m "
        "outside); allowed: at least one; enlarge it, or use a finer body.spacing",
        (int)c->cloud->surface_count, at[0], at[1], at[2], best);
    return fail_at(c, place, text);
}

/// Warn about the selectors of a list that add nothing.
static pal_status warn_idle(const checking *c, const pal_selector_list *list, uint8_t *marks) {
    for (int32_t i = 0; i < list->count && list->count > 1; i++) {
        pal_selector_list one = {.count = 1, .item = &list->item[i]};
        if (mark(c, &one, marks) == 0 && pal_scene_warn(c->scene, &list->item[i].place,
                                                        "selects no surface node") != PALPATE_OK) {
            return fail_memory(c);
        }
    }
    return PALPATE_OK;
}

static pal_status select_fixed(const checking *c, uint8_t *marks) {
    const pal_scene *scene = c->scene;
    pal_status status = warn_idle(c, &scene->fixed, marks);
    if (status != PALPATE_OK) {
        return status;
    }
    c->sets->fixed_count = mark(c, &scene->fixed, marks);
    for (int32_t n = 0; n < c->cloud->surface_count; n++) {
        c->sets->flags[n] = marks[n] ? PALPATE_NODE_FIXED : 0;
    }
    if (c->sets->fixed_count == 0) {
        return fail_empty(c, &scene->fixed_place, &scene->fixed);
    }
    if (c->sets->fixed_count == c->cloud->surface_count) {
        return fail_at(c, &scene->fixed_place,
                       "found every surface node fixed; allowed: some must stay free; narrow it");
    }
    return PALPATE_OK;
}

static int covers_all(const pal_selector_list *list) {
    for (int32_t i = 0; i < list->count; i++) {
        if (list->item[i].kind == PALPATE_SELECT_ALL) {
            return 1;
        }
    }
    return 0;
}

static pal_status select_touchable(const checking *c, uint8_t *marks) {
    pal_scene *scene = c->scene;
    if (scene->touchable.count == 0) {
        return PALPATE_OK; // only patches
    }
    pal_status status = warn_idle(c, &scene->touchable, marks);
    if (status != PALPATE_OK) {
        return status;
    }
    int32_t count = mark(c, &scene->touchable, marks);
    if (count == 0) {
        return fail_empty(c, &scene->touchable_place, &scene->touchable);
    }
    int32_t both = 0;
    for (int32_t n = 0; n < c->cloud->surface_count; n++) {
        int fixed = c->sets->flags[n] & PALPATE_NODE_FIXED;
        both += marks[n] && fixed;
        if (marks[n] && !fixed) {
            c->sets->flags[n] |= PALPATE_NODE_TOUCHABLE;
        }
    }
    c->sets->touchable_count = count - both;
    if (count == both) {
        return fail_at(c, &scene->touchable_place,
                       "found only fixed nodes in it; allowed: at least one free node; "
                       "fixed wins: enlarge it, or narrow body.fixed");
    }
    // `all` (the default) means all that is free: nothing to warn about
    if (both > 0 && !covers_all(&scene->touchable) &&
        pal_scene_warn(scene, &scene->touchable_place,
                       "%d of its %d nodes are fixed; fixed wins, they cannot be touched",
                       (int)both, (int)count) != PALPATE_OK) {
        return fail_memory(c);
    }
    return PALPATE_OK;
}

static pal_status select_patches(const checking *c, uint8_t *marks) {
    pal_scene *scene = c->scene;
    pal_node_sets *sets = c->sets;
    int32_t capacity = 0;
    sets->patch_count = scene->patch_count;
    sets->patch_start = calloc((size_t)scene->patch_count + 1, sizeof *sets->patch_start);
    if (sets->patch_start == NULL) {
        return fail_memory(c);
    }
    for (int32_t p = 0; p < scene->patch_count; p++) {
        const pal_scene_patch *patch = &scene->patch[p];
        pal_status status = warn_idle(c, &patch->where, marks);
        if (status != PALPATE_OK) {
            return status;
        }
        int32_t count = mark(c, &patch->where, marks);
        if (count == 0) {
            return fail_empty(c, &patch->place, &patch->where);
        }
        int32_t used = sets->patch_start[p];
        if (used + count > capacity) {
            capacity = 2 * (used + count);
            int32_t *grown = realloc(sets->patch_node, (size_t)capacity * sizeof *grown);
            if (grown == NULL) {
                return fail_memory(c);
            }
            sets->patch_node = grown;
        }
        int32_t both = 0;
        for (int32_t n = 0; n < c->cloud->surface_count; n++) {
            if (marks[n] && (c->sets->flags[n] & PALPATE_NODE_FIXED) != 0) {
                both++;
            } else if (marks[n]) {
                sets->patch_node[used++] = n;
            }
        }
        if (both == count) {
            return fail_at(c, &patch->place,
                           "found only fixed nodes in it; allowed: at least one free node; "
                           "fixed wins: move the patch, or narrow body.fixed");
        }
        if (both > 0 && pal_scene_warn(scene, &patch->place,
                                       "%d of its %d nodes are fixed; fixed wins, the patch has %d",
                                       (int)both, (int)count, (int)(count - both)) != PALPATE_OK) {
            return fail_memory(c);
        }
        sets->patch_start[p + 1] = used;
    }
    return PALPATE_OK;
}

// ---- Rigid motion
// --------------------------------------------------------------------------------

static int32_t root_of(int32_t *parent, int32_t i) {
    while (parent[i] != i) {
        parent[i] = parent[parent[i]];
        i = parent[i];
    }
    return i;
}

/// Connected parts: parent[n] is the first node of the part of n.
static void find_parts(const pal_cloud *cloud, int32_t *parent) {
    for (int32_t n = 0; n < cloud->node_count; n++) {
        parent[n] = cloud->tet_count > 0 ? n : 0;
    }
    for (int32_t t = 0; t < cloud->tet_count; t++) {
        const int32_t *tet = &cloud->tet[4 * (size_t)t];
        for (int k = 1; k < 4; k++) {
            int32_t a = root_of(parent, tet[0]);
            int32_t b = root_of(parent, tet[k]);
            parent[a > b ? a : b] = a > b ? b : a;
        }
    }
    for (int32_t n = 0; n < cloud->node_count; n++) {
        parent[n] = root_of(parent, n);
    }
}

/// Farthest fixed node of a part from `from`, or from the line through `from` and `to`.
static int32_t farthest(const checking *c, const int32_t *part, int32_t which, const double from[3],
                        const double *to, double *out) {
    int32_t best = -1;
    *out = -1.0;
    double line[3] = {0.0, 0.0, 0.0};
    double length = to != NULL ? distance(from, to) : 0.0;
    for (int i = 0; i < 3 && to != NULL; i++) {
        line[i] = (to[i] - from[i]) / length;
    }
    for (int32_t n = 0; n < c->cloud->surface_count; n++) {
        if (part[n] != which || (c->sets->flags[n] & PALPATE_NODE_FIXED) == 0) {
            continue;
        }
        double x[3];
        node_position(c, n, x);
        double along = 0.0;
        for (int i = 0; i < 3; i++) {
            along += (x[i] - from[i]) * line[i];
        }
        double foot[3];
        for (int i = 0; i < 3; i++) {
            foot[i] = from[i] + along * line[i];
        }
        double d = distance(x, foot);
        if (d > *out) {
            *out = d;
            best = n;
        }
    }
    return best;
}

static pal_status check_part(const checking *c, const int32_t *part, int32_t which, int32_t parts) {
    char name[120] = "the body";
    char text[400];
    double corner[3];
    node_position(c, which, corner);
    if (parts > 1) {
        (void)snprintf(name, sizeof name,
                       "the part of the body with node [%.6g, %.6g, %.6g] (of %d separate parts)",
                       corner[0], corner[1], corner[2], (int)parts);
    }
    double apart;
    double off;
    int32_t a = farthest(c, part, which, corner, NULL, &apart);
    if (a < 0) {
        (void)snprintf(
            text, sizeof text,
            "found no fixed node on %s: it can move freely; allowed: at least three fixed "
            "nodes off one line; fix it too, or remove it",
            name);
        return fail_at(c, &c->scene->fixed_place, text);
    }
    double from[3];
    double to[3];
    node_position(c, a, from);
    int32_t b = farthest(c, part, which, from, NULL, &apart);
    node_position(c, b, to);
    if (apart <= LINE * c->size) {
        (void)snprintf(text, sizeof text,
                       "found %s held at one place only, [%.6g, %.6g, %.6g]: it can turn about it; "
                       "allowed: at least three fixed nodes off one line; enlarge the selector",
                       name, from[0], from[1], from[2]);
        return fail_at(c, &c->scene->fixed_place, text);
    }
    (void)farthest(c, part, which, from, to, &off);
    if (off <= LINE * c->size) {
        (void)snprintf(
            text, sizeof text,
            "found %s held on one line only, [%.6g, %.6g, %.6g] to [%.6g, %.6g, %.6g]: it "
            "can turn about it; allowed: at least three fixed nodes off one line; enlarge "
            "the selector",
            name, from[0], from[1], from[2], to[0], to[1], to[2]);
        return fail_at(c, &c->scene->fixed_place, text);
    }
    return PALPATE_OK;
}

static pal_status check_held(const checking *c) {
    int32_t *part = malloc((size_t)c->cloud->node_count * sizeof *part);
    if (part == NULL) {
        return fail_memory(c);
    }
    find_parts(c->cloud, part);
    int32_t parts = 0;
    for (int32_t n = 0; n < c->cloud->node_count; n++) {
        parts += part[n] == n;
    }
    pal_status status = PALPATE_OK;
    for (int32_t n = 0; n < c->cloud->node_count && status == PALPATE_OK; n++) {
        if (part[n] == n) {
            status = check_part(c, part, n, parts);
        }
    }
    free(part);
    return status;
}

// ---- Probes
// ----------------------------------------------------------------------------------------

/// Distance from x to the triangle a, b, c (Ericson, Real-Time Collision Detection, 5.1.5: regions
/// of the nearest point).
static double triangle_distance(const double x[3], double v[3][3]) {
    double ab[3];
    double ac[3];
    double p[3];
    double d[6] = {0};
    for (int i = 0; i < 3; i++) {
        ab[i] = v[1][i] - v[0][i];
        ac[i] = v[2][i] - v[0][i];
        d[0] += ab[i] * (x[i] - v[0][i]);
        d[1] += ac[i] * (x[i] - v[0][i]);
        d[2] += ab[i] * (x[i] - v[1][i]);
        d[3] += ac[i] * (x[i] - v[1][i]);
        d[4] += ab[i] * (x[i] - v[2][i]);
        d[5] += ac[i] * (x[i] - v[2][i]);
    }
    double vc = d[0] * d[3] - d[2] * d[1];
    double vb = d[4] * d[1] - d[0] * d[5];
    double va = d[2] * d[5] - d[4] * d[3];
    double s; // nearest point = v0 + s ab + t ac
    double t;
    if (d[0] <= 0 && d[1] <= 0) {
        s = 0, t = 0;
    } else if (d[2] >= 0 && d[3] <= d[2]) {
        s = 1, t = 0;
    } else if (d[5] >= 0 && d[4] <= d[5]) {
        s = 0, t = 1;
    } else if (vc <= 0 && d[0] >= 0 && d[2] <= 0) {
        s = d[0] / (d[0] - d[2]), t = 0;
    } else if (vb <= 0 && d[1] >= 0 && d[5] <= 0) {
        s = 0, t = d[1] / (d[1] - d[5]);
    } else if (va <= 0 && d[3] - d[2] >= 0 && d[4] - d[5] >= 0) {
        t = (d[3] - d[2]) / ((d[3] - d[2]) + (d[4] - d[5])), s = 1 - t;
    } else {
        s = vb / (va + vb + vc), t = vc / (va + vb + vc);
    }
    for (int i = 0; i < 3; i++) {
        p[i] = v[0][i] + s * ab[i] + t * ac[i];
    }
    return distance(x, p);
}

static double triple(const double a[3], const double b[3], const double c[3]) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
}

/// Distance to the surface [m]; negative inside.
static double outside_by(const checking *c, const double x[3], int32_t *nearest) {
    double best = DBL_MAX;
    double angle = 0.0;
    for (int32_t t = 0; t < c->cloud->triangle_count; t++) {
        double v[3][3];
        double r[3][3];
        double length[3];
        for (int k = 0; k < 3; k++) {
            node_position(c, c->cloud->triangle[3 * (size_t)t + (size_t)k], v[k]);
            for (int i = 0; i < 3; i++) {
                r[k][i] = v[k][i] - x[i];
            }
            length[k] = sqrt(v3_dot(r[k], r[k]));
        }
        angle += 2.0 * atan2(triple(r[0], r[1], r[2]),
                             length[0] * length[1] * length[2] + v3_dot(r[0], r[1]) * length[2] +
                                 v3_dot(r[1], r[2]) * length[0] + v3_dot(r[2], r[0]) * length[1]);
        double d = triangle_distance(x, v);
        if (d < best) {
            best = d;
            *nearest = c->cloud->triangle[3 * (size_t)t];
        }
    }
    static const double PI = 3.14159265358979323846;
    return angle > 2.0 * PI ? -best : best; // inside: the solid angle is 4 pi
}

static pal_status check_probes(const checking *c) {
    for (int32_t i = 0; i < c->scene->probe_count && c->cloud->triangle_count > 0; i++) {
        const pal_scene_probe *probe = &c->scene->probe[i];
        int32_t nearest = 0;
        double out = outside_by(c, probe->position, &nearest);
        if (out > 0.5 * c->cloud->length * c->cloud->spacing[nearest]) {
            double x[3];
            node_position(c, nearest, x);
            char text[300];
            (void)snprintf(text, sizeof text,
                           "found a point %.3g m outside the body (near surface node [%.6g, %.6g, "
                           "%.6g]); allowed: points of the body; move it inside",
                           out, x[0], x[1], x[2]);
            return fail_at(c, &probe->place, text);
        }
    }
    return PALPATE_OK;
}

pal_status pal_scene_select_nodes(pal_scene *scene, const pal_cloud *cloud, pal_node_sets *out,
                                  pal_error *error) {
    *out = (pal_node_sets){0};
    checking c = {
        .scene = scene, .cloud = cloud, .size = body_size(cloud), .sets = out, .error = error};
    uint8_t *marks = malloc((size_t)cloud->surface_count + 1);
    out->flags = calloc((size_t)cloud->node_count + 1, 1);
    pal_status status = marks == NULL || out->flags == NULL ? fail_memory(&c) : PALPATE_OK;
    if (status == PALPATE_OK) {
        status = select_fixed(&c, marks);
    }
    if (status == PALPATE_OK) {
        status = select_touchable(&c, marks);
    }
    if (status == PALPATE_OK) {
        status = select_patches(&c, marks);
    }
    if (status == PALPATE_OK) {
        status = check_held(&c);
    }
    if (status == PALPATE_OK) {
        status = check_probes(&c);
    }
    free(marks);
    if (status != PALPATE_OK) {
        pal_node_sets_clear(out);
    }
    return status;
}
