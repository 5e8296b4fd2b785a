/// Quaternions, poses, and the device -> world -> body chain, against rotation matrices.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>

#include "haptic/base/pose.h"

// A few roundings of numbers of order one.
static const double EPS = 1e-14;

static uint64_t random_state = 1;
static double uniform(void) { // (-1, 1)
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (double)(random_state >> 11) * 0x1p-52 - 1.0;
}

static void random_pose(pal_pose *p) {
    double q[4];
    for (int i = 0; i < 4; i++) {
        q[i] = uniform();
    }
    assert_true(pal_quat_normalize(q, p->orientation));
    for (int i = 0; i < 3; i++) {
        p->position[i] = uniform();
    }
}

/// The textbook matrix of a unit quaternion: an independent formula for the same rotation.
static void matrix(const double q[4], double m[3][3]) {
    double w = q[0], x = q[1], y = q[2], z = q[3];
    double a[3][3] = {{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                      {2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                      {2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) {
            m[i][j] = a[i][j];
        }
    }
}

static void assert_near(const double a[3], const double b[3], double tolerance) {
    for (int i = 0; i < 3; i++) {
        assert_true(fabs(a[i] - b[i]) <= tolerance);
    }
}

static void rotation_equals_the_matrix_and_back(void **state) {
    (void)state;
    for (int n = 0; n < 200; n++) {
        pal_pose p;
        random_pose(&p);
        double m[3][3], v[3] = {uniform(), uniform(), uniform()}, r[3], e[3] = {0}, back[3];
        matrix(p.orientation, m);
        pal_quat_rotate(p.orientation, v, r);
        for (int i = 0; i < 3; i++) {
            for (int j = 0; j < 3; j++) {
                e[i] += m[i][j] * v[j];
            }
        }
        assert_near(r, e, EPS);
        pal_quat_rotate_inverse(p.orientation, r, back);
        assert_near(back, v, EPS);
    }
}

static void compose_inverse_and_apply_agree(void **state) {
    (void)state;
    for (int n = 0; n < 200; n++) {
        pal_pose a, b;
        random_pose(&a);
        random_pose(&b);
        double v[3] = {uniform(), uniform(), uniform()}, t[3], expect[3], got[3];
        pal_pose_apply(&b, v, t);
        pal_pose_apply(&a, t, expect);
        pal_pose ab = pal_pose_compose(&a, &b);
        pal_pose_apply(&ab, v, got);
        assert_near(got, expect, 4 * EPS);
        pal_pose inverse = pal_pose_inverse(&ab);
        pal_pose_apply(&inverse, got, got);
        assert_near(got, v, 8 * EPS);
    }
}

static void identity_is_exact(void **state) {
    (void)state;
    pal_pose id = pal_pose_identity();
    pal_frames f = pal_frames_make(&id, &id, 1.0);
    double x[3] = {0.1, -0.2, 0.3}, v[3];
    pal_pose out;
    pal_frames_to_body(&f, x, id.orientation, &out);
    for (int i = 0; i < 3; i++) { // bit for bit: an unmoved body adds no rounding
        assert_true(out.position[i] == x[i]);
    }
    pal_frames_vector_to_device(&f, x, v);
    assert_true(v[0] == x[0] && v[1] == x[1] && v[2] == x[2]);
}

static void chain_is_device_world_body(void **state) {
    (void)state;
    for (int n = 0; n < 100; n++) {
        pal_pose body, device, tool, out;
        random_pose(&body);
        random_pose(&device);
        random_pose(&tool);
        double scale = 2.5, local[3] = {0.1, 0.2, -0.3}, world[3], expect[3], got[3];
        pal_frames f = pal_frames_make(&body, &device, scale);
        pal_frames_to_body(&f, tool.position, tool.orientation, &out);
        // a point fixed to the tool, step by step: tool -> (scaled origin) device -> world -> body
        double origin[3], arm[3];
        for (int i = 0; i < 3; i++) {
            origin[i] = scale * tool.position[i];
        }
        pal_quat_rotate(tool.orientation, local, arm);
        for (int i = 0; i < 3; i++) {
            origin[i] += arm[i];
        }
        pal_pose_apply(&device, origin, world);
        for (int i = 0; i < 3; i++) {
            world[i] -= body.position[i];
        }
        pal_quat_rotate_inverse(body.orientation, world, expect);
        pal_pose_apply(&out, local, got);
        assert_near(got, expect, 10 * EPS);
        // a force keeps its length and comes back
        double force[3] = {uniform(), uniform(), uniform()}, there[3], back[3];
        pal_frames_vector_to_device(&f, force, there);
        pal_frames_vector_to_body(&f, there, back);
        assert_near(back, force, 4 * EPS);
        double a = 0, b = 0;
        for (int i = 0; i < 3; i++) {
            a += force[i] * force[i];
            b += there[i] * there[i];
        }
        assert_true(fabs(a - b) <= 10 * EPS);
    }
}

static void bad_quaternions_and_poses_are_found(void **state) {
    (void)state;
    double zero[4] = {0, 0, 0, 0}, nan[4] = {1, NAN, 0, 0}, inf[4] = {INFINITY, 0, 0, 0}, out[4];
    assert_false(pal_quat_normalize(zero, out));
    assert_true(out[0] == 1.0 && out[1] == 0.0);
    assert_false(pal_quat_normalize(nan, out));
    assert_false(pal_quat_normalize(inf, out));
    pal_pose p = pal_pose_identity();
    assert_true(pal_pose_valid(&p));
    p.position[2] = NAN;
    assert_false(pal_pose_valid(&p));
}

static void slerp_turns_at_constant_rate_the_short_way(void **state) {
    (void)state;
    double a[4] = {1, 0, 0, 0}, half = 0.6;
    double b[4] = {-cos(half), 0, 0, -sin(half)}; // minus: the long way round unless flipped
    for (int i = 0; i <= 10; i++) {
        double s = 0.1 * i, q[4];
        pal_quat_slerp(a, b, s, q);
        assert_true(fabs(q[0] - cos(s * half)) < EPS && fabs(q[3] - sin(s * half)) < EPS);
    }
    double q[4];
    pal_quat_slerp(a, a, 0.3, q);
    assert_true(q[0] == 1.0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rotation_equals_the_matrix_and_back),
        cmocka_unit_test(compose_inverse_and_apply_agree),
        cmocka_unit_test(identity_is_exact),
        cmocka_unit_test(chain_is_device_world_body),
        cmocka_unit_test(bad_quaternions_and_poses_are_found),
        cmocka_unit_test(slerp_turns_at_constant_rate_the_short_way),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
