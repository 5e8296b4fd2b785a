/// @file surface_weld.c  One vertex per place.
///
/// Importers give every (position, normal, texture) triple a vertex of its own, STL every corner of
/// every triangle. Vertices closer than 1e-6 of the surface's extent are one: in the order of their
/// x (then number) each one joins the first that is near and stands for itself, else it stands for
/// itself. Those are found through a grid of cells of that length, hashed: linear in the number of
/// vertices, however many lie in one plane. Thread: any.
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/geometry/surface.h"
#include "haptic/base/vec.h"

static const double WELD = 1e-6;
static const double CELL =
    1.001; ///< cells are longer than the reach: neighbours differ by 1 at most

typedef struct sorted {
    double x;
    int32_t vertex;
} sorted;

typedef struct grid {
    double low[3], reach;
    uint64_t mask;
    int32_t *first; ///< (mask + 1) rank of the newest vertex in a bucket, -1: none
    int32_t *next;  ///< (vertices) by rank
} grid;

static int sorted_compare(const void *pa, const void *pb) {
    const sorted *a = pa, *b = pb;
    if (a->x != b->x) {
        return a->x < b->x ? -1 : 1;
    }
    return (a->vertex > b->vertex) - (a->vertex < b->vertex);
}

static uint64_t bucket_of(const grid *g, const int64_t cell[3]) {
    uint64_t h = (uint64_t)cell[0] * 0x9E3779B97F4A7C15u ^ (uint64_t)cell[1] * 0xC2B2AE3D27D4EB4Fu ^
                 (uint64_t)cell[2] * 0x165667B19E3779F9u;
    h ^= h >> 29;
    h *= 0xBF58476D1CE4E5B9u;
    return (h ^ h >> 32) & g->mask;
}

static void cell_of(const grid *g, const double *x, int64_t cell[3]) {
    for (int c = 0; c < 3; c++) { // at most 1e6 by the definition of reach
        cell[c] = (int64_t)floor((x[c] - g->low[c]) / (CELL * g->reach));
    }
}

/// The first (by rank) that stands for itself within reach; -1: none.
static int32_t find_near(const grid *g, const pal_surface *s, const sorted *order,
                         const double *x) {
    int64_t cell[3], near[3];
    int32_t best = -1;
    cell_of(g, x, cell);
    for (int k = 0; k < 27; k++) {
        near[0] = cell[0] + k % 3 - 1;
        near[1] = cell[1] + k / 3 % 3 - 1;
        near[2] = cell[2] + k / 9 - 1;
        for (int32_t r = g->first[bucket_of(g, near)]; r >= 0; r = g->next[r]) {
            if ((best < 0 || r < best) &&
                v3_distance(s->x + 3 * (size_t)order[r].vertex, x) <= g->reach) {
                best = r;
            }
        }
    }
    return best;
}

static double measure(const pal_surface *s, double low[3]) {
    double extent = 0.0;
    for (int c = 0; c < 3; c++) {
        double high = -HUGE_VAL;
        low[c] = HUGE_VAL;
        for (size_t i = 0; i < (size_t)s->vertex_count; i++) {
            low[c] = fmin(low[c], s->x[3 * i + (size_t)c]);
            high = fmax(high, s->x[3 * i + (size_t)c]);
        }
        extent = fmax(extent, high - low[c]);
    }
    return extent;
}

pal_status pal_surface_twins(const pal_surface *s, int32_t *same, pal_error *error) {
    size_t n = (size_t)s->vertex_count;
    grid g = {.mask = 1};
    g.reach = WELD * measure(s, g.low);
    while (g.mask + 1 < 2 * n) {
        g.mask = 2 * g.mask + 1;
    }
    sorted *order = malloc((n + 1) * sizeof *order);
    g.first = malloc((g.mask + 1) * sizeof *g.first);
    g.next = malloc((n + 1) * sizeof *g.next);
    if (order == NULL || g.first == NULL || g.next == NULL) {
        free(order);
        free(g.first);
        free(g.next);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to weld %zu vertices", n);
    }
    for (size_t i = 0; i <= g.mask; i++) {
        g.first[i] = -1;
    }
    for (size_t i = 0; i < n; i++) {
        order[i] = (sorted){s->x[3 * i], (int32_t)i};
    }
    qsort(order, n, sizeof *order, sorted_compare);
    int one_place = !(g.reach > 0.0 && g.reach < HUGE_VAL); // or so wide that it cannot be measured
    for (size_t i = 0; i < n; i++) {
        int32_t a = order[i].vertex;
        const double *x = s->x + 3 * (size_t)a;
        int32_t leader = one_place ? (i > 0 ? 0 : -1) : find_near(&g, s, order, x);
        same[a] = leader >= 0 ? order[leader].vertex : a;
        if (leader < 0 && !one_place) {
            int64_t cell[3];
            cell_of(&g, x, cell);
            uint64_t b = bucket_of(&g, cell);
            g.next[i] = g.first[b];
            g.first[b] = (int32_t)i;
        }
    }
    free(order);
    free(g.first);
    free(g.next);
    return PALPATE_OK;
}

/// Give vertices at the same place one number, in the order of first use; drop unused ones.
pal_status pal_surface_weld(pal_surface *s, pal_error *error) {
    size_t n = (size_t)s->vertex_count;
    int32_t *same = malloc(n * sizeof *same);
    int32_t *number = malloc(n * sizeof *number);
    double *x = malloc(3 * n * sizeof *x);
    if (same == NULL || number == NULL || x == NULL) {
        free(same);
        free(number);
        free(x);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to weld %zu vertices", n);
    }
    pal_status status = pal_surface_twins(s, same, error);
    if (status != PALPATE_OK) {
        free(same);
        free(number);
        free(x);
        return status;
    }
    int32_t count = 0;
    for (size_t i = 0; i < n; i++) {
        number[i] = -1;
    }
    for (size_t i = 0; i < 3 * (size_t)s->triangle_count; i++) {
        int32_t a = same[s->v[i]];
        if (number[a] < 0) {
            v3_copy(s->x + 3 * (size_t)a, x + 3 * (size_t)count);
            number[a] = count++;
        }
        s->v[i] = number[a];
    }
    free(s->x);
    s->x = x;
    s->vertex_count = count;
    free(number);
    free(same);
    return PALPATE_OK;
}
