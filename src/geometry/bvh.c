/// @file bvh.c  A tree of axis-aligned boxes over triangles.
///
/// Closest point on a triangle: Ericson, Real-Time Collision Detection (2005), section 5.1.5.
#include "src/geometry/bvh.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

enum { LEAF = 4, DEPTH = 64 };

typedef struct item {
    double key;
    int32_t triangle;
} item;

static int item_compare(const void *pa, const void *pb) {
    const item *a = pa, *b = pb;
    if (a->key != b->key) {
        return a->key < b->key ? -1 : 1;
    }
    return (a->triangle > b->triangle) - (a->triangle < b->triangle);
}

static double centroid(const pal_bvh *bvh, int32_t t, int axis) {
    const int32_t *v = bvh->v + 3 * (size_t)t;
    return bvh->x[3 * (size_t)v[0] + (size_t)axis] + bvh->x[3 * (size_t)v[1] + (size_t)axis] +
           bvh->x[3 * (size_t)v[2] + (size_t)axis];
}

static void bound(const pal_bvh *bvh, pal_bvh_box *box, int32_t first, int32_t count) {
    for (int c = 0; c < 3; c++) {
        box->low[c] = HUGE_VAL;
        box->high[c] = -HUGE_VAL;
    }
    for (int32_t i = first; i < first + count; i++) {
        const int32_t *v = bvh->v + 3 * (size_t)bvh->order[i];
        for (int k = 0; k < 3; k++) {
            for (int c = 0; c < 3; c++) {
                double x = bvh->x[3 * (size_t)v[k] + (size_t)c];
                box->low[c] = fmin(box->low[c], x);
                box->high[c] = fmax(box->high[c], x);
            }
        }
    }
}

/// Fill box `at` for order[first .. first+count) and everything below it.
static void build(pal_bvh *bvh, item *scratch, int32_t first, int32_t count) {
    int32_t at = bvh->box_count++;
    pal_bvh_box *box = bvh->box + at;
    bound(bvh, box, first, count);
    if (count <= LEAF) {
        box->first = first;
        box->count = count;
        return;
    }
    int axis = 0;
    double widest = -1.0;
    for (int c = 0; c < 3; c++) {
        double low = HUGE_VAL, high = -HUGE_VAL;
        for (int32_t i = first; i < first + count; i++) {
            double key = centroid(bvh, bvh->order[i], c);
            low = fmin(low, key);
            high = fmax(high, key);
        }
        if (high - low > widest) {
            widest = high - low;
            axis = c;
        }
    }
    for (int32_t i = 0; i < count; i++) {
        scratch[i].triangle = bvh->order[first + i];
        scratch[i].key = centroid(bvh, scratch[i].triangle, axis);
    }
    qsort(scratch, (size_t)count, sizeof *scratch, item_compare);
    for (int32_t i = 0; i < count; i++) {
        bvh->order[first + i] = scratch[i].triangle;
    }
    int32_t half = count / 2;
    box->count = 0;
    build(bvh, scratch, first, half);
    bvh->box[at].right = bvh->box_count;
    build(bvh, scratch, first + half, count - half);
}

pal_status pal_bvh_build(pal_bvh *bvh, const double *x, const int32_t *v, int32_t triangle_count,
                         pal_error *error) {
    memset(bvh, 0, sizeof *bvh);
    size_t n = triangle_count > 0 ? (size_t)triangle_count : 1;
    item *scratch = malloc(n * sizeof *scratch);
    bvh->x = x;
    bvh->v = v;
    bvh->triangle_count = triangle_count;
    bvh->order = malloc(n * sizeof *bvh->order);
    bvh->box = calloc(2 * n, sizeof *bvh->box);
    if (scratch == NULL || bvh->order == NULL || bvh->box == NULL) {
        free(scratch);
        pal_bvh_clear(bvh);
        return pal_fail(error, PALPATE_ERROR_MEMORY,
                        "surface: no memory for a tree of %d triangles", triangle_count);
    }
    for (int32_t i = 0; i < triangle_count; i++) {
        bvh->order[i] = i;
    }
    if (triangle_count > 0) {
        build(bvh, scratch, 0, triangle_count);
    }
    free(scratch);
    return PALPATE_OK;
}

void pal_bvh_clear(pal_bvh *bvh) {
    free(bvh->order);
    free(bvh->box);
    memset(bvh, 0, sizeof *bvh);
}

static void closest_on_triangle(const double p[3], const double a[3], const double b[3],
                                const double c[3], double out[3]) {
    double ab[3], ac[3], ap[3], bp[3], cp[3];
    v3_sub(b, a, ab);
    v3_sub(c, a, ac);
    v3_sub(p, a, ap);
    double d1 = v3_dot(ab, ap), d2 = v3_dot(ac, ap);
    if (d1 <= 0.0 && d2 <= 0.0) {
        v3_copy(a, out);
        return;
    }
    v3_sub(p, b, bp);
    double d3 = v3_dot(ab, bp), d4 = v3_dot(ac, bp);
    if (d3 >= 0.0 && d4 <= d3) {
        v3_copy(b, out);
        return;
    }
    double vc = d1 * d4 - d3 * d2;
    if (vc <= 0.0 && d1 >= 0.0 && d3 <= 0.0) {
        v3_add(a, d1 / (d1 - d3), ab, out);
        return;
    }
    v3_sub(p, c, cp);
    double d5 = v3_dot(ab, cp), d6 = v3_dot(ac, cp);
    if (d6 >= 0.0 && d5 <= d6) {
        v3_copy(c, out);
        return;
    }
    double vb = d5 * d2 - d1 * d6;
    if (vb <= 0.0 && d2 >= 0.0 && d6 <= 0.0) {
        v3_add(a, d2 / (d2 - d6), ac, out);
        return;
    }
    double va = d3 * d6 - d5 * d4;
    if (va <= 0.0 && d4 - d3 >= 0.0 && d5 - d6 >= 0.0) {
        double bc[3];
        v3_sub(c, b, bc);
        v3_add(b, (d4 - d3) / ((d4 - d3) + (d5 - d6)), bc, out);
        return;
    }
    double sum = 1.0 / (va + vb + vc);
    for (int k = 0; k < 3; k++) {
        out[k] = a[k] + ab[k] * (vb * sum) + ac[k] * (vc * sum);
    }
}

static double box_distance2(const pal_bvh_box *box, const double x[3]) {
    double sum = 0.0;
    for (int c = 0; c < 3; c++) {
        double d = fmax(0.0, fmax(box->low[c] - x[c], x[c] - box->high[c]));
        sum += d * d;
    }
    return sum;
}

static int32_t closest(const pal_bvh *bvh, const double x[3], const double *side, double point[3],
                       double *distance) {
    int32_t stack[2 * DEPTH], top = 0, found = -1;
    double best = HUGE_VAL;
    if (bvh->box_count > 0) {
        stack[top++] = 0;
    }
    while (top > 0) {
        int32_t at = stack[--top];
        const pal_bvh_box *box = bvh->box + at;
        if (box_distance2(box, x) > best) {
            continue;
        }
        if (box->count == 0) {
            int32_t left = at + 1, right = box->right;
            int near_left = box_distance2(bvh->box + left, x) <= box_distance2(bvh->box + right, x);
            stack[top++] = near_left ? right : left;
            stack[top++] = near_left ? left : right;
            continue;
        }
        for (int32_t i = box->first; i < box->first + box->count; i++) {
            const int32_t *v = bvh->v + 3 * (size_t)bvh->order[i];
            const double *a = bvh->x + 3 * (size_t)v[0], *b = bvh->x + 3 * (size_t)v[1];
            const double *c = bvh->x + 3 * (size_t)v[2];
            double p[3], d[3], n[3];
            closest_on_triangle(x, a, b, c, p);
            v3_sub(p, x, d);
            double d2 = v3_dot(d, d);
            if (d2 < best || (d2 == best && bvh->order[i] < found)) {
                if (side != NULL) {
                    v3_normal(a, b, c, n);
                    if (v3_dot(n, side) <= 0.0) {
                        continue;
                    }
                }
                best = d2;
                found = bvh->order[i];
                if (point != NULL) {
                    v3_copy(p, point);
                }
            }
        }
    }
    if (distance != NULL) {
        *distance = sqrt(best);
    }
    return found;
}

int32_t pal_bvh_closest(const pal_bvh *bvh, const double x[3], double point[3], double *distance) {
    return closest(bvh, x, NULL, point, distance);
}

int32_t pal_bvh_closest_side(const pal_bvh *bvh, const double x[3], const double side[3],
                             double point[3], double *distance) {
    return closest(bvh, x, side, point, distance);
}

void pal_bvh_overlap(const pal_bvh *bvh, const double low[3], const double high[3],
                     int (*visit)(void *user, int32_t triangle), void *user) {
    int32_t stack[2 * DEPTH], top = 0;
    if (bvh->box_count > 0) {
        stack[top++] = 0;
    }
    while (top > 0) {
        int32_t at = stack[--top];
        const pal_bvh_box *box = bvh->box + at;
        int apart = 0;
        for (int c = 0; c < 3; c++) {
            apart |= box->low[c] > high[c] || box->high[c] < low[c];
        }
        if (apart) {
            continue;
        }
        if (box->count == 0) {
            stack[top++] = box->right;
            stack[top++] = at + 1;
            continue;
        }
        for (int32_t i = box->first; i < box->first + box->count; i++) {
            if (visit(user, bvh->order[i])) {
                return;
            }
        }
    }
}
