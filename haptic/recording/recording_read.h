/// @file recording_read.h  Reading raw recordings, item by item and checked (private).
#ifndef PALPATE_HAPTIC_RECORDING_READ_H
#define PALPATE_HAPTIC_RECORDING_READ_H

#include "haptic/recording/recording.h"

/// A raw file open for reading. Items are taken in order; damaged ones are skipped and counted.
typedef struct pal_raw_reader {
    int fd;
    int64_t begin;     ///< offset of item 0
    int64_t item_size; ///< with its checksum
    uint64_t items;    ///< whole items in the file
    uint64_t next;     ///< next item to read
    uint64_t tail;     ///< 1: the file ends inside an item
    uint64_t bad;      ///< skipped so far, the tail included
} pal_raw_reader;

/// Open PATH.ticks and check its header.
/// @return _OK; _IO, _FORMAT, _VERSION, _TRUNCATED, _CHECKSUM
pal_status pal_raw_open_ticks(const char *name, pal_ticks_header *header, pal_raw_reader *reader,
                              pal_error *error);
/// Open PATH.frames; `surface` gets the rest block (malloc'd: doubles, then triangles).
pal_status pal_raw_open_frames(const char *name, pal_frames_header *header, char **surface,
                               pal_raw_reader *reader, pal_error *error);
void pal_raw_close(pal_raw_reader *reader);

/// Read up to `capacity` good items, without their checksums, packed at item_size - 8 bytes each.
/// @param[out] count  items read; 0 at the end. @return _OK, _IO, _MEMORY
pal_status pal_raw_read(pal_raw_reader *reader, void *out, int64_t capacity, int64_t *count,
                        pal_error *error);
/// Start again at item 0.
void pal_raw_rewind(pal_raw_reader *reader);

#endif
