/// @file realtime.c  Scheduling, core, memory and floating-point mode of the servo thread.
#include "haptic/base/realtime.h"

#include <errno.h>
#include <fcntl.h>
#include <pthread.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <string.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <time.h>
#include <unistd.h>

#if defined(__x86_64__)
#include <xmmintrin.h>
#endif

/// Bytes of stack touched in advance; far above what a tick uses.
enum { STACK_PREFAULT = 128 * 1024 };

static __attribute__((noinline)) void prefault_stack(void) {
    volatile char page[STACK_PREFAULT];
    for (size_t i = 0; i < sizeof page; i += 1024) {
        page[i] = 0;
    }
    page[sizeof page - 1] = 0;
}

int32_t pal_rt_flush_denormals(void) {
#if defined(__x86_64__)
    _mm_setcsr(_mm_getcsr() | 0x8040u); // FTZ | DAZ
    return 0;
#elif defined(__aarch64__)
    uint64_t fpcr = 0;
    __asm__ volatile("mrs %0, fpcr" : "=r"(fpcr));
    __asm__ volatile("msr fpcr, %0" : : "r"(fpcr | (UINT64_C(1) << 24))); // FZ
    return 0;
#else
    return ENOTSUP;
#endif
}

static int32_t pin(const pal_rt_request *request, int32_t *cpu) {
    cpu_set_t allowed, one;
    CPU_ZERO(&allowed);
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) {
        return errno;
    }
    *cpu = request->cpu;
    for (int i = CPU_SETSIZE - 1; *cpu < 0 && i >= 0; i--) {
        if (CPU_ISSET(i, &allowed)) {
            *cpu = i;
        }
    }
    if (*cpu < 0 || *cpu >= CPU_SETSIZE) {
        return EINVAL;
    }
    CPU_ZERO(&one);
    CPU_SET(*cpu, &one);
    return sched_setaffinity(0, sizeof one, &one) != 0 ? errno : 0;
}

void pal_rt_enter(const pal_rt_request *request, pal_rt_grant *grant) {
    memset(grant, 0, sizeof *grant);
    grant->fifo = grant->pin = grant->memory = grant->latency = -1;
    grant->cpu = -1;
    grant->priority = request->priority;
    prefault_stack();
    grant->denormals = pal_rt_flush_denormals();
    // concerns ordinary scheduling only: SCHED_FIFO timers have no slack
    (void)prctl(PR_SET_TIMERSLACK, 1UL, 0UL, 0UL, 0UL);
    if (!request->want) {
        return;
    }
    grant->pin = pin(request, &grant->cpu);
    const struct sched_param param = {.sched_priority = request->priority};
    grant->fifo = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
}

void pal_rt_lock_memory(pal_rt_grant *grant) {
    struct rlimit limit = {0};
    grant->locked_limit = getrlimit(RLIMIT_MEMLOCK, &limit) == 0 ? (uint64_t)limit.rlim_cur : 0;
    grant->memory = mlockall(MCL_CURRENT) != 0 ? errno : 0;
}

int pal_rt_hold_latency(pal_rt_grant *grant) {
    int fd = open("/dev/cpu_dma_latency", O_WRONLY | O_CLOEXEC);
    const int32_t microseconds = 0;
    if (fd < 0) {
        grant->latency = errno;
        return -1;
    }
    if (write(fd, &microseconds, sizeof microseconds) != (ssize_t)sizeof microseconds) {
        grant->latency = errno != 0 ? errno : EIO;
        close(fd);
        return -1;
    }
    grant->latency = 0;
    return fd;
}

int pal_rt_granted(const pal_rt_grant *grant) {
    return grant->fifo == 0 && grant->pin == 0 && grant->memory == 0;
}

static void add(char *out, size_t size, const char *format, ...)
    __attribute__((format(printf, 3, 4)));
static void add(char *out, size_t size, const char *format, ...) {
    size_t used = strlen(out);
    va_list args;
    va_start(args, format);
    if (used < size) {
        (void)vsnprintf(out + used, size - used, format, args);
    }
    va_end(args);
}

/// strerror_r into its own buffer (strerror is not for threads).
static const char *why(int32_t code, char buffer[96]) {
    return strerror_r(code, buffer, 96);
}

void pal_rt_describe(const pal_rt_request *request, const pal_rt_grant *grant, char *out,
                     size_t size) {
    char buffer[96];
    if (size == 0) {
        return;
    }
    out[0] = 0;
    const char *denormals =
        grant->denormals == 0 ? "denormals flushed" : "denormals not flushed (unknown CPU)";
    if (!request->want) {
        add(out, size, "ordinary scheduling, as asked for; %s", denormals);
        return;
    }
    if (grant->fifo == 0) {
        add(out, size, "SCHED_FIFO priority %d", (int)grant->priority);
    } else {
        add(out, size,
            "ordinary scheduling: SCHED_FIFO priority %d was refused (%s), raise RLIMIT_RTPRIO "
            "(rtprio in /etc/security/limits.conf) or grant CAP_SYS_NICE",
            (int)grant->priority, why(grant->fifo, buffer));
    }
    if (grant->pin == 0) {
        add(out, size, "; pinned to core %d", (int)grant->cpu);
    } else {
        add(out, size, "; not pinned to core %d (%s), name a core the process may use",
            (int)grant->cpu, why(grant->pin, buffer));
    }
    if (grant->memory == 0) {
        add(out, size, "; memory locked");
    } else {
        add(out, size,
            "; memory not locked (%s, limit %llu KiB), raise RLIMIT_MEMLOCK (memlock in "
            "/etc/security/limits.conf)",
            why(grant->memory, buffer), (unsigned long long)(grant->locked_limit / 1024));
    }
    if (grant->latency == 0) {
        add(out, size, "; deep sleep of the cores held off");
    }
    add(out, size, "; %s", denormals);
}

int64_t pal_rt_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

int64_t pal_rt_cpu_now(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

void pal_rt_sleep_until(int64_t deadline_ns) {
    const struct timespec t = {.tv_sec = (time_t)(deadline_ns / 1000000000),
                               .tv_nsec = (long)(deadline_ns % 1000000000)};
    while (clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &t, NULL) == EINTR) {
    }
}
