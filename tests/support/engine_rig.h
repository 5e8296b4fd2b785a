/// @file engine_rig.h  An engine on a synthetic half space, and independent answers to check it by.
#ifndef PALPATE_TESTS_ENGINE_RIG_H
#define PALPATE_TESTS_ENGINE_RIG_H

#include "haptic/engine/engine.h"
#include "tests/support/synthetic_model.h"

typedef struct rig {
    pal_model *model;
    pal_tool_def tools[PALPATE_TOOLS_MAX];
    pal_engine_def def;
    pal_engine *engine;
} rig;

/// Contact law that rig_model puts into r->def: the nodal one unless a test's setup says otherwise.
extern pal_contact_kind rig_law;
/// cmocka setup: rig_law = PALPATE_CONTACT_SURFACE; teardown: PALPATE_CONTACT_NODES.
int rig_surface_law(void **state);
int rig_nodes_law(void **state);

/// n x n touchable nodes 2 mm apart, a node at the origin when n is odd; one sphere tool, radius 4
/// mm. Aborts the test when out of memory.
void rig_model(rig *r, int32_t n, pal_precision precision, double skew);
/// Create the engine from r->def and r->tools (asserts success).
void rig_engine(rig *r);
void rig_free(rig *r);

/// A tool state at x with the identity orientation and no button.
pal_tool_state rig_state(double x, double y, double z);
/// One tick of one tool at x, y, z.
pal_tool_force rig_tick(rig *r, double x, double y, double z);
/// `steps` ticks from (x, y, z0) to (x, y, z1); the last tick's answer.
pal_tool_force rig_press(rig *r, double x, double y, double z0, double z1, int steps);

/// Eq. 52 by LAPACK for the touched nodes of the last tick: f = C_aa^-1 u_a, shape [dof_count].
/// The caller frees it.
double *rig_lapack(const rig *r);

#endif
