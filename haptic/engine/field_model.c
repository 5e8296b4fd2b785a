/// @file field_model.c  Eq. 53 for a model: one sweep, or through the clusters' bases
/// (row_bases.h).
///
/// Compressed: c = S f over the touched columns; per cluster U c into a tile of its own rows; the
/// near pairs of the touched groups on top; then every node's three numbers to their place. Each of
/// the three is the kernel of field.h, so the variants agree bit for bit.
#include "haptic/engine/field_model.h"
#include "haptic/base/block.h"

#include <string.h>

enum { LINE = PALPATE_BLOCK_LINE, FLOATS = LINE / (int)sizeof(float) };

/// Rows of the swept block, up to a whole line of the column.
static int64_t swept_rows(const pal_model *model) {
    int64_t granule = LINE / (int64_t)pal_precision_size(model->info.precision);
    return (pal_model_block_rows(model) + granule - 1) / granule * granule;
}

int64_t pal_field_floats(const pal_model *model) {
    if (model->info.row_count == 0 || (model->c_st == NULL && model->bases == NULL)) {
        return 0;
    }
    return model->bases == NULL ? swept_rows(model)
                                : (3 * (int64_t)model->info.row_count + 31) / 32 * 32;
}

typedef struct scratch {
    float *coefficient; ///< (rank) of all clusters
    float *tile;        ///< the clusters' rows
    float *factor;      ///< (3 column_count) forces of one group
    int32_t *column;    ///< (3 column_count) their columns in the group
    int32_t *next;      ///< (3 column_count) the touched dofs of a group, chained
    int32_t *head;      ///< (group_count) -1: nothing touched
} scratch;

/// Lay the scratch out from `at`; sizes alone with at NULL.
static size_t lay_out(const pal_model *model, unsigned char *at, scratch *s) {
    const pal_row_bases *b = model->bases;
    size_t dofs = 3 * (size_t)model->info.column_count;
    const size_t bytes[] = {
        pal_block_padded((size_t)swept_rows(model) * sizeof(float)),
        pal_block_padded((size_t)b->tile_start[b->cluster_count] * sizeof(float)),
        pal_block_padded(dofs * sizeof(float)),
        pal_block_padded(dofs * sizeof(int32_t)),
        pal_block_padded(dofs * sizeof(int32_t)),
        pal_block_padded((size_t)b->group_count * sizeof(int32_t))};
    size_t total = 0, start[6];
    for (int i = 0; i < 6; i++) {
        start[i] = total;
        total += bytes[i];
    }
    if (at != NULL) {
        *s = (scratch){.coefficient = (float *)(void *)(at + start[0]),
                       .tile = (float *)(void *)(at + start[1]),
                       .factor = (float *)(void *)(at + start[2]),
                       .column = (int32_t *)(void *)(at + start[3]),
                       .next = (int32_t *)(void *)(at + start[4]),
                       .head = (int32_t *)(void *)(at + start[5])};
    }
    return total;
}

size_t pal_field_scratch_bytes(const pal_model *model) {
    return model->bases != NULL ? lay_out(model, NULL, NULL) : 0;
}

/// Chain the touched dofs by group, in the order given. @return the groups' heads in s->head
static void chain(const pal_row_bases *b, int32_t count, const int32_t *dof, const scratch *s) {
    memset(s->head, 0xff, (size_t)b->group_count * sizeof *s->head);
    for (int32_t k = count - 1; k >= 0; k--) { // backwards: the chains then run forwards
        int32_t g = b->column_group[dof[k] / 3];
        s->next[k] = s->head[g];
        s->head[g] = k;
    }
}

/// Ask for the columns of a near pair: they are short and lie anywhere, so no prefetcher would.
static inline void fetch(const pal_row_bases *b, int32_t pair, int32_t count,
                         const int32_t *column) {
    int64_t ld = pal_bases_ld(b, b->pair_cluster[pair]);
    const int16_t *data = b->near + b->near_start[pair];
    for (int32_t k = 0; k < count; k++) {
        for (int64_t i = 0; i < ld; i += LINE / (int64_t)sizeof *data) {
            __builtin_prefetch(data + column[k] * ld + i);
        }
    }
}

/// Add the near pairs of one touched group to its clusters' tiles.
static void add_near(pal_isa isa, const pal_row_bases *b, int32_t group, const int32_t *dof,
                     const double *f, const scratch *s) {
    int32_t count = 0;
    for (int32_t k = s->head[group]; k >= 0; k = s->next[k]) {
        s->column[count++] = 3 * (b->column_place[dof[k] / 3] - b->group_start[group]) + dof[k] % 3;
    }
    for (int32_t p = b->pair_start[group]; p < b->pair_start[group + 1]; p++) {
        int32_t r = b->pair_cluster[p], i = 0;
        const float *scale = b->near_scale + b->near_scale_start[p];
        if (p + 1 < b->pair_start[group + 1]) {
            fetch(b, p + 1, count, s->column);
        }
        for (int32_t k = s->head[group]; k >= 0; k = s->next[k], i++) {
            s->factor[i] = (float)(f[k] * (double)scale[s->column[i]]);
        }
        const pal_field_job job = {.precision = PALPATE_PRECISION_SCALED,
                                   .block = b->near + b->near_start[p],
                                   .ld = pal_bases_ld(b, r),
                                   .rows = pal_bases_ld(b, r),
                                   .count = count,
                                   .dof = s->column,
                                   .f32 = s->factor,
                                   .add = 1,
                                   .out = s->tile + b->tile_start[r]};
        pal_field_sweep(isa, &job);
    }
}

static void compute_compressed(pal_isa isa, const pal_model *model, int32_t count,
                               const int32_t *dof, const double *f, const float *f32,
                               const scratch *s, float *out) {
    const pal_row_bases *b = model->bases;
    if (b->rank > 0) {
        const pal_field_job job = {.precision = model->info.precision,
                                   .block = model->c_st,
                                   .ld = model->row_ld,
                                   .rows = swept_rows(model),
                                   .count = count,
                                   .dof = dof,
                                   .f32 = f32,
                                   .out = s->coefficient};
        pal_field_sweep(isa, &job);
        for (int32_t k = 0; k < b->rank; k++) {
            s->coefficient[k] *= b->basis_scale[k];
        }
    }
    for (int32_t r = 0; r < b->cluster_count; r++) {
        const pal_field_job job = {.precision = PALPATE_PRECISION_SCALED,
                                   .block = b->basis + b->basis_start[r],
                                   .ld = pal_bases_ld(b, r),
                                   .rows = pal_bases_ld(b, r),
                                   .count = pal_bases_rank(b, r),
                                   .f32 = s->coefficient + b->rank_start[r],
                                   .out = s->tile + b->tile_start[r]};
        pal_field_sweep(isa, &job);
    }
    chain(b, count, dof, s);
    for (int32_t k = 0; k < count; k++) {
        int32_t g = b->column_group[dof[k] / 3];
        if (s->head[g] == k) { // once per group, at its first dof
            add_near(isa, b, g, dof, f, s);
        }
    }
    for (int32_t r = 0; r < b->cluster_count; r++) {
        const float *tile = s->tile + b->tile_start[r];
        for (int32_t p = b->cluster_start[r]; p < b->cluster_start[r + 1]; p++, tile += 3) {
            float *to = out + 3 * (int64_t)b->row_order[p];
            to[0] = tile[0];
            to[1] = tile[1];
            to[2] = tile[2];
        }
    }
    for (int64_t i = 3 * (int64_t)model->info.row_count; i < pal_field_floats(model); i++) {
        out[i] = 0.0f;
    }
}

static void compute(pal_isa isa, const pal_model *model, int32_t count, const int32_t *dof,
                    const double *f, const float *f32, void *scratch_block, float *out) {
    if (model->bases != NULL) {
        scratch s;
        (void)lay_out(model, scratch_block, &s);
        compute_compressed(isa, model, count, dof, f, f32, &s, out);
        return;
    }
    const pal_field_job job = {.precision = model->info.precision,
                               .block = model->c_st,
                               .ld = model->row_ld,
                               .rows = swept_rows(model),
                               .count = count,
                               .dof = dof,
                               .f = f,
                               .f32 = f32,
                               .out = out};
    pal_field_sweep(isa, &job);
}

void pal_field_compute(pal_isa isa, const pal_model *model, int32_t count, const int32_t *dof,
                       const double *f, const float *f32, void *scratch_block, float *out) {
    // a column without a force adds nothing: on a flat face along an axis, touched without
    // friction, these are two in three
    enum { SKIP_MAX = 384 };
    int32_t kept_dof[SKIP_MAX], kept = 0;
    double kept_f[SKIP_MAX];
    float kept_f32[SKIP_MAX];
    for (int32_t k = 0; k < count && count <= SKIP_MAX; k++) {
        if (f[k] != 0.0) {
            kept_dof[kept] = dof[k];
            kept_f[kept] = f[k];
            kept_f32[kept++] = f32[k];
        }
    }
    int some = count <= SKIP_MAX && kept < count;
    compute(isa, model, some ? kept : count, some ? kept_dof : dof, some ? kept_f : f,
            some ? kept_f32 : f32, scratch_block, out);
}

// ---- Cost ---------------------------------------------------------------------------------------

void pal_field_count_work(const pal_model *model, int32_t count, const int32_t *dof,
                          double work[PALPATE_FIELD_WORK]) {
    memset(work, 0, PALPATE_FIELD_WORK * sizeof *work);
    if (pal_field_floats(model) == 0) {
        return;
    }
    const pal_row_bases *b = model->bases;
    size_t element = pal_precision_size(model->info.precision);
    work[element == 2 ? PALPATE_WORK_INTEGER : PALPATE_WORK_TOUCHED] =
        (double)count * (double)swept_rows(model) * (double)element;
    if (b == NULL) {
        return;
    }
    for (int32_t k = 0; k < count; k++) {
        int32_t g = b->column_group[dof[k] / 3];
        int first = 1; // dof of its group
        for (int32_t i = 0; i < k && first; i++) {
            first = b->column_group[dof[i] / 3] != g;
        }
        for (int32_t p = b->pair_start[g]; p < b->pair_start[g + 1]; p++) {
            work[PALPATE_WORK_NEAR] += 2 * (double)pal_bases_ld(b, b->pair_cluster[p]);
            work[PALPATE_WORK_PAIRS] += first;
        }
    }
    work[PALPATE_WORK_BASIS] = 2 * (double)b->basis_start[b->cluster_count];
    work[PALPATE_WORK_CLUSTERS] = b->cluster_count;
    work[PALPATE_WORK_ROWS] = 3 * (double)model->info.row_count;
}

const double pal_field_work_ns[PALPATE_FIELD_WORK] = {
    [PALPATE_WORK_TOUCHED] = 0.0255, [PALPATE_WORK_INTEGER] = 0.035, [PALPATE_WORK_BASIS] = 0.026,
    [PALPATE_WORK_NEAR] = 0.03,      [PALPATE_WORK_PAIRS] = 210,     [PALPATE_WORK_CLUSTERS] = 225,
    [PALPATE_WORK_ROWS] = 0};

double pal_field_predict(const pal_model *model, int32_t count, const int32_t *dof) {
    double work[PALPATE_FIELD_WORK], ns = 0;
    pal_field_count_work(model, count, dof, work);
    for (int i = 0; i < PALPATE_FIELD_WORK; i++) {
        ns += pal_field_work_ns[i] * work[i];
    }
    return ns;
}
