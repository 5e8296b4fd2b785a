/// @file golden.c  Prints a hash of everything the engine answers on one fixed model, per scenario.
///
/// The model (a half space, synthetic_model.c) and the tools' paths come from +, -, *, / and sqrt
/// alone, which IEEE 754 rounds correctly, so every build starts from the same bits; the first line
/// is the model's own hash. tests/golden/compare.sh builds the online library in several ways and
/// compares what this prints: compiler, optimisation level and instruction set must not change a
/// bit of a force. Nothing of a pal_tool_force is left out. A field kernel the processor lacks is
/// not run; the kernels must agree among themselves, so their lines do not name them.
#include <inttypes.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/engine/engine.h"
#include "haptic/base/hash.h"
#include "haptic/model/model.h"
#include "tests/support/synthetic_model.h"

int main(void);

enum { TICKS = 600, LAWS = 2 };

/// Choose a contact law. @return its name
static const char *choose_law(pal_engine_def *def, int law) {
    def->contact_law = law == 0 ? PALPATE_CONTACT_SURFACE : PALPATE_CONTACT_NODES;
    return law == 0 ? "surface" : "nodes";
}

typedef struct scenario {
    const char *name;
    pal_shape_kind shape;
    double radius, length;
    double skew; ///< of the model: above 0 takes the nonsymmetric solver
    int32_t tools;
    int32_t max_contacts;
    double friction, coupling;
} scenario;

static const scenario list[] = {
    {"point", PALPATE_SHAPE_POINT, 0.0, 0.0, 0.0, 1, 32, 0.0, 0.0},
    {"sphere", PALPATE_SHAPE_SPHERE, 0.004, 0.0, 0.0, 1, 32, 0.0, 0.0},
    {"sphere, coupled", PALPATE_SHAPE_SPHERE, 0.004, 0.0, 0.0, 1, 32, 0.0, 500.0},
    {"sphere, rough", PALPATE_SHAPE_SPHERE, 0.004, 0.0, 0.0, 1, 32, 0.4, 0.0},
    {"sphere, raw model", PALPATE_SHAPE_SPHERE, 0.004, 0.0, 0.02, 1, 32, 0.0, 0.0},
    {"sphere, few contacts", PALPATE_SHAPE_SPHERE, 0.008, 0.0, 0.0, 1, 6, 0.0, 0.0},
    {"capsule", PALPATE_SHAPE_CAPSULE, 0.002, 0.010, 0.0, 1, 32, 0.0, 0.0},
    {"capsule, rough", PALPATE_SHAPE_CAPSULE, 0.002, 0.010, 0.0, 1, 32, 0.3, 200.0},
    {"two spheres", PALPATE_SHAPE_SPHERE, 0.003, 0.0, 0.0, 2, 32, 0.0, 0.0},
};

/// Between -1 and 1, in straight lines.
static double triangle_wave(int tick, int period) {
    int phase = tick % period;
    double up = 4.0 * (double)phase / (double)period;
    return phase * 4 < period ? up : phase * 4 < 3 * period ? 2.0 - up : up - 4.0;
}

/// In, along, turning, out again; out of contact at both ends.
static pal_tool_state path(const scenario *s, int tool, int tick) {
    double t = (double)tick / TICKS, in = 4.0 * t * (1.0 - t);
    double clear = s->shape == PALPATE_SHAPE_POINT ? 0.0005 : s->radius + 0.0005;
    double half = s->shape == PALPATE_SHAPE_CAPSULE ? 0.5 * s->length : 0.0;
    double tilt = 0.5 * triangle_wave(tick, 400), size = sqrt(1.0 + tilt * tilt);
    pal_tool_state state = {.orientation = {1.0 / size, tilt / size, 0.0, 0.0}};
    state.position[0] = 0.004 * triangle_wave(tick, 300) + (tool == 0 ? -0.001 : 0.003);
    state.position[1] = 0.003 * triangle_wave(tick + 50, 220) + (tool == 0 ? -0.002 : 0.002);
    state.position[2] = clear + half - 0.0035 * in;
    state.buttons = tick > TICKS / 2 && tick < TICKS / 2 + 60; // takes hold, where the law can
    return state;
}

static void hash_force(pal_hash *hash, const pal_tool_force *f) {
    pal_hash_update(hash, f->force, sizeof f->force);
    pal_hash_update(hash, f->torque, sizeof f->torque);
    pal_hash_update(hash, &f->contact_count, sizeof f->contact_count);
    pal_hash_update(hash, &f->fault, sizeof f->fault);
    pal_hash_update(hash, &f->depth, sizeof f->depth);
    pal_hash_update(hash, f->centroid, sizeof f->centroid);
    pal_hash_update(hash, f->normal, sizeof f->normal);
}

static void print_hash(const char *law, const char *name, const char *what, pal_hash *hash,
                       double peak) {
    uint8_t sum[PALPATE_HASH_BYTES];
    pal_hash_final(hash, sum);
    (void)printf("%s; %s; %s: ", law, name, what);
    for (int i = 0; i < 16; i++) {
        (void)printf("%02x", sum[i]);
    }
    (void)printf(" peak %.17g\n", peak);
}

static void fail(const char *what, const char *why) {
    (void)fprintf(stderr, "golden: %s: %s\n", what, why);
    exit(1);
}

/// One run. @param isa  field kernel
static void run(const pal_model *model, const scenario *s, int law, pal_isa isa, int forces_too) {
    pal_tool_def tool[2];
    pal_engine_def def = pal_engine_default_def();
    memset(tool, 0, sizeof tool);
    for (int i = 0; i < s->tools; i++) {
        tool[i] = (pal_tool_def){.name = "tool",
                                 .shape = s->shape,
                                 .radius = s->radius,
                                 .length = s->length,
                                 .friction = s->friction,
                                 .coupling_stiffness = s->coupling,
                                 .coupling_damping = s->coupling > 0.0 ? 1.0 : 0.0,
                                 .limits = {1e3, 1e3, 1e3}};
    }
    def.tools = tool;
    def.tool_count = s->tools;
    def.max_contacts = s->max_contacts;
    def.frame_age = 1;
    const char *law_name = choose_law(&def, law);
    pal_engine *engine = NULL;
    pal_error error = {0};
    pal_status status = pal_engine_create(model, &def, &engine, &error);
    if (status == PALPATE_ERROR_UNSUPPORTED) { // a tool that the law does not know
        (void)printf("%s; %s; unsupported\n", law_name, s->name);
        return;
    }
    if (status != PALPATE_OK) {
        fail(s->name, error.message);
    }
    engine->isa = isa;
    pal_hash forces, field;
    pal_hash_init(&forces, PALPATE_HASH_BYTES);
    pal_hash_init(&field, PALPATE_HASH_BYTES);
    double peak = 0.0, far = 0.0;
    for (int k = 0; k < TICKS; k++) {
        pal_tool_state in[2] = {path(s, 0, k), path(s, 1, k)};
        pal_tool_force out[2];
        pal_frame frame;
        (void)pal_engine_tick(engine, in, out);
        for (int i = 0; i < s->tools; i++) {
            hash_force(&forces, &out[i]);
            peak = fmax(peak, fabs(out[i].force[2]));
        }
        if (pal_engine_snapshot(pal_engine_reader(engine, 0), &frame) > 0) {
            pal_hash_update(&field, frame.displacement,
                            3 * (size_t)frame.row_count * sizeof *frame.displacement);
            for (int64_t i = 0; i < 3 * (int64_t)frame.row_count; i++) {
                far = fmax(far, fabs((double)frame.displacement[i]));
            }
        }
    }
    if (!(peak > 0.0) || !(far > 0.0)) {
        fail(s->name, "it never touched");
    }
    if (forces_too) {
        print_hash(law_name, s->name, "forces", &forces, peak);
    }
    print_hash(law_name, s->name, "field", &field, far);
    pal_engine_free(engine);
}

int main(void) {
    (void)printf("golden 1\n");
    for (int k = 0; k < 2; k++) { // symmetric, raw
        synthetic_params p = synthetic_default_params();
        p.n = 12;
        p.skew = k == 1 ? 0.02 : 0.0;
        pal_model *model = synthetic_model(&p);
        if (model == NULL) {
            fail("model", "out of memory");
        }
        pal_hash hash;
        size_t n = 3 * (size_t)model->info.column_count;
        pal_hash_init(&hash, PALPATE_HASH_BYTES);
        pal_hash_update(&hash, model->c_tt, n * n * sizeof *model->c_tt);
        pal_hash_update(&hash, model->position,
                        3 * (size_t)model->info.node_count * sizeof *model->position);
        print_hash("none", k == 1 ? "raw" : "symmetric", "model", &hash, model->c_tt[0]);
        for (int law = 0; law < LAWS; law++) {
            for (size_t i = 0; i < sizeof list / sizeof *list; i++) {
                int first = 1;
                for (int isa = 0; (list[i].skew > 0.0) == (k == 1) && isa < PALPATE_ISA_COUNT;
                     isa++) {
                    if (pal_field_available((pal_isa)isa)) {
                        run(model, &list[i], law, (pal_isa)isa, first);
                        first = 0;
                    }
                }
            }
        }
        pal_model_free(model);
    }
    return 0;
}
