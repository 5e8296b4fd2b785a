/// @file replay.c  Feeding a recording to an engine and comparing what comes out (see replay.h).
#include "haptic/recording/replay_read.h"

#include <math.h>
#include <pthread.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/realtime.h"

enum { CHUNK = 4096 };

typedef struct replay {
    pal_recording *recording;
    pal_engine *engine;
    uint64_t max_ticks;
    pal_replay_report *report;
    double square_sum;
    pal_tick_record *row; ///< a chunk, and what is left of the one before
    pal_status status;
    pal_error *error;
} replay;

static double length(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

/// The first member that differs bit for bit, or NULL.
static const char *difference(const pal_tool_force *a, const pal_tool_force *b) {
    return memcmp(a->force, b->force, sizeof a->force) != 0            ? "force"
           : memcmp(a->torque, b->torque, sizeof a->torque) != 0       ? "torque"
           : a->contact_count != b->contact_count                      ? "contacts"
           : a->fault != b->fault                                      ? "fault"
           : memcmp(&a->depth, &b->depth, sizeof a->depth) != 0        ? "depth"
           : memcmp(a->centroid, b->centroid, sizeof a->centroid) != 0 ? "centroid"
           : memcmp(a->normal, b->normal, sizeof a->normal) != 0       ? "normal"
                                                                       : NULL;
}

static void compare(replay *p, const pal_tick_record *row, const pal_tool_force *force) {
    pal_replay_report *r = p->report;
    const char *what = difference(&row->force, force);
    if (what != NULL && r->differences++ == 0) {
        r->first.tick = row->tick;
        r->first.time_ns = row->time_ns;
        r->first.tool = row->tool;
        r->first.what = what;
        r->first.recorded = row->force;
        r->first.replayed = *force;
    }
    double d[3];
    for (int i = 0; i < 3; i++) {
        d[i] = force->force[i] - row->force.force[i];
    }
    double off = length(d);
    p->square_sum += off * off;
    if (off > r->peak_difference) {
        r->peak_difference = off;
        r->peak_tick = row->tick;
    }
    r->recorded_peak = fmax(r->recorded_peak, length(row->force.force));
    r->replayed_peak = fmax(r->replayed_peak, length(force->force));
    r->records++;
}

/// One tick from the rows of all its tools.
static pal_status play_tick(replay *p, const pal_tick_record *row, int32_t tools) {
    pal_tool_state in[PALPATE_TOOLS_MAX] = {{{0.0}, {0.0}, 0, 0, 0}};
    pal_tool_force out[PALPATE_TOOLS_MAX];
    for (int32_t t = 0; t < tools; t++) {
        if (row[t].tick != row[0].tick || row[t].tool != t) {
            return pal_fail(p->error, PALPATE_ERROR_FORMAT,
                            "/ticks: tick %llu, tool %d where tool %d of tick %llu must be; a tick "
                            "needs a record of each tool to be replayed",
                            (unsigned long long)row[t].tick, (int)row[t].tool, (int)t,
                            (unsigned long long)row[0].tick);
        }
        in[t] = row[t].state;
    }
    (void)pal_engine_force(p->engine, in, out);
    for (int32_t t = 0; t < tools; t++) {
        compare(p, &row[t], &out[t]);
    }
    p->report->ticks++;
    return PALPATE_OK;
}

static pal_status play(replay *p) {
    const pal_recording_info *info = &p->recording->info;
    int32_t tools = info->engine.tool_count;
    int64_t chunk = CHUNK / tools * tools;
    uint64_t next = 0;
    if (info->records % tools != 0) {
        return pal_fail(p->error, PALPATE_ERROR_FORMAT,
                        "/ticks: %lld records of %d tools: the last tick is not whole",
                        (long long)info->records, (int)tools);
    }
    for (int64_t at = 0; at < info->records; at += chunk) {
        int64_t n = info->records - at < chunk ? info->records - at : chunk;
        pal_status status = pal_recording_rows(p->recording, at, n, p->row, p->error);
        for (int64_t i = 0; status == PALPATE_OK && i < n; i += tools) {
            if (p->max_ticks != 0 && p->report->ticks == p->max_ticks) {
                return PALPATE_OK;
            }
            if (at == 0 && i == 0) {
                p->report->start = next = p->row[0].tick;
            }
            p->report->holes += p->row[i].tick != next;
            next = p->row[i].tick + 1;
            status = play_tick(p, &p->row[i], tools);
        }
        if (status != PALPATE_OK) {
            return status;
        }
    }
    return PALPATE_OK;
}

static void *replay_main(void *arg) {
    replay *p = arg;
    pal_rt_grant grant;
    pal_rt_enter(&(const pal_rt_request){.want = 0, .cpu = -1, .priority = 1}, &grant);
    p->status = play(p);
    return NULL;
}

pal_status pal_replay(pal_recording *recording, const pal_model *model, uint64_t max_ticks,
                      pal_replay_report *out, pal_error *error) {
    if (recording == NULL || model == NULL || out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_replay: NULL argument");
    }
    memset(out, 0, sizeof *out);
    pal_model_info info;
    pal_model_get_info(model, &info);
    out->hash_matches = strcmp(info.hash, recording->info.model_hash) == 0;
    replay p = {.recording = recording, .max_ticks = max_ticks, .report = out, .error = error};
    pal_status status = pal_engine_create(model, &recording->info.engine, &p.engine, error);
    if (status != PALPATE_OK) {
        return status;
    }
    p.row = malloc(CHUNK * sizeof *p.row);
    pthread_t thread;
    if (p.row == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "replay: no memory");
    } else if (pthread_create(&thread, NULL, replay_main, &p) != 0) {
        status = pal_fail(error, PALPATE_ERROR_SYSTEM, "replay: no thread");
    } else {
        (void)pthread_join(thread, NULL);
        status = p.status;
    }
    out->rms_difference = out->records > 0 ? sqrt(p.square_sum / (double)out->records) : 0.0;
    free(p.row);
    pal_engine_free(p.engine);
    return status;
}
