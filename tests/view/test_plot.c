/// The plot: curves lie where their values say, gaps stay gaps, faults are shaded, errors are
/// located.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>
#include <png.h>

#include "haptic/view/view.h"

enum { WIDTH = 640, HEIGHT = 480 };

static uint8_t *drawn(const pal_plot *plot) {
    char path[] = "/tmp/palpate-plot-XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    (void)close(fd);
    pal_error e = {0};
    if (pal_plot_write_png(path, WIDTH, HEIGHT, plot, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    png_image image;
    memset(&image, 0, sizeof image);
    image.version = PNG_IMAGE_VERSION;
    assert_true(png_image_begin_read_from_file(&image, path));
    assert_int_equal(image.width, WIDTH);
    assert_int_equal(image.height, HEIGHT);
    image.format = PNG_FORMAT_RGBA;
    uint8_t *rgba = malloc(PNG_IMAGE_SIZE(image));
    assert_non_null(rgba);
    assert_true(png_image_finish_read(&image, NULL, rgba, 0, NULL));
    (void)unlink(path);
    return rgba;
}

/// Row of the topmost pixel of a column that is nearly of that colour; -1: none.
static int topmost(const uint8_t *rgba, int x, const double colour[3]) {
    for (int y = 0; y < HEIGHT; y++) {
        const uint8_t *p = rgba + 4 * (y * WIDTH + x);
        double off = 0.0;
        for (int k = 0; k < 3; k++) {
            off = fmax(off, fabs(p[k] / 255.0 - colour[k]));
        }
        if (off < 0.25) {
            return y;
        }
    }
    return -1;
}

static void curves_lie_where_their_values_say(void **state) {
    (void)state;
    int n = pal_plot_columns(WIDTH, HEIGHT), left = WIDTH - n;
    double *v = malloc(2 * (size_t)n * sizeof *v);
    uint8_t *mark = calloc((size_t)n, 1);
    assert_non_null(v);
    assert_non_null(mark);
    for (int i = 0; i < n; i++) { // a straight line up to 4, with a gap
        v[i] = v[n + i] = 4.0 * i / (n - 1);
        if (i > n / 2 && i < n / 2 + 40) {
            v[i] = v[n + i] = (double)NAN;
        }
    }
    v[n + n / 4] = 3.0; // one tick's spike within its column
    pal_plot_panel panel = {.title = "force", .unit = "N", .series_count = 1};
    panel.series[0] = (pal_plot_series){v, v + n, {0.9, 0.0, 0.0}, "probe"};
    pal_plot plot = {
        .title = "a test", .from = 0.0, .to = 2.0, .columns = n, .panel_count = 1, .panel = &panel};
    uint8_t *rgba = drawn(&plot);
    // the right margin is narrower than the left one: find the first column drawn
    int first = -1, last = -1;
    for (int x = 0; x < WIDTH; x++) {
        if (topmost(rgba, x, panel.series[0].colour) >= 0) {
            first = first < 0 ? x : first;
            last = x;
        }
    }
    assert_true(first > 0 && first < left && last < WIDTH);
    assert_true(abs(last - first - (n - 1)) <= 2); // the line's width
    int y0 = topmost(rgba, first + 2, panel.series[0].colour);
    int y1 = topmost(rgba, last - 2, panel.series[0].colour);
    assert_true(y0 > y1 + HEIGHT / 2);
    double expected = y0 + (y1 - y0) * 0.75; // three quarters up at three quarters of the way
    assert_true(fabs(topmost(rgba, first + 3 * n / 4, panel.series[0].colour) - expected) < 4.0);
    assert_true(fabs(topmost(rgba, first + n / 4, panel.series[0].colour) - expected) <
                4.0);                                                                // the spike
    assert_int_equal(topmost(rgba, first + n / 2 + 20, panel.series[0].colour), -1); // the gap
    // a marked column is shaded
    mark[n / 2 + 20] = 1;
    plot.mark = mark;
    uint8_t *marked = drawn(&plot);
    const uint8_t *before = rgba + 4 * (HEIGHT / 2 * WIDTH + first + n / 2 + 20);
    const uint8_t *after = marked + 4 * (HEIGHT / 2 * WIDTH + first + n / 2 + 20);
    assert_true(after[1] + 30 < before[1] && after[0] + 20 > before[0]);
    free(marked);
    free(rgba);
    // logarithmic: a decade is a decade
    plot.mark = NULL;
    panel.logarithmic = 1;
    panel.floor = 1.0;
    for (int i = 0; i < n; i++) {
        v[i] = v[n + i] = i < n / 3 ? 2.0 : i < 2 * n / 3 ? 20.0 : 200.0; // off the frame
    }
    rgba = drawn(&plot);
    int a = topmost(rgba, first + n / 6, panel.series[0].colour);
    int b = topmost(rgba, first + n / 2, panel.series[0].colour);
    int c = topmost(rgba, first + 5 * n / 6, panel.series[0].colour);
    assert_true(a > b && b > c && abs((a - b) - (b - c)) <= 3);
    free(rgba);
    free(v);
    free(mark);
}

static void extremes_do_not_hang_or_crash(void **state) {
    (void)state;
    int n = pal_plot_columns(WIDTH, HEIGHT);
    double *v = malloc((size_t)n * sizeof *v);
    assert_non_null(v);
    static const double value[] = {0.0, -1e300, 1e300, 1e-300};
    for (size_t k = 0; k < sizeof value / sizeof *value; k++) {
        for (int logarithmic = 0; logarithmic < 2; logarithmic++) {
            for (int i = 0; i < n; i++) {
                v[i] = i % 2 ? value[k] : (double)NAN;
            }
            pal_plot_panel panel = {
                .title = "x", .unit = "1", .logarithmic = logarithmic, .series_count = 1};
            panel.series[0] = (pal_plot_series){v, v, {0, 0, 0}, ""};
            pal_plot plot = {.title = "",
                             .from = 5.0,
                             .to = 5.0,
                             .columns = n,
                             .panel_count = 1,
                             .panel = &panel};
            free(drawn(&plot));
            plot.from = -1e12;
            plot.to = 1e12;
            free(drawn(&plot));
        }
    }
    free(v);
}

static void errors_name_the_picture(void **state) {
    (void)state;
    double v[4096] = {0};
    pal_plot_panel panel = {.title = "x", .unit = "1", .series_count = 1};
    panel.series[0] = (pal_plot_series){v, v, {0, 0, 0}, ""};
    pal_plot plot = {.title = "", .to = 1.0, .columns = 10, .panel_count = 1, .panel = &panel};
    pal_error e = {0};
    assert_int_equal(pal_plot_write_png("/tmp/x.png", WIDTH, HEIGHT, &plot, &e),
                     PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(e.message, "/tmp/x.png"));
    plot.columns = pal_plot_columns(WIDTH, HEIGHT);
    assert_int_equal(pal_plot_write_png("/nonexistent/x.png", WIDTH, HEIGHT, &plot, &e),
                     PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "/nonexistent/x.png"));
    // what is not a file stays what it is
    char pipe[64];
    struct stat found;
    (void)snprintf(pipe, sizeof pipe, "/tmp/palpate-plot-pipe-%d", (int)getpid());
    assert_int_equal(mkfifo(pipe, 0600), 0);
    assert_int_equal(pal_plot_write_png(pipe, WIDTH, HEIGHT, &plot, &e), PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "not a regular file"));
    assert_int_equal(stat(pipe, &found), 0);
    assert_true(S_ISFIFO(found.st_mode));
    (void)unlink(pipe);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(curves_lie_where_their_values_say),
        cmocka_unit_test(extremes_do_not_hang_or_crash),
        cmocka_unit_test(errors_name_the_picture),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
