/// @file compress.c  Bench: bytes, error and time of a field against the form its rows are stored
/// in.
///
/// Real bodies, each precomputed once with all rows in single precision; then the same rows in
/// half, in scaled 16-bit integers, and in what store.tolerance picks at 1e-2, 1e-3 and 1e-4. For
/// each form:
///   bytes    of the stored rows
///   error    worst max |du| / max |u| over 64 contacts that the choice has not seen
///   (field_sample.h) us       one field with 45 and with 15 nodes touched: median of thread CPU
///   times, the forms
///            interleaved, every call another contact, so that touched columns come from wherever
///            they lie
///   times    faster than single precision (m x N, in this library's own kernel), median of the
///   rounds' ratios predicted  what precompute says the field costs
///
///     bench/compress [--quick | --large]     (--quick: small bodies; --large adds 20k stored
///     nodes)
/// writes bench/results/compress.csv, compress.png (gnuplot).
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <palpate/precompute.h>
#include <palpate/scene.h>

#include "haptic/engine/field_model.h"
#include "haptic/model/model.h"
#include "src/store/compress.h"
#include "src/store/field_sample.h"

enum { FORMS = 6, ROUNDS = 25, CONTACTS = 64 };

typedef struct form {
    const char *name;
    double tolerance; ///< of store.tolerance; 0: `precision`
    pal_precision precision;
} form;

static const form forms[FORMS] = {{"single", 0, PALPATE_PRECISION_SINGLE},
                                  {"half", 0, PALPATE_PRECISION_HALF},
                                  {"scaled", 0, PALPATE_PRECISION_SCALED},
                                  {"tolerance 1e-2", 1e-2, PALPATE_PRECISION_SINGLE},
                                  {"tolerance 1e-3", 1e-3, PALPATE_PRECISION_SINGLE},
                                  {"tolerance 1e-4", 1e-4, PALPATE_PRECISION_SINGLE}};

static const struct {
    const char *name, *scene; ///< NULL: the liver of ../shared
    const char *set;
    int size; ///< 0 quick, 1 default, 2 large
} bodies[] = {{"block", "scenes/block.yaml", "store.displacement=all", 0},
              {"hemisphere", "scenes/hemisphere.yaml", "store.displacement=all", 0},
              {"organ", "scenes/organ.yaml", "store.displacement=all", 0},
              {"liver 7.5 mm", NULL, "body.spacing=0.0075", 0},
              {"liver 5.5 mm", NULL, "body.spacing=0.0055", 1},
              {"liver 4.5 mm", NULL, "body.spacing=0.0045", 1},
              {"liver 3.7 mm", NULL, "body.spacing=0.0037", 2}};

static double cpu_seconds(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static double wall_seconds(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *v, int count) {
    qsort(v, (size_t)count, sizeof *v, by_value);
    return v[count / 2];
}

static int fail(const char *what, const pal_error *error) {
    (void)fprintf(stderr, "bench/compress: %s: %s\n", what, error->message);
    return 1;
}

/// A scene on the liver of ../shared, in a temporary file.
static int write_liver(char path[64]) {
    char here[512];
    (void)snprintf(path, 64, "/tmp/palpate-bench-XXXXXX");
    int fd = realpath("../shared/data/liver2.obj", here) != NULL ? mkstemp(path) : -1;
    FILE *f = fd >= 0 ? fdopen(fd, "w") : NULL;
    if (f == NULL) {
        return 0;
    }
    (void)fprintf(f,
                  "palpate: 1\nestimate: false\nbody:\n  geometry: {file: %s, scale: 0.1}\n  "
                  "spacing: 0.0075\n"
                  "  material: {young: 5e3, poisson: 0.47}\n  fixed: [{above: {y: -0.01}}]\n"
                  "  touchable: [{ball: {center: [-0.04, -0.09, 1.5], radius: 0.05}}]\n"
                  "store: {displacement: all}\n",
                  here);
    return fclose(f) == 0;
}

static pal_model *body_model(size_t k, pal_error *error) {
    char path[64] = "";
    const char *set[] = {bodies[k].set, "estimate=false", NULL};
    if (bodies[k].scene == NULL && !write_liver(path)) {
        (void)snprintf(error->message, sizeof error->message, "no ../shared/data/liver2.obj");
        return NULL;
    }
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    if (pal_scene_load(path[0] != 0 ? path : bodies[k].scene, set, 2, &scene, error) ==
        PALPATE_OK) {
        (void)pal_precompute(scene, NULL, &model, error);
    }
    pal_scene_free(scene);
    if (path[0] != 0) {
        (void)unlink(path);
    }
    return model;
}

/// One field [s].
static double time_field(const pal_model *m, const pal_sample_contact *c, void *scratch,
                         float *out) {
    float f32[3 * PALPATE_SAMPLE_NODES];
    for (int32_t k = 0; k < c->count; k++) {
        f32[k] = (float)(c->force[k] * pal_model_unit(m, c->dof[k]));
    }
    double start = cpu_seconds();
    pal_field_compute(pal_field_best(), m, c->count, c->dof, c->force, f32, scratch, out);
    return cpu_seconds() - start;
}

/// Medians over rounds: us of each form and its ratio to the first.
static void time_forms(const pal_model rows[FORMS], const pal_field_sample *sample, int32_t nodes,
                       double us[FORMS], double ratio[FORMS]) {
    size_t floats = 0, bytes = 0;
    for (int f = 0; f < FORMS; f++) {
        floats = (size_t)pal_field_floats(&rows[f]) > floats ? (size_t)pal_field_floats(&rows[f])
                                                             : floats;
        bytes =
            pal_field_scratch_bytes(&rows[f]) > bytes ? pal_field_scratch_bytes(&rows[f]) : bytes;
    }
    float *out = aligned_alloc(64, (floats * sizeof *out + 64) / 64 * 64);
    void *scratch = aligned_alloc(64, bytes + 64);
    double each[FORMS][ROUNDS], over[FORMS][ROUNDS];
    memset(scratch, 0, bytes + 64);
    for (int r = 0; r < ROUNDS; r++) {
        for (int f = 0; f < FORMS; f++) {
            double t[CONTACTS];
            int n = 0;
            for (int32_t s = 0; s < sample->count; s++) {
                const pal_sample_contact *c = &sample->contact[s];
                if (c->count == 3 * nodes) {
                    t[n++] = time_field(&rows[f], c, scratch, out);
                }
            }
            each[f][r] = median(t, n);
            over[f][r] = each[0][r] / each[f][r];
        }
    }
    for (int f = 0; f < FORMS; f++) {
        us[f] = 1e6 * median(each[f], ROUNDS);
        ratio[f] = median(over[f], ROUNDS);
    }
    free(out);
    free(scratch);
}

static const char *stored_as(const pal_model *m) {
    static const char *const precision[] = {"double", "single", "half", "scaled"};
    return m->bases != NULL ? "bases" : precision[m->info.precision];
}

static int bench_body(size_t k, FILE *csv) {
    pal_error error = {0};
    pal_model *model = body_model(k, &error);
    if (model == NULL) {
        return fail(bodies[k].name, &error);
    }
    pal_model rows[FORMS]; // borrow all of the model but the rows
    double worst[FORMS], us[2][FORMS], ratio[2][FORMS], seconds[FORMS];
    pal_field_sample sample;
    int status = pal_field_sample_make(model, 99, CONTACTS, &sample, &error) != PALPATE_OK;
    for (int f = 0; status == 0 && f < FORMS; f++) {
        double start = wall_seconds();
        status = pal_rows_convert(model, forms[f].precision, &rows[f], &error) != PALPATE_OK ||
                 pal_compress(&rows[f], forms[f].tolerance, NULL, &error) != PALPATE_OK ||
                 pal_field_sample_error(&sample, &rows[f], &worst[f], NULL, &error) != PALPATE_OK;
        seconds[f] = wall_seconds() - start;
    }
    if (status != 0) {
        return fail(bodies[k].name, &error);
    }
    time_forms(rows, &sample, PALPATE_SAMPLE_NODES, us[0], ratio[0]);
    time_forms(rows, &sample, 15, us[1], ratio[1]);
    for (int f = 0; f < FORMS; f++) {
        const pal_model *m = &rows[f];
        double mb = 1e-6 * (double)pal_model_row_bytes(m);
        printf("%-13s %6d %5d  %-15s %-7s %8.2f %9.1e | %8.1f %6.2f | %8.1f %6.2f | %8.1f %6.1f\n",
               bodies[k].name, (int)m->info.row_count, (int)m->info.column_count, forms[f].name,
               stored_as(m), mb, worst[f], us[0][f], ratio[0][f], us[1][f], ratio[1][f],
               m->info.field_us, seconds[f]);
        (void)fprintf(csv, "%s,%d,%d,%s,%s,%llu,%.3e,%.2f,%.3f,%.2f,%.3f,%.2f,%.2f,%d,%d,%d\n",
                      bodies[k].name, (int)m->info.row_count, (int)m->info.column_count,
                      forms[f].name, stored_as(m), (unsigned long long)pal_model_row_bytes(m),
                      worst[f], us[0][f], ratio[0][f], us[1][f], ratio[1][f], m->info.field_us,
                      seconds[f], m->bases != NULL ? (int)m->bases->cluster_count : 0,
                      m->bases != NULL ? (int)m->bases->rank : 0,
                      m->bases != NULL ? (int)m->bases->pair_count : 0);
        pal_rows_clear(&rows[f]);
    }
    (void)fflush(stdout);
    (void)fflush(csv);
    pal_field_sample_clear(&sample);
    pal_model_free(model);
    return 0;
}

/// Time over stored nodes, and bytes, with gnuplot (silently left out where it is missing).
static void plot(void) {
    FILE *g = popen("gnuplot 2>/dev/null", "w");
    if (g == NULL) {
        return;
    }
    (void)fprintf(g, "set datafile separator ','\nset terminal pngcairo size 1100,480\n"
                     "set output 'bench/results/compress.png'\nset multiplot layout 1,2\n"
                     "set logscale xy\nset grid\nset key top left\nset xlabel 'stored nodes'\n");
    static const char *const axis[] = {"field with 45 nodes touched [us, one core]",
                                       "stored rows [MB]"};
    static const char *const value[] = {"8", "($6/1e6)"};
    for (int p = 0; p < 2; p++) {
        (void)fprintf(g, "set ylabel '%s'\nplot", axis[p]);
        for (int f = 0; f < FORMS; f++) {
            (void)fprintf(
                g, "%s '< grep \",%s,\" bench/results/compress.csv' using 2:%s title '%s' pt %d",
                f > 0 ? "," : "", forms[f].name, value[p], forms[f].name, 4 + f);
        }
        (void)fprintf(g, p == 0 ? ", 300 title '300 us' dt 2\n" : "\n");
    }
    (void)pclose(g);
}

int main(int argc, char **argv) {
    int size = argc > 1 && strcmp(argv[1], "--quick") == 0   ? 0
               : argc > 1 && strcmp(argv[1], "--large") == 0 ? 2
                                                             : 1;
    FILE *csv = fopen("bench/results/compress.csv", "w");
    if (csv == NULL) {
        (void)fprintf(
            stderr, "bench/compress: cannot write bench/results/compress.csv: run from the root\n");
        return 1;
    }
    (void)fprintf(csv, "body,stored,columns,asked,stored_as,bytes,error,us_45,over_single_45,us_15,"
                       "over_single_15,predicted_us,compress_s,clusters,rank,pairs\n");
    printf("kernel %s; times are medians of %d interleaved rounds\n",
           pal_isa_name(pal_field_best()), ROUNDS);
    printf("%-13s %6s %5s  %-15s %-7s %8s %9s | %8s %6s | %8s %6s | %8s %6s\n", "body", "stored",
           "cols", "asked", "form", "MB", "error", "us m=45", "times", "us m=15", "times",
           "predict", "s");
    for (size_t k = 0; k < sizeof bodies / sizeof *bodies; k++) {
        if (bodies[k].size <= size && bench_body(k, csv) != 0) {
            (void)fclose(csv);
            return 1;
        }
    }
    (void)fclose(csv);
    plot();
    printf("written: bench/results/compress.csv, compress.png\n");
    return 0;
}
