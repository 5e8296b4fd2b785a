/// @file engine.h  Online: the tick. Tool poses in, forces out, displacement field published.
///
/// Real-time contract: pal_engine_force, pal_engine_field and pal_engine_tick allocate nothing,
/// lock nothing, log nothing, make no system call and never abort; their cost is bounded by counts
/// fixed at creation. The same inputs give the same outputs bit for bit, whatever the load.
#ifndef PALPATE_ENGINE_H
#define PALPATE_ENGINE_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/model.h>
#include <palpate/status.h>
#include <palpate/tool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pal_engine pal_engine;
typedef struct pal_reader pal_reader;

/// Rigid pose: x_world = R(orientation) x_local + position. Quaternion w first, unit.
typedef struct pal_pose {
    double position[3];    ///< [m]
    double orientation[4]; ///< w, x, y, z
} pal_pose;

/// What the device says, once per tick. Position in the device's own frame and units of metres.
typedef struct pal_tool_state {
    double position[3];
    double orientation[4]; ///< w, x, y, z
    uint32_t buttons;      ///< bit 0: grasp
    uint32_t flags;        ///< PALPATE_STATE_STALE and periods missed; a device leaves it 0
    int64_t time_ns;       ///< device time stamp; 0: none
} pal_tool_state;

/// pal_tool_state.flags, set by the servo (a host with a loop of its own may do the same), so that
/// all the engine's answer depends on is in its input and a recording can be replayed.
enum {
    PALPATE_STATE_STALE = 1,   ///< the device refused; the pose is the last one it gave
    PALPATE_STATE_UNLATCH = 2, ///< a latched watchdog is let go before this tick
    PALPATE_STATE_MISSED_SHIFT =
        8 ///< flags >> 8: periods that passed without a tick before this one
};

/// Fault bits of pal_tool_force.fault. X(name, bit, text)
#define PALPATE_FAULT_LIST(X)                                                                      \
    X(PALPATE_FAULT_INPUT, 0, "tool pose was not finite; the last good one was used")              \
    X(PALPATE_FAULT_FORCE, 1, "computed force was not finite; zero was returned")                  \
    X(PALPATE_FAULT_SINGULAR, 2,                                                                   \
      "contact system could not be factored; last good or best force kept")                        \
    X(PALPATE_FAULT_CONTACTS, 3, "more contacts than there is room for; some were left out")       \
    X(PALPATE_FAULT_CAP, 4, "force was capped")                                                    \
    X(PALPATE_FAULT_SLEW, 5, "force change was limited")                                           \
    X(PALPATE_FAULT_CUTOFF, 6, "contact solver stopped at its iteration limit")                    \
    X(PALPATE_FAULT_TORQUE_CAP, 7, "torque was capped")                                            \
    X(PALPATE_FAULT_STALE, 8, "device pose is stale")                                              \
    X(PALPATE_FAULT_JUMP, 9, "device pose jumped faster than physical")                            \
    X(PALPATE_FAULT_STALL, 10, "servo or device stalled")                                          \
    X(PALPATE_FAULT_LATCHED, 11, "watchdog is latched: force is zero until it is let go")          \
    X(PALPATE_FAULT_RAMP, 12, "force is ramping up after a fault")                                 \
    X(PALPATE_FAULT_UNFELT, 13,                                                                    \
      "inside the body the tool feels nothing: it began there, or no surface to touch is near")

enum {
#define PALPATE_FAULT_ENUM(name, bit, text) name = 1u << (bit),
    PALPATE_FAULT_LIST(PALPATE_FAULT_ENUM)
#undef PALPATE_FAULT_ENUM
};

/// What the tool feels. Force and torque are those on the tool, in the device's frame.
typedef struct pal_tool_force {
    double force[3];  ///< [N]
    double torque[3]; ///< about the tool's origin [N m]
    int32_t contact_count;
    uint32_t fault; ///< PALPATE_FAULT_* of this tick
    double depth;   ///< deepest overlap of the tool with the rest surface [m]; 0 without contact
    double centroid[3]; ///< force-weighted contact centroid, body frame [m]
    double normal[3];   ///< outward, against what the force without friction pushes, body frame,
                        ///< unit; 0 without contact
} pal_tool_force;

/// Definition of an engine; make it with pal_engine_default_def() (a cookie is checked).
typedef struct pal_engine_def {
    uint32_t cookie;
    int32_t tool_count;           ///< 1..PALPATE_TOOLS_MAX
    const pal_tool_def *tools;    ///< copied at create, shape [tool_count]
    int32_t max_contacts;         ///< contact points over all tools; default 32
    pal_contact_kind contact_law; ///< default PALPATE_CONTACT_SURFACE
    int32_t contact_points;       ///< law "surface": points of one tool; 0: 16, at most 64
    int32_t reader_count;         ///< snapshot readers; default 2
    pal_pose body_pose;           ///< body in the world
    pal_pose device_to_world;     ///< device frame in the world
    double device_scale;          ///< world metres per device metre; default 1
    double period;                ///< tick period [s]; default 0.001
    /// An unread frame is replaced by a newer one after this many ticks; 1: every tick. Default 4:
    /// what a reader takes is at most 4 ticks old and idle readers cost a quarter of the sweeps.
    /// Not used with PALPATE_FIELD_BY_READER: forces are published every tick.
    int32_t frame_age;
    pal_field_by field_by;     ///< default PALPATE_FIELD_BY_SERVO
    pal_watchdog_def watchdog; ///< of every tool; zeros: the defaults
} pal_engine_def;

PALPATE_API pal_engine_def pal_engine_default_def(void);

/// Bytes pal_engine_create() will ask for (one block), 0 when the def is not valid.
PALPATE_API size_t pal_engine_bytes(const pal_model *model, const pal_engine_def *def);

/// Create an engine on a model (which must outlive it). One allocation; several engines may share
/// a model. @return PALPATE_OK; _ARGUMENT, _MEMORY, _UNSUPPORTED
PALPATE_API pal_status pal_engine_create(const pal_model *model, const pal_engine_def *def,
                                         pal_engine **out, pal_error *error);
PALPATE_API void pal_engine_free(pal_engine *engine);

/// The definition in effect: limits and watchdog with their defaults filled in and never beyond the
/// tool's device spec. Valid as long as the engine.
PALPATE_API const pal_engine_def *pal_engine_get_def(const pal_engine *engine);

/// Contact and tool forces of this tick ("force first"). Thread: servo.
/// @param[in]  in   shape [tool_count]
/// @param[out] out  shape [tool_count]
/// @return union of the tools' fault bits. Cost: O(candidates + m^2) warm, O(m^3) when contacts
/// change. Source: law "nodes": De, Hong, Bathe 2003, Eq. 52; law "surface":
/// haptic/contact/contact_anywhere.c. With a virtual coupling (coupling_stiffness > 0, law
/// "surface") the pose is the device's: the tool is a proxy behind a spring and damper, balanced
/// with the contact in the same solution, and the force is theirs.
PALPATE_API uint32_t pal_engine_force(pal_engine *engine, const pal_tool_state in[],
                                      pal_tool_force out[]);

/// Displacement of the stored rows under the forces of the last pal_engine_force, published to
/// every reader that has taken the previous frame or whose unread frame is frame_age ticks old.
/// Thread: servo. Cost: O(m rows), nothing when no reader wants a frame; with
/// PALPATE_FIELD_BY_READER O(m readers): only the nodal forces are published, and the rows are
/// summed by pal_engine_snapshot. Source: De, Hong, Bathe 2003, Eq. 53.
PALPATE_API void pal_engine_field(pal_engine *engine);

/// pal_engine_force, then pal_engine_field.
PALPATE_API uint32_t pal_engine_tick(pal_engine *engine, const pal_tool_state in[],
                                     pal_tool_force out[]);

/// Forget contacts, forces and latched faults. Not during a tick. Thread: servo.
PALPATE_API void pal_engine_reset(pal_engine *engine);

/// Onset of a fault: the first tick in a row that raised the bit.
typedef struct pal_fault_event {
    uint64_t tick;
    double value; ///< the offending value, as in pal_engine_counts
    int32_t tool;
    int32_t bit;
} pal_fault_event;
enum { PALPATE_EVENTS_KEPT = 64 };

/// Totals since create or reset.
typedef struct pal_engine_counts {
    uint64_t ticks;
    uint64_t contact_ticks;                     ///< ticks with contact
    uint64_t contacts_dropped;                  ///< contacts beyond max_contacts
    uint64_t fault[32];                         ///< by fault bit
    uint64_t fault_tick[32];                    ///< last tick with that fault
    double fault_value[32];                     ///< the offending value of the last such event
    uint64_t events;                            ///< onsets of faults
    pal_fault_event event[PALPATE_EVENTS_KEPT]; ///< the newest of them; number n at n % KEPT
    uint64_t frames_published;
    uint64_t solver_iterations;
    int32_t worst_iterations;
} pal_engine_counts;
/// Thread: servo, or any while no tick runs.
PALPATE_API void pal_engine_get_counts(const pal_engine *engine, pal_engine_counts *out);

/// One published frame; valid until the reader's next pal_engine_snapshot.
typedef struct pal_frame {
    uint64_t tick;   ///< ticks evaluated before this one since create or reset
    int64_t time_ns; ///< tick * period
    int32_t row_count;
    int32_t tool_count;
    const float *displacement; ///< of the stored rows [m], body frame, shape [row_count, 3]
    pal_pose tool_pose[PALPATE_TOOLS_MAX]; ///< in the body frame (the proxy's behind a coupling)
    pal_tool_force tool_force[PALPATE_TOOLS_MAX]; ///< force and torque here in the body frame
} pal_frame;

/// Reader handle `index` (0..reader_count-1); one thread per handle.
PALPATE_API pal_reader *pal_engine_reader(pal_engine *engine, int32_t index);

/// Newest whole frame, wait-free. @return 1: *frame is newer than the last one this reader got,
/// 0: the same one again, -1: nothing published yet. Thread: the reader's.
/// With PALPATE_FIELD_BY_READER a new frame's displacement is computed here, into memory of the
/// reader's own: O(m rows), the servo's bits exactly (where this thread flushes denormals as the
/// servo's does; else they may differ below 1e-37 m).
PALPATE_API int pal_engine_snapshot(pal_reader *reader, pal_frame *frame);

/// Displacement [m] and (optional) deformed unit normals at the model's skin vertices, from a
/// frame. The skin is the mesh that the scene names (`skin: {file: ...}`), else the surface file
/// the body was made from, else the cloud's own surface. Vertices are numbered as in an OBJ file's
/// `v` lines or a PLY file's elements, so that the host's texture coordinates and buffers fit (STL
/// files number none: one vertex per place, in the order of first use). Vertices at the same place
/// (where textures are cut) share one normal.
/// @param[out] displacement shape [skin_count, 3]
/// @param[out] normal       shape [skin_count, 3] or NULL; (0, 0, 0) at a vertex of no triangle
/// skin_count is pal_model_info's. Rows that are not stored count as displacement 0.
/// @return PALPATE_OK; _ARGUMENT when the frame is not this model's
/// Thread: the reader's. Cost: O(skin_count).
PALPATE_API pal_status pal_model_skin(const pal_model *model, const pal_frame *frame,
                                      float *displacement, float *normal);
/// The skin's rest positions [m], shape [skin_count, 3], and triangles, shape [count, 3]; where
/// several vertices lie at the same place, all triangles name the same one of them.
PALPATE_API const double *pal_model_skin_positions(const pal_model *model);
PALPATE_API const int32_t *pal_model_skin_triangles(const pal_model *model, int32_t *count);

#ifdef __cplusplus
}
#endif
#endif
