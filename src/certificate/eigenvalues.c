/// @file eigenvalues.c  Extreme eigenvalues of the symmetric part of a dense matrix.
///
/// A dense eigensolver costs about 4/3 n^3 flops with poor locality and is hopeless at n = 30 000;
/// Lanczos (ARPACK) needs a few dozen products. The small end of a compliance's spectrum is
/// clustered, so it is found as the large end of the inverse, through the Cholesky factor that the
/// certificate needs anyway. Without one (indefinite), plain Lanczos on the small end: it need only
/// tell how negative it is.
#include "src/certificate/certificate.h"

#include <arpack/arpack.h>
#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

enum { DENSE_BELOW = 96 };

/// ARPACK keeps Fortran SAVE variables: one user at a time.
static pthread_mutex_t arpack_lock = PTHREAD_MUTEX_INITIALIZER;

/// ARPACK's Fortran routine: its C binding dseupd_c allocates inside and crashes without memory.
/// Lengths of the strings are passed last, as gfortran does.
extern void dseupd_(const a_int *rvec, const char *howmny, a_int *select, double *d, double *z,
                    const a_int *ldz, const double *sigma, const char *bmat, const a_int *n,
                    const char *which, const a_int *nev, const double *tol, double *resid,
                    const a_int *ncv, double *v, const a_int *ldv, a_int *iparam, a_int *ipntr,
                    double *workd, double *workl, const a_int *lworkl, a_int *info, size_t, size_t,
                    size_t);

/// y = A x with A symmetric (lower triangle of `a`), or y = A^-1 x with A's Cholesky factor.
static void apply(const double *a, int64_t n, int inverse, const double *x, double *y) {
    if (inverse) {
        memcpy(y, x, (size_t)n * sizeof *y);
        cblas_dtrsv(CblasColMajor, CblasLower, CblasNoTrans, CblasNonUnit, (int)n, a, (int)n, y, 1);
        cblas_dtrsv(CblasColMajor, CblasLower, CblasTrans, CblasNonUnit, (int)n, a, (int)n, y, 1);
    } else {
        cblas_dsymv(CblasColMajor, CblasLower, (int)n, 1.0, a, (int)n, x, 1, 0.0, y, 1);
    }
}

/// One extreme eigenvalue by implicitly restarted Lanczos. `which`: "LA" largest, "SA" smallest.
static pal_status lanczos(const double *a, int64_t n, int inverse, const char *which,
                          double *value) {
    a_int ncv = n < 40 ? (a_int)n : 40, lworkl = ncv * (ncv + 8), ido = 0, info = 1;
    a_int iparam[11] = {1, 0, 300, 1, 0, 0, 1}, ipntr[11] = {0};
    double *v = malloc((size_t)n * (size_t)ncv * sizeof *v);
    double *resid = malloc((size_t)n * sizeof *resid),
           *workd = malloc(3 * (size_t)n * sizeof *workd);
    double *workl = malloc((size_t)lworkl * sizeof *workl);
    a_int *select = malloc((size_t)ncv * sizeof *select);
    pal_status status = PALPATE_ERROR_MEMORY;
    if (v != NULL && resid != NULL && workd != NULL && workl != NULL && select != NULL) {
        for (int64_t i = 0; i < n; i++) {
            resid[i] = 1.0 + 0.5 * sin(12.9898 * (double)(i + 1)); // fixed start: deterministic
        }
        pthread_mutex_lock(&arpack_lock);
        for (;;) {
            dsaupd_c(&ido, "I", (a_int)n, which, 1, 1e-6, resid, ncv, v, (a_int)n, iparam, ipntr,
                     workd, workl, lworkl, &info);
            if (ido != -1 && ido != 1) {
                break;
            }
            apply(a, n, inverse, workd + ipntr[0] - 1, workd + ipntr[1] - 1);
        }
        status = PALPATE_ERROR_SINGULAR;
        if (info >= 0 && iparam[4] >= 1) {
            const a_int no = 0, one = 1, rows = (a_int)n;
            const double shift = 0.0, tolerance = 1e-6;
            double d[1] = {0.0};
            dseupd_(&no, "A", select, d, v, &rows, &shift, "I", &rows, which, &one, &tolerance,
                    resid, &ncv, v, &rows, iparam, ipntr, workd, workl, &lworkl, &info, 1, 1, 2);
            *value = d[0];
            status = info == 0 ? PALPATE_OK : PALPATE_ERROR_SINGULAR;
        }
        pthread_mutex_unlock(&arpack_lock);
    }
    free(select);
    free(workl);
    free(workd);
    free(resid);
    free(v);
    return status;
}

pal_status pal_extreme_eigenvalues(const double *c, int64_t n, double *smallest, double *largest,
                                   int *positive, pal_error *error) {
    *smallest = *largest = NAN;
    *positive = 0;
    double *a = malloc((size_t)n * (size_t)n * sizeof *a);
    if (a == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "out of memory for the eigenvalues of C_TT (%.2f GB)",
                        8e-9 * (double)(n * n));
    }
    for (int64_t j = 0; j < n; j++) {
        for (int64_t i = 0; i < n; i++) {
            a[j * n + i] = 0.5 * (c[j * n + i] + c[i * n + j]);
        }
    }
    pal_status status = PALPATE_OK;
    if (n <= DENSE_BELOW) {
        double w[DENSE_BELOW];
        if (LAPACKE_dsyev(LAPACK_COL_MAJOR, 'N', 'L', (int)n, a, (int)n, w) == 0) {
            *smallest = w[0];
            *largest = w[n - 1];
            *positive = w[0] > (double)n * 2.3e-16 * w[n - 1];
        }
        free(a);
        return PALPATE_OK;
    }
    status = lanczos(a, n, 0, "LA", largest);
    if (status == PALPATE_OK || status == PALPATE_ERROR_SINGULAR) {
        // the upper triangle keeps the matrix while the lower one becomes its Cholesky factor
        double *diagonal = malloc((size_t)n * sizeof *diagonal);
        if (diagonal == NULL) {
            free(a);
            return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
        }
        for (int64_t i = 0; i < n; i++) {
            diagonal[i] = a[i * n + i];
        }
        *positive = LAPACKE_dpotrf(LAPACK_COL_MAJOR, 'L', (int)n, a, (int)n) == 0;
        if (*positive) {
            double inverse = NAN;
            status = lanczos(a, n, 1, "LA", &inverse);
            *smallest = 1.0 / inverse;
        } else {
            for (int64_t j = 0; j < n; j++) {
                a[j * n + j] = diagonal[j];
                for (int64_t i = j + 1; i < n; i++) {
                    a[j * n + i] = a[i * n + j];
                }
            }
            status = lanczos(a, n, 0, "SA", smallest);
        }
        free(diagonal);
    }
    free(a);
    // not converged: the values stay NaN and the certificate says so; only memory is an error
    return status == PALPATE_ERROR_MEMORY ? pal_fail(error, status, "out of memory") : PALPATE_OK;
}
