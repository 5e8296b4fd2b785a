/// Surface weights: partition of unity, linear reproduction, continuity, thin lobes, candidates.
#include <setjmp.h>
#include <stdarg.h>
#include <stddef.h>
#include <stdint.h>

#include <cmocka.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "tests/support/rest_rig.h"

static uint64_t seed = 9;

static double uniform(void) {
    return rest_rig_random(&seed);
}

static double norm(const double v[3]) {
    return sqrt(v[0] * v[0] + v[1] * v[1] + v[2] * v[2]);
}

static void random_point(const rest_rig *rig, pal_surface_point *x) {
    double b[3] = {uniform() + 1, uniform() + 1, uniform() + 1}, sum = b[0] + b[1] + b[2];
    for (int i = 0; i < 3; i++) {
        b[i] /= sum;
    }
    int32_t t = (int32_t)((uniform() + 1) * 0.5 * rig->surface.triangle_count);
    pal_rest_point(&rig->surface, t, b, x);
}

/// Mean fan normal at a point, which the weights' tangent plane has.
static void fan_normal(const rest_rig *rig, const pal_surface_point *x, double n[3]) {
    for (int i = 0; i < 3; i++) {
        n[i] = 0.0;
        for (int c = 0; c < 3; c++) {
            n[i] += x->weight[c] *
                    rig->surface.node_normal[3 * rig->surface.triangle[3 * x->triangle + c] + i];
        }
    }
    double length = norm(n);
    for (int i = 0; i < 3; i++) {
        n[i] /= length;
    }
}

static void sum_is_one_and_linear_fields_are_kept(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 0.8, 0.5};
    rest_rig_sphere(&rig, 3, 0.2, size);
    for (int n = 0; n < 3000; n++) {
        pal_surface_point x;
        pal_weights w;
        double normal[3], sum = 0.0, mean[3] = {0, 0, 0};
        random_point(&rig, &x);
        assert_true(pal_weights_at(&rig.weights, &x, n % 3 == 0 ? 0.3 : 0.0, &w) >= 4);
        for (int32_t k = 0; k < w.count; k++) {
            assert_true(k == 0 || w.column[k] > w.column[k - 1]);
            const double *y = rig.model->position + 3 * rig.model->column_node[w.column[k]];
            sum += w.phi[k];
            for (int i = 0; i < 3; i++) {
                mean[i] += w.phi[k] * (y[i] - x.position[i]);
            }
        }
        fan_normal(&rig, &x, normal);
        double out = mean[0] * normal[0] + mean[1] * normal[1] + mean[2] * normal[2];
        for (int i = 0; i < 3; i++) {
            mean[i] -= out * normal[i]; // what is left lies in the tangent plane
        }
        assert_true(fabs(sum - 1.0) < 1e-13);
        assert_true(norm(mean) < 1e-12); // rounding, scaled by 1 / THIN at worst
        assert_true(w.sigma > 0.0 && w.sigma < w.radius);
    }
    rest_rig_free(&rig);
}

/// The weights by the formula over all nodes of the model: no candidate is missing.
static void candidates_are_complete(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 0.8, 0.5};
    rest_rig_sphere(&rig, 4, 0.25, size);
    int32_t count = rig.model->info.surface_count;
    double *r = calloc((size_t)count, sizeof *r);
    for (int n = 0; n < 1000; n++) {
        pal_surface_point x;
        pal_weights w;
        double normal[3];
        random_point(&rig, &x);
        fan_normal(&rig, &x, normal);
        (void)pal_weights_at(&rig.weights, &x, n % 2 ? 100.0 : 0.0, &w);
        int below = 0, inside = 0;
        for (int32_t i = 0; i < count; i++) {
            const double *m = rig.surface.node_normal + 3 * i, *y = rig.model->position + 3 * i;
            double d[3] = {y[0] - x.position[0], y[1] - x.position[1], y[2] - x.position[2]};
            double facing = 1.0 + m[0] * normal[0] + m[1] * normal[1] + m[2] * normal[2];
            r[i] = facing > 1e-3 ? norm(d) * 2.0 / facing : 9e9;
            below += r[i] < w.radius * (1.0 - 1e-12);
            inside += r[i] <= w.radius * (1.0 + 1e-12);
        }
        // the support ends at the next node
        int32_t nodes = n % 2 ? PALPATE_WEIGHTS_MAX : PALPATE_WEIGHTS_NODES;
        assert_int_equal(below, nodes);
        assert_int_equal(inside, nodes + 1);
        assert_int_equal(w.count, nodes);
        for (int32_t k = 0; k < w.count; k++) {
            assert_true(r[rig.model->column_node[w.column[k]]] < w.radius);
        }
    }
    free(r);
    rest_rig_free(&rig);
}

/// sum |phi(x) - phi(x')| over nodes along lines over the surface.
static double largest_slope(const rest_rig *rig, const double size[3], double radius, int steps) {
    double *phi[2], slope = 0.0;
    size_t count = (size_t)rig->model->info.column_count;
    phi[0] = calloc(count, sizeof(double));
    phi[1] = calloc(count, sizeof(double));
    for (int n = 0; n < 10; n++) {
        double a[3] = {uniform(), uniform(), uniform()}, b[3] = {uniform(), uniform(), uniform()};
        pal_surface_point x, last = {.triangle = -1};
        pal_weights w;
        for (int k = 0; k <= steps / 10; k++) {
            double p[3], z = (double)k / (steps / 10), sum = 0.0, step = 0.0;
            for (int i = 0; i < 3; i++) {
                p[i] = (1 - z) * a[i] + z * b[i];
            }
            double length = norm(p);
            for (int i = 0; i < 3; i++) {
                p[i] *= 1.02 * size[i] / fmax(length, 0.2);
            }
            if (length < 0.2 || !pal_rest_closest(&rig->surface, p, 1.0, last.triangle, &x)) {
                last.triangle = -1;
                continue;
            }
            memset(phi[k % 2], 0, count * sizeof(double));
            (void)pal_weights_at(&rig->weights, &x, radius, &w);
            for (int32_t i = 0; i < w.count; i++) {
                phi[k % 2][w.column[i]] = w.phi[i];
            }
            for (size_t i = 0; i < count; i++) {
                sum += fabs(phi[0][i] - phi[1][i]);
            }
            for (int i = 0; i < 3; i++) {
                step += (x.position[i] - last.position[i]) * (x.position[i] - last.position[i]);
            }
            if (last.triangle >= 0) {
                slope = fmax(slope, (sum - 1e-9) / sqrt(step));
            }
            last = x;
        }
    }
    free(phi[0]);
    free(phi[1]);
    return slope;
}

static void weights_are_continuous(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 0.8, 0.5};
    rest_rig_sphere(&rig, 3, 0.2, size);
    // phi falls from about 0.3 to 0 over rho = 2 h, over some 12 nodes: slope about 12 * 0.15 / h;
    // shortest edges are near 0.05. A node that jumped in or out with a weight of 0.01 within a
    // step of 2e-5 would give 500.
    double slope = largest_slope(&rig, size, 0.0, 100000);
    double wide = largest_slope(&rig, size, 0.35, 30000);
    rest_rig_free(&rig);
    assert_true(slope > 1.0 && slope < 100.0);
    assert_true(wide > 0.1 && wide < slope);

    const double cube[3] = {1.0, 1.0, 1.0}; // across sharp edges
    rest_rig_box(&rig, 10, cube);
    for (int n = 0; n < 2000; n++) {
        pal_surface_point x[2];
        pal_weights w[2];
        for (int side = 0; side < 2; side++) { // just left and right of the edge x = 1, z = 1
            double at[3] = {side ? 1.0 : 1.0 - 1e-7, 0.111 + 0.35 * (n / 2000.0),
                            side ? 1.0 - 1e-7 : 1.0};
            assert_int_equal(pal_rest_closest(&rig.surface, at, 1.0, -1, &x[side]), 1);
            (void)pal_weights_at(&rig.weights, &x[side], 0.0, &w[side]);
        }
        double change = 0.0;
        for (int32_t k = 0; k < w[0].count; k++) {
            for (int32_t l = 0; l < w[1].count; l++) {
                if (w[0].column[k] == w[1].column[l]) {
                    change += fabs(w[0].phi[k] - w[1].phi[l]);
                    w[1].phi[l] = 0.0;
                }
            }
        }
        for (int32_t l = 0; l < w[1].count; l++) {
            change += w[1].phi[l] > 1e-4 ? w[1].phi[l] : 0.0;
        }
        assert_true(change < 1e-3); // slope 1e3 times the step of 1.4e-7, and nodes that just enter
    }
    rest_rig_free(&rig);
}

/// A plate thinner than the node spacing: points of the top use no node of the bottom.
static void other_side_of_a_thin_lobe_is_absent(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 1.0, 0.02}; // edges are about 0.07 to 0.14
    rest_rig_sphere(&rig, 3, 0.15, size);
    int tops = 0;
    for (int n = 0; n < 5000; n++) {
        pal_surface_point x;
        pal_weights w;
        random_point(&rig, &x);
        if (hypot(x.position[0], x.position[1]) > 0.75 || fabs(x.normal[2]) < 0.95) {
            continue; // at the rim the surface goes round
        }
        tops++;
        (void)pal_weights_at(&rig.weights, &x, n % 2 ? 0.3 : 0.0, &w);
        for (int32_t k = 0; k < w.count; k++) {
            double z = rig.model->position[3 * rig.model->column_node[w.column[k]] + 2];
            assert_true(z * x.normal[2] > 0.0);
        }
    }
    assert_true(tops > 1000);
    rest_rig_free(&rig);
}

/// Only touchable columns carry weight; a lone node carries all of it; far away there is none.
static void small_regions_are_served(void **state) {
    (void)state;
    rest_rig rig;
    const double size[3] = {1.0, 1.0, 1.0};
    rest_rig_sphere(&rig, 2, 0.0, size);
    for (int wanted = 1; wanted < 9; wanted++) {
        for (int32_t i = 0; i < rig.model->info.surface_count; i++) {
            rig.model->node_flags[i] = i < wanted ? PALPATE_NODE_TOUCHABLE : 0;
        }
        rest_rig_build(&rig, PALPATE_WEIGHTS_NODES, PALPATE_WEIGHTS_POWER);
        int some = 0, none = 0;
        for (int n = 0; n < 2000; n++) {
            pal_surface_point x;
            pal_weights w;
            random_point(&rig, &x);
            double sum = 0.0;
            (void)pal_weights_at(&rig.weights, &x, 0.0, &w);
            for (int32_t k = 0; k < w.count; k++) {
                assert_true(w.column[k] < wanted && isfinite(w.phi[k]));
                sum += w.phi[k];
            }
            assert_true(w.count == 0 || fabs(sum - 1.0) < 1e-12);
            some += w.count > 0;
            none += w.count == 0;
        }
        assert_true(some > 10 && none > 10);
    }
    rest_rig_free(&rig);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(sum_is_one_and_linear_fields_are_kept),
        cmocka_unit_test(candidates_are_complete),
        cmocka_unit_test(weights_are_continuous),
        cmocka_unit_test(other_side_of_a_thin_lobe_is_absent),
        cmocka_unit_test(small_regions_are_served),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
