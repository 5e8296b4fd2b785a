/// @file factor.h  Factorization of the assembled system and solves with many right-hand sides.
///
/// Nonsymmetric systems: UMFPACK (METIS ordering on the pattern of K + K^T, row-scaled). Symmetric
/// positive definite systems: CHOLMOD, supernodal, METIS ordering. Both factors are then solved in
/// blocks of right-hand sides by our own kernel (lu_solve.h), which skips what unit loads leave
/// zero and what nobody asked for: UMFPACK's own solve takes one right-hand side at a time, and
/// CHOLMOD's solves through a threaded BLAS, which stalls as soon as another process wants a core.
///
/// Threads: a factor is immutable after creation; any number of threads may solve with it, each
/// with its own workspace.
#ifndef PALPATE_SRC_FACTOR_H
#define PALPATE_SRC_FACTOR_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

#include "src/discretization/sparse.h"

typedef struct pal_factor pal_factor;
typedef struct pal_factor_workspace pal_factor_workspace;

/// Right-hand sides one call solves at once at the best speed.
enum { PALPATE_FACTOR_BLOCK = 32 };

typedef struct pal_factor_report {
    char kind[96];    ///< e.g. "UMFPACK 5.7.9 (symmetric strategy, METIS)"
    double rcond;     ///< cheap reciprocal condition estimate of the scaled matrix
    int64_t nonzeros; ///< of the factors (L + U, or L)
    uint64_t bytes;   ///< held by the factors
    double flops;     ///< of the factorization
    double seconds;   ///< analysis + factorization
} pal_factor_report;

/// Factor K (n x n).
/// @param positive  1: K is symmetric positive definite (both triangles stored)
/// @param[out] report  may be NULL
/// @return PALPATE_OK; _SINGULAR (the message names the unknown where it stopped), _MEMORY,
///         _CANCELLED (progress said so before the numerical phase)
pal_status pal_factor_create(const pal_sparse *k, int positive, const pal_progress *progress,
                             pal_factor **out, pal_factor_report *report, pal_error *error);
/// The same, refused before the numerical phase (PALPATE_ERROR_MEMORY) when the factors, whose size
/// the symbolic analysis tells, and `reserve` bytes to be allocated next to them will not fit in
/// memory.
pal_status pal_factor_create_beside(const pal_sparse *k, int positive, uint64_t reserve,
                                    const pal_progress *progress, pal_factor **out,
                                    pal_factor_report *report, pal_error *error);
void pal_factor_free(pal_factor *factor);

pal_factor_workspace *pal_factor_workspace_new(const pal_factor *factor);
void pal_factor_workspace_free(pal_factor_workspace *workspace);

/// Tell which unknowns of later solutions are wanted: the others may come out as garbage, at less
/// cost. @param needed (n) flags; NULL: all. Not while another thread solves.
pal_status pal_factor_need(pal_factor *factor, const uint8_t *needed, pal_error *error);

/// Solve K X = B in place.
/// @param[in,out] x  (n x count), column-major, ld = n; right-hand sides in, solutions out
/// Cost: O(count * nonzeros); zero parts of the right-hand sides are skipped. Thread: one per
/// workspace.
pal_status pal_factor_solve(const pal_factor *factor, pal_factor_workspace *workspace,
                            int32_t count, double *x, pal_error *error);

/// The same through the library's own one-at-a-time solve, with its iterative refinement steps: the
/// baseline of bench/offline and an independent route for tests. UMFPACK only for refine > 0.
pal_status pal_factor_solve_reference(const pal_factor *factor, const pal_sparse *k, int refine,
                                      const double *b, double *x, pal_error *error);

#endif
