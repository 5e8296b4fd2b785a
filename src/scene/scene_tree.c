/// The scene tree: its arena, look-ups and `--set`.
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/scene/scene_tree.h"

enum { CHUNK_BYTES = 16384, SEGMENTS_MAX = 16 };

struct pal_chunk {
    struct pal_chunk *next;
    size_t used, size;
    _Alignas(16) unsigned char data[];
};

void pal_tree_clear(pal_tree *tree) {
    while (tree->chunks != NULL) {
        struct pal_chunk *next = tree->chunks->next;
        free(tree->chunks);
        tree->chunks = next;
    }
}

void *pal_tree_alloc(pal_tree *tree, size_t size) {
    size = (size + 15) & ~(size_t)15;
    struct pal_chunk *chunk = tree->chunks;
    if (chunk == NULL || chunk->size - chunk->used < size) {
        size_t room = size > CHUNK_BYTES ? size : CHUNK_BYTES;
        chunk = calloc(1, sizeof *chunk + room);
        if (chunk == NULL) {
            return NULL;
        }
        chunk->size = room;
        chunk->next = tree->chunks;
        tree->chunks = chunk;
    }
    void *p = chunk->data + chunk->used;
    chunk->used += size;
    return p;
}

pal_value *pal_tree_text(pal_tree *tree, const char *text, size_t length) {
    pal_value *value = pal_tree_alloc(tree, sizeof *value);
    char *copy = pal_tree_alloc(tree, length + 1);
    if (value == NULL || copy == NULL) {
        return NULL;
    }
    memcpy(copy, text, length);
    value->kind = PALPATE_VALUE_TEXT;
    value->text = copy;
    return value;
}

pal_value *pal_tree_empty(pal_tree *tree, pal_value_kind kind) {
    pal_value *value = pal_tree_alloc(tree, sizeof *value);
    if (value != NULL) {
        value->kind = kind;
    }
    return value;
}

int pal_tree_append(pal_tree *tree, pal_value *to, pal_value *key, pal_value *item) {
    // room is made at 0, 4, 8, 16, ... items
    int32_t n = to->count;
    if (n == 0 || (n >= 4 && (n & (n - 1)) == 0)) {
        size_t room = n == 0 ? 4 : 2 * (size_t)n;
        pal_value **items = pal_tree_alloc(tree, room * sizeof *items);
        pal_value **keys = pal_tree_alloc(tree, room * sizeof *keys);
        if (items == NULL || keys == NULL) {
            return -1;
        }
        if (n > 0) {
            memcpy(items, to->item, (size_t)n * sizeof *items);
            memcpy(keys, to->key, (size_t)n * sizeof *keys);
        }
        to->item = items;
        to->key = keys;
    }
    to->item[n] = item;
    to->key[n] = key;
    to->count = n + 1;
    return 0;
}

static int32_t find(const pal_value *map, const char *key, size_t length) {
    if (map == NULL || map->kind != PALPATE_VALUE_MAP) {
        return -1;
    }
    for (int32_t i = 0; i < map->count; i++) {
        if (strncmp(map->key[i]->text, key, length) == 0 && map->key[i]->text[length] == 0) {
            return i;
        }
    }
    return -1;
}

pal_value *pal_value_get(const pal_value *map, const char *key) {
    int32_t i = find(map, key, strlen(key));
    return i < 0 ? NULL : map->item[i];
}

pal_value *pal_value_key(const pal_value *map, const char *key) {
    int32_t i = find(map, key, strlen(key));
    return i < 0 ? NULL : map->key[i];
}

int pal_value_is_null(const pal_value *value) {
    if (value == NULL) {
        return 1;
    }
    if (value->kind != PALPATE_VALUE_TEXT || value->quoted) {
        return 0;
    }
    const char *t = value->text;
    return t[0] == 0 || strcmp(t, "~") == 0 || strcmp(t, "null") == 0 || strcmp(t, "Null") == 0 ||
           strcmp(t, "NULL") == 0;
}

char *pal_value_where(const pal_tree *tree, const pal_value *value, char *out, size_t size) {
    if (value != NULL && value->set > 0 && value->set <= tree->override_count) {
        (void)snprintf(out, size, "--set %.200s", tree->override[value->set - 1]);
    } else if (value != NULL && value->line > 0) {
        (void)snprintf(out, size, "%.300s:%d:%d", tree->file, (int)value->line, (int)value->column);
    } else {
        (void)snprintf(out, size, "%.300s", tree->file);
    }
    return out;
}

char *pal_value_words(const pal_value *value, char *out, size_t size) {
    if (pal_value_is_null(value)) {
        (void)snprintf(out, size, "nothing");
    } else if (value->kind == PALPATE_VALUE_MAP) {
        (void)snprintf(out, size, "a mapping");
    } else if (value->kind == PALPATE_VALUE_LIST) {
        (void)snprintf(out, size, "a list of %d", (int)value->count);
    } else {
        const char *quote = value->quoted ? "\"" : "";
        (void)snprintf(out, size, "%s%.48s%s%s", quote, value->text,
                       strlen(value->text) > 48 ? "..." : "", quote);
        for (char *c = out; *c != 0; c++) {
            if ((unsigned char)*c < 0x20 || *c == 0x7F) {
                *c = ' ';
            }
        }
    }
    return out;
}

// ---- --set -------------------------------------------------------------------------------------

typedef struct segment {
    const char *text;
    size_t length;
    long index; ///< -1: not a number
} segment;

/// Split "a.b[2].c" (up to `end`) into segments. @return count, or -1 when malformed
static int split(const char *path, const char *end, segment out[SEGMENTS_MAX]) {
    int count = 0;
    const char *p = path;
    while (p < end) {
        if (count == SEGMENTS_MAX) {
            return -1;
        }
        const char *from = p;
        int bracket = *p == '[';
        if (bracket) {
            from = ++p;
            while (p < end && *p != ']') {
                p++;
            }
        } else {
            while (p < end && *p != '.' && *p != '[') {
                p++;
            }
        }
        if (p == from) {
            return -1;
        }
        segment s = {.text = from, .length = (size_t)(p - from), .index = 0};
        for (const char *d = from; d < p; d++) {
            s.index = *d >= '0' && *d <= '9' && s.index >= 0 && s.index < 100000
                          ? 10 * s.index + (*d - '0')
                          : -1;
        }
        if (bracket && (p == end || s.index < 0)) {
            return -1;
        }
        p += bracket;
        out[count++] = s;
        if (p < end && *p == '.') {
            if (++p == end) {
                return -1;
            }
        } else if (p < end && *p != '[') {
            return -1;
        }
    }
    return count;
}

/// Item of a list by number or by the `name` of its maps; count for "one past the end"; -1: none.
static int32_t list_index(const pal_value *list, const segment *s) {
    if (s->index >= 0) {
        return s->index <= list->count ? (int32_t)s->index : -1;
    }
    for (int32_t i = 0; i < list->count; i++) {
        const pal_value *name = pal_value_get(list->item[i], "name");
        if (name != NULL && name->kind == PALPATE_VALUE_TEXT && strlen(name->text) == s->length &&
            strncmp(name->text, s->text, s->length) == 0) {
            return i;
        }
    }
    return -1;
}

static pal_status set_fail(const pal_tree *tree, int32_t index, pal_error *error,
                           const char *what) {
    return pal_fail(error, PALPATE_ERROR_SCENE, "--set %.200s: %s", tree->override[index], what);
}

pal_status pal_tree_set(pal_tree *tree, pal_value *root, int32_t index,
                        int (*is_list)(const char *path), pal_error *error) {
    const char *text = tree->override[index];
    const char *equals = strchr(text, '=');
    segment s[SEGMENTS_MAX];
    int count = equals != NULL ? split(text, equals, s) : -1;
    if (count <= 0) {
        return set_fail(
            tree, index, error,
            "found no path; allowed: dotted.path=value, e.g. body.material.poisson=0.3");
    }
    size_t size = strlen(equals + 1);
    if (size > PALPATE_SCENE_BYTES_MAX) {
        return set_fail(tree, index, error, "found a value over 1 MiB; shorten it");
    }
    pal_value *value = NULL;
    pal_status status = pal_yaml_parse(tree, equals + 1, size, index + 1, &value, error);
    if (status != PALPATE_OK) {
        return status;
    }
    if (value == NULL && (value = pal_tree_text(tree, "", 0)) != NULL) {
        value->set = index + 1;
    }
    pal_value *at = root;
    char path[512] = "";
    for (int i = 0; value != NULL; i++) {
        int last = i == count - 1;
        pal_value **slot = NULL;
        if (at->kind == PALPATE_VALUE_LIST) {
            int32_t k = list_index(at, &s[i]);
            if (k < 0) {
                char what[200];
                (void)snprintf(
                    what, sizeof what,
                    "found no item %.*s in a list of %d; allowed: 0 to %d (%d appends) or "
                    "an item's name",
                    (int)(s[i].length < 64 ? s[i].length : 64), s[i].text, (int)at->count,
                    (int)at->count, (int)at->count);
                return set_fail(tree, index, error, what);
            }
            if (k == at->count && pal_tree_append(tree, at, NULL, NULL) != 0) {
                break;
            }
            slot = &at->item[k];
            (void)strncat(path, "[]", sizeof path - strlen(path) - 1);
        } else if (at->kind == PALPATE_VALUE_MAP) {
            int32_t k = find(at, s[i].text, s[i].length);
            if (k < 0) {
                pal_value *key = pal_tree_text(tree, s[i].text, s[i].length);
                if (key == NULL || pal_tree_append(tree, at, key, NULL) != 0) {
                    break;
                }
                key->set = index + 1;
                k = at->count - 1;
            }
            slot = &at->item[k];
            size_t n = strlen(path);
            (void)snprintf(path + n, sizeof path - n, "%s%.*s", n > 0 ? "." : "",
                           (int)(s[i].length < 64 ? s[i].length : 64), s[i].text);
        } else {
            char what[200];
            (void)snprintf(what, sizeof what,
                           "found that %.100s is a single value; allowed: a key inside a mapping",
                           path);
            return set_fail(tree, index, error, what);
        }
        if (last) {
            *slot = value;
            return PALPATE_OK;
        }
        if (pal_value_is_null(*slot)) {
            *slot = pal_tree_empty(tree, is_list(path) ? PALPATE_VALUE_LIST : PALPATE_VALUE_MAP);
            if (*slot == NULL) {
                break;
            }
            (*slot)->set = index + 1;
        }
        at = *slot;
    }
    return pal_fail(error, PALPATE_ERROR_MEMORY, "--set %.200s: out of memory", text);
}
