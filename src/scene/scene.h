/// @file scene.h  The scene in memory, after loading and checking (private to the offline library).
#ifndef PALPATE_SRC_SCENE_H
#define PALPATE_SRC_SCENE_H

#include <stdint.h>

#include <palpate/model.h>
#include <palpate/scene.h>
#include <palpate/tool.h>

#include "src/discretization/discretization.h"

typedef enum pal_geometry_kind {
    PALPATE_GEOMETRY_BOX,
    PALPATE_GEOMETRY_SPHERE,
    PALPATE_GEOMETRY_HEMISPHERE,
    PALPATE_GEOMETRY_FILE
} pal_geometry_kind;

/// Where a value stands in the scene, for located errors after loading. "file:line:column: key".
typedef struct pal_place {
    int32_t line, column; ///< 1-based; 0: given by --set or by default
    int32_t set;          ///< k: given by override k-1 (--set); 0: by the file or by default
    char key[128];        ///< dotted path, e.g. "body.patches.pole"
} pal_place;

typedef struct pal_geometry {
    pal_geometry_kind kind;
    double size[3];   ///< box [m]
    double center[3]; ///< box and sphere [m]; default 0
    double radius;    ///< sphere, hemisphere [m]
    char path[1024];  ///< file: absolute
    double scale;     ///< metres per file unit
    pal_place place;
} pal_geometry;

typedef enum pal_selector_kind {
    PALPATE_SELECT_ALL,
    PALPATE_SELECT_BALL,
    PALPATE_SELECT_BOX,
    PALPATE_SELECT_BELOW,
    PALPATE_SELECT_ABOVE
} pal_selector_kind;

/// A selector on surface nodes of the rest shape; inclusive with a tolerance of 1e-6 body sizes.
typedef struct pal_selector {
    pal_selector_kind kind;
    double center[3], radius; ///< ball
    double low[3], high[3];   ///< box
    int32_t axis;             ///< below/above: 0, 1, 2
    double value;             ///< below/above
    pal_place place;
} pal_selector;

typedef struct pal_selector_list {
    int32_t count;
    pal_selector *item;
} pal_selector_list;

typedef struct pal_scene_patch {
    char name[PALPATE_NAME_MAX];
    pal_selector_list where;
    double
        rim_spacing; ///< [m]; -f: f times the automatic one (1/14 of the patch's radius); 0: no rim
    pal_place place;
} pal_scene_patch;

typedef enum pal_refine_kind { PALPATE_REFINE_BALL, PALPATE_REFINE_RIM } pal_refine_kind;
typedef struct pal_refine {
    pal_refine_kind kind;
    double center[3], radius;   ///< ball
    char rim[PALPATE_NAME_MAX]; ///< rim: patch name
    double spacing;             ///< [m]
    pal_place place;
} pal_refine;

typedef struct pal_scene_probe {
    char name[PALPATE_NAME_MAX];
    double position[3]; ///< [m]
    pal_place place;
} pal_scene_probe;

/// The mesh that a host draws; an empty path: none given.
typedef struct pal_scene_skin {
    char path[1024]; ///< absolute
    double scale;    ///< metres per file unit
    pal_place place;
} pal_scene_skin;

typedef enum pal_store_rows {
    PALPATE_STORE_NONE,
    PALPATE_STORE_SURFACE,
    PALPATE_STORE_ALL
} pal_store_rows;

struct pal_scene {
    char path[1024];  ///< scene file, absolute
    char shown[1024]; ///< scene file as the caller named it, for messages
    int32_t override_count;
    char **override; ///< the --set texts, for messages
    int32_t version; ///< of the scene format
    pal_geometry geometry;
    double spacing; ///< [m]
    pal_place spacing_place;
    int32_t refine_count;
    double grading; ///< growth of the spacing per unit distance from a refined zone
    pal_refine *refine;
    double young, poisson, density;
    pal_place young_place, poisson_place;
    pal_selector_list fixed;
    pal_place fixed_place;
    pal_selector_list touchable;
    pal_place touchable_place;
    int32_t patch_count;
    pal_scene_patch *patch;
    int32_t probe_count;
    pal_scene_probe *probe;
    pal_method method;
    pal_place method_place;
    int32_t symmetrize;   ///< repair: 1 symmetrize, 0 none, 2 positive
    int32_t estimate;     ///< 1: estimate the discretization error by a second, coarser cloud
    int32_t certify_warn; ///< certify: warn -> 1 (write a model that fails), strict -> 0
    pal_store_rows store_rows;
    pal_precision precision;
    double store_tolerance; ///< 0: none
    pal_scene_skin skin;
    pal_runtime_config runtime;
    char *canonical; ///< canonical text of the physics part with all defaults (hashed)
    int32_t warning_count;
    char **warning;
};

/// Format "file:line:column: key" of a place into `out`; "--set path=value: key" for an override,
/// and only the file when the value is a default or place is NULL. @return out
char *pal_place_text(const pal_scene *scene, const pal_place *place, char *out, size_t size);

/// Add a warning to the scene (located; place NULL: about the scene as a whole). Returns PALPATE_OK
/// or _MEMORY.
pal_status pal_scene_warn(pal_scene *scene, const pal_place *place, const char *format, ...)
    __attribute__((format(printf, 3, 4)));

/// 1 when a point (physical coordinates [m]) is selected by any selector of the list.
/// @param body_size  largest extent of the body's bounding box [m]; the tolerance is 1e-6 of it
int pal_select(const pal_selector_list *list, const double x[3], double body_size);

/// How far a point lies outside the nearest selector of the list [m]; 0: inside one.
double pal_select_distance(const pal_selector_list *list, const double x[3]);

/// The mesh to draw, vertices as its file numbers them (skin.h).
typedef struct pal_skin_source {
    int32_t vertex_count, triangle_count;
    double *position;  ///< (vertex_count x 3) [m], physical
    int32_t *triangle; ///< (triangle_count x 3)
    int32_t *twin;     ///< (vertex_count) one vertex for all at the same place
} pal_skin_source;

/// Build the node cloud of a scene (geometry.c, cloud_build.c; starts the mesher process).
/// @param[out] skin  may be NULL; freed with pal_skin_clear
pal_status pal_cloud_build(pal_scene *scene, const pal_progress *progress, pal_cloud *cloud,
                           pal_skin_source *skin, pal_error *error);

#endif
