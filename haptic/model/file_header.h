/// @file file_header.h  The sealed file: header in the user block, checksum gate, atomic writing
/// (private; exported).
///
/// Every Palpate file (model, recording) is an HDF5 file whose user block starts with this header,
/// all numbers little endian:
///
///     0   8  magic 89 'P' 'A' 'L' 'P' 0D 0A 1A   (as PNG's: survives no text conversion unnoticed)
///     8   8  kind, NUL-padded: "MODEL", "RECORD"
///    16   4  format version of that kind
///    20   4  size of the user block (512 or a larger power of two)
///    24   8  total size of the file
///    32  32  BLAKE2b-256 of bytes 96 .. total size
///    64  32  BLAKE2b-256 of bytes 0 .. 63
///    96      zero up to the end of the user block, then HDF5
///
/// The header's layout is fixed for all versions. Nothing behind it is looked at before both
/// checksums hold, so that an HDF5 library never parses damaged bytes. The checksums find damage,
/// not malice.
#ifndef PALPATE_HAPTIC_FILE_HEADER_H
#define PALPATE_HAPTIC_FILE_HEADER_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

enum { PALPATE_USER_BLOCK = 512, PALPATE_HEADER_BYTES = 96 };

typedef enum pal_file_kind { PALPATE_FILE_MODEL = 0, PALPATE_FILE_RECORDING = 1 } pal_file_kind;

/// Write the header into an image whose user block (PALPATE_USER_BLOCK bytes) is still zero.
/// @return PALPATE_OK; _ARGUMENT when the image is smaller than the user block
PALPATE_API pal_status pal_file_seal(pal_file_kind kind, uint32_t version, void *image,
                                     size_t size);

/// The same for a file on disk, in place: reads it once, writes the header, fsyncs.
PALPATE_API pal_status pal_file_seal_path(pal_file_kind kind, uint32_t version, const char *path,
                                          pal_error *error);

/// Check a whole image: kind, version <= `newest`, sizes, checksums. @param name  for messages
/// @return PALPATE_OK; _FORMAT, _VERSION, _TRUNCATED, _CHECKSUM
PALPATE_API pal_status pal_file_verify(pal_file_kind kind, uint32_t newest, const void *image,
                                       size_t size, const char *name, pal_error *error);

/// The same for a file on disk, read in pieces (files larger than memory).
PALPATE_API pal_status pal_file_verify_path(pal_file_kind kind, uint32_t newest, const char *path,
                                            pal_error *error);

/// Read a whole file into memory and verify it. The header is verified before anything is allocated
/// by its word, and never more than the file's size is.
/// @param[out] image  to be freed by the caller
/// @return as pal_file_verify; _IO (not a regular file, unreadable), _MEMORY
PALPATE_API pal_status pal_file_load(pal_file_kind kind, uint32_t newest, const char *path,
                                     void **image, size_t *size, pal_error *error);

/// Write bytes as `path` so that a reader sees the old file or the whole new one: temporary file in
/// the same directory, fsync, rename, fsync of the directory. On failure the temporary is removed
/// and an older `path` is untouched. A symbolic link at `path` is replaced, not followed; anything
/// else that is not a regular file is refused.
/// @param mode  permissions before the umask, e.g. 0666 or 0600
/// @return PALPATE_OK; _IO, _MEMORY
PALPATE_API pal_status pal_file_save(const char *path, const void *data, size_t size, unsigned mode,
                                     pal_error *error);

/// Make the directory entry of `path` durable. @return 0 or errno
PALPATE_API int pal_file_sync_directory(const char *path);

#endif
