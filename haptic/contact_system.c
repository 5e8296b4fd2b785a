/// @file contact_system.c  Law "surface": compliance between contact points, forces, nodal forces.
///
/// Row r is a force on the body along the unit vector e_r at point i(r). Displacement at i along e_r
/// per force of row s at j:
///
///     M_rs = e_r^T [ Phi_i R Phi_j^T + K_ij ] e_s + (same tool) e_r.e_s / k
///     K_ij = (t I + (n - t) n_i n_j^T) b_ij,   b_ij = 1 / sqrt(|x_i - x_j|^2 + (w_i + w_j)^2)
///
/// with R the regular part of the nodes' compliance (working_set.h): what the mesh knows, interpolated,
/// plus the half-space's 1/r between the points themselves, each with the width of its own cell (w_i =
/// sqrt(A_i) / (2 self)). b is the Gram matrix of charges spread over depths w_i, so positive definite,
/// coincident points included. 1/k is the compliance of the virtual coupling: the proxy stands at
/// p_free - f / k, and gaps are taken at p_free. A point that fades gets 1/fade times its own K_ii.
///
/// Unilateral rows have e = -n and the gap w = M z + q >= 0, z >= 0 (complementarity.h); the forces
/// act on the nodes as Phi^T e z (virtual work).
#include <string.h>

#include "haptic/contact_anywhere.h"

void pal_anywhere_gather(anywhere_law *law) {
    int32_t kept = 0;
    pal_working_set_begin(&law->set);
    for (int32_t i = 0; i < law->points; i++) {
        anywhere_point *point = &law->point[i];
        int fits = 1;
        for (int32_t k = 0; k < point->phi.count && fits; k++) {
            point->slot[k] = pal_working_set_add(&law->set, point->phi.column[k]);
            fits = point->slot[k] >= 0;
        }
        if (!fits) {
            law->dropped++;
            law->fault[point->tool] |= PALPATE_FAULT_CONTACTS;
            continue;
        }
        if (kept != i) {
            law->point[kept] = *point;
        }
        kept++;
    }
    law->points = kept;
}

/// y = R Phi^T e
static void sweep(const anywhere_law *law, const anywhere_row *row, double *restrict y) {
    const pal_working_set *set = &law->set;
    const anywhere_point *point = &law->point[row->point];
    size_t n = 3 * (size_t)set->count, ld = (size_t)set->stride;
    memset(y, 0, n * sizeof *y);
    for (int32_t k = 0; k < point->phi.count; k++) {
        const double *restrict c = set->block + 3 * (size_t)point->slot[k] * ld;
        double a0 = point->phi.phi[k] * row->along[0], a1 = point->phi.phi[k] * row->along[1],
               a2 = point->phi.phi[k] * row->along[2];
        for (size_t i = 0; i < n; i++) {
            y[i] += a0 * c[i] + a1 * c[i + ld] + a2 * c[i + 2 * ld];
        }
    }
}

/// e^T Phi y
static double sample(const anywhere_law *law, const anywhere_row *row, const double *y) {
    const anywhere_point *point = &law->point[row->point];
    double sum[3] = {0.0, 0.0, 0.0};
    for (int32_t k = 0; k < point->phi.count; k++) {
        const double *v = y + 3 * (size_t)point->slot[k];
        for (int i = 0; i < 3; i++) {
            sum[i] += point->phi.phi[k] * v[i];
        }
    }
    return dot(row->along, sum);
}

/// e_r^T K_ij e_s, and the coupling.
static double between(const anywhere_law *law, const anywhere_row *r, const anywhere_row *s) {
    const anywhere_point *i = &law->point[r->point], *j = &law->point[s->point];
    double d[3] = {i->x[0] - j->x[0], i->x[1] - j->x[1], i->x[2] - j->x[2]};
    double width = i->width + j->width, both = dot(r->along, s->along);
    double blend = law->set.tangent * both + (law->set.normal - law->set.tangent) *
                                                 dot(r->along, i->normal) *
                                                 dot(s->along, j->normal);
    double sum = blend / sqrt(dot(d, d) + width * width);
    if (r->point == s->point) {
        sum /= i->fade;
    }
    return i->tool == j->tool ? sum + law->tool[i->tool].yield * both : sum;
}

void pal_anywhere_assemble(anywhere_law *law) {
    law->rows = law->points;
    for (int32_t i = 0; i < law->points; i++) {
        const anywhere_point *point = &law->point[i];
        law->row[i] = (anywhere_row){
            .point = i,
            .along = {-point->normal[0], -point->normal[1], -point->normal[2]}};
        law->q[i] = point->gap;
        law->active[i] = law->touching[point->id];
    }
    size_t n = (size_t)law->rows;
    for (size_t s = 0; s < n; s++) {
        double *y = law->y + s * (size_t)law->ld;
        sweep(law, &law->row[s], y);
        for (size_t r = law->set.symmetric ? s : 0; r < n; r++) {
            law->m[r + s * n] =
                sample(law, &law->row[r], y) + between(law, &law->row[r], &law->row[s]);
        }
    }
    for (size_t s = 0; law->set.symmetric && s < n; s++) {
        for (size_t r = 0; r < s; r++) {
            law->m[r + s * n] = law->m[s + r * n];
        }
    }
}

int32_t pal_anywhere_solve(anywhere_law *law) {
    pal_lcp lcp = {.n = law->rows,
                   .m = law->m,
                   .ld = law->rows,
                   .symmetric = law->set.symmetric,
                   .q = law->q};
    pal_lcp_result r =
        pal_lcp_solve(&lcp, PALPATE_LCP_ITERATIONS, law->active, law->z, law->w, law->work);
    uint32_t fault = r.state == PALPATE_LCP_CUT_OFF    ? PALPATE_FAULT_CUTOFF
                     : r.state == PALPATE_LCP_SINGULAR ? PALPATE_FAULT_SINGULAR
                                                       : 0;
    memset(law->touching, 0, (size_t)law->capacity * sizeof *law->touching);
    for (int32_t i = 0; i < law->rows; i++) {
        const anywhere_point *point = &law->point[law->row[i].point];
        law->touching[point->id] = law->z[i] > 0.0;
        law->fault[point->tool] |= fault;
    }
    return r.iterations;
}

int32_t pal_anywhere_distribute(anywhere_law *law) {
    const pal_working_set *set = &law->set;
    memset(law->nodal, 0, 3 * (size_t)set->count * sizeof *law->nodal);
    for (int32_t r = 0; r < law->rows; r++) {
        const anywhere_row *row = &law->row[r];
        const anywhere_point *point = &law->point[row->point];
        for (int32_t k = 0; k < point->phi.count && law->z[r] != 0.0; k++) {
            double *f = law->nodal + 3 * (size_t)point->slot[k];
            double a = point->phi.phi[k] * law->z[r];
            for (int i = 0; i < 3; i++) {
                f[i] += a * row->along[i];
            }
        }
    }
    int32_t count = 0;
    for (int32_t s = 0; s < set->count; s++) {
        const double *f = law->nodal + 3 * (size_t)s;
        for (int i = 0; i < 3 && (f[0] != 0.0 || f[1] != 0.0 || f[2] != 0.0); i++) {
            law->dof[count] = 3 * set->column[s] + i;
            law->force[count++] = f[i];
        }
    }
    return count;
}
