/// @file h5.c  HDF5 files, on disk and as images in memory: made, opened, closed. See h5.h for
/// layout and thread rules.
///
/// Images: HDF5's core driver with file-image callbacks. A written image is the driver's own
/// buffer, kept when the driver closes; a read image is the caller's buffer, handed out for every
/// "copy", so no second copy of a model is ever made.
#include <errno.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "haptic/base/error.h"
#include "haptic/model/h5_call.h"

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
        file->half = pal_h5_half_type();
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
    pal_h5_call call = pal_h5_enter();
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
        status = pal_h5_fail(error, path != NULL ? PALPATE_ERROR_IO : PALPATE_ERROR_MEMORY,
                             "cannot create", path != NULL ? path : "an HDF5 image");
        (void)close_ids(file);
        free(file->image);
        free(file);
        file = NULL;
    }
out:
    (void)pal_h5_drop(creation);
    (void)pal_h5_drop(access);
    *out = file;
    pal_h5_leave(call);
    return status;
}

pal_status pal_h5_take_image(pal_h5 *file, void **image, size_t *size, pal_error *error) {
    *image = NULL;
    *size = 0;
    if (!file->memory || !file->writing) {
        (void)pal_h5_close(file, NULL);
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "this HDF5 file has no image to take");
    }
    pal_h5_call call = pal_h5_enter();
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
        status = pal_h5_fail(error, PALPATE_ERROR_MEMORY, "cannot finish", "an HDF5 image");
        free(file->image);
    }
    free(file);
    pal_h5_leave(call);
    return status;
}

static pal_status open_file(const char *path, const void *image, size_t size, pal_h5 **out,
                            pal_error *error) {
    *out = NULL;
    pal_h5_call call = pal_h5_enter();
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
        status = pal_h5_fail(error, PALPATE_ERROR_FORMAT, "HDF5 cannot read",
                             path != NULL ? path : "the image");
        (void)close_ids(file);
        free(file);
        file = NULL;
    }
out:
    (void)pal_h5_drop(access);
    *out = file;
    pal_h5_leave(call);
    return status;
}

pal_status pal_h5_open_image(const void *image, size_t size, pal_h5 **out, pal_error *error) {
    return open_file(NULL, image, size, out, error);
}

pal_status pal_h5_open_file(const char *path, pal_h5 **out, pal_error *error) {
    struct stat st;
    *out = NULL;
    if (stat(path, &st) != 0) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: %s", path, strerror(errno));
    }
    if (!S_ISREG(st.st_mode)) {
        return pal_fail(error, PALPATE_ERROR_IO, "%s: not a regular file", path);
    }
    return open_file(path, NULL, (size_t)st.st_size, out, error);
}

pal_status pal_h5_close(pal_h5 *file, pal_error *error) {
    if (file == NULL) {
        return PALPATE_OK;
    }
    pal_h5_call call = pal_h5_enter();
    pal_status status = PALPATE_OK;
    if (close_ids(file)) {
        status = pal_h5_fail(error, PALPATE_ERROR_IO, "cannot close", "the HDF5 file");
    }
    if (file->writing) {
        free(file->image);
    }
    free(file);
    pal_h5_leave(call);
    return status;
}
