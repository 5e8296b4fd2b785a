/// @file failing_allocator.h  An allocator that fails when told to, for the fault table's row of
/// allocations (tests/README.md).
///
/// Include it in exactly one file of a test program: it defines malloc, calloc, realloc,
/// aligned_alloc and free, for the program and for every library in its process. Between
/// failing_watch and failing_stop the calls of the chosen callers are counted, the n-th fails with
/// ENOMEM, and blocks are remembered until they are freed, whenever and by whomever that is.
///
/// A caller is told by the object its return address lies in: this program (Palpate's libraries are
/// linked statically), a library named in failing_libraries, another library. Sanitizers bring
/// their own allocator, so there failing_or_skip() skips the test; their leak check sees the rest.
///
/// Threads: any; one watch at a time.
#ifndef PALPATE_TESTS_FAILING_ALLOCATOR_H
#define PALPATE_TESTS_FAILING_ALLOCATOR_H

#include <errno.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <dlfcn.h>

#include <palpate/status.h>

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define FAILING_ALLOCATOR 0
#else
#define FAILING_ALLOCATOR 1
#endif

typedef enum failing_caller {
    FAILING_OWN = 1,   ///< this program
    FAILING_NAMED = 2, ///< a library whose file name contains one of failing_libraries
    FAILING_OTHER = 4, ///< any other library
    FAILING_ANY = 7
} failing_caller;

enum { FAILING_LIVE_MAX = 1 << 16, FAILING_PAGES = 4096 };

static const char *const *failing_libraries; ///< NULL at the end; set before the first watch
static volatile int failing_callers;         ///< whose calls count; may change while watching
static volatile long failing_calls;          ///< counted since the watch began
static volatile int failing_by;              ///< caller of the call that failed, 0: none did
static volatile size_t failing_moment;       ///< when malloc is asked for this size (0: never) ...
static void (*failing_happening)(void);      ///< ... this happens, once

static volatile long failing_at;
static volatile int failing_watching, failing_overflow;
static volatile long failing_live_count;
static void *failing_live[FAILING_LIVE_MAX]; ///< open addressing; the array itself: deleted
static char failing_owner[FAILING_LIVE_MAX]; ///< failing_caller of each
static atomic_flag failing_lock = ATOMIC_FLAG_INIT;

#if FAILING_ALLOCATOR
extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
extern void __libc_free(void *);
PALPATE_API void *malloc(size_t n); // exported, so that libraries use them too
PALPATE_API void *calloc(size_t n, size_t m);
PALPATE_API void *realloc(void *p, size_t n);
PALPATE_API void *aligned_alloc(size_t a, size_t n);
PALPATE_API void free(void *p);

static void failing_enter(void) {
    while (atomic_flag_test_and_set(&failing_lock)) {
    }
}

static void failing_leave(void) {
    atomic_flag_clear(&failing_lock);
}

static size_t failing_slot(const void *p) {
    return ((uintptr_t)p >> 4) * 2654435761u % FAILING_LIVE_MAX;
}

static void failing_remember(void *p, int caller) {
    size_t i = failing_slot(p), n = 0;
    while (failing_live[i] != NULL && failing_live[i] != (void *)failing_live &&
           n < FAILING_LIVE_MAX) {
        i = (i + 1) % FAILING_LIVE_MAX;
        n++;
    }
    failing_overflow |= n == FAILING_LIVE_MAX;
    if (n < FAILING_LIVE_MAX) {
        failing_live[i] = p;
        failing_owner[i] = (char)caller;
        failing_live_count++;
    }
}

/// @return whose it was, 0: not remembered
static int failing_forget(const void *p) {
    size_t i = failing_slot(p);
    for (size_t n = 0; failing_live_count > 0 && failing_live[i] != NULL && n < FAILING_LIVE_MAX;
         n++) {
        if (failing_live[i] == p) {
            failing_live[i] = (void *)failing_live;
            failing_live_count--;
            return failing_owner[i];
        }
        i = (i + 1) % FAILING_LIVE_MAX;
    }
    return 0;
}

static int failing_look_up(void *address) {
    Dl_info at, here;
    if (dladdr(address, &at) == 0 || dladdr((void *)&failing_live, &here) == 0) {
        return FAILING_OTHER;
    }
    if (at.dli_fbase == here.dli_fbase) {
        return FAILING_OWN;
    }
    for (size_t i = 0; failing_libraries != NULL && failing_libraries[i] != NULL; i++) {
        if (at.dli_fname != NULL && strstr(at.dli_fname, failing_libraries[i]) != NULL) {
            return FAILING_NAMED;
        }
    }
    return FAILING_OTHER;
}

/// Looked up once per page of code: dladdr is slow, and takes the loader's lock, under which others
/// allocate (so it is not called under ours).
static int failing_caller_of(void *address) {
    static struct {
        uintptr_t page;
        int caller;
    } known[FAILING_PAGES];
    uintptr_t page = (uintptr_t)address >> 12;
    size_t i = page % FAILING_PAGES;
    failing_enter();
    int caller = known[i].page == page ? known[i].caller : 0;
    failing_leave();
    if (caller == 0) {
        caller = failing_look_up(address);
        failing_enter();
        known[i].page = page;
        known[i].caller = caller;
        failing_leave();
    }
    return caller;
}

/// Count the call. @return 1 when it is to fail; *caller: whose block to remember, 0: nobody's
static int failing_now(void *address, int *caller) {
    *caller = failing_watching ? failing_caller_of(address) & failing_callers : 0;
    if (*caller == 0) {
        return 0;
    }
    failing_enter();
    int now = ++failing_calls == failing_at;
    failing_leave();
    if (now) {
        failing_by = *caller;
        errno = ENOMEM;
    }
    return now;
}

static void *failing_kept(void *p, int caller) {
    if (caller != 0 && p != NULL) {
        failing_enter();
        failing_remember(p, caller);
        failing_leave();
    }
    return p;
}

void *malloc(size_t n) {
    int caller;
    if (failing_watching && failing_moment != 0 && n == failing_moment) {
        failing_moment = 0;
        failing_happening();
    }
    return failing_now(__builtin_return_address(0), &caller)
               ? NULL
               : failing_kept(__libc_malloc(n), caller);
}

void *calloc(size_t n, size_t m) {
    int caller;
    return failing_now(__builtin_return_address(0), &caller)
               ? NULL
               : failing_kept(__libc_calloc(n, m), caller);
}

void *aligned_alloc(size_t a, size_t n) {
    int caller;
    return failing_now(__builtin_return_address(0), &caller)
               ? NULL
               : failing_kept(__libc_memalign(a, n), caller);
}

/// A block from before the watch stays one; one of the watch stays its owner's if nobody counted
/// has made it grow.
void *realloc(void *p, size_t n) {
    int caller, owner = 0;
    if (failing_now(__builtin_return_address(0), &caller)) {
        return NULL;
    }
    if (p != NULL) { // forgotten first: once freed, another thread may be given the address
        failing_enter();
        owner = failing_forget(p);
        failing_leave();
        caller = owner != 0 && caller != 0 ? caller : owner;
    }
    return failing_kept(__libc_realloc(p, n), caller);
}

void free(void *p) {
    if (p != NULL && failing_live_count > 0) {
        failing_enter();
        (void)failing_forget(p);
        failing_leave();
    }
    __libc_free(p);
}
#endif

/// Begin: nothing is remembered, the at-th counted call fails (0: none does).
static inline void failing_watch(long at, int callers) {
    for (size_t i = 0; i < FAILING_LIVE_MAX; i++) {
        failing_live[i] = NULL;
    }
    failing_calls = failing_live_count = 0;
    failing_by = failing_overflow = 0;
    failing_at = at;
    failing_callers = callers;
    failing_watching = 1;
}

static inline void failing_stop(void) {
    failing_watching = 0;
}

/// Blocks made for these callers during the last watch and not freed since; -1: too many to know.
static inline int failing_leaked(int callers) {
    int n = 0;
    for (size_t i = 0; i < FAILING_LIVE_MAX; i++) {
        n += failing_live[i] != NULL && failing_live[i] != (void *)failing_live &&
             (failing_owner[i] & callers) != 0;
    }
    return failing_overflow ? -1 : n;
}

#define failing_or_skip()                                                                          \
    do {                                                                                           \
        if (!FAILING_ALLOCATOR) {                                                                  \
            skip();                                                                                \
        }                                                                                          \
    } while (0)

#endif
