/// The servo thread allocates nothing, takes no lock and does no I/O: calls are trapped by
/// interposition and counted on that thread between its first device read and its last write.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <dlfcn.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/session.h>

#include "tests/support/synthetic_model.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define TRAPS 0
#else
#define TRAPS 1
#endif

static _Thread_local int on_servo;
static _Atomic int trapped;
static _Atomic(const char *) what;

static void trap(const char *name) {
    if (on_servo) {
        atomic_fetch_add(&trapped, 1);
        atomic_store(&what, name);
    }
}

#if TRAPS
// exported, so that the C library's own calls come here as well
PALPATE_API void *malloc(size_t size);
PALPATE_API void *calloc(size_t count, size_t size);
PALPATE_API void *realloc(void *old, size_t size);
// (free stays ours alone: the C library frees what it keeps per thread when the thread ends)
#pragma GCC visibility push(default)

void *__libc_malloc(size_t size);
void *__libc_calloc(size_t count, size_t size);
void *__libc_realloc(void *old, size_t size);
void __libc_free(void *old);

void *malloc(size_t size) {
    trap("malloc");
    return __libc_malloc(size);
}

void *calloc(size_t count, size_t size) {
    trap("calloc");
    return __libc_calloc(count, size);
}

void *realloc(void *old, size_t size) {
    trap("realloc");
    return __libc_realloc(old, size);
}

__attribute__((visibility("hidden"))) void free(void *old) {
    trap("free");
    __libc_free(old);
}

/// The C library's own function behind an interposed name (dlsym each time: simple, and quick
/// enough).
#define REAL(name)                                                                                 \
    __typeof__(&name) real = NULL;                                                                 \
    *(void **)(void *)&real = dlsym(RTLD_NEXT, #name)

int pthread_mutex_lock(pthread_mutex_t *mutex) {
    REAL(pthread_mutex_lock);
    trap("pthread_mutex_lock");
    return real(mutex);
}

int pthread_cond_wait(pthread_cond_t *cond, pthread_mutex_t *mutex) {
    REAL(pthread_cond_wait);
    trap("pthread_cond_wait");
    return real(cond, mutex);
}

ssize_t write(int fd, const void *data, size_t size) {
    REAL(write);
    trap("write");
    return real(fd, data, size);
}

ssize_t pwrite(int fd, const void *data, size_t size, off_t offset) {
    REAL(pwrite);
    trap("pwrite");
    return real(fd, data, size, offset);
}

ssize_t read(int fd, void *data, size_t size) {
    REAL(read);
    trap("read");
    return real(fd, data, size);
}
#pragma GCC visibility pop
#endif

/// A device that marks its thread as the servo's.
typedef struct marker {
    pal_device inner;
    pal_session *session;
    int64_t reads, stop_at;
    int misbehave; ///< allocate and lock in read: the trap must see it
} marker;

static pal_status mark_read(void *self, int64_t time_ns, pal_tool_state *state) {
    marker *m = self;
    on_servo = 1;
    m->reads++;
    if (m->misbehave && m->reads == 3) {
        static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
        pthread_mutex_lock(&mutex);
        void *volatile p = malloc(17);
        free(p);
        pthread_mutex_unlock(&mutex);
    }
    if (m->reads == m->stop_at) {
        pal_session_request_stop(m->session); // the loop's own end is watched as well
    }
    return m->inner.read(m->inner.self, time_ns, state);
}

static int run(int freewheel, int misbehave) {
    synthetic_params p = synthetic_default_params();
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    pal_tool_def tool = pal_model_runtime(model)->tools[0];
    tool.device.kind = PALPATE_DEVICE_SCRIPTED;
    tool.device.stroke =
        (pal_stroke){.kind = PALPATE_STROKE_PALPATION, .depth = 0.003, .ramp = 0.1, .period = 0.2};
    char path[40] = "/tmp/palpate-calls-XXXXXX"; // room for ".xdmf"
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    close(fd);
    marker m = {.stop_at = 300, .misbehave = misbehave};
    pal_session_def def = pal_session_default_def();
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.freewheel = freewheel;
    def.record_path = path; // with recorder and renderer at work
    assert_int_equal(pal_device_create(&tool, 1e-3, &m.inner, NULL), PALPATE_OK);
    def.devices[0] = (pal_device){.abi = PALPATE_DEVICE_ABI, .self = &m, .read = mark_read};
    pal_error e = {0};
    if (pal_session_create(model, &def, &m.session, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    atomic_store(&trapped, 0);
    atomic_store(&what, "");
    assert_int_equal(pal_session_start(m.session, &e), PALPATE_OK);
    assert_int_equal(pal_session_finish(m.session, &e), PALPATE_OK);
    int calls = atomic_load(&trapped);
    pal_session_report r;
    pal_session_get_report(m.session, &r);
    assert_int_equal(r.ticks, 300);
    assert_true(r.counts.contact_ticks > 10); // it did touch
    pal_session_free(m.session);
    m.inner.close(m.inner.self);
    pal_model_free(model);
    (void)unlink(path);
    strcat(path, ".xdmf");
    (void)unlink(path);
    return calls;
}

static void the_servo_thread_calls_nothing_it_must_not(void **state) {
    (void)state;
    if (!TRAPS) {
        skip(); // sanitizers interpose the same functions
    }
    for (int freewheel = 0; freewheel < 2; freewheel++) {
        int calls = run(freewheel, 0);
        if (calls != 0) {
            fail_msg("%d calls on the servo thread, the last: %s", calls, atomic_load(&what));
        }
    }
}

static void the_trap_works(void **state) {
    (void)state;
    if (!TRAPS) {
        skip();
    }
    assert_int_equal(run(1, 1), 3); // lock, malloc, free
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_servo_thread_calls_nothing_it_must_not),
        cmocka_unit_test(the_trap_works),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
