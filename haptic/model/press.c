/// @file press.c  Bonded press of a patch: statics of paper 1, Eqs. 52-53.
///
/// All m nodes of the patch are displaced by the same vector u. Their forces solve C_aa f_a = u_a
/// (Eq. 52), with C_aa the patch's block of the stored C_TT; whatever else is stored follows as
/// U_b = C_ba f_a (Eq. 53). Forces are those the tool applies to the body. Symmetric positive
/// blocks are factored by Cholesky, all others (raw blocks, or symmetric ones that failed their
/// certificate and were kept by `certify: warn`) by LU. Thread: any; the model is only read.
/// Source: De, Hong, Bathe 2003, Eqs. 52-53.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/dense.h"
#include "haptic/base/error.h"
#include "haptic/model/model.h"

static const pal_patch *find_patch(const pal_model *model, const char *name, pal_error *error) {
    for (int32_t i = 0; i < model->info.patch_count; i++) {
        if (strcmp(model->patch[i].name, name) == 0) {
            return &model->patch[i];
        }
    }
    char names[512] = "none";
    size_t at = 0;
    for (int32_t i = 0; i < model->info.patch_count && at < sizeof names; i++) {
        int n = snprintf(names + at, sizeof names - at, "%s%s", i > 0 ? ", " : "",
                         model->patch[i].name);
        at += n > 0 ? (size_t)n : 0;
    }
    (void)pal_fail(
        error, PALPATE_ERROR_NOT_FOUND,
        "patch \"%.64s\": the model has no such patch; its patches are: %s; name one of them "
        "or add it to body.patches in the scene",
        name, names);
    return NULL;
}

/// Solve C_aa f = u in place of `force`.
static pal_status solve_patch(const pal_model *model, const pal_patch *patch, double *force,
                              pal_error *error) {
    size_t m = (size_t)patch->count, n = 3 * m, ld = 3 * (size_t)model->info.column_count;
    int32_t order = (int32_t)n;
    double *block = calloc(n, n * sizeof *block);
    int32_t *pivot = calloc(n, sizeof *pivot);
    pal_status status = PALPATE_OK;
    if (block == NULL || pivot == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY,
                          "patch \"%s\": no memory for its %zu x %zu block", patch->name, n, n);
        goto out;
    }
    for (int attempt = 0; attempt < 2; attempt++) {
        for (size_t b = 0; b < n; b++) {
            const double *column = model->c_tt + ((size_t)patch->column[b / 3] * 3 + b % 3) * ld;
            for (size_t a = 0; a < n; a++) {
                block[a + b * n] = column[(size_t)patch->column[a / 3] * 3 + a % 3];
            }
        }
        if (attempt == 0 && model->info.certificate.symmetrized) {
            if (pal_dense_cholesky(order, 0, block, order) == 0) {
                pal_dense_cholesky_solve(order, block, order, 1, force, order);
                goto out;
            }
            continue; // the block was overwritten
        }
        int32_t failed = pal_dense_lu(order, block, order, pivot);
        if (failed != 0) {
            status = pal_fail(
                error, PALPATE_ERROR_SINGULAR,
                "patch \"%s\": its compliance block (%d unknowns) is singular at unknown %d; "
                "use a finer spacing or another method",
                patch->name, (int)order, (int)failed - 1);
            goto out;
        }
        pal_dense_lu_solve(order, block, order, pivot, 1, force, order);
        break;
    }
out:
    free(block);
    free(pivot);
    return status;
}

pal_status pal_model_press(const pal_model *model, const char *patch_name, const double by[3],
                           pal_press *out, pal_error *error) {
    if (out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "press: no place for the result");
    }
    memset(out, 0, sizeof *out);
    if (model == NULL || patch_name == NULL || by == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "press: needs a model, a patch and a displacement");
    }
    if (!isfinite(by[0]) || !isfinite(by[1]) || !isfinite(by[2])) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "press: displacement (%g, %g, %g) m is not finite; give three numbers",
                        by[0], by[1], by[2]);
    }
    const pal_patch *patch = find_patch(model, patch_name, error);
    if (patch == NULL) {
        return PALPATE_ERROR_NOT_FOUND;
    }

    const pal_model_info *info = &model->info;
    size_t m = (size_t)patch->count, rows = (size_t)info->row_count,
           probes = (size_t)info->probe_count;
    pal_press press = {.patch_nodes = patch->count};
    press.node_force = calloc(m, 3 * sizeof(double));
    press.probe = calloc(probes + 1, 3 * sizeof(double));
    press.displacement = rows > 0 ? calloc(rows, 3 * sizeof(double)) : NULL;
    double *column = malloc((3 * rows + 1) * sizeof *column);
    if (press.node_force == NULL || press.probe == NULL || column == NULL ||
        (rows > 0 && press.displacement == NULL)) {
        free(column);
        pal_press_clear(&press);
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "patch \"%s\": no memory for %zu nodes and %zu rows", patch->name, m, rows);
    }
    for (size_t i = 0; i < m; i++) {
        memcpy(press.node_force + 3 * i, by, 3 * sizeof *by);
    }
    pal_status status = solve_patch(model, patch, press.node_force, error);
    if (status != PALPATE_OK) {
        free(column);
        pal_press_clear(&press);
        return status;
    }

    for (size_t i = 0; i < m; i++) {
        const double *x = model->position + 3 * (size_t)model->column_node[patch->column[i]];
        for (int c = 0; c < 3; c++) {
            press.center[c] += x[c] / (double)m;
        }
    }
    for (size_t i = 0; i < m; i++) {
        const double *x = model->position + 3 * (size_t)model->column_node[patch->column[i]];
        const double *f = press.node_force + 3 * i, *o = press.center;
        double arm[3] = {x[0] - o[0], x[1] - o[1], x[2] - o[2]};
        press.moment[0] += arm[1] * f[2] - arm[2] * f[1];
        press.moment[1] += arm[2] * f[0] - arm[0] * f[2];
        press.moment[2] += arm[0] * f[1] - arm[1] * f[0];
        for (size_t c = 0; c < 3; c++) {
            size_t dof = 3 * (size_t)patch->column[i] + c;
            press.force[c] += f[c];
            for (size_t k = 0; k < 3 * probes; k++) {
                press.probe[k] += model->probe_row[k + dof * 3 * probes] * f[c];
            }
            if (rows > 0 && pal_model_load_column(model, (int64_t)dof, column) == PALPATE_OK) {
                for (size_t k = 0; k < 3 * rows; k++) {
                    press.displacement[k] += f[c] * column[k];
                }
            }
        }
    }
    free(column);
    *out = press;
    return PALPATE_OK;
}

void pal_press_clear(pal_press *press) {
    if (press != NULL) {
        free(press->node_force);
        free(press->probe);
        free(press->displacement);
        memset(press, 0, sizeof *press);
    }
}
