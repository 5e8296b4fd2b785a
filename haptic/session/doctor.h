/// @file doctor.h  Is this machine ready for a 1 kHz servo? One check per line (for `palpate
/// doctor`).
///
/// Everything is read from /proc, /sys, resource limits and a trial thread; nothing is changed.
#ifndef PALPATE_HAPTIC_DOCTOR_H
#define PALPATE_HAPTIC_DOCTOR_H

#include <stdint.h>

#include <palpate/status.h>

typedef enum pal_check_state {
    PALPATE_CHECK_OK = 0,
    PALPATE_CHECK_WARN = 1, ///< works, with worse lateness
    PALPATE_CHECK_FAIL = 2  ///< real time is refused
} pal_check_state;

typedef struct pal_check {
    char name[32];
    pal_check_state state;
    char found[160];
    char remedy[320]; ///< one line; "" when the state is ok
} pal_check;

enum { PALPATE_CHECKS_MAX = 16 };

/// Run all checks.
/// @param      root  directory standing for "/" in /proc and /sys paths; NULL or "": the machine
///                   itself (with another root the limits and the trial thread are still real)
/// @param[out] out   shape [PALPATE_CHECKS_MAX]
/// @return number of checks. Thread: any; starts and joins one short thread.
PALPATE_API int32_t pal_doctor(const char *root, pal_check out[PALPATE_CHECKS_MAX]);

/// Worst state: the program's exit status is 0 for ok and warn, 1 for fail.
PALPATE_API pal_check_state pal_doctor_worst(const pal_check check[], int32_t count);

PALPATE_API const char *pal_check_state_name(pal_check_state state); ///< "ok", "warn", "fail"

#endif
