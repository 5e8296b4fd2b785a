/// @file h5_changes.c  Changes to a good HDF5 file's content, made by HDF5 itself (h5_changes.h).
#include "tests/fuzz/h5_changes.h"

#include <string.h>

#include <hdf5.h>

/// The image as an HDF5 file that can be changed in memory.
static hid_t open_copy(const h5_base *base) {
    hid_t access = H5Pcreate(H5P_FILE_ACCESS);
    REQUIRE(access >= 0 && H5Pset_fapl_core(access, 65536, 0) >= 0 &&
            H5Pset_file_image(access, base->image, base->size) >= 0);
    hid_t file = H5Fopen("fuzzed", H5F_ACC_RDWR, access);
    H5Pclose(access);
    REQUIRE(file >= 0);
    return file;
}

static herr_t note_name(hid_t id, const char *name, const H5O_info_t *info, void *data) {
    (void)id;
    h5_base *base = data;
    if (info->type == H5O_TYPE_DATASET && base->names < NAMES_MAX) {
        base->name[base->names] = malloc(strlen(name) + 2);
        REQUIRE(base->name[base->names] != NULL);
        (void)sprintf(base->name[base->names++], "/%s", name);
    }
    return 0;
}

void h5_base_note_names(h5_base *base) {
    REQUIRE(H5open() >= 0 && H5Eset_auto2(H5E_DEFAULT, NULL, NULL) >= 0);
    hid_t file = open_copy(base);
    REQUIRE(H5Ovisit2(file, H5_INDEX_NAME, H5_ITER_NATIVE, note_name, base, H5O_INFO_BASIC) >= 0);
    H5Fclose(file);
}

uint64_t h5_take(const uint8_t **data, size_t *size, size_t bytes) {
    uint64_t x = 0;
    for (size_t i = 0; i<bytes && * size> 0; i++, (*data)++, (*size)--) {
        x |= (uint64_t) * *data << (8 * i);
    }
    return x;
}

/// Most elements a dataset in chunks may have to be written: reshape makes each a chunk of its own,
/// of which HDF5 keeps hundreds of bytes in memory.
enum { CHUNKS_MAX = 1 << 12 };

static void write_values(hid_t file, const char *name, uint32_t argument, uint64_t value) {
    hid_t dataset = H5Dopen2(file, name, H5P_DEFAULT);
    if (dataset < 0) {
        return;
    }
    hid_t type = H5Dget_type(dataset), space = H5Dget_space(dataset);
    size_t element = H5Tget_size(type);
    hid_t creation = H5Dget_create_plist(dataset);
    hssize_t count = H5Sget_simple_extent_npoints(space);
    if (H5Pget_layout(creation) == H5D_CHUNKED && count > CHUNKS_MAX) {
        count = 0;
    }
    H5Pclose(creation);
    if (count > 0 && element > 0 && (size_t)count < ((size_t)1 << 22) / element) {
        uint8_t *bytes = calloc((size_t)count, element);
        REQUIRE(bytes != NULL);
        if (H5Dread(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes) >= 0) {
            size_t at = (argument % (size_t)count) * element;
            for (size_t i = 0; i < element && i < 8; i++) {
                bytes[at + i] = (uint8_t)(value >> (8 * i));
            }
            (void)H5Dwrite(dataset, type, H5S_ALL, H5S_ALL, H5P_DEFAULT, bytes);
        }
        free(bytes);
    }
    H5Sclose(space);
    H5Tclose(type);
    H5Dclose(dataset);
}

/// A new dataset of another type, rank or size, some of its bytes from `value`.
static void reshape(hid_t file, const char *name, uint32_t argument, uint64_t value) {
    hid_t types[] = {H5T_STD_I32LE, H5T_IEEE_F64LE, H5T_IEEE_F32LE, H5T_STD_U8LE,
                     H5T_STD_U64LE, H5T_IEEE_F64BE, H5T_C_S1,       H5T_STD_I16LE};
    hid_t type = H5Tcopy(types[argument & 7]);
    if ((argument & 7) == 6) {
        (void)H5Tset_size(type, value & 0x8000 ? H5T_VARIABLE : (size_t)(value & 0x3FF) + 1);
        (void)H5Tset_cset(type, argument & 8 ? H5T_CSET_UTF8 : H5T_CSET_ASCII);
    }
    int rank = (int)((argument >> 4) & 3);
    hsize_t dims[3];
    for (int i = 0; i < 3; i++) {
        dims[i] = (hsize_t)((value >> (16 * i)) & 0xFFFF);
        dims[i] = dims[i] > 0xFF00 ? (hsize_t)1 << (dims[i] & 63) : dims[i] & 0xFF;
    }
    hid_t creation = H5Pcreate(H5P_DATASET_CREATE);
    uint64_t total = (rank > 0 ? dims[0] : 1) * (rank > 1 ? dims[1] : 1) * (rank > 2 ? dims[2] : 1);
    if ((argument & 64) != 0 && total < 100000) {
        (void)H5Pset_alloc_time(creation, H5D_ALLOC_TIME_EARLY);
    }
    if ((argument & 128) != 0 && rank > 0) {
        hsize_t chunk[3] = {1, 1, 1};
        (void)H5Pset_chunk(creation, rank, chunk);
    }
    hid_t space = rank == 0 ? H5Screate(argument & 256 ? H5S_NULL : H5S_SCALAR)
                            : H5Screate_simple(rank, dims, NULL);
    if (space >= 0 && H5Ldelete(file, name, H5P_DEFAULT) >= 0) {
        hid_t dataset = H5Dcreate2(file, name, type, space, H5P_DEFAULT, creation, H5P_DEFAULT);
        if (dataset >= 0) {
            H5Dclose(dataset);
        }
    }
    if (space >= 0) {
        H5Sclose(space);
    }
    H5Pclose(creation);
    H5Tclose(type);
}

static void act(const h5_base *base, hid_t file, const char *name, unsigned action,
                uint32_t argument, uint64_t value) {
    const char *other = base->name[argument % (uint32_t)base->names];
    hid_t group;
    switch (action % 8) {
    case 0:
    case 1:
    case 2:
        write_values(file, name, argument, value);
        break;
    case 3:
        reshape(file, name, argument, value);
        break;
    case 4:
        (void)H5Ldelete(file, name, H5P_DEFAULT);
        break;
    case 5:
        if (H5Ldelete(file, name, H5P_DEFAULT) >= 0) {
            (void)H5Lcreate_soft(other, file, name, H5P_DEFAULT, H5P_DEFAULT);
        }
        break;
    case 6: // hard link to something else
        if (H5Lexists(file, other, H5P_DEFAULT) > 0 && strcmp(name, other) != 0 &&
            H5Ldelete(file, name, H5P_DEFAULT) >= 0) {
            (void)H5Lcreate_hard(file, other, file, name, H5P_DEFAULT, H5P_DEFAULT);
        }
        break;
    default:
        if (H5Ldelete(file, name, H5P_DEFAULT) >= 0 &&
            (group = H5Gcreate2(file, name, H5P_DEFAULT, H5P_DEFAULT, H5P_DEFAULT)) >= 0) {
            H5Gclose(group);
        }
    }
}

uint8_t *h5_changed(const h5_base *base, const uint8_t *data, size_t size, size_t *length) {
    hid_t file = open_copy(base);
    for (int steps = 0; size >= 3 && steps < 16; steps++) {
        const char *name = base->name[h5_take(&data, &size, 1) % (uint64_t)base->names];
        unsigned action = (unsigned)h5_take(&data, &size, 1);
        uint32_t argument = (uint32_t)h5_take(&data, &size, 4);
        uint64_t value = h5_take(&data, &size, 8);
        act(base, file, name, action, argument, value);
    }
    REQUIRE(H5Fflush(file, H5F_SCOPE_LOCAL) >= 0);
    ssize_t size_now = H5Fget_file_image(file, NULL, 0);
    REQUIRE(size_now > 0);
    uint8_t *image = malloc((size_t)size_now);
    REQUIRE(image != NULL && H5Fget_file_image(file, image, (size_t)size_now) == size_now);
    H5Fclose(file);
    *length = (size_t)size_now;
    return image;
}
