/// @file offscreen.c  EGL without a display: surfaceless context, multisampled framebuffer,
/// readback.
#include "haptic/view/view.h"

#include <stdlib.h>
#include <string.h>

#include <epoxy/egl.h>
#include <epoxy/gl.h>

#include "haptic/base/error.h"

enum { SAMPLES = 4 };

struct pal_offscreen {
    EGLDisplay display;
    EGLContext context;
    int width, height;
    GLuint multisampled, resolved;         ///< framebuffers
    GLuint colour, depth, resolved_colour; ///< renderbuffers
};

static GLuint renderbuffer(GLenum format, int samples, int width, int height) {
    GLuint name = 0;
    glGenRenderbuffers(1, &name);
    glBindRenderbuffer(GL_RENDERBUFFER, name);
    if (samples > 0) {
        glRenderbufferStorageMultisample(GL_RENDERBUFFER, samples, format, width, height);
    } else {
        glRenderbufferStorage(GL_RENDERBUFFER, format, width, height);
    }
    return name;
}

static pal_status create_context(pal_offscreen *o, pal_error *error) {
    static const EGLint attributes[] = {EGL_CONTEXT_MAJOR_VERSION,
                                        3,
                                        EGL_CONTEXT_MINOR_VERSION,
                                        3,
                                        EGL_CONTEXT_OPENGL_PROFILE_MASK,
                                        EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT,
                                        EGL_NONE};
    const char *extensions = eglQueryString(EGL_NO_DISPLAY, EGL_EXTENSIONS);
    if (extensions == NULL || strstr(extensions, "EGL_MESA_platform_surfaceless") == NULL) {
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "EGL has no surfaceless platform: install libegl1 and libgl1-mesa-dri");
    }
    o->display = eglGetPlatformDisplayEXT(EGL_PLATFORM_SURFACELESS_MESA, EGL_DEFAULT_DISPLAY, NULL);
    if (o->display == EGL_NO_DISPLAY || !eglInitialize(o->display, NULL, NULL)) {
        o->display = EGL_NO_DISPLAY;
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "EGL cannot start without a display (error 0x%x): install libgl1-mesa-dri",
                        (unsigned)eglGetError());
    }
    if (!eglBindAPI(EGL_OPENGL_API)) {
        return pal_fail(error, PALPATE_ERROR_SYSTEM, "EGL has no OpenGL: install libgl1-mesa-dri");
    }
    o->context = eglCreateContext(o->display, EGL_NO_CONFIG_KHR, EGL_NO_CONTEXT, attributes);
    if (o->context == EGL_NO_CONTEXT ||
        !eglMakeCurrent(o->display, EGL_NO_SURFACE, EGL_NO_SURFACE, o->context)) {
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "no OpenGL 3.3 context without a display (EGL error 0x%x)",
                        (unsigned)eglGetError());
    }
    return PALPATE_OK;
}

pal_status pal_offscreen_create(int width, int height, pal_offscreen **out, pal_error *error) {
    *out = NULL;
    if (width < 16 || height < 16 || width > 8192 || height > 8192) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "picture of %d x %d pixels: allowed 16 to 8192", width, height);
    }
    pal_offscreen *o = calloc(1, sizeof *o);
    if (o == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    o->display = EGL_NO_DISPLAY;
    o->context = EGL_NO_CONTEXT;
    o->width = width;
    o->height = height;
    pal_status status = create_context(o, error);
    if (status == PALPATE_OK) {
        o->colour = renderbuffer(GL_RGBA8, SAMPLES, width, height);
        o->depth = renderbuffer(GL_DEPTH_COMPONENT24, SAMPLES, width, height);
        o->resolved_colour = renderbuffer(GL_RGBA8, 0, width, height);
        glGenFramebuffers(1, &o->multisampled);
        glBindFramebuffer(GL_FRAMEBUFFER, o->multisampled);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER, o->colour);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_DEPTH_ATTACHMENT, GL_RENDERBUFFER, o->depth);
        int complete = glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
        glGenFramebuffers(1, &o->resolved);
        glBindFramebuffer(GL_FRAMEBUFFER, o->resolved);
        glFramebufferRenderbuffer(GL_FRAMEBUFFER, GL_COLOR_ATTACHMENT0, GL_RENDERBUFFER,
                                  o->resolved_colour);
        complete = complete && glCheckFramebufferStatus(GL_FRAMEBUFFER) == GL_FRAMEBUFFER_COMPLETE;
        if (!complete) {
            status = pal_fail(error, PALPATE_ERROR_SYSTEM, "no multisampled framebuffer of %d x %d",
                              width, height);
        }
    }
    if (status != PALPATE_OK) {
        pal_offscreen_free(o);
        return status;
    }
    *out = o;
    return PALPATE_OK;
}

void pal_offscreen_free(pal_offscreen *o) {
    if (o == NULL) {
        return;
    }
    if (o->context != EGL_NO_CONTEXT) {
        GLuint buffers[3] = {o->colour, o->depth, o->resolved_colour};
        GLuint frames[2] = {o->multisampled, o->resolved};
        glDeleteFramebuffers(2, frames);
        glDeleteRenderbuffers(3, buffers);
        eglMakeCurrent(o->display, EGL_NO_SURFACE, EGL_NO_SURFACE, EGL_NO_CONTEXT);
        eglDestroyContext(o->display, o->context);
    }
    if (o->display != EGL_NO_DISPLAY) {
        eglTerminate(o->display);
    }
    free(o);
}

void pal_offscreen_begin(pal_offscreen *o) {
    glBindFramebuffer(GL_FRAMEBUFFER, o->multisampled);
}

void pal_offscreen_end(pal_offscreen *o) {
    glBindFramebuffer(GL_FRAMEBUFFER, o->multisampled);
    glFinish();
}

void pal_offscreen_read(pal_offscreen *o, uint8_t *rgba) {
    glBindFramebuffer(GL_READ_FRAMEBUFFER, o->multisampled);
    glBindFramebuffer(GL_DRAW_FRAMEBUFFER, o->resolved);
    glBlitFramebuffer(0, 0, o->width, o->height, 0, 0, o->width, o->height, GL_COLOR_BUFFER_BIT,
                      GL_NEAREST);
    glBindFramebuffer(GL_FRAMEBUFFER, o->resolved);
    glPixelStorei(GL_PACK_ALIGNMENT, 1);
    size_t stride = 4 * (size_t)o->width;
    for (int y = 0; y < o->height; y++) { // OpenGL's rows go upwards
        glReadPixels(0, o->height - 1 - y, o->width, 1, GL_RGBA, GL_UNSIGNED_BYTE,
                     rgba + stride * (size_t)y);
    }
}
