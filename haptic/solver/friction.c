/// @file friction.c  Coulomb friction by a semismooth Newton method; proximal points where it
/// cycles.
///
/// 1. Newton. With d_n, d_t the point's own compliances, z = f_n - c_n w_n / d_n and y = f_t - c_t
/// w_t /
///    d_t, the conditions are f_n = max(0, z), f_t = P(y), P: onto the disc of radius mu max(0, z)
///    (Alart, Curnier 1991). Where z <= 0 the point is open: f = 0. Where |y| <= mu z it sticks: w
///    = 0. Else it slips: with d = y / |y| and e across it, linearised,
///        w_n = 0,  f_t = mu f_n d + f_e e,  w_e + g f_e = 0,  g = (1 - b) d_t / (b c_t),  b = mu z
///        / |y|,
///    so that a slipping point adds two unknowns (f_n, f_e), a sticking one three and a
///    frictionless one one. The system B' M A + g, columns A = n + mu d, e and rows B = n, e, is
///    small, positive on the diagonal, and symmetric unless a point slips. Steps are halved until
///    the largest of the last MEMORY residuals is improved (Grippo, Lampariello, Lucidi 1986),
///    quadratic at the end; from the last tick's forces and states one to three steps.
/// 2. Newton again with a smaller c_t, from f = 0: it takes other points for slipping.
/// 3. Proximal points (Rockafellar 1976): f_k+1 solves the same problem with M + a I and q - a f_k,
/// which
///    is close to diagonal for large a, where Newton does not fail; a falls by SHRINK when it did
///    not, and grows when it did. For an associated law this converges for every a; the circular
///    cone's is not associated, and a few problems with strong coupling and large mu are left to
/// 4. continuation in mu, from the frictionless solution.
/// On 1500 problems of condition 1e6 and mu to 1.5, the hardest class, 1 leaves 10 %, 2 cures
/// 60 % of these and 3 all but a few.
///
/// The best iterate, projected on its cones, is kept in the residual of the header.
///
/// Layout of the workspace: system (3m x 3m), vectors of 3m, the workspace of pal_lcp_solve for the
/// frictionless case, points of m, pivots.
#include "haptic/solver/friction.h"

#include <math.h>
#include <string.h>

#include "haptic/solver/complementarity.h"
#include "haptic/base/dense.h"
#include "haptic/base/wide.h"

/// Not hypot(): libm's last bit depends on its version; forces do not overflow.
static double length2(double a, double b) {
    return sqrt(a * a + b * b);
}

enum { PRODUCT = 8 }; // vectors of y in registers
enum { HALVINGS = 7, MEMORY = 4, NEWTON = 30, PROXIMAL = 40, PROXIMAL_STEPS = 20, MU_STEPS = 8 };
static const double TOLERANCE = 1e-9;   // of the residual over || q ||
static const double SHRINK = 0.6;       // of a from one proximal point to the next
static const double FIRST_SHIFT = 1e-2; // a of the first, over the mean of M's diagonal

typedef struct point {
    double dn, dt; ///< own compliance
    double d[2];   ///< slip: direction of f_t
    double mu;     ///< as scaled; < 0: held
    int32_t row;   ///< first row
    int32_t rows;  ///< 1 or 3
    double spring; ///< g
    int32_t at;    ///< first unknown
    uint8_t kind;  ///< pal_friction_point
} point;

typedef struct friction_work {
    const pal_friction *p;
    const double *q; ///< of the problem that Newton solves: p->q, or shifted
    double shift;    ///< a
    double cn, ct;   ///< of z and y
    double norm;     ///< || q || of the header
    double best;     ///< residual of best_f
    double *system, *x, *f, *w, *step, *wstep, *trial, *wtrial, *best_f, *best_w, *moved;
    point *point;
    int32_t *pivot;
    void *lcp;
    int32_t left; ///< iterations
    int singular;
} friction_work;

enum { WORK_VECTORS = 10 };

static size_t lcp_doubles(size_t m) {
    return (pal_lcp_bytes((int32_t)m) + sizeof(double) - 1) / sizeof(double);
}

size_t pal_friction_bytes(int32_t points) {
    size_t m = points > 0 ? (size_t)points : 1, n = 3 * m;
    return (n * n + WORK_VECTORS * n + lcp_doubles(m)) * sizeof(double) + m * sizeof(point) +
           n * sizeof(int32_t);
}

static void place(friction_work *s, int32_t points, void *memory) {
    size_t m = points > 0 ? (size_t)points : 1, n = 3 * m;
    double *at = memory;
    s->system = at;
    at += n * n;
    double **vector[WORK_VECTORS] = {&s->x,     &s->f,      &s->w,      &s->step,   &s->wstep,
                                     &s->trial, &s->wtrial, &s->best_f, &s->best_w, &s->moved};
    for (int i = 0; i < WORK_VECTORS; i++, at += n) {
        *vector[i] = at;
    }
    s->lcp = at;
    s->point = (point *)(void *)(at + lcp_doubles(m));
    s->pivot = (int32_t *)(void *)(s->point + m);
}

/// Rows i .. of y = (M + shift) f: `vectors` x PALPATE_LANES of them.
PALPATE_INLINE void product_tile(const int vectors, const pal_friction *p, double shift,
                                 const double *f, double *y, int32_t i) {
    pal_lanes sum[PRODUCT];
    PALPATE_UNROLL
    for (int h = 0; h < vectors; h++) {
        PALPATE_LOAD(sum[h], f + i + PALPATE_LANES * h);
        sum[h] *= shift;
    }
    for (int32_t j = 0; j < p->rows; j++) {
        const double *column = p->m + (size_t)j * (size_t)p->ld + i;
        if (f[j] != 0) {
            const pal_lanes fj = PALPATE_FILL(f[j]);
            PALPATE_UNROLL
            for (int h = 0; h < vectors; h++) {
                pal_lanes c;
                PALPATE_LOAD(c, column + PALPATE_LANES * h);
                sum[h] += c * fj;
            }
        }
    }
    PALPATE_UNROLL
    for (int h = 0; h < vectors; h++) {
        PALPATE_STORE(y + i + PALPATE_LANES * h, sum[h]);
    }
}

PALPATE_INLINE void product_tiles(const pal_friction *p, double shift, const double *f, double *y) {
    int32_t n = p->rows, i = 0;
    for (; i + PRODUCT * PALPATE_LANES <= n; i += PRODUCT * PALPATE_LANES) {
        product_tile(PRODUCT, p, shift, f, y, i);
    }
    for (; i + PRODUCT / 2 * PALPATE_LANES <= n; i += PRODUCT / 2 * PALPATE_LANES) {
        product_tile(PRODUCT / 2, p, shift, f, y, i);
    }
    for (; i + PALPATE_LANES <= n; i += PALPATE_LANES) {
        product_tile(1, p, shift, f, y, i);
    }
    for (; i < n; i++) {
        double sum = shift * f[i];
        for (int32_t j = 0; j < n; j++) {
            sum = f[j] != 0 ? sum + p->m[(size_t)i + (size_t)j * (size_t)p->ld] * f[j] : sum;
        }
        y[i] = sum;
    }
}

PALPATE_AVX2 static void product_avx2(const pal_friction *p, double shift, const double *f,
                                      double *y) {
    product_tiles(p, shift, f, y);
}

/// y = (M + shift) f; y may not be f. Every element is summed over the columns in their order.
static void product(const pal_friction *p, double shift, const double *f, double *y) {
    if (pal_have_avx2()) {
        product_avx2(p, shift, f, y);
    } else {
        product_tiles(p, shift, f, y);
    }
}

static void gap(const pal_friction *p, double shift, const double *q, const double *f, double *w) {
    product(p, shift, f, w);
    for (int32_t i = 0; i < p->rows; i++) {
        w[i] += q[i];
    }
}

/// Onto the disc of radius r >= 0.
static void disc(double r, double v[2]) {
    double size = length2(v[0], v[1]);
    if (size > r) {
        double scale = r / size;
        v[0] *= scale;
        v[1] *= scale;
        // the product may round outwards: keep the promise |f_t| <= mu f_n
        while (length2(v[0], v[1]) > r) {
            v[0] *= 1 - 2e-16;
            v[1] *= 1 - 2e-16;
        }
    }
}

/// || F(f) || / || q || of the map that Newton solves; with c = 1 and f in its cones it is zero
/// with the header's.
static double merit(const friction_work *s, const double *force, const double *gaps) {
    double sum = 0;
    for (int32_t i = 0; i < s->p->points; i++) {
        const point *c = &s->point[i];
        const double *f = force + c->row, *w = gaps + c->row;
        if (c->mu < 0) {
            sum += w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
            continue;
        }
        double z = c->dn * f[0] - s->cn * w[0], r = z > 0 ? c->dn * f[0] - z : c->dn * f[0];
        sum += r * r;
        if (c->mu > 0) {
            double y[2] = {c->dt * f[1] - s->ct * w[1], c->dt * f[2] - s->ct * w[2]};
            double size = length2(y[0], y[1]), radius = z > 0 ? c->mu * c->dt * z / c->dn : 0;
            double scale = size > radius ? radius / size : 1;
            double r1 = c->dt * f[1] - scale * y[0], r2 = c->dt * f[2] - scale * y[1];
            sum += r1 * r1 + r2 * r2;
        }
    }
    return sqrt(sum) / s->norm;
}

/// The header's residual of f in its cones.
static double natural_residual(const friction_work *s, const double *force, const double *gaps) {
    double sum = 0;
    for (int32_t i = 0; i < s->p->points; i++) {
        const point *c = &s->point[i];
        const double *f = force + c->row, *w = gaps + c->row;
        if (c->mu < 0) {
            sum += w[0] * w[0] + w[1] * w[1] + w[2] * w[2];
            continue;
        }
        double r = c->dn * f[0] < w[0] ? c->dn * f[0] : w[0];
        sum += r * r;
        if (c->mu > 0) {
            double y[2] = {c->dt * f[1] - w[1], c->dt * f[2] - w[2]};
            disc(c->mu * c->dt * f[0], y);
            double r1 = c->dt * f[1] - y[0], r2 = c->dt * f[2] - y[1];
            sum += r1 * r1 + r2 * r2;
        }
    }
    return sqrt(sum) / s->norm;
}

/// Project f on its cones.
static void project(const friction_work *s, const double *from, double *to) {
    memcpy(to, from, (size_t)s->p->rows * sizeof *to);
    for (int32_t i = 0; i < s->p->points; i++) {
        const point *c = &s->point[i];
        double *f = to + c->row;
        if (c->mu >= 0) {
            f[0] = f[0] > 0 ? f[0] : 0;
        }
        if (c->mu > 0) {
            disc(c->mu * f[0], f + 1);
        }
    }
}

/// Keep f, projected, when it is the best of the problem given. Uses s->trial, s->wtrial.
/// @return its residual
static double keep_best(friction_work *s, const double *f) {
    project(s, f, s->trial);
    gap(s->p, 0, s->p->q, s->trial, s->wtrial);
    double residual = natural_residual(s, s->trial, s->wtrial);
    if (residual < s->best) {
        s->best = residual;
        memcpy(s->best_f, s->trial, (size_t)s->p->rows * sizeof *f);
        memcpy(s->best_w, s->wtrial, (size_t)s->p->rows * sizeof *f);
    }
    return residual;
}

/// What every point does at f, w. @param hint  states to take instead, or NULL
/// @return the unknowns; *symmetric when no point with friction slips
static int32_t predict(friction_work *s, const uint8_t *hint, int *symmetric) {
    int32_t unknowns = 0;
    *symmetric = s->p->symmetric;
    for (int32_t i = 0; i < s->p->points; i++) {
        point *c = &s->point[i];
        const double *f = s->f + c->row, *w = s->w + c->row;
        c->at = unknowns;
        if (c->mu < 0) {
            c->kind = PALPATE_POINT_STICK;
            unknowns += 3;
            continue;
        }
        double z = f[0] - s->cn * w[0] / c->dn;
        c->kind = PALPATE_POINT_OPEN;
        int touches = z > 0 || (hint != NULL && hint[i] != PALPATE_POINT_OPEN);
        if (!touches) {
            continue;
        }
        if (!(c->mu > 0)) {
            c->kind = PALPATE_POINT_SLIP;
            unknowns += 1;
            continue;
        }
        double y[2] = {f[1] - s->ct * w[1] / c->dt, f[2] - s->ct * w[2] / c->dt};
        double size = length2(y[0], y[1]), radius = c->mu * (z > 0 ? z : 0);
        int sticks = hint != NULL && hint[i] != PALPATE_POINT_OPEN ? hint[i] == PALPATE_POINT_STICK
                                                                   : size <= radius;
        if (sticks || !(size > 0)) {
            c->kind = PALPATE_POINT_STICK;
            unknowns += 3;
            continue;
        }
        c->kind = PALPATE_POINT_SLIP;
        c->d[0] = y[0] / size;
        c->d[1] = y[1] / size;
        double b = radius < size ? radius / size : 1; // hint: |y| may be inside
        c->spring = b > 1e-12 ? (1 - b) * c->dt / (b * s->ct) : 1e12 * c->dt / s->ct;
        unknowns += 2;
        *symmetric = 0;
    }
    return unknowns;
}

/// B' v of the rows v of point `c`. @return their number
static inline int32_t rows_of(const point *c, const double *v, double *to) {
    to[0] = v[0];
    if (c->kind == PALPATE_POINT_STICK) {
        to[1] = v[1];
        to[2] = v[2];
        return 3;
    }
    if (c->rows == 3) {
        to[1] = c->d[0] * v[2] - c->d[1] * v[1];
        return 2;
    }
    return 1;
}

/// M A of a slipping point: along = m_n + mu (d_1 m_1 + d_2 m_2), across = d_1 m_2 - d_2 m_1, n
/// rows (m_1 and m_2 follow m_n, `ld` apart).
PALPATE_INLINE void slip_columns(int32_t n, const double *m, size_t ld, double mu,
                                 const double d[2], double *along, double *across) {
    int32_t i = 0;
    for (; i + PALPATE_LANES <= n; i += PALPATE_LANES) {
        pal_lanes a, t1, t2;
        PALPATE_LOAD(a, m + i);
        PALPATE_LOAD(t1, m + ld + i);
        PALPATE_LOAD(t2, m + 2 * ld + i);
        a = a + mu * (d[0] * t1 + d[1] * t2);
        t2 = d[0] * t2 - d[1] * t1;
        PALPATE_STORE(along + i, a);
        PALPATE_STORE(across + i, t2);
    }
    for (; i < n; i++) {
        double t1 = m[ld + (size_t)i], t2 = m[2 * ld + (size_t)i];
        along[i] = m[i] + mu * (d[0] * t1 + d[1] * t2);
        across[i] = d[0] * t2 - d[1] * t1;
    }
}

PALPATE_AVX2 static void slip_columns_avx2(int32_t n, const double *m, size_t ld, double mu,
                                           const double d[2], double *along, double *across) {
    slip_columns(n, m, ld, mu, d, along, across);
}

/// B' of a column of M or M A.
static void project_rows(const friction_work *s, const double *column, double *to) {
    for (int32_t i = 0; i < s->p->points; i++) {
        const point *r = &s->point[i];
        if (r->kind != PALPATE_POINT_OPEN) {
            rows_of(r, column + r->row, to + r->at);
        }
    }
}

/// The system of the states predicted, and x = -B' q. Uses s->step, s->wstep.
static void assemble(friction_work *s, int32_t unknowns) {
    const pal_friction *p = s->p;
    size_t ld = (size_t)p->ld, k = (size_t)unknowns;
    for (int32_t j = 0; j < p->points; j++) {
        const point *c = &s->point[j];
        if (c->kind == PALPATE_POINT_OPEN) {
            continue;
        }
        const double *m = p->m + (size_t)c->row * ld, *q = s->q + c->row;
        double *to = s->system + (size_t)c->at * k;
        if (c->kind == PALPATE_POINT_STICK || c->rows == 1) {
            for (int32_t l = 0; l < c->rows; l++) {
                project_rows(s, m + (size_t)l * ld, to + (size_t)l * k);
            }
        } else {
            (pal_have_avx2() ? slip_columns_avx2 : slip_columns)(p->rows, m, ld, c->mu, c->d,
                                                                 s->step, s->wstep);
            project_rows(s, s->step, to);
            project_rows(s, s->wstep, to + k);
        }
        // a on M's diagonal: B' A of the point's own rows is the unit matrix
        to += c->at;
        to[0] += s->shift;
        if (c->kind == PALPATE_POINT_STICK) {
            to[1 + k] += s->shift;
            to[2 + 2 * k] += s->shift;
        } else if (c->rows == 3) {
            to[1 + k] += s->shift + c->spring;
        }
        double minus[3] = {-q[0], c->rows == 3 ? -q[1] : 0, c->rows == 3 ? -q[2] : 0};
        rows_of(c, minus, s->x + c->at);
    }
}

/// The Newton point into s->step (still a point, not a step). @return 0, or -1: singular
static int newton_point(friction_work *s, const uint8_t *hint) {
    int symmetric;
    int32_t unknowns = predict(s, hint, &symmetric), failed = unknowns > 0;
    for (; symmetric >= 0 && failed != 0; symmetric--) {
        assemble(s, unknowns);
        if (symmetric) {
            failed = pal_dense_cholesky(unknowns, 0, s->system, unknowns);
            if (failed == 0) {
                pal_dense_cholesky_solve(unknowns, s->system, unknowns, 1, s->x, unknowns);
            }
        } else {
            failed = pal_dense_lu(unknowns, s->system, unknowns, s->pivot);
            if (failed == 0) {
                pal_dense_lu_solve(unknowns, s->system, unknowns, s->pivot, 1, s->x, unknowns);
            }
        }
    }
    for (int32_t i = 0; i < unknowns && failed == 0; i++) {
        failed = !isfinite(s->x[i]);
    }
    if (failed != 0) {
        s->singular = 1;
        return -1;
    }
    for (int32_t i = 0; i < s->p->points; i++) {
        const point *c = &s->point[i];
        const double *x = s->x + c->at;
        double *to = s->step + c->row;
        if (c->kind == PALPATE_POINT_OPEN) {
            memset(to, 0, (size_t)c->rows * sizeof *to);
            continue;
        }
        to[0] = x[0];
        if (c->kind == PALPATE_POINT_STICK) {
            to[1] = x[1];
            to[2] = x[2];
        } else if (c->rows == 3) {
            to[1] = c->mu * x[0] * c->d[0] - x[1] * c->d[1];
            to[2] = c->mu * x[0] * c->d[1] + x[1] * c->d[0];
        }
    }
    return 0;
}

/// trial = f + length step, wtrial its gaps.
static void try_step(friction_work *s, double length) {
    for (int32_t i = 0; i < s->p->rows; i++) {
        s->trial[i] = s->f[i] + length * s->step[i];
        s->wtrial[i] = s->w[i] + length * s->wstep[i];
    }
}

/// Newton on (M + shift, s->q) from s->f, at most `steps`. @return 1 when solved
static int newton(friction_work *s, int32_t steps, const uint8_t *hint) {
    int32_t n = s->p->rows;
    double last[MEMORY];
    gap(s->p, s->shift, s->q, s->f, s->w);
    double now = merit(s, s->f, s->w);
    for (int32_t it = 0; it < steps && s->left > 0; it++) {
        if (now <= TOLERANCE) {
            return 1;
        }
        s->left--;
        if (newton_point(s, it == 0 ? hint : NULL) != 0) {
            return 0;
        }
        double most =
            it > 0 || hint == NULL ? 0 : HUGE_VAL; // the states hinted at are trusted once
        last[it % MEMORY] = now;
        for (int32_t i = 0; i < MEMORY && i <= it && most < HUGE_VAL; i++) {
            most = last[i] > most ? last[i] : most;
        }
        for (int32_t i = 0; i < n; i++) {
            s->step[i] -= s->f[i];
        }
        product(s->p, s->shift, s->step, s->wstep);
        double least = HUGE_VAL, length = 1, taken = 1;
        for (int k = 0; k < HALVINGS; k++, length *= 0.5) {
            try_step(s, length);
            double value = merit(s, s->trial, s->wtrial);
            if (value < least) {
                least = value;
                taken = length;
            }
            if (value < 0.999 * most) {
                break;
            }
        }
        if (!(least < HUGE_VAL)) {
            return 0;
        }
        // w goes along; what rounding adds to it is seen by keep_best, which takes it anew
        try_step(s, taken);
        memcpy(s->f, s->trial, (size_t)n * sizeof *s->f);
        memcpy(s->w, s->wtrial, (size_t)n * sizeof *s->w);
        now = least;
    }
    return now <= TOLERANCE;
}

static void proximal(friction_work *s) {
    int32_t n = s->p->rows;
    double mean = 0;
    for (int32_t i = 0; i < s->p->points; i++) {
        mean += s->point[i].dn / s->p->points;
    }
    double a = FIRST_SHIFT * mean;
    memset(s->f, 0, (size_t)n * sizeof *s->f);
    for (int32_t k = 0; k < PROXIMAL && s->left > 0 && s->best > TOLERANCE; k++) {
        s->shift = a;
        for (int32_t i = 0; i < n; i++) {
            s->moved[i] = s->p->q[i] - a * s->f[i];
        }
        s->q = s->moved;
        int solved = newton(s, PROXIMAL_STEPS, NULL);
        a *= solved ? SHRINK : 2;
        keep_best(s, s->f);
    }
    s->shift = 0;
    s->q = s->p->q;
}

static void raise_mu(friction_work *s) {
    memset(s->f, 0, (size_t)s->p->rows * sizeof *s->f);
    for (int32_t k = 1; k <= MU_STEPS && s->left > 0; k++) {
        for (int32_t i = 0; i < s->p->points; i++) {
            s->point[i].mu = s->p->mu[i] < 0 ? -1 : s->p->mu[i] * k / MU_STEPS;
        }
        newton(s, NEWTON, NULL);
    }
    for (int32_t i = 0; i < s->p->points; i++) {
        s->point[i].mu = s->p->mu[i];
    }
    keep_best(s, s->f);
}

/// The states of best_f, from its forces.
static void finish(friction_work *s, uint8_t *state, double *f, double *w) {
    for (int32_t i = 0; i < s->p->points; i++) {
        const point *c = &s->point[i];
        const double *a = s->best_f + c->row;
        int sticks = c->mu < 0 || (c->mu > 0 && length2(a[1], a[2]) < c->mu * a[0] * (1 - 1e-9));
        state[i] = sticks     ? PALPATE_POINT_STICK
                   : a[0] > 0 ? PALPATE_POINT_SLIP
                              : PALPATE_POINT_OPEN;
    }
    memcpy(f, s->best_f, (size_t)s->p->rows * sizeof *f);
    memcpy(w, s->best_w, (size_t)s->p->rows * sizeof *f);
}

static pal_friction_result solve_frictionless(const friction_work *s, int32_t max_iterations,
                                              uint8_t *state, double *f, double *w) {
    const pal_friction *p = s->p;
    pal_lcp lcp = {.n = p->points, .m = p->m, .ld = p->ld, .symmetric = p->symmetric, .q = p->q};
    pal_lcp_result r = pal_lcp_solve(&lcp, max_iterations, state, f, w, s->lcp);
    for (int32_t i = 0; i < p->points; i++) {
        state[i] = f[i] > 0 ? PALPATE_POINT_SLIP : PALPATE_POINT_OPEN;
    }
    return (pal_friction_result){(pal_friction_state)r.state, r.iterations, r.residual};
}

pal_friction_result pal_friction_solve(const pal_friction *problem, int32_t max_iterations,
                                       uint8_t *state, double *f, double *w, void *work) {
    const pal_friction *p = problem;
    pal_friction_result result = {PALPATE_FRICTION_SOLVED, 0, 0};
    if (p->points < 1) {
        return result;
    }
    size_t n = (size_t)p->rows, ld = (size_t)p->ld;
    friction_work s = {.p = p, .q = p->q, .cn = 1, .ct = 1, .left = max_iterations};
    place(&s, p->points, work);
    int touching = 0;
    int32_t row = 0;
    double norm = 0;
    for (int32_t i = 0; i < p->points; i++) {
        const double *own = p->m + (size_t)row * (ld + 1);
        point *c = &s.point[i];
        *c = (point){.dn = own[0], .mu = p->mu[i], .row = row, .rows = 1};
        if (c->mu > 0 || c->mu < 0) {
            c->rows = 3;
            c->dt = (own[ld + 1] + own[2 * ld + 2]) / 2;
        }
        touching |= state[i] != PALPATE_POINT_OPEN;
        row += c->rows;
    }
    if (p->rows == p->points) {
        return solve_frictionless(&s, max_iterations, state, f, w);
    }
    for (size_t i = 0; i < n; i++) {
        norm += p->q[i] * p->q[i];
    }
    s.norm = norm > 0 ? sqrt(norm) : 1;
    s.best = HUGE_VAL;
    memcpy(s.f, f, n * sizeof *f);
    memset(s.best_f, 0, n * sizeof *f);
    memcpy(s.best_w, p->q, n * sizeof *f);
    if (!(keep_best(&s, s.f) <= TOLERANCE)) { // else the start is the solution
        newton(&s, NEWTON, touching ? state : NULL);
        keep_best(&s, s.f);
    }
    if (s.best > TOLERANCE) { // no worse than f = 0
        memset(s.f, 0, n * sizeof *f);
        keep_best(&s, s.f);
    }
    if (s.best > TOLERANCE && s.left > 0) {
        s.ct = 0.1;
        newton(&s, NEWTON, NULL);
        keep_best(&s, s.f);
        s.ct = 1;
    }
    if (s.best > TOLERANCE && s.left > 0) {
        proximal(&s);
    }
    if (s.best > TOLERANCE && s.left > 0) {
        raise_mu(&s);
    }
    finish(&s, state, f, w);
    result.iterations = max_iterations - s.left;
    result.residual = s.best;
    if (!(s.best <= TOLERANCE)) {
        result.state = s.singular ? PALPATE_FRICTION_SINGULAR : PALPATE_FRICTION_CUT_OFF;
    }
    return result;
}
