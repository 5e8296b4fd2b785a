/// @file h5_changes.h  Changes to a good HDF5 file's content, made by HDF5 itself, so that HDF5
/// always gets a well-formed file and our own readers get the nonsense.
#ifndef PALPATE_TESTS_FUZZ_H5_CHANGES_H
#define PALPATE_TESTS_FUZZ_H5_CHANGES_H

#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>

enum { NAMES_MAX = 512 };

/// The good file.
typedef struct h5_base {
    uint8_t *image;
    size_t size;
    int names;
    char *name[NAMES_MAX]; ///< all datasets
} h5_base;

#define REQUIRE(condition)                                                                         \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            (void)fprintf(stderr, "%s:%d: violated: %s\n", __FILE__, __LINE__, #condition);        \
            abort();                                                                               \
        }                                                                                          \
    } while (0)

/// List the datasets of base->image.
void h5_base_note_names(h5_base *base);

/// A copy changed by up to 16 steps {dataset u8, action u8, argument u32, value u64}: values
/// overwritten, datasets of other types and shapes, deleted, linked, made groups. To be freed.
uint8_t *h5_changed(const h5_base *base, const uint8_t *data, size_t size, size_t *length);

/// The next `bytes` bytes as a little-endian number; what is missing is 0.
uint64_t h5_take(const uint8_t **data, size_t *size, size_t bytes);

#endif
