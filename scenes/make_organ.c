/// make_organ.c  Writes scenes/organ.obj: a liver-like closed surface that the project makes
/// itself.
///
///     cc -O1 -ffp-contract=off scenes/make_organ.c -lm -o /tmp/make_organ
///     /tmp/make_organ > scenes/organ.obj
///
/// A unit ball is mapped onto the organ by p = T(r(d) d): r(d) > 0 pulls the surface in and out
/// along its radius (the dome of the right lobe, the notch between the lobes, the hollow
/// underneath), T scales the axes, thins the left lobe (cross-sections scaled by a positive
/// function of x) and bends the body (a shear by a function of x). Each step maps one to one and
/// keeps orientation, so the smooth surface cannot intersect itself. The triangles are those of a
/// geodesic sphere (icosahedron, each edge split in FREQUENCY), moved along the surface until their
/// edges are even; that the moved triangles still cover the sphere once is checked. Metres; 10 f^2
/// + 2 vertices, 20 f^2 triangles.
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

enum {
    FREQUENCY = 11,
    VERTICES = 10 * FREQUENCY * FREQUENCY + 2,
    TRIANGLES = 20 * FREQUENCY * FREQUENCY,
    SWEEPS = 1000
};

/// Half axes [m] before bulges and taper: length, depth, height.
static const double HALF[3] = {0.098, 0.066, 0.040};

static double bump(const double d[3], double x, double y, double z, double width) {
    double n = sqrt(x * x + y * y + z * z);
    double s = 0.0;
    const double c[3] = {x / n, y / n, z / n};
    for (int i = 0; i < 3; i++) {
        s += (d[i] - c[i]) * (d[i] - c[i]);
    }
    return exp(-s / (width * width));
}

/// The notch in the front edge: a groove across it, fading out towards the back.
static double notch(const double d[3]) {
    double x = (d[0] - 0.28) / 0.30;
    return exp(-x * x) / (1.0 + exp(7.0 * (d[1] + 0.55)));
}

static double radius(const double d[3]) {
    return 1.0 + 0.10 * bump(d, -0.6, 0.2, 0.8, 0.7) // dome of the right lobe
           - 0.24 * notch(d)                         // between the lobes
           - 0.24 * bump(d, -0.1, -0.35, -1.0, 0.45) // hollow underneath
           + 0.06 * bump(d, -0.9, -0.5, -0.2, 0.5);  // lower tip of the right lobe
}

static double taper(double x) {
    return 1.0 - 0.42 * tanh(1.3 * x / HALF[0]);
}

static double bend(double x) {
    return -1.4 * x * x; // both ends lower than the middle
}

static void surface(const double d[3], double p[3]) {
    double r = radius(d);
    double x = HALF[0] * r * d[0];
    p[0] = x;
    p[1] = HALF[1] * r * d[1] * taper(x);
    p[2] = HALF[2] * r * d[2] * taper(x) + bend(x);
}

/// Direction whose surface point lies on the same ray (in the ball) as p.
static void direction(const double p[3], double d[3]) {
    d[0] = p[0] / HALF[0];
    d[1] = p[1] / (HALF[1] * taper(p[0]));
    d[2] = (p[2] - bend(p[0])) / (HALF[2] * taper(p[0]));
    double n = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int i = 0; i < 3; i++) {
        d[i] /= n;
    }
}

static double triple(const double a[3], const double b[3], const double c[3]) {
    return a[0] * (b[1] * c[2] - b[2] * c[1]) + a[1] * (b[2] * c[0] - b[0] * c[2]) +
           a[2] * (b[0] * c[1] - b[1] * c[0]);
}

// ---- Geodesic sphere ---------------------------------------------------------------------------

static double point[VERTICES][3]; ///< directions
static double place[VERTICES][3]; ///< on the organ [m]
static int triangle[TRIANGLES][3];
static int vertex_count;
static int triangle_count;

/// Vertex at a direction: the one that is there already, or a new one.
static int vertex(const double d[3]) {
    for (int i = 0; i < vertex_count; i++) {
        double s = 0.0;
        for (int k = 0; k < 3; k++) {
            s += (point[i][k] - d[k]) * (point[i][k] - d[k]);
        }
        if (s < 1e-8) {
            return i;
        }
    }
    if (vertex_count == VERTICES) {
        (void)fprintf(stderr, "make_organ: too many vertices\n");
        exit(1);
    }
    memcpy(point[vertex_count], d, sizeof point[0]);
    return vertex_count++;
}

static int corner(const double a[3], const double b[3], const double c[3], int i, int j) {
    double d[3];
    double n = 0.0;
    for (int k = 0; k < 3; k++) {
        d[k] = (FREQUENCY - i - j) * a[k] + i * b[k] + j * c[k];
        n += d[k] * d[k];
    }
    for (int k = 0; k < 3; k++) {
        d[k] /= sqrt(n);
    }
    return vertex(d);
}

static void add(int a, int b, int c) {
    const int t[3] = {a, b, c};
    memcpy(triangle[triangle_count++], t, sizeof t);
}

static void geodesic_sphere(void) {
    const double g = (1.0 + sqrt(5.0)) / 2.0;
    const double v[12][3] = {{-1, g, 0}, {1, g, 0}, {-1, -g, 0}, {1, -g, 0},
                             {0, -1, g}, {0, 1, g}, {0, -1, -g}, {0, 1, -g},
                             {g, 0, -1}, {g, 0, 1}, {-g, 0, -1}, {-g, 0, 1}};
    static const int f[20][3] = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                                 {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                                 {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                                 {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
    for (int t = 0; t < 20; t++) {
        const double *a = v[f[t][0]];
        const double *b = v[f[t][1]];
        const double *c = v[f[t][2]];
        for (int i = 0; i < FREQUENCY; i++) {
            for (int j = 0; i + j < FREQUENCY; j++) {
                add(corner(a, b, c, i, j), corner(a, b, c, i + 1, j), corner(a, b, c, i, j + 1));
                if (i + j + 1 < FREQUENCY) {
                    add(corner(a, b, c, i + 1, j), corner(a, b, c, i + 1, j + 1),
                        corner(a, b, c, i, j + 1));
                }
            }
        }
    }
}

/// Move every vertex towards the centroid of its triangles, weighted by their areas (which evens
/// the areas out), and back onto the surface; one sweep.
static void relax(void) {
    static double sum[VERTICES][3];
    static double weight[VERTICES];
    memset(sum, 0, sizeof sum);
    memset(weight, 0, sizeof weight);
    for (int t = 0; t < triangle_count; t++) {
        const double *a = place[triangle[t][0]];
        const double *b = place[triangle[t][1]];
        const double *c = place[triangle[t][2]];
        double n[3];
        for (int k = 0; k < 3; k++) {
            int i = (k + 1) % 3;
            int j = (k + 2) % 3;
            n[k] = (b[i] - a[i]) * (c[j] - a[j]) - (b[j] - a[j]) * (c[i] - a[i]);
        }
        double area = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]) / 2.0;
        for (int e = 0; e < 3; e++) {
            int v = triangle[t][e];
            for (int k = 0; k < 3; k++) {
                sum[v][k] += area * (a[k] + b[k] + c[k]) / 3.0;
            }
            weight[v] += area;
        }
    }
    for (int i = 0; i < vertex_count; i++) {
        double p[3];
        for (int k = 0; k < 3; k++) {
            p[k] = 0.5 * place[i][k] + 0.5 * sum[i][k] / weight[i];
        }
        direction(p, point[i]);
        surface(point[i], place[i]);
    }
}

int main(void) {
    geodesic_sphere();
    for (int i = 0; i < vertex_count; i++) {
        surface(point[i], place[i]);
    }
    for (int s = 0; s < SWEEPS; s++) {
        relax();
    }
    double volume = 0.0;
    double shortest = 1.0;
    double longest = 0.0;
    for (int t = 0; t < triangle_count; t++) {
        const int *v = triangle[t];
        if (triple(point[v[0]], point[v[1]], point[v[2]]) <= 0.0) {
            (void)fprintf(stderr, "make_organ: triangle %d is folded\n", t);
            return 1;
        }
        volume += triple(place[v[0]], place[v[1]], place[v[2]]) / 6.0;
        for (int e = 0; e < 3; e++) {
            double l = 0.0;
            for (int k = 0; k < 3; k++) {
                l = hypot(l, place[v[e]][k] - place[v[(e + 1) % 3]][k]);
            }
            shortest = fmin(shortest, l);
            longest = fmax(longest, l);
        }
    }
    (void)printf("# liver-like organ, metres; made by scenes/make_organ.c\n");
    for (int i = 0; i < vertex_count; i++) {
        (void)printf("v %.6f %.6f %.6f\n", place[i][0], place[i][1], place[i][2]);
    }
    for (int t = 0; t < triangle_count; t++) {
        (void)printf("f %d %d %d\n", triangle[t][0] + 1, triangle[t][1] + 1, triangle[t][2] + 1);
    }
    (void)fprintf(stderr, "%d vertices, %d triangles, volume %.3e m^3, edges %.2f to %.2f mm\n",
                  vertex_count, triangle_count, volume, 1e3 * shortest, 1e3 * longest);
    return 0;
}
