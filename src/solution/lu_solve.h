/// @file lu_solve.h  Triangular solves with a block of right-hand sides over extracted LU factors.
#ifndef PALPATE_SRC_LU_SOLVE_H
#define PALPATE_SRC_LU_SOLVE_H

#include <stdint.h>

/// Right-hand sides solved at once, and the widest panel.
enum { PALPATE_LU_BLOCK = 32, PALPATE_LU_WIDTH = 8 };

/// A triangular factor as panels: up to 8 consecutive columns of L (rows of U) that share one list
/// of row (column) numbers; where a member lacks an entry it holds a zero.
typedef struct pal_lu_panels {
    int32_t count;
    int32_t *first;       ///< (count + 1) first column (row) of each panel
    int64_t *index_start; ///< (count + 1) into index
    int64_t *value_start; ///< (count + 1) into value
    int32_t *index;       ///< beyond the panel itself, ascending
    double *value;        ///< per panel: width x width triangle, then [index][member]
} pal_lu_panels;

/// P R A Q = L U. L unit lower, by columns; U upper, by rows; U's diagonal apart.
typedef struct pal_lu {
    int32_t n;
    pal_lu_panels lower;   ///< triangle [row][column]
    pal_lu_panels upper;   ///< triangle [row][column]
    double *diagonal;      ///< (n) of U, inverted
    int32_t *row_order;    ///< P: row k of L is row row_order[k] of A
    int32_t *column_order; ///< Q: column k of U is column column_order[k] of A
    double *row_scale;     ///< (n) factor of each row of A
    uint8_t *needed;       ///< (upper.count) panels that the wanted unknowns depend on; NULL: all
} pal_lu;

/// Instruction sets; the results are the same bits.
typedef enum pal_lu_variant { PALPATE_LU_BASE, PALPATE_LU_AVX2, PALPATE_LU_AVX512 } pal_lu_variant;

void pal_lu_clear(pal_lu *lu);

/// Gather columns of a strictly lower factor (rows of a strictly upper one) into panels.
/// @param start (n + 1), index (strictly ascending per column, all beyond the column's own number)
/// @param by_row  1: rows of U; 0: columns of L (the layout of the triangle)
/// @return 0; -1 out of memory (panels stay empty)
int pal_lu_panels_make(int32_t n, const int64_t *start, const int32_t *index, const double *value,
                       int by_row, pal_lu_panels *panels);

/// Bytes the panels hold.
uint64_t pal_lu_bytes(const pal_lu *lu);

/// The widest variant of this CPU.
pal_lu_variant pal_lu_best_variant(void);

/// Solve A X = B in place for up to PALPATE_LU_BLOCK right-hand sides.
/// @param x     (n x count) column-major, ld = n
/// @param work  (n x PALPATE_LU_BLOCK), 64-byte aligned
void pal_lu_solve(const pal_lu *lu, pal_lu_variant variant, int32_t count, double *x, double *work);

/// Mark in needed (upper.count, allocated by the caller) what the unknowns flagged in `wanted` (n)
/// depend on.
void pal_lu_mark_needed(const pal_lu *lu, const uint8_t *wanted, uint8_t *needed);

#endif
