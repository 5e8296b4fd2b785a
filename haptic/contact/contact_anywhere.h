/// @file contact_anywhere.h  Data and parts of the contact law "surface" (private to contact_*.c).
///
/// contact_anywhere.c explains the law and holds its memory and its tick; contact_touch.c finds
/// where tools overlap the rest surface and spreads contact points there; contact_system.c builds
/// the compliance between the points and solves it; contact_grasp.c holds points to a closed tool;
/// contact_friction.c keeps what friction needs to know of the last tick.
#ifndef PALPATE_HAPTIC_CONTACT_ANYWHERE_H
#define PALPATE_HAPTIC_CONTACT_ANYWHERE_H

#include <math.h>

#include "haptic/contact/contact.h"
#include "haptic/contact/contact_pattern.h"
#include "haptic/contact/contact_surface.h"
#include "haptic/contact/contact_weights.h"
#include "haptic/solver/friction.h"
#include "haptic/contact/solid.h"
#include "haptic/contact/working_set.h"
#include "haptic/base/vec.h"

enum { PALPATE_STATIONS_MAX = 18, PALPATE_POINTS_MAX = 64 };

/// A ball of the tool: its own contact with the surface, and the pattern of points under it. A
/// sphere or point is one station, a capsule a row of them along its axis.
typedef struct anywhere_station {
    double along;   ///< place on the tool's axis [m], tip end negative
    double length;  ///< of the shaft it stands for [m]; 0: a ball of its own
    int32_t first;  ///< identity of its first point
    int32_t points; ///< size of its pattern
    // ---- state
    pal_surface_point at; ///< below it in the last tick; triangle -1: unknown
    double across[3];     ///< first direction of its pattern, carried from tick to tick
    double centre[3];     ///< in the last tick [m]
    int known;            ///< centre and outside are those of the last tick
    int outside;          ///< the centre was outside the body, or came from there
    int engaged;          ///< it touches
    int laid;             ///< its points were laid out in the last tick: law->place holds
    double drag[3]; ///< friction: mean displacement of the body under it, along the surface [m]
    double stuck;   ///< friction: part of the normal force on points that stick
    // ---- of this tick
    double depth;    ///< overlap with the rest surface before coupling gives way [m]
    double give[3];  ///< of the coupling along the surface: from the free pose to the proxy [m]
    double step[3];  ///< what give was found short of [m]
    double pace;     ///< the part of step that give follows in a tick
    double shift[3]; ///< from the free pose to where the pattern is laid out: give, less drag [m]
} anywhere_station;

/// A contact point of this tick.
typedef struct anywhere_point {
    int32_t tool, station;
    int32_t id;         ///< the same from tick to tick
    double x[3];        ///< on the rest surface [m]
    double normal[3];   ///< outward
    double along[3][3]; ///< directions of its rows: -normal, two tangents; [row][component]
    /// The same as the tool feels them: the first is the gradient of its overlap by its place, the
    /// others are along's. The tool pushes with sum z felt; its motion d changes w by -felt.d
    double felt[3][3];
    double q[3];   ///< gap and slips with the tool at its free pose, without force [m]
    double mu;     ///< friction; < 0: held (friction.h)
    double arm[3]; ///< from the tool's origin to where it touches [m]
    int32_t rows;  ///< 1, or 3 where mu is not 0
    int32_t first; ///< its first row in the system
    double area;   ///< [m^2]
    double width;  ///< w: compliance with itself is coefficient / (2 w) [m]
    double fade;   ///< 0..1: towards the rim of the touchable region it grows infinitely soft
    pal_weights phi;
    int32_t slot[PALPATE_WEIGHTS_MAX]; ///< of phi's nodes in the working set
} anywhere_point;

/// What friction remembers of a contact point of the last tick.
typedef struct anywhere_trace {
    int32_t id, tool, station;
    double x[3], normal[3], width, fade; ///< as anywhere_point
    double force[3];                     ///< on the body [N]
} anywhere_trace;

/// A point held by a closed tool.
typedef struct anywhere_held {
    anywhere_point point;
    double local[3]; ///< its deformed place in the tool's frame [m]
} anywhere_held;

typedef struct anywhere_tool {
    anywhere_station station[PALPATE_STATIONS_MAX];
    int32_t stations;
    pal_pattern pattern; ///< of its balls
    double yield;        ///< 1 / k_eff of the coupling [m/N]; 0: rigid
    double damping;      ///< b / period [N/m]
    // ---- state
    int has_before;
    int closed;          ///< last tick's button
    int32_t held_count;  ///< points held; > 0: no other point of the tool touches
    anywhere_held *held; ///< shape [points of a tool]
    double preload[3];   ///< while held: what the slopes added to the force at closing [N]
    double device[3];    ///< device position in the last tick [m]
    double proxy[3];     ///< proxy position in the last tick [m]
    pal_pose last;       ///< free pose in the last tick
    double force[3];     ///< that it pushed with in the last tick [N]
    // ---- of this tick
    int inside;      ///< the centre of one of its balls is inside the body
    pal_pose free;   ///< where the coupling alone would put the proxy
    pal_solid solid; ///< there
} anywhere_tool;

/// Contact points by components, room for three more than there are (contact_system.c).
typedef struct anywhere_around {
    double *x, *y, *z, *width; ///< shape [capacity + 4]
    double *near;              ///< b between one point and each, shape [capacity + 4]
    double *along;             ///< directions of rows, shape [capacity, component, row + 1 spare]
} anywhere_around;

typedef struct anywhere_law {
    pal_contact_def def;
    const pal_model *model;
    pal_rest_surface surface;
    pal_weights_table weights;
    pal_near_field near;
    pal_working_set set;
    double spacing; ///< root of the mean area of a touchable node [m]; squared, a point tool's area
    double modulus; ///< E / (1 - nu^2) [Pa]
    anywhere_tool tool[PALPATE_TOOLS_MAX];
    int32_t capacity; ///< points
    int32_t points;
    int32_t dropped; ///< points left out in this tick
    uint32_t fault[PALPATE_TOOLS_MAX];
    anywhere_point *point;    ///< shape [capacity]
    anywhere_held *held;      ///< of all tools, shape [capacity]
    pal_surface_point *place; ///< by identity: in the last tick, shape [capacity]
    // ---- contact_system.c
    int32_t rows;
    int32_t ld; ///< of y
    double *y;  ///< R Phi^T of each point [m/N], shape [ld, 3 capacity] + 1: in its columns first,
                ///< .. along x, y, z; where rows = 1 in the one along its row
    anywhere_around around;
    double *m;            ///< compliance of the rows, column-major, ld = rows [m/N]
    double *q, *z, *w;    ///< shape [3 capacity]
    double *mu;           ///< of the points, shape [capacity]
    uint8_t *state;       ///< pal_friction_point of the points, shape [capacity]
    uint8_t *before;      ///< the same by identity, of the last tick, shape [capacity]
    double *force_before; ///< by identity: forces of the last tick [N], shape [capacity, 3]
    void *work;
    double *nodal; ///< force on the nodes of the working set [N], shape [3 set.capacity]
    int32_t *dof;  ///< shape [3 set.capacity]
    double *force; ///< shape [3 set.capacity]
    // ---- contact_friction.c: the last tick, kept where a tool has friction
    int frictional;
    int32_t traces;
    anywhere_trace *trace; ///< shape [capacity]
    anywhere_around past;  ///< of the traces; along: force and its part along the normal, 4 each
    int32_t past_nodes;
    int32_t *past_column; ///< nodes of the working set then, shape [set.capacity]
    double *past_force;   ///< on them [N], shape [set.capacity, 3]
    double *past_u;       ///< R F of them [m], shape [set.capacity, 3]
    double *recalled_u;   ///< R F of the last tick on the nodes of the working set now [m]
    uint8_t *recalled;    ///< shape [set.capacity]
} anywhere_law;

/// The contact points of tool t at its free pose: appended to law->point.
void pal_anywhere_touch(anywhere_law *law, int32_t t);

/// Put the points' nodes into the working set; points that do not fit are dropped.
void pal_anywhere_gather(anywhere_law *law);
/// Rows, their compliance, gaps.
void pal_anywhere_assemble(anywhere_law *law);
/// Solve for z. @return iterations; fault bits are put into law->fault
int32_t pal_anywhere_solve(anywhere_law *law);
/// Displacement of the body at point i under the forces of the solution [m]; law->nodal must hold
/// their nodal forces.
void pal_anywhere_displacement(anywhere_law *law, int32_t i, double u[3]);
/// Displacement at the point under the forces of `law->trace` through the half-space's own part K
/// [m].
void pal_anywhere_trace(const anywhere_law *law, const anywhere_point *point, double u[3]);
/// sum_k phi_k v_k over the point's nodes, v by slots.
void pal_anywhere_sample(const anywhere_point *point, const double *v, double u[3]);
/// Nodal forces Phi^T f of the solution into law->nodal, and those that are not 0 into dof, force.
/// @return number of entries
int32_t pal_anywhere_distribute(anywhere_law *law);

/// The held points of tool t at its free pose: appended to law->point.
void pal_anywhere_hold(anywhere_law *law, int32_t t);
/// After the solution: hold what tool t touches, at its proxy.
void pal_anywhere_grasp(anywhere_law *law, int32_t t, const pal_pose *proxy);

/// Where to lay out the pattern of a station: s->give, s->shift.
void pal_anywhere_shift(const anywhere_law *law, int32_t t, anywhere_station *s);
/// Displacements of the last tick on the nodes of this tick's working set.
void pal_anywhere_recall(anywhere_law *law);
/// q of the point's tangential rows: slip since the last tick without new force.
void pal_anywhere_slip(const anywhere_law *law, anywhere_point *point);
/// Keep what the next tick needs; at the tick's end.
void pal_anywhere_remember(anywhere_law *law);

#endif
