/// @file progress.c  The progress line on a terminal, and clean interruption.
#include "haptic/program/program.h"

#include <errno.h>
#include <stdio.h>
#include <string.h>
#include <time.h>
#include <unistd.h>

static volatile sig_atomic_t signal_seen = 0;
static struct timespec signal_time; // of the first one

/// Asked twice, the program goes at once; files have their names only when whole. Twice within half
/// a second is once: `timeout` and shells signal a process and then its group.
static void on_signal(int number) {
    struct timespec now;
    int saved = errno;
    (void)clock_gettime(CLOCK_MONOTONIC, &now);
    errno = saved;
    if (!signal_seen) {
        signal_time = now;
        signal_seen = number;
    } else if ((double)(now.tv_sec - signal_time.tv_sec) +
                   1e-9 * (double)(now.tv_nsec - signal_time.tv_nsec) >
               0.5) {
        _exit(128 + number);
    }
}

void interrupt_install(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_signal;
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGINT, &action, NULL);
    (void)sigaction(SIGTERM, &action, NULL);
    (void)signal(SIGXFSZ, SIG_IGN); // a file at its limit is a write that fails, as on a full disk
}

int interrupt_signal(void) {
    return signal_seen;
}

void interrupt_restore(void) {
    (void)signal(SIGINT, SIG_DFL);
    (void)signal(SIGTERM, SIG_DFL);
    if (signal_seen) {
        (void)raise(signal_seen);
    }
}

static volatile sig_atomic_t dump_seen = 0;

static void on_dump(int number) {
    (void)number;
    dump_seen = 1;
}

void dump_install(void) {
    struct sigaction action;
    memset(&action, 0, sizeof action);
    action.sa_handler = on_dump;
    (void)sigemptyset(&action.sa_mask);
    (void)sigaction(SIGUSR1, &action, NULL);
}

int dump_signal(void) {
    int seen = dump_seen;
    dump_seen = 0;
    return seen;
}

static double last_drawn = 0.0;
static int drawn = 0;

static int draw(void *user, const char *stage, double fraction, double seconds_left) {
    const common_options *options = user;
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    double now = (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
    if (!options->quiet && isatty(STDERR_FILENO) && (now - last_drawn > 0.1 || fraction < 0.0)) {
        last_drawn = now;
        drawn = 1;
        if (fraction < 0.0) {
            (void)fprintf(stderr, "\r\033[K%-9s ...", stage);
        } else if (seconds_left >= 0.0) {
            (void)fprintf(stderr, "\r\033[K%-9s %3.0f %%, %.0f s left", stage, 100.0 * fraction,
                          seconds_left);
        } else {
            (void)fprintf(stderr, "\r\033[K%-9s %3.0f %%", stage, 100.0 * fraction);
        }
        (void)fflush(stderr);
    }
    return signal_seen != 0;
}

pal_progress progress_line(const common_options *options) {
    union {
        const void *from;
        void *to;
    } user = {.from = options};
    return (pal_progress){.call = draw, .user = user.to};
}

void progress_end(void) {
    if (drawn) {
        (void)fprintf(stderr, "\r\033[K");
        (void)fflush(stderr);
        drawn = 0;
    }
}
