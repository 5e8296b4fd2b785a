/// Tests: scenes written as text.
#include <setjmp.h>
#include <stdarg.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "tests/support/scene_text.h"

void test_scene_put(const char *text, size_t size, char path[64]) {
    char directory[] = "/tmp/palpate-scene-XXXXXX";
    assert_non_null(mkdtemp(directory));
    (void)snprintf(path, 64, "%s/scene.yaml", directory);
    FILE *f = fopen(path, "wb");
    assert_non_null(f);
    assert_int_equal(fwrite(text, 1, size, f), size);
    assert_int_equal(fclose(f), 0);
}

void test_scene_remove(const char *path) {
    char directory[64];
    (void)snprintf(directory, sizeof directory, "%s", path);
    *strrchr(directory, '/') = 0;
    assert_int_equal(unlink(path), 0);
    assert_int_equal(rmdir(directory), 0);
}

pal_status test_scene_load(const char *text, const char *const set[], pal_scene **out,
                           pal_error *error) {
    char path[64];
    int count = 0;
    while (set != NULL && set[count] != NULL) {
        count++;
    }
    test_scene_put(text, strlen(text), path);
    pal_status status = pal_scene_load(path, set, count, out, error);
    test_scene_remove(path);
    return status;
}
