/// Trajectory CSV: located errors, interpolation in time, slerp, round trip.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <locale.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "haptic/base/pose.h"
#include "haptic/device/stroke.h"
#include "haptic/device/trajectory.h"

#define HEAD "time,x,y,z,qw,qx,qy,qz,button\n"

static pal_status parse(const char *text, pal_trajectory *t, pal_error *e) {
    memset(e, 0, sizeof *e);
    return pal_trajectory_parse("t.csv", text, strlen(text), t, e);
}

static void good_files_are_read(void **state) {
    (void)state;
    static const char *const good[] = {
        HEAD "0,0.1,-2e-3,+3,1,0,0,0,0\n1,0.1,0.2,0.3,1,0,0,0,5\n",
        HEAD "0,0.1,-2e-3,+3,1,0,0,0,0\n1,0.1,0.2,0.3,1,0,0,0,5", // no newline at the end
        "time, x ,y,\tz,qw,qx,qy,qz,button\r\n0,0.1,-2e-3, 3 "
        ",1,0,0,0,0\r\n1,0.1,0.2,0.3,1,0,0,0,5\r\n",
        "# comment\n\n" HEAD "#x\n0,0.1,-2e-3,3,1,0,0,0,0\n   \n1,0.1,0.2,0.3,1,0,0,0,5\n\n",
        "\xEF\xBB\xBF" HEAD "0,0.1,-.002,3.,1,0,0,0,0\n1,0.1,0.2,0.3,1,0,0,0,5\n",
    };
    for (size_t i = 0; i < sizeof good / sizeof *good; i++) {
        pal_trajectory t;
        pal_error e;
        if (parse(good[i], &t, &e) != PALPATE_OK) {
            fail_msg("case %zu: %s", i, e.message);
        }
        assert_int_equal(t.count, 2);
        assert_true(t.sample[0].position[0] == 0.1 && t.sample[0].position[1] == -0.002);
        assert_true(t.sample[0].position[2] == 3.0);
        assert_int_equal(t.sample[1].buttons, 5);
        pal_trajectory_clear(&t);
    }
}

/// Each bad file with the place and the words its message must hold.
static void bad_files_are_refused_with_the_place(void **state) {
    (void)state;
    static const struct {
        const char *text, *place, *word;
    } bad[] = {
        {"", "t.csv:1:1:", "empty"},
        {"\n\n# only a comment\n", "t.csv:1:1:", "empty"},
        {"0,0,0,0,1,0,0,0,0\n", "t.csv:1:1:", "header"},
        {"time,x,y,z,qw,qx,qy,qz\n", "t.csv:1:21:", "header"},
        {"time,x,y,z,qx,qy,qz,qw,button\n", "t.csv:1:12:", "header"},
        {HEAD, "t.csv:2:1:", "none"},
        {HEAD "0,0,0,0,1,0,0,0\n", "t.csv:2:16:", "button"},
        {HEAD "0,0,0,0,1,0,0,0,0,7\n", "t.csv:2:18:", "ninth"},
        {HEAD "0,0,0,0,1,0,0,0,\n", "t.csv:2:17:", "button"},
        {HEAD "0,0.5x,0,0,1,0,0,0,0\n", "t.csv:2:3:", "0.5x"},
        {HEAD "0,nan,0,0,1,0,0,0,0\n", "t.csv:2:3:", "nan"},
        {HEAD "0,0,inf,0,1,0,0,0,0\n", "t.csv:2:5:", "inf"},
        {HEAD "0,0,0,1e999,1,0,0,0,0\n", "t.csv:2:7:", "1e999"},
        {HEAD "0,0x10,0,0,1,0,0,0,0\n", "t.csv:2:3:", "0x10"},
        {HEAD "0,1 2,0,0,1,0,0,0,0\n", "t.csv:2:3:", "1 2"},
        {HEAD "0,1e7,0,0,1,0,0,0,0\n", "t.csv:2:3:", "1e6"},
        {HEAD "-1,0,0,0,1,0,0,0,0\n", "t.csv:2:1:", "increasing"},
        {HEAD "1,0,0,0,1,0,0,0,0\n1,0,0,0,1,0,0,0,0\n", "t.csv:3:1:", "increasing"},
        {HEAD "1,0,0,0,1,0,0,0,0\n\n0.5,0,0,0,1,0,0,0,0\n", "t.csv:4:1:", "increasing"},
        {HEAD "0,0,0,0,0,0,0,0,0\n", "t.csv:2:9:", "unit quaternion"},
        {HEAD "0,0,0,0,1,1,0,0,0\n", "t.csv:2:9:", "unit quaternion"},
        {HEAD "0,0,0,0,1,0,0,0,1.5\n", "t.csv:2:17:", "whole"},
        {HEAD "0,0,0,0,1,0,0,0,-1\n", "t.csv:2:17:", "whole"},
        {HEAD "0,0,0,0,1,0,0,0,4294967296\n", "t.csv:2:17:", "whole"},
        {HEAD "0,;drop\x01table-and-a-very-long-piece-of-nonsense-beyond-forty,0,0,1,0,0,0,0\n",
         "t.csv:2:3:", "..."},
    };
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        pal_trajectory t;
        pal_error e;
        assert_int_equal(parse(bad[i].text, &t, &e), PALPATE_ERROR_SCENE);
        if (strncmp(e.message, bad[i].place, strlen(bad[i].place)) != 0 ||
            strstr(e.message, bad[i].word) == NULL) {
            fail_msg("case %zu: wanted '%s ... %s', got '%s'", i, bad[i].place, bad[i].word,
                     e.message);
        }
        assert_null(t.sample);
    }
}

static void a_nul_byte_is_not_the_end(void **state) {
    (void)state;
    static const char text[] = HEAD "0,0,0,0,1,0,0,0,0\n1,0\0,0,0,1,0,0,0,0\n";
    pal_trajectory t;
    pal_error e = {0};
    assert_int_equal(pal_trajectory_parse("t.csv", text, sizeof text - 1, &t, &e),
                     PALPATE_ERROR_SCENE);
    assert_non_null(strstr(e.message, "t.csv:3:3: x:"));
}

static void unreadable_files_are_refused(void **state) {
    (void)state;
    pal_trajectory t;
    pal_error e = {0};
    assert_int_equal(pal_trajectory_load("/nonexistent/t.csv", &t, &e), PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "/nonexistent/t.csv"));
    assert_int_equal(pal_trajectory_load("/", &t, &e), PALPATE_ERROR_IO);
    assert_int_equal(pal_trajectory_load("/dev/zero", &t, &e), PALPATE_ERROR_IO); // endless
}

/// A host in a locale with decimal commas must not change how the file is read.
static void the_locale_does_not_matter(void **state) {
    (void)state;
    char *old = setlocale(LC_NUMERIC, NULL);
    static const char *const comma[] = {"de_DE.UTF-8", "fr_FR.UTF-8", "de_DE"};
    int have = 0;
    for (size_t i = 0; i < 3 && !have; i++) {
        have = setlocale(LC_NUMERIC, comma[i]) != NULL;
    }
    if (!have) {
        skip(); // no such locale installed
    }
    pal_trajectory t;
    pal_error e;
    assert_int_equal(parse(HEAD "0.5,0.25,0,0,1,0,0,0,0\n", &t, &e), PALPATE_OK);
    assert_true(t.sample[0].position[0] == 0.25);
    pal_trajectory_clear(&t);
    setlocale(LC_NUMERIC, old);
}

static void positions_are_linear_and_ends_hold(void **state) {
    (void)state;
    pal_trajectory t;
    pal_error e;
    assert_int_equal(
        parse(HEAD "1,0,0,0,1,0,0,0,3\n2,1,-2,4,1,0,0,0,7\n4,1,0,0,1,0,0,0,0\n", &t, &e),
        PALPATE_OK);
    static const struct {
        double time, x, y, z;
        uint32_t buttons;
    } want[] = {
        {-5, 0, 0, 0, 3},         {1, 0, 0, 0, 3},  {1.25, 0.25, -0.5, 1, 3},
        {1.75, 0.75, -1.5, 3, 3}, {2, 1, -2, 4, 7}, {3, 1, -1, 2, 7},
        {3.5, 1, -0.5, 1, 7},     {4, 1, 0, 0, 0},  {1e9, 1, 0, 0, 0},
    };
    for (size_t i = 0; i < sizeof want / sizeof *want; i++) {
        pal_tool_state s;
        pal_trajectory_at(&t, want[i].time, &s);
        // values are small dyadic numbers: exact
        assert_true(s.position[0] == want[i].x && s.position[1] == want[i].y &&
                    s.position[2] == want[i].z);
        assert_int_equal(s.buttons, want[i].buttons);
    }
    pal_trajectory_clear(&t);
}

static void orientation_turns_at_constant_rate_by_the_shorter_arc(void **state) {
    (void)state;
    // a turn of 100 degrees about z, the second sample with its sign flipped (same rotation)
    const double a = 100.0 * acos(-1.0) / 180.0;
    const double from[4] = {1, 0, 0, 0}, to[4] = {-cos(a / 2), 0, 0, -sin(a / 2)};
    for (int i = 0; i <= 20; i++) {
        double s = i / 20.0, q[4];
        pal_quat_slerp(from, to, s, q);
        // rounding of a few operations on unit numbers
        assert_true(fabs(q[0] - cos(s * a / 2)) < 1e-15 && fabs(q[3] - sin(s * a / 2)) < 1e-15);
        assert_true(q[1] == 0 && q[2] == 0);
    }
    // nearly equal: the sines cancel, the result must stay unit and between
    const double b = 1e-7, near[4] = {cos(b), sin(b), 0, 0};
    double q[4];
    pal_quat_slerp(from, near, 0.5, q);
    assert_true(fabs(q[1] - b / 2) < 1e-20 && fabs(q[0] - 1.0) < 1e-14);
    // a quarter turn through the file
    pal_trajectory t;
    pal_error e;
    assert_int_equal(parse(HEAD "0,0,0,0,1,0,0,0,0\n1,0,0,0,0.70710678,0.70710678,0,0,0\n", &t, &e),
                     PALPATE_OK);
    pal_tool_state s;
    pal_trajectory_at(&t, 0.5, &s);
    // 1e-8: the file's digits
    assert_true(fabs(s.orientation[0] - cos(acos(-1.0) / 8)) < 1e-8);
    pal_trajectory_clear(&t);
}

static void writing_and_reading_gives_the_same_motion(void **state) {
    (void)state;
    const pal_stroke stroke = {.kind = PALPATE_STROKE_PALPATION,
                               .depth = 0.004,
                               .ramp = 0.5,
                               .period = 1.1,
                               .tremor_amplitude = 2e-4,
                               .tremor_frequency = 10};
    const double start[3] = {0.01, -0.02, 0.05}, axis[3] = {0.6, 0, -0.8};
    pal_stroke_path path;
    pal_trajectory t, back;
    pal_error e = {0};
    assert_int_equal(pal_stroke_bind("p", &stroke, start, axis, &path, &e), PALPATE_OK);
    assert_int_equal(pal_stroke_sample(&path, 2.0, 100, &t, &e), PALPATE_OK);
    assert_int_equal(t.count, 201);
    char name[] = "/tmp/palpate-trajectory-XXXXXX";
    int fd = mkstemp(name);
    assert_true(fd >= 0);
    FILE *file = fdopen(fd, "w");
    assert_int_equal(pal_trajectory_write(&t, file, &e), PALPATE_OK);
    fclose(file);
    if (pal_trajectory_load(name, &back, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    unlink(name);
    assert_int_equal(back.count, t.count);
    for (int64_t i = 0; i < t.count; i++) {
        assert_true(fabs(back.sample[i].time - t.sample[i].time) < 1e-8);
        for (int k = 0; k < 3; k++) { // written to 0.01 um
            assert_true(fabs(back.sample[i].position[k] - t.sample[i].position[k]) <= 0.5001e-8);
        }
        for (int k = 0; k < 4; k++) {
            assert_true(fabs(back.sample[i].orientation[k] - t.sample[i].orientation[k]) < 1e-8);
        }
    }
    pal_trajectory_clear(&t);
    pal_trajectory_clear(&back);
    // a full disk is an error, not a silent short file
    FILE *full = fopen("/dev/full", "w");
    if (full != NULL) {
        pal_trajectory one = {.count = 1, .sample = (pal_sample[1]){{.orientation = {1}}}};
        assert_int_equal(pal_trajectory_write(&one, full, &e), PALPATE_ERROR_IO);
        fclose(full);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(good_files_are_read),
        cmocka_unit_test(bad_files_are_refused_with_the_place),
        cmocka_unit_test(a_nul_byte_is_not_the_end),
        cmocka_unit_test(unreadable_files_are_refused),
        cmocka_unit_test(the_locale_does_not_matter),
        cmocka_unit_test(positions_are_linear_and_ends_hold),
        cmocka_unit_test(orientation_turns_at_constant_rate_by_the_shorter_arc),
        cmocka_unit_test(writing_and_reading_gives_the_same_motion),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
