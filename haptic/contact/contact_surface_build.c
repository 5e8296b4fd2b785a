/// @file contact_surface_build.c  Building the smooth rest surface: neighbours, sectors, bends,
/// boxes.
///
/// Corner normals: sum over the corner's sector of e1 x e2 / (|e1|^2 |e2|^2), the weights of Max
/// 1999
/// ("Weights for computing vertex normals from facet normals"), exact for nodes on a sphere.
/// Bend of an edge from i to j, e = p_j - p_i:  c = -1/2 (P_i e - P_j e), P_i the projection on the
/// corner normals of both sides at i: one normal on smooth edges (Boubekeur and Alexa 2008, alpha =
/// 1/2), two on sharp ones, where the edge's own curve then follows both faces (a hemisphere's rim
/// becomes round from either side).
/// Inside: each node keeps the nearest boundary edge that its neighbours know of (label
/// correcting).
#include <math.h>
#include <string.h>

#include "haptic/base/block.h"
#include "haptic/contact/contact_surface.h"
#include "haptic/base/vec.h"

enum { LEAF = 3 };
static const double SHARP = 0.766044443118978; // cos 40 degrees

typedef struct build {
    pal_rest_surface *s;
    const pal_model *model;
    int32_t *queue; ///< nodes, shape [node_count]
    int32_t *edge;  ///< nearest boundary edge 3 t + e of a node, -1; shape [node_count]
    uint8_t *flag;  ///< column of the node is touchable; later: node is in the queue; [node_count]
} build;

static size_t place(const pal_model *model, pal_rest_surface *s, build *b, unsigned char *memory) {
    size_t t = (size_t)model->info.triangle_count, n = (size_t)model->info.surface_count, at = 0;
    PALPATE_BLOCK_PLACE(memory, at, s->corner_normal, 9 * t * sizeof(double));
    PALPATE_BLOCK_PLACE(memory, at, s->bend, 9 * t * sizeof(double));
    PALPATE_BLOCK_PLACE(memory, at, s->node_normal, 3 * n * sizeof(double));
    PALPATE_BLOCK_PLACE(memory, at, s->inside, n * sizeof(double));
    PALPATE_BLOCK_PLACE(memory, at, s->box, (2 * t + 1) * sizeof(pal_rest_box));
    PALPATE_BLOCK_PLACE(memory, at, s->across, 3 * t * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, s->order, t * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, s->touchable, t);
    PALPATE_BLOCK_PLACE(memory, at, s->sharp, t);
    PALPATE_BLOCK_PLACE(memory, at, s->fan_start, (n + 1) * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, s->fan, 3 * t * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, b->queue, n * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, b->edge, n * sizeof(int32_t));
    PALPATE_BLOCK_PLACE(memory, at, b->flag, n);
    return at;
}

size_t pal_rest_bytes(const pal_model *model) {
    pal_rest_surface s;
    build b;
    return place(model, &s, &b, NULL);
}

// ---- Small helpers ------------------------------------------------------------------------------

/// v / |v|; 0 stays 0. @return |v|
static double unit(double v[3]) {
    double length = sqrt(v3_dot(v, v));
    for (int i = 0; i < 3 && length > 0.0; i++) {
        v[i] /= length;
    }
    return length;
}

static const double *node_at(const pal_rest_surface *s, int32_t t, int c) {
    return s->position + 3 * (size_t)s->triangle[3 * (size_t)t + (size_t)c];
}

static double *corner_at(const pal_rest_surface *s, int32_t t, int c) {
    return s->corner_normal + 9 * (size_t)t + 3 * (size_t)c;
}

/// Edges from corner c to the next two, and their cross product (twice the area vector).
static void corner_edges(const pal_rest_surface *s, int32_t t, int c, double u[3], double v[3],
                         double area[3]) {
    const double *p = node_at(s, t, c), *q = node_at(s, t, (c + 1) % 3);
    const double *r = node_at(s, t, (c + 2) % 3);
    for (int i = 0; i < 3; i++) {
        u[i] = q[i] - p[i];
        v[i] = r[i] - p[i];
    }
    v3_cross(u, v, area);
}

// ---- Neighbours ---------------------------------------------------------------------------------

static void list_corners(build *b) {
    pal_rest_surface *s = b->s;
    size_t corners = 3 * (size_t)s->triangle_count;
    memset(b->s->fan_start, 0, ((size_t)s->node_count + 1) * sizeof(int32_t));
    for (size_t k = 0; k < corners; k++) {
        b->s->fan_start[s->triangle[k] + 1]++;
    }
    for (int32_t i = 0; i < s->node_count; i++) {
        b->s->fan_start[i + 1] += b->s->fan_start[i];
    }
    for (size_t k = 0; k < corners; k++) { // start[i] runs to the end of its range ...
        b->s->fan[b->s->fan_start[s->triangle[k]]++] = (int32_t)k;
    }
    for (int32_t i = s->node_count; i > 0; i--) { // ... and is moved back
        b->s->fan_start[i] = b->s->fan_start[i - 1];
    }
    b->s->fan_start[0] = 0;
}

/// Edge 3 t + e that runs from node i to node j, other than `self`; -1: none; -2: several.
static int32_t find_edge(const build *b, int32_t i, int32_t j, int32_t self) {
    int32_t found = -1;
    for (int32_t k = b->s->fan_start[i]; k < b->s->fan_start[i + 1]; k++) {
        int32_t corner = b->s->fan[k], t = corner / 3, next = 3 * t + (corner + 1 - 3 * t) % 3;
        if (b->s->triangle[next] == j && corner != self) {
            found = found == -1 ? corner : -2;
        }
    }
    return found;
}

/// Across each edge, the one triangle that has it in the other direction; where an edge has more
/// than two triangles, or two of the same direction, the surface is open.
static void find_across(build *b) {
    pal_rest_surface *s = b->s;
    for (int32_t t = 0; t < s->triangle_count; t++) {
        for (int e = 0; e < 3; e++) {
            int32_t self = 3 * t + e, i = s->triangle[self], j = s->triangle[3 * t + (e + 1) % 3];
            int32_t other = find_edge(b, j, i, -1);
            s->across[self] = other >= 0 && find_edge(b, i, j, self) == -1 ? other : -1;
        }
    }
}

static void find_sharp(pal_rest_surface *s) {
    memset(s->sharp, 0, (size_t)s->triangle_count);
    for (int32_t t = 0; t < s->triangle_count; t++) {
        double u[3], v[3], n[3], m[3];
        corner_edges(s, t, 0, u, v, n);
        for (int e = 0; e < 3; e++) {
            int32_t other = s->across[3 * t + e];
            if (other >= 0) {
                corner_edges(s, other / 3, 0, u, v, m);
                double size = sqrt(v3_dot(n, n) * v3_dot(m, m));
                s->sharp[t] |= (uint8_t)((size > 0.0 && v3_dot(n, m) < SHARP * size) << e);
            }
        }
    }
}

// ---- Normals ------------------------------------------------------------------------------------

/// The next corner around the same node, counter-clockwise (step 1) or clockwise (-1); -1 at a
/// sharp edge or where the surface ends.
static int32_t turn(const pal_rest_surface *s, int32_t corner, int step) {
    int32_t t = corner / 3, c = corner - 3 * t, e = step > 0 ? (c + 2) % 3 : c;
    int32_t other = s->across[3 * t + e];
    if (other < 0 || (s->sharp[t] >> e) & 1) {
        return -1;
    }
    int32_t u = other / 3;
    return step > 0 ? other : 3 * u + (other - 3 * u + 1) % 3;
}

/// First corner of the sector that holds `corner`: after a sharp edge; in a closed fan, the lowest.
static int32_t sector_start(const pal_rest_surface *s, int32_t corner, int32_t limit) {
    int32_t at = corner, lowest = corner;
    for (int32_t k = 0; k < limit; k++) {
        int32_t before = turn(s, at, -1);
        if (before < 0) {
            return at;
        }
        at = before;
        if (at == corner) {
            return lowest;
        }
        lowest = at < lowest ? at : lowest;
    }
    return lowest;
}

static void sector_normal(const pal_rest_surface *s, int32_t first, int32_t limit, double n[3]) {
    n[0] = n[1] = n[2] = 0.0;
    int32_t at = first;
    for (int32_t k = 0; k < limit && at >= 0; k++) {
        double u[3], v[3], area[3];
        corner_edges(s, at / 3, at % 3, u, v, area);
        double weight = v3_dot(u, u) * v3_dot(v, v);
        for (int i = 0; i < 3 && weight > 0.0; i++) {
            n[i] += area[i] / weight;
        }
        at = turn(s, at, 1);
        if (at == first) {
            break;
        }
    }
}

/// The angle of (x, y), y >= 0, from 0 to pi. Not atan2(): libm's last bit depends on its version
/// and on the processor, and with it every force. Half-angle steps, then the series below tan(pi /
/// 32): each operation here is rounded correctly, so all machines agree; within 1e-15 of the angle.
static double angle_of(double y, double x) {
    double reach = sqrt(x * x + y * y), t = y / (reach + fabs(x)); // tan(angle / 2) of |x|
    if (!(reach > 0.0)) {
        return 0.0;
    }
    for (int i = 0; i < 3; i++) {
        t = t / (1.0 + sqrt(1.0 + t * t));
    }
    double square = t * t, sum = 0.0;
    for (int k = 15; k >= 1; k -= 2) {
        sum = 1.0 / k - square * sum;
    }
    double angle = 16.0 * t * sum;
    return x < 0.0 ? 3.14159265358979323846 - angle : angle;
}

/// Normals of corners by sector, of nodes by angle over the whole fan (which do not know of edges).
static void find_normals(build *b) {
    pal_rest_surface *s = b->s;
    memset(s->node_normal, 0, 3 * (size_t)s->node_count * sizeof(double));
    for (int32_t i = 0; i < s->node_count; i++) {
        int32_t limit = b->s->fan_start[i + 1] - b->s->fan_start[i];
        double *fan = s->node_normal + 3 * (size_t)i;
        for (int32_t k = b->s->fan_start[i]; k < b->s->fan_start[i + 1]; k++) {
            int32_t corner = b->s->fan[k];
            double u[3], v[3], area[3], *n = corner_at(s, corner / 3, corner % 3);
            sector_normal(s, sector_start(s, corner, limit), limit, n);
            corner_edges(s, corner / 3, corner % 3, u, v, area);
            double angle = angle_of(sqrt(v3_dot(area, area)), v3_dot(u, v));
            unit(area);
            for (int c = 0; c < 3; c++) {
                fan[c] += angle * area[c];
            }
            if (!(unit(n) > 0.0)) {
                memcpy(n, area, sizeof area); // a triangle without area keeps a normal of length 0
            }
        }
        unit(fan);
    }
}

/// out = (projection on span(a, b)) e, a and b unit.
static void project_on(const double a[3], const double b[3], const double e[3], double out[3]) {
    double more[3], along = v3_dot(a, b), in = v3_dot(a, e);
    for (int i = 0; i < 3; i++) {
        more[i] = b[i] - along * a[i];
        out[i] = in * a[i];
    }
    if (unit(more) > 1e-6) {
        double rest = v3_dot(more, e);
        for (int i = 0; i < 3; i++) {
            out[i] += rest * more[i];
        }
    }
}

static void find_bends(pal_rest_surface *s) {
    for (int32_t t = 0; t < s->triangle_count; t++) {
        for (int e = 0; e < 3; e++) {
            int next = (e + 1) % 3;
            const double *p = node_at(s, t, e), *q = node_at(s, t, next);
            const double *ni = corner_at(s, t, e), *nj = corner_at(s, t, next), *mi = ni, *mj = nj;
            int32_t other = s->across[3 * t + e];
            if (other >= 0) {
                mj = corner_at(s, other / 3, other % 3);
                mi = corner_at(s, other / 3, (other + 1 - other / 3 * 3) % 3);
            }
            double edge[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]}, pi[3], pj[3];
            project_on(ni, mi, edge, pi);
            project_on(nj, mj, edge, pj);
            for (int i = 0; i < 3; i++) {
                s->bend[9 * (size_t)t + 3 * (size_t)e + (size_t)i] = -0.5 * (pi[i] - pj[i]);
            }
        }
    }
}

// ---- Touchable region ---------------------------------------------------------------------------

static double body_size(const pal_model *model) {
    const double *low = model->info.bounds_min, *high = model->info.bounds_max;
    double box[3] = {high[0] - low[0], high[1] - low[1], high[2] - low[2]};
    return sqrt(v3_dot(box, box));
}

static double edge_distance(const pal_rest_surface *s, int32_t edge, const double x[3]) {
    int32_t t = edge / 3;
    const double *p = node_at(s, t, edge - 3 * t), *q = node_at(s, t, (edge + 1 - 3 * t) % 3);
    double e[3] = {q[0] - p[0], q[1] - p[1], q[2] - p[2]};
    double d[3] = {x[0] - p[0], x[1] - p[1], x[2] - p[2]}, length = v3_dot(e, e);
    double along = length > 0.0 ? fmin(fmax(v3_dot(d, e) / length, 0.0), 1.0) : 0.0;
    for (int i = 0; i < 3; i++) {
        d[i] -= along * e[i];
    }
    return sqrt(v3_dot(d, d));
}

/// Mark triangles with three touchable columns, and queue the nodes of the edges around them.
static int32_t find_boundary(build *b) {
    pal_rest_surface *s = b->s;
    const pal_model *model = b->model;
    memset(b->flag, 0, (size_t)s->node_count); // NOLINT(*.NonNullParamChecker): place() set it
    for (int32_t j = 0; j < model->info.column_count; j++) {
        int32_t node = model->column_node[j];
        if (node < s->node_count) {
            b->flag[node] = (model->node_flags[node] & PALPATE_NODE_TOUCHABLE) != 0;
        }
    }
    for (int32_t t = 0; t < s->triangle_count; t++) {
        const int32_t *v = s->triangle + 3 * (size_t)t;
        s->touchable[t] = b->flag[v[0]] & b->flag[v[1]] & b->flag[v[2]];
    }
    memset(b->flag, 0, (size_t)s->node_count);
    int32_t queued = 0;
    for (int32_t t = 0; t < s->triangle_count; t++) {
        for (int e = 0; e < 3 && s->touchable[t]; e++) {
            int32_t other = s->across[3 * t + e];
            if (other >= 0 && s->touchable[other / 3]) {
                continue;
            }
            for (int k = 0; k < 2; k++) {
                int32_t i = s->triangle[3 * (size_t)t + (size_t)((e + k) % 3)];
                s->inside[i] = 0.0;
                b->edge[i] = 3 * t + e;
                if (!b->flag[i]) {
                    b->flag[i] = 1;
                    b->queue[queued++] = i;
                }
            }
        }
    }
    return queued;
}

static void find_inside(build *b) {
    pal_rest_surface *s = b->s;
    double size = body_size(b->model);
    for (int32_t i = 0; i < s->node_count; i++) {
        s->inside[i] = size;
        b->edge[i] = -1; // NOLINT(*.NullDereference): place() set it
    }
    int32_t head = 0, queued = find_boundary(b);
    while (queued > 0) {
        int32_t i = b->queue[head];
        head = head + 1 < s->node_count ? head + 1 : 0;
        queued--;
        b->flag[i] = 0;
        for (int32_t k = b->s->fan_start[i]; k < b->s->fan_start[i + 1]; k++) {
            int32_t t = b->s->fan[k] / 3;
            for (int c = 0; c < 3; c++) {
                int32_t j = s->triangle[3 * (size_t)t + (size_t)c];
                double r = edge_distance(s, b->edge[i], s->position + 3 * (size_t)j);
                if (b->edge[j] == b->edge[i] || !(r < s->inside[j])) {
                    continue;
                }
                s->inside[j] = r;
                b->edge[j] = b->edge[i];
                if (!b->flag[j]) {
                    int32_t tail = head + queued;
                    b->queue[tail < s->node_count ? tail : tail - s->node_count] = j;
                    b->flag[j] = 1;
                    queued++;
                }
            }
        }
    }
    memset(b->flag, 0, (size_t)s->node_count);
    for (int32_t t = 0; t < s->triangle_count; t++) {
        for (int c = 0; c < 3 && s->touchable[t]; c++) {
            b->flag[s->triangle[3 * (size_t)t + (size_t)c]] = 1;
        }
    }
    for (int32_t i = 0; i < s->node_count; i++) {
        s->inside[i] = b->flag[i] ? s->inside[i] : -s->inside[i];
    }
}

// ---- Tree of boxes ------------------------------------------------------------------------------

/// Box of a patch's Bezier control points, which hold it: corners and edge midpoints plus c / 2.
static void patch_box(const pal_rest_surface *s, int32_t t, double low[3], double high[3]) {
    for (int e = 0; e < 3; e++) {
        const double *p = node_at(s, t, e), *q = node_at(s, t, (e + 1) % 3);
        const double *c = s->bend + 9 * (size_t)t + 3 * (size_t)e;
        for (int i = 0; i < 3; i++) {
            double middle = 0.5 * (p[i] + q[i] + c[i]);
            low[i] = fmin(low[i], fmin(p[i], middle));
            high[i] = fmax(high[i], fmax(p[i], middle));
        }
    }
}

static double middle_of(const pal_rest_surface *s, int32_t t, int axis) {
    return node_at(s, t, 0)[axis] + node_at(s, t, 1)[axis] + node_at(s, t, 2)[axis];
}

static int before(const pal_rest_surface *s, int32_t a, int32_t b, int axis) {
    double x = middle_of(s, a, axis), y = middle_of(s, b, axis);
    return x < y || (x == y && a < b);
}

/// Order the range so that its lower half by `axis` comes first (quickselect).
static void halve(pal_rest_surface *s, int32_t first, int32_t count, int axis) {
    int32_t low = first, high = first + count - 1, middle = first + count / 2;
    while (low < high) {
        int32_t pivot = s->order[low + (high - low) / 2], i = low, j = high;
        while (i <= j) {
            while (before(s, s->order[i], pivot, axis)) {
                i++;
            }
            while (before(s, pivot, s->order[j], axis)) {
                j--;
            }
            if (i <= j) {
                int32_t swap = s->order[i];
                s->order[i++] = s->order[j];
                s->order[j--] = swap;
            }
        }
        if (middle <= j) {
            high = j;
        } else if (middle >= i) {
            low = i;
        } else {
            break;
        }
    }
}

/// Boxes in preorder. Halving keeps the depth below log2(n) + 1, so recursion is shallow.
static void build_boxes(pal_rest_surface *s, int32_t first, int32_t count, double pad) {
    int32_t self = s->box_count++;
    pal_rest_box *box = &s->box[self];
    double spread[3];
    for (int i = 0; i < 3; i++) {
        box->low[i] = HUGE_VAL;
        box->high[i] = -HUGE_VAL;
    }
    for (int32_t k = first; k < first + count; k++) {
        patch_box(s, s->order[k], box->low, box->high);
    }
    for (int i = 0; i < 3; i++) { // rounding of a query never misses a flat box
        box->low[i] -= pad;
        box->high[i] += pad;
    }
    box->first = first;
    box->count = count;
    if (count <= LEAF) {
        return;
    }
    for (int i = 0; i < 3; i++) {
        spread[i] = box->high[i] - box->low[i];
    }
    int axis = spread[1] > spread[0] ? 1 : 0;
    axis = spread[2] > spread[axis] ? 2 : axis;
    halve(s, first, count, axis);
    box->count = 0;
    build_boxes(s, first, count / 2, pad);
    s->box[self].first = s->box_count;
    build_boxes(s, first + count / 2, count - count / 2, pad);
}

void pal_rest_init(pal_rest_surface *surface, const pal_model *model, void *memory) {
    build b = {.s = surface, .model = model};
    *surface = (pal_rest_surface){.triangle_count = model->info.triangle_count,
                                  .node_count = model->info.surface_count,
                                  .triangle = model->triangle,
                                  .position = model->position};
    (void)place(model, surface, &b, memory);
    list_corners(&b);
    find_across(&b);
    find_sharp(surface);
    find_normals(&b);
    find_bends(surface);
    find_inside(&b);
    for (int32_t t = 0; t < surface->triangle_count; t++) {
        surface->order[t] = t;
    }
    if (surface->triangle_count > 0) {
        build_boxes(surface, 0, surface->triangle_count, 1e-9 * body_size(model));
    }
}
