/// @file contact_stiffness.c  Stiffness of a bonded contact and its work around closed paths.
#include "src/certificate/contact_stiffness.h"

#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

enum { PATH_STEPS = 360 };

pal_status pal_contact_stiffness(const double *c, int64_t columns, const int32_t *set,
                                 int32_t count, double a[9]) {
    int64_t n = 3 * (int64_t)count, t = 3 * columns;
    double *block = malloc((size_t)(n * n + 3 * n) * sizeof *block);
    lapack_int *pivot = malloc((size_t)n * sizeof *pivot);
    pal_status status = PALPATE_ERROR_MEMORY;
    if (block != NULL && pivot != NULL) {
        double *f = block + n * n;
        for (int64_t j = 0; j < n; j++) {
            int64_t cj = 3 * (int64_t)set[j / 3] + j % 3;
            for (int64_t i = 0; i < n; i++) {
                block[j * n + i] = c[cj * t + 3 * (int64_t)set[i / 3] + i % 3];
            }
            for (int64_t k = 0; k < 3; k++) {
                f[k * n + j] = j % 3 == k;
            }
        }
        status = PALPATE_ERROR_SINGULAR;
        if (LAPACKE_dgesv(LAPACK_COL_MAJOR, (int)n, 3, block, (int)n, pivot, f, (int)n) == 0) {
            memset(a, 0, 9 * sizeof *a);
            for (int64_t k = 0; k < 3; k++) {
                for (int64_t i = 0; i < n; i++) {
                    a[3 * (i % 3) + k] += f[k * n + i];
                }
            }
            status = PALPATE_OK;
        }
    }
    free(pivot);
    free(block);
    return status;
}

static void path(int kind, double s, double u[3]) {
    memset(u, 0, 3 * sizeof *u);
    if (kind < 3) { // circle in the plane normal to axis `kind`
        u[(kind + 1) % 3] = cos(s);
        u[(kind + 2) % 3] = sin(s);
    } else { // figure eight folded along its waist: one lobe in the xy plane, the other in the xz
             // plane
        double x = sin(s), y = sin(s) * cos(s);
        u[0] = x;
        u[1] = x >= 0.0 ? y : 0.0;
        u[2] = x >= 0.0 ? 0.0 : y;
    }
}

double pal_loop_energy(const double a[9]) {
    double symmetric[9], eigenvalue[3], worst = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            symmetric[3 * i + j] = 0.5 * (a[3 * i + j] + a[3 * j + i]);
        }
    }
    if (LAPACKE_dsyev(LAPACK_ROW_MAJOR, 'N', 'L', 3, symmetric, 3, eigenvalue) != 0) {
        return NAN;
    }
    for (int kind = 0; kind < 4; kind++) {
        double work = 0.0, u[3], v[3];
        path(kind, 0.0, u);
        for (int k = 1; k <= PATH_STEPS; k++) {
            path(kind, 2.0 * M_PI * k / PATH_STEPS, v);
            for (int i = 0; i < 3;
                 i++) { // the force at the middle of the step is exact for linear F
                for (int j = 0; j < 3; j++) {
                    work += a[3 * i + j] * 0.5 * (u[j] + v[j]) * (v[i] - u[i]);
                }
            }
            memcpy(u, v, sizeof u);
        }
        worst = fmax(worst, fabs(work));
    }
    return worst / (0.5 * fabs(eigenvalue[2]));
}
