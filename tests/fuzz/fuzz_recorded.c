/// @file fuzz_recorded.c  libFuzzer target: the finished recording (HDF5), at the gate and behind
/// it.
///
/// The input is a list of changes to a good recording, built at start. Its first byte chooses:
///   0  changes to the sealed file's bytes, {offset u24, xor u8}...: the gate refuses what differs
///   1  changes to the content by HDF5 itself (h5_changes.h), sealed anew. Oracle: refused with a
///      message, or rows that can be read, whose replay on a model ends in a report or a message.
#include <math.h>
#include <string.h>

#include "haptic/model/file_header.h"
#include "haptic/recording/recording_read.h"
#include "haptic/recording/replay.h"
#include "tests/fuzz/h5_changes.h"
#include "tests/fuzz/scratch.h"
#include "tests/support/synthetic_model.h"

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static h5_base base;
static pal_model *model;
static char path[SCRATCH_PATH];

enum { TICKS = 40 };

/// A raw recording of a press, made into the finished one.
static void make_recording(void) {
    char ticks[SCRATCH_PATH];
    pal_ticks_header h;
    pal_item_file file = {.fd = -1};
    scratch_path(".h5", path);
    scratch_path(".h5.ticks", ticks);
    (void)unlink(ticks);
    (void)unlink(path);
    memset(&h, 0, sizeof h);
    pal_session_def def = pal_session_default_def();
    pal_tool_def tool = pal_model_runtime(model)->tools[0];
    def.engine.tools = &tool;
    def.engine.tool_count = 1;
    pal_ticks_header_fill(&h, model, &def);
    REQUIRE(pal_ticks_create(ticks, &h, &file, NULL) == PALPATE_OK);
    for (uint64_t i = 0; i < TICKS; i++) {
        pal_tick_item item;
        memset(&item, 0, sizeof item);
        item.record.tick = i;
        item.record.time_ns = (int64_t)i * 1000000;
        item.record.state.position[2] = 0.004 - 1e-4 * (double)i;
        item.record.state.orientation[0] = 1.0;
        item.check = pal_item_check(&item.record, sizeof item.record, i);
        pal_item_append(&file, &item, sizeof item, 1);
    }
    REQUIRE(pal_ticks_finish(&file, &h) == 0);
    (void)close(file.fd);
    REQUIRE(pal_recording_convert(path, NULL, NULL) == PALPATE_OK);
    FILE *in = fopen(path, "rbe");
    REQUIRE(in != NULL && fseek(in, 0, SEEK_END) == 0);
    base.size = (size_t)ftell(in);
    base.image = malloc(base.size);
    rewind(in);
    REQUIRE(base.image != NULL && fread(base.image, 1, base.size, in) == base.size);
    (void)fclose(in);
}

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc;
    (void)argv;
    synthetic_params p = synthetic_default_params();
    p.n = 3;
    p.layers = 2;
    model = synthetic_model(&p);
    REQUIRE(model != NULL);
    make_recording();
    h5_base_note_names(&base);
    return 0;
}

static void read_all(pal_recording *recording) {
    pal_error error = {0};
    const pal_recording_info *info = pal_recording_get_info(recording);
    pal_tick_record row[16];
    int64_t count = info->records < 16 ? info->records : 16;
    REQUIRE(info->records >= 0);
    REQUIRE(pal_recording_rows(recording, info->records - count, count, row, &error) ==
                PALPATE_OK ||
            error.message[0] != 0);
    pal_replay_report report;
    error = (pal_error){0};
    if (pal_replay(recording, model, 1000, &report, &error) == PALPATE_OK) {
        REQUIRE(report.differences <= report.records && report.ticks <= 1000);
    } else {
        REQUIRE(error.message[0] != 0);
    }
}

static void open_changed(const uint8_t *image, size_t size, int must_fail) {
    pal_error error = {0};
    pal_recording *recording = NULL;
    scratch_write(path, image, size);
    pal_status status = pal_recording_open(path, &recording, &error);
    if (status == PALPATE_OK) {
        REQUIRE(!must_fail);
        read_all(recording);
        pal_recording_close(recording);
    } else {
        REQUIRE(recording == NULL && error.message[0] != 0);
    }
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 1) {
        return 0;
    }
    size_t length = base.size;
    uint8_t *image;
    if (data[0] & 1) {
        image = h5_changed(&base, data + 1, size - 1, &length);
        memset(image, 0, PALPATE_HEADER_BYTES);
        REQUIRE(pal_file_seal(PALPATE_FILE_RECORDING, PALPATE_RECORDING_VERSION, image, length) ==
                PALPATE_OK);
        open_changed(image, length, 0);
    } else {
        data++;
        size--;
        image = malloc(length);
        REQUIRE(image != NULL);
        memcpy(image, base.image, length);
        while (size >= 4) {
            uint64_t at = h5_take(&data, &size, 3);
            image[at % length] ^= (uint8_t)h5_take(&data, &size, 1);
        }
        open_changed(image, length, memcmp(image, base.image, length) != 0);
    }
    free(image);
    return 0;
}
