/// @file row_clusters.h  Clusters of rows and a basis for each: the offline half of row_bases.h
/// (private).
#ifndef PALPATE_SRC_ROW_CLUSTERS_H
#define PALPATE_SRC_ROW_CLUSTERS_H

#include "haptic/model/model.h"

/// One finished cluster: rows at positions [first, first + count) of the row order.
typedef struct pal_cluster {
    int32_t first, count;
    int32_t rank;
    double *basis; ///< (3 count x rank) column-major, orthonormal columns
    float *coef;   ///< (rank x 3 columns) U^T A, A the normalised rows
    uint8_t *near; ///< (group_count) 1: the group's residual exceeds the tolerance
    double cost;   ///< elements read per field, expected
    struct pal_cluster *next;
} pal_cluster;

/// The dense rows and the trees over them.
typedef struct pal_cluster_job {
    const pal_model *model; ///< with dense rows in double or single precision
    const int32_t *row_order;
    int32_t group_count;
    const int32_t *group_start, *column_order;
    const double
        *size; ///< (3 columns) largest displacement of each column [m/N]; rows are divided by it
    double tolerance;  ///< of a column's displacement at any node, relative to its largest
    double separation; ///< a group is far when it lies beyond (1 + this) radii of the cluster
    double touched;    ///< dofs touched at once, for the cost
} pal_cluster_job;

/// Positions of points ordered so that each of the `start` intervals (count + 1 entries, NULL: not
/// wanted) holds at most `most` neighbouring points: halved along the longest side of their box.
/// @param index  which point each entry is, shape [points]; reordered
/// @return number of intervals
int32_t pal_cluster_split(const double *position, const int32_t *node, int32_t points, int32_t most,
                          int32_t *index, int32_t *start);

/// The cheapest clusters for positions [first, first + count): one, or those of its halves.
/// @return PALPATE_OK and a list in ascending order; _MEMORY
pal_status pal_cluster_build(const pal_cluster_job *job, int32_t first, int32_t count,
                             pal_cluster **out, pal_error *error);

void pal_cluster_free(pal_cluster *list);

/// Normalised rows of a cluster (3 count x 3 columns), column-major.
void pal_cluster_rows(const pal_cluster_job *job, int32_t first, int32_t count, double *rows);

#endif
