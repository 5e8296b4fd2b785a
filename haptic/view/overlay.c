/// @file overlay.c  Text, colour scale and plots over the picture, drawn by cairo.
#include "haptic/view/view.h"

#include <math.h>
#include <stdio.h>
#include <string.h>

#include <cairo.h>

/// From the colour of resting tissue through blue and green to yellow, sampled at 9 points.
static const double tissue_scale[9][3] = {
    {0.82, 0.65, 0.60}, {0.70, 0.60, 0.62}, {0.50, 0.52, 0.62},
    {0.30, 0.46, 0.60}, {0.16, 0.50, 0.56}, {0.13, 0.60, 0.53},
    {0.30, 0.72, 0.43}, {0.60, 0.84, 0.26}, {0.99, 0.91, 0.14}};

void pal_colour(double t, double rgb[3]) {
    t = t > 0.0 ? (t < 1.0 ? t : 1.0) : 0.0;
    int i = (int)(8.0 * t);
    i = i > 7 ? 7 : i;
    double f = 8.0 * t - i;
    for (int k = 0; k < 3; k++) {
        rgb[k] = (1.0 - f) * tissue_scale[i][k] + f * tissue_scale[i + 1][k];
    }
}

double pal_round_up(double x) {
    if (!(x > 0.0) || !isfinite(x)) {
        return 1e-6;
    }
    double p = pow(10.0, floor(log10(x)));
    double m = x / p;
    static const double step[] = {1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0};
    int i = 0;
    while (i < 8 && m > step[i]) {
        i++;
    }
    return p * step[i];
}

/// A length in the unit that reads best.
static void length_text(double metres, char *out, size_t size) {
    double a = fabs(metres);
    if (a >= 1.0 || a == 0.0) {
        (void)snprintf(out, size, "%.3g m", metres);
    } else if (a >= 1e-4) {
        (void)snprintf(out, size, "%.3g mm", 1e3 * metres);
    } else {
        (void)snprintf(out, size, "%.3g \302\265m", 1e6 * metres);
    }
}

static void text(cairo_t *c, double x, double y, double size, int bold, const char *s) {
    cairo_select_font_face(c, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL,
                           bold ? CAIRO_FONT_WEIGHT_BOLD : CAIRO_FONT_WEIGHT_NORMAL);
    cairo_set_font_size(c, size);
    cairo_move_to(c, x, y);
    cairo_show_text(c, s);
}

static void draw_scale(cairo_t *c, double unit, int width, int height, double range) {
    double w = 1.4 * unit, h = 0.42 * height, x = width - 7.5 * unit, y = 0.5 * (height - h);
    for (int i = 0; i < 128; i++) {
        double rgb[3];
        pal_colour((i + 0.5) / 128.0, rgb);
        cairo_set_source_rgb(c, rgb[0], rgb[1], rgb[2]);
        cairo_rectangle(c, x, y + h * (127 - i) / 128.0, w, h / 128.0 + 1.0);
        cairo_fill(c);
    }
    cairo_set_source_rgb(c, 0.15, 0.15, 0.18);
    cairo_set_line_width(c, 1.0);
    cairo_rectangle(c, x, y, w, h);
    cairo_stroke(c);
    for (int i = 0; i <= 4; i++) {
        char s[32];
        length_text(range * i / 4.0, s, sizeof s);
        text(c, x + w + 0.5 * unit, y + h * (4 - i) / 4.0 + 0.35 * unit, unit, 0, i ? s : "0");
    }
    text(c, x - 2.2 * unit, y - unit, unit, 0, "displacement");
}

static void draw_plot(cairo_t *c, double unit, double x, double y, double w, double h,
                      const double *v, int count, double seconds, const char *title,
                      const char *unit_text, double factor) {
    double top = 0.0;
    for (int i = 0; i < count; i++) {
        top = fmax(top, fabs(v[i]) * factor);
    }
    top = pal_round_up(top);
    cairo_set_source_rgba(c, 1.0, 1.0, 1.0, 0.75);
    cairo_rectangle(c, x, y, w, h);
    cairo_fill_preserve(c);
    cairo_set_source_rgb(c, 0.6, 0.6, 0.65);
    cairo_set_line_width(c, 1.0);
    cairo_stroke(c);
    cairo_set_source_rgb(c, 0.75, 0.2, 0.15);
    cairo_set_line_width(c, 1.6);
    for (int i = 0; i < count; i++) {
        double px = x + w * (count > 1 ? i / (count - 1.0) : 1.0);
        double py = y + h - h * 0.92 * fabs(v[i]) * factor / top;
        if (i == 0) {
            cairo_move_to(c, px, py);
        } else {
            cairo_line_to(c, px, py);
        }
    }
    cairo_stroke(c);
    char s[128];
    cairo_set_source_rgb(c, 0.15, 0.15, 0.18);
    (void)snprintf(s, sizeof s, "%s %.3g %s", title, count ? fabs(v[count - 1]) * factor : 0.0,
                   unit_text);
    text(c, x + 0.4 * unit, y + 1.2 * unit, unit, 1, s);
    (void)snprintf(s, sizeof s, "scale %.3g %s, last %.3g s", top, unit_text, seconds);
    text(c, x + 0.4 * unit, y + h - 0.4 * unit, 0.8 * unit, 0, s);
}

void pal_overlay_draw(uint8_t *argb, int width, int height, const pal_caption *caption,
                      double range, const pal_label *labels, int label_count) {
    int stride = cairo_format_stride_for_width(CAIRO_FORMAT_ARGB32, width);
    memset(argb, 0, (size_t)stride * (size_t)height);
    cairo_surface_t *surface =
        cairo_image_surface_create_for_data(argb, CAIRO_FORMAT_ARGB32, width, height, stride);
    cairo_t *c = cairo_create(surface);
    double unit = fmax(9.0, height / 50.0);
    draw_scale(c, unit, width, height, range);
    if (caption->title != NULL) {
        cairo_set_source_rgb(c, 0.1, 0.1, 0.12);
        double y = 2.0 * unit;
        char line[256];
        const char *s = caption->title;
        for (int i = 0; *s != '\0' && i < 12; i++) {
            size_t n = strcspn(s, "\n");
            (void)snprintf(line, sizeof line, "%.*s", (int)n, s);
            text(c, 1.2 * unit, y, i == 0 ? 1.3 * unit : unit, i == 0, line);
            y += 1.6 * unit;
            s += n + (s[n] == '\n');
        }
    }
    if (caption->history_count > 1) {
        double w = 0.28 * width, h = 0.13 * height;
        if (caption->force_history != NULL) {
            draw_plot(c, unit, unit, height - 2.0 * h - 2.0 * unit, w, h, caption->force_history,
                      caption->history_count, caption->history_seconds, "force", "N", 1.0);
        }
        if (caption->depth_history != NULL) {
            draw_plot(c, unit, unit, height - h - unit, w, h, caption->depth_history,
                      caption->history_count, caption->history_seconds, "depth", "mm", 1e3);
        }
    }
    for (int i = 0; i < label_count; i++) {
        cairo_set_source_rgba(c, 1.0, 1.0, 1.0, 0.8);
        cairo_text_extents_t e;
        cairo_select_font_face(c, "DejaVu Sans", CAIRO_FONT_SLANT_NORMAL, CAIRO_FONT_WEIGHT_BOLD);
        cairo_set_font_size(c, 1.2 * unit);
        cairo_text_extents(c, labels[i].text, &e);
        cairo_rectangle(c, labels[i].x + 0.4 * unit, labels[i].y - 1.3 * unit, e.width + 0.8 * unit,
                        1.8 * unit);
        cairo_fill(c);
        cairo_set_source_rgb(c, 0.7, 0.1, 0.1);
        text(c, labels[i].x + 0.8 * unit, labels[i].y, 1.2 * unit, 1, labels[i].text);
    }
    if (caption->help != NULL) {
        double w = 0.5 * width, h = 0.6 * height, x = 0.5 * (width - w), y = 0.5 * (height - h);
        cairo_set_source_rgba(c, 1.0, 1.0, 1.0, 0.9);
        cairo_rectangle(c, x, y, w, h);
        cairo_fill(c);
        cairo_set_source_rgb(c, 0.1, 0.1, 0.12);
        const char *s = caption->help;
        double at = y + 2.5 * unit;
        while (*s != '\0') {
            char line[256];
            size_t n = strcspn(s, "\n");
            (void)snprintf(line, sizeof line, "%.*s", (int)n, s);
            text(c, x + 2.0 * unit, at, unit, 0, line);
            at += 1.6 * unit;
            s += n + (s[n] == '\n');
        }
    }
    if (caption->paused) {
        cairo_set_source_rgb(c, 0.7, 0.1, 0.1);
        text(c, 0.5 * width - 3.0 * unit, 2.5 * unit, 1.6 * unit, 1, "paused");
    }
    cairo_destroy(c);
    cairo_surface_flush(surface);
    cairo_surface_destroy(surface);
}
