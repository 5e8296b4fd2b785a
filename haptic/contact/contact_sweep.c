/// @file contact_sweep.c  Weighted sums of columns in tiles of rows held in registers.
///
/// Columns are padded to 64 bytes (working_set.h), so whole tiles may be read; what they hold
/// behind the last node is not used.
#include "haptic/contact/contact_sweep.h"

#include <string.h>

typedef double lanes __attribute__((vector_size(32)));

enum { TILE = 8 };

#define INLINE static inline __attribute__((always_inline))

/// sum += a * the four numbers at p (vectors are not passed by value: their ABI depends on the
/// target)
#define ADD(sum, a, p)                                                                             \
    do {                                                                                           \
        lanes v_;                                                                                  \
        memcpy(&v_, p, sizeof v_);                                                                 \
        (sum) += (a)*v_;                                                                           \
    } while (0)

INLINE void row_tiles(const pal_working_set *set, int32_t count, const int32_t *slot,
                      const double *phi, const double along[3], double *y) {
    size_t n = 3 * (size_t)set->count, ld = (size_t)set->stride;
    for (size_t i = 0; i < n; i += TILE) {
        lanes low = {0.0, 0.0, 0.0, 0.0}, high = {0.0, 0.0, 0.0, 0.0};
        for (int32_t k = 0; k < count; k++) {
            const double *c = set->block + 3 * (size_t)slot[k] * ld + i;
            double s = phi[k] * along[0], t = phi[k] * along[1], u = phi[k] * along[2];
            lanes a = {s, s, s, s}, b = {t, t, t, t}, d = {u, u, u, u};
            for (int h = 0; h < 2; h++) {
                lanes *sum = h == 0 ? &low : &high;
                ADD(*sum, a, c + 4 * h);
                ADD(*sum, b, c + ld + 4 * h);
                ADD(*sum, d, c + 2 * ld + 4 * h);
            }
        }
        memcpy(y + i, &low, sizeof low);
        memcpy(y + i + 4, &high, sizeof high);
    }
}

INLINE void axes_tiles(const pal_working_set *set, int32_t count, const int32_t *slot,
                       const double *phi, double *y, size_t to) {
    size_t n = 3 * (size_t)set->count, ld = (size_t)set->stride;
    for (size_t i = 0; i < n; i += TILE) {
        lanes sum[3][2];
        memset(sum, 0, sizeof sum);
        for (int32_t k = 0; k < count; k++) {
            const double *c = set->block + 3 * (size_t)slot[k] * ld + i;
            lanes a = {phi[k], phi[k], phi[k], phi[k]};
            for (size_t b = 0; b < 3; b++) {
                ADD(sum[b][0], a, c + b * ld);
                ADD(sum[b][1], a, c + b * ld + 4);
            }
        }
        for (size_t b = 0; b < 3; b++) {
            memcpy(y + b * to + i, sum[b], sizeof sum[b]);
        }
    }
}

#if defined __x86_64__
#define AVX2 __attribute__((target("avx2")))
AVX2 static void row_avx2(const pal_working_set *set, int32_t count, const int32_t *slot,
                          const double *phi, const double along[3], double *y) {
    row_tiles(set, count, slot, phi, along, y);
}
AVX2 static void axes_avx2(const pal_working_set *set, int32_t count, const int32_t *slot,
                           const double *phi, double *y, size_t to) {
    axes_tiles(set, count, slot, phi, y, to);
}
static int have_avx2(void) {
    return __builtin_cpu_supports("avx2");
}
#else
#define row_avx2 row_tiles
#define axes_avx2 axes_tiles
static int have_avx2(void) {
    return 0;
}
#endif

void pal_sweep_row(const pal_working_set *set, int32_t count, const int32_t *slot,
                   const double *phi, const double along[3], double *y) {
    if (have_avx2()) {
        row_avx2(set, count, slot, phi, along, y);
    } else {
        row_tiles(set, count, slot, phi, along, y);
    }
}

void pal_sweep_axes(const pal_working_set *set, int32_t count, const int32_t *slot,
                    const double *phi, double *y, size_t ld) {
    if (have_avx2()) {
        axes_avx2(set, count, slot, phi, y, ld);
    } else {
        axes_tiles(set, count, slot, phi, y, ld);
    }
}
