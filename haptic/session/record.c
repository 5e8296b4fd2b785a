/// @file record.c  The recorder thread (duties: record.h; layout and durability: recording.h).
#include "haptic/session/record.h"

#include <errno.h>
#include <fcntl.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/model/model.h"
#include "haptic/recording/xdmf.h"
#include "haptic/session/render_thread.h"

enum {
    BATCH = 256,
    WHEN = 16384,
    DRAIN_NS = 10000000,
    SYNC_NS = 1000000000,
    FAULT_SYNC_NS = 100000000,
    IDLE_NS = 50000
};

/// Stored rows that lie on the surface: surface nodes come first and rows ascend, so a prefix.
static int32_t surface_rows(const pal_model *model) {
    int32_t n = 0;
    while (n < model->info.row_count && model->row_node[n] < model->info.surface_count) {
        n++;
    }
    return n;
}

/// Rest positions and the triangles all of whose corners are recorded. @return malloc'd block or
/// NULL
static char *make_surface(const pal_model *model, int32_t rows, int32_t *triangle_count) {
    int32_t *row_of = malloc(((size_t)model->info.surface_count + 1) * sizeof *row_of);
    int64_t size = pal_frames_static_bytes(rows, model->info.triangle_count);
    char *block = calloc(1, (size_t)size + 8);
    if (row_of == NULL || block == NULL) {
        free(row_of);
        free(block);
        return NULL;
    }
    for (int32_t i = 0; i < model->info.surface_count; i++) {
        row_of[i] = -1;
    }
    for (int32_t r = 0; r < rows; r++) {
        row_of[model->row_node[r]] = r;
        memcpy(block + 24 * (size_t)r, model->position + 3 * (size_t)model->row_node[r], 24);
    }
    char *at = block + 24 * (size_t)rows;
    *triangle_count = 0;
    for (int32_t t = 0; t < model->info.triangle_count; t++) {
        const int32_t *node = model->triangle + 3 * (size_t)t;
        const int32_t corner[3] = {row_of[node[0]], row_of[node[1]], row_of[node[2]]};
        if (corner[0] >= 0 && corner[1] >= 0 && corner[2] >= 0) {
            memcpy(at, corner, sizeof corner);
            at += sizeof corner;
            (*triangle_count)++;
        }
    }
    free(row_of);
    return block;
}

static int put(int fd, const void *data, size_t size, int64_t offset) {
    errno = 0; // a short write sets none: the disk is full, or the file at its limit
    return pwrite(fd, data, size, offset) == (ssize_t)size ? 0 : (errno != 0 ? errno : ENOSPC);
}

static int write_frames_header(pal_recorder *r) {
    char header[PALPATE_FRAMES_HEADER] = {0};
    size_t size = sizeof r->frames_header;
    uint64_t check = pal_item_check(&r->frames_header, size, (uint64_t)PALPATE_HEADER_NUMBER);
    memcpy(header, &r->frames_header, size);
    memcpy(header + size, &check, sizeof check);
    return put(r->frames.fd, header, sizeof header, 0);
}

static pal_status open_frames(pal_recorder *r, const pal_model *model, const pal_session_def *def,
                              pal_error *error) {
    pal_frames_header *h = &r->frames_header;
    int32_t rows = surface_rows(model), triangles = 0;
    char *surface = make_surface(model, rows, &triangles);
    r->frame = calloc(1, (size_t)pal_frames_item_bytes(rows));
    if (surface == NULL || r->frame == NULL) {
        free(surface);
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "recording: no memory for a surface of %d nodes", (int)rows);
    }
    memcpy(h->magic, PALPATE_FRAMES_MAGIC, sizeof h->magic);
    h->endian = PALPATE_RECORDING_ENDIAN;
    h->version = PALPATE_RECORDING_VERSION;
    h->header_bytes = PALPATE_FRAMES_HEADER;
    h->item_bytes = pal_frames_item_bytes(rows);
    h->row_count = rows;
    h->triangle_count = triangles;
    h->tool_count = def->engine.tool_count;
    h->rate = def->render_rate;
    r->frames.fd = open(r->frames_name, O_RDWR | O_CREAT | O_EXCL | O_CLOEXEC, 0666);
    int why = r->frames.fd < 0 ? errno : write_frames_header(r);
    size_t size = (size_t)pal_frames_static_bytes(rows, triangles);
    uint64_t check = pal_item_check(surface, size, (uint64_t)PALPATE_STATIC_NUMBER);
    memcpy(surface + size, &check, sizeof check);
    if (why == 0) {
        why = put(r->frames.fd, surface, size + 8, PALPATE_FRAMES_HEADER);
    }
    free(surface);
    r->frames.end = PALPATE_FRAMES_HEADER + (int64_t)size + 8;
    if (why != 0) {
        return pal_fail(
            error, PALPATE_ERROR_IO, "%s: cannot be written: %s%s", r->frames_name, strerror(why),
            why == EEXIST ? "; recover that recording with `palpate recover`, or delete it" : "");
    }
    return PALPATE_OK;
}

pal_status pal_recorder_open(pal_recorder *r, const pal_model *model, const pal_session_def *def,
                             pal_error *error) {
    r->ticks.fd = r->frames.fd = -1;
    pal_status status = pal_recording_name(def->record_path, "", r->path, error);
    if (status == PALPATE_OK) {
        status = pal_recording_name(def->record_path, ".ticks", r->ticks_name, error);
    }
    if (status == PALPATE_OK) {
        status = pal_recording_name(def->record_path, ".frames", r->frames_name, error);
    }
    // the finished files are renamed over what is there: root would replace a device
    char companion[PALPATE_RECORDING_PATH];
    if (status == PALPATE_OK) {
        status = pal_xdmf_name(r->path, companion, error);
    }
    const char *const made[] = {r->path, companion};
    for (size_t k = 0; status == PALPATE_OK && k < sizeof made / sizeof *made; k++) {
        struct stat found;
        if (stat(made[k], &found) == 0 && !S_ISREG(found.st_mode)) {
            status = pal_fail(error, PALPATE_ERROR_IO,
                              "%s: exists and is not a regular file; choose another name", made[k]);
        }
    }
    if (status != PALPATE_OK) {
        return status;
    }
    r->batch = calloc(BATCH, sizeof *r->batch);
    r->when = calloc(WHEN, sizeof *r->when);
    if (r->batch == NULL || r->when == NULL) {
        pal_recorder_close(r, 1);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory");
    }
    pal_ticks_header_fill(&r->ticks_header, model, def);
    status = pal_ticks_create(r->ticks_name, &r->ticks_header, &r->ticks, error);
    if (status == PALPATE_OK && r->reader != NULL) {
        r->frame_period_ns = (int64_t)(1e9 / def->render_rate);
        status = open_frames(r, model, def, error);
    }
    if (status != PALPATE_OK) {
        pal_recorder_close(r, 1);
    }
    return status;
}

void pal_recorder_close(pal_recorder *r, int discard) {
    // only files this recorder made (fd >= 0): an unfinished recording in the way is not its own
    if (r->batch != NULL && r->ticks.fd >= 0) {
        close(r->ticks.fd);
        if (discard) {
            unlink(r->ticks_name);
        }
    }
    if (r->batch != NULL && r->frames.fd >= 0) {
        close(r->frames.fd);
        if (discard) {
            unlink(r->frames_name);
        }
    }
    r->ticks.fd = r->frames.fd = -1;
    free(r->batch);
    free(r->frame);
    free(r->when);
    r->when = NULL;
    r->batch = NULL;
    r->frame = NULL;
}

/// Let the report see the numbers.
static void publish(pal_recorder *r) {
    atomic_store_explicit(&r->records, r->ticks.items, memory_order_relaxed);
    atomic_store_explicit(&r->records_lost, r->ticks.lost, memory_order_relaxed);
    atomic_store_explicit(&r->frames_done, r->frames.items, memory_order_relaxed);
    atomic_store_explicit(&r->frames_lost, r->frames.lost, memory_order_relaxed);
    int why = r->ticks.first_errno != 0 ? r->ticks.first_errno : r->frames.first_errno;
    atomic_store_explicit(&r->first_errno, why, memory_order_relaxed);
}

/// Write all that is queued. @return records moved
static int64_t drain(pal_recorder *r) {
    int64_t moved = 0;
    const pal_tick_record *front = NULL;
    for (int64_t n; (n = pal_queue_peek(r->queue, &front)) > 0; moved += n) {
        n = n < BATCH ? n : BATCH;
        for (int64_t i = 0; i < n; i++) {
            r->batch[i].record = front[i];
            r->when[front[i].tick % WHEN].tick = front[i].tick;
            r->when[front[i].tick % WHEN].time_ns = front[i].time_ns;
            r->last_tick = front[i].tick;
            uint32_t *last = &r->last_fault[front[i].tool];
            r->sync_now |= (front[i].fault & ~*last & PALPATE_DUMP_FAULTS) != 0;
            *last = front[i].fault;
            r->batch[i].check =
                pal_item_check(&front[i], sizeof front[i], r->ticks.items + (uint64_t)i);
        }
        pal_queue_drop(r->queue, n);
        pal_item_append(&r->ticks, r->batch, sizeof *r->batch, n);
    }
    publish(r);
    return moved;
}

/// Session time of a tick. The engine counts evaluated ticks; periods that were missed are known
/// from the records. A frame is published just before its record: the newest one may have to be
/// guessed.
static int64_t time_of(const pal_recorder *r, uint64_t tick) {
    if (r->when[tick % WHEN].tick == tick && (tick > 0 || r->last_tick < WHEN)) {
        return r->when[tick % WHEN].time_ns;
    }
    int64_t ahead = (int64_t)(tick - r->last_tick);
    return r->when[r->last_tick % WHEN].time_ns + ahead * r->servo->period_ns;
}

static void record_frame(pal_recorder *r) {
    pal_frame frame;
    if (r->reader == NULL || pal_engine_snapshot(r->reader, &frame) != 1) {
        return;
    }
    (void)drain(r);
    size_t size = (size_t)r->frames_header.item_bytes - 8;
    pal_frame_head *head = (pal_frame_head *)(void *)r->frame;
    memset(head, 0, sizeof *head);
    head->tick = frame.tick;
    head->time_ns = time_of(r, frame.tick);
    for (int32_t i = 0; i < frame.tool_count; i++) {
        head->tool_pose[i] = frame.tool_pose[i];
        head->tool_force[i] = frame.tool_force[i];
    }
    if (r->frames_header.row_count > 0) {
        memcpy(r->frame + sizeof *head, frame.displacement,
               12 * (size_t)r->frames_header.row_count);
    }
    uint64_t check = pal_item_check(r->frame, size, r->frames.items);
    memcpy(r->frame + size, &check, sizeof check);
    pal_item_append(&r->frames, r->frame, size + 8, 1);
    publish(r);
}

static void sync_files(pal_recorder *r) {
    if (fdatasync(r->ticks.fd) != 0 && r->ticks.first_errno == 0) {
        r->ticks.first_errno = errno;
    }
    if (r->frames.fd >= 0 && fdatasync(r->frames.fd) != 0 && r->frames.first_errno == 0) {
        r->frames.first_errno = errno;
    }
}

static void run_realtime(pal_recorder *r) {
    int64_t now = pal_rt_now(), next_frame = now + r->frame_period_ns, next_sync = now + SYNC_NS;
    int64_t soonest = now; ///< next sync for a fault
    while (pal_sleep_while_running(r->servo, now + DRAIN_NS)) {
        (void)drain(r);
        now = pal_rt_now();
        if (r->reader != NULL && now >= next_frame) {
            record_frame(r);
            next_frame += r->frame_period_ns;
            next_frame = next_frame < now ? now : next_frame;
        }
        if (now >= next_sync || (r->sync_now && now >= soonest)) {
            sync_files(r);
            r->sync_now = 0;
            now = pal_rt_now();
            next_sync = now + SYNC_NS;
            soonest = now + FAULT_SYNC_NS;
        }
    }
}

static void run_gated(pal_recorder *r) {
    uint64_t seen = 0;
    for (int alive = 1; alive;) {
        alive = atomic_load_explicit(&r->servo->running, memory_order_acquire);
        int64_t moved = drain(r);
        if (r->reader != NULL && pal_gate_poll(r->servo, &seen)) {
            if (seen % 2 == 0) {
                record_frame(r);
            } else {
                pal_frame stale;
                (void)pal_engine_snapshot(r->reader, &stale);
            }
            pal_gate_done(r->servo, PALPATE_TAKER_RECORD, seen);
        } else if (moved == 0 && alive) {
            const struct timespec t = {.tv_nsec = IDLE_NS};
            (void)clock_nanosleep(CLOCK_MONOTONIC, 0, &t, NULL);
        }
    }
}

void pal_recorder_run(pal_recorder *r) {
    if (r->servo->freewheel) {
        run_gated(r);
    } else {
        run_realtime(r);
    }
    (void)drain(r);
    record_frame(r);
    int why = pal_ticks_finish(&r->ticks, &r->ticks_header);
    if (why != 0 && r->ticks.first_errno == 0) {
        r->ticks.first_errno = why;
    }
    if (r->frames.fd >= 0) {
        r->frames_header.frames = r->frames.items;
        r->frames_header.lost = r->frames.lost;
        r->frames_header.complete = 1;
        why = write_frames_header(r);
        if (why != 0 && r->frames.first_errno == 0) {
            r->frames.first_errno = why;
        }
    }
    sync_files(r);
    publish(r);
}
