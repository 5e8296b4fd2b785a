/// @file soak_hand.c  Random but physical motion, and faults of the device that reports it.
///
/// A hand works around a random node of the touchable surface: it comes from outside, presses to a
/// random depth and leaves again (a raised sine along the node's normal), slides and circles in the
/// tangent plane, trembles at 8 to 12 Hz (physiological: some 0.1 mm) and turns its wrist. Speeds
/// stay below 1 m/s, so a jump is always a fault. Faults begin at random and last random times.
#include "tests/soak/soak.h"

#include <math.h>
#include <string.h>

#include "haptic/model/model.h"

static uint64_t next(soak_rng *r) {
    uint64_t z = r->state += 0x9E3779B97F4A7C15u;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    return z ^ (z >> 31);
}

double soak_uniform(soak_rng *r, double low, double high) {
    return low + (high - low) * ((double)(next(r) >> 11) * 0x1p-53);
}

int soak_chance(soak_rng *r, double probability) {
    return soak_uniform(r, 0.0, 1.0) < probability;
}

int64_t soak_below(soak_rng *r, int64_t n) {
    return (int64_t)(next(r) % (uint64_t)n);
}

static void unit(double v[3]) {
    double l = sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
    for (int i = 0; i < 3; i++) {
        v[i] /= l;
    }
}

static void random_direction(soak_rng *r, double v[3]) {
    double l = 0.0;
    v[0] = v[1] = v[2] = 1.0;
    while (!(l > 0.01 && l < 1.0)) {
        l = 0.0;
        for (int i = 0; i < 3; i++) {
            v[i] = soak_uniform(r, -1.0, 1.0);
            l += v[i] * v[i];
        }
    }
    unit(v);
}

static void cross(const double a[3], const double b[3], double out[3]) {
    for (int i = 0; i < 3; i++) {
        int j = (i + 1) % 3, k = (i + 2) % 3;
        out[i] = a[j] * b[k] - a[k] * b[j];
    }
}

void soak_hand_init(soak_hand *h, soak_episode *e, int index) {
    soak_rng *r = &e->rng;
    const pal_tool_def *tool = &e->tool[index];
    memset(h, 0, sizeof *h);
    h->episode = e;
    h->index = index;
    h->rng.state = next(r);
    int32_t node = e->model->column_node[soak_below(r, e->model->info.column_count)];
    memcpy(h->origin, e->model->position + 3 * (size_t)node, sizeof h->origin);
    memcpy(h->normal, e->model->normal + 3 * (size_t)node, sizeof h->normal);
    double other[3];
    random_direction(r, other);
    cross(h->normal, other, h->tangent);
    unit(h->tangent);
    cross(h->normal, h->tangent, h->side);
    // a capsule lies across its z, wherever that points: it must start outside in any case
    double reach = tool->shape == PALPATE_SHAPE_POINT ? 0.0 : tool->radius + 0.5 * tool->length;
    h->clearance = reach + soak_uniform(r, 0.001, 0.01);
    h->depth = soak_uniform(r, 0.0005, 0.08 * e->size) -
               (tool->shape == PALPATE_SHAPE_POINT ? 0.0 : tool->radius);
    h->press_rate = soak_uniform(r, 0.2, 2.0);
    h->press_phase = -1.5707963267948966; // from outside
    for (int k = 0; k < 2; k++) {
        h->slide[k] = soak_chance(r, 0.6) ? soak_uniform(r, 0.0, 0.15 * e->size) : 0.0;
        h->slide_rate[k] = soak_uniform(r, 0.1, 1.5);
        h->slide_phase[k] = soak_uniform(r, 0.0, 6.28);
    }
    h->tremor = soak_chance(r, 0.7) ? soak_uniform(r, 0.0, 3e-4) : 0.0;
    h->tremor_rate = soak_uniform(r, 8.0, 12.0);
    random_direction(r, h->turn_axis);
    h->turn = soak_chance(r, 0.5) ? soak_uniform(r, 0.0, 1.0) : 0.0;
    h->turn_rate = soak_uniform(r, 0.1, 1.0);
    h->grasps = soak_chance(r, 0.15);
    if (soak_chance(r, 0.3)) { // in and out along one line: the path is retraced
        h->slide[0] = h->slide[1] = h->tremor = h->turn = 0.0;
        h->grasps = 0;
        h->retraces = 1;
    }
    h->fault_rate = soak_chance(r, 0.3) ? 0.0 : soak_uniform(r, 0.0, 0.003);
}

static void honest_pose(soak_hand *h, double t, pal_tool_state *state) {
    const double turn = 6.283185307179586;
    double press = 0.5 + 0.5 * sin(turn * h->press_rate * t + h->press_phase);
    double height = h->clearance - (h->clearance + h->depth) * press;
    double a = h->slide[0] * sin(turn * h->slide_rate[0] * t + h->slide_phase[0]);
    double b = h->slide[1] * sin(turn * h->slide_rate[1] * t + h->slide_phase[1]);
    a += h->tremor * sin(turn * h->tremor_rate * t);
    height += h->tremor * sin(1.13 * turn * h->tremor_rate * t);
    double angle = 0.5 * h->turn * sin(turn * h->turn_rate * t);
    state->orientation[0] = cos(angle);
    for (int i = 0; i < 3; i++) {
        state->position[i] =
            h->origin[i] + height * h->normal[i] + a * h->tangent[i] + b * h->side[i];
        state->orientation[i + 1] = sin(angle) * h->turn_axis[i];
    }
    state->buttons = h->grasps && sin(turn * 0.7 * t) > 0.3;
}

/// Maybe a fault begins.
static void roll(soak_hand *h) {
    if (h->fault_left > 0) {
        h->fault_left--;
        return;
    }
    h->fault = SOAK_NONE;
    if (!soak_chance(&h->rng, h->fault_rate)) {
        return;
    }
    int kinds = h->episode->by_session ? SOAK_MISSED : SOAK_FAULTS;
    h->fault = (soak_fault)(1 + soak_below(&h->rng, kinds - 1));
    h->injected[h->fault]++;
    static const int64_t most[] = {1, 5, 60, 300, 1500};
    h->fault_left = soak_below(&h->rng, most[soak_below(&h->rng, 5)]);
    random_direction(&h->rng, h->jump);
    double by = soak_uniform(&h->rng, 0.05, 1.0);
    for (int i = 0; i < 3; i++) {
        h->jump[i] *= by;
    }
}

pal_status soak_hand_read(soak_hand *h, int64_t time_ns, pal_tool_state *state) {
    static const double nonsense[] = {NAN, INFINITY, -INFINITY};
    soak_episode *e = h->episode;
    int64_t now = time_ns + 1000000000; // 0 means no stamp
    roll(h);
    memset(state, 0, sizeof *state);
    if (h->simulated) {
        (void)h->inner.read(h->inner.self, time_ns, state);
    } else {
        honest_pose(h, 1e-9 * (double)time_ns, state);
    }
    state->time_ns = now;
    pal_status status = PALPATE_OK;
    int old = 0;
    int first = h->stamp == 0; // nothing came before it that it could be older than
    switch (h->fault) {
    case SOAK_NOT_A_NUMBER:
        (soak_chance(&h->rng, 0.5) ? state->position : state->orientation)[soak_below(&h->rng, 3)] =
            nonsense[soak_below(&h->rng, 3)];
        old = 1;
        break;
    case SOAK_REFUSED:
        status = PALPATE_ERROR_DEVICE;
        h->refused++;
        old = 1;
        break;
    case SOAK_FROZEN:
        state->time_ns = first ? now : h->stamp;
        old = !first;
        break;
    case SOAK_BACKWARDS:
        if (!first) {
            state->time_ns = h->stamp - (now - h->stamp);
            state->time_ns -= state->time_ns == 0; // 0 would be no stamp at all
            old = 1;
        }
        break;
    case SOAK_TELEPORT:
        for (int i = 0; i < 3; i++) {
            state->position[i] += h->jump[i];
        }
        break;
    case SOAK_NONE:
    case SOAK_REFUSED_WRITE:
    case SOAK_MISSED:
    case SOAK_FAULTS:
        break;
    }
    h->unusable = old ? h->unusable + 1 : 0;
    h->stamp = old ? h->stamp : now;
    e->in[h->index] = *state;
    e->bad[h->index] = h->fault != SOAK_NONE && h->fault != SOAK_REFUSED_WRITE;
    return status;
}

pal_status soak_hand_write(soak_hand *h, int64_t time_ns, const pal_tool_force *force) {
    if (h->simulated) {
        (void)h->inner.write(h->inner.self, time_ns, force);
    }
    if (h->fault == SOAK_REFUSED_WRITE) {
        h->refused++;
        return PALPATE_ERROR_DEVICE;
    }
    return PALPATE_OK;
}
