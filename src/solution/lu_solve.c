/// @file lu_solve.c  Block triangular solves over extracted sparse LU factors.
///
/// A sparse triangular solve with one right-hand side does two flops per factor entry and waits for
/// memory. Here 32 right-hand sides lie side by side (work[row][32]), so each entry read from
/// memory serves 32 of them; and consecutive columns of L (rows of U) of one elimination front,
/// which have nearly the same pattern, are gathered into panels of up to 8 (zeros fill the
/// differences), so that each row of the work array is read and written once per 8 entries instead
/// of once per entry. Forward L: a panel's 8 pivots stay in registers and are scattered down.
/// Backward U: 8 sums stay in registers and rows of the solution are gathered.
///
/// Panels of L whose rows are still zero are skipped, tile by tile (a unit nodal force excites
/// nothing before its own pivot); panels of U that no wanted unknown depends on are skipped too.
///
/// The arithmetic is the same in every instruction-set variant: one product, one subtraction per
/// entry, in the same order for each unknown, never fused; so results do not depend on the CPU.
#include "src/solution/lu_solve.h"

#include <stdlib.h>
#include <string.h>

enum { B = PALPATE_LU_BLOCK, W = PALPATE_LU_WIDTH };

static void clear_panels(pal_lu_panels *p) {
    free(p->first);
    free(p->index_start);
    free(p->value_start);
    free(p->index);
    free(p->value);
    memset(p, 0, sizeof *p);
}

void pal_lu_clear(pal_lu *lu) {
    clear_panels(&lu->lower);
    clear_panels(&lu->upper);
    free(lu->diagonal);
    free(lu->row_order);
    free(lu->column_order);
    free(lu->row_scale);
    free(lu->needed);
    memset(lu, 0, sizeof *lu);
}

static uint64_t panel_bytes(const pal_lu_panels *p) {
    return p->count == 0 ? 0
                         : sizeof(double) * (uint64_t)p->value_start[p->count] +
                               sizeof(int32_t) * (uint64_t)p->index_start[p->count] +
                               20u * (uint64_t)p->count;
}

uint64_t pal_lu_bytes(const pal_lu *lu) {
    return panel_bytes(&lu->lower) + panel_bytes(&lu->upper) + 24u * (uint64_t)lu->n;
}

// ---- Panels -------------------------------------------------------------------------------------

/// Union of two ascending lists without numbers below `from`. @return its length
static int64_t merge(const int32_t *a, int64_t na, const int32_t *b, int64_t nb, int32_t from,
                     int32_t *out) {
    int64_t i = 0, j = 0, count = 0;
    while (i < na || j < nb) {
        int32_t next;
        if (j >= nb || (i < na && a[i] < b[j])) {
            next = a[i++];
        } else {
            i += i < na && a[i] == b[j];
            next = b[j++];
        }
        if (next >= from) {
            out[count++] = next;
        }
    }
    return count;
}

/// Width of the panel that starts at column k, and its list. One more column joins while zeros stay
/// below a fifth of what is stored: a padded entry costs flops, a missing member traffic.
static int32_t grow(int32_t n, int32_t k, const int64_t *start, const int32_t *index, int32_t *list,
                    int32_t *other, int64_t *length) {
    int32_t width = 1;
    int64_t held = start[k + 1] - start[k], count = held;
    memcpy(list, index + start[k], (size_t)count * sizeof *list);
    while (width < W && k + width < n) {
        int32_t j = k + width;
        int64_t add = start[j + 1] - start[j];
        int64_t joined = merge(list, count, index + start[j], add, j + 1, other);
        if (4 * (joined * (width + 1)) > 5 * (held + add) + 16) {
            break;
        }
        memcpy(list, other, (size_t)joined * sizeof *list);
        held += add;
        count = joined;
        width++;
    }
    *length = count;
    return width;
}

/// Put column k + member of a panel (list of `length` numbers) into its values.
static void fill(int32_t k, int32_t member, int32_t width, const int64_t *start,
                 const int32_t *index, const double *value, const int32_t *list, int64_t length,
                 int by_row, double *out) {
    double *triangle = out, *body = out + width * width;
    int64_t at = 0;
    int32_t j = k + member;
    for (int64_t e = start[j]; e < start[j + 1]; e++) {
        if (index[e] < k + width) {
            int32_t other = index[e] - k;
            triangle[by_row ? member * width + other : other * width + member] = value[e];
            continue;
        }
        while (at < length && list[at] < index[e]) {
            at++;
        }
        body[at * width + member] = value[e];
    }
}

int pal_lu_panels_make(int32_t n, const int64_t *start, const int32_t *index, const double *value,
                       int by_row, pal_lu_panels *p) {
    size_t size = (size_t)n + 1;
    int32_t *list = malloc(size * sizeof *list), *other = malloc(size * sizeof *other);
    memset(p, 0, sizeof *p);
    p->first = malloc(size * sizeof *p->first);
    p->index_start = malloc(size * sizeof *p->index_start);
    p->value_start = malloc(size * sizeof *p->value_start);
    int failed = !list || !other || !p->first || !p->index_start || !p->value_start;
    if (!failed) { // shape
        int64_t indices = 0, values = 0, length;
        for (int32_t k = 0; k < n; k = p->first[p->count]) {
            int32_t width = grow(n, k, start, index, list, other, &length);
            p->first[p->count] = k;
            p->index_start[p->count] = indices;
            p->value_start[p->count] = values;
            indices += length;
            values += width * (width + length);
            p->first[++p->count] = k + width;
            p->index_start[p->count] = indices;
            p->value_start[p->count] = values;
        }
        p->index = malloc(((size_t)indices + 1) * sizeof *p->index);
        p->value = calloc((size_t)values + 1, sizeof *p->value);
        failed = !p->index || !p->value;
    }
    for (int32_t q = 0; !failed && q < p->count; q++) {
        // NOLINTNEXTLINE(*.uninitialized.Assign): the loop above set first[0 .. count]
        int32_t k = p->first[q], width = p->first[q + 1] - k;
        int32_t *to = p->index + p->index_start[q];
        int64_t length = 0;
        for (int32_t m = 0; m < width; m++) {
            length = merge(list, length, index + start[k + m], start[k + m + 1] - start[k + m],
                           k + width, other);
            memcpy(list, other, (size_t)length * sizeof *list);
        }
        memcpy(to, list, (size_t)length * sizeof *to);
        for (int32_t m = 0; m < width; m++) {
            fill(k, m, width, start, index, value, to, length, by_row,
                 p->value + p->value_start[q]);
        }
    }
    free(list);
    free(other);
    if (failed) {
        clear_panels(p);
        return -1;
    }
    return 0;
}

// ---- Kernels ------------------------------------------------------------------------------------

/// The sweeps for one vector width. A tile is two vectors of right-hand sides; the panel is applied
/// to one tile after the other while its values are in the nearest cache.
#define LU_SWEEP(suffix, BYTES, ATTRIBUTE)                                                         \
    typedef double wide_##suffix __attribute__((vector_size(BYTES), may_alias));                   \
    enum { TILE_##suffix = 2 * (BYTES) / 8 };                                                      \
    ATTRIBUTE static inline __attribute__((always_inline)) void lower_##suffix(                    \
        const int width, int64_t length, const int32_t *row, const double *value, double *pivot,   \
        double *w) {                                                                               \
        wide_##suffix p[W][2];                                                                     \
        const double *body = value + width * width;                                                \
        int any = 0;                                                                               \
        for (int i = 0; i < width * B; i += B) {                                                   \
            for (int c = 0; c < TILE_##suffix; c++) {                                              \
                any |= pivot[i + c] != 0.0;                                                        \
            }                                                                                      \
        }                                                                                          \
        if (!any) {                                                                                \
            return;                                                                                \
        }                                                                                          \
        _Pragma("GCC unroll 8") for (int i = 0; i < width; i++) {                                  \
            wide_##suffix *at = (wide_##suffix *)(void *)(pivot + i * B);                          \
            p[i][0] = at[0];                                                                       \
            p[i][1] = at[1];                                                                       \
            _Pragma("GCC unroll 8") for (int j = 0; j < i; j++) {                                  \
                p[i][0] -= value[i * width + j] * p[j][0];                                         \
                p[i][1] -= value[i * width + j] * p[j][1];                                         \
            }                                                                                      \
            at[0] = p[i][0];                                                                       \
            at[1] = p[i][1];                                                                       \
        }                                                                                          \
        for (int64_t e = 0; e < length; e++) {                                                     \
            wide_##suffix *at = (wide_##suffix *)(void *)(w + (int64_t)row[e] * B);                \
            wide_##suffix a = at[0], b = at[1];                                                    \
            _Pragma("GCC unroll 8") for (int j = 0; j < width; j++) {                              \
                a -= body[e * width + j] * p[j][0];                                                \
                b -= body[e * width + j] * p[j][1];                                                \
            }                                                                                      \
            at[0] = a;                                                                             \
            at[1] = b;                                                                             \
        }                                                                                          \
    }                                                                                              \
    ATTRIBUTE static inline __attribute__((always_inline)) void upper_##suffix(                    \
        const int width, int64_t length, const int32_t *column, const double *value,               \
        const double *diagonal, double *top, const double *w) {                                    \
        wide_##suffix p[W][2];                                                                     \
        const double *body = value + width * width;                                                \
        _Pragma("GCC unroll 8") for (int i = 0; i < width; i++) {                                  \
            const wide_##suffix *at = (const wide_##suffix *)(const void *)(top + i * B);          \
            p[i][0] = at[0];                                                                       \
            p[i][1] = at[1];                                                                       \
        }                                                                                          \
        for (int64_t e = length - 1; e >= 0; e--) {                                                \
            const wide_##suffix *at =                                                              \
                (const wide_##suffix *)(const void *)(w + (int64_t)column[e] * B);                 \
            wide_##suffix a = at[0], b = at[1];                                                    \
            _Pragma("GCC unroll 8") for (int i = 0; i < width; i++) {                              \
                p[i][0] -= body[e * width + i] * a;                                                \
                p[i][1] -= body[e * width + i] * b;                                                \
            }                                                                                      \
        }                                                                                          \
        _Pragma("GCC unroll 8") for (int i = width - 1; i >= 0; i--) {                             \
            wide_##suffix *at = (wide_##suffix *)(void *)(top + i * B);                            \
            p[i][0] *= diagonal[i];                                                                \
            p[i][1] *= diagonal[i];                                                                \
            at[0] = p[i][0];                                                                       \
            at[1] = p[i][1];                                                                       \
            _Pragma("GCC unroll 8") for (int j = 0; j < i; j++) {                                  \
                p[j][0] -= value[j * width + i] * p[i][0];                                         \
                p[j][1] -= value[j * width + i] * p[i][1];                                         \
            }                                                                                      \
        }                                                                                          \
    }                                                                                              \
    ATTRIBUTE static void sweep_##suffix(const pal_lu *lu, double *w) {                            \
        const pal_lu_panels *l = &lu->lower, *u = &lu->upper;                                      \
        for (int32_t q = 0; q < l->count; q++) {                                                   \
            int32_t k = l->first[q];                                                               \
            int64_t length = l->index_start[q + 1] - l->index_start[q];                            \
            const int32_t *row = l->index + l->index_start[q];                                     \
            const double *value = l->value + l->value_start[q];                                    \
            for (int c = 0; c < B; c += TILE_##suffix) {                                           \
                double *pivot = w + (int64_t)k * B + c;                                            \
                BY_WIDTH(l->first[q + 1] - k, lower_##suffix, length, row, value, pivot, w + c)    \
            }                                                                                      \
        }                                                                                          \
        for (int32_t q = u->count - 1; q >= 0; q--) {                                              \
            if (lu->needed != NULL && !lu->needed[q]) {                                            \
                continue;                                                                          \
            }                                                                                      \
            int32_t k = u->first[q];                                                               \
            int64_t length = u->index_start[q + 1] - u->index_start[q];                            \
            const int32_t *column = u->index + u->index_start[q];                                  \
            const double *value = u->value + u->value_start[q];                                    \
            for (int c = 0; c < B; c += TILE_##suffix) {                                           \
                double *top = w + (int64_t)k * B + c;                                              \
                BY_WIDTH(u->first[q + 1] - k, upper_##suffix, length, column, value,               \
                         lu->diagonal + k, top, w + c)                                             \
            }                                                                                      \
        }                                                                                          \
    }

/// One copy of the kernel per width, so that its loops unroll into registers.
#define BY_WIDTH(width, kernel, ...)                                                               \
    switch (width) {                                                                               \
    case 1:                                                                                        \
        kernel(1, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    case 2:                                                                                        \
        kernel(2, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    case 3:                                                                                        \
        kernel(3, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    case 4:                                                                                        \
        kernel(4, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    case 5:                                                                                        \
        kernel(5, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    case 6:                                                                                        \
        kernel(6, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    case 7:                                                                                        \
        kernel(7, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    default:                                                                                       \
        kernel(8, __VA_ARGS__);                                                                    \
        break;                                                                                     \
    }

LU_SWEEP(base, 16, )
#if defined(__x86_64__)
LU_SWEEP(avx2, 32, __attribute__((target("avx2"))))
#if defined(__clang__)
LU_SWEEP(avx512, 64, __attribute__((target("avx512f"))))
#else
LU_SWEEP(avx512, 64, __attribute__((target("avx512f,prefer-vector-width=512"))))
#endif
#endif

pal_lu_variant pal_lu_best_variant(void) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx512f")) {
        return PALPATE_LU_AVX512;
    }
    if (__builtin_cpu_supports("avx2")) {
        return PALPATE_LU_AVX2;
    }
#endif
    return PALPATE_LU_BASE;
}

void pal_lu_solve(const pal_lu *lu, pal_lu_variant variant, int32_t count, double *x,
                  double *work) {
    int64_t n = lu->n;
    for (int64_t k = 0; k < n; k++) {
        int64_t i = lu->row_order[k];
        double s = lu->row_scale[i];
        for (int32_t c = 0; c < B; c++) {
            work[k * B + c] = c < count ? s * x[c * n + i] : 0.0;
        }
    }
    switch (variant) {
#if defined(__x86_64__)
    case PALPATE_LU_AVX512:
        sweep_avx512(lu, work);
        break;
    case PALPATE_LU_AVX2:
        sweep_avx2(lu, work);
        break;
#endif
    default:
        sweep_base(lu, work);
    }
    for (int64_t k = 0; k < n; k++) {
        int64_t j = lu->column_order[k];
        for (int32_t c = 0; c < count; c++) {
            x[c * n + j] = work[k * B + c];
        }
    }
}

void pal_lu_mark_needed(const pal_lu *lu, const uint8_t *wanted, uint8_t *needed) {
    // x_i depends on x_j for U_ij != 0, j > i: going down the rows, a panel with a needed row needs
    // the panels of all its columns. Panel p holds the unknowns first[p] .. first[p + 1] - 1.
    const pal_lu_panels *u = &lu->upper;
    memset(needed, 0, (size_t)u->count);
    for (int32_t q = 0; q < u->count; q++) {
        for (int32_t k = u->first[q]; !needed[q] && k < u->first[q + 1]; k++) {
            needed[q] = wanted[lu->column_order[k]] != 0;
        }
        int32_t to = q;
        for (int64_t e = u->index_start[q]; needed[q] && e < u->index_start[q + 1]; e++) {
            while (u->first[to + 1] <= u->index[e]) {
                to++;
            }
            needed[to] = 1;
        }
    }
}
