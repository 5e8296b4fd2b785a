/// @file mailbox.h  Newest value from one thread to another without waiting (private).
///
/// Three slots of equal size: the writer owns one, the reader owns one, the third changes hands by
/// an atomic exchange of its index (bit 2: it holds news). Neither side ever waits or sees a torn
/// value; a value the reader did not take is overwritten. One writer thread, one reader thread.
#ifndef PALPATE_HAPTIC_MAILBOX_H
#define PALPATE_HAPTIC_MAILBOX_H

#include <stdatomic.h>
#include <stdint.h>

typedef struct pal_mailbox {
    _Atomic uint32_t middle; ///< index of the slot in between; bit 2: news
    uint32_t back;           ///< writer's slot
    uint32_t front;          ///< reader's slot
} pal_mailbox;

enum { PALPATE_MAILBOX_NEWS = 4, PALPATE_MAILBOX_SLOTS = 3 };

static inline void pal_mailbox_init(pal_mailbox *m) {
    atomic_init(&m->middle, 1);
    m->back = 0;
    m->front = 2;
}

/// The slot the writer may fill; then call pal_mailbox_post.
static inline uint32_t pal_mailbox_back(const pal_mailbox *m) {
    return m->back;
}

static inline void pal_mailbox_post(pal_mailbox *m) {
    uint32_t old =
        atomic_exchange_explicit(&m->middle, m->back | PALPATE_MAILBOX_NEWS, memory_order_acq_rel);
    m->back = old & 3u;
}

/// Take the newest value into the reader's slot. @return 1: `front` is new, 0: as before.
static inline int pal_mailbox_take(pal_mailbox *m) {
    if (!(atomic_load_explicit(&m->middle, memory_order_relaxed) & PALPATE_MAILBOX_NEWS)) {
        return 0;
    }
    uint32_t old = atomic_exchange_explicit(&m->middle, m->front, memory_order_acq_rel);
    m->front = old & 3u;
    return 1;
}

#endif
