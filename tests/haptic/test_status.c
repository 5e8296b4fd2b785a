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

/// An endless name in the middle must not cost the reason at the end, nor tear a character.
static void messages_longer_than_the_buffer_lose_their_middle(void **state) {
    (void)state;
    char text[3000];
    memset(text, 'a', sizeof text - 1);
    text[sizeof text - 1] = 0;
    pal_error e = {0};
    pal_fail(&e, PALPATE_ERROR_IO, "place %s: reason; remedy", text);
    assert_int_equal(strlen(e.message), sizeof e.message - 1);
    assert_memory_equal(e.message, "place aaa", 9);
    assert_non_null(strstr(e.message, "aaa...aaa"));
    assert_string_equal(e.message + strlen(e.message) - 19, "aaa: reason; remedy");
    pal_fail_prefix(&e, PALPATE_ERROR_IO, "scene %s", text);
    assert_int_equal(strlen(e.message), sizeof e.message - 1);
    assert_memory_equal(e.message, "scene aaa", 9);
    assert_string_equal(e.message + strlen(e.message) - 8, "; remedy");
    for (int shift = 0; shift < 3; shift++) { // three-byte characters at every offset
        size_t n = 0;
        while (n < (size_t)shift) {
            text[n++] = 'x';
        }
        for (; n + 3 < sizeof text; n += 3) {
            memcpy(text + n, "\342\202\254", 3);
        }
        text[n] = 0;
        pal_fail(&e, PALPATE_ERROR_IO, "%s", text);
        const char *gap = strstr(e.message, "...");
        assert_non_null(gap);
        assert_int_equal((gap - e.message - shift) % 3, 0);
        assert_int_equal(strlen(gap + 3) % 3, 0);
        assert_true(strlen(e.message) >= sizeof e.message - 5);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(names_and_texts_cover_the_list),
        cmocka_unit_test(fail_formats_and_prefix_keeps_the_rest),
        cmocka_unit_test(messages_longer_than_the_buffer_lose_their_middle),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
