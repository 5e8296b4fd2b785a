/// @file contact.h  Contact: from tool poses to nodal forces on the compliance's columns (private).
///
/// A module of its own between the model and the tick. A contact law is a table of functions over a
/// block of memory: the engine sizes the block, hands the law the tools in the body frame once per
/// tick, and gets nodal forces on column degrees of freedom (for the field, Eq. 53) and one summary
/// per tool. The engine knows nothing else about contact, so another law (contact anywhere on the
/// surface, complementarity, friction) is another table.
///
/// Every function but `bytes` and `init` obeys the tick's contract: no allocation, lock, log or
/// system call, cost bounded by counts, same inputs and state give the same bits.
#ifndef PALPATE_HAPTIC_CONTACT_H
#define PALPATE_HAPTIC_CONTACT_H

#include <stddef.h>
#include <stdint.h>

#include "haptic/model/model.h"
#include "haptic/base/stages.h"
#include <palpate/engine.h>

/// What a law is made for.
typedef struct pal_contact_def {
    int32_t tool_count;
    const pal_tool_def *tools; ///< shape [tool_count]; must outlive the law
    int32_t max_contacts;      ///< contact points over all tools
    int32_t points;            ///< contact points of one tool, where the law spreads them
    double period;             ///< tick period [s]
} pal_contact_def;

/// A tool at one tick, in the body frame.
typedef struct pal_contact_tool {
    pal_pose pose;
    int closed;  ///< grasp button
    int present; ///< 0: no good pose was ever seen; the tool touches nothing
} pal_contact_tool;

/// Summary of one tool's contact, body frame. Forces here are those of the tool ON THE BODY.
typedef struct pal_contact_wrench {
    double force[3];    ///< [N]
    double torque[3];   ///< about the tool's origin [N m]
    double depth;       ///< deepest overlap with the rest surface [m]
    double centroid[3]; ///< force-weighted [m]
    double normal[3];   ///< mean outward unit normal; 0 without contact
    int32_t count;      ///< contact points
    uint32_t fault;     ///< PALPATE_FAULT_SINGULAR, _CONTACTS, _CUTOFF, _UNFELT
    pal_pose proxy;     ///< where the tool is drawn: its pose, or the proxy's
} pal_contact_wrench;

/// Result of one tick. Pointers stay valid until the next solve or reset.
typedef struct pal_contact_result {
    pal_contact_wrench tool[PALPATE_TOOLS_MAX];
    int32_t dof_count;   ///< a multiple of 3
    const int32_t *dof;  ///< column degrees of freedom with a force, shape [dof_count]
    const double *force; ///< nodal forces on the body [N], shape [dof_count]
    const double
        *displacement;  ///< prescribed there [m], shape [dof_count]; NULL if the law has none
    int32_t iterations; ///< solver passes of this tick
    int32_t dropped;    ///< contacts left out because of max_contacts
    /// Set by the caller before each solve, usually NULL: a law that clears the result keeps it and
    /// ends PALPATE_STAGE_CONTACT where geometry is done and the solver begins.
    pal_stages *stages;
} pal_contact_result;

typedef struct pal_contact_law {
    const char *name;
    /// PALPATE_OK, or _UNSUPPORTED / _ARGUMENT with a message naming the tool and the key.
    pal_status (*check)(const pal_model *model, const pal_contact_def *def, pal_error *error);
    /// Bytes of the law's block (a multiple of 64).
    size_t (*bytes)(const pal_model *model, const pal_contact_def *def);
    /// Prepare the block (64-byte aligned). @return self
    void *(*init)(void *memory, const pal_model *model, const pal_contact_def *def);
    /// One tick. @param[in] tools finite poses with unit quaternions, shape [tool_count]
    void (*solve)(void *self, const pal_contact_tool tools[], pal_contact_result *result);
    /// Forget contacts and forces.
    void (*reset)(void *self);
    /// Bring what the next tick will read back into the cache: the field's sweep over megabytes
    /// has put it out, and the next force should not wait for memory. Changes nothing. May be NULL.
    void (*warm)(const void *self);
} pal_contact_law;

/// Contact points anywhere on the surface, unilateral: contact_anywhere.c. The default.
extern const pal_contact_law pal_contact_anywhere;
/// Prescribed displacement of touched nodes (De, Hong, Bathe 2003, Eq. 52): contact.c.
extern const pal_contact_law pal_contact_nodes;

#endif
