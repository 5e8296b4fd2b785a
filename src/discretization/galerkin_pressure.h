/// @file galerkin_pressure.h  The pressure part of the displacement/pressure form
/// (method_galerkin.c).
///
/// Per pair of nodes (x, y) that share a tetrahedron: the divergence entries of the displacement of
/// x on the pressure row of y and the other way round, and the pressure-pressure entry.
#ifndef PALPATE_SRC_GALERKIN_PRESSURE_H
#define PALPATE_SRC_GALERKIN_PRESSURE_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/discretization/galerkin_regions.h"

typedef struct pal_pressure {
    int32_t node_count;
    int64_t *start;     ///< (node_count + 1)
    int32_t *column;    ///< (start[node_count]) node y of each row x, ascending
    double *gradient_x; ///< (start[..] x 3) sum V_T/4 g_x, over size of y: u of x on pressure of y
    double *gradient_y; ///< (start[..] x 3) sum V_T/4 g_y, over size of x: u of y on pressure of x
    double *mass;       ///< (start[..]) (V/kappa + stabilization) entry, scaled by both sizes
} pal_pressure;

/// @param tets         regions of kind TET
/// @param bulk         kappa (E = 1)
/// @param compliance   stabilization / mu: factor of the pressure fluctuation term
/// @return PALPATE_OK or _MEMORY (out is cleared)
pal_status pal_pressure_create(pal_pressure *out, const pal_regions *tets, int32_t node_count,
                               double bulk, double compliance, pal_error *error);
void pal_pressure_clear(pal_pressure *pressure);

#endif
