/// @file dump.c  Writing the record ring (rules: dump.h).
#include "haptic/session/dump.h"

#include <errno.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/base/realtime.h"

enum { POLL_NS = 5000000 };

pal_status pal_dump_ring(const pal_ring *ring, const pal_ticks_header *header, const char *path,
                         pal_tick_record *record, pal_error *error) {
    char name[PALPATE_RECORDING_PATH];
    pal_status status = pal_recording_name(path, ".ticks", name, error);
    if (status != PALPATE_OK) {
        return status;
    }
    int32_t count = pal_ring_copy(ring, record, (int32_t)ring->capacity);
    while (count > 0 &&
           record[0].tool != 0) { // whole ticks only: a replay needs every tool's record
        record++;
        count--;
    }
    while (count > 0 && record[count - 1].tool != header->tool_count - 1) {
        count--;
    }
    pal_item_file file;
    pal_ticks_header own = *header;
    status = pal_ticks_create(name, &own, &file, error);
    if (status != PALPATE_OK) {
        return status;
    }
    for (int32_t i = 0; i < count; i++) {
        const pal_tick_item item = {.record = record[i],
                                    .check =
                                        pal_item_check(&record[i], sizeof record[i], (uint64_t)i)};
        pal_item_append(&file, &item, sizeof item, 1);
    }
    int why = pal_ticks_finish(&file, &own);
    if (why == 0 && fdatasync(file.fd) != 0) {
        why = errno;
    }
    why = file.first_errno != 0 ? file.first_errno : why;
    close(file.fd);
    if (why != 0) {
        unlink(name);
        return pal_fail(error, PALPATE_ERROR_IO, "%s: %s", name, strerror(why));
    }
    return PALPATE_OK;
}

int pal_dump_name(const char *path, int32_t n, char out[PALPATE_RECORDING_PATH]) {
    const char *slash = strrchr(path, '/'), *dot = strrchr(slash != NULL ? slash : path, '.');
    int stem = dot != NULL ? (int)(dot - path) : (int)strlen(path);
    int length = n == 1 ? snprintf(out, PALPATE_RECORDING_PATH, "%s", path)
                        : snprintf(out, PALPATE_RECORDING_PATH, "%.*s-%d%s", stem, path, (int)n,
                                   dot != NULL ? dot : "");
    return length > 0 && length < PALPATE_RECORDING_PATH;
}

pal_status pal_dumper_init(pal_dumper *d, const char *path, pal_error *error) {
    char longest[PALPATE_RECORDING_PATH], name[PALPATE_RECORDING_PATH];
    if (path[0] == 0 || !pal_dump_name(path, PALPATE_DUMP_NAMES, longest) ||
        pal_recording_name(longest, ".frames", name, NULL) != PALPATE_OK) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "session definition: dump_path '%.64s' is %s", path,
                        path[0] == 0 ? "empty" : "too long");
    }
    (void)snprintf(d->path, sizeof d->path, "%s", path);
    d->record = malloc(d->ring->capacity * sizeof *d->record);
    return d->record != NULL
               ? PALPATE_OK
               : pal_fail(error, PALPATE_ERROR_MEMORY, "dump: no memory for %llu records",
                          (unsigned long long)d->ring->capacity);
}

void pal_dumper_clear(pal_dumper *d) {
    free(d->record);
    d->record = NULL;
}

/// The next name that neither a finished nor a raw recording has. @return its number, 0: none is
/// free
static int32_t free_name(const pal_dumper *d, char path[PALPATE_RECORDING_PATH]) {
    int32_t made = atomic_load_explicit(&d->count, memory_order_relaxed);
    for (int32_t n = made > 0 ? d->number[made - 1] + 1 : 1; n <= PALPATE_DUMP_NAMES; n++) {
        char raw[PALPATE_RECORDING_PATH];
        if (pal_dump_name(d->path, n, path) &&
            pal_recording_name(path, ".ticks", raw, NULL) == PALPATE_OK &&
            access(path, F_OK) != 0 && access(raw, F_OK) != 0) {
            return n;
        }
    }
    return 0;
}

static void write_one(pal_dumper *d) {
    char path[PALPATE_RECORDING_PATH];
    int32_t made = atomic_load_explicit(&d->count, memory_order_relaxed);
    int32_t n = made < PALPATE_DUMPS_MAX ? free_name(d, path) : 0;
    pal_error why = {0};
    errno = 0;
    if (n > 0 && pal_dump_ring(d->ring, d->header, path, d->record, &why) == PALPATE_OK) {
        d->number[made] = n;
        atomic_store_explicit(&d->count, made + 1, memory_order_release);
        return;
    }
    if (n > 0 && atomic_load_explicit(&d->first_errno, memory_order_relaxed) == 0) {
        atomic_store_explicit(&d->first_errno, errno != 0 ? errno : EIO, memory_order_relaxed);
    }
    atomic_store_explicit(&d->skipped, atomic_load_explicit(&d->skipped, memory_order_relaxed) + 1,
                          memory_order_relaxed);
}

void pal_dumper_run(pal_dumper *d) {
    pal_servo *servo = d->servo;
    for (int alive = 1; alive;) {
        alive = atomic_load_explicit(&servo->running, memory_order_acquire);
        uint64_t due = atomic_load_explicit(&servo->dump_due, memory_order_acquire);
        uint64_t ticks = atomic_load_explicit(&servo->ticks, memory_order_acquire);
        if (due != 0 && (ticks >= due || !alive)) {
            write_one(d);
            atomic_store_explicit(&servo->dump_due, 0, memory_order_release);
        } else if (atomic_exchange(&d->requested, 0) != 0) {
            write_one(d);
        } else if (alive) {
            pal_rt_sleep_until(pal_rt_now() + POLL_NS);
        }
    }
}

pal_status pal_dumper_convert(pal_dumper *d, pal_error *error) {
    pal_status first = PALPATE_OK;
    int32_t count = atomic_load_explicit(&d->count, memory_order_acquire);
    for (int32_t i = 0; i < count; i++) {
        char path[PALPATE_RECORDING_PATH];
        (void)pal_dump_name(d->path, d->number[i], path);
        pal_status status = pal_recording_convert(path, NULL, first == PALPATE_OK ? error : NULL);
        first = first == PALPATE_OK ? status : first;
    }
    return first;
}
