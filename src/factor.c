/// @file factor.c  The one file that includes SuiteSparse: UMFPACK and CHOLMOD (see factor.h).
#include "src/factor.h"

#include <float.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <cholmod.h>
#include <umfpack.h>

#include "haptic/error.h"
#include "src/lu_solve.h"

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

static double seconds_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

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

/// Copy UMFPACK's factors into the block solver's layout.
static pal_status extract_lu(pal_factor *f, pal_error *error) {
    SuiteSparse_long lnz, unz, rows, columns, nz_diagonal;
    pal_lu *lu = &f->lu;
    pal_status status = PALPATE_ERROR_MEMORY;
    SuiteSparse_long *lp = NULL, *lj = NULL, *up = NULL, *ui = NULL, *p = NULL, *q = NULL, recip = 0;
    double *lx = NULL, *ux = NULL;
    if (umfpack_dl_get_lunz(&lnz, &unz, &rows, &columns, &nz_diagonal, f->numeric) != UMFPACK_OK) {
        return pal_fail(error, PALPATE_ERROR_SINGULAR, "UMFPACK did not return its factors");
    }
    size_t n = (size_t)f->n;
    lp = malloc((n + 1) * sizeof *lp);
    lj = malloc((size_t)lnz * sizeof *lj);
    lx = malloc((size_t)lnz * sizeof *lx);
    up = malloc((n + 1) * sizeof *up);
    ui = malloc((size_t)unz * sizeof *ui);
    ux = malloc((size_t)unz * sizeof *ux);
    p = malloc(n * sizeof *p);
    q = malloc(n * sizeof *q);
    lu->n = f->n;
    lu->l_start = calloc(n + 2, sizeof *lu->l_start);
    lu->l_row = malloc((size_t)lnz * sizeof *lu->l_row);
    lu->l_value = malloc((size_t)lnz * sizeof *lu->l_value);
    lu->u_start = malloc((n + 1) * sizeof *lu->u_start);
    lu->u_row = malloc((size_t)unz * sizeof *lu->u_row);
    lu->u_value = malloc((size_t)unz * sizeof *lu->u_value);
    lu->diagonal = malloc(n * sizeof *lu->diagonal);
    lu->row_order = malloc(n * sizeof *lu->row_order);
    lu->column_order = malloc(n * sizeof *lu->column_order);
    lu->row_scale = malloc(n * sizeof *lu->row_scale);
    if (!lp || !lj || !lx || !up || !ui || !ux || !p || !q || !lu->l_start || !lu->l_row ||
        !lu->l_value || !lu->u_start || !lu->u_row || !lu->u_value || !lu->diagonal ||
        !lu->row_order || !lu->column_order || !lu->row_scale) {
        pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the factors (%lld entries)",
                 (long long)(lnz + unz));
        goto done;
    }
    if (umfpack_dl_get_numeric(lp, lj, lx, up, ui, ux, p, q, NULL, &recip, lu->row_scale,
                               f->numeric) != UMFPACK_OK) {
        status = pal_fail(error, PALPATE_ERROR_SINGULAR, "UMFPACK did not return its factors");
        goto done;
    }
    for (size_t i = 0; i < n; i++) {
        lu->row_order[i] = (int32_t)p[i];
        lu->column_order[i] = (int32_t)q[i];
        if (!recip) {
            lu->row_scale[i] = 1.0 / lu->row_scale[i];
        }
    }
    // L comes by rows with its unit diagonal: transpose, dropping the diagonal
    for (size_t i = 0; i < n; i++) {
        for (SuiteSparse_long e = lp[i]; e < lp[i + 1]; e++) {
            if ((size_t)lj[e] != i) {
                lu->l_start[lj[e] + 2]++;
            }
        }
    }
    for (size_t j = 1; j <= n + 1; j++) {
        lu->l_start[j] += lu->l_start[j - 1];
    }
    for (size_t i = 0; i < n; i++) {
        for (SuiteSparse_long e = lp[i]; e < lp[i + 1]; e++) {
            if ((size_t)lj[e] != i) {
                int64_t at = lu->l_start[lj[e] + 1]++;
                lu->l_row[at] = (int32_t)i;
                lu->l_value[at] = lx[e];
            }
        }
    }
    // U comes by columns with its diagonal
    int64_t at = 0;
    for (size_t j = 0; j < n; j++) {
        lu->u_start[j] = at;
        for (SuiteSparse_long e = up[j]; e < up[j + 1]; e++) {
            if ((size_t)ui[e] == j) {
                lu->diagonal[j] = 1.0 / ux[e];
            } else {
                lu->u_row[at] = (int32_t)ui[e];
                lu->u_value[at++] = ux[e];
            }
        }
    }
    lu->u_start[n] = at;
    status = PALPATE_OK;
done:
    free(lp);
    free(lj);
    free(lx);
    free(up);
    free(ui);
    free(ux);
    free(p);
    free(q);
    return status;
}

/// UMFPACK reads SuiteSparse_long (64-bit) arrays: pal_sparse has int64_t of the same layout.
_Static_assert(sizeof(SuiteSparse_long) == sizeof(int64_t), "SuiteSparse_long is 64 bits");

/// A pivot ratio below n ulps is rounding noise: the last pivot of an exactly singular matrix.
static double rcond_floor(int32_t n) {
    return (double)n * DBL_EPSILON;
}

static pal_status singular_message(const double *info, int32_t n, pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_SINGULAR,
                    "the stiffness is singular to working precision: rank about %.0f of %d unknowns "
                    "(rcond %.1e); is the body held against every rigid motion (body.fixed), and is "
                    "the spacing fine enough for its thinnest part?",
                    n - (info[UMFPACK_NROW] - info[UMFPACK_UDIAG_NZ]), n, info[UMFPACK_RCOND]);
}

static pal_status create_lu(pal_factor *f, const pal_sparse *k, pal_factor_report *report,
                            pal_error *error) {
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
        s = umfpack_dl_numeric(ap, ai, k->value, symbolic, &f->numeric, control, info);
    }
    if (symbolic != NULL) {
        umfpack_dl_free_symbolic(&symbolic);
    }
    if (s == UMFPACK_ERROR_out_of_memory) {
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "out of memory while factoring %d unknowns: use a larger body.spacing", f->n);
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
        report->bytes = (uint64_t)(12.0 * (info[UMFPACK_LNZ] + info[UMFPACK_UNZ]));
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
    common->postorder = 1;
}

/// Copy CHOLMOD's L (simplicial, packed) into the block solver's layout: with D its diagonal,
/// L L^T = (L D^-1) (D L^T), a unit lower and an upper triangular factor.
static pal_status extract_cholesky(pal_factor *f, pal_error *error) {
    const cholmod_factor *c = f->chol;
    const SuiteSparse_long *start = c->p, *row = c->i, *permutation = c->Perm;
    const double *value = c->x;
    pal_lu *lu = &f->lu;
    size_t n = (size_t)f->n, entries = (size_t)start[n];
    lu->n = f->n;
    lu->l_start = malloc((n + 1) * sizeof *lu->l_start);
    lu->u_start = calloc(n + 2, sizeof *lu->u_start);
    lu->l_row = malloc(entries * sizeof *lu->l_row);
    lu->u_row = malloc(entries * sizeof *lu->u_row);
    lu->l_value = malloc(entries * sizeof *lu->l_value);
    lu->u_value = malloc(entries * sizeof *lu->u_value);
    lu->diagonal = malloc(n * sizeof *lu->diagonal);
    lu->row_order = malloc(n * sizeof *lu->row_order);
    lu->column_order = malloc(n * sizeof *lu->column_order);
    lu->row_scale = malloc(n * sizeof *lu->row_scale);
    if (!lu->l_start || !lu->u_start || !lu->l_row || !lu->u_row || !lu->l_value || !lu->u_value ||
        !lu->diagonal || !lu->row_order || !lu->column_order || !lu->row_scale) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for the factors (%zu entries)",
                        2 * entries);
    }
    int64_t at = 0;
    for (size_t j = 0; j < n; j++) { // each column starts with its diagonal
        double d = value[start[j]];
        lu->diagonal[j] = 1.0 / (d * d);
        lu->row_order[j] = lu->column_order[j] = (int32_t)permutation[j];
        lu->row_scale[j] = 1.0;
        lu->l_start[j] = at;
        for (SuiteSparse_long e = start[j] + 1; e < start[j + 1]; e++) {
            lu->l_row[at] = (int32_t)row[e];
            lu->l_value[at++] = value[e] / d;
            lu->u_start[row[e] + 2]++;
        }
    }
    lu->l_start[n] = at;
    for (size_t j = 1; j <= n + 1; j++) {
        lu->u_start[j] += lu->u_start[j - 1];
    }
    for (size_t i = 0; i < n; i++) { // column k of D L^T holds d_i L_ki
        for (SuiteSparse_long e = start[i] + 1; e < start[i + 1]; e++) {
            int64_t to = lu->u_start[row[e] + 1]++;
            lu->u_row[to] = (int32_t)i;
            lu->u_value[to] = value[start[i]] * value[e];
        }
    }
    return PALPATE_OK;
}

static pal_status create_cholesky(pal_factor *f, const pal_sparse *k, pal_factor_report *report,
                                  pal_error *error) {
    cholmod_sparse a = chol_view(k);
    cholmod_common *common = &f->common;
    f->chol = cholmod_l_analyze(&a, common);
    if (f->chol == NULL || cholmod_l_factorize(&a, f->chol, common) == 0 ||
        common->status == CHOLMOD_OUT_OF_MEMORY || common->status == CHOLMOD_TOO_LARGE) {
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "out of memory while factoring %d unknowns: use a larger body.spacing", f->n);
    }
    double rcond = common->status == CHOLMOD_OK ? cholmod_l_rcond(f->chol, common) : 0.0;
    if (common->status == CHOLMOD_NOT_POSDEF || !(rcond > rcond_floor(f->n))) {
        return pal_fail(error, PALPATE_ERROR_SINGULAR,
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
        report->bytes = (uint64_t)(24.0 * common->method[common->selected].lnz);
        report->flops = common->method[common->selected].fl;
    }
    return status;
}

pal_status pal_factor_create(const pal_sparse *k, int positive, const pal_progress *progress,
                             pal_factor **out, pal_factor_report *report, pal_error *error) {
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
    double begin = seconds_now();
    pal_factor *f = calloc(1, sizeof *f);
    if (f == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    f->n = (int32_t)k->columns;
    f->positive = positive;
    pal_status status;
    if (positive) {
        chol_start(&f->common);
        status = create_cholesky(f, k, report, error);
    } else {
        status = create_lu(f, k, report, error);
    }
    if (status != PALPATE_OK) {
        pal_factor_free(f);
        return status;
    }
    if (report != NULL) {
        report->seconds = seconds_now() - begin;
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
    uint8_t *mark = malloc((size_t)factor->n);
    if (mark == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    pal_lu_mark_needed(&factor->lu, needed, mark);
    factor->lu.needed = mark;
    return PALPATE_OK;
}

pal_status pal_factor_solve(const pal_factor *factor, pal_factor_workspace *workspace, int32_t count,
                            double *x, pal_error *error) {
    if (count < 0 || workspace == NULL || workspace->factor != factor) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "workspace of another factor");
    }
    for (int32_t c = 0; c < count; c += PALPATE_LU_BLOCK) {
        int32_t m = count - c < PALPATE_LU_BLOCK ? count - c : PALPATE_LU_BLOCK;
        pal_lu_solve(&factor->lu, m, x + (int64_t)c * factor->n, workspace->work);
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
        return pal_fail(error, s == UMFPACK_ERROR_out_of_memory ? PALPATE_ERROR_MEMORY : PALPATE_ERROR_SINGULAR,
                        "UMFPACK's solve failed (status %ld)", (long)s);
    }
    return PALPATE_OK;
}
