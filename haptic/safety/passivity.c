/// @file passivity.c  Passivity observer (formulas: passivity.h).
#include "haptic/safety/passivity.h"

#include <math.h>
#include <string.h>

double pal_passivity_tick(pal_passivity *p, const double position[3], const double force[3]) {
    double work = 0.0, finite = 0.0;
    for (int k = 0; k < 3; k++) {
        work += p->force[k] * (position[k] - p->position[k]);
        finite += 0.0 * position[k] + 0.0 * force[k];
    }
    if (!p->started || !isfinite(work)) {
        work = 0.0;
    }
    p->given += work > 0.0 ? work : 0.0;
    p->taken += work < 0.0 ? -work : 0.0;
    p->worst = fmax(p->worst, p->given - p->taken);
    p->started = finite == 0.0;
    if (p->started) {
        memcpy(p->position, position, sizeof p->position);
        memcpy(p->force, force, sizeof p->force);
    }
    return work;
}

double pal_passivity_mark(pal_passivity *p) {
    double net = p->given - p->taken, since = net - p->mark;
    p->mark = net;
    return since;
}
