/// @file window.c  GLFW window and its input (see window.h). Main thread only.
#include "haptic/view/window.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include <epoxy/gl.h>
#define GLFW_INCLUDE_NONE
#include <GLFW/glfw3.h>

#include "haptic/base/error.h"

struct pal_window {
    GLFWwindow *handle;
    pal_window_input input; ///< gathered by the callbacks since the last poll
    double last[2];
    int orbiting, panning;
};

static void on_key(GLFWwindow *handle, int key, int scancode, int action, int mods) {
    (void)scancode;
    (void)mods;
    pal_window *w = glfwGetWindowUserPointer(handle);
    if (action != GLFW_PRESS) {
        return;
    }
    switch (key) {
    case GLFW_KEY_ESCAPE:
    case GLFW_KEY_Q:
        w->input.close = 1;
        break;
    case GLFW_KEY_SPACE:
        w->input.pause = 1;
        break;
    case GLFW_KEY_R:
        w->input.reset = 1;
        break;
    case GLFW_KEY_U:
        w->input.unlatch = 1;
        break;
    case GLFW_KEY_H:
    case GLFW_KEY_F1:
        w->input.help = 1;
        break;
    case GLFW_KEY_S:
        w->input.snapshot = 1;
        break;
    case GLFW_KEY_M:
        w->input.toggle_mouse = 1;
        break;
    default:
        break;
    }
}

static void on_button(GLFWwindow *handle, int button, int action, int mods) {
    pal_window *w = glfwGetWindowUserPointer(handle);
    int down = action == GLFW_PRESS;
    if (button == GLFW_MOUSE_BUTTON_LEFT && !(mods & GLFW_MOD_SHIFT)) {
        w->input.pressing = down;
    }
    if (button == GLFW_MOUSE_BUTTON_RIGHT ||
        (button == GLFW_MOUSE_BUTTON_LEFT && (mods & GLFW_MOD_SHIFT))) {
        w->orbiting = down;
    }
    if (button == GLFW_MOUSE_BUTTON_LEFT && !down) {
        w->input.pressing = 0;
        w->orbiting = 0;
    }
    if (button == GLFW_MOUSE_BUTTON_MIDDLE) {
        w->panning = down;
    }
}

static void on_move(GLFWwindow *handle, double x, double y) {
    pal_window *w = glfwGetWindowUserPointer(handle);
    int width = 1, height = 1, pixels_wide = 1, pixels_high = 1;
    glfwGetWindowSize(handle, &width, &height);
    glfwGetFramebufferSize(handle, &pixels_wide, &pixels_high);
    double dx = (x - w->last[0]) / (height > 0 ? height : 1),
           dy = (y - w->last[1]) / (height > 0 ? height : 1);
    w->last[0] = x;
    w->last[1] = y;
    w->input.cursor[0] = x * pixels_wide / (width > 0 ? width : 1);
    w->input.cursor[1] = y * pixels_high / (height > 0 ? height : 1);
    if (w->orbiting) {
        w->input.orbit[0] -= 4.0 * dx;
        w->input.orbit[1] += 3.0 * dy;
    }
    if (w->panning) {
        w->input.pan[0] += dx;
        w->input.pan[1] += dy;
    }
}

static void on_scroll(GLFWwindow *handle, double x, double y) {
    (void)x;
    pal_window *w = glfwGetWindowUserPointer(handle);
    if (w->input.pressing) {
        w->input.push += y;
    } else {
        w->input.zoom *= pow(0.9, y);
    }
}

pal_status pal_window_create(int width, int height, const char *title, pal_window **out,
                             pal_error *error) {
    *out = NULL;
    pal_window *w = calloc(1, sizeof *w);
    if (w == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    w->input.zoom = 1.0;
    if (!glfwInit()) {
        free(w);
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "no window can be opened here (is DISPLAY set?): use `palpate run "
                        "--snapshot FILE.png`, or "
                        "run under xvfb-run");
    }
    glfwWindowHint(GLFW_CONTEXT_VERSION_MAJOR, 3);
    glfwWindowHint(GLFW_CONTEXT_VERSION_MINOR, 3);
    glfwWindowHint(GLFW_OPENGL_PROFILE, GLFW_OPENGL_CORE_PROFILE);
    glfwWindowHint(GLFW_OPENGL_FORWARD_COMPAT, GLFW_TRUE);
    glfwWindowHint(GLFW_SAMPLES, 4);
    w->handle = glfwCreateWindow(width, height, title, NULL, NULL);
    if (w->handle == NULL) {
        glfwWindowHint(GLFW_SAMPLES, 0);
        w->handle = glfwCreateWindow(width, height, title, NULL, NULL);
    }
    if (w->handle == NULL) {
        glfwTerminate();
        free(w);
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "this display has no OpenGL 3.3: install libgl1-mesa-dri");
    }
    glfwMakeContextCurrent(w->handle);
    glfwSwapInterval(0); // the caller paces itself at the render rate
    glfwSetWindowUserPointer(w->handle, w);
    glfwSetKeyCallback(w->handle, on_key);
    glfwSetMouseButtonCallback(w->handle, on_button);
    glfwSetCursorPosCallback(w->handle, on_move);
    glfwSetScrollCallback(w->handle, on_scroll);
    glEnable(GL_MULTISAMPLE);
    *out = w;
    return PALPATE_OK;
}

void pal_window_free(pal_window *w) {
    if (w == NULL) {
        return;
    }
    glfwDestroyWindow(w->handle);
    glfwTerminate();
    free(w);
}

void pal_window_poll(pal_window *w, pal_window_input *input, int *width, int *height) {
    glfwPollEvents();
    *input = w->input;
    input->close |= glfwWindowShouldClose(w->handle);
    int pressing = w->input.pressing;
    double cursor[2] = {w->input.cursor[0], w->input.cursor[1]};
    memset(&w->input, 0, sizeof w->input);
    w->input.zoom = 1.0;
    w->input.pressing = pressing;
    w->input.cursor[0] = cursor[0];
    w->input.cursor[1] = cursor[1];
    glfwGetFramebufferSize(w->handle, width, height);
    glBindFramebuffer(GL_FRAMEBUFFER, 0);
}

void pal_window_show(pal_window *w) {
    glfwSwapBuffers(w->handle);
}

void pal_window_read(pal_window *w, int width, int height, uint8_t *rgba) {
    (void)w;
    glReadBuffer(GL_BACK);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    for (int y = 0; y < height; y++) {
        glReadPixels(0, height - 1 - y, width, 1, GL_RGBA, GL_UNSIGNED_BYTE,
                     rgba + 4 * (size_t)width * (size_t)y);
    }
}
