/// @file soak_check.c  What must hold in every tick.
///
/// Limits hold to rounding. Energy: over an excursion (all tools free, then touching, then free
/// again, no fault, limit or grasp in between) the work done on the body is summed by the
/// trapezoidal rule over poses and forces of the ticks. Where one tool retraces its path, in and
/// out along one line, it must not end below zero by more than the rule cannot tell (in and out are
/// sampled at different depths; for a force that is monotone within a tick a trapezoid errs by less
/// than |dF| |dx| / 2, and errors of both signs come: half of that is allowed): whatever the law,
/// it may keep no memory that gives energy back. Where tools slide, forces are the gradient of an
/// energy to a few per cent only (contact_touch.c, test_contact_energy), those of the nodal law not
/// at all: measured, not judged.
#include "tests/soak/soak.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#define FAULT_BIT(name, bit, text) | name
static const uint32_t KNOWN = 0u PALPATE_FAULT_LIST(FAULT_BIT);

void soak_fail(soak_episode *e, const char *format, ...) {
    if (e->failure[0] != 0) {
        return;
    }
    va_list args;
    va_start(args, format);
    (void)vsnprintf(e->failure, sizeof e->failure, format, args);
    va_end(args);
    if (e->session != NULL) {
        pal_session_request_stop(e->session);
    }
}

static double norm(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static int finite3(const double v[3]) {
    return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]);
}

void soak_check_force(soak_episode *e, int tool, int64_t n, const pal_tool_force *f) {
    soak_track *t = &e->track[tool];
    const pal_engine_def *def = &e->effective;
    const pal_tool_limits *limits = &def->tools[tool].limits;
    double change[3], step = limits->slew * 1e3 * def->period;
    for (int i = 0; i < 3; i++) {
        change[i] = f->force[i] - t->force[i];
    }
    if (!finite3(f->force) || !finite3(f->torque) || !finite3(f->centroid) || !finite3(f->normal) ||
        !isfinite(f->depth)) {
        soak_fail(e, "tick %lld, tool %d: something is not finite", (long long)n, tool);
    }
    if (!(norm(f->force) <= limits->force * (1 + 1e-12))) {
        soak_fail(e, "tick %lld, tool %d: force %.17g N above its cap %.17g N", (long long)n, tool,
                  norm(f->force), limits->force);
    }
    if (!(norm(f->torque) <= limits->torque * (1 + 1e-12))) {
        soak_fail(e, "tick %lld, tool %d: torque %.17g N m above its cap", (long long)n, tool,
                  norm(f->torque));
    }
    // a force that was no number is zero at once
    if (!(f->fault & PALPATE_FAULT_FORCE) && !(norm(change) <= step * (1 + 1e-9) + 1e-13)) {
        soak_fail(e, "tick %lld, tool %d: the force moved by %.17g N, slew allows %.17g N",
                  (long long)n, tool, norm(change), step);
    }
    if (f->contact_count < 0 || f->contact_count > def->max_contacts || f->depth < 0.0 ||
        f->depth > 10.0 * (e->size + 1.0)) {
        soak_fail(e, "tick %lld, tool %d: %d contacts, depth %g m", (long long)n, tool,
                  (int)f->contact_count, f->depth);
    }
    if (f->fault & ~KNOWN) {
        soak_fail(e, "tick %lld, tool %d: fault 0x%x", (long long)n, tool, f->fault);
    }
    double stale = ceil(def->watchdog.stale / def->period * (1 - 1e-9));
    if (e->hand[tool].unusable >= stale && !(f->fault & PALPATE_FAULT_STALE)) {
        soak_fail(e, "tick %lld, tool %d: %d unusable poses in a row and not stale", (long long)n,
                  tool, e->hand[tool].unusable);
    }
    t->latched_for = f->fault & PALPATE_FAULT_LATCHED ? t->latched_for + 1 : 0;
    double fade = def->watchdog.ramp_down / def->period + limits->force / step + 3.0;
    if ((double)t->latched_for > fade && norm(f->force) > 0.0) {
        soak_fail(e, "tick %lld, tool %d: latched for %lld ticks and still %g N", (long long)n,
                  tool, (long long)t->latched_for, norm(f->force));
    }
    for (int bit = 0; bit < 32; bit++) {
        t->fault[bit] += f->fault >> bit & 1u;
    }
    e->energy.largest = fmax(e->energy.largest, norm(f->force));
}

/// Work of one tool on the body between two ticks [J].
static double work(const soak_track *t, const pal_tool_state *in, const pal_tool_force *f) {
    const double *p = t->orientation, *q = in->orientation;
    // rotation from p to q as a vector: twice the vector part of q p*
    const double turn[3] = {2 * (-q[0] * p[1] + q[1] * p[0] - q[2] * p[3] + q[3] * p[2]),
                            2 * (-q[0] * p[2] + q[1] * p[3] + q[2] * p[0] - q[3] * p[1]),
                            2 * (-q[0] * p[3] - q[1] * p[2] + q[2] * p[1] + q[3] * p[0])};
    double w = 0.0;
    for (int i = 0; i < 3; i++) {
        w -= 0.5 * (f->force[i] + t->force[i]) * (in->position[i] - t->position[i]);
        w -= 0.5 * (f->torque[i] + t->torque[i]) * turn[i];
    }
    return w;
}

void soak_check_tick(soak_episode *e, int64_t n, const pal_tool_force out[]) {
    soak_energy *g = &e->energy;
    int free_of_it = 1, ordinary = 1;
    double w = 0.0, blur = 0.0;
    (void)n;
    for (int t = 0; t < e->effective.tool_count; t++) {
        const pal_tool_force *f = &out[t];
        free_of_it &= f->contact_count == 0 && f->depth == 0.0 && norm(f->force) == 0.0;
        ordinary &= (f->fault & ~PALPATE_FAULT_UNFELT) == 0 && !e->bad[t] &&
                    e->in[t].buttons == 0 && e->in[t].flags == 0;
        if (ordinary && g->begun) {
            w += work(&e->track[t], &e->in[t], f);
            double df[3], dx[3];
            for (int i = 0; i < 3; i++) {
                df[i] = f->force[i] - e->track[t].force[i];
                dx[i] = e->in[t].position[i] - e->track[t].position[i];
            }
            blur += 0.25 * norm(df) * norm(dx);
        }
    }
    g->judged &= ordinary && g->begun;
    if (g->judged) {
        g->work += w;
        g->blur += blur;
        g->stored = fmax(g->stored, g->work);
    }
    if (free_of_it) {
        if (g->judged && g->stored > 1e-6) { // below a micronewton metre nothing was felt
            g->excursions++;
            g->worst = fmin(g->worst, g->work / g->stored);
            g->beyond = fmax(g->beyond, -g->work - g->blur);
            g->given += fmax(0.0, -g->work);
            g->taken += fmax(0.0, g->work);
        }
        g->work = g->stored = g->blur = 0.0;
        g->judged = ordinary;
    }
    g->begun = ordinary;
    for (int t = 0; t < e->effective.tool_count; t++) {
        soak_track *s = &e->track[t];
        memcpy(s->force, out[t].force, sizeof s->force);
        memcpy(s->torque, out[t].torque, sizeof s->torque);
        memcpy(s->position, e->in[t].position, sizeof s->position);
        memcpy(s->orientation, e->in[t].orientation, sizeof s->orientation);
    }
}

void soak_check_frame(soak_episode *e, const pal_frame *frame) {
    e->frames++;
    for (int64_t i = 0; frame->displacement != NULL && i < 3 * (int64_t)frame->row_count; i++) {
        if (!isfinite(frame->displacement[i])) {
            soak_fail(e, "frame of tick %llu: displacement %lld is not finite",
                      (unsigned long long)frame->tick, (long long)i);
            return;
        }
    }
}

void soak_check_counts(soak_episode *e, const pal_engine_counts *c) {
    if (c->ticks != (uint64_t)e->ticks) {
        soak_fail(e, "the engine counts %llu ticks of %lld", (unsigned long long)c->ticks,
                  (long long)e->ticks);
    }
    uint64_t onsets = 0;
    for (int bit = 0; bit < 32; bit++) {
        uint64_t mine = 0;
        for (int t = 0; t < e->effective.tool_count; t++) {
            mine += e->track[t].fault[bit];
        }
        onsets += mine > 0;
        if (mine != c->fault[bit]) {
            soak_fail(e, "fault bit %d: the engine counts %llu ticks, %llu were seen", bit,
                      (unsigned long long)c->fault[bit], (unsigned long long)mine);
        }
    }
    if (c->events < onsets || c->contact_ticks > c->ticks) {
        soak_fail(e, "%llu events, %llu contact ticks", (unsigned long long)c->events,
                  (unsigned long long)c->contact_ticks);
    }
}
