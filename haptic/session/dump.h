/// @file dump.h  The record ring on disk: on a fault and on demand (private).
///
/// The servo marks the onset of a fault (a bit of `mask` that the tick before did not have) and
/// says when the ring is to be written: `after` ticks later, so that the dump shows what led to the
/// fault and what followed. Onsets meanwhile belong to the same dump. A thread of its own writes
/// the raw file and hands it to the disk; the servo never waits for it, but in freewheel, where
/// nobody waits for the servo and the ring would be overwritten, it does. When the session is
/// finished the raw files become recordings like any other (recording_file.c): `palpate replay`,
/// h5dump. After a kill `palpate recover` makes them. A dump never overwrites a file: the second of
/// PATH.h5 is PATH-2.h5.
#ifndef PALPATE_HAPTIC_DUMP_H
#define PALPATE_HAPTIC_DUMP_H

#include <stdatomic.h>

#include "haptic/recording/recording.h"
#include "haptic/session/servo.h"

enum {
    PALPATE_DUMPS_MAX = 16, ///< per session; later ones are counted only
    PALPATE_DUMP_NAMES = 999
};

typedef struct pal_dumper {
    pal_servo *servo;
    const pal_ring *ring;
    const pal_ticks_header *header;
    char path[PALPATE_RECORDING_PATH]; ///< as asked for; "": no dumps
    pal_tick_record *record;           ///< shape [ring capacity]
    int32_t number[PALPATE_DUMPS_MAX]; ///< of the names taken
    _Atomic int32_t count;             ///< dumps written
    _Atomic int32_t skipped;           ///< not written: too many, or the disk refused
    _Atomic int32_t first_errno;
    _Atomic int32_t requested; ///< on demand
} pal_dumper;

/// Write the newest records of a ring as a raw recording `path`.ticks (must not exist) and sync it.
/// @param record  room for the ring's capacity
/// @return PALPATE_OK; _ARGUMENT (path), _IO (nothing left)
pal_status pal_dump_ring(const pal_ring *ring, const pal_ticks_header *header, const char *path,
                         pal_tick_record *record, pal_error *error);

/// Name number n (from 1) of a dump: n = 1 is `path`, else "-n" goes before the extension.
/// @return 0 when it does not fit
int pal_dump_name(const char *path, int32_t n, char out[PALPATE_RECORDING_PATH]);

/// Memory and path. `dumper` is zeroed by the caller but for servo, ring, header.
/// @return PALPATE_OK; _ARGUMENT, _MEMORY
pal_status pal_dumper_init(pal_dumper *dumper, const char *path, pal_error *error);
/// The thread's main loop; returns after the servo has ended and what was due is written.
void pal_dumper_run(pal_dumper *dumper);
/// Make recordings of the raw dumps. @return PALPATE_OK or the first error (its raw file stays)
pal_status pal_dumper_convert(pal_dumper *dumper, pal_error *error);
void pal_dumper_clear(pal_dumper *dumper);

#endif
