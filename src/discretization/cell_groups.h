/// @file cell_groups.h  Groups of node cells: the coarse level of the cell method's dilatation.
#ifndef PALPATE_SRC_CELL_GROUPS_H
#define PALPATE_SRC_CELL_GROUPS_H

#include <stdint.h>

#include <palpate/status.h>

#include "src/discretization/cell_faces.h"
#include "src/cloud/cloud.h"
#include "src/discretization/gradients.h"

/// Gather the nodes into groups, one for each interior node and about one for every six nodes where
/// there is no interior (cell_groups.c). A group is connected and every node has one.
/// @param[out] group  group of each node, shape [node_count]
/// @return PALPATE_OK; _MEMORY
pal_status pal_cell_groups(const pal_cloud *cloud, const pal_cell_faces *faces, int32_t *group,
                           int32_t *group_count, pal_error *error);

/// Mean gradient over each group's cells, from the nodes' (weights: cell volumes).
/// @param[out] volume  of each group, shape [group_count]
pal_status pal_cell_group_gradients(const pal_cloud *cloud, const pal_gradients *nodal,
                                    const int32_t *group, int32_t group_count, double *volume,
                                    pal_gradients *out, pal_error *error);

#endif
