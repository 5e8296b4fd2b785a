/// @file offline.c  Opening libpalpate-offline when a scene is given.
#include "haptic/program/program.h"

#include <dlfcn.h>
#include <string.h>

#include "haptic/base/error.h"

const offline_api *offline_open(pal_error *error) {
    static offline_api api; // of the program, not of a library
    static int opened = 0;
    if (opened) {
        return &api;
    }
    void *library = dlopen("libpalpate-offline.so.0", RTLD_NOW | RTLD_LOCAL);
    if (library == NULL) {
        pal_fail(error, PALPATE_ERROR_SYSTEM,
                 "a scene needs the offline library, which cannot be opened: %s; install it beside "
                 "libpalpate, or give a model file made by `palpate precompute`",
                 dlerror());
        return NULL;
    }
#define LOAD(member, name)                                                                         \
    do {                                                                                           \
        void *symbol = dlsym(library, name);                                                       \
        if (symbol == NULL) {                                                                      \
            pal_fail(error, PALPATE_ERROR_SYSTEM,                                                  \
                     "libpalpate-offline.so.0 lacks %s: it is of another version", name);          \
            return NULL;                                                                           \
        }                                                                                          \
        memcpy(&api.member, &symbol, sizeof symbol);                                               \
    } while (0)
    LOAD(scene_load, "pal_scene_load");
    LOAD(scene_free, "pal_scene_free");
    LOAD(scene_runtime, "pal_scene_runtime");
    LOAD(scene_warning_count, "pal_scene_warning_count");
    LOAD(scene_warning, "pal_scene_warning");
    LOAD(scene_schema, "pal_scene_schema");
    LOAD(scene_scale_spacing, "pal_scene_scale_spacing");
    LOAD(precompute, "pal_precompute");
    LOAD(precompute_cached, "pal_precompute_cached");
    LOAD(cache_path, "pal_cache_path");
    LOAD(cache_find, "pal_cache_find");
#undef LOAD
    opened = 1;
    return &api;
}
