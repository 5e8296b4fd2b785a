/// @file seconds.h  Elapsed time of the offline stages.
#ifndef PALPATE_SRC_SECONDS_H
#define PALPATE_SRC_SECONDS_H

#include <time.h>

/// Monotonic time [s]; only differences mean anything. Thread: any.
static inline double pal_seconds_now(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

#endif
