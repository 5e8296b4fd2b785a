/// @file painter.c  Drawing on the session's render thread (see painter.h).
#include "haptic/program/painter.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "haptic/base/error.h"
#include "haptic/view/view.h"

struct painter {
    painter_def def;
    pal_camera camera;
    pal_offscreen *offscreen;
    pal_canvas *canvas;
    pal_gif *gif;
    uint8_t *picture;
    double best_force, range, gif_next;
    float *copy; ///< displacement of the best frame
    pal_frame best_frame;
    unsigned long frames;
    double seconds;
    int started;
    pal_status status;
    pal_error error;
};

/// Can pictures be drawn at all? The context is used by nobody.
static pal_status try_drawing(const painter_def *def, pal_error *error) {
    pal_offscreen *offscreen = NULL;
    if (def->snapshot_path == NULL && def->gif_path == NULL) {
        return PALPATE_OK;
    }
    pal_status status = pal_offscreen_create(def->width, def->height, &offscreen, error);
    pal_offscreen_free(offscreen);
    return status;
}

pal_status painter_create(const painter_def *def, painter **out, pal_error *error) {
    *out = NULL;
    pal_status status = try_drawing(def, error);
    if (status != PALPATE_OK) {
        return status;
    }
    painter *p = calloc(1, sizeof *p);
    pal_model_info info;
    pal_model_get_info(def->model, &info);
    if (p != NULL) {
        p->def = *def;
        p->camera = pal_camera_default(def->model);
        p->best_force = -1.0;
        p->picture = malloc(4 * (size_t)def->width * (size_t)def->height);
        p->copy = malloc((3 * (size_t)info.row_count + 1) * sizeof *p->copy);
    }
    if (p == NULL || p->picture == NULL || p->copy == NULL) {
        painter_free(p);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for a picture of %dx%d", def->width,
                        def->height);
    }
    *out = p;
    return PALPATE_OK;
}

static void start(painter *p) {
    p->started = 1;
    p->status = pal_offscreen_create(p->def.width, p->def.height, &p->offscreen, &p->error);
    if (p->status == PALPATE_OK) {
        p->status = pal_canvas_create(p->def.model, &p->canvas, &p->error);
    }
    if (p->status == PALPATE_OK && p->def.gif_path != NULL) {
        p->status = pal_gif_open(p->def.gif_path, p->def.width, p->def.height, p->def.gif_period,
                                 &p->gif, &p->error);
    }
}

static double force_size(const pal_frame *frame, double *depth) {
    double largest = 0.0;
    *depth = 0.0;
    for (int32_t t = 0; t < frame->tool_count; t++) {
        const double *f = frame->tool_force[t].force;
        largest = fmax(largest, sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
        *depth = fmax(*depth, frame->tool_force[t].depth);
    }
    return largest;
}

/// @param keep  1: full size and read back into p->picture; 0: half size, drawn only
static void draw(painter *p, const pal_frame *frame, int keep) {
    int width = keep ? p->def.width : p->def.width / 2,
        height = keep ? p->def.height : p->def.height / 2;
    char title[512];
    double depth, force = force_size(frame, &depth);
    (void)snprintf(title, sizeof title, "%s\nt = %.2f s\nforce %.3f N\ndepth %.2f mm", p->def.title,
                   1e-9 * (double)frame->time_ns, force, 1e3 * depth);
    pal_caption caption = {.title = title, .range = p->range};
    pal_offscreen_begin(p->offscreen);
    pal_canvas_draw(p->canvas, frame, p->def.runtime, &p->camera, &caption, width, height);
    double largest = pal_canvas_largest(p->canvas);
    if (largest > p->range) { // the scale grows with the run, in steps, and never shrinks
        p->range = pal_round_up(largest);
    }
    if (keep) {
        pal_offscreen_read(p->offscreen, p->picture);
    } else {
        pal_offscreen_end(p->offscreen);
    }
}

/// Last call, still on the render thread: the snapshot, the end of the GIF, the context.
static void finish(painter *p) {
    if (p->started && p->status == PALPATE_OK && p->def.snapshot_path != NULL) {
        p->range = 0.0;
        if (p->best_force >= 0.0) {
            draw(p, &p->best_frame, 1);
        } else {
            pal_caption caption = {.title = p->def.title};
            pal_offscreen_begin(p->offscreen);
            pal_canvas_draw(p->canvas, NULL, p->def.runtime, &p->camera, &caption, p->def.width,
                            p->def.height);
            pal_offscreen_read(p->offscreen, p->picture);
        }
        p->status = pal_picture_write_png(p->def.snapshot_path, p->def.width, p->def.height,
                                          p->picture, &p->error);
    }
    pal_status closed = pal_gif_close(p->gif, p->status == PALPATE_OK ? &p->error : NULL);
    p->status = p->status == PALPATE_OK ? closed : p->status;
    p->gif = NULL;
    pal_canvas_free(p->canvas);
    pal_offscreen_free(p->offscreen);
    p->canvas = NULL;
    p->offscreen = NULL;
}

static void keep_if_best(painter *p, const pal_frame *frame) {
    double depth, force = force_size(frame, &depth);
    if (p->def.snapshot_path == NULL || force <= p->best_force) {
        return;
    }
    p->best_force = force;
    p->best_frame = *frame;
    if (frame->row_count > 0) {
        memcpy(p->copy, frame->displacement, 3 * (size_t)frame->row_count * sizeof *p->copy);
    }
    p->best_frame.displacement = p->copy;
}

void painter_frame(void *user, const pal_frame *frame) {
    painter *p = user;
    if (!p->started) {
        start(p);
    }
    if (frame == NULL) {
        finish(p);
        return;
    }
    if (p->status != PALPATE_OK) {
        return;
    }
    struct timespec a, b;
    clock_gettime(CLOCK_MONOTONIC, &a);
    double now = 1e-9 * (double)frame->time_ns;
    int animate = p->gif != NULL && now >= p->gif_next;
    draw(p, frame, animate);
    keep_if_best(p, frame);
    if (animate) {
        p->gif_next = now + p->def.gif_period - 1e-6;
        p->status = pal_gif_add(p->gif, p->picture, &p->error);
    }
    clock_gettime(CLOCK_MONOTONIC, &b);
    p->seconds += (double)(b.tv_sec - a.tv_sec) + 1e-9 * (double)(b.tv_nsec - a.tv_nsec);
    p->frames++;
}

pal_status painter_status(const painter *p, pal_error *error) {
    if (p->status != PALPATE_OK && error != NULL) {
        *error = p->error;
    }
    return p->status;
}

unsigned long painter_count(const painter *p, double *mean_seconds) {
    *mean_seconds = p->frames > 0 ? p->seconds / (double)p->frames : 0.0;
    return p->frames;
}

void painter_free(painter *p) {
    if (p == NULL) {
        return;
    }
    free(p->picture);
    free(p->copy);
    free(p);
}
