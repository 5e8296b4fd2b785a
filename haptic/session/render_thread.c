/// @file render_thread.c  The render thread's loop (rules: render_thread.h).
#include "haptic/session/render_thread.h"

#include "haptic/base/realtime.h"

/// Longest sleep in one piece: how late the end of the servo may be noticed.
enum { PIECE_NS = 20000000 };

int pal_sleep_while_running(const pal_servo *servo, int64_t deadline) {
    for (;;) {
        if (!atomic_load_explicit(&servo->running, memory_order_acquire)) {
            return 0;
        }
        int64_t now = pal_rt_now();
        if (now >= deadline) {
            return 1;
        }
        pal_rt_sleep_until(deadline - now > PIECE_NS ? now + PIECE_NS : deadline);
    }
}

static void take(pal_render *render) {
    pal_frame frame;
    if (pal_engine_snapshot(render->reader, &frame) == 1) {
        if (render->call != NULL) {
            render->call(render->user, &frame);
        }
        uint64_t n = atomic_load_explicit(&render->frames, memory_order_relaxed);
        atomic_store_explicit(&render->frames, n + 1, memory_order_relaxed);
    }
}

static void run_gated(pal_render *render) {
    uint64_t seen = 0;
    while (pal_gate_wait(render->servo, &seen)) {
        if (seen % 2 == 0) { // the frame just offered
            take(render);
        } else { // drain an older one
            pal_frame stale;
            (void)pal_engine_snapshot(render->reader, &stale);
        }
        pal_gate_done(render->servo, PALPATE_TAKER_RENDER, seen);
    }
}

void pal_render_run(pal_render *render) {
    if (render->servo->freewheel) {
        run_gated(render);
    } else {
        int64_t next = pal_rt_now() + render->period_ns;
        while (pal_sleep_while_running(render->servo, next)) {
            take(render);
            int64_t now = pal_rt_now();
            next += render->period_ns;
            next = next < now ? now : next; // a slow picture skips, it does not hurry
        }
    }
    take(render);
    if (render->call != NULL) {
        render->call(render->user, NULL); // the end: what belongs to this thread can be freed on it
    }
}
