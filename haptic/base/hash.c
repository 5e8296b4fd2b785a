/// @file hash.c  BLAKE2b (RFC 7693), sequential, unkeyed.
///
/// The message is cut into blocks of 128 bytes; each is mixed into eight 64-bit words of state by
/// twelve rounds of the function G (RFC 7693, section 3.1) on a 4x4 matrix of words. The last block
/// is padded with zeros and marked by inverting word 14. Words are little endian; bytes are put
/// together by shifts, so the result does not depend on the machine's byte order.
/// Thread: any; all state is in the caller's pal_hash.
#include "haptic/base/hash.h"

#include <string.h>

/// Initial state: fractional parts of the square roots of the first eight primes.
static const uint64_t initial[8] = {
    0x6A09E667F3BCC908u, 0xBB67AE8584CAA73Bu, 0x3C6EF372FE94F82Bu, 0xA54FF53A5F1D36F1u,
    0x510E527FADE682D1u, 0x9B05688C2B3E6C1Fu, 0x1F83D9ABFB41BD6Bu, 0x5BE0CD19137E2179u,
};

/// Message word schedule; rounds 10 and 11 repeat rows 0 and 1.
static const uint8_t sigma[10][16] = {
    {0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15},
    {14, 10, 4, 8, 9, 15, 13, 6, 1, 12, 0, 2, 11, 7, 5, 3},
    {11, 8, 12, 0, 5, 2, 15, 13, 10, 14, 3, 6, 7, 1, 9, 4},
    {7, 9, 3, 1, 13, 12, 11, 14, 2, 6, 5, 10, 4, 0, 15, 8},
    {9, 0, 5, 7, 2, 4, 10, 15, 14, 1, 11, 12, 6, 8, 3, 13},
    {2, 12, 6, 10, 0, 11, 8, 3, 4, 13, 7, 5, 15, 14, 1, 9},
    {12, 5, 1, 15, 14, 13, 4, 10, 0, 7, 6, 3, 9, 2, 8, 11},
    {13, 11, 7, 14, 12, 1, 3, 9, 5, 0, 15, 4, 8, 6, 2, 10},
    {6, 15, 14, 9, 11, 3, 0, 8, 12, 2, 13, 7, 1, 4, 10, 5},
    {10, 2, 8, 4, 7, 6, 1, 5, 15, 11, 9, 14, 3, 12, 13, 0},
};

static uint64_t rotate_right(uint64_t x, unsigned n) {
    return (x >> n) | (x << (64 - n));
}

static uint64_t load_word(const uint8_t *p) {
    uint64_t w = 0;
    for (int i = 7; i >= 0; i--) {
        w = (w << 8) | p[i];
    }
    return w;
}

static inline void mix(uint64_t *v, int a, int b, int c, int d, uint64_t x, uint64_t y) {
    v[a] += v[b] + x;
    v[d] = rotate_right(v[d] ^ v[a], 32);
    v[c] += v[d];
    v[b] = rotate_right(v[b] ^ v[c], 24);
    v[a] += v[b] + y;
    v[d] = rotate_right(v[d] ^ v[a], 16);
    v[c] += v[d];
    v[b] = rotate_right(v[b] ^ v[c], 63);
}

static void compress(pal_hash *hash, const uint8_t *block, size_t used, int last) {
    hash->length[0] += used;
    hash->length[1] += hash->length[0] < used;

    uint64_t m[16], v[16];
    for (int i = 0; i < 16; i++) {
        m[i] = load_word(block + 8 * i);
    }
    for (int i = 0; i < 8; i++) {
        v[i] = hash->state[i];
        v[i + 8] = initial[i];
    }
    v[12] ^= hash->length[0];
    v[13] ^= hash->length[1];
    if (last) {
        v[14] = ~v[14];
    }
    // unrolled, the schedule's indices become constants: twice as fast
#pragma GCC unroll 12
    for (int round = 0; round < 12; round++) {
        const uint8_t *s = sigma[round % 10];
        mix(v, 0, 4, 8, 12, m[s[0]], m[s[1]]);
        mix(v, 1, 5, 9, 13, m[s[2]], m[s[3]]);
        mix(v, 2, 6, 10, 14, m[s[4]], m[s[5]]);
        mix(v, 3, 7, 11, 15, m[s[6]], m[s[7]]);
        mix(v, 0, 5, 10, 15, m[s[8]], m[s[9]]);
        mix(v, 1, 6, 11, 12, m[s[10]], m[s[11]]);
        mix(v, 2, 7, 8, 13, m[s[12]], m[s[13]]);
        mix(v, 3, 4, 9, 14, m[s[14]], m[s[15]]);
    }
    for (int i = 0; i < 8; i++) {
        hash->state[i] ^= v[i] ^ v[i + 8];
    }
}

void pal_hash_init(pal_hash *hash, size_t digest_size) {
    if (digest_size < 1) {
        digest_size = 1;
    }
    if (digest_size > PALPATE_HASH_MAX_BYTES) {
        digest_size = PALPATE_HASH_MAX_BYTES;
    }
    memset(hash, 0, sizeof *hash);
    memcpy(hash->state, initial, sizeof initial);
    hash->state[0] ^= 0x01010000u ^ (uint64_t)digest_size;
    hash->digest_size = digest_size;
}

void pal_hash_update(pal_hash *hash, const void *data, size_t size) {
    const uint8_t *p = data;
    // the last block must stay in the buffer until final, so compress only when more follows
    while (size > 0) {
        if (hash->fill == sizeof hash->block) {
            compress(hash, hash->block, sizeof hash->block, 0);
            hash->fill = 0;
        }
        if (hash->fill == 0 && size > sizeof hash->block) {
            compress(hash, p, sizeof hash->block, 0);
            p += sizeof hash->block;
            size -= sizeof hash->block;
            continue;
        }
        size_t n = sizeof hash->block - hash->fill;
        if (n > size) {
            n = size;
        }
        memcpy(hash->block + hash->fill, p, n);
        hash->fill += n;
        p += n;
        size -= n;
    }
}

void pal_hash_final(pal_hash *hash, uint8_t *digest) {
    memset(hash->block + hash->fill, 0, sizeof hash->block - hash->fill);
    compress(hash, hash->block, hash->fill, 1);
    for (size_t i = 0; i < hash->digest_size; i++) {
        digest[i] = (uint8_t)(hash->state[i / 8] >> (8 * (i % 8)));
    }
}

void pal_hash_to_hex(const uint8_t *bytes, size_t size, char *hex) {
    static const char digit[] = "0123456789abcdef";
    for (size_t i = 0; i < size; i++) {
        hex[2 * i] = digit[bytes[i] >> 4];
        hex[2 * i + 1] = digit[bytes[i] & 15];
    }
    hex[2 * size] = 0;
}

void pal_hash_buffer(const void *data, size_t size, uint8_t *digest) {
    pal_hash hash;
    pal_hash_init(&hash, PALPATE_HASH_BYTES);
    pal_hash_update(&hash, data, size);
    pal_hash_final(&hash, digest);
}

void pal_hash_buffer_hex(const void *data, size_t size, char *hex) {
    uint8_t digest[PALPATE_HASH_BYTES];
    pal_hash_buffer(data, size, digest);
    pal_hash_to_hex(digest, sizeof digest, hex);
}
