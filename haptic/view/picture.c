/// @file picture.c  PNG (libpng) and animated GIF (giflib).
#include "haptic/view/view.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <gif_lib.h>
#include <png.h>

#include "haptic/base/error.h"

pal_status pal_picture_write_png(const char *path, int width, int height, const uint8_t *rgba,
                                 pal_error *error) {
    char temporary[4096];
    if ((size_t)snprintf(temporary, sizeof temporary, "%s.%ld.tmp", path, (long)getpid()) >=
        sizeof temporary) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: the path is too long", path);
    }
    struct stat found; // the rename would put a file in the place of a device or a pipe
    if (stat(path, &found) == 0 && !S_ISREG(found.st_mode)) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s: the picture cannot be written: not a regular file", path);
    }
    png_image image;
    memset(&image, 0, sizeof image);
    image.version = PNG_IMAGE_VERSION;
    image.width = (png_uint_32)width;
    image.height = (png_uint_32)height;
    image.format = PNG_FORMAT_RGBA;
    uint8_t *opaque = malloc(4 * (size_t)width * (size_t)height);
    if (opaque == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    memcpy(opaque, rgba, 4 * (size_t)width * (size_t)height);
    for (size_t i = 0; i < (size_t)width * (size_t)height; i++) {
        opaque[4 * i + 3] = 255;
    }
    errno = 0;
    int ok = png_image_write_to_file(&image, temporary, 0, opaque, 0, NULL);
    int why = errno; // of the system; libpng says no more than that it failed
    free(opaque);
    if (!ok || rename(temporary, path) != 0) {
        why = ok ? errno : why;
        pal_status status =
            pal_fail(error, PALPATE_ERROR_IO, "%s: the picture cannot be written: %s", path,
                     why != 0 ? strerror(why) : image.message);
        (void)remove(temporary);
        return status;
    }
    return PALPATE_OK;
}

struct pal_gif {
    GifFileType *file;
    ColorMapObject *map;
    int width, height, delay; ///< delay in 1/100 s
    GifByteType *line;
    char *path, *temporary; ///< written there, renamed when whole; NULL: a device or a pipe
    int frames, failed;
};

/// Bayer's 4 x 4 ordered dither, in [0, 1).
static const double dither[4][4] = {{0, 8, 2, 10}, {12, 4, 14, 6}, {3, 11, 1, 9}, {15, 7, 13, 5}};

pal_status pal_gif_open(const char *path, int width, int height, double frame_seconds,
                        pal_gif **out, pal_error *error) {
    *out = NULL;
    int code = 0;
    GifColorType colours[256];
    memset(colours, 0, sizeof colours);
    for (int i = 0; i < 216; i++) {
        colours[i].Red = (GifByteType)(51 * (i / 36));
        colours[i].Green = (GifByteType)(51 * (i / 6 % 6));
        colours[i].Blue = (GifByteType)(51 * (i % 6));
    }
    pal_gif *g = calloc(1, sizeof *g);
    if (g == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    g->width = width;
    g->height = height;
    g->delay = (int)(100.0 * frame_seconds + 0.5);
    g->line = malloc((size_t)width);
    g->map = GifMakeMapObject(256, colours);
    g->path = strdup(path);
    struct stat found;
    size_t room = strlen(path) + 32;
    if (stat(path, &found) != 0 || S_ISREG(found.st_mode)) {
        g->temporary = malloc(room);
        if (g->temporary == NULL) {
            (void)pal_gif_close(g, NULL);
            return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
        }
        (void)snprintf(g->temporary, room, "%s.%ld.tmp", path, (long)getpid());
    }
    int fd = open(g->temporary != NULL ? g->temporary : path,
                  O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0666); // giflib's own mode is 0600
    int why = fd < 0 ? errno : 0;
    g->file = fd < 0 ? NULL : EGifOpenFileHandle(fd, &code);
    if (fd >= 0 && g->file == NULL) {
        (void)close(fd);
    }
    if (g->line == NULL || g->map == NULL || g->path == NULL || g->file == NULL) {
        pal_status status =
            pal_fail(error, PALPATE_ERROR_IO, "%s: the GIF cannot be written: %s", path,
                     why    ? strerror(why)
                     : code ? GifErrorString(code)
                            : "out of memory");
        g->failed = 1;
        (void)pal_gif_close(g, NULL);
        return status;
    }
    EGifSetGifVersion(g->file, true);
    unsigned char loop[3] = {1, 0, 0}; // NETSCAPE2.0: repeat for ever
    if (EGifPutScreenDesc(g->file, width, height, 8, 0, g->map) == GIF_ERROR ||
        EGifPutExtensionLeader(g->file, APPLICATION_EXT_FUNC_CODE) == GIF_ERROR ||
        EGifPutExtensionBlock(g->file, 11, "NETSCAPE2.0") == GIF_ERROR ||
        EGifPutExtensionBlock(g->file, 3, loop) == GIF_ERROR ||
        EGifPutExtensionTrailer(g->file) == GIF_ERROR) {
        g->failed = 1;
        (void)pal_gif_close(g, NULL);
        return pal_fail(error, PALPATE_ERROR_IO, "%s: the GIF cannot be written (disk full?)",
                        path);
    }
    *out = g;
    return PALPATE_OK;
}

pal_status pal_gif_add(pal_gif *g, const uint8_t *rgba, pal_error *error) {
    GraphicsControlBlock control = {DISPOSE_DO_NOT, false, g->delay, NO_TRANSPARENT_COLOR};
    GifByteType extension[4];
    EGifGCBToExtension(&control, extension);
    int ok = EGifPutExtension(g->file, GRAPHICS_EXT_FUNC_CODE, 4, extension) != GIF_ERROR &&
             EGifPutImageDesc(g->file, 0, 0, g->width, g->height, false, NULL) != GIF_ERROR;
    for (int y = 0; ok && y < g->height; y++) {
        for (int x = 0; x < g->width; x++) {
            const uint8_t *p = rgba + 4 * ((size_t)y * (size_t)g->width + (size_t)x);
            double t = (dither[y & 3][x & 3] + 0.5) / 16.0;
            int c[3];
            for (int k = 0; k < 3; k++) {
                c[k] = (int)(p[k] / 51.0 + t);
            }
            g->line[x] = (GifByteType)(36 * c[0] + 6 * c[1] + c[2]);
        }
        ok = EGifPutLine(g->file, g->line, g->width) != GIF_ERROR;
    }
    g->frames += ok;
    g->failed |= !ok;
    return ok ? PALPATE_OK
              : pal_fail(error, PALPATE_ERROR_IO,
                         "%s: picture %d of the GIF cannot be written (disk full?)", g->path,
                         g->frames + 1);
}

pal_status pal_gif_close(pal_gif *g, pal_error *error) {
    int code = 0, ok = 1, why = 0;
    if (g == NULL) {
        return PALPATE_OK;
    }
    if (g->file != NULL) {
        ok = EGifCloseFile(g->file, &code) != GIF_ERROR;
        if (g->temporary != NULL && ok && !g->failed && rename(g->temporary, g->path) != 0) {
            why = errno;
            ok = 0;
        }
    }
    if (g->temporary != NULL && (!ok || g->failed || g->file == NULL)) {
        (void)remove(g->temporary); // a torn animation is worth nothing
    }
    pal_status status = ok ? PALPATE_OK
                           : pal_fail(error, PALPATE_ERROR_IO, "%s: the GIF cannot be finished: %s",
                                      g->path, why != 0 ? strerror(why) : GifErrorString(code));
    if (g->map != NULL) {
        GifFreeMapObject(g->map);
    }
    free(g->line);
    free(g->path);
    free(g->temporary);
    free(g);
    return status;
}
