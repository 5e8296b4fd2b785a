/// @file rest_rig.c  Icospheres and boxes as models without compliance.
#include "tests/support/rest_rig.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

double rest_rig_random(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-52 - 1.0;
}

/// A growing mesh; nodes at equal places are one node.
typedef struct mesh {
    double *x;
    int32_t *v;
    int32_t nodes, triangles, room;
} mesh;

static mesh mesh_new(int32_t triangles) {
    mesh m = {.room = triangles};
    m.x = calloc((size_t)triangles * 3, 3 * sizeof *m.x);
    m.v = calloc((size_t)triangles, 3 * sizeof *m.v);
    assert_true(m.x != NULL && m.v != NULL);
    return m;
}

static int32_t add_node(mesh *m, const double x[3]) {
    for (int32_t i = 0; i < m->nodes; i++) {
        const double *y = m->x + 3 * (size_t)i;
        if (fabs(y[0] - x[0]) + fabs(y[1] - x[1]) + fabs(y[2] - x[2]) < 1e-9) {
            return i;
        }
    }
    memcpy(m->x + 3 * (size_t)m->nodes, x, 3 * sizeof *x);
    return m->nodes++;
}

static void add_triangle(mesh *m, int32_t a, int32_t b, int32_t c) {
    assert_true(m->triangles < m->room);
    int32_t v[3] = {a, b, c};
    memcpy(m->v + 3 * (size_t)m->triangles++, v, sizeof v);
}

static void to_model(rest_rig *rig, mesh *m, const double size[3]) {
    *rig = (rest_rig){.model = pal_model_new()};
    pal_model *model = rig->model;
    assert_non_null(model);
    size_t n = (size_t)m->nodes;
    model->info.node_count = model->info.surface_count = m->nodes;
    model->info.column_count = model->info.touchable_count = m->nodes;
    model->info.triangle_count = m->triangles;
    model->position = m->x;
    model->triangle = m->v;
    model->node_flags = malloc(n);
    model->column_node = calloc(n, sizeof(int32_t));
    assert_true(model->node_flags != NULL && model->column_node != NULL);
    for (size_t i = 0; i < n; i++) {
        model->node_flags[i] = PALPATE_NODE_TOUCHABLE;
        model->column_node[i] = (int32_t)i;
        for (int c = 0; c < 3; c++) {
            double *x = &model->position[3 * i + (size_t)c];
            *x *= size[c];
            model->info.bounds_min[c] = fmin(model->info.bounds_min[c], *x);
            model->info.bounds_max[c] = fmax(model->info.bounds_max[c], *x);
        }
    }
    rest_rig_build(rig, PALPATE_WEIGHTS_NODES, PALPATE_WEIGHTS_POWER);
}

void rest_rig_build(rest_rig *rig, int32_t nodes, int32_t power) {
    free(rig->surface_memory);
    free(rig->weights_memory);
    rig->surface_memory = aligned_alloc(64, pal_rest_bytes(rig->model));
    rig->weights_memory = aligned_alloc(64, pal_weights_bytes(rig->model));
    assert_true(rig->surface_memory != NULL && rig->weights_memory != NULL);
    pal_rest_init(&rig->surface, rig->model, rig->surface_memory);
    pal_weights_init(&rig->weights, rig->model, &rig->surface, nodes, power, rig->weights_memory);
}

void rest_rig_free(rest_rig *rig) {
    free(rig->surface_memory);
    free(rig->weights_memory);
    pal_model_free(rig->model);
}

static void to_unit(double x[3]) {
    double length = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]);
    for (int i = 0; i < 3; i++) {
        x[i] /= length;
    }
}

void rest_rig_sphere(rest_rig *rig, int levels, double jitter, const double size[3]) {
    static const int face[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                    {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                    {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                    {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    double g = (1.0 + sqrt(5.0)) / 2.0;
    double corner[12][3] = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                            {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                            {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
    mesh m = mesh_new(20);
    for (int i = 0; i < 12; i++) {
        to_unit(corner[i]);
        add_node(&m, corner[i]);
    }
    for (int t = 0; t < 20; t++) {
        add_triangle(&m, face[t][0], face[t][1], face[t][2]);
    }
    for (int level = 0; level < levels; level++) {
        mesh fine = mesh_new(4 * m.triangles);
        memcpy(fine.x, m.x, 3 * (size_t)m.nodes * sizeof *m.x);
        fine.nodes = m.nodes;
        for (int32_t t = 0; t < m.triangles; t++) {
            const int32_t *v = m.v + 3 * (size_t)t;
            int32_t middle[3];
            for (int e = 0; e < 3; e++) {
                const double *p = m.x + 3 * (size_t)v[e], *q = m.x + 3 * (size_t)v[(e + 1) % 3];
                double x[3] = {p[0] + q[0], p[1] + q[1], p[2] + q[2]};
                to_unit(x);
                middle[e] = add_node(&fine, x);
            }
            add_triangle(&fine, v[0], middle[0], middle[2]);
            add_triangle(&fine, middle[0], v[1], middle[1]);
            add_triangle(&fine, middle[2], middle[1], v[2]);
            add_triangle(&fine, middle[0], middle[1], middle[2]);
        }
        free(m.x);
        free(m.v);
        m = fine;
    }
    uint64_t state = 11;
    double edge = 1.1 * pow(0.5, levels);
    for (int32_t i = 0; i < m.nodes; i++) {
        for (int c = 0; c < 3; c++) {
            m.x[3 * (size_t)i + (size_t)c] += jitter * edge * rest_rig_random(&state);
        }
        to_unit(m.x + 3 * (size_t)i);
    }
    to_model(rig, &m, size);
}

void rest_rig_box(rest_rig *rig, int n, const double size[3]) {
    mesh m = mesh_new(12 * n * n);
    for (int face = 0; face < 6; face++) {
        int axis = face / 2, far = face % 2, u = (axis + 1) % 3, v = (axis + 2) % 3;
        for (int j = 0; j < n; j++) {
            for (int i = 0; i < n; i++) {
                int32_t node[4];
                for (int k = 0; k < 4; k++) {
                    double x[3];
                    x[axis] = far;
                    x[u] = (double)(i + (k == 1 || k == 2)) / n;
                    x[v] = (double)(j + (k >= 2)) / n;
                    node[k] = add_node(&m, x);
                }
                int b = far ? 1 : 3, d = far ? 3 : 1;
                add_triangle(&m, node[0], node[b], node[2]);
                add_triangle(&m, node[0], node[2], node[d]);
            }
        }
    }
    to_model(rig, &m, size);
}
