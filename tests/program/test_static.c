/// The force of `run` at the end of a slow press is the static one: a real model, a real run in
/// real time, its recording, and LAPACK on the model's own compliance for the nodes that were
/// touched.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <palpate/palpate.h>

#include "haptic/model/h5.h"
#include "tests/support/engine_rig.h"
#include "tests/support/program.h"

static char folder[] = "/tmp/palpate-static-XXXXXX";

static void run_ok(const char *format, ...) __attribute__((format(printf, 1, 2)));
static void run_ok(const char *format, ...) {
    char arguments[4096];
    va_list args;
    va_start(args, format);
    (void)vsnprintf(arguments, sizeof arguments, format, args);
    va_end(args);
    program_result r = program_run(arguments);
    if (r.status != 0) {
        fail_msg("palpate %s: %d, %s", arguments, r.status, r.error);
    }
    program_clear(&r);
}

static double *read_column(pal_h5 *file, const char *path, int64_t rows, int64_t width) {
    double *x = malloc((size_t)(rows * width) * sizeof *x);
    pal_error e = {0};
    assert_non_null(x);
    if (pal_h5_read(file, path, PALPATE_H5_F64, 2, (const int64_t[]){rows, width}, x, &e) !=
        PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    return x;
}

static void a_slow_press_ends_in_the_static_solution(void **state) {
    (void)state;
    char model[300], record[300];
    (void)snprintf(model, sizeof model, "%s/m.palpate", folder);
    (void)snprintf(record, sizeof record, "%s/r.h5", folder);
    // 3 mm in 1 s, a little aside so that nothing is symmetric
    run_ok(
        "precompute %s/scenes/hemisphere.yaml -q -o %s --set body.patches.pole.rim_spacing=0.002 "
        "--set 'tools.probe.device={scripted: {kind: press, depth: 0.003, ramp: 1}}' "
        "--set contact.law=nodes --set 'tools.probe.start=[0.0021, -0.0013, 0.054]'",
        program_source(), model);
    run_ok("run %s --for 1.2 --no-draw --no-realtime --record %s", model, record);

    rig r = {0};
    pal_error e = {0};
    pal_h5 *file = NULL;
    int64_t n = 0;
    if (pal_model_load(model, &r.model, &e) != PALPATE_OK ||
        pal_h5_open_file(record, &file, &e) != PALPATE_OK ||
        pal_h5_dims(file, "/ticks/tick", PALPATE_H5_U64, 1, &n, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    assert_true(n > 100); // a loaded machine may miss many
    double *position = read_column(file, "/ticks/position", n, 3);
    double *orientation = read_column(file, "/ticks/orientation", n, 4);
    double *force = read_column(file, "/ticks/force", n, 3);
    assert_int_equal(pal_h5_close(file, NULL), PALPATE_OK);

    // which nodes are touched at the end: the engine's answer, fed with the same poses
    const pal_runtime_config *runtime = pal_model_runtime(r.model);
    r.def = pal_engine_default_def();
    r.def.tools = runtime->tools;
    r.def.tool_count = 1;
    r.def.max_contacts = runtime->max_contacts;
    r.def.contact_law = runtime->contact_law;
    assert_int_equal(pal_engine_create(r.model, &r.def, &r.engine, &e), PALPATE_OK);
    pal_tool_force out = {0};
    for (int64_t i = 0; i < n; i++) {
        pal_tool_state in = {0};
        memcpy(in.position, position + 3 * i, sizeof in.position);
        memcpy(in.orientation, orientation + 4 * i, sizeof in.orientation);
        (void)pal_engine_force(r.engine, &in, &out);
    }
    const pal_contact_result *c = &r.engine->result;
    assert_true(out.contact_count >= 3);
    assert_int_equal(out.fault, 0); // nothing capped or limited: the bare solution
    assert_int_equal(c->dof_count, 3 * out.contact_count);

    // static: C_aa f = u of the touched nodes; the tool feels the negative of their sum
    double *f = rig_lapack(&r), sum[3] = {0}, size = 0, difference = 0;
    for (int i = 0; i < c->dof_count; i++) {
        sum[i % 3] += f[i];
    }
    for (int k = 0; k < 3; k++) {
        size = hypot(size, sum[k]);
        difference = hypot(difference, force[3 * (n - 1) + k] + sum[k]);
    }
    print_message("force %.6g N on %d nodes, static solution differs by %.1e\n", size,
                  (int)out.contact_count, difference / size);
    assert_true(size > 0.02 && size < 1.0); // about 0.12 N; Hertz: 4/3 E* sqrt(R) d^1.5 = 0.17 N
    assert_true(difference <= 1e-5 * size);
    // down on the body, up on the tool, and nearly along the press
    assert_true(force[3 * (n - 1) + 2] > 0.9 * size);
    free(f);
    free(position);
    free(orientation);
    free(force);
    pal_engine_free(r.engine);
    pal_model_free(r.model);
}

static int setup(void **state) {
    (void)state;
    return mkdtemp(folder) == NULL;
}

static int teardown(void **state) {
    (void)state;
    char command[400];
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_slow_press_ends_in_the_static_solution),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
