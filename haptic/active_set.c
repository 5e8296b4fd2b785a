/// @file active_set.c  Eq. 52 on an ordered list of touched nodes, with a factor kept between ticks.
#include "haptic/active_set.h"

#include <string.h>

#include "haptic/dense.h"

enum { LINE = 64 };

static size_t padded(size_t bytes) {
    return (bytes + LINE - 1) / LINE * LINE;
}

size_t pal_active_set_bytes(int32_t capacity) {
    size_t m = (size_t)capacity, n = 3 * m;
    return padded(m * sizeof(int32_t)) + 3 * padded(n * sizeof(double)) +
           2 * padded(n * sizeof(int32_t)) + padded(n * n * sizeof(double));
}

void pal_active_set_init(pal_active_set *set, const pal_model *model, int32_t capacity,
                         void *memory) {
    size_t m = (size_t)capacity, n = 3 * m;
    unsigned char *at = memory;
    memset(at, 0, pal_active_set_bytes(capacity));
    *set = (pal_active_set){.c = model->c_tt,
                            .ld = 3 * (int64_t)model->info.column_count,
                            .symmetric = model->info.certificate.symmetrized != 0,
                            .capacity = capacity};
    set->matrix = (double *)(void *)at;
    at += padded(n * n * sizeof(double));
    set->u = (double *)(void *)at;
    at += padded(n * sizeof(double));
    set->f = (double *)(void *)at;
    at += padded(n * sizeof(double));
    set->work = (double *)(void *)at;
    at += padded(n * sizeof(double));
    set->column = (int32_t *)(void *)at;
    at += padded(m * sizeof(int32_t));
    set->dof = (int32_t *)(void *)at;
    at += padded(n * sizeof(int32_t));
    set->pivot = (int32_t *)(void *)at;
}

void pal_active_set_clear(pal_active_set *set) {
    set->count = set->solved = set->factored = 0;
}

void pal_active_set_append(pal_active_set *set, int32_t column) {
    int32_t i = set->count++;
    set->column[i] = column;
    for (int r = 0; r < 3; r++) {
        set->u[3 * i + r] = 0.0;
    }
}

void pal_active_set_remove(pal_active_set *set, int32_t index) {
    int32_t behind = --set->count - index;
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
    return 0;
}

void pal_active_set_displacement(const pal_active_set *set, int32_t column, double u[3]) {
    double a = 0.0, b = 0.0, c = 0.0;
    int64_t row = 3 * (int64_t)column;
    if (set->symmetric) { // rows are columns: stay within three of them
        const double *x = set->c + row * set->ld, *y = x + set->ld, *z = y + set->ld;
        for (int32_t k = 0; k < set->solved; k++) {
            a += x[set->dof[k]] * set->f[k];
            b += y[set->dof[k]] * set->f[k];
            c += z[set->dof[k]] * set->f[k];
        }
    } else {
        for (int32_t k = 0; k < set->solved; k++) {
            const double *x = set->c + row + (int64_t)set->dof[k] * set->ld;
            a += x[0] * set->f[k];
            b += x[1] * set->f[k];
            c += x[2] * set->f[k];
        }
    }
    u[0] = a;
    u[1] = b;
    u[2] = c;
}
