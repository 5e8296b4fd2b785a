/// @file row_bases.h  The stored rows C_ST in compressed form: a small basis per cluster of rows
/// (private).
///
/// A field far from the tool is smooth, whatever touches: over a cluster of neighbouring rows r,
/// all columns of nodes further away lie in a space of few dimensions. With an orthonormal basis
/// U_r of it (rows x rank) and the touchable nodes in groups g,
///     C_rj  =  U_r S_rj  +  D_rg(j)     S_rj = U_r^T C_rj for every column j,
/// where D_rg = C_rg - U_r S_rg is stored only for the few pairs (r, g) where it exceeds the
/// tolerance: the group lies in the cluster or beside it. A field costs S (ranks instead of rows)
/// over the touched columns, then U once, however many nodes are touched, then the near pairs. This
/// is the row half of an H^2-matrix of one level (Hackbusch, Hierarchical Matrices: Algorithms and
/// Analysis, 2015, ch. 8), made algebraically by src/store/compress.c.
///
/// S is the model's c_st (scaled precision, `rank` rows instead of 3 row_count). U and D are
/// columns of 16-bit integers with a scale each. Everything is immutable once filled; owned by the
/// model.
#ifndef PALPATE_HAPTIC_ROW_BASES_H
#define PALPATE_HAPTIC_ROW_BASES_H

#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_row_bases {
    int32_t cluster_count, group_count, pair_count;
    int32_t rank; ///< sum of the clusters' ranks: rows of S

    int32_t *cluster_start; ///< (cluster_count + 1) first position in row_order; ascending
    int32_t *row_order;     ///< (row_count) row at each position: a permutation
    int32_t *rank_start;    ///< (cluster_count + 1) first row of S; may repeat (rank 0)
    int32_t *group_start;   ///< (group_count + 1) first position in column_order; ascending
    int32_t *column_order;  ///< (column_count) column at each position: a permutation
    int32_t *pair_start;    ///< (group_count + 1) first near pair of each group
    int32_t *pair_cluster;  ///< (pair_count) its cluster; ascending within a group

    int16_t *
        basis; ///< U: cluster r at basis_start[r], rank columns of pal_bases_ld(r); 64-byte aligned
    float *basis_scale; ///< (rank)
    int16_t *near;      ///< D: pair p at near_start[p], 3 columns per node of the group, each of
                        ///< pal_bases_ld(cluster); 64-byte aligned
    float *near_scale;  ///< pair p at near_scale_start[p]

    // derived by pal_row_bases_derive, not stored
    int64_t *basis_start;      ///< (cluster_count + 1) elements
    int64_t *near_start;       ///< (pair_count + 1) elements
    int64_t *near_scale_start; ///< (pair_count + 1)
    int64_t *tile_start;       ///< (cluster_count + 1) the clusters' padded rows, end to end
    int32_t *row_place;        ///< (row_count) position of each row in row_order
    int32_t *column_place;     ///< (column_count) position of each column in column_order
    int32_t *column_group;     ///< (column_count)
} pal_row_bases;

/// Rows of a cluster in storage: 3 per node, up to whole lines of 64 bytes.
static inline int64_t pal_bases_ld(const pal_row_bases *b, int32_t cluster) {
    return (3 * (int64_t)(b->cluster_start[cluster + 1] - b->cluster_start[cluster]) + 31) / 32 *
           32;
}
static inline int32_t pal_bases_rank(const pal_row_bases *b, int32_t cluster) {
    return b->rank_start[cluster + 1] - b->rank_start[cluster];
}

/// Check the counts and index arrays, which must be there, against each other and make the derived
/// arrays. Nothing is read of the data. @return PALPATE_OK; _ARGUMENT saying what is wrong, _MEMORY
PALPATE_API pal_status pal_row_bases_derive(pal_row_bases *b, int32_t row_count,
                                            int32_t column_count, pal_error *error);

/// Allocate the data for the derived sizes (zeroed).
PALPATE_API pal_status pal_row_bases_alloc(pal_row_bases *b, pal_error *error);

/// The same checks again on a whole model, the derived arrays and every scale. Allocates nothing.
/// @return PALPATE_OK; _ARGUMENT
PALPATE_API pal_status pal_row_bases_check(const pal_row_bases *b, int32_t row_count,
                                           int32_t column_count, pal_error *error);

/// column (3 row_count) = U S + D for one column of the model.
/// @param s  its coefficients [m/N], element i is s_unit x s[i], shape [rank]
PALPATE_API void pal_row_bases_column(const pal_row_bases *b, int64_t dof, const int16_t *s,
                                      double s_unit, double *column);

/// Bytes of the bases and near pairs (S not counted).
PALPATE_API uint64_t pal_row_bases_bytes(const pal_row_bases *b);

/// Free all; NULL is allowed.
PALPATE_API void pal_row_bases_free(pal_row_bases *b);

#endif
