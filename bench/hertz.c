/// @file hertz.c  Sphere on a block against Hertz and a converged finite-element table (paper 2,
/// section 3.3).
///
///     make bench-hertz                 four clouds per method: CSV, table and plots in
///     bench/results make bench-hertz ARGS=--quick    three of them make bench-hertz ARGS=--plot
///     only draw what the CSVs hold
///
/// Block of 2 m, bottom and sides clamped, E = 10 kPa, nu = 0.3, rigid frictionless sphere of 1 m:
/// the problem of ../shared/reference/sphere_on_block.json. The clouds are that of
/// scenes/block.yaml with every spacing scaled. Contact law: linearised about the rest shape, as in
/// the table; the law on the deformed shape beside it.
///
/// hertz.csv        one row per method, cloud and depth: force, contact radius, both references
/// hertz_error.csv  one row per method and cloud: relative L2 error of the force over the depths
/// against
///                  the table and against Hertz, and the indentation at a fixed force (that of the
///                  table at 0.1 m) against the table's 0.1 m and Hertz's (3 F / (4 E* sqrt
///                  R))^(2/3)
/// hertz.png        the paper's Figures 1 (F(d) of the reference method and Hertz), 3 (L2 error
/// over
///                  degrees of freedom), 4 (methods of close accuracy and Hertz), 5 (indentation at
///                  fixed force over nodes)
/// Hertz's half space is softer than the clamped block (10 % at 0.02 m, 40 % at 0.2 m in the
/// table), so the error against Hertz tends to that of the block, not to zero.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <jansson.h>

#include <palpate/precompute.h>

enum { DEPTHS_MAX = 16, FIXED = 2 }; // index of the depth whose force is held fixed

typedef struct table {
    int count;
    double depth[DEPTHS_MAX], force[DEPTHS_MAX], radius[DEPTHS_MAX], hertz[DEPTHS_MAX];
} table;

static const double YOUNG = 1e4, POISSON = 0.3, RADIUS = 1;

static double hertz_force(double depth) {
    return 4.0 / 3 * YOUNG / (1 - POISSON * POISSON) * sqrt(RADIUS) * pow(depth, 1.5); // Eq. 13
}

static double hertz_depth(double force) {
    return pow(force / hertz_force(1), 2.0 / 3);
}

/// The finite-element table; without it NaN, and Hertz only.
static void read_table(table *t) {
    static const double depth[] = {0.02, 0.05, 0.1, 0.15, 0.2};
    json_t *file = json_load_file("../shared/reference/sphere_on_block.json", 0, NULL);
    json_t *curve = json_object_get(file, "curve");
    t->count = curve != NULL ? (int)json_array_size(curve) : 5;
    if (t->count > DEPTHS_MAX) {
        t->count = DEPTHS_MAX;
    }
    for (int i = 0; i < t->count; i++) {
        json_t *row = json_array_get(curve, (size_t)i);
        t->depth[i] = row != NULL ? json_number_value(json_object_get(row, "depth")) : depth[i];
        t->force[i] = row != NULL ? json_number_value(json_object_get(row, "force")) : (double)NAN;
        t->radius[i] =
            row != NULL ? json_number_value(json_object_get(row, "contact_radius")) : (double)NAN;
        t->hertz[i] = hertz_force(t->depth[i]);
    }
    if (curve == NULL) {
        printf("../shared/reference/sphere_on_block.json is not there: against Hertz only\n");
    }
    json_decref(file);
}

static pal_model *build(const char *method, double factor) {
    char set[5][64];
    (void)snprintf(set[0], sizeof set[0], "method.kind=%s", method);
    (void)snprintf(set[1], sizeof set[1], "body.spacing=%.9g", 0.35 * factor);
    (void)snprintf(set[2], sizeof set[2], "body.refine.0.spacing=%.9g", 0.04 * factor);
    (void)snprintf(set[3], sizeof set[3], "body.refine.1.spacing=%.9g", 0.09 * factor);
    (void)snprintf(set[4], sizeof set[4], "body.grading=%.9g", 0.45);
    const char *overrides[] = {
        set[0], set[1], set[2], set[3], set[4], "store.displacement=none", "estimate=false"};
    pal_error error = {0};
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    if (pal_scene_load("scenes/block.yaml", overrides, 7, &scene, &error) != PALPATE_OK ||
        pal_precompute(scene, NULL, &model, &error) != PALPATE_OK) {
        fprintf(stderr, "%s, spacings x %g: %s\n", method, factor, error.message);
        pal_model_free(model);
        model = NULL;
    }
    pal_scene_free(scene);
    return model;
}

static double force_at(const pal_model *m, const pal_tool_def *tool, double depth) {
    pal_indent_result r;
    pal_error error = {0};
    if (pal_model_indent(m, tool, PALPATE_INDENT_REST, &depth, 1, &r, &error) != PALPATE_OK) {
        fprintf(stderr, "%s\n", error.message);
        return (double)NAN;
    }
    return r.force;
}

/// Depth at which the tool is pushed back with `force`: bisection, F rises with depth.
static double depth_at(const pal_model *m, const pal_tool_def *tool, double force) {
    double low = 0, high = 0.4;
    while (high - low > 1e-7) {
        double middle = 0.5 * (low + high);
        double f = force_at(m, tool, middle);
        if (isnan(f)) {
            return (double)NAN;
        }
        *(f < force ? &low : &high) = middle;
    }
    return 0.5 * (low + high);
}

static int measure(const char *method, double factor, const table *t, FILE *curve, FILE *errors) {
    pal_model *m = build(method, factor);
    if (m == NULL) {
        return 1;
    }
    pal_model_info info;
    pal_model_get_info(m, &info);
    const pal_tool_def *tool = &pal_model_runtime(m)->tools[0];
    pal_indent_result rest[DEPTHS_MAX], full[DEPTHS_MAX];
    pal_error error = {0};
    if (pal_model_indent(m, tool, PALPATE_INDENT_REST, t->depth, t->count, rest, &error) !=
            PALPATE_OK ||
        pal_model_indent(m, tool, PALPATE_INDENT_FULL, t->depth, t->count, full, &error) !=
            PALPATE_OK) {
        fprintf(stderr, "%s\n", error.message);
        pal_model_free(m);
        return 1;
    }
    printf("%s, %d nodes (spacings x %.2f), %.1f s offline\n", method, info.node_count, factor,
           info.seconds.total);
    double table2 = 0, hertz2 = 0, table_error = 0, hertz_error = 0, worst = 0;
    for (int i = 0; i < t->count; i++) {
        double f = rest[i].force, relative = f / t->force[i] - 1;
        fprintf(curve, "%s,%d,%d,%g,%g,%.8g,%.8g,%.8g,%d,%.6g,%.6g,%.8g,%d\n", method,
                info.node_count, 3 * (info.node_count - info.fixed_count), factor, t->depth[i], f,
                t->force[i], t->hertz[i], rest[i].contacts, rest[i].radius, t->radius[i],
                full[i].force, rest[i].cut_off | full[i].cut_off);
        printf("  depth %.2f  F %8.2f N  table %+6.2f %%  Hertz %+6.2f %%  radius %.3f m (%+.3f)  "
               "%4d contacts  "
               "full law %+.2f %%\n",
               t->depth[i], f, 100 * relative, 100 * (f / t->hertz[i] - 1), rest[i].radius,
               rest[i].radius - t->radius[i], rest[i].contacts, 100 * (full[i].force / f - 1));
        table_error += pow(f - t->force[i], 2);
        table2 += pow(t->force[i], 2);
        hertz_error += pow(f - t->hertz[i], 2);
        hertz2 += pow(t->hertz[i], 2);
        worst = fmax(worst, fabs(relative));
    }
    double fixed = isnan(t->force[FIXED]) ? t->hertz[FIXED] : t->force[FIXED];
    double depth = depth_at(m, tool, fixed);
    double l2 = sqrt(table_error / table2), l2_hertz = sqrt(hertz_error / hertz2);
    fprintf(errors, "%s,%d,%d,%g,%.6g,%.6g,%.6g,%.8g,%.8g,%.8g,%.8g,%.4g\n", method,
            info.node_count, 3 * (info.node_count - info.fixed_count), factor, l2, l2_hertz, worst,
            fixed, depth, t->depth[FIXED], hertz_depth(fixed), info.seconds.total);
    printf("  L2 error %.2f %% of the table, %.1f %% of Hertz; at %.1f N indented %.5f m (table "
           "%.5f, Hertz %.5f)\n",
           100 * l2, 100 * l2_hertz, fixed, depth, t->depth[FIXED], hertz_depth(fixed));
    fflush(stdout);
    fflush(curve);
    fflush(errors);
    pal_model_free(m);
    return 0;
}

static void plot(void) {
    FILE *g = popen("gnuplot", "w");
    if (g == NULL) {
        fprintf(stderr, "gnuplot is missing: no plots\n");
        return;
    }
    static const char *const script =
        "set datafile separator ','\nset terminal pngcairo size 1400,1000 font 'DejaVu Sans,10'\n"
        "set output 'bench/results/hertz.png'\nset multiplot layout 2,2\nset grid\n"
        "c = 'bench/results/hertz.csv'; e = 'bench/results/hertz_error.csv'\n"
        "cell = '< grep ^cell, '.e; galerkin = '< grep ^galerkin, '.e\n"
        "hertz(d) = 4.0/3 * 1e4/0.91 * d**1.5\n"
        "stats c using 2 every ::1 nooutput\nfinest = STATS_max\n"
        "set key left top\nset xrange [0:0.21]\nset xlabel 'indentation [m]'\nset ylabel 'force "
        "[N]'\n"
        "set title 'Figure 1: reference (finite elements) and Hertz'\n"
        "plot c using ($2==finest ? $5 : 1/0):7 smooth unique with linespoints title 'finite "
        "elements, clamped block', "
        "hertz(x) title 'Hertz, half space'\n"
        "set title 'Figure 4: methods and theory, cloud of scenes/block.yaml'\n"
        "plot hertz(x) title 'Hertz, half space', "
        "c using ($4==1 ? $5 : 1/0):7 smooth unique with lines dashtype 2 title 'finite elements', "
        "c using (strcol(1) eq 'cell' && $4==1 ? $5 : 1/0):6 with points title 'cell', "
        "c using (strcol(1) eq 'galerkin' && $4==1 ? $5 : 1/0):6 with points title 'galerkin', "
        "c using (strcol(1) eq 'cell' && $4==1 ? $5 : 1/0):12 with points title 'cell, contact on "
        "the deformed shape'\n"
        "set xrange [*:*]\nset logscale x\nset key right center\n"
        "set title 'Figure 3: L2 error of the force'\nset xlabel 'degrees of freedom'\n"
        "set ylabel 'relative L2 error over the depths'\nset logscale y\nset yrange [1e-3:1]\n"
        "plot cell using 3:5 with linespoints title 'cell, of the table', "
        "galerkin using 3:5 with linespoints title 'galerkin, of the table', "
        "cell using 3:6 with linespoints title 'cell, of Hertz (the block is finite)'\n"
        "unset logscale y\nset yrange [0.096:0.12]\nset title 'Figure 5: indentation at fixed "
        "force'\nset xlabel 'nodes'\n"
        "set ylabel 'indentation [m]'\n"
        "plot cell using 2:9 with linespoints title 'cell', "
        "galerkin using 2:9 with linespoints title 'galerkin', "
        "e using 2:10 smooth unique with lines dashtype 2 title 'finite elements', "
        "e using 2:11 smooth unique with lines dashtype 3 title 'Hertz, half space'\n"
        "unset multiplot\n";
    fputs(script, g);
    if (pclose(g) == 0) {
        printf("bench/results/hertz.csv hertz_error.csv hertz.png\n");
    } else {
        fprintf(stderr, "gnuplot failed: no plots\n");
    }
}

int main(int argc, char **argv) {
    static const char *const methods[] = {"cell", "galerkin"};
    static const double factors[] = {1.4, 1, 0.72, 0.52};
    if (argc > 1 && strcmp(argv[1], "--plot") == 0) {
        plot();
        return 0;
    }
    int levels = argc > 1 && strcmp(argv[1], "--quick") == 0 ? 3 : 4, failed = 0;
    table t;
    read_table(&t);
    FILE *curve = fopen("bench/results/hertz.csv", "w"),
         *errors = fopen("bench/results/hertz_error.csv", "w");
    if (curve == NULL || errors == NULL) {
        fprintf(stderr, "bench/results: cannot be written; run from the repository's root\n");
        return 1;
    }
    fprintf(curve, "method,nodes,unknowns,factor,depth,force,table_force,hertz_force,contacts,"
                   "radius,table_radius,"
                   "full_force,cut_off\n");
    fprintf(errors,
            "method,nodes,unknowns,factor,l2_table,l2_hertz,worst_table,fixed_force,indentation,"
            "table_indentation,hertz_indentation,offline_s\n");
    for (int k = 0; k < levels; k++) {
        for (int m = 0; m < 2; m++) {
            failed |= measure(methods[m], factors[k], &t, curve, errors);
        }
    }
    fclose(curve);
    fclose(errors);
    plot();
    return failed;
}
