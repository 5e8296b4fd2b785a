/// @file surface_read.c  Surface files through palpate-reader, welded.
///
/// Assimp, which palpate-reader is built on, aborts, loops or takes all memory on some files, so it
/// runs in a process of its own with limits that follow the file's size. Thread: any.
#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "src/geometry/reader_client.h"
#include "src/geometry/surface.h"

void pal_surface_clear(pal_surface *s) {
    free(s->x);
    free(s->v);
    memset(s, 0, sizeof *s);
}

static int has_extension(const char *path, const char *extension) {
    const char *dot = strrchr(path, '.');
    return dot != NULL && strcasecmp(dot + 1, extension) == 0;
}

/// Assimp 5.2 reads a PLY header without end for ever, and believes any count: look first.
static const char *look_at_ply(int fd, int64_t size) {
    FILE *in = fdopen(dup(fd), "rb");
    char line[256];
    const char *why = "its header has no end";
    for (int i = 0; in != NULL && i < 1000 && fgets(line, sizeof line, in) != NULL; i++) {
        long count;
        if (sscanf(line, "element %*s %ld", &count) == 1 && (count < 0 || count > size)) {
            why = "its header announces more elements than the file can hold";
            break;
        }
        if (strncmp(line, "end_header", 10) == 0 &&
            strspn(line + 10, " \t\r\n") == strlen(line + 10)) {
            why = NULL;
            break;
        }
    }
    if (in != NULL) {
        (void)fclose(in);
    }
    return why;
}

/// What can be told before anything is parsed. @param[out] size  in bytes. @return NULL: go on
static const char *look_at(int fd, pal_reader_format format, int64_t *size) {
    struct stat found;
    if (fstat(fd, &found) != 0) {
        return strerror(errno);
    }
    *size = found.st_size;
    if (!S_ISREG(found.st_mode)) {
        return "it is not a regular file";
    }
    if (found.st_size == 0) {
        return "it is empty";
    }
    if (found.st_size > PALPATE_READER_FILE_MAX) {
        return "it is larger than 1 GiB; reduce its number of triangles";
    }
    const char *why = format == PALPATE_READER_PLY ? look_at_ply(fd, *size) : NULL;
    return why == NULL && lseek(fd, 0, SEEK_SET) != 0 ? strerror(errno) : why;
}

/// @param welding  1: one vertex per place; 0: as the importer numbers them
static pal_status import(const char *path, int welding, pal_surface *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_reader_limits limits = {0};
    int format = has_extension(path, "obj")   ? PALPATE_READER_OBJ
                 : has_extension(path, "stl") ? PALPATE_READER_STL
                 : has_extension(path, "ply") ? PALPATE_READER_PLY
                                              : -1;
    // not blocking: a pipe nobody writes to must not hold us
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    if (fd < 0) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: %s", path, strerror(errno));
    }
    int64_t size = 0;
    const char *why = format < 0 ? "its name does not end in .stl, .obj or .ply"
                                 : look_at(fd, (pal_reader_format)format, &size);
    pal_status status;
    if (why != NULL) {
        status = pal_fail(error, PALPATE_ERROR_IO,
                          "%s: not a readable surface (STL, OBJ or PLY): %s", path, why);
    } else {
        limits = pal_reader_default_limits(size);
        status =
            pal_reader_import(fd, size, (pal_reader_format)format, !welding, &limits, out, error);
        if (status == PALPATE_OK && welding) {
            status = pal_surface_weld(out, error);
        }
        if (status == PALPATE_ERROR_IO) {
            status = pal_fail_prefix(error, status, "%s: not a readable surface (STL, OBJ or PLY)",
                                     path);
        } else if (status != PALPATE_OK) {
            status = pal_fail_prefix(error, status, "%s", path);
        }
    }
    (void)close(fd);
    if (status != PALPATE_OK) {
        pal_surface_clear(out);
    }
    return status;
}

pal_status pal_surface_read(const char *path, pal_surface *out, pal_error *error) {
    return import(path, 1, out, error);
}

pal_status pal_surface_read_in_order(const char *path, pal_surface *out, pal_error *error) {
    if (has_extension(path, "obj")) {
        return pal_obj_read(path, out, error);
    }
    return import(path, !has_extension(path, "ply"), out, error);
}
