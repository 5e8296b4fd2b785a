/// Every allocation of the cell method fails once: a clean error, nothing leaked, and the next
/// build is the same to the bit.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "tests/support/cell_rig.h"
#include "tests/support/failing_allocator.h"

static void every_allocation_fails_once(void **state) {
    (void)state;
    failing_or_skip();
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
        for (long n = 1;; n++) {
            pal_error e = {0};
            failing_watch(n, FAILING_ANY);
            pal_status status = pal_method_cell(&c, fixed, 0.49, &methods[m], NULL, &s, &e);
            if (status == PALPATE_OK) {
                int same = memcmp(s.matrix.value, whole.matrix.value,
                                  (size_t)entries * sizeof(double)) == 0;
                pal_system_clear(&s);
                failing_stop();
                assert_true(same);
                assert_int_equal(failing_leaked(FAILING_ANY), 0);
                if (failing_calls < n) {
                    break; // nothing failed: all allocations have had their turn
                }
                continue; // the C library or a shrinking realloc did without
            }
            failing_stop();
            failures++;
            assert_int_equal(status, PALPATE_ERROR_MEMORY);
            assert_int_equal(e.status, PALPATE_ERROR_MEMORY);
            assert_true(e.message[0] != '\0');
            assert_int_equal(failing_leaked(FAILING_ANY), 0);
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
