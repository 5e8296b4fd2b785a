/// @file method_cell.c  Cell method: the balance of every node's median-dual cell (design 2.2).
///
/// For each node I:  sum over the walls of its cell of  sigma n dA  +  F_I  =  0 , F_I the nodal force
/// (it stands for the cell's part of the body's surface). Two forms share cells, walls and supports:
///
/// **symmetric** (default). On the piece of wall inside a tetrahedron the deviatoric stress is the
/// mean over the tetrahedron's six pairs, the pressure the mean over its four nodes; the strain
/// of a pair (I, J) is the mean over all tetrahedra around it, the dilatation of a node the mean over
/// its cell. With wall vectors V (g_b - g_a) / 4 (cell_faces.h) the balance is then the gradient of
///
///     sum_pairs V_p  mu |dev eps_p|^2  +  sum_nodes V_n kappa / 2 theta_n^2 ,
///
/// so K is symmetric and positive definite by construction, reciprocity is exact, and a pair's
/// V_p = S . e / 3 is positive whatever the shapes. One constraint per node on the dilatation: no
/// locking as nu -> 1/2. With `volumetric: patch` (default) the surface nodes' cells are joined to
/// interior ones first, because prescribed nodes bring constraints without freedoms (cell_patches.h). (The same averages in the finite element literature: edge- and node-based
/// strain smoothing, Liu & Nguyen-Thoi 2010; mean dilatation at nodes, Bonet & Burton 1998.)
///
/// **collocated** (design 2.2 as it stands). The stress of a wall is taken at the pair's midpoint from
/// an MLS gradient G over the k nearest nodes, corrected so that it interpolates the pair,
/// G <- G + e (delta_J - delta_I - e.G) / |e|^2, and its dilatation as the mean of the two nodes',
/// each the volume-weighted mean of its walls' divergences. K is nonsymmetric and on clouds graded
/// steeply towards the surface its touched block need not be positive: the certificate says.
///
/// Both reproduce linear displacements exactly under nodal forces sigma . area_vector, and conserve
/// force exactly: walls are shared, so the rows of all nodes add up to zero.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/error.h"
#include "src/cell_faces.h"
#include "src/cell_patches.h"
#include "src/cell_rows.h"
#include "src/mls.h"
#include "src/neighbours.h"

/// All that the rows need. `pair` and `nodal` are the operators of strain and of dilatation.
typedef struct cell_parts {
    const pal_cloud *cloud;
    pal_cell_faces faces;
    pal_gradients pair, nodal;
    pal_lists pair_entry, nodal_entry; ///< symmetric: entries of the operators by node
    int32_t *pair_point, *nodal_point; ///< symmetric: their points
    pal_lists own_pair;                ///< collocated: the pairs of each node
    double *dilatation_volume;         ///< symmetric: volume of each point of `nodal`
    double mu;     ///< shear modulus, E = 1
    double lambda; ///< of the stress at the pair: -2 mu / 3 + beta kappa
    double kappa;  ///< of the nodal dilatation: (1 - beta) bulk modulus
} cell_parts;

static void parts_clear(cell_parts *p) {
    pal_cell_faces_clear(&p->faces);
    pal_gradients_clear(&p->pair);
    pal_gradients_clear(&p->nodal);
    pal_lists_clear(&p->pair_entry);
    pal_lists_clear(&p->nodal_entry);
    pal_lists_clear(&p->own_pair);
    free(p->dilatation_volume);
    free(p->pair_point);
    free(p->nodal_point);
}

/// block += scale (lambda a b^T + mu b a^T + mu (a.b) I): the force along a of the stress of grad b.
/// Every product is of the form (a_i b_j), so that swapping a and b transposes the block exactly.
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
    for (int64_t u = p->pair_entry.start[node]; u < p->pair_entry.start[node + 1]; u++) {
        int32_t q = p->pair_point[u];
        const double *a = &p->pair.weight[3 * (size_t)p->pair_entry.item[u]];
        for (int64_t k = p->pair.start[q]; k < p->pair.start[q + 1]; k++) {
            add_stress(pal_scatter_at(row, p->pair.node[k]), p->faces.volume[q], p->lambda, p->mu,
                       a, &p->pair.weight[3 * k]);
        }
    }
    for (int64_t u = p->nodal_entry.start[node];
         p->kappa > 0 && u < p->nodal_entry.start[node + 1]; u++) {
        int32_t q = p->nodal_point[u];
        const double *a = &p->nodal.weight[3 * (size_t)p->nodal_entry.item[u]];
        for (int64_t k = p->nodal.start[q]; k < p->nodal.start[q + 1]; k++) {
            add_stress(pal_scatter_at(row, p->nodal.node[k]), p->dilatation_volume[q], p->kappa, 0, a,
                       &p->nodal.weight[3 * k]);
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
    pal_status status = weight == NULL ? pal_fail(error, PALPATE_ERROR_MEMORY,
                                                  "wall gradients: out of memory")
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
        status = pal_gradients_create(&p->nodal, cloud->node_count,
                                      64 * (int64_t)cloud->node_count, error);
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

/// Replace the nodes' mean gradients by those of patches, or note the nodes' volumes.
static pal_status dilatation_regions(cell_parts *p, int patches, pal_error *error) {
    const pal_cloud *cloud = p->cloud;
    if (patches) {
        pal_gradients joined = {0};
        pal_status status = pal_cell_patches(cloud, &p->faces, &p->nodal, &joined,
                                             &p->dilatation_volume, error);
        if (status == PALPATE_OK) {
            pal_gradients_clear(&p->nodal);
            p->nodal = joined;
        }
        return status;
    }
    size_t bytes = (size_t)cloud->node_count * sizeof *p->dilatation_volume;
    p->dilatation_volume = malloc(bytes + 1);
    if (p->dilatation_volume == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "dilatation of the nodes: out of memory");
    }
    memcpy(p->dilatation_volume, cloud->volume, bytes);
    return PALPATE_OK;
}

/// Mean gradients of pairs and of nodes or patches, and who uses them.
static pal_status symmetric_gradients(cell_parts *p, int patches, pal_stencil_report *report,
                                      pal_error *error) {
    const pal_cloud *cloud = p->cloud;
    pal_status status = pal_cell_pair_gradients(cloud, &p->faces, &p->pair, error);
    if (status == PALPATE_OK) {
        status = pal_cell_node_gradients(cloud, &p->faces, &p->nodal, error);
    }
    if (status == PALPATE_OK) {
        status = dilatation_regions(p, patches, error);
    }
    if (status == PALPATE_OK) {
        status = pal_gradients_users(&p->pair, cloud->node_count, &p->pair_entry, &p->pair_point,
                                     error);
    }
    if (status == PALPATE_OK) {
        status = pal_gradients_users(&p->nodal, cloud->node_count, &p->nodal_entry,
                                     &p->nodal_point, error);
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
    if (method->stabilization > 1) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "method.stabilization: %g; kind: cell blends that part of the plain "
                        "volumetric stress into the nodal one: 0 to 1",
                        method->stabilization);
    }
    return PALPATE_OK;
}

pal_status pal_method_cell(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                           const pal_method *method, const pal_progress *progress,
                           pal_system *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_status status = check_options(poisson, method, error);
    if (status != PALPATE_OK) {
        return status;
    }
    int plain = method->volumetric == PALPATE_VOLUMETRIC_PLAIN;
    int symmetric = method->form == PALPATE_CELL_SYMMETRIC;
    int patches = method->volumetric == PALPATE_VOLUMETRIC_PATCH;
    double bulk = 1 / (3 * (1 - 2 * poisson));
    double blend = plain ? 1 : method->stabilization > 0 ? method->stabilization : 0;
    cell_parts p = {.cloud = cloud, .mu = 0.5 / (1 + poisson), .kappa = (1 - blend) * bulk};
    p.lambda = blend * bulk - 2 * p.mu / 3;
    pal_stencil_report report = {0};
    status = pal_cell_faces_create(cloud, &p.faces, error);
    if (status == PALPATE_OK) {
        status = symmetric ? symmetric_gradients(&p, patches, &report, error)
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
            snprintf(out->options, sizeof out->options, "form=symmetric, volumetric=%s, blend=%g",
                     plain ? "plain" : patches ? "patch" : "nodal", blend);
        } else {
            snprintf(out->options, sizeof out->options,
                     "form=collocated, basis=%s, neighbours=%d, exponent=%d, volumetric=%s, blend=%g",
                     method->basis == PALPATE_BASIS_QUADRATIC ? "quadratic"
                     : method->basis == PALPATE_BASIS_CUBIC   ? "cubic"
                                                              : "linear",
                     method->neighbours > 0
                         ? method->neighbours
                         : pal_basis_neighbours(method->basis != 0 ? method->basis
                                                                   : PALPATE_BASIS_LINEAR),
                     method->exponent > 0 ? method->exponent : 2, plain ? "plain" : "nodal",
                     blend);
        }
    } else {
        pal_system_clear(out);
    }
    parts_clear(&p);
    return status;
}
