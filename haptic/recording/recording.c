/// @file recording.c  Append-only item files and the tick file's header (layout: recording.h).
#include "haptic/recording/recording.h"

#include <errno.h>
#include <fcntl.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include "haptic/base/error.h"

pal_status pal_recording_name(const char *path, const char *suffix,
                              char out[PALPATE_RECORDING_PATH], pal_error *error) {
    int n = snprintf(out, PALPATE_RECORDING_PATH, "%s%s", path, suffix);
    if (path[0] == 0 || n < 0 || n >= PALPATE_RECORDING_PATH) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "recording path '%.64s%s': %s", path,
                        strlen(path) > 64 ? "..." : "", path[0] == 0 ? "is empty" : "is too long");
    }
    return PALPATE_OK;
}

/// Write all of `size` bytes at `offset`. @return bytes written; short on error (errno set)
static int64_t write_at(int fd, const void *data, int64_t size, int64_t offset) {
    int64_t done = 0;
    while (done < size) {
        ssize_t n = pwrite(fd, (const char *)data + done, (size_t)(size - done), offset + done);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n <= 0) {
            errno = n == 0 ? ENOSPC : errno;
            break;
        }
        done += n;
    }
    return done;
}

void pal_item_append(pal_item_file *file, const void *item, size_t size, int64_t count) {
    int64_t wanted = (int64_t)size * count;
    int64_t done = write_at(file->fd, item, wanted, file->end);
    if (done < wanted && file->first_errno == 0) {
        file->first_errno = errno;
    }
    int64_t whole = done / (int64_t)size;
    file->end += whole * (int64_t)size;
    file->items += (uint64_t)whole;
    file->lost += (uint64_t)(count - whole);
}

void pal_ticks_header_fill(pal_ticks_header *header, const pal_model *model,
                           const pal_session_def *def) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    memset(header, 0, sizeof *header);
    memcpy(header->magic, PALPATE_TICKS_MAGIC, sizeof header->magic);
    header->endian = PALPATE_RECORDING_ENDIAN;
    header->version = PALPATE_RECORDING_VERSION;
    header->header_bytes = PALPATE_TICKS_HEADER;
    header->item_bytes = sizeof(pal_tick_item);
    header->tool_bytes = sizeof(pal_tool_def);
    header->tool_count = def->engine.tool_count;
    header->max_contacts = def->engine.max_contacts;
    if (def->engine.contact_law == PALPATE_CONTACT_SURFACE) {
        header->contact = def->engine.contact_points << 8 | 1;
    }
    header->period_ns = (int64_t)(def->engine.period * 1e9 + 0.5);
    header->started_s = (int64_t)time(NULL);
    header->period = def->engine.period;
    header->device_scale = def->engine.device_scale;
    header->body_pose = def->engine.body_pose;
    header->device_to_world = def->engine.device_to_world;
    header->watchdog = def->engine.watchdog;
    header->freewheel = def->freewheel;
    (void)snprintf(header->model_hash, sizeof header->model_hash, "%s", info.hash);
    (void)snprintf(header->model_method, sizeof header->model_method, "%s", info.method);
    (void)snprintf(header->model_provenance, sizeof header->model_provenance, "%s",
                   info.provenance);
    (void)snprintf(header->program, sizeof header->program, "palpate %s", pal_version());
    for (int32_t i = 0; i < header->tool_count; i++) {
        header->tool[i] = def->engine.tools[i];
    }
}

static int write_header(int fd, const pal_ticks_header *header) {
    static const char zero[PALPATE_TICKS_HEADER - sizeof *header - 8];
    int64_t size = (int64_t)sizeof *header, pad = (int64_t)sizeof zero;
    uint64_t check = pal_item_check(header, sizeof *header, (uint64_t)PALPATE_HEADER_NUMBER);
    return write_at(fd, header, size, 0) == size && write_at(fd, &check, 8, size) == 8 &&
                   write_at(fd, zero, pad, size + 8) == pad
               ? 0
               : errno;
}

pal_status pal_ticks_create(const char *name, const pal_ticks_header *header, pal_item_file *file,
                            pal_error *error) {
    memset(file, 0, sizeof *file);
    file->fd = open(name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    if (file->fd < 0 && errno == EEXIST) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s: a recording that was not finished is in the way; recover it with "
                        "`palpate recover`, or delete it",
                        name);
    }
    int why = file->fd < 0 ? errno : write_header(file->fd, header);
    if (why != 0) {
        if (file->fd >= 0) {
            close(file->fd);
            unlink(name);
            file->fd = -1;
        }
        return pal_fail(error, PALPATE_ERROR_IO, "%s: cannot be written: %s", name, strerror(why));
    }
    file->end = PALPATE_TICKS_HEADER;
    return PALPATE_OK;
}

int pal_ticks_finish(pal_item_file *file, pal_ticks_header *header) {
    header->records = file->items;
    header->lost = file->lost;
    header->complete = 1;
    return write_header(file->fd, header);
}
