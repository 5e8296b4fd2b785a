/// @file command_doctor.c  palpate doctor: is this machine ready for a 1 kHz servo?
#include "haptic/program/program.h"

#include <stdio.h>

#include "haptic/session/doctor.h"

static error_t parse(int key, char *arg, struct argp_state *state) {
    (void)arg;
    if (key == ARGP_KEY_INIT) {
        state->child_inputs[0] = state->input;
        return 0;
    }
    return ARGP_ERR_UNKNOWN;
}

static const char doc[] =
    "Tell what this machine lacks for a 1 kHz servo, with a remedy per line.\v"
    "Exit status 0 when every check is ok or only a warning, 1 when real time is refused. Nothing "
    "on the "
    "machine is changed.\n\n"
    "Example:\n  palpate doctor";

int command_doctor(int argc, char **argv) {
    common_options o = {.command = "palpate doctor",
                        .no_set = "no scene is used: the machine is looked at as it is"};
    const struct argp_child children[] = {{&plain_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {NULL, parse, "", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_check check[PALPATE_CHECKS_MAX];
    int32_t count = pal_doctor(NULL, check);
    pal_check_state worst = pal_doctor_worst(check, count);
    json_t *list = json_array();
    for (int32_t i = 0; i < count; i++) {
        const char *state = pal_check_state_name(check[i].state);
        if (o.json) {
            json_array_append_new(list, json_pack("{s:s,s:s,s:s,s:s}", "check", check[i].name,
                                                  "state", state, "found", check[i].found, "remedy",
                                                  check[i].remedy));
        } else {
            (void)printf("%-5s %-20s %s\n", state, check[i].name, check[i].found);
            if (check[i].remedy[0] != '\0') {
                (void)printf("      %-20s -> %s\n", "", check[i].remedy);
            }
        }
    }
    if (o.json) {
        print_json(json_pack("{s:s,s:o}", "state", pal_check_state_name(worst), "checks", list));
    } else {
        json_decref(list);
        (void)printf("%s\n", worst == PALPATE_CHECK_OK ? "ready for real time"
                             : worst == PALPATE_CHECK_WARN
                                 ? "works; the warnings above cost lateness"
                                 : "real time is refused: see the remedies above");
    }
    return worst == PALPATE_CHECK_FAIL;
}
