/// @file hash.h  BLAKE2b, incremental (private; exported for the offline library and the program).
///
/// Content hashes of scenes, checksums of files, golden hashes of forces. Not keyed.
/// Source: RFC 7693 (M-J. Saarinen, J-P. Aumasson, 2015).
#ifndef PALPATE_HAPTIC_HASH_H
#define PALPATE_HAPTIC_HASH_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

/// Bytes of the digest used throughout Palpate (BLAKE2b-256) and of its hex form with the NUL.
enum { PALPATE_HASH_BYTES = 32, PALPATE_HASH_HEX = 65, PALPATE_HASH_MAX_BYTES = 64 };

/// State of one hash; plain data, may be copied to fork a hash. One thread at a time.
typedef struct pal_hash {
    uint64_t state[8];
    uint64_t length[2]; ///< bytes compressed so far, 128 bit
    uint8_t block[128]; ///< input not yet compressed
    size_t fill;        ///< bytes in `block`
    size_t digest_size;
} pal_hash;

/// Start a hash of `digest_size` bytes, 1 .. PALPATE_HASH_MAX_BYTES (clamped to that range).
PALPATE_API void pal_hash_init(pal_hash *hash, size_t digest_size);

/// Add `size` bytes; `data` may be NULL when size is 0.
PALPATE_API void pal_hash_update(pal_hash *hash, const void *data, size_t size);

/// End the hash. @param[out] digest  shape [digest_size]. The state is spent (init it again).
PALPATE_API void pal_hash_final(pal_hash *hash, uint8_t *digest);

/// `size` bytes as lower-case hex. @param[out] hex  shape [2 size + 1]
PALPATE_API void pal_hash_to_hex(const uint8_t *bytes, size_t size, char *hex);

/// BLAKE2b-256 of one buffer. @param[out] digest  shape [PALPATE_HASH_BYTES]
PALPATE_API void pal_hash_buffer(const void *data, size_t size, uint8_t *digest);

/// BLAKE2b-256 of one buffer as hex. @param[out] hex  shape [PALPATE_HASH_HEX]
PALPATE_API void pal_hash_buffer_hex(const void *data, size_t size, char *hex);

#endif
