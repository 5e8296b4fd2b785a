/// The one table of scene keys: key, type, unit, range, default, help, and where the value goes.
/// It drives the loader, --set, --help and the reference documentation.
///
/// Paths: list items are "[]", names that the user chooses are "*". A parent stands before its
/// keys. Defaults that are YAML values are read by the loader like written ones; those in
/// parentheses describe what happens when the key is absent.
#include <math.h>
#include <string.h>

#include "src/scene/scene_schema.h"

// Ranges: text, low, low is open, high, high is open.
#define POSITIVE "more than 0", 0.0, 1, INFINITY, 0
#define NOT_NEGATIVE "0 or more", 0.0, 0, INFINITY, 0
#define FINITE "any", -INFINITY, 0, INFINITY, 0
#define WITHIN(a, b) #a " to " #b, a, 0, b, 0
#define UP_TO(b) "more than 0, up to " #b, 0.0, 1, b, 0
#define BETWEEN(a, b) "more than " #a ", less than " #b, a, 1, b, 1

#define LIMIT_WORDS .word = {"auto", "none"}, .word_value = {0, INFINITY}

#define BIND(...) (&(const pal_key_binding){__VA_ARGS__})
#define AT(object, field) .offset = offsetof(object, field)
#define PLACE(object, field) .has_place = 1, .place_offset = offsetof(object, field)
#define FLAGS(f) .flags = (f)
#define OPTION(n) .option = (n), .flags = PALPATE_KEY_OPTION
#define END .inline_max = 0

// Rows. The last arguments are bindings; END only makes the argument list never empty.
#define MAP_(path, def, help, ...)                                                                 \
    { path, "mapping", "", "", def, help, BIND(.kind = PALPATE_KEY_MAP, __VA_ARGS__) }
#define MAP(...) MAP_(__VA_ARGS__, END)
#define ONE_OF_(path, allowed, def, help, ...)                                                     \
    { path, "one of", "", allowed, def, help, BIND(.kind = PALPATE_KEY_ONE_OF, __VA_ARGS__) }
#define ONE_OF(...) ONE_OF_(__VA_ARGS__, END)
#define NUMBER_(path, unit, allowed, lo, lo_, hi, hi_, def, help, object, field, ...)              \
    {                                                                                              \
        path, "number", unit, allowed, def, help,                                                  \
            BIND(.kind = PALPATE_KEY_NUMBER, AT(object, field), .low = lo, .low_open = lo_,        \
                 .high = hi, .high_open = hi_, __VA_ARGS__)                                        \
    }
#define NUMBER(...) NUMBER_(__VA_ARGS__, END)
#define VECTOR_(path, unit, allowed, lo, lo_, hi, hi_, def, help, object, field, ...)              \
    {                                                                                              \
        path, "vector", unit, allowed, def, help,                                                  \
            BIND(.kind = PALPATE_KEY_VECTOR, AT(object, field), .low = lo, .low_open = lo_,        \
                 .high = hi, .high_open = hi_, __VA_ARGS__)                                        \
    }
#define VECTOR(...) VECTOR_(__VA_ARGS__, END)
#define INTEGER_(path, allowed, lo, lo_, hi, hi_, def, help, object, field, ...)                   \
    {                                                                                              \
        path, "integer", "-", allowed, def, help,                                                  \
            BIND(.kind = PALPATE_KEY_INTEGER, AT(object, field), .low = lo, .low_open = lo_,       \
                 .high = hi, .high_open = hi_, __VA_ARGS__)                                        \
    }
#define INTEGER(...) INTEGER_(__VA_ARGS__, END)
#define CHOICE_(path, words, def, help, object, field, ...)                                        \
    {                                                                                              \
        path, "choice", "", words, def, help,                                                      \
            BIND(.kind = PALPATE_KEY_CHOICE, AT(object, field), __VA_ARGS__)                       \
    }
#define CHOICE(...) CHOICE_(__VA_ARGS__, END)

#define METHODS(m) .methods = (m)
#define POINT (1 << PALPATE_METHOD_POINT)
#define CELL (1 << PALPATE_METHOD_CELL)
#define GALERKIN (1 << PALPATE_METHOD_GALERKIN)
#define COLLOCATED (1 << PALPATE_METHOD_COLLOCATED)

/// The selector keys below `path`; `enter` is .enter_patch = 1 for those of a patch.
#define SELECTOR_KEYS(path, enter)                                                                 \
    MAP(path ".ball", "(one of)", "nodes inside a ball", OPTION(PALPATE_SELECT_BALL),              \
        PLACE(pal_selector, place), enter),                                                        \
        VECTOR(path ".ball.center", "m", FINITE, "required", "its centre", pal_selector, center,   \
               FLAGS(PALPATE_KEY_REQUIRED)),                                                       \
        NUMBER(path ".ball.radius", "m", POSITIVE, "required", "its radius", pal_selector, radius, \
               FLAGS(PALPATE_KEY_REQUIRED)),                                                       \
        MAP(path ".box", "(one of)",                                                               \
            "nodes inside a box along the axes: min and max, or center and size",                  \
            OPTION(PALPATE_SELECT_BOX), PLACE(pal_selector, place),                                \
            .check = pal_rule_selector_box, enter),                                                \
        VECTOR(path ".box.min", "m", FINITE, "(with max)", "its lowest corner", pal_selector,      \
               low),                                                                               \
        VECTOR(path ".box.max", "m", FINITE, "(with min)", "its highest corner", pal_selector,     \
               high),                                                                              \
        VECTOR(path ".box.center", "m", FINITE, "(with size)", "its centre", pal_selector,         \
               center),                                                                            \
        VECTOR(path ".box.size", "m", NOT_NEGATIVE, "(with center)", "its edge lengths",           \
               pal_selector, high),                                                                \
        ONE_OF(path ".below", "x, y, z", "(one of)", "nodes at or below a value of one axis",      \
               OPTION(PALPATE_SELECT_BELOW), AT(pal_selector, axis), PLACE(pal_selector, place),   \
               enter),                                                                             \
        NUMBER(path ".below.x", "m", FINITE, "(one of)", "x at most this", pal_selector, value,    \
               OPTION(0)),                                                                         \
        NUMBER(path ".below.y", "m", FINITE, "(one of)", "y at most this", pal_selector, value,    \
               OPTION(1)),                                                                         \
        NUMBER(path ".below.z", "m", FINITE, "(one of)", "z at most this", pal_selector, value,    \
               OPTION(2)),                                                                         \
        ONE_OF(path ".above", "x, y, z", "(one of)", "nodes at or above a value of one axis",      \
               OPTION(PALPATE_SELECT_ABOVE), AT(pal_selector, axis), PLACE(pal_selector, place),   \
               enter),                                                                             \
        NUMBER(path ".above.x", "m", FINITE, "(one of)", "x at least this", pal_selector, value,   \
               OPTION(0)),                                                                         \
        NUMBER(path ".above.y", "m", FINITE, "(one of)", "y at least this", pal_selector, value,   \
               OPTION(1)),                                                                         \
        NUMBER(path ".above.z", "m", FINITE, "(one of)", "z at least this", pal_selector, value,   \
               OPTION(2)),                                                                         \
        MAP(path ".all", "(one of)", "every surface node; also written as the word all",           \
            .option = PALPATE_SELECT_ALL, FLAGS(PALPATE_KEY_OPTION | PALPATE_KEY_BARE),            \
            PLACE(pal_selector, place), enter)

#define SELECTOR_WORDS "ball, box, below, above, all"

#define SELECTOR_LIST(path, def, help, flags_, option_, object, field, place_)                     \
    {path,                                                                                         \
     "list of selectors",                                                                          \
     "",                                                                                           \
     SELECTOR_WORDS,                                                                               \
     def,                                                                                          \
     help,                                                                                         \
     BIND(.kind = PALPATE_KEY_LIST, .offset = offsetof(object, field.item),                        \
          .count_offset = offsetof(object, field.count), .item_size = sizeof(pal_selector),        \
          FLAGS((flags_) | PALPATE_KEY_SINGLE), .option = option_, PLACE(object, place_))},        \
        ONE_OF(path "[]", SELECTOR_WORDS, "", "one selector; those of a list are united",          \
               AT(pal_selector, kind), PLACE(pal_selector, place)),                                \
        SELECTOR_KEYS(path "[]", .enter_patch = 0)

static const pal_scene_key KEYS[] = {
    MAP("", "", "the scene", .check = pal_rule_root),
    {"palpate", "integer", "-", "1", "required", "version of the scene format",
     BIND(.kind = PALPATE_KEY_INTEGER, AT(struct pal_scene, version), .low = 1, .high = 1,
          FLAGS(PALPATE_KEY_REQUIRED), .remedy = "a higher version needs a newer Palpate")},

    // ---- body
    MAP("body", "required", "the deformable body", FLAGS(PALPATE_KEY_REQUIRED),
        .check = pal_rule_body),
    ONE_OF("body.geometry", "hemisphere, box, sphere, file", "required", "its shape",
           AT(struct pal_scene, geometry.kind), FLAGS(PALPATE_KEY_REQUIRED),
           PLACE(struct pal_scene, geometry.place), .check = pal_rule_geometry),
    MAP("body.geometry.hemisphere", "(one of)", "flat face at z = 0, pole at +z",
        OPTION(PALPATE_GEOMETRY_HEMISPHERE)),
    NUMBER("body.geometry.hemisphere.radius", "m", POSITIVE, "required", "its radius",
           struct pal_scene, geometry.radius, FLAGS(PALPATE_KEY_REQUIRED)),
    MAP("body.geometry.box", "(one of)", "a box along the axes", OPTION(PALPATE_GEOMETRY_BOX)),
    VECTOR("body.geometry.box.size", "m", POSITIVE, "required", "its edge lengths",
           struct pal_scene, geometry.size, FLAGS(PALPATE_KEY_REQUIRED)),
    VECTOR("body.geometry.box.center", "m", FINITE, "[0, 0, 0]", "its centre", struct pal_scene,
           geometry.center),
    MAP("body.geometry.sphere", "(one of)", "a ball", OPTION(PALPATE_GEOMETRY_SPHERE)),
    NUMBER("body.geometry.sphere.radius", "m", POSITIVE, "required", "its radius", struct pal_scene,
           geometry.radius, FLAGS(PALPATE_KEY_REQUIRED)),
    VECTOR("body.geometry.sphere.center", "m", FINITE, "[0, 0, 0]", "its centre", struct pal_scene,
           geometry.center),
    {"body.geometry.file", "path", "", "an STL, OBJ or PLY file", "(one of)",
     "closed triangle surface; relative to the scene file",
     BIND(.kind = PALPATE_KEY_PATH, AT(struct pal_scene, geometry.path),
          .option = PALPATE_GEOMETRY_FILE, FLAGS(PALPATE_KEY_OPTION | PALPATE_KEY_EXISTS))},
    NUMBER("body.geometry.scale", "m", POSITIVE, "1",
           "metres per unit of the surface file (file only)", struct pal_scene, geometry.scale),
    NUMBER("body.spacing", "m", POSITIVE, "required", "node spacing", struct pal_scene, spacing,
           FLAGS(PALPATE_KEY_REQUIRED), PLACE(struct pal_scene, spacing_place)),
    NUMBER("body.grading", "-", UP_TO(2), "0.45",
           "growth of the spacing per metre away from a finer zone", struct pal_scene, grading),
    {"body.refine", "list", "", "mappings", "[]", "zones with finer spacing",
     BIND(.kind = PALPATE_KEY_LIST, AT(struct pal_scene, refine),
          .count_offset = offsetof(struct pal_scene, refine_count),
          .item_size = sizeof(pal_refine))},
    MAP("body.refine[]", "", "a ball (center, radius, spacing) or a patch's rim (rim, spacing)",
        PLACE(pal_refine, place), .check = pal_rule_refine),
    VECTOR("body.refine[].center", "m", FINITE, "(with radius)", "centre of the ball", pal_refine,
           center),
    NUMBER("body.refine[].radius", "m", POSITIVE, "(with center)", "radius of the ball", pal_refine,
           radius),
    {"body.refine[].rim", "name", "", "a patch's name", "(instead of center and radius)",
     "refine towards the rim of this patch", BIND(.kind = PALPATE_KEY_NAME, AT(pal_refine, rim))},
    NUMBER("body.refine[].spacing", "m", POSITIVE, "required", "node spacing there", pal_refine,
           spacing, FLAGS(PALPATE_KEY_REQUIRED)),
    MAP("body.material", "required", "isotropic linear elastic material",
        FLAGS(PALPATE_KEY_REQUIRED)),
    NUMBER("body.material.young", "Pa", POSITIVE, "required", "Young's modulus", struct pal_scene,
           young, FLAGS(PALPATE_KEY_REQUIRED), PLACE(struct pal_scene, young_place)),
    NUMBER("body.material.poisson", "-", BETWEEN(-1, 0.5), "required", "Poisson's ratio",
           struct pal_scene, poisson, FLAGS(PALPATE_KEY_REQUIRED),
           PLACE(struct pal_scene, poisson_place),
           .remedy =
               "for nearly incompressible tissue use 0.49 to 0.499 with method: {kind: cell}"),
    NUMBER("body.material.density", "kg/m^3", POSITIVE, "1000", "density", struct pal_scene,
           density),
    SELECTOR_LIST("body.fixed", "required", "surface nodes held at u = 0", PALPATE_KEY_REQUIRED, 0,
                  struct pal_scene, fixed, fixed_place),
    SELECTOR_LIST("body.touchable", "[all]", "surface nodes that a tool may touch", 0, 0,
                  struct pal_scene, touchable, touchable_place),
    {"body.patches", "names", "", "name: selector", "{}", "named sets of nodes for `palpate press`",
     BIND(.kind = PALPATE_KEY_NAMED, AT(struct pal_scene, patch),
          .count_offset = offsetof(struct pal_scene, patch_count),
          .item_size = sizeof(pal_scene_patch), .name_offset = offsetof(pal_scene_patch, name))},
    ONE_OF("body.patches.*", SELECTOR_WORDS ", any", "", "the patch's selector, and rim_spacing",
           AT(pal_selector, kind), PLACE(pal_scene_patch, place)),
    SELECTOR_KEYS("body.patches.*", .enter_patch = 1),
    SELECTOR_LIST("body.patches.*.any", "(one of)", "several selectors, united", PALPATE_KEY_OPTION,
                  -1, pal_scene_patch, where, place),
    NUMBER("body.patches.*.rim_spacing", "m", POSITIVE, "auto",
           "node spacing on the patch's rim; auto: 1/14 of the patch's radius; none: no nodes on "
           "the rim",
           pal_scene_patch, rim_spacing, .word = {"auto", "none"}, .word_value = {-1, 0}),
    {"body.probes", "names", "", "name: [x, y, z]", "{}", "points whose displacement is reported",
     BIND(.kind = PALPATE_KEY_NAMED, AT(struct pal_scene, probe),
          .count_offset = offsetof(struct pal_scene, probe_count),
          .item_size = sizeof(pal_scene_probe), .name_offset = offsetof(pal_scene_probe, name))},
    VECTOR("body.probes.*", "m", FINITE, "", "position in the rest shape", pal_scene_probe,
           position, PLACE(pal_scene_probe, place)),

    // ---- method
    MAP("method", "(all defaults)", "how equilibrium is discretized", .check = pal_rule_method,
        PLACE(struct pal_scene, method_place)),
    CHOICE("method.kind", "point | cell | galerkin", "cell",
           "point collocation (paper 1), cell collocation, or Galerkin", struct pal_scene,
           method.kind),
    CHOICE("method.form", "symmetric | collocated", "symmetric",
           "cell balance from averaged strains (positive by construction), or from MLS gradients",
           struct pal_scene, method.form, METHODS(CELL | COLLOCATED)),
    CHOICE("method.basis", "linear | quadratic | cubic",
           "(quadratic for point, linear for form: collocated)", "monomials of the MLS fit",
           struct pal_scene, method.basis, .first = 1, METHODS(POINT | COLLOCATED)),
    CHOICE("method.derivatives", "full | diffuse", "full", "derivatives of the MLS shape functions",
           struct pal_scene, method.derivatives, METHODS(POINT)),
    INTEGER("method.neighbours", WITHIN(4, 400), "(by the basis)", "nodes per stencil",
            struct pal_scene, method.neighbours, METHODS(POINT | COLLOCATED)),
    INTEGER("method.exponent", WITHIN(1, 8), "2", "p of the singular weight s^-2p",
            struct pal_scene, method.exponent, METHODS(POINT | COLLOCATED)),
    {"method.fictitious", "switch", "", "true | false",
     "(true; false for the linear basis, as in paper 1)",
     "fictitious nodes outside each traction node, PDE on the boundary",
     BIND(.kind = PALPATE_KEY_SWITCH, AT(struct pal_scene, method.fictitious), METHODS(POINT))},
    CHOICE("method.volumetric", "plain | nodal | mixed | patch",
           "(patch for cell, nodal for form: collocated, mixed for galerkin)",
           "volumetric part: at the point, averaged at nodes, with pressures (galerkin only), at "
           "nodes "
           "and, towards nu = 0.5, over groups of cells (cell only)",
           struct pal_scene, method.volumetric, METHODS(CELL | COLLOCATED | GALERKIN)),
    NUMBER("method.stabilization", "-", WITHIN(0, 1e6),
           "(5 for cell, 0 for form: collocated, 1 for galerkin)",
           "cell: bulk modulus up to which single nodes resist, in shear moduli, the rest acts on "
           "groups; collocated: part of the plain volumetric term blended in, 0 to 1; galerkin, "
           "mixed: "
           "factor of the pressure's stabilization",
           struct pal_scene, method.stabilization, METHODS(CELL | COLLOCATED | GALERKIN)),
    INTEGER("method.integration", WITHIN(1, 64), "(the method's own)",
            "integration points per cell", struct pal_scene, method.integration, METHODS(GALERKIN),
            FLAGS(PALPATE_KEY_NOT_BUILT)),

    // ---- model
    CHOICE("repair", "none | symmetrize | positive", "symmetrize",
           "what is stored: the raw block, its symmetric part, or the nearest positive one",
           struct pal_scene, symmetrize),
    CHOICE("certify", "strict | warn", "strict",
           "whether a model that fails its certificate is refused or written with a warning",
           struct pal_scene, certify_warn),
    {"estimate", "switch", "", "true | false", "true",
     "estimate the error of the patches' forces by a second cloud, 1.5 times coarser",
     BIND(.kind = PALPATE_KEY_SWITCH, AT(struct pal_scene, estimate))},
    MAP("store", "(all defaults)", "what is stored beside the touched nodes' own block"),
    CHOICE("store.displacement", "none | surface | all", "surface",
           "nodes whose displacement can be asked for", struct pal_scene, store_rows),
    CHOICE("store.precision", "double | single | half | scaled", "single",
           "of the stored displacement rows; scaled: 16-bit integers with a scale per column",
           struct pal_scene, precision),
    NUMBER("store.tolerance", "-", WITHIN(0, 0.5), "0",
           "the rows are stored in the cheapest form whose displacements err by at most this part "
           "of the "
           "largest (over sampled contacts); 0: as store.precision says",
           struct pal_scene, store_tolerance),

    MAP("skin", "(the body's surface file, or its own surface)",
        "the mesh that a host draws: displacement and normals can be asked for at its vertices",
        PLACE(struct pal_scene, skin.place)),
    {"skin.file", "path", "", "an STL, OBJ or PLY file", "required",
     "any triangles near the body's surface; the vertices keep their order; relative to the scene "
     "file",
     BIND(.kind = PALPATE_KEY_PATH, AT(struct pal_scene, skin.path),
          FLAGS(PALPATE_KEY_REQUIRED | PALPATE_KEY_EXISTS))},
    NUMBER("skin.scale", "m", POSITIVE, "1", "metres per unit of that file", struct pal_scene,
           skin.scale),

    // ---- tools
    {"tools", "list", "", "mappings, at most 8", "[]", "what touches the body",
     BIND(.kind = PALPATE_KEY_LIST, AT(struct pal_scene, runtime.tools),
          .count_offset = offsetof(struct pal_scene, runtime.tool_count),
          .item_size = sizeof(pal_tool_def), .inline_max = PALPATE_TOOLS_MAX)},
    MAP("tools[]", "", "one tool", .check = pal_rule_tool),
    {"tools[].name", "name", "", "letters, digits, _ and -", "(tool, tool2, ...)", "its name",
     BIND(.kind = PALPATE_KEY_NAME, AT(pal_tool_def, name))},
    ONE_OF("tools[].shape", "point, sphere, capsule", "point", "its shape",
           AT(pal_tool_def, shape)),
    MAP("tools[].shape.point", "(one of)", "a point; also written as the word point",
        .option = PALPATE_SHAPE_POINT, FLAGS(PALPATE_KEY_OPTION | PALPATE_KEY_BARE)),
    MAP("tools[].shape.sphere", "(one of)", "a ball around the tool's origin",
        OPTION(PALPATE_SHAPE_SPHERE)),
    NUMBER("tools[].shape.sphere.radius", "m", POSITIVE, "required", "its radius", pal_tool_def,
           radius, FLAGS(PALPATE_KEY_REQUIRED)),
    MAP("tools[].shape.capsule", "(one of)",
        "a rounded rod along the tool's z, centred on its origin", OPTION(PALPATE_SHAPE_CAPSULE)),
    NUMBER("tools[].shape.capsule.radius", "m", POSITIVE, "required", "its radius", pal_tool_def,
           radius, FLAGS(PALPATE_KEY_REQUIRED)),
    NUMBER("tools[].shape.capsule.length", "m", POSITIVE, "required",
           "length of its axis, round ends not counted", pal_tool_def, length,
           FLAGS(PALPATE_KEY_REQUIRED)),
    ONE_OF("tools[].device", "replay, scripted, simulated, or null",
           "(none: the host drives the tool)", "what moves it; null: it stays at start",
           AT(pal_tool_def, device.kind)),
    {"tools[].device.replay", "path", "", "a trajectory CSV file", "(one of)",
     "time,x,y,z,qw,qx,qy,qz,button; relative to the scene file",
     BIND(.kind = PALPATE_KEY_PATH, AT(pal_tool_def, device.path), OPTION(PALPATE_DEVICE_REPLAY))},
    MAP("tools[].device.scripted", "(one of)", "a motion by parameters, from start along axis",
        OPTION(PALPATE_DEVICE_SCRIPTED)),
    CHOICE("tools[].device.scripted.kind", "press | slide | circle | palpation", "press",
           "what it does once pressed", pal_tool_def, device.stroke.kind),
    NUMBER("tools[].device.scripted.depth", "m", POSITIVE, "required",
           "depth along the tool's axis, past start", pal_tool_def, device.stroke.depth,
           FLAGS(PALPATE_KEY_REQUIRED)),
    NUMBER("tools[].device.scripted.ramp", "s", POSITIVE, "0.5", "time of the smooth approach",
           pal_tool_def, device.stroke.ramp),
    NUMBER("tools[].device.scripted.period", "s", POSITIVE, "2", "period of the repeated motion",
           pal_tool_def, device.stroke.period),
    NUMBER("tools[].device.scripted.amplitude", "m", NOT_NEGATIVE, "0.005",
           "half travel of a slide, radius of a circle", pal_tool_def, device.stroke.amplitude),
    VECTOR("tools[].device.scripted.direction", "-", FINITE, "(x, or y for an axis along x)",
           "direction of a slide, made perpendicular to the tool's axis", pal_tool_def,
           device.stroke.direction),
    NUMBER("tools[].device.scripted.tremor_amplitude", "m", NOT_NEGATIVE,
           "(0.0002 for palpation, else 0)", "amplitude of the hand's tremor", pal_tool_def,
           device.stroke.tremor_amplitude),
    NUMBER("tools[].device.scripted.tremor_frequency", "Hz", UP_TO(100), "10",
           "its frequency; physiological: 8 to 12", pal_tool_def, device.stroke.tremor_frequency),
    MAP("tools[].device.simulated", "(one of)",
        "a simulated force-feedback device in a simulated hand, from start along axis: a closed "
        "loop",
        OPTION(PALPATE_DEVICE_SIMULATED)),
    CHOICE("tools[].device.simulated.model", "touch | premium", "touch",
           "whose figures it has: Touch (Phantom Omni) or Phantom Premium 1.5", pal_tool_def,
           device.simulated.model),
    NUMBER("tools[].device.simulated.mass", "kg", WITHIN(0.001, 100), "(by model: 0.045, 0.075)",
           "apparent mass at the tip", pal_tool_def, device.simulated.mass),
    NUMBER("tools[].device.simulated.damping", "N s/m", WITHIN(0, 10000), "(0.1)",
           "viscous damping of the device alone", pal_tool_def, device.simulated.damping),
    NUMBER("tools[].device.simulated.friction", "N", WITHIN(0, 1000), "(by model: 0.26, 0.04)",
           "Coulomb friction of each axis", pal_tool_def, device.simulated.friction),
    NUMBER("tools[].device.simulated.resolution", "m", WITHIN(0, 0.01), "(by model: 5.5e-5, 3e-5)",
           "step of the encoders; 0: exact", pal_tool_def, device.simulated.resolution),
    NUMBER("tools[].device.simulated.force", "N", WITHIN(0, 10000), "(by model: 3.3, 8.5)",
           "largest force of the actuators", pal_tool_def, device.simulated.force),
    NUMBER("tools[].device.simulated.reach", "m", WITHIN(0.0001, 1000), "(by model: 0.08, 0.19)",
           "each coordinate stops this far from start", pal_tool_def, device.simulated.reach),
    NUMBER("tools[].device.simulated.push", "N", WITHIN(-1000, 1000), "0",
           "constant force along axis, as of a weight", pal_tool_def, device.simulated.push),
    NUMBER("tools[].device.simulated.kick", "m/s", WITHIN(-10, 10), "0",
           "speed along axis at the start", pal_tool_def, device.simulated.kick),
    NUMBER("tools[].device.simulated.grasp", "s", NOT_NEGATIVE, "0",
           "the grasp button closes at this time; 0: never", pal_tool_def, device.simulated.grasp),
    MAP("tools[].device.simulated.hand", "(all defaults)", "the hand that holds it"),
    CHOICE("tools[].device.simulated.hand.grip", "firm | light | none", "firm",
           "a measured arm and hand, a tenth of it, or nobody", pal_tool_def,
           device.simulated.grip),
    NUMBER("tools[].device.simulated.hand.mass", "kg", WITHIN(0, 100),
           "(by grip: 0.554, 0.0554, 0)", "mass that moves with the tip", pal_tool_def,
           device.simulated.hand_mass),
    NUMBER("tools[].device.simulated.hand.damping", "N s/m", WITHIN(0, 10000),
           "(by grip: 6.45, 0.645, 0)", "between the tip and the intended motion", pal_tool_def,
           device.simulated.hand_damping),
    NUMBER("tools[].device.simulated.hand.stiffness", "N/m", WITHIN(0, 1000000),
           "(by grip: 135, 13.5, 0)", "between the tip and the intended motion", pal_tool_def,
           device.simulated.hand_stiffness),
    NUMBER("tools[].device.simulated.hand.release", "s", NOT_NEGATIVE, "0",
           "it lets go at this time; 0: never", pal_tool_def, device.simulated.release),
    MAP("tools[].device.simulated.motion", "(all defaults)",
        "what the hand intends, as a scripted device moves; it stays at start without a depth"),
    CHOICE("tools[].device.simulated.motion.kind", "press | slide | circle | palpation", "press",
           "what it does once pressed", pal_tool_def, device.stroke.kind),
    NUMBER("tools[].device.simulated.motion.depth", "m", NOT_NEGATIVE, "0",
           "depth along the tool's axis, past start", pal_tool_def, device.stroke.depth),
    NUMBER("tools[].device.simulated.motion.ramp", "s", POSITIVE, "0.5",
           "time of the smooth approach", pal_tool_def, device.stroke.ramp),
    NUMBER("tools[].device.simulated.motion.period", "s", POSITIVE, "2",
           "period of the repeated motion", pal_tool_def, device.stroke.period),
    NUMBER("tools[].device.simulated.motion.amplitude", "m", NOT_NEGATIVE, "0.005",
           "half travel of a slide, radius of a circle", pal_tool_def, device.stroke.amplitude),
    VECTOR("tools[].device.simulated.motion.direction", "-", FINITE,
           "(x, or y for an axis along x)",
           "direction of a slide, made perpendicular to the tool's axis", pal_tool_def,
           device.stroke.direction),
    NUMBER("tools[].device.simulated.motion.tremor_amplitude", "m", NOT_NEGATIVE,
           "(0.0002 for palpation, else 0)", "amplitude of the hand's tremor", pal_tool_def,
           device.stroke.tremor_amplitude),
    NUMBER("tools[].device.simulated.motion.tremor_frequency", "Hz", UP_TO(100), "10",
           "its frequency; physiological: 8 to 12", pal_tool_def, device.stroke.tremor_frequency),
    NUMBER("tools[].friction", "-", WITHIN(0, 10), "0",
           "Coulomb friction coefficient (contact: {law: surface})", pal_tool_def, friction),
    MAP("tools[].coupling", "(see stiffness)",
        "virtual coupling between device and tool (contact law surface)"),
    NUMBER(
        "tools[].coupling.stiffness", "N/m", NOT_NEGATIVE,
        "(1000 with a simulated device and with none (the host's), else 0)",
        "its spring; 0: rigid, the device pose is the tool's; default: stable on soft and stiff "
        "organs with and without a hand (bench/stability); never above device_spec.max_stiffness",
        pal_tool_def, coupling_stiffness),
    NUMBER("tools[].coupling.damping", "N s/m", NOT_NEGATIVE, "(stiffness / servo.rate)",
           "its damper; never above device_spec.max_damping", pal_tool_def, coupling_damping),
    MAP("tools[].limits", "(all defaults)", "what the device may be asked for"),
    NUMBER(
        "tools[].limits.force", "N", UP_TO(1000), "auto",
        "cap of the force's magnitude; auto: device_spec.max_force, else 3.3 (peak of a Geomagic "
        "Touch); none: no cap, and each run says so",
        pal_tool_def, limits.force, LIMIT_WORDS),
    NUMBER("tools[].limits.slew", "N/ms", UP_TO(100000), "auto",
           "cap of the force's rate of change; auto: 100; none: as above", pal_tool_def,
           limits.slew, LIMIT_WORDS),
    NUMBER("tools[].limits.torque", "N m", UP_TO(100), "auto",
           "cap of the torque's magnitude; auto: device_spec.max_torque, else 0.2; none: as above",
           pal_tool_def, limits.torque, LIMIT_WORDS),
    MAP("tools[].device_spec", "(all unknown)",
        "what the device that the tool is felt with can bear; limits and coupling never exceed it"),
    NUMBER("tools[].device_spec.max_force", "N", UP_TO(1000), "(unknown)", "largest force",
           pal_tool_def, spec.max_force),
    NUMBER("tools[].device_spec.max_torque", "N m", UP_TO(100), "(unknown)", "largest torque",
           pal_tool_def, spec.max_torque),
    NUMBER("tools[].device_spec.max_stiffness", "N/m", UP_TO(1e6), "(unknown)",
           "stiffest virtual coupling that stays stable on it", pal_tool_def, spec.max_stiffness),
    NUMBER("tools[].device_spec.max_damping", "N s/m", UP_TO(1e4), "(unknown)",
           "largest damping of a virtual coupling", pal_tool_def, spec.max_damping),
    NUMBER("tools[].device_spec.max_speed", "m/s", UP_TO(1000), "(unknown)",
           "speed of its tip; a pose that moves faster is a fault", pal_tool_def, spec.max_speed),
    VECTOR("tools[].start", "m", FINITE, "(needed by indent and by scripted devices)",
           "tool origin when it just touches", pal_tool_def, start),
    VECTOR("tools[].axis", "-", FINITE, "[0, 0, -1]", "pressing direction, any length but 0",
           pal_tool_def, axis, FLAGS(PALPATE_KEY_UNIT)),

    // ---- rates
    MAP("servo", "(all defaults)", "the force loop"),
    NUMBER("servo.rate", "Hz", WITHIN(10, 20000), "1000", "ticks per second", struct pal_scene,
           runtime.servo_rate),
    MAP("render", "(all defaults)", "the picture"),
    NUMBER("render.rate", "Hz", WITHIN(0, 1000), "30", "frames per second; 0: none",
           struct pal_scene, runtime.render_rate),
    CHOICE(
        "render.field", "servo | render", "servo",
        "who computes the displacement field: the servo after each force, or the render thread at "
        "its own rate (large bodies: the tick then costs nothing for the field)",
        struct pal_scene, runtime.field_by),
    MAP("watchdog", "(all defaults)", "when input is a fault and the force fades, ramps or latches",
        .check = pal_rule_watchdog),
    NUMBER("watchdog.stale", "s", WITHIN(0.001, 1), "0.02",
           "a pose this old (refused, no number, time stamp standing or backwards) fades the force",
           struct pal_scene, runtime.watchdog.stale),
    NUMBER("watchdog.stall", "s", WITHIN(0.001, 10), "0.1",
           "so much time without a tick: the force starts from zero", struct pal_scene,
           runtime.watchdog.stall),
    NUMBER("watchdog.latch", "s", WITHIN(0.001, 60), "1",
           "stale or stalled this long: the force stays zero until it is let go", struct pal_scene,
           runtime.watchdog.latch),
    NUMBER("watchdog.speed", "m/s", WITHIN(0.001, 1000), "auto",
           "a pose that moves faster is a jump; auto: device_spec.max_speed, else 20",
           struct pal_scene, runtime.watchdog.speed, .word = {"auto"}, .word_value = {0}),
    NUMBER("watchdog.ramp_down", "s", WITHIN(1e-6, 1), "0.01", "time in which the force fades",
           struct pal_scene, runtime.watchdog.ramp_down),
    NUMBER("watchdog.ramp_up", "s", WITHIN(0.001, 10), "0.1",
           "time in which it comes back after a fault", struct pal_scene, runtime.watchdog.ramp_up),
    MAP("contact", "(all defaults)", "how tools touch the body"),
    CHOICE("contact.law", "surface | nodes", "surface",
           "contact anywhere on the surface, or prescribed displacement of touched nodes (paper 1)",
           struct pal_scene, runtime.contact_law),
    INTEGER("contact.points", WITHIN(1, 64), "16",
            "law surface: contact points of one tool, 1, 6, 7, 16, 19 or 37 for a ball",
            struct pal_scene, runtime.contact_points),
    INTEGER("max_contacts", WITHIN(1, 1024), "32", "contact points an engine keeps at once",
            struct pal_scene, runtime.max_contacts),
};

int pal_scene_schema(const pal_scene_key **keys) {
    if (keys != NULL) {
        *keys = KEYS;
    }
    return (int)(sizeof KEYS / sizeof KEYS[0]);
}

int pal_schema_find(const char *path) {
    for (size_t i = 0; i < sizeof KEYS / sizeof KEYS[0]; i++) {
        if (strcmp(KEYS[i].path, path) == 0) {
            return (int)i;
        }
    }
    return -1;
}

/// 1 when a written path matches a schema path, whose * stands for any one name.
static int path_matches(const char *written, const char *schema) {
    while (*schema != 0) {
        if (*schema == '*') {
            while (*written != 0 && *written != '.') {
                written++;
            }
            schema++;
        } else if (*schema++ != *written++) {
            return 0;
        }
    }
    return *written == 0;
}

int pal_schema_is_list(const char *path) {
    for (size_t i = 0; i < sizeof KEYS / sizeof KEYS[0]; i++) {
        if (KEYS[i].binding->kind == PALPATE_KEY_LIST && path_matches(path, KEYS[i].path)) {
            return 1;
        }
    }
    return 0;
}
