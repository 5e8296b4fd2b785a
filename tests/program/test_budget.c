/// `palpate precompute --budget`: what is picked keeps to the budget when the model is looked at,
/// says why, and a budget that nothing meets is refused by name.
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

#include "haptic/engine/cost.h"
#include "tests/support/program.h"
#include "tests/support/synthetic_model.h"

static char scene[128], plain[128], model[128];

static program_result run(const char *format, ...) __attribute__((format(printf, 1, 2)));
static program_result run(const char *format, ...) {
    char arguments[2048];
    va_list args;
    va_start(args, format);
    (void)vsnprintf(arguments, sizeof arguments, format, args);
    va_end(args);
    return program_run(arguments);
}

static const char TEXT[] = "palpate: 1\n"
                           "body:\n"
                           "  geometry: {box: {size: [0.06, 0.06, 0.03], center: [0, 0, -0.015]}}\n"
                           "  spacing: 0.012\n"
                           "  material: {young: 10e3, poisson: 0.4}\n"
                           "  fixed: [{below: {z: -0.03}}]\n"
                           "  touchable: [{above: {z: 0}}]\n"
                           "%s"
                           "tools:\n"
                           "  - name: probe\n"
                           "    shape: {sphere: {radius: 0.01}}\n"
                           "    device: {scripted: {kind: palpation, depth: 0.004, period: 0.5}}\n"
                           "    start: [0, 0, 0.01]\n"
                           "    axis: [0, 0, -1]\n";

static void write_scene(char *path, size_t size, const char *name, const char *patches) {
    (void)snprintf(path, size, "/tmp/palpate-budget-%ld-%s", (long)getpid(), name);
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    (void)fprintf(f, TEXT, patches);
    assert_int_equal(fclose(f), 0);
}

static int set_up(void **state) {
    (void)state;
    write_scene(
        scene, sizeof scene, "patch.yaml",
        "  patches: {top: {ball: {center: [0, 0, 0], radius: 0.012}, rim_spacing: 0.004}}\n");
    write_scene(plain, sizeof plain, "plain.yaml", "");
    (void)snprintf(model, sizeof model, "/tmp/palpate-budget-%ld.palpate", (long)getpid());
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    (void)unlink(scene);
    (void)unlink(plain);
    (void)unlink(model);
    return 0;
}

static const char *picked(const program_result *r, const char *key) {
    return json_string_value(
        json_object_get(json_object_get(json_object_get(r->json, "budget"), "picked"), key));
}

static void bytes_are_kept_to_and_more_bytes_buy_a_finer_model(void **state) {
    (void)state;
    double nodes[2];
    const double allowed[2] = {1e6, 3e6};
    for (int k = 0; k < 2; k++) {
        program_result r = run("precompute %s --budget %.0fkB -o %s --json --quiet", plain,
                               1e-3 * allowed[k], model);
        assert_int_equal(r.status, 0);
        program_result info =
            run("info %s --json", model); // the file itself, not what was promised
        double bytes = program_number(info.json, "bytes");
        assert_true(bytes <= allowed[k]);
        assert_true(bytes >
                    0.1 * allowed[k]); // steps of 2^(1/3) in spacing: a factor of 2 to 3 in bytes
        assert_true(bytes == program_number(r.json, "budget.measured.bytes"));
        assert_string_equal(picked(&r, "displacement"),
                            "surface"); // what the scene asked for is kept
        assert_non_null(json_object_get(json_object_get(r.json, "budget"), "why"));
        assert_true(json_array_size(json_object_get(json_object_get(r.json, "budget"), "pilots")) >=
                    2);
        nodes[k] = program_number(info.json, "nodes");
        program_clear(&info);
        program_clear(&r);
    }
    assert_true(nodes[1] > 1.3 * nodes[0]);
}

static void an_error_is_met_by_the_models_own_estimate(void **state) {
    (void)state;
    program_result r = run("precompute %s --budget 6%% -o %s --json --quiet", scene, model);
    assert_int_equal(r.status, 0);
    program_result info = run("info %s --json", model);
    double estimate = program_number(info.json, "certificate.estimated_error");
    assert_true(estimate > 0.0 && estimate <= 0.06);
    const char *rule =
        json_string_value(json_object_get(json_object_get(r.json, "budget"), "optimised"));
    assert_non_null(rule);
    assert_non_null(strstr(rule, "then the cheapest tick"));
    program_clear(&info);
    program_clear(&r);
    r = run("precompute %s --budget 6%%", plain); // nothing there to estimate it with
    assert_int_not_equal(r.status, 0);
    assert_non_null(strstr(r.error, "body.patches"));
    program_clear(&r);
}

static void a_time_budget_of_no_concern_is_met_and_said(void **state) {
    (void)state;
    // two seconds a tick: met on any machine; the text names what was picked, predicted and
    // measured
    program_result r = run("precompute %s --budget 2s --budget 5MB -o %s", scene, model);
    assert_int_equal(r.status, 0);
    assert_non_null(strstr(r.out, "picked "));
    assert_non_null(strstr(r.out, "because "));
    assert_non_null(strstr(r.out, "optimised    of all that fit: the most of the stored rows"));
    assert_non_null(strstr(r.out, "below 0.5 % all count as equal"));
    assert_non_null(strstr(r.out, "predicted "));
    assert_non_null(strstr(r.out, "measured "));
    // of settings that differ in nothing the budget counts, the one whose frames come every tick
    char *picked = strstr(r.out, "picked ");
    picked[strcspn(picked, "\n")] = '\0';
    assert_non_null(strstr(picked, "field by the servo"));
    program_clear(&r);
}

static void what_nothing_meets_is_refused(void **state) {
    (void)state;
    program_result r = run("precompute %s --budget 1kB -o %s.none", scene, model);
    assert_int_not_equal(r.status, 0);
    assert_non_null(strstr(r.error, "none of"));
    assert_non_null(strstr(r.error, "bytes allowed"));
    assert_null(strstr(r.out, "picked"));
    program_clear(&r);
    char path[160];
    (void)snprintf(path, sizeof path, "%s.none", model);
    assert_int_not_equal(access(path, F_OK), 0); // and nothing is written
    static const char *const bad[] = {"fast", "0us", "-3MB", "5", "5kg", "nan%", "1e999MB"};
    for (size_t k = 0; k < sizeof bad / sizeof *bad; k++) {
        r = run("precompute %s --budget %s", scene, bad[k]);
        assert_int_not_equal(r.status, 0);
        assert_non_null(strstr(r.error, "--budget"));
        program_clear(&r);
    }
}

/// A star of 86 corners, whose arms twice the spacing cannot follow: the file's own triangles stay.
static void write_star(const char *path) {
    enum { RINGS = 7, AROUND = 12 };
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    (void)fprintf(f, "v 0 0 0.03\nv 0 0 -0.03\n");
    for (int i = 0; i < RINGS; i++) {
        for (int j = 0; j < AROUND; j++) {
            double t = acos(-1.0) * (i + 1) / (RINGS + 1), p = acos(-1.0) * 2.0 * j / AROUND;
            double r = 0.03 * (1.0 + 0.3 * sin(t) * sin(t) * cos(4.0 * p));
            (void)fprintf(f, "v %.6g %.6g %.6g\n", r * sin(t) * cos(p), r * sin(t) * sin(p),
                          r * cos(t));
        }
    }
    for (int j = 0; j < AROUND; j++) {
        int a = 3 + j, b = 3 + (j + 1) % AROUND, last = (RINGS - 1) * AROUND;
        (void)fprintf(f, "f 1 %d %d\nf 2 %d %d\n", a, b, b + last, a + last);
        for (int i = 0; i + 1 < RINGS; i++, a += AROUND, b += AROUND) {
            (void)fprintf(f, "f %d %d %d\nf %d %d %d\n", a, a + AROUND, b + AROUND, a, b + AROUND,
                          b);
        }
    }
    assert_int_equal(fclose(f), 0);
}

static void pilots_that_are_no_coarser_are_replaced_by_finer_ones(void **state) {
    (void)state;
    char star[160];
    (void)snprintf(star, sizeof star, "%s.obj", plain);
    write_star(star);
    program_result r = run("precompute %s --budget 1MB --json --quiet --set body.spacing=0.016 "
                           "--set 'body.geometry={file: %s, scale: 1}' "
                           "--set 'body.fixed=[{below: {z: -0.01}}]' "
                           "--set 'body.touchable=[{above: {z: 0.01}}]' "
                           "--set 'tools.probe.start=[0, 0, 0.04]' -o %s",
                           plain, star, model);
    assert_int_equal(r.status, 0);
    json_t *pilots = json_object_get(json_object_get(r.json, "budget"), "pilots");
    assert_true(json_array_size(pilots) >= 2);
    // at 2 and 1.26 times its spacing the star has its own 86 corners and as many nodes within
    double coarse = program_number(json_array_get(pilots, 0), "nodes");
    double fine = program_number(json_array_get(pilots, 1), "nodes");
    assert_true(program_number(json_array_get(pilots, 0), "spacing_factor") == 1.26);
    assert_true(program_number(json_array_get(pilots, 1), "spacing_factor") == 0.8);
    assert_true(coarse < 0.8 * fine);
    program_clear(&r);
    (void)unlink(star);
}

static void the_field_is_predicted_from_measured_bytes(void **state) {
    (void)state;
    pal_cost_machine machine;
    assert_int_equal(pal_cost_measure(&machine, NULL), PALPATE_OK);
    for (int p = 0; p < 4; p++) {
        for (int k = 0; k < PALPATE_COST_SIZES; k++) {
            assert_true(machine.per_byte[p][k] > 0.0 && isfinite(machine.per_byte[p][k]));
        }
        // at a measured size the prediction is the measurement; more bytes always take longer
        double rows = machine.bytes[2] / 9.0 / 8.0 / (p == 0 ? 8.0 : p == 1 ? 4.0 : 2.0);
        double at = pal_cost_field(&machine, (pal_precision)p, 8.0, rows);
        assert_true(fabs(at - machine.bytes[2] * machine.per_byte[p][2]) < 1e-6 * at);
        assert_true(pal_cost_field(&machine, (pal_precision)p, 8.0, 0.0) == 0.0);
        assert_true(pal_cost_field(&machine, (pal_precision)p, 800.0, 1e5) > at);
    }
}

static void ticks_are_counted_with_contact_only(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    p.n = 9;
    pal_model *half_space = synthetic_model(&p);
    assert_non_null(half_space);
    pal_cost_ticks own, wide;
    assert_int_equal(pal_cost_of_ticks(half_space, 1.0, 1, &own, NULL), PALPATE_OK);
    assert_int_equal(pal_cost_of_ticks(half_space, 4.0, 1, &wide, NULL), PALPATE_OK);
    assert_true(own.ticks > 100 && own.contacts >= 1.0 && own.most >= own.contacts);
    assert_true(wide.most > own.most); // a wider tool touches more
    assert_true(own.tick_us.p50 >= own.force_us.p50);
    pal_model_free(half_space);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(bytes_are_kept_to_and_more_bytes_buy_a_finer_model),
        cmocka_unit_test(an_error_is_met_by_the_models_own_estimate),
        cmocka_unit_test(a_time_budget_of_no_concern_is_met_and_said),
        cmocka_unit_test(what_nothing_meets_is_refused),
        cmocka_unit_test(pilots_that_are_no_coarser_are_replaced_by_finer_ones),
        cmocka_unit_test(the_field_is_predicted_from_measured_bytes),
        cmocka_unit_test(ticks_are_counted_with_contact_only),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
