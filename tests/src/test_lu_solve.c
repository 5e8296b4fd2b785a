/// Panels and block triangular solves: against a plain sparse substitution, entry by entry in the
/// same order, in every instruction-set variant: the same bits.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/solution/lu_solve.h"

enum { N = 211, B = PALPATE_LU_BLOCK };

static double random_unit(uint64_t *s) {
    *s = *s * 6364136223846793005u + 1442695040888963407u;
    return (double)(*s >> 11) / 9007199254740992.0 - 0.5;
}

typedef struct triangle {
    int64_t start[N + 1];
    int32_t index[N * N];
    double value[N * N];
} triangle;

/// Runs of up to 11 columns that share most of a pattern, as a front's columns do, and single ones.
static void random_triangle(uint64_t *seed, triangle *t) {
    uint8_t shared[N] = {0};
    int64_t at = 0;
    int run = 0;
    for (int j = 0; j < N; j++) {
        if (run == 0) {
            run = 1 + (int)(11.0 * (random_unit(seed) + 0.5));
            for (int i = 0; i < N; i++) {
                shared[i] = random_unit(seed) < -0.3;
            }
        }
        run--;
        t->start[j] = at;
        for (int i = j + 1; i < N; i++) {
            double u = random_unit(seed);
            if ((shared[i] || i - j < 4) ? u < 0.47 : u < -0.495) {
                t->index[at] = i;
                t->value[at++] = 0.2 * random_unit(seed);
            }
        }
    }
    t->start[N] = at;
}

typedef struct rig {
    triangle lower, upper;
    pal_lu lu;
    double *x, *expected, *work;
} rig;

static void make(rig *r, int count) {
    uint64_t seed = 11;
    pal_lu *lu = &r->lu;
    random_triangle(&seed, &r->lower);
    random_triangle(&seed, &r->upper);
    lu->n = N;
    lu->diagonal = malloc(N * sizeof *lu->diagonal);
    lu->row_order = malloc(N * sizeof *lu->row_order);
    lu->column_order = malloc(N * sizeof *lu->column_order);
    lu->row_scale = malloc(N * sizeof *lu->row_scale);
    for (int k = 0; k < N; k++) {
        lu->diagonal[k] = 1.5 + random_unit(&seed);
        lu->row_order[k] = (k * 17) % N;
        lu->column_order[k] = (k * 23 + 5) % N;
        lu->row_scale[k] = 1.0 + random_unit(&seed);
    }
    const triangle *l = &r->lower, *u = &r->upper;
    assert_int_equal(pal_lu_panels_make(N, l->start, l->index, l->value, 0, &lu->lower), 0);
    assert_int_equal(pal_lu_panels_make(N, u->start, u->index, u->value, 1, &lu->upper), 0);
    r->x = malloc(sizeof(double) * N * B);
    r->expected = malloc(sizeof(double) * N * B);
    r->work = aligned_alloc(64, sizeof(double) * N * B);
    for (int c = 0; c < count; c++) {
        double y[N];
        for (int i = 0; i < N; i++) { // some columns begin with zeros, which the sweep skips
            r->x[c * N + i] = c % 3 == 1 && (i * 29) % N < N - 20 ? 0.0 : random_unit(&seed);
        }
        for (int k = 0; k < N; k++) {
            int i = lu->row_order[k];
            y[k] = lu->row_scale[i] * r->x[c * N + i];
        }
        for (int k = 0; k < N; k++) {
            for (int64_t e = l->start[k]; e < l->start[k + 1]; e++) {
                y[l->index[e]] -= l->value[e] * y[k];
            }
        }
        for (int k = N - 1; k >= 0; k--) {
            for (int64_t e = u->start[k + 1] - 1; e >= u->start[k]; e--) {
                y[k] -= u->value[e] * y[u->index[e]];
            }
            y[k] *= lu->diagonal[k];
        }
        for (int k = 0; k < N; k++) {
            r->expected[c * N + lu->column_order[k]] = y[k];
        }
    }
}

static void clear(rig *r) {
    pal_lu_clear(&r->lu);
    free(r->x);
    free(r->expected);
    free(r->work);
    free(r);
}

static void every_variant_gives_the_bits_of_plain_substitution(void **state) {
    (void)state;
    static const int counts[] = {1, 7, B};
    for (size_t k = 0; k < sizeof counts / sizeof counts[0]; k++) {
        for (pal_lu_variant v = PALPATE_LU_BASE; v <= pal_lu_best_variant(); v++) {
            rig *r = calloc(1, sizeof *r);
            make(r, counts[k]);
            pal_lu_solve(&r->lu, v, counts[k], r->x, r->work);
            for (int i = 0; i < N * counts[k]; i++) {
                assert_true(r->x[i] == r->expected[i]);
            }
            clear(r);
        }
    }
}

static void panels_hold_every_entry_and_little_else(void **state) {
    (void)state;
    rig *r = calloc(1, sizeof *r);
    make(r, 1);
    const pal_lu_panels *p = &r->lu.lower;
    int64_t nonzero = 0, wide = 0;
    for (int64_t e = 0; e < p->value_start[p->count]; e++) {
        nonzero += p->value[e] != 0.0;
    }
    for (int32_t q = 0; q < p->count; q++) {
        int32_t width = p->first[q + 1] - p->first[q];
        assert_in_range(width, 1, PALPATE_LU_WIDTH);
        wide += width > 2;
    }
    assert_int_equal(nonzero, r->lower.start[N]);
    assert_int_equal(p->first[p->count], N);
    assert_true(wide > 5);
    clear(r);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_variant_gives_the_bits_of_plain_substitution),
        cmocka_unit_test(panels_hold_every_entry_and_little_else),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
