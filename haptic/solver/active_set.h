/// @file active_set.h  The touched nodes and their compliance system C_aa f_a = u_a (private).
///
/// De, Hong, Bathe 2003, Eq. 52. The set is an ordered list of column nodes; its matrix is factored
/// by pal_dense (Cholesky of the stored symmetric block, LU with partial pivoting of a raw one). A
/// Cholesky factor is kept and extended: appending nodes adds rows, removing one keeps the rows in
/// front of it, an unchanged set costs two triangular solves. A row of the factor depends only on
/// the rows before it, so the result depends on the order of the list and not on how it came about.
/// Thread: one at a time. No allocation.
#ifndef PALPATE_HAPTIC_ACTIVE_SET_H
#define PALPATE_HAPTIC_ACTIVE_SET_H

#include <stddef.h>
#include <stdint.h>

#include "haptic/model/model.h"

typedef struct pal_active_set {
    const double *c;  ///< C_TT, column-major
    int64_t ld;       ///< 3 column_count
    int symmetric;    ///< stored block is symmetric
    int32_t capacity; ///< nodes
    int32_t count;    ///< nodes in the set
    int32_t solved;   ///< unknowns of the last solve (f, dof of that solve are kept until the next)
    int32_t factored; ///< leading unknowns whose factor is valid
    int32_t *column;  ///< column node of each, shape [capacity]
    double *u;        ///< prescribed displacement [m], shape [capacity, 3]
    double *f;        ///< forces of the last solve [N], shape [3 capacity]
    int32_t *dof;     ///< their columns of C, shape [3 capacity]
    double *matrix;   ///< factor, shape [3 capacity, 3 capacity], column-major
    double *work;     ///< shape [3 capacity]
    int32_t *pivot;   ///< shape [3 capacity]
    int current;      ///< the set is that of the last solve
    int32_t slots;    ///< nodes whose rows are cached
    int32_t next;     ///< slot to give away next
    int32_t stride;   ///< elements between cached rows
    int32_t *slot;    ///< slot of each column node, -1: none; shape [column_count]
    int32_t *owner;   ///< column node of each slot, -1: none; shape [slots]
    int32_t *valid;   ///< leading unknowns gathered; shape [slots]
    uint64_t *used;   ///< `solves` when last asked for; shape [slots]
    uint64_t solves;  ///< solves so far
    double *row;      ///< rows of C against the set's unknowns, shape [slots, 3, stride]
} pal_active_set;

size_t pal_active_set_bytes(const pal_model *model, int32_t capacity);
/// @param memory 64-byte aligned, pal_active_set_bytes() long
void pal_active_set_init(pal_active_set *set, const pal_model *model, int32_t capacity,
                         void *memory);

/// Empty the set and forget the last solve.
void pal_active_set_clear(pal_active_set *set);
/// Append column node `column`; the set must not be full. Its u is zero.
void pal_active_set_append(pal_active_set *set, int32_t column);
/// Remove entry `index`; later entries move up.
void pal_active_set_remove(pal_active_set *set, int32_t index);

/// f = C_aa^-1 u. @return 0; -1 when the matrix could not be factored (f, dof, solved unchanged).
/// Cost: O(m^2) for an unchanged set, O(m^3) for a new one.
int pal_active_set_solve(pal_active_set *set);

/// Displacement of column node `column` under the forces of the last solve [m]. Cost: O(3 m).
void pal_active_set_displacement(pal_active_set *set, int32_t column, double u[3]);

#endif
