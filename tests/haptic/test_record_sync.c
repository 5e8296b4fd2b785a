/// The recording is handed to the disk at once when a fault begins, not a second later
/// (haptic/recording/recording.h). fdatasync is replaced by one that counts.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <cmocka.h>

#include <palpate/session.h>

#include "tests/support/synthetic_model.h"

static _Atomic int syncs;

PALPATE_API int fdatasync(int fd);
int fdatasync(int fd) {
    atomic_fetch_add(&syncs, 1);
    return fd < 0 ? -1 : 0;
}

enum { FAULT_AT = 50, GIVE_UP_NS = 900000000 }; // by then the sync of every second has not come

typedef struct failing {
    pal_device inner;
    pal_session *session;
    int64_t reads, synced_at;
    int fails;
} failing;

static pal_status failing_read(void *self, int64_t time_ns, pal_tool_state *state) {
    failing *d = self;
    d->reads++;
    if (d->synced_at == 0 && atomic_load(&syncs) > 0) {
        d->synced_at = time_ns;
        pal_session_request_stop(d->session);
    }
    return d->fails && d->reads > FAULT_AT && d->reads < FAULT_AT + 200
               ? PALPATE_ERROR_DEVICE
               : d->inner.read(d->inner.self, time_ns, state);
}

static void failing_close(void *self) {
    failing *d = self;
    d->inner.close(d->inner.self);
}

/// @return session time at which the first sync was seen [ns]; 0: none before it ended
static int64_t first_sync(const pal_model *model, const char *path, int fails) {
    pal_tool_def tool = pal_model_runtime(model)->tools[0];
    tool.device.kind = PALPATE_DEVICE_SCRIPTED;
    tool.device.stroke =
        (pal_stroke){.kind = PALPATE_STROKE_PALPATION, .depth = 0.003, .ramp = 0.1, .period = 0.5};
    pal_session_def def = pal_session_default_def();
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.duration = 1e-9 * GIVE_UP_NS;
    def.realtime = 0;
    def.record_path = path;
    failing device = {.fails = fails};
    pal_error e = {0};
    assert_int_equal(pal_device_create(&tool, 1e-3, &def.devices[0], &e), PALPATE_OK);
    device.inner = def.devices[0];
    def.devices[0].self = &device;
    def.devices[0].read = failing_read;
    def.devices[0].close = failing_close;
    if (pal_session_create(model, &def, &device.session, &e) != PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    atomic_store(&syncs, 0);
    assert_int_equal(pal_session_start(device.session, &e), PALPATE_OK);
    assert_int_equal(pal_session_finish(device.session, &e), PALPATE_OK);
    pal_session_free(device.session);
    char companion[160];
    (void)snprintf(companion, sizeof companion, "%.*s.xdmf", (int)strlen(path) - 3, path);
    assert_int_equal(unlink(path), 0);
    assert_int_equal(unlink(companion), 0);
    assert_true(atomic_load(&syncs) > 0); // at the end at the latest
    return device.synced_at;
}

static void a_fault_goes_to_the_disk_at_once(void **state) {
    (void)state;
    synthetic_params p = synthetic_default_params();
    pal_model *model = synthetic_model(&p);
    char folder[] = "/tmp/palpate-sync-XXXXXX", path[64];
    assert_non_null(model);
    assert_non_null(mkdtemp(folder));
    (void)snprintf(path, sizeof path, "%s/run.h5", folder);
    // a recorder that gets no processor for most of a second is let off, not twice more
    int64_t at = 0, without = 1;
    for (int k = 0; k < 3 && at == 0; k++) {
        at = first_sync(model, path, 1);
    }
    assert_true(at > FAULT_AT * (int64_t)1000000);
    for (int k = 0; k < 3 && without != 0; k++) { // and without a fault nothing is
        without = first_sync(model, path, 0);
    }
    assert_int_equal(without, 0);
    assert_int_equal(rmdir(folder), 0);
    pal_model_free(model);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(a_fault_goes_to_the_disk_at_once)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
