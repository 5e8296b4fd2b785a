/// @file shape.h  Constraint surfaces that nodes must lie on, and the spacing wanted at a point.
///
/// A surface node lies on one face of the body, on a curve (sharp edge or patch rim) or on a
/// corner: it satisfies one, two or three constraints f_i(x) = 0. Everything is in normalised
/// coordinates (cloud.h). Thread: any, read-only after it is filled.
#ifndef PALPATE_SRC_SHAPE_H
#define PALPATE_SRC_SHAPE_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/geometry/bvh.h"

typedef enum pal_constraint_kind {
    PALPATE_CONSTRAINT_PLANE,  ///< normal . x = offset
    PALPATE_CONSTRAINT_SPHERE, ///< |x - center| = radius
    PALPATE_CONSTRAINT_MESH,   ///< on the input triangulation (closest point)
    PALPATE_CONSTRAINT_EDGES   ///< on the input's sharp edges (closest point)
} pal_constraint_kind;

typedef struct pal_constraint {
    pal_constraint_kind kind;
    double vector[3]; ///< plane: unit normal; sphere: center
    double value;     ///< plane: offset; sphere: radius
} pal_constraint;

/// Up to four constraint numbers, ascending; unused ones are -1 at the end.
typedef struct pal_constraint_set {
    int16_t id[4];
} pal_constraint_set;

typedef struct pal_shape {
    int32_t count, capacity;
    pal_constraint *constraint;
    const pal_bvh *mesh; ///< of PALPATE_CONSTRAINT_MESH; may be NULL when there is none
    int32_t segment_count;
    double *segment; ///< (segment_count x 6) sharp edges of the input, for _EDGES
} pal_shape;

/// @return the number of the constraint (an equal one is reused), or a negative pal_status
int pal_shape_add(pal_shape *shape, const pal_constraint *constraint);
void pal_shape_clear(pal_shape *shape);

pal_constraint_set pal_set_none(void);
pal_constraint_set pal_set_one(int id);
pal_constraint_set pal_set_union(pal_constraint_set a, pal_constraint_set b);
pal_constraint_set pal_set_common(pal_constraint_set a, pal_constraint_set b);
int pal_set_equal(pal_constraint_set a, pal_constraint_set b);
int pal_set_has(pal_constraint_set a, int id);

/// Signed distance-like value of a plane or sphere constraint and its unit gradient (may be NULL).
double pal_constraint_value(const pal_constraint *c, const double x[3], double gradient[3]);

/// Move x to a nearby point that satisfies every constraint of the set (least-norm Newton steps;
/// linearly dependent constraints are skipped).
/// @param side  outward direction of the surface at x, to find the right side of the input
///              triangulation (bvh.h); NULL: any
/// @return 1 when the residual ended below 1e-11, else 0 (x is then the best point found)
int pal_shape_project(const pal_shape *shape, pal_constraint_set set, const double *side,
                      double x[3]);

/// Spacing: h(x) = min(cap, min over sources of (h_s + grading * distance to the source)).
typedef struct pal_size_source {
    double a[3], b[3]; ///< segment of a rim, or a ball's center twice
    double radius;     ///< ball: inside it the spacing is h; rim: 0
    double spacing;    ///< h_s
} pal_size_source;

typedef struct pal_size_field {
    double cap, grading;
    int32_t count, capacity;
    pal_size_source *source;
} pal_size_field;

/// @return PALPATE_OK or PALPATE_ERROR_MEMORY
pal_status pal_size_add(pal_size_field *field, const pal_size_source *source);
void pal_size_clear(pal_size_field *field);
double pal_size_at(const pal_size_field *field, const double x[3]);

#endif
