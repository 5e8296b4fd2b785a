/// @file targets.c  Where a command will write, looked at before the work begins (see targets.h).
#include "haptic/program/targets.h"

#include <errno.h>
#include <limits.h>
#include <stdio.h>
#include <string.h>
#include <strings.h>
#include <sys/stat.h>
#include <unistd.h>

#include "haptic/base/error.h"

/// Files grow in "NAME.PID.tmp", "NAME.ticks" and so on beside NAME: room for the longest ending.
enum { ENDING_MAX = 32 };

/// Has `path` one of the endings in `kinds`, with a name before it?
static int has_kind(const char *base, const char *kinds) {
    size_t length = strlen(base);
    for (const char *at = kinds; *at != '\0';) {
        size_t n = strcspn(at, " ");
        if (length > n && strncasecmp(base + length - n, at, n) == 0) {
            return 1;
        }
        at += n + (at[n] == ' ');
    }
    return 0;
}

/// The folder must be there and take files.
static pal_status check_folder(const char *option, const char *path, size_t folder_length,
                               pal_error *error) {
    char folder[PATH_MAX];
    struct stat found;
    (void)snprintf(folder, sizeof folder, "%.*s", (int)folder_length, path);
    if (folder_length == 0) {
        (void)snprintf(folder, sizeof folder, "%s", path[0] == '/' ? "/" : ".");
    }
    if (stat(folder, &found) != 0) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s %.300s: its folder %.300s: %s; make it first",
                        option, path, folder, strerror(errno));
    }
    if (!S_ISDIR(found.st_mode)) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s %.300s: %.300s is not a folder; choose another place", option, path,
                        folder);
    }
    if (access(folder, W_OK | X_OK) != 0) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s %.300s: nothing can be written into %.300s: %s; choose another place",
                        option, path, folder, strerror(errno));
    }
    return PALPATE_OK;
}

pal_status target_check(const char *option, const char *path, const char *kinds, const char *source,
                        pal_error *error) {
    if (path == NULL) {
        return PALPATE_OK;
    }
    const char *slash = strrchr(path, '/'), *base = slash != NULL ? slash + 1 : path;
    if (base[0] == '\0') {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "%s '%s': not the name of a file", option,
                        path);
    }
    if (strlen(path) >= PATH_MAX - ENDING_MAX || strlen(base) > NAME_MAX - ENDING_MAX) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "%s %.64s...: the name is too long (%zu bytes); shorten it", option, path,
                        strlen(path));
    }
    struct stat found, read;
    if (stat(path, &found) == 0) {
        if (S_ISDIR(found.st_mode)) {
            return pal_fail(error, PALPATE_ERROR_IO,
                            "%s %.300s: a folder; give the name of a file in it", option, path);
        }
        if (!S_ISREG(found.st_mode)) { // the finished file is renamed over it
            return pal_fail(error, PALPATE_ERROR_IO,
                            "%s %.300s: exists and is not a regular file; choose another name",
                            option, path);
        }
        if (source != NULL && stat(source, &read) == 0 && found.st_dev == read.st_dev &&
            found.st_ino == read.st_ino) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "%s %.300s: would overwrite what is read; choose another name", option,
                            path);
        }
    }
    if (kinds != NULL && !has_kind(base, kinds)) {
        const char *space = strchr(kinds, ' ');
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "%s %.300s: a name that ends in %.*s is needed: that is what is written",
                        option, path, space != NULL ? (int)(space - kinds) : (int)strlen(kinds),
                        kinds);
    }
    return check_folder(option, path, slash != NULL ? (size_t)(slash - path) : 0, error);
}
