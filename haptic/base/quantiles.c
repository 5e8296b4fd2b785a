/// @file quantiles.c  Log-linear histogram of nanoseconds (layout and error bound: quantiles.h).
#include "haptic/base/quantiles.h"

#include <math.h>
#include <stdlib.h>

enum { BITS = PALPATE_HISTOGRAM_BITS, BUCKETS = PALPATE_HISTOGRAM_BUCKETS };

static int32_t bucket_of(int64_t ns) {
    if (ns < 0) {
        ns = 0;
    }
    uint64_t v = (uint64_t)ns;
    if (v < (UINT64_C(2) << BITS)) {
        return (int32_t)v;
    }
    // v in [2^(BITS+e), 2^(BITS+e+1)), e >= 1: its BITS+1 leading bits choose the bucket
    int e = 63 - __builtin_clzll(v) - BITS;
    if (e > PALPATE_HISTOGRAM_OCTAVES) {
        return BUCKETS - 1;
    }
    return (int32_t)(((uint64_t)e << BITS) + (v >> e));
}

/// Largest value that falls into a bucket.
static int64_t bucket_top(int32_t bucket) {
    if (bucket < (2 << BITS)) {
        return bucket;
    }
    int e = (bucket >> BITS) - 1;
    uint64_t lead = (uint64_t)bucket - ((uint64_t)e << BITS);
    return (int64_t)(((lead + 1) << e) - 1);
}

pal_status pal_histogram_init(pal_histogram *histogram) {
    histogram->bucket = malloc(BUCKETS * sizeof *histogram->bucket);
    if (histogram->bucket == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    for (int32_t i = 0; i < BUCKETS; i++) {
        atomic_init(&histogram->bucket[i].count, 0);
    }
    atomic_init(&histogram->max, 0);
    atomic_init(&histogram->total, 0);
    return PALPATE_OK;
}

void pal_histogram_clear(pal_histogram *histogram) {
    free(histogram->bucket);
    histogram->bucket = NULL;
}

void pal_histogram_add(pal_histogram *histogram, int64_t ns) {
    // a single writer: load and store are enough, no locked instruction
    // (a bucket that saturates, after 49 days at 1 kHz, only makes the tail look worse)
    _Atomic uint32_t *b = &histogram->bucket[bucket_of(ns)].count;
    uint32_t n = atomic_load_explicit(b, memory_order_relaxed);
    if (n != UINT32_MAX) {
        atomic_store_explicit(b, n + 1, memory_order_relaxed);
    }
    if (ns > atomic_load_explicit(&histogram->max, memory_order_relaxed)) {
        atomic_store_explicit(&histogram->max, ns, memory_order_relaxed);
    }
    uint64_t total = atomic_load_explicit(&histogram->total, memory_order_relaxed);
    atomic_store_explicit(&histogram->total, total + 1, memory_order_relaxed);
}

/// Several quantiles (p ascending) in one pass that ends at the last of them. A sample counted
/// between the total and its bucket, while the writer runs, shifts a rank by one at most.
static void quantiles(const pal_histogram *histogram, const double p[], int count, int64_t out[]) {
    int64_t max = atomic_load_explicit(&histogram->max, memory_order_relaxed);
    uint64_t total = atomic_load_explicit(&histogram->total, memory_order_relaxed);
    uint64_t seen = 0;
    int32_t bucket = -1;
    for (int k = 0; k < count; k++) {
        double rank = ceil(p[k] * (double)total);
        uint64_t want = rank < 1.0 ? 1 : (uint64_t)rank;
        while (total > 0 && seen < want && bucket < BUCKETS - 1) {
            bucket++;
            seen += atomic_load_explicit(&histogram->bucket[bucket].count, memory_order_relaxed);
        }
        int64_t top = total == 0 ? 0 : bucket_top(bucket);
        out[k] = total > 0 && (bucket == BUCKETS - 1 || top > max) ? max : top;
    }
}

int64_t pal_histogram_quantile(const pal_histogram *histogram, double p) {
    int64_t value = 0;
    quantiles(histogram, &p, 1, &value);
    return value;
}

pal_quantiles pal_histogram_us(const pal_histogram *histogram) {
    int64_t ns[3] = {0};
    quantiles(histogram, (const double[]){0.5, 0.99, 0.999}, 3, ns);
    return (pal_quantiles){
        .p50 = 1e-3 * (double)ns[0],
        .p99 = 1e-3 * (double)ns[1],
        .p999 = 1e-3 * (double)ns[2],
        .max = 1e-3 * (double)atomic_load_explicit(&histogram->max, memory_order_relaxed),
    };
}
