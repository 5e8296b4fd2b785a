/// @file soup.h  What must hold of any surface a reader returned, for fuzz targets.
#ifndef PALPATE_TESTS_FUZZ_SOUP_H
#define PALPATE_TESTS_FUZZ_SOUP_H

#include <math.h>
#include <stdlib.h>

#include "src/geometry/surface.h"

static inline void soup_check(pal_surface *s) {
    for (int64_t i = 0; i < 3 * (int64_t)s->vertex_count; i++) {
        if (!isfinite(s->x[i])) {
            abort();
        }
    }
    for (int64_t i = 0; i < 3 * (int64_t)s->triangle_count; i++) {
        if (s->v[i] < 0 || s->v[i] >= s->vertex_count) {
            abort();
        }
    }
    int32_t repaired = 0;
    pal_error error = {0};
    if (pal_surface_check(s, 1.0, &repaired, &error) != PALPATE_OK && error.message[0] == 0) {
        abort();
    }
}

#endif
