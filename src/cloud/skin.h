/// @file skin.h  The mesh a host draws: read in its file's own order, weighed on the surface nodes.
#ifndef PALPATE_SRC_SKIN_H
#define PALPATE_SRC_SKIN_H

#include "haptic/model/model.h"
#include "src/cloud/cloud.h"
#include "src/geometry/geometry.h"
#include "src/scene/scene.h"

/// The scene's render mesh in metres: its `skin`, else the surface file the body was made from,
/// else nothing (PALPATE_OK, no vertices). Vertices are numbered as in the file, used or not.
/// Triangles of a `skin` keep their winding; those of the body's own file are turned outward as the
/// body's were.
/// @param body  may be NULL when the scene has a skin
/// @return PALPATE_OK; _IO, _GEOMETRY (located), _MEMORY
pal_status pal_skin_read(const pal_scene *scene, const pal_body *body, pal_skin_source *skin,
                         pal_error *error);

/// Weights of the vertices on the stored surface rows: barycentric at the nearest point of the
/// cloud's surface. Nothing to do (and no skin) without vertices or without stored rows. Warns of
/// vertices further from the surface than the node spacing there.
/// @return PALPATE_OK; _SCENE when a vertex lies further away than half the body's size (a wrong
/// scale, located); _MEMORY
pal_status pal_skin_fill(pal_scene *scene, const pal_skin_source *skin, const pal_cloud *cloud,
                         pal_model *model, pal_error *error);

void pal_skin_clear(pal_skin_source *skin);

#endif
