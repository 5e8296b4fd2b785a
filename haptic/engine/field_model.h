/// @file field_model.h  Eq. 53 for a model, in whichever form it stores its rows (private).
#ifndef PALPATE_HAPTIC_FIELD_MODEL_H
#define PALPATE_HAPTIC_FIELD_MODEL_H

#include <stddef.h>

#include "haptic/engine/field.h"
#include "haptic/model/model.h"

/// Floats of a field: 3 row_count rounded up to what the kernel writes; 0 without rows.
PALPATE_API int64_t pal_field_floats(const pal_model *model);

/// Bytes of scratch one thread needs, a multiple of 64; 0 where rows are not compressed.
PALPATE_API size_t pal_field_scratch_bytes(const pal_model *model);

/// The displacement of all stored rows under nodal forces.
/// @param dof    column dofs, shape [count], no more than 3 column_count, each once
/// @param f      nodal forces [N], shape [count]
/// @param f32    f x pal_model_unit(dof) rounded to single precision, shape [count]
/// @param scratch  pal_field_scratch_bytes, 64-byte aligned; may be NULL when that is 0
/// @param[out] out  [m], shape [pal_field_floats], 64-byte aligned
/// Columns whose force is exactly 0 are not read (up to 384 dofs). Compressed rows take what is
/// left. Thread: any, with a scratch of its own; no allocation, no system call, no lock. The same
/// bits with every variant of the kernel.
PALPATE_API void pal_field_compute(pal_isa isa, const pal_model *model, int32_t count,
                                   const int32_t *dof, const double *f, const float *f32,
                                   void *scratch, float *out);

/// What a field costs, counted: bytes of touched columns (of 16-bit numbers apart: converting costs
/// a little), bytes of bases, which stay in the cache from tick to tick, bytes of near pairs, which
/// are short runs from anywhere; then what has to be begun: near pairs, clusters, and rows to put
/// where they belong.
enum {
    PALPATE_WORK_TOUCHED,
    PALPATE_WORK_INTEGER,
    PALPATE_WORK_BASIS,
    PALPATE_WORK_NEAR,
    PALPATE_WORK_PAIRS,
    PALPATE_WORK_CLUSTERS,
    PALPATE_WORK_ROWS,
    PALPATE_FIELD_WORK
};

/// Count the work of pal_field_compute for these dofs. Cost: O(count^2).
PALPATE_API void pal_field_count_work(const pal_model *model, int32_t count, const int32_t *dof,
                                      double work[PALPATE_FIELD_WORK]);

/// Nanoseconds of each kind of work: the least squares of the relative errors over the forms and
/// bodies that bench/compress measures, which prints the fit anew.
extern PALPATE_API const double pal_field_work_ns[PALPATE_FIELD_WORK];

/// Predicted nanoseconds of pal_field_compute for these dofs on the machine of bench/results.
PALPATE_API double pal_field_predict(const pal_model *model, int32_t count, const int32_t *dof);

#endif
