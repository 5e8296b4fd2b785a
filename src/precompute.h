/// @file precompute.h  The offline stage after the cloud (private: pal_precompute and its tests).
#ifndef PALPATE_SRC_PRECOMPUTE_H
#define PALPATE_SRC_PRECOMPUTE_H

#include "src/cloud/cloud.h"
#include "src/scene/scene.h"
#include "src/cloud/scene_check.h"

/// Fill, assemble, factor, solve, certify. `model` is a new one; on failure the caller frees it.
/// @return as pal_precompute
pal_status pal_build_on_cloud(pal_scene *scene, const pal_cloud *cloud, const pal_skin_source *skin,
                              const pal_node_sets *sets, const pal_progress *progress,
                              pal_model *model, pal_error *error);

#endif
