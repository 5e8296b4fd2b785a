/// @file field_sample.c  Contacts to measure a stored field with (see field_sample.h).
#include "src/store/field_sample.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/engine/field_model.h"

/// Numbers in [0, 1): the same everywhere (Knuth's MMIX generator, upper bits).
static double unit_random(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 11) * 0x1p-53;
}

typedef struct near_node {
    double square;
    int32_t column;
} near_node;

static int by_distance(const void *a, const void *b) {
    const near_node *x = a, *y = b;
    return x->square != y->square ? (x->square > y->square) - (x->square < y->square)
                                  : (x->column > y->column) - (x->column < y->column);
}

static void make_contact(const pal_model *m, int32_t wanted, int friction, uint64_t *random,
                         near_node *near, pal_sample_contact *c) {
    int32_t columns = m->info.column_count;
    int32_t center = (int32_t)(unit_random(random) * columns);
    const double *o = m->position + 3 * (size_t)m->column_node[center];
    for (int32_t j = 0; j < columns; j++) {
        const double *x = m->position + 3 * (size_t)m->column_node[j];
        double d[3] = {x[0] - o[0], x[1] - o[1], x[2] - o[2]};
        near[j] = (near_node){d[0] * d[0] + d[1] * d[1] + d[2] * d[2], j};
    }
    qsort(near, (size_t)columns, sizeof *near, by_distance);
    int32_t count = wanted < columns ? wanted : columns;
    double reach = near[count - 1].square > 0 ? 1.02 * near[count - 1].square : 1, side[3],
           length = 0;
    for (int i = 0; i < 3; i++) {
        side[i] = unit_random(random) - 0.5;
        length += side[i] * side[i];
    }
    double slide = friction ? 0.3 / sqrt(length + 1e-12) : 0;
    c->count = 3 * count;
    for (int32_t k = 0; k < count; k++) {
        const double *n = m->normal + 3 * (size_t)m->column_node[near[k].column];
        double p = sqrt(1 - near[k].square / reach) * (0.5 + unit_random(random));
        for (int i = 0; i < 3; i++) {
            c->dof[3 * k + i] = 3 * near[k].column + i;
            c->force[3 * k + i] = p * (slide * side[i] - n[i]);
        }
    }
}

void pal_field_sample_clear(pal_field_sample *sample) {
    free(sample->contact);
    free(sample->field);
    *sample = (pal_field_sample){0};
}

pal_status pal_field_sample_make(const pal_model *model, uint64_t seed, int32_t count,
                                 pal_field_sample *out, pal_error *error) {
    static const int32_t nodes[] = {1, 4, 15, PALPATE_SAMPLE_NODES};
    size_t rows = 3 * (size_t)model->info.row_count;
    *out = (pal_field_sample){.count = count};
    out->contact = calloc((size_t)count + 1, sizeof *out->contact);
    out->field = calloc((size_t)count * rows + 1, sizeof *out->field);
    near_node *near = malloc((size_t)model->info.column_count * sizeof *near + 1);
    double *column = malloc((rows + 1) * sizeof *column);
    pal_status status = PALPATE_OK;
    if (out->contact == NULL || out->field == NULL || near == NULL || column == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for %d sampled fields",
                          (int)count);
    }
    uint64_t random = seed * 2 + 1;
    for (int32_t s = 0; status == PALPATE_OK && s < count; s++) {
        pal_sample_contact *c = &out->contact[s];
        make_contact(model, nodes[s % 4], s / 4 % 2, &random, near, c);
        double *field = out->field + (size_t)s * rows;
        for (int32_t k = 0; status == PALPATE_OK && k < c->count; k++) {
            status = pal_model_load_column(model, c->dof[k], column);
            for (size_t i = 0; i < rows; i++) {
                field[i] += c->force[k] * column[i];
            }
        }
    }
    free(near);
    free(column);
    if (status != PALPATE_OK) {
        pal_field_sample_clear(out);
    }
    return status;
}

pal_status pal_field_sample_error(const pal_field_sample *sample, const pal_model *model,
                                  double *worst, double *cost, pal_error *error) {
    size_t floats = (size_t)pal_field_floats(model), scratch_bytes = pal_field_scratch_bytes(model);
    float *out = aligned_alloc(64, (floats * sizeof *out + 64) / 64 * 64);
    void *scratch = aligned_alloc(64, scratch_bytes + 64);
    pal_status status = PALPATE_OK;
    if (out == NULL || scratch == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory for a sampled field");
    }
    double sum = 0;
    int32_t large = 0;
    *worst = 0;
    for (int32_t s = 0; status == PALPATE_OK && s < sample->count; s++) {
        const pal_sample_contact *c = &sample->contact[s];
        float f32[3 * PALPATE_SAMPLE_NODES];
        for (int32_t k = 0; k < c->count; k++) {
            f32[k] = (float)(c->force[k] * pal_model_unit(model, c->dof[k]));
        }
        pal_field_compute(pal_field_best(), model, c->count, c->dof, c->force, f32, scratch, out);
        const double *exact = sample->field + (size_t)s * 3 * (size_t)model->info.row_count;
        double off = 0, size = 0;
        for (int32_t i = 0; i < model->info.row_count; i++) {
            double e = 0, u = 0;
            for (int d = 0; d < 3; d++) {
                double x = exact[3 * i + d], y = (double)out[3 * i + d];
                e += (y - x) * (y - x);
                u += x * x;
            }
            off = fmax(off, e);
            size = fmax(size, u);
        }
        *worst = fmax(*worst, size > 0 ? sqrt(off / size) : 0);
        if (c->count == sample->contact[3 < sample->count ? 3 : 0].count) {
            sum += pal_field_predict(model, c->count, c->dof);
            large++;
        }
    }
    free(out);
    free(scratch);
    if (cost != NULL) {
        *cost = large > 0 ? sum / large : 0;
    }
    return status;
}
