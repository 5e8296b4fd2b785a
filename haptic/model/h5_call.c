/// @file h5_call.c  Around every call into HDF5: lock, errors, types, rows to and from memory (see
/// h5_call.h).
#include "haptic/model/h5_call.h"

#include <pthread.h>
#include <stdio.h>
#include <string.h>

#include "haptic/base/error.h"

_Static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "files are little endian, so is memory");

/// HDF5's library state is global: one call at a time.
static pthread_mutex_t h5_mutex = PTHREAD_MUTEX_INITIALIZER;

pal_h5_call pal_h5_enter(void) {
    pal_h5_call call = {0};
    (void)pthread_mutex_lock(&h5_mutex);
    (void)H5open();
    (void)H5Eget_auto2(H5E_DEFAULT, &call.print, &call.print_data);
    (void)H5Eset_auto2(H5E_DEFAULT, NULL, NULL);
    return call;
}

void pal_h5_leave(pal_h5_call call) {
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

pal_status pal_h5_fail(pal_error *error, pal_status status, const char *what, const char *path) {
    char text[160] = "";
    (void)H5Ewalk2(H5E_DEFAULT, H5E_WALK_UPWARD, innermost, text);
    return pal_fail(error, status, "%s %s%s", what, path, text);
}

int pal_h5_drop(hid_t id) {
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

hid_t pal_h5_type_id(const pal_h5 *file, pal_h5_type type) {
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
hid_t pal_h5_half_type(void) {
    hid_t t = H5Tcopy(H5T_IEEE_F32LE);
    if (t >= 0 && (H5Tset_fields(t, 15, 10, 5, 0, 10) < 0 || H5Tset_size(t, 2) < 0 ||
                   H5Tset_ebias(t, 15) < 0)) {
        (void)H5Tclose(t);
        t = H5I_INVALID_HID;
    }
    return t;
}
hid_t pal_h5_text_type(size_t size) {
    hid_t type = H5Tcopy(H5T_C_S1);
    if (type >= 0 && (H5Tset_size(type, size) < 0 || H5Tset_cset(type, H5T_CSET_UTF8) < 0)) {
        (void)H5Tclose(type);
        type = H5I_INVALID_HID;
    }
    return type;
}

// ---- Rows ---------------------------------------------------------------------------------------

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

int pal_h5_transfer_rows(hid_t dataset, hid_t type, int64_t first, int64_t count, int64_t ld,
                         const void *from, void *to) {
    hid_t space = H5Dget_space(dataset), memory = H5I_INVALID_HID;
    int ok = space >= 0 && select_rows(space, first, count, ld, &memory);
    if (ok) {
        char nothing = 0; // zero-sized transfers still want an address
        ok = to != NULL ? H5Dread(dataset, type, memory, space, H5P_DEFAULT, to) >= 0
                        : H5Dwrite(dataset, type, memory, space, H5P_DEFAULT,
                                   from != NULL ? from : &nothing) >= 0;
    }
    (void)pal_h5_drop(memory);
    (void)pal_h5_drop(space);
    return ok;
}
