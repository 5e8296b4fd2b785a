/// @file galerkin_trial.h  Wider trial functions for the Galerkin method: MLS on overlapping
/// spheres.
///
/// Each node is the centre of a sphere whose radius follows the local spacing (paper 1,
/// section 2.1), so on a graded cloud fine and coarse nodes reach equally far relative to their own
/// spacing; a fixed number of nearest nodes sees the fine side only. Thread: functions are
/// reentrant.
#ifndef PALPATE_SRC_GALERKIN_TRIAL_H
#define PALPATE_SRC_GALERKIN_TRIAL_H

#include <palpate/status.h>

#include "src/cloud/cloud.h"
#include "src/discretization/discretization.h"
#include "src/discretization/galerkin_regions.h"

/// Replace the mean gradients of PAIR regions (made with the cell's own nodes) by those of MLS
/// trial functions, linear basis, weight quartic(s) / s^2p, s = |x - x_J| / r_J.
/// @param[in,out] pairs  regions of kind PAIR; unchanged on error
/// @param neighbours     spheres over a point, on average: sets their radii; 5 to 400
/// @param exponent       p of the singular weight, 0..8
/// @param[in,out] report grown: points whose spheres do not determine a linear fit; they keep their
///                       cell's own nodes
/// @return PALPATE_OK, _MEMORY, _ARGUMENT
pal_status pal_regions_widen(pal_regions *pairs, const pal_cloud *cloud, int32_t neighbours,
                             int32_t exponent, pal_stencil_report *report, pal_error *error);

#endif
