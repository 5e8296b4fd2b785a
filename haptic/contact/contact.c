/// @file contact.c  Contact law "nodes": prescribed displacement of touched nodes.
///
/// De, Hong, Bathe 2003, section 4, Eq. 52: nodes that the tool touches move to its surface, and
/// their reactions follow from  f_a = C_aa^-1 u_a  over all tools together.
///
/// Direction. A tool in contact pushes along d (unit): minus the mean outward normal of the rest
/// surface around the tool's axis, weighted smoothly (squared chord of the node's line through the
/// tool). d is carried from tick to tick, so a tool pressed past the middle of a thin organ still
/// pushes the side it came from; only nodes that face the tool (normal.d < 0) are its own.
///
/// Target. A node touched where it lay at y = X + tau (tau: its displacement across d at first
/// touch, caused by its neighbours) is moved along d to the far side of the tool:
///     u_a = tau + s d,    s = far end of the chord of the line y + s d through the solid.
/// u_a starts where the free node was, so neither touch nor tool motion makes it jump, and a sphere
/// deeper than its radius still pushes forward. A point tool takes the one node nearest to its line
/// (s level with the tip); changing node needs to be a tenth nearer, so it cannot flicker.
///
/// Unilateral. In passes bounded by PASSES: solve; let go of all nodes that are pulled (f_a.d < 0);
/// else touch all nodes whose deformed position X + C f is inside a tool; else done. A node let go
/// twice in a tick stays free until the next. More than max_contacts: the deepest stay (ties: lower
/// tool, then lower node). Grasp: while the button is closed the nodes touched at closing are held
/// where they were on the tool, pulled or not.
///
/// The tool comes from outside: contact begins only with nodes whose outside the tool was on.
#include "haptic/contact/contact.h"

#include <string.h>

#include "haptic/base/block.h"
#include "haptic/contact/contact_nodes.h"
#include "haptic/base/error.h"

// ---- Memory -------------------------------------------------------------------------------------

static pal_status nodes_check(const pal_model *model, const pal_contact_def *def,
                              pal_error *error) {
    (void)model;
    for (int32_t t = 0; t < def->tool_count; t++) {
        const pal_tool_def *tool = &def->tools[t];
        if (tool->friction > 0.0) {
            return pal_fail(error, PALPATE_ERROR_UNSUPPORTED,
                            "tools[%d].friction: %g: the contact law \"nodes\" has no friction; "
                            "use contact: {law: surface} or 0",
                            (int)t, tool->friction);
        }
        if (tool->coupling_stiffness > 0.0) {
            return pal_fail(error, PALPATE_ERROR_UNSUPPORTED,
                            "tools[%d].coupling: %g N/m: the contact law \"nodes\" has no virtual "
                            "coupling; use contact: {law: surface} or leave it out",
                            (int)t, tool->coupling_stiffness);
        }
    }
    return PALPATE_OK;
}

static size_t grid_count(const pal_model *model) {
    return (size_t)model->info.column_count; // touchable nodes are columns
}

static size_t nodes_bytes(const pal_model *model, const pal_contact_def *def) {
    size_t n = grid_count(model), m = (size_t)def->max_contacts;
    return pal_block_padded(sizeof(nodes_law)) + pal_grid_bytes(model) +
           pal_active_set_bytes(model, def->max_contacts) + pal_block_padded(m * sizeof(int32_t)) +
           pal_block_padded(m * sizeof(double)) + pal_block_padded(n * sizeof(node_state)) +
           pal_block_padded(n * sizeof(choice)) + pal_block_padded(m * sizeof(choice)) +
           2 * (size_t)def->tool_count * pal_block_padded(n * sizeof(int32_t));
}

static void nodes_reset(void *self) {
    nodes_law *law = self;
    pal_active_set_clear(&law->set);
    law->tick = 0;
    law->moved = 0.0;
    law->good = (pal_contact_result){0};
    for (int32_t a = 0; a < law->grid.count; a++) {
        law->node[a] = (node_state){.owner = -1, .listed = -1};
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        int32_t *candidate = law->tool[t].candidate, *near = law->tool[t].near;
        law->tool[t] = (tool_state){.candidate = candidate, .near = near, .pick = -1};
    }
}

static void *nodes_init(void *memory, const pal_model *model, const pal_contact_def *def) {
    size_t n = grid_count(model), m = (size_t)def->max_contacts;
    unsigned char *at = memory;
    memset(memory, 0, nodes_bytes(model, def));
    nodes_law *law = pal_block_take(&at, sizeof *law);
    law->def = *def;
    pal_grid_init(&law->grid, model, pal_block_take(&at, pal_grid_bytes(model)));
    pal_active_set_init(&law->set, model, def->max_contacts,
                        pal_block_take(&at, pal_active_set_bytes(model, def->max_contacts)));
    law->member = pal_block_take(&at, m * sizeof(int32_t));
    law->depth = pal_block_take(&at, m * sizeof(double));
    law->node = pal_block_take(&at, n * sizeof(node_state));
    law->fresh = pal_block_take(&at, n * sizeof(choice));
    law->kept = pal_block_take(&at, m * sizeof(choice));
    for (int32_t t = 0; t < def->tool_count; t++) {
        law->tool[t].candidate = pal_block_take(&at, n * sizeof(int32_t));
        law->tool[t].near = pal_block_take(&at, n * sizeof(int32_t));
    }
    nodes_reset(law);
    return law;
}

// ---- Summary ------------------------------------------------------------------------------------

static void summarise(nodes_law *law, pal_contact_result *result) {
    double weight[PALPATE_TOOLS_MAX] = {0.0};
    law->moved = 0.0;
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        law->tool[t].moved = 0.0;
    }
    for (int32_t k = 0; k < law->set.count; k++) {
        int32_t t = law->node[law->member[k]].owner;
        tool_state *tool = &law->tool[t];
        pal_contact_wrench *w = &result->tool[t];
        const double *f = law->set.f + 3 * (size_t)k, *u = law->set.u + 3 * (size_t)k;
        double x[3], arm[3], push = fmax(0.0, v3_dot(f, tool->dir));
        for (int i = 0; i < 3; i++) {
            x[i] = rest_of(law, law->member[k])[i] + u[i];
            arm[i] = x[i] - tool->pose.position[i];
            w->force[i] += f[i];
            w->centroid[i] += push * x[i];
        }
        weight[t] += push;
        w->torque[0] += arm[1] * f[2] - arm[2] * f[1];
        w->torque[1] += arm[2] * f[0] - arm[0] * f[2];
        w->torque[2] += arm[0] * f[1] - arm[1] * f[0];
        w->depth = fmax(w->depth, law->depth[k]);
        w->count++;
        tool->moved = fmax(tool->moved, sqrt(v3_dot(u, u)));
        law->moved = fmax(law->moved, tool->moved);
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        pal_contact_wrench *w = &result->tool[t];
        for (int i = 0; i < 3 && w->count > 0; i++) {
            w->centroid[i] =
                weight[t] > 0.0 ? w->centroid[i] / weight[t] : law->tool[t].solid.center[i];
            w->normal[i] = -law->tool[t].dir[i];
        }
    }
}

static void nodes_solve(void *self, const pal_contact_tool tools[], pal_contact_result *result) {
    nodes_law *law = self;
    pal_stages *stages = result->stages;
    law->tick++;
    *result = (pal_contact_result){0};
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        tool_state *tool = &law->tool[t];
        if (!tools[t].present) {
            tool->candidates = tool->nears = 0;
            tool->engaged = tool->has_before = 0;
            continue;
        }
        tool->pose = tools[t].pose;
        tool->solid = pal_solid_place(&law->def.tools[t], &tools[t].pose);
        if (!tool->has_before) {
            tool->before = tool->solid;
            tool->pose_before = tool->pose;
        }
        double step[3], swing[3];
        for (int i = 0; i < 3; i++) {
            step[i] = tool->solid.center[i] - tool->before.center[i];
            swing[i] = tool->solid.axis[i] - tool->before.axis[i];
        }
        tool->travel = sqrt(v3_dot(step, step)) + tool->solid.half * sqrt(v3_dot(swing, swing));
        pal_nodes_gather(law, t);
        if (tool->engaged) {
            pal_nodes_turn(law, t);
        } else {
            pal_nodes_engage(law, t);
        }
        if (tool->engaged && is_point(law, t)) {
            pal_nodes_pick(law, t);
        }
    }
    pal_nodes_grasp(law, tools);
    for (int32_t k = law->set.count - 1; k >= 0; k--) {
        const node_state *node = &law->node[law->member[k]];
        int32_t t = node->owner;
        int moved_on = is_point(law, t) && !node->held && law->tool[t].pick != law->member[k];
        if (moved_on || !pal_nodes_aim(law, k)) {
            pal_nodes_let_go(law, k);
        }
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        pal_nodes_narrow(law, t);
    }
    pal_stages_end(stages, PALPATE_STAGE_CONTACT);
    uint32_t fault = pal_nodes_settle(law, result);
    if (fault & PALPATE_FAULT_SINGULAR) {
        *result = law->good;
    } else {
        result->dof_count = law->set.solved;
        result->dof = law->set.dof;
        result->force = law->set.f;
        result->displacement = law->set.u;
        summarise(law, result);
        law->good = *result;
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        tool_state *tool = &law->tool[t];
        result->tool[t].fault |= fault;
        result->tool[t].proxy = tool->pose;
        pal_nodes_disengage(law, t, &result->tool[t]);
        tool->before = tool->solid;
        tool->pose_before = tool->pose;
        tool->has_before = tools[t].present;
    }
}

const pal_contact_law pal_contact_nodes = {
    .name = "nodes",
    .check = nodes_check,
    .bytes = nodes_bytes,
    .init = nodes_init,
    .solve = nodes_solve,
    .reset = nodes_reset,
};
