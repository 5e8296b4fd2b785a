/// @file dense_small.h  Factorizations of matrices with at most a few dozen columns.
///
/// For MLS stencils (19 columns at most): LAPACK's overhead and OpenBLAS's mutexes would cost more
/// than the arithmetic, and these kernels sum in a fixed order. No allocation; thread: any.
#ifndef PALPATE_SRC_DENSE_SMALL_H
#define PALPATE_SRC_DENSE_SMALL_H

#include <stdint.h>

enum { PALPATE_SMALL_COLUMNS = 32 };

/// Triangular factor R of A P = Q R by Householder reflections with column pivoting; Q is not kept.
/// Rows are first sorted by decreasing largest element: with the pivoting this makes the
/// factorization backward stable row by row, so rows of very different weight do not hurt each
/// other (Cox and Higham 1998).
/// @param[in,out] a     column-major, shape [rows, columns], leading dimension ld; on return R in
///                      the upper triangle of the first min(rows, columns) rows
/// @param[out] pivot    column of A that stands at each place, shape [columns]
/// @param tolerance     rank: number of |R_kk| > tolerance |R_00|
/// @return rank
int32_t pal_small_qr(int32_t rows, int32_t columns, double *a, int32_t ld, int32_t *pivot,
                     double tolerance);

/// Inverse of the leading upper triangle of R, shape [n, n].
/// @param[out] inverse  row-major upper triangle (row i: columns i..n-1), ld n; below it zero
void pal_small_triangle_inverse(int32_t n, const double *r, int32_t ld, double *inverse);

/// Cholesky A = L L^T of a symmetric matrix, row-major, in place (lower triangle is read, written).
/// @return 1, or 0 when a pivot is not positive
int pal_small_cholesky(int32_t n, double *a, int32_t ld);

#endif
