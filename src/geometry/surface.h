/// @file surface.h  Surface files: read, weld, check, remesh.
#ifndef PALPATE_SRC_SURFACE_H
#define PALPATE_SRC_SURFACE_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/geometry/geometry.h"

/// A triangle soup: indices into vertices, in the file's unit.
typedef struct pal_surface {
    int32_t vertex_count, triangle_count;
    double *x;  ///< (vertex_count x 3)
    int32_t *v; ///< (triangle_count x 3)
} pal_surface;

void pal_surface_clear(pal_surface *s);

/// Read an STL, OBJ or PLY file and weld vertices at the same place (importers split them by normal
/// and texture). Triangles only (polygons are cut into triangles).
/// @return PALPATE_OK; PALPATE_ERROR_IO (no file, not a surface), _GEOMETRY (not finite, empty),
/// _MEMORY
pal_status pal_surface_read(const char *path, pal_surface *out, pal_error *error);

/// The same, each vertex once and numbered as the file numbers it: `v` lines of an OBJ file,
/// elements of a PLY file, used or not, several at one place or not. An STL file numbers none:
/// welded, in the order of first use. Polygons of an OBJ file become fans.
/// @return as pal_surface_read
pal_status pal_surface_read_in_order(const char *path, pal_surface *out, pal_error *error);

/// OBJ for pal_surface_read_in_order (obj_read.c).
pal_status pal_obj_read(const char *path, pal_surface *out, pal_error *error);

/// Vertices at the same place (within 1e-6 of the extent).
/// @param[out] same  (vertex_count) one vertex for all of a place, itself when it is alone
/// @return PALPATE_OK; _MEMORY
pal_status pal_surface_twins(const pal_surface *s, int32_t *same, pal_error *error);

/// Give vertices at the same place one number, in the order of first use; drop unused ones.
/// @return PALPATE_OK; _MEMORY
pal_status pal_surface_weld(pal_surface *s, pal_error *error);

/// Check that the surface bounds a body; repair what is unambiguous (duplicate and collapsed
/// triangles are dropped, orientation made consistent and outward).
/// @param unit      metres per file unit, for coordinates in messages
/// @param repaired  number of triangles turned or dropped
/// @return PALPATE_OK; PALPATE_ERROR_GEOMETRY saying what, how often, where and the remedy; _MEMORY
pal_status pal_surface_check(pal_surface *s, double unit, int32_t *repaired, pal_error *error);

/// Body of a scene whose geometry is a file.
pal_status pal_surface_body(pal_scene *scene, pal_body *body, pal_error *error);

/// Mark the edges whose triangles' normals have a smaller cosine, where they form closed networks
/// (ends that fade out are dropped, they would only pin single nodes), and hand their segments to
/// the shape.
pal_status pal_surface_sharpen(pal_body *body, double cosine, pal_error *error);

/// Remesh body->mesh to the spacing wanted, or keep the input's triangles, cut where they are too
/// long, when that fails its checks (with a warning).
/// @param size  may be made finer where the surface is thinner than the spacing
pal_status pal_surface_remesh(pal_scene *scene, pal_body *body, pal_size_field *size,
                              const pal_progress *progress, pal_error *error);

#endif
