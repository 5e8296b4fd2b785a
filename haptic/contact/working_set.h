/// @file working_set.h  The nodes under the contact points and their compliance block (private).
///
/// Contact at a surface point interpolates the nodes around it; the compliance between all nodes in
/// use is kept here from tick to tick in one small contiguous block, so that only a node that is
/// new costs accesses to the big C_TT (a cache miss each). What is kept is its regular part R_ab
/// (near_field.h): C_ab less the half-space's own 1/r, and between neighbours, where no mesh
/// resolves 1/r, the value of the nodes around. R is what the mesh knows of the body beyond a
/// half-space and is smooth, so it may be interpolated; 1/r is put back between the contact points
/// (contact_system.c) with the points' own area in place of the nodes'. Hence tips below the node
/// spacing resolve, and sliding does not rise and fall with the nodes.
///
/// Thread: one at a time. No allocation, every bound a count.
#ifndef PALPATE_HAPTIC_WORKING_SET_H
#define PALPATE_HAPTIC_WORKING_SET_H

#include <stddef.h>
#include <stdint.h>

#include "haptic/contact/near_field.h"

typedef struct pal_working_set {
    const pal_model *model;
    const pal_near_field *near;
    int symmetric;    ///< C_TT is
    int32_t capacity; ///< nodes
    int32_t count;    ///< nodes in the set; slots 0 .. count - 1
    int32_t stride;   ///< elements between columns of `block`
    uint64_t tick;
    uint64_t gathered; ///< nodes read from C_TT so far
    int32_t *slot;     ///< of each column node, -1: none; shape [column_count]
    int32_t *column;   ///< column node of each slot, shape [capacity]
    uint64_t *used;    ///< tick in which it was last asked for, shape [capacity]
    double *block;     ///< R, column-major, (3 capacity x 3 capacity), ld = stride [m/N]
} pal_working_set;

/// A multiple of 64.
size_t pal_working_set_bytes(const pal_model *model, int32_t capacity);
/// @param memory 64-byte aligned, pal_working_set_bytes() long; zeroed here
void pal_working_set_init(pal_working_set *set, const pal_near_field *near, int32_t capacity,
                          void *memory);
void pal_working_set_clear(pal_working_set *set);

/// Begin a tick: nodes not used in the last one stay, up to a few; slots may change.
void pal_working_set_begin(pal_working_set *set);
/// Slot of a column node, gathered when new; stays valid until the next begin.
/// @return the slot; -1: the set is full. Cost of a new node: 9 count accesses to C_TT (18 count
/// when it is not symmetric), prefetched.
int32_t pal_working_set_add(pal_working_set *set, int32_t column);

#endif
