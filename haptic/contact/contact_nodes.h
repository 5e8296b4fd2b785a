/// @file contact_nodes.h  Data and parts of the contact law "nodes" (private to contact*.c).
///
/// contact.c explains the law and holds its memory and summary; contact_reach.c finds which nodes a
/// tool can reach and in which direction it pushes; contact_settle.c finds which of them carry
/// force.
#ifndef PALPATE_HAPTIC_CONTACT_NODES_H
#define PALPATE_HAPTIC_CONTACT_NODES_H

#include <math.h>

#include "haptic/solver/active_set.h"
#include "haptic/contact/contact.h"
#include "haptic/contact/grid.h"
#include "haptic/contact/solid.h"
#include "haptic/base/vec.h"

/// A touchable node's contact state; counters belong to the tick in `stamp`.
typedef struct node_state {
    double offset[3]; ///< touched: tau [m]; held: position in the tool's frame [m]
    uint64_t stamp;
    int32_t listed; ///< index in the list of new contacts, -1
    int16_t owner;  ///< tool, -1: free
    int8_t held;
    int8_t let_go;  ///< times in this tick
    int8_t dropped; ///< left out in this tick
} node_state;

typedef struct tool_state {
    pal_solid solid;  ///< now
    pal_solid before; ///< last tick
    pal_pose pose, pose_before;
    double dir[3];      ///< d
    double depth;       ///< of the last tick [m]
    double travel;      ///< of the tool's surface since the last tick, at most [m]
    int32_t *candidate; ///< nodes that this tool may touch, shape [grid.count]
    int32_t candidates;
    int32_t *near; ///< those that may be inside it this tick, shape [grid.count]
    int32_t nears;
    double moved;   ///< largest |u| of its nodes in the last tick [m]
    int32_t pick;   ///< point tool: its node, -1
    int has_before; ///< a pose was seen before
    int engaged;    ///< pushes along d
    int outside;    ///< point tool: was outside the surface
    int barred;     ///< sphere, capsule: met the surface from inside and is not clear of it
    int closed;     ///< last tick's button
    int holding;    ///< held nodes
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
    int32_t *member;  ///< grid node of each entry of the set, shape [max_contacts]
    double *depth;    ///< u.d of each entry [m], shape [max_contacts]
    node_state *node; ///< shape [grid.count]
    choice *fresh;    ///< new contacts of a pass, shape [grid.count]
    choice *kept;     ///< the deepest, shape [max_contacts]
    uint64_t tick;
    double moved;            ///< largest |u| of a touched node in the last tick [m]
    pal_contact_result good; ///< last result that could be solved
    tool_state tool[PALPATE_TOOLS_MAX];
} nodes_law;

// ---- contact_reach.c ----------------------------------------------------------------------------

/// Candidates of tool t: nodes at rest in the box it may reach this tick.
void pal_nodes_gather(nodes_law *law, int32_t t);
/// d of an engaged tool from the rest normals around its axis. Nothing around: d stays.
void pal_nodes_turn(nodes_law *law, int32_t t);
/// Begin contact when tool t has come in from outside.
void pal_nodes_engage(nodes_law *law, int32_t t);
/// List the candidates of an engaged tool that may be inside it: those facing it whose line through
/// the rest position meets the tool, widened by how far a free node can have moved. Near a contact
/// the surface moves less than the contact does (half of it at most here); other tools count in
/// full.
void pal_nodes_narrow(nodes_law *law, int32_t t);
/// The node a point tool presses: nearest to its line, facing it, over its own patch.
void pal_nodes_pick(nodes_law *law, int32_t t);
/// Without contact a tool stays engaged only while its far side is below the nearest node's level
/// (a small tool between nodes); else it is outside and must come in anew.
void pal_nodes_disengage(nodes_law *law, int32_t t, const pal_contact_wrench *w);

// ---- contact_settle.c ---------------------------------------------------------------------------

/// Remove entry `index` of the set; its node is free.
void pal_nodes_let_go(nodes_law *law, int32_t index);
/// Button edges: hold what is touched at closing, let it be only pushed after opening.
void pal_nodes_grasp(nodes_law *law, const pal_contact_tool tools[]);
/// Prescribed displacement of entry k from its tool's pose. @return 0: the tool has left its line.
int pal_nodes_aim(nodes_law *law, int32_t k);
/// Solve, release and touch until nothing changes. @return fault bits for all tools.
uint32_t pal_nodes_settle(nodes_law *law, pal_contact_result *result);

// ---- Small helpers ------------------------------------------------------------------------------

static inline int is_point(const nodes_law *law, int32_t t) {
    return law->def.tools[t].shape == PALPATE_SHAPE_POINT;
}

static inline const double *rest_of(const nodes_law *law, int32_t a) {
    return law->grid.position + 3 * (size_t)a;
}

static inline const double *normal_of(const nodes_law *law, int32_t a) {
    return law->grid.normal + 3 * (size_t)a;
}

/// Deformed position and displacement of node a under the forces of the last solve.
static inline void deformed(nodes_law *law, int32_t a, double x[3], double u[3]) {
    pal_active_set_displacement(&law->set, law->grid.column[a], u);
    for (int i = 0; i < 3; i++) {
        x[i] = rest_of(law, a)[i] + u[i];
    }
}

/// The node's state with this tick's counters.
static inline node_state *state_of(nodes_law *law, int32_t a) {
    node_state *node = &law->node[a];
    if (node->stamp != law->tick) {
        node->stamp = law->tick;
        node->let_go = node->dropped = 0;
    }
    return node;
}

#endif
