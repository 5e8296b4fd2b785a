/// @file device_scripted.c  A device that moves by a formula (stroke.h); endless.
#include <stdio.h>
#include <stdlib.h>

#include "haptic/device/device.h"
#include "haptic/base/error.h"
#include "haptic/device/stroke.h"

static pal_status scripted_read(void *self, int64_t time_ns, pal_tool_state *state) {
    pal_stroke_at(self, 1e-9 * (double)time_ns, state);
    state->time_ns = time_ns;
    return PALPATE_OK;
}

static void scripted_close(void *self) {
    free(self);
}

pal_status pal_device_scripted_create(const pal_tool_def *tool, pal_device *out, pal_error *error) {
    if (!tool->has_start) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tool '%s': a scripted device needs the tool's start and axis", tool->name);
    }
    pal_stroke_path *self = calloc(1, sizeof *self);
    if (self == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "tool '%s': no memory for its device",
                        tool->name);
    }
    pal_status status =
        pal_stroke_bind(tool->name, &tool->device.stroke, tool->start, tool->axis, self, error);
    if (status != PALPATE_OK) {
        free(self);
        return status;
    }
    out->abi = PALPATE_DEVICE_ABI;
    out->self = self;
    (void)snprintf(out->spec.name, sizeof out->spec.name, "scripted");
    out->read = scripted_read;
    out->close = scripted_close;
    return PALPATE_OK;
}
