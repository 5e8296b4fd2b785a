/// @file scene_scale.c  Scaling all node spacings of a scene together.
#include <math.h>
#include <stdlib.h>

#include "haptic/base/error.h"
#include "src/scene/scene.h"
#include "src/scene/scene_hash.h"

pal_status pal_scene_scale_spacing(pal_scene *scene, double factor, pal_error *error) {
    if (!(factor > 0.0) || !isfinite(factor)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "factor of the spacings: %g; must be positive", factor);
    }
    scene->spacing *= factor;
    for (int32_t i = 0; i < scene->refine_count; i++) {
        scene->refine[i].spacing *= factor;
    }
    for (int32_t i = 0; i < scene->patch_count; i++) {
        scene->patch[i].rim_spacing *=
            factor; // a negative one is a multiple of the automatic spacing
    }
    return pal_scene_write_canonical(scene, error);
}
