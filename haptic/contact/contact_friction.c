/// @file contact_friction.c  Law "surface": what friction knows of the last tick.
///
/// Coulomb's law asks for the slip of the body against the tool, which is incremental: with u the
/// displacement of the material now under point i, then (') and now, and d the motion of the tool
/// there,
///
///     w_t = [u_i - u_i' - d_i]_t,   u_i = [C F]_i,   d_i = p - p' + arm_i - Q^T arm_i,
///
/// Q the tool's turn since the last tick; p = p_free - sum f / k behind a coupling
/// (contact_system.c). u' is taken at this tick's points from the forces of the last: R F' on the
/// nodes (those that have joined the working set are computed anew) and K between this tick's
/// points and the last's. So a point that has moved along the body finds the displacement that was
/// there, and where nothing moves w = 0 for the forces of the last tick: nothing drifts.
///
/// Pattern. A tool that sticks carries the material along. Of the material X, now at X + u, the
/// tool at p touches X = p - u: the pattern is laid out under p - drag, drag being the mean
/// displacement under the station along the surface, weighted by the normal forces, in the last
/// tick, plus the part of the tool's motion since by which sticking points will follow it. So a
/// stuck pattern stays on its material, a sliding one runs ahead with the tool. The free pose
/// behind a coupling lies ahead of the proxy by sum f' / k, which is taken off likewise. Gaps are
/// those of the shifted tool less the shift's own normal part, which M has already: the shift
/// changes them by curvature only.
#include <string.h>

#include "haptic/base/pose.h"
#include "haptic/base/wide.h"
#include "haptic/contact/contact_anywhere.h"

enum { SWEEPS = 8 }; // vectors of displacement in registers

/// Weight in the drag of a point without normal force, as a part of the tool's force: were a
/// station that loses its force laid out without drag, it could win and lose it for ever under a
/// tool at rest.
static const double UNLOADED = 1e-6;
/// Of the drag found under a pattern against the one it was laid out for, what the next is laid out
/// for. The drag depends on where the pattern lies; deep in a curved body by more than itself and
/// the other way, so that taken whole two places took turns for ever (5 and 8 mm, 26 % of the force
/// each tick).
static const double RELAX = 0.5;
/// The same of the coupling's give along the surface, down to this part where it turns round from
/// tick to tick: at sharp edges it depends on where the tool is laid out by many times itself, and
/// taken whole the force jumped every tick (a shaft with friction held still at a box's edges: 84
/// of 120 for ever, now 27, by up to all of the force).
static const double PACE_MIN = 0.03;

/// v less its part along n.
static void flatten(const double n[3], double v[3]) {
    double along = v3_dot(v, n);
    for (int i = 0; i < 3; i++) {
        v[i] -= along * n[i];
    }
}

/// Motion of the tool since the last tick at `arm`, without the give of the coupling: what of the
/// motion of the free pose and of the turn is seen there.
static void motion_at(const anywhere_tool *tool, const double from[3], const double arm[3],
                      double d[3]) {
    double back[4], turn[4], before[3];
    pal_quat_conjugate(tool->last.orientation, back);
    pal_quat_multiply(tool->free.orientation, back, turn);
    pal_quat_rotate_inverse(turn, arm, before);
    for (int i = 0; i < 3; i++) {
        d[i] = tool->free.position[i] - from[i] + arm[i] - before[i];
    }
}

void pal_anywhere_shift(const anywhere_law *law, int32_t t, anywhere_station *s) {
    const anywhere_tool *tool = &law->tool[t];
    memset(s->shift, 0, sizeof s->shift);
    if (!s->engaged || !tool->has_before) {
        memset(s->give, 0, sizeof s->give);
        memset(s->step, 0, sizeof s->step);
        s->pace = RELAX;
        return;
    }
    double found[3];
    for (int i = 0; i < 3; i++) {
        found[i] = -tool->yield * tool->force[i] - s->give[i];
    }
    flatten(s->at.normal, found);
    s->pace =
        v3_dot(found, s->step) < 0.0 ? fmax(0.5 * s->pace, PACE_MIN) : fmin(1.2 * s->pace, RELAX);
    for (int i = 0; i < 3; i++) {
        s->step[i] = found[i];
        s->give[i] += s->pace * found[i];
    }
    flatten(s->at.normal, s->give);
    memcpy(s->shift, s->give, sizeof s->shift);
    if (!(law->def.tools[t].friction > 0.0)) {
        return;
    }
    double arm[3], follow[3];
    for (int i = 0; i < 3; i++) { // the foot of the ball
        arm[i] = s->along * tool->solid.axis[i] - tool->solid.radius * s->at.normal[i];
    }
    motion_at(tool, tool->last.position, arm, follow);
    for (int i = 0; i < 3; i++) {
        s->shift[i] -= s->drag[i] + s->stuck * follow[i];
    }
    flatten(s->at.normal, s->shift);
}

void pal_anywhere_recall(anywhere_law *law) {
    const pal_working_set *set = &law->set;
    memset(law->recalled, 0, (size_t)set->count);
    for (int32_t k = 0; k < law->past_nodes; k++) {
        int32_t s = set->slot[law->past_column[k]];
        if (s >= 0) {
            memcpy(law->recalled_u + 3 * (size_t)s, law->past_u + 3 * (size_t)k,
                   3 * sizeof *law->recalled_u);
            law->recalled[s] = 1;
        }
    }
    size_t ld = (size_t)set->stride;
    for (int32_t s = 0; s < set->count; s++) {
        double *u = law->recalled_u + 3 * (size_t)s;
        if (law->recalled[s]) {
            continue;
        }
        u[0] = u[1] = u[2] = 0.0;
        for (int32_t k = 0; k < law->past_nodes; k++) {
            int32_t a = set->slot[law->past_column[k]];
            const double *f = law->past_force + 3 * (size_t)k;
            for (size_t c = 0; c < 3 && a >= 0 && f[c] != 0.0; c++) {
                const double *column = set->block + 3 * (size_t)s + (3 * (size_t)a + c) * ld;
                for (int i = 0; i < 3; i++) {
                    u[i] += column[i] * f[c];
                }
            }
        }
    }
}

void pal_anywhere_slip(const anywhere_law *law, anywhere_point *point) {
    const anywhere_tool *tool = &law->tool[point->tool];
    double u[3], own[3], d[3] = {0.0, 0.0, 0.0};
    pal_anywhere_sample(point, law->recalled_u, u);
    pal_anywhere_trace(law, point, own);
    if (tool->has_before) {
        motion_at(tool, tool->proxy, point->arm, d);
    }
    for (int r = 1; r < 3; r++) {
        const double *e = point->along[r];
        point->q[r] = -v3_dot(e, u) - v3_dot(e, own) - v3_dot(e, d);
    }
}

/// drag and stuck of the stations.
static void follow_material(anywhere_law *law) {
    double weight[PALPATE_TOOLS_MAX][PALPATE_STATIONS_MAX] = {{0.0}};
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        for (int32_t k = 0; k < law->tool[t].stations; k++) {
            memset(law->tool[t].station[k].drag, 0, sizeof law->tool[t].station[k].drag);
            law->tool[t].station[k].stuck = 0.0;
        }
    }
    for (int32_t i = 0; i < law->points; i++) {
        const anywhere_point *point = &law->point[i];
        const anywhere_tool *tool = &law->tool[point->tool];
        anywhere_station *s = &law->tool[point->tool].station[point->station];
        double z = law->z[point->first];
        if (!(point->mu > 0.0)) {
            continue;
        }
        // a station between others may carry none; its material is displaced all the same
        z = (z > 0.0 ? z : 0.0) + UNLOADED * sqrt(v3_dot(tool->force, tool->force));
        weight[point->tool][point->station] += z;
        s->stuck += law->state[i] == PALPATE_POINT_STICK ? z : 0.0;
        for (int32_t a = 1; a < 3; a++) {
            const double *e = point->along[a];
            int32_t r = point->first + a;
            // M z less the give of the coupling
            double u = law->w[r] - law->q[r] - tool->yield * v3_dot(e, tool->force);
            for (int c = 0; c < 3; c++) {
                s->drag[c] += z * u * e[c];
            }
        }
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        for (int32_t k = 0; k < law->tool[t].stations; k++) {
            anywhere_station *s = &law->tool[t].station[k];
            double sum = weight[t][k];
            s->stuck = sum > 0.0 ? s->stuck / sum : 0.0;
            for (int c = 0; c < 3; c++) {
                double found = sum > 0.0 ? s->drag[c] / sum : 0.0, laid = s->give[c] - s->shift[c];
                s->drag[c] = laid + RELAX * (found - laid);
            }
            flatten(s->at.normal, s->drag);
        }
    }
}

/// Elements k .. of sum_sweeps(): `vectors` x PALPATE_LANES of them.
PALPATE_INLINE void sum_tile(const int vectors, anywhere_law *law, size_t k) {
    pal_lanes sum[SWEEPS];
    PALPATE_UNROLL
    for (int h = 0; h < vectors; h++) {
        sum[h] = PALPATE_FILL(0.0);
    }
    for (int32_t i = 0; i < law->points; i++) {
        const anywhere_point *point = &law->point[i];
        for (int32_t a = 0; a < point->rows; a++) {
            const double *y = law->y + (size_t)(point->first + a) * (size_t)law->ld + k;
            double f = point->rows == 3 ? law->trace[i].force[a] : law->z[point->first];
            if (f != 0.0) {
                const pal_lanes times = PALPATE_FILL(f);
                PALPATE_UNROLL
                for (int h = 0; h < vectors; h++) {
                    pal_lanes v;
                    PALPATE_LOAD(v, y + PALPATE_LANES * h);
                    sum[h] += times * v;
                }
            }
        }
    }
    PALPATE_UNROLL
    for (int h = 0; h < vectors; h++) {
        PALPATE_STORE(law->past_u + k + PALPATE_LANES * h, sum[h]);
    }
}

/// past_u = R F of the nodes, from the sweeps of the points: of three directions with a point's
/// force, or of the one along its row. Columns are padded: whole tiles may be read and written.
PALPATE_INLINE void sum_sweeps(anywhere_law *law) {
    size_t nodes = 3 * (size_t)law->past_nodes, k = 0;
    for (; k + SWEEPS * PALPATE_LANES <= nodes; k += SWEEPS * PALPATE_LANES) {
        sum_tile(SWEEPS, law, k);
    }
    for (; k < nodes; k += 2 * PALPATE_LANES) {
        sum_tile(2, law, k);
    }
}

PALPATE_AVX2 static void sum_sweeps_avx2(anywhere_law *law) {
    sum_sweeps(law);
}

void pal_anywhere_remember(anywhere_law *law) {
    const pal_working_set *set = &law->set;
    size_t nodes = 3 * (size_t)set->count;
    law->past_nodes = set->count;
    memcpy(law->past_column, set->column, (size_t)set->count * sizeof *law->past_column);
    memcpy(law->past_force, law->nodal, nodes * sizeof *law->past_force);
    law->traces = law->points;
    for (int32_t i = 0; i < law->points; i++) {
        const anywhere_point *point = &law->point[i];
        anywhere_trace *trace = &law->trace[i];
        *trace = (anywhere_trace){.id = point->id,
                                  .tool = point->tool,
                                  .station = point->station,
                                  .width = point->width,
                                  .fade = point->fade};
        memcpy(trace->x, point->x, sizeof trace->x);
        memcpy(trace->normal, point->normal, sizeof trace->normal);
        for (int32_t a = 0; a < point->rows; a++) {
            for (int c = 0; c < 3; c++) {
                trace->force[c] += law->z[point->first + a] * point->along[a][c];
            }
        }
        double *along = law->past.along + 4 * (size_t)i;
        law->past.x[i] = point->x[0];
        law->past.y[i] = point->x[1];
        law->past.z[i] = point->x[2];
        law->past.width[i] = point->width;
        memcpy(along, trace->force, sizeof trace->force);
        along[3] = v3_dot(trace->force, trace->normal);
    }
    if (pal_have_avx2()) {
        sum_sweeps_avx2(law);
    } else {
        sum_sweeps(law);
    }
    follow_material(law);
}
