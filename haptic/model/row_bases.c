/// @file row_bases.c  Life and checks of the compressed rows (see row_bases.h). Thread: any.
#include "haptic/model/row_bases.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

#define BAD(...) pal_fail(error, PALPATE_ERROR_ARGUMENT, "model: rows: " __VA_ARGS__)

void pal_row_bases_free(pal_row_bases *b) {
    if (b == NULL) {
        return;
    }
    free(b->cluster_start);
    free(b->row_order);
    free(b->rank_start);
    free(b->group_start);
    free(b->column_order);
    free(b->pair_start);
    free(b->pair_cluster);
    free(b->basis);
    free(b->basis_scale);
    free(b->near);
    free(b->near_scale);
    free(b->basis_start);
    free(b->near_start);
    free(b->near_scale_start);
    free(b->tile_start);
    free(b->row_place);
    free(b->column_place);
    free(b->column_group);
    free(b);
}

/// first[0] = 0, ascending (strictly when asked), first[count] = end.
static pal_status check_starts(const char *name, const int32_t *first, int32_t count, int32_t end,
                               int strictly, pal_error *error) {
    if (first == NULL) {
        return BAD("%s is missing", name);
    }
    if (first[0] != 0 || first[count] != end) {
        return BAD("%s runs from %d to %d, must be 0 to %d", name, (int)first[0], (int)first[count],
                   (int)end);
    }
    for (int32_t i = 0; i < count; i++) {
        if (first[i + 1] < first[i] || (strictly && first[i + 1] == first[i]) ||
            first[i + 1] > end) {
            return BAD("%s[%d] is %d after %d", name, (int)i + 1, (int)first[i + 1], (int)first[i]);
        }
    }
    return PALPATE_OK;
}

/// Each of 0 .. count - 1 once; its inverse goes to `place` (count).
static pal_status invert(const char *name, const int32_t *order, int32_t count, int32_t *place,
                         pal_error *error) {
    if (order == NULL && count > 0) {
        return BAD("%s is missing", name);
    }
    for (int32_t i = 0; i < count; i++) {
        place[i] = -1;
    }
    for (int32_t i = 0; i < count; i++) {
        if (order[i] < 0 || order[i] >= count || place[order[i]] >= 0) {
            return BAD("%s[%d] is %d, must be a permutation of 0 to %d", name, (int)i,
                       (int)order[i], (int)count - 1);
        }
        place[order[i]] = i;
    }
    return PALPATE_OK;
}

static pal_status check_structure(const pal_row_bases *b, int32_t row_count, int32_t column_count,
                                  pal_error *error) {
    if (row_count < 1 || column_count < 1 || b->cluster_count < 1 || b->cluster_count > row_count ||
        b->group_count < 1 || b->group_count > column_count || b->rank < 0 ||
        (int64_t)b->rank > 3 * (int64_t)row_count || b->pair_count < 0 ||
        (int64_t)b->pair_count > (int64_t)b->cluster_count * b->group_count) {
        return BAD(
            "%d clusters, %d groups, %d near pairs, rank %d do not fit %d rows of %d columns",
            (int)b->cluster_count, (int)b->group_count, (int)b->pair_count, (int)b->rank,
            (int)row_count, (int)column_count);
    }
    pal_status status =
        check_starts("cluster_start", b->cluster_start, b->cluster_count, row_count, 1, error);
    if (status == PALPATE_OK) {
        status = check_starts("rank_start", b->rank_start, b->cluster_count, b->rank, 0, error);
    }
    if (status == PALPATE_OK) {
        status =
            check_starts("group_start", b->group_start, b->group_count, column_count, 1, error);
    }
    if (status == PALPATE_OK) {
        status = check_starts("pair_start", b->pair_start, b->group_count, b->pair_count, 0, error);
    }
    for (int32_t r = 0; status == PALPATE_OK && r < b->cluster_count; r++) {
        if (pal_bases_rank(b, r) > 3 * (b->cluster_start[r + 1] - b->cluster_start[r])) {
            status = BAD("cluster %d has rank %d for %d nodes", (int)r, (int)pal_bases_rank(b, r),
                         (int)(b->cluster_start[r + 1] - b->cluster_start[r]));
        }
    }
    if (status == PALPATE_OK && b->pair_cluster == NULL && b->pair_count > 0) {
        status = BAD("pair_cluster is missing");
    }
    for (int32_t g = 0; status == PALPATE_OK && g < b->group_count; g++) {
        for (int32_t p = b->pair_start[g]; p < b->pair_start[g + 1]; p++) {
            // NOLINTNEXTLINE(*.NullDereference): pairs end at pair_count
            int32_t r = b->pair_cluster[p];
            if (r < 0 || r >= b->cluster_count ||
                (p > b->pair_start[g] && r <= b->pair_cluster[p - 1])) {
                status = BAD("pair_cluster[%d] is %d of %d, must ascend within a group", (int)p,
                             (int)r, (int)b->cluster_count);
                break;
            }
        }
    }
    return status;
}

static int64_t group_columns(const pal_row_bases *b, int32_t group) {
    return 3 * (int64_t)(b->group_start[group + 1] - b->group_start[group]);
}

pal_status pal_row_bases_derive(pal_row_bases *b, int32_t row_count, int32_t column_count,
                                pal_error *error) {
    pal_status status = check_structure(b, row_count, column_count, error);
    if (status != PALPATE_OK) {
        return status;
    }
    size_t clusters = (size_t)b->cluster_count, pairs = (size_t)b->pair_count;
    b->row_place = malloc((size_t)row_count * sizeof *b->row_place);
    b->column_place = malloc((size_t)column_count * sizeof *b->column_place);
    b->column_group = malloc((size_t)column_count * sizeof *b->column_group);
    b->basis_start = malloc((clusters + 1) * sizeof *b->basis_start);
    b->tile_start = malloc((clusters + 1) * sizeof *b->tile_start);
    b->near_start = malloc((pairs + 1) * sizeof *b->near_start);
    b->near_scale_start = malloc((pairs + 1) * sizeof *b->near_scale_start);
    if (b->row_place == NULL || b->column_place == NULL || b->column_group == NULL ||
        b->basis_start == NULL || b->tile_start == NULL || b->near_start == NULL ||
        b->near_scale_start == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "model: no memory for the tables of its rows");
    }
    status = invert("row_order", b->row_order, row_count, b->row_place, error);
    if (status == PALPATE_OK) {
        status = invert("column_order", b->column_order, column_count, b->column_place, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    b->basis_start[0] = 0;
    b->tile_start[0] = 0;
    for (int32_t r = 0; r < b->cluster_count; r++) {
        int64_t ld = pal_bases_ld(b, r);
        b->basis_start[r + 1] = b->basis_start[r] + ld * pal_bases_rank(b, r);
        b->tile_start[r + 1] = b->tile_start[r] + ld;
    }
    b->near_start[0] = 0;
    b->near_scale_start[0] = 0;
    for (int32_t g = 0; g < b->group_count; g++) {
        int64_t columns = group_columns(b, g);
        for (int32_t k = b->group_start[g]; k < b->group_start[g + 1]; k++) {
            b->column_group[b->column_order[k]] = g;
        }
        for (int32_t p = b->pair_start[g]; p < b->pair_start[g + 1]; p++) {
            b->near_start[p + 1] = b->near_start[p] + columns * pal_bases_ld(b, b->pair_cluster[p]);
            b->near_scale_start[p + 1] = b->near_scale_start[p] + columns;
        }
    }
    return PALPATE_OK;
}

/// Are the derived tables those of the stored ones?
static int derived_fits(const pal_row_bases *b, int32_t row_count) {
    int same = b->basis_start[0] == 0 && b->tile_start[0] == 0 && b->near_start[0] == 0 &&
               b->near_scale_start[0] == 0;
    for (int32_t i = 0; same && i < row_count; i++) {
        int32_t row = b->row_order[i];
        same = row >= 0 && row < row_count && b->row_place[row] == i;
    }
    for (int32_t r = 0; same && r < b->cluster_count; r++) {
        int64_t ld = pal_bases_ld(b, r);
        same = b->basis_start[r + 1] == b->basis_start[r] + ld * pal_bases_rank(b, r) &&
               b->tile_start[r + 1] == b->tile_start[r] + ld;
    }
    for (int32_t g = 0; same && g < b->group_count; g++) {
        int64_t columns = group_columns(b, g);
        for (int32_t k = b->group_start[g]; same && k < b->group_start[g + 1]; k++) {
            int32_t column = b->column_order[k];
            same = column >= 0 && column < b->group_start[b->group_count] &&
                   b->column_place[column] == k && b->column_group[column] == g;
        }
        for (int32_t p = b->pair_start[g]; same && p < b->pair_start[g + 1]; p++) {
            same = b->near_start[p + 1] ==
                       b->near_start[p] + columns * pal_bases_ld(b, b->pair_cluster[p]) &&
                   b->near_scale_start[p + 1] == b->near_scale_start[p] + columns;
        }
    }
    return same;
}

/// `count` 16-bit integers, whole lines, zeroed.
static int16_t *integers(int64_t count) {
    size_t bytes = ((size_t)count * sizeof(int16_t) + 64) / 64 * 64;
    int16_t *data = bytes <= PTRDIFF_MAX ? aligned_alloc(64, bytes) : NULL;
    if (data != NULL) {
        memset(data, 0, bytes);
    }
    return data;
}

pal_status pal_row_bases_alloc(pal_row_bases *b, pal_error *error) {
    b->basis = integers(b->basis_start[b->cluster_count]);
    b->near = integers(b->near_start[b->pair_count]);
    b->basis_scale = calloc((size_t)b->rank + 1, sizeof *b->basis_scale);
    b->near_scale = calloc((size_t)b->near_scale_start[b->pair_count] + 1, sizeof *b->near_scale);
    if (b->basis == NULL || b->near == NULL || b->basis_scale == NULL || b->near_scale == NULL) {
        return pal_fail(
            error, PALPATE_ERROR_MEMORY, "model: no memory for %.3g MB of compressed rows",
            2e-6 * (double)(b->basis_start[b->cluster_count] + b->near_start[b->pair_count]));
    }
    return PALPATE_OK;
}

static pal_status check_scales(const char *name, const float *scale, int64_t count,
                               pal_error *error) {
    if (scale == NULL) {
        return BAD("%s is missing", name);
    }
    for (int64_t i = 0; i < count; i++) {
        if (!isfinite(scale[i])) {
            return BAD("%s[%lld] is %g", name, (long long)i, (double)scale[i]);
        }
    }
    return PALPATE_OK;
}

pal_status pal_row_bases_check(const pal_row_bases *b, int32_t row_count, int32_t column_count,
                               pal_error *error) {
    if (b->basis_start == NULL || b->near_start == NULL || b->near_scale_start == NULL ||
        b->tile_start == NULL || b->row_place == NULL || b->column_place == NULL ||
        b->column_group == NULL || b->basis == NULL || b->near == NULL || b->row_order == NULL ||
        b->column_order == NULL) {
        return BAD("a table is missing");
    }
    pal_status status = check_structure(b, row_count, column_count, error);
    if (status == PALPATE_OK && !derived_fits(b, row_count)) {
        status = BAD("the derived tables do not fit the stored ones");
    }
    if (status == PALPATE_OK) {
        status = check_scales("basis_scale", b->basis_scale, b->rank, error);
    }
    return status == PALPATE_OK ? check_scales("near_scale", b->near_scale,
                                               b->near_scale_start[b->pair_count], error)
                                : status;
}

uint64_t pal_row_bases_bytes(const pal_row_bases *b) {
    return 2 * (uint64_t)(b->basis_start[b->cluster_count] + b->near_start[b->pair_count]) +
           4 * ((uint64_t)b->rank + (uint64_t)b->near_scale_start[b->pair_count]);
}

void pal_row_bases_column(const pal_row_bases *b, int64_t dof, const int16_t *s, double s_unit,
                          double *column) {
    int32_t node = (int32_t)(dof / 3), group = b->column_group[node];
    int64_t local = 3 * (int64_t)(b->column_place[node] - b->group_start[group]) + dof % 3;
    int32_t pair = b->pair_start[group], pairs = b->pair_start[group + 1];
    for (int32_t r = 0; r < b->cluster_count; r++) {
        int64_t ld = pal_bases_ld(b, r);
        int32_t first = b->cluster_start[r], nodes = b->cluster_start[r + 1] - first;
        const int16_t *u = b->basis + b->basis_start[r];
        const int16_t *d = NULL;
        double d_unit = 0;
        if (pair < pairs && b->pair_cluster[pair] == r) {
            d = b->near + b->near_start[pair] + local * ld;
            d_unit = (double)b->near_scale[b->near_scale_start[pair] + local];
            pair++;
        }
        for (int32_t i = 0; i < 3 * nodes; i++) {
            double sum = d != NULL ? d_unit * d[i] : 0;
            for (int32_t k = 0; k < pal_bases_rank(b, r); k++) {
                int32_t at = b->rank_start[r] + k;
                sum += s_unit * s[at] * ((double)b->basis_scale[at] * u[k * ld + i]);
            }
            column[3 * (int64_t)b->row_order[first + i / 3] + i % 3] = sum;
        }
    }
}
