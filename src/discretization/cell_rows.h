/// @file cell_rows.h  Assembled 3x3 block rows, one node at a time, into the matrices of a system.
///
/// The method fills the row of one node in a pal_scatter of width 9 (block of node J: 3x3
/// row-major, force component x displacement component); the rows of free nodes become K, those of
/// fixed nodes the reaction, columns of fixed nodes (u = 0) are dropped.
#ifndef PALPATE_SRC_CELL_ROWS_H
#define PALPATE_SRC_CELL_ROWS_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/cloud/cloud.h"
#include "src/discretization/discretization.h"
#include "src/discretization/gradients.h"

/// Number the unknowns (3 per free node, in node order), list the fixed nodes, fill B with unit
/// columns at the free surface nodes. Zeroes *system first.
/// @return PALPATE_OK; _ARGUMENT: a fixed interior node, nothing free; _MEMORY (system cleared)
pal_status pal_rows_number(const pal_cloud *cloud, const uint8_t *fixed, pal_system *system,
                           pal_error *error);

/// Put node `node`'s block row into `row` (empty on entry).
typedef void (*pal_row_fill)(const void *context, int32_t node, pal_scatter *row);

/// Fill every node's row and make system->matrix and system->reaction from them; reports progress
/// as "assemble" from `done` to 1. @return PALPATE_OK; _MEMORY; _CANCELLED
pal_status pal_rows_assemble(pal_system *system, pal_row_fill fill, const void *context,
                             const pal_progress *progress, double done, pal_error *error);

#endif
