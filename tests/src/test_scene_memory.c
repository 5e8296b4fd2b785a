/// Every allocation of loading, hashing and selecting fails once: a clean error, nothing leaked.
///
/// The program's allocator is replaced by one that counts and can fail at the n-th call (libyaml
/// and the C library's streams use it too). Sanitizers bring their own, so there the test is
/// skipped; their leak check sees the other scene tests.
#include <dlfcn.h>
#include <errno.h>
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/cloud/scene_check.h"
#include "tests/support/scene_text.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

// volatile: compilers take malloc and free for functions that touch no variable of ours
static volatile long calls;   ///< allocations since the count began
static volatile long fail_at; ///< this one fails; 0: none
static volatile long balance; ///< allocations not yet freed
static volatile int watching;
static volatile int in_yaml; ///< 1: the failing allocation was libyaml's own

#if !SANITIZED
extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void __libc_free(void *);
PALPATE_API void *malloc(size_t n); // exported, so that libraries use them too
PALPATE_API void *calloc(size_t n, size_t m);
PALPATE_API void *realloc(void *p, size_t n);
PALPATE_API void free(void *p);

static int fails(void *caller) {
    int now = watching && ++calls == fail_at;
    if (now) {
        Dl_info info;
        in_yaml = dladdr(caller, &info) != 0 && strstr(info.dli_fname, "libyaml") != NULL;
        errno = ENOMEM;
    }
    return now;
}

static void *counted(void *p) {
    balance += watching && p != NULL;
    return p;
}

void *malloc(size_t n) {
    return fails(__builtin_return_address(0)) ? NULL : counted(__libc_malloc(n));
}
void *calloc(size_t n, size_t m) {
    return fails(__builtin_return_address(0)) ? NULL : counted(__libc_calloc(n, m));
}
void *realloc(void *p, size_t n) {
    if (fails(__builtin_return_address(0))) {
        return NULL;
    }
    void *q = __libc_realloc(p, n);
    return p == NULL ? counted(q) : q;
}
void free(void *p) {
    balance -= watching && p != NULL;
    __libc_free(p);
}
#endif

static const char *const SCENE =
    "palpate: 1\n"
    "body:\n"
    "  geometry: {file: scene.yaml}\n"
    "  spacing: 0.025\n"
    "  refine: [{rim: top, spacing: 0.03}]\n" // coarser: one warning
    "  material: {young: 1000, poisson: 0.3}\n"
    "  fixed: [{below: {z: 0}}]\n"
    "  touchable: [{above: {z: 0}}]\n" // overlaps fixed: another
    "  patches: {top: {above: {z: 0.1}}, side: {any: [{below: {x: 0}}, {above: {x: 0.1}}]}}\n"
    "  probes: {p: [0.05, 0.05, 0.05]}\n"
    "tools: [{name: a, device: {replay: nowhere.csv}}]\n";

/// Load, hash and select, once.
static char message[1024]; ///< of the last error

static pal_status use(const char *path, const pal_cloud *cloud, char hex[65]) {
    const char *const set[] = {"tools.a.limits.force=2", "body.probes.q=[0.01, 0.05, 0.05]"};
    pal_scene *scene = NULL;
    pal_node_sets sets = {0};
    pal_error error = {0};
    pal_status status = pal_scene_load(path, set, 2, &scene, &error);
    if (status == PALPATE_OK) {
        status = pal_scene_hash(scene, hex, &error);
    }
    if (status == PALPATE_OK) {
        status = pal_scene_select_nodes(scene, cloud, &sets, &error);
    }
    memcpy(message, error.message, sizeof message);
    pal_node_sets_clear(&sets);
    pal_scene_free(scene);
    return status;
}

static void every_failing_allocation_is_a_clean_error(void **state) {
    (void)state;
    if (SANITIZED) {
        skip();
    }
    char path[64];
    pal_cloud cloud = {0};
    const double size[3] = {1, 1, 1};
    const int n[3] = {4, 4, 4};
    assert_int_equal(pal_cloud_box(&cloud, size, n, 0.0, 1, NULL), PALPATE_OK);
    cloud.length = 0.1;
    test_scene_put(SCENE, strlen(SCENE), path);
    char reference[65];
    char hex[65];
    assert_int_equal(use(path, &cloud, reference),
                     PALPATE_OK); // lazy set-up of the C library happens here
    balance = calls = fail_at = 0;
    watching = 1;
    pal_status status = use(path, &cloud, hex);
    watching = 0;
    long total = calls;
    assert_int_equal(status, PALPATE_OK);
    assert_int_equal(balance, 0);
    assert_true(total > 100);
    int survived = 0;
    int yaml_lost = 0;
    for (long i = 1; i <= total; i++) {
        balance = calls = in_yaml = 0;
        fail_at = i;
        watching = 1;
        status = use(path, &cloud, hex);
        watching = 0;
        // streams of the C library work on, unbuffered, when they get no buffer
        int unharmed = status == PALPATE_OK && strcmp(hex, reference) == 0;
        survived += unharmed;
        // libyaml 0.2.5 itself loses one block when a growth of its node stack fails
        int lost = balance == 1 && in_yaml;
        yaml_lost += lost;
        if ((status != PALPATE_ERROR_MEMORY && !unharmed) || (balance != 0 && !lost)) {
            fail_msg("allocation %ld of %ld: %s (%s), %ld not freed", i, total,
                     pal_status_name(status), message, balance);
        }
    }
    print_message("%ld allocations, %d of them dispensable\n", total, survived);
    assert_in_range(survived, 0, 3);
    assert_in_range(yaml_lost, 0, 1);
    test_scene_remove(path);
    pal_cloud_clear(&cloud);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_failing_allocation_is_a_clean_error),
    };
    return cmocka_run_group_tests_name("scene_memory", tests, NULL, NULL);
}
