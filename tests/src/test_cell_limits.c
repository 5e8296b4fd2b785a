/// The cell method where bodies, materials and clouds become extreme, and its refusals.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/discretization/cell_faces.h"
#include "src/discretization/cell_groups.h"
#include "src/solution/factor.h"
#include "tests/support/cell_rig.h"

static const double UNIT[3] = {1, 1, 1};
static const pal_method SYMMETRIC = {
    .kind = PALPATE_METHOD_CELL, .volumetric = PALPATE_VOLUMETRIC_PATCH, .stabilization = -1};
static const pal_method COLLOCATED = {.kind = PALPATE_METHOD_CELL,
                                      .volumetric = PALPATE_VOLUMETRIC_NODAL,
                                      .form = PALPATE_CELL_COLLOCATED,
                                      .stabilization = -1};

// ---- Near incompressibility: groups -----------------------------------------------------------

static void groups_cover_the_body_and_share_freedoms(void **state) {
    (void)state;
    pal_error e = {0};
    const int cells[3][3] = {{6, 6, 6}, {8, 8, 1}, {6, 5, 2}}; // thick, no interior, one layer
    for (int k = 0; k < 3; k++) {
        pal_cloud c;
        pal_cell_faces f;
        rig_box(&c, UNIT, cells[k][0], cells[k][1], cells[k][2], 0.2);
        assert_int_equal(pal_cell_faces_create(&c, &f, &e), PALPATE_OK);
        int32_t *group = calloc((size_t)c.node_count, sizeof *group), count = 0;
        int32_t *size = calloc((size_t)c.node_count, sizeof *size), alone = 0;
        assert_int_equal(pal_cell_groups(&c, &f, group, &count, &e), PALPATE_OK);
        for (int32_t i = 0; i < c.node_count; i++) {
            assert_in_range(group[i], 0, count - 1);
            size[group[i]]++;
        }
        for (int32_t i = 0; i < c.surface_count; i++) {
            alone += size[group[i]] == 1; // a constraint whose freedoms a tool may take away
        }
        for (int32_t g = 0; g < count; g++) {
            assert_true(size[g] > 0);
        }
        assert_int_equal(alone, 0);
        int32_t interior = c.node_count - c.surface_count;
        assert_true(interior > 0 ? count == interior : count < c.node_count / 3);
        free(size);
        free(group);
        pal_cell_faces_clear(&f);
        pal_cloud_clear(&c);
    }
}

/// Tip deflection of a cantilever L x 1 x 1 (n cells across) over that of beam theory with shear,
/// L^3 / 3 I + 6 L / 5 G (E = 1).
static double cantilever(const pal_method *method, double nu, int length, int n) {
    pal_cloud c;
    rig_box(&c, (const double[3]){length, 1, 1}, length * n, n, n, 0.1);
    double tip = rig_tip(&c, nu, method), l = length;
    pal_cloud_clear(&c);
    return tip / (4 * l * l * l + 1.2 * l * 2 * (1 + nu));
}

static void no_locking_towards_incompressibility(void **state) {
    (void)state;
    // measured with 4 cells across: 1.002 at nu = 0.3, 0.956 at 0.4999 (the clamp resists the
    // anticlastic curvature more; with 8 cells 0.961); without averaging (plain) 0.18
    const double nus[] = {0.3, 0.45, 0.49, 0.499, 0.4999};
    for (int k = 0; k < 5; k++) {
        double tip = cantilever(&SYMMETRIC, nus[k], 5, 4);
        print_message("# cantilever nu %g: %.3f of beam theory\n", nus[k], tip);
        assert_true(tip > 0.93 && tip < 1.03);
    }
    pal_method plain = SYMMETRIC;
    plain.volumetric = PALPATE_VOLUMETRIC_PLAIN;
    assert_true(cantilever(&plain, 0.4999, 5, 4) < 0.5); // the test can tell locking
}

// ---- Thin bodies
// ----------------------------------------------------------------------------------

static void needles_and_plates_bend_as_theory_says(void **state) {
    (void)state;
    const double nus[] = {0.3, 0.4999};
    for (int k = 0; k < 2; k++) {
        double nu = nus[k], needle = cantilever(&SYMMETRIC, nu, 60, 2);
        // plate 1 x 1, clamped at one side, sheared at the other: between a beam (free to curve
        // across) and cylindrical bending, 4 (1 - nu^2) / t^3
        const double t = 0.1;
        pal_cloud c;
        rig_box(&c, (const double[3]){1, 1, t}, 20, 20, 2, 0.1);
        double plate = rig_tip(&c, nu, &SYMMETRIC) / (4 / (t * t * t) + 1.2 / t * 2 * (1 + nu));
        pal_cloud_clear(&c);
        rig_box(&c, (const double[3]){1, 1, t}, 10, 10, 1, 0.1); // no interior node at all
        double shell = rig_tip(&c, nu, &SYMMETRIC) / (4 / (t * t * t) + 1.2 / t * 2 * (1 + nu));
        pal_cloud_clear(&c);
        print_message("# nu %g: needle %.3f, plate %.3f, one layer %.3f\n", nu, needle, plate,
                      shell);
        assert_true(needle > 0.9 && needle < 1.15);
        assert_true(plate > 0.95 * (1 - nu * nu) && plate < 1.15);
        assert_true(shell > 0.85 * (1 - nu * nu) && shell < 1.15);
    }
}

// ---- Bad clouds
// -----------------------------------------------------------------------------------

/// Held at three corners that are not in line: the least that holds a body.
static void three_nodes_hold_a_body(void **state) {
    (void)state;
    const double g[3][3] = {{0, 0, 0.5}, {0, 0, -0.3}, {0, 0, -0.2}}; // vanishes on z = 0
    pal_cloud c;
    rig_box(&c, UNIT, 5, 5, 5, 0.2);
    uint8_t *fixed = rig_flags(c.node_count);
    int held = 0;
    for (int32_t i = 0; i < c.surface_count; i++) {
        const double *x = &c.position[3 * i];
        int corner = x[2] < 1e-9 && (x[0] < 1e-9 || x[0] > 1 - 1e-9) && x[1] < 1e-9;
        corner |= x[2] < 1e-9 && x[0] < 1e-9 && x[1] > 1 - 1e-9;
        fixed[i] = (uint8_t)corner;
        held += corner;
    }
    assert_int_equal(held, 3);
    assert_true(rig_patch_error(&c, fixed, 0.45, &SYMMETRIC, g) < 1e-9);
    free(fixed);
    pal_cloud_clear(&c);
}

/// Linear fields stay exact on the worst clouds that have volume at all.
static void bad_clouds_keep_the_patch_test(void **state) {
    (void)state;
    const double g[3][3] = {{0, 0, 0.5}, {0, 0, -0.3}, {0, 0, -0.2}};
    const pal_method *methods[2] = {&SYMMETRIC, &COLLOCATED};
    for (int k = 0; k < 2; k++) {
        pal_cloud c;
        pal_error e = {0};
        rig_box(&c, UNIT, 6, 6, 6, k ? 0.49 : 0.0); // 1: as jittered as tetrahedra allow
        if (k == 0) { // an interior node moved to within 1e-6 spacings of its neighbour
            int32_t a = -1, b = -1;
            for (int32_t i = c.surface_count; i < c.node_count; i++) {
                const double *x = &c.position[3 * i];
                int middle = fabs(x[0] - 0.5) + fabs(x[1] - 0.5) < 1e-9;
                a = middle && fabs(x[2] - 0.5) < 1e-9 ? i : a;
                b = middle && fabs(x[2] - 2.0 / 3) < 1e-9 ? i : b;
            }
            assert_true(a >= 0 && b >= 0);
            c.position[3 * a + 2] = c.position[3 * b + 2] - 1e-6 / 6;
            if (pal_cloud_complete(&c, &e) != PALPATE_OK) {
                fail_msg("%s", e.message);
            }
        }
        uint8_t *fixed = rig_flags(c.node_count);
        for (int32_t i = 0; i < c.surface_count; i++) {
            fixed[i] = c.position[3 * i + 2] < 1e-9;
        }
        for (int m = 0; m < 2; m++) {
            // tetrahedra of height 1e-6 amplify rounding by 1e6
            assert_true(rig_patch_error(&c, fixed, 0.3, methods[m], g) < 1e-8);
            assert_true(rig_patch_error(&c, fixed, 0.49, methods[m], g) < 1e-8);
        }
        free(fixed);
        pal_cloud_clear(&c);
    }
}

// ---- Refusals --------------------------------------------------------------------------------

static void refused(const pal_cloud *c, const uint8_t *fixed, double nu, const pal_method *m,
                    pal_status status, const char *word) {
    pal_system s;
    pal_error e = {0};
    assert_int_equal(pal_method_cell(c, fixed, nu, m, NULL, &s, &e), status);
    assert_int_equal(e.status, status);
    if (strstr(e.message, word) == NULL) {
        fail_msg("\"%s\" does not name \"%s\"", e.message, word);
    }
    assert_null(s.matrix.value);
    assert_null(s.dof_unknown);
}

static int stop(void *user, const char *stage, double fraction, double seconds_left) {
    (void)stage;
    (void)fraction;
    (void)seconds_left;
    return ++*(int *)user > 2;
}

static void impossible_input_is_refused_with_a_reason(void **state) {
    (void)state;
    pal_cloud c;
    rig_box(&c, UNIT, 8, 8, 8, 0.1);
    uint8_t *fixed = rig_flags(c.node_count);
    refused(&c, fixed, 0.5, &SYMMETRIC, PALPATE_ERROR_ARGUMENT, "poisson");
    refused(&c, fixed, -1, &SYMMETRIC, PALPATE_ERROR_ARGUMENT, "poisson");
    refused(&c, fixed, NAN, &COLLOCATED, PALPATE_ERROR_ARGUMENT, "poisson");
    pal_method m = SYMMETRIC;
    m.volumetric = PALPATE_VOLUMETRIC_MIXED;
    refused(&c, fixed, 0.3, &m, PALPATE_ERROR_UNSUPPORTED, "mixed");
    m = COLLOCATED;
    m.stabilization = 2;
    refused(&c, fixed, 0.3, &m, PALPATE_ERROR_ARGUMENT, "stabilization");
    fixed[c.node_count - 1] = 1;
    refused(&c, fixed, 0.3, &SYMMETRIC, PALPATE_ERROR_ARGUMENT, "inside");
    // progress may cancel at any call, in both forms
    memset(fixed, 0, (size_t)c.node_count);
    const pal_method *methods[2] = {&SYMMETRIC, &COLLOCATED};
    for (int k = 0; k < 2; k++) {
        int calls = 0;
        pal_progress progress = {stop, &calls};
        pal_system s;
        pal_error e = {0};
        assert_int_equal(pal_method_cell(&c, fixed, 0.3, methods[k], &progress, &s, &e),
                         PALPATE_ERROR_CANCELLED);
        assert_null(s.matrix.value);
    }
    // a flat tetrahedron: three nodes and their own plane
    int32_t *t = &c.tet[4 * 100];
    double *x = &c.position[3 * (size_t)t[3]];
    for (int d = 0; d < 3; d++) {
        x[d] = (c.position[3 * t[0] + d] + c.position[3 * t[1] + d] + c.position[3 * t[2] + d]) / 3;
    }
    refused(&c, fixed, 0.3, &SYMMETRIC, PALPATE_ERROR_STENCIL, "no volume");
    free(fixed);
    pal_cloud_clear(&c);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(groups_cover_the_body_and_share_freedoms),
        cmocka_unit_test(no_locking_towards_incompressibility),
        cmocka_unit_test(needles_and_plates_bend_as_theory_says),
        cmocka_unit_test(three_nodes_hold_a_body),
        cmocka_unit_test(bad_clouds_keep_the_patch_test),
        cmocka_unit_test(impossible_input_is_refused_with_a_reason),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
