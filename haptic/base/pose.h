/// @file pose.h  Quaternions, rigid poses and the device -> world -> body chain (private).
///
/// Quaternions are w first and unit; a pose maps x -> R(orientation) x + position. All functions
/// are pure, allocate nothing and may be called from any thread. Outputs may alias inputs.
#ifndef PALPATE_HAPTIC_POSE_H
#define PALPATE_HAPTIC_POSE_H

#include <palpate/engine.h>

/// out = q / |q|. @return 1; 0 when q is not finite or shorter than 1e-6 (out: identity).
int pal_quat_normalize(const double q[4], double out[4]);
/// out = a b (first b, then a).
void pal_quat_multiply(const double a[4], const double b[4], double out[4]);
void pal_quat_conjugate(const double q[4], double out[4]);
/// out = R(q) v; q unit.
void pal_quat_rotate(const double q[4], const double v[3], double out[3]);
/// out = R(q)^T v; q unit.
void pal_quat_rotate_inverse(const double q[4], const double v[3], double out[3]);
/// Shortest-arc spherical interpolation from a (s = 0) to b (s = 1), unit result.
void pal_quat_slerp(const double a[4], const double b[4], double s, double out[4]);

/// The identity.
pal_pose pal_pose_identity(void);
/// Finite position, finite quaternion longer than 1e-6. @return 1 or 0.
int pal_pose_valid(const pal_pose *pose);
/// x -> a(b(x)).
pal_pose pal_pose_compose(const pal_pose *a, const pal_pose *b);
pal_pose pal_pose_inverse(const pal_pose *a);
/// out = R v + p, v and out [m].
void pal_pose_apply(const pal_pose *pose, const double v[3], double out[3]);

/// Where a device is relative to a body: x_body = R(pose.orientation) (scale x_device) + position.
typedef struct pal_frames {
    pal_pose body_from_device;
    double scale; ///< body metres per device metre
} pal_frames;

/// From the engine's definition: body_pose^-1 o device_to_world, orientations normalised here.
pal_frames pal_frames_make(const pal_pose *body_pose, const pal_pose *device_to_world,
                           double scale);
/// Device pose -> pose in the body frame. The device's quaternion is normalised.
void pal_frames_to_body(const pal_frames *frames, const double position[3],
                        const double orientation[4], pal_pose *out);
/// A free vector (force, torque) body -> device. Lengths are scaled, forces are not.
void pal_frames_vector_to_device(const pal_frames *frames, const double body[3], double device[3]);
/// A free vector device -> body.
void pal_frames_vector_to_body(const pal_frames *frames, const double device[3], double body[3]);

#endif
