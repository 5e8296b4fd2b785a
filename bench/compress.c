/// @file compress.c  Bench: bytes, error and time of a field against the form its rows are stored
/// in.
///
/// Real bodies, each precomputed once with all rows in single precision; then the same rows in
///   half, scaled      16 bits: IEEE halves, integers with a scale per column
///   far 8 bits        rows far from a column's node in 8 bits, near ones in 16, each group of 32
///                     neighbouring rows with a scale per column; 8 where the steps stay below
///                     0.75e-3 of the column's largest displacement. Not built into the library:
///                     this bench says why
///   bases 1e-2, 1e-3  bases (row_bases.h) at that tolerance of every column
///   tolerance ...     what store.tolerance picks
///   sgemv             OpenBLAS on the touched columns in single precision, copied side by side for
///                     it (not timed)
/// For each form:
///   bytes      of the stored rows
///   error      worst max |du| / max |u| over 64 contacts that the choice has not seen
///              (field_sample.h)
///   us         one field with 45 and with 15 nodes touched: median of thread CPU times, the forms
///              interleaved, every call another contact, so that touched columns come from wherever
///              they lie
///   times      faster than single precision (m x N, in this library's own kernel), median of the
///              rounds' ratios
///   predicted  what precompute says the field costs
/// Then the nanoseconds per unit of work (field_model.h, pal_field_work_ns) that fit these times
/// best: least squares of the relative errors, none negative.
///
///     bench/compress [--quick | --large]     (--quick: small bodies; --large adds 20k stored
///     nodes)
/// writes bench/results/compress.csv, compress.png (gnuplot).
#include <cblas.h>
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

#include <palpate/precompute.h>
#include <palpate/scene.h>

#include "bench/support/near_far.h"
#include "haptic/engine/field_model.h"
#include "haptic/model/model.h"
#include "src/store/compress.h"
#include "src/store/field_sample.h"

extern void openblas_set_num_threads(int threads);

enum { FORMS = 10, ROUNDS = 25, CONTACTS = 64, SIZES = 2, COPIES = 16, SAMPLES_MAX = 256 };
enum { CONVERTED, BASES, PICKED, NEAR_FAR, SGEMV }; ///< kinds of form
static const int32_t touched_nodes[SIZES] = {PALPATE_SAMPLE_NODES, 15};

typedef struct form {
    const char *name;
    int kind;
    double tolerance;
    pal_precision precision;
} form;

static const form forms[FORMS] = {{"single", CONVERTED, 0, PALPATE_PRECISION_SINGLE},
                                  {"half", CONVERTED, 0, PALPATE_PRECISION_HALF},
                                  {"scaled", CONVERTED, 0, PALPATE_PRECISION_SCALED},
                                  {"far 8 bits", NEAR_FAR, 0.75e-3, PALPATE_PRECISION_SCALED},
                                  {"bases 1e-2", BASES, 1e-2, PALPATE_PRECISION_SCALED},
                                  {"bases 1e-3", BASES, 1e-3, PALPATE_PRECISION_SCALED},
                                  {"tolerance 1e-2", PICKED, 1e-2, PALPATE_PRECISION_SINGLE},
                                  {"tolerance 1e-3", PICKED, 1e-3, PALPATE_PRECISION_SINGLE},
                                  {"tolerance 1e-4", PICKED, 1e-4, PALPATE_PRECISION_SINGLE},
                                  {"sgemv", SGEMV, 0, PALPATE_PRECISION_SINGLE}};

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

static double near_far_error(const near_far *x, const pal_field_sample *sample, int32_t rows,
                             float *out) {
    double worst = 0;
    for (int32_t s = 0; s < sample->count && near_far_available(); s++) {
        const double *exact = sample->field + (size_t)s * 3 * (size_t)rows;
        double off = 0, size = 0;
        near_far_field(x, sample->contact[s].count, sample->contact[s].dof,
                       sample->contact[s].force, out);
        for (int32_t i = 0; i < rows; i++) {
            double e = 0, u = 0;
            for (int d = 0; d < 3; d++) {
                double v = exact[3 * i + d];
                e += ((double)out[3 * i + d] - v) * ((double)out[3 * i + d] - v);
                u += v * v;
            }
            off = fmax(off, e);
            size = fmax(size, u);
        }
        worst = fmax(worst, size > 0 ? sqrt(off / size) : 0);
    }
    return worst;
}

// ---- One body in every form ---------------------------------------------------------------------

typedef struct body {
    pal_model *model;
    pal_model rows[FORMS]; ///< borrow all of the model but the rows
    near_far near_far;
    pal_field_sample sample;
    float *copy[SIZES][COPIES]; ///< sgemv's columns
    float *out;
    void *scratch;
    double bytes[FORMS], error[FORMS], seconds[FORMS];
    double us[SIZES][FORMS], times[SIZES][FORMS];
} body;

static void body_clear(body *b) {
    for (int f = 0; f < FORMS; f++) {
        pal_rows_clear(&b->rows[f]);
    }
    for (int k = 0; k < SIZES * COPIES; k++) {
        free(b->copy[k / COPIES][k % COPIES]);
    }
    near_far_clear(&b->near_far);
    pal_field_sample_clear(&b->sample);
    pal_model_free(b->model);
    free(b->out);
    free(b->scratch);
}

static int out_of_memory(pal_error *error) {
    (void)snprintf(error->message, sizeof error->message, "out of memory");
    return 0;
}

/// The columns of the first contacts of each size, side by side.
static int copy_columns(body *b, pal_error *error) {
    int64_t ld = 3 * (int64_t)b->model->info.row_count;
    for (int size = 0; size < SIZES; size++) {
        int n = 0;
        for (int32_t s = 0; s < b->sample.count && n < COPIES; s++) {
            const pal_sample_contact *c = &b->sample.contact[s];
            if (c->count != 3 * touched_nodes[size]) {
                continue;
            }
            float *to = aligned_alloc(64, ((size_t)(ld * c->count) * sizeof *to + 63) / 64 * 64);
            b->copy[size][n++] = to;
            for (int32_t k = 0; to != NULL && k < c->count; k++) {
                memcpy(to + k * ld,
                       (const float *)b->rows[0].c_st + (int64_t)c->dof[k] * b->rows[0].row_ld,
                       (size_t)ld * sizeof *to);
            }
            if (to == NULL) {
                return out_of_memory(error);
            }
        }
    }
    return 1;
}

/// Fill in b->rows and what they weigh. @return 0 with a message
static int make_forms(body *b, pal_error *error) {
    const pal_model *m = b->model;
    int ok = pal_field_sample_make(m, 99, CONTACTS, &b->sample, error) == PALPATE_OK;
    size_t floats = 3 * (size_t)m->info.row_count + 64, scratch = 64;
    for (int f = 0; ok && f < FORMS; f++) {
        pal_model *rows = &b->rows[f];
        double start = wall_seconds();
        switch (forms[f].kind) {
        case NEAR_FAR:
            ok = near_far_make(m, forms[f].tolerance, &b->near_far) || out_of_memory(error);
            break;
        case BASES:
            ok = pal_rows_compress(m, forms[f].tolerance, NULL, rows, error) == PALPATE_OK;
            break;
        case SGEMV:
            ok = copy_columns(b, error);
            break;
        default:
            ok = pal_rows_convert(m, forms[f].precision, rows, error) == PALPATE_OK &&
                 pal_compress(rows, forms[f].tolerance, NULL, error) == PALPATE_OK;
            break;
        }
        b->seconds[f] = wall_seconds() - start;
        if (ok && forms[f].kind < NEAR_FAR) {
            double cost;
            ok = pal_field_sample_error(&b->sample, rows, &b->error[f], &cost, error) == PALPATE_OK;
            rows->info.field_us = 1e-3 * cost;
            b->bytes[f] = (double)pal_model_row_bytes(rows);
            floats = (size_t)fmax((double)floats, (double)pal_field_floats(rows));
            scratch = (size_t)fmax((double)scratch, (double)pal_field_scratch_bytes(rows));
        }
    }
    b->out = aligned_alloc(64, (floats * sizeof *b->out + 63) / 64 * 64);
    b->scratch = aligned_alloc(64, (scratch + 63) / 64 * 64);
    if (ok && (b->out == NULL || b->scratch == NULL)) {
        return out_of_memory(error);
    }
    for (int f = 0; ok && f < FORMS; f++) {
        if (forms[f].kind == NEAR_FAR) {
            b->bytes[f] = (double)b->near_far.bytes;
            b->error[f] = near_far_error(&b->near_far, &b->sample, m->info.row_count, b->out);
        } else if (forms[f].kind == SGEMV) {
            b->bytes[f] = b->bytes[0];
            b->error[f] = b->error[0];
        }
    }
    return ok;
}

/// One field [s]; sgemv takes the n-th copy.
static double time_field(const body *b, int f, int size, int n, const pal_sample_contact *c) {
    const pal_model *m = forms[f].kind < NEAR_FAR ? &b->rows[f] : &b->rows[0];
    float f32[3 * PALPATE_SAMPLE_NODES];
    for (int32_t k = 0; k < c->count; k++) {
        f32[k] = (float)(c->force[k] * pal_model_unit(m, c->dof[k]));
    }
    int ld = 3 * m->info.row_count;
    double start = cpu_seconds();
    if (forms[f].kind == NEAR_FAR && !near_far_available()) {
        return 1;
    }
    if (forms[f].kind == SGEMV) {
        cblas_sgemv(CblasColMajor, CblasNoTrans, ld, c->count, 1.0f, b->copy[size][n % COPIES], ld,
                    f32, 1, 0.0f, b->out, 1);
    } else if (forms[f].kind == NEAR_FAR) {
        near_far_field(&b->near_far, c->count, c->dof, c->force, b->out);
    } else {
        pal_field_compute(pal_field_best(), m, c->count, c->dof, c->force, f32, b->scratch, b->out);
    }
    return cpu_seconds() - start;
}

/// Medians over rounds: us of each form and its ratio to the first.
static void time_forms(body *b, int size) {
    static double each[FORMS][ROUNDS], over[FORMS][ROUNDS];
    for (int r = 0; r < ROUNDS; r++) {
        for (int f = 0; f < FORMS; f++) {
            double t[CONTACTS];
            int n = 0;
            for (int32_t s = 0; s < b->sample.count; s++) {
                const pal_sample_contact *c = &b->sample.contact[s];
                if (c->count == 3 * touched_nodes[size]) {
                    t[n] = time_field(b, f, size, n, c);
                    n++;
                }
            }
            each[f][r] = median(t, n);
            over[f][r] = each[0][r] / each[f][r];
        }
    }
    for (int f = 0; f < FORMS; f++) {
        b->us[size][f] = 1e6 * median(each[f], ROUNDS);
        b->times[size][f] = median(over[f], ROUNDS);
    }
}

// ---- What a unit of work costs ------------------------------------------------------------------

/// Counted work and measured nanoseconds of one form.
typedef struct fit_sample {
    double work[PALPATE_FIELD_WORK], ns;
} fit_sample;
typedef struct fit {
    int count;
    fit_sample at[SAMPLES_MAX];
} fit;

static void fit_add(fit *x, const body *b, int f, int size) {
    double work[PALPATE_FIELD_WORK], sum[PALPATE_FIELD_WORK] = {0};
    int n = 0;
    for (int32_t s = 0; s < b->sample.count; s++) {
        const pal_sample_contact *c = &b->sample.contact[s];
        if (c->count == 3 * touched_nodes[size]) {
            pal_field_count_work(&b->rows[f], c->count, c->dof, work);
            for (int i = 0; i < PALPATE_FIELD_WORK; i++) {
                sum[i] += work[i];
            }
            n++;
        }
    }
    if (x->count < SAMPLES_MAX && n > 0) {
        fit_sample *to = &x->at[x->count++];
        for (int i = 0; i < PALPATE_FIELD_WORK; i++) {
            to->work[i] = sum[i] / n;
        }
        to->ns = 1e3 * b->us[size][f];
    }
}

/// Least squares of sum_i x_i work_i / ns - 1 with x >= 0, by coordinates.
static void fit_print(const fit *x) {
    static const char *const name[PALPATE_FIELD_WORK] = {
        "touched byte", "16-bit byte", "basis byte", "near byte", "near pair", "cluster", "row"};
    double ns[PALPATE_FIELD_WORK] = {0};
    for (int sweep = 0; sweep < 20000; sweep++) {
        for (int i = 0; i < PALPATE_FIELD_WORK; i++) {
            double top = 0, bottom = 0;
            for (int k = 0; k < x->count; k++) {
                const fit_sample *p = &x->at[k];
                double rest = 1;
                for (int j = 0; j < PALPATE_FIELD_WORK; j++) {
                    rest -= j != i ? ns[j] * p->work[j] / p->ns : 0;
                }
                top += rest * p->work[i] / p->ns;
                bottom += p->work[i] / p->ns * p->work[i] / p->ns;
            }
            ns[i] = bottom > 0 ? fmax(0, top / bottom) : 0;
        }
    }
    double worst[2] = {0, 0}, square[2] = {0, 0};
    for (int k = 0; k < x->count; k++) {
        const double *const by[2] = {pal_field_work_ns, ns};
        for (int w = 0; w < 2; w++) {
            double t = 0;
            for (int i = 0; i < PALPATE_FIELD_WORK; i++) {
                t += by[w][i] * x->at[k].work[i];
            }
            double e = t / x->at[k].ns - 1;
            worst[w] = fmax(worst[w], fabs(e));
            square[w] += e * e / x->count;
        }
    }
    printf("\npal_field_work_ns, in use and as these %d times fit it:\n", x->count);
    for (int i = 0; i < PALPATE_FIELD_WORK; i++) {
        printf("  %-12s %9.4f ns %9.4f ns\n", name[i], pal_field_work_ns[i], ns[i]);
    }
    printf("  prediction off by %.0f %% (rms), %.0f %% at worst; with the fit %.0f %%, %.0f %%\n",
           100 * sqrt(square[0]), 100 * worst[0], 100 * sqrt(square[1]), 100 * worst[1]);
}

static const char *stored_as(const body *b, int f) {
    static const char *const precision[] = {"double", "single", "half", "scaled"};
    const pal_model *m = &b->rows[f];
    return forms[f].kind == NEAR_FAR ? "8/16 bits"
           : forms[f].kind == SGEMV  ? "single"
           : m->bases != NULL        ? "bases"
                                     : precision[m->info.precision];
}

static int bench_body(size_t k, FILE *csv, fit *times) {
    pal_error error = {0};
    static body b;
    memset(&b, 0, sizeof b);
    b.model = body_model(k, &error);
    if (b.model == NULL || !make_forms(&b, &error)) {
        body_clear(&b);
        return fail(bodies[k].name, &error);
    }
    time_forms(&b, 0);
    time_forms(&b, 1);
    const pal_model_info *info = &b.model->info;
    for (int f = 0; f < FORMS; f++) {
        if (forms[f].kind == NEAR_FAR && !near_far_available()) {
            continue;
        }
        const pal_row_bases *bases = b.rows[f].bases;
        double predicted = b.rows[f].info.field_us;
        printf("%-13s %6d %5d  %-15s %-7s %8.2f %9.1e | %8.1f %6.2f | %8.1f %6.2f | %8.1f %6.1f\n",
               bodies[k].name, (int)info->row_count, (int)info->column_count, forms[f].name,
               stored_as(&b, f), 1e-6 * b.bytes[f], b.error[f], b.us[0][f], b.times[0][f],
               b.us[1][f], b.times[1][f], predicted, b.seconds[f]);
        (void)fprintf(
            csv, "%s,%d,%d,%s,%s,%.0f,%.3e,%.2f,%.3f,%.2f,%.3f,%.2f,%.2f,%d,%d,%d\n",
            bodies[k].name, (int)info->row_count, (int)info->column_count, forms[f].name,
            stored_as(&b, f), b.bytes[f], b.error[f], b.us[0][f], b.times[0][f], b.us[1][f],
            b.times[1][f], predicted, b.seconds[f], bases != NULL ? (int)bases->cluster_count : 0,
            bases != NULL ? (int)bases->rank : 0, bases != NULL ? (int)bases->pair_count : 0);
        for (int size = 0; size < SIZES && forms[f].kind < PICKED; size++) {
            fit_add(times, &b, f, size);
        }
    }
    (void)fflush(stdout);
    (void)fflush(csv);
    body_clear(&b);
    return 0;
}

/// Time and bytes over stored nodes, and over the error for the last body, with gnuplot (silently
/// left out where it is missing).
static void plot(const char *last) {
    FILE *g = popen("gnuplot 2>/dev/null", "w");
    if (g == NULL) {
        return;
    }
    (void)fprintf(g, "set datafile separator ','\nset terminal pngcairo size 1300,900\n"
                     "set output 'bench/results/compress.png'\nset multiplot layout 2,2\n"
                     "set logscale xy\nset grid\nset key font ',9'\n");
    static const char *const axis[] = {"field with 45 nodes touched [us, one core]",
                                       "stored rows [MB]"};
    static const char *const value[] = {"8", "($6/1e6)"};
    for (int p = 0; p < 4; p++) {
        (void)fprintf(g, "set xlabel '%s'\nset ylabel '%s'\nset title '%s'\nset key %s\n%splot",
                      p < 2 ? "stored nodes" : "worst error of a contact, max |du| / max |u|",
                      axis[p % 2], p < 2 ? "all bodies" : last, p % 2 ? "on outside right" : "off",
                      p < 2 ? "" : "set format x '10^{%T}'\nset xrange [1e-7:1e-1]\n");
        for (int f = 0; f < FORMS; f++) {
            (void)fprintf(g,
                          "%s '< grep \"^%s,[^,]*,[^,]*,%s,\" bench/results/compress.csv' using "
                          "%s:%s title '%s' pt %d lc %d ps 1.5",
                          f > 0 ? "," : "", p < 2 ? "[^,]*" : last, forms[f].name,
                          p < 2 ? "2" : "7", value[p % 2], forms[f].name, 4 + f, 1 + f);
        }
        (void)fprintf(g, p == 0 ? ", 300 title '300 us' dt 2\n" : "\n");
    }
    (void)pclose(g);
}

int main(int argc, char **argv) {
    int size = argc > 1 && strcmp(argv[1], "--quick") == 0   ? 0
               : argc > 1 && strcmp(argv[1], "--large") == 0 ? 2
                                                             : 1;
    static fit times;
    const char *last = "";
    openblas_set_num_threads(1);
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
        if (bodies[k].size > size) {
            continue;
        }
        if (bench_body(k, csv, &times) != 0) {
            (void)fclose(csv);
            return 1;
        }
        last = bodies[k].name;
    }
    (void)fclose(csv);
    plot(last);
    fit_print(&times);
    printf("written: bench/results/compress.csv, compress.png\n");
    return 0;
}
