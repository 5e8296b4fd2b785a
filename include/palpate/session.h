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

/// What the device can bear. Zero: unknown.
typedef struct pal_device_spec {
    char name[PALPATE_NAME_MAX];
    double max_force;      ///< [N]
    double max_torque;     ///< [N m]
    double max_stiffness;  ///< [N/m]
    double damping;        ///< mechanical damping at the tip [N s/m]
    double resolution;     ///< position resolution [m]
} pal_device_spec;

/// read() and write() are called on the servo thread once per tick: no allocation, no lock, no
/// blocking. open() and close() run on the thread that starts the session.
typedef struct pal_device {
    uint32_t abi;  ///< PALPATE_DEVICE_ABI
    void *self;
    pal_device_spec spec;
    pal_status (*open)(void *self, pal_error *error);                        ///< may be NULL
    pal_status (*read)(void *self, int64_t time_ns, pal_tool_state *state);  ///< state at session time
    pal_status (*write)(void *self, int64_t time_ns, const pal_tool_force *force); ///< may be NULL
    void (*close)(void *self);                                               ///< may be NULL; frees self
    double (*duration)(const void *self); ///< length of the motion [s]; may be NULL: endless
} pal_device;
#define PALPATE_DEVICE_ABI 1u

/// Make the device a tool definition names (null, replay, scripted). It reports poses in the body's
/// frame. The caller owns it (out->close(out->self)) until a session takes it over.
/// @return PALPATE_OK; _IO or _SCENE (trajectory file, located), _ARGUMENT (the tool has no device, or a
/// stroke's parameters are impossible), _UNSUPPORTED, _MEMORY
PALPATE_API pal_status pal_device_create(const pal_tool_def *tool, double period, pal_device *out,
                                         pal_error *error);

/// Length of the device's motion [s]; negative: endless.
PALPATE_API double pal_device_duration(const pal_device *device);

/// A device that the host moves (a mouse, a tracker read elsewhere): its pose is the newest one given
/// to pal_device_host_set, handed over without waiting on either side. `initial` may be NULL (origin).
/// @return PALPATE_OK; _MEMORY
PALPATE_API pal_status pal_device_host_create(const pal_pose *initial, pal_device *out,
                                              pal_error *error);
/// New pose and buttons, from one host thread; wait-free. Only while the device is open or new.
PALPATE_API void pal_device_host_set(pal_device *device, const pal_pose *pose, uint32_t buttons);
/// Newest force written by the servo, from one host thread; wait-free. @return 1 when there is one.
PALPATE_API int pal_device_host_get(pal_device *device, pal_tool_force *force);

/// ---- Session ----------------------------------------------------------------------------------

typedef struct pal_session pal_session;

/// One per-tick record (ring and recording file). Fixed size, plain data, little endian.
typedef struct pal_tick_record {
    uint64_t tick;
    int64_t time_ns;       ///< session time of the tick (tick * period in freewheel)
    int64_t lateness_ns;   ///< wake-up after the deadline; 0 in freewheel
    int32_t device_ns, force_ns, field_ns, compute_ns; ///< stage times; compute: whole tick
    uint32_t fault;
    int32_t tool;          ///< index; one record per tool and tick
    pal_tool_state state;  ///< input
    pal_tool_force force;  ///< output
} pal_tick_record;

typedef struct pal_session_def {
    uint32_t cookie;
    pal_engine_def engine;     ///< tools, poses, period
    pal_device devices[PALPATE_TOOLS_MAX]; ///< one per tool; owned by the session after create
    double duration;           ///< stop after this session time [s]; 0: until told to stop
    int32_t freewheel;         ///< 1: no waiting, every tick evaluated
    int32_t realtime;          ///< 1: try SCHED_FIFO, mlockall, pinning; 2: fail if refused; 0: do not
    int32_t cpu;               ///< core of the servo thread; -1: the last one allowed
    int32_t priority;          ///< SCHED_FIFO priority; default 80
    double render_rate;        ///< [Hz]; 0: no render thread
    /// Called on the render thread for each new frame; may draw, allocate, block (the servo does not
    /// notice). NULL: frames are only counted.
    void (*render)(void *user, const pal_frame *frame);
    void *render_user;
    const char *record_path;   ///< recording file; NULL: none
    int32_t ring_ticks;        ///< per-tick ring kept in memory; default 8192
} pal_session_def;

PALPATE_API pal_session_def pal_session_default_def(void);

PALPATE_API pal_status pal_session_create(const pal_model *model, const pal_session_def *def,
                                          pal_session **out, pal_error *error);
/// Start the threads. @return _SYSTEM when realtime is 2 and refused.
PALPATE_API pal_status pal_session_start(pal_session *session, pal_error *error);
/// Ask the servo to stop within one period; returns at once. Async-signal-safe.
PALPATE_API void pal_session_request_stop(pal_session *session);
/// 1 while the servo runs.
PALPATE_API int pal_session_running(const pal_session *session);
/// Wait for the end, join the threads, close devices and the recording.
PALPATE_API pal_status pal_session_finish(pal_session *session, pal_error *error);
PALPATE_API void pal_session_free(pal_session *session);
PALPATE_API pal_engine *pal_session_engine(pal_session *session);

typedef struct pal_quantiles {
    double p50, p99, p999, max; ///< [us]
} pal_quantiles;

typedef struct pal_session_report {
    uint64_t ticks;     ///< evaluated
    uint64_t missed;    ///< periods elapsed without a tick; ticks + missed = periods elapsed
    uint64_t frames;    ///< frames rendered
    uint64_t field_skipped; ///< ticks whose field was skipped under overload
    double seconds;     ///< session time
    pal_quantiles compute_us, lateness_us, device_us, force_us, field_us;
    double peak_force;  ///< largest |force| [N]
    double peak_force_vector[3]; ///< force on the tool there, body frame [N]
    double peak_depth;  ///< [m]
    pal_engine_counts counts;
    char scheduling[512]; ///< what was granted and what was refused, one sentence
} pal_session_report;
PALPATE_API void pal_session_get_report(const pal_session *session, pal_session_report *out);

/// Copy the newest records of the ring, oldest first; returns how many. After finish, or from one
/// reader thread while running.
PALPATE_API int32_t pal_session_ring(const pal_session *session, pal_tick_record *out, int32_t capacity);

#ifdef __cplusplus
}
#endif
#endif
