/// @file method_point.h  Point collocation, with what each row of its system stands for.
#ifndef PALPATE_SRC_METHOD_POINT_H
#define PALPATE_SRC_METHOD_POINT_H

#include "src/discretization/discretization.h"

typedef enum pal_row_kind {
    PALPATE_ROW_BALANCE = 0, ///< component of div sigma at the node
    PALPATE_ROW_TRACTION = 1 ///< component of sigma n at the node
} pal_row_kind;

/// K's row r applied to a displacement field gives scale * (the component it names), so that a body
/// force b enters the right-hand side as -scale * b, a traction t as scale * t.
typedef struct pal_point_row {
    pal_row_kind kind;
    int32_t node, component;
    double scale;
} pal_point_row;

/// What a system made by pal_point_build stands for, beyond pal_system.
typedef struct pal_point_detail {
    pal_point_row *rows; ///< (unknown_count)
    pal_sparse held;     ///< K's columns of the fixed dofs (unknown_count x 3 fixed_count), in the
                         ///< order of fixed_node: with u there, K U = B F - held u
} pal_point_detail;

void pal_point_detail_clear(pal_point_detail *detail);

/// As pal_method_point, with details of the system.
/// @param[out] detail  NULL: not wanted
pal_status pal_point_build(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                           const pal_method *method, const pal_progress *progress, pal_system *out,
                           pal_point_detail *detail, pal_error *error);

/// The vector the traction row of a surface node uses, sigma v = nodal force: the node's area
/// vector, which serves all faces that meet there at once (see method_point.c).
void pal_point_area_vector(const pal_cloud *cloud, int32_t node, double v[3]);

#endif
