/// @file row_clusters.c  Which rows share a basis, and the basis (see row_clusters.h).
///
/// Bottom up over a tree of halved boxes. At a leaf, the rows A of 16 nodes: eigenvectors of A A^T
/// over the columns of the far groups (its left singular vectors), as many as the tolerance needs.
/// A parent's basis is sought inside its children's: their coefficients are all that is left to
/// decompose, so each level costs what the leaves do. Far groups of a parent are far from both
/// children. The price of a cluster is what a field reads of it; the cheaper of a cluster and its
/// two halves is kept (Boerm, Efficient Numerical Methods for Non-local Operators, 2010, ch. 6,
/// with prices for ranks).
#include "src/store/row_clusters.h"

#include <cblas.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

enum { LEAF = 16, SAMPLED = 256 };
/// A basis is only a stage on the way to its parent's at this part of the tolerance.
static const double STAGE = 0.6;
/// What a basis's element costs against one of a touched column: it stays in cache.
static const double BASIS_COST = 0.6;
/// And one of a near pair: short runs from anywhere.
static const double NEAR_COST = 2;
/// What it costs to begin with a near pair or a cluster, in elements; groups touched at once.
static const double PAIR_COST = 600, CLUSTER_COST = 800, GROUPS_TOUCHED = 8;

typedef struct stage {
    int32_t first, count, rank;
    double *basis; ///< (3 count x rank)
    double *coef;  ///< (rank x 3 columns)
    uint8_t *far;  ///< (group_count)
} stage;

static void stage_clear(stage *s) {
    free(s->basis);
    free(s->coef);
    free(s->far);
    *s = (stage){0};
}

void pal_cluster_free(pal_cluster *list) {
    while (list != NULL) {
        pal_cluster *next = list->next;
        free(list->basis);
        free(list->coef);
        free(list->near);
        free(list);
        list = next;
    }
}

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for compressing the stored rows");
}

// ---- Trees --------------------------------------------------------------------------------------

typedef struct keyed {
    double key;
    int32_t index;
} keyed;

static int by_key(const void *a, const void *b) {
    const keyed *x = a, *y = b;
    return x->key != y->key ? (x->key > y->key) - (x->key < y->key)
                            : (x->index > y->index) - (x->index < y->index);
}

static int32_t split(const double *position, const int32_t *node, int32_t first, int32_t points,
                     int32_t most, int32_t *index, int32_t *start, int32_t intervals, keyed *key) {
    if (points <= most) {
        if (start != NULL) {
            start[intervals] = first;
            start[intervals + 1] = first + points;
        }
        return intervals + 1;
    }
    double low[3] = {INFINITY, INFINITY, INFINITY}, high[3] = {-INFINITY, -INFINITY, -INFINITY};
    for (int32_t i = first; i < first + points; i++) {
        for (int d = 0; d < 3; d++) {
            double x = position[3 * (size_t)node[index[i]] + (size_t)d];
            low[d] = fmin(low[d], x);
            high[d] = fmax(high[d], x);
        }
    }
    size_t axis = 0;
    for (size_t d = 1; d < 3; d++) {
        axis = high[d] - low[d] > high[axis] - low[axis] ? d : axis;
    }
    for (int32_t i = 0; i < points; i++) {
        int32_t at = index[first + i];
        key[i] = (keyed){position[3 * (size_t)node[at] + axis], at};
    }
    qsort(key, (size_t)points, sizeof *key, by_key);
    for (int32_t i = 0; i < points; i++) {
        index[first + i] = key[i].index;
    }
    int32_t half = points / 2;
    intervals = split(position, node, first, half, most, index, start, intervals, key);
    return split(position, node, first + half, points - half, most, index, start, intervals, key);
}

int32_t pal_cluster_split(const double *position, const int32_t *node, int32_t points, int32_t most,
                          int32_t *index, int32_t *start) {
    keyed *key = malloc((size_t)points * sizeof *key + 1);
    if (key == NULL) {
        return -1;
    }
    int32_t intervals = split(position, node, 0, points, most, index, start, 0, key);
    free(key);
    return intervals;
}

// ---- One cluster --------------------------------------------------------------------------------

void pal_cluster_rows(const pal_cluster_job *job, int32_t first, int32_t count, double *rows) {
    const pal_model *m = job->model;
    int64_t n = 3 * (int64_t)m->info.column_count;
    for (int64_t j = 0; j < n; j++) {
        double inverse = 1 / job->size[j], *to = rows + j * 3 * count;
        for (int32_t i = 0; i < count; i++) {
            int64_t at = j * m->row_ld + 3 * (int64_t)job->row_order[first + i];
            for (int d = 0; d < 3; d++) {
                to[3 * i + d] = inverse * (m->info.precision == PALPATE_PRECISION_DOUBLE
                                               ? ((const double *)m->c_st)[at + d]
                                               : (double)((const float *)m->c_st)[at + d]);
            }
        }
    }
}

static void find_far(const pal_cluster_job *job, int32_t first, int32_t count, uint8_t *far) {
    const pal_model *m = job->model;
    double center[3] = {0, 0, 0}, radius = 0;
    for (int32_t i = first; i < first + count; i++) {
        const double *x = m->position + 3 * (size_t)m->row_node[job->row_order[i]];
        for (int d = 0; d < 3; d++) {
            center[d] += x[d] / count;
        }
    }
    for (int32_t i = first; i < first + count; i++) {
        const double *x = m->position + 3 * (size_t)m->row_node[job->row_order[i]];
        radius = fmax(radius, (x[0] - center[0]) * (x[0] - center[0]) +
                                  (x[1] - center[1]) * (x[1] - center[1]) +
                                  (x[2] - center[2]) * (x[2] - center[2]));
    }
    double beyond = radius * (1 + job->separation) * (1 + job->separation);
    for (int32_t g = 0; g < job->group_count; g++) {
        far[g] = 1;
        for (int32_t k = job->group_start[g]; k < job->group_start[g + 1]; k++) {
            const double *x = m->position + 3 * (size_t)m->column_node[job->column_order[k]];
            double d[3] = {x[0] - center[0], x[1] - center[1], x[2] - center[2]};
            far[g] &= d[0] * d[0] + d[1] * d[1] + d[2] * d[2] > beyond;
        }
    }
}

/// Largest displacement of any node in a column of residuals.
static double node_size(const double *column, int32_t count) {
    double most = 0;
    for (int32_t i = 0; i < count; i++) {
        const double *e = column + 3 * i;
        most = fmax(most, e[0] * e[0] + e[1] * e[1] + e[2] * e[2]);
    }
    return sqrt(most);
}

/// residual (rows x n) = a - basis[:, 0:rank] coef[0:rank, :] for n columns
static void subtract(int32_t rows, int32_t n, int32_t rank, const double *a, const double *basis,
                     const double *coef, int32_t coef_ld, double *residual) {
    memcpy(residual, a, (size_t)rows * (size_t)n * sizeof *residual);
    if (rank > 0) {
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, rows, n, rank, -1, basis, rows, coef,
                    coef_ld, 1, residual, rows);
    }
}

/// What one level works with; everything below is `all` doubles in one block.
typedef struct room {
    double *a;        ///< (rows x n) normalised rows
    double *far;      ///< (full x nf) coefficients of far columns, then residuals
    double *gram;     ///< (full x full)
    double *value;    ///< (full)
    double *sample_a; ///< (rows x SAMPLED)
    double *sample_c; ///< (full x SAMPLED)
    double *block;
} room;

static int room_make(room *r, int64_t rows, int64_t n, int64_t full) {
    int64_t wide = full > rows ? full : rows;
    int64_t sizes[] = {rows * n, wide * n, full * full, full, rows * SAMPLED, full * SAMPLED},
            sum = 1;
    for (int i = 0; i < 6; i++) {
        sum += sizes[i];
    }
    r->block = malloc((size_t)sum * sizeof *r->block);
    double **part[] = {&r->a, &r->far, &r->gram, &r->value, &r->sample_a, &r->sample_c};
    double *at = r->block;
    for (int i = 0; r->block != NULL && i < 6; i++) {
        *part[i] = at;
        at += sizes[i];
    }
    return r->block != NULL;
}

/// Smallest rank with which every sampled far column is within `tolerance`.
static int32_t needed_rank(const room *r, int32_t count, int32_t samples, int32_t full,
                           const double *basis, double tolerance) {
    int32_t low = 0, high = full;
    while (low < high) {
        int32_t rank = (low + high) / 2;
        subtract(3 * count, samples, rank, r->sample_a, basis, r->sample_c, full, r->far);
        double worst = 0;
        for (int32_t j = 0; j < samples; j++) {
            worst = fmax(worst, node_size(r->far + (size_t)j * 3 * (size_t)count, count));
        }
        if (worst <= tolerance) {
            high = rank;
        } else {
            low = rank + 1;
        }
    }
    return low;
}

/// Full basis and coefficients of a node of the tree: the eigenvectors, largest first, of the far
/// columns' Gram matrix within `inner` (rows x full, orthonormal; NULL: the unit vectors).
/// @param coef  (full x n) coefficients within `inner`; replaced by those of the new basis
/// @param basis  (rows x full) made
/// @return LAPACK's info
static int decompose(const pal_cluster_job *job, room *r, int32_t rows, int32_t full,
                     const double *inner, const uint8_t *far, double *coef, double *basis) {
    int32_t n = 3 * job->model->info.column_count, nf = 0;
    for (int32_t g = 0; g < job->group_count; g++) {
        for (int32_t k = job->group_start[g]; far[g] && k < job->group_start[g + 1]; k++) {
            memcpy(r->far + (size_t)nf * (size_t)full,
                   coef + 3 * (size_t)job->column_order[k] * (size_t)full,
                   3 * (size_t)full * sizeof *coef);
            nf += 3;
        }
    }
    cblas_dsyrk(CblasColMajor, CblasUpper, CblasNoTrans, full, nf, 1, r->far, full, 0, r->gram,
                full);
    int info = LAPACKE_dsyev(LAPACK_COL_MAJOR, 'V', 'U', full, r->gram, full, r->value);
    if (info != 0) {
        return info;
    }
    for (int32_t k = 0; k < full / 2; k++) { // ascending -> descending
        double *x = r->gram + (size_t)k * (size_t)full,
               *y = r->gram + (size_t)(full - 1 - k) * (size_t)full;
        cblas_dswap(full, x, 1, y, 1);
    }
    if (inner == NULL) {
        memcpy(basis, r->gram, (size_t)full * (size_t)full * sizeof *basis);
    } else {
        cblas_dgemm(CblasColMajor, CblasNoTrans, CblasNoTrans, rows, full, full, 1, inner, rows,
                    r->gram, full, 0, basis, rows);
    }
    cblas_dgemm(CblasColMajor, CblasTrans, CblasNoTrans, full, n, full, 1, r->gram, full, coef,
                full, 0, r->far, full);
    memcpy(coef, r->far, (size_t)full * (size_t)n * sizeof *coef);
    return 0;
}

/// Evenly spaced far columns into the samples. @return how many
static int32_t take_samples(const pal_cluster_job *job, room *r, int32_t rows, int32_t full,
                            const uint8_t *far, const double *coef) {
    int32_t columns = 0, taken = 0, seen = 0;
    for (int32_t g = 0; g < job->group_count; g++) {
        columns += far[g] ? 3 * (job->group_start[g + 1] - job->group_start[g]) : 0;
    }
    int32_t wanted = columns < SAMPLED ? columns : SAMPLED;
    for (int32_t g = 0; g < job->group_count; g++) {
        for (int32_t k = 3 * job->group_start[g]; far[g] && k < 3 * job->group_start[g + 1]; k++) {
            if ((int64_t)seen++ * wanted / columns < taken) {
                continue;
            }
            size_t j = 3 * (size_t)job->column_order[k / 3] + (size_t)(k % 3);
            memcpy(r->sample_a + (size_t)taken * (size_t)rows, r->a + j * (size_t)rows,
                   (size_t)rows * sizeof *r->a);
            memcpy(r->sample_c + (size_t)taken * (size_t)full, coef + j * (size_t)full,
                   (size_t)full * sizeof *coef);
            taken++;
            if (taken == wanted) {
                return taken;
            }
        }
    }
    return taken;
}

/// The cluster with `rank` of the basis: near groups, cost, copies. @return NULL: out of memory
static pal_cluster *finish(const pal_cluster_job *job, const room *r, int32_t first, int32_t count,
                           int32_t full, int32_t rank, const double *basis, const double *coef) {
    int32_t n = 3 * job->model->info.column_count, rows = 3 * count;
    pal_cluster *c = calloc(1, sizeof *c);
    if (c == NULL) {
        return NULL;
    }
    *c = (pal_cluster){.first = first, .count = count, .rank = rank};
    c->basis = malloc((size_t)rows * (size_t)rank * sizeof *c->basis + 1);
    c->coef = malloc((size_t)rank * (size_t)n * sizeof *c->coef + 1);
    c->near = calloc((size_t)job->group_count, 1);
    if (c->basis == NULL || c->coef == NULL || c->near == NULL) {
        pal_cluster_free(c);
        return NULL;
    }
    memcpy(c->basis, basis, (size_t)rows * (size_t)rank * sizeof *basis);
    for (int32_t j = 0; j < n; j++) {
        for (int32_t k = 0; k < rank; k++) {
            c->coef[(size_t)j * (size_t)rank + (size_t)k] =
                (float)coef[(size_t)j * (size_t)full + (size_t)k];
        }
    }
    subtract(rows, n, rank, r->a, basis, coef, full, r->far);
    int32_t padded = (rows + 31) / 32 * 32;
    double near_columns = 0, near_groups = 0, stored = padded;
    for (int32_t g = 0; g < job->group_count; g++) {
        for (int32_t k = 3 * job->group_start[g]; !c->near[g] && k < 3 * job->group_start[g + 1];
             k++) {
            size_t j = 3 * (size_t)job->column_order[k / 3] + (size_t)(k % 3);
            c->near[g] = node_size(r->far + j * (size_t)rows, count) > job->tolerance;
        }
        near_groups += c->near[g];
        near_columns += c->near[g] ? 3.0 * (job->group_start[g + 1] - job->group_start[g]) : 0;
    }
    c->cost = rank * (job->touched + BASIS_COST * stored) +
              NEAR_COST * near_columns / n * stored * job->touched + CLUSTER_COST +
              PAIR_COST * near_groups * fmin(1, GROUPS_TOUCHED / job->group_count);
    return c;
}

static pal_status build(const pal_cluster_job *job, int32_t first, int32_t count, stage *up,
                        pal_cluster **out, pal_error *error) {
    int32_t n = 3 * job->model->info.column_count, rows = 3 * count, full = rows;
    stage half[2] = {{0}, {0}};
    pal_cluster *list = NULL, *one = NULL;
    pal_status status = PALPATE_OK;
    *out = NULL;
    if (count > LEAF) {
        pal_cluster *second = NULL, **end = &list;
        status = build(job, first, count / 2, &half[0], &list, error);
        if (status == PALPATE_OK) {
            status = build(job, first + count / 2, count - count / 2, &half[1], &second, error);
        }
        while (*end != NULL) {
            end = &(*end)->next;
        }
        *end = second;
        full = half[0].rank + half[1].rank;
    }
    room r = {0};
    double *inner = NULL, *basis = NULL;
    *up = (stage){.first = first, .count = count};
    if (status == PALPATE_OK) {
        basis = calloc((size_t)rows * (size_t)full + 1, sizeof *basis);
        inner = count > LEAF ? calloc((size_t)rows * (size_t)full + 1, sizeof *inner) : NULL;
        up->coef = malloc((size_t)full * (size_t)n * sizeof *up->coef + 1);
        up->far = malloc((size_t)job->group_count);
        if (!room_make(&r, rows, n, full) || basis == NULL || up->coef == NULL || up->far == NULL ||
            (count > LEAF && inner == NULL)) {
            status = no_memory(error);
        }
    }
    if (status == PALPATE_OK) {
        pal_cluster_rows(job, first, count, r.a);
        find_far(job, first, count, up->far);
        for (int h = 0, at = 0; h < 2 && count > LEAF; at += half[h].rank, h++) {
            size_t below = h == 0 ? 0 : 3 * (size_t)half[0].count, tall = 3 * (size_t)half[h].count;
            for (int32_t k = 0; k < half[h].rank; k++) {
                memcpy(inner + (size_t)(at + k) * (size_t)rows + below,
                       half[h].basis + (size_t)k * tall, tall * sizeof *inner);
            }
            for (int32_t j = 0; j < n; j++) {
                memcpy(up->coef + (size_t)j * (size_t)full + (size_t)at,
                       half[h].coef + (size_t)j * (size_t)half[h].rank,
                       (size_t)half[h].rank * sizeof *inner);
            }
            for (int32_t g = 0; g < job->group_count; g++) {
                up->far[g] &= half[h].far[g];
            }
        }
        if (count <= LEAF) {
            memcpy(up->coef, r.a, (size_t)rows * (size_t)n * sizeof *up->coef);
        }
        int32_t rank = 0, samples = 0;
        if (full > 0) {
            int info = decompose(job, &r, rows, full, inner, up->far, up->coef, basis);
            status = info == 0  ? PALPATE_OK
                     : info < 0 ? no_memory(error)
                                : pal_fail(error, PALPATE_ERROR_SINGULAR,
                                           "the eigenvalues of a cluster of rows did not converge");
        }
        if (status == PALPATE_OK && full > 0) {
            samples = take_samples(job, &r, rows, full, up->far, up->coef);
            rank = needed_rank(&r, count, samples, full, basis, job->tolerance);
        }
        if (status == PALPATE_OK) {
            one = finish(job, &r, first, count, full, rank, basis, up->coef);
            status = one != NULL ? PALPATE_OK : no_memory(error);
        }
        if (status == PALPATE_OK) { // for the parent: a little more of the basis
            up->rank =
                full > 0 ? needed_rank(&r, count, samples, full, basis, STAGE * job->tolerance) : 0;
            up->basis = basis;
            basis = NULL;
            for (int32_t j = 0; j < n; j++) {
                memmove(up->coef + (size_t)j * (size_t)up->rank,
                        up->coef + (size_t)j * (size_t)full, (size_t)up->rank * sizeof *up->coef);
            }
        }
    }
    double halves = 0;
    for (const pal_cluster *c = list; c != NULL; c = c->next) {
        halves += c->cost;
    }
    if (status == PALPATE_OK && (list == NULL || one->cost <= halves)) {
        pal_cluster_free(list);
        list = one;
        one = NULL;
    }
    pal_cluster_free(one);
    if (status != PALPATE_OK) {
        pal_cluster_free(list);
        list = NULL;
        stage_clear(up);
    }
    *out = list;
    free(r.block);
    free(inner);
    free(basis);
    stage_clear(&half[0]);
    stage_clear(&half[1]);
    return status;
}

pal_status pal_cluster_build(const pal_cluster_job *job, int32_t first, int32_t count,
                             pal_cluster **out, pal_error *error) {
    stage top;
    pal_status status = build(job, first, count, &top, out, error);
    stage_clear(&top);
    return status;
}
