/// Status names, texts and the error buffer.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/base/error.h"

static void names_and_texts_cover_the_list(void **state) {
    (void)state;
#define CHECK(name, value, text)                                                                   \
    assert_string_equal(pal_status_name(name), #name);                                             \
    assert_string_equal(pal_status_text(name), text);                                              \
    assert_int_equal(name, value);
    PALPATE_STATUS_LIST(CHECK)
#undef CHECK
    assert_string_equal(pal_status_name((pal_status)-999), "unknown");
}

static void fail_formats_and_prefix_keeps_the_rest(void **state) {
    (void)state;
    pal_error e = {0};
    assert_int_equal(pal_fail(&e, PALPATE_ERROR_IO, "%s: %d", "x", 3), PALPATE_ERROR_IO);
    assert_string_equal(e.message, "x: 3");
    assert_int_equal(pal_fail_prefix(&e, PALPATE_ERROR_SCENE, "scene %d", 7), PALPATE_ERROR_SCENE);
    assert_string_equal(e.message, "scene 7: x: 3");
    assert_int_equal(pal_fail(NULL, PALPATE_ERROR_IO, "nobody listens"), PALPATE_ERROR_IO);
    assert_int_equal(pal_fail_prefix(NULL, PALPATE_ERROR_IO, "nobody listens"), PALPATE_ERROR_IO);
}

static void messages_longer_than_the_buffer_are_cut(void **state) {
    (void)state;
    char text[3000];
    memset(text, 'a', sizeof text - 1);
    text[sizeof text - 1] = 0;
    pal_error e = {0};
    pal_fail(&e, PALPATE_ERROR_IO, "%s", text);
    assert_int_equal(strlen(e.message), sizeof e.message - 1);
    pal_fail_prefix(&e, PALPATE_ERROR_IO, "%s", text);
    assert_int_equal(strlen(e.message), sizeof e.message - 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_and_texts_cover_the_list),
        cmocka_unit_test(fail_formats_and_prefix_keeps_the_rest),
        cmocka_unit_test(messages_longer_than_the_buffer_are_cut),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
