/// @file h5_read.c  Reading HDF5 that somebody else may have written: what is there must be exactly
/// what the caller expects, stored plainly and no larger than the file (see h5.h).
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/model/h5_call.h"

/// Every component of `path` must be a hard link: soft and external ones could lead anywhere.
static int hard_path(hid_t id, const char *path) {
    char prefix[PALPATE_H5_PATH_MAX];
    size_t length = strlen(path);
    if (length == 0 || length >= sizeof prefix || path[0] != '/') {
        return 0;
    }
    for (size_t i = 1; i <= length; i++) {
        if (path[i] != '/' && path[i] != 0) {
            continue;
        }
        memcpy(prefix, path, i);
        prefix[i] = 0;
        H5L_info_t link;
        if (H5Lexists(id, prefix, H5P_DEFAULT) <= 0 ||
            H5Lget_info(id, prefix, &link, H5P_DEFAULT) < 0 || link.type != H5L_TYPE_HARD) {
            return 0;
        }
    }
    return 1;
}

int pal_h5_has(pal_h5 *file, const char *path) {
    pal_h5_call call = pal_h5_enter();
    int found = hard_path(file->id, path);
    pal_h5_leave(call);
    return found;
}

/// Open a dataset that is stored plainly: contiguous, unfiltered, in this file, no larger than it.
static hid_t open_dataset(pal_h5 *file, const char *path, pal_error *error) {
    if (!hard_path(file->id, path)) {
        (void)pal_fail(error, PALPATE_ERROR_FORMAT, "%s is missing", path);
        return H5I_INVALID_HID;
    }
    H5O_info_t object;
    hid_t dataset = H5I_INVALID_HID, creation = H5I_INVALID_HID;
    if (H5Oget_info_by_name2(file->id, path, &object, H5O_INFO_BASIC, H5P_DEFAULT) < 0 ||
        object.type != H5O_TYPE_DATASET || (dataset = H5Dopen2(file->id, path, H5P_DEFAULT)) < 0) {
        (void)pal_h5_fail(error, PALPATE_ERROR_FORMAT, "cannot open dataset", path);
        return H5I_INVALID_HID;
    }
    creation = H5Dget_create_plist(dataset);
    if (creation < 0 || H5Pget_layout(creation) != H5D_CONTIGUOUS ||
        H5Pget_nfilters(creation) != 0 || H5Pget_external_count(creation) != 0 ||
        H5Dget_storage_size(dataset) > file->size) {
        (void)pal_fail(error, PALPATE_ERROR_FORMAT, "%s is not stored plainly", path);
        (void)H5Dclose(dataset);
        dataset = H5I_INVALID_HID;
    }
    (void)pal_h5_drop(creation);
    return dataset;
}

/// Type, rank and completeness of an open dataset; its dimensions into dims.
static pal_status check_dataset(const pal_h5 *file, hid_t dataset, const char *path,
                                pal_h5_type type, int rank, int64_t dims[], pal_error *error) {
    pal_status status = PALPATE_OK;
    hsize_t shape[PALPATE_H5_RANK_MAX] = {0};
    hid_t stored = H5Dget_type(dataset), space = H5Dget_space(dataset);
    int found = space >= 0 ? H5Sget_simple_extent_ndims(space) : -1;
    if (stored < 0 || H5Tequal(stored, pal_h5_type_id(file, type)) <= 0) {
        status = pal_fail(error, PALPATE_ERROR_FORMAT, "%s has another number type", path);
    } else if (found != rank ||
               (rank > 0 && H5Sget_simple_extent_dims(space, shape, NULL) != rank) ||
               (rank == 0 && H5Sget_simple_extent_type(space) != H5S_SCALAR)) {
        status = pal_fail(error, PALPATE_ERROR_FORMAT, "%s has %d dimensions, must have %d", path,
                          found, rank);
    } else {
        size_t bytes = pal_h5_type_size(type);
        for (int i = 0; i < rank; i++) {
            if (shape[i] > INT64_MAX || __builtin_mul_overflow(bytes, (size_t)shape[i], &bytes)) {
                bytes = SIZE_MAX;
                break;
            }
            dims[i] = (int64_t)shape[i];
        }
        if (bytes > file->size || H5Dget_storage_size(dataset) != bytes) {
            status = pal_fail(error, PALPATE_ERROR_FORMAT,
                              "%s claims %zu bytes that the file does not hold", path, bytes);
        }
    }
    (void)pal_h5_drop(stored);
    (void)pal_h5_drop(space);
    return status;
}

pal_status pal_h5_dims(pal_h5 *file, const char *path, pal_h5_type type, int rank, int64_t dims[],
                       pal_error *error) {
    pal_h5_call call = pal_h5_enter();
    pal_status status = PALPATE_ERROR_FORMAT;
    hid_t dataset = open_dataset(file, path, error);
    if (dataset >= 0) {
        status = check_dataset(file, dataset, path, type, rank, dims, error);
        (void)H5Dclose(dataset);
    }
    pal_h5_leave(call);
    return status;
}

pal_status pal_h5_read_rows(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                            const int64_t dims[], int64_t first, int64_t count, int64_t ld,
                            void *data, pal_error *error) {
    pal_h5_call call = pal_h5_enter();
    pal_status status = PALPATE_ERROR_FORMAT;
    int64_t found[PALPATE_H5_RANK_MAX] = {0};
    hid_t dataset = open_dataset(file, path, error);
    if (dataset < 0) {
        goto out;
    }
    status = check_dataset(file, dataset, path, type, rank, found, error);
    int empty = count == 0;
    for (int i = 0; status == PALPATE_OK && i < rank; i++) {
        empty |= dims[i] == 0;
        if (found[i] != dims[i]) {
            status = pal_fail(error, PALPATE_ERROR_FORMAT,
                              "%s has %lld entries in dimension %d, must have %lld", path,
                              (long long)found[i], i, (long long)dims[i]);
        }
    }
    if (status == PALPATE_OK && !empty &&
        (data == NULL || !pal_h5_transfer_rows(dataset, pal_h5_type_id(file, type), first, count,
                                               ld, NULL, data))) {
        status = pal_h5_fail(error, PALPATE_ERROR_FORMAT, "cannot read", path);
    }
    (void)H5Dclose(dataset);
out:
    pal_h5_leave(call);
    return status;
}

pal_status pal_h5_read(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                       const int64_t dims[], void *data, pal_error *error) {
    return pal_h5_read_rows(file, path, type, rank, dims, 0, rank == 0 ? 1 : dims[0], 0, data,
                            error);
}

/// Bytes of a fixed-length scalar text, terminator included; 0 when it is something else.
static size_t text_bytes(const pal_h5 *file, hid_t dataset) {
    hid_t type = H5Dget_type(dataset), space = H5Dget_space(dataset);
    size_t size = 0;
    if (type >= 0 && space >= 0 && H5Tget_class(type) == H5T_STRING &&
        H5Tis_variable_str(type) == 0 && H5Tget_strpad(type) == H5T_STR_NULLTERM &&
        H5Tget_cset(type) == H5T_CSET_UTF8 && H5Sget_simple_extent_type(space) == H5S_SCALAR) {
        size = H5Tget_size(type);
        if (size > file->size || H5Dget_storage_size(dataset) != size) {
            size = 0;
        }
    }
    (void)pal_h5_drop(space);
    (void)pal_h5_drop(type);
    return size;
}

pal_status pal_h5_text_size(pal_h5 *file, const char *path, size_t *size, pal_error *error) {
    pal_h5_call call = pal_h5_enter();
    pal_status status = PALPATE_ERROR_FORMAT;
    hid_t dataset = open_dataset(file, path, error);
    *size = 0;
    if (dataset >= 0) {
        *size = text_bytes(file, dataset);
        status = *size > 0 ? PALPATE_OK
                           : pal_fail(error, PALPATE_ERROR_FORMAT, "%s is not a text", path);
        (void)H5Dclose(dataset);
    }
    pal_h5_leave(call);
    return status;
}

pal_status pal_h5_read_text(pal_h5 *file, const char *path, char *text, size_t size,
                            pal_error *error) {
    pal_h5_call call = pal_h5_enter();
    pal_status status = PALPATE_ERROR_FORMAT;
    hid_t type = H5I_INVALID_HID, dataset = open_dataset(file, path, error);
    if (dataset < 0) {
        goto out;
    }
    size_t bytes = text_bytes(file, dataset);
    if (bytes == 0 || bytes > size) {
        status = pal_fail(error, PALPATE_ERROR_FORMAT, "%s is not a text of at most %zu bytes",
                          path, size);
        goto out;
    }
    type = pal_h5_text_type(bytes);
    if (type < 0 || H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text) < 0) {
        status = pal_h5_fail(error, PALPATE_ERROR_FORMAT, "cannot read", path);
    } else if (memchr(text, 0, bytes) != text + bytes - 1) {
        status = pal_fail(error, PALPATE_ERROR_FORMAT, "%s does not end where it says", path);
    } else {
        status = PALPATE_OK;
    }
out:
    if (status != PALPATE_OK && size > 0) {
        text[0] = 0;
    }
    (void)pal_h5_drop(type);
    (void)pal_h5_drop(dataset);
    pal_h5_leave(call);
    return status;
}
