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
/// Target. A node touched where it lay at y = X + tau (tau: its displacement across d at first touch,
/// caused by its neighbours) is moved along d to the far side of the tool:
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
#include "haptic/contact.h"

#include <math.h>
#include <string.h>

#include "haptic/active_set.h"
#include "haptic/error.h"
#include "haptic/grid.h"
#include "haptic/pose.h"
#include "haptic/solid.h"

enum { PASSES = 12, LINE = 64, SUBSTEPS = 4, FIRST_TURNS = 4 };
static const double TOUCH = 1e-7;         // of a node's reach: overlap that counts as touch
static const double POINT_CHANGE = 0.9;   // a point tool's new node must be this much nearer
static const double MARGIN_NORMAL = 1.5;  // of the largest reach: radius normals are averaged over

/// A touchable node's contact state; counters belong to the tick in `stamp`.
typedef struct node_state {
    double offset[3]; ///< touched: tau [m]; held: position in the tool's frame [m]
    uint64_t stamp;
    int32_t listed;   ///< index in the list of new contacts, -1
    int8_t owner;     ///< tool, -1: free
    int8_t held;
    int8_t let_go;    ///< times in this tick
    int8_t dropped;   ///< left out in this tick
} node_state;

typedef struct tool_state {
    pal_solid solid;      ///< now
    pal_solid before;     ///< last tick
    pal_pose pose, pose_before;
    double dir[3];        ///< d
    double depth;         ///< of the last tick [m]
    double travel;        ///< of the tool's surface since the last tick, at most [m]
    int32_t *candidate;   ///< nodes that this tool may touch, shape [grid.count]
    int32_t candidates;
    int32_t pick;         ///< point tool: its node, -1
    int has_before;       ///< a pose was seen before
    int engaged;          ///< pushes along d
    int outside;          ///< point tool: was outside the surface
    int closed;           ///< last tick's button
    int holding;          ///< held nodes
} tool_state;

/// A node about to be touched, or one in the set, for the choice of the deepest.
typedef struct choice {
    double depth;
    double offset[3];
    int32_t node, tool;
} choice;

typedef struct nodes_law {
    pal_contact_def def;
    pal_grid grid;
    pal_active_set set;
    int32_t *member;   ///< grid node of each entry of the set, shape [max_contacts]
    double *depth;     ///< u.d of each entry [m], shape [max_contacts]
    node_state *node;  ///< shape [grid.count]
    choice *fresh;     ///< new contacts of a pass, shape [grid.count]
    choice *kept;      ///< the deepest, shape [max_contacts]
    uint64_t tick;
    double lateral;    ///< largest |u| of a touched node in the last tick [m]
    pal_contact_result good; ///< last result that could be solved
    tool_state tool[PALPATE_TOOLS_MAX];
} nodes_law;

// ---- Memory -------------------------------------------------------------------------------------

static size_t padded(size_t bytes) {
    return (bytes + LINE - 1) / LINE * LINE;
}

static void *take(unsigned char **at, size_t bytes) {
    void *here = *at;
    *at += padded(bytes);
    return here;
}

static pal_status nodes_check(const pal_model *model, const pal_contact_def *def,
                              pal_error *error) {
    (void)model;
    for (int32_t t = 0; t < def->tool_count; t++) {
        const pal_tool_def *tool = &def->tools[t];
        if (tool->friction > 0.0) {
            return pal_fail(error, PALPATE_ERROR_UNSUPPORTED,
                            "tools[%d].friction: %g: friction is not built yet; use 0", (int)t,
                            tool->friction);
        }
        if (tool->coupling_stiffness > 0.0) {
            return pal_fail(error, PALPATE_ERROR_UNSUPPORTED,
                            "tools[%d].coupling: %g N/m: virtual coupling is not built yet; leave "
                            "it out",
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
    return padded(sizeof(nodes_law)) + pal_grid_bytes(model) +
           pal_active_set_bytes(def->max_contacts) + padded(m * sizeof(int32_t)) +
           padded(m * sizeof(double)) + padded(n * sizeof(node_state)) +
           padded(n * sizeof(choice)) + padded(m * sizeof(choice)) +
           (size_t)def->tool_count * padded(n * sizeof(int32_t));
}

static void nodes_reset(void *self) {
    nodes_law *law = self;
    pal_active_set_clear(&law->set);
    law->tick = 0;
    law->lateral = 0.0;
    law->good = (pal_contact_result){0};
    for (int32_t a = 0; a < law->grid.count; a++) {
        law->node[a] = (node_state){.owner = -1, .listed = -1};
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        int32_t *candidate = law->tool[t].candidate;
        law->tool[t] = (tool_state){.candidate = candidate, .pick = -1};
    }
}

static void *nodes_init(void *memory, const pal_model *model, const pal_contact_def *def) {
    size_t n = grid_count(model), m = (size_t)def->max_contacts;
    unsigned char *at = memory;
    memset(memory, 0, nodes_bytes(model, def));
    nodes_law *law = take(&at, sizeof *law);
    law->def = *def;
    pal_grid_init(&law->grid, model, take(&at, pal_grid_bytes(model)));
    pal_active_set_init(&law->set, model, def->max_contacts,
                        take(&at, pal_active_set_bytes(def->max_contacts)));
    law->member = take(&at, m * sizeof(int32_t));
    law->depth = take(&at, m * sizeof(double));
    law->node = take(&at, n * sizeof(node_state));
    law->fresh = take(&at, n * sizeof(choice));
    law->kept = take(&at, m * sizeof(choice));
    for (int32_t t = 0; t < def->tool_count; t++) {
        law->tool[t].candidate = take(&at, n * sizeof(int32_t));
    }
    nodes_reset(law);
    return law;
}

// ---- Small helpers ------------------------------------------------------------------------------

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static int is_point(const nodes_law *law, int32_t t) {
    return law->def.tools[t].shape == PALPATE_SHAPE_POINT;
}

static const double *rest_of(const nodes_law *law, int32_t a) {
    return law->grid.position + 3 * (size_t)a;
}

static const double *normal_of(const nodes_law *law, int32_t a) {
    return law->grid.normal + 3 * (size_t)a;
}

/// Deformed position and displacement of node a under the forces of the last solve.
static void deformed(const nodes_law *law, int32_t a, double x[3], double u[3]) {
    pal_active_set_displacement(&law->set, law->grid.column[a], u);
    for (int i = 0; i < 3; i++) {
        x[i] = rest_of(law, a)[i] + u[i];
    }
}

/// The node's state with this tick's counters.
static node_state *state_of(nodes_law *law, int32_t a) {
    node_state *node = &law->node[a];
    if (node->stamp != law->tick) {
        node->stamp = law->tick;
        node->let_go = node->dropped = 0;
    }
    return node;
}

/// Squared distance of x from the line through the tip along d.
static double off_line(const pal_solid *solid, const double d[3], const double x[3]) {
    double p[3] = {x[0] - solid->center[0], x[1] - solid->center[1], x[2] - solid->center[2]};
    double b = dot(p, d);
    return fmax(0.0, dot(p, p) - b * b);
}

static double normal_radius(const nodes_law *law, const pal_solid *solid) {
    return fmax(solid->radius, MARGIN_NORMAL * law->grid.reach_max);
}

// ---- Candidates, engagement, direction ----------------------------------------------------------

static void gather(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    double low[3], high[3];
    pal_solid_box(&tool->solid, low, high);
    double wide = normal_radius(law, &tool->solid);
    double margin = tool->travel + law->lateral + law->grid.reach_max;
    if (tool->engaged) {
        margin += 1.5 * wide - tool->solid.radius + law->grid.reach_max;
    }
    for (int i = 0; i < 3; i++) {
        double back = tool->engaged ? -tool->dir[i] * (tool->depth + tool->travel) : 0.0;
        low[i] += fmin(back, 0.0) - margin;
        high[i] += fmax(back, 0.0) + margin;
    }
    tool->candidates = pal_grid_query(&law->grid, low, high, tool->candidate);
}

/// d from the rest normals around the tool's axis. Nothing around: d stays.
static void turn(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    pal_solid wide = tool->solid;
    wide.radius = normal_radius(law, &tool->solid);
    double more = wide.radius - tool->solid.radius, sum[3] = {0.0, 0.0, 0.0};
    for (int32_t k = 0; k < tool->candidates; k++) {
        const double *x = rest_of(law, tool->candidate[k]);
        const double *n = normal_of(law, tool->candidate[k]);
        double near, far;
        if (dot(n, tool->dir) < 0.0 && pal_solid_chord(&wide, x, tool->dir, &near, &far)) {
            double level = 1.0 + (far - more) / (0.5 * wide.radius);
            double weight = (far - near) * (far - near) * fmax(0.0, fmin(1.0, level));
            for (int i = 0; i < 3; i++) {
                sum[i] -= weight * n[i];
            }
        }
    }
    double length = sqrt(dot(sum, sum));
    if (!(length > 0.0) || !(dot(sum, tool->dir) > 0.0)) {
        return;
    }
    double d[3]; // halfway: a fixed point reached without swinging
    for (int i = 0; i < 3; i++) {
        d[i] = tool->dir[i] + sum[i] / length;
    }
    length = sqrt(dot(d, d));
    for (int i = 0; i < 3; i++) {
        tool->dir[i] = d[i] / length;
    }
}

/// Nearest candidate to the tip in the deformed configuration; -1: none.
static int32_t nearest(const nodes_law *law, const tool_state *tool, double x[3]) {
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

/// Node by which a point tool enters, -1: none. The tip is below the plane of its nearest node, over
/// that node's own patch, and was outside before (or starts just below).
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
    double height = dot(p, n), reach = law->grid.reach[a];
    if (height >= 0.0) {
        tool->outside = 1;
        return -1;
    }
    double across = dot(p, p) - height * height;
    int was_outside = tool->has_before ? tool->outside : -height <= reach;
    tool->outside = 0;
    return was_outside && across <= reach * reach ? a : -1;
}

/// Node by which a sphere or capsule enters, -1: none. The deepest node inside the tool now or on its
/// way since the last tick, among those whose outside the tool was on.
static int32_t enter_solid(const nodes_law *law, const tool_state *tool) {
    int32_t best = -1;
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
        if (!(distance < least)) {
            continue;
        }
        // from the nearest point of the tool's axis one tick ago
        double p[3] = {x[0] - tool->before.center[0], x[1] - tool->before.center[1],
                       x[2] - tool->before.center[2]};
        double along = fmax(-tool->before.half,
                            fmin(tool->before.half, dot(p, tool->before.axis)));
        for (int i = 0; i < 3; i++) {
            p[i] = along * tool->before.axis[i] - p[i];
        }
        if (dot(p, normal_of(law, a)) >= 0.0) {
            least = distance;
            best = a;
        }
    }
    return best;
}

static void engage(nodes_law *law, int32_t t) {
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
    gather(law, t);
    for (int k = 0; k < FIRST_TURNS; k++) {
        turn(law, t);
    }
}

// ---- The set ------------------------------------------------------------------------------------

static void let_go(nodes_law *law, int32_t index) {
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
static void grasp(nodes_law *law, const pal_contact_tool tools[]) {
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
                double s = dot(u, tool->dir);
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
static int aim(nodes_law *law, int32_t k) {
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
    law->depth[k] = dot(u, tool->dir);
    return 1;
}

/// The node a point tool presses: nearest to its line, facing it, over its own patch.
static void pick_node(nodes_law *law, int32_t t) {
    tool_state *tool = &law->tool[t];
    int32_t now = tool->pick, best = -1;
    double least = HUGE_VAL;
    for (int32_t k = 0; k < tool->candidates; k++) {
        int32_t a = tool->candidate[k];
        double off = off_line(&tool->solid, tool->dir, rest_of(law, a));
        double reach = law->grid.reach[a];
        if (!(dot(normal_of(law, a), tool->dir) < 0.0) || off > reach * reach) {
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

/// List the free nodes whose deformed position is inside a tool. @return how many.
static int32_t find_fresh(nodes_law *law) {
    int32_t count = 0;
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        tool_state *tool = &law->tool[t];
        if (!tool->engaged || tool->holding > 0) {
            continue;
        }
        for (int32_t k = 0; k < tool->candidates; k++) {
            int32_t a = tool->candidate[k];
            node_state *node = state_of(law, a);
            if (node->owner >= 0 || node->dropped || node->let_go > 1 ||
                (is_point(law, t) && a != tool->pick) ||
                !(dot(normal_of(law, a), tool->dir) < 0.0)) {
                continue;
            }
            double x[3], u[3], near, far;
            deformed(law, a, x, u);
            if (!pal_solid_chord(&tool->solid, x, tool->dir, &near, &far) ||
                !(far > TOUCH * law->grid.reach[a]) ||
                (!is_point(law, t) && !(near < tool->travel + tool->depth))) {
                continue;
            }
            double s = dot(u, tool->dir);
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
            let_go(law, k);
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
    node->owner = (int8_t)c->tool;
    node->held = 0;
    memcpy(node->offset, c->offset, sizeof node->offset);
    law->member[k] = c->node;
    pal_active_set_append(&law->set, law->grid.column[c->node]);
    if (!aim(law, k)) { // grazing after rounding: not a contact
        let_go(law, k);
        node->let_go = 2;
    }
}

/// Let go of every node that is pulled. @return how many.
static int32_t release_pulled(nodes_law *law) {
    int32_t count = 0;
    for (int32_t k = law->set.count - 1; k >= 0; k--) {
        node_state *node = state_of(law, law->member[k]);
        const double *f = law->set.f + 3 * (size_t)k;
        if (!node->held && dot(f, law->tool[node->owner].dir) < 0.0) {
            let_go(law, k);
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
            let_go(law, k);
            count++;
        }
    }
    return count;
}

static int any_pulled(const nodes_law *law) {
    for (int32_t k = 0; k < law->set.count; k++) {
        const node_state *node = &law->node[law->member[k]];
        if (!node->held &&
            dot(law->set.f + 3 * (size_t)k, law->tool[node->owner].dir) < 0.0) {
            return 1;
        }
    }
    return 0;
}

/// Solve, release and touch until nothing changes. @return fault bits for all tools.
static uint32_t settle(nodes_law *law, pal_contact_result *result) {
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

// ---- Summary ------------------------------------------------------------------------------------

static void summarise(nodes_law *law, pal_contact_result *result) {
    double weight[PALPATE_TOOLS_MAX] = {0.0};
    law->lateral = 0.0;
    for (int32_t k = 0; k < law->set.count; k++) {
        int32_t t = law->node[law->member[k]].owner;
        const tool_state *tool = &law->tool[t];
        pal_contact_wrench *w = &result->tool[t];
        const double *f = law->set.f + 3 * (size_t)k, *u = law->set.u + 3 * (size_t)k;
        double x[3], arm[3], push = fmax(0.0, dot(f, tool->dir));
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
        law->lateral = fmax(law->lateral, sqrt(dot(u, u)));
    }
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        pal_contact_wrench *w = &result->tool[t];
        for (int i = 0; i < 3 && w->count > 0; i++) {
            w->centroid[i] = weight[t] > 0.0 ? w->centroid[i] / weight[t]
                                             : law->tool[t].solid.center[i];
            w->normal[i] = -law->tool[t].dir[i];
        }
    }
}

/// Without contact a tool stays engaged only while its far side is below the nearest node's level
/// (a small tool between nodes); else it is outside and must come in anew.
static void disengage(nodes_law *law, int32_t t, const pal_contact_wrench *w) {
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
        if (dot(normal_of(law, a), tool->dir) < 0.0 && off < least) {
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
        below = dot(p, tool->dir) + tool->solid.radius +
                tool->solid.half * fabs(dot(tool->solid.axis, tool->dir));
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

static void nodes_solve(void *self, const pal_contact_tool tools[], pal_contact_result *result) {
    nodes_law *law = self;
    law->tick++;
    *result = (pal_contact_result){0};
    for (int32_t t = 0; t < law->def.tool_count; t++) {
        tool_state *tool = &law->tool[t];
        if (!tools[t].present) {
            tool->candidates = 0;
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
        tool->travel = sqrt(dot(step, step)) + tool->solid.half * sqrt(dot(swing, swing));
        gather(law, t);
        if (tool->engaged) {
            turn(law, t);
        } else {
            engage(law, t);
        }
        if (tool->engaged && is_point(law, t)) {
            pick_node(law, t);
        }
    }
    grasp(law, tools);
    for (int32_t k = law->set.count - 1; k >= 0; k--) {
        const node_state *node = &law->node[law->member[k]];
        int32_t t = node->owner;
        int moved_on = is_point(law, t) && !node->held && law->tool[t].pick != law->member[k];
        if (moved_on || !aim(law, k)) {
            let_go(law, k);
        }
    }
    uint32_t fault = settle(law, result);
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
        disengage(law, t, &result->tool[t]);
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
