/// Recordings: what was felt is what is read back, after a kill, a full disk or damage as well.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <errno.h>
#include <fcntl.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/session.h>

#include "haptic/model/h5.h"
#include "haptic/recording/recording.h"
#include "tests/support/synthetic_model.h"

static pal_model *model;
static pal_tool_def tool;
static char folder[64];

static int set_up(void **state) {
    (void)state;
    (void)snprintf(folder, sizeof folder, "/tmp/palpate-record-XXXXXX");
    synthetic_params p = synthetic_default_params();
    model = synthetic_model(&p);
    if (model == NULL || mkdtemp(folder) == NULL) {
        return 1;
    }
    tool = pal_model_runtime(model)->tools[0];
    tool.device.kind = PALPATE_DEVICE_SCRIPTED;
    tool.device.stroke = (pal_stroke){.kind = PALPATE_STROKE_PALPATION,
                                      .depth = 0.003,
                                      .ramp = 0.1,
                                      .period = 0.5,
                                      .tremor_amplitude = 1e-4,
                                      .tremor_frequency = 10};
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[128];
    pal_model_free(model);
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command);
}

static const char *in_folder(const char *name, char out[256]) {
    (void)snprintf(out, 256, "%s/%s", folder, name);
    return out;
}

static int exists(const char *path, const char *suffix) {
    char name[512];
    (void)snprintf(name, sizeof name, "%s%s", path, suffix);
    return access(name, F_OK) == 0;
}

static pal_session *make_session(const char *path, double duration, int freewheel, pal_error *e) {
    pal_session_def def = pal_session_default_def();
    pal_session *session = NULL;
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.duration = duration;
    def.freewheel = freewheel;
    def.realtime = 0;
    def.record_path = path;
    def.ring_ticks = 4096;
    if (pal_device_create(&tool, 1e-3, &def.devices[0], e) != PALPATE_OK) {
        return NULL;
    }
    if (pal_session_create(model, &def, &session, e) != PALPATE_OK) {
        def.devices[0].close(def.devices[0].self); // still ours
    }
    return session;
}

// ---- Reading back
// --------------------------------------------------------------------------------

static pal_h5 *open_h5(const char *path) {
    pal_h5 *file = NULL;
    pal_error e = {0};
    if (pal_h5_open_file(path, &file, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    return file;
}

static void read_all(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                     const int64_t dims[], void *out) {
    pal_error e = {0};
    if (pal_h5_read(file, path, type, rank, dims, out, &e) != PALPATE_OK) {
        fail_msg("%s: %s", path, e.message);
    }
}

static int64_t record_count(pal_h5 *file) {
    int64_t n = 0;
    pal_error e = {0};
    if (pal_h5_dims(file, "/ticks/tick", PALPATE_H5_U64, 1, &n, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    return n;
}

static int64_t whole(pal_h5 *file, const char *path) {
    int64_t value = -1;
    read_all(file, path, PALPATE_H5_I64, 0, NULL, &value);
    return value;
}

enum { MOST = 4096 };
static uint64_t tick[MOST];
static int64_t when[MOST];
static double position[MOST][3], force[MOST][3], depth[MOST];

/// Read the first columns of a recording. @return rows
static int64_t read_ticks(pal_h5 *file) {
    int64_t n = record_count(file);
    assert_true(n <= MOST);
    read_all(file, "/ticks/tick", PALPATE_H5_U64, 1, &n, tick);
    read_all(file, "/ticks/time", PALPATE_H5_I64, 1, &n, when);
    read_all(file, "/ticks/position", PALPATE_H5_F64, 2, (const int64_t[]){n, 3}, position);
    read_all(file, "/ticks/force", PALPATE_H5_F64, 2, (const int64_t[]){n, 3}, force);
    read_all(file, "/ticks/depth", PALPATE_H5_F64, 1, &n, depth);
    return n;
}

/// Inputs are the device's at that time and outputs an engine's fed with them, bit for bit, as long
/// as no tick is missing.
static void check_against_engine(int64_t n) {
    pal_engine_def def = pal_engine_default_def();
    pal_engine *engine = NULL;
    pal_device d;
    def.tool_count = 1;
    def.tools = &tool;
    assert_int_equal(pal_engine_create(model, &def, &engine, NULL), PALPATE_OK);
    assert_int_equal(pal_device_create(&tool, 1e-3, &d, NULL), PALPATE_OK);
    for (int64_t i = 0; i < n; i++) {
        pal_tool_state in;
        pal_tool_force out;
        assert_int_equal(tick[i], i);
        d.read(d.self, when[i], &in);
        (void)pal_engine_force(engine, &in, &out);
        assert_memory_equal(in.position, position[i], sizeof position[i]);
        assert_memory_equal(out.force, force[i], sizeof force[i]);
        assert_memory_equal(&out.depth, &depth[i], sizeof depth[i]);
    }
    d.close(d.self);
    pal_engine_free(engine);
}

static void a_run_is_read_back_as_it_was(void **state) {
    (void)state;
    char path[256], xdmf[256];
    in_folder("run.h5", path);
    pal_error e = {0};
    pal_session *session = make_session(path, 1.0, 1, &e);
    assert_non_null(session);
    assert_true(exists(path, ".ticks") && exists(path, ".frames"));
    if (pal_session_start(session, &e) != PALPATE_OK ||
        pal_session_finish(session, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_session_report r;
    pal_session_get_report(session, &r);
    assert_int_equal(r.records, 1000);
    assert_int_equal(r.records_lost, 0);
    assert_int_equal(r.record_frames, 32); // every 33 ticks and the last
    assert_int_equal(r.record_frames_lost, 0);
    assert_string_equal(r.record_error, "");
    assert_false(exists(path, ".ticks") || exists(path, ".frames") || exists(path, ".part"));
    pal_h5 *file = open_h5(path);
    assert_int_equal(read_ticks(file), 1000);
    assert_int_equal(whole(file, "/complete"), 1);
    assert_int_equal(whole(file, "/period"), 1000000);
    assert_int_equal(whole(file, "/records_lost"), 0);
    char text[128];
    pal_model_info info;
    pal_model_get_info(model, &info);
    assert_int_equal(pal_h5_read_text(file, "/model_hash", text, sizeof text, NULL), PALPATE_OK);
    assert_string_equal(text, info.hash);
    assert_int_equal(pal_h5_read_text(file, "/tool/0/name", text, sizeof text, NULL), PALPATE_OK);
    assert_string_equal(text, "probe");
    check_against_engine(1000);

    // the ring holds the same
    static pal_tick_record ring[4096];
    assert_int_equal(pal_session_ring(session, ring, 4096), 1000);
    for (int i = 0; i < 1000; i++) {
        assert_memory_equal(ring[i].force.force, force[i], sizeof force[i]);
    }

    // frames: position = rest + displacement, and they move
    int64_t rows[2], frames = 0;
    assert_int_equal(pal_h5_dims(file, "/surface/rest", PALPATE_H5_F64, 2, rows, &e), PALPATE_OK);
    assert_int_equal(pal_h5_dims(file, "/frames/tick", PALPATE_H5_U64, 1, &frames, &e), PALPATE_OK);
    assert_int_equal(frames, 32);
    assert_true(rows[0] > 30);
    size_t count = (size_t)(rows[0] * 3);
    float *u = malloc(count * sizeof *u), *x = malloc(count * sizeof *x);
    double *rest = malloc(count * sizeof *rest), time[32], tool_force[32][3];
    assert_true(u != NULL && x != NULL && rest != NULL);
    read_all(file, "/surface/rest", PALPATE_H5_F64, 2, rows, rest);
    read_all(file, "/frames/time", PALPATE_H5_F64, 1, &frames, time);
    read_all(file, "/frames/tool_force", PALPATE_H5_F64, 3, (const int64_t[]){32, 1, 3},
             tool_force);
    float largest = 0;
    for (int f = 0; f < 32; f++) {
        char name[64];
        (void)snprintf(name, sizeof name, "/frames/displacement/%06d", f);
        read_all(file, name, PALPATE_H5_F32, 2, rows, u);
        (void)snprintf(name, sizeof name, "/frames/position/%06d", f);
        read_all(file, name, PALPATE_H5_F32, 2, rows, x);
        for (size_t i = 0; i < count; i++) {
            assert_true(x[i] == (float)(rest[i] + (double)u[i]));
            largest = u[i] < largest ? u[i] : largest;
        }
        if (f < 31) { // every 33 ticks; the identity pose makes body and device frame the same
            assert_true(time[f] > 0.033 * f - 1e-9 && time[f] < 0.033 * f + 1e-9);
            assert_memory_equal(tool_force[f], force[33 * f], sizeof force[0]);
        }
    }
    assert_true(largest < -1e-3f); // pressed 3 mm
    int64_t triangles[2];
    assert_int_equal(pal_h5_dims(file, "/surface/triangles", PALPATE_H5_I32, 2, triangles, &e),
                     PALPATE_OK);
    int32_t *corner = malloc((size_t)triangles[0] * 3 * sizeof *corner);
    assert_non_null(corner);
    read_all(file, "/surface/triangles", PALPATE_H5_I32, 2, triangles, corner);
    assert_true(triangles[0] > 20);
    for (int64_t i = 0; i < 3 * triangles[0]; i++) {
        assert_true(corner[i] >= 0 && corner[i] < rows[0]);
    }
    free(corner);
    free(u);
    free(x);
    free(rest);
    assert_int_equal(pal_h5_close(file, NULL), PALPATE_OK);
    pal_session_free(session);

    // the companion names this file's datasets, by its last component
    in_folder("run.xdmf", xdmf);
    FILE *f = fopen(xdmf, "r");
    assert_non_null(f);
    static char xml[1 << 20];
    size_t n = fread(xml, 1, sizeof xml - 1, f);
    fclose(f);
    xml[n] = 0;
    assert_non_null(strstr(xml, ">run.h5:/frames/position/000031<"));
    assert_non_null(strstr(xml, "CollectionType=\"Temporal\""));
    int grids = 0;
    for (const char *p = xml; (p = strstr(p, "<Grid Name=\"surface ")) != NULL; p++) {
        grids++;
    }
    assert_int_equal(grids, 32);
    assert_null(strstr(xml, folder));
}

static void real_time_recording_is_complete(void **state) {
    (void)state;
    char path[256];
    in_folder("real.h5", path);
    pal_error e = {0};
    pal_session *session = make_session(path, 0.5, 0, &e);
    assert_non_null(session);
    assert_int_equal(pal_session_start(session, &e), PALPATE_OK);
    assert_int_equal(pal_session_finish(session, &e), PALPATE_OK);
    pal_session_report r;
    pal_session_get_report(session, &r);
    pal_session_free(session);
    assert_int_equal(r.records, r.ticks);
    assert_int_equal(r.records_lost, 0);
    pal_h5 *file = open_h5(path);
    int64_t n = read_ticks(file);
    assert_int_equal(n, r.ticks);
    check_against_engine(n);
    // each frame carries the session time of its tick, missed periods included
    int64_t frames = 0;
    assert_int_equal(pal_h5_dims(file, "/frames/tick", PALPATE_H5_U64, 1, &frames, NULL),
                     PALPATE_OK);
    assert_true(frames >= 1 && frames <= 20 && frames == (int64_t)r.record_frames);
    uint64_t frame_tick[20];
    double frame_time[20];
    read_all(file, "/frames/tick", PALPATE_H5_U64, 1, &frames, frame_tick);
    read_all(file, "/frames/time", PALPATE_H5_F64, 1, &frames, frame_time);
    for (int64_t i = 0; i < frames; i++) {
        assert_true(frame_tick[i] < (uint64_t)n);
        double off = frame_time[i] - 1e-9 * (double)when[frame_tick[i]];
        assert_true(off < 1e-9 && off > -1e-9);
    }
    pal_h5_close(file, NULL);
}

/// kill -9 in the middle: what had been handed to the kernel is there, whole and in order.
static void a_killed_run_is_recovered(void **state) {
    (void)state;
    char path[256], raw[256];
    in_folder("killed.h5", path);
    in_folder("killed.h5.ticks", raw);
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        pal_session *session = make_session(path, 0.0, 0, NULL); // endless
        if (session == NULL || pal_session_start(session, NULL) != PALPATE_OK) {
            _exit(1);
        }
        for (;;) {
            pause();
        }
    }
    struct stat st = {0};
    for (int i = 0;
         i < 10000 && st.st_size < PALPATE_TICKS_HEADER + 400 * (off_t)sizeof(pal_tick_item); i++) {
        usleep(2000);
        (void)stat(raw, &st);
    }
    assert_int_equal(kill(child, SIGKILL), 0);
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFSIGNALED(status));

    pal_error e = {0};
    pal_session *again = make_session(path, 1.0, 1, &e); // must not overwrite it
    assert_null(again);
    assert_non_null(strstr(e.message, "palpate recover"));
    assert_true(exists(path, ".ticks") && exists(path, ".frames"));

    pal_recording_summary s;
    if (pal_recording_convert(path, &s, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    assert_true(s.records >= 400);
    assert_true(s.records >= ((uint64_t)st.st_size - PALPATE_TICKS_HEADER) / sizeof(pal_tick_item));
    assert_int_equal(s.complete, 0);
    assert_int_equal(s.bad_records, 0); // a kill tears nothing: the kernel has whole writes
    assert_false(exists(path, ".ticks") || exists(path, ".frames"));
    pal_h5 *file = open_h5(path);
    assert_int_equal(whole(file, "/complete"), 0);
    int64_t n = read_ticks(file);
    assert_int_equal(n, s.records);
    check_against_engine(n);
    pal_h5_close(file, NULL);
    assert_int_equal(pal_recording_convert(path, &s, &e),
                     PALPATE_ERROR_IO); // nothing left to convert
}

/// The disk ends at 150 kB (a file size limit stands for it: same error path): the run goes on.
static void a_full_disk_is_counted_and_the_run_goes_on(void **state) {
    (void)state;
    char path[256];
    in_folder("full.h5", path);
    fflush(NULL);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        const struct rlimit small = {150000, 150000};
        signal(SIGXFSZ, SIG_IGN);
        pal_error e = {0};
        pal_session *session = make_session(path, 2.0, 1, &e);
        if (session == NULL || setrlimit(RLIMIT_FSIZE, &small) != 0 ||
            pal_session_start(session, &e) != PALPATE_OK) {
            _exit(1);
        }
        pal_session_report r;
        pal_status status = pal_session_finish(session, &e);
        pal_session_get_report(session, &r);
        pal_session_free(session);
        if (r.ticks != 2000 || r.counts.ticks != 2000) {
            _exit(2); // the run suffered
        }
        if (r.records + r.records_lost != 2000 ||
            r.records != (150000 - PALPATE_TICKS_HEADER) / sizeof(pal_tick_item)) {
            _exit(3);
        }
        if (strstr(r.record_error, strerror(EFBIG)) == NULL || r.record_frames_lost == 0) {
            _exit(4);
        }
        _exit(status == PALPATE_ERROR_IO ? 0 : 5); // no room for the converted file either: said so
    }
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    assert_true(WIFEXITED(status));
    assert_int_equal(WEXITSTATUS(status), 0);
    // with room again, what was saved can still be had
    assert_true(exists(path, ".ticks") && !exists(path, ".part"));
    pal_recording_summary s;
    pal_error e = {0};
    if (pal_recording_convert(path, &s, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    assert_int_equal(s.records, (150000 - PALPATE_TICKS_HEADER) / sizeof(pal_tick_item));
    assert_int_equal(s.complete, 1);
    pal_h5 *file = open_h5(path);
    int64_t n = read_ticks(file);
    check_against_engine(n);
    assert_int_equal(whole(file, "/records_lost"), 2000 - n);
    pal_h5_close(file, NULL);
}

static void where_nothing_can_be_written_the_session_is_refused(void **state) {
    (void)state;
    pal_error e = {0};
    assert_null(make_session("/nonexistent/folder/run.h5", 1.0, 1, &e));
    assert_int_equal(e.status, PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "/nonexistent/folder/run.h5.ticks"));
    assert_null(make_session("", 1.0, 1, &e));
    assert_int_equal(e.status, PALPATE_ERROR_ARGUMENT);
    static char long_path[5000];
    memset(long_path, 'a', sizeof long_path - 1);
    assert_null(make_session(long_path, 1.0, 1, &e));
    assert_int_equal(e.status, PALPATE_ERROR_ARGUMENT);
    // a session that never starts leaves nothing behind
    char path[256];
    in_folder("unused.h5", path);
    pal_session *session = make_session(path, 1.0, 1, &e);
    assert_non_null(session);
    assert_true(exists(path, ".ticks"));
    pal_session_free(session);
    assert_false(exists(path, ".ticks") || exists(path, ".frames") || exists(path, ""));
}

static void the_ring_can_be_dumped_while_it_fills(void **state) {
    (void)state;
    char path[256];
    in_folder("ring.h5", path);
    pal_error e = {0};
    pal_session *session = make_session(NULL, 0.0, 0, &e);
    assert_non_null(session);
    assert_int_equal(pal_session_start(session, &e), PALPATE_OK);
    usleep(100000);
    if (pal_session_dump(session, path, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    pal_session_request_stop(session);
    assert_int_equal(pal_session_finish(session, &e), PALPATE_OK);
    pal_session_free(session);
    pal_h5 *file = open_h5(path);
    int64_t n = read_ticks(file);
    assert_true(n > 0);
    check_against_engine(n); // the ring is large enough to hold all from tick 0 on
    pal_h5_close(file, NULL);
}

// ---- Damage
// --------------------------------------------------------------------------------------

enum { ITEMS = 100 };

/// A raw file of ITEMS records as a session would leave it.
static void write_raw(const char *path) {
    char name[300];
    pal_session_def def = pal_session_default_def();
    pal_ticks_header header;
    pal_item_file file;
    pal_error e = {0};
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    (void)snprintf(name, sizeof name, "%s.ticks", path);
    (void)unlink(name);
    pal_ticks_header_fill(&header, model, &def);
    if (pal_ticks_create(name, &header, &file, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    for (uint64_t i = 0; i < ITEMS; i++) {
        pal_tick_item item = {.record = {.tick = i, .time_ns = (int64_t)i * 1000000}};
        item.check = pal_item_check(&item.record, sizeof item.record, i);
        pal_item_append(&file, &item, sizeof item, 1);
    }
    assert_int_equal(file.items, ITEMS);
    close(file.fd);
}

static void poke(const char *path, off_t offset, const void *bytes, size_t size) {
    char name[300];
    (void)snprintf(name, sizeof name, "%s.ticks", path);
    int fd = open(name, O_WRONLY);
    assert_true(fd >= 0);
    assert_int_equal(pwrite(fd, bytes, size, offset), (ssize_t)size);
    close(fd);
}

static void cut(const char *path, off_t size) {
    char name[300];
    (void)snprintf(name, sizeof name, "%s.ticks", path);
    assert_int_equal(truncate(name, size), 0);
}

static void damage_costs_no_more_than_what_it_hit(void **state) {
    (void)state;
    char path[256];
    in_folder("hurt.h5", path);
    const off_t head = PALPATE_TICKS_HEADER, item = sizeof(pal_tick_item);
    const uint32_t next_version = PALPATE_RECORDING_VERSION + 1;
    static const char zeros[sizeof(pal_tick_item)];
    for (int i = 0; i < 10; i++) {
        write_raw(path);
        pal_status want = PALPATE_OK;
        uint64_t records = ITEMS, bad = 0;
        switch (i) {
        case 0:
            break; // intact
        case 1:
            poke(path, head + 7 * item + 100, "x", 1);
            records--;
            bad = 1;
            break; // one byte
        case 2:
            cut(path, head + 50 * item + 11);
            records = 50;
            bad = 1;
            break; // torn at the end
        case 3:
            cut(path, head);
            records = 0;
            break; // header only
        case 4:
            cut(path, head / 2);
            want = PALPATE_ERROR_TRUNCATED;
            break;
        case 5:
            cut(path, 100);
            want = PALPATE_ERROR_TRUNCATED;
            break;
        case 6:
            poke(path, 0, "HDF5", 4);
            want = PALPATE_ERROR_FORMAT;
            break;
        case 7:
            poke(path, 12, &next_version, 4);
            want = PALPATE_ERROR_VERSION;
            break;
        case 8:
            poke(path, 200, "y", 1);
            want = PALPATE_ERROR_CHECKSUM;
            break;
        case 9:
            poke(path, head + 3 * item, zeros, sizeof zeros);
            records--;
            bad = 1;
            break; // a hole
        }
        pal_recording_summary s = {0};
        pal_error e = {0};
        pal_status status = pal_recording_convert(path, &s, &e);
        if (status != want) {
            fail_msg("case %d: %s: %s", i, pal_status_name(status), e.message);
        }
        if (want == PALPATE_OK) {
            assert_int_equal(s.records, records);
            assert_int_equal(s.bad_records, bad);
            assert_int_equal(s.complete, 0);
            pal_h5 *file = open_h5(path);
            assert_int_equal(record_count(file), records);
            assert_int_equal(whole(file, "/records_damaged"), bad);
            pal_h5_close(file, NULL);
        } else {
            assert_non_null(strstr(e.message, "hurt.h5.ticks"));
            assert_true(exists(path, ".ticks")); // kept for another try
        }
        (void)unlink(path);
    }
}

/// An item written twice, or moved, is not taken for another one.
static void misplaced_items_are_not_believed(void **state) {
    (void)state;
    char path[256];
    in_folder("moved.h5", path);
    write_raw(path);
    const off_t head = PALPATE_TICKS_HEADER, item = sizeof(pal_tick_item);
    pal_tick_item copy = {.record = {.tick = 3, .time_ns = 3000000}};
    copy.check = pal_item_check(&copy.record, sizeof copy.record, 3);
    poke(path, head + 60 * item, &copy, sizeof copy);
    pal_recording_summary s;
    assert_int_equal(pal_recording_convert(path, &s, NULL), PALPATE_OK);
    assert_int_equal(s.records, ITEMS - 1);
    assert_int_equal(s.bad_records, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_run_is_read_back_as_it_was),
        cmocka_unit_test(real_time_recording_is_complete),
        cmocka_unit_test(a_killed_run_is_recovered),
        cmocka_unit_test(a_full_disk_is_counted_and_the_run_goes_on),
        cmocka_unit_test(where_nothing_can_be_written_the_session_is_refused),
        cmocka_unit_test(the_ring_can_be_dumped_while_it_fills),
        cmocka_unit_test(damage_costs_no_more_than_what_it_hit),
        cmocka_unit_test(misplaced_items_are_not_believed),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
