/// The smooth rest surface: exact on spheres, continuous, the same as brute force.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/rest_rig.h"

static const double one[3] = {1.0, 1.0, 1.0};
static uint64_t seed = 5;

static double uniform(void) {
    return rest_rig_random(&seed);
}

static double norm(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static double apart(const double a[3], const double b[3]) {
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return norm(d);
}

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void direction(double d[3]) {
    do {
        for (int i = 0; i < 3; i++) {
            d[i] = uniform();
        }
    } while (norm(d) > 1.0 || norm(d) < 0.1);
    double length = norm(d);
    for (int i = 0; i < 3; i++) {
        d[i] /= length;
    }
}

static double longest_edge(const rest_rig *rig) {
    double most = 0.0;
    for (int32_t k = 0; k < 3 * rig->model->info.triangle_count; k++) {
        int32_t t = k / 3, next = 3 * t + (k + 1 - 3 * t) % 3;
        most = fmax(most, apart(rig->model->position + 3 * rig->model->triangle[k],
                                rig->model->position + 3 * rig->model->triangle[next]));
    }
    return most;
}

// ---- Exactness ----------------------------------------------------------------------------------

/// On a sphere corner normals are radial to rounding, and the middle of an edge of length h is at
/// radius 1 - 3 h^4 / 128 + O(h^6) where the flat edge is at 1 - h^2 / 8.
static void sphere_is_round(void **state) {
    (void)state;
    rest_rig rig;
    rest_rig_sphere(&rig, 3, 0.2, one);
    const pal_rest_surface *s = &rig.surface;
    for (int32_t t = 0; t < s->triangle_count; t++) {
        assert_int_equal(s->sharp[t], 0);
        for (int e = 0; e < 3; e++) {
            const double *p = s->position + 3 * s->triangle[3 * t + e];
            const double *q = s->position + 3 * s->triangle[3 * t + (e + 1) % 3];
            assert_true(apart(s->corner_normal + 9 * t + 3 * e, p) < 1e-12);
            double b[3] = {0.0, 0.0, 0.0}, h = apart(p, q);
            b[e] = b[(e + 1) % 3] = 0.5;
            pal_surface_point x;
            pal_rest_point(s, t, b, &x);
            assert_true(fabs(1.0 - norm(x.position) - 3 * pow(h, 4) / 128) < 0.1 * pow(h, 4) / 128);
            assert_true(fabs(dot(x.normal, x.position) - norm(x.position)) < 1e-14);
        }
    }
    double h = longest_edge(&rig), worst = 0.0, turn = 0.0;
    for (int n = 0; n < 20000; n++) {
        double p[3], r = 1.0 + 0.5 * uniform();
        direction(p);
        for (int i = 0; i < 3; i++) {
            p[i] *= r;
        }
        pal_surface_point x;
        assert_int_equal(pal_rest_closest(s, p, 1.0, -1, &x), 1);
        worst = fmax(worst, fabs(x.distance - (r - 1.0)));
        for (int i = 0; i < 3; i++) {
            turn = fmax(turn, fabs(x.normal[i] - p[i] / r));
        }
    }
    // the flat triangles miss the sphere by up to h^2 / 6 in their middles, the patches by far less
    assert_true(worst < 0.02 * h * h);
    assert_true(turn < 0.05 * h * h);
    rest_rig_free(&rig);
}

/// Faces stay flat, edges sharp: the box's own distance from outside, and from inside near a face.
static void box_is_sharp(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 2.0, 3.0};
    rest_rig_box(&rig, 5, size);
    for (int n = 0; n < 20000; n++) {
        double p[3], foot[3];
        for (int i = 0; i < 3; i++) {
            p[i] = size[i] * (0.5 + uniform());
            foot[i] = fmin(fmax(p[i], 0.0), size[i]);
        }
        double expect = apart(p, foot);
        if (expect == 0.0) { // inside: the nearest face
            expect = -HUGE_VAL;
            for (int i = 0; i < 3; i++) {
                expect = fmax(expect, fmax(-p[i], p[i] - size[i]));
            }
        }
        pal_surface_point x;
        assert_int_equal(pal_rest_closest(&rig.surface, p, 10.0, -1, &x), 1);
        assert_true(fabs(x.distance - expect) < 1e-9);
        for (int i = 0; i < 3; i++) {
            assert_true(fabs(x.position[i] + x.distance * x.normal[i] - p[i]) < 1e-9);
        }
    }
    rest_rig_free(&rig);
}

/// Both sides of an edge give the same curve, sharp or not: no gaps. A cut ellipsoid has both.
static void surface_has_no_gaps(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 0.6, 0.12};
    rest_rig_sphere(&rig, 3, 0.2, size);
    for (int32_t i = 0; i < rig.model->info.surface_count; i++) { // flat below: a round sharp rim
        double *z = &rig.model->position[3 * i + 2];
        *z = fmax(*z, -0.01);
    }
    rest_rig_build(&rig, PALPATE_WEIGHTS_NODES, PALPATE_WEIGHTS_POWER);
    const pal_rest_surface *s = &rig.surface;
    int sharp = 0, smooth = 0;
    for (int32_t t = 0; t < s->triangle_count; t++) {
        for (int e = 0; e < 3; e++) {
            int32_t u = s->across[3 * t + e] / 3, f = s->across[3 * t + e] % 3;
            int is_sharp = (s->sharp[t] >> e) & 1;
            assert_int_equal(is_sharp, (s->sharp[u] >> f) & 1);
            sharp += is_sharp;
            smooth += !is_sharp;
            for (int k = 0; k <= 8; k++) {
                double b[3] = {0.0, 0.0, 0.0}, c[3] = {0.0, 0.0, 0.0};
                b[e] = c[(f + 1) % 3] = k / 8.0;
                b[(e + 1) % 3] = c[f] = 1.0 - k / 8.0;
                pal_surface_point x, y;
                pal_rest_point(s, t, b, &x);
                pal_rest_point(s, u, c, &y);
                assert_true(apart(x.position, y.position) < 1e-12);
                assert_true(is_sharp || apart(x.normal, y.normal) < 1e-12);
            }
        }
    }
    assert_true(sharp > 50 && smooth > 500);
    rest_rig_free(&rig);
}

// ---- Agreement ----------------------------------------------------------------------------------

/// The same answers when every triangle is tried alone, whatever the hint.
static void tree_finds_what_all_triangles_give(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 0.8, 0.3};
    rest_rig_sphere(&rig, 3, 0.2, size);
    pal_rest_surface alone = rig.surface; // a tree of one leaf that holds one triangle
    int32_t only = 0;
    pal_rest_box leaf = {.low = {-9, -9, -9}, .high = {9, 9, 9}, .first = 0, .count = 1};
    alone.box = &leaf;
    alone.order = &only;
    int hits = 0;
    for (int n = 0; n < 300; n++) {
        double p[3], d[3], least = 2.0, level = 0.7;
        direction(p);
        direction(d);
        double r = 1.0 + 0.2 * uniform();
        for (int i = 0; i < 3; i++) {
            p[i] *= r * size[i];
        }
        pal_surface_point x, y, best = {.triangle = -1}, first = {.triangle = -1};
        for (only = 0; only < rig.surface.triangle_count; only++) {
            if (pal_rest_closest(&alone, p, 2.0, -1, &x) && fabs(x.distance) < least) {
                least = fabs(x.distance);
                best = x;
            }
            if (pal_rest_project(&alone, p, d, 0.7, 0.1, -1, &x) && fabs(x.distance) < level) {
                level = fabs(x.distance);
                first = x;
            }
        }
        for (int hint = -1; hint < 3; hint++) {
            int32_t at =
                hint < 0 ? -1 : (int32_t)((uniform() + 1) * 0.5 * rig.surface.triangle_count);
            assert_int_equal(pal_rest_closest(&rig.surface, p, 2.0, at, &x), best.triangle >= 0);
            assert_true(apart(x.position, best.position) < 1e-9);
            assert_int_equal(pal_rest_project(&rig.surface, p, d, 0.7, 0.1, at, &y),
                             first.triangle >= 0);
            if (first.triangle >= 0) {
                hits++;
                assert_true(apart(y.position, first.position) < 1e-9);
                assert_true(dot(y.normal, d) > 0.1);
            }
        }
    }
    assert_true(hits > 200);
    rest_rig_free(&rig);
}

/// x + s n = p to rounding, and no sampled point of the surface is nearer than the curvature
/// explains.
static void closest_is_nearest(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 0.8, 0.5};
    rest_rig_sphere(&rig, 3, 0.2, size);
    for (int n = 0; n < 200; n++) {
        double p[3], r = 1.0 + 0.2 * uniform();
        direction(p);
        for (int i = 0; i < 3; i++) {
            p[i] *= r * size[i];
        }
        pal_surface_point x, y;
        assert_int_equal(pal_rest_closest(&rig.surface, p, 1.0, -1, &x), 1);
        for (int i = 0; i < 3; i++) {
            assert_true(fabs(x.position[i] + x.distance * x.normal[i] - p[i]) < 1e-9);
        }
        double least = 1.0;
        for (int32_t t = 0; t < rig.surface.triangle_count; t++) {
            for (int k = 0; k < 15; k++) {
                double b[3] = {(k % 5) / 4.0, (k / 5) / 2.0, 0.0};
                b[1] *= 1.0 - b[0];
                b[2] = 1.0 - b[0] - b[1];
                pal_rest_point(&rig.surface, t, b, &y);
                least = fmin(least, apart(y.position, p));
            }
        }
        // normals are those of the patches within O(h^2): |p - x| is within a few per cent of least
        assert_true(fabs(x.distance) < 1.03 * least + 1e-3);
    }
    rest_rig_free(&rig);
}

// ---- Continuity ---------------------------------------------------------------------------------

/// Largest change of position and normal per length of step along random chords at heights where
/// the projection is single-valued.
static void walk(const rest_rig *rig, const double size[3], double height, int steps, double *slope,
                 double *swing, int *lost) {
    *slope = *swing = 0.0;
    *lost = 0;
    for (int n = 0; n < 20; n++) {
        double a[3], b[3];
        direction(a);
        direction(b);
        pal_surface_point x, last = {.triangle = -1};
        double before[3] = {0, 0, 0};
        for (int k = 0; k <= steps / 20; k++) {
            double q[3], p[3], z = (double)k / (steps / 20);
            for (int i = 0; i < 3; i++) {
                q[i] = (1 - z) * a[i] + z * b[i];
            }
            double length = norm(q);
            for (int i = 0; i < 3; i++) {
                p[i] = (1.0 + height * sin(40 * z)) * size[i] * q[i] / length;
            }
            if (length < 0.3 || !pal_rest_closest(&rig->surface, p, 1.0, last.triangle, &x)) {
                *lost += length >= 0.3;
                last.triangle = -1;
                continue;
            }
            if (last.triangle >= 0) {
                double step = apart(p, before);
                *slope = fmax(*slope, (apart(x.position, last.position) - 1e-12) / step);
                *swing = fmax(*swing, (apart(x.normal, last.normal) - 1e-12) / step);
            }
            last = x;
            memcpy(before, p, sizeof p);
        }
    }
}

static void closest_is_continuous(void **state) {
    (void)state;
    rest_rig rig;
    double slope, swing;
    int lost;
    rest_rig_sphere(&rig, 3, 0.2, one);
    // on a sphere at radius 1 - h >= 0.7 the foot moves 1 / 0.7 = 1.43 times as fast as p; patches
    // differ from the sphere by a few per cent in slope
    walk(&rig, one, 0.3, 100000, &slope, &swing, &lost);
    assert_int_equal(lost, 0);
    assert_true(slope < 1.43 * 1.15);
    assert_true(swing < 1.43 * 1.15);
    rest_rig_free(&rig);
    // a flat ellipsoid: least radius of curvature 0.5^2 / 1 = 0.25; heights of 5 % (0.05 at the
    // tip)
    const double size[3] = {1.0, 1.0, 0.5};
    rest_rig_sphere(&rig, 4, 0.15, size);
    walk(&rig, size, 0.05, 100000, &slope, &swing, &lost);
    assert_int_equal(lost, 0);
    assert_true(slope < 1.25 * 1.15);
    assert_true(swing < 1.25 * 1.15 * 4.0); // normals turn by 1 / 0.25 per length of foot
    rest_rig_free(&rig);
}

/// A ball's centre outside a box: position and normal over faces, edges and corners. The foot on a
/// convex body moves no faster than p; the normal turns by at most 1 / height.
static void box_is_rolled_over(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 1.0, 1.0};
    rest_rig_box(&rig, 4, size);
    for (int n = 0; n < 20; n++) {
        double a[3], b[3], before[3] = {0, 0, 0};
        direction(a);
        direction(b);
        pal_surface_point x, last = {.triangle = -1};
        for (int k = 0; k <= 5000; k++) {
            double p[3], q[3], z = k / 5000.0;
            for (int i = 0; i < 3; i++) {
                q[i] = (1 - z) * a[i] + z * b[i];
            }
            double length = norm(q);
            for (int i = 0; i < 3; i++) {
                p[i] = 0.5 + 1.1 * q[i] / length; // 0.2 outside at the corners
            }
            assert_int_equal(pal_rest_closest(&rig.surface, p, 2.0, last.triangle, &x), 1);
            if (last.triangle >= 0 && length > 0.2) {
                double step = apart(p, before);
                assert_true(apart(x.position, last.position) < 1.0001 * step + 1e-9);
                assert_true(apart(x.normal, last.normal) < 1.0001 * step / 0.19 + 1e-9);
            }
            last = x;
            memcpy(before, p, sizeof p);
        }
    }
    rest_rig_free(&rig);
}

/// Pressed past the middle of a thin plate, `track` stays on its side where `closest` changes over.
static void track_keeps_its_side(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 1.0, 0.1};
    rest_rig_sphere(&rig, 3, 0.1, size);
    pal_surface_point x, y;
    double p[3] = {0.1, 0.05, 0.12};
    assert_int_equal(pal_rest_closest(&rig.surface, p, 1.0, -1, &x), 1);
    for (int k = 0; k < 300; k++) {
        p[2] -= 0.001; // to z = -0.18, 0.28 below the top, out at the other side
        p[0] -= 0.0005;
        assert_int_equal(pal_rest_track(&rig.surface, p, 1.0, &x, &x), 1);
        assert_true(x.normal[2] > 0.9);
        assert_true(fabs(x.distance - (p[2] - x.position[2]) / x.normal[2]) < 1e-9);
        assert_int_equal(pal_rest_closest(&rig.surface, p, 1.0, -1, &y), 1);
        if (p[2] > 0.02) {
            assert_true(apart(x.position, y.position) < 1e-9);
        } else if (p[2] < -0.02) {
            assert_true(y.normal[2] < 0.0);
        }
    }
    rest_rig_free(&rig);
}

static void hits_are_continuous(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 0.9, 0.7};
    rest_rig_sphere(&rig, 3, 0.2, size);
    int pairs = 0;
    for (int n = 0; n < 20; n++) {
        double o[3], v[3], d[3], before[3] = {0, 0, 0};
        direction(d);
        direction(o);
        direction(v);
        pal_surface_point x, last = {.triangle = -1};
        for (int k = 0; k < 5000; k++) {
            double p[3];
            for (int i = 0; i < 3; i++) {
                p[i] = 0.8 * d[i] + 0.4 * o[i] + 2e-4 * (k - 2500) * v[i];
            }
            int hit = pal_rest_project(&rig.surface, p, d, 2.0, 0.3, last.triangle, &x);
            if (hit && last.triangle >= 0) {
                pairs++;
                // slope 1 / cosine: at most 1 / 0.3; the patches' own slopes differ from n a little
                assert_true(apart(x.position, last.position) < 1.2 / 0.3 * apart(p, before));
            } else if (hit != (last.triangle >= 0) && k > 0) { // comes and goes at the cosine only
                assert_true(dot(hit ? x.normal : last.normal, d) < 0.31);
            }
            last = x;
            memcpy(before, p, sizeof p);
        }
    }
    assert_true(pairs > 50000);
    rest_rig_free(&rig);
}

// ---- Region and edge cases ----------------------------------------------------------------------

static void inside_is_the_distance_to_the_rim(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 1.0, 1.0};
    rest_rig_box(&rig, 20, size);
    for (int32_t i = 0; i < rig.model->info.surface_count; i++) { // the top's middle, z = 1
        const double *x = rig.model->position + 3 * i;
        int in = x[2] > 0.999 && x[0] > 0.199 && x[0] < 0.801 && x[1] > 0.199 && x[1] < 0.801;
        rig.model->node_flags[i] = in ? PALPATE_NODE_TOUCHABLE : 0;
    }
    rest_rig_build(&rig, PALPATE_WEIGHTS_NODES, PALPATE_WEIGHTS_POWER);
    for (int n = 0; n < 2000; n++) {
        double p[3] = {0.5 + 0.5 * uniform(), 0.5 + 0.5 * uniform(), 1.0 + 0.1 * uniform()};
        double a = 0.3 - fabs(p[0] - 0.5), b = 0.3 - fabs(p[1] - 0.5);
        double expect = a < 0.0 && b < 0.0 ? -hypot(a, b) : fmin(a, b);
        pal_surface_point x;
        assert_int_equal(pal_rest_closest(&rig.surface, p, 1.0, -1, &x), 1);
        if (x.normal[2] >
            0.999) { // linear between nodes 0.05 apart: cuts the ridges by half of that
            assert_true(fabs(x.inside - expect) < 0.026);
            assert_true(x.inside <= 0.0 || rig.surface.touchable[x.triangle]);
            assert_true(x.inside >= 0.0 || !rig.surface.touchable[x.triangle]);
        }
    }
    rest_rig_free(&rig);
}

static void nonsense_finds_nothing(void **state) {
    (void)state;
    rest_rig rig;
    rest_rig_sphere(&rig, 2, 0.0, one);
    pal_surface_point x;
    const double nan[3] = {NAN, 0, 0}, far[3] = {1e300, 0, 0}, middle[3] = {0, 0, 0};
    const double z[3] = {0, 0, 1}, none[3] = {0, 0, 0};
    assert_int_equal(pal_rest_closest(&rig.surface, nan, 1.0, -1, &x), 0);
    assert_int_equal(x.triangle, -1);
    assert_int_equal(pal_rest_closest(&rig.surface, far, 1.0, -1, &x), 0);
    assert_int_equal(pal_rest_closest(&rig.surface, far, HUGE_VAL, 1 << 30, &x), 0);
    (void)pal_rest_closest(&rig.surface, middle, 2.0, -1, &x); // all equally near: ends, by count
    assert_int_equal(pal_rest_project(&rig.surface, nan, z, 1.0, 0.0, -1, &x), 0);
    assert_int_equal(pal_rest_project(&rig.surface, middle, none, 1.0, 0.0, -1, &x), 0);
    assert_int_equal(pal_rest_project(&rig.surface, middle, z, 2.0, 0.0, -1, &x), 1);
    assert_true(fabs(x.position[2] - 1.0) < 0.01);
    rest_rig_free(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sphere_is_round),
        cmocka_unit_test(box_is_sharp),
        cmocka_unit_test(surface_has_no_gaps),
        cmocka_unit_test(tree_finds_what_all_triangles_give),
        cmocka_unit_test(closest_is_nearest),
        cmocka_unit_test(closest_is_continuous),
        cmocka_unit_test(box_is_rolled_over),
        cmocka_unit_test(track_keeps_its_side),
        cmocka_unit_test(hits_are_continuous),
        cmocka_unit_test(inside_is_the_distance_to_the_rim),
        cmocka_unit_test(nonsense_finds_nothing),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
