/// Every allocation of compressing rows, of writing and of reading them fails once: a clean error,
/// nothing leaked, the model as it was, and the next time it works.
/// Only calls of our own code fail, not those inside HDF5.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/model/model.h"
#include "src/store/compress.h"
#include "tests/support/failing_allocator.h"
#include "tests/support/synthetic_model.h"

static pal_model *box(void) {
    synthetic_params p = synthetic_default_params();
    p.n = 6;
    p.layers = 3;
    p.rows = SYNTHETIC_ROWS_ALL;
    pal_model *m = synthetic_model(&p);
    assert_non_null(m);
    return m;
}

static void compressing(void **state) {
    (void)state;
    failing_or_skip();
    pal_model *m = box();
    const void *rows = m->c_st;
    pal_error error;
    long n = 1;
    for (;; n++) {
        memset(&error, 0, sizeof error);
        pal_rows out;
        failing_watch(n, FAILING_OWN);
        pal_status status = pal_rows_compress(m, 1e-3, NULL, &out, &error);
        if (status == PALPATE_OK) {
            pal_rows_clear(&out);
        }
        failing_stop();
        if (failing_calls < n) { // none failed
            assert_int_equal(status, PALPATE_OK);
            assert_int_equal(failing_leaked(FAILING_OWN), 0);
            break;
        }
        assert_int_equal(status, PALPATE_ERROR_MEMORY);
        assert_true(strlen(error.message) > 5);
        assert_int_equal(failing_leaked(FAILING_OWN), 0);
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
    failing_or_skip();
    for (long n = 1;; n += 7) { // most sites were hit above: here the seams between the forms
        pal_model *m = box();
        pal_error error = {0};
        failing_watch(n, FAILING_OWN);
        pal_status status = pal_compress(m, 2e-3, NULL, &error);
        failing_stop();
        int failed = failing_calls >= n;
        assert_int_equal(status, failed ? PALPATE_ERROR_MEMORY : PALPATE_OK);
        assert_int_equal(pal_model_check(m, NULL), PALPATE_OK);
        assert_true(!failed || (m->bases == NULL && m->info.precision == PALPATE_PRECISION_SINGLE &&
                                failing_leaked(FAILING_OWN) == 0));
        pal_model_free(m);
        if (!failed) {
            break;
        }
    }
}

static void writing_and_reading(void **state) {
    (void)state;
    failing_or_skip();
    pal_model *m = box();
    pal_rows out;
    assert_int_equal(pal_rows_compress(m, 1e-3, NULL, &out, NULL), PALPATE_OK);
    pal_rows_take(m, &out);
    void *image = NULL, *again;
    size_t size, other = 0;
    assert_int_equal(pal_model_image(m, &image, &size, NULL), PALPATE_OK);
    for (int reading = 0; reading < 2; reading++) {
        for (long n = 1;; n++) {
            pal_error error = {0};
            pal_model *got = NULL;
            again = NULL;
            failing_watch(n, FAILING_OWN);
            pal_status status = reading ? pal_model_parse(image, size, &got, &error)
                                        : pal_model_image(m, &again, &other, &error);
            // giving back what the image was too large by may fail without harm
            int same = again != NULL && other == size && memcmp(again, image, size) == 0;
            pal_model_free(got);
            free(again);
            failing_stop();
            assert_int_equal(failing_leaked(FAILING_OWN), 0);
            if (failing_calls < n) {
                assert_int_equal(status, PALPATE_OK);
                break;
            }
            if (status == PALPATE_OK) {
                assert_true(same && !reading);
                continue;
            }
            assert_true(status == PALPATE_ERROR_MEMORY || status == PALPATE_ERROR_IO);
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
