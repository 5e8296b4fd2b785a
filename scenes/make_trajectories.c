/// make_trajectories.c  Writes scenes/trajectories/*.csv: press, slide and palpation with
/// physiological tremor for the shipped scenes.
///
///     make && cc -Iinclude -I. scenes/make_trajectories.c build/libpalpate.so -Wl,-rpath,build
///         -o build/make_trajectories && build/make_trajectories scenes/trajectories
///
/// The strokes are the library's own scripted ones (haptic/device/stroke.h has the formulas), sampled.
/// Each begins `lift` before the tool touches, so that a run shows the first contact. Tremor: three
/// sines between 8 and 12 Hz, each coordinate within 0.2 mm; 200 Hz keeps linear interpolation
/// within 2 % of it.
#include <stdio.h>
#include <string.h>

#include "haptic/device/stroke.h"

/// A scene's tool where it just touches, and how far its strokes go. The axis is -z everywhere.
typedef struct place {
    const char *prefix;
    double start[3]; ///< as in the scene [m]
    double lift;     ///< the stroke begins this far above [m]
    double depth;    ///< below touching [m]
    double reach;    ///< half travel of the slide [m]
} place;

static const place places[] = {
    {"", {0, 0, 0.054}, 0.002, 0.005, 0.010},                    // hemisphere.yaml
    {"block-", {0, 0, 1.0}, 0.02, 0.1, 0.2},                     // block.yaml
    {"organ-", {-0.0306, 0.0074, 0.05237}, 0.002, 0.006, 0.012}, // organ.yaml
};

static int write_one(const char *folder, const place *p, const char *name, const pal_stroke *stroke,
                     double rate) {
    const double axis[3] = {0, 0, -1}, start[3] = {p->start[0], p->start[1], p->start[2] + p->lift};
    char path[1024];
    pal_stroke_path bound;
    pal_trajectory t = {0};
    pal_error error = {0};
    (void)snprintf(path, sizeof path, "%s/%s%s.csv", folder, p->prefix, name);
    FILE *file = fopen(path, "w");
    if (file == NULL) {
        perror(path);
        return 1;
    }
    int ok = pal_stroke_bind(name, stroke, start, axis, &bound, &error) == PALPATE_OK &&
             pal_stroke_sample(&bound, 10.0, rate, &t, &error) == PALPATE_OK &&
             pal_trajectory_write(&t, file, &error) == PALPATE_OK;
    ok = fclose(file) == 0 && ok;
    if (!ok) {
        fprintf(stderr, "%s: %s\n", path, error.message);
    }
    pal_trajectory_clear(&t);
    return !ok;
}

int main(int argc, char **argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: make_trajectories FOLDER\n");
        return 2;
    }
    int failed = 0;
    for (size_t i = 0; i < sizeof places / sizeof *places; i++) {
        const place *p = &places[i];
        // down in 6 s, then 4 s at rest: the end of the run is a static press
        const pal_stroke press = {
            .kind = PALPATE_STROKE_PRESS, .depth = p->lift + p->depth, .ramp = 6.0};
        // down in 2 s, then to and fro
        const pal_stroke slide = {.kind = PALPATE_STROKE_SLIDE,
                                  .depth = p->lift + 0.6 * p->depth,
                                  .ramp = 2.0,
                                  .period = 4.0,
                                  .amplitude = p->reach,
                                  .direction = {1, 0, 0}};
        // in and out once a second and a quarter, with tremor
        const pal_stroke palpation = {.kind = PALPATE_STROKE_PALPATION,
                                      .depth = p->lift + 0.8 * p->depth,
                                      .ramp = 0.5,
                                      .period = 1.25,
                                      .tremor_amplitude = 2e-4,
                                      .tremor_frequency = 10.0};
        failed |= write_one(argv[1], p, "press", &press, 50.0);
        failed |= write_one(argv[1], p, "slide", &slide, 50.0);
        failed |= write_one(argv[1], p, "palpation", &palpation, 200.0);
    }
    return failed;
}
