/// @file ticks.c  Bench: a million ticks, stage by stage.
///
/// Freewheel ticks as the servo makes them (device read, force, device write, field, publish) on
/// the hemisphere and the organ of scenes/ and on a half space with 10 000 stored nodes under a
/// sphere that keeps 16 or more contact points. One reader whose frames are replaced every tick:
/// the field is computed each time, the worst case (a session's readers want it every fourth tick
/// at most).
///
/// Clocks. "pose to force" and "whole tick" are thread CPU time (CLOCK_THREAD_CPUTIME_ID: what the
/// host gives to others is not counted), read three times a tick; a read is a system call, and its
/// cost, printed, is inside both. The stages are told apart by the time stamp counter where it is
/// constant (some 10 ns a read), else by CLOCK_MONOTONIC: elapsed time, pre-emption included.
///
/// What the host adds. Interrupts are counted as the thread's own time, and a 4 ms timer alone hits
/// one in 200 ticks of 20 us. So after every tick a loop runs that does nothing but a fixed number
/// of dependent multiply-adds, as many as take the median time from pose to force: its p99.9 is
/// what a perfectly even computation of that length sees here. Printed beside it: what the solver
/// did in the heaviest thousandth of the ticks against all of them.
///
///     bench/ticks [--ticks N] [--quick] [--case NAME]...
/// (default 1 000 000 ticks per case; --quick 20 000); writes bench/results/ticks.csv.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#if defined __x86_64__
#include <cpuid.h>
#include <x86intrin.h>
#endif

#include <palpate/precompute.h>
#include <palpate/session.h>

#include "haptic/base/quantiles.h"
#include "haptic/contact/contact_anywhere.h"
#include "haptic/engine/engine.h"
#include "src/store/compress.h"
#include "tests/support/synthetic_model.h"

static int64_t cpu_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static int64_t elapsed_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

#if defined __x86_64__
static double ns_per_count; // of the time stamp counter
static uint64_t first_count;

static int64_t counter_now(void) {
    return (int64_t)((double)(__rdtsc() - first_count) * ns_per_count);
}

/// The counter where it runs at one rate whatever the core does, set against CLOCK_MONOTONIC over
/// 100 ms.
static int64_t (*stage_clock(const char **name))(void) {
    unsigned a = 0, b = 0, c = 0, d = 0;
    if (__get_cpuid(0x80000007u, &a, &b, &c, &d) == 0 || (d >> 8 & 1u) == 0) {
        *name = "CLOCK_MONOTONIC";
        return elapsed_now;
    }
    int64_t start = elapsed_now(), end = start;
    first_count = __rdtsc();
    while (end - start < 100000000) {
        end = elapsed_now();
    }
    ns_per_count = (double)(end - start) / (double)(__rdtsc() - first_count);
    *name = "the time stamp counter";
    return counter_now;
}
#else
static int64_t (*stage_clock(const char **name))(void) {
    *name = "CLOCK_MONOTONIC";
    return elapsed_now;
}
#endif

static int64_t clock_cost(int64_t (*now)(void)) {
    enum { READS = 100000 };
    int64_t start = now();
    for (int k = 0; k < READS; k++) {
        (void)now();
    }
    return (now() - start) / READS;
}

/// Nothing but `steps` multiply-adds, each waiting for the last.
static void do_nothing(int64_t steps) {
    volatile double kept = 1.0;
    double x = kept;
    for (int64_t k = 0; k < steps; k++) {
        x = x * 0.999999 + 1e-6;
#if defined __x86_64__
        __asm__ volatile("" : "+x"(x)); // keep the loop
#endif
    }
    kept = x;
    (void)kept;
}

/// Steps that take `ns` on an undisturbed core.
static int64_t steps_for(int64_t ns) {
    enum { STEPS = 20000, TRIES = 200 };
    int64_t best = INT64_MAX;
    for (int k = 0; k < TRIES; k++) {
        int64_t start = cpu_now();
        do_nothing(STEPS);
        int64_t took = cpu_now() - start;
        best = took < best ? took : best;
    }
    return best > 0 ? STEPS * ns / best : 0;
}

typedef struct bench_case {
    const char *name, *scene; ///< scene NULL: the half space
    pal_precision precision;  ///< of the half space's stored rows
    pal_contact_kind law;
    pal_field_by by;
    double radius; ///< of the sphere; 0: the scene's own
    pal_stroke stroke;
    double force_limit, tick_limit; ///< p99.9 asked for [us]; 0: none
    double friction;
    double tolerance; ///< of the half space's rows, as store.tolerance; 0: none
} bench_case;

#define SLIDE(depth_, amplitude_)                                                                  \
    {                                                                                              \
        .kind = PALPATE_STROKE_CIRCLE, .depth = (depth_), .ramp = 0.5, .period = 2,                \
        .amplitude = (amplitude_), .tremor_amplitude = 2e-4, .tremor_frequency = 10                \
    }

#define SINGLE PALPATE_PRECISION_SINGLE
#define SCALED PALPATE_PRECISION_SCALED
#define SURFACE PALPATE_CONTACT_SURFACE
#define NODES PALPATE_CONTACT_NODES
#define SERVO PALPATE_FIELD_BY_SERVO
#define READER PALPATE_FIELD_BY_READER

static const bench_case cases[] = {
    {"hemisphere", "scenes/hemisphere.yaml", SINGLE, SURFACE, SERVO, 0, SLIDE(0.003, 0.004), 0, 0,
     0, 0},
    {"organ", "scenes/organ.yaml", SINGLE, SURFACE, SERVO, 0, SLIDE(0.006, 0.008), 0, 0, 0, 0},
    {"10k", NULL, SINGLE, SURFACE, SERVO, 0.012, SLIDE(0.003, 0.006), 60, 400, 0, 0},
    {"10k-scaled", NULL, SCALED, SURFACE, SERVO, 0.012, SLIDE(0.003, 0.006), 60, 400, 0, 0},
    {"10k-tolerance", NULL, SINGLE, SURFACE, SERVO, 0.012, SLIDE(0.003, 0.006), 60, 400, 0, 1e-3},
    {"10k-render", NULL, SINGLE, SURFACE, READER, 0.012, SLIDE(0.003, 0.006), 60, 400, 0, 0},
    {"10k-friction", NULL, SINGLE, SURFACE, SERVO, 0.012, SLIDE(0.003, 0.006), 60, 400, 0.3, 0},
    {"10k-friction-tolerance", NULL, SINGLE, SURFACE, SERVO, 0.012, SLIDE(0.003, 0.006), 60, 400,
     0.3, 1e-3},
    {"10k-stick", NULL, SINGLE, SURFACE, SERVO, 0.012, SLIDE(0.003, 0.006), 60, 400, 5, 0},
    {"10k-nodes", NULL, SINGLE, NODES, SERVO, 0.012, SLIDE(0.0019, 0.006), 60, 400, 0, 0},
};
enum { CASES = sizeof cases / sizeof *cases };

/// About 10 000 stored nodes: 23 x 23 touchable on 25 x 25, 17 layers of which the last is fixed.
static pal_model *half_space(pal_precision precision, double tolerance, pal_error *error) {
    synthetic_params p = synthetic_default_params();
    p.n = 23;
    p.layers = 17;
    p.rows = SYNTHETIC_ROWS_ALL;
    p.precision = precision;
    pal_model *model = synthetic_model(&p);
    if (model != NULL && tolerance > 0.0 &&
        pal_compress(model, tolerance, NULL, error) != PALPATE_OK) {
        pal_model_free(model);
        return NULL;
    }
    return model;
}

static pal_model *open_scene(const char *path, pal_error *error) {
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    if (pal_scene_load(path, NULL, 0, &scene, error) == PALPATE_OK) {
        (void)pal_precompute_cached(scene, NULL, &model, NULL, error);
    }
    pal_scene_free(scene);
    return model;
}

/// What is printed beside the stages themselves.
enum { FORCE = PALPATE_STAGE_COUNT, TICK, LOOP, ROWS };

/// What is kept of a tick to tell the heaviest ones.
typedef struct tick_work {
    float force_us; ///< pose to force
    uint16_t iterations, gathered;
} tick_work;

typedef struct measured {
    pal_histogram time[ROWS];
    pal_stages stages; ///< of this tick
    tick_work *work;   ///< shape [ticks]
    uint64_t ticks, contacts, touching, nodes;
    int64_t steps; ///< of do_nothing()
    int32_t fewest, most, nodes_most;
} measured;

enum { WARM = 2000, SIZING = 2000 }; // pressed in and on its circle; then the median is taken

static uint64_t gathered(const pal_engine *engine) {
    const anywhere_law *law = engine->contact;
    return engine->law == &pal_contact_anywhere ? law->set.gathered : 0;
}

static void add_tick(measured *m, const pal_tool_force *out, const pal_engine *engine,
                     const int64_t clock[3], uint64_t fresh) {
    const pal_stages *s = &m->stages;
    int32_t nodes = engine->result.dof_count / 3;
    m->nodes += (uint64_t)nodes;
    m->nodes_most = nodes > m->nodes_most ? nodes : m->nodes_most;
    for (int k = 0; k < PALPATE_STAGE_COUNT; k++) {
        pal_histogram_add(&m->time[k], s->ns[k]);
    }
    pal_histogram_add(&m->time[FORCE], clock[1] - clock[0]);
    pal_histogram_add(&m->time[TICK], clock[2] - clock[0] + s->ns[PALPATE_STAGE_DEVICE_IN]);
    m->work[m->ticks++] = (tick_work){.force_us = (float)(clock[1] - clock[0]) * 1e-3f,
                                      .iterations = (uint16_t)engine->result.iterations,
                                      .gathered = (uint16_t)fresh};
    m->contacts += (uint64_t)out->contact_count;
    m->touching += out->contact_count > 0;
    m->most = out->contact_count > m->most ? out->contact_count : m->most;
    m->fewest = out->contact_count < m->fewest ? out->contact_count : m->fewest;
}

static pal_status run_ticks(pal_engine *engine, pal_device *device, uint64_t ticks,
                            int64_t (*now)(void), measured *m) {
    pal_stages *stages = &m->stages;
    pal_histogram *force = &m->time[FORCE];
    m->steps = 0;
    m->fewest = INT32_MAX;
    *stages = (pal_stages){.now = now};
    engine->stages = stages;
    for (uint64_t k = 0; k < WARM + SIZING + ticks; k++) {
        pal_tool_state in = {0};
        pal_tool_force out;
        int64_t time_ns = (int64_t)k * 1000000, clock[3];
        uint64_t before = gathered(engine);
        pal_stages_begin(stages);
        pal_status status = device->read(device->self, time_ns, &in);
        if (status != PALPATE_OK) {
            return status;
        }
        pal_stages_end(stages, PALPATE_STAGE_DEVICE_IN);
        clock[0] = cpu_now();
        stages->last = now();
        (void)pal_engine_force(engine, &in, &out);
        if (device->write != NULL) {
            (void)device->write(device->self, time_ns, &out);
        }
        pal_stages_end(stages, PALPATE_STAGE_DEVICE_OUT);
        clock[1] = cpu_now();
        stages->last = now();
        pal_engine_field(engine);
        clock[2] = cpu_now();
        if (k >= WARM && k < WARM + SIZING) {
            pal_histogram_add(force, clock[1] - clock[0]);
        } else if (k >= WARM + SIZING) {
            add_tick(m, &out, engine, clock, gathered(engine) - before);
        }
        if (k == WARM + SIZING - 1) {
            int64_t median = pal_histogram_quantile(force, 0.5) - clock_cost(cpu_now);
            m->steps = steps_for(median > 0 ? median : 0);
            pal_histogram_clear(force);
            status = pal_histogram_init(force);
            if (status != PALPATE_OK) {
                return status;
            }
        }
        if (k >= WARM + SIZING) {
            int64_t start = cpu_now();
            do_nothing(m->steps);
            pal_histogram_add(&m->time[LOOP], cpu_now() - start);
        }
    }
    return PALPATE_OK;
}

/// What the heaviest thousandth of the ticks did, and all of them.
static void report_heaviest(const measured *m) {
    double limit = (double)pal_histogram_quantile(&m->time[FORCE], 0.999) * 1e-3;
    double heavy = 0.0, work[2][3] = {{0.0}};
    for (uint64_t k = 0; k < m->ticks; k++) {
        const tick_work *w = &m->work[k];
        int is_heavy = (double)w->force_us >= limit;
        heavy += is_heavy;
        for (int h = 0; h <= is_heavy; h++) {
            work[h][0] += w->iterations;
            work[h][1] += w->gathered;
            work[h][2] = fmax(work[h][2], w->iterations);
        }
    }
    printf("all ticks: %.2f solver iterations (most %.0f), %.3f nodes gathered; the heaviest "
           "thousandth: %.2f (most %.0f), %.3f\n",
           work[0][0] / (double)m->ticks, work[0][2], work[0][1] / (double)m->ticks,
           work[1][0] / fmax(heavy, 1.0), work[1][2], work[1][1] / fmax(heavy, 1.0));
}

static void write_csv(FILE *csv, const char *name, const char *law, int32_t rows, const char *stage,
                      double contacts, uint64_t ticks, const double q[4]) {
    if (csv != NULL) {
        (void)fprintf(csv, "%s,%s,%d,%s,%.2f,%llu,%.3f,%.3f,%.3f,%.3f\n", name, law, (int)rows,
                      stage, contacts, (unsigned long long)ticks, q[0], q[1], q[2], q[3]);
    }
}

static void report(const bench_case *c, const pal_model_info *info, const pal_engine *engine,
                   measured *m, FILE *csv) {
#define STAGE_TEXT(name, text) text,
    static const char *const name[ROWS] = {PALPATE_STAGE_LIST(STAGE_TEXT) "pose to force",
                                           "whole tick", "a do-nothing loop as long"};
#undef STAGE_TEXT
    double contacts = (double)m->contacts / (double)m->ticks, q[ROWS][4];
    printf("\n%s: %d stored nodes, %d bytes an entry, %d touchable, field by the %s, law '%s'; "
           "%llu ticks, %.1f contact points (%d to %d), %.1f nodes carry force (most %d), "
           "faults %llu\n%-38s %8s %8s %8s %8s\n",
           c->name, info->row_count, (int)pal_precision_size(info->precision),
           info->touchable_count, c->by == PALPATE_FIELD_BY_SERVO ? "servo" : "reader",
           engine->law->name, (unsigned long long)m->ticks, contacts, m->fewest, m->most,
           (double)m->nodes / (double)m->ticks, m->nodes_most,
           (unsigned long long)(engine->counts.fault[2] + engine->counts.fault[6] +
                                engine->counts.fault[11]),
           "stage [us elapsed]", "p50", "p99", "p99.9", "max");
    for (int k = 0; k < ROWS; k++) {
        pal_quantiles t = pal_histogram_us(&m->time[k]);
        double limit = k == FORCE ? c->force_limit : k == TICK ? c->tick_limit : 0.0;
        char verdict[64] = "";
        q[k][0] = t.p50, q[k][1] = t.p99, q[k][2] = t.p999, q[k][3] = t.max;
        if (limit > 0.0) {
            (void)snprintf(verdict, sizeof verdict, "  p99.9 asked for: %.0f: %s", limit,
                           t.p999 <= limit ? "met" : "NOT met");
        }
        printf("%s%-38s %8.2f %8.2f %8.2f %8.2f%s\n", k == FORCE ? "[us of thread CPU time]\n" : "",
               name[k], t.p50, t.p99, t.p999, t.max, verdict);
        write_csv(csv, c->name, engine->law->name, info->row_count, name[k], contacts, m->ticks,
                  q[k]);
    }
    double ratio[4];
    for (int k = 0; k < 4; k++) {
        ratio[k] = q[LOOP][k] > 0.0 ? q[FORCE][k] / q[LOOP][k] : 0.0;
    }
    printf("%-38s %8.2f %8.2f %8.2f %8.2f\n", "pose to force over that loop [ratio]", ratio[0],
           ratio[1], ratio[2], ratio[3]);
    write_csv(csv, c->name, engine->law->name, info->row_count, "ratio pose to force to loop",
              contacts, m->ticks, ratio);
    report_heaviest(m);
    (void)fflush(stdout);
}

static int run_case(const bench_case *c, uint64_t ticks, int64_t (*now)(void), FILE *csv) {
    pal_error error = {0};
    pal_model *model = c->scene != NULL ? open_scene(c->scene, &error)
                                        : half_space(c->precision, c->tolerance, &error);
    pal_engine *engine = NULL;
    pal_device device = {0};
    static measured m;
    memset(&m, 0, sizeof m);
    m.work = malloc(ticks * sizeof *m.work);
    int failed = model == NULL || m.work == NULL;
    for (uint64_t k = 0; k < ticks && m.work != NULL; k++) {
        m.work[k].force_us = 0.0f; // faults the pages in
    }
    for (int k = 0; k < ROWS; k++) {
        failed |= pal_histogram_init(&m.time[k]) != PALPATE_OK;
    }
    if (!failed) {
        pal_tool_def tool = pal_model_runtime(model)->tools[0];
        if (c->radius > 0.0) {
            tool.shape = PALPATE_SHAPE_SPHERE;
            tool.radius = c->radius;
            tool.start[2] = c->radius;
        }
        tool.friction = c->friction > 0.0 ? c->friction : tool.friction;
        tool.device.kind = PALPATE_DEVICE_SCRIPTED;
        tool.device.stroke = c->stroke;
        pal_engine_def def = pal_engine_default_def();
        def.tool_count = 1;
        def.tools = &tool;
        def.reader_count = 1;
        def.frame_age = 1;
        def.field_by = c->by;
        def.max_contacts = 64;
        def.contact_law = c->law;
        failed = pal_device_create(&tool, def.period, &device, &error) != PALPATE_OK ||
                 pal_engine_create(model, &def, &engine, &error) != PALPATE_OK ||
                 run_ticks(engine, &device, ticks, now, &m) != PALPATE_OK;
        if (!failed) {
            pal_model_info info;
            pal_model_get_info(model, &info);
            report(c, &info, engine, &m, csv);
        }
    }
    if (failed) {
        (void)fprintf(stderr, "bench/ticks: %s: %s\n", c->name, error.message);
    }
    if (device.close != NULL) {
        device.close(device.self);
    }
    for (int k = 0; k < ROWS; k++) {
        pal_histogram_clear(&m.time[k]);
    }
    free(m.work);
    pal_engine_free(engine);
    pal_model_free(model);
    return failed;
}

int main(int argc, char **argv) {
    uint64_t ticks = 1000000;
    uint32_t only = 0; // bit per case; 0: all
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--quick") == 0) {
            ticks = 20000;
        } else if (strcmp(argv[i], "--ticks") == 0 && i + 1 < argc) {
            ticks = (uint64_t)fmax(1000.0, atof(argv[++i]));
        } else if (strcmp(argv[i], "--case") == 0 && i + 1 < argc) {
            int k = 0;
            for (i++; k < CASES && strcmp(argv[i], cases[k].name) != 0; k++) {
            }
            if (k == CASES) {
                (void)fprintf(stderr, "%s: no case '%s'\n", argv[0], argv[i]);
                return 2;
            }
            only |= 1u << k;
        } else {
            (void)fprintf(stderr, "usage: %s [--ticks N] [--quick] [--case NAME]...\n", argv[0]);
            return 2;
        }
    }
    FILE *csv = fopen("bench/results/ticks.csv", "w");
    if (csv != NULL) {
        (void)fprintf(csv,
                      "case,law,stored_nodes,stage,contacts,ticks,p50_us,p99_us,p999_us,max_us\n");
    }
    const char *name;
    int64_t (*now)(void) = stage_clock(&name);
    printf("a read of thread CPU time takes %lld ns, a tick has 3; one of %s, for the stages, %lld "
           "ns, a tick has %d\n",
           (long long)clock_cost(cpu_now), name, (long long)clock_cost(now),
           PALPATE_STAGE_COUNT + 3);
    int failed = 0;
    for (int k = 0; k < CASES; k++) {
        if (only == 0 || (only & 1u << k) != 0) {
            failed |= run_case(&cases[k], ticks, now, csv);
        }
    }
    if (csv != NULL) {
        (void)fclose(csv);
    }
    return failed;
}
