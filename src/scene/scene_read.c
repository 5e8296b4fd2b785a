/// The scene tree -> struct pal_scene, driven by the schema table.
///
/// Every value is read by the row that describes it; defaults are read the same way from the
/// table's text. An error names place, key, what was found, what is allowed, and a remedy.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/scene/scene_schema.h"

static pal_status read_row(pal_reading *r, int row, const pal_value *value, void *object);

// ---- Mappings ----------------------------------------------------------------------------------

/// Row of child `name` of a row, or -1.
static int child_row(int row, const char *name) {
    const pal_scene_key *keys;
    (void)pal_scene_schema(&keys);
    char path[256];
    (void)snprintf(path, sizeof path, "%s%s%.64s", keys[row].path,
                   keys[row].path[0] != 0 ? "." : "", name);
    return name[0] == 0 || strlen(name) > 64 || strpbrk(name, ".[*") != NULL
               ? -1
               : pal_schema_find(path);
}

/// The last part of `path` when it is a key of the mapping `parent`, else NULL.
static const char *child_name(const char *parent, const char *path) {
    size_t n = strlen(parent);
    if (strncmp(path, parent, n) != 0 || (n > 0 && path[n] != '.')) {
        return NULL;
    }
    const char *name = path + n + (n > 0);
    return name[0] != 0 && strpbrk(name, ".[*") == NULL ? name : NULL;
}

static pal_status fail_unknown(pal_reading *r, int row, const pal_value *key) {
    const pal_scene_key *keys;
    int count = pal_scene_schema(&keys);
    char list[256] = "";
    char remedy[200] = "";
    int best = pal_word_slips(key->text) + 1;
    for (int i = 0; i < count; i++) {
        const char *name = child_name(keys[row].path, keys[i].path);
        if (name == NULL) {
            continue;
        }
        size_t n = strlen(list);
        (void)snprintf(list + n, sizeof list - n, "%s%s", n > 0 ? ", " : "", name);
        int d = pal_word_distance(name, key->text);
        if (d < best && d < (int)strlen(name)) { // at least one letter in common
            best = d;
            (void)snprintf(remedy, sizeof remedy, "did you mean %s?", name);
        }
    }
    for (int i = 0; i < count && remedy[0] == 0; i++) { // a known key in the wrong place
        const char *dot = strrchr(keys[i].path, '.');
        const char *name = dot != NULL ? dot + 1 : keys[i].path;
        if (name[0] != 0 && strcmp(name, key->text) == 0) {
            (void)snprintf(remedy, sizeof remedy, "did you mean %.100s%s?", keys[i].path,
                           dot == NULL ? " at the top level" : "");
        }
    }
    const char *shown = key->text[0] != 0 ? key->text : "\"\"";
    return pal_reading_fail(r, PALPATE_ERROR_SCENE, key, shown, "an unknown key", list,
                            remedy[0] != 0 ? remedy : "remove it");
}

static pal_status read_child(pal_reading *r, int row, const char *name, const pal_value *value,
                             void *object) {
    size_t n = strlen(r->path);
    (void)snprintf(r->path + n, sizeof r->path - n, "%s%s", n > 0 && name[0] != '[' ? "." : "",
                   name);
    pal_status status = read_row(r, row, value, object);
    if (status == PALPATE_OK) { // kept on errors: nobody reads it any more
        r->path[n] = 0;
    }
    return status;
}

/// The object that an option's keys belong to: a patch's option describes its own selector.
static void *enter(const pal_key_binding *b, void *object) {
    if (!b->enter_patch) {
        return object;
    }
    pal_selector_list *where = &((pal_scene_patch *)object)->where;
    if (where->item == NULL) {
        where->item = calloc(1, sizeof *where->item);
        where->count = where->item != NULL;
    }
    return where->item;
}

/// @param name  NULL: written as a bare word, so that there is nothing more to read
static pal_status read_option(pal_reading *r, int parent, int row, const char *name,
                              const pal_value *value, void *object) {
    const pal_scene_key *keys;
    (void)pal_scene_schema(&keys);
    const pal_key_binding *b = keys[row].binding;
    object = enter(b, object);
    if (object == NULL) {
        return pal_reading_memory(r);
    }
    if (b->option >= 0) {
        int option = b->option;
        memcpy((char *)object + keys[parent].binding->offset, &option, sizeof option);
    }
    if (name != NULL) {
        return read_child(r, row, name, value, object);
    }
    if (b->has_place) {
        pal_reading_place(r, value, (pal_place *)(void *)((char *)object + b->place_offset));
    }
    return PALPATE_OK;
}

/// A default from the table, read like a written value.
static pal_status read_default(pal_reading *r, int row, const char *name, void *object) {
    const pal_scene_key *keys;
    (void)pal_scene_schema(&keys);
    const char *text = keys[row].default_text;
    if (text[0] == '(') {
        return keys[row].binding->kind == PALPATE_KEY_MAP && strcmp(text, "(all defaults)") == 0
                   ? read_child(r, row, name, NULL, object)
                   : PALPATE_OK;
    }
    pal_value *value;
    pal_status status = pal_yaml_parse(&r->tree, text, strlen(text), 0, &value, r->error);
    if (status != PALPATE_OK || value == NULL) {
        return status;
    }
    value->line = 0;
    value->column = 0;
    return read_child(r, row, name, value, object);
}

/// @param at  for the place of messages; a null value stands for a mapping without keys
static pal_status read_map(pal_reading *r, int row, const pal_value *at, void *object) {
    const pal_scene_key *keys;
    int count = pal_scene_schema(&keys);
    const pal_scene_key *key = &keys[row];
    const pal_value empty = {.kind = PALPATE_VALUE_MAP};
    const pal_value *value = pal_value_is_null(at) ? &empty : at;
    int one_of = key->binding->kind == PALPATE_KEY_ONE_OF;
    if (one_of && value->kind == PALPATE_VALUE_TEXT && !value->quoted) {
        int option = child_row(row, value->text);
        if (option >= 0 && (keys[option].binding->flags & PALPATE_KEY_BARE) != 0) {
            return read_option(r, row, option, NULL, value, object);
        }
    }
    if (value->kind != PALPATE_VALUE_MAP) {
        return pal_reading_fail_value(r, key, value, NULL);
    }
    // unknown keys first: a slip in a name explains a missing key
    int32_t options = 0;
    for (int32_t i = 0; i < value->count; i++) {
        int child = child_row(row, value->key[i]->text);
        if (child < 0) {
            return fail_unknown(r, row, value->key[i]);
        }
        if ((keys[child].binding->flags & PALPATE_KEY_OPTION) != 0 && ++options > 1) {
            char found[160] = "";
            for (int32_t j = 0; j <= i; j++) {
                int other = child_row(row, value->key[j]->text);
                if ((keys[other].binding->flags & PALPATE_KEY_OPTION) != 0) {
                    size_t n = strlen(found);
                    (void)snprintf(found + n, sizeof found - n, "%s%s", n > 0 ? " and " : "",
                                   value->key[j]->text);
                }
            }
            char allowed[200];
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, value->key[i], NULL, found,
                                    pal_key_allowed(key, allowed, sizeof allowed), "keep one");
        }
    }
    if (one_of && options == 0) {
        char allowed[200];
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, at, NULL,
                                value->count == 0 ? "nothing" : "none of them",
                                pal_key_allowed(key, allowed, sizeof allowed), "add one");
    }
    for (int child = row + 1; child < count; child++) {
        const char *name = child_name(key->path, keys[child].path);
        if (name == NULL) {
            continue;
        }
        const pal_key_binding *b = keys[child].binding;
        const pal_value *written = pal_value_get(value, name);
        int option = (b->flags & PALPATE_KEY_OPTION) != 0;
        pal_status status = PALPATE_OK;
        if (option && pal_value_key(value, name) != NULL) {
            status = read_option(r, row, child, name, written, object);
        } else if (option) {
            continue;
        } else if (!pal_value_is_null(written)) {
            status = read_child(r, child, name, written, object);
        } else if ((b->flags & PALPATE_KEY_REQUIRED) != 0) {
            char allowed[256];
            char remedy[200];
            const pal_value *empty_key =
                written != NULL && written->set > 0 ? written : pal_value_key(value, name);
            (void)snprintf(remedy, sizeof remedy, "add %s: %s", name, keys[child].help);
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, empty_key != NULL ? empty_key : at,
                                    name, "nothing, but it is required",
                                    pal_key_allowed(&keys[child], allowed, sizeof allowed), remedy);
        } else {
            status = read_default(r, child, name, object);
        }
        if (status != PALPATE_OK) {
            return status;
        }
    }
    return PALPATE_OK;
}

// ---- Lists and named items
// -----------------------------------------------------------------------

static pal_status read_items(pal_reading *r, int row, const pal_value *value, void *object) {
    const pal_scene_key *keys;
    (void)pal_scene_schema(&keys);
    const pal_scene_key *key = &keys[row];
    const pal_key_binding *b = key->binding;
    int named = b->kind == PALPATE_KEY_NAMED;
    char item_path[256];
    (void)snprintf(item_path, sizeof item_path, "%s%s", key->path, named ? ".*" : "[]");
    int item_row = pal_schema_find(item_path);
    pal_value single = *value;
    pal_value *one[1] = {&single};
    pal_value list = {.kind = PALPATE_VALUE_LIST, .count = 1, .item = one};
    if (!named && (b->flags & PALPATE_KEY_SINGLE) != 0 && value->kind != PALPATE_VALUE_LIST) {
        list.line = value->line;
        list.column = value->column;
        list.set = value->set;
        value = &list;
    }
    if (value->kind != (named ? PALPATE_VALUE_MAP : PALPATE_VALUE_LIST)) {
        return pal_reading_fail_value(r, key, value, named ? NULL : "begin each item with '- '");
    }
    if (b->inline_max > 0 && value->count > b->inline_max) {
        return pal_reading_fail_value(r, key, value, "remove some");
    }
    char *items = (char *)object + b->offset;
    if (b->inline_max == 0) {
        items = value->count > 0 ? calloc((size_t)value->count, b->item_size) : NULL;
        if (items == NULL && value->count > 0) {
            return pal_reading_memory(r);
        }
        memcpy((char *)object + b->offset, &items, sizeof items);
    }
    memcpy((char *)object + b->count_offset, &value->count, sizeof value->count);
    for (int32_t i = 0; i < value->count; i++) {
        char *item = items + (size_t)i * b->item_size;
        char name[80];
        (void)snprintf(name, sizeof name, "[%d]", (int)i);
        if (named) {
            if (!pal_word_is_name(value->key[i]->text)) {
                char found[128];
                return pal_reading_fail(r, PALPATE_ERROR_SCENE, value->key[i], NULL,
                                        pal_value_words(value->key[i], found, sizeof found),
                                        "names of at most 63 letters, digits, _ and -",
                                        "rename it");
            }
            (void)snprintf(name, sizeof name, "%s", value->key[i]->text);
            (void)snprintf(item + b->name_offset, PALPATE_NAME_MAX, "%s", value->key[i]->text);
        }
        const pal_value *v = value->item[i];
        if (pal_value_is_null(v)) {
            size_t n = strlen(r->path);
            (void)snprintf(r->path + n, sizeof r->path - n, "%s%s", named ? "." : "", name);
            return pal_reading_fail_value(r, &keys[item_row], v != NULL ? v : value,
                                          "write it or remove it");
        }
        pal_status status = read_child(r, item_row, name, v, item);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    return PALPATE_OK;
}

/// `all: true`, for an option that may also be a bare word.
static int is_bare_true(const pal_key_binding *b, const pal_value *value) {
    return (b->flags & PALPATE_KEY_BARE) != 0 && value != NULL &&
           value->kind == PALPATE_VALUE_TEXT && strcmp(value->text, "true") == 0;
}

static pal_status read_row(pal_reading *r, int row, const pal_value *value, void *object) {
    const pal_scene_key *keys;
    (void)pal_scene_schema(&keys);
    const pal_key_binding *b = keys[row].binding;
    if (b->has_place) {
        pal_reading_place(r, value, (pal_place *)(void *)((char *)object + b->place_offset));
    }
    if ((b->flags & PALPATE_KEY_NOT_BUILT) != 0) {
        return pal_reading_not_built(r, value, "nothing");
    }
    pal_status status;
    switch (b->kind) {
    case PALPATE_KEY_MAP:
    case PALPATE_KEY_ONE_OF:
        status = is_bare_true(b, value) ? PALPATE_OK : read_map(r, row, value, object);
        break;
    case PALPATE_KEY_LIST:
    case PALPATE_KEY_NAMED:
        status = pal_value_is_null(value) ? pal_reading_fail_value(r, &keys[row], value, "write it")
                                          : read_items(r, row, value, object);
        break;
    default:
        status = pal_value_is_null(value)
                     ? pal_reading_fail_value(r, &keys[row], value, "write it")
                     : pal_reading_leaf(r, &keys[row], value, (char *)object + b->offset);
        break;
    }
    if (status == PALPATE_OK && b->check != NULL) {
        status = b->check(r, value, object);
    }
    return status;
}

pal_status pal_scene_read(pal_reading *r, const pal_value *root) {
    r->path[0] = 0;
    return read_row(r, pal_schema_find(""), root, r->scene);
}
