/// @file galerkin_inf_sup.h  Numerical inf-sup test of the displacement/pressure pair. Dense: small
/// clouds.
#ifndef PALPATE_SRC_GALERKIN_INF_SUP_H
#define PALPATE_SRC_GALERKIN_INF_SUP_H

#include <palpate/status.h>

#include "src/discretization/discretization.h"

typedef struct pal_inf_sup {
    double beta; ///< smallest nonzero inf-sup value; stable when it does not fall with refinement
    int32_t zero_modes; ///< pressures that nothing sees; 1 when all of the surface is held, else 0
    int32_t pressures;
} pal_inf_sup;

/// beta^2 = smallest nonzero eigenvalue of (B K^-1 B^T + S) p = beta^2 M p in the limit nu -> 1/2,
/// with K the deviatoric stiffness, S the method's stabilization and M = diag(V_I) / mu the
/// pressure's norm (Chapelle, Bathe, Computers & Structures 47, 1993, with S as in Bochev,
/// Dohrmann, Gunzburger 2006).
/// @param method  volumetric is taken as mixed; stabilization and neighbours as given
/// @return PALPATE_OK; _SINGULAR (not held), _MEMORY, and what pal_method_galerkin returns
/// Cost: O(unknowns^3), about 10 s for 700 nodes. Thread: any.
pal_status pal_galerkin_inf_sup(const pal_cloud *cloud, const uint8_t *fixed,
                                const pal_method *method, pal_inf_sup *out, pal_error *error);

#endif
