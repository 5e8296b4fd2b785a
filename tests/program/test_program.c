/// The program as a user meets it: help, JSON keys, cache, model files, errors, interruption.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <dirent.h>
#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <cmocka.h>

#include "tests/support/program.h"

static char model_path[256], scene_path[512], plain_path[256];

static program_result run(const char *format, ...) __attribute__((format(printf, 1, 2)));
static program_result run(const char *format, ...) {
    char arguments[4096];
    va_list args;
    va_start(args, format);
    (void)vsnprintf(arguments, sizeof arguments, format, args);
    va_end(args);
    return program_run(arguments);
}

static void every_command_helps_with_an_example(void **state) {
    (void)state;
    static const char *const command[] = {"precompute", "info",   "press",  "run",
                                          "view",       "doctor", "schema", "recover"};
    for (size_t i = 0; i < sizeof command / sizeof command[0]; i++) {
        program_result r = run("%s --help", command[i]);
        assert_int_equal(r.status, 0);
        assert_non_null(strstr(r.out, "Example:"));
        assert_non_null(strstr(r.out, "--json"));
        const int builds = i < 5; // where no scene is built there is nothing to set
        assert_true((strstr(r.out, "--set") != NULL) == builds);
        program_clear(&r);
    }
    program_result r = run("--version");
    assert_int_equal(r.status, 0);
    program_clear(&r);
    r = run("nonsense");
    assert_int_equal(r.status, 2);
    assert_non_null(strstr(r.error, "nonsense"));
    program_clear(&r);
    r = run("help press"); // as `press --help`
    assert_int_equal(r.status, 0);
    assert_non_null(strstr(r.out, "--patch"));
    program_clear(&r);
    r = run("schema --json");
    assert_int_equal(r.status, 0);
    assert_true(json_array_size(json_object_get(r.json, "keys")) > 30);
    program_clear(&r);
}

static void precompute_prints_the_keys_of_the_design(void **state) {
    (void)state;
    static const char *const key[] = {"nodes",
                                      "touchable",
                                      "stored",
                                      "bytes",
                                      "seconds.cloud",
                                      "seconds.assemble",
                                      "seconds.factor",
                                      "seconds.solve",
                                      "seconds.total",
                                      "peak_bytes",
                                      "certificate.pass",
                                      "certificate.reciprocity",
                                      "certificate.force_change",
                                      "certificate.min_eigenvalue_ratio",
                                      "certificate.solve_residual",
                                      "certificate.rcond"};
    program_result r = run("precompute %s -o %s --json", scene_path, model_path);
    assert_int_equal(r.status, 0);
    for (size_t i = 0; i < sizeof key / sizeof key[0]; i++) {
        assert_true(isfinite(program_number(r.json, key[i])));
    }
    assert_true(json_is_string(json_object_get(r.json, "method")));
    assert_true(program_number(r.json, "certificate.pass") == 1.0);
    program_result info = run("info %s --json", model_path);
    assert_int_equal(info.status, 0);
    assert_string_equal(json_string_value(json_object_get(info.json, "hash")),
                        json_string_value(json_object_get(r.json, "hash")));
    assert_true(program_number(info.json, "nodes") == program_number(r.json, "nodes"));
    program_clear(&info);
    program_clear(&r);
}

static int cached(const char *set) {
    program_result r = run("precompute %s --json %s", scene_path, set);
    assert_int_equal(r.status, 0);
    int was = (int)program_number(r.json, "cached");
    program_clear(&r);
    return was;
}

static void physics_rebuilds_and_nothing_else_does(void **state) {
    (void)state;
    assert_true(cached("") == 1); // built by the test before
    assert_true(cached("--set body.material.young=10000.0") == 1);
    assert_true(cached("--set render.rate=25") == 1);
    assert_true(cached("--set tools.probe.limits.force=2") == 1);
    assert_true(cached("--set body.material.young=12000") == 0);
    assert_true(cached("--set body.material.young=12e3") == 1);
    assert_true(cached("--set body.material.poisson=0.4") == 0);
    assert_true(cached("--set repair=none") == 0);
}

/// What the build warned of is said again by who finds the model in the cache, or has its file
/// only, and once.
static void warnings_stay_with_the_model(void **state) {
    (void)state;
    char scene[300], file[300];
    (void)snprintf(scene, sizeof scene, "%s.warned.yaml", model_path);
    (void)snprintf(file, sizeof file, "%s.warned", model_path);
    FILE *f = fopen(scene, "w");
    assert_non_null(f);
    (void)fputs("palpate: 1\nbody:\n  geometry: {box: {size: [0.04, 0.04, 0.02]}}\n"
                "  spacing: 0.01\n  material: {young: 10e3, poisson: 0.3}\n"
                "  fixed: [{below: {z: -0.01}}]\n  touchable: [{below: {z: 0.01}}]\n",
                f);
    assert_int_equal(fclose(f), 0);
    char *said[3] = {NULL};
    for (int i = 0; i < 3; i++) { // built, from the cache, from the file
        program_result r =
            i < 2 ? run("precompute %s -o %s --json", scene, file) : run("info %s --json", file);
        assert_int_equal(r.status, 0);
        json_t *warnings = json_object_get(r.json, "warnings");
        assert_int_equal(json_array_size(warnings), 1);
        said[i] = strdup(json_string_value(json_array_get(warnings, 0)));
        assert_non_null(strstr(said[i], "fixed wins"));
        assert_string_equal(said[i], said[0]);
        assert_true(i == 2 || (program_number(r.json, "cached") == 1.0) == (i == 1));
        program_clear(&r);
    }
    program_result r = run("info %s", file);
    char *first = strstr(r.error, "fixed wins");
    assert_non_null(first);
    assert_null(strstr(first + 1, "fixed wins"));
    program_clear(&r);
    for (int i = 0; i < 3; i++) {
        free(said[i]);
    }
    (void)unlink(scene);
    (void)unlink(file);
}

static void the_error_is_estimated_and_refined_to_a_target(void **state) {
    (void)state;
    program_result a = run("precompute %s --json", scene_path);
    double first = program_number(a.json, "certificate.estimated_error");
    assert_true(first > 0.0 && first < 0.1);
    program_result b = run("precompute %s --json --target-error %g", scene_path, 0.7 * first);
    assert_int_equal(b.status, 0);
    assert_true(program_number(b.json, "certificate.estimated_error") <= 0.7 * first);
    assert_true(program_number(b.json, "nodes") > program_number(a.json, "nodes"));
    program_clear(&b);
    b = run("precompute %s --json --set estimate=false", scene_path);
    assert_true(
        json_is_null(json_object_get(json_object_get(b.json, "certificate"), "estimated_error")));
    program_clear(&b);
    b = run("precompute %s --target-error 0.01 --set estimate=false", scene_path);
    assert_int_equal(b.status, 1);
    assert_non_null(strstr(b.error, "estimate"));
    program_clear(&b);
    program_clear(&a);
}

static void a_model_file_presses_like_its_scene(void **state) {
    (void)state;
    program_result a = run("press %s --patch pole --by 0.001,0,-0.005 --json", scene_path);
    program_result b = run("press %s --patch pole --by 0.001,0,-0.005 --json", model_path);
    assert_int_equal(a.status, 0);
    assert_int_equal(b.status, 0);
    static const char *const key[] = {"force.0",     "force.1",  "force.2",      "moment.0",
                                      "moment.1",    "moment.2", "probes.mid.0", "probes.mid.2",
                                      "patch_nodes", "nodes"};
    for (size_t i = 0; i < sizeof key / sizeof key[0]; i++) {
        assert_true(isfinite(program_number(a.json, key[i])));
        assert_true(program_number(a.json, key[i]) == program_number(b.json, key[i]));
    }
    // the tool pushes down and sideways: so does its force on the body
    assert_true(program_number(a.json, "force.2") < 0.0 && program_number(a.json, "force.0") > 0.0);
    assert_true(program_number(a.json, "probes.mid.2") < 0.0);
    program_clear(&a);
    program_clear(&b);
}

static void h5dump_reads_the_model(void **state) {
    (void)state;
    char command[600];
    (void)snprintf(command, sizeof command, "h5dump -H %s > /dev/null 2>&1", model_path);
    assert_int_equal(system(command), 0);
}

static void errors_are_located_and_exit_is_not_zero(void **state) {
    (void)state;
    const struct {
        const char *arguments, *expect;
    } t[] = {
        {"press %s --patch pole --by 0,0", "three numbers"},
        {"press %s --patch rim --by 0,0,-0.001 --json", "pole"},
        {"press %s --patch pole --by 0,0,-0.001 --set body.material.poisson=0.5", "0.5"},
        {"press %s --patch pole --by 0,0,-0.001 --set body.materiel.poisson=0.3", "materiel"},
        {"precompute %s --set body.spacing=0.5x", "0.5x"},
        {"precompute %s -o /nonexistent/x.palpate", "/nonexistent"},
        {"info /nonexistent/model.palpate --set a=%s", "/nonexistent/model.palpate"},
    };
    for (size_t i = 0; i < sizeof t / sizeof t[0]; i++) {
        char arguments[2048];
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored "-Wformat-nonliteral"
        (void)snprintf(arguments, sizeof arguments, t[i].arguments, scene_path);
#pragma GCC diagnostic pop
        program_result r = program_run(arguments);
        assert_int_not_equal(r.status, 0);
        assert_true(r.status < 128);
        if (strstr(r.error, t[i].expect) == NULL) {
            fail_msg("%s: '%s' lacks '%s'", arguments, r.error, t[i].expect);
        }
        if (strstr(arguments, "--json") != NULL) { // still one object on stdout
            assert_true(json_is_object(json_object_get(r.json, "error")));
        }
        program_clear(&r);
    }
}

/// No limit is a choice that every run reports; a limit left out is the default.
static void a_run_says_what_limits_hold(void **state) {
    (void)state;
    program_result r =
        run("run %s --for 0.05 --freewheel --no-draw --json --set tools.probe.limits.force=none "
            "--set tools.probe.device_spec.max_torque=0.01",
            scene_path);
    assert_int_equal(r.status, 0);
    const json_t *limits = json_array_get(json_object_get(r.json, "limits"), 0);
    assert_true(json_is_null(json_object_get(limits, "force")));
    assert_true(program_number(r.json, "limits.0.slew") == 100.0);
    assert_true(program_number(r.json, "limits.0.torque") == 0.01);
    program_clear(&r);
    r = run("run %s --for 0.05 --freewheel --no-draw --set tools.probe.limits.force=none",
            scene_path);
    assert_non_null(strstr(r.out, "force NOT LIMITED"));
    program_clear(&r);
    r = run("run %s --for 0.05 --freewheel --no-draw --set tools.probe.limits.force=0", scene_path);
    assert_int_not_equal(r.status, 0);
    assert_non_null(strstr(r.error, "auto, or none"));
    program_clear(&r);
}

static int cache_entries(const char *directory) {
    int n = 0;
    DIR *d = opendir(directory);
    for (struct dirent *e; d != NULL && (e = readdir(d)) != NULL;) {
        n += e->d_name[0] != '.';
    }
    if (d != NULL) {
        closedir(d);
    }
    return n;
}

/// SIGINT at several moments of a build: it ends, nothing is left in the cache directory.
/// /dev/full takes nothing: a result that did not get out is no success.
static void lost_output_is_not_success(void **state) {
    (void)state;
    static const char *const command[] = {"--version", "--help", "schema", "info --json", "info"};
    for (size_t i = 0; i < sizeof command / sizeof command[0]; i++) {
        char line[600];
        for (int full = 0; full < 2; full++) {
            (void)snprintf(line, sizeof line, "\"$PALPATE\" %s %s > /dev/%s 2> /dev/null",
                           command[i], strncmp(command[i], "info", 4) == 0 ? model_path : "",
                           full ? "full" : "null");
            int status = system(line); // NOLINT(cert-env33-c): our own program
            assert_int_equal(WIFEXITED(status) && WEXITSTATUS(status) == 0, !full);
        }
    }
}

static void an_interrupt_leaves_nothing_half_written(void **state) {
    (void)state;
    char cache[] = "/tmp/palpate-int-XXXXXX";
    assert_non_null(mkdtemp(cache));
    const char *program = getenv("PALPATE") ? getenv("PALPATE") : "build/palpate";
    int interrupted = 0;
    for (int ms = 20; ms <= 900; ms += 220) {
        pid_t child = fork();
        if (child == 0) {
            setenv("PALPATE_CACHE", cache, 1);
            (void)!freopen("/dev/null", "w", stdout);
            (void)!freopen("/dev/null", "w", stderr);
            execlp(program, "palpate", "precompute", plain_path, "--set",
                   "body.material.young=7777", (char *)NULL);
            _exit(99);
        }
        struct timespec pause = {0, ms * 1000000L};
        (void)nanosleep(&pause, NULL);
        kill(child, SIGINT);
        int status = 0;
        waitpid(child, &status, 0);
        int killed = WIFSIGNALED(status) || WEXITSTATUS(status) == 128 + SIGINT;
        interrupted += killed;
        if (killed) {
            assert_int_equal(cache_entries(cache), 0);
        } else {
            assert_int_equal(WEXITSTATUS(status), 0); // it was faster than the signal
        }
    }
    assert_true(interrupted > 0);
    char command[300];
    (void)snprintf(command, sizeof command, "rm -rf %s", cache);
    assert_int_equal(system(command), 0);
}

static int setup(void **state) {
    (void)state;
    (void)snprintf(model_path, sizeof model_path, "/tmp/palpate-test-%ld.palpate", (long)getpid());
    (void)snprintf(plain_path, sizeof plain_path, "%s/scenes/hemisphere.yaml", program_source());
    // the shipped scene, coarser: what is tested here is the program
    (void)snprintf(scene_path, sizeof scene_path,
                   "%s/scenes/hemisphere.yaml --set body.patches.pole.rim_spacing=0.002 "
                   "--set body.refine=[]",
                   program_source());
    return 0;
}

static int teardown(void **state) {
    (void)state;
    (void)unlink(model_path);
    return 0;
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(every_command_helps_with_an_example),
        cmocka_unit_test(precompute_prints_the_keys_of_the_design),
        cmocka_unit_test(physics_rebuilds_and_nothing_else_does),
        cmocka_unit_test(warnings_stay_with_the_model),
        cmocka_unit_test(the_error_is_estimated_and_refined_to_a_target),
        cmocka_unit_test(a_model_file_presses_like_its_scene),
        cmocka_unit_test(h5dump_reads_the_model),
        cmocka_unit_test(errors_are_located_and_exit_is_not_zero),
        cmocka_unit_test(a_run_says_what_limits_hold),
        cmocka_unit_test(lost_output_is_not_success),
        cmocka_unit_test(an_interrupt_leaves_nothing_half_written),
    };
    return cmocka_run_group_tests(tests, setup, teardown);
}
