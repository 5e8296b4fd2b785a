/// Surface files from strangers: what kills, stalls or bloats the importer is an error that names
/// the file, and a reader that lies is not believed.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <fcntl.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/geometry/reader_client.h"
#include "tests/support/surfaces.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

static void refused(const char *path, pal_status status, const char *const *words) {
    pal_surface s = {0};
    pal_error e = {0};
    assert_int_equal(pal_surface_read(path, &s, &e), status);
    for (; *words != NULL; words++) {
        if (strstr(e.message, *words) == NULL) {
            fail_msg("message '%s' lacks '%s'", e.message, *words);
        }
    }
    assert_null(s.x);
    assert_null(s.v);
}
#define REFUSED(path, status, ...) refused(path, status, (const char *const[]){__VA_ARGS__, NULL})

/// Found by fuzzing: libassimp 5.2.5 counts the faces of a polygon with "03" differently twice and
/// calls abort().
static const char ABORTS[] = "ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\n"
                             "property float y\nproperty float z\nelement face 1\n"
                             "property list uchar int vertex_indices\nend_header\n"
                             "0 0 0\n1 0 0\n0 1 03\n 0 1 2\n";

static void an_importer_that_aborts_is_an_error_with_the_file(void **state) {
    (void)state;
    char path[64];
    test_surface_text(ABORTS, "ply", path);
    REFUSED(path, PALPATE_ERROR_IO, path, "not a readable surface", "palpate-reader", "damaged");
    (void)unlink(path);
}

static int opened(const char *text, const char *extension, int64_t *size) {
    char path[64];
    struct stat found;
    test_surface_text(text, extension, path);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    assert_true(fd > 2);
    assert_int_equal(fstat(fd, &found), 0);
    *size = found.st_size;
    (void)unlink(path);
    return fd;
}

static void an_endless_import_is_ended(void **state) {
    (void)state;
    // a header without an end keeps Assimp busy for ever; pal_surface_read looks for it first
    int64_t size;
    int fd = opened("ply\nformat ascii 1.0\nelement vertex 3\n", "ply", &size);
    const pal_reader_limits limits = {(int64_t)1 << 30, 1, 100};
    pal_surface s = {0};
    pal_error e = {0};
    assert_int_equal(pal_reader_import(fd, size, PALPATE_READER_PLY, 0, &limits, &s, &e),
                     PALPATE_ERROR_IO);
    // either it runs out of memory or of time: both limits are there
    if (strstr(e.message, "signal 24") == NULL && strstr(e.message, "signal 9") == NULL &&
        strstr(e.message, "signal 6") == NULL) {
        fail_msg("%s", e.message);
    }
    (void)close(fd);
}

static void memory_is_bounded(void **state) {
    (void)state;
    if (SANITIZED) {
        skip(); // their shadow memory cannot be limited
    }
    // an honest file, but 100 kB for it: the limit is felt
    test_surface t;
    char path[64];
    test_surface_sphere(&t, 4, 1.0);
    test_surface_write(&t, "stlb", path);
    int fd = open(path, O_RDONLY | O_CLOEXEC);
    struct stat found;
    assert_true(fd > 2 && fstat(fd, &found) == 0);
    pal_surface s = {0};
    pal_error e = {0};
    const pal_reader_limits little = {100000, 10, 100};
    pal_status status =
        pal_reader_import(fd, found.st_size, PALPATE_READER_STL, 0, &little, &s, &e);
    if (status != PALPATE_ERROR_IO && status != PALPATE_ERROR_MEMORY) {
        fail_msg("%d: %s", status, e.message);
    }
    assert_null(s.x);
    assert_int_equal(lseek(fd, 0, SEEK_SET), 0);
    const pal_reader_limits enough = pal_reader_default_limits(found.st_size);
    assert_int_equal(pal_reader_import(fd, found.st_size, PALPATE_READER_STL, 0, &enough, &s, &e),
                     PALPATE_OK);
    pal_surface_clear(&s);
    // a header that announces 2 000 000 000 vertices, past the look at the header
    (void)close(fd);
    (void)unlink(path);
    int64_t size;
    fd =
        opened("ply\nformat binary_little_endian 1.0\nelement vertex 2000000000\nproperty float x\n"
               "property float y\nproperty float z\nend_header\n0123456789",
               "ply", &size);
    assert_int_equal(pal_reader_import(fd, size, PALPATE_READER_PLY, 0, &enough, &s, &e),
                     PALPATE_ERROR_IO);
    (void)close(fd);
}

static void files_that_lie_about_their_size_are_refused(void **state) {
    (void)state;
    char path[64];
    test_surface_text("ply\nformat ascii 1.0\nelement vertex 4000000000\nend_header\n", "ply",
                      path);
    REFUSED(path, PALPATE_ERROR_IO, path, "announces more elements than the file can hold");
    (void)unlink(path);
    test_surface_text("v 0 0 0\n", "obj", path);
    REFUSED(path, PALPATE_ERROR_IO, path);
    assert_int_equal(truncate(path, PALPATE_READER_FILE_MAX + 1), 0); // a sparse file
    REFUSED(path, PALPATE_ERROR_IO, path, "larger than 1 GiB");
    (void)unlink(path);
    char pipe_path[80], folder[80];
    (void)snprintf(pipe_path, sizeof pipe_path, "%s.stl", path);
    assert_int_equal(mkfifo(pipe_path, 0600), 0); // nobody writes: opening it must not wait
    REFUSED(pipe_path, PALPATE_ERROR_IO, pipe_path, "not a regular file");
    (void)unlink(pipe_path);
    (void)snprintf(folder, sizeof folder, "%s.obj", path);
    assert_int_equal(mkdir(folder, 0700), 0);
    REFUSED(folder, PALPATE_ERROR_IO, folder, "not a regular file");
    (void)rmdir(folder);
}

/// A shell script in place of the reader.
static void with_reader(const char *body, const char *file, pal_status status, const char *words) {
    char path[] = "/tmp/palpate-fake-XXXXXX";
    int fd = mkstemp(path);
    assert_true(fd >= 0);
    assert_true(dprintf(fd, "#!/bin/sh\n%s\n", body) > 0);
    assert_int_equal(fchmod(fd, 0700), 0);
    assert_int_equal(close(fd), 0);
    assert_int_equal(setenv("PALPATE_READER", path, 1), 0);
    REFUSED(file, status, file, words);
    assert_int_equal(unsetenv("PALPATE_READER"), 0);
    (void)unlink(path);
}

static void a_reader_that_fails_is_an_error_with_the_file(void **state) {
    (void)state;
    char path[64];
    test_surface_text("solid nothing\nendsolid\n", "stl", path);
    with_reader("exit 0", path, PALPATE_ERROR_IO, "exit status 0");
    with_reader("kill -11 $$", path, PALPATE_ERROR_IO, "signal 11");
    with_reader("printf 'last \\033[31mwords\\n' >&2; exit 7", path, PALPATE_ERROR_IO,
                "(exit status 7): last ?[31mwords");
    with_reader("cat >/dev/null & head -c 4096 /dev/zero; exit 0", path, PALPATE_ERROR_SYSTEM,
                "same build");
    assert_int_equal(setenv("PALPATE_READER", "/nonexistent/reader", 1), 0);
    REFUSED(path, PALPATE_ERROR_SYSTEM, path, "PALPATE_READER: /nonexistent/reader");
    // one that hangs is ended after the time given
    char script[] = "/tmp/palpate-fake-XXXXXX";
    int fd = mkstemp(script);
    assert_true(fd >= 0 && dprintf(fd, "#!/bin/sh\nexec sleep 1000\n") > 0);
    assert_int_equal(fchmod(fd, 0700), 0);
    assert_int_equal(close(fd), 0);
    assert_int_equal(setenv("PALPATE_READER", script, 1), 0);
    const pal_reader_limits limits = {1 << 20, 1, 1};
    pal_surface s = {0};
    pal_error e = {0};
    fd = open(path, O_RDONLY | O_CLOEXEC);
    assert_int_equal(pal_reader_import(fd, 10, PALPATE_READER_STL, 0, &limits, &s, &e),
                     PALPATE_ERROR_SYSTEM);
    assert_non_null(strstr(e.message, "took more than 1 s"));
    (void)close(fd);
    assert_int_equal(unsetenv("PALPATE_READER"), 0);
    (void)unlink(script);
    (void)unlink(path);
}

/// What the library makes of an answer.
static pal_status hear(const pal_reader_reply *reply, const double *x, size_t nx, const int32_t *v,
                       size_t nv, pal_error *e) {
    static const pal_helper_kind nobody = {"palpate-reader", "NOBODY"};
    int pair[2];
    assert_int_equal(socketpair(AF_UNIX, SOCK_STREAM, 0, pair), 0);
    pal_helper h = {
        .kind = &nobody, .child = -1, .channel = pair[0], .log = -1, .deadline_ns = INT64_MAX};
    const pal_reader_request request = {.magic = PALPATE_READER_MAGIC, .file_bytes = 1000};
    assert_int_equal(write(pair[1], reply, sizeof *reply), (ssize_t)sizeof *reply);
    assert_int_equal(write(pair[1], x, nx * sizeof *x), (ssize_t)(nx * sizeof *x));
    assert_int_equal(write(pair[1], v, nv * sizeof *v), (ssize_t)(nv * sizeof *v));
    assert_int_equal(shutdown(pair[1], SHUT_WR), 0);
    pal_surface s = {0};
    *e = (pal_error){0};
    pal_status status = pal_reader_converse(&h, &request, &s, e);
    pal_surface_clear(&s);
    (void)pal_helper_finish(&h, 0);
    (void)close(pair[1]);
    return status;
}

static void a_lying_answer_is_not_believed(void **state) {
    (void)state;
    const pal_reader_reply good = {.magic = PALPATE_READER_MAGIC,
                                   .version = PALPATE_READER_VERSION,
                                   .size = sizeof good,
                                   .vertex_count = 3,
                                   .triangle_count = 1};
    const double x[9] = {0, 0, 0, 1, 0, 0, 0, 1, 0};
    const int32_t v[3] = {0, 1, 2};
    pal_error e;
    assert_int_equal(hear(&good, x, 9, v, 3, &e), PALPATE_OK);
    assert_int_equal(hear(&good, x, 9, v, 2, &e), PALPATE_ERROR_TRUNCATED);
    assert_int_equal(hear(&good, x, 7, v, 0, &e), PALPATE_ERROR_TRUNCATED);
    pal_reader_reply r = good;
    r.vertex_count = 1001; // more than the file has bytes
    assert_int_equal(hear(&r, x, 9, v, 3, &e), PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "1001 vertices"));
    r = good;
    r.triangle_count = -1;
    assert_int_equal(hear(&r, x, 9, v, 3, &e), PALPATE_ERROR_IO);
    const double far[9] = {0, 0, 0, 1, 0, 0, 0, HUGE_VAL, 0};
    assert_int_equal(hear(&good, far, 9, v, 3, &e), PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "vertex 2"));
    const int32_t wild[3] = {0, 1, 3};
    assert_int_equal(hear(&good, x, 9, wild, 3, &e), PALPATE_ERROR_IO);
    assert_non_null(strstr(e.message, "names vertex 3 of 3"));
    r = good;
    r.verdict = 77; // unknown: a refusal, its text made printable and ended
    memset(r.message, '\n', sizeof r.message);
    assert_int_equal(hear(&r, x, 0, v, 0, &e), PALPATE_ERROR_IO);
    assert_int_equal(strlen(e.message), sizeof r.message - 1);
    assert_int_equal(strspn(e.message, "?"), sizeof r.message - 1);
    r.verdict = PALPATE_READER_NO_MEMORY;
    assert_int_equal(hear(&r, x, 0, v, 0, &e), PALPATE_ERROR_MEMORY);
}

/// The definition, in n^2 steps: in the order of x (then number), each vertex joins the first that
/// is near and stands for itself.
static void twins_by_definition(const pal_surface *s, const int32_t *order, double reach,
                                int32_t *same) {
    for (int32_t i = 0; i < s->vertex_count; i++) {
        const double *a = s->x + 3 * order[i];
        same[order[i]] = order[i];
        for (int32_t j = 0; j < i; j++) {
            const double *b = s->x + 3 * order[j];
            double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
            if (same[order[j]] == order[j] &&
                sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]) <= reach) {
                same[order[i]] = order[j];
                break;
            }
        }
    }
}

static void twins_are_those_of_the_definition(void **state) {
    (void)state;
    enum { N = 600 };
    double x[3 * N];
    int32_t order[N], same[N], wanted[N];
    uint64_t seed = 12345;
    for (int round = 0; round < 40; round++) {
        // clusters whose size is about the reach, so that chains and cell borders matter
        for (int i = 0; i < 3 * N; i++) {
            seed = seed * 6364136223846793005u + 1442695040888963407u;
            double u = (double)(seed >> 11) / 9007199254740992.0;
            double grain = floor(u * 5.0) / 4.0, fine = u * 1e3 - floor(u * 1e3);
            x[i] = round % 4 == 0 && i % 3 == 0 ? 0.5 : grain + 4e-6 * fine; // all in one plane
        }
        memcpy(x, (const double[3]){0, 0, 0}, 3 * sizeof *x);
        memcpy(x + 3, (const double[3]){2, 2, 2}, 3 * sizeof *x); // the extent is 2 exactly
        pal_surface s = {.vertex_count = N, .x = x};
        for (int i = 0; i < N; i++) { // insertion sort by (x, number)
            int at = i;
            while (at > 0 && x[3 * order[at - 1]] > x[3 * i]) {
                order[at] = order[at - 1];
                at--;
            }
            order[at] = i;
        }
        twins_by_definition(&s, order, 2e-6, wanted);
        assert_int_equal(pal_surface_twins(&s, same, NULL), PALPATE_OK);
        assert_memory_equal(same, wanted, sizeof same);
        int joined = 0;
        for (int i = 0; i < N; i++) {
            joined += same[i] != i;
        }
        assert_true(joined > 20 && joined < N - 20); // the case is one
    }
}

static void a_million_corners_in_one_plane_are_welded(void **state) {
    (void)state;
    // quadratic welding would take an hour here; the run's time limit would end it
    enum { SIDE = 500 };
    pal_surface s = {.vertex_count = 4 * SIDE * SIDE, .triangle_count = 2 * SIDE * SIDE};
    s.x = calloc(3 * (size_t)s.vertex_count, sizeof *s.x);
    s.v = calloc(3 * (size_t)s.triangle_count, sizeof *s.v);
    assert_non_null(s.x);
    assert_non_null(s.v);
    for (int32_t q = 0; q < SIDE * SIDE; q++) {
        for (int32_t k = 0; k < 4; k++) { // x stays 0
            s.x[3 * (4 * q + k) + 1] = (q % SIDE + (k == 1 || k == 2)) / (double)SIDE;
            s.x[3 * (4 * q + k) + 2] = (q / SIDE + (k >= 2)) / (double)SIDE;
        }
        const int32_t v[6] = {4 * q, 4 * q + 1, 4 * q + 2, 4 * q, 4 * q + 2, 4 * q + 3};
        memcpy(s.v + 6 * q, v, sizeof v);
    }
    assert_int_equal(pal_surface_weld(&s, NULL), PALPATE_OK);
    assert_int_equal(s.vertex_count, (SIDE + 1) * (SIDE + 1));
    pal_surface_clear(&s);
    // no extent: all at one place
    double one[9] = {3, 3, 3, 3, 3, 3, 3, 3, 3};
    int32_t same[3];
    pal_surface point = {.vertex_count = 3, .x = one};
    assert_int_equal(pal_surface_twins(&point, same, NULL), PALPATE_OK);
    assert_true(same[0] == 0 && same[1] == 0 && same[2] == 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(an_importer_that_aborts_is_an_error_with_the_file),
        cmocka_unit_test(an_endless_import_is_ended),
        cmocka_unit_test(memory_is_bounded),
        cmocka_unit_test(files_that_lie_about_their_size_are_refused),
        cmocka_unit_test(a_reader_that_fails_is_an_error_with_the_file),
        cmocka_unit_test(a_lying_answer_is_not_believed),
        cmocka_unit_test(twins_are_those_of_the_definition),
        cmocka_unit_test(a_million_corners_in_one_plane_are_welded),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
