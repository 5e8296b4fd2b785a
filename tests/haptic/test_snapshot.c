/// The triple buffer: order, replacement, and whole frames under a racing writer (run it in TSan).
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/engine/snapshot.h"

enum { FLOATS = 1024, FRAMES = 60000 };

static pal_reader *make(void **memory) {
    pal_reader *reader = aligned_alloc(PALPATE_CACHE_LINE, sizeof *reader);
    *memory = aligned_alloc(PALPATE_CACHE_LINE, pal_snapshot_bytes(FLOATS));
    assert_non_null(reader);
    assert_non_null(*memory);
    pal_snapshot_init(reader, *memory, FLOATS);
    return reader;
}

/// Every value of the frame carries the tick: any mixture of two frames shows.
static void write_frame(pal_reader *reader, uint64_t tick) {
    pal_slot *slot = pal_snapshot_back(reader);
    slot->frame.tick = tick;
    slot->frame.time_ns = (int64_t)tick;
    slot->frame.displacement = slot->displacement;
    for (int i = 0; i < FLOATS; i++) {
        slot->displacement[i] = (float)(tick % 65536);
    }
    for (int t = 0; t < PALPATE_TOOLS_MAX; t++) {
        slot->frame.tool_pose[t].position[1] = (double)tick;
        slot->frame.tool_force[t].force[2] = (double)tick;
    }
    (void)pal_snapshot_publish(reader);
}

static int whole(const pal_frame *frame) {
    float want = (float)(frame->tick % 65536);
    for (int i = 0; i < FLOATS; i++) {
        if (frame->displacement[i] != want) {
            return 0;
        }
    }
    for (int t = 0; t < PALPATE_TOOLS_MAX; t++) {
        if (frame->tool_pose[t].position[1] != (double)frame->tick ||
            frame->tool_force[t].force[2] != (double)frame->tick) {
            return 0;
        }
    }
    return frame->time_ns == (int64_t)frame->tick;
}

static void nothing_then_newest_then_the_same(void **state) {
    (void)state;
    void *memory;
    pal_reader *reader = make(&memory);
    pal_frame frame;
    assert_int_equal(pal_snapshot_take(reader, &frame), -1);
    assert_false(pal_snapshot_unread(reader));
    write_frame(reader, 1);
    assert_true(pal_snapshot_unread(reader));
    assert_int_equal(pal_snapshot_take(reader, &frame), 1);
    assert_int_equal(frame.tick, 1);
    assert_int_equal(pal_snapshot_take(reader, &frame), 0);
    assert_int_equal(frame.tick, 1);
    for (uint64_t t = 2; t < 9; t++) { // the reader sleeps: only the newest is kept
        write_frame(reader, t);
        assert_int_equal(frame.tick, 1);
        assert_true(whole(&frame)); // and the frame it holds is not touched
    }
    assert_int_equal(pal_snapshot_take(reader, &frame), 1);
    assert_int_equal(frame.tick, 8);
    assert_true(whole(&frame));
    free(reader);
    free(memory);
}

static void publish_tells_whether_a_frame_was_replaced(void **state) {
    (void)state;
    void *memory;
    pal_reader *reader = make(&memory);
    pal_frame frame;
    pal_snapshot_back(reader)->frame.tick = 5;
    assert_int_equal(pal_snapshot_publish(reader), 0);
    pal_snapshot_back(reader)->frame.tick = 6;
    assert_int_equal(pal_snapshot_publish(reader), 1);
    assert_int_equal(reader->published, 2);
    assert_int_equal(reader->published_tick, 6);
    assert_int_equal(pal_snapshot_take(reader, &frame), 1);
    pal_snapshot_back(reader)->frame.tick = 7;
    assert_int_equal(pal_snapshot_publish(reader), 0);
    free(reader);
    free(memory);
}

typedef struct race {
    pal_reader *reader[2];
    atomic_int done;
    int torn[2], backwards[2];
    uint64_t taken[2], last[2];
} race;

static void *writer_main(void *arg) {
    race *r = arg;
    for (uint64_t t = 1; t <= FRAMES; t++) {
        for (int k = 0; k < 2; k++) {
            // one reader gets every frame, the other only when it has taken the previous one
            if (k == 0 || !pal_snapshot_unread(r->reader[k]) || t == FRAMES) {
                write_frame(r->reader[k], t);
            }
        }
    }
    atomic_store(&r->done, 1);
    return NULL;
}

typedef struct reader_arg {
    race *r;
    int index;
} reader_arg;

static void *reader_main(void *arg) {
    race *r = ((reader_arg *)arg)->r;
    int k = ((reader_arg *)arg)->index;
    pal_frame frame;
    for (int last_round = 0;;) {
        int fresh = pal_snapshot_take(r->reader[k], &frame);
        if (fresh == 1) {
            r->taken[k]++;
            r->backwards[k] += frame.tick <= r->last[k];
            r->last[k] = frame.tick;
        }
        if (fresh >= 0) {
            r->torn[k] += !whole(&frame);
        }
        if (last_round) {
            return NULL;
        }
        last_round = atomic_load(&r->done); // look once more after the writer ended
    }
}

static void no_torn_frame_under_a_racing_writer(void **state) {
    (void)state;
    race r;
    memset(&r, 0, sizeof r);
    void *memory[2];
    reader_arg arg[2];
    pthread_t thread[3];
    for (int k = 0; k < 2; k++) {
        r.reader[k] = make(&memory[k]);
        arg[k] = (reader_arg){&r, k};
        assert_int_equal(pthread_create(&thread[k], NULL, reader_main, &arg[k]), 0);
    }
    assert_int_equal(pthread_create(&thread[2], NULL, writer_main, &r), 0);
    for (int k = 0; k < 3; k++) {
        assert_int_equal(pthread_join(thread[k], NULL), 0);
    }
    for (int k = 0; k < 2; k++) {
        assert_int_equal(r.torn[k], 0);
        assert_int_equal(r.backwards[k], 0);
        assert_int_equal(r.last[k], FRAMES); // the newest always arrives
        assert_true(r.taken[k] >= 1);
        free(r.reader[k]);
        free(memory[k]);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(nothing_then_newest_then_the_same),
        cmocka_unit_test(publish_tells_whether_a_frame_was_replaced),
        cmocka_unit_test(no_torn_frame_under_a_racing_writer),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
