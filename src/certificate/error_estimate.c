/// @file error_estimate.c  Two clouds, one difference (see error_estimate.h).
#include "src/certificate/error_estimate.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/certificate/contact_stiffness.h"

pal_status pal_estimate_scene(const pal_scene *scene, pal_scene *coarse, pal_error *error) {
    *coarse = *scene;
    coarse->refine = malloc(((size_t)scene->refine_count + 1) * sizeof *coarse->refine);
    coarse->patch = malloc(((size_t)scene->patch_count + 1) * sizeof *coarse->patch);
    coarse->canonical = NULL;
    coarse->warning_count = 0;
    coarse->warning = NULL;
    if (coarse->refine == NULL || coarse->patch == NULL) {
        pal_estimate_scene_clear(coarse);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    // empty lists are null, which memcpy may not be given
    if (scene->refine_count > 0) {
        memcpy(coarse->refine, scene->refine, (size_t)scene->refine_count * sizeof *coarse->refine);
    }
    if (scene->patch_count > 0) {
        memcpy(coarse->patch, scene->patch, (size_t)scene->patch_count * sizeof *coarse->patch);
    }
    coarse->touchable.count = 0; // the patches' columns only
    coarse->probe_count = 0;
    coarse->store_rows = PALPATE_STORE_NONE;
    coarse->certify_warn = 1;
    coarse->estimate = 0;
    pal_status status = pal_scene_scale_spacing(coarse, PALPATE_ESTIMATE_RATIO, error);
    if (status != PALPATE_OK) {
        pal_estimate_scene_clear(coarse);
    }
    return status;
}

void pal_estimate_scene_clear(pal_scene *coarse) {
    for (int32_t i = 0; i < coarse->warning_count; i++) {
        free(coarse->warning[i]);
    }
    free(coarse->warning);
    free(coarse->canonical);
    free(coarse->refine);
    free(coarse->patch);
    memset(coarse, 0, sizeof *coarse);
}

double pal_estimate_error(const pal_model *fine, const pal_model *coarse) {
    double worst = -1.0;
    for (int32_t p = 0; p < fine->info.patch_count; p++) {
        double a[9], b[9];
        const pal_patch *f = &fine->patch[p], *c = &coarse->patch[p];
        if (pal_contact_stiffness(fine->c_tt, fine->info.column_count, f->column, f->count, a) !=
                PALPATE_OK ||
            pal_contact_stiffness(coarse->c_tt, coarse->info.column_count, c->column, c->count,
                                  b) != PALPATE_OK) {
            continue;
        }
        for (int axis = 0; axis < 3; axis++) {
            double size = 0.0, off = 0.0;
            for (int i = 0; i < 3; i++) {
                size += a[3 * i + axis] * a[3 * i + axis];
                off += (b[3 * i + axis] - a[3 * i + axis]) * (b[3 * i + axis] - a[3 * i + axis]);
            }
            worst = fmax(worst, sqrt(off / size) / (PALPATE_ESTIMATE_RATIO - 1.0));
        }
    }
    return worst;
}
