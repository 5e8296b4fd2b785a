/// @file working_set.c  Gathering and keeping the regular compliance of the nodes in use.
///
/// The set is compact: a node leaves by the last one taking its slot, so sweeps over the block are
/// contiguous. Of a symmetric C_TT each block is read once and mirrored. A few nodes that were not
/// used in the last tick stay, oldest first out: a tool that trembles over the edge of a stencil
/// reads nothing twice.
#include "haptic/contact/working_set.h"
#include "haptic/base/block.h"

#include <string.h>

enum { STALE = 12 };

static size_t stride_of(int32_t capacity) {
    return pal_block_padded(3 * (size_t)capacity * sizeof(double)) / sizeof(double);
}

size_t pal_working_set_bytes(const pal_model *model, int32_t capacity) {
    size_t n = (size_t)capacity;
    return pal_block_padded((size_t)model->info.column_count * sizeof(int32_t)) +
           pal_block_padded(n * sizeof(int32_t)) + pal_block_padded(n * sizeof(uint64_t)) +
           3 * n * stride_of(capacity) * sizeof(double);
}

void pal_working_set_init(pal_working_set *set, const pal_near_field *near, int32_t capacity,
                          void *memory) {
    const pal_model *model = near->model;
    size_t n = (size_t)capacity;
    unsigned char *at = memory;
    memset(memory, 0, pal_working_set_bytes(model, capacity));
    *set = (pal_working_set){.model = model,
                             .near = near,
                             .symmetric = model->info.certificate.symmetrized != 0,
                             .capacity = capacity,
                             .stride = (int32_t)stride_of(capacity)};
    set->slot = pal_block_take(&at, (size_t)model->info.column_count * sizeof(int32_t));
    set->column = pal_block_take(&at, n * sizeof(int32_t));
    set->used = pal_block_take(&at, n * sizeof(uint64_t));
    set->block = pal_block_take(&at, 3 * n * stride_of(capacity) * sizeof(double));
    for (int32_t j = 0; j < model->info.column_count; j++) {
        set->slot[j] = -1;
    }
}

void pal_working_set_clear(pal_working_set *set) {
    for (int32_t s = 0; s < set->count; s++) {
        set->slot[set->column[s]] = -1;
    }
    set->count = 0;
    set->tick = 0;
}

/// Slot s goes; the last one takes its place.
static void forget(pal_working_set *set, int32_t s) {
    int32_t last = --set->count;
    size_t ld = (size_t)set->stride;
    set->slot[set->column[s]] = -1;
    if (s == last) {
        return;
    }
    double *block = set->block;
    for (size_t c = 0; c < 3; c++) { // the column with the old slots of both, then the rows
        memcpy(block + (3 * (size_t)s + c) * ld, block + (3 * (size_t)last + c) * ld,
               3 * (size_t)(last + 1) * sizeof *block);
    }
    for (size_t j = 0; j < 3 * (size_t)last; j++) {
        memcpy(block + 3 * (size_t)s + j * ld, block + 3 * (size_t)last + j * ld,
               3 * sizeof *block);
    }
    set->column[s] = set->column[last];
    set->used[s] = set->used[last];
    set->slot[set->column[s]] = s;
}

void pal_working_set_begin(pal_working_set *set) {
    int32_t stale = 0;
    for (int32_t s = 0; s < set->count; s++) {
        stale += set->used[s] < set->tick;
    }
    for (; stale > STALE; stale--) {
        int32_t oldest = 0;
        for (int32_t s = 1; s < set->count; s++) {
            int older = set->used[s] < set->used[oldest] ||
                        (set->used[s] == set->used[oldest] && set->column[s] < set->column[oldest]);
            oldest = older ? s : oldest;
        }
        forget(set, oldest);
    }
    set->tick++;
}

/// Store r[i + 3 j] as R of slots a (rows) and b (columns).
static inline void put(pal_working_set *set, int32_t a, int32_t b, const double r[9]) {
    double *to = set->block + 3 * (size_t)a + 3 * (size_t)b * (size_t)set->stride;
    for (int j = 0; j < 3; j++, to += set->stride) {
        to[0] = r[3 * j];
        to[1] = r[3 * j + 1];
        to[2] = r[3 * j + 2];
    }
}

/// R of slots a (rows) and b (columns) from C's 3 x 3 block at c, columns `ld` apart.
static inline void regular_part(const pal_working_set *set, int32_t a, int32_t b, const double *c,
                                size_t ld, double r[9]) {
    if (pal_near_pair(set->near, set->column[a], set->column[b], r)) {
        return;
    }
    pal_near_kernel(set->near, set->column[a], set->column[b], r);
    for (int j = 0; j < 3; j++, c += ld) {
        r[3 * j] = c[0] - r[3 * j];
        r[3 * j + 1] = c[1] - r[3 * j + 1];
        r[3 * j + 2] = c[2] - r[3 * j + 2];
    }
}

int32_t pal_working_set_add(pal_working_set *set, int32_t column) {
    int32_t s = set->slot[column];
    if (s >= 0) {
        set->used[s] = set->tick;
        return s;
    }
    if (set->count == set->capacity) {
        return -1;
    }
    s = set->count++;
    set->slot[column] = s;
    set->column[s] = column;
    set->used[s] = set->tick;
    set->gathered++;
    const double *c_tt = set->model->c_tt;
    size_t ld = 3 * (size_t)set->model->info.column_count, own = 3 * (size_t)column;
    for (int32_t a = 0; a <= s; a++) {
        size_t row = 3 * (size_t)set->column[a];
        for (size_t j = 0; j < 3; j++) {
            __builtin_prefetch(c_tt + row + (own + j) * ld);
            if (!set->symmetric) {
                __builtin_prefetch(c_tt + own + (row + j) * ld);
            }
        }
    }
    for (int32_t a = 0; a <= s; a++) {
        size_t row = 3 * (size_t)set->column[a];
        double r[9];
        regular_part(set, a, s, c_tt + row + own * ld, ld, r);
        put(set, a, s, r);
        if (a == s) {
            break;
        }
        if (set->symmetric) {
            const double mirrored[9] = {r[0], r[3], r[6], r[1], r[4], r[7], r[2], r[5], r[8]};
            put(set, s, a, mirrored);
        } else {
            regular_part(set, s, a, c_tt + own + row * ld, ld, r);
            put(set, s, a, r);
        }
    }
    return s;
}
