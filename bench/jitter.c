/// @file jitter.c  Bench: what the engine adds to the machine's own lateness.
///
/// The servo thread (a session with a scripted tool pressing a model of 10 000 stored nodes) and
/// `cyclictest` (rt-tests) at the same priority, on the same core, in alternating slices; first
/// with the other cores as they are, then with each loaded by a busy process that streams through
/// memory and with the session's render thread at 30 Hz. Lateness = wake-up after the deadline. The
/// figure that counts is the median of the ratios servo / cyclictest of neighbouring slices, with
/// its distribution-free 95 % interval (order statistics).
///
///     bench/jitter [--quick] [--slices N] [--seconds S]
/// (default 20 slices of 5 s each per condition, --quick 6 of 2 s); writes
/// bench/results/jitter_slices.csv, jitter_histogram.csv, jitter.png (gnuplot).
#include <math.h>
#include <sched.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <unistd.h>

#include <palpate/session.h>

#include "tests/support/synthetic_model.h"

enum {
    SLICES_MAX = 200,
    LATE_MAX = 50000,
    QUANTILES = 3,
    SIDES = 2,
    CONDITIONS = 2,
    LOADS_MAX = 64
};
static const char *const side_name[SIDES] = {"servo", "cyclictest"};
static const char *const condition_name[CONDITIONS] = {"idle", "loaded"};
static const double level[QUANTILES] = {0.5, 0.99, 0.999};

typedef struct slice {
    double us[QUANTILES], max;
    uint64_t ticks, missed;
} slice;

typedef struct distribution {
    uint64_t count[LATE_MAX + 1]; ///< by whole microseconds; the last one and above
} distribution;

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/// Quantiles of one slice's own histogram, added to the total.
static void finish_slice(const distribution *own, distribution *total, slice *s) {
    uint64_t all = 0;
    for (int k = 0; k <= LATE_MAX; k++) {
        all += own->count[k];
        total->count[k] += own->count[k];
        if (own->count[k] > 0) {
            s->max = k;
        }
    }
    s->ticks = all;
    for (int q = 0; q < QUANTILES; q++) {
        uint64_t seen = 0, want = (uint64_t)ceil(level[q] * (double)all);
        int k = 0;
        while (k < LATE_MAX && (seen += own->count[k]) < want) {
            k++;
        }
        s->us[q] = k;
    }
}

static void drop_frame(void *user, const pal_frame *frame) {
    (void)user;
    (void)frame;
}

static int servo_slice(const pal_model *model, int cpu, int loaded, double seconds,
                       distribution *own, slice *s, char *scheduling, size_t size) {
    pal_error error = {0};
    pal_session *session = NULL;
    pal_session_def def = pal_session_default_def();
    const pal_runtime_config *runtime = pal_model_runtime(model);
    double period = def.engine.period;
    def.engine.tool_count = 1;
    def.engine.tools = runtime->tools;
    def.duration = seconds;
    def.realtime = 1;
    def.cpu = cpu;
    def.priority = 80;
    def.render_rate = loaded ? 30.0 : 0.0;
    def.render = loaded ? drop_frame : NULL;
    def.ring_ticks = (int32_t)(seconds / period) + 16;
    if (pal_device_create(&runtime->tools[0], period, &def.devices[0], &error) != PALPATE_OK ||
        pal_session_create(model, &def, &session, &error) != PALPATE_OK ||
        pal_session_start(session, &error) != PALPATE_OK ||
        pal_session_finish(session, &error) != PALPATE_OK) {
        (void)fprintf(stderr, "bench/jitter: %s\n", error.message);
        pal_session_free(session);
        return -1;
    }
    pal_session_report report;
    pal_session_get_report(session, &report);
    pal_tick_record *records = malloc((size_t)def.ring_ticks * sizeof *records);
    int32_t count = records == NULL ? 0 : pal_session_ring(session, records, def.ring_ticks);
    for (int32_t k = 0; k < count; k++) {
        int64_t us = records[k].lateness_ns / 1000;
        own->count[us < 0 ? 0 : us > LATE_MAX ? LATE_MAX : us]++;
    }
    s->missed = report.missed;
    (void)snprintf(scheduling, size, "%s", report.scheduling);
    free(records);
    pal_session_free(session);
    return count > 0 ? 0 : -1;
}

static int cyclictest_slice(int cpu, double seconds, distribution *own) {
    char command[256], line[256];
    (void)snprintf(
        command, sizeof command,
        "cyclictest -q -m -p 80 -i 1000 -a %d --mainaffinity=%d -t 1 -l %.0f -h %d 2>/dev/null",
        cpu, cpu, 1000.0 * seconds, LATE_MAX);
    FILE *f = popen(command, "r");
    if (f == NULL) {
        return -1;
    }
    uint64_t all = 0;
    while (fgets(line, sizeof line, f) != NULL) {
        unsigned long us, count;
        if (sscanf(line, "%lu %lu", &us, &count) == 2 && us <= LATE_MAX) {
            own->count[us] += count;
            all += count;
        } else if (sscanf(line, "# Histogram Overflows: %lu", &count) == 1) {
            own->count[LATE_MAX] += count;
        }
    }
    (void)pclose(f);
    return all > 0 ? 0 : -1;
}

static volatile double sink;

/// A process per other core that streams through 64 MB until it is killed.
static int start_load(int servo_cpu, const cpu_set_t *allowed, pid_t *load) {
    int count = 0;
    for (int c = 0; c < CPU_SETSIZE && count < LOADS_MAX; c++) {
        if (c == servo_cpu || !CPU_ISSET(c, allowed)) {
            continue;
        }
        pid_t id = fork();
        if (id == 0) {
            cpu_set_t one;
            CPU_ZERO(&one);
            CPU_SET(c, &one);
            (void)sched_setaffinity(0, sizeof one, &one);
            size_t size = 8u << 20;
            double *v = calloc(size, sizeof *v);
            for (double sum = 0; v != NULL;) {
                for (size_t k = 0; k < size; k++) {
                    v[k] += 1.0;
                    sum += v[k];
                }
                sink = sum;
                if (getppid() == 1) {
                    break;
                }
            }
            _exit(0);
        }
        if (id > 0) {
            load[count++] = id;
        }
    }
    return count;
}

static void stop_load(pid_t *load, int count) {
    for (int k = 0; k < count; k++) {
        (void)kill(load[k], SIGKILL);
        (void)waitpid(load[k], NULL, 0);
    }
}

/// Median of n values (sorted here) and the order statistics that hold it with 95 % probability.
static void median_interval(double *v, int n, double out[3]) {
    qsort(v, (size_t)n, sizeof *v, by_value);
    double tail = pow(0.5, n), term = tail; // P(fewer than k of n below the median)
    int k = 0;
    while (k + 1 < (n + 1) / 2) {
        term *= (double)(n - k) / (double)(k + 1);
        if (tail + term > 0.025) {
            break;
        }
        tail += term;
        k++;
    }
    out[0] = n % 2 ? v[n / 2] : 0.5 * (v[n / 2 - 1] + v[n / 2]);
    out[1] = v[k];
    out[2] = v[n - 1 - k];
}

static void plot(distribution total[CONDITIONS][SIDES]) {
    FILE *csv = fopen("bench/results/jitter_histogram.csv", "w");
    if (csv == NULL) {
        return;
    }
    (void)fprintf(csv, "lateness_us,idle_servo,idle_cyclictest,loaded_servo,loaded_cyclictest\n");
    uint64_t all[4] = {0}, above[4];
    for (int k = 0; k <= LATE_MAX; k++) {
        for (int i = 0; i < 4; i++) {
            all[i] += total[i / 2][i % 2].count[k];
        }
    }
    memcpy(above, all, sizeof above);
    for (int k = 0; k <= LATE_MAX; k++) { // share of ticks later than k - 1 us
        int any = 0;
        for (int i = 0; i < 4; i++) {
            any |= total[i / 2][i % 2].count[k] != 0;
        }
        if (any) {
            (void)fprintf(csv, "%d", k);
            for (int i = 0; i < 4; i++) {
                (void)fprintf(csv, ",%.4g", all[i] ? (double)above[i] / (double)all[i] : 0.0);
            }
            (void)fprintf(csv, "\n");
        }
        for (int i = 0; i < 4; i++) {
            above[i] -= total[i / 2][i % 2].count[k];
        }
    }
    (void)fclose(csv);
    FILE *g = popen("gnuplot", "w");
    if (g == NULL) {
        return;
    }
    (void)fprintf(g, "set datafile separator ','\nset terminal pngcairo size 900,560\n"
                     "set output 'bench/results/jitter.png'\nset logscale xy\nset grid\n"
                     "set xlabel 'lateness [us]'\nset ylabel 'share of ticks at least as late'\n"
                     "set format y '10^{%%L}'\nset rmargin 6\n"
                     "plot for [c=2:5] 'bench/results/jitter_histogram.csv' using "
                     "($1+1):(column(c)>0?column(c):1/0) "
                     "with steps lw 2 title word('idle:servo idle:cyclictest loaded:servo "
                     "loaded:cyclictest', c-1)\n");
    (void)pclose(g);
}

int main(int argc, char **argv) {
    int slices = 20;
    double seconds = 5.0;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--quick") == 0) {
            slices = 6;
            seconds = 2.0;
        } else if (strcmp(argv[i], "--slices") == 0 && i + 1 < argc) {
            slices = (int)fmin(SLICES_MAX, fmax(1.0, atof(argv[++i])));
        } else if (strcmp(argv[i], "--seconds") == 0 && i + 1 < argc) {
            seconds = fmin(60.0, fmax(0.1, atof(argv[++i])));
        } else {
            (void)fprintf(stderr, "usage: %s [--quick] [--slices N] [--seconds S]\n", argv[0]);
            return 2;
        }
    }
    cpu_set_t allowed;
    if (sched_getaffinity(0, sizeof allowed, &allowed) != 0) {
        return 1;
    }
    int cpu = CPU_SETSIZE - 1;
    while (cpu > 0 && !CPU_ISSET(cpu, &allowed)) {
        cpu--;
    }
    synthetic_params params = synthetic_default_params();
    params.n = 23;
    params.layers = 17;
    params.rows = SYNTHETIC_ROWS_ALL;
    pal_model *model = synthetic_model(&params);
    static distribution total[CONDITIONS][SIDES], own;
    static slice run[CONDITIONS][SIDES][SLICES_MAX];
    char scheduling[512] = "";
    FILE *csv = fopen("bench/results/jitter_slices.csv", "w");
    if (model == NULL || csv == NULL) {
        (void)fprintf(stderr, "bench/jitter: out of memory, or run from the project's folder\n");
        return 1;
    }
    (void)fprintf(csv, "condition,side,slice,ticks,missed,p50_us,p99_us,p999_us,max_us\n");
    printf("%-7s %-5s %9s %16s %24s\n", "", "", "servo us", "cyclictest us",
           "median of slice ratios");
    for (int c = 0; c < CONDITIONS; c++) {
        pid_t load[LOADS_MAX];
        int loads = c == 1 ? start_load(cpu, &allowed, load) : 0, failed = 0;
        for (int k = 0; k < slices && !failed; k++) {
            for (int turn = 0; turn < SIDES && !failed; turn++) {
                int side = (turn + k) % 2; // each goes first in every other pair
                slice *s = &run[c][side][k];
                memset(&own, 0, sizeof own);
                failed = side == 0 ? servo_slice(model, cpu, c, seconds, &own, s, scheduling,
                                                 sizeof scheduling)
                                   : cyclictest_slice(cpu, seconds, &own);
                finish_slice(&own, &total[c][side], s);
                (void)fprintf(csv, "%s,%s,%d,%llu,%llu,%g,%g,%g,%g\n", condition_name[c],
                              side_name[side], k, (unsigned long long)s->ticks,
                              (unsigned long long)s->missed, s->us[0], s->us[1], s->us[2], s->max);
            }
        }
        stop_load(load, loads);
        if (failed) {
            (void)fprintf(
                stderr,
                "bench/jitter: a slice failed (is cyclictest of rt-tests installed, and may "
                "this user use real-time priorities?)\n");
            return 1;
        }
        for (int q = 0; q < QUANTILES; q++) {
            double ratio[SLICES_MAX], a[SLICES_MAX], b[SLICES_MAX], r[3], ma[3], mb[3];
            for (int k = 0; k < slices; k++) {
                a[k] = run[c][0][k].us[q];
                b[k] = run[c][1][k].us[q];
                ratio[k] = (a[k] + 0.5) / (b[k] + 0.5); // whole microseconds: the middle of each
            }
            median_interval(ratio, slices, r);
            median_interval(a, slices, ma);
            median_interval(b, slices, mb);
            printf("%-7s p%-5.4g %8.1f %16.1f %10.2f  [%.2f, %.2f]\n", condition_name[c],
                   100 * level[q], ma[0], mb[0], r[0], r[1], r[2]);
        }
        (void)fflush(stdout);
    }
    (void)fclose(csv);
    printf("core %d, %d slices of %g s each way; servo: %s\n", cpu, slices, seconds, scheduling);
    plot(total);
    printf("bench/results/jitter_slices.csv jitter_histogram.csv jitter.png\n");
    pal_model_free(model);
    return 0;
}
