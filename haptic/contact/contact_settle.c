/// @file contact_settle.c  Law "nodes": which touched nodes carry force.
///
/// Passes over one active set for all tools, bounded by a count: solve Eq. 52, let go of what is
/// pulled, touch what has come inside. contact.c explains the law.
#include "haptic/contact/contact_nodes.h"

#include <string.h>

#include "haptic/base/pose.h"

enum { PASSES = 12 };
static const double TOUCH = 1e-7; // of a node's reach: overlap that counts as touch

void pal_nodes_let_go(nodes_law *law, int32_t index) {
    node_state *node = state_of(law, law->member[index]);
    law->tool[node->owner].holding -= node->held;
    node->owner = -1;
    node->held = 0;
    int32_t behind = law->set.count - 1 - index;
    pal_active_set_remove(&law->set, index);
    memmove(law->member + index, law->member + index + 1, (size_t)behind * sizeof *law->member);
    memmove(law->depth + index, law->depth + index + 1, (size_t)behind * sizeof *law->depth);
}

/// Button edges: hold what is touched at closing, let it be pushed only after opening.
void pal_nodes_grasp(nodes_law *law, const pal_contact_tool tools[]) {
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        tool_state *tool = &law->tool[t];
        int closed = tools[t].closed != 0;
        for (int32_t k = 0; closed != tool->closed && k < law->set.count; k++) {
            int32_t a = law->member[k];
            node_state *node = &law->node[a];
            const double *u = law->set.u + 3 * (size_t)k;
            if (node->owner != t) {
                continue;
            }
            if (closed) {
                pal_pose inverse = pal_pose_inverse(&tool->pose_before);
                double x[3];
                for (int i = 0; i < 3; i++) {
                    x[i] = rest_of(law, a)[i] + u[i];
                }
                pal_pose_apply(&inverse, x, node->offset);
                node->held = 1;
                tool->holding++;
            } else if (node->held) {
                double s = v3_dot(u, tool->dir);
                for (int i = 0; i < 3; i++) {
                    node->offset[i] = u[i] - s * tool->dir[i];
                }
                node->held = 0;
                tool->holding--;
            }
        }
        tool->closed = closed;
    }
}

/// Prescribed displacement of entry k from its tool's pose. @return 0: the tool has left its line.
int pal_nodes_aim(nodes_law *law, int32_t k) {
    int32_t a = law->member[k];
    const node_state *node = &law->node[a];
    const tool_state *tool = &law->tool[node->owner];
    const double *x = rest_of(law, a);
    double *u = law->set.u + 3 * (size_t)k, y[3], near, far;
    if (node->held) {
        pal_pose_apply(&tool->pose, node->offset, y);
        for (int i = 0; i < 3; i++) {
            u[i] = y[i] - x[i];
        }
    } else {
        for (int i = 0; i < 3; i++) {
            y[i] = x[i] + node->offset[i];
        }
        if (!tool->engaged || !pal_solid_chord(&tool->solid, y, tool->dir, &near, &far)) {
            return 0;
        }
        for (int i = 0; i < 3; i++) {
            u[i] = node->offset[i] + far * tool->dir[i];
        }
    }
    law->depth[k] = v3_dot(u, tool->dir);
    return 1;
}

/// List the free nodes whose deformed position is inside a tool. @return how many.
static int32_t find_fresh(nodes_law *law) {
    int32_t count = 0;
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        tool_state *tool = &law->tool[t];
        for (int32_t k = 0; k < tool->nears; k++) {
            int32_t a = tool->near[k];
            node_state *node = state_of(law, a);
            if (node->owner >= 0 || node->dropped || node->let_go > 1) {
                continue;
            }
            double x[3], u[3], near, far;
            deformed(law, a, x, u);
            if (!pal_solid_chord(&tool->solid, x, tool->dir, &near, &far) ||
                !(far > TOUCH * law->grid.reach[a]) ||
                (!is_point(law, t) && !(near < tool->travel + tool->depth))) {
                continue;
            }
            double s = v3_dot(u, tool->dir);
            choice fresh = {.depth = far + s, .node = a, .tool = t};
            for (int i = 0; i < 3; i++) {
                fresh.offset[i] = u[i] - s * tool->dir[i];
            }
            if (node->listed < 0) {
                node->listed = count;
                law->fresh[count++] = fresh;
            } else if (fresh.depth > law->fresh[node->listed].depth) {
                law->fresh[node->listed] = fresh; // two tools: the deeper one has it
            }
        }
    }
    for (int32_t k = 0; k < count; k++) {
        law->node[law->fresh[k].node].listed = -1;
    }
    return count;
}

static int deeper(const choice *a, const choice *b) {
    if (a->depth != b->depth) {
        return a->depth > b->depth;
    }
    return a->tool != b->tool ? a->tool < b->tool : a->node < b->node;
}

/// Keep the max_contacts deepest of the set and the new ones. New ones that stay are moved to the
/// front of law->fresh. @return how many.
static int32_t keep_deepest(nodes_law *law, int32_t fresh, pal_contact_result *result) {
    int32_t room = law->def.max_contacts, kept = 0;
    for (int32_t k = 0; k < law->set.count + fresh; k++) { // insertion into a list of `room`
        choice c;
        if (k < law->set.count) {
            const node_state *node = &law->node[law->member[k]];
            c = (choice){.depth = node->held ? HUGE_VAL : law->depth[k],
                         .node = law->member[k],
                         .tool = node->owner};
        } else {
            c = law->fresh[k - law->set.count];
        }
        int32_t at = kept;
        while (at > 0 && deeper(&c, &law->kept[at - 1])) {
            at--;
        }
        if (at >= room) {
            continue;
        }
        kept += kept < room;
        memmove(law->kept + at + 1, law->kept + at, (size_t)(kept - 1 - at) * sizeof c);
        law->kept[at] = c;
    }
    for (int32_t k = 0; k < kept; k++) {
        law->node[law->kept[k].node].listed = k;
    }
    int32_t stay = 0;
    for (int32_t k = 0; k < fresh; k++) {
        choice c = law->fresh[k];
        if (law->node[c.node].listed >= 0) {
            law->fresh[stay++] = c;
        } else {
            law->node[c.node].dropped = 1;
            result->dropped++;
            result->tool[c.tool].fault |= PALPATE_FAULT_CONTACTS;
        }
    }
    for (int32_t k = law->set.count - 1; k >= 0; k--) {
        int32_t a = law->member[k], t = law->node[a].owner;
        if (law->node[a].listed < 0) {
            pal_nodes_let_go(law, k);
            state_of(law, a)->dropped = 1;
            result->dropped++;
            result->tool[t].fault |= PALPATE_FAULT_CONTACTS;
        }
    }
    for (int32_t k = 0; k < kept; k++) {
        law->node[law->kept[k].node].listed = -1;
    }
    return stay;
}

static void touch(nodes_law *law, const choice *c) {
    int32_t k = law->set.count;
    node_state *node = state_of(law, c->node);
    node->owner = (int16_t)c->tool;
    node->held = 0;
    memcpy(node->offset, c->offset, sizeof node->offset);
    law->member[k] = c->node;
    pal_active_set_append(&law->set, law->grid.column[c->node]);
    if (!pal_nodes_aim(law, k)) { // grazing after rounding: not a contact
        pal_nodes_let_go(law, k);
        node->let_go = 2;
    }
}

/// Let go of every node that is pulled. @return how many.
static int32_t release_pulled(nodes_law *law) {
    int32_t count = 0;
    for (int32_t k = law->set.count - 1; k >= 0; k--) {
        node_state *node = state_of(law, law->member[k]);
        const double *f = law->set.f + 3 * (size_t)k;
        if (!node->held && v3_dot(f, law->tool[node->owner].dir) < 0.0) {
            pal_nodes_let_go(law, k);
            node->let_go++;
            count++;
        }
    }
    return count;
}

/// Let go of every node in front of its tool: without forces that is all that tells that the tool
/// has left. @return how many.
static int32_t release_in_front(nodes_law *law) {
    int32_t count = 0;
    for (int32_t k = law->set.count - 1; k >= 0; k--) {
        if (!law->node[law->member[k]].held && law->depth[k] < 0.0) {
            pal_nodes_let_go(law, k);
            count++;
        }
    }
    return count;
}

static int any_pulled(const nodes_law *law) {
    for (int32_t k = 0; k < law->set.count; k++) {
        const node_state *node = &law->node[law->member[k]];
        if (!node->held && v3_dot(law->set.f + 3 * (size_t)k, law->tool[node->owner].dir) < 0.0) {
            return 1;
        }
    }
    return 0;
}

/// Solve, release and touch until nothing changes. @return fault bits for all tools.
uint32_t pal_nodes_settle(nodes_law *law, pal_contact_result *result) {
    for (int pass = 1;; pass++) {
        result->iterations = pass;
        int last = pass == PASSES;
        if (pal_active_set_solve(&law->set) != 0) {
            if (last || release_in_front(law) == 0) {
                return PALPATE_FAULT_SINGULAR;
            }
            continue;
        }
        if (last ? any_pulled(law) : release_pulled(law) > 0) {
            if (last) {
                return PALPATE_FAULT_CUTOFF;
            }
            continue;
        }
        int32_t fresh = find_fresh(law), before = law->set.count;
        if (fresh == 0) {
            return 0;
        }
        if (last) {
            return PALPATE_FAULT_CUTOFF;
        }
        if (before + fresh > law->def.max_contacts) {
            fresh = keep_deepest(law, fresh, result);
        }
        for (int32_t k = 0; k < fresh; k++) {
            touch(law, &law->fresh[k]);
        }
        if (fresh == 0 && law->set.count == before) {
            return 0;
        }
    }
}
