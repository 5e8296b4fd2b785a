/// @file servo.h  The servo loop: one tick per period against absolute deadlines (private).
///
/// Period n of a run has the deadline anchor + n period. A tick belongs to the period in which it
/// wakes up. When whole periods have passed (a late wake-up, an overlong tick), they are counted as
/// missed and the loop goes on with the period it is in: no catch-up burst, no drift, and
///     ticks + missed = periods elapsed
/// holds exactly. Session time is the period's number times the period.
///
/// A tick: read devices, pal_engine_force, write devices (force first), pal_engine_field unless
/// what is left of the period is shorter than the field has lately taken (measured), then the
/// record. In freewheel the same tick runs without waiting and the field is never skipped; where a
/// recorder or a renderer takes frames, the loop waits for them at every frame so that they see the
/// same frames on any machine, and waits for room in the recorder's queue: nothing is lost.
///
/// The servo thread allocates nothing, takes no lock and does no I/O. Its numbers are published in
/// relaxed atomics: anyone may read them while it runs.
#ifndef PALPATE_HAPTIC_SERVO_H
#define PALPATE_HAPTIC_SERVO_H

#include <stdatomic.h>
#include <stdint.h>

#include <palpate/session.h>

#include "haptic/session/pace.h"
#include "haptic/safety/passivity.h"
#include "haptic/base/pose.h"
#include "haptic/base/quantiles.h"
#include "haptic/base/realtime.h"
#include "haptic/session/ring.h"

/// Times collected per tick.
typedef struct pal_servo_times {
    pal_histogram compute, cpu, lateness, device, force, field, pose_to_force;
} pal_servo_times;

/// Freewheel only: the servo offers a frame and waits until every taker has it. A taker first
/// drains its reader (a stale frame may lie there), then takes the fresh one: two steps per frame.
typedef struct pal_frame_gate {
    _Atomic uint64_t step;    ///< raised by the servo
    _Atomic uint64_t done[2]; ///< last step each taker has finished
    _Atomic int32_t open[2];  ///< 1: this taker takes part
} pal_frame_gate;

enum { PALPATE_TAKER_RENDER = 0, PALPATE_TAKER_RECORD = 1 };

typedef struct pal_servo {
    // fixed before the start
    pal_engine *engine;
    pal_device *device; ///< shape [tool_count]
    int32_t tool_count;
    int32_t freewheel;
    int64_t period_ns;
    uint64_t periods;       ///< 0: endless
    uint64_t frame_periods; ///< freewheel: offer a frame every so many periods; 0: never
    uint64_t slice_periods; ///< reference slices; 0: none
    pal_frames frames;      ///< device frame and body frame
    pal_ring *ring;
    pal_queue *queue; ///< NULL: not recorded
    pal_frame_gate gate;
    uint32_t dump_mask;  ///< onset of one of these faults asks for a dump of the ring; 0: none
    uint64_t dump_after; ///< so many ticks later

    // orders and state
    _Atomic int32_t stop; ///< ask to stop
    _Atomic uint64_t
        dump_due; ///< ticks at which the ring is to be dumped; 0: not. Cleared by the dumper
    _Atomic int32_t unlatch; ///< ask to let latched watchdogs go
    _Atomic int32_t running; ///< 1 from the start of the loop to its end

    // numbers, written by the servo thread only
    _Atomic uint64_t ticks, missed, field_skipped, device_errors, records_lost, page_faults;
    _Atomic uint64_t bare_ticks, bare_missed;
    _Atomic uint32_t latched; ///< bit per tool, of the last tick
    _Atomic uint32_t fault;   ///< fault bits raised so far, those of devices included
    _Atomic double peak_force, peak_vector[3], peak_depth;
    _Atomic double energy[PALPATE_TOOLS_MAX][3]; ///< given, taken, worst of each tool's port [J]
    pal_servo_times times;
    pal_histogram bare_lateness;

    // the loop's own
    pal_pace pace; ///< of the field
    pal_passivity port[PALPATE_TOOLS_MAX];
    uint32_t last_fault; ///< bits of the last tick, all tools
    pal_tool_state last[PALPATE_TOOLS_MAX];
} pal_servo;

/// Allocate the histograms. @return PALPATE_OK or _MEMORY (cleared)
pal_status pal_servo_init(pal_servo *servo);
void pal_servo_clear(pal_servo *servo);

/// The loop; returns when the periods are over or `stop` is set. Thread: the servo's own.
void pal_servo_run(pal_servo *servo);

/// Taker's side of the gate: 1 when a step beyond `*seen` is there (then call pal_gate_done).
int pal_gate_poll(pal_servo *servo, uint64_t *seen);
/// Wait until `step` rises above `*seen` or the servo ends.
/// @return 1: a step to do (then call pal_gate_done), 0: the servo has ended
int pal_gate_wait(pal_servo *servo, uint64_t *seen);
void pal_gate_done(pal_servo *servo, int taker, uint64_t seen);

/// A bare loop of `periods` periods on a thread of its own, set up as `request` says: it sleeps and
/// wakes, nothing else. What it misses, the machine misses. Blocks until it is over.
/// @param[out] scheduling  what was granted, one sentence; may be NULL
/// @return PALPATE_OK; _ARGUMENT, _MEMORY, _SYSTEM (thread)
PALPATE_API pal_status pal_servo_bare_loop(uint64_t periods, int64_t period_ns,
                                           const pal_rt_request *request, pal_bare_report *out,
                                           char *scheduling, size_t scheduling_size,
                                           pal_error *error);

#endif
