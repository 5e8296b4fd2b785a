/// @file factor.c  The one file that includes SuiteSparse: UMFPACK and CHOLMOD (see factor.h).
#include "src/solution/factor.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cholmod.h>
#include <umfpack.h>

#include "haptic/base/error.h"
#include "src/base/seconds.h"
#include "src/solution/lu_solve.h"
#include "src/solution/memory_plan.h"

struct pal_factor {
    int32_t n;
    int positive;
    pal_lu lu;             ///< extracted factors: what solves
    void *numeric;         ///< nonsymmetric: UMFPACK's own, kept for the reference solve
    cholmod_factor *chol;  ///< symmetric positive definite: CHOLMOD's own, kept for the same
    cholmod_common common; ///< of the thread that made it
};

struct pal_factor_workspace {
    const pal_factor *factor;
    double *work;
};

void pal_factor_free(pal_factor *f) {
    if (f == NULL) {
        return;
    }
    pal_lu_clear(&f->lu);
    if (f->numeric != NULL) {
        umfpack_dl_free_numeric(&f->numeric);
    }
    if (f->positive) {
        if (f->chol != NULL) {
            cholmod_l_free_factor(&f->chol, &f->common);
        }
        cholmod_l_finish(&f->common);
    }
    free(f);
}

/// A triangular factor by columns (or rows), strictly below (or beyond) the diagonal.
typedef struct triangle {
    int64_t *start;
    int32_t *index;
    double *value;
} triangle;

static void triangle_clear(triangle *t) {
    free(t->start);
    free(t->index);
    free(t->value);
    memset(t, 0, sizeof *t);
}

static int triangle_alloc(size_t n, size_t entries, triangle *t) {
    t->start = calloc(n + 2, sizeof *t->start);
    t->index = malloc((entries + 1) * sizeof *t->index);
    t->value = malloc((entries + 1) * sizeof *t->value);
    return t->start == NULL || t->index == NULL || t->value == NULL;
}

/// Transpose what UMFPACK returns (L by rows, U by columns), dropping the diagonal; diagonal may be
/// NULL.
static int transpose(size_t n, const SuiteSparse_long *start, const SuiteSparse_long *index,
                     const double *value, double *diagonal, triangle *t) {
    if (triangle_alloc(n, (size_t)start[n], t) != 0) {
        return -1;
    }
    for (size_t i = 0; i < n; i++) {
        for (SuiteSparse_long e = start[i]; e < start[i + 1]; e++) {
            if ((size_t)index[e] != i) {
                t->start[index[e] + 2]++;
            } else if (diagonal != NULL) {
                diagonal[i] = 1.0 / value[e];
            }
        }
    }
    for (size_t j = 1; j <= n + 1; j++) {
        t->start[j] += t->start[j - 1];
    }
    for (size_t i = 0; i < n; i++) {
        for (SuiteSparse_long e = start[i]; e < start[i + 1]; e++) {
            if ((size_t)index[e] != i) {
                int64_t at = t->start[index[e] + 1]++;
                t->index[at] = (int32_t)i;
                t->value[at] = value[e];
            }
        }
    }
    return 0;
}

static int alloc_orders(pal_factor *f) {
    size_t n = (size_t)f->n;
    pal_lu *lu = &f->lu;
    lu->n = f->n;
    lu->diagonal = malloc(n * sizeof *lu->diagonal);
    lu->row_order = malloc(n * sizeof *lu->row_order);
    lu->column_order = malloc(n * sizeof *lu->column_order);
    lu->row_scale = malloc(n * sizeof *lu->row_scale);
    return !lu->diagonal || !lu->row_order || !lu->column_order || !lu->row_scale;
}

static pal_status no_memory(int64_t entries, pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the factors (%lld entries)",
                    (long long)entries);
}

/// Copy UMFPACK's factors into the block solver's panels, L first and then U: one at a time in
/// memory.
static pal_status extract_lu(pal_factor *f, pal_error *error) {
    SuiteSparse_long lnz, unz, rows, columns, nz_diagonal, recip = 0;
    pal_lu *lu = &f->lu;
    if (umfpack_dl_get_lunz(&lnz, &unz, &rows, &columns, &nz_diagonal, f->numeric) != UMFPACK_OK) {
        return pal_fail(error, PALPATE_ERROR_SINGULAR, "UMFPACK did not return its factors");
    }
    size_t n = (size_t)f->n, most = (size_t)(lnz > unz ? lnz : unz);
    SuiteSparse_long *start = malloc((n + 1) * sizeof *start),
                     *index = malloc(most * sizeof *index);
    SuiteSparse_long *p = malloc(n * sizeof *p), *q = malloc(n * sizeof *q);
    double *value = malloc(most * sizeof *value);
    triangle t = {0};
    pal_status status = PALPATE_OK;
    if (!start || !index || !p || !q || !value || alloc_orders(f) != 0) {
        status = no_memory(lnz + unz, error);
    }
    // with a whole object it fails for lack of memory only
    if (status == PALPATE_OK &&
        umfpack_dl_get_numeric(start, index, value, NULL, NULL, NULL, p, q, NULL, &recip,
                               lu->row_scale, f->numeric) != UMFPACK_OK) {
        status = no_memory(lnz + unz, error);
    }
    for (size_t i = 0; status == PALPATE_OK && i < n; i++) {
        lu->row_order[i] = (int32_t)p[i];
        lu->column_order[i] = (int32_t)q[i];
        if (!recip) {
            lu->row_scale[i] = 1.0 / lu->row_scale[i];
        }
    }
    if (status == PALPATE_OK &&
        (transpose(n, start, index, value, NULL, &t) != 0 ||
         pal_lu_panels_make(f->n, t.start, t.index, t.value, 0, &lu->lower) != 0)) {
        status = no_memory(lnz, error);
    }
    triangle_clear(&t);
    if (status == PALPATE_OK &&
        umfpack_dl_get_numeric(NULL, NULL, NULL, start, index, value, NULL, NULL, NULL, NULL, NULL,
                               f->numeric) != UMFPACK_OK) {
        status = no_memory(lnz + unz, error);
    }
    if (status == PALPATE_OK &&
        (transpose(n, start, index, value, lu->diagonal, &t) != 0 ||
         pal_lu_panels_make(f->n, t.start, t.index, t.value, 1, &lu->upper) != 0)) {
        status = no_memory(unz, error);
    }
    triangle_clear(&t);
    free(start);
    free(index);
    free(p);
    free(q);
    free(value);
    return status;
}

/// UMFPACK reads SuiteSparse_long (64-bit) arrays: pal_sparse has int64_t of the same layout.
_Static_assert(sizeof(SuiteSparse_long) == sizeof(int64_t), "SuiteSparse_long is 64 bits");

/// A pivot ratio below n ulps is rounding noise: the last pivot of an exactly singular matrix.
static double rcond_floor(int32_t n) {
    return (double)n * DBL_EPSILON;
}

static pal_status singular_message(const double *info, int32_t n, pal_error *error) {
    return pal_fail(
        error, PALPATE_ERROR_SINGULAR,
        "the stiffness is singular to working precision: rank about %.0f of %d unknowns "
        "(rcond %.1e); is the body held against every rigid motion (body.fixed), and is "
        "the spacing fine enough for its thinnest part?",
        n - (info[UMFPACK_NROW] - info[UMFPACK_UDIAG_NZ]), n, info[UMFPACK_RCOND]);
}

/// Refuse a factorization that will not fit, before its numerical phase: with `entries` known from
/// the symbolic analysis (exact unless pivots leave the diagonal), `bytes_each` at the peak (which
/// is our extraction: the library's factor, its copy, its transpose and the panels), and 1 kB a
/// thread and unknown for the solves.
static pal_status check_memory(int32_t n, double entries, double bytes_each, uint64_t reserve,
                               pal_error *error) {
    double need = entries * bytes_each + 2000.0 * n + (double)reserve;
    double available = (double)pal_memory_available();
    if (available <= 0.0 || need <= available) {
        return PALPATE_OK;
    }
    return pal_fail(
        error, PALPATE_ERROR_MEMORY,
        "the factors of %d unknowns (%.3g million entries) and the compliance need about "
        "%.1f GB of memory and %.1f GB are free: use a larger body.spacing, narrow "
        "body.touchable or store less (store.displacement)",
        n, 1e-6 * entries, 1e-9 * need, 1e-9 * available);
}

static pal_status create_lu(pal_factor *f, const pal_sparse *k, uint64_t reserve,
                            pal_factor_report *report, pal_error *error) {
    double control[UMFPACK_CONTROL], info[UMFPACK_INFO];
    umfpack_dl_defaults(control);
    control[UMFPACK_STRATEGY] = UMFPACK_STRATEGY_SYMMETRIC;
    control[UMFPACK_ORDERING] = UMFPACK_ORDERING_METIS;
    control[UMFPACK_SCALE] = UMFPACK_SCALE_MAX;
    control[UMFPACK_IRSTEP] = 0;
    void *symbolic = NULL;
    const SuiteSparse_long *ap = (const SuiteSparse_long *)k->start;
    const SuiteSparse_long *ai = (const SuiteSparse_long *)k->row;
    SuiteSparse_long n = (SuiteSparse_long)k->columns;
    SuiteSparse_long s = umfpack_dl_symbolic(n, n, ap, ai, k->value, &symbolic, control, info);
    if (s == UMFPACK_OK) {
        pal_status fits = check_memory(f->n, info[UMFPACK_SYMMETRIC_LUNZ], 32.0, reserve, error);
        if (fits != PALPATE_OK) {
            umfpack_dl_free_symbolic(&symbolic);
            return fits;
        }
        s = umfpack_dl_numeric(ap, ai, k->value, symbolic, &f->numeric, control, info);
    }
    if (symbolic != NULL) {
        umfpack_dl_free_symbolic(&symbolic);
    }
    // an ordering fails for lack of memory only: a singular pattern is found later
    if (s == UMFPACK_ERROR_out_of_memory || s == UMFPACK_ERROR_ordering_failed) {
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "out of memory while factoring %d unknowns: use a larger body.spacing",
                        f->n);
    }
    if (s == UMFPACK_WARNING_singular_matrix) {
        return singular_message(info, f->n, error);
    }
    if (s != UMFPACK_OK) {
        return pal_fail(error, PALPATE_ERROR_SINGULAR, "UMFPACK refused the stiffness (status %ld)",
                        (long)s);
    }
    double rcond = info[UMFPACK_RCOND];
    if (!(rcond > rcond_floor(f->n))) {
        return singular_message(info, f->n, error);
    }
    pal_status status = extract_lu(f, error);
    if (status != PALPATE_OK) {
        return status;
    }
    if (report != NULL) {
        const char *ordering = info[UMFPACK_ORDERING_USED] == UMFPACK_ORDERING_METIS ? "METIS"
                               : info[UMFPACK_ORDERING_USED] == UMFPACK_ORDERING_AMD ? "AMD"
                                                                                     : "other";
        (void)snprintf(report->kind, sizeof report->kind, "UMFPACK %d.%d.%d (%s strategy, %s)",
                       UMFPACK_MAIN_VERSION, UMFPACK_SUB_VERSION, UMFPACK_SUBSUB_VERSION,
                       info[UMFPACK_STRATEGY_USED] == UMFPACK_STRATEGY_SYMMETRIC ? "symmetric"
                                                                                 : "unsymmetric",
                       ordering);
        report->rcond = rcond;
        report->nonzeros = (int64_t)(info[UMFPACK_LNZ] + info[UMFPACK_UNZ]);
        report->bytes = pal_lu_bytes(&f->lu);
        report->flops = info[UMFPACK_FLOPS];
    }
    return PALPATE_OK;
}

/// A view of a pal_sparse (both triangles) as CHOLMOD's symmetric upper-triangular matrix.
static cholmod_sparse chol_view(const pal_sparse *k) {
    cholmod_sparse a = {0};
    a.nrow = (size_t)k->rows;
    a.ncol = (size_t)k->columns;
    a.nzmax = (size_t)k->start[k->columns];
    a.p = k->start;
    a.i = k->row;
    a.x = k->value;
    a.stype = 1;
    a.itype = CHOLMOD_LONG;
    a.xtype = CHOLMOD_REAL;
    a.dtype = CHOLMOD_DOUBLE;
    a.sorted = 1;
    a.packed = 1;
    return a;
}

static void chol_start(cholmod_common *common) {
    cholmod_l_start(common);
    common->print = 0;
    common->supernodal = CHOLMOD_SUPERNODAL;
    common->quick_return_if_not_posdef = 1;
    common->nmethods = 1;
    common->method[0].ordering = CHOLMOD_METIS;
    common->metis_memory = 2.0; // METIS ends the process when it runs out: ask for its room before
    common->postorder = 1;
}

/// Copy CHOLMOD's L (simplicial, packed) into the block solver's panels: with D its diagonal,
/// L L^T = (L D^-1) (D L^T), a unit lower and an upper triangular factor of the same pattern.
static pal_status extract_cholesky(pal_factor *f, pal_error *error) {
    const cholmod_factor *c = f->chol;
    const SuiteSparse_long *start = c->p, *row = c->i, *permutation = c->Perm;
    const double *value = c->x;
    pal_lu *lu = &f->lu;
    size_t n = (size_t)f->n, entries = (size_t)start[n];
    triangle t = {0};
    if (alloc_orders(f) != 0 || triangle_alloc(n, entries, &t) != 0) {
        triangle_clear(&t);
        return no_memory((int64_t)entries, error);
    }
    int failed = 0;
    for (int upper = 0; upper < 2 && !failed; upper++) {
        int64_t at = 0;
        for (size_t j = 0; j < n; j++) { // each column starts with its diagonal
            double d = value[start[j]];
            lu->diagonal[j] = 1.0 / (d * d);
            lu->row_order[j] = lu->column_order[j] = (int32_t)permutation[j];
            lu->row_scale[j] = 1.0;
            t.start[j] = at;
            for (SuiteSparse_long e = start[j] + 1; e < start[j + 1]; e++) {
                t.index[at] = (int32_t)row[e];
                t.value[at++] = upper ? d * value[e] : value[e] / d;
            }
        }
        t.start[n] = at;
        failed = pal_lu_panels_make(f->n, t.start, t.index, t.value, upper,
                                    upper ? &lu->upper : &lu->lower) != 0;
    }
    triangle_clear(&t);
    return failed ? no_memory((int64_t)entries, error) : PALPATE_OK;
}

static pal_status create_cholesky(pal_factor *f, const pal_sparse *k, uint64_t reserve,
                                  pal_factor_report *report, pal_error *error) {
    cholmod_sparse a = chol_view(k);
    cholmod_common *common = &f->common;
    f->chol = cholmod_l_analyze(&a, common);
    if (f->chol != NULL) {
        pal_status fits = check_memory(f->n, common->lnz, 48.0, reserve, error);
        if (fits != PALPATE_OK) {
            return fits;
        }
    }
    if (f->chol == NULL || cholmod_l_factorize(&a, f->chol, common) == 0 ||
        common->status == CHOLMOD_OUT_OF_MEMORY || common->status == CHOLMOD_TOO_LARGE) {
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "out of memory while factoring %d unknowns: use a larger body.spacing",
                        f->n);
    }
    double rcond = common->status == CHOLMOD_OK ? cholmod_l_rcond(f->chol, common) : 0.0;
    if (common->status == CHOLMOD_NOT_POSDEF || !(rcond > rcond_floor(f->n))) {
        return pal_fail(
            error, PALPATE_ERROR_SINGULAR,
            "the stiffness is not positive definite (stopped at unknown %lld of %d, rcond "
            "%.1e); is the body held against every rigid motion (body.fixed), and is the "
            "spacing fine enough for its thinnest part?",
            (long long)f->chol->minor, f->n, rcond);
    }
    if (!cholmod_l_change_factor(CHOLMOD_REAL, 1, 0, 1, 1, f->chol, common)) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the factors of %d unknowns",
                        f->n);
    }
    pal_status status = extract_cholesky(f, error);
    if (status == PALPATE_OK && report != NULL) {
        int version[3];
        cholmod_l_version(version);
        (void)snprintf(report->kind, sizeof report->kind, "CHOLMOD %d.%d.%d (supernodal, METIS)",
                       version[0], version[1], version[2]);
        report->rcond = rcond;
        report->nonzeros = (int64_t)common->method[common->selected].lnz;
        report->bytes = pal_lu_bytes(&f->lu);
        report->flops = common->method[common->selected].fl;
    }
    return status;
}

pal_status pal_factor_create(const pal_sparse *k, int positive, const pal_progress *progress,
                             pal_factor **out, pal_factor_report *report, pal_error *error) {
    return pal_factor_create_beside(k, positive, 0, progress, out, report, error);
}

pal_status pal_factor_create_beside(const pal_sparse *k, int positive, uint64_t reserve,
                                    const pal_progress *progress, pal_factor **out,
                                    pal_factor_report *report, pal_error *error) {
    *out = NULL;
    if (k->rows != k->columns || k->columns < 1 || k->columns > INT32_MAX / 4) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "cannot factor a %lld x %lld matrix",
                        (long long)k->rows, (long long)k->columns);
    }
    if (progress != NULL && progress->call != NULL &&
        progress->call(progress->user, "factor", -1.0, -1.0) != 0) {
        return pal_fail(error, PALPATE_ERROR_CANCELLED, "cancelled before the factorization");
    }
    for (int64_t e = 0; e < k->start[k->columns]; e++) {
        if (!isfinite(k->value[e])) {
            return pal_fail(error, PALPATE_ERROR_SINGULAR,
                            "the stiffness has an entry that is not finite");
        }
    }
    double begin = pal_seconds_now();
    pal_factor *f = calloc(1, sizeof *f);
    if (f == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    f->n = (int32_t)k->columns;
    f->positive = positive;
    pal_status status;
    if (positive) {
        chol_start(&f->common);
        status = create_cholesky(f, k, reserve, report, error);
    } else {
        status = create_lu(f, k, reserve, report, error);
    }
    if (status != PALPATE_OK) {
        pal_factor_free(f);
        return status;
    }
    if (report != NULL) {
        report->seconds = pal_seconds_now() - begin;
    }
    *out = f;
    return PALPATE_OK;
}

pal_factor_workspace *pal_factor_workspace_new(const pal_factor *factor) {
    pal_factor_workspace *w = calloc(1, sizeof *w);
    if (w == NULL) {
        return NULL;
    }
    w->factor = factor;
    w->work = aligned_alloc(64, (size_t)factor->n * PALPATE_LU_BLOCK * sizeof *w->work);
    if (w->work == NULL) {
        free(w);
        return NULL;
    }
    return w;
}

void pal_factor_workspace_free(pal_factor_workspace *w) {
    if (w != NULL) {
        free(w->work);
        free(w);
    }
}

pal_status pal_factor_need(pal_factor *factor, const uint8_t *needed, pal_error *error) {
    free(factor->lu.needed);
    factor->lu.needed = NULL;
    if (needed == NULL) {
        return PALPATE_OK;
    }
    uint8_t *mark = malloc((size_t)factor->lu.upper.count);
    if (mark == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    pal_lu_mark_needed(&factor->lu, needed, mark);
    factor->lu.needed = mark;
    return PALPATE_OK;
}

pal_status pal_factor_solve(const pal_factor *factor, pal_factor_workspace *workspace,
                            int32_t count, double *x, pal_error *error) {
    if (count < 0 || workspace == NULL || workspace->factor != factor) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "workspace of another factor");
    }
    for (int32_t c = 0; c < count; c += PALPATE_LU_BLOCK) {
        int32_t m = count - c < PALPATE_LU_BLOCK ? count - c : PALPATE_LU_BLOCK;
        pal_lu_solve(&factor->lu, pal_lu_best_variant(), m, x + (int64_t)c * factor->n,
                     workspace->work);
    }
    return PALPATE_OK;
}

pal_status pal_factor_solve_reference(const pal_factor *factor, const pal_sparse *k, int refine,
                                      const double *b, double *x, pal_error *error) {
    if (factor->positive) {
        cholmod_common common;
        cholmod_dense view = {0};
        union {
            const double *from;
            void *to;
        } rhs = {.from = b};
        view.nrow = view.nzmax = view.d = (size_t)factor->n;
        view.ncol = 1;
        view.x = rhs.to;
        view.xtype = CHOLMOD_REAL;
        view.dtype = CHOLMOD_DOUBLE;
        chol_start(&common);
        cholmod_dense *solution = cholmod_l_solve(CHOLMOD_A, factor->chol, &view, &common);
        if (solution != NULL) {
            memcpy(x, solution->x, view.nzmax * sizeof *x);
            cholmod_l_free_dense(&solution, &common);
        }
        int ok = common.status == CHOLMOD_OK;
        cholmod_l_finish(&common);
        return ok ? PALPATE_OK : pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    double control[UMFPACK_CONTROL], info[UMFPACK_INFO];
    umfpack_dl_defaults(control);
    control[UMFPACK_IRSTEP] = refine;
    SuiteSparse_long s = umfpack_dl_solve(UMFPACK_A, (const SuiteSparse_long *)k->start,
                                          (const SuiteSparse_long *)k->row, k->value, x, b,
                                          factor->numeric, control, info);
    if (s != UMFPACK_OK) {
        return pal_fail(
            error, s == UMFPACK_ERROR_out_of_memory ? PALPATE_ERROR_MEMORY : PALPATE_ERROR_SINGULAR,
            "UMFPACK's solve failed (status %ld)", (long)s);
    }
    return PALPATE_OK;
}
