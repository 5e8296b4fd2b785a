/// @file dense_small.c  Pivoted Householder QR, triangle inverse and Cholesky of small matrices.
///
/// QR with column pivoting: Businger and Golub 1965; the norms of the remaining columns are
/// recomputed at every step (cheap at this size, and free of the downdating's cancellation). Row
/// sorting: A. J. Cox and N. J. Higham, "Stability of Householder QR factorization for weighted
/// least squares problems", 1998.
#include "src/base/dense_small.h"

#include <math.h>
#include <string.h>

static void swap_rows(double *a, int32_t ld, int32_t columns, int32_t i, int32_t j) {
    for (int32_t c = 0; c < columns; c++) {
        double t = a[c * ld + i];
        a[c * ld + i] = a[c * ld + j];
        a[c * ld + j] = t;
    }
}

static double row_size(const double *a, int32_t ld, int32_t columns, int32_t row) {
    double most = 0.0;
    for (int32_t c = 0; c < columns; c++) {
        most = fmax(most, fabs(a[c * ld + row]));
    }
    return most;
}

/// Shell sort of the rows, largest element descending (a few dozen to a few hundred rows).
static void sort_rows(int32_t rows, int32_t columns, double *a, int32_t ld) {
    static const int32_t gaps[] = {301, 132, 57, 23, 10, 4, 1};
    for (int g = 0; g < 7; g++) {
        for (int32_t i = gaps[g]; i < rows; i++) {
            for (int32_t j = i; j >= gaps[g]; j -= gaps[g]) {
                if (row_size(a, ld, columns, j) <= row_size(a, ld, columns, j - gaps[g])) {
                    break;
                }
                swap_rows(a, ld, columns, j, j - gaps[g]);
            }
        }
    }
}

static double norm_below(const double *column, int32_t from, int32_t rows) {
    double sum = 0.0;
    for (int32_t i = from; i < rows; i++) {
        sum += column[i] * column[i];
    }
    return sum;
}

int32_t pal_small_qr(int32_t rows, int32_t columns, double *a, int32_t ld, int32_t *pivot,
                     double tolerance) {
    sort_rows(rows, columns, a, ld);
    for (int32_t c = 0; c < columns; c++) {
        pivot[c] = c;
    }
    int32_t steps = rows < columns ? rows : columns;
    int32_t rank = 0;
    double first = 0.0;
    for (int32_t k = 0; k < steps; k++) {
        int32_t best = k;
        double most = -1.0;
        for (int32_t c = k; c < columns; c++) {
            double norm = norm_below(a + c * ld, k, rows);
            if (norm > most) { // ties: the first column
                most = norm;
                best = c;
            }
        }
        if (best != k) {
            for (int32_t i = 0; i < rows; i++) {
                double t = a[k * ld + i];
                a[k * ld + i] = a[best * ld + i];
                a[best * ld + i] = t;
            }
            int32_t t = pivot[k];
            pivot[k] = pivot[best];
            pivot[best] = t;
        }
        double *v = a + k * ld;
        double norm = sqrt(most);
        if (k == 0) {
            first = norm;
        }
        if (!(norm > tolerance * first)) {
            // the rest is zero to tolerance: leave a clean triangle
            for (int32_t c = k; c < columns; c++) {
                for (int32_t i = k; i < rows; i++) {
                    a[c * ld + i] = 0.0;
                }
            }
            break;
        }
        rank++;
        // H = I - beta v v^T maps v onto (alpha, 0); the sign avoids cancellation
        double alpha = v[k] > 0.0 ? -norm : norm;
        double head = v[k] - alpha;
        double beta = -1.0 / (alpha * head);
        v[k] = head;
        for (int32_t c = k + 1; c < columns; c++) {
            double *u = a + c * ld;
            double dot = 0.0;
            for (int32_t i = k; i < rows; i++) {
                dot += v[i] * u[i];
            }
            dot *= beta;
            for (int32_t i = k; i < rows; i++) {
                u[i] -= dot * v[i];
            }
        }
        v[k] = alpha;
        for (int32_t i = k + 1; i < rows; i++) {
            v[i] = 0.0;
        }
    }
    return rank;
}

void pal_small_triangle_inverse(int32_t n, const double *r, int32_t ld, double *inverse) {
    memset(inverse, 0, (size_t)n * (size_t)n * sizeof *inverse);
    for (int32_t j = 0; j < n; j++) {
        inverse[j * n + j] = 1.0 / r[j * ld + j];
        for (int32_t i = j - 1; i >= 0; i--) {
            double sum = 0.0;
            for (int32_t k = i + 1; k <= j; k++) {
                sum += r[k * ld + i] * inverse[k * n + j];
            }
            inverse[i * n + j] = -sum / r[i * ld + i];
        }
    }
}

int pal_small_cholesky(int32_t n, double *a, int32_t ld) {
    for (int32_t j = 0; j < n; j++) {
        for (int32_t i = j; i < n; i++) {
            double sum = a[i * ld + j];
            for (int32_t k = 0; k < j; k++) {
                sum -= a[i * ld + k] * a[j * ld + k];
            }
            if (i == j) {
                if (!(sum > 0.0)) {
                    return 0;
                }
                a[j * ld + j] = sqrt(sum);
            } else {
                a[i * ld + j] = sum / a[j * ld + j];
            }
        }
    }
    return 1;
}
