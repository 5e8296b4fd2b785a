/// Extremes through the library, scene text to certified model (issue 4, part 7): each works within
/// a stated tolerance or is refused with a message; none crashes, none gives a number that is none.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <palpate/precompute.h>

#include "haptic/model/model.h"
#include "tests/support/scene_text.h"

static const char *const KINDS[] = {"method.kind=cell", "method.kind=galerkin",
                                    "method.kind=point"};
enum { CELL, GALERKIN, POINT, KIND_COUNT };

/// A unit cube held at its base; the patch is its whole top.
static const char CUBE[] =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {box: {size: [1, 1, 1]}}\n"
    "  spacing: 0.25\n"
    "  material: {young: 1, poisson: 0.3}\n"
    "  fixed: [{below: {z: -0.5}}]\n"
    "  patches: {top: {box: {min: [-1, -1, 0.5], max: [1, 1, 0.5]}, rim_spacing: none}}\n"
    "  probes: {mid: [0, 0, 0]}\n"
    "certify: warn\n"
    "store: {displacement: surface, precision: double}\n";

static pal_status build(const char *text, const char *const set[], pal_model **m,
                        pal_error *error) {
    pal_scene *scene = NULL;
    *m = NULL;
    memset(error, 0, sizeof *error);
    pal_status status = test_scene_load(text, set, &scene, error);
    if (status == PALPATE_OK) {
        status = pal_precompute(scene, NULL, m, error);
    }
    pal_scene_free(scene);
    if (status != PALPATE_OK) { // every refusal says something
        assert_true(strlen(error->message) > 20);
    }
    return status;
}

/// Everything finite, also what is computed from the blocks. @return force of the patch's press
static double check(const pal_model *m, const char *patch, const double by[3]) {
    pal_press p;
    pal_error error = {0};
    assert_int_equal(pal_model_check(m, &error), PALPATE_OK);
    int64_t t = 3 * (int64_t)m->info.column_count;
    for (int64_t i = 0; i < t * t; i++) {
        assert_true(isfinite(m->c_tt[i]));
    }
    if (patch == NULL) {
        return 0.0;
    }
    if (pal_model_press(m, patch, by, &p, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    double force = 0.0;
    for (int d = 0; d < 3; d++) {
        assert_true(isfinite(p.force[d]) && isfinite(p.moment[d]));
        force += p.force[d] * by[d];
    }
    for (int64_t i = 0; i < 3 * (int64_t)m->info.row_count; i++) {
        assert_true(isfinite(p.displacement[i]));
    }
    pal_press_clear(&p);
    return force / sqrt(by[0] * by[0] + by[1] * by[1] + by[2] * by[2]);
}

static pal_model *must(const char *text, const char *const set[]) {
    pal_model *m;
    pal_error error;
    if (build(text, set, &m, &error) != PALPATE_OK) {
        fail_msg("%s: %s", set != NULL && set[0] != NULL ? set[0] : "", error.message);
    }
    return m;
}

/// Poisson's ratios over the whole range: stiffness of a clamped cube's bonded top, against the
/// confined modulus as an upper bound and E A / h as a lower one (nu >= 0: clamping only stiffens).
static void every_poisson_ratio_works(void **state) {
    (void)state;
    static const char *const ratios[] = {"-0.5", "0", "0.3", "0.45", "0.49", "0.499", "0.4999"};
    const double by[3] = {0, 0, -0.01};
    for (int k = 0; k < POINT; k++) {
        double last = 0.0;
        for (int i = 0; i < 7; i++) {
            char poisson[60];
            (void)snprintf(poisson, sizeof poisson, "body.material.poisson=%s", ratios[i]);
            pal_model *m = must(CUBE, (const char *const[]){KINDS[k], poisson, NULL});
            double nu = strtod(ratios[i], NULL), force = check(m, "top", by) / 0.01;
            double confined = (1 - nu) / ((1 + nu) * (1 - 2 * nu));
            assert_true(force > 0.97 && force < 1.05 * confined); // E A / h = 1; 5 %: coarse cloud
            assert_int_equal(m->info.certificate.pass, 1);
            assert_int_equal(m->info.certificate.passive, 1);
            // stiffness grows with nu in [0, 0.5) and does not lock: bonded incompressible cubes
            // are at most twice as stiff as free ones
            assert_true(nu <= 0.0 || force > last);
            assert_true(force < 2.0);
            last = force;
            print_message("%s nu %s: %.4f\n", KINDS[k], ratios[i], force);
            pal_model_free(m);
        }
    }
    // point collocation is not passive everywhere: it says so or passes, but its numbers are
    // numbers
    for (int i = 0; i < 7; i++) {
        char poisson[60];
        (void)snprintf(poisson, sizeof poisson, "body.material.poisson=%s", ratios[i]);
        pal_model *m = must(CUBE, (const char *const[]){KINDS[POINT], poisson, NULL});
        (void)check(m, NULL, by);
        assert_int_equal(m->info.certificate.pass, m->info.certificate.reason[0] == '\0');
        pal_model_free(m);
    }
}

static void impossible_materials_are_refused(void **state) {
    (void)state;
    static const char *const bad[] = {"body.material.poisson=0.5",  "body.material.poisson=0.6",
                                      "body.material.poisson=-1",   "body.material.young=0",
                                      "body.material.young=-1",     "body.material.young=.inf",
                                      "body.material.poisson=.nan", "body.material.young=1e400"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        pal_model *m;
        pal_error error;
        assert_int_equal(build(CUBE, (const char *const[]){bad[i], NULL}, &m, &error),
                         PALPATE_ERROR_SCENE);
        assert_null(m);
        assert_non_null(strstr(error.message, "body.material."));
    }
}

static void stiffness_and_size_scale_out(void **state) {
    (void)state;
    static const double young[] = {1e-3, 1e15}, sizes[] = {1e-6, 1e3};
    const double by[3] = {0.001, 0, -0.01};
    pal_model *m = must(CUBE, NULL);
    double reference = check(m, "top", by);
    pal_model_free(m);
    for (int v = 0; v < 4; v++) {
        double e = young[v / 2], s = sizes[v % 2];
        char text[1000];
        (void)snprintf(
            text, sizeof text,
            "palpate: 1\nbody:\n"
            "  geometry: {box: {size: [%g, %g, %g]}}\n  spacing: %g\n"
            "  material: {young: %g, poisson: 0.3}\n  fixed: [{below: {z: %g}}]\n"
            "  patches: {top: {box: {min: [%g, %g, %g], max: [%g, %g, %g]}, rim_spacing: none}}\n"
            "store: {displacement: surface, precision: half}\n",
            s, s, s, 0.25 * s, e, -0.5 * s, -s, -s, 0.5 * s, s, s, 0.5 * s);
        m = must(text, NULL);
        double force = check(m, "top", (const double[3]){s * by[0], s * by[1], s * by[2]});
        assert_true(fabs(force / (e * s * s) / reference - 1.0) < 1e-8);
        pal_model_free(m);
    }
}

/// One node: a 3 x 3 block, positive; all surface nodes: every free one, positive with them all.
static void one_touchable_node_and_all_of_them(void **state) {
    (void)state;
    for (int k = 0; k < KIND_COUNT; k++) {
        pal_model *one = must(
            CUBE, (const char *const[]){
                      KINDS[k], "body.patches={}",
                      "body.touchable=[{ball: {center: [0.5, 0.5, 0.5], radius: 0.01}}]", NULL});
        pal_model *all = must(CUBE, (const char *const[]){KINDS[k], "body.patches={}", NULL});
        assert_int_equal(one->info.column_count, 1);
        assert_int_equal(all->info.column_count, all->info.surface_count - all->info.fixed_count);
        (void)check(one, NULL, NULL);
        (void)check(all, NULL, NULL);
        int32_t j = 0;
        while (all->column_node[j] != one->column_node[0]) {
            j++;
        }
        int64_t t = 3 * (int64_t)all->info.column_count;
        for (int c = 0; c < 3; c++) { // the same block, whoever else is there
            for (int d = 0; d < 3; d++) {
                double a = one->c_tt[3 * c + d], b = all->c_tt[(3 * j + c) * t + 3 * j + d];
                assert_true(fabs(a - b) <= 1e-12 * fabs(one->c_tt[0]));
            }
        }
        assert_true(k == POINT || (one->info.certificate.passive && all->info.certificate.passive));
        pal_model_free(one);
        pal_model_free(all);
    }
}

/// A needle 20 x 1 x 1 held at one end, the other pulled and shifted: beam theory; a plate 6 x 6 x
/// 0.5 held at one edge, the opposite one lifted.
static void needles_and_plates(void **state) {
    (void)state;
    static const char needle[] =
        "palpate: 1\nbody:\n  geometry: {box: {size: [20, 1, 1]}}\n  spacing: 0.4\n"
        "  material: {young: 1, poisson: 0.3}\n  fixed: [{below: {x: -10}}]\n"
        "  touchable: [{above: {x: 10}}]\n"
        "  patches: {tip: {box: {min: [10, -1, -1], max: [10, 1, 1]}, rim_spacing: none}}\n"
        "store: {displacement: none}\n";
    static const char plate[] =
        "palpate: 1\nbody:\n  geometry: {box: {size: [6, 6, 0.5]}}\n  spacing: 0.3\n"
        "  material: {young: 1, poisson: 0.3}\n  fixed: [{below: {x: -3}}]\n"
        "  touchable: [{above: {x: 3}}]\n"
        "  patches: {edge: {box: {min: [3, -4, -1], max: [3, 4, 1]}, rim_spacing: none}}\n"
        "store: {displacement: none}\n";
    for (int k = 0; k < POINT; k++) {
        pal_model *m = must(needle, (const char *const[]){KINDS[k], NULL});
        // pulled by 0.01: E A / L; the tip's end held flat: 12 E I / L^3 (with shear: L^2/12I +
        // 6/5/G)
        double pull = check(m, "tip", (const double[3]){0.01, 0, 0}) / 0.01;
        double bend = check(m, "tip", (const double[3]){0, 0, 0.01}) / 0.01;
        double want = 1.0 / (20.0 * 20.0 * 20.0 + 20.0 * 1.2 * 2.6);
        print_message("%s needle: %d nodes, pull %.4f, bend %.4f of theory, rcond %.1e, %s\n",
                      KINDS[k], (int)m->info.node_count, pull * 20.0, bend / want,
                      m->info.certificate.rcond, m->info.certificate.reason);
        assert_int_equal(m->info.certificate.pass, 1);
        assert_true(fabs(pull * 20.0 - 1.0) < 0.03); // clamped ends: 1 to 2 %
        assert_true(fabs(bend / want - 1.0) < 0.15); // two to three nodes across
        pal_model_free(m);
        m = must(plate, (const char *const[]){KINDS[k], NULL});
        double lift = check(m, "edge", (const double[3]){0, 0, 0.01}) / 0.01;
        // a beam clamped at both ends, with shear: L^3 / 12 E I + 6 L / 5 G A
        want = 1.0 / (6.0 * 6.0 * 6.0 / (6.0 * 0.125) + 1.2 * 6.0 * 2.6 / 3.0);
        print_message("%s plate: %d nodes, bend %.4f of a beam, rcond %.1e, %s\n", KINDS[k],
                      (int)m->info.node_count, lift / want, m->info.certificate.rcond,
                      m->info.certificate.reason);
        // a plate lies between a beam and plane strain, 1 / (1 - nu^2) = 1.1; 7 % for two cells
        // through its thickness, which averaged strains see softer and plain ones stiffer
        assert_true(lift > 0.93 * want && lift < 1.1 * 1.07 * want);
        assert_int_equal(m->info.certificate.pass, 1);
        pal_model_free(m);
    }
}

static void held_at_three_nodes_or_not_enough(void **state) {
    (void)state;
    static const char *const three =
        "body.fixed=[{ball: {center: [-0.5, -0.5, -0.5], radius: 0.01}}, "
        "{ball: {center: [0.5, -0.5, -0.5], radius: 0.01}}, "
        "{ball: {center: [-0.5, 0.5, -0.5], radius: 0.01}}]";
    static const char *const loose[] = {
        "body.fixed=[{ball: {center: [-0.5, -0.5, -0.5], radius: 0.01}}]",
        "body.fixed=[{ball: {center: [-0.5, -0.5, -0.5], radius: 0.01}}, "
        "{ball: {center: [0.5, -0.5, -0.5], radius: 0.01}}]",
        "body.fixed=[{box: {min: [-0.5, -0.5, -0.5], max: [0.5, -0.5, -0.5]}}]", // an edge: a hinge
        "body.fixed=[{ball: {center: [5, 5, 5], radius: 0.01}}]"};
    for (int k = 0; k < KIND_COUNT; k++) {
        pal_model *m = must(CUBE, (const char *const[]){KINDS[k], three, NULL});
        assert_int_equal(m->info.fixed_count, 3);
        double force = check(m, k == POINT ? NULL : "top", (const double[3]){0, 0, -0.01});
        assert_true(k == POINT || (force > 0.0 && force < 0.01)); // softer than held at its base
        pal_model_free(m);
        for (int i = 0; i < 4; i++) {
            pal_error error;
            assert_int_equal(
                build(CUBE, (const char *const[]){KINDS[k], loose[i], NULL}, &m, &error),
                PALPATE_ERROR_SCENE);
            assert_null(m);
            assert_non_null(strstr(error.message, "body.fixed"));
        }
    }
}

/// Everything held, or everything touchable held: nothing to press.
static void nothing_left_to_touch_is_refused(void **state) {
    (void)state;
    pal_model *m;
    pal_error error;
    assert_int_equal(build(CUBE, (const char *const[]){"body.fixed=[all]", NULL}, &m, &error),
                     PALPATE_ERROR_SCENE);
    assert_null(m);
    assert_int_equal(
        build(CUBE,
              (const char *const[]){"body.patches={}", "body.touchable=[{below: {z: -0.5}}]", NULL},
              &m, &error),
        PALPATE_ERROR_SCENE);
    assert_null(m);
}

/// Supports too small to span space, and as large as the body.
static void supports_of_any_size(void **state) {
    (void)state;
    static const char *const neighbours[] = {"method.neighbours=4", "method.neighbours=10",
                                             "method.neighbours=60", "method.neighbours=120",
                                             "method.neighbours=100000"};
    static const char *const all[] = {"method.kind=point", "method={kind: cell, form: collocated}"};
    for (int k = 0; k < 2; k++) {
        int worked = 0;
        for (size_t i = 0; i < sizeof neighbours / sizeof *neighbours; i++) {
            pal_model *m;
            pal_error error;
            pal_status status =
                build(CUBE, (const char *const[]){all[k], neighbours[i], NULL}, &m, &error);
            if (status == PALPATE_OK) {
                (void)check(m, NULL, NULL);
                worked++;
            } else {
                print_message("%s %s: %s\n", all[k], neighbours[i], error.message);
                assert_null(m);
                assert_non_null(strstr(error.message, "neighbours"));
            }
            pal_model_free(m);
        }
        assert_true(worked >= 2);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_poisson_ratio_works),
        cmocka_unit_test(impossible_materials_are_refused),
        cmocka_unit_test(stiffness_and_size_scale_out),
        cmocka_unit_test(one_touchable_node_and_all_of_them),
        cmocka_unit_test(needles_and_plates),
        cmocka_unit_test(held_at_three_nodes_or_not_enough),
        cmocka_unit_test(nothing_left_to_touch_is_refused),
        cmocka_unit_test(supports_of_any_size),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
