/// @file painter.h  The render thread's drawing: offscreen pictures of a running session.
#ifndef PALPATE_PROGRAM_PAINTER_H
#define PALPATE_PROGRAM_PAINTER_H

#include <palpate/engine.h>
#include <palpate/model.h>

/// Draws every frame it is given; keeps the picture with the largest force for the snapshot and,
/// when asked, every n-th for a GIF.
typedef struct painter painter;

typedef struct painter_def {
    const pal_model *model;
    const pal_runtime_config *runtime;
    const char *title;
    int width, height;
    const char *snapshot_path; ///< PNG of the frame with the largest force; NULL: none
    const char *gif_path;      ///< NULL: none
    double gif_period;         ///< seconds of session time between GIF frames
} painter_def;

/// The OpenGL context is made on the thread of the first painter_frame. Where a picture is asked
/// for, one is made and freed here too: a machine that cannot draw is known before the run.
/// @return PALPATE_OK; _MEMORY, or what the view says of a machine that cannot draw
pal_status painter_create(const painter_def *def, painter **out, pal_error *error);
/// pal_session_def.render; the last call, with NULL, writes the pictures. Thread: render.
void painter_frame(void *painter, const pal_frame *frame);
/// After the session. @return PALPATE_OK, or the first error of drawing or writing
pal_status painter_status(const painter *p, pal_error *error);
/// Frames drawn, and the mean time a drawing took [s].
unsigned long painter_count(const painter *p, double *mean_seconds);
void painter_free(painter *p);

#endif
