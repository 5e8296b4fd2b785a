/// @file mesher_client.c  The library's end of the conversation with palpate-mesher.
///
/// Its answer is not believed: counts, indices and coordinates are checked here. Thread: any; each
/// call has its own process (helper.h).
#include "src/cloud/mesher_client.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/mesher/protocol.h"

static const pal_helper_kind mesher = {"palpate-mesher", "PALPATE_MESHER"};

void pal_mesh_fill_clear(pal_mesh_fill *fill) {
    free(fill->inside);
    free(fill->tet);
    memset(fill, 0, sizeof *fill);
}

static pal_status check_reply(pal_mesher_reply *reply, pal_error *error) {
    if (reply->magic != PALPATE_MESHER_MAGIC || reply->version != PALPATE_MESHER_VERSION ||
        reply->size != sizeof *reply) {
        return pal_fail(
            error, PALPATE_ERROR_CLOUD,
            "palpate-mesher: its answer is not of version %d: library and mesher must come "
            "from the same build",
            PALPATE_MESHER_VERSION);
    }
    if (reply->status != 0) {
        pal_helper_printable(reply->message, sizeof reply->message);
        return pal_fail(error, PALPATE_ERROR_CLOUD,
                        "palpate-mesher: %s; try another body.spacing or check the surface",
                        reply->message);
    }
    if (reply->inside_count < 0 || reply->inside_count > PALPATE_MESHER_COUNT_MAX ||
        reply->tet_count < 1 || reply->tet_count > PALPATE_MESHER_COUNT_MAX) {
        return pal_fail(error, PALPATE_ERROR_CLOUD, "palpate-mesher: it answers %d nodes, %d cells",
                        reply->inside_count, reply->tet_count);
    }
    return PALPATE_OK;
}

pal_status pal_mesher_converse(pal_helper *h, const pal_mesher_request *head, const double *x,
                               const int32_t *triangle, const pal_mesher_source *source,
                               const pal_progress *progress, pal_mesh_fill *out, pal_error *error) {
    size_t n = (size_t)head->vertex_count, m = (size_t)head->triangle_count;
    pal_mesher_reply reply = {0};
    const struct {
        const void *data;
        size_t size;
    } part[4] = {{head, sizeof *head},
                 {x, 3 * n * sizeof *x},
                 {triangle, 3 * m * sizeof *triangle},
                 {source, (size_t)head->source_count * sizeof *source}};
    pal_status status = PALPATE_OK;
    for (int i = 0; i < 4 && status == PALPATE_OK; i++) {
        status = pal_helper_transfer(h, part[i].data, NULL, part[i].size, progress, error);
    }
    if (status != PALPATE_OK && status != PALPATE_ERROR_TRUNCATED) {
        return status;
    } // gone: it may have answered before it left, e.g. that it is of another version
    status = pal_helper_transfer(h, NULL, &reply, sizeof reply, progress, error);
    if (status == PALPATE_OK) {
        status = check_reply(&reply, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    void *data;
    size_t coordinates = 3 * (size_t)reply.inside_count, corners = 4 * (size_t)reply.tet_count;
    status = pal_helper_receive(h, coordinates * sizeof *out->inside, progress, &data, error);
    if (status == PALPATE_OK) {
        out->inside = data;
        out->inside_count = reply.inside_count;
        status = pal_helper_receive(h, corners * sizeof *out->tet, progress, &data, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    out->tet = data;
    out->tet_count = reply.tet_count;
    for (size_t i = 0; i < coordinates; i++) {
        if (!isfinite(out->inside[i])) {
            return pal_fail(error, PALPATE_ERROR_CLOUD,
                            "palpate-mesher: node %zu of its answer is not at a finite place",
                            i / 3);
        }
    }
    for (size_t i = 0; i < corners; i++) {
        if (out->tet[i] < 0 || out->tet[i] >= head->vertex_count + out->inside_count) {
            return pal_fail(error, PALPATE_ERROR_CLOUD,
                            "palpate-mesher: cell %zu of its answer names node %d", i / 4,
                            out->tet[i]);
        }
    }
    return PALPATE_OK;
}

pal_status pal_mesher_fill(const double *x, int32_t vertex_count, const int32_t *triangle,
                           int32_t triangle_count, const pal_size_field *size,
                           const pal_progress *progress, pal_mesh_fill *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_mesher_source *source = malloc(((size_t)size->count + 1) * sizeof *source);
    if (source == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for the spacing field");
    }
    for (int32_t i = 0; i < size->count; i++) {
        const pal_size_source *s = size->source + i;
        memcpy(source[i].a, s->a, sizeof s->a);
        memcpy(source[i].b, s->b, sizeof s->b);
        source[i].radius = s->radius;
        source[i].spacing = s->spacing;
    }
    pal_mesher_request head = {.magic = PALPATE_MESHER_MAGIC,
                               .version = PALPATE_MESHER_VERSION,
                               .size = sizeof head,
                               .vertex_count = vertex_count,
                               .triangle_count = triangle_count,
                               .source_count = size->count,
                               .cap = size->cap,
                               .grading = size->grading};
    pal_helper h;
    pal_status status = pal_helper_start(&h, &mesher, -1, 0, error);
    if (status == PALPATE_OK) {
        status = pal_mesher_converse(&h, &head, x, triangle, source, progress, out, error);
        int state =
            pal_helper_finish(&h, status != PALPATE_OK && status != PALPATE_ERROR_TRUNCATED);
        if (status == PALPATE_ERROR_TRUNCATED) {
            char fate[512];
            pal_helper_fate(&h, state, fate, sizeof fate);
            status = pal_fail(error, PALPATE_ERROR_CLOUD, "%s", fate);
        }
    }
    free(source);
    if (status != PALPATE_OK) {
        pal_mesh_fill_clear(out);
    }
    return status;
}
