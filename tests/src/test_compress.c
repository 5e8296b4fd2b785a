/// Compressed rows: the error they promise, the same bits on every processor, files that survive
/// and files that lie, and whoever else reads rows: columns, press, engine, both sides of a
/// snapshot.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include <palpate/engine.h>
#include <palpate/precompute.h>

#include "haptic/engine/engine.h"
#include "haptic/engine/field_model.h"
#include "haptic/model/model.h"
#include "src/store/compress.h"
#include "src/store/field_sample.h"
#include "src/store/row_clusters.h"
#include "tests/support/scene_text.h"
#include "tests/support/synthetic_model.h"

static pal_error error;
#define OK(call)                                                                                   \
    do {                                                                                           \
        pal_status ok_ = (call);                                                                   \
        if (ok_ != PALPATE_OK) {                                                                   \
            fail_msg("%s: %d %s", #call, (int)ok_, error.message);                                 \
        }                                                                                          \
    } while (0)

static void *need(void *p) {
    assert_non_null(p);
    return p;
}

/// A box of half space, dense in single precision.
static pal_model *box(int32_t n, int32_t layers) {
    synthetic_params p = synthetic_default_params();
    p.n = n;
    p.layers = layers;
    p.rows = SYNTHETIC_ROWS_ALL;
    return need(synthetic_model(&p));
}

static pal_model *compressed_box(int32_t n, int32_t layers, double tolerance) {
    pal_model *m = box(n, layers);
    pal_rows rows;
    OK(pal_rows_compress(m, tolerance, NULL, &rows, &error));
    pal_rows_take(m, &rows);
    OK(pal_model_check(m, &error));
    assert_non_null(m->bases);
    return m;
}

static float *field_of(const pal_model *m, pal_isa isa, const pal_sample_contact *c) {
    size_t bytes = ((size_t)pal_field_floats(m) * sizeof(float) + 64) / 64 * 64;
    float *out = need(aligned_alloc(64, bytes)), f32[3 * PALPATE_SAMPLE_NODES];
    void *scratch = need(aligned_alloc(64, pal_field_scratch_bytes(m) + 64));
    memset(out, 0xff, bytes);
    memset(scratch, 0xff, pal_field_scratch_bytes(m) + 64);
    for (int32_t k = 0; k < c->count; k++) {
        f32[k] = (float)(c->force[k] * pal_model_unit(m, c->dof[k]));
    }
    pal_field_compute(isa, m, c->count, c->dof, c->force, f32, scratch, out);
    free(scratch);
    return out;
}

// ---- Error --------------------------------------------------------------------------------------

/// No column is off by more than the tolerance at any node: far columns by construction, near ones
/// are stored. On top come the integers: half a step, 2^-16 of a column's largest number, for S, U
/// and D; coefficients of a cluster of 128 nodes reach sqrt(128) times the displacement.
static void every_column_is_within_the_tolerance(void **state) {
    (void)state;
    static const double tolerances[] = {1e-1, 1e-2, 1e-3, 1e-4};
    for (int t = 0; t < 4; t++) {
        pal_model *exact = box(12, 5), *m = compressed_box(12, 5, tolerances[t]);
        int32_t rows = m->info.row_count;
        double *a = need(malloc(3 * (size_t)rows * sizeof *a)), worst = 0;
        double *b = need(malloc(3 * (size_t)rows * sizeof *b));
        for (int64_t j = 0; j < 3 * (int64_t)m->info.column_count; j++) {
            OK(pal_model_load_column(exact, j, a));
            OK(pal_model_load_column(m, j, b));
            double off = 0, size = 0;
            for (int32_t i = 0; i < rows; i++) {
                double e = 0, u = 0;
                for (int d = 0; d < 3; d++) {
                    e += (a[3 * i + d] - b[3 * i + d]) * (a[3 * i + d] - b[3 * i + d]);
                    u += a[3 * i + d] * a[3 * i + d];
                }
                off = fmax(off, e);
                size = fmax(size, u);
            }
            worst = fmax(worst, sqrt(off / size));
        }
        print_message(
            "tolerance %g: columns off by %.2e at worst, %.0f of %.0f kB, %d clusters, rank %d\n",
            tolerances[t], worst, 1e-3 * (double)pal_model_row_bytes(m),
            1e-3 * (double)pal_model_row_bytes(exact), (int)m->bases->cluster_count,
            (int)m->bases->rank);
        assert_true(worst <= tolerances[t] + 3e-4);
        free(a);
        free(b);
        pal_model_free(exact);
        pal_model_free(m);
    }
}

/// A field is the sum of its columns: the kernel against double precision, single rounding allowed
/// for (135 columns, then 60 of a basis, then 135 near ones, each sum in single precision).
static void fields_are_sums_of_columns(void **state) {
    (void)state;
    pal_model *m = compressed_box(12, 5, 1e-3);
    size_t rows = 3 * (size_t)m->info.row_count;
    double *sum = need(malloc(rows * sizeof *sum)), *column = need(malloc(rows * sizeof *column));
    pal_field_sample sample;
    OK(pal_field_sample_make(m, 3, 12, &sample, &error));
    for (int32_t s = 0; s < sample.count; s++) {
        const pal_sample_contact *c = &sample.contact[s];
        float *out = field_of(m, pal_field_best(), c);
        double size = 0, off = 0;
        memset(sum, 0, rows * sizeof *sum);
        for (int32_t k = 0; k < c->count; k++) {
            OK(pal_model_load_column(m, c->dof[k], column));
            for (size_t i = 0; i < rows; i++) {
                sum[i] += c->force[k] * column[i];
            }
        }
        for (size_t i = 0; i < rows; i++) {
            size = fmax(size, fabs(sum[i]));
            off = fmax(off, fabs((double)out[i] - sum[i]));
        }
        assert_true(off <= 1e-5 * size);
        for (int64_t i = (int64_t)rows; i < pal_field_floats(m); i++) {
            assert_true(out[i] == 0.0f);
        }
        free(out);
    }
    pal_field_sample_clear(&sample);
    free(sum);
    free(column);
    pal_model_free(m);
}

static void variants_agree_bit_for_bit(void **state) {
    (void)state;
    pal_model *m = compressed_box(12, 5, 1e-3);
    pal_field_sample sample;
    OK(pal_field_sample_make(m, 5, 16, &sample, &error));
    sample.contact[15].count = 0; // nothing touched
    for (int32_t s = 0; s < sample.count; s++) {
        float *twin = field_of(m, PALPATE_ISA_SCALAR, &sample.contact[s]);
        for (int isa = PALPATE_ISA_PORTABLE; isa < PALPATE_ISA_COUNT; isa++) {
            if (pal_field_available((pal_isa)isa)) {
                float *out = field_of(m, (pal_isa)isa, &sample.contact[s]);
                assert_memory_equal(out, twin, (size_t)pal_field_floats(m) * sizeof *out);
                free(out);
            }
        }
        assert_true(s < 15 || twin[0] == 0.0f);
        free(twin);
    }
    pal_field_sample_clear(&sample);
    pal_model_free(m);
}

/// One body of each kind, small enough for every sanitizer: a hemisphere, a box, an organ.
static const struct {
    const char *name, *text;
} BODIES[] = {
    {"hemisphere", "palpate: 1\nestimate: false\ncertify: warn\n"
                   "body:\n  geometry: {hemisphere: {radius: 0.05}}\n  spacing: 0.009\n"
                   "  material: {young: 10e3, poisson: 0.45}\n  fixed: [{below: {z: 0.0}}]\n"
                   "  touchable: [{ball: {center: [0, 0, 0.05], radius: 0.03}}]\n"
                   "store: {displacement: all}\n"},
    {"box", "palpate: 1\nestimate: false\ncertify: warn\n"
            "body:\n  geometry: {box: {size: [0.2, 0.08, 0.06]}}\n  spacing: 0.01\n"
            "  material: {young: 10e3, poisson: 0.3}\n  fixed: [{below: {x: -0.1}}]\n"
            "  touchable: [{ball: {center: [0.02, 0, 0.03], radius: 0.035}}]\n"
            "store: {displacement: all}\n"},
    {"liver", "palpate: 1\nestimate: false\ncertify: warn\n"
              "body:\n  geometry: {file: ../shared/data/liver2.obj, scale: 0.1}\n  spacing: 0.014\n"
              "  material: {young: 5e3, poisson: 0.47}\n  fixed: [{above: {y: -0.01}}]\n"
              "  touchable: [{ball: {center: [-0.04, -0.09, 1.5], radius: 0.05}}]\n"
              "store: {displacement: all}\n"},
};

/// What the program would do: choose by a tolerance, then be held to it by contacts that it did not
/// choose by.
static void the_tolerance_holds_on_bodies(void **state) {
    (void)state;
    static const double tolerances[] = {1e-2, 1e-3, 1e-4, 5e-6};
    for (size_t k = 0; k < sizeof BODIES / sizeof *BODIES; k++) {
        char text[1024], here[512];
        pal_scene *scene;
        pal_model *exact;
        FILE *there = fopen("../shared/data/liver2.obj", "re");
        if (there != NULL) {
            (void)fclose(there);
        } else if (k == 2) {
            print_message("../shared is absent: no liver\n");
            continue;
        }
        // scenes resolve paths by their own file, which is a temporary one here
        const char *file = strstr(BODIES[k].text, "../shared");
        if (file != NULL && realpath("../shared", here) != NULL) {
            (void)snprintf(text, sizeof text, "%.*s%s%s", (int)(file - BODIES[k].text),
                           BODIES[k].text, here, file + strlen("../shared"));
        } else {
            (void)snprintf(text, sizeof text, "%s", BODIES[k].text);
        }
        OK(test_scene_load(text, (const char *const[]){"store.precision=double", NULL}, &scene,
                           &error));
        OK(pal_precompute(scene, NULL, &exact, &error));
        pal_scene_free(scene);
        for (int t = k == 2; t < (k == 2 ? 3 : 4); t++) { // the liver is the slowest
            pal_rows own;
            OK(pal_rows_convert(exact, PALPATE_PRECISION_DOUBLE, &own, &error));
            pal_model copy = *exact; // borrows all but the rows
            copy.c_st = NULL;
            copy.column_scale = NULL;
            copy.bases = NULL;
            pal_rows_take(&copy, &own);
            OK(pal_compress(&copy, tolerances[t], NULL, &error));
            pal_field_sample other;
            double worst;
            OK(pal_field_sample_make(exact, 77, 64, &other, &error));
            OK(pal_field_sample_error(&other, &copy, &worst, NULL, &error));
            static const char *const precision[] = {"double", "single", "half", "scaled"};
            print_message(
                "%-10s tolerance %.0e: %s, %6.0f kB, sampled %.1e, other contacts %.1e, %.1f us\n",
                BODIES[k].name, tolerances[t],
                copy.bases != NULL ? "bases" : precision[copy.info.precision],
                1e-3 * (double)pal_model_row_bytes(&copy), copy.info.field_error, worst,
                copy.info.field_us);
            assert_true(worst <= tolerances[t]);
            assert_true(copy.info.field_error <= 0.75 * tolerances[t] && copy.info.field_error > 0);
            assert_true(copy.info.field_tolerance == tolerances[t]);
            // what is more exact than integers of 16 bits is not stored in them
            assert_true(tolerances[t] > 1e-5 || copy.info.precision == PALPATE_PRECISION_SINGLE);
            pal_rows_clear(&copy);
            if (tolerances[t] >=
                1e-3) { // bases too where they are not the cheapest, columns 8 times closer
                pal_rows bases;
                OK(pal_rows_compress(exact, tolerances[t] / 8, NULL, &bases, &error));
                OK(pal_field_sample_error(&other, &bases, &worst, NULL, &error));
                print_message("%-10s bases at %.0e: %.1e\n", "", tolerances[t] / 8, worst);
                assert_true(worst <= tolerances[t]);
                pal_rows_clear(&bases);
            }
            pal_field_sample_clear(&other);
        }
        pal_model_free(exact);
    }
}

/// Scaled integers against IEEE half at equal bytes.
static void scaled_beats_half(void **state) {
    (void)state;
    pal_model *m = box(14, 6);
    pal_field_sample sample;
    double err[2];
    static const pal_precision form[] = {PALPATE_PRECISION_HALF, PALPATE_PRECISION_SCALED};
    OK(pal_field_sample_make(m, 9, 32, &sample, &error));
    for (int k = 0; k < 2; k++) {
        pal_rows rows;
        OK(pal_rows_convert(m, form[k], &rows, &error));
        OK(pal_field_sample_error(&sample, &rows, &err[k], NULL, &error));
        pal_rows_clear(&rows);
    }
    print_message("half %.2e, scaled %.2e\n", err[0], err[1]);
    assert_true(err[1] < 0.5 * err[0]);
    pal_field_sample_clear(&sample);
    pal_model_free(m);
}

static void only_dense_rows_can_be_compressed(void **state) {
    (void)state;
    pal_model *m = compressed_box(6, 3, 1e-2);
    pal_rows rows;
    assert_int_equal(pal_rows_compress(m, 1e-2, NULL, &rows, &error), PALPATE_ERROR_ARGUMENT);
    pal_rows half;
    pal_model *dense = box(6, 3);
    OK(pal_rows_convert(dense, PALPATE_PRECISION_HALF, &half, &error));
    pal_rows_take(dense, &half);
    assert_int_equal(pal_rows_compress(dense, 1e-2, NULL, &rows, &error), PALPATE_ERROR_ARGUMENT);
    pal_model_free(dense);
    dense = box(6, 3);
    assert_int_equal(pal_rows_compress(dense, 0, NULL, &rows, &error), PALPATE_ERROR_ARGUMENT);
    pal_model_free(dense);
    pal_model_free(m);
}

static int stop(void *user, const char *stage, double fraction, double seconds) {
    (void)fraction;
    (void)seconds;
    ++*(int *)user;
    return strcmp(stage, "compress") == 0;
}

static void it_can_be_cancelled(void **state) {
    (void)state;
    pal_model *m = box(14, 6);
    pal_rows rows;
    int called = 0;
    const pal_progress progress = {.call = stop, .user = &called};
    // another thread may take all the work before this one is asked: then nothing is cancelled
    pal_status status = pal_rows_compress(m, 1e-3, &progress, &rows, &error);
    assert_int_equal(status, called > 0 ? PALPATE_ERROR_CANCELLED : PALPATE_OK);
    if (status == PALPATE_OK) {
        pal_rows_clear(&rows);
    }
    assert_null(rows.c_st);
    assert_null(rows.bases);
    pal_model_free(m);
}

// ---- Those who read rows ------------------------------------------------------------------------

/// Press sums columns: compressed and dense agree within the tolerance.
static void press_reads_compressed_rows(void **state) {
    (void)state;
    pal_model *dense = box(10, 5), *m = compressed_box(10, 5, 1e-3);
    pal_press a, b;
    const double by[3] = {0, 1e-4, -1e-3};
    OK(pal_model_press(dense, "centre", by, &a, &error));
    OK(pal_model_press(m, "centre", by, &b, &error));
    double off = 0;
    for (int32_t i = 0; i < 3 * m->info.row_count; i++) {
        off = fmax(off, fabs(a.displacement[i] - b.displacement[i]));
    }
    assert_memory_equal(a.force, b.force, sizeof a.force); // the force does not know
    // 12 nodes bonded: forces of both signs at the rim add errors up to a few times a column's
    assert_true(off <= 5e-3 * 1e-3);
    pal_press_clear(&a);
    pal_press_clear(&b);
    pal_model_free(dense);
    pal_model_free(m);
}

/// The engine's frames: the servo's field and the reader's own are the same bits, and both the sum.
static void frames_hold_the_compressed_field(void **state) {
    (void)state;
    pal_model *m = compressed_box(10, 5, 1e-3);
    const pal_tool_def tool = {.name = "probe", .shape = PALPATE_SHAPE_SPHERE, .radius = 0.006};
    pal_engine *engine[2];
    pal_frame frame[2];
    for (int by = 0; by < 2; by++) {
        pal_engine_def def = pal_engine_default_def();
        def.tool_count = 1;
        def.tools = &tool;
        def.reader_count = 1;
        def.frame_age = 1;
        def.field_by = by == 0 ? PALPATE_FIELD_BY_SERVO : PALPATE_FIELD_BY_READER;
        OK(pal_engine_create(m, &def, &engine[by], &error));
        for (int k = 0; k < 20; k++) {
            pal_tool_state in = {.position = {1e-4 * k, 0, 0.006 - 1e-4 * k},
                                 .orientation = {1, 0, 0, 0}};
            pal_tool_force out;
            (void)pal_engine_tick(engine[by], &in, &out);
        }
        assert_int_equal(pal_engine_snapshot(pal_engine_reader(engine[by], 0), &frame[by]), 1);
    }
    assert_int_equal(frame[0].tick, frame[1].tick);
    assert_memory_equal(frame[0].displacement, frame[1].displacement,
                        3 * (size_t)m->info.row_count * sizeof(float));
    const pal_contact_result *result = &engine[0]->result;
    assert_true(result->dof_count > 0);
    size_t rows = 3 * (size_t)m->info.row_count;
    double *sum = need(calloc(rows, sizeof *sum)), *column = need(malloc(rows * sizeof *column));
    double size = 0;
    for (int32_t k = 0; k < result->dof_count; k++) {
        OK(pal_model_load_column(m, result->dof[k], column));
        for (size_t i = 0; i < rows; i++) {
            sum[i] += result->force[k] * column[i];
            size = fmax(size, fabs(sum[i]));
        }
    }
    for (size_t i = 0; i < rows; i++) {
        assert_true(fabs(sum[i] - (double)frame[0].displacement[i]) <= 1e-5 * size); // single sums
    }
    free(sum);
    free(column);
    pal_engine_free(engine[0]);
    pal_engine_free(engine[1]);
    pal_model_free(m);
}

// ---- Files --------------------------------------------------------------------------------------

static void files_keep_every_bit(void **state) {
    (void)state;
    pal_model *m = compressed_box(10, 4, 1e-3), *again;
    m->info.field_error = 4e-4;
    m->info.field_tolerance = 1e-3;
    m->info.field_us = 12;
    void *image, *second;
    size_t size, size2;
    OK(pal_model_image(m, &image, &size, &error));
    uint32_t version;
    memcpy(&version, (char *)image + 16, sizeof version);
    assert_int_equal(version, 2); // programs that know version 1 alone refuse it by that
    OK(pal_model_parse(image, size, &again, &error));
    const pal_row_bases *a = m->bases, *b = again->bases;
    assert_non_null(b);
#define SAME(member, count)                                                                        \
    assert_memory_equal(a->member, b->member, (size_t)(count) * sizeof *a->member)
    SAME(cluster_start, a->cluster_count + 1);
    SAME(row_order, m->info.row_count);
    SAME(rank_start, a->cluster_count + 1);
    SAME(group_start, a->group_count + 1);
    SAME(column_order, m->info.column_count);
    SAME(pair_start, a->group_count + 1);
    SAME(pair_cluster, a->pair_count);
    SAME(basis, a->basis_start[a->cluster_count]);
    SAME(basis_scale, a->rank);
    SAME(near, a->near_start[a->pair_count]);
    SAME(near_scale, a->near_scale_start[a->pair_count]);
#undef SAME
    assert_memory_equal(m->column_scale, again->column_scale,
                        3 * (size_t)m->info.column_count * sizeof(double));
    assert_true(again->info.field_error == 4e-4 && again->info.field_tolerance == 1e-3 &&
                again->info.field_us == 12);
    pal_model_info info;
    pal_model_get_info(again, &info);
    assert_int_equal(info.row_clusters, a->cluster_count);
    assert_int_equal(info.row_rank, a->rank);
    assert_true(info.row_bytes == pal_model_row_bytes(m) && info.row_bytes > 0);
    OK(pal_model_image(again, &second, &size2, &error));
    assert_int_equal(size, size2);
    assert_memory_equal(image, second, size);
    free(image);
    free(second);
    pal_model_free(m);
    pal_model_free(again);
}

static void refused(const pal_model *m, int line) {
    error.message[0] = 0;
    pal_status status = pal_model_check(m, &error);
    if (status != PALPATE_ERROR_ARGUMENT || strlen(error.message) < 10) {
        fail_msg("line %d: %d %s", line, (int)status, error.message);
    }
}
#define REFUSED(place, value)                                                                      \
    do {                                                                                           \
        __auto_type old_ = (place);                                                                \
        (place) = (value);                                                                         \
        refused(m, __LINE__);                                                                      \
        (place) = old_;                                                                            \
        OK(pal_model_check(m, &error));                                                            \
    } while (0)

static void check_finds_every_kind_of_damage(void **state) {
    (void)state;
    pal_model *m = compressed_box(10, 4, 1e-3);
    pal_row_bases *b = m->bases;
    assert_true(b->cluster_count > 1 && b->group_count > 1 && b->pair_count > 1);
    REFUSED(m->info.precision, PALPATE_PRECISION_HALF);
    REFUSED(b->cluster_count, 0);
    REFUSED(b->cluster_count, b->cluster_count - 1);
    REFUSED(b->group_count, b->group_count - 1);
    REFUSED(b->group_count, m->info.column_count + 1);
    REFUSED(b->pair_count, -1);
    REFUSED(b->pair_count, b->pair_count + 1);
    REFUSED(b->rank, -1);
    REFUSED(b->rank, b->rank + 1);
    REFUSED(b->cluster_start[0], 1);
    REFUSED(b->cluster_start[1], 0);
    REFUSED(b->cluster_start[1], m->info.row_count + 5);
    REFUSED(b->cluster_start[b->cluster_count], m->info.row_count - 1);
    REFUSED(b->rank_start[1], -1);
    REFUSED(b->rank_start[1], b->rank + 1);
    REFUSED(b->rank_start[1], b->rank_start[1] + 1); // the bases would move
    REFUSED(b->row_order[0], b->row_order[1]);
    REFUSED(b->row_order[0], -1);
    REFUSED(b->row_order[0], m->info.row_count);
    REFUSED(b->group_start[1], 0);
    REFUSED(b->group_start[1], b->group_start[1] + 1);
    REFUSED(b->column_order[0], b->column_order[1]);
    REFUSED(b->column_order[0], m->info.column_count);
    REFUSED(b->pair_start[1], b->pair_count + 1);
    REFUSED(b->pair_start[1], -1);
    REFUSED(b->pair_cluster[0], -1);
    REFUSED(b->pair_cluster[0], b->cluster_count);
    REFUSED(b->pair_cluster[1], b->pair_cluster[0]);
    REFUSED(b->basis_scale[0], NAN);
    REFUSED(b->near_scale[0], INFINITY);
    REFUSED(b->basis, NULL);
    REFUSED(b->near, NULL);
    REFUSED(b->basis_scale, NULL);
    REFUSED(b->near_scale, NULL);
    REFUSED(b->row_order, NULL);
    REFUSED(b->pair_cluster, NULL);
    REFUSED(b->column_place, NULL);
    REFUSED(m->c_st, NULL);
    REFUSED(m->column_scale, NULL);
    REFUSED(m->column_scale[1], 0.0);
    REFUSED(m->row_ld, m->row_ld + 32);
    REFUSED(m->info.row_count, m->info.row_count - 1);
    pal_model_free(m);
}

/// Numbers of the /rows tables changed behind the checksums: refused, or still a model within whose
/// arrays a field stays (sanitizers watch).
static void hostile_files_are_refused_or_harmless(void **state) {
    (void)state;
    pal_model *m = compressed_box(10, 4, 1e-3);
    const pal_row_bases *b = m->bases;
    assert_true(b->rank > 8 && b->pair_count > 8 && b->group_count > 2);
    const pal_sample_contact contact = {
        .count = 6, .dof = {0, 1, 2, 30, 31, 32}, .force = {1, 2, 3, 4, 5, 6}};
    const struct {
        const void *data;
        size_t bytes;
    } tables[] = {{b->cluster_start, 4 * ((size_t)b->cluster_count + 1)},
                  {b->row_order, 4 * (size_t)m->info.row_count},
                  {b->rank_start, 4 * ((size_t)b->cluster_count + 1)},
                  {b->group_start, 4 * ((size_t)b->group_count + 1)},
                  {b->column_order, 4 * (size_t)m->info.column_count},
                  {b->pair_start, 4 * ((size_t)b->group_count + 1)},
                  {b->pair_cluster, 4 * (size_t)b->pair_count},
                  {b->basis, 64},
                  {b->basis_scale, 4 * (size_t)b->rank},
                  {b->near_scale, 256},
                  {b->near, 64}};
    enum { TABLES = sizeof tables / sizeof *tables };
    void *image;
    size_t size;
    OK(pal_model_image(m, &image, &size, &error));
    uint8_t *bytes = need(malloc(size)), *at[TABLES];
    for (int k = 0; k < TABLES; k++) {
        at[k] = need(memmem(image, size, tables[k].data, tables[k].bytes));
    }
    uint64_t random = 11;
    int bad = 0, good = 0;
    for (int k = 0; k < 1100; k++) {
        memcpy(bytes, image, size);
        for (int c = 0; c < 1 + k / TABLES % 3; c++) {
            random = random * 6364136223846793005u + 1442695040888963407u;
            size_t table = (size_t)(k % TABLES),
                   place = (size_t)(random >> 20) % (tables[table].bytes / 4);
            int32_t wild = (int32_t)(random >> 32);
            wild = k % 2 ? wild : wild % 64; // also numbers that might pass
            memcpy(bytes + (at[table] - (uint8_t *)image) + 4 * place, &wild, sizeof wild);
        }
        pal_model *got = NULL;
        pal_status status = pal_model_parse(bytes, size, &got, &error);
        if (status == PALPATE_OK) {
            free(field_of(got, pal_field_best(), &contact));
            good++;
        } else {
            assert_int_equal(status, PALPATE_ERROR_FORMAT);
            assert_int_equal(error.status, PALPATE_ERROR_FORMAT);
            bad++;
        }
        pal_model_free(got);
    }
    print_message("%d refused, %d harmless\n", bad, good);
    assert_true(bad > 500 && good > 100);
    free(bytes);
    free(image);
    pal_model_free(m);
}

// ---- Trees --------------------------------------------------------------------------------------

static void splits_are_permutations_of_small_intervals(void **state) {
    (void)state;
    pal_model *m = box(9, 4);
    int32_t n = m->info.row_count;
    int32_t *index = need(malloc((size_t)n * sizeof *index)),
            *start = need(malloc((size_t)(n + 1) * sizeof *start));
    uint8_t *seen = need(calloc((size_t)n, 1));
    for (int32_t i = 0; i < n; i++) {
        index[i] = i;
    }
    int32_t count = pal_cluster_split(m->position, m->row_node, n, 16, index, start);
    assert_true(count >= n / 16);
    assert_int_equal(start[0], 0);
    assert_int_equal(start[count], n);
    for (int32_t k = 0; k < count; k++) {
        assert_in_range(start[k + 1] - start[k], 8, 16); // halves of at least 17
    }
    for (int32_t i = 0; i < n; i++) {
        assert_false(seen[index[i]]++);
    }
    free(index);
    free(start);
    free(seen);
    pal_model_free(m);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_column_is_within_the_tolerance),
        cmocka_unit_test(fields_are_sums_of_columns),
        cmocka_unit_test(variants_agree_bit_for_bit),
        cmocka_unit_test(the_tolerance_holds_on_bodies),
        cmocka_unit_test(scaled_beats_half),
        cmocka_unit_test(only_dense_rows_can_be_compressed),
        cmocka_unit_test(it_can_be_cancelled),
        cmocka_unit_test(press_reads_compressed_rows),
        cmocka_unit_test(frames_hold_the_compressed_field),
        cmocka_unit_test(files_keep_every_bit),
        cmocka_unit_test(check_finds_every_kind_of_damage),
        cmocka_unit_test(hostile_files_are_refused_or_harmless),
        cmocka_unit_test(splits_are_permutations_of_small_intervals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
