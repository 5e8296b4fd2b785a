/// @file sparse.c  Compressed-column sparse matrices from triplets.
///
/// Compression is two stable counting sorts, first by row, then by column, so that each column's
/// rows ascend and duplicates stay in the order they were added; they are then summed in that
/// order. No comparison sort, so the result depends on nothing but the triplets. O(nonzeros + rows
/// + columns). Thread: functions are reentrant; a list belongs to one thread at a time.
#include "src/discretization/sparse.h"

#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

/// Double a list's capacity; the three arrays grow one after the other, so that a failure between
/// them leaves every array at least as long as `capacity` says.
static pal_status triplets_grow(pal_triplets *t) {
    int64_t capacity = t->capacity > 0 ? 2 * t->capacity : 1024;
    int32_t *row = realloc(t->row, (size_t)capacity * sizeof *row);
    if (row == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    t->row = row;
    int32_t *column = realloc(t->column, (size_t)capacity * sizeof *column);
    if (column == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    t->column = column;
    double *value = realloc(t->value, (size_t)capacity * sizeof *value);
    if (value == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    t->value = value;
    t->capacity = capacity;
    return PALPATE_OK;
}

pal_status pal_triplets_add(pal_triplets *t, int32_t row, int32_t column, double value) {
    if (t->count == t->capacity) {
        pal_status status = triplets_grow(t);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    t->row[t->count] = row;
    t->column[t->count] = column;
    t->value[t->count] = value;
    t->count++;
    return PALPATE_OK;
}

void pal_triplets_clear(pal_triplets *t) {
    free(t->row);
    free(t->column);
    free(t->value);
    memset(t, 0, sizeof *t);
}

/// start[i] = number of keys below i, for i in [0, n]; start has n + 1 elements.
static void count_starts(const int32_t *key, int64_t count, int64_t n, int64_t *start) {
    memset(start, 0, (size_t)(n + 1) * sizeof *start);
    for (int64_t k = 0; k < count; k++) {
        start[key[k] + 1]++;
    }
    for (int64_t i = 0; i < n; i++) {
        start[i + 1] += start[i];
    }
}

/// Sum equal rows of each column in place; the columns' starts move up.
static void sum_duplicates(pal_sparse *a) {
    int64_t out = 0;
    int64_t begin = 0;
    for (int64_t c = 0; c < a->columns; c++) {
        int64_t end = a->start[c + 1];
        int64_t first = out;
        for (int64_t k = begin; k < end; k++) {
            if (out > first && a->row[out - 1] == a->row[k]) {
                a->value[out - 1] += a->value[k];
            } else {
                // NOLINTNEXTLINE(*.uninitialized.Assign): the caller set every entry
                a->row[out] = a->row[k];
                // NOLINTNEXTLINE(*.uninitialized.Assign): the same
                a->value[out] = a->value[k];
                out++;
            }
        }
        begin = end;
        a->start[c + 1] = out;
    }
}

pal_status pal_sparse_from_triplets(const pal_triplets *t, int64_t rows, int64_t columns,
                                    pal_sparse *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    if (rows < 0 || columns < 0 || rows > INT32_MAX || columns > INT32_MAX) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "sparse matrix: %lld x %lld is not a size below 2^31", (long long)rows,
                        (long long)columns);
    }
    for (int64_t k = 0; k < t->count; k++) {
        if (t->row[k] < 0 || t->row[k] >= rows || t->column[k] < 0 || t->column[k] >= columns) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "sparse matrix: entry %lld at (%d, %d) is outside %lld x %lld",
                            (long long)k, t->row[k], t->column[k], (long long)rows,
                            (long long)columns);
        }
    }
    size_t n = (size_t)(t->count > 0 ? t->count : 1);
    size_t most = (size_t)(rows > columns ? rows : columns) + 1;
    int64_t *cursor = malloc(most * sizeof *cursor);
    int64_t *by_row = malloc(n * sizeof *by_row);
    out->start = malloc((size_t)(columns + 1) * sizeof *out->start);
    out->row = malloc(n * sizeof *out->row);
    out->value = malloc(n * sizeof *out->value);
    if (cursor == NULL || by_row == NULL || out->start == NULL || out->row == NULL ||
        out->value == NULL) {
        free(cursor);
        free(by_row);
        pal_sparse_clear(out);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "sparse matrix: no memory for %lld entries",
                        (long long)t->count);
    }
    out->rows = rows;
    out->columns = columns;

    count_starts(t->row, t->count, rows, cursor);
    for (int64_t k = 0; k < t->count; k++) {
        by_row[cursor[t->row[k]]++] = k;
    }
    count_starts(t->column, t->count, columns, out->start);
    memcpy(cursor, out->start, (size_t)columns * sizeof *cursor);
    for (int64_t i = 0; i < t->count; i++) {
        // NOLINTNEXTLINE(*.uninitialized.Assign): a permutation, all of it set above
        int64_t k = by_row[i];
        int64_t at = cursor[t->column[k]]++;
        out->row[at] = t->row[k];
        out->value[at] = t->value[k];
    }
    free(cursor);
    free(by_row);
    sum_duplicates(out);
    return PALPATE_OK;
}

void pal_sparse_clear(pal_sparse *a) {
    free(a->start);
    free(a->row);
    free(a->value);
    memset(a, 0, sizeof *a);
}

void pal_sparse_multiply(const pal_sparse *a, double alpha, const double *x, double *y) {
    for (int64_t c = 0; c < a->columns; c++) {
        double ax = alpha * x[c];
        for (int64_t k = a->start[c]; k < a->start[c + 1]; k++) {
            y[a->row[k]] += a->value[k] * ax;
        }
    }
}
