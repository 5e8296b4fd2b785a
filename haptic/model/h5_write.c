/// @file h5_write.c  Writing HDF5: groups, datasets and texts with their attributes (see h5.h).
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/model/h5_call.h"

static int write_attribute(hid_t object, const char *name, const char *text) {
    hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR), attribute = H5I_INVALID_HID;
    int ok = type >= 0 && space >= 0 && H5Tset_size(type, strlen(text) + 1) >= 0 &&
             H5Tset_cset(type, H5T_CSET_UTF8) >= 0;
    if (ok) {
        attribute = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
        ok = attribute >= 0 && H5Awrite(attribute, type, text) >= 0;
    }
    ok = pal_h5_drop(attribute) && ok;
    (void)pal_h5_drop(space);
    (void)pal_h5_drop(type);
    return ok;
}

/// Make dataset `path` of `type` on `space`, with its attributes. @return its id or negative
static hid_t make_dataset(pal_h5 *file, const char *path, hid_t type, hid_t space, const char *unit,
                          const char *description) {
    hid_t links = H5Pcreate(H5P_LINK_CREATE), creation = H5Pcreate(H5P_DATASET_CREATE);
    hid_t dataset = H5I_INVALID_HID;
    if (links >= 0 && creation >= 0 && H5Pset_create_intermediate_group(links, 1) >= 0 &&
        H5Pset_obj_track_times(creation, 0) >= 0 && H5Pset_layout(creation, H5D_CONTIGUOUS) >= 0 &&
        H5Pset_alloc_time(creation, H5D_ALLOC_TIME_EARLY) >= 0 &&
        H5Pset_fill_time(creation, H5D_FILL_TIME_NEVER) >= 0) {
        dataset = H5Dcreate2(file->id, path, type, space, links, creation, H5P_DEFAULT);
    }
    if (dataset >= 0 &&
        ((unit != NULL && !write_attribute(dataset, "unit", unit)) ||
         (description != NULL && !write_attribute(dataset, "description", description)))) {
        (void)H5Dclose(dataset);
        dataset = H5I_INVALID_HID;
    }
    (void)pal_h5_drop(links);
    (void)pal_h5_drop(creation);
    return dataset;
}

pal_status pal_h5_describe(pal_h5 *file, const char *group, const char *description,
                           pal_error *error) {
    pal_h5_call call = pal_h5_enter();
    hid_t object = H5I_INVALID_HID;
    hid_t links = H5Pcreate(H5P_LINK_CREATE);
    if (strcmp(group, "/") == 0 || H5Lexists(file->id, group, H5P_DEFAULT) > 0) {
        object = H5Gopen2(file->id, group, H5P_DEFAULT);
    } else if (links >= 0 && H5Pset_create_intermediate_group(links, 1) >= 0) {
        object = H5Gcreate2(file->id, group, links, H5P_DEFAULT, H5P_DEFAULT);
    }
    int ok = object >= 0 && write_attribute(object, "description", description);
    ok = pal_h5_drop(object) && ok;
    (void)pal_h5_drop(links);
    pal_status status =
        ok ? PALPATE_OK : pal_h5_fail(error, PALPATE_ERROR_IO, "cannot write", group);
    pal_h5_leave(call);
    return status;
}

/// dims as HDF5 wants them. @return 0 when the shape is out of range
static int shape_of(int rank, const int64_t dims[], hsize_t shape[PALPATE_H5_RANK_MAX],
                    size_t element, size_t *bytes) {
    if (rank < 0 || rank > PALPATE_H5_RANK_MAX || element == 0) {
        return 0;
    }
    *bytes = element;
    for (int i = 0; i < rank; i++) {
        if (dims[i] < 0 || __builtin_mul_overflow(*bytes, (size_t)dims[i], bytes)) {
            return 0;
        }
        shape[i] = (hsize_t)dims[i];
    }
    return *bytes <= PTRDIFF_MAX;
}

pal_status pal_h5_declare(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                          const int64_t dims[], const char *unit, const char *description,
                          pal_error *error) {
    hsize_t shape[PALPATE_H5_RANK_MAX];
    size_t bytes;
    if (!shape_of(rank, dims, shape, pal_h5_type_size(type), &bytes)) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "%s: its dimensions are out of range", path);
    }
    pal_h5_call call = pal_h5_enter();
    hid_t space = rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(rank, shape, NULL);
    hid_t dataset =
        space >= 0 ? make_dataset(file, path, pal_h5_type_id(file, type), space, unit, description)
                   : H5I_INVALID_HID;
    pal_status status = PALPATE_OK;
    if (dataset < 0 || H5Dclose(dataset) < 0) {
        status = pal_h5_fail(error, PALPATE_ERROR_IO, "cannot write", path);
    }
    (void)pal_h5_drop(space);
    pal_h5_leave(call);
    return status;
}

pal_status pal_h5_write_rows(pal_h5 *file, const char *path, pal_h5_type type, int64_t first,
                             int64_t count, int64_t ld, const void *data, pal_error *error) {
    pal_h5_call call = pal_h5_enter();
    hid_t dataset = H5Dopen2(file->id, path, H5P_DEFAULT);
    int ok = dataset >= 0 && pal_h5_transfer_rows(dataset, pal_h5_type_id(file, type), first, count,
                                                  ld, data, NULL);
    ok = pal_h5_drop(dataset) && ok;
    pal_status status =
        ok ? PALPATE_OK : pal_h5_fail(error, PALPATE_ERROR_IO, "cannot write", path);
    pal_h5_leave(call);
    return status;
}

pal_status pal_h5_write(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                        const int64_t dims[], const void *data, const char *unit,
                        const char *description, pal_error *error) {
    pal_status status = pal_h5_declare(file, path, type, rank, dims, unit, description, error);
    if (status != PALPATE_OK) {
        return status;
    }
    return pal_h5_write_rows(file, path, type, 0, rank == 0 ? 1 : dims[0], 0, data, error);
}

pal_status pal_h5_write_text(pal_h5 *file, const char *path, const char *text,
                             const char *description, pal_error *error) {
    pal_h5_call call = pal_h5_enter();
    hid_t type = pal_h5_text_type(strlen(text) + 1), space = H5Screate(H5S_SCALAR);
    hid_t dataset = type >= 0 && space >= 0
                        ? make_dataset(file, path, type, space, NULL, description)
                        : H5I_INVALID_HID;
    int ok = dataset >= 0 && H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text) >= 0;
    ok = pal_h5_drop(dataset) && ok;
    (void)pal_h5_drop(space);
    (void)pal_h5_drop(type);
    pal_status status =
        ok ? PALPATE_OK : pal_h5_fail(error, PALPATE_ERROR_IO, "cannot write", path);
    pal_h5_leave(call);
    return status;
}
