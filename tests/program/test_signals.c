/// The fault table (tests/README.md), row of signals: SIGINT, SIGTERM and SIGSTOP/SIGCONT in every
/// phase of a precomputation, and in a run that is recorded. The phases are read off the progress
/// line, so the program runs on a pseudo terminal.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <dirent.h>
#include <errno.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "tests/support/program.h"

static char folder[64], cache[96], model_path[96], record_path[96], scene[256];

static int set_up(void **state) {
    (void)state;
    (void)snprintf(folder, sizeof folder, "/tmp/palpate-signals-XXXXXX");
    // processes that the program leaves behind become ours, and are seen
    if (mkdtemp(folder) == NULL || prctl(PR_SET_CHILD_SUBREAPER, 1UL, 0UL, 0UL, 0UL) != 0) {
        return 1;
    }
    (void)snprintf(cache, sizeof cache, "%s/cache", folder);
    (void)snprintf(model_path, sizeof model_path, "%s/m.palpate", folder);
    (void)snprintf(record_path, sizeof record_path, "%s/r.h5", folder);
    (void)snprintf(scene, sizeof scene, "%s/scenes/hemisphere.yaml", program_source());
    return 0;
}

static int tear_down(void **state) {
    (void)state;
    char command[128];
    (void)snprintf(command, sizeof command, "rm -rf %s", folder);
    return system(command); // NOLINT(cert-env33-c): our own folder
}

static void pause_ms(int ms) {
    const struct timespec t = {.tv_sec = ms / 1000, .tv_nsec = 1000000L * (ms % 1000)};
    (void)nanosleep(&t, NULL);
}

// ---- A program on a terminal
// ----------------------------------------------------------------------

typedef struct child {
    pid_t pid;
    int fd;
    char text[1 << 16]; ///< all it has written
    size_t size;
    int status;
} child;

static void start(child *c, const char *const argv[]) {
    memset(c, 0, sizeof *c);
    c->pid = forkpty(&c->fd, NULL, NULL, NULL);
    assert_true(c->pid >= 0);
    if (c->pid == 0) {
        const char *program = getenv("PALPATE") != NULL ? getenv("PALPATE") : "build/palpate";
        (void)setenv("PALPATE_CACHE", cache, 1);
        (void)execv(program, (char *const *)(uintptr_t)argv);
        _exit(99);
    }
}

/// Read what is there. @return 0 once the terminal is closed
static int take(child *c, int ms) {
    struct pollfd p = {.fd = c->fd, .events = POLLIN};
    if (poll(&p, 1, ms) <= 0) {
        return 1;
    }
    if (c->size > sizeof c->text - 4096) { // keep the newest
        memmove(c->text, c->text + 8192, c->size -= 8192);
    }
    ssize_t n = read(c->fd, c->text + c->size, sizeof c->text - 1 - c->size);
    if (n <= 0) {
        return n < 0 && errno == EINTR;
    }
    c->size += (size_t)n;
    c->text[c->size] = 0;
    return 1;
}

/// Wait until it has written `word`. @return 0 when it ended without
static int await(child *c, const char *word) {
    while (strstr(c->text, word) == NULL) {
        if (!take(c, 100)) {
            return strstr(c->text, word) != NULL;
        }
    }
    return 1;
}

/// Read to the end and wait for it. @return exit status, 128 + signal
static int end(child *c) {
    while (take(c, 100)) {
    }
    assert_int_equal(waitpid(c->pid, &c->status, 0), c->pid);
    close(c->fd);
    return WIFEXITED(c->status) ? WEXITSTATUS(c->status) : 128 + WTERMSIG(c->status);
}

/// Nothing of the program lives on: not the mesher either.
static void expect_no_orphans(void) {
    for (int i = 0; i < 6000; i++) { // a minute: only a failure waits that long
        if (waitpid(-1, NULL, WNOHANG) < 0) {
            assert_int_equal(errno, ECHILD);
            return;
        }
        pause_ms(10);
    }
    fail_msg("a process of the program lives on");
}

/// Entries of the cache directory, hidden ones included.
static int cache_entries(void) {
    int n = 0;
    DIR *d = opendir(cache);
    for (struct dirent *e; d != NULL && (e = readdir(d)) != NULL;) {
        n += strcmp(e->d_name, ".") != 0 && strcmp(e->d_name, "..") != 0;
    }
    if (d != NULL) {
        (void)closedir(d);
    }
    return n;
}

static void remove_all(void) {
    char command[256];
    (void)snprintf(command, sizeof command, "rm -rf %s %s", cache, model_path);
    assert_int_equal(system(command), 0); // NOLINT(cert-env33-c): our own folder
}

static void expect_good_model(const char *path) {
    char arguments[160];
    (void)snprintf(arguments, sizeof arguments, "info %s --json", path);
    program_result r = program_run(arguments);
    assert_int_equal(r.status, 0);
    assert_true(program_number(r.json, "certificate.pass") == 1.0);
    program_clear(&r);
}

// ---- Precompute
// -------------------------------------------------------------------------------------

static const char *const phases[] = {"cloud", "assemble", "factor", "solve", "certify", "write"};
enum { PHASES = sizeof phases / sizeof *phases };

static void start_precompute(child *c) {
    const char *const argv[] = {"palpate",
                                "precompute",
                                scene,
                                "-o",
                                model_path,
                                "--set",
                                "estimate=false",
                                "--set",
                                "body.patches.pole.rim_spacing=0.0014",
                                "--set",
                                "body.refine=[]",
                                NULL};
    start(c, argv);
}

static void a_precompute_told_to_end_leaves_nothing_half_made(void **state) {
    (void)state;
    static const int signals[] = {SIGINT, SIGTERM};
    int interrupted = 0;
    for (int s = 0; s < 2; s++) {
        for (int p = 0; p < PHASES; p++) {
            remove_all();
            child c;
            start_precompute(&c);
            int reached = await(&c, phases[p]);
            assert_true(reached ||
                        strcmp(phases[p], "solve") == 0); // solving may be too quick to be shown
            (void)kill(c.pid, signals[s]);
            int status = end(&c);
            expect_no_orphans();
            if (status == 128 + signals[s]) {
                interrupted++;
                assert_int_equal(cache_entries(), 0);
                assert_int_equal(access(model_path, F_OK), -1);
            } else if (status == 0) { // it was faster: then everything is there
                assert_int_equal(cache_entries(), 1);
                expect_good_model(model_path);
            } else {
                fail_msg("%s at %s: exit %d: %s", strsignal(signals[s]), phases[p], status, c.text);
            }
        }
    }
    assert_true(interrupted >= 8); // of 12: all but the last phases
}

static void a_precompute_that_is_stopped_goes_on(void **state) {
    (void)state;
    remove_all();
    child c;
    start_precompute(&c);
    for (int p = 0; p < PHASES; p++) {
        (void)await(&c, phases[p]);
        (void)kill(c.pid, SIGSTOP);
        pause_ms(120);
        (void)kill(c.pid, SIGCONT);
    }
    assert_int_equal(end(&c), 0);
    expect_no_orphans();
    assert_int_equal(cache_entries(), 1);
    expect_good_model(model_path);
}

// ---- Run and record
// -----------------------------------------------------------------------------------

static int is_there(const char *suffix) {
    char name[160];
    (void)snprintf(name, sizeof name, "%s%s", record_path, suffix);
    return access(name, F_OK) == 0;
}

static void start_run(child *c) {
    char command[200];
    (void)snprintf(command, sizeof command, "rm -f %s*", record_path);
    assert_int_equal(system(command), 0); // NOLINT(cert-env33-c): our own folder
    const char *const argv[] = {"palpate",   "run",      model_path,  "--for",         "3600",
                                "--no-draw", "--record", record_path, "--no-realtime", NULL};
    start(c, argv);
    for (int i = 0; i < 6000; i++) { // records beyond the header are on disk; minutes when starved
        char name[160];
        struct stat st;
        (void)snprintf(name, sizeof name, "%s.ticks", record_path);
        if (stat(name, &st) == 0 && st.st_size > 60000) {
            return;
        }
        (void)take(c, 50);
    }
    fail_msg("the run does not start: %s", c->text);
}

/// Differences of a replay on the model.
static double differences(void) {
    char arguments[256];
    (void)snprintf(arguments, sizeof arguments, "replay %s --model %s --json", record_path,
                   model_path);
    program_result r = program_run(arguments);
    double n = r.status <= 1 ? program_number(r.json, "differences") : -1.0;
    program_clear(&r);
    return n;
}

static void a_recorded_run_told_to_end_ends_in_order(void **state) {
    (void)state;
    static const int signals[] = {SIGINT, SIGTERM};
    for (int s = 0; s < 2; s++) {
        child c;
        start_run(&c);
        (void)kill(c.pid, SIGSTOP); // and stopped meanwhile
        pause_ms(150);
        (void)kill(c.pid, SIGCONT);
        pause_ms(50);
        (void)kill(c.pid, signals[s]);
        assert_int_equal(end(&c), 128 + signals[s]);
        assert_true(is_there("") && !is_there(".ticks") && !is_there(".frames") &&
                    !is_there(".part"));
        assert_true(differences() == 0.0);
    }
}

/// Asked twice it leaves at once; what was recorded is there, or can be recovered.
static void asked_twice_it_leaves_and_loses_nothing(void **state) {
    (void)state;
    child c;
    start_run(&c);
    (void)kill(c.pid, SIGINT);
    pause_ms(2);
    (void)kill(c.pid, SIGTERM);
    int status = end(&c);
    assert_true(status == 128 + SIGTERM || status == 128 + SIGINT);
    if (is_there(".ticks")) {
        char arguments[160];
        (void)snprintf(arguments, sizeof arguments, "recover %s --json", record_path);
        program_result r = program_run(arguments);
        assert_int_equal(r.status, 0);
        assert_true(program_number(r.json, "records") >= 100.0);
        program_clear(&r);
    }
    assert_true(is_there("") && !is_there(".ticks") && differences() == 0.0);
}

/// The model's file is removed, then another one is put there, while a session runs on it.
static void a_run_does_not_need_its_model_file_any_more(void **state) {
    (void)state;
    char kept[160], command[400];
    (void)snprintf(kept, sizeof kept, "%s.kept", model_path);
    (void)snprintf(command, sizeof command, "cp %s %s", model_path, kept);
    assert_int_equal(system(command), 0); // NOLINT(cert-env33-c): our own folder
    child c;
    start_run(&c);
    assert_int_equal(truncate(model_path, 5000), 0);
    pause_ms(100);
    assert_int_equal(unlink(model_path), 0);
    pause_ms(100);
    FILE *f = fopen(model_path, "w");
    assert_non_null(f);
    (void)fputs("something else", f);
    (void)fclose(f);
    pause_ms(100);
    (void)kill(c.pid, SIGINT);
    assert_int_equal(end(&c), 128 + SIGINT);
    assert_int_equal(rename(kept, model_path), 0);
    assert_true(differences() == 0.0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_precompute_told_to_end_leaves_nothing_half_made),
        cmocka_unit_test(a_precompute_that_is_stopped_goes_on),
        cmocka_unit_test(a_recorded_run_told_to_end_ends_in_order),
        cmocka_unit_test(asked_twice_it_leaves_and_loses_nothing),
        cmocka_unit_test(a_run_does_not_need_its_model_file_any_more),
    };
    return cmocka_run_group_tests(tests, set_up, tear_down);
}
