/// @file model.h  The precomputed model: compliance, nodes, certificate; immutable once made.
///
/// A model is built by the offline library (precompute.h) or loaded from a file. All functions
/// taking `const pal_model *` are safe from any thread at once.
#ifndef PALPATE_MODEL_H
#define PALPATE_MODEL_H

#include <stddef.h>
#include <stdint.h>

#include <palpate/status.h>
#include <palpate/tool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef struct pal_model pal_model;

typedef enum pal_precision {
    PALPATE_PRECISION_DOUBLE = 0,
    PALPATE_PRECISION_SINGLE = 1,
    PALPATE_PRECISION_HALF = 2,
    PALPATE_PRECISION_SCALED =
        3 ///< 16-bit integers with a scale per column: a tenth of half's error
} pal_precision;

/// The model's certificate (design section 5). Ratios are dimensionless.
typedef struct pal_certificate {
    int32_t pass;          ///< 1: every gate holds
    int32_t passive;       ///< 1: stored C_TT is symmetric and positive definite
    int32_t symmetrized;   ///< 1: C_TT was replaced by (C + C^T)/2
    double reciprocity;    ///< ||C - C^T||_F / ||C||_F on the column nodes, before symmetrizing
    double force_change;   ///< worst relative change of a sampled contact force by symmetrizing
    double min_eigenvalue; ///< of the stored symmetric part [m/N]
    double max_eigenvalue; ///< [m/N]
    double min_eigenvalue_ratio; ///< min / max eigenvalue of the symmetric part
    double solve_residual;       ///< worst ||K u - f|| / ||f|| over sampled columns
    double rcond;                ///< reciprocal condition estimate of the equilibrated system
    double force_balance; ///< worst |support reaction + applied force| / |force|; negative: not
                          ///< computed
    double mls_worst_condition; ///< worst scaled stencil condition number
    double mls_worst_point[3];  ///< where [m]
    int32_t mls_grown;          ///< deficient stencils that had to grow
    double estimated_error; ///< estimated relative discretization error of the force; negative: not
                            ///< estimated
    double
        loop_energy_raw; ///< worst energy returned per closed tool loop / stored energy, raw block
    double loop_energy;  ///< the same for the stored block
    char reason[512];    ///< why it fails and the remedy; "" when it passes
} pal_certificate;

/// Seconds spent in each offline stage.
typedef struct pal_offline_seconds {
    double cloud, assemble, factor, solve, certify, total;
} pal_offline_seconds;

/// Plain facts about a model.
typedef struct pal_model_info {
    int32_t node_count;
    int32_t surface_count;
    int32_t triangle_count;
    int32_t touchable_count; ///< nodes a tool may touch
    int32_t column_count;    ///< nodes with compliance columns: touchable and patch nodes
    int32_t row_count;       ///< nodes whose displacement is stored
    int32_t fixed_count;
    int32_t patch_count;
    int32_t probe_count;
    int32_t skin_count;      ///< vertices of pal_model_skin: render mesh, else the surface nodes
    pal_precision precision; ///< of the stored rows
    uint64_t bytes;          ///< of the compliance blocks in memory
    uint64_t peak_bytes;     ///< peak resident memory of the offline stage
    // the displacement field of a contact of 45 nodes, over sampled contacts; 0: not measured
    double field_error;     ///< worst max |du| / max |u| by the form the rows are stored in
    double field_tolerance; ///< asked for; 0: the rows are stored as store.precision says
    double field_us;        ///< predicted time of one field on the machine of bench/results [us]
    uint64_t row_bytes;     ///< of the stored rows in memory, part of `bytes`
    int32_t row_clusters;   ///< clusters of rows with a basis each; 0: every row is stored
    int32_t row_rank;       ///< sum of the bases' ranks, instead of 3 row_count rows
    double spacing_min, spacing_mean, spacing_max; ///< [m]
    double young;                                  ///< [Pa]
    double poisson;
    double density;                      ///< [kg/m^3]
    double volume;                       ///< of the body [m^3]
    double bounds_min[3], bounds_max[3]; ///< of the rest shape [m]
    char method[32];                     ///< "point", "cell", "galerkin", ...
    char method_options[256];            ///< the options in effect, "key=value, ..."
    char hash[65];                       ///< content hash of all that determines the model, hex
    char provenance[512];                ///< program version, compiler, libraries, host
    char warnings[2048];                 ///< what building it warned of, a line each; "": nothing
    pal_offline_seconds seconds;
    pal_certificate certificate;
} pal_model_info;

/// Load a model file into memory. The whole-file checksum is verified before HDF5 parses anything.
/// @return PALPATE_OK; _IO, _FORMAT, _VERSION, _TRUNCATED, _CHECKSUM, _MEMORY (nothing is returned)
PALPATE_API pal_status pal_model_load(const char *path, pal_model **out, pal_error *error);

/// pal_model_load, refusing a model whose content hash is not `hash` (hex, as pal_scene_hash gives
/// it).
/// @return as pal_model_load; PALPATE_STALE when the file is whole but of another scene (*out is
/// NULL)
PALPATE_API pal_status pal_model_load_expect(const char *path, const char *hash, pal_model **out,
                                             pal_error *error);

/// Write a model: to a temporary file in the same directory, fsync, then renamed over `path`.
/// On failure nothing is left behind and an older file at `path` is untouched.
/// @return PALPATE_OK; _IO (no space, no permission, ...), _ARGUMENT (not a valid model), _MEMORY
PALPATE_API pal_status pal_model_save(const pal_model *model, const char *path, pal_error *error);

/// Free a model; NULL is allowed. No engine may still use it.
PALPATE_API void pal_model_free(pal_model *model);

PALPATE_API void pal_model_get_info(const pal_model *model, pal_model_info *out);

/// The tools and rates stored with the model.
PALPATE_API const pal_runtime_config *pal_model_runtime(const pal_model *model);

/// Rest positions [m], shape [node_count, 3]; surface nodes come first.
PALPATE_API const double *pal_model_positions(const pal_model *model);
/// Outward unit normals of the rest surface, shape [surface_count, 3].
PALPATE_API const double *pal_model_normals(const pal_model *model);
/// Surface triangles, outward counter-clockwise, shape [triangle_count, 3], indices of surface
/// nodes.
PALPATE_API const int32_t *pal_model_triangles(const pal_model *model);
/// Nodes whose displacement is stored, ascending, shape [row_count].
PALPATE_API const int32_t *pal_model_rows(const pal_model *model);
/// Nodes with compliance columns, ascending, shape [column_count].
PALPATE_API const int32_t *pal_model_columns(const pal_model *model);
/// The stored compliance of the column nodes C_TT [m/N], shape [3 column_count, 3 column_count],
/// column-major: column 3j+c is the displacement under a unit force in direction c at column node
/// j.
PALPATE_API const double *pal_model_compliance(const pal_model *model);

/// Patch `index`'s name and its nodes as indices into pal_model_columns().
PALPATE_API const char *pal_model_patch(const pal_model *model, int32_t index,
                                        const int32_t **columns, int32_t *count);
/// Probe `index`'s name and rest position [m].
PALPATE_API const char *pal_model_probe(const pal_model *model, int32_t index, double position[3]);

/// Bonded press: all nodes of a patch displaced by the same vector (paper 1, Eqs. 52-53, statics).
typedef struct pal_press {
    int32_t patch_nodes;
    double force[3];    ///< the tool's force on the body [N]
    double moment[3];   ///< about the mean rest position of the patch's nodes [N m]
    double center[3];   ///< that mean position [m]
    double *node_force; ///< force on each patch node, shape [patch_nodes, 3]; owned
    double *probe;      ///< displacement of each probe, shape [probe_count, 3]; owned
    double *
        displacement; ///< of the stored rows, shape [row_count, 3]; owned; NULL when row_count is 0
} pal_press;

/// Press a patch by a vector.
/// @param patch  a name from the scene
/// @param by     displacement of every node of the patch [m]
/// @return PALPATE_OK; _NOT_FOUND (the message lists the names), _SINGULAR, _MEMORY
/// Cost: O(m^3 + m (rows + probes)). Source: De, Hong, Bathe 2003, Eqs. 52-53.
PALPATE_API pal_status pal_model_press(const pal_model *model, const char *patch,
                                       const double by[3], pal_press *out, pal_error *error);
PALPATE_API void pal_press_clear(pal_press *press);

/// Contact law of a pressed tool.
typedef enum pal_indent_law {
    PALPATE_INDENT_REST =
        0, ///< linearised about the rest shape: contact along the tool's axis (Hertz)
    PALPATE_INDENT_FULL = 1 ///< on the deformed shape: contact along the tool's surface normals
} pal_indent_law;

/// One depth of an indentation.
typedef struct pal_indent_result {
    double depth;           ///< travel of the tool from its `start` along its axis [m]
    double force;           ///< magnitude of the tool's force on the body [N]
    double force_vector[3]; ///< that force [N]
    double radius; ///< of the circle with the area of contact seen along the axis [m]; 0: below one
                   ///< node
    int32_t contacts;   ///< places that carry force
    int32_t iterations; ///< of the complementarity solver
    int32_t cut_off;    ///< 1: the solver was stopped early; the force is that of its best iterate
} pal_indent_result;

/// Press a rigid, frictionless tool along its axis by given depths, from its `start`; its own axis
/// (local -z) points along `axis`. Contact is unilateral at the touchable nodes, and for a tip
/// under which no node lies at the point of the surface on its axis. Small-strain response, no
/// dynamics.
/// @param tool    needs has_start and axis; device, coupling, friction and limits are not used
/// @param depths  >= 0 [m], shape [count], any order
/// @param[out] out  shape [count]
/// @return PALPATE_OK; _ARGUMENT (no start, nothing touchable under the tool, a bad depth),
///         _UNSUPPORTED (a point with the full law), _MEMORY
/// Cost: O(k^3) per depth for k touched nodes. Source: Aras et al. 2014, section 3; indent.c.
PALPATE_API pal_status pal_model_indent(const pal_model *model, const pal_tool_def *tool,
                                        pal_indent_law law, const double *depths, int32_t count,
                                        pal_indent_result *out, pal_error *error);

#ifdef __cplusplus
}
#endif
#endif
