/// @file plot.c  Curves over time as a picture, drawn by cairo: panels below each other, one time
/// axis.
///
/// What a panel shows is the range (lowest to highest) of a number within each column of pixels, so
/// a spike of one tick in an hour is still there; where a column holds one value the range is a
/// point and neighbours are joined. Layout in units of the picture's height, so any size reads
/// alike.
#include "haptic/view/view.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cairo.h>

#include "haptic/base/error.h"

typedef struct frame {
    double x, y, w, h; ///< of a panel's plotting area [px]
    double low, high;  ///< values at its bottom and top (logarithms where `logarithmic`)
    int logarithmic;
    double unit; ///< height of small text
} frame;

static double unit_of(int height) {
    return fmax(8.0, height / 56.0);
}

static double left_of(int height) {
    return 7.0 * unit_of(height);
}

int pal_plot_columns(int width, int height) {
    return (int)(width - left_of(height) - 1.5 * unit_of(height));
}

static void write_text(cairo_t *c, double x, double y, double size, double anchor, const char *s) {
    cairo_text_extents_t e;
    cairo_select_font_face(c, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(c, size);
    cairo_text_extents(c, s, &e);
    cairo_move_to(c, x - anchor * e.x_advance, y);
    cairo_show_text(c, s);
}

/// A step of 1, 2 or 5 times a power of ten that cuts `range` into about `parts`.
static double step_of(double range, int parts) {
    double rough = range / parts, power = pow(10.0, floor(log10(rough)));
    double m = rough / power;
    return power * (m < 1.5 ? 1.0 : m < 3.5 ? 2.0 : m < 7.5 ? 5.0 : 10.0);
}

static double place(const frame *f, double value) {
    double v = f->logarithmic ? log10(fmax(value, 1e-300)) : value;
    return f->y + f->h * (1.0 - fmin(1.0, fmax(0.0, (v - f->low) / (f->high - f->low))));
}

/// The values shown, with room: from 0 or the lowest to the next round number.
static void scale(frame *f, const pal_plot_panel *p, int columns) {
    double low = HUGE_VAL, high = -HUGE_VAL;
    for (int s = 0; s < p->series_count; s++) {
        for (int i = 0; i < columns; i++) {
            if (p->series[s].low[i] <= p->series[s].high[i]) { // false for NaN: nothing there
                low = fmin(low, p->series[s].low[i]);
                high = fmax(high, p->series[s].high[i]);
            }
        }
    }
    f->logarithmic = p->logarithmic;
    if (p->logarithmic) {
        double floor_value = p->floor > 0.0 ? p->floor : 1e-3;
        f->low = floor(log10(fmax(fmin(low, 1e12), floor_value)));
        f->high = fmax(f->low + 1.0, ceil(log10(fmax(fmin(high, 1e12), floor_value))));
        return;
    }
    f->low = fmin(0.0, low < HUGE_VAL ? low : 0.0);
    f->high = high > f->low ? high : f->low + 1.0;
    double step = step_of(f->high - f->low, 4);
    f->low = step * floor(f->low / step);
    f->high = step * ceil(f->high / step * (1.0 + 1e-12));
}

static void draw_levels(cairo_t *c, const frame *f) {
    char s[32];
    double step =
        f->logarithmic ? fmax(1.0, ceil((f->high - f->low) / 4.0)) : step_of(f->high - f->low, 4);
    for (int i = 0; f->low + i * step <= f->high * (1.0 + 1e-9) + 1e-12 && i < 20; i++) {
        double v = f->low + i * step, y = f->y + f->h * (1.0 - (v - f->low) / (f->high - f->low));
        cairo_set_source_rgb(c, 0.88, 0.88, 0.90);
        cairo_set_line_width(c, 1.0);
        cairo_move_to(c, f->x, y);
        cairo_line_to(c, f->x + f->w, y);
        cairo_stroke(c);
        cairo_set_source_rgb(c, 0.15, 0.15, 0.18);
        (void)snprintf(s, sizeof s, "%.6g", f->logarithmic ? pow(10.0, v) : v);
        write_text(c, f->x - 0.5 * f->unit, y + 0.35 * f->unit, 0.9 * f->unit, 1.0, s);
    }
}

static void draw_series(cairo_t *c, const frame *f, const pal_plot_series *s, int columns) {
    int open = 0;
    cairo_set_source_rgb(c, s->colour[0], s->colour[1], s->colour[2]);
    cairo_set_line_width(c, 1.3);
    for (int i = 0; i < columns; i++) {
        if (!(s->low[i] <= s->high[i])) { // nothing fell into it: the line is cut
            open = 0;
            continue;
        }
        double x = f->x + i + 0.5, top = place(f, s->high[i]), bottom = place(f, s->low[i]);
        if (open) {
            cairo_line_to(c, x, top);
        } else {
            cairo_move_to(c, x, top);
        }
        cairo_line_to(c, x, fmax(bottom, top + 0.7)); // a lone point is seen, too
        open = 1;
    }
    cairo_stroke(c);
}

static void draw_panel(cairo_t *c, const pal_plot *plot, const pal_plot_panel *p, frame *f) {
    char s[128];
    scale(f, p, plot->columns);
    cairo_set_source_rgb(c, 1.0, 1.0, 1.0);
    cairo_rectangle(c, f->x, f->y, f->w, f->h);
    cairo_fill(c);
    for (int i = 0; plot->mark != NULL && i < plot->columns; i++) {
        if (plot->mark[i]) {
            cairo_set_source_rgba(c, 0.85, 0.15, 0.10, 0.25);
            cairo_rectangle(c, f->x + i, f->y, 1.0, f->h);
            cairo_fill(c);
        }
    }
    draw_levels(c, f);
    for (int k = 0; k < p->series_count; k++) {
        draw_series(c, f, &p->series[k], plot->columns);
    }
    cairo_set_source_rgb(c, 0.45, 0.45, 0.50);
    cairo_set_line_width(c, 1.0);
    cairo_rectangle(c, f->x, f->y, f->w, f->h);
    cairo_stroke(c);
    cairo_set_source_rgb(c, 0.10, 0.10, 0.12);
    (void)snprintf(s, sizeof s, "%s [%s]", p->title, p->unit);
    write_text(c, f->x, f->y - 0.45 * f->unit, 1.05 * f->unit, 0.0, s);
    double at = f->x + f->w;
    for (int k = p->series_count - 1; k >= 0 && p->series_count > 1; k--) {
        cairo_text_extents_t e;
        cairo_text_extents(c, p->series[k].name, &e);
        at -= e.x_advance + f->unit;
        cairo_set_source_rgb(c, p->series[k].colour[0], p->series[k].colour[1],
                             p->series[k].colour[2]);
        write_text(c, at, f->y - 0.45 * f->unit, f->unit, 0.0, p->series[k].name);
    }
}

static void draw_time(cairo_t *c, const pal_plot *plot, const frame *last, double top) {
    double span = plot->to - plot->from, step = step_of(span > 0.0 ? span : 1.0, 8);
    char s[32];
    for (int64_t i = (int64_t)ceil(plot->from / step - 1e-9);
         (double)i * step <= plot->to + 1e-9 * span; i++) {
        double x = last->x + (span > 0.0 ? last->w * ((double)i * step - plot->from) / span : 0.0);
        cairo_set_source_rgba(c, 0.5, 0.5, 0.55, 0.25);
        cairo_set_line_width(c, 1.0);
        cairo_move_to(c, x, top);
        cairo_line_to(c, x, last->y + last->h);
        cairo_stroke(c);
        cairo_set_source_rgb(c, 0.15, 0.15, 0.18);
        (void)snprintf(s, sizeof s, "%.6g", (double)i * step);
        write_text(c, x, last->y + last->h + 1.4 * last->unit, 0.9 * last->unit, 0.5, s);
        if (!(span > 0.0)) {
            break;
        }
    }
    write_text(c, last->x + last->w, last->y + last->h + 2.7 * last->unit, last->unit, 1.0,
               "session time [s]");
}

pal_status pal_plot_write_png(const char *path, int width, int height, const pal_plot *plot,
                              pal_error *error) {
    if (plot->columns != pal_plot_columns(width, height) || plot->columns < 16 ||
        plot->panel_count < 1) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "%s: %dx%d is too small for the plot", path,
                        width, height);
    }
    cairo_surface_t *surface = cairo_image_surface_create(CAIRO_FORMAT_RGB24, width, height);
    cairo_t *c = cairo_create(surface);
    double unit = unit_of(height), top = 4.0 * unit, bottom = 3.5 * unit, gap = 2.2 * unit;
    double each = (height - top - bottom - gap * (plot->panel_count - 1)) / plot->panel_count;
    frame f = {.x = left_of(height), .w = plot->columns, .h = each, .unit = unit};
    cairo_set_source_rgb(c, 0.965, 0.965, 0.975);
    cairo_paint(c);
    cairo_set_source_rgb(c, 0.10, 0.10, 0.12);
    write_text(c, f.x, 1.7 * unit, 1.2 * unit, 0.0, plot->title);
    for (int i = 0; i < plot->panel_count; i++) {
        f.y = top + i * (each + gap);
        draw_panel(c, plot, &plot->panel[i], &f);
    }
    draw_time(c, plot, &f, top);
    cairo_destroy(c);
    cairo_surface_flush(surface);
    pal_status status = PALPATE_OK;
    uint8_t *rgba = malloc(4 * (size_t)width * (size_t)height);
    if (cairo_surface_status(surface) != CAIRO_STATUS_SUCCESS || rgba == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory for a picture of %dx%d", path,
                          width, height);
    } else {
        const uint8_t *data = cairo_image_surface_get_data(surface);
        size_t stride = (size_t)cairo_image_surface_get_stride(surface);
        for (size_t y = 0; y < (size_t)height; y++) {
            for (size_t x = 0; x < (size_t)width; x++) {
                uint32_t pixel;
                memcpy(&pixel, data + y * stride + 4 * x, sizeof pixel);
                uint8_t *to = rgba + 4 * (y * (size_t)width + x);
                to[0] = (uint8_t)(pixel >> 16);
                to[1] = (uint8_t)(pixel >> 8);
                to[2] = (uint8_t)pixel;
                to[3] = 255;
            }
        }
        status = pal_picture_write_png(path, width, height, rgba, error);
    }
    free(rgba);
    cairo_surface_destroy(surface);
    return status;
}
