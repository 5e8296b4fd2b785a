/// @file complementarity.c  Block principal pivoting; where it cycles, Lemke's method.
///
/// 1. Block pivots. A set A of unknowns is taken as active: z_A = -M_AA^-1 q_A, z = 0 elsewhere,
///    w = q + M z. The set is right when no z_i of A and no w_i outside is negative; otherwise all
///    the wrong unknowns I are exchanged at once (Kostreva 1978; Judice and Pires 1994). Reaches
///    the right set in a handful of steps from far away, in one from last tick's set, but may
///    cycle: it is given BLOCK_TRIES steps in which |I| does not fall below its least value so far.
/// 2. Lemke's complementary pivots on w = q + M z + e z0, the tool lifted by z0: z0 falls from the
///    height at which nothing is touched to 0, and every basis on the way is the contact at that
///    height (so an early stop is the answer to a shallower press). Ends at the solution whenever
///    the symmetric part of M is positive definite (Lemke 1965; Cottle, Pang, Stone 1992,
///    section 4.4). A step is O(n^2) on a tableau scaled to a unit diagonal; its set is then solved
///    and checked as in 1, so the tableau's rounding does not enter the answer.
/// 3. Should the check fail (rounding), Murty's pivots from there: exchange the last of I only,
/// which
///    visits no set twice on a P-matrix (Murty 1974), until the iterations are used up.
/// Projected Gauss-Seidel is not used: it diverges on skew M. Murty's pivots alone are not either:
/// they took over 200 steps on 2 of 10 000 random problems of 40 unknowns.
///
/// Rounding: w_i is a sum of terms of magnitude b_i = |q_i| + sum |M_ij z_j|, known to a few n eps
/// b_i. Anything smaller counts as zero; a z_i counts as zero when M_ii z_i is that small. Without
/// this, degenerate problems (z_i = w_i = 0) would exchange the unknown for ever.
///
/// The best iterate so far, clamped to z >= 0, is kept: its residual is that of the header.
///
/// Layout of the workspace: factor or tableau (n x (n+1)), then z_A, trial z, w, bound or the
/// tableau's right-hand side, best z, best w, scale (n each), index (n) and pivot (n+1) integers.
#include "haptic/solver/complementarity.h"

#include <float.h>
#include <math.h>
#include <string.h>

#include "haptic/base/dense.h"

enum { BLOCK_TRIES = 10 };

typedef struct lcp_work {
    double *factor, *za, *trial, *w, *bound, *best_z, *best_w, *scale;
    int32_t *index, *pivot;
} lcp_work;

enum { WORK_VECTORS = 7 };

size_t pal_lcp_bytes(int32_t n) {
    size_t k = n > 0 ? (size_t)n : 1;
    return k * (k + 1 + WORK_VECTORS) * sizeof(double) + (2 * k + 1) * sizeof(int32_t);
}

static lcp_work place(int32_t n, void *memory) {
    size_t k = n > 0 ? (size_t)n : 1;
    lcp_work s;
    s.factor = memory;
    s.za = s.factor + k * (k + 1);
    s.trial = s.za + k;
    s.w = s.trial + k;
    s.bound = s.w + k;
    s.best_z = s.bound + k;
    s.best_w = s.best_z + k;
    s.scale = s.best_w + k;
    s.index = (int32_t *)(void *)(s.scale + k);
    s.pivot = s.index + k;
    return s;
}

/// w = q + M z; with `bound` also the magnitude that was summed.
static void residual_vector(const pal_lcp *p, const double *z, double *w, double *bound) {
    for (int32_t i = 0; i < p->n; i++) {
        w[i] = p->q[i];
    }
    if (bound != NULL) {
        for (int32_t i = 0; i < p->n; i++) {
            bound[i] = fabs(p->q[i]);
        }
    }
    for (int32_t j = 0; j < p->n; j++) {
        const double *column = p->m + (size_t)j * (size_t)p->ld, zj = z[j];
        if (zj == 0) {
            continue;
        }
        for (int32_t i = 0; i < p->n; i++) {
            w[i] += column[i] * zj;
        }
        if (bound != NULL) {
            for (int32_t i = 0; i < p->n; i++) {
                bound[i] += fabs(column[i] * zj);
            }
        }
    }
}

/// || min(M_ii z_i, w_i) ||_2
static double natural_residual(const pal_lcp *p, const double *z, const double *w) {
    double sum = 0;
    for (int32_t i = 0; i < p->n; i++) {
        double scaled = p->m[(size_t)i * (size_t)p->ld + (size_t)i] * z[i];
        double r = scaled < w[i] ? scaled : w[i];
        sum += r * r;
    }
    return sqrt(sum);
}

/// z_A = -M_AA^-1 q_A into s->za. @return 0, or -1 when the block cannot be factored
static int solve_active(const pal_lcp *p, int32_t count, const lcp_work *s) {
    size_t k = (size_t)count, ld = (size_t)p->ld;
    int32_t failed = 1;
    for (int symmetric = p->symmetric != 0; symmetric >= 0 && failed != 0; symmetric--) {
        for (size_t b = 0; b < k; b++) {
            const double *column = p->m + (size_t)s->index[b] * ld;
            for (size_t a = symmetric ? b : 0; a < k; a++) {
                s->factor[a + b * k] = column[s->index[a]];
            }
        }
        for (size_t a = 0; a < k; a++) {
            s->za[a] = -p->q[s->index[a]];
        }
        if (symmetric) {
            failed = pal_dense_cholesky(count, 0, s->factor, count);
            if (failed == 0) {
                pal_dense_cholesky_solve(count, s->factor, count, 1, s->za, count);
            }
        } else {
            failed = pal_dense_lu(count, s->factor, count, s->pivot);
            if (failed == 0) {
                pal_dense_lu_solve(count, s->factor, count, s->pivot, 1, s->za, count);
            }
        }
    }
    for (size_t a = 0; a < k && failed == 0; a++) {
        failed = !isfinite(s->za[a]);
    }
    return failed == 0 ? 0 : -1;
}

/// Mark in `wrong` the unknowns of I (1); s->trial, s->w and s->bound are those of the set.
/// @param[out] last  the last of I
static int32_t find_wrong(const pal_lcp *p, const uint8_t *active, const lcp_work *s,
                          int32_t *last) {
    int32_t wrong = 0;
    double rounding = (p->n + 8) * DBL_EPSILON;
    for (int32_t i = 0; i < p->n; i++) {
        double diagonal = p->m[(size_t)i * (size_t)p->ld + (size_t)i];
        double value = active[i] ? diagonal * s->trial[i] : s->w[i];
        s->pivot[i] =
            value < -rounding * s->bound[i]; // the factor's pivots are not needed any more
        if (s->pivot[i]) {
            wrong++;
            *last = i;
        }
    }
    return wrong;
}

/// Clamp the trial to z >= 0 and keep it when it is the best so far.
/// @param known  s->w is that of the trial: kept where there is nothing to clamp
static void keep_best(const pal_lcp *p, const lcp_work *s, double *best, int known) {
    for (int32_t i = 0; i < p->n; i++) {
        known &= s->trial[i] >= 0;
        s->trial[i] = s->trial[i] > 0 ? s->trial[i] : 0;
    }
    if (!known) {
        residual_vector(p, s->trial, s->w, NULL);
    }
    double residual = natural_residual(p, s->trial, s->w);
    if (residual < *best) {
        *best = residual;
        memcpy(s->best_z, s->trial, (size_t)p->n * sizeof *s->trial);
        memcpy(s->best_w, s->w, (size_t)p->n * sizeof *s->w);
    }
}

/// ---- Lemke's method ---------------------------------------------------------------------------
/// Dictionary x_B = r + T x_N. Variables: w_i is i, z_i is n + i, z0 is 2n; basic ones in s->index,
/// nonbasic ones in s->pivot (n + 1 of them).
static void dictionary_start(const pal_lcp *p, const lcp_work *s) {
    size_t n = (size_t)p->n;
    for (size_t i = 0; i < n; i++) {
        double diagonal = p->m[i * (size_t)p->ld + i];
        s->scale[i] = diagonal > 0 ? 1 / sqrt(diagonal) : 1;
    }
    for (size_t j = 0; j < n; j++) {
        for (size_t i = 0; i < n; i++) {
            s->factor[i + j * n] = s->scale[i] * p->m[i + j * (size_t)p->ld] * s->scale[j];
        }
        s->factor[j + n * n] = s->scale[j];
        s->bound[j] = s->scale[j] * p->q[j];
        s->index[j] = (int32_t)j;
        s->pivot[j] = (int32_t)(n + j);
    }
    s->pivot[n] = (int32_t)(2 * n);
}

static void dictionary_exchange(int32_t order, int32_t row, int32_t column, const lcp_work *s) {
    size_t n = (size_t)order, r = (size_t)row, c = (size_t)column;
    double *t = s->factor, *rhs = s->bound, *entering = t + c * n, inverse = 1 / entering[r];
    for (size_t j = 0; j <= n; j++) { // x_entering = (x_row - rhs_row - sum of the others) / pivot
        t[r + j * n] = j == c ? inverse : -t[r + j * n] * inverse;
    }
    double value = -rhs[r] * inverse;
    for (size_t j = 0; j <= n; j++) {
        double f = t[r + j * n];
        for (size_t i = 0; j != c && f != 0 && i < n; i++) {
            t[i + j * n] += i == r ? 0 : entering[i] * f;
        }
    }
    for (size_t i = 0; i < n; i++) {
        rhs[i] = i == r ? value : rhs[i] + entering[i] * value;
        entering[i] *= i == r ? 1 : inverse;
    }
    int32_t label = s->index[r];
    s->index[r] = s->pivot[c];
    s->pivot[c] = label;
}

/// Row that first falls to zero as nonbasic `column` rises; z0's on a tie, else the larger pivot's.
/// @return -1: none does
static int32_t dictionary_leaving(int32_t n, int32_t column, const lcp_work *s) {
    const double *t = s->factor + (size_t)column * (size_t)n;
    const double smallest = 1e-11; // of a tableau with unit diagonal
    int32_t row = -1;
    double least = INFINITY;
    for (int32_t i = 0; i < n; i++) {
        if (t[i] < -smallest) {
            double ratio = (s->bound[i] > 0 ? s->bound[i] : 0) / -t[i];
            int tie = row >= 0 && ratio <= least && ratio >= least;
            if (ratio < least ||
                (tie && s->index[row] != 2 * n && (s->index[i] == 2 * n || t[i] < t[row]))) {
                least = ratio;
                row = i;
            }
        }
    }
    return row;
}

/// Lemke's pivots until z0 leaves. On return `active` is the set of the last basis and s->trial its
/// z.
static void lemke(const pal_lcp *p, int32_t max_iterations, uint8_t *active, const lcp_work *s,
                  int32_t *iterations) {
    int32_t n = p->n, row = 0, column = n;
    dictionary_start(p, s);
    for (int32_t i = 1; i < n; i++) { // the height at which the last contact is lost
        row = p->q[i] < p->q[row] ? i : row;
    }
    if (p->q[row] >= 0) {
        row = -1; // nothing is touched
    }
    while (row >= 0 && *iterations < max_iterations) {
        int32_t leaving = s->index[row];
        dictionary_exchange(n, row, column, s);
        (*iterations)++;
        if (leaving == 2 * n) {
            break;
        }
        int32_t entering = leaving < n ? leaving + n : leaving - n;
        for (column = 0; s->pivot[column] != entering; column++) {
        }
        row = dictionary_leaving(n, column, s); // -1, a ray: M is not as required, or rounding
    }
    memset(active, 0, (size_t)n);
    memset(s->trial, 0, (size_t)n * sizeof *s->trial);
    for (int32_t i = 0; i < n; i++) {
        if (s->index[i] >= n && s->index[i] < 2 * n) {
            active[s->index[i] - n] = 1;
            s->trial[s->index[i] - n] = s->scale[s->index[i] - n] * s->bound[i];
        }
    }
}

/// Solve the set and judge it. @return the number of wrong unknowns; -1: a singular block
static int32_t try_set(const pal_lcp *p, const uint8_t *active, const lcp_work *s, double *best,
                       int32_t *last) {
    int32_t count = 0;
    for (int32_t i = 0; i < p->n; i++) {
        s->trial[i] = 0;
        if (active[i]) {
            s->index[count++] = i;
        }
    }
    if (count > 0 && solve_active(p, count, s) != 0) {
        return -1;
    }
    for (int32_t a = 0; a < count; a++) {
        s->trial[s->index[a]] = s->za[a];
    }
    residual_vector(p, s->trial, s->w, s->bound);
    int32_t wrong = find_wrong(p, active, s, last);
    keep_best(p, s, best, 1);
    return wrong;
}

pal_lcp_result pal_lcp_solve(const pal_lcp *problem, int32_t max_iterations, uint8_t *active,
                             double *z, double *w, void *work) {
    const pal_lcp *p = problem;
    pal_lcp_result result = {PALPATE_LCP_SOLVED, 0, 0};
    if (p->n < 1) {
        return result;
    }
    lcp_work s = place(p->n, work);
    double norm = 0;
    for (int32_t i = 0; i < p->n; i++) {
        s.best_z[i] = 0;
        s.best_w[i] = p->q[i];
        norm += p->q[i] * p->q[i];
    }
    norm = sqrt(norm);
    double best = natural_residual(p, s.best_z, s.best_w);

    int32_t least = INT32_MAX, tries = BLOCK_TRIES, last = 0;
    int block = 1;
    result.state = PALPATE_LCP_CUT_OFF;
    while (result.iterations < max_iterations) {
        result.iterations++;
        int32_t wrong = try_set(p, active, &s, &best, &last);
        if (wrong <= 0) {
            result.state = wrong == 0 ? PALPATE_LCP_SOLVED : PALPATE_LCP_SINGULAR;
            break;
        }
        if (wrong < least) {
            least = wrong;
            tries = BLOCK_TRIES;
        } else if (block && tries-- == 0) {
            block = 0;
            lemke(p, max_iterations - 1, active, &s, &result.iterations);
            keep_best(p, &s, &best, 0);
            continue;
        }
        for (int32_t i = block ? 0 : last; i <= last; i++) {
            active[i] = s.pivot[i] ? !active[i] : active[i];
        }
    }
    for (int32_t i = 0; i < p->n; i++) {
        z[i] = s.best_z[i];
        w[i] = s.best_w[i];
        active[i] = z[i] > 0;
    }
    result.residual = norm > 0 ? best / norm : 0;
    return result;
}
