/// @file engine_rig.c  An engine on a synthetic half space, and independent answers to check it by.
#include "tests/support/engine_rig.h"

#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <lapacke.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

pal_contact_kind rig_law = PALPATE_CONTACT_NODES;

int rig_surface_law(void **state) {
    (void)state;
    rig_law = PALPATE_CONTACT_SURFACE;
    return 0;
}

int rig_nodes_law(void **state) {
    (void)state;
    rig_law = PALPATE_CONTACT_NODES;
    return 0;
}

void rig_model(rig *r, int32_t n, pal_precision precision, double skew) {
    memset(r, 0, sizeof *r);
    synthetic_params p = synthetic_default_params();
    p.n = n;
    p.precision = precision;
    p.skew = skew;
    r->model = synthetic_model(&p);
    assert_non_null(r->model);
    r->tools[0] = (pal_tool_def){.name = "ball",
                                 .shape = PALPATE_SHAPE_SPHERE,
                                 .radius = 0.004,
                                 .limits = {INFINITY, INFINITY, INFINITY}};
    r->def = pal_engine_default_def();
    r->def.tool_count = 1;
    r->def.tools = r->tools;
    r->def.frame_age = 1;
    r->def.contact_law = rig_law;
}

void rig_engine(rig *r) {
    pal_error error = {0};
    pal_status status = pal_engine_create(r->model, &r->def, &r->engine, &error);
    if (status != PALPATE_OK) {
        print_error("%s\n", error.message);
    }
    assert_int_equal(status, PALPATE_OK);
}

void rig_free(rig *r) {
    pal_engine_free(r->engine);
    pal_model_free(r->model);
}

pal_tool_state rig_state(double x, double y, double z) {
    return (pal_tool_state){.position = {x, y, z}, .orientation = {1.0, 0.0, 0.0, 0.0}};
}

pal_tool_force rig_tick(rig *r, double x, double y, double z) {
    pal_tool_state in = rig_state(x, y, z);
    pal_tool_force out;
    (void)pal_engine_tick(r->engine, &in, &out);
    return out;
}

pal_tool_force rig_press(rig *r, double x, double y, double z0, double z1, int steps) {
    pal_tool_force out = {0};
    for (int k = 0; k <= steps; k++) {
        out = rig_tick(r, x, y, z0 + (z1 - z0) * k / steps);
    }
    return out;
}

double *rig_lapack(const rig *r) {
    const pal_contact_result *result = &r->engine->result;
    int32_t m = result->dof_count;
    size_t ld = 3 * (size_t)r->model->info.column_count, n = (size_t)m;
    double *a = calloc(n * n + 1, sizeof *a), *f = calloc(n + 1, sizeof *f);
    lapack_int *pivot = calloc(n + 1, sizeof *pivot);
    assert_non_null(a);
    assert_non_null(f);
    assert_non_null(pivot);
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < n; i++) {
            a[i + j * n] = r->model->c_tt[(size_t)result->dof[i] + (size_t)result->dof[j] * ld];
        }
        f[j] = result->displacement[j];
    }
    assert_int_equal(LAPACKE_dgesv(LAPACK_COL_MAJOR, m, 1, a, m, pivot, f, m), 0);
    free(a);
    free(pivot);
    return f;
}
