/// `touchable: all` and other large wishes: memory is predicted from counts before it is asked for,
/// a body that does not fit is refused by name, one that fits is done within the prediction, and
/// whatever limit the process has, the answer is a status and a message, never a crash.
#include <malloc.h>
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

#include "haptic/model/model.h"
#include "src/solution/memory_plan.h"
#include "src/store/compress.h"
#include "tests/support/scene_text.h"
#include "tests/support/synthetic_model.h"

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
    uint64_t predicted, bytes, grown; ///< the last: resident memory at its most, less at first
} verdict;

static void limit_to(uint64_t more) {
    const struct rlimit limit = {address_space() + more, address_space() + more};
    if (setrlimit(RLIMIT_AS, &limit) != 0) {
        _exit(77);
    }
}

/// Build the plate in a process of its own, its address space limited (0: not). Fails the test when
/// the process does not end by itself with an answer.
static verdict build_with(const char *const set[], uint64_t more) {
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
        struct rusage before, after;
        (void)getrusage(RUSAGE_SELF, &before);
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
        (void)getrusage(RUSAGE_SELF, &after);
        v.grown = 1024 * (uint64_t)(after.ru_maxrss - before.ru_maxrss);
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

static verdict build(const char *spacing, uint64_t more) {
    return build_with((const char *const[]){spacing, NULL}, more);
}

/// Where the factors are what takes the memory, they are in the plan: not less than what a build
/// takes, and not so much that what fits is refused.
static void factors_are_predicted(void **state) {
    (void)state;
    if (SANITIZED) {
        skip(); // shadows and quarantines are resident, too
    }
    static const char *const method[2] = {"method.kind=galerkin", "method.kind=cell"};
    for (int k = 0; k < 2; k++) {
        const char *const set[] = {"body.geometry={box: {size: [0.04, 0.04, 0.04]}}",
                                   "body.fixed=[{below: {z: -0.02}}]",
                                   "body.touchable=[{ball: {center: [0, 0, 0.02], radius: 0.006}}]",
                                   "store.displacement=none",
                                   method[k],
                                   NULL};
        verdict v = build_with(set, 0);
        if (v.status != PALPATE_OK) {
            fail_msg("%s", v.message);
        }
        print_message("  %s: %.0f MB predicted, grown by %.0f\n", method[k],
                      1e-6 * (double)v.predicted, 1e-6 * (double)v.grown);
        assert_true(v.bytes < v.grown / 4); // it is not the model itself
        // the plan is of the solve: cloud, matrix and libraries take some 30 MB beside it
        assert_true(v.grown <= v.predicted + (64u << 20));
        assert_true(v.predicted <= 5 * v.grown);
    }
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

static void a_tolerance_counts_its_candidates(void **state) {
    (void)state;
    pal_model_info info = {.node_count = 20000,
                           .column_count = 10000,
                           .row_count = 20000,
                           .precision = PALPATE_PRECISION_SCALED, // what it became
                           .field_tolerance = 1e-3,
                           .method = "cell"};
    double t = 30000.0, s = 60000.0;
    // dense in single precision, then scaled integers and bases beside it
    assert_true((double)pal_memory_plan_blocks(&info) == 8 * t * t + 4 * t * s);
    assert_true((double)pal_memory_plan_compress(&info) >= 4 * t * s);
    assert_true(pal_memory_plan_peak(&info) >=
                pal_memory_plan_blocks(&info) + pal_memory_plan_compress(&info));
    info.field_tolerance = 1e-6; // from double precision, through single
    assert_true((double)pal_memory_plan_blocks(&info) == 8 * t * t + 8 * t * s);
    assert_true((double)pal_memory_plan_compress(&info) >= 8 * t * s);
    info.field_tolerance = 0; // the contacts that measure the field
    assert_true((double)pal_memory_plan_compress(&info) < 1000 * s);
    info.row_count = 0;
    assert_true(pal_memory_plan_compress(&info) == 0);
}

static uint64_t status_bytes(const char *key) {
    char line[160];
    unsigned long long kib = 0;
    FILE *f = fopen("/proc/self/status", "r");
    while (f != NULL && fgets(line, sizeof line, f) != NULL) {
        if (strncmp(line, key, strlen(key)) == 0) {
            (void)sscanf(line + strlen(key), " %llu", &kib);
        }
    }
    if (f != NULL) {
        (void)fclose(f);
    }
    return 1024 * (uint64_t)kib;
}

/// What choosing a form of these rows takes beside them, in a process of its own.
static uint64_t compressing_takes(int32_t n, int32_t layers, double tolerance, uint64_t *planned) {
    synthetic_params params = synthetic_default_params();
    params.n = n;
    params.layers = layers;
    params.rows = SYNTHETIC_ROWS_ALL;
    params.precision = pal_memory_plan_precision(tolerance, PALPATE_PRECISION_SINGLE);
    pal_model *model = synthetic_model(&params);
    assert_non_null(model);
    model->info.field_tolerance = tolerance;
    *planned = pal_memory_plan_compress(&model->info);
    (void)malloc_trim(0);
    int end[2], how = 0;
    uint64_t taken = 0;
    assert_int_equal(pipe(end), 0);
    pid_t child = fork();
    assert_true(child >= 0);
    if (child == 0) { // its high-water mark starts at what it has
        uint64_t before = status_bytes("VmRSS:");
        pal_error error = {0};
        pal_status status = pal_compress(model, tolerance, NULL, &error);
        taken = status_bytes("VmHWM:") - before;
        _exit(status == PALPATE_OK && write(end[1], &taken, sizeof taken) == sizeof taken ? 0 : 1);
    }
    (void)close(end[1]);
    assert_int_equal(read(end[0], &taken, sizeof taken), sizeof taken);
    (void)close(end[0]);
    assert_int_equal(waitpid(child, &how, 0), child);
    assert_true(WIFEXITED(how) && WEXITSTATUS(how) == 0);
    pal_model_free(model);
    return taken;
}

/// Chosen within what was planned, and the plan is not idle: a fifth of it at least is used (one of
/// two threads may find little to do, and bases be small).
static void choosing_a_form_stays_within_its_plan(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    static const struct {
        int32_t n, layers;
        double tolerance;
    } cases[] = {{10, 4, 1e-3}, {16, 8, 1e-2}, {14, 6, 1e-6}};
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        uint64_t planned;
        uint64_t taken =
            compressing_takes(cases[k].n, cases[k].layers, cases[k].tolerance, &planned);
        print_message("%d columns to %g: took %.1f MB, planned %.1f MB\n", cases[k].n * cases[k].n,
                      cases[k].tolerance, 1e-6 * (double)taken, 1e-6 * (double)planned);
        assert_true(taken <= planned);
        assert_true(taken >= planned / 5);
    }
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
        cmocka_unit_test(factors_are_predicted),
        cmocka_unit_test(ten_thousand_touchable_nodes_are_predicted),
        cmocka_unit_test(what_does_not_fit_is_refused_with_its_counts),
        cmocka_unit_test(what_fits_is_done_within_its_prediction),
        cmocka_unit_test(a_tolerance_counts_its_candidates),
        cmocka_unit_test(choosing_a_form_stays_within_its_plan),
        cmocka_unit_test(no_limit_crashes_it),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
