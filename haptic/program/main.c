/// @file main.c  palpate COMMAND ...: dispatch.
#include "haptic/program/program.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

typedef struct command {
    const char *name;
    int (*run)(int argc, char **argv);
    const char *help;
} command;

static const command commands[] = {
    {"precompute", command_precompute, "SCENE [-o MODEL]: build and certify the model of a scene"},
    {"info", command_info, "MODEL: what is in it, its certificate, its cost"},
    {"press", command_press, "SCENE|MODEL --patch NAME --by X,Y,Z: force of a bonded patch"},
    {"indent", command_indent,
     "SCENE|MODEL --tool NAME --depths D1,D2,...: a rigid tool pressed in, F(d)"},
    {"run", command_run,
     "SCENE|MODEL [--for S] [--freewheel] [--record FILE] [--snapshot PNG]: feel it"},
    {"recover", command_recover, "FILE: the recording of a run that was killed"},
    {"replay", command_replay,
     "FILE [--model SCENE|MODEL]: a recording felt again; every force bit for bit?"},
    {"plot", command_plot,
     "FILE [-o PNG]: force, depth, compute time and lateness of a recording, drawn"},
    {"view", command_view, "SCENE|MODEL: the running model in a window; the mouse can be the tool"},
    {"doctor", command_doctor, "is this machine ready for real time?"},
    {"schema", command_schema, "every key of a scene"},
};
enum { EXIT_USAGE = 2 };
enum { COMMAND_COUNT = sizeof commands / sizeof commands[0] };

static void usage(FILE *out) {
    (void)fprintf(
        out, "palpate %s: real-time haptics of deformable organs\n\nusage: palpate COMMAND ...\n\n",
        pal_version());
    for (int i = 0; i < COMMAND_COUNT; i++) {
        (void)fprintf(out, "  %-11s %s\n", commands[i].name, commands[i].help);
    }
    (void)fprintf(
        out,
        "\nEvery command takes --json and --help (with an example); those given a SCENE take\n"
        "--set KEY=VALUE. Exit status: 0 success, 1 failure, 2 wrong usage, 128 + signal when\n"
        "interrupted. Start with:\n"
        "  palpate press scenes/hemisphere.yaml --patch pole --by 0,0,-0.005\n");
}

/// A standard stream that is closed would lend its number to the next file opened, and what is
/// printed would land there: give each number something, which for output refuses every write.
static void hold_standard_streams(void) {
    for (int fd = 0; fd <= 2; fd++) {
        if (fcntl(fd, F_GETFD) < 0 && errno == EBADF) {
            (void)open("/dev/null", O_RDONLY);
        }
    }
}

/// `--help` ends in argp, by exit: what it printed must have got out too.
static void at_exit(void) {
    if (print_finish(0) != 0) {
        _exit(EXIT_FAILURE);
    }
}

int main(int argc, char **argv) {
    hold_standard_streams();
    (void)atexit(at_exit);
    argp_err_exit_status = EXIT_USAGE;
    if (argc >= 2 && (strcmp(argv[1], "--version") == 0 || strcmp(argv[1], "-V") == 0)) {
        (void)printf("palpate %s\n", pal_version());
        return print_finish(0);
    }
    if (argc == 3 && strcmp(argv[1], "help") == 0) { // `help press` is `press --help`
        static char help[] = "--help";
        argv[1] = argv[2];
        argv[2] = help;
    }
    if (argc >= 2 && (strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0 ||
                      strcmp(argv[1], "help") == 0)) {
        usage(stdout);
        return print_finish(0);
    }
    for (int i = 0; argc >= 2 && i < COMMAND_COUNT; i++) {
        if (strcmp(argv[1], commands[i].name) == 0) {
            char name[64];
            (void)snprintf(name, sizeof name, "palpate %s", commands[i].name);
            argv[1] = name;
            return print_finish(commands[i].run(argc - 1, argv + 1));
        }
    }
    if (argc >= 2) {
        (void)fprintf(stderr, "palpate: no command '%s'\n\n", argv[1]);
    }
    usage(stderr);
    return EXIT_USAGE;
}
