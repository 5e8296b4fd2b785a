/// @file session.h  Threads and devices around an engine: servo, render, recorder.
///
/// Only a session sets scheduling, affinity, mlockall and floating-point modes, and only on its own
/// threads, by option. The host's threads are never touched.
#ifndef PALPATE_SESSION_H
#define PALPATE_SESSION_H

#include <stdint.h>

#include <palpate/engine.h>
#include <palpate/model.h>
#include <palpate/status.h>

#ifdef __cplusplus
extern "C" {
#endif

/// ---- Devices: a table of functions; real hardware plugs in here ------------------------------

/// read() and write() are called on the servo thread once per tick: no allocation, no lock, no
/// blocking. open() and close() run on the thread that starts the session.
typedef struct pal_device {
    uint32_t abi; ///< PALPATE_DEVICE_ABI
    void *self;
    pal_device_spec spec;                             ///< what it can bear (tool.h); zero: unknown
    pal_status (*open)(void *self, pal_error *error); ///< may be NULL
    pal_status (*read)(void *self, int64_t time_ns,
                       pal_tool_state *state); ///< state at session time
    pal_status (*write)(void *self, int64_t time_ns, const pal_tool_force *force); ///< may be NULL
    void (*close)(void *self);            ///< may be NULL; frees self
    double (*duration)(const void *self); ///< length of the motion [s]; may be NULL: endless
} pal_device;
#define PALPATE_DEVICE_ABI 2u

/// Figures of a device and of a hand, with their sources in haptic/device/simulated.c. push, kick,
/// release and grasp are 0. Thread: any.
PALPATE_API pal_simulated pal_simulated_default(pal_simulated_model model, pal_simulated_grip grip);

/// Make the device a tool definition names (null, replay, scripted, simulated). It reports poses in
/// the body's frame. The caller owns it (out->close(out->self)) until a session takes it over.
/// @return PALPATE_OK; _IO or _SCENE (trajectory file, located), _ARGUMENT (the tool has no device,
/// or a stroke's parameters are impossible), _UNSUPPORTED, _MEMORY
PALPATE_API pal_status pal_device_create(const pal_tool_def *tool, double period, pal_device *out,
                                         pal_error *error);

/// Length of the device's motion [s]; negative: endless.
PALPATE_API double pal_device_duration(const pal_device *device);

/// A device that the host moves (a mouse, a tracker read elsewhere): its pose is the newest one
/// given to pal_device_host_set, handed over without waiting on either side. `initial` may be NULL
/// (origin).
/// @return PALPATE_OK; _MEMORY
PALPATE_API pal_status pal_device_host_create(const pal_pose *initial, pal_device *out,
                                              pal_error *error);
/// New pose and buttons, from one host thread; wait-free. Only while the device is open or new.
PALPATE_API void pal_device_host_set(pal_device *device, const pal_pose *pose, uint32_t buttons);
/// Newest force written by the servo, from one host thread; wait-free. @return 1 when there is one.
PALPATE_API int pal_device_host_get(pal_device *device, pal_tool_force *force);

/// ---- Session ----------------------------------------------------------------------------------

typedef struct pal_session pal_session;

/// One per-tick record (ring and recording file). Fixed size, plain data without padding, little
/// endian. Records of skipped periods do not exist: consecutive `tick` numbers with a jump in
/// `time_ns` show them.
typedef struct pal_tick_record {
    uint64_t tick;       ///< evaluated ticks before this one
    int64_t time_ns;     ///< session time of the tick: its period's number times the period
    int64_t lateness_ns; ///< wake-up after the deadline; 0 in freewheel
    int32_t device_ns, force_ns, field_ns,
        compute_ns;        ///< stage times; compute: read to field's end
    int32_t cpu_ns;        ///< thread CPU time of the same span: what pre-emption did not take
    int32_t field_skipped; ///< 1: overload, no field this tick
    uint32_t fault;        ///< PALPATE_FAULT_*, output stage and devices included
    int32_t tool;          ///< index; one record per tool and tick
    pal_tool_state state;  ///< input as given to the engine
    pal_tool_force force;  ///< output as given to the device
} pal_tick_record;

typedef struct pal_session_def {
    uint32_t cookie;
    pal_engine_def engine;                 ///< tools, poses, period
    pal_device devices[PALPATE_TOOLS_MAX]; ///< one per tool; owned by the session after create
    double duration;    ///< stop after this session time [s]; 0: until told to stop
    int32_t freewheel;  ///< 1: no waiting, every tick evaluated
    int32_t realtime;   ///< 1: try SCHED_FIFO, mlockall, pinning; 2: fail if refused; 0: do not
    int32_t cpu;        ///< core of the servo thread; -1: the last one allowed
    int32_t priority;   ///< SCHED_FIFO priority; default 80
    double render_rate; ///< [Hz]; 0: no render thread
    /// Called on the render thread for each new frame; may draw, allocate, block (the servo does
    /// not notice). NULL: frames are only counted.
    /// The last call, with NULL, says that the session ends.
    void (*render)(void *user, const pal_frame *frame);
    void *render_user;
    const char *record_path; ///< recording file (HDF5, `.h5`); NULL: none; copied at create
    int32_t ring_ticks;      ///< per-tick ring kept in memory; default 8192
    /// The ring is written to this recording (`.h5`; "-2", "-3", ... before the extension for the
    /// next ones, at most 16 per session, nothing is overwritten) a quarter of the ring, at most 1
    /// s, after the onset of a fault of dump_faults, and on demand. NULL: not; copied at create.
    /// While the session runs the raw file FILE.ticks holds it; finish converts it, `palpate
    /// recover` does after a kill.
    const char *dump_path;
    uint32_t dump_faults; ///< default PALPATE_DUMP_FAULTS
    /// Above 0: after each such slice of session time [s] the servo thread runs a bare loop (sleep
    /// and wake only) of equal length while session time stands still; the report's `bare` tells
    /// what the machine itself misses. A run then takes twice its duration. 0: none (default).
    double reference_slice;
} pal_session_def;

/// Faults of input, physics and timing; not the limits that act in ordinary use.
#define PALPATE_DUMP_FAULTS                                                                        \
    (PALPATE_FAULT_INPUT | PALPATE_FAULT_FORCE | PALPATE_FAULT_SINGULAR | PALPATE_FAULT_STALE |    \
     PALPATE_FAULT_JUMP | PALPATE_FAULT_STALL | PALPATE_FAULT_LATCHED)

PALPATE_API pal_session_def pal_session_default_def(void);

/// Create engine, rings, threads' memory. The devices belong to the session only on success.
/// @return PALPATE_OK; _ARGUMENT, _MEMORY, _UNSUPPORTED, _IO (recording file, unfinished recording
/// in the way)
PALPATE_API pal_status pal_session_create(const pal_model *model, const pal_session_def *def,
                                          pal_session **out, pal_error *error);
/// Start the threads. @return _SYSTEM when realtime is 2 and refused.
PALPATE_API pal_status pal_session_start(pal_session *session, pal_error *error);
/// Ask the servo to stop within one period; returns at once. Async-signal-safe.
PALPATE_API void pal_session_request_stop(pal_session *session);
/// Let a latched watchdog go: from the next tick on the force comes back over ramp_up. The fault
/// that latched it may latch it again. The input of that tick says so (PALPATE_STATE_UNLATCH),
/// hence a replay of the recording does the same. Thread: any; async-signal-safe.
PALPATE_API void pal_session_unlatch(pal_session *session);
/// Ask for a dump of the ring now (def.dump_path). Thread: any; async-signal-safe.
PALPATE_API void pal_session_request_dump(pal_session *session);
/// 1 while the servo runs.
PALPATE_API int pal_session_running(const pal_session *session);
/// Wait for the end, join the threads, close devices, convert the recording. The run's report holds
/// whatever this returns. @return PALPATE_OK; _IO, _MEMORY when the recording could not be
/// converted (its raw files stay and pal_recording_convert can be tried again)
PALPATE_API pal_status pal_session_finish(pal_session *session, pal_error *error);
PALPATE_API void pal_session_free(pal_session *session);
PALPATE_API pal_engine *pal_session_engine(pal_session *session);

typedef struct pal_quantiles {
    double p50, p99, p999, max; ///< [us]
} pal_quantiles;

/// What a bare loop on the servo thread (same core, priority, deadlines, no work) met.
typedef struct pal_bare_report {
    uint64_t ticks, missed; ///< their sum is the number of periods elapsed
    pal_quantiles lateness_us;
} pal_bare_report;

/// Work at a device's port, from the poses it gave and the forces it was given (held between
/// ticks). From rest without contact an engine that returns no more than was put in keeps given <=
/// taken.
typedef struct pal_port_energy {
    double given; ///< done on the device by the session [J]
    double taken; ///< done by the device [J]
    double worst; ///< largest given - taken there has been [J]; > 0: energy was returned in excess
} pal_port_energy;

typedef struct pal_session_report {
    uint64_t ticks;         ///< evaluated
    uint64_t missed;        ///< periods elapsed without a tick; ticks + missed = periods elapsed
    uint64_t frames;        ///< frames rendered
    uint64_t field_skipped; ///< ticks whose field was skipped under overload
    double seconds;         ///< session time
    pal_quantiles compute_us, lateness_us, device_us, force_us, field_us;
    pal_quantiles
        cpu_us; ///< thread CPU time of compute (a pre-empted tick shows only in compute_us)
    pal_quantiles pose_to_force_us; ///< from the pose read to the force handed to the device
    double peak_force;              ///< largest |force| [N]
    double peak_force_vector[3];    ///< force on the tool there, body frame [N]
    double peak_depth;              ///< [m]
    pal_engine_counts counts;       ///< filled once the servo has ended
    int32_t tool_count;
    pal_tool_limits
        limits[PALPATE_TOOLS_MAX];  ///< in effect; INFINITY: none, by the definition's choice
    uint32_t latched;               ///< bit per tool whose watchdog is latched
    uint32_t fault;                 ///< fault bits that have occurred, of the engine and of devices
    uint64_t device_errors;         ///< reads and writes that a device refused
    uint64_t page_faults;           ///< of the servo thread after its first tick
    uint64_t records, records_lost; ///< ticks x tools written to the recording, and not
    uint64_t record_frames, record_frames_lost;
    pal_bare_report bare;                    ///< with def.reference_slice
    pal_port_energy port[PALPATE_TOOLS_MAX]; ///< of each tool's device
    char record_error[256];    ///< first failure of the recording; "" when there was none
    int32_t dumps, dumps_lost; ///< of the ring: written, and not (too many, or the disk refused)
    char dump_path[256];       ///< the newest; "" when there is none
    char scheduling[512];      ///< what was granted and what was refused, one sentence
} pal_session_report;
/// Thread: any; numbers still move while the servo runs.
PALPATE_API void pal_session_get_report(const pal_session *session, pal_session_report *out);

/// Copy the newest records of the ring, oldest first; returns how many. After finish, or from one
/// reader thread while running.
PALPATE_API int32_t pal_session_ring(const pal_session *session, pal_tick_record *out,
                                     int32_t capacity);

/// Write the ring as a recording of its own (`path`, HDF5, with XDMF companion but no surface).
/// After finish, or from the ring's one reader thread while running. @return _OK, _IO, _MEMORY
PALPATE_API pal_status pal_session_dump(const pal_session *session, const char *path,
                                        pal_error *error);

/// ---- Recordings -------------------------------------------------------------------------------

/// What a conversion found.
typedef struct pal_recording_summary {
    uint64_t records, frames;
    uint64_t bad_records, bad_frames; ///< dropped: checksum wrong or cut off at the file's end
    double seconds;                   ///< session time of the last record
    int32_t complete;                 ///< 1: the run ended in order; 0: it was killed
} pal_recording_summary;

/// Make `path` (HDF5) and its `.xdmf` companion out of the raw files `path.ticks` and `path.frames`
/// of a run that was killed, then remove those. A finished session has done this itself.
/// @param[out] summary  may be NULL
/// @return PALPATE_OK; _IO, _FORMAT, _VERSION, _TRUNCATED (header), _CHECKSUM (header), _MEMORY;
/// the raw files stay on failure
PALPATE_API pal_status pal_recording_convert(const char *path, pal_recording_summary *summary,
                                             pal_error *error);

#ifdef __cplusplus
}
#endif
#endif
