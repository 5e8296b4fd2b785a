/// @file gradients.h  Gradients at many points as one sparse operator on nodal values.
///
///     grad u (point q) = sum_{k = start[q]}^{start[q+1]-1}  weight[3k..3k+2]  u(node[k])
///
/// The common form of everything a discretization needs of the displacement: cell walls, smoothed
/// regions and nodal averages differ only in how the operator is made. Read-only after creation.
#ifndef PALPATE_SRC_GRADIENTS_H
#define PALPATE_SRC_GRADIENTS_H

#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_gradients {
    int32_t count;    ///< points
    int64_t *start;   ///< (count + 1)
    int32_t *node;    ///< (start[count]) ascending and unique at each point
    double *weight;   ///< (start[count] x 3) [1 / length]
    int64_t capacity; ///< entries allocated
} pal_gradients;

/// Lists of integers by owner: item[start[o] .. start[o+1]-1] belong to owner o.
typedef struct pal_lists {
    int32_t count;  ///< owners
    int64_t *start; ///< (count + 1)
    int32_t *item;
} pal_lists;

void pal_gradients_clear(pal_gradients *g);
void pal_lists_clear(pal_lists *l);

/// Room for `count` points (none filled yet: fill them in order with pal_gradients_append).
pal_status pal_gradients_create(pal_gradients *out, int32_t count, int64_t guess, pal_error *error);

/// Fill point `q` (points in ascending order) with `n` nodes, sorted here.
/// @param[in] node    shape [n], unique, any order
/// @param[in] weight  shape [n, 3]
/// @return PALPATE_OK or _MEMORY
pal_status pal_gradients_append(pal_gradients *g, int32_t q, int32_t n, const int32_t *node,
                                const double *weight, pal_error *error);

/// For every node, the points whose operator uses it, ascending, as entry numbers k of the
/// operator.
/// @param[out] point  the point of each item, shape [start[count]] (allocated; the caller frees it)
pal_status pal_gradients_users(const pal_gradients *g, int32_t node_count, pal_lists *entry,
                               int32_t **point, pal_error *error);

/// Invert a table: owner of each of `item_count` items x `per_item` owners -> items of each owner,
/// ascending. @param[in] table  shape [item_count, per_item]
pal_status pal_lists_invert(const int32_t *table, int32_t item_count, int32_t per_item,
                            int32_t owner_count, pal_lists *out, pal_error *error);

/// A scatter of 3-vectors onto nodes that can be emptied in time proportional to what it holds.
typedef struct pal_scatter {
    int32_t node_count;
    int32_t count; ///< nodes held
    int32_t *node; ///< (count) in order of arrival
    double *value; ///< (node_count x width) dense
    uint8_t *held; ///< (node_count)
    int32_t width;
} pal_scatter;

pal_status pal_scatter_create(pal_scatter *out, int32_t node_count, int32_t width,
                              pal_error *error);
void pal_scatter_clear(pal_scatter *s);
/// The `width` values of `node`, zeroes when it was not held; the node is held from now on.
double *pal_scatter_at(pal_scatter *s, int32_t node);
/// Sort the held nodes ascending.
void pal_scatter_sort(pal_scatter *s);
/// Forget all held nodes (their values are zeroed).
void pal_scatter_empty(pal_scatter *s);

#endif
