/// @file ripple.c  How smooth is contact anywhere: ripple of the point compliance over the nodes.
///
///     make bench-ripple                          three scenes and a uniform half ball: tables and
///     CSV make bench-ripple ARGS="scene.yaml ..."    these scenes instead
///
/// Points slide along lines over the touchable surface, for every number of nodes K and power p of
/// the weights (haptic/contact/contact_weights.h). What one contact point feels at x should not
/// know where the nodes are:
///     nodal       c(x) = n' Phi C_TT Phi' n                        the mesh's own
///     near field  c(x) = n' Phi R Phi' n + 3.91 n0 / sqrt(cell)    R of
///     haptic/contact/near_field.h, n0 =
///                 (1 - nu^2) / (pi E): 1/r put back with the area of a contact cell, here a node's
/// ripple = (largest - smallest) / mean over windows of two spacings after removing a quadratic
/// trend (c varies over the body on its own): median over the windows and the worst. Then balls are
/// slid along the same lines at constant depth: ripple of the normal force of the contact law
/// "surface".
///
/// ripple.csv, ripple_slide.csv: one row per scene, K, p; per scene and ball. Times are medians.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include "haptic/contact/contact.h"
#include "haptic/contact/contact_surface.h"
#include "haptic/contact/contact_weights.h"
#include "haptic/contact/near_field.h"

#include <palpate/precompute.h>

enum { SAMPLES = 24, WINDOW = 2 * SAMPLES, LINES = 12, LONGEST = 30 * SAMPLES };

typedef struct place {
    pal_surface_point at;
    double spacing; ///< around it [m]
} place;

typedef struct walk {
    int count;
    place *place;
} walk;

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static pal_model *build(const char *path, const char *overrides[], int count) {
    pal_error error = {0};
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    if (pal_scene_load(path, overrides, count, &scene, &error) != PALPATE_OK ||
        pal_precompute(scene, NULL, &model, &error) != PALPATE_OK) {
        fprintf(stderr, "%s: %s\n", path, error.message);
        model = NULL;
    }
    pal_scene_free(scene);
    return model;
}

/// Points a 1/SAMPLES spacing apart along the surface, from a node, turned by `angle` there.
static walk walk_along(const pal_rest_surface *s, const pal_weights_table *table, int32_t triangle,
                       double angle, double mean) {
    static const double middle[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3};
    walk w = {.place = calloc(LONGEST, sizeof(place))};
    pal_surface_point x;
    pal_weights weights;
    pal_rest_point(s, triangle, middle, &x);
    const double *p = s->position + 3 * s->triangle[3 * triangle];
    double e[3], f[3], t[3];
    for (int i = 0; i < 3; i++) {
        e[i] = p[i] - x.position[i];
    }
    for (int i = 0; i < 3; i++) {
        f[i] = x.normal[(i + 1) % 3] * e[(i + 2) % 3] - x.normal[(i + 2) % 3] * e[(i + 1) % 3];
    }
    for (int i = 0; i < 3; i++) {
        t[i] = cos(angle) * e[i] + sin(angle) * f[i];
    }
    while (w.place != NULL && w.count < LONGEST) {
        if (pal_weights_at(table, &x, 0.0, &weights) < 7) {
            break;
        }
        double h = weights.radius * sqrt(2 * 3.14159265358979 / (1.7320508 * (table->nodes + 1)));
        if (x.inside < 1.5 * h + mean) { // at the rim the law fades contacts out
            break;                       // one-sided stencils at the rim are faded out by the law
        }
        w.place[w.count++] = (place){x, h};
        double out = dot(t, x.normal), q[3];
        for (int i = 0; i < 3; i++) {
            t[i] -= out * x.normal[i];
        }
        double length = sqrt(dot(t, t));
        for (int i = 0; i < 3; i++) {
            t[i] /= length;
            q[i] = x.position[i] + t[i] * h / SAMPLES;
        }
        if (!pal_rest_track(s, q, h, &x, &x)) {
            break;
        }
    }
    return w;
}

/// n' Phi C Phi' n, or with R in place of C (near not NULL).
static double compliance(const pal_model *model, const pal_near_field *near,
                         const pal_surface_point *x, const pal_weights *w) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    const double *c = pal_model_compliance(model), *n = x->normal;
    size_t ld = 3 * (size_t)info.column_count;
    double sum = 0;
    for (int32_t j = 0; j < w->count; j++) {
        for (int32_t i = 0; i < w->count; i++) {
            const double *block = c + 3 * (size_t)w->column[i] + 3 * (size_t)w->column[j] * ld;
            double r[9], g[9] = {0}, value = 0;
            if (near == NULL || !pal_near_pair(near, w->column[i], w->column[j], r)) {
                if (near != NULL) {
                    pal_near_kernel(near, w->column[i], w->column[j], g);
                }
                for (size_t k = 0; k < 9; k++) {
                    r[k] = block[k % 3 + k / 3 * ld] - g[k];
                }
            }
            for (size_t b = 0; b < 3; b++) {
                value += n[b] * dot(n, r + 3 * b);
            }
            sum += w->phi[i] * w->phi[j] * value;
        }
    }
    return sum;
}

/// (largest - smallest) / mean of v[0 .. WINDOW] without its quadratic trend.
static double window_ripple(const double *v) {
    double m[3] = {0, 0, 0}, s2 = 0, s4 = 0, low = HUGE_VAL, high = -HUGE_VAL;
    for (int k = 0; k <= WINDOW; k++) {
        double z = 2.0 * k / WINDOW - 1;
        m[0] += v[k];
        m[1] += v[k] * z;
        m[2] += v[k] * z * z;
        s2 += z * z;
        s4 += z * z * z * z;
    }
    double n = WINDOW + 1, c = (m[2] - m[0] * s2 / n) / (s4 - s2 * s2 / n), b = m[1] / s2;
    double a = (m[0] - c * s2) / n;
    for (int k = 0; k <= WINDOW; k++) {
        double z = 2.0 * k / WINDOW - 1, rest = v[k] - a - b * z - c * z * z;
        low = fmin(low, rest);
        high = fmax(high, rest);
    }
    return (high - low) / (m[0] / n);
}

static int by_size(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return x < y ? -1 : x > y;
}

static double seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/// Median time of each query; what is timed is one call and two readings of the clock.
static void time_queries(const pal_rest_surface *s, const pal_weights_table *table, const walk *w,
                         double built) {
    enum { KINDS = 7, MOST = 4000 };
    static const char *const name[KINDS] = {"closest",   "with hint", "track", "project",
                                            "with hint", "weights",   "widest"};
    double *t = calloc(KINDS * MOST, sizeof *t), sum = 0;
    int count = 0;
    for (int k = 0; t != NULL && count < MOST && k < LONGEST; k += 1) {
        for (int l = 0; l < LINES && count < MOST; l++) {
            if (k >= w[l].count) {
                continue;
            }
            const place *at = &w[l].place[k];
            pal_weights weights;
            pal_surface_point x;
            double p[3], side[3], clock[KINDS + 1], reach = 20 * at->spacing;
            const double *up = at->at.normal;
            for (int i = 0; i < 3; i++) { // a little below the surface; beside it by two spacings
                p[i] = at->at.position[i] - 0.7 * at->spacing * up[i];
                side[i] = p[i] + 2 * at->spacing * (up[(i + 1) % 3] - up[(i + 2) % 3]);
            }
            clock[0] = seconds();
            sum += pal_rest_closest(s, p, reach, -1, &x);
            clock[1] = seconds();
            sum += pal_rest_closest(s, p, reach, at->at.triangle, &x);
            clock[2] = seconds();
            sum += pal_rest_track(s, p, reach, &at->at, &x);
            clock[3] = seconds();
            sum += pal_rest_project(s, side, up, reach, 0.1, -1, &x);
            clock[4] = seconds();
            sum += pal_rest_project(s, side, up, reach, 0.1, at->at.triangle, &x);
            clock[5] = seconds();
            sum += pal_weights_at(table, &at->at, 0.0, &weights);
            clock[6] = seconds();
            sum += pal_weights_at(table, &at->at, 100, &weights);
            clock[7] = seconds();
            for (int i = 0; i < KINDS; i++) {
                t[i * MOST + count] = clock[i + 1] - clock[i];
            }
            count++;
        }
    }
    printf("  us (median of %d):", count);
    for (int i = 0; i < KINDS && count > 0; i++) {
        qsort(t + i * MOST, (size_t)count, sizeof *t, by_size);
        printf(" %s %.2f%s", name[i], 1e6 * t[i * MOST + count / 2], i < KINDS - 1 ? "," : "");
    }
    printf("; built in %.0f ms (%.0f answers)\n", 1e3 * built, sum);
    free(t);
}

/// Normal force on a ball slid along the lines at constant depth: what the hand feels.
static void slide(const pal_model *model, const walk *line, double radius, double depth, FILE *csv,
                  const char *name) {
    pal_tool_def tool = {.shape = PALPATE_SHAPE_SPHERE};
    pal_contact_def def = {
        .tool_count = 1, .tools = &tool, .max_contacts = 32, .points = 16, .period = 1e-3};
    double *v = calloc(LONGEST, sizeof *v), *window = calloc(LINES * LONGEST, sizeof *window);
    double mean = 0, jump = 0;
    int windows = 0, points = 0;
    void *memory = NULL;
    for (int l = 0; l < LINES && v != NULL && window != NULL; l++) {
        if (line[l].count == 0) {
            continue;
        }
        double h = line[l].place[0].spacing; // in spacings at the start of the line
        tool.radius = radius * h;
        memory = aligned_alloc(64, pal_contact_anywhere.bytes(model, &def));
        if (memory == NULL) {
            break;
        }
        void *law = pal_contact_anywhere.init(memory, model, &def);
        for (int i = 0; i < line[l].count; i++) {
            const pal_surface_point *at = &line[l].place[i].at;
            pal_contact_tool pose = {.pose = {.orientation = {1, 0, 0, 0}}, .present = 1};
            pal_contact_result result = {0};
            for (int c = 0; c < 3; c++) {
                pose.pose.position[c] = at->position[c] + (radius - depth) * h * at->normal[c];
            }
            pal_contact_anywhere.solve(law, &pose, &result);
            v[i] = -dot(result.tool[0].force, at->normal);
            mean += v[i];
            points++;
            if (i > 0) { // largest change in a step of 1/24 spacing, over the force
                jump = fmax(jump, fabs(v[i] - v[i - 1]) / fmax(v[i], 1e-30));
            }
        }
        for (int i = 0; i + WINDOW < line[l].count; i += SAMPLES / 2) {
            window[windows++] = window_ripple(v + i);
        }
        free(memory);
    }
    if (windows > 0) {
        qsort(window, (size_t)windows, sizeof *window, by_size);
        printf("  ball of %4.1f spacings, %.2f deep: force %.4g N, ripple %5.2f %% median, %5.2f "
               "%% worst; "
               "largest step %.2f %%\n",
               radius, depth, mean / points, 100 * window[windows / 2], 100 * window[windows - 1],
               100 * jump);
        fprintf(csv, "%s,%g,%g,%.6g,%.6g,%.6g,%.6g\n", name, radius, depth, mean / points,
                window[windows / 2], window[windows - 1], jump);
    }
    free(v);
    free(window);
}

static int measure(const char *name, const pal_model *model, FILE *csv, FILE *balls) {
    static const int nodes[] = {5, 7, 9, 11, 12, 13, 15, 17, 19};
    pal_model_info info;
    pal_model_get_info(model, &info);
    pal_rest_surface s;
    pal_weights_table table;
    pal_near_field near;
    void *a = aligned_alloc(64, pal_rest_bytes(model)),
         *b = aligned_alloc(64, pal_weights_bytes(model)),
         *d = aligned_alloc(64, pal_near_bytes(model));
    double *v = calloc(2 * (LONGEST + 1), sizeof *v),
           *window = calloc(4 * LINES * LONGEST, sizeof *window);
    if (a == NULL || b == NULL || d == NULL || v == NULL || window == NULL) {
        fprintf(stderr, "%s: no memory\n", name);
        free(a);
        free(b);
        free(d);
        free(v);
        free(window);
        return 1;
    }
    double start = seconds();
    pal_rest_init(&s, model, a);
    double surface = seconds();
    pal_near_init(&near, model, &s, 2, d); // as the law does
    pal_weights_init(&table, model, &s, PALPATE_WEIGHTS_NODES, PALPATE_WEIGHTS_POWER, b);
    double built = seconds() - start;
    surface -= start;
    walk line[LINES];
    double length = 0, longest = 0;
    int32_t inner[64], inners = 0, each = s.triangle_count / 4000 + 1;
    for (int32_t t = 0; t < s.triangle_count; t += each) { // start well inside
        static const double middle[3] = {1.0 / 3, 1.0 / 3, 1.0 / 3};
        pal_surface_point x;
        pal_weights w;
        pal_rest_point(&s, t, middle, &x);
        (void)pal_weights_at(&table, &x, 0.0, &w);
        if (x.inside > 2 * w.radius && w.count > 0) {
            inner[inners < 64 ? inners : (t * 7919) % 64] = t;
            inners += inners < 64;
        }
    }
    for (int l = 0; l < LINES; l++) {
        line[l] = (walk){0};
        if (inners > 0) {
            line[l] = walk_along(&s, &table, inner[(l * 5 + 1) % inners], 1.0 + 2.4 * l,
                                 info.spacing_mean);
        }
        length += (double)line[l].count / SAMPLES;
        longest = fmax(longest, (double)line[l].count / SAMPLES);
    }
    printf(
        "%s: %d nodes, %d touchable, E %g Pa, nu %g; %.0f spacings in %d lines; surface %.0f ms\n",
        name, info.node_count, info.touchable_count, info.young, info.poisson, length, LINES,
        1e3 * surface);
    time_queries(&s, &table, line, built);
    for (int k = 0; k < 9; k++) {
        static const double radius[] = {0.3, 1, 3}, depth[] = {0.1, 0.3, 0.8};
        slide(model, line, radius[k / 3], radius[k / 3] * depth[k % 3], balls, name);
    }
    printf("  %3s", "K");
    for (int p = 1; p <= 4; p++) {
        printf("   p=%d nodal: median worst, near field", p);
    }
    printf("   ripple [%%]\n");
    for (size_t k = 0; k < sizeof nodes / sizeof *nodes; k++) {
        printf("  %3d", nodes[k]);
        for (int p = 1; p <= 4; p++) {
            pal_weights_init(&table, model, &s, nodes[k], p, b);
            double *found[2] = {window, window + 2 * LINES * LONGEST}, sigma = 0;
            int windows = 0, points = 0;
            for (int l = 0; l < LINES; l++) {
                for (int i = 0; i < line[l].count; i++) {
                    pal_weights w;
                    (void)pal_weights_at(&table, &line[l].place[i].at, 0.0, &w);
                    const place *at = &line[l].place[i];
                    v[i] = compliance(model, NULL, &at->at, &w);
                    v[LONGEST + i] =
                        compliance(model, &near, &at->at, &w) +
                        PALPATE_NEAR_SELF * near.normal / (0.93 * line[l].place[0].spacing);
                    sigma += w.sigma / line[l].place[i].spacing;
                    points++;
                }
                for (int i = 0; i + WINDOW < line[l].count; i += SAMPLES / 2) {
                    found[0][windows] = window_ripple(v + i);
                    found[1][windows++] = window_ripple(v + LONGEST + i);
                }
            }
            if (windows == 0) {
                continue;
            }
            for (int c = 0; c < 2; c++) {
                qsort(found[c], (size_t)windows, sizeof(double), by_size);
            }
            printf("    %6.2f %6.2f  (%5.2f %6.2f)  ", 100 * found[0][windows / 2],
                   100 * found[0][windows - 1], 100 * found[1][windows / 2],
                   100 * found[1][windows - 1]);
            fprintf(csv, "%s,%d,%d,%d,%.6g,%.6g,%.6g,%.6g,%.4g\n", name, info.node_count, nodes[k],
                    p, found[0][windows / 2], found[0][windows - 1], found[1][windows / 2],
                    found[1][windows - 1], sigma / points);
        }
        printf("\n");
        fflush(stdout);
    }
    for (int l = 0; l < LINES; l++) {
        free(line[l].place);
    }
    free(a);
    free(b);
    free(d);
    free(v);
    free(window);
    return 0;
}

int main(int argc, char **argv) {
    const char *plain[] = {"store.displacement=none", "estimate=false"};
    const char *even[] = {"store.displacement=none",
                          "estimate=false",
                          "body.refine=[]",
                          "body.spacing=0.0045",
                          "body.patches={}",
                          "body.touchable=[{ball: {center: [0, 0, 0.05], radius: 0.045}}]"};
    int failed = 0;
    FILE *csv = fopen("bench/results/ripple.csv", "w"),
         *balls = fopen("bench/results/ripple_slide.csv", "w");
    if (csv == NULL || balls == NULL) {
        fprintf(stderr, "bench/results: cannot be written; run from the repository's root\n");
        return 1;
    }
    fprintf(csv, "scene,nodes,k,p,median,worst,near_median,near_worst,sigma_over_"
                 "spacing\n");
    static const char *const scenes[] = {"scenes/hemisphere.yaml", "scenes/block.yaml",
                                         "scenes/organ.yaml"};
    int count = argc > 1 ? argc - 1 : 4;
    for (int i = 0; i < count; i++) {
        const char *path = argc > 1 ? argv[i + 1] : scenes[i % 3];
        int uniform = argc == 1 && i == 3;
        pal_model *model = uniform ? build(path, even, 6) : build(path, plain, 2);
        failed |=
            model == NULL || measure(uniform ? "uniform hemisphere" : path, model, csv, balls);
        pal_model_free(model);
    }
    fclose(csv);
    fclose(balls);
    return failed;
}
