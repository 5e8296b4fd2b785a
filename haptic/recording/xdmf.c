/// @file xdmf.c  Writing the XDMF companion (contents: xdmf.h).
#include "haptic/recording/xdmf.h"

#include <errno.h>
#include <locale.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#include "haptic/base/error.h"

static int ends_with(const char *text, const char *end) {
    size_t n = strlen(text), m = strlen(end);
    return n > m && strcmp(text + n - m, end) == 0;
}

pal_status pal_xdmf_name(const char *h5_path, char out[PALPATE_RECORDING_PATH], pal_error *error) {
    pal_status status = pal_recording_name(h5_path, ".xdmf", out, error);
    size_t n = strlen(h5_path);
    size_t cut = ends_with(h5_path, ".h5") ? 3 : ends_with(h5_path, ".hdf5") ? 5 : 0;
    if (status == PALPATE_OK && cut > 0) {
        memcpy(out + n - cut, ".xdmf", sizeof ".xdmf");
    }
    return status;
}

/// The file's own name with XML's special characters spelt out.
static void put_escaped(FILE *out, const char *path) {
    const char *slash = strrchr(path, '/');
    for (const char *p = slash != NULL ? slash + 1 : path; *p != 0; p++) {
        switch (*p) {
        case '&':
            fputs("&amp;", out);
            break;
        case '<':
            fputs("&lt;", out);
            break;
        case '>':
            fputs("&gt;", out);
            break;
        case '"':
            fputs("&quot;", out);
            break;
        default:
            fputc(*p, out);
        }
    }
}

void pal_xdmf_dataset(const char *name, int64_t frame, char *out, size_t size) {
    (void)snprintf(out, size, "/frames/%s/%06lld", name, (long long)frame);
}

/// One frame's dataset [rows, 3] of singles.
static void put_dataset(FILE *out, const pal_xdmf_series *s, const char *name, int64_t frame) {
    char path[64];
    pal_xdmf_dataset(name, frame, path, sizeof path);
    fprintf(out,
            "          <DataItem Dimensions=\"%d 3\" NumberType=\"Float\" Precision=\"4\" "
            "Format=\"HDF\">",
            (int)s->rows);
    put_escaped(out, s->h5_path);
    fprintf(out, ":%s</DataItem>\n", path);
}

/// A few numbers [tools, 3] written out.
static void put_numbers(FILE *out, const pal_xdmf_series *s, const double *value) {
    fprintf(out,
            "          <DataItem Dimensions=\"%d 3\" NumberType=\"Float\" Precision=\"8\" "
            "Format=\"XML\">",
            (int)s->tools);
    for (int32_t i = 0; i < 3 * s->tools; i++) {
        fprintf(out, "%s%.9g", i > 0 ? " " : "", value[i]);
    }
    fputs("</DataItem>\n", out);
}

static void put_surface(FILE *out, const pal_xdmf_series *s, int64_t frame) {
    fprintf(out,
            "        <Topology TopologyType=\"Triangle\" NumberOfElements=\"%d\">\n"
            "          <DataItem Dimensions=\"%d 3\" NumberType=\"Int\" Precision=\"4\" "
            "Format=\"HDF\">",
            (int)s->triangles, (int)s->triangles);
    put_escaped(out, s->h5_path);
    fputs(":/surface/triangles</DataItem>\n        </Topology>\n        <Geometry "
          "GeometryType=\"XYZ\">\n",
          out);
    put_dataset(out, s, "position", frame);
    fputs("        </Geometry>\n"
          "        <Attribute Name=\"displacement\" AttributeType=\"Vector\" Center=\"Node\">\n",
          out);
    put_dataset(out, s, "displacement", frame);
    fputs("        </Attribute>\n", out);
}

static void put_tools(FILE *out, const pal_xdmf_series *s, int64_t frame) {
    fprintf(out,
            "        <Topology TopologyType=\"Polyvertex\" NumberOfElements=\"%d\" "
            "NodesPerElement=\"1\">\n"
            "          <DataItem Dimensions=\"%d 1\" NumberType=\"Int\" Precision=\"4\" "
            "Format=\"XML\">",
            (int)s->tools, (int)s->tools);
    for (int32_t i = 0; i < s->tools; i++) {
        fprintf(out, "%s%d", i > 0 ? " " : "", (int)i);
    }
    fputs("</DataItem>\n        </Topology>\n        <Geometry GeometryType=\"XYZ\">\n", out);
    put_numbers(out, s, s->tool_position + 3 * (int64_t)s->tools * frame);
    fputs("        </Geometry>\n"
          "        <Attribute Name=\"force\" AttributeType=\"Vector\" Center=\"Node\">\n",
          out);
    put_numbers(out, s, s->tool_force + 3 * (int64_t)s->tools * frame);
    fputs("        </Attribute>\n", out);
}

static void put_collection(FILE *out, const pal_xdmf_series *s, const char *name,
                           void (*put_frame)(FILE *, const pal_xdmf_series *, int64_t)) {
    fprintf(out, "    <Grid Name=\"%s\" GridType=\"Collection\" CollectionType=\"Temporal\">\n",
            name);
    for (int64_t f = 0; f < s->frames; f++) {
        fprintf(
            out,
            "      <Grid Name=\"%s %lld\" GridType=\"Uniform\">\n        <Time Value=\"%.9g\"/>\n",
            name, (long long)f, s->time[f]);
        put_frame(out, s, f);
        fputs("      </Grid>\n", out);
    }
    fputs("    </Grid>\n", out);
}

pal_status pal_xdmf_write(const char *name, const pal_xdmf_series *series, pal_error *error) {
    char temporary[PALPATE_RECORDING_PATH];
    pal_status status = pal_recording_name(name, ".part", temporary, error);
    if (status != PALPATE_OK) {
        return status;
    }
    FILE *out = fopen(temporary, "we");
    locale_t c_locale = newlocale(LC_ALL_MASK, "C", (locale_t)0);
    if (out == NULL || c_locale == (locale_t)0) {
        int why = out == NULL ? errno : ENOMEM;
        if (out != NULL) {
            (void)fclose(out);
            (void)unlink(temporary);
        }
        if (c_locale != (locale_t)0) {
            freelocale(c_locale);
        }
        return pal_fail(error, PALPATE_ERROR_IO, "%s: cannot be written: %s", name, strerror(why));
    }
    locale_t before = uselocale(c_locale);
    fputs("<?xml version=\"1.0\"?>\n<Xdmf Version=\"3.0\">\n  <Domain>\n", out);
    if (series->frames > 0 && series->rows > 0 && series->triangles > 0) {
        put_collection(out, series, "surface", put_surface);
    }
    if (series->frames > 0) {
        put_collection(out, series, "tools", put_tools);
    }
    fputs("  </Domain>\n</Xdmf>\n", out);
    uselocale(before);
    freelocale(c_locale);
    int bad = ferror(out);
    bad |= fclose(out) != 0;
    if (bad || rename(temporary, name) != 0) {
        int why = errno;
        (void)unlink(temporary);
        return pal_fail(error, PALPATE_ERROR_IO, "%s: cannot be written: %s", name, strerror(why));
    }
    return PALPATE_OK;
}
