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
    PALPATE_SHAPE_CAPSULE = 2 ///< segment of `length` along the tool's local z, centred on its origin
} pal_shape_kind;

typedef enum pal_device_kind {
    PALPATE_DEVICE_NONE = 0,     ///< the host drives the tool (embedding), or the tool is only pressed
    PALPATE_DEVICE_NULL = 1,     ///< stays at `start`
    PALPATE_DEVICE_REPLAY = 2,   ///< trajectory CSV, interpolated in time
    PALPATE_DEVICE_SCRIPTED = 3, ///< press, slide, circle, tremor by parameters
    PALPATE_DEVICE_SIMULATED = 4 ///< simulated device and hand, closed loop
} pal_device_kind;

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

typedef struct pal_device_def {
    pal_device_kind kind;
    char path[1024];   ///< replay: the trajectory CSV, absolute
    pal_stroke stroke; ///< scripted
} pal_device_def;

typedef struct pal_tool_limits {
    double force;  ///< cap of |force| [N]
    double slew;   ///< cap of |d force/dt| [N/ms]
    double torque; ///< cap of |torque| [N m]
} pal_tool_limits;

/// One tool of a scene. Positions are in the body's frame.
typedef struct pal_tool_def {
    char name[PALPATE_NAME_MAX];
    pal_shape_kind shape;
    double radius;             ///< sphere and capsule [m]; 0 for a point
    double length;             ///< capsule: length of the segment [m]
    double friction;           ///< Coulomb coefficient mu [-]
    double coupling_stiffness; ///< virtual coupling [N/m]; 0: none (rigid)
    double coupling_damping;   ///< [N s/m]
    pal_tool_limits limits;
    double start[3]; ///< tool origin when it just touches [m]
    double axis[3];  ///< pressing direction, unit
    int has_start;   ///< 1 when the scene gave `start`
    pal_device_def device;
} pal_tool_def;

/// Who computes the displacement field (Eq. 53) of a frame.
typedef enum pal_field_by {
    PALPATE_FIELD_BY_SERVO = 0, ///< the servo, after the force has gone out; a reader only takes it
    /// whoever takes the frame, on its own thread and at its own rate: the servo publishes the nodal
    /// forces alone, O(m) a tick however large the body
    PALPATE_FIELD_BY_READER = 1
} pal_field_by;

/// What a run needs beside the physics; stored in the model file so that `run MODEL` works alone.
typedef struct pal_runtime_config {
    int32_t tool_count;
    pal_tool_def tools[PALPATE_TOOLS_MAX];
    double servo_rate;    ///< [Hz]
    double render_rate;   ///< [Hz]
    int32_t max_contacts; ///< contact points an engine keeps; more are reduced and counted
    pal_field_by field_by; ///< the scene's `render: {field: servo | render}`
} pal_runtime_config;

#ifdef __cplusplus
}
#endif
#endif
