/// @file compress.h  The cheapest form of the stored rows that meets a tolerance (private).
#ifndef PALPATE_SRC_COMPRESS_H
#define PALPATE_SRC_COMPRESS_H

#include <palpate/precompute.h>

#include "haptic/model/model.h"

/// Rows in one form, apart from the model they belong to: a model whose other members are borrowed.
/// Free with pal_rows_clear, or hand over with pal_rows_take.
typedef struct pal_model pal_rows;

/// The model's rows again in another precision. @return PALPATE_OK; _MEMORY, _ARGUMENT (out of
/// range)
PALPATE_API pal_status pal_rows_convert(const pal_model *model, pal_precision precision,
                                        pal_rows *out, pal_error *error);

/// The model's rows, which must be dense in double or single precision, as bases (row_bases.h).
/// @param tolerance  of each column at any node, relative to the column's largest displacement
/// @return PALPATE_OK; _ARGUMENT, _MEMORY, _SINGULAR (a decomposition failed), _CANCELLED
PALPATE_API pal_status pal_rows_compress(const pal_model *model, double tolerance,
                                         const pal_progress *progress, pal_rows *out,
                                         pal_error *error);

PALPATE_API void pal_rows_clear(pal_rows *rows);

/// Put `rows` into the model instead of its own.
PALPATE_API void pal_rows_take(pal_model *model, pal_rows *rows);

/// Replace the model's rows, dense in double precision or single, by the form with the lowest
/// predicted cost per field (pal_field_predict for 45 touched nodes) whose error over sampled
/// contacts (field_sample.h: max |du| / max |u|) is within `tolerance`; fills in info.field and
/// info.precision. With tolerance 0 the rows stay and only info.field is measured.
/// @return PALPATE_OK; _MEMORY, _CANCELLED
PALPATE_API pal_status pal_compress(pal_model *model, double tolerance,
                                    const pal_progress *progress, pal_error *error);

#endif
