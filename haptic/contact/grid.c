/// @file grid.c  Uniform grid over the rest positions of touchable nodes (counting sort by cell).
#include "haptic/contact/grid.h"
#include "haptic/base/block.h"

#include <math.h>
#include <string.h>

enum { CELLS_MAX = 32768 };

static int touchable(const pal_model *model, int32_t column) {
    return (model->node_flags[model->column_node[column]] & PALPATE_NODE_TOUCHABLE) != 0;
}

static int32_t touchable_count(const pal_model *model) {
    int32_t count = 0;
    for (int32_t j = 0; j < model->info.column_count; j++) {
        count += touchable(model, j);
    }
    return count;
}

/// Box, cell size and cell counts; the box is never empty and has at most CELLS_MAX cells.
static void layout(const pal_model *model, pal_grid *grid) {
    double high[3];
    int first = 1;
    for (int i = 0; i < 3; i++) {
        grid->low[i] = high[i] = 0.0;
    }
    for (int32_t j = 0; j < model->info.column_count; j++) {
        if (!touchable(model, j)) {
            continue;
        }
        const double *x = model->position + 3 * (size_t)model->column_node[j];
        for (int i = 0; i < 3; i++) {
            grid->low[i] = first ? x[i] : fmin(grid->low[i], x[i]);
            high[i] = first ? x[i] : fmax(high[i], x[i]);
        }
        first = 0;
    }
    double extent =
        fmax(high[0] - grid->low[0], fmax(high[1] - grid->low[1], high[2] - grid->low[2]));
    // about two nodes per cell on a surface: the area of a bounding face over half the count
    int32_t count = touchable_count(model);
    grid->cell = count > 0 ? extent * sqrt(2.0 / count) : 0.0;
    if (!(grid->cell > 0.0)) {
        grid->cell = 1.0;
    }
    for (;;) {
        double cells = 1.0;
        for (int i = 0; i < 3; i++) {
            double n = floor((high[i] - grid->low[i]) / grid->cell) + 1.0;
            grid->size[i] = n < 1e6 ? (int32_t)n : 1000000;
            cells *= grid->size[i];
        }
        if (cells <= CELLS_MAX) {
            return;
        }
        grid->cell *= 1.25;
    }
}

static size_t cell_count(const pal_grid *grid) {
    return (size_t)grid->size[0] * (size_t)grid->size[1] * (size_t)grid->size[2];
}

size_t pal_grid_bytes(const pal_model *model) {
    pal_grid grid;
    layout(model, &grid);
    size_t n = (size_t)touchable_count(model);
    return 2 * pal_block_padded(n * sizeof(int32_t)) +
           2 * pal_block_padded(3 * n * sizeof(double)) + pal_block_padded(n * sizeof(double)) +
           pal_block_padded((cell_count(&grid) + 1) * sizeof(int32_t));
}

static int32_t cell_along(const pal_grid *grid, double x, int i) {
    double at = floor((x - grid->low[i]) / grid->cell);
    if (!(at > 0.0)) {
        return 0;
    }
    return at < grid->size[i] - 1 ? (int32_t)at : grid->size[i] - 1;
}

static int32_t cell_of(const pal_grid *grid, const double x[3]) {
    return cell_along(grid, x[0], 0) +
           grid->size[0] * (cell_along(grid, x[1], 1) + grid->size[1] * cell_along(grid, x[2], 2));
}

/// No point of a triangle is farther from its nearest corner than its longest edge / sqrt(3) when
/// it is equilateral; 0.6 leaves a little for the others. Nodes without triangles get the mean
/// spacing.
static void find_reach(const pal_model *model, pal_grid *grid) {
    for (int32_t a = 0; a < grid->count; a++) {
        grid->reach[a] = 0.0;
    }
    for (int32_t t = 0; t < model->info.triangle_count; t++) {
        const int32_t *corner = model->triangle + 3 * (size_t)t;
        double longest = 0.0;
        for (int e = 0; e < 3; e++) {
            const double *p = model->position + 3 * (size_t)corner[e];
            const double *q = model->position + 3 * (size_t)corner[(e + 1) % 3];
            double v[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
            longest = fmax(longest, sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]));
        }
        for (int e = 0; e < 3; e++) { // binary search: columns ascend
            int32_t lo = 0, hi = grid->count - 1;
            while (lo <= hi) {
                int32_t mid = lo + (hi - lo) / 2, node = model->column_node[grid->column[mid]];
                if (node == corner[e]) {
                    grid->reach[mid] = fmax(grid->reach[mid], 0.6 * longest);
                    break;
                }
                if (node < corner[e]) {
                    lo = mid + 1;
                } else {
                    hi = mid - 1;
                }
            }
        }
    }
    grid->reach_max = 0.0;
    for (int32_t a = 0; a < grid->count; a++) {
        if (!(grid->reach[a] > 0.0)) {
            grid->reach[a] =
                model->info.spacing_mean > 0.0 ? 0.6 * model->info.spacing_mean : 0.6 * grid->cell;
        }
        grid->reach_max = fmax(grid->reach_max, grid->reach[a]);
    }
}

void pal_grid_init(pal_grid *grid, const pal_model *model, void *memory) {
    layout(model, grid);
    grid->count = touchable_count(model);
    size_t n = (size_t)grid->count;
    unsigned char *at = memory;
    grid->position = (double *)(void *)at;
    at += pal_block_padded(3 * n * sizeof(double));
    grid->normal = (double *)(void *)at;
    at += pal_block_padded(3 * n * sizeof(double));
    grid->reach = (double *)(void *)at;
    at += pal_block_padded(n * sizeof(double));
    grid->column = (int32_t *)(void *)at;
    at += pal_block_padded(n * sizeof(int32_t));
    grid->node = (int32_t *)(void *)at;
    at += pal_block_padded(n * sizeof(int32_t));
    grid->start = (int32_t *)(void *)at;

    int32_t a = 0;
    for (int32_t j = 0; j < model->info.column_count; j++) {
        if (touchable(model, j)) {
            size_t node = (size_t)model->column_node[j];
            grid->column[a] = j;
            memcpy(grid->position + 3 * (size_t)a, model->position + 3 * node, 3 * sizeof(double));
            memcpy(grid->normal + 3 * (size_t)a, model->normal + 3 * node, 3 * sizeof(double));
            a++;
        }
    }
    find_reach(model, grid);

    size_t cells = cell_count(grid);
    memset(grid->start, 0, (cells + 1) * sizeof(int32_t));
    for (a = 0; a < grid->count; a++) {
        grid->start[cell_of(grid, grid->position + 3 * (size_t)a) + 1]++;
    }
    for (size_t c = 0; c < cells; c++) {
        grid->start[c + 1] += grid->start[c];
    }
    for (a = 0; a < grid->count; a++) { // start[c] runs to the end of its cell ...
        grid->node[grid->start[cell_of(grid, grid->position + 3 * (size_t)a)]++] = a;
    }
    for (size_t c = cells; c > 0; c--) { // ... and is moved back
        grid->start[c] = grid->start[c - 1];
    }
    grid->start[0] = 0;
}

int32_t pal_grid_query(const pal_grid *grid, const double low[3], const double high[3],
                       int32_t *out) {
    int32_t from[3], to[3], found = 0;
    for (int i = 0; i < 3; i++) {
        if (!(low[i] <= high[i])) {
            return 0; // also when not a number
        }
        from[i] = cell_along(grid, low[i], i);
        to[i] = cell_along(grid, high[i], i);
    }
    for (int32_t z = from[2]; z <= to[2]; z++) {
        for (int32_t y = from[1]; y <= to[1]; y++) {
            int32_t row = grid->size[0] * (y + grid->size[1] * z);
            for (int32_t k = grid->start[row + from[0]]; k < grid->start[row + to[0] + 1]; k++) {
                const double *x = grid->position + 3 * (size_t)grid->node[k];
                if (x[0] >= low[0] && x[0] <= high[0] && x[1] >= low[1] && x[1] <= high[1] &&
                    x[2] >= low[2] && x[2] <= high[2]) {
                    out[found++] = grid->node[k];
                }
            }
        }
    }
    return found;
}
