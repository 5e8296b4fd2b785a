/// YAML text -> pal_value tree. The only file that includes libyaml.
///
/// libyaml's document API gives every node's line and column. Aliases are expanded into copies
/// here, so that a later --set changes one place only; the number of values and the depth are
/// limited, which bounds "billion laughs" documents and self-referencing aliases alike.
#include <stdio.h>
#include <string.h>

#include <yaml.h>

#include "haptic/base/error.h"
#include "src/scene/scene_tree.h"

typedef struct reader {
    pal_tree *tree;
    yaml_document_t *document;
    int32_t set;
    pal_error *error;
} reader;

static void where_mark(const pal_tree *tree, int32_t set, size_t line, size_t column, char *out,
                       size_t size) {
    pal_value at = {.line = (int32_t)line, .column = (int32_t)column, .set = set};
    (void)pal_value_where(tree, &at, out, size);
}

/// "where: what", `what` being the whole sentence.
static pal_status fail_at(reader *r, yaml_mark_t mark, const char *what) {
    char where[400];
    where_mark(r->tree, r->set, mark.line + 1, mark.column + 1, where, sizeof where);
    return pal_fail(r->error, PALPATE_ERROR_SCENE, "%s: %s", where, what);
}

/// Byte offset -> line and column (characters), 1-based.
static void offset_place(const char *text, size_t offset, size_t *line, size_t *column) {
    *line = 1;
    *column = 1;
    for (size_t i = 0; i < offset; i++) {
        if (text[i] == '\n') {
            ++*line;
            *column = 1;
        } else if (((unsigned char)text[i] & 0xC0u) != 0x80u) {
            ++*column;
        }
    }
}

/// Length of the valid UTF-8 sequence at s (0: invalid). Overlong forms and surrogates are invalid.
static size_t utf8_length(const unsigned char *s, size_t left) {
    if (s[0] < 0x80) {
        return 1;
    }
    size_t n = s[0] >= 0xF0 ? 4 : s[0] >= 0xE0 ? 3 : 2;
    if (s[0] < 0xC2 || s[0] > 0xF4 || n > left) {
        return 0;
    }
    for (size_t i = 1; i < n; i++) {
        if ((s[i] & 0xC0u) != 0x80u) {
            return 0;
        }
    }
    if ((s[0] == 0xE0 && s[1] < 0xA0) || (s[0] == 0xED && s[1] > 0x9F) ||
        (s[0] == 0xF0 && s[1] < 0x90) || (s[0] == 0xF4 && s[1] > 0x8F)) {
        return 0;
    }
    return n;
}

/// Encoding and control characters, located, before libyaml sees the text.
static pal_status check_bytes(reader *r, const char *text, size_t size) {
    for (size_t i = 0; i < size;) {
        unsigned char c = (unsigned char)text[i];
        size_t n = utf8_length((const unsigned char *)text + i, size - i);
        if (n != 0 && (c >= 0x20 || c == '\t' || c == '\n' || c == '\r') && c != 0x7F) {
            i += n;
            continue;
        }
        size_t line;
        size_t column;
        char where[400];
        offset_place(text, i, &line, &column);
        where_mark(r->tree, r->set, line, column, where, sizeof where);
        if (n == 0) {
            return pal_fail(r->error, PALPATE_ERROR_SCENE,
                            "%s: found byte 0x%02X; allowed: UTF-8 text; save the file as UTF-8",
                            where, c);
        }
        return pal_fail(r->error, PALPATE_ERROR_SCENE,
                        "%s: found control character 0x%02X; allowed: printable text; remove it",
                        where, c);
    }
    return PALPATE_OK;
}

/// libyaml's time grows with the square of the nesting of brackets and of the number of anchors, so
/// both are limited before it sees the text (brackets and & in comments and quotes are counted too:
/// no scene comes near).
static pal_status check_cost(reader *r, const char *text, size_t size) {
    enum { BRACKETS_MAX = 200, ANCHORS_MAX = 1000 };
    int depth = 0;
    int anchors = 0;
    for (size_t i = 0; i < size; i++) {
        depth += text[i] == '[' || text[i] == '{';
        depth -= (text[i] == ']' || text[i] == '}') && depth > 0;
        anchors += text[i] == '&';
        if (depth <= BRACKETS_MAX && anchors <= ANCHORS_MAX) {
            continue;
        }
        size_t line;
        size_t column;
        char where[400];
        offset_place(text, i, &line, &column);
        where_mark(r->tree, r->set, line, column, where, sizeof where);
        return pal_fail(r->error, PALPATE_ERROR_SCENE, "%s: found %s; a scene needs fewer than 10",
                        where,
                        anchors > ANCHORS_MAX ? "more than 1000 anchors (&)"
                                              : "brackets nested deeper than 200");
    }
    return PALPATE_OK;
}

static pal_status syntax_error(reader *r, const yaml_parser_t *parser, const char *text,
                               size_t size) {
    // a failed allocation in the loader leaves no error at all (libyaml 0.2.5)
    if (parser->error == YAML_MEMORY_ERROR || parser->error == YAML_NO_ERROR) {
        return pal_fail(r->error, PALPATE_ERROR_MEMORY, "%s: out of memory", r->tree->file);
    }
    yaml_mark_t mark = parser->problem_mark;
    if (parser->context != NULL && mark.index >= size) {
        mark = parser->context_mark; // what was never closed, rather than the end of the file
    }
    size_t line = mark.line + 1;
    size_t column = mark.column + 1;
    if (parser->error == YAML_READER_ERROR) {
        size_t offset = parser->problem_offset < size ? parser->problem_offset : size;
        offset_place(text, offset, &line, &column);
    }
    char where[400];
    where_mark(r->tree, r->set, line, column, where, sizeof where);
    const char *remedy = "check indentation, brackets and colons on this line and the one before";
    if (mark.index < size && text[mark.index] == '\t') {
        remedy = "found a tab: indent with spaces";
    }
    return pal_fail(r->error, PALPATE_ERROR_SCENE, "%s: not valid YAML: %s%s%s; %s", where,
                    parser->problem != NULL ? parser->problem : "syntax error",
                    parser->context != NULL ? " " : "",
                    parser->context != NULL ? parser->context : "", remedy);
}

static int tag_is_known(const char *tag) {
    static const char *const known[] = {YAML_NULL_TAG,  YAML_BOOL_TAG, YAML_STR_TAG, YAML_INT_TAG,
                                        YAML_FLOAT_TAG, YAML_SEQ_TAG,  YAML_MAP_TAG};
    for (size_t i = 0; tag != NULL && i < sizeof known / sizeof known[0]; i++) {
        if (strcmp(tag, known[i]) == 0) {
            return 1;
        }
    }
    return tag == NULL || strcmp(tag, "!") == 0;
}

static pal_status convert(reader *r, int index, int depth, pal_value **out);

static pal_status convert_text(reader *r, const yaml_node_t *node, pal_value **out) {
    size_t length = node->data.scalar.length;
    const char *text = (const char *)node->data.scalar.value;
    if (memchr(text, 0, length) != NULL) {
        return fail_at(r, node->start_mark, "found a zero byte in a value; remove it");
    }
    if (length > PALPATE_SCENE_TEXT_MAX) {
        return fail_at(r, node->start_mark, "found a value longer than 1023 bytes; shorten it");
    }
    *out = pal_tree_text(r->tree, text, length);
    if (*out != NULL) {
        (*out)->quoted = node->data.scalar.style != YAML_PLAIN_SCALAR_STYLE;
    }
    return PALPATE_OK;
}

static pal_status convert_list(reader *r, const yaml_node_t *node, int depth, pal_value *list) {
    const yaml_node_item_t *i = node->data.sequence.items.start;
    for (; i < node->data.sequence.items.top; i++) {
        pal_value *item;
        pal_status status = convert(r, *i, depth + 1, &item);
        if (status != PALPATE_OK) {
            return status;
        }
        if (pal_tree_append(r->tree, list, NULL, item) != 0) {
            return pal_fail(r->error, PALPATE_ERROR_MEMORY, "%s: out of memory", r->tree->file);
        }
    }
    return PALPATE_OK;
}

static pal_status convert_map(reader *r, const yaml_node_t *node, int depth, pal_value *map) {
    const yaml_node_pair_t *i = node->data.mapping.pairs.start;
    for (; i < node->data.mapping.pairs.top; i++) {
        const yaml_node_t *name = yaml_document_get_node(r->document, i->key);
        if (name == NULL || name->type != YAML_SCALAR_NODE) {
            return fail_at(r, name != NULL ? name->start_mark : node->start_mark,
                           "found a key that is a list or a mapping; allowed: a name");
        }
        pal_value *key;
        pal_status status = convert(r, i->key, depth + 1, &key);
        if (status != PALPATE_OK) {
            return status;
        }
        const pal_value *first = pal_value_key(map, key->text);
        if (first != NULL) {
            char where[400];
            (void)pal_value_where(r->tree, key, where, sizeof where);
            return pal_fail(r->error, PALPATE_ERROR_SCENE,
                            "%s: %.100s: found a second time (first at line %d, column %d); "
                            "allowed: once; remove one",
                            where, key->text, (int)first->line, (int)first->column);
        }
        pal_value *item;
        status = convert(r, i->value, depth + 1, &item);
        if (status != PALPATE_OK) {
            return status;
        }
        if (pal_tree_append(r->tree, map, key, item) != 0) {
            return pal_fail(r->error, PALPATE_ERROR_MEMORY, "%s: out of memory", r->tree->file);
        }
    }
    return PALPATE_OK;
}

static pal_status convert(reader *r, int index, int depth, pal_value **out) {
    *out = NULL;
    const yaml_node_t *node = yaml_document_get_node(r->document, index);
    if (node == NULL) {
        return pal_fail(r->error, PALPATE_ERROR_SCENE, "%s: not valid YAML", r->tree->file);
    }
    if (depth > PALPATE_SCENE_DEPTH_MAX) {
        return fail_at(
            r, node->start_mark,
            "found values nested deeper than 32 levels (or an alias inside itself); a scene needs "
            "fewer than 10");
    }
    if (++r->tree->value_count > PALPATE_SCENE_VALUES_MAX) {
        return fail_at(r, node->start_mark,
                       "found more than 20000 values (an alias counts each time); allowed: at most "
                       "20000");
    }
    if (!tag_is_known((const char *)node->tag)) {
        char what[160];
        (void)snprintf(what, sizeof what, "found tag %.100s; allowed: none; remove it",
                       (const char *)node->tag);
        return fail_at(r, node->start_mark, what);
    }
    pal_status status = PALPATE_OK;
    if (node->type == YAML_SCALAR_NODE) {
        status = convert_text(r, node, out);
    } else {
        *out = pal_tree_empty(r->tree, node->type == YAML_SEQUENCE_NODE ? PALPATE_VALUE_LIST
                                                                        : PALPATE_VALUE_MAP);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    if (*out == NULL) {
        return pal_fail(r->error, PALPATE_ERROR_MEMORY, "%s: out of memory", r->tree->file);
    }
    (*out)->line = (int32_t)node->start_mark.line + 1;
    (*out)->column = (int32_t)node->start_mark.column + 1;
    (*out)->set = r->set;
    if (node->type == YAML_SEQUENCE_NODE) {
        return convert_list(r, node, depth, *out);
    }
    return node->type == YAML_MAPPING_NODE ? convert_map(r, node, depth, *out) : PALPATE_OK;
}

pal_status pal_yaml_parse(pal_tree *tree, const char *text, size_t size, int32_t set,
                          pal_value **out, pal_error *error) {
    yaml_document_t document;
    reader r = {.tree = tree, .document = &document, .set = set, .error = error};
    *out = NULL;
    if (size >= 3 && memcmp(text, "\xEF\xBB\xBF", 3) == 0) {
        text += 3; // byte order mark
        size -= 3;
    }
    pal_status status = check_bytes(&r, text, size);
    if (status == PALPATE_OK) {
        status = check_cost(&r, text, size);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    yaml_parser_t parser;
    if (!yaml_parser_initialize(&parser)) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: out of memory", tree->file);
    }
    yaml_parser_set_encoding(&parser, YAML_UTF8_ENCODING);
    yaml_parser_set_input_string(&parser, (const unsigned char *)text, size);
    if (!yaml_parser_load(&parser, &document)) {
        status = syntax_error(&r, &parser, text, size);
        yaml_parser_delete(&parser);
        return status;
    }
    if (yaml_document_get_root_node(&document) != NULL) {
        status = convert(&r, 1, 0, out);
    }
    yaml_document_delete(&document);
    if (status == PALPATE_OK && *out != NULL) {
        // a second document is an error, and so is a syntax error after the first
        if (!yaml_parser_load(&parser, &document)) {
            status = syntax_error(&r, &parser, text, size);
        } else {
            const yaml_node_t *second = yaml_document_get_root_node(&document);
            if (second != NULL) {
                status =
                    fail_at(&r, second->start_mark,
                            "found a second document; allowed: one; remove the '---' before it");
            }
            yaml_document_delete(&document);
        }
    }
    yaml_parser_delete(&parser);
    return status;
}
