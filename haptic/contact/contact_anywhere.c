/// @file contact_anywhere.c  Contact law "surface": contact points anywhere on the rest surface.
///
/// Each tool carries a pattern of contact points that moves and grows with it (contact_touch.c).
/// Displacement at a point is interpolated from the nodes around it, u = Phi U, and its force acts
/// on them with the same weights, F = Phi^T f (virtual work), so the compliance between points is
/// Phi C Phi^T, of which the part that the nodes cannot resolve is replaced by the half-space's own
/// (working_set.h, contact_system.c). Contact is linearised about the rest shape: the body
/// is loaded along the rest surface's normals, and gaps w = q + M z and forces z are complementary
/// (complementarity.h), for all tools in one system, coupled through the body.
///
/// Virtual coupling, solved together with the contact. Device at p_d, proxy at p, spring k, damper
/// b, period h; backward Euler for the damper makes the coupling a spring to a free position:
///     f = k (p_d - p) + b/h ((p_d - p_d') - (p - p')) = k_eff (p_free - p),   k_eff = k + b/h,
///     p_free = (k p_d + b/h (p' + p_d - p_d')) / k_eff      (': last tick)
/// A massless proxy balances contact and coupling, f = sum of contact forces, which is 1/k_eff
/// between all points of the tool in M and gaps taken at p_free. The proxy has the device's
/// orientation.
///
/// Grasp. What a tool touches when its button closes is held to it, in all three directions, until
/// it opens; nothing else of it touches meanwhile (contact_grasp.c).
///
/// Friction (Coulomb, circular cone: friction.h) adds two rows to a point: the slip of the body
/// against the tool since the last tick (contact_friction.c); its force acts where the tool
/// touches, with its torque, so that a twist about the normal is resisted too.
///
/// Force on the tool. z h(p), its work, has a gradient that is not along the body's normal: a tool
/// also feels the slopes of its own surface (contact_touch.c: felt). The coupling's part of M is
/// felt_i . felt_j / k_eff, so that M stays symmetric, and the slopes are those of the place that
/// the last tick's force predicts for the proxy.
///
/// Torque. The normal force of a contact passes through the centre of the ball it comes from, so a
/// sphere and a point feel none and a capsule that of forces at its axis.
///
/// Memory: one block. Everything is bounded by counts; no state but the last tick's.
#include "haptic/contact/contact_anywhere.h"

#include <string.h>

#include "haptic/base/block.h"
#include "haptic/base/error.h"
#include "haptic/base/pose.h"

enum { NODES_PER_POINT = 14, NODES_SPARE = 24, WEIGHT_NODES = 6 };

// ---- Definition ---------------------------------------------------------------------------------

static pal_status anywhere_check(const pal_model *model, const pal_contact_def *def,
                                 pal_error *error) {
    (void)model;
    for (int32_t t = 0; t < def->tool_count; t++) {
        const pal_tool_def *tool = &def->tools[t];
        if (!(tool->friction >= 0.0 && isfinite(tool->friction))) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "tools[%d].friction: %g: must not be negative", (int)t, tool->friction);
        }
        if (!(tool->coupling_stiffness >= 0.0 && isfinite(tool->coupling_stiffness)) ||
            !(tool->coupling_damping >= 0.0 && isfinite(tool->coupling_damping))) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "tools[%d].coupling: stiffness %g N/m, damping %g N s/m: must not be "
                            "negative (stiffness 0: no coupling)",
                            (int)t, tool->coupling_stiffness, tool->coupling_damping);
        }
    }
    return PALPATE_OK;
}

/// Contact points of one tool: `points`, but all tools together max_contacts at most.
static int32_t share(const pal_contact_def *def) {
    int32_t points = def->points < PALPATE_POINTS_MAX ? def->points : PALPATE_POINTS_MAX;
    int32_t each = def->max_contacts / def->tool_count;
    points = each < points ? each : points;
    return points > 1 ? points : 1;
}

static int32_t point_capacity(const pal_contact_def *def) {
    return def->tool_count * share(def);
}

static int32_t node_capacity(const pal_model *model, const pal_contact_def *def) {
    int32_t want = NODES_PER_POINT * point_capacity(def) + NODES_SPARE;
    return want < model->info.column_count ? want : model->info.column_count;
}

/// Stations and patterns of a tool with `points` contact points.
static void lay_out(anywhere_tool *tool, const pal_tool_def *def, int32_t first, int32_t points) {
    memset(tool, 0, sizeof *tool);
    pal_pattern_init(&tool->pattern, def->shape == PALPATE_SHAPE_POINT ? 1 : points);
    tool->stations = 1;
    tool->station[0] = (anywhere_station){.first = first, .points = tool->pattern.count};
    tool->station[0].at.triangle = -1;
    if (def->shape != PALPATE_SHAPE_CAPSULE || !(def->length > 0.0)) {
        return;
    }
    // a ball at each end, the tip first, and single points along the shaft between
    int32_t ends = points >= 12 ? 6 : 1, rest = points - 2 * ends;
    int32_t inner = rest < PALPATE_STATIONS_MAX - 2 ? rest : PALPATE_STATIONS_MAX - 2;
    inner = inner > 0 ? inner : 0;
    pal_pattern_init(&tool->pattern, ends);
    tool->stations = points > 1 ? inner + 2 : 1;
    for (int32_t k = 0; k < tool->stations; k++) {
        anywhere_station *s = &tool->station[k];
        *s = (anywhere_station){.first = first, .points = k < 2 ? tool->pattern.count : 1};
        s->at.triangle = -1;
        s->along = k == 0   ? -0.5 * def->length
                   : k == 1 ? 0.5 * def->length
                            : def->length * ((k - 1.0) / (inner + 1.0) - 0.5);
        s->length = k < 2 ? 0.0 : def->length / (inner + 1.0);
        first += s->points;
    }
}

// ---- Memory -------------------------------------------------------------------------------------

static size_t y_stride(const pal_model *model, const pal_contact_def *def) {
    return pal_block_padded(3 * (size_t)node_capacity(model, def) * sizeof(double)) /
           sizeof(double);
}

static int has_friction(const pal_contact_def *def) {
    int some = 0;
    for (int32_t t = 0; t < def->tool_count; t++) {
        some |= def->tools[t].friction > 0.0;
    }
    return some;
}

/// Of anywhere_around without its directions.
static size_t around_bytes(size_t points) {
    return 5 * pal_block_padded((points + 4) * sizeof(double));
}

static void take_around(anywhere_around *around, size_t points, unsigned char **at) {
    double **part[] = {&around->x, &around->y, &around->z, &around->width, &around->near};
    for (size_t k = 0; k < sizeof part / sizeof *part; k++) {
        *part[k] = pal_block_take(at, (points + 4) * sizeof(double));
    }
}

/// Of what contact_friction.c keeps.
static size_t past_bytes(const pal_model *model, const pal_contact_def *def) {
    size_t points = (size_t)point_capacity(def), nodes = (size_t)node_capacity(model, def);
    return has_friction(def)
               ? pal_block_padded(points * sizeof(anywhere_trace)) + around_bytes(points) +
                     pal_block_padded(4 * points * sizeof(double)) +
                     pal_block_padded(nodes * sizeof(int32_t)) +
                     3 * pal_block_padded(3 * nodes * sizeof(double)) + pal_block_padded(nodes)
               : 0;
}

static size_t anywhere_bytes(const pal_model *model, const pal_contact_def *def) {
    size_t points = (size_t)point_capacity(def), rows = 3 * points;
    size_t nodes = 3 * (size_t)node_capacity(model, def);
    return pal_block_padded(sizeof(anywhere_law)) + pal_rest_bytes(model) +
           pal_weights_bytes(model) + pal_near_bytes(model) +
           pal_working_set_bytes(model, node_capacity(model, def)) +
           pal_block_padded(points * sizeof(anywhere_point)) +
           pal_block_padded(points * sizeof(anywhere_held)) +
           pal_block_padded(points * sizeof(pal_surface_point)) +
           pal_block_padded((rows * y_stride(model, def) + 1) * sizeof(double)) +
           around_bytes(points) + pal_block_padded(12 * points * sizeof(double)) +
           pal_block_padded(rows * rows * sizeof(double)) +
           4 * pal_block_padded(rows * sizeof(double)) + pal_block_padded(points * sizeof(double)) +
           2 * pal_block_padded(points) + pal_block_padded(pal_friction_bytes((int32_t)points)) +
           2 * pal_block_padded(nodes * sizeof(double)) +
           pal_block_padded(nodes * sizeof(int32_t)) + past_bytes(model, def);
}

static void anywhere_reset(void *self) {
    anywhere_law *law = self;
    int32_t each = share(&law->def);
    pal_working_set_clear(&law->set);
    memset(law->before, 0, (size_t)law->capacity);
    memset(law->force_before, 0, 3 * (size_t)law->capacity * sizeof *law->force_before);
    law->points = law->rows = law->traces = law->past_nodes = 0;
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        const pal_tool_def *def = &law->def.tools[t];
        anywhere_tool *tool = &law->tool[t];
        lay_out(tool, def, t * each, each);
        tool->held = law->held + (size_t)t * (size_t)each;
        if (def->coupling_stiffness > 0.0) {
            tool->damping = def->coupling_damping / law->def.period;
            tool->yield = 1.0 / (def->coupling_stiffness + tool->damping);
        }
    }
}

/// Root of the mean area of a touchable node.
static double touchable_spacing(const pal_model *model) {
    double sum = 0.0;
    int32_t count = 0;
    for (int32_t j = 0; j < model->info.column_count; j++) {
        int32_t node = model->column_node[j];
        if ((model->node_flags[node] & PALPATE_NODE_TOUCHABLE) != 0) {
            const double *a = model->area_vector + 3 * (size_t)node;
            sum += sqrt(v3_dot(a, a));
            count++;
        }
    }
    return count > 0 && sum > 0.0 ? sqrt(sum / count) : model->info.spacing_mean;
}

static void *anywhere_init(void *memory, const pal_model *model, const pal_contact_def *def) {
    size_t points = (size_t)point_capacity(def), rows = 3 * points;
    size_t nodes = 3 * (size_t)node_capacity(model, def);
    unsigned char *at = memory;
    memset(memory, 0, anywhere_bytes(model, def));
    anywhere_law *law = pal_block_take(&at, sizeof *law);
    law->def = *def;
    law->model = model;
    law->capacity = (int32_t)points;
    law->ld = (int32_t)y_stride(model, def);
    double nu = model->info.poisson;
    law->modulus = fabs(nu) < 1.0 ? model->info.young / (1.0 - nu * nu) : 0.0;
    law->spacing = touchable_spacing(model);
    pal_rest_init(&law->surface, model, pal_block_take(&at, pal_rest_bytes(model)));
    pal_weights_init(&law->weights, model, &law->surface, WEIGHT_NODES, PALPATE_WEIGHTS_POWER,
                     pal_block_take(&at, pal_weights_bytes(model)));
    pal_near_init(&law->near, model, &law->surface, 2, pal_block_take(&at, pal_near_bytes(model)));
    pal_working_set_init(
        &law->set, &law->near, node_capacity(model, def),
        pal_block_take(&at, pal_working_set_bytes(model, node_capacity(model, def))));
    law->point = pal_block_take(&at, points * sizeof *law->point);
    law->held = pal_block_take(&at, points * sizeof *law->held);
    law->place = pal_block_take(&at, points * sizeof *law->place);
    law->y = pal_block_take(&at, (rows * y_stride(model, def) + 1) * sizeof(double));
    take_around(&law->around, points, &at);
    law->around.along = pal_block_take(&at, 12 * points * sizeof(double));
    law->m = pal_block_take(&at, rows * rows * sizeof(double));
    law->q = pal_block_take(&at, rows * sizeof(double));
    law->z = pal_block_take(&at, rows * sizeof(double));
    law->w = pal_block_take(&at, rows * sizeof(double));
    law->force_before = pal_block_take(&at, rows * sizeof(double));
    law->mu = pal_block_take(&at, points * sizeof(double));
    law->state = pal_block_take(&at, points);
    law->before = pal_block_take(&at, points);
    law->work = pal_block_take(&at, pal_friction_bytes((int32_t)points));
    law->nodal = pal_block_take(&at, nodes * sizeof(double));
    law->force = pal_block_take(&at, nodes * sizeof(double));
    law->dof = pal_block_take(&at, nodes * sizeof(int32_t));
    law->frictional = has_friction(def);
    if (law->frictional) {
        law->trace = pal_block_take(&at, points * sizeof *law->trace);
        take_around(&law->past, points, &at);
        law->past.along = pal_block_take(&at, 4 * points * sizeof(double));
        law->past_column = pal_block_take(&at, nodes / 3 * sizeof(int32_t));
        law->past_force = pal_block_take(&at, nodes * sizeof(double));
        law->past_u = pal_block_take(&at, nodes * sizeof(double));
        law->recalled_u = pal_block_take(&at, nodes * sizeof(double));
        law->recalled = pal_block_take(&at, nodes / 3);
    }
    anywhere_reset(law);
    return law;
}

// ---- Tick ---------------------------------------------------------------------------------------

/// Where the coupling alone would put tool t.
static void place(anywhere_law *law, int32_t t, const pal_pose *device) {
    anywhere_tool *tool = &law->tool[t];
    const pal_tool_def *def = &law->def.tools[t];
    tool->free = *device;
    if (tool->yield > 0.0 && tool->has_before) {
        for (int i = 0; i < 3; i++) {
            double moved = tool->proxy[i] + device->position[i] - tool->device[i];
            tool->free.position[i] =
                (def->coupling_stiffness * device->position[i] + tool->damping * moved) *
                tool->yield;
        }
    }
    memcpy(tool->device, device->position, sizeof tool->device);
    tool->solid = pal_solid_place(def, &tool->free);
}

static void add_cross(const double a[3], const double f[3], double sum[3]) {
    sum[0] += a[1] * f[2] - a[2] * f[1];
    sum[1] += a[2] * f[0] - a[0] * f[2];
    sum[2] += a[0] * f[1] - a[1] * f[0];
}

/// Torque about the tool's origin of a point's force f: that of a held one acts where it is held;
/// the normal part of another acts at the tool's axis, friction where the tool touches.
/// @param push  its normal force
static void add_torque(const anywhere_tool *tool, const anywhere_point *point, double push,
                       const double f[3], double torque[3]) {
    const pal_solid *solid = &tool->solid;
    if (point->mu < 0.0) { // x - q.e, both with the tool at its free pose
        double p[3];
        for (int i = 0; i < 3; i++) {
            p[i] = point->x[i] - solid->center[i] - point->q[0] * point->along[0][i] -
                   point->q[1] * point->along[1][i] - point->q[2] * point->along[2][i];
        }
        add_cross(p, f, torque);
        return;
    }
    double s = v3_dot(point->arm, solid->axis), normal[3], friction[3], axis[3];
    s = s < -solid->half ? -solid->half : s > solid->half ? solid->half : s;
    for (int i = 0; i < 3; i++) {
        normal[i] = push * point->felt[0][i];
        friction[i] = f[i] - normal[i];
        axis[i] = s * solid->axis[i];
    }
    add_cross(axis, normal, torque);
    add_cross(point->arm, friction, torque);
}

static void summarise(anywhere_law *law, pal_contact_result *result) {
    double weight[PALPATE_TOOLS_MAX] = {0.0};
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        const anywhere_tool *tool = &law->tool[t];
        for (int i = 0; i < 3 && tool->held_count > 0; i++) {
            result->tool[t].force[i] = tool->preload[i];
        }
    }
    for (int32_t p = 0; p < law->points; p++) {
        const anywhere_point *point = &law->point[p];
        pal_contact_wrench *w = &result->tool[point->tool];
        double f[3] = {0.0, 0.0, 0.0}, size = fabs(law->z[point->first]);
        for (int32_t a = 0; a < point->rows; a++) {
            for (int i = 0; i < 3; i++) {
                f[i] += law->z[point->first + a] * point->felt[a][i];
            }
        }
        if (!(size > 0.0) && !(point->mu < 0.0)) {
            continue;
        }
        for (int i = 0; i < 3; i++) {
            w->force[i] += f[i];
            w->centroid[i] += size * point->x[i];
            w->normal[i] -= size * point->felt[0][i];
        }
        add_torque(&law->tool[point->tool], point, law->z[point->first], f, w->torque);
        weight[point->tool] += size;
        w->count++;
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        pal_contact_wrench *w = &result->tool[t];
        double length = sqrt(v3_dot(w->normal, w->normal));
        for (int i = 0; i < 3 && weight[t] > 0.0; i++) {
            w->centroid[i] /= weight[t];
            w->normal[i] = length > 0.0 ? w->normal[i] / length : 0.0;
        }
    }
}

static void finish(anywhere_law *law, int32_t t, const pal_contact_tool *in,
                   pal_contact_wrench *w) {
    anywhere_tool *tool = &law->tool[t];
    double back[3];
    w->fault |= law->fault[t];
    w->proxy = tool->free;
    tool->has_before = in->present;
    tool->last = tool->free;
    memcpy(tool->force, w->force, sizeof tool->force);
    for (int i = 0; i < 3; i++) {
        back[i] = tool->yield * w->force[i];
        tool->proxy[i] = w->proxy.position[i] = tool->free.position[i] - back[i];
    }
    for (int32_t k = 0; k < tool->stations && w->count > 0; k++) {
        const anywhere_station *s = &tool->station[k];
        double depth = s->engaged ? s->depth + v3_dot(back, s->at.normal) : 0.0;
        w->depth = depth > w->depth ? depth : w->depth;
    }
}

static void anywhere_solve(void *self, const pal_contact_tool tools[], pal_contact_result *result) {
    anywhere_law *law = self;
    pal_stages *stages = result->stages;
    *result = (pal_contact_result){0};
    memset(law->fault, 0, sizeof law->fault);
    law->points = law->dropped = 0;
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        anywhere_tool *tool = &law->tool[t];
        if (tools[t].present) {
            place(law, t, &tools[t].pose);
            tool->held_count = tools[t].closed ? tool->held_count : 0;
            int32_t before = law->points;
            pal_anywhere_touch(law, t);
            pal_anywhere_hold(law, t);
            if (tool->inside && law->points == before) {
                law->fault[t] |= PALPATE_FAULT_UNFELT;
            }
        } else {
            tool->held_count = 0;
            for (int32_t k = 0; k < tool->stations; k++) {
                anywhere_station *s = &tool->station[k];
                s->known = s->engaged = s->laid = 0;
            }
        }
    }
    pal_anywhere_gather(law);
    pal_stages_end(stages, PALPATE_STAGE_CONTACT);
    pal_anywhere_assemble(law);
    result->iterations = pal_anywhere_solve(law);
    result->dof_count = pal_anywhere_distribute(law);
    result->dof = law->dof;
    result->force = law->force;
    result->dropped = law->dropped;
    summarise(law, result);

    for (int32_t t = 0; t < law->def.tool_count; t++) {
        finish(law, t, &tools[t], &result->tool[t]);
        int closed = tools[t].present && tools[t].closed;
        if (closed && !law->tool[t].closed) {
            pal_anywhere_grasp(law, t, &result->tool[t].proxy);
        }
        law->tool[t].closed = closed;
    }
    if (law->frictional) {
        pal_anywhere_remember(law);
    }
}

static void fetch(const void *memory, size_t bytes) {
    const char *at = memory;
    for (size_t k = 0; k < bytes; k += PALPATE_BLOCK_LINE) {
        __builtin_prefetch(at + k);
    }
}

/// The compliance of the nodes in use first: it is most, and the sweeps run through all of it.
static void anywhere_warm(const void *self) {
    const anywhere_law *law = self;
    const pal_working_set *set = &law->set;
    const pal_rest_surface *surface = &law->surface;
    size_t nodes = 3 * (size_t)set->count, points = (size_t)law->points, rows = (size_t)law->rows;
    for (size_t c = 0; c < nodes && points > 0; c++) {
        fetch(set->block + c * (size_t)set->stride, nodes * sizeof(double));
    }
    for (size_t r = 0; r < rows; r++) {
        fetch(law->y + r * (size_t)law->ld, nodes * sizeof(double));
    }
    fetch(law->m, rows * rows * sizeof(double));
    fetch(law->point, points * sizeof *law->point);
    for (int32_t s = 0; s < set->count && points > 0; s++) {
        size_t node = (size_t)law->model->column_node[set->column[s]];
        fetch(surface->position + 3 * node, 3 * sizeof(double));
        fetch(surface->node_normal + 3 * node, 3 * sizeof(double));
    }
    for (size_t p = 0; p < points; p++) {
        const pal_surface_point *place = &law->place[law->point[p].id];
        if (place->triangle >= 0) {
            pal_weights_fetch(&law->weights, place->triangle);
            fetch(surface->corner_normal + 9 * (size_t)place->triangle, 9 * sizeof(double));
            fetch(surface->bend + 9 * (size_t)place->triangle, 9 * sizeof(double));
        }
    }
}

const pal_contact_law pal_contact_anywhere = {
    .name = "surface",
    .check = anywhere_check,
    .bytes = anywhere_bytes,
    .init = anywhere_init,
    .solve = anywhere_solve,
    .reset = anywhere_reset,
    .warm = anywhere_warm,
};
