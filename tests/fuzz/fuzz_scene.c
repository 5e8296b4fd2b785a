/// @file fuzz_scene.c  libFuzzer target: the scene loader (YAML, rules, defaults, checks).
///
/// The text is given as a file; surfaces it names are not there. Oracle: refused with a
/// message, or a scene that can be asked for its runtime and freed.
#include <stdint.h>

#include <palpate/scene.h>

#include "tests/fuzz/scratch.h"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    char path[SCRATCH_PATH];
    scratch_path(".yaml", path);
    scratch_write(path, data, size);
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
    (void)unlink(path);
    return 0;
}
