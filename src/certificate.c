/// @file certificate.c  Reciprocity, passivity, residuals: what a model says about itself.
#include "src/certificate.h"

#include <lapacke.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/error.h"

enum { CONTACT_SAMPLES = 8, CONTACT_NODES = 12, CONTACT_NODES_MAX = 512 };

/// Gates. The residual of a column is far below what any force needs; above 1e-8 the factorization
/// itself is in doubt.
static const double RESIDUAL_GATE = 1e-8;
/// Stencils with a scaled condition above this reproduce nothing.
static const double STENCIL_GATE = 1e12;

double pal_reciprocity_error(const double *c, int64_t n) {
    double skew = 0.0, all = 0.0;
    for (int64_t j = 0; j < n; j++) {
        for (int64_t i = 0; i < j; i++) {
            double a = c[j * n + i], b = c[i * n + j];
            skew += 2.0 * (a - b) * (a - b);
            all += a * a + b * b;
        }
        all += c[j * n + j] * c[j * n + j];
    }
    return all > 0.0 ? sqrt(skew / all) : 0.0;
}

void pal_symmetrize(double *c, int64_t n) {
    enum { TILE = 32 };
    for (int64_t jb = 0; jb < n; jb += TILE) {
        for (int64_t ib = 0; ib <= jb; ib += TILE) {
            for (int64_t j = jb; j < jb + TILE && j < n; j++) {
                for (int64_t i = ib; i < ib + TILE && i < j; i++) {
                    double mean = 0.5 * (c[j * n + i] + c[i * n + j]);
                    c[j * n + i] = c[i * n + j] = mean;
                }
            }
        }
    }
}

/// Total force of a bonded contact on column nodes `set` displaced by u, from the raw block and from
/// its symmetric part. @return relative difference, or a negative number when it cannot be solved
static double force_change(const pal_model *m, const int32_t *set, int32_t count, const double u[3]) {
    int64_t n = 3 * (int64_t)count, t = 3 * (int64_t)m->info.column_count;
    double *a = malloc((size_t)(2 * n * n + 2 * n) * sizeof *a);
    lapack_int *pivot = malloc((size_t)n * sizeof *pivot);
    double change = -1.0;
    if (a != NULL && pivot != NULL) {
        double *s = a + n * n, *f = s + n * n, *g = f + n;
        for (int64_t j = 0; j < n; j++) {
            int64_t cj = 3 * (int64_t)set[j / 3] + j % 3;
            for (int64_t i = 0; i < n; i++) {
                int64_t ci = 3 * (int64_t)set[i / 3] + i % 3;
                a[j * n + i] = m->c_tt[cj * t + ci];
                s[j * n + i] = 0.5 * (m->c_tt[cj * t + ci] + m->c_tt[ci * t + cj]);
            }
            f[j] = g[j] = u[j % 3];
        }
        if (LAPACKE_dgesv(LAPACK_COL_MAJOR, (int)n, 1, a, (int)n, pivot, f, (int)n) == 0 &&
            LAPACKE_dgesv(LAPACK_COL_MAJOR, (int)n, 1, s, (int)n, pivot, g, (int)n) == 0) {
            double raw[3] = {0}, off[3] = {0};
            for (int64_t i = 0; i < n; i++) {
                raw[i % 3] += f[i];
                off[i % 3] += g[i] - f[i];
            }
            double size = sqrt(raw[0] * raw[0] + raw[1] * raw[1] + raw[2] * raw[2]);
            change = sqrt(off[0] * off[0] + off[1] * off[1] + off[2] * off[2]) / size;
        }
    }
    free(pivot);
    free(a);
    return change;
}

/// The worst force change over the patches (along each axis) and over small contacts sampled evenly
/// among the column nodes (pressed along the inward normal).
static double sampled_force_change(const pal_model *m, pal_error *error, pal_status *status) {
    double worst = -1.0;
    int32_t t = m->info.column_count;
    for (int32_t p = 0; p < m->info.patch_count; p++) {
        if (m->patch[p].count > CONTACT_NODES_MAX) {
            continue;
        }
        for (int d = 0; d < 3; d++) {
            double u[3] = {d == 0, d == 1, d == 2};
            worst = fmax(worst, force_change(m, m->patch[p].column, m->patch[p].count, u));
        }
    }
    double *distance = malloc((size_t)t * sizeof *distance);
    if (distance == NULL) {
        *status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
        return worst;
    }
    for (int k = 0; k < CONTACT_SAMPLES; k++) {
        int32_t center = (int32_t)((int64_t)(t - 1) * k / (CONTACT_SAMPLES - 1));
        const double *x = m->position + 3 * (int64_t)m->column_node[center];
        for (int32_t i = 0; i < t; i++) {
            const double *y = m->position + 3 * (int64_t)m->column_node[i];
            distance[i] = hypot(hypot(y[0] - x[0], y[1] - x[1]), y[2] - x[2]);
        }
        int32_t set[CONTACT_NODES], count = 0;
        while (count < CONTACT_NODES && count < t) {
            int32_t best = 0;
            for (int32_t i = 1; i < t; i++) {
                if (distance[i] < distance[best]) {
                    best = i;
                }
            }
            distance[best] = INFINITY;
            set[count++] = best;
        }
        const double *normal = m->normal + 3 * (int64_t)m->column_node[center];
        double u[3] = {-normal[0], -normal[1], -normal[2]};
        worst = fmax(worst, force_change(m, set, count, u));
    }
    free(distance);
    return worst;
}

static void judge(pal_certificate *c, const pal_model *m, int finite) {
    const char *method = m->info.method;
    char *r = c->reason;
    size_t size = sizeof c->reason;
    c->pass = 0;
    if (!finite) {
        (void)snprintf(r, size, "the compliance has entries that are not finite");
    } else if (!(c->solve_residual <= RESIDUAL_GATE)) {
        (void)snprintf(r, size,
                       "the solved columns do not satisfy the equations (residual %.1e, allowed %.0e): the "
                       "system is too ill-conditioned (rcond %.1e); hold the body better or use "
                       "method: {kind: galerkin}",
                       c->solve_residual, RESIDUAL_GATE, c->rcond);
    } else if (!(c->mls_worst_condition <= STENCIL_GATE)) {
        (void)snprintf(r, size,
                       "a moving-least-squares stencil at (%.6g, %.6g, %.6g) m has condition %.1e (allowed "
                       "%.0e): use more neighbours (method.neighbours) or a more even cloud",
                       c->mls_worst_point[0], c->mls_worst_point[1], c->mls_worst_point[2],
                       c->mls_worst_condition, STENCIL_GATE);
    } else if (!(c->min_eigenvalue_ratio > 0.0)) {
        (void)snprintf(r, size,
                       "the symmetric part of the touchable compliance is not positive definite (smallest "
                       "over largest eigenvalue %.1e): it would feed energy into the hand; %s",
                       c->min_eigenvalue_ratio,
                       strcmp(method, "point") == 0
                           ? "point collocation does this on graded clouds and for nu near 0.5: use "
                             "method: {kind: cell} or {kind: galerkin}"
                           : "use a finer body.spacing or method: {kind: galerkin}");
    } else {
        c->pass = 1;
        r[0] = '\0';
    }
}

pal_status pal_certify(const pal_system *system, const pal_factor_report *factor,
                       const pal_compliance_report *compliance, double length, int symmetrize,
                       const pal_progress *progress, pal_model *model, pal_error *error) {
    pal_certificate *c = &model->info.certificate;
    int64_t n = 3 * (int64_t)model->info.column_count;
    memset(c, 0, sizeof *c);
    c->solve_residual = compliance->residual;
    c->force_balance = compliance->balance;
    c->rcond = factor->rcond;
    c->mls_worst_condition = system->stencils.worst_condition;
    for (int d = 0; d < 3; d++) {
        c->mls_worst_point[d] = length * system->stencils.worst_point[d];
    }
    c->mls_grown = (int32_t)system->stencils.grown;
    c->estimated_error = -1.0;
    c->loop_energy = c->loop_energy_raw = -1.0;
    int finite = 1;
    for (int64_t i = 0; finite && i < n * n; i++) {
        finite = isfinite(model->c_tt[i]);
    }
    if (progress != NULL && progress->call != NULL &&
        progress->call(progress->user, "certify", -1.0, -1.0) != 0) {
        return pal_fail(error, PALPATE_ERROR_CANCELLED, "cancelled before the certificate");
    }
    pal_status status = PALPATE_OK;
    if (finite) {
        int positive = 0;
        c->reciprocity = pal_reciprocity_error(model->c_tt, n);
        c->force_change = sampled_force_change(model, error, &status);
        if (symmetrize) {
            pal_symmetrize(model->c_tt, n);
            c->symmetrized = 1;
        }
        if (status == PALPATE_OK) {
            status = pal_extreme_eigenvalues(model->c_tt, n, &c->min_eigenvalue, &c->max_eigenvalue,
                                             &positive, error);
        }
        c->min_eigenvalue_ratio = c->min_eigenvalue / c->max_eigenvalue;
        if (!positive && c->min_eigenvalue_ratio > 0.0) {
            c->min_eigenvalue_ratio = -c->min_eigenvalue_ratio; // Cholesky broke down: not positive
        }
        c->passive = symmetrize && positive;
    }
    if (status != PALPATE_OK) {
        return status;
    }
    judge(c, model, finite);
    return PALPATE_OK;
}
