/// @file error.h  Filling the caller's error buffer (private to Palpate's own libraries).
#ifndef PALPATE_HAPTIC_ERROR_H
#define PALPATE_HAPTIC_ERROR_H

#include <palpate/status.h>

/// Write `status` and a printf message into `error` (may be NULL). @return status, so that
/// `return pal_fail(error, PALPATE_ERROR_X, "...")` reads well. Exported for libpalpate-offline.
PALPATE_API pal_status pal_fail(pal_error *error, pal_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/// Put "prefix: " in front of the message already there. @return error->status (or `status` if
/// NULL).
PALPATE_API pal_status pal_fail_prefix(pal_error *error, pal_status status, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

#if defined(__clang_analyzer__) || defined(PALPATE_ANALYZER)
/// Static analysers see one file at a time: tell them that the status given is the one returned.
static inline pal_status pal_told(pal_status said, pal_status status) {
    (void)said;
    return status;
}
#define pal_fail(error, status, ...) pal_told((pal_fail)(error, status, __VA_ARGS__), status)
#define pal_fail_prefix(error, status, ...)                                                        \
    pal_told((pal_fail_prefix)(error, status, __VA_ARGS__), status)
#endif

#endif
