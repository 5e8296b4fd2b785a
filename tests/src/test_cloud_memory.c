/// Every allocation of building a cloud fails once: a clean error (or the same cloud, where the C
/// library can do without), nothing leaked.
///
/// The program's allocator is replaced by one that counts calls made by this program's own code
/// and can fail at the n-th. Sanitizers bring their own
/// allocator, so there the test is skipped; their leak check sees the other cloud tests.
#include <errno.h>
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
#include "tests/support/surfaces.h"

#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
#define SANITIZED 1
#else
#define SANITIZED 0
#endif

static volatile long calls, fail_at, balance;
static volatile int watching;
static void *volatile live[4096]; ///< blocks of our own

#if !SANITIZED
extern void *__libc_malloc(size_t);
extern void *__libc_calloc(size_t, size_t);
extern void *__libc_realloc(void *, size_t);
extern void __libc_free(void *);
extern const char __executable_start, etext;
PALPATE_API void *malloc(size_t n);
PALPATE_API void *calloc(size_t n, size_t m);
PALPATE_API void *realloc(void *p, size_t n);
PALPATE_API void free(void *p);

static int ours(const void *caller) {
    return watching && (uintptr_t)caller >= (uintptr_t)&__executable_start &&
           (uintptr_t)caller < (uintptr_t)&etext;
}
static int fails(const void *caller) {
    int now = ours(caller) && ++calls == fail_at;
    if (now) {
        errno = ENOMEM;
    }
    return now;
}
static void *made(const void *caller, void *p) {
    for (int i = 0; ours(caller) && p != NULL && i < 4096; i++) {
        if (live[i] == NULL) {
            live[i] = p;
            balance++;
            break;
        }
    }
    return p;
}
static int gone(const void *p) {
    for (int i = 0; watching && p != NULL && i < 4096; i++) {
        if (live[i] == p) {
            live[i] = NULL;
            balance--;
            return 1;
        }
    }
    return 0;
}
void *malloc(size_t n) {
    const void *caller = __builtin_return_address(0);
    return fails(caller) ? NULL : made(caller, __libc_malloc(n));
}
void *calloc(size_t n, size_t m) {
    const void *caller = __builtin_return_address(0);
    return fails(caller) ? NULL : made(caller, __libc_calloc(n, m));
}
void *realloc(void *p, size_t n) {
    const void *caller = __builtin_return_address(0);
    if (fails(caller)) {
        return NULL;
    }
    int known = gone(p);
    void *q = __libc_realloc(p, n);
    return known || p == NULL ? made(caller, q) : q;
}
void free(void *p) {
    (void)gone(p);
    __libc_free(p);
}
#endif

/// Build with the n-th allocation failing. @return the allocations made
static long attempt(test_scene *t, long n, pal_status *status, int32_t *nodes) {
    pal_cloud c;
    pal_skin_source skin;
    pal_error e = {0};
    calls = balance = 0;
    fail_at = n;
    watching = 1;
    *status = pal_cloud_build(&t->scene, NULL, &c, &skin, &e);
    if (*status == PALPATE_OK) {
        *nodes = c.node_count;
        pal_cloud_clear(&c);
        pal_skin_clear(&skin);
    }
    watching = 0;
    if (balance != 0) {
        fail_msg("allocation %ld: %ld blocks leaked (%s)", n, balance, e.message);
    }
    if (*status != PALPATE_OK) {
        assert_true(e.message[0] != 0);
        assert_null(c.position);
        assert_null(skin.position);
    }
    return calls;
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
    if (SANITIZED) {
        skip();
    }
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
    if (SANITIZED) {
        skip();
    }
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
