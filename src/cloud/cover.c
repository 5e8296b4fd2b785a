/// @file cover.c  Sphere radii of the cover.
///
/// Paper 1, section 2.2, gives the radii in the plane from the edges of the node generator's mesh,
/// which "only provides a structure". In space:
///
///     surface node                     the shortest of its edges along the surface
///     inner node away from it          the mean of its edges
///     inner node of a tetrahedron      the smallest distance to the planes of the surface
///     with a surface triangle          triangles opposite to it, as paper 1's Fig. 5
///
/// The paper relies on evenly graded meshes for a satisfactory cover; here it is made sure. Each
/// tetrahedron is to be covered by the spheres of its own vertices. It is cut into a lattice of
/// PIECES steps per edge; a point of it lies within reach = sqrt(3/8) longest / PIECES of a lattice
/// point (Jung's theorem in three dimensions), so it suffices that each lattice point p has a
/// vertex i with |p - x_i| + reach <= r_i. Where none has, all four radii are enlarged by the
/// factor that makes it so; a node takes the largest factor of its tetrahedra. Larger radii never
/// uncover.
#include "src/cloud/cover.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"

enum { PIECES = 8 };

static double distance(const double *a, const double *b) {
    double dx = a[0] - b[0], dy = a[1] - b[1], dz = a[2] - b[2];
    return sqrt(dx * dx + dy * dy + dz * dz);
}

static const double *at(const pal_cloud *c, int32_t node) {
    return c->position + 3 * (int64_t)node;
}

/// Distance of x from the plane of a, b, c; infinite when they span none.
static double plane_distance(const double *x, const double *a, const double *b, const double *c) {
    double u[3], v[3], n[3], w[3];
    for (int i = 0; i < 3; i++) {
        u[i] = b[i] - a[i];
        v[i] = c[i] - a[i];
        w[i] = x[i] - a[i];
    }
    n[0] = u[1] * v[2] - u[2] * v[1];
    n[1] = u[2] * v[0] - u[0] * v[2];
    n[2] = u[0] * v[1] - u[1] * v[0];
    double size = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
    double height = fabs(w[0] * n[0] + w[1] * n[1] + w[2] * n[2]);
    return size > 0.0 ? height / size : (double)INFINITY;
}

/// The paper's rules. `count` (node_count) gets each node's tetrahedra.
static void rule_radii(const pal_cloud *c, double *radius, int32_t *count) {
    static const int others[4][3] = {{1, 2, 3}, {0, 2, 3}, {0, 1, 3}, {0, 1, 2}};
    for (int32_t i = 0; i < c->node_count; i++) {
        radius[i] = INFINITY;
        count[i] = 0;
    }
    for (int32_t t = 0; t < c->triangle_count; t++) {
        const int32_t *v = c->triangle + 3 * (int64_t)t;
        for (int e = 0; e < 3; e++) {
            int32_t a = v[e], b = v[(e + 1) % 3];
            double length = distance(at(c, a), at(c, b));
            radius[a] = fmin(radius[a], length);
            radius[b] = fmin(radius[b], length);
        }
    }
    for (int32_t t = 0; t < c->tet_count; t++) {
        const int32_t *v = c->tet + 4 * (int64_t)t;
        for (int k = 0; k < 4; k++) {
            count[v[k]]++;
            int32_t a = v[others[k][0]], b = v[others[k][1]], d = v[others[k][2]];
            if (v[k] >= c->surface_count && a < c->surface_count && b < c->surface_count &&
                d < c->surface_count) {
                double height = plane_distance(at(c, v[k]), at(c, a), at(c, b), at(c, d));
                radius[v[k]] = fmin(radius[v[k]], height);
            }
        }
    }
    for (int32_t i = 0; i < c->node_count; i++) {
        if (!isfinite(radius[i]) && count[i] > 0) {
            radius[i] = c->spacing[i]; // the mean of its edges
        }
    }
}

/// The factor by which a tetrahedron's four spheres must grow to cover it.
static double needed(const pal_cloud *c, const int32_t *v, const double *radius) {
    double longest = 0.0;
    for (int a = 0; a < 4; a++) {
        for (int b = a + 1; b < 4; b++) {
            longest = fmax(longest, distance(at(c, v[a]), at(c, v[b])));
        }
    }
    double reach = sqrt(3.0 / 8.0) * longest / PIECES;
    double factor = 1.0;
    for (int i = 0; i <= PIECES; i++) {
        for (int j = 0; i + j <= PIECES; j++) {
            for (int k = 0; i + j + k <= PIECES; k++) {
                const double part[4] = {i, j, k, PIECES - i - j - k};
                double p[3] = {0.0, 0.0, 0.0};
                for (int a = 0; a < 4; a++) {
                    for (int d = 0; d < 3; d++) {
                        p[d] += part[a] / PIECES * at(c, v[a])[d];
                    }
                }
                double best = INFINITY;
                for (int a = 0; a < 4; a++) {
                    best = fmin(best, (distance(p, at(c, v[a])) + reach) / radius[v[a]]);
                }
                factor = fmax(factor, best);
            }
        }
    }
    return factor;
}

pal_status pal_cover_build(const pal_cloud *cloud, pal_cover *out, pal_error *error) {
    memset(out, 0, sizeof *out);
    int32_t n = cloud->node_count;
    size_t room = (size_t)(n > 0 ? n : 1);
    double *work = malloc(room * sizeof *work);
    int32_t *count = malloc(room * sizeof *count);
    out->radius = malloc(room * sizeof *out->radius);
    if (work == NULL || count == NULL || out->radius == NULL) {
        free(work);
        free(count);
        pal_cover_clear(out);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "cover: no memory for %d spheres", n);
    }
    out->node_count = n;
    rule_radii(cloud, out->radius, count);
    pal_status status = PALPATE_OK;
    for (int32_t i = 0; i < n && status == PALPATE_OK; i++) {
        if (count[i] == 0 || !(out->radius[i] > 0.0)) {
            status = pal_fail(error, PALPATE_ERROR_ARGUMENT,
                              "cover: node %d at (%g, %g, %g) has no tetrahedron of positive size",
                              i, at(cloud, i)[0], at(cloud, i)[1], at(cloud, i)[2]);
        }
        work[i] = 1.0;
    }
    for (int32_t t = 0; t < cloud->tet_count && status == PALPATE_OK; t++) {
        const int32_t *v = cloud->tet + 4 * (int64_t)t;
        double factor = needed(cloud, v, out->radius);
        for (int a = 0; a < 4; a++) {
            work[v[a]] = fmax(work[v[a]], factor);
        }
    }
    if (status == PALPATE_OK) {
        out->largest_enlargement = 1.0;
        out->min = INFINITY;
        for (int32_t i = 0; i < n; i++) {
            out->enlarged += work[i] > 1.0;
            out->largest_enlargement = fmax(out->largest_enlargement, work[i]);
            out->radius[i] *= work[i];
            double relative = out->radius[i] / cloud->spacing[i];
            out->min = fmin(out->min, relative);
            out->max = fmax(out->max, relative);
            out->mean += relative / n;
        }
    } else {
        pal_cover_clear(out);
    }
    free(work);
    free(count);
    return status;
}

void pal_cover_clear(pal_cover *cover) {
    free(cover->radius);
    memset(cover, 0, sizeof *cover);
}
