/// @file rest_rig.h  Models that have a surface and nothing else, for the geometry of contact.
#ifndef PALPATE_TESTS_REST_RIG_H
#define PALPATE_TESTS_REST_RIG_H

#include "haptic/contact/contact_surface.h"
#include "haptic/contact/contact_weights.h"

typedef struct rest_rig {
    pal_model *model; ///< all nodes are touchable columns
    pal_rest_surface surface;
    pal_weights_table weights;
    void *surface_memory, *weights_memory;
} rest_rig;

/// Icosahedron cut `levels` times, nodes at radius 1 moved along the surface by `jitter` of an
/// edge, then scaled by size: a sphere or an ellipsoid. Aborts the test when out of memory, as the
/// others do.
void rest_rig_sphere(rest_rig *rig, int levels, double jitter, const double size[3]);

/// Box [0, size] with n x n squares per face (two triangles each).
void rest_rig_box(rest_rig *rig, int n, const double size[3]);

/// Build surface and weights (again: after changes of node flags).
void rest_rig_build(rest_rig *rig, int32_t nodes, int32_t power);

void rest_rig_free(rest_rig *rig);

/// (-1, 1), from a state that starts at 1 to any fixed number.
double rest_rig_random(uint64_t *state);

#endif
