/// @file watchdog.c  Stale, stalled, jumping: ramp and latch (rules: watchdog.h).
#include "haptic/watchdog.h"

#include <math.h>
#include <string.h>

enum { BIT_STALE = 8, BIT_JUMP = 9, BIT_STALL = 10, BIT_LATCHED = 11, BIT_RAMP = 12 };
_Static_assert(PALPATE_FAULT_STALE == 1u << BIT_STALE && PALPATE_FAULT_JUMP == 1u << BIT_JUMP &&
                   PALPATE_FAULT_STALL == 1u << BIT_STALL &&
                   PALPATE_FAULT_LATCHED == 1u << BIT_LATCHED &&
                   PALPATE_FAULT_RAMP == 1u << BIT_RAMP,
               "bits of PALPATE_FAULT_LIST");

void pal_watchdog_init(pal_watchdog *w, double period) {
    memset(w, 0, sizeof *w);
    w->period = period;
    w->scale = 1.0;
}

static int at_least(double periods, double period, double seconds) {
    return periods * period >= seconds * (1.0 - 1e-9); // 20 periods of 1 ms are 20 ms
}

/// Is this tick's pose an old one?
static int is_old(const pal_watchdog *w, const pal_tool_state *in, const double position[3]) {
    int frozen = in->time_ns != 0 && w->stamp != 0 && in->time_ns <= w->stamp;
    return position == NULL || (in->flags & PALPATE_STATE_STALE) != 0 || frozen;
}

static uint32_t judge_jump(pal_watchdog *w, const double position[3], double value[32]) {
    uint32_t fault = 0;
    if (w->has_pose) {
        double dx = position[0] - w->position[0], dy = position[1] - w->position[1];
        double dz = position[2] - w->position[2];
        double speed = sqrt(dx * dx + dy * dy + dz * dz) / (w->since * w->period);
        if (!(speed <= PALPATE_WATCH_SPEED)) {
            fault = PALPATE_FAULT_JUMP;
            value[BIT_JUMP] = speed;
            w->latched |= w->scale < 1.0;
            w->scale = 0.0;
        }
    }
    memcpy(w->position, position, sizeof w->position);
    w->has_pose = 1;
    w->since = 0.0;
    return fault;
}

uint32_t pal_watchdog_step(pal_watchdog *w, const pal_tool_state *in, const double position[3],
                           double value[32]) {
    uint32_t fault = 0;
    double missed = (double)(in->flags >> PALPATE_STATE_MISSED_SHIFT);
    w->since += 1.0 + missed;
    if (at_least(missed, w->period, PALPATE_WATCH_STALL)) {
        fault |= PALPATE_FAULT_STALL;
        value[BIT_STALL] = missed;
        w->scale = 0.0;
        w->latched |= at_least(missed, w->period, PALPATE_WATCH_LATCH);
    }
    if (is_old(w, in, position)) {
        w->stale += w->stale < UINT32_MAX;
    } else {
        w->stale = 0;
        w->stamp = in->time_ns;
        fault |= judge_jump(w, position, value);
    }
    int stale = at_least(w->stale, w->period, PALPATE_WATCH_STALE);
    if (stale) {
        fault |= PALPATE_FAULT_STALE;
        value[BIT_STALE] = w->stale;
        w->latched |= at_least(w->stale, w->period, PALPATE_WATCH_LATCH);
    }
    if (w->latched) {
        fault |= PALPATE_FAULT_LATCHED;
        value[BIT_LATCHED] = w->scale;
    }
    if (w->latched || stale) {
        w->scale = fmax(0.0, w->scale - w->period / PALPATE_WATCH_RAMP_DOWN);
    } else if (w->scale < 1.0 && !(fault & (PALPATE_FAULT_JUMP | PALPATE_FAULT_STALL))) {
        fault |= PALPATE_FAULT_RAMP;
        value[BIT_RAMP] = w->scale;
        w->scale = fmin(1.0, w->scale + w->period / PALPATE_WATCH_RAMP_UP);
    }
    return fault;
}
