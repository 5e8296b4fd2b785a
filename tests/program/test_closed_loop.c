/// `palpate run` with a simulated device: the same loop gives the same numbers, the report's
/// energies are those of its recording, and a hand's press holds against the organ.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include "haptic/model/h5.h"
#include "haptic/safety/passivity.h"
#include "tests/support/program.h"
#include <palpate/palpate.h>

static char folder[] = "/tmp/palpate-loop-XXXXXX";

static const char *scene(void) {
    static const char text[] =
        "palpate: 1\n"
        "body:\n"
        "  geometry: {hemisphere: {radius: 0.05}}\n"
        "  spacing: 0.01\n"
        "  material: {young: 10e3, poisson: 0.45}\n"
        "  fixed: [{below: {z: 0}}]\n"
        "tools:\n"
        "  - name: probe\n"
        "    shape: {sphere: {radius: 0.006}}\n"
        "    start: [0, 0, 0.056]\n"
        "    device: {simulated: {motion: {kind: palpation, depth: 0.006, period: 1}}}\n";
    static char path[300];
    (void)snprintf(path, sizeof path, "%s/scene.yaml", folder);
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    assert_true(fputs(text, f) >= 0);
    assert_int_equal(fclose(f), 0);
    return path;
}

static double *read_column(const char *record, const char *path, int64_t rows) {
    pal_h5 *file = NULL;
    pal_error e = {0};
    double *x = malloc((size_t)(3 * rows) * sizeof *x);
    assert_non_null(x);
    if (pal_h5_open_file(record, &file, &e) != PALPATE_OK ||
        pal_h5_read(file, path, PALPATE_H5_F64, 2, (const int64_t[]){rows, 3}, x, &e) !=
            PALPATE_OK) {
        fail_msg("%s", e.message);
    }
    assert_int_equal(pal_h5_close(file, &e), PALPATE_OK);
    return x;
}

static void energies_are_those_of_the_recording(void **state) {
    (void)state;
    enum { TICKS = 2000 };
    char arguments[1024], record[300];
    (void)snprintf(record, sizeof record, "%s/run.h5", folder);
    (void)snprintf(arguments, sizeof arguments,
                   "run %s --for 2 --freewheel --no-draw --json --record %s", scene(), record);
    program_result r = program_run(arguments);
    if (r.status != 0) {
        fail_msg("%s", r.error);
    }
    assert_true(program_number(r.json, "ticks") == TICKS);
    assert_true(program_number(r.json, "peak_force") > 0.05); // it did touch
    double given = program_number(r.json, "energy.probe.given");
    double taken = program_number(r.json, "energy.probe.taken");
    double worst = program_number(r.json, "energy.probe.worst");
    // two presses of some 3 mm and 0.18 N; what sampling adds, K T / 2 times the integral of v^2,
    // is 30 N/m x 1 ms x 2 s x (13 mm/s)^2 = 10 uJ at most
    assert_true(taken > 2e-4 && given > 2e-4 && worst >= 0.0 && worst < 1e-5);
    assert_true(fabs(given - taken) < 1e-5);

    double *x = read_column(record, "/ticks/position", TICKS);
    double *f = read_column(record, "/ticks/force", TICKS);
    pal_passivity p = {0};
    for (int n = 0; n < TICKS; n++) {
        (void)pal_passivity_tick(&p, x + (size_t)(3 * n), f + (size_t)(3 * n));
    }
    free(x);
    free(f);
    const double digits = 1e-11; // the report prints 12
    assert_true(fabs(p.given - given) < digits * given && fabs(p.taken - taken) < digits * taken &&
                fabs(p.worst - worst) < digits * given);
    program_clear(&r);

    program_result again = program_run(arguments); // freewheel: the loop has no clock
    assert_true(program_number(again.json, "energy.probe.taken") == taken);
    assert_true(program_number(again.json, "energy.probe.given") == given);
    program_clear(&again);
}

static int make_folder(void **state) {
    (void)state;
    return mkdtemp(folder) == NULL;
}

static int remove_folder(void **state) {
    (void)state;
    static const char *const names[] = {"scene.yaml", "run.h5", "run.xdmf", "run.h5.xdmf"};
    char path[400];
    for (size_t i = 0; i < sizeof names / sizeof *names; i++) {
        (void)snprintf(path, sizeof path, "%s/%s", folder, names[i]);
        (void)unlink(path);
    }
    return rmdir(folder);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(energies_are_those_of_the_recording),
    };
    return cmocka_run_group_tests(tests, make_folder, remove_folder);
}
