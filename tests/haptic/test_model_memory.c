/// Allocation failure at every allocation of saving, loading and pressing a model: a clean error, no
/// leak, no partial file, and the library works afterwards.
///
/// malloc and friends are replaced for this program; only calls made by its own code (libpalpate is
/// linked statically) are counted and made to fail, not those inside HDF5 or libc.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <dirent.h>
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "haptic/model.h"
#include "tests/support/synthetic_model.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define REPLACED 0 // the sanitizers replace malloc themselves
#else
#define REPLACED 1
#endif

static int counting, fail_at, calls;
static void *live[4096];
static int live_count;

#if REPLACED
extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
extern void __libc_free(void *);
extern char __executable_start, etext;

static int ours(const void *caller) {
    return counting && (uintptr_t)caller >= (uintptr_t)&__executable_start && (uintptr_t)caller < (uintptr_t)&etext;
}

static int fails(void) {
    return ++calls == fail_at;
}

static void forget(const void *p) {
    for (int i = 0; p != NULL && i < live_count; i++) {
        if (live[i] == p) {
            live[i] = live[--live_count];
            return;
        }
    }
}

static void *note(void *p) {
    if (p != NULL && live_count < 4096) {
        live[live_count++] = p;
    }
    return p;
}

#define FAIL_OR(call)                                                                              \
    if (!ours(__builtin_return_address(0))) {                                                      \
        return call;                                                                               \
    }                                                                                              \
    if (fails()) {                                                                                 \
        errno = ENOMEM;                                                                            \
        return NULL;                                                                               \
    }                                                                                              \
    return note(call)

void *malloc(size_t size) {
    FAIL_OR(__libc_malloc(size));
}
void *calloc(size_t count, size_t size) {
    FAIL_OR(__libc_calloc(count, size));
}
void *aligned_alloc(size_t alignment, size_t size) {
    FAIL_OR(__libc_memalign(alignment, size));
}
void *realloc(void *old, size_t size) {
    if (!ours(__builtin_return_address(0))) {
        return __libc_realloc(old, size);
    }
    if (fails()) {
        errno = ENOMEM;
        return NULL;
    }
    forget(old);
    return note(__libc_realloc(old, size));
}
void free(void *p) {
    forget(p);
    __libc_free(p);
}
#endif

static char directory[64], path[100];
static pal_model *model;

static int setup(void **state) {
    (void)state;
    (void)snprintf(directory, sizeof directory, "/tmp/palpate-memory-XXXXXX");
    if (mkdtemp(directory) == NULL) {
        return -1;
    }
    (void)snprintf(path, sizeof path, "%s/m.palpate", directory);
    synthetic_params p = synthetic_default_params();
    p.n = 3;
    p.skin = 1;
    model = synthetic_model(&p);
    return model == NULL ? -1 : pal_model_save(model, path, NULL);
}

static int teardown(void **state) {
    (void)state;
    pal_model_free(model);
    return unlink(path) | rmdir(directory); // fails when anything else was left behind
}

typedef pal_status (*operation)(pal_error *error);

static pal_status do_save(pal_error *error) {
    return pal_model_save(model, path, error);
}

static pal_status do_load(pal_error *error) {
    pal_model *m = NULL;
    pal_status status = pal_model_load(path, &m, error);
    if ((status == PALPATE_OK) != (m != NULL)) {
        return (pal_status)99;
    }
    pal_model_free(m);
    return status;
}

static pal_status do_press(pal_error *error) {
    static const double by[3] = {0, 0, -1e-3};
    pal_press press;
    pal_status status = pal_model_press(model, "all", by, &press, error);
    if ((status == PALPATE_OK) != (press.node_force != NULL)) {
        return (pal_status)99;
    }
    pal_press_clear(&press);
    return status;
}

/// Fail the first, second, third ... allocation until the operation gets through.
static void survives(operation run, int least) {
    if (!REPLACED) {
        skip();
    }
    for (int n = 1;; n++) {
        pal_error error = {0};
        fail_at = n;
        calls = live_count = 0;
        counting = 1;
        pal_status status = run(&error);
        counting = 0;
        assert_int_equal(live_count, 0);
        if (calls < n) { // nothing failed this time
            assert_int_equal(status, PALPATE_OK);
            assert_true(n > least);
            return;
        }
        assert_int_not_equal(status, 99);
        // an allocation that only saves memory (shrinking the image) may fail without harm
        if (status != PALPATE_OK) {
            assert_true(status < 0);
            assert_int_equal(error.status, status);
            assert_true(strlen(error.message) > 10);
        }
        DIR *d = opendir(directory);
        int entries = 0;
        while (readdir(d) != NULL) {
            entries++;
        }
        closedir(d);
        assert_int_equal(entries, 3); // ".", "..", the model
        assert_int_equal(do_load(&error), PALPATE_OK); // still whole, HDF5 still works
    }
}

static void saving_survives(void **state) {
    (void)state;
    survives(do_save, 3);
}

static void loading_survives(void **state) {
    (void)state;
    survives(do_load, 15);
}

static void pressing_survives(void **state) {
    (void)state;
    survives(do_press, 4);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(saving_survives),
        cmocka_unit_test(loading_survives),
        cmocka_unit_test(pressing_survives),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
