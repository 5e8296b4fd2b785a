/// Selectors: is a point of the rest shape in a list's union?
///
/// Inclusive with a tolerance of 1e-6 body sizes (largest extent of the bounding box): mesh generators
/// put the nodes of a face at z = 0 at 1e-17. Pure function; any thread.
#include "src/scene.h"

static const double TOLERANCE = 1e-6;

static int selects(const pal_selector *s, const double x[3], double tolerance) {
    switch (s->kind) {
    case PALPATE_SELECT_ALL:
        return 1;
    case PALPATE_SELECT_BALL: {
        double d2 = 0.0;
        for (int i = 0; i < 3; i++) {
            d2 += (x[i] - s->center[i]) * (x[i] - s->center[i]);
        }
        return d2 <= (s->radius + tolerance) * (s->radius + tolerance);
    }
    case PALPATE_SELECT_BOX:
        for (int i = 0; i < 3; i++) {
            if (!(x[i] >= s->low[i] - tolerance && x[i] <= s->high[i] + tolerance)) {
                return 0;
            }
        }
        return 1;
    case PALPATE_SELECT_BELOW:
        return x[s->axis] <= s->value + tolerance;
    case PALPATE_SELECT_ABOVE:
        return x[s->axis] >= s->value - tolerance;
    }
    return 0;
}

int pal_select(const pal_selector_list *list, const double x[3], double body_size) {
    for (int32_t i = 0; i < list->count; i++) {
        if (selects(&list->item[i], x, TOLERANCE * body_size)) {
            return 1;
        }
    }
    return 0;
}
