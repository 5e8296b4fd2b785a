/// @file solid.h  The tool's solid in the body frame and its intersection with lines (private).
///
/// One representation for all shapes: the points within `radius` of a segment. A sphere is a
/// segment of length zero, a point a sphere of radius zero. Pure functions, no allocation, any
/// thread.
#ifndef PALPATE_HAPTIC_SOLID_H
#define PALPATE_HAPTIC_SOLID_H

#include <palpate/engine.h>

typedef struct pal_solid {
    double center[3]; ///< [m]
    double axis[3];   ///< unit; the tool's local z
    double half;      ///< half the segment's length [m]
    double radius;    ///< [m]
} pal_solid;

/// The solid of a tool definition at a pose in the body frame.
pal_solid pal_solid_place(const pal_tool_def *tool, const pal_pose *pose);

/// Signed distance of x from the solid's surface [m], negative inside.
double pal_solid_distance(const pal_solid *solid, const double x[3]);

/// Where the line x + s d (d unit) is inside the solid: near <= s <= far.
/// @return 1; 0 when the line misses (or only grazes). A solid of radius and length zero is always
///         "hit" at near = far = (center - x).d: the line through x that ends level with the tip.
int pal_solid_chord(const pal_solid *solid, const double x[3], const double d[3], double *near,
                    double *far);

/// Axis-aligned box of the solid.
void pal_solid_box(const pal_solid *solid, double low[3], double high[3]);

#endif
