/// @file method_point.c  Point collocation: the equations of elasticity at the nodes.
///
/// Source: De, Hong, Bathe 2003, section 3 (Eqs. 30-45); design 2.1. Rows, with E = 1:
///
///     div sigma = 0                       at interior nodes               (Eq. 43)
///     sigma n = F / A                     at free surface nodes           (Eq. 44)
///     u = 0                               at fixed nodes: eliminated      (Eq. 35)
///
/// with displacement derivatives from moving least squares on each node's nearest nodes (mls.c).
/// Option `fictitious`: one more unknown node stands one spacing outside each free surface node,
/// along its normal, and div sigma = 0 is collocated at that surface node as well; the extra nodes
/// make the boundary's stencils two-sided.
///
/// Forces and sharp edges: the unknown of the online stage is the nodal force F, so the traction
/// row divides it by an area. Where faces meet, no single normal is right; the row takes the node's
/// area vector S = sum of its triangles' area vectors / 3: sigma S = F. In a uniform state of
/// stress that is exactly the force the triangles around the node carry, edges and corners
/// included, so linear fields pass to rounding. n is S / |S| and A is |S|. Only where the faces
/// nearly fold onto each other (|S| below a tenth of the area) A is kept at that tenth, lest the
/// row blow up.
///
/// The reaction of a fixed node is sigma S there, its first derivatives one-sided: good to the
/// discretization's order only. Point collocation does not conserve force.
///
/// Every row is scaled by a power of two so that its largest entry lies in [0.5, 1).
///
/// Thread: any; progress is called on the caller's.
#include "src/discretization/method_point.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/discretization/mls.h"

/// Least A of a traction row, in parts of the node's area.
static const double fold_limit = 0.1;
/// A fictitious node's distance from its surface node, in local spacings.
static const double fictitious_distance = 1.0;

void pal_point_area_vector(const pal_cloud *cloud, int32_t node, double v[3]) {
    const double *s = cloud->area_vector + 3 * (int64_t)node;
    double size = sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
    double area = fmax(size, fold_limit * cloud->area[node]);
    for (int a = 0; a < 3; a++) {
        v[a] = area * cloud->normal[3 * (int64_t)node + a];
    }
}

void pal_point_detail_clear(pal_point_detail *detail) {
    free(detail->rows);
    pal_sparse_clear(&detail->held);
    memset(detail, 0, sizeof *detail);
}

typedef struct builder {
    const pal_cloud *cloud;
    const uint8_t *fixed;
    const pal_progress *progress;
    pal_error *error;
    double lambda, mu;
    pal_mls_options mls_options;
    int32_t neighbours;
    int fictitious;
    int32_t extra_count; ///< fictitious nodes
    int32_t *extra_of;   ///< (surface_count) fictitious node of a surface node, -1: none
    double *position;    ///< (node_count + extra_count x 3)
    int32_t *unknown;    ///< (node_count + extra_count) first unknown of a node; fixed: -1 - i,
                         ///< where i is its place in fixed_node
    pal_neighbours tree;
    pal_mls mls;
    pal_triplets matrix, load, reaction, held;
    pal_point_detail *detail;
    pal_system *out;
} builder;

static void builder_clear(builder *b) {
    free(b->extra_of);
    free(b->position);
    free(b->unknown);
    pal_neighbours_clear(&b->tree);
    pal_mls_clear(&b->mls);
    pal_triplets_clear(&b->matrix);
    pal_triplets_clear(&b->load);
    pal_triplets_clear(&b->reaction);
    pal_triplets_clear(&b->held);
}

static pal_status no_memory(builder *b) {
    return pal_fail(b->error, PALPATE_ERROR_MEMORY, "point collocation: no memory for %d nodes",
                    b->cloud->node_count);
}

/// ---- Nodes and unknowns --------------------------------------------------------------------

/// Mean distance of the nearest nodes: the spacing that counts for a stencil.
static double local_spacing(const pal_neighbours *tree, const double x[3]) {
    enum { COUNT = 7 }; // itself and six
    int32_t index[COUNT];
    double d2[COUNT];
    int32_t found = pal_neighbours_nearest(tree, x, COUNT, index, d2);
    double sum = 0.0;
    for (int32_t i = 1; i < found; i++) {
        sum += sqrt(d2[i]);
    }
    return found > 1 ? sum / (found - 1) : 0.0;
}

static pal_status place_nodes(builder *b) {
    const pal_cloud *c = b->cloud;
    int32_t n = c->node_count;
    for (int32_t i = 0; i < c->surface_count && b->fictitious; i++) {
        b->extra_count += !b->fixed[i];
    }
    size_t all = (size_t)n + (size_t)b->extra_count;
    b->extra_of = malloc((size_t)(c->surface_count + 1) * sizeof *b->extra_of);
    b->position = malloc(all * 3 * sizeof *b->position);
    b->unknown = malloc(all * sizeof *b->unknown);
    if (b->extra_of == NULL || b->position == NULL || b->unknown == NULL) {
        return no_memory(b);
    }
    memcpy(b->position, c->position, (size_t)n * 3 * sizeof *b->position);
    if (b->fictitious) {
        pal_neighbours tree;
        pal_status status = pal_neighbours_create(&tree, c->position, n, b->error);
        if (status != PALPATE_OK) {
            return status;
        }
        int32_t next = n;
        for (int32_t i = 0; i < c->surface_count; i++) {
            b->extra_of[i] = -1;
            if (b->fixed[i]) {
                continue;
            }
            double h = fictitious_distance * local_spacing(&tree, c->position + 3 * (int64_t)i);
            for (int a = 0; a < 3; a++) {
                b->position[3 * (int64_t)next + a] =
                    c->position[3 * (int64_t)i + a] + h * c->normal[3 * (int64_t)i + a];
            }
            b->extra_of[i] = next++;
        }
        pal_neighbours_clear(&tree);
    }
    int32_t unknown = 0, held = 0;
    for (size_t i = 0; i < all; i++) {
        if (i < (size_t)n && b->fixed[i]) {
            b->unknown[i] = -1 - held++;
        } else {
            b->unknown[i] = unknown;
            unknown += 3;
        }
    }
    b->out->unknown_count = unknown;
    return pal_neighbours_create(&b->tree, b->position, (int32_t)all, b->error);
}

static pal_status number_unknowns(builder *b) {
    pal_system *s = b->out;
    int32_t n = b->cloud->node_count;
    s->node_count = n;
    for (int32_t i = 0; i < n; i++) {
        s->fixed_count += b->fixed[i] != 0;
    }
    s->dof_unknown = malloc((size_t)n * 3 * sizeof *s->dof_unknown);
    s->fixed_node = malloc((size_t)(s->fixed_count + 1) * sizeof *s->fixed_node);
    if (s->dof_unknown == NULL || s->fixed_node == NULL) {
        return no_memory(b);
    }
    int32_t at = 0;
    for (int32_t i = 0; i < n; i++) {
        if (b->fixed[i]) {
            s->fixed_node[at++] = i;
        }
        for (int c = 0; c < 3; c++) {
            s->dof_unknown[3 * (int64_t)i + c] = b->unknown[i] < 0 ? -1 : b->unknown[i] + c;
        }
    }
    return PALPATE_OK;
}

/// ---- Rows ----------------------------------------------------------------------------------

/// Coefficient of u_J,d in (div sigma)_c.
static double balance_coefficient(const builder *b, int32_t j, int c, int d) {
    static const int second[3][3] = {{0, 1, 2}, {1, 3, 4}, {2, 4, 5}};
    const double *h = b->mls.d2phi + 6 * (int64_t)j;
    double laplace = c == d ? b->mu * (h[0] + h[3] + h[5]) : 0.0;
    return laplace + (b->lambda + b->mu) * h[second[c][d]];
}

/// Coefficient of u_J,d in (sigma v)_c.
static double traction_coefficient(const builder *b, int32_t j, int c, int d, const double v[3]) {
    const double *g = b->mls.dphi + 3 * (int64_t)j;
    double normal = c == d ? b->mu * (v[0] * g[0] + v[1] * g[1] + v[2] * g[2]) : 0.0;
    return normal + b->lambda * v[c] * g[d] + b->mu * v[d] * g[c];
}

/// Add the three rows of one condition at `node` from the stencil at hand; v: NULL for balance.
static pal_status add_rows(builder *b, int32_t first_row, int32_t node, const double *v,
                           double area) {
    for (int c = 0; c < 3; c++) {
        double largest = 0.0;
        for (int32_t j = 0; j < b->mls.count; j++) {
            for (int d = 0; d < 3; d++) {
                double k = v != NULL ? traction_coefficient(b, j, c, d, v)
                                     : balance_coefficient(b, j, c, d);
                largest = fmax(largest, fabs(k));
            }
        }
        int exponent = 0;
        (void)frexp(largest, &exponent);
        double scale = ldexp(v != NULL ? 1.0 : -1.0, -exponent);
        for (int32_t j = 0; j < b->mls.count; j++) {
            int32_t column = b->unknown[b->mls.node[j]];
            pal_triplets *into = column >= 0 ? &b->matrix : &b->held;
            if (column < 0 && b->detail == NULL) {
                continue;
            }
            column = column >= 0 ? column : 3 * (-1 - column);
            for (int d = 0; d < 3; d++) {
                double k = v != NULL ? traction_coefficient(b, j, c, d, v)
                                     : balance_coefficient(b, j, c, d);
                if (k != 0.0 && pal_triplets_add(into, first_row + c, column + d, scale * k)) {
                    return no_memory(b);
                }
            }
        }
        if (v != NULL && pal_triplets_add(&b->load, first_row + c, 3 * node + c, scale / area)) {
            return no_memory(b);
        }
        if (b->detail != NULL) {
            b->detail->rows[first_row + c] = (pal_point_row){
                v != NULL ? PALPATE_ROW_TRACTION : PALPATE_ROW_BALANCE, node, c, scale};
        }
    }
    return PALPATE_OK;
}

static pal_status add_reaction(builder *b, int32_t node, const double v[3]) {
    int32_t row = 3 * (-1 - b->unknown[node]);
    for (int32_t j = 0; j < b->mls.count; j++) {
        int32_t column = b->unknown[b->mls.node[j]];
        for (int c = 0; c < 3 && column >= 0; c++) {
            for (int d = 0; d < 3; d++) {
                double k = traction_coefficient(b, j, c, d, v);
                if (k != 0.0 && pal_triplets_add(&b->reaction, row + c, column + d, k)) {
                    return no_memory(b);
                }
            }
        }
    }
    return PALPATE_OK;
}

static pal_status add_node(builder *b, int32_t node) {
    const pal_cloud *cloud = b->cloud;
    int surface = node < cloud->surface_count;
    if (b->fixed[node] && !surface) {
        return PALPATE_OK; // held inside: nothing touches it, no reaction to speak of
    }
    b->mls_options.order = surface && (b->fixed[node] || !b->fictitious) ? 1 : 2;
    pal_status status =
        pal_mls_stencil(&b->mls, &b->tree, &b->mls_options, cloud->position + 3 * (int64_t)node,
                        b->neighbours, &b->out->stencils, b->error);
    if (status != PALPATE_OK) {
        const double *x = cloud->position + 3 * (int64_t)node;
        return pal_fail_prefix(
            b->error, status, "point collocation at node %d, (%g, %g, %g) m; in units of %g m",
            node, cloud->length * x[0], cloud->length * x[1], cloud->length * x[2], cloud->length);
    }
    if (!surface) {
        return add_rows(b, b->unknown[node], node, NULL, 0.0);
    }
    double v[3];
    pal_point_area_vector(cloud, node, v);
    if (b->fixed[node]) {
        return add_reaction(b, node, v);
    }
    double area = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    status = add_rows(b, b->unknown[node], node, cloud->normal + 3 * (int64_t)node, area);
    if (status == PALPATE_OK && b->fictitious) {
        status = add_rows(b, b->unknown[b->extra_of[node]], node, NULL, 0.0);
    }
    return status;
}

static pal_status assemble(builder *b) {
    for (int32_t i = 0; i < b->cloud->node_count; i++) {
        if (b->progress != NULL && b->progress->call != NULL && i % 256 == 0 &&
            b->progress->call(b->progress->user, "assemble", (double)i / b->cloud->node_count,
                              -1.0)) {
            return pal_fail(b->error, PALPATE_ERROR_CANCELLED, "cancelled while assembling");
        }
        pal_status status = add_node(b, i);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    pal_system *s = b->out;
    pal_status status = pal_sparse_from_triplets(&b->matrix, s->unknown_count, s->unknown_count,
                                                 &s->matrix, b->error);
    if (status == PALPATE_OK) {
        status = pal_sparse_from_triplets(&b->load, s->unknown_count,
                                          3 * (int64_t)b->cloud->surface_count, &s->load, b->error);
    }
    if (status == PALPATE_OK) {
        status = pal_sparse_from_triplets(&b->reaction, 3 * (int64_t)s->fixed_count,
                                          s->unknown_count, &s->reaction, b->error);
    }
    if (status == PALPATE_OK && b->detail != NULL) {
        status = pal_sparse_from_triplets(&b->held, s->unknown_count, 3 * (int64_t)s->fixed_count,
                                          &b->detail->held, b->error);
    }
    return status;
}

pal_status pal_point_build(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                           const pal_method *method, const pal_progress *progress, pal_system *out,
                           pal_point_detail *detail, pal_error *error) {
    memset(out, 0, sizeof *out);
    if (detail != NULL) {
        memset(detail, 0, sizeof *detail);
    }
    if (!(poisson > -1.0 && poisson < 0.5)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "point collocation: Poisson's ratio %g must lie between -1 and 0.5",
                        poisson);
    }
    builder b = {.cloud = cloud,
                 .fixed = fixed,
                 .progress = progress,
                 .error = error,
                 .detail = detail,
                 .out = out};
    b.mu = 0.5 / (1.0 + poisson);
    b.lambda = poisson / ((1.0 + poisson) * (1.0 - 2.0 * poisson));
    b.mls_options.basis = method->basis > 0 ? method->basis : PALPATE_BASIS_QUADRATIC;
    b.mls_options.derivatives = method->derivatives;
    b.mls_options.exponent = method->exponent > 0 ? method->exponent : 2;
    b.neighbours =
        method->neighbours > 0 ? method->neighbours : pal_basis_neighbours(b.mls_options.basis);
    b.fictitious = method->fictitious != 0;
    if (b.mls_options.basis > PALPATE_BASIS_CUBIC || b.mls_options.exponent > 8) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "point collocation: basis %d must be 1, 2 or 3 and exponent %d at most 8",
                        (int)b.mls_options.basis, b.mls_options.exponent);
    }
    if (b.mls_options.basis == PALPATE_BASIS_LINEAR &&
        b.mls_options.derivatives == PALPATE_DERIVATIVES_DIFFUSE) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "point collocation: a linear basis has no diffuse second derivatives; use "
                        "derivatives: full or basis: quadratic");
    }
    static const char *const names[] = {"linear", "quadratic", "cubic"};
    (void)snprintf(out->options, sizeof out->options,
                   "basis=%s, derivatives=%s, neighbours=%d, exponent=%d, fictitious=%s",
                   names[b.mls_options.basis - 1],
                   b.mls_options.derivatives == PALPATE_DERIVATIVES_FULL ? "full" : "diffuse",
                   b.neighbours, b.mls_options.exponent, b.fictitious ? "yes" : "no");

    pal_status status = place_nodes(&b);
    if (status == PALPATE_OK) {
        status = number_unknowns(&b);
    }
    if (status == PALPATE_OK && detail != NULL) {
        detail->rows = calloc((size_t)out->unknown_count + 1, sizeof *detail->rows);
        status = detail->rows == NULL ? no_memory(&b) : PALPATE_OK;
    }
    if (status == PALPATE_OK) {
        status = assemble(&b);
    }
    builder_clear(&b);
    if (status != PALPATE_OK) {
        pal_system_clear(out);
        if (detail != NULL) {
            pal_point_detail_clear(detail);
        }
    }
    return status;
}

pal_status pal_method_point(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                            const pal_method *method, const pal_progress *progress, pal_system *out,
                            pal_error *error) {
    return pal_point_build(cloud, fixed, poisson, method, progress, out, NULL, error);
}
