/// Selectors: is a point of the rest shape in a list's union?
///
/// Inclusive with a tolerance of 1e-6 body sizes (largest extent of the bounding box): mesh
/// generators put the nodes of a face at z = 0 at 1e-17. Pure function; any thread.
#include <float.h>
#include <math.h>

#include "src/scene/scene.h"

static const double TOLERANCE = 1e-6;

/// How far x lies outside a selector [m]; 0 or less: inside.
static double outside(const pal_selector *s, const double x[3]) {
    double d = 0.0;
    switch (s->kind) {
    case PALPATE_SELECT_ALL:
        return 0.0;
    case PALPATE_SELECT_BALL:
        return hypot(hypot(x[0] - s->center[0], x[1] - s->center[1]), x[2] - s->center[2]) -
               s->radius;
    case PALPATE_SELECT_BOX: // distance along the worst axis, so that the tolerance is a larger box
        for (int i = 0; i < 3; i++) {
            d = fmax(d, fmax(s->low[i] - x[i], x[i] - s->high[i]));
        }
        return d;
    case PALPATE_SELECT_BELOW:
        return x[s->axis] - s->value;
    case PALPATE_SELECT_ABOVE:
        return s->value - x[s->axis];
    }
    return DBL_MAX;
}

double pal_select_distance(const pal_selector_list *list, const double x[3]) {
    double best = DBL_MAX;
    for (int32_t i = 0; i < list->count; i++) {
        best = fmin(best, fmax(0.0, outside(&list->item[i], x)));
    }
    return best;
}

int pal_select(const pal_selector_list *list, const double x[3], double body_size) {
    for (int32_t i = 0; i < list->count; i++) {
        if (outside(&list->item[i], x) <= TOLERANCE * body_size) {
            return 1;
        }
    }
    return 0;
}
