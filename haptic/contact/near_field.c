/// @file near_field.c  Column nodes within one or two edges, and their regular compliance, taken
/// from the next ones.
#include "haptic/contact/near_field.h"
#include "haptic/base/block.h"

#include <math.h>
#include <string.h>

enum { RING = 128, ROOM = 48 };

static size_t place(const pal_model *model, pal_near_field *near, int32_t **column,
                    unsigned char *memory) {
    size_t n = (size_t)model->info.column_count, at = 0;
    PALPATE_BLOCK_PLACE(memory, at, near->regular, 9 * n * sizeof(double));
    PALPATE_BLOCK_PLACE(memory, at, near->spacing, n * sizeof(double));
    PALPATE_BLOCK_PLACE(memory, at, near->edge_start, (n + 1) * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, near->start, (n + 1) * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, near->neighbour, ROOM * n * sizeof(int32_t));
    // every triangle gives each of its corners two neighbours, each counted twice on closed
    // surfaces
    PALPATE_BLOCK_PLACE(memory, at, near->edge,
                        6 * (size_t)model->info.triangle_count * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, *column, (size_t)model->info.surface_count * sizeof(int32_t));
    return at;
}

size_t pal_near_bytes(const pal_model *model) {
    pal_near_field near;
    int32_t *column;
    return place(model, &near, &column, NULL);
}

static const double *position_of(const pal_near_field *near, int32_t column) {
    return near->model->position + 3 * (size_t)near->model->column_node[column];
}

static double apart(const pal_near_field *near, int32_t a, int32_t b) {
    const double *x = position_of(near, a), *y = position_of(near, b);
    double d[3] = {x[0] - y[0], x[1] - y[1], x[2] - y[2]};
    return sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
}

/// C_ab, column-major.
static void block_of(const pal_model *model, int32_t a, int32_t b, double c[9]) {
    size_t ld = 3 * (size_t)model->info.column_count;
    for (size_t j = 0; j < 3; j++) {
        memcpy(c + 3 * j, model->c_tt + (3 * (size_t)b + j) * ld + 3 * (size_t)a,
               3 * sizeof(double));
    }
}

void pal_near_kernel(const pal_near_field *near, int32_t a, int32_t b, double g[9]) {
    const double *n = near->model->normal + 3 * (size_t)near->model->column_node[a];
    const double *m = near->model->normal + 3 * (size_t)near->model->column_node[b];
    double r = apart(near, a, b), over = r > 0.0 ? 1.0 / r : 0.0;
    for (int j = 0; j < 3; j++) {
        for (int i = 0; i < 3; i++) {
            double both = (near->normal - near->tangent) * n[i] * m[j];
            g[i + 3 * j] = over * (both + (i == j ? near->tangent : 0.0));
        }
    }
}

/// Insert into an ascending list without repeats. @return new length
static int32_t insert(int32_t *list, int32_t count, int32_t room, int32_t value) {
    int32_t at = count;
    while (at > 0 && list[at - 1] > value) {
        at--;
    }
    if ((at > 0 && list[at - 1] == value) || count >= room) {
        return count;
    }
    memmove(list + at + 1, list + at, (size_t)(count - at) * sizeof *list);
    list[at] = value;
    return count + 1;
}

static int holds(const int32_t *list, int32_t count, int32_t value) {
    int32_t low = 0, high = count - 1;
    while (low <= high) {
        int32_t middle = low + (high - low) / 2;
        if (list[middle] == value) {
            return 1;
        }
        if (list[middle] < value) {
            low = middle + 1;
        } else {
            high = middle - 1;
        }
    }
    return 0;
}

static void find_edges(pal_near_field *near, const pal_rest_surface *s, const int32_t *column) {
    int32_t total = 0;
    for (int32_t a = 0; a < near->model->info.column_count; a++) {
        int32_t node = near->model->column_node[a], count = 0;
        near->edge_start[a] = total;
        near->spacing[a] = 0.0;
        for (int32_t k = node < s->node_count ? s->fan_start[node] : 0;
             node < s->node_count && k < s->fan_start[node + 1]; k++) {
            for (int c = 0; c < 3; c++) {
                int32_t b = column[s->triangle[3 * (size_t)(s->fan[k] / 3) + (size_t)c]];
                if (b >= 0 && b != a) {
                    count = insert(near->edge + total, count, INT32_MAX, b);
                }
            }
        }
        for (int32_t k = 0; k < count; k++) {
            near->spacing[a] += apart(near, a, near->edge[total + k]) / count;
        }
        total += count;
    }
    near->edge_start[near->model->info.column_count] = total;
}

/// Columns within one or two edges, ROOM of a node at most.
static void find_neighbours(pal_near_field *near, int32_t edges) {
    int32_t total = 0;
    for (int32_t a = 0; a < near->model->info.column_count; a++) {
        int32_t *list = near->neighbour + total, count = 0;
        near->start[a] = total;
        for (int32_t k = near->edge_start[a]; k < near->edge_start[a + 1]; k++) {
            int32_t b = near->edge[k];
            count = insert(list, count, ROOM, b);
            for (int32_t l = near->edge_start[b]; edges > 1 && l < near->edge_start[b + 1]; l++) {
                count = near->edge[l] != a ? insert(list, count, ROOM, near->edge[l]) : count;
            }
        }
        total += count;
    }
    near->start[near->model->info.column_count] = total;
}

/// The next columns beyond the neighbours of a; the neighbours where there are none. @return how
/// many
static int32_t ring_around(const pal_near_field *near, int32_t a, int32_t *ring) {
    const int32_t *first = near->neighbour + near->start[a];
    int32_t firsts = near->start[a + 1] - near->start[a], count = 0;
    for (int32_t k = 0; k < firsts; k++) {
        for (int32_t l = near->start[first[k]]; l < near->start[first[k] + 1]; l++) {
            int32_t b = near->neighbour[l];
            if (b != a && !holds(first, firsts, b)) {
                count = insert(ring, count, RING, b);
            }
        }
    }
    for (int32_t k = 0; k < firsts && count == 0 && firsts <= RING; k++) {
        ring[k] = first[k];
    }
    return count > 0 ? count : firsts <= RING ? firsts : 0;
}

/// Symmetric part of the mean of R over the ring; a node by itself keeps what its share of the
/// surface does not explain.
static void find_regular(pal_near_field *near, int32_t a) {
    int32_t ring[RING], count = ring_around(near, a, ring);
    double mean[9] = {0.0}, c[9], g[9];
    for (int32_t k = 0; k < count; k++) {
        block_of(near->model, a, ring[k], c);
        pal_near_kernel(near, a, ring[k], g);
        for (int i = 0; i < 9; i++) {
            mean[i] += (c[i] - g[i]) / count;
        }
    }
    if (count == 0) {
        const double *v = near->model->area_vector + 3 * (size_t)near->model->column_node[a];
        double area = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
        double self = area > 0.0 ? PALPATE_NEAR_SELF / sqrt(area) : 0.0;
        const double *n = near->model->normal + 3 * (size_t)near->model->column_node[a];
        block_of(near->model, a, a, mean);
        for (int j = 0; j < 3; j++) {
            for (int i = 0; i < 3; i++) {
                mean[i + 3 * j] -= self * ((near->normal - near->tangent) * n[i] * n[j] +
                                           (i == j ? near->tangent : 0.0));
            }
        }
    }
    for (int j = 0; j < 3; j++) {
        for (int i = 0; i < 3; i++) {
            near->regular[9 * (size_t)a + (size_t)(i + 3 * j)] =
                0.5 * (mean[i + 3 * j] + mean[j + 3 * i]);
        }
    }
}

void pal_near_init(pal_near_field *near, const pal_model *model, const pal_rest_surface *surface,
                   int32_t edges, void *memory) {
    int32_t *column = NULL;
    double e = model->info.young, nu = model->info.poisson, pi = 3.14159265358979324;
    int known = e > 0.0 && isfinite(e) && fabs(nu) < 1.0;
    *near = (pal_near_field){.model = model,
                             .normal = known ? (1.0 - nu * nu) / (pi * e) : 0.0,
                             .tangent = known ? (1.0 + nu) * (1.0 - 0.5 * nu) / (pi * e) : 0.0};
    (void)place(model, near, &column, memory);
    for (int32_t i = 0; i < model->info.surface_count; i++) {
        column[i] = -1; // NOLINT(*.NullDereference): place() set it
    }
    for (int32_t a = 0; a < model->info.column_count; a++) {
        if (model->column_node[a] < model->info.surface_count) {
            column[model->column_node[a]] = a; // NOLINT(*.NullDereference): place() set it
        }
    }
    find_edges(near, surface, column);
    find_neighbours(near, edges);
    for (int32_t a = 0; a < model->info.column_count; a++) {
        find_regular(near, a);
    }
}

static int neighbours(const pal_near_field *near, int32_t a, int32_t b) {
    return holds(near->neighbour + near->start[a], near->start[a + 1] - near->start[a], b);
}

int pal_near_pair(const pal_near_field *near, int32_t a, int32_t b, double r[9]) {
    if (a != b && !neighbours(near, a, b) && !neighbours(near, b, a)) {
        return 0;
    }
    const double *x = near->regular + 9 * (size_t)a, *y = near->regular + 9 * (size_t)b;
    for (int i = 0; i < 9; i++) {
        r[i] = 0.5 * (x[i] + y[i]);
    }
    if (!near->model->info.certificate.symmetrized) { // what a raw model has of skew it keeps
        double c[9], d[9];
        block_of(near->model, a, b, c);
        block_of(near->model, b, a, d);
        for (int j = 0; j < 3; j++) {
            for (int i = 0; i < 3; i++) {
                r[i + 3 * j] += 0.5 * (c[i + 3 * j] - d[j + 3 * i]);
            }
        }
    }
    return 1;
}
