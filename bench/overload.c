/// @file overload.c  Bench: a displacement field too large for the period costs frames, never
/// forces.
///
/// A real-time servo at 2.5 kHz under a scripted slide with friction on a half space with 30 000
/// stored nodes, whose field takes longer than the 400 us there are; in alternating slices, one
/// after the other:
///   none     the same body without stored rows: what the machine itself does to the force
///   servo    the field by the servo: it must give way
///   render   the field by the render thread (render: {field: render})
/// Per slice: share of periods with a tick, pose to force, share of ticks with a field, frames
/// drawn a second. Medians over the slices are printed with the ratio to `none` of the same round.
///
///     bench/overload [--slices N] [--seconds S]        (default 7 slices of 2 s each)
/// writes bench/results/overload.csv.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <palpate/session.h>

#include "haptic/model/model.h"
#include "tests/support/synthetic_model.h"

enum { SLICES_MAX = 100, KINDS = 3, VALUES = 8 };
static const char *const kind_name[KINDS] = {"none", "servo", "render"};
static const char *const value_name[VALUES] = {"ticks %",   "pose to force p50", "p99",
                                               "p99.9",     "lateness p99",      "fields %",
                                               "field p50", "frames/s"};

static int by_value(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

static double median(const double *v, int count) {
    double sorted[SLICES_MAX];
    memcpy(sorted, v, (size_t)count * sizeof *v);
    qsort(sorted, (size_t)count, sizeof *sorted, by_value);
    return count % 2 ? sorted[count / 2] : 0.5 * (sorted[count / 2 - 1] + sorted[count / 2]);
}

static int slice(const pal_model *model, int kind, double seconds, double out[VALUES]) {
    pal_error error = {0};
    pal_session *session = NULL;
    pal_tool_def tool = pal_model_runtime(model)->tools[0];
    tool.radius = 0.012;
    tool.friction = 0.3; // without it two columns in three carry nothing and are left out
    tool.start[2] = tool.radius;
    tool.device.kind = PALPATE_DEVICE_SCRIPTED;
    tool.device.stroke = (pal_stroke){.kind = PALPATE_STROKE_CIRCLE,
                                      .depth = 0.0019,
                                      .ramp = 0.2,
                                      .period = 1,
                                      .amplitude = 0.002};
    pal_session_def def = pal_session_default_def();
    def.engine.tool_count = 1;
    def.engine.tools = &tool;
    def.engine.period = 4e-4;
    def.engine.frame_age = 1; // every tick wants its field
    def.engine.field_by = kind == 2 ? PALPATE_FIELD_BY_READER : PALPATE_FIELD_BY_SERVO;
    def.duration = seconds;
    if (pal_device_create(&tool, def.engine.period, &def.devices[0], &error) != PALPATE_OK ||
        pal_session_create(model, &def, &session, &error) != PALPATE_OK ||
        pal_session_start(session, &error) != PALPATE_OK ||
        pal_session_finish(session, &error) != PALPATE_OK) {
        (void)fprintf(stderr, "bench/overload: %s\n", error.message);
        pal_session_free(session);
        return 1;
    }
    pal_session_report r;
    pal_session_get_report(session, &r);
    pal_session_free(session);
    out[0] = 100.0 * (double)r.ticks / (double)(r.ticks + r.missed);
    out[1] = r.pose_to_force_us.p50;
    out[2] = r.pose_to_force_us.p99;
    out[3] = r.pose_to_force_us.p999;
    out[4] = r.lateness_us.p99;
    out[5] = 100.0 * (double)(r.ticks - r.field_skipped) / (double)r.ticks;
    out[6] = r.field_us.p50;
    out[7] = (double)r.frames / r.seconds;
    return 0;
}

int main(int argc, char **argv) {
    int slices = 7;
    double seconds = 2.0;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--slices") == 0 && i + 1 < argc) {
            slices = (int)fmin(SLICES_MAX, fmax(1.0, atof(argv[++i])));
        } else if (strcmp(argv[i], "--seconds") == 0 && i + 1 < argc) {
            seconds = fmin(60.0, fmax(0.5, atof(argv[++i])));
        } else {
            (void)fprintf(stderr, "usage: %s [--slices N] [--seconds S]\n", argv[0]);
            return 2;
        }
    }
    synthetic_params p = synthetic_default_params();
    p.n = 13;
    p.layers = 135;
    p.rows = SYNTHETIC_ROWS_ALL;
    pal_model *large = synthetic_model(&p);
    p.rows = SYNTHETIC_ROWS_NONE;
    p.layers = 2;
    pal_model *none = synthetic_model(&p);
    FILE *csv = fopen("bench/results/overload.csv", "w");
    if (large == NULL || none == NULL || csv == NULL) {
        (void)fprintf(stderr, "bench/overload: out of memory, or run from the project's folder\n");
        return 1;
    }
    static double value[KINDS][VALUES][SLICES_MAX];
    (void)fprintf(csv,
                  "slice,field,ticks_percent,pose_to_force_p50_us,p99_us,p999_us,lateness_p99_us,"
                  "fields_percent,field_p50_us,frames_per_second\n");
    for (int k = 0; k < slices; k++) {
        for (int turn = 0; turn < KINDS; turn++) {
            int kind = (turn + k) % KINDS;
            double v[VALUES];
            if (slice(kind == 0 ? none : large, kind, seconds, v) != 0) {
                return 1;
            }
            (void)fprintf(csv, "%d,%s", k, kind_name[kind]);
            for (int i = 0; i < VALUES; i++) {
                value[kind][i][k] = v[i];
                (void)fprintf(csv, ",%.2f", v[i]);
            }
            (void)fprintf(csv, "\n");
        }
    }
    (void)fclose(csv);
    printf("%d stored nodes, servo at 2.5 kHz, %d slices of %g s each way; medians (ratio to `none` "
           "of the round) "
           "[us]\n%-20s",
           large->info.row_count, slices, seconds, "field by");
    for (int i = 0; i < VALUES; i++) {
        printf(" %18s", value_name[i]);
    }
    for (int kind = 0; kind < KINDS; kind++) {
        printf("\n%-20s", kind_name[kind]);
        for (int i = 0; i < VALUES; i++) {
            double ratio[SLICES_MAX];
            for (int k = 0; k < slices; k++) {
                ratio[k] = value[kind][i][k] / value[0][i][k];
            }
            printf(" %10.1f", median(value[kind][i], slices));
            if (kind > 0 && i < 5) {
                printf(" (%.2f) ", median(ratio, slices));
            } else {
                printf("%8s", "");
            }
        }
    }
    printf("\nbench/results/overload.csv\n");
    pal_model_free(large);
    pal_model_free(none);
    return 0;
}
