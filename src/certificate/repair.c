/// @file repair.c  Clipping the spectrum of a compliance block (see repair.h).
#include "src/certificate/repair.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>

#include "haptic/base/error.h"
#include "src/certificate/certificate.h"

pal_status pal_repair_positive(double *c, int64_t n, double floor, double *change,
                               pal_error *error) {
    *change = 0.0;
    if (n > PALPATE_REPAIR_MAX) {
        return pal_fail(
            error, PALPATE_ERROR_UNSUPPORTED,
            "repair: positive needs the eigenvectors of %lld rows; allowed: up to %d (%d touchable "
            "nodes); narrow body.touchable or use repair: symmetrize",
            (long long)n, PALPATE_REPAIR_MAX, PALPATE_REPAIR_MAX / 3);
    }
    double all = cblas_dnrm2((int)(n * n), c, 1);
    pal_symmetrize(c, n);
    double *vector = malloc((size_t)(n * n) * sizeof *vector),
           *value = malloc((size_t)n * sizeof *value);
    pal_status status = PALPATE_OK;
    if (vector == NULL || value == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY,
                          "out of memory for the eigenvectors of %lld rows", (long long)n);
    } else {
        cblas_dcopy((int)(n * n), c, 1, vector, 1);
        if (LAPACKE_dsyevd(LAPACK_COL_MAJOR, 'V', 'L', (int)n, vector, (int)n, value) != 0 ||
            !(value[n - 1] > 0.0)) {
            status = pal_fail(error, PALPATE_ERROR_SINGULAR,
                              "repair: positive: no eigenvalue is positive");
        }
    }
    if (status == PALPATE_OK) {
        double least = floor * value[n - 1], square = 0.0;
        // C_new = C + sum over the clipped of (least - w) v v^T: what need not change keeps its
        // bits
        for (int64_t k = 0; k < n && value[k] < least; k++) {
            double add = least - value[k];
            square += add * add;
            cblas_dsyr(CblasColMajor, CblasLower, (int)n, add, vector + k * n, 1, c, (int)n);
        }
        for (int64_t j = 0; j < n; j++) {
            for (int64_t i = j + 1; i < n; i++) {
                c[i * n + j] = c[j * n + i];
            }
        }
        *change = sqrt(square) / all;
    }
    free(value);
    free(vector);
    return status;
}
