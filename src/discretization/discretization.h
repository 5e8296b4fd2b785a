/// @file discretization.h  The one interface of all discretizations.
///
/// A discretization takes nodes + cells + material + supports and returns a linear system in
/// normalised coordinates with E = 1 (cloud.h):
///
///     K U = B F ,      U: unknowns, F: nodal forces at the free surface nodes
///
/// U holds the displacement of every free node (dof 3*node + c -> unknown dof_unknown[3*node+c])
/// and whatever else the method needs (fictitious nodes, pressures). The contract of all methods:
/// column (J, c) of C = K^-1 B is the displacement of every node under a unit *nodal force* in
/// direction c at surface node J (design section 1).
#ifndef PALPATE_SRC_DISCRETIZATION_H
#define PALPATE_SRC_DISCRETIZATION_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/cloud/cloud.h"
#include "src/discretization/sparse.h"

typedef enum pal_method_kind {
    PALPATE_METHOD_POINT = 0,
    PALPATE_METHOD_CELL = 1,
    PALPATE_METHOD_GALERKIN = 2
} pal_method_kind;

typedef enum pal_basis {
    PALPATE_BASIS_LINEAR = 1,
    PALPATE_BASIS_QUADRATIC = 2,
    PALPATE_BASIS_CUBIC = 3
} pal_basis;

typedef enum pal_derivatives {
    PALPATE_DERIVATIVES_FULL = 0,
    PALPATE_DERIVATIVES_DIFFUSE = 1
} pal_derivatives;

typedef enum pal_volumetric {
    PALPATE_VOLUMETRIC_PLAIN = 0, ///< the full stress at the integration point
    PALPATE_VOLUMETRIC_NODAL = 1, ///< volumetric part averaged at the nodes (design 2.2)
    PALPATE_VOLUMETRIC_MIXED = 2, ///< displacement/pressure (paper 1, section 2.4)
    PALPATE_VOLUMETRIC_PATCH = 3  ///< cell: nodal, and above some bulk modulus over groups of cells
} pal_volumetric;

typedef enum pal_cell_form {
    PALPATE_CELL_SYMMETRIC =
        0, ///< strains of pairs and dilatations of nodes averaged over the cells
    PALPATE_CELL_COLLOCATED = 1 ///< MLS gradient at the pairs' midpoints (design 2.2), nonsymmetric
} pal_cell_form;

/// Options of a method; 0 in a numeric field means the method's own default.
typedef struct pal_method {
    pal_method_kind kind;
    pal_basis basis;
    pal_derivatives derivatives;
    int32_t neighbours; ///< nodes per stencil
    int32_t exponent;   ///< p of the singular weight s^-2p
    int32_t
        fictitious; ///< point: 1: fictitious nodes outside each traction node + PDE on the boundary
    pal_volumetric volumetric;
    pal_cell_form form;   ///< cell
    double stabilization; ///< method's own stabilization factor; negative: default
    int32_t integration;  ///< galerkin: points per cell; 0: default
} pal_method;

/// What happened to the stencils.
typedef struct pal_stencil_report {
    int64_t count;          ///< stencils built
    int64_t grown;          ///< deficient ones whose support had to grow
    double worst_condition; ///< of the scaled moment matrix
    double worst_point[3];  ///< where (normalised)
    int32_t min_neighbours, max_neighbours;
} pal_stencil_report;

typedef struct pal_system {
    int32_t node_count;
    int32_t unknown_count; ///< n
    int32_t *dof_unknown;  ///< (3 N) unknown of each displacement dof, -1 where fixed
    pal_sparse matrix;     ///< K (n x n), compressed columns
    int32_t symmetric;     ///< 1: K is symmetric (both triangles stored)
    int32_t positive;      ///< 1: K is symmetric positive definite by construction (CHOLMOD)
    pal_sparse load;       ///< B (n x 3 surface_count): right-hand side of a unit nodal force
    pal_sparse reaction;   ///< (3 fixed_count x n): force of the support on each fixed node, per U
    int32_t *fixed_node;   ///< (fixed_count)
    int32_t fixed_count;
    pal_stencil_report stencils;
    char options[256]; ///< the options in effect, "key=value, ..."
} pal_system;

void pal_system_clear(pal_system *system);

/// Build the system of a cloud.
/// @param fixed    (node_count) 1 where the node is held at u = 0 (surface nodes)
/// @param poisson  in (-1, 0.5)
/// @return PALPATE_OK; _ARGUMENT, _STENCIL (located), _MEMORY, _CANCELLED, _UNSUPPORTED
pal_status pal_discretize(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                          const pal_method *method, const pal_progress *progress, pal_system *out,
                          pal_error *error);

/// Each method's own builder (same arguments); pal_discretize dispatches (discretization.c).
pal_status pal_method_point(const pal_cloud *, const uint8_t *fixed, double poisson,
                            const pal_method *, const pal_progress *, pal_system *, pal_error *);
pal_status pal_method_cell(const pal_cloud *, const uint8_t *fixed, double poisson,
                           const pal_method *, const pal_progress *, pal_system *, pal_error *);
pal_status pal_method_galerkin(const pal_cloud *, const uint8_t *fixed, double poisson,
                               const pal_method *, const pal_progress *, pal_system *, pal_error *);

/// Interpolation of the solution at any point of the body: nodes and MLS weights (sum u_h(x) =
/// sum_k weight[k] u(node[k])), for probes and the skin.
/// @param capacity  length of node[] and weight[]
/// @return number of nodes used, or a negative pal_status
int32_t pal_interpolate(const pal_cloud *cloud, const double x[3], int32_t capacity, int32_t *node,
                        double *weight);

/// The same on the first `node_count` nodes alone (e.g. the surface's: they come first).
/// @param position  shape [node_count, 3]
/// Linear MLS on the min(capacity, 16) nearest nodes: exact for linear fields wherever those nodes
/// span space, and within their plane or line where they do not. At a node: that node, weight 1.
/// Cost: O(node_count).
int32_t pal_interpolate_nodes(const double *position, int32_t node_count, const double x[3],
                              int32_t capacity, int32_t *node, double *weight);

#endif
