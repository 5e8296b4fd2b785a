/// Raw recordings as they are met: a ring that wrapped inside a tick, headers that are whole by
/// their checksum and nonsense by their content, surfaces damaged or cut, disks that refuse; and
/// the companion that ParaView opens, under a name that XML must escape.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "haptic/recording/recording.h"
#include "haptic/recording/recording_read.h"
#include "haptic/recording/xdmf.h"
#include "haptic/session/dump.h"
#include "tests/support/synthetic_model.h"

static char folder[64], path[128], ticks[160], frames[160];

static int set_up(void **state) {
    (void)state;
    (void)snprintf(folder, sizeof folder, "/tmp/palpate-raw-XXXXXX");
    if (mkdtemp(folder) == NULL) {
        return 1;
    }
    (void)snprintf(path, sizeof path, "%s/run.h5", folder);
    (void)snprintf(ticks, sizeof ticks, "%s.ticks", path);
    (void)snprintf(frames, sizeof frames, "%s.frames", path);
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    return rmdir(folder); // fails when anything was left behind
}

static pal_ticks_header header_of(int tools) {
    synthetic_params p = synthetic_default_params();
    p.n = 3;
    pal_model *model = synthetic_model(&p);
    assert_non_null(model);
    pal_tool_def tool[PALPATE_TOOLS_MAX];
    for (int i = 0; i < tools; i++) {
        tool[i] = pal_model_runtime(model)->tools[0];
    }
    pal_session_def def = pal_session_default_def();
    def.engine.tool_count = tools;
    def.engine.tools = tool;
    pal_ticks_header header;
    memset(&header, 0, sizeof header);
    pal_ticks_header_fill(&header, model, &def);
    pal_model_free(model);
    return header;
}

// ---- Dumps --------------------------------------------------------------------------------------

/// Dump a ring of `capacity` after `pushed` records of `tools` tools; what is in the file then.
static int64_t dump(int capacity, int pushed, int tools, pal_tick_record *out) {
    pal_ring ring;
    pal_tick_record room[16], record;
    pal_error error = {0};
    pal_ticks_header header = header_of(tools);
    assert_int_equal(pal_ring_init(&ring, capacity), PALPATE_OK);
    for (int k = 0; k < pushed; k++) {
        memset(&record, 0, sizeof record);
        record.tick = (uint64_t)(k / tools);
        record.tool = k % tools;
        pal_ring_push(&ring, &record);
    }
    if (pal_dump_ring(&ring, &header, path, room, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    pal_ring_clear(&ring);
    pal_raw_reader reader;
    int64_t count = 0;
    assert_int_equal(pal_raw_open_ticks(ticks, &header, &reader, &error), PALPATE_OK);
    if (reader.items > 0) {
        assert_int_equal(pal_raw_read(&reader, out, 16, &count, &error), PALPATE_OK);
    }
    assert_int_equal(count, reader.items);
    assert_int_equal(reader.bad, 0);
    pal_raw_close(&reader);
    assert_int_equal(unlink(ticks), 0);
    return count;
}

static void a_dump_holds_whole_ticks_only(void **state) {
    (void)state;
    pal_tick_record out[16];
    // 7 records of 3 tools end inside tick 2; a ring of 5 then begins inside tick 0
    assert_int_equal(dump(5, 7, 3, out), 3);
    for (int i = 0; i < 3; i++) {
        assert_int_equal(out[i].tick, 1);
        assert_int_equal(out[i].tool, i);
    }
    assert_int_equal(dump(8, 8, 2, out), 8); // nothing torn: all of it
    assert_int_equal(dump(3, 7, 3, out), 0); // no whole tick
    assert_int_equal(dump(4, 0, 1, out), 0);
}

static void a_dump_never_replaces_and_says_why_it_cannot_be(void **state) {
    (void)state;
    pal_ring ring;
    pal_tick_record room[4];
    pal_ticks_header header = header_of(1);
    pal_error error = {0};
    char name[PALPATE_RECORDING_PATH];
    assert_int_equal(pal_ring_init(&ring, 4), PALPATE_OK);
    assert_int_equal(pal_dump_ring(&ring, &header, path, room, &error), PALPATE_OK);
    assert_int_equal(pal_dump_ring(&ring, &header, path, room, &error), PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, ticks));
    assert_int_equal(unlink(ticks), 0);
    // every write to it is refused: nothing is left, and the disk's reason is told
    int full = open("/dev/full", O_WRONLY | O_CLOEXEC);
    assert_true(full >= 0);
    pal_item_file file = {.fd = full};
    const pal_tick_item item = {.check = 1};
    pal_item_append(&file, &item, sizeof item, 1);
    pal_item_append(&file, &item, sizeof item, 2);
    assert_int_equal(file.items, 0);
    assert_int_equal(file.lost, 3);
    assert_int_equal(file.first_errno, ENOSPC);
    (void)close(full);
    // names: numbered before the extension, refused when there is no room for the longest
    assert_true(pal_dump_name("a.b/run", 2, name));
    assert_string_equal(name, "a.b/run-2");
    assert_true(pal_dump_name("a.b/run.h5", 12, name));
    assert_string_equal(name, "a.b/run-12.h5");
    char longest[PALPATE_RECORDING_PATH];
    memset(longest, 'x', sizeof longest - 1);
    longest[sizeof longest - 1] = '\0';
    pal_dumper dumper = {.ring = &ring, .header = &header};
    assert_int_equal(pal_dumper_init(&dumper, longest, &error), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "too long"));
    assert_int_equal(pal_dumper_init(&dumper, "", &error), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "empty"));
    pal_ring_clear(&ring);
}

// ---- Headers that lie ---------------------------------------------------------------------------

/// A header sealed as the writer does it, padded to `size`.
static void put(const char *name, const void *header, size_t bytes, size_t size, const void *rest,
                size_t more) {
    static char block[PALPATE_TICKS_HEADER];
    memset(block, 0, sizeof block);
    memcpy(block, header, bytes);
    uint64_t check = pal_item_check(header, bytes, (uint64_t)PALPATE_HEADER_NUMBER);
    memcpy(block + bytes, &check, sizeof check);
    FILE *f = fopen(name, "w");
    assert_non_null(f);
    assert_int_equal(fwrite(block, 1, size, f), size);
    assert_int_equal(more > 0 ? fwrite(rest, 1, more, f) : 0, more);
    assert_int_equal(fclose(f), 0);
}

static void ticks_headers_that_lie_are_refused(void **state) {
    (void)state;
    pal_ticks_header sound = header_of(2), got;
    memcpy(sound.magic, PALPATE_TICKS_MAGIC, 8);
    sound.endian = PALPATE_RECORDING_ENDIAN;
    sound.version = PALPATE_RECORDING_VERSION;
    sound.header_bytes = PALPATE_TICKS_HEADER;
    sound.item_bytes = sizeof(pal_tick_item);
    sound.tool_bytes = sizeof(pal_tool_def);
    for (int k = 0; k < 8; k++) {
        pal_ticks_header h = sound;
        pal_raw_reader reader;
        pal_error error = {0};
        h.header_bytes += k == 1;
        h.item_bytes -= k == 2;
        h.tool_bytes += k == 3;
        h.tool_count = k == 4 ? 0 : k == 5 ? PALPATE_TOOLS_MAX + 1 : h.tool_count;
        h.period_ns = k == 6 ? 0 : h.period_ns;
        h.version += k == 7;
        put(ticks, &h, sizeof h, PALPATE_TICKS_HEADER, NULL, 0);
        pal_status status = pal_raw_open_ticks(ticks, &got, &reader, &error);
        assert_int_equal(status, k == 0   ? PALPATE_OK
                                 : k == 7 ? PALPATE_ERROR_VERSION
                                          : PALPATE_ERROR_FORMAT);
        assert_true(k == 0 || strstr(error.message, ticks) != NULL);
        pal_raw_close(&reader);
    }
    assert_int_equal(unlink(ticks), 0);
}

static void frames_that_lie_are_refused(void **state) {
    (void)state;
    enum { ROWS = 3, TRIANGLES = 1 };
    struct {
        double x[ROWS][3];
        int32_t corner[3], pad;
        uint64_t check;
    } sound = {{{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, {0, 1, 2}, 0, 0};
    const size_t bytes = offsetof(__typeof__(sound), check);
    assert_int_equal(bytes, pal_frames_static_bytes(ROWS, TRIANGLES));
    static const struct {
        const char *what;
        pal_status status;
    } cases[] = {
        {"sound", PALPATE_OK},
        {"rows below 0", PALPATE_ERROR_FORMAT},
        {"more rows than a model can have", PALPATE_ERROR_FORMAT},
        {"triangles below 0", PALPATE_ERROR_FORMAT},
        {"no tool", PALPATE_ERROR_FORMAT},
        {"items of another size", PALPATE_ERROR_FORMAT},
        {"ends inside its surface", PALPATE_ERROR_TRUNCATED},
        {"a bit of it turned", PALPATE_ERROR_CHECKSUM},
        {"a corner beyond the rows, sealed", PALPATE_ERROR_CHECKSUM},
        {"a position that is no number, sealed", PALPATE_ERROR_CHECKSUM},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        pal_frames_header h = {.endian = PALPATE_RECORDING_ENDIAN,
                               .version = PALPATE_RECORDING_VERSION,
                               .header_bytes = PALPATE_FRAMES_HEADER,
                               .item_bytes = pal_frames_item_bytes(ROWS),
                               .row_count = k == 1   ? -1
                                            : k == 2 ? INT32_MAX / 2
                                                     : ROWS,
                               .triangle_count = k == 3 ? -1 : TRIANGLES,
                               .tool_count = k == 4 ? 0 : 1,
                               .rate = 30};
        memcpy(h.magic, PALPATE_FRAMES_MAGIC, 8);
        h.item_bytes += k == 5 ? 8 : 0;
        __typeof__(sound) s = sound;
        s.corner[2] = k == 8 ? ROWS : s.corner[2];
        s.x[1][1] = k == 9 ? (double)NAN : s.x[1][1];
        s.check = pal_item_check(&s, bytes, (uint64_t)PALPATE_STATIC_NUMBER);
        s.x[2][0] = k == 7 ? 1e-300 : s.x[2][0];
        put(frames, &h, sizeof h, PALPATE_FRAMES_HEADER, &s, k == 6 ? bytes : sizeof s);
        char *surface = NULL;
        pal_raw_reader reader;
        pal_error error = {0};
        pal_status status = pal_raw_open_frames(frames, &h, &surface, &reader, &error);
        if (status != cases[k].status || (status == PALPATE_OK) != (surface != NULL) ||
            (status != PALPATE_OK && strstr(error.message, frames) == NULL)) {
            fail_msg("%s: %s: %s", cases[k].what, pal_status_name(status), error.message);
        }
        free(surface);
        pal_raw_close(&reader);
    }
    assert_int_equal(unlink(frames), 0);
}

// ---- The companion ------------------------------------------------------------------------------

static void the_companion_escapes_and_replaces_whole(void **state) {
    (void)state;
    const double time[2] = {0, 0.5}, position[6] = {1, 2, 3, 4, 5, 6}, force[6] = {0};
    const pal_xdmf_series series = {.h5_path = "/x/a<b>&\"c\".h5",
                                    .frames = 2,
                                    .time = time,
                                    .tool_position = position,
                                    .tool_force = force,
                                    .rows = 3,
                                    .triangles = 1,
                                    .tools = 1};
    char name[160], text[8192], part[176];
    pal_error error = {0};
    (void)snprintf(name, sizeof name, "%s/run.xdmf", folder);
    assert_int_equal(pal_xdmf_write(name, &series, &error), PALPATE_OK);
    FILE *f = fopen(name, "r");
    assert_non_null(f);
    text[fread(text, 1, sizeof text - 1, f)] = '\0';
    assert_int_equal(fclose(f), 0);
    assert_non_null(strstr(text, "a&lt;b&gt;&amp;&quot;c&quot;.h5:/frames/position/000001"));
    assert_null(strstr(text, "a<b"));
    assert_null(strstr(text, "/x/")); // both files move together
    assert_non_null(strstr(text, "<Time Value=\"0.5\"/>"));
    assert_int_equal(unlink(name), 0);
    // a folder that is not there; a folder in its place: told, and nothing left
    (void)snprintf(part, sizeof part, "%s/none/run.xdmf", folder);
    assert_int_equal(pal_xdmf_write(part, &series, &error), PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, part));
    assert_int_equal(mkdir(name, 0700), 0);
    assert_int_equal(pal_xdmf_write(name, &series, &error), PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, name));
    assert_int_equal(rmdir(name), 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_dump_holds_whole_ticks_only),
        cmocka_unit_test(a_dump_never_replaces_and_says_why_it_cannot_be),
        cmocka_unit_test(ticks_headers_that_lie_are_refused),
        cmocka_unit_test(frames_that_lie_are_refused),
        cmocka_unit_test(the_companion_escapes_and_replaces_whole),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
