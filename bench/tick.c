/// @file tick.c  Bench: the field kernel against memory and OpenBLAS, and the stages of a tick.
///
/// Part 1, one process, interleaved round by round on blocks of 3N rows x 3m columns:
///   read    a pure read of the single-precision block with the same vector width, from its first
///           byte to its last
///   streams the same read as the sweep makes it: twelve columns beside each other, in panels
///   single, half, scaled, double   this library's sweep (Eq. 53) in each storage precision
///   sgemv   OpenBLAS on the single-precision block, one thread
/// Times are thread CPU times; each measurement is warmed by one untimed run, so a block that fits
/// a cache is read from that cache. GB/s counts the bytes of the block once; "moved" counts the
/// result too, which the sweep writes and a read does not: a third more for three columns.
/// sgemv/read says how many times faster than sgemv anything that reads the block can be.
/// Part 1b: the field of a half space of 10 000 stored nodes as store.tolerance 1e-3 stores it,
/// against sgemv on the touched columns in single precision. Part 2: ticks in freewheel on that
/// half space with a sphere pressed and dragged over 16 or more contact points (or on a model
/// file): quantiles of each stage.
///
///     bench/tick [--quick] [--stages] [--ticks N] [MODEL]      (--stages: part 2 alone)
/// writes bench/results/tick_kernel.csv, tick_stages.csv, tick_kernel.png (gnuplot).
#include <cblas.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>
#include <time.h>

#include "haptic/engine/engine.h"
#include "haptic/engine/field_model.h"
#include "src/store/compress.h"
#include "src/store/field_sample.h"
#include "tests/support/synthetic_model.h"

extern void openblas_set_num_threads(int threads);

static double cpu_seconds(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double quantile(double *sorted, size_t count, double q) {
    return sorted[(size_t)fmin((double)count - 1.0, floor(q * (double)count))];
}

static double median(double *v, size_t count) {
    qsort(v, count, sizeof *v, by_value);
    return v[count / 2];
}

// ---- Part 1: kernels ----------------------------------------------------------------------------

enum {
    KERNEL_READ,
    KERNEL_STREAMS,
    KERNEL_SINGLE,
    KERNEL_HALF,
    KERNEL_SCALED,
    KERNEL_DOUBLE,
    KERNEL_SGEMV,
    KERNELS
};

typedef struct bench_block {
    int32_t nodes, contacts, columns;
    int64_t rows, ld;
    float *single;
    uint16_t *half;
    int16_t *scaled;
    double *full;
    int32_t *dof;
    double *f;
    float *f32;
    float *out;
} bench_block;

static void *aligned(size_t bytes) {
    // as pal_model_alloc_rows does
    size_t alignment = bytes >= 4u << 20 ? 2u << 20 : 64;
    void *p = aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment);
    if (p == NULL) {
        (void)fprintf(stderr, "bench/tick: out of memory for %zu bytes\n", bytes);
        exit(1);
    }
    if (alignment > 64) {
        (void)madvise(p, bytes, MADV_HUGEPAGE);
    }
    memset(p, 0, bytes);
    return p;
}

static volatile float sink;

/// Read `bytes` (a multiple of 512) with the widest vectors of the variant in use.
#define READER(name, width, attribute)                                                             \
    attribute static void name(const float *block, size_t bytes) {                                 \
        typedef float wide __attribute__((vector_size(width), may_alias));                         \
        const wide *at = (const wide *)(const void *)block;                                        \
        wide a[8] = {{0}};                                                                         \
        for (size_t i = 0; i < bytes / (width); i += 8) {                                          \
            _Pragma("GCC unroll 8") for (int k = 0; k < 8; k++) {                                  \
                a[k] += at[i + (size_t)k];                                                         \
            }                                                                                      \
        }                                                                                          \
        for (int k = 1; k < 8; k++) {                                                              \
            a[0] += a[k];                                                                          \
        }                                                                                          \
        sink = a[0][0];                                                                            \
    }

/// Read columns three at a time or twelve, in panels, as the sweep does.
#define STREAMS(name, width, attribute)                                                            \
    attribute static void name(const bench_block *b) {                                             \
        enum { PANEL = 16384, WIDTH = (width) / 4 };                                               \
        typedef float wide __attribute__((vector_size(width), may_alias));                         \
        wide a[12] = {{0}};                                                                        \
        for (int64_t row = 0; row < b->rows; row += PANEL) {                                       \
            int64_t end = row + PANEL < b->rows ? row + PANEL : b->rows;                           \
            int32_t k = 0;                                                                         \
            for (; k + 12 <= b->columns; k += 12) {                                                \
                const float *at = b->single + k * b->ld;                                           \
                for (int64_t i = row; i < end; i += WIDTH) {                                       \
                    _Pragma("GCC unroll 12") for (int g = 0; g < 12; g++) {                        \
                        a[g] += *(const wide *)(const void *)(at + g * b->ld + i);                 \
                    }                                                                              \
                }                                                                                  \
            }                                                                                      \
            for (; k < b->columns; k += 3) {                                                       \
                const float *at = b->single + k * b->ld;                                           \
                for (int64_t i = row; i < end; i += WIDTH) {                                       \
                    _Pragma("GCC unroll 3") for (int g = 0; g < 3; g++) {                          \
                        a[g] += *(const wide *)(const void *)(at + g * b->ld + i);                 \
                    }                                                                              \
                }                                                                                  \
            }                                                                                      \
        }                                                                                          \
        for (int k = 1; k < 12; k++) {                                                             \
            a[0] += a[k];                                                                          \
        }                                                                                          \
        sink = a[0][0];                                                                            \
    }
READER(read_portable, 16, )
STREAMS(streams_portable, 16, )
#if defined(__x86_64__)
READER(read_avx2, 32, __attribute__((target("avx2"))))
STREAMS(streams_avx2, 32, __attribute__((target("avx2"))))
READER(read_avx512, 64, __attribute__((target("avx512f"))))
STREAMS(streams_avx512, 64, __attribute__((target("avx512f"))))
#endif

static void pure_read(pal_isa isa, const bench_block *b, size_t bytes, int streams) {
#if defined(__x86_64__)
    if (isa == PALPATE_ISA_AVX512) {
        streams ? streams_avx512(b) : read_avx512(b->single, bytes);
        return;
    }
    if (isa == PALPATE_ISA_AVX2) {
        streams ? streams_avx2(b) : read_avx2(b->single, bytes);
        return;
    }
#endif
    streams ? streams_portable(b) : read_portable(b->single, bytes);
}

static bench_block make_block(int32_t nodes, int32_t contacts) {
    bench_block b = {.nodes = nodes, .contacts = contacts, .columns = 3 * contacts};
    b.rows = (3 * (int64_t)nodes + 127) / 128 * 128;  // whole 512-byte units for the reader
    b.ld = b.rows % 1024 == 0 ? b.rows + 32 : b.rows; // no whole pages, as pal_model_alloc_rows
    size_t count = (size_t)b.ld * (size_t)b.columns;
    b.single = aligned(count * sizeof *b.single);
    b.half = aligned(count * sizeof *b.half);
    b.scaled = aligned(count * sizeof *b.scaled);
    b.full = aligned(count * sizeof *b.full);
    for (size_t i = 0; i < count; i++) {
        double v = 1e-3 * (1.0 + (double)(i % 97));
        b.single[i] = (float)v;
        b.full[i] = v;
        b.half[i] = pal_half_from_double(v);
        b.scaled[i] = (int16_t)(i % 97);
    }
    b.dof = aligned((size_t)b.columns * sizeof *b.dof);
    b.f = aligned((size_t)b.columns * sizeof *b.f);
    b.f32 = aligned((size_t)b.columns * sizeof *b.f32);
    b.out = aligned((size_t)b.rows * sizeof *b.out);
    for (int32_t k = 0; k < b.columns; k++) {
        b.dof[k] = k;
        b.f[k] = 0.01 * (1 + k % 7);
        b.f32[k] = (float)b.f[k];
    }
    return b;
}

static void free_block(bench_block *b) {
    free(b->single);
    free(b->half);
    free(b->scaled);
    free(b->full);
    free(b->dof);
    free(b->f);
    free(b->f32);
    free(b->out);
}

static size_t kernel_bytes(const bench_block *b, int kernel) {
    size_t element = kernel == KERNEL_HALF || kernel == KERNEL_SCALED ? 2
                     : kernel == KERNEL_DOUBLE                        ? 8
                                                                      : 4;
    return (size_t)b->rows * (size_t)b->columns * element; // whole 512 bytes
}

static void run_kernel(const bench_block *b, int kernel, pal_isa isa) {
    pal_field_job job = {.ld = b->ld,
                         .rows = b->rows,
                         .count = b->columns,
                         .dof = b->dof,
                         .f = b->f,
                         .f32 = b->f32,
                         .out = b->out};
    switch (kernel) {
    case KERNEL_READ:
    case KERNEL_STREAMS:
        pure_read(isa, b, kernel_bytes(b, kernel), kernel == KERNEL_STREAMS);
        return;
    case KERNEL_SGEMV:
        cblas_sgemv(CblasColMajor, CblasNoTrans, (int)b->rows, b->columns, 1.0f, b->single,
                    (int)b->ld, b->f32, 1, 0.0f, b->out, 1);
        return;
    case KERNEL_SINGLE:
        job.precision = PALPATE_PRECISION_SINGLE;
        job.block = b->single;
        break;
    case KERNEL_HALF:
        job.precision = PALPATE_PRECISION_HALF;
        job.block = b->half;
        break;
    case KERNEL_SCALED:
        job.precision = PALPATE_PRECISION_SCALED;
        job.block = b->scaled;
        break;
    default:
        job.precision = PALPATE_PRECISION_DOUBLE;
        job.block = b->full;
        break;
    }
    pal_field_sweep(isa, &job);
}

/// One timed run [s] after an untimed one; small blocks are repeated to be longer than the clock.
static double time_kernel(const bench_block *b, int kernel, pal_isa isa) {
    int repeat = (int)fmax(1.0, 4e6 / (double)kernel_bytes(b, kernel));
    run_kernel(b, kernel, isa);
    double start = cpu_seconds();
    for (int k = 0; k < repeat; k++) {
        run_kernel(b, kernel, isa);
    }
    return (cpu_seconds() - start) / repeat;
}

/// Rates over block size, one curve per kernel, with gnuplot (silently left out where it is
/// missing).
static void plot_kernels(void) {
    FILE *plot = popen("gnuplot 2>/dev/null", "w");
    if (plot == NULL) {
        return;
    }
    (void)fprintf(plot, "set datafile separator ','\nset terminal pngcairo size 900,560\n"
                        "set output 'bench/results/tick_kernel.png'\nset logscale x\nset grid\n"
                        "set key top right\nset xlabel 'single-precision block [MB]'\n"
                        "set ylabel 'bytes of the block read [GB/s]'\nset yrange [0:*]\n"
                        "set title 'Field kernel (Eq. 53), one core'\nplot");
    static const char *const title[] = {
        "pure read", "the same in streams", "single", "half", "scaled", "double", "OpenBLAS sgemv"};
    for (int k = 0; k < KERNELS; k++) {
        (void)fprintf(plot, "%s '%s' using ($3/1e6):%d skip 1 title '%s' pt %d", k > 0 ? "," : "",
                      "bench/results/tick_kernel.csv", 4 + k, title[k], 5 + 2 * k);
    }
    (void)fprintf(plot, "\n");
    (void)pclose(plot);
}

/// Ratios of two kernels' times, round by round: their median.
static double ratio(double time[KERNELS][64], int over, int of, int rounds) {
    double r[64];
    for (int k = 0; k < rounds; k++) {
        r[k] = time[over][k] / time[of][k];
    }
    return median(r, (size_t)rounds);
}

static void bench_kernels(int quick) {
    static const int32_t nodes[] = {1000, 3000, 10000, 30000};
    static const int32_t contacts[] = {1, 4, 16, 64};
    pal_isa isa = pal_field_best();
    int rounds = quick ? 5 : 25;
    FILE *csv = fopen("bench/results/tick_kernel.csv", "w");
    if (csv != NULL) {
        (void)fprintf(csv,
                      "nodes,contacts,bytes_single,read_GBs,streams_GBs,single_GBs,half_GBs,"
                      "scaled_GBs,double_GBs,sgemv_GBs,single_over_read,moved_over_read,"
                      "single_over_streams,single_over_sgemv,sgemv_over_read,"
                      "single_over_half_time,single_over_scaled_time,single_us,half_us,sgemv_us\n");
    }
    printf("field kernel: %s; GB/s of the block, medians of %d interleaved rounds\n",
           pal_isa_name(isa), rounds);
    printf("%7s %4s %9s | %6s %7s %6s %6s %6s %6s %6s | %6s %6s %8s | %6s %10s | %6s %7s\n",
           "nodes", "m", "MB", "read", "streams", "single", "half", "scaled", "double", "sgemv",
           "/read", "moved", "/streams", "/sgemv", "sgemv/read", "half x", "scaled x");
    for (size_t a = 0; a < sizeof nodes / sizeof *nodes; a++) {
        for (size_t c = 0; c < sizeof contacts / sizeof *contacts; c++) {
            bench_block b = make_block(nodes[a], contacts[c]);
            static double time[KERNELS][64];
            for (int r = 0; r < rounds; r++) {
                for (int k = 0; k < KERNELS; k++) {
                    time[k][r] = time_kernel(&b, k, isa);
                }
            }
            double to_read = ratio(time, KERNEL_READ, KERNEL_SINGLE, rounds),
                   moved = to_read * (b.columns + 1) / b.columns,
                   to_streams = ratio(time, KERNEL_STREAMS, KERNEL_SINGLE, rounds),
                   to_sgemv = ratio(time, KERNEL_SGEMV, KERNEL_SINGLE, rounds),
                   share = ratio(time, KERNEL_READ, KERNEL_SGEMV, rounds),
                   half = ratio(time, KERNEL_SINGLE, KERNEL_HALF, rounds),
                   scaled = ratio(time, KERNEL_SINGLE, KERNEL_SCALED, rounds), rate[KERNELS],
                   mid[KERNELS];
            for (int k = 0; k < KERNELS; k++) {
                mid[k] = median(time[k], (size_t)rounds);
                rate[k] = 1e-9 * (double)kernel_bytes(&b, k) / mid[k];
            }
            printf(
                "%7d %4d %9.3f | %6.1f %7.1f %6.1f %6.1f %6.1f %6.1f %6.1f | %6.2f %6.2f %8.2f | "
                "%6.2f %10.2f | %6.2f %7.2f\n",
                (int)b.nodes, (int)b.contacts, 1e-6 * (double)kernel_bytes(&b, KERNEL_SINGLE),
                rate[KERNEL_READ], rate[KERNEL_STREAMS], rate[KERNEL_SINGLE], rate[KERNEL_HALF],
                rate[KERNEL_SCALED], rate[KERNEL_DOUBLE], rate[KERNEL_SGEMV], to_read, moved,
                to_streams, to_sgemv, share, half, scaled);
            (void)fflush(stdout);
            if (csv != NULL) {
                (void)fprintf(csv, "%d,%d,%zu", (int)b.nodes, (int)b.contacts,
                              kernel_bytes(&b, KERNEL_SINGLE));
                for (int k = 0; k < KERNELS; k++) {
                    (void)fprintf(csv, ",%.3f", rate[k]);
                }
                (void)fprintf(csv, ",%.4f,%.4f,%.4f,%.4f,%.4f,%.4f,%.4f,%.3f,%.3f,%.3f\n", to_read,
                              moved, to_streams, to_sgemv, share, half, scaled,
                              1e6 * mid[KERNEL_SINGLE], 1e6 * mid[KERNEL_HALF],
                              1e6 * mid[KERNEL_SGEMV]);
            }
            free_block(&b);
        }
    }
    if (csv != NULL) {
        (void)fclose(csv);
    }
    plot_kernels();
}

// ---- Part 1b: what is stored against sgemv ------------------------------------------------------

enum { FORM_SINGLE, FORM_TOLERANCE, FORM_SGEMV, FORMS };

/// Medians over contacts of `nodes` nodes of one field in each form, every call another contact.
static void time_fields(const pal_model *single, const pal_model *chosen,
                        const pal_field_sample *sample, int32_t nodes, int rounds) {
    enum { COPIES = 16 };
    int64_t ld = single->row_ld;
    float *copy[COPIES] = {NULL}, *out = aligned((size_t)(ld + 64) * sizeof *out);
    void *scratch = aligned(pal_field_scratch_bytes(chosen) + 64);
    static double time[KERNELS][64];
    int n = 0;
    for (int32_t s = 0; s < sample->count && n < COPIES; s++) {
        const pal_sample_contact *c = &sample->contact[s];
        if (c->count == 3 * nodes) {
            copy[n] = aligned((size_t)(ld * c->count) * sizeof(float));
            for (int32_t k = 0; k < c->count; k++) {
                memcpy(copy[n] + k * ld, (const float *)single->c_st + c->dof[k] * ld,
                       (size_t)ld * sizeof(float));
            }
            n++;
        }
    }
    for (int r = 0; r < rounds; r++) {
        for (int form = 0; form < FORMS; form++) {
            double each[64];
            int seen = 0;
            for (int32_t s = 0; s < sample->count && seen < n; s++) {
                const pal_sample_contact *c = &sample->contact[s];
                const pal_model *m = form == FORM_TOLERANCE ? chosen : single;
                float f32[3 * PALPATE_SAMPLE_NODES];
                double f[3 * PALPATE_SAMPLE_NODES];
                if (c->count != 3 * nodes) {
                    continue;
                }
                for (int32_t k = 0; k < c->count; k++) { // no column may be left out
                    f[k] = c->force[k] != 0.0 ? c->force[k] : 0.01;
                    f32[k] = (float)(f[k] * pal_model_unit(m, c->dof[k]));
                }
                double start = cpu_seconds();
                if (form == FORM_SGEMV) {
                    cblas_sgemv(CblasColMajor, CblasNoTrans, (int)ld, c->count, 1.0f, copy[seen],
                                (int)ld, f32, 1, 0.0f, out, 1);
                } else {
                    pal_field_compute(pal_field_best(), m, c->count, c->dof, f, f32, scratch, out);
                }
                each[seen++] = cpu_seconds() - start;
            }
            time[form][r] = median(each, (size_t)n);
        }
    }
    double to_single = ratio(time, FORM_SGEMV, FORM_SINGLE, rounds),
           to_chosen = ratio(time, FORM_SGEMV, FORM_TOLERANCE, rounds);
    printf("  %2d nodes touched: single %.1f us, tolerance 1e-3 %.1f us, sgemv %.1f us: %.2f and "
           "%.2f times faster than sgemv\n",
           (int)nodes, 1e6 * median(time[FORM_SINGLE], (size_t)rounds),
           1e6 * median(time[FORM_TOLERANCE], (size_t)rounds),
           1e6 * median(time[FORM_SGEMV], (size_t)rounds), to_single, to_chosen);
    for (int k = 0; k < n; k++) {
        free(copy[k]);
    }
    free(out);
    free(scratch);
}

static int bench_chosen(const pal_model *single, int quick) {
    pal_field_sample sample;
    pal_model chosen;
    pal_error error = {0};
    if (single->bases != NULL || single->info.precision != PALPATE_PRECISION_SINGLE ||
        single->c_st == NULL) {
        printf("\nno rows in single precision: nothing to compare with sgemv\n");
        return 0;
    }
    if (pal_field_sample_make(single, 99, 64, &sample, &error) != PALPATE_OK ||
        pal_rows_convert(single, PALPATE_PRECISION_SINGLE, &chosen, &error) != PALPATE_OK ||
        pal_compress(&chosen, 1e-3, NULL, &error) != PALPATE_OK) {
        (void)fprintf(stderr, "bench/tick: %s\n", error.message);
        return 1;
    }
    printf(
        "\nfield of %d stored nodes, %.1f MB in single precision, %.1f MB as store.tolerance 1e-3 "
        "stores it (%s, error %.1e)\n",
        (int)single->info.row_count, 1e-6 * (double)pal_model_row_bytes(single),
        1e-6 * (double)pal_model_row_bytes(&chosen),
        chosen.bases != NULL ? "bases" : "scaled integers", chosen.info.field_error);
    time_fields(single, &chosen, &sample, PALPATE_SAMPLE_NODES, quick ? 5 : 25);
    time_fields(single, &chosen, &sample, 15, quick ? 5 : 25);
    pal_rows_clear(&chosen);
    pal_field_sample_clear(&sample);
    return 0;
}

// ---- Part 2: stages of a tick -------------------------------------------------------------------

enum { STAGE_FORCE, STAGE_FIELD, STAGE_TICK, STAGES };

/// About 10 000 stored nodes: 23 x 23 touchable on 25 x 25, 17 layers of which the last is fixed.
static pal_model *big_model(void) {
    synthetic_params p = synthetic_default_params();
    p.n = 23;
    p.layers = 17;
    p.rows = SYNTHETIC_ROWS_ALL;
    return synthetic_model(&p);
}

static void print_stage(const char *name, double *v, size_t count, FILE *csv) {
    qsort(v, count, sizeof *v, by_value);
    double q[4] = {quantile(v, count, 0.5), quantile(v, count, 0.99), quantile(v, count, 0.999),
                   v[count - 1]};
    printf("%-28s %8.1f %8.1f %8.1f %8.1f\n", name, 1e6 * q[0], 1e6 * q[1], 1e6 * q[2], 1e6 * q[3]);
    if (csv != NULL) {
        (void)fprintf(csv, "%s,%zu,%.3f,%.3f,%.3f,%.3f\n", name, count, 1e6 * q[0], 1e6 * q[1],
                      1e6 * q[2], 1e6 * q[3]);
    }
}

/// A sphere pressed and dragged in a circle; every tick publishes to one reader (the worst case).
static int bench_stages(const pal_model *model, size_t ticks) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    const pal_tool_def *own = &pal_model_runtime(model)->tools[0];
    pal_tool_def tool = {.name = "probe", .shape = PALPATE_SHAPE_SPHERE};
    // wide enough for about 16 nodes of 2 mm, or the model's own tool
    int has_own = pal_model_runtime(model)->tool_count > 0 && own->has_start && own->radius > 0.0 &&
                  strcmp(info.method, "half-space") != 0;
    tool.radius = has_own ? own->radius : 0.012;
    double start[3] = {0, 0, tool.radius}, axis[3] = {0, 0, -1};
    if (has_own) {
        memcpy(start, own->start, sizeof start);
        memcpy(axis, own->axis, sizeof axis);
    }
    pal_engine_def def = pal_engine_default_def();
    def.tool_count = 1;
    def.tools = &tool;
    def.reader_count = 1;
    def.frame_age = 1;
    pal_engine *engine = NULL;
    pal_error error = {0};
    if (pal_engine_create(model, &def, &engine, &error) != PALPATE_OK) {
        (void)fprintf(stderr, "bench/tick: %s\n", error.message);
        return 1;
    }
    double *stage[STAGES];
    for (int k = 0; k < STAGES; k++) {
        stage[k] = aligned(ticks * sizeof(double));
    }
    double press = has_own ? 0.3 * tool.radius : 0.002;
    uint64_t contacts = 0;
    int32_t most = 0;
    for (size_t k = 0; k < ticks; k++) { // press in over 500 ticks, then circles of 2 s
        double depth = press * fmin(1.0, (double)k / 500.0),
               turn = 3.14159265358979 * ((double)k - 500.0) / 1000.0;
        double swing = has_own ? tool.radius : 0.012, a = swing * sin(turn),
               b = swing * (1 - cos(turn));
        pal_tool_state in = {.orientation = {1, 0, 0, 0}};
        double side[3] = {1, 0, 0}, other[3] = {0, 1, 0};
        for (int i = 0; i < 3; i++) {
            in.position[i] =
                start[i] + depth * axis[i] + (k < 500 ? 0.0 : 0.5 * (a * side[i] + b * other[i]));
        }
        pal_tool_force out;
        double t0 = cpu_seconds();
        (void)pal_engine_force(engine, &in, &out);
        double t1 = cpu_seconds();
        pal_engine_field(engine);
        double t2 = cpu_seconds();
        stage[STAGE_FORCE][k] = t1 - t0;
        stage[STAGE_FIELD][k] = t2 - t1;
        stage[STAGE_TICK][k] = t2 - t0;
        contacts += (uint64_t)out.contact_count;
        most = out.contact_count > most ? out.contact_count : most;
    }
    pal_engine_counts counts;
    pal_engine_get_counts(engine, &counts);
    printf("\ntick: %d stored nodes, %d touchable, %.1f contacts a tick (most %d), %.2f passes "
           "(worst %d), engine %zu bytes\n",
           (int)info.row_count, (int)info.touchable_count, (double)contacts / (double)ticks,
           (int)most, (double)counts.solver_iterations / (double)ticks,
           (int)counts.worst_iterations, pal_engine_bytes(model, &def));
    printf("%zu freewheel ticks, thread CPU time [us]\n%-28s %8s %8s %8s %8s\n", ticks, "stage",
           "p50", "p99", "p99.9", "max");
    FILE *csv = fopen("bench/results/tick_stages.csv", "w");
    if (csv != NULL) {
        (void)fprintf(csv, "stage,ticks,p50_us,p99_us,p999_us,max_us\n");
    }
    print_stage("pose to force", stage[STAGE_FORCE], ticks, csv);
    print_stage("field and publish", stage[STAGE_FIELD], ticks, csv);
    print_stage("whole tick", stage[STAGE_TICK], ticks, csv);
    if (csv != NULL) {
        (void)fclose(csv);
    }
    for (int k = 0; k < STAGES; k++) {
        free(stage[k]);
    }
    pal_engine_free(engine);
    return 0;
}

int main(int argc, char **argv) {
    int quick = 0, ticks_only = 0;
    size_t ticks = 100000;
    const char *path = NULL;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--quick") == 0) {
            quick = 1;
            ticks = 20000;
        } else if (strcmp(argv[i], "--stages") == 0) {
            ticks_only = 1;
        } else if (strcmp(argv[i], "--ticks") == 0 && i + 1 < argc) {
            ticks = (size_t)fmax(1000.0, atof(argv[++i]));
        } else {
            path = argv[i];
        }
    }
    openblas_set_num_threads(1);
    if (ticks_only == 0) {
        bench_kernels(quick);
    }
    pal_error error = {0};
    pal_model *model = NULL;
    if (path == NULL) {
        model = big_model();
    } else if (pal_model_load(path, &model, &error) != PALPATE_OK) {
        (void)fprintf(stderr, "bench/tick: %s\n", error.message);
        return 1;
    }
    int failed = model == NULL || (ticks_only == 0 && bench_chosen(model, quick) != 0) ||
                 bench_stages(model, ticks) != 0;
    pal_model_free(model);
    return failed;
}
