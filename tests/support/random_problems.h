/// @file random_problems.h  Random matrices for the tests of the contact solvers: as hard as asked,
/// the same for the same seed.
#ifndef PALPATE_TESTS_RANDOM_PROBLEMS_H
#define PALPATE_TESTS_RANDOM_PROBLEMS_H

#include <stdint.h>

enum { RANDOM_MATRIX_MAX = 111 }; ///< largest order

/// Begin the sequence anew.
void random_seed(uint64_t seed);
/// In (-1, 1).
double random_uniform(void);
/// In (0, 1).
double random_positive(void);

/// Positive definite matrix, column-major, shape [n, n]. Its symmetric part V D V^T has the given
/// condition: eigenvalues spread logarithmically in [1 / condition, 1], in random directions (V:
/// Householder reflections). Its skew part has `skew` times the symmetric one's Frobenius norm:
/// either of random entries, which overwhelms the small eigenvalues, or (cone) V D^1/2 K D^1/2 V^T,
/// whose numerical range is a proper cone.
void random_matrix(int n, double condition, double skew, int cone, double *m);

/// Frobenius norm of a matrix of order n.
double matrix_norm(int n, const double *a);

/// For qsort: rising.
int rising_int(const void *a, const void *b);

#endif
