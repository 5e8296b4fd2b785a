/// @file solid.c  Distance and line intersection of a capsule (sphere, point) in the body frame.
///
/// The capsule is the union of two balls and the cylinder between them. It is convex, so a line
/// meets it in one interval, whose ends are the smallest entry and the largest exit of the three
/// parts (a line that leaves the cylinder through an end disc is inside a ball there).
#include "haptic/contact/solid.h"

#include <math.h>

#include "haptic/base/pose.h"
#include "haptic/base/vec.h"

pal_solid pal_solid_place(const pal_tool_def *tool, const pal_pose *pose) {
    static const double local_z[3] = {0.0, 0.0, 1.0};
    pal_solid solid = {.half = 0.0, .radius = 0.0};
    for (int i = 0; i < 3; i++) {
        solid.center[i] = pose->position[i];
    }
    pal_quat_rotate(pose->orientation, local_z, solid.axis);
    if (tool->shape != PALPATE_SHAPE_POINT) {
        solid.radius = tool->radius;
    }
    if (tool->shape == PALPATE_SHAPE_CAPSULE) {
        solid.half = 0.5 * tool->length;
    }
    return solid;
}

double pal_solid_distance(const pal_solid *solid, const double x[3]) {
    double p[3] = {x[0] - solid->center[0], x[1] - solid->center[1], x[2] - solid->center[2]};
    double along = fmax(-solid->half, fmin(solid->half, v3_dot(p, solid->axis)));
    for (int i = 0; i < 3; i++) {
        p[i] -= along * solid->axis[i];
    }
    return sqrt(v3_dot(p, p)) - solid->radius;
}

/// [near, far] becomes the hull of itself and [low, high].
static inline void widen(double *near, double *far, double low, double high) {
    *near = low < *near ? low : *near;
    *far = high > *far ? high : *far;
}

/// Widen [near, far] by the interval of a ball.
static int ball(const double p[3], const double d[3], double radius, double *near, double *far) {
    double b = v3_dot(p, d);
    double q[3] = {p[0] - b * d[0], p[1] - b * d[1], p[2] - b * d[2]};
    double room = radius * radius - v3_dot(q, q);
    if (!(room > 0.0)) {
        return 0;
    }
    double root = sqrt(room);
    widen(near, far, -b - root, -b + root);
    return 1;
}

int pal_solid_chord(const pal_solid *solid, const double x[3], const double d[3], double *near,
                    double *far) {
    double p[3] = {x[0] - solid->center[0], x[1] - solid->center[1], x[2] - solid->center[2]};
    if (solid->radius == 0.0 && solid->half == 0.0) {
        *near = *far = -v3_dot(p, d);
        return 1;
    }
    *near = INFINITY;
    *far = -INFINITY;
    if (solid->half == 0.0) {
        return ball(p, d, solid->radius, near, far);
    }
    int hit = 0;
    for (int end = -1; end <= 1; end += 2) {
        double q[3];
        for (int i = 0; i < 3; i++) {
            q[i] = p[i] - end * solid->half * solid->axis[i];
        }
        hit |= ball(q, d, solid->radius, near, far);
    }
    double slope = v3_dot(d, solid->axis), along = v3_dot(p, solid->axis);
    double e[3], q[3];
    for (int i = 0; i < 3; i++) { // line and point across the axis
        e[i] = d[i] - slope * solid->axis[i];
        q[i] = p[i] - along * solid->axis[i];
    }
    double a = v3_dot(e, e);
    if (a > 1e-24) {
        double b = v3_dot(e, q), c = v3_dot(q, q) - solid->radius * solid->radius;
        double room = b * b - a * c;
        if (room > 0.0) {
            for (int end = -1; end <= 1; end += 2) {
                double s = (-b + end * sqrt(room)) / a;
                if (fabs(along + s * slope) <= solid->half) {
                    widen(near, far, s, s);
                    hit = 1;
                }
            }
        }
    }
    return hit;
}

void pal_solid_box(const pal_solid *solid, double low[3], double high[3]) {
    for (int i = 0; i < 3; i++) {
        double reach = fabs(solid->axis[i]) * solid->half + solid->radius;
        low[i] = solid->center[i] - reach;
        high[i] = solid->center[i] + reach;
    }
}
