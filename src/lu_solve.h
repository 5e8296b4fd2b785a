/// @file lu_solve.h  Triangular solves with a block of right-hand sides over extracted LU factors.
#ifndef PALPATE_SRC_LU_SOLVE_H
#define PALPATE_SRC_LU_SOLVE_H

#include <stdint.h>

/// P R A Q = L U. L unit lower, U upper, both by columns; U's diagonal apart.
typedef struct pal_lu {
    int32_t n;
    int64_t *l_start; ///< (n + 1)
    int32_t *l_row;   ///< strictly below the diagonal
    double *l_value;
    int64_t *u_start; ///< (n + 1)
    int32_t *u_row;   ///< strictly above the diagonal
    double *u_value;
    double *diagonal;     ///< (n) of U, inverted
    int32_t *row_order;   ///< P: row k of L is row row_order[k] of A
    int32_t *column_order;///< Q: column k of U is column column_order[k] of A
    double *row_scale;    ///< (n) factor of each row of A
    uint8_t *needed;      ///< (n) columns of U that the wanted unknowns depend on; NULL: all
} pal_lu;

enum { PALPATE_LU_BLOCK = 16 };

void pal_lu_clear(pal_lu *lu);

/// Solve A X = B in place for up to PALPATE_LU_BLOCK right-hand sides.
/// @param x     (n x count) column-major, ld = n
/// @param work  (n x PALPATE_LU_BLOCK), 64-byte aligned
void pal_lu_solve(const pal_lu *lu, int32_t count, double *x, double *work);

/// Mark in lu->needed (n, allocated by the caller) what the unknowns flagged in `wanted` depend on.
void pal_lu_mark_needed(const pal_lu *lu, const uint8_t *wanted, uint8_t *needed);

#endif
