/// Paper 1's hemisphere against the converged reference
/// (../shared/reference/hemisphere_patch.json): force and displacements of the bonded cap over five
/// clouds of 900 to 1600 nodes and one that is the same body as a rotated surface, convergence over
/// three rim spacings, and what point collocation gives.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "tests/support/program.h"

static const double R = 0.05;
static json_t *reference;
static char scene[64];

/// The scene with every spacing scaled by `factor` and a probe at each point of the reference.
static void write_scene(double nu, double spacing, double rim, const json_t *material) {
    FILE *f = fopen(scene, "w");
    assert_non_null(f);
    fprintf(f,
            "palpate: 1\nbody:\n  geometry: {hemisphere: {radius: %g}}\n  spacing: %.9g\n"
            "  material: {young: 1e4, poisson: %g}\n  fixed: [{below: {z: 0}}]\n"
            "  touchable: [{ball: {center: [0, 0, %g], radius: 0.012}}]\n"
            "  patches: {pole: {ball: {center: [0, 0, %g], radius: %.12g}, rim_spacing: %.9g}}\n  "
            "probes:\n",
            R, spacing, nu, R, R, 2 * R * sin(0.1), rim);
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(material, "dome"), key, value) {
        double a = atof(key);
        fprintf(f, "    dome_%.0f: [%.12g, 0, %.12g]\n", 100 * a, R * sin(a), R * cos(a));
    }
    json_object_foreach(json_object_get(material, "axis"), key, value) {
        fprintf(f, "    axis_%.0f: [0, 0, %.12g]\n", 100 * atof(key), R * atof(key));
    }
    fprintf(f, "store: {displacement: none}\n");
    fclose(f);
}

static json_t *material_of(const char *nu) {
    return json_object_get(json_object_get(reference, "poisson"), nu);
}

/// Worst distance of the probes from the reference, relative to the pressed displacement.
static double probe_error(const json_t *press, const json_t *material) {
    double worst = 0;
    const char *key;
    json_t *value;
    char path[64];
    json_object_foreach(json_object_get(material, "dome"), key, value) {
        double u[3];
        for (int d = 0; d < 3; d++) {
            (void)snprintf(path, sizeof path, "probes.dome_%.0f.%d", 100 * atof(key), d);
            u[d] = program_number(press, path);
        }
        worst = fmax(worst, hypot(hypot(u[0] - json_number_value(json_array_get(value, 0)), u[1]),
                                  u[2] - json_number_value(json_array_get(value, 1))));
    }
    json_object_foreach(json_object_get(material, "axis"), key, value) {
        (void)snprintf(path, sizeof path, "probes.axis_%.0f.2", 100 * atof(key));
        worst = fmax(worst, fabs(program_number(press, path) - json_number_value(value)));
    }
    return worst / 0.005;
}

static program_result press(const char *set) {
    char arguments[512];
    (void)snprintf(arguments, sizeof arguments, "press %s --patch pole --by 0,0,-0.005 --json %s",
                   scene, set);
    program_result r = program_run(arguments);
    if (r.status != 0) {
        fail_msg("%s: %s", arguments, r.error);
    }
    return r;
}

static void five_clouds_agree_with_the_reference(void **state) {
    (void)state;
    if (reference == NULL) {
        skip();
    }
    static const char *const nus[] = {"0.30", "0.45"};
    static const double factors[] = {0.9, 0.95, 1.0, 1.05, 1.1};
    for (int n = 0; n < 2; n++) {
        json_t *material = material_of(nus[n]);
        double exact = json_number_value(json_object_get(material, "force_z"));
        for (int k = 0; k < 5; k++) {
            write_scene(atof(nus[n]), 0.0095 * factors[k], 0.00075 * factors[k], material);
            program_result r = press("");
            double f[3] = {program_number(r.json, "force.0"), program_number(r.json, "force.1"),
                           program_number(r.json, "force.2")};
            double nodes = program_number(r.json, "nodes"), probes = probe_error(r.json, material);
            print_message(
                "# nu %s spacing x %.2f: %4.0f nodes, F_z %.4f N (%+.2f %%), probes %.2f %%\n",
                nus[n], factors[k], nodes, f[2], 100 * (f[2] / exact - 1), 100 * probes);
            assert_true(nodes >= 900 && nodes <= 1600);
            // the issue allows 4 %; measured within 1.3 %: 2 % says that something got worse
            assert_true(fabs(f[2] / exact - 1) < 0.02);
            assert_true(fabs(f[0]) < 0.01 * fabs(f[2]) && fabs(f[1]) < 0.01 * fabs(f[2]));
            assert_true(probes < 0.05);
            assert_true(program_number(r.json, "certificate.pass") == 1);
            program_clear(&r);
        }
    }
}

static void force_falls_monotonically_as_the_rim_is_refined(void **state) {
    (void)state;
    if (reference == NULL) {
        skip();
    }
    // a coarse rim reaches too far out, so the cap is stiffer; refining it alone, the force falls
    // towards the value of that interior cloud in ever smaller steps
    json_t *material = material_of("0.30");
    double exact = json_number_value(json_object_get(material, "force_z")), force[3];
    static const double rim[] = {0.0028, 0.0014, 0.0007};
    for (int k = 0; k < 3; k++) {
        write_scene(0.3, 0.0095, rim[k], material);
        program_result r = press("");
        force[k] = fabs(program_number(r.json, "force.2"));
        print_message("# rim %.1f mm: %.0f nodes, |F_z| %.4f N (%+.2f %%)\n", 1e3 * rim[k],
                      program_number(r.json, "nodes"), force[k],
                      100 * (force[k] / fabs(exact) - 1));
        // measured +3.6 %, +1.1 %, +0.7 %: the coarse rim is a quarter of the patch's radius
        assert_true(fabs(force[k] - fabs(exact)) < 0.05 * fabs(exact));
        program_clear(&r);
    }
    assert_true(force[0] > force[1] && force[1] > force[2]);
    assert_true(force[1] - force[2] < force[0] - force[1]);
}

static void point_collocation_is_reported_as_it_is(void **state) {
    (void)state;
    if (reference == NULL) {
        skip();
    }
    json_t *material = material_of("0.30");
    write_scene(0.3, 0.012, 0.0015, material);
    static const char *const basis[] = {"linear", "quadratic"};
    for (int k = 0; k < 2; k++) {
        char set[128];
        (void)snprintf(set, sizeof set, "--set method.kind=point --set method.basis=%s", basis[k]);
        program_result r = press(set);
        print_message("# point, %s: F_z %.3f N, reciprocity %.2f, certificate %s\n", basis[k],
                      program_number(r.json, "force.2"),
                      program_number(r.json, "certificate.reciprocity"),
                      program_number(r.json, "certificate.pass") == 1 ? "passes" : "does not pass");
        // whatever the force: it is a number, and the certificate knows it is not reciprocal
        assert_true(isfinite(program_number(r.json, "force.2")));
        assert_true(program_number(r.json, "certificate.reciprocity") > 0.05);
        if (program_number(r.json, "certificate.pass") != 1) {
            assert_non_null(strstr(r.error, "certificate"));
        }
        program_clear(&r);
    }
}

static int setup(void **state) {
    (void)state;
    char path[512];
    (void)snprintf(path, sizeof path, "%s/../shared/reference/hemisphere_patch.json",
                   program_source());
    reference = json_load_file(path, 0, NULL);
    (void)snprintf(scene, sizeof scene, "/tmp/palpate-hemisphere-%ld.yaml", (long)getpid());
    return 0;
}

static int teardown(void **state) {
    (void)state;
    json_decref(reference);
    (void)unlink(scene);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(five_clouds_agree_with_the_reference),
        cmocka_unit_test(force_falls_monotonically_as_the_rim_is_refined),
        cmocka_unit_test(point_collocation_is_reported_as_it_is),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
