/// @file clouds.h  Clouds for tests: hand-filled scenes, and dumping a cloud to text.
#ifndef PALPATE_TESTS_SUPPORT_CLOUDS_H
#define PALPATE_TESTS_SUPPORT_CLOUDS_H

#include "src/scene/scene.h"

enum { TEST_SCENE_MAX = 4 };

/// A scene that needs no file: clear with memset; lists point into the struct itself.
typedef struct test_scene {
    pal_scene scene;
    pal_refine refine[TEST_SCENE_MAX];
    pal_scene_patch patch[TEST_SCENE_MAX];
    pal_selector selector[TEST_SCENE_MAX];
} test_scene;

/// Defaults: nothing refined, no patches, grading 0.45.
void test_scene_init(test_scene *t, pal_geometry_kind kind, double spacing);
void test_scene_box(test_scene *t, double x, double y, double z, const double center[3],
                    double spacing);
/// The hemisphere of the design (R = 0.05, patch at the pole with its rim), all spacings x factor.
/// @param ball  also the refine ball {pole, 0.015, 0.0022}
void test_scene_hemisphere(test_scene *t, double factor, double scale, int ball);
void test_scene_refine_ball(test_scene *t, const double center[3], double radius, double spacing);
/// A patch selected by a ball; rim_spacing < 0: auto.
void test_scene_patch_ball(test_scene *t, const char *name, const double center[3], double radius,
                           double rim_spacing);
/// Free the warnings.
void test_scene_clear(test_scene *t);

/// Text: "N ns ntri ntet length", then positions (normalised), triangles, tets. @return 0 on
/// success
int test_cloud_dump(const pal_cloud *cloud, const char *path);

#endif
