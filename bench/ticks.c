/// @file ticks.c  Bench: a million ticks, stage by stage.
///
/// Freewheel ticks as the servo makes them (device read, force, device write, field, publish) on
/// the hemisphere and the organ of scenes/ and on a half space with 10 000 stored nodes under a
/// sphere that keeps 16 or more contact points. The stage clock (haptic/base/stages.h) is hung into
/// the engine and reads CLOCK_THREAD_CPUTIME_ID: what the host gives to others is not counted. It
/// is a system call, which is why only a bench does this; its own cost, printed, is inside every
/// stage. One reader whose frames are replaced every tick: the field is computed each time, the
/// worst case (a session's readers want it every fourth tick at most).
///
///     bench/ticks [--ticks N] [--quick] [--case NAME]...
/// (default 1 000 000 ticks per case; --quick 20 000); writes bench/results/ticks.csv.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <palpate/precompute.h>
#include <palpate/session.h>

#include "haptic/engine/engine.h"
#include "haptic/base/quantiles.h"
#include "src/store/compress.h"
#include "tests/support/synthetic_model.h"

static int64_t cpu_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

static int64_t clock_cost(void) {
    enum { READS = 100000 };
    int64_t start = cpu_now();
    for (int k = 0; k < READS; k++) {
        (void)cpu_now();
    }
    return (cpu_now() - start) / READS;
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
enum { FORCE = PALPATE_STAGE_COUNT, TICK, ROWS };

typedef struct measured {
    pal_histogram time[ROWS];
    uint64_t contacts, touching, nodes;
    int32_t fewest, most, nodes_most;
} measured;

static void add_tick(measured *m, const pal_stages *s, const pal_tool_force *out, int32_t nodes) {
    m->nodes += (uint64_t)nodes;
    m->nodes_most = nodes > m->nodes_most ? nodes : m->nodes_most;
    int64_t force = 0, all = 0;
    for (int k = 0; k < PALPATE_STAGE_COUNT; k++) {
        pal_histogram_add(&m->time[k], s->ns[k]);
        all += s->ns[k];
        force += k > PALPATE_STAGE_DEVICE_IN && k <= PALPATE_STAGE_DEVICE_OUT ? s->ns[k] : 0;
    }
    pal_histogram_add(&m->time[FORCE], force);
    pal_histogram_add(&m->time[TICK], all);
    m->contacts += (uint64_t)out->contact_count;
    m->touching += out->contact_count > 0;
    m->most = out->contact_count > m->most ? out->contact_count : m->most;
    m->fewest = out->contact_count < m->fewest ? out->contact_count : m->fewest;
}

static pal_status run_ticks(pal_engine *engine, pal_device *device, uint64_t ticks, measured *m) {
    pal_stages stages = {.now = cpu_now};
    for (uint64_t k = 0; k < ticks; k++) {
        pal_tool_state in = {0};
        pal_tool_force out;
        int64_t time_ns = (int64_t)k * 1000000;
        if (k == 2000) { // pressed in and on its circle
            m->fewest = INT32_MAX;
            engine->stages = &stages;
        }
        pal_stages_begin(&stages);
        pal_status status = device->read(device->self, time_ns, &in);
        if (status != PALPATE_OK) {
            return status;
        }
        pal_stages_end(engine->stages, PALPATE_STAGE_DEVICE_IN);
        (void)pal_engine_force(engine, &in, &out);
        if (device->write != NULL) {
            (void)device->write(device->self, time_ns, &out);
        }
        pal_stages_end(engine->stages, PALPATE_STAGE_DEVICE_OUT);
        pal_engine_field(engine);
        if (engine->stages != NULL) {
            add_tick(m, &stages, &out, engine->result.dof_count / 3);
        }
    }
    return PALPATE_OK;
}

static void report(const bench_case *c, const pal_model_info *info, const pal_engine *engine,
                   measured *m, FILE *csv) {
#define STAGE_TEXT(name, text) text,
    static const char *const name[ROWS] = {PALPATE_STAGE_LIST(STAGE_TEXT) "pose to force",
                                           "whole tick"};
#undef STAGE_TEXT
    uint64_t ticks = atomic_load(&m->time[TICK].total);
    printf("\n%s: %d stored nodes, %d bytes an entry, %d touchable, field by the %s, law '%s'; "
           "%llu ticks, %.1f "
           "contact points (%d to %d), %.1f nodes carry force (most %d), faults %llu\n%-38s %8s "
           "%8s %8s %8s\n",
           c->name, info->row_count, (int)pal_precision_size(info->precision),
           info->touchable_count, c->by == PALPATE_FIELD_BY_SERVO ? "servo" : "reader",
           engine->law->name, (unsigned long long)ticks, (double)m->contacts / (double)ticks,
           m->fewest, m->most, (double)m->nodes / (double)ticks, m->nodes_most,
           (unsigned long long)(engine->counts.fault[2] + engine->counts.fault[6] +
                                engine->counts.fault[11]),
           "stage [us of thread CPU time]", "p50", "p99", "p99.9", "max");
    for (int k = 0; k < ROWS; k++) {
        pal_quantiles q = pal_histogram_us(&m->time[k]);
        double limit = k == FORCE ? c->force_limit : k == TICK ? c->tick_limit : 0.0;
        char verdict[64] = "";
        if (limit > 0.0) {
            (void)snprintf(verdict, sizeof verdict, "  p99.9 asked for: %.0f: %s", limit,
                           q.p999 <= limit ? "met" : "NOT met");
        }
        printf("%-38s %8.2f %8.2f %8.2f %8.2f%s\n", name[k], q.p50, q.p99, q.p999, q.max, verdict);
        if (csv != NULL) {
            (void)fprintf(csv, "%s,%s,%d,%s,%.2f,%llu,%.3f,%.3f,%.3f,%.3f\n", c->name,
                          engine->law->name, info->row_count, name[k],
                          (double)m->contacts / (double)ticks, (unsigned long long)ticks, q.p50,
                          q.p99, q.p999, q.max);
        }
    }
    (void)fflush(stdout);
}

static int run_case(const bench_case *c, uint64_t ticks, FILE *csv) {
    pal_error error = {0};
    pal_model *model = c->scene != NULL ? open_scene(c->scene, &error)
                                        : half_space(c->precision, c->tolerance, &error);
    pal_engine *engine = NULL;
    pal_device device = {0};
    static measured m;
    memset(&m, 0, sizeof m);
    int failed = model == NULL;
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
                 run_ticks(engine, &device, ticks + 2000, &m) != PALPATE_OK;
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
    printf("a read of the clock takes %lld ns; a tick has %d\n", (long long)clock_cost(),
           PALPATE_STAGE_COUNT + 1);
    int failed = 0;
    for (int k = 0; k < CASES; k++) {
        if (only == 0 || (only & 1u << k) != 0) {
            failed |= run_case(&cases[k], ticks, csv);
        }
    }
    if (csv != NULL) {
        (void)fclose(csv);
    }
    return failed;
}
