/// @file stability.c  Bench: how stiff may the loop be? Z-width, energy per cycle, default
/// coupling.
///
/// A simulated device (haptic/device/simulated.c: figures and sources) at 1 kHz in freewheel
/// against
///   1 a virtual wall F = -K x - B dx/dt (backward difference), device without friction, no hand:
///   largest
///     K without growth beside the bounds 2 b / T (stable) and 2 (b - |B|) / T (passive with any
///     hand: Colgate and Schenkel 1997);
///   2 an elastic half-space through the engine: largest coupling stiffness without growth over 10
///   s
///     after a tap of 0.2 m/s, by coupling damping, organ (E = 1e3 .. 1e6 Pa), device and hand;
///   3 a slab (a real model): no coupling and the default coupling on soft and stiff organs:
///   growth,
///     and the energy that a cycle of palpation returns beyond what it took;
///   4 a hemisphere's node held by the grasp of a device that nobody holds: raw collocated
///   compliance
///     against the repaired one.
/// "bare" is the device without Coulomb friction and with exact encoders, only its 0.1 N s/m: a
/// worst case, since friction is what calms real ones.
///
/// Without a hand, a coupling (k, B) in series with an organ K_o passes the device k r, with
/// r = K_o / (K_o + k), and B r^2; sampling takes k r T / 2. So b + B r^2 > k r T / 2 for every
/// organ, that is k < (4 / T) sqrt(b B) (where that r is below 1, else k < 2 (b + B) / T): the line
/// in the second plot.
///
///     bench/stability [--quick] [--part 1..4] [--plot]
/// writes bench/results/stability_{wall,width,default,raw}.csv and stability.png (gnuplot).
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <palpate/precompute.h>
#include <palpate/scene.h>

#include "tests/support/closed_loop.h"
#include "tests/support/synthetic_model.h"

static const double PERIOD = 1e-3, STIFFEST = 25600.0, TAP = 0.2;
static const char *const DEVICE[] = {"bare", "touch", "premium"};
static const char *const GRIP[] = {"firm", "light", "none"}; // pal_simulated_grip

static pal_simulated device_of(int device, int grip) {
    pal_simulated s =
        pal_simulated_default(device == 2 ? PALPATE_SIMULATED_PREMIUM : PALPATE_SIMULATED_TOUCH,
                              (pal_simulated_grip)grip);
    if (device == 0) {
        s.friction = s.resolution = 0.0;
    }
    return s;
}

static pal_tool_def tool_of(int device, int grip, const double start[3], double radius) {
    pal_tool_def t = {.name = "probe",
                      .shape = PALPATE_SHAPE_SPHERE,
                      .radius = radius,
                      .has_start = 1,
                      .axis = {0, 0, -1}};
    memcpy(t.start, start, sizeof t.start);
    t.device.kind = PALPATE_DEVICE_SIMULATED;
    t.device.simulated = device_of(device, grip);
    t.device.stroke = (pal_stroke){.ramp = 0.3, .period = 0.5, .direction = {1, 0, 0}};
    return t;
}

static void *must(void *p, const char *what) {
    if (p == NULL) {
        fprintf(stderr, "bench/stability: %s\n", what);
        exit(1);
    }
    return p;
}

static FILE *table(const char *name, const char *head) {
    char path[128];
    snprintf(path, sizeof path, "bench/results/stability_%s.csv", name);
    FILE *f =
        must(fopen(path, "w"), "bench/results cannot be written; run from the repository's root");
    fprintf(f, "%s\n", head);
    return f;
}

static loop_result loop(const loop_def *def) {
    loop_result r;
    pal_error error = {0};
    if (loop_run(def, &r, &error) != PALPATE_OK) {
        fprintf(stderr, "bench/stability: %s\n", error.message);
        exit(1);
    }
    return r;
}

/// Largest value up to STIFFEST below the first at which `calm` says no, by doubling, then halving
/// the octave `halvings` times (3: to 9 %). INFINITY: none said no.
static double largest(int (*calm)(double k, const void *with), const void *with, int halvings) {
    double low = 0.0, high = 25.0;
    while (calm(high, with)) {
        low = high;
        high *= 2.0;
        if (high > STIFFEST) {
            return INFINITY;
        }
    }
    for (int i = 0; i < halvings && low > 0.0; i++) {
        double k = sqrt(low * high);
        if (calm(k, with)) {
            low = k;
        } else {
            high = k;
        }
    }
    return low;
}

// ---- 1: a wall ----------------------------------------------------------------------------------

typedef struct wall {
    double b, damping;
} wall;

static int calm_wall(double k, const void *with) {
    const wall *w = with;
    pal_tool_def t = tool_of(0, PALPATE_GRIP_NONE, (const double[3]){0, 0, 0}, 0.004);
    t.device.simulated.damping = w->b;
    t.device.simulated.kick = TAP;
    t.device.simulated.force = 1e4;
    t.device.simulated.reach = 1e3;
    pal_device d;
    must(pal_device_create(&t, PERIOD, &d, NULL) == PALPATE_OK ? &d : NULL, "no device");
    double before = 0.0, middle = 0.0, late = 0.0;
    for (int n = 0; n < 10000 && fabs(before) < 0.5; n++) {
        pal_tool_state in;
        pal_tool_force f = {.fault = 0};
        (void)d.read(d.self, n * (int64_t)1000000, &in);
        double z = in.position[2];
        f.force[2] = -k * z - w->damping * (z - before) / PERIOD;
        (void)d.write(d.self, 0, &f);
        before = z;
        middle = n >= 1000 && n < 3000 ? fmax(middle, fabs(z)) : middle;
        late = n >= 8000 ? fmax(late, fabs(z)) : late;
    }
    d.close(d.self);
    return fabs(before) < 0.5 && late <= 0.999 * middle + 1e-15;
}

static void walls(void) {
    FILE *f =
        table("wall", "device_damping,wall_damping,largest_stiffness,stable_bound,passive_bound");
    printf("1 virtual wall, no hand, no friction, T = 1 ms\n   b [N s/m]  B [N s/m]   largest K   "
           "2b/T   2(b-|B|)/T\n");
    const double b[] = {0.05, 0.1, 0.2, 0.5, 1, 2}, damping[] = {0, 0.2};
    for (int j = 0; j < 2; j++) {
        for (int i = 0; i < 6; i++) {
            wall w = {b[i], damping[j]};
            double k = largest(calm_wall, &w, 7),
                   passive = fmax(0.0, 2 * (w.b - w.damping) / PERIOD);
            fprintf(f, "%g,%g,%g,%g,%g\n", w.b, w.damping, k, 2 * w.b / PERIOD, passive);
            printf("   %-9g  %-9g  %10.0f  %6.0f  %6.0f\n", w.b, w.damping, k, 2 * w.b / PERIOD,
                   passive);
        }
    }
    fclose(f);
}

// ---- 2: width -----------------------------------------------------------------------------------

static int calm_organ(double k, const void *with) {
    loop_def def = *(const loop_def *)with;
    def.tool.coupling_stiffness = k;
    loop_result r = loop(&def);
    int held = def.tool.device.simulated.hand_mass > 0.0;
    return (held || r.touching > 0) && loop_calms(&r, def.tool.device.simulated.resolution);
}

static void widths(int quick) {
    FILE *f = table("width", "young,device,hand,damping,contact_stiffness,rigid_calm,largest_"
                             "stiffness,all_organs_bound");
    printf(
        "2 largest coupling stiffness without growth over 10 s [N/m] (inf: none up to %g grew)\n",
        STIFFEST);
    printf("   passive with any hand, bare (b = 0.1): K < 2 (b - |B|) / T = 200 N/m at B = 0, none "
           "from B = 0.1 on\n");
    printf("   E [Pa]   device   hand    K_o [N/m]  no coupling   B=0      0.1      0.3      1     "
           "   3 N s/m\n");
    const double damping[] = {0, 0.1, 0.3, 1, 3};
    for (double young = 1e3; young < 2e6; young *= 10) {
        synthetic_params p = synthetic_default_params();
        p.n = 11;
        p.young = young;
        p.rows = SYNTHETIC_ROWS_NONE;
        pal_model *model = must(synthetic_model(&p), "out of memory");
        for (int device = 0; device < 3; device++) {
            for (int grip = 2; grip >= (quick ? 2 : 0); grip--) {
                loop_def def = {.model = model, .seconds = 10, .period = PERIOD, .points = 7};
                def.tool = tool_of(device, grip, (const double[3]){3e-4, 2e-4, 0.004}, 0.004);
                def.stop_when_still = device > 0;
                double force = loop_press(model, &def.tool, 2e-3);
                def.tool.device.simulated.push = fmin(1.0, force);
                def.tool.device.simulated.kick = TAP;
                loop_result rigid = loop(&def);
                int calm = loop_calms(&rigid, def.tool.device.simulated.resolution);
                // of a Hertzian contact at 2 mm: dF/dd = 1.5 F/d
                printf("   %-8g %-8s %-7s %9.0f  %-12s", young, DEVICE[device], GRIP[grip],
                       1.5 * force / 2e-3, calm ? "calm" : "GROWS");
                for (int i = 0; i < 5; i++) {
                    def.tool.coupling_damping = damping[i];
                    double k = largest(calm_organ, &def, 3), b = def.tool.device.simulated.damping;
                    double bound =
                        fmin(4 / PERIOD * sqrt(b * damping[i]), 2 * (b + damping[i]) / PERIOD);
                    fprintf(f, "%g,%s,%s,%g,%g,%d,%g,%g\n", young, DEVICE[device], GRIP[grip],
                            damping[i], 1.5 * force / 2e-3, calm, fmin(k, 2 * STIFFEST),
                            fmax(bound, 2 * b / PERIOD));
                    printf(" %-8.0f", k);
                    fflush(stdout);
                }
                printf("\n");
            }
        }
        pal_model_free(model);
    }
    fclose(f);
}

// ---- 3 and 4: real models -----------------------------------------------------------------------

static pal_model *model_of(const char *text, const char *const set[], int sets) {
    char path[] = "/tmp/palpate-stability-XXXXXX";
    int fd = mkstemp(path);
    FILE *file = must(fd >= 0 ? fdopen(fd, "w") : NULL, "no temporary file");
    fputs(text, file);
    fclose(file);
    pal_scene *scene = NULL;
    pal_model *model = NULL;
    pal_error error = {0};
    if (pal_scene_load(path, set, sets, &scene, &error) != PALPATE_OK ||
        pal_precompute(scene, NULL, &model, &error) != PALPATE_OK) {
        fprintf(stderr, "bench/stability: %s\n", error.message);
        exit(1);
    }
    remove(path);
    pal_scene_free(scene);
    return model;
}

/// A slab of 10 x 10 x 5 cm on its base: flat, so that a device that nobody holds stays on it.
static pal_model *slab(double young) {
    char set_young[64];
    snprintf(set_young, sizeof set_young, "body.material.young=%g", young);
    return model_of("palpate: 1\n"
                    "body:\n"
                    "  geometry: {box: {size: [0.1, 0.1, 0.05], center: [0, 0, -0.025]}}\n"
                    "  spacing: 0.0125\n"
                    "  refine: [{center: [0, 0, 0], radius: 0.012, spacing: 0.003}]\n"
                    "  material: {young: 1e4, poisson: 0.45}\n"
                    "  fixed: [{below: {z: -0.05}}]\n"
                    "  touchable: [{ball: {center: [0, 0, 0], radius: 0.025}}]\n"
                    "store: {displacement: none}\n",
                    (const char *const[]){set_young}, 1);
}

static const double TOP[3] = {0, 0, 0.004};

static void defaults(int quick) {
    FILE *f =
        table("default", "young,device,hand,coupling,calm,swing_first,swing_last,taken,excess");
    printf("3 a slab of organ: tapped at 0.2 m/s for 10 s, then palpated by the hand, 4 mm deep at "
           "2 Hz\n");
    printf("   (off: at rest above the organ, held by friction)\n   E [Pa]   device   hand    "
           "coupling   tap: swing first..last [mm]   cycle: taken [mJ]  excess [mJ]  of it\n");
    for (double young = 1e3; young < 2e6; young *= quick ? 10 : sqrt(10)) {
        pal_model *model = slab(young);
        for (int device = 0; device < 3; device++) {
            for (int grip = 2; grip >= 0; grip--) {
                for (int coupled = 0; coupled < 2; coupled++) {
                    loop_def def = {.model = model, .seconds = 10, .period = PERIOD};
                    def.tool = tool_of(device, grip, TOP, 0.004);
                    def.stop_when_still = device > 0;
                    def.tool.coupling_stiffness =
                        coupled ? PALPATE_DEFAULT_COUPLING_STIFFNESS : 0.0;
                    def.tool.coupling_damping =
                        coupled ? PALPATE_DEFAULT_COUPLING_STIFFNESS * PERIOD : 0.0;
                    def.tool.device.simulated.push = fmin(1.0, loop_press(model, &def.tool, 2e-3));
                    def.tool.device.simulated.kick = TAP;
                    loop_result tap = loop(&def), cycle = {.cycle_taken = NAN, .cycle_given = NAN};
                    int calm = loop_calms(&tap, def.tool.device.simulated.resolution);
                    if (grip != PALPATE_GRIP_NONE) {
                        def.tool.device.simulated.push = def.tool.device.simulated.kick = 0.0;
                        def.tool.device.stroke.kind = PALPATE_STROKE_PALPATION;
                        def.tool.device.stroke.depth = 4e-3;
                        def.cycle = 0.5;
                        def.stop_when_still = 0;
                        cycle = loop(&def);
                    }
                    calm = !calm || grip != PALPATE_GRIP_NONE || tap.touching > 0 ? calm : -1;
                    fprintf(f, "%g,%s,%s,%s,%d,%g,%g,%g,%g\n", young, DEVICE[device], GRIP[grip],
                            coupled ? "default" : "none", calm, tap.swing[0],
                            tap.swing[LOOP_WINDOWS - 1], cycle.cycle_taken, cycle.cycle_given);
                    printf("   %-8.3g %-8s %-7s %-9s  %-6s %8.3f .. %-8.3g      ", young,
                           DEVICE[device], GRIP[grip], coupled ? "default" : "none",
                           calm > 0   ? "calm"
                           : calm < 0 ? "off"
                                      : "GROWS",
                           1e3 * tap.swing[0], 1e3 * tap.swing[LOOP_WINDOWS - 1]);
                    if (cycle.cycle_taken > 1e-7) { // else friction held the hand off the organ
                        printf("%12.4g %12.3g %8.2g %%", 1e3 * cycle.cycle_taken,
                               1e3 * cycle.cycle_given,
                               100 * cycle.cycle_given / cycle.cycle_taken);
                    }
                    printf("\n");
                    fflush(stdout);
                }
            }
        }
        pal_model_free(model);
    }
    fclose(f);
}

static void raw(void) {
    static const char *const text =
        "palpate: 1\n"
        "body:\n"
        "  geometry: {hemisphere: {radius: 0.05}}\n"
        "  spacing: 0.01\n"
        "  material: {young: 1e4, poisson: 0.3}\n"
        "  fixed: [{below: {z: 0}}]\n"
        "  touchable: [{ball: {center: [0, 0, 0.05], radius: 0.02}}]\n"
        "  patches: {pole: {ball: {center: [0, 0, 0.05], radius: 0.01}, rim_spacing: 0.0025}}\n"
        "store: {displacement: none}\n"
        "method: {form: collocated}\n"
        "repair: none\n";
    static const char *const repaired[] = {"repair=symmetrize"};
    pal_model *model[2] = {model_of(text, NULL, 0), model_of(text, repaired, 1)};
    FILE *f = table("raw", "time,model,damping,swing");
    int32_t column = loop_worst_column(model[0]);
    double skew, stiffness;
    (void)loop_forceps(model[0], column, 0.1, &skew, &stiffness);
    printf("4 collocated hemisphere, E = 1e4 Pa, a node held by forceps, circled at 2 mm; the hand "
           "lets go at 1.5 s\n");
    printf("   stiffness %.0f N/m, its skew part %.1f %%: it feeds a circle below b = %.2g N s/m "
           "(skew / omega); "
           "sampling any motion below %.2g\n",
           stiffness, 100 * skew, skew * sqrt(stiffness * device_of(0, PALPATE_GRIP_NONE).mass),
           stiffness * PERIOD / 2);
    printf("   model      b [N s/m]   swing [mm] after 1.75   2.25     3.25     5.25     9.75 s   "
           "given - taken\n");
    for (int m = 0; m < 2; m++) {
        const double damping[] = {0.05, 0.1, 0.2, 0.4};
        for (int i = 0; i < 4; i++) {
            loop_def def = {.model = model[m], .seconds = 10, .period = PERIOD, .nodes = 1};
            def.tool = loop_forceps(model[m], column, damping[i], NULL, NULL);
            loop_result r = loop(&def);
            for (int w = 0; w < LOOP_WINDOWS; w++) {
                fprintf(f, "%g,%s,%g,%g\n", (w + 0.5) * 0.5, m ? "repaired" : "raw", damping[i],
                        r.swing[w]);
            }
            printf("   %-9s  %-9g       %14.3g %8.3g %8.3g %8.3g %8.3g      %.3g mJ\n",
                   m ? "repaired" : "raw", damping[i], 1e3 * r.swing[3], 1e3 * r.swing[4],
                   1e3 * r.swing[6], 1e3 * r.swing[10], 1e3 * r.swing[19],
                   1e3 * (r.given - r.taken));
        }
        pal_model_free(model[m]);
    }
    fclose(f);
}

static void plot(void) {
    FILE *g = popen("gnuplot", "w");
    if (g == NULL) {
        fprintf(stderr, "gnuplot is missing: no plots\n");
        return;
    }
    static const char *const script =
        "set datafile separator ','\nset terminal pngcairo size 1500,1000 font 'DejaVu Sans,10'\n"
        "set output 'bench/results/stability.png'\nset multiplot layout 2,2\nset grid\nset "
        "logscale xy\nset format y '10^{%L}'\nset key left top\n"
        "r = 'bench/results/stability_'\n"
        "set format x '%g'\nset title 'Virtual wall, no hand, T = 1 ms: largest stiffness'\nset "
        "xlabel 'damping of the device b [N s/m]'\n"
        "set ylabel 'K [N/m]'\n"
        "plot r.'wall.csv' using ($2==0 ? $1 : 1/0):3 with points title 'measured, B = 0', "
        "'' using ($2==0 ? $1 : 1/0):4 with lines title '2 b / T', "
        "'' using ($2==0.2 ? $1 : 1/0):3 with points title 'measured, B = 0.2', "
        "'' using ($2==0.2 && $5>0 ? $1 : 1/0):5 with lines title 'passive with any hand: 2 (b - "
        "|B|) / T'\n"
        "unset logscale x\nset title 'Coupling on a half-space: largest stiffness (51200: none "
        "grew)'\n"
        "set xlabel 'damping of the coupling B [N s/m]'\nset ylabel 'k [N/m]'\n"
        "set key right bottom\n"
        "w = '< grep '\n"
        "plot for [e in '1e+05 1e+06'] for [d in 'bare premium'] w.\"'\".(e eq '1e+05' ? "
        "'^100000,' : '^1e+06,').d.',none'.\"' \".r.'width.csv' "
        "using 4:7 with linespoints title d.', no hand, E = '.e, "
        "w.\"'^1e+06,bare,light' \".r.'width.csv' using 4:7 with linespoints title 'bare, light "
        "hand, E = 1e+06', "
        "w.\"'^1e+06,bare,none' \".r.'width.csv' using 4:8 with lines dashtype 2 title 'bound over "
        "all organs', "
        "'-' using 1:2 with points pointtype 7 pointsize 2 title 'default'\n"
        "1,1000\ne\n"
        "set logscale xy\nset title 'Slab palpated 4 mm at 2 Hz by a firm hand, bare device: a "
        "cycle'\n"
        "set xlabel 'Young modulus [Pa]'\nset ylabel 'energy [J]'\nset key left top\n"
        "set yrange [1e-7:1e-2]\n"
        "plot for [c in 'none default'] w.\"',bare,firm,\".c.\"' \".r.'default.csv' using 1:8 with "
        "linespoints title 'taken, coupling '.c, "
        "for [c in 'none default'] w.\"',bare,firm,\".c.\"' \".r.'default.csv' using 1:(abs($9)) "
        "with linespoints dashtype 2 title '|returned in excess|, coupling '.c\n"
        "unset logscale x\nset title 'Grasped hemisphere, no hand: the raw model feeds the "
        "loop'\nset xlabel 'time [s]'\n"
        "set ylabel 'swing [m]'\nset key outside right center\nset yrange [1e-7:1]\n"
        "plot for [m in 'raw repaired'] for [b in '0.05 0.1 0.2 0.4'] w.\"',\".m.','.b.\",' "
        "\".r.'raw.csv' using 1:($1>1.5 ? $4 : 1/0) "
        "with linespoints title m.', b = '.b.' N s/m'\n"
        "unset multiplot\n";
    fputs(script, g);
    if (pclose(g) != 0) {
        fprintf(stderr, "gnuplot failed: no plots\n");
    }
}

int main(int argc, char **argv) {
    int quick = 0, part = 0;
    for (int i = 1; i < argc; i++) {
        if (strcmp(argv[i], "--plot") == 0) {
            plot();
            return 0;
        }
        if (strcmp(argv[i], "--part") == 0 && i + 1 < argc) {
            part = atoi(argv[i + 1]);
        }
        quick |= strcmp(argv[i], "--quick") == 0;
    }
    if (part == 0 || part == 1) {
        walls();
    }
    if (part == 0 || part == 2) {
        widths(quick);
    }
    if (part == 0 || part == 3) {
        defaults(quick);
    }
    if (part == 0 || part == 4) {
        raw();
    }
    if (part == 0) {
        plot();
    }
    return 0;
}
