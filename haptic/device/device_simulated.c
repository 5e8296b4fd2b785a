/// @file device_simulated.c  A simulated device in a simulated hand, stepped by the servo.
///
/// The pose of a tick is read, the engine answers, the force is written; it then acts, unchanged
/// (zero-order hold) and never above what the actuators can give, until the next tick is read, when
/// the mechanics (simulated.h) is advanced over the time that has passed. The three axes are equal
/// and independent. The session sees encoder positions: each coordinate rounded to the resolution.
/// Forces only: like the devices it stands for, it has no motors for torque; the orientation is the
/// stroke's. A function of the forces and times given alone: runs in freewheel are reproducible.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/device/device.h"
#include "haptic/base/error.h"
#include "haptic/device/simulated.h"
#include "haptic/device/stroke.h"

/// Longest time that is caught up in one read [s]; a servo that stood still longer finds the device
/// where this much time has brought it.
static const double CATCH_UP = 1.0;

typedef struct simulated_device {
    pal_simulated def;
    pal_stroke_path path;
    double period;
    int64_t now;         ///< time of the mechanical state [ns]
    int started;         ///< a first read has set `now`
    double state[3][2];  ///< per axis: position [m], velocity [m/s]
    double reference[3]; ///< hand's intended position at `now` [m]
    double force[3];     ///< held [N]
} simulated_device;

static void begin(simulated_device *d, int64_t time_ns) {
    pal_tool_state intended;
    pal_stroke_at(&d->path, 1e-9 * (double)time_ns, &intended);
    for (int k = 0; k < 3; k++) {
        d->reference[k] = intended.position[k];
        d->state[k][0] = d->path.start[k];
        d->state[k][1] = d->def.kick * d->path.frame[2][k];
        d->force[k] = 0.0;
    }
    d->now = time_ns;
    d->started = 1;
}

/// One stretch of constant force and linear reference.
static void advance(simulated_device *d, double from, double time) {
    const pal_simulated *s = &d->def;
    int held = s->release <= 0.0 || from < s->release;
    const pal_axis axis = {.mass = s->mass + (held ? s->hand_mass : 0.0),
                           .damping = s->damping + (held ? s->hand_damping : 0.0),
                           .stiffness = held ? s->hand_stiffness : 0.0,
                           .hand_damping = held ? s->hand_damping : 0.0,
                           .friction = s->friction};
    pal_tool_state intended;
    pal_stroke_at(&d->path, from + time, &intended);
    for (int k = 0; k < 3; k++) {
        double rate = (intended.position[k] - d->reference[k]) / time;
        double push = d->force[k] + s->push * d->path.frame[2][k];
        pal_axis_advance(&axis, time, push, d->reference[k], rate, d->state[k]);
        double low = d->path.start[k] - s->reach, high = d->path.start[k] + s->reach;
        if (!(d->state[k][0] > low && d->state[k][0] < high)) { // inelastic stop
            d->state[k][0] = d->state[k][0] >= high ? high : low;
            d->state[k][1] = 0.0;
        }
        d->reference[k] = intended.position[k];
    }
}

static pal_status simulated_read(void *self, int64_t time_ns, pal_tool_state *state) {
    simulated_device *d = self;
    if (!d->started || time_ns < d->now) { // first, or started anew
        begin(d, time_ns);
    }
    double from = 1e-9 * (double)d->now;
    double passed = 1e-9 * (double)(time_ns - d->now);
    double left = fmin(passed, CATCH_UP);
    while (left > 0.0) {
        double step = left < 1.5 * d->period ? left : d->period;
        advance(d, from, step);
        from += step;
        left = step < left ? left - step : 0.0;
    }
    d->now = time_ns;
    pal_stroke_at(&d->path, 1e-9 * (double)time_ns, state);
    for (int k = 0; k < 3; k++) {
        double x = d->state[k][0], step = d->def.resolution;
        state->position[k] = step > 0.0 ? step * nearbyint(x / step) : x;
    }
    state->buttons = d->def.grasp > 0.0 && 1e-9 * (double)time_ns >= d->def.grasp;
    state->time_ns = time_ns;
    return PALPATE_OK;
}

static pal_status simulated_write(void *self, int64_t time_ns, const pal_tool_force *force) {
    simulated_device *d = self;
    (void)time_ns;
    const double *f = force->force;
    double size = sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]);
    double part = size > d->def.force ? d->def.force / size : 1.0;
    for (int k = 0; k < 3; k++) {
        d->force[k] = isfinite(size) ? part * f[k] : 0.0;
    }
    return PALPATE_OK;
}

static void simulated_close(void *self) {
    free(self);
}

static pal_status check(const char *name, const pal_simulated *s, double period, pal_error *error) {
    const struct {
        const char *key;
        double value, low, high;
    } range[] = {
        {"mass [kg]", s->mass, 1e-3, 100.0},
        {"damping [N s/m]", s->damping, 0.0, 1e4},
        {"friction [N]", s->friction, 0.0, 1e3},
        {"resolution [m]", s->resolution, 0.0, 0.01},
        {"force [N]", s->force, 0.0, 1e4},
        {"stiffness [N/m]", s->stiffness, 0.0, 1e9},
        {"reach [m]", s->reach, 1e-4, 1e3},
        {"hand.mass [kg]", s->hand_mass, 0.0, 100.0},
        {"hand.damping [N s/m]", s->hand_damping, 0.0, 1e4},
        {"hand.stiffness [N/m]", s->hand_stiffness, 0.0, 1e6},
        {"push [N]", s->push, -1e3, 1e3},
        {"kick [m/s]", s->kick, -10.0, 10.0},
        {"release [s]", s->release, 0.0, 1e9},
        {"grasp [s]", s->grasp, 0.0, 1e9},
    };
    for (size_t i = 0; i < sizeof range / sizeof *range; i++) {
        if (!(range[i].value >= range[i].low && range[i].value <= range[i].high)) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "tool '%s': simulated device: %s is %g, allowed: %g to %g", name,
                            range[i].key, range[i].value, range[i].low, range[i].high);
        }
    }
    const pal_axis alone = {.mass = s->mass, .damping = s->damping};
    const pal_axis held = {.mass = s->mass + s->hand_mass,
                           .damping = s->damping + s->hand_damping,
                           .stiffness = s->hand_stiffness};
    const double most = 100.0; // bounds the work of a tick
    double rate = fmax(pal_axis_rate(&alone), pal_axis_rate(&held));
    if (!(rate * period <= most)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tool '%s': simulated device: damping and stiffness give a rate of %g 1/s "
                        "with this mass, allowed at a period of %g s: %g; more mass or less "
                        "damping",
                        name, rate, period, most / period);
    }
    return PALPATE_OK;
}

pal_status pal_device_simulated_create(const pal_tool_def *tool, double period, pal_device *out,
                                       pal_error *error) {
    const pal_simulated *s = &tool->device.simulated;
    if (!tool->has_start) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tool '%s': a simulated device needs the tool's start and axis",
                        tool->name);
    }
    pal_status status = check(tool->name, s, period, error);
    if (status != PALPATE_OK) {
        return status;
    }
    simulated_device *self = calloc(1, sizeof *self);
    if (self == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "tool '%s': no memory for its device",
                        tool->name);
    }
    status = pal_stroke_bind(tool->name, &tool->device.stroke, tool->start, tool->axis, &self->path,
                             error);
    if (status != PALPATE_OK) {
        free(self);
        return status;
    }
    self->def = *s;
    self->period = period;
    out->abi = PALPATE_DEVICE_ABI;
    out->self = self;
    (void)snprintf(out->spec.name, sizeof out->spec.name, "simulated");
    out->spec.max_force = s->force;
    out->spec.max_stiffness = s->stiffness;
    out->spec.damping = s->damping;
    out->spec.resolution = s->resolution;
    out->read = simulated_read;
    out->write = simulated_write;
    out->close = simulated_close;
    return PALPATE_OK;
}
