/// @file fuzz_frames.c  libFuzzer target: raw recordings (.ticks and .frames) read and made into
/// the finished file.
///
/// Input: a byte of mode; two bytes, the length of the tick items; then 64 bytes that change the
/// frame header's first fields (exclusive or), the items of the tick file (pressed together: 16
/// bytes of input become one item), the rest of the frame file. Mode bit 0: the headers' checksums
/// are made right; bit 1: the surface's and the items' too; bit 5: the frame file is only read.
/// Oracle: refused with a message, or counts that add up; what `recover` makes of them opens and
/// has as many rows.
#include <stdint.h>
#include <string.h>

#include "haptic/recording/recording_read.h"
#include "haptic/recording/replay.h"
#include "tests/fuzz/scratch.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void seal(uint8_t *at, size_t size, uint64_t number) {
    uint64_t check = pal_item_check(at, size, number);
    memcpy(at + size, &check, sizeof check);
}

static void write_ticks(const char *path, const uint8_t *data, size_t size, int mode) {
    size_t items = size / 16, item = sizeof(pal_tick_item);
    uint8_t *file = calloc(1, PALPATE_TICKS_HEADER + items * item + 16);
    pal_ticks_header h;
    if (file == NULL) {
        abort();
    }
    memset(&h, 0, sizeof h);
    memcpy(h.magic, PALPATE_TICKS_MAGIC, sizeof h.magic);
    h.endian = PALPATE_RECORDING_ENDIAN;
    h.version = PALPATE_RECORDING_VERSION;
    h.header_bytes = PALPATE_TICKS_HEADER;
    h.item_bytes = sizeof(pal_tick_item);
    h.tool_bytes = sizeof(pal_tool_def);
    h.tool_count = 1;
    h.max_contacts = 32;
    h.period_ns = 1000000;
    h.period = 1e-3;
    memcpy(file, &h, sizeof h);
    seal(file, sizeof h, (uint64_t)PALPATE_HEADER_NUMBER);
    for (size_t i = 0; i < items; i++) {
        uint8_t *to = file + PALPATE_TICKS_HEADER + i * item;
        memcpy(to + 14 * (data[16 * i] % 16), data + 16 * i + 1, 15);
        seal(to, item - 8, i + (mode & 4 ? 1 : 0)); // bit 2: items that are out of place
    }
    size_t tail = size % 16; // the file may end inside an item
    memcpy(file + PALPATE_TICKS_HEADER + items * item, data + 16 * items, tail);
    scratch_write(path, file, PALPATE_TICKS_HEADER + items * item + tail);
    free(file);
}

static void write_frames(const char *path, const uint8_t *data, size_t size, int mode) {
    size_t front = size < 64 ? size : 64, rest = size - front;
    uint8_t *file = calloc(1, PALPATE_FRAMES_HEADER + rest + 8);
    pal_frames_header h;
    if (file == NULL) {
        abort();
    }
    memset(&h, 0, sizeof h);
    memcpy(h.magic, PALPATE_FRAMES_MAGIC, sizeof h.magic);
    h.endian = PALPATE_RECORDING_ENDIAN;
    h.version = PALPATE_RECORDING_VERSION;
    h.header_bytes = PALPATE_FRAMES_HEADER;
    h.row_count = 3;
    h.triangle_count = 1;
    h.tool_count = 1;
    h.item_bytes = pal_frames_item_bytes(3);
    h.rate = 30.0;
    for (size_t i = 0; i < front; i++) {
        ((uint8_t *)&h)[i] ^= data[i];
    }
    if (mode & 8) { // a header that agrees with itself
        h.item_bytes =
            pal_frames_item_bytes(h.row_count > 0 && h.row_count < 1 << 20 ? h.row_count : 3);
    }
    memcpy(file, &h, sizeof h);
    memcpy(file + PALPATE_FRAMES_HEADER, data + front, rest);
    if (mode & 1) {
        seal(file, sizeof h, (uint64_t)PALPATE_HEADER_NUMBER);
    }
    if ((mode & 2) && h.row_count >= 0 && h.row_count < 1 << 20 && h.triangle_count >= 0 &&
        h.triangle_count < 1 << 20) {
        size_t surface = (size_t)pal_frames_static_bytes(h.row_count, h.triangle_count);
        size_t item = (size_t)pal_frames_item_bytes(h.row_count), n = 0;
        if (surface + 8 <= rest) {
            seal(file + PALPATE_FRAMES_HEADER, surface, (uint64_t)PALPATE_STATIC_NUMBER);
        }
        for (size_t at = surface + 8; at + item <= rest; at += item, n++) {
            seal(file + PALPATE_FRAMES_HEADER + at, item - 8, n);
        }
    }
    scratch_write(path, file, PALPATE_FRAMES_HEADER + rest);
    free(file);
}

static void read_frames(const char *path) {
    pal_frames_header header;
    pal_raw_reader reader = {.fd = -1};
    pal_error error = {0};
    char *surface = NULL;
    if (pal_raw_open_frames(path, &header, &surface, &reader, &error) != PALPATE_OK) {
        if (error.message[0] == 0 || surface != NULL) {
            abort();
        }
        return;
    }
    uint64_t good = 0;
    int64_t n = 1;
    char *item = malloc(4 * (size_t)reader.item_size);
    while (item != NULL && n > 0) {
        if (pal_raw_read(&reader, item, 4, &n, &error) != PALPATE_OK) {
            abort();
        }
        good += (uint64_t)n;
    }
    if (item == NULL || good + reader.bad != reader.items + reader.tail) {
        abort();
    }
    free(item);
    free(surface);
    pal_raw_close(&reader);
}

static void recover(const char *path) {
    pal_recording_summary summary;
    pal_error error = {0};
    if (pal_recording_convert(path, &summary, &error) != PALPATE_OK) {
        if (error.message[0] == 0) {
            abort();
        }
        return;
    }
    pal_recording *recording = NULL;
    if (pal_recording_open(path, &recording, &error) != PALPATE_OK) {
        (void)fprintf(stderr, "%s\n", error.message);
        abort();
    }
    const pal_recording_info *info = pal_recording_get_info(recording);
    if (info->records != (int64_t)summary.records) {
        abort();
    }
    pal_tick_record row;
    for (int64_t i = 0; i < info->records; i++) {
        if (pal_recording_rows(recording, i, 1, &row, &error) != PALPATE_OK &&
            error.message[0] == 0) {
            abort();
        }
    }
    pal_recording_close(recording);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 3) {
        return 0;
    }
    char path[SCRATCH_PATH], ticks[SCRATCH_PATH], frames[SCRATCH_PATH], xdmf[SCRATCH_PATH];
    scratch_path(".h5", path);
    scratch_path(".h5.ticks", ticks);
    scratch_path(".h5.frames", frames);
    scratch_path(".xdmf", xdmf);
    size_t tick_bytes = ((size_t)data[1] | (size_t)data[2] << 8) & 1023;
    tick_bytes = tick_bytes < size - 3 ? tick_bytes : size - 3;
    write_ticks(ticks, data + 3, tick_bytes, data[0]);
    write_frames(frames, data + 3 + tick_bytes, size - 3 - tick_bytes, data[0]);
    read_frames(frames);
    if (!(data[0] & 32)) { // HDF5 and fsync take most of the time
        recover(path);
    }
    (void)unlink(path);
    (void)unlink(ticks);
    (void)unlink(frames);
    (void)unlink(xdmf);
    return 0;
}
