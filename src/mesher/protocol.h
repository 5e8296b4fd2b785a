/// @file protocol.h  What goes between the library and the helper process palpate-mesher.
///
/// Standard input: one pal_mesher_request, then position (3 vertex_count doubles), triangle
/// (3 triangle_count int32), source (source_count pal_mesher_source). Standard output: one
/// pal_mesher_reply, then the coordinates of the inside nodes (3 inside_count doubles) and tet
/// (4 tet_count int32; nodes below vertex_count are the request's vertices in their order).
/// Standard error: lines "progress F" with F in 0..1. Both ends are the same build on the same
/// machine: the structs travel as they lie in memory, sizes and version checked.
#ifndef PALPATE_SRC_MESHER_PROTOCOL_H
#define PALPATE_SRC_MESHER_PROTOCOL_H

#include <stdint.h>

#define PALPATE_MESHER_MAGIC 0x31524853454d4c50u /* "PLMESHR1" */
enum { PALPATE_MESHER_VERSION = 1, PALPATE_MESHER_COUNT_MAX = 1 << 26 };

typedef struct pal_mesher_source {
    double a[3], b[3], radius, spacing;
} pal_mesher_source;

typedef struct pal_mesher_request {
    uint64_t magic;
    uint32_t version, size; ///< size: sizeof this struct
    int32_t vertex_count, triangle_count, source_count, reserved;
    double cap, grading;
} pal_mesher_request;

typedef struct pal_mesher_reply {
    uint64_t magic;
    uint32_t version, size;
    int32_t status; ///< 0: done; else `message` says why and nothing follows
    int32_t inside_count, tet_count, reserved;
    char message[512];
} pal_mesher_reply;

#endif
