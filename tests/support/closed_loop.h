/// @file closed_loop.h  A simulated device and an engine in a loop, without threads or clock.
///
/// What a session does in freewheel (read, force, write), and what is looked at afterwards: does
/// the motion grow, and what energy went through the device's port.
#ifndef PALPATE_TESTS_CLOSED_LOOP_H
#define PALPATE_TESTS_CLOSED_LOOP_H

#include <palpate/model.h>
#include <palpate/session.h>

enum { LOOP_WINDOWS = 20 };

typedef struct loop_def {
    const pal_model *model;
    pal_tool_def tool; ///< device simulated
    double seconds;
    double period; ///< [s]
    double cycle;  ///< mark the energy after each such time [s]; 0: never
    int nodes;     ///< 1: contact law "nodes"
    int points;    ///< contact points of law "surface"; 0: default
    /// 1: end when the encoders have shown the same position for half a second (a device with
    /// friction and a force that depends on its position alone then rests for good)
    int stop_when_still;
} loop_def;

typedef struct loop_result {
    /// Length of the box that the tip's encoder positions fill, per twentieth of the time [m].
    double swing[LOOP_WINDOWS];
    double given, taken, worst; ///< pal_passivity [J]
    double cycle_given; ///< worst energy given in excess in one cycle, the first two left out [J]
    double cycle_taken; ///< taken per cycle, mean of the same cycles [J]
    double peak_force;  ///< [N]
    double end[3];      ///< last position [m]
    int touching;       ///< contact points at the end
    uint32_t faults;
} loop_result;

/// @return the engine's or the device's status
pal_status loop_run(const loop_def *def, loop_result *out, pal_error *error);

/// 1: no growth. What moves in the last fifth of the time is less than nine tenths of what moved
/// between a tenth and three tenths of it, a millionth of the first swing, or within two steps of
/// the encoders. (A loop that has grown into the limits of its actuators neither grows nor decays:
/// that counts as growth.)
int loop_calms(const loop_result *r, double resolution);

/// A pair of forceps: a point tool on a Touch without Coulomb friction and encoder steps, with
/// `damping` [N s/m]. A firm hand presses it 2 mm into a node of the surface and circles at 2 mm
/// round it; the grasp closes once it is pressed (0.6 s), the hand lets go at 1.5 s. The node: the
/// touchable one whose own stiffness, the inverse of its 3 x 3 compliance, has the largest skew
/// part (any, when the compliance is symmetric).
/// @param node  index of a column of the model, or -1 to choose it; @param[out] skew  |skew| / mean
/// stiffness there; may be NULL; @param[out] stiffness  largest direct stiffness [N/m]; may be NULL
pal_tool_def loop_forceps(const pal_model *model, int32_t node, double damping, double *skew,
                          double *stiffness);
/// The column that loop_forceps chooses.
int32_t loop_worst_column(const pal_model *model);

/// Force on the tool [N] against its axis at `depth` past its start, without a device.
double loop_press(const pal_model *model, const pal_tool_def *tool, double depth);

#endif
