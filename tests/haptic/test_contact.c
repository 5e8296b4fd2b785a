/// The contact law "nodes" and its parts: solids, grid, active set; unilateral, grasp, several
/// tools.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/contact/contact_nodes.h"
#include "tests/support/engine_rig.h"

static uint64_t random_state = 3;
static double uniform(void) { // (-1, 1)
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (double)(random_state >> 11) * 0x1p-52 - 1.0;
}

static double norm(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static nodes_law *law_of(const rig *r) {
    return r->engine->contact;
}

// ---- Solids -------------------------------------------------------------------------------------

static void chord_ends_lie_on_the_surface_and_hold_the_inside(void **state) {
    (void)state;
    int hits = 0;
    for (int n = 0; n < 3000; n++) {
        pal_tool_def tool = {.shape = n % 2 ? PALPATE_SHAPE_CAPSULE : PALPATE_SHAPE_SPHERE,
                             .radius = 0.3 + 0.2 * uniform(),
                             .length = 1.0 + uniform()};
        pal_pose pose = {.position = {uniform(), uniform(), uniform()}};
        double q[4] = {uniform(), uniform(), uniform(), uniform()};
        (void)pal_quat_normalize(q, pose.orientation);
        pal_solid s = pal_solid_place(&tool, &pose);
        double x[3] = {uniform(), uniform(), uniform()}, d[3] = {uniform(), uniform(), uniform()};
        double length = norm(d), near, far, p[3];
        for (int i = 0; i < 3; i++) {
            d[i] /= length;
        }
        int hit = pal_solid_chord(&s, x, d, &near, &far), inside = 0;
        for (int k = -400; k <= 400; k++) { // the line, sampled
            for (int i = 0; i < 3; i++) {
                p[i] = x[i] + 0.01 * k * d[i];
            }
            int in = pal_solid_distance(&s, p) < 0.0;
            inside |= in;
            if (hit) {
                assert_int_equal(in, 0.01 * k > near && 0.01 * k < far);
            }
        }
        if (!hit) {
            assert_false(inside);
            continue;
        }
        hits++;
        for (int end = 0; end < 2; end++) {
            for (int i = 0; i < 3; i++) {
                p[i] = x[i] + (end ? far : near) * d[i];
            }
            assert_true(fabs(pal_solid_distance(&s, p)) <
                        1e-7); // grazing lines lose half the digits
        }
        double low[3], high[3];
        pal_solid_box(&s, low, high);
        for (int i = 0; i < 3; i++) {
            assert_true(p[i] > low[i] - 1e-9 && p[i] < high[i] + 1e-9);
        }
    }
    assert_true(hits > 300);
}

static void point_is_always_level_with_its_tip(void **state) {
    (void)state;
    pal_tool_def tool = {.shape = PALPATE_SHAPE_POINT, .radius = 5.0};
    pal_pose pose = {.position = {1, 2, 3}, .orientation = {1, 0, 0, 0}};
    pal_solid s = pal_solid_place(&tool, &pose);
    double x[3] = {0, 0, 5}, d[3] = {0, 0, -1}, near, far;
    assert_true(s.radius == 0.0);
    assert_int_equal(pal_solid_chord(&s, x, d, &near, &far), 1);
    assert_true(near == 2.0 && far == 2.0);
}

// ---- Grid ---------------------------------------------------------------------------------------

static void grid_finds_what_a_full_search_finds(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 12, PALPATE_PRECISION_SINGLE, 0.0);
    void *memory = aligned_alloc(64, pal_grid_bytes(r.model));
    pal_grid grid;
    pal_grid_init(&grid, r.model, memory);
    assert_int_equal(grid.count, 144);
    int32_t *found = calloc((size_t)grid.count, sizeof *found);
    for (int n = 0; n < 500; n++) {
        double low[3], high[3];
        for (int i = 0; i < 3; i++) {
            double a = 0.02 * uniform(), b = 0.02 * uniform();
            low[i] = fmin(a, b) - (i == 2 ? 0.001 : 0.0);
            high[i] = fmax(a, b) + (i == 2 ? 0.001 : 0.0);
        }
        int32_t count = pal_grid_query(&grid, low, high, found), expect = 0;
        for (int32_t a = 0; a < grid.count; a++) {
            const double *x = grid.position + 3 * a;
            int in = 1, listed = 0;
            for (int i = 0; i < 3; i++) {
                in &= x[i] >= low[i] && x[i] <= high[i];
            }
            for (int32_t k = 0; k < count; k++) {
                listed += found[k] == a;
            }
            assert_int_equal(listed, in);
            expect += in;
        }
        assert_int_equal(count, expect);
    }
    double nan[3] = {NAN, 0, 0}, big[3] = {INFINITY, INFINITY, INFINITY};
    double small[3] = {-INFINITY, -INFINITY, -INFINITY};
    assert_int_equal(pal_grid_query(&grid, nan, big, found), 0);
    assert_int_equal(pal_grid_query(&grid, small, big, found), grid.count);
    // every point of the surface is within reach of its nearest node (2 mm squares cut in two)
    assert_true(grid.reach_max > 0.002 / sqrt(2.0) && grid.reach_max < 0.002);
    free(found);
    free(memory);
    rig_free(&r);
}

// ---- Active set ---------------------------------------------------------------------------------

static void kept_factor_gives_the_bits_of_a_new_one(double skew) {
    rig r;
    rig_model(&r, 8, PALPATE_PRECISION_SINGLE, skew);
    enum { CAPACITY = 20 };
    void *memory[2];
    pal_active_set set[2];
    for (int k = 0; k < 2; k++) {
        memory[k] = aligned_alloc(64, pal_active_set_bytes(r.model, CAPACITY));
        pal_active_set_init(&set[k], r.model, CAPACITY, memory[k]);
    }
    assert_int_equal(set[0].symmetric, skew == 0.0);
    for (int step = 0; step < 400; step++) {
        pal_active_set *kept = &set[0], *fresh = &set[1];
        for (int change = (int)(3 * fabs(uniform())); change >= 0; change--) {
            int32_t column = (int32_t)(64 * fabs(uniform())), used = 0;
            for (int32_t k = 0; k < kept->count; k++) {
                used |= kept->column[k] == column;
            }
            if (kept->count > 0 && (uniform() < -0.1 || kept->count == CAPACITY)) {
                pal_active_set_remove(kept, (int32_t)(kept->count * fabs(uniform())));
            } else if (!used) {
                pal_active_set_append(kept, column);
            }
        }
        pal_active_set_clear(fresh);
        for (int32_t k = 0; k < kept->count; k++) {
            pal_active_set_append(fresh, kept->column[k]);
        }
        for (int32_t i = 0; i < 3 * kept->count; i++) {
            kept->u[i] = fresh->u[i] = uniform();
        }
        assert_int_equal(pal_active_set_solve(kept), 0);
        assert_int_equal(pal_active_set_solve(fresh), 0);
        assert_memory_equal(kept->f, fresh->f, 3 * (size_t)kept->count * sizeof(double));
        for (int32_t k = 0; k < kept->count; k++) { // C f gives the prescribed displacement back
            double u[3];
            pal_active_set_displacement(kept, kept->column[k], u);
            for (int i = 0; i < 3; i++) {
                assert_true(fabs(u[i] - kept->u[3 * k + i]) < 1e-11);
            }
        }
    }
    free(memory[0]);
    free(memory[1]);
    rig_free(&r);
}

static void kept_cholesky_gives_the_bits_of_a_new_one(void **state) {
    (void)state;
    kept_factor_gives_the_bits_of_a_new_one(0.0);
}

static void kept_lu_gives_the_bits_of_a_new_one(void **state) {
    (void)state;
    kept_factor_gives_the_bits_of_a_new_one(0.2);
}

// ---- Unilateral ---------------------------------------------------------------------------------

/// Complementarity over all touchable nodes, not only candidates: no touched node is pulled; no
/// free node that faces a tool in contact is inside it.
static void assert_settled(const rig *r, double tolerance) {
    nodes_law *law = law_of(r);
    for (int32_t a = 0; a < law->grid.count; a++) {
        double x[3], u[3];
        deformed(law, a, x, u);
        for (int32_t t = 0; t < law->def.tool_count; t++) {
            const tool_state *tool = &law->tool[t];
            if (tool->engaged && law->node[a].owner < 0 && !is_point(law, t)) {
                assert_true(pal_solid_distance(&tool->solid, x) > -tolerance);
            }
        }
    }
    for (int32_t k = 0; k < law->set.count; k++) {
        const tool_state *tool = &law->tool[law->node[law->member[k]].owner];
        assert_true(v3_dot(law->set.f + 3 * k, tool->dir) >= 0.0);
    }
}

static void nothing_pulled_and_nothing_inside(void **state) {
    (void)state;
    for (int skewed = 0; skewed < 2; skewed++) {
        rig r;
        rig_model(&r, 13, PALPATE_PRECISION_SINGLE, skewed ? 0.1 : 0.0);
        r.tools[1] =
            (pal_tool_def){.shape = PALPATE_SHAPE_CAPSULE, .radius = 0.003, .length = 0.01};
        r.tools[2] = (pal_tool_def){.shape = PALPATE_SHAPE_SPHERE, .radius = 0.006};
        r.def.tool_count = 3;
        r.def.max_contacts = 128;
        rig_engine(&r);
        uint64_t touched = 0, faults = 0;
        for (int k = 0; k < 3000; k++) {
            double s = 0.001 * k;
            pal_tool_state in[3];
            in[0] = rig_state(0.008 * sin(11 * s), 0.008 * cos(7 * s), 0.003 + 0.002 * sin(13 * s));
            in[1] = rig_state(0.006 * sin(5 * s), -0.003, 0.0028 + 0.002 * cos(9 * s));
            in[2] = rig_state(-0.006, 0.006 * cos(8 * s), 0.0055 + 0.002 * sin(6 * s));
            double q[4] = {1.0, 1.0 + 0.2 * sin(4 * s), 0.3, 0.1};
            (void)pal_quat_normalize(q, in[1].orientation);
            pal_tool_force out[3];
            uint32_t fault = pal_engine_force(r.engine, in, out);
            faults += fault != 0;
            touched += (uint64_t)(out[0].contact_count > 0 && out[1].contact_count > 0);
            if (fault == 0) { // touch tolerance: 1e-7 of the reach
                assert_settled(&r, 1e-9);
            }
        }
        assert_true(touched > 500);
        assert_true(faults < 30); // cut-offs where tools fight for nodes: below 1 %
        pal_engine_counts counts;
        pal_engine_get_counts(r.engine, &counts);
        print_message("skew %d: %.2f passes a tick, worst %d, %d cut off of 3000\n", skewed,
                      (double)counts.solver_iterations / 3000, (int)counts.worst_iterations,
                      (int)faults);
        rig_free(&r);
    }
}

static void deeper_than_the_radius_still_pushes_forward(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 13, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    double before = 0.0;
    for (int k = 1; k <= 300; k++) { // radius 4 mm, pressed 9 mm: the centre is far below the rest
        pal_tool_force out = rig_tick(&r, 0, 0, 0.004 - 3e-5 * k);
        assert_true(out.force[2] > before);
        assert_true(fabs(out.depth - 3e-5 * k) < 1e-12);
        before = out.force[2];
    }
    rig_free(&r);
}

static void a_tool_from_inside_or_outside_the_patch_feels_nothing(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    pal_tool_force out = {0};
    for (int k = 0; k <= 100; k++) { // it starts inside the body and comes up through the surface
        out = rig_tick(&r, 0.0003, 0, -0.03 + 6e-4 * k);
        assert_true(norm(out.force) == 0.0);
    }
    out = rig_press(&r, 0.0003, 0, 0.0041, 0.0035, 10); // now it is outside and may press
    assert_true(out.force[2] > 0.0);
    out = rig_press(&r, 0.2, 0.2, 0.0041, 0.003, 10); // far beyond the touchable nodes
    assert_true(norm(out.force) == 0.0);
    rig_free(&r);
}

static void a_fast_tool_does_not_tunnel(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    (void)rig_tick(&r, 0, 0, 0.006);
    pal_tool_force out = rig_tick(&r, 0, 0, -0.004); // 10 mm in a tick: 10 m/s
    assert_true(out.force[2] > 0.0);
    assert_true(fabs(out.depth - 0.008) < 1e-12);
    rig_free(&r);
}

// ---- Continuity ---------------------------------------------------------------------------------

/// Largest force change of a tick beyond what the stiffest contact seen would give for the motion.
static void assert_smooth(rig *r, double (*path)(int, int), int steps, double travel, double factor,
                          const char *name) {
    pal_tool_force last = {0};
    double worst = 0.0, peak = 0.0;
    for (int k = 0; k <= steps; k++) {
        pal_tool_force out = rig_tick(r, path(k, 0), path(k, 1), path(k, 2));
        assert_int_equal(out.fault, 0);
        double change[3];
        for (int i = 0; i < 3; i++) {
            change[i] = out.force[i] - last.force[i];
        }
        worst = fmax(worst, k > 0 ? norm(change) : 0.0);
        peak = fmax(peak, norm(out.force));
        last = out;
    }
    // a rigid flat punch on the half space, 2 E a / (1 - nu^2), with the ball's own radius as a, is
    // stiffer than any contact of the ball
    double k = 2 * 10e3 * 0.004 / (1 - 0.45 * 0.45);
    print_message("%s: worst change %.3g N a tick, stiffness x motion %.3g N, peak %.3g N\n", name,
                  worst, k * travel, peak);
    assert_true(worst <= factor * k * travel);
}

static double press_path(int k, int i) {
    static const double at[2] = {0.0006, -0.0004};
    return i < 2 ? at[i] : 0.0041 - 2e-6 * k;
}
static double slide_path(int k, int i) {
    return i == 0 ? -0.008 + 1e-5 * k : i == 1 ? 0.0004 : 0.003;
}

static void pressing_is_smooth(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 13, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    assert_smooth(&r, press_path, 1500, 2e-6, 1.0, "press"); // nodes join without a jump
    rig_free(&r);
}

static void sliding_is_bounded(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 13, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    (void)rig_press(&r, -0.008, 0.0004, 0.0041, 0.003, 400);
    assert_smooth(&r, slide_path, 1600, 1e-5, 1.0, "slide");
    rig_free(&r);
}

// ---- Points, capsules, grasp, several tools
// -------------------------------------------------------

static void point_presses_its_nearest_node(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    r.tools[0] = (pal_tool_def){.shape = PALPATE_SHAPE_POINT};
    rig_engine(&r);
    pal_tool_force out = rig_press(&r, 0.0004, -0.0003, 0.0005, -0.001, 100);
    assert_int_equal(out.contact_count, 1);
    int32_t node = r.model->column_node[r.engine->result.dof[0] / 3];
    assert_true(norm(r.model->position + 3 * node) < 1e-12); // the one at the origin
    const double *c = r.model->c_tt;
    size_t ld = 3 * (size_t)r.model->info.column_count, d = (size_t)r.engine->result.dof[0];
    // one node, isotropic about z: u_z / c_zz; sideways nothing
    assert_true(fabs(out.force[2] - 0.001 / c[d + 2 + (d + 2) * ld]) < 1e-10 * out.force[2]);
    // slide two nodes on: always one node, always nearly the same push
    double first = out.force[2];
    int32_t last = node, changes = 0;
    for (int k = 0; k < 400; k++) {
        out = rig_tick(&r, 0.0004 + 1e-5 * k, -0.0003, -0.001);
        assert_int_equal(out.contact_count, 1);
        assert_true(fabs(out.force[2] - first) < 1e-6 * first); // equal nodes of the half space
        node = r.model->column_node[r.engine->result.dof[0] / 3];
        changes += node != last;
        last = node;
    }
    assert_int_equal(changes, 2);
    out = rig_tick(&r, 0.0044, -0.0003, 0.0001);
    assert_true(norm(out.force) == 0.0);
    rig_free(&r);
}

static void tilted_capsule_feels_a_torque(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 13, PALPATE_PRECISION_SINGLE, 0.0);
    r.tools[0] = (pal_tool_def){.shape = PALPATE_SHAPE_CAPSULE, .radius = 0.003, .length = 0.012};
    rig_engine(&r);
    double tilt[2] = {0.0, 0.1}, torque[2];
    for (int k = 0; k < 2; k++) {
        pal_engine_reset(r.engine);
        pal_tool_force out = {0};
        for (int step = 0; step <= 50; step++) {
            pal_tool_state in = rig_state(0, 0, 0.0042 - 3e-5 * step);
            double angle = 0.5 * (1.5707963267948966 + tilt[k]); // lying along x, +x end down
            in.orientation[0] = cos(angle);
            in.orientation[2] = sin(angle);
            (void)pal_engine_tick(r.engine, &in, &out);
        }
        assert_true(out.contact_count >= 3);
        assert_true(out.force[2] > 0.0);
        torque[k] = out.torque[1] / out.force[2];
    }
    assert_true(fabs(torque[0]) < 1e-9); // level: none
    // the +x end is deeper: the body lifts it, a turn about -y; the arm is a fraction of the length
    assert_true(torque[1] < -0.0005 && torque[1] > -0.008);
    rig_free(&r);
}

static void grasp_holds_until_opened(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 11, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    pal_tool_force pushed = rig_press(&r, 0, 0, 0.0041, 0.003, 30), out = {0};
    assert_true(pushed.force[2] > 0.0);
    int held = pushed.contact_count;
    for (int k = 0; k <= 60; k++) { // close, then lift to 2 mm above the first touch
        pal_tool_state in = rig_state(0, 0, 0.003 + 5e-5 * k);
        in.buttons = 1;
        (void)pal_engine_tick(r.engine, &in, &out);
        assert_int_equal(out.contact_count, held);
        if (k == 0) { // closing alone changes nothing
            assert_true(fabs(out.force[2] - pushed.force[2]) < 1e-9 * pushed.force[2]);
        }
    }
    assert_true(out.force[2] < -0.5 * pushed.force[2]); // the tissue pulls the tool back down
    double *f = rig_lapack(&r), sum = 0.0;
    for (int i = 2; i < r.engine->result.dof_count; i += 3) {
        sum += f[i];
    }
    assert_true(fabs(out.force[2] + sum) < 1e-10 * fabs(sum));
    free(f);
    pal_tool_state in = rig_state(0, 0, 0.006); // turned while held: a torque answers
    in.buttons = 1;
    in.orientation[0] = cos(0.1);
    in.orientation[3] = sin(0.1);
    (void)pal_engine_tick(r.engine, &in, &out);
    assert_true(out.torque[2] < -1e-6);
    in.buttons = 0;
    (void)pal_engine_tick(r.engine, &in, &out);
    assert_true(norm(out.force) == 0.0);
    assert_int_equal(out.contact_count, 0);
    // opened while pressing: it is pushed on as before
    (void)rig_press(&r, 0, 0, 0.0041, 0.003, 30);
    in = rig_state(0, 0, 0.003);
    in.buttons = 1;
    (void)pal_engine_tick(r.engine, &in, &out);
    double closed = out.force[2];
    in.buttons = 0;
    (void)pal_engine_tick(r.engine, &in, &out);
    assert_true(fabs(out.force[2] - closed) < 1e-9 * closed);
    rig_free(&r);
}

static void tools_feel_each_other_through_the_body(void **state) {
    (void)state;
    double alone = 0.0;
    for (int both = 0; both < 2; both++) {
        rig r;
        rig_model(&r, 13, PALPATE_PRECISION_SINGLE, 0.0);
        r.tools[1] = r.tools[0];
        r.def.tool_count = 2;
        rig_engine(&r);
        pal_tool_force out[2];
        for (int k = 0; k <= 50; k++) {
            pal_tool_state in[2] = {rig_state(-0.005, 0, 0.0041 - 2e-5 * k),
                                    rig_state(0.005, 0, both ? 0.0041 - 2e-5 * k : 0.1)};
            (void)pal_engine_tick(r.engine, in, out);
        }
        if (!both) {
            alone = out[0].force[2];
            assert_true(norm(out[1].force) == 0.0);
        } else {
            // the neighbour has pushed part of the way already
            assert_true(out[0].force[2] < 0.95 * alone && out[0].force[2] > 0.5 * alone);
            assert_true(fabs(out[0].force[2] - out[1].force[2]) < 1e-9 * alone); // mirror images
            assert_true(fabs(out[0].force[0] + out[1].force[0]) < 1e-9 * alone);
            double *f = rig_lapack(&r), sum = 0.0; // Eq. 52 over the nodes of both
            for (int i = 2; i < r.engine->result.dof_count; i += 3) {
                sum += f[i];
            }
            assert_true(fabs(out[0].force[2] + out[1].force[2] + sum) < 1e-10 * fabs(sum));
            free(f);
        }
        rig_free(&r);
    }
}

static void two_tools_on_one_node_share_nothing(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    r.tools[1] = r.tools[0];
    r.def.tool_count = 2;
    rig_engine(&r);
    pal_tool_force out[2];
    for (int k = 0; k <= 60; k++) { // the same place: the deeper one has the node
        pal_tool_state in[2] = {rig_state(0, 0, 0.0041 - 1e-5 * k),
                                rig_state(0, 0, 0.0041 - 2e-5 * k)};
        (void)pal_engine_tick(r.engine, in, out);
        for (int32_t i = 0; i < r.engine->result.dof_count; i++) {
            for (int32_t j = 0; j < i; j++) {
                assert_int_not_equal(r.engine->result.dof[i], r.engine->result.dof[j]);
            }
        }
    }
    assert_true(out[1].force[2] > 0.0);
    rig_free(&r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(chord_ends_lie_on_the_surface_and_hold_the_inside),
        cmocka_unit_test(point_is_always_level_with_its_tip),
        cmocka_unit_test(grid_finds_what_a_full_search_finds),
        cmocka_unit_test(kept_cholesky_gives_the_bits_of_a_new_one),
        cmocka_unit_test(kept_lu_gives_the_bits_of_a_new_one),
        cmocka_unit_test(nothing_pulled_and_nothing_inside),
        cmocka_unit_test(deeper_than_the_radius_still_pushes_forward),
        cmocka_unit_test(a_tool_from_inside_or_outside_the_patch_feels_nothing),
        cmocka_unit_test(a_fast_tool_does_not_tunnel),
        cmocka_unit_test(pressing_is_smooth),
        cmocka_unit_test(sliding_is_bounded),
        cmocka_unit_test(point_presses_its_nearest_node),
        cmocka_unit_test(tilted_capsule_feels_a_torque),
        cmocka_unit_test(grasp_holds_until_opened),
        cmocka_unit_test(tools_feel_each_other_through_the_body),
        cmocka_unit_test(two_tools_on_one_node_share_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
