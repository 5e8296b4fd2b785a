/// One value of a scene: numbers, vectors, words, names and paths, read by the row of the schema
/// that describes them, and the messages about them.
#include <ctype.h>
#include <errno.h>
#include <limits.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "src/scene/scene_schema.h"

// ---- Messages ----------------------------------------------------------------------------------

pal_status pal_reading_memory(pal_reading *r) {
    return pal_fail(r->error, PALPATE_ERROR_MEMORY, "%.300s: out of memory", r->tree.file);
}

pal_status pal_reading_fail(pal_reading *r, pal_status status, const pal_value *at,
                            const char *leaf, const char *found, const char *allowed,
                            const char *remedy) {
    char where[400];
    (void)pal_value_where(&r->tree, at, where, sizeof where);
    int has_path = r->path[0] != 0;
    return pal_fail(r->error, status, "%s: %.200s%s%.64s%sfound %.200s%s%.200s%s%.250s", where,
                    r->path, has_path && leaf != NULL ? "." : "", leaf != NULL ? leaf : "",
                    has_path || leaf != NULL ? ": " : "", found,
                    allowed != NULL ? "; allowed: " : "", allowed != NULL ? allowed : "",
                    remedy != NULL ? "; " : "", remedy != NULL ? remedy : "");
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
const char *pal_key_allowed(const pal_scene_key *key, char *out, size_t size) {
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

pal_status pal_reading_fail_value(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                                  const char *remedy) {
    char found[128];
    char allowed[256];
    return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL,
                            pal_value_words(value, found, sizeof found),
                            pal_key_allowed(key, allowed, sizeof allowed), remedy);
}

static const char NOT_BUILT[] = "this feature is not built yet; leave the key out";

pal_status pal_reading_not_built(pal_reading *r, const pal_value *value, const char *allowed) {
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
        return pal_reading_fail_value(r, key, value, NULL);
    }
    for (int i = 0; i < 2; i++) {
        if (b->word[i] != NULL && strcmp(value->text, b->word[i]) == 0) {
            *out = b->word_value[i];
            return PALPATE_OK;
        }
    }
    if (value->quoted) {
        return pal_reading_fail_value(r, key, value, "remove the quotes");
    }
    if (!is_decimal(value->text)) {
        return pal_reading_fail_value(
            r, key, value,
            isdigit((unsigned char)value->text[0])
                ? "write the digits alone, like 0.007 or 7e-3; units are SI"
                : "write it like 0.007 or 7e-3");
    }
    double x = strtod(value->text, NULL);
    if (!isfinite(x)) {
        return pal_reading_fail_value(r, key, value, "it does not fit a double");
    }
    x += 0.0; // -0 -> 0
    int low = b->low_open ? x > b->low : x >= b->low;
    int high = b->high_open ? x < b->high : x <= b->high;
    if (!low || !high) {
        return pal_reading_fail_value(r, key, value, b->remedy);
    }
    if ((b->flags & PALPATE_KEY_NOT_BUILT_UNLESS_0) != 0 && x != 0.0) {
        return pal_reading_not_built(r, value, "0");
    }
    *out = x;
    return PALPATE_OK;
}

static pal_status read_integer(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                               int32_t *out) {
    double x = 0.0;
    pal_status status = read_number(r, key, value, &x);
    if (status != PALPATE_OK) {
        return status;
    }
    if (x != floor(x) || fabs(x) > INT32_MAX) {
        return pal_reading_fail_value(r, key, value, "write a whole number");
    }
    *out = (int32_t)x;
    return PALPATE_OK;
}

static pal_status read_vector(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                              double out[3]) {
    if (value->kind != PALPATE_VALUE_LIST || value->count != 3) {
        return pal_reading_fail_value(r, key, value, "write three numbers in brackets");
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
int pal_word_distance(const char *a, const char *b) {
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

int pal_word_slips(const char *word) {
    return (int32_t)(strlen(word) / 3) + 1; // one slip in a short word, more in a long one
}

static pal_status read_choice(pal_reading *r, const pal_scene_key *key, const pal_value *value,
                              int32_t *out) {
    char word[32];
    char near[32] = "";
    if (value->kind == PALPATE_VALUE_TEXT) {
        int best = pal_word_slips(value->text) + 1;
        for (int i = 0; nth_word(key->allowed, i, word, sizeof word); i++) {
            if (strcmp(word, value->text) == 0) {
                if ((key->binding->not_built >> i & 1u) != 0) {
                    return pal_reading_not_built(r, value, key->allowed);
                }
                *out = i + key->binding->first;
                return PALPATE_OK;
            }
            int d = pal_word_distance(word, value->text);
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
    return pal_reading_fail_value(r, key, value, near[0] != 0 ? remedy : NULL);
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
    return pal_reading_fail_value(r, key, value, NULL);
}

/// Letters, digits, _ and -, and any UTF-8 beyond ASCII; what --set can address.
int pal_word_is_name(const char *s) {
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
        return pal_reading_fail_value(r, key, value, NULL);
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
    const char *why = missing ? strerror(errno) : "";
    if (missing && (key->binding->flags & PALPATE_KEY_EXISTS) != 0) {
        char found[1200];
        (void)snprintf(found, sizeof found, "%.48s, but %.120s cannot be read (%s)", value->text,
                       joined, why);
        return pal_reading_fail(
            r, PALPATE_ERROR_SCENE, value, NULL, found, key->allowed,
            value->set > 0 ? "paths on the command line are relative to the working directory"
                           : "paths are relative to the scene file");
    }
    char *real = missing ? NULL : realpath(joined, NULL);
    if (!missing && real == NULL && errno == ENOMEM) {
        return pal_reading_memory(r);
    }
    const char *path = real != NULL ? real : joined;
    size_t size = strlen(path) + 1;
    int fits = size <= 1024;
    if (fits) {
        memcpy(out, path, size);
    }
    free(real);
    if (!fits) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL, "a path over 1023 bytes",
                                key->allowed, "move the file to a shorter path");
    }
    if (missing) {
        pal_place place;
        pal_reading_place(r, value, &place);
        return pal_scene_warn(r->scene, &place, "%.200s cannot be read (%s); `run` will need it",
                              path, why);
    }
    return PALPATE_OK;
}

pal_status pal_reading_leaf(pal_reading *r, const pal_scene_key *key, const pal_value *value,
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
        if (value->kind != PALPATE_VALUE_TEXT || !pal_word_is_name(value->text)) {
            return pal_reading_fail_value(r, key, value, "rename it");
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
