/// @file mls_stencil.c  Which nodes an MLS evaluation uses: the k nearest, grown where deficient.
///
/// The support radius is a little more than the distance of the k-th neighbour, so that the
/// outermost nodes still count. Nodes at the same distance as the k-th (to 1e-9) all belong: a
/// lattice's stencils keep its symmetry and do not depend on numbering.
#include "src/discretization/mls.h"

#include <math.h>
#include <string.h>

#include "haptic/base/error.h"

/// Support radius over the k-th neighbour's distance. Measured on smooth solutions (quadratic point
/// collocation, jittered cubes): 1.0 to 1.1 leaves up to twice the error, 1.5 and 2 lose the order.
static const double reach = 1.25;

static pal_status gather(pal_mls *mls, const pal_neighbours *nodes, const double x[3], int32_t k,
                         double *radius) {
    for (int32_t asked = k + 12;; asked *= 2) { // room for ties
        pal_status status = pal_mls_reserve(mls, asked);
        if (status != PALPATE_OK) {
            return status;
        }
        int32_t found = pal_neighbours_nearest(nodes, x, asked, mls->node, mls->distance2);
        double last = mls->distance2[(k < found ? k : found) - 1];
        double limit = last * (1.0 + 2e-9);
        int32_t count = 0;
        while (count < found && mls->distance2[count] <= limit) {
            count++;
        }
        if (count < found || found == nodes->count || asked > 8 * k) {
            mls->count = count;
            *radius = reach * sqrt(last);
            return PALPATE_OK;
        }
    }
}

static void note(pal_stencil_report *report, const pal_mls *mls, const double x[3], int grown) {
    if (report == NULL) {
        return;
    }
    report->min_neighbours = report->count == 0 || mls->count < report->min_neighbours
                                 ? mls->count
                                 : report->min_neighbours;
    report->max_neighbours =
        mls->count > report->max_neighbours ? mls->count : report->max_neighbours;
    report->count++;
    report->grown += grown;
    if (mls->info.condition > report->worst_condition) {
        report->worst_condition = mls->info.condition;
        for (int a = 0; a < 3; a++) {
            report->worst_point[a] = x[a];
        }
    }
}

pal_status pal_mls_stencil(pal_mls *mls, const pal_neighbours *nodes,
                           const pal_mls_options *options, const double x[3], int32_t neighbours,
                           pal_stencil_report *report, pal_error *error) {
    int32_t k = neighbours > 0 ? neighbours : pal_basis_neighbours(options->basis);
    int32_t least = pal_basis_size(options->basis);
    k = k < least ? least : k;
    for (int grown = 0;; grown = 1) {
        double radius = 0.0;
        pal_status status = gather(mls, nodes, x, k, &radius);
        if (status != PALPATE_OK) {
            return pal_fail(error, status, "MLS stencil at (%g, %g, %g): no memory for %d nodes",
                            x[0], x[1], x[2], k);
        }
        for (int32_t j = 0; j < mls->count; j++) {
            memcpy(mls->position + 3 * j, nodes->position + 3 * (int64_t)mls->node[j],
                   3 * sizeof *mls->position);
        }
        mls->radius = radius;
        if (!(radius > 0.0)) {
            return pal_fail(error, PALPATE_ERROR_STENCIL,
                            "MLS stencil at (%g, %g, %g): all %d nearest nodes coincide; remove "
                            "duplicate nodes",
                            x[0], x[1], x[2], mls->count);
        }
        status = pal_mls_shape(mls, options, x, radius, mls->count, mls->position, mls->phi,
                               mls->dphi, mls->d2phi, &mls->info);
        if (status == PALPATE_OK) {
            note(report, mls, x, grown);
            return PALPATE_OK;
        }
        if (status != PALPATE_ERROR_STENCIL) {
            return pal_fail(error, status, "MLS stencil at (%g, %g, %g) with %d nodes, exponent %d",
                            x[0], x[1], x[2], mls->count, options->exponent);
        }
        if (mls->info.coincident >= 0) {
            return pal_fail(error, PALPATE_ERROR_STENCIL,
                            "MLS stencil at (%g, %g, %g): nodes %d and %d coincide; remove one",
                            x[0], x[1], x[2], mls->node[mls->info.centre],
                            mls->node[mls->info.coincident]);
        }
        if (mls->count >= nodes->count || options->accept_deficient) {
            return pal_fail(
                error, PALPATE_ERROR_STENCIL,
                "MLS stencil at (%g, %g, %g): rank %d of %d with all %d nodes; the nodes "
                "lie on a surface of the basis' degree: add nodes or lower the basis",
                x[0], x[1], x[2], mls->info.rank, mls->info.columns, mls->count);
        }
        k = mls->count + (mls->count + 1) / 2;
    }
}
