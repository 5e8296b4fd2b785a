/// @file certificate.h  How far a compliance can be trusted (design section 5).
#ifndef PALPATE_SRC_CERTIFICATE_H
#define PALPATE_SRC_CERTIFICATE_H

#include "haptic/model/model.h"
#include "src/solution/compliance.h"
#include "src/discretization/discretization.h"
#include "src/solution/factor.h"

/// What is stored instead of the raw block; the values are those of the scene's `repair`.
typedef enum pal_repair {
    PALPATE_REPAIR_NONE = 0,
    PALPATE_REPAIR_SYMMETRIZE = 1, ///< (C + C^T) / 2
    PALPATE_REPAIR_POSITIVE = 2    ///< nearest symmetric positive definite block (repair.h)
} pal_repair;

/// Certify the model's raw C_TT and replace it as `repair` says. Fills
/// model->info.certificate (all but the fields it has no data for, which are negative).
/// @return PALPATE_OK also when the certificate does not pass (certificate.pass, .reason);
///         _MEMORY, _CANCELLED
/// Cost: O((3 columns)^3 / 3) for the Cholesky factorization. Thread: any; one at a time inside.
pal_status pal_certify(const pal_system *system, const pal_factor_report *factor,
                       const pal_compliance_report *compliance, double length, pal_repair repair,
                       const pal_progress *progress, pal_model *model, pal_error *error);

/// ||C - C^T||_F / ||C||_F of a dense column-major matrix (n x n).
double pal_reciprocity_error(const double *c, int64_t n);

/// C <- (C + C^T) / 2.
void pal_symmetrize(double *c, int64_t n);

/// Extreme eigenvalues of the symmetric part of C (n x n): dense for small n, Lanczos (ARPACK)
/// else; the smallest through a Cholesky factorization when there is one.
/// @param[out] positive  1 when the Cholesky factorization of the symmetric part succeeded
/// @return PALPATE_OK; _MEMORY
pal_status pal_extreme_eigenvalues(const double *c, int64_t n, double *smallest, double *largest,
                                   int *positive, pal_error *error);

#endif
