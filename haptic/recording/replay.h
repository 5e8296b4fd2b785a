/// @file replay.h  A recording felt again: the same engine, the same inputs, are the forces the
/// same? (private; exported for the program).
///
/// A finished recording (HDF5, recording_file.c) holds all that the engine's answer depends on: its
/// definition (tools, poses, period, limits) and the input of every tick as the engine got it,
/// device refusals and missed periods included (pal_tool_state.flags). Replaying builds an engine
/// by that definition and feeds it tick by tick, on a thread set up as the servo's (denormals
/// flushed). On the same build and model every recorded output must come out bit for bit; on
/// another model the report says how much that one would have felt different.
///
/// A recording with holes (records lost to a full disk, the dump of a ring that starts late) is
/// replayed as far as it goes; the engine's memory of what is missing (slew, watchdog, active set)
/// makes differences after a hole possible, so the report names the holes.
#ifndef PALPATE_HAPTIC_REPLAY_H
#define PALPATE_HAPTIC_REPLAY_H

#include <palpate/session.h>

/// A finished recording open for reading.
typedef struct pal_recording pal_recording;

/// What it says about itself. Texts are NUL-terminated.
typedef struct pal_recording_info {
    pal_engine_def engine; ///< tools points into the recording
    int64_t records;       ///< rows: ticks times tools
    int32_t freewheel, complete;
    char model_hash[72], model_method[32], program[64];
} pal_recording_info;

/// Open and check everything but the rows. @return _OK; _IO, _FORMAT, _VERSION, _MEMORY
PALPATE_API pal_status pal_recording_open(const char *path, pal_recording **out, pal_error *error);
PALPATE_API void pal_recording_close(pal_recording *recording);
PALPATE_API const pal_recording_info *pal_recording_get_info(const pal_recording *recording);

/// Rows `first`, `first + 1`, ... into `out`, shape [count]; their tool indices are checked.
/// @return _OK; _ARGUMENT (range), _FORMAT, _IO, _MEMORY
PALPATE_API pal_status pal_recording_rows(pal_recording *recording, int64_t first, int64_t count,
                                          pal_tick_record *out, pal_error *error);

/// What a replay found. A difference is a recorded output of a tick and tool (force, torque,
/// contacts, faults, depth, centroid, normal) that did not come out bit for bit.
typedef struct pal_replay_report {
    uint64_t ticks, records;
    uint64_t start;       ///< tick number of the first record
    uint64_t holes;       ///< places where tick numbers are missing
    uint64_t differences; ///< records that differ
    struct {
        uint64_t tick;
        int64_t time_ns;
        int32_t tool;
        const char *what; ///< "force", "torque", ...
        pal_tool_force recorded, replayed;
    } first;                ///< first difference; `what` is NULL without one
    double peak_difference; ///< largest |replayed - recorded force| [N]
    double rms_difference;  ///< root mean square of it over the records [N]
    uint64_t peak_tick;     ///< tick of peak_difference
    double recorded_peak;   ///< largest |force| recorded [N]
    double replayed_peak;   ///< and replayed [N]
    int32_t hash_matches;   ///< 1: the model is the one that was recorded
} pal_replay_report;

/// Replay on `model`. Blocks; not for the servo thread.
/// @param max_ticks  stop after so many ticks; 0: all
/// @return _OK whatever the differences; _FORMAT (rows that cannot be of one run), _IO, _MEMORY,
/// _ARGUMENT, _UNSUPPORTED (the definition does not fit the model), _SYSTEM (no thread)
PALPATE_API pal_status pal_replay(pal_recording *recording, const pal_model *model,
                                  uint64_t max_ticks, pal_replay_report *out, pal_error *error);

#endif
