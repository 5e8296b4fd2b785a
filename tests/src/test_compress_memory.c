/// Every allocation of compressing rows, of writing and of reading them fails once: a clean error,
/// nothing leaked, the model as it was, and the next time it works.
///
/// The program's allocator is replaced by one that can fail at the n-th call and counts the blocks
/// made while watching; only calls from this program's own code, not those inside HDF5 or libc.
/// Sanitizers bring their own allocator: skipped there.
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/model/model.h"
#include "src/store/compress.h"
#include "tests/support/synthetic_model.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

static atomic_long calls, balance;
static atomic_int watching;
static long fail_at;

#if !SANITIZED
extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void *__libc_memalign(size_t, size_t);
extern void __libc_free(void *);
extern char __executable_start, etext;
PALPATE_API void *malloc(size_t n);
PALPATE_API void *calloc(size_t n, size_t m);
PALPATE_API void *aligned_alloc(size_t alignment, size_t n);
PALPATE_API void free(void *p);

static int ours(const void *caller) {
    return watching && (uintptr_t)caller >= (uintptr_t)&__executable_start &&
           (uintptr_t)caller < (uintptr_t)&etext;
}
#define OURS ours(__builtin_return_address(0))
static int fails(void) {
    int now = atomic_fetch_add(&calls, 1) + 1 == fail_at;
    if (now) {
        errno = ENOMEM;
    }
    return now;
}
static void *made(void *p) {
    atomic_fetch_add(&balance, p != NULL);
    return p;
}
void *malloc(size_t n) {
    return !OURS ? __libc_malloc(n) : fails() ? NULL : made(__libc_malloc(n));
}
void *calloc(size_t n, size_t m) {
    return !OURS ? __libc_calloc(n, m) : fails() ? NULL : made(__libc_calloc(n, m));
}
void *aligned_alloc(size_t alignment, size_t n) {
    return !OURS     ? __libc_memalign(alignment, n)
           : fails() ? NULL
                     : made(__libc_memalign(alignment, n));
}
void free(void *p) {
    if (OURS && p != NULL) {
        atomic_fetch_sub(&balance, 1);
    }
    __libc_free(p);
}
#endif

static pal_model *box(void) {
    synthetic_params p = synthetic_default_params();
    p.n = 6;
    p.layers = 3;
    p.rows = SYNTHETIC_ROWS_ALL;
    pal_model *m = synthetic_model(&p);
    assert_non_null(m);
    return m;
}

static void watch(long at) {
    atomic_store(&calls, 0);
    atomic_store(&balance, 0);
    fail_at = at;
    atomic_store(&watching, 1);
}

static void compressing(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    pal_model *m = box();
    const void *rows = m->c_st;
    pal_error error;
    long n = 1;
    for (;; n++) {
        memset(&error, 0, sizeof error);
        pal_rows out;
        watch(n);
        pal_status status = pal_rows_compress(m, 1e-3, NULL, &out, &error);
        if (status == PALPATE_OK) {
            pal_rows_clear(&out);
        }
        atomic_store(&watching, 0);
        if (atomic_load(&calls) < n) { // none failed
            assert_int_equal(status, PALPATE_OK);
            assert_int_equal(atomic_load(&balance), 0);
            break;
        }
        assert_int_equal(status, PALPATE_ERROR_MEMORY);
        assert_true(strlen(error.message) > 5);
        assert_int_equal(atomic_load(&balance), 0);
        assert_ptr_equal(m->c_st, rows);
        assert_null(m->bases);
    }
    print_message("%ld allocations\n", n - 1);
    assert_true(n > 30);
    pal_model_free(m);
}

/// The choice among all forms: the model keeps its rows when it fails.
static void choosing(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    for (long n = 1;; n += 7) { // most sites were hit above: here the seams between the forms
        pal_model *m = box();
        pal_error error = {0};
        watch(n);
        pal_status status = pal_compress(m, 2e-3, NULL, &error);
        atomic_store(&watching, 0);
        int failed = atomic_load(&calls) >= n;
        assert_int_equal(status, failed ? PALPATE_ERROR_MEMORY : PALPATE_OK);
        assert_int_equal(pal_model_check(m, NULL), PALPATE_OK);
        assert_true(!failed || (m->bases == NULL && m->info.precision == PALPATE_PRECISION_SINGLE &&
                                atomic_load(&balance) == 0));
        pal_model_free(m);
        if (!failed) {
            break;
        }
    }
}

static void writing_and_reading(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    pal_model *m = box();
    pal_rows out;
    assert_int_equal(pal_rows_compress(m, 1e-3, NULL, &out, NULL), PALPATE_OK);
    pal_rows_take(m, &out);
    void *image = NULL, *again;
    size_t size, other;
    assert_int_equal(pal_model_image(m, &image, &size, NULL), PALPATE_OK);
    for (int reading = 0; reading < 2; reading++) {
        for (long n = 1;; n++) {
            pal_error error = {0};
            pal_model *got = NULL;
            again = NULL;
            watch(n);
            pal_status status = reading ? pal_model_parse(image, size, &got, &error)
                                        : pal_model_image(m, &again, &other, &error);
            pal_model_free(got);
            free(again);
            atomic_store(&watching, 0);
            if (atomic_load(&calls) < n) {
                assert_int_equal(status, PALPATE_OK);
                break;
            }
            assert_true(status == PALPATE_ERROR_MEMORY || status == PALPATE_ERROR_IO);
            assert_int_equal(atomic_load(&balance), 0);
        }
    }
    free(image);
    pal_model_free(m);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(compressing),
        cmocka_unit_test(choosing),
        cmocka_unit_test(writing_and_reading),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
