/// @file mouse_tool.h  A device that is either the scene's own or the mouse, and can be paused.
#ifndef PALPATE_PROGRAM_MOUSE_TOOL_H
#define PALPATE_PROGRAM_MOUSE_TOOL_H

#include <palpate/session.h>

typedef struct mouse_tool mouse_tool;

/// Wrap `inner` (owned from now on) and a host device. The device is closed by the session; the
/// mouse_tool itself belongs to the caller and must outlive the session.
/// @param tool  gives the start pose of the mouse's tool
mouse_tool *mouse_tool_create(const pal_device *inner, const pal_tool_def *tool, pal_device *out);
void mouse_tool_free(mouse_tool *m);

/// From the window's thread, wait-free.
void mouse_tool_select(mouse_tool *m, int mouse);
void mouse_tool_pause(mouse_tool *m, int paused);
void mouse_tool_restart(mouse_tool *m);
void mouse_tool_set(mouse_tool *m, const pal_pose *pose);

/// Where the ray meets the model's rest surface: point and outward normal. @return 1 when it does
int mouse_tool_pick(const pal_model *model, const double origin[3], const double direction[3],
                    double point[3], double normal[3]);

/// The tool's pose when it overlaps the surface point by `depth` along the inward normal; its
/// handle points along the normal.
pal_pose mouse_tool_pose(const pal_tool_def *tool, const double point[3], const double normal[3],
                         double depth);

#endif
