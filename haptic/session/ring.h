/// @file ring.h  Per-tick records from the servo to others: newest-history ring and queue
/// (private).
///
/// pal_ring keeps the newest `capacity` records and overwrites the oldest: the servo never waits. A
/// reader copies a slot and checks the slot's sequence number before and after (a seqlock per
/// slot), so a slot overwritten meanwhile is left out, never torn. Every word is atomic, so the
/// check is data-race free: the writer's words are release stores after the odd sequence number,
/// the reader's are acquire loads, hence whoever sees a new word sees the odd number too.
///
/// pal_queue is bounded, single producer, single consumer (Lamport 1983): nothing is lost unless it
/// is full, and then the producer is told so.
#ifndef PALPATE_HAPTIC_RING_H
#define PALPATE_HAPTIC_RING_H

#include <stdatomic.h>
#include <stdint.h>

#include <palpate/session.h>

enum { PALPATE_RECORD_WORDS = sizeof(pal_tick_record) / sizeof(uint64_t) };
_Static_assert(sizeof(pal_tick_record) == 240,
               "record layout is a file format: no padding, 30 words");

typedef struct pal_ring_slot {
    _Atomic uint64_t sequence; ///< 2n+1 while record n is being written, 2n+2 after; 0: empty
    _Atomic uint64_t word[PALPATE_RECORD_WORDS];
} pal_ring_slot;

typedef struct pal_ring {
    pal_ring_slot *slot;
    uint64_t capacity;
    _Atomic uint64_t count; ///< records pushed ever
} pal_ring;

/// @return PALPATE_OK or _MEMORY; every page is touched
pal_status pal_ring_init(pal_ring *ring, int64_t capacity);
void pal_ring_clear(pal_ring *ring);
/// Thread: the one writer. Wait-free.
void pal_ring_push(pal_ring *ring, const pal_tick_record *record);
/// Newest records, oldest first; at most min(capacity argument, ring's). Returns how many.
/// Lock-free.
int32_t pal_ring_copy(const pal_ring *ring, pal_tick_record *out, int32_t capacity);

// NOLINTNEXTLINE(clang-analyzer-optin.performance.Padding): each end on a cache line of its own
typedef struct pal_queue {
    pal_tick_record *item;
    uint64_t mask;                      ///< capacity - 1, a power of two
    _Alignas(64) _Atomic uint64_t head; ///< next to write; producer's
    uint64_t tail_seen;                 ///< producer's last look at tail
    _Alignas(64) _Atomic uint64_t tail; ///< next to read; consumer's
} pal_queue;

/// @return PALPATE_OK or _MEMORY; at least `capacity` records fit
pal_status pal_queue_init(pal_queue *queue, int64_t capacity);
void pal_queue_clear(pal_queue *queue);
/// @return 1 when queued, 0 when full. Thread: producer. Wait-free.
int pal_queue_push(pal_queue *queue, const pal_tick_record *record);
/// Records that lie in one piece at the front: *out points at them. Thread: consumer.
int64_t pal_queue_peek(const pal_queue *queue, const pal_tick_record **out);
/// Give back `count` records just peeked. Thread: consumer.
void pal_queue_drop(pal_queue *queue, int64_t count);

#endif
