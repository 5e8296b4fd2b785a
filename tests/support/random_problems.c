#include "tests/support/random_problems.h"

#include <math.h>

enum { MAX = RANDOM_MATRIX_MAX };

static uint64_t seed;

void random_seed(uint64_t value) {
    seed = value;
}

double random_uniform(void) { // splitmix64
    seed += 0x9E3779B97F4A7C15u;
    uint64_t z = seed;
    z = (z ^ (z >> 30)) * 0xBF58476D1CE4E5B9u;
    z = (z ^ (z >> 27)) * 0x94D049BB133111EBu;
    z ^= z >> 31;
    return (double)(int64_t)z / 9223372036854775808.0;
}

double random_positive(void) {
    return 0.5 + 0.5 * random_uniform();
}

double matrix_norm(int n, const double *a) {
    double sum = 0;
    for (int i = 0; i < n * n; i++) {
        sum += a[i] * a[i];
    }
    return sqrt(sum);
}

/// n Householder reflections.
static void random_orthogonal(int n, double *a) {
    for (int i = 0; i < n * n; i++) {
        a[i] = i % (n + 1) == 0;
    }
    for (int k = 0; k < n; k++) {
        double h[MAX], norm = 0;
        for (int i = 0; i < n; i++) {
            h[i] = random_uniform();
            norm += h[i] * h[i];
        }
        for (int j = 0; j < n; j++) {
            double dot = 0;
            for (int i = 0; i < n; i++) {
                dot += h[i] * a[i + j * n];
            }
            for (int i = 0; i < n; i++) {
                a[i + j * n] -= 2 * dot / norm * h[i];
            }
        }
    }
}

void random_matrix(int n, double condition, double skew, int cone, double *m) {
    static double v[MAX * MAX], k[MAX * MAX], t[MAX * MAX];
    double root[MAX];
    random_orthogonal(n, v);
    for (int i = 0; i < n; i++) {
        double u = i == 0 ? 0 : i == n - 1 ? 1 : random_positive();
        root[i] = sqrt(pow(condition, -u));
    }
    for (int j = 0; j < n; j++) {
        for (int i = 0; i <= j; i++) {
            double a = i == j ? 0 : random_uniform() * (cone ? root[i] * root[j] : 1);
            k[i + j * n] = a;
            k[j + i * n] = -a;
        }
    }
    if (cone) { // K lives in the eigenvectors' frame
        for (int j = 0; j < n; j++) {
            for (int i = 0; i < n; i++) {
                double sum = 0;
                for (int l = 0; l < n; l++) {
                    sum += v[i + l * n] * k[l + j * n];
                }
                t[i + j * n] = sum;
            }
        }
        for (int j = 0; j < n; j++) {
            for (int i = 0; i <= j; i++) {
                double sum = 0;
                for (int l = 0; l < n; l++) {
                    sum += t[i + l * n] * v[j + l * n];
                }
                k[i + j * n] = i == j ? 0 : sum;
                k[j + i * n] = -k[i + j * n];
            }
        }
    }
    for (int j = 0; j < n; j++) {
        for (int i = 0; i <= j; i++) {
            double sum = 0;
            for (int l = 0; l < n; l++) {
                sum += v[i + l * n] * root[l] * root[l] * v[j + l * n];
            }
            m[i + j * n] = m[j + i * n] = sum;
        }
    }
    double norm = matrix_norm(n, k), scale = norm > 0 ? skew * matrix_norm(n, m) / norm : 0;
    for (int i = 0; i < n * n; i++) {
        m[i] += scale * k[i];
    }
}

int rising_int(const void *a, const void *b) {
    return *(const int *)a - *(const int *)b;
}
