/// @file galerkin_pressure.c  Nodal pressures: divergence, compressibility and stabilization terms.
///
/// Pressure p = sum_I p_I N_I / s_I with N_I the node's hat function and s_I = V_I^(1/3) a scale
/// that makes all unknowns' entries of one size. With V_I the median-dual volume,
///
///     B_Ia = (1 / s_I) sum_T (V_T / 4) g_Ta              V_I times the mean divergence of I's dual
///     cell C_IJ = (1 / (s_I s_J)) [ delta_IJ V_I / kappa + (alpha / mu) sum_T (V_T / 20)(delta_IJ
///     - 1/4) ]
///
/// The second term is int (p - Pi p)(q - Pi q), Pi the mean over each tetrahedron: the polynomial
/// pressure projection of Bochev, Dohrmann, Gunzburger (SIAM J. Numer. Anal. 44, 2006), alpha = 1
/// there; it makes the equal-order pair stable without a mesh-dependent parameter.
#include "src/discretization/galerkin_pressure.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

/// Row x from the tetrahedra around it.
static void add_row(pal_pressure *p, const pal_regions *tets, int32_t x, int64_t *slot, double bulk,
                    double compliance) {
    for (int64_t k = p->start[x]; k < p->start[x + 1]; k++) {
        slot[p->column[k]] = k;
    }
    for (int64_t k = tets->at_node[x]; k < tets->at_node[x + 1]; k++) {
        int32_t t = tets->region[k];
        double v = tets->volume[t];
        const double *gx = tets->gradient + 3 * (tets->start[t] + tets->local[k]);
        for (int64_t m = tets->start[t]; m < tets->start[t + 1]; m++) {
            int32_t y = tets->node[m];
            int64_t s = slot[y];
            const double *gy = tets->gradient + 3 * m;
            for (int c = 0; c < 3; c++) {
                p->gradient_x[3 * s + c] += 0.25 * v * gx[c];
                p->gradient_y[3 * s + c] += 0.25 * v * gy[c];
            }
            p->mass[s] += x == y ? 0.25 * v / bulk + compliance * v * (0.75 / 20.0)
                                 : -compliance * v * (0.25 / 20.0);
        }
    }
}

pal_status pal_pressure_create(pal_pressure *out, const pal_regions *tets, int32_t node_count,
                               double bulk, double compliance, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_blocks pattern = {0};
    pal_status status = pal_blocks_create(&pattern, tets, NULL, node_count, error);
    if (status != PALPATE_OK) {
        return status;
    }
    size_t pairs = (size_t)pattern.start[node_count];
    int64_t *slot = malloc((size_t)node_count * sizeof *slot);
    double *size = calloc((size_t)node_count, sizeof *size);
    out->gradient_x = calloc(3 * pairs, sizeof *out->gradient_x);
    out->gradient_y = calloc(3 * pairs, sizeof *out->gradient_y);
    out->mass = calloc(pairs, sizeof *out->mass);
    if (slot == NULL || size == NULL || out->gradient_x == NULL || out->gradient_y == NULL ||
        out->mass == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "galerkin: no memory for the pressures");
        pal_pressure_clear(out);
        goto done;
    }
    out->node_count = node_count;
    out->start = pattern.start;
    out->column = pattern.column;
    pattern.start = NULL;
    pattern.column = NULL;
    for (int32_t x = 0; x < node_count; x++) {
        add_row(out, tets, x, slot, bulk, compliance);
        for (int64_t k = tets->at_node[x]; k < tets->at_node[x + 1]; k++) {
            size[x] += 0.25 * tets->volume[tets->region[k]];
        }
        size[x] = cbrt(size[x]);
    }
    for (int32_t x = 0; x < node_count; x++) {
        for (int64_t k = out->start[x]; k < out->start[x + 1]; k++) {
            int32_t y = out->column[k];
            for (int c = 0; c < 3; c++) {
                out->gradient_x[3 * k + c] /= size[y];
                out->gradient_y[3 * k + c] /= size[x];
            }
            out->mass[k] /= size[x] * size[y];
        }
    }
done:
    free(slot);
    free(size);
    pal_blocks_clear(&pattern);
    return status;
}

void pal_pressure_clear(pal_pressure *p) {
    free(p->start);
    free(p->column);
    free(p->gradient_x);
    free(p->gradient_y);
    free(p->mass);
    memset(p, 0, sizeof *p);
}
