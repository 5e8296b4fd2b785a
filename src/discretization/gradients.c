/// @file gradients.c  Sparse gradient operators, inverted tables and the scatter they are built
/// with.
///
/// Everything is ordered by index, never by address or by hash, so that the same cloud gives the
/// same operator bit for bit.
#include "src/discretization/gradients.h"

#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

static pal_status no_memory(pal_error *error, const char *what) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: out of memory; use a coarser spacing", what);
}

void pal_gradients_clear(pal_gradients *g) {
    if (g != NULL) {
        free(g->start);
        free(g->node);
        free(g->weight);
        memset(g, 0, sizeof *g);
    }
}

void pal_lists_clear(pal_lists *l) {
    if (l != NULL) {
        free(l->start);
        free(l->item);
        memset(l, 0, sizeof *l);
    }
}

/// Room for `capacity` entries. On failure what was there stays.
static pal_status gradients_reserve(pal_gradients *g, int64_t capacity, pal_error *error) {
    if (capacity <= g->capacity) {
        return PALPATE_OK;
    }
    int32_t *node = realloc(g->node, (size_t)capacity * sizeof *node);
    if (node == NULL) {
        return no_memory(error, "gradient operator");
    }
    g->node = node;
    double *weight = realloc(g->weight, (size_t)capacity * 3 * sizeof *weight);
    if (weight == NULL) {
        return no_memory(error, "gradient operator");
    }
    g->weight = weight;
    g->capacity = capacity;
    return PALPATE_OK;
}

pal_status pal_gradients_create(pal_gradients *out, int32_t count, int64_t guess,
                                pal_error *error) {
    memset(out, 0, sizeof *out);
    out->count = count;
    out->start = calloc((size_t)count + 1, sizeof *out->start);
    if (out->start == NULL) {
        return no_memory(error, "gradient operator");
    }
    pal_status status = gradients_reserve(out, guess < 16 ? 16 : guess, error);
    if (status != PALPATE_OK) {
        pal_gradients_clear(out);
    }
    return status;
}

pal_status pal_gradients_append(pal_gradients *g, int32_t q, int32_t n, const int32_t *node,
                                const double *weight, pal_error *error) {
    int64_t first = g->start[q];
    if (first + n > g->capacity) {
        pal_status status = gradients_reserve(g, g->capacity + g->capacity / 2 + n, error);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    // insertion sort: a stencil has some tens of nodes
    for (int32_t k = 0; k < n; k++) {
        int64_t at = first + k;
        for (; at > first && g->node[at - 1] > node[k]; at--) {
            g->node[at] = g->node[at - 1];
            memcpy(&g->weight[3 * at], &g->weight[3 * (at - 1)], 3 * sizeof(double));
        }
        g->node[at] = node[k];
        memcpy(&g->weight[3 * at], &weight[3 * (int64_t)k], 3 * sizeof(double));
    }
    g->start[q + 1] = first + n;
    return PALPATE_OK;
}

pal_status pal_gradients_users(const pal_gradients *g, int32_t node_count, pal_lists *entry,
                               int32_t **point, pal_error *error) {
    int64_t total = g->start[g->count];
    memset(entry, 0, sizeof *entry);
    *point = NULL;
    entry->count = node_count;
    entry->start = calloc((size_t)node_count + 1, sizeof *entry->start);
    entry->item = malloc((size_t)(total + 1) * sizeof *entry->item);
    *point = malloc((size_t)(total + 1) * sizeof **point);
    if (total > INT32_MAX || entry->start == NULL || entry->item == NULL || *point == NULL) {
        pal_lists_clear(entry);
        free(*point);
        *point = NULL;
        return no_memory(error, "users of a gradient operator");
    }
    for (int64_t k = 0; k < total; k++) {
        entry->start[g->node[k] + 1]++;
    }
    for (int32_t i = 0; i < node_count; i++) {
        entry->start[i + 1] += entry->start[i];
    }
    for (int32_t q = 0; q < g->count; q++) {
        for (int64_t k = g->start[q]; k < g->start[q + 1]; k++) {
            int64_t at = entry->start[g->node[k]]++;
            entry->item[at] = (int32_t)k;
            (*point)[at] = q;
        }
    }
    // every start has moved to its successor: move them back
    memmove(entry->start + 1, entry->start, (size_t)node_count * sizeof *entry->start);
    entry->start[0] = 0;
    return PALPATE_OK;
}

pal_status pal_lists_invert(const int32_t *table, int32_t item_count, int32_t per_item,
                            int32_t owner_count, pal_lists *out, pal_error *error) {
    int64_t total = (int64_t)item_count * per_item;
    memset(out, 0, sizeof *out);
    out->count = owner_count;
    out->start = calloc((size_t)owner_count + 1, sizeof *out->start);
    out->item = malloc((size_t)(total + 1) * sizeof *out->item);
    if (out->start == NULL || out->item == NULL) {
        pal_lists_clear(out);
        return no_memory(error, "inverted table");
    }
    for (int64_t k = 0; k < total; k++) {
        out->start[table[k] + 1]++;
    }
    for (int32_t o = 0; o < owner_count; o++) {
        out->start[o + 1] += out->start[o];
    }
    for (int64_t k = 0; k < total; k++) {
        out->item[out->start[table[k]]++] = (int32_t)(k / per_item);
    }
    memmove(out->start + 1, out->start, (size_t)owner_count * sizeof *out->start);
    out->start[0] = 0;
    return PALPATE_OK;
}

pal_status pal_scatter_create(pal_scatter *out, int32_t node_count, int32_t width,
                              pal_error *error) {
    memset(out, 0, sizeof *out);
    out->node_count = node_count;
    out->width = width;
    out->node = malloc(((size_t)node_count + 1) * sizeof *out->node);
    out->value = calloc(((size_t)node_count + 1) * (size_t)width, sizeof *out->value);
    out->held = calloc((size_t)node_count + 1, sizeof *out->held);
    if (out->node == NULL || out->value == NULL || out->held == NULL) {
        pal_scatter_clear(out);
        return no_memory(error, "assembly row");
    }
    return PALPATE_OK;
}

void pal_scatter_clear(pal_scatter *s) {
    if (s != NULL) {
        free(s->node);
        free(s->value);
        free(s->held);
        memset(s, 0, sizeof *s);
    }
}

double *pal_scatter_at(pal_scatter *s, int32_t node) {
    if (!s->held[node]) {
        s->held[node] = 1;
        s->node[s->count++] = node;
    }
    return &s->value[(size_t)node * (size_t)s->width];
}

static int ascending(const void *a, const void *b) {
    int32_t x = *(const int32_t *)a, y = *(const int32_t *)b;
    return (x > y) - (x < y);
}

void pal_scatter_sort(pal_scatter *s) {
    qsort(s->node, (size_t)s->count, sizeof *s->node, ascending);
}

void pal_scatter_empty(pal_scatter *s) {
    for (int32_t k = 0; k < s->count; k++) {
        int32_t i = s->node[k];
        s->held[i] = 0;
        memset(&s->value[(size_t)i * (size_t)s->width], 0, (size_t)s->width * sizeof(double));
    }
    s->count = 0;
}
