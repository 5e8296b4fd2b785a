/// @file fuzz_model.c  libFuzzer target: the model file, at the gate and behind it.
///
/// The input is not a file but a list of changes to a good one (built at start, so seeds are a few
/// bytes and every input reaches deep). Its first byte chooses:
///
///   0  changes to the bytes of the sealed file: {offset u24, xor u8}..., then an optional cut of
///   the
///      length. Oracle: the gate refuses whatever differs from the original.
///   1  changes to the content by means of HDF5 itself, so that HDF5 always gets a well-formed file
///   and
///      our own reader gets the nonsense: {dataset u8, action u8, argument u32, value u64}...
///      Oracle: refused with a message, or a model that passes pal_model_check, can be pressed and
///      skinned, and writes and reads back to the same bytes.
///   2  as 0, but behind the gate: only when PALPATE_FUZZ_RAW is set in the environment.
///   HDF5 1.10.8
///      is known to crash on such bytes; what it finds are HDF5's bugs, listed apart. It is why the
///      gate comes first.
///
/// Bit 7 of that byte takes the model with compressed rows.
///
/// Build: clang -g -O1 -fsanitize=fuzzer,address,undefined with libpalpate's sources.
#include <math.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/model/file_header.h"
#include "haptic/model/model.h"
#include "src/store/compress.h"
#include "tests/fuzz/h5_changes.h"
#include "tests/support/synthetic_model.h"

#include <palpate/engine.h>

int LLVMFuzzerInitialize(int *argc, char ***argv);
int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

static h5_base bases[2]; ///< stored as half rows; compressed
static int raw;          ///< behind the gate, too

static void take_base(pal_model *model, h5_base *base) {
    void *image;
    REQUIRE(pal_model_image(model, &image, &base->size, NULL) == PALPATE_OK);
    base->image = image;
    pal_model_free(model);
    h5_base_note_names(base);
}

int LLVMFuzzerInitialize(int *argc, char ***argv) {
    (void)argc;
    (void)argv;
    synthetic_params p = synthetic_default_params();
    p.n = 2;
    p.layers = 2;
    p.skin = 1;
    p.precision = PALPATE_PRECISION_HALF;
    pal_model *model = synthetic_model(&p);
    REQUIRE(model != NULL);
    model->scene_text = strdup("palpate: 1\n");
    take_base(model, &bases[0]);
    p.n = 3;
    p.precision = PALPATE_PRECISION_DOUBLE;
    p.rows = SYNTHETIC_ROWS_ALL;
    model = synthetic_model(&p);
    pal_rows rows;
    REQUIRE(model != NULL && pal_rows_compress(model, 0.05, NULL, &rows, NULL) == PALPATE_OK);
    pal_rows_take(model, &rows);
    take_base(model, &bases[1]);
    raw = getenv("PALPATE_FUZZ_RAW") != NULL;
    return 0;
}

/// A tool pressed into it: the engine takes it or says why not, and answers finite forces.
static void touch(const pal_model *model) {
    const pal_tool_def tool = {
        .name = "ball", .shape = PALPATE_SHAPE_SPHERE, .radius = 0.004, .limits = {1.0, 1.0, 1.0}};
    pal_engine_def def = pal_engine_default_def();
    def.tool_count = 1;
    def.tools = &tool;
    pal_error error = {0};
    for (int law = PALPATE_CONTACT_SURFACE; law <= PALPATE_CONTACT_NODES; law++) {
        pal_engine *engine = NULL;
        def.contact_law = (pal_contact_kind)law;
        if (pal_engine_create(model, &def, &engine, &error) != PALPATE_OK) {
            REQUIRE(engine == NULL && error.message[0] != 0);
            continue;
        }
        for (int k = 0; k < 4; k++) {
            pal_tool_state in = {.position = {0.0, 0.0, 0.004 - 0.001 * k},
                                 .orientation = {1.0, 0.0, 0.0, 0.0}};
            pal_tool_force out;
            pal_frame frame;
            (void)pal_engine_tick(engine, &in, &out);
            REQUIRE(isfinite(out.force[0] + out.force[1] + out.force[2]));
            (void)pal_engine_snapshot(pal_engine_reader(engine, 0), &frame);
        }
        pal_engine_free(engine);
    }
}

/// Use a model that was accepted, as a host would.
static void use(pal_model *model) {
    pal_error error = {0};
    REQUIRE(pal_model_check(model, &error) == PALPATE_OK);
    pal_model_info info;
    pal_model_get_info(model, &info);
    for (int32_t i = 0; i < info.patch_count; i++) {
        static const double by[3] = {1e-4, 0, -1e-3};
        pal_press press;
        (void)pal_model_press(model, pal_model_patch(model, i, NULL, NULL), by, &press, &error);
        pal_press_clear(&press);
    }
    float *rows = calloc((size_t)info.row_count * 3 + 1, sizeof *rows);
    float *skin = calloc((size_t)info.skin_count * 6 + 1, sizeof *skin);
    if (rows != NULL && skin != NULL) {
        pal_frame frame = {.row_count = info.row_count, .displacement = rows};
        REQUIRE(pal_model_skin(model, &frame, skin, skin + 3 * (size_t)info.skin_count) ==
                PALPATE_OK);
    }
    free(rows);
    free(skin);
    touch(model);
    void *image, *again;
    size_t size, again_size;
    REQUIRE(pal_model_image(model, &image, &size, &error) == PALPATE_OK);
    pal_model *second;
    REQUIRE(pal_model_parse(image, size, &second, &error) == PALPATE_OK);
    REQUIRE(pal_model_image(second, &again, &again_size, &error) == PALPATE_OK);
    REQUIRE(size == again_size && memcmp(image, again, size) == 0);
    pal_model_free(second);
    free(image);
    free(again);
}

static void parse(const void *image, size_t size) {
    pal_error error = {0};
    pal_model *model;
    pal_status status = pal_model_parse(image, size, &model, &error);
    if (status == PALPATE_OK) {
        use(model);
        pal_model_free(model);
    } else {
        REQUIRE(model == NULL &&
                (status == PALPATE_ERROR_FORMAT || status == PALPATE_ERROR_MEMORY));
        REQUIRE(error.message[0] != 0);
    }
}

// ---- Modes 0 and 2: bytes
// -------------------------------------------------------------------------

static void change_bytes(const h5_base *base, const uint8_t *data, size_t size,
                         int behind_the_gate) {
    uint8_t *image = malloc(base->size + 256);
    REQUIRE(image != NULL);
    memcpy(image, base->image, base->size);
    memset(image + base->size, 0, 256);
    size_t length = base->size;
    while (size >= 4) {
        uint64_t at = h5_take(&data, &size, 3);
        image[at % base->size] ^= (uint8_t)h5_take(&data, &size, 1);
    }
    if (size >= 2) {
        length = (size_t)(h5_take(&data, &size, 2) * base->size / 65000); // may also grow a little
        length = length > base->size + 256 ? base->size + 256 : length;
    }
    uint8_t *exact = malloc(length + 1); // so that reading beyond the end is seen
    REQUIRE(exact != NULL);
    memcpy(exact, image, length);
    if (behind_the_gate) {
        parse(exact, length);
    } else {
        pal_error error = {0};
        pal_status status = pal_file_verify(PALPATE_FILE_MODEL, PALPATE_MODEL_VERSION, exact,
                                            length, "fuzzed", &error);
        int same = length == base->size && memcmp(image, base->image, length) == 0;
        REQUIRE((status == PALPATE_OK) == same);
        REQUIRE(same || error.message[0] != 0);
    }
    free(exact);
    free(image);
}

static void change_content(const h5_base *base, const uint8_t *data, size_t size) {
    size_t length;
    uint8_t *image = h5_changed(base, data, size, &length);
    parse(image, length);
    free(image);
}

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    if (size < 1) {
        return 0;
    }
    const h5_base *base = &bases[data[0] >> 7];
    switch ((data[0] & 127) % 3) {
    case 0:
        change_bytes(base, data + 1, size - 1, 0);
        break;
    case 1:
        change_content(base, data + 1, size - 1);
        break;
    default:
        if (raw) {
            change_bytes(base, data + 1, size - 1, 1);
        }
    }
    return 0;
}
