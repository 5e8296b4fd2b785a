/// Pacing of the field under overload, on made-up times: no clock, no luck.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>

#include "haptic/session/pace.h"

enum { PERIOD = 1000000, LEFT = 950000 };

typedef struct tally {
    int run, overrun;
} tally;

/// Fields that take `took` each while `left` is there, for `ticks` ticks.
static tally play(pal_pace *p, int ticks, int64_t took, int64_t left) {
    tally t = {0, 0};
    for (int i = 0; i < ticks; i++) {
        if (pal_pace_allows(p, left)) {
            pal_pace_ran(p, took, left);
            t.run++;
            t.overrun += took > left;
        }
    }
    return t;
}

static void a_field_that_fits_always_runs(void **state) {
    (void)state;
    pal_pace p;
    pal_pace_init(&p, PERIOD);
    tally t = play(&p, 10000, 900000, LEFT);
    assert_int_equal(t.run, 10000);
    assert_int_equal(t.overrun, 0);
}

static void a_hopeless_field_costs_about_one_tick_a_second(void **state) {
    (void)state;
    static const int64_t took[] = {1000000, 1500000, 5000000, 40000000};
    for (int i = 0; i < 4; i++) {
        pal_pace p;
        pal_pace_init(&p, PERIOD);
        tally t = play(&p, 60000, took[i], LEFT); // a minute
        assert_int_equal(t.run, t.overrun);
        // ten while the wait doubles up to a second, then one a second at most
        assert_true(t.overrun >= 20 && t.overrun <= 70);
    }
}

static void a_spike_does_not_freeze_the_picture(void **state) {
    (void)state;
    pal_pace p;
    pal_pace_init(&p, PERIOD);
    (void)play(&p, 100, 500000, LEFT);
    pal_pace_ran(&p, 20000000, LEFT); // the host took the core for 20 ms
    int skipped = 0;
    while (!pal_pace_allows(&p, LEFT)) {
        skipped++;
    }
    assert_true(skipped <= 60); // from two periods down by 1/64 a tick: 2 frames of 30 Hz
    pal_pace_ran(&p, 500000, LEFT);
    assert_int_equal(play(&p, 1000, 500000, LEFT).run, 1000);
}

static void spikes_do_not_add_up(void **state) {
    (void)state;
    pal_pace p;
    pal_pace_init(&p, PERIOD);
    int run = 0;
    for (int i = 0; i < 60000; i++) {
        if (pal_pace_allows(&p, LEFT)) {
            pal_pace_ran(&p, i % 1000 == 0 ? 20000000 : 500000, LEFT); // one a second
            run++;
        }
    }
    assert_true(run > 54000); // 90 %: each spike costs at most 60 ticks and is then forgotten
}

static void a_field_that_fits_again_is_back_within_a_second_or_so(void **state) {
    (void)state;
    pal_pace p;
    pal_pace_init(&p, PERIOD);
    (void)play(&p, 60000, 3000000, LEFT);
    tally t = play(&p, 1200, 400000, LEFT);
    assert_true(t.run > 0);
    assert_int_equal(play(&p, 1000, 400000, LEFT).run, 1000);
}

static void no_time_left_means_no_field(void **state) {
    (void)state;
    pal_pace p;
    pal_pace_init(&p, PERIOD);
    assert_int_equal(play(&p, 1000, 1, 0).run, 0);
    assert_int_equal(play(&p, 1000, 1, -5).run, 0);
    assert_int_equal(play(&p, 10, 1, 10).run, 10);
    // free calls (no reader wants a frame) between expensive ones do not hide an overrun
    pal_pace_init(&p, PERIOD);
    int overrun = 0;
    for (int i = 0; i < 60000; i++) {
        if (pal_pace_allows(&p, LEFT)) {
            int64_t took = i % 4 == 0 ? 1500000 : 300;
            pal_pace_ran(&p, took, LEFT);
            overrun += took > LEFT;
        }
    }
    assert_true(overrun <= 70);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_field_that_fits_always_runs),
        cmocka_unit_test(a_hopeless_field_costs_about_one_tick_a_second),
        cmocka_unit_test(a_spike_does_not_freeze_the_picture),
        cmocka_unit_test(spikes_do_not_add_up),
        cmocka_unit_test(a_field_that_fits_again_is_back_within_a_second_or_so),
        cmocka_unit_test(no_time_left_means_no_field),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
