/// @file model_check.c  Is a model whole? Every count, index, name and number, before it is used.
///
/// Run on what the offline stage built and on what a file held, so that the engine may index
/// without looking. Reads every array once; allocates nothing.
#include <inttypes.h>
#include <math.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/model/model.h"
#include "haptic/safety/watchdog.h"

#define BAD(...) pal_fail(error, PALPATE_ERROR_ARGUMENT, "model: " __VA_ARGS__)

static pal_status check_count(const char *name, int64_t value, int64_t low, int64_t high,
                              pal_error *error) {
    if (value < low || value > high) {
        return BAD("%s is %" PRId64 ", must be %" PRId64 " to %" PRId64, name, value, low, high);
    }
    return PALPATE_OK;
}

static pal_status check_finite(const char *name, const double *x, int64_t count, pal_error *error) {
    if (count > 0 && x == NULL) {
        return BAD("%s is missing", name);
    }
    for (int64_t i = 0; i < count; i++) {
        if (!isfinite(x[i])) {
            return BAD("%s[%" PRId64 "] is %g", name, i, x[i]);
        }
    }
    return PALPATE_OK;
}

/// Indices in [0, limit); strictly ascending when `ascending`.
static pal_status check_indices(const char *name, const int32_t *index, int64_t count,
                                int32_t limit, int ascending, pal_error *error) {
    if (count > 0 && index == NULL) {
        return BAD("%s is missing", name);
    }
    for (int64_t i = 0; i < count; i++) {
        if (index[i] < 0 || index[i] >= limit) {
            return BAD("%s[%" PRId64 "] is %d, must be 0 to %d", name, i, (int)index[i],
                       (int)limit - 1);
        }
        if (ascending && i > 0 && index[i] <= index[i - 1]) {
            return BAD("%s[%" PRId64 "] is %d after %d, must ascend", name, i, (int)index[i],
                       (int)index[i - 1]);
        }
    }
    return PALPATE_OK;
}

static pal_status check_text(const char *name, const char *text, size_t size, int may_be_empty,
                             pal_error *error) {
    if (memchr(text, 0, size) == NULL) {
        return BAD("%s is not terminated", name);
    }
    if (text[0] == 0 && !may_be_empty) {
        return BAD("%s is empty", name);
    }
    return PALPATE_OK;
}

#define TRY(call)                                                                                  \
    do {                                                                                           \
        pal_status try_status = (call);                                                            \
        if (try_status != PALPATE_OK) {                                                            \
            return try_status;                                                                     \
        }                                                                                          \
    } while (0)

static pal_status check_info(const pal_model_info *info, pal_error *error) {
    TRY(check_count("node_count", info->node_count, 1, PALPATE_COUNT_MAX, error));
    TRY(check_count("surface_count", info->surface_count, 1, info->node_count, error));
    TRY(check_count("triangle_count", info->triangle_count, 0, PALPATE_COUNT_MAX, error));
    TRY(check_count("touchable_count", info->touchable_count, 0, info->surface_count, error));
    TRY(check_count("column_count", info->column_count, 0, info->surface_count, error));
    TRY(check_count("row_count", info->row_count, 0, info->node_count, error));
    TRY(check_count("fixed_count", info->fixed_count, 0, info->node_count, error));
    TRY(check_count("patch_count", info->patch_count, 0, PALPATE_COUNT_MAX, error));
    TRY(check_count("probe_count", info->probe_count, 0, PALPATE_COUNT_MAX, error));
    TRY(check_count("skin_count", info->skin_count, 0, PALPATE_COUNT_MAX, error));
    TRY(check_count("precision", (int64_t)info->precision, PALPATE_PRECISION_DOUBLE,
                    PALPATE_PRECISION_SCALED, error));
#define NAMED(member)                                                                              \
    { #member, info->member }
    const struct {
        const char *name;
        double value;
    } numbers[] = {NAMED(spacing_min),
                   NAMED(spacing_mean),
                   NAMED(spacing_max),
                   NAMED(young),
                   NAMED(poisson),
                   NAMED(density),
                   NAMED(volume),
                   NAMED(field_error),
                   NAMED(field_tolerance),
                   NAMED(field_us),
                   NAMED(bounds_min[0]),
                   NAMED(bounds_min[1]),
                   NAMED(bounds_min[2]),
                   NAMED(bounds_max[0]),
                   NAMED(bounds_max[1]),
                   NAMED(bounds_max[2]),
                   NAMED(seconds.cloud),
                   NAMED(seconds.assemble),
                   NAMED(seconds.factor),
                   NAMED(seconds.solve),
                   NAMED(seconds.certify),
                   NAMED(seconds.total),
                   NAMED(certificate.reciprocity),
                   NAMED(certificate.force_change),
                   NAMED(certificate.min_eigenvalue),
                   NAMED(certificate.max_eigenvalue),
                   NAMED(certificate.min_eigenvalue_ratio),
                   NAMED(certificate.solve_residual),
                   NAMED(certificate.rcond),
                   NAMED(certificate.force_balance),
                   NAMED(certificate.mls_worst_condition),
                   NAMED(certificate.mls_worst_point[0]),
                   NAMED(certificate.mls_worst_point[1]),
                   NAMED(certificate.mls_worst_point[2]),
                   NAMED(certificate.estimated_error),
                   NAMED(certificate.loop_energy_raw),
                   NAMED(certificate.loop_energy)};
#undef NAMED
    for (size_t i = 0; i < sizeof numbers / sizeof *numbers; i++) {
        if (!isfinite(numbers[i].value)) {
            return BAD("%s is %g", numbers[i].name, numbers[i].value);
        }
    }
    const pal_certificate *c = &info->certificate;
    TRY(check_text("method", info->method, sizeof info->method, 1, error));
    TRY(check_text("method_options", info->method_options, sizeof info->method_options, 1, error));
    TRY(check_text("provenance", info->provenance, sizeof info->provenance, 1, error));
    TRY(check_text("certificate.reason", c->reason, sizeof c->reason, 1, error));
    TRY(check_text("hash", info->hash, sizeof info->hash, 1, error));
    size_t digits = strspn(info->hash, "0123456789abcdef");
    if (info->hash[0] != 0 && (digits != 64 || info->hash[64] != 0)) {
        return BAD("hash \"%.64s\" is not 64 hexadecimal digits", info->hash);
    }
    return PALPATE_OK;
}

static pal_status check_runtime(const pal_runtime_config *runtime, pal_error *error) {
    TRY(check_count("tool_count", runtime->tool_count, 0, PALPATE_TOOLS_MAX, error));
    TRY(check_count("max_contacts", runtime->max_contacts, 0, PALPATE_COUNT_MAX, error));
    TRY(check_count("field_by", (int64_t)runtime->field_by, PALPATE_FIELD_BY_SERVO,
                    PALPATE_FIELD_BY_READER, error));
    pal_error why = {0};
    if (pal_watchdog_check(&runtime->watchdog, &why) != PALPATE_OK) {
        return BAD("%s", why.message);
    }
    TRY(check_count("contact_law", (int64_t)runtime->contact_law, PALPATE_CONTACT_SURFACE,
                    PALPATE_CONTACT_NODES, error));
    TRY(check_count("contact_points", runtime->contact_points, 0, 64, error));
    double rates[] = {runtime->servo_rate, runtime->render_rate};
    TRY(check_finite("rates", rates, 2, error));
    for (int32_t i = 0; i < runtime->tool_count; i++) {
        const pal_tool_def *tool = &runtime->tools[i];
        const pal_stroke *stroke = &tool->device.stroke;
        TRY(check_text("tool name", tool->name, sizeof tool->name, 0, error));
        TRY(check_text("device spec name", tool->spec.name, sizeof tool->spec.name, 1, error));
        TRY(check_text("tool path", tool->device.path, sizeof tool->device.path, 1, error));
        TRY(check_count("tool shape", (int64_t)tool->shape, PALPATE_SHAPE_POINT,
                        PALPATE_SHAPE_CAPSULE, error));
        TRY(check_count("tool device", (int64_t)tool->device.kind, PALPATE_DEVICE_NONE,
                        PALPATE_DEVICE_SIMULATED, error));
        TRY(check_count("tool stroke", (int64_t)stroke->kind, PALPATE_STROKE_PRESS,
                        PALPATE_STROKE_PALPATION, error));
        const pal_simulated *simulated = &tool->device.simulated;
        TRY(check_count("tool model", (int64_t)simulated->model, PALPATE_SIMULATED_TOUCH,
                        PALPATE_SIMULATED_PREMIUM, error));
        TRY(check_count("tool grip", (int64_t)simulated->grip, PALPATE_GRIP_FIRM, PALPATE_GRIP_NONE,
                        error));
        double figures[] = {
            simulated->mass,           simulated->damping,   simulated->friction,
            simulated->resolution,     simulated->force,     simulated->stiffness,
            simulated->reach,          simulated->hand_mass, simulated->hand_damping,
            simulated->hand_stiffness, simulated->push,      simulated->kick,
            simulated->release,        simulated->grasp};
        TRY(check_finite("simulated device", figures, 14, error));
        double numbers[] = {tool->radius,
                            tool->length,
                            tool->friction,
                            tool->coupling_stiffness,
                            tool->coupling_damping,
                            tool->limits.force,
                            tool->limits.slew,
                            tool->limits.torque,
                            tool->start[0],
                            tool->start[1],
                            tool->start[2],
                            tool->axis[0],
                            tool->axis[1],
                            tool->axis[2],
                            stroke->depth,
                            stroke->ramp,
                            stroke->period,
                            stroke->amplitude,
                            stroke->direction[0],
                            stroke->direction[1],
                            stroke->direction[2],
                            stroke->tremor_amplitude,
                            stroke->tremor_frequency};
        for (int k = 5; k < 8; k++) { // no limit, on purpose
            numbers[k] = numbers[k] == (double)INFINITY ? 0.0 : numbers[k];
        }
        TRY(check_finite("tool", numbers, (int64_t)(sizeof numbers / sizeof *numbers), error));
        double spec[] = {tool->spec.max_force,   tool->spec.max_torque, tool->spec.max_stiffness,
                         tool->spec.max_damping, tool->spec.max_speed,  tool->spec.damping,
                         tool->spec.resolution};
        TRY(check_finite("device spec", spec, (int64_t)(sizeof spec / sizeof *spec), error));
        for (int k = 0; k < 8; k++) { // sizes, coupling and limits
            if (numbers[k] < 0) {
                return BAD("tool %d (%s): value %d is negative, %g", (int)i, tool->name, k,
                           numbers[k]);
            }
        }
    }
    return PALPATE_OK;
}

static pal_status check_nodes(const pal_model *model, pal_error *error) {
    const pal_model_info *info = &model->info;
    int64_t nodes = info->node_count, surface = info->surface_count;
    TRY(check_finite("position", model->position, 3 * nodes, error));
    TRY(check_finite("normal", model->normal, 3 * surface, error));
    TRY(check_finite("area_vector", model->area_vector, 3 * surface, error));
    for (int64_t i = 0; i < surface; i++) {
        const double *n = model->normal + 3 * i;
        double length = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        if (fabs(length - 1) > 1e-6) { // a rounded unit vector is within 1e-15; single within 1e-7
            return BAD("normal %" PRId64 " has length %g, must be 1", i, length);
        }
    }
    TRY(check_indices("triangle", model->triangle, 3 * (int64_t)info->triangle_count,
                      info->surface_count, 0, error));
    if (model->node_flags == NULL) {
        return BAD("node_flags is missing");
    }
    int64_t fixed = 0, touchable = 0;
    for (int64_t i = 0; i < nodes; i++) {
        int flags = model->node_flags[i];
        if ((flags & ~(PALPATE_NODE_FIXED | PALPATE_NODE_TOUCHABLE)) != 0 ||
            flags == (PALPATE_NODE_FIXED | PALPATE_NODE_TOUCHABLE) ||
            (i >= surface && (flags & PALPATE_NODE_TOUCHABLE) != 0)) {
            return BAD("node %" PRId64 " has flags %d", i, flags);
        }
        fixed += (flags & PALPATE_NODE_FIXED) != 0;
        touchable += (flags & PALPATE_NODE_TOUCHABLE) != 0;
    }
    if (fixed != info->fixed_count || touchable != info->touchable_count) {
        return BAD("%" PRId64 " fixed and %" PRId64
                   " touchable nodes are flagged, counts say %d and %d",
                   fixed, touchable, (int)info->fixed_count, (int)info->touchable_count);
    }
    return PALPATE_OK;
}

static pal_status check_columns_and_rows(const pal_model *model, pal_error *error) {
    const pal_model_info *info = &model->info;
    TRY(check_indices("column_node", model->column_node, info->column_count, info->surface_count, 1,
                      error));
    TRY(check_indices("row_node", model->row_node, info->row_count, info->node_count, 1, error));
    int64_t touchable = 0;
    for (int32_t i = 0; i < info->column_count; i++) {
        int flags = model->node_flags[model->column_node[i]];
        if ((flags & PALPATE_NODE_FIXED) != 0) {
            return BAD("column %d belongs to fixed node %d", (int)i, (int)model->column_node[i]);
        }
        touchable += (flags & PALPATE_NODE_TOUCHABLE) != 0;
    }
    if (touchable != info->touchable_count) {
        return BAD("%" PRId64 " of %d touchable nodes have columns", touchable,
                   (int)info->touchable_count);
    }

    int64_t n = 3 * (int64_t)info->column_count;
    TRY(check_finite("c_tt", model->c_tt, n * n, error));
    if (info->certificate.symmetrized) {
        for (int64_t j = 0; j < n; j++) {
            for (int64_t i = 0; i < j; i++) {
                if (model->c_tt[i + j * n] != model->c_tt[j + i * n]) {
                    return BAD("c_tt is marked symmetric, but (%" PRId64 ", %" PRId64 ") is not", i,
                               j);
                }
            }
        }
    }
    TRY(check_finite("probe_row", model->probe_row, 3 * info->probe_count * n, error));

    if (model->bases != NULL) {
        if (info->precision != PALPATE_PRECISION_SCALED) {
            return BAD("compressed rows must be in scaled precision");
        }
        TRY(pal_row_bases_check(model->bases, info->row_count, info->column_count, error));
    }
    int64_t rows = pal_model_block_rows(model);
    if (rows == 0 || n == 0) {
        return PALPATE_OK;
    }
    size_t element = pal_precision_size(info->precision);
    if (model->c_st == NULL || (uintptr_t)model->c_st % 64 != 0 || model->row_ld < rows ||
        ((size_t)model->row_ld * element) % 64 != 0 || model->row_ld - rows >= 64) {
        return BAD("c_st is missing or not aligned to 64 bytes (row_ld %" PRId64 ")",
                   model->row_ld);
    }
    int exponent;
    if (!(model->row_scale > 0) || !isfinite(model->row_scale) ||
        frexp(model->row_scale, &exponent) != 0.5) {
        return BAD("row_scale is %g, must be a power of two", model->row_scale);
    }
    if ((model->column_scale != NULL) != (info->precision == PALPATE_PRECISION_SCALED)) {
        return BAD("column_scale must be there in scaled precision and in no other");
    }
    for (int64_t j = 0; model->column_scale != NULL && j < n; j++) {
        if (!(model->column_scale[j] > 0) || !isfinite(model->column_scale[j])) {
            return BAD("column_scale[%" PRId64 "] is %g, must be positive", j,
                       model->column_scale[j]);
        }
    }
    const char *column = model->c_st;
    for (int64_t j = 0; j < n; j++, column += (size_t)model->row_ld * element) {
        for (int64_t at = 0; at < model->row_ld; at += 256) {
            double value[256];
            int64_t count = model->row_ld - at < 256 ? model->row_ld - at : 256;
            pal_precision_load(info->precision, column + (size_t)at * element, count, value);
            for (int64_t i = 0; i < count; i++) {
                if (!isfinite(value[i]) || (at + i >= rows && value[i] != 0)) {
                    return BAD("c_st (%" PRId64 ", %" PRId64 ") is %g", at + i, j, value[i]);
                }
            }
        }
    }
    return PALPATE_OK;
}

static pal_status check_names(const pal_model *model, pal_error *error) {
    const pal_model_info *info = &model->info;
    if ((info->patch_count > 0 && model->patch == NULL) ||
        (info->probe_count > 0 && model->probe == NULL)) {
        return BAD("patches or probes are missing");
    }
    for (int32_t i = 0; i < info->patch_count; i++) {
        const pal_patch *patch = &model->patch[i];
        TRY(check_text("patch name", patch->name, sizeof patch->name, 0, error));
        TRY(check_count("patch nodes", patch->count, 1, info->column_count, error));
        TRY(check_indices("patch column", patch->column, patch->count, info->column_count, 1,
                          error));
    }
    for (int32_t i = 0; i < info->probe_count; i++) {
        TRY(check_text("probe name", model->probe[i].name, sizeof model->probe[i].name, 0, error));
        TRY(check_finite("probe position", model->probe[i].position, 3, error));
    }
    return PALPATE_OK;
}

static pal_status check_skin(const pal_model *model, pal_error *error) {
    int64_t count = model->info.skin_count;
    TRY(check_count("skin_triangle_count", model->skin_triangle_count, 0, PALPATE_COUNT_MAX,
                    error));
    TRY(check_finite("skin_position", model->skin_position, 3 * count, error));
    TRY(check_indices("skin_triangle", model->skin_triangle,
                      3 * (int64_t)model->skin_triangle_count, model->info.skin_count, 0, error));
    TRY(check_indices("skin_twin", model->skin_twin, count, model->info.skin_count, 0, error));
    for (int64_t i = 0; i < count; i++) {
        if (model->skin_twin[model->skin_twin[i]] != model->skin_twin[i]) {
            return BAD("skin_twin[%" PRId64 "] is %d, which has another twin", i,
                       (int)model->skin_twin[i]);
        }
    }
    if (count > 0 && (model->skin_row == NULL || model->skin_weight == NULL)) {
        return BAD("the skin's weights are missing");
    }
    for (int64_t i = 0; i < count * PALPATE_SKIN_WEIGHTS; i++) {
        if (model->skin_row[i] < -1 || model->skin_row[i] >= model->info.row_count ||
            !isfinite(model->skin_weight[i])) {
            return BAD("skin weight %" PRId64 " is %g on row %d", i, (double)model->skin_weight[i],
                       (int)model->skin_row[i]);
        }
    }
    return PALPATE_OK;
}

pal_status pal_model_check(const pal_model *model, pal_error *error) {
    if (model == NULL) {
        return BAD("there is none");
    }
    TRY(check_info(&model->info, error));
    TRY(check_runtime(&model->runtime, error));
    TRY(check_nodes(model, error));
    TRY(check_columns_and_rows(model, error));
    TRY(check_names(model, error));
    return check_skin(model, error);
}
