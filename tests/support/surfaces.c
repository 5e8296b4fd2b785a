/// Triangle surfaces for tests: see surfaces.h.
#include "surfaces.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int32_t add_vertex(test_surface *t, const double x[3]) {
    for (int32_t i = 0; i < t->vertex_count; i++) {
        if (memcmp(t->x + 3 * i, x, 3 * sizeof *x) == 0) {
            return i;
        }
    }
    memcpy(t->x + 3 * t->vertex_count, x, 3 * sizeof *x);
    return t->vertex_count++;
}

void test_surface_sphere(test_surface *t, int level, double radius) {
    static const double corner[6][3] = {{1, 0, 0},  {0, 1, 0}, {-1, 0, 0},
                                        {0, -1, 0}, {0, 0, 1}, {0, 0, -1}};
    static const int32_t face[8][3] = {{0, 1, 4}, {1, 2, 4}, {2, 3, 4}, {3, 0, 4},
                                       {1, 0, 5}, {2, 1, 5}, {3, 2, 5}, {0, 3, 5}};
    memset(t, 0, sizeof *t);
    for (int i = 0; i < 6; i++) {
        (void)add_vertex(t, corner[i]);
    }
    memcpy(t->v, face, sizeof face);
    t->triangle_count = 8;
    for (; level > 0; level--) {
        int32_t old = t->triangle_count;
        for (int32_t i = 0; i < old; i++) {
            int32_t v[3], m[3];
            memcpy(v, t->v + 3 * i, sizeof v);
            for (int k = 0; k < 3; k++) {
                double x[3], r = 0.0;
                for (int d = 0; d < 3; d++) {
                    x[d] = t->x[3 * v[k] + d] + t->x[3 * v[(k + 1) % 3] + d];
                    r += x[d] * x[d];
                }
                for (int d = 0; d < 3; d++) {
                    x[d] /= sqrt(r);
                }
                m[k] = add_vertex(t, x);
            }
            const int32_t fresh[4][3] = {
                {m[0], m[1], m[2]}, {v[0], m[0], m[2]}, {v[1], m[1], m[0]}, {v[2], m[2], m[1]}};
            memcpy(t->v + 3 * i, fresh[0], sizeof fresh[0]);
            memcpy(t->v + 3 * t->triangle_count, fresh[1], 3 * sizeof fresh[1]);
            t->triangle_count += 3;
        }
    }
    for (int32_t i = 0; i < 3 * t->vertex_count; i++) {
        t->x[i] *= radius;
    }
}

void test_surface_cube_more(test_surface *t, double x, double y, double z) {
    static const int32_t quad[6][4] = {{0, 4, 6, 2}, {1, 3, 7, 5}, {0, 1, 5, 4},
                                       {2, 6, 7, 3}, {0, 2, 3, 1}, {4, 5, 7, 6}};
    int32_t corner[8];
    for (int i = 0; i < 8; i++) {
        const double p[3] = {x + (i & 1), y + (i >> 1 & 1), z + (i >> 2)};
        corner[i] = add_vertex(t, p);
    }
    for (int f = 0; f < 6; f++) {
        // both diagonals of neighbouring faces start at corner 0 or 7: edges are cube edges or
        // diagonals
        const int32_t v[6] = {corner[quad[f][0]], corner[quad[f][1]], corner[quad[f][2]],
                              corner[quad[f][0]], corner[quad[f][2]], corner[quad[f][3]]};
        memcpy(t->v + 3 * t->triangle_count, v, sizeof v);
        t->triangle_count += 2;
    }
}

void test_surface_cube(test_surface *t, double x, double y, double z) {
    memset(t, 0, sizeof *t);
    test_surface_cube_more(t, x, y, z);
}

static FILE *open_temporary(const char *extension, char *path) {
    (void)snprintf(path, 64, "/tmp/palpate-surface-XXXXXX.%s", extension);
    int fd = mkstemps(path, (int)strlen(extension) + 1);
    FILE *out = fd >= 0 ? fdopen(fd, "wb") : NULL;
    if (out == NULL) {
        perror(path);
        exit(99);
    }
    return out;
}

void test_surface_text(const char *text, const char *extension, char *path) {
    FILE *out = open_temporary(extension, path);
    (void)fputs(text, out);
    (void)fclose(out);
}

static void write_stl_binary(const test_surface *t, FILE *out) {
    char header[80] = "test";
    uint32_t count = (uint32_t)t->triangle_count;
    (void)fwrite(header, 1, sizeof header, out);
    (void)fwrite(&count, sizeof count, 1, out);
    for (int32_t i = 0; i < t->triangle_count; i++) {
        float f[12] = {0};
        uint16_t attribute = 0;
        for (int k = 0; k < 9; k++) {
            f[3 + k] = (float)t->x[3 * t->v[3 * i + k / 3] + k % 3];
        }
        (void)fwrite(f, sizeof f, 1, out);
        (void)fwrite(&attribute, sizeof attribute, 1, out);
    }
}

void test_surface_write(const test_surface *t, const char *kind, char *path) {
    int stl = strncmp(kind, "stl", 3) == 0, binary = strcmp(kind, "stlb") == 0;
    int ply = strcmp(kind, "ply") == 0;
    FILE *out = open_temporary(stl ? "stl" : kind, path);
    if (binary) {
        write_stl_binary(t, out);
    } else if (stl) {
        (void)fprintf(out, "solid test\n");
        for (int32_t i = 0; i < t->triangle_count; i++) {
            (void)fprintf(out, "facet normal 0 0 0\n outer loop\n");
            for (int k = 0; k < 3; k++) {
                const double *x = t->x + 3 * t->v[3 * i + k];
                (void)fprintf(out, "  vertex %.9g %.9g %.9g\n", x[0], x[1], x[2]);
            }
            (void)fprintf(out, " endloop\nendfacet\n");
        }
        (void)fprintf(out, "endsolid test\n");
    } else {
        if (ply) {
            (void)fprintf(
                out,
                "ply\nformat ascii 1.0\nelement vertex %d\nproperty float x\nproperty float y\n"
                "property float z\nelement face %d\nproperty list uchar int vertex_indices\n"
                "end_header\n",
                t->vertex_count, t->triangle_count);
        }
        for (int32_t i = 0; i < t->vertex_count; i++) {
            (void)fprintf(out, "%s%.9g %.9g %.9g\n", ply ? "" : "v ", t->x[3 * i], t->x[3 * i + 1],
                          t->x[3 * i + 2]);
        }
        for (int32_t i = 0; i < t->triangle_count; i++) {
            const int32_t *v = t->v + 3 * i;
            (void)fprintf(out, "%s %d %d %d\n", ply ? "3" : "f", v[0] + !ply, v[1] + !ply,
                          v[2] + !ply);
        }
    }
    (void)fclose(out);
}

int test_shared(const char *name, char *path, size_t size) {
    const char *source = getenv("PALPATE_SOURCE");
    (void)snprintf(path, size, "%s/../shared/%s", source != NULL ? source : ".", name);
    return access(path, R_OK) == 0;
}
