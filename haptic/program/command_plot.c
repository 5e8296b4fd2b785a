/// @file command_plot.c  palpate plot FILE: force, depth, compute time and lateness over time, as
/// PNG.
#include "haptic/program/program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/program/targets.h"
#include "haptic/recording/replay.h"
#include "haptic/view/view.h"

enum { KEY_SIZE = 0x200, KEY_FROM, KEY_TO, CHUNK = 4096, PANELS = 4 };
enum { FORCE, DEPTH, COMPUTE, LATENESS };

typedef struct options {
    common_options common;
    const char *path, *out;
    int width, height;
    double from, to; ///< [s]; NaN: the recording's own
} options;

/// The range of one number in each column.
typedef struct band {
    double *low, *high;
} band;

typedef struct plot {
    int columns;
    double from, to; ///< [s]
    band force[PALPATE_TOOLS_MAX], depth[PALPATE_TOOLS_MAX], compute, lateness;
    uint8_t *mark;
    double *memory; ///< of all bands
    int64_t rows, faulty;
    double peak[PANELS];
} plot;

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    case 'o':
        o->out = arg;
        return 0;
    case KEY_SIZE:
        parse_size(arg, &o->width, &o->height, state);
        return 0;
    case KEY_FROM:
        o->from = parse_time(arg, "--from", 1, state);
        return 0;
    case KEY_TO:
        o->to = parse_time(arg, "--to", 1, state);
        return 0;
    default:
        return parse_recording(key, arg, state, &o->path);
    }
}

static const struct argp_option list[] = {
    {"output", 'o', "PNG", 0, "Where the picture goes (default: FILE with .png for .h5)", 1},
    {"size", KEY_SIZE, "WxH", 0, "Size of the picture (default 1280x960)", 1},
    {"from", KEY_FROM, "SECONDS", 0, "Start of the time shown (default: the recording's)", 1},
    {"to", KEY_TO, "SECONDS", 0, "End of the time shown", 1},
    {0}};
static const char doc[] =
    "Draw a recording: each tool's force and depth, compute time and lateness of the ticks over "
    "session time, as "
    "a PNG picture. A column of pixels shows the whole range of its ticks, so no spike is lost; "
    "columns with a "
    "fault are shaded red.\v"
    "Lateness below 0.1 us (all of it in freewheel) is drawn at 0.1 us.\n\n"
    "Example:\n  palpate run scenes/hemisphere.yaml --for 5 --record press.h5\n"
    "  palpate plot press.h5 -o press.png";

static void widen(band *b, int column, double value) {
    if (isfinite(value)) { // fmin and fmax take the number where the other one is NaN
        b->low[column] = fmin(b->low[column], value);
        b->high[column] = fmax(b->high[column], value);
    }
}

static void take_row(plot *p, const pal_tick_record *row, int32_t tools) {
    double time = 1e-9 * (double)row->time_ns;
    if (!(time >= p->from && time <= p->to) || row->tool < 0 || row->tool >= tools) {
        return;
    }
    double at = p->to > p->from ? (time - p->from) / (p->to - p->from) : 0.0;
    int column = (int)fmin(at * p->columns, p->columns - 1.0);
    const double *f = row->force.force;
    const double value[PANELS] = {sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]),
                                  1e3 * row->force.depth, 1e-3 * row->compute_ns,
                                  1e-3 * (double)row->lateness_ns};
    widen(&p->force[row->tool], column, value[FORCE]);
    widen(&p->depth[row->tool], column, value[DEPTH]);
    widen(&p->compute, column, value[COMPUTE]);
    widen(&p->lateness, column, fmax(value[LATENESS], 0.1));
    for (int k = 0; k < PANELS; k++) {
        p->peak[k] = fmax(p->peak[k], value[k]);
    }
    p->mark[column] |= row->fault != 0;
    p->faulty += row->fault != 0;
    p->rows++;
}

/// Time range of what is recorded, then every row into its column.
static pal_status gather(const options *o, pal_recording *recording, plot *p, pal_error *error) {
    const pal_recording_info *info = pal_recording_get_info(recording);
    pal_tick_record *row = malloc(CHUNK * sizeof *row);
    if (row == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "%s: no memory to read it", o->path);
    }
    pal_status status = PALPATE_OK;
    if (info->records == 0) {
        status =
            pal_fail(error, PALPATE_ERROR_FORMAT, "%s: it holds no tick; nothing to draw", o->path);
    } else {
        status = pal_recording_rows(recording, 0, 1, row, error);
        p->from = isnan(o->from) ? 1e-9 * (double)row[0].time_ns : o->from;
    }
    if (status == PALPATE_OK) {
        status = pal_recording_rows(recording, info->records - 1, 1, row, error);
        p->to = isnan(o->to) ? 1e-9 * (double)row[0].time_ns : o->to;
    }
    if (status == PALPATE_OK && !(p->from <= p->to)) {
        status = pal_fail(error, PALPATE_ERROR_ARGUMENT, "%s: from %g s to %g s is no time to show",
                          o->path, p->from, p->to);
    }
    for (int64_t first = 0; status == PALPATE_OK && first < info->records; first += CHUNK) {
        int64_t n = info->records - first < CHUNK ? info->records - first : CHUNK;
        status = pal_recording_rows(recording, first, n, row, error);
        for (int64_t i = 0; status == PALPATE_OK && i < n; i++) {
            take_row(p, &row[i], info->engine.tool_count);
        }
    }
    free(row);
    if (status == PALPATE_OK && p->rows == 0) {
        status = pal_fail(error, PALPATE_ERROR_ARGUMENT, "%s: no tick between %g s and %g s",
                          o->path, p->from, p->to);
    }
    return status;
}

static int make_bands(plot *p) {
    size_t n = (size_t)p->columns, bands = 2 * PALPATE_TOOLS_MAX + 2;
    p->memory = malloc(2 * bands * n * sizeof *p->memory);
    p->mark = calloc(n, 1);
    if (p->memory == NULL || p->mark == NULL) {
        return 0;
    }
    for (size_t i = 0; i < 2 * bands * n; i++) {
        p->memory[i] = (double)NAN;
    }
    double *at = p->memory;
    for (int i = 0; i < PALPATE_TOOLS_MAX; i++) {
        p->force[i] = (band){at, at + n};
        p->depth[i] = (band){at + 2 * n, at + 3 * n};
        at += 4 * n;
    }
    p->compute = (band){at, at + n};
    p->lateness = (band){at + 2 * n, at + 3 * n};
    return 1;
}

static pal_plot_series series(const band *b, int i, const char *name) {
    static const double colour[4][3] = {
        {0.75, 0.20, 0.15}, {0.15, 0.35, 0.70}, {0.15, 0.55, 0.25}, {0.60, 0.40, 0.05}};
    pal_plot_series s = {.low = b->low, .high = b->high, .name = name};
    memcpy(s.colour, colour[i % 4], sizeof s.colour);
    return s;
}

static pal_status draw(const options *o, const char *out, const pal_recording_info *info,
                       const plot *p, pal_error *error) {
    char title[512];
    pal_plot_panel panel[PANELS] = {
        {.title = "force on the tool", .unit = "N"},
        {.title = "depth below the rest surface", .unit = "mm"},
        {.title = "compute time of a tick", .unit = "\302\265s", .logarithmic = 1, .floor = 0.1},
        {.title = "lateness of a tick", .unit = "\302\265s", .logarithmic = 1, .floor = 0.1}};
    for (int t = 0; t < info->engine.tool_count; t++) {
        panel[FORCE].series[t] = series(&p->force[t], t, info->engine.tools[t].name);
        panel[DEPTH].series[t] = series(&p->depth[t], t, info->engine.tools[t].name);
    }
    panel[FORCE].series_count = panel[DEPTH].series_count = info->engine.tool_count;
    panel[COMPUTE].series[0] = series(&p->compute, 1, "");
    panel[LATENESS].series[0] = series(&p->lateness, 2, "");
    panel[COMPUTE].series_count = panel[LATENESS].series_count = 1;
    const char *base = strrchr(o->path, '/');
    (void)snprintf(title, sizeof title, "%.80s: %lld ticks%s, peak force %.3g N, deepest %.3g mm%s",
                   base != NULL ? base + 1 : o->path,
                   (long long)(p->rows / info->engine.tool_count),
                   info->freewheel ? " in freewheel" : "", p->peak[FORCE], p->peak[DEPTH],
                   p->faulty > 0 ? "; red: faults" : "");
    const pal_plot drawing = {.title = title,
                              .from = p->from,
                              .to = p->to,
                              .columns = p->columns,
                              .mark = p->mark,
                              .panel_count = PANELS,
                              .panel = panel};
    return pal_plot_write_png(out, o->width, o->height, &drawing, error);
}

/// FILE with .png in place of .h5 or .hdf5.
static void default_name(const char *path, char *out, size_t size) {
    size_t n = strlen(path);
    n -= n > 3 && strcmp(path + n - 3, ".h5") == 0     ? 3
         : n > 5 && strcmp(path + n - 5, ".hdf5") == 0 ? 5
                                                       : 0;
    (void)snprintf(out, size, "%.*s.png", (int)n, path);
}

static void print_report(const options *o, const char *out, const pal_recording_info *info,
                         const plot *p) {
    if (o->common.json) {
        print_json(json_pack("{s:o,s:o,s:i,s:i,s:I,s:i,s:f,s:f,s:f,s:f,s:f,s:f,s:I}", "file",
                             json_text(o->path), "picture", json_text(out), "width", o->width,
                             "height", o->height, "records", (json_int_t)p->rows, "tools",
                             (int)info->engine.tool_count, "from", p->from, "to", p->to,
                             "peak_force", p->peak[FORCE], "peak_depth", 1e-3 * p->peak[DEPTH],
                             "compute_us_max", p->peak[COMPUTE], "lateness_us_max",
                             p->peak[LATENESS], "faulty_records", (json_int_t)p->faulty));
    } else {
        (void)printf("%s: %.3f to %.3f s of %s, %lld records (%lld with faults); peak force %.4g "
                     "N, deepest %.4g "
                     "mm, longest tick %.4g us, latest %.4g us\n",
                     out, p->from, p->to, o->path, (long long)p->rows, (long long)p->faulty,
                     p->peak[FORCE], p->peak[DEPTH], p->peak[COMPUTE], p->peak[LATENESS]);
    }
}

int command_plot(int argc, char **argv) {
    options o = {
        .common =
            {.command = "palpate plot",
             .no_set =
                 "a recording is drawn as it is; set the key in `palpate run SCENE --record`"},
        .width = 1280,
        .height = 960,
        .from = (double)NAN,
        .to = (double)NAN};
    const struct argp_child children[] = {{&plain_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {list, parse, "FILE", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    char name[4096];
    default_name(o.path, name, sizeof name);
    const char *out = o.out != NULL ? o.out : name;
    pal_error error = {0};
    pal_recording *recording = NULL;
    plot p = {.columns = pal_plot_columns(o.width, o.height)};
    pal_status status = pal_recording_open(o.path, &recording, &error);
    if (status == PALPATE_OK) {
        status =
            target_check(o.out != NULL ? "--output" : "the picture", out, ".png", o.path, &error);
    }
    if (status == PALPATE_OK && p.columns < 16) {
        status = pal_fail(&error, PALPATE_ERROR_ARGUMENT, "--size %dx%d: too narrow to draw in",
                          o.width, o.height);
    }
    if (status == PALPATE_OK && !make_bands(&p)) {
        status = pal_fail(&error, PALPATE_ERROR_MEMORY, "%s: no memory to draw it", o.path);
    }
    if (status == PALPATE_OK) {
        status = gather(&o, recording, &p, &error);
    }
    if (status == PALPATE_OK) {
        interrupt_install(); // the picture is whole or not there
        status = draw(&o, out, pal_recording_get_info(recording), &p, &error);
    }
    int exit_status = 0;
    if (status == PALPATE_OK) {
        print_report(&o, out, pal_recording_get_info(recording), &p);
    } else {
        exit_status = report_error(&o.common, status, &error);
    }
    if (exit_status == 0 && interrupt_signal() != 0) {
        exit_status = 128 + interrupt_signal();
    }
    free(p.memory);
    free(p.mark);
    pal_recording_close(recording);
    return exit_status;
}
