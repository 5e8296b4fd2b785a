/// @file scene_tree.h  A scene as a tree of values that know where they stand (private).
///
/// scene_yaml.c makes the tree from YAML text, scene_tree.c looks values up and applies `--set`,
/// scene_read.c turns the tree into a struct pal_scene by the schema. All memory of a tree is one
/// arena, freed at once. Not thread-safe; one tree, one thread.
#ifndef PALPATE_SRC_SCENE_TREE_H
#define PALPATE_SRC_SCENE_TREE_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

/// Limits of a scene: what a person writes is far below, what an attacker writes is refused.
enum {
    PALPATE_SCENE_BYTES_MAX = 1 << 20, ///< of the file, and of one --set value
    PALPATE_SCENE_VALUES_MAX = 20000,  ///< values after aliases are expanded
    PALPATE_SCENE_DEPTH_MAX = 32,      ///< nesting
    PALPATE_SCENE_TEXT_MAX = 1023      ///< bytes of one value
};

typedef enum pal_value_kind {
    PALPATE_VALUE_TEXT,
    PALPATE_VALUE_LIST,
    PALPATE_VALUE_MAP
} pal_value_kind;

typedef struct pal_value {
    pal_value_kind kind;
    char *text;              ///< text: the scalar, NUL-terminated
    int32_t quoted;          ///< text: 1 when written in quotes or as a block
    int32_t count;           ///< list, map: items
    struct pal_value **item; ///< list: items; map: values, shape [count]
    struct pal_value **key;  ///< map: keys (texts), shape [count]
    int32_t line, column;    ///< 1-based, in characters
    int32_t set;             ///< 0: from the file; k: from override k-1
} pal_value;

typedef struct pal_tree {
    const char *file;            ///< the scene file's name for messages; not owned
    const char *const *override; ///< the overrides' texts; not owned
    int32_t override_count;
    int32_t value_count;
    struct pal_chunk *chunks;
} pal_tree;

void pal_tree_clear(pal_tree *tree);

/// Zeroed memory that lives as long as the tree; NULL when out of memory.
void *pal_tree_alloc(pal_tree *tree, size_t size);

pal_value *pal_tree_text(pal_tree *tree, const char *text, size_t length);
/// An empty list or map.
pal_value *pal_tree_empty(pal_tree *tree, pal_value_kind kind);
/// Append to a list (key NULL) or a map. @return 0, or -1 when out of memory
int pal_tree_append(pal_tree *tree, pal_value *to, pal_value *key, pal_value *item);

/// Parse one YAML document. An empty text gives *out = NULL.
/// @param set  0: the scene file, k: override k-1
/// @return PALPATE_OK, _SCENE (located), _MEMORY
pal_status pal_yaml_parse(pal_tree *tree, const char *text, size_t size, int32_t set,
                          pal_value **out, pal_error *error);

/// The value of a key of a map (NULL: not there, or not a map).
pal_value *pal_value_get(const pal_value *map, const char *key);
/// The key's own value (for its place); NULL as above.
pal_value *pal_value_key(const pal_value *map, const char *key);
/// 1 for ~, null, or nothing.
int pal_value_is_null(const pal_value *value);

/// Apply override `index` ("dotted.path=value") to the tree. Lists are addressed by number
/// (a number one past the end appends) or by the `name` of their items; missing maps are made.
/// @param is_list  tells whether a schema path ("body.refine") is a list
pal_status pal_tree_set(pal_tree *tree, pal_value *root, int32_t index,
                        int (*is_list)(const char *path), pal_error *error);

/// "file:line:column" or "--set path=value" of a value, for messages. @return out
char *pal_value_where(const pal_tree *tree, const pal_value *value, char *out, size_t size);

/// The value in a few words for "found ...": text (cut, control characters replaced), "a list of
/// 3", "a mapping", "nothing". @return out
char *pal_value_words(const pal_value *value, char *out, size_t size);

#endif
