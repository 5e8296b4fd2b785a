/// @file render_thread.h  Frames for the picture at the render rate (private).
///
/// Takes the newest snapshot at each deadline of the render rate and hands new ones to the host's
/// callback, which may draw, allocate and block: the servo does not notice. A slow callback skips
/// deadlines. In freewheel the frames come through the servo's gate instead: one per render period
/// of session time. The last state is always handed over before the thread ends.
#ifndef PALPATE_HAPTIC_RENDER_THREAD_H
#define PALPATE_HAPTIC_RENDER_THREAD_H

#include <stdatomic.h>
#include <stdint.h>

#include "haptic/session/servo.h"

typedef struct pal_render {
    pal_servo *servo;
    pal_reader *reader;
    int64_t period_ns;
    void (*call)(void *user, const pal_frame *frame); ///< may be NULL
    void *user;
    _Atomic uint64_t frames; ///< new frames taken
} pal_render;

/// The thread's main loop; returns after the servo has ended.
void pal_render_run(pal_render *render);

/// Sleep until `deadline` [ns] in pieces, but no longer than the servo runs. @return 0 when it has
/// ended
int pal_sleep_while_running(const pal_servo *servo, int64_t deadline);

#endif
