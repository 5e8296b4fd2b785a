/// @file recording_file.c  Raw recording -> HDF5 and XDMF.
///
/// HDF5 behind Palpate's sealed header (file_header.h; all little endian, each dataset with unit
/// and description):
///   /format /program /model_hash ...     what was run; /tool/K/... its tools
///   /ticks/NAME    one row per tick and tool, in the order recorded
///   /frames/NAME   one row per frame: tick, time, tools
///   /frames/position/N, /frames/displacement/N   the surface of frame N (000000 on), [node, 3]
///   /surface/rest, /surface/triangles
/// The XDMF companion points ParaView at /frames: a temporal collection of the deformed surface
/// with its displacement, and one of the tools with their forces. The file is made beside its name
/// and renamed when whole; only then do the raw files go.
#include <palpate/session.h>

#include <errno.h>
#include <fcntl.h>
#include <stddef.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/statvfs.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/model/file_header.h"
#include "haptic/model/h5.h"
#include "haptic/recording/recording_read.h"
#include "haptic/recording/xdmf.h"

enum { CHUNK = 8192 };

#define AT(member) offsetof(pal_tick_record, member)
const pal_tick_field pal_tick_field_list[] = {
    {"/ticks/tick", AT(tick), PALPATE_H5_U64, 1, "1", "evaluated ticks before this one"},
    {"/ticks/time", AT(time_ns), PALPATE_H5_I64, 1, "ns",
     "session time: period number times period"},
    {"/ticks/lateness", AT(lateness_ns), PALPATE_H5_I64, 1, "ns", "wake-up after the deadline"},
    {"/ticks/device_time", AT(device_ns), PALPATE_H5_I32, 1, "ns", "device read and write"},
    {"/ticks/force_time", AT(force_ns), PALPATE_H5_I32, 1, "ns", "contact and force"},
    {"/ticks/field_time", AT(field_ns), PALPATE_H5_I32, 1, "ns", "displacement field"},
    {"/ticks/compute_time", AT(compute_ns), PALPATE_H5_I32, 1, "ns", "whole tick"},
    {"/ticks/cpu_time", AT(cpu_ns), PALPATE_H5_I32, 1, "ns", "thread CPU time of the tick"},
    {"/ticks/field_skipped", AT(field_skipped), PALPATE_H5_I32, 1, "1", "1: no field, overload"},
    {"/ticks/fault", AT(fault), PALPATE_H5_U32, 1, "1", "fault bits (PALPATE_FAULT_LIST)"},
    {"/ticks/tool", AT(tool), PALPATE_H5_I32, 1, "1", "index of the tool"},
    {"/ticks/position", AT(state.position), PALPATE_H5_F64, 3, "m",
     "device pose given, device frame"},
    {"/ticks/orientation", AT(state.orientation), PALPATE_H5_F64, 4, "1", "quaternion w, x, y, z"},
    {"/ticks/buttons", AT(state.buttons), PALPATE_H5_U32, 1, "1", "button bits"},
    {"/ticks/flags", AT(state.flags), PALPATE_H5_U32, 1, "1",
     "PALPATE_STATE_STALE and the periods missed before the tick"},
    {"/ticks/device_stamp", AT(state.time_ns), PALPATE_H5_I64, 1, "ns", "device time stamp"},
    {"/ticks/force", AT(force.force), PALPATE_H5_F64, 3, "N", "force on the tool, device frame"},
    {"/ticks/torque", AT(force.torque), PALPATE_H5_F64, 3, "N m",
     "torque on the tool about its origin"},
    {"/ticks/contacts", AT(force.contact_count), PALPATE_H5_I32, 1, "1", "contact points"},
    {"/ticks/tool_fault", AT(force.fault), PALPATE_H5_U32, 1, "1",
     "fault bits of the engine alone"},
    {"/ticks/depth", AT(force.depth), PALPATE_H5_F64, 1, "m",
     "deepest overlap with the rest surface"},
    {"/ticks/centroid", AT(force.centroid), PALPATE_H5_F64, 3, "m", "contact centroid, body frame"},
    {"/ticks/normal", AT(force.normal), PALPATE_H5_F64, 3, "1", "mean contact normal, body frame"},
};
const int pal_tick_field_count = sizeof pal_tick_field_list / sizeof *pal_tick_field_list;

/// One conversion: inputs, output, and the first failure.
typedef struct conversion {
    char ticks_name[PALPATE_RECORDING_PATH], frames_name[PALPATE_RECORDING_PATH];
    char temporary[PALPATE_RECORDING_PATH], xdmf_name[PALPATE_RECORDING_PATH];
    pal_ticks_header ticks_header;
    pal_frames_header frames_header;
    pal_raw_reader ticks, frames;
    char *surface;
    int has_frames;
    uint64_t records, frame_count; ///< good ones
    pal_h5 *file;
    pal_recording_summary summary;
} conversion;

static pal_status count_good(pal_raw_reader *reader, uint64_t *good, pal_error *error) {
    int64_t capacity = reader->item_size > 65536 ? 16 : 4096, n = 0;
    char *buffer = malloc((size_t)(reader->item_size * capacity));
    if (buffer == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory to read it");
    }
    *good = 0;
    pal_status status = PALPATE_OK;
    do {
        status = pal_raw_read(reader, buffer, capacity, &n, error);
        *good += (uint64_t)n;
    } while (status == PALPATE_OK && n > 0);
    free(buffer);
    uint64_t bad = reader->bad;
    pal_raw_rewind(reader);
    reader->bad = bad;
    return status;
}

static pal_status write_number(pal_h5 *file, const char *path, double value, const char *unit,
                               const char *description, pal_error *error) {
    return pal_h5_write(file, path, PALPATE_H5_F64, 0, NULL, &value, unit, description, error);
}

static pal_status write_whole(pal_h5 *file, const char *path, int64_t value, const char *unit,
                              const char *description, pal_error *error) {
    return pal_h5_write(file, path, PALPATE_H5_I64, 0, NULL, &value, unit, description, error);
}

static pal_status write_pose(pal_h5 *file, const char *path, const pal_pose *pose,
                             const char *description, pal_error *error) {
    const double v[7] = {pose->position[0],    pose->position[1],    pose->position[2],
                         pose->orientation[0], pose->orientation[1], pose->orientation[2],
                         pose->orientation[3]};
    return pal_h5_write(file, path, PALPATE_H5_F64, 1, (const int64_t[]){7}, v, "m, 1", description,
                        error);
}

static pal_status write_tools(conversion *c, pal_error *error) {
    pal_status status = PALPATE_OK;
    for (int32_t i = 0; status == PALPATE_OK && i < c->ticks_header.tool_count; i++) {
        pal_tool_def *t = &c->ticks_header.tool[i];
        char path[PALPATE_H5_PATH_MAX];
        t->name[PALPATE_NAME_MAX - 1] = 0;
        (void)snprintf(path, sizeof path, "/tool/%d/name", (int)i);
        status = pal_h5_write_text(c->file, path, t->name, "the tool's name", error);
        const double shape[6] = {(double)t->shape,      t->radius,          t->length, t->friction,
                                 t->coupling_stiffness, t->coupling_damping};
        (void)snprintf(path, sizeof path, "/tool/%d/shape", (int)i);
        if (status == PALPATE_OK) {
            status =
                pal_h5_write(c->file, path, PALPATE_H5_F64, 1, (const int64_t[]){6}, shape, "SI",
                             "shape (0 point, 1 sphere, 2 capsule), radius, length, friction, "
                             "coupling stiffness, coupling damping",
                             error);
        }
        const double limits[3] = {t->limits.force, t->limits.slew, t->limits.torque};
        (void)snprintf(path, sizeof path, "/tool/%d/limits", (int)i);
        if (status == PALPATE_OK) {
            status = pal_h5_write(c->file, path, PALPATE_H5_F64, 1, (const int64_t[]){3}, limits,
                                  "N, N/ms, N m", "caps of force, slew and torque", error);
        }
        const double spec[7] = {t->spec.max_force,   t->spec.max_torque, t->spec.max_stiffness,
                                t->spec.max_damping, t->spec.max_speed,  t->spec.damping,
                                t->spec.resolution};
        (void)snprintf(path, sizeof path, "/tool/%d/spec", (int)i);
        if (status == PALPATE_OK) {
            status =
                pal_h5_write(c->file, path, PALPATE_H5_F64, 1, (const int64_t[]){7}, spec, "SI",
                             "what its device bears: force, torque, stiffness, damping, speed; "
                             "its damping and resolution",
                             error);
        }
    }
    return status;
}

static pal_status write_facts(conversion *c, pal_error *error) {
    pal_ticks_header *h = &c->ticks_header;
    h->model_hash[sizeof h->model_hash - 1] = h->model_method[sizeof h->model_method - 1] = 0;
    h->model_provenance[sizeof h->model_provenance - 1] = h->program[sizeof h->program - 1] = 0;
    const struct {
        const char *path, *text, *description;
    } text[] = {
        {"/format", "palpate recording 2", "format and version"},
        {"/program", h->program, "what recorded it"},
        {"/model_hash", h->model_hash, "content hash of the model"},
        {"/model_method", h->model_method, "discretization of the model"},
        {"/model_provenance", h->model_provenance, "what built the model"},
    };
    const struct {
        const char *path;
        int64_t value;
        const char *unit, *description;
    } whole[] = {
        {"/period", h->period_ns, "ns", "servo period"},
        {"/started", h->started_s, "s", "wall clock at the start, since 1970-01-01 UTC"},
        {"/complete", h->complete, "1", "1: the run ended in order, 0: it was killed"},
        {"/freewheel", h->freewheel, "1", "1: without deadlines"},
        {"/max_contacts", h->max_contacts, "1", "contact points the engine kept at most"},
        {"/contact", h->contact, "1", "contact law: 0 nodes; else surface, points << 8 | 1"},
        {"/records_lost", (int64_t)h->lost, "1", "records the disk refused"},
        {"/records_damaged", (int64_t)c->ticks.bad, "1",
         "records dropped: checksum wrong or cut off"},
    };
    pal_status status = PALPATE_OK;
    for (size_t i = 0; status == PALPATE_OK && i < sizeof text / sizeof *text; i++) {
        status = pal_h5_write_text(c->file, text[i].path, text[i].text, text[i].description, error);
    }
    for (size_t i = 0; status == PALPATE_OK && i < sizeof whole / sizeof *whole; i++) {
        status = write_whole(c->file, whole[i].path, whole[i].value, whole[i].unit,
                             whole[i].description, error);
    }
    if (status == PALPATE_OK) {
        status = write_number(c->file, "/engine_period", h->period, "s",
                              "servo period as the engine has it", error);
    }
    if (status == PALPATE_OK) {
        status = write_number(c->file, "/device_scale", h->device_scale, "1",
                              "world metres per device metre", error);
    }
    if (status == PALPATE_OK) {
        status = write_pose(c->file, "/body_pose", &h->body_pose,
                            "body in the world: x, y, z, qw, qx, qy, qz", error);
    }
    if (status == PALPATE_OK) {
        status = write_pose(c->file, "/device_to_world", &h->device_to_world,
                            "device frame in the world: x, y, z, qw, qx, qy, qz", error);
    }
    const pal_watchdog_def *w = &h->watchdog;
    const double watchdog[6] = {w->stale, w->stall, w->latch, w->speed, w->ramp_down, w->ramp_up};
    if (status == PALPATE_OK) {
        status =
            pal_h5_write(c->file, "/watchdog", PALPATE_H5_F64, 1, (const int64_t[]){6}, watchdog,
                         "s, m/s", "stale, stall, latch, speed, ramp down, ramp up", error);
    }
    return status == PALPATE_OK ? write_tools(c, error) : status;
}

static pal_status write_ticks(conversion *c, pal_error *error) {
    pal_status status = PALPATE_OK;
    for (int f = 0; status == PALPATE_OK && f < pal_tick_field_count; f++) {
        const pal_tick_field *d = &pal_tick_field_list[f];
        status = pal_h5_declare(c->file, d->path, d->type, d->width > 1 ? 2 : 1,
                                (const int64_t[]){(int64_t)c->records, d->width}, d->unit,
                                d->description, error);
    }
    pal_tick_record *record = malloc(CHUNK * sizeof *record);
    double *column = malloc(CHUNK * 4 * sizeof *column);
    if (record == NULL || column == NULL) {
        free(record);
        free(column);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory to convert it");
    }
    int64_t first = 0, n = 1;
    while (status == PALPATE_OK && n > 0) {
        status = pal_raw_read(&c->ticks, record, CHUNK, &n, error);
        n = status != PALPATE_OK ? 0 : n;
        n = (uint64_t)(first + n) > c->records ? (int64_t)c->records - first : n; // as counted
        for (int f = 0; n > 0 && status == PALPATE_OK && f < pal_tick_field_count; f++) {
            const pal_tick_field *d = &pal_tick_field_list[f];
            size_t size = pal_h5_type_size(d->type) * (size_t)d->width;
            for (int64_t i = 0; i < n; i++) {
                memcpy((char *)column + (size_t)i * size, (const char *)&record[i] + d->offset,
                       size);
            }
            status = pal_h5_write_rows(c->file, d->path, d->type, first, n, 0, column, error);
        }
        if (n > 0) {
            c->summary.seconds = 1e-9 * (double)record[n - 1].time_ns;
        }
        first += n;
    }
    free(record);
    free(column);
    return status;
}

static pal_status write_surface(conversion *c, pal_error *error) {
    const pal_frames_header *h = &c->frames_header;
    pal_status status = pal_h5_write(
        c->file, "/surface/rest", PALPATE_H5_F64, 2, (const int64_t[]){h->row_count, 3}, c->surface,
        "m", "rest positions of the recorded surface nodes, body frame", error);
    if (status == PALPATE_OK) {
        status = pal_h5_write(c->file, "/surface/triangles", PALPATE_H5_I32, 2,
                              (const int64_t[]){h->triangle_count, 3},
                              c->surface + 24 * (size_t)h->row_count, "1",
                              "corners, indices into the recorded nodes", error);
    }
    return status;
}

/// What is small about the frames, collected while they pass; shapes [frames, ...].
typedef struct frame_table {
    uint64_t *tick;
    double *time, *place, *turn, *force; ///< (tools x 3, 4, 3)
} frame_table;

static void free_table(frame_table *t) {
    free(t->tick);
    free(t->time);
    free(t->place);
    free(t->turn);
    free(t->force);
    *t = (frame_table){0};
}

static pal_status make_table(frame_table *t, uint64_t frames, int32_t tools, pal_error *error) {
    size_t n = (size_t)frames + 1, m = n * (size_t)tools;
    *t = (frame_table){.tick = calloc(n, sizeof *t->tick),
                       .time = calloc(n, sizeof *t->time),
                       .place = calloc(3 * m, sizeof *t->place),
                       .turn = calloc(4 * m, sizeof *t->turn),
                       .force = calloc(3 * m, sizeof *t->force)};
    if (t->tick == NULL || t->time == NULL || t->place == NULL || t->turn == NULL ||
        t->force == NULL) {
        free_table(t);
        (void)pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory for %llu frames",
                       (unsigned long long)frames);
        return PALPATE_ERROR_MEMORY;
    }
    return PALPATE_OK;
}

static pal_status write_table(conversion *c, const frame_table *t, pal_error *error) {
    int64_t frames = (int64_t)c->frame_count, tools = c->frames_header.tool_count;
    const struct {
        const char *path;
        pal_h5_type type;
        int rank;
        int64_t width;
        const void *data;
        const char *unit, *description;
    } set[] = {
        {"/frames/tick", PALPATE_H5_U64, 1, 0, t->tick, "1", "tick of the frame"},
        {"/frames/time", PALPATE_H5_F64, 1, 0, t->time, "s", "session time"},
        {"/frames/tool_position", PALPATE_H5_F64, 3, 3, t->place, "m", "tools, body frame"},
        {"/frames/tool_orientation", PALPATE_H5_F64, 3, 4, t->turn, "1", "quaternions w, x, y, z"},
        {"/frames/tool_force", PALPATE_H5_F64, 3, 3, t->force, "N", "on the tools, body frame"},
    };
    pal_status status = PALPATE_OK;
    for (size_t i = 0; status == PALPATE_OK && i < sizeof set / sizeof *set; i++) {
        status = pal_h5_write(c->file, set[i].path, set[i].type, set[i].rank,
                              (const int64_t[]){frames, tools, set[i].width}, set[i].data,
                              set[i].unit, set[i].description, error);
    }
    return status;
}

static pal_status write_frame(conversion *c, frame_table *table, int64_t index, const char *item,
                              float *position, pal_error *error) {
    const pal_frames_header *h = &c->frames_header;
    const pal_frame_head *head = (const pal_frame_head *)(const void *)item;
    const float *u = (const float *)(const void *)(item + sizeof *head);
    const double *rest = (const double *)(const void *)c->surface;
    table->tick[index] = head->tick;
    table->time[index] = 1e-9 * (double)head->time_ns;
    for (int32_t t = 0; t < h->tool_count; t++) {
        int64_t k = index * h->tool_count + t;
        memcpy(table->place + 3 * k, head->tool_pose[t].position, 3 * sizeof(double));
        memcpy(table->turn + 4 * k, head->tool_pose[t].orientation, 4 * sizeof(double));
        memcpy(table->force + 3 * k, head->tool_force[t].force, 3 * sizeof(double));
    }
    for (int64_t i = 0; i < 3 * (int64_t)h->row_count; i++) {
        position[i] = (float)(rest[i] + (double)u[i]);
    }
    char path[64];
    const int64_t dims[2] = {h->row_count, 3};
    pal_xdmf_dataset("position", index, path, sizeof path);
    pal_status status = pal_h5_write(c->file, path, PALPATE_H5_F32, 2, dims, position, "m",
                                     "deformed surface, body frame", error);
    pal_xdmf_dataset("displacement", index, path, sizeof path);
    return status != PALPATE_OK ? status
                                : pal_h5_write(c->file, path, PALPATE_H5_F32, 2, dims, u, "m",
                                               "displacement, body frame", error);
}

/// Frames and the XDMF text that points at them.
static pal_status write_frames(conversion *c, const char *h5_path, pal_error *error) {
    frame_table table;
    pal_status status = make_table(&table, c->frame_count, c->frames_header.tool_count, error);
    if (status != PALPATE_OK) {
        return status;
    }
    char *item = calloc(1, (size_t)c->frames.item_size);
    float *position = malloc(3 * sizeof(float) * ((size_t)c->frames_header.row_count + 1));
    if (item == NULL || position == NULL) {
        (void)pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory for a frame");
        status = PALPATE_ERROR_MEMORY;
    } else {
        status = write_surface(c, error);
    }
    int64_t done = 0, n = 1;
    while (status == PALPATE_OK && n > 0 && done < (int64_t)c->frame_count) {
        status = pal_raw_read(&c->frames, item, 1, &n, error);
        if (status == PALPATE_OK && n > 0) {
            status = write_frame(c, &table, done++, item, position, error);
        }
    }
    if (status == PALPATE_OK) {
        status = write_table(c, &table, error);
    }
    if (status == PALPATE_OK) {
        const pal_xdmf_series series = {.h5_path = h5_path,
                                        .frames = done,
                                        .time = table.time,
                                        .tool_position = table.place,
                                        .tool_force = table.force,
                                        .rows = c->frames_header.row_count,
                                        .triangles = c->frames_header.triangle_count,
                                        .tools = c->frames_header.tool_count};
        status = pal_xdmf_write(c->xdmf_name, &series, error);
    }
    free(item);
    free(position);
    free_table(&table);
    return status;
}

/// Rename the finished file into place, on disk.
static pal_status commit(const char *temporary, const char *path, pal_error *error) {
    int fd = open(temporary, O_RDONLY | O_CLOEXEC);
    int why = fd < 0 || fsync(fd) != 0 ? errno : 0;
    if (fd >= 0) {
        close(fd);
    }
    if (why == 0 && rename(temporary, path) != 0) {
        why = errno;
    }
    return why == 0 ? PALPATE_OK
                    : pal_fail(error, PALPATE_ERROR_IO, "%s: cannot be written: %s", path,
                               strerror(why));
}

static pal_status open_raw(conversion *c, pal_error *error) {
    pal_status status = pal_raw_open_ticks(c->ticks_name, &c->ticks_header, &c->ticks, error);
    if (status == PALPATE_OK) {
        status = count_good(&c->ticks, &c->records, error);
    }
    if (status == PALPATE_OK && access(c->frames_name, F_OK) == 0) {
        pal_error frames_error = {0};
        status = pal_raw_open_frames(c->frames_name, &c->frames_header, &c->surface, &c->frames,
                                     &frames_error);
        // killed while the surface was being written: there are no frames, but there may be ticks
        c->has_frames = status == PALPATE_OK;
        if (status == PALPATE_ERROR_TRUNCATED) {
            status = PALPATE_OK;
        } else if (status != PALPATE_OK) {
            return pal_fail(error, status, "%s", frames_error.message);
        }
    }
    if (status == PALPATE_OK && c->has_frames) {
        status = count_good(&c->frames, &c->frame_count, error);
    }
    return status;
}

/// HDF5 cannot be left in peace once a write has failed (its clean-up at exit crashes), so a full
/// disk and a limit to the size of files are found before it starts.
static pal_status check_space(const conversion *c, const char *path, pal_error *error) {
    struct statvfs disk;
    char folder[PALPATE_RECORDING_PATH];
    (void)snprintf(folder, sizeof folder, "%s", path);
    char *slash = strrchr(folder, '/');
    (void)snprintf(slash != NULL ? slash + 1 : folder, 2, ".");
    double need = (double)c->records * sizeof(pal_tick_record) + 65536.0;
    if (c->has_frames) { // displacement and position
        need += 2.0 * (double)c->frame_count * (double)c->frames_header.item_bytes;
    }
    struct rlimit limit;
    if (getrlimit(RLIMIT_FSIZE, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY &&
        need > (double)limit.rlim_cur) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s: its %.1f MB are more than the %.1f MB that a file may have here "
                        "(ulimit -f); raise that, then `palpate recover %s`",
                        path, 1e-6 * need, 1e-6 * (double)limit.rlim_cur, path);
    }
    if (statvfs(folder, &disk) != 0) {
        return PALPATE_OK; // the writing itself will tell
    }
    double free_bytes = (double)disk.f_bavail * (double)disk.f_frsize;
    return need <= free_bytes
               ? PALPATE_OK
               : pal_fail(error, PALPATE_ERROR_IO,
                          "%s: its %.1f MB do not fit into the %.1f MB that are free; free "
                          "space, then `palpate recover %s`",
                          path, 1e-6 * need, 1e-6 * free_bytes, path);
}

static pal_status convert(conversion *c, const char *path, pal_error *error) {
    pal_status status = open_raw(c, error);
    if (status != PALPATE_OK) {
        return status;
    }
    status = check_space(c, path, error);
    if (status != PALPATE_OK) {
        return status;
    }
    uint64_t bad_records = c->ticks.bad, bad_frames = c->has_frames ? c->frames.bad : 0;
    size_t expected = (size_t)c->records * sizeof(pal_tick_record);
    status = pal_h5_create(c->temporary, PALPATE_USER_BLOCK, expected, &c->file, error);
    if (status != PALPATE_OK) {
        (void)unlink(c->temporary);
        return status;
    }
    status = write_facts(c, error);
    if (status == PALPATE_OK) {
        status = write_ticks(c, error);
    }
    if (status == PALPATE_OK && c->has_frames) {
        status = write_frames(c, path, error);
    }
    pal_status closed = pal_h5_close(c->file, status == PALPATE_OK ? error : NULL);
    status = status != PALPATE_OK ? status : closed;
    if (status == PALPATE_OK) {
        status = pal_file_seal_path(PALPATE_FILE_RECORDING, PALPATE_RECORDING_VERSION, c->temporary,
                                    error);
    }
    if (status == PALPATE_OK) {
        status = commit(c->temporary, path, error);
    }
    if (status != PALPATE_OK) {
        (void)unlink(c->temporary);
        return status;
    }
    (void)unlink(c->ticks_name);
    (void)unlink(c->frames_name);
    c->summary.records = c->records;
    c->summary.frames = c->frame_count;
    c->summary.bad_records = bad_records;
    c->summary.bad_frames = bad_frames;
    c->summary.complete = c->ticks_header.complete == 1;
    return PALPATE_OK;
}

pal_status pal_recording_convert(const char *path, pal_recording_summary *summary,
                                 pal_error *error) {
    if (path == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_recording_convert: path is NULL");
    }
    conversion *c = calloc(1, sizeof *c);
    if (c == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory to convert it");
    }
    c->ticks.fd = c->frames.fd = -1;
    pal_status status = pal_recording_name(path, ".ticks", c->ticks_name, error);
    if (status == PALPATE_OK) {
        status = pal_recording_name(path, ".frames", c->frames_name, error);
    }
    if (status == PALPATE_OK) {
        status = pal_recording_name(path, ".part", c->temporary, error);
    }
    if (status == PALPATE_OK) {
        status = pal_xdmf_name(path, c->xdmf_name, error);
    }
    if (status == PALPATE_OK) {
        status = convert(c, path, error);
    }
    pal_raw_close(&c->ticks);
    pal_raw_close(&c->frames);
    free(c->surface);
    if (status == PALPATE_OK && summary != NULL) {
        *summary = c->summary;
    }
    free(c);
    return status;
}
