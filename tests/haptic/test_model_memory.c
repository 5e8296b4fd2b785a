/// Allocation failure at every allocation of saving, loading and pressing a model: a clean error,
/// no leak, no partial file, and the library works afterwards. Also what happens to a file while it
/// is being read: the allocation of its image is the moment between looking and reading.
/// Only calls of our own code fail, not those inside HDF5.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <dirent.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cmocka.h>

#include "haptic/model/model.h"
#include "tests/support/failing_allocator.h"
#include "tests/support/synthetic_model.h"

static char directory[64], path[100];
static pal_model *model;

static int setup(void **state) {
    (void)state;
    (void)snprintf(directory, sizeof directory, "/tmp/palpate-memory-XXXXXX");
    if (mkdtemp(directory) == NULL) {
        return -1;
    }
    (void)snprintf(path, sizeof path, "%s/m.palpate", directory);
    synthetic_params p = synthetic_default_params();
    p.n = 3;
    p.skin = 1;
    model = synthetic_model(&p);
    return model == NULL ? -1 : pal_model_save(model, path, NULL);
}

static int teardown(void **state) {
    (void)state;
    pal_model_free(model);
    return unlink(path) | rmdir(directory); // fails when anything else was left behind
}

typedef pal_status (*operation)(pal_error *error);

static pal_status do_save(pal_error *error) {
    return pal_model_save(model, path, error);
}

static pal_status do_load(pal_error *error) {
    pal_model *m = NULL;
    pal_status status = pal_model_load(path, &m, error);
    if ((status == PALPATE_OK) != (m != NULL)) {
        return (pal_status)99;
    }
    pal_model_free(m);
    return status;
}

static pal_status do_press(pal_error *error) {
    static const double by[3] = {0, 0, -1e-3};
    pal_press press;
    pal_status status = pal_model_press(model, "all", by, &press, error);
    if ((status == PALPATE_OK) != (press.node_force != NULL)) {
        return (pal_status)99;
    }
    pal_press_clear(&press);
    return status;
}

/// Fail the first, second, third ... allocation until the operation gets through.
static void survives(operation run, int least) {
    failing_or_skip();
    for (int n = 1;; n++) {
        pal_error error = {0};
        failing_watch(n, FAILING_OWN);
        pal_status status = run(&error);
        failing_stop();
        assert_int_equal(failing_leaked(FAILING_OWN), 0);
        if (failing_calls < n) { // nothing failed this time
            assert_int_equal(status, PALPATE_OK);
            assert_true(n > least);
            return;
        }
        assert_int_not_equal(status, 99);
        // an allocation that only saves memory (shrinking the image) may fail without harm
        if (status != PALPATE_OK) {
            assert_true(status < 0);
            assert_int_equal(error.status, status);
            assert_true(strlen(error.message) > 10);
        }
        DIR *d = opendir(directory);
        int entries = 0;
        while (readdir(d) != NULL) {
            entries++;
        }
        closedir(d);
        assert_int_equal(entries, 3);                  // ".", "..", the model
        assert_int_equal(do_load(&error), PALPATE_OK); // still whole, HDF5 still works
    }
}

static void saving_survives(void **state) {
    (void)state;
    survives(do_save, 3);
}

static void loading_survives(void **state) {
    (void)state;
    survives(do_load, 15);
}

static void pressing_survives(void **state) {
    (void)state;
    survives(do_press, 4);
}

// ---- The file changes while it is read
// ------------------------------------------------------------

static size_t file_size(void) {
    struct stat st;
    assert_int_equal(stat(path, &st), 0);
    return (size_t)st.st_size;
}

static void shorten(void) {
    (void)!truncate(path, (off_t)(file_size() / 2));
}

static void scribble(void) {
    int fd = open(path, O_WRONLY);
    (void)!pwrite(fd, "scribble", 8, (off_t)(file_size() / 2));
    (void)close(fd);
}

static void overwrite_header(void) {
    int fd = open(path, O_WRONLY);
    (void)!pwrite(fd, "scribble", 8, 100);
    (void)close(fd);
}

static void remove_it(void) {
    (void)unlink(path);
}

static void replace_it(void) {
    (void)pal_model_save(model, path, NULL);
}

static void lengthen(void) {
    int fd = open(path, O_WRONLY | O_APPEND);
    (void)!write(fd, "more", 4);
    (void)close(fd);
}

static void files_that_change_under_the_reader(void **state) {
    (void)state;
    static const struct {
        void (*what)(void);
        pal_status then;
    } cases[] = {
        {shorten, PALPATE_ERROR_TRUNCATED},
        {scribble, PALPATE_ERROR_CHECKSUM},
        {overwrite_header, PALPATE_ERROR_CHECKSUM},
        {remove_it, PALPATE_OK},  // the open file is still whole
        {replace_it, PALPATE_OK}, // and so is the old one after an atomic rename
        {lengthen, PALPATE_OK},   // what was there is read and verified
    };
    failing_or_skip();
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        pal_error error = {0};
        assert_int_equal(pal_model_save(model, path, &error), PALPATE_OK);
        failing_moment = file_size();
        failing_happening = cases[k].what;
        failing_watch(0, FAILING_OWN);
        pal_status status = do_load(&error);
        failing_stop();
        assert_int_equal(failing_moment, 0); // it did happen
        assert_int_equal(status, cases[k].then);
        assert_int_equal(failing_leaked(FAILING_OWN), 0);
    }
    assert_int_equal(pal_model_save(model, path, NULL), PALPATE_OK);
}

/// The model is in memory: nothing that happens to its file afterwards matters.
static void files_that_change_after_loading(void **state) {
    (void)state;
    pal_model *m;
    assert_int_equal(pal_model_load(path, &m, NULL), PALPATE_OK);
    scribble();
    shorten();
    remove_it();
    assert_int_equal(pal_model_check(m, NULL), PALPATE_OK);
    size_t n = 9 * (size_t)m->info.column_count * (size_t)m->info.column_count;
    assert_memory_equal(m->c_tt, model->c_tt, n * sizeof *m->c_tt);
    pal_model_free(m);
    assert_int_equal(pal_model_save(model, path, NULL), PALPATE_OK);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(saving_survives),
        cmocka_unit_test(loading_survives),
        cmocka_unit_test(pressing_survives),
        cmocka_unit_test(files_that_change_under_the_reader),
        cmocka_unit_test(files_that_change_after_loading),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
