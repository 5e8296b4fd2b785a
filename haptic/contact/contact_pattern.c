/// @file contact_pattern.c  Points on rings in the unit disc.
///
/// n points in all, rings of m_k points: the ring's cells fill the annulus between the radii with
/// n r^2 = (points inside it) and (points inside it) + m_k; its points sit at the annulus' radius
/// of gyration, every other ring turned by half a step.
///
/// Calibration of `self`. Between two cells at distance r the half-space gives coefficient / r
/// (Boussinesq); the compliance of a cell with itself is that of its own load, coefficient * self /
/// sqrt(area), with `self` between 3.0 (mean over a uniformly loaded disc: 16 / (3 pi) sqrt(pi))
/// and 3.9 (the lattice sum that makes sum_j A_j / r_ij + sqrt(A) self an exact quadrature of 1/r:
/// Wigner's constant, 3.9002 square, 3.9210 hexagonal). A rigid ball on a half-space with the
/// pattern's radius proportional to sqrt(R d) is the same problem at every depth. `scale` is where
/// its force is stationary in the pattern's radius, so that a contact that a thin body, a curved
/// one or a neighbour makes 5 % wider or narrower still has its force within 0.4 %; `self` makes
/// that force Hertz's, 4/3 E* sqrt(R) d^(3/2). tests/haptic/test_contact_anywhere.c computes both
/// anew.
#include "haptic/contact/contact_pattern.h"

#include <math.h>
#include <stddef.h>

enum { RINGS = 4 };

typedef struct ring_table {
    int32_t count;
    int32_t ring[RINGS];
    double scale, self;
} ring_table;

static const ring_table TABLE[] = {
    {1, {1}, 0.85, 5.020188170}, // grows with the radius: nothing is stationary
    {6, {1, 5}, 0.804, 4.126329688},
    {7, {1, 6}, 0.805, 4.209697593},
    {16, {1, 5, 10}, 0.773, 4.199567720},
    {19, {1, 6, 12}, 0.774, 4.259835221},
    {37, {1, 6, 12, 18}, 0.757, 4.251974541},
};

/// cos and sin of pi / m: literals, so that every machine has the same bits.
static void half_step(int32_t m, double *c, double *s) {
    switch (m) {
    case 5:
        *c = 0.80901699437494742;
        *s = 0.58778525229247313;
        return;
    case 6:
        *c = 0.86602540378443865;
        *s = 0.5;
        return;
    case 10:
        *c = 0.95105651629515357;
        *s = 0.30901699437494742;
        return;
    case 12:
        *c = 0.96592582628906829;
        *s = 0.25881904510252077;
        return;
    case 18:
        *c = 0.98480775301220806;
        *s = 0.17364817766693035;
        return;
    default:
        *c = 1.0;
        *s = 0.0;
    }
}

void pal_pattern_init(pal_pattern *pattern, int32_t points) {
    const ring_table *t = TABLE;
    for (size_t k = 1; k < sizeof TABLE / sizeof TABLE[0]; k++) {
        t = TABLE[k].count <= points ? &TABLE[k] : t;
    }
    *pattern = (pal_pattern){.count = t->count,
                             .share = 3.14159265358979324 / t->count,
                             .self = t->self,
                             .scale = t->scale};
    int32_t at = 1; // the centre stays at 0
    for (int k = 1; k < RINGS && at < t->count; k++) {
        int32_t m = t->ring[k];
        double radius = sqrt((at + 0.5 * m) / t->count), c, s;
        half_step(m, &c, &s);
        double x = k % 2 != 0 ? 1.0 : c, y = k % 2 != 0 ? 0.0 : s;
        for (int32_t i = 0; i < m; i++, at++) {
            pattern->at[at][0] = radius * x;
            pattern->at[at][1] = radius * y;
            for (int turn = 0; turn < 2; turn++) {
                double next = c * x - s * y;
                y = s * x + c * y;
                x = next;
            }
        }
    }
}

double pal_pattern_radius(const pal_pattern *pattern, double ball, double depth) {
    double most = 0.95 * ball;
    double radius = depth < ball ? sqrt((2.0 * ball - depth) * depth) : ball;
    return pattern->scale * (radius < most ? radius : most);
}
