/// @file sparse.h  Compressed-column sparse matrices, built from triplets by counting.
#ifndef PALPATE_SRC_SPARSE_H
#define PALPATE_SRC_SPARSE_H

#include <stdint.h>

#include <palpate/status.h>

/// Compressed columns; row indices ascending and unique in each column.
typedef struct pal_sparse {
    int64_t rows, columns;
    int64_t *start; ///< (columns + 1)
    int64_t *row;   ///< (start[columns])
    double *value;  ///< (start[columns])
} pal_sparse;

/// A growing list of triplets; duplicates are added up by pal_sparse_from_triplets.
typedef struct pal_triplets {
    int64_t count, capacity;
    int32_t *row, *column;
    double *value;
} pal_triplets;

/// @return 0, or PALPATE_ERROR_MEMORY (the list is unchanged)
pal_status pal_triplets_add(pal_triplets *t, int32_t row, int32_t column, double value);
void pal_triplets_clear(pal_triplets *t);

/// Compress, adding duplicates up in the order they were added (deterministic).
pal_status pal_sparse_from_triplets(const pal_triplets *t, int64_t rows, int64_t columns,
                                    pal_sparse *out, pal_error *error);
void pal_sparse_clear(pal_sparse *a);

/// y = y + alpha A x;  x (columns), y (rows).
void pal_sparse_multiply(const pal_sparse *a, double alpha, const double *x, double *y);

#endif
