/// History ring and queue: order, overwriting, fullness, and no torn record under a running writer.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdlib.h>
#include <string.h>
#include <sys/time.h>

#include <cmocka.h>

#include "haptic/session/ring.h"

/// A record whose every word follows from n: a torn one betrays itself.
static pal_tick_record numbered(uint64_t n) {
    pal_tick_record r;
    uint64_t word[PALPATE_RECORD_WORDS];
    for (int w = 0; w < PALPATE_RECORD_WORDS; w++) {
        word[w] = n;
    }
    memcpy(&r, word, sizeof r);
    return r;
}

static int whole(const pal_tick_record *r) {
    uint64_t word[PALPATE_RECORD_WORDS];
    memcpy(word, r, sizeof word);
    for (int w = 1; w < PALPATE_RECORD_WORDS; w++) {
        if (word[w] != word[0]) {
            return 0;
        }
    }
    return 1;
}

static void the_ring_keeps_the_newest_in_order(void **state) {
    (void)state;
    pal_ring ring = {0};
    assert_int_equal(pal_ring_init(&ring, 7), PALPATE_OK);
    pal_tick_record out[20];
    assert_int_equal(pal_ring_copy(&ring, out, 20), 0);
    for (uint64_t n = 0; n < 30; n++) {
        pal_tick_record r = numbered(n);
        pal_ring_push(&ring, &r);
        int32_t want = n + 1 < 7 ? (int32_t)n + 1 : 7;
        assert_int_equal(pal_ring_copy(&ring, out, 20), want);
        for (int32_t i = 0; i < want; i++) {
            assert_int_equal(out[i].tick, n - (uint64_t)(want - 1 - i));
            assert_true(whole(&out[i]));
        }
    }
    assert_int_equal(pal_ring_copy(&ring, out, 3), 3); // fewer: the newest of them
    assert_int_equal(out[0].tick, 27);
    assert_int_equal(out[2].tick, 29);
    assert_int_equal(pal_ring_copy(&ring, out, 0), 0);
    pal_ring_clear(&ring);
}

enum { STRESS = 300000 };

static void *ring_writer(void *arg) {
    for (uint64_t n = 1; n <= STRESS; n++) {
        pal_tick_record r = numbered(n);
        pal_ring_push(arg, &r);
    }
    return NULL;
}

/// One slot: every copy races the next record into it. Sixteen: order as well.
static void no_torn_record(int64_t capacity) {
    pal_ring ring = {0};
    assert_int_equal(pal_ring_init(&ring, capacity), PALPATE_OK);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, ring_writer, &ring), 0);
    pal_tick_record out[16];
    uint64_t newest = 0;
    int torn = 0, disorder = 0;
    while (newest < STRESS) {
        int32_t n = pal_ring_copy(&ring, out, 16);
        for (int32_t i = 0; i < n; i++) {
            torn += !whole(&out[i]);
            disorder += i > 0 && out[i].tick <= out[i - 1].tick;
        }
        newest = n > 0 ? out[n - 1].tick : newest;
        if (n == 0) {
            sched_yield();
        }
    }
    pthread_join(thread, NULL);
    assert_int_equal(torn, 0);
    assert_int_equal(disorder, 0);
    pal_ring_clear(&ring);
}

static void a_reader_sees_no_torn_record(void **state) {
    (void)state;
    no_torn_record(1);
    no_torn_record(16);
}

static pal_ring *interrupted;
static volatile sig_atomic_t pushes;

static void push_one(int number) {
    (void)number;
    pal_tick_record r = numbered((uint64_t)++pushes);
    pal_ring_push(interrupted, &r);
}

/// The writer comes in the middle of a copy, whatever the machine is doing: a signal handler of the
/// reading thread.
static void a_copy_interrupted_by_the_writer_is_left_out(void **state) {
    (void)state;
    enum { PUSHES = 4000, COPIES = 20000000 }; // the latter where a sanitizer holds signals back
    pal_ring ring = {0};
    assert_int_equal(pal_ring_init(&ring, 1), PALPATE_OK);
    interrupted = &ring;
    struct sigaction action = {.sa_handler = push_one, .sa_flags = SA_RESTART};
    const struct itimerval often = {{0, 50}, {0, 50}}, never = {{0, 0}, {0, 0}};
    assert_int_equal(sigaction(SIGALRM, &action, NULL), 0);
    assert_int_equal(setitimer(ITIMER_REAL, &often, NULL), 0);
    int torn = 0, left_out = 0;
    for (int k = 0; k < COPIES && pushes < PUSHES; k++) {
        pal_tick_record out;
        int32_t n = pal_ring_copy(&ring, &out, 1);
        torn += n == 1 && !whole(&out);
        left_out += n == 0;
    }
    assert_int_equal(setitimer(ITIMER_REAL, &never, NULL), 0);
    action.sa_handler = SIG_IGN; // one may still be on its way
    assert_int_equal(sigaction(SIGALRM, &action, NULL), 0);
    print_message("  %d pushes, %d copies left out\n", (int)pushes, left_out);
    assert_int_equal(torn, 0);
    pal_ring_clear(&ring);
}

static void the_queue_is_full_when_it_is_full(void **state) {
    (void)state;
    pal_queue q = {0};
    assert_int_equal(pal_queue_init(&q, 5), PALPATE_OK); // rounded up to 8
    const pal_tick_record *front = NULL;
    assert_int_equal(pal_queue_peek(&q, &front), 0);
    uint64_t pushed = 0, read = 0;
    for (int round = 0; round < 50; round++) {
        pal_tick_record r = numbered(pushed);
        while (pal_queue_push(&q, &r)) {
            r = numbered(++pushed);
        }
        assert_int_equal(pushed - read, 8);
        int64_t n = pal_queue_peek(&q, &front);
        assert_true(n >= 1 && n <= 8);
        int64_t take = 1 + round % n; // leaves some: the border of the array moves round
        for (int64_t i = 0; i < take; i++) {
            assert_int_equal(front[i].tick, read++);
        }
        pal_queue_drop(&q, take);
    }
    pal_queue_clear(&q);
}

static void *queue_writer(void *arg) {
    for (uint64_t n = 0; n < STRESS; n++) {
        pal_tick_record r = numbered(n);
        while (!pal_queue_push(arg, &r)) {
            sched_yield();
        }
    }
    return NULL;
}

static void the_queue_loses_nothing_between_threads(void **state) {
    (void)state;
    pal_queue q = {0};
    assert_int_equal(pal_queue_init(&q, 64), PALPATE_OK);
    pthread_t thread;
    assert_int_equal(pthread_create(&thread, NULL, queue_writer, &q), 0);
    uint64_t next = 0;
    int wrong = 0;
    while (next < STRESS) {
        const pal_tick_record *front = NULL;
        int64_t n = pal_queue_peek(&q, &front);
        for (int64_t i = 0; i < n; i++) {
            wrong += front[i].tick != next++ || !whole(&front[i]);
        }
        pal_queue_drop(&q, n);
        if (n == 0) {
            sched_yield();
        }
    }
    pthread_join(thread, NULL);
    assert_int_equal(wrong, 0);
    pal_queue_clear(&q);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_ring_keeps_the_newest_in_order),
        cmocka_unit_test(a_reader_sees_no_torn_record),
        cmocka_unit_test(a_copy_interrupted_by_the_writer_is_left_out),
        cmocka_unit_test(the_queue_is_full_when_it_is_full),
        cmocka_unit_test(the_queue_loses_nothing_between_threads),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
