/// @file pace.h  When the displacement field may run under overload (private, pure logic).
///
/// The field runs when what is left of the period covers what it has lately taken. The estimate
/// follows a rise at once, up to two periods, so that one pre-empted field (a host that took the
/// core away) does not freeze the picture for long; it falls by 1/64 per tick, also while skipping,
/// so that the field is tried again. A field that really takes longer than there is time for would
/// then overrun at each try: after an overrun the next try waits twice as long as the wait before,
/// at most a second. So a hopeless field costs the force at most about one late tick a second, and
/// a field that fits again is back within a second.
#ifndef PALPATE_HAPTIC_PACE_H
#define PALPATE_HAPTIC_PACE_H

#include <stdint.h>

typedef struct pal_pace {
    int64_t period;   ///< [ns]
    int64_t estimate; ///< what a field is expected to take [ns]
    int64_t hold;     ///< ticks waited after the last overrun
    int64_t wait;     ///< ticks still to wait
} pal_pace;

void pal_pace_init(pal_pace *pace, int64_t period_ns);

/// May a field start with `left` [ns] of the period left? Call once per tick; a 0 counts as a skip.
int pal_pace_allows(pal_pace *pace, int64_t left);

/// A field was run and took `took` [ns] of the `left` [ns] there were.
void pal_pace_ran(pal_pace *pace, int64_t took, int64_t left);

#endif
