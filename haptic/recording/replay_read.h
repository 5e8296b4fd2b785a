/// @file replay_read.h  An open finished recording (private to replay*.c).
#ifndef PALPATE_HAPTIC_REPLAY_READ_H
#define PALPATE_HAPTIC_REPLAY_READ_H

#include "haptic/model/h5.h"
#include "haptic/recording/replay.h"

struct pal_recording {
    pal_h5 *file;
    pal_recording_info info;
    pal_tool_def tool[PALPATE_TOOLS_MAX];
};

#endif
