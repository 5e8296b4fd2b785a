/// @file field.c  Eq. 53 over the stored rows: variants by instruction set, chosen at run time.
///
/// The arithmetic is in field_sweep.h, written once with a wide type and instantiated per variant;
/// only the conversion of halves differs. See field.h for the order of summation.
#include "haptic/engine/field.h"

#include <string.h>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#endif

enum {
    SWEEP_GROUP = 12,         ///< columns per pass: as many pointers as there are registers for
    SWEEP_ROWS = 16384,       ///< rows per panel: long runs matter more than L1, 64 KiB in L2 do
    SWEEP_ROWS_DOUBLE = 2048, ///< the same in double storage
    SWEEP_SHORT = 512,        ///< blocks of so few rows are summed in registers
};

/// IEEE half to single, exact for every finite value (stored blocks hold no others). The subnormal
/// branch is a subtraction of normal numbers: it does not change when denormals are flushed.
static inline float half_to_float(uint16_t h) {
    uint32_t magnitude = (uint32_t)(h & 0x7fffu) << 13, sign = (uint32_t)(h & 0x8000u) << 16, bits;
    float value;
    if (magnitude < 0x00800000u) {
        bits = magnitude | 0x38800000u;
        memcpy(&value, &bits, sizeof value);
        value -= 0x1p-14f;
    } else {
        bits = magnitude + 0x38000000u;
        memcpy(&value, &bits, sizeof value);
    }
    memcpy(&bits, &value, sizeof bits);
    bits |= sign;
    memcpy(&value, &bits, sizeof value);
    return value;
}

/// The twin that the others must equal bit for bit.
static void sweep_scalar(const pal_field_job *job) {
    for (int64_t i = 0; i < job->rows; i++) {
        if (job->precision == PALPATE_PRECISION_DOUBLE) {
            double a = 0.0;
            for (int32_t k = 0; k < job->count; k++) {
                int64_t at = job->dof != NULL ? job->dof[k] : k;
                a += job->f[k] * ((const double *)job->block)[at * job->ld + i];
            }
            job->out[i] = (float)a;
            continue;
        }
        float a = job->add ? job->out[i] : 0.0f;
        for (int32_t k = 0; k < job->count; k++) {
            int64_t at = (job->dof != NULL ? job->dof[k] : k) * job->ld + i;
            float c = job->precision == PALPATE_PRECISION_SINGLE ? ((const float *)job->block)[at]
                      : job->precision == PALPATE_PRECISION_SCALED
                          ? (float)((const int16_t *)job->block)[at]
                          : half_to_float(((const uint16_t *)job->block)[at]);
            a += job->f32[k] * c;
        }
        job->out[i] = a;
    }
}

#define SWEEP(name) sweep_portable_##name
#define SWEEP_TARGET
#define SWEEP_WIDTH 16
#define SWEEP_HALF(p, v)                                                                           \
    ((v) = (sweep_portable_floats){half_to_float((p)[0]), half_to_float((p)[1]),                   \
                                   half_to_float((p)[2]), half_to_float((p)[3])})
#define SWEEP_INTEGER(p, v)                                                                        \
    ((v) = (sweep_portable_floats){(float)(p)[0], (float)(p)[1], (float)(p)[2], (float)(p)[3]})
#include "haptic/engine/field_sweep.h"
#undef SWEEP
#undef SWEEP_TARGET
#undef SWEEP_WIDTH
#undef SWEEP_HALF
#undef SWEEP_INTEGER

#if defined(__x86_64__)
#define SWEEP(name) sweep_avx2_##name
#define SWEEP_TARGET __attribute__((target("avx2,f16c")))
#define SWEEP_WIDTH 32
#define SWEEP_HALF(p, v)                                                                           \
    ((v) = (sweep_avx2_floats)_mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)(const void *)(p))))
#define SWEEP_INTEGER(p, v)                                                                        \
    ((v) = (sweep_avx2_floats)_mm256_cvtepi32_ps(                                                  \
         _mm256_cvtepi16_epi32(_mm_loadu_si128((const __m128i *)(const void *)(p)))))
#include "haptic/engine/field_sweep.h"
#undef SWEEP
#undef SWEEP_TARGET
#undef SWEEP_WIDTH
#undef SWEEP_HALF
#undef SWEEP_INTEGER

#define SWEEP(name) sweep_avx512_##name
#define SWEEP_TARGET __attribute__((target("avx512f")))
#define SWEEP_WIDTH 64
#define SWEEP_HALF(p, v)                                                                           \
    ((v) = (sweep_avx512_floats)_mm512_cvtph_ps(                                                   \
         _mm256_loadu_si256((const __m256i *)(const void *)(p))))
#define SWEEP_INTEGER(p, v)                                                                        \
    ((v) = (sweep_avx512_floats)_mm512_cvtepi32_ps(                                                \
         _mm512_cvtepi16_epi32(_mm256_loadu_si256((const __m256i *)(const void *)(p)))))
#include "haptic/engine/field_sweep.h"
#undef SWEEP
#undef SWEEP_TARGET
#undef SWEEP_WIDTH
#undef SWEEP_HALF
#undef SWEEP_INTEGER
#endif

#if defined(__x86_64__)
/// Conversion of halves; a flag of its own that __builtin_cpu_supports does not know everywhere.
static int have_f16c(void) {
    unsigned a, b, c, d;
    return __get_cpuid(1, &a, &b, &c, &d) && (c & bit_F16C) != 0;
}
#endif

int pal_field_available(pal_isa isa) {
    switch (isa) {
    case PALPATE_ISA_SCALAR:
    case PALPATE_ISA_PORTABLE:
        return 1;
    case PALPATE_ISA_AVX2:
#if defined(__x86_64__)
        return __builtin_cpu_supports("avx2") && have_f16c();
#else
        return 0;
#endif
    case PALPATE_ISA_AVX512:
#if defined(__x86_64__)
        return __builtin_cpu_supports("avx512f") != 0;
#else
        return 0;
#endif
    case PALPATE_ISA_COUNT:
        break;
    }
    return 0;
}

pal_isa pal_field_best(void) {
    pal_isa best = PALPATE_ISA_PORTABLE;
    for (int i = PALPATE_ISA_PORTABLE; i < PALPATE_ISA_COUNT; i++) {
        if (pal_field_available((pal_isa)i)) {
            best = (pal_isa)i;
        }
    }
    return best;
}

const char *pal_isa_name(pal_isa isa) {
    static const char *const name[PALPATE_ISA_COUNT] = {"scalar", "portable", "avx2", "avx512"};
    return isa >= 0 && isa < PALPATE_ISA_COUNT ? name[isa] : "unknown";
}

void pal_field_sweep(pal_isa isa, const pal_field_job *job) {
    switch (isa) {
#if defined(__x86_64__)
    case PALPATE_ISA_AVX512:
        sweep_avx512_all(job);
        return;
    case PALPATE_ISA_AVX2:
        sweep_avx2_all(job);
        return;
#endif
    case PALPATE_ISA_SCALAR:
        sweep_scalar(job);
        return;
    default:
        sweep_portable_all(job);
        return;
    }
}
