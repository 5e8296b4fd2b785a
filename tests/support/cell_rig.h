/// @file cell_rig.h  Boxes, solves and loads shared by the tests of the cell method (normalised, E
/// = 1).
#ifndef PALPATE_TESTS_SUPPORT_CELL_RIG_H
#define PALPATE_TESTS_SUPPORT_CELL_RIG_H

#include <stddef.h>
#include <stdint.h>

#include "src/discretization/discretization.h"

/// Zeroed arrays; the test fails when there is no memory.
uint8_t *rig_flags(int32_t n);
double *rig_zeros(size_t n);

/// Structured box [0,sx]x[0,sy]x[0,sz] of nx x ny x nz cells (seed 11).
void rig_box(pal_cloud *c, const double size[3], int nx, int ny, int nz, double jitter);

/// pal_method_cell; fails the test with its message.
void rig_build(const pal_cloud *c, const uint8_t *fixed, double nu, const pal_method *m,
               pal_system *s);

/// Solve in place and check the residual (backward stable: rounding of |K| |x|), so that no test
/// rests on a bad solve.
void rig_solve(const pal_system *s, double *x);

/// Stress of a displacement gradient.
void rig_stress(double nu, const double g[3][3], double sigma[3][3]);

/// Largest error of the displacement under sigma . area_vector of the linear field `g`, which must
/// vanish at the fixed nodes.
double rig_patch_error(const pal_cloud *c, const uint8_t *fixed, double nu, const pal_method *m,
                       const double g[3][3]);

/// Mean deflection along z of the end x = max under a unit shear force there, x = 0 held.
double rig_tip(const pal_cloud *c, double nu, const pal_method *m);

#endif
