/// @file field_sweep.h  Template of one sweep variant; included by field.c once per variant.
///
/// No include guard on purpose. The includer defines:
///   SWEEP(name)     the function's name for this variant, e.g. sweep_avx2_##name
///   SWEEP_TARGET    function attributes (target instruction set)
///   SWEEP_WIDTH     bytes of the wide type (16, 32, 64)
///   SWEEP_HALF(p, v) load SWEEP_WIDTH / 4 halves at p into the float vector v
///   SWEEP_INTEGER(p, v) the same for 16-bit integers
///   SWEEP_FUSE(f, c, a) a = f c + a, rounded once, in single precision
///   SWEEP_UNROLL    vectors of the result held in registers at a time
///
/// Blocking: a panel of SWEEP_ROWS rows of the result stays in cache while the columns are swept
/// over it, SWEEP_GROUP columns per pass, so that the panel is read and written once per
/// SWEEP_GROUP columns and every column is read in long consecutive runs (the prefetcher's
/// favourite). Nodal forces come in threes, so the remainder is swept by sixes and threes.
///
/// What limits it (measured, AVX-512, Zen 5): the loads in flight. A multiplication and an addition
/// per line that wait for it fill the schedulers at half the distance that a pure read (one
/// addition) reaches, 0.78 of the read at 23 MB; fused it is 0.95 to 1.0. Several vectors of each
/// column at a time (SWEEP_UNROLL) are longer runs per stream: 0.6 -> 0.8 of the read from L2.
/// Prefetching by software 128 bytes to 4 KB ahead, other panels, groups of 6, 9, 18 and 24
/// columns, tiles of 16 to 28 vectors in registers over all columns, huge pages below 4 MB: no
/// better over all sizes; and a read of the same block in twelve streams is as fast as a linear one
/// beyond L2, so columns need not be interleaved. Three columns (one contact point) reach 0.65 to
/// 0.77 of the read with every one of these: their result is a third more bytes, with it 0.87
/// to 1.0.

typedef float SWEEP(floats) __attribute__((vector_size(SWEEP_WIDTH), aligned(4), may_alias));
typedef double SWEEP(doubles) __attribute__((vector_size(SWEEP_WIDTH), aligned(8), may_alias));

#define SWEEP_LOAD_FLOAT(p, v) ((v) = *(const SWEEP(floats) *)(const void *)(p))
#define SWEEP_LOAD_DOUBLE(p, v) ((v) = *(const SWEEP(doubles) *)(const void *)(p))

/// Twice rounded, for double storage.
#define SWEEP_ADD(f, c, a) ((a) += (f) * (c))

/// COUNT vectors of the result from row i on, over GROUP columns.
#define SWEEP_STEP(COUNT, GROUP, VECTOR, LOAD, FUSE, FRESH)                                        \
    VECTOR a[COUNT];                                                                               \
    _Pragma("GCC unroll 4") for (int u = 0; u < (COUNT); u++) {                                    \
        if (FRESH) {                                                                               \
            a[u] = (VECTOR){0};                                                                    \
        } else {                                                                                   \
            a[u] = *(VECTOR *)(void *)(acc + i + u * LANES);                                       \
        }                                                                                          \
    }                                                                                              \
    _Pragma("GCC unroll 16") for (int g = 0; g < (GROUP); g++) {                                   \
        _Pragma("GCC unroll 4") for (int u = 0; u < (COUNT); u++) {                                \
            VECTOR c;                                                                              \
            LOAD(column[g] + i + u * LANES, c);                                                    \
            FUSE(factor[g], c, a[u]);                                                              \
        }                                                                                          \
    }                                                                                              \
    _Pragma("GCC unroll 4") for (int u = 0; u < (COUNT); u++) {                                    \
        *(VECTOR *)(void *)(acc + i + u * LANES) = a[u];                                           \
    }

#define SWEEP_LOOP(GROUP, VECTOR, LOAD, FUSE, FRESH)                                               \
    int64_t i = 0;                                                                                 \
    for (; i + SWEEP_UNROLL * LANES <= rows; i += SWEEP_UNROLL * LANES) {                          \
        SWEEP_STEP(SWEEP_UNROLL, GROUP, VECTOR, LOAD, FUSE, FRESH)                                 \
    }                                                                                              \
    for (; i < rows; i += LANES) {                                                                 \
        SWEEP_STEP(1, GROUP, VECTOR, LOAD, FUSE, FRESH)                                            \
    }

/// acc[i] += sum over GROUP columns from `first`, rows [row, row + rows); acc starts from zero at
/// the first column
#define SWEEP_PASS(NAME, GROUP, ELEMENT, SCALAR, VECTOR, LOAD, FUSE, FACTOR)                       \
    SWEEP_TARGET static void SWEEP(NAME)(const pal_field_job *job, int32_t first, int64_t row,     \
                                         int64_t rows, SCALAR *acc) {                              \
        enum { LANES = SWEEP_WIDTH / (int)sizeof(SCALAR) };                                        \
        const ELEMENT *column[GROUP];                                                              \
        VECTOR factor[GROUP];                                                                      \
        for (int g = 0; g < (GROUP); g++) {                                                        \
            int64_t at = job->dof != NULL ? job->dof[first + g] : first + g;                       \
            column[g] = (const ELEMENT *)job->block + at * job->ld + row;                          \
            factor[g] = (VECTOR){0} + job->FACTOR[first + g];                                      \
        }                                                                                          \
        if (first == 0 && !job->add) {                                                             \
            SWEEP_LOOP(GROUP, VECTOR, LOAD, FUSE, 1)                                               \
        } else {                                                                                   \
            SWEEP_LOOP(GROUP, VECTOR, LOAD, FUSE, 0)                                               \
        }                                                                                          \
    }

/// All columns over one panel, in the order of job->dof.
#define SWEEP_PANEL(NAME, PASS, SCALAR)                                                            \
    SWEEP_TARGET static void SWEEP(NAME)(const pal_field_job *job, int64_t row, int64_t rows,      \
                                         SCALAR *acc) {                                            \
        int32_t k = 0;                                                                             \
        if (job->count == 0 && !job->add) {                                                        \
            memset(acc, 0, (size_t)rows * sizeof *acc);                                            \
        }                                                                                          \
        for (; k + SWEEP_GROUP <= job->count; k += SWEEP_GROUP) {                                  \
            SWEEP(PASS##_many)(job, k, row, rows, acc);                                            \
        }                                                                                          \
        for (; k + 6 <= job->count; k += 6) {                                                      \
            SWEEP(PASS##_six)(job, k, row, rows, acc);                                             \
        }                                                                                          \
        for (; k + 3 <= job->count; k += 3) {                                                      \
            SWEEP(PASS##_three)(job, k, row, rows, acc);                                           \
        }                                                                                          \
        for (; k < job->count; k++) {                                                              \
            SWEEP(PASS##_one)(job, k, row, rows, acc);                                             \
        }                                                                                          \
    }

// element, accumulator and vector types, loader, summation, and which rounding of the force is used
#define SWEEP_SINGLE float, float, SWEEP(floats), SWEEP_LOAD_FLOAT, SWEEP_FUSE, f32
#define SWEEP_HALVES uint16_t, float, SWEEP(floats), SWEEP_HALF, SWEEP_FUSE, f32
#define SWEEP_SCALED int16_t, float, SWEEP(floats), SWEEP_INTEGER, SWEEP_FUSE, f32
#define SWEEP_DOUBLE double, double, SWEEP(doubles), SWEEP_LOAD_DOUBLE, SWEEP_ADD, f
#define SWEEP_EXPAND(NAME, GROUP, TYPES) SWEEP_PASS_(NAME, GROUP, TYPES)
#define SWEEP_PASS_(NAME, GROUP, ...) SWEEP_PASS(NAME, GROUP, __VA_ARGS__)

SWEEP_EXPAND(single_many, SWEEP_GROUP, SWEEP_SINGLE)
SWEEP_EXPAND(single_six, 6, SWEEP_SINGLE)
SWEEP_EXPAND(single_three, 3, SWEEP_SINGLE)
SWEEP_EXPAND(single_one, 1, SWEEP_SINGLE)
SWEEP_PANEL(panel_single, single, float)

SWEEP_EXPAND(half_many, SWEEP_GROUP, SWEEP_HALVES)
SWEEP_EXPAND(half_six, 6, SWEEP_HALVES)
SWEEP_EXPAND(half_three, 3, SWEEP_HALVES)
SWEEP_EXPAND(half_one, 1, SWEEP_HALVES)
SWEEP_PANEL(panel_half, half, float)

SWEEP_EXPAND(scaled_many, SWEEP_GROUP, SWEEP_SCALED)
SWEEP_EXPAND(scaled_six, 6, SWEEP_SCALED)
SWEEP_EXPAND(scaled_three, 3, SWEEP_SCALED)
SWEEP_EXPAND(scaled_one, 1, SWEEP_SCALED)
SWEEP_PANEL(panel_scaled, scaled, float)

SWEEP_EXPAND(double_many, SWEEP_GROUP, SWEEP_DOUBLE)
SWEEP_EXPAND(double_six, 6, SWEEP_DOUBLE)
SWEEP_EXPAND(double_three, 3, SWEEP_DOUBLE)
SWEEP_EXPAND(double_one, 1, SWEEP_DOUBLE)
SWEEP_PANEL(panel_double, double, double)

// Short blocks (one cluster's rows): VECTORS vectors of the result stay in registers over all
// columns.
#define SWEEP_TILE(VECTORS)                                                                        \
    SWEEP_TARGET static void SWEEP(tile_##VECTORS)(const pal_field_job *job, int64_t row) {        \
        enum { LANES = SWEEP_WIDTH / (int)sizeof(float) };                                         \
        float *out = job->out + row;                                                               \
        SWEEP(floats) a[VECTORS];                                                                  \
        _Pragma("GCC unroll 8") for (int v = 0; v < (VECTORS); v++) {                              \
            a[v] = job->add ? *(const SWEEP(floats) *)(const void *)(out + v * LANES)              \
                            : (SWEEP(floats)){0};                                                  \
        }                                                                                          \
        for (int32_t k = 0; k < job->count; k++) {                                                 \
            int64_t at = job->dof != NULL ? job->dof[k] : k;                                       \
            const int16_t *column = (const int16_t *)job->block + at * job->ld + row;              \
            SWEEP(floats) factor = (SWEEP(floats)){0} + job->f32[k];                               \
            _Pragma("GCC unroll 8") for (int v = 0; v < (VECTORS); v++) {                          \
                SWEEP(floats) c;                                                                   \
                SWEEP_INTEGER(column + v * LANES, c);                                              \
                SWEEP_FUSE(factor, c, a[v]);                                                       \
            }                                                                                      \
        }                                                                                          \
        _Pragma("GCC unroll 8") for (int v = 0; v < (VECTORS); v++) {                              \
            *(SWEEP(floats) *)(void *)(out + v * LANES) = a[v];                                    \
        }                                                                                          \
    }
SWEEP_TILE(8)
SWEEP_TILE(2)

static void SWEEP(tiles)(const pal_field_job *job) {
    enum { LANES = SWEEP_WIDTH / (int)sizeof(float) };
    int64_t row = 0;
    for (; row + 8 * LANES <= job->rows; row += 8 * LANES) {
        SWEEP(tile_8)(job, row);
    }
    for (; row < job->rows; row += 2 * LANES) { // rows are a multiple of 32
        SWEEP(tile_2)(job, row);
    }
}

static void SWEEP(all)(const pal_field_job *job) {
    if (job->precision == PALPATE_PRECISION_SCALED && job->rows <= SWEEP_SHORT) {
        SWEEP(tiles)(job);
        return;
    }
    int64_t panel = job->precision == PALPATE_PRECISION_DOUBLE ? SWEEP_ROWS_DOUBLE : SWEEP_ROWS;
    for (int64_t row = 0; row < job->rows; row += panel) {
        int64_t rows = job->rows - row < panel ? job->rows - row : panel;
        float *out = job->out + row;
        if (job->precision == PALPATE_PRECISION_SINGLE) {
            SWEEP(panel_single)(job, row, rows, out);
        } else if (job->precision == PALPATE_PRECISION_HALF) {
            SWEEP(panel_half)(job, row, rows, out);
        } else if (job->precision == PALPATE_PRECISION_SCALED) {
            SWEEP(panel_scaled)(job, row, rows, out);
        } else {
            double acc[SWEEP_ROWS_DOUBLE] = {0.0};
            SWEEP(panel_double)(job, row, rows, acc);
            for (int64_t i = 0; i < rows; i++) {
                out[i] = (float)acc[i];
            }
        }
    }
}

#undef SWEEP_LOAD_FLOAT
#undef SWEEP_LOAD_DOUBLE
#undef SWEEP_PASS
#undef SWEEP_LOOP
#undef SWEEP_STEP
#undef SWEEP_ADD
#undef SWEEP_PASS_
#undef SWEEP_EXPAND
#undef SWEEP_PANEL
#undef SWEEP_TILE
#undef SWEEP_SINGLE
#undef SWEEP_HALVES
#undef SWEEP_SCALED
#undef SWEEP_DOUBLE
