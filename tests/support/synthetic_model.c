/// @file synthetic_model.c  Half-space compliance on a box of nodes.
///
/// Boussinesq and Cerruti (Landau and Lifshitz, Theory of Elasticity, section 8, Eq. 8.19), for the
/// half space z' = -z > 0 with the force at the origin of its surface, r = |x|, s = r + z':
///   u_x = a { [x z'/r^3 - (1-2nu) x/(r s)] F_z + [2(1-nu) r + z']/(r s) F_x
///             + [2 r (nu r + z') + z'^2] x/(r^3 s^2) (x F_x + y F_y) }
///   u_z = a { [2(1-nu)/r + z'^2/r^3] F_z + [(1-2nu)/(r s) + z'/r^3] (x F_x + y F_y) },
/// a = (1+nu)/(2 pi E). On the diagonal, 1/r is replaced by its mean over a disc of radius b under
/// a uniform load on the same disc, 16/(3 pi b); x^2/r^3 by half of that (isotropy).
#include "tests/support/synthetic_model.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/dense.h"
#include "haptic/model/model.h"

static const double pi = 3.14159265358979323846;

synthetic_params synthetic_default_params(void) {
    return (synthetic_params){.n = 6,
                              .layers = 3,
                              .spacing = 0.002,
                              .young = 10e3,
                              .poisson = 0.45,
                              .rows = SYNTHETIC_ROWS_SURFACE,
                              .precision = PALPATE_PRECISION_SINGLE};
}

void synthetic_green(double young, double poisson, const double x[3], const double y[3],
                     int direction, double area, double u[3]) {
    double a = (1 + poisson) / (2 * pi * young);
    double d[3] = {x[0] - y[0], x[1] - y[1], -(x[2] - y[2])};
    double r = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    u[0] = u[1] = u[2] = 0;
    if (r < 1e-3 * sqrt(area)) {
        double mean = 16 / (3 * pi * sqrt(area / pi));
        // F_x: 2(1-nu)/r + 2 nu x^2/r^3 at the surface; F_z: 2(1-nu)/r; no coupling by symmetry
        u[direction] =
            a * mean * (direction == 2 ? 2 * (1 - poisson) : 2 * (1 - poisson) + poisson);
        return;
    }
    double s = r + d[2], r3 = r * r * r;
    double force[3] = {0, 0, 0};
    force[direction] = direction == 2 ? -1 : 1; // into z' = -z
    double along = d[0] * force[0] + d[1] * force[1];
    double radial = (d[2] / r3 - (1 - 2 * poisson) / (r * s)) * force[2] +
                    (2 * r * (poisson * r + d[2]) + d[2] * d[2]) / (r3 * s * s) * along;
    double shear = (2 * (1 - poisson) * r + d[2]) / (r * s);
    u[0] = a * (radial * d[0] + shear * force[0]);
    u[1] = a * (radial * d[1] + shear * force[1]);
    u[2] = -a * ((2 * (1 - poisson) / r + d[2] * d[2] / r3) * force[2] +
                 ((1 - 2 * poisson) / (r * s) + d[2] / r3) * along);
}

// ---- Nodes and triangles ------------------------------------------------------------------------

typedef struct grid {
    int32_t m, layers; ///< nodes per side and in depth
    int32_t *node;     ///< node of grid point (i, j, k), k = 0 on top: node[(k m + j) m + i]
} grid;

static int32_t *at(const grid *g, int32_t i, int32_t j, int32_t k) {
    return &g->node[((size_t)k * (size_t)g->m + (size_t)j) * (size_t)g->m + (size_t)i];
}

static int on_surface(const grid *g, int32_t i, int32_t j, int32_t k) {
    return i == 0 || j == 0 || k == 0 || i == g->m - 1 || j == g->m - 1 || k == g->layers - 1;
}

static void add_quad(pal_model *model, int32_t a, int32_t b, int32_t c, int32_t d) {
    int32_t *t = model->triangle + 3 * model->info.triangle_count;
    int32_t corners[6] = {a, b, c, a, c, d};
    memcpy(t, corners, sizeof corners);
    model->info.triangle_count += 2;
}

static void make_triangles(pal_model *model, const grid *g) {
    int32_t e = g->m - 1, f = g->layers - 1;
    for (int32_t j = 0; j < e; j++) {
        for (int32_t i = 0; i < e; i++) {
            add_quad(model, *at(g, i, j, 0), *at(g, i + 1, j, 0), *at(g, i + 1, j + 1, 0),
                     *at(g, i, j + 1, 0));
            add_quad(model, *at(g, i, j, f), *at(g, i, j + 1, f), *at(g, i + 1, j + 1, f),
                     *at(g, i + 1, j, f));
        }
    }
    for (int32_t k = 0; k < f; k++) {
        for (int32_t i = 0; i < e; i++) {
            add_quad(model, *at(g, i, 0, k), *at(g, i, 0, k + 1), *at(g, i + 1, 0, k + 1),
                     *at(g, i + 1, 0, k));
            add_quad(model, *at(g, i, e, k), *at(g, i + 1, e, k), *at(g, i + 1, e, k + 1),
                     *at(g, i, e, k + 1));
            add_quad(model, *at(g, 0, i, k), *at(g, 0, i + 1, k), *at(g, 0, i + 1, k + 1),
                     *at(g, 0, i, k + 1));
            add_quad(model, *at(g, e, i, k), *at(g, e, i, k + 1), *at(g, e, i + 1, k + 1),
                     *at(g, e, i + 1, k));
        }
    }
}

static void make_normals(pal_model *model) {
    const pal_model_info *info = &model->info;
    for (int32_t t = 0; t < info->triangle_count; t++) {
        const int32_t *v = model->triangle + 3 * t;
        double e[2][3], area[3];
        for (int c = 0; c < 3; c++) {
            e[0][c] = model->position[3 * v[1] + c] - model->position[3 * v[0] + c];
            e[1][c] = model->position[3 * v[2] + c] - model->position[3 * v[0] + c];
        }
        for (int c = 0; c < 3; c++) {
            int p = (c + 1) % 3, q = (c + 2) % 3;
            area[c] = (e[0][p] * e[1][q] - e[0][q] * e[1][p]) / 2;
        }
        for (int corner = 0; corner < 3; corner++) {
            for (int c = 0; c < 3; c++) {
                model->area_vector[3 * v[corner] + c] += area[c] / 3;
            }
        }
    }
    for (int32_t i = 0; i < info->surface_count; i++) {
        const double *s = model->area_vector + 3 * i;
        double length = sqrt(s[0] * s[0] + s[1] * s[1] + s[2] * s[2]);
        for (int c = 0; c < 3; c++) {
            model->normal[3 * i + c] = s[c] / length;
        }
    }
}

static int make_nodes(pal_model *model, const synthetic_params *p, grid *g) {
    pal_model_info *info = &model->info;
    int32_t m = g->m, inner = (m - 2) * (m - 2) * (g->layers - 2);
    info->node_count = m * m * g->layers;
    info->surface_count = info->node_count - inner;
    size_t nodes = (size_t)info->node_count, surface = (size_t)info->surface_count;
    size_t triangles =
        4 * (size_t)(m - 1) * (size_t)(m - 1) + 8 * (size_t)(m - 1) * (size_t)(g->layers - 1);
    model->position = calloc(nodes * 3, sizeof(double));
    model->node_flags = calloc(nodes, 1);
    model->normal = calloc(surface * 3, sizeof(double));
    model->area_vector = calloc(surface * 3, sizeof(double));
    model->triangle = calloc(triangles * 3, sizeof(int32_t));
    g->node = calloc(nodes, sizeof(int32_t));
    if (model->position == NULL || model->node_flags == NULL || model->normal == NULL ||
        model->area_vector == NULL || model->triangle == NULL || g->node == NULL) {
        return 0;
    }
    int32_t next[2] = {0, info->surface_count};
    double half = (m - 1) * p->spacing / 2;
    for (int32_t k = 0; k < g->layers; k++) {
        for (int32_t j = 0; j < m; j++) {
            for (int32_t i = 0; i < m; i++) {
                int32_t node = next[!on_surface(g, i, j, k)]++;
                *at(g, i, j, k) = node;
                double *x = model->position + 3 * node;
                x[0] = i * p->spacing - half;
                x[1] = j * p->spacing - half;
                x[2] = -k * p->spacing;
                if (k == g->layers - 1) {
                    model->node_flags[node] = PALPATE_NODE_FIXED;
                    info->fixed_count++;
                } else if (k == 0 && i > 0 && j > 0 && i < m - 1 && j < m - 1) {
                    model->node_flags[node] = PALPATE_NODE_TOUCHABLE;
                    info->touchable_count++;
                }
            }
        }
    }
    make_triangles(model, g);
    make_normals(model);
    for (int c = 0; c < 3; c++) {
        info->bounds_min[c] = c < 2 ? -half : -(g->layers - 1) * p->spacing;
        info->bounds_max[c] = c < 2 ? half : 0;
    }
    info->volume = 4 * half * half * (g->layers - 1) * p->spacing;
    return 1;
}

// ---- Compliance ---------------------------------------------------------------------------------

static void green_at(const pal_model *model, const synthetic_params *p, const double *x,
                     int32_t column, int direction, double u[3]) {
    const double *y = model->position + 3 * model->column_node[column];
    synthetic_green(p->young, p->poisson, x, y, direction, p->spacing * p->spacing, u);
}

static int make_c_tt(pal_model *model, const synthetic_params *p) {
    int32_t t = model->info.column_count;
    size_t n = 3 * (size_t)t;
    model->c_tt = calloc(n * n, sizeof(double));
    if (model->c_tt == NULL) {
        return 0;
    }
    for (int32_t b = 0; b < t; b++) {
        for (int c = 0; c < 3; c++) {
            for (int32_t a = 0; a < t; a++) {
                double *entry = model->c_tt + 3 * (size_t)a + (3 * (size_t)b + (size_t)c) * n;
                green_at(model, p, model->position + 3 * model->column_node[a], b, c, entry);
            }
        }
    }
    // exact symmetry, and the skew part when asked for: noise that falls off like C itself
    double norm2 = 0, skew2 = 0;
    uint64_t seed = 12345;
    double *noise = p->skew != 0 ? calloc(n * n, sizeof(double)) : NULL;
    if (p->skew != 0 && noise == NULL) {
        return 0;
    }
    for (size_t j = 0; j < n; j++) {
        norm2 += model->c_tt[j + j * n] * model->c_tt[j + j * n];
        for (size_t i = 0; i < j; i++) {
            double mean = (model->c_tt[i + j * n] + model->c_tt[j + i * n]) / 2;
            model->c_tt[i + j * n] = model->c_tt[j + i * n] = mean;
            norm2 += 2 * mean * mean;
            if (noise != NULL) {
                seed = seed * 6364136223846793005u + 1442695040888963407u;
                noise[i + j * n] = ((double)(seed >> 11) / 4503599627370496.0 - 1) *
                                   fabs(model->c_tt[i / 3 * 3 + j / 3 * 3 * n]);
                skew2 += 2 * noise[i + j * n] * noise[i + j * n];
            }
        }
    }
    if (noise != NULL) {
        // C + N - N^T: C - C^T = 2 (N - N^T)
        double factor = p->skew / 2 * sqrt(norm2 / skew2);
        for (size_t j = 0; j < n; j++) {
            for (size_t i = 0; i < j; i++) {
                model->c_tt[i + j * n] += factor * noise[i + j * n];
                model->c_tt[j + i * n] -= factor * noise[i + j * n];
            }
        }
        free(noise);
    }
    return 1;
}

static int make_rows(pal_model *model, const synthetic_params *p) {
    pal_model_info *info = &model->info;
    int32_t last = p->rows == SYNTHETIC_ROWS_NONE      ? 0
                   : p->rows == SYNTHETIC_ROWS_SURFACE ? info->surface_count
                                                       : info->node_count;
    model->row_node = calloc((size_t)info->node_count, sizeof(int32_t));
    double *column = calloc(3 * (size_t)info->node_count, sizeof(double));
    int ok = model->row_node != NULL && column != NULL;
    for (int32_t i = 0; ok && i < last; i++) {
        if ((model->node_flags[i] & PALPATE_NODE_FIXED) == 0) {
            model->row_node[info->row_count++] = i;
        }
    }
    ok = ok && pal_model_alloc_rows(model, NULL) == PALPATE_OK;
    if (ok && info->row_count > 0) {
        double self[3];
        green_at(model, p, model->position + 3 * model->column_node[0], 0, 0, self);
        pal_model_scale_rows(model, self[0]); // the largest entry
    }
    for (int32_t b = 0; ok && info->row_count > 0 && b < info->column_count; b++) {
        for (int c = 0; ok && c < 3; c++) {
            for (int32_t r = 0; r < info->row_count; r++) {
                green_at(model, p, model->position + 3 * model->row_node[r], b, c, column + 3 * r);
            }
            ok = pal_model_store_column(model, 3 * (int64_t)b + c, column) == PALPATE_OK;
        }
    }
    free(column);
    return ok;
}

/// Extreme eigenvalues of the symmetric part by power and inverse iteration.
static int make_certificate(pal_model *model, const synthetic_params *p) {
    pal_certificate *c = &model->info.certificate;
    size_t n = 3 * (size_t)model->info.column_count;
    double *s = calloc(n * n, sizeof *s), *x = calloc(n, sizeof *x), *y = calloc(n, sizeof *y);
    int ok = s != NULL && x != NULL && y != NULL;
    double norm2 = 0, skew2 = 0;
    for (int inverse = 0; ok && inverse < 2; inverse++) {
        for (size_t j = 0; j < n; j++) {
            x[j] = inverse ? ((j / 3 + j) % 2 ? 1 : -0.7) : 1;
            for (size_t i = 0; i < n; i++) {
                double a = model->c_tt[i + j * n], b = model->c_tt[j + i * n];
                s[i + j * n] = (a + b) / 2;
                norm2 += inverse ? 0 : a * a;
                skew2 += inverse ? 0 : (a - b) * (a - b);
            }
        }
        if (inverse && pal_dense_cholesky((int32_t)n, 0, s, (int32_t)n) != 0) {
            break;
        }
        double value = 0;
        for (int step = 0; step < 60; step++) {
            memcpy(y, x, n * sizeof *y);
            if (inverse) {
                pal_dense_cholesky_solve((int32_t)n, s, (int32_t)n, 1, y, (int32_t)n);
            } else {
                memset(y, 0, n * sizeof *y);
                for (size_t j = 0; j < n; j++) {
                    for (size_t i = 0; i < n; i++) {
                        y[i] += s[i + j * n] * x[j];
                    }
                }
            }
            double length = 0;
            for (size_t i = 0; i < n; i++) {
                length += y[i] * y[i];
            }
            value = sqrt(length);
            for (size_t i = 0; i < n; i++) {
                x[i] = y[i] / value;
            }
        }
        if (inverse) {
            c->min_eigenvalue = 1 / value;
            c->pass = 1;
            c->passive = p->skew == 0;
        } else {
            c->max_eigenvalue = value;
        }
    }
    c->symmetrized = p->skew == 0;
    c->reciprocity = norm2 > 0 ? sqrt(skew2 / norm2) : 0;
    c->min_eigenvalue_ratio = c->max_eigenvalue > 0 ? c->min_eigenvalue / c->max_eigenvalue : 0;
    c->force_balance = c->estimated_error = -1;
    if (!c->pass) {
        (void)snprintf(c->reason, sizeof c->reason, "the symmetric part is not positive definite");
    }
    free(s);
    free(x);
    free(y);
    return ok;
}

// ---- Patches, probes, skin, tool
// ------------------------------------------------------------------

static int make_patch(pal_model *model, const char *name, double radius) {
    const pal_model_info *info = &model->info;
    pal_patch *patch = &model->patch[model->info.patch_count++];
    (void)snprintf(patch->name, sizeof patch->name, "%s", name);
    patch->column = calloc((size_t)info->column_count, sizeof(int32_t));
    if (patch->column == NULL) {
        return 0;
    }
    for (int32_t i = 0; i < info->column_count; i++) {
        const double *x = model->position + 3 * model->column_node[i];
        if (hypot(x[0], x[1]) <= radius) {
            patch->column[patch->count++] = i;
        }
    }
    return 1;
}

static int make_patches_and_probes(pal_model *model, const synthetic_params *p) {
    pal_model_info *info = &model->info;
    double h = p->spacing;
    model->patch = calloc(2, sizeof *model->patch);
    model->probe = calloc(2, sizeof *model->probe);
    model->probe_row = calloc(2 * 9 * (size_t)info->column_count, sizeof(double));
    if (model->patch == NULL || model->probe == NULL || model->probe_row == NULL ||
        !make_patch(model, "centre", 1.6 * h) || !make_patch(model, "all", INFINITY)) {
        return 0;
    }
    info->probe_count = 2;
    model->probe[0] = (pal_probe){"deep", {0, 0, -0.9 * h}};
    model->probe[1] = (pal_probe){"beside", {1.3 * h, -0.4 * h, -0.6 * h}};
    for (int32_t b = 0; b < info->column_count; b++) {
        for (int c = 0; c < 3; c++) {
            for (int k = 0; k < 2; k++) {
                green_at(model, p, model->probe[k].position, b, c,
                         model->probe_row + 3 * k + 6 * (3 * (size_t)b + (size_t)c));
            }
        }
    }
    return 1;
}

static int32_t row_of(const pal_model *model, int32_t node) {
    for (int32_t r = 0; r < model->info.row_count; r++) {
        if (model->row_node[r] == node) {
            return r;
        }
    }
    return -1;
}

static int make_skin(pal_model *model, const grid *g) {
    int32_t side = 2 * g->m - 1, cells = side - 1;
    model->info.skin_count = side * side;
    model->skin_triangle_count = 2 * cells * cells;
    size_t count = (size_t)model->info.skin_count;
    model->skin_position = calloc(3 * count, sizeof(double));
    model->skin_row = calloc(PALPATE_SKIN_WEIGHTS * count, sizeof(int32_t));
    model->skin_weight = calloc(PALPATE_SKIN_WEIGHTS * count, sizeof(float));
    model->skin_triangle = calloc(3 * (size_t)model->skin_triangle_count, sizeof(int32_t));
    model->skin_twin = calloc(count, sizeof(int32_t));
    if (model->skin_twin == NULL || model->skin_position == NULL || model->skin_row == NULL ||
        model->skin_weight == NULL || model->skin_triangle == NULL) {
        return 0;
    }
    int32_t *triangle = model->skin_triangle;
    for (int32_t j = 0; j < side; j++) {
        for (int32_t i = 0; i < side; i++) {
            size_t v = (size_t)(j * side + i);
            model->skin_twin[v] = (int32_t)v;
            int32_t corner[4] = {*at(g, i / 2, j / 2, 0), *at(g, (i + 1) / 2, j / 2, 0),
                                 *at(g, i / 2, (j + 1) / 2, 0),
                                 *at(g, (i + 1) / 2, (j + 1) / 2, 0)};
            for (int k = 0; k < PALPATE_SKIN_WEIGHTS; k++) {
                int used = k < 4;
                model->skin_row[v * PALPATE_SKIN_WEIGHTS + (size_t)k] =
                    used ? row_of(model, corner[k]) : -1;
                model->skin_weight[v * PALPATE_SKIN_WEIGHTS + (size_t)k] = used ? 0.25f : 0;
                for (int c = 0; used && c < 3; c++) {
                    model->skin_position[3 * v + (size_t)c] +=
                        model->position[3 * corner[k] + c] / 4;
                }
            }
            if (i < cells && j < cells) {
                int32_t a = j * side + i, b = a + 1, c = a + side, d = c + 1;
                int32_t corners[6] = {a, b, d, a, d, c};
                memcpy(triangle, corners, sizeof corners);
                triangle += 6;
            }
        }
    }
    return 1;
}

static void make_runtime(pal_model *model, const synthetic_params *p) {
    pal_runtime_config *runtime = &model->runtime;
    double h = p->spacing;
    runtime->tool_count = 1;
    runtime->servo_rate = 1000;
    runtime->render_rate = 30;
    runtime->max_contacts = 32;
    runtime->contact_law = PALPATE_CONTACT_SURFACE;
    runtime->contact_points = 16;
    runtime->tools[0] = (pal_tool_def){.name = "probe",
                                       .shape = PALPATE_SHAPE_SPHERE,
                                       .radius = 2 * h,
                                       .limits = {.force = 3.3, .slew = 100, .torque = 0.1},
                                       .start = {0, 0, 2 * h},
                                       .axis = {0, 0, -1},
                                       .has_start = 1,
                                       .device = {.kind = PALPATE_DEVICE_SCRIPTED,
                                                  .stroke = {.kind = PALPATE_STROKE_PRESS,
                                                             .depth = 0.5 * h,
                                                             .ramp = 0.2,
                                                             .period = 1,
                                                             .direction = {1, 0, 0}}}};
}

pal_model *synthetic_model(const synthetic_params *params) {
    if (params->n < 2 || params->n > 200 || params->layers < 2 || params->layers > 200 ||
        !(params->spacing > 0) || !(params->young > 0)) {
        return NULL;
    }
    grid g = {.m = params->n + 2, .layers = params->layers};
    pal_model *model = pal_model_new();
    if (model == NULL) {
        return NULL;
    }
    pal_model_info *info = &model->info;
    info->precision = params->precision;
    info->young = params->young;
    info->poisson = params->poisson;
    info->density = 1000;
    info->spacing_min = info->spacing_mean = info->spacing_max = params->spacing;
    (void)snprintf(info->method, sizeof info->method, "half-space");
    (void)snprintf(info->method_options, sizeof info->method_options, "spacing=%g",
                   params->spacing);
    (void)snprintf(info->provenance, sizeof info->provenance, "tests/support/synthetic_model.c");

    int ok = make_nodes(model, params, &g);
    info->column_count = info->touchable_count;
    model->column_node = calloc((size_t)info->column_count + 1, sizeof(int32_t));
    ok = ok && model->column_node != NULL;
    for (int32_t i = 0, t = 0; ok && i < info->surface_count; i++) {
        if ((model->node_flags[i] & PALPATE_NODE_TOUCHABLE) != 0) {
            model->column_node[t++] = i;
        }
    }
    ok = ok && make_c_tt(model, params) && make_rows(model, params) &&
         make_certificate(model, params) && make_patches_and_probes(model, params) &&
         (!params->skin || make_skin(model, &g));
    free(g.node);
    if (!ok) {
        pal_model_free(model);
        return NULL;
    }
    make_runtime(model, params);
    size_t n = 3 * (size_t)info->column_count;
    info->bytes =
        n * n * sizeof(double) + n * (size_t)model->row_ld * pal_precision_size(info->precision);
    return model;
}
