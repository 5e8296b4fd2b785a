/// @file model_file.c  The one model file format: reader and writer from one description.
///
/// A sealed HDF5 file (file_header.h): the checksum gate comes first, then every dataset is read
/// with the type and dimensions the counts ask for, then pal_model_check looks at every index and
/// number. Reader and writer walk the same tables and the same functions (`transfer` knows the
/// direction), so they cannot drift apart. Numbers keep their bits: doubles as doubles, the stored
/// rows in their own precision. Content:
///
///     /info /certificate /seconds      scalars of pal_model_info
///     /nodes /compliance /patches/N /probes/N /skin
///     /runtime /runtime/tools/N        so that `palpate run MODEL` needs nothing else
///     /scene                           the canonical scene text (optional)
///
/// Nothing allocated exceeds the file's own size. Thread: any.
#include <stddef.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/model/file_header.h"
#include "haptic/model/h5.h"
#include "haptic/model/model.h"
#include "haptic/model/model_fields.h"

// ---- One walk for both directions ---------------------------------------------------------------

typedef struct transfer {
    pal_h5 *file;
    int reading;
    size_t limit; ///< reading: bytes of the file; nothing larger is allocated
    pal_error *error;
} transfer;

#define TRY(call)                                                                                  \
    do {                                                                                           \
        pal_status try_status = (call);                                                            \
        if (try_status != PALPATE_OK) {                                                            \
            return try_status;                                                                     \
        }                                                                                          \
    } while (0)

static pal_status transfer_fields(const transfer *t, const char *prefix, const pal_field *fields,
                                  size_t count, void *base) {
    for (size_t i = 0; i < count; i++) {
        const pal_field *f = &fields[i];
        char path[PALPATE_H5_PATH_MAX];
        (void)snprintf(path, sizeof path, "%s%s", prefix, f->path);
        void *at = (char *)base + f->offset;
        int rank = f->count > 1 ? 1 : 0;
        int64_t dims[1] = {f->count};
        if (f->type == PALPATE_FIELD_TEXT) {
            TRY(t->reading ? pal_h5_read_text(t->file, path, at, (size_t)f->count, t->error)
                           : pal_h5_write_text(t->file, path, at, f->description, t->error));
        } else if (t->reading) {
            TRY(pal_h5_read(t->file, path, (pal_h5_type)f->type, rank, dims, at, t->error));
        } else {
            TRY(pal_h5_write(t->file, path, (pal_h5_type)f->type, rank, dims, at, f->unit,
                             f->description, t->error));
        }
    }
    return PALPATE_OK;
}

static pal_status transfer_list(const transfer *t, const char *prefix, const pal_field_list *list,
                                void *base) {
    return transfer_fields(t, prefix, list->field, list->count, base);
}

/// Room for rows x columns elements, when the file can hold that many.
static pal_status allocate(const transfer *t, const char *path, int64_t rows, int64_t columns,
                           size_t element, void **out) {
    size_t bytes;
    if (rows < 0 || columns < 0 || __builtin_mul_overflow((size_t)rows, (size_t)columns, &bytes) ||
        __builtin_mul_overflow(bytes, element, &bytes) || bytes > t->limit) {
        return pal_fail(t->error, PALPATE_ERROR_FORMAT,
                        "%s: %lld x %lld entries do not fit the file", path, (long long)rows,
                        (long long)columns);
    }
    *out = malloc(bytes + 1); // never NULL for nothing
    if (*out == NULL) {
        return pal_fail(t->error, PALPATE_ERROR_MEMORY, "%s: no memory for %zu bytes", path, bytes);
    }
    return PALPATE_OK;
}

/// A packed array (rows x columns); columns 0 makes it a vector. Reading allocates *data.
static pal_status transfer_array(const transfer *t, const char *path, pal_h5_type type,
                                 int64_t rows, int64_t columns, void **data, const char *unit,
                                 const char *description) {
    int64_t dims[2] = {rows, columns};
    int rank = columns > 0 ? 2 : 1;
    if (!t->reading) {
        return pal_h5_write(t->file, path, type, rank, dims, *data, unit, description, t->error);
    }
    TRY(allocate(t, path, rows, columns > 0 ? columns : 1, pal_h5_type_size(type), data));
    return pal_h5_read(t->file, path, type, rank, dims, *data, t->error);
}

/// `pointer` is any array member; its address travels as void **, copied in and out by memcpy.
#define ARRAY(path, type, rows, columns, pointer, unit, description)                               \
    do {                                                                                           \
        void *array_;                                                                              \
        memcpy(&array_, &(pointer), sizeof array_);                                                \
        pal_status array_status =                                                                  \
            transfer_array(t, path, type, rows, columns, &array_, unit, description);              \
        if (t->reading) {                                                                          \
            memcpy(&(pointer), &array_, sizeof array_);                                            \
        }                                                                                          \
        if (array_status != PALPATE_OK) {                                                          \
            return array_status;                                                                   \
        }                                                                                          \
    } while (0)

/// Counts size everything that follows; read ones are checked before they are used.
static pal_status check_counts(const transfer *t, const pal_model *model) {
    const pal_model_info *i = &model->info;
    int32_t counts[] = {i->node_count, i->surface_count, i->triangle_count, i->column_count,
                        i->row_count,  i->patch_count,   i->probe_count,    i->skin_count};
    for (size_t k = 0; k < sizeof counts / sizeof *counts; k++) {
        if (counts[k] < 0 || counts[k] > PALPATE_COUNT_MAX) {
            return pal_fail(t->error, PALPATE_ERROR_FORMAT, "/info: count %d is out of range",
                            (int)counts[k]);
        }
    }
    if (model->runtime.tool_count < 0 || model->runtime.tool_count > PALPATE_TOOLS_MAX) {
        return pal_fail(t->error, PALPATE_ERROR_FORMAT,
                        "/runtime/tool_count is %d, must be 0 to %d",
                        (int)model->runtime.tool_count, PALPATE_TOOLS_MAX);
    }
    if (pal_precision_size(i->precision) == 0) {
        return pal_fail(t->error, PALPATE_ERROR_FORMAT, "/info/precision is %d, must be 0 to 3",
                        (int)i->precision);
    }
    return PALPATE_OK;
}

static pal_status transfer_nodes(const transfer *t, pal_model *model) {
    const pal_model_info *i = &model->info;
    ARRAY("/nodes/position", PALPATE_H5_F64, i->node_count, 3, model->position, "m",
          "rest positions; surface nodes first");
    ARRAY("/nodes/flags", PALPATE_H5_U8, i->node_count, 0, model->node_flags, "1",
          "bit 0: fixed, bit 1: touchable");
    ARRAY("/nodes/normal", PALPATE_H5_F64, i->surface_count, 3, model->normal, "1",
          "outward unit normals of the surface nodes");
    ARRAY("/nodes/area_vector", PALPATE_H5_F64, i->surface_count, 3, model->area_vector, "m^2",
          "tributary area vectors of the surface nodes");
    ARRAY("/nodes/triangle", PALPATE_H5_I32, i->triangle_count, 3, model->triangle, "1",
          "surface triangles, outward counter-clockwise, indices of surface nodes");
    return PALPATE_OK;
}

static pal_h5_type row_type(pal_precision precision) {
    return precision == PALPATE_PRECISION_DOUBLE   ? PALPATE_H5_F64
           : precision == PALPATE_PRECISION_SINGLE ? PALPATE_H5_F32
           : precision == PALPATE_PRECISION_SCALED ? PALPATE_H5_I16
                                                   : PALPATE_H5_F16;
}

/// Integers of 16 bits in one run; reading fills what pal_row_bases_alloc made.
static pal_status transfer_integers(const transfer *t, const char *path, int64_t count,
                                    int16_t *data, const char *description) {
    int64_t dims[1] = {count};
    return t->reading ? pal_h5_read(t->file, path, PALPATE_H5_I16, 1, dims, data, t->error)
                      : pal_h5_write(t->file, path, PALPATE_H5_I16, 1, dims, data, "1", description,
                                     t->error);
}

static pal_status transfer_scales(const transfer *t, const char *path, int64_t count, float *data,
                                  const char *unit, const char *description) {
    int64_t dims[1] = {count};
    return t->reading ? pal_h5_read(t->file, path, PALPATE_H5_F32, 1, dims, data, t->error)
                      : pal_h5_write(t->file, path, PALPATE_H5_F32, 1, dims, data, unit,
                                     description, t->error);
}

/// Compressed rows: /rows is there for them alone. Every count is checked before it sizes anything.
static pal_status transfer_bases(const transfer *t, pal_model *model) {
    static const pal_field fields[] = {
        {"/rows/cluster_count", offsetof(pal_row_bases, cluster_count), PALPATE_H5_I32, 1, "1",
         "clusters of rows"},
        {"/rows/group_count", offsetof(pal_row_bases, group_count), PALPATE_H5_I32, 1, "1",
         "groups of columns"},
        {"/rows/pair_count", offsetof(pal_row_bases, pair_count), PALPATE_H5_I32, 1, "1",
         "near pairs of both"},
        {"/rows/rank", offsetof(pal_row_bases, rank), PALPATE_H5_I32, 1, "1",
         "rows of c_st: all clusters' ranks"},
    };
    const pal_model_info *i = &model->info;
    if (t->reading ? !pal_h5_has(t->file, "/rows/rank") : model->bases == NULL) {
        return PALPATE_OK;
    }
    if (t->reading) {
        model->bases = calloc(1, sizeof *model->bases);
        if (model->bases == NULL) {
            return pal_fail(t->error, PALPATE_ERROR_MEMORY, "/rows: no memory");
        }
    }
    pal_row_bases *b = model->bases;
    TRY(transfer_fields(t, "", fields, sizeof fields / sizeof *fields, b));
    const int32_t count[] = {b->cluster_count, b->group_count, b->pair_count, b->rank};
    for (size_t k = 0; k < sizeof count / sizeof *count; k++) {
        if (count[k] < 0 || count[k] > PALPATE_COUNT_MAX) {
            return pal_fail(t->error, PALPATE_ERROR_FORMAT, "%s is %d, out of range",
                            fields[k].path, (int)count[k]);
        }
    }
    ARRAY("/rows/cluster_start", PALPATE_H5_I32, (int64_t)b->cluster_count + 1, 0, b->cluster_start,
          "1", "first position of each cluster in row_order");
    ARRAY("/rows/row_order", PALPATE_H5_I32, i->row_count, 0, b->row_order, "1",
          "row at each position");
    ARRAY("/rows/rank_start", PALPATE_H5_I32, (int64_t)b->cluster_count + 1, 0, b->rank_start, "1",
          "first row of c_st of each cluster");
    ARRAY("/rows/group_start", PALPATE_H5_I32, (int64_t)b->group_count + 1, 0, b->group_start, "1",
          "first position of each group in column_order");
    ARRAY("/rows/column_order", PALPATE_H5_I32, i->column_count, 0, b->column_order, "1",
          "column at each position");
    ARRAY("/rows/pair_start", PALPATE_H5_I32, (int64_t)b->group_count + 1, 0, b->pair_start, "1",
          "first near pair of each group");
    ARRAY("/rows/pair_cluster", PALPATE_H5_I32, b->pair_count, 0, b->pair_cluster, "1",
          "cluster of each near pair");
    if (t->reading) {
        pal_status status = pal_row_bases_derive(b, i->row_count, i->column_count, t->error);
        if (status != PALPATE_OK) {
            if (status != PALPATE_ERROR_MEMORY && t->error != NULL) {
                t->error->status = PALPATE_ERROR_FORMAT;
            }
            return status == PALPATE_ERROR_MEMORY ? status : PALPATE_ERROR_FORMAT;
        }
        int64_t all = b->basis_start[b->cluster_count] + b->near_start[b->pair_count];
        if (all > (int64_t)t->limit / 2) {
            return pal_fail(t->error, PALPATE_ERROR_FORMAT,
                            "/rows: %lld entries of bases and near pairs do not fit the file",
                            (long long)all);
        }
        TRY(pal_row_bases_alloc(b, t->error));
    }
    TRY(transfer_integers(t, "/rows/basis", b->basis_start[b->cluster_count], b->basis,
                          "bases U, cluster by cluster, column by column, rows padded to 32"));
    TRY(transfer_scales(t, "/rows/basis_scale", b->rank, b->basis_scale, "1",
                        "column k of all bases times this is orthonormal"));
    TRY(transfer_integers(
        t, "/rows/near", b->near_start[b->pair_count], b->near,
        "what U c_st leaves of C in the near pairs, pair by pair, column by column"));
    return transfer_scales(t, "/rows/near_scale", b->near_scale_start[b->pair_count], b->near_scale,
                           "m/N", "column of a near pair times this is in m/N");
}

static pal_status transfer_rows(const transfer *t, pal_model *model) {
    static const char path[] = "/compliance/c_st", scales[] = "/compliance/column_scale";
    const pal_model_info *i = &model->info;
    int64_t dims[2] = {3 * (int64_t)i->column_count, pal_model_block_rows(model)};
    pal_h5_type type = row_type(i->precision);
    if (t->reading) {
        double scale = model->row_scale;
        size_t bytes;
        if (__builtin_mul_overflow((size_t)dims[0], (size_t)dims[1], &bytes) ||
            __builtin_mul_overflow(bytes, pal_h5_type_size(type), &bytes) || bytes > t->limit) {
            return pal_fail(t->error, PALPATE_ERROR_FORMAT,
                            "%s: %lld x %lld entries do not fit the file", path, (long long)dims[0],
                            (long long)dims[1]);
        }
        TRY(pal_model_alloc_rows(model, t->error));
        model->row_scale = scale;
        if (model->column_scale != NULL) {
            TRY(pal_h5_read(t->file, scales, PALPATE_H5_F64, 1, dims, model->column_scale,
                            t->error));
        }
        return pal_h5_read_rows(t->file, path, type, 2, dims, 0, dims[0], model->row_ld,
                                model->c_st, t->error);
    }
    TRY(pal_h5_declare(
        t->file, path, type, 2, dims, "m/N / row_scale",
        model->bases != NULL
            ? "coefficients S: entry (j, i) belongs to column i of the bases in /rows; C_ST = U S "
              "+ near"
            : "compliance C_ST: entry (j, i) is the displacement of row dof i under a unit force "
              "in "
              "column dof j; dof 3k + c: node k of row_node or column_node, direction c",
        t->error));
    if (dims[0] == 0 || dims[1] == 0) {
        return PALPATE_OK;
    }
    if (model->column_scale != NULL) {
        TRY(pal_h5_write(t->file, scales, PALPATE_H5_F64, 1, dims, model->column_scale, "1",
                         "column j of c_st times row_scale times this is in m/N", t->error));
    }
    return pal_h5_write_rows(t->file, path, type, 0, dims[0], model->row_ld, model->c_st, t->error);
}

static pal_status transfer_compliance(const transfer *t, pal_model *model) {
    const pal_model_info *i = &model->info;
    int64_t n = 3 * (int64_t)i->column_count;
    ARRAY("/compliance/column_node", PALPATE_H5_I32, i->column_count, 0, model->column_node, "1",
          "node of each column triple, ascending");
    ARRAY("/compliance/row_node", PALPATE_H5_I32, i->row_count, 0, model->row_node, "1",
          "node of each stored row triple, ascending");
    if (n > 0) {
        ARRAY("/compliance/c_tt", PALPATE_H5_F64, n, n, model->c_tt, "m/N",
              "compliance of the column nodes: entry (j, i) is the displacement of dof i under a "
              "unit force "
              "in dof j; dof 3k + c: column node k, direction c");
    }
    if (n > 0 && i->probe_count > 0) {
        ARRAY("/compliance/probe_row", PALPATE_H5_F64, n, 3 * (int64_t)i->probe_count,
              model->probe_row, "m/N",
              "entry (j, 3k + c): displacement of probe k in direction c under a unit force in dof "
              "j");
    }
    TRY(transfer_bases(t, model));
    return transfer_rows(t, model);
}

static pal_status transfer_patches(const transfer *t, pal_model *model) {
    int32_t count = model->info.patch_count;
    if (t->reading) {
        void *patches;
        TRY(allocate(t, "/patches", count, 1, sizeof *model->patch, &patches));
        memset(patches, 0, (size_t)count * sizeof *model->patch);
        model->patch = patches;
    }
    for (int32_t k = 0; k < count; k++) {
        char path[PALPATE_H5_PATH_MAX];
        pal_patch *patch = &model->patch[k];
        (void)snprintf(path, sizeof path, "/patches/%d/name", (int)k);
        TRY(t->reading
                ? pal_h5_read_text(t->file, path, patch->name, sizeof patch->name, t->error)
                : pal_h5_write_text(t->file, path, patch->name, "name in the scene", t->error));
        (void)snprintf(path, sizeof path, "/patches/%d/column", (int)k);
        int64_t nodes = patch->count;
        if (t->reading) {
            TRY(pal_h5_dims(t->file, path, PALPATE_H5_I32, 1, &nodes, t->error));
            if (nodes > model->info.column_count) {
                return pal_fail(t->error, PALPATE_ERROR_FORMAT,
                                "%s: %lld nodes, the model has %d columns", path, (long long)nodes,
                                (int)model->info.column_count);
            }
            patch->count = (int32_t)nodes;
        }
        ARRAY(path, PALPATE_H5_I32, nodes, 0, patch->column, "1",
              "the patch's nodes: indices into column_node");
    }
    return PALPATE_OK;
}

static pal_status transfer_probes(const transfer *t, pal_model *model) {
    static const pal_field fields[] = {
        {"name", offsetof(pal_probe, name), PALPATE_FIELD_TEXT,
         PALPATE_MEMBER_SIZE(pal_probe, name), NULL, "name in the scene"},
        {"position", offsetof(pal_probe, position), PALPATE_H5_F64, 3, "m", "rest position"}};
    int32_t count = model->info.probe_count;
    if (t->reading) {
        void *probes;
        TRY(allocate(t, "/probes", count, 1, sizeof *model->probe, &probes));
        memset(probes, 0, (size_t)count * sizeof *model->probe);
        model->probe = probes;
    }
    for (int32_t k = 0; k < count; k++) {
        char prefix[PALPATE_H5_PATH_MAX];
        (void)snprintf(prefix, sizeof prefix, "/probes/%d/", (int)k);
        TRY(transfer_fields(t, prefix, fields, sizeof fields / sizeof *fields, &model->probe[k]));
    }
    return PALPATE_OK;
}

static pal_status transfer_skin(const transfer *t, pal_model *model) {
    static const pal_field fields[] = {{"/skin/triangle_count",
                                        offsetof(struct pal_model, skin_triangle_count),
                                        PALPATE_H5_I32, 1, "1", "triangles of the render mesh"}};
    int32_t count = model->info.skin_count;
    if (count == 0) {
        return PALPATE_OK;
    }
    TRY(transfer_fields(t, "", fields, 1, model));
    ARRAY("/skin/position", PALPATE_H5_F64, count, 3, model->skin_position, "m",
          "rest positions of the vertices");
    ARRAY("/skin/twin", PALPATE_H5_I32, count, 0, model->skin_twin, "1",
          "vertex whose normal each one shares: one for all at the same place");
    ARRAY("/skin/row", PALPATE_H5_I32, count, PALPATE_SKIN_WEIGHTS, model->skin_row, "1",
          "indices into row_node; -1: unused");
    ARRAY("/skin/weight", PALPATE_H5_F32, count, PALPATE_SKIN_WEIGHTS, model->skin_weight, "1",
          "u(vertex) = sum of weight times u(row)");
    ARRAY("/skin/triangle", PALPATE_H5_I32, model->skin_triangle_count, 3, model->skin_triangle,
          "1", "triangles, outward counter-clockwise, indices of vertices");
    return PALPATE_OK;
}

static pal_status transfer_scene(const transfer *t, pal_model *model) {
    static const char path[] = "/scene";
    if (!t->reading) {
        return model->scene_text == NULL
                   ? PALPATE_OK
                   : pal_h5_write_text(t->file, path, model->scene_text,
                                       "canonical scene with defaults", t->error);
    }
    size_t size;
    if (!pal_h5_has(t->file, path)) {
        return PALPATE_OK;
    }
    TRY(pal_h5_text_size(t->file, path, &size, t->error));
    void *text;
    TRY(allocate(t, path, (int64_t)size, 1, 1, &text));
    model->scene_text = text;
    return pal_h5_read_text(t->file, path, model->scene_text, size, t->error);
}

/// Fields that an older file may lack.
static pal_status transfer_added(const transfer *t, const char *prefix, const pal_field_list *list,
                                 void *object) {
    for (size_t k = 0; k < list->count; k++) {
        char path[PALPATE_H5_PATH_MAX];
        (void)snprintf(path, sizeof path, "%s%s", prefix, list->field[k].path);
        if (!t->reading || pal_h5_has(t->file, path)) {
            TRY(transfer_fields(t, prefix, &list->field[k], 1, object));
        }
    }
    return PALPATE_OK;
}

static pal_status transfer_model(const transfer *t, pal_model *model) {
    TRY(transfer_list(t, "", &pal_model_fields, model));
    TRY(transfer_added(t, "", &pal_model_fields_added, model));
    TRY(check_counts(t, model));
    for (int32_t k = 0; k < model->runtime.tool_count; k++) {
        char prefix[PALPATE_H5_PATH_MAX];
        pal_tool_def *tool = &model->runtime.tools[k];
        (void)snprintf(prefix, sizeof prefix, "/runtime/tools/%d/", (int)k);
        TRY(transfer_list(t, prefix, &pal_tool_fields, tool));
        TRY(transfer_added(t, prefix, &pal_tool_fields_added, tool));
    }
    TRY(transfer_nodes(t, model));
    TRY(transfer_compliance(t, model));
    TRY(transfer_patches(t, model));
    TRY(transfer_probes(t, model));
    TRY(transfer_skin(t, model));
    return transfer_scene(t, model);
}

// ---- Writing ------------------------------------------------------------------------------------

static size_t expected_size(const pal_model *model) {
    const pal_model_info *i = &model->info;
    size_t n = 3 * (size_t)i->column_count;
    return ((size_t)1 << 17) + n * n * 8 + pal_model_row_bytes(model) + 32 * (size_t)i->row_count +
           (size_t)i->node_count * 80 + (size_t)i->triangle_count * 12 +
           (size_t)i->skin_count * 100 + (size_t)model->skin_triangle_count * 12 +
           n * 24 * (size_t)i->probe_count;
}

/// The lowest version whose readers know everything in this model.
static uint32_t needed_version(const pal_model *model) {
    return model->info.precision == PALPATE_PRECISION_SCALED ? 2
                                                             : 1; // compressed rows are scaled too
}

pal_status pal_model_image(const pal_model *model, void **image, size_t *size, pal_error *error) {
    *image = NULL;
    *size = 0;
    TRY(pal_model_check(model, error));
    pal_h5 *file;
    TRY(pal_h5_create(NULL, PALPATE_USER_BLOCK, expected_size(model), &file, error));
    transfer t = {.file = file, .error = error};
    // the walk writes to the model only when reading
    pal_model *walked;
    memcpy(&walked, &model, sizeof(void *));
    pal_status status =
        pal_h5_describe(file, "/",
                        "Palpate model: precomputed compliance of a deformable body. SI units. "
                        "Documentation: README of Palpate; layout: haptic/model/model.h",
                        error);
    if (status == PALPATE_OK) {
        status = transfer_model(&t, walked);
    }
    if (status != PALPATE_OK) {
        (void)pal_h5_close(file, NULL);
        return status;
    }
    TRY(pal_h5_take_image(file, image, size, error));
    return pal_file_seal(PALPATE_FILE_MODEL, needed_version(model), *image, *size);
}

pal_status pal_model_save_mode(const pal_model *model, const char *path, unsigned mode,
                               pal_error *error) {
    if (model == NULL || path == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "save: needs a model and a path");
    }
    void *image;
    size_t size;
    pal_status status = pal_model_image(model, &image, &size, error);
    if (status != PALPATE_OK) {
        return pal_fail_prefix(error, status, "%s: cannot be written", path);
    }
    status = pal_file_save(path, image, size, mode, error);
    free(image);
    return status;
}

pal_status pal_model_save(const pal_model *model, const char *path, pal_error *error) {
    return pal_model_save_mode(model, path, 0666, error);
}

// ---- Reading ------------------------------------------------------------------------------------

pal_status pal_model_parse(const void *image, size_t size, pal_model **out, pal_error *error) {
    *out = NULL;
    pal_model *model = pal_model_new();
    if (model == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for a model");
    }
    pal_h5 *file = NULL;
    pal_status status = pal_h5_open_image(image, size, &file, error);
    if (status == PALPATE_OK) {
        transfer t = {.file = file, .reading = 1, .limit = size, .error = error};
        status = transfer_model(&t, model);
        (void)pal_h5_close(file, NULL);
    }
    if (status == PALPATE_OK && pal_model_check(model, error) != PALPATE_OK) {
        status = PALPATE_ERROR_FORMAT;
        if (error != NULL) {
            error->status = status;
        }
    }
    if (status != PALPATE_OK) {
        pal_model_free(model);
        return status;
    }
    *out = model;
    return PALPATE_OK;
}

pal_status pal_model_load(const char *path, pal_model **out, pal_error *error) {
    if (path == NULL || out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "load: needs a path and a place for the model");
    }
    *out = NULL;
    void *image;
    size_t size;
    TRY(pal_file_load(PALPATE_FILE_MODEL, PALPATE_MODEL_VERSION, path, &image, &size, error));
    pal_status status = pal_model_parse(image, size, out, error);
    free(image);
    if (status == PALPATE_ERROR_FORMAT) {
        return pal_fail_prefix(
            error, status,
            "%s: whole, but not a valid model (write it again with palpate precompute)", path);
    }
    return status == PALPATE_OK ? status : pal_fail_prefix(error, status, "%s", path);
}

pal_status pal_model_load_expect(const char *path, const char *hash, pal_model **out,
                                 pal_error *error) {
    if (hash == NULL || out == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT,
                        "load: needs the expected content hash and a place for the model");
    }
    *out = NULL;
    pal_model *model = NULL;
    pal_status status = pal_model_load(path, &model, error);
    if (model == NULL || strcmp(model->info.hash, hash) == 0) {
        *out = model;
        return status;
    }
    status = pal_fail(error, PALPATE_STALE,
                      "%s: stale: built from scene %.12s..., the scene given is %.12s...; build it "
                      "again with palpate precompute",
                      path, model->info.hash, hash);
    pal_model_free(model);
    return status;
}
