/// @file contact_reach.c  Law "nodes": which nodes a tool can reach, and where it pushes.
///
/// Candidates come from a grid over rest positions, in a box around the tool stretched back along
/// its direction by the depth of the last tick. Entering is tested on deformed positions X + C_TT f
/// with the forces of the last tick; direction and levels use the rest surface, which does not
/// wobble.
#include "haptic/contact/contact_nodes.h"

#include <string.h>

enum { SUBSTEPS = 4, FIRST_TURNS = 4 };
static const double POINT_CHANGE = 0.9;  // a point tool's new node must be this much nearer
static const double MARGIN_NORMAL = 1.5; // of the largest reach: radius normals are averaged over

/// Squared distance of x from the line through the tip along d.
static double off_line(const pal_solid *solid, const double d[3], const double x[3]) {
    double p[3] = {x[0] - solid->center[0], x[1] - solid->center[1], x[2] - solid->center[2]};
    double b = v3_dot(p, d);
    return fmax(0.0, v3_dot(p, p) - b * b);
}

/// Radius over which normals are averaged: the patch a ball pressed to this depth covers, at least
/// a few nodes.
static double normal_radius(const nodes_law *law, const tool_state *tool) {
    double r = tool->solid.radius;
    double patch = fmin(r, sqrt(2.0 * r * fmax(0.0, tool->depth)));
    return fmax(patch, MARGIN_NORMAL * law->grid.reach_max);
}

void pal_nodes_gather(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    double low[3], high[3];
    pal_solid_box(&tool->solid, low, high);
    double margin = tool->travel + law->moved + law->grid.reach_max;
    double wide = tool->engaged ? normal_radius(law, tool) : 0.0;
    margin += fmax(0.0, wide - tool->solid.radius);
    for (int i = 0; i < 3; i++) {
        // back to the surface it came through, forward to the normals below it
        double back = tool->engaged ? -tool->dir[i] * (tool->depth + tool->travel) : 0.0;
        double ahead = tool->engaged ? tool->dir[i] * 0.5 * wide : 0.0;
        low[i] += fmin(fmin(back, ahead), 0.0) - margin;
        high[i] += fmax(fmax(back, ahead), 0.0) + margin;
    }
    tool->candidates = pal_grid_query(&law->grid, low, high, tool->candidate);
}

/// d from the rest normals around the tool's axis. Nothing around: d stays.
void pal_nodes_turn(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    pal_solid wide = tool->solid;
    wide.radius = normal_radius(law, tool);
    double more = wide.radius - tool->solid.radius, sum[3] = {0.0, 0.0, 0.0};
    for (int32_t k = 0; k < tool->candidates; k++) {
        const double *x = rest_of(law, tool->candidate[k]);
        const double *n = normal_of(law, tool->candidate[k]);
        double near, far;
        if (v3_dot(n, tool->dir) < 0.0 && pal_solid_chord(&wide, x, tool->dir, &near, &far)) {
            double level = 1.0 + (far - more) / (0.5 * wide.radius);
            double weight = (far - near) * (far - near) * fmax(0.0, fmin(1.0, level));
            for (int i = 0; i < 3; i++) {
                sum[i] -= weight * n[i];
            }
        }
    }
    double length = sqrt(v3_dot(sum, sum));
    if (!(length > 0.0) || !(v3_dot(sum, tool->dir) > 0.0)) {
        return;
    }
    double d[3]; // halfway: a fixed point reached without swinging
    for (int i = 0; i < 3; i++) {
        d[i] = tool->dir[i] + sum[i] / length;
    }
    length = sqrt(v3_dot(d, d));
    for (int i = 0; i < 3; i++) {
        tool->dir[i] = d[i] / length;
    }
}

void pal_nodes_narrow(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    tool->nears = 0;
    if (!tool->engaged || tool->holding > 0) {
        return;
    }
    if (is_point(law, t)) {
        if (tool->pick >= 0) {
            tool->near[tool->nears++] = tool->pick;
        }
        return;
    }
    double free = tool->travel + 0.5 * tool->moved;
    for (int32_t k = 0; k < law->def.tool_count; k++) {
        free += k != t ? law->tool[k].moved : 0.0;
    }
    pal_solid wide = tool->solid;
    wide.radius += free;
    for (int32_t k = 0; k < tool->candidates; k++) {
        int32_t a = tool->candidate[k];
        double near, far;
        if (v3_dot(normal_of(law, a), tool->dir) < 0.0 &&
            pal_solid_chord(&wide, rest_of(law, a), tool->dir, &near, &far) && far > 0.0) {
            tool->near[tool->nears++] = a;
        }
    }
}

/// Nearest candidate to the tip in the deformed configuration; -1: none.
static int32_t nearest(nodes_law *law, const tool_state *tool, double x[3]) {
    int32_t best = -1;
    double least = HUGE_VAL;
    for (int32_t k = 0; k < tool->candidates; k++) {
        double y[3], u[3], r = 0.0;
        deformed(law, tool->candidate[k], y, u);
        for (int i = 0; i < 3; i++) {
            r += (tool->solid.center[i] - y[i]) * (tool->solid.center[i] - y[i]);
        }
        if (r < least) {
            least = r;
            best = tool->candidate[k];
            memcpy(x, y, sizeof y);
        }
    }
    return best;
}

/// Node by which a point tool enters, -1: none. The tip is below the plane of its nearest node,
/// over that node's own patch, and was outside before (or starts just below).
static int32_t enter_point(nodes_law *law, tool_state *tool) {
    double x[3];
    int32_t a = nearest(law, tool, x);
    if (a < 0) {
        tool->outside = 1;
        return -1;
    }
    const double *n = normal_of(law, a);
    double p[3] = {tool->solid.center[0] - x[0], tool->solid.center[1] - x[1],
                   tool->solid.center[2] - x[2]};
    double height = v3_dot(p, n), reach = law->grid.reach[a];
    if (height >= 0.0) {
        tool->outside = 1;
        return -1;
    }
    double across = v3_dot(p, p) - height * height;
    int was_outside = tool->has_before ? tool->outside : -height <= reach;
    tool->outside = 0;
    return was_outside && across <= reach * reach ? a : -1;
}

/// Node by which a sphere or capsule enters, -1: none. The deepest node inside the tool now or on
/// its way since the last tick, among those whose outside the tool was on. A tool that met the
/// surface from inside is barred until it is clear of it.
static int32_t enter_solid(nodes_law *law, tool_state *tool) {
    int32_t best = -1, inside = 0;
    double least = 0.0;
    for (int32_t k = 0; k < tool->candidates; k++) {
        int32_t a = tool->candidate[k];
        double x[3], u[3], distance = HUGE_VAL;
        deformed(law, a, x, u);
        for (int step = 0; step < SUBSTEPS; step++) {
            pal_solid on_way = tool->solid;
            for (int i = 0; i < 3; i++) {
                double back = (double)step / SUBSTEPS;
                on_way.center[i] += back * (tool->before.center[i] - tool->solid.center[i]);
            }
            distance = fmin(distance, pal_solid_distance(&on_way, x));
        }
        inside += distance < 0.0;
        if (!(distance < least)) {
            continue;
        }
        // from the nearest point of the tool's axis one tick ago
        double p[3] = {x[0] - tool->before.center[0], x[1] - tool->before.center[1],
                       x[2] - tool->before.center[2]};
        double along =
            fmax(-tool->before.half, fmin(tool->before.half, v3_dot(p, tool->before.axis)));
        for (int i = 0; i < 3; i++) {
            p[i] = along * tool->before.axis[i] - p[i];
        }
        if (v3_dot(p, normal_of(law, a)) >= 0.0) {
            least = distance;
            best = a;
        }
    }
    if (tool->barred) {
        best = -1;
    }
    tool->barred = inside > 0 && best < 0;
    return best;
}

void pal_nodes_engage(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    int32_t a = is_point(law, t) ? enter_point(law, tool) : enter_solid(law, tool);
    if (a < 0) {
        return;
    }
    for (int i = 0; i < 3; i++) {
        tool->dir[i] = -normal_of(law, a)[i];
    }
    tool->engaged = 1;
    tool->depth = 0.0;
    pal_nodes_gather(law, t);
    for (int k = 0; k < FIRST_TURNS; k++) {
        pal_nodes_turn(law, t);
    }
}

/// The node a point tool presses: nearest to its line, facing it, over its own patch.
void pal_nodes_pick(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    int32_t now = tool->pick, best = -1;
    double least = HUGE_VAL;
    for (int32_t k = 0; k < tool->candidates; k++) {
        int32_t a = tool->candidate[k];
        double off = off_line(&tool->solid, tool->dir, rest_of(law, a));
        double reach = law->grid.reach[a];
        if (!(v3_dot(normal_of(law, a), tool->dir) < 0.0) || off > reach * reach) {
            continue;
        }
        double weighed = a == now ? POINT_CHANGE * POINT_CHANGE * off : off;
        if (weighed < least) {
            least = weighed;
            best = a;
        }
    }
    tool->pick = best;
}

/// Without contact a tool stays engaged only while its far side is below the nearest node's level
/// (a small tool between nodes); else it is outside and must come in anew.
void pal_nodes_disengage(nodes_law *law, int32_t t, const pal_contact_wrench *w) {
    tool_state *tool = &law->tool[t];
    tool->depth = w->depth;
    if (!tool->engaged || w->count > 0 || tool->holding > 0) {
        return;
    }
    int32_t best = -1;
    double least = HUGE_VAL;
    for (int32_t k = 0; k < tool->candidates; k++) {
        int32_t a = tool->candidate[k];
        double off = off_line(&tool->solid, tool->dir, rest_of(law, a));
        if (v3_dot(normal_of(law, a), tool->dir) < 0.0 && off < least) {
            least = off;
            best = a;
        }
    }
    double below = -1.0;
    if (best >= 0) {
        double room = law->grid.reach[best] + tool->solid.radius + tool->solid.half;
        double p[3];
        for (int i = 0; i < 3; i++) {
            p[i] = tool->solid.center[i] - rest_of(law, best)[i];
        }
        below = v3_dot(p, tool->dir) + tool->solid.radius +
                tool->solid.half * fabs(v3_dot(tool->solid.axis, tool->dir));
        below = least <= room * room ? below : -1.0;
    }
    if (!(below > 0.0)) {
        tool->engaged = 0;
        tool->outside = 1;
        tool->pick = -1;
    } else {
        tool->depth = below;
    }
}
