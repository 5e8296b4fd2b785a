/// @file scene_size.h  Is the spacing sensible for the body? (private)
#ifndef PALPATE_SRC_SCENE_SIZE_H
#define PALPATE_SRC_SCENE_SIZE_H

#include "src/scene/scene.h"

/// A scene that asks for more nodes than this is refused before anything is built.
enum { PALPATE_SCENE_NODES_MAX = 200000 };

/// Nodes that the scene's spacings ask for in a body of this volume [m^3]; good to a factor of 2.
double pal_scene_predict_nodes(const pal_scene *scene, double volume);

/// Refuse spacings above half the body or with absurdly many nodes; warn about single layers. The
/// loader does it for primitives; whoever reads a surface file does it with what was read.
/// @param low, high  bounding box [m]
/// @param volume     of the body [m^3]
/// @return PALPATE_OK; PALPATE_ERROR_SCENE, located at body.spacing; _MEMORY
pal_status pal_scene_check_size(pal_scene *scene, const double low[3], const double high[3],
                                double volume, pal_error *error);

/// The same for a body that is a primitive; nothing for files.
pal_status pal_scene_check_primitive(pal_scene *scene, pal_error *error);

#endif
