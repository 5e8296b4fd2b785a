/// @file surface_check.c  Does a triangle surface bound a body? Repairs what is unambiguous.
///
/// In this order: degenerate triangles, open and over-shared edges, orientation (made consistent by
/// walking over shared edges), vertices where two fans touch, separate parts, volume (turned
/// outward when negative), self-intersection. Every refusal says how often, where (metres) and the
/// remedy.
#include "src/geometry/surface.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/geometry/triangle_cross.h"
#include "haptic/base/vec.h"

enum { SHOWN = 5 };

typedef struct side {
    uint64_t key;
    int32_t e; ///< 3 triangle + corner the edge starts at
} side;

typedef struct checker {
    pal_surface *s;
    double unit;
    int32_t *twin; ///< (3 triangles) the half-edge on the other side
    side *sides;
    int32_t *part;  ///< (triangles)
    int32_t *queue; ///< (triangles)
    int32_t parts;
    int32_t repaired;
} checker;

static int side_compare(const void *pa, const void *pb) {
    const side *a = pa, *b = pb;
    if (a->key != b->key) {
        return a->key < b->key ? -1 : 1;
    }
    return (a->e > b->e) - (a->e < b->e);
}

static int32_t head(const pal_surface *s, int32_t e) {
    return s->v[e % 3 == 2 ? e - 2 : e + 1];
}

static const double *at(const pal_surface *s, int32_t vertex) {
    return s->x + 3 * (size_t)vertex;
}

/// "(x, y, z)" in metres appended to `text` (up to SHOWN places, then "...").
static void add_place(char *text, size_t size, int32_t already, const double x[3], double unit) {
    size_t used = strlen(text);
    if (already < SHOWN) {
        (void)snprintf(text + used, size - used, "%s(%.6g, %.6g, %.6g)", already ? ", " : "",
                       x[0] * unit, x[1] * unit, x[2] * unit);
    } else if (already == SHOWN) {
        (void)snprintf(text + used, size - used, ", ...");
    }
}

static void middle(const pal_surface *s, int32_t triangle, double out[3]) {
    for (int c = 0; c < 3; c++) {
        out[c] = 0.0;
        for (int k = 0; k < 3; k++) {
            out[c] += at(s, s->v[3 * triangle + k])[c] / 3.0;
        }
    }
}

/// Drop triangles that welding collapsed to an edge; refuse those without area.
static pal_status check_degenerate(checker *k, pal_error *error) {
    pal_surface *s = k->s;
    int32_t kept = 0, flat = 0;
    char where[400] = "";
    for (int32_t t = 0; t < s->triangle_count; t++) {
        const int32_t *v = s->v + 3 * (size_t)t;
        if (v[0] == v[1] || v[1] == v[2] || v[2] == v[0]) {
            k->repaired++;
            continue;
        }
        double n[3], longest = 0.0;
        v3_normal(at(s, v[0]), at(s, v[1]), at(s, v[2]), n);
        for (int e = 0; e < 3; e++) {
            longest = fmax(longest, v3_distance(at(s, v[e]), at(s, v[(e + 1) % 3])));
        }
        if (!(v3_norm(n) > 1e-9 * longest * longest)) {
            double x[3];
            middle(s, t, x);
            add_place(where, sizeof where, flat++, x, k->unit);
        }
        memmove(s->v + 3 * (size_t)kept++, v, 3 * sizeof *v);
    }
    s->triangle_count = kept;
    if (flat > 0) {
        return pal_fail(
            error, PALPATE_ERROR_GEOMETRY,
            "%d degenerate triangle%s (three corners on a line), at %s m: remove %s in a mesh "
            "editor (merge by distance, collapse short edges)",
            flat, flat == 1 ? "" : "s", where, flat == 1 ? "it" : "them");
    }
    if (kept < 4) {
        return pal_fail(error, PALPATE_ERROR_GEOMETRY,
                        "%d triangles with area are too few to close a body: is the file empty?",
                        kept);
    }
    return PALPATE_OK;
}

/// Pair up half-edges; refuse edges with one triangle or more than two.
static pal_status check_edges(checker *k, pal_error *error) {
    const pal_surface *s = k->s;
    size_t count = 3 * (size_t)s->triangle_count;
    int32_t open = 0, crowded = 0;
    char open_at[400] = "", crowded_at[400] = "";
    for (size_t e = 0; e < count; e++) {
        uint64_t a = (uint64_t)s->v[e], b = (uint64_t)head(s, (int32_t)e);
        k->sides[e] = (side){a < b ? a << 32 | b : b << 32 | a, (int32_t)e};
    }
    qsort(k->sides, count, sizeof *k->sides, side_compare);
    for (size_t i = 0, j; i < count; i = j) {
        for (j = i + 1; j < count && k->sides[j].key == k->sides[i].key; j++) {
        }
        int32_t e = k->sides[i].e;
        double x[3];
        for (int c = 0; c < 3; c++) {
            x[c] = 0.5 * (at(s, s->v[e])[c] + at(s, head(s, e))[c]);
        }
        if (j - i == 1) {
            add_place(open_at, sizeof open_at, open++, x, k->unit);
        } else if (j - i > 2) {
            add_place(crowded_at, sizeof crowded_at, crowded++, x, k->unit);
        } else {
            k->twin[e] = k->sides[i + 1].e;
            k->twin[k->sides[i + 1].e] = e;
        }
    }
    if (crowded > 0) {
        return pal_fail(
            error, PALPATE_ERROR_GEOMETRY,
            "the surface is not a manifold: %d edge%s shared by more than two triangles, at "
            "%s m: remove inner walls and doubled faces",
            crowded, crowded == 1 ? " is" : "s are", crowded_at);
    }
    if (open > 0) {
        return pal_fail(
            error, PALPATE_ERROR_GEOMETRY,
            "the surface is open: %d edge%s only one triangle, at %s m: close the holes", open,
            open == 1 ? " has" : "s have", open_at);
    }
    return PALPATE_OK;
}

/// Turn a triangle over: corners 1 and 2 change places, so half-edges 0 and 2 do.
static void turn(checker *k, int32_t t) {
    int32_t *v = k->s->v + 3 * (size_t)t, keep = v[1];
    v[1] = v[2];
    v[2] = keep;
    int32_t a = k->twin[3 * t], b = k->twin[3 * t + 2];
    k->twin[3 * t] = b;
    k->twin[3 * t + 2] = a;
    k->twin[b] = 3 * t;
    k->twin[a] = 3 * t + 2;
    k->repaired++;
}

/// Walk over shared edges, turning triangles that disagree; number the parts.
static pal_status check_orientation(checker *k, pal_error *error) {
    const pal_surface *s = k->s;
    for (int32_t t = 0; t < s->triangle_count; t++) {
        k->part[t] = -1;
    }
    k->parts = 0;
    for (int32_t seed = 0; seed < s->triangle_count; seed++) {
        if (k->part[seed] >= 0) {
            continue;
        }
        int32_t first = 0, last = 0, turned = 0;
        k->queue[last++] = seed;
        k->part[seed] = k->parts;
        while (first < last) {
            int32_t t = k->queue[first++];
            for (int32_t e = 3 * t; e < 3 * t + 3; e++) {
                int32_t o = k->twin[e];
                int agrees = s->v[o] == head(s, e);
                if (k->part[o / 3] < 0) {
                    if (!agrees) {
                        turn(k, o / 3);
                        turned++;
                    }
                    k->part[o / 3] = k->parts;
                    k->queue[last++] = o / 3;
                } else if (!agrees) {
                    const double *x = at(s, s->v[e]);
                    return pal_fail(error, PALPATE_ERROR_GEOMETRY,
                                    "the surface has one side only (like a Moebius strip): its "
                                    "triangles cannot be turned to agree near (%.6g, %.6g, %.6g) m",
                                    x[0] * k->unit, x[1] * k->unit, x[2] * k->unit);
                }
            }
        }
        // fewer repairs when the minority is turned: the seed may have been the odd one
        if (2 * turned > last) {
            for (int32_t i = 0; i < last; i++) {
                turn(k, k->queue[i]);
            }
            k->repaired -= 2 * turned;
        }
        k->parts++;
    }
    return PALPATE_OK;
}

/// Every vertex must have one fan of triangles.
static pal_status check_vertices(checker *k, pal_error *error) {
    const pal_surface *s = k->s;
    int32_t touching = 0;
    char where[400] = "";
    int32_t *uses = calloc((size_t)s->vertex_count, 2 * sizeof *uses);
    if (uses == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to check %d vertices",
                        s->vertex_count);
    }
    int32_t *start = uses + s->vertex_count;
    for (int32_t e = 0; e < 3 * s->triangle_count; e++) {
        uses[s->v[e]]++;
        start[s->v[e]] = e;
    }
    for (int32_t i = 0; i < s->vertex_count; i++) {
        if (uses[i] == 0) {
            continue;
        }
        int32_t e = start[i], fan = 0;
        do {
            fan++;
            e = k->twin[e % 3 == 0 ? e + 2 : e - 1];
        } while (e != start[i] && fan <= uses[i]);
        if (fan != uses[i]) {
            add_place(where, sizeof where, touching++, at(s, i), k->unit);
        }
    }
    free(uses);
    if (touching > 0) {
        return pal_fail(
            error, PALPATE_ERROR_GEOMETRY,
            "the surface is not a manifold: %d %s where two parts of it touch in a point, "
            "at %s m: separate them",
            touching, touching == 1 ? "vertex" : "vertices", where);
    }
    return PALPATE_OK;
}

static pal_status check_volume(checker *k, pal_error *error) {
    const pal_surface *s = k->s;
    if (k->parts > 1) {
        char where[400] = "";
        int32_t shown = 0;
        for (int32_t t = 0; t < s->triangle_count; t++) {
            if (k->part[t] == shown) { // parts are numbered in the order of their first triangle
                double x[3];
                middle(s, t, x);
                add_place(where, sizeof where, shown++, x, k->unit);
            }
        }
        return pal_fail(
            error, PALPATE_ERROR_GEOMETRY,
            "the surface has %d separate parts, with triangles at %s m: a body is one closed "
            "surface; keep one part or join them",
            k->parts, where);
    }
    double low[3], high[3], volume = 0.0, extent = 0.0;
    for (int c = 0; c < 3; c++) {
        low[c] = HUGE_VAL;
        high[c] = -HUGE_VAL;
        for (int32_t i = 0; i < s->vertex_count; i++) {
            low[c] = fmin(low[c], at(s, i)[c]);
            high[c] = fmax(high[c], at(s, i)[c]);
        }
        extent = fmax(extent, high[c] - low[c]);
    }
    for (int32_t t = 0; t < s->triangle_count; t++) {
        double p[3][3], n[3];
        for (int i = 0; i < 3; i++) {
            v3_sub(at(s, s->v[3 * t + i]), low, p[i]);
        }
        v3_cross(p[1], p[2], n);
        volume += v3_dot(p[0], n) / 6.0;
    }
    if (!(fabs(volume) > 1e-9 * extent * extent * extent)) {
        return pal_fail(
            error, PALPATE_ERROR_GEOMETRY,
            "the surface encloses no volume (%.3g m^3, extent %.3g m, around (%.6g, %.6g, "
            "%.6g) m): it is flat or folded onto itself",
            volume * k->unit * k->unit * k->unit, extent * k->unit,
            0.5 * (low[0] + high[0]) * k->unit, 0.5 * (low[1] + high[1]) * k->unit,
            0.5 * (low[2] + high[2]) * k->unit);
    }
    if (volume < 0.0) {
        for (int32_t t = 0; t < s->triangle_count; t++) {
            turn(k, t);
        }
    }
    return PALPATE_OK;
}

typedef struct crossing {
    const pal_surface *s;
    double unit;
    int32_t triangle, count, neighbours; ///< neighbours: of the pairs, those that share a corner
    char where[500];
} crossing;

static int visit_pair(void *user, int32_t other) {
    crossing *c = user;
    if (other <= c->triangle || !pal_triangles_cross(c->s->x, c->s->v + 3 * (size_t)c->triangle,
                                                     c->s->v + 3 * (size_t)other)) {
        return 0;
    }
    for (int i = 0, shared = 0; i < 9 && !shared; i++) {
        shared = c->s->v[3 * c->triangle + i / 3] == c->s->v[3 * other + i % 3];
        c->neighbours += shared;
    }
    double a[3], b[3];
    middle(c->s, c->triangle, a);
    middle(c->s, other, b);
    for (int k = 0; k < 3; k++) {
        a[k] = 0.5 * (a[k] + b[k]);
    }
    add_place(c->where, sizeof c->where, c->count++, a, c->unit);
    return 0;
}

static pal_status check_crossings(checker *k, pal_error *error) {
    const pal_surface *s = k->s;
    pal_bvh tree;
    pal_status status = pal_bvh_build(&tree, s->x, s->v, s->triangle_count, error);
    if (status != PALPATE_OK) {
        return status;
    }
    crossing found = {.s = s, .unit = k->unit};
    for (int32_t t = 0; t < s->triangle_count; t++) {
        double low[3], high[3];
        for (int c = 0; c < 3; c++) {
            low[c] = high[c] = at(s, s->v[3 * t])[c];
            for (int i = 1; i < 3; i++) {
                low[c] = fmin(low[c], at(s, s->v[3 * t + i])[c]);
                high[c] = fmax(high[c], at(s, s->v[3 * t + i])[c]);
            }
        }
        found.triangle = t;
        pal_bvh_overlap(&tree, low, high, visit_pair, &found);
    }
    pal_bvh_clear(&tree);
    if (found.count > 0) {
        int32_t apart = found.count - found.neighbours;
        char beside[64] = "";
        if (found.neighbours > 0) {
            (void)snprintf(beside, sizeof beside, "%s%d that share%s a corner",
                           apart > 0 ? " and " : "", found.neighbours,
                           found.neighbours == 1 ? "s" : "");
        }
        return pal_fail(
            error, PALPATE_ERROR_GEOMETRY,
            "the surface intersects itself: %.0d%s%s, at %s m: separate them in a mesh editor "
            "or smooth the surface there",
            apart,
            apart > 1 ? " pairs of triangles"
                      : (apart == 1 ? " pair of triangles" : "pairs of triangles: "),
            beside, found.where);
    }
    return PALPATE_OK;
}

pal_status pal_surface_check(pal_surface *s, double unit, int32_t *repaired, pal_error *error) {
    size_t n = (size_t)(s->triangle_count > 0 ? s->triangle_count : 1);
    checker k = {.s = s, .unit = unit};
    k.twin = malloc(3 * n * sizeof *k.twin);
    k.sides = malloc(3 * n * sizeof *k.sides);
    k.part = malloc(n * sizeof *k.part);
    k.queue = malloc(n * sizeof *k.queue);
    pal_status status = PALPATE_OK;
    if (k.twin == NULL || k.sides == NULL || k.part == NULL || k.queue == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "no memory to check %zu triangles", n);
    }
    static pal_status (*const step[])(checker *, pal_error *) = {
        check_degenerate, check_edges,  check_orientation,
        check_vertices,   check_volume, check_crossings};
    for (size_t i = 0; i < sizeof step / sizeof step[0] && status == PALPATE_OK; i++) {
        status = step[i](&k, error);
    }
    if (repaired != NULL) {
        *repaired = k.repaired;
    }
    free(k.twin);
    free(k.sides);
    free(k.part);
    free(k.queue);
    return status;
}
