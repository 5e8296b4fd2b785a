/// @file status.c  Status names and the error buffer.
#include <palpate/status.h>

#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
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

/// Put a text into the message. One that is too long loses its middle, which is somebody's endless
/// name: the place is at the start, the reason and the remedy are at the end.
static void put_message(pal_error *error, const char *text, size_t length) {
    static const char gap[] = "...";
    size_t room = sizeof error->message - 1;
    if (length <= room) {
        memcpy(error->message, text, length);
        error->message[length] = 0;
        return;
    }
    size_t head = room / 2 - sizeof gap + 1, tail = room - head - (sizeof gap - 1);
    while (head > 0 && ((unsigned char)text[head] & 0xC0) == 0x80) { // no character is torn
        head--;
    }
    while (tail > 0 && ((unsigned char)text[length - tail] & 0xC0) == 0x80) {
        tail--;
    }
    memcpy(error->message, text, head);
    memcpy(error->message + head, gap, sizeof gap - 1);
    memcpy(error->message + head + sizeof gap - 1, text + length - tail, tail);
    error->message[head + sizeof gap - 1 + tail] = 0;
}

static void format_message(pal_error *error, const char *format, va_list args) {
    va_list again;
    va_copy(again, args);
    int length = vsnprintf(error->message, sizeof error->message, format, args);
    if (length >= (int)sizeof error->message) {
        char *whole = malloc((size_t)length + 1);
        if (whole != NULL) { // else its start has to do
            (void)vsnprintf(whole, (size_t)length + 1, format, again);
            put_message(error, whole, (size_t)length);
            free(whole);
        }
    }
    va_end(again);
}

pal_status(pal_fail)(pal_error *error, pal_status status, const char *format, ...) {
    if (error != NULL) {
        va_list args;
        va_start(args, format);
        error->status = status;
        format_message(error, format, args);
        va_end(args);
    }
    return status;
}

pal_status(pal_fail_prefix)(pal_error *error, pal_status status, const char *format, ...) {
    if (error == NULL) {
        return status;
    }
    char old[sizeof error->message], both[2 * sizeof error->message + 2];
    memcpy(old, error->message, sizeof old);
    va_list args;
    va_start(args, format);
    format_message(error, format, args);
    va_end(args);
    int length = snprintf(both, sizeof both, "%s: %s", error->message, old);
    put_message(error, both, (size_t)length);
    error->status = status;
    return status;
}
