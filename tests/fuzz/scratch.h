/// @file scratch.h  Files for readers under fuzz: in memory where there is /dev/shm, one set per
/// process. (A memfd by its name in /proc cannot be opened everywhere, and nothing would be
/// fuzzed.)
#ifndef PALPATE_TESTS_FUZZ_SCRATCH_H
#define PALPATE_TESTS_FUZZ_SCRATCH_H

#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

enum { SCRATCH_PATH = 96 };

static inline void scratch_path(const char *suffix, char path[SCRATCH_PATH]) {
    (void)snprintf(path, SCRATCH_PATH, "%s/palpate-fuzz-%d%s",
                   access("/dev/shm", W_OK) == 0 ? "/dev/shm" : "/tmp", (int)getpid(), suffix);
}

static inline void scratch_write(const char *path, const void *data, size_t size) {
    FILE *f = fopen(path, "wbe");
    if (f == NULL || fwrite(data, 1, size, f) != size || fclose(f) != 0) {
        perror(path);
        abort();
    }
}

#endif
