/// @file mls.c  MLS shape functions by elimination of the nearest node.
///
/// Source: De, Hong, Bathe 2003, section 3.3 (Eqs. 36-40); derivatives at nodes: design 2.1.
///
/// Singular weights make A(x) blow up at a node. Let K be the node nearest to x, take monomials
/// centred there, p = (1, q), q_K = 0, and eliminate the constant. With g = 1 / W_K, which is
/// smooth and vanishes at x_K as s^2p, sums over J != K, and
///
///     a00 = sum W_J,   a0 = sum W_J q_J,   e = g / (1 + g a00),
///     M~ = sum W_J q_J q_J^T - e a0 a0^T,
///     M~ c = q(x) - e a0,   c0 = e - e a0 . c
///
/// the shape functions are h_J = W_J (c0 + q_J . c) and h_K = 1 - sum h_J. Nothing here is singular
/// at the node: for x = x_K (g = 0) it is the constrained local fit of design 2.1, and
/// differentiating these lines gives the full derivatives at nodes and off them with one formula:
///
///     M~ c_i  = q_i  - (e a0)_i - M~_i c
///     M~ c_ij = q_ij - (e a0)_ij - M~_ij c - M~_i c_j - M~_j c_i
///
/// (p = 1 included, where e_ij = 2 delta_ij / r^2 at the node adds to the second derivatives). The
/// diffuse derivatives drop every derivative of a weight.
///
/// M~ is never formed in raw monomials: it is the Gram matrix of the rows sqrt(W_J) (q_J - e a0)
/// and sqrt(g) / (1 + g a00) a0, whose pivoted QR gives rank and condition; q is then replaced by
/// the polynomials that R^-T makes of it, in which M~ = I up to rounding, and one Cholesky step on
/// the remaining Gram matrix makes it I to the last bits. Every solve above disappears.
///
/// Coordinates are scaled by the stencil radius and centred at x_K; degrees are scaled apart, so
/// that the rank decision is invariant under rotation and scaling and never blows a flat direction
/// up.
#include "src/discretization/mls.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "haptic/base/error.h"
#include "src/base/dense_small.h"
#include "src/discretization/mls_weight.h"

enum { COLUMNS_MAX = 19, TERMS = 10 }; // value, 3 first, 6 second derivatives

/// |R_kk| below this times |R_00| is rank deficiency: a stencil that is flat to 1e-9 of its size.
static const double rank_tolerance = 1e-9;
/// Nodes closer than this (of the radius) to an evaluated node coincide with it.
static const double coincidence = 1e-10;

static const int8_t power[COLUMNS_MAX][3] = {
    {1, 0, 0}, {0, 1, 0}, {0, 0, 1},                                             //
    {2, 0, 0}, {1, 1, 0}, {1, 0, 1}, {0, 2, 0}, {0, 1, 1}, {0, 0, 2},            //
    {3, 0, 0}, {2, 1, 0}, {2, 0, 1}, {1, 2, 0}, {1, 1, 1}, {1, 0, 2}, {0, 3, 0}, //
    {0, 2, 1}, {0, 1, 2}, {0, 0, 3},
};
/// Second derivative m is d_first d_second: xx xy xz yy yz zz.
static const int8_t pair_first[6] = {0, 0, 0, 1, 1, 2};
static const int8_t pair_second[6] = {0, 1, 2, 1, 2, 2};

int32_t pal_basis_size(pal_basis basis) {
    return basis == PALPATE_BASIS_CUBIC ? 20 : basis == PALPATE_BASIS_QUADRATIC ? 10 : 4;
}

int32_t pal_basis_neighbours(pal_basis basis) {
    return basis == PALPATE_BASIS_CUBIC ? 100 : basis == PALPATE_BASIS_QUADRATIC ? 60 : 24;
}

/// ---- Workspace -----------------------------------------------------------------------------

/// Doubles of work per node: polynomials, weights, QR rows, y.
enum { WORK_PER_NODE = COLUMNS_MAX + TERMS + COLUMNS_MAX + TERMS };

pal_status pal_mls_reserve(pal_mls *mls, int32_t count) {
    if (count <= mls->capacity) {
        return PALPATE_OK;
    }
    size_t n = (size_t)count + (size_t)count / 2 + 8;
    size_t doubles = n * (WORK_PER_NODE + 1 + 3 + 1 + 3 + 6) + COLUMNS_MAX;
    double *block = malloc(doubles * sizeof(double) + n * sizeof(int32_t));
    if (block == NULL) {
        return PALPATE_ERROR_MEMORY;
    }
    free(mls->block);
    mls->block = block;
    mls->capacity = (int32_t)n;
    mls->count = 0;
    mls->work = block;
    mls->distance2 = mls->work + n * WORK_PER_NODE + COLUMNS_MAX; // one more QR row
    mls->position = mls->distance2 + n;
    mls->phi = mls->position + 3 * n;
    mls->dphi = mls->phi + n;
    mls->d2phi = mls->dphi + 3 * n;
    mls->node = (int32_t *)(void *)(mls->d2phi + 6 * n);
    return PALPATE_OK;
}

void pal_mls_clear(pal_mls *mls) {
    free(mls->block);
    memset(mls, 0, sizeof *mls);
}

/// ---- Monomials and weights -----------------------------------------------------------------

/// Monomials without the constant at xi.
static void monomials(int32_t columns, const double xi[3], double *q) {
    double x = xi[0], y = xi[1], z = xi[2];
    q[0] = x;
    q[1] = y;
    q[2] = z;
    if (columns > 3) {
        q[3] = x * x;
        q[4] = x * y;
        q[5] = x * z;
        q[6] = y * y;
        q[7] = y * z;
        q[8] = z * z;
    }
    if (columns > 9) {
        q[9] = x * q[3];
        q[10] = y * q[3];
        q[11] = z * q[3];
        q[12] = x * q[6];
        q[13] = x * q[7];
        q[14] = x * q[8];
        q[15] = y * q[6];
        q[16] = z * q[6];
        q[17] = y * q[8];
        q[18] = z * q[8];
    }
}

/// The derivative of a monomial, `take` times in each direction.
static double monomial_derivative(const int8_t exponent[3], const int take[3], const double xi[3]) {
    double value = 1.0;
    for (int a = 0; a < 3; a++) {
        int n = exponent[a];
        for (int t = 0; t < take[a]; t++) {
            value *= n--;
        }
        for (; n > 0; n--) {
            value *= xi[a];
        }
    }
    return value;
}

/// ---- Small vectors -------------------------------------------------------------------------

static double dot(int32_t n, const double *a, const double *b) {
    double sum = 0.0;
    for (int32_t i = 0; i < n; i++) {
        sum += a[i] * b[i];
    }
    return sum;
}

static void add(int32_t n, double alpha, const double *x, double *y) {
    for (int32_t i = 0; i < n; i++) {
        y[i] += alpha * x[i];
    }
}

/// ---- One evaluation ------------------------------------------------------------------------

/// Everything of one evaluation; arrays over the stencil live in the workspace.
typedef struct fit {
    const pal_mls_options *options;
    int32_t count, columns, rank, centre;
    int32_t order;        ///< of the result
    int32_t weight_order; ///< highest derivative of the weights that is needed
    double *q;            ///< (count x COLUMNS_MAX) polynomials at the nodes
    double *w;            ///< (count x TERMS) weights; the centre's row is zero
    double *y;            ///< (count x TERMS) c0 + q_J . c and derivatives
    double *rows;         ///< QR workspace, column-major, (count) x columns
    double g[TERMS];      ///< 1 / W_K
    double e[TERMS];
    double a00[TERMS];
    double a0[TERMS][COLUMNS_MAX];
    double h[TERMS][COLUMNS_MAX];  ///< e a0
    double qx[TERMS][COLUMNS_MAX]; ///< polynomials at x
    double c[TERMS][COLUMNS_MAX];
    double c0[TERMS];
} fit;

/// Second derivative of a product u v from the terms of u and v.
static double product_second(const double *u, const double *v, int m) {
    int i = pair_first[m], j = pair_second[m];
    return u[4 + m] * v[0] + u[1 + i] * v[1 + j] + u[1 + j] * v[1 + i] + u[0] * v[4 + m];
}

/// a00 and a0 with derivatives, e, h = e a0. `q` may be in any polynomials.
static void moments(fit *f) {
    int terms = f->weight_order == 0 ? 1 : f->weight_order == 1 ? 4 : TERMS;
    memset(f->a00, 0, sizeof f->a00);
    memset(f->a0, 0, sizeof f->a0);
    for (int32_t j = 0; j < f->count; j++) {
        const double *w = f->w + j * TERMS;
        const double *q = f->q + j * COLUMNS_MAX;
        for (int t = 0; t < terms; t++) {
            f->a00[t] += w[t];
            add(f->rank, w[t], q, f->a0[t]);
        }
    }
    double d[TERMS] = {0}; // 1 + g a00
    memset(f->e, 0, sizeof f->e);
    memset(f->h, 0, sizeof f->h);
    d[0] = 1.0 + f->g[0] * f->a00[0];
    f->e[0] = f->g[0] / d[0];
    for (int32_t c = 0; c < f->rank; c++) {
        f->h[0][c] = f->e[0] * f->a0[0][c];
    }
    for (int i = 1; i < 4 && terms > 1; i++) {
        d[i] = f->g[i] * f->a00[0] + f->g[0] * f->a00[i];
        f->e[i] = (f->g[i] - f->e[0] * d[i]) / d[0];
        for (int32_t c = 0; c < f->rank; c++) {
            f->h[i][c] = f->e[i] * f->a0[0][c] + f->e[0] * f->a0[i][c];
        }
    }
    for (int m = 0; m < 6 && terms > 4; m++) {
        int i = pair_first[m], j = pair_second[m];
        d[4 + m] = product_second(f->g, f->a00, m);
        f->e[4 + m] =
            (f->g[4 + m] - f->e[1 + i] * d[1 + j] - f->e[1 + j] * d[1 + i] - f->e[0] * d[4 + m]) /
            d[0];
        for (int32_t c = 0; c < f->rank; c++) {
            f->h[4 + m][c] = f->e[4 + m] * f->a0[0][c] + f->e[1 + i] * f->a0[1 + j][c] +
                             f->e[1 + j] * f->a0[1 + i][c] + f->e[0] * f->a0[4 + m][c];
        }
    }
}

/// v <- T v: raw monomials into orthonormal polynomials. `inverse` is R^-1 (row-major, rank x
/// rank).
static void transform(const fit *f, const double *scale, const int32_t *pivot,
                      const double *inverse, double *v) {
    double permuted[COLUMNS_MAX];
    for (int32_t c = 0; c < f->rank; c++) {
        permuted[c] = v[pivot[c]] * scale[pivot[c]];
    }
    memset(v, 0, (size_t)f->columns * sizeof *v);
    for (int32_t i = 0; i < f->rank; i++) { // v = R^-T permuted
        // NOLINTNEXTLINE(*.CallAndMessage): rank of them are set above
        add(f->rank - i, permuted[i], inverse + i * f->rank + i, v + i);
    }
}

/// v <- L^-1 v, row-major lower triangle.
static void lower_solve(int32_t n, const double *l, double *v) {
    for (int32_t i = 0; i < n; i++) {
        v[i] = (v[i] - dot(i, l + i * COLUMNS_MAX, v)) / l[i * COLUMNS_MAX + i];
    }
}

/// Replace the monomials by polynomials in which M~ is the identity.
/// @return 0 when the stencil does not support the basis
static int orthonormalize(fit *f, pal_mls_info *info) {
    int32_t n = f->columns;
    f->rank = n;
    int32_t weight_order = f->weight_order;
    f->weight_order = 0;
    moments(f);
    // rows of the weighted, centred problem; the centre's row holds the eliminated constant
    int32_t ld = f->count;
    double norm[4] = {0};
    for (int32_t j = 0; j < f->count; j++) {
        double root = sqrt(f->w[j * TERMS]);
        double tail = sqrt(f->g[0]) / (1.0 + f->g[0] * f->a00[0]);
        for (int32_t c = 0; c < n; c++) {
            f->rows[c * ld + j] = j == f->centre ? tail * f->a0[0][c]
                                                 : root * (f->q[j * COLUMNS_MAX + c] - f->h[0][c]);
        }
    }
    // one scale for each degree
    double scale[COLUMNS_MAX];
    for (int32_t c = 0; c < n; c++) {
        int degree = c < 3 ? 1 : c < 9 ? 2 : 3;
        double square = dot(f->count, f->rows + c * ld, f->rows + c * ld);
        norm[degree] = fmax(norm[degree], square);
    }
    for (int32_t c = 0; c < n; c++) {
        double most = norm[c < 3 ? 1 : c < 9 ? 2 : 3];
        scale[c] = most > 0.0 ? 1.0 / sqrt(most) : 1.0;
        for (int32_t j = 0; j < f->count; j++) {
            f->rows[c * ld + j] *= scale[c];
        }
    }
    int32_t pivot[COLUMNS_MAX];
    f->rank = pal_small_qr(f->count, n, f->rows, ld, pivot, rank_tolerance);
    info->rank = f->rank;
    info->columns = n;
    info->condition = INFINITY;
    if (f->rank < n && !f->options->accept_deficient) {
        return 0;
    }
    double inverse[COLUMNS_MAX * COLUMNS_MAX];
    pal_small_triangle_inverse(f->rank, f->rows, ld, inverse);
    double forward = 0.0, backward = 0.0;
    for (int32_t c = 0; c < f->rank; c++) {
        forward += dot(c + 1, f->rows + c * ld, f->rows + c * ld);
    }
    backward = dot(f->rank * f->rank, inverse, inverse);
    if (f->rank > 0) {
        info->condition = forward * backward / ((double)f->rank * f->rank);
    }
    for (int32_t j = 0; j < f->count; j++) {
        transform(f, scale, pivot, inverse, f->q + j * COLUMNS_MAX);
    }
    for (int t = 0; t < TERMS; t++) {
        transform(f, scale, pivot, inverse, f->qx[t]);
    }
    // second pass: what rounding left of M~ - I
    moments(f);
    double gram[COLUMNS_MAX * COLUMNS_MAX] = {0};
    double tail = f->g[0] / ((1.0 + f->g[0] * f->a00[0]) * (1.0 + f->g[0] * f->a00[0]));
    for (int32_t j = 0; j < f->count; j++) {
        double row[COLUMNS_MAX];
        double weight = f->w[j * TERMS];
        for (int32_t c = 0; c < f->rank; c++) {
            row[c] = f->q[j * COLUMNS_MAX + c] - f->h[0][c];
        }
        if (j == f->centre) {
            memcpy(row, f->a0[0], sizeof row);
            weight = tail;
        }
        for (int32_t c = 0; c < f->rank; c++) {
            add(c + 1, weight * row[c], row, gram + c * COLUMNS_MAX);
        }
    }
    if (!pal_small_cholesky(f->rank, gram, COLUMNS_MAX)) {
        return 0;
    }
    for (int32_t j = 0; j < f->count; j++) {
        lower_solve(f->rank, gram, f->q + j * COLUMNS_MAX);
    }
    for (int t = 0; t < TERMS; t++) {
        lower_solve(f->rank, gram, f->qx[t]);
    }
    f->weight_order = weight_order;
    return 1;
}

/// c and c0 with derivatives; y_J = c0 + q_J . c with derivatives.
static void solve(fit *f) {
    int32_t n = f->rank;
    int first = f->order > 0;
    int second = f->order > 1;
    memset(f->c, 0, sizeof f->c);
    memset(f->c0, 0, sizeof f->c0);
    for (int32_t i = 0; i < n; i++) {
        f->c[0][i] = f->qx[0][i] - f->h[0][i];
    }
    f->c0[0] = f->e[0] - dot(n, f->h[0], f->c[0]);
    for (int32_t j = 0; j < f->count; j++) {
        f->y[j * TERMS] = dot(n, f->q + j * COLUMNS_MAX, f->c[0]);
    }
    double p[TERMS] = {0};  // a0_t . c
    double r[4][4] = {{0}}; // a0_t . c_i
    for (int t = 0; t < TERMS; t++) {
        p[t] = dot(n, f->a0[t], f->c[0]);
    }
    if (first) {
        for (int i = 0; i < 3; i++) {
            double *c = f->c[1 + i];
            for (int32_t k = 0; k < n; k++) {
                c[k] = f->qx[1 + i][k] - f->h[1 + i][k];
            }
            if (f->weight_order > 0) {
                for (int32_t j = 0; j < f->count; j++) {
                    add(n, -f->w[j * TERMS + 1 + i] * f->y[j * TERMS], f->q + j * COLUMNS_MAX, c);
                }
                add(n, p[0], f->h[1 + i], c);
                add(n, p[1 + i], f->h[0], c);
            }
            f->c0[1 + i] = f->e[1 + i] - dot(n, f->h[1 + i], f->c[0]) - dot(n, f->h[0], c);
            for (int t = 0; t < 4; t++) {
                r[i + 1][t] = dot(n, f->a0[t], c);
            }
        }
        for (int32_t j = 0; j < f->count; j++) {
            for (int i = 1; i < 4; i++) {
                f->y[j * TERMS + i] = dot(n, f->q + j * COLUMNS_MAX, f->c[i]);
            }
        }
    }
    if (second) {
        for (int m = 0; m < 6; m++) {
            for (int32_t k = 0; k < n; k++) {
                f->c[4 + m][k] = f->qx[4 + m][k] - f->h[4 + m][k];
            }
        }
        if (f->weight_order > 0) {
            for (int32_t j = 0; j < f->count; j++) {
                const double *w = f->w + j * TERMS;
                const double *y = f->y + j * TERMS;
                const double *q = f->q + j * COLUMNS_MAX;
                for (int m = 0; m < 6; m++) {
                    int a = 1 + pair_first[m], b = 1 + pair_second[m];
                    add(n, -(w[4 + m] * y[0] + w[a] * y[b] + w[b] * y[a]), q, f->c[4 + m]);
                }
            }
            for (int m = 0; m < 6; m++) {
                int a = 1 + pair_first[m], b = 1 + pair_second[m];
                double *c = f->c[4 + m];
                // the e a0 a0^T part of M~_ij c + M~_i c_j + M~_j c_i
                add(n, p[0], f->h[4 + m], c);
                add(n, p[b] + r[b][0], f->h[a], c);
                add(n, p[a] + r[a][0], f->h[b], c);
                add(n, p[4 + m] + r[b][a] + r[a][b], f->h[0], c);
            }
        }
        for (int m = 0; m < 6; m++) {
            int a = 1 + pair_first[m], b = 1 + pair_second[m];
            f->c0[4 + m] = f->e[4 + m] - dot(n, f->h[4 + m], f->c[0]) - dot(n, f->h[a], f->c[b]) -
                           dot(n, f->h[b], f->c[a]) - dot(n, f->h[0], f->c[4 + m]);
        }
        for (int32_t j = 0; j < f->count; j++) {
            for (int m = 4; m < TERMS; m++) {
                f->y[j * TERMS + m] = dot(n, f->q + j * COLUMNS_MAX, f->c[m]);
            }
        }
    }
    int terms = second ? TERMS : first ? 4 : 1;
    for (int32_t j = 0; j < f->count; j++) {
        for (int t = 0; t < terms; t++) {
            f->y[j * TERMS + t] += f->c0[t];
        }
    }
}

/// h_J = W_J y_J and derivatives, out of scaled coordinates; the centre's by partition of unity.
static void shape(const fit *f, double radius, double *phi, double *dphi, double *d2phi) {
    double sum[TERMS] = {0};
    double inverse = 1.0 / radius;
    for (int32_t j = 0; j < f->count; j++) {
        if (j == f->centre) {
            continue;
        }
        const double *w = f->w + j * TERMS;
        const double *y = f->y + j * TERMS;
        phi[j] = w[0] * y[0];
        sum[0] += phi[j];
        for (int i = 0; i < 3 && f->order > 0; i++) {
            double v = (w[1 + i] * y[0] + w[0] * y[1 + i]) * inverse;
            dphi[3 * j + i] = v;
            sum[1 + i] += v;
        }
        for (int m = 0; m < 6 && f->order > 1; m++) {
            double v = product_second(w, y, m) * inverse * inverse;
            d2phi[6 * j + m] = v;
            sum[4 + m] += v;
        }
    }
    int32_t k = f->centre;
    phi[k] = 1.0 - sum[0];
    for (int i = 0; i < 3 && f->order > 0; i++) {
        dphi[3 * k + i] = -sum[1 + i];
    }
    for (int m = 0; m < 6 && f->order > 1; m++) {
        d2phi[6 * k + m] = -sum[4 + m];
    }
}

/// Weights of all nodes but the centre, and g of the centre.
static void weigh(fit *f, const double x[3], double radius, const double *position) {
    memset(f->g, 0, sizeof f->g);
    for (int32_t j = 0; j < f->count; j++) {
        double delta[3];
        for (int a = 0; a < 3; a++) {
            delta[a] = (x[a] - position[3 * j + a]) / radius;
        }
        double s = sqrt(dot(3, delta, delta));
        double *w = f->w + j * TERMS;
        memset(w, 0, TERMS * sizeof *w);
        if (j == f->centre) {
            pal_radial_terms(pal_weight_inverse(f->options->weight, f->options->exponent, s), delta,
                             s, f->weight_order, f->g);
        } else if (s < 1.0) {
            pal_radial_terms(pal_weight_at(f->options->weight, f->options->exponent, s), delta, s,
                             f->weight_order, w);
        }
    }
}

static double distance_squared(const double *a, const double *b) {
    double dx = a[0] - b[0], dy = a[1] - b[1], dz = a[2] - b[2];
    return dx * dx + dy * dy + dz * dz;
}

pal_status pal_mls_shape(pal_mls *mls, const pal_mls_options *options, const double x[3],
                         double radius, int32_t count, const double *position, double *phi,
                         double *dphi, double *d2phi, pal_mls_info *info) {
    pal_mls_info scratch = {0};
    pal_mls_info *out = info != NULL ? info : &scratch;
    *out = (pal_mls_info){
        .columns = pal_basis_size(options->basis) - 1, .condition = INFINITY, .coincident = -1};
    if (!(radius > 0.0) || !isfinite(radius) || count <= 0 || options->exponent < 0 ||
        options->exponent > 8 || options->order < 0 || options->order > 2 ||
        (options->order > 0 && dphi == NULL) || (options->order > 1 && d2phi == NULL)) {
        return PALPATE_ERROR_ARGUMENT;
    }
    pal_status status = pal_mls_reserve(mls, count);
    if (status != PALPATE_OK) {
        return status;
    }
    fit f = {.options = options, .count = count, .columns = out->columns, .order = options->order};
    f.q = mls->work;
    f.w = f.q + (size_t)count * COLUMNS_MAX;
    f.y = f.w + (size_t)count * TERMS;
    f.rows = f.y + (size_t)count * TERMS;

    double nearest = INFINITY;
    for (int32_t j = 0; j < count; j++) {
        double d2 = distance_squared(x, position + 3 * j);
        if (d2 < nearest) {
            nearest = d2;
            f.centre = j;
        }
    }
    out->centre = f.centre;
    const double *origin = position + 3 * f.centre;
    if (!(nearest < radius * radius)) {
        return PALPATE_ERROR_STENCIL; // no node's sphere covers x
    }
    double tiny = coincidence * radius;
    if (options->exponent > 0 && nearest < tiny * tiny) {
        for (int32_t j = 0; j < count; j++) {
            if (j != f.centre && distance_squared(origin, position + 3 * j) < tiny * tiny) {
                out->coincident = j;
                return PALPATE_ERROR_STENCIL;
            }
        }
    }

    // at a node, first derivatives do not feel the weights' (c = 0, e = e_i = 0 there)
    int at_node = nearest == 0.0 && options->exponent > 0;
    f.weight_order = options->derivatives == PALPATE_DERIVATIVES_DIFFUSE || (at_node && f.order < 2)
                         ? 0
                         : f.order;
    weigh(&f, x, radius, position);
    for (int32_t j = 0; j < count; j++) {
        double xi[3];
        for (int a = 0; a < 3; a++) {
            xi[a] = (position[3 * j + a] - origin[a]) / radius;
        }
        monomials(f.columns, xi, f.q + j * COLUMNS_MAX);
    }
    double xi[3];
    for (int a = 0; a < 3; a++) {
        xi[a] = (x[a] - origin[a]) / radius;
    }
    for (int32_t c = 0; c < f.columns; c++) {
        for (int t = 0; t < TERMS; t++) {
            int take[3] = {0, 0, 0};
            if (t >= 4) {
                take[pair_first[t - 4]]++;
                take[pair_second[t - 4]]++;
            } else if (t >= 1) {
                take[t - 1]++;
            }
            f.qx[t][c] = monomial_derivative(power[c], take, xi);
        }
    }
    if (!orthonormalize(&f, out)) {
        return PALPATE_ERROR_STENCIL;
    }
    moments(&f);
    solve(&f);
    shape(&f, radius, phi, dphi, d2phi);
    return PALPATE_OK;
}
