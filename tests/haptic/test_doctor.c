/// `palpate doctor`: each check on made-up /proc and /sys trees, and on the machine itself.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <cmocka.h>

#include "haptic/session/doctor.h"

static char root[64];

static int make_root(void **state) {
    (void)state;
    (void)snprintf(root, sizeof root, "/tmp/palpate-doctor-XXXXXX");
    return mkdtemp(root) == NULL;
}

static int remove_root(void **state) {
    (void)state;
    char command[128];
    (void)snprintf(command, sizeof command, "rm -rf %s", root);
    return system(command);
}

/// Write root/path, making its directories.
static void put(const char *path, const char *text) {
    char full[256];
    (void)snprintf(full, sizeof full, "%s%s", root, path);
    for (char *p = full + strlen(root) + 1; (p = strchr(p, '/')) != NULL; p++) {
        *p = 0;
        (void)mkdir(full, 0700);
        *p = '/';
    }
    FILE *file = fopen(full, "w");
    assert_non_null(file);
    fputs(text, file);
    fclose(file);
}

static pal_check get(const char *name) {
    pal_check check[PALPATE_CHECKS_MAX];
    int32_t n = pal_doctor(root, check);
    for (int32_t i = 0; i < n; i++) {
        if (strcmp(check[i].name, name) == 0) {
            return check[i];
        }
    }
    fail_msg("no check '%s'", name);
    return check[0];
}

static void each_finding_gives_its_verdict(void **state) {
    (void)state;
    static const struct {
        const char *path, *text, *name;
        pal_check_state want;
        const char *word; ///< in what was found
    } table[] = {
        {"/proc/sys/kernel/version", "#1 SMP PREEMPT_DYNAMIC Debian", "kernel", PALPATE_CHECK_WARN,
         "DYNAMIC"},
        {"/proc/sys/kernel/version", "#1 SMP PREEMPT_RT Debian", "kernel", PALPATE_CHECK_OK,
         "PREEMPT_RT"},
        {"/proc/sys/kernel/version", "#1 SMP Debian", "kernel", PALPATE_CHECK_WARN,
         "no preemption"},
        {"/sys/kernel/realtime", "1\n", "kernel", PALPATE_CHECK_OK, "PREEMPT_RT"},
        {"/sys/devices/system/cpu/isolated", "\n", "isolated cores", PALPATE_CHECK_WARN, "none"},
        {"/sys/devices/system/cpu/isolated", "2-3\n", "isolated cores", PALPATE_CHECK_OK, "2-3"},
        {"/sys/devices/system/cpu/cpu0/cpufreq/scaling_governor", "performance\n", "governor",
         PALPATE_CHECK_OK, "performance on 1 of 1"},
        {"/sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave\n", "governor",
         PALPATE_CHECK_WARN, "powersave on 1 of 2"},
        {"/sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n",
         "clock source", PALPATE_CHECK_WARN, "hpet"},
        {"/sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n",
         "clock source", PALPATE_CHECK_OK, "tsc"},
        {"/proc/sys/kernel/sched_rt_runtime_us", "-1\n", "real-time throttling", PALPATE_CHECK_OK,
         "off"},
        {"/proc/sys/kernel/sched_rt_runtime_us", "950000\n", "real-time throttling",
         PALPATE_CHECK_OK, "950000 of 1000000"},
        {"/proc/sys/kernel/sched_rt_runtime_us", "100000\n", "real-time throttling",
         PALPATE_CHECK_WARN, "100000"},
        {"/proc/self/timerslack_ns", "50000\n", "timer slack", PALPATE_CHECK_OK, "50000"},
        {"/proc/self/timerslack_ns", "40000000\n", "timer slack", PALPATE_CHECK_WARN, "40000000"},
        {"/sys/kernel/mm/transparent_hugepage/enabled", "[always] madvise never\n",
         "transparent huge pages", PALPATE_CHECK_OK, "always"},
        {"/sys/kernel/mm/transparent_hugepage/defrag", "[always] defer never\n",
         "transparent huge pages", PALPATE_CHECK_WARN, "defrag [always]"},
        {"/sys/kernel/mm/transparent_hugepage/defrag", "always defer [madvise]\n",
         "transparent huge pages", PALPATE_CHECK_OK, "madvise"},
        {"/proc/swaps", "Filename Type Size Used Priority\n", "swap", PALPATE_CHECK_OK, "0 areas"},
        {"/proc/swaps", "Filename Type Size Used Priority\n/dev/sda2 partition 1 0 -2\n", "swap",
         PALPATE_CHECK_WARN, "1 area"},
        {"/proc/cpuinfo", "flags : fpu vme\n", "virtual machine", PALPATE_CHECK_OK, "no"},
        {"/proc/cpuinfo", "flags : fpu hypervisor vme\n", "virtual machine", PALPATE_CHECK_WARN,
         "yes"},
    };
    for (size_t i = 0; i < sizeof table / sizeof *table; i++) {
        put(table[i].path, table[i].text);
        pal_check c = get(table[i].name);
        if (c.state != table[i].want || strstr(c.found, table[i].word) == NULL) {
            fail_msg("row %zu: %s: %s, '%s'", i, c.name, pal_check_state_name(c.state), c.found);
        }
        assert_int_equal(c.remedy[0] == 0,
                         c.state == PALPATE_CHECK_OK); // a remedy exactly when needed
        assert_null(strchr(c.remedy, '\n'));
    }
}

static void an_empty_tree_is_not_a_crash(void **state) {
    (void)state;
    pal_check check[PALPATE_CHECKS_MAX];
    int32_t n = pal_doctor("/nonexistent", check);
    assert_true(n >= 10 && n <= PALPATE_CHECKS_MAX);
    for (int32_t i = 0; i < n; i++) {
        assert_true(check[i].found[0] != 0);
    }
}

static void this_machine_gets_a_line_per_check(void **state) {
    (void)state;
    pal_check check[PALPATE_CHECKS_MAX];
    int32_t n = pal_doctor(NULL, check);
    int worst = 0;
    for (int32_t i = 0; i < n; i++) {
        assert_true(check[i].name[0] != 0 && check[i].found[0] != 0);
        assert_int_equal(check[i].remedy[0] == 0, check[i].state == PALPATE_CHECK_OK);
        for (int32_t k = 0; k < i; k++) {
            assert_string_not_equal(check[i].name, check[k].name);
        }
        worst = (int)check[i].state > worst ? (int)check[i].state : worst;
    }
    assert_int_equal(pal_doctor_worst(check, n), worst);
    assert_int_equal(pal_doctor_worst(check, 0), PALPATE_CHECK_OK);
    assert_string_equal(pal_check_state_name(PALPATE_CHECK_FAIL), "fail");
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(each_finding_gives_its_verdict),
        cmocka_unit_test(an_empty_tree_is_not_a_crash),
        cmocka_unit_test(this_machine_gets_a_line_per_check),
    };
    return cmocka_run_group_tests(tests, make_root, remove_root);
}
