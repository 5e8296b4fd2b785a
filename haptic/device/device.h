/// @file device.h  The makers behind pal_device_create (private). One file per kind of device.
#ifndef PALPATE_HAPTIC_DEVICE_H
#define PALPATE_HAPTIC_DEVICE_H

#include <palpate/session.h>

/// Each fills `out` (abi, spec, functions, self). @return PALPATE_OK or an error, nothing allocated
pal_status pal_device_null_create(const pal_tool_def *tool, pal_device *out, pal_error *error);
pal_status pal_device_replay_create(const pal_tool_def *tool, pal_device *out, pal_error *error);
pal_status pal_device_scripted_create(const pal_tool_def *tool, pal_device *out, pal_error *error);
pal_status pal_device_simulated_create(const pal_tool_def *tool, double period, pal_device *out,
                                       pal_error *error);

#endif
