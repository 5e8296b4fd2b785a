/// @file model_fill.h  Everything of a model but its compliance: nodes, sets, probes, facts.
#ifndef PALPATE_SRC_MODEL_FILL_H
#define PALPATE_SRC_MODEL_FILL_H

#include "haptic/model/model.h"
#include "src/cloud/cloud.h"
#include "src/solution/compliance.h"
#include "src/scene/scene.h"
#include "src/cloud/scene_check.h"

/// Fill `model` (fresh from pal_model_new) from a scene, its cloud and its node sets: positions in
/// metres, columns (touchable and patch nodes), rows (as store.displacement says), patches, probes,
/// runtime, canonical text, facts.
/// @param[out] probes  (scene->probe_count), interpolation weights of the probes
/// @return PALPATE_OK; _SCENE (a probe outside the body, no touchable node and no patch: located),
///         _STENCIL, _MEMORY
pal_status pal_model_fill(const pal_scene *scene, const pal_cloud *cloud, const pal_node_sets *sets,
                          pal_model *model, pal_probe_weights *probes, pal_error *error);

#endif
