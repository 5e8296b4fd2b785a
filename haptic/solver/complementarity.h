/// @file complementarity.h  Unilateral contact as a linear complementarity problem (private;
/// exported).
///
/// Find z >= 0 with w = M z + q >= 0 and z_i w_i = 0 for every i. In contact z are forces that push
/// [N], M the compliance between the contact points [m/N], q the gaps before any force [m] and w
/// the gaps under it. M must have a positive definite symmetric part (stored models have M = M^T,
/// raw ones a skew part on top); then the solution exists and is unique. Thread: any, one workspace
/// each. No allocation, no lock; every bound is a count, so the same input gives the same bits. The
/// mathematics stand in complementarity.c.
#ifndef PALPATE_HAPTIC_COMPLEMENTARITY_H
#define PALPATE_HAPTIC_COMPLEMENTARITY_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_lcp {
    int32_t n;
    const double *m; ///< M, column-major, (n x n)
    int32_t ld;      ///< >= n
    int symmetric;   ///< 1: M = M^T and positive definite (Cholesky; LU when that fails)
    const double *q; ///< shape [n], finite
} pal_lcp;

typedef enum pal_lcp_state {
    PALPATE_LCP_SOLVED = 0,
    PALPATE_LCP_CUT_OFF = 1, ///< the iterations were used up: the best iterate is returned
    PALPATE_LCP_SINGULAR = 2 ///< a block of M could not be factored: the best iterate is returned
} pal_lcp_state;

typedef struct pal_lcp_result {
    pal_lcp_state state;
    int32_t iterations; ///< factorizations and Lemke pivots done
    /// || min(M_ii z_i, w_i) || / || q || of what is returned (the same unit in both arguments); 0
    /// when q is 0
    double residual;
} pal_lcp_result;

/// Iterations that suffice for every problem of the test with room to spare.
enum { PALPATE_LCP_ITERATIONS = 200 };

/// Bytes of workspace for problems of up to n unknowns: 8 n (n + 9) and a little.
PALPATE_API size_t pal_lcp_bytes(int32_t n);

/// Solve; whatever happens z is finite, z >= 0 (a contact never pulls), and its residual is no
/// worse than that of z = 0; more iterations never make it worse.
/// @param[in]     max_iterations  bound of factorizations and Lemke pivots together, >= 1
/// @param[in,out] active  where z_i > 0 is expected (nonzero), shape [n]: the set of the last tick,
///                or zeros; on return the set of z returned
/// @param[out]    z, w    shape [n]; w = M z + q of the z returned
/// @param[in,out] work    8-byte aligned, pal_lcp_bytes(n); contents need not be kept
/// Cost: per iteration k^3/3 (symmetric) or 2 k^3/3 for k active unknowns, and 4 n k; a Lemke pivot
/// 2 n^2. Thread: servo.
PALPATE_API pal_lcp_result pal_lcp_solve(const pal_lcp *problem, int32_t max_iterations,
                                         uint8_t *active, double *z, double *w, void *work);

#endif
