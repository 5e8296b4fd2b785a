/// @file mesher_client.c  The library's end of the conversation with palpate-mesher.
///
/// One socket pair is the child's standard input and output (a socket, because send() can refuse to
/// raise SIGPIPE when the child dies: the library never touches a host's signals), one pipe its
/// standard error. A single poll loop writes, reads and reports progress, so neither side can block
/// the other. The child is always reaped. Thread: any; each call has its own process.
#include "src/mesher_client.h"

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
#include <unistd.h>

#include "haptic/error.h"
#include "src/mesher/protocol.h"

extern char **environ;

enum { POLL_MS = 100, LOG_SIZE = 400 };

typedef struct talk {
    pid_t child;
    int channel, log; ///< socket to the child; read end of its standard error
    char line[256];   ///< the line of standard error being read
    size_t line_length;
    char last[LOG_SIZE]; ///< last line that was not progress
    double fraction;
} talk;

void pal_mesh_fill_clear(pal_mesh_fill *fill) {
    free(fill->inside);
    free(fill->tet);
    memset(fill, 0, sizeof *fill);
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

static int try_beside(char *file, char *path, size_t size) {
    static const char *const place[] = {"/palpate-mesher", "/../palpate-mesher",
                                        "/../libexec/palpate/palpate-mesher",
                                        "/../../libexec/palpate/palpate-mesher",
                                        "/../../palpate-mesher"};
    if (!directory_of(file)) {
        return 0;
    }
    for (size_t i = 0; i < sizeof place / sizeof place[0]; i++) {
        if (try_path(file, place[i], path, size)) {
            return 1;
        }
    }
    return 0;
}

pal_status pal_mesher_path(char *path, size_t size, pal_error *error) {
    const char *named = getenv("PALPATE_MESHER");
    if (named != NULL && named[0]) {
        if (try_path(named, "", path, size)) {
            return PALPATE_OK;
        }
        return pal_fail(error, PALPATE_ERROR_SYSTEM,
                        "PALPATE_MESHER: %s is not an executable file; unset it or name palpate-mesher",
                        named);
    }
    char file[1024];
    static const char anchor = 0; // lies in this library or program
    Dl_info info;
    if (dladdr(&anchor, &info) != 0 && info.dli_fname != NULL) {
        (void)snprintf(file, sizeof file, "%s", info.dli_fname);
        if (try_beside(file, path, size)) {
            return PALPATE_OK;
        }
    }
    ssize_t n = readlink("/proc/self/exe", file, sizeof file - 1);
    if (n > 0) {
        file[n] = 0;
        if (try_beside(file, path, size)) {
            return PALPATE_OK;
        }
    }
    return pal_fail(error, PALPATE_ERROR_SYSTEM,
                    "palpate-mesher: not found beside the library or the program nor in "
                    "../libexec/palpate; install it or set PALPATE_MESHER to its path");
}

static pal_status start(talk *t, pal_error *error) {
    char path[1024];
    pal_status status = pal_mesher_path(path, sizeof path, error);
    if (status != PALPATE_OK) {
        return status;
    }
    int pair[2] = {-1, -1}, log[2] = {-1, -1};
    posix_spawn_file_actions_t actions;
    int failed = 0;
    if (socketpair(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0, pair) != 0 || pipe2(log, O_CLOEXEC) != 0 ||
        posix_spawn_file_actions_init(&actions) != 0) {
        failed = errno ? errno : ENOMEM;
    } else {
        failed = posix_spawn_file_actions_adddup2(&actions, pair[1], STDIN_FILENO);
        failed = failed ? failed : posix_spawn_file_actions_adddup2(&actions, pair[1], STDOUT_FILENO);
        failed = failed ? failed : posix_spawn_file_actions_adddup2(&actions, log[1], STDERR_FILENO);
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

/// Close, end the child if it still runs, reap it. @return its wait status
static int finish(talk *t, int kill_it) {
    int state = 0;
    (void)close(t->channel);
    if (t->log >= 0) {
        (void)close(t->log);
    }
    if (kill_it) {
        (void)kill(t->child, SIGKILL);
    }
    while (waitpid(t->child, &state, 0) < 0 && errno == EINTR) {
    }
    return state;
}

static void take_line(talk *t) {
    t->line[t->line_length] = 0;
    double f;
    if (sscanf(t->line, "progress %lf", &f) == 1) {
        t->fraction = f;
    } else if (t->line_length > 0) {
        (void)snprintf(t->last, sizeof t->last, "%s", t->line);
    }
    t->line_length = 0;
}

static void read_log(talk *t) {
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

/// Move `size` bytes: out of `from` (sending) or into `to` (receiving), whichever is not NULL.
static pal_status transfer(talk *t, const char *from, char *to, size_t size,
                           const pal_progress *progress, pal_error *error) {
    size_t done = 0;
    while (done < size) {
        struct pollfd watch[2] = {{t->channel, from != NULL ? POLLOUT : POLLIN, 0},
                                  {t->log, POLLIN, 0}};
        int ready = poll(watch, t->log >= 0 ? 2 : 1, POLL_MS);
        if (ready < 0 && errno != EINTR) {
            return pal_fail(error, PALPATE_ERROR_SYSTEM, "palpate-mesher: poll: %s", strerror(errno));
        }
        if (ready > 0 && t->log >= 0 && watch[1].revents) {
            read_log(t);
        }
        if (progress != NULL && progress->call != NULL &&
            progress->call(progress->user, "cloud", 0.2 + 0.75 * t->fraction, -1.0) != 0) {
            return pal_fail(error, PALPATE_ERROR_CANCELLED, "cloud: cancelled while filling the body");
        }
        if (ready > 0 && watch[0].revents) {
            ssize_t n = from != NULL
                            ? send(t->channel, from + done, size - done, MSG_NOSIGNAL | MSG_DONTWAIT)
                            : recv(t->channel, to + done, size - done, MSG_DONTWAIT);
            if (n > 0) {
                done += (size_t)n;
            } else if (n == 0 || (errno != EINTR && errno != EAGAIN)) {
                return PALPATE_ERROR_CLOUD; // the child is gone: the caller says how
            }
        }
    }
    return PALPATE_OK;
}

static pal_status check_reply(const pal_mesher_reply *reply, pal_error *error) {
    if (reply->magic != PALPATE_MESHER_MAGIC || reply->version != PALPATE_MESHER_VERSION ||
        reply->size != sizeof *reply) {
        return pal_fail(error, PALPATE_ERROR_CLOUD,
                        "palpate-mesher: its answer is not of version %d: library and mesher must come "
                        "from the same build",
                        PALPATE_MESHER_VERSION);
    }
    if (reply->status != 0) {
        return pal_fail(error, PALPATE_ERROR_CLOUD,
                        "palpate-mesher: %.*s; try another body.spacing or check the surface",
                        (int)sizeof reply->message - 1, reply->message);
    }
    if (reply->inside_count < 0 || reply->inside_count > PALPATE_MESHER_COUNT_MAX ||
        reply->tet_count < 1 || reply->tet_count > PALPATE_MESHER_COUNT_MAX) {
        return pal_fail(error, PALPATE_ERROR_CLOUD, "palpate-mesher: it answers %d nodes, %d cells",
                        reply->inside_count, reply->tet_count);
    }
    return PALPATE_OK;
}

/// The whole exchange on a running child.
static pal_status converse(talk *t, const pal_mesher_request *head, const double *x,
                           const int32_t *triangle, const pal_mesher_source *source,
                           const pal_progress *progress, pal_mesh_fill *out, pal_error *error) {
    size_t n = (size_t)head->vertex_count, m = (size_t)head->triangle_count;
    pal_mesher_reply reply = {0};
    const struct {
        const void *data;
        size_t size;
    } part[4] = {{head, sizeof *head},
                 {x, 3 * n * sizeof *x},
                 {triangle, 3 * m * sizeof *triangle},
                 {source, (size_t)head->source_count * sizeof *source}};
    for (int i = 0; i < 4; i++) {
        pal_status status = transfer(t, part[i].data, NULL, part[i].size, progress, error);
        if (status == PALPATE_ERROR_CLOUD) {
            break; // it may have answered before it left, e.g. that it is of another version
        }
        if (status != PALPATE_OK) {
            return status;
        }
    }
    pal_status status = transfer(t, NULL, (char *)&reply, sizeof reply, progress, error);
    if (status == PALPATE_OK) {
        status = check_reply(&reply, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    out->inside_count = reply.inside_count;
    out->tet_count = reply.tet_count;
    out->inside = malloc((3 * (size_t)reply.inside_count + 1) * sizeof *out->inside);
    out->tet = calloc(4 * (size_t)reply.tet_count + 1, sizeof *out->tet);
    if (out->inside == NULL || out->tet == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for %d cells", reply.tet_count);
    }
    status = transfer(t, NULL, (char *)out->inside,
                      3 * (size_t)reply.inside_count * sizeof *out->inside, progress, error);
    if (status == PALPATE_OK) {
        status = transfer(t, NULL, (char *)out->tet, 4 * (size_t)reply.tet_count * sizeof *out->tet,
                          progress, error);
    }
    for (size_t i = 0; status == PALPATE_OK && i < 4 * (size_t)out->tet_count; i++) {
        if (out->tet[i] < 0 || out->tet[i] >= head->vertex_count + out->inside_count) {
            status = pal_fail(error, PALPATE_ERROR_CLOUD, "palpate-mesher: a cell names node %d",
                              out->tet[i]);
        }
    }
    return status;
}

pal_status pal_mesher_fill(const double *x, int32_t vertex_count, const int32_t *triangle,
                           int32_t triangle_count, const pal_size_field *size,
                           const pal_progress *progress, pal_mesh_fill *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    pal_mesher_source *source = malloc(((size_t)size->count + 1) * sizeof *source);
    if (source == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for the spacing field");
    }
    for (int32_t i = 0; i < size->count; i++) {
        const pal_size_source *s = size->source + i;
        memcpy(source[i].a, s->a, sizeof s->a);
        memcpy(source[i].b, s->b, sizeof s->b);
        source[i].radius = s->radius;
        source[i].spacing = s->spacing;
    }
    pal_mesher_request head = {.magic = PALPATE_MESHER_MAGIC,
                               .version = PALPATE_MESHER_VERSION,
                               .size = sizeof head,
                               .vertex_count = vertex_count,
                               .triangle_count = triangle_count,
                               .source_count = size->count,
                               .cap = size->cap,
                               .grading = size->grading};
    talk t = {.child = -1, .channel = -1, .log = -1};
    pal_status status = start(&t, error);
    if (status == PALPATE_OK) {
        pal_error said = {0};
        status = converse(&t, &head, x, triangle, source, progress, out, &said);
        int state = finish(&t, status != PALPATE_OK && status != PALPATE_ERROR_CLOUD);
        if (status == PALPATE_ERROR_CLOUD && said.message[0] == 0) {
            char how[64];
            if (WIFSIGNALED(state)) {
                (void)snprintf(how, sizeof how, "signal %d", WTERMSIG(state));
            } else {
                (void)snprintf(how, sizeof how, "exit status %d", WEXITSTATUS(state));
            }
            (void)pal_fail(&said, status, "palpate-mesher: it ended in the middle of its work (%s)%s%s",
                           how, t.last[0] ? ": " : "", t.last);
        }
        if (status != PALPATE_OK) {
            (void)pal_fail(error, status, "%s", said.message);
        }
    }
    free(source);
    if (status != PALPATE_OK) {
        pal_mesh_fill_clear(out);
    }
    return status;
}
