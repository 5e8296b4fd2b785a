/// @file scene_hash.h  The canonical text of a scene (private).
#ifndef PALPATE_SRC_SCENE_HASH_H
#define PALPATE_SRC_SCENE_HASH_H

#include "src/scene/scene.h"

/// Write scene->canonical: every key that determines the model, defaults included, one a line,
/// numbers as %.17g. The thread's locale must be "C". @return PALPATE_OK, _MEMORY
pal_status pal_scene_write_canonical(pal_scene *scene, pal_error *error);

#endif
