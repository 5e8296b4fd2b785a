/// @file contact_grasp.c  Law "surface": points held to a closed tool.
///
/// At closing every point that carries force is kept with its place on the body, its weights Phi_i
/// and the place in the tool's frame where it then is, T^-1 (x_i + u_i). From the next tick on the
/// body must move there with the tool, u_i = T(local_i) - x_i in all three directions, whatever the
/// force: three rows with w = 0 and q = -target.e (friction.h: held). At an unmoved pose these are
/// met by the very forces of closing, so closing changes nothing; what the tool's slopes added to
/// its force (contact_touch.c) stays as it was then.
#include <string.h>

#include "haptic/contact/contact_anywhere.h"
#include "haptic/base/pose.h"

void pal_anywhere_hold(anywhere_law *law, int32_t t) {
    const anywhere_tool *tool = &law->tool[t];
    for (int32_t k = 0; k < tool->held_count; k++) {
        const anywhere_held *held = &tool->held[k];
        anywhere_point *point = &law->point[law->points++];
        double target[3];
        *point = held->point;
        pal_pose_apply(&tool->free, held->local, target);
        for (int i = 0; i < 3; i++) {
            target[i] -= point->x[i] + tool->yield * tool->preload[i];
        }
        for (int a = 0; a < 3; a++) {
            point->q[a] = -v3_dot(target, point->along[a]);
        }
    }
}

void pal_anywhere_grasp(anywhere_law *law, int32_t t, const pal_pose *proxy) {
    anywhere_tool *tool = &law->tool[t];
    pal_pose inverse = pal_pose_inverse(proxy);
    memset(tool->preload, 0, sizeof tool->preload);
    for (int32_t i = 0; i < law->points; i++) {
        const anywhere_point *point = &law->point[i];
        if (point->tool != t || !(law->z[point->first] > 0.0)) {
            continue;
        }
        anywhere_held *held = &tool->held[tool->held_count++];
        double x[3];
        pal_anywhere_displacement(law, i, x);
        for (int c = 0; c < 3; c++) {
            x[c] += point->x[c];
            tool->preload[c] += law->z[point->first] * (point->felt[0][c] - point->along[0][c]);
        }
        held->point = *point;
        held->point.mu = -1.0;
        memcpy(held->point.felt, held->point.along, sizeof held->point.felt);
        pal_pose_apply(&inverse, x, held->local);
    }
}
