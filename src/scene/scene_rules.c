/// What the schema table cannot say alone: rules between the keys of one mapping.
///
/// Each rule runs once all keys of its mapping were read; defaults that depend on other keys are
/// filled in here.
#include <math.h>
#include <stdio.h>
#include <string.h>

#include <palpate/session.h>

#include "haptic/base/error.h"
#include "src/scene/scene_schema.h"
#include "src/scene/scene_size.h"

pal_status pal_rule_geometry(pal_reading *r, const pal_value *value, void *object) {
    const struct pal_scene *scene = object;
    const pal_value *scale = pal_value_get(value, "scale");
    if (!pal_value_is_null(scale) && scene->geometry.kind != PALPATE_GEOMETRY_FILE) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_key(value, "scale"), "scale",
                                "a scale for a shape given in metres", "with file only",
                                "remove it");
    }
    return PALPATE_OK;
}

pal_status pal_rule_selector_box(pal_reading *r, const pal_value *value, void *object) {
    pal_selector *s = object;
    int corners = (pal_value_get(value, "min") != NULL) + (pal_value_get(value, "max") != NULL);
    int sizes = (pal_value_get(value, "center") != NULL) + (pal_value_get(value, "size") != NULL);
    if (corners + sizes != 2 || corners == 1) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL,
                                corners + sizes == 0 ? "nothing" : "an incomplete or doubled box",
                                "min and max, or center and size", "write one pair");
    }
    for (int i = 0; i < 3; i++) {
        if (sizes == 2) {
            double half = s->high[i] / 2.0;
            s->low[i] = s->center[i] - half;
            s->high[i] = s->center[i] + half;
        }
        if (s->low[i] > s->high[i]) {
            char found[120];
            (void)snprintf(found, sizeof found, "min %g above max %g on axis %c", s->low[i],
                           s->high[i], "xyz"[i]);
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_get(value, "min"), NULL,
                                    found, "min at most max on every axis", "exchange them");
        }
    }
    return PALPATE_OK;
}

pal_status pal_rule_refine(pal_reading *r, const pal_value *value, void *object) {
    pal_refine *refine = object;
    int center = !pal_value_is_null(pal_value_get(value, "center"));
    int radius = !pal_value_is_null(pal_value_get(value, "radius"));
    int rim = !pal_value_is_null(pal_value_get(value, "rim"));
    if (rim + (center && radius) != 1 || center != radius) {
        const char *found = rim      ? "rim and a ball"
                            : center ? "center without radius"
                            : radius ? "radius without center"
                                     : "only a spacing";
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, NULL, found,
                                "center and radius, or rim", "write one of the two");
    }
    refine->kind = rim ? PALPATE_REFINE_RIM : PALPATE_REFINE_BALL;
    return PALPATE_OK;
}

static const char *const METHOD_NAMES[] = {"kind: point", "kind: cell with form: symmetric",
                                           "kind: galerkin", "kind: cell with form: collocated"};

/// An option that the method does not have is an error: it would do nothing.
static pal_status rule_options(pal_reading *r, const pal_value *value, int which) {
    const pal_scene_key *keys;
    int count = pal_scene_schema(&keys);
    for (int i = 0; i < count; i++) {
        int methods = keys[i].binding->methods;
        if (methods == 0 || (methods >> which & 1) != 0) {
            continue;
        }
        const char *name = strrchr(keys[i].path, '.') + 1;
        if (pal_value_is_null(pal_value_get(value, name))) {
            continue;
        }
        char found[100];
        char allowed[160] = "";
        (void)snprintf(found, sizeof found, "an option that %s does not have", METHOD_NAMES[which]);
        int any_cell =
            (methods >> PALPATE_METHOD_CELL & 1) != 0; // then form: collocated has it too
        for (int k = 0; k < (any_cell ? 3 : 4); k++) {
            size_t n = strlen(allowed);
            if ((methods >> k & 1) != 0) {
                (void)snprintf(allowed + n, sizeof allowed - n, "%s%s", n > 0 ? ", or " : "with ",
                               k == PALPATE_METHOD_CELL ? "kind: cell" : METHOD_NAMES[k]);
            }
        }
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_key(value, name), name, found,
                                allowed, "remove it, or change the method");
    }
    return PALPATE_OK;
}

static pal_status rule_stabilization(pal_reading *r, const pal_value *value,
                                     const pal_method *method) {
    int galerkin = method->kind == PALPATE_METHOD_GALERKIN;
    int collocated = !galerkin && method->form == PALPATE_CELL_COLLOCATED;
    pal_volumetric needed = galerkin     ? PALPATE_VOLUMETRIC_MIXED
                            : collocated ? PALPATE_VOLUMETRIC_NODAL
                                         : PALPATE_VOLUMETRIC_PATCH;
    if (method->volumetric != needed) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_key(value, "stabilization"),
                                "stabilization", "a factor of nothing",
                                galerkin     ? "with volumetric: mixed"
                                : collocated ? "with volumetric: nodal"
                                             : "with volumetric: patch",
                                "remove it");
    }
    if (collocated && method->stabilization > 1.0) {
        char found[40];
        (void)snprintf(found, sizeof found, "%g", method->stabilization);
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_get(value, "stabilization"),
                                "stabilization", found, "0 to 1 for form: collocated",
                                "it is the part of the plain term that is blended in");
    }
    return PALPATE_OK;
}

pal_status pal_rule_method(pal_reading *r, const pal_value *value, void *object) {
    struct pal_scene *scene = object;
    pal_method *method = &scene->method;
    int point = method->kind == PALPATE_METHOD_POINT;
    int galerkin = method->kind == PALPATE_METHOD_GALERKIN;
    int collocated = method->kind == PALPATE_METHOD_CELL && method->form == PALPATE_CELL_COLLOCATED;
    int which = collocated ? PALPATE_METHOD_COLLOCATED : (int)method->kind;
    pal_status status = rule_options(r, value, which);
    if (status != PALPATE_OK) {
        return status;
    }
    if (pal_value_is_null(pal_value_get(value, "basis"))) {
        method->basis = point ? PALPATE_BASIS_QUADRATIC : PALPATE_BASIS_LINEAR;
    }
    const pal_value *volumetric = pal_value_get(value, "volumetric");
    if (pal_value_is_null(volumetric)) {
        method->volumetric = point        ? PALPATE_VOLUMETRIC_PLAIN
                             : galerkin   ? PALPATE_VOLUMETRIC_MIXED
                             : collocated ? PALPATE_VOLUMETRIC_NODAL
                                          : PALPATE_VOLUMETRIC_PATCH;
    } else if (method->volumetric == PALPATE_VOLUMETRIC_PATCH && (galerkin || collocated)) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, volumetric, "volumetric", "patch",
                                galerkin ? "plain, nodal or mixed for kind: galerkin"
                                         : "plain or nodal for form: collocated",
                                "leave it out");
    } else if (method->volumetric == PALPATE_VOLUMETRIC_MIXED && !galerkin) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, volumetric, "volumetric", "mixed",
                                "plain, nodal or patch for kind: cell",
                                "leave it out, or kind: galerkin");
    }
    if (pal_value_is_null(pal_value_get(value, "stabilization"))) {
        method->stabilization = -1.0;
    } else if ((status = rule_stabilization(r, value, method)) != PALPATE_OK) {
        return status;
    }
    if (!point) {
        method->fictitious = 0;
    } else if (pal_value_is_null(pal_value_get(value, "fictitious"))) {
        method->fictitious = method->basis != PALPATE_BASIS_LINEAR; // paper 1 has none
    }
    if (!point && !collocated) {
        method->exponent = 0;
    }
    return PALPATE_OK;
}

/// What scripted and simulated devices share: `key` below device holds the device, `motion` the
/// stroke's keys.
static pal_status rule_stroke(pal_reading *r, const pal_value *device, const pal_value *motion,
                              const char *key, const char *direction_key, pal_tool_def *def) {
    pal_stroke *stroke = &def->device.stroke;
    if (!def->has_start) {
        char found[64];
        (void)snprintf(found, sizeof found, "a %s device, but no start", strrchr(key, '.') + 1);
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, device, key, found,
                                "start: [x, y, z] beside device",
                                "add the tool's origin when it just touches");
    }
    if (pal_value_is_null(pal_value_get(motion, "tremor_amplitude"))) {
        stroke->tremor_amplitude = stroke->kind == PALPATE_STROKE_PALPATION ? 2e-4 : 0.0;
    }
    const pal_value *direction = pal_value_get(motion, "direction");
    if (pal_value_is_null(direction)) {
        int along_x = fabs(def->axis[0]) > 0.9;
        stroke->direction[along_x] = 1.0;
    }
    double *d = stroke->direction;
    double along = 0.0;
    double length = 0.0;
    for (int i = 0; i < 3; i++) {
        along += d[i] * def->axis[i];
        length = hypot(length, d[i]);
    }
    double across = 0.0;
    for (int i = 0; i < 3; i++) {
        d[i] -= along * def->axis[i];
        across = hypot(across, d[i]);
    }
    if (!(across > 1e-6 * length)) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, direction, direction_key,
                                "a direction of length 0 or along the tool's axis",
                                "[x, y, z] across the axis", "choose another direction");
    }
    for (int i = 0; i < 3; i++) {
        d[i] /= across;
    }
    return PALPATE_OK;
}

static pal_status rule_scripted(pal_reading *r, const pal_value *tool, pal_tool_def *def) {
    const pal_value *scripted = pal_value_get(pal_value_get(tool, "device"), "scripted");
    return rule_stroke(r, scripted, scripted, "device.scripted", "device.scripted.direction", def);
}

/// Figures that the scene does not give are those of the model and of the grip.
static pal_status rule_simulated(pal_reading *r, const pal_value *tool, pal_tool_def *def) {
    const pal_value *at = pal_value_get(pal_value_get(tool, "device"), "simulated");
    const pal_value *hand = pal_value_get(at, "hand");
    pal_simulated *s = &def->device.simulated;
    pal_simulated figures = pal_simulated_default(s->model, s->grip);
    const struct {
        const pal_value *map;
        const char *key;
        double *value, figure;
    } given[] = {
        {at, "mass", &s->mass, figures.mass},
        {at, "damping", &s->damping, figures.damping},
        {at, "friction", &s->friction, figures.friction},
        {at, "resolution", &s->resolution, figures.resolution},
        {at, "force", &s->force, figures.force},
        {at, "reach", &s->reach, figures.reach},
        {hand, "mass", &s->hand_mass, figures.hand_mass},
        {hand, "damping", &s->hand_damping, figures.hand_damping},
        {hand, "stiffness", &s->hand_stiffness, figures.hand_stiffness},
    };
    s->stiffness = figures.stiffness;
    for (size_t i = 0; i < sizeof given / sizeof *given; i++) {
        if (pal_value_is_null(pal_value_get(given[i].map, given[i].key))) {
            *given[i].value = given[i].figure;
        } else if (given[i].map == hand && s->grip == PALPATE_GRIP_NONE) {
            char leaf[64];
            (void)snprintf(leaf, sizeof leaf, "device.simulated.hand.%s", given[i].key);
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_get(hand, given[i].key), leaf,
                                    "a hand's figure with grip: none", "no figure, or another grip",
                                    "leave it out, or grip: firm");
        }
    }
    return rule_stroke(r, at, pal_value_get(at, "motion"), "device.simulated",
                       "device.simulated.motion.direction", def);
}

pal_status pal_rule_tool(pal_reading *r, const pal_value *value, void *object) {
    pal_tool_def *tool = object;
    const pal_runtime_config *runtime = &r->scene->runtime;
    int index = (int)(tool - runtime->tools);
    if (tool->name[0] == 0) {
        (void)snprintf(tool->name, sizeof tool->name, index > 0 ? "tool%d" : "tool", index + 1);
    }
    for (int i = 0; i < index; i++) {
        if (strcmp(runtime->tools[i].name, tool->name) == 0) {
            char found[120];
            (void)snprintf(found, sizeof found, "%s, the name of tools[%d]", tool->name, i);
            const pal_value *name = pal_value_get(value, "name");
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, name != NULL ? name : value, "name",
                                    found, "a name of its own", "rename one");
        }
    }
    const pal_device_spec *spec = &tool->spec;
    const pal_value *limits = pal_value_get(value, "limits");
    if ((spec->max_force > 0.0 && tool->limits.force > spec->max_force) ||
        (spec->max_torque > 0.0 && tool->limits.torque > spec->max_torque)) {
        pal_place place;
        pal_reading_place(r, limits, &place);
        if (pal_scene_warn(
                r->scene, &place,
                "a limit is above what device_spec says the device bears: the device's holds") !=
            PALPATE_OK) {
            return pal_reading_memory(r);
        }
    }
    tool->has_start = !pal_value_is_null(pal_value_get(value, "start"));
    if (pal_value_key(value, "device") != NULL &&
        pal_value_is_null(pal_value_get(value, "device"))) {
        tool->device.kind = PALPATE_DEVICE_NULL;
    }
    switch (tool->device.kind) {
    case PALPATE_DEVICE_SCRIPTED:
        return rule_scripted(r, value, tool);
    case PALPATE_DEVICE_SIMULATED:
        return rule_simulated(r, value, tool);
    default:
        return PALPATE_OK;
    }
}

/// Refine zones that name a patch, and zones that do not refine.
static pal_status rule_refinement(pal_reading *r, const pal_value *body) {
    struct pal_scene *scene = r->scene;
    for (int32_t i = 0; i < scene->refine_count; i++) {
        const pal_refine *refine = &scene->refine[i];
        int found = refine->kind != PALPATE_REFINE_RIM;
        for (int32_t k = 0; k < scene->patch_count && !found; k++) {
            found = strcmp(scene->patch[k].name, refine->rim) == 0;
        }
        if (!found) {
            char key[40];
            char list[200] = "";
            for (int32_t k = 0; k < scene->patch_count; k++) {
                size_t n = strlen(list);
                (void)snprintf(list + n, sizeof list - n, "%s%s", n > 0 ? ", " : "",
                               scene->patch[k].name);
            }
            (void)snprintf(key, sizeof key, "refine[%d].rim", (int)i);
            const pal_value *zone = pal_value_get(body, "refine")->item[i];
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_get(zone, "rim"), key,
                                    refine->rim,
                                    scene->patch_count > 0 ? list : "a name from body.patches",
                                    "name a patch of body.patches");
        }
        if (refine->spacing > scene->spacing &&
            pal_scene_warn(scene, &refine->place,
                           "spacing %g m is coarser than body.spacing %g m: "
                           "it has no effect",
                           refine->spacing, scene->spacing) != PALPATE_OK) {
            return pal_reading_memory(r);
        }
    }
    return PALPATE_OK;
}

pal_status pal_rule_body(pal_reading *r, const pal_value *value, void *object) {
    struct pal_scene *scene = object;
    pal_status status = rule_refinement(r, value);
    if (status == PALPATE_OK && scene->fixed.count == 0) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_get(value, "fixed"), "fixed",
                                "an empty list", "at least one selector",
                                "hold the body somewhere, e.g. - {below: {z: 0}}");
    }
    if (status == PALPATE_OK) {
        status = pal_scene_check_primitive(scene, r->error);
    }
    return status;
}

pal_status pal_rule_watchdog(pal_reading *r, const pal_value *value, void *object) {
    const pal_watchdog_def *w = &((const struct pal_scene *)object)->runtime.watchdog;
    if (w->latch < w->stale || w->latch < w->stall) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, value, "latch",
                                "a time shorter than stale or stall", "at least both", "raise it");
    }
    return PALPATE_OK;
}

/// A simulated device is advanced by steps of at most 1 / rate: no more than 100 of them per tick
/// (haptic/device/device_simulated.c demands the same).
static pal_status rule_simulated_rate(pal_reading *r, const pal_value *root, int32_t tool) {
    const pal_device_def *device = &r->scene->runtime.tools[tool].device;
    const pal_simulated *s = &device->simulated;
    if (device->kind != PALPATE_DEVICE_SIMULATED) {
        return PALPATE_OK;
    }
    double mass = s->mass + s->hand_mass;
    double rate = fmax(s->damping / s->mass,
                       (s->damping + s->hand_damping) / mass + sqrt(s->hand_stiffness / mass));
    if (rate <= 100.0 * r->scene->runtime.servo_rate) {
        return PALPATE_OK;
    }
    char key[64];
    char found[96];
    (void)snprintf(key, sizeof key, "tools[%d].device.simulated", (int)tool);
    (void)snprintf(found, sizeof found, "damping and stiffness over mass of %g 1/s", rate);
    return pal_reading_fail(
        r, PALPATE_ERROR_SCENE,
        pal_value_get(pal_value_get(pal_value_get(root, "tools")->item[tool], "device"),
                      "simulated"),
        key, found, "at most 100 times servo.rate", "more mass, less damping or less stiffness");
}

/// Stiffness and damping that the scene does not give. Devices that feel the force (simulated, the
/// host's) get the coupling that bench/stability found stable; prescribed motions cannot be
/// unstable and stay rigid, and so does contact law nodes, which has no coupling.
static pal_status rule_coupling(pal_reading *r, const pal_value *root, int32_t index) {
    pal_tool_def *tool = &r->scene->runtime.tools[index];
    const pal_value *at = pal_value_get(pal_value_get(root, "tools")->item[index], "coupling");
    int feels =
        tool->device.kind == PALPATE_DEVICE_SIMULATED || tool->device.kind == PALPATE_DEVICE_NONE;
    if (pal_value_is_null(pal_value_get(at, "stiffness"))) {
        const pal_value *damping = pal_value_get(at, "damping");
        if (!pal_value_is_null(damping)) {
            char key[64];
            (void)snprintf(key, sizeof key, "tools[%d].coupling.damping", (int)index);
            return pal_reading_fail(r, PALPATE_ERROR_SCENE, damping, key,
                                    "a damping without a stiffness", "both, or a stiffness alone",
                                    "add stiffness");
        }
        double most = tool->spec.max_stiffness > 0.0 ? tool->spec.max_stiffness : (double)INFINITY;
        tool->coupling_stiffness = feels && r->scene->runtime.contact_law == PALPATE_CONTACT_SURFACE
                                       ? fmin(PALPATE_DEFAULT_COUPLING_STIFFNESS, most)
                                       : 0.0;
    }
    if (pal_value_is_null(pal_value_get(at, "damping"))) {
        double most = tool->spec.max_damping > 0.0 ? tool->spec.max_damping : (double)INFINITY;
        tool->coupling_damping =
            fmin(tool->coupling_stiffness / r->scene->runtime.servo_rate, most);
    }
    return PALPATE_OK;
}

pal_status pal_rule_root(pal_reading *r, const pal_value *value, void *object) {
    const struct pal_scene *scene = object;
    for (int32_t t = 0; t < scene->runtime.tool_count; t++) {
        pal_status status = rule_simulated_rate(r, value, t);
        if (status == PALPATE_OK) {
            status = rule_coupling(r, value, t);
        }
        if (status != PALPATE_OK) {
            return status;
        }
    }
    if (scene->skin.path[0] != '\0' && scene->store_rows == PALPATE_STORE_NONE) {
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_key(value, "skin"), "skin",
                                "a mesh to draw and store: {displacement: none}",
                                "displacement: surface or all", "change one of them");
    }
    if (scene->touchable.count == 0 && scene->patch_count == 0) {
        const pal_value *body = pal_value_get(value, "body");
        return pal_reading_fail(r, PALPATE_ERROR_SCENE, pal_value_get(body, "touchable"),
                                "body.touchable", "an empty list and no patches",
                                "a selector, or a patch", "leave the key out to touch all");
    }
    return PALPATE_OK;
}
