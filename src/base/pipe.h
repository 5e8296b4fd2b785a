/// @file pipe.h  Whole reads and writes on a pipe, for the helper processes (private to src/mesher
/// and src/reader).
///
/// Inline, as the helpers link nothing of the libraries.
#ifndef PALPATE_SRC_PIPE_H
#define PALPATE_SRC_PIPE_H

#include <errno.h>
#include <stddef.h>
#include <unistd.h>

/// Read exactly `size` bytes. @return 0 at the end of the pipe or on an error
static inline int pal_pipe_read(int fd, void *data, size_t size) {
    char *p = data;
    while (size > 0) {
        ssize_t n = read(fd, p, size);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            return 0;
        }
        p += n;
        size -= (size_t)n;
    }
    return 1;
}

/// Write all `size` bytes. @return 0 on an error
static inline int pal_pipe_write(int fd, const void *data, size_t size) {
    const char *p = data;
    while (size > 0) {
        ssize_t n = write(fd, p, size);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            return 0;
        }
        p += n;
        size -= (size_t)n;
    }
    return 1;
}

#endif
