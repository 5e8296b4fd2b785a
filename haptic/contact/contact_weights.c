/// @file contact_weights.c  Surface moving least squares: candidates per triangle, weights at a
/// point.
///
/// With W = sum w_j, wn_j = w_j / W, q_j = tangential coordinates of node j about x over rho,
/// m = sum wn_j q_j and S = sum wn_j (q_j - m)(q_j - m)', the linear fit evaluated at x is
///
///     phi_j = wn_j (1 - (q_j - m)' (S + eps I)^-1 m),
///
/// sum phi_j = 1 for every eps; with eps = 0, sum phi_j q_j = 0, so linear fields are reproduced.
/// eps grows smoothly from 0 when the smaller eigenvalue of S falls below THIN (about 0.12 on
/// regular clouds): nodes on a line or a single one give the constant fit.
///
/// Candidates: whatever can be among the nearest K + 1 (or PALPATE_WEIGHTS_MAX + 1) nodes of any
/// point of the triangle lies in a ball around its middle; of those nodes, the ones that are
/// connected to the triangle by edges inside the ball.
#include <math.h>
#include <string.h>

#include "haptic/contact/contact_weights.h"
#include "haptic/base/block.h"
#include "haptic/base/vec.h"

enum { FLOOD = 384, SAMPLES = 7 };
static const double THIN = 0.004;

static int touchable(const pal_model *model, int32_t column) {
    return (model->node_flags[model->column_node[column]] & PALPATE_NODE_TOUCHABLE) != 0;
}

/// Touchable column of a surface node by bisection (columns ascend); -1: none.
static int32_t column_of(const pal_model *model, int32_t node) {
    int32_t low = 0, high = model->info.column_count - 1;
    while (low <= high) {
        int32_t middle = low + (high - low) / 2;
        if (model->column_node[middle] == node) {
            return touchable(model, middle) ? middle : -1;
        }
        if (model->column_node[middle] < node) {
            low = middle + 1;
        } else {
            high = middle - 1;
        }
    }
    return -1;
}

static int has_column(const pal_model *model, int32_t t) {
    const int32_t *v = model->triangle + 3 * (size_t)t;
    return column_of(model, v[0]) >= 0 || column_of(model, v[1]) >= 0 ||
           column_of(model, v[2]) >= 0;
}

static size_t place(const pal_model *model, pal_weights_table *table, int32_t **mark,
                    unsigned char *memory) {
    size_t triangles = (size_t)model->info.triangle_count, lists = 0, at = 0;
    for (int32_t t = 0; t < model->info.triangle_count; t++) {
        lists += (size_t)has_column(model, t);
    }
    PALPATE_BLOCK_PLACE(memory, at, table->list, triangles * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, table->near, lists * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, table->count, lists * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, table->candidate,
                        lists * PALPATE_WEIGHTS_CANDIDATES * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, table->away,
                        lists * PALPATE_WEIGHTS_CANDIDATES * sizeof(float));
    PALPATE_BLOCK_PLACE(memory, at, *mark, (size_t)model->info.surface_count * sizeof(int32_t));
    return at;
}

size_t pal_weights_bytes(const pal_model *model) {
    pal_weights_table table;
    int32_t *mark;
    return place(model, &table, &mark, NULL);
}

/// Fan normal (unit) at a point of a triangle.
static inline void normal_at(const pal_rest_surface *s, int32_t t, const double b[3], double n[3]) {
    const int32_t *v = s->triangle + 3 * (size_t)t;
    const double *n0 = s->node_normal + 3 * (size_t)v[0], *n1 = s->node_normal + 3 * (size_t)v[1],
                 *n2 = s->node_normal + 3 * (size_t)v[2];
    for (int i = 0; i < 3; i++) {
        n[i] = b[0] * n0[i] + b[1] * n1[i] + b[2] * n2[i];
    }
    double length = sqrt(v3_dot(n, n));
    for (int i = 0; i < 3 && length > 0.0; i++) {
        n[i] /= length;
    }
}

/// Position and fan normal at a point of a triangle, the position on the flat triangle.
static void sample(const pal_rest_surface *s, int32_t t, const double b[3], double x[3],
                   double n[3]) {
    const int32_t *v = s->triangle + 3 * (size_t)t;
    for (int i = 0; i < 3; i++) {
        x[i] = 0.0;
        for (int c = 0; c < 3; c++) {
            x[i] += b[c] * s->position[3 * (size_t)v[c] + (size_t)i];
        }
    }
    normal_at(s, t, b, n);
}

/// Distance used by the weights; HUGE_VAL for a node that faces the other way.
static inline double reach_of(const pal_rest_surface *s, int32_t node, const double x[3],
                              const double n[3]) {
    const double *y = s->position + 3 * (size_t)node, *m = s->node_normal + 3 * (size_t)node;
    double d[3] = {y[0] - x[0], y[1] - x[1], y[2] - x[2]}, facing = 1.0 + v3_dot(n, m);
    return facing > 1e-3 ? sqrt(v3_dot(d, d)) * 2.0 / facing : HUGE_VAL;
}

/// The k-th smallest (from 0) of r[0 .. count - 1]; reorders r. k < count.
static double kth(double *r, int32_t count, int32_t k) {
    int32_t low = 0, high = count - 1;
    while (low < high) {
        double pivot = r[low + (high - low) / 2];
        int32_t i = low, j = high;
        while (i <= j) {
            while (r[i] < pivot) {
                i++;
            }
            while (pivot < r[j]) {
                j--;
            }
            if (i <= j) {
                double swap = r[i];
                r[i++] = r[j];
                r[j--] = swap;
            }
        }
        if (k <= j) {
            high = j;
        } else if (k >= i) {
            low = i;
        } else {
            break;
        }
    }
    return r[k];
}

/// Support radius of `nodes` nodes: the distance of the next one; a little beyond the last where
/// there are no more.
static double support(const double *r, int32_t count, int32_t nodes, double *scratch) {
    memcpy(scratch, r, (size_t)count * sizeof(double));
    double next = nodes < count ? kth(scratch, count, nodes) : HUGE_VAL;
    if (next < HUGE_VAL) {
        return next;
    }
    double last = 0.0;
    for (int32_t k = 0; k < count; k++) {
        last = r[k] < HUGE_VAL ? fmax(last, r[k]) : last;
    }
    return 1.25 * last;
}

// ---- Candidates ---------------------------------------------------------------------------------

/// Touchable nodes within `radius` of x, connected to triangle t inside that ball. @return how many
static int32_t flood(const pal_weights_table *table, int32_t t, const double x[3], double radius,
                     int32_t *mark, int32_t stamp, int32_t *found) {
    const pal_rest_surface *s = table->surface;
    int32_t count = 0;
    for (int c = 0; c < 3; c++) {
        int32_t node = s->triangle[3 * (size_t)t + (size_t)c];
        mark[node] = stamp;
        found[count++] = node;
    }
    for (int32_t at = 0; at < count; at++) {
        for (int32_t k = s->fan_start[found[at]]; k < s->fan_start[found[at] + 1]; k++) {
            for (int c = 0; c < 3; c++) {
                int32_t j = s->triangle[3 * (size_t)(s->fan[k] / 3) + (size_t)c];
                const double *y = s->position + 3 * (size_t)j;
                double d[3] = {y[0] - x[0], y[1] - x[1], y[2] - x[2]};
                if (mark[j] != stamp && count < FLOOD && v3_dot(d, d) <= radius * radius) {
                    mark[j] = stamp;
                    found[count++] = j;
                }
            }
        }
    }
    int32_t kept = 0;
    for (int32_t k = 0; k < count; k++) {
        if (column_of(table->model, found[k]) >= 0) {
            found[kept++] = found[k];
        }
    }
    return kept;
}

/// Largest distance from the triangle's middle x at which a node can be among the nearest `nodes` +
/// 1 of one of its points, by samples and a margin.
static double needed(const pal_rest_surface *s, int32_t t, const double x[3], const int32_t *found,
                     int32_t count, int32_t nodes) {
    static const double at[SAMPLES][3] = {{1, 0, 0},     {0, 1, 0},     {0, 0, 1}, {0.5, 0.5, 0},
                                          {0, 0.5, 0.5}, {0.5, 0, 0.5}, {1, 1, 1}};
    double most = 0.0, size = 0.0, r[FLOOD], scratch[FLOOD];
    for (int k = 0; k < SAMPLES; k++) {
        double y[3], n[3], sum = at[k][0] + at[k][1] + at[k][2];
        double b[3] = {at[k][0] / sum, at[k][1] / sum, at[k][2] / sum};
        sample(s, t, b, y, n);
        for (int32_t i = 0; i < count; i++) {
            r[i] = reach_of(s, found[i], y, n);
        }
        double d[3] = {y[0] - x[0], y[1] - x[1], y[2] - x[2]}, away = sqrt(v3_dot(d, d));
        size = fmax(size, away);
        most = fmax(most, away + support(r, count, nodes, scratch));
    }
    return most + 0.4 * size;
}

/// Candidates for `nodes` nodes around the triangle's middle. @return how many; *radius: of the
/// ball
static int32_t gather(const pal_weights_table *table, int32_t t, const double x[3], int32_t nodes,
                      int32_t *mark, int32_t *stamp, int32_t *found, double *radius) {
    const pal_rest_surface *s = table->surface;
    int32_t count = 0;
    for (int c = 0; c < 3; c++) {
        const double *y = s->position + 3 * (size_t)s->triangle[3 * (size_t)t + (size_t)c];
        double d[3] = {y[0] - x[0], y[1] - x[1], y[2] - x[2]};
        *radius = fmax(*radius, 2.0 * sqrt(v3_dot(d, d)));
    }
    for (int n = 0; n < 12; n++) {
        count = flood(table, t, x, *radius, mark, ++*stamp, found);
        double more = needed(s, t, x, found, count, nodes);
        if (count > nodes && more <= *radius) {
            break;
        }
        *radius = fmax(1.3 * *radius, fmin(more, 1.6 * *radius));
    }
    return count;
}

static double away(const pal_rest_surface *s, int32_t node, const double x[3]) {
    const double *y = s->position + 3 * (size_t)node;
    double d[3] = {y[0] - x[0], y[1] - x[1], y[2] - x[2]};
    return v3_dot(d, d);
}

static void fill_list(pal_weights_table *table, int32_t t, int32_t list, int32_t *mark,
                      int32_t *stamp) {
    const pal_rest_surface *s = table->surface;
    const double third[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3};
    double x[3], n[3], near = 0.0, far;
    int32_t found[FLOOD];
    sample(s, t, third, x, n);
    (void)gather(table, t, x, table->nodes, mark, stamp, found, &near);
    far = near;
    int32_t count = gather(table, t, x, PALPATE_WEIGHTS_MAX, mark, stamp, found, &far);
    for (int32_t i = 1; i < count; i++) { // nearest first, ties by node
        int32_t node = found[i], j = i;
        double r = away(s, node, x);
        while (j > 0 && (away(s, found[j - 1], x) > r ||
                         (away(s, found[j - 1], x) >= r && found[j - 1] > node))) {
            found[j] = found[j - 1];
            j--;
        }
        found[j] = node;
    }
    count = count < PALPATE_WEIGHTS_CANDIDATES ? count : PALPATE_WEIGHTS_CANDIDATES;
    table->count[list] = count;
    table->near[list] = 0;
    for (int32_t i = 0; i < count; i++) {
        table->near[list] += away(s, found[i], x) <= near * near;
        table->candidate[(size_t)list * PALPATE_WEIGHTS_CANDIDATES + (size_t)i] =
            column_of(table->model, found[i]);
        table->away[(size_t)list * PALPATE_WEIGHTS_CANDIDATES + (size_t)i] =
            (float)(sqrt(away(s, found[i], x)) * (1.0 - 1e-6)); // a lower bound in single too
    }
}

void pal_weights_init(pal_weights_table *table, const pal_model *model,
                      const pal_rest_surface *surface, int32_t nodes, int32_t power, void *memory) {
    int32_t *mark = NULL, lists = 0, stamp = 0;
    *table =
        (pal_weights_table){.surface = surface, .model = model, .nodes = nodes, .power = power};
    (void)place(model, table, &mark, memory);
    // NOLINTNEXTLINE(*.NonNullParamChecker): place() set it
    memset(mark, 0, (size_t)surface->node_count * sizeof *mark);
    for (int32_t t = 0; t < surface->triangle_count; t++) {
        table->list[t] = -1;
        if (has_column(model, t)) {
            fill_list(table, t, lists, mark, &stamp);
            table->list[t] = lists++;
        }
    }
}

// ---- Weights ------------------------------------------------------------------------------------

static double power_of(double x, int32_t p) {
    double y = x;
    for (int32_t k = 1; k < p; k++) {
        y *= x;
    }
    return y;
}

/// Two unit vectors across n.
static void tangents(const double n[3], double u[3], double v[3]) {
    int i = fabs(n[1]) < fabs(n[0]) ? 1 : 0;
    i = fabs(n[2]) < fabs(n[i]) ? 2 : i;
    double e[3] = {0.0, 0.0, 0.0};
    e[i] = 1.0;
    for (int c = 0; c < 3; c++) {
        u[c] = e[c] - n[i] * n[c];
    }
    double length = sqrt(v3_dot(u, u));
    for (int c = 0; c < 3; c++) {
        u[c] /= length;
    }
    v[0] = n[1] * u[2] - n[2] * u[1];
    v[1] = n[2] * u[0] - n[0] * u[2];
    v[2] = n[0] * u[1] - n[1] * u[0];
}

/// phi from the weights in out->phi and coordinates q: the formula at the top of the file.
static void fit(pal_weights *out, double q[][2]) {
    double total = 0.0, m[2] = {0.0, 0.0}, a = 0.0, b = 0.0, c = 0.0;
    for (int32_t k = 0; k < out->count; k++) {
        total += out->phi[k];
    }
    for (int32_t k = 0; k < out->count; k++) {
        out->phi[k] /= total;
        m[0] += out->phi[k] * q[k][0];
        m[1] += out->phi[k] * q[k][1];
    }
    for (int32_t k = 0; k < out->count; k++) {
        double x = q[k][0] - m[0], y = q[k][1] - m[1];
        a += out->phi[k] * x * x;
        b += out->phi[k] * x * y;
        c += out->phi[k] * y * y;
    }
    out->sigma = out->radius * sqrt(0.5 * (a + c));
    double low = 0.5 * (a + c) - sqrt(0.25 * (a - c) * (a - c) + b * b);
    double ridge = low < THIN ? (THIN - low) * (THIN - low) / THIN : 0.0;
    a += ridge;
    c += ridge;
    double det = a * c - b * b;
    double s[2] = {(c * m[0] - b * m[1]) / det, (a * m[1] - b * m[0]) / det};
    for (int32_t k = 0; k < out->count; k++) {
        out->phi[k] *= 1.0 - (q[k][0] - m[0]) * s[0] - (q[k][1] - m[1]) * s[1];
    }
}

/// The candidates that count, and how far they are.
typedef struct nearest {
    int32_t count;
    int32_t column[PALPATE_WEIGHTS_MAX + 1];
    double r[PALPATE_WEIGHTS_MAX + 1];
} nearest;

/// Place of the largest r, without a branch to guess wrong.
static int32_t farthest(const nearest *n) {
    int32_t far = 0;
    double r = n->r[0];
    for (int32_t k = 1; k < n->count; k++) {
        far = n->r[k] > r ? k : far;
        r = n->r[k] > r ? n->r[k] : r;
    }
    return far;
}

/// The `nodes` + 1 nearest of a triangle's candidates (fewer where more face the other way).
/// Candidates come by their distance from the triangle's middle, so that the rest of them is too
/// far once that is; r is not less than the plain distance, which costs no root.
/// @return support radius: the largest r; a little beyond it where there are no more nodes
static double find_nearest(const pal_weights_table *table, const pal_surface_point *at,
                           const double n[3], int32_t list, nearest *out) {
    const pal_rest_surface *s = table->surface;
    const int32_t *candidate = table->candidate + (size_t)list * PALPATE_WEIGHTS_CANDIDATES;
    const float *apart = table->away + (size_t)list * PALPATE_WEIGHTS_CANDIDATES;
    const int32_t *v = s->triangle + 3 * (size_t)at->triangle;
    const double slack = 1.0 + 1e-9, *x = at->position; // above all rounding
    const double *p0 = s->position + 3 * (size_t)v[0], *p1 = s->position + 3 * (size_t)v[1],
                 *p2 = s->position + 3 * (size_t)v[2];
    int32_t most = table->nodes + 1, near = table->near[list], k = 0, last = 0;
    out->count = 0;
    for (; k < near && out->count < most; k++) {
        double r = reach_of(s, table->model->column_node[candidate[k]], x, n);
        out->r[out->count] = r;
        out->column[out->count] = candidate[k];
        out->count += r < HUGE_VAL ? 1 : 0;
    }
    if (out->count == 0) {
        return 0.0;
    }
    last = farthest(out);
    if (out->count < most) {
        return 1.25 * out->r[last];
    }
    double square = 0.0, third = 1.0 / 3.0;
    for (int i = 0; i < 3; i++) {
        double d = x[i] - (p0[i] + p1[i] + p2[i]) * third;
        square += d * d;
    }
    double off = sqrt(square) * slack, most_r = out->r[last], limit = most_r * slack + off;
    for (; k < near && (double)apart[k] <= limit; k++) {
        int32_t node = table->model->column_node[candidate[k]];
        const double *y = s->position + 3 * (size_t)node;
        double d[3] = {y[0] - x[0], y[1] - x[1], y[2] - x[2]};
        if (v3_dot(d, d) > most_r * most_r * slack) {
            continue;
        }
        double r = reach_of(s, node, x, n);
        if (r < most_r) {
            out->r[last] = r;
            out->column[last] = candidate[k];
            last = farthest(out);
            most_r = out->r[last];
            limit = most_r * slack + off;
        }
    }
    return most_r;
}

/// The same of all candidates, for a support radius wanted: those within it.
static double find_within(const pal_weights_table *table, const pal_surface_point *at,
                          const double n[3], int32_t list, double radius, nearest *out) {
    const int32_t *candidate = table->candidate + (size_t)list * PALPATE_WEIGHTS_CANDIDATES;
    double r[PALPATE_WEIGHTS_CANDIDATES] = {0.0}, scratch[PALPATE_WEIGHTS_CANDIDATES];
    int32_t count = table->count[list];
    for (int32_t k = 0; k < count; k++) {
        r[k] = reach_of(table->surface, table->model->column_node[candidate[k]], at->position, n);
    }
    double own = support(r, count, table->nodes, scratch);
    if (radius > own) {
        own = fmax(own, fmin(radius, support(r, count, PALPATE_WEIGHTS_MAX, scratch)));
    }
    out->count = 0;
    for (int32_t k = 0; k < count && out->count <= PALPATE_WEIGHTS_MAX; k++) {
        if (r[k] <= own) {
            out->r[out->count] = r[k];
            out->column[out->count++] = candidate[k];
        }
    }
    return own;
}

int32_t pal_weights_at(const pal_weights_table *table, const pal_surface_point *at, double radius,
                       pal_weights *out) {
    const pal_rest_surface *s = table->surface;
    const pal_model *model = table->model;
    double n[3], u[3], v[3];
    double q[PALPATE_WEIGHTS_MAX][2];
    nearest found;
    out->count = 0;
    out->sigma = out->radius = 0.0;
    int32_t list = at->triangle >= 0 ? table->list[at->triangle] : -1;
    if (list < 0) {
        return 0;
    }
    normal_at(s, at->triangle, at->weight, n);
    out->radius = radius > 0.0 ? find_within(table, at, n, list, radius, &found)
                               : find_nearest(table, at, n, list, &found);
    double over = out->radius > 0.0 ? 1.0 / out->radius : 0.0;
    int32_t kept = 0;
    for (int32_t k = 0; k < found.count; k++) { // by r: z may round down
        double z = found.r[k] * over;
        found.r[kept] = found.r[k];
        found.column[kept] = found.column[k];
        kept += 1.0 - z * z > 0.0 && (!(over > 0.0) || found.r[k] < out->radius);
    }
    out->count = kept < PALPATE_WEIGHTS_MAX ? kept : PALPATE_WEIGHTS_MAX;
    tangents(n, u, v);
    for (int32_t k = 0; k < out->count; k++) { // by column: counted, not sorted, without guessing
        int32_t column = found.column[k], slot = 0;
        for (int32_t l = 0; l < out->count; l++) {
            slot += found.column[l] < column;
        }
        double z = found.r[k] * over;
        const double *y = model->position + 3 * (size_t)model->column_node[column];
        double d[3] = {y[0] - at->position[0], y[1] - at->position[1], y[2] - at->position[2]};
        out->column[slot] = column;
        out->phi[slot] = power_of(1.0 - z * z, table->power);
        q[slot][0] = over * v3_dot(d, u);
        q[slot][1] = over * v3_dot(d, v);
    }
    if (out->count > 0) {
        fit(out, q);
    }
    return out->count;
}

void pal_weights_fetch(const pal_weights_table *table, int32_t triangle) {
    int32_t list = table->list[triangle];
    for (int32_t k = 0; list >= 0 && k < 32; k += 16) { // two lines of each: most look no farther
        size_t at = (size_t)list * PALPATE_WEIGHTS_CANDIDATES + (size_t)k;
        __builtin_prefetch(table->candidate + at);
        __builtin_prefetch(table->away + at);
    }
}
