/// @file doctor.c  Real-time readiness of the machine: what was found, and the remedy.
#include "haptic/session/doctor.h"

#include <errno.h>
#include <pthread.h>
#include <sched.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/utsname.h>
#include <time.h>

/// Checks write here one after the other.
typedef struct doctor {
    const char *root;
    pal_check *out;
    int32_t count;
} doctor;

static pal_check *begin(doctor *d, const char *name) {
    pal_check *c = &d->out[d->count++];
    memset(c, 0, sizeof *c);
    (void)snprintf(c->name, sizeof c->name, "%s", name);
    return c;
}

static void verdict(pal_check *c, pal_check_state state, const char *remedy) {
    c->state = state;
    (void)snprintf(c->remedy, sizeof c->remedy, "%s", state == PALPATE_CHECK_OK ? "" : remedy);
}

static void found(pal_check *c, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void found(pal_check *c, const char *format, ...) {
    va_list args;
    va_start(args, format);
    (void)vsnprintf(c->found, sizeof c->found, format, args);
    va_end(args);
}

/// First bytes of a file below the root, newline stripped. @return 1 when it could be read
static int slurp(const doctor *d, const char *path, char *out, size_t size) {
    char full[512];
    out[0] = 0;
    (void)snprintf(full, sizeof full, "%s%s", d->root, path);
    FILE *file = fopen(full, "re");
    if (file == NULL) {
        return 0;
    }
    size_t n = fread(out, 1, size - 1, file);
    out[n] = 0;
    (void)fclose(file);
    while (n > 0 && (out[n - 1] == '\n' || out[n - 1] == ' ')) {
        out[--n] = 0;
    }
    return 1;
}

static void check_kernel(doctor *d) {
    char realtime[16], version[256];
    pal_check *c = begin(d, "kernel");
    (void)slurp(d, "/proc/sys/kernel/version", version, sizeof version);
    int rt = (slurp(d, "/sys/kernel/realtime", realtime, sizeof realtime) && realtime[0] == '1') ||
             strstr(version, "PREEMPT_RT") != NULL;
    const char *model = rt                                           ? "PREEMPT_RT"
                        : strstr(version, "PREEMPT_DYNAMIC") != NULL ? "PREEMPT_DYNAMIC"
                        : strstr(version, "PREEMPT") != NULL         ? "PREEMPT"
                                                                     : "no preemption";
    struct utsname u;
    found(c, "%s, %s", uname(&u) == 0 ? u.release : "unknown", model);
    verdict(c, rt ? PALPATE_CHECK_OK : PALPATE_CHECK_WARN,
            strstr(version, "PREEMPT_DYNAMIC") != NULL
                ? "boot with preempt=full, or install a PREEMPT_RT kernel: apt-get install "
                  "linux-image-rt-amd64"
                : "install a PREEMPT_RT kernel: apt-get install linux-image-rt-amd64");
}

static void *try_fifo(void *arg) {
    const struct sched_param param = {.sched_priority = 80};
    *(int *)arg = pthread_setschedparam(pthread_self(), SCHED_FIFO, &param);
    return NULL;
}

static void check_scheduling(doctor *d) {
    pal_check *c = begin(d, "scheduling");
    pthread_t thread;
    int result = EAGAIN;
    struct rlimit limit = {0};
    (void)getrlimit(RLIMIT_RTPRIO, &limit);
    if (pthread_create(&thread, NULL, try_fifo, &result) == 0) {
        pthread_join(thread, NULL);
    }
    char text[96];
    found(c, "SCHED_FIFO priority 80 %s%s, RLIMIT_RTPRIO %llu",
          result == 0 ? "granted" : "refused: ",
          result == 0 ? "" : strerror_r(result, text, sizeof text),
          (unsigned long long)limit.rlim_cur);
    verdict(
        c, result == 0 ? PALPATE_CHECK_OK : PALPATE_CHECK_FAIL,
        "add '@audio - rtprio 95' (or your user) to /etc/security/limits.conf and log in again, or "
        "setcap cap_sys_nice+ep on the program");
}

static void check_memory(doctor *d) {
    pal_check *c = begin(d, "memory lock");
    struct rlimit limit = {0};
    (void)getrlimit(RLIMIT_MEMLOCK, &limit);
    // CAP_IPC_LOCK (bit 14) lifts the limit
    char status[4096];
    unsigned long long capabilities = 0;
    const char *at =
        slurp(d, "/proc/self/status", status, sizeof status) ? strstr(status, "CapEff:") : NULL;
    if (at != NULL) {
        capabilities = strtoull(at + 7, NULL, 16);
    }
    int capable = (capabilities >> 14) & 1;
    int enough = capable || limit.rlim_cur == RLIM_INFINITY || limit.rlim_cur >= (rlim_t)1 << 30;
    if (limit.rlim_cur == RLIM_INFINITY) {
        found(c, "RLIMIT_MEMLOCK unlimited");
    } else {
        found(c, "RLIMIT_MEMLOCK %llu KiB%s", (unsigned long long)(limit.rlim_cur / 1024),
              capable ? ", lifted by CAP_IPC_LOCK" : "");
    }
    verdict(c, enough ? PALPATE_CHECK_OK : PALPATE_CHECK_FAIL,
            "add '@audio - memlock unlimited' (or your user) to /etc/security/limits.conf and log "
            "in again");
}

static void check_cores(doctor *d) {
    pal_check *c = begin(d, "cores");
    cpu_set_t set;
    CPU_ZERO(&set);
    int cores = sched_getaffinity(0, sizeof set, &set) == 0 ? CPU_COUNT(&set) : 1;
    found(c, "%d usable", cores);
    verdict(c, cores >= 2 ? PALPATE_CHECK_OK : PALPATE_CHECK_FAIL,
            "give the process 2 cores or more: one for the servo, one for picture and recorder");
}

static void check_isolation(doctor *d) {
    pal_check *c = begin(d, "isolated cores");
    char text[128];
    int have = slurp(d, "/sys/devices/system/cpu/isolated", text, sizeof text) && text[0] != 0;
    found(c, "%s", have ? text : "none");
    verdict(c, have ? PALPATE_CHECK_OK : PALPATE_CHECK_WARN,
            "boot with isolcpus=N nohz_full=N rcu_nocbs=N for the servo's core N (the last one)");
}

static void check_governor(doctor *d) {
    pal_check *c = begin(d, "governor");
    char text[64], path[96];
    int seen = 0, slow = 0;
    for (int cpu = 0; cpu < 1024; cpu++) {
        (void)snprintf(path, sizeof path, "/sys/devices/system/cpu/cpu%d/cpufreq/scaling_governor",
                       cpu);
        char one[64];
        if (!slurp(d, path, one, sizeof one)) {
            if (cpu > 0) {
                break;
            }
            continue;
        }
        seen++;
        if (slow == 0) {
            memcpy(text, one, sizeof text);
        }
        slow += strcmp(one, "performance") != 0;
    }
    if (seen == 0) {
        found(c, "no frequency scaling visible");
    } else {
        found(c, "%s on %d of %d cores", text, slow > 0 ? slow : seen, seen);
    }
    verdict(c, slow == 0 ? PALPATE_CHECK_OK : PALPATE_CHECK_WARN,
            "cpupower frequency-set -g performance");
}

static void check_clock(doctor *d) {
    pal_check *c = begin(d, "clock source");
    char text[64];
    struct timespec resolution = {0};
    (void)clock_getres(CLOCK_MONOTONIC, &resolution);
    int known = slurp(d, "/sys/devices/system/clocksource/clocksource0/current_clocksource", text,
                      sizeof text);
    int fast = !known || strcmp(text, "tsc") == 0 || strcmp(text, "kvm-clock") == 0 ||
               strcmp(text, "arch_sys_counter") == 0 ||
               strcmp(text, "hyperv_clocksource_tsc_page") == 0;
    int fine = resolution.tv_sec == 0 && resolution.tv_nsec <= 1000;
    found(c, "%s, resolution %lld ns", known ? text : "unknown", (long long)resolution.tv_nsec);
    verdict(
        c, fast && fine ? PALPATE_CHECK_OK : PALPATE_CHECK_WARN,
        fine ? "boot with clocksource=tsc tsc=reliable: reading this clock is a slow device access"
             : "use a kernel with high-resolution timers (CONFIG_HIGH_RES_TIMERS)");
}

static void check_throttling(doctor *d) {
    pal_check *c = begin(d, "real-time throttling");
    char runtime[32], period[32];
    long long r = -1, p = 1000000;
    if (slurp(d, "/proc/sys/kernel/sched_rt_runtime_us", runtime, sizeof runtime)) {
        r = strtoll(runtime, NULL, 10);
    }
    if (slurp(d, "/proc/sys/kernel/sched_rt_period_us", period, sizeof period)) {
        p = strtoll(period, NULL, 10);
    }
    if (r < 0) {
        found(c, "off");
    } else {
        found(c, "%lld of %lld us for real-time threads", r, p);
    }
    // a 1 kHz servo sleeps most of each period; below half of the time it would be cut
    verdict(c, r < 0 || 2 * r >= p ? PALPATE_CHECK_OK : PALPATE_CHECK_WARN,
            "sysctl -w kernel.sched_rt_runtime_us=950000");
}

static void check_timer_slack(doctor *d) {
    pal_check *c = begin(d, "timer slack");
    char text[32];
    int known = slurp(d, "/proc/self/timerslack_ns", text, sizeof text);
    long long slack = known ? strtoll(text, NULL, 10) : 50000;
    found(c, "%lld ns; the servo thread sets its own to 1 ns", slack);
    verdict(c, slack <= 1000000 ? PALPATE_CHECK_OK : PALPATE_CHECK_WARN,
            "start from a shell with the default timer slack (50000 ns)");
}

static void check_huge_pages(doctor *d) {
    pal_check *c = begin(d, "transparent huge pages");
    char enabled[64], defrag[64];
    int known = slurp(d, "/sys/kernel/mm/transparent_hugepage/enabled", enabled, sizeof enabled);
    (void)slurp(d, "/sys/kernel/mm/transparent_hugepage/defrag", defrag, sizeof defrag);
    int stalls = known && strstr(enabled, "[always]") != NULL && strstr(defrag, "[always]") != NULL;
    found(c, "enabled %s, defrag %s", known ? enabled : "unknown",
          defrag[0] != 0 ? defrag : "unknown");
    verdict(c, stalls ? PALPATE_CHECK_WARN : PALPATE_CHECK_OK,
            "echo madvise > /sys/kernel/mm/transparent_hugepage/defrag: compaction stalls threads");
}

static void check_virtual(doctor *d) {
    pal_check *c = begin(d, "virtual machine");
    char text[8192], product[128];
    // the flag is in the first processor's block, which is within the first kilobytes
    int guest = slurp(d, "/proc/cpuinfo", text, sizeof text) && strstr(text, " hypervisor") != NULL;
    int named =
        slurp(d, "/sys/class/dmi/id/product_name", product, sizeof product) && product[0] != 0;
    int container =
        strstr(slurp(d, "/proc/1/cgroup", text, sizeof text) ? text : "", "docker") != NULL;
    found(c, "%s%s%s%s", guest ? "yes" : "no", guest && named ? ", " : "",
          guest && named ? product : "", container ? ", in a container" : "");
    verdict(c, guest ? PALPATE_CHECK_WARN : PALPATE_CHECK_OK,
            "run on the hardware itself: a host that takes a core away makes periods missed "
            "whatever the "
            "guest does");
}

static void check_swap(doctor *d) {
    pal_check *c = begin(d, "swap");
    char text[2048];
    // one header line, then a line per area
    int areas = 0;
    if (slurp(d, "/proc/swaps", text, sizeof text)) {
        for (const char *p = text; (p = strchr(p, '\n')) != NULL; p++) {
            areas++;
        }
    }
    found(c, "%d area%s", areas, areas == 1 ? "" : "s");
    verdict(c, areas == 0 ? PALPATE_CHECK_OK : PALPATE_CHECK_WARN,
            "swapoff -a, or make sure that memory can be locked (above)");
}

int32_t pal_doctor(const char *root, pal_check out[PALPATE_CHECKS_MAX]) {
    doctor d = {.root = root != NULL ? root : "", .out = out};
    check_kernel(&d);
    check_scheduling(&d);
    check_memory(&d);
    check_cores(&d);
    check_isolation(&d);
    check_governor(&d);
    check_clock(&d);
    check_throttling(&d);
    check_timer_slack(&d);
    check_huge_pages(&d);
    check_swap(&d);
    check_virtual(&d);
    return d.count;
}

pal_check_state pal_doctor_worst(const pal_check check[], int32_t count) {
    pal_check_state worst = PALPATE_CHECK_OK;
    for (int32_t i = 0; i < count; i++) {
        worst = check[i].state > worst ? check[i].state : worst;
    }
    return worst;
}

const char *pal_check_state_name(pal_check_state state) {
    static const char *const name[] = {"ok", "warn", "fail"};
    return (unsigned)state <= PALPATE_CHECK_FAIL ? name[state] : "unknown";
}
