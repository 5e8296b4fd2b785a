/// @file scene.h  Offline: load and check a scene (YAML), override keys, list the schema.
/// Library: libpalpate-offline. Thread: one scene, one thread.
#ifndef PALPATE_SCENE_H
#define PALPATE_SCENE_H

#include <palpate/status.h>
#include <palpate/tool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pal_scene pal_scene;

/// Load a scene file and apply `overrides` ("dotted.path=value", later wins).
/// @return PALPATE_OK; PALPATE_ERROR_SCENE with "file:line:column: key: found ..., allowed ...;
/// remedy";
///         PALPATE_ERROR_IO; PALPATE_ERROR_UNSUPPORTED for a key whose feature is not built yet.
PALPATE_API pal_status pal_scene_load(const char *path, const char *const overrides[],
                                      int override_count, pal_scene **out, pal_error *error);

PALPATE_API void pal_scene_free(pal_scene *scene);

/// Tools and rates of the scene (trajectory paths made absolute).
PALPATE_API const pal_runtime_config *pal_scene_runtime(const pal_scene *scene);

/// Content hash (hex, 64 characters) of all that determines the model: geometry (file contents
/// included), spacing, refinement, material, supports, touchable, patches, probes, method, repair,
/// store, skin (its file's contents included) and the format version. Tools and rates are not part
/// of it.
/// @param[out] hex  at least 65 bytes
PALPATE_API pal_status pal_scene_hash(const pal_scene *scene, char hex[65], pal_error *error);

/// Scale every node spacing of the scene (body, refinement, rims, the automatic ones too): below 1
/// for a finer cloud. The content hash follows.
/// @return PALPATE_OK; PALPATE_ERROR_SCENE when the cloud would be absurdly large; _ARGUMENT;
/// _MEMORY
PALPATE_API pal_status pal_scene_scale_spacing(pal_scene *scene, double factor, pal_error *error);

/// Number of warnings found while loading, and each one's text (located like errors).
PALPATE_API int pal_scene_warning_count(const pal_scene *scene);
PALPATE_API const char *pal_scene_warning(const pal_scene *scene, int index);

/// One row of the schema: what drives the loader, --set, --help and the reference documentation.
typedef struct pal_scene_key {
    const char *path;    ///< dotted, list items as [], user's names as *: "body.refine[].spacing"
    const char *type;    ///< "number", "integer", "text", "vector3", "choice", ...
    const char *unit;    ///< "m", "Pa", "-" ...
    const char *allowed; ///< range or choices in words
    const char *default_text;              ///< "required" or the default
    const char *help;                      ///< one line
    const struct pal_key_binding *binding; ///< how the loader reads it (private)
} pal_scene_key;

/// The whole schema, parents before their keys. @return number of rows. Thread: any.
PALPATE_API int pal_scene_schema(const pal_scene_key **keys);

#ifdef __cplusplus
}
#endif
#endif
