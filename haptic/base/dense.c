/// @file dense.c  Cholesky and LU for the tick: register-tiled, fixed order.
///
/// Cholesky left-looking (jki): a panel of PANEL columns is brought up to date with all columns to
/// its left in tiles of TILE rows held in registers, then factored itself. An element sees its
/// updates in ascending k, one rounded multiply and one rounded subtract each, so tiling and vector
/// width do not show in the result. Vectors are GCC/clang vector extensions: plain element-wise
/// arithmetic that the compiler lowers to whatever the target has; on x86-64 the same source is
/// compiled a second time for AVX2 (without FMA) and chosen at run time. Algorithms: Golub and Van
/// Loan, Matrix Computations, 4th ed., 3.2 (LU), 4.2 (Cholesky), 6.5.4 (removing a row and column).
#include "haptic/base/dense.h"

#include <math.h>
#include <stddef.h>
#include <string.h>

#include "haptic/base/wide.h"

typedef pal_lanes lanes;

enum { LANES = PALPATE_LANES, TILE = 8, PANEL = 4 };

#define INLINE PALPATE_INLINE
#define AT(a, i, j) ((a)[(size_t)(i) + (size_t)(j) * (size_t)(ld)])

/// c -= a b for `vectors` x LANES rows and PANEL columns held in registers; b by strides as below.
INLINE void update_registers(const int vectors, int32_t depth, const double *a, double *c,
                             int32_t ld, const double *b, size_t bk, size_t bj) {
    lanes acc[PANEL][TILE / LANES];
    PALPATE_UNROLL
    for (int j = 0; j < PANEL; j++) {
        PALPATE_UNROLL
        for (int r = 0; r < vectors; r++) {
            memcpy(&acc[j][r], &AT(c, LANES * r, j), sizeof(lanes));
        }
    }
    for (int32_t k = 0; k < depth; k++) {
        lanes left[TILE / LANES];
        PALPATE_UNROLL
        for (int r = 0; r < vectors; r++) {
            memcpy(&left[r], &AT(a, LANES * r, k), sizeof(lanes));
        }
        PALPATE_UNROLL
        for (int j = 0; j < PANEL; j++) {
            double s = b[(size_t)k * bk + (size_t)j * bj];
            lanes right = {s, s, s, s};
            PALPATE_UNROLL
            for (int r = 0; r < vectors; r++) {
                acc[j][r] -= left[r] * right;
            }
        }
    }
    PALPATE_UNROLL
    for (int j = 0; j < PANEL; j++) {
        PALPATE_UNROLL
        for (int r = 0; r < vectors; r++) {
            memcpy(&AT(c, LANES * r, j), &acc[j][r], sizeof(lanes));
        }
    }
}

/// c (rows x columns at c) -= a (rows x depth) * b (depth x columns), where b is given by strides:
/// b(k, j) = b[k * bk + j * bj]. rows <= TILE, columns <= PANEL.
INLINE void update_tile(int32_t rows, int32_t columns, int32_t depth, const double *a, double *c,
                        int32_t ld, const double *b, size_t bk, size_t bj) {
    if (columns == PANEL && rows == TILE) {
        update_registers(TILE / LANES, depth, a, c, ld, b, bk, bj);
        return;
    }
    int32_t from = 0;
    if (columns == PANEL && rows >= LANES) {
        update_registers(1, depth, a, c, ld, b, bk, bj);
        from = LANES;
    }
    for (int32_t j = 0; j < columns; j++) {
        for (int32_t i = from; i < rows; i++) {
            double sum = AT(c, i, j);
            for (int32_t k = 0; k < depth; k++) {
                sum -= AT(a, i, k) * b[(size_t)k * bk + (size_t)j * bj];
            }
            AT(c, i, j) = sum;
        }
    }
}

INLINE int32_t smaller(int32_t a, int32_t b) {
    return a < b ? a : b;
}

/// x[i] -= s column[i], i = from .. to-1
INLINE void subtract(const double *column, double s, double *x, int32_t from, int32_t to) {
    // vectors start at multiples of LANES whatever `from` is: a load that straddles two vectors
    // just stored would wait for both to reach the cache
    lanes factor = {s, s, s, s};
    int32_t i = from;
    for (; i < to && i % LANES != 0; i++) {
        x[i] -= column[i] * s;
    }
    for (; i + LANES <= to; i += LANES) {
        lanes c, v;
        memcpy(&c, column + i, sizeof c);
        memcpy(&v, x + i, sizeof v);
        v -= c * factor;
        memcpy(x + i, &v, sizeof v);
    }
    for (; i < to; i++) {
        x[i] -= column[i] * s;
    }
}

/// x[i] /= s, i = from .. to-1
INLINE void divide(double *x, double s, int32_t from, int32_t to) {
    lanes divisor = {s, s, s, s};
    int32_t i = from;
    for (; i + LANES <= to; i += LANES) {
        lanes v;
        memcpy(&v, x + i, sizeof v);
        v /= divisor;
        memcpy(x + i, &v, sizeof v);
    }
    for (; i < to; i++) {
        x[i] /= s;
    }
}

// ---- Cholesky -----------------------------------------------------------------------------------

INLINE int32_t cholesky(int32_t n, int32_t first, double *a, int32_t ld) {
    for (int32_t j0 = first; j0 < n; j0 += PANEL) {
        int32_t width = smaller(PANEL, n - j0);
        // columns left of the panel; l_jk is row j0.. of column k. The strict upper triangle of the
        // panel's diagonal block would be written by a tile, so that block is done by columns.
        for (int32_t j = j0; j < j0 + width; j++) {
            int32_t i0 = j, end = j0 + width;
            update_tile(end - i0, 1, j0, &AT(a, i0, 0), &AT(a, i0, j), ld, &AT(a, j, 0), (size_t)ld,
                        1);
        }
        for (int32_t i = j0 + width; i < n; i += TILE) {
            update_tile(smaller(TILE, n - i), width, j0, &AT(a, i, 0), &AT(a, i, j0), ld,
                        &AT(a, j0, 0), (size_t)ld, 1);
        }
        for (int32_t j = j0; j < j0 + width; j++) {
            double *column = &AT(a, 0, j);
            for (int32_t k = j0; k < j; k++) {
                subtract(&AT(a, 0, k), AT(a, j, k), column, j, n);
            }
            double pivot = column[j];
            if (!(pivot > 0) || !isfinite(pivot)) {
                return j + 1;
            }
            double root = sqrt(pivot);
            column[j] = root;
            divide(column, root, j + 1, n);
        }
    }
    return 0;
}

// ---- LU -----------------------------------------------------------------------------------------

INLINE void swap_rows(double *a, int32_t ld, int32_t p, int32_t q, int32_t from, int32_t to) {
    for (int32_t j = from; j < to; j++) {
        double t = AT(a, p, j);
        AT(a, p, j) = AT(a, q, j);
        AT(a, q, j) = t;
    }
}

/// Right-looking: a panel is factored, then everything behind it updated, so that each element
/// still sees its updates in ascending k.
INLINE int32_t lu(int32_t n, double *a, int32_t ld, int32_t *pivot) {
    for (int32_t j0 = 0; j0 < n; j0 += PANEL) {
        int32_t width = smaller(PANEL, n - j0), end = j0 + width;
        for (int32_t j = j0; j < end; j++) {
            for (int32_t k = j0; k < j; k++) {
                subtract(&AT(a, 0, k), AT(a, k, j), &AT(a, 0, j), k + 1, n);
            }
            int32_t best = j;
            double largest = fabs(AT(a, j, j));
            for (int32_t i = j + 1; i < n; i++) {
                double size = fabs(AT(a, i, j));
                best = size > largest ? i : best;
                largest = size > largest ? size : largest;
            }
            pivot[j] = best;
            if (!(largest > 0) || !isfinite(largest)) {
                return j + 1;
            }
            if (best != j) {
                swap_rows(a, ld, j, best, 0, n);
            }
            divide(&AT(a, 0, j), AT(a, j, j), j + 1, n);
        }
        for (int32_t j = end; j < n; j += PANEL) {
            int32_t columns = smaller(PANEL, n - j);
            for (int32_t c = j; c < j + columns; c++) { // rows of U
                const double *l = &AT(a, j0, j0);
                double x[PANEL]; // the last panel, which may be narrower, has nothing behind it
                PALPATE_UNROLL
                for (int i = 0; i < PANEL; i++) {
                    x[i] = AT(a, j0 + i, c);
                    PALPATE_UNROLL
                    for (int k = 0; k < i; k++) {
                        x[i] -= AT(l, i, k) * x[k];
                    }
                    AT(a, j0 + i, c) = x[i];
                }
            }
            for (int32_t i = end; i < n; i += TILE) {
                update_tile(smaller(TILE, n - i), columns, PANEL, &AT(a, i, j0), &AT(a, i, j), ld,
                            &AT(a, j0, j), 1, (size_t)ld);
            }
        }
    }
    return 0;
}

// ---- Triangular solves --------------------------------------------------------------------------

/// sum column[i] x[i], i = from .. to-1, in four interleaved partial sums: ((0+2)+(1+3)) + tail
INLINE double dot(const double *column, const double *x, int32_t from, int32_t to) {
    lanes sum = {0, 0, 0, 0};
    double head = 0;
    int32_t i = from;
    for (; i < to && i % LANES != 0; i++) { // as in subtract()
        head += column[i] * x[i];
    }
    for (; i + LANES <= to; i += LANES) {
        lanes c, v;
        memcpy(&c, column + i, sizeof c);
        memcpy(&v, x + i, sizeof v);
        sum += c * v;
    }
    double total = head + ((sum[0] + sum[2]) + (sum[1] + sum[3]));
    for (; i < to; i++) {
        total += column[i] * x[i];
    }
    return total;
}

INLINE void lower_solve(int32_t n, const double *l, int32_t ld, double *x) {
    for (int32_t j = 0; j < n; j++) {
        x[j] /= AT(l, j, j);
        subtract(&AT(l, 0, j), x[j], x, j + 1, n);
    }
}

INLINE void lower_solve_transposed(int32_t n, const double *l, int32_t ld, double *x) {
    for (int32_t j = n - 1; j >= 0; j--) {
        x[j] = (x[j] - dot(&AT(l, 0, j), x, j + 1, n)) / AT(l, j, j);
    }
}

INLINE void lu_solve(int32_t n, const double *a, int32_t ld, const int32_t *pivot, double *x) {
    for (int32_t k = 0; k < n; k++) {
        if (pivot[k] != k) {
            double t = x[k];
            x[k] = x[pivot[k]];
            x[pivot[k]] = t;
        }
    }
    for (int32_t j = 0; j < n; j++) {
        subtract(&AT(a, 0, j), x[j], x, j + 1, n);
    }
    for (int32_t j = n - 1; j >= 0; j--) {
        x[j] /= AT(a, j, j);
        subtract(&AT(a, 0, j), x[j], x, 0, j);
    }
}

// ---- One copy per instruction set
// -----------------------------------------------------------------

PALPATE_AVX2 static int32_t cholesky_avx2(int32_t n, int32_t first, double *a, int32_t ld) {
    return cholesky(n, first, a, ld);
}
PALPATE_AVX2 static int32_t lu_avx2(int32_t n, double *a, int32_t ld, int32_t *pivot) {
    return lu(n, a, ld, pivot);
}
// without AVX the compiler passes 32-byte vectors through the stack: the solves gain most
PALPATE_AVX2 static void lower_solve_avx2(int32_t n, const double *l, int32_t ld, double *x) {
    lower_solve(n, l, ld, x);
}
PALPATE_AVX2 static void lower_solve_transposed_avx2(int32_t n, const double *l, int32_t ld,
                                                     double *x) {
    lower_solve_transposed(n, l, ld, x);
}
PALPATE_AVX2 static void lu_solve_avx2(int32_t n, const double *a, int32_t ld, const int32_t *pivot,
                                       double *x) {
    lu_solve(n, a, ld, pivot, x);
}
int32_t pal_dense_cholesky(int32_t n, int32_t first, double *a, int32_t ld) {
    return pal_have_avx2() ? cholesky_avx2(n, first, a, ld) : cholesky(n, first, a, ld);
}

int32_t pal_dense_lu(int32_t n, double *a, int32_t ld, int32_t *pivot) {
    return pal_have_avx2() ? lu_avx2(n, a, ld, pivot) : lu(n, a, ld, pivot);
}

void pal_dense_lower_solve(int32_t n, const double *l, int32_t ld, double *x) {
    if (pal_have_avx2()) {
        lower_solve_avx2(n, l, ld, x);
    } else {
        lower_solve(n, l, ld, x);
    }
}

void pal_dense_lower_solve_transposed(int32_t n, const double *l, int32_t ld, double *x) {
    if (pal_have_avx2()) {
        lower_solve_transposed_avx2(n, l, ld, x);
    } else {
        lower_solve_transposed(n, l, ld, x);
    }
}

void pal_dense_cholesky_solve(int32_t n, const double *l, int32_t ld, int32_t count, double *b,
                              int32_t ldb) {
    for (int32_t j = 0; j < count; j++) {
        double *x = b + (size_t)j * (size_t)ldb;
        pal_dense_lower_solve(n, l, ld, x);
        pal_dense_lower_solve_transposed(n, l, ld, x);
    }
}

void pal_dense_lu_solve(int32_t n, const double *a, int32_t ld, const int32_t *pivot, int32_t count,
                        double *b, int32_t ldb) {
    for (int32_t j = 0; j < count; j++) {
        double *x = b + (size_t)j * (size_t)ldb;
        if (pal_have_avx2()) {
            lu_solve_avx2(n, a, ld, pivot, x);
        } else {
            lu_solve(n, a, ld, pivot, x);
        }
    }
}

void pal_dense_cholesky_remove(int32_t n, int32_t k, double *l, int32_t ld) {
    // row k goes, the rows below it move up
    for (int32_t j = 0; j <= k; j++) {
        memmove(&AT(l, k, j), &AT(l, k + 1, j), (size_t)(n - 1 - k) * sizeof *l);
    }
    // each column behind k now reaches one element above the diagonal; rotating it with its left
    // neighbour removes that element. Old element (i+1, j+1) is read before (i+1, j+1) is written.
    for (int32_t j = k; j < n - 1; j++) {
        double p = AT(l, j, j), q = AT(l, j + 1, j + 1);
        double r = sqrt(p * p + q * q), c = p / r, s = q / r;
        AT(l, j, j) = r;
        for (int32_t i = j + 1; i < n - 1; i++) {
            double left = AT(l, i, j), right = AT(l, i + 1, j + 1);
            AT(l, i, j) = c * left + s * right;
            AT(l, i, j + 1) = c * right - s * left;
        }
    }
}
