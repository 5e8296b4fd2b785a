/// @file cell_rig.c  See cell_rig.h.
#include "tests/support/cell_rig.h"

#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/solution/factor.h"

uint8_t *rig_flags(int32_t n) {
    uint8_t *f = calloc((size_t)n, 1);
    assert_non_null(f);
    return f;
}

double *rig_zeros(size_t n) {
    double *f = calloc(n, sizeof *f);
    assert_non_null(f);
    return f;
}

void rig_box(pal_cloud *c, const double size[3], int nx, int ny, int nz, double jitter) {
    pal_error e = {0};
    if (pal_cloud_box(c, size, (const int[3]){nx, ny, nz}, jitter, 11, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
}

void rig_build(const pal_cloud *c, const uint8_t *fixed, double nu, const pal_method *m,
               pal_system *s) {
    pal_error e = {0};
    if (pal_method_cell(c, fixed, nu, m, NULL, s, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
}

void rig_solve(const pal_system *s, double *x) {
    pal_error e = {0};
    pal_factor *factor = NULL;
    double *b = rig_zeros((size_t)s->unknown_count);
    memcpy(b, x, (size_t)s->unknown_count * sizeof *b);
    if (pal_factor_create(&s->matrix, s->positive, NULL, &factor, NULL, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_factor_workspace *w = pal_factor_workspace_new(factor);
    assert_non_null(w);
    assert_int_equal(pal_factor_solve(factor, w, 1, x, &e), PALPATE_OK);
    pal_factor_workspace_free(w);
    pal_factor_free(factor);
    double size = 0, left = 0, largest = 0, stiffest = 0;
    for (int32_t i = 0; i < s->unknown_count; i++) {
        size = fmax(size, fabs(b[i]));
        largest = fmax(largest, fabs(x[i]));
    }
    for (int64_t k = 0; k < s->matrix.start[s->matrix.columns]; k++) {
        stiffest = fmax(stiffest, fabs(s->matrix.value[k]));
    }
    pal_sparse_multiply(&s->matrix, -1, x, b);
    for (int32_t i = 0; i < s->unknown_count; i++) {
        left = fmax(left, fabs(b[i]));
    }
    assert_true(left <= 1e-9 * size + 1e-14 * stiffest * largest);
    free(b);
}

void rig_stress(double nu, const double g[3][3], double sigma[3][3]) {
    double mu = 0.5 / (1 + nu), lambda = nu / ((1 + nu) * (1 - 2 * nu));
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            sigma[i][j] =
                mu * (g[i][j] + g[j][i]) + (i == j ? lambda * (g[0][0] + g[1][1] + g[2][2]) : 0);
        }
    }
}

double rig_patch_error(const pal_cloud *c, const uint8_t *fixed, double nu, const pal_method *m,
                       const double g[3][3]) {
    double sigma[3][3], worst = 0;
    rig_stress(nu, g, sigma);
    pal_system s;
    rig_build(c, fixed, nu, m, &s);
    double *load = rig_zeros((size_t)s.load.columns), *x = rig_zeros((size_t)s.unknown_count);
    for (int64_t j = 0; j < s.load.columns; j++) {
        for (int d = 0; d < 3; d++) {
            load[j] += sigma[j % 3][d] * c->area_vector[3 * (j / 3) + d];
        }
    }
    pal_sparse_multiply(&s.load, 1, load, x);
    rig_solve(&s, x);
    for (int32_t i = 0; i < 3 * c->node_count; i++) {
        if (s.dof_unknown[i] >= 0) {
            const double *p = &c->position[3 * (i / 3)], *row = g[i % 3];
            double want = row[0] * p[0] + row[1] * p[1] + row[2] * p[2];
            worst = fmax(worst, fabs(x[s.dof_unknown[i]] - want));
        }
    }
    free(load);
    free(x);
    pal_system_clear(&s);
    return worst;
}

double rig_tip(const pal_cloud *c, double nu, const pal_method *m) {
    uint8_t *fixed = rig_flags(c->node_count);
    double end = 0, area = 0, tip = 0;
    for (int32_t i = 0; i < c->surface_count; i++) {
        fixed[i] = c->position[3 * i] < 1e-9;
        end = fmax(end, c->position[3 * i]);
    }
    pal_system s;
    rig_build(c, fixed, nu, m, &s);
    double *weight = rig_zeros((size_t)c->node_count), *x = rig_zeros((size_t)s.unknown_count);
    for (int32_t t = 0; t < c->triangle_count; t++) {
        const int32_t *v = &c->triangle[3 * t];
        double a[3], b[3];
        int at_end = 1;
        for (int k = 0; k < 3; k++) {
            at_end = at_end && c->position[3 * v[k]] > end - 1e-9;
            a[k] = c->position[3 * v[1] + k] - c->position[3 * v[0] + k];
            b[k] = c->position[3 * v[2] + k] - c->position[3 * v[0] + k];
        }
        for (int k = 0; k < 3 && at_end; k++) {
            double third = fabs(a[1] * b[2] - a[2] * b[1]) / 6;
            weight[v[k]] += third;
            area += third;
        }
    }
    for (int32_t i = 0; i < c->node_count; i++) {
        if (weight[i] > 0) {
            x[s.dof_unknown[3 * i + 2]] = weight[i] / area;
        }
    }
    rig_solve(&s, x);
    for (int32_t i = 0; i < c->node_count; i++) {
        tip += weight[i] > 0 ? weight[i] / area * x[s.dof_unknown[3 * i + 2]] : 0;
    }
    free(weight);
    free(x);
    free(fixed);
    pal_system_clear(&s);
    return tip;
}
