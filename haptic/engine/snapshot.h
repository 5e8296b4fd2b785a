/// @file snapshot.h  Wait-free hand-over of frames from the servo to one reader (private).
///
/// Each reader owns three slots. At any time the writer owns one (back), the reader one (front) and
/// the third (middle) holds the newest published frame; one atomic word names the middle slot and
/// says whether it is unread. Publishing and taking are one atomic exchange each: no loop, no lock,
/// no torn frame, and the writer never waits for a slow reader (the unread frame is replaced).
/// Release on publish orders the slot's contents before the exchange; acquire on take orders the
/// reads after it; both exchanges are acquire-release because slots travel in both directions.
///
/// Threads: _unread, _back, _publish: the writer (servo). _take: the reader.
#ifndef PALPATE_HAPTIC_SNAPSHOT_H
#define PALPATE_HAPTIC_SNAPSHOT_H

#include <stdalign.h>
#include <stdatomic.h>
#include <stddef.h>
#include <stdint.h>

#include <palpate/engine.h>

enum { PALPATE_CACHE_LINE = 64 };

typedef struct pal_slot {
    pal_frame frame;
    float *displacement; ///< the slot's buffer, 64-byte aligned, shape [floats]
    // where the reader computes the field: what it needs (the engine's; NULL otherwise)
    int32_t count; ///< degrees of freedom with a force
    int32_t *dof;  ///< shape [count], as are f [N] and f32, the same scaled for the stored rows
    double *f;
    float *f32;
} pal_slot;

/// The three parts lie on cache lines of their own: neither thread disturbs the other's line.
struct pal_reader {
    alignas(PALPATE_CACHE_LINE) _Atomic uint32_t middle; ///< slot index | PALPATE_UNREAD
    alignas(PALPATE_CACHE_LINE) uint32_t back;           ///< writer's slot
    uint64_t published;                                  ///< frames published; writer's
    uint64_t published_tick;                             ///< tick of the last one; writer's
    alignas(PALPATE_CACHE_LINE) uint32_t front;          ///< reader's slot
    uint32_t has_frame;                                  ///< reader has taken at least one
    const pal_engine *engine; ///< its rows are summed by this reader; NULL: the writer has done it
    float *field;             ///< the reader's own buffer then, shape [engine rows]
    void *scratch;            ///< and its scratch for the sum
    alignas(PALPATE_CACHE_LINE) pal_slot slot[3];
};

enum { PALPATE_UNREAD = 4 };

/// Bytes of the three displacement buffers of one reader for `floats` values each.
size_t pal_snapshot_bytes(int64_t floats);

/// Initialise a reader on `buffers` (64-byte aligned, pal_snapshot_bytes() long). Before any use.
void pal_snapshot_init(pal_reader *reader, void *buffers, int64_t floats);

/// 1 when the last published frame has not been taken yet (it may be taken a moment later).
int pal_snapshot_unread(const pal_reader *reader);

/// The writer's slot: fill frame and displacement, then publish.
pal_slot *pal_snapshot_back(pal_reader *reader);

/// Publish the back slot. Wait-free. @return 1 when an unread frame was replaced.
int pal_snapshot_publish(pal_reader *reader);

/// Newest frame; see pal_engine_snapshot. Wait-free.
int pal_snapshot_take(pal_reader *reader, pal_frame *frame);

#endif
