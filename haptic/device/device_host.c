/// @file device_host.c  A device whose pose comes from a thread of the host (a mouse, a tracker).
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/device/device.h"
#include "haptic/base/error.h"
#include "haptic/device/mailbox.h"

typedef struct host_device {
    pal_mailbox pose_box, force_box;
    pal_tool_state pose[PALPATE_MAILBOX_SLOTS];
    pal_tool_force force[PALPATE_MAILBOX_SLOTS];
    int has_force; ///< reader side
} host_device;

static pal_status host_read(void *self, int64_t time_ns, pal_tool_state *state) {
    host_device *d = self;
    (void)pal_mailbox_take(&d->pose_box);
    *state = d->pose[d->pose_box.front];
    state->time_ns = time_ns;
    return PALPATE_OK;
}

static pal_status host_write(void *self, int64_t time_ns, const pal_tool_force *force) {
    host_device *d = self;
    (void)time_ns;
    d->force[pal_mailbox_back(&d->force_box)] = *force;
    pal_mailbox_post(&d->force_box);
    return PALPATE_OK;
}

static void host_close(void *self) {
    free(self);
}

pal_status pal_device_host_create(const pal_pose *initial, pal_device *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    host_device *d = calloc(1, sizeof *d);
    if (d == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for a host device");
    }
    pal_mailbox_init(&d->pose_box);
    pal_mailbox_init(&d->force_box);
    for (int i = 0; i < PALPATE_MAILBOX_SLOTS; i++) {
        d->pose[i].orientation[0] = 1.0;
        if (initial != NULL) {
            memcpy(d->pose[i].position, initial->position, sizeof initial->position);
            memcpy(d->pose[i].orientation, initial->orientation, sizeof initial->orientation);
        }
    }
    out->abi = PALPATE_DEVICE_ABI;
    out->self = d;
    (void)snprintf(out->spec.name, sizeof out->spec.name, "host");
    out->read = host_read;
    out->write = host_write;
    out->close = host_close;
    return PALPATE_OK;
}

void pal_device_host_set(pal_device *device, const pal_pose *pose, uint32_t buttons) {
    if (device == NULL || device->read != host_read || pose == NULL) {
        return;
    }
    host_device *d = device->self;
    pal_tool_state *s = &d->pose[pal_mailbox_back(&d->pose_box)];
    memset(s, 0, sizeof *s);
    memcpy(s->position, pose->position, sizeof s->position);
    memcpy(s->orientation, pose->orientation, sizeof s->orientation);
    s->buttons = buttons;
    pal_mailbox_post(&d->pose_box);
}

int pal_device_host_get(pal_device *device, pal_tool_force *force) {
    if (device == NULL || device->read != host_read || force == NULL) {
        return 0;
    }
    host_device *d = device->self;
    d->has_force |= pal_mailbox_take(&d->force_box);
    *force = d->force[d->force_box.front];
    return d->has_force;
}
