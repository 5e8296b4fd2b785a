/// @file reader_client.c  The library's end of the conversation with palpate-reader.
///
/// Its answer is not believed: it reads files from strangers and may have been taken over by one.
/// Counts are bounded by the file's size (a vertex or a corner takes a byte at least), memory grows
/// with what arrives, indices and coordinates are checked. Thread: any; each call has its own
/// process (helper.h).
#include "src/geometry/reader_client.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

static const pal_helper_kind reader = {"palpate-reader", "PALPATE_READER"};

pal_reader_limits pal_reader_default_limits(int64_t file_bytes) {
    int32_t megabytes = (int32_t)(file_bytes >> 20);
    return (pal_reader_limits){.memory_bytes = ((int64_t)256 << 20) + 64 * file_bytes,
                               .cpu_seconds = 3 + megabytes,
                               .seconds = 4 * (3 + megabytes)};
}

static pal_status check_reply(const pal_reader_request *request, pal_reader_reply *reply,
                              pal_error *error) {
    if (reply->magic != PALPATE_READER_MAGIC || reply->version != PALPATE_READER_VERSION ||
        reply->size != sizeof *reply) {
        return pal_fail(
            error, PALPATE_ERROR_SYSTEM,
            "palpate-reader: its answer is not of version %d: library and reader must come "
            "from the same build",
            PALPATE_READER_VERSION);
    }
    if (reply->verdict != PALPATE_READER_DONE) {
        pal_helper_printable(reply->message, sizeof reply->message);
        return pal_fail(error,
                        reply->verdict == PALPATE_READER_NO_MEMORY      ? PALPATE_ERROR_MEMORY
                        : reply->verdict == PALPATE_READER_BAD_GEOMETRY ? PALPATE_ERROR_GEOMETRY
                                                                        : PALPATE_ERROR_IO,
                        "%s",
                        reply->message[0] ? reply->message : "palpate-reader gives no reason");
    }
    if (reply->vertex_count < 1 || reply->vertex_count > request->file_bytes ||
        reply->triangle_count < 1 || reply->triangle_count > request->file_bytes ||
        reply->vertex_count > INT32_MAX / 8 || reply->triangle_count > INT32_MAX / 8) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "palpate-reader: it answers %d vertices and %d triangles from %lld bytes",
                        reply->vertex_count, reply->triangle_count, (long long)request->file_bytes);
    }
    return PALPATE_OK;
}

pal_status pal_reader_converse(pal_helper *h, const pal_reader_request *request, pal_surface *out,
                               pal_error *error) {
    pal_reader_reply reply = {0};
    pal_status status = pal_helper_transfer(h, request, NULL, sizeof *request, NULL, error);
    if (status == PALPATE_OK || status == PALPATE_ERROR_TRUNCATED) { // gone: it may have answered
        status = pal_helper_transfer(h, NULL, &reply, sizeof reply, NULL, error);
    }
    if (status == PALPATE_OK) {
        status = check_reply(request, &reply, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    void *data;
    size_t coordinates = 3 * (size_t)reply.vertex_count, corners = 3 * (size_t)reply.triangle_count;
    status = pal_helper_receive(h, coordinates * sizeof *out->x, NULL, &data, error);
    if (status == PALPATE_OK) {
        out->x = data;
        out->vertex_count = reply.vertex_count;
        status = pal_helper_receive(h, corners * sizeof *out->v, NULL, &data, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    out->v = data;
    out->triangle_count = reply.triangle_count;
    for (size_t i = 0; i < coordinates; i++) {
        if (!isfinite(out->x[i])) {
            return pal_fail(error, PALPATE_ERROR_IO,
                            "palpate-reader: vertex %zu of its answer is not at a finite place",
                            i / 3);
        }
    }
    for (size_t i = 0; i < corners; i++) {
        if (out->v[i] < 0 || out->v[i] >= out->vertex_count) {
            return pal_fail(error, PALPATE_ERROR_IO,
                            "palpate-reader: triangle %zu of its answer names vertex %d of %d",
                            i / 3, out->v[i], out->vertex_count);
        }
    }
    return PALPATE_OK;
}

pal_status pal_reader_import(int file, int64_t file_bytes, pal_reader_format format, int in_order,
                             const pal_reader_limits *limits, pal_surface *out, pal_error *error) {
    const pal_reader_request request = {.magic = PALPATE_READER_MAGIC,
                                        .version = PALPATE_READER_VERSION,
                                        .size = sizeof request,
                                        .format = (int32_t)format,
                                        .in_order = in_order,
                                        .file_bytes = file_bytes,
                                        .memory_bytes = limits->memory_bytes,
                                        .cpu_seconds = limits->cpu_seconds};
    pal_helper h;
    pal_status status = pal_helper_start(&h, &reader, file, limits->seconds, error);
    if (status != PALPATE_OK) {
        return status;
    }
    status = pal_reader_converse(&h, &request, out, error);
    int state = pal_helper_finish(&h, status != PALPATE_OK && status != PALPATE_ERROR_TRUNCATED);
    if (status == PALPATE_ERROR_TRUNCATED) {
        char fate[512];
        pal_helper_fate(&h, state, fate, sizeof fate);
        status =
            pal_fail(error, PALPATE_ERROR_IO, "%s; is the file damaged? Export it again", fate);
    }
    if (status != PALPATE_OK) {
        pal_surface_clear(out);
    }
    return status;
}
