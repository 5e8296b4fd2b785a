/// The window under Xvfb: it opens, draws the running organ, saves a picture; without a display it
/// says what to do instead.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <png.h>

#include "tests/support/program.h"

static void window_draws_the_running_organ(void **state) {
    (void)state;
    if (system("command -v xvfb-run > /dev/null 2>&1") != 0) {
        skip();
    }
    char line[1200], picture[128];
    (void)snprintf(picture, sizeof picture, "/tmp/palpate-view-%ld.png", (long)getpid());
    const char *program = getenv("PALPATE") ? getenv("PALPATE") : "build/palpate";
    (void)snprintf(
        line, sizeof line,
        "exec xvfb-run -a %s view %s/scenes/hemisphere.yaml --for 3 --size 480x320 "
        "--set body.patches.pole.rim_spacing=0.002 --set body.refine=[] --snapshot %s --json 2>&1",
        program, program_source(), picture);
    FILE *p = popen(line, "r");
    char out[4096];
    size_t n = fread(out, 1, sizeof out - 1, p);
    out[n] = '\0';
    int status = pclose(p);
    if (status != 0) {
        fail_msg("status %d: %s", status, out);
    }
    const char *json = strchr(out, '{');
    assert_non_null(json);
    json_t *object = json_loads(json, JSON_DISABLE_EOF_CHECK, NULL);
    assert_true(program_number(object, "frames") >= 5);
    assert_true(program_number(object, "ticks") + program_number(object, "missed") >= 2900);
    json_decref(object);
    png_image image;
    memset(&image, 0, sizeof image);
    image.version = PNG_IMAGE_VERSION;
    assert_true(png_image_begin_read_from_file(&image, picture));
    assert_int_equal(image.width, 480);
    assert_int_equal(image.height, 320);
    image.format = PNG_FORMAT_RGB;
    uint8_t *rgb = malloc(PNG_IMAGE_SIZE(image));
    assert_true(png_image_finish_read(&image, NULL, rgb, 0, NULL));
    int tissue = 0;
    for (size_t i = 0; i < (size_t)480 * 320;
         i++) { // reddish: resting tissue; the background is bluish
        tissue += rgb[3 * i] > rgb[3 * i + 2] + 20;
    }
    assert_true(tissue > 480 * 320 / 20);
    free(rgb);
    unlink(picture);
}

static void without_a_display_the_message_says_what_to_do(void **state) {
    (void)state;
    char arguments[1024];
    char *display = getenv("DISPLAY") ? strdup(getenv("DISPLAY")) : NULL;
    unsetenv("DISPLAY");
    unsetenv("WAYLAND_DISPLAY");
    (void)snprintf(arguments, sizeof arguments,
                   "view %s/scenes/hemisphere.yaml --set body.patches.pole.rim_spacing=0.002 --set "
                   "body.refine=[]",
                   program_source());
    program_result r = program_run(arguments);
    assert_int_equal(r.status, 1);
    assert_non_null(strstr(r.error, "--snapshot"));
    program_clear(&r);
    if (display != NULL) {
        setenv("DISPLAY", display, 1);
        free(display);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(window_draws_the_running_organ),
        cmocka_unit_test(without_a_display_the_message_says_what_to_do),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
