/// The model file: round trip bit for bit, the checksum gate, damage behind the gate, failing
/// disks, processes and threads side by side.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <math.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>
#include <hdf5.h>

#include "haptic/model/file_header.h"
#include "haptic/model/h5.h"
#include "haptic/base/hash.h"
#include "haptic/model/model.h"
#include "tests/support/synthetic_model.h"

static char directory[128], path[256];

static int enter_directory(void **state) {
    (void)state;
    // memory when there is some: a hundred fsyncs on a busy disk take a quarter of a minute
    const char *where = access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp";
    (void)snprintf(directory, sizeof directory, "%s/palpate-model-XXXXXX", where);
    if (mkdtemp(directory) == NULL) {
        return -1;
    }
    (void)snprintf(path, sizeof path, "%s/m.palpate", directory);
    return 0;
}

static int leave_directory(void **state) {
    (void)state;
    char command[200];
    (void)snprintf(command, sizeof command, "rm -rf '%s'", directory);
    return system(command);
}

/// Number of entries in the test's directory.
static int entries(const char *where) {
    DIR *d = opendir(where);
    assert_non_null(d);
    int count = 0;
    while (readdir(d) != NULL) {
        count++;
    }
    closedir(d);
    return count - 2;
}

static pal_model *build(int precision, int skin, double skew, synthetic_rows rows) {
    synthetic_params p = synthetic_default_params();
    p.n = 4;
    p.precision = (pal_precision)precision;
    p.skin = skin;
    p.skew = skew;
    p.rows = rows;
    pal_model *m = synthetic_model(&p);
    assert_non_null(m);
    // every number and text that no builder sets: distinct, so that a swapped pair shows
    double value = 0.1;
    pal_certificate *c = &m->info.certificate;
    double *numbers[] = {&m->info.density,          &m->info.seconds.cloud,
                         &m->info.seconds.assemble, &m->info.seconds.factor,
                         &m->info.seconds.solve,    &m->info.seconds.certify,
                         &m->info.seconds.total,    &c->force_change,
                         &c->solve_residual,        &c->rcond,
                         &c->force_balance,         &c->mls_worst_condition,
                         &c->mls_worst_point[0],    &c->mls_worst_point[1],
                         &c->mls_worst_point[2],    &c->estimated_error,
                         &c->loop_energy_raw,       &c->loop_energy,
                         &m->info.spacing_min,      &m->info.spacing_mean,
                         &m->info.spacing_max};
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        *numbers[i] = value += 0.1;
    }
    m->info.peak_bytes = 0xFEDCBA9876543210u;
    c->mls_grown = 12345;
    (void)snprintf(c->reason, sizeof c->reason, "none, \xC3\xA9t\xC3\xA9"); // UTF-8
    (void)snprintf(m->info.hash, sizeof m->info.hash,
                   "00112233445566778899aabbccddeeff00112233445566778899aabbccddeeff");
    pal_tool_def *tool = &m->runtime.tools[1];
    *tool = m->runtime.tools[0];
    m->runtime.tool_count = 2;
    (void)snprintf(tool->name, sizeof tool->name, "second");
    (void)snprintf(tool->device.path, sizeof tool->device.path, "/tmp/a b.csv");
    tool->shape = PALPATE_SHAPE_CAPSULE;
    tool->device.kind = PALPATE_DEVICE_REPLAY;
    double *tool_numbers[] = {&tool->radius,
                              &tool->length,
                              &tool->friction,
                              &tool->coupling_stiffness,
                              &tool->coupling_damping,
                              &tool->limits.force,
                              &tool->limits.slew,
                              &tool->limits.torque,
                              &tool->spec.max_force,
                              &tool->spec.max_torque,
                              &tool->spec.max_stiffness,
                              &tool->spec.max_damping,
                              &tool->spec.max_speed,
                              &tool->spec.damping,
                              &tool->spec.resolution,
                              &tool->start[0],
                              &tool->start[1],
                              &tool->start[2],
                              &tool->axis[0],
                              &tool->axis[1],
                              &tool->axis[2],
                              &tool->device.stroke.depth,
                              &tool->device.stroke.ramp,
                              &tool->device.stroke.period,
                              &tool->device.stroke.amplitude,
                              &tool->device.stroke.direction[0],
                              &tool->device.stroke.direction[1],
                              &tool->device.stroke.direction[2],
                              &tool->device.stroke.tremor_amplitude,
                              &tool->device.stroke.tremor_frequency};
    for (size_t i = 0; i < sizeof tool_numbers / sizeof *tool_numbers; i++) {
        *tool_numbers[i] = value += 0.1;
    }
    (void)snprintf(tool->spec.name, sizeof tool->spec.name, "a desk arm");
    tool->limits.slew = INFINITY; // none, on purpose
    m->runtime.watchdog = (pal_watchdog_def){0.01, 0.2, 3.0, 4.0, 0.5, 0.6};
    tool->device.stroke.kind = PALPATE_STROKE_PALPATION;
    tool->start[0] = -0.0; // bits, not values
    tool->start[1] = 5e-324;
    m->scene_text = malloc(200001); // larger than an HDF5 attribute may be
    assert_non_null(m->scene_text);
    memset(m->scene_text, 'x', 200000);
    m->scene_text[200000] = 0;
    return m;
}

static void save(const pal_model *m) {
    pal_error error = {0};
    if (pal_model_save(m, path, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
}

static pal_status load_status(const char *from, const char *expected_in_message) {
    pal_model *m = (pal_model *)1;
    pal_error error = {0};
    pal_status status = pal_model_load(from, &m, &error);
    if (status == PALPATE_OK) {
        pal_model_free(m);
        return status;
    }
    assert_null(m);
    assert_int_equal(error.status, status);
    assert_non_null(strstr(error.message, from));
    if (expected_in_message != NULL && strstr(error.message, expected_in_message) == NULL) {
        fail_msg("\"%s\" does not say \"%s\"", error.message, expected_in_message);
    }
    return status;
}

static uint8_t *slurp(const char *from, size_t *size) {
    FILE *f = fopen(from, "rb");
    assert_non_null(f);
    assert_int_equal(fseek(f, 0, SEEK_END), 0);
    *size = (size_t)ftell(f);
    rewind(f);
    uint8_t *bytes = malloc(*size + 1);
    assert_non_null(bytes);
    assert_int_equal(fread(bytes, 1, *size, f), *size);
    fclose(f);
    return bytes;
}

static void spill(const char *to, const void *bytes, size_t size) {
    FILE *f = fopen(to, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(bytes, 1, size, f), size);
    assert_int_equal(fclose(f), 0);
}

// ---- Round trip ---------------------------------------------------------------------------------

#define SAME(member, count)                                                                        \
    do {                                                                                           \
        if ((count) > 0) {                                                                         \
            assert_memory_equal(a->member, b->member, (size_t)(count) * sizeof *a->member);        \
        }                                                                                          \
    } while (0)

static void assert_same_models(const pal_model *a, const pal_model *b) {
    const pal_model_info *i = &a->info;
    assert_memory_equal(&a->info, &b->info, sizeof a->info);
    assert_int_equal(a->runtime.tool_count, b->runtime.tool_count);
    for (int k = 0; k < a->runtime.tool_count; k++) {
        const pal_tool_def *p = &a->runtime.tools[k], *q = &b->runtime.tools[k];
        assert_string_equal(p->name, q->name);
        assert_string_equal(p->device.path, q->device.path);
        assert_int_equal(p->shape, q->shape);
        assert_int_equal(p->has_start, q->has_start);
        assert_int_equal(p->device.kind, q->device.kind);
        assert_int_equal(p->device.stroke.kind, q->device.stroke.kind);
        // radius .. axis and the stroke's numbers are contiguous doubles
        assert_memory_equal(&p->radius, &q->radius,
                            offsetof(pal_tool_def, has_start) - offsetof(pal_tool_def, radius));
        assert_memory_equal(&p->device.stroke.depth, &q->device.stroke.depth,
                            sizeof p->device.stroke - offsetof(pal_stroke, depth));
    }
    assert_true(a->runtime.servo_rate == b->runtime.servo_rate &&
                a->runtime.render_rate == b->runtime.render_rate);
    assert_int_equal(a->runtime.max_contacts, b->runtime.max_contacts);
    assert_int_equal(a->runtime.field_by, b->runtime.field_by);
    assert_memory_equal(&a->runtime.watchdog, &b->runtime.watchdog, sizeof a->runtime.watchdog);
    assert_int_equal(a->runtime.contact_law, b->runtime.contact_law);
    assert_int_equal(a->runtime.contact_points, b->runtime.contact_points);
    SAME(position, 3 * i->node_count);
    SAME(normal, 3 * i->surface_count);
    SAME(area_vector, 3 * i->surface_count);
    SAME(triangle, 3 * i->triangle_count);
    SAME(node_flags, i->node_count);
    SAME(column_node, i->column_count);
    SAME(row_node, i->row_count);
    SAME(c_tt, 9 * i->column_count * i->column_count);
    SAME(probe_row, 9 * i->column_count * i->probe_count);
    assert_int_equal(a->row_ld, b->row_ld);
    assert_true(a->row_scale == b->row_scale);
    assert_int_equal(a->column_scale == NULL, b->column_scale == NULL);
    if (a->column_scale != NULL) {
        SAME(column_scale, 3 * i->column_count);
    }
    if (i->row_count > 0) {
        assert_memory_equal(a->c_st, b->c_st,
                            (size_t)a->row_ld * 3 * (size_t)i->column_count *
                                pal_precision_size(i->precision));
    }
    for (int k = 0; k < i->patch_count; k++) {
        assert_string_equal(a->patch[k].name, b->patch[k].name);
        assert_int_equal(a->patch[k].count, b->patch[k].count);
        SAME(patch[k].column, a->patch[k].count);
    }
    for (int k = 0; k < i->probe_count; k++) {
        assert_string_equal(a->probe[k].name, b->probe[k].name);
        assert_memory_equal(a->probe[k].position, b->probe[k].position, 24);
    }
    assert_int_equal(a->skin_triangle_count, b->skin_triangle_count);
    SAME(skin_position, 3 * i->skin_count);
    SAME(skin_triangle, 3 * a->skin_triangle_count);
    SAME(skin_twin, i->skin_count);
    SAME(skin_row, PALPATE_SKIN_WEIGHTS * i->skin_count);
    SAME(skin_weight, PALPATE_SKIN_WEIGHTS * i->skin_count);
    assert_int_equal(a->scene_text == NULL, b->scene_text == NULL);
    if (a->scene_text != NULL) {
        assert_string_equal(a->scene_text, b->scene_text);
    }
}

static void round_trips_keep_every_bit(void **state) {
    (void)state;
    for (int precision = 0; precision < 4; precision++) {
        for (int variant = 0; variant < 4; variant++) {
            pal_model *a = build(precision, variant == 1, variant == 2 ? 0.1 : 0,
                                 variant == 3 ? SYNTHETIC_ROWS_NONE : SYNTHETIC_ROWS_ALL),
                      *b = NULL;
            if (variant == 3) {
                free(a->scene_text);
                a->scene_text = NULL;
            }
            save(a);
            pal_error error = {0};
            assert_int_equal(pal_model_load(path, &b, &error), PALPATE_OK);
            assert_same_models(a, b);
            // equal models make equal files
            void *first, *second;
            size_t n, m;
            assert_int_equal(pal_model_image(a, &first, &n, &error), PALPATE_OK);
            assert_int_equal(pal_model_image(b, &second, &m, &error), PALPATE_OK);
            assert_int_equal(n, m);
            assert_memory_equal(first, second, n);
            // the lowest version that can hold it, so that older programs read what they know
            uint32_t version;
            memcpy(&version, (char *)first + 16, sizeof version);
            assert_int_equal(version, precision == PALPATE_PRECISION_SCALED ? 2 : 1);
            free(first), free(second);
            pal_model_free(a), pal_model_free(b);
        }
    }
    assert_int_equal(entries(directory), 1); // no temporary left
}

static void models_without_patches_probes_or_columns_round_trip(void **state) {
    (void)state;
    pal_model *a = build(1, 0, 0, SYNTHETIC_ROWS_NONE), *b;
    for (int k = 0; k < a->info.patch_count; k++) {
        free(a->patch[k].column);
    }
    a->info.patch_count = a->info.probe_count = 0;
    save(a);
    assert_int_equal(pal_model_load(path, &b, NULL), PALPATE_OK);
    assert_same_models(a, b);
    pal_model_free(b);
    for (int k = 0; k < a->info.node_count; k++) {
        a->node_flags[k] &= PALPATE_NODE_FIXED;
    }
    a->info.touchable_count = a->info.column_count = 0;
    save(a);
    assert_int_equal(pal_model_load(path, &b, NULL), PALPATE_OK);
    assert_same_models(a, b);
    pal_model_free(a), pal_model_free(b);
}

static void invalid_models_are_not_written(void **state) {
    (void)state;
    pal_model *a = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE);
    pal_error error = {0};
    a->c_tt[3] = (double)NAN;
    (void)unlink(path);
    assert_int_equal(pal_model_save(a, path, &error), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "c_tt"));
    assert_int_equal(entries(directory), 0);
    assert_int_equal(pal_model_save(NULL, path, &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_model_save(a, NULL, &error), PALPATE_ERROR_ARGUMENT);
    pal_model_free(a);
}

static void h5dump_reads_it(void **state) {
    (void)state;
    if (system("command -v h5dump > /dev/null") != 0) {
        skip();
    }
    pal_model *a = build(2, 1, 0, SYNTHETIC_ROWS_SURFACE);
    save(a);
    char command[2048];
    (void)snprintf(command, sizeof command,
                   "h5dump '%s' > '%s.all' && h5dump -d /info/young '%s' > '%s.txt' && grep -q "
                   "'10000' '%s.txt' && "
                   "grep -q '\"Pa\"' '%s.txt' && grep -q 'c_st' '%s.all'",
                   path, path, path, path, path, path, path);
    assert_int_equal(system(command), 0);
    pal_model_free(a);
}

// ---- The gate -----------------------------------------------------------------------------------

static void every_flipped_byte_is_found(void **state) {
    (void)state;
    pal_model *a = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE);
    free(a->scene_text);
    a->scene_text = NULL;
    void *image;
    size_t size;
    pal_error error = {0};
    assert_int_equal(pal_model_image(a, &image, &size, &error), PALPATE_OK);
    uint8_t *bytes = image;
    assert_int_equal(
        pal_file_verify(PALPATE_FILE_MODEL, PALPATE_MODEL_VERSION, bytes, size, "m", &error),
        PALPATE_OK);
    size_t step = 97,
           checked = 0; // all of the header and the HDF5 superblock, then samples of the rest
    for (size_t i = 0; i < size; i += i < 700 ? 1 : step, checked++) {
        uint8_t bit = (uint8_t)(1u << (i % 8));
        bytes[i] ^= bit;
        pal_status status =
            pal_file_verify(PALPATE_FILE_MODEL, PALPATE_MODEL_VERSION, bytes, size, "m", &error);
        assert_int_equal(status, i < 8 ? PALPATE_ERROR_FORMAT : PALPATE_ERROR_CHECKSUM);
        bytes[i] ^= bit;
    }
    assert_true(checked > 1000);
    // and through the whole path, a few
    for (size_t i = 3; i < size; i += size / 7) {
        bytes[i] ^= 0x10;
        spill(path, bytes, size);
        assert_int_equal(load_status(path, i < 8 ? "not a Palpate model" : "corrupted"),
                         i < 8 ? PALPATE_ERROR_FORMAT : PALPATE_ERROR_CHECKSUM);
        assert_int_equal(pal_file_verify_path(PALPATE_FILE_MODEL, 1, path, &error),
                         i < 8 ? PALPATE_ERROR_FORMAT : PALPATE_ERROR_CHECKSUM);
        bytes[i] ^= 0x10;
    }
    free(image);
    pal_model_free(a);
}

static void every_truncation_is_found(void **state) {
    (void)state;
    pal_model *a = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE);
    save(a);
    size_t size;
    uint8_t *bytes = slurp(path, &size);
    for (size_t k = 0; k < 50; k++) {
        spill(path, bytes, size * k / 50);
        assert_int_equal(load_status(path, "truncated"), PALPATE_ERROR_TRUNCATED);
    }
    static const size_t edges[] = {1, 7, 8, 95, 96, 97, 511, 512};
    for (size_t k = 0; k < sizeof edges / sizeof *edges; k++) {
        spill(path, bytes, edges[k]);
        assert_int_equal(load_status(path, "truncated"), PALPATE_ERROR_TRUNCATED);
    }
    spill(path, bytes, size - 1);
    assert_int_equal(load_status(path, "truncated"), PALPATE_ERROR_TRUNCATED);
    bytes[size] = 0;
    spill(path, bytes, size + 1);
    assert_int_equal(load_status(path, "corrupted"), PALPATE_ERROR_CHECKSUM);
    free(bytes);
    pal_model_free(a);
}

static void foreign_newer_and_stale_files_are_told_apart(void **state) {
    (void)state;
    pal_model *a = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE), *b;
    pal_error error = {0};
    spill(path, "palpate: 1\nbody:\n", 17);
    assert_int_equal(load_status(path, "it starts with 70 61 6c"), PALPATE_ERROR_FORMAT);
    spill(path, "x", 1);
    assert_int_equal(load_status(path, "it starts with 78;"), PALPATE_ERROR_FORMAT);

    pal_h5 *plain;
    assert_int_equal(pal_h5_create(path, 0, 0, &plain, &error), PALPATE_OK);
    assert_int_equal(pal_h5_close(plain, &error), PALPATE_OK);
    assert_int_equal(load_status(path, "plain HDF5"), PALPATE_ERROR_FORMAT);

    save(a);
    size_t size;
    uint8_t *bytes = slurp(path, &size);
    assert_int_equal(pal_file_seal(PALPATE_FILE_RECORDING, 1, bytes, size), PALPATE_OK);
    spill(path, bytes, size);
    assert_int_equal(load_status(path, "a Palpate recording, not a model"), PALPATE_ERROR_FORMAT);
    assert_int_equal(pal_file_seal(PALPATE_FILE_MODEL, PALPATE_MODEL_VERSION + 1, bytes, size),
                     PALPATE_OK);
    spill(path, bytes, size);
    assert_int_equal(load_status(path, "newer"), PALPATE_ERROR_VERSION);
    assert_int_equal(pal_file_seal(PALPATE_FILE_MODEL, 0, bytes, size), PALPATE_OK);
    spill(path, bytes, size);
    assert_int_equal(load_status(path, "version 0"), PALPATE_ERROR_FORMAT);
    // an unknown kind, a user block that is none, a size below it: sealed by hand
    static const struct {
        size_t at;
        uint8_t value;
    } changes[] = {{8, 'X'}, {20, 1}, {21, 6}};
    for (int k = 0; k < 3; k++) {
        assert_int_equal(pal_file_seal(PALPATE_FILE_MODEL, 1, bytes, size), PALPATE_OK);
        bytes[changes[k].at] = changes[k].value;
        pal_hash_buffer(bytes, 64, bytes + 64);
        spill(path, bytes, size);
        assert_int_equal(load_status(path, NULL), PALPATE_ERROR_FORMAT);
    }
    assert_int_equal(pal_file_seal(PALPATE_FILE_MODEL, 1, bytes, 511), PALPATE_ERROR_ARGUMENT);
    free(bytes);

    save(a);
    assert_int_equal(pal_model_load_expect(path, a->info.hash, &b, &error), PALPATE_OK);
    pal_model_free(b);
    assert_int_equal(pal_model_load_expect(path, "ff", &b, &error), PALPATE_STALE);
    assert_non_null(strstr(error.message, "stale"));
    assert_null(b);
    assert_int_equal(pal_model_load_expect(path, NULL, &b, &error), PALPATE_ERROR_ARGUMENT);
    pal_model_free(a);
}

static void unreadable_things_are_io_errors(void **state) {
    (void)state;
    char other[300];
    (void)snprintf(other, sizeof other, "%s/none", directory);
    assert_int_equal(load_status(other, "No such file"), PALPATE_ERROR_IO);
    assert_int_equal(load_status(directory, "not a regular file"), PALPATE_ERROR_IO);
    assert_int_equal(mkfifo(other, 0600), 0);
    assert_int_equal(load_status(other, "not a regular file"),
                     PALPATE_ERROR_IO); // and does not hang
    assert_int_equal(unlink(other), 0);
    assert_int_equal(load_status("/dev/zero", "not a regular file"), PALPATE_ERROR_IO);
    if (geteuid() != 0) {
        spill(other, "x", 1);
        assert_int_equal(chmod(other, 0), 0);
        assert_int_equal(load_status(other, "Permission denied"), PALPATE_ERROR_IO);
    }
    pal_model *m;
    assert_int_equal(pal_model_load(NULL, &m, NULL), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_model_load(other, NULL, NULL), PALPATE_ERROR_ARGUMENT);
}

// ---- Behind the gate ----------------------------------------------------------------------------

typedef void (*surgery)(hid_t file);

/// Save, open with HDF5 itself, damage, seal again, load: must be refused, and say what.
static void expect_refused(const pal_model *m, surgery cut, const char *message) {
    save(m);
    hid_t file = H5Fopen(path, H5F_ACC_RDWR, H5P_DEFAULT);
    assert_true(file >= 0);
    cut(file);
    assert_true(H5Fclose(file) >= 0);
    pal_error error = {0};
    assert_int_equal(pal_file_seal_path(PALPATE_FILE_MODEL, 1, path, &error), PALPATE_OK);
    assert_int_equal(pal_file_verify_path(PALPATE_FILE_MODEL, 1, path, &error), PALPATE_OK);
    assert_int_equal(load_status(path, message), PALPATE_ERROR_FORMAT);
}

static void set_number(hid_t file, const char *name, hid_t type, const void *value) {
    hid_t d = H5Dopen2(file, name, H5P_DEFAULT);
    assert_true(d >= 0 && H5Dwrite(d, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, value) >= 0 &&
                H5Dclose(d) >= 0);
}

static void set_count(hid_t file, const char *name, int32_t value) {
    set_number(file, name, H5T_NATIVE_INT32, &value);
}

static void replace(hid_t file, const char *name, hid_t type, int rank, const hsize_t *dims,
                    hid_t creation) {
    assert_true(H5Ldelete(file, name, H5P_DEFAULT) >= 0);
    hid_t s = rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(rank, dims, NULL);
    hid_t d = H5Dcreate2(file, name, type, s, H5P_DEFAULT, creation, H5P_DEFAULT);
    assert_true(d >= 0 && H5Dclose(d) >= 0);
    H5Sclose(s);
}

static void cut_missing(hid_t f) {
    assert_true(H5Ldelete(f, "/nodes/position", H5P_DEFAULT) >= 0);
}
static void cut_missing_group(hid_t f) {
    assert_true(H5Ldelete(f, "/runtime/tools", H5P_DEFAULT) >= 0);
}
static void cut_single(hid_t f) {
    replace(f, "/info/young", H5T_IEEE_F32LE, 0, NULL, H5P_DEFAULT);
}
static void cut_big_endian(hid_t f) {
    replace(f, "/info/young", H5T_IEEE_F64BE, 0, NULL, H5P_DEFAULT);
}
static void cut_rank(hid_t f) {
    hsize_t d[1] = {1};
    replace(f, "/info/young", H5T_IEEE_F64LE, 1, d, H5P_DEFAULT);
}
static void cut_null_space(hid_t f) {
    assert_true(H5Ldelete(f, "/info/young", H5P_DEFAULT) >= 0);
    hid_t s = H5Screate(H5S_NULL), d = H5Dcreate2(f, "/info/young", H5T_IEEE_F64LE, s, H5P_DEFAULT,
                                                  H5P_DEFAULT, H5P_DEFAULT);
    assert_true(d >= 0);
    H5Dclose(d), H5Sclose(s);
}
static void cut_dims(hid_t f) {
    hsize_t d[2] = {5, 3};
    replace(f, "/nodes/position", H5T_IEEE_F64LE, 2, d, H5P_DEFAULT);
}
static void cut_huge(hid_t f) { // storage is never allocated, so the file stays small
    hsize_t d[2] = {(hsize_t)1 << 40, (hsize_t)1 << 20};
    replace(f, "/nodes/position", H5T_IEEE_F64LE, 2, d, H5P_DEFAULT);
}
static void cut_unallocated(hid_t f) {
    hsize_t d[2] = {36 * 3, 3};
    replace(f, "/nodes/position", H5T_IEEE_F64LE, 2, d, H5P_DEFAULT);
}
static void cut_deflate(hid_t f) {
    hid_t c = H5Pcreate(H5P_DATASET_CREATE);
    hsize_t d[2] = {36 * 3, 3};
    assert_true(H5Pset_chunk(c, 2, d) >= 0 && H5Pset_deflate(c, 9) >= 0);
    replace(f, "/nodes/position", H5T_IEEE_F64LE, 2, d, c);
    H5Pclose(c);
}
static void cut_external(hid_t f) { // would read another file's bytes
    hid_t c = H5Pcreate(H5P_DATASET_CREATE);
    hsize_t d[2] = {36 * 3, 3};
    assert_true(H5Pset_external(c, "/etc/passwd", 0, H5F_UNLIMITED) >= 0);
    replace(f, "/nodes/position", H5T_IEEE_F64LE, 2, d, c);
    H5Pclose(c);
}
static void cut_soft_link(hid_t f) {
    assert_true(H5Lmove(f, "/nodes/position", f, "/nodes/moved", H5P_DEFAULT, H5P_DEFAULT) >= 0);
    assert_true(H5Lcreate_soft("/nodes/moved", f, "/nodes/position", H5P_DEFAULT, H5P_DEFAULT) >=
                0);
}
static void cut_external_link(hid_t f) {
    assert_true(H5Ldelete(f, "/nodes", H5P_DEFAULT) >= 0);
    assert_true(
        H5Lcreate_external("/tmp/other.h5", "/nodes", f, "/nodes", H5P_DEFAULT, H5P_DEFAULT) >= 0);
}
static void cut_group_for_dataset(hid_t f) {
    assert_true(H5Ldelete(f, "/info/young", H5P_DEFAULT) >= 0);
    hid_t g = H5Gcreate2(f, "/info/young", H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT);
    assert_true(g >= 0 && H5Gclose(g) >= 0);
}
static void cut_variable_text(hid_t f) {
    hid_t t = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(t, H5T_VARIABLE) >= 0);
    replace(f, "/info/method", t, 0, NULL, H5P_DEFAULT);
    H5Tclose(t);
}
static void text_of(hid_t f, const char *name, const char *text, size_t size) {
    hid_t t = H5Tcopy(H5T_C_S1);
    assert_true(H5Tset_size(t, size) >= 0 && H5Tset_cset(t, H5T_CSET_UTF8) >= 0);
    replace(f, name, t, 0, NULL, H5P_DEFAULT);
    set_number(f, name, t, text);
    H5Tclose(t);
}
static char long_text[1000];
static void cut_long_text(hid_t f) {
    text_of(f, "/info/method", long_text, 33);
}
static void cut_unterminated(hid_t f) {
    text_of(f, "/info/method", "abcd", 4);
}
static void cut_early_end(hid_t f) {
    text_of(f, "/info/method", "ab\0d\0", 5);
}
static void cut_scene_dataset(hid_t f) {
    replace(f, "/scene", H5T_STD_I32LE, 0, NULL, H5P_DEFAULT);
}
static void cut_hash(hid_t f) {
    text_of(f, "/info/hash", "xyz", 4);
}
static void cut_nodes_up(hid_t f) {
    set_count(f, "/info/node_count", 36 * 3 + 1);
}
static void cut_nodes_max(hid_t f) {
    set_count(f, "/info/node_count", INT32_MAX);
}
static void cut_nodes_large(hid_t f) {
    set_count(f, "/info/node_count", PALPATE_COUNT_MAX);
}
static void cut_nodes_negative(hid_t f) {
    set_count(f, "/info/node_count", -1);
}
static void cut_columns(hid_t f) {
    set_count(f, "/info/column_count", PALPATE_COUNT_MAX);
}
static void cut_rows(hid_t f) {
    set_count(f, "/info/row_count", PALPATE_COUNT_MAX);
}
static void cut_rows_overflow(hid_t f) {
    set_count(f, "/info/row_count", INT32_MAX);
}
static void cut_patches(hid_t f) {
    set_count(f, "/info/patch_count", PALPATE_COUNT_MAX);
}
static void cut_patches_more(hid_t f) {
    set_count(f, "/info/patch_count", 3);
}
static void cut_probes(hid_t f) {
    set_count(f, "/info/probe_count", 3);
}
static void cut_probes_max(hid_t f) {
    set_count(f, "/info/probe_count", PALPATE_COUNT_MAX);
}
static void cut_skin(hid_t f) {
    set_count(f, "/info/skin_count", 1000);
}
static void cut_skin_triangles(hid_t f) {
    set_count(f, "/skin/triangle_count", -5);
}
static void cut_tools(hid_t f) {
    set_count(f, "/runtime/tool_count", 9);
}
static void cut_tools_negative(hid_t f) {
    set_count(f, "/runtime/tool_count", -9);
}
static void cut_precision(hid_t f) {
    set_count(f, "/info/precision", 7);
}
static void cut_precision_other(hid_t f) {
    set_count(f, "/info/precision", PALPATE_PRECISION_DOUBLE);
}
static void cut_patch_large(hid_t f) {
    hsize_t d[1] = {1000};
    replace(f, "/patches/0/column", H5T_STD_I32LE, 1, d, H5P_DEFAULT);
}
static void cut_patch_many(hid_t f) {
    hsize_t d[1] = {1000};
    hid_t c = H5Pcreate(H5P_DATASET_CREATE);
    assert_true(H5Pset_alloc_time(c, H5D_ALLOC_TIME_EARLY) >= 0);
    replace(f, "/patches/0/column", H5T_STD_I32LE, 1, d, c);
    H5Pclose(c);
}
static void cut_nan(hid_t f) {
    double x = (double)NAN;
    set_number(f, "/info/volume", H5T_NATIVE_DOUBLE, &x);
}
static void cut_scale(hid_t f) {
    double x = 3;
    set_number(f, "/compliance/row_scale", H5T_NATIVE_DOUBLE, &x);
}
static void cut_column_scale(hid_t f) {
    assert_true(H5Ldelete(f, "/compliance/column_scale", H5P_DEFAULT) >= 0);
}
static void cut_column_scale_short(hid_t f) {
    hsize_t d[1] = {47};
    replace(f, "/compliance/column_scale", H5T_IEEE_F64LE, 1, d, H5P_DEFAULT);
}
static void cut_column_scale_zero(hid_t f) {
    double zero[48] = {0};
    set_number(f, "/compliance/column_scale", H5T_NATIVE_DOUBLE, zero);
}
static void cut_precision_half(hid_t f) {
    set_count(f, "/info/precision", PALPATE_PRECISION_HALF);
}
static void cut_symmetric(hid_t f) {
    double *c = malloc(48 * 48 * sizeof *c);
    assert_non_null(c);
    hid_t d = H5Dopen2(f, "/compliance/c_tt", H5P_DEFAULT);
    assert_true(H5Dread(d, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, c) >= 0);
    c[5] *= 1.0000001;
    assert_true(H5Dwrite(d, H5T_NATIVE_DOUBLE, H5S_ALL, H5S_ALL, H5P_DEFAULT, c) >= 0);
    H5Dclose(d);
    free(c);
}

static void damage_behind_the_gate_is_refused(void **state) {
    (void)state;
    static const struct {
        surgery cut;
        const char *message;
    } cases[] = {
        {cut_missing, "/nodes/position is missing"},
        {cut_missing_group, "/runtime/tools/0/name is missing"},
        {cut_single, "/info/young has another number type"},
        {cut_big_endian, "/info/young has another number type"},
        {cut_rank, "/info/young has 1 dimensions"},
        {cut_null_space, "/info/young"},
        {cut_dims, "/nodes/position"},
        {cut_huge, "/nodes/position claims"},
        {cut_unallocated, "/nodes/position claims"},
        {cut_deflate, "not stored plainly"},
        {cut_external, "not stored plainly"},
        {cut_soft_link, "/nodes/position is missing"},
        {cut_external_link, "is missing"},
        {cut_group_for_dataset, "cannot open dataset /info/young"},
        {cut_variable_text, "/info/method"},
        {cut_long_text, "/info/method is not a text of at most 32"},
        {cut_unterminated, "/info/method does not end"},
        {cut_early_end, "/info/method does not end"},
        {cut_scene_dataset, "/scene is not a text"},
        {cut_hash, "hash \"xyz\""},
        {cut_nodes_up, "/nodes/position has 108 entries in dimension 0, must have 109"},
        {cut_nodes_max, "/info: count 2147483647"},
        {cut_nodes_large, "do not fit the file"},
        {cut_nodes_negative, "/info: count -1"},
        {cut_columns, "do not fit the file"},
        {cut_rows, "do not fit the file"},
        {cut_rows_overflow, "/info: count"},
        {cut_patches, "do not fit the file"},
        {cut_patches_more, "/patches/2/name is missing"},
        {cut_probes, "/compliance/probe_row"},
        {cut_probes_max, "do not fit the file"},
        {cut_skin, "/skin/position"},
        {cut_skin_triangles, "/skin/triangle"},
        {cut_tools, "/runtime/tool_count is 9"},
        {cut_tools_negative, "/runtime/tool_count is -9"},
        {cut_precision, "/info/precision is 7"},
        {cut_precision_other, "/compliance/c_st has another number type"},
        {cut_patch_large, "/patches/0/column claims"},
        {cut_patch_many, "1000 nodes, the model has 16 columns"},
        {cut_nan, "volume is nan"},
        {cut_scale, "row_scale is 3"},
        {cut_symmetric, "marked symmetric"},
    };
    memset(long_text, 'y', sizeof long_text - 1);
    long_text[32] = 0;
    pal_model *m = build(1, 1, 0, SYNTHETIC_ROWS_SURFACE);
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        expect_refused(m, cases[k].cut, cases[k].message);
    }
    pal_model_free(m);
    m = build(PALPATE_PRECISION_SCALED, 0, 0, SYNTHETIC_ROWS_SURFACE);
    expect_refused(m, cut_column_scale, "/compliance/column_scale is missing");
    expect_refused(m, cut_column_scale_short, "/compliance/column_scale");
    expect_refused(m, cut_column_scale_zero, "column_scale[0] is 0");
    expect_refused(m, cut_precision_half, "/compliance/c_st has another number type");
    pal_model_free(m);
    // a sealed file whose HDF5 part is gone
    uint8_t *bytes = calloc(1, 4096);
    assert_int_equal(pal_file_seal(PALPATE_FILE_MODEL, 1, bytes, 4096), PALPATE_OK);
    spill(path, bytes, 4096);
    assert_int_equal(load_status(path, "HDF5 cannot read"), PALPATE_ERROR_FORMAT);
    free(bytes);
}

// ---- Disks --------------------------------------------------------------------------------------

static void saving_where_one_cannot_leaves_nothing(void **state) {
    (void)state;
    pal_model *m = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE);
    pal_error error = {0};
    char other[400];
    int before = entries(directory);
    (void)snprintf(other, sizeof other, "%s/no/such/place.palpate", directory);
    assert_int_equal(pal_model_save(m, other, &error), PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, "No such file"));
    assert_int_equal(pal_model_save(m, directory, &error), PALPATE_ERROR_IO);
    assert_int_equal(pal_model_save(m, "", &error), PALPATE_ERROR_IO);
    assert_int_equal(pal_model_save(m, "/tmp/", &error), PALPATE_ERROR_IO);
    assert_int_equal(pal_model_save(m, "/dev/full", &error),
                     PALPATE_ERROR_IO); // not replaced by a file
    assert_non_null(strstr(error.message, "not a regular file"));
    struct stat st;
    assert_true(stat("/dev/full", &st) != 0 || S_ISCHR(st.st_mode));
    assert_int_equal(entries(directory), before);

    // a file name of the longest length still has room for its temporary
    (void)snprintf(other, sizeof other, "%s/", directory);
    size_t n = strlen(other);
    memset(other + n, 'n', 255);
    other[n + 255] = 0;
    assert_int_equal(pal_model_save(m, other, &error), PALPATE_OK);
    assert_int_equal(unlink(other), 0);

    // permissions: 0666 and 0600 under the umask
    mode_t mask = umask(027);
    assert_int_equal(pal_model_save(m, path, &error), PALPATE_OK);
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0640);
    assert_int_equal(pal_model_save_mode(m, path, 0600, &error), PALPATE_OK);
    assert_int_equal(stat(path, &st), 0);
    assert_int_equal(st.st_mode & 0777, 0600);
    (void)umask(mask);

    // a symbolic link is replaced, its target untouched
    (void)snprintf(other, sizeof other, "%s/target", directory);
    spill(other, "precious", 8);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(symlink(other, path), 0);
    assert_int_equal(pal_model_save(m, path, &error), PALPATE_OK);
    assert_int_equal(lstat(path, &st), 0);
    assert_true(S_ISREG(st.st_mode));
    size_t size;
    uint8_t *bytes = slurp(other, &size);
    assert_int_equal(size, 8);
    free(bytes);
    assert_int_equal(unlink(other), 0);
    pal_model_free(m);
}

/// Runs in a child: saves must fail with `code`, name it, and leave the old file alone.
static int failing_save(const pal_model *m, const char *where, int code, int old_entries) {
    pal_error error = {0};
    if (pal_model_save(m, where, &error) != PALPATE_ERROR_IO ||
        strstr(error.message, strerror(code)) == NULL ||
        strstr(error.message, "free space") == NULL) {
        (void)fprintf(stderr, "got: %s\n", error.message);
        return 1;
    }
    char parent[400];
    (void)snprintf(parent, sizeof parent, "%s", where);
    *strrchr(parent, '/') = 0;
    return entries(parent) == old_entries ? 0 : 2;
}

static int exit_status(pid_t child) {
    int status = 0;
    assert_int_equal(waitpid(child, &status, 0), child);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128;
}

static void a_full_disk_leaves_the_old_file(void **state) {
    (void)state;
    pal_model *m = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE);
    save(m);
    int before = entries(directory);
    // a file size limit: fails in write() as a full disk does, without privileges
    pid_t child = fork();
    if (child == 0) {
        struct rlimit limit = {50000, 50000};
        (void)signal(SIGXFSZ, SIG_IGN);
        _exit(setrlimit(RLIMIT_FSIZE, &limit) != 0 ? 9 : failing_save(m, path, EFBIG, before));
    }
    assert_int_equal(exit_status(child), 0);
    assert_int_equal(load_status(path, NULL), PALPATE_OK);

    // a real one, where a private mount is allowed
    child = fork();
    if (child == 0) {
        char where[400];
        (void)snprintf(where, sizeof where, "%s/small", directory);
        if (unshare(CLONE_NEWNS) != 0 || mount(NULL, "/", NULL, MS_REC | MS_PRIVATE, NULL) != 0 ||
            mkdir(where, 0700) != 0 || mount("tmpfs", where, "tmpfs", 0, "size=128k") != 0) {
            _exit(77);
        }
        (void)strcat(where, "/m.palpate");
        spill(where, "old", 3);
        int failed = failing_save(m, where, ENOSPC, 1);
        struct stat st;
        _exit(failed != 0 ? failed : stat(where, &st) == 0 && st.st_size == 3 ? 0 : 3);
    }
    int status = exit_status(child);
    pal_model_free(m);
    if (status == 77) {
        skip();
    }
    assert_int_equal(status, 0);
}

// ---- Side by side -------------------------------------------------------------------------------

static void two_processes_saving_at_once_end_with_one_good_file(void **state) {
    (void)state;
    pal_model *m = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE);
    save(m);
    int before = entries(directory);
    pid_t child[2];
    for (int k = 0; k < 2; k++) {
        child[k] = fork();
        if (child[k] == 0) {
            m->info.density = 100 + k;
            for (int i = 0; i < 20; i++) {
                if (pal_model_save(m, path, NULL) != PALPATE_OK) {
                    _exit(1);
                }
            }
            _exit(0);
        }
    }
    for (int i = 0; i < 30; i++) { // a reader never sees half a file
        assert_int_equal(load_status(path, NULL), PALPATE_OK);
    }
    assert_int_equal(exit_status(child[0]), 0);
    assert_int_equal(exit_status(child[1]), 0);
    pal_model *b;
    assert_int_equal(pal_model_load(path, &b, NULL), PALPATE_OK);
    assert_true(b->info.density == 100 || b->info.density == 101);
    assert_int_equal(entries(directory), before);
    pal_model_free(m), pal_model_free(b);
}

typedef struct loader {
    char path[400];
    double density;
    int failed;
} loader;

static void *load_repeatedly(void *argument) {
    loader *l = argument;
    for (int i = 0; i < 5; i++) {
        pal_model *m;
        if (pal_model_load(l->path, &m, NULL) != PALPATE_OK) {
            l->failed = 1;
            return NULL;
        }
        l->failed |= m->info.density != l->density ? 2 : 0;
        l->failed |= pal_model_save(m, l->path, NULL) != PALPATE_OK ? 4 : 0;
        pal_model_free(m);
    }
    return NULL;
}

/// Each thread its own model: images open at the same time must not be mixed up.
static void threads_load_and_save_side_by_side(void **state) {
    (void)state;
    pal_model *m = build(1, 0, 0, SYNTHETIC_ROWS_SURFACE);
    pthread_t thread[4];
    loader loaders[4] = {{{0}, 0, 0}};
    for (int k = 0; k < 4; k++) {
        (void)snprintf(loaders[k].path, sizeof loaders[k].path, "%s/%d.palpate", directory, k);
        m->info.density = loaders[k].density = 1000 + k;
        assert_int_equal(pal_model_save(m, loaders[k].path, NULL), PALPATE_OK);
    }
    for (int k = 0; k < 4; k++) {
        assert_int_equal(pthread_create(&thread[k], NULL, load_repeatedly, &loaders[k]), 0);
    }
    for (int k = 0; k < 4; k++) {
        assert_int_equal(pthread_join(thread[k], NULL), 0);
        assert_int_equal(loaders[k].failed, 0);
    }
    pal_model_free(m);
}

/// The same without threads, so that it fails every time: two images open at once.
static void two_images_open_at_once_stay_apart(void **state) {
    (void)state;
    pal_h5 *file[2];
    void *image[2];
    size_t size[2];
    pal_error error = {0};
    for (int k = 0; k < 2; k++) {
        assert_int_equal(pal_h5_create(NULL, 512, 0, &file[k], &error), PALPATE_OK);
    }
    for (int k = 0; k < 2; k++) {
        int32_t value = 7 + k;
        assert_int_equal(
            pal_h5_write(file[k], "/x", PALPATE_H5_I32, 0, NULL, &value, NULL, NULL, &error),
            PALPATE_OK);
    }
    for (int k = 0; k < 2; k++) {
        assert_int_equal(pal_h5_take_image(file[k], &image[k], &size[k], &error), PALPATE_OK);
    }
    for (int k = 0; k < 2; k++) {
        assert_int_equal(pal_h5_open_image(image[k], size[k], &file[k], &error), PALPATE_OK);
    }
    for (int k = 0; k < 2; k++) {
        int32_t value = 0;
        assert_int_equal(pal_h5_read(file[k], "/x", PALPATE_H5_I32, 0, NULL, &value, &error),
                         PALPATE_OK);
        assert_int_equal(value, 7 + k);
        assert_int_equal(pal_h5_close(file[k], &error), PALPATE_OK);
        free(image[k]);
    }
}

// ---- h5 itself ----------------------------------------------------------------------------------

static void h5_files_on_disk_are_written_row_by_row(void **state) {
    (void)state;
    pal_h5 *file;
    pal_error error = {0};
    int64_t dims[2] = {10, 3}, found[2], wrong[2] = {10, 4};
    assert_int_equal(pal_h5_create(path, PALPATE_USER_BLOCK, 0, &file, &error), PALPATE_OK);
    assert_int_equal(pal_h5_declare(file, "/a/b", PALPATE_H5_I64, 2, dims, "m", "d", &error),
                     PALPATE_OK);
    int64_t rows[10][5];
    for (int i = 0; i < 10; i++) {
        for (int j = 0; j < 5; j++) {
            rows[i][j] = 10 * i + j;
        }
    }
    for (int i = 0; i < 10; i += 2) {
        assert_int_equal(pal_h5_write_rows(file, "/a/b", PALPATE_H5_I64, i, 2, 5, rows[i], &error),
                         PALPATE_OK);
    }
    assert_int_equal(pal_h5_write_rows(file, "/a/b", PALPATE_H5_I64, 9, 2, 5, rows, &error),
                     PALPATE_ERROR_IO);
    assert_int_equal(pal_h5_write_rows(file, "/a/b", PALPATE_H5_I64, 0, 2, 2, rows, &error),
                     PALPATE_ERROR_IO);
    assert_int_equal(pal_h5_write_rows(file, "/none", PALPATE_H5_I64, 0, 2, 0, rows, &error),
                     PALPATE_ERROR_IO);
    assert_int_equal(pal_h5_write_text(file, "/a/t", "", NULL, &error), PALPATE_OK);
    assert_int_equal(pal_h5_describe(file, "/a", "group", &error), PALPATE_OK);
    assert_int_equal(pal_h5_describe(file, "/c", "group", &error), PALPATE_OK);
    assert_int_equal(pal_h5_declare(file, "/a/b", PALPATE_H5_I64, 2, dims, NULL, NULL, &error),
                     PALPATE_ERROR_IO);
    int64_t out_of_range[2] = {INT64_MAX, INT64_MAX};
    assert_int_equal(
        pal_h5_declare(file, "/x", PALPATE_H5_I64, 2, out_of_range, NULL, NULL, &error),
        PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_h5_close(file, &error), PALPATE_OK);

    assert_int_equal(pal_file_seal_path(PALPATE_FILE_RECORDING, 3, path, &error), PALPATE_OK);
    assert_int_equal(pal_file_verify_path(PALPATE_FILE_RECORDING, 3, path, &error), PALPATE_OK);
    assert_int_equal(pal_file_verify_path(PALPATE_FILE_RECORDING, 2, path, &error),
                     PALPATE_ERROR_VERSION);
    assert_int_equal(pal_file_seal_path(PALPATE_FILE_RECORDING, 3, "/no/such/file", &error),
                     PALPATE_ERROR_IO);
    char brief[300];
    (void)snprintf(brief, sizeof brief, "%s/brief", directory);
    spill(brief, "too short to be sealed", 22);
    assert_int_equal(pal_file_seal_path(PALPATE_FILE_RECORDING, 3, brief, &error),
                     PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "too short"));
    assert_int_equal(pal_h5_open_file(path, &file, &error), PALPATE_OK);
    assert_int_equal(pal_h5_dims(file, "/a/b", PALPATE_H5_I64, 2, found, &error), PALPATE_OK);
    assert_int_equal(found[0], 10);
    assert_int_equal(found[1], 3);
    int64_t back[4][7] = {{0}};
    assert_int_equal(pal_h5_read_rows(file, "/a/b", PALPATE_H5_I64, 2, dims, 3, 4, 7, back, &error),
                     PALPATE_OK);
    for (int i = 0; i < 4; i++) {
        assert_memory_equal(back[i], rows[3 + i], 24);
        assert_int_equal(back[i][3], 0);
    }
    assert_int_equal(pal_h5_read(file, "/a/b", PALPATE_H5_I64, 2, wrong, back, &error),
                     PALPATE_ERROR_FORMAT);
    assert_int_equal(pal_h5_read_rows(file, "/a/b", PALPATE_H5_I64, 2, dims, 8, 3, 0, back, &error),
                     PALPATE_ERROR_FORMAT);
    assert_int_equal(
        pal_h5_read_rows(file, "/a/b", PALPATE_H5_I64, 2, dims, -1, 3, 0, back, &error),
        PALPATE_ERROR_FORMAT);
    char text[4] = "zzz";
    assert_int_equal(pal_h5_read_text(file, "/a/t", text, sizeof text, &error), PALPATE_OK);
    assert_string_equal(text, "");
    assert_false(pal_h5_has(file, "/a/x"));
    assert_false(pal_h5_has(file, "a"));
    assert_true(pal_h5_has(file, "/a/b"));
    assert_int_equal(pal_h5_close(file, &error), PALPATE_OK);
    assert_int_equal(pal_h5_open_file("/no/such", &file, &error), PALPATE_ERROR_IO);
    assert_int_equal(pal_h5_open_file("/dev/null", &file, &error), PALPATE_ERROR_IO);
    assert_int_equal(pal_h5_create("/no/such/file", 0, 0, &file, &error), PALPATE_ERROR_IO);
    assert_null(file);
    assert_int_equal(pal_h5_close(NULL, NULL), PALPATE_OK);
    assert_int_equal(pal_h5_type_size((pal_h5_type)99), 0);
    void *image;
    size_t size;
    assert_int_equal(pal_h5_create(path, 0, 0, &file, &error), PALPATE_OK);
    assert_int_equal(pal_h5_take_image(file, &image, &size, &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_h5_create(NULL, 0, 0, &file, &error), PALPATE_OK); // dropped unfinished
    assert_int_equal(pal_h5_close(file, &error), PALPATE_OK);
}

int main(void) {
#define IN_DIRECTORY(test) cmocka_unit_test_setup_teardown(test, enter_directory, leave_directory)
    const struct CMUnitTest tests[] = {
        IN_DIRECTORY(round_trips_keep_every_bit),
        IN_DIRECTORY(models_without_patches_probes_or_columns_round_trip),
        IN_DIRECTORY(invalid_models_are_not_written),
        IN_DIRECTORY(h5dump_reads_it),
        IN_DIRECTORY(every_flipped_byte_is_found),
        IN_DIRECTORY(every_truncation_is_found),
        IN_DIRECTORY(foreign_newer_and_stale_files_are_told_apart),
        IN_DIRECTORY(unreadable_things_are_io_errors),
        IN_DIRECTORY(damage_behind_the_gate_is_refused),
        IN_DIRECTORY(saving_where_one_cannot_leaves_nothing),
        IN_DIRECTORY(a_full_disk_leaves_the_old_file),
        IN_DIRECTORY(two_processes_saving_at_once_end_with_one_good_file),
        IN_DIRECTORY(threads_load_and_save_side_by_side),
        IN_DIRECTORY(two_images_open_at_once_stay_apart),
        IN_DIRECTORY(h5_files_on_disk_are_written_row_by_row),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
