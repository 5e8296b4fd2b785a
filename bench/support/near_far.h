/// @file near_far.h  Stored rows with the far ones in 8 bits: a form that bench/compress measures
/// and the library has not.
#ifndef PALPATE_BENCH_NEAR_FAR_H
#define PALPATE_BENCH_NEAR_FAR_H

#include <stddef.h>
#include <stdint.h>

#include "haptic/model/model.h"

/// Rows in groups; piece (column j, group g) is `unit` times 8- or 16-bit integers.
typedef struct near_far {
    int32_t groups;
    int32_t *order, *start; ///< rows by group
    int64_t *at;            ///< (columns x groups) byte of the piece, odd: 16 bits
    float *unit;
    unsigned char *data;
    size_t bytes;
} near_far;

/// The model's rows, 8 bits where half a step stays below tolerance times the column's largest
/// displacement. @return 0: out of memory
int near_far_make(const pal_model *m, double tolerance, near_far *x);
void near_far_clear(near_far *x);

/// 1 where there is AVX-512: the one variant written.
int near_far_available(void);

/// out (3 row_count) = the weighted sum of columns, groups of rows in registers.
void near_far_field(const near_far *x, int32_t count, const int32_t *dof, const double *f,
                    float *out);

#endif
