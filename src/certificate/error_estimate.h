/// @file error_estimate.h  How far a model's forces are from converged ones, from a second cloud.
///
/// The force of a bonded patch converges like the spacing h at its rim (the stress is singular
/// there; measured: +2.0, +1.1, +0.6 % at 1.4, 1.0, 0.7 mm). With F(h) = F + c h, the forces of two
/// clouds whose spacings all differ by the factor r give the error of the finer one: (F(r h) -
/// F(h)) / (r - 1). (Richardson 1911.) One pair of clouds is a sample: the estimate is meant to be
/// right within a factor of two or three, and never below what the change of cloud alone does.
#ifndef PALPATE_SRC_ERROR_ESTIMATE_H
#define PALPATE_SRC_ERROR_ESTIMATE_H

#include "haptic/model/model.h"
#include "src/scene/scene.h"

/// Spacing of the coarser cloud over that of the model's.
#define PALPATE_ESTIMATE_RATIO 1.5

/// A copy of the scene for the coarser cloud: spacings scaled, only what its patches need. Shares
/// all else with `scene`; free with pal_estimate_scene_clear. @return PALPATE_OK; _MEMORY
pal_status pal_estimate_scene(const pal_scene *scene, pal_scene *coarse, pal_error *error);
void pal_estimate_scene_clear(pal_scene *coarse);

/// The largest estimated relative error of the patches' forces over the three axes; negative when
/// there is no patch to compare.
double pal_estimate_error(const pal_model *fine, const pal_model *coarse);

#endif
