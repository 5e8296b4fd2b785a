/// `palpate indent` on scenes/block.yaml against the finite-element table of the same problem
/// (../shared/reference/sphere_on_block.json), against Hertz for other radii and materials, what
/// must hold for any contact, and its refusals.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/program.h"

static program_result indent(const char *arguments) {
    char all[1024];
    (void)snprintf(all, sizeof all, "indent %s/scenes/block.yaml --tool ball --json %s",
                   program_source(), arguments);
    return program_run(all);
}

static program_result indent_well(const char *arguments) {
    program_result r = indent(arguments);
    if (r.status != 0 || r.json == NULL) {
        fail_msg("%s: %s", arguments, r.error);
    }
    return r;
}

static double at(const program_result *r, int depth, const char *key) {
    char path[64];
    (void)snprintf(path, sizeof path, "curve.%d.%s", depth, key);
    return program_number(r->json, path);
}

/// Hertz: F = 4/3 E* sqrt(R) d^1.5 on a half space (Aras et al. 2014, Eq. 13).
static double hertz(double young, double nu, double radius, double depth) {
    return 4.0 / 3 * young / (1 - nu * nu) * sqrt(radius) * pow(depth, 1.5);
}

static void sphere_on_block_follows_the_table(void **state) {
    (void)state;
    char path[512];
    (void)snprintf(path, sizeof path, "%s/../shared/reference/sphere_on_block.json",
                   program_source());
    json_t *reference = json_load_file(path, 0, NULL);
    if (reference == NULL) {
        print_message("no %s\n", path);
        skip();
    }
    program_result r = indent_well("--depths 0.02,0.05,0.1,0.15,0.2");
    print_message("  %.0f nodes\n", program_number(r.json, "nodes"));
    assert_true(program_number(r.json, "nodes") < 1300);
    json_t *row;
    size_t i;
    json_array_foreach(json_object_get(reference, "curve"), i, row) {
        int k = (int)i;
        double force = program_number(row, "force"), radius = program_number(row, "contact_radius");
        double error = at(&r, k, "force") / force - 1, off = at(&r, k, "radius") - radius;
        // the scene's spacing at the edge of contact: 0.04 to r = 0.15, then growing by 0.45, 0.09
        // at most up to 0.45
        double spacing = 0.04 + 0.45 * fmax(0, radius - 0.15);
        spacing = fmin(spacing, 0.09 + 0.45 * fmax(0, radius - 0.45));
        print_message("  depth %.2f: force %8.2f N, FE %8.2f (%+.1f %%), Hertz %+.1f %%; radius "
                      "%.3f, FE %.3f "
                      "(%+.2f spacings), %.0f nodes\n",
                      at(&r, k, "depth"), at(&r, k, "force"), force, 100 * error,
                      100 * (at(&r, k, "force") / program_number(row, "hertz") - 1),
                      at(&r, k, "radius"), radius, off / spacing, at(&r, k, "contacts"));
        assert_true(fabs(error) < 0.015); // issue 5 asks for 0.03; 0.01 is reached
        assert_true(fabs(off) < spacing); // issue 5
        assert_true(at(&r, k, "force") >
                    program_number(row, "hertz") * 0.97); // the block is stiffer
    }
    assert_int_equal(json_array_size(json_object_get(r.json, "curve")), i);
    program_clear(&r);
    json_decref(reference);
}

/// Radii and materials without a table: the finite block exceeds Hertz by a few per cent that grow
/// with the contact radius (10 % at 0.146 m, 17 % at 0.235 m in the table for nu = 0.3); the cloud
/// may add 3 %.
static void other_radii_and_materials_follow_hertz(void **state) {
    (void)state;
    const struct {
        double radius, nu, depth;
    } cases[] = {
        {0.5, 0.3, 0.04}, {2, 0.3, 0.02}, {1, 0.1, 0.04}, {1, 0.45, 0.02}, {0.4, 0.49, 0.05}};
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        char set[256];
        double R = cases[i].radius, d = cases[i].depth;
        (void)snprintf(
            set, sizeof set,
            "--depths %g --set tools.0.shape.sphere.radius=%g --set tools.0.start=[0,0,%g] "
            "--set body.material.poisson=%g",
            d, R, R, cases[i].nu);
        program_result r = indent_well(set);
        double ratio = at(&r, 0, "force") / hertz(1e4, cases[i].nu, R, d);
        print_message("  R %.1f, nu %.2f, depth %.2f: %.3f of Hertz\n", R, cases[i].nu, d, ratio);
        // excess over Hertz: 0.10 at a = 0.146 m in the table, in proportion to a; more when nearly
        // incompressible, as the clamped sides hold the volume: at nu = 0.49 the methods cell and
        // galerkin on finer clouds tend to 1.234 (1.251, 1.243, 1.239 and 1.240, 1.234, 1.234 at
        // spacings x 1, 0.72, 0.55)
        double nu = cases[i].nu, excess = 0.7 * sqrt(R * d) *
                                          (nu > 0.47  ? 2.36
                                           : nu > 0.4 ? 1.8
                                                      : 1);
        assert_true(fabs(ratio / (1 + excess) - 1) < 0.03);
        program_clear(&r);
    }
}

/// Contact small against the block and of a few spacings: Hertz's closed form, no table. The block
/// is 0.7 % stiffer than the half-space at a = 0.01 m (0.10 at 0.146 m, in proportion).
static void small_contact_is_hertz(void **state) {
    (void)state;
    const double nu[] = {0.0, 0.45};
    for (int i = 0; i < 2; i++) {
        char set[512];
        (void)snprintf(
            set, sizeof set,
            "--depths 0.002 --set tools.0.shape.sphere.radius=0.05 --set tools.0.start=[0,0,0.05] "
            "--set body.material.poisson=%g --set 'body.touchable=[{ball: {center: [0,0,0], "
            "radius: 0.02}}]' "
            "--set 'body.refine=[{center: [0,0,0], radius: 0.013, spacing: 0.003}]'",
            nu[i]);
        program_result r = indent_well(set);
        double ratio = at(&r, 0, "force") / hertz(1e4, nu[i], 0.05, 0.002),
               radius = at(&r, 0, "radius");
        print_message("  nu %.2f: %.4f of Hertz, radius %.4f of 0.0100\n", nu[i], ratio, radius);
        assert_true(fabs(ratio - 1.007) <
                    0.03); // issue 5's accuracy; 0.985 to 1.008 over four clouds
        assert_true(fabs(radius - 0.01) < 0.003); // one spacing
        program_clear(&r);
    }
}

static void force_is_linear_in_young_and_even_in_order(void **state) {
    (void)state;
    program_result a = indent_well("--depths 0,0.03,0.1");
    program_result b = indent_well("--depths 0.1,0.03,0 --set body.material.young=2e4");
    assert_true(at(&a, 0, "force") == 0 && at(&a, 0, "contacts") == 0 && at(&a, 0, "radius") == 0);
    for (int i = 0; i < 3; i++) {
        // rounding only: the same problem in other units, reached from another depth
        assert_true(fabs(at(&b, 2 - i, "force") - 2 * at(&a, i, "force")) <=
                    1e-9 * at(&b, 2 - i, "force"));
        assert_true(at(&b, 2 - i, "contacts") == at(&a, i, "contacts"));
    }
    // along the axis, as contact is: nothing sideways, down
    assert_true(program_number(a.json, "curve.2.force_vector.0") == 0);
    assert_true(program_number(a.json, "curve.2.force_vector.2") < 0);
    program_clear(&a);
    program_clear(&b);
}

/// A capsule stands on its tip: a sphere with a shaft above it.
static void capsule_end_is_a_sphere(void **state) {
    (void)state;
    program_result a = indent_well("--depths 0.05,0.1");
    program_result b =
        indent_well("--depths 0.05,0.1 --set 'tools.0.shape={capsule: {radius: 1, length: 0.5}}' "
                    "--set tools.0.start=[0,0,1.25]");
    for (int i = 0; i < 2; i++) {
        assert_true(fabs(at(&a, i, "force") - at(&b, i, "force")) < 1e-9 * at(&a, i, "force"));
    }
    program_clear(&a);
    program_clear(&b);
}

/// A point meets the surface on its axis, linear in depth; a needle thinner than the spacing alike.
static void point_is_linear(void **state) {
    (void)state;
    program_result r = indent_well(
        "--depths 0.01,0.02 --set 'tools.0.shape=point' --set tools.0.start=[0.013,0.021,0]");
    assert_true(at(&r, 0, "contacts") == 1 && at(&r, 0, "force") > 0);
    assert_true(fabs(at(&r, 1, "force") - 2 * at(&r, 0, "force")) < 1e-12 * at(&r, 1, "force"));
    assert_true(json_array_size(json_object_get(r.json, "warnings")) >
                0); // it depends on the spacing
    program_clear(&r);
}

/// Contact normals of the sphere on the deformed shape: the same as depth goes to zero. Under a
/// frictionless sphere the surface moves inwards, by about (1 - 2 nu) / (2 (1 - nu)) of a^2 / R, to
/// where the sphere is deeper: stiffer, in proportion to a / R = sqrt(depth / R), and hardly when
/// nearly incompressible. No net force sideways on a centred sphere.
static void full_law_tends_to_the_linear_one(void **state) {
    (void)state;
    const char *depths = "--depths 0.01,0.05,0.2";
    char full[64];
    (void)snprintf(full, sizeof full, "%s --contact full", depths);
    program_result a = indent_well(depths), b = indent_well(full);
    double before = 0;
    for (int i = 0; i < 3; i++) {
        double change = at(&b, i, "force") / at(&a, i, "force") - 1, side = 0;
        char path[64];
        for (int k = 0; k < 2; k++) {
            (void)snprintf(path, sizeof path, "curve.%d.force_vector.%d", i, k);
            side = fmax(side, fabs(program_number(b.json, path)));
        }
        print_message("  depth %.2f: full law %+.2f %%\n", at(&a, i, "depth"), 100 * change);
        assert_true(change > before);
        assert_true(change < 0.29 * sqrt(at(&a, i, "depth"))); // (1 - 2 nu) / (2 (1 - nu)), R = 1 m
        assert_true(side < 0.02 * at(&b, i, "force"));
        before = change;
    }
    assert_string_equal(json_string_value(json_object_get(b.json, "contact")), "full");
    double compressible = at(&b, 0, "force") / at(&a, 0, "force") - 1;
    program_clear(&a);
    program_clear(&b);
    a = indent_well("--depths 0.01 --set body.material.poisson=0.49");
    b = indent_well("--depths 0.01 --contact full --set body.material.poisson=0.49");
    double nearly = at(&b, 0, "force") / at(&a, 0, "force") - 1;
    print_message("  depth 0.01, nu 0.49: full law %+.2f %%\n", 100 * nearly);
    assert_true(fabs(nearly) < 0.5 * compressible);
    program_clear(&a);
    program_clear(&b);
}

/// A raw, nonsymmetric block: the contact problem with a skew part.
static void raw_model_differs_little(void **state) {
    (void)state;
    const char *base = "--depths 0.05,0.2 --set method.form=collocated";
    char raw[128];
    (void)snprintf(raw, sizeof raw, "%s --set repair=none", base);
    program_result a = indent_well(base), b = indent_well(raw);
    assert_true(program_number(b.json, "certificate.reciprocity") > 1e-3); // it is skew indeed
    for (int i = 0; i < 2; i++) {
        double change = at(&b, i, "force") / at(&a, i, "force") - 1;
        print_message("  depth %.2f: raw %+.2f %%\n", at(&a, i, "depth"), 100 * change);
        assert_true(fabs(change) > 1e-6 && fabs(change) < 0.02); // design section 1: 0.1 to 0.7 %
        assert_true(json_is_false(json_object_get(
            json_array_get(json_object_get(b.json, "curve"), (size_t)i), "cut_off")));
    }
    program_clear(&a);
    program_clear(&b);
}

static void refuses(void **state) {
    (void)state;
    const struct {
        const char *arguments, *message;
    } cases[] = {
        {"--depths 0.01 --tool nose", "there is no such tool; the tools are: ball"},
        {"--depths -0.01", "numbers of 0 or more"},
        {"--depths 0.01,", "numbers of 0 or more"},
        {"--depths nan", "numbers of 0 or more"},
        {"--depths 0.01 --contact soft", "rest or full"},
        {"", "give --tool and --depths"},
        {"--depths 0.01 --set tools.0.start=null", "needs its start"},
        {"--depths 0.01 --set tools.0.start=[5,5,1]", "meets no touchable place"},
        {"--depths 0.01 --set tools.0.shape=point --contact full", "no surface to slide on"},
    };
    for (size_t i = 0; i < sizeof cases / sizeof *cases; i++) {
        program_result r = indent(cases[i].arguments);
        if (r.status == 0 || strstr(r.error, cases[i].message) == NULL) {
            fail_msg("%s: status %d: %s", cases[i].arguments, r.status, r.error);
        }
        program_clear(&r);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sphere_on_block_follows_the_table),
        cmocka_unit_test(other_radii_and_materials_follow_hertz),
        cmocka_unit_test(small_contact_is_hertz),
        cmocka_unit_test(force_is_linear_in_young_and_even_in_order),
        cmocka_unit_test(capsule_end_is_a_sphere),
        cmocka_unit_test(point_is_linear),
        cmocka_unit_test(full_law_tends_to_the_linear_one),
        cmocka_unit_test(raw_model_differs_little),
        cmocka_unit_test(refuses),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
