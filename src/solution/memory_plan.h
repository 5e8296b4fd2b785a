/// @file memory_plan.h  Will it fit? Predicted before anything large is allocated.
#ifndef PALPATE_SRC_MEMORY_PLAN_H
#define PALPATE_SRC_MEMORY_PLAN_H

#include <stdint.h>

#include <palpate/model.h>

/// Bytes of the compliance blocks the solve stage will hold.
uint64_t pal_memory_plan_blocks(const pal_model_info *info);

/// Predicted peak bytes of the solve and certificate stages for a model's counts.
uint64_t pal_memory_plan_peak(const pal_model_info *info);

/// Bytes the machine can give now (MemAvailable, and what RLIMIT_AS leaves beside what is mapped
/// and will be by OpenBLAS); 0: unknown.
uint64_t pal_memory_available(void);

/// @return PALPATE_OK; PALPATE_ERROR_MEMORY naming the largest block and the remedy
pal_status pal_memory_plan_check(const pal_model_info *info, pal_error *error);

#endif
