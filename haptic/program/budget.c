/// @file budget.c  From a budget to settings: measure, predict, pick, build, check.
///
/// Two pilot models per method, with all spacings 2 and 1.26 times the scene's (1.26 and 0.8 in
/// thin bodies, and where the coarser has not fewer nodes: see LEVEL), are built and ticked by the
/// scene's own tool. Counts (nodes, columns, rows, touched nodes) and the estimated error are power
/// laws y = a f^b of the spacing factor f through both pilots; beyond the finer one b is the mean
/// of what the pilots say and what a uniform cloud would have (3 for nodes, 2 for surface nodes),
/// as graded clouds lie between. The force stage's p99 against touched nodes is measured on the
/// finer pilot with tools of growing radius, the field follows from its bytes and this machine's
/// measured seconds per byte (haptic/engine/cost.h), offline seconds go with nodes^1.8
/// (bench/offline). Candidates: method x spacing factor x stored rows x precision x who computes
/// the field. What the pick is the best of: BUDGET_RULE in budget.h; errors below half a per cent
/// count as equal, as a hand tells forces apart from several per cent on. The model is built and
/// measured; what it misses corrects the prediction of its kind and the next pick is tried.
#include "haptic/program/budget.h"

#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/engine/cost.h"
#include "haptic/base/error.h"
#include "haptic/model/model.h"

enum {
    METHODS = 2,
    PILOTS = 2,
    SWELLS = 3,
    FACTORS = 10,
    ROWS = 3,
    FORMS = 3,
    BYS = 2,
    ROUNDS = 5,
    REASON = 512,
    CANDIDATES = METHODS * FACTORS * ROWS * FORMS * BYS
};
/// How the rows are stored: as the scene asks, in 16 bits, or compressed to a tolerance.
enum { AS_ASKED, IN_16_BITS, COMPRESSED };
static const char *const method_name[METHODS] = {"cell", "galerkin"};
static const char *const rows_name[ROWS] = {"none", "surface", "all"};
static const char *const precision_name[4] = {"double", "single", "half", "scaled"};
static const char *const by_name[BYS] = {"servo", "render"};
/// Where a body is too thin for twice its spacing, pilots are finer.
enum { PILOT_SETS = 2 };
static const double pilot_factors[PILOT_SETS][PILOTS] = {{2.0, 1.26}, {1.26, 0.8}};
/// A surface too curved for twice its spacing is meshed finer than asked: a coarse pilot with more
/// than this share of the finer one's nodes (uniform clouds: 0.25 to 0.4) has no slope to tell.
static const double LEVEL = 0.8;
static const double TOLERANCE = 1e-3;
/// What a search may build: beyond this, ask by hand.
static const double NODES_MAX = 40000.0, SECONDS_MAX = 120.0;
static const double ERROR_FLOOR = 0.005;
static const double swells[SWELLS] = {1.0, 3.0, 9.0};

// ---- Reading ------------------------------------------------------------------------------------

int budget_parse(const char *text, budget *out) {
    static const struct {
        const char *unit;
        int kind; ///< 0 time [us], 1 bytes, 2 error
        double scale;
    } units[] = {{"us", 0, 1.0}, {"ms", 0, 1e3}, {"s", 0, 1e6},  {"B", 1, 1.0},
                 {"kB", 1, 1e3}, {"MB", 1, 1e6}, {"GB", 1, 1e9}, {"%", 2, 0.01}};
    char *end = NULL;
    double v = strtod(text, &end);
    if (end == text || !isfinite(v) || !(v > 0.0)) {
        return 0;
    }
    for (size_t k = 0; k < sizeof units / sizeof *units; k++) {
        if (strcmp(end, units[k].unit) == 0) {
            double *place = units[k].kind == 0   ? &out->tick_us
                            : units[k].kind == 1 ? &out->bytes
                                                 : &out->error;
            *place = v * units[k].scale;
            return 1;
        }
    }
    return 0;
}

// ---- Pilots -------------------------------------------------------------------------------------

typedef struct pilot {
    double nodes, columns, surface, inside, contacts, most, force_us, seconds,
        error; ///< error < 0: none
} pilot;

typedef struct candidate {
    int method, rows, by, form;
    pal_precision precision;
    double factor;
    double nodes, bytes, tick_us, seconds, error; ///< predicted; error < 0: unknown
    int tried;
} candidate;

typedef struct search {
    const char *scene;
    const common_options *options;
    const budget *wanted;
    pal_cost_machine machine;
    pilot pilots[METHODS][PILOTS];
    const double *pilot_factor;
    int has[METHODS];
    char why_not[METHODS][REASON];
    double less_field[METHODS],
        less_bytes[METHODS]; ///< compressed / as asked, finer pilot; 0: not compressed
    double touched[METHODS][SWELLS], force_us[METHODS][SWELLS]; ///< of the finer pilot
    int asked_rows;
    pal_precision asked_precision;
    double period_us;
    candidate all[CANDIDATES];
    int count;
    double correct_tick[METHODS][BYS], correct_error[METHODS], correct_bytes;
} search;

/// Load the scene with a candidate's settings, scale it and build it.
static pal_status build(search *s, const char *const extra[], int extra_count, double factor,
                        source *out, pal_error *error) {
    const offline_api *offline = offline_open(error);
    const char *set[OVERRIDES_MAX + 8];
    int count = 0;
    for (; count < s->options->override_count; count++) {
        set[count] = s->options->overrides[count];
    }
    for (int k = 0; k < extra_count; k++) {
        set[count++] = extra[k];
    }
    memset(out, 0, sizeof *out);
    pal_status status = offline->scene_load(s->scene, set, count, &out->scene, error);
    if (status == PALPATE_OK && factor != 1.0) {
        status = offline->scene_scale_spacing(out->scene, factor, error);
    }
    if (status == PALPATE_OK) {
        pal_progress progress = progress_line(s->options);
        status =
            offline->precompute_cached(out->scene, &progress, &out->model, &out->was_cached, error);
        progress_end();
    }
    out->passed = 1;
    if (status != PALPATE_OK) {
        source_close(out);
    }
    return status;
}

static void say(const search *s, const char *format, ...) __attribute__((format(printf, 2, 3)));
static void say(const search *s, const char *format, ...) {
    if (!s->options->quiet) {
        va_list args;
        va_start(args, format);
        (void)vfprintf(stderr, format, args);
        va_end(args);
    }
}

/// What compressing to TOLERANCE saves on the finer pilot (larger bodies save more). Failing is no
/// error.
static void measure_compressed(search *s, int method, const pal_model *plain, double field_us) {
    char set[2][64];
    const char *extra[] = {set[0], set[1]};
    source p;
    pal_cost_ticks ticks;
    pal_error why = {0};
    (void)snprintf(set[0], sizeof set[0], "method.kind=%s", method_name[method]);
    (void)snprintf(set[1], sizeof set[1], "store.tolerance=%g", TOLERANCE);
    s->less_field[method] = s->less_bytes[method] = 0.0;
    double bytes = (double)pal_model_row_bytes(plain);
    if (!(bytes > 0.0) || plain->info.field_tolerance > 0.0 || !(field_us > 0.0) ||
        build(s, extra, 2, s->pilot_factor[PILOTS - 1], &p, &why) != PALPATE_OK) {
        say(s, "pilot: not compressed: %s\n", why.message);
        return;
    }
    if (pal_cost_of_ticks(p.model, 1.0, 2, &ticks, &why) == PALPATE_OK) {
        s->less_field[method] = ticks.field_us.p50 / field_us;
        s->less_bytes[method] = (double)pal_model_row_bytes(p.model) / bytes;
        say(s, "pilot: compressed to %g: %.2f of the bytes, %.2f of the field's time\n", TOLERANCE,
            s->less_bytes[method], s->less_field[method]);
    }
    source_close(&p);
}

static pal_status measure_pilot(search *s, int method, int k, pal_error *error) {
    char set[64];
    const char *extra[] = {set};
    source p;
    pal_cost_ticks ticks;
    (void)snprintf(set, sizeof set, "method.kind=%s", method_name[method]);
    pal_status status = build(s, extra, 1, s->pilot_factor[k], &p, error);
    if (status != PALPATE_OK) {
        return status;
    }
    const pal_model_info *i = &p.model->info;
    status = pal_cost_of_ticks(p.model, 1.0, k + 1, &ticks, error);
    for (int w = 0; w < SWELLS && k == PILOTS - 1 && status == PALPATE_OK; w++) {
        pal_cost_ticks wide = ticks;
        if (w > 0) {
            status = pal_cost_of_ticks(p.model, swells[w], 2, &wide, error);
        }
        s->touched[method][w] = wide.most;
        s->force_us[method][w] = wide.force_us.p99;
    }
    if (status == PALPATE_OK) {
        s->pilots[method][k] = (pilot){.nodes = i->node_count,
                                       .columns = i->column_count,
                                       .surface = i->surface_count,
                                       .inside = i->node_count - i->fixed_count,
                                       .contacts = ticks.contacts,
                                       .most = ticks.most,
                                       .force_us = ticks.force_us.p99,
                                       .seconds = i->seconds.total,
                                       .error = i->certificate.estimated_error};
        s->asked_precision = i->precision;
        s->asked_rows = i->row_count == 0 ? 0 : i->row_count > i->surface_count ? 2 : 1;
        s->period_us = 1e6 / pal_model_runtime(p.model)->servo_rate;
        say(s,
            "pilot: %s, spacings x %.2f: %d nodes, %d columns, %.1f touched nodes, force %.1f us, "
            "%.2f s\n",
            method_name[method], s->pilot_factor[k], i->node_count, i->column_count, ticks.contacts,
            ticks.force_us.p99, i->seconds.total);
        if (k == PILOTS - 1) {
            measure_compressed(s, method, p.model, ticks.field_us.p50);
        }
    }
    source_close(&p);
    return status;
}

static pal_status measure_pilots(search *s, int method, pal_error *error) {
    pal_status status = measure_pilot(s, method, 0, error);
    return status == PALPATE_OK ? measure_pilot(s, method, 1, error) : status;
}

/// y at factor f: the power law through both pilots, beyond them with the mean of its exponent and
/// that of a uniform cloud.
static double law(const double pilot_factor[PILOTS], double coarse, double fine, double f,
                  double uniform) {
    if (!(coarse > 0.0) || !(fine > 0.0)) {
        return fmax(coarse, fine);
    }
    double b = log(coarse / fine) / log(pilot_factor[0] / pilot_factor[1]);
    return fine * pow(f / pilot_factor[1], f < pilot_factor[1] ? 0.5 * (b + uniform) : b);
}

#define LAW(field, uniform) law(s->pilot_factor, p[0].field, p[1].field, c->factor, uniform)

/// Force stage's p99 for `most` touched nodes: piecewise straight in logarithms through what was
/// measured, beyond it with the last slope, at least 1.
static double force_time(const search *s, int method, double most) {
    const double *x = s->touched[method], *y = s->force_us[method];
    int k = 1;
    while (k < SWELLS - 1 && most > x[k]) {
        k++;
    }
    if (!(x[k] > x[k - 1])) { // a point, or a body too small for a larger tool
        return y[0] * fmax(1.0, most / fmax(1.0, x[0]));
    }
    double slope = log(y[k] / y[k - 1]) / log(x[k] / x[k - 1]);
    slope = most > x[SWELLS - 1] ? fmax(1.0, slope) : slope;
    return y[k] * pow(fmax(1.0, most) / x[k], slope);
}

/// Relative error of a displacement by how its rows are stored: half has 2^-11, scaled a third of
/// that at most (bench/compress), compressed rows what was allowed; single and double are below all
/// else.
static double rounding_of(const candidate *c) {
    return c->form == COMPRESSED                      ? TOLERANCE
           : c->precision == PALPATE_PRECISION_HALF   ? 0x1p-11
           : c->precision == PALPATE_PRECISION_SCALED ? 1.5e-4
                                                      : 0.0;
}

static void predict(const search *s, candidate *c) {
    const pilot *p = s->pilots[c->method];
    double columns = LAW(columns, -2.0), surface = LAW(surface, -2.0), inside = LAW(inside, -3.0);
    double rows = c->rows == 0 ? 0.0 : c->rows == 1 ? surface : inside;
    double most = LAW(most, -2.0), force = force_time(s, c->method, most);
    int packed = c->form == COMPRESSED;
    double field = (packed ? s->less_field[c->method] : 1.0) *
                   (1e6 * pal_cost_field(&s->machine, c->precision, most, rows));
    double row_bytes = (packed ? s->less_bytes[c->method] : 1.0) * 9.0 * columns * rows *
                       (double)pal_precision_size(c->precision);
    c->nodes = LAW(nodes, -3.0);
    c->seconds = p[1].seconds * pow(c->nodes / p[1].nodes, 1.8);
    c->bytes = s->correct_bytes * (72.0 * columns * columns + row_bytes);
    c->tick_us = s->correct_tick[c->method][c->by] * (force + (c->by == 0 ? field : 0.0));
    double rounding = rows > 0.0 ? rounding_of(c) : 0.0;
    // a coarse pilot has no second, still coarser cloud in a thin body: the error then goes with
    // the spacing
    double error = p[1].error < 0.0   ? -1.0
                   : p[0].error < 0.0 ? p[1].error * c->factor / s->pilot_factor[1]
                                      : LAW(error, 1.0);
    c->error = error < 0.0 ? -1.0 : s->correct_error[c->method] * error + rounding;
}

// ---- Picking ------------------------------------------------------------------------------------

static int fits(const search *s, const candidate *c) {
    const budget *b = s->wanted;
    return !c->tried && c->nodes <= NODES_MAX && c->seconds <= SECONDS_MAX &&
           (b->tick_us <= 0.0 || c->tick_us <= b->tick_us) &&
           (b->bytes <= 0.0 || c->bytes <= b->bytes) &&
           (b->error <= 0.0 || (c->error >= 0.0 && c->error <= b->error));
}

/// 1 when a is the better pick of two that fit.
static int better(const search *s, const candidate *a, const candidate *b) {
    const budget *w = s->wanted;
    if (a->rows != b->rows) { // never less to see than asked for, where it can be had
        return a->rows > b->rows;
    }
    double busy = 0.5 * s->period_us; // the servo keeps the field while half the period is left
    int a_full = a->by == 0 && a->tick_us > busy, b_full = b->by == 0 && b->tick_us > busy;
    if (w->tick_us <= 0.0 && a_full != b_full) {
        return b_full;
    }
    if (w->tick_us <= 0.0 && w->bytes <= 0.0) { // error alone: the cheapest that meets it
        if (a->by != b->by) {
            return a->by < b->by;
        }
        return a->tick_us < b->tick_us;
    }
    double ea = a->error >= 0.0 ? fmax(ERROR_FLOOR, a->error) : a->factor;
    double eb = b->error >= 0.0 ? fmax(ERROR_FLOOR, b->error) : b->factor;
    if (fabs(ea - eb) > 0.02 * fmax(ea, eb)) {
        return ea < eb;
    }
    if (a->by != b->by) {
        return a->by < b->by;
    }
    if (a->form != b->form) {
        return a->form < b->form;
    }
    return a->seconds < b->seconds;
}

static void enumerate(search *s) {
    s->count = 0;
    for (int m = 0; m < METHODS; m++) {
        for (int f = 0; f < FACTORS && s->has[m]; f++) {
            for (int r = s->asked_rows; r >= 0; r--) {
                for (int k = 0; k < (r == 0 ? 1 : FORMS * BYS); k++) {
                    int form = k % FORMS;
                    if ((form == IN_16_BITS && s->asked_precision >= PALPATE_PRECISION_HALF) ||
                        (form == COMPRESSED && !(s->less_bytes[m] > 0.0))) {
                        continue; // 16 bits already, or nothing to compress
                    }
                    s->all[s->count++] =
                        (candidate){.method = m,
                                    .rows = r,
                                    .by = k / FORMS,
                                    .form = form,
                                    .factor = 2.0 * pow(2.0, -f / 3.0),
                                    .precision = form == IN_16_BITS ? PALPATE_PRECISION_SCALED
                                                                    : s->asked_precision};
                }
            }
        }
    }
}

/// The best that fits, or NULL; counts those that do.
static candidate *pick(search *s, int *fitting) {
    candidate *best = NULL;
    *fitting = 0;
    for (int k = 0; k < s->count; k++) {
        predict(s, &s->all[k]);
        if (fits(s, &s->all[k])) {
            ++*fitting;
            if (best == NULL || better(s, &s->all[k], best)) {
                best = &s->all[k];
            }
        }
    }
    return best;
}

static const char *form_name(const candidate *c) {
    return c->form == COMPRESSED ? "compressed to 0.001" : precision_name[c->precision];
}

static void describe(const candidate *c, char *out, size_t size) {
    (void)snprintf(out, size, "method %s, spacings x %.2f, rows %s in %s, field by the %s",
                   method_name[c->method], c->factor, rows_name[c->rows], form_name(c),
                   by_name[c->by]);
}

/// How far over the budget, the largest ratio; what the refusal names.
static double excess(const search *s, const candidate *c, const char **what) {
    const budget *b = s->wanted;
    double worst = 0.0;
    const double ratio[3] = {
        b->tick_us > 0.0 ? c->tick_us / b->tick_us : 0.0,
        b->bytes > 0.0 ? c->bytes / b->bytes : 0.0,
        b->error > 0.0 ? (c->error >= 0.0 ? c->error / b->error : (double)INFINITY) : 0.0};
    static const char *const name[3] = {"time", "bytes", "error"};
    for (int k = 0; k < 3; k++) {
        if (ratio[k] > worst) {
            worst = ratio[k];
            *what = name[k];
        }
    }
    return worst;
}

static pal_status refuse(const search *s, pal_error *error) {
    const candidate *nearest = NULL;
    double least = INFINITY;
    const char *what = "";
    for (int k = 0; k < s->count; k++) {
        const candidate *c = &s->all[k];
        double e = excess(s, c, &what);
        if (c->nodes <= NODES_MAX && c->seconds <= SECONDS_MAX && e < least) {
            least = e;
            nearest = c;
        }
    }
    if (nearest == NULL) {
        return s->wanted->error > 0.0 && s->count > 0
                   ? pal_fail(error, PALPATE_ERROR_ARGUMENT,
                              "--budget of an error: nothing estimates it: the scene needs "
                              "body.patches and "
                              "estimate: true")
                   : pal_fail(error, PALPATE_ERROR_ARGUMENT,
                              "--budget: no method could be tried: cell: %.180s; galerkin: %.180s",
                              s->why_not[0], s->why_not[1]);
    }
    char settings[160], e[32] = "unknown";
    describe(nearest, settings, sizeof settings);
    (void)excess(s, nearest, &what);
    if (nearest->error >= 0.0) {
        (void)snprintf(e, sizeof e, "%.2g %%", 100.0 * nearest->error);
    }
    return pal_fail(
        error, PALPATE_ERROR_ARGUMENT,
        "--budget: none of %d settings fits; the nearest (%s) needs %.3g us a tick and %.3g MB "
        "with an "
        "error of %s, %.3g times the %s allowed (tried are spacings from 2 times the scene's down "
        "to "
        "0.25, up to 40 000 nodes and 2 minutes offline): allow more, or narrow body.touchable",
        s->count, settings, nearest->tick_us, 1e-6 * nearest->bytes, e, excess(s, nearest, &what),
        what);
}

// ---- Building and checking ----------------------------------------------------------------------

typedef struct measured {
    double tick_us, bytes, error;
} measured;

static pal_status try_candidate(search *s, candidate *c, source *out, measured *m,
                                pal_error *error) {
    char set[5][64];
    const char *extra[5];
    int sets = c->form == COMPRESSED ? 5 : 4;
    (void)snprintf(set[0], sizeof set[0], "method.kind=%s", method_name[c->method]);
    (void)snprintf(set[1], sizeof set[1], "store.displacement=%s", rows_name[c->rows]);
    (void)snprintf(set[2], sizeof set[2], "store.precision=%s", precision_name[c->precision]);
    (void)snprintf(set[3], sizeof set[3], "render.field=%s", by_name[c->by]);
    (void)snprintf(set[4], sizeof set[4], "store.tolerance=%g", TOLERANCE);
    for (int k = 0; k < sets; k++) {
        extra[k] = set[k];
    }
    c->tried = 1;
    pal_status status = build(s, extra, sets, c->factor, out, error);
    if (status != PALPATE_OK) {
        return status;
    }
    pal_cost_ticks ticks;
    status = pal_cost_of_ticks(out->model, 1.0, 3, &ticks, error);
    if (status != PALPATE_OK) {
        source_close(out);
        return status;
    }
    const pal_model_info *i = &out->model->info;
    m->tick_us = c->by == 0 ? ticks.tick_us.p99 : ticks.render_us.p99;
    m->bytes = (double)i->bytes;
    m->error = i->certificate.estimated_error < 0.0
                   ? -1.0
                   : i->certificate.estimated_error + (c->rows > 0 ? rounding_of(c) : 0.0);
    return PALPATE_OK;
}

/// 1 when the built model keeps to the budget; what it misses corrects the predictions of its kind.
static int keeps(search *s, const candidate *c, const measured *m) {
    const budget *b = s->wanted;
    int ok = 1;
    if (b->tick_us > 0.0 && m->tick_us > b->tick_us) {
        s->correct_tick[c->method][c->by] *= m->tick_us / c->tick_us;
        ok = 0;
    }
    if (b->bytes > 0.0 && m->bytes > b->bytes) {
        s->correct_bytes *= m->bytes / c->bytes;
        ok = 0;
    }
    if (b->error > 0.0 && !(m->error >= 0.0 && m->error <= b->error)) {
        s->correct_error[c->method] *= m->error > c->error ? m->error / c->error : 1.05;
        ok = 0;
    }
    return ok;
}

static json_t *number_or_null(double v) {
    return v >= 0.0 ? json_real(v) : json_null();
}

static json_t *make_account(const search *s, const candidate *c, const measured *m, int fitting,
                            int rounds) {
    const budget *b = s->wanted;
    int error_alone = b->tick_us <= 0.0 && b->bytes <= 0.0;
    const char *why = error_alone      ? "the cheapest tick that keeps the error"
                      : c->error < 0.0 ? "the finest spacing that fits"
                      : c->error <= ERROR_FLOOR
                          ? "an error below 0.5 % that fits, the least work offline"
                          : "the least estimated error that fits";
    json_t *j = json_object(), *pilots = json_array();
    json_object_set_new(j, "asked",
                        json_pack("{s:o,s:o,s:o}", "tick_us",
                                  number_or_null(b->tick_us > 0.0 ? b->tick_us : -1.0), "bytes",
                                  number_or_null(b->bytes > 0.0 ? b->bytes : -1.0), "error",
                                  number_or_null(b->error > 0.0 ? b->error : -1.0)));
    json_object_set_new(
        j, "picked",
        json_pack("{s:s,s:f,s:s,s:s,s:f,s:s}", "method", method_name[c->method], "spacing_factor",
                  c->factor, "displacement", rows_name[c->rows], "precision", form_name(c),
                  "tolerance", c->form == COMPRESSED ? TOLERANCE : 0.0, "field", by_name[c->by]));
    json_object_set_new(j, "why", json_string(why));
    json_object_set_new(j, "optimised", json_string(error_alone ? BUDGET_RULE_ERROR : BUDGET_RULE));
    json_object_set_new(j, "considered", json_integer(s->count));
    json_object_set_new(j, "fitting", json_integer(fitting));
    json_object_set_new(j, "built", json_integer(rounds));
    json_object_set_new(j, "predicted",
                        json_pack("{s:f,s:f,s:o,s:f,s:f}", "tick_us", c->tick_us, "bytes", c->bytes,
                                  "error", number_or_null(c->error), "seconds", c->seconds, "nodes",
                                  c->nodes));
    json_object_set_new(j, "measured",
                        json_pack("{s:f,s:f,s:o}", "tick_us", m->tick_us, "bytes", m->bytes,
                                  "error", number_or_null(m->error)));
    for (int k = 0; k < METHODS; k++) {
        for (int p = 0; p < PILOTS && s->has[k]; p++) {
            const pilot *q = &s->pilots[k][p];
            json_array_append_new(pilots,
                                  json_pack("{s:s,s:f,s:f,s:f,s:f,s:o}", "method", method_name[k],
                                            "spacing_factor", s->pilot_factor[p], "nodes", q->nodes,
                                            "force_us", q->force_us, "seconds", q->seconds, "error",
                                            number_or_null(q->error)));
        }
    }
    json_object_set_new(j, "pilots", pilots);
    json_object_set_new(j, "field_GBs",
                        json_pack("{s:f,s:f}", "single_6MB",
                                  1e-9 / s->machine.per_byte[PALPATE_PRECISION_SINGLE][3],
                                  "scaled_6MB",
                                  1e-9 / s->machine.per_byte[PALPATE_PRECISION_SCALED][3]));
    return j;
}

static pal_status calibrate(search *s, pal_error *error) {
    pal_status status = pal_cost_measure(&s->machine, error);
    s->pilot_factor = pilot_factors[0];
    for (int m = 0; m < METHODS && status == PALPATE_OK; m++) {
        pal_error why = {0};
        pal_status made = measure_pilots(s, m, &why);
        int level = made == PALPATE_OK && s->pilots[m][0].nodes > LEVEL * s->pilots[m][1].nodes;
        if (m == 0 && made != PALPATE_ERROR_CANCELLED && (made != PALPATE_OK || level)) {
            if (level) {
                say(s,
                    "pilot: this surface is not coarser at %.2f times its spacings; finer pilots\n",
                    s->pilot_factor[0]);
            }
            s->pilot_factor = pilot_factors[1];
            made = measure_pilots(s, m, &why);
        }
        s->has[m] = made == PALPATE_OK;
        s->correct_error[m] = s->correct_tick[m][0] = s->correct_tick[m][1] = 1.0;
        (void)snprintf(s->why_not[m], sizeof s->why_not[m], "%.500s", why.message);
        if (made == PALPATE_ERROR_CANCELLED) {
            return pal_fail(error, made, "%s", why.message);
        }
        if (made != PALPATE_OK) {
            say(s, "pilot: %s cannot be used here: %s\n", method_name[m], why.message);
        }
    }
    s->correct_bytes = 1.0;
    return status;
}

pal_status budget_build(const char *scene, const budget *wanted, const common_options *options,
                        source *out, json_t **account, pal_error *error) {
    search *s = calloc(1, sizeof *s);
    *account = NULL;
    memset(out, 0, sizeof *out);
    if (s == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    s->scene = scene;
    s->options = options;
    s->wanted = wanted;
    pal_status status = calibrate(s, error);
    int done = 0, fitting = 0;
    if (status == PALPATE_OK) {
        enumerate(s);
    }
    for (int round = 0; status == PALPATE_OK && !done; round++) {
        candidate *c = round < ROUNDS ? pick(s, &fitting) : NULL;
        if (c == NULL) {
            status = refuse(s, error);
            break;
        }
        char settings[160];
        measured m;
        describe(c, settings, sizeof settings);
        say(s, "try: %s (%d of %d fit): predicted %.1f us a tick, %.1f MB, %.1f s\n", settings,
            fitting, s->count, c->tick_us, 1e-6 * c->bytes, c->seconds);
        pal_error why = {0};
        status = try_candidate(s, c, out, &m, &why);
        if (status == PALPATE_OK && keeps(s, c, &m)) {
            *account = make_account(s, c, &m, fitting, round + 1);
            done = 1;
        } else if (status == PALPATE_OK) {
            say(s, "  measured %.1f us a tick, %.1f MB, error %.2f %%: over the budget\n",
                m.tick_us, 1e-6 * m.bytes, 100.0 * m.error);
            source_close(out);
        } else if (status == PALPATE_ERROR_CANCELLED) {
            (void)pal_fail(error, status, "%s", why.message);
        } else { // a cloud or a certificate that fails there: the next one
            say(s, "  not built: %s\n", why.message);
            status = PALPATE_OK;
        }
    }
    free(s);
    return status;
}

static double real(const json_t *o, const char *key) {
    return json_number_value(json_object_get(o, key));
}

static const char *text(const json_t *o, const char *key) {
    return json_string_value(json_object_get(o, key));
}

static void print_error(const json_t *o) {
    if (json_is_number(json_object_get(o, "error"))) {
        (void)printf(", error %.2f %%", 100.0 * real(o, "error"));
    }
}

void budget_print(const json_t *account) {
    const json_t *p = json_object_get(account, "picked"),
                 *a = json_object_get(account, "predicted");
    const json_t *m = json_object_get(account, "measured");
    (void)printf("picked         method %s, spacings x %.2f, rows %s in %s, field by the %s\n",
                 text(p, "method"), real(p, "spacing_factor"), text(p, "displacement"),
                 text(p, "precision"), text(p, "field"));
    (void)printf("  because      %s: %lld of %lld settings fit, %lld built\n", text(account, "why"),
                 (long long)json_integer_value(json_object_get(account, "fitting")),
                 (long long)json_integer_value(json_object_get(account, "considered")),
                 (long long)json_integer_value(json_object_get(account, "built")));
    (void)printf("  optimised    of all that fit: %s\n", text(account, "optimised"));
    (void)printf("  predicted    %.1f us a tick (p99), %.1f MB", real(a, "tick_us"),
                 1e-6 * real(a, "bytes"));
    print_error(a);
    (void)printf(", %.1f s offline\n  measured     %.1f us a tick (p99), %.1f MB",
                 real(a, "seconds"), real(m, "tick_us"), 1e-6 * real(m, "bytes"));
    print_error(m);
    (void)printf("\n");
}
