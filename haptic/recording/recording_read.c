/// @file recording_read.c  Raw recordings are checked before they are believed (layout:
/// recording.h).
#include "haptic/recording/recording_read.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "haptic/base/error.h"

/// Largest surface believed: 100 million numbers; a header that says more is damaged.
enum { ROWS_MAX = 1 << 25 };

static int64_t read_at(int fd, void *out, int64_t size, int64_t offset) {
    int64_t done = 0;
    while (done < size) {
        ssize_t n = pread(fd, (char *)out + done, (size_t)(size - done), offset + done);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            return n < 0 ? -1 : done;
        }
        done += n;
    }
    return done;
}

static pal_status fail_close(pal_raw_reader *reader, const char *name, pal_status status,
                             const char *what, pal_error *error) {
    pal_raw_close(reader);
    return pal_fail(error, status, "%s: %s", name, what);
}

/// Open, read the fixed header of `size` bytes and its checksum, check magic and version.
static pal_status open_checked(const char *name, const char *magic, void *header, size_t size,
                               pal_raw_reader *reader, int64_t *file_size, pal_error *error) {
    memset(reader, 0, sizeof *reader);
    reader->fd = open(name, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat st;
    if (reader->fd < 0 || fstat(reader->fd, &st) != 0 || !S_ISREG(st.st_mode)) {
        int why = reader->fd < 0 ? errno : EINVAL;
        pal_raw_close(reader);
        return pal_fail(error, PALPATE_ERROR_IO, "%s: %s", name, strerror(why));
    }
    *file_size = st.st_size;
    uint64_t check = 0;
    if (read_at(reader->fd, header, (int64_t)size, 0) != (int64_t)size ||
        read_at(reader->fd, &check, 8, (int64_t)size) != 8) {
        return fail_close(reader, name, PALPATE_ERROR_TRUNCATED,
                          "ends inside its header; nothing was recorded", error);
    }
    uint32_t endian = 0, version = 0;
    memcpy(&endian, (const char *)header + 8, 4);
    memcpy(&version, (const char *)header + 12, 4);
    if (memcmp(header, magic, 8) != 0 || endian != PALPATE_RECORDING_ENDIAN) {
        return fail_close(reader, name, PALPATE_ERROR_FORMAT, "is not a Palpate recording", error);
    }
    if (version != PALPATE_RECORDING_VERSION) {
        return fail_close(reader, name, PALPATE_ERROR_VERSION,
                          "was recorded by another version of Palpate; convert it with that one",
                          error);
    }
    if (check != pal_item_check(header, size, (uint64_t)PALPATE_HEADER_NUMBER)) {
        return fail_close(reader, name, PALPATE_ERROR_CHECKSUM, "its header is damaged", error);
    }
    return PALPATE_OK;
}

static void count_items(pal_raw_reader *reader, int64_t file_size) {
    int64_t rest = file_size > reader->begin ? file_size - reader->begin : 0;
    reader->items = (uint64_t)(rest / reader->item_size);
    reader->tail = reader->bad = rest % reader->item_size != 0;
}

pal_status pal_raw_open_ticks(const char *name, pal_ticks_header *header, pal_raw_reader *reader,
                              pal_error *error) {
    int64_t size = 0;
    pal_status status =
        open_checked(name, PALPATE_TICKS_MAGIC, header, sizeof *header, reader, &size, error);
    if (status != PALPATE_OK) {
        return status;
    }
    if (header->header_bytes != PALPATE_TICKS_HEADER ||
        header->item_bytes != sizeof(pal_tick_item) || header->tool_bytes != sizeof(pal_tool_def) ||
        header->tool_count < 1 || header->tool_count > PALPATE_TOOLS_MAX ||
        header->period_ns <= 0) {
        return fail_close(reader, name, PALPATE_ERROR_FORMAT, "its header holds impossible sizes",
                          error);
    }
    reader->begin = PALPATE_TICKS_HEADER;
    reader->item_size = sizeof(pal_tick_item);
    count_items(reader, size);
    return PALPATE_OK;
}

/// 1 when every corner is a row and every position finite.
static int surface_is_sound(const char *surface, const pal_frames_header *h) {
    const char *at = surface;
    for (int64_t i = 0; i < 3 * (int64_t)h->row_count; i++, at += 8) {
        double x;
        memcpy(&x, at, sizeof x);
        if (!isfinite(x)) {
            return 0;
        }
    }
    for (int64_t i = 0; i < 3 * (int64_t)h->triangle_count; i++, at += 4) {
        int32_t corner;
        memcpy(&corner, at, sizeof corner);
        if (corner < 0 || corner >= h->row_count) {
            return 0;
        }
    }
    return 1;
}

pal_status pal_raw_open_frames(const char *name, pal_frames_header *h, char **surface,
                               pal_raw_reader *reader, pal_error *error) {
    int64_t size = 0;
    *surface = NULL;
    pal_status status =
        open_checked(name, PALPATE_FRAMES_MAGIC, h, sizeof *h, reader, &size, error);
    if (status != PALPATE_OK) {
        return status;
    }
    if (h->header_bytes != PALPATE_FRAMES_HEADER || h->row_count < 0 || h->row_count > ROWS_MAX ||
        h->triangle_count < 0 || h->triangle_count > 4 * ROWS_MAX || h->tool_count < 1 ||
        h->tool_count > PALPATE_TOOLS_MAX || h->item_bytes != pal_frames_item_bytes(h->row_count)) {
        return fail_close(reader, name, PALPATE_ERROR_FORMAT, "its header holds impossible sizes",
                          error);
    }
    int64_t bytes = pal_frames_static_bytes(h->row_count, h->triangle_count);
    reader->begin = PALPATE_FRAMES_HEADER + bytes + 8;
    reader->item_size = h->item_bytes;
    if (size < reader->begin) {
        return fail_close(reader, name, PALPATE_ERROR_TRUNCATED, "ends inside its surface", error);
    }
    *surface = malloc((size_t)bytes + 8);
    if (*surface == NULL) {
        return fail_close(reader, name, PALPATE_ERROR_MEMORY, "no memory for its surface", error);
    }
    uint64_t check = 0;
    int64_t got = read_at(reader->fd, *surface, bytes + 8, PALPATE_FRAMES_HEADER);
    memcpy(&check, *surface + bytes, sizeof check);
    if (got != bytes + 8 ||
        check != pal_item_check(*surface, (size_t)bytes, (uint64_t)PALPATE_STATIC_NUMBER) ||
        !surface_is_sound(*surface, h)) {
        free(*surface);
        *surface = NULL;
        return fail_close(reader, name, PALPATE_ERROR_CHECKSUM, "its surface is damaged", error);
    }
    count_items(reader, size);
    return PALPATE_OK;
}

void pal_raw_close(pal_raw_reader *reader) {
    if (reader->fd >= 0) {
        close(reader->fd);
    }
    reader->fd = -1;
}

void pal_raw_rewind(pal_raw_reader *reader) {
    reader->next = 0;
    reader->bad = reader->tail;
}

pal_status pal_raw_read(pal_raw_reader *reader, void *out, int64_t capacity, int64_t *count,
                        pal_error *error) {
    size_t size = (size_t)reader->item_size, body = size - 8;
    char *block = malloc(size * (size_t)capacity);
    *count = 0;
    if (block == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory for %lld items",
                        (long long)capacity);
    }
    while (*count == 0 && reader->next < reader->items) {
        uint64_t left = reader->items - reader->next;
        int64_t n = left < (uint64_t)capacity ? (int64_t)left : capacity;
        int64_t offset = reader->begin + (int64_t)reader->next * reader->item_size;
        if (read_at(reader->fd, block, n * reader->item_size, offset) != n * reader->item_size) {
            free(block);
            return pal_fail(error, PALPATE_ERROR_IO, "recording: item %llu cannot be read: %s",
                            (unsigned long long)reader->next, strerror(errno));
        }
        for (int64_t i = 0; i < n; i++) {
            const char *item = block + (size_t)i * size;
            uint64_t check;
            memcpy(&check, item + body, sizeof check);
            if (check == pal_item_check(item, body, reader->next + (uint64_t)i)) {
                memcpy((char *)out + (size_t)*count * body, item, body);
                (*count)++;
            } else {
                reader->bad++;
            }
        }
        reader->next += (uint64_t)n;
    }
    free(block);
    return PALPATE_OK;
}
