/// @file protocol.h  What goes between the library and the helper process palpate-reader.
///
/// Standard input: one pal_reader_request; the surface file is open as descriptor
/// PALPATE_HELPER_FILE. Standard output: one pal_reader_reply, then position (3 vertex_count
/// doubles), then triangle (3 triangle_count int32). Both ends are the same build on the same
/// machine: the structs travel as they lie in memory, sizes and version checked.
#ifndef PALPATE_SRC_READER_PROTOCOL_H
#define PALPATE_SRC_READER_PROTOCOL_H

#include <stdint.h>

#define PALPATE_READER_MAGIC 0x3152444145524c50u /* "PLREADR1" */
enum { PALPATE_READER_VERSION = 1 };

typedef enum pal_reader_format {
    PALPATE_READER_OBJ,
    PALPATE_READER_STL,
    PALPATE_READER_PLY
} pal_reader_format;

typedef enum pal_reader_verdict {
    PALPATE_READER_DONE,
    PALPATE_READER_NO_SURFACE, ///< the file is none, `message` says why
    PALPATE_READER_BAD_GEOMETRY,
    PALPATE_READER_NO_MEMORY
} pal_reader_verdict;

typedef struct pal_reader_request {
    uint64_t magic;
    uint32_t version, size; ///< size: sizeof this struct
    int32_t format, in_order;
    int64_t file_bytes;
    int64_t memory_bytes; ///< may be taken beyond what the program itself takes
    int32_t cpu_seconds, reserved;
} pal_reader_request;

typedef struct pal_reader_reply {
    uint64_t magic;
    uint32_t version, size;
    int32_t verdict; ///< unless PALPATE_READER_DONE, `message` says why and nothing follows
    int32_t vertex_count, triangle_count, reserved;
    char message[512];
} pal_reader_reply;

#endif
