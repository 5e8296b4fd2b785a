/// @file cost.c  Measuring what a tick costs here (see cost.h).
#include "haptic/engine/cost.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/engine/engine.h"
#include "haptic/base/error.h"
#include "haptic/base/quantiles.h"
#include "haptic/base/realtime.h"

// ---- The field's bytes --------------------------------------------------------------------------

/// Least seconds per byte of `bytes` swept as 24 columns (8 contact points).
static double sweep_time(pal_precision precision, const void *block, double bytes, float *out) {
    enum { COLUMNS = 24, RUNS = 5 };
    int32_t dof[COLUMNS];
    double f[COLUMNS], least = INFINITY;
    float f32[COLUMNS];
    for (int32_t k = 0; k < COLUMNS; k++) {
        dof[k] = k;
        f[k] = 0.01 * (k + 1);
        f32[k] = (float)f[k];
    }
    size_t element = pal_precision_size(precision);
    int64_t rows = (int64_t)(bytes / COLUMNS / (double)element) / 32 * 32;
    const pal_field_job job = {.precision = precision,
                               .block = block,
                               .ld = rows,
                               .rows = rows,
                               .count = COLUMNS,
                               .dof = dof,
                               .f = f,
                               .f32 = f32,
                               .out = out};
    double swept = (double)rows * COLUMNS * (double)element;
    int repeat = (int)fmax(1.0, 2e6 / swept);
    pal_isa isa = pal_field_best();
    for (int r = 0; r <= RUNS; r++) { // the first run warms the caches
        int64_t start = pal_rt_cpu_now();
        for (int k = 0; k < repeat; k++) {
            pal_field_sweep(isa, &job);
        }
        double per_byte = 1e-9 * (double)(pal_rt_cpu_now() - start) / repeat / swept;
        least = r > 0 ? fmin(least, per_byte) : least;
    }
    return least;
}

pal_status pal_cost_measure(pal_cost_machine *out, pal_error *error) {
    static const double size[PALPATE_COST_SIZES] = {6e4, 4e5, 1.6e6, 6e6, 2.4e7, 6e7};
    size_t most = (size_t)size[PALPATE_COST_SIZES - 1] + 64;
    void *block = aligned_alloc(64, (most + 63) / 64 * 64);
    float *sum = aligned_alloc(64, (most / 24 / 2 * sizeof *sum + 127) / 64 * 64);
    if (block == NULL || sum == NULL) {
        free(block);
        free(sum);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to measure the field kernel");
    }
    memset(block, 0, most);
    for (int k = 0; k < PALPATE_COST_SIZES; k++) {
        out->bytes[k] = size[k];
        for (int p = PALPATE_PRECISION_DOUBLE; p <= PALPATE_PRECISION_SCALED; p++) {
            out->per_byte[p][k] = sweep_time((pal_precision)p, block, size[k], sum);
        }
    }
    free(block);
    free(sum);
    return PALPATE_OK;
}

double pal_cost_field(const pal_cost_machine *machine, pal_precision precision, double contacts,
                      double rows) {
    double bytes = 9.0 * contacts * rows * (double)pal_precision_size(precision);
    const double *y = machine->per_byte[precision], *x = machine->bytes;
    double per_byte = y[0];
    if (bytes >= x[PALPATE_COST_SIZES - 1]) {
        per_byte = y[PALPATE_COST_SIZES - 1];
    }
    for (int k = 1; k < PALPATE_COST_SIZES; k++) {
        if (bytes > x[k - 1] && bytes <= x[k]) {
            double t = log(bytes / x[k - 1]) / log(x[k] / x[k - 1]);
            per_byte = y[k - 1] + t * (y[k] - y[k - 1]);
        }
    }
    return bytes * per_byte;
}

// ---- Ticks of a model ---------------------------------------------------------------------------

/// A probe of three spacings' radius over the touchable node nearest to their middle.
static pal_status make_tool(const pal_model *model, pal_tool_def *tool, pal_error *error) {
    const pal_runtime_config *runtime = pal_model_runtime(model);
    double middle[3] = {0}, best = INFINITY, radius = 3.0 * model->info.spacing_mean;
    int32_t count = 0, node = -1;
    for (int32_t i = 0; i < model->info.surface_count; i++) {
        if (model->node_flags[i] & PALPATE_NODE_TOUCHABLE) {
            count++;
            for (int d = 0; d < 3; d++) {
                middle[d] += model->position[3 * (int64_t)i + d];
            }
        }
    }
    if (count == 0) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "nothing is touchable: there is no tick to measure");
    }
    if (runtime->tool_count > 0 && runtime->tools[0].has_start) {
        *tool = runtime->tools[0];
        return PALPATE_OK;
    }
    for (int32_t i = 0; i < model->info.surface_count; i++) {
        const double *x = model->position + 3 * (int64_t)i;
        double r = hypot(hypot(x[0] - middle[0] / count, x[1] - middle[1] / count),
                         x[2] - middle[2] / count);
        if ((model->node_flags[i] & PALPATE_NODE_TOUCHABLE) && r < best) {
            best = r;
            node = i;
        }
    }
    *tool = (pal_tool_def){
        .name = "probe", .shape = PALPATE_SHAPE_SPHERE, .radius = radius, .has_start = 1};
    for (int d = 0; d < 3; d++) {
        double n = model->normal[3 * (int64_t)node + d];
        tool->start[d] = model->position[3 * (int64_t)node + d] + radius * n;
        tool->axis[d] = -n;
    }
    return PALPATE_OK;
}

/// @param own  1: a replay is kept; 0: not, as its path belongs to a tool of one size
static void give_motion(const pal_model *model, pal_tool_def *tool, int own) {
    if (tool->device.kind == PALPATE_DEVICE_SCRIPTED ||
        (tool->device.kind == PALPATE_DEVICE_REPLAY && own)) {
        return;
    }
    double size = tool->radius > 0.0 ? tool->radius : model->info.spacing_mean;
    tool->device.kind = PALPATE_DEVICE_SCRIPTED;
    tool->device.stroke = (pal_stroke){.kind = PALPATE_STROKE_CIRCLE,
                                       .depth = 0.4 * size,
                                       .ramp = 0.5,
                                       .period = 2.0,
                                       .amplitude = size};
}

typedef struct meter {
    pal_histogram force, field, tick;
} meter;

static void keep_least(pal_quantiles *least, const pal_histogram *of, int first) {
    pal_quantiles q = pal_histogram_us(of);
    least->p50 = first ? q.p50 : fmin(least->p50, q.p50);
    least->p99 = first ? q.p99 : fmin(least->p99, q.p99);
    least->p999 = first ? q.p999 : fmin(least->p999, q.p999);
    least->max = first ? q.max : fmin(least->max, q.max);
}

/// The motion once; the means go to `out`, the times to `m`.
static pal_status run_once(const pal_model *model, const pal_engine_def *def, pal_device *device,
                           double seconds, meter *m, pal_cost_ticks *out, pal_error *error) {
    pal_engine *engine = NULL;
    pal_status status = pal_engine_create(model, def, &engine, error);
    uint64_t ticks = (uint64_t)(seconds / def->period), touching = 0, contacts = 0;
    for (uint64_t k = 0; status == PALPATE_OK && k < ticks; k++) {
        pal_tool_state in = {0};
        pal_tool_force felt;
        (void)device->read(device->self, (int64_t)((double)k * def->period * 1e9), &in);
        int64_t start = pal_rt_cpu_now();
        (void)pal_engine_force(engine, &in, &felt);
        int64_t forced = pal_rt_cpu_now();
        pal_engine_field(engine);
        int64_t end = pal_rt_cpu_now();
        int32_t nodes = engine->result.dof_count / 3;
        if (nodes > 0) { // a tool in the air costs nothing and says nothing
            pal_histogram_add(&m->force, forced - start);
            pal_histogram_add(&m->field, end - forced);
            pal_histogram_add(&m->tick, end - start);
            touching++;
            contacts += (uint64_t)nodes;
            out->most = nodes > out->most ? nodes : out->most;
        }
    }
    pal_engine_free(engine);
    out->ticks = touching;
    out->contacts = touching > 0 ? (double)contacts / (double)touching : 0.0;
    return status;
}

static pal_status init_meter(meter *m, pal_error *error) {
    memset(m, 0, sizeof *m);
    if (pal_histogram_init(&m->force) != PALPATE_OK ||
        pal_histogram_init(&m->field) != PALPATE_OK || pal_histogram_init(&m->tick) != PALPATE_OK) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to measure ticks");
    }
    return PALPATE_OK;
}

static void clear_meter(meter *m) {
    pal_histogram_clear(&m->force);
    pal_histogram_clear(&m->field);
    pal_histogram_clear(&m->tick);
}

pal_status pal_cost_of_ticks(const pal_model *model, double swell, int runs, pal_cost_ticks *out,
                             pal_error *error) {
    pal_tool_def tool;
    pal_device device = {0};
    *out = (pal_cost_ticks){0};
    pal_status status = make_tool(model, &tool, error);
    if (status != PALPATE_OK) {
        return status;
    }
    give_motion(model, &tool, swell == 1.0);
    for (int d = 0; d < 3; d++) {
        tool.start[d] -= (swell - 1.0) * tool.radius * tool.axis[d];
    }
    tool.radius *= swell;
    const pal_runtime_config *runtime = pal_model_runtime(model);
    pal_engine_def def = pal_engine_default_def();
    def.tools = &tool;
    def.tool_count = 1;
    def.reader_count = 1;
    def.frame_age = 1;
    def.max_contacts = runtime->max_contacts > 0 ? runtime->max_contacts : def.max_contacts;
    def.contact_law = runtime->contact_law;
    def.contact_points = runtime->contact_points;
    def.period = runtime->servo_rate > 0.0 ? 1.0 / runtime->servo_rate : def.period;
    status = pal_device_create(&tool, def.period, &device, error);
    if (status != PALPATE_OK) {
        return status;
    }
    double length = pal_device_duration(&device);
    const pal_stroke *stroke = &tool.device.stroke;
    length = length > 0.0 ? length : fmax(1.5, stroke->ramp + fmin(stroke->period, 4.0));
    length = fmin(length, 6.0);
    int modes = swell == 1.0 ? 2 : 1;
    for (int r = 0; r < modes * runs && status == PALPATE_OK; r++) {
        int reader = r % modes, first = r < modes;
        meter m;
        def.field_by = reader ? PALPATE_FIELD_BY_READER : PALPATE_FIELD_BY_SERVO;
        status = init_meter(&m, error);
        if (status == PALPATE_OK) {
            status = run_once(model, &def, &device, length, &m, out, error);
        }
        if (status == PALPATE_OK && reader) {
            keep_least(&out->render_us, &m.tick, first);
        } else if (status == PALPATE_OK) {
            keep_least(&out->force_us, &m.force, first);
            keep_least(&out->field_us, &m.field, first);
            keep_least(&out->tick_us, &m.tick, first);
        }
        clear_meter(&m);
    }
    if (device.close != NULL) {
        device.close(device.self);
    }
    if (status == PALPATE_OK && out->ticks == 0) {
        status = pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "tool '%.*s' touches nothing in its own motion: there is no tick to measure; move "
            "its start or its device",
            PALPATE_NAME_MAX, tool.name);
    }
    return status;
}
