/// Every allocation of building a cloud fails once: a clean error (or the same cloud, where the C
/// library can do without), nothing leaked.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include "src/cloud/skin.h"
#include "tests/support/clouds.h"
#include "tests/support/failing_allocator.h"
#include "tests/support/surfaces.h"

/// Build with the n-th allocation failing. @return the allocations made
static long attempt(test_scene *t, long n, pal_status *status, int32_t *nodes) {
    pal_cloud c;
    pal_skin_source skin;
    pal_error e = {0};
    failing_watch(n, FAILING_OWN);
    *status = pal_cloud_build(&t->scene, NULL, &c, &skin, &e);
    if (*status == PALPATE_OK) {
        *nodes = c.node_count;
        pal_cloud_clear(&c);
        pal_skin_clear(&skin);
    }
    failing_stop();
    int lost = failing_leaked(FAILING_OWN);
    if (lost != 0) {
        fail_msg("allocation %ld: %d blocks leaked (%s)", n, lost, e.message);
    }
    if (*status != PALPATE_OK) {
        assert_true(e.message[0] != 0);
        assert_null(c.position);
        assert_null(skin.position);
    }
    return failing_calls;
}

static void fail_each(test_scene *t) {
    pal_status status;
    int32_t nodes = 0, same = 0;
    long total = attempt(t, 0, &status, &nodes);
    assert_int_equal(status, PALPATE_OK);
    assert_true(total > 30);
    int failed = 0;
    // the first 40 one by one, later ones (mostly sorting edges round after round) with growing
    // steps, the last 20 one by one again
    for (long n = 1; n <= total; n += n < 40 || n > total - 20 ? 1 : 1 + n / 40) {
        (void)attempt(t, n, &status, &same);
        if (status == PALPATE_OK) {
            assert_int_equal(same, nodes);
        } else {
            assert_int_equal(status, PALPATE_ERROR_MEMORY);
            failed++;
        }
    }
    assert_true(failed > 30);
    test_scene_clear(t);
}

static void primitives_survive_every_failing_allocation(void **state) {
    (void)state;
    failing_or_skip();
    test_scene t;
    const double pole[3] = {0.0, 0.0, 1.0};
    test_scene_init(&t, PALPATE_GEOMETRY_HEMISPHERE, 0.5);
    t.scene.geometry.radius = 1.0;
    test_scene_refine_ball(&t, pole, 0.1, 0.4);
    test_scene_patch_ball(&t, "pole", pole, 0.5, 0.3);
    fail_each(&t);
}

static void files_survive_every_failing_allocation(void **state) {
    (void)state;
    failing_or_skip();
    test_surface cube;
    char path[64];
    test_surface_cube(&cube, 0.0, 0.0, 0.0);
    test_surface_write(&cube, "obj", path);
    test_scene t;
    const double corner[3] = {0.0, 0.0, 0.0};
    test_scene_init(&t, PALPATE_GEOMETRY_FILE, 0.5);
    memcpy(t.scene.geometry.path, path, sizeof path);
    test_scene_patch_ball(&t, "corner", corner, 0.5, 0.3);
    fail_each(&t);
    (void)unlink(path);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(primitives_survive_every_failing_allocation),
        cmocka_unit_test(files_survive_every_failing_allocation),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
