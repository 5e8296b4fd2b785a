/// @file snapshot.c  Wait-free triple buffer, one per reader (see snapshot.h for the protocol).
#include "haptic/engine/snapshot.h"

static size_t buffer_bytes(int64_t floats) {
    size_t bytes = (size_t)floats * sizeof(float);
    return (bytes + PALPATE_CACHE_LINE - 1) / PALPATE_CACHE_LINE * PALPATE_CACHE_LINE;
}

size_t pal_snapshot_bytes(int64_t floats) {
    return 3 * buffer_bytes(floats);
}

void pal_snapshot_init(pal_reader *reader, void *buffers, int64_t floats) {
    atomic_init(&reader->middle, 0u);
    reader->back = 1;
    reader->front = 2;
    reader->published = 0;
    reader->published_tick = 0;
    reader->has_frame = 0;
    reader->engine = NULL;
    reader->field = NULL;
    reader->scratch = NULL;
    for (int i = 0; i < 3; i++) {
        unsigned char *at = (unsigned char *)buffers + (size_t)i * buffer_bytes(floats);
        reader->slot[i] = (pal_slot){0};
        reader->slot[i].displacement = (float *)(void *)at;
        for (int64_t k = 0; k < floats; k++) { // also faults the pages in
            reader->slot[i].displacement[k] = 0.0f;
        }
    }
}

int pal_snapshot_unread(const pal_reader *reader) {
    return (atomic_load_explicit(&reader->middle, memory_order_relaxed) & PALPATE_UNREAD) != 0;
}

pal_slot *pal_snapshot_back(pal_reader *reader) {
    return &reader->slot[reader->back];
}

int pal_snapshot_publish(pal_reader *reader) {
    reader->published++;
    reader->published_tick = reader->slot[reader->back].frame.tick;
    uint32_t old = atomic_exchange_explicit(&reader->middle, reader->back | PALPATE_UNREAD,
                                            memory_order_acq_rel);
    reader->back = old & 3u;
    return (old & PALPATE_UNREAD) != 0;
}

int pal_snapshot_take(pal_reader *reader, pal_frame *frame) {
    int fresh = 0;
    if (pal_snapshot_unread(reader)) {
        uint32_t old =
            atomic_exchange_explicit(&reader->middle, reader->front, memory_order_acq_rel);
        reader->front = old & 3u;
        reader->has_frame = 1;
        fresh = 1;
    }
    if (!reader->has_frame) {
        return -1;
    }
    *frame = reader->slot[reader->front].frame;
    return fresh;
}
