/// @file cost.h  What a tick costs on this machine: measured, and predicted from counts (private).
///
/// Two measurements, in thread CPU time (what the host gives to others is not counted):
///   the field   seconds to sweep a block of so many bytes, per precision and size (the memory
///   wall) the ticks   a model driven in freewheel by its own tool: force stage, whole tick,
///   contact points
/// A field is then predicted as bytes = (3 m)(3 s) bytes per entry times the measured seconds per
/// byte at that size; the rest of a tick follows the touched nodes through measured ticks (palpate
/// precompute
/// --budget). Nothing here is a constant of some other machine.
///
/// Thread: any but the servo's; allocates.
#ifndef PALPATE_HAPTIC_COST_H
#define PALPATE_HAPTIC_COST_H

#include <palpate/engine.h>
#include <palpate/model.h>
#include <palpate/session.h>

enum { PALPATE_COST_SIZES = 6 };

typedef struct pal_cost_machine {
    double bytes[PALPATE_COST_SIZES];       ///< block sizes measured, ascending
    double per_byte[4][PALPATE_COST_SIZES]; ///< [s], by pal_precision
} pal_cost_machine;

/// Measure the field kernel. Takes about half a second. @return PALPATE_OK; _MEMORY
PALPATE_API pal_status pal_cost_measure(pal_cost_machine *out, pal_error *error);

/// Seconds one field takes: `contacts` touched nodes, `rows` stored nodes.
PALPATE_API double pal_cost_field(const pal_cost_machine *machine, pal_precision precision,
                                  double contacts, double rows);

typedef struct pal_cost_ticks {
    uint64_t ticks;
    double contacts;         ///< touched nodes per tick with contact, mean
    int32_t most;            ///< and largest
    pal_quantiles force_us;  ///< pose to force
    pal_quantiles field_us;  ///< field and publish, computed each tick
    pal_quantiles tick_us;   ///< both
    pal_quantiles render_us; ///< both when the readers compute the field; own radius only
} pal_cost_ticks;

/// Drive the model by its first tool's own motion (at most 6 s of it, every tick with its field),
/// or by a press and circle in the middle of the touchable nodes when it has none. The motion is
/// run several times and the least of each quantile kept: the ticks are the same to the bit, so
/// what differs is the machine's other work.
/// @param swell  the tool's radius is this many times its own, still just touching at its start:
/// how the
///               cost grows with the touched nodes, learned on one model
/// @param runs   times the motion is run
/// @return PALPATE_OK; _ARGUMENT (nothing touchable), _MEMORY, what the device or engine says
PALPATE_API pal_status pal_cost_of_ticks(const pal_model *model, double swell, int runs,
                                         pal_cost_ticks *out, pal_error *error);

#endif
