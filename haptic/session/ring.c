/// @file ring.c  History ring and queue of tick records (protocols: ring.h).
#include "haptic/session/ring.h"

#include <stdlib.h>
#include <string.h>

pal_status pal_ring_init(pal_ring *ring, int64_t capacity) {
    ring->slot = malloc((size_t)capacity * sizeof *ring->slot);
    if (ring->slot == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    ring->capacity = (uint64_t)capacity;
    atomic_init(&ring->count, 0);
    for (int64_t i = 0; i < capacity; i++) {
        atomic_init(&ring->slot[i].sequence, 0);
        for (int w = 0; w < PALPATE_RECORD_WORDS; w++) {
            atomic_init(&ring->slot[i].word[w], 0);
        }
    }
    return PALPATE_OK;
}

void pal_ring_clear(pal_ring *ring) {
    free(ring->slot);
    ring->slot = NULL;
    ring->capacity = 0;
}

void pal_ring_push(pal_ring *ring, const pal_tick_record *record) {
    uint64_t n = atomic_load_explicit(&ring->count, memory_order_relaxed);
    pal_ring_slot *slot = &ring->slot[n % ring->capacity];
    uint64_t word[PALPATE_RECORD_WORDS];
    memcpy(word, record, sizeof word);
    atomic_store_explicit(&slot->sequence, 2 * n + 1, memory_order_relaxed);
    for (int w = 0; w < PALPATE_RECORD_WORDS; w++) {
        atomic_store_explicit(&slot->word[w], word[w], memory_order_release);
    }
    atomic_store_explicit(&slot->sequence, 2 * n + 2, memory_order_release);
    atomic_store_explicit(&ring->count, n + 1, memory_order_release);
}

int32_t pal_ring_copy(const pal_ring *ring, pal_tick_record *out, int32_t capacity) {
    uint64_t end = atomic_load_explicit(&ring->count, memory_order_acquire);
    uint64_t want = end < ring->capacity ? end : ring->capacity;
    want = capacity > 0 && want > (uint64_t)capacity ? (uint64_t)capacity : want;
    int32_t got = 0;
    for (uint64_t n = end - want; capacity > 0 && n < end; n++) {
        const pal_ring_slot *slot = &ring->slot[n % ring->capacity];
        uint64_t word[PALPATE_RECORD_WORDS];
        if (atomic_load_explicit(&slot->sequence, memory_order_acquire) != 2 * n + 2) {
            continue; // already overwritten by a newer one
        }
        for (int w = 0; w < PALPATE_RECORD_WORDS; w++) {
            word[w] = atomic_load_explicit(&slot->word[w], memory_order_acquire);
        }
        if (atomic_load_explicit(&slot->sequence, memory_order_relaxed) == 2 * n + 2) {
            memcpy(&out[got++], word, sizeof word);
        }
    }
    return got;
}

pal_status pal_queue_init(pal_queue *queue, int64_t capacity) {
    uint64_t size = 1;
    while (size < (uint64_t)capacity) {
        size *= 2;
    }
    queue->item = malloc(size * sizeof *queue->item);
    if (queue->item == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    memset(queue->item, 0, size * sizeof *queue->item);
    queue->mask = size - 1;
    queue->tail_seen = 0;
    atomic_init(&queue->head, 0);
    atomic_init(&queue->tail, 0);
    return PALPATE_OK;
}

void pal_queue_clear(pal_queue *queue) {
    free(queue->item);
    queue->item = NULL;
}

int pal_queue_push(pal_queue *queue, const pal_tick_record *record) {
    uint64_t head = atomic_load_explicit(&queue->head, memory_order_relaxed);
    if (head - queue->tail_seen > queue->mask) {
        queue->tail_seen = atomic_load_explicit(&queue->tail, memory_order_acquire);
        if (head - queue->tail_seen > queue->mask) {
            return 0;
        }
    }
    queue->item[head & queue->mask] = *record;
    atomic_store_explicit(&queue->head, head + 1, memory_order_release);
    return 1;
}

int64_t pal_queue_peek(const pal_queue *queue, const pal_tick_record **out) {
    uint64_t tail = atomic_load_explicit(&queue->tail, memory_order_relaxed);
    uint64_t head = atomic_load_explicit(&queue->head, memory_order_acquire);
    uint64_t at = tail & queue->mask, in_piece = queue->mask + 1 - at;
    *out = &queue->item[at];
    return (int64_t)(head - tail < in_piece ? head - tail : in_piece);
}

void pal_queue_drop(pal_queue *queue, int64_t count) {
    uint64_t tail = atomic_load_explicit(&queue->tail, memory_order_relaxed);
    atomic_store_explicit(&queue->tail, tail + (uint64_t)count, memory_order_release);
}
