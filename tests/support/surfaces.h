/// @file surfaces.h  Triangle surfaces for tests, written to temporary files.
#ifndef PALPATE_TESTS_SUPPORT_SURFACES_H
#define PALPATE_TESTS_SUPPORT_SURFACES_H

#include <stddef.h>
#include <stdint.h>

enum { TEST_SURFACE_MAX = 4096 };

typedef struct test_surface {
    int32_t vertex_count, triangle_count;
    double x[3 * TEST_SURFACE_MAX];
    int32_t v[6 * TEST_SURFACE_MAX];
} test_surface;

/// Octahedron whose edges are halved `level` times, on a sphere.
void test_surface_sphere(test_surface *t, int level, double radius);
/// Unit cube with its lowest corner there; _more adds another one.
void test_surface_cube(test_surface *t, double x, double y, double z);
void test_surface_cube_more(test_surface *t, double x, double y, double z);

/// Write as "obj", "stl", "stlb" (binary) or "ply" below /tmp. @param[out] path  at least 64 bytes
void test_surface_write(const test_surface *t, const char *kind, char *path);
/// Write a text file with this extension.
void test_surface_text(const char *text, const char *extension, char *path);

/// Path of a file in the project's shared folder. @return 0 when it is absent
int test_shared(const char *name, char *path, size_t size);

#endif
