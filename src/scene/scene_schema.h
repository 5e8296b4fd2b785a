/// @file scene_schema.h  How one key of a scene is read into memory (private).
///
/// The table in scene_schema.c is the only list of keys. A row's public half (pal_scene_key) feeds
/// --help and the reference; its binding drives the loader: where the value goes (offset in the
/// object that holds it), what is allowed, and what is checked once a mapping is complete.
#ifndef PALPATE_SRC_SCENE_SCHEMA_H
#define PALPATE_SRC_SCENE_SCHEMA_H

#include <stddef.h>

#include "src/scene/scene.h"
#include "src/scene/scene_tree.h"

typedef enum pal_key_kind {
    PALPATE_KEY_MAP,    ///< fixed keys, all in the same object
    PALPATE_KEY_ONE_OF, ///< exactly one of the option keys (and possibly extras)
    PALPATE_KEY_LIST,   ///< items described by the row path[]
    PALPATE_KEY_NAMED,  ///< user's names -> items described by the row path.*
    PALPATE_KEY_NUMBER,
    PALPATE_KEY_INTEGER,
    PALPATE_KEY_VECTOR, ///< three numbers, each in the range
    PALPATE_KEY_CHOICE, ///< one of the words in `allowed`, stored as its position + first
    PALPATE_KEY_SWITCH, ///< true | false
    PALPATE_KEY_NAME,   ///< identifier, buffer of PALPATE_NAME_MAX
    PALPATE_KEY_PATH    ///< file, made absolute, buffer of 1024
} pal_key_kind;

enum {
    PALPATE_KEY_REQUIRED = 1, ///< must be present when its parent is
    PALPATE_KEY_OPTION = 2,   ///< one of the options of its ONE_OF parent
    PALPATE_KEY_BARE = 4,     ///< option that may be written as a word: `- all`
    PALPATE_KEY_SINGLE = 8,   ///< list that a single item may stand for
    PALPATE_KEY_EXISTS = 16,  ///< path: the file must exist now
    PALPATE_KEY_UNIT = 32,    ///< vector: normalised to length 1; zero is refused
    /// ---- Features that are not built yet: the key is accepted by the grammar and refused, never
    /// ignored. Remove the flag when the feature lands.
    PALPATE_KEY_NOT_BUILT = 64,          ///< refused when present
    PALPATE_KEY_NOT_BUILT_UNLESS_0 = 128 ///< refused when not 0
};

/// What options depend on: the method's kind, and a cell method with form: collocated.
enum { PALPATE_METHOD_COLLOCATED = 3 };

struct pal_reading;

/// Check (or complete) an object after all its keys were read. `value` is NULL when the mapping was
/// not written and only defaults apply.
typedef pal_status (*pal_key_check)(struct pal_reading *r, const pal_value *value, void *object);

typedef struct pal_key_binding {
    pal_key_kind kind;
    size_t offset; ///< of the value in its object; ONE_OF: of the option's number
    int flags;
    double low, high; ///< range of numbers
    int low_open, high_open;
    int first;           ///< choice: number of the first word
    unsigned not_built;  ///< choice: bit per word that is refused as not built yet
    int option;          ///< OPTION: the number stored in the parent's `offset`; -1: none
    const char *word[2]; ///< number: words that may stand for it
    double word_value[2];
    size_t item_size;    ///< list, named: size of one item
    size_t count_offset; ///< list, named: of the int32_t count
    int inline_max;      ///< list: > 0 when the items are an array inside the object
    size_t name_offset;  ///< named: of the name in the item
    size_t place_offset; ///< of a pal_place in the object
    int has_place;
    int enter_patch;    ///< object of this key is the patch's own selector
    int methods;        ///< option of these methods (bits 1 << kind or COLLOCATED); 0: of all
    const char *remedy; ///< what to do about a bad value
    pal_key_check check;
} pal_key_binding;

/// State of one load.
typedef struct pal_reading {
    pal_scene *scene;
    pal_tree tree;
    pal_error *error;
    char path[512]; ///< key being read, as written: "tools[0].shape"
} pal_reading;

/// Read the root mapping into reading->scene.
pal_status pal_scene_read(pal_reading *r, const pal_value *root);

/// 1 when the schema says that the key at this written path (list items as []) is a list.
int pal_schema_is_list(const char *path);
/// Row of a schema path; -1: none.
int pal_schema_find(const char *path);

/// "where: key: found X; allowed: Y; remedy"; key: the key being read, plus ".leaf" when not NULL.
pal_status pal_reading_fail(pal_reading *r, pal_status status, const pal_value *at,
                            const char *leaf, const char *found, const char *allowed,
                            const char *remedy);
pal_status pal_reading_memory(pal_reading *r);
/// The same for a value that does not fit its row; remedy may be NULL.
pal_status pal_reading_fail_value(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                                  const char *remedy);
/// PALPATE_ERROR_UNSUPPORTED for a feature that is not built yet.
pal_status pal_reading_not_built(pal_reading *r, const pal_value *value, const char *allowed);
/// What a row allows, in words. @return out, or a constant
const char *pal_key_allowed(const pal_scene_key *key, char *out, size_t size);

/// Read a value that has no keys (number, integer, vector, choice, switch, name, path) to `at`.
/// The thread's locale must be "C".
pal_status pal_reading_leaf(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                            void *at);

/// Distance of two words in slips (letters changed, missing, added, swapped); 99 for long words.
int pal_word_distance(const char *a, const char *b);
/// Slips up to which a word is worth suggesting.
int pal_word_slips(const char *word);
/// 1 for 1 to 63 bytes of letters, digits, _, - and non-ASCII UTF-8: what --set can address.
int pal_word_is_name(const char *s);

void pal_reading_place(const pal_reading *r, const pal_value *value, pal_place *out);

/// The checks named by the table (scene_rules.c).
pal_status pal_rule_geometry(pal_reading *r, const pal_value *value, void *object);
pal_status pal_rule_selector_box(pal_reading *r, const pal_value *value, void *object);
pal_status pal_rule_refine(pal_reading *r, const pal_value *value, void *object);
pal_status pal_rule_method(pal_reading *r, const pal_value *value, void *object);
pal_status pal_rule_tool(pal_reading *r, const pal_value *value, void *object);
pal_status pal_rule_body(pal_reading *r, const pal_value *value, void *object);
pal_status pal_rule_watchdog(pal_reading *r, const pal_value *value, void *object);
pal_status pal_rule_root(pal_reading *r, const pal_value *value, void *object);

#endif
