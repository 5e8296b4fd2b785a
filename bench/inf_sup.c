/// @file inf_sup.c  Bench: which displacement/pressure pair of the Galerkin method is stable.
///
/// Numerical inf-sup values (src/discretization/galerkin_inf_sup.h) on a cube held all round, 3 to
/// 7 cells a side, lattice and jittered. A pair is stable when only the constant pressure is unseen
/// and beta does not fall with refinement: the last value at least 0.8 of the first (an unstable
/// pair's falls like h or faster, here to less than 0.5). Dense algebra, about a minute.
///
///     bench/inf_sup            writes bench/results/inf_sup.csv
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "src/discretization/galerkin_inf_sup.h"

enum { FIRST = 3, LAST = 7 };

typedef struct pair {
    const char *name;
    pal_method method;
} pair;

static const pair PAIRS[] = {
    {"nodal average, no stabilization", {.kind = PALPATE_METHOD_GALERKIN, .stabilization = 0.0}},
    {"pressure projection 0.1", {.kind = PALPATE_METHOD_GALERKIN, .stabilization = 0.1}},
    {"pressure projection 1 (default)", {.kind = PALPATE_METHOD_GALERKIN, .stabilization = 1.0}},
    {"pressure projection 4", {.kind = PALPATE_METHOD_GALERKIN, .stabilization = 4.0}},
    {"wide MLS (18), no stabilization",
     {.kind = PALPATE_METHOD_GALERKIN, .stabilization = 0.0, .neighbours = 18}},
    {"wide MLS (18), projection 1",
     {.kind = PALPATE_METHOD_GALERKIN, .stabilization = 1.0, .neighbours = 18}},
};

static pal_status measure(const pair *p, int n, double jitter, pal_inf_sup *out, pal_error *error) {
    pal_cloud cloud;
    const double size[3] = {1, 1, 1};
    pal_status status = pal_cloud_box(&cloud, size, (const int[3]){n, n, n}, jitter, 5, error);
    if (status != PALPATE_OK) {
        return status;
    }
    uint8_t *fixed = calloc((size_t)cloud.node_count, 1);
    if (fixed == NULL) {
        pal_cloud_clear(&cloud);
        return PALPATE_ERROR_MEMORY;
    }
    memset(fixed, 1, (size_t)cloud.surface_count);
    status = pal_galerkin_inf_sup(&cloud, fixed, &p->method, out, error);
    free(fixed);
    pal_cloud_clear(&cloud);
    return status;
}

int main(void) {
    FILE *csv = fopen("bench/results/inf_sup.csv", "w");
    if (csv == NULL) {
        fprintf(stderr,
                "bench/results/inf_sup.csv: cannot be written; run from the repository's root\n");
        return 1;
    }
    fprintf(csv, "pair,jitter,cells,pressures,zero_modes,beta\n");
    printf("%-34s %6s  %s\n", "pair", "jitter", "beta (zero modes) for 3 .. 7 cells a side");
    int failed = 0;
    for (size_t k = 0; k < sizeof PAIRS / sizeof *PAIRS && !failed; k++) {
        for (int jittered = 0; jittered < 2 && !failed; jittered++) {
            double jitter = jittered ? 0.25 : 0.0, first = 0.0;
            pal_inf_sup s = {0};
            int zero_modes = 0;
            printf("%-34s %6g ", PAIRS[k].name, jitter);
            for (int n = FIRST; n <= LAST && !failed; n++) {
                pal_error error = {0};
                if (measure(&PAIRS[k], n, jitter, &s, &error) != PALPATE_OK) {
                    fprintf(stderr, "%s\n", error.message);
                    failed = 1;
                    break;
                }
                first = n == FIRST ? s.beta : first;
                zero_modes = s.zero_modes > zero_modes ? s.zero_modes : zero_modes;
                printf(" %.3f (%d)", s.beta, s.zero_modes);
                (void)fflush(stdout);
                fprintf(csv, "%s,%g,%d,%d,%d,%.6g\n", PAIRS[k].name, jitter, n, s.pressures,
                        s.zero_modes, s.beta);
            }
            printf("  %s\n", zero_modes > 1         ? "UNSTABLE: pressures nothing sees"
                             : s.beta < 0.8 * first ? "UNSTABLE: falls with refinement"
                                                    : "stable");
        }
    }
    (void)fclose(csv);
    return failed;
}
