/// `touchable: all` and other large wishes: memory is predicted from counts before it is asked for,
/// a body that does not fit is refused by name, one that fits is done within the prediction, and
/// whatever limit the process has, the answer is a status and a message, never a crash.
#include <math.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/precompute.h>

#include "src/solution/memory_plan.h"
#include "tests/support/scene_text.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1 // they reserve terabytes of address space: no limit on it can be set
#else
#define SANITIZED 0
#endif

/// A thin plate held at one side, all of its surface touchable: most of its nodes are surface
/// nodes.
static const char PLATE[] =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {box: {size: [0.06, 0.06, 0.006], center: [0, 0, -0.003]}}\n"
    "  spacing: 0.003\n"
    "  material: {young: 10e3, poisson: 0.4}\n"
    "  fixed: [{below: {x: -0.03}}]\n"
    "  touchable: all\n"
    "estimate: false\n";

static uint64_t address_space(void) {
    unsigned long pages = 0;
    FILE *f = fopen("/proc/self/statm", "r");
    if (f != NULL) {
        if (fscanf(f, "%lu", &pages) != 1) {
            pages = 0;
        }
        (void)fclose(f);
    }
    return (uint64_t)pages * (uint64_t)sysconf(_SC_PAGESIZE);
}

/// What the child found; bytes left beside the address space it had when it began.
typedef struct verdict {
    pal_status status;
    char message[1024];
    int32_t touchable;
    uint64_t predicted, bytes;
} verdict;

static void limit_to(uint64_t more) {
    const struct rlimit limit = {address_space() + more, address_space() + more};
    if (setrlimit(RLIMIT_AS, &limit) != 0) {
        _exit(77);
    }
}

/// Build the plate in a process of its own, its address space limited (0: not). Fails the test when
/// the process does not end by itself with an answer.
static verdict build(const char *spacing, uint64_t more) {
    verdict v;
    int end[2];
    memset(&v, 0, sizeof v);
    assert_int_equal(pipe(end), 0);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        pal_scene *scene = NULL;
        pal_model *model = NULL;
        pal_error error = {0};
        const char *set[] = {spacing, NULL};
        v.status = test_scene_load(PLATE, set, &scene, &error);
        if (more > 0) {
            limit_to(more);
        }
        if (v.status == PALPATE_OK) {
            v.status = pal_precompute(scene, NULL, &model, &error);
        }
        if (model != NULL) {
            pal_model_info info;
            pal_model_get_info(model, &info);
            v.touchable = info.touchable_count;
            v.predicted = pal_memory_plan_peak(&info);
            v.bytes = info.bytes;
        }
        memcpy(v.message, error.message, sizeof v.message);
        _exit(write(end[1], &v, sizeof v) == (ssize_t)sizeof v ? 0 : 1);
    }
    (void)close(end[1]);
    ssize_t got = read(end[0], &v, sizeof v);
    (void)close(end[0]);
    int how = 0;
    assert_int_equal(waitpid(child, &how, 0), child);
    if (!WIFEXITED(how) || WEXITSTATUS(how) != 0 || got != (ssize_t)sizeof v) {
        fail_msg("with %llu bytes more the process ended by %d", (unsigned long long)more, how);
    }
    return v;
}

static void ten_thousand_touchable_nodes_are_predicted(void **state) {
    (void)state;
    pal_model_info info = {.node_count = 20000,
                           .column_count = 10000,
                           .row_count = 10000,
                           .precision = PALPATE_PRECISION_SINGLE,
                           .method = "cell"};
    double t = 30000.0, s = 30000.0;
    // C_TT in double, C_ST in single, and the certificate's copy of C_TT: none of them can be
    // missing
    assert_true((double)pal_memory_plan_blocks(&info) == 8 * t * t + 4 * t * s);
    assert_true((double)pal_memory_plan_peak(&info) >= 16 * t * t + 4 * t * s);
    assert_true((double)pal_memory_plan_peak(&info) < 2.0 * (16 * t * t + 4 * t * s));
}

static void what_does_not_fit_is_refused_with_its_counts(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) {
        pal_model_info info = {.node_count = 20000,
                               .column_count = 10000,
                               .row_count = 10000,
                               .precision = PALPATE_PRECISION_SINGLE,
                               .method = "cell"};
        pal_error error = {0};
        limit_to(4000000000u);
        int ok = pal_memory_plan_check(&info, &error) == PALPATE_ERROR_MEMORY &&
                 strstr(error.message, "10000 touchable nodes") != NULL &&
                 strstr(error.message, "20000 nodes") != NULL &&
                 strstr(error.message, "body.touchable") != NULL;
        _exit(ok ? 0 : 1);
    }
    int how = 0;
    assert_int_equal(waitpid(child, &how, 0), child);
    assert_true(WIFEXITED(how));
    assert_int_equal(WEXITSTATUS(how), 0);
}

static void what_fits_is_done_within_its_prediction(void **state) {
    (void)state;
    verdict v = build("body.spacing=0.003", 0);
    if (v.status != PALPATE_OK) {
        fail_msg("%s", v.message);
    }
    assert_true(v.touchable > 600);
    assert_true(v.bytes >= 9u * 8u * (uint64_t)v.touchable * (uint64_t)v.touchable);
    assert_true(v.predicted >= v.bytes);
    if (SANITIZED) {
        return;
    }
    // given what it predicted, and the address space that OpenBLAS and threads reserve per core, it
    // is done; given half of the blocks it is refused (and does not wait for ever, as OpenBLAS
    // would)
    uint64_t reserve = (uint64_t)sysconf(_SC_NPROCESSORS_ONLN) * (uint64_t)(200 << 20);
    assert_int_equal(build("body.spacing=0.003", v.predicted + reserve + (64u << 20)).status,
                     PALPATE_OK);
    verdict refused = build("body.spacing=0.003", v.bytes / 2);
    assert_int_not_equal(refused.status, PALPATE_OK);
    assert_true(strlen(refused.message) > 20);
}

static void no_limit_crashes_it(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    int refused = 0;
    for (uint64_t more = 4000000; more < 1200000000; more *= 2) {
        verdict v = build("body.spacing=0.004", more);
        if (v.status != PALPATE_OK) {
            assert_true(strlen(v.message) > 10);
            refused++;
        }
    }
    assert_true(refused > 0);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(ten_thousand_touchable_nodes_are_predicted),
        cmocka_unit_test(what_does_not_fit_is_refused_with_its_counts),
        cmocka_unit_test(what_fits_is_done_within_its_prediction),
        cmocka_unit_test(no_limit_crashes_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
