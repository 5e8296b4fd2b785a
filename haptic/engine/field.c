/// @file field.c  Eq. 53 over the stored rows: variants by instruction set, chosen at run time.
///
/// The arithmetic is in field_sweep.h, written once with a wide type and instantiated per variant;
/// only the conversion of 16-bit numbers and the fused multiply-add differ. See field.h for the
/// order of summation.
#include "haptic/engine/field.h"

#include <math.h>
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
            a = fmaf(job->f32[k], c, a);
        }
        job->out[i] = a;
    }
}

typedef float portable_floats __attribute__((vector_size(16), aligned(4), may_alias));

/// f c + a rounded once. Every processor but the older ones of x86 has the instruction; there the
/// product is exact in double precision, and so twice rounded is once rounded unless the sum in
/// double precision is a tie of single precision or below its normal numbers. Then the sum is
/// rounded to odd (Boldo and Melquiond, Emulation of FMA and correctly rounded sums, IEEE Trans.
/// Comput. 57, 2008), which the second rounding cannot mistake for a tie.
#if defined(__x86_64__)
static __m128d odd_sum(__m128d p, __m128d a) {
    const __m128i one = _mm_set1_epi64x(1);
    __m128d s = _mm_add_pd(p, a), part = _mm_sub_pd(s, p);
    // s + rest = p + a exactly (Knuth)
    __m128d rest = _mm_add_pd(_mm_sub_pd(p, _mm_sub_pd(s, part)), _mm_sub_pd(a, part));
    __m128i bits = _mm_castpd_si128(s);
    // inexact with an even last bit: the odd neighbour towards the rest
    __m128d square = _mm_mul_pd(rest, rest); // NaN where the sum is infinite: stays so
    __m128i move = _mm_and_si128(_mm_castpd_si128(_mm_cmplt_pd(_mm_setzero_pd(), square)),
                                 _mm_andnot_si128(bits, one));
    __m128i away = _mm_srli_epi64(_mm_xor_si128(bits, _mm_castpd_si128(rest)), 63);
    __m128i back = _mm_and_si128(move, away);
    return _mm_castsi128_pd(_mm_sub_epi64(_mm_add_epi64(bits, move), _mm_add_epi64(back, back)));
}

static inline portable_floats portable_fuse(portable_floats f, portable_floats c,
                                            portable_floats a) {
    __m128 x = (__m128)f, y = (__m128)c, z = (__m128)a;
    __m128d product[2] = {
        _mm_mul_pd(_mm_cvtps_pd(x), _mm_cvtps_pd(y)),
        _mm_mul_pd(_mm_cvtps_pd(_mm_movehl_ps(x, x)), _mm_cvtps_pd(_mm_movehl_ps(y, y)))};
    __m128d before[2] = {_mm_cvtps_pd(z), _mm_cvtps_pd(_mm_movehl_ps(z, z))};
    __m128d low = _mm_add_pd(product[0], before[0]), high = _mm_add_pd(product[1], before[1]);
    __m128 sum = _mm_movelh_ps(_mm_cvtpd_ps(low), _mm_cvtpd_ps(high));
    // the 29 bits that single precision has not, and its exponent
    const __m128i dropped = _mm_set1_epi32(0x1fffffff), tie = _mm_set1_epi32(0x10000000);
    __m128i rest =
        _mm_and_si128(_mm_castps_si128(_mm_shuffle_ps(_mm_castpd_ps(low), _mm_castpd_ps(high),
                                                      _MM_SHUFFLE(2, 0, 2, 0))),
                      dropped);
    __m128i exponent = _mm_and_si128(_mm_castps_si128(sum), _mm_set1_epi32(0x7f800000));
    __m128i doubtful =
        _mm_or_si128(_mm_cmpeq_epi32(rest, tie), _mm_cmpeq_epi32(exponent, _mm_setzero_si128()));
    if (__builtin_expect(_mm_movemask_epi8(doubtful) != 0, 0)) {
        sum = _mm_movelh_ps(_mm_cvtpd_ps(odd_sum(product[0], before[0])),
                            _mm_cvtpd_ps(odd_sum(product[1], before[1])));
    }
    return (portable_floats)sum;
}
#else
static inline portable_floats portable_fuse(portable_floats f, portable_floats c,
                                            portable_floats a) {
    for (int i = 0; i < 4; i++) {
        a[i] = __builtin_fmaf(f[i], c[i], a[i]);
    }
    return a;
}
#endif

#define SWEEP(name) sweep_portable_##name
#define SWEEP_TARGET
#define SWEEP_WIDTH 16
#define SWEEP_UNROLL 1
#define SWEEP_FUSE(f, c, a) ((a) = portable_fuse((f), (c), (a)))
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
#undef SWEEP_UNROLL
#undef SWEEP_FUSE

#if defined(__x86_64__)
#define SWEEP(name) sweep_avx2_##name
#define SWEEP_TARGET __attribute__((target("avx2,fma,f16c")))
#define SWEEP_WIDTH 32
#define SWEEP_UNROLL 2 // 12 factors and 2 sums: what 16 registers hold
#define SWEEP_FUSE(f, c, a)                                                                        \
    ((a) = (sweep_avx2_floats)_mm256_fmadd_ps((__m256)(f), (__m256)(c), (__m256)(a)))
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
#undef SWEEP_UNROLL
#undef SWEEP_FUSE

#define SWEEP(name) sweep_avx512_##name
#define SWEEP_TARGET __attribute__((target("avx512f")))
#define SWEEP_WIDTH 64
#define SWEEP_UNROLL 4
#define SWEEP_FUSE(f, c, a)                                                                        \
    ((a) = (sweep_avx512_floats)_mm512_fmadd_ps((__m512)(f), (__m512)(c), (__m512)(a)))
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
#undef SWEEP_UNROLL
#undef SWEEP_FUSE
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
        return __builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma") && have_f16c();
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
