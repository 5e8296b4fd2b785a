/// @file seeds_main.c  Runs a fuzz target without a fuzzer: over its seeds and simple mutations of
/// them.
///
/// Usage: TARGET MUTATIONS FILE... Each file is given as it is, then MUTATIONS times changed by a
/// fixed random sequence (bytes overwritten, cut, doubled), so that every compiler and sanitizer
/// the tests run with sees the same inputs. Ends by the target's own abort() or with 0.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);
int LLVMFuzzerInitialize(int *argc, char ***argv) __attribute__((weak));
int main(int argc, char **argv);

enum { SIZE_MAX_INPUT = 1 << 20 };

static uint64_t seed = 1;

static uint32_t next(uint32_t below) {
    seed = seed * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)((seed >> 33) % (below > 0 ? below : 1));
}

/// @return the new size, at most twice the old one
static size_t mutate(uint8_t *data, size_t size) {
    for (uint32_t n = 1 + next(4); n > 0 && size > 0; n--) {
        size_t at = next((uint32_t)size), length = 1 + next((uint32_t)(size - at));
        switch (next(5)) {
        case 0:
            data[at] ^= (uint8_t)(1u << next(8));
            break;
        case 1:
            data[at] = (uint8_t)next(256);
            break;
        case 2:
            memset(data + at, next(2) ? 0xFF : 0, length < 8 ? length : 8);
            break;
        case 3:
            memmove(data + at, data + at + length, size - at - length);
            size -= length;
            break;
        default:
            if (size + length <= SIZE_MAX_INPUT) {
                memmove(data + at + length, data + at, size - at);
                size += length;
            }
        }
    }
    return size;
}

static int run(const char *path, int mutations) {
    uint8_t *seed_data = malloc(SIZE_MAX_INPUT), *changed = malloc(SIZE_MAX_INPUT);
    FILE *in = fopen(path, "rb");
    if (in == NULL || seed_data == NULL || changed == NULL) {
        perror(path);
        return 1;
    }
    size_t size = fread(seed_data, 1, SIZE_MAX_INPUT / 2, in);
    (void)fclose(in);
    for (int i = 0; i <= mutations; i++) {
        memcpy(changed, seed_data, size);
        size_t n = i == 0 ? size : mutate(changed, size);
        uint8_t *exact = malloc(n > 0 ? n : 1); // so that reading beyond the end is seen
        if (exact == NULL) {
            return 1;
        }
        memcpy(exact, changed, n);
        (void)LLVMFuzzerTestOneInput(exact, n);
        free(exact);
    }
    free(seed_data);
    free(changed);
    return 0;
}

int main(int argc, char **argv) {
    if (argc < 3) {
        (void)fprintf(stderr, "usage: %s MUTATIONS FILE...\n", argv[0]);
        return 2;
    }
    if (LLVMFuzzerInitialize != NULL) {
        (void)LLVMFuzzerInitialize(&argc, &argv);
    }
    int failed = 0;
    for (int i = 2; i < argc; i++) {
        failed |= run(argv[i], atoi(argv[1]));
    }
    return failed;
}
