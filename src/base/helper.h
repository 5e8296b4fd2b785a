/// @file helper.h  A helper process: found, started, talked with, reaped (private to src/).
///
/// What may crash on its input or must not be linked lives in a process of its own: palpate-mesher
/// (Gmsh) and palpate-reader (Assimp). Its death is an error message, never ours.
#ifndef PALPATE_SRC_HELPER_H
#define PALPATE_SRC_HELPER_H

#include <stddef.h>
#include <stdint.h>
#include <sys/types.h>

#include <palpate/status.h>

enum { PALPATE_HELPER_FILE = 3 }; ///< where the child finds the file it was given

typedef struct pal_helper_kind {
    const char *name, *variable; ///< the program; the environment variable that names another one
} pal_helper_kind;

typedef struct pal_helper {
    const pal_helper_kind *kind;
    pid_t child;         ///< <= 0: none
    int channel, log;    ///< socket to the child; read end of its standard error
    int seconds;         ///< given to the whole exchange; 0: no end
    int64_t deadline_ns; ///< CLOCK_MONOTONIC
    char line[256];      ///< the line of standard error being read
    size_t line_length;
    char last[400]; ///< last line that was not progress, printable
    double fraction;
} pal_helper;

/// Where the program is: its variable, else next to this library or program, else
/// ../libexec/palpate.
/// @return PALPATE_OK; _SYSTEM
pal_status pal_helper_path(const pal_helper_kind *kind, char *path, size_t size, pal_error *error);

/// Start it. @param file  becomes descriptor PALPATE_HELPER_FILE of the child; -1: none. Not 0,
/// 1, 2.
/// @param seconds  until transfers fail; 0: never. @return PALPATE_OK; _SYSTEM
pal_status pal_helper_start(pal_helper *h, const pal_helper_kind *kind, int file, int seconds,
                            pal_error *error);

/// Move `size` bytes: out of `from` (sending) or into `to` (receiving), whichever is not NULL.
/// @return PALPATE_OK; _TRUNCATED without a message: the child is gone; _CANCELLED, _SYSTEM (late)
pal_status pal_helper_transfer(pal_helper *h, const void *from, void *to, size_t size,
                               const pal_progress *progress, pal_error *error);

/// Receive `size` bytes into memory that grows with what arrives, not with what was announced.
/// @param[out] data  malloc'd, at least one byte; NULL on failure. @return as _transfer; _MEMORY
pal_status pal_helper_receive(pal_helper *h, size_t size, const pal_progress *progress, void **data,
                              pal_error *error);

/// Close, end the child if it still runs (when `kill_it`), reap it. @return its wait status
int pal_helper_finish(pal_helper *h, int kill_it);

/// How it ended, as a sentence: name, signal or exit status, its last words.
void pal_helper_fate(const pal_helper *h, int state, char *text, size_t size);

/// End a text from outside with a NUL and make its control characters '?'.
void pal_helper_printable(char *text, size_t size);

#endif
