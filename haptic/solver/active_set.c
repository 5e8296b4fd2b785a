/// @file active_set.c  Eq. 52 on an ordered list of touched nodes, with a factor kept between
/// ticks.
#include "haptic/solver/active_set.h"

#include <string.h>

#include "haptic/base/block.h"
#include "haptic/base/dense.h"

enum { SLOTS_MAX = 512 };

static int32_t slot_count(const pal_model *model) {
    return model->info.column_count < SLOTS_MAX ? model->info.column_count : SLOTS_MAX;
}

static size_t row_bytes(int32_t capacity) {
    return pal_block_padded(3 * (size_t)capacity * sizeof(double));
}

size_t pal_active_set_bytes(const pal_model *model, int32_t capacity) {
    size_t m = (size_t)capacity, n = 3 * m, slots = (size_t)slot_count(model);
    return pal_block_padded(m * sizeof(int32_t)) + 3 * pal_block_padded(n * sizeof(double)) +
           2 * pal_block_padded(n * sizeof(int32_t)) + pal_block_padded(n * n * sizeof(double)) +
           3 * slots * row_bytes(capacity) + 2 * pal_block_padded(slots * sizeof(int32_t)) +
           pal_block_padded(slots * sizeof(uint64_t)) +
           pal_block_padded((size_t)model->info.column_count * sizeof(int32_t));
}

void pal_active_set_init(pal_active_set *set, const pal_model *model, int32_t capacity,
                         void *memory) {
    size_t m = (size_t)capacity, n = 3 * m, slots = (size_t)slot_count(model);
    unsigned char *at = memory;
    memset(at, 0, pal_active_set_bytes(model, capacity));
    *set = (pal_active_set){.c = model->c_tt,
                            .ld = 3 * (int64_t)model->info.column_count,
                            .symmetric = model->info.certificate.symmetrized != 0,
                            .capacity = capacity,
                            .slots = slot_count(model),
                            .stride = (int32_t)(row_bytes(capacity) / sizeof(double))};
    set->matrix = pal_block_take(&at, n * n * sizeof(double));
    set->u = pal_block_take(&at, n * sizeof(double));
    set->f = pal_block_take(&at, n * sizeof(double));
    set->work = pal_block_take(&at, n * sizeof(double));
    set->row = pal_block_take(&at, 3 * slots * row_bytes(capacity));
    set->column = pal_block_take(&at, m * sizeof(int32_t));
    set->dof = pal_block_take(&at, n * sizeof(int32_t));
    set->pivot = pal_block_take(&at, n * sizeof(int32_t));
    set->owner = pal_block_take(&at, slots * sizeof(int32_t));
    set->valid = pal_block_take(&at, slots * sizeof(int32_t));
    set->used = pal_block_take(&at, slots * sizeof(uint64_t));
    set->slot = pal_block_take(&at, (size_t)model->info.column_count * sizeof(int32_t));
    for (int32_t j = 0; j < model->info.column_count; j++) {
        set->slot[j] = -1;
    }
    pal_active_set_clear(set);
}

void pal_active_set_clear(pal_active_set *set) {
    set->count = set->solved = set->factored = 0;
    set->current = 1;
    set->next = 0;
    for (int32_t s = 0; s < set->slots; s++) {
        if (set->owner[s] >= 0) {
            set->slot[set->owner[s]] = -1;
        }
        set->owner[s] = -1;
        set->valid[s] = 0;
    }
}

void pal_active_set_append(pal_active_set *set, int32_t column) {
    int32_t i = set->count++;
    set->current = 0;
    set->column[i] = column;
    for (int r = 0; r < 3; r++) {
        set->u[3 * i + r] = 0.0;
    }
}

/// Take three unknowns out of cached rows: rows in use close the gap, others are cut off there.
static void forget_unknowns(pal_active_set *set, int32_t s, int32_t first) {
    int32_t behind = set->valid[s] - first - 3;
    if (behind < 0) {
        set->valid[s] = set->valid[s] > first ? first : set->valid[s];
        return;
    }
    if (set->used[s] + 1 < set->solves) {
        set->valid[s] = first;
        return;
    }
    double *row = set->row + 3 * (size_t)s * (size_t)set->stride + first;
    for (int r = 0; r < 3; r++, row += set->stride) {
        memmove(row, row + 3, (size_t)behind * sizeof *row);
    }
    set->valid[s] -= 3;
}

void pal_active_set_remove(pal_active_set *set, int32_t index) {
    int32_t behind = --set->count - index;
    set->current = 0;
    for (int32_t s = 0; s < set->slots; s++) {
        forget_unknowns(set, s, 3 * index);
    }
    memmove(set->column + index, set->column + index + 1, (size_t)behind * sizeof *set->column);
    memmove(set->u + 3 * index, set->u + 3 * (index + 1), 3 * (size_t)behind * sizeof *set->u);
    // the leading block of a Cholesky factor stays a factor; that of a pivoted LU does not
    int32_t valid = set->symmetric ? 3 * index : 0;
    if (set->factored > valid) {
        set->factored = valid;
    }
}

/// Element (i, j) of C_aa.
static inline double element(const pal_active_set *set, int32_t i, int32_t j) {
    int64_t row = 3 * (int64_t)set->column[i / 3] + i % 3;
    int64_t column = 3 * (int64_t)set->column[j / 3] + j % 3;
    return set->c[row + column * set->ld];
}

static int factor_symmetric(pal_active_set *set) {
    int32_t n = 3 * set->count, ld = 3 * set->capacity, first = set->factored;
    if (first >= n) {
        return 0;
    }
    // rows behind the valid part: against the valid columns by a triangular solve, the rest raw
    for (int32_t i = first; i < n; i++) {
        for (int32_t j = 0; j < first; j++) {
            set->work[j] = element(set, i, j);
        }
        pal_dense_lower_solve(first, set->matrix, ld, set->work);
        for (int32_t j = 0; j < first; j++) {
            set->matrix[i + (size_t)j * (size_t)ld] = set->work[j];
        }
        for (int32_t j = first; j <= i; j++) {
            set->matrix[i + (size_t)j * (size_t)ld] = element(set, i, j);
        }
    }
    int32_t failed = pal_dense_cholesky(n, first, set->matrix, ld);
    set->factored = failed == 0 ? n : first;
    return failed == 0 ? 0 : -1;
}

static int factor_general(pal_active_set *set) {
    int32_t n = 3 * set->count, ld = 3 * set->capacity;
    if (set->factored == n) {
        return 0;
    }
    set->factored = 0;
    for (int32_t j = 0; j < n; j++) {
        for (int32_t i = 0; i < n; i++) {
            set->matrix[i + (size_t)j * (size_t)ld] = element(set, i, j);
        }
    }
    if (pal_dense_lu(n, set->matrix, ld, set->pivot) != 0) {
        return -1;
    }
    set->factored = n;
    return 0;
}

int pal_active_set_solve(pal_active_set *set) {
    int32_t n = 3 * set->count, ld = 3 * set->capacity;
    if ((set->symmetric ? factor_symmetric(set) : factor_general(set)) != 0) {
        return -1;
    }
    memcpy(set->f, set->u, (size_t)n * sizeof *set->f);
    if (set->symmetric) {
        pal_dense_cholesky_solve(n, set->matrix, ld, 1, set->f, ld);
    } else if (n > 0) {
        pal_dense_lu_solve(n, set->matrix, ld, set->pivot, 1, set->f, ld);
    }
    for (int32_t i = 0; i < n; i++) {
        set->dof[i] = 3 * set->column[i / 3] + i % 3;
    }
    set->solved = n;
    set->solves++;
    set->current = 1;
    return 0;
}

/// The cached rows of a column node against all unknowns of the set.
static const double *rows_of(pal_active_set *set, int32_t column) {
    int32_t s = set->slot[column];
    if (s < 0) {
        s = set->next;
        set->next = s + 1 < set->slots ? s + 1 : 0;
        if (set->owner[s] >= 0) {
            set->slot[set->owner[s]] = -1;
        }
        set->owner[s] = column;
        set->slot[column] = s;
        set->valid[s] = 0;
    }
    double *row = set->row + 3 * (size_t)s * (size_t)set->stride;
    for (int32_t k = set->valid[s]; k < set->solved; k++) {
        for (int r = 0; r < 3; r++) {
            // of a symmetric block, read the column: three runs instead of a page per entry
            int64_t i = 3 * (int64_t)column + r, j = set->dof[k];
            row[(size_t)r * (size_t)set->stride + (size_t)k] =
                set->symmetric ? set->c[j + i * set->ld] : set->c[i + j * set->ld];
        }
    }
    set->valid[s] = set->solved;
    set->used[s] = set->solves;
    return row;
}

typedef double pair __attribute__((vector_size(16), aligned(8), may_alias));

/// Sum of a[k] b[k]: four running sums, added in a fixed order.
static double product(const double *a, const double *b, int32_t n) {
    pair even = {0.0, 0.0}, odd = {0.0, 0.0};
    int32_t k = 0;
    for (; k + 4 <= n; k += 4) {
        even += *(const pair *)(const void *)(a + k) * *(const pair *)(const void *)(b + k);
        odd += *(const pair *)(const void *)(a + k + 2) * *(const pair *)(const void *)(b + k + 2);
    }
    double tail = 0.0;
    for (; k < n; k++) {
        tail += a[k] * b[k];
    }
    return ((even[0] + even[1]) + (odd[0] + odd[1])) + tail;
}

void pal_active_set_displacement(pal_active_set *set, int32_t column, double u[3]) {
    u[0] = u[1] = u[2] = 0.0;
    if (set->solved == 0) {
        return;
    }
    if (set->current) {
        const double *row = rows_of(set, column);
        for (int r = 0; r < 3; r++) {
            u[r] = product(row + (size_t)r * (size_t)set->stride, set->f, set->solved);
        }
        return;
    }
    for (int32_t k = 0; k < set->solved; k++) { // the cache follows the set, not the last solve
        const double *c = set->c + 3 * (int64_t)column + (int64_t)set->dof[k] * set->ld;
        for (int r = 0; r < 3; r++) {
            u[r] += c[r] * set->f[k];
        }
    }
}
