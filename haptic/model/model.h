/// @file model.h  The model's memory layout (private: engine, file format, offline stage).
///
/// The offline stage fills a pal_model made by pal_model_new(); from then on it is immutable.
/// Every array is owned by the model and freed by pal_model_free(). SI units, body frame.
#ifndef PALPATE_HAPTIC_MODEL_H
#define PALPATE_HAPTIC_MODEL_H

#include <stdint.h>

#include <palpate/model.h>

#include "haptic/model/row_bases.h"

enum { PALPATE_NODE_FIXED = 1, PALPATE_NODE_TOUCHABLE = 2 };

/// A named set of column nodes that `press` displaces together.
typedef struct pal_patch {
    char name[PALPATE_NAME_MAX];
    int32_t count;
    int32_t *column; ///< indices into column_node, shape [count], ascending
} pal_patch;

typedef struct pal_probe {
    char name[PALPATE_NAME_MAX];
    double position[3]; ///< [m]
} pal_probe;

/// The render mesh and its weights on surface nodes: u(vertex) = sum_k weight_k u(row_k).
enum { PALPATE_SKIN_WEIGHTS = 8 };

struct pal_model {
    pal_model_info info; ///< counts and facts; the counts below are those of `info`
    pal_runtime_config runtime;

    double *position;    ///< (node_count x 3) [m]; surface nodes first
    double *normal;      ///< (surface_count x 3) unit, outward
    double *area_vector; ///< (surface_count x 3) tributary area vector [m^2]
    int32_t *triangle;   ///< (triangle_count x 3) surface nodes, outward counter-clockwise
    uint8_t *node_flags; ///< (node_count) PALPATE_NODE_*

    int32_t *column_node; ///< (column_count) node of each column triple, ascending
    int32_t *row_node;    ///< (row_count) node of each stored row triple, ascending

    /// Stored C_TT (3t x 3t) [m/N], column-major, ld = 3t; symmetric when certificate.symmetrized.
    double *c_tt;
    /// Stored rows C_ST (3s x 3t) [m/N] in `precision`, column-major; the column of dof j starts at
    /// element j * row_ld; row_ld >= 3s is a multiple of 64 bytes; base 64-byte aligned; padding 0.
    /// element times row_scale (and, scaled, times column_scale[dof]) is the compliance in m/N.
    void *c_st;
    int64_t row_ld;
    /// A power of two; 1 for all but half. Half has 5 exponent bits: without a scale, stiff
    /// bodies (small compliances) would fall below its smallest normal number, 6e-5.
    double row_scale;
    /// Scaled precision: column dof's integers times column_scale[dof] are in m/N, shape
    /// [3 column_count], each finite and positive; NULL in the other precisions.
    double *column_scale;
    /// NULL: c_st has 3 row_count rows. Else the rows are compressed (row_bases.h), the precision
    /// is scaled and c_st holds the bases' coefficients S: `rank` rows, no c_st when that is 0.
    pal_row_bases *bases;
    /// Probe rows (3 probe_count x 3t) [m/N], column-major, ld = 3 probe_count.
    double *probe_row;

    pal_patch *patch; ///< (patch_count)
    pal_probe *probe; ///< (probe_count)

    int32_t skin_triangle_count;
    double *skin_position;  ///< (skin_count x 3)
    int32_t *skin_triangle; ///< (skin_triangle_count x 3) twins' representatives
    int32_t *skin_twin; ///< (skin_count) vertex whose normal this one shares: same place; itself
                        ///< when alone
    int32_t *skin_row;  ///< (skin_count x PALPATE_SKIN_WEIGHTS) index into row_node; -1: unused
    float *skin_weight; ///< (skin_count x PALPATE_SKIN_WEIGHTS)

    char *scene_text; ///< canonical scene (with defaults), NUL-terminated; may be NULL
};

/// An empty model (all zero). Exported for libpalpate-offline.
PALPATE_API pal_model *pal_model_new(void);

/// Rows of c_st without padding: 3 row_count, or the rank of the compressed rows.
static inline int64_t pal_model_block_rows(const pal_model *model) {
    return model->bases != NULL ? model->bases->rank : 3 * (int64_t)model->info.row_count;
}

/// Bytes of the stored rows in memory, whatever their form.
PALPATE_API uint64_t pal_model_row_bytes(const pal_model *model);

/// Bytes of one element of c_st.
PALPATE_API size_t pal_precision_size(pal_precision precision);

/// Allocate c_st (and column_scale, ones) for info.row_count, info.column_count, info.precision;
/// set row_ld, row_scale = 1 (zeroed; NULL and row_ld 0 when there are no rows). Frees an older
/// c_st.
/// @return PALPATE_OK; _ARGUMENT (counts or precision), _MEMORY
PALPATE_API pal_status pal_model_alloc_rows(pal_model *model, pal_error *error);

/// Choose row_scale for entries of magnitude up to `largest` [m/N]: 1 for all but half; for half
/// the power of two that brings `largest` between 2^13 and 2^14 (2 bits below overflow).
PALPATE_API void pal_model_scale_rows(pal_model *model, double largest);

/// Store column `dof` (0 .. 3 column_count - 1) of C_ST, or of S in a compressed model.
/// @param[in] column [m/N], shape [pal_model_block_rows]
/// @return PALPATE_OK; _ARGUMENT when a value does not fit the precision or the dof does not exist
PALPATE_API pal_status pal_model_store_column(pal_model *model, int64_t dof, const double *column);

/// Metres per newton of the stored number 1 in column `dof`: row_scale, times the column's own.
static inline double pal_model_unit(const pal_model *model, int64_t dof) {
    return model->column_scale != NULL ? model->row_scale * model->column_scale[dof]
                                       : model->row_scale;
}

/// Read column `dof` of C_ST back. @param[out] column [m/N], shape [3 row_count]
PALPATE_API pal_status pal_model_load_column(const pal_model *model, int64_t dof, double *column);

/// IEEE 754 binary16: nearest even from a double (one rounding), exact back. Bit-exact software;
/// NaN and infinity are kept.
PALPATE_API uint16_t pal_half_from_double(double x);
PALPATE_API float pal_half_to_float(uint16_t half);

enum { PALPATE_SCALED_MAX = 32767 };

/// Convert `count` doubles into the storage precision (round to nearest even; half: saturating to
/// the largest finite value is NOT done, overflow is PALPATE_ERROR_ARGUMENT; so for scaled, whose
/// numbers are the integers of magnitude up to PALPATE_SCALED_MAX).
PALPATE_API pal_status pal_precision_store(pal_precision precision, const double *in, int64_t count,
                                           void *out);
PALPATE_API void pal_precision_load(pal_precision precision, const void *in, int64_t count,
                                    double *out);

/// Version of the model file's content; a file with a higher one is refused. A model is written
/// with the lowest version that can hold it: 1; 2 for rows in scaled precision or compressed.
enum { PALPATE_MODEL_VERSION = 2 };

/// The model as a sealed file image (file_header.h), to be freed by the caller.
PALPATE_API pal_status pal_model_image(const pal_model *model, void **image, size_t *size,
                                       pal_error *error);

/// Parse an image whose checksums were verified already (or, when fuzzing, on purpose not).
/// @return PALPATE_OK; _FORMAT, _MEMORY. *out is NULL on error.
PALPATE_API pal_status pal_model_parse(const void *image, size_t size, pal_model **out,
                                       pal_error *error);

/// pal_model_save with the file's permissions before the umask; pal_model_save uses 0666.
PALPATE_API pal_status pal_model_save_mode(const pal_model *model, const char *path, unsigned mode,
                                           pal_error *error);

/// Largest count of anything a model may hold; keeps all products within 63 bits.
enum { PALPATE_COUNT_MAX = 1 << 26 };

/// Check every count, index range, and finiteness of a model (after load and after build).
/// @return PALPATE_OK; _ARGUMENT naming the array, the index and the value. Cost: reads all of it.
PALPATE_API pal_status pal_model_check(const pal_model *model, pal_error *error);

#endif
