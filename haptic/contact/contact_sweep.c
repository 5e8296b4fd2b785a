/// @file contact_sweep.c  Weighted sums of columns in tiles of rows held in registers.
///
/// Columns are padded to 64 bytes (working_set.h), so whole tiles may be read; what they hold
/// behind the last node is not used.
#include "haptic/contact/contact_sweep.h"

#include "haptic/base/wide.h"

enum { NODES = 64, ROW = 8, AXES = 4 }; // vectors in registers

/// sum += a * the four numbers at p
#define ADD(sum, a, p)                                                                             \
    do {                                                                                           \
        pal_lanes v_;                                                                              \
        PALPATE_LOAD(v_, p);                                                                       \
        (sum) += (a)*v_;                                                                           \
    } while (0)

/// The first column of a node and what each of its three counts.
typedef struct term {
    const double *column;
    double a[3];
} term;

/// Rows i .. of y: `vectors` x PALPATE_LANES of them.
PALPATE_INLINE void row_tile(const int vectors, const term *terms, int32_t count, size_t ld,
                             size_t i, double *y) {
    pal_lanes sum[ROW];
    PALPATE_UNROLL
    for (int h = 0; h < vectors; h++) {
        sum[h] = PALPATE_FILL(0.0);
    }
    for (int32_t k = 0; k < count; k++) {
        const double *c = terms[k].column + i;
        const pal_lanes a = PALPATE_FILL(terms[k].a[0]), b = PALPATE_FILL(terms[k].a[1]),
                        d = PALPATE_FILL(terms[k].a[2]);
        PALPATE_UNROLL
        for (int h = 0; h < vectors; h++) {
            ADD(sum[h], a, c + PALPATE_LANES * h);
            ADD(sum[h], b, c + ld + PALPATE_LANES * h);
            ADD(sum[h], d, c + 2 * ld + PALPATE_LANES * h);
        }
    }
    PALPATE_UNROLL
    for (int h = 0; h < vectors; h++) {
        PALPATE_STORE(y + i + PALPATE_LANES * h, sum[h]);
    }
}

PALPATE_INLINE void row_tiles(const pal_working_set *set, int32_t count, const int32_t *slot,
                              const double *phi, const double along[3], double *y) {
    size_t n = 3 * (size_t)set->count, ld = (size_t)set->stride, i = 0;
    term terms[NODES];
    count = count < NODES ? count : NODES;
    for (int32_t k = 0; k < count; k++) {
        terms[k].column = set->block + 3 * (size_t)slot[k] * ld;
        for (int c = 0; c < 3; c++) {
            terms[k].a[c] = phi[k] * along[c];
        }
    }
    for (; i + PALPATE_LANES * ROW <= n; i += PALPATE_LANES * ROW) {
        row_tile(ROW, terms, count, ld, i, y);
    }
    for (; i < n; i += PALPATE_LANES * 2) {
        row_tile(2, terms, count, ld, i, y);
    }
}

PALPATE_INLINE void axes_tile(const int vectors, const term *terms, int32_t count, size_t ld,
                              size_t i, double *y, size_t to) {
    pal_lanes sum[3][AXES];
    PALPATE_UNROLL
    for (int h = 0; h < vectors; h++) {
        sum[0][h] = sum[1][h] = sum[2][h] = PALPATE_FILL(0.0);
    }
    for (int32_t k = 0; k < count; k++) {
        const double *c = terms[k].column + i;
        const pal_lanes a = PALPATE_FILL(terms[k].a[0]);
        PALPATE_UNROLL
        for (size_t b = 0; b < 3; b++) {
            PALPATE_UNROLL
            for (int h = 0; h < vectors; h++) {
                ADD(sum[b][h], a, c + b * ld + PALPATE_LANES * h);
            }
        }
    }
    PALPATE_UNROLL
    for (size_t b = 0; b < 3; b++) {
        PALPATE_UNROLL
        for (int h = 0; h < vectors; h++) {
            PALPATE_STORE(y + b * to + i + PALPATE_LANES * h, sum[b][h]);
        }
    }
}

PALPATE_INLINE void axes_tiles(const pal_working_set *set, int32_t count, const int32_t *slot,
                               const double *phi, double *y, size_t to) {
    size_t n = 3 * (size_t)set->count, ld = (size_t)set->stride, i = 0;
    term terms[NODES];
    count = count < NODES ? count : NODES;
    for (int32_t k = 0; k < count; k++) {
        terms[k].column = set->block + 3 * (size_t)slot[k] * ld;
        terms[k].a[0] = phi[k];
    }
    for (; i + PALPATE_LANES * AXES <= n; i += PALPATE_LANES * AXES) {
        axes_tile(AXES, terms, count, ld, i, y, to);
    }
    for (; i < n; i += PALPATE_LANES * 2) {
        axes_tile(2, terms, count, ld, i, y, to);
    }
}

PALPATE_AVX2 static void row_avx2(const pal_working_set *set, int32_t count, const int32_t *slot,
                                  const double *phi, const double along[3], double *y) {
    row_tiles(set, count, slot, phi, along, y);
}
PALPATE_AVX2 static void axes_avx2(const pal_working_set *set, int32_t count, const int32_t *slot,
                                   const double *phi, double *y, size_t to) {
    axes_tiles(set, count, slot, phi, y, to);
}

void pal_sweep_row(const pal_working_set *set, int32_t count, const int32_t *slot,
                   const double *phi, const double along[3], double *y) {
    if (pal_have_avx2()) {
        row_avx2(set, count, slot, phi, along, y);
    } else {
        row_tiles(set, count, slot, phi, along, y);
    }
}

void pal_sweep_axes(const pal_working_set *set, int32_t count, const int32_t *slot,
                    const double *phi, double *y, size_t ld) {
    if (pal_have_avx2()) {
        axes_avx2(set, count, slot, phi, y, ld);
    } else {
        axes_tiles(set, count, slot, phi, y, ld);
    }
}
