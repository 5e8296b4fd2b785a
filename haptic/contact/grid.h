/// @file grid.h  The touchable nodes at rest and a spatial grid over them (private).
///
/// Built once at creation in the caller's memory, immutable afterwards. Queries return nodes in a
/// fixed order (cell by cell, ascending inside a cell): the same box gives the same list.
/// Threads: any, after pal_grid_init.
#ifndef PALPATE_HAPTIC_GRID_H
#define PALPATE_HAPTIC_GRID_H

#include <stddef.h>
#include <stdint.h>

#include "haptic/model/model.h"

typedef struct pal_grid {
    int32_t count;    ///< touchable column nodes
    int32_t *column;  ///< index into model->column_node, ascending, shape [count]
    double *position; ///< rest positions [m], shape [count, 3]
    double *normal;   ///< outward unit normals, shape [count, 3]
    double *reach;    ///< radius around the node that its triangles leave to it [m], shape [count]
    double reach_max; ///< [m]
    double low[3];    ///< corner of cell 0 [m]
    double cell;      ///< cell size [m]
    int32_t size[3];  ///< cells per direction
    int32_t *start;   ///< first entry of each cell, shape [cells + 1]
    int32_t *node;    ///< node indices 0..count-1 by cell, shape [count]
} pal_grid;

/// Bytes that pal_grid_init needs for a model (a multiple of 64).
size_t pal_grid_bytes(const pal_model *model);

/// Build in `memory` (64-byte aligned, pal_grid_bytes() long).
void pal_grid_init(pal_grid *grid, const pal_model *model, void *memory);

/// Nodes at rest inside the closed box; `out` must hold grid->count. @return how many.
int32_t pal_grid_query(const pal_grid *grid, const double low[3], const double high[3],
                       int32_t *out);

#endif
