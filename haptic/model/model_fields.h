/// @file model_fields.h  The scalars of a model file as tables that reader and writer walk
/// (private).
///
/// Each entry is one dataset of the file and one member of the struct it is read into.
#ifndef PALPATE_HAPTIC_MODEL_FIELDS_H
#define PALPATE_HAPTIC_MODEL_FIELDS_H

#include <stddef.h>

#include "haptic/model/h5.h"

enum { PALPATE_FIELD_TEXT = -1 };

typedef struct pal_field {
    const char *path; ///< absolute for the model, relative for a tool
    size_t offset;    ///< in the struct
    int type;         ///< pal_h5_type, or PALPATE_FIELD_TEXT with `count` bytes
    int count;
    const char *unit, *description;
} pal_field;

typedef struct pal_field_list {
    const pal_field *field;
    size_t count;
} pal_field_list;

#define PALPATE_MEMBER_SIZE(type, member) ((int)sizeof(((type *)0)->member))

extern const pal_field_list pal_model_fields; ///< of struct pal_model
extern const pal_field_list pal_tool_fields;  ///< of pal_tool_def
/// Added since version 1: a file without them holds the default, 0.
extern const pal_field_list pal_model_fields_added, pal_tool_fields_added;

#endif
