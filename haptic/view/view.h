/// @file view.h  Pictures of a running model: the deformed surface, the tools, the forces.
///
/// Used by the program, not part of libpalpate. Everything with a pal_canvas runs on the one thread
/// whose OpenGL context is current; nothing here is called from the servo thread.
#ifndef PALPATE_VIEW_H
#define PALPATE_VIEW_H

#include <stdint.h>

#include <palpate/engine.h>
#include <palpate/model.h>

/// ---- OpenGL context without a display (offscreen.c) --------------------------------------------
typedef struct pal_offscreen pal_offscreen;
/// EGL surfaceless context with a multisampled framebuffer, made current on this thread.
/// @return PALPATE_OK; PALPATE_ERROR_SYSTEM with the missing package or capability
pal_status pal_offscreen_create(int width, int height, pal_offscreen **out, pal_error *error);
void pal_offscreen_free(pal_offscreen *offscreen);
/// Make the framebuffer the target of the next drawing.
void pal_offscreen_begin(pal_offscreen *offscreen);
/// Wait until the drawing is done (nothing is read back).
void pal_offscreen_end(pal_offscreen *offscreen);
/// Resolve and read the picture. @param[out] rgba  shape [height, width, 4], top row first
void pal_offscreen_read(pal_offscreen *offscreen, uint8_t *rgba);

/// ---- Camera
/// -------------------------------------------------------------------------------------
typedef struct pal_camera {
    double azimuth, elevation; ///< [rad], around the vertical (z)
    double distance;           ///< in body sizes
    double center[3];          ///< looked at [m]
} pal_camera;
/// A view of the body from above and aside, nearer to where the tools start.
pal_camera pal_camera_default(const pal_model *model);

/// ---- The canvas (canvas.c): the model's surface and its tools drawn by OpenGL
/// -------------------
typedef struct pal_canvas pal_canvas;
pal_status pal_canvas_create(const pal_model *model, pal_canvas **out, pal_error *error);
void pal_canvas_free(pal_canvas *canvas);

/// What the overlay adds to a frame.
typedef struct pal_caption {
    const char *title; ///< upper left; NULL: none
    double range;      ///< displacement at the top of the colour scale [m]; 0: this frame's largest
    const double *depth_history; ///< (history_count) [m], newest last; NULL: no plots
    const double *force_history; ///< (history_count) [N]
    int history_count;
    double history_seconds; ///< time the histories span
    const char *help;       ///< lines of a help box; NULL: none
    int paused;
} pal_caption;

/// Draw a frame (NULL: the rest shape) into the current framebuffer of width x height pixels.
void pal_canvas_draw(pal_canvas *canvas, const pal_frame *frame, const pal_runtime_config *tools,
                     const pal_camera *camera, const pal_caption *caption, int width, int height);
/// Largest displacement of the last frame drawn [m].
double pal_canvas_largest(const pal_canvas *canvas);
/// World ray under a pixel of the last drawing: origin and unit direction [m], body frame.
void pal_canvas_ray(const pal_canvas *canvas, double x, double y, double origin[3],
                    double direction[3]);

/// ---- Overlay (overlay.c): text, scale and plots by cairo, as a picture to be blended on top
/// --------
/// @param[out] argb  premultiplied ARGB32 of width x height (cairo's native layout), overwritten
/// @param labels  force labels: pixel position and text
typedef struct pal_label {
    double x, y;
    char text[64];
} pal_label;
void pal_overlay_draw(uint8_t *argb, int width, int height, const pal_caption *caption,
                      double range, const pal_label *labels, int label_count);
/// Colour of the displacement scale at t in [0, 1]: the same in the shader and in the legend.
void pal_colour(double t, double rgb[3]);
/// The next of 1, 1.5, 2, 3, 4, 5, 6, 8 times a power of ten at or above x.
double pal_round_up(double x);

/// ---- Plots (plot.c): numbers over time, as a picture
/// --------------------------------------------- One curve: the lowest and highest value within
/// each column of pixels; NaN where there is none.
typedef struct pal_plot_series {
    const double *low, *high; ///< shape [columns]
    double colour[3];
    const char *name;
} pal_plot_series;
typedef struct pal_plot_panel {
    const char *title, *unit;
    double floor; ///< the least value a logarithmic panel shows
    pal_plot_series series[PALPATE_TOOLS_MAX];
    int series_count, logarithmic;
} pal_plot_panel;
typedef struct pal_plot {
    const char *title;
    double from, to;     ///< time at the first and behind the last column [s]
    int columns;         ///< pal_plot_columns of the picture's size
    const uint8_t *mark; ///< (columns) 1: shade it; NULL: none
    int panel_count;
    const pal_plot_panel *panel;
} pal_plot;
/// Columns of the plotting area of a picture of that size.
int pal_plot_columns(int width, int height);
/// @return PALPATE_OK; _ARGUMENT (too small, other columns), _IO, _MEMORY
pal_status pal_plot_write_png(const char *path, int width, int height, const pal_plot *plot,
                              pal_error *error);

/// ---- Pictures (picture.c)
/// ----------------------------------------------------------------------- Write an RGBA picture
/// (alpha ignored) as PNG: temporary file, then rename.
pal_status pal_picture_write_png(const char *path, int width, int height, const uint8_t *rgba,
                                 pal_error *error);
/// An animated GIF, frame by frame (6x6x6 colour cube with ordered dithering).
typedef struct pal_gif pal_gif;
pal_status pal_gif_open(const char *path, int width, int height, double frame_seconds,
                        pal_gif **out, pal_error *error);
pal_status pal_gif_add(pal_gif *gif, const uint8_t *rgba, pal_error *error);
pal_status pal_gif_close(pal_gif *gif, pal_error *error);

#endif
