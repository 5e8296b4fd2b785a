/// @file quantiles.h  Distribution of a time over an endless run in bounded memory (private).
///
/// Log-linear histogram of nanoseconds: every value below 8192 ns has a bucket of its own, above
/// that each octave is cut into 4096 buckets, so a quantile is exact below 8.192 us and at most
/// 1/4096 (0.025 %) too high beyond it; the maximum is always exact. Quantiles are by nearest rank:
/// the smallest value that at least ceil(p n) samples do not exceed. Values of 2^40 ns (18 minutes)
/// and more share the last bucket (the maximum still tells).
/// Thread: one writer; readers at any time (relaxed atomics: a reader may miss the newest samples).
#ifndef PALPATE_HAPTIC_QUANTILES_H
#define PALPATE_HAPTIC_QUANTILES_H

#include <stdatomic.h>
#include <stdint.h>

#include <palpate/session.h>

typedef struct pal_histogram {
    struct {
        _Atomic uint32_t count;
    } * bucket;             ///< [PALPATE_HISTOGRAM_BUCKETS]; saturates at 2^32-1
    _Atomic int64_t max;    ///< [ns]
    _Atomic uint64_t total; ///< samples
} pal_histogram;

enum {
    PALPATE_HISTOGRAM_BITS = 12,
    PALPATE_HISTOGRAM_OCTAVES = 40 - PALPATE_HISTOGRAM_BITS - 1,
    PALPATE_HISTOGRAM_BUCKETS = (2 + PALPATE_HISTOGRAM_OCTAVES) << PALPATE_HISTOGRAM_BITS
};

/// Allocate and touch every page. @return PALPATE_OK or _MEMORY.
pal_status pal_histogram_init(pal_histogram *histogram);
void pal_histogram_clear(pal_histogram *histogram); ///< frees; a zeroed one is allowed

/// Count one sample [ns]; negative counts as 0. No allocation, no lock. Thread: the writer.
void pal_histogram_add(pal_histogram *histogram, int64_t ns);

/// Quantile `p` in 0..1 [ns]; 0 when empty. Cost: O(buckets).
int64_t pal_histogram_quantile(const pal_histogram *histogram, double p);

/// p50, p99, p99.9 and max in microseconds.
pal_quantiles pal_histogram_us(const pal_histogram *histogram);

#endif
