/// @file dense.h  Small dense factorizations with a fixed order of operations (private; exported).
///
/// For the tick (contact systems up to a few hundred unknowns) and for press. Nothing here
/// allocates, locks, calls a library or depends on the number of threads. Every element of a factor
/// is built by the same sequence of rounded operations, a_ij - l_i0 u_0j - l_i1 u_1j - ... in
/// ascending order, whatever the block size or the vector width, so results are the same bits on
/// every x86-64 build (needs -ffp-contract=off). Matrices are column-major with leading dimension
/// `ld` >= n; no alignment is needed. Thread: any, as long as the arguments are not shared.
#ifndef PALPATE_HAPTIC_DENSE_H
#define PALPATE_HAPTIC_DENSE_H

#include <stdint.h>

#include <palpate/status.h>

/// A = L L^T in place: reads and writes the lower triangle with the diagonal only.
/// @param first  columns [0, first) are factored already (rows below them included): 0 for a whole
///               factorization, k to append unknowns k .. n-1 to a factor of order k
/// @return 0; else 1 + the index of the first pivot that is not positive and finite (the columns
///         before it are valid: the factor of the leading block)
/// Cost: n^3/3 multiply-adds.
PALPATE_API int32_t pal_dense_cholesky(int32_t n, int32_t first, double *a, int32_t ld);

/// Solve L L^T X = B in place, B (n x count, ld ldb).
PALPATE_API void pal_dense_cholesky_solve(int32_t n, const double *l, int32_t ld, int32_t count,
                                          double *b, int32_t ldb);

/// P A = L U in place with row interchanges (partial pivoting, first largest wins).
/// @param[out] pivot  shape [n]: at step k row k was swapped with row pivot[k]
/// @return 0; else 1 + the index of the first pivot that is zero or not finite
/// Cost: 2 n^3/3 multiply-adds.
PALPATE_API int32_t pal_dense_lu(int32_t n, double *a, int32_t ld, int32_t *pivot);

/// Solve A X = B in place from pal_dense_lu, B (n x count, ld ldb).
PALPATE_API void pal_dense_lu_solve(int32_t n, const double *lu, int32_t ld, const int32_t *pivot,
                                    int32_t count, double *b, int32_t ldb);

/// x <- L^-1 x (lower, diagonal stored), one right-hand side.
PALPATE_API void pal_dense_lower_solve(int32_t n, const double *l, int32_t ld, double *x);
/// x <- L^-T x.
PALPATE_API void pal_dense_lower_solve_transposed(int32_t n, const double *l, int32_t ld,
                                                  double *x);

/// Remove unknown `k` from a Cholesky factor of order n in place (Givens rotations on the columns
/// behind it): afterwards the leading (n-1) x (n-1) lower triangle is the factor of A without row
/// and column k. Cost: O((n - k)^2).
PALPATE_API void pal_dense_cholesky_remove(int32_t n, int32_t k, double *l, int32_t ld);

#endif
