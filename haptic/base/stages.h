/// @file stages.h  A clock for the stages of a tick, for benches (private).
///
/// An engine has none: a tick then pays one test of a pointer per stage. A bench hangs one into
/// pal_engine.stages, starts it before the tick and reads the nanoseconds after it. The clock
/// itself is the bench's choice: CLOCK_THREAD_CPUTIME_ID does not count what the host's other work
/// took away, but it is a system call, which the real-time path must not make.
///
/// Thread: the servo's (or the bench's in its place).
#ifndef PALPATE_HAPTIC_STAGES_H
#define PALPATE_HAPTIC_STAGES_H

#include <stddef.h>
#include <stdint.h>

/// The stages in the order of a tick. X(NAME, text)
#define PALPATE_STAGE_LIST(X)                                                                      \
    X(DEVICE_IN, "device read")                                                                    \
    X(INPUT, "pose to body frame and watchdog")                                                    \
    X(CONTACT, "contact geometry")                                                                 \
    X(SOLVE, "contact solve")                                                                      \
    X(OUTPUT, "output stage")                                                                      \
    X(DEVICE_OUT, "force out")                                                                     \
    X(FIELD, "field")                                                                              \
    X(PUBLISH, "publish")                                                                          \
    X(WARM, "warming the cache for the next tick")

typedef enum pal_stage {
#define PALPATE_STAGE_ENUM(name, text) PALPATE_STAGE_##name,
    PALPATE_STAGE_LIST(PALPATE_STAGE_ENUM)
#undef PALPATE_STAGE_ENUM
        PALPATE_STAGE_COUNT
} pal_stage;

typedef struct pal_stages {
    int64_t (*now)(void);            ///< [ns]
    int64_t last;                    ///< when the last stage ended
    int64_t ns[PALPATE_STAGE_COUNT]; ///< of this tick
} pal_stages;

/// Begin a tick: all stages 0, the first one starts now.
static inline void pal_stages_begin(pal_stages *s) {
    for (int k = 0; k < PALPATE_STAGE_COUNT; k++) {
        s->ns[k] = 0;
    }
    s->last = s->now();
}

/// The time since the last end belongs to `stage` (added: a stage may come in pieces).
static inline void pal_stages_end(pal_stages *s, pal_stage stage) {
    if (s != NULL) {
        int64_t now = s->now();
        s->ns[stage] += now - s->last;
        s->last = now;
    }
}

#endif
