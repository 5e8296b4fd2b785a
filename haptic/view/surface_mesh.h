/// @file surface_mesh.h  The drawn surface: deformed corners with normals smoothed up to a crease.
#ifndef PALPATE_VIEW_SURFACE_MESH_H
#define PALPATE_VIEW_SURFACE_MESH_H

#include <palpate/engine.h>
#include <palpate/model.h>

/// Corner layout handed to OpenGL: position (3), normal (3), displacement magnitude (1).
enum { PALPATE_CORNER_FLOATS = 7 };

typedef struct pal_surface_mesh {
    const pal_model *model;
    int32_t vertex_count, triangle_count;
    const double *rest;      ///< (vertex_count x 3)
    const int32_t *triangle; ///< (triangle_count x 3)
    float *displacement;     ///< (vertex_count x 3)
    float *face_normal;      ///< (triangle_count x 3), length twice the area
    int32_t *group_start;    ///< (3 triangle_count + 1): faces that share a corner's smooth normal
    int32_t *group_face;
    float *corner; ///< (3 triangle_count x PALPATE_CORNER_FLOATS)
    float largest; ///< displacement magnitude of the last update [m]
} pal_surface_mesh;

pal_status pal_surface_mesh_create(const pal_model *model, pal_surface_mesh *out, pal_error *error);
void pal_surface_mesh_clear(pal_surface_mesh *mesh);
/// Fill `corner` from a frame (NULL: the rest shape).
void pal_surface_mesh_update(pal_surface_mesh *mesh, const pal_frame *frame);

#endif
