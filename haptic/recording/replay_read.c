/// @file replay_read.c  A finished recording (HDF5) back into an engine's definition and tick
/// records.
///
/// The file's seal is verified before HDF5 sees it, and nothing in it is trusted: types, ranks and
/// dimensions are checked by h5_read.c, the definition by pal_engine_create, tool indices here.
/// Rows are read in pieces, so a file's claim about its length allocates nothing.
#include "haptic/recording/replay_read.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/model/file_header.h"
#include "haptic/recording/recording.h"

static pal_status read_number(pal_h5 *file, const char *path, double *value, pal_error *error) {
    return pal_h5_read(file, path, PALPATE_H5_F64, 0, NULL, value, error);
}

static pal_status read_whole(pal_h5 *file, const char *path, int64_t *value, pal_error *error) {
    return pal_h5_read(file, path, PALPATE_H5_I64, 0, NULL, value, error);
}

static pal_status read_pose(pal_h5 *file, const char *path, pal_pose *pose, pal_error *error) {
    double v[7];
    pal_status status = pal_h5_read(file, path, PALPATE_H5_F64, 1, (const int64_t[]){7}, v, error);
    if (status == PALPATE_OK) {
        memcpy(pose->position, v, sizeof pose->position);
        memcpy(pose->orientation, v + 3, sizeof pose->orientation);
    }
    return status;
}

static pal_status read_tool(pal_h5 *file, int32_t i, pal_tool_def *tool, pal_error *error) {
    char path[PALPATE_H5_PATH_MAX];
    double shape[6], limits[3];
    (void)snprintf(path, sizeof path, "/tool/%d/name", (int)i);
    pal_status status = pal_h5_read_text(file, path, tool->name, sizeof tool->name, error);
    if (status == PALPATE_OK) {
        (void)snprintf(path, sizeof path, "/tool/%d/shape", (int)i);
        status = pal_h5_read(file, path, PALPATE_H5_F64, 1, (const int64_t[]){6}, shape, error);
    }
    if (status == PALPATE_OK) {
        (void)snprintf(path, sizeof path, "/tool/%d/limits", (int)i);
        status = pal_h5_read(file, path, PALPATE_H5_F64, 1, (const int64_t[]){3}, limits, error);
    }
    double spec[7] = {0.0};
    (void)snprintf(path, sizeof path, "/tool/%d/spec", (int)i);
    if (status == PALPATE_OK && pal_h5_has(file, path)) {
        status = pal_h5_read(file, path, PALPATE_H5_F64, 1, (const int64_t[]){7}, spec, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    tool->spec = (pal_device_spec){.max_force = spec[0],
                                   .max_torque = spec[1],
                                   .max_stiffness = spec[2],
                                   .max_damping = spec[3],
                                   .max_speed = spec[4],
                                   .damping = spec[5],
                                   .resolution = spec[6]};
    if (!(shape[0] >= PALPATE_SHAPE_POINT && shape[0] <= PALPATE_SHAPE_CAPSULE)) {
        return pal_fail(error, PALPATE_ERROR_FORMAT, "/tool/%d/shape: %g is no known shape", (int)i,
                        shape[0]);
    }
    tool->shape = (pal_shape_kind)(int)shape[0];
    tool->radius = shape[1];
    tool->length = shape[2];
    tool->friction = shape[3];
    tool->coupling_stiffness = shape[4];
    tool->coupling_damping = shape[5];
    tool->limits = (pal_tool_limits){limits[0], limits[1], limits[2]};
    return PALPATE_OK;
}

static pal_status read_facts(pal_recording *r, pal_error *error) {
    pal_recording_info *info = &r->info;
    pal_engine_def *def = &info->engine;
    char format[64] = "";
    pal_status status = pal_h5_read_text(r->file, "/format", format, sizeof format, error);
    if (status != PALPATE_OK) {
        return status;
    }
    if (strcmp(format, "palpate recording 2") != 0) {
        return pal_fail(
            error, PALPATE_ERROR_VERSION,
            "/format: '%s', this program replays 'palpate recording 2'; record it again", format);
    }
    const struct {
        const char *path;
        char *text;
        size_t size;
    } text[] = {{"/model_hash", info->model_hash, sizeof info->model_hash},
                {"/model_method", info->model_method, sizeof info->model_method},
                {"/program", info->program, sizeof info->program}};
    for (size_t i = 0; status == PALPATE_OK && i < sizeof text / sizeof *text; i++) {
        status = pal_h5_read_text(r->file, text[i].path, text[i].text, text[i].size, error);
    }
    int64_t freewheel = 0, complete = 0, max_contacts = 0;
    const struct {
        const char *path;
        int64_t *value;
    } whole[] = {
        {"/freewheel", &freewheel}, {"/complete", &complete}, {"/max_contacts", &max_contacts}};
    for (size_t i = 0; status == PALPATE_OK && i < sizeof whole / sizeof *whole; i++) {
        status = read_whole(r->file, whole[i].path, whole[i].value, error);
    }
    *def = pal_engine_default_def();
    if (status == PALPATE_OK) {
        status = read_number(r->file, "/engine_period", &def->period, error);
    }
    if (status == PALPATE_OK) {
        status = read_number(r->file, "/device_scale", &def->device_scale, error);
    }
    if (status == PALPATE_OK) {
        status = read_pose(r->file, "/body_pose", &def->body_pose, error);
    }
    if (status == PALPATE_OK) {
        status = read_pose(r->file, "/device_to_world", &def->device_to_world, error);
    }
    double w[6] = {0.0}; // recordings from before there were thresholds were made with the defaults
    if (status == PALPATE_OK && pal_h5_has(r->file, "/watchdog")) {
        status =
            pal_h5_read(r->file, "/watchdog", PALPATE_H5_F64, 1, (const int64_t[]){6}, w, error);
    }
    def->watchdog = (pal_watchdog_def){w[0], w[1], w[2], w[3], w[4], w[5]};
    info->freewheel = freewheel != 0;
    info->complete = complete == 1;
    if (status == PALPATE_OK && (max_contacts < 1 || max_contacts > INT32_MAX)) {
        status = pal_fail(error, PALPATE_ERROR_FORMAT, "/max_contacts: %lld: must be positive",
                          (long long)max_contacts);
    }
    def->max_contacts = (int32_t)max_contacts;
    int64_t contact = 0; // older recordings: all there was
    if (status == PALPATE_OK && pal_h5_has(r->file, "/contact")) {
        status = read_whole(r->file, "/contact", &contact, error);
    }
    def->contact_law = (contact & 1) != 0 ? PALPATE_CONTACT_SURFACE : PALPATE_CONTACT_NODES;
    def->contact_points = (int32_t)(contact >> 8 & 0xff);
    def->reader_count = 0; // nobody looks at the field
    def->tools = r->tool;
    return status;
}

static pal_status read_tools(pal_recording *r, pal_error *error) {
    pal_status status = PALPATE_OK;
    int32_t n = 0;
    char path[PALPATE_H5_PATH_MAX];
    (void)snprintf(path, sizeof path, "/tool/0/name");
    while (status == PALPATE_OK && n < PALPATE_TOOLS_MAX && pal_h5_has(r->file, path)) {
        status = read_tool(r->file, n, &r->tool[n], error);
        n++;
        (void)snprintf(path, sizeof path, "/tool/%d/name", (int)n);
    }
    if (status == PALPATE_OK && n == 0) {
        status = pal_fail(error, PALPATE_ERROR_FORMAT, "/tool: there is none");
    }
    r->info.engine.tool_count = n;
    return status;
}

pal_status pal_recording_open(const char *path, pal_recording **out, pal_error *error) {
    if (path == NULL || out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_recording_open: NULL argument");
    }
    *out = NULL;
    pal_recording *r = calloc(1, sizeof *r);
    if (r == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory to read it", path);
    }
    // the gate: HDF5 1.10 crashes on damaged bytes
    pal_status status =
        pal_file_verify_path(PALPATE_FILE_RECORDING, PALPATE_RECORDING_VERSION, path, error);
    if (status == PALPATE_OK) {
        status = pal_h5_open_file(path, &r->file, error);
    }
    if (status == PALPATE_OK) {
        status = read_facts(r, error);
        if (status == PALPATE_OK) {
            status = read_tools(r, error);
        }
        int64_t rows[1] = {0};
        if (status == PALPATE_OK) {
            status = pal_h5_dims(r->file, "/ticks/tick", PALPATE_H5_U64, 1, rows, error);
        }
        r->info.records = rows[0];
        if (status != PALPATE_OK) {
            status = pal_fail_prefix(error, status, "%s", path);
        }
    }
    if (status != PALPATE_OK) {
        pal_recording_close(r);
        return status;
    }
    *out = r;
    return PALPATE_OK;
}

void pal_recording_close(pal_recording *r) {
    if (r != NULL) {
        (void)pal_h5_close(r->file, NULL);
        free(r);
    }
}

const pal_recording_info *pal_recording_get_info(const pal_recording *recording) {
    return &recording->info;
}

pal_status pal_recording_rows(pal_recording *r, int64_t first, int64_t count, pal_tick_record *out,
                              pal_error *error) {
    if (first < 0 || count < 0 || first > r->info.records || count > r->info.records - first) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "recording: %lld rows from %lld of %lld",
                        (long long)count, (long long)first, (long long)r->info.records);
    }
    double *column = malloc((size_t)(count + 1) * 4 * sizeof *column);
    if (column == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "recording: no memory for %lld rows",
                        (long long)count);
    }
    memset(out, 0, (size_t)count * sizeof *out);
    pal_status status = PALPATE_OK;
    for (int f = 0; status == PALPATE_OK && count > 0 && f < pal_tick_field_count; f++) {
        const pal_tick_field *d = &pal_tick_field_list[f];
        size_t size = pal_h5_type_size(d->type) * (size_t)d->width;
        const int64_t dims[2] = {r->info.records, d->width};
        status = pal_h5_read_rows(r->file, d->path, d->type, d->width > 1 ? 2 : 1, dims, first,
                                  count, 0, column, error);
        for (int64_t i = 0; status == PALPATE_OK && i < count; i++) {
            memcpy((char *)&out[i] + d->offset, (const char *)column + (size_t)i * size, size);
        }
    }
    free(column);
    for (int64_t i = 0; status == PALPATE_OK && i < count; i++) {
        if (out[i].tool < 0 || out[i].tool >= r->info.engine.tool_count) {
            status = pal_fail(error, PALPATE_ERROR_FORMAT,
                              "/ticks/tool: row %lld: %d: must be 0 to %d", (long long)(first + i),
                              (int)out[i].tool, (int)r->info.engine.tool_count - 1);
        }
    }
    return status;
}
