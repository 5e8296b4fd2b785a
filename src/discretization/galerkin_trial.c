/// @file galerkin_trial.c  MLS values at the corners of the pair regions, as corrections of
/// own-node ones.
///
/// The boundary of a pair's region inside tetrahedron T consists of the triangles (a, c_F, c_T) and
/// (b, c_F, c_T), a and b the pair, F the two faces of T that contain both, c centroids. With one
/// value per corner, shared by all regions that meet there, the linear rule on each triangle keeps
/// the mean gradients consistent (they add up to boundary terms), and the linear fit keeps them
/// exact on linear fields. Own-node values are the mean of the corner nodes; so
///
///     G_ab += (1 / V_ab) sum_T [ A_T (phi(c_T) - mean_T) / 3 + sum_F A_F (phi(c_F) - mean_F) / 3 ]
///
/// with A_F the outward area vectors of the two triangles at F, A_T those of all four. On the
/// body's surface phi(c_F) = mean_F: there the trial functions stay linear between nodes, so that a
/// face whose nodes are held is held everywhere.
#include "src/discretization/galerkin_trial.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/discretization/neighbours.h"

/// Points: tetrahedron centroids, then face centroids. Row r: phi - mean, sparse.
typedef struct rows {
    int32_t count;
    int64_t *start;
    int32_t *node;
    double *weight;
} rows;

typedef struct face_key {
    int32_t node[3]; ///< ascending
    int32_t at;      ///< 4 * tet + opposite corner
} face_key;

typedef struct work {
    const pal_cloud *cloud;
    int32_t face_count;
    int32_t *tet_face;     ///< (tet_count x 4) face opposite each corner
    int32_t *face_node;    ///< (face_count x 3)
    uint8_t *face_outside; ///< (face_count) on the surface
    double *point;         ///< ((tet_count + face_count) x 3)
    rows value;
    int64_t *cursor;
    int32_t *found;
    double *distance2;
    pal_neighbours tree;
} work;

static int face_compare(const void *pa, const void *pb) {
    const face_key *a = pa, *b = pb;
    for (int k = 0; k < 3; k++) {
        if (a->node[k] != b->node[k]) {
            return a->node[k] < b->node[k] ? -1 : 1;
        }
    }
    return (a->at > b->at) - (a->at < b->at);
}

static int index_compare(const void *pa, const void *pb) {
    const int32_t *a = pa, *b = pb;
    return (*a > *b) - (*a < *b);
}

static void work_clear(work *w) {
    free(w->tet_face);
    free(w->face_node);
    free(w->face_outside);
    free(w->point);
    free(w->value.start);
    free(w->value.node);
    free(w->value.weight);
    free(w->cursor);
    free(w->found);
    free(w->distance2);
    pal_neighbours_clear(&w->tree);
}

static pal_status number_faces(work *w) {
    const pal_cloud *c = w->cloud;
    size_t n = 4 * (size_t)c->tet_count;
    face_key *key = malloc(n * sizeof *key);
    w->tet_face = malloc(n * sizeof *w->tet_face);
    w->face_node = malloc(3 * n * sizeof *w->face_node);
    w->face_outside = malloc(n * sizeof *w->face_outside);
    if (key == NULL || w->tet_face == NULL || w->face_node == NULL || w->face_outside == NULL) {
        free(key);
        return PALPATE_ERROR_MEMORY;
    }
    for (size_t i = 0; i < n; i++) {
        const int32_t *t = c->tet + (i - i % 4);
        int at = 0;
        for (size_t k = 0; k < 4; k++) {
            if (k != i % 4) {
                key[i].node[at++] = t[k];
            }
        }
        qsort(key[i].node, 3, sizeof *key[i].node, index_compare);
        key[i].at = (int32_t)i;
    }
    qsort(key, n, sizeof *key, face_compare);
    for (size_t i = 0; i < n; i++) {
        if (i > 0 && memcmp(key[i].node, key[i - 1].node, sizeof key[i].node) == 0) {
            w->face_outside[w->face_count - 1] = 0;
        } else {
            memcpy(w->face_node + 3 * (size_t)w->face_count, key[i].node, sizeof key[i].node);
            w->face_outside[w->face_count++] = 1;
        }
        w->tet_face[key[i].at] = w->face_count - 1;
    }
    free(key);
    return PALPATE_OK;
}

/// The corner nodes of point p: 4 or 3.
static const int32_t *own_nodes(const work *w, int32_t p, int *count) {
    int32_t tets = w->cloud->tet_count;
    *count = p < tets ? 4 : 3;
    return p < tets ? w->cloud->tet + 4 * (size_t)p : w->face_node + 3 * (size_t)(p - tets);
}

static pal_status place_points(work *w) {
    w->value.count = w->cloud->tet_count + w->face_count;
    w->point = malloc(3 * (size_t)w->value.count * sizeof *w->point);
    if (w->point == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    for (int32_t p = 0; p < w->value.count; p++) {
        int n;
        const int32_t *own = own_nodes(w, p, &n);
        for (int c = 0; c < 3; c++) {
            double sum = 0.0;
            for (int k = 0; k < n; k++) {
                sum += w->cloud->position[3 * (size_t)own[k] + (size_t)c];
            }
            w->point[3 * (size_t)p + (size_t)c] = sum / n;
        }
    }
    return PALPATE_OK;
}

/// Which spheres cover each inner point, nodes ascending.
static pal_status cover_points(work *w, double reach, pal_error *error) {
    const pal_cloud *c = w->cloud;
    int32_t n = w->value.count;
    w->value.start = calloc((size_t)n + 1, sizeof *w->value.start);
    w->cursor = malloc((size_t)n * sizeof *w->cursor);
    w->found = malloc((size_t)n * sizeof *w->found);
    w->distance2 = malloc((size_t)n * sizeof *w->distance2);
    if (w->value.start == NULL || w->cursor == NULL || w->found == NULL || w->distance2 == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    // NOLINTNEXTLINE(clang-analyzer-unix.Malloc): the caller clears all that w holds
    pal_status status = pal_neighbours_create(&w->tree, w->point, n, error);
    if (status != PALPATE_OK) {
        return status;
    }
    for (int pass = 0; pass < 2; pass++) {
        for (int32_t a = 0; a < c->node_count; a++) {
            int32_t count =
                pal_neighbours_within(&w->tree, c->position + 3 * (size_t)a, reach * c->spacing[a],
                                      n, w->found, w->distance2, NULL);
            for (int32_t k = 0; k < count; k++) {
                int32_t p = w->found[k];
                if (p >= c->tet_count && w->face_outside[p - c->tet_count]) {
                    continue;
                }
                if (pass == 0) {
                    w->value.start[p + 1]++;
                } else {
                    w->value.node[w->cursor[p]++] = a;
                }
            }
        }
        if (pass == 0) {
            for (int32_t p = 0; p < n; p++) {
                w->value.start[p + 1] += w->value.start[p];
                w->cursor[p] = w->value.start[p];
            }
            size_t total = (size_t)w->value.start[n] + 1;
            w->value.node = malloc(total * sizeof *w->value.node);
            w->value.weight = calloc(total, sizeof *w->value.weight);
            if (w->value.node == NULL || w->value.weight == NULL) {
                return PALPATE_ERROR_MEMORY;
            }
        }
    }
    return PALPATE_OK;
}

/// Solve the 4 x 4 normal equations M c = (1, 0, 0, 0) by Cholesky. @return 0 when not definite
static int solve_fit(double m[4][4], double c[4]) {
    double l[4][4];
    for (int i = 0; i < 4; i++) {
        for (int j = 0; j <= i; j++) {
            double sum = m[i][j];
            for (int k = 0; k < j; k++) {
                sum -= l[i][k] * l[j][k];
            }
            if (i == j &&
                !(sum > 1e-6 * m[i][i])) { // pivot: distance from a plane, relative, squared
                return 0;
            }
            l[i][j] = i == j ? sqrt(sum) : sum / l[j][j];
        }
    }
    for (int i = 0; i < 4; i++) {
        double sum = i == 0 ? 1.0 : 0.0;
        for (int k = 0; k < i; k++) {
            sum -= l[i][k] * c[k];
        }
        c[i] = sum / l[i][i];
    }
    for (int i = 3; i >= 0; i--) {
        for (int k = i + 1; k < 4; k++) {
            c[i] -= l[k][i] * c[k];
        }
        c[i] /= l[i][i];
    }
    return 1;
}

/// Row p becomes phi - mean. @return 0 when its spheres do not determine a linear fit (row zero)
static int fit_point(work *w, int32_t p, double reach, int32_t exponent) {
    const pal_cloud *c = w->cloud;
    const double *x = w->point + 3 * (size_t)p;
    int64_t from = w->value.start[p], to = w->value.start[p + 1];
    int n;
    const int32_t *own = own_nodes(w, p, &n);
    double size = c->spacing[own[0]], m[4][4] = {{0}}, fit[4] = {0};
    for (int64_t k = from; k < to; k++) {
        int32_t a = w->value.node[k];
        double q[4] = {1.0, 0.0, 0.0, 0.0}, d2 = 0.0;
        for (int i = 0; i < 3; i++) {
            double d = c->position[3 * (size_t)a + (size_t)i] - x[i];
            d2 += d * d;
            q[i + 1] = d / size;
        }
        double s = sqrt(d2) / (reach * c->spacing[a]);
        double weight =
            s < 1.0 ? (1.0 + s * s * (-6.0 + s * (8.0 - 3.0 * s))) / pow(s, 2.0 * exponent) : 0.0;
        w->value.weight[k] = weight;
        for (int i = 0; i < 4; i++) {
            for (int j = 0; j < 4; j++) {
                m[i][j] += weight * q[i] * q[j];
            }
        }
    }
    int ok = to - from >= 4 && solve_fit(m, fit);
    for (int64_t k = from; k < to; k++) {
        const double *y = c->position + 3 * (size_t)w->value.node[k];
        double q = fit[0];
        for (int i = 0; i < 3; i++) {
            q += fit[i + 1] * (y[i] - x[i]) / size;
        }
        w->value.weight[k] = ok ? w->value.weight[k] * q : 0.0;
    }
    return ok;
}

/// What pair (a, b) adds to its row: point and area vector / 3 over the volume.
typedef struct term {
    int32_t point;
    double area[3];
} term;

/// The three terms of pair (a, b) in tetrahedron t.
static void tet_terms(const work *w, int32_t t, int32_t a, int32_t b, term out[3]) {
    const int32_t *n = w->cloud->tet + 4 * (size_t)t;
    const double *ct = w->point + 3 * (size_t)t;
    out[0] = (term){.point = t};
    int at = 0;
    for (int k = 0; k < 4; k++) {
        if (n[k] == a || n[k] == b) {
            continue; // the face opposite k contains both
        }
        int32_t face = w->tet_face[4 * (size_t)t + (size_t)k];
        term *f = &out[++at];
        *f = (term){.point = w->cloud->tet_count + face};
        const double *cf = w->point + 3 * (size_t)f->point;
        for (int end = 0; end < 2; end++) {
            const double *y = w->cloud->position + 3 * (size_t)(end ? b : a);
            const double *other = w->cloud->position + 3 * (size_t)(end ? a : b);
            double u[3], v[3], s = 0.0;
            for (int i = 0; i < 3; i++) {
                u[i] = cf[i] - y[i];
                v[i] = ct[i] - y[i];
            }
            double area[3] = {u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2],
                              u[0] * v[1] - u[1] * v[0]};
            for (int i = 0; i < 3; i++) { // outward: away from the pair's other node
                s += area[i] * (y[i] - other[i]);
            }
            for (int i = 0; i < 3; i++) {
                double outward = (s > 0.0 ? 0.5 : -0.5) * area[i] / 3.0;
                f->area[i] += outward;
                out[0].area[i] += outward;
            }
        }
    }
}

/// Scatter one term into the dense map `sum` (node x 3) with the touched nodes listed.
static void scatter(const work *w, const term *q, int32_t *seen, int32_t *list, int32_t *count,
                    double *sum) {
    int n;
    const int32_t *own = own_nodes(w, q->point, &n);
    int64_t from = w->value.start[q->point], to = w->value.start[q->point + 1];
    double total = 0.0; // 1 where fitted, 0 where the own nodes stay
    for (int64_t k = from; k < to; k++) {
        total += w->value.weight[k];
    }
    if (total < 0.5) {
        return;
    }
    for (int64_t k = from - n; k < to; k++) {
        int32_t a = k < from ? own[k - from + n] : w->value.node[k];
        double weight = k < from ? -1.0 / n : w->value.weight[k];
        if (k >= from && fabs(weight) < 1e-14) {
            continue;
        }
        if (!seen[a]) {
            seen[a] = 1;
            list[(*count)++] = a;
        }
        for (int i = 0; i < 3; i++) {
            sum[3 * (size_t)a + (size_t)i] += weight * q->area[i];
        }
    }
}

/// Widened lists of all pairs: pass 0 counts, pass 1 fills `out`.
static void widen_pairs(const work *w, const pal_regions *pairs, const pal_region_part *parts,
                        int pass, int32_t *seen, int32_t *list, double *sum, pal_regions *out) {
    const pal_region_part *part = parts;
    int64_t total = 0;
    for (int32_t f = 0; f < pairs->count; f++) {
        uint64_t key = part->key;
        int32_t a = (int32_t)(key >> 32), b = (int32_t)(key & 0xffffffffu), count = 0;
        for (int64_t k = pairs->start[f]; k < pairs->start[f + 1]; k++) {
            int32_t node = pairs->node[k];
            seen[node] = 1;
            list[count++] = node;
            for (int i = 0; i < 3; i++) {
                sum[3 * (size_t)node + (size_t)i] = pairs->gradient[3 * k + i] * pairs->volume[f];
            }
        }
        const pal_region_part *end = parts + 6 * (size_t)w->cloud->tet_count;
        for (; part < end && part->key == key; part++) {
            term q[3];
            tet_terms(w, part->tet, a, b, q);
            for (int k = 0; k < 3; k++) {
                scatter(w, &q[k], seen, list, &count, sum);
            }
        }
        out->start[f] = total;
        if (pass == 1) {
            qsort(list, (size_t)count, sizeof *list, index_compare);
        }
        for (int32_t k = 0; k < count; k++) {
            size_t node = (size_t)list[k];
            for (int i = 0; i < 3; i++) {
                if (pass == 1) {
                    out->gradient[3 * (total + k) + i] =
                        sum[3 * node + (size_t)i] / pairs->volume[f];
                }
                sum[3 * node + (size_t)i] = 0.0;
            }
            if (pass == 1) {
                out->node[total + k] = list[k];
            }
            seen[node] = 0;
        }
        total += count;
    }
    out->start[pairs->count] = total;
}

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "galerkin: no memory for the trial functions");
}

static pal_status replace_lists(const work *w, pal_regions *pairs) {
    size_t n = (size_t)w->cloud->node_count, part_count;
    pal_regions out = {0};
    pal_status status = PALPATE_ERROR_MEMORY;
    pal_region_part *parts = pal_region_parts(w->cloud, PALPATE_REGION_PAIR, &part_count);
    int32_t *seen = calloc(n, sizeof *seen), *list = malloc(n * sizeof *list);
    double *sum = calloc(3 * n, sizeof *sum);
    out.start = malloc(((size_t)pairs->count + 1) * sizeof *out.start);
    if (parts == NULL || seen == NULL || list == NULL || sum == NULL || out.start == NULL) {
        goto done;
    }
    widen_pairs(w, pairs, parts, 0, seen, list, sum, &out);
    size_t total = (size_t)out.start[pairs->count], room = total + 1; // malloc(0) may be NULL
    out.node = malloc(room * sizeof *out.node);
    out.gradient = malloc(3 * room * sizeof *out.gradient);
    out.region = malloc(room * sizeof *out.region);
    out.local = malloc(room * sizeof *out.local);
    out.at_node = malloc((n + 1) * sizeof *out.at_node);
    if (out.node == NULL || out.gradient == NULL || out.region == NULL || out.local == NULL ||
        out.at_node == NULL) {
        goto done;
    }
    widen_pairs(w, pairs, parts, 1, seen, list, sum, &out);
    out.count = pairs->count;
    out.volume = pairs->volume;
    out.worst_condition = pairs->worst_condition;
    memcpy(out.worst_point, pairs->worst_point, sizeof out.worst_point);
    pal_regions_transpose(&out, w->cloud->node_count);
    pairs->volume = NULL;
    pal_regions_clear(pairs);
    *pairs = out;
    memset(&out, 0, sizeof out);
    status = PALPATE_OK;
done:
    pal_regions_clear(&out);
    free(parts);
    free(seen);
    free(list);
    free(sum);
    return status;
}

pal_status pal_regions_widen(pal_regions *pairs, const pal_cloud *cloud, int32_t neighbours,
                             int32_t exponent, pal_stencil_report *report, pal_error *error) {
    if (neighbours < 5 || neighbours > 400 || exponent < 0 || exponent > 8 ||
        cloud->spacing == NULL) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "galerkin: neighbours %d (5 to 400, or 0 for the cell's own nodes), exponent %d "
            "(0 to 8)",
            neighbours, exponent);
    }
    // a tetrahedral cloud has about 1.3 nodes per spacing^3: 4/3 pi reach^3 1.3 spheres over a
    // point
    double reach = cbrt(neighbours / (4.0 / 3.0 * 3.14159265358979324 * 1.3));
    work w = {.cloud = cloud};
    pal_status status = number_faces(&w);
    if (status == PALPATE_OK) {
        status = place_points(&w);
    }
    if (status == PALPATE_OK) {
        status = cover_points(&w, reach, error);
    }
    if (status == PALPATE_OK) {
        for (int32_t p = 0; p < w.value.count; p++) {
            int outside = p >= cloud->tet_count && w.face_outside[p - cloud->tet_count];
            report->grown += !outside && !fit_point(&w, p, reach, exponent);
        }
        status = replace_lists(&w, pairs);
    }
    if (status == PALPATE_ERROR_MEMORY) {
        (void)no_memory(error);
    }
    work_clear(&w);
    return status;
}
