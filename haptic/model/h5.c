/// @file h5.c  The one file that includes HDF5. See h5.h for layout and thread rules.
///
/// Images: HDF5's core driver with file-image callbacks. A written image is the driver's own
/// buffer, kept when the driver closes; a read image is the caller's buffer, handed out for every
/// "copy", so no second copy of a model is ever made.
#include "haptic/model/h5.h"

#include <errno.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include <hdf5.h>

#include "haptic/base/error.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little endian, so is memory");

struct pal_h5 {
    hid_t id;
    hid_t half;    ///< the file type of PALPATE_H5_F16
    size_t size;   ///< bytes of a file opened for reading; no dataset may claim more
    void *image;   ///< memory: the driver's buffer (writing) or the caller's (reading)
    size_t length; ///< bytes of `image`
    int memory, writing;
};

/// HDF5's library state is global: one call at a time.
static pthread_mutex_t h5_mutex = PTHREAD_MUTEX_INITIALIZER;

/// What was in force before a call, restored after it.
typedef struct h5_call {
    H5E_auto2_t print;
    void *print_data;
} h5_call;

static h5_call enter(void) {
    h5_call call = {0};
    (void)pthread_mutex_lock(&h5_mutex);
    (void)H5open();
    (void)H5Eget_auto2(H5E_DEFAULT, &call.print, &call.print_data);
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    return call;
}

static void leave(h5_call call) {
    (void)H5Eclear2(H5E_DEFAULT);
    (void)H5Eset_auto2(H5E_DEFAULT, call.print, call.print_data);
    (void)pthread_mutex_unlock(&h5_mutex);
}

static herr_t innermost(unsigned n, const H5E_error2_t *entry, void *text) {
    if (n == 0 && entry->desc != NULL) {
        (void)snprintf(text, 160, " (HDF5: %.140s)", entry->desc);
    }
    return 0;
}

static pal_status fail_h5(pal_error *error, pal_status status, const char *what, const char *path) {
    char text[160] = "";
    (void)H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, innermost, text);
    return pal_fail(error, status, "%s %s%s", what, path, text);
}

/// Close any HDF5 object; an invalid one is none. @return 0 when that failed (a late write error)
static int drop(hid_t id) {
    return id < 0 || H5Idec_ref(id) >= 0;
}

// ---- Types --------------------------------------------------------------------------------------

size_t pal_h5_type_size(pal_h5_type type) {
    switch (type) {
    case PALPATE_H5_U8:
        return 1;
    case PALPATE_H5_I16:
    case PALPATE_H5_F16:
        return 2;
    case PALPATE_H5_I32:
    case PALPATE_H5_U32:
    case PALPATE_H5_F32:
        return 4;
    case PALPATE_H5_I64:
    case PALPATE_H5_U64:
    case PALPATE_H5_F64:
        return 8;
    }
    return 0;
}

static hid_t type_id(const pal_h5 *file, pal_h5_type type) {
    switch (type) {
    case PALPATE_H5_U8:
        return H5T_STD_U8LE;
    case PALPATE_H5_I16:
        return H5T_STD_I16LE;
    case PALPATE_H5_I32:
        return H5T_STD_I32LE;
    case PALPATE_H5_U32:
        return H5T_STD_U32LE;
    case PALPATE_H5_I64:
        return H5T_STD_I64LE;
    case PALPATE_H5_U64:
        return H5T_STD_U64LE;
    case PALPATE_H5_F16:
        return file->half;
    case PALPATE_H5_F32:
        return H5T_IEEE_F32LE;
    case PALPATE_H5_F64:
        return H5T_IEEE_F64LE;
    }
    return H5I_INVALID_HID;
}

/// sign 1, exponent 5 (bias 15), fraction 10; h5dump prints it as a number
static hid_t half_type(void) {
    hid_t t = H5Tcopy(H5T_IEEE_F32LE);
    if (t >= 0 && (H5Tset_fields(t, 15, 10, 5, 0, 10) < 0 || H5Tset_size(t, 2) < 0 ||
                   H5Tset_ebias(t, 15) < 0)) {
        (void)H5Tclose(t);
        t = H5I_INVALID_HID;
    }
    return t;
}

// ---- Images -------------------------------------------------------------------------------------

static void *image_malloc(size_t size, H5FD_file_image_op_t op, void *udata) {
    pal_h5 *file = udata;
    (void)op;
    if (!file->writing) {
        return file->image;
    }
    free(file->image);
    file->image = malloc(size);
    file->length = file->image != NULL ? size : 0;
    return file->image;
}

static void *image_memcpy(void *to, const void *from, size_t size, H5FD_file_image_op_t op,
                          void *udata) {
    (void)op;
    (void)udata;
    return to == from ? to : memcpy(to, from, size);
}

static void *image_realloc(void *old, size_t size, H5FD_file_image_op_t op, void *udata) {
    pal_h5 *file = udata;
    (void)op;
    if (!file->writing || old != file->image) {
        return NULL;
    }
    void *image = realloc(old, size);
    if (image != NULL) {
        file->image = image;
        file->length = size;
    }
    return image;
}

/// The driver lets go; the buffer stays ours (or the caller's).
static herr_t image_free(void *image, H5FD_file_image_op_t op, void *udata) {
    (void)image;
    (void)op;
    (void)udata;
    return 0;
}

static void *udata_copy(void *udata) {
    return udata;
}

static herr_t udata_free(void *udata) {
    (void)udata;
    return 0;
}

/// HDF5 takes two open core files of one name for the same file, so each image gets its own.
static const char *image_name(const pal_h5 *file, char name[40]) {
    (void)snprintf(name, 40, "palpate image %p", (const void *)file);
    return name;
}

// ---- Files --------------------------------------------------------------------------------------

static pal_h5 *new_file(pal_error *error) {
    pal_h5 *file = calloc(1, sizeof *file);
    if (file != NULL) {
        file->id = H5I_INVALID_HID;
        file->half = half_type();
    }
    if (file == NULL || file->half < 0) {
        free(file);
        (void)pal_fail(error, PALPATE_ERROR_MEMORY, "no memory for an HDF5 file");
        return NULL;
    }
    return file;
}

static int close_ids(pal_h5 *file) {
    int failed = 0;
    if (file->id >= 0) {
        failed = H5Fclose(file->id) < 0;
    }
    file->id = H5I_INVALID_HID;
    (void)H5Tclose(file->half);
    return failed;
}

/// The core driver on our callbacks; with an image when reading.
static int set_memory_driver(hid_t access, pal_h5 *file, size_t increment) {
    H5FD_file_image_callbacks_t callbacks = {image_malloc, image_memcpy, image_realloc, image_free,
                                             udata_copy,   udata_free,   file};
    return H5Pset_fapl_core(access, increment, 0) >= 0 &&
           H5Pset_file_image_callbacks(access, &callbacks) >= 0 &&
           (file->writing || H5Pset_file_image(access, file->image, file->length) >= 0);
}

pal_status pal_h5_create(const char *path, size_t user_block, size_t expected, pal_h5 **out,
                         pal_error *error) {
    *out = NULL;
    h5_call call = enter();
    pal_status status = PALPATE_OK;
    hid_t creation = H5I_INVALID_HID, access = H5I_INVALID_HID;
    pal_h5 *file = new_file(error);
    if (file == NULL) {
        status = PALPATE_ERROR_MEMORY;
        goto out;
    }
    file->memory = path == NULL;
    file->writing = 1;
    size_t increment = expected + expected / 64 + 65536;
    creation = H5Pcreate(H5P_FILE_CREATE);
    access = H5Pcreate(H5P_FILE_ACCESS);
    int ok = creation >= 0 && access >= 0 && H5Pset_userblock(creation, user_block) >= 0 &&
             // time stamps would make equal models unequal files
             H5Pset_obj_track_times(creation, 0) >= 0 &&
             // small aggregation blocks: less padding in small files
             H5Pset_meta_block_size(access, 2048) >= 0 &&
             H5Pset_small_data_block_size(access, 2048) >= 0 &&
             (path != NULL || set_memory_driver(access, file, increment));
    if (ok) {
        char name[40];
        file->id = H5Fcreate(path != NULL ? path : image_name(file, name), H5F_ACC_TRUNC, creation,
                             access);
    }
    if (file->id < 0) {
        status = fail_h5(error, path != NULL ? PALPATE_ERROR_IO : PALPATE_ERROR_MEMORY,
                         "cannot create", path != NULL ? path : "an HDF5 image");
        (void)close_ids(file);
        free(file->image);
        free(file);
        file = NULL;
    }
out:
    (void)drop(creation);
    (void)drop(access);
    *out = file;
    leave(call);
    return status;
}

pal_status pal_h5_take_image(pal_h5 *file, void **image, size_t *size, pal_error *error) {
    *image = NULL;
    *size = 0;
    if (!file->memory || !file->writing) {
        (void)pal_h5_close(file, NULL);
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "this HDF5 file has no image to take");
    }
    h5_call call = enter();
    pal_status status = PALPATE_OK;
    hsize_t bytes = 0;
    int ok = H5Fflush(file->id, H5F_SCOPE_LOCAL) >= 0 && H5Fget_filesize(file->id, &bytes) >= 0;
    ok = close_ids(file) == 0 && ok;
    if (ok && bytes > 0 && file->image != NULL) {
        // the driver grows in large steps: what the file does not reach is cut off
        *size = bytes < file->length ? (size_t)bytes : file->length;
        *image = realloc(file->image, *size);
        if (*image == NULL) {
            *image = file->image; // too much room is no failure
        }
    } else {
        status = fail_h5(error, PALPATE_ERROR_MEMORY, "cannot finish", "an HDF5 image");
        free(file->image);
    }
    free(file);
    leave(call);
    return status;
}

static pal_status open_file(const char *path, const void *image, size_t size, pal_h5 **out,
                            pal_error *error) {
    *out = NULL;
    h5_call call = enter();
    pal_status status = PALPATE_OK;
    hid_t access = H5I_INVALID_HID;
    pal_h5 *file = new_file(error);
    if (file == NULL) {
        status = PALPATE_ERROR_MEMORY;
        goto out;
    }
    file->memory = path == NULL;
    file->size = file->length = size;
    memcpy(&file->image, &image, sizeof image); // read only: HDF5's interface has no const
    access = H5Pcreate(H5P_FILE_ACCESS);
    if (access >= 0 && (path != NULL || set_memory_driver(access, file, 65536))) {
        char name[40];
        file->id = H5Fopen(path != NULL ? path : image_name(file, name), H5F_ACC_RDONLY, access);
    }
    if (file->id < 0) {
        status = fail_h5(error, PALPATE_ERROR_FORMAT, "HDF5 cannot read",
                         path != NULL ? path : "the image");
        (void)close_ids(file);
        free(file);
        file = NULL;
    }
out:
    (void)drop(access);
    *out = file;
    leave(call);
    return status;
}

pal_status pal_h5_open_image(const void *image, size_t size, pal_h5 **out, pal_error *error) {
    return open_file(NULL, image, size, out, error);
}

pal_status pal_h5_open_file(const char *path, pal_h5 **out, pal_error *error) {
    struct stat st;
    *out = NULL;
    if (stat(path, &st) != 0 || !S_ISREG(st.st_mode)) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: %s", path,
                        errno != 0 && !S_ISREG(st.st_mode) ? "not a regular file"
                                                           : strerror(errno));
    }
    return open_file(path, NULL, (size_t)st.st_size, out, error);
}

pal_status pal_h5_close(pal_h5 *file, pal_error *error) {
    if (file == NULL) {
        return PALPATE_OK;
    }
    h5_call call = enter();
    pal_status status = PALPATE_OK;
    if (close_ids(file)) {
        status = fail_h5(error, PALPATE_ERROR_IO, "cannot close", "the HDF5 file");
    }
    if (file->writing) {
        free(file->image);
    }
    free(file);
    leave(call);
    return status;
}

// ---- Writing ------------------------------------------------------------------------------------

static int write_attribute(hid_t object, const char *name, const char *text) {
    hid_t type = H5Tcopy(H5T_C_S1), space = H5Screate(H5S_SCALAR), attribute = H5I_INVALID_HID;
    int ok = type >= 0 && space >= 0 && H5Tset_size(type, strlen(text) + 1) >= 0 &&
             H5Tset_cset(type, H5T_CSET_UTF8) >= 0;
    if (ok) {
        attribute = H5Acreate2(object, name, type, space, H5P_DEFAULT, H5P_DEFAULT);
        ok = attribute >= 0 && H5Awrite(attribute, type, text) >= 0;
    }
    ok = drop(attribute) && ok;
    (void)drop(space);
    (void)drop(type);
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
    (void)drop(links);
    (void)drop(creation);
    return dataset;
}

pal_status pal_h5_describe(pal_h5 *file, const char *group, const char *description,
                           pal_error *error) {
    h5_call call = enter();
    hid_t object = H5I_INVALID_HID;
    hid_t links = H5Pcreate(H5P_LINK_CREATE);
    if (strcmp(group, "/") == 0 || H5Lexists(file->id, group, H5P_DEFAULT) > 0) {
        object = H5Gopen2(file->id, group, H5P_DEFAULT);
    } else if (links >= 0 && H5Pset_create_intermediate_group(links, 1) >= 0) {
        object = H5Gcreate2(file->id, group, links, H5P_DEFAULT, H5P_DEFAULT);
    }
    int ok = object >= 0 && write_attribute(object, "description", description);
    ok = drop(object) && ok;
    (void)drop(links);
    pal_status status = ok ? PALPATE_OK : fail_h5(error, PALPATE_ERROR_IO, "cannot write", group);
    leave(call);
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
    h5_call call = enter();
    hid_t space = rank == 0 ? H5Screate(H5S_SCALAR) : H5Screate_simple(rank, shape, NULL);
    hid_t dataset = space >= 0
                        ? make_dataset(file, path, type_id(file, type), space, unit, description)
                        : H5I_INVALID_HID;
    pal_status status = PALPATE_OK;
    if (dataset < 0 || H5Dclose(dataset) < 0) {
        status = fail_h5(error, PALPATE_ERROR_IO, "cannot write", path);
    }
    (void)drop(space);
    leave(call);
    return status;
}

/// Select rows [first, first + count) of a dataset and make the memory space for rows `ld` apart.
static int select_rows(hid_t space, int64_t first, int64_t count, int64_t ld, hid_t *memory) {
    hsize_t dims[PALPATE_H5_RANK_MAX] = {0}, start[PALPATE_H5_RANK_MAX] = {0};
    int rank = H5Sget_simple_extent_ndims(space);
    if (rank < 0 || rank > PALPATE_H5_RANK_MAX ||
        (rank > 0 && H5Sget_simple_extent_dims(space, dims, NULL) < 0)) {
        return 0;
    }
    if (rank == 0) {
        *memory = first == 0 && count == 1 ? H5Screate(H5S_SCALAR) : H5I_INVALID_HID;
        return *memory >= 0;
    }
    if (first < 0 || count < 0 || (hsize_t)first > dims[0] ||
        (hsize_t)count > dims[0] - (hsize_t)first) {
        return 0;
    }
    start[0] = (hsize_t)first;
    dims[0] = (hsize_t)count;
    if (count == 0 || (rank > 1 && dims[1] == 0)) {
        *memory = H5Screate_simple(rank, dims, NULL);
        return *memory >= 0 && H5Sselect_none(space) >= 0 && H5Sselect_none(*memory) >= 0;
    }
    hsize_t zero[PALPATE_H5_RANK_MAX] = {0}, spread[PALPATE_H5_RANK_MAX];
    memcpy(spread, dims, sizeof spread);
    if (ld != 0) {
        if (rank != 2 || ld < (int64_t)dims[1]) {
            return 0;
        }
        spread[1] = (hsize_t)ld;
    }
    *memory = H5Screate_simple(rank, spread, NULL);
    return *memory >= 0 &&
           H5Sselect_hyperslab(space, H5S_SELECT_SET, start, NULL, dims, NULL) >= 0 &&
           H5Sselect_hyperslab(*memory, H5S_SELECT_SET, zero, NULL, dims, NULL) >= 0;
}

static int transfer_rows(hid_t dataset, hid_t type, int64_t first, int64_t count, int64_t ld,
                         const void *from, void *to) {
    hid_t space = H5Dget_space(dataset), memory = H5I_INVALID_HID;
    int ok = space >= 0 && select_rows(space, first, count, ld, &memory);
    if (ok) {
        char nothing = 0; // zero-sized transfers still want an address
        ok = to != NULL ? H5Dread(dataset, type, memory, space, H5P_DEFAULT, to) >= 0
                        : H5Dwrite(dataset, type, memory, space, H5P_DEFAULT,
                                   from != NULL ? from : &nothing) >= 0;
    }
    (void)drop(memory);
    (void)drop(space);
    return ok;
}

pal_status pal_h5_write_rows(pal_h5 *file, const char *path, pal_h5_type type, int64_t first,
                             int64_t count, int64_t ld, const void *data, pal_error *error) {
    h5_call call = enter();
    hid_t dataset = H5Dopen2(file->id, path, H5P_DEFAULT);
    int ok =
        dataset >= 0 && transfer_rows(dataset, type_id(file, type), first, count, ld, data, NULL);
    ok = drop(dataset) && ok;
    pal_status status = ok ? PALPATE_OK : fail_h5(error, PALPATE_ERROR_IO, "cannot write", path);
    leave(call);
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

static hid_t text_type(size_t size) {
    hid_t type = H5Tcopy(H5T_C_S1);
    if (type >= 0 && (H5Tset_size(type, size) < 0 || H5Tset_cset(type, H5T_CSET_UTF8) < 0)) {
        (void)H5Tclose(type);
        type = H5I_INVALID_HID;
    }
    return type;
}

pal_status pal_h5_write_text(pal_h5 *file, const char *path, const char *text,
                             const char *description, pal_error *error) {
    h5_call call = enter();
    hid_t type = text_type(strlen(text) + 1), space = H5Screate(H5S_SCALAR);
    hid_t dataset = type >= 0 && space >= 0
                        ? make_dataset(file, path, type, space, NULL, description)
                        : H5I_INVALID_HID;
    int ok = dataset >= 0 && H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text) >= 0;
    ok = drop(dataset) && ok;
    (void)drop(space);
    (void)drop(type);
    pal_status status = ok ? PALPATE_OK : fail_h5(error, PALPATE_ERROR_IO, "cannot write", path);
    leave(call);
    return status;
}

// ---- Reading ------------------------------------------------------------------------------------

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
    h5_call call = enter();
    int found = hard_path(file->id, path);
    leave(call);
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
        (void)fail_h5(error, PALPATE_ERROR_FORMAT, "cannot open dataset", path);
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
    (void)drop(creation);
    return dataset;
}

/// Type, rank and completeness of an open dataset; its dimensions into dims.
static pal_status check_dataset(const pal_h5 *file, hid_t dataset, const char *path,
                                pal_h5_type type, int rank, int64_t dims[], pal_error *error) {
    pal_status status = PALPATE_OK;
    hsize_t shape[PALPATE_H5_RANK_MAX] = {0};
    hid_t stored = H5Dget_type(dataset), space = H5Dget_space(dataset);
    int found = space >= 0 ? H5Sget_simple_extent_ndims(space) : -1;
    if (stored < 0 || H5Tequal(stored, type_id(file, type)) <= 0) {
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
    (void)drop(stored);
    (void)drop(space);
    return status;
}

pal_status pal_h5_dims(pal_h5 *file, const char *path, pal_h5_type type, int rank, int64_t dims[],
                       pal_error *error) {
    h5_call call = enter();
    pal_status status = PALPATE_ERROR_FORMAT;
    hid_t dataset = open_dataset(file, path, error);
    if (dataset >= 0) {
        status = check_dataset(file, dataset, path, type, rank, dims, error);
        (void)H5Dclose(dataset);
    }
    leave(call);
    return status;
}

pal_status pal_h5_read_rows(pal_h5 *file, const char *path, pal_h5_type type, int rank,
                            const int64_t dims[], int64_t first, int64_t count, int64_t ld,
                            void *data, pal_error *error) {
    h5_call call = enter();
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
        (data == NULL ||
         !transfer_rows(dataset, type_id(file, type), first, count, ld, NULL, data))) {
        status = fail_h5(error, PALPATE_ERROR_FORMAT, "cannot read", path);
    }
    (void)H5Dclose(dataset);
out:
    leave(call);
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
    (void)drop(space);
    (void)drop(type);
    return size;
}

pal_status pal_h5_text_size(pal_h5 *file, const char *path, size_t *size, pal_error *error) {
    h5_call call = enter();
    pal_status status = PALPATE_ERROR_FORMAT;
    hid_t dataset = open_dataset(file, path, error);
    *size = 0;
    if (dataset >= 0) {
        *size = text_bytes(file, dataset);
        status = *size > 0 ? PALPATE_OK
                           : pal_fail(error, PALPATE_ERROR_FORMAT, "%s is not a text", path);
        (void)H5Dclose(dataset);
    }
    leave(call);
    return status;
}

pal_status pal_h5_read_text(pal_h5 *file, const char *path, char *text, size_t size,
                            pal_error *error) {
    h5_call call = enter();
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
    type = text_type(bytes);
    if (type < 0 || H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, text) < 0) {
        status = fail_h5(error, PALPATE_ERROR_FORMAT, "cannot read", path);
    } else if (memchr(text, 0, bytes) != text + bytes - 1) {
        status = pal_fail(error, PALPATE_ERROR_FORMAT, "%s does not end where it says", path);
    } else {
        status = PALPATE_OK;
    }
out:
    if (status != PALPATE_OK && size > 0) {
        text[0] = 0;
    }
    (void)drop(type);
    (void)drop(dataset);
    leave(call);
    return status;
}
