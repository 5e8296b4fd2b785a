/// @file cell_patches.h  Dilatation patches: where the cell method averages the volumetric part.
///
/// One dilatation per node is one constraint per node as nu -> 1/2. Nodes whose displacement is
/// prescribed (supports, and all nodes a tool holds) bring a constraint but no freedom: beneath a
/// bonded patch the constraints outnumber the freedoms, and the force comes out too large (measured on
/// the hemisphere patch at nu = 0.4999, 1000 to 1300 nodes: 6 to 8 %). So the cell of every surface
/// node is joined to the cell of the interior neighbour it shares most volume with: constraints
/// belong to interior nodes, each of which brings three freedoms. A surface node without interior
/// neighbour (thin parts) keeps its own cell.
#ifndef PALPATE_SRC_CELL_PATCHES_H
#define PALPATE_SRC_CELL_PATCHES_H

#include "src/cell_faces.h"
#include "src/gradients.h"

/// Join the nodes' mean gradients into those of patches.
/// @param[in]  nodal   mean gradient over each node's cell (pal_cell_node_gradients)
/// @param[out] out     mean gradient over each patch
/// @param[out] volume  volume of each patch, shape [out->count]; the caller frees it
/// @return PALPATE_OK or _MEMORY
pal_status pal_cell_patches(const pal_cloud *cloud, const pal_cell_faces *faces,
                            const pal_gradients *nodal, pal_gradients *out, double **volume,
                            pal_error *error);

#endif
