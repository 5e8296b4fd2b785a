/// @file precompute.h  Offline: from a scene to a certified model.
/// Library: libpalpate-offline.
#ifndef PALPATE_PRECOMPUTE_H
#define PALPATE_PRECOMPUTE_H

#include <palpate/model.h>
#include <palpate/scene.h>
#include <palpate/status.h>

#ifdef __cplusplus
extern "C" {
#endif

/// Build and certify the model of a scene.
/// @param scene     warnings found on the way are added to it (pal_scene_warning)
/// @param progress  may be NULL; called from this thread; non-zero return cancels
/// @return PALPATE_OK; _SCENE or _GEOMETRY (located), _CLOUD, _STENCIL, _SINGULAR, _CERTIFICATE,
///         _MEMORY, _CANCELLED. On error *out is NULL and nothing was written anywhere; but with
///         _CERTIFICATE (the message names reason and remedy) *out is the model, so that it can be
///         looked at: pal_model_save refuses nothing, the program does not write it.
///         A scene with `certify: warn` gets PALPATE_OK and a scene warning instead.
/// Thread: any, one call per scene at a time; starts helper threads and one helper process
/// (mesher).
PALPATE_API pal_status pal_precompute(pal_scene *scene, const pal_progress *progress,
                                      pal_model **out, pal_error *error);

/// The cache file of a scene: $PALPATE_CACHE, else $XDG_CACHE_HOME/palpate, else ~/.cache/palpate,
/// then HASH.palpate. The directory is created with mode 0700.
PALPATE_API pal_status pal_cache_path(const pal_scene *scene, char *path, size_t size,
                                      pal_error *error);

/// The model of content hash `hash` (64 hexadecimal digits, pal_model_info.hash) from the cache.
/// @return PALPATE_OK; _ARGUMENT when it is no hash; _IO, _SYSTEM when the cache has none or is not
/// to be trusted; else as pal_model_load
PALPATE_API pal_status pal_cache_find(const char *hash, pal_model **out, pal_error *error);

/// pal_precompute through the cache: load the cached model when it matches the scene, else build
/// and write it (atomic rename). The returned model carries the scene's runtime configuration.
/// @param[out] was_cached  may be NULL; 1 when nothing had to be built
PALPATE_API pal_status pal_precompute_cached(pal_scene *scene, const pal_progress *progress,
                                             pal_model **out, int *was_cached, pal_error *error);

#ifdef __cplusplus
}
#endif
#endif
