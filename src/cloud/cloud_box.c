/// @file cloud_box.c  A structured, jittered box cloud for tests: no mesher needed.
///
/// Every cell is cut into the six Kuhn tetrahedra that share its main diagonal (0,0,0)-(1,1,1): the
/// cuts of neighbouring cells match. Thread: any.
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/cloud/cloud.h"

typedef struct grid {
    const int *n;    ///< cells per axis
    int32_t *number; ///< node number of each grid point: surface first
} grid;

static size_t grid_point(const grid *g, int i, int j, int k) {
    return ((size_t)i * (size_t)(g->n[1] + 1) + (size_t)j) * (size_t)(g->n[2] + 1) + (size_t)k;
}

static int on_surface(const grid *g, int i, int j, int k) {
    return i == 0 || j == 0 || k == 0 || i == g->n[0] || j == g->n[1] || k == g->n[2];
}

/// splitmix64 (Steele, Lea, Flood 2014): one step, uniform in [-1, 1).
static double next_uniform(uint64_t *state) {
    uint64_t z = (*state += 0x9e3779b97f4a7c15u);
    z = (z ^ (z >> 30)) * 0xbf58476d1ce4e5b9u;
    z = (z ^ (z >> 27)) * 0x94d049bb133111ebu;
    z ^= z >> 31;
    return (double)(z >> 11) * 0x1p-52 - 1.0;
}

/// Numbers, rest positions and jitter offsets of the grid points.
static void place_nodes(pal_cloud *c, grid *g, const double size[3], double jitter, uint64_t seed,
                        double *offset) {
    int32_t surface = 0, inside = c->surface_count;
    for (int i = 0; i <= g->n[0]; i++) {
        for (int j = 0; j <= g->n[1]; j++) {
            for (int k = 0; k <= g->n[2]; k++) {
                int32_t id = on_surface(g, i, j, k) ? surface++ : inside++;
                const int index[3] = {i, j, k};
                g->number[grid_point(g, i, j, k)] = id;
                for (int d = 0; d < 3; d++) {
                    size_t at = 3 * (size_t)id + (size_t)d;
                    double h = size[d] / g->n[d], u = next_uniform(&seed);
                    int end = index[d] == 0 || index[d] == g->n[d];
                    c->position[at] = index[d] == g->n[d] ? size[d] : index[d] * h;
                    offset[at] = end ? 0.0 : jitter * h * u;
                }
            }
        }
    }
}

static void fill_tets(pal_cloud *c, const grid *g) {
    static const int order[6][3] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                    {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    size_t tet = 0, triangle = 0;
    for (int i = 0; i < g->n[0]; i++) {
        for (int j = 0; j < g->n[1]; j++) {
            for (int k = 0; k < g->n[2]; k++) {
                for (int p = 0; p < 6; p++) {
                    int at[4][3] = {{i, j, k}, {i, j, k}, {i, j, k}, {i, j, k}};
                    for (int s = 0; s < 3; s++) {
                        for (int later = s + 1; later < 4; later++) {
                            at[later][order[p][s]]++;
                        }
                    }
                    // odd permutations are mirror images: swap two nodes
                    int odd = p == 1 || p == 2 || p == 5;
                    int32_t *n = c->tet + 4 * tet++;
                    for (int v = 0; v < 4; v++) {
                        int from = odd && v == 1 ? 2 : (odd && v == 2 ? 1 : v);
                        const int *q = at[from];
                        n[v] = g->number[grid_point(g, q[0], q[1], q[2])];
                    }
                    if (odd) {
                        int swap[3];
                        memcpy(swap, at[1], sizeof swap);
                        memcpy(at[1], at[2], sizeof swap);
                        memcpy(at[2], swap, sizeof swap);
                    }
                    static const int side[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
                    for (int f = 0; f < 4; f++) {
                        const int *a = at[side[f][0]], *b = at[side[f][1]], *e = at[side[f][2]];
                        for (int d = 0; d < 3; d++) {
                            if (a[d] == b[d] && b[d] == e[d] && (a[d] == 0 || a[d] == g->n[d])) {
                                int32_t *t = c->triangle + 3 * triangle++;
                                for (int v = 0; v < 3; v++) {
                                    t[v] = n[side[f][v]];
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

static double tet_volume_moved(const double *x, const double *offset, const int32_t n[4]) {
    double e[3][3];
    for (int k = 0; k < 3; k++) {
        for (size_t d = 0; d < 3; d++) {
            size_t a = 3 * (size_t)n[0] + d, b = 3 * (size_t)n[k + 1] + d;
            e[k][d] = (x[b] + offset[b]) - (x[a] + offset[a]);
        }
    }
    return ((e[0][1] * e[1][2] - e[0][2] * e[1][1]) * e[2][0] +
            (e[0][2] * e[1][0] - e[0][0] * e[1][2]) * e[2][1] +
            (e[0][0] * e[1][1] - e[0][1] * e[1][0]) * e[2][2]) /
           6.0;
}

/// Halve the offsets of tetrahedra that would lose more than nine tenths of their volume.
static void limit_jitter(const pal_cloud *c, double cell_volume, double *offset) {
    for (int pass = 0, changed = 1; changed && pass < 60; pass++) {
        changed = 0;
        for (size_t t = 0; t < (size_t)c->tet_count; t++) {
            const int32_t *n = c->tet + 4 * t;
            if (tet_volume_moved(c->position, offset, n) < 0.1 * cell_volume / 6.0) {
                changed = 1;
                for (int v = 0; v < 4; v++) {
                    for (size_t d = 0; d < 3; d++) {
                        offset[3 * (size_t)n[v] + d] *= 0.5;
                    }
                }
            }
        }
    }
}

pal_status pal_cloud_box(pal_cloud *cloud, const double size[3], const int n[3], double jitter,
                         uint64_t seed, pal_error *error) {
    if (cloud == NULL || size == NULL || n == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "box cloud: NULL argument");
    }
    for (int d = 0; d < 3; d++) {
        if (!(size[d] > 0.0) || n[d] < 1 || n[d] > 512) {
            return pal_fail(
                error, PALPATE_ERROR_ARGUMENT,
                "box cloud: size %g with %d cells along axis %d; allowed: a positive size "
                "and 1 to 512 cells",
                size[d], n[d], d);
        }
    }
    if (!(jitter >= 0.0 && jitter < 0.5)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "box cloud: jitter %g is not in [0, 0.5) spacings", jitter);
    }
    memset(cloud, 0, sizeof *cloud);
    size_t cells = (size_t)n[0] * (size_t)n[1] * (size_t)n[2];
    size_t points = (size_t)(n[0] + 1) * (size_t)(n[1] + 1) * (size_t)(n[2] + 1);
    size_t inside = (size_t)(n[0] - 1) * (size_t)(n[1] - 1) * (size_t)(n[2] - 1);
    size_t quads = 2 * ((size_t)n[0] * (size_t)n[1] + (size_t)n[1] * (size_t)n[2] +
                        (size_t)n[2] * (size_t)n[0]);
    grid g = {n, malloc(points * sizeof *g.number)};
    double *offset = malloc(3 * points * sizeof *offset);
    cloud->length = 1.0;
    cloud->node_count = (int32_t)points;
    cloud->surface_count = (int32_t)(points - inside);
    cloud->triangle_count = (int32_t)(2 * quads);
    cloud->tet_count = (int32_t)(6 * cells);
    cloud->position = malloc(3 * points * sizeof(double));
    cloud->triangle = malloc(6 * quads * sizeof(int32_t));
    cloud->tet = malloc(24 * cells * sizeof(int32_t));
    pal_status status;
    if (g.number == NULL || offset == NULL || cloud->position == NULL || cloud->triangle == NULL ||
        cloud->tet == NULL) {
        status =
            pal_fail(error, PALPATE_ERROR_MEMORY, "box cloud: no memory for %zu nodes", points);
    } else {
        place_nodes(cloud, &g, size, jitter, seed, offset);
        fill_tets(cloud, &g);
        limit_jitter(cloud, size[0] * size[1] * size[2] / (double)cells, offset);
        for (size_t i = 0; i < 3 * points; i++) {
            cloud->position[i] += offset[i];
        }
        status = pal_cloud_complete(cloud, error);
    }
    free(g.number);
    free(offset);
    if (status != PALPATE_OK) {
        pal_cloud_clear(cloud);
    }
    return status;
}
