/// @file pose.c  Quaternions, rigid poses and the device -> world -> body chain.
///
/// Rotation by a unit quaternion (w, q):  R v = v + 2 w (q x v) + 2 q x (q x v), which is exact for
/// the identity. A tool position x_d in the device frame is  x_w = R_d (s x_d) + p_d  in the world
/// and  x_b = R_b^T (x_w - p_b)  in the body; both steps are folded into one pose at creation.
#include "haptic/base/pose.h"

#include <math.h>

static const double QUAT_SHORT = 1e-6;

int pal_quat_normalize(const double q[4], double out[4]) {
    double norm = sqrt(q[0] * q[0] + q[1] * q[1] + q[2] * q[2] + q[3] * q[3]);
    if (!isfinite(norm) || norm < QUAT_SHORT) {
        out[0] = 1.0;
        out[1] = out[2] = out[3] = 0.0;
        return 0;
    }
    for (int i = 0; i < 4; i++) {
        out[i] = q[i] / norm;
    }
    return 1;
}

void pal_quat_multiply(const double a[4], const double b[4], double out[4]) {
    double w = a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3];
    double x = a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2];
    double y = a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1];
    double z = a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0];
    out[0] = w;
    out[1] = x;
    out[2] = y;
    out[3] = z;
}

void pal_quat_conjugate(const double q[4], double out[4]) {
    out[0] = q[0];
    out[1] = -q[1];
    out[2] = -q[2];
    out[3] = -q[3];
}

void pal_quat_rotate(const double q[4], const double v[3], double out[3]) {
    double t[3] = {2.0 * (q[2] * v[2] - q[3] * v[1]), 2.0 * (q[3] * v[0] - q[1] * v[2]),
                   2.0 * (q[1] * v[1] - q[2] * v[0])};
    double x = v[0] + q[0] * t[0] + (q[2] * t[2] - q[3] * t[1]);
    double y = v[1] + q[0] * t[1] + (q[3] * t[0] - q[1] * t[2]);
    double z = v[2] + q[0] * t[2] + (q[1] * t[1] - q[2] * t[0]);
    out[0] = x;
    out[1] = y;
    out[2] = z;
}

void pal_quat_rotate_inverse(const double q[4], const double v[3], double out[3]) {
    double c[4];
    pal_quat_conjugate(q, c);
    pal_quat_rotate(c, v, out);
}

void pal_quat_slerp(const double a[4], const double b[4], double s, double out[4]) {
    double dot = a[0] * b[0] + a[1] * b[1] + a[2] * b[2] + a[3] * b[3];
    double sign = dot < 0.0 ? -1.0 : 1.0;
    dot *= sign;
    double wa = 1.0 - s, wb = s;
    if (dot < 1.0 - 1e-9) { // closer than that the linear blend is exact to rounding
        double angle = acos(dot);
        wa = sin((1.0 - s) * angle) / sin(angle);
        wb = sin(s * angle) / sin(angle);
    }
    double q[4];
    for (int i = 0; i < 4; i++) {
        q[i] = wa * a[i] + sign * wb * b[i];
    }
    (void)pal_quat_normalize(q, out);
}

pal_pose pal_pose_identity(void) {
    return (pal_pose){.position = {0.0, 0.0, 0.0}, .orientation = {1.0, 0.0, 0.0, 0.0}};
}

int pal_pose_valid(const pal_pose *pose) {
    double q[4];
    return isfinite(pose->position[0]) && isfinite(pose->position[1]) &&
           isfinite(pose->position[2]) && pal_quat_normalize(pose->orientation, q);
}

pal_pose pal_pose_compose(const pal_pose *a, const pal_pose *b) {
    pal_pose out = pal_pose_identity();
    pal_pose_apply(a, b->position, out.position);
    pal_quat_multiply(a->orientation, b->orientation, out.orientation);
    (void)pal_quat_normalize(out.orientation, out.orientation);
    return out;
}

pal_pose pal_pose_inverse(const pal_pose *a) {
    pal_pose out = pal_pose_identity();
    pal_quat_conjugate(a->orientation, out.orientation);
    pal_quat_rotate(out.orientation, a->position, out.position);
    for (int i = 0; i < 3; i++) {
        out.position[i] = -out.position[i];
    }
    return out;
}

void pal_pose_apply(const pal_pose *pose, const double v[3], double out[3]) {
    double r[3];
    pal_quat_rotate(pose->orientation, v, r);
    for (int i = 0; i < 3; i++) {
        out[i] = r[i] + pose->position[i];
    }
}

pal_frames pal_frames_make(const pal_pose *body_pose, const pal_pose *device_to_world,
                           double scale) {
    pal_pose body = *body_pose, device = *device_to_world;
    (void)pal_quat_normalize(body.orientation, body.orientation);
    (void)pal_quat_normalize(device.orientation, device.orientation);
    pal_pose inverse = pal_pose_inverse(&body);
    return (pal_frames){.body_from_device = pal_pose_compose(&inverse, &device), .scale = scale};
}

void pal_frames_to_body(const pal_frames *frames, const double position[3],
                        const double orientation[4], pal_pose *out) {
    double scaled[3], q[4];
    for (int i = 0; i < 3; i++) {
        scaled[i] = frames->scale * position[i];
    }
    pal_pose_apply(&frames->body_from_device, scaled, out->position);
    (void)pal_quat_normalize(orientation, q);
    pal_quat_multiply(frames->body_from_device.orientation, q, out->orientation);
}

void pal_frames_vector_to_device(const pal_frames *frames, const double body[3], double device[3]) {
    pal_quat_rotate_inverse(frames->body_from_device.orientation, body, device);
}

void pal_frames_vector_to_body(const pal_frames *frames, const double device[3], double body[3]) {
    pal_quat_rotate(frames->body_from_device.orientation, device, body);
}
