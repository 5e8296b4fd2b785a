/// Every allocation of loading, hashing and selecting fails once: a clean error, nothing leaked.
/// Those of libyaml and of the C library's streams fail too.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cmocka.h>

#include "src/cloud/scene_check.h"
#include "tests/support/failing_allocator.h"
#include "tests/support/scene_text.h"

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
    failing_or_skip();
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
    static const char *const yaml[] = {"libyaml", NULL};
    failing_libraries = yaml;
    failing_watch(0, FAILING_ANY);
    pal_status status = use(path, &cloud, hex);
    failing_stop();
    long total = failing_calls;
    assert_int_equal(status, PALPATE_OK);
    assert_int_equal(failing_leaked(FAILING_ANY), 0);
    assert_true(total > 100);
    int survived = 0;
    int yaml_lost = 0;
    for (long i = 1; i <= total; i++) {
        failing_watch(i, FAILING_ANY);
        status = use(path, &cloud, hex);
        failing_stop();
        // streams of the C library work on, unbuffered, when they get no buffer
        int unharmed = status == PALPATE_OK && strcmp(hex, reference) == 0;
        survived += unharmed;
        // libyaml 0.2.5 itself loses one block when a growth of its node stack fails
        int left = failing_leaked(FAILING_ANY);
        int lost = left == 1 && failing_leaked(FAILING_NAMED) == 1 && failing_by == FAILING_NAMED;
        yaml_lost += lost;
        if ((status != PALPATE_ERROR_MEMORY && !unharmed) || (left != 0 && !lost)) {
            fail_msg("allocation %ld of %ld: %s (%s), %d not freed", i, total,
                     pal_status_name(status), message, left);
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
