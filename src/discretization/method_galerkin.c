/// @file method_galerkin.c  Galerkin method with smoothed gradients and nodal pressures: symmetric,
/// passive.
///
/// Minimise the strain energy over nodal displacements u:
///
///     2 mu sum_f V_f dev eps_f(u) : dev eps_f(u)  +  volumetric energy  -  sum_J F_J . u_J
///
/// Trial functions are MLS on the cell's own nodes: with a linear basis and a tetrahedron's four
/// nodes as stencil the moving least squares fit is the linear interpolant, whatever the weight, so
/// the functions are continuous, h_J(x_K) = delta_JK, and a face between fixed nodes does not move.
/// Wider MLS functions (galerkin_trial.h, option neighbours) gain little for two to four times the
/// nonzeros. What makes them accurate is the integration: the gradient is averaged exactly over
/// each neighbour pair's region f (galerkin_regions.h) before it is squared. Unsmoothed linear
/// functions are too stiff, those smoothed over a node's whole cell too soft; pair regions lie
/// between, an order of magnitude closer to either (Liu, Nguyen-Thoi, Lam, J. Sound Vib. 320, 2009;
/// Nguyen-Thoi et al. 2009 in 3D).
///
/// Volumetric part (PALPATE_VOLUMETRIC_*), theta_I the mean divergence over node I's dual cell V_I:
///
///     PLAIN   lambda div_f^2 on the pairs: locks towards nu = 1/2
///     NODAL   sum_I V_I kappa theta_I^2: does not lock outright, but the pair is only weakly
///     stable MIXED   p_I per node, -p C p / 2 + p . B u (galerkin_pressure.c): stable for all nu <
///     1/2
///
/// MIXED gives the symmetric quasi-definite system [K B^T; B -C] (Vanderbei 1995): it has an LDL^T
/// factorization in any order, and its displacement block of the inverse is (K + B^T C^-1 B)^-1,
/// which is symmetric positive definite. So the compliance is passive by construction; the system
/// itself is not positive definite (positive = 0), those of PLAIN and NODAL are.
///
/// Patch test, rigid motion: exact to rounding (Chen et al. 2001; linear fields have constant p).
/// Thread: any, one call per thread; allocates, no state.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/discretization/discretization.h"
#include "src/discretization/galerkin_pressure.h"
#include "src/discretization/galerkin_regions.h"
#include "src/discretization/galerkin_trial.h"

enum { DEFAULT_EXPONENT = 2 }; ///< p of the wide trial functions' weight

typedef struct model {
    const pal_cloud *cloud;
    const uint8_t *fixed;
    pal_blocks blocks;     ///< K on all nodes, fixed ones too
    pal_pressure pressure; ///< start NULL: none
    int32_t *fixed_number; ///< (node_count) place in fixed_node; -1: free
} model;

/// A compressed-column matrix under construction.
typedef struct writer {
    pal_sparse *out;
    int64_t at;
    int64_t column;
} writer;

static pal_status no_memory(pal_error *error) {
    return pal_fail(error, PALPATE_ERROR_MEMORY, "galerkin: no memory for the system");
}

static pal_status writer_open(writer *w, pal_sparse *out, int64_t rows, int64_t columns,
                              int64_t nonzeros) {
    memset(out, 0, sizeof *out);
    out->rows = rows;
    out->columns = columns;
    size_t room = (size_t)(nonzeros > 0 ? nonzeros : 1);
    out->start = malloc((size_t)(columns + 1) * sizeof *out->start);
    out->row = malloc(room * sizeof *out->row);
    out->value = malloc(room * sizeof *out->value);
    *w = (writer){.out = out};
    if (out->start == NULL || out->row == NULL || out->value == NULL) {
        pal_sparse_clear(out);
        return PALPATE_ERROR_MEMORY;
    }
    out->start[0] = 0;
    return PALPATE_OK;
}

static void writer_put(writer *w, int64_t row, double value) {
    w->out->row[w->at] = row;
    w->out->value[w->at++] = value;
}

static void writer_end_column(writer *w) {
    w->out->start[++w->column] = w->at;
}

/// Number the unknowns: displacements of the free nodes, then all pressures.
static pal_status number_unknowns(model *m, pal_system *s, int mixed) {
    int32_t n = m->cloud->node_count;
    s->node_count = n;
    s->dof_unknown = malloc(3 * (size_t)n * sizeof *s->dof_unknown);
    m->fixed_number = malloc((size_t)n * sizeof *m->fixed_number);
    int32_t fixed = 0, unknown = 0;
    for (int32_t a = 0; a < n; a++) {
        fixed += m->fixed[a] != 0;
    }
    s->fixed_node = malloc((size_t)(fixed > 0 ? fixed : 1) * sizeof *s->fixed_node);
    if (s->dof_unknown == NULL || m->fixed_number == NULL || s->fixed_node == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    for (int32_t a = 0; a < n; a++) {
        m->fixed_number[a] = -1;
        if (m->fixed[a]) {
            m->fixed_number[a] = s->fixed_count;
            s->fixed_node[s->fixed_count++] = a;
        }
        for (int c = 0; c < 3; c++) {
            s->dof_unknown[3 * (size_t)a + (size_t)c] = m->fixed[a] ? -1 : unknown++;
        }
    }
    s->unknown_count = unknown + (mixed ? n : 0);
    return PALPATE_OK;
}

/// Column (b, c) of [K; B] restricted to free or to fixed rows. K is symmetric: its rows serve as
/// columns. Pressure rows belong to the free part.
static void put_displacement_column(const model *m, const pal_system *s, writer *w, int32_t b,
                                    int c, int of_fixed) {
    const pal_blocks *k = &m->blocks;
    for (int64_t e = k->start[b]; e < k->start[b + 1]; e++) {
        int32_t a = k->column[e];
        int32_t number = m->fixed_number[a];
        if ((number >= 0) != of_fixed) {
            continue;
        }
        for (int i = 0; i < 3; i++) {
            int64_t row = of_fixed ? 3 * (int64_t)number + i : s->dof_unknown[3 * (int64_t)a + i];
            writer_put(w, row, k->value[9 * e + 3 * c + i]);
        }
    }
    const pal_pressure *p = &m->pressure;
    if (p->start != NULL && !of_fixed) {
        int32_t first = s->unknown_count - s->node_count;
        for (int64_t e = p->start[b]; e < p->start[b + 1]; e++) {
            writer_put(w, first + p->column[e], p->gradient_x[3 * e + c]);
        }
    }
    writer_end_column(w);
}

/// Pressure column of node x: [B^T; -C] restricted likewise.
static void put_pressure_column(const model *m, const pal_system *s, writer *w, int32_t x,
                                int of_fixed) {
    const pal_pressure *p = &m->pressure;
    int32_t first = s->unknown_count - s->node_count;
    for (int64_t e = p->start[x]; e < p->start[x + 1]; e++) {
        int32_t a = p->column[e];
        int32_t number = m->fixed_number[a];
        if ((number >= 0) != of_fixed) {
            continue;
        }
        for (int i = 0; i < 3; i++) {
            int64_t row = of_fixed ? 3 * (int64_t)number + i : s->dof_unknown[3 * (int64_t)a + i];
            writer_put(w, row, p->gradient_y[3 * e + i]);
        }
    }
    for (int64_t e = p->start[x]; !of_fixed && e < p->start[x + 1]; e++) {
        writer_put(w, first + p->column[e], -p->mass[e]);
    }
    writer_end_column(w);
}

/// The system's matrix (of_fixed 0) or its reaction rows (of_fixed 1).
static pal_status put_matrix(const model *m, const pal_system *s, int of_fixed, pal_sparse *out) {
    int64_t bound = 9 * m->blocks.start[s->node_count];
    if (m->pressure.start != NULL) {
        bound += 7 * m->pressure.start[s->node_count];
    }
    writer w;
    int64_t rows = of_fixed ? 3 * (int64_t)s->fixed_count : s->unknown_count;
    if (writer_open(&w, out, rows, s->unknown_count, bound) != PALPATE_OK) {
        return PALPATE_ERROR_MEMORY;
    }
    for (int32_t b = 0; b < s->node_count; b++) {
        for (int c = 0; c < 3 && !m->fixed[b]; c++) {
            put_displacement_column(m, s, &w, b, c, of_fixed);
        }
    }
    for (int32_t x = 0; m->pressure.start != NULL && x < s->node_count; x++) {
        put_pressure_column(m, s, &w, x, of_fixed);
    }
    return PALPATE_OK;
}

/// Unit nodal forces: the identity on the free surface nodes' unknowns.
static pal_status put_load(const model *m, const pal_system *s, pal_sparse *out) {
    int64_t columns = 3 * (int64_t)m->cloud->surface_count;
    writer w;
    if (writer_open(&w, out, s->unknown_count, columns, columns) != PALPATE_OK) {
        return PALPATE_ERROR_MEMORY;
    }
    for (int64_t j = 0; j < columns; j++) {
        if (s->dof_unknown[j] >= 0) {
            writer_put(&w, s->dof_unknown[j], 1.0);
        }
        writer_end_column(&w);
    }
    return PALPATE_OK;
}

static void report_stencils(const pal_regions *pairs, pal_stencil_report *out) {
    out->count = pairs->count;
    out->worst_condition = pairs->worst_condition;
    memcpy(out->worst_point, pairs->worst_point, sizeof out->worst_point);
    out->min_neighbours = INT32_MAX;
    for (int32_t f = 0; f < pairs->count; f++) {
        int32_t count = (int32_t)(pairs->start[f + 1] - pairs->start[f]);
        out->min_neighbours = count < out->min_neighbours ? count : out->min_neighbours;
        out->max_neighbours = count > out->max_neighbours ? count : out->max_neighbours;
    }
}

/// Energy blocks and pressures.
static pal_status build_model(model *m, pal_system *s, double poisson, const pal_method *method,
                              double stabilization, const pal_progress *progress,
                              pal_error *error) {
    pal_volumetric volumetric = method->volumetric;
    double mu = 0.5 / (1.0 + poisson);
    double bulk = 1.0 / (3.0 * (1.0 - 2.0 * poisson));
    double on_pairs =
        volumetric == PALPATE_VOLUMETRIC_PLAIN ? bulk - 2.0 * mu / 3.0 : -2.0 * mu / 3.0;
    int32_t n = m->cloud->node_count;
    pal_regions pairs = {0}, other = {0};
    pal_status status = pal_regions_create(&pairs, m->cloud, PALPATE_REGION_PAIR, error);
    if (status != PALPATE_OK) {
        return status;
    }
    if (method->neighbours > 0) {
        int32_t exponent = method->exponent > 0 ? method->exponent : DEFAULT_EXPONENT;
        status =
            pal_regions_widen(&pairs, m->cloud, method->neighbours, exponent, &s->stencils, error);
        if (status != PALPATE_OK) {
            goto done;
        }
    }
    report_stencils(&pairs, &s->stencils);
    if (volumetric == PALPATE_VOLUMETRIC_NODAL) {
        status = pal_regions_create(&other, m->cloud, PALPATE_REGION_NODE, error);
    } else if (volumetric == PALPATE_VOLUMETRIC_MIXED) {
        status = pal_regions_create(&other, m->cloud, PALPATE_REGION_TET, error);
    }
    if (status == PALPATE_OK) {
        status = pal_blocks_create(
            &m->blocks, &pairs, volumetric == PALPATE_VOLUMETRIC_NODAL ? &other : NULL, n, error);
    }
    if (status == PALPATE_OK) {
        status = pal_blocks_add_energy(&m->blocks, &pairs, mu, on_pairs, progress, 0.1, 0.6, error);
    }
    if (status == PALPATE_OK && volumetric == PALPATE_VOLUMETRIC_NODAL) {
        status = pal_blocks_add_energy(&m->blocks, &other, 0.0, bulk, progress, 0.6, 0.9, error);
    }
    if (status == PALPATE_OK && volumetric == PALPATE_VOLUMETRIC_MIXED) {
        status = pal_pressure_create(&m->pressure, &other, n, bulk, stabilization / mu, error);
    }
done:
    pal_regions_clear(&pairs);
    pal_regions_clear(&other);
    return status;
}

static pal_status check_arguments(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                                  const pal_method *method, pal_error *error) {
    if (cloud == NULL || fixed == NULL || method == NULL || cloud->node_count <= 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "galerkin: no cloud, supports or method given");
    }
    if (!(poisson > -1.0 && poisson < 0.5)) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "galerkin: Poisson's ratio is %g; it must be above -1 and below 0.5 (0.4999 is "
            "fine)",
            poisson);
    }
    if ((int)method->volumetric < PALPATE_VOLUMETRIC_PLAIN ||
        (int)method->volumetric > PALPATE_VOLUMETRIC_MIXED) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "galerkin: volumetric is %d; choose plain, nodal or mixed",
                        (int)method->volumetric);
    }
    if (method->basis != 0 && method->basis != PALPATE_BASIS_LINEAR) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "galerkin: basis is %s; only linear is built (quadratic trial functions on pair "
            "regions were measured and are less accurate); remove it",
            method->basis == PALPATE_BASIS_QUADRATIC ? "quadratic" : "cubic");
    }
    if (method->stabilization > 1e6 || isnan(method->stabilization)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "galerkin: stabilization is %g; it must be from 0 to 1e6, 1 is the default",
                        method->stabilization);
    }
    return PALPATE_OK;
}

static void describe(const pal_method *method, double stabilization, pal_system *out) {
    static const char *const names[] = {"plain", "nodal", "mixed"};
    int n = snprintf(out->options, sizeof out->options,
                     "kind=galerkin, basis=linear, volumetric=%s", names[method->volumetric]);
    if (method->volumetric == PALPATE_VOLUMETRIC_MIXED) {
        n += snprintf(out->options + n, sizeof out->options - (size_t)n, ", stabilization=%g",
                      stabilization);
    }
    if (method->neighbours > 0) {
        (void)snprintf(out->options + n, sizeof out->options - (size_t)n,
                       ", neighbours=%d, exponent=%d", method->neighbours,
                       method->exponent > 0 ? method->exponent : DEFAULT_EXPONENT);
    }
}

pal_status pal_method_galerkin(const pal_cloud *cloud, const uint8_t *fixed, double poisson,
                               const pal_method *method, const pal_progress *progress,
                               pal_system *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_status status = check_arguments(cloud, fixed, poisson, method, error);
    if (status != PALPATE_OK) {
        return status;
    }
    pal_volumetric volumetric = method->volumetric;
    double stabilization = method->stabilization < 0.0 ? 1.0 : method->stabilization;
    model m = {.cloud = cloud, .fixed = fixed};
    if (number_unknowns(&m, out, volumetric == PALPATE_VOLUMETRIC_MIXED) != PALPATE_OK) {
        status = no_memory(error);
        goto done;
    }
    status = build_model(&m, out, poisson, method, stabilization, progress, error);
    if (status != PALPATE_OK) {
        goto done;
    }
    if (put_matrix(&m, out, 0, &out->matrix) != PALPATE_OK ||
        put_matrix(&m, out, 1, &out->reaction) != PALPATE_OK ||
        put_load(&m, out, &out->load) != PALPATE_OK) {
        status = no_memory(error);
        goto done;
    }
    out->symmetric = 1;
    out->positive = volumetric != PALPATE_VOLUMETRIC_MIXED;
    describe(method, stabilization, out);
done:
    pal_blocks_clear(&m.blocks);
    pal_pressure_clear(&m.pressure);
    free(m.fixed_number);
    if (status != PALPATE_OK) {
        pal_system_clear(out);
    }
    return status;
}
