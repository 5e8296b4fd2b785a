/// The tick: Eq. 52 against LAPACK, Eq. 53 against the stored rows, frames, limits, faults, life.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/engine_rig.h"

static double norm(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

// ---- Eq. 52 and Eq. 53 --------------------------------------------------------------------------

static void force_is_lapacks(double skew) {
    rig r;
    rig_model(&r, 11, PALPATE_PRECISION_SINGLE, skew);
    rig_engine(&r);
    int checked = 0;
    for (int k = 0; k <= 60; k++) { // press off a node, with a slide on top
        double z = 0.004 - 3e-5 * k, x = 0.0007 + 2e-5 * k, y = -0.0003;
        pal_tool_force out = rig_tick(&r, x, y, z);
        const pal_contact_result *c = &r.engine->result;
        assert_int_equal(c->dof_count, 3 * out.contact_count);
        if (out.contact_count == 0) {
            continue;
        }
        double *f = rig_lapack(&r), sum[3] = {0}, torque[3] = {0}, size = 0;
        for (int i = 0; i < c->dof_count; i++) {
            sum[i % 3] += f[i];
            size = fmax(size, fabs(f[i]));
        }
        for (int i = 0; i < c->dof_count; i++) {
            // two backward-stable solves of a system of condition below 1e4
            assert_true(fabs(f[i] - c->force[i]) <= 1e-10 * size);
        }
        for (int p = 0; p < c->dof_count / 3; p++) { // about the tool's origin, at the moved node
            int32_t node = r.model->column_node[c->dof[3 * p] / 3];
            double arm[3], tool[3] = {x, y, z};
            for (int i = 0; i < 3; i++) {
                arm[i] = r.model->position[3 * node + i] + c->displacement[3 * p + i] - tool[i];
            }
            // every touched node lies on the sphere
            assert_true(fabs(norm(arm) - 0.004) < 1e-12);
            for (int i = 0; i < 3; i++) {
                int j = (i + 1) % 3, l = (i + 2) % 3;
                torque[i] += arm[j] * f[3 * p + l] - arm[l] * f[3 * p + j];
            }
        }
        for (int i = 0; i < 3; i++) { // the tool feels the negative
            assert_true(fabs(out.force[i] + sum[i]) <= 1e-10 * norm(sum));
            assert_true(fabs(out.torque[i] + torque[i]) <= 1e-10 * norm(sum) * 0.004);
        }
        checked += out.contact_count > 3;
        free(f);
    }
    assert_true(checked > 20);
    rig_free(&r);
}

static void force_equals_lapack_symmetric(void **state) {
    (void)state;
    force_is_lapacks(0.0);
}

static void force_equals_lapack_nonsymmetric(void **state) {
    (void)state;
    force_is_lapacks(0.15);
}

static void field_equals_the_stored_rows_times_force(void **state) {
    (void)state;
    for (int p = 0; p < 3; p++) {
        rig r;
        rig_model(&r, 9, (pal_precision)p, 0.0);
        rig_engine(&r);
        (void)rig_press(&r, 0, 0, 0.0041, 0.003, 20);
        pal_frame frame;
        assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 1), &frame), 1);
        const pal_contact_result *c = &r.engine->result;
        int64_t rows = 3 * (int64_t)r.model->info.row_count;
        double *column = calloc((size_t)rows, sizeof *column);
        double *sum = calloc((size_t)rows, sizeof *sum), *size = calloc((size_t)rows, sizeof *size);
        for (int k = 0; k < c->dof_count; k++) {
            assert_int_equal(pal_model_load_column(r.model, c->dof[k], column), PALPATE_OK);
            for (int64_t i = 0; i < rows; i++) {
                sum[i] += column[i] * c->force[k];
                size[i] += fabs(column[i] * c->force[k]);
            }
        }
        assert_true(c->dof_count > 9);
        assert_int_equal(frame.row_count, r.model->info.row_count);
        for (int64_t i = 0; i < rows; i++) { // (columns + 2) roundings of 2^-24
            double bound = p == PALPATE_PRECISION_DOUBLE ? 1.01 : c->dof_count + 2;
            assert_true(fabs((double)frame.displacement[i] - sum[i]) <= bound * 0x1p-24 * size[i]);
        }
        // at touched nodes the field is what was prescribed, to the storage's precision
        double unit = p == PALPATE_PRECISION_HALF ? 0x1p-11 : 0x1p-24;
        for (int32_t row = 0; row < r.model->info.row_count; row++) {
            for (int k = 0; k < c->dof_count; k += 3) {
                if (r.model->column_node[c->dof[k] / 3] != r.model->row_node[row]) {
                    continue;
                }
                for (int i = 0; i < 3; i++) {
                    double got = (double)frame.displacement[3 * row + i];
                    assert_true(fabs(got - c->displacement[k + i]) <=
                                (c->dof_count + 4) * unit * (size[3 * row + i] + 1e-9));
                }
            }
        }
        free(column);
        free(sum);
        free(size);
        rig_free(&r);
    }
}

// ---- What a press feels like --------------------------------------------------------------------

static void press_pushes_back_grows_and_ends(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 11, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    pal_tool_force out = rig_tick(&r, 0, 0, 0.00401);
    assert_int_equal(out.contact_count, 0);
    assert_true(norm(out.force) == 0.0 && out.depth == 0.0);
    double before = 0.0;
    for (int k = 1; k <= 100; k++) {
        double depth = 3e-5 * k;
        out = rig_tick(&r, 0, 0, 0.004 - depth);
        assert_int_equal(out.fault, 0);
        assert_true(out.contact_count >= 1);
        assert_true(out.force[2] > before); // against the press, and growing
        before = out.force[2];
        // the lattice is symmetric about the axis: nothing sideways, no torque
        assert_true(hypot(out.force[0], out.force[1]) < 1e-9 * out.force[2]);
        assert_true(norm(out.torque) < 1e-9 * out.force[2] * 0.004);
        assert_true(fabs(out.depth - depth) < 1e-12);
        assert_true(fabs(out.normal[2] - 1.0) < 1e-12);
        assert_true(fabs(out.centroid[0]) < 1e-9 && out.centroid[2] < 0.0);
    }
    assert_int_equal(out.contact_count, 9); // Hertz: radius sqrt(R d) = 3.5 mm, nodes 2 mm apart
    for (int k = 99; k >= 1; k--) {         // on the way out it only falls
        out = rig_tick(&r, 0, 0, 0.004 - 3e-5 * k);
        assert_true(out.force[2] > 0.0 && out.force[2] < before);
        before = out.force[2];
    }
    out = rig_tick(&r, 0, 0, 0.00401);
    assert_true(norm(out.force) == 0.0 && out.contact_count == 0 && norm(out.normal) == 0.0);
    pal_frame frame;
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &frame), 1);
    for (int32_t i = 0; i < 3 * frame.row_count; i++) {
        assert_true(frame.displacement[i] == 0.0f);
    }
    rig_free(&r);
}

static void body_and_device_poses_rotate_everything(void **state) {
    (void)state;
    rig a, b;
    rig_model(&a, 9, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&a);
    rig_model(&b, 9, PALPATE_PRECISION_SINGLE, 0.0);
    double q1[4] = {0.9, 0.1, -0.3, 0.2}, q2[4] = {0.5, -0.4, 0.6, 0.1};
    b.def.body_pose = (pal_pose){.position = {0.3, -0.2, 1.1}};
    b.def.device_to_world = (pal_pose){.position = {-0.4, 0.05, 0.2}};
    b.def.device_scale = 2.5;
    (void)pal_quat_normalize(q1, b.def.body_pose.orientation);
    (void)pal_quat_normalize(q2, b.def.device_to_world.orientation);
    rig_engine(&b);
    for (int k = 0; k <= 40; k++) {
        double body[3] = {0.0005, 0.0002, 0.0041 - 4e-5 * k}, world[3], device[3];
        pal_tool_force fa = rig_tick(&a, body[0], body[1], body[2]);
        // body -> world -> device by hand
        pal_pose_apply(&b.def.body_pose, body, world);
        pal_pose inverse = pal_pose_inverse(&b.def.device_to_world);
        pal_pose_apply(&inverse, world, device);
        pal_tool_force fb = rig_tick(&b, device[0] / 2.5, device[1] / 2.5, device[2] / 2.5);
        assert_int_equal(fa.contact_count, fb.contact_count);
        double expect[3], torque[3];
        pal_quat_rotate(b.def.body_pose.orientation, fa.force, expect);
        pal_quat_rotate_inverse(b.def.device_to_world.orientation, expect, expect);
        pal_quat_rotate(b.def.body_pose.orientation, fa.torque, torque);
        pal_quat_rotate_inverse(b.def.device_to_world.orientation, torque, torque);
        for (int i = 0; i < 3; i++) { // stiffness 100 N/m x rounding of a metre-sized position
            assert_true(fabs(fb.force[i] - expect[i]) < 1e-11);
            assert_true(fabs(fb.torque[i] - torque[i]) < 1e-13);
        }
        // summaries and frames stay in the body's frame
        assert_true(fabs(fa.depth - fb.depth) < 1e-12);
        pal_frame frame;
        assert_int_equal(pal_engine_snapshot(pal_engine_reader(b.engine, 0), &frame), 1);
        for (int i = 0; i < 3; i++) {
            assert_true(fabs(frame.tool_force[0].force[i] - fa.force[i]) < 1e-11);
            assert_true(fabs(frame.tool_pose[0].position[i] - body[i]) < 1e-14);
        }
    }
    rig_free(&a);
    rig_free(&b);
}

// ---- Limits and faults --------------------------------------------------------------------------

static void more_than_max_contacts_keeps_the_deepest(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 11, PALPATE_PRECISION_SINGLE, 0.0);
    r.def.max_contacts = 5;
    rig_engine(&r);
    pal_tool_force out = rig_press(&r, 0, 0, 0.0041, 0.0015, 30);
    assert_int_equal(out.contact_count, 5);
    assert_true(out.fault & PALPATE_FAULT_CONTACTS);
    pal_engine_counts counts;
    pal_engine_get_counts(r.engine, &counts);
    assert_true(counts.contacts_dropped > 0);
    assert_true(counts.fault[3] > 0 && counts.fault_value[3] >= 1.0);
    assert_int_equal(counts.fault_tick[3], 30);
    for (int p = 0; p < 5; p++) { // the centre and its four neighbours are the deepest under a ball
        int32_t node = r.model->column_node[r.engine->result.dof[3 * p] / 3];
        assert_true(hypot(r.model->position[3 * node], r.model->position[3 * node + 1]) < 0.0021);
    }
    double *f = rig_lapack(&r), sum = 0.0; // and they carry Eq. 52's force
    for (int i = 2; i < 15; i += 3) {
        sum += f[i];
    }
    assert_true(fabs(out.force[2] + sum) < 1e-10 * fabs(sum));
    free(f);
    rig_free(&r);
}

static void bad_pose_keeps_the_last_good_one(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    pal_tool_force out = rig_tick(&r, NAN, 0, 0); // nothing good yet: no contact, no force
    assert_int_equal(out.fault, PALPATE_FAULT_INPUT);
    assert_true(norm(out.force) == 0.0);
    pal_tool_force good = rig_press(&r, 0, 0, 0.0041, 0.0032, 20);
    assert_int_equal(good.fault, 0);
    pal_tool_state bad[4] = {rig_state(NAN, 0, 0.003), rig_state(0, INFINITY, 0.003),
                             rig_state(0, 0, 0.001), rig_state(0, 0, 0.001)};
    bad[2].orientation[2] = NAN;
    bad[3].orientation[0] = 0.0; // the zero quaternion is no orientation
    for (int k = 0; k < 4; k++) {
        uint32_t fault = pal_engine_tick(r.engine, &bad[k], &out);
        assert_int_equal(fault, PALPATE_FAULT_INPUT);
        for (int i = 0; i < 3; i++) {
            assert_true(fabs(out.force[i] - good.force[i]) <= 1e-12 * norm(good.force));
        }
    }
    pal_engine_counts counts;
    pal_engine_get_counts(r.engine, &counts);
    assert_int_equal(counts.fault[0], 5);
    assert_int_equal(counts.ticks, 26);
    assert_int_equal(counts.fault_tick[0], 25);
    rig_free(&r);
}

static void absurd_but_finite_poses_do_no_harm(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    r.tools[0].limits = (pal_tool_limits){.force = 3.3, .torque = 0.1};
    rig_engine(&r);
    static const double far[] = {1e300, -1e300, 1e150, -1e20, 1e9};
    for (int k = 0; k < 200; k++) {
        (void)rig_press(&r, 0, 0, 0.0041, 0.003, 3);
        double x[3];
        for (int i = 0; i < 3; i++) {
            x[i] = far[(k + 3 * i) % 5] * ((k >> i) & 1);
        }
        pal_tool_force out = rig_tick(&r, x[0], x[1], x[2]);
        assert_true(isfinite(norm(out.force)) && isfinite(norm(out.torque)));
        assert_true(norm(out.force) <= 3.3 * (1 + 1e-12));
    }
    pal_frame frame;
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &frame), 1);
    for (int i = 0; i < 3 * frame.row_count; i++) {
        assert_true(isfinite(frame.displacement[i]));
    }
    rig_free(&r);
}

static void cap_and_slew_reach_the_output(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    r.tools[0].limits = (pal_tool_limits){.force = 0.05, .slew = 0.01};
    rig_engine(&r);
    double before = 0.0, peak = 0.0;
    uint32_t all = 0;
    for (int k = 0; k <= 40; k++) {
        pal_tool_force out = rig_tick(&r, 0, 0, k == 0 ? 0.0041 : 0.002);
        double now = norm(out.force);
        assert_true(fabs(now - before) <= 0.01 * (1 + 1e-9));
        peak = fmax(peak, now);
        before = now;
        all |= out.fault;
    }
    assert_true(fabs(peak - 0.05) < 1e-12);
    assert_true(all & PALPATE_FAULT_CAP);
    assert_true(all & PALPATE_FAULT_SLEW);
    pal_engine_counts counts;
    pal_engine_get_counts(r.engine, &counts);
    assert_true(counts.fault[4] > 0 && counts.fault_value[4] > 0.05);
    rig_free(&r);
}

/// A tool that was never given limits is limited all the same.
static void zero_limits_are_the_defaults(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    r.tools[0].limits = (pal_tool_limits){0};
    r.tools[0].spec.max_force = 0.02;
    rig_engine(&r);
    const pal_engine_def *def = pal_engine_get_def(r.engine);
    assert_true(def->tools[0].limits.force == 0.02);
    assert_true(def->tools[0].limits.slew == PALPATE_DEFAULT_SLEW);
    assert_true(def->tools[0].limits.torque == PALPATE_DEFAULT_TORQUE);
    pal_tool_force out = rig_press(&r, 0, 0, 0.0041, 0.002, 10);
    assert_true(out.fault & PALPATE_FAULT_CAP);
    assert_true(fabs(norm(out.force) - 0.02) < 1e-12);
    rig_free(&r);
}

static void unfactorable_block_keeps_the_last_force_and_says_so(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&r);
    pal_tool_force good = rig_press(&r, 0, 0, 0.0041, 0.00399, 10);
    assert_int_equal(good.contact_count, 1);
    size_t n = 3 * (size_t)r.model->info.column_count;
    for (size_t i = 0; i < n; i++) { // every node that comes now has an indefinite block
        r.model->c_tt[i + i * n] = -r.model->c_tt[i + i * n];
    }
    pal_tool_force out = rig_press(&r, 0, 0, 0.0039, 0.003, 5);
    assert_true(out.fault & PALPATE_FAULT_SINGULAR);
    assert_true(norm(out.force) > 0.0 && isfinite(norm(out.force)));
    out = rig_tick(&r, 0, 0, 0.02);                        // 17 m/s: no jump for the watchdog
    assert_true(norm(out.force) == 0.0 && out.fault == 0); // leaving ends it
    rig_free(&r);
}

static void reset_forgets_and_repeats(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    r.tools[0].limits.slew = 0.05;
    rig_engine(&r);
    pal_tool_force first[50], again;
    for (int k = 0; k < 50; k++) {
        first[k] = rig_tick(&r, 1e-5 * k, 0, 0.0041 - 2e-5 * k);
    }
    pal_engine_reset(r.engine);
    pal_engine_counts counts;
    pal_engine_get_counts(r.engine, &counts);
    assert_int_equal(counts.ticks, 0);
    for (int k = 0; k < 50; k++) {
        again = rig_tick(&r, 1e-5 * k, 0, 0.0041 - 2e-5 * k);
        assert_memory_equal(&again, &first[k], sizeof again);
    }
    rig_free(&r);
}

// ---- Determinism, several engines, readers
// -------------------------------------------------------

static void forces_do_not_depend_on_fields_readers_or_other_engines(void **state) {
    (void)state;
    rig a, b;
    rig_model(&a, 9, PALPATE_PRECISION_SINGLE, 0.0);
    rig_engine(&a);
    b = a; // the same model
    b.def.reader_count = 0;
    b.def.max_contacts = a.def.max_contacts;
    rig_engine(&b);
    assert_ptr_not_equal(a.engine, b.engine);
    pal_frame frame;
    for (int k = 0; k < 300; k++) {
        pal_tool_state in =
            rig_state(0.003 * sin(0.02 * k), 0.002 * cos(0.03 * k), 0.0035 + 0.001 * cos(0.05 * k));
        pal_tool_force fa, fb;
        (void)pal_engine_tick(a.engine, &in, &fa);
        if (k % 3 == 0) {
            (void)pal_engine_snapshot(pal_engine_reader(a.engine, 0), &frame);
        }
        if (k % 7 == 0) { // b is now and then asked to do something else and undone by nothing
            pal_engine_counts counts;
            pal_engine_get_counts(b.engine, &counts);
            pal_engine_field(b.engine);
        }
        (void)pal_engine_force(b.engine, &in, &fb);
        assert_memory_equal(&fa, &fb, sizeof fa);
    }
    pal_engine_free(b.engine);
    rig_free(&a);
}

static void variants_of_the_kernel_give_the_same_frame(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_HALF, 0.0);
    rig_engine(&r);
    pal_tool_state in = rig_state(0.0004, 0, 0.0033);
    pal_tool_force out;
    pal_frame first, frame;
    (void)pal_engine_tick(r.engine, &in, &out);
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &first), 1);
    for (int isa = 0; isa < PALPATE_ISA_COUNT; isa++) {
        if (pal_field_available((pal_isa)isa)) {
            r.engine->isa = (pal_isa)isa;
            pal_engine_field(r.engine);
            assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 1), &frame), 1);
            assert_memory_equal(frame.displacement, first.displacement,
                                3 * (size_t)frame.row_count * sizeof(float));
        }
    }
    rig_free(&r);
}

static void unread_frames_are_replaced_at_their_age(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    r.def.frame_age = 4;
    r.def.reader_count = 1;
    rig_engine(&r);
    pal_frame frame;
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &frame), -1);
    for (int k = 0; k < 11; k++) { // published at ticks 0, 4, 8
        (void)rig_tick(&r, 0, 0, 0.0039);
    }
    pal_engine_counts counts;
    pal_engine_get_counts(r.engine, &counts);
    assert_int_equal(counts.frames_published, 3);
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &frame), 1);
    assert_int_equal(frame.tick, 8);
    assert_int_equal(frame.time_ns, 8000000);
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &frame), 0);
    (void)rig_tick(&r, 0, 0, 0.0039); // taken: the next tick publishes at once
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &frame), 1);
    assert_int_equal(frame.tick, 11);
    assert_null(pal_engine_reader(r.engine, 1));
    assert_null(pal_engine_reader(r.engine, -1));
    rig_free(&r);
}

static void model_without_rows_gives_forces_alone(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 9, PALPATE_PRECISION_SINGLE, 0.0);
    pal_model_free(r.model);
    synthetic_params p = synthetic_default_params();
    p.rows = SYNTHETIC_ROWS_NONE;
    p.n = 9;
    r.model = synthetic_model(&p);
    assert_non_null(r.model);
    rig_engine(&r);
    pal_tool_force out = rig_press(&r, 0, 0, 0.0041, 0.003, 10);
    assert_true(out.force[2] > 0.0);
    pal_frame frame;
    assert_int_equal(pal_engine_snapshot(pal_engine_reader(r.engine, 0), &frame), 1);
    assert_int_equal(frame.row_count, 0);
    assert_null(frame.displacement);
    assert_true(frame.tool_force[0].force[2] == out.force[2]);
    rig_free(&r);
}

// ---- Definition ---------------------------------------------------------------------------------

static void definitions_are_checked(void **state) {
    (void)state;
    rig r;
    rig_model(&r, 5, PALPATE_PRECISION_SINGLE, 0.0);
    pal_engine_def good = r.def;
    size_t bytes = pal_engine_bytes(r.model, &good);
    assert_true(bytes > 0);
    good.max_contacts *= 2;
    assert_true(pal_engine_bytes(r.model, &good) > bytes);
    struct {
        pal_engine_def def;
        pal_tool_def tool;
        pal_status status;
        const char *word;
    } bad[32];
    int n = 0;
#define BAD(change, code, text)                                                                    \
    do {                                                                                           \
        bad[n].def = r.def;                                                                        \
        bad[n].tool = r.tools[0];                                                                  \
        pal_engine_def *def = &bad[n].def;                                                         \
        pal_tool_def *tool = &bad[n].tool;                                                         \
        (void)def, (void)tool;                                                                     \
        change;                                                                                    \
        bad[n].status = code;                                                                      \
        bad[n++].word = text;                                                                      \
    } while (0)
    BAD(def->cookie = 0, PALPATE_ERROR_ARGUMENT, "pal_engine_default_def");
    BAD(def->tool_count = 0, PALPATE_ERROR_ARGUMENT, "tool_count");
    BAD(def->tool_count = 9, PALPATE_ERROR_ARGUMENT, "tool_count");
    BAD(def->max_contacts = 0, PALPATE_ERROR_ARGUMENT, "max_contacts");
    BAD(def->contact_law = (pal_contact_kind)2, PALPATE_ERROR_ARGUMENT, "contact_law");
    BAD(def->contact_points = 65, PALPATE_ERROR_ARGUMENT, "contact_points");
    BAD(def->reader_count = -1, PALPATE_ERROR_ARGUMENT, "reader_count");
    BAD(def->frame_age = 0, PALPATE_ERROR_ARGUMENT, "frame_age");
    BAD(def->body_pose.position[1] = NAN, PALPATE_ERROR_ARGUMENT, "body_pose");
    BAD(def->device_to_world.orientation[0] = 0, PALPATE_ERROR_ARGUMENT, "device_to_world");
    BAD(def->device_scale = 0, PALPATE_ERROR_ARGUMENT, "device_scale");
    BAD(def->period = INFINITY, PALPATE_ERROR_ARGUMENT, "period");
    BAD(tool->radius = 0, PALPATE_ERROR_ARGUMENT, "radius");
    BAD(tool->shape = (pal_shape_kind)7, PALPATE_ERROR_ARGUMENT, "shape");
    BAD(tool->limits.force = -1, PALPATE_ERROR_ARGUMENT, "limits");
    BAD(tool->limits.slew = (double)NAN, PALPATE_ERROR_ARGUMENT, "limits");
    BAD(tool->spec.max_force = -1, PALPATE_ERROR_ARGUMENT, "spec");
    BAD(tool->spec.max_speed = (double)INFINITY, PALPATE_ERROR_ARGUMENT, "spec");
    BAD((tool->spec.max_stiffness = 400, tool->coupling_stiffness = 500), PALPATE_ERROR_ARGUMENT,
        "bears");
    BAD((tool->spec.max_damping = 1, tool->coupling_damping = 2), PALPATE_ERROR_ARGUMENT, "bears");
    BAD(def->watchdog.stale = 2, PALPATE_ERROR_ARGUMENT, "watchdog.stale");
    BAD(tool->friction = 0.3, PALPATE_ERROR_UNSUPPORTED, "friction");
    BAD(tool->coupling_stiffness = 500, PALPATE_ERROR_UNSUPPORTED, "coupling"); // of law "nodes"
    BAD((def->contact_law = PALPATE_CONTACT_SURFACE, tool->coupling_stiffness = NAN),
        PALPATE_ERROR_ARGUMENT, "coupling");
    BAD((def->contact_law = PALPATE_CONTACT_SURFACE, tool->coupling_damping = -1),
        PALPATE_ERROR_ARGUMENT, "coupling");
#undef BAD
    for (int k = 0; k < n; k++) {
        pal_error error = {0};
        pal_engine *engine = (pal_engine *)(void *)&error;
        bad[k].def.tools = &bad[k].tool;
        assert_int_equal(pal_engine_bytes(r.model, &bad[k].def), 0);
        assert_int_equal(pal_engine_create(r.model, &bad[k].def, &engine, &error), bad[k].status);
        assert_null(engine);
        assert_non_null(strstr(error.message, bad[k].word));
    }
    pal_engine *engine;
    assert_int_equal(pal_engine_create(NULL, &r.def, &engine, NULL), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_engine_create(r.model, &r.def, NULL, NULL), PALPATE_ERROR_ARGUMENT);
    pal_engine_free(NULL);
    rig_free(&r);
}

#define BOTH_LAWS(test)                                                                            \
    cmocka_unit_test(test), {                                                                      \
#test " (surface)", test, rig_surface_law, rig_nodes_law, NULL                             \
    }

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(force_equals_lapack_symmetric),
        cmocka_unit_test(force_equals_lapack_nonsymmetric),
        cmocka_unit_test(field_equals_the_stored_rows_times_force),
        cmocka_unit_test(press_pushes_back_grows_and_ends),
        BOTH_LAWS(body_and_device_poses_rotate_everything),
        cmocka_unit_test(more_than_max_contacts_keeps_the_deepest),
        cmocka_unit_test(zero_limits_are_the_defaults),
        BOTH_LAWS(bad_pose_keeps_the_last_good_one),
        BOTH_LAWS(absurd_but_finite_poses_do_no_harm),
        BOTH_LAWS(cap_and_slew_reach_the_output),
        cmocka_unit_test(unfactorable_block_keeps_the_last_force_and_says_so),
        BOTH_LAWS(reset_forgets_and_repeats),
        BOTH_LAWS(forces_do_not_depend_on_fields_readers_or_other_engines),
        BOTH_LAWS(variants_of_the_kernel_give_the_same_frame),
        BOTH_LAWS(unread_frames_are_replaced_at_their_age),
        BOTH_LAWS(model_without_rows_gives_forces_alone),
        cmocka_unit_test(definitions_are_checked),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
