/// @file output.c  Finite check, slew limit, force cap, torque cap (see output.h).
#include "haptic/safety/output.h"

#include <math.h>

enum { BIT_FORCE = 1, BIT_CAP = 4, BIT_SLEW = 5, BIT_TORQUE_CAP = 7 };
_Static_assert(PALPATE_FAULT_FORCE == 1u << BIT_FORCE && PALPATE_FAULT_CAP == 1u << BIT_CAP &&
                   PALPATE_FAULT_SLEW == 1u << BIT_SLEW &&
                   PALPATE_FAULT_TORQUE_CAP == 1u << BIT_TORQUE_CAP,
               "bits of PALPATE_FAULT_LIST");

/// The lesser of two maxima of which 0 is unknown.
static double lesser(double a, double b) {
    return a > 0.0 && b > 0.0 ? fmin(a, b) : fmax(a, b);
}

pal_device_spec pal_spec_merge(const pal_device_spec *scene, const pal_device_spec *own) {
    pal_device_spec spec = own->name[0] != 0 ? *own : *scene;
    spec.max_force = lesser(scene->max_force, own->max_force);
    spec.max_torque = lesser(scene->max_torque, own->max_torque);
    spec.max_stiffness = lesser(scene->max_stiffness, own->max_stiffness);
    spec.max_damping = lesser(scene->max_damping, own->max_damping);
    spec.max_speed = lesser(scene->max_speed, own->max_speed);
    spec.damping = own->damping > 0.0 ? own->damping : scene->damping;
    spec.resolution = own->resolution > 0.0 ? own->resolution : scene->resolution;
    return spec;
}

static double resolve(double limit, double most, double usual) {
    double asked = limit > 0.0 ? limit : most > 0.0 ? most : usual;
    return most > 0.0 ? fmin(asked, most) : asked;
}

pal_tool_limits pal_limits_resolve(const pal_tool_limits *limits, const pal_device_spec *spec) {
    return (pal_tool_limits){
        .force = resolve(limits->force, spec->max_force, PALPATE_DEFAULT_FORCE),
        .slew = resolve(limits->slew, 0.0, PALPATE_DEFAULT_SLEW),
        .torque = resolve(limits->torque, spec->max_torque, PALPATE_DEFAULT_TORQUE)};
}

void pal_output_init(pal_output *output, const pal_tool_limits *limits, double period) {
    *output = (pal_output){.limits = *limits, .step = limits->slew * 1e3 * period};
}

void pal_output_reset(pal_output *output) {
    output->force[0] = output->force[1] = output->force[2] = 0.0;
}

static double length(const double v[3]) {
    double largest = fmax(fabs(v[0]), fmax(fabs(v[1]), fabs(v[2])));
    if (!(largest > 0.0)) {
        return 0.0;
    }
    double x = v[0] / largest, y = v[1] / largest, z = v[2] / largest; // no overflow on the way
    return largest * sqrt(x * x + y * y + z * z);
}

static int finite3(const double v[3]) {
    return isfinite(v[0]) && isfinite(v[1]) && isfinite(v[2]);
}

/// Shorten v to at most `most`. @return its old length when it was longer, else 0.
static double shorten(double v[3], double most) {
    double is = length(v);
    if (!(is > most)) {
        return 0.0;
    }
    for (int i = 0; i < 3; i++) {
        v[i] *= most / is;
    }
    return is;
}

uint32_t pal_output_apply(pal_output *output, pal_tool_force *force, double value[32]) {
    uint32_t fault = 0;
    if (!finite3(force->force) || !finite3(force->torque) || !isfinite(length(force->force)) ||
        !isfinite(length(force->torque))) {
        fault |= PALPATE_FAULT_FORCE;
        value[BIT_FORCE] = length(force->force);
        for (int i = 0; i < 3; i++) {
            force->force[i] = force->torque[i] = 0.0;
        }
    } else {
        double change[3];
        for (int i = 0; i < 3; i++) {
            change[i] = force->force[i] - output->force[i];
        }
        double moved = shorten(change, output->step);
        if (moved > 0.0) {
            fault |= PALPATE_FAULT_SLEW;
            value[BIT_SLEW] = moved;
            for (int i = 0; i < 3; i++) {
                force->force[i] = output->force[i] + change[i];
            }
        }
    }
    double was = shorten(force->force, output->limits.force);
    if (was > 0.0) {
        fault |= PALPATE_FAULT_CAP;
        value[BIT_CAP] = was;
    }
    was = shorten(force->torque, output->limits.torque);
    if (was > 0.0) {
        fault |= PALPATE_FAULT_TORQUE_CAP;
        value[BIT_TORQUE_CAP] = was;
    }
    for (int i = 0; i < 3; i++) {
        output->force[i] = force->force[i];
    }
    force->fault |= fault;
    return fault;
}
