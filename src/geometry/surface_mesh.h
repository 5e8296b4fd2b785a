/// @file surface_mesh.h  A closed triangle mesh that can be cut and remeshed.
///
/// Half-edge e = 3 t + k runs from v[e] to v[next(e)] in triangle t; twin[e] runs the other way in
/// the neighbour. Feature edges (sharp edges of the body, rims of patches) carry the constraints of
/// their curve and are never flipped away or crossed. Dead triangles have v[3 t] = -1. Thread: one.
#ifndef PALPATE_SRC_SURFACE_MESH_H
#define PALPATE_SRC_SURFACE_MESH_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/geometry/shape.h"

typedef struct pal_surface_mesh {
    int32_t vertex_count, vertex_capacity;
    double *x;               ///< (vertex_count x 3)
    double *h;               ///< (vertex_count) spacing wanted there
    pal_constraint_set *set; ///< (vertex_count) what the vertex must stay on
    int32_t *out;            ///< (vertex_count) an outgoing half-edge; -1: dead
    int32_t triangle_count, triangle_capacity;
    int32_t *v;               ///< (triangle_count x 3)
    int32_t *twin;            ///< (triangle_count x 3)
    uint8_t *feature;         ///< (triangle_count x 3) 1 on both halves of a feature edge
    pal_constraint_set *edge; ///< (triangle_count x 3) constraints of a feature edge's curve
    int16_t *face;            ///< (triangle_count) the constraint that is the body's face
    int sharp;                ///< constraint whose curves may have corners; -1: none
} pal_surface_mesh;

enum { PALPATE_VERTEX_SMOOTH, PALPATE_VERTEX_CURVE, PALPATE_VERTEX_CORNER };

/// From x (n x 3), v (m x 3) and each triangle's face constraint (NULL: all 0). Edges between
/// different faces become features. The surface must be closed and manifold.
pal_status pal_smesh_build(pal_surface_mesh *m, const double *x, int32_t vertex_count,
                           const int32_t *v, int32_t triangle_count, const int16_t *face,
                           pal_error *error);
void pal_smesh_clear(pal_surface_mesh *m);

/// A copy into an empty mesh.
pal_status pal_smesh_copy(pal_surface_mesh *to, const pal_surface_mesh *from, pal_error *error);

static inline int32_t pal_smesh_next(int32_t e) {
    return e % 3 == 2 ? e - 2 : e + 1;
}
static inline int32_t pal_smesh_prev(int32_t e) {
    return e % 3 == 0 ? e + 2 : e - 1;
}
/// Head of a half-edge (its tail is m->v[e]).
static inline int32_t pal_smesh_head(const pal_surface_mesh *m, int32_t e) {
    return m->v[pal_smesh_next(e)];
}
/// The outgoing half-edge after e around its tail.
static inline int32_t pal_smesh_around(const pal_surface_mesh *m, int32_t e) {
    return m->twin[pal_smesh_prev(e)];
}

/// How a vertex may move: PALPATE_VERTEX_*; the two feature half-edges of a curve vertex go to
/// along[2] (may be NULL).
int pal_smesh_kind(const pal_surface_mesh *m, int32_t vertex, int32_t along[2]);

/// Mark both halves of an edge as a feature with these constraints added.
void pal_smesh_mark(pal_surface_mesh *m, int32_t e, pal_constraint_set set);

/// Half-edge from a to b, or -1.
int32_t pal_smesh_find(const pal_surface_mesh *m, int32_t a, int32_t b);

/// Insert a vertex at x on edge e (not projected). @return the new vertex or a negative pal_status
int32_t pal_smesh_split(pal_surface_mesh *m, int32_t e, const double x[3]);

/// Turn edge e between the other two corners of its triangles. @return 1 when done, 0 when the mesh
/// would not stay a manifold or the edge is a feature
int pal_smesh_flip(pal_surface_mesh *m, int32_t e);

/// Merge the tail of e into its head. The caller has checked positions and features.
/// @return 1 when done, 0 when the mesh would not stay a manifold (nothing changed)
int pal_smesh_collapse(pal_surface_mesh *m, int32_t e);

/// Drop dead triangles and vertices (numbers change, order is kept).
pal_status pal_smesh_compact(pal_surface_mesh *m, pal_error *error);

/// Unit normal of a triangle with vertex `vertex` (-1: none) moved to `moved`; returns twice the
/// area.
double pal_smesh_normal(const pal_surface_mesh *m, int32_t t, int32_t vertex, const double moved[3],
                        double n[3]);

/// Sum of the area vectors (times two) of the triangles around a vertex: the outward direction
/// there.
void pal_smesh_vertex_normal(const pal_surface_mesh *m, int32_t vertex, double n[3]);

/// Enclosed volume.
double pal_smesh_volume(const pal_surface_mesh *m);

/// Remesh: edges as long as the size field says, triangles near equilateral, features kept, every
/// vertex on its constraints (remesh.c). `rounds` of split, collapse, flip, smooth.
/// @param progress  may be NULL; reports 0.05 to 0.2 of stage "cloud"
/// @return PALPATE_OK; PALPATE_ERROR_MEMORY; _CANCELLED
pal_status pal_smesh_remesh(pal_surface_mesh *m, const pal_shape *shape, const pal_size_field *size,
                            int rounds, const pal_progress *progress, pal_error *error);

/// Only split what is longer than the size field says (keeps the surface as it is).
pal_status pal_smesh_refine(pal_surface_mesh *m, const pal_shape *shape, const pal_size_field *size,
                            pal_error *error);

/// Cut the mesh along constraint `id` = 0: afterwards no edge has its ends strictly on two sides
/// (imprint.c). A cut vertex satisfies the constraint besides its own.
pal_status pal_smesh_cut(pal_surface_mesh *m, const pal_shape *shape, int id, pal_error *error);

#endif
