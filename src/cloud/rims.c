/// @file rims.c  Patch rims on the body's surface (design section 4: the cloud conforms to
/// patches).
///
/// The stress is singular at the rim of a bonded patch and the force follows the patch's radius, so
/// nodes lie on the rim and the spacing grows away from it. A patch is a union of selectors; each
/// selector's boundary is one sphere or up to six planes. The surface is cut along all of them,
/// then the edges between a selected and an unselected triangle are the rim. An automatic rim
/// spacing is 1/14 of the patch's radius, taken as that of a disc of the patch's area (exact for
/// caps of a sphere, whose area is pi times the chord squared). Thread: one scene, one thread.
#include "src/cloud/rims.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

static const double TOLERANCE = 1e-6; // of selectors (selector.c), body size 1
static const double AUTO_RIM = 1.0 / 14.0;
enum { SELECTOR_PLANES = 6 };

/// A selector's boundary in normalised coordinates.
typedef struct boundary {
    int count;
    int id[SELECTOR_PLANES]; ///< constraint numbers; the selector is where all values are <= 0
} boundary;

static pal_status add_boundary(const pal_selector *s, double length, pal_shape *shape,
                               boundary *out, pal_error *error) {
    pal_constraint c = {PALPATE_CONSTRAINT_PLANE, {0.0, 0.0, 0.0}, 0.0};
    out->count = 0;
    for (int k = 0; k < SELECTOR_PLANES; k++) {
        double sign = k & 1 ? 1.0 : -1.0;
        memset(c.vector, 0, sizeof c.vector);
        if (s->kind == PALPATE_SELECT_BALL && k == 0) {
            c.kind = PALPATE_CONSTRAINT_SPHERE;
            for (int d = 0; d < 3; d++) {
                c.vector[d] = pal_grid(s->center[d] / length);
            }
            c.value = pal_grid(s->radius / length);
        } else if (s->kind == PALPATE_SELECT_BOX) {
            c.vector[k / 2] = sign;
            c.value = sign * pal_grid((k & 1 ? s->high : s->low)[k / 2] / length);
        } else if ((s->kind == PALPATE_SELECT_BELOW || s->kind == PALPATE_SELECT_ABOVE) && k == 0) {
            double side = s->kind == PALPATE_SELECT_BELOW ? 1.0 : -1.0;
            c.vector[s->axis] = side;
            c.value = side * pal_grid(s->value / length);
        } else {
            break;
        }
        int id = pal_shape_add(shape, &c);
        if (id < 0) {
            return pal_fail(error, (pal_status)id, "body.patches: %s",
                            id == PALPATE_ERROR_MEMORY ? "no memory for their rims"
                                                       : "more than 32767 rim surfaces");
        }
        out->id[out->count++] = id;
    }
    return PALPATE_OK;
}

/// Is a point inside every surface of the boundary (an empty one selects all)?
static int inside(const pal_shape *shape, const boundary *b, const double x[3]) {
    for (int k = 0; k < b->count; k++) {
        if (pal_constraint_value(shape->constraint + b->id[k], x, NULL) > TOLERANCE) {
            return 0;
        }
    }
    return 1;
}

/// Triangles whose corners and centre are selected, after cutting: a triangle lies on one side.
static void select_triangles(const pal_body *body, const boundary *b, uint8_t *selected) {
    const pal_surface_mesh *m = &body->mesh;
    for (int32_t t = 0; t < m->triangle_count; t++) {
        double center[3] = {0.0, 0.0, 0.0};
        int in = 1;
        for (int k = 0; k < 3; k++) {
            const double *x = m->x + 3 * (size_t)m->v[3 * (size_t)t + (size_t)k];
            in = in && inside(&body->shape, b, x);
            v3_add(center, 1.0 / 3.0, x, center);
        }
        selected[t] |= (uint8_t)(in && inside(&body->shape, b, center));
    }
}

/// Constraints of this patch that both ends of an edge satisfy.
static pal_constraint_set shared_constraints(const pal_body *body, const boundary *list,
                                             int32_t count, int32_t a, int32_t b) {
    pal_constraint_set out = pal_set_none();
    for (int32_t i = 0; i < count; i++) {
        for (int k = 0; k < list[i].count; k++) {
            int id = list[i].id[k];
            if (pal_set_has(body->mesh.set[a], id) && pal_set_has(body->mesh.set[b], id)) {
                out = pal_set_union(out, pal_set_one(id));
            }
        }
    }
    return out;
}

/// After cutting, a vertex keeps only the constraints of its face or of the feature it lies on.
static void reset_sets(pal_surface_mesh *m) {
    for (int32_t i = 0; i < m->vertex_count; i++) {
        pal_constraint_set features = pal_set_none();
        int32_t e = m->out[i];
        do {
            features = m->feature[e] ? pal_set_union(features, m->edge[e]) : features;
            e = pal_smesh_around(m, e);
        } while (e != m->out[i]);
        m->set[i] = features.id[0] >= 0 ? features : pal_set_one(m->face[m->out[i] / 3]);
    }
}

static double chosen_spacing(const pal_scene *scene, const pal_scene_patch *patch, double radius,
                             double length) {
    double h = patch->rim_spacing < 0.0 ? -patch->rim_spacing * AUTO_RIM * radius
                                        : pal_grid(patch->rim_spacing / length);
    int explicit = patch->rim_spacing > 0.0;
    for (int32_t i = 0; i < scene->refine_count; i++) {
        const pal_refine *r = scene->refine + i;
        if (r->kind == PALPATE_REFINE_RIM && strcmp(r->rim, patch->name) == 0) {
            double wanted = pal_grid(r->spacing / length);
            h = explicit ? fmin(h, wanted) : wanted;
            explicit = 1;
        }
    }
    return h;
}

static int has_rim(const pal_scene *scene, const pal_scene_patch *patch) {
    return patch->rim_spacing != 0.0 || chosen_spacing(scene, patch, 0.0, 1.0) > 0.0;
}

/// Mark the rim of one patch and measure the patch.
static pal_status mark_rim(pal_body *body, const boundary *list, int32_t count,
                           const uint8_t *selected, double *area) {
    pal_surface_mesh *m = &body->mesh;
    *area = 0.0;
    for (int32_t t = 0; t < m->triangle_count; t++) {
        double n[3];
        *area += selected[t] ? 0.5 * pal_smesh_normal(m, t, -1, NULL, n) : 0.0;
        for (int32_t e = 3 * t; e < 3 * t + 3; e++) {
            int32_t o = m->twin[e];
            if (selected[t] && !selected[o / 3]) {
                pal_constraint_set set = shared_constraints(body, list, count, m->v[e], m->v[o]);
                set = pal_set_union(set, pal_set_one(m->face[t]));
                set = pal_set_union(set, pal_set_one(m->face[o / 3]));
                pal_smesh_mark(m, e, set);
            }
        }
    }
    return PALPATE_OK;
}

static pal_status add_sources(const pal_body *body, const uint8_t *selected, double spacing,
                              pal_size_field *size, pal_error *error) {
    const pal_surface_mesh *m = &body->mesh;
    for (int32_t e = 0; e < 3 * m->triangle_count; e++) {
        if (selected[e / 3] && !selected[m->twin[e] / 3]) {
            pal_size_source s = {.radius = 0.0, .spacing = spacing};
            v3_copy(m->x + 3 * (size_t)m->v[e], s.a);
            v3_copy(m->x + 3 * (size_t)pal_smesh_head(m, e), s.b);
            if (pal_size_add(size, &s) != PALPATE_OK) {
                return pal_fail(error, PALPATE_ERROR_MEMORY,
                                "body.patches: no memory for their rims");
            }
        }
    }
    return PALPATE_OK;
}

static pal_status imprint_patch(pal_scene *scene, const pal_scene_patch *patch, pal_body *body,
                                pal_size_field *size, pal_error *error) {
    int32_t count = patch->where.count;
    boundary *list = calloc((size_t)count + 1, sizeof *list);
    uint8_t *selected = NULL;
    pal_status status = list != NULL ? PALPATE_OK : PALPATE_ERROR_MEMORY;
    for (int32_t i = 0; i < count && status == PALPATE_OK; i++) {
        status = add_boundary(patch->where.item + i, body->length, &body->shape, list + i, error);
        for (int k = 0; k < list[i].count && status == PALPATE_OK; k++) {
            status = pal_smesh_cut(&body->mesh, &body->shape, list[i].id[k], error);
        }
    }
    if (status == PALPATE_OK) {
        selected = calloc((size_t)body->mesh.triangle_count, 1);
        status = selected != NULL ? PALPATE_OK : PALPATE_ERROR_MEMORY;
    }
    if (status == PALPATE_OK) {
        double area = 0.0;
        for (int32_t i = 0; i < count; i++) {
            select_triangles(body, list + i, selected);
        }
        status = mark_rim(body, list, count, selected, &area);
        reset_sets(&body->mesh);
        double h = chosen_spacing(scene, patch, sqrt(area / 3.14159265358979324), body->length);
        if (area > 0.0) {
            status = add_sources(body, selected, pal_grid(h), size, error);
        }
    } else if (status == PALPATE_ERROR_MEMORY) {
        (void)pal_fail(error, status, "body.patches.%s: no memory for its rim", patch->name);
    }
    free(list);
    free(selected);
    return status;
}

pal_status pal_size_from_scene(const pal_scene *scene, double length, pal_size_field *out,
                               pal_error *error) {
    memset(out, 0, sizeof *out);
    out->cap = pal_grid(scene->spacing / length);
    out->grading = scene->grading;
    for (int32_t i = 0; i < scene->refine_count; i++) {
        const pal_refine *r = scene->refine + i;
        if (r->kind != PALPATE_REFINE_BALL) {
            continue;
        }
        pal_size_source s = {.radius = pal_grid(r->radius / length),
                             .spacing = pal_grid(r->spacing / length)};
        for (int c = 0; c < 3; c++) {
            s.a[c] = s.b[c] = pal_grid(r->center[c] / length);
        }
        if (pal_size_add(out, &s) != PALPATE_OK) {
            pal_size_clear(out);
            return pal_fail(error, PALPATE_ERROR_MEMORY, "body.refine: no memory");
        }
    }
    return PALPATE_OK;
}

/// A surface fine enough to see every selector: a sixth of its radius near it.
static pal_status prepare(const pal_scene *scene, pal_body *body, const pal_size_field *size,
                          pal_error *error) {
    pal_size_field rough = {.cap = fmax(size->cap, 0.05), .grading = fmax(size->grading, 0.2)};
    pal_status status = PALPATE_OK;
    for (int32_t p = 0; p < scene->patch_count && status == PALPATE_OK; p++) {
        const pal_scene_patch *patch = scene->patch + p;
        for (int32_t i = 0; has_rim(scene, patch) && i < patch->where.count; i++) {
            const pal_selector *s = patch->where.item + i;
            pal_size_source source = {.radius = 0.0};
            if (s->kind == PALPATE_SELECT_BALL) {
                source.radius = s->radius / body->length;
                source.spacing = source.radius / 6.0;
                for (int c = 0; c < 3; c++) {
                    source.a[c] = source.b[c] = s->center[c] / body->length;
                }
            } else if (s->kind == PALPATE_SELECT_BOX) {
                source.spacing = HUGE_VAL;
                for (int c = 0; c < 3; c++) {
                    double extent = (s->high[c] - s->low[c]) / body->length;
                    source.a[c] = source.b[c] = 0.5 * (s->low[c] + s->high[c]) / body->length;
                    source.radius += 0.25 * extent * extent;
                    source.spacing =
                        extent > 1e-3 ? fmin(source.spacing, extent / 6.0) : source.spacing;
                }
                source.radius = sqrt(source.radius);
            } else {
                continue;
            }
            source.spacing = pal_grid(fmax(source.spacing, 1e-4));
            source.radius = pal_grid(source.radius);
            for (int c = 0; c < 3; c++) {
                source.a[c] = source.b[c] = pal_grid(source.a[c]);
            }
            if (source.spacing < rough.cap) {
                status = pal_size_add(&rough, &source);
            }
        }
    }
    if (status == PALPATE_OK) {
        status = body->is_file
                     ? pal_smesh_refine(&body->mesh, &body->shape, &rough, error)
                     : pal_smesh_remesh(&body->mesh, &body->shape, &rough, 2, NULL, error);
    } else {
        status = pal_fail(error, status, "body.patches: no memory for their rims");
    }
    pal_size_clear(&rough);
    return status;
}

pal_status pal_rims_imprint(pal_scene *scene, pal_body *body, pal_size_field *size,
                            pal_error *error) {
    int any = 0;
    for (int32_t p = 0; p < scene->patch_count; p++) {
        any |= has_rim(scene, scene->patch + p);
    }
    pal_status status = !any && body->is_file ? PALPATE_OK : prepare(scene, body, size, error);
    for (int32_t p = 0; p < scene->patch_count && status == PALPATE_OK; p++) {
        if (has_rim(scene, scene->patch + p)) {
            status = imprint_patch(scene, scene->patch + p, body, size, error);
        }
    }
    return status;
}
