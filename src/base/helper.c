/// @file helper.c  Starting a helper process, talking with it, reaping it.
///
/// One socket pair is the child's standard input and output (a socket, because send() can refuse to
/// raise SIGPIPE when the child dies: the library never touches a host's signals), one pipe its
/// standard error. A single poll loop writes, reads and reports progress, so neither side can block
/// the other. The child is always reaped. Thread: any; each call has its own process.
#include "src/base/helper.h"

#include <dlfcn.h>
#include <errno.h>
#include <fcntl.h>
#include <poll.h>
#include <signal.h>
#include <spawn.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include "haptic/base/error.h"

extern char **environ;

enum { POLL_MS = 100, RECEIVE_FIRST = 1 << 20 };

static int64_t now_ns(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_MONOTONIC, &t);
    return (int64_t)t.tv_sec * 1000000000 + t.tv_nsec;
}

/// Is DIR/NAME an executable? Leaves it in path.
static int try_path(const char *dir, const char *rest, char *path, size_t size) {
    int n = snprintf(path, size, "%s%s", dir, rest);
    return n > 0 && (size_t)n < size && access(path, X_OK) == 0;
}

/// Cut a file's name off its path.
static int directory_of(char *file) {
    char *slash = strrchr(file, '/');
    if (slash == NULL) {
        return 0;
    }
    *slash = 0;
    return 1;
}

static int try_beside(char *file, const char *name, char *path, size_t size) {
    static const char *const place[] = {"/", "/../", "/../libexec/palpate/",
                                        "/../../libexec/palpate/", "/../../"};
    if (!directory_of(file)) {
        return 0;
    }
    for (size_t i = 0; i < sizeof place / sizeof place[0]; i++) {
        char rest[128];
        (void)snprintf(rest, sizeof rest, "%s%s", place[i], name);
        if (try_path(file, rest, path, size)) {
            return 1;
        }
    }
    return 0;
}

pal_status pal_helper_path(const pal_helper_kind *kind, char *path, size_t size, pal_error *error) {
    const char *named = getenv(kind->variable);
    if (named != NULL && named[0]) {
        if (try_path(named, "", path, size)) {
            return PALPATE_OK;
        }
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "%s: %s is not an executable file; unset it or name %s", kind->variable,
                        named, kind->name);
    }
    char file[1024];
    static const char anchor = 0; // lies in this library or program
    Dl_info info;
    if (dladdr(&anchor, &info) != 0 && info.dli_fname != NULL) {
        (void)snprintf(file, sizeof file, "%s", info.dli_fname);
        if (try_beside(file, kind->name, path, size)) {
            return PALPATE_OK;
        }
    }
    ssize_t n = readlink("/proc/self/exe", file, sizeof file - 1);
    if (n > 0) {
        file[n] = 0;
        if (try_beside(file, kind->name, path, size)) {
            return PALPATE_OK;
        }
    }
    return pal_fail(
        error, PALPATE_ERROR_SYSTEM,
        "%s: not found beside the library or the program nor in ../libexec/palpate; install "
        "it or set %s to its path",
        kind->name, kind->variable);
}

pal_status pal_helper_start(pal_helper *t, const pal_helper_kind *kind, int file, int seconds,
                            pal_error *error) {
    *t = (pal_helper){.kind = kind, .child = -1, .channel = -1, .log = -1};
    t->deadline_ns = seconds > 0 ? now_ns() + 1000000000 * (int64_t)seconds : INT64_MAX;
    t->seconds = seconds;
    char path[1024];
    pal_status status = pal_helper_path(kind, path, sizeof path, error);
    if (status != PALPATE_OK) {
        return status;
    }
    int pair[2] = {-1, -1}, log[2] = {-1, -1};
    posix_spawn_file_actions_t actions;
    int failed = 0;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0 ||
        pipe2(log, O_CLOEXEC) != 0 || posix_spawn_file_actions_init(&actions) != 0) {
        failed = errno ? errno : ENOMEM;
    } else {
        failed = posix_spawn_file_actions_adddup2(&actions, pair[1], STDIN_FILENO);
        failed =
            failed ? failed : posix_spawn_file_actions_adddup2(&actions, pair[1], STDOUT_FILENO);
        failed =
            failed ? failed : posix_spawn_file_actions_adddup2(&actions, log[1], STDERR_FILENO);
        if (file >= 0) { // last: the others may not be in its place any more
            failed = failed ? failed
                            : posix_spawn_file_actions_adddup2(&actions, file, PALPATE_HELPER_FILE);
        }
        char *argv[] = {path, NULL};
        failed = failed ? failed : posix_spawn(&t->child, path, &actions, NULL, argv, environ);
        (void)posix_spawn_file_actions_destroy(&actions);
    }
    if (pair[1] >= 0) {
        (void)close(pair[1]);
    }
    if (log[1] >= 0) {
        (void)close(log[1]);
    }
    if (failed) {
        if (pair[0] >= 0) {
            (void)close(pair[0]);
        }
        if (log[0] >= 0) {
            (void)close(log[0]);
        }
        return pal_fail(error, PALPATE_ERROR_SYSTEM, "%s: could not be started: %s", path,
                        strerror(failed));
    }
    t->channel = pair[0];
    t->log = log[0];
    return PALPATE_OK;
}

int pal_helper_finish(pal_helper *t, int kill_it) {
    int state = 0;
    if (t->channel >= 0) {
        (void)close(t->channel);
    }
    if (t->log >= 0) {
        (void)close(t->log);
    }
    t->channel = t->log = -1;
    if (t->child > 0) { // none in a test that speaks for it
        if (kill_it) {
            (void)kill(t->child, SIGKILL);
        }
        while (waitpid(t->child, &state, 0) < 0 && errno == EINTR) {
        }
    }
    t->child = -1;
    return state;
}

void pal_helper_fate(const pal_helper *t, int state, char *text, size_t size) {
    (void)snprintf(text, size, "%s: it ended in the middle of its work (%s %d)%s%s", t->kind->name,
                   WIFSIGNALED(state) ? "signal" : "exit status",
                   WIFSIGNALED(state) ? WTERMSIG(state) : WEXITSTATUS(state),
                   t->last[0] ? ": " : "", t->last);
}

void pal_helper_printable(char *text, size_t size) {
    text[size - 1] = 0;
    for (; *text != 0; text++) {
        if ((unsigned char)*text < ' ' || *text == 127) {
            *text = '?';
        }
    }
}

static void take_line(pal_helper *t) {
    t->line[t->line_length] = 0;
    double f;
    if (sscanf(t->line, "progress %lf", &f) == 1) {
        t->fraction = f;
    } else if (t->line_length > 0) {
        (void)snprintf(t->last, sizeof t->last, "%s", t->line);
        pal_helper_printable(t->last, sizeof t->last);
    }
    t->line_length = 0;
}

static void read_log(pal_helper *t) {
    char text[512];
    ssize_t n = read(t->log, text, sizeof text);
    if (n == 0 || (n < 0 && errno != EINTR && errno != EAGAIN)) {
        (void)close(t->log);
        t->log = -1;
        return;
    }
    for (ssize_t i = 0; i < n; i++) {
        if (text[i] == '\n') {
            take_line(t);
        } else if (t->line_length + 1 < sizeof t->line) {
            t->line[t->line_length++] = text[i];
        }
    }
}

/// What the child still said when its end of the channel closed.
static void drain_log(pal_helper *t) {
    struct pollfd watch = {t->log, POLLIN, 0};
    while (t->log >= 0 && poll(&watch, 1, POLL_MS) > 0) {
        read_log(t);
    }
    if (t->line_length > 0) {
        take_line(t);
    }
}

/// Has the time come to give it up? Says so.
static pal_status late(const pal_helper *t, pal_error *error) {
    return now_ns() < t->deadline_ns
               ? PALPATE_OK
               : pal_fail(error, PALPATE_ERROR_SYSTEM, "%s: it took more than %d s and was ended",
                          t->kind->name, t->seconds);
}

pal_status pal_helper_transfer(pal_helper *t, const void *from, void *to, size_t size,
                               const pal_progress *progress, pal_error *error) {
    size_t done = 0;
    while (done < size) {
        struct pollfd watch[2] = {{t->channel, from != NULL ? POLLOUT : POLLIN, 0},
                                  {t->log, POLLIN, 0}};
        int ready = poll(watch, t->log >= 0 ? 2 : 1, POLL_MS);
        if (ready < 0 && errno != EINTR) {
            return pal_fail(error, PALPATE_ERROR_SYSTEM, "%s: poll: %s", t->kind->name,
                            strerror(errno));
        }
        if (ready > 0 && t->log >= 0 && watch[1].revents) {
            read_log(t);
        }
        if (progress != NULL && progress->call != NULL &&
            progress->call(progress->user, "cloud", 0.2 + 0.75 * t->fraction, -1.0) != 0) {
            return pal_fail(error, PALPATE_ERROR_CANCELLED,
                            "cloud: cancelled while filling the body");
        }
        pal_status status = late(t, error);
        if (status != PALPATE_OK) {
            return status;
        }
        if (ready > 0 && watch[0].revents) {
            ssize_t n = from != NULL
                            ? send(t->channel, (const char *)from + done, size - done,
                                   MSG_NOSIGNAL | MSG_DONTWAIT)
                            : recv(t->channel, (char *)to + done, size - done, MSG_DONTWAIT);
            if (n > 0) {
                done += (size_t)n;
            } else if (n == 0 || (errno != EINTR && errno != EAGAIN)) {
                drain_log(t);
                return PALPATE_ERROR_TRUNCATED; // the child is gone: the caller says how
            }
        }
    }
    return PALPATE_OK;
}

pal_status pal_helper_receive(pal_helper *h, size_t size, const pal_progress *progress, void **data,
                              pal_error *error) {
    size_t done = 0, room = size < RECEIVE_FIRST ? size : RECEIVE_FIRST;
    char *all = malloc(room + 1);
    pal_status status = PALPATE_OK;
    *data = NULL;
    while (all != NULL && status == PALPATE_OK && done < size) {
        if (done == room) {
            room = room < size / 2 ? 2 * room : size;
            char *larger = realloc(all, room + 1);
            if (larger == NULL) {
                free(all);
            }
            all = larger;
        }
        if (all != NULL) {
            status = pal_helper_transfer(h, NULL, all + done, room - done, progress, error);
            done = room;
        }
    }
    if (all == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory for its answer of %zu bytes",
                        h->kind->name, size);
    }
    if (status != PALPATE_OK) {
        free(all);
        return status;
    }
    *data = all;
    return PALPATE_OK;
}
