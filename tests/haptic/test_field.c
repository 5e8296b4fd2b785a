/// Eq. 53's sweep: every variant equals the scalar twin bit for bit, and the twin equals the sum.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/engine/field.h"

enum { LD = 16384 + 64, COLUMNS = 64, COUNT_MAX = 100 };

static uint64_t random_state = 7;
static uint32_t random_bits(void) {
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(random_state >> 32);
}
static double uniform(void) {
    return (double)random_bits() * 0x1p-31 - 1.0;
}

/// The value of an IEEE half by its definition (independent of the kernel's bit tricks).
static double half_value(uint16_t h) {
    int exponent = (h >> 10) & 31, mantissa = h & 1023;
    double v = exponent == 0 ? ldexp(mantissa, -24) : ldexp(1024 + mantissa, exponent - 25);
    return h & 0x8000 ? -v : v;
}

typedef struct fixture {
    void *block;
    int32_t dof[COUNT_MAX];
    double f[COUNT_MAX];
    float f32[COUNT_MAX];
    float *out[PALPATE_ISA_COUNT];
} fixture;

static size_t element(pal_precision p) {
    return p == PALPATE_PRECISION_DOUBLE ? 8 : p == PALPATE_PRECISION_SINGLE ? 4 : 2;
}

static double block_value(const fixture *x, pal_precision p, int64_t at) {
    return p == PALPATE_PRECISION_DOUBLE   ? ((double *)x->block)[at]
           : p == PALPATE_PRECISION_SINGLE ? (double)((float *)x->block)[at]
           : p == PALPATE_PRECISION_SCALED ? (double)((int16_t *)x->block)[at]
                                           : half_value(((uint16_t *)x->block)[at]);
}

static void make(fixture *x, pal_precision p) {
    x->block = aligned_alloc(64, LD * COLUMNS * element(p));
    assert_non_null(x->block);
    for (int64_t i = 0; i < LD * COLUMNS; i++) {
        if (p == PALPATE_PRECISION_DOUBLE) {
            ((double *)x->block)[i] = uniform();
        } else if (p == PALPATE_PRECISION_SINGLE) {
            ((float *)x->block)[i] = (float)uniform();
        } else if (p == PALPATE_PRECISION_SCALED) {
            ((int16_t *)x->block)[i] = (int16_t)random_bits();
        } else { // every finite pattern: subnormals and both zeros included
            uint16_t h;
            do {
                h = (uint16_t)random_bits();
            } while ((h & 0x7c00) == 0x7c00);
            ((uint16_t *)x->block)[i] = h;
        }
    }
    for (int k = 0; k < COUNT_MAX; k++) {
        x->dof[k] = (int32_t)(random_bits() % COLUMNS);
        x->f[k] = uniform();
        x->f32[k] = (float)x->f[k];
    }
    for (int i = 0; i < PALPATE_ISA_COUNT; i++) {
        x->out[i] = aligned_alloc(64, LD * sizeof(float));
        assert_non_null(x->out[i]);
    }
}

static void drop(fixture *x) {
    free(x->block);
    for (int i = 0; i < PALPATE_ISA_COUNT; i++) {
        free(x->out[i]);
    }
}

static pal_field_job job_of(const fixture *x, pal_precision p, int64_t rows, int32_t count) {
    return (pal_field_job){.precision = p,
                           .block = x->block,
                           .ld = LD,
                           .rows = rows,
                           .count = count,
                           .dof = x->dof,
                           .f = x->f,
                           .f32 = x->f32};
}

/// Counts around the groups of twelve, six and three, rows around the panel and each vector width.
static void variants_agree_bit_for_bit(pal_precision p) {
    static const int32_t counts[] = {0, 1, 2, 3, 4, 6, 9, 11, 12, 13, 21, 48, 96, 100};
    static const int64_t rows[] = {32, 64, 96, 480, 512, 544, 2016, 2048, 2080, 4096, 16384, LD};
    fixture x;
    make(&x, p);
    for (size_t c = 0; c < sizeof counts / sizeof *counts; c++) {
        for (size_t r = 0; r < sizeof rows / sizeof *rows; r++) {
            pal_field_job job = job_of(&x, p, rows[r], counts[c]);
            for (int isa = 0; isa < PALPATE_ISA_COUNT; isa++) {
                if (!pal_field_available((pal_isa)isa)) {
                    continue;
                }
                memset(x.out[isa], 0xff, LD * sizeof(float)); // NaN: whatever is left out shows
                job.out = x.out[isa];
                pal_field_sweep((pal_isa)isa, &job);
                assert_memory_equal(x.out[isa], x.out[0], (size_t)rows[r] * sizeof(float));
                if (rows[r] < LD) { // and nothing beyond is written
                    assert_true(isnan(x.out[isa][rows[r]]));
                }
            }
        }
    }
    drop(&x);
}

/// Columns in their own order and sums that go on where an earlier one ended, as compressed rows
/// use them: the same bits as one sum over all columns by the twin.
static void sums_can_be_continued(void **state) {
    (void)state;
    static const int64_t rows[] = {32, 160, 512, 544, LD};
    for (int p = PALPATE_PRECISION_SINGLE; p <= PALPATE_PRECISION_SCALED; p++) {
        fixture x;
        make(&x, (pal_precision)p);
        int32_t order[40];
        for (int k = 0; k < 40; k++) {
            order[k] = k;
        }
        for (size_t r = 0; r < sizeof rows / sizeof *rows; r++) {
            pal_field_job whole = job_of(&x, (pal_precision)p, rows[r], 40);
            whole.dof = order;
            whole.out = x.out[0];
            pal_field_sweep(PALPATE_ISA_SCALAR, &whole);
            for (int isa = 0; isa < PALPATE_ISA_COUNT; isa++) {
                if (!pal_field_available((pal_isa)isa)) {
                    continue;
                }
                float *out = isa == 0 ? x.out[1] : x.out[isa];
                memset(out, 0xff, LD * sizeof(float));
                pal_field_job first = whole, none = whole, rest = whole;
                first.dof = NULL;
                first.count = 17;
                none.count = 0;
                none.add = 1;
                rest.dof = order + 17;
                rest.f = x.f + 17;
                rest.f32 = x.f32 + 17;
                rest.count = 23;
                rest.add = 1;
                first.out = none.out = rest.out = out;
                pal_field_sweep((pal_isa)isa, &first);
                pal_field_sweep((pal_isa)isa, &none);
                pal_field_sweep((pal_isa)isa, &rest);
                assert_memory_equal(out, whole.out, (size_t)rows[r] * sizeof(float));
            }
        }
        drop(&x);
    }
}

static void variants_agree_single(void **state) {
    (void)state;
    variants_agree_bit_for_bit(PALPATE_PRECISION_SINGLE);
}
static void variants_agree_half(void **state) {
    (void)state;
    variants_agree_bit_for_bit(PALPATE_PRECISION_HALF);
}
static void variants_agree_scaled(void **state) {
    (void)state;
    variants_agree_bit_for_bit(PALPATE_PRECISION_SCALED);
}
static void variants_agree_double(void **state) {
    (void)state;
    variants_agree_bit_for_bit(PALPATE_PRECISION_DOUBLE);
}

static void sum_is_within_the_rounding_bound(void **state) {
    (void)state;
    for (int p = 0; p < 4; p++) {
        fixture x;
        make(&x, (pal_precision)p);
        pal_field_job job = job_of(&x, (pal_precision)p, 512, 96);
        job.out = x.out[0];
        pal_field_sweep(pal_field_best(), &job);
        for (int64_t i = 0; i < job.rows; i++) {
            double sum = 0.0, magnitude = 0.0;
            for (int k = 0; k < job.count; k++) {
                double term =
                    x.f[k] * block_value(&x, (pal_precision)p, x.dof[k] * (int64_t)LD + i);
                sum += term;
                magnitude += fabs(term);
            }
            // single accumulation: (count + 2) roundings of 2^-24; double: one final rounding
            double unit = p == PALPATE_PRECISION_DOUBLE ? 1.01 : (double)(job.count + 2);
            assert_true(fabs((double)x.out[0][i] - sum) <= unit * 0x1p-24 * magnitude);
        }
        drop(&x);
    }
}

/// a + f c a hair from the middle between two floats: rounded once it goes the right way, rounded
/// to double precision (or to single, as a product) first it becomes a tie and goes to the even
/// one.
static void every_term_is_rounded_once(void **state) {
    (void)state;
    const float sums[] = {1.0f + 0x1p-23f, 1.0f + 0x3p-23f, -(1.0f + 0x1p-23f), -(1.0f + 0x3p-23f)};
    const float factors[] = {1.0f, -1.0f, -1.0f, 1.0f};
    enum { CASES = 4, ROWS = 32 };
    float *block = aligned_alloc(64, 2 * ROWS * sizeof *block);
    float *out = aligned_alloc(64, ROWS * sizeof *out);
    assert_non_null(block);
    assert_non_null(out);
    for (int k = 0; k < CASES; k++) {
        for (int i = 0; i < ROWS; i++) {
            block[i] = sums[k];
            block[ROWS + i] = factors[k] * (1.0f - 0x1p-15f);
        }
        const float f32[] = {1.0f, 0x1p-24f * (1.0f + 0x1p-15f)};
        // the test's own premise: twice rounded is not the same
        assert_true((float)((double)sums[k] + (double)f32[1] * (double)block[ROWS]) != sums[k]);
        for (int isa = 0; isa < PALPATE_ISA_COUNT; isa++) {
            if (pal_field_available((pal_isa)isa)) {
                const pal_field_job job = {.precision = PALPATE_PRECISION_SINGLE,
                                           .block = block,
                                           .ld = ROWS,
                                           .rows = ROWS,
                                           .count = 2,
                                           .f32 = f32,
                                           .out = out};
                pal_field_sweep((pal_isa)isa, &job);
                for (int i = 0; i < ROWS; i++) {
                    assert_true(out[i] == sums[k]);
                }
            }
        }
    }
    free(block);
    free(out);
}

/// Sums below the normal numbers of single precision have fewer bits to round to.
static void variants_agree_below_the_normal_numbers(void **state) {
    (void)state;
    fixture x;
    make(&x, PALPATE_PRECISION_SINGLE);
    for (int64_t i = 0; i < LD * COLUMNS; i++) {
        ((float *)x.block)[i] *= 0x1p-127f;
    }
    pal_field_job job = job_of(&x, PALPATE_PRECISION_SINGLE, LD, 21);
    int small = 0;
    for (int isa = 0; isa < PALPATE_ISA_COUNT; isa++) {
        if (pal_field_available((pal_isa)isa)) {
            job.out = x.out[isa];
            pal_field_sweep((pal_isa)isa, &job);
            assert_memory_equal(x.out[isa], x.out[0], LD * sizeof(float));
        }
    }
    for (int i = 0; i < LD; i++) {
        small += fpclassify(x.out[0][i]) == FP_SUBNORMAL;
    }
    assert_true(small > LD / 10);
    drop(&x);
}

static void no_force_gives_zero(void **state) {
    (void)state;
    fixture x;
    make(&x, PALPATE_PRECISION_SINGLE);
    pal_field_job job = job_of(&x, PALPATE_PRECISION_SINGLE, LD, 0);
    job.out = x.out[0];
    memset(x.out[0], 0xff, LD * sizeof(float));
    pal_field_sweep(pal_field_best(), &job);
    for (int i = 0; i < LD; i++) {
        assert_true(x.out[0][i] == 0.0f);
    }
    drop(&x);
}

static void best_is_available_and_named(void **state) {
    (void)state;
    assert_true(pal_field_available(pal_field_best()));
    assert_true(pal_field_available(PALPATE_ISA_PORTABLE));
    assert_false(pal_field_available(PALPATE_ISA_COUNT));
    assert_string_equal(pal_isa_name(PALPATE_ISA_AVX512), "avx512");
    assert_string_equal(pal_isa_name(PALPATE_ISA_COUNT), "unknown");
    print_message("kernel in use: %s\n", pal_isa_name(pal_field_best()));
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(variants_agree_single),
        cmocka_unit_test(variants_agree_half),
        cmocka_unit_test(variants_agree_double),
        cmocka_unit_test(variants_agree_scaled),
        cmocka_unit_test(sums_can_be_continued),
        cmocka_unit_test(sum_is_within_the_rounding_bound),
        cmocka_unit_test(every_term_is_rounded_once),
        cmocka_unit_test(variants_agree_below_the_normal_numbers),
        cmocka_unit_test(no_force_gives_zero),
        cmocka_unit_test(best_is_available_and_named),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
