/// @file realtime.h  What the operating system grants a thread for real time (private).
///
/// Asked for on the session's own servo thread only: SCHED_FIFO, one core, an exact timer, stack in
/// memory, denormals flushed to zero (a decaying field would otherwise cost ten times as much).
/// Locking memory concerns the process: mlockall(MCL_CURRENT) once all of the session's memory
/// exists. MCL_FUTURE is left out on purpose: it would make the host's later allocations count
/// against RLIMIT_MEMLOCK and fail. Locked pages stay locked after the session (munlockall would
/// undo the host's own locks). Whatever is refused is said in one sentence, never silently.
#ifndef PALPATE_HAPTIC_REALTIME_H
#define PALPATE_HAPTIC_REALTIME_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>

typedef struct pal_rt_request {
    int32_t want;     ///< 0: ordinary scheduling; 1: real time where granted
    int32_t cpu;      ///< core; -1: the last one the thread may use
    int32_t priority; ///< SCHED_FIFO priority, 1..99
} pal_rt_request;

/// errno of each step; 0: granted, -1: not asked for.
typedef struct pal_rt_grant {
    int32_t fifo, pin, memory, latency;
    int32_t denormals; ///< 0: flushed, otherwise this CPU's mode is not known
    int32_t cpu, priority;
    uint64_t locked_limit; ///< RLIMIT_MEMLOCK [bytes]
} pal_rt_grant;

/// Apply to the calling thread: scheduling, core, timer slack of 1 ns, stack prefault, denormals.
/// Fills fifo, pin, denormals, cpu, priority. Thread: the servo's own, before its loop.
void pal_rt_enter(const pal_rt_request *request, pal_rt_grant *grant);

/// Flush denormal results and operands to zero on this thread. @return 0 when done
int32_t pal_rt_flush_denormals(void);

/// Lock the process's present memory. Fills memory, locked_limit.
void pal_rt_lock_memory(pal_rt_grant *grant);

/// Keep the cores out of deep sleep (/dev/cpu_dma_latency, 0 us) while the descriptor returned is
/// open. Fills latency. @return descriptor or -1
int pal_rt_hold_latency(pal_rt_grant *grant);

/// 1 when everything that matters (scheduling, core, memory) was granted.
int pal_rt_granted(const pal_rt_grant *grant);

/// One sentence: what holds, what was refused and the remedy.
void pal_rt_describe(const pal_rt_request *request, const pal_rt_grant *grant, char *out,
                     size_t size);

/// CLOCK_MONOTONIC and the thread's CPU clock [ns].
int64_t pal_rt_now(void);
int64_t pal_rt_cpu_now(void);

/// Sleep until an absolute time on CLOCK_MONOTONIC [ns]; signals do not cut it short.
void pal_rt_sleep_until(int64_t deadline_ns);

#endif
