/// @file rims.h  Patch rims: cut the surface along them and grade the spacing towards them.
#ifndef PALPATE_SRC_RIMS_H
#define PALPATE_SRC_RIMS_H

#include "src/geometry/geometry.h"

/// Refinement balls and the scene's spacing, normalised (no rims yet).
pal_status pal_size_from_scene(const pal_scene *scene, double length, pal_size_field *out,
                               pal_error *error);

/// Cut body->mesh along the boundary of every patch that has a rim, mark the rim's edges as
/// features and add the rims (as segments) to the size field.
pal_status pal_rims_imprint(pal_scene *scene, pal_body *body, pal_size_field *size,
                            pal_error *error);

#endif
