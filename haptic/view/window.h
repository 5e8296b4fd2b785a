/// @file window.h  A window with an OpenGL context and the mouse as camera and tool (GLFW).
#ifndef PALPATE_VIEW_WINDOW_H
#define PALPATE_VIEW_WINDOW_H

#include "haptic/view/view.h"

typedef struct pal_window pal_window;

/// What the user asked for since the last poll.
typedef struct pal_window_input {
    int close, pause, reset, help, snapshot, toggle_mouse, unlatch; ///< 1: asked
    double orbit[2];  ///< camera azimuth and elevation to add [rad]
    double pan[2];    ///< camera shift, in window heights
    double zoom;      ///< factor on the camera's distance
    double cursor[2]; ///< pixel of the framebuffer
    int pressing;     ///< 1 while the left button is down
    double push;      ///< wheel steps while pressing: deeper (> 0) or less
} pal_window_input;

/// @return PALPATE_OK; PALPATE_ERROR_SYSTEM: no display (the message says how to do without)
pal_status pal_window_create(int width, int height, const char *title, pal_window **out,
                             pal_error *error);
void pal_window_free(pal_window *window);
/// Handle events; the size of the framebuffer is returned too.
void pal_window_poll(pal_window *window, pal_window_input *input, int *width, int *height);
/// Show what was drawn.
void pal_window_show(pal_window *window);
/// Read the picture just drawn (before pal_window_show). @param[out] rgba shape [height, width, 4]
void pal_window_read(pal_window *window, int width, int height, uint8_t *rgba);

#endif
