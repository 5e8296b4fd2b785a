/// @file friction_problem.h  Problems of Coulomb friction and their conditions, for the tests of
/// the solver: written from the conditions (friction.h), not from the solver.
#ifndef PALPATE_TESTS_FRICTION_PROBLEM_H
#define PALPATE_TESTS_FRICTION_PROBLEM_H

#include <stdint.h>

#include "haptic/solver/friction.h"

enum { POINTS = 37, MAX = 3 * POINTS };

typedef struct friction_problem {
    int points, n, symmetric;
    int row[POINTS]; ///< first of each point
    double m[MAX * MAX], q[MAX], mu[POINTS];
} friction_problem;

/// Random matrix (see random_problems.h) of three rows a point.
void friction_random_matrix(friction_problem *p, int points, double condition, double skew,
                            int cone);
/// Random q; mu in [mu_least, mu_most].
void friction_random_vector(friction_problem *p, double mu_least, double mu_most);
/// Drop the tangential rows of points with mu = 0.
void friction_drop_idle_rows(friction_problem *p);

/// w = M f + q.
void friction_gaps(const friction_problem *p, const double *f, double *w);
/// Natural map of all conditions, unit step (M of the tests has norm about 1), over || q ||.
double friction_natural(const friction_problem *p, const double *f);
/// Fails the test unless every force is in its cone, to one rounding: the solver squares and sums.
void friction_assert_in_cones(const friction_problem *p, const double *f);

pal_friction_result friction_solve(const friction_problem *p, int iterations, uint8_t *state,
                                   double *f, double *w);

/// || a - b || / || b ||, or || a || where b = 0.
double friction_distance(int n, const double *a, const double *b);

#endif
