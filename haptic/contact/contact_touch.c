/// @file contact_touch.c  Law "surface": where a tool overlaps the rest surface, and the points
/// there.
///
/// Station. Each ball of a tool (centre p, radius R) has a foot c on the smooth rest surface with
/// the normal n through p; its height h = (p - c).n, its overlap d = R - h. It is followed from
/// tick to tick on its own branch of the surface, so a tool pressed past the middle of a thin organ
/// keeps the side it came from. Contact begins only for a ball whose centre was outside the body.
///
/// Coupling. Behind a virtual coupling the pose handed in is the free one: where the proxy would be
/// without contact. Against a stiff body it lies deep inside, so the foot is looked for from the
/// height of the last proxy, and the pattern's size follows the depth D at which Hertz's force on a
/// half-space balances the coupling, k (d - D) = 4/3 E* sqrt(R) D^(3/2). Neither enters the balance
/// of forces itself, which takes the gaps at the free pose and the coupling's compliance
/// (contact_system.c).
///
/// Points. Pattern places a (u e1 + v e2) around c, a = pal_pattern_radius(R, D), are moved along n
/// onto the surface: x_i with its own normal n_i, looked for from where it was in the last tick (on
/// the branch of the foot: forgotten when that was lost). The gap of x_i is the height of the
/// tool's solid over it along n, times n.n_i. e1 is carried along the surface without turning about
/// n.
///
/// Force. With the overlap h_i(p) of the tool at p and the compliance M, contact's energy is E(p) =
/// max over z >= 0 of z.h(p) - z.M z / 2, whose derivative by p is the force sum_i z_i grad h_i:
/// not along the rest normal n_i but along the tool's own normal at its far side over x_i, with z_i
/// times the cosine along n. (The shares of the points' own motion along the body cancel in the
/// continuum: a pressure's energy does not know where it is sampled.) So it is a gradient: where
/// tissue grows stiffer sideways the tool is held back by as much as it will store, a frictionless
/// ball has no torque, and what a closed path returns is the error of 16 points
/// (test_contact_energy). The body is loaded along n_i, as everything in it is linearised about its
/// rest shape. With friction the cone stands about the tool's normal, its tangents are the body's.
#include <string.h>

#include "haptic/contact/contact_anywhere.h"
#include "haptic/base/pose.h"

static const double TURN_MIN = 0.15, TURN_FULL = 0.4; // cosine between n and n_i: fade
/// The tool's slope is no steeper than at this cosine (77 degrees); patterns on flat bodies reach
/// 0.6
static const double STEEP_MIN = 0.22;

/// 0 below a, 1 above b, smooth between.
static double ramp(double x, double a, double b) {
    double s = (x - a) / (b - a);
    s = s < 0.0 ? 0.0 : s > 1.0 ? 1.0 : s;
    return s * s * (3.0 - 2.0 * s);
}

/// D: depth at which a ball on a half-space balances the coupling. Newton on s = sqrt(D), from
/// above.
static double balanced_depth(double depth, double ball, double modulus, double yield) {
    if (yield == 0.0 || !(ball > 0.0)) {
        return depth;
    }
    double h = 4.0 / 3.0 * modulus * sqrt(ball) * yield, s = sqrt(depth);
    for (int i = 0; i < 24; i++) {
        double f = (h * s + 1.0) * s * s - depth, slope = (3.0 * h * s + 2.0) * s;
        s -= slope > 0.0 ? f / slope : 0.0;
    }
    return s * s < depth ? s * s : depth;
}

/// Foot of the centre p. @return 1; 0 without one
static int find_foot(anywhere_law *law, anywhere_station *s, const double p[3], double ball) {
    double travel = 0.0;
    for (int i = 0; s->known && i < 3; i++) {
        travel += (p[i] - s->centre[i]) * (p[i] - s->centre[i]);
    }
    travel = sqrt(travel);
    const double *low = law->model->info.bounds_min, *high = law->model->info.bounds_max;
    double size[3] = {high[0] - low[0], high[1] - low[1], high[2] - low[2]};
    double all = sqrt(v3_dot(size, size)) + ball + travel;
    pal_surface_point at = s->at;
    int found = s->engaged && pal_rest_track(&law->surface, p, all, &s->at, &at);
    if (!found) {
        double reach = s->known && !s->engaged ? ball + travel + 0.1 * law->spacing : all;
        found = pal_rest_closest(&law->surface, p, reach, s->at.triangle, &at);
        s->engaged = 0;
    }
    if (!found) {
        s->outside = s->known ? s->outside : 1;
        s->at.triangle = -1;
    } else {
        if (!s->engaged) {
            // the first time: a tool may start pressed in, its centre not deeper than its radius
            s->outside =
                s->known ? s->outside || at.distance > 0.0 : at.distance > -ball - 1e-9 * all;
        }
        s->at = at;
    }
    memcpy(s->centre, p, sizeof s->centre);
    s->known = 1;
    return found;
}

/// e1 in the plane across n.
static void carry_frame(anywhere_station *s, const double n[3], int fresh) {
    double *e = s->across;
    double along = v3_dot(e, n), length = 0.0;
    for (int pass = fresh; pass < 3; pass++) {
        if (pass > 0) { // the axis that is most across n
            int axis = fabs(n[0]) <= fabs(n[1]) ? (fabs(n[0]) <= fabs(n[2]) ? 0 : 2)
                                                : (fabs(n[1]) <= fabs(n[2]) ? 1 : 2);
            e[0] = e[1] = e[2] = 0.0;
            e[axis] = 1.0;
            along = n[axis];
        }
        for (int i = 0; i < 3; i++) {
            e[i] -= along * n[i];
        }
        length = sqrt(v3_dot(e, e));
        if (length > 0.1) {
            break;
        }
    }
    for (int i = 0; i < 3; i++) {
        e[i] /= length;
    }
}

/// Directions of a point's rows: inward, then e1 and e2 moved into its tangent plane.
static void frame(anywhere_point *point, const double across[3]) {
    const double *n = point->normal;
    double along = v3_dot(across, n), e[3], length;
    for (int i = 0; i < 3; i++) {
        e[i] = across[i] - along * n[i];
    }
    length = sqrt(v3_dot(e, e));
    for (int i = 0; i < 3; i++) {
        point->along[0][i] = -n[i];
        point->along[1][i] = e[i] / length; // facing > TURN_MIN keeps it away from 0
    }
    e[0] = point->along[1][0], e[1] = point->along[1][1], e[2] = point->along[1][2];
    point->along[2][0] = n[1] * e[2] - n[2] * e[1];
    point->along[2][1] = n[2] * e[0] - n[0] * e[2];
    point->along[2][2] = n[0] * e[1] - n[1] * e[0];
}

/// felt[0]: the gradient of the point's overlap by the tool's place; `down` is -n.
static void feel(const anywhere_tool *tool, const double down[3], double facing,
                 anywhere_point *point) {
    const pal_solid *solid = &tool->solid;
    double e[3], along = v3_dot(point->arm, solid->axis);
    along = along < -solid->half ? -solid->half : along > solid->half ? solid->half : along;
    for (int i = 0; i < 3; i++) { // the tool's outward normal there, times its radius
        e[i] = point->arm[i] - along * solid->axis[i];
    }
    double deep = v3_dot(e, down), least = STEEP_MIN * solid->radius;
    memcpy(point->felt, point->along, sizeof point->felt);
    for (int i = 0; i < 3 && solid->radius > 0.0; i++) {
        double slope = (e[i] - deep * down[i]) / (deep > least ? deep : least);
        point->felt[0][i] = facing * (down[i] + slope);
    }
}

/// Append the point at surface place `at` (cell `area` seen along n).
static void add_point(anywhere_law *law, int32_t t, const anywhere_station *s, int32_t k,
                      const pal_surface_point *at, double area, double self) {
    const anywhere_tool *tool = &law->tool[t];
    const double *n = s->at.normal;
    double facing = v3_dot(at->normal, n), near, far, down[3] = {-n[0], -n[1], -n[2]};
    double fade = ramp(at->inside, 0.0, law->spacing) * ramp(facing, TURN_MIN, TURN_FULL);
    double from[3];
    for (int i = 0; i < 3; i++) { // the body moved against the tool
        from[i] = at->position[i] - s->shift[i];
    }
    if (!(fade > 1e-6) || !pal_solid_chord(&tool->solid, from, down, &near, &far)) {
        return;
    }
    anywhere_point *point = &law->point[law->points];
    if (pal_weights_at(&law->weights, at, 0.0, &point->phi) == 0) {
        return;
    }
    point->tool = t;
    point->station = (int32_t)(s - tool->station);
    point->id = s->first + k;
    memcpy(point->x, at->position, sizeof point->x);
    memcpy(point->normal, at->normal, sizeof point->normal);
    point->mu = law->def.tools[t].friction;
    for (int i = 0; i < 3; i++) {
        point->arm[i] = from[i] + far * down[i] - tool->free.position[i];
    }
    frame(point, s->across);
    feel(tool, down, facing, point);
    point->q[0] = -far * facing + v3_dot(point->felt[0], s->give);
    for (int i = 0; i < 3; i++) { // M has the body's part of the shift along its normal
        point->q[0] -= at->normal[i] * (s->shift[i] - s->give[i]);
    }
    point->q[1] = point->q[2] = 0.0;
    point->area = area / facing;
    point->width = sqrt(point->area) / (2.0 * self);
    point->fade = fade;
    law->points += point->width > 0.0;
}

/// Where the line through `origin` meets the surface: from point k's own place in the last tick
/// when it has one, else from the foot, else wherever. @return 1; 0 without one
static int find_place(anywhere_law *law, const anywhere_station *s, int32_t k,
                      const pal_rest_aim *aim, const double origin[3], double reach, int laid,
                      pal_surface_point *at) {
    pal_surface_point *last = &law->place[s->first + k];
    if ((laid && pal_rest_follow(&law->surface, aim, origin, reach, TURN_MIN, last, at)) ||
        pal_rest_follow(&law->surface, aim, origin, reach, TURN_MIN, &s->at, at) ||
        pal_rest_project(&law->surface, origin, aim->direction, reach, TURN_MIN, -1, at)) {
        *last = *at;
        return 1;
    }
    last->triangle = -1;
    return 0;
}

/// @param laid  the points were laid out in the last tick, on the branch of the foot
static void spread(anywhere_law *law, int32_t t, anywhere_station *s, double ball, double depth,
                   int laid) {
    const anywhere_tool *tool = &law->tool[t];
    double a = pal_pattern_radius(&tool->pattern, ball, depth);
    if (s->points == 1) {
        double area = ball == 0.0       ? law->spacing * law->spacing
                      : s->length > 0.0 ? 1.4 * a * s->length
                                        : 3.14159265358979324 * a * a;
        double self = ball == 0.0 || s->length > 0.0 ? PALPATE_NEAR_SELF : tool->pattern.self;
        add_point(law, t, s, 0, &s->at, area, self);
        return;
    }
    const double *n = s->at.normal, *e = s->across;
    double f[3] = {n[1] * e[2] - n[2] * e[1], n[2] * e[0] - n[0] * e[2], n[0] * e[1] - n[1] * e[0]};
    double reach = 2.0 * ball + a;
    pal_rest_aim aim;
    int aimed = pal_rest_aim_at(n, &aim);
    for (int32_t k = 0; k < s->points; k++) {
        const double *uv = tool->pattern.at[k];
        pal_surface_point at = s->at;
        if (k > 0) {
            double origin[3];
            for (int i = 0; i < 3; i++) {
                origin[i] = s->at.position[i] + a * (uv[0] * e[i] + uv[1] * f[i]);
            }
            if (!aimed || !find_place(law, s, k, &aim, origin, reach, laid, &at)) {
                continue;
            }
        }
        add_point(law, t, s, k, &at, tool->pattern.share * a * a, tool->pattern.self);
    }
}

void pal_anywhere_touch(anywhere_law *law, int32_t t) {
    anywhere_tool *tool = &law->tool[t];
    double ball = tool->solid.radius;
    tool->inside = 0;
    for (int32_t k = 0; k < tool->stations; k++) {
        anywhere_station *s = &tool->station[k];
        double p[3], from[3], back[3];
        for (int i = 0; i < 3; i++) {
            p[i] = tool->free.position[i] + s->along * tool->solid.axis[i];
            back[i] = tool->proxy[i] - tool->free.position[i];
        }
        int fresh = !s->engaged;
        pal_anywhere_shift(law, t, s);
        double lift = s->engaged && tool->yield > 0.0 ? v3_dot(back, s->at.normal) : 0.0;
        for (int i = 0; i < 3; i++) {
            from[i] = p[i] + s->shift[i] + (lift != 0.0 ? lift * s->at.normal[i] : 0.0);
        }
        int found = find_foot(law, s, from, ball);
        int laid = s->laid && s->engaged; // still: the foot was followed
        s->depth = 0.0;
        s->laid = 0;
        if (!found) {
            s->engaged = 0;
            continue;
        }
        tool->inside |= s->at.distance < 0.0;
        double arm[3];
        for (int i = 0; i < 3; i++) {
            arm[i] = p[i] + s->shift[i] - s->at.position[i];
        }
        double depth = ball - v3_dot(arm, s->at.normal);
        s->engaged = s->outside && depth > 0.0;
        if (!s->engaged) {
            continue;
        }
        s->depth = depth;
        carry_frame(s, s->at.normal, fresh);
        if (tool->held_count > 0) {
            continue;
        }
        spread(law, t, s, ball, balanced_depth(depth, ball, law->modulus, tool->yield), laid);
        s->laid = 1;
    }
}
