#include "tests/support/program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

static char *slurp(FILE *f) {
    size_t n = 0, capacity = 4096;
    char *text = malloc(capacity);
    for (;;) {
        n += fread(text + n, 1, capacity - n - 1, f);
        if (n + 1 < capacity) {
            break;
        }
        text = realloc(text, capacity *= 2);
    }
    text[n] = '\0';
    return text;
}

program_result program_run(const char *arguments) {
    program_result r = {.status = -1};
    char path[] = "/tmp/palpate-stderr-XXXXXX", command[8192];
    int fd = mkstemp(path);
    const char *program = getenv("PALPATE");
    (void)snprintf(command, sizeof command, "exec %s %s 2>%s", program ? program : "build/palpate",
                   arguments, path);
    FILE *p = popen(command, "r");
    if (p != NULL) {
        r.out = slurp(p);
        int status = pclose(p);
        r.status = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
    }
    FILE *e = fdopen(fd, "r");
    r.error = slurp(e);
    (void)fclose(e);
    (void)unlink(path);
    r.json = r.out != NULL ? json_loads(r.out, 0, NULL) : NULL;
    return r;
}

void program_clear(program_result *r) {
    free(r->out);
    free(r->error);
    json_decref(r->json);
    memset(r, 0, sizeof *r);
}

const char *program_source(void) {
    const char *s = getenv("PALPATE_SOURCE");
    return s != NULL ? s : ".";
}

double program_number(const json_t *object, const char *path) {
    char step[128];
    while (*path != '\0' && object != NULL) {
        size_t n = strcspn(path, ".");
        (void)snprintf(step, sizeof step, "%.*s", (int)n, path);
        object = json_is_array(object) ? json_array_get(object, (size_t)atoi(step))
                                       : json_object_get(object, step);
        path += n + (path[n] == '.');
    }
    return json_is_number(object)    ? json_number_value(object)
           : json_is_boolean(object) ? json_boolean_value(object)
                                     : (double)NAN;
}
