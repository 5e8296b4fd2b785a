/// @file reader_client.h  Start palpate-reader, hand it a surface file, get triangles back.
#ifndef PALPATE_SRC_READER_CLIENT_H
#define PALPATE_SRC_READER_CLIENT_H

#include "src/base/helper.h"
#include "src/reader/protocol.h"
#include "src/geometry/surface.h"

#define PALPATE_READER_FILE_MAX ((int64_t)1 << 30)

/// What the process may take beyond what it takes by itself.
typedef struct pal_reader_limits {
    int64_t memory_bytes;
    int32_t cpu_seconds, seconds; ///< of its own time; on the clock, after which it is ended
} pal_reader_limits;

/// Generous for an honest file of that size: Assimp takes some 10 to 30 bytes per byte of a file
/// and reads 10 MB/s or more.
pal_reader_limits pal_reader_default_limits(int64_t file_bytes);

/// Read a surface file that is open at its beginning.
/// @param in_order  1: PLY vertices numbered as in the file
/// @return PALPATE_OK; _IO (it is no surface, or reading it killed the reader), _GEOMETRY, _MEMORY,
///         _SYSTEM (the reader could not be started, or was ended for taking too long)
pal_status pal_reader_import(int file, int64_t file_bytes, pal_reader_format format, int in_order,
                             const pal_reader_limits *limits, pal_surface *out, pal_error *error);

/// The exchange with a running child (for tests: with anything that answers).
/// @param[out] out  cleared by the caller, also on failure
/// @return as pal_reader_import; _TRUNCATED without a message: it is gone
pal_status pal_reader_converse(pal_helper *h, const pal_reader_request *request, pal_surface *out,
                               pal_error *error);

#endif
