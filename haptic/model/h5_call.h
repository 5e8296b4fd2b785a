/// @file h5_call.h  What h5.c, h5_write.c and h5_read.c share; the one file that includes HDF5
/// (private).
///
/// Every call into HDF5 stands between pal_h5_enter and pal_h5_leave, which hold the one mutex and
/// keep HDF5 from printing; the functions below expect that. Ids are dropped by pal_h5_drop.
#ifndef PALPATE_HAPTIC_H5_CALL_H
#define PALPATE_HAPTIC_H5_CALL_H

#include <hdf5.h>

#include "haptic/model/h5.h"

struct pal_h5 {
    hid_t id;
    hid_t half;    ///< the file type of PALPATE_H5_F16
    size_t size;   ///< bytes of a file opened for reading; no dataset may claim more
    void *image;   ///< memory: the driver's buffer (writing) or the caller's (reading)
    size_t length; ///< bytes of `image`
    int memory, writing;
};

/// What was in force before a call, restored after it.
typedef struct pal_h5_call {
    H5E_auto2_t print;
    void *print_data;
} pal_h5_call;

/// Take the mutex, silence HDF5.
pal_h5_call pal_h5_enter(void);
void pal_h5_leave(pal_h5_call call);

/// "WHAT PATH (HDF5: its innermost message)". @return status
pal_status pal_h5_fail(pal_error *error, pal_status status, const char *what, const char *path);

/// Close any HDF5 object; an invalid one is none. @return 0 when that failed (a late write error)
int pal_h5_drop(hid_t id);

/// The file type of numbers; it belongs to HDF5 or to the file. @return negative when there is none
hid_t pal_h5_type_id(const pal_h5 *file, pal_h5_type type);

/// A new type for PALPATE_H5_F16, IEEE binary16. @return negative when HDF5 cannot make it
hid_t pal_h5_half_type(void);

/// A new type for a text of `size` bytes, terminator included.
hid_t pal_h5_text_type(size_t size);

/// Move rows [first, first + count) of an open dataset; rows lie `ld` elements apart in memory (0:
/// packed). @param to  NULL: write `from`. @return 0 when the rows are out of range or HDF5 fails
int pal_h5_transfer_rows(hid_t dataset, hid_t type, int64_t first, int64_t count, int64_t ld,
                         const void *from, void *to);

#endif
