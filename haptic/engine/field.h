/// @file field.h  The displacement field: a weighted sum of stored columns (private).
///
/// Paper 1, Eq. 53:  U_b = C_ba f_a  over the stored rows. One call reads count x rows elements
/// once and is bound by memory. Column-major block: the column of dof j starts at element j ld.
///
/// Every variant (scalar twin, portable, AVX2, AVX-512) computes, for each row i on its own,
///     a = 0;  a = a + f[0] c0[i];  a = a + f[1] c1[i];  ...
/// Single, half and scaled storage (16-bit integers, exact in single precision) are summed in
/// single precision by IEEE 754's fused multiply-add, rounded once per column; double storage in
/// double precision with a rounding per product and per sum, and once at the end. Both are exactly
/// defined, so all variants agree bit for bit. Fused, because an instruction less per line that
/// waits for memory lets more lines be on their way (field_sweep.h has the numbers).
#ifndef PALPATE_HAPTIC_FIELD_H
#define PALPATE_HAPTIC_FIELD_H

#include <stdint.h>

#include <palpate/model.h>

typedef enum pal_isa {
    PALPATE_ISA_SCALAR = 0, ///< the twin: one row at a time, for tests
    PALPATE_ISA_PORTABLE = 1,
    PALPATE_ISA_AVX2 = 2,
    PALPATE_ISA_AVX512 = 3,
    PALPATE_ISA_COUNT = 4
} pal_isa;

typedef struct pal_field_job {
    pal_precision precision;
    const void *block; ///< 64-byte aligned; columns of ld elements
    int64_t ld;        ///< elements between columns, a multiple of 64 bytes
    int64_t
        rows; ///< rows to compute, a multiple of 8 (double), 16 (single), 32 (half, scaled); <= ld
    int32_t count;      ///< columns to sum; 0 gives zero
    const int32_t *dof; ///< column indices, shape [count]; NULL: 0, 1, 2, ...
    const double *f;    ///< nodal forces [N], shape [count]
    const float
        *f32;    ///< the same times the columns' units, rounded to single precision, shape [count]
    int32_t add; ///< 1: add to what is in out (not in double precision)
    float *out;  ///< displacement [m], shape [rows], 64-byte aligned
} pal_field_job;

/// 1 when this processor runs the variant.
int pal_field_available(pal_isa isa);
/// The widest variant this processor runs.
PALPATE_API pal_isa pal_field_best(void);
const char *pal_isa_name(pal_isa isa);

/// Compute the job with an available variant. Thread: any; no allocation, no system call.
/// Cost: O(count rows), one read of the block.
void pal_field_sweep(pal_isa isa, const pal_field_job *job);

#endif
