/// @file program.h  Running the `palpate` program in a test and reading what it says.
#ifndef PALPATE_TESTS_PROGRAM_H
#define PALPATE_TESTS_PROGRAM_H

#include <jansson.h>

typedef struct program_result {
    int status;   ///< exit status; 128 + signal when killed
    char *out;    ///< standard output
    char *error;  ///< standard error
    json_t *json; ///< standard output parsed, NULL when it is not one JSON object
} program_result;

/// Run `palpate ARGUMENTS` (words split by the shell) with $PALPATE from the environment.
program_result program_run(const char *arguments);
void program_clear(program_result *r);

/// Path of the project's source tree ($PALPATE_SOURCE, else ".").
const char *program_source(void);

/// Number at a dotted path of an object ("certificate.pass", "force.2"); NaN when absent.
double program_number(const json_t *object, const char *path);

#endif
