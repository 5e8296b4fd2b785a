/// @file compliance.h  From a factored system to compliance blocks in metres per newton.
///
/// Column (J, c) of C = K^-1 B is the response to a unit nodal force (design section 1). Only the
/// columns of the model's column nodes are solved, only the rows of its column, row and probe nodes
/// are kept. Units: the system is solved in normalised coordinates with E = 1, so with u = L u~ and
/// f = E L^2 f~ the compliance is C = C~ / (E L).
#ifndef PALPATE_SRC_COMPLIANCE_H
#define PALPATE_SRC_COMPLIANCE_H

#include <stdint.h>

#include "haptic/model/model.h"
#include "src/discretization/discretization.h"
#include "src/solution/factor.h"

/// Interpolation of one probe: u(x) = sum_k weight[k] u(node[k]).
enum { PALPATE_PROBE_NODES = 128 };
typedef struct pal_probe_weights {
    int32_t count;
    int32_t node[PALPATE_PROBE_NODES];
    double weight[PALPATE_PROBE_NODES];
} pal_probe_weights;

typedef struct pal_compliance_report {
    double residual; ///< worst ||K u - b|| / ||b|| over the sampled columns, as delivered
    double balance; ///< worst |sum of support reactions + applied force| over them; -1: no supports
    int32_t sampled; ///< columns sampled
    int32_t refined; ///< refinement steps given to every column
} pal_compliance_report;

/// Solve and store the blocks of `model`, whose column_node, row_node, counts and precision are
/// set; allocates c_tt (raw, not symmetrized), c_st and probe_row.
/// @param young   Pa; @param length  metres per normalised length
/// @param probes  (info.probe_count)
/// Cost: column_count * 3 solves on every core. @return PALPATE_OK; _MEMORY, _CANCELLED, _SINGULAR
/// (a solution that is not finite)
pal_status pal_compliance_solve(const pal_system *system, pal_factor *factor, double young,
                                double length, const pal_probe_weights *probes,
                                const pal_progress *progress, pal_model *model,
                                pal_compliance_report *report, pal_error *error);

#endif
