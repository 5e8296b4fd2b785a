/// @file stroke.c  Scripted strokes as functions of time (formulas: stroke.h).
#include "haptic/device/stroke.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

static const double pi = 3.14159265358979323846;

/// Scale to unit length. @return 0 when the vector is zero or not finite.
static int normalise(double v[3]) {
    double length = sqrt(v3_dot(v, v));
    if (!(length > 1e-300) || !isfinite(length)) {
        return 0;
    }
    for (int k = 0; k < 3; k++) {
        v[k] /= length;
    }
    return 1;
}

/// u: `direction` made perpendicular to the axis; any perpendicular when it has no such part.
static void make_frame(const double direction[3], const double axis[3], double frame[3][3]) {
    double *u = frame[0], along = v3_dot(direction, axis);
    double size = sqrt(v3_dot(direction, direction));
    for (int k = 0; k < 3; k++) {
        u[k] = direction[k] - along * axis[k];
    }
    if (!(sqrt(v3_dot(u, u)) > 1e-6 * size) || !normalise(u)) {
        int least = fabs(axis[0]) <= fabs(axis[1]) ? 0 : 1;
        least = fabs(axis[2]) < fabs(axis[least]) ? 2 : least;
        for (int k = 0; k < 3; k++) {
            u[k] = (k == least) - axis[least] * axis[k];
        }
        (void)normalise(u);
    }
    memcpy(frame[2], axis, sizeof frame[2]);
    v3_cross(frame[2], frame[0], frame[1]);
}

/// Shortest rotation of (0, 0, -1) onto a unit vector: q = (1 + c, from x to) normalised.
static void turn_to(const double axis[3], double q[4]) {
    const double from[3] = {0, 0, -1};
    double c = v3_dot(from, axis);
    if (c < -1.0 + 1e-12) { // opposite: half a turn about x
        const double half[4] = {0, 1, 0, 0};
        memcpy(q, half, sizeof half);
        return;
    }
    q[0] = 1.0 + c;
    v3_cross(from, axis, q + 1);
    double norm = sqrt(q[0] * q[0] + v3_dot(q + 1, q + 1));
    for (int k = 0; k < 4; k++) {
        q[k] /= norm;
    }
}

pal_status pal_stroke_bind(const char *name, const pal_stroke *stroke, const double start[3],
                           const double axis[3], pal_stroke_path *out, pal_error *error) {
    const struct {
        const char *key;
        double value, low, high;
    } range[] = {
        {"depth [m]", stroke->depth, -1e3, 1e3},
        {"ramp [s]", stroke->ramp, 0.0, 1e6},
        {"period [s]", stroke->period, 0.0, 1e6},
        {"amplitude [m]", stroke->amplitude, 0.0, 1e3},
        {"tremor amplitude [m]", stroke->tremor_amplitude, 0.0, 1e3},
        {"tremor frequency [Hz]", stroke->tremor_frequency, 0.0, 1e3},
    };
    for (size_t i = 0; i < sizeof range / sizeof *range; i++) {
        if (!(range[i].value >= range[i].low && range[i].value <= range[i].high)) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "tool '%s': scripted stroke: %s is %g, allowed: %g to %g", name,
                            range[i].key, range[i].value, range[i].low, range[i].high);
        }
    }
    if (stroke->kind < PALPATE_STROKE_PRESS || stroke->kind > PALPATE_STROKE_PALPATION) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "tool '%s': unknown stroke kind %d", name,
                        (int)stroke->kind);
    }
    if (stroke->kind != PALPATE_STROKE_PRESS && !(stroke->period > 0.0)) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "tool '%s': scripted stroke: period is %g s; slide, circle and palpation need "
            "one above 0",
            name, stroke->period);
    }
    if (stroke->kind == PALPATE_STROKE_CIRCLE && !(stroke->ramp > 0.0)) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "tool '%s': scripted stroke: ramp is %g s; a circle needs one above 0 to reach "
            "its radius without a jump",
            name, stroke->ramp);
    }
    memset(out, 0, sizeof *out);
    out->stroke = *stroke;
    double unit[3] = {axis[0], axis[1], axis[2]};
    if (!normalise(unit) || !isfinite(v3_dot(start, start)) ||
        !isfinite(v3_dot(stroke->direction, stroke->direction))) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tool '%s': start, axis and direction must be finite and the axis not zero",
                        name);
    }
    memcpy(out->start, start, sizeof out->start);
    make_frame(stroke->direction, unit, out->frame);
    turn_to(unit, out->orientation);
    return PALPATE_OK;
}

/// Raised cosine from 0 at t <= 0 to 1 at t >= length.
static double ease(double t, double length) {
    if (t >= length) {
        return 1.0;
    }
    return t <= 0.0 ? 0.0 : 0.5 - 0.5 * cos(pi * t / length);
}

static double tremor(const pal_stroke *s, int axis, double time) {
    static const double ratio[3] = {0.87, 1.0, 1.16}, weight[3] = {0.3, 0.5, 0.2};
    static const double phase[3][3] = {{0.3, 1.9, 4.1}, {2.2, 0.7, 5.3}, {1.1, 3.7, 2.9}};
    double sum = 0.0;
    for (int i = 0; i < 3; i++) {
        sum += weight[i] * sin(2.0 * pi * ratio[i] * s->tremor_frequency * time + phase[axis][i]);
    }
    return s->tremor_amplitude * ease(time, s->ramp) * sum;
}

void pal_stroke_at(const pal_stroke_path *path, double time, pal_tool_state *state) {
    const pal_stroke *s = &path->stroke;
    double t = time > 0.0 ? time : 0.0;
    double move[3] = {0, 0, s->depth * ease(t, s->ramp)}; // along u, v, axis
    double after = t > s->ramp ? t - s->ramp : 0.0;
    double reach = s->amplitude * ease(after, s->ramp);
    double turn = s->period > 0.0 ? 2.0 * pi * (after / s->period) : 0.0;
    switch (s->kind) {
    case PALPATE_STROKE_PRESS:
        break;
    case PALPATE_STROKE_SLIDE:
        move[0] = after > 0.0 ? reach * sin(turn) : 0.0;
        break;
    case PALPATE_STROKE_CIRCLE:
        move[0] = after > 0.0 ? reach * cos(turn) : 0.0;
        move[1] = after > 0.0 ? reach * sin(turn) : 0.0;
        break;
    case PALPATE_STROKE_PALPATION:
        move[2] = s->depth * (0.5 - 0.5 * cos(2.0 * pi * (t / s->period)));
        break;
    }
    memset(state, 0, sizeof *state);
    memcpy(state->orientation, path->orientation, sizeof state->orientation);
    for (int k = 0; k < 3; k++) {
        state->position[k] = path->start[k] + move[0] * path->frame[0][k] +
                             move[1] * path->frame[1][k] + move[2] * path->frame[2][k];
        if (s->tremor_amplitude > 0.0) {
            state->position[k] += tremor(s, k, t);
        }
    }
}

pal_status pal_stroke_sample(const pal_stroke_path *path, double duration, double rate,
                             pal_trajectory *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    double samples = floor(duration * rate + 0.5) + 1.0;
    if (!(duration >= 0.0) || !(rate > 0.0) || !(samples <= 1e8)) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "trajectory of %g s at %g Hz: allowed: a duration >= 0, a rate above 0, at most "
            "1e8 samples",
            duration, rate);
    }
    int64_t count = (int64_t)samples;
    out->sample = calloc((size_t)count, sizeof *out->sample);
    if (out->sample == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "trajectory: no memory for %lld samples",
                        (long long)count);
    }
    out->count = count;
    for (int64_t i = 0; i < count; i++) {
        pal_tool_state state;
        pal_sample *s = &out->sample[i];
        s->time = (double)i / rate;
        pal_stroke_at(path, s->time, &state);
        memcpy(s->position, state.position, sizeof s->position);
        memcpy(s->orientation, state.orientation, sizeof s->orientation);
    }
    return PALPATE_OK;
}
