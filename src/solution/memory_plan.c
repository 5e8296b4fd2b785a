/// @file memory_plan.c  Peak memory of the offline stage from counts alone (see memory_plan.h).
#include "src/solution/memory_plan.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/model/model.h"

static uint64_t dense_element(const pal_model_info *info) {
    return pal_precision_size(pal_memory_plan_precision(info->field_tolerance, info->precision));
}

uint64_t pal_memory_plan_blocks(const pal_model_info *info) {
    uint64_t t = 3 * (uint64_t)info->column_count, s = 3 * (uint64_t)info->row_count;
    return 8 * t * t + t * s * dense_element(info);
}

uint64_t pal_memory_plan_compress(const pal_model_info *info) {
    enum { CONTACTS = 48, SCALED = 2, SINGLE = 4, TALL = 384, SAMPLED = 256, THREADS_MAX = 16 };
    uint64_t t = 3 * (uint64_t)info->column_count, s = 3 * (uint64_t)info->row_count;
    if (t == 0 || s == 0) {
        return 0;
    }
    uint64_t sampled = 8 * CONTACTS * s + 64 * s; // fields of the sampled contacts, one as computed
    if (!(info->field_tolerance > 0)) {
        return sampled;
    }
    // scaled integers beside the dense rows (and beside single where those are in double)
    uint64_t dense = t * s * (SCALED + (dense_element(info) == 8 ? SINGLE : 0));
    // the best bases so far, those on trial and their coefficients in single precision: with ranks
    // of a sixth of the rows (10 000 rows, 1e-3; larger bodies have less, where smaller ones have
    // more the clusters below outweigh it) 1.6 bytes for each entry of the rows
    uint64_t bases = 2 * t * s;
    // per thread one cluster of 128 nodes: its rows, far columns and coefficients, those of its
    // halves, in double precision; then in single; bases and samples, which do not grow with t
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    uint64_t threads = cores < 1 ? 1 : cores > THREADS_MAX ? THREADS_MAX : (uint64_t)cores;
    uint64_t cluster = (4 * 8 + 2 * 4) * TALL * t + 8 * (3 * TALL * TALL + 2 * TALL * SAMPLED);
    return sampled + dense + bases + threads * cluster;
}

uint64_t pal_memory_plan_peak(const pal_model_info *info) {
    uint64_t t = 3 * (uint64_t)info->column_count, n = 3 * (uint64_t)info->node_count;
    // Before the symbolic analysis the factors are a guess (factor.c refuses by the exact count).
    // From 1000 to 8000 nodes bench/offline finds 3.1 n^(5/3) entries in UMFPACK's L + U of the
    // mixed galerkin system (within 3 %; 32 bytes each while they are extracted) and at most 1.4
    // n^(5/3) in CHOLMOD's L (48 bytes each), n the displacements. Nested dissection tends to
    // n^(4/3): larger bodies need less.
    double dn = (double)n, cube = cbrt(dn);
    double each = strcmp(info->method, "galerkin") == 0 ? 3.1 * 32.0 : 1.4 * 48.0;
    uint64_t factors = (uint64_t)(each * dn * cube * cube) + 2000 * n;
    uint64_t certificate =
        8 * t * t; // copies C_TT for its factorization; the factors are freed by then
    uint64_t compress = pal_memory_plan_compress(info), beside = factors;
    beside = certificate > beside ? certificate : beside;
    beside = compress > beside ? compress : beside;
    return pal_memory_plan_blocks(info) + beside;
}

/// Address space of this process in use [bytes]; 0: unknown.
static uint64_t address_space(void) {
    unsigned long long pages = 0;
    FILE *f = fopen("/proc/self/statm", "re");
    if (f != NULL) {
        pages = fscanf(f, "%llu", &pages) == 1 ? pages : 0;
        (void)fclose(f);
    }
    return (uint64_t)pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

/// What a limited address space has left for the model. OpenBLAS maps a buffer of 128 MiB per
/// thread and tries for ever when it cannot have it; a thread's arena reserves 64 MiB more, its
/// stack 8.
static uint64_t address_space_left(uint64_t limit) {
    long cores = sysconf(_SC_NPROCESSORS_ONLN);
    uint64_t taken = address_space() + (cores > 0 ? (uint64_t)cores : 1) * (uint64_t)(200 << 20);
    return limit > taken ? limit - taken : 1;
}

uint64_t pal_memory_available(void) {
    uint64_t available = 0;
    FILE *f = fopen("/proc/meminfo", "re");
    if (f != NULL) {
        char line[160];
        unsigned long long kib;
        while (fgets(line, sizeof line, f) != NULL) {
            if (sscanf(line, "MemAvailable: %llu kB", &kib) == 1) {
                available = 1024 * (uint64_t)kib;
            }
        }
        (void)fclose(f);
    }
    struct rlimit limit;
    if (getrlimit(RLIMIT_AS, &limit) == 0 && limit.rlim_cur != RLIM_INFINITY) {
        uint64_t left = address_space_left(limit.rlim_cur);
        available = available == 0 || left < available ? left : available;
    }
    return available;
}

pal_status pal_memory_plan_check(const pal_model_info *info, pal_error *error) {
    uint64_t peak = pal_memory_plan_peak(info), available = pal_memory_available();
    if (available == 0 || peak <= available) {
        return PALPATE_OK;
    }
    double t = 3.0 * info->column_count;
    char choice[80] = "";
    if (info->field_tolerance > 0) {
        (void)snprintf(choice, sizeof choice, ", choosing their form (store.tolerance) %.1f GB",
                       1e-9 * (double)pal_memory_plan_compress(info));
    }
    return pal_fail(
        error, PALPATE_ERROR_MEMORY,
        "the model needs about %.1f GB of memory and %.1f GB are free: %d nodes, the "
        "compliance of %d touchable nodes takes %.1f GB and their rows %.1f GB%s; narrow "
        "body.touchable, store less (store.displacement) or use a larger body.spacing",
        1e-9 * (double)peak, 1e-9 * (double)available, info->node_count, info->column_count,
        8e-9 * t * t, 3e-9 * t * info->row_count * (double)dense_element(info), choice);
}
