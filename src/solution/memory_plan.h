/// @file memory_plan.h  Will it fit? Predicted before anything large is allocated.
#ifndef PALPATE_SRC_MEMORY_PLAN_H
#define PALPATE_SRC_MEMORY_PLAN_H

#include <stdint.h>

#include <palpate/model.h>

/// Precision of the rows as they are solved for: with a tolerance (store.tolerance; 0: none) they
/// are dense and more exact first, and their form is chosen afterwards.
static inline pal_precision pal_memory_plan_precision(double tolerance, pal_precision asked) {
    return tolerance == 0     ? asked
           : tolerance > 1e-5 ? PALPATE_PRECISION_SINGLE
                              : PALPATE_PRECISION_DOUBLE;
}

/// Bytes of the compliance blocks the solve stage will hold. The tolerance is
/// info->field_tolerance.
uint64_t pal_memory_plan_blocks(const pal_model_info *info);

/// Bytes beside the blocks while the form of the rows is chosen (src/store/compress.c): the
/// candidates that live at the same time and what their clusters are made in.
uint64_t pal_memory_plan_compress(const pal_model_info *info);

/// Predicted peak bytes of the solve, certificate and compression stages for a model's counts and
/// tolerance.
uint64_t pal_memory_plan_peak(const pal_model_info *info);

/// Bytes the machine can give now (MemAvailable, and what RLIMIT_AS leaves beside what is mapped
/// and will be by OpenBLAS); 0: unknown.
uint64_t pal_memory_available(void);

/// @return PALPATE_OK; PALPATE_ERROR_MEMORY naming the largest block and the remedy
pal_status pal_memory_plan_check(const pal_model_info *info, pal_error *error);

#endif
