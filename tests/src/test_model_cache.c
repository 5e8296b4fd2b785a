/// The model cache: where it is, whom it trusts, what it leaves behind.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include "haptic/model/model.h"
#include "src/store/model_cache.h"
#include "tests/support/synthetic_model.h"

#include <palpate/precompute.h>

static char root[64];

static int setup(void **state) {
    (void)state;
    (void)snprintf(root, sizeof root, "/tmp/palpate-cache-XXXXXX");
    return mkdtemp(root) == NULL ? -1 : unsetenv("PALPATE_CACHE") | unsetenv("XDG_CACHE_HOME");
}

static int teardown(void **state) {
    (void)state;
    char command[100];
    (void)snprintf(command, sizeof command, "rm -rf '%s'", root);
    return system(command);
}

static const char *in_root(const char *name) {
    static char path[4][512];
    static int next;
    next = (next + 1) % 4;
    (void)snprintf(path[next], sizeof path[next], "%s%s", root, name);
    return path[next];
}

static int mode_of(const char *path) {
    struct stat st;
    assert_int_equal(lstat(path, &st), 0);
    return (int)(st.st_mode & 07777);
}

static void the_environment_says_where(void **state) {
    (void)state;
    char path[512];
    pal_error error = {0};
    assert_int_equal(setenv("HOME", root, 1), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_OK);
    assert_string_equal(path, in_root("/.cache/palpate"));
    assert_int_equal(mode_of(path), 0700);
    assert_int_equal(mode_of(in_root("/.cache")), 0700);

    assert_int_equal(setenv("XDG_CACHE_HOME", "relative", 1), 0); // to be ignored
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_OK);
    assert_string_equal(path, in_root("/.cache/palpate"));
    assert_int_equal(setenv("XDG_CACHE_HOME", in_root("/xdg/deep"), 1), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_OK);
    assert_string_equal(path, in_root("/xdg/deep/palpate"));

    assert_int_equal(setenv("PALPATE_CACHE", in_root("/own///"), 1), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_OK);
    assert_string_equal(path, in_root("/own"));
    assert_int_equal(mode_of(path), 0700);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_OK); // again: exists
    assert_int_equal(pal_cache_directory(path, 5, &error), PALPATE_ERROR_ARGUMENT);
    assert_non_null(strstr(error.message, "PALPATE_CACHE"));
}

static void directories_others_could_write_are_refused(void **state) {
    (void)state;
    char path[512];
    pal_error error = {0};
    assert_int_equal(mkdir(in_root("/real"), 0700), 0);
    assert_int_equal(symlink(in_root("/real"), in_root("/link")), 0);
    assert_int_equal(setenv("PALPATE_CACHE", in_root("/link"), 1), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_ERROR_SYSTEM);
    assert_non_null(strstr(error.message, "symbolic link"));
    assert_int_equal(setenv("PALPATE_CACHE", in_root("/link/"), 1), 0); // the slash must not help
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_ERROR_SYSTEM);

    assert_int_equal(setenv("PALPATE_CACHE", in_root("/real"), 1), 0);
    assert_int_equal(chmod(in_root("/real"), 0770), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_ERROR_SYSTEM);
    assert_non_null(strstr(error.message, "written by others"));
    assert_int_equal(chmod(in_root("/real"), 0755), 0); // others may look
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_OK);

    int fd = open(in_root("/file"), O_CREAT | O_WRONLY, 0600);
    assert_true(fd >= 0 && close(fd) == 0);
    assert_int_equal(setenv("PALPATE_CACHE", in_root("/file"), 1), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_ERROR_SYSTEM);
    assert_non_null(strstr(error.message, "not a directory"));
    assert_int_equal(setenv("PALPATE_CACHE", in_root("/file/below"), 1), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_ERROR_IO);
    assert_int_equal(setenv("PALPATE_CACHE", "/proc/none/below", 1), 0);
    assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_ERROR_IO);

    if (geteuid() == 0) {
        assert_int_equal(chown(in_root("/real"), 12345, 12345), 0);
        assert_int_equal(setenv("PALPATE_CACHE", in_root("/real"), 1), 0);
        assert_int_equal(pal_cache_directory(path, sizeof path, &error), PALPATE_ERROR_SYSTEM);
        assert_non_null(strstr(error.message, "another user"));
    }
}

static pal_model *build(char digit) {
    synthetic_params p = synthetic_default_params();
    p.n = 3;
    pal_model *m = synthetic_model(&p);
    assert_non_null(m);
    memset(m->info.hash, digit, 64);
    return m;
}

static void models_come_back_and_strange_files_do_not(void **state) {
    (void)state;
    pal_model *a = build('a'), *b;
    pal_error error = {0};
    const char *path = in_root("/a.palpate");
    assert_int_equal(pal_cache_load(path, a->info.hash, &b, &error), PALPATE_ERROR_IO);
    mode_t mask = umask(0);
    assert_int_equal(pal_cache_save(a, path, &error), PALPATE_OK);
    (void)umask(mask);
    assert_int_equal(mode_of(path), 0600);
    assert_int_equal(pal_cache_load(path, a->info.hash, &b, &error), PALPATE_OK);
    assert_string_equal(b->info.hash, a->info.hash);
    pal_model_free(b);
    assert_int_equal(pal_cache_load(path, "other", &b, &error), PALPATE_STALE);
    assert_null(b);
    assert_int_equal(chmod(path, 0620), 0);
    assert_int_equal(pal_cache_load(path, a->info.hash, &b, &error), PALPATE_ERROR_IO);
    assert_non_null(strstr(error.message, "trusted"));
    assert_int_equal(chmod(path, 0600), 0);
    assert_int_equal(symlink(path, in_root("/l.palpate")), 0);
    assert_int_equal(pal_cache_load(in_root("/l.palpate"), a->info.hash, &b, &error),
                     PALPATE_ERROR_IO);
    pal_model_free(a);
}

/// What a recording names is found by its hash; what is no hash never becomes a path.
static void models_are_found_by_their_hash(void **state) {
    (void)state;
    pal_model *a = build('b'), *b = NULL;
    pal_error error = {0};
    char path[600];
    assert_int_equal(setenv("PALPATE_CACHE", in_root("/cache"), 1), 0);
    assert_int_equal(pal_cache_find(a->info.hash, &b, &error), PALPATE_ERROR_IO);
    assert_null(b);
    (void)snprintf(path, sizeof path, "%s/%s.palpate", in_root("/cache"), a->info.hash);
    assert_int_equal(pal_cache_save(a, path, &error), PALPATE_OK);
    assert_int_equal(pal_cache_find(a->info.hash, &b, &error), PALPATE_OK);
    assert_string_equal(b->info.hash, a->info.hash);
    pal_model_free(b);
    static const char *const bad[] = {
        "", "b", "../../../../../../../../../../../../../../../../../../../etc/passwd/",
        "BBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBBB",
        "bbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbbb"};
    for (size_t i = 0; i < sizeof bad / sizeof *bad; i++) {
        assert_int_equal(pal_cache_find(bad[i], &b, &error), PALPATE_ERROR_ARGUMENT);
    }
    assert_int_equal(pal_cache_find(NULL, &b, &error), PALPATE_ERROR_ARGUMENT);
    pal_model_free(a);
}

static void old_leftovers_are_removed_new_ones_kept(void **state) {
    (void)state;
    const char *old = in_root("/.x.palpate.0123456789abcdef0123.tmp");
    const char *new = in_root("/.y.palpate.0123456789abcdef0123.tmp");
    const char *other = in_root("/.something-else-of-the-user-here.tmp");
    const char *names[] = {old, new, other};
    for (int i = 0; i < 3; i++) {
        int fd = open(names[i], O_CREAT | O_WRONLY, 0600);
        assert_true(fd >= 0 && close(fd) == 0);
        if (i != 1) {
            struct timespec t[2] = {{.tv_sec = 1000000000}, {.tv_sec = 1000000000}};
            assert_int_equal(utimensat(AT_FDCWD, names[i], t, 0), 0);
        }
    }
    pal_model *a = build('b');
    char path[200];
    (void)snprintf(path, sizeof path, "%s/b.palpate", root);
    assert_int_equal(pal_cache_save(a, path, NULL), PALPATE_OK);
    assert_int_not_equal(access(names[0], F_OK), 0);
    assert_int_equal(access(names[1], F_OK), 0);
    assert_int_equal(access(names[2], F_OK), 0);
    pal_model_free(a);
}

/// Two builders of the same model at once: one good file, nothing else.
static void two_builders_end_with_one_file(void **state) {
    (void)state;
    pal_model *a = build('c'), *b;
    char path[200], command[300];
    (void)snprintf(path, sizeof path, "%s/c.palpate", root);
    pid_t child[2];
    for (int k = 0; k < 2; k++) {
        child[k] = fork();
        if (child[k] == 0) {
            int ok = 1;
            for (int i = 0; i < 5; i++) {
                ok = ok && pal_cache_save(a, path, NULL) == PALPATE_OK;
            }
            _exit(!ok);
        }
    }
    for (int k = 0; k < 2; k++) {
        int status;
        assert_int_equal(waitpid(child[k], &status, 0), child[k]);
        assert_int_equal(status, 0);
    }
    assert_int_equal(pal_cache_load(path, a->info.hash, &b, NULL), PALPATE_OK);
    pal_model_free(a), pal_model_free(b);
    (void)snprintf(command, sizeof command, "test $(ls -A '%s' | wc -l) = 1", root);
    assert_int_equal(system(command), 0);
}

static void scenes_have_a_path(void **state) {
    (void)state;
    char scene_path[200], path[512], hash[65];
    pal_error error = {0};
    (void)snprintf(scene_path, sizeof scene_path, "%s/s.yaml", root);
    FILE *f = fopen(scene_path, "w");
    assert_non_null(f);
    (void)fputs("palpate: 1\nbody:\n  geometry: {hemisphere: {radius: 0.05}}\n  spacing: 0.01\n"
                "  material: {young: 10e3, poisson: 0.3}\n  fixed: [{below: {z: 0.0}}]\n",
                f);
    assert_int_equal(fclose(f), 0);
    assert_int_equal(setenv("PALPATE_CACHE", in_root("/cache"), 1), 0);
    pal_scene *scene;
    if (pal_scene_load(scene_path, NULL, 0, &scene, &error) != PALPATE_OK) {
        fail_msg("%s", error.message);
    }
    assert_int_equal(pal_cache_path(scene, path, sizeof path, &error), PALPATE_OK);
    assert_int_equal(pal_scene_hash(scene, hash, &error), PALPATE_OK);
    char expected[600];
    (void)snprintf(expected, sizeof expected, "%s/%s.palpate", in_root("/cache"), hash);
    assert_string_equal(path, expected);
    assert_int_equal(mode_of(in_root("/cache")), 0700);
    assert_int_equal(pal_cache_path(scene, path, strlen(expected), &error), PALPATE_ERROR_ARGUMENT);
    assert_int_equal(pal_cache_path(NULL, path, sizeof path, &error), PALPATE_ERROR_ARGUMENT);
    pal_scene_free(scene);
}

int main(void) {
#define TEST(name) cmocka_unit_test_setup_teardown(name, setup, teardown)
    const struct CMUnitTest tests[] = {
        TEST(the_environment_says_where),
        TEST(directories_others_could_write_are_refused),
        TEST(models_come_back_and_strange_files_do_not),
        TEST(models_are_found_by_their_hash),
        TEST(old_leftovers_are_removed_new_ones_kept),
        TEST(two_builders_end_with_one_file),
        TEST(scenes_have_a_path),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
