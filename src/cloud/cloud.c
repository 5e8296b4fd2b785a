/// @file cloud.c  What follows from nodes, triangles and tetrahedra: normals, areas, cell volumes.
///
/// Median dual (design 2.2): a node owns a quarter of each of its tetrahedra and a third of each of
/// its surface triangles. Area vectors (not normal x area) are kept because only they add up to
/// zero over a closed surface, edges and corners included. Sums run in element order, so the same
/// cloud gives the same bits. Thread: any, one cloud per thread.
#include "src/cloud/cloud.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

typedef struct face {
    int32_t node[3]; ///< ascending
    int32_t sign;    ///< parity of the permutation that sorted them: +1 or -1
} face;

void pal_cloud_clear(pal_cloud *cloud) {
    if (cloud == NULL) {
        return;
    }
    free(cloud->position);
    free(cloud->spacing);
    free(cloud->normal);
    free(cloud->area_vector);
    free(cloud->area);
    free(cloud->volume);
    free(cloud->triangle);
    free(cloud->tet);
    memset(cloud, 0, sizeof *cloud);
}

static void edge(const double *x, int32_t a, int32_t b, double out[3]) {
    for (int c = 0; c < 3; c++) {
        out[c] = x[3 * (size_t)b + (size_t)c] - x[3 * (size_t)a + (size_t)c];
    }
}

/// Area vector of a triangle: (b - a) x (c - a) / 2.
static void triangle_vector(const double *x, const int32_t t[3], double out[3]) {
    double u[3], v[3];
    edge(x, t[0], t[1], u);
    edge(x, t[0], t[2], v);
    v3_cross(u, v, out);
    for (int c = 0; c < 3; c++) {
        out[c] *= 0.5;
    }
}

static double tet_volume(const double *x, const int32_t t[4]) {
    double u[3], v[3], w[3], n[3];
    edge(x, t[0], t[1], u);
    edge(x, t[0], t[2], v);
    edge(x, t[0], t[3], w);
    v3_cross(u, v, n);
    return v3_dot(n, w) / 6.0;
}

static face face_make(int32_t a, int32_t b, int32_t c) {
    face f = {{a, b, c}, 1};
    for (int pass = 0; pass < 3; pass++) {
        int i = pass == 1 ? 1 : 0;
        if (f.node[i] > f.node[i + 1]) {
            int32_t t = f.node[i];
            f.node[i] = f.node[i + 1];
            f.node[i + 1] = t;
            f.sign = -f.sign;
        }
    }
    return f;
}

static int face_compare(const void *pa, const void *pb) {
    const face *a = pa, *b = pb;
    for (int i = 0; i < 3; i++) {
        if (a->node[i] != b->node[i]) {
            return a->node[i] < b->node[i] ? -1 : 1;
        }
    }
    return (a->sign > b->sign) - (a->sign < b->sign);
}

static int key_compare(const void *pa, const void *pb) {
    uint64_t a = *(const uint64_t *)pa, b = *(const uint64_t *)pb;
    return (a > b) - (a < b);
}

static pal_status check_indices(const pal_cloud *c, pal_error *error) {
    if (c->node_count < 4 || c->surface_count < 4 || c->surface_count > c->node_count ||
        c->tet_count < 1 || c->triangle_count < 4 || c->position == NULL || c->tet == NULL ||
        c->triangle == NULL) {
        return pal_fail(
            error, PALPATE_ERROR_CLOUD,
            "cloud: %d nodes, %d on the surface, %d triangles, %d tetrahedra: not a body",
            c->node_count, c->surface_count, c->triangle_count, c->tet_count);
    }
    for (size_t i = 0; i < 3 * (size_t)c->node_count; i++) {
        if (!isfinite(c->position[i])) {
            return pal_fail(error, PALPATE_ERROR_CLOUD, "cloud: node %zu has no finite position",
                            i / 3);
        }
    }
    for (size_t i = 0; i < 4 * (size_t)c->tet_count; i++) {
        if (c->tet[i] < 0 || c->tet[i] >= c->node_count) {
            return pal_fail(error, PALPATE_ERROR_CLOUD,
                            "cloud: tetrahedron %zu names node %d of %d", i / 4, c->tet[i],
                            c->node_count);
        }
    }
    for (size_t i = 0; i < 3 * (size_t)c->triangle_count; i++) {
        if (c->triangle[i] < 0 || c->triangle[i] >= c->surface_count) {
            return pal_fail(error, PALPATE_ERROR_CLOUD,
                            "cloud: triangle %zu names node %d, the surface has %d", i / 3,
                            c->triangle[i], c->surface_count);
        }
    }
    return PALPATE_OK;
}

/// The triangles must be exactly the tetrahedra's boundary, with the same orientation: then they
/// are closed and outward because the tetrahedra are positive.
static pal_status check_boundary(const pal_cloud *c, pal_error *error) {
    static const int side[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}}; // outward
    size_t count = 4 * (size_t)c->tet_count, triangles = (size_t)c->triangle_count;
    face *all = malloc((count + triangles) * sizeof *all);
    if (all == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for %zu faces", count);
    }
    for (size_t t = 0; t < (size_t)c->tet_count; t++) {
        const int32_t *n = c->tet + 4 * t;
        for (int k = 0; k < 4; k++) {
            all[4 * t + (size_t)k] = face_make(n[side[k][0]], n[side[k][1]], n[side[k][2]]);
        }
    }
    // a boundary triangle enters with the opposite sign: then every face must pair up
    for (size_t t = 0; t < triangles; t++) {
        const int32_t *n = c->triangle + 3 * t;
        all[count + t] = face_make(n[0], n[2], n[1]);
    }
    count += triangles;
    qsort(all, count, sizeof *all, face_compare);
    pal_status status = PALPATE_OK;
    for (size_t i = 0; i < count && status == PALPATE_OK; i += 2) {
        int paired = i + 1 < count && all[i].sign == -all[i + 1].sign &&
                     memcmp(all[i].node, all[i + 1].node, sizeof all[i].node) == 0;
        int thrice = i + 2 < count && memcmp(all[i].node, all[i + 2].node, sizeof all[i].node) == 0;
        if (!paired || thrice) {
            const double *x = c->position + 3 * (size_t)all[i].node[0];
            status =
                pal_fail(error, PALPATE_ERROR_CLOUD,
                         "cloud: face (%d, %d, %d) near (%g, %g, %g) (normalised) is not shared "
                         "by two cells or by one cell and the surface with one orientation",
                         all[i].node[0], all[i].node[1], all[i].node[2], x[0], x[1], x[2]);
        }
    }
    free(all);
    return status;
}

/// Mean length of each node's distinct edges.
static pal_status fill_spacing(pal_cloud *c, pal_error *error) {
    static const int pair[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
    size_t count = 6 * (size_t)c->tet_count;
    uint64_t *key = malloc(count * sizeof *key);
    int32_t *degree = calloc((size_t)c->node_count, sizeof *degree);
    if (key == NULL || degree == NULL) {
        free(key);
        free(degree);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for %zu edges", count);
    }
    for (size_t t = 0; t < (size_t)c->tet_count; t++) {
        for (int k = 0; k < 6; k++) {
            uint64_t a = (uint64_t)c->tet[4 * t + (size_t)pair[k][0]];
            uint64_t b = (uint64_t)c->tet[4 * t + (size_t)pair[k][1]];
            key[6 * t + (size_t)k] = a < b ? a << 32 | b : b << 32 | a;
        }
    }
    qsort(key, count, sizeof *key, key_compare);
    for (size_t i = 0; i < count; i++) {
        if (i > 0 && key[i] == key[i - 1]) {
            continue;
        }
        int32_t a = (int32_t)(key[i] >> 32), b = (int32_t)(key[i] & 0xffffffffu);
        double e[3];
        edge(c->position, a, b, e);
        double length = sqrt(v3_dot(e, e));
        c->spacing[a] += length;
        c->spacing[b] += length;
        degree[a]++;
        degree[b]++;
    }
    for (int32_t i = 0; i < c->node_count; i++) {
        c->spacing[i] /= degree[i]; // every node has a tetrahedron: checked before
    }
    free(key);
    free(degree);
    return PALPATE_OK;
}

static pal_status allocate_derived(pal_cloud *c, pal_error *error) {
    free(c->spacing);
    free(c->normal);
    free(c->area_vector);
    free(c->area);
    free(c->volume);
    size_t n = (size_t)c->node_count, s = (size_t)c->surface_count;
    c->spacing = calloc(n, sizeof(double));
    c->volume = calloc(n, sizeof(double));
    c->normal = calloc(3 * s, sizeof(double));
    c->area_vector = calloc(3 * s, sizeof(double));
    c->area = calloc(s, sizeof(double));
    if (c->spacing == NULL || c->volume == NULL || c->normal == NULL || c->area_vector == NULL ||
        c->area == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cloud: no memory for %zu nodes", n);
    }
    return PALPATE_OK;
}

static pal_status fill_surface(pal_cloud *c, pal_error *error) {
    for (size_t t = 0; t < (size_t)c->triangle_count; t++) {
        const int32_t *n = c->triangle + 3 * t;
        double v[3];
        triangle_vector(c->position, n, v);
        double third = sqrt(v3_dot(v, v)) / 3.0;
        for (int k = 0; k < 3; k++) {
            c->area[n[k]] += third;
            for (int d = 0; d < 3; d++) {
                c->area_vector[3 * (size_t)n[k] + (size_t)d] += v[d] / 3.0;
            }
        }
    }
    for (size_t i = 0; i < (size_t)c->surface_count; i++) {
        const double *v = c->area_vector + 3 * i;
        double norm = sqrt(v3_dot(v, v));
        if (!(norm > 1e-6 * c->area[i])) { // also catches a node without a triangle
            const double *x = c->position + 3 * i;
            return pal_fail(error, PALPATE_ERROR_CLOUD,
                            "cloud: surface node %zu at (%g, %g, %g) (normalised) has no outward "
                            "direction: it has no triangle or they fold onto each other",
                            i, x[0], x[1], x[2]);
        }
        for (int d = 0; d < 3; d++) {
            c->normal[3 * i + (size_t)d] = v[d] / norm;
        }
    }
    return PALPATE_OK;
}

pal_status pal_cloud_complete(pal_cloud *cloud, pal_error *error) {
    if (cloud == NULL) {
        return pal_fail(error, PALPATE_ERROR_ARGUMENT, "cloud: NULL");
    }
    pal_status status = check_indices(cloud, error);
    if (status == PALPATE_OK) {
        status = allocate_derived(cloud, error);
    }
    if (status != PALPATE_OK) {
        return status;
    }
    for (size_t t = 0; t < (size_t)cloud->tet_count; t++) {
        const int32_t *n = cloud->tet + 4 * t;
        double v = tet_volume(cloud->position, n);
        if (!(v > 0.0)) {
            const double *x = cloud->position + 3 * (size_t)n[0];
            return pal_fail(error, PALPATE_ERROR_CLOUD,
                            "cloud: tetrahedron %zu at (%g, %g, %g) (normalised) has volume %g", t,
                            x[0], x[1], x[2], v);
        }
        for (int k = 0; k < 4; k++) {
            cloud->volume[n[k]] += 0.25 * v;
        }
    }
    for (int32_t i = 0; i < cloud->node_count; i++) {
        if (!(cloud->volume[i] > 0.0)) {
            return pal_fail(error, PALPATE_ERROR_CLOUD, "cloud: node %d has no tetrahedron", i);
        }
    }
    status = check_boundary(cloud, error);
    if (status == PALPATE_OK) {
        status = fill_surface(cloud, error);
    }
    if (status == PALPATE_OK) {
        status = fill_spacing(cloud, error);
    }
    return status;
}

/// Smallest and largest dihedral angle of a tetrahedron [rad].
static void tet_dihedrals(const double *x, const int32_t t[4], double *low, double *high) {
    static const int side[4][3] = {{1, 2, 3}, {0, 3, 2}, {0, 1, 3}, {0, 2, 1}};
    double n[4][3];
    for (int k = 0; k < 4; k++) {
        int32_t f[3] = {t[side[k][0]], t[side[k][1]], t[side[k][2]]};
        triangle_vector(x, f, n[k]);
    }
    for (int a = 0; a < 4; a++) {
        for (int b = a + 1; b < 4; b++) {
            double s = sqrt(v3_dot(n[a], n[a]) * v3_dot(n[b], n[b]));
            double angle = acos(fmax(-1.0, fmin(1.0, -v3_dot(n[a], n[b]) / s)));
            *low = fmin(*low, angle);
            *high = fmax(*high, angle);
        }
    }
}

void pal_cloud_measure(const pal_cloud *cloud, pal_cloud_report *out) {
    static const int pair[6][2] = {{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {2, 3}};
    const double degree = 57.29577951308232, h = cloud->length;
    memset(out, 0, sizeof *out);
    out->node_count = cloud->node_count;
    out->surface_count = cloud->surface_count;
    out->interior_count = cloud->node_count - cloud->surface_count;
    out->triangle_count = cloud->triangle_count;
    out->tet_count = cloud->tet_count;
    out->spacing_min = HUGE_VAL;
    for (int32_t i = 0; i < cloud->node_count; i++) {
        out->spacing_min = fmin(out->spacing_min, cloud->spacing[i] * h);
        out->spacing_max = fmax(out->spacing_max, cloud->spacing[i] * h);
        out->spacing_mean += cloud->spacing[i] * h / cloud->node_count;
        out->volume += cloud->volume[i] * h * h * h;
    }
    for (int32_t i = 0; i < cloud->surface_count; i++) {
        out->area += cloud->area[i] * h * h;
    }
    double low = 4.0, high = 0.0;
    out->quality_min = out->edge_min = HUGE_VAL;
    for (size_t t = 0; t < (size_t)cloud->tet_count; t++) {
        const int32_t *n = cloud->tet + 4 * t;
        double sum = 0.0;
        int on_surface = 1;
        for (int k = 0; k < 6; k++) {
            double e[3];
            edge(cloud->position, n[pair[k][0]], n[pair[k][1]], e);
            double e2 = v3_dot(e, e);
            double local = 0.5 * (cloud->spacing[n[pair[k][0]]] + cloud->spacing[n[pair[k][1]]]);
            out->edge_min = fmin(out->edge_min, sqrt(e2) / local);
            sum += e2;
        }
        for (int k = 0; k < 4; k++) {
            on_surface &= n[k] < cloud->surface_count;
        }
        double quality = 12.0 * pow(3.0 * tet_volume(cloud->position, n), 2.0 / 3.0) / sum;
        out->quality_min = fmin(out->quality_min, quality);
        out->quality_mean += quality / cloud->tet_count;
        out->surface_tets += on_surface;
        tet_dihedrals(cloud->position, n, &low, &high);
    }
    out->dihedral_min = low * degree;
    out->dihedral_max = high * degree;
}
