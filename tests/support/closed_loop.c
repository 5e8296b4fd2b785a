/// @file closed_loop.c  A simulated device and an engine in a loop, without threads or clock.
#include "tests/support/closed_loop.h"

#include <math.h>
#include <string.h>

#include "haptic/model/model.h"
#include "haptic/safety/passivity.h"

static pal_status make(const loop_def *def, pal_engine **engine, pal_error *error) {
    pal_engine_def e = pal_engine_default_def();
    e.tool_count = 1;
    e.tools = &def->tool;
    e.period = def->period;
    if (def->points > 0) {
        e.contact_points = def->points;
    }
    if (def->nodes) {
        e.contact_law = PALPATE_CONTACT_NODES;
    }
    return pal_engine_create(def->model, &e, engine, error);
}

/// Box of the positions of one window.
typedef struct box {
    double low[3], high[3];
    int filled;
} box;

static void fill(box *b, const double x[3]) {
    for (int k = 0; k < 3; k++) {
        b->low[k] = b->filled ? fmin(b->low[k], x[k]) : x[k];
        b->high[k] = b->filled ? fmax(b->high[k], x[k]) : x[k];
    }
    b->filled = 1;
}

static double diagonal(const box *b) {
    double sum = 0.0;
    for (int k = 0; k < 3; k++) {
        sum += (b->high[k] - b->low[k]) * (b->high[k] - b->low[k]);
    }
    return sqrt(sum);
}

pal_status loop_run(const loop_def *def, loop_result *out, pal_error *error) {
    pal_engine *engine = NULL;
    pal_device device;
    memset(out, 0, sizeof *out);
    pal_status status = make(def, &engine, error);
    if (status != PALPATE_OK) {
        return status;
    }
    status = pal_device_create(&def->tool, def->period, &device, error);
    if (status != PALPATE_OK) {
        pal_engine_free(engine);
        return status;
    }
    const int64_t ticks = llround(def->seconds / def->period);
    const int64_t cycle = def->cycle > 0.0 ? llround(def->cycle / def->period) : 0;
    pal_passivity port = {0};
    box window = {.filled = 0};
    double taken_before = 0.0;
    int cycles = 0, current = 0, still = 0;
    out->cycle_given = -INFINITY;
    for (int64_t n = 0; n < ticks; n++) {
        pal_tool_state in;
        pal_tool_force force;
        int64_t time_ns = llround((double)n * def->period * 1e9);
        memset(&in, 0, sizeof in);
        (void)device.read(device.self, time_ns, &in);
        out->faults |= pal_engine_force(engine, &in, &force);
        (void)device.write(device.self, time_ns, &force);
        (void)pal_passivity_tick(&port, in.position, force.force);
        const double *f = force.force;
        out->touching = force.contact_count;
        out->peak_force = fmax(out->peak_force, sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
        int here = (int)(n * LOOP_WINDOWS / ticks);
        if (here != current) {
            out->swing[current] = diagonal(&window);
            window.filled = 0;
            current = here;
        }
        fill(&window, in.position);
        still = memcmp(in.position, out->end, sizeof out->end) == 0 ? still + 1 : 0;
        if (def->stop_when_still && still * def->period >= 0.5) {
            break; // nothing moves any more: nothing will
        }
        memcpy(out->end, in.position, sizeof out->end);
        if (cycle > 0 && n > 0 && n % cycle == 0) {
            double excess = pal_passivity_mark(&port);
            if (++cycles > 2) {
                out->cycle_given = fmax(out->cycle_given, excess);
                out->cycle_taken += port.taken - taken_before;
            }
            taken_before = port.taken;
        }
    }
    out->swing[current] = diagonal(&window);
    out->given = port.given;
    out->taken = port.taken;
    out->worst = port.worst;
    out->cycle_taken /= cycles > 2 ? cycles - 2 : 1;
    device.close(device.self);
    pal_engine_free(engine);
    return PALPATE_OK;
}

static double widest(const loop_result *r, int from, int to) {
    double most = 0.0;
    for (int i = from; i < to; i++) {
        most = fmax(most, r->swing[i]);
    }
    return most;
}

int loop_calms(const loop_result *r, double resolution) {
    double middle = widest(r, 2, 6), late = widest(r, 16, LOOP_WINDOWS);
    double noise = 1e-6 * r->swing[0]; // decayed to rounding: no growth
    return late <= fmax(fmax(0.9 * middle, noise), 2.0 * sqrt(3.0) * resolution);
}

/// |skew part| / mean diagonal of the stiffness of one column's node, held alone.
static double skew_of(const pal_model *model, int32_t column, double *largest) {
    size_t n = 3 * (size_t)model->info.column_count, first = 3 * (size_t)column;
    double c[3][3], k[3][3];
    for (size_t i = 0; i < 3; i++) {
        for (size_t j = 0; j < 3; j++) {
            c[i][j] = model->c_tt[first + i + (first + j) * n];
        }
    }
    double det = 0.0;
    for (int i = 0; i < 3; i++) {
        for (int j = 0; j < 3; j++) { // cofactors, cyclic
            int a = (i + 1) % 3, b = (i + 2) % 3, d = (j + 1) % 3, e = (j + 2) % 3;
            k[j][i] = c[a][d] * c[b][e] - c[a][e] * c[b][d];
        }
        det += c[0][i] * k[i][0];
    }
    double skew = 0.0, mean = 0.0;
    *largest = 0.0;
    for (int i = 0; i < 3; i++) {
        int a = (i + 1) % 3, b = (i + 2) % 3;
        double w = 0.5 * (k[a][b] - k[b][a]) / det;
        skew += w * w;
        mean += k[i][i] / det / 3.0;
        *largest = fmax(*largest, k[i][i] / det);
    }
    return sqrt(skew) / mean;
}

int32_t loop_worst_column(const pal_model *model) {
    int32_t worst = 0;
    double most = -1.0, unused;
    for (int32_t i = 0; i < model->info.column_count; i++) {
        double skew = skew_of(model, i, &unused);
        if (skew > most) {
            most = skew;
            worst = i;
        }
    }
    return worst;
}

pal_tool_def loop_forceps(const pal_model *model, int32_t node, double damping, double *skew,
                          double *stiffness) {
    pal_tool_def t = {.name = "forceps", .shape = PALPATE_SHAPE_POINT, .has_start = 1};
    int32_t column = node >= 0 ? node : loop_worst_column(model);
    double largest, share = skew_of(model, column, &largest);
    for (int k = 0; k < 3; k++) {
        t.start[k] = model->position[3 * model->column_node[column] + k];
        t.axis[k] = -model->normal[3 * model->column_node[column] + k];
    }
    if (skew != NULL) {
        *skew = share;
    }
    if (stiffness != NULL) {
        *stiffness = largest;
    }
    t.device.kind = PALPATE_DEVICE_SIMULATED;
    pal_simulated *s = &t.device.simulated;
    *s = pal_simulated_default(PALPATE_SIMULATED_TOUCH, PALPATE_GRIP_FIRM);
    s->friction = s->resolution = 0.0;
    s->damping = damping;
    s->grasp = 0.6;
    s->release = 1.5;
    t.device.stroke = (pal_stroke){.kind = PALPATE_STROKE_CIRCLE,
                                   .depth = 2e-3,
                                   .ramp = 0.5,
                                   .period = 1.0,
                                   .amplitude = 2e-3,
                                   .direction = {1, 0, 0}};
    return t;
}

double loop_press(const pal_model *model, const pal_tool_def *tool, double depth) {
    loop_def def = {.model = model, .tool = *tool, .period = 1e-3};
    pal_engine *engine = NULL;
    pal_error error;
    def.tool.coupling_stiffness = def.tool.coupling_damping = 0.0;
    def.tool.limits = (pal_tool_limits){.force = INFINITY, .slew = INFINITY, .torque = INFINITY};
    if (make(&def, &engine, &error) != PALPATE_OK) {
        return NAN;
    }
    pal_tool_force force = {0};
    for (int n = 0; n <= 100; n++) {
        pal_tool_state in = {.orientation = {1.0, 0.0, 0.0, 0.0}};
        for (int k = 0; k < 3; k++) {
            in.position[k] = tool->start[k] + 0.01 * n * depth * tool->axis[k];
        }
        (void)pal_engine_force(engine, &in, &force);
    }
    pal_engine_free(engine);
    return -(force.force[0] * tool->axis[0] + force.force[1] * tool->axis[1] +
             force.force[2] * tool->axis[2]);
}
