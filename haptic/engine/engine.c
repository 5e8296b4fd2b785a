/// @file engine.c  The tick: poses in, contact, forces out; then the field for readers that want
/// it.
///
/// pal_engine_force transforms device poses into the body frame, runs the contact law (Eq. 52) and
/// the output stage; pal_engine_field sweeps the stored columns (Eq. 53) straight into the back
/// buffer of the first reader that wants a frame and copies it to the others. The force comes first
/// and does not depend on whether or when the field is computed. With PALPATE_FIELD_BY_READER the
/// servo publishes dofs and nodal forces only; whoever takes the frame sweeps the same columns in
/// the same order, hence to the same bits, into a buffer of its own.
///
/// Memory: one block, see haptic/engine/engine.h. Threads: one servo thread per engine, one thread
/// per reader; several engines may share a model, which is only read.
#include "haptic/engine/engine.h"

#include <assert.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/block.h"
#include "haptic/base/error.h"
#include "haptic/engine/field_model.h"

enum {
    LINE = PALPATE_CACHE_LINE,
    CONTACTS_MAX = 1024,
    POINTS = 16,
    POINTS_MAX = 64,
    READERS_MAX = 64
};
static const uint32_t ENGINE_COOKIE = 0x50414c45u;

// ---- Definition ---------------------------------------------------------------------------------

pal_engine_def pal_engine_default_def(void) {
    return (pal_engine_def){.cookie = ENGINE_COOKIE,
                            .max_contacts = 32,
                            .reader_count = 2,
                            .body_pose = pal_pose_identity(),
                            .device_to_world = pal_pose_identity(),
                            .device_scale = 1.0,
                            .period = 1e-3,
                            .frame_age = 4};
}

const pal_contact_law *pal_contact_law_for(const pal_engine_def *def) {
    return def->contact_law == PALPATE_CONTACT_NODES ? &pal_contact_nodes : &pal_contact_anywhere;
}

/// Is the spec one, and the coupling within it?
static pal_status check_spec(const pal_tool_def *tool, int32_t t, pal_error *error) {
    const pal_device_spec *s = &tool->spec;
    const double known[] = {s->max_force, s->max_torque, s->max_stiffness, s->max_damping,
                            s->max_speed, s->damping,    s->resolution};
    for (size_t i = 0; i < sizeof known / sizeof *known; i++) {
        if (!(known[i] >= 0.0) || !isfinite(known[i])) {
            return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                            "tools[%d].spec: %g: must be finite and not negative (0: unknown)",
                            (int)t, known[i]);
        }
    }
    if (s->max_stiffness > 0.0 && tool->coupling_stiffness > s->max_stiffness) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tools[%d].coupling_stiffness: %g N/m: its device bears %g N/m; lower it",
                        (int)t, tool->coupling_stiffness, s->max_stiffness);
    }
    if (s->max_damping > 0.0 && tool->coupling_damping > s->max_damping) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tools[%d].coupling_damping: %g N s/m: its device bears %g N s/m; lower it",
                        (int)t, tool->coupling_damping, s->max_damping);
    }
    return PALPATE_OK;
}

static pal_status check_tool(const pal_tool_def *tool, int32_t t, pal_error *error) {
    if (tool->shape != PALPATE_SHAPE_POINT && tool->shape != PALPATE_SHAPE_SPHERE &&
        tool->shape != PALPATE_SHAPE_CAPSULE) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "tools[%d].shape: %d: unknown shape", (int)t,
                        (int)tool->shape);
    }
    if (tool->shape != PALPATE_SHAPE_POINT && !(tool->radius > 0.0 && isfinite(tool->radius))) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tools[%d].radius: %g: must be positive for this shape", (int)t,
                        tool->radius);
    }
    if (tool->shape == PALPATE_SHAPE_CAPSULE && !(tool->length >= 0.0 && isfinite(tool->length))) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "tools[%d].length: %g: must not be negative",
                        (int)t, tool->length);
    }
    const pal_tool_limits *l = &tool->limits;
    if (!(l->force >= 0.0) || !(l->slew >= 0.0) || !(l->torque >= 0.0)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "tools[%d].limits: force %g, slew %g, torque %g: must not be negative "
                        "(0: the device's or the default; INFINITY: none)",
                        (int)t, l->force, l->slew, l->torque);
    }
    return check_spec(tool, t, error);
}

static pal_contact_def contact_def(const pal_engine_def *def) {
    return (pal_contact_def){.tool_count = def->tool_count,
                             .tools = def->tools,
                             .max_contacts = def->max_contacts,
                             .points = def->contact_points > 0 ? def->contact_points : POINTS,
                             .period = def->period};
}

static pal_status check(const pal_model *model, const pal_engine_def *def, pal_error *error) {
    if (model == NULL || def == NULL || def->cookie != ENGINE_COOKIE) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine: %s; start from pal_engine_default_def()",
                        model == NULL ? "no model" : "the definition was not initialised");
    }
    if (def->tool_count < 1 || def->tool_count > PALPATE_TOOLS_MAX || def->tools == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def.tool_count: %d: must be 1 to %d, with tools",
                        (int)def->tool_count, PALPATE_TOOLS_MAX);
    }
    if (def->max_contacts < 1 || def->max_contacts > CONTACTS_MAX) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def.max_contacts: %d: must be 1 to %d", (int)def->max_contacts,
                        CONTACTS_MAX);
    }
    if (def->contact_law != PALPATE_CONTACT_SURFACE && def->contact_law != PALPATE_CONTACT_NODES) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def.contact_law: %d: unknown law", (int)def->contact_law);
    }
    if (def->contact_points < 0 || def->contact_points > POINTS_MAX) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def.contact_points: %d: must be 0 (default) to %d",
                        (int)def->contact_points, POINTS_MAX);
    }
    if (def->reader_count < 0 || def->reader_count > READERS_MAX || def->frame_age < 1) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def: reader_count %d must be 0 to %d, frame_age %d at least 1",
                        (int)def->reader_count, READERS_MAX, (int)def->frame_age);
    }
    if (def->field_by != PALPATE_FIELD_BY_SERVO && def->field_by != PALPATE_FIELD_BY_READER) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def.field_by: %d: must be 0 or 1", (int)def->field_by);
    }
    if (!pal_pose_valid(&def->body_pose) || !pal_pose_valid(&def->device_to_world)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def: body_pose or device_to_world is not a finite pose with a "
                        "unit quaternion");
    }
    if (!(def->device_scale > 0.0) || !isfinite(def->device_scale) || !(def->period > 0.0) ||
        !isfinite(def->period)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_def: device_scale %g and period %g s must be positive",
                        def->device_scale, def->period);
    }
    for (int32_t t = 0; t < def->tool_count; t++) {
        pal_status status = check_tool(&def->tools[t], t, error);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    pal_status watchdog = pal_watchdog_check(&def->watchdog, error);
    if (watchdog != PALPATE_OK) {
        return watchdog;
    }
    pal_contact_def contact = contact_def(def);
    return pal_contact_law_for(def)->check(model, &contact, error);
}

// ---- Memory -------------------------------------------------------------------------------------

static size_t force32_bytes(const pal_model *model) {
    return pal_block_padded(3 * (size_t)model->info.column_count * sizeof(float));
}

/// Nodal forces of one slot where the readers compute the field: dof, f, f32.
static size_t slot_bytes(const pal_model *model) {
    size_t dofs = 3 * (size_t)model->info.column_count;
    return pal_block_padded(dofs * sizeof(int32_t)) + pal_block_padded(dofs * sizeof(double)) +
           force32_bytes(model);
}

/// Buffers of one reader.
static size_t reader_bytes(const pal_model *model, const pal_engine_def *def) {
    return def->field_by == PALPATE_FIELD_BY_READER
               ? 3 * slot_bytes(model) +
                     pal_block_padded((size_t)pal_field_floats(model) * sizeof(float)) +
                     pal_field_scratch_bytes(model)
               : pal_snapshot_bytes(pal_field_floats(model));
}

static size_t block_bytes(const pal_model *model, const pal_engine_def *def) {
    pal_contact_def contact = contact_def(def);
    return pal_block_padded(sizeof(pal_engine)) + pal_contact_law_for(def)->bytes(model, &contact) +
           force32_bytes(model) + pal_field_scratch_bytes(model) +
           (size_t)def->reader_count *
               (pal_block_padded(sizeof(pal_reader)) + reader_bytes(model, def));
}

size_t pal_engine_bytes(const pal_model *model, const pal_engine_def *def) {
    return check(model, def, NULL) == PALPATE_OK ? block_bytes(model, def) : 0;
}

/// Place a reader's buffers at *at; also faults their pages in.
static void init_reader(const pal_engine *engine, pal_reader *reader, unsigned char **at) {
    const pal_model *model = engine->model;
    size_t bytes = reader_bytes(model, &engine->def);
    if (engine->def.field_by != PALPATE_FIELD_BY_READER) {
        pal_snapshot_init(reader, pal_block_take(at, bytes), engine->rows);
        return;
    }
    size_t dofs = 3 * (size_t)model->info.column_count;
    memset(*at, 0, bytes);
    pal_snapshot_init(reader, *at, 0);
    for (int i = 0; i < 3; i++) {
        reader->slot[i].displacement = NULL;
        reader->slot[i].dof = pal_block_take(at, dofs * sizeof(int32_t));
        reader->slot[i].f = pal_block_take(at, dofs * sizeof(double));
        reader->slot[i].f32 = pal_block_take(at, dofs * sizeof(float));
    }
    reader->engine = engine;
    reader->field = pal_block_take(at, (size_t)engine->rows * sizeof(float));
    reader->scratch = pal_block_take(at, pal_field_scratch_bytes(model));
}

pal_status pal_engine_create(const pal_model *model, const pal_engine_def *def, pal_engine **out,
                             pal_error *error) {
    if (out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "pal_engine_create: no place for the engine");
    }
    *out = NULL;
    pal_status status = check(model, def, error);
    if (status != PALPATE_OK) {
        return status;
    }
    size_t bytes = block_bytes(model, def);
    unsigned char *block = aligned_alloc(LINE, bytes);
    if (block == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "pal_engine_create: %zu bytes for the engine; lower max_contacts (%d) or "
                        "reader_count (%d)",
                        bytes, (int)def->max_contacts, (int)def->reader_count);
    }
    unsigned char *at = block;
    pal_engine *engine = pal_block_take(&at, sizeof *engine);
    memset(engine, 0, sizeof *engine);
    engine->model = model;
    engine->bytes = bytes;
    engine->def = *def;
    memcpy(engine->tools, def->tools, (size_t)def->tool_count * sizeof *def->tools);
    engine->def.tools = engine->tools;
    engine->frames = pal_frames_make(&def->body_pose, &def->device_to_world, def->device_scale);
    engine->isa = pal_field_best();
    engine->law = pal_contact_law_for(&engine->def);
    pal_contact_def contact = contact_def(&engine->def);
    engine->contact = engine->law->init(pal_block_take(&at, engine->law->bytes(model, &contact)),
                                        model, &contact);
    engine->force32 = pal_block_take(&at, force32_bytes(model));
    memset(engine->force32, 0, force32_bytes(model));
    engine->scratch = pal_block_take(&at, pal_field_scratch_bytes(model));
    memset(engine->scratch, 0, pal_field_scratch_bytes(model)); // faults the pages in
    engine->rows = pal_field_floats(model);
    engine->reader = (pal_reader *)(void *)at;
    at += (size_t)def->reader_count * pal_block_padded(sizeof(pal_reader));
    for (int32_t r = 0; r < def->reader_count; r++) {
        init_reader(engine, &engine->reader[r], &at);
    }
    assert(at == block + bytes);
    for (int32_t t = 0; t < def->tool_count; t++) {
        pal_tool_def *tool = &engine->tools[t];
        pal_watchdog_def watchdog = pal_watchdog_resolve(&def->watchdog, &tool->spec);
        tool->limits = pal_limits_resolve(&tool->limits, &tool->spec);
        pal_output_init(&engine->output[t], &tool->limits, def->period);
        pal_watchdog_init(&engine->watchdog[t], &watchdog, def->period);
    }
    engine->def.watchdog = pal_watchdog_resolve(&def->watchdog, &(pal_device_spec){.max_force = 0});
    *out = engine;
    return PALPATE_OK;
}

void pal_engine_free(pal_engine *engine) {
    free(engine); // one block
}

const pal_engine_def *pal_engine_get_def(const pal_engine *engine) {
    return &engine->def;
}

void pal_engine_reset(pal_engine *engine) {
    engine->law->reset(engine->contact);
    engine->result = (pal_contact_result){0};
    engine->counts = (pal_engine_counts){0};
    for (int32_t t = 0; t < engine->def.tool_count; t++) {
        engine->input[t] = (pal_contact_tool){0};
        engine->force[t] = (pal_tool_force){0};
        pal_output_reset(&engine->output[t]);
        pal_watchdog_init(&engine->watchdog[t], &engine->watchdog[t].def, engine->def.period);
        engine->raised[t] = 0;
    }
}

void pal_engine_get_counts(const pal_engine *engine, pal_engine_counts *out) {
    *out = engine->counts;
}

// ---- Tick ---------------------------------------------------------------------------------------

static void count_faults(pal_engine *engine, int32_t tool, uint32_t fault, const double value[32]) {
    pal_engine_counts *c = &engine->counts;
    uint32_t fresh = fault & ~engine->raised[tool];
    engine->raised[tool] = fault;
    for (int bit = 0; fault != 0; bit++, fault >>= 1) {
        if (fault & 1u) {
            c->fault[bit]++;
            c->fault_tick[bit] = c->ticks - 1;
            c->fault_value[bit] = value[bit];
        }
        if (fresh >> bit & 1u) {
            c->event[c->events++ % PALPATE_EVENTS_KEPT] = (pal_fault_event){
                .tick = c->ticks - 1, .value = value[bit], .tool = tool, .bit = bit};
        }
    }
}

/// The value that made a pose unusable, for the counters.
static double offending(const pal_tool_state *in) {
    for (int i = 0; i < 3; i++) {
        if (!isfinite(in->position[i])) {
            return in->position[i];
        }
    }
    double norm = 0.0;
    for (int i = 0; i < 4; i++) {
        norm += in->orientation[i] * in->orientation[i];
    }
    return sqrt(norm);
}

/// Device pose -> body frame; a pose that is not finite leaves the last good one in place.
static uint32_t read_input(pal_engine *engine, int32_t t, const pal_tool_state *in,
                           double value[32]) {
    pal_contact_tool *tool = &engine->input[t];
    pal_pose pose;
    memcpy(pose.position, in->position, sizeof pose.position);
    memcpy(pose.orientation, in->orientation, sizeof pose.orientation);
    if (!pal_pose_valid(&pose)) {
        value[0] = offending(in);
        return PALPATE_FAULT_INPUT | pal_watchdog_step(&engine->watchdog[t], in, NULL, value);
    }
    pal_frames_to_body(&engine->frames, in->position, in->orientation, &tool->pose);
    tool->closed = (in->buttons & 1u) != 0;
    tool->present = 1;
    return pal_watchdog_step(&engine->watchdog[t], in, tool->pose.position, value);
}

/// What the body does to the tool, in the device's frame, through the output stage.
static uint32_t write_output(pal_engine *engine, int32_t t, uint32_t fault, double value[32],
                             pal_tool_force *out) {
    const pal_contact_wrench *w = &engine->result.tool[t];
    double force[3], torque[3];
    for (int i = 0; i < 3; i++) {
        force[i] = -w->force[i];
        torque[i] = -w->torque[i];
    }
    *out =
        (pal_tool_force){.contact_count = w->count, .fault = fault | w->fault, .depth = w->depth};
    memcpy(out->centroid, w->centroid, sizeof out->centroid);
    memcpy(out->normal, w->normal, sizeof out->normal);
    pal_frames_vector_to_device(&engine->frames, force, out->force);
    pal_frames_vector_to_device(&engine->frames, torque, out->torque);
    double scale = engine->watchdog[t].scale;
    for (int i = 0; scale < 1.0 && i < 3; i++) {
        out->force[i] *= scale;
        out->torque[i] *= scale;
    }
    if (pal_output_apply(&engine->output[t], out, value) & PALPATE_FAULT_FORCE) {
        pal_watchdog_trip(&engine->watchdog[t]);
    }
    engine->force[t] = *out;
    pal_frames_vector_to_body(&engine->frames, out->force, engine->force[t].force);
    pal_frames_vector_to_body(&engine->frames, out->torque, engine->force[t].torque);
    return out->fault;
}

uint32_t pal_engine_force(pal_engine *engine, const pal_tool_state in[], pal_tool_force out[]) {
    uint32_t all = 0, fault[PALPATE_TOOLS_MAX] = {0};
    double value[PALPATE_TOOLS_MAX][32] = {{0.0}};
    engine->counts.ticks++;
    for (int32_t t = 0; t < engine->def.tool_count; t++) {
        fault[t] = read_input(engine, t, &in[t], value[t]);
    }
    pal_stages *stages = engine->stages;
    pal_stages_end(stages, PALPATE_STAGE_INPUT);
    engine->result.stages = stages;
    engine->law->solve(engine->contact, engine->input, &engine->result);
    pal_stages_end(stages, PALPATE_STAGE_SOLVE);

    pal_contact_result *result = &engine->result;
    int touched = 0, finite = 1;
    for (int32_t k = 0; k < result->dof_count; k++) {
        engine->force32[k] =
            (float)(result->force[k] * pal_model_unit(engine->model, result->dof[k]));
        finite &= isfinite(engine->force32[k]) != 0;
    }
    for (int32_t t = 0; t < engine->def.tool_count; t++) {
        int32_t nodes = result->dof_count / 3;
        value[t][2] = nodes;
        value[t][3] = result->dropped;
        value[t][6] = result->iterations;
        uint32_t bits = write_output(engine, t, fault[t], value[t], &out[t]);
        count_faults(engine, t, bits, value[t]);
        all |= bits;
        touched |= out[t].contact_count > 0;
    }
    if (!finite || (all & PALPATE_FAULT_FORCE)) { // never into the field or the next tick
        engine->law->reset(engine->contact);
        result->dof_count = 0;
    }
    engine->counts.contact_ticks += (uint64_t)touched;
    engine->counts.contacts_dropped += (uint64_t)result->dropped;
    engine->counts.solver_iterations += (uint64_t)result->iterations;
    if (result->iterations > engine->counts.worst_iterations) {
        engine->counts.worst_iterations = result->iterations;
    }
    pal_stages_end(stages, PALPATE_STAGE_OUTPUT);
    return all;
}

static int wants_frame(const pal_engine *engine, const pal_reader *reader, uint64_t tick) {
    return reader->engine != NULL || reader->published == 0 || !pal_snapshot_unread(reader) ||
           tick - reader->published_tick >= (uint64_t)engine->def.frame_age;
}

/// Eq. 53 on either side: the same columns in the same order, so the same bits. Reads what is fixed
/// at creation only.
static void sum_rows(const pal_engine *engine, int32_t count, const int32_t *dof, const double *f,
                     const float *f32, void *scratch, float *out) {
    pal_field_compute(engine->isa, engine->model, count, dof, f, f32, scratch, out);
}

/// The forces that a reader needs to compute the field by itself.
static void hand_over(const pal_engine *engine, pal_slot *slot) {
    size_t count = (size_t)engine->result.dof_count;
    slot->count = engine->result.dof_count;
    if (count > 0) {
        memcpy(slot->dof, engine->result.dof, count * sizeof *slot->dof);
        memcpy(slot->f, engine->result.force, count * sizeof *slot->f);
        memcpy(slot->f32, engine->force32, count * sizeof *slot->f32);
    }
}

void pal_engine_field(pal_engine *engine) {
    uint64_t tick = engine->counts.ticks - (engine->counts.ticks > 0);
    const float *field = NULL; // computed once, in the first reader's buffer
    for (int32_t r = 0; r < engine->def.reader_count; r++) {
        pal_reader *reader = &engine->reader[r];
        if (!wants_frame(engine, reader, tick)) {
            continue;
        }
        pal_slot *slot = pal_snapshot_back(reader);
        if (reader->engine != NULL) {
            hand_over(engine, slot);
        } else if (engine->rows > 0 && field == NULL) {
            sum_rows(engine, engine->result.dof_count, engine->result.dof, engine->result.force,
                     engine->force32, engine->scratch, slot->displacement);
            field = slot->displacement;
            pal_stages_end(engine->stages, PALPATE_STAGE_FIELD);
        } else if (field != NULL) {
            memcpy(slot->displacement, field, (size_t)engine->rows * sizeof *field);
        }
        pal_frame *frame = &slot->frame;
        frame->tick = tick;
        frame->time_ns = llrint((double)tick * engine->def.period * 1e9);
        frame->row_count = engine->model->info.row_count;
        frame->tool_count = engine->def.tool_count;
        frame->displacement = engine->rows > 0 ? slot->displacement : NULL;
        for (int32_t t = 0; t < engine->def.tool_count; t++) {
            frame->tool_pose[t] = engine->result.tool[t].proxy;
            frame->tool_force[t] = engine->force[t];
        }
        (void)pal_snapshot_publish(reader);
        engine->counts.frames_published++;
    }
    pal_stages_end(engine->stages, PALPATE_STAGE_PUBLISH);
    if (field != NULL && engine->law->warm != NULL) {
        engine->law->warm(engine->contact);
    }
    pal_stages_end(engine->stages, PALPATE_STAGE_WARM);
}

uint32_t pal_engine_tick(pal_engine *engine, const pal_tool_state in[], pal_tool_force out[]) {
    uint32_t fault = pal_engine_force(engine, in, out);
    pal_engine_field(engine);
    return fault;
}

// ---- Readers ------------------------------------------------------------------------------------

pal_reader *pal_engine_reader(pal_engine *engine, int32_t index) {
    if (engine == NULL || index < 0 || index >= engine->def.reader_count) {
        return NULL;
    }
    return &engine->reader[index];
}

int pal_engine_snapshot(pal_reader *reader, pal_frame *frame) {
    if (reader == NULL || frame == NULL) {
        return -1;
    }
    int fresh = pal_snapshot_take(reader, frame);
    const pal_engine *engine = reader->engine;
    if (fresh >= 0 && engine != NULL && engine->rows > 0) {
        const pal_slot *slot = &reader->slot[reader->front];
        if (fresh == 1) {
            sum_rows(engine, slot->count, slot->dof, slot->f, slot->f32, reader->scratch,
                     reader->field);
        }
        frame->displacement = reader->field;
    }
    return fresh;
}
