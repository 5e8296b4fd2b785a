/// @file contact_pattern.h  How the contact points of a tool are spread under it (private).
///
/// Points on rings in the unit disc, each standing for a cell of the same area: 1, 1 + 5, 1 + 6, 1
/// + 5
/// + 10, 1 + 6 + 12, 1 + 6 + 12 + 18. The pattern moves with the tool and grows with its overlap,
/// so no point enters or leaves as the tool slides. Immutable after init; any thread.
#ifndef PALPATE_HAPTIC_CONTACT_PATTERN_H
#define PALPATE_HAPTIC_CONTACT_PATTERN_H

#include <stdint.h>

enum { PALPATE_PATTERN_MAX = 37 };

typedef struct pal_pattern {
    int32_t count;
    double at[PALPATE_PATTERN_MAX][2]; ///< in the unit disc, the centre first
    double share;                      ///< area of each cell: pi / count
    /// Self-compliance of a cell of area A is coefficient * self / sqrt(A): calibrated so that
    /// Hertz's force comes out exactly on a half-space (contact_pattern.c)
    double self;
    double scale; ///< radius of the pattern over that of the overlap; Hertz's contact ends at 0.707
} pal_pattern;

/// The largest pattern of at most `points` (>= 1) points.
void pal_pattern_init(pal_pattern *pattern, int32_t points);

/// Radius of the pattern under a ball pressed by depth > 0 [m]: `scale` times that of the circle in
/// which the ball cuts the plane, the latter 0.95 of the ball's at most.
double pal_pattern_radius(const pal_pattern *pattern, double ball, double depth);

#endif
