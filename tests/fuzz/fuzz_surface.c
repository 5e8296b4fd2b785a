/// @file fuzz_surface.c  libFuzzer target: surface files (OBJ, PLY, STL), from the file to the
/// check.
///
/// Input: one byte that chooses the kind of file and the reader, then the file. PLY and STL (and
/// OBJ for a body) go through palpate-reader, a process of its own, so a crash of Assimp is a
/// refusal; OBJ in order is read in this process. Oracle: refused with a message, or a soup whose
/// corners exist and whose numbers are finite, which the check takes or refuses with a message.
#include <stdint.h>
#include <string.h>

#include "tests/fuzz/scratch.h"
#include "tests/fuzz/soup.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    static const char *const kind[8] = {".obj", ".obj", ".ply", ".stl",
                                        ".obj", ".obj", ".ply", ".stl"};
    if (size < 1) {
        return 0;
    }
    int k = data[0] & 7, in_order = k == 0 || k >= 4;
    char path[SCRATCH_PATH];
    scratch_path(kind[k], path);
    scratch_write(path, data + 1, size - 1);
    pal_surface s = {0};
    pal_error error = {0};
    pal_status status =
        in_order ? pal_surface_read_in_order(path, &s, &error) : pal_surface_read(path, &s, &error);
    (void)unlink(path);
    if (status == PALPATE_OK) {
        soup_check(&s);
    } else if (error.message[0] == 0 || (status == PALPATE_ERROR_SYSTEM &&
                                         strstr(error.message, "took more than") == NULL)) {
        (void)fprintf(stderr, "status %d: %s\n", status, error.message);
        abort();
    }
    pal_surface_clear(&s);
    return 0;
}
