/// @file contact_sweep.h  Displacement of the working set's nodes under a contact point's force
/// (private).
///
/// y = R Phi^T e: a weighted sum of columns of the working set's block. Every element is summed
/// over the columns in their order, one rounded product and one rounded sum each, whatever the
/// vector width, so results are the same bits on every x86-64 build. The same source is compiled a
/// second time for AVX2 (without FMA) and chosen at run time. Thread: any.
#ifndef PALPATE_HAPTIC_CONTACT_SWEEP_H
#define PALPATE_HAPTIC_CONTACT_SWEEP_H

#include "haptic/contact/working_set.h"

/// y for the force along one direction. @param slot, phi  the point's nodes, shape [count]
/// @param[out] y  shape [set->stride]; the first 3 set->count are the displacement [m/N]
void pal_sweep_row(const pal_working_set *set, int32_t count, const int32_t *slot,
                   const double *phi, const double along[3], double *y);

/// y along x, y and z, `ld` elements apart.
void pal_sweep_axes(const pal_working_set *set, int32_t count, const int32_t *slot,
                    const double *phi, double *y, size_t ld);

#endif
