/// @file simulated.c  A simulated device: figures, and the motion of one axis (equation:
/// simulated.h).
///
/// Figures of the devices: the makers' data sheets. Touch, formerly Phantom Omni (3D Systems,
/// SensAble Technologies): apparent mass at the tip about 45 g, back-drive friction below 0.26 N,
/// about 0.055 mm (450 dpi), 3.3 N at the nominal position, 1.02 to 2.31 N/mm by axis, 160 x 120 x
/// 70 mm. Phantom Premium 1.5: below 75 g, 0.04 N, 0.03 mm (860 dpi), 8.5 N, 3.5 N/mm, 381 x 267 x
/// 191 mm. Data sheets give no viscous damping. Diolaiti, Niemeyer, Barbagli and Salisbury (IEEE
/// Trans. Robotics 22(2), 2006) and Abbott and Okamura (IEEE Trans. Robotics 21(5), 2005) find that
/// Coulomb friction, not viscous damping, is what keeps such devices stable, so 0.1 N s/m is an
/// assumption on the low side; both names are therefore keys of the scene.
///
/// Hand: mass 0.554 kg, damping 6.45 N s/m, stiffness 135 N/m, measured on an arm that holds a
/// haptic handle (van Beek, Bergmann Tiest, Mugge and Kappers, Scientific Reports 5:18004, 2015,
/// Fig. 3). The second-order form is that of Hasser and Cutkosky (Haptics Symposium 2002). The
/// light grip is no measurement: a tenth of everything, a harder case for stability.
#include "haptic/device/simulated.h"

#include <math.h>
#include <string.h>

#include <palpate/session.h>

enum { TERMS = 20, EVENTS_MAX = 64, BISECTIONS = 80 };

pal_simulated pal_simulated_default(pal_simulated_model model, pal_simulated_grip grip) {
    pal_simulated s = {.mass = 0.045,
                       .damping = 0.1,
                       .friction = 0.26,
                       .resolution = 5.5e-5,
                       .force = 3.3,
                       .stiffness = 1020.0,
                       .reach = 0.08};
    if (model == PALPATE_SIMULATED_PREMIUM) {
        s = (pal_simulated){.mass = 0.075,
                            .damping = 0.1,
                            .friction = 0.04,
                            .resolution = 3e-5,
                            .force = 8.5,
                            .stiffness = 3500.0,
                            .reach = 0.19};
    }
    s.model = model;
    s.grip = grip;
    if (grip != PALPATE_GRIP_NONE) {
        double part = grip == PALPATE_GRIP_LIGHT ? 0.1 : 1.0;
        s.hand_mass = 0.554 * part;
        s.hand_damping = 6.45 * part;
        s.hand_stiffness = 135.0 * part;
    }
    return s;
}

double pal_axis_rate(const pal_axis *axis) {
    return axis->damping / axis->mass + sqrt(axis->stiffness / axis->mass);
}

/// Power series in time of the distance to the reference's start and of the velocity.
typedef struct series {
    double y[TERMS + 1], v[TERMS + 1];
} series;

/// @param push  constant force [N]; @param slope  force per second [N/s]
static void expand(const pal_axis *a, double y, double v, double push, double slope, series *out) {
    out->y[0] = y;
    out->v[0] = v;
    for (int n = 0; n < TERMS; n++) {
        double f = (n == 0   ? push
                    : n == 1 ? slope
                             : 0.0) -
                   a->damping * out->v[n] - a->stiffness * out->y[n];
        out->y[n + 1] = out->v[n] / (n + 1);
        out->v[n + 1] = f / (a->mass * (n + 1));
    }
}

static double value(const double c[TERMS + 1], double t) {
    double sum = c[TERMS];
    for (int n = TERMS - 1; n >= 0; n--) {
        sum = sum * t + c[n];
    }
    return sum;
}

static double slope_at(const double c[TERMS + 1], double t) {
    double sum = TERMS * c[TERMS];
    for (int n = TERMS - 1; n >= 1; n--) {
        sum = sum * t + n * c[n];
    }
    return sum;
}

/// Zero of f between low, where f sgn > 0, and high, where it is not.
static double bisect(double (*f)(const double *, double), const double *c, double sgn, double low,
                     double high) {
    for (int i = 0; i < BISECTIONS; i++) {
        double middle = 0.5 * (low + high);
        if (!(middle > low && middle < high)) {
            break;
        }
        if (f(c, middle) * sgn > 0.0) {
            low = middle;
        } else {
            high = middle;
        }
    }
    return high;
}

/// First time in (0, time] at which the velocity, of sign sgn from the start on, comes to 0; -1:
/// none. The time is at most 1 / rate, so the velocity has at most one extremum in it that matters.
static double stop_time(const series *s, double sgn, double time) {
    double from = 0.0, to = time;
    double v_end = value(s->v, time) * sgn;
    double bend = slope_at(s->v, 0.0) * sgn, bend_end = slope_at(s->v, time) * sgn;
    if (v_end > 0.0) {
        if (!(bend < 0.0 && bend_end > 0.0)) {
            return -1.0;
        }
        to = bisect(slope_at, s->v, -sgn, 0.0, time); // lowest speed on the way
        if (value(s->v, to) * sgn > 0.0) {
            return -1.0;
        }
    } else if (!(s->v[0] * sgn > 0.0)) { // from rest: up, then down
        from = bend_end < 0.0 ? bisect(slope_at, s->v, sgn, 0.0, time) : 0.0;
    }
    return bisect(value, s->v, sgn, from, to);
}

void pal_axis_advance(const pal_axis *axis, double time, double force, double reference,
                      double rate, double state[2]) {
    double most = 1.0 / fmax(pal_axis_rate(axis), 1e-9);
    double y = state[0] - reference, v = state[1], done = 0.0;
    double c = axis->friction, slope = axis->stiffness * rate;
    int events = 0;
    while (done < time) {
        // forces other than friction, spring and damper, now
        double push = force + axis->hand_damping * rate + slope * done;
        double left = time - done, sgn = v > 0.0 ? 1.0 : v < 0.0 ? -1.0 : 0.0;
        if (c > 0.0 && sgn == 0.0) {
            double net = push - axis->stiffness * y;
            if (fabs(net) <= c || events >= EVENTS_MAX) {
                // it sticks until the reference has pulled the spring far enough
                double wait = slope > 0.0   ? (c - net) / slope
                              : slope < 0.0 ? (-c - net) / slope
                                            : left;
                if (!(wait < left) || events >= EVENTS_MAX) {
                    break;
                }
                events++;
                done += fmax(wait, 0.0);
                push = force + axis->hand_damping * rate + slope * done;
                left = time - done;
                sgn = slope > 0.0 ? 1.0 : -1.0;
            } else {
                sgn = net > 0.0 ? 1.0 : -1.0;
            }
        }
        double step = fmin(left, most);
        series s;
        expand(axis, y, v, push - c * sgn, slope, &s);
        double stop = c > 0.0 ? stop_time(&s, sgn, step) : -1.0;
        if (stop >= 0.0) {
            events++;
            y = value(s.y, stop);
            v = 0.0;
            done += stop;
        } else {
            y = value(s.y, step);
            v = value(s.v, step);
            done = step < left ? done + step : time;
        }
    }
    state[0] = reference + y;
    state[1] = v;
}
