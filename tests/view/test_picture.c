/// The offscreen picture of an indented body: something is drawn, coloured where it is displaced,
/// and written as a PNG that libpng reads back the same; the GIF has its frames.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>
#include <gif_lib.h>
#include <png.h>

#include "haptic/view/view.h"
#include "tests/support/synthetic_model.h"

enum { WIDTH = 480, HEIGHT = 360 };

/// A frame with a smooth dent of `depth` at the surface point nearest the middle, and its tool.
static pal_frame dent(const pal_model *model, double depth, float *u) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    const double *x = pal_model_positions(model);
    const int32_t *row = pal_model_rows(model);
    double size = info.bounds_max[0] - info.bounds_min[0];
    double cx = 0.5 * (info.bounds_min[0] + info.bounds_max[0]);
    double cy = 0.5 * (info.bounds_min[1] + info.bounds_max[1]);
    for (int32_t i = 0; i < info.row_count; i++) {
        double r2 = pow(x[3 * row[i]] - cx, 2) + pow(x[3 * row[i] + 1] - cy, 2);
        u[3 * i] = u[3 * i + 1] = 0.0F;
        u[3 * i + 2] = (float)(-depth * exp(-r2 / (0.02 * size * size)));
    }
    pal_frame f = {.tick = 1, .row_count = info.row_count, .tool_count = 1, .displacement = u};
    f.tool_pose[0].position[0] = cx;
    f.tool_pose[0].position[1] = cy;
    f.tool_pose[0].position[2] = info.bounds_max[2] - depth + 0.06 * size;
    f.tool_pose[0].orientation[0] = 1.0;
    f.tool_force[0].force[2] = 1.25;
    f.tool_force[0].contact_count = 1;
    f.tool_force[0].centroid[0] = cx;
    f.tool_force[0].centroid[1] = cy;
    f.tool_force[0].centroid[2] = info.bounds_max[2] - depth;
    return f;
}

static int count_where(const uint8_t *rgba, int (*is)(const uint8_t *)) {
    int n = 0;
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        n += is(rgba + 4 * i);
    }
    return n;
}
static int is_red(const uint8_t *p) {
    return p[0] > 120 && p[1] < 70 && p[2] < 70;
}
static int is_green(const uint8_t *p) { // the upper half of the scale; resting tissue is reddish
    return p[1] > p[0] + 20;
}

static void picture_shows_the_dent_and_the_force(void **state) {
    (void)state;
    pal_model *model;
    pal_error error = {0};
    synthetic_params params = synthetic_default_params();
    params.n = 24;
    model = synthetic_model(&params);
    assert_non_null(model);
    pal_model_info info;
    pal_model_get_info(model, &info);
    pal_offscreen *off = NULL;
    pal_canvas *canvas = NULL;
    assert_int_equal(pal_offscreen_create(WIDTH, HEIGHT, &off, &error), PALPATE_OK);
    assert_int_equal(pal_canvas_create(model, &canvas, &error), PALPATE_OK);
    pal_runtime_config tools = {.tool_count = 1};
    tools.tools[0].shape = PALPATE_SHAPE_SPHERE;
    double size = info.bounds_max[0] - info.bounds_min[0];
    tools.tools[0].radius = 0.06 * size;
    float *u = calloc(3 * (size_t)info.row_count + 1, sizeof *u);
    uint8_t *rest = malloc(4 * WIDTH * HEIGHT), *dented = malloc(4 * WIDTH * HEIGHT);
    pal_camera camera = pal_camera_default(model);
    pal_caption caption = {.title = "a dent\nsecond line"};
    pal_offscreen_begin(off);
    pal_canvas_draw(canvas, NULL, &tools, &camera, &caption, WIDTH, HEIGHT);
    pal_offscreen_read(off, rest);
    assert_true(pal_canvas_largest(canvas) == 0.0);
    pal_frame frame = dent(model, 0.1 * size, u);
    pal_offscreen_begin(off);
    pal_canvas_draw(canvas, &frame, &tools, &camera, &caption, WIDTH, HEIGHT);
    pal_offscreen_read(off, dented);
    assert_true(fabs(pal_canvas_largest(canvas) - 0.1 * size) < 0.03 * size);
    if (getenv("PALPATE_KEEP_PICTURE") != NULL) {
        (void)pal_picture_write_png(getenv("PALPATE_KEEP_PICTURE"), WIDTH, HEIGHT, dented, NULL);
    }
    // the rest shape has no arrow and no colour beyond the legend's; the dented one has both
    assert_true(count_where(dented, is_red) > count_where(rest, is_red) + 50);
    assert_true(count_where(dented, is_green) > count_where(rest, is_green) + 50);

    // PNG: what libpng reads back is what was drawn
    char path[] = "/tmp/palpate-picture-XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    close(fd);
    assert_int_equal(pal_picture_write_png(path, WIDTH, HEIGHT, dented, &error), PALPATE_OK);
    png_image image;
    memset(&image, 0, sizeof image);
    image.version = PNG_IMAGE_VERSION;
    assert_true(png_image_begin_read_from_file(&image, path));
    assert_int_equal(image.width, WIDTH);
    assert_int_equal(image.height, HEIGHT);
    image.format = PNG_FORMAT_RGB;
    uint8_t *back = malloc(PNG_IMAGE_SIZE(image));
    assert_true(png_image_finish_read(&image, NULL, back, 0, NULL));
    for (int i = 0; i < WIDTH * HEIGHT; i++) {
        assert_memory_equal(back + 3 * i, dented + 4 * i, 3);
    }
    // GIF: two frames of the right size
    pal_gif *gif = NULL;
    assert_int_equal(pal_gif_open(path, WIDTH, HEIGHT, 0.1, &gif, &error), PALPATE_OK);
    assert_int_equal(pal_gif_add(gif, rest, &error), PALPATE_OK);
    assert_int_equal(pal_gif_add(gif, dented, &error), PALPATE_OK);
    assert_int_equal(pal_gif_close(gif, &error), PALPATE_OK);
    int code = 0;
    GifFileType *read = DGifOpenFileName(path, &code);
    assert_non_null(read);
    assert_int_equal(DGifSlurp(read), GIF_OK);
    assert_int_equal(read->ImageCount, 2);
    assert_int_equal(read->SWidth, WIDTH);
    DGifCloseFile(read, &code);
    unlink(path);
    free(back);
    free(rest);
    free(dented);
    free(u);
    pal_canvas_free(canvas);
    pal_offscreen_free(off);
    pal_model_free(model);
}

static void bad_paths_and_sizes_are_refused(void **state) {
    (void)state;
    uint8_t pixel[4 * 16 * 16] = {0};
    pal_error error = {0};
    pal_gif *gif = NULL;
    pal_offscreen *off = NULL;
    assert_int_equal(pal_picture_write_png("/nonexistent/x.png", 16, 16, pixel, &error),
                     PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, "/nonexistent/x.png"));
    assert_int_equal(pal_gif_open("/nonexistent/x.gif", 16, 16, 0.1, &gif, &error),
                     PALPATE_ERROR_IO);
    assert_null(gif);
    assert_int_equal(pal_offscreen_create(3, 16, &off, &error), PALPATE_ERROR_ARGUMENT);
}

static void scales_round_up_to_plain_numbers(void **state) {
    (void)state;
    const double in[] = {0.9, 1.0, 1.1, 2.0, 2.1, 5.1, 0.00031},
                 out[] = {1, 1, 1.5, 2, 3, 6, 0.0004};
    for (int i = 0; i < 7; i++) {
        assert_true(fabs(pal_round_up(in[i]) - out[i]) < 1e-12 * out[i]);
    }
    assert_true(pal_round_up(0.0) > 0.0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(picture_shows_the_dent_and_the_force),
        cmocka_unit_test(bad_paths_and_sizes_are_refused),
        cmocka_unit_test(scales_round_up_to_plain_numbers),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
