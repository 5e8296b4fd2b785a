/// @file device_null.c  A device that stands still at the tool's start.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/device/device.h"
#include "haptic/base/error.h"

static pal_status null_read(void *self, int64_t time_ns, pal_tool_state *state) {
    *state = *(const pal_tool_state *)self;
    state->time_ns = time_ns;
    return PALPATE_OK;
}

static void null_close(void *self) {
    free(self);
}

pal_status pal_device_null_create(const pal_tool_def *tool, pal_device *out, pal_error *error) {
    pal_tool_state *self = calloc(1, sizeof *self);
    if (self == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "tool '%s': no memory for its device",
                        tool->name);
    }
    memcpy(self->position, tool->start, sizeof self->position);
    self->orientation[0] = 1.0;
    out->abi = PALPATE_DEVICE_ABI;
    out->self = self;
    (void)snprintf(out->spec.name, sizeof out->spec.name, "null");
    out->read = null_read;
    out->close = null_close;
    return PALPATE_OK;
}
