/// @file galerkin_regions.h  Smoothing regions of the cells and the block matrices they couple.
///
/// A region is a part of the body over which the gradient of the trial functions is averaged
/// exactly: by the divergence theorem the average over a region is an integral over its boundary,
/// so the averages add up to boundary terms alone and the linear patch test holds to rounding
/// (stabilised conforming nodal integration, Chen, Wu, Yoon, You 2001). Three partitions of the
/// tetrahedra:
///
///     TET   the tetrahedron itself
///     PAIR  the sixth of each tetrahedron that belongs to one of its edges (cut through face and
///           cell centroids): one region per pair of neighbouring nodes (Nguyen-Thoi, Liu et al.
///           2009)
///     NODE  the quarter of each tetrahedron that belongs to one of its corners: the median dual
///
/// Thread: functions are reentrant; results are read only afterwards.
#ifndef PALPATE_SRC_GALERKIN_REGIONS_H
#define PALPATE_SRC_GALERKIN_REGIONS_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

#include "src/cloud/cloud.h"

typedef enum pal_region_kind {
    PALPATE_REGION_TET = 0,
    PALPATE_REGION_PAIR = 1,
    PALPATE_REGION_NODE = 2
} pal_region_kind;

typedef struct pal_regions {
    int32_t count;
    int64_t *start;   ///< (count + 1) into node and gradient
    int32_t *node;    ///< (start[count]) nodes of each region, ascending
    double *gradient; ///< (start[count] x 3) mean gradient of the node's trial function [1/length]
    double *volume;   ///< (count)
    int64_t *at_node; ///< (node_count + 1) into region and local
    int32_t *region;  ///< regions of each node, ascending
    int32_t *local;   ///< the node's place in that region's list
    double worst_condition; ///< of the tetrahedra's scaled moment matrices (4-node linear MLS)
    double worst_point[3];  ///< centroid of that tetrahedron
} pal_regions;

/// A tetrahedron's part of a region; sorted by (key, tet), a region is a run of equal keys.
typedef struct pal_region_part {
    uint64_t key; ///< TET: the tetrahedron; PAIR: smaller node << 32 | larger node; NODE: the node
    int32_t tet;
} pal_region_part;

/// The parts of all regions, sorted: 1, 6 or 4 per tetrahedron. Free with free(); NULL: no memory.
pal_region_part *pal_region_parts(const pal_cloud *cloud, pal_region_kind kind, size_t *count);

/// Fill at_node, region and local from start and node. Their arrays must be allocated.
void pal_regions_transpose(pal_regions *regions, int32_t node_count);

/// Cut the cloud's tetrahedra into regions.
/// @return PALPATE_OK; _CLOUD (a tetrahedron without volume, a node of no tetrahedron: located),
///         _MEMORY (out is cleared). Cost: O(tets log tets).
pal_status pal_regions_create(pal_regions *out, const pal_cloud *cloud, pal_region_kind kind,
                              pal_error *error);
void pal_regions_clear(pal_regions *regions);

/// A matrix of 3 x 3 blocks on node pairs that share a region; rows ascending in column.
typedef struct pal_blocks {
    int32_t node_count;
    int64_t *start;  ///< (node_count + 1)
    int32_t *column; ///< (start[node_count]) node, ascending in each row
    double *value;   ///< (start[node_count] x 9) row-major blocks
} pal_blocks;

/// Zero matrix on the pattern of `regions` and of `more` (may be NULL).
/// @return PALPATE_OK or _MEMORY (out is cleared)
pal_status pal_blocks_create(pal_blocks *out, const pal_regions *regions, const pal_regions *more,
                             int32_t node_count, pal_error *error);
void pal_blocks_clear(pal_blocks *blocks);

/// Add the strain energy of the regions' mean gradients: for nodes a, b of a region of volume V
///     block_ij += V (shear (g_a . g_b delta_ij + g_a_j g_b_i) + volumetric g_a_i g_b_j)
/// which is 2 shear eps(u):eps(v) + volumetric div u div v. Rows are independent and summed in
/// region order, so the result is exactly symmetric. The regions' pattern must be within that of
/// `blocks`.
/// @return PALPATE_OK, _MEMORY, or _CANCELLED
pal_status pal_blocks_add_energy(pal_blocks *blocks, const pal_regions *regions, double shear,
                                 double volumetric, const pal_progress *progress,
                                 double progress_from, double progress_to, pal_error *error);

#endif
