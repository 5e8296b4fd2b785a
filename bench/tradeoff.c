/// @file tradeoff.c  Bench: the trade in one picture: settings against error, time and bytes.
///
/// The hemisphere of bench/references (R = 50 mm, nu = 0.45, cap bonded and pushed down 5 mm;
/// finite elements graded to 2e-6 radii) with a touchable cap of 30 mm, over
///   method x spacing x stored rows x storage (precision, compression tolerance) x who computes the
///   field
/// and for each
///   force error         of the bonded cap, down and aside, the worse, against the reference
///   displacement error  rms over the dome and axis points of the reference, and the rms over all
///   stored
///                       rows of what storing them costs (against doubles), added in squares; per
///                       push
///   p99 tick            of the scene's own sphere sliding over the pole, thread CPU time
///   (haptic/engine/cost.h) offline seconds     of the whole pal_precompute (compression included)
///   bytes               of the compliance blocks in memory
/// A model per method and spacing is built with all rows in double; the others are made from it, so
/// the clouds are the same and only what is named differs. Pareto front: no other setting is as
/// good in all five and more than 3 % better in one (a setting without rows has no displacement to
/// be good in).
///
///     bench/tradeoff [--quick]          (--quick: two spacings)
/// writes bench/results/tradeoff.csv, tradeoff.png.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#include <jansson.h>

#include <palpate/precompute.h>

#include "haptic/engine/cost.h"
#include "haptic/model/model.h"
#include "src/store/compress.h"
#include "src/base/seconds.h"

enum { ROWS_MAX = 512, GOALS = 5 };
static const double R = 0.05, PUSH = 0.005;

typedef struct setting {
    const char *method, *rows, *storage, *field;
    double spacing, tolerance;
    int nodes, stored;
    double goal[GOALS]; ///< force error, displacement error, p99 tick [us], offline [s], bytes
    double rounding, force_us;
    int pareto;
} setting;

static setting all[ROWS_MAX];
static int count;

typedef struct full_model {
    pal_model *model;
    double *column; ///< all rows in double, (3t x 3n)
    int32_t *node;  ///< of each row
    int32_t rows, surface_rows;
    double force_error, displacement_error;
} full_model;

static double number(const json_t *o) {
    return json_is_number(o) ? json_number_value(o) : (double)NAN;
}

static const json_t *axial(const json_t *reference, const char *what) {
    return json_object_get(json_object_get(json_object_get(reference, what), "0.45"),
                           what[0] == 'p' ? "force_z" : "force_x");
}

static pal_model *build(const json_t *reference, const char *method, double spacing) {
    char path[64];
    (void)snprintf(path, sizeof path, "/tmp/palpate-tradeoff-%ld.yaml", (long)getpid());
    FILE *f = fopen(path, "w");
    if (f == NULL) {
        return NULL;
    }
    (void)fprintf(f,
                  "palpate: 1\nbody:\n  geometry: {hemisphere: {radius: %g}}\n  spacing: %.9g\n  "
                  "material: {young: 1e4, "
                  "poisson: 0.45}\n  fixed: [{below: {z: 0}}]\n  touchable: [{ball: {center: [0, "
                  "0, %g], radius: 0.03}}]\n"
                  "  patches: {pole: {ball: {center: [0, 0, %g], radius: %.12g}, rim_spacing: "
                  "%.9g}}\n  probes:\n",
                  R, spacing, R, R, 2 * R * sin(0.1), 0.08 * spacing);
    const json_t *points = json_object_get(json_object_get(reference, "poisson"), "0.45");
    const char *key;
    json_t *value;
    json_object_foreach(json_object_get(points, "dome"), key, value) {
        (void)fprintf(f, "    d%.0f: [%.12g, 0, %.12g]\n", 100 * atof(key), R * sin(atof(key)),
                      R * cos(atof(key)));
    }
    json_object_foreach(json_object_get(points, "axis"), key, value) {
        (void)fprintf(f, "    a%.0f: [0, 0, %.12g]\n", 100 * atof(key), R * atof(key));
    }
    (void)fprintf(f,
                  "method: {kind: %s}\nstore: {displacement: all, precision: double}\ncertify: "
                  "warn\nestimate: false\n"
                  "tools:\n  - name: probe\n    shape: {sphere: {radius: 0.006}}\n    start: [0, "
                  "0, 0.056]\n    axis: "
                  "[0, 0, -1]\n    device: {scripted: {kind: circle, depth: 0.003, amplitude: "
                  "0.006, ramp: 0.3}}\n",
                  method);
    (void)fclose(f);
    pal_error error = {0};
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    if (pal_scene_load(path, NULL, 0, &scene, &error) != PALPATE_OK ||
        pal_precompute(scene, NULL, &model, &error) != PALPATE_OK) {
        (void)fprintf(stderr, "bench/tradeoff: %s, %g m: %s\n", method, spacing, error.message);
    }
    pal_scene_free(scene);
    (void)unlink(path);
    return model;
}

/// Force and displacement against the reference: what the discretization costs.
static void judge(full_model *m, const json_t *reference) {
    const json_t *points = json_object_get(json_object_get(reference, "poisson"), "0.45");
    const double down[3] = {0, 0, -PUSH}, aside[3] = {PUSH, 0, 0};
    pal_press press;
    if (pal_model_press(m->model, "pole", down, &press, NULL) == PALPATE_OK) {
        m->force_error = fabs(press.force[2] / number(axial(reference, "poisson")) - 1);
        double sum = 0;
        for (int32_t p = 0; p < m->model->info.probe_count; p++) {
            double at[3];
            const char *name = pal_model_probe(m->model, p, at), *key;
            json_t *value;
            json_object_foreach(json_object_get(points, name[0] == 'd' ? "dome" : "axis"), key,
                                value) {
                const double *u = press.probe + 3 * (size_t)p;
                if (fabs(100 * atof(key) - atof(name + 1)) < 0.5) {
                    double e = name[0] == 'd' ? hypot(u[0] - number(json_array_get(value, 0)),
                                                      u[2] - number(json_array_get(value, 1)))
                                              : fabs(u[2] - number(value));
                    sum += e * e;
                }
            }
        }
        m->displacement_error = sqrt(sum / m->model->info.probe_count) / PUSH;
        pal_press_clear(&press);
    }
    if (pal_model_press(m->model, "pole", aside, &press, NULL) == PALPATE_OK) {
        m->force_error =
            fmax(m->force_error, fabs(press.force[0] / number(axial(reference, "lateral")) - 1));
        pal_press_clear(&press);
    }
}

/// Keep all rows in double beside the model; surface rows first by node number.
static int take(full_model *m) {
    const pal_model_info *i = &m->model->info;
    size_t n = 3 * (size_t)i->row_count, t = 3 * (size_t)i->column_count;
    m->rows = i->row_count;
    m->column = malloc(n * t * sizeof *m->column);
    m->node = malloc((size_t)m->rows * sizeof *m->node);
    if (m->column == NULL || m->node == NULL) {
        return 0;
    }
    memcpy(m->node, m->model->row_node, (size_t)m->rows * sizeof *m->node);
    m->surface_rows = 0;
    while (m->surface_rows < m->rows && m->node[m->surface_rows] < i->surface_count) {
        m->surface_rows++; // rows ascend and surface nodes come first
    }
    for (size_t j = 0; j < t; j++) {
        if (pal_model_load_column(m->model, (int64_t)j, m->column + j * n) != PALPATE_OK) {
            return 0;
        }
    }
    return 1;
}

/// Store `rows` of them in `precision`.
static pal_status restore(full_model *m, int32_t rows, pal_precision precision, pal_error *error) {
    pal_model *model = m->model;
    size_t n = 3 * (size_t)m->rows, t = 3 * (size_t)model->info.column_count;
    double largest = 0;
    pal_row_bases_free(model->bases);
    model->bases = NULL;
    model->info.row_count = rows;
    model->info.precision = precision;
    memcpy(model->row_node, m->node, (size_t)rows * sizeof *m->node);
    pal_status status = pal_model_alloc_rows(model, error);
    for (size_t k = 0; rows > 0 && k < n * t; k++) {
        largest = fmax(largest, fabs(m->column[k]));
    }
    pal_model_scale_rows(model, largest);
    for (size_t j = 0; rows > 0 && j < t && status == PALPATE_OK; j++) {
        status = pal_model_store_column(model, (int64_t)j, m->column + j * n);
    }
    return status;
}

/// rms over the stored rows of what storing costs, per push.
static double rounding(full_model *m, const double *truth) {
    const double down[3] = {0, 0, -PUSH};
    pal_press press;
    double sum = 0;
    if (m->model->info.row_count == 0 ||
        pal_model_press(m->model, "pole", down, &press, NULL) != PALPATE_OK) {
        return 0;
    }
    size_t n = 3 * (size_t)m->model->info.row_count;
    for (size_t k = 0; k < n; k++) {
        sum += (press.displacement[k] - truth[k]) * (press.displacement[k] - truth[k]);
    }
    pal_press_clear(&press);
    return sqrt(3 * sum / (double)n) / PUSH;
}

static void add(const full_model *m, const setting *like, const pal_cost_ticks *ticks,
                double seconds, double round) {
    const pal_model_info *i = &m->model->info;
    for (int by = 0; by < (i->row_count > 0 ? 2 : 1) && count < ROWS_MAX; by++) {
        setting *s = &all[count++];
        *s = *like;
        s->field = i->row_count == 0 ? "none" : by == 0 ? "servo" : "render";
        s->nodes = i->node_count;
        s->stored = i->row_count;
        s->rounding = round;
        s->force_us = ticks->force_us.p99;
        s->goal[0] = m->force_error;
        s->goal[1] = i->row_count > 0 ? hypot(m->displacement_error, round) : (double)INFINITY;
        s->goal[2] = by == 0 && i->row_count > 0 ? ticks->tick_us.p99 : ticks->render_us.p99;
        s->goal[3] = seconds;
        s->goal[4] = (double)i->bytes;
    }
}

static int sweep(const json_t *reference, const char *method, double spacing) {
    static const struct {
        const char *rows, *storage;
        pal_precision precision;
        double tolerance;
    } variants[] = {
        {"none", "-", PALPATE_PRECISION_SINGLE, 0},
        {"surface", "double", PALPATE_PRECISION_DOUBLE, 0},
        {"surface", "single", PALPATE_PRECISION_SINGLE, 0},
        {"surface", "half", PALPATE_PRECISION_HALF, 0},
        {"surface", "scaled", PALPATE_PRECISION_SCALED, 0},
        {"surface", "tolerance", PALPATE_PRECISION_DOUBLE, 1e-3},
        {"surface", "tolerance", PALPATE_PRECISION_DOUBLE, 1e-2},
        {"all", "single", PALPATE_PRECISION_SINGLE, 0},
        {"all", "scaled", PALPATE_PRECISION_SCALED, 0},
        {"all", "tolerance", PALPATE_PRECISION_DOUBLE, 1e-3},
    };
    full_model m = {.model = build(reference, method, spacing)};
    pal_press truth = {0};
    const double down[3] = {0, 0, -PUSH};
    pal_error error = {0};
    if (m.model == NULL) {
        return 0;
    }
    judge(&m, reference);
    double seconds = m.model->info.seconds.total;
    int first = count;
    int ok = pal_model_press(m.model, "pole", down, &truth, &error) == PALPATE_OK && take(&m);
    for (size_t k = 0; k < sizeof variants / sizeof *variants && ok; k++) {
        int32_t rows = strcmp(variants[k].rows, "none") == 0      ? 0
                       : strcmp(variants[k].rows, "surface") == 0 ? m.surface_rows
                                                                  : m.rows;
        setting s = {.method = method,
                     .spacing = spacing,
                     .rows = variants[k].rows,
                     .storage = variants[k].storage,
                     .tolerance = variants[k].tolerance};
        pal_cost_ticks ticks;
        ok = restore(&m, rows, variants[k].precision, &error) == PALPATE_OK;
        double start = pal_seconds_now();
        if (ok && variants[k].tolerance > 0.0) {
            ok = pal_compress(m.model, variants[k].tolerance, NULL, &error) == PALPATE_OK;
        }
        double packing = pal_seconds_now() - start;
        uint64_t t = 3 * (uint64_t)m.model->info.column_count;
        m.model->info.bytes = 8 * t * t + pal_model_row_bytes(m.model) +
                              8 * t * 3 * (uint64_t)m.model->info.probe_count;
        ok = ok && pal_cost_of_ticks(m.model, 1.0, 3, &ticks, &error) == PALPATE_OK;
        if (ok) {
            add(&m, &s, &ticks, seconds + packing, rounding(&m, truth.displacement));
        }
    }
    if (!ok) {
        (void)fprintf(stderr, "bench/tradeoff: %s, %g m: %s\n", method, spacing, error.message);
    }
    // without a field the ticks of one cloud are the same to the bit whatever is stored: the least
    // time
    double least = INFINITY;
    for (int k = first; k < count; k++) {
        least = strcmp(all[k].field, "servo") == 0 ? least : fmin(least, all[k].goal[2]);
    }
    for (int k = first; k < count; k++) {
        all[k].goal[2] = strcmp(all[k].field, "servo") == 0 ? fmax(least, all[k].goal[2]) : least;
    }
    pal_press_clear(&truth);
    free(m.column);
    free(m.node);
    pal_model_free(m.model);
    return ok;
}

// ---- Front, table, picture ----------------------------------------------------------------------

static int dominates(const setting *a, const setting *b) {
    int better = 0;
    for (int g = 0; g < GOALS; g++) {
        if (a->goal[g] > 1.001 * b->goal[g]) { // what nobody can measure is no difference
            return 0;
        }
        better |= a->goal[g] < 0.97 * b->goal[g];
    }
    return better;
}

static void mark_front(void) {
    for (int k = 0; k < count; k++) {
        all[k].pareto = 1;
        for (int j = 0; j < count; j++) {
            all[k].pareto &= !dominates(&all[j], &all[k]);
        }
    }
}

static void print_all(FILE *csv) {
    (void)fprintf(
        csv,
        "method,spacing,nodes,rows,storage,tolerance,field,stored,force_error,displacement_error,"
        "storing_error,p99_tick_us,p99_force_us,offline_s,bytes,pareto\n");
    printf("%-9s %8s %6s %-8s %-10s %-7s | %8s %8s %9s %9s %9s\n", "method", "spacing", "nodes",
           "rows", "storage", "field", "force %", "displ. %", "tick us", "offline s", "MB");
    for (int k = 0; k < count; k++) {
        const setting *s = &all[k];
        char shown[24] = "-", stored[32];
        if (isfinite(s->goal[1])) {
            (void)snprintf(shown, sizeof shown, "%.3f", 100 * s->goal[1]);
        }
        (void)snprintf(stored, sizeof stored, s->tolerance > 0 ? "%s %.0e" : "%s", s->storage,
                       s->tolerance);
        printf("%-9s %8.4f %6d %-8s %-10s %-7s | %8.3f %8s %9.1f %9.2f %9.2f%s\n", s->method,
               s->spacing, s->nodes, s->rows, stored, s->field, 100 * s->goal[0], shown, s->goal[2],
               s->goal[3], 1e-6 * s->goal[4], s->pareto ? "  *" : "");
        (void)fprintf(csv, "%s,%g,%d,%s,%s,%g,%s,%d,%.6g,%.6g,%.3g,%.2f,%.2f,%.3f,%.0f,%d\n",
                      s->method, s->spacing, s->nodes, s->rows, s->storage, s->tolerance, s->field,
                      s->stored, s->goal[0], isfinite(s->goal[1]) ? s->goal[1] : (double)NAN,
                      s->rounding, s->goal[2], s->force_us, s->goal[3], s->goal[4], s->pareto);
    }
}

static void plot(void) {
    FILE *g = popen("gnuplot", "w");
    if (g == NULL) {
        return;
    }
    // one panel per pair; every setting a point, the front filled
    static const struct {
        const char *x, *y, *name_x, *name_y;
    } panel[3] = {{"$12", "100*$9", "p99 tick [us]", "force error [%]"},
                  {"1e-6*$15", "100*$10", "compliance in memory [MB]", "displacement error [%]"},
                  {"$14", "100*$9", "offline [s]", "force error [%]"}};
    (void)fprintf(g, "set datafile separator ','\nset terminal pngcairo size 1500,560\nset output "
                     "'bench/results/tradeoff.png'\nset multiplot layout 1,3 title 'Hemisphere, nu "
                     "= 0.45: every setting; "
                     "filled: Pareto front over all five goals'\nset logscale xy\nset grid\nset "
                     "key bottom left\n");
    static const char *const series[4][3] = {{"cell", "servo", "4"},
                                             {"cell", "render", "6"},
                                             {"galerkin", "servo", "8"},
                                             {"galerkin", "render", "10"}};
    for (int p = 0; p < 3; p++) {
        (void)fprintf(g, "set xlabel '%s'\nset ylabel '%s'\nplot ", panel[p].name_x,
                      panel[p].name_y);
        for (int k = 0; k < 8; k++) {
            int front = k % 2;
            const char *const *s = series[k / 2];
            (void)fprintf(g,
                          "%s'bench/results/tradeoff.csv' skip 1 using "
                          "((strcol(1) eq '%s' && (strcol(7) eq '%s' || (strcol(7) eq 'none' && "
                          "'%s' eq 'servo')) && "
                          "$16==%d) ? %s : 1/0):(%s) pt %d ps 1.2 lc %d %s%s%s%s%s",
                          k ? ", " : "", s[0], s[1], s[1], front, panel[p].x, panel[p].y,
                          atoi(s[2]) + front, 1 + k / 2, front ? "title '" : "notitle",
                          front ? s[0] : "", front ? ", field by " : "", front ? s[1] : "",
                          front ? "'" : "");
        }
        (void)fprintf(g, "\n");
    }
    (void)fprintf(g, "unset multiplot\n");
    (void)pclose(g);
}

/// The best of those that keep to limits, for the README's table of needs.
static void need(const char *what, double force, double tick, int picture, int goal) {
    const setting *best = NULL;
    for (int k = 0; k < count; k++) {
        const setting *s = &all[k];
        if (s->goal[0] <= force && s->goal[2] <= tick && (!picture || s->stored > 0) &&
            (picture < 2 || strcmp(s->rows, "all") == 0) &&
            (best == NULL || s->goal[goal] < best->goal[goal])) {
            best = s;
        }
    }
    if (best == NULL) {
        printf("%-58s nothing\n", what);
        return;
    }
    printf("%-58s %s, spacing %g, rows %s %s, field %s: force %.2f %%, tick %.0f us, %.1f s, %.1f "
           "MB\n",
           what, best->method, best->spacing, best->rows, best->storage, best->field,
           100 * best->goal[0], best->goal[2], best->goal[3], 1e-6 * best->goal[4]);
}

int main(int argc, char **argv) {
    static const double spacing[] = {0.016, 0.0115, 0.0085, 0.0057};
    int finest = argc > 1 && strcmp(argv[1], "--quick") == 0 ? 2 : 4;
    json_error_t why;
    json_t *reference = json_load_file("bench/references/hemisphere.json", 0, &why);
    FILE *csv = fopen("bench/results/tradeoff.csv", "w");
    if (reference == NULL || csv == NULL) {
        (void)fprintf(stderr, "bench/tradeoff: run from the project's folder\n");
        return 1;
    }
    int ok = 1;
    for (int k = 0; k < finest; k++) {
        ok &= sweep(reference, "cell", spacing[k]) && sweep(reference, "galerkin", spacing[k]);
    }
    (void)sweep(reference, "point", spacing[1]); // the paper's own: to be seen once
    mark_front();
    print_all(csv);
    (void)fclose(csv);
    plot();
    printf("\n");
    need("least force error", INFINITY, INFINITY, 0, 0);
    need("surface shown, force within 1 %, quickest tick", 0.01, INFINITY, 1, 2);
    need("surface shown, force within 1 %, fewest bytes", 0.01, INFINITY, 1, 4);
    need("surface shown, force within 2 %, built quickest", 0.02, INFINITY, 1, 3);
    need("inside shown too, force within 1 %, fewest bytes", 0.01, INFINITY, 2, 4);
    need("force only, within 1 %, fewest bytes", 0.01, INFINITY, 0, 4);
    need("surface shown, tick within 100 us, least force error", INFINITY, 100, 1, 0);
    printf("* on the Pareto front; bench/results/tradeoff.csv tradeoff.png\n");
    json_decref(reference);
    return ok ? 0 : 1;
}
