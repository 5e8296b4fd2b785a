/// @file block.h  Laying out arrays in one block of memory, each on a cache line of its own
/// (private).
///
/// Whoever lives in a block sized at creation counts its bytes and places its arrays by the same
/// steps. Pure arithmetic, any thread.
#ifndef PALPATE_HAPTIC_BLOCK_H
#define PALPATE_HAPTIC_BLOCK_H

#include <stddef.h>

enum { PALPATE_BLOCK_LINE = 64 };

/// `bytes` up to a whole cache line.
static inline size_t pal_block_padded(size_t bytes) {
    return (bytes + PALPATE_BLOCK_LINE - 1) / PALPATE_BLOCK_LINE * PALPATE_BLOCK_LINE;
}

/// The next array of `bytes` from *at, which moves on. @param[in,out] at  64-byte aligned
static inline void *pal_block_take(unsigned char **at, size_t bytes) {
    void *here = *at;
    *at += pal_block_padded(bytes);
    return here;
}

/// Count an array of `bytes` in the offset `at`; where `memory` is not NULL, let `field` point to
/// it.
#define PALPATE_BLOCK_PLACE(memory, at, field, bytes)                                              \
    do {                                                                                           \
        if ((memory) != NULL) {                                                                    \
            (field) = (void *)((memory) + (at));                                                   \
        }                                                                                          \
        (at) += pal_block_padded(bytes);                                                           \
    } while (0)

#endif
