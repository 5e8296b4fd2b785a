/// @file cell_rows.c  Rows are collected as columns of the transpose and transposed at the end by
/// counting: memory is the matrix twice, never a list of triplets (a nodal volumetric term would
/// need some hundred of them per entry).
#include "src/discretization/cell_rows.h"

#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY,
                    "assembly: out of memory for the matrix; use a coarser spacing");
}

pal_status pal_rows_number(const pal_cloud *cloud, const uint8_t *fixed, pal_system *system,
                           pal_error *error) {
    memset(system, 0, sizeof *system);
    int32_t n = cloud->node_count, surface = cloud->surface_count;
    system->node_count = n;
    for (int32_t i = 0; i < n; i++) {
        system->fixed_count += fixed[i] ? 1 : 0;
        if (fixed[i] && i >= surface) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "supports: node %d is inside the body; only surface nodes are held", i);
        }
    }
    system->unknown_count = 3 * (n - system->fixed_count);
    if (system->unknown_count == 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "supports: all %d nodes are held", n);
    }
    pal_sparse *b = &system->load;
    b->rows = system->unknown_count;
    b->columns = 3 * (int64_t)surface;
    system->dof_unknown = malloc(3 * (size_t)n * sizeof *system->dof_unknown);
    system->fixed_node = malloc(((size_t)system->fixed_count + 1) * sizeof *system->fixed_node);
    b->start = calloc((size_t)b->columns + 1, sizeof *b->start);
    b->row = malloc(((size_t)b->columns + 1) * sizeof *b->row);
    b->value = malloc(((size_t)b->columns + 1) * sizeof *b->value);
    if (system->dof_unknown == NULL || system->fixed_node == NULL || b->start == NULL ||
        b->row == NULL || b->value == NULL) {
        pal_system_clear(system);
        return no_memory(error);
    }
    int32_t unknown = 0, held = 0;
    for (int32_t i = 0; i < n; i++) {
        for (int c = 0; c < 3; c++) {
            system->dof_unknown[3 * (size_t)i + (size_t)c] = fixed[i] ? -1 : unknown++;
        }
        if (fixed[i]) {
            system->fixed_node[held++] = i;
        }
    }
    for (int64_t j = 0; j < b->columns; j++) {
        int64_t at = b->start[j];
        // NOLINTNEXTLINE(*.UndefinedBinaryOperatorResult): columns are 3 n, all set above
        if (system->dof_unknown[j] >= 0) {
            b->row[at] = system->dof_unknown[j];
            b->value[at++] = 1;
        }
        b->start[j + 1] = at;
    }
    return PALPATE_OK;
}

/// A compressed-column matrix that grows column by column.
typedef struct growing {
    pal_sparse a;
    int64_t capacity;
} growing;

static pal_status growing_reserve(growing *g, int64_t more, pal_error *error) {
    int64_t need = (g->a.columns ? g->a.start[g->a.columns] : 0) + more;
    if (need <= g->capacity) {
        return PALPATE_OK;
    }
    int64_t capacity = need + need / 2;
    int64_t *row = realloc(g->a.row, (size_t)capacity * sizeof *row);
    if (row == NULL) {
        return no_memory(error);
    }
    g->a.row = row;
    double *value = realloc(g->a.value, (size_t)capacity * sizeof *value);
    if (value == NULL) {
        return no_memory(error);
    }
    g->a.value = value;
    g->capacity = capacity;
    return PALPATE_OK;
}

/// Append a node's three rows as three columns. The scatter is sorted, so rows are ascending.
static pal_status growing_append(growing *g, const pal_scatter *row, const int32_t *dof_unknown,
                                 pal_error *error) {
    pal_status status = growing_reserve(g, 9 * (int64_t)row->count + 1, error);
    if (status != PALPATE_OK) {
        return status;
    }
    for (int i = 0; i < 3; i++) {
        int64_t at = g->a.start[g->a.columns];
        for (int32_t k = 0; k < row->count; k++) {
            size_t node = (size_t)row->node[k];
            if (dof_unknown[3 * node] < 0) {
                continue;
            }
            for (size_t j = 0; j < 3; j++) {
                g->a.row[at] = dof_unknown[3 * node + j];
                g->a.value[at++] = row->value[9 * node + 3 * (size_t)i + j];
            }
        }
        g->a.start[++g->a.columns] = at;
    }
    return PALPATE_OK;
}

static pal_status transpose(const pal_sparse *a, pal_sparse *out, pal_error *error) {
    int64_t total = a->start[a->columns];
    memset(out, 0, sizeof *out);
    out->rows = a->columns;
    out->columns = a->rows;
    out->start = calloc((size_t)out->columns + 1, sizeof *out->start);
    out->row = malloc(((size_t)total + 1) * sizeof *out->row);
    out->value = malloc(((size_t)total + 1) * sizeof *out->value);
    if (out->start == NULL || out->row == NULL || out->value == NULL) {
        pal_sparse_clear(out);
        return no_memory(error);
    }
    for (int64_t k = 0; k < total; k++) {
        out->start[a->row[k] + 1]++;
    }
    for (int64_t j = 0; j < out->columns; j++) {
        out->start[j + 1] += out->start[j];
    }
    for (int64_t j = 0; j < a->columns; j++) {
        for (int64_t k = a->start[j]; k < a->start[j + 1]; k++) {
            int64_t at = out->start[a->row[k]]++;
            out->row[at] = j;
            out->value[at] = a->value[k];
        }
    }
    memmove(out->start + 1, out->start, (size_t)out->columns * sizeof *out->start);
    out->start[0] = 0;
    return PALPATE_OK;
}

pal_status pal_rows_assemble(pal_system *system, pal_row_fill fill, const void *context,
                             const pal_progress *progress, double done, pal_error *error) {
    growing k = {0}, r = {0};
    pal_scatter row = {0};
    int32_t n = system->node_count;
    k.a.rows = r.a.rows = system->unknown_count;
    k.a.start = calloc((size_t)system->unknown_count + 1, sizeof *k.a.start);
    r.a.start = calloc(3 * (size_t)system->fixed_count + 1, sizeof *r.a.start);
    pal_status status = k.a.start != NULL && r.a.start != NULL ? PALPATE_OK : no_memory(error);
    if (status == PALPATE_OK) {
        status = growing_reserve(&k, 240 * (int64_t)n, error);
    }
    if (status == PALPATE_OK) {
        status = growing_reserve(&r, 240 * (int64_t)system->fixed_count + 1, error);
    }
    if (status == PALPATE_OK) {
        status = pal_scatter_create(&row, n, 9, error);
    }
    for (int32_t i = 0; i < n && status == PALPATE_OK; i++) {
        if (progress != NULL && progress->call != NULL && i % 256 == 0 &&
            progress->call(progress->user, "assemble", done + (1 - done) * i / n, -1)) {
            status = pal_fail(error, PALPATE_ERROR_CANCELLED, "assembly: cancelled");
            break;
        }
        fill(context, i, &row);
        pal_scatter_sort(&row);
        growing *into = system->dof_unknown[3 * (size_t)i] < 0 ? &r : &k;
        status = growing_append(into, &row, system->dof_unknown, error);
        pal_scatter_empty(&row);
    }
    pal_scatter_clear(&row);
    if (status == PALPATE_OK) {
        status = transpose(&r.a, &system->reaction, error);
    }
    if (status == PALPATE_OK) {
        status = transpose(&k.a, &system->matrix, error);
    }
    pal_sparse_clear(&k.a);
    pal_sparse_clear(&r.a);
    return status;
}
