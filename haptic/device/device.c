/// @file device.c  Which device a tool definition means.
#include "haptic/device/device.h"

#include <math.h>
#include <string.h>

#include "haptic/base/error.h"

pal_status pal_device_create(const pal_tool_def *tool, double period, pal_device *out,
                             pal_error *error) {
    if (tool == NULL || out == NULL || !(period > 0.0)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_device_create: NULL or a period of %g s", period);
    }
    memset(out, 0, sizeof *out);
    switch (tool->device.kind) {
    case PALPATE_DEVICE_NONE:
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tool '%s' has no device; give it one in the scene, e.g. device: {replay: "
                        "trajectories/press.csv}",
                        tool->name);
    case PALPATE_DEVICE_NULL:
        return pal_device_null_create(tool, out, error);
    case PALPATE_DEVICE_REPLAY:
        return pal_device_replay_create(tool, out, error);
    case PALPATE_DEVICE_SCRIPTED:
        return pal_device_scripted_create(tool, out, error);
    case PALPATE_DEVICE_SIMULATED:
        return pal_device_simulated_create(tool, period, out, error);
    }
    return pal_fail(error, PALPATE_ERROR_ARGUMENT, "tool '%s': unknown device kind %d", tool->name,
                    (int)tool->device.kind);
}

double pal_device_duration(const pal_device *device) {
    if (device == NULL || device->duration == NULL) {
        return -1.0;
    }
    return device->duration(device->self);
}
