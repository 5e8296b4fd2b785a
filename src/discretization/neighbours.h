/// @file neighbours.h  Nearest nodes and nodes in a sphere, deterministic.
///
/// A k-d tree over a fixed set of points. Answers are ordered by (squared distance, index) and ties
/// are broken by index, so they depend on the points alone, never on the tree. Queries only read
/// the tree: any number of threads may ask at once.
#ifndef PALPATE_SRC_NEIGHBOURS_H
#define PALPATE_SRC_NEIGHBOURS_H

#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_neighbours {
    int32_t count;    ///< points
    double *position; ///< (count x 3) copy of the points, in their own order
    double *point;    ///< (count x 3) the points in tree order
    int32_t *index;   ///< (count) the points' own indices, in tree order
    uint8_t *axis;    ///< (count) splitting axis of the range whose middle this is
} pal_neighbours;

/// Build the tree (copies the points). Cost: O(count log count).
/// @param[in] position  shape [count, 3]
/// @return PALPATE_OK; _ARGUMENT (no point, or one that is not finite: located), _MEMORY
pal_status pal_neighbours_create(pal_neighbours *out, const double *position, int32_t count,
                                 pal_error *error);
void pal_neighbours_clear(pal_neighbours *n);

/// The k points nearest to x, ascending in (squared distance, index).
/// @param[out] index     shape [k]
/// @param[out] distance2 squared distances, shape [k]
/// @return number found: min(k, count)
int32_t pal_neighbours_nearest(const pal_neighbours *n, const double x[3], int32_t k,
                               int32_t *index, double *distance2);

/// The points with |x - x_J| <= radius, ascending in (squared distance, index); when there are more
/// than `capacity`, the nearest `capacity` of them.
/// @param[out] index     shape [capacity]
/// @param[out] distance2 squared distances, shape [capacity]
/// @param[out] total     how many there are, may exceed capacity; may be NULL
/// @return number written
int32_t pal_neighbours_within(const pal_neighbours *n, const double x[3], double radius,
                              int32_t capacity, int32_t *index, double *distance2, int32_t *total);

#endif
