/// @file cloud.h  The node cloud: what the geometry stage hands to the discretizations.
///
/// Coordinates are normalised: x_physical = length * x, with the body's size mapped to order one
/// and every coordinate rounded to a fixed binary grid, so that the same shape at any absolute size
/// gives the same cloud bit for bit. Everything offline (MLS, assembly, solve) works in these
/// coordinates with E = 1; compliance.c puts the units back: C = C~ / (E length).
///
/// Nodes [0, surface_count) lie on the surface. Tetrahedra give structure only (cells, volumes,
/// areas), no element interpolates anything (paper 1, section 2.2).
#ifndef PALPATE_SRC_CLOUD_H
#define PALPATE_SRC_CLOUD_H

#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_cloud {
    double length;         ///< metres per unit of normalised length
    int32_t node_count;    ///< N
    int32_t surface_count; ///< nodes on the surface, first in order
    double *position;      ///< (N x 3)
    double *spacing;       ///< (N) local spacing: mean length of the node's tetrahedron edges
    double *normal;        ///< (surface_count x 3) unit outward: area vector normalised
    double *area_vector;   ///< (surface_count x 3) sum of the node's triangle area vectors / 3
    double *area;          ///< (surface_count) sum of the node's triangle areas / 3
    double *volume;        ///< (N) median-dual cell volume: sum of the node's tet volumes / 4
    int32_t triangle_count;
    int32_t *triangle; ///< (triangle_count x 3) outward counter-clockwise, surface nodes
    int32_t tet_count;
    int32_t *tet; ///< (tet_count x 4) positive volume: (b-a)x(c-a).(d-a) > 0
} pal_cloud;

/// Free every array and zero the struct.
void pal_cloud_clear(pal_cloud *cloud);

/// From positions, surface_count, triangles and tets: fill spacing, normals, areas and volumes
/// (allocates them; what was there is freed first). Checks indices, orientation of every
/// tetrahedron, that the triangles are exactly the tetrahedra's boundary, closed and outward, that
/// every node has a tetrahedron and that the first surface_count nodes, and no others, are on it.
/// @return PALPATE_OK; PALPATE_ERROR_CLOUD (located, in normalised coordinates);
/// PALPATE_ERROR_MEMORY
pal_status pal_cloud_complete(pal_cloud *cloud, pal_error *error);

/// Structured test cloud: box [0,sx]x[0,sy]x[0,sz] with n cells per axis, six tets a cell, inside
/// nodes jittered by `jitter` x spacing (surface nodes within their face), deterministic in `seed`.
/// length = 1. Where a jitter would turn a tetrahedron inside out its nodes are moved less.
pal_status pal_cloud_box(pal_cloud *cloud, const double size[3], const int n[3], double jitter,
                         uint64_t seed, pal_error *error);

/// What a cloud looks like: for the printout of `precompute` and for tests.
typedef struct pal_cloud_report {
    int32_t node_count, surface_count, interior_count;
    int32_t triangle_count, tet_count;
    double spacing_min, spacing_mean, spacing_max; ///< of the nodes' spacings [m]
    double volume;                                 ///< [m^3]
    double area;                                   ///< [m^2]
    double dihedral_min, dihedral_max;             ///< smallest and largest of all tets [degrees]
    double quality_min, quality_mean;              ///< 12 (3 V)^(2/3) / sum of edge^2: 1 is regular
    int32_t surface_tets;                          ///< tets whose four nodes are all on the surface
    double edge_min;                               ///< shortest edge over the spacing there
} pal_cloud_report;

/// Measure a completed cloud. Cost: O(tets). Thread: any.
void pal_cloud_measure(const pal_cloud *cloud, pal_cloud_report *out);

#endif
