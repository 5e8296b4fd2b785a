/// @file model.c  The model in memory: life, accessors, storage precision of the rows.
///
/// Layout: haptic/model/model.h. A model is filled by one thread and immutable afterwards;
/// everything that takes a const pal_model is safe from any thread.
#include "haptic/model/model.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/mman.h>

#if defined(__x86_64__)
#include <cpuid.h>
#include <immintrin.h>
#endif

#include "haptic/base/error.h"

enum { ROW_ALIGNMENT = 64, PAGE = 4096, HUGE_PAGE = 1 << 21 };

// ---- Life ---------------------------------------------------------------------------------------

pal_model *pal_model_new(void) {
    return calloc(1, sizeof(pal_model));
}

void pal_model_free(pal_model *model) {
    if (model == NULL) {
        return;
    }
    if (model->patch != NULL) {
        for (int32_t i = 0; i < model->info.patch_count; i++) {
            free(model->patch[i].column);
        }
    }
    free(model->position);
    free(model->normal);
    free(model->area_vector);
    free(model->triangle);
    free(model->node_flags);
    free(model->column_node);
    free(model->row_node);
    free(model->c_tt);
    free(model->c_st);
    free(model->column_scale);
    pal_row_bases_free(model->bases);
    free(model->probe_row);
    free(model->patch);
    free(model->probe);
    free(model->skin_position);
    free(model->skin_triangle);
    free(model->skin_twin);
    free(model->skin_row);
    free(model->skin_weight);
    free(model->scene_text);
    free(model);
}

// ---- Accessors ----------------------------------------------------------------------------------

void pal_model_get_info(const pal_model *model, pal_model_info *out) {
    if (out == NULL) {
        return;
    }
    if (model == NULL) {
        memset(out, 0, sizeof *out);
        return;
    }
    *out = model->info;
    out->row_bytes = pal_model_row_bytes(model);
    out->row_clusters = model->bases != NULL ? model->bases->cluster_count : 0;
    out->row_rank = model->bases != NULL ? model->bases->rank : 0;
    if (out->skin_count == 0) { // pal_model_skin then serves the cloud's own surface
        out->skin_count = out->surface_count;
    }
}

const pal_runtime_config *pal_model_runtime(const pal_model *model) {
    return model != NULL ? &model->runtime : NULL;
}

const double *pal_model_positions(const pal_model *model) {
    return model != NULL ? model->position : NULL;
}

const double *pal_model_normals(const pal_model *model) {
    return model != NULL ? model->normal : NULL;
}

const int32_t *pal_model_triangles(const pal_model *model) {
    return model != NULL ? model->triangle : NULL;
}

const int32_t *pal_model_rows(const pal_model *model) {
    return model != NULL ? model->row_node : NULL;
}

const int32_t *pal_model_columns(const pal_model *model) {
    return model != NULL ? model->column_node : NULL;
}

const double *pal_model_compliance(const pal_model *model) {
    return model != NULL ? model->c_tt : NULL;
}

const char *pal_model_patch(const pal_model *model, int32_t index, const int32_t **columns,
                            int32_t *count) {
    int found = model != NULL && index >= 0 && index < model->info.patch_count;
    if (columns != NULL) {
        *columns = found ? model->patch[index].column : NULL;
    }
    if (count != NULL) {
        *count = found ? model->patch[index].count : 0;
    }
    return found ? model->patch[index].name : NULL;
}

const char *pal_model_probe(const pal_model *model, int32_t index, double position[3]) {
    int found = model != NULL && index >= 0 && index < model->info.probe_count;
    if (position != NULL) {
        for (int c = 0; c < 3; c++) {
            position[c] = found ? model->probe[index].position[c] : 0;
        }
    }
    return found ? model->probe[index].name : NULL;
}

// ---- IEEE 754 binary16 --------------------------------------------------------------------------

uint16_t pal_half_from_double(double x) {
    uint64_t bits;
    memcpy(&bits, &x, sizeof bits);
    uint16_t sign = (uint16_t)((bits >> 48) & 0x8000u);
    int exponent = (int)((bits >> 52) & 0x7FFu) - 1023;
    uint64_t fraction = bits & 0xFFFFFFFFFFFFFu;
    if (exponent == 1024) { // infinity, NaN (made quiet)
        return (uint16_t)(sign | 0x7C00u | (fraction != 0 ? 0x200u | (fraction >> 42) : 0u));
    }
    if (exponent > 15) {
        return sign | 0x7C00u;
    }
    if (exponent < -25) { // below half of the smallest subnormal, 2^-24
        return sign;
    }
    // keep 10 fraction bits of a normal number, fewer of a subnormal one
    uint64_t significand = fraction | (1ull << 52);
    int drop = exponent >= -14 ? 42 : 42 + (-14 - exponent);
    uint64_t kept = significand >> drop;
    uint64_t rest = significand & ((1ull << drop) - 1), tie = 1ull << (drop - 1);
    if (rest > tie || (rest == tie && (kept & 1u) != 0)) {
        kept++;
    }
    // the hidden bit adds one to the exponent field; a carry out of the fraction does the same
    uint64_t field = exponent >= -14 ? (uint64_t)(exponent + 14) << 10 : 0;
    return (uint16_t)(sign | (field + kept));
}

float pal_half_to_float(uint16_t half) {
    uint32_t sign = (uint32_t)(half & 0x8000u) << 16;
    uint32_t exponent = (half >> 10) & 0x1Fu;
    uint32_t fraction = half & 0x3FFu;
    uint32_t bits;
    if (exponent == 31) {
        bits = sign | 0x7F800000u | (fraction << 13) | (fraction != 0 ? 0x400000u : 0u);
    } else if (exponent != 0) {
        bits = sign | ((exponent + 112) << 23) | (fraction << 13);
    } else if (fraction == 0) {
        bits = sign;
    } else {
        int shift = 0;
        while ((fraction & 0x400u) == 0) {
            fraction <<= 1;
            shift++;
        }
        bits = sign | ((uint32_t)(113 - shift) << 23) | ((fraction & 0x3FFu) << 13);
    }
    float x;
    memcpy(&x, &bits, sizeof x);
    return x;
}

#if defined(__x86_64__)
/// clang 14's __builtin_cpu_supports does not know "f16c"; "avx" covers the operating system's
/// part.
static int have_f16c(void) {
    unsigned a, b, c, d;
    return __builtin_cpu_supports("avx") && __get_cpuid(1, &a, &b, &c, &d) && (c & bit_F16C) != 0;
}

/// Eight halves at a time by the processor's own conversion, which is exact, so both ways agree.
__attribute__((target("avx,f16c"))) static int64_t load_halves_f16c(const uint16_t *in,
                                                                    int64_t count, double *out) {
    int64_t i = 0;
    for (; i + 8 <= count; i += 8) {
        __m256 single = _mm256_cvtph_ps(_mm_loadu_si128((const __m128i *)(const void *)(in + i)));
        _mm256_storeu_pd(out + i, _mm256_cvtps_pd(_mm256_castps256_ps128(single)));
        _mm256_storeu_pd(out + i + 4, _mm256_cvtps_pd(_mm256_extractf128_ps(single, 1)));
    }
    return i;
}
#endif

// ---- Storage precision --------------------------------------------------------------------------

size_t pal_precision_size(pal_precision precision) {
    switch (precision) {
    case PALPATE_PRECISION_DOUBLE:
        return 8;
    case PALPATE_PRECISION_SINGLE:
        return 4;
    case PALPATE_PRECISION_HALF:
    case PALPATE_PRECISION_SCALED:
        return 2;
    }
    return 0;
}

pal_status pal_precision_store(pal_precision precision, const double *in, int64_t count,
                               void *out) {
    int overflow = 0;
    if (precision == PALPATE_PRECISION_DOUBLE) {
        memcpy(out, in, (size_t)count * sizeof *in);
    } else if (precision == PALPATE_PRECISION_SINGLE) {
        float *single = out;
        for (int64_t i = 0; i < count; i++) {
            single[i] = (float)in[i];
            overflow |= isinf(single[i]) && !isinf(in[i]);
        }
    } else if (precision == PALPATE_PRECISION_HALF) {
        uint16_t *half = out;
        for (int64_t i = 0; i < count; i++) {
            half[i] = pal_half_from_double(in[i]);
            overflow |= (half[i] & 0x7FFFu) == 0x7C00u && !isinf(in[i]);
        }
    } else if (precision == PALPATE_PRECISION_SCALED) {
        int16_t *integer = out;
        for (int64_t i = 0; i < count; i++) {
            double x = nearbyint(in[i]);
            int fits = fabs(x) <= PALPATE_SCALED_MAX; // false for NaN
            integer[i] = (int16_t)(fits ? x : 0);
            overflow |= !fits;
        }
    } else {
        return PALPATE_ERROR_ARGUMENT;
    }
    return overflow ? PALPATE_ERROR_ARGUMENT : PALPATE_OK;
}

void pal_precision_load(pal_precision precision, const void *in, int64_t count, double *out) {
    if (precision == PALPATE_PRECISION_DOUBLE) {
        memcpy(out, in, (size_t)count * sizeof *out);
    } else if (precision == PALPATE_PRECISION_SINGLE) {
        const float *single = in;
        for (int64_t i = 0; i < count; i++) {
            out[i] = (double)single[i];
        }
    } else if (precision == PALPATE_PRECISION_HALF) {
        const uint16_t *half = in;
        int64_t i = 0;
#if defined(__x86_64__)
        if (have_f16c()) {
            i = load_halves_f16c(half, count, out);
        }
#endif
        for (; i < count; i++) {
            out[i] = (double)pal_half_to_float(half[i]);
        }
    } else if (precision == PALPATE_PRECISION_SCALED) {
        const int16_t *integer = in;
        for (int64_t i = 0; i < count; i++) {
            out[i] = (double)integer[i];
        }
    }
}

// ---- Stored rows --------------------------------------------------------------------------------

pal_status pal_model_alloc_rows(pal_model *model, pal_error *error) {
    const pal_model_info *info = &model->info;
    size_t element = pal_precision_size(info->precision);
    if (element == 0 || info->row_count < 0 || info->column_count < 0 ||
        info->row_count > PALPATE_COUNT_MAX || info->column_count > PALPATE_COUNT_MAX) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "model: cannot store %d rows of %d columns in precision %d",
                        (int)info->row_count, (int)info->column_count, (int)info->precision);
    }
    free(model->c_st);
    free(model->column_scale);
    model->c_st = NULL;
    model->column_scale = NULL;
    model->row_ld = 0;
    model->row_scale = 1;
    if (pal_model_block_rows(model) == 0 || info->column_count == 0) {
        return PALPATE_OK;
    }
    size_t column = ((size_t)pal_model_block_rows(model) * element + ROW_ALIGNMENT - 1) /
                    ROW_ALIGNMENT * ROW_ALIGNMENT;
    if (column % PAGE == 0) { // a dozen columns swept together must not share one set of the cache
        column += ROW_ALIGNMENT;
    }
    size_t bytes = 0;
    if (__builtin_mul_overflow(column, (size_t)info->column_count * 3, &bytes)) {
        bytes = SIZE_MAX;
    }
    // the sweep walks a dozen columns at once: with 4 KiB pages it would miss the TLB in each
    size_t alignment = bytes >= 2 * HUGE_PAGE ? HUGE_PAGE : ROW_ALIGNMENT;
    // C17 leaves a size that is no multiple of the alignment to the library; AddressSanitizer
    // refuses it
    void *rows = bytes <= PTRDIFF_MAX - HUGE_PAGE
                     ? aligned_alloc(alignment, (bytes + alignment - 1) / alignment * alignment)
                     : NULL;
    if (rows == NULL) {
        return pal_fail(
            error, PALPATE_ERROR_MEMORY,
            "model: no memory for %d rows x %d columns of compliance (%.3g MB); store fewer "
            "rows (store.displacement) or in a lower precision (store.precision)",
            (int)info->row_count, (int)info->column_count, (double)bytes / 1e6);
    }
    if (alignment == HUGE_PAGE) {
        (void)madvise(rows, bytes, MADV_HUGEPAGE); // a wish: works without
    }
    if (info->precision == PALPATE_PRECISION_SCALED) {
        size_t columns = 3 * (size_t)info->column_count;
        model->column_scale = malloc(columns * sizeof *model->column_scale);
        if (model->column_scale == NULL) {
            free(rows);
            return pal_fail(error, PALPATE_ERROR_MEMORY, "model: no memory for %zu scales",
                            columns);
        }
        for (size_t i = 0; i < columns; i++) {
            model->column_scale[i] = 1;
        }
    }
    memset(rows, 0, bytes);
    model->c_st = rows;
    model->row_ld = (int64_t)(column / element);
    return PALPATE_OK;
}

void pal_model_scale_rows(pal_model *model, double largest) {
    model->row_scale = 1;
    if (model->info.precision == PALPATE_PRECISION_HALF && largest > 0 && isfinite(largest)) {
        int exponent; // largest = m 2^exponent, m in [0.5, 1)
        (void)frexp(largest, &exponent);
        model->row_scale = ldexp(1, exponent - 14);
    }
}

static void *column_start(const pal_model *model, int64_t dof) {
    return (char *)model->c_st +
           (size_t)dof * (size_t)model->row_ld * pal_precision_size(model->info.precision);
}

uint64_t pal_model_row_bytes(const pal_model *model) {
    uint64_t columns = 3 * (uint64_t)model->info.column_count;
    uint64_t block =
        columns * (uint64_t)pal_model_block_rows(model) * pal_precision_size(model->info.precision);
    return block + (model->column_scale != NULL ? columns * sizeof *model->column_scale : 0) +
           (model->bases != NULL ? pal_row_bases_bytes(model->bases) : 0);
}

pal_status pal_model_store_column(pal_model *model, int64_t dof, const double *column) {
    int64_t rows = pal_model_block_rows(model);
    if (dof < 0 || dof >= 3 * (int64_t)model->info.column_count || model->c_st == NULL) {
        return PALPATE_ERROR_ARGUMENT;
    }
    if (model->column_scale != NULL) {
        double largest = 0;
        for (int64_t i = 0; i < rows; i++) {
            largest = fmax(largest, fabs(column[i]));
        }
        double scale = largest / PALPATE_SCALED_MAX;
        model->column_scale[dof] = isnormal(scale) ? scale : 1;
    }
    double inverse = 1 / pal_model_unit(model, dof), scaled[256];
    for (int64_t at = 0; at < rows; at += 256) {
        int64_t n = rows - at < 256 ? rows - at : 256;
        for (int64_t i = 0; i < n; i++) {
            scaled[i] = column[at + i] * inverse;
        }
        char *out = (char *)column_start(model, dof) +
                    (size_t)at * pal_precision_size(model->info.precision);
        pal_status status = pal_precision_store(model->info.precision, scaled, n, out);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    return PALPATE_OK;
}

pal_status pal_model_load_column(const pal_model *model, int64_t dof, double *column) {
    int64_t rows = 3 * (int64_t)model->info.row_count;
    if (dof < 0 || dof >= 3 * (int64_t)model->info.column_count ||
        (model->c_st == NULL && model->bases == NULL)) {
        return PALPATE_ERROR_ARGUMENT;
    }
    if (model->bases != NULL) {
        int none = model->c_st == NULL; // rank 0: near pairs alone
        pal_row_bases_column(model->bases, dof, none ? NULL : column_start(model, dof),
                             none ? 0 : pal_model_unit(model, dof), column);
        return PALPATE_OK;
    }
    pal_precision_load(model->info.precision, column_start(model, dof), rows, column);
    double unit = pal_model_unit(model, dof);
    for (int64_t i = 0; i < rows; i++) {
        column[i] *= unit;
    }
    return PALPATE_OK;
}
