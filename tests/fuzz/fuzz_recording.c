/// @file fuzz_recording.c  libFuzzer target: the raw recording reader, in front of and behind its
/// checksums.
///
/// Input: one byte of mode, then a tick file. Mode bit 0: the header's checksum is made right
/// first; bit 1: each item's too, so that the reader gets nonsense that looks intact. Oracle:
/// refused with a message, or what is read ends and its counts add up to the items in the file.
#include <stdint.h>
#include <string.h>

#include "haptic/recording/recording_read.h"
#include "tests/fuzz/scratch.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static void seal(uint8_t *file, size_t size, int items) {
    if (size >= sizeof(pal_ticks_header) + 8) {
        uint64_t check =
            pal_item_check(file, sizeof(pal_ticks_header), (uint64_t)PALPATE_HEADER_NUMBER);
        memcpy(file + sizeof(pal_ticks_header), &check, sizeof check);
    }
    size_t item = sizeof(pal_tick_item);
    for (size_t at = PALPATE_TICKS_HEADER, n = 0; items && at + item <= size; at += item, n++) {
        uint64_t check = pal_item_check(file + at, item - 8, n);
        memcpy(file + at + item - 8, &check, sizeof check);
    }
}

/// A file that short has its header grown, so that a few bytes reach the items.
static uint8_t *grow(const uint8_t *data, size_t size, size_t *grown) {
    size_t head = sizeof(pal_ticks_header);
    size_t front = size < 64 ? size : 64; // changes to the header's first fields, by exclusive or
    *grown = PALPATE_TICKS_HEADER + (size - front);
    uint8_t *file = calloc(1, *grown + 1);
    if (file == NULL) {
        abort();
    }
    pal_ticks_header h;
    memset(&h, 0, head);
    memcpy(h.magic, PALPATE_TICKS_MAGIC, sizeof h.magic);
    h.endian = PALPATE_RECORDING_ENDIAN;
    h.version = PALPATE_RECORDING_VERSION;
    h.header_bytes = PALPATE_TICKS_HEADER;
    h.item_bytes = sizeof(pal_tick_item);
    h.tool_bytes = sizeof(pal_tool_def);
    h.tool_count = 1;
    h.max_contacts = 32;
    h.period_ns = 1000000;
    memcpy(file, &h, head);
    for (size_t i = 0; i < front; i++) {
        file[i] ^= data[i];
    }
    memcpy(file + PALPATE_TICKS_HEADER, data + front, size - front);
    return file;
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 1) {
        return 0;
    }
    size_t grown = 0;
    uint8_t *file = grow(data + 1, size - 1, &grown);
    if (data[0] & 1) {
        seal(file, grown, (data[0] & 2) != 0);
    }
    char path[SCRATCH_PATH];
    scratch_path(".ticks", path);
    scratch_write(path, file, grown);
    pal_ticks_header header;
    pal_raw_reader reader = {.fd = -1};
    pal_error error = {0};
    if (pal_raw_open_ticks(path, &header, &reader, &error) != PALPATE_OK) {
        if (error.message[0] == 0) {
            abort();
        }
    } else {
        pal_tick_record row[16];
        int64_t n = 1;
        uint64_t good = 0;
        while (n > 0) {
            if (pal_raw_read(&reader, row, 16, &n, &error) != PALPATE_OK) {
                abort();
            }
            good += (uint64_t)n;
        }
        if (good + reader.bad != reader.items + reader.tail) {
            abort();
        }
        pal_raw_close(&reader);
    }
    (void)unlink(path);
    free(file);
    return 0;
}
