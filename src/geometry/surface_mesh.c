/// @file surface_mesh.c  Half-edge operations: build, split, flip, collapse.
///
/// Split and collapse keep a closed manifold closed and manifold: a collapse obeys the link
/// condition (Dey, Edelsbrunner, Guha, Nekhayev 1999): the ends of the edge have exactly two common
/// neighbours.
#include "src/geometry/surface_mesh.h"

#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "haptic/base/vec.h"

/// A sharp edge of the input that turns by more than 75 degrees in a vertex has a corner there.
static const double CORNER_COSINE = 0.26;

typedef struct half {
    uint64_t key; ///< smaller vertex << 32 | larger
    int32_t e;
} half;

static int half_compare(const void *pa, const void *pb) {
    const half *a = pa, *b = pb;
    if (a->key != b->key) {
        return a->key < b->key ? -1 : 1;
    }
    return (a->e > b->e) - (a->e < b->e);
}

/// realloc that keeps the old block on failure. @return 0 when out of memory
static int grow(void *pointer, size_t count, size_t size) {
    void *old, *fresh;
    memcpy(&old, pointer, sizeof old);
    fresh = realloc(old, count * size);
    if (fresh == NULL) {
        return 0;
    }
    memcpy(pointer, &fresh, sizeof fresh);
    // cppcheck-suppress memleak  ; *pointer owns it
    return 1;
}

static int reserve_vertices(pal_surface_mesh *m, int32_t count) {
    if (count <= m->vertex_capacity) {
        return 1;
    }
    size_t n = (size_t)count + (size_t)count / 2 + 64;
    if (!grow(&m->x, 3 * n, sizeof *m->x) || !grow(&m->h, n, sizeof *m->h) ||
        !grow(&m->set, n, sizeof *m->set) || !grow(&m->out, n, sizeof *m->out)) {
        return 0;
    }
    m->vertex_capacity = (int32_t)n;
    return 1;
}

static int reserve_triangles(pal_surface_mesh *m, int32_t count) {
    if (count <= m->triangle_capacity) {
        return 1;
    }
    size_t n = (size_t)count + (size_t)count / 2 + 64;
    if (!grow(&m->v, 3 * n, sizeof *m->v) || !grow(&m->twin, 3 * n, sizeof *m->twin) ||
        !grow(&m->feature, 3 * n, sizeof *m->feature) || !grow(&m->edge, 3 * n, sizeof *m->edge) ||
        !grow(&m->face, n, sizeof *m->face)) {
        return 0;
    }
    m->triangle_capacity = (int32_t)n;
    return 1;
}

void pal_smesh_clear(pal_surface_mesh *m) {
    free(m->x);
    free(m->h);
    free(m->set);
    free(m->out);
    free(m->v);
    free(m->twin);
    free(m->feature);
    free(m->edge);
    free(m->face);
    memset(m, 0, sizeof *m);
}

pal_status pal_smesh_build(pal_surface_mesh *m, const double *x, int32_t vertex_count,
                           const int32_t *v, int32_t triangle_count, const int16_t *face,
                           pal_error *error) {
    memset(m, 0, sizeof *m);
    size_t n = 3 * (size_t)triangle_count;
    half *edges = malloc((n ? n : 1) * sizeof *edges);
    if (edges == NULL || !reserve_vertices(m, vertex_count) ||
        !reserve_triangles(m, triangle_count)) {
        free(edges);
        pal_smesh_clear(m);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory for %d triangles",
                        triangle_count);
    }
    m->sharp = -1;
    m->vertex_count = vertex_count;
    m->triangle_count = triangle_count;
    memcpy(m->x, x, 3 * (size_t)vertex_count * sizeof *x);
    memcpy(m->v, v, n * sizeof *v);
    for (int32_t i = 0; i < vertex_count; i++) {
        m->h[i] = 0.0;
        m->set[i] = pal_set_none();
        m->out[i] = -1;
    }
    for (int32_t t = 0; t < triangle_count; t++) {
        m->face[t] = face != NULL ? face[t] : 0;
        for (int32_t e = 3 * t; e < 3 * t + 3; e++) {
            int32_t a = m->v[e], b = pal_smesh_head(m, e);
            uint64_t low = (uint64_t)(a < b ? a : b), high = (uint64_t)(a < b ? b : a);
            edges[e] = (half){low << 32 | high, e};
            m->out[a] = e;
            m->feature[e] = 0;
            m->edge[e] = pal_set_none();
            m->set[a] = pal_set_union(m->set[a], pal_set_one(m->face[t]));
        }
    }
    qsort(edges, n, sizeof *edges, half_compare);
    int closed = n % 2 == 0;
    for (size_t i = 0; i + 1 < n && closed; i += 2) {
        int32_t a = edges[i].e, b = edges[i + 1].e;
        closed = edges[i].key == edges[i + 1].key && m->v[a] == pal_smesh_head(m, b);
        m->twin[a] = b;
        m->twin[b] = a;
        if (closed && m->face[a / 3] != m->face[b / 3]) {
            pal_smesh_mark(m, a,
                           pal_set_union(pal_set_one(m->face[a / 3]), pal_set_one(m->face[b / 3])));
        }
    }
    free(edges);
    if (!closed) {
        pal_smesh_clear(m);
        return pal_fail(error, PALPATE_ERROR_GEOMETRY,
                        "surface: an edge is not shared by two triangles");
    }
    return PALPATE_OK;
}

pal_status pal_smesh_copy(pal_surface_mesh *to, const pal_surface_mesh *from, pal_error *error) {
    memset(to, 0, sizeof *to);
    if (!reserve_vertices(to, from->vertex_count) || !reserve_triangles(to, from->triangle_count)) {
        pal_smesh_clear(to);
        return pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory for %d triangles",
                        from->triangle_count);
    }
    size_t n = (size_t)from->vertex_count, m = (size_t)from->triangle_count;
    to->sharp = from->sharp;
    to->vertex_count = from->vertex_count;
    to->triangle_count = from->triangle_count;
    memcpy(to->x, from->x, 3 * n * sizeof *to->x);
    memcpy(to->h, from->h, n * sizeof *to->h);
    memcpy(to->set, from->set, n * sizeof *to->set);
    memcpy(to->out, from->out, n * sizeof *to->out);
    memcpy(to->v, from->v, 3 * m * sizeof *to->v);
    memcpy(to->twin, from->twin, 3 * m * sizeof *to->twin);
    memcpy(to->feature, from->feature, 3 * m * sizeof *to->feature);
    memcpy(to->edge, from->edge, 3 * m * sizeof *to->edge);
    memcpy(to->face, from->face, m * sizeof *to->face);
    return PALPATE_OK;
}

int pal_smesh_kind(const pal_surface_mesh *m, int32_t vertex, int32_t along[2]) {
    int count = 0;
    int32_t found[2] = {-1, -1}, e = m->out[vertex];
    do {
        if (m->feature[e]) {
            if (count < 2) {
                found[count] = e;
            }
            count++;
        }
        e = pal_smesh_around(m, e);
    } while (e != m->out[vertex]);
    if (along != NULL) {
        along[0] = found[0];
        along[1] = found[1];
    }
    if (count == 0) {
        return PALPATE_VERTEX_SMOOTH;
    }
    if (count != 2 || !pal_set_equal(m->edge[found[0]], m->edge[found[1]])) {
        return PALPATE_VERTEX_CORNER;
    }
    if (m->sharp < 0 || !pal_set_has(m->edge[found[0]], m->sharp)) {
        return PALPATE_VERTEX_CURVE;
    }
    double u[3], w[3];
    v3_sub(m->x + 3 * (size_t)pal_smesh_head(m, found[0]), m->x + 3 * (size_t)vertex, u);
    v3_sub(m->x + 3 * (size_t)pal_smesh_head(m, found[1]), m->x + 3 * (size_t)vertex, w);
    return -v3_dot(u, w) < CORNER_COSINE * v3_norm(u) * v3_norm(w) ? PALPATE_VERTEX_CORNER
                                                                   : PALPATE_VERTEX_CURVE;
}

void pal_smesh_mark(pal_surface_mesh *m, int32_t e, pal_constraint_set set) {
    int32_t o = m->twin[e];
    m->feature[e] = m->feature[o] = 1;
    m->edge[e] = m->edge[o] = pal_set_union(m->edge[e], set);
    int32_t a = m->v[e], b = m->v[o];
    m->set[a] = pal_set_union(m->set[a], set);
    m->set[b] = pal_set_union(m->set[b], set);
}

int32_t pal_smesh_find(const pal_surface_mesh *m, int32_t a, int32_t b) {
    int32_t e = m->out[a];
    do {
        if (pal_smesh_head(m, e) == b) {
            return e;
        }
        e = pal_smesh_around(m, e);
    } while (e != m->out[a]);
    return -1;
}

static void pair(pal_surface_mesh *m, int32_t a, int32_t b) {
    m->twin[a] = b;
    m->twin[b] = a;
}

/// Half-edge `to` takes over what lies beyond half-edge `from` (twin and feature).
static void take_over(pal_surface_mesh *m, int32_t to, int32_t from) {
    m->feature[to] = m->feature[from];
    m->edge[to] = m->edge[from];
    pair(m, to, m->twin[from]);
}

static void plain(pal_surface_mesh *m, int32_t e) {
    m->feature[e] = 0;
    m->edge[e] = pal_set_none();
}

int32_t pal_smesh_split(pal_surface_mesh *m, int32_t e, const double x[3]) {
    if (!reserve_vertices(m, m->vertex_count + 1) || !reserve_triangles(m, m->triangle_count + 2)) {
        return PALPATE_ERROR_MEMORY;
    }
    // triangle (a, b, c) of e and (b, a, d) of its twin o become (a, n, c), (n, b, c), (b, n, d),
    // (n, a, d)
    int32_t o = m->twin[e], n = m->vertex_count++;
    int32_t bc = pal_smesh_next(e), ca = pal_smesh_prev(e), ad = pal_smesh_next(o);
    int32_t b = m->v[bc], c = m->v[ca], a = m->v[ad], d = m->v[pal_smesh_prev(o)];
    int32_t p = 3 * m->triangle_count, q = p + 3;
    m->triangle_count += 2;
    m->face[p / 3] = m->face[e / 3];
    m->face[q / 3] = m->face[o / 3];
    // p: n b c
    m->v[p] = n;
    m->v[p + 1] = b;
    m->v[p + 2] = c;
    // q: n a d
    m->v[q] = n;
    m->v[q + 1] = a;
    m->v[q + 2] = d;
    take_over(m, p + 1, bc);
    take_over(m, q + 1, ad);
    m->v[bc] = n; // e: a n, bc: n c, ca: c a
    m->v[ad] = n; // o: b n, ad: n d
    m->feature[p] = m->feature[q] = m->feature[e];
    m->edge[p] = m->edge[q] = m->edge[e];
    plain(m, bc);
    plain(m, p + 2);
    plain(m, ad);
    plain(m, q + 2);
    pair(m, bc, p + 2);
    pair(m, ad, q + 2);
    pair(m, e, q);
    pair(m, p, o);
    m->out[n] = p;
    m->out[a] = e;
    m->out[b] = o;
    m->out[c] = ca;
    m->out[d] = pal_smesh_prev(o);
    v3_copy(x, m->x + 3 * (size_t)n);
    m->h[n] = 0.5 * (m->h[a] + m->h[b]);
    m->set[n] = m->feature[e] ? m->edge[e] : pal_set_one(m->face[e / 3]);
    return n;
}

int pal_smesh_flip(pal_surface_mesh *m, int32_t e) {
    int32_t o = m->twin[e];
    int32_t bc = pal_smesh_next(e), ca = pal_smesh_prev(e), ad = pal_smesh_next(o),
            db = pal_smesh_prev(o);
    int32_t a = m->v[e], b = m->v[bc], c = m->v[ca], d = m->v[db];
    if (m->feature[e] || c == d || m->face[e / 3] != m->face[o / 3] ||
        pal_smesh_find(m, c, d) >= 0) {
        return 0;
    }
    // (a, b, c), (b, a, d) become (d, c, a) in e's triangle and (c, d, b) in o's
    int32_t t_bc = m->twin[bc], t_ad = m->twin[ad];
    uint8_t f_bc = m->feature[bc], f_ad = m->feature[ad];
    pal_constraint_set s_bc = m->edge[bc], s_ad = m->edge[ad];
    m->v[e] = d;
    m->v[bc] = c;
    m->v[ca] = a;
    m->v[o] = c;
    m->v[ad] = d;
    m->v[db] = b;
    // bc: c a (was ca), ca: a d (was ad), ad: d b (was db), db: b c (was bc)
    m->feature[bc] = m->feature[ca];
    m->edge[bc] = m->edge[ca];
    pair(m, bc, m->twin[ca]);
    m->feature[ca] = f_ad;
    m->edge[ca] = s_ad;
    pair(m, ca, t_ad);
    m->feature[ad] = m->feature[db];
    m->edge[ad] = m->edge[db];
    pair(m, ad, m->twin[db]);
    m->feature[db] = f_bc;
    m->edge[db] = s_bc;
    pair(m, db, t_bc);
    m->out[a] = ca;
    m->out[b] = db;
    m->out[c] = o;
    m->out[d] = e;
    return 1;
}

int pal_smesh_collapse(pal_surface_mesh *m, int32_t e) {
    int32_t o = m->twin[e], a = m->v[e], b = m->v[o];
    int32_t c = m->v[pal_smesh_prev(e)], d = m->v[pal_smesh_prev(o)];
    int common = 0, valence = 0;
    int32_t f = e;
    do {
        common += pal_smesh_head(m, f) != b && pal_smesh_find(m, b, pal_smesh_head(m, f)) >= 0;
        valence++;
        f = pal_smesh_around(m, f);
    } while (f != e);
    if (common != 2 || c == d || valence < 3) {
        return 0;
    }
    for (int side = 0; side < 2; side++) { // c and d lose an edge
        int32_t start = m->out[side ? d : c], count = 0;
        f = start;
        do {
            count++;
            f = pal_smesh_around(m, f);
        } while (f != start);
        if (count <= 3) {
            return 0;
        }
    }
    f = e;
    do { // every half-edge leaving a now leaves b
        int32_t next = pal_smesh_around(m, f);
        m->v[f] = b;
        f = next;
    } while (f != e);
    int32_t bc = pal_smesh_next(e), ca = pal_smesh_prev(e);
    int32_t ad = pal_smesh_next(o), db = pal_smesh_prev(o);
    int32_t bc_out = m->twin[bc], ca_out = m->twin[ca], ad_out = m->twin[ad], db_out = m->twin[db];
    if (m->feature[ca]) { // the merged edge is a feature when either was
        m->feature[bc_out] = 1;
        m->edge[bc_out] = m->edge[ca];
    }
    if (m->feature[ad]) {
        m->feature[db_out] = 1;
        m->edge[db_out] = m->edge[ad];
    }
    m->feature[ca_out] = m->feature[bc_out];
    m->edge[ca_out] = m->edge[bc_out];
    m->feature[ad_out] = m->feature[db_out];
    m->edge[ad_out] = m->edge[db_out];
    pair(m, bc_out, ca_out);
    pair(m, ad_out, db_out);
    for (int k = 0; k < 3; k++) {
        m->v[3 * (e / 3) + k] = -1;
        m->v[3 * (o / 3) + k] = -1;
    }
    // bc_out runs c -> b, ca_out b -> c (was a -> c), ad_out d -> b (was d -> a), db_out b -> d
    m->out[a] = -1;
    m->out[b] = ca_out;
    m->out[c] = bc_out;
    m->out[d] = ad_out;
    return 1;
}

pal_status pal_smesh_compact(pal_surface_mesh *m, pal_error *error) {
    int32_t *map = malloc((size_t)(m->vertex_count + m->triangle_count + 1) * sizeof *map);
    if (map == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "surface: no memory to renumber %d triangles",
                        m->triangle_count);
    }
    int32_t *tmap = map + m->vertex_count, vertices = 0, triangles = 0;
    for (int32_t i = 0; i < m->vertex_count; i++) {
        map[i] = m->out[i] >= 0 ? vertices++ : -1;
    }
    for (int32_t t = 0; t < m->triangle_count; t++) {
        tmap[t] = m->v[3 * (size_t)t] >= 0 ? triangles++ : -1;
    }
    for (int32_t i = 0; i < m->vertex_count; i++) {
        int32_t to = map[i];
        if (to >= 0) {
            v3_copy(m->x + 3 * (size_t)i, m->x + 3 * (size_t)to);
            m->h[to] = m->h[i];
            m->set[to] = m->set[i];
            m->out[to] = 3 * tmap[m->out[i] / 3] + m->out[i] % 3;
        }
    }
    for (int32_t t = 0; t < m->triangle_count; t++) {
        int32_t to = tmap[t];
        if (to >= 0) {
            m->face[to] = m->face[t];
            for (int k = 0; k < 3; k++) {
                int32_t e = 3 * t + k, f = 3 * to + k;
                m->v[f] = map[m->v[e]];
                m->twin[f] = 3 * tmap[m->twin[e] / 3] + m->twin[e] % 3;
                m->feature[f] = m->feature[e];
                m->edge[f] = m->edge[e];
            }
        }
    }
    m->vertex_count = vertices;
    m->triangle_count = triangles;
    free(map);
    return PALPATE_OK;
}

double pal_smesh_normal(const pal_surface_mesh *m, int32_t t, int32_t vertex, const double moved[3],
                        double n[3]) {
    const double *p[3];
    for (int k = 0; k < 3; k++) {
        int32_t v = m->v[3 * (size_t)t + (size_t)k];
        p[k] = moved != NULL && v == vertex ? moved : m->x + 3 * (size_t)v;
    }
    v3_normal(p[0], p[1], p[2], n);
    double norm = v3_norm(n);
    for (int c = 0; c < 3; c++) {
        n[c] = norm > 0.0 ? n[c] / norm : 0.0;
    }
    return norm;
}

void pal_smesh_vertex_normal(const pal_surface_mesh *m, int32_t vertex, double n[3]) {
    n[0] = n[1] = n[2] = 0.0;
    int32_t e = m->out[vertex];
    do {
        double u[3];
        double area = pal_smesh_normal(m, e / 3, -1, NULL, u);
        v3_add(n, area, u, n);
        e = pal_smesh_around(m, e);
    } while (e != m->out[vertex]);
}

double pal_smesh_volume(const pal_surface_mesh *m) {
    double sum = 0.0;
    for (size_t t = 0; t < (size_t)m->triangle_count; t++) {
        if (m->v[3 * t] >= 0) {
            double n[3];
            const double *a = m->x + 3 * (size_t)m->v[3 * t];
            v3_normal(a, m->x + 3 * (size_t)m->v[3 * t + 1], m->x + 3 * (size_t)m->v[3 * t + 2], n);
            sum += v3_dot(a, n) / 6.0;
        }
    }
    return sum;
}
