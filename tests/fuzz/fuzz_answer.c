/// @file fuzz_answer.c  libFuzzer target: what the helper processes answer, and what is made of it.
///
/// Input: a byte of mode, 5 bytes that a good reply's head is changed by (field and exclusive or),
/// then the arrays that follow it. Mode bit 0: palpate-mesher, else palpate-reader; bit 1: the head
/// comes from the input as it is. Oracle: refused with a message, cut short, or an answer whose
/// indices exist and whose numbers are finite; a surface is then welded and checked.
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

#include "src/cloud/mesher_client.h"
#include "src/geometry/reader_client.h"
#include "tests/fuzz/soup.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static const pal_helper_kind nobody = {"palpate-nobody", "PALPATE_NOBODY"};

/// A helper whose whole answer is in the channel already.
static pal_helper prepare(const void *answer, size_t size, int *peer) {
    int pair[2];
    if (socketpair(AF_UNIX, SOCK_STREAM, 0, pair) != 0 ||
        send(pair[1], answer, size, MSG_NOSIGNAL) != (ssize_t)size ||
        shutdown(pair[1], SHUT_WR) != 0) {
        abort();
    }
    *peer = pair[1];
    return (pal_helper){
        .kind = &nobody, .child = -1, .channel = pair[0], .log = -1, .deadline_ns = INT64_MAX};
}

static void judge(pal_status status, const pal_error *error) {
    if (status != PALPATE_OK && status != PALPATE_ERROR_TRUNCATED && error->message[0] == 0) {
        abort();
    }
}

static void read_surface(pal_helper *h) {
    const pal_reader_request request = {.magic = PALPATE_READER_MAGIC, .file_bytes = 4096};
    pal_surface s = {0};
    pal_error error = {0};
    pal_status status = pal_reader_converse(h, &request, &s, &error);
    judge(status, &error);
    if (status == PALPATE_OK) {
        status = pal_surface_weld(&s, &error);
        judge(status, &error);
        soup_check(&s);
    }
    pal_surface_clear(&s);
}

static void fill_surface(pal_helper *h) {
    static const double x[12] = {0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0, 1};
    static const int32_t v[12] = {0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3};
    const pal_mesher_request head = {
        .magic = PALPATE_MESHER_MAGIC, .vertex_count = 4, .triangle_count = 4};
    pal_mesh_fill fill = {0};
    pal_error error = {0};
    pal_status status = pal_mesher_converse(h, &head, x, v, NULL, NULL, &fill, &error);
    judge(status, &error);
    for (int64_t i = 0; status == PALPATE_OK && i < 3 * (int64_t)fill.inside_count; i++) {
        if (!isfinite(fill.inside[i])) {
            abort();
        }
    }
    for (int64_t i = 0; status == PALPATE_OK && i < 4 * (int64_t)fill.tet_count; i++) {
        if (fill.tet[i] < 0 || fill.tet[i] >= 4 + fill.inside_count) {
            abort();
        }
    }
    pal_mesh_fill_clear(&fill);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 6) {
        return 0;
    }
    int mesher = data[0] & 1, raw = data[0] & 2;
    union {
        pal_reader_reply reader;
        pal_mesher_reply mesher;
        uint8_t byte[40]; // the bytes that are changed
    } head;
    memset(&head, 0, sizeof head);
    size_t head_size = mesher ? sizeof head.mesher : sizeof head.reader, rest = size - 6;
    if (mesher) {
        head.mesher = (pal_mesher_reply){.magic = PALPATE_MESHER_MAGIC,
                                         .version = PALPATE_MESHER_VERSION,
                                         .size = sizeof head.mesher,
                                         .inside_count = data[1] % 16,
                                         .tet_count = data[2] % 64};
    } else {
        head.reader = (pal_reader_reply){.magic = PALPATE_READER_MAGIC,
                                         .version = PALPATE_READER_VERSION,
                                         .size = sizeof head.reader,
                                         .vertex_count = data[1],
                                         .triangle_count = data[2]};
    }
    head.byte[data[3] % sizeof head.byte] ^= data[4]; // 0 changes nothing
    uint8_t *answer = malloc(head_size + rest);
    if (answer == NULL) {
        abort();
    }
    memcpy(answer, &head, head_size);
    memcpy(answer + head_size, data + 6, rest);
    int peer;
    pal_helper h = raw ? prepare(data + 6, rest, &peer) : prepare(answer, head_size + rest, &peer);
    if (mesher) {
        fill_surface(&h);
    } else {
        read_surface(&h);
    }
    (void)pal_helper_finish(&h, 0);
    (void)close(peer);
    free(answer);
    return 0;
}
