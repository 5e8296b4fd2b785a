/// @file method_cell.c  Cell method: balance of every node's median-dual cell (design 2.2).
///
/// For each node I:  sum over the walls of its cell of  sigma n dA  +  F_I  =  0 , F_I the nodal
/// force (it stands for the cell's part of the body's surface). Two forms share cells, walls and
/// supports:
///
/// **symmetric** (default). On the piece of wall inside a tetrahedron the deviatoric stress is the
/// mean over the tetrahedron's six pairs, the pressure the mean over its four nodes; the strain
/// of a pair (I, J) is the mean over all tetrahedra around it, the dilatation of a node the mean
/// over its cell. With wall vectors V (g_b - g_a) / 4 (cell_faces.h) the balance is then the
/// gradient of
///
///     sum_pairs V_p mu |dev eps_p|^2 + sum_nodes V_n k/2 theta_n^2 + sum_groups V_g K/2 theta_g^2
///
/// with k + K = kappa, so K is symmetric and positive definite by construction, reciprocity is
/// exact, and a pair's V_p = S . e / 3 is positive whatever the shapes. One dilatation per node is
/// still too many as nu -> 1/2: half of the nodes of a graded cloud are on its surface, and those
/// that a support or a tool prescribes bring a constraint but no freedom (the force of a bonded
/// patch came out 4-8 % too large at nu = 0.4999). So with `volumetric: patch` (default) k is
/// limited to `stabilization` shear moduli (5: takes effect above nu = 0.406), and the rest of the
/// bulk modulus acts on the mean dilatation of groups that each have freedoms of their own
/// (cell_groups.h): then 0.3-0.9 % at every nu from 0.3 to 0.4999. k keeps the dilatation inside a
/// group in check: with 2 coarse thin plates come out 20 % too soft, with 10 the force is
/// up to 0.7 % larger. (The same averages in the finite element literature: edge- and node-based
/// strain smoothing, Liu & Nguyen-Thoi 2010; mean dilatation at nodes, Bonet & Burton 1998, and
/// over macro-elements.)
///
/// **collocated** (design 2.2 as it stands). The stress of a wall is taken at the pair's midpoint
/// from an MLS gradient G over the k nearest nodes, corrected so that it interpolates the pair, G
/// <- G + e (delta_J - delta_I - e.G) / |e|^2, and its dilatation as the mean of the two nodes',
/// each the volume-weighted mean of its walls' divergences. K is nonsymmetric and on clouds graded
/// steeply towards the surface its touched block need not be positive: the certificate says.
///
/// Both reproduce linear displacements exactly under nodal forces sigma . area_vector, and conserve
/// force exactly: walls are shared, so the rows of all nodes add up to zero.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/discretization/cell_faces.h"
#include "src/discretization/cell_groups.h"
#include "src/discretization/cell_rows.h"
#include "src/discretization/mls.h"
#include "src/discretization/neighbours.h"

enum { CELL_TERMS = 3 };

/// Default of `stabilization` in the symmetric form: bulk modulus that acts on single nodes, in
/// shear moduli.
static const double FINE_BULK = 5;

/// One term of the symmetric form: sum over its points of volume (lambda / 2 tr^2 + mu |eps|^2).
typedef struct cell_term {
    const pal_gradients *gradients;
    const double *volume;
    double lambda, mu;
    pal_lists entry; ///< entries of the operator by node
    int32_t *point;  ///< their points
} cell_term;

/// All that the rows need. `pair`, `nodal`, `grouped`: operators of strain and of dilatation.
typedef struct cell_parts {
    const pal_cloud *cloud;
    pal_cell_faces faces;
    pal_gradients pair, nodal, grouped;
    double *group_volume;
    cell_term term[CELL_TERMS]; ///< symmetric: pairs, nodes, groups
    int term_count;
    pal_lists own_pair; ///< collocated: the pairs of each node
    double mu;          ///< shear modulus, E = 1
    double lambda;      ///< of the stress at the pair: -2 mu / 3 + plain part of the bulk modulus
    double kappa;       ///< of the nodes' dilatation
    double coarse;      ///< of the groups' dilatation
} cell_parts;

static void parts_clear(cell_parts *p) {
    pal_cell_faces_clear(&p->faces);
    pal_gradients_clear(&p->pair);
    pal_gradients_clear(&p->nodal);
    pal_gradients_clear(&p->grouped);
    pal_lists_clear(&p->own_pair);
    free(p->group_volume);
    for (int t = 0; t < CELL_TERMS; t++) {
        pal_lists_clear(&p->term[t].entry);
        free(p->term[t].point);
    }
}

/// block += scale (lambda a b^T + mu b a^T + mu (a.b) I): the force along a of the stress of grad
/// b. Every product is of the form (a_i b_j), so that swapping a and b transposes the block
/// exactly.
static void add_stress(double *block, double scale, double lambda, double mu, const double a[3],
                       const double b[3]) {
    double trace = mu * (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]);
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            double s = lambda * (a[i] * b[j]) + mu * (a[j] * b[i]) + (i == j ? trace : 0);
            block[3 * i + j] += scale * s;
        }
    }
}

static void fill_symmetric(const void *context, int32_t node, pal_scatter *row) {
    const cell_parts *p = context;
    for (int t = 0; t < p->term_count; t++) {
        const cell_term *term = &p->term[t];
        const pal_gradients *g = term->gradients;
        for (int64_t u = term->entry.start[node]; u < term->entry.start[node + 1]; u++) {
            int32_t q = term->point[u];
            const double *a = &g->weight[3 * (size_t)term->entry.item[u]];
            for (int64_t k = g->start[q]; k < g->start[q + 1]; k++) {
                add_stress(pal_scatter_at(row, g->node[k]), term->volume[q], term->lambda, term->mu,
                           a, &g->weight[3 * k]);
            }
        }
    }
}

static void fill_collocated(const void *context, int32_t node, pal_scatter *row) {
    const cell_parts *p = context;
    double outward[3], sum[3] = {0, 0, 0};
    for (int64_t u = p->own_pair.start[node]; u < p->own_pair.start[node + 1]; u++) {
        int32_t q = p->own_pair.item[u];
        const int32_t *ends = &p->faces.pair[2 * (size_t)q];
        for (int c = 0; c < 3; c++) {
            double s = p->faces.wall[3 * (size_t)q + (size_t)c];
            outward[c] = ends[0] == node ? s : -s;
            sum[c] += outward[c];
        }
        // K U = F: minus the force that the neighbours exert through the walls
        for (int64_t k = p->pair.start[q]; k < p->pair.start[q + 1]; k++) {
            add_stress(pal_scatter_at(row, p->pair.node[k]), -1, p->lambda, p->mu, outward,
                       &p->pair.weight[3 * k]);
        }
        if (p->kappa > 0) { // the neighbour's half of the wall's dilatation
            int32_t other = ends[0] == node ? ends[1] : ends[0];
            for (int64_t k = p->nodal.start[other]; k < p->nodal.start[other + 1]; k++) {
                add_stress(pal_scatter_at(row, p->nodal.node[k]), -0.5, p->kappa, 0, outward,
                           &p->nodal.weight[3 * k]);
            }
        }
    }
    for (int64_t k = p->nodal.start[node]; p->kappa > 0 && k < p->nodal.start[node + 1]; k++) {
        add_stress(pal_scatter_at(row, p->nodal.node[k]), -0.5, p->kappa, 0, sum,
                   &p->nodal.weight[3 * k]); // its own half, all walls at once
    }
}

/// The MLS gradient of one pair, corrected along it, in sum->value[3 node ...].
static void pair_gradient(const pal_cloud *cloud, const int32_t ends[2], const pal_mls *mls,
                          pal_scatter *sum) {
    double e[3], e2 = 0;
    for (int c = 0; c < 3; c++) {
        e[c] = cloud->position[3 * (size_t)ends[1] + (size_t)c] -
               cloud->position[3 * (size_t)ends[0] + (size_t)c];
        e2 += e[c] * e[c];
    }
    for (int32_t k = 0; k < mls->count; k++) {
        const double *g = &mls->dphi[3 * (size_t)k];
        double along = (e[0] * g[0] + e[1] * g[1] + e[2] * g[2]) / e2;
        double *s = pal_scatter_at(sum, mls->node[k]);
        for (int c = 0; c < 3; c++) {
            s[c] += g[c] - e[c] * along;
        }
    }
    for (int end = 0; end < 2; end++) {
        double *s = pal_scatter_at(sum, ends[end]);
        for (int c = 0; c < 3; c++) {
            s[c] += (end ? e[c] : -e[c]) / e2;
        }
    }
}

/// Gradients at all pairs' midpoints by MLS, and the nodes' means of them.
static pal_status collocated_gradients(const pal_method *method, const pal_progress *progress,
                                       cell_parts *p, pal_stencil_report *report,
                                       pal_error *error) {
    const pal_cloud *cloud = p->cloud;
    pal_mls_options options = {.basis = method->basis != 0 ? method->basis : PALPATE_BASIS_LINEAR,
                               .exponent = method->exponent > 0 ? method->exponent : 2,
                               .order = 1,
                               .derivatives = PALPATE_DERIVATIVES_DIFFUSE};
    pal_neighbours tree = {0};
    pal_mls mls = {0};
    pal_scatter sum = {0};
    double *weight = malloc(3 * ((size_t)cloud->node_count + 1) * sizeof *weight);
    pal_status status = weight == NULL
                            ? pal_fail(error, PALPATE_ERROR_MEMORY, "wall gradients: out of memory")
                            : PALPATE_OK;
    if (status == PALPATE_OK) {
        status = pal_neighbours_create(&tree, cloud->position, cloud->node_count, error);
    }
    if (status == PALPATE_OK) {
        status = pal_scatter_create(&sum, cloud->node_count, 3, error);
    }
    int32_t pairs = p->faces.pair_count;
    if (status == PALPATE_OK) {
        status = pal_gradients_create(&p->pair, pairs, 26 * (int64_t)pairs, error);
    }
    for (int32_t q = 0; q < pairs && status == PALPATE_OK; q++) {
        if (progress != NULL && progress->call != NULL && q % 1024 == 0 &&
            progress->call(progress->user, "assemble", 0.5 * q / pairs, -1)) {
            status = pal_fail(error, PALPATE_ERROR_CANCELLED, "wall gradients: cancelled");
            break;
        }
        const int32_t *ends = &p->faces.pair[2 * (size_t)q];
        double middle[3];
        for (int c = 0; c < 3; c++) {
            middle[c] = 0.5 * (cloud->position[3 * (size_t)ends[0] + (size_t)c] +
                               cloud->position[3 * (size_t)ends[1] + (size_t)c]);
        }
        status = pal_mls_stencil(&mls, &tree, &options, middle, method->neighbours, report, error);
        if (status != PALPATE_OK) {
            break;
        }
        pair_gradient(cloud, ends, &mls, &sum);
        for (int32_t k = 0; k < sum.count; k++) {
            memcpy(&weight[3 * (size_t)k], &sum.value[3 * (size_t)sum.node[k]], 3 * sizeof *weight);
        }
        status = pal_gradients_append(&p->pair, q, sum.count, sum.node, weight, error);
        pal_scatter_empty(&sum);
    }
    if (status == PALPATE_OK) {
        status = pal_lists_invert(p->faces.pair, pairs, 2, cloud->node_count, &p->own_pair, error);
    }
    if (status == PALPATE_OK) {
        status = pal_gradients_create(&p->nodal, cloud->node_count, 64 * (int64_t)cloud->node_count,
                                      error);
    }
    for (int32_t i = 0; i < cloud->node_count && status == PALPATE_OK; i++) {
        double volume = 0;
        for (int64_t u = p->own_pair.start[i]; u < p->own_pair.start[i + 1]; u++) {
            int32_t q = p->own_pair.item[u];
            volume += p->faces.volume[q];
            for (int64_t k = p->pair.start[q]; k < p->pair.start[q + 1]; k++) {
                double *s = pal_scatter_at(&sum, p->pair.node[k]);
                for (int c = 0; c < 3; c++) {
                    s[c] += p->faces.volume[q] * p->pair.weight[3 * k + c];
                }
            }
        }
        for (int32_t k = 0; k < sum.count; k++) {
            for (size_t c = 0; c < 3; c++) {
                weight[3 * (size_t)k + c] = sum.value[3 * (size_t)sum.node[k] + c] / volume;
            }
        }
        status = pal_gradients_append(&p->nodal, i, sum.count, sum.node, weight, error);
        pal_scatter_empty(&sum);
    }
    free(weight);
    pal_neighbours_clear(&tree);
    pal_mls_clear(&mls);
    pal_scatter_clear(&sum);
    return status;
}

static pal_status add_term(cell_parts *p, const pal_gradients *gradients, const double *volume,
                           double lambda, double mu, pal_error *error) {
    cell_term *t = &p->term[p->term_count++];
    t->gradients = gradients;
    t->volume = volume;
    t->lambda = lambda;
    t->mu = mu;
    return pal_gradients_users(gradients, p->cloud->node_count, &t->entry, &t->point, error);
}

static pal_status grouped_gradients(cell_parts *p, pal_error *error) {
    size_t n = (size_t)p->cloud->node_count;
    int32_t count = 0, *group = malloc(n * sizeof *group);
    p->group_volume = malloc(n * sizeof *p->group_volume);
    pal_status status = PALPATE_OK;
    if (group == NULL || p->group_volume == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "cell groups: out of memory");
    }
    if (status == PALPATE_OK) {
        status = pal_cell_groups(p->cloud, &p->faces, group, &count, error);
    }
    if (status == PALPATE_OK) {
        status = pal_cell_group_gradients(p->cloud, &p->nodal, group, count, p->group_volume,
                                          &p->grouped, error);
    }
    free(group);
    return status;
}

/// The terms of the symmetric form: mean gradients of pairs, nodes and groups, and who uses them.
static pal_status symmetric_gradients(cell_parts *p, pal_stencil_report *report, pal_error *error) {
    const pal_cloud *cloud = p->cloud;
    pal_status status = pal_cell_pair_gradients(cloud, &p->faces, &p->pair, error);
    if (status == PALPATE_OK) {
        status = add_term(p, &p->pair, p->faces.volume, p->lambda, p->mu, error);
    }
    if (status == PALPATE_OK && (p->kappa > 0 || p->coarse > 0)) {
        status = pal_cell_node_gradients(cloud, &p->faces, &p->nodal, error);
    }
    if (status == PALPATE_OK && p->kappa > 0) {
        status = add_term(p, &p->nodal, cloud->volume, p->kappa, 0, error);
    }
    if (status == PALPATE_OK && p->coarse > 0) {
        status = grouped_gradients(p, error);
    }
    if (status == PALPATE_OK && p->coarse > 0) {
        status = add_term(p, &p->grouped, p->group_volume, p->coarse, 0, error);
    }
    if (status == PALPATE_OK) {
        report->count = p->pair.count;
        report->worst_condition = p->faces.worst_shape;
        memcpy(report->worst_point, p->faces.worst_point, sizeof report->worst_point);
        report->min_neighbours = INT32_MAX;
        for (int32_t q = 0; q < p->pair.count; q++) {
            int32_t n = (int32_t)(p->pair.start[q + 1] - p->pair.start[q]);
            report->min_neighbours = n < report->min_neighbours ? n : report->min_neighbours;
            report->max_neighbours = n > report->max_neighbours ? n : report->max_neighbours;
        }
    }
    return status;
}

static pal_status check_options(double poisson, const pal_method *method, pal_error *error) {
    if (!(poisson > -1 && poisson < 0.5)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "body.material.poisson: %g; must be above -1 and below 0.5 (0.4999 works "
                        "with method: {kind: cell, volumetric: nodal})",
                        poisson);
    }
    if (method->volumetric == PALPATE_VOLUMETRIC_MIXED) {
        return pal_fail(error, PALPATE_ERROR_UNSUPPORTED,
                        "method.volumetric: mixed is not built for kind: cell; use nodal");
    }
    if (method->volumetric == PALPATE_VOLUMETRIC_PATCH && method->form == PALPATE_CELL_COLLOCATED) {
        return pal_fail(error, PALPATE_ERROR_UNSUPPORTED,
                        "method.volumetric: patch is not built for form: collocated; use nodal");
    }
    if (method->form != PALPATE_CELL_SYMMETRIC && method->form != PALPATE_CELL_COLLOCATED) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "method.form: %d; symmetric or collocated",
                        (int)method->form);
    }
    if (method->form == PALPATE_CELL_COLLOCATED && method->stabilization > 1) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "method.stabilization: %g; form: collocated blends that part of the plain "
                        "volumetric stress into the nodal one: 0 to 1",
                        method->stabilization);
    }
    return PALPATE_OK;
}

pal_status pal_method_cell(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                           const pal_method *method, const pal_progress *progress, pal_system *out,
                           pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_status status = check_options(poisson, method, error);
    if (status != PALPATE_OK) {
        return status;
    }
    int plain = method->volumetric == PALPATE_VOLUMETRIC_PLAIN;
    int symmetric = method->form == PALPATE_CELL_SYMMETRIC;
    int patches = method->volumetric == PALPATE_VOLUMETRIC_PATCH;
    double bulk = 1 / (3 * (1 - 2 * poisson)), given = method->stabilization;
    cell_parts p = {.cloud = cloud, .mu = 0.5 / (1 + poisson)};
    double blend = plain ? 1 : symmetric || given < 0 ? 0 : given;
    double limit = given < 0 ? FINE_BULK : given; // in shear moduli
    p.lambda = blend * bulk - 2 * p.mu / 3;
    p.kappa = (1 - blend) * bulk;
    if (patches && p.kappa > limit * p.mu) {
        p.coarse = p.kappa - limit * p.mu;
        p.kappa = limit * p.mu;
    }
    pal_stencil_report report = {0};
    status = pal_cell_faces_create(cloud, &p.faces, error);
    if (status == PALPATE_OK) {
        status = symmetric ? symmetric_gradients(&p, &report, error)
                           : collocated_gradients(method, progress, &p, &report, error);
    }
    if (status == PALPATE_OK) {
        status = pal_rows_number(cloud, fixed, out, error);
    }
    if (status == PALPATE_OK) {
        status = pal_rows_assemble(out, symmetric ? fill_symmetric : fill_collocated, &p, progress,
                                   symmetric ? 0.1 : 0.5, error);
    }
    if (status == PALPATE_OK) {
        out->symmetric = out->positive = symmetric;
        out->stencils = report;
        if (symmetric) {
            int n = snprintf(out->options, sizeof out->options, "form=symmetric, volumetric=%s",
                             plain     ? "plain"
                             : patches ? "patch"
                                       : "nodal");
            if (patches) {
                snprintf(out->options + n, sizeof out->options - (size_t)n,
                         ", stabilization=%g, patches=%d", limit, p.grouped.count);
            }
        } else {
            snprintf(out->options, sizeof out->options,
                     "form=collocated, basis=%s, neighbours=%d, exponent=%d, volumetric=%s, "
                     "stabilization=%g",
                     method->basis == PALPATE_BASIS_QUADRATIC ? "quadratic"
                     : method->basis == PALPATE_BASIS_CUBIC   ? "cubic"
                                                              : "linear",
                     method->neighbours > 0
                         ? method->neighbours
                         : pal_basis_neighbours(method->basis != 0 ? method->basis
                                                                   : PALPATE_BASIS_LINEAR),
                     method->exponent > 0 ? method->exponent : 2, plain ? "plain" : "nodal", blend);
        }
    } else {
        pal_system_clear(out);
    }
    parts_clear(&p);
    return status;
}
