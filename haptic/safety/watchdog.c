/// @file watchdog.c  Stale, stalled, jumping: ramp and latch (rules: watchdog.h).
#include "haptic/safety/watchdog.h"

#include <math.h>
#include <string.h>

#include "haptic/base/error.h"

enum { BIT_STALE = 8, BIT_JUMP = 9, BIT_STALL = 10, BIT_LATCHED = 11, BIT_RAMP = 12 };
_Static_assert(PALPATE_FAULT_STALE == 1u << BIT_STALE && PALPATE_FAULT_JUMP == 1u << BIT_JUMP &&
                   PALPATE_FAULT_STALL == 1u << BIT_STALL &&
                   PALPATE_FAULT_LATCHED == 1u << BIT_LATCHED &&
                   PALPATE_FAULT_RAMP == 1u << BIT_RAMP,
               "bits of PALPATE_FAULT_LIST");

/// Range and default of each threshold. Bounds keep it a watchdog: none is infinite.
static const struct {
    const char *name;
    size_t offset;
    double low, high, usual;
} threshold[] = {
    {"stale", offsetof(pal_watchdog_def, stale), 1e-3, 1.0, 0.02},
    {"stall", offsetof(pal_watchdog_def, stall), 1e-3, 10.0, 0.1},
    {"latch", offsetof(pal_watchdog_def, latch), 1e-3, 60.0, 1.0},
    {"speed", offsetof(pal_watchdog_def, speed), 1e-3, 1000.0, 20.0},
    {"ramp_down", offsetof(pal_watchdog_def, ramp_down), 1e-6, 1.0, 0.01},
    {"ramp_up", offsetof(pal_watchdog_def, ramp_up), 1e-3, 10.0, 0.1},
};
enum { THRESHOLDS = sizeof threshold / sizeof *threshold };

pal_status pal_watchdog_check(const pal_watchdog_def *def, pal_error *error) {
    for (int i = 0; i < THRESHOLDS; i++) {
        double v;
        memcpy(&v, (const char *)def + threshold[i].offset, sizeof v);
        if (v != 0.0 && !(v >= threshold[i].low && v <= threshold[i].high)) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "watchdog.%s: %g: must be %g to %g, or 0 for the default %g",
                            threshold[i].name, v, threshold[i].low, threshold[i].high,
                            threshold[i].usual);
        }
    }
    return PALPATE_OK;
}

pal_watchdog_def pal_watchdog_resolve(const pal_watchdog_def *def, const pal_device_spec *spec) {
    pal_watchdog_def out = *def;
    double known = spec->max_speed;
    if (known > 0.0) {
        out.speed = out.speed > 0.0 ? fmin(out.speed, known) : known;
    }
    for (int i = 0; i < THRESHOLDS; i++) {
        double v;
        memcpy(&v, (const char *)&out + threshold[i].offset, sizeof v);
        v = v > 0.0 ? v : threshold[i].usual;
        memcpy((char *)&out + threshold[i].offset, &v, sizeof v);
    }
    return out;
}

void pal_watchdog_trip(pal_watchdog *w) {
    w->latched |= w->scale < 1.0;
    w->scale = 0.0;
}

void pal_watchdog_init(pal_watchdog *w, const pal_watchdog_def *def, double period) {
    pal_watchdog_def kept = *def; // may be w's own
    memset(w, 0, sizeof *w);
    w->def = kept;
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
        if (!(speed <= w->def.speed)) {
            fault = PALPATE_FAULT_JUMP;
            value[BIT_JUMP] = speed;
            pal_watchdog_trip(w);
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
    if (w->latched && (in->flags & PALPATE_STATE_UNLATCH) != 0) {
        w->latched = 0;
        w->scale = 0.0;
    }
    if (at_least(missed, w->period, w->def.stall)) {
        fault |= PALPATE_FAULT_STALL;
        value[BIT_STALL] = missed;
        w->scale = 0.0;
        w->latched |= at_least(missed, w->period, w->def.latch);
    }
    if (is_old(w, in, position)) {
        w->stale += w->stale < UINT32_MAX;
    } else {
        w->stale = 0;
        w->stamp = in->time_ns;
        fault |= judge_jump(w, position, value);
    }
    int stale = at_least(w->stale, w->period, w->def.stale);
    if (stale) {
        fault |= PALPATE_FAULT_STALE;
        value[BIT_STALE] = w->stale;
        w->latched |= at_least(w->stale, w->period, w->def.latch);
    }
    if (w->latched) {
        fault |= PALPATE_FAULT_LATCHED;
        value[BIT_LATCHED] = w->scale;
    }
    if (w->latched || stale) {
        w->scale = fmax(0.0, w->scale - w->period / w->def.ramp_down);
    } else if (w->scale < 1.0 && !(fault & (PALPATE_FAULT_JUMP | PALPATE_FAULT_STALL))) {
        fault |= PALPATE_FAULT_RAMP;
        value[BIT_RAMP] = w->scale;
        w->scale = fmin(1.0, w->scale + w->period / w->def.ramp_up);
    }
    return fault;
}
