/// @file pace.c  When the displacement field may run under overload (rules: pace.h).
#include "haptic/session/pace.h"

enum { FADE = 64 };

void pal_pace_init(pal_pace *pace, int64_t period_ns) {
    *pace = (pal_pace){.period = period_ns};
}

int pal_pace_allows(pal_pace *pace, int64_t left) {
    if (pace->wait > 0) {
        pace->wait--;
        return 0;
    }
    if (left > 0 && pace->estimate <= left) {
        return 1;
    }
    pace->estimate -= pace->estimate / FADE + (pace->estimate > 0);
    return 0;
}

void pal_pace_ran(pal_pace *pace, int64_t took, int64_t left) {
    int64_t counted = took < 2 * pace->period ? took : 2 * pace->period;
    int64_t faded = pace->estimate - pace->estimate / FADE;
    // engine calls without a reader that wants a frame cost nothing and prove nothing
    int real = 4 * took > pace->estimate;
    pace->estimate = counted > faded ? counted : faded;
    if (took > left) {
        int64_t second = 1000000000 / pace->period;
        pace->hold = pace->hold == 0 ? 1 : 2 * pace->hold;
        pace->hold = pace->hold > second ? second : pace->hold;
        pace->wait = pace->hold;
    } else if (real) {
        pace->hold = 0;
    }
}
