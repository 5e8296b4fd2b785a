/// @file geometry.h  A scene's body in normalised coordinates, as a closed triangle mesh.
#ifndef PALPATE_SRC_GEOMETRY_H
#define PALPATE_SRC_GEOMETRY_H

#include "src/geometry/bvh.h"
#include "src/scene/scene.h"
#include "src/geometry/shape.h"
#include "src/geometry/surface_mesh.h"

typedef struct pal_body {
    double length;         ///< metres per unit
    pal_shape shape;       ///< constraints: the body's faces, later the rims' surfaces too
    pal_surface_mesh mesh; ///< closed triangulation, nodes on their constraints
    double least_extent;   ///< smallest extent (normalised): a spacing above it makes no sense
    int is_file;
    // surface file only: the checked input, normalised
    int32_t input_vertices, input_triangles;
    double *input_x;
    int32_t *input_v;
    pal_bvh input_tree;
} pal_body;

/// Round to the grid of normalised coordinates, 2^-36: the same shape at any size gives the same
/// bits.
double pal_grid(double x);

/// Make the body of a scene: primitives exactly, surface files read, welded and checked.
/// @return PALPATE_OK; PALPATE_ERROR_GEOMETRY (located), _IO, _MEMORY
pal_status pal_body_make(pal_scene *scene, pal_body *body, pal_error *error);
void pal_body_clear(pal_body *body);

#endif
