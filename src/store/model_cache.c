/// @file model_cache.c  Where built models are kept between runs, and whom to trust there.
///
/// A model decides what force a hand feels, so one that another user could have put there is not
/// loaded: directory and file must belong to the effective user and be writable by nobody else, and
/// neither may be a symbolic link. Files are named by content hash and replaced by atomic rename.
/// Thread: any; other processes may use the same cache at the same time.
#include "src/store/model_cache.h"

#include <dirent.h>
#include <errno.h>
#include <fcntl.h>
#include <pwd.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <palpate/precompute.h>

#include "haptic/base/error.h"
#include "haptic/base/hash.h"
#include "haptic/model/model.h"

static const char remedy[] = "set PALPATE_CACHE to a directory of your own";

/// The path by the environment, nothing created yet. @return 0 when it does not fit
static int choose_directory(char *path, size_t size) {
    const char *own = getenv("PALPATE_CACHE"), *xdg = getenv("XDG_CACHE_HOME"),
               *home = getenv("HOME");
    int n;
    if (own != NULL && own[0] != 0) {
        n = snprintf(path, size, "%s", own);
    } else if (xdg != NULL && xdg[0] == '/') { // the specification says to ignore relative ones
        n = snprintf(path, size, "%s/palpate", xdg);
    } else {
        char buffer[4096];
        struct passwd entry, *found = NULL;
        if ((home == NULL || home[0] != '/') &&
            getpwuid_r(geteuid(), &entry, buffer, sizeof buffer, &found) == 0 && found != NULL) {
            home = found->pw_dir;
        }
        n = home != NULL && home[0] == '/' ? snprintf(path, size, "%s/.cache/palpate", home) : -1;
    }
    if (n < 0 || (size_t)n >= size) {
        return 0;
    }
    while (n > 1 && path[n - 1] == '/') { // lstat("link/") would follow the link
        path[--n] = 0;
    }
    return 1;
}

/// mkdir -p, mode 0700. @return 0 or errno
static int make_directories(char *path) {
    for (char *p = path + 1;; p++) {
        if (*p != '/' && *p != 0) {
            continue;
        }
        char kept = *p;
        *p = 0;
        int failed = mkdir(path, 0700) != 0 && errno != EEXIST ? errno : 0;
        *p = kept;
        // a parent that exists but may not be written (EROFS, EACCES) is no failure yet
        if (kept == 0) {
            return failed;
        }
    }
}

pal_status pal_cache_directory(char *path, size_t size, pal_error *error) {
    struct stat st;
    if (path == NULL || !choose_directory(path, size)) {
        return pal_fail(
            error, PALPATE_ERROR_ARGUMENT,
            "cache: no directory: neither PALPATE_CACHE nor XDG_CACHE_HOME nor HOME gives one that "
            "fits %zu bytes; %s",
            size, remedy);
    }
    if (lstat(path, &st) != 0) {
        int code = errno == ENOENT ? make_directories(path) : errno;
        if (code == 0 && lstat(path, &st) != 0) {
            code = errno;
        }
        if (code != 0) {
            return pal_fail(error, PALPATE_ERROR_IO, "cache %s: cannot be made: %s; %s", path,
                            strerror(code), remedy);
        }
    }
    const char *wrong = S_ISLNK(st.st_mode)                       ? "is a symbolic link"
                        : !S_ISDIR(st.st_mode)                    ? "is not a directory"
                        : st.st_uid != geteuid()                  ? "belongs to another user"
                        : (st.st_mode & (S_IWGRP | S_IWOTH)) != 0 ? "may be written by others"
                                                                  : NULL;
    if (wrong != NULL) {
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "cache %s: %s, so models in it are not to be trusted; %s", path, wrong,
                        remedy);
    }
    return PALPATE_OK;
}

pal_status pal_cache_path(const pal_scene *scene, char *path, size_t size, pal_error *error) {
    char hash[65];
    if (scene == NULL || path == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "pal_cache_path: scene or path is NULL");
    }
    pal_status status = pal_scene_hash(scene, hash, error);
    if (status != PALPATE_OK) {
        return status;
    }
    status = pal_cache_directory(path, size, error);
    if (status != PALPATE_OK) {
        return status;
    }
    size_t length = strlen(path);
    int n = snprintf(path + length, size - length, "/%s.palpate", hash);
    if (n < 0 || (size_t)n >= size - length) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "cache: %zu bytes are too few for its path; %s", size, remedy);
    }
    return PALPATE_OK;
}

pal_status pal_cache_find(const char *hash, pal_model **out, pal_error *error) {
    char path[4096];
    if (out == NULL || hash == NULL || strlen(hash) != 2 * PALPATE_HASH_BYTES ||
        strspn(hash, "0123456789abcdef") != 2 * PALPATE_HASH_BYTES) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_cache_find: '%.70s' is not a model's hash",
                        hash != NULL ? hash : "(NULL)");
    }
    *out = NULL;
    pal_status status = pal_cache_directory(path, sizeof path, error);
    if (status != PALPATE_OK) {
        return status;
    }
    size_t length = strlen(path);
    int n = snprintf(path + length, sizeof path - length, "/%s.palpate", hash);
    if (n < 0 || (size_t)n >= sizeof path - length) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "cache: its path is too long; %s", remedy);
    }
    return pal_cache_load(path, hash, out, error);
}

pal_status pal_cache_load(const char *path, const char *hash, pal_model **out, pal_error *error) {
    struct stat st;
    *out = NULL;
    if (lstat(path, &st) != 0) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: %s", path, strerror(errno));
    }
    if (!S_ISREG(st.st_mode) || st.st_uid != geteuid() || (st.st_mode & (S_IWGRP | S_IWOTH)) != 0) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s: not a file that only you can write, so it is not trusted; remove it",
                        path);
    }
    return pal_model_load_expect(path, hash, out, error);
}

/// Remove temporaries (".NAME.RANDOM.tmp", file_header.c) older than a day.
static void remove_leftovers(const char *model_path) {
    const char *slash = strrchr(model_path, '/');
    char *directory = slash != NULL ? strndup(model_path, (size_t)(slash - model_path) + 1) : NULL;
    DIR *entries = directory != NULL ? opendir(directory) : NULL;
    free(directory);
    if (entries == NULL) {
        return;
    }
    time_t now = time(NULL);
    const struct dirent *entry;
    while ((entry = readdir(entries)) != NULL) {
        size_t length = strlen(entry->d_name);
        struct stat st;
        if (entry->d_name[0] == '.' && length > 30 &&
            strcmp(entry->d_name + length - 4, ".tmp") == 0 &&
            strstr(entry->d_name, ".palpate.") != NULL &&
            fstatat(dirfd(entries), entry->d_name, &st, AT_SYMLINK_NOFOLLOW) == 0 &&
            S_ISREG(st.st_mode) && now - st.st_mtime > 24 * 3600) {
            (void)unlinkat(dirfd(entries), entry->d_name, 0);
        }
    }
    (void)closedir(entries);
}

pal_status pal_cache_save(const pal_model *model, const char *path, pal_error *error) {
    remove_leftovers(path);
    return pal_model_save_mode(model, path, 0600, error);
}
