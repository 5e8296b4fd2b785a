/// @file certificate.c  Reciprocity, passivity, residuals: what a model says about itself.
#include "src/certificate/certificate.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/certificate/contact_stiffness.h"
#include "src/certificate/repair.h"

enum { CONTACT_SAMPLES = 8, CONTACT_NODES = 12, CONTACT_NODES_MAX = 512 };

/// Gates. The residual of a column is far below what any force needs; above 1e-8 the factorization
/// itself is in doubt.
static const double RESIDUAL_GATE = 1e-8;
/// repair: positive: smallest eigenvalue allowed, relative to the largest. Contacts of a few nodes
/// feel 1e-3 and above; what is clipped below this is noise.
static const double REPAIR_FLOOR = 1e-6;
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

/// What the sampled contacts say of the raw and of the stored block.
typedef struct contact_samples {
    const double *raw, *stored;                 ///< (3 columns x 3 columns)
    double force_change, loop_raw, loop_stored; ///< worst so far; negative: none
} contact_samples;

/// One contact: relative change of its force when pressed along each u, energy around closed paths.
/// The two stiffnesses hold for every direction, so they are solved for once.
static void add_contact(contact_samples *s, int32_t columns, const int32_t *set, int32_t count,
                        const double u[][3], int directions) {
    double a[9], b[9];
    if (pal_contact_stiffness(s->raw, columns, set, count, a) != PALPATE_OK) {
        return;
    }
    if (s->stored == s->raw) {
        memcpy(b, a, sizeof b);
    } else if (pal_contact_stiffness(s->stored, columns, set, count, b) != PALPATE_OK) {
        return;
    }
    for (int k = 0; k < directions; k++) {
        double size = 0.0, off = 0.0;
        for (int i = 0; i < 3; i++) {
            double f = 0.0, g = 0.0;
            for (int j = 0; j < 3; j++) {
                f += a[3 * i + j] * u[k][j];
                g += b[3 * i + j] * u[k][j];
            }
            size += f * f;
            off += (g - f) * (g - f);
        }
        s->force_change = fmax(s->force_change, sqrt(off / size));
    }
    s->loop_raw = fmax(s->loop_raw, pal_loop_energy(a));
    s->loop_stored = fmax(s->loop_stored, pal_loop_energy(b));
}

/// The patches (pressed along each axis) and small contacts sampled evenly among the column nodes
/// (pressed along the inward normal).
static pal_status sample_contacts(const pal_model *m, contact_samples *s, pal_error *error) {
    int32_t t = m->info.column_count;
    static const double axes[3][3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
    for (int32_t p = 0; p < m->info.patch_count; p++) {
        if (m->patch[p].count <= CONTACT_NODES_MAX) {
            add_contact(s, t, m->patch[p].column, m->patch[p].count, axes, 3);
        }
    }
    double *distance = malloc((size_t)t * sizeof *distance);
    if (distance == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
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
        const double inward[1][3] = {{-normal[0], -normal[1], -normal[2]}};
        add_contact(s, t, set, count, inward, 1);
    }
    free(distance);
    return PALPATE_OK;
}

/// Repair the block as asked and sample contacts before and after.
static pal_status repair_and_sample(pal_repair repair, pal_model *model, pal_error *error) {
    pal_certificate *c = &model->info.certificate;
    int64_t n = 3 * (int64_t)model->info.column_count;
    double *raw = NULL;
    if (repair != PALPATE_REPAIR_NONE &&
        c->reciprocity > 1e-12) { // below: rounding, nothing to compare
        raw = malloc((size_t)(n * n) * sizeof *raw);
        if (raw == NULL) {
            return pal_fail(error, PALPATE_ERROR_MEMORY,
                            "out of memory for a copy of C_TT (%.2f GB)", 8e-9 * (double)(n * n));
        }
        memcpy(raw, model->c_tt, (size_t)(n * n) * sizeof *raw);
    }
    pal_status status = PALPATE_OK;
    if (repair == PALPATE_REPAIR_SYMMETRIZE) {
        pal_symmetrize(model->c_tt, n);
    } else if (repair == PALPATE_REPAIR_POSITIVE) {
        double change = 0.0;
        status = pal_repair_positive(model->c_tt, n, REPAIR_FLOOR, &change, error);
    }
    c->symmetrized = repair != PALPATE_REPAIR_NONE;
    if (status == PALPATE_OK) {
        contact_samples s = {raw != NULL ? raw : model->c_tt, model->c_tt, -1.0, -1.0, -1.0};
        status = sample_contacts(model, &s, error);
        c->force_change = s.force_change;
        c->loop_energy_raw = s.loop_raw;
        c->loop_energy = s.loop_stored;
    }
    free(raw);
    return status;
}

static void judge(pal_certificate *c, const pal_model *m, int finite) {
    const char *method = m->info.method;
    char *r = c->reason;
    size_t size = sizeof c->reason;
    c->pass = 0;
    if (!finite) {
        (void)snprintf(r, size, "the compliance has entries that are not finite");
    } else if (!(c->solve_residual <= RESIDUAL_GATE)) {
        (void)snprintf(
            r, size,
            "the solved columns do not satisfy the equations (residual %.1e, allowed %.0e): the "
            "system is too ill-conditioned (rcond %.1e); hold the body better or use "
            "method: {kind: galerkin}",
            c->solve_residual, RESIDUAL_GATE, c->rcond);
    } else if (!(c->mls_worst_condition <= STENCIL_GATE)) {
        (void)snprintf(
            r, size,
            "a moving-least-squares stencil at (%.6g, %.6g, %.6g) m has condition %.1e (allowed "
            "%.0e): use more neighbours (method.neighbours) or a more even cloud",
            c->mls_worst_point[0], c->mls_worst_point[1], c->mls_worst_point[2],
            c->mls_worst_condition, STENCIL_GATE);
    } else if (isnan(c->min_eigenvalue_ratio)) {
        (void)snprintf(r, size,
                       "the extreme eigenvalues of the touchable compliance did not converge, so "
                       "nothing is known "
                       "of its passivity; narrow body.touchable or use another method");
    } else if (!(c->min_eigenvalue_ratio > 0.0)) {
        (void)snprintf(
            r, size,
            "the symmetric part of the touchable compliance is not positive definite (smallest "
            "over largest eigenvalue %.1e): it would feed energy into the hand; %s",
            c->min_eigenvalue_ratio,
            strcmp(method, "point") == 0
                ? "point collocation does this on graded clouds and for nu near 0.5: use "
                  "method: {kind: cell} or {kind: galerkin}"
                : "use a finer body.spacing, method: {kind: galerkin} or repair: positive");
    } else {
        c->pass = 1;
        r[0] = '\0';
    }
}

pal_status pal_certify(const pal_system *system, const pal_factor_report *factor,
                       const pal_compliance_report *compliance, double length, pal_repair repair,
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
        status = repair_and_sample(repair, model, error);
        if (status == PALPATE_OK) {
            status = pal_extreme_eigenvalues(model->c_tt, n, &c->min_eigenvalue, &c->max_eigenvalue,
                                             &positive, error);
        }
        c->min_eigenvalue_ratio = c->min_eigenvalue / c->max_eigenvalue;
        if (!positive && c->min_eigenvalue_ratio > 0.0) {
            c->min_eigenvalue_ratio = -c->min_eigenvalue_ratio; // Cholesky broke down: not positive
        }
        c->passive = repair != PALPATE_REPAIR_NONE && positive;
    }
    if (status != PALPATE_OK) {
        return status;
    }
    judge(c, model, finite);
    return PALPATE_OK;
}
