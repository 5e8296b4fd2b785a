/// Clouds for tests: see clouds.h.
#include "clouds.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>

void test_scene_init(test_scene *t, pal_geometry_kind kind, double spacing) {
    memset(t, 0, sizeof *t);
    pal_scene *s = &t->scene;
    (void)snprintf(s->path, sizeof s->path, "/test.yaml");
    (void)snprintf(s->shown, sizeof s->shown, "test.yaml");
    (void)snprintf(s->geometry.place.key, sizeof s->geometry.place.key, "body.geometry");
    (void)snprintf(s->spacing_place.key, sizeof s->spacing_place.key, "body.spacing");
    s->geometry.kind = kind;
    s->geometry.scale = 1.0;
    s->spacing = spacing;
    s->grading = 0.45;
    s->refine = t->refine;
    s->patch = t->patch;
}

void test_scene_box(test_scene *t, double x, double y, double z, const double center[3],
                    double spacing) {
    const double size[3] = {x, y, z};
    test_scene_init(t, PALPATE_GEOMETRY_BOX, spacing);
    memcpy(t->scene.geometry.size, size, sizeof size);
    memcpy(t->scene.geometry.center, center, sizeof size);
}

void test_scene_refine_ball(test_scene *t, const double center[3], double radius, double spacing) {
    pal_refine *r = t->refine + t->scene.refine_count++;
    r->kind = PALPATE_REFINE_BALL;
    memcpy(r->center, center, sizeof r->center);
    r->radius = radius;
    r->spacing = spacing;
}

void test_scene_patch_ball(test_scene *t, const char *name, const double center[3], double radius,
                           double rim_spacing) {
    int32_t i = t->scene.patch_count++;
    pal_selector *s = t->selector + i;
    s->kind = PALPATE_SELECT_BALL;
    memcpy(s->center, center, sizeof s->center);
    s->radius = radius;
    (void)snprintf(t->patch[i].name, sizeof t->patch[i].name, "%s", name);
    t->patch[i].where.count = 1;
    t->patch[i].where.item = s;
    t->patch[i].rim_spacing = rim_spacing;
}

void test_scene_hemisphere(test_scene *t, double factor, double scale, int ball) {
    const double pole[3] = {0.0, 0.0, 0.05 * scale};
    test_scene_init(t, PALPATE_GEOMETRY_HEMISPHERE, 0.007 * factor * scale);
    t->scene.geometry.radius = 0.05 * scale;
    if (ball) {
        test_scene_refine_ball(t, pole, 0.015 * scale, 0.0022 * factor * scale);
    }
    test_scene_patch_ball(t, "pole", pole, 0.009983 * scale, 0.0007 * factor * scale);
}

void test_scene_clear(test_scene *t) {
    for (int32_t i = 0; i < t->scene.warning_count; i++) {
        free(t->scene.warning[i]);
    }
    free(t->scene.warning);
    t->scene.warning = NULL;
    t->scene.warning_count = 0;
}

int test_cloud_dump(const pal_cloud *c, const char *path) {
    FILE *out = fopen(path, "w");
    if (out == NULL) {
        return 1;
    }
    (void)fprintf(out, "%d %d %d %d %.17g\n", c->node_count, c->surface_count, c->triangle_count,
                  c->tet_count, c->length);
    for (size_t i = 0; i < (size_t)c->node_count; i++) {
        (void)fprintf(out, "%.17g %.17g %.17g\n", c->position[3 * i], c->position[3 * i + 1],
                      c->position[3 * i + 2]);
    }
    for (size_t i = 0; i < (size_t)c->triangle_count; i++) {
        (void)fprintf(out, "%d %d %d\n", c->triangle[3 * i], c->triangle[3 * i + 1],
                      c->triangle[3 * i + 2]);
    }
    for (size_t i = 0; i < (size_t)c->tet_count; i++) {
        (void)fprintf(out, "%d %d %d %d\n", c->tet[4 * i], c->tet[4 * i + 1], c->tet[4 * i + 2],
                      c->tet[4 * i + 3]);
    }
    return fclose(out) != 0;
}
