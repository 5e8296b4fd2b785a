/// @file device_replay.c  A device that replays a trajectory file, interpolated in time.
#include <stdio.h>
#include <stdlib.h>

#include "haptic/device/device.h"
#include "haptic/base/error.h"
#include "haptic/device/trajectory.h"

static pal_status replay_read(void *self, int64_t time_ns, pal_tool_state *state) {
    const pal_trajectory *t = self;
    pal_trajectory_at(t, 1e-9 * (double)time_ns, state);
    state->time_ns = time_ns;
    return PALPATE_OK;
}

static double replay_duration(const void *self) {
    const pal_trajectory *t = self;
    return t->sample[t->count - 1].time;
}

static void replay_close(void *self) {
    pal_trajectory_clear(self);
    free(self);
}

pal_status pal_device_replay_create(const pal_tool_def *tool, pal_device *out, pal_error *error) {
    pal_trajectory *self = calloc(1, sizeof *self);
    if (self == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "tool '%s': no memory for its device",
                        tool->name);
    }
    pal_status status = pal_trajectory_load(tool->device.path, self, error);
    if (status != PALPATE_OK) {
        free(self);
        return pal_fail_prefix(error, status, "tool '%s'", tool->name);
    }
    out->abi = PALPATE_DEVICE_ABI;
    out->self = self;
    (void)snprintf(out->spec.name, sizeof out->spec.name, "replay");
    out->read = replay_read;
    out->close = replay_close;
    out->duration = replay_duration;
    return PALPATE_OK;
}
