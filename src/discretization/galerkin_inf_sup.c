/// @file galerkin_inf_sup.c  Eigenvalues of the pressure Schur complement, dense (LAPACK).
///
/// With K = L L^T and W = L^-1 B^T the Schur complement is G = W^T W + S. The pressure unknowns
/// carry the scale s_I = V_I^(1/3) (galerkin_pressure.c), so M becomes V_I / s_I^2 / mu = s_I / mu,
/// and D^-1/2 G D^-1/2 with D = M has the eigenvalues wanted. Eigenvalues below 1e-9 of the largest
/// are the zero modes: rounding leaves them at 1e-14.
#include "src/discretization/galerkin_inf_sup.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <cblas.h>
#include <lapacke.h>

#include "haptic/base/error.h"

typedef struct dense {
    int32_t displacements, pressures;
    double *stiffness;  ///< (displacements squared)
    double *divergence; ///< (displacements x pressures): B^T, then W
    double *schur;      ///< (pressures squared): S, then G
    double *eigenvalue; ///< (pressures)
} dense;

static pal_status dense_fill(dense *d, const pal_system *s) {
    size_t np = (size_t)s->node_count, nd = (size_t)s->unknown_count - np;
    d->displacements = (int32_t)nd;
    d->pressures = (int32_t)np;
    d->stiffness = calloc(nd * nd + 1, sizeof *d->stiffness);
    d->divergence = calloc(nd * np + 1, sizeof *d->divergence);
    d->schur = calloc(np * np, sizeof *d->schur);
    d->eigenvalue = calloc(np, sizeof *d->eigenvalue);
    if (!d->stiffness || !d->divergence || !d->schur || !d->eigenvalue) {
        return PALPATE_ERROR_MEMORY;
    }
    for (size_t j = 0; j < nd + np; j++) {
        for (int64_t e = s->matrix.start[j]; e < s->matrix.start[j + 1]; e++) {
            size_t i = (size_t)s->matrix.row[e];
            if (i < nd && j < nd) {
                d->stiffness[i + nd * j] = s->matrix.value[e];
            } else if (i < nd) {
                d->divergence[i + nd * (j - nd)] = s->matrix.value[e];
            } else if (j >= nd) {
                d->schur[(i - nd) + np * (j - nd)] = -s->matrix.value[e];
            }
        }
    }
    return PALPATE_OK;
}

static pal_status dense_eigenvalues(dense *d, const pal_cloud *cloud, double mu, pal_error *error) {
    int32_t nd = d->displacements, np = d->pressures;
    if (LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', nd, d->stiffness, nd) != 0) {
        return pal_fail(error, PALPATE_ERROR_SINGULAR,
                        "inf-sup: the deviatoric stiffness is singular: hold three nodes at least");
    }
    cblas_dtrsm(CblasColMajor, CblasLeft, CblasLower, CblasNoTrans, CblasNonUnit, nd, np, 1.0,
                d->stiffness, nd, d->divergence, nd);
    cblas_dsyrk(CblasColMajor, CblasUpper, CblasTrans, np, nd, 1.0, d->divergence, nd, 1.0,
                d->schur, np);
    for (size_t j = 0; j < (size_t)np; j++) {
        for (size_t i = 0; i <= j; i++) {
            d->schur[i + (size_t)np * j] *=
                mu / sqrt(cbrt(cloud->volume[i]) * cbrt(cloud->volume[j]));
        }
    }
    if (LAPACKE_dsyev(LAPACK_COL_MAJOR, 'N', 'U', np, d->schur, np, d->eigenvalue) != 0) {
        return pal_fail(error, PALPATE_ERROR_SINGULAR, "inf-sup: the eigenvalues did not converge");
    }
    return PALPATE_OK;
}

pal_status pal_galerkin_inf_sup(const pal_cloud *cloud, const uint8_t *fixed,
                                const pal_method *method, pal_inf_sup *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    const double poisson = 0.5 - 1e-13; // V / kappa is rounding beside everything else
    pal_method mixed = *method;
    mixed.volumetric = PALPATE_VOLUMETRIC_MIXED;
    pal_system system;
    pal_status status = pal_method_galerkin(cloud, fixed, poisson, &mixed, NULL, &system, error);
    if (status != PALPATE_OK) {
        return status;
    }
    dense d = {0};
    status = dense_fill(&d, &system);
    if (status != PALPATE_OK) {
        (void)pal_fail(error, status, "inf-sup: no memory for %d unknowns", system.unknown_count);
        goto done;
    }
    status = dense_eigenvalues(&d, cloud, 0.5 / (1.0 + poisson), error);
    if (status != PALPATE_OK) {
        goto done;
    }
    out->pressures = d.pressures;
    while (out->zero_modes < d.pressures - 1 &&
           d.eigenvalue[out->zero_modes] < 1e-9 * d.eigenvalue[d.pressures - 1]) {
        out->zero_modes++;
    }
    out->beta = sqrt(fmax(d.eigenvalue[out->zero_modes], 0.0));
done:
    free(d.stiffness);
    free(d.divergence);
    free(d.schur);
    free(d.eigenvalue);
    pal_system_clear(&system);
    return status;
}
