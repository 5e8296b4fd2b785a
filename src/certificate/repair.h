/// @file repair.h  The nearest symmetric positive definite block (repair: positive).
#ifndef PALPATE_SRC_REPAIR_H
#define PALPATE_SRC_REPAIR_H

#include <stdint.h>

#include <palpate/status.h>

/// Largest order the dense eigendecomposition is allowed: moderate sets (2000 column nodes).
enum { PALPATE_REPAIR_MAX = 6000 };

/// Replace C by the symmetric matrix nearest to it in the Frobenius norm whose eigenvalues are at
/// least `floor` times its largest one: the symmetric part with its eigenvalues clipped (Higham
/// 1988).
/// @param[out] change  ||C_new - (C + C^T)/2||_F / ||C||_F
/// @return PALPATE_OK; _UNSUPPORTED when n is above PALPATE_REPAIR_MAX; _MEMORY; _SINGULAR (no
/// eigenvalue is positive, or the decomposition failed)
/// Cost: O(n^3), LAPACK dsyevd.
pal_status pal_repair_positive(double *c, int64_t n, double floor, double *change,
                               pal_error *error);

#endif
