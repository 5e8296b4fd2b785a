/// @file friction.h  Unilateral contact with Coulomb friction, circular cone (private; exported).
///
/// m contact points, each with a local frame (normal, tangent 1, tangent 2); f [N] acts on the body
/// along it, w [m] is the gap (normal) and the slip (tangents) under f. A point has three rows in
/// this order where its mu > 0, one (normal) where mu = 0. Given the compliance M between the rows
/// and q, the gaps and slips without force, find f with w = M f + q and at every point
///     f_n >= 0,  w_n >= 0,  f_n w_n = 0,                       (unilateral)
///     |f_t| <= mu f_n;  w_t = 0 or f_t = -mu f_n w_t / |w_t|.   (stick or slip)
/// A held point (mu < 0: grasped) has three rows and w = 0, whatever its force.
/// M must have a positive definite symmetric part (stored models have M = M^T, raw ones a skew part
/// on top). Then a solution exists. It is unique for mu below a bound that M sets (the closer to
/// diagonal, the larger); beyond it Coulomb's law itself may admit several, and which of them is
/// returned depends on the start: from the forces of the last tick, the one continued from there.
/// Thread: any, one workspace each. No allocation, no lock; every bound is a count, so the same
/// input and start give the same bits. The mathematics stand in friction.c.
#ifndef PALPATE_HAPTIC_FRICTION_H
#define PALPATE_HAPTIC_FRICTION_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_friction {
    int32_t points;
    int32_t rows;     ///< 3 for every point with mu != 0, 1 for the others
    const double *m;  ///< M [m/N], column-major, (rows x rows), rows of point 0 first
    int32_t ld;       ///< >= rows
    int symmetric;    ///< 1: M = M^T (Cholesky where the system is symmetric; LU when that fails)
    const double *q;  ///< [m], shape [rows], finite
    const double *mu; ///< shape [points]; < 0: held
} pal_friction;

/// What a point does; the numbers are part of the warm start.
typedef enum pal_friction_point {
    PALPATE_POINT_OPEN = 0,
    PALPATE_POINT_STICK = 1, ///< also a held point
    PALPATE_POINT_SLIP = 2   ///< points without friction that touch are slipping
} pal_friction_point;

typedef enum pal_friction_state {
    PALPATE_FRICTION_SOLVED = 0,
    PALPATE_FRICTION_CUT_OFF = 1, ///< the iterations were used up: the best iterate is returned
    PALPATE_FRICTION_SINGULAR = 2 ///< as CUT_OFF, and a system could not be factored on the way
} pal_friction_state;

typedef struct pal_friction_result {
    pal_friction_state state;
    int32_t iterations; ///< factorizations done
    /// Natural map of all conditions, over || q || (0 when q is 0): || r || with
    /// r_n = min(d_n f_n, w_n), r_t = d_t f_t - P(d_t f_t - w_t), P: onto the disc of radius
    /// mu d_t f_n, d_n and d_t the point's own compliances; r = w where held.
    double residual;
} pal_friction_result;

/// Iterations that suffice for every problem of the test but one in thousands.
enum { PALPATE_FRICTION_ITERATIONS = 600 };

/// Bytes of workspace for up to `points` points of three rows: about 8 (10 m^2 + 60 m).
PALPATE_API size_t pal_friction_bytes(int32_t points);

/// Solve; whatever happens f is finite, f_n >= 0 and |f_t| <= mu f_n, and its residual is no worse
/// than that of f = 0. With mu = 0 everywhere this is pal_lcp_solve, bit for bit.
/// @param[in]     max_iterations  bound of factorizations, >= 1
/// @param[in,out] state  pal_friction_point of each, shape [points]: of the last tick, or zeros
/// @param[in,out] f      shape [rows]: forces of the last tick or zeros (finite) as a start; on
///                       return the forces
/// @param[out]    w      shape [rows]; w = M f + q of the f returned
/// @param[in,out] work   8-byte aligned, pal_friction_bytes(points); contents need not be kept
/// Cost: an iteration is one factorization of 3 unknowns per sticking or held, 2 per slipping, 1
/// per frictionless point in contact, and 3 rows^2; from a start that solves the problem there is
/// none. Thread: servo. Source: Alart, Curnier 1991; Hueeber, Stadler, Wohlmuth 2008.
PALPATE_API pal_friction_result pal_friction_solve(const pal_friction *problem,
                                                   int32_t max_iterations, uint8_t *state,
                                                   double *f, double *w, void *work);

#endif
