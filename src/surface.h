/// @file surface.h  Surface files: read, weld, check, remesh.
#ifndef PALPATE_SRC_SURFACE_H
#define PALPATE_SRC_SURFACE_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/geometry.h"

/// A triangle soup: indices into vertices, in the file's unit.
typedef struct pal_surface {
    int32_t vertex_count, triangle_count;
    double *x;   ///< (vertex_count x 3)
    int32_t *v;  ///< (triangle_count x 3)
} pal_surface;

void pal_surface_clear(pal_surface *s);

/// Read an STL, OBJ or PLY file and weld vertices at the same place (importers split them by normal
/// and texture). Triangles only (polygons are cut into triangles).
/// @return PALPATE_OK; PALPATE_ERROR_IO (no file, not a surface), _GEOMETRY (not finite, empty), _MEMORY
pal_status pal_surface_read(const char *path, pal_surface *out, pal_error *error);

/// Check that the surface bounds a body; repair what is unambiguous (duplicate and collapsed
/// triangles are dropped, orientation made consistent and outward).
/// @param unit      metres per file unit, for coordinates in messages
/// @param repaired  number of triangles turned or dropped
/// @return PALPATE_OK; PALPATE_ERROR_GEOMETRY saying what, how often, where and the remedy; _MEMORY
pal_status pal_surface_check(pal_surface *s, double unit, int32_t *repaired, pal_error *error);

/// Body of a scene whose geometry is a file.
pal_status pal_surface_body(pal_scene *scene, pal_body *body, pal_error *error);

/// Remesh body->mesh to the spacing wanted, or keep the input's triangles when that fails its checks
/// (with a warning).
/// @param size  may be made finer where the surface is thinner than the spacing
pal_status pal_surface_remesh(pal_scene *scene, pal_body *body, pal_size_field *size,
                              const pal_progress *progress, pal_error *error);

/// The input surface in metres, for rendering.
pal_status pal_surface_skin(const pal_body *body, pal_skin_source *skin, pal_error *error);

#endif
