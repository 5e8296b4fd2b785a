/// @file record.h  The recorder thread: from the servo's queue and snapshots to raw files
/// (private).
///
/// The thread does all I/O; the servo only pushes into a queue that holds several seconds. What the
/// disk refuses is counted and reported, and the run goes on. File layout: recording.h.
#ifndef PALPATE_HAPTIC_RECORD_H
#define PALPATE_HAPTIC_RECORD_H

#include <stdatomic.h>
#include <stdint.h>

#include "haptic/recording/recording.h"
#include "haptic/session/servo.h"

typedef struct pal_recorder {
    pal_servo *servo;
    pal_queue *queue;
    pal_reader *reader; ///< NULL: no frames
    int64_t frame_period_ns;
    char path[PALPATE_RECORDING_PATH];
    char ticks_name[PALPATE_RECORDING_PATH], frames_name[PALPATE_RECORDING_PATH];
    pal_ticks_header ticks_header;
    pal_frames_header frames_header;
    pal_item_file ticks, frames;
    pal_tick_item *batch; ///< items being checksummed
    char *frame;          ///< one frame item
    struct {
        uint64_t tick;
        int64_t time_ns;
    } * when;                               ///< session time of recent ticks, by tick mod size
    uint64_t last_tick;                     ///< newest tick drained
    uint32_t last_fault[PALPATE_TOOLS_MAX]; ///< of each tool's newest record
    int32_t sync_now;                       ///< a fault has begun: to the disk with it
    _Atomic uint64_t records, records_lost, frames_done, frames_lost;
    _Atomic int32_t first_errno;
} pal_recorder;

/// Create the raw files and write headers and the rest surface. `recorder` is zeroed by the caller
/// but for servo, queue and reader. @return _OK; _ARGUMENT, _IO, _MEMORY (nothing left behind)
pal_status pal_recorder_open(pal_recorder *recorder, const pal_model *model,
                             const pal_session_def *def, pal_error *error);
/// The thread's main loop; returns after the servo has ended and all is on disk.
void pal_recorder_run(pal_recorder *recorder);
/// Close and, with `discard`, delete the raw files. Safe on a zeroed recorder.
void pal_recorder_close(pal_recorder *recorder, int discard);

#endif
