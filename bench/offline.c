/// @file offline.c  Bench: what the offline stage costs, against the number of nodes.
///
/// Hemispheres of uniform spacing with about 500 touchable nodes around the pole (fewer on the
/// smallest ones), methods cell (CHOLMOD) and galerkin (displacement and pressure, UMFPACK). Each
/// case runs in a process of its own, so its peak memory is its own: the whole of pal_precompute
/// timed by stage, then on the same system the solver alone, one thread, thread CPU time:
///   block       pal_factor_solve, blocks of right-hand sides, wanted rows only (what precompute
///   does) reference   UMFPACK's own solve (CHOLMOD's on the positive definite systems), one
///   right-hand side
///               at a time, with 0 and 2 steps of iterative refinement
/// on sampled columns, interleaved, the ratio being of medians in the same run. Growth exponents:
/// the slope of a least-squares line through (log nodes, log seconds or bytes).
///
///     bench/offline [--large | --middle | --quick | --nodes N] [--method NAME]
/// (--large adds 20k nodes, --middle stops at 5k, --quick at 2k); writes bench/results/offline.csv,
/// offline.png
/// (--nodes, one size alone, writes neither).
#include <math.h>
#include <stdint.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/types.h>
#include <sys/wait.h>
#include <time.h>
#include <unistd.h>

#include <palpate/precompute.h>

#include "haptic/model/model.h"
#include "src/cloud/cloud.h"
#include "src/discretization/discretization.h"
#include "src/solution/factor.h"
#include "src/solution/memory_plan.h"
#include "src/scene/scene.h"
#include "src/cloud/scene_check.h"

extern void openblas_set_num_threads(int threads);

enum { CASES_MAX = 16, ROUNDS = 3, REFERENCES = 4, METHODS = 2 };
static const char *const method_name[METHODS] = {"cell", "galerkin"};

typedef struct result {
    int ok, method;
    int32_t nodes, touchable, unknowns;
    pal_offline_seconds s;
    uint64_t model_bytes, peak_bytes, predicted_bytes, factor_bytes;
    int64_t factor_entries;
    double block, reference[2]; ///< thread CPU seconds per column
    double difference;          ///< worst relative difference of the two solvers
} result;

static double cpu_seconds(void) {
    struct timespec t;
    (void)clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(double *v, int count) {
    qsort(v, (size_t)count, sizeof *v, by_value);
    return count % 2 ? v[count / 2] : 0.5 * (v[count / 2 - 1] + v[count / 2]);
}

static pal_status load(int method, int nodes, pal_scene **scene, pal_error *error) {
    const double R = 0.05, pi = 3.14159265358979;
    // a cloud of spacing h has about 1.3 nodes per h^3 (measured); the cap of 500 nodes: pi r^2 =
    // 450 h^2
    double h = cbrt(1.3 * 2.0 / 3.0 * pi * R * R * R / nodes),
           r = fmin(1.2 * R, h * sqrt(450.0 / pi));
    char path[64];
    (void)snprintf(path, sizeof path, "/tmp/palpate-offline-%ld.yaml", (long)getpid());
    FILE *f = fopen(path, "w");
    if (f == NULL) {
        return PALPATE_ERROR_IO;
    }
    (void)fprintf(f,
                  "palpate: 1\nbody:\n  geometry: {hemisphere: {radius: %g}}\n  spacing: %.6g\n"
                  "  material: {young: 1e4, poisson: 0.45}\n  fixed: [{below: {z: 0}}]\n"
                  "  touchable: [{ball: {center: [0, 0, %g], radius: %.6g}}]\n"
                  "method: {kind: %s}\nstore: {displacement: surface}\ncertify: warn\n",
                  R, h, R, r, method_name[method]);
    (void)fclose(f);
    pal_status status = pal_scene_load(path, NULL, 0, scene, error);
    (void)unlink(path);
    return status;
}

/// Right-hand side of touchable dof j.
static void load_column(const pal_system *s, const int32_t *touchable, int64_t j, double *x) {
    int64_t column = 3 * (int64_t)touchable[j / 3] + j % 3;
    memset(x, 0, (size_t)s->unknown_count * sizeof *x);
    for (int64_t e = s->load.start[column]; e < s->load.start[column + 1]; e++) {
        x[s->load.row[e]] += s->load.value[e];
    }
}

/// Solve sampled blocks both ways on one thread.
static pal_status compare(const pal_system *system, const int32_t *touchable, int32_t count,
                          const uint8_t *need, result *r, pal_error *error) {
    size_t n = (size_t)system->unknown_count;
    pal_factor *factor = NULL;
    pal_factor_report report;
    pal_status status =
        pal_factor_create(&system->matrix, system->positive, NULL, &factor, &report, error);
    if (status != PALPATE_OK) {
        return status;
    }
    r->factor_bytes = report.bytes;
    r->factor_entries = report.nonzeros;
    pal_factor_workspace *ws = pal_factor_workspace_new(factor);
    double *x = malloc(n * PALPATE_FACTOR_BLOCK * sizeof *x), *b = malloc(n * sizeof *b);
    double *y = malloc(n * sizeof *y);
    double block[ROUNDS], one[2][ROUNDS * REFERENCES];
    if (ws == NULL || x == NULL || b == NULL || y == NULL) {
        status = PALPATE_ERROR_MEMORY;
    }
    if (status == PALPATE_OK) {
        status = pal_factor_need(factor, need, error);
    }
    int64_t columns = 3 * (int64_t)count;
    int width = columns < PALPATE_FACTOR_BLOCK ? (int)columns : PALPATE_FACTOR_BLOCK;
    for (int round = -1; round < ROUNDS && status == PALPATE_OK;
         round++) { // the first one warms up
        int64_t first = (columns - width) * (round < 0 ? 0 : round) / (ROUNDS - 1);
        for (int c = 0; c < width; c++) {
            load_column(system, touchable, first + c, x + (size_t)c * n);
        }
        double t = cpu_seconds();
        status = pal_factor_solve(factor, ws, width, x, error);
        t = cpu_seconds() - t;
        block[round < 0 ? 0 : round] = t / width;
        for (int k = 0; k < REFERENCES && status == PALPATE_OK; k++) {
            int c = k * width / REFERENCES;
            load_column(system, touchable, first + c, b);
            for (int refine = 0; refine < 2 && status == PALPATE_OK; refine++) {
                t = cpu_seconds();
                status =
                    pal_factor_solve_reference(factor, &system->matrix, 2 * refine, b, y, error);
                one[refine][(round < 0 ? 0 : round) * REFERENCES + k] = cpu_seconds() - t;
            }
            double off = 0, size = 0;
            for (size_t i = 0; i < n; i++) {
                if (need[i]) {
                    off = fmax(off, fabs(y[i] - x[(size_t)c * n + i]));
                    size = fmax(size, fabs(y[i]));
                }
            }
            r->difference = fmax(r->difference, off / size);
        }
    }
    if (status == PALPATE_OK) {
        r->block = median(block, ROUNDS);
        r->reference[0] = median(one[0], ROUNDS * REFERENCES);
        r->reference[1] = median(one[1], ROUNDS * REFERENCES);
    }
    free(y);
    free(b);
    free(x);
    pal_factor_workspace_free(ws);
    pal_factor_free(factor);
    return status;
}

/// The solvers on the case's system, assembled again.
static pal_status solvers(pal_scene *scene, const pal_model *m, result *r, pal_error *error) {
    pal_cloud cloud = {0};
    pal_node_sets sets = {0};
    pal_system system = {0};
    pal_status status = pal_cloud_build(scene, NULL, &cloud, NULL, error);
    if (status == PALPATE_OK) {
        status = pal_scene_select_nodes(scene, &cloud, &sets, error);
    }
    uint8_t *fixed = calloc((size_t)cloud.node_count + 1, 1), *need = NULL;
    if (status == PALPATE_OK && fixed == NULL) {
        status = PALPATE_ERROR_MEMORY;
    }
    for (int32_t i = 0; status == PALPATE_OK && i < cloud.node_count; i++) {
        fixed[i] = (sets.flags[i] & PALPATE_NODE_FIXED) != 0;
    }
    if (status == PALPATE_OK) {
        status =
            pal_discretize(&cloud, fixed, scene->poisson, &scene->method, NULL, &system, error);
    }
    if (status == PALPATE_OK) {
        r->unknowns = system.unknown_count;
        need = calloc((size_t)system.unknown_count, 1);
        status = need == NULL ? PALPATE_ERROR_MEMORY : PALPATE_OK;
    }
    if (status == PALPATE_OK) {
        for (int32_t i = 0; i < m->info.row_count; i++) {
            for (int d = 0; d < 3; d++) {
                int32_t u = system.dof_unknown[3 * (int64_t)m->row_node[i] + d];
                if (u >= 0) {
                    need[u] = 1;
                }
            }
        }
        status = compare(&system, m->column_node, m->info.column_count, need, r, error);
    }
    free(need);
    free(fixed);
    pal_system_clear(&system);
    pal_node_sets_clear(&sets);
    pal_cloud_clear(&cloud);
    return status;
}

static result run(int method, int nodes) {
    result r = {.method = method};
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    pal_error error = {0};
    openblas_set_num_threads(
        1); // waits by spinning otherwise: its CPU time would count the waiting
    pal_status status = load(method, nodes, &scene, &error);
    if (status == PALPATE_OK) {
        status = pal_precompute(scene, NULL, &model, &error);
    }
    if (status == PALPATE_OK) {
        r.nodes = model->info.node_count;
        r.touchable = model->info.column_count;
        r.s = model->info.seconds;
        r.model_bytes = model->info.bytes;
        r.peak_bytes = model->info.peak_bytes;
        r.predicted_bytes = pal_memory_plan_peak(&model->info);
        status = solvers(scene, model, &r, &error);
    }
    if (status != PALPATE_OK) {
        (void)fprintf(stderr, "bench/offline: %s, %d nodes: %s\n", method_name[method], nodes,
                      error.message);
    }
    r.ok = status == PALPATE_OK;
    pal_model_free(model);
    pal_scene_free(scene);
    return r;
}

/// The same in a child process.
static result run_apart(int method, int nodes) {
    result r = {0};
    int end[2];
    if (pipe(end) != 0) {
        return r;
    }
    (void)fflush(stdout);
    pid_t child = fork();
    if (child == 0) {
        r = run(method, nodes);
        _exit(write(end[1], &r, sizeof r) == (ssize_t)sizeof r ? 0 : 1);
    }
    (void)close(end[1]);
    if (read(end[0], &r, sizeof r) != (ssize_t)sizeof r) {
        r.ok = 0;
    }
    (void)close(end[0]);
    (void)waitpid(child, NULL, 0);
    return r;
}

static double pick(const result *r, int k) {
    const double v[] = {
        r->s.cloud,   r->s.assemble, r->s.factor,           r->s.solve,
        r->s.certify, r->s.total,    (double)r->peak_bytes, (double)r->factor_bytes};
    return v[k];
}

static void exponents(const result *all, int count, int method) {
    static const char *const name[] = {"cloud",   "assemble", "factor",     "solve",
                                       "certify", "total",    "peak bytes", "factor bytes"};
    printf("%s grows as nodes to the power:", method_name[method]);
    for (int k = 0; k < 8; k++) {
        double n = 0, sx = 0, sy = 0, sxx = 0, sxy = 0;
        for (int i = 0; i < count; i++) {
            if (all[i].ok && all[i].method == method && pick(&all[i], k) > 0) {
                double x = log(all[i].nodes), y = log(pick(&all[i], k));
                n += 1;
                sx += x;
                sy += y;
                sxx += x * x;
                sxy += x * y;
            }
        }
        if (n >= 2) {
            printf("%s %s %.2f", k ? "," : "", name[k], (n * sxy - sx * sy) / (n * sxx - sx * sx));
        }
    }
    printf("\n");
}

static void plot(void) {
    FILE *g = popen("gnuplot", "w");
    if (g == NULL) {
        return;
    }
    (void)fprintf(
        g, "set datafile separator ','\nset terminal pngcairo size 1600,900 font 'DejaVu Sans,10'\n"
           "set output 'bench/results/offline.png'\nset multiplot layout 1,3\nset logscale xy\n"
           "set grid\nset xlabel 'nodes'\nset format x '%%g'\nset format y '%%g'\n"
           "set lmargin 9\nset rmargin 3\nset bmargin 12\nset tmargin 1\n"
           "set key bmargin center vertical maxrows 5 samplen 2 width -1 font ',9'\n");
    static const char *const what[3] = {"seconds per stage", "MB", "CPU ms per column, one thread"};
    static const char *const columns[3][5] = {
        {"5:cloud", "6:assemble", "7:factor", "8:solve", "10:total"},
        {"12:peak", "13:predicted peak", "14:factors", "11:model", NULL},
        {"16:in blocks", "17:one at a time", "18:refined twice", NULL, NULL}};
    static const double unit[3] = {1.0, 1e-6, 1e3};
    for (int p = 0; p < 3; p++) {
        (void)fprintf(g, "set ylabel '%s'\nplot ", what[p]);
        for (int m = 0; m < METHODS; m++) {
            for (int k = 0; k < 5 && columns[p][k] != NULL; k++) {
                (void)fprintf(g,
                              "%s\"< awk -F, '$1==\\\"%s\\\"' bench/results/offline.csv\" using "
                              "2:(%g*$%d) with linespoints dt %d title '%s %s'",
                              m + k ? ", " : "", method_name[m], unit[p], atoi(columns[p][k]),
                              m + 1, method_name[m], strchr(columns[p][k], ':') + 1);
            }
        }
        (void)fprintf(g, "\n");
    }
    (void)fprintf(g, "unset multiplot\n");
    (void)pclose(g);
}

int main(int argc, char **argv) {
    int target[] = {1000, 2000, 5000, 10000, 20000};
    int sizes = 4, only = -1, count = 0, alone = 0;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--large") == 0) {
            sizes = 5;
        } else if (strcmp(argv[i], "--plot") == 0) { // draw the CSV again
            plot();
            return 0;
        } else if (strcmp(argv[i], "--quick") == 0) {
            sizes = 2;
        } else if (strcmp(argv[i], "--middle") == 0) {
            sizes = 3;
        } else if (strcmp(argv[i], "--nodes") == 0 && i + 1 < argc) {
            target[0] = (int)fmax(300.0, atof(argv[++i]));
            alone = sizes = 1;
        } else if (strcmp(argv[i], "--method") == 0 && i + 1 < argc) {
            i++;
            only = strcmp(argv[i], "galerkin") == 0;
        } else {
            (void)fprintf(
                stderr,
                "usage: %s [--large | --middle | --quick | --nodes N] [--method cell|galerkin]\n",
                argv[0]);
            return 2;
        }
    }
    FILE *csv = fopen(alone ? "/dev/null" : "bench/results/offline.csv", "w");
    if (csv == NULL) {
        (void)fprintf(stderr, "bench/offline: run from the project's folder\n");
        return 1;
    }
    (void)fprintf(
        csv,
        "method,nodes,touchable,unknowns,cloud_s,assemble_s,factor_s,solve_s,certify_s,total_s,"
        "model_bytes,peak_bytes,predicted_bytes,factor_bytes,factor_entries,block_s,"
        "one_at_a_time_s,refined_s,difference\n");
    printf("%-9s %6s %5s %8s | %6s %8s %7s %7s %8s %7s s | %7s %7s %7s MB | %7s %7s %7s ms | %6s "
           "%6s\n",
           "method", "nodes", "touch", "unknowns", "cloud", "assemble", "factor", "solve",
           "certify", "total", "model", "peak", "planned", "block", "one", "refined", "ratio",
           "ratio2");
    static result all[CASES_MAX];
    for (int k = 0; k < sizes; k++) {
        for (int m = 0; m < METHODS; m++) {
            if (only >= 0 && only != m) {
                continue;
            }
            result *r = &all[count];
            *r = run_apart(m, target[k]);
            if (!r->ok) {
                printf("%-9s %6d nodes: failed\n", method_name[m], target[k]);
                continue;
            }
            count++;
            printf("%-9s %6d %5d %8d | %6.2f %8.2f %7.2f %7.2f %8.2f %7.2f   | %7.0f %7.0f %7.0f   "
                   " | %7.3f %7.2f "
                   "%7.2f    | %6.1f %6.1f\n",
                   method_name[m], r->nodes, r->touchable, r->unknowns, r->s.cloud, r->s.assemble,
                   r->s.factor, r->s.solve, r->s.certify, r->s.total, 1e-6 * (double)r->model_bytes,
                   1e-6 * (double)r->peak_bytes, 1e-6 * (double)r->predicted_bytes, 1e3 * r->block,
                   1e3 * r->reference[0], 1e3 * r->reference[1], r->reference[0] / r->block,
                   r->reference[1] / r->block);
            (void)fflush(stdout);
            (void)fprintf(
                csv,
                "%s,%d,%d,%d,%.4g,%.4g,%.4g,%.4g,%.4g,%.4g,%llu,%llu,%llu,%llu,%lld,%.4g,%.4g,%.4g,"
                "%.3g\n",
                method_name[m], r->nodes, r->touchable, r->unknowns, r->s.cloud, r->s.assemble,
                r->s.factor, r->s.solve, r->s.certify, r->s.total,
                (unsigned long long)r->model_bytes, (unsigned long long)r->peak_bytes,
                (unsigned long long)r->predicted_bytes, (unsigned long long)r->factor_bytes,
                (long long)r->factor_entries, r->block, r->reference[0], r->reference[1],
                r->difference);
            (void)fflush(csv);
        }
    }
    (void)fclose(csv);
    for (int m = 0; m < METHODS && !alone; m++) {
        if (only < 0 || only == m) {
            exponents(all, count, m);
        }
    }
    if (alone) {
        return count > 0 ? 0 : 1;
    }
    printf("CPU ms per column on one thread (cell: CHOLMOD one at a time, not refined); "
           "bench/results/offline.csv, offline.png\n");
    plot();
    return count > 0 ? 0 : 1;
}
