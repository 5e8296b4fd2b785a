/// The scene tree -> struct pal_scene, driven by the schema table.
///
/// Every value is read by the row that describes it; defaults are read the same way from the
/// table's text. An error names place, key, what was found, what is allowed, and a remedy.
#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "haptic/error.h"
#include "src/scene_schema.h"

static pal_status read_row(pal_reading *r, int row, const pal_value *value, void *object);

// ---- Messages ----------------------------------------------------------------------------------

pal_status pal_reading_memory(pal_reading *r) {
    return pal_fail(r->error, PALPATE_ERROR_MEMORY, "%.300s: out of memory", r->tree.file);
}

pal_status pal_reading_fail(pal_reading *r, pal_status status, const pal_value *at, const char *leaf,
                            const char *found, const char *allowed, const char *remedy) {
    char where[400];
    (void)pal_value_where(&r->tree, at, where, sizeof where);
    int has_path = r->path[0] != 0;
    return pal_fail(r->error, status, "%s: %.200s%s%.64s%sfound %.200s%s%.200s%s%.250s", where, r->path,
                    has_path && leaf != NULL ? "." : "", leaf != NULL ? leaf : "",
                    has_path || leaf != NULL ? ": " : "", found, allowed != NULL ? "; allowed: " : "",
                    allowed != NULL ? allowed : "", remedy != NULL ? "; " : "",
                    remedy != NULL ? remedy : "");
}

void pal_reading_place(const pal_reading *r, const pal_value *value, pal_place *out) {
    *out = (pal_place){0};
    if (value != NULL) {
        out->line = value->set > 0 ? 0 : value->line;
        out->column = value->set > 0 ? 0 : value->column;
        out->set = value->set;
    }
    (void)snprintf(out->key, sizeof out->key, "%.*s", (int)sizeof out->key - 1, r->path);
}

/// "number [m], more than 0" for a row.
static const char *allowed_words(const pal_scene_key *key, char *out, size_t size) {
    switch (key->binding->kind) {
    case PALPATE_KEY_NUMBER:
    case PALPATE_KEY_INTEGER:
    case PALPATE_KEY_VECTOR: {
        const char *type = key->binding->kind == PALPATE_KEY_NUMBER    ? "a number"
                           : key->binding->kind == PALPATE_KEY_INTEGER ? "a whole number"
                                                                       : "[x, y, z], three numbers";
        int any = strcmp(key->allowed, "any") == 0;
        int unit = key->unit[0] != 0 && strcmp(key->unit, "-") != 0;
        const char *const *word = key->binding->word;
        (void)snprintf(out, size, "%s%s%s%s%s%s%s%s%s%s", type, unit ? " in " : "",
                       unit ? key->unit : "", any ? "" : ", ", any ? "" : key->allowed,
                       key->binding->kind == PALPATE_KEY_VECTOR && !any ? " each" : "",
                       word[0] != NULL ? ", or " : "", word[0] != NULL ? word[0] : "",
                       word[1] != NULL ? ", or " : "", word[1] != NULL ? word[1] : "");
        return out;
    }
    case PALPATE_KEY_MAP:
        return "a mapping (key: value)";
    case PALPATE_KEY_NAME:
        return "a name of at most 63 letters, digits, _ and -";
    case PALPATE_KEY_LIST:
        (void)snprintf(out, size, "a list of %s", key->allowed);
        return out;
    case PALPATE_KEY_ONE_OF:
        (void)snprintf(out, size, "one of %s", key->allowed);
        return out;
    case PALPATE_KEY_NAMED:
        (void)snprintf(out, size, "a mapping, %s", key->allowed);
        return out;
    case PALPATE_KEY_CHOICE:
    case PALPATE_KEY_SWITCH:
    case PALPATE_KEY_PATH:
        break;
    }
    return key->allowed;
}

static pal_status fail_value(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                             const char *remedy) {
    char found[128];
    char allowed[256];
    return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL,
                            pal_value_words(value, found, sizeof found),
                            allowed_words(key, allowed, sizeof allowed), remedy);
}

static const char NOT_BUILT[] = "this feature is not built yet; leave the key out";

static pal_status fail_not_built(pal_reading *r, const pal_value *value, const char *allowed) {
    char found[128];
    return pal_reading_fail(r, PALPATE_ERROR_UNSUPPORTED, value, NULL,
                            pal_value_words(value, found, sizeof found), allowed, NOT_BUILT);
}

// ---- Numbers -----------------------------------------------------------------------------------

/// A decimal number of the YAML 1.2 core schema; the whole text, nothing else (no hex, inf or nan).
static int is_decimal(const char *s) {
    if (*s == '+' || *s == '-') {
        s++;
    }
    int digits = 0;
    for (; isdigit((unsigned char)*s); s++) {
        digits = 1;
    }
    if (*s == '.') {
        for (s++; isdigit((unsigned char)*s); s++) {
            digits = 1;
        }
    }
    if (!digits) {
        return 0;
    }
    if (*s == 'e' || *s == 'E') {
        s++;
        if (*s == '+' || *s == '-') {
            s++;
        }
        if (!isdigit((unsigned char)*s)) {
            return 0;
        }
        while (isdigit((unsigned char)*s)) {
            s++;
        }
    }
    return *s == 0;
}

/// Read a number of a row's range (the caller's locale is "C").
static pal_status read_number(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                              double *out) {
    const pal_key_binding *b = key->binding;
    if (value->kind != PALPATE_VALUE_TEXT) {
        return fail_value(r, key, value, NULL);
    }
    for (int i = 0; i < 2; i++) {
        if (b->word[i] != NULL && strcmp(value->text, b->word[i]) == 0) {
            *out = b->word_value[i];
            return PALPATE_OK;
        }
    }
    if (value->quoted) {
        return fail_value(r, key, value, "remove the quotes");
    }
    if (!is_decimal(value->text)) {
        return fail_value(r, key, value,
                          isdigit((unsigned char)value->text[0])
                              ? "write the digits alone, like 0.007 or 7e-3; units are SI"
                              : "write it like 0.007 or 7e-3");
    }
    double x = strtod(value->text, NULL);
    if (!isfinite(x)) {
        return fail_value(r, key, value, "it does not fit a double");
    }
    x += 0.0; // -0 -> 0
    int low = b->low_open ? x > b->low : x >= b->low;
    int high = b->high_open ? x < b->high : x <= b->high;
    if (!low || !high) {
        return fail_value(r, key, value, b->remedy);
    }
    if ((b->flags & PALPATE_KEY_NOT_BUILT_UNLESS_0) != 0 && x != 0.0) {
        return fail_not_built(r, value, "0");
    }
    *out = x;
    return PALPATE_OK;
}

static pal_status read_integer(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                               int32_t *out) {
    double x;
    pal_status status = read_number(r, key, value, &x);
    if (status != PALPATE_OK) {
        return status;
    }
    if (x != floor(x) || fabs(x) > INT32_MAX) {
        return fail_value(r, key, value, "write a whole number");
    }
    *out = (int32_t)x;
    return PALPATE_OK;
}

static pal_status read_vector(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                              double out[3]) {
    if (value->kind != PALPATE_VALUE_LIST || value->count != 3) {
        return fail_value(r, key, value, "write three numbers in brackets");
    }
    size_t n = strlen(r->path);
    for (int i = 0; i < 3; i++) {
        (void)snprintf(r->path + n, sizeof r->path - n, "[%d]", i);
        pal_scene_key one = *key;
        pal_key_binding binding = *key->binding;
        binding.kind = PALPATE_KEY_NUMBER;
        one.binding = &binding;
        pal_status status = read_number(r, &one, value->item[i], &out[i]);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    r->path[n] = 0;
    if ((key->binding->flags & PALPATE_KEY_UNIT) != 0) {
        double big = fmax(fabs(out[0]), fmax(fabs(out[1]), fabs(out[2])));
        if (big == 0.0) {
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL, "a direction of length 0",
                                    "[x, y, z], not all 0", "write e.g. [0, 0, -1]");
        }
        double x = out[0] / big;
        double y = out[1] / big;
        double z = out[2] / big;
        double length = sqrt(x * x + y * y + z * z);
        out[0] = x / length;
        out[1] = y / length;
        out[2] = z / length;
    }
    return PALPATE_OK;
}

// ---- Words -------------------------------------------------------------------------------------

/// Damerau-Levenshtein distance (adjacent swaps count one) of short words; 99 for long ones.
static int word_distance(const char *a, const char *b) {
    enum { MAX = 32 };
    int d[MAX + 1][MAX + 1];
    int n = (int)strlen(a);
    int m = (int)strlen(b);
    if (n > MAX || m > MAX) {
        return 99;
    }
    for (int i = 0; i <= n; i++) {
        for (int j = 0; j <= m; j++) {
            if (i == 0 || j == 0) {
                d[i][j] = i + j;
                continue;
            }
            int swap = tolower((unsigned char)a[i - 1]) != tolower((unsigned char)b[j - 1]);
            int best = d[i - 1][j - 1] + swap;
            best = d[i - 1][j] + 1 < best ? d[i - 1][j] + 1 : best;
            best = d[i][j - 1] + 1 < best ? d[i][j - 1] + 1 : best;
            if (i > 1 && j > 1 && a[i - 1] == b[j - 2] && a[i - 2] == b[j - 1] &&
                d[i - 2][j - 2] + 1 < best) {
                best = d[i - 2][j - 2] + 1;
            }
            d[i][j] = best;
        }
    }
    return d[n][m];
}

/// The one of "a | b | c" at position i, copied to `out`. @return 0 when there is none
static int nth_word(const char *words, int i, char *out, size_t size) {
    for (; i > 0; i--) {
        words = strstr(words, " | ");
        if (words == NULL) {
            return 0;
        }
        words += 3;
    }
    size_t n = strcspn(words, " ");
    (void)snprintf(out, size, "%.*s", (int)n, words);
    return 1;
}

static int32_t closer_than(const char *word) {
    return (int32_t)(strlen(word) / 3) + 1; // one slip in a short word, more in a long one
}

static pal_status read_choice(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                              int32_t *out) {
    char word[32];
    char near[32] = "";
    if (value->kind == PALPATE_VALUE_TEXT) {
        int best = closer_than(value->text) + 1;
        for (int i = 0; nth_word(key->allowed, i, word, sizeof word); i++) {
            if (strcmp(word, value->text) == 0) {
                if ((key->binding->not_built >> i & 1u) != 0) {
                    return fail_not_built(r, value, key->allowed);
                }
                *out = i + key->binding->first;
                return PALPATE_OK;
            }
            int d = word_distance(word, value->text);
            if (d < best) {
                best = d;
                (void)snprintf(near, sizeof near, "%s", word);
            }
        }
    }
    char remedy[64] = "";
    if (near[0] != 0) {
        (void)snprintf(remedy, sizeof remedy, "did you mean %s?", near);
    }
    return fail_value(r, key, value, near[0] != 0 ? remedy : NULL);
}

static pal_status read_switch(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                              int32_t *out) {
    static const char *const words[2][3] = {{"false", "False", "FALSE"}, {"true", "True", "TRUE"}};
    for (int on = 0; on < 2; on++) {
        for (int i = 0; i < 3; i++) {
            if (value->kind == PALPATE_VALUE_TEXT && !value->quoted &&
                strcmp(value->text, words[on][i]) == 0) {
                *out = on;
                return PALPATE_OK;
            }
        }
    }
    return fail_value(r, key, value, NULL);
}

/// Letters, digits, _ and -, and any UTF-8 beyond ASCII; what --set can address.
static int is_name(const char *s) {
    size_t n = strlen(s);
    if (n == 0 || n >= PALPATE_NAME_MAX) {
        return 0;
    }
    for (; *s != 0; s++) {
        unsigned char c = (unsigned char)*s;
        if (c < 0x80 && !isalnum(c) && c != '_' && c != '-') {
            return 0;
        }
    }
    return 1;
}

static pal_status read_path(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                            char out[1024]) {
    if (value->kind != PALPATE_VALUE_TEXT || value->text[0] == 0) {
        return fail_value(r, key, value, NULL);
    }
    // relative to the scene file; on the command line to the working directory
    char joined[PATH_MAX];
    const char *base = "";
    char directory[1024];
    if (value->text[0] != '/') {
        (void)snprintf(directory, sizeof directory, "%s", r->scene->path);
        char *slash = strrchr(directory, '/');
        if (value->set > 0) {
            if (getcwd(directory, sizeof directory) == NULL) {
                return pal_reading_fail(r, PALPATE_ERROR_SYSTEM, value, NULL,
                                        "no working directory", NULL, "give an absolute path");
            }
        } else if (slash != NULL) {
            *slash = 0;
        }
        base = directory;
    }
    (void)snprintf(joined, sizeof joined, "%s%s%s", base, base[0] != 0 ? "/" : "", value->text);
    int missing = access(joined, R_OK) != 0;
    if (missing && (key->binding->flags & PALPATE_KEY_EXISTS) != 0) {
        char found[1200];
        (void)snprintf(found, sizeof found, "%.48s, but %.120s cannot be read (%s)", value->text,
                       joined, strerror(errno));
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL, found, key->allowed,
                                value->set > 0
                                    ? "paths on the command line are relative to the working directory"
                                    : "paths are relative to the scene file");
    }
    char *real = missing ? NULL : realpath(joined, NULL);
    const char *path = real != NULL ? real : joined;
    int fits = strlen(path) < 1024;
    if (fits) {
        (void)snprintf(out, 1024, "%s", path);
    }
    free(real);
    if (!fits) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL, "a path over 1023 bytes",
                                key->allowed, "move the file to a shorter path");
    }
    if (missing) {
        pal_place place;
        pal_reading_place(r, value, &place);
        return pal_scene_warn(r->scene, &place, "%.200s cannot be read (%s); `run` will need it", path,
                              strerror(errno));
    }
    return PALPATE_OK;
}

// ---- Mappings ----------------------------------------------------------------------------------

/// Row of child `name` of a row, or -1.
static int child_row(int row, const char *name) {
    const pal_scene_key *keys;
    (void)pal_scene_schema(&keys);
    char path[256];
    (void)snprintf(path, sizeof path, "%s%s%.64s", keys[row].path, keys[row].path[0] != 0 ? "." : "",
                   name);
    return strlen(name) > 64 || strpbrk(name, ".[*") != NULL ? -1 : pal_schema_find(path);
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
    int best = closer_than(key->text) + 1;
    for (int i = 0; i < count; i++) {
        const char *name = child_name(keys[row].path, keys[i].path);
        if (name == NULL) {
            continue;
        }
        size_t n = strlen(list);
        (void)snprintf(list + n, sizeof list - n, "%s%s", n > 0 ? ", " : "", name);
        int d = word_distance(name, key->text);
        if (d < best) {
            best = d;
            (void)snprintf(remedy, sizeof remedy, "did you mean %s?", name);
        }
    }
    for (int i = 0; i < count && remedy[0] == 0; i++) { // a known key in the wrong place
        const char *dot = strrchr(keys[i].path, '.');
        const char *name = dot != NULL ? dot + 1 : keys[i].path;
        if (strcmp(name, key->text) == 0) {
            (void)snprintf(remedy, sizeof remedy, "did you mean %.100s?", keys[i].path);
        }
    }
    return pal_reading_fail(r, PALPATE_ERROR_SCENE, key, key->text, "an unknown key", list,
                            remedy[0] != 0 ? remedy : "remove it");
}

static pal_status read_child(pal_reading *r, int row, const char *name, const pal_value *value,
                             void *object) {
    size_t n = strlen(r->path);
    (void)snprintf(r->path + n, sizeof r->path - n, "%s%s", n > 0 && name[0] != '[' ? "." : "", name);
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
        return fail_value(r, key, value, NULL);
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
                                    allowed_words(key, allowed, sizeof allowed), "keep one");
        }
    }
    if (one_of && options == 0) {
        char allowed[200];
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, at, NULL,
                                value->count == 0 ? "nothing" : "none of them",
                                allowed_words(key, allowed, sizeof allowed), "add one");
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
            const pal_value *empty_key = pal_value_key(value, name);
            (void)snprintf(remedy, sizeof remedy, "add %s: %s", name, keys[child].help);
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, empty_key != NULL ? empty_key : at, name,
                                    "nothing, but it is required",
                                    allowed_words(&keys[child], allowed, sizeof allowed), remedy);
        } else {
            status = read_default(r, child, name, object);
        }
        if (status != PALPATE_OK) {
            return status;
        }
    }
    return PALPATE_OK;
}

// ---- Lists and named items -----------------------------------------------------------------------

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
        return fail_value(r, key, value, named ? NULL : "begin each item with '- '");
    }
    if (b->inline_max > 0 && value->count > b->inline_max) {
        return fail_value(r, key, value, "remove some");
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
            if (!is_name(value->key[i]->text)) {
                char found[128];
                return pal_reading_fail(r, PALPATE_ERROR_SCENE, value->key[i], NULL,
                                        pal_value_words(value->key[i], found, sizeof found),
                                        "names of at most 63 letters, digits, _ and -", "rename it");
            }
            (void)snprintf(name, sizeof name, "%s", value->key[i]->text);
            (void)snprintf(item + b->name_offset, PALPATE_NAME_MAX, "%s", value->key[i]->text);
        }
        const pal_value *v = value->item[i];
        if (pal_value_is_null(v)) {
            size_t n = strlen(r->path);
            (void)snprintf(r->path + n, sizeof r->path - n, "%s%s", named ? "." : "", name);
            return fail_value(r, &keys[item_row], v != NULL ? v : value, "write it or remove it");
        }
        pal_status status = read_child(r, item_row, name, v, item);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    return PALPATE_OK;
}

static pal_status read_leaf(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                            void *at) {
    switch (key->binding->kind) {
    case PALPATE_KEY_NUMBER:
        return read_number(r, key, value, at);
    case PALPATE_KEY_INTEGER:
        return read_integer(r, key, value, at);
    case PALPATE_KEY_VECTOR:
        return read_vector(r, key, value, at);
    case PALPATE_KEY_CHOICE:
        return read_choice(r, key, value, at);
    case PALPATE_KEY_SWITCH:
        return read_switch(r, key, value, at);
    case PALPATE_KEY_PATH:
        return read_path(r, key, value, at);
    case PALPATE_KEY_NAME:
        if (value->kind != PALPATE_VALUE_TEXT || !is_name(value->text)) {
            return fail_value(r, key, value, "rename it");
        }
        (void)snprintf(at, PALPATE_NAME_MAX, "%s", value->text);
        return PALPATE_OK;
    case PALPATE_KEY_MAP:
    case PALPATE_KEY_ONE_OF:
    case PALPATE_KEY_LIST:
    case PALPATE_KEY_NAMED:
        break;
    }
    return PALPATE_OK;
}

/// `all: true`, for an option that may also be a bare word.
static int is_bare_true(const pal_key_binding *b, const pal_value *value) {
    return (b->flags & PALPATE_KEY_BARE) != 0 && value != NULL && value->kind == PALPATE_VALUE_TEXT &&
           strcmp(value->text, "true") == 0;
}

static pal_status read_row(pal_reading *r, int row, const pal_value *value, void *object) {
    const pal_scene_key *keys;
    (void)pal_scene_schema(&keys);
    const pal_key_binding *b = keys[row].binding;
    if (b->has_place) {
        pal_reading_place(r, value, (pal_place *)(void *)((char *)object + b->place_offset));
    }
    if ((b->flags & PALPATE_KEY_NOT_BUILT) != 0) {
        return fail_not_built(r, value, "nothing");
    }
    pal_status status;
    switch (b->kind) {
    case PALPATE_KEY_MAP:
    case PALPATE_KEY_ONE_OF:
        status = is_bare_true(b, value) ? PALPATE_OK : read_map(r, row, value, object);
        break;
    case PALPATE_KEY_LIST:
    case PALPATE_KEY_NAMED:
        status = pal_value_is_null(value) ? fail_value(r, &keys[row], value, "write it")
                                          : read_items(r, row, value, object);
        break;
    default:
        status = pal_value_is_null(value)
                     ? fail_value(r, &keys[row], value, "write it")
                     : read_leaf(r, &keys[row], value, (char *)object + b->offset);
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
