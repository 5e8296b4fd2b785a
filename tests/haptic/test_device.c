/// Devices behind pal_device_create: one conformance list for all, then each one's own motion.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/session.h>

static pal_tool_def make_tool(pal_device_kind kind) {
    pal_tool_def t = {.name = "probe",
                      .shape = PALPATE_SHAPE_SPHERE,
                      .radius = 0.004,
                      .has_start = 1,
                      .start = {0.01, 0.02, 0.054},
                      .axis = {0, 0, -1}};
    t.device.kind = kind;
    t.device.simulated = pal_simulated_default(PALPATE_SIMULATED_TOUCH, PALPATE_GRIP_FIRM);
    t.device.stroke = (pal_stroke){.kind = PALPATE_STROKE_PRESS,
                                   .depth = 0.005,
                                   .ramp = 1,
                                   .period = 2,
                                   .amplitude = 0.01,
                                   .direction = {1, 0, 0}};
    return t;
}

static pal_device make(const pal_tool_def *tool) {
    pal_device d;
    pal_error e = {0};
    if (pal_device_create(tool, 1e-3, &d, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    return d;
}

static pal_tool_state at(const pal_device *d, double time) {
    pal_tool_state s;
    assert_int_equal(d->read(d->self, (int64_t)llround(time * 1e9), &s), PALPATE_OK);
    return s;
}

static char csv_path[64];

static int write_csv(void **state) {
    (void)state;
    (void)snprintf(csv_path, sizeof csv_path, "/tmp/palpate-device-XXXXXX");
    int fd = mkstemp(csv_path);
    static const char text[] =
        "time,x,y,z,qw,qx,qy,qz,button\n0,0,0,0.054,1,0,0,0,0\n2,0,0,0.05,1,0,0,0,1\n";
    return fd < 0 || write(fd, text, sizeof text - 1) != (ssize_t)(sizeof text - 1) ||
           close(fd) != 0;
}

static int remove_csv(void **state) {
    (void)state;
    return unlink(csv_path);
}

/// What every device owes the servo, whatever it is.
static void conforms(pal_device *d) {
    assert_int_equal(d->abi, PALPATE_DEVICE_ABI);
    assert_true(d->spec.name[0] != 0);
    assert_non_null(d->read);
    if (d->open != NULL) {
        assert_int_equal(d->open(d->self, NULL), PALPATE_OK);
    }
    for (int i = 0; i < 3000; i++) {
        double t = i * 1e-3;
        pal_tool_state s = at(d, t), again = at(d, t);
        double norm = 0;
        for (int k = 0; k < 3; k++) {
            assert_true(isfinite(s.position[k]));
        }
        for (int k = 0; k < 4; k++) {
            norm += s.orientation[k] * s.orientation[k];
        }
        assert_true(fabs(norm - 1.0) < 1e-12); // unit to rounding
        assert_int_equal(s.time_ns, llround(t * 1e9));
        assert_memory_equal(&s, &again, sizeof s); // a function of time alone
        if (d->write != NULL) {
            pal_tool_force f = {0};
            assert_int_equal(d->write(d->self, s.time_ns, &f), PALPATE_OK);
        }
    }
    d->close(d->self);
}

static void every_device_conforms(void **state) {
    (void)state;
    static const pal_device_kind kinds[] = {PALPATE_DEVICE_NULL, PALPATE_DEVICE_REPLAY,
                                            PALPATE_DEVICE_SCRIPTED, PALPATE_DEVICE_SIMULATED};
    for (size_t i = 0; i < 4; i++) {
        pal_tool_def t = make_tool(kinds[i]);
        (void)snprintf(t.device.path, sizeof t.device.path, "%s", csv_path);
        pal_device d = make(&t);
        conforms(&d);
    }
    pal_device host;
    assert_int_equal(pal_device_host_create(NULL, &host, NULL), PALPATE_OK);
    conforms(&host);
}

static void what_cannot_be_made_is_refused(void **state) {
    (void)state;
    pal_device d;
    pal_error e = {0};
    pal_tool_def t = make_tool(PALPATE_DEVICE_NONE);
    assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "probe"));
    t = make_tool(PALPATE_DEVICE_SIMULATED); // no figures: a mass of 0
    t.device.simulated.mass = 0.0;
    assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "mass"));
    t = make_tool((pal_device_kind)77);
    assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
    t = make_tool(PALPATE_DEVICE_REPLAY);
    (void)snprintf(t.device.path, sizeof t.device.path, "/nonexistent.csv");
    assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "/nonexistent.csv"));
    t = make_tool(PALPATE_DEVICE_SCRIPTED);
    t.has_start = 0;
    assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_device_create(&t, 0.0, &d, &e), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_device_create(NULL, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
    // one impossible number at a time
    for (int i = 0; i < 7; i++) {
        t = make_tool(PALPATE_DEVICE_SCRIPTED);
        t.device.stroke.kind = PALPATE_STROKE_CIRCLE;
        pal_stroke *s = &t.device.stroke;
        double *value[] = {&s->depth,           &s->ramp,      &s->ramp,
                           &s->period,          &s->amplitude, &t.axis[2],
                           &s->tremor_frequency};
        const double wrong[] = {NAN, -1, 0, 0, -0.1, 0, INFINITY};
        *value[i] = wrong[i];
        assert_int_equal(pal_device_create(&t, 1e-3, &d, &e), PALPATE_ERROR_ARGUMENT);
        assert_non_null(strstr(e.message, "probe"));
    }
}

static void replay_knows_its_length(void **state) {
    (void)state;
    pal_tool_def t = make_tool(PALPATE_DEVICE_REPLAY);
    (void)snprintf(t.device.path, sizeof t.device.path, "%s", csv_path);
    pal_device d = make(&t);
    assert_true(pal_device_duration(&d) == 2.0);
    assert_true(fabs(at(&d, 1.0).position[2] - 0.052) < 1e-15);
    assert_int_equal(at(&d, 1.999).buttons, 0);
    assert_int_equal(at(&d, 2.5).buttons, 1);
    d.close(d.self);
    t = make_tool(PALPATE_DEVICE_SCRIPTED);
    d = make(&t);
    assert_true(pal_device_duration(&d) < 0.0);
    d.close(d.self);
}

static void strokes_are_what_they_say(void **state) {
    (void)state;
    const double eps = 1e-12; // rounding of sines on metres
    pal_tool_def t = make_tool(PALPATE_DEVICE_SCRIPTED);
    pal_device d = make(&t); // press: 5 mm down in 1 s, then still
    assert_true(fabs(at(&d, 0.0).position[2] - 0.054) < eps);
    assert_true(fabs(at(&d, 0.5).position[2] - 0.0515) < eps);
    assert_true(fabs(at(&d, 1.0).position[2] - 0.049) < eps);
    assert_true(fabs(at(&d, 9.0).position[2] - 0.049) < eps);
    assert_true(at(&d, 0.3).position[0] == 0.01 && at(&d, 9.0).orientation[0] == 1.0);
    d.close(d.self);

    t.device.stroke.kind = PALPATE_STROKE_SLIDE; // 10 mm to either side, period 2 s
    t.device.stroke.direction[2] = 5.0;          // the part along the axis is taken out
    d = make(&t);
    assert_true(fabs(at(&d, 3.5).position[0] - 0.02) <
                eps); // a quarter period after the second ramp
    assert_true(fabs(at(&d, 4.5).position[0] - 0.0) < eps);
    assert_true(fabs(at(&d, 3.5).position[2] - 0.049) < eps); // depth kept
    d.close(d.self);

    t.device.stroke.kind = PALPATE_STROKE_CIRCLE;
    d = make(&t);
    for (int i = 0; i < 40; i++) {
        pal_tool_state s = at(&d, 2.0 + 0.05 * i);
        assert_true(fabs(hypot(s.position[0] - 0.01, s.position[1] - 0.02) - 0.01) < eps);
        assert_true(fabs(s.position[2] - 0.049) < eps);
    }
    assert_true(fabs(at(&d, 2.5).position[1] - at(&d, 3.5).position[1]) > 0.019); // it goes round
    d.close(d.self);

    t.device.stroke.kind = PALPATE_STROKE_PALPATION; // in and out every 2 s
    d = make(&t);
    assert_true(fabs(at(&d, 1.0).position[2] - 0.049) < eps);
    assert_true(fabs(at(&d, 2.0).position[2] - 0.054) < eps);
    assert_true(fabs(at(&d, 3.0).position[2] - 0.049) < eps);
    d.close(d.self);
}

/// Any axis: the tool's own axis (local -z) points along it and the press goes along it.
static void strokes_follow_the_axis(void **state) {
    (void)state;
    static const double axes[][3] = {
        {0, 0, -1}, {0, 0, 1}, {1, 0, 0}, {-3, 2, 0.5}, {0, -1e-3, 1e-3}};
    for (size_t i = 0; i < sizeof axes / sizeof *axes; i++) {
        pal_tool_def t = make_tool(PALPATE_DEVICE_SCRIPTED);
        memcpy(t.axis, axes[i], sizeof t.axis);
        pal_device d = make(&t);
        pal_tool_state s = at(&d, 5.0);
        double n = sqrt(t.axis[0] * t.axis[0] + t.axis[1] * t.axis[1] + t.axis[2] * t.axis[2]);
        const double *q = s.orientation;
        // third column of R(q), negated: where local -z points
        const double local[3] = {-2 * (q[1] * q[3] + q[0] * q[2]), -2 * (q[2] * q[3] - q[0] * q[1]),
                                 -(1 - 2 * (q[1] * q[1] + q[2] * q[2]))};
        for (int k = 0; k < 3; k++) {
            assert_true(fabs(local[k] - t.axis[k] / n) < 1e-12);
            assert_true(fabs(s.position[k] - t.start[k] - 0.005 * t.axis[k] / n) < 1e-15);
        }
        d.close(d.self);
    }
}

/// Tremor stays within its amplitude, reaches most of it, and its power lies between 8 and 12 Hz
/// (discrete Fourier transform of 10 s, 0.1 Hz bins, after it has faded in).
static void tremor_is_physiological(void **state) {
    (void)state;
    enum { N = 2000 };
    pal_tool_def t = make_tool(PALPATE_DEVICE_SCRIPTED);
    t.device.stroke.depth = 0.0;
    t.device.stroke.tremor_amplitude = 3e-4;
    t.device.stroke.tremor_frequency = 10.0;
    pal_device d = make(&t);
    static double x[N];
    double peak = 0;
    for (int i = 0; i < N; i++) { // 200 Hz, from 1 s (ramp over) to 11 s
        x[i] = at(&d, 1.0 + i / 200.0).position[0] - t.start[0];
        peak = fmax(peak, fabs(x[i]));
    }
    d.close(d.self);
    assert_true(peak <= 3e-4 && peak > 2.4e-4);
    double inside = 0, total = 0;
    for (int bin = 1; bin < N / 2; bin++) {
        double re = 0, im = 0;
        for (int i = 0; i < N; i++) {
            double w =
                0.5 - 0.5 * cos(2 * acos(-1.0) * i / N); // Hann: no leakage from 8.7 to below 8
            re += w * x[i] * cos(2 * acos(-1.0) * ((double)bin * i / N));
            im += w * x[i] * sin(2 * acos(-1.0) * ((double)bin * i / N));
        }
        double power = re * re + im * im, f = bin * 0.1;
        total += power;
        inside += f >= 8.0 && f <= 12.0 ? power : 0.0;
    }
    assert_true(inside > 0.999 * total);
}

typedef struct shuttle {
    pal_device *device;
    int torn, seen;
} shuttle;

enum { POSES = 200000 };

static void *host_thread(void *arg) {
    shuttle *s = arg;
    for (int i = 1; i <= POSES; i++) { // all numbers of one pose agree: a torn one would not
        pal_pose p = {.position = {i, i, i}, .orientation = {1, 0, 0, 0}};
        pal_device_host_set(s->device, &p, (uint32_t)i);
        pal_tool_force f;
        if (pal_device_host_get(s->device, &f)) {
            s->torn += f.force[0] != f.torque[2] || f.force[0] != f.depth;
        }
    }
    return NULL;
}

static void host_poses_are_whole_and_newest(void **state) {
    (void)state;
    pal_device d;
    pal_pose first = {.position = {-1, -1, -1}, .orientation = {1, 0, 0, 0}};
    assert_int_equal(pal_device_host_create(&first, &d, NULL), PALPATE_OK);
    pal_tool_force f;
    assert_int_equal(pal_device_host_get(&d, &f), 0);
    assert_true(at(&d, 0).position[0] == -1);
    shuttle s = {.device = &d};
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, host_thread, &s), 0);
    double last = -1;
    int torn = 0, backwards = 0;
    for (long tick = 0; last < POSES && tick < 2000000000L; tick++) {
        pal_tool_state p = at(&d, 0);
        torn += p.position[0] != p.position[1] || p.position[0] != p.position[2];
        torn += p.position[0] > 0 && (double)p.buttons != p.position[0];
        backwards += p.position[0] < last;
        last = p.position[0];
        pal_tool_force out = {
            .force = {(double)tick}, .torque = {0, 0, (double)tick}, .depth = (double)tick};
        assert_int_equal(d.write(d.self, 0, &out), PALPATE_OK);
    }
    pthread_join(thread, NULL);
    assert_int_equal(torn, 0);
    assert_int_equal(s.torn, 0);
    assert_int_equal(backwards, 0);
    assert_true(last == POSES); // the last pose given is the one that stays
    assert_int_equal(pal_device_host_get(&d, &f), 1);
    d.close(d.self);
    pal_tool_def null_tool = make_tool(PALPATE_DEVICE_NULL);
    pal_device other = make(&null_tool); // not a host device: ignored, not misread
    pal_device_host_set(&other, &first, 0);
    assert_int_equal(pal_device_host_get(&other, &f), 0);
    assert_true(at(&other, 0).position[0] == 0.01);
    other.close(other.self);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_device_conforms),
        cmocka_unit_test(what_cannot_be_made_is_refused),
        cmocka_unit_test(replay_knows_its_length),
        cmocka_unit_test(strokes_are_what_they_say),
        cmocka_unit_test(strokes_follow_the_axis),
        cmocka_unit_test(tremor_is_physiological),
        cmocka_unit_test(host_poses_are_whole_and_newest),
    };
    return cmocka_run_group_tests(tests, write_csv, remove_csv);
}
