/// @file synthetic_model.h  Models whose compliance is known in closed form, for tests and benches.
///
/// A box of (n + 2) x (n + 2) x layers nodes, its top at z = 0, cut out of an elastic half space:
/// the compliance is Boussinesq's and Cerruti's, so it is physical (symmetric, positive definite,
/// decays as 1/r) without solving anything. The bottom layer is marked fixed and has neither rows
/// nor columns. The n x n inner nodes of the top are touchable and have exact +z normals.
#ifndef PALPATE_TESTS_SYNTHETIC_MODEL_H
#define PALPATE_TESTS_SYNTHETIC_MODEL_H

#include <stdint.h>

#include <palpate/model.h>

typedef enum synthetic_rows {
    SYNTHETIC_ROWS_NONE,
    SYNTHETIC_ROWS_SURFACE,
    SYNTHETIC_ROWS_ALL
} synthetic_rows;

typedef struct synthetic_params {
    int32_t n;               ///< touchable nodes per side (n >= 2); column_count = n * n
    int32_t layers;          ///< node layers in depth, top and bottom included (>= 2)
    double spacing;          ///< [m], in all directions
    double young, poisson;   ///< [Pa], -
    synthetic_rows rows;     ///< surface: all unfixed surface nodes; all: all unfixed nodes
    pal_precision precision; ///< of the rows
    /// 0: C_TT symmetric positive definite. Else a skew part of this relative size (reciprocity
    /// ||C - C^T||_F / ||C||_F is about `skew`) is added and the model marked not symmetrized.
    double skew;
    int32_t skin; ///< 1: add a render mesh twice as fine as the top, bilinear weights
} synthetic_params;

/// n = 6, layers = 3, spacing 2 mm, E = 10 kPa, nu = 0.45, surface rows in single, symmetric, no
/// skin.
synthetic_params synthetic_default_params(void);

/// Build the model: patches "centre" (touchable nodes within 1.6 spacings of the top's centre) and
/// "all"; probes "deep" (below the centre) and "beside" (off it); one scripted sphere tool "probe"
/// of radius 2 spacings that starts touching the top's centre and presses along -z.
/// @return NULL when out of memory or a parameter is out of range
pal_model *synthetic_model(const synthetic_params *params);

/// Displacement [m] at point x under a unit force in direction `direction` at surface point y of
/// the half space z <= 0 (z up): u[3]. At x == y: the mean over a disc of area `area` of the
/// displacement under a uniform traction on it.
void synthetic_green(double young, double poisson, const double x[3], const double y[3],
                     int direction, double area, double u[3]);

#endif
