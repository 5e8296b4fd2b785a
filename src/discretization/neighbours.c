/// @file neighbours.c  A balanced k-d tree in place, queried with a bounded heap.
///
/// The tree is implicit: a range [low, high) of the reordered points is split at its middle by the
/// widest axis of its bounding box, points compared by (coordinate, index), which are all distinct.
/// A query keeps its k best in a max-heap, kept in the caller's arrays, ordered by (squared
/// distance, index), and finally sorts it. A subtree is visited unless its splitting plane is
/// farther than the worst of k; at equal distance it is visited, since a smaller index may wait
/// there.
#include "src/discretization/neighbours.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

enum { LEAF = 8 };

/// ---- Building ------------------------------------------------------------------------------

static int before(const double *position, int axis, int32_t a, int32_t b) {
    double xa = position[3 * (int64_t)a + axis];
    double xb = position[3 * (int64_t)b + axis];
    return xa < xb || (xa == xb && a < b);
}

static void swap_index(int32_t *index, int32_t i, int32_t j) {
    int32_t t = index[i];
    index[i] = index[j];
    index[j] = t;
}

/// Quickselect: afterwards index[middle] is the one that sorting [low, high) would put there.
static void select_middle(const double *position, int axis, int32_t *index, int32_t low,
                          int32_t high, int32_t middle) {
    while (high - low > 1) {
        // median of three as pivot, moved to the front
        int32_t last = high - 1;
        int32_t half = low + (high - low) / 2;
        if (before(position, axis, index[half], index[low])) {
            swap_index(index, half, low);
        }
        if (before(position, axis, index[last], index[low])) {
            swap_index(index, last, low);
        }
        if (before(position, axis, index[last], index[half])) {
            swap_index(index, last, half);
        }
        int32_t pivot = index[half];
        swap_index(index, half, low);
        int32_t store = low;
        for (int32_t i = low + 1; i < high; i++) {
            if (before(position, axis, index[i], pivot)) {
                store++;
                swap_index(index, i, store);
            }
        }
        swap_index(index, low, store);
        if (store == middle) {
            return;
        }
        if (middle < store) {
            high = store;
        } else {
            low = store + 1;
        }
    }
}

static int widest_axis(const double *position, const int32_t *index, int32_t low, int32_t high) {
    int widest = 0;
    double extent = -1.0;
    for (int a = 0; a < 3; a++) {
        double least = position[3 * (int64_t)index[low] + a];
        double most = least;
        for (int32_t i = low + 1; i < high; i++) {
            double v = position[3 * (int64_t)index[i] + a];
            least = v < least ? v : least;
            most = v > most ? v : most;
        }
        if (most - least > extent) {
            extent = most - least;
            widest = a;
        }
    }
    return widest;
}

static void build(pal_neighbours *n, const double *position, int32_t low, int32_t high) {
    while (high - low > LEAF) {
        int32_t middle = low + (high - low) / 2;
        int axis = widest_axis(position, n->index, low, high);
        select_middle(position, axis, n->index, low, high, middle);
        n->axis[middle] = (uint8_t)axis;
        build(n, position, low, middle); // depth: log2(count)
        low = middle + 1;
    }
}

pal_status pal_neighbours_create(pal_neighbours *out, const double *position, int32_t count,
                                 pal_error *error) {
    memset(out, 0, sizeof *out);
    if (position == NULL || count <= 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "neighbour search: no points given");
    }
    for (int64_t i = 0; i < 3 * (int64_t)count; i++) {
        if (!isfinite(position[i])) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "neighbour search: coordinate %d of node %lld is %g, not a number",
                            (int)(i % 3), (long long)(i / 3), position[i]);
        }
    }
    out->position = malloc((size_t)count * 3 * sizeof *out->position);
    out->point = malloc((size_t)count * 3 * sizeof *out->point);
    out->index = malloc((size_t)count * sizeof *out->index);
    out->axis = calloc((size_t)count, sizeof *out->axis);
    if (out->position == NULL || out->point == NULL || out->index == NULL || out->axis == NULL) {
        pal_neighbours_clear(out);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "neighbour search: no memory for %d points",
                        count);
    }
    out->count = count;
    memcpy(out->position, position, (size_t)count * 3 * sizeof *position);
    for (int32_t i = 0; i < count; i++) {
        out->index[i] = i;
    }
    build(out, position, 0, count);
    for (int64_t i = 0; i < count; i++) {
        memcpy(out->point + 3 * i, position + 3 * (int64_t)out->index[i], 3 * sizeof *out->point);
    }
    return PALPATE_OK;
}

void pal_neighbours_clear(pal_neighbours *n) {
    free(n->position);
    free(n->point);
    free(n->index);
    free(n->axis);
    memset(n, 0, sizeof *n);
}

/// ---- Queries -------------------------------------------------------------------------------

/// The best found so far: a max-heap in the caller's arrays. `limit` rejects what is farther.
typedef struct query {
    const pal_neighbours *tree;
    double x[3];
    double limit;
    int32_t capacity, count;
    int32_t *index;
    double *distance2;
    int32_t total;
} query;

static int worse(const query *q, int32_t i, int32_t j) {
    return q->distance2[i] > q->distance2[j] ||
           (q->distance2[i] == q->distance2[j] && q->index[i] > q->index[j]);
}

static void swap_entry(query *q, int32_t i, int32_t j) {
    swap_index(q->index, i, j);
    double t = q->distance2[i];
    q->distance2[i] = q->distance2[j];
    q->distance2[j] = t;
}

static void sift_down(query *q, int32_t at, int32_t count) {
    for (;;) {
        int32_t child = 2 * at + 1;
        if (child >= count) {
            return;
        }
        if (child + 1 < count && worse(q, child + 1, child)) {
            child++;
        }
        if (!worse(q, child, at)) {
            return;
        }
        swap_entry(q, child, at);
        at = child;
    }
}

static void offer(query *q, int32_t index, double distance2) {
    if (distance2 > q->limit) {
        return;
    }
    q->total++;
    if (q->count < q->capacity) {
        int32_t at = q->count++;
        q->index[at] = index;
        q->distance2[at] = distance2;
        while (at > 0 && worse(q, at, (at - 1) / 2)) {
            swap_entry(q, at, (at - 1) / 2);
            at = (at - 1) / 2;
        }
    } else if (q->capacity > 0 && (distance2 < q->distance2[0] ||
                                   (distance2 == q->distance2[0] && index < q->index[0]))) {
        q->index[0] = index;
        q->distance2[0] = distance2;
        sift_down(q, 0, q->count);
    }
}

static void offer_at(query *q, int32_t i) {
    const double *p = q->tree->point + 3 * (int64_t)i;
    double dx = p[0] - q->x[0];
    double dy = p[1] - q->x[1];
    double dz = p[2] - q->x[2];
    offer(q, q->tree->index[i], dx * dx + dy * dy + dz * dz);
}

/// @param counting  1: every point within the limit is wanted (for `total`), not only the k best
static void visit(query *q, int32_t low, int32_t high, int counting) {
    while (high - low > LEAF) {
        int32_t middle = low + (high - low) / 2;
        int axis = q->tree->axis[middle];
        double plane = q->x[axis] - q->tree->point[3 * (int64_t)middle + axis];
        int left_first = plane < 0.0;
        visit(q, left_first ? low : middle + 1, left_first ? middle : high, counting);
        offer_at(q, middle);
        double reach = q->limit;
        if (!counting && q->count == q->capacity && q->distance2[0] < reach) {
            reach = q->distance2[0];
        }
        if (plane * plane > reach) {
            return;
        }
        if (left_first) {
            low = middle + 1;
        } else {
            high = middle;
        }
    }
    for (int32_t i = low; i < high; i++) {
        offer_at(q, i);
    }
}

static void sort_ascending(query *q) {
    for (int32_t last = q->count - 1; last > 0; last--) {
        swap_entry(q, 0, last);
        sift_down(q, 0, last);
    }
}

int32_t pal_neighbours_nearest(const pal_neighbours *n, const double x[3], int32_t k,
                               int32_t *index, double *distance2) {
    query q = {.tree = n,
               .x = {x[0], x[1], x[2]},
               .limit = INFINITY,
               .capacity = k,
               .index = index,
               .distance2 = distance2};
    if (k <= 0) {
        return 0;
    }
    visit(&q, 0, n->count, 0);
    sort_ascending(&q);
    return q.count;
}

int32_t pal_neighbours_within(const pal_neighbours *n, const double x[3], double radius,
                              int32_t capacity, int32_t *index, double *distance2, int32_t *total) {
    query q = {.tree = n,
               .x = {x[0], x[1], x[2]},
               .limit = radius * radius,
               .capacity = capacity > 0 ? capacity : 0,
               .index = index,
               .distance2 = distance2};
    if (radius >= 0.0) {
        visit(&q, 0, n->count, 1);
        sort_ascending(&q);
    }
    if (total != NULL) {
        *total = q.total;
    }
    return q.count;
}
