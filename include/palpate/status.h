/// @file status.h  Status codes and the caller's error buffer.
///
/// Offline functions return a pal_status and, on failure, write one sentence into the caller's
/// pal_error: the thing, the value, the place and the remedy. Online (tick) functions never use
/// pal_error: they report a fault mask (engine.h).
#ifndef PALPATE_STATUS_H
#define PALPATE_STATUS_H

#ifdef __cplusplus
extern "C" {
#endif

/// Marks a symbol as part of the library's ABI; everything else is hidden.
#define PALPATE_API __attribute__((visibility("default")))

/// The one list of status codes: X(name, value, text). Negative is an error, 0 is success,
/// positive is success with a remark.
#define PALPATE_STATUS_LIST(X)                                                                     \
    X(PALPATE_OK, 0, "success")                                                                    \
    X(PALPATE_STALE, 1, "valid, but not built from the scene given")                               \
    X(PALPATE_ERROR_ARGUMENT, -1, "an argument is out of its documented range")                    \
    X(PALPATE_ERROR_MEMORY, -2, "out of memory")                                                   \
    X(PALPATE_ERROR_IO, -3, "a file could not be read or written")                                 \
    X(PALPATE_ERROR_SCENE, -4, "the scene is not valid")                                           \
    X(PALPATE_ERROR_GEOMETRY, -5, "the geometry cannot be used")                                   \
    X(PALPATE_ERROR_CLOUD, -6, "the node cloud could not be built")                                \
    X(PALPATE_ERROR_STENCIL, -7, "a moving-least-squares stencil is deficient")                    \
    X(PALPATE_ERROR_SINGULAR, -8, "a matrix is singular to working precision")                     \
    X(PALPATE_ERROR_CERTIFICATE, -9, "the model does not pass its certificate")                    \
    X(PALPATE_ERROR_FORMAT, -10, "the file is not a Palpate file")                                 \
    X(PALPATE_ERROR_VERSION, -11, "the file was written by a newer version")                       \
    X(PALPATE_ERROR_CHECKSUM, -12, "the file is corrupted")                                        \
    X(PALPATE_ERROR_TRUNCATED, -13, "the file is truncated")                                       \
    X(PALPATE_ERROR_CANCELLED, -14, "cancelled")                                                   \
    X(PALPATE_ERROR_UNSUPPORTED, -15, "not built yet")                                             \
    X(PALPATE_ERROR_NOT_FOUND, -16, "no such name")                                                \
    X(PALPATE_ERROR_SYSTEM, -17, "the operating system refused")                                   \
    X(PALPATE_ERROR_DEVICE, -18, "the haptic device failed")

typedef enum pal_status {
#define PALPATE_STATUS_ENUM(name, value, text) name = value,
    PALPATE_STATUS_LIST(PALPATE_STATUS_ENUM)
#undef PALPATE_STATUS_ENUM
} pal_status;

/// The caller's error buffer. Zero-initialise it; every `pal_error *` parameter may be NULL.
typedef struct pal_error {
    pal_status status;
    char message[1024]; ///< one sentence, UTF-8, no trailing newline; "" on success
} pal_error;

/// @return the enumerator's name, e.g. "PALPATE_ERROR_SCENE"; "unknown" for any other value.
/// Thread: any.
PALPATE_API const char *pal_status_name(pal_status status);

/// @return the one-line meaning from PALPATE_STATUS_LIST. Thread: any.
PALPATE_API const char *pal_status_text(pal_status status);

/// Library version as "major.minor.patch". Thread: any.
PALPATE_API const char *pal_version(void);

/// Progress and cancel callback of the offline stage, called from the calling thread at least
/// every 0.2 s or so of work.
/// @param stage     "cloud", "assemble", "factor", "solve", "certify", "write"
/// @param fraction  done part of this stage, 0..1 (negative: unknown)
/// @param seconds_left  estimate for this stage [s]; negative: unknown
/// @return 0 to go on, anything else to cancel (the call then returns PALPATE_ERROR_CANCELLED).
typedef int (*pal_progress_fn)(void *user, const char *stage, double fraction, double seconds_left);

typedef struct pal_progress {
    pal_progress_fn call; ///< NULL: no progress wanted
    void *user;
} pal_progress;

#ifdef __cplusplus
}
#endif
#endif
