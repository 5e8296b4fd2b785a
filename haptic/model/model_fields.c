/// @file model_fields.c  The scalars of a model file: path, place in the model, type, unit, meaning
/// (see model_fields.h). A new one goes into an `added` table, so that older files still load.
#include "haptic/model/model_fields.h"

#include "haptic/model/model.h"

#define AT(member) offsetof(struct pal_model, member)
#define I32 PALPATE_H5_I32
#define U64 PALPATE_H5_U64
#define F64 PALPATE_H5_F64

_Static_assert(sizeof(pal_precision) == 4 && sizeof(pal_shape_kind) == 4 &&
                   sizeof(pal_device_kind) == 4 && sizeof(pal_stroke_kind) == 4 && sizeof(int) == 4,
               "enumerations and int are stored as 32-bit integers");
_Static_assert(offsetof(pal_simulated, grasp) - offsetof(pal_simulated, mass) == 13 * 8,
               "the figures of a simulated device are stored as one array");

static const pal_field model_fields[] = {
    {"/info/node_count", AT(info.node_count), I32, 1, "1", "nodes of the cloud"},
    {"/info/surface_count", AT(info.surface_count), I32, 1, "1", "surface nodes, first in order"},
    {"/info/triangle_count", AT(info.triangle_count), I32, 1, "1", "surface triangles"},
    {"/info/touchable_count", AT(info.touchable_count), I32, 1, "1", "nodes a tool may touch"},
    {"/info/column_count", AT(info.column_count), I32, 1, "1", "nodes with compliance columns (t)"},
    {"/info/row_count", AT(info.row_count), I32, 1, "1", "nodes whose displacement is stored (s)"},
    {"/info/fixed_count", AT(info.fixed_count), I32, 1, "1", "nodes held at u = 0"},
    {"/info/patch_count", AT(info.patch_count), I32, 1, "1", "named patches"},
    {"/info/probe_count", AT(info.probe_count), I32, 1, "1", "probes"},
    {"/info/skin_count", AT(info.skin_count), I32, 1, "1", "vertices of the render mesh"},
    {"/info/precision", AT(info.precision), I32, 1, "1",
     "of the stored rows: 0 double, 1 single, 2 half, 3 scaled 16-bit"},
    {"/info/bytes", AT(info.bytes), U64, 1, "byte", "compliance blocks in memory"},
    {"/info/peak_bytes", AT(info.peak_bytes), U64, 1, "byte", "peak memory of the offline stage"},
    {"/info/spacing_min", AT(info.spacing_min), F64, 1, "m", "smallest node spacing"},
    {"/info/spacing_mean", AT(info.spacing_mean), F64, 1, "m", "mean node spacing"},
    {"/info/spacing_max", AT(info.spacing_max), F64, 1, "m", "largest node spacing"},
    {"/info/young", AT(info.young), F64, 1, "Pa", "Young's modulus"},
    {"/info/poisson", AT(info.poisson), F64, 1, "1", "Poisson's ratio"},
    {"/info/density", AT(info.density), F64, 1, "kg/m^3", "density"},
    {"/info/volume", AT(info.volume), F64, 1, "m^3", "volume of the body"},
    {"/info/bounds_min", AT(info.bounds_min), F64, 3, "m", "lower corner of the rest shape"},
    {"/info/bounds_max", AT(info.bounds_max), F64, 3, "m", "upper corner of the rest shape"},
    {"/info/method", AT(info.method), PALPATE_FIELD_TEXT,
     PALPATE_MEMBER_SIZE(pal_model_info, method), NULL, "discretization"},
    {"/info/method_options", AT(info.method_options), PALPATE_FIELD_TEXT,
     PALPATE_MEMBER_SIZE(pal_model_info, method_options), NULL, "its options in effect"},
    {"/info/hash", AT(info.hash), PALPATE_FIELD_TEXT, PALPATE_MEMBER_SIZE(pal_model_info, hash),
     NULL, "content hash of the scene's physics (BLAKE2b-256, hex)"},
    {"/info/provenance", AT(info.provenance), PALPATE_FIELD_TEXT,
     PALPATE_MEMBER_SIZE(pal_model_info, provenance), NULL, "program, compiler, libraries, host"},

    {"/seconds/cloud", AT(info.seconds.cloud), F64, 1, "s", "node cloud"},
    {"/seconds/assemble", AT(info.seconds.assemble), F64, 1, "s", "assembly"},
    {"/seconds/factor", AT(info.seconds.factor), F64, 1, "s", "factorization"},
    {"/seconds/solve", AT(info.seconds.solve), F64, 1, "s", "columns"},
    {"/seconds/certify", AT(info.seconds.certify), F64, 1, "s", "certificate"},
    {"/seconds/total", AT(info.seconds.total), F64, 1, "s", "all of the offline stage"},

    {"/certificate/pass", AT(info.certificate.pass), I32, 1, "1", "1: every gate holds"},
    {"/certificate/passive", AT(info.certificate.passive), I32, 1, "1",
     "1: C_TT is symmetric and positive definite"},
    {"/certificate/symmetrized", AT(info.certificate.symmetrized), I32, 1, "1",
     "1: C_TT was replaced by (C + C^T)/2"},
    {"/certificate/reciprocity", AT(info.certificate.reciprocity), F64, 1, "1",
     "||C - C^T||_F / ||C||_F before symmetrizing"},
    {"/certificate/force_change", AT(info.certificate.force_change), F64, 1, "1",
     "worst relative change of a sampled force by symmetrizing"},
    {"/certificate/min_eigenvalue", AT(info.certificate.min_eigenvalue), F64, 1, "m/N",
     "of the stored symmetric part"},
    {"/certificate/max_eigenvalue", AT(info.certificate.max_eigenvalue), F64, 1, "m/N",
     "of the stored symmetric part"},
    {"/certificate/min_eigenvalue_ratio", AT(info.certificate.min_eigenvalue_ratio), F64, 1, "1",
     "smallest / largest eigenvalue of the symmetric part"},
    {"/certificate/solve_residual", AT(info.certificate.solve_residual), F64, 1, "1",
     "worst ||K u - f|| / ||f|| over sampled columns"},
    {"/certificate/rcond", AT(info.certificate.rcond), F64, 1, "1", "of the equilibrated system"},
    {"/certificate/force_balance", AT(info.certificate.force_balance), F64, 1, "1",
     "worst |support + applied force| / |force|; negative: not computed"},
    {"/certificate/mls_worst_condition", AT(info.certificate.mls_worst_condition), F64, 1, "1",
     "worst scaled stencil condition"},
    {"/certificate/mls_worst_point", AT(info.certificate.mls_worst_point), F64, 3, "m", "where"},
    {"/certificate/mls_grown", AT(info.certificate.mls_grown), I32, 1, "1",
     "stencils that had to grow"},
    {"/certificate/estimated_error", AT(info.certificate.estimated_error), F64, 1, "1",
     "estimated relative error of the force; negative: not estimated"},
    {"/certificate/loop_energy_raw", AT(info.certificate.loop_energy_raw), F64, 1, "1",
     "worst energy returned per closed tool loop / stored energy, raw block"},
    {"/certificate/loop_energy", AT(info.certificate.loop_energy), F64, 1, "1",
     "the same, stored block"},
    {"/certificate/reason", AT(info.certificate.reason), PALPATE_FIELD_TEXT,
     PALPATE_MEMBER_SIZE(pal_certificate, reason), NULL,
     "why it fails and the remedy; empty when it passes"},

    {"/compliance/row_scale", AT(row_scale), F64, 1, "1", "c_st times this is in m/N"},

    {"/runtime/tool_count", AT(runtime.tool_count), I32, 1, "1", "tools"},
    {"/runtime/servo_rate", AT(runtime.servo_rate), F64, 1, "Hz", "servo rate"},
    {"/runtime/render_rate", AT(runtime.render_rate), F64, 1, "Hz", "render rate"},
    {"/runtime/max_contacts", AT(runtime.max_contacts), I32, 1, "1",
     "contact points an engine keeps"},
};

/// Added since version 1: a file without them holds the default, 0.
static const pal_field added_fields[] = {
    {"/info/field_error", AT(info.field_error), F64, 1, "1",
     "displacement error of the stored rows over sampled contacts, relative to the largest"},
    {"/info/field_tolerance", AT(info.field_tolerance), F64, 1, "1", "asked for; 0: none"},
    {"/info/field_us", AT(info.field_us), F64, 1, "us",
     "predicted time of a field, 45 nodes touched"},
    {"/info/warnings", AT(info.warnings), PALPATE_FIELD_TEXT,
     PALPATE_MEMBER_SIZE(pal_model_info, warnings), NULL,
     "what building it warned of, a line each"},
    {"/runtime/field_by", AT(runtime.field_by), I32, 1, "1",
     "who computes the displacement field: 0 servo, 1 reader"},
    {"/runtime/watchdog_stale", AT(runtime.watchdog.stale), F64, 1, "s", "0: the default"},
    {"/runtime/watchdog_stall", AT(runtime.watchdog.stall), F64, 1, "s", "0: the default"},
    {"/runtime/watchdog_latch", AT(runtime.watchdog.latch), F64, 1, "s", "0: the default"},
    {"/runtime/watchdog_speed", AT(runtime.watchdog.speed), F64, 1, "m/s", "0: the default"},
    {"/runtime/watchdog_ramp_down", AT(runtime.watchdog.ramp_down), F64, 1, "s", "0: the default"},
    {"/runtime/watchdog_ramp_up", AT(runtime.watchdog.ramp_up), F64, 1, "s", "0: the default"},
    {"/runtime/contact_law", AT(runtime.contact_law), I32, 1, "1",
     "contact law: 0 anywhere on the surface, 1 nodes"},
    {"/runtime/contact_points", AT(runtime.contact_points), I32, 1, "1",
     "contact points of one tool; 0: the engine's default"},
};

#undef AT
#define AT(member) offsetof(pal_tool_def, member)
#define SIZE(member) PALPATE_MEMBER_SIZE(pal_tool_def, member)

static const pal_field tool_fields[] = {
    {"name", AT(name), PALPATE_FIELD_TEXT, SIZE(name), NULL, "name in the scene"},
    {"shape", AT(shape), I32, 1, "1", "0 point, 1 sphere, 2 capsule"},
    {"radius", AT(radius), F64, 1, "m", "of sphere and capsule"},
    {"length", AT(length), F64, 1, "m", "of the capsule's segment"},
    {"friction", AT(friction), F64, 1, "1", "Coulomb coefficient"},
    {"coupling_stiffness", AT(coupling_stiffness), F64, 1, "N/m", "virtual coupling; 0: rigid"},
    {"coupling_damping", AT(coupling_damping), F64, 1, "N s/m", "virtual coupling"},
    {"limit_force", AT(limits.force), F64, 1, "N", "cap of the force"},
    {"limit_slew", AT(limits.slew), F64, 1, "N/ms", "cap of its rate"},
    {"limit_torque", AT(limits.torque), F64, 1, "N m", "cap of the torque"},
    {"start", AT(start), F64, 3, "m", "tool origin when it just touches"},
    {"axis", AT(axis), F64, 3, "1", "pressing direction"},
    {"has_start", AT(has_start), I32, 1, "1", "1: the scene gave start"},
    {"device", AT(device.kind), I32, 1, "1", "0 none, 1 null, 2 replay, 3 scripted, 4 simulated"},
    {"path", AT(device.path), PALPATE_FIELD_TEXT, SIZE(device.path), NULL,
     "trajectory of a replay, absolute"},
    {"stroke", AT(device.stroke.kind), I32, 1, "1", "0 press, 1 slide, 2 circle, 3 palpation"},
    {"depth", AT(device.stroke.depth), F64, 1, "m", "stroke: depth"},
    {"ramp", AT(device.stroke.ramp), F64, 1, "s", "stroke: time of approach"},
    {"period", AT(device.stroke.period), F64, 1, "s", "stroke: period"},
    {"amplitude", AT(device.stroke.amplitude), F64, 1, "m", "stroke: half travel or radius"},
    {"direction", AT(device.stroke.direction), F64, 3, "1", "stroke: slide direction"},
    {"tremor_amplitude", AT(device.stroke.tremor_amplitude), F64, 1, "m", "stroke: tremor"},
    {"tremor_frequency", AT(device.stroke.tremor_frequency), F64, 1, "Hz", "stroke: tremor"},
};

/// Added since version 1, as above.
static const pal_field added_tool_fields[] = {
    {"simulated_model", AT(device.simulated.model), I32, 1, "1", "0 touch, 1 premium"},
    {"simulated_grip", AT(device.simulated.grip), I32, 1, "1", "0 firm, 1 light, 2 none"},
    {"simulated", AT(device.simulated.mass), F64, 14, "SI",
     "simulated device: mass, damping, friction, resolution, force, stiffness, reach; hand: mass, "
     "damping, stiffness; push, kick, release, grasp"},
    {"spec_name", AT(spec.name), PALPATE_FIELD_TEXT, SIZE(spec.name), NULL, "what device it is"},
    {"spec_max_force", AT(spec.max_force), F64, 1, "N", "what it bears; 0: unknown"},
    {"spec_max_torque", AT(spec.max_torque), F64, 1, "N m", "0: unknown"},
    {"spec_max_stiffness", AT(spec.max_stiffness), F64, 1, "N/m", "of a coupling; 0: unknown"},
    {"spec_max_damping", AT(spec.max_damping), F64, 1, "N s/m", "of a coupling; 0: unknown"},
    {"spec_max_speed", AT(spec.max_speed), F64, 1, "m/s", "0: unknown"},
    {"spec_damping", AT(spec.damping), F64, 1, "N s/m", "its own"},
    {"spec_resolution", AT(spec.resolution), F64, 1, "m", "of its position"},
};

#define LIST(table)                                                                                \
    { table, sizeof table / sizeof *table }
const pal_field_list pal_model_fields = LIST(model_fields);
const pal_field_list pal_model_fields_added = LIST(added_fields);
const pal_field_list pal_tool_fields = LIST(tool_fields);
const pal_field_list pal_tool_fields_added = LIST(added_tool_fields);
