/// @file h5.h  The one place that knows HDF5: typed datasets with checked dimensions (private;
/// exported).
///
/// A pal_h5 is one open HDF5 file: an image in memory (models) or a file on disk (recordings).
/// Paths are "/group/name"; parents are created on writing. Every number is stored little endian in
/// its own type, contiguous, unfiltered, with the attributes "unit" and "description", so that
/// h5dump reads like a document; every text is a fixed-length string. Reading accepts exactly that:
/// type, rank and dimensions must match, links must be hard, storage contiguous and complete, and
/// nothing larger than the file itself is allocated or read.
///
/// HDF5 keeps global state and its serial build need not be thread-safe, so every call takes one
/// mutex for its duration (never across calls); handles may be used from any thread, one thread at
/// a time. HDF5's own error printing is silenced during each call; its innermost message goes into
/// pal_error. Not for the servo thread. A host that uses HDF5 itself on other threads at the same
/// time needs a thread-safe build of it (Debian's is).
#ifndef PALPATE_HAPTIC_H5_H
#define PALPATE_HAPTIC_H5_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_h5 pal_h5;

typedef enum pal_h5_type {
    PALPATE_H5_U8,
    PALPATE_H5_I16,
    PALPATE_H5_I32,
    PALPATE_H5_U32,
    PALPATE_H5_I64,
    PALPATE_H5_U64,
    PALPATE_H5_F16, ///< IEEE binary16, as uint16_t in memory
    PALPATE_H5_F32,
    PALPATE_H5_F64
} pal_h5_type;

enum { PALPATE_H5_RANK_MAX = 4, PALPATE_H5_PATH_MAX = 128 };

/// Bytes of one element.
PALPATE_API size_t pal_h5_type_size(pal_h5_type type);

// ---- Files --------------------------------------------------------------------------------------

/// Start a new file whose first `user_block` bytes (0, or a power of two from 512) are left to the
/// caller. @param path  created or truncated on disk; NULL: kept in memory until pal_h5_take_image
/// @param expected  bytes it will hold, roughly: sizes the first allocation of an image
/// @return PALPATE_OK; _MEMORY, _IO
PALPATE_API pal_status pal_h5_create(const char *path, size_t user_block, size_t expected,
                                     pal_h5 **out, pal_error *error);

/// Close a file made with path NULL and hand over its bytes (user block zero), to be freed by the
/// caller. The handle is gone afterwards, whatever is returned.
PALPATE_API pal_status pal_h5_take_image(pal_h5 *file, void **image, size_t *size,
                                         pal_error *error);

/// Open an image for reading, in place: `image` must stay valid and unchanged until pal_h5_close.
/// @return PALPATE_OK; _FORMAT when HDF5 cannot read it, _MEMORY
PALPATE_API pal_status pal_h5_open_image(const void *image, size_t size, pal_h5 **out,
                                         pal_error *error);

/// Open a file on disk for reading. @return PALPATE_OK; _IO, _FORMAT, _MEMORY
PALPATE_API pal_status pal_h5_open_file(const char *path, pal_h5 **out, pal_error *error);

/// Close; on a written file, flush to the system. NULL is allowed. @return PALPATE_OK or _IO
PALPATE_API pal_status pal_h5_close(pal_h5 *file, pal_error *error);

// ---- Writing ------------------------------------------------------------------------------------

/// Describe a group (or "/"): attribute "description".
PALPATE_API pal_status pal_h5_describe(pal_h5 *file, const char *group, const char *description,
                                       pal_error *error);

/// Declare a dataset of fixed size and write none of it yet; rank 0 is a scalar.
/// @param dims  shape [rank], slowest first; zeros are allowed
PALPATE_API pal_status pal_h5_declare(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                                      const int64_t dims[], const char *unit,
                                      const char *description, pal_error *error);

/// Write `count` rows (slowest dimension) from `first` on into a declared dataset.
/// @param ld  elements from one row to the next in `data`; 0: packed. Only rank 1 and 2 may set it.
PALPATE_API pal_status pal_h5_write_rows(pal_h5 *file, const char *path, pal_h5_type type,
                                         int64_t first, int64_t count, int64_t ld, const void *data,
                                         pal_error *error);

/// Declare and write at once, packed.
PALPATE_API pal_status pal_h5_write(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                                    const int64_t dims[], const void *data, const char *unit,
                                    const char *description, pal_error *error);

/// A text (UTF-8, NUL-terminated) as a scalar fixed-length string.
PALPATE_API pal_status pal_h5_write_text(pal_h5 *file, const char *path, const char *text,
                                         const char *description, pal_error *error);

// ---- Reading ------------------------------------------------------------------------------------

/// Is there a hard link at `path`? Parents too.
PALPATE_API int pal_h5_has(pal_h5 *file, const char *path);

/// Dimensions of a dataset of that type and rank. @return PALPATE_OK; _FORMAT with what was found
PALPATE_API pal_status pal_h5_dims(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                                   int64_t dims[], pal_error *error);

/// Read a whole dataset, which must have exactly this type, rank and dimensions, packed.
PALPATE_API pal_status pal_h5_read(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                                   const int64_t dims[], void *data, pal_error *error);

/// Read `count` rows from `first` on of a dataset with these dimensions; `ld` as for writing.
PALPATE_API pal_status pal_h5_read_rows(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                                        const int64_t dims[], int64_t first, int64_t count,
                                        int64_t ld, void *data, pal_error *error);

/// Read a text into `text` (NUL-terminated). @return PALPATE_OK; _FORMAT when it needs more than
/// `size` bytes or has a NUL inside
PALPATE_API pal_status pal_h5_read_text(pal_h5 *file, const char *path, char *text, size_t size,
                                        pal_error *error);

/// Bytes a text needs, NUL included; at most the file's size.
PALPATE_API pal_status pal_h5_text_size(pal_h5 *file, const char *path, size_t *size,
                                        pal_error *error);

#endif
