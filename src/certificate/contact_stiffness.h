/// @file contact_stiffness.h  What a small bonded contact feels of a compliance block.
#ifndef PALPATE_SRC_CONTACT_STIFFNESS_H
#define PALPATE_SRC_CONTACT_STIFFNESS_H

#include <stdint.h>

#include <palpate/status.h>

/// Total force F = A u on column nodes `set` all displaced by u (paper 1, Eq. 52, summed).
/// @param[in]  c    compliance block, shape [3 columns, 3 columns], column-major, any symmetry
/// @param[in]  set  column indices, shape [count]
/// @param[out] a    stiffness, shape [3, 3], row-major [N/m]
/// @return PALPATE_OK; _SINGULAR, _MEMORY
pal_status pal_contact_stiffness(const double *c, int64_t columns, const int32_t *set,
                                 int32_t count, double a[9]);

/// Work that F = A u does on a tool led around closed paths of unit radius (a circle in each
/// coordinate plane, a figure eight whose lobes lie in different planes), the largest over the
/// paths and both senses, relative to the energy k/2 stored at unit displacement along the stiffest
/// axis. Zero exactly when A is symmetric; positive means that the hand is given energy every turn.
double pal_loop_energy(const double a[9]);

#endif
