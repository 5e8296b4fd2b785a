/// BLAKE2b against RFC 7693's vector, an independent implementation (CPython's hashlib.blake2b),
/// and itself fed in pieces.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#include <cmocka.h>

#include "haptic/base/hash.h"

static void rfc_7693_appendix_a(void **state) {
    (void)state;
    uint8_t digest[64];
    char hex[129];
    pal_hash h;
    pal_hash_init(&h, 64);
    pal_hash_update(&h, "abc", 3);
    pal_hash_final(&h, digest);
    pal_hash_to_hex(digest, sizeof digest, hex);
    assert_string_equal(hex, "ba80a53f981c4d0d6a2797b69f12f6e94c212f14685ac4b74b12bb6fdbffa2d1"
                             "7d87c5392aab792dc252d5de4533cc9518d38aa8dbf1925ab92386edd4009923");
}

/// byte i of the message is (7 i + 3) mod 256; digests of 32 bytes by hashlib.blake2b
static const struct {
    size_t size;
    const char *hex;
} vectors[] = {
    {0, "0e5751c026e543b2e8ab2eb06099daa1d1e5df47778f7787faab45cdf12fe3a8"},
    {1, "e88bd757ad5b9bedf372d8d3f0cf6c962a469db61a265f6418e1ffed86da29ec"},
    {127, "c9ae3859964b35f04c54b36d33cf299d7290ee621005d28e51598a943560aaaa"},
    {128, "f0501d06597880592bc49234eef100ec1ff349058d0e9d9b753504e24af86dd6"},
    {129, "a34a4e1e03c541dfbf3099c4b6c143c022ced65c28bd7e8a10e0a098461aecf0"},
    {255, "f2d64a40e9412a3414161ff6250075225418fd7c271c1123e162e1bca0de9f93"},
    {256, "d93ebb9c802f5630ab22516fd82b6c21bc8bd551d531349b715f046ed11ed871"},
    {257, "4ce481b24d387422d2bc2baa03d1afd55a1327939ff537c71eb9b38709268649"},
    {1000, "d62b6c768ce1afc8367e0498ab2f8e3f7c178c35b1429f14c4604b545d200f52"},
};

static void block_edges_match_hashlib(void **state) {
    (void)state;
    uint8_t message[1000];
    for (size_t i = 0; i < sizeof message; i++) {
        message[i] = (uint8_t)(7 * i + 3);
    }
    for (size_t k = 0; k < sizeof vectors / sizeof *vectors; k++) {
        char hex[PALPATE_HASH_HEX];
        pal_hash_buffer_hex(message, vectors[k].size, hex);
        assert_string_equal(hex, vectors[k].hex);
    }
}

/// RFC 7693 appendix E's sequence; its unkeyed half hashed over all digest sizes and lengths there,
/// the expected grand hash by hashlib.blake2b.
static void rfc_7693_appendix_e_unkeyed(void **state) {
    (void)state;
    static const size_t digest_sizes[] = {20, 32, 48, 64};
    static const size_t lengths[] = {0, 3, 128, 129, 255, 1024};
    pal_hash grand;
    pal_hash_init(&grand, 32);
    for (int d = 0; d < 4; d++) {
        for (int n = 0; n < 6; n++) {
            uint8_t message[1024], digest[64];
            uint32_t a = 0xDEAD4BADu * (uint32_t)lengths[n], b = 1;
            for (size_t i = 0; i < lengths[n]; i++) {
                uint32_t t = a + b;
                a = b;
                b = t;
                message[i] = (uint8_t)(t >> 24);
            }
            pal_hash h;
            pal_hash_init(&h, digest_sizes[d]);
            pal_hash_update(&h, message, lengths[n]);
            pal_hash_final(&h, digest);
            pal_hash_update(&grand, digest, digest_sizes[d]);
        }
    }
    uint8_t digest[32];
    char hex[PALPATE_HASH_HEX];
    pal_hash_final(&grand, digest);
    pal_hash_to_hex(digest, 32, hex);
    assert_string_equal(hex, "681f345ad53c6360214ea500fd259edddbca775f605fad81b9b189d6d88e15c6");
}

static void pieces_give_the_same_hash(void **state) {
    (void)state;
    uint8_t message[1000], whole[32], pieces[32];
    for (size_t i = 0; i < sizeof message; i++) {
        message[i] = (uint8_t)(i * i);
    }
    pal_hash_buffer(message, sizeof message, whole);
    for (size_t step = 1; step <= 300; step += 7) {
        pal_hash h;
        pal_hash_init(&h, 32);
        for (size_t at = 0; at < sizeof message; at += step) {
            size_t n = sizeof message - at < step ? sizeof message - at : step;
            pal_hash_update(&h, message + at, n);
            pal_hash_update(&h, NULL, 0);
        }
        pal_hash_final(&h, pieces);
        assert_memory_equal(whole, pieces, sizeof whole);
    }
}

static void digest_size_is_clamped(void **state) {
    (void)state;
    uint8_t a[64], b[64];
    pal_hash h, g;
    pal_hash_init(&h, 1000);
    pal_hash_init(&g, 64);
    pal_hash_final(&h, a);
    pal_hash_final(&g, b);
    assert_memory_equal(a, b, 64);
    pal_hash_init(&h, 0);
    assert_int_equal(h.digest_size, 1);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(rfc_7693_appendix_a),         cmocka_unit_test(block_edges_match_hashlib),
        cmocka_unit_test(rfc_7693_appendix_e_unkeyed), cmocka_unit_test(pieces_give_the_same_hash),
        cmocka_unit_test(digest_size_is_clamped),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
