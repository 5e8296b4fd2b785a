/// @file trajectory.c  Trajectory CSV and interpolation (format and mathematics: trajectory.h).
#include "haptic/device/trajectory.h"

#include <errno.h>
#include <fcntl.h>
#include <locale.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

#include "haptic/base/error.h"
#include "haptic/base/pose.h"

enum { FIELDS = 9 };
static const char *const field_name[FIELDS] = {"time", "x",  "y",  "z",     "qw",
                                               "qx",   "qy", "qz", "button"};
static const char header[] = "time,x,y,z,qw,qx,qy,qz,button";
/// A day at 1 kHz is 10 GB of text; a file beyond this is a mistake, not a trajectory.
static const int64_t size_max = INT64_C(1) << 30;

/// Where the reader stands.
typedef struct cursor {
    const char *name, *begin, *end; ///< text [begin, end)
    const char *line_begin, *line_end;
    int64_t line;
    locale_t c_locale;
} cursor;

/// A piece of the file for a message: at most 40 bytes, unprintable ones as '?'.
static const char *quoted(const char *from, const char *to, char out[48]) {
    size_t n = (size_t)(to - from);
    size_t keep = n > 40 ? 37 : n;
    for (size_t i = 0; i < keep; i++) {
        unsigned char c = (unsigned char)from[i];
        out[i] = (c >= 32 && c < 127) ? (char)c : '?';
    }
    memcpy(out + keep, n > 40 ? "..." : "", n > 40 ? 4 : 1);
    return out;
}

static pal_status fail_at(const cursor *c, const char *at, pal_error *error, const char *key,
                          const char *from, const char *to, const char *allowed) {
    char found[48];
    return pal_fail(error, PALPATE_ERROR_SCENE, "%s:%lld:%lld: %s: found '%s', allowed: %s",
                    c->name, (long long)c->line, (long long)(at - c->line_begin) + 1, key,
                    quoted(from, to, found), allowed);
}

/// Step to the next line that holds something. @return 0 at the end of the text.
static int next_line(cursor *c) {
    while (c->begin < c->end) {
        const char *eol = memchr(c->begin, '\n', (size_t)(c->end - c->begin));
        c->line_begin = c->begin;
        c->line_end = eol != NULL ? eol : c->end;
        c->begin = eol != NULL ? eol + 1 : c->end;
        c->line++;
        if (c->line_end > c->line_begin && c->line_end[-1] == '\r') {
            c->line_end--;
        }
        const char *p = c->line_begin;
        while (p < c->line_end && (*p == ' ' || *p == '\t')) {
            p++;
        }
        if (p < c->line_end && *p != '#') {
            return 1;
        }
    }
    return 0;
}

static void trim(const char **from, const char **to) {
    while (*from < *to && (**from == ' ' || **from == '\t')) {
        (*from)++;
    }
    while (*to > *from && ((*to)[-1] == ' ' || (*to)[-1] == '\t')) {
        (*to)--;
    }
}

/// One decimal number filling [from, to): no hex, no inf, no nan, no rest.
static int parse_number(const cursor *c, const char *from, const char *to, double *value) {
    char text[64];
    size_t n = (size_t)(to - from);
    if (n == 0 || n >= sizeof text) {
        return 0;
    }
    for (size_t i = 0; i < n; i++) {
        char ch = from[i];
        if (!((ch >= '0' && ch <= '9') || ch == '+' || ch == '-' || ch == '.' || ch == 'e' ||
              ch == 'E')) {
            return 0;
        }
    }
    memcpy(text, from, n);
    text[n] = 0;
    char *rest = NULL;
    *value = strtod_l(text, &rest, c->c_locale);
    return rest == text + n && isfinite(*value);
}

static pal_status parse_header(cursor *c, pal_error *error) {
    if (!next_line(c)) {
        return pal_fail(error, PALPATE_ERROR_SCENE,
                        "%s:1:1: header: found an empty file, allowed: '%s'", c->name, header);
    }
    const char *p = c->line_begin;
    if (c->line_end - p >= 3 && memcmp(p, "\xEF\xBB\xBF", 3) == 0) { // byte order mark
        p += 3;
    }
    for (int f = 0; f < FIELDS; f++) {
        const char *comma = memchr(p, ',', (size_t)(c->line_end - p));
        const char *from = p, *to = comma != NULL ? comma : c->line_end;
        trim(&from, &to);
        size_t n = strlen(field_name[f]);
        int last = f == FIELDS - 1;
        if ((size_t)(to - from) != n || memcmp(from, field_name[f], n) != 0 ||
            (comma == NULL) != last) {
            return fail_at(c, from, error, "header", c->line_begin, c->line_end, header);
        }
        p = comma != NULL ? comma + 1 : c->line_end;
    }
    return PALPATE_OK;
}

static pal_status parse_sample(const cursor *c, const pal_sample *before, pal_sample *out,
                               pal_error *error) {
    double v[FIELDS] = {0};
    const char *at[FIELDS] = {0};
    const char *p = c->line_begin;
    for (int f = 0; f < FIELDS; f++) {
        const char *comma = memchr(p, ',', (size_t)(c->line_end - p));
        const char *from = p, *to = comma != NULL ? comma : c->line_end;
        trim(&from, &to);
        at[f] = from;
        if (!parse_number(c, from, to, &v[f])) {
            return fail_at(c, from, error, field_name[f], from, to, "a finite decimal number");
        }
        if (comma == NULL && f < FIELDS - 1) {
            return fail_at(c, c->line_end, error, field_name[f + 1], c->line_end, c->line_end,
                           "nine fields a line: time,x,y,z,qw,qx,qy,qz,button");
        }
        if (comma != NULL && f == FIELDS - 1) {
            return fail_at(c, comma, error, "line", comma, c->line_end,
                           "nothing after the ninth field, button");
        }
        p = comma != NULL ? comma + 1 : c->line_end;
    }
    if (v[0] < 0.0 || (before != NULL && !(v[0] > before->time))) {
        return fail_at(c, at[0], error, "time", at[0], at[1] - 1,
                       "seconds >= 0, strictly increasing from line to line");
    }
    for (int f = 1; f <= 3; f++) {
        if (fabs(v[f]) > 1e6) {
            return fail_at(c, at[f], error, field_name[f], at[f], at[f + 1] - 1,
                           "metres within 1e6");
        }
    }
    double norm = sqrt(v[4] * v[4] + v[5] * v[5] + v[6] * v[6] + v[7] * v[7]);
    if (!(fabs(norm - 1.0) <= 1e-3)) {
        return fail_at(c, at[4], error, "qw,qx,qy,qz", at[4], at[8] - 1,
                       "a unit quaternion, w first (length within 1e-3 of 1)");
    }
    if (v[8] < 0.0 || v[8] > 4294967295.0 || v[8] != floor(v[8])) {
        return fail_at(c, at[8], error, "button", at[8], c->line_end,
                       "a whole number, 0..4294967295");
    }
    out->time = v[0];
    memcpy(out->position, v + 1, sizeof out->position);
    for (int k = 0; k < 4; k++) {
        out->orientation[k] = v[4 + k] / norm;
    }
    out->buttons = (uint32_t)v[8];
    return PALPATE_OK;
}

static pal_status parse_all(cursor *c, pal_trajectory *out, pal_error *error) {
    pal_status status = parse_header(c, error);
    int64_t capacity = 0;
    while (status == PALPATE_OK && next_line(c)) {
        if (out->count == capacity) {
            capacity = capacity == 0 ? 256 : 2 * capacity;
            pal_sample *more = realloc(out->sample, (size_t)capacity * sizeof *more);
            if (more == NULL) {
                return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory for %lld samples",
                                c->name, (long long)capacity);
            }
            out->sample = more;
        }
        const pal_sample *before = out->count > 0 ? &out->sample[out->count - 1] : NULL;
        status = parse_sample(c, before, &out->sample[out->count], error);
        out->count += status == PALPATE_OK;
    }
    if (status == PALPATE_OK && out->count == 0) {
        status =
            pal_fail(error, PALPATE_ERROR_SCENE,
                     "%s:%lld:1: samples: found none after the header, allowed: one or more lines",
                     c->name, (long long)c->line + 1);
    }
    return status;
}

pal_status pal_trajectory_parse(const char *name, const char *text, size_t size,
                                pal_trajectory *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    cursor c = {
        .name = name, .begin = text, .end = text + size, .line_begin = text, .line_end = text};
    c.c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (c.c_locale == (locale_t)0) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory for the C locale", name);
    }
    pal_status status = parse_all(&c, out, error);
    freelocale(c.c_locale);
    if (status != PALPATE_OK) {
        pal_trajectory_clear(out);
    }
    return status;
}

/// The whole file into memory (regular files only: a device or pipe could be endless).
static pal_status read_file(const char *path, char **text, size_t *size, pal_error *error) {
    int fd = open(path, O_RDONLY | O_CLOEXEC | O_NONBLOCK);
    struct stat st;
    if (fd < 0 || fstat(fd, &st) != 0) {
        int why = errno;
        if (fd >= 0) {
            close(fd);
        }
        return pal_fail(error, PALPATE_ERROR_IO, "trajectory '%s': %s", path, strerror(why));
    }
    if (!S_ISREG(st.st_mode) || st.st_size > size_max) {
        close(fd);
        return pal_fail(error, PALPATE_ERROR_IO,
                        "trajectory '%s': %s; give a CSV file of at most 1 GiB", path,
                        S_ISREG(st.st_mode) ? "the file is too large" : "not a regular file");
    }
    char *buffer = malloc((size_t)st.st_size + 1);
    if (buffer == NULL) {
        close(fd);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "trajectory '%s': no memory for %lld bytes",
                        path, (long long)st.st_size);
    }
    size_t have = 0;
    while (have < (size_t)st.st_size) {
        ssize_t n = read(fd, buffer + have, (size_t)st.st_size - have);
        if (n < 0 && errno == EINTR) {
            continue;
        }
        if (n < 0) {
            int why = errno;
            free(buffer);
            close(fd);
            return pal_fail(error, PALPATE_ERROR_IO, "trajectory '%s': %s", path, strerror(why));
        }
        if (n == 0) {
            break; // it shrank meanwhile: take what is there
        }
        have += (size_t)n;
    }
    close(fd);
    *text = buffer;
    *size = have;
    return PALPATE_OK;
}

pal_status pal_trajectory_load(const char *path, pal_trajectory *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    char *text = NULL;
    size_t size = 0;
    pal_status status = read_file(path, &text, &size, error);
    if (status == PALPATE_OK) {
        status = pal_trajectory_parse(path, text, size, out, error);
        free(text);
    }
    return status;
}

void pal_trajectory_clear(pal_trajectory *trajectory) {
    free(trajectory->sample);
    memset(trajectory, 0, sizeof *trajectory);
}

void pal_trajectory_at(const pal_trajectory *trajectory, double time, pal_tool_state *state) {
    const pal_sample *s = trajectory->sample;
    int64_t low = 0, high = trajectory->count; // last sample with s[low].time <= time, if any
    while (high - low > 1) {
        int64_t middle = low + (high - low) / 2;
        if (s[middle].time <= time) {
            low = middle;
        } else {
            high = middle;
        }
    }
    memset(state, 0, sizeof *state);
    state->buttons = s[low].buttons;
    if (time <= s[low].time || low == trajectory->count - 1) {
        memcpy(state->position, s[low].position, sizeof state->position);
        memcpy(state->orientation, s[low].orientation, sizeof state->orientation);
        return;
    }
    double w = (time - s[low].time) / (s[low + 1].time - s[low].time);
    for (int k = 0; k < 3; k++) {
        state->position[k] = (1.0 - w) * s[low].position[k] + w * s[low + 1].position[k];
    }
    pal_quat_slerp(s[low].orientation, s[low + 1].orientation, w, state->orientation);
}

pal_status pal_trajectory_write(const pal_trajectory *trajectory, FILE *file, pal_error *error) {
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (c_locale == (locale_t)0) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "trajectory: no memory for the C locale");
    }
    locale_t old = uselocale(c_locale);
    fprintf(file, "%s\n", header);
    for (int64_t i = 0; i < trajectory->count; i++) {
        const pal_sample *s = &trajectory->sample[i];
        fprintf(file, "%.9g,%.8g,%.8g,%.8g,%.9g,%.9g,%.9g,%.9g,%u\n", s->time,
                round(1e8 * s->position[0]) / 1e8 + 0.0, round(1e8 * s->position[1]) / 1e8,
                round(1e8 * s->position[2]) / 1e8 + 0.0, s->orientation[0], s->orientation[1],
                s->orientation[2], s->orientation[3], (unsigned)s->buttons);
    }
    uselocale(old);
    freelocale(c_locale);
    if (ferror(file) || fflush(file) != 0) {
        return pal_fail(error, PALPATE_ERROR_IO, "trajectory: cannot be written: %s",
                        strerror(errno));
    }
    return PALPATE_OK;
}
