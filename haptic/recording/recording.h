/// @file recording.h  The raw recording on disk and its writer (private).
///
/// While a session runs, two append-only files grow beside the recording's path:
///   PATH.ticks   header (PALPATE_TICKS_HEADER bytes), then one fixed-size item per tick and tool:
///                pal_tick_record and a checksum
///   PATH.frames  header (PALPATE_FRAMES_HEADER bytes), the rest surface (positions as doubles,
///                triangles as int32, padded to 8 bytes, checksum), then one fixed-size item per
///                frame: pal_frame_head, displacement of the surface rows in single precision
///                (padded to 8 bytes), checksum
/// Numbers are little endian. A checksum is the first 8 bytes of BLAKE2b over what precedes it in
/// its item and the item's own number, so a torn, stale or misplaced item is recognised. Items lost
/// to a full disk leave no hole; their tick numbers are missing.
///
/// Durability: the recorder thread hands items to the kernel every 10 ms (what a killed process can
/// lose) and to the disk every second, at once when a fault begins (at most ten times a second) and
/// at the end (what a power cut can lose).
#ifndef PALPATE_HAPTIC_RECORDING_H
#define PALPATE_HAPTIC_RECORDING_H

#include <stdint.h>
#include <stdio.h>

#include <palpate/session.h>

#include "haptic/model/h5.h"
#include "haptic/base/hash.h"

enum {
    PALPATE_RECORDING_VERSION = 3,
    PALPATE_TICKS_HEADER = 16384,
    PALPATE_FRAMES_HEADER = 512,
    PALPATE_RECORDING_PATH = 4096
};
#define PALPATE_TICKS_MAGIC "PALTICKS"
#define PALPATE_FRAMES_MAGIC "PALFRAME"
#define PALPATE_RECORDING_ENDIAN 0x01020304u

typedef struct pal_ticks_header {
    char magic[8];
    uint32_t endian, version, header_bytes, item_bytes, tool_bytes;
    int32_t tool_count;
    int32_t complete; ///< 1 once the run ended in order
    int32_t max_contacts;
    int64_t period_ns;
    int64_t started_s; ///< wall clock, seconds since 1970
    uint64_t records, lost;
    double device_scale;
    double period; ///< as the engine has it [s]; period_ns is rounded
    pal_pose body_pose, device_to_world;
    pal_watchdog_def watchdog;
    int32_t freewheel;
    int32_t contact; ///< 0: law "nodes" (all there was once); else "surface", points << 8 | 1
    char model_hash[72];
    char model_method[32];
    char model_provenance[512];
    char program[64];
    pal_tool_def tool[PALPATE_TOOLS_MAX];
} pal_ticks_header;
_Static_assert(sizeof(pal_ticks_header) + 8 <= PALPATE_TICKS_HEADER, "tick header must fit");

typedef struct pal_tick_item {
    pal_tick_record record;
    uint64_t check;
} pal_tick_item;
_Static_assert(sizeof(pal_tick_item) == 248, "item layout is a file format");

typedef struct pal_frames_header {
    char magic[8];
    uint32_t endian, version, header_bytes, reserved;
    int64_t item_bytes;
    int32_t row_count, triangle_count, tool_count, complete;
    double rate; ///< [Hz]
    uint64_t frames, lost;
} pal_frames_header;
_Static_assert(sizeof(pal_frames_header) + 8 <= PALPATE_FRAMES_HEADER, "frame header must fit");

typedef struct pal_frame_head {
    uint64_t tick;
    int64_t time_ns;
    pal_pose tool_pose[PALPATE_TOOLS_MAX];
    pal_tool_force tool_force[PALPATE_TOOLS_MAX];
} pal_frame_head;

/// Bytes of the rest surface block without its checksum, and of one frame item with it.
static inline int64_t pal_frames_static_bytes(int32_t rows, int32_t triangles) {
    return (24 * (int64_t)rows + 12 * (int64_t)triangles + 7) / 8 * 8;
}
static inline int64_t pal_frames_item_bytes(int32_t rows) {
    return (int64_t)sizeof(pal_frame_head) + (12 * (int64_t)rows + 7) / 8 * 8 + 8;
}

/// Checksum of `size` bytes that are item `number` of their file.
static inline uint64_t pal_item_check(const void *data, size_t size, uint64_t number) {
    pal_hash hash;
    uint64_t check = 0;
    pal_hash_init(&hash, sizeof check);
    pal_hash_update(&hash, data, size);
    pal_hash_update(&hash, &number, sizeof number);
    pal_hash_final(&hash, (uint8_t *)&check);
    return check;
}
enum { PALPATE_HEADER_NUMBER = -1, PALPATE_STATIC_NUMBER = -2 }; ///< "numbers" of headers, surface

/// PATH + suffix into `out`. @return _OK, or _ARGUMENT when it is too long
pal_status pal_recording_name(const char *path, const char *suffix,
                              char out[PALPATE_RECORDING_PATH], pal_error *error);

/// One member of pal_tick_record as a dataset of the finished file.
typedef struct pal_tick_field {
    const char *path;
    size_t offset; ///< in pal_tick_record
    pal_h5_type type;
    int width; ///< numbers per row; 1: a vector of numbers
    const char *unit, *description;
} pal_tick_field;
extern const pal_tick_field pal_tick_field_list[];
extern const int pal_tick_field_count;

/// ---- Writer ----------------------------------------------------------------------------------

/// An append-only file of fixed-size items. A failed write loses the items it was for, is counted,
/// and the next one is tried again at the same place: the file stays a row of whole items.
typedef struct pal_item_file {
    int fd;
    int64_t end; ///< where the next item goes
    uint64_t items, lost;
    int first_errno; ///< of the first failed write; 0: none
} pal_item_file;

/// Append `count` items of `size` bytes. Never fails: counts.
void pal_item_append(pal_item_file *file, const void *item, size_t size, int64_t count);

/// Fill the tick file's header from a session's definition.
void pal_ticks_header_fill(pal_ticks_header *header, const pal_model *model,
                           const pal_session_def *def);

/// Create `name` (must not exist) and write its header. @return _OK, _IO
pal_status pal_ticks_create(const char *name, const pal_ticks_header *header, pal_item_file *file,
                            pal_error *error);
/// Rewrite the header at its place with the counts and `complete`. @return 0 or errno
int pal_ticks_finish(pal_item_file *file, pal_ticks_header *header);

#endif
