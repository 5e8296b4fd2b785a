/// @file engine.h  The engine's memory (private: engine, its tests and benches).
///
/// One block: this struct, then the contact law's block, the readers and their buffers, the forces
/// of the last tick in both precisions. Everything is placed at creation; nothing moves afterwards.
#ifndef PALPATE_HAPTIC_ENGINE_H
#define PALPATE_HAPTIC_ENGINE_H

#include "haptic/contact/contact.h"
#include "haptic/engine/field.h"
#include "haptic/model/model.h"
#include "haptic/safety/output.h"
#include "haptic/base/pose.h"
#include "haptic/engine/snapshot.h"
#include "haptic/base/stages.h"
#include "haptic/safety/watchdog.h"
#include <palpate/engine.h>

struct pal_engine {
    const pal_model *model;
    pal_engine_def def; ///< tools points into this block
    pal_tool_def tools[PALPATE_TOOLS_MAX];
    pal_frames frames;
    pal_isa isa; ///< field kernel in use; tests and benches may change it
    const pal_contact_law *law;
    void *contact;
    pal_contact_result result;                 ///< of the last tick
    pal_contact_tool input[PALPATE_TOOLS_MAX]; ///< last good poses, body frame
    pal_watchdog watchdog[PALPATE_TOOLS_MAX];
    pal_output output[PALPATE_TOOLS_MAX];
    pal_tool_force force[PALPATE_TOOLS_MAX]; ///< given out, force and torque in the body frame
    float *force32;     ///< result.force x pal_model_unit, rounded; shape [3 column_count]
    void *scratch;      ///< of pal_field_compute, the servo's
    pal_stages *stages; ///< NULL; a bench's stage clock
    int64_t rows;       ///< floats of a field: 3 row_count rounded up to what the kernel writes
    pal_reader *reader; ///< shape [def.reader_count]
    pal_engine_counts counts;
    uint32_t raised[PALPATE_TOOLS_MAX]; ///< fault bits of the last tick
    size_t bytes;
};

/// The law pal_engine_create picks for a definition.
const pal_contact_law *pal_contact_law_for(const pal_engine_def *def);

#endif
