/// @file file_header.c  Sealing, verifying, reading and atomically writing Palpate's files.
///
/// Layout and promises: file_header.h. Thread: any; two processes may save the same path at once,
/// the later rename wins and both files are whole.
#include "haptic/model/file_header.h"

#include <errno.h>
#include <fcntl.h>
#include <inttypes.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/random.h>
#include <sys/stat.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/base/hash.h"

enum {
    KIND_AT = 8,
    VERSION_AT = 16,
    BLOCK_AT = 20,
    TOTAL_AT = 24,
    SUM_AT = 32,
    HEADER_SUM_AT = 64
};

static const uint8_t magic[8] = {0x89, 'P', 'A', 'L', 'P', '\r', '\n', 0x1A};

typedef struct kind_text {
    char stored[8];
    const char *name, *maker;
} kind_text;

static const kind_text kinds[] = {
    [PALPATE_FILE_MODEL] = {"MODEL", "model", "palpate precompute"},
    [PALPATE_FILE_RECORDING] = {"RECORD", "recording", "palpate run --record"},
};
enum { KIND_COUNT = sizeof kinds / sizeof *kinds };

static uint64_t load_le(const uint8_t *p, int bytes) {
    uint64_t x = 0;
    for (int i = bytes - 1; i >= 0; i--) {
        x = (x << 8) | p[i];
    }
    return x;
}

static void store_le(uint8_t *p, int bytes, uint64_t x) {
    for (int i = 0; i < bytes; i++) {
        p[i] = (uint8_t)(x >> (8 * i));
    }
}

// ---- Header -------------------------------------------------------------------------------------

static void make_header(pal_file_kind kind, uint32_t version, uint64_t total,
                        const uint8_t *checksum, uint8_t header[PALPATE_HEADER_BYTES]) {
    memset(header, 0, PALPATE_HEADER_BYTES);
    memcpy(header, magic, sizeof magic);
    memcpy(header + KIND_AT, kinds[kind].stored, sizeof kinds[kind].stored);
    store_le(header + VERSION_AT, 4, version);
    store_le(header + BLOCK_AT, 4, PALPATE_USER_BLOCK);
    store_le(header + TOTAL_AT, 8, total);
    memcpy(header + SUM_AT, checksum, PALPATE_HASH_BYTES);
    pal_hash_buffer(header, HEADER_SUM_AT, header + HEADER_SUM_AT);
}

static pal_status wrong_magic(pal_file_kind kind, const uint8_t *bytes, size_t have,
                              const char *name, pal_error *error) {
    static const uint8_t hdf5[8] = {0x89, 'H', 'D', 'F', '\r', '\n', 0x1A, '\n'};
    const kind_text *k = &kinds[kind];
    if (have >= sizeof hdf5 && memcmp(bytes, hdf5, sizeof hdf5) == 0) {
        return pal_fail(
            error, PALPATE_ERROR_FORMAT,
            "%s: not a Palpate %s: plain HDF5 without Palpate's header; give a file written by %s",
            name, k->name, k->maker);
    }
    char start[3 * 8 + 1] = "";
    for (size_t i = 0; i < have && i < 8; i++) {
        (void)snprintf(start + 3 * i, 4, " %02x", bytes[i]);
    }
    return pal_fail(error, PALPATE_ERROR_FORMAT,
                    "%s: not a Palpate %s: it starts with%s; give a file written by %s", name,
                    k->name, start, k->maker);
}

/// Check the first bytes of a file of `size` bytes, of which `have` (up to PALPATE_HEADER_BYTES)
/// are here.
static pal_status check_header(pal_file_kind kind, uint32_t newest, const uint8_t *header,
                               size_t have, uint64_t size, const char *name, pal_error *error) {
    const kind_text *k = &kinds[kind];
    size_t compare = have < sizeof magic ? have : sizeof magic;
    if (memcmp(header, magic, compare) != 0) {
        return wrong_magic(kind, header, have, name, error);
    }
    if (have < PALPATE_HEADER_BYTES) {
        return pal_fail(error, PALPATE_ERROR_TRUNCATED,
                        "%s: truncated: %zu bytes, the header alone has %d; write it again with %s",
                        name, have, PALPATE_HEADER_BYTES, k->maker);
    }
    uint8_t sum[PALPATE_HASH_BYTES];
    pal_hash_buffer(header, HEADER_SUM_AT, sum);
    if (memcmp(sum, header + HEADER_SUM_AT, sizeof sum) != 0) {
        return pal_fail(
            error, PALPATE_ERROR_CHECKSUM,
            "%s: corrupted: the checksum of its header does not match; write it again with %s",
            name, k->maker);
    }
    if (memcmp(header + KIND_AT, k->stored, sizeof k->stored) != 0) {
        const char *found = "file of another kind";
        for (int i = 0; i < KIND_COUNT; i++) {
            if (memcmp(header + KIND_AT, kinds[i].stored, sizeof kinds[i].stored) == 0) {
                found = kinds[i].name;
            }
        }
        return pal_fail(error, PALPATE_ERROR_FORMAT,
                        "%s: a Palpate %s, not a %s; give a file written by %s", name, found,
                        k->name, k->maker);
    }
    uint32_t version = (uint32_t)load_le(header + VERSION_AT, 4);
    if (version > newest) {
        return pal_fail(error, PALPATE_ERROR_VERSION,
                        "%s: %s format version %" PRIu32 ", this program (%s) reads up to %" PRIu32
                        "; use a newer Palpate, or write it again with %s",
                        name, k->name, version, pal_version(), newest, k->maker);
    }
    uint64_t block = load_le(header + BLOCK_AT, 4), total = load_le(header + TOTAL_AT, 8);
    if (version == 0 || block < PALPATE_USER_BLOCK || (block & (block - 1)) != 0 || total < block) {
        return pal_fail(error, PALPATE_ERROR_FORMAT,
                        "%s: version %" PRIu32 ", user block %" PRIu64 " and size %" PRIu64
                        " do not make a %s",
                        name, version, block, total, k->name);
    }
    if (size < total) {
        return pal_fail(error, PALPATE_ERROR_TRUNCATED,
                        "%s: truncated: %" PRIu64 " of %" PRIu64 " bytes; write it again with %s",
                        name, size, total, k->maker);
    }
    if (size > total) {
        return pal_fail(error, PALPATE_ERROR_CHECKSUM,
                        "%s: corrupted: %" PRIu64 " bytes, its header says %" PRIu64
                        "; write it again with %s",
                        name, size, total, k->maker);
    }
    return PALPATE_OK;
}

static pal_status check_sum(pal_file_kind kind, const uint8_t *header, const uint8_t *computed,
                            const char *name, pal_error *error) {
    if (memcmp(header + SUM_AT, computed, PALPATE_HASH_BYTES) == 0) {
        return PALPATE_OK;
    }
    char stored[17], found[17];
    pal_hash_to_hex(header + SUM_AT, 8, stored);
    pal_hash_to_hex(computed, 8, found);
    return pal_fail(
        error, PALPATE_ERROR_CHECKSUM,
        "%s: corrupted: its checksum is %s..., its header says %s...; write it again with %s", name,
        found, stored, kinds[kind].maker);
}

pal_status pal_file_seal(pal_file_kind kind, uint32_t version, void *image, size_t size) {
    if (size < PALPATE_USER_BLOCK) {
        return PALPATE_ERROR_ARGUMENT;
    }
    uint8_t checksum[PALPATE_HASH_BYTES];
    pal_hash_buffer((const uint8_t *)image + PALPATE_HEADER_BYTES, size - PALPATE_HEADER_BYTES,
                    checksum);
    make_header(kind, version, size, checksum, image);
    return PALPATE_OK;
}

pal_status pal_file_verify(pal_file_kind kind, uint32_t newest, const void *image, size_t size,
                           const char *name, pal_error *error) {
    size_t have = size < PALPATE_HEADER_BYTES ? size : PALPATE_HEADER_BYTES;
    pal_status status = check_header(kind, newest, image, have, size, name, error);
    if (status != PALPATE_OK) {
        return status;
    }
    uint8_t checksum[PALPATE_HASH_BYTES];
    pal_hash_buffer((const uint8_t *)image + PALPATE_HEADER_BYTES, size - PALPATE_HEADER_BYTES,
                    checksum);
    return check_sum(kind, image, checksum, name, error);
}

// ---- Reading ------------------------------------------------------------------------------------

/// Read up to `size` bytes. @return bytes read (fewer only at the end of the file), -1 with errno
static ssize_t read_all(int fd, void *to, size_t size) {
    size_t done = 0;
    while (done < size) {
        ssize_t n = read(fd, (char *)to + done, size - done);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            return -1;
        }
        if (n == 0) {
            break;
        }
        done += (size_t)n;
    }
    return (ssize_t)done;
}

static int write_all(int fd, const void *from, size_t size) {
    size_t done = 0;
    while (done < size) {
        // one call moves at most 2 GB; smaller pieces also meet a full disk early
        size_t piece = size - done < ((size_t)1 << 26) ? size - done : (size_t)1 << 26;
        ssize_t n = write(fd, (const char *)from + done, piece);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            return errno;
        }
        done += (size_t)n;
    }
    return 0;
}

static pal_status fail_errno(pal_error *error, const char *path, const char *what, int code) {
    return pal_fail(error, PALPATE_ERROR_IO, "%s: %s: %s", path, what, strerror(code));
}

/// Open for reading and check the header. O_NONBLOCK: a FIFO must not hang us before it is refused.
static pal_status open_checked(pal_file_kind kind, uint32_t newest, const char *path,
                               uint8_t header[PALPATE_HEADER_BYTES], int *fd, uint64_t *size,
                               pal_error *error) {
    struct stat st;
    *fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK | O_NOCTTY);
    if (*fd < 0) {
        return fail_errno(error, path, "cannot open", errno);
    }
    pal_status status;
    if (fstat(*fd, &st) != 0) {
        status = fail_errno(error, path, "cannot examine", errno);
    } else if (!S_ISREG(st.st_mode)) {
        status = pal_fail(error, PALPATE_ERROR_IO, "%s: not a regular file", path);
    } else {
        ssize_t have = read_all(*fd, header, PALPATE_HEADER_BYTES);
        *size = (uint64_t)st.st_size;
        status = have < 0 ? fail_errno(error, path, "cannot read", errno)
                          : check_header(kind, newest, header, (size_t)have, *size, path, error);
    }
    if (status != PALPATE_OK) {
        (void)close(*fd);
    }
    return status;
}

static pal_status shrank(pal_error *error, const char *path, uint64_t have, uint64_t size) {
    return pal_fail(error, PALPATE_ERROR_TRUNCATED,
                    "%s: truncated while it was read: %" PRIu64 " of %" PRIu64
                    " bytes; is it being written?",
                    path, have, size);
}

pal_status pal_file_load(pal_file_kind kind, uint32_t newest, const char *path, void **image,
                         size_t *size, pal_error *error) {
    uint8_t header[PALPATE_HEADER_BYTES];
    uint64_t total = 0;
    int fd;
    *image = NULL;
    *size = 0;
    pal_status status = open_checked(kind, newest, path, header, &fd, &total, error);
    if (status != PALPATE_OK) {
        return status;
    }
    uint8_t *bytes = malloc(total > 0 ? (size_t)total : 1);
    if (bytes == NULL) {
        (void)close(fd);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory for its %" PRIu64 " bytes",
                        path, total);
    }
    memcpy(bytes, header, sizeof header);
    ssize_t rest = read_all(fd, bytes + sizeof header, (size_t)total - sizeof header);
    int code = errno;
    (void)close(fd);
    if (rest < 0) {
        status = fail_errno(error, path, "cannot read", code);
    } else if ((uint64_t)rest + sizeof header < total) {
        status = shrank(error, path, (uint64_t)rest + sizeof header, total);
    } else {
        status = pal_file_verify(kind, newest, bytes, (size_t)total, path, error);
    }
    if (status != PALPATE_OK) {
        free(bytes);
        return status;
    }
    *image = bytes;
    *size = (size_t)total;
    return PALPATE_OK;
}

/// Hash what follows the read position to the end of the file. @return bytes, -1 with errno
static int64_t hash_rest(int fd, uint8_t *digest) {
    enum { PIECE = 1 << 18 };
    uint8_t *piece = malloc(PIECE);
    if (piece == NULL) {
        errno = ENOMEM;
        return -1;
    }
    pal_hash hash;
    pal_hash_init(&hash, PALPATE_HASH_BYTES);
    int64_t total = 0;
    ssize_t n;
    while ((n = read_all(fd, piece, PIECE)) > 0) {
        pal_hash_update(&hash, piece, (size_t)n);
        total += n;
    }
    pal_hash_final(&hash, digest);
    int code = errno;
    free(piece);
    errno = code;
    return n < 0 ? -1 : total;
}

pal_status pal_file_verify_path(pal_file_kind kind, uint32_t newest, const char *path,
                                pal_error *error) {
    uint8_t header[PALPATE_HEADER_BYTES], checksum[PALPATE_HASH_BYTES];
    uint64_t total = 0;
    int fd;
    pal_status status = open_checked(kind, newest, path, header, &fd, &total, error);
    if (status != PALPATE_OK) {
        return status;
    }
    int64_t rest = hash_rest(fd, checksum);
    int code = errno;
    (void)close(fd);
    if (rest < 0) {
        return fail_errno(error, path, "cannot read", code);
    }
    if ((uint64_t)rest + sizeof header < total) {
        return shrank(error, path, (uint64_t)rest + sizeof header, total);
    }
    return check_sum(kind, header, checksum, path, error);
}

pal_status pal_file_seal_path(pal_file_kind kind, uint32_t version, const char *path,
                              pal_error *error) {
    uint8_t header[PALPATE_HEADER_BYTES], checksum[PALPATE_HASH_BYTES];
    int fd = open(path, O_RDWR | O_CLOEXEC);
    if (fd < 0) {
        return fail_errno(error, path, "cannot open", errno);
    }
    int code = 0;
    ssize_t have = read_all(fd, header, sizeof header);
    int64_t rest = have == (ssize_t)sizeof header ? hash_rest(fd, checksum) : 0;
    if (have < 0 || rest < 0) {
        code = errno;
    } else if (rest + PALPATE_HEADER_BYTES < PALPATE_USER_BLOCK) {
        (void)close(fd);
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "%s: too short for a sealed file", path);
    } else {
        make_header(kind, version, (uint64_t)rest + sizeof header, checksum, header);
        if (lseek(fd, 0, SEEK_SET) != 0) {
            code = errno;
        }
        code = code != 0 ? code : write_all(fd, header, sizeof header);
        if (code == 0 && fsync(fd) != 0) {
            code = errno;
        }
    }
    if (close(fd) != 0 && code == 0) {
        code = errno;
    }
    return code == 0 ? PALPATE_OK : fail_errno(error, path, "cannot seal", code);
}

// ---- Writing ------------------------------------------------------------------------------------

int pal_file_sync_directory(const char *path) {
    const char *slash = strrchr(path, '/');
    size_t length = slash == NULL ? 0 : slash == path ? 1 : (size_t)(slash - path);
    char *directory = length > 0 ? strndup(path, length) : strdup(".");
    if (directory == NULL) {
        return ENOMEM;
    }
    int fd = open(directory, O_RDONLY | O_DIRECTORY | O_CLOEXEC);
    int code = fd < 0 ? errno : 0;
    free(directory);
    if (fd >= 0) {
        // EINVAL: a file system that cannot sync directories has nothing to sync
        if (fsync(fd) != 0 && errno != EINVAL) {
            code = errno;
        }
        (void)close(fd);
    }
    return code;
}

/// Create a new file next to `path`, named .NAME.RANDOM.tmp. @return its descriptor, or -1 with
/// errno
static int create_temporary(const char *path, unsigned mode, char *temporary, size_t size) {
    const char *slash = strrchr(path, '/');
    int directory = slash == NULL ? 0 : (int)(slash - path + 1);
    const char *name = path + directory;
    for (int attempt = 0; attempt < 100; attempt++) {
        uint64_t random = 0;
        if (getrandom(&random, sizeof random, 0) != (ssize_t)sizeof random) {
            random = (uint64_t)getpid() << 32 | (uint64_t)attempt;
        }
        // names may be NAME_MAX long already: keep only their start
        (void)snprintf(temporary, size, "%.*s.%.100s.%016" PRIx64 ".tmp", directory, path, name,
                       random);
        int fd =
            open(temporary, O_WRONLY | O_CREAT | O_EXCL | O_NOFOLLOW | O_CLOEXEC, (mode_t)mode);
        if (fd >= 0 || errno != EEXIST) {
            return fd;
        }
    }
    return -1;
}

pal_status pal_file_save(const char *path, const void *data, size_t size, unsigned mode,
                         pal_error *error) {
    struct stat st;
    if (path[0] == 0 || path[strlen(path) - 1] == '/') {
        return pal_fail(error, PALPATE_ERROR_IO, "\"%s\": not a file name", path);
    }
    if (lstat(path, &st) == 0 && !S_ISREG(st.st_mode) && !S_ISLNK(st.st_mode)) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s: exists and is not a regular file; choose another name", path);
    }
    size_t room = strlen(path) + 140;
    char *temporary = malloc(room);
    if (temporary == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory for a file name", path);
    }
    const char *what = "cannot create";
    int code = 0, made = 0;
    int fd = create_temporary(path, mode, temporary, room);
    if (fd < 0) {
        code = errno;
    } else {
        made = 1;
        what = "cannot write";
        code = write_all(fd, data, size);
        if (code == 0 && fsync(fd) != 0) {
            code = errno;
        }
        if (close(fd) != 0 && code == 0) {
            code = errno;
        }
        if (code == 0) {
            what = "cannot rename the finished file";
            code = rename(temporary, path) != 0 ? errno : 0;
            made = code != 0;
        }
        if (code == 0) {
            what = "written, but its directory cannot be synced";
            code = pal_file_sync_directory(path);
        }
    }
    if (made) {
        (void)unlink(temporary);
    }
    free(temporary);
    if (code == ENOSPC || code == EDQUOT || code == EFBIG) {
        return pal_fail(error, PALPATE_ERROR_IO,
                        "%s: %s its %.1f MB: %s; free space or choose another place", path, what,
                        (double)size / 1e6, strerror(code));
    }
    return code == 0 ? PALPATE_OK : fail_errno(error, path, what, code);
}
