/// @file fuzz_scene.c  libFuzzer target: the scene loader (YAML, rules, defaults, checks).
///
/// The text is given as a file in memory; surfaces it names are not there. Oracle: refused with a
/// message, or a scene that can be asked for its runtime and freed.
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <sys/mman.h>
#include <unistd.h>

#include <palpate/scene.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char path[64];
    int fd = memfd_create("scene", MFD_CLOEXEC);
    if (fd < 0 || write(fd, data, size) != (ssize_t)size) {
        abort();
    }
    (void)snprintf(path, sizeof path, "/proc/self/fd/%d", fd);
    pal_scene *scene = NULL;
    pal_error error = {0};
    if (pal_scene_load(path, NULL, 0, &scene, &error) != PALPATE_OK) {
        if (error.message[0] == 0) {
            abort();
        }
    } else if (pal_scene_runtime(scene) == NULL) {
        abort();
    }
    pal_scene_free(scene);
    (void)close(fd);
    return 0;
}
