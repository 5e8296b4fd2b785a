/// @file indent.h  Workings of pal_model_indent (private). The mathematics stand in indent.c.
#ifndef PALPATE_HAPTIC_INDENT_H
#define PALPATE_HAPTIC_INDENT_H

#include "haptic/model/model.h"

/// A place of the surface that the tool may touch: a node, or a point of a triangle.
typedef struct indent_point {
    int32_t nodes;       ///< 1 or 3
    int32_t column[3];   ///< column nodes
    double weight[3];    ///< displacement = sum weight u(column); the force is shared alike
    double x[3];         ///< rest position [m]
    double area;         ///< tributary area seen along the axis [m^2]; 0 for a point of a triangle
    double u[3];         ///< displacement of the last solve [m]
    double direction[3]; ///< of the force on the body, unit
    double z;            ///< force of the last solve [N]
    int32_t chosen;      ///< index in the contact system, -1: not in it
} indent_point;

/// Every place tool can touch when pressed along `axis`: touchable nodes that face it, lie under it
/// and, when none does, the point of the surface on its axis.
/// @param[out] out  to be freed by the caller; NULL on error
/// @return PALPATE_OK; _ARGUMENT when there is none, _MEMORY. Thread: any.
pal_status pal_indent_points(const pal_model *model, const pal_tool_def *tool, const double axis[3],
                             indent_point **out, int32_t *count, pal_error *error);

/// Half extent of the tool along its own axis at the distance r from it [m]. @return NAN where r is
/// beyond the tool
double pal_tool_extent(const pal_tool_def *tool, double r);

#endif
