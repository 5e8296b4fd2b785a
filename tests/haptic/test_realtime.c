/// The tick's contract, proved twice: no allocator, lock, I/O or sleep call is made (interposed in
/// this program), and no system call at all (a child whose kernel kills it for one).
#include <dlfcn.h>
#include <errno.h>
#include <linux/audit.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <pthread.h>
#include <semaphore.h>
#include <setjmp.h>
#include <signal.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/syscall.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>
#include <math.h>

#include "tests/support/engine_rig.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

// ---- Traps --------------------------------------------------------------------------------------

static _Thread_local int armed;
static _Thread_local int trapped;
static _Thread_local const char *first_trapped;

static inline void trap(const char *name) {
    if (armed) {
        trapped++;
        first_trapped = first_trapped == NULL ? name : first_trapped;
    }
}

#if !SANITIZED
// The allocator under its internal names; everything else is looked up before anything is armed.
extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
extern void __libc_free(void *);

void *malloc(size_t n) {
    trap("malloc");
    return __libc_malloc(n);
}
void *calloc(size_t n, size_t m) {
    trap("calloc");
    return __libc_calloc(n, m);
}
void *realloc(void *p, size_t n) {
    trap("realloc");
    return __libc_realloc(p, n);
}
void *aligned_alloc(size_t a, size_t n) {
    trap("aligned_alloc");
    return __libc_memalign(a, n);
}
int posix_memalign(void **out, size_t a, size_t n) {
    trap("posix_memalign");
    *out = __libc_memalign(a, n);
    return *out == NULL ? ENOMEM : 0;
}
void free(void *p) {
    trap("free");
    __libc_free(p);
}

/// name, parameters, arguments: forwards to the next definition.
#define FORWARD_LIST(X)                                                                            \
    X(int, pthread_mutex_lock, (pthread_mutex_t * m), (m))                                         \
    X(int, pthread_mutex_trylock, (pthread_mutex_t * m), (m))                                      \
    X(int, pthread_mutex_unlock, (pthread_mutex_t * m), (m))                                       \
    X(int, pthread_rwlock_rdlock, (pthread_rwlock_t * m), (m))                                     \
    X(int, pthread_rwlock_wrlock, (pthread_rwlock_t * m), (m))                                     \
    X(int, pthread_cond_wait, (pthread_cond_t * c, pthread_mutex_t * m), (c, m))                   \
    X(int, pthread_cond_signal, (pthread_cond_t * c), (c))                                         \
    X(int, pthread_cond_broadcast, (pthread_cond_t * c), (c))                                      \
    X(int, sem_wait, (sem_t * s), (s))                                                             \
    X(int, sem_post, (sem_t * s), (s))                                                             \
    X(ssize_t, write, (int fd, const void *p, size_t n), (fd, p, n))                               \
    X(ssize_t, read, (int fd, void *p, size_t n), (fd, p, n))                                      \
    X(int, nanosleep, (const struct timespec *a, struct timespec *b), (a, b))                      \
    X(int, clock_nanosleep, (clockid_t c, int f, const struct timespec *a, struct timespec *b),    \
      (c, f, a, b))

#define FORWARD(type, name, parameters, arguments)                                                 \
    static type(*next_##name) parameters;                                                          \
    type name parameters {                                                                         \
        trap(#name);                                                                               \
        if (next_##name == NULL) {                                                                 \
            *(void **)(void *)&next_##name = dlsym(RTLD_NEXT, #name);                              \
        }                                                                                          \
        return next_##name arguments;                                                              \
    }
FORWARD_LIST(FORWARD)
#endif

// ---- A busy life for an engine ------------------------------------------------------------------

enum { TICKS = 4000 };

/// Three tools of all shapes that press, slide, grasp, leave, send NaN, and overflow max_contacts.
static void make(rig *r, double skew) {
    rig_model(r, 13, PALPATE_PRECISION_SINGLE, skew);
    r->tools[0].limits = (pal_tool_limits){.force = 0.1, .slew = 0.002, .torque = 1e-4};
    r->tools[1] = (pal_tool_def){.name = "tip", .shape = PALPATE_SHAPE_POINT};
    r->tools[2] = (pal_tool_def){.name = "shaft",
                                 .shape = PALPATE_SHAPE_CAPSULE,
                                 .radius = 0.003,
                                 .length = 0.01,
                                 .limits = {.torque = 1e-6}};
    r->def.tool_count = 3;
    r->def.max_contacts = rig_law == PALPATE_CONTACT_NODES ? 12 : 48; // too few; 16 points a tool
    rig_engine(r);
}

static uint32_t live(rig *r, int *contacts) {
    uint32_t faults = 0;
    pal_frame frame;
    pal_engine_counts counts;
    for (int k = 0; k < TICKS; k++) {
        double a = 2 * 3.14159265358979 * k / 500;
        pal_tool_state in[3];
        in[0] = rig_state(0.004 * cos(a), 0.003 * sin(a), 0.0025 + 0.002 * cos(3 * a));
        in[1] = rig_state(-0.006 + 0.002 * cos(a), 0.004, -0.0005 + 0.001 * sin(a));
        in[2] = rig_state(0.006, -0.004, 0.002 + 0.0015 * sin(a));
        in[2].orientation[0] = in[2].orientation[1] = 0.70710678118654757;
        in[0].buttons = (k / 300) % 3 == 1;
        if (k % 997 == 996) {
            in[1].position[0] = NAN;
        }
        pal_tool_force out[3];
        faults |= pal_engine_tick(r->engine, in, out);
        *contacts += out[0].contact_count + out[1].contact_count + out[2].contact_count;
        if (k % 33 == 0) {
            (void)pal_engine_snapshot(pal_engine_reader(r->engine, 0), &frame);
            pal_engine_get_counts(r->engine, &counts);
        }
        if (k == TICKS / 2) {
            pal_engine_reset(r->engine);
        }
    }
    return faults;
}

/// Faults that such a life must meet. The law "surface" spreads no more points than there are.
static uint32_t lively(void) {
    uint32_t all =
        PALPATE_FAULT_INPUT | PALPATE_FAULT_CAP | PALPATE_FAULT_SLEW | PALPATE_FAULT_TORQUE_CAP;
    return rig_law == PALPATE_CONTACT_NODES ? all | PALPATE_FAULT_CONTACTS : all;
}

// ---- Tests --------------------------------------------------------------------------------------

static void the_traps_work(void **state) {
    (void)state;
    if (SANITIZED) {
        skip(); // the sanitizer owns the allocator here
    }
    static pthread_mutex_t mutex = PTHREAD_MUTEX_INITIALIZER;
    trapped = 0;
    armed = 1;
    void *volatile p = malloc(100);
    free(p);
    (void)pthread_mutex_lock(&mutex);
    (void)pthread_mutex_unlock(&mutex);
    ssize_t written = write(-1, "", 0);
    armed = 0;
    assert_int_equal(written, -1);
    assert_int_equal(trapped, 5);
    assert_string_equal(first_trapped, "malloc");
    first_trapped = NULL;
}

static void ticks_call_nothing(double skew) {
    rig r;
    make(&r, skew);
    int contacts = 0;
    trapped = 0;
    armed = 1;
    uint32_t faults = live(&r, &contacts);
    armed = 0;
    if (trapped > 0) {
        print_error("%d calls, the first to %s\n", trapped, first_trapped);
    }
    assert_int_equal(trapped, 0);
    assert_int_equal(faults & lively(), lively()); // the life was busy: every path was taken
    assert_true(contacts > TICKS);
    rig_free(&r);
}

static void no_allocation_lock_or_io_in_a_tick(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    ticks_call_nothing(0.0);
    ticks_call_nothing(0.1);
}

/// From here on this process may only exit. @return 0, or -1 when the kernel offers no filters.
static int forbid_system_calls(void) {
    struct sock_filter filter[] = {
        BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
        BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, __NR_exit_group, 0, 1),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
        BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_KILL_PROCESS),
    };
    struct sock_fprog program = {.len = sizeof filter / sizeof *filter, .filter = filter};
    return prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0) == 0 &&
                   prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program) == 0
               ? 0
               : -1;
}

enum { CHILD_OK = 0, CHILD_NO_FILTER = 3, CHILD_IDLE = 4 };

static int run_child(int misbehave) {
    rig r;
    make(&r, 0.0);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        int contacts = 0;
        if (forbid_system_calls() != 0) {
            _exit(CHILD_NO_FILTER);
        }
        if (misbehave) {
            (void)syscall(SYS_getppid);
        }
        uint32_t faults = live(&r, &contacts);
        _exit((faults & lively()) == lively() && contacts > TICKS ? CHILD_OK : CHILD_IDLE);
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    rig_free(&r);
    return status;
}

static void no_system_call_in_a_tick(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    int status = run_child(1);
    if (WIFEXITED(status) && WEXITSTATUS(status) == CHILD_NO_FILTER) {
        print_message("skipped: the kernel offers no system call filters\n");
        skip();
    }
    assert_true(WIFSIGNALED(status) && WTERMSIG(status) == SIGSYS); // the filter does kill
    status = run_child(0);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), CHILD_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(the_traps_work),
        cmocka_unit_test(no_allocation_lock_or_io_in_a_tick),
        {"no_allocation_lock_or_io_in_a_tick (surface)", no_allocation_lock_or_io_in_a_tick,
         rig_surface_law, rig_nodes_law, NULL},
        cmocka_unit_test(no_system_call_in_a_tick),
        {"no_system_call_in_a_tick (surface)", no_system_call_in_a_tick, rig_surface_law,
         rig_nodes_law, NULL},
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
