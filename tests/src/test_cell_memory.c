/// Every allocation of the cell method fails once: a clean error, nothing leaked, and the next
/// build is the same to the bit.
///
/// The program's allocator is replaced by one that can fail at the n-th call and counts the blocks
/// made while watching. Sanitizers bring their own allocator: skipped there.
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/cell_rig.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

static volatile long calls, fail_at, balance;
static volatile int watching;

#if !SANITIZED
extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void __libc_free(void *);
PALPATE_API void *malloc(size_t n);
PALPATE_API void *calloc(size_t n, size_t m);
PALPATE_API void *realloc(void *p, size_t n);
PALPATE_API void free(void *p);

static int fails(void) {
    int now = watching && ++calls == fail_at;
    if (now) {
        errno = ENOMEM;
    }
    return now;
}
static void *made(void *p) {
    balance += watching && p != NULL;
    return p;
}
void *malloc(size_t n) {
    return fails() ? NULL : made(__libc_malloc(n));
}
void *calloc(size_t n, size_t m) {
    return fails() ? NULL : made(__libc_calloc(n, m));
}
void *realloc(void *p, size_t n) {
    return fails() ? NULL : p == NULL ? made(__libc_realloc(p, n)) : __libc_realloc(p, n);
}
void free(void *p) {
    balance -= watching && p != NULL;
    __libc_free(p);
}
#endif

static void every_allocation_fails_once(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    const pal_method methods[2] = {
        {.kind = PALPATE_METHOD_CELL, .volumetric = PALPATE_VOLUMETRIC_PATCH, .stabilization = -1},
        {.kind = PALPATE_METHOD_CELL,
         .volumetric = PALPATE_VOLUMETRIC_NODAL,
         .form = PALPATE_CELL_COLLOCATED,
         .stabilization = -1}};
    pal_cloud c;
    rig_box(&c, (const double[3]){1, 1, 1}, 3, 3, 3, 0.1);
    uint8_t *fixed = rig_flags(c.node_count);
    fixed[0] = 1;
    for (int m = 0; m < 2; m++) {
        pal_system whole, s;
        rig_build(&c, fixed, 0.49, &methods[m], &whole); // 0.49: groups take part
        int64_t entries = whole.matrix.start[whole.matrix.columns];
        long failures = 0;
        for (fail_at = 1;; fail_at++) {
            pal_error e = {0};
            calls = balance = 0;
            watching = 1;
            pal_status status = pal_method_cell(&c, fixed, 0.49, &methods[m], NULL, &s, &e);
            if (status == PALPATE_OK) {
                int same = memcmp(s.matrix.value, whole.matrix.value,
                                  (size_t)entries * sizeof(double)) == 0;
                pal_system_clear(&s);
                watching = 0;
                assert_true(same);
                assert_int_equal(balance, 0);
                if (calls < fail_at) {
                    break; // nothing failed: all allocations have had their turn
                }
                continue; // the C library or a shrinking realloc did without
            }
            watching = 0;
            failures++;
            assert_int_equal(status, PALPATE_ERROR_MEMORY);
            assert_int_equal(e.status, PALPATE_ERROR_MEMORY);
            assert_true(e.message[0] != '\0');
            assert_int_equal(balance, 0);
            assert_null(s.matrix.value);
        }
        assert_true(failures > 20); // the loop did something
        pal_system_clear(&whole);
    }
    free(fixed);
    pal_cloud_clear(&c);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(every_allocation_fails_once)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
