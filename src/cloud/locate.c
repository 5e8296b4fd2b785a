/// @file locate.c  Point location against the cloud's surface (see locate.h).
#include "src/cloud/locate.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

double pal_cloud_winding(const pal_cloud *cloud, const double x[3]) {
    double total = 0.0;
    for (int32_t t = 0; t < cloud->triangle_count; t++) {
        double v[3][3], r[3];
        for (int k = 0; k < 3; k++) {
            const double *p = cloud->position + 3 * (int64_t)cloud->triangle[3 * t + k];
            for (int d = 0; d < 3; d++) {
                v[k][d] = p[d] - x[d];
            }
            r[k] = sqrt(v3_dot(v[k], v[k]));
        }
        double cross[3] = {v[1][1] * v[2][2] - v[1][2] * v[2][1],
                           v[1][2] * v[2][0] - v[1][0] * v[2][2],
                           v[1][0] * v[2][1] - v[1][1] * v[2][0]};
        double y = v3_dot(v[0], cross);
        double z = r[0] * r[1] * r[2] + v3_dot(v[0], v[1]) * r[2] + v3_dot(v[1], v[2]) * r[0] +
                   v3_dot(v[2], v[0]) * r[1];
        total += 2.0 * atan2(y, z);
    }
    return total / (4.0 * 3.14159265358979323846);
}

double pal_triangle_nearest(const double a[3], const double b[3], const double c[3],
                            const double x[3], double weight[3]) {
    // Ericson, Real-Time Collision Detection, section 5.1.5: regions of the triangle's plane
    double ab[3], ac[3], ax[3], bx[3], cx[3];
    for (int d = 0; d < 3; d++) {
        ab[d] = b[d] - a[d];
        ac[d] = c[d] - a[d];
        ax[d] = x[d] - a[d];
        bx[d] = x[d] - b[d];
        cx[d] = x[d] - c[d];
    }
    double d1 = v3_dot(ab, ax), d2 = v3_dot(ac, ax), d3 = v3_dot(ab, bx), d4 = v3_dot(ac, bx);
    double d5 = v3_dot(ab, cx), d6 = v3_dot(ac, cx);
    double va = d3 * d6 - d5 * d4, vb = d5 * d2 - d1 * d6, vc = d1 * d4 - d3 * d2;
    double v = 0.0, w = 0.0;
    if (d1 <= 0.0 && d2 <= 0.0) {
        v = w = 0.0;
    } else if (d3 >= 0.0 && d4 <= d3) {
        v = 1.0;
    } else if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        v = d1 / (d1 - d3);
    } else if (d6 >= 0.0 && d5 <= d6) {
        w = 1.0;
    } else if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        w = d2 / (d2 - d6);
    } else if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        w = (d4 - d3) / ((d4 - d3) + (d5 - d6));
        v = 1.0 - w;
    } else {
        double sum = va + vb + vc;
        v = vb / sum;
        w = vc / sum;
    }
    weight[0] = 1.0 - v - w;
    weight[1] = v;
    weight[2] = w;
    double square = 0.0;
    for (int d = 0; d < 3; d++) {
        double off = ax[d] - v * ab[d] - w * ac[d];
        square += off * off;
    }
    return square;
}

void pal_triangle_ring_clear(pal_triangle_ring *ring) {
    free(ring->start);
    free(ring->item);
    memset(ring, 0, sizeof *ring);
}

pal_status pal_triangle_ring_build(const pal_cloud *cloud, pal_triangle_ring *out,
                                   pal_error *error) {
    memset(out, 0, sizeof *out);
    out->start = calloc((size_t)cloud->surface_count + 2, sizeof *out->start);
    out->item = malloc((3 * (size_t)cloud->triangle_count + 1) * sizeof *out->item);
    if (out->start == NULL || out->item == NULL) {
        pal_triangle_ring_clear(out);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    for (int64_t e = 0; e < 3 * (int64_t)cloud->triangle_count; e++) {
        out->start[cloud->triangle[e] + 2]++;
    }
    for (int32_t i = 1; i <= cloud->surface_count + 1; i++) {
        out->start[i] += out->start[i - 1];
    }
    for (int64_t e = 0; e < 3 * (int64_t)cloud->triangle_count; e++) {
        out->item[out->start[cloud->triangle[e] + 1]++] = (int32_t)(e / 3);
    }
    return PALPATE_OK;
}

int32_t pal_cloud_nearest_triangle(const pal_cloud *cloud, const pal_triangle_ring *ring,
                                   const int32_t *candidates, int32_t count, const double x[3],
                                   double *distance, double weight[3]) {
    int32_t best = -1;
    double best_square = INFINITY;
    for (int32_t k = 0; k < count; k++) {
        for (int32_t e = ring->start[candidates[k]]; e < ring->start[candidates[k] + 1]; e++) {
            const int32_t *v = cloud->triangle + 3 * (int64_t)ring->item[e];
            double w[3];
            double square = pal_triangle_nearest(cloud->position + 3 * (int64_t)v[0],
                                                 cloud->position + 3 * (int64_t)v[1],
                                                 cloud->position + 3 * (int64_t)v[2], x, w);
            if (square < best_square) {
                best_square = square;
                best = ring->item[e];
                memcpy(weight, w, sizeof w);
            }
        }
    }
    *distance = sqrt(best_square);
    return best;
}
