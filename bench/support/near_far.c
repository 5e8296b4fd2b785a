/// @file near_far.c  Far rows in 8 bits, near ones in 16 (see near_far.h).
#include "bench/support/near_far.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#if defined(__x86_64__)
#include <immintrin.h>
#endif

#include "haptic/engine/field.h"
#include "src/store/row_clusters.h"

enum { GROUP_NODES = 32, GROUP_ROWS = 3 * GROUP_NODES, LANES = 16 };

void near_far_clear(near_far *x) {
    free(x->order);
    free(x->start);
    free(x->at);
    free(x->unit);
    free(x->data);
    *x = (near_far){0};
}

int near_far_make(const pal_model *m, double tolerance, near_far *x) {
    size_t rows = (size_t)m->info.row_count, columns = 3 * (size_t)m->info.column_count;
    double *column = malloc(3 * rows * sizeof *column);
    *x = (near_far){.order = malloc(rows * sizeof *x->order),
                    .start = malloc((rows + 1) * sizeof *x->start)};
    if (column == NULL || x->order == NULL || x->start == NULL) {
        free(column);
        return 0;
    }
    for (size_t i = 0; i < rows; i++) {
        x->order[i] = (int32_t)i;
    }
    x->groups = pal_cluster_split(m->position, m->row_node, m->info.row_count, GROUP_NODES,
                                  x->order, x->start);
    size_t pieces = x->groups > 0 ? (size_t)x->groups * columns : 1;
    x->at = malloc(pieces * sizeof *x->at);
    x->unit = malloc(pieces * sizeof *x->unit);
    x->data =
        aligned_alloc(64, (columns * (2 * 3 * rows + 128 * (size_t)x->groups) + 64) / 64 * 64);
    int made = x->groups > 0 && x->at != NULL && x->unit != NULL && x->data != NULL;
    size_t end = 0;
    for (size_t j = 0; made && j < columns; j++) {
        (void)pal_model_load_column(m, (int64_t)j, column);
        double size = 0;
        for (size_t i = 0; i < rows; i++) {
            const double *u = column + 3 * i;
            size = fmax(size, sqrt(u[0] * u[0] + u[1] * u[1] + u[2] * u[2]));
        }
        for (int32_t g = 0; g < x->groups; g++) {
            int32_t count = 3 * (x->start[g + 1] - x->start[g]), padded = (count + 15) / 16 * 16;
            double piece[GROUP_ROWS + LANES] = {0}, most = 0;
            for (int32_t i = 0; i < count; i++) {
                piece[i] = column[3 * x->order[x->start[g] + i / 3] + i % 3];
                most = fmax(most, fabs(piece[i]));
            }
            int wide = sqrt(3) * 0.5 * most / 127 > tolerance * size;
            double unit = most > 0 ? most / (wide ? PALPATE_SCALED_MAX : 127) : 1;
            size_t k = j * (size_t)x->groups + (size_t)g;
            x->at[k] = (int64_t)end + wide;
            x->unit[k] = (float)unit;
            for (int32_t i = 0; i < padded; i++) {
                double q = nearbyint(piece[i] / unit);
                if (wide) {
                    ((int16_t *)(void *)(x->data + end))[i] = (int16_t)q;
                } else {
                    ((int8_t *)(x->data + end))[i] = (int8_t)q;
                }
            }
            end += (size_t)padded * (wide ? 2 : 1);
        }
    }
    x->bytes = end + pieces * (sizeof(int32_t) + sizeof *x->unit); // 32-bit places would do
    free(column);
    return made;
}

#if defined(__x86_64__)
#define WIDE_TARGET __attribute__((target("avx512f")))
#define LOAD_BYTES(p) _mm512_cvtepi8_epi32(_mm_loadu_si128((const __m128i *)(const void *)(p)))
#define LOAD_SHORTS(p) _mm512_cvtepi16_epi32(_mm256_loadu_si256((const __m256i *)(const void *)(p)))
#define FUSE(f, c, a) ((a) = _mm512_fmadd_ps((f), _mm512_cvtepi32_ps(c), (a)))

/// One group of rows, VECTORS vectors of the sum in registers over all columns.
#define GROUP(VECTORS)                                                                             \
    WIDE_TARGET static void group_##VECTORS(const near_far *x, int32_t g, int32_t count,           \
                                            const int32_t *dof, const double *f, float *tile) {    \
        __m512 sum[VECTORS];                                                                       \
        for (int v = 0; v < (VECTORS); v++) {                                                      \
            sum[v] = _mm512_setzero_ps();                                                          \
        }                                                                                          \
        for (int32_t k = 0; k < count; k++) {                                                      \
            size_t piece = (size_t)dof[k] * (size_t)x->groups + (size_t)g;                         \
            const unsigned char *at = x->data + (x->at[piece] & ~(int64_t)1);                      \
            __m512 factor = _mm512_set1_ps((float)f[k] * x->unit[piece]);                          \
            if (x->at[piece] & 1) {                                                                \
                _Pragma("GCC unroll 6") for (int v = 0; v < (VECTORS); v++) {                      \
                    FUSE(factor, LOAD_SHORTS(at + 2 * LANES * v), sum[v]);                         \
                }                                                                                  \
            } else {                                                                               \
                _Pragma("GCC unroll 6") for (int v = 0; v < (VECTORS); v++) {                      \
                    FUSE(factor, LOAD_BYTES(at + LANES * v), sum[v]);                              \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
        for (int v = 0; v < (VECTORS); v++) {                                                      \
            _mm512_storeu_ps(tile + LANES * v, sum[v]);                                            \
        }                                                                                          \
    }
GROUP(1)
GROUP(2)
GROUP(3)
GROUP(4)
GROUP(5)
GROUP(6)
#endif

int near_far_available(void) {
    return pal_field_best() == PALPATE_ISA_AVX512;
}

void near_far_field(const near_far *x, int32_t count, const int32_t *dof, const double *f,
                    float *out) {
#if defined(__x86_64__)
    static void (*const group[])(const near_far *, int32_t, int32_t, const int32_t *,
                                 const double *,
                                 float *) = {group_1, group_2, group_3, group_4, group_5, group_6};
    for (int32_t g = 0; g < x->groups; g++) {
        int32_t nodes = x->start[g + 1] - x->start[g];
        float tile[GROUP_ROWS + LANES];
        group[(3 * nodes - 1) / LANES](x, g, count, dof, f, tile);
        for (int32_t i = 0; i < nodes; i++) {
            memcpy(out + 3 * x->order[x->start[g] + i], tile + 3 * i, 3 * sizeof *tile);
        }
    }
#else
    (void)x, (void)count, (void)dof, (void)f, (void)out;
#endif
}
