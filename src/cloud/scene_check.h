/// @file scene_check.h  A scene's selectors applied to its cloud: node sets, and the checks that
/// need them (an empty patch, nothing fixed, a body not held against every rigid motion).
#ifndef PALPATE_SRC_SCENE_CHECK_H
#define PALPATE_SRC_SCENE_CHECK_H

#include "haptic/model/model.h"
#include "src/cloud/cloud.h"
#include "src/scene/scene.h"

/// Sets of surface nodes. `fixed` wins over touchable and patches.
typedef struct pal_node_sets {
    uint8_t *flags; ///< (node_count) PALPATE_NODE_FIXED | PALPATE_NODE_TOUCHABLE
    int32_t fixed_count, touchable_count;
    int32_t patch_count;
    int32_t *patch_start; ///< (patch_count + 1)
    int32_t *
        patch_node; ///< nodes of patch p: patch_node[patch_start[p] .. patch_start[p+1]), ascending
} pal_node_sets;

/// Select the nodes; warnings (a fixed node also touchable or in a patch) go to the scene.
/// @return PALPATE_OK; PALPATE_ERROR_SCENE located at the selector concerned; _MEMORY
pal_status pal_scene_select_nodes(pal_scene *scene, const pal_cloud *cloud, pal_node_sets *out,
                                  pal_error *error);
void pal_node_sets_clear(pal_node_sets *sets);

#endif
