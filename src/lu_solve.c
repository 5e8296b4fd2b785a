/// @file lu_solve.c  Block triangular solves over extracted sparse LU factors.
///
/// A sparse triangular solve with one right-hand side does two flops per factor entry and waits for
/// memory. Sixteen right-hand sides stored side by side (work[row][16]) reuse each entry of L and U
/// sixteen times from a register. Columns of L whose block row is still zero are skipped (a unit
/// nodal force excites nothing before its own pivot), columns of U that no wanted unknown depends on
/// are skipped too (U x = y backward: x_i needs x_j for every U_ij != 0).
///
/// The arithmetic is the same in every instruction-set variant: one product, one subtraction per
/// entry, in column order, never fused; so results do not depend on the CPU.
#include "src/lu_solve.h"

#include <stdlib.h>
#include <string.h>

enum { B = PALPATE_LU_BLOCK };

void pal_lu_clear(pal_lu *lu) {
    free(lu->l_start);
    free(lu->l_row);
    free(lu->l_value);
    free(lu->u_start);
    free(lu->u_row);
    free(lu->u_value);
    free(lu->diagonal);
    free(lu->row_order);
    free(lu->column_order);
    free(lu->row_scale);
    free(lu->needed);
    memset(lu, 0, sizeof *lu);
}

static inline __attribute__((always_inline)) void sweep(const pal_lu *lu, double *restrict w) {
    int32_t n = lu->n;
    for (int32_t k = 0; k < n; k++) {
        double pivot[B];
        memcpy(pivot, w + (int64_t)k * B, sizeof pivot);
        int any = 0;
        for (int c = 0; c < B; c++) {
            any |= pivot[c] != 0.0;
        }
        if (!any) {
            continue;
        }
        for (int64_t e = lu->l_start[k]; e < lu->l_start[k + 1]; e++) {
            double v = lu->l_value[e];
            double *row = w + (int64_t)lu->l_row[e] * B;
            for (int c = 0; c < B; c++) {
                row[c] -= v * pivot[c];
            }
        }
    }
    for (int32_t k = n - 1; k >= 0; k--) {
        if (lu->needed != NULL && !lu->needed[k]) {
            continue;
        }
        double pivot[B];
        double *top = w + (int64_t)k * B;
        for (int c = 0; c < B; c++) {
            pivot[c] = top[c] * lu->diagonal[k];
            top[c] = pivot[c];
        }
        for (int64_t e = lu->u_start[k]; e < lu->u_start[k + 1]; e++) {
            double v = lu->u_value[e];
            double *row = w + (int64_t)lu->u_row[e] * B;
            for (int c = 0; c < B; c++) {
                row[c] -= v * pivot[c];
            }
        }
    }
}

static void sweep_base(const pal_lu *lu, double *w) {
    sweep(lu, w);
}

#if defined(__x86_64__)
__attribute__((target("avx2"))) static void sweep_avx2(const pal_lu *lu, double *w) {
    sweep(lu, w);
}

__attribute__((target("avx512f,prefer-vector-width=512"))) static void sweep_avx512(const pal_lu *lu,
                                                                                    double *w) {
    sweep(lu, w);
}
#endif

void pal_lu_solve(const pal_lu *lu, int32_t count, double *x, double *work) {
    int64_t n = lu->n;
    for (int64_t k = 0; k < n; k++) {
        int64_t i = lu->row_order[k];
        double s = lu->row_scale[i];
        for (int32_t c = 0; c < B; c++) {
            work[k * B + c] = c < count ? s * x[c * n + i] : 0.0;
        }
    }
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f")) {
        sweep_avx512(lu, work);
    } else if (__builtin_cpu_supports("avx2")) {
        sweep_avx2(lu, work);
    } else
#endif
    {
        sweep_base(lu, work);
    }
    for (int64_t k = 0; k < n; k++) {
        int64_t j = lu->column_order[k];
        for (int32_t c = 0; c < count; c++) {
            x[c * n + j] = work[k * B + c];
        }
    }
}

void pal_lu_mark_needed(const pal_lu *lu, const uint8_t *wanted, uint8_t *needed) {
    // x_i depends on x_j for U_ij != 0, j > i: going down the columns, column j is needed when it is
    // wanted itself or when one of its rows i < j is.
    for (int32_t j = 0; j < lu->n; j++) {
        uint8_t mark = wanted[lu->column_order[j]] != 0;
        for (int64_t e = lu->u_start[j]; !mark && e < lu->u_start[j + 1]; e++) {
            mark = needed[lu->u_row[e]];
        }
        needed[j] = mark;
    }
}
