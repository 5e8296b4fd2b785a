/// @file status.c  Status names and the error buffer.
#include <palpate/status.h>

#include <stdarg.h>
#include <stdio.h>
#include <string.h>

#include "haptic/base/error.h"

const char *pal_status_name(pal_status status) {
    switch (status) {
#define PALPATE_STATUS_CASE(name, value, text)                                                     \
    case name:                                                                                     \
        return #name;
        PALPATE_STATUS_LIST(PALPATE_STATUS_CASE)
#undef PALPATE_STATUS_CASE
    }
    return "unknown";
}

const char *pal_status_text(pal_status status) {
    switch (status) {
#define PALPATE_STATUS_CASE(name, value, text)                                                     \
    case name:                                                                                     \
        return text;
        PALPATE_STATUS_LIST(PALPATE_STATUS_CASE)
#undef PALPATE_STATUS_CASE
    }
    return "unknown status";
}

const char *pal_version(void) {
    return PALPATE_VERSION;
}

pal_status(pal_fail)(pal_error *error, pal_status status, const char *format, ...) {
    if (error != NULL) {
        va_list args;
        va_start(args, format);
        error->status = status;
        (void)vsnprintf(error->message, sizeof error->message, format, args);
        va_end(args);
    }
    return status;
}

pal_status(pal_fail_prefix)(pal_error *error, pal_status status, const char *format, ...) {
    if (error == NULL) {
        return status;
    }
    char old[sizeof error->message];
    char prefix[sizeof error->message];
    memcpy(old, error->message, sizeof old);
    va_list args;
    va_start(args, format);
    (void)vsnprintf(prefix, sizeof prefix, format, args);
    va_end(args);
    size_t n = strlen(prefix);
    memcpy(error->message, prefix, n);
    if (n + 3 < sizeof error->message) {
        (void)snprintf(error->message + n, sizeof error->message - n, ": %.*s",
                       (int)(sizeof error->message - n - 3), old);
    }
    error->status = status;
    return status;
}
