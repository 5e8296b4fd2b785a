/// @file simulated.h  Dynamics of one axis of a simulated device in a hand (private).
///
///     M x'' + B x' + k (x - r(t)) - b_h r'(t) + c sgn(x') = F
///
/// M, B: device and hand together; k, b_h: the hand's spring and damper towards its intended motion
/// r; c: Coulomb friction of the device, which also holds it at rest while the other forces stay
/// below c. Between two ticks F is constant (zero-order hold) and r linear, so the equation is
/// linear but for the sign of the velocity. It is advanced by its own power series, cut where the
/// rest is below rounding (argument at most 1, 20 terms), from one change of sign to the next:
/// exact to rounding, which the tests hold against closed forms.
#ifndef PALPATE_HAPTIC_SIMULATED_H
#define PALPATE_HAPTIC_SIMULATED_H

typedef struct pal_axis {
    double mass, damping, stiffness, hand_damping, friction; ///< M, B, k, b_h (part of B), c
} pal_axis;

/// Advance position and velocity by `time` [s].
/// @param[in]     force      held over the whole time, without friction and hand [N]
/// @param[in]     reference  of the hand at its start [m]
/// @param[in]     rate       of the reference [m/s]
/// @param[in,out] state      position [m] and velocity [m/s]
/// Cost: bounded by pal_axis_rate() x time. No allocation. Thread: any.
void pal_axis_advance(const pal_axis *axis, double time, double force, double reference,
                      double rate, double state[2]);

/// Fastest rate of the axis [1/s]: B/M + sqrt(k/M).
double pal_axis_rate(const pal_axis *axis);

#endif
