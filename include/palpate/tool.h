/// @file tool.h  What a tool is: shape, device, coupling, limits. Plain data, SI units.
#ifndef PALPATE_TOOL_H
#define PALPATE_TOOL_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define PALPATE_NAME_MAX 64
#define PALPATE_TOOLS_MAX 8

typedef enum pal_shape_kind {
    PALPATE_SHAPE_POINT = 0,
    PALPATE_SHAPE_SPHERE = 1,
    PALPATE_SHAPE_CAPSULE =
        2 ///< segment of `length` along the tool's local z, centred on its origin
} pal_shape_kind;

typedef enum pal_device_kind {
    PALPATE_DEVICE_NONE = 0, ///< the host drives the tool (embedding), or the tool is only pressed
    PALPATE_DEVICE_NULL = 1, ///< stays at `start`
    PALPATE_DEVICE_REPLAY = 2,   ///< trajectory CSV, interpolated in time
    PALPATE_DEVICE_SCRIPTED = 3, ///< press, slide, circle, tremor by parameters
    PALPATE_DEVICE_SIMULATED = 4 ///< simulated device and hand, closed loop
} pal_device_kind;

/// Contact law of an engine.
typedef enum pal_contact_kind {
    PALPATE_CONTACT_SURFACE = 0, ///< contact points anywhere on the rest surface, unilateral
    PALPATE_CONTACT_NODES = 1    ///< prescribed displacement of touched nodes (paper 1, Eq. 52)
} pal_contact_kind;

typedef enum pal_stroke_kind {
    PALPATE_STROKE_PRESS = 0,
    PALPATE_STROKE_SLIDE = 1,
    PALPATE_STROKE_CIRCLE = 2,
    PALPATE_STROKE_PALPATION = 3 ///< repeated presses with physiological tremor
} pal_stroke_kind;

/// A scripted stroke. The tool starts at its `start`, presses `depth` along its `axis` with a
/// smooth (raised cosine) approach of `ramp` seconds, then moves as the kind says.
typedef struct pal_stroke {
    pal_stroke_kind kind;
    double depth;            ///< [m]
    double ramp;             ///< [s]
    double period;           ///< period of the repeated motion [s]
    double amplitude;        ///< half travel of a slide, radius of a circle [m]
    double direction[3];     ///< slide direction, made perpendicular to the axis
    double tremor_amplitude; ///< [m]
    double tremor_frequency; ///< [Hz]
} pal_stroke;

typedef enum pal_simulated_model {
    PALPATE_SIMULATED_TOUCH = 0,  ///< Geomagic/3D Systems Touch (SensAble Phantom Omni)
    PALPATE_SIMULATED_PREMIUM = 1 ///< SensAble Phantom Premium 1.5
} pal_simulated_model;

typedef enum pal_simulated_grip {
    PALPATE_GRIP_FIRM = 0,  ///< measured arm and hand
    PALPATE_GRIP_LIGHT = 1, ///< a tenth of it: harder for stability than any measured one
    PALPATE_GRIP_NONE = 2   ///< nobody holds it
} pal_simulated_grip;

/// A simulated force-feedback device and the hand that holds it. pal_simulated_default() fills in
/// published figures (haptic/device/simulated.c names the sources). The hand follows the device's
/// `stroke`; without a hand only `push` and the tool's force move the device.
typedef struct pal_simulated {
    pal_simulated_model model; ///< whose figures these are; the numbers below are what counts
    pal_simulated_grip grip;   ///< likewise of the hand
    double mass;               ///< apparent mass at the tip [kg]
    double damping;            ///< viscous, of the device alone [N s/m]
    double friction;           ///< Coulomb (back-drive) friction of each axis [N]
    double resolution;         ///< of the encoders, each axis [m]; 0: exact
    double force;              ///< largest force of the actuators [N]
    double stiffness;          ///< largest the maker gives; only told to the session [N/m]
    double reach;              ///< stops: each coordinate stays within start +- reach [m]
    double hand_mass;          ///< of the hand, moving with the tip [kg]
    double hand_damping;       ///< between tip and intended motion [N s/m]
    double hand_stiffness;     ///< between tip and intended motion [N/m]; all three 0: no hand
    double push;               ///< constant force along the tool's axis [N]
    double kick;               ///< speed along the tool's axis at the start [m/s]
    double release;            ///< the hand lets go at this time [s]; 0: never
    double grasp;              ///< the grasp button closes at this time [s]; 0: never
} pal_simulated;

typedef struct pal_device_def {
    pal_device_kind kind;
    char path[1024];         ///< replay: the trajectory CSV, absolute
    pal_stroke stroke;       ///< scripted, and what the hand of a simulated device intends
    pal_simulated simulated; ///< simulated
} pal_device_def;

/// What a device can bear. Zero: unknown. A limit, a coupling or a speed beyond what is known here
/// is never passed on: forces are capped at the lesser of limit and device, a coupling is refused.
typedef struct pal_device_spec {
    char name[PALPATE_NAME_MAX];
    double max_force;     ///< [N]
    double max_torque;    ///< [N m]
    double max_stiffness; ///< of a virtual coupling it can render stably [N/m]
    double max_damping;   ///< of a virtual coupling [N s/m]
    double max_speed;     ///< of its tip; a pose that moves faster is a fault [m/s]
    double damping;       ///< mechanical damping at the tip [N s/m]
    double resolution;    ///< position resolution [m]
} pal_device_spec;

/// Limits of the output stage. Each: 0 asks for the default, which is the device spec's maximum
/// where that is known, else PALPATE_DEFAULT_*; INFINITY is no limit, a choice that is reported
/// wherever limits are (pal_session_report, `palpate run`). There is no other way to be without
/// one.
typedef struct pal_tool_limits {
    double force;  ///< cap of |force| [N]
    double slew;   ///< cap of |d force/dt| [N/ms]
    double torque; ///< cap of |torque| [N m]
} pal_tool_limits;
#define PALPATE_DEFAULT_FORCE 3.3  ///< [N]: peak of a Geomagic Touch
#define PALPATE_DEFAULT_SLEW 100.0 ///< [N/ms]
#define PALPATE_DEFAULT_TORQUE 0.2 ///< [N m]

/// When the watchdog in front of the output stage acts. Each: 0 asks for the default; values out of
/// range are refused, so that it cannot be turned off. Rules: haptic/safety/watchdog.h.
typedef struct pal_watchdog_def {
    double stale; ///< a pose this old is stale, the force fades [s]; 0.001 to 1, default 0.02
    double
        stall; ///< periods without a tick: the force starts from zero [s]; 0.001 to 10, default 0.1
    double latch;     ///< stale or stalled this long latches [s]; 0.001 to 60, default 1
    double speed;     ///< a pose that moves faster jumps [m/s]; up to 1000, default: the device
                      ///< spec's max_speed, else 20; never above the former
    double ramp_down; ///< time in which a force fades [s]; up to 1, default 0.01
    double ramp_up;   ///< time in which it comes back after a fault [s]; 0.001 to 10, default 0.1
} pal_watchdog_def;

/// Default virtual coupling of a scene's tools whose device feels the force back (simulated, or the
/// host's), measured by bench/stability: no growth on organs from 1 kPa to 1 MPa, with and without
/// a hand, on devices with and without friction. Its damping is stiffness x period (1 N s/m at 1
/// kHz).
#define PALPATE_DEFAULT_COUPLING_STIFFNESS 1000.0 ///< [N/m]

/// One tool of a scene. Positions are in the body's frame.
// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): in the order a reader looks for things
typedef struct pal_tool_def {
    char name[PALPATE_NAME_MAX];
    pal_shape_kind shape;
    double radius;             ///< sphere and capsule [m]; 0 for a point
    double length;             ///< capsule: length of the segment [m]
    double friction;           ///< Coulomb coefficient mu [-]
    double coupling_stiffness; ///< virtual coupling [N/m]; 0: none (rigid)
    double coupling_damping;   ///< [N s/m]
    pal_tool_limits limits;
    pal_device_spec
        spec; ///< what its device can bear; a session takes the lesser of this and the device's own
    double start[3]; ///< tool origin when it just touches [m]
    double axis[3];  ///< pressing direction, unit
    int has_start;   ///< 1 when the scene gave `start`
    pal_device_def device;
} pal_tool_def;

/// Who computes the displacement field (Eq. 53) of a frame.
typedef enum pal_field_by {
    PALPATE_FIELD_BY_SERVO = 0, ///< the servo, after the force has gone out; a reader only takes it
    /// whoever takes the frame, on its own thread and at its own rate: the servo publishes the
    /// nodal forces alone, O(m) a tick however large the body
    PALPATE_FIELD_BY_READER = 1
} pal_field_by;

/// What a run needs beside the physics; stored in the model file so that `run MODEL` works alone.
typedef struct pal_runtime_config {
    int32_t tool_count;
    pal_tool_def tools[PALPATE_TOOLS_MAX];
    double servo_rate;            ///< [Hz]
    double render_rate;           ///< [Hz]
    int32_t max_contacts;         ///< contact points an engine keeps; more are reduced and counted
    pal_contact_kind contact_law; ///< contact law of the engine
    int32_t contact_points;       ///< contact points of one tool; 0: the engine's default
    pal_field_by field_by;        ///< the scene's `render: {field: servo | render}`
    pal_watchdog_def watchdog;
} pal_runtime_config;

#ifdef __cplusplus
}
#endif
#endif
