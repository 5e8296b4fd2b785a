/// @file model_cache.h  The user's cache of built models (private). pal_cache_path is public
/// (precompute.h).
#ifndef PALPATE_SRC_MODEL_CACHE_H
#define PALPATE_SRC_MODEL_CACHE_H

#include <stddef.h>

#include <palpate/model.h>
#include <palpate/status.h>

/// The cache directory, created with mode 0700 (parents too) when it is missing: $PALPATE_CACHE,
/// else $XDG_CACHE_HOME/palpate (when absolute), else ~/.cache/palpate.
/// @return PALPATE_OK; _SYSTEM when it is a symbolic link, not a directory, another user's, or
/// writable by others; _IO when it cannot be made; _ARGUMENT when `size` is too small
pal_status pal_cache_directory(char *path, size_t size, pal_error *error);

/// Load a cached model of content hash `hash`. The file must be a regular file of this user, not
/// writable by others. @return as pal_model_load_expect; _IO when there is none or it is not ours
pal_status pal_cache_load(const char *path, const char *hash, pal_model **out, pal_error *error);

/// Write a model into the cache, mode 0600 (atomic rename: two processes building the same model
/// end with one good file). Also removes temporaries that killed processes left over a day ago.
pal_status pal_cache_save(const pal_model *model, const char *path, pal_error *error);

#endif
