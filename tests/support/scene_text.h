/// @file scene_text.h  Tests: scenes written as text.
#ifndef PALPATE_TESTS_SCENE_TEXT_H
#define PALPATE_TESTS_SCENE_TEXT_H

#include <stddef.h>

#include <palpate/scene.h>

/// Write `size` bytes to a new temporary file named scene.yaml in a directory of its own.
/// @param[out] path  at least 64 bytes
void test_scene_put(const char *text, size_t size, char path[64]);
/// Remove the file and its directory.
void test_scene_remove(const char *path);

/// Load a scene from text with overrides; the temporary file is removed.
/// @param set  NULL-terminated list, or NULL
pal_status test_scene_load(const char *text, const char *const set[], pal_scene **out,
                           pal_error *error);

#endif
