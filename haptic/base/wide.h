/// @file wide.h  Four doubles at a time, the same bits everywhere (private).
///
/// GCC/clang vector extensions: plain element-wise arithmetic that the compiler lowers to whatever
/// the target has. A kernel is written once as a PALPATE_INLINE function, wrapped once in a
/// function marked PALPATE_AVX2 (without FMA) and chosen at run time by pal_have_avx2(). As long as
/// every element is made by one sequence of rounded operations, the width does not show in results.
/// Vectors are not passed by value: their ABI depends on the target. Unaligned loads and stores.
#ifndef PALPATE_HAPTIC_WIDE_H
#define PALPATE_HAPTIC_WIDE_H

#include <string.h>

typedef double pal_lanes __attribute__((vector_size(32)));
enum { PALPATE_LANES = 4 };

#define PALPATE_INLINE static inline __attribute__((always_inline))

/// In front of a loop whose count is known: keeps an array of vectors in registers.
#define PALPATE_UNROLL _Pragma("GCC unroll 8")

#define PALPATE_LOAD(lanes, from) memcpy(&(lanes), (from), sizeof(pal_lanes))
#define PALPATE_STORE(to, lanes) memcpy((to), &(lanes), sizeof(pal_lanes))
#define PALPATE_FILL(s) ((pal_lanes){(s), (s), (s), (s)})

#if defined __x86_64__ && !defined PALPATE_DENSE_BASELINE
#define PALPATE_AVX2 __attribute__((target("avx2")))
static inline int pal_have_avx2(void) {
    return __builtin_cpu_supports("avx2");
}
#else
#define PALPATE_AVX2
static inline int pal_have_avx2(void) {
    return 0;
}
#endif

#endif
