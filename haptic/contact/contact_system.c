/// @file contact_system.c  Law "surface": compliance between contact points, forces, nodal forces.
///
/// Row r is a force on the body along the unit vector e_r at point i(r). Displacement at i along
/// e_r per force of row s at j:
///
///     M_rs = e_r^T [ Phi_i R Phi_j^T + K_ij ] e_s + (same tool) g_r.g_s / k
///     K_ij = (t I + (n - t) n_i n_j^T) b_ij,   b_ij = 1 / sqrt(|x_i - x_j|^2 + (w_i + w_j)^2)
///
/// with R the regular part of the nodes' compliance (near_field.h, working_set.h): what the mesh
/// knows, interpolated, plus the half-space's 1/r between the points themselves, each with the
/// width of its own cell (w_i = sqrt(A_i) / (2 self)). b is the Gram matrix of charges spread over
/// depths w_i, so positive definite, but for points of equal width at one place, which would be one
/// row twice: so b is a little smaller between stations and between tools. 1/k is the compliance of
/// the virtual coupling: the proxy stands at p_free - f / k, and gaps are taken at p_free; the
/// tool feels row r along g_r (contact_touch.c: felt), so what it gives enters there alone. A point
/// that fades gets 1/fade times its own K_ii.
///
/// A point has one row, e = -n with the gap w = M z + q >= 0 and z >= 0, or three, with the slips
/// along two tangents behind it (friction: since the last tick, contact_friction.c; held: w = 0);
/// friction.h solves all together. The forces act on the nodes as Phi^T e z (virtual work).
///
/// M is built four numbers at a time (wide.h): b of four points i; the three components of u and
/// the three rows of a point with one spare. Each number is made by the operations above in one
/// order.
#include <string.h>

#include "haptic/base/wide.h"
#include "haptic/contact/contact_anywhere.h"
#include "haptic/contact/contact_sweep.h"

/// Bounds of a tick: pivots without friction; factorizations with it, of which from the last tick's
/// forces 1 to 4 are typical.
enum { ITERATIONS = 200, FRICTION_ITERATIONS = 60 };
/// Factors of b_ij between two tools and between two stations of one: below 1, so that M is
/// positive definite where their points coincide (a capsule on end, tools in one place).
static const double APART = 0.99, ALONG = 0.999;

void pal_anywhere_gather(anywhere_law *law) {
    int32_t kept = 0;
    pal_working_set_begin(&law->set);
    for (int32_t i = 0; i < law->points; i++) {
        anywhere_point *point = &law->point[i];
        int fits = 1;
        for (int32_t k = 0; k < point->phi.count && fits; k++) {
            point->slot[k] = pal_working_set_add(&law->set, point->phi.column[k]);
            fits = point->slot[k] >= 0;
        }
        if (!fits) {
            law->dropped++;
            law->fault[point->tool] |= PALPATE_FAULT_CONTACTS;
            continue;
        }
        if (kept != i) {
            law->point[kept] = *point;
        }
        kept++;
    }
    law->points = kept;
}

/// y = R Phi^T: along x, y and z, or (rows = 1) along the point's row alone.
static void sweep(const anywhere_law *law, const anywhere_point *point, double *y) {
    if (point->rows == 3) {
        pal_sweep_axes(&law->set, point->phi.count, point->slot, point->phi.phi, y,
                       (size_t)law->ld);
    } else {
        pal_sweep_row(&law->set, point->phi.count, point->slot, point->phi.phi, point->along[0], y);
    }
}

void pal_anywhere_sample(const anywhere_point *point, const double *v, double u[3]) {
    u[0] = u[1] = u[2] = 0.0;
    for (int32_t k = 0; k < point->phi.count; k++) {
        const double *at = v + 3 * (size_t)point->slot[k];
        for (int i = 0; i < 3; i++) {
            u[i] += point->phi.phi[k] * at[i];
        }
    }
}

/// b_ij before fading, j given by its parts; `same`: i and j are one point.
static double apart(const anywhere_point *i, const double x[3], double width, int32_t tool,
                    int32_t station, int same) {
    double d[3] = {i->x[0] - x[0], i->x[1] - x[1], i->x[2] - x[2]}, both = i->width + width;
    double b = 1.0 / sqrt(v3_dot(d, d) + both * both);
    if (same) {
        return b;
    }
    return i->tool != tool ? APART * b : i->station != station ? ALONG * b : b;
}

static double spread(const anywhere_point *i, const anywhere_point *j) {
    double b = apart(i, j->x, j->width, j->tool, j->station, i == j);
    return i == j ? b / i->fade : b;
}

/// to[k] = 1 / sqrt(|x_k - x|^2 + (w_k + w)^2) of the points `at`.
PALPATE_INLINE void find_inverse(const anywhere_around *at, int32_t first, int32_t count,
                                 const anywhere_point *point, double *to) {
    const pal_lanes x = PALPATE_FILL(point->x[0]), y = PALPATE_FILL(point->x[1]),
                    z = PALPATE_FILL(point->x[2]), w = PALPATE_FILL(point->width);
    for (int32_t p = first; p < count; p += PALPATE_LANES) {
        pal_lanes a, b, c, both, square;
        PALPATE_LOAD(a, at->x + p);
        PALPATE_LOAD(b, at->y + p);
        PALPATE_LOAD(c, at->z + p);
        PALPATE_LOAD(both, at->width + p);
        a -= x, b -= y, c -= z, both += w;
        square = a * a + b * b + c * c + both * both;
        for (int k = 0; k < PALPATE_LANES; k++) {
            square[k] = sqrt(square[k]);
        }
        square = 1.0 / square;
        PALPATE_STORE(to + p, square);
    }
}

PALPATE_INLINE void trace_all(const anywhere_law *law, const anywhere_point *point, double u[3]) {
    const anywhere_around *past = &law->past;
    double t = law->near.tangent, more = law->near.normal - t;
    pal_lanes sum = PALPATE_FILL(0.0); // of b f, and of b f.n
    find_inverse(past, 0, law->traces, point, past->near);
    for (int32_t k = 0; k < law->traces; k++) {
        const anywhere_trace *j = &law->trace[k];
        double b = past->near[k];
        if (point->id == j->id) {
            b /= j->fade;
        } else {
            b *= point->tool != j->tool ? APART : point->station != j->station ? ALONG : 1.0;
        }
        pal_lanes f;
        PALPATE_LOAD(f, past->along + 4 * (size_t)k);
        sum += b * f;
    }
    for (int i = 0; i < 3; i++) {
        u[i] = t * sum[i] + more * sum[3] * point->normal[i];
    }
}

PALPATE_AVX2 static void trace_all_avx2(const anywhere_law *law, const anywhere_point *point,
                                        double u[3]) {
    trace_all(law, point, u);
}

void pal_anywhere_trace(const anywhere_law *law, const anywhere_point *point, double u[3]) {
    if (pal_have_avx2()) {
        trace_all_avx2(law, point, u);
    } else {
        trace_all(law, point, u);
    }
}

/// law->near[p] = b between j and the points from `first` on; two points of the same tool and
/// station take no factor.
PALPATE_INLINE void find_near(anywhere_law *law, int32_t j, int32_t first) {
    const anywhere_point *point = law->point;
    const anywhere_around *at = &law->around;
    find_inverse(at, first, law->points, &point[j], at->near);
    for (int32_t p = first; p < law->points; p++) {
        at->near[p] *= point[p].tool != point[j].tool         ? APART
                       : point[p].station != point[j].station ? ALONG
                                                              : 1.0;
    }
    at->near[j] /= point[j].fade;
}

/// u = sum_k phi_k v_k of the point's nodes, the fourth component without meaning.
PALPATE_INLINE void sample_wide(const anywhere_point *point, const double *v, pal_lanes *u) {
    pal_lanes sum = PALPATE_FILL(0.0);
    for (int32_t k = 0; k < point->phi.count; k++) {
        pal_lanes at;
        PALPATE_LOAD(at, v + 3 * (size_t)point->slot[k]);
        sum += PALPATE_FILL(point->phi.phi[k]) * at;
    }
    *u = sum;
}

/// The same for three v, `ld` apart.
PALPATE_INLINE void sample_axes(const anywhere_point *point, const double *v, size_t ld,
                                pal_lanes u[3]) {
    pal_lanes x = PALPATE_FILL(0.0), y = x, z = x;
    for (int32_t k = 0; k < point->phi.count; k++) {
        const double *at = v + 3 * (size_t)point->slot[k];
        const pal_lanes phi = PALPATE_FILL(point->phi.phi[k]);
        pal_lanes a, b, c;
        PALPATE_LOAD(a, at);
        PALPATE_LOAD(b, at + ld);
        PALPATE_LOAD(c, at + 2 * ld);
        x += phi * a;
        y += phi * b;
        z += phi * c;
    }
    u[0] = x, u[1] = y, u[2] = z;
}

/// Columns of M for point j of one row, rows of the points from `first` on.
PALPATE_INLINE void fill_row(anywhere_law *law, const anywhere_point *j, int32_t first,
                             const double *y) {
    double t = law->near.tangent, more = law->near.normal - t;
    double *m = law->m + (size_t)j->first * (size_t)law->rows;
    const double *e = j->along[0];
    for (int32_t p = first; p < law->points; p++) {
        const anywhere_point *i = &law->point[p];
        double yield = i->tool == j->tool ? law->tool[i->tool].yield : 0.0;
        pal_lanes u;
        sample_wide(i, y, &u);
        double v[3] = {u[0], u[1], u[2]};
        for (int32_t a = 0; a < i->rows; a++) {
            double blend = t * v3_dot(i->along[a], e) - (a == 0 ? -more : 0.0);
            m[i->first + a] = v3_dot(i->along[a], v) + blend * law->around.near[p] +
                              yield * v3_dot(i->felt[a], j->felt[0]);
        }
    }
}

/// The same for point j of three rows.
PALPATE_INLINE void fill_axes(anywhere_law *law, const anywhere_point *j, int32_t first,
                              const double *y) {
    size_t n = (size_t)law->rows, ld = (size_t)law->ld;
    double t = law->near.tangent, more = law->near.normal - t;
    for (int32_t p = first; p < law->points; p++) {
        const anywhere_point *i = &law->point[p];
        const double *turned = law->around.along + 12 * (size_t)p; // [component][row], spare 0
        double yield = i->tool == j->tool ? law->tool[i->tool].yield : 0.0;
        double near = law->around.near[p], *m = law->m + (size_t)j->first * n + (size_t)i->first;
        pal_lanes u[3], along[3], felt[3];
        sample_axes(i, y, ld, u);
        PALPATE_UNROLL
        for (int b = 0; b < 3; b++) {
            PALPATE_LOAD(along[b], turned + 4 * b);
            felt[b] = along[b]; // but its first row
            felt[b][0] = i->felt[0][b];
        }
        PALPATE_UNROLL
        for (int b = 0; b < 3; b++) {
            const double *e = j->along[b], *g = j->felt[b];
            // along[0] = -normal, the others lie across it
            const pal_lanes other = {b == 0 ? -more : 0.0, 0.0, 0.0, 0.0};
            pal_lanes v = u[0] * e[0] + u[1] * e[1] + u[2] * e[2];
            pal_lanes both = along[0] * e[0] + along[1] * e[1] + along[2] * e[2];
            pal_lanes give = felt[0] * g[0] + felt[1] * g[1] + felt[2] * g[2];
            pal_lanes blend = t * both - other;
            pal_lanes sum = along[0] * v[0] + along[1] * v[1] + along[2] * v[2];
            sum = sum + blend * near + yield * give;
            double *to = m + (size_t)b * n;
            to[0] = sum[0];
            if (i->rows == 3) {
                to[1] = sum[1];
                to[2] = sum[2];
            }
        }
    }
}

PALPATE_INLINE void fill_all(anywhere_law *law) {
    for (int32_t p = 0; p < law->points; p++) {
        const anywhere_point *j = &law->point[p];
        double *y = law->y + (size_t)j->first * (size_t)law->ld;
        int32_t first = law->set.symmetric ? p : 0;
        sweep(law, j, y);
        find_near(law, p, first);
        if (j->rows == 3) {
            fill_axes(law, j, first, y);
        } else {
            fill_row(law, j, first, y);
        }
    }
}

PALPATE_AVX2 static void fill_all_avx2(anywhere_law *law) {
    fill_all(law);
}

/// What fill_all() reads of the points, by components.
static void place_around(anywhere_law *law) {
    const anywhere_around *at = &law->around;
    for (int32_t p = 0; p < law->points; p++) {
        const anywhere_point *point = &law->point[p];
        double *turned = at->along + 12 * (size_t)p;
        at->x[p] = point->x[0];
        at->y[p] = point->x[1];
        at->z[p] = point->x[2];
        at->width[p] = point->width;
        for (int k = 0; k < 3; k++) {
            for (int a = 0; a < 3; a++) {
                turned[4 * k + a] = point->along[a][k];
            }
        }
    }
}

void pal_anywhere_assemble(anywhere_law *law) {
    law->rows = 0;
    if (law->frictional) {
        pal_anywhere_recall(law);
    }
    for (int32_t i = 0; i < law->points; i++) {
        anywhere_point *point = &law->point[i];
        if (point->mu > 0.0) {
            pal_anywhere_slip(law, point);
        }
        point->rows = point->mu != 0.0 ? 3 : 1;
        point->first = law->rows;
        law->rows += point->rows;
        law->mu[i] = point->mu;
        law->state[i] = law->before[point->id];
        for (int32_t a = 0; a < point->rows; a++) {
            law->q[point->first + a] = point->q[a];
            law->z[point->first + a] = law->force_before[3 * (size_t)point->id + (size_t)a];
        }
    }
    place_around(law);
    if (pal_have_avx2()) {
        fill_all_avx2(law);
    } else {
        fill_all(law);
    }
    size_t n = (size_t)law->rows;
    for (size_t s = 0; law->set.symmetric && s < n; s++) {
        for (size_t r = 0; r < s; r++) {
            law->m[r + s * n] = law->m[s + r * n];
        }
    }
}

int32_t pal_anywhere_solve(anywhere_law *law) {
    const pal_friction problem = {.points = law->points,
                                  .rows = law->rows,
                                  .m = law->m,
                                  .ld = law->rows,
                                  .symmetric = law->set.symmetric,
                                  .q = law->q,
                                  .mu = law->mu};
    int32_t most = law->frictional ? FRICTION_ITERATIONS : ITERATIONS;
    pal_friction_result r =
        pal_friction_solve(&problem, most, law->state, law->z, law->w, law->work);
    uint32_t fault = r.state == PALPATE_FRICTION_CUT_OFF    ? PALPATE_FAULT_CUTOFF
                     : r.state == PALPATE_FRICTION_SINGULAR ? PALPATE_FAULT_SINGULAR
                                                            : 0;
    memset(law->before, 0, (size_t)law->capacity * sizeof *law->before);
    memset(law->force_before, 0, 3 * (size_t)law->capacity * sizeof *law->force_before);
    for (int32_t i = 0; i < law->points; i++) {
        const anywhere_point *point = &law->point[i];
        law->before[point->id] = law->state[i];
        for (int32_t a = 0; a < point->rows; a++) {
            law->force_before[3 * (size_t)point->id + (size_t)a] = law->z[point->first + a];
        }
        law->fault[point->tool] |= fault;
    }
    return r.iterations;
}

void pal_anywhere_displacement(anywhere_law *law, int32_t i, double u[3]) {
    const pal_working_set *set = &law->set;
    const anywhere_point *point = &law->point[i];
    size_t n = 3 * (size_t)set->count, ld = (size_t)set->stride;
    double t = law->near.tangent, more = law->near.normal - t;
    u[0] = u[1] = u[2] = 0.0;
    for (size_t c = 0; c < n; c++) { // Phi_i R F
        const double *column = set->block + c * ld;
        double v[3];
        if (law->nodal[c] != 0.0) {
            pal_anywhere_sample(point, column, v);
            for (int k = 0; k < 3; k++) {
                u[k] += v[k] * law->nodal[c];
            }
        }
    }
    for (int32_t p = 0; p < law->points; p++) { // K_ij f_j
        const anywhere_point *j = &law->point[p];
        double near = spread(point, j), f[3] = {0.0, 0.0, 0.0};
        for (int32_t b = 0; b < j->rows; b++) {
            for (int k = 0; k < 3; k++) {
                f[k] += law->z[j->first + b] * j->along[b][k];
            }
        }
        double along = v3_dot(f, j->normal);
        for (int k = 0; k < 3; k++) {
            u[k] += near * (t * f[k] + more * along * point->normal[k]);
        }
    }
}

int32_t pal_anywhere_distribute(anywhere_law *law) {
    const pal_working_set *set = &law->set;
    memset(law->nodal, 0, 3 * (size_t)set->count * sizeof *law->nodal);
    for (int32_t p = 0; p < law->points; p++) {
        const anywhere_point *point = &law->point[p];
        double x = 0.0, y = 0.0, z = 0.0;
        for (int32_t a = 0; a < point->rows; a++) {
            double f = law->z[point->first + a];
            x += f * point->along[a][0];
            y += f * point->along[a][1];
            z += f * point->along[a][2];
        }
        if (x == 0.0 && y == 0.0 && z == 0.0) {
            continue;
        }
        for (int32_t k = 0; k < point->phi.count; k++) {
            double *f = law->nodal + 3 * (size_t)point->slot[k], phi = point->phi.phi[k];
            f[0] += phi * x;
            f[1] += phi * y;
            f[2] += phi * z;
        }
    }
    int32_t count = 0;
    for (int32_t s = 0; s < set->count; s++) {
        const double *f = law->nodal + 3 * (size_t)s;
        for (int i = 0; i < 3; i++) {
            law->dof[count + i] = 3 * set->column[s] + i;
            law->force[count + i] = f[i];
        }
        count += f[0] != 0.0 || f[1] != 0.0 || f[2] != 0.0 ? 3 : 0;
    }
    return count;
}
