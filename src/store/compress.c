/// @file compress.c  The cheapest form of the stored rows that meets a tolerance (see compress.h).
///
/// Candidates: double, single, scaled 16-bit integers and bases in scaled integers. Half precision
/// is none: at equal bytes its error is 5 to 10 times that of scaled (bench/compress). Nor are far
/// rows in 8 bits, near ones in 16, to 1e-3: on the livers of bench/compress 81 to 94 % of scaled's
/// bytes, since 8 bits serve only where a displacement is below a ninth of the column's largest,
/// with 20 times its error and short runs that take 4 times as long; bases of the same error take
/// 16 to 32 % of the bytes and less time the larger the body. The tolerance of the bases holds for
/// single columns; that of a contact follows from it by measurement: compress, sample, tighten or
/// relax, at most TRIES times.
#include "src/store/compress.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/engine/field_model.h"
#include "src/store/field_sample.h"
#include "src/store/row_clusters.h"

enum { GROUP = 8, TOP = 128, TRIES = 5, THREADS_MAX = 16 };
static const double SEPARATION = 0.4;
/// Degrees of freedom under one tool: 45 nodes.
static const double TOUCHED = 135;
static const uint64_t SEED = 20261122;
/// Part of the tolerance that the sampled contacts may use, since they are not all there are.
static const double SAFETY = 0.75;

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for compressing the stored rows");
}

// ---- Rows on their own --------------------------------------------------------------------------

static void borrow(const pal_model *model, pal_rows *out) {
    *out = *model;
    out->c_st = NULL;
    out->column_scale = NULL;
    out->bases = NULL;
    out->row_ld = 0;
    out->row_scale = 1;
}

void pal_rows_clear(pal_rows *rows) {
    free(rows->c_st);
    free(rows->column_scale);
    pal_row_bases_free(rows->bases);
    rows->c_st = NULL;
    rows->column_scale = NULL;
    rows->bases = NULL;
}

void pal_rows_take(pal_model *model, pal_rows *rows) {
    pal_rows_clear(model);
    model->c_st = rows->c_st;
    model->column_scale = rows->column_scale;
    model->bases = rows->bases;
    model->row_ld = rows->row_ld;
    model->row_scale = rows->row_scale;
    model->info.precision = rows->info.precision;
    rows->c_st = NULL;
    rows->column_scale = NULL;
    rows->bases = NULL;
}

pal_status pal_rows_convert(const pal_model *model, pal_precision precision, pal_rows *out,
                            pal_error *error) {
    borrow(model, out);
    out->info.precision = precision;
    double *column = malloc((3 * (size_t)model->info.row_count + 1) * sizeof *column);
    pal_status status = column != NULL ? pal_model_alloc_rows(out, error) : no_memory(error);
    double largest = 0;
    for (int64_t j = 0; status == PALPATE_OK && precision == PALPATE_PRECISION_HALF &&
                        j < 3 * (int64_t)model->info.column_count;
         j++) {
        status = pal_model_load_column(model, j, column);
        for (int64_t i = 0; i < 3 * (int64_t)model->info.row_count; i++) {
            largest = fmax(largest, fabs(column[i]));
        }
    }
    if (status == PALPATE_OK) {
        pal_model_scale_rows(out, largest);
    }
    for (int64_t j = 0; status == PALPATE_OK && j < 3 * (int64_t)model->info.column_count; j++) {
        status = pal_model_load_column(model, j, column);
        if (status == PALPATE_OK && pal_model_store_column(out, j, column) != PALPATE_OK) {
            status = pal_fail(error, PALPATE_ERROR_ARGUMENT,
                              "a displacement per newton does not fit in that precision");
        }
    }
    free(column);
    if (status != PALPATE_OK) {
        pal_rows_clear(out);
    }
    return status;
}

// ---- Bases --------------------------------------------------------------------------------------

typedef struct work {
    pal_cluster_job job;
    int32_t *row_order, *column_order, *group_start, *top_start;
    double *size;
    int32_t top_count;
    pal_cluster **cluster; ///< (top_count) lists
    atomic_int next, status;
    const pal_progress *progress;
} work;

static void work_clear(work *w) {
    for (int32_t i = 0; w->cluster != NULL && i < w->top_count; i++) {
        pal_cluster_free(w->cluster[i]);
    }
    free(w->cluster);
    free(w->row_order);
    free(w->column_order);
    free(w->group_start);
    free(w->top_start);
    free(w->size);
}

/// Trees over rows and columns, and the columns' sizes.
static pal_status prepare(const pal_model *m, double tolerance, const pal_progress *progress,
                          work *w, pal_error *error) {
    size_t rows = (size_t)m->info.row_count, columns = (size_t)m->info.column_count;
    *w = (work){.progress = progress};
    w->row_order = malloc((rows + 1) * sizeof *w->row_order);
    w->top_start = malloc((rows + 1) * sizeof *w->top_start);
    w->column_order = malloc((columns + 1) * sizeof *w->column_order);
    w->group_start = malloc((columns + 1) * sizeof *w->group_start);
    w->size = malloc((3 * columns + 1) * sizeof *w->size);
    double *column = malloc((3 * rows + 1) * sizeof *column);
    if (w->row_order == NULL || w->top_start == NULL || w->column_order == NULL ||
        w->group_start == NULL || w->size == NULL || column == NULL) {
        free(column);
        return no_memory(error);
    }
    for (int32_t i = 0; i < m->info.row_count; i++) {
        w->row_order[i] = i;
    }
    for (int32_t i = 0; i < m->info.column_count; i++) {
        w->column_order[i] = i;
    }
    w->top_count = pal_cluster_split(m->position, m->row_node, m->info.row_count, TOP, w->row_order,
                                     w->top_start);
    int32_t groups = pal_cluster_split(m->position, m->column_node, m->info.column_count, GROUP,
                                       w->column_order, w->group_start);
    w->cluster = w->top_count > 0 ? calloc((size_t)w->top_count, sizeof(pal_cluster *)) : NULL;
    if (w->cluster == NULL || groups < 1) {
        free(column);
        return no_memory(error);
    }
    for (size_t j = 0; j < 3 * columns; j++) {
        (void)pal_model_load_column(m, (int64_t)j, column);
        double most = 0;
        for (size_t i = 0; i < rows; i++) {
            const double *u = column + 3 * i;
            most = fmax(most, u[0] * u[0] + u[1] * u[1] + u[2] * u[2]);
        }
        w->size[j] = most > 0 ? sqrt(most) : 1;
    }
    free(column);
    w->job = (pal_cluster_job){.model = m,
                               .row_order = w->row_order,
                               .group_count = groups,
                               .group_start = w->group_start,
                               .column_order = w->column_order,
                               .size = w->size,
                               .tolerance = tolerance,
                               .separation = SEPARATION,
                               .touched = TOUCHED};
    return PALPATE_OK;
}

static void run(work *w, int report) {
    while (atomic_load(&w->status) == PALPATE_OK) {
        int32_t t = atomic_fetch_add(&w->next, 1);
        if (t >= w->top_count) {
            break;
        }
        pal_status status = pal_cluster_build(
            &w->job, w->top_start[t], w->top_start[t + 1] - w->top_start[t], &w->cluster[t], NULL);
        if (status == PALPATE_OK && report && w->progress != NULL && w->progress->call != NULL &&
            w->progress->call(w->progress->user, "compress", (double)t / w->top_count, -1.0) != 0) {
            status = PALPATE_ERROR_CANCELLED;
        }
        int none = PALPATE_OK;
        if (status != PALPATE_OK) {
            atomic_compare_exchange_strong(&w->status, &none, status);
        }
    }
}

static void *run_beside(void *arg) {
    run(arg, 0);
    return NULL;
}

static pal_status build_clusters(work *w, pal_error *error) {
    pthread_t id[THREADS_MAX];
    long cpus = sysconf(_SC_NPROCESSORS_ONLN);
    int wanted = cpus < 1 ? 1 : (int)(cpus > THREADS_MAX ? THREADS_MAX : cpus), started = 0;
    while (started < wanted - 1 && pthread_create(&id[started], NULL, run_beside, w) == 0) {
        started++;
    }
    run(w, 1);
    for (int i = 0; i < started; i++) {
        pthread_join(id[i], NULL);
    }
    switch ((pal_status)atomic_load(&w->status)) {
    case PALPATE_OK:
        return PALPATE_OK;
    case PALPATE_ERROR_CANCELLED:
        return pal_fail(error, PALPATE_ERROR_CANCELLED,
                        "cancelled while compressing the stored rows");
    case PALPATE_ERROR_SINGULAR:
        return pal_fail(error, PALPATE_ERROR_SINGULAR,
                        "the eigenvalues of a cluster of rows did not converge");
    default:
        return no_memory(error);
    }
}

static int32_t *copied(const int32_t *from, int32_t count) {
    int32_t *to = malloc(((size_t)count + 1) * sizeof *to);
    if (to != NULL) {
        memcpy(to, from, (size_t)count * sizeof *to);
    }
    return to;
}

/// Counts and index arrays of the bases from the finished clusters.
static pal_status describe(const work *w, pal_row_bases *b, pal_error *error) {
    const pal_model_info *info = &w->job.model->info;
    b->group_count = w->job.group_count;
    for (int32_t t = 0; t < w->top_count; t++) {
        for (const pal_cluster *c = w->cluster[t]; c != NULL; c = c->next) {
            b->cluster_count++;
            b->rank += c->rank;
            for (int32_t g = 0; g < b->group_count; g++) {
                b->pair_count += c->near[g];
            }
        }
    }
    b->row_order = copied(w->row_order, info->row_count);
    b->column_order = copied(w->column_order, info->column_count);
    b->group_start = copied(w->group_start, b->group_count + 1);
    b->cluster_start = malloc(((size_t)b->cluster_count + 1) * sizeof *b->cluster_start);
    b->rank_start = malloc(((size_t)b->cluster_count + 1) * sizeof *b->rank_start);
    b->pair_start = malloc(((size_t)b->group_count + 1) * sizeof *b->pair_start);
    b->pair_cluster = malloc(((size_t)b->pair_count + 1) * sizeof *b->pair_cluster);
    if (b->row_order == NULL || b->column_order == NULL || b->group_start == NULL ||
        b->cluster_start == NULL || b->rank_start == NULL || b->pair_start == NULL ||
        b->pair_cluster == NULL) {
        return no_memory(error);
    }
    int32_t r = 0;
    b->cluster_start[0] = b->rank_start[0] = 0;
    for (int32_t t = 0; t < w->top_count; t++) {
        for (const pal_cluster *c = w->cluster[t]; c != NULL; c = c->next, r++) {
            b->cluster_start[r + 1] = c->first + c->count;
            b->rank_start[r + 1] = b->rank_start[r] + c->rank;
        }
    }
    int32_t p = 0;
    for (int32_t g = 0; g < b->group_count; g++) {
        b->pair_start[g] = p;
        r = 0;
        for (int32_t t = 0; t < w->top_count; t++) {
            for (const pal_cluster *c = w->cluster[t]; c != NULL; c = c->next, r++) {
                if (c->near[g]) {
                    b->pair_cluster[p++] = r;
                }
            }
        }
    }
    b->pair_start[b->group_count] = p;
    return PALPATE_OK;
}

/// One column as integers with a scale.
static float quantize(const double *column, int32_t count, double unit, int16_t *out) {
    double largest = 0;
    for (int32_t i = 0; i < count; i++) {
        largest = fmax(largest, fabs(column[i]));
    }
    float scale = (float)(largest * unit / PALPATE_SCALED_MAX);
    if (!isnormal(scale)) {
        return 0.0f;
    }
    double inverse = unit / (double)scale;
    for (int32_t i = 0; i < count; i++) { // the scale is rounded: the largest may end one too high
        double q = nearbyint(column[i] * inverse);
        out[i] = (int16_t)fmax(-PALPATE_SCALED_MAX, fmin(PALPATE_SCALED_MAX, q));
    }
    return scale;
}

/// The bases and the near pairs' residuals.
static pal_status fill_bases(const work *w, pal_row_bases *b, pal_error *error) {
    int64_t n = 3 * (int64_t)w->job.model->info.column_count;
    int32_t *pair = malloc((size_t)b->group_count * sizeof *pair); // next pair of each group
    double *rows = malloc((size_t)(3 * TOP * n) * sizeof *rows);
    double *residual = malloc(3 * TOP * sizeof *residual);
    if (pair == NULL || rows == NULL || residual == NULL) {
        free(pair);
        free(rows);
        free(residual);
        return no_memory(error);
    }
    memcpy(pair, b->pair_start, (size_t)b->group_count * sizeof *pair);
    int32_t r = 0;
    for (int32_t t = 0; t < w->top_count; t++) {
        for (const pal_cluster *c = w->cluster[t]; c != NULL; c = c->next, r++) {
            int32_t count = 3 * c->count;
            int64_t ld = pal_bases_ld(b, r);
            for (int32_t k = 0; k < c->rank; k++) {
                b->basis_scale[b->rank_start[r] + k] = quantize(
                    c->basis + (int64_t)k * count, count, 1, b->basis + b->basis_start[r] + k * ld);
            }
            pal_cluster_rows(&w->job, c->first, c->count, rows);
            for (int32_t g = 0; g < b->group_count; g++) {
                if (!c->near[g]) {
                    continue;
                }
                int32_t p = pair[g]++, columns = 3 * (b->group_start[g + 1] - b->group_start[g]);
                for (int32_t k = 0; k < columns; k++) {
                    int64_t j = 3 * (int64_t)b->column_order[b->group_start[g] + k / 3] + k % 3;
                    memcpy(residual, rows + j * count, (size_t)count * sizeof *residual);
                    for (int32_t i = 0; i < c->rank; i++) {
                        double s = (double)c->coef[j * c->rank + i];
                        const double *u = c->basis + (int64_t)i * count;
                        for (int32_t q = 0; q < count; q++) {
                            residual[q] -= s * u[q];
                        }
                    }
                    b->near_scale[b->near_scale_start[p] + k] =
                        quantize(residual, count, w->size[j], b->near + b->near_start[p] + k * ld);
                }
            }
        }
    }
    free(pair);
    free(rows);
    free(residual);
    return PALPATE_OK;
}

/// S, column by column.
static pal_status fill_coefficients(const work *w, pal_rows *out, pal_error *error) {
    double *s = malloc(((size_t)out->bases->rank + 1) * sizeof *s);
    pal_status status = s != NULL ? pal_model_alloc_rows(out, error) : no_memory(error);
    for (int64_t j = 0;
         status == PALPATE_OK && out->bases->rank > 0 && j < 3 * (int64_t)out->info.column_count;
         j++) {
        double *at = s;
        for (int32_t t = 0; t < w->top_count; t++) {
            for (const pal_cluster *c = w->cluster[t]; c != NULL; c = c->next) {
                for (int32_t k = 0; k < c->rank; k++) {
                    *at++ = w->size[j] * (double)c->coef[j * c->rank + k];
                }
            }
        }
        status = pal_model_store_column(out, j, s);
    }
    free(s);
    return status;
}

pal_status pal_rows_compress(const pal_model *model, double tolerance, const pal_progress *progress,
                             pal_rows *out, pal_error *error) {
    const pal_model_info *info = &model->info;
    borrow(model, out);
    if (model->bases != NULL || model->c_st == NULL || !(tolerance > 0) ||
        (info->precision != PALPATE_PRECISION_DOUBLE &&
         info->precision != PALPATE_PRECISION_SINGLE)) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "only rows in double or single precision can be compressed, to a tolerance above 0");
    }
    out->info.precision = PALPATE_PRECISION_SCALED;
    out->bases = calloc(1, sizeof *out->bases);
    work w = {0};
    pal_status status =
        out->bases != NULL ? prepare(model, tolerance, progress, &w, error) : no_memory(error);
    if (status == PALPATE_OK) {
        status = build_clusters(&w, error);
    }
    if (status == PALPATE_OK) {
        status = describe(&w, out->bases, error);
    }
    if (status == PALPATE_OK) {
        status = pal_row_bases_derive(out->bases, info->row_count, info->column_count, error);
    }
    if (status == PALPATE_OK) {
        status = pal_row_bases_alloc(out->bases, error);
    }
    if (status == PALPATE_OK) {
        status = fill_bases(&w, out->bases, error);
    }
    if (status == PALPATE_OK) {
        status = fill_coefficients(&w, out, error);
    }
    work_clear(&w);
    if (status != PALPATE_OK) {
        pal_rows_clear(out);
    }
    return status;
}

// ---- Choice -------------------------------------------------------------------------------------

typedef struct candidate {
    pal_rows rows;
    double error, cost; ///< relative; ns
} candidate;

static pal_status measure(const pal_field_sample *sample, candidate *c, pal_error *error) {
    return pal_field_sample_error(sample, &c->rows, &c->error, &c->cost, error);
}

/// Bases whose measured error is just within what is allowed; c->error above it: none found.
static pal_status fit_bases(const pal_model *model, const pal_field_sample *sample, double allowed,
                            const pal_progress *progress, candidate *c, pal_error *error) {
    candidate best = {.error = INFINITY};
    double inner = 0.5 * allowed, before = INFINITY;
    pal_status status = PALPATE_OK;
    for (int k = 0; status == PALPATE_OK && k < TRIES; k++) {
        candidate now = {.error = INFINITY};
        status = pal_rows_compress(model, inner, progress, &now.rows, error);
        if (status == PALPATE_OK) {
            status = measure(sample, &now, error);
        }
        int fits = status == PALPATE_OK && now.error <= allowed,
            relaxed_too_far = !fits && best.error <= allowed,
            enough = fits && now.error > 0.45 * allowed, // ranks grow with the logarithm
            rounding =
                !fits && now.error > 0.7 * before; // the integers': tightening brings no more
        inner *= fmax(0.25, fmin(2.0, 0.8 * allowed / now.error));
        if (fits && (best.error > allowed || now.cost < best.cost)) {
            pal_rows_clear(&best.rows);
            best = now;
        } else {
            pal_rows_clear(&now.rows);
        }
        before = now.error;
        if (relaxed_too_far || enough || rounding) {
            break;
        }
    }
    if (status != PALPATE_OK) {
        pal_rows_clear(&best.rows);
    }
    *c = best;
    return status;
}

/// Take c instead of best when it is cheaper and allowed, or the first that is allowed.
static void choose(candidate *best, candidate *c, double allowed) {
    if (c->error <= allowed && (best->error > allowed || c->cost < best->cost)) {
        candidate old = *best;
        *best = *c;
        *c = old;
    }
    pal_rows_clear(&c->rows);
}

pal_status pal_compress(pal_model *model, double tolerance, const pal_progress *progress,
                        pal_error *error) {
    if (model->c_st == NULL || model->info.row_count == 0 || model->info.column_count == 0) {
        return PALPATE_OK;
    }
    double allowed = SAFETY * tolerance;
    pal_field_sample sample;
    pal_status status = pal_field_sample_make(model, SEED, PALPATE_SAMPLE_COUNT, &sample, error);
    if (status != PALPATE_OK) {
        return status;
    }
    candidate best = {.rows = *model}; // what it has
    status = measure(&sample, &best, error);
    borrow(model, &best.rows);
    if (status == PALPATE_OK && tolerance > 0 &&
        model->info.precision == PALPATE_PRECISION_DOUBLE) {
        candidate c = {.error = INFINITY};
        status = pal_rows_convert(model, PALPATE_PRECISION_SINGLE, &c.rows, error);
        status = status == PALPATE_OK ? measure(&sample, &c, error) : status;
        choose(&best, &c, status == PALPATE_OK ? allowed : 0);
    }
    double scaled = INFINITY;
    if (status == PALPATE_OK && tolerance > 0) {
        candidate c = {.error = INFINITY};
        status = pal_rows_convert(model, PALPATE_PRECISION_SCALED, &c.rows, error);
        status = status == PALPATE_OK ? measure(&sample, &c, error) : status;
        scaled = c.error;
        choose(&best, &c, status == PALPATE_OK ? allowed : 0);
    }
    if (status == PALPATE_OK && scaled <= allowed) { // bases are integers too: no more exact
        candidate c = {.error = INFINITY};
        status = fit_bases(model, &sample, allowed, progress, &c, error);
        choose(&best, &c, status == PALPATE_OK ? allowed : 0);
    }
    pal_field_sample_clear(&sample);
    if (status != PALPATE_OK) {
        pal_rows_clear(&best.rows);
        return status;
    }
    if (best.rows.c_st != NULL || best.rows.bases != NULL) {
        pal_rows_take(model, &best.rows);
    }
    model->info.field_tolerance = tolerance;
    model->info.field_error = best.error;
    model->info.field_us = 1e-3 * best.cost;
    return PALPATE_OK;
}
