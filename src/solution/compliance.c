/// @file compliance.c  Columns of the inverse, many at a time (see compliance.h).
///
/// Blocks of columns are handed out to worker threads by an atomic counter; each block is solved
/// alone, so the result does not depend on the number of threads. The calling thread works too and
/// reports progress between its blocks.
#include "src/solution/compliance.h"

#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "src/base/seconds.h"

enum { SAMPLED_COLUMNS = 12, THREADS_MAX = 16 };
/// A sampled residual above this earns every column one step of iterative refinement. Forces are
/// asked to 1e-8 at best; backward stable solves give about 1e-13.
static const double REFINE_ABOVE = 1e-10;
/// Rows in half precision are scaled by the largest entry of the sampled columns times this:
/// columns of a finer zone are larger, about as the spacings' ratio. Where that is not enough, all
/// is solved again with as much more room.
static const double HALF_HEADROOM = 64.0;
enum { HALF_TRIES = 4 };

typedef struct job {
    const pal_system *system;
    const pal_factor *factor;
    const pal_probe_weights *probes;
    pal_model *model;
    double unit;
    double largest; ///< entry of the stored rows over the sampled columns [m/N]
    int refine;
    int32_t block;        ///< columns per block
    int64_t column_count; ///< 3 * columns
    atomic_llong next;
    atomic_llong done;
    atomic_int status; ///< pal_status, first failure wins
    const pal_progress *progress;
    double begin;
} job;

/// Put the right-hand side of model column `j` (dof 3 * column index + direction) into x (n).
static void load_column(const job *w, int64_t j, double *x) {
    const pal_sparse *load = &w->system->load;
    int64_t column = 3 * (int64_t)w->model->column_node[j / 3] + j % 3;
    memset(x, 0, (size_t)w->system->unknown_count * sizeof *x);
    for (int64_t e = load->start[column]; e < load->start[column + 1]; e++) {
        x[load->row[e]] += load->value[e];
    }
}

static double dof_value(const job *w, const double *x, int32_t node, int d) {
    int32_t unknown = w->system->dof_unknown[3 * (int64_t)node + d];
    return unknown < 0 ? 0.0 : w->unit * x[unknown];
}

/// Solve `count` columns from `first` in x (n x count), with refinement when asked.
static pal_status solve_block(const job *w, pal_factor_workspace *ws, int64_t first, int32_t count,
                              double *x, double *residual, pal_error *error) {
    int64_t n = w->system->unknown_count;
    for (int32_t c = 0; c < count; c++) {
        load_column(w, first + c, x + c * n);
    }
    pal_status status = pal_factor_solve(w->factor, ws, count, x, error);
    for (int r = 0; residual != NULL && status == PALPATE_OK && r < w->refine; r++) {
        for (int32_t c = 0; c < count; c++) {
            load_column(w, first + c, residual + c * n);
            pal_sparse_multiply(&w->system->matrix, -1.0, x + c * n, residual + c * n);
        }
        status = pal_factor_solve(w->factor, ws, count, residual, error);
        for (int64_t i = 0; status == PALPATE_OK && i < n * count; i++) {
            x[i] += residual[i];
        }
    }
    return status;
}

/// Keep the wanted rows of one solved column.
static pal_status keep_column(const job *w, int64_t j, const double *x, double *rows) {
    pal_model *m = w->model;
    int32_t t = m->info.column_count, s = m->info.row_count, probes = m->info.probe_count;
    double *tt = m->c_tt + j * 3 * t;
    double sum = 0.0;
    for (int32_t i = 0; i < t; i++) {
        for (int d = 0; d < 3; d++) {
            tt[3 * i + d] = dof_value(w, x, m->column_node[i], d);
            sum += fabs(tt[3 * i + d]);
        }
    }
    if (!isfinite(sum)) {
        return PALPATE_ERROR_SINGULAR;
    }
    if (s > 0) {
        for (int32_t i = 0; i < s; i++) {
            for (int d = 0; d < 3; d++) {
                rows[3 * i + d] = dof_value(w, x, m->row_node[i], d);
            }
        }
        pal_status status = pal_model_store_column(m, j, rows);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    for (int32_t p = 0; p < probes; p++) {
        const pal_probe_weights *q = &w->probes[p];
        for (int d = 0; d < 3; d++) {
            double u = 0.0;
            for (int32_t k = 0; k < q->count; k++) {
                u += q->weight[k] * dof_value(w, x, q->node[k], d);
            }
            m->probe_row[j * 3 * probes + 3 * p + d] = u;
        }
    }
    return PALPATE_OK;
}

static void fail_job(job *w, pal_status status) {
    int none = PALPATE_OK;
    atomic_compare_exchange_strong(&w->status, &none, status);
}

/// Solve blocks until none is left. The caller's thread passes report = 1.
static void work(job *w, int report) {
    int64_t n = w->system->unknown_count;
    pal_factor_workspace *ws = pal_factor_workspace_new(w->factor);
    double *x = malloc((size_t)(n * w->block) * sizeof *x);
    double *residual = w->refine ? malloc((size_t)(n * w->block) * sizeof *residual) : NULL;
    double *rows = malloc((3 * (size_t)w->model->info.row_count + 1) * sizeof *rows);
    if (ws == NULL || x == NULL || rows == NULL || (w->refine && residual == NULL)) {
        fail_job(w, PALPATE_ERROR_MEMORY);
    }
    while (atomic_load(&w->status) == PALPATE_OK) {
        int64_t first = atomic_fetch_add(&w->next, w->block);
        if (first >= w->column_count) {
            break;
        }
        int64_t left = w->column_count - first;
        int32_t count = left < w->block ? (int32_t)left : w->block;
        pal_status status = solve_block(w, ws, first, count, x, residual, NULL);
        for (int32_t c = 0; status == PALPATE_OK && c < count; c++) {
            status = keep_column(w, first + c, x + c * n, rows);
        }
        if (status != PALPATE_OK) {
            fail_job(w, status);
            break;
        }
        int64_t done = atomic_fetch_add(&w->done, count) + count;
        if (report && w->progress != NULL && w->progress->call != NULL) {
            double f = (double)done / (double)w->column_count;
            double left_s = (pal_seconds_now() - w->begin) * (1.0 - f) / f;
            if (w->progress->call(w->progress->user, "solve", f, left_s) != 0) {
                fail_job(w, PALPATE_ERROR_CANCELLED);
            }
        }
    }
    free(rows);
    free(residual);
    free(x);
    pal_factor_workspace_free(ws);
}

static void *worker(void *arg) {
    work(arg, 0);
    return NULL;
}

/// Solve a few columns in full: residual and balance of forces; decides about refinement.
static pal_status sample(job *w, pal_compliance_report *report, pal_error *error) {
    const pal_system *system = w->system;
    int64_t n = system->unknown_count, supports = 3 * (int64_t)system->fixed_count;
    pal_factor_workspace *ws = pal_factor_workspace_new(w->factor);
    double *x = malloc((size_t)n * sizeof *x), *r = malloc((size_t)n * sizeof *r);
    double *b = malloc((size_t)n * sizeof *b);
    double *reaction = malloc((size_t)(supports + 1) * sizeof *reaction);
    pal_status status = PALPATE_OK;
    if (ws == NULL || x == NULL || r == NULL || b == NULL || reaction == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    report->residual = 0.0;
    report->balance = supports > 0 && system->reaction.start != NULL ? 0.0 : -1.0;
    report->sampled = 0;
    for (int k = 0; status == PALPATE_OK && k < SAMPLED_COLUMNS; k++) {
        int64_t j = (w->column_count - 1) * k / (SAMPLED_COLUMNS - 1);
        status = solve_block(w, ws, j, 1, x, r, error);
        if (status != PALPATE_OK) {
            break;
        }
        for (int32_t i = 0; i < 3 * w->model->info.row_count; i++) {
            w->largest = fmax(w->largest, fabs(dof_value(w, x, w->model->row_node[i / 3], i % 3)));
        }
        load_column(w, j, b);
        memcpy(r, b, (size_t)n * sizeof *r);
        pal_sparse_multiply(&system->matrix, -1.0, x, r);
        double rr = 0.0, bb = 0.0;
        for (int64_t i = 0; i < n; i++) {
            rr += r[i] * r[i];
            bb += b[i] * b[i];
        }
        double relative = bb > 0.0 ? sqrt(rr / bb) : 0.0;
        report->residual = isnan(relative) ? (double)INFINITY : fmax(report->residual, relative);
        if (report->balance >= 0.0) {
            memset(reaction, 0, (size_t)supports * sizeof *reaction);
            pal_sparse_multiply(&system->reaction, 1.0, x, reaction);
            double sum[3] = {0.0, 0.0, 0.0};
            sum[j % 3] = 1.0;
            for (int64_t i = 0; i < supports; i++) {
                sum[i % 3] += reaction[i];
            }
            double off = sqrt(sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]);
            report->balance = fmax(report->balance, off);
        }
        report->sampled++;
    }
    free(reaction);
    free(b);
    free(r);
    free(x);
    pal_factor_workspace_free(ws);
    return status;
}

/// Tell the factor which unknowns the kept rows need.
static pal_status mark_needed(const job *w, pal_factor *factor, pal_error *error) {
    const pal_model *m = w->model;
    uint8_t *need = calloc((size_t)w->system->unknown_count, 1);
    if (need == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    const int32_t *dof = w->system->dof_unknown;
#define NEED(node)                                                                                 \
    for (int d = 0; d < 3; d++) {                                                                  \
        if (dof[3 * (int64_t)(node) + d] >= 0) {                                                   \
            need[dof[3 * (int64_t)(node) + d]] = 1;                                                \
        }                                                                                          \
    }
    for (int32_t i = 0; i < m->info.column_count; i++) {
        NEED(m->column_node[i])
    }
    for (int32_t i = 0; i < m->info.row_count; i++) {
        NEED(m->row_node[i])
    }
    for (int32_t p = 0; p < m->info.probe_count; p++) {
        for (int32_t k = 0; k < w->probes[p].count; k++) {
            NEED(w->probes[p].node[k])
        }
    }
#undef NEED
    pal_status status = pal_factor_need(factor, need, error);
    free(need);
    return status;
}

static pal_status allocate_blocks(pal_model *m, pal_error *error) {
    size_t t = 3 * (size_t)m->info.column_count;
    m->c_tt = malloc(t * t * sizeof *m->c_tt);
    m->probe_row = calloc(t * 3 * (size_t)m->info.probe_count + 1, sizeof *m->probe_row);
    if (m->c_tt == NULL || m->probe_row == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "out of memory for the compliance of %d touchable nodes (%.2f GB): narrow "
                        "body.touchable",
                        m->info.column_count, 8e-9 * (double)t * (double)t);
    }
    return pal_model_alloc_rows(m, error);
}

/// Solve every column on all cores. @return the first failure, or PALPATE_OK
static pal_status solve_all(job *w) {
    atomic_store(&w->next, 0);
    atomic_store(&w->done, 0);
    atomic_store(&w->status, PALPATE_OK);
    w->begin = pal_seconds_now();
    long cpus = sysconf(_SC_NPROCESSORS_ONLN);
    int threads = cpus < 1 ? 1 : (int)(cpus > THREADS_MAX ? THREADS_MAX : cpus);
    pthread_t id[THREADS_MAX];
    int started = 0;
    while (started < threads - 1 && pthread_create(&id[started], NULL, worker, w) == 0) {
        started++;
    }
    work(w, 1);
    for (int i = 0; i < started; i++) {
        pthread_join(id[i], NULL);
    }
    return (pal_status)atomic_load(&w->status);
}

pal_status pal_compliance_solve(const pal_system *system, pal_factor *factor, double young,
                                double length, const pal_probe_weights *probes,
                                const pal_progress *progress, pal_model *model,
                                pal_compliance_report *report, pal_error *error) {
    job w = {.system = system, .factor = factor, .probes = probes, .model = model};
    w.unit = 1.0 / (young * length);
    w.column_count = 3 * (int64_t)model->info.column_count;
    w.progress = progress;
    w.block = PALPATE_FACTOR_BLOCK;
    if (w.column_count == 0 || !(w.unit > 0.0) || !isfinite(w.unit)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "no column to solve, or young * length is not positive");
    }
    pal_status status = allocate_blocks(model, error);
    if (status == PALPATE_OK) {
        status = sample(&w, report, error);
    }
    if (status == PALPATE_OK && report->residual > REFINE_ABOVE) {
        w.refine = 1;
        status = sample(&w, report, error);
    }
    report->refined = w.refine;
    if (status == PALPATE_OK && !w.refine) {
        status = mark_needed(&w, factor, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    pal_model_scale_rows(model, HALF_HEADROOM * w.largest);
    status = solve_all(&w);
    for (int k = 1; status == PALPATE_ERROR_ARGUMENT && k < HALF_TRIES &&
                    model->info.precision == PALPATE_PRECISION_HALF;
         k++) {
        model->row_scale *= HALF_HEADROOM;
        status = solve_all(&w);
    }
    (void)pal_factor_need(factor, NULL, NULL);
    switch (status) {
    case PALPATE_OK:
        return PALPATE_OK;
    case PALPATE_ERROR_CANCELLED:
        return pal_fail(error, PALPATE_ERROR_CANCELLED, "cancelled after %lld of %lld columns",
                        (long long)atomic_load(&w.done), (long long)w.column_count);
    case PALPATE_ERROR_SINGULAR:
        return pal_fail(error, PALPATE_ERROR_SINGULAR,
                        "a column of the compliance is not finite: the body is not held enough, or "
                        "body.material is out of any sensible range");
    case PALPATE_ERROR_ARGUMENT:
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "a displacement per newton does not fit in store.precision: use single or "
                        "double");
    default:
        return pal_fail(error, status, "out of memory while solving");
    }
}
