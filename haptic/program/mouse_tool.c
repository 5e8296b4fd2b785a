/// @file mouse_tool.c  The mouse as a tool (see mouse_tool.h).
#include "haptic/program/mouse_tool.h"

#include <math.h>
#include <stdatomic.h>
#include <stdlib.h>
#include <string.h>

struct mouse_tool {
    pal_device inner, host;
    _Atomic int use_mouse, paused, restart;
    int64_t offset, last; ///< servo thread only [ns]
};

static pal_status open_both(void *self, pal_error *error) {
    mouse_tool *m = self;
    pal_status status = m->inner.open != NULL ? m->inner.open(m->inner.self, error) : PALPATE_OK;
    if (status == PALPATE_OK && m->host.open != NULL) {
        status = m->host.open(m->host.self, error);
    }
    return status;
}

/// The inner device sees a time that stands still while paused and starts anew on a restart.
static pal_status read_one(void *self, int64_t time_ns, pal_tool_state *state) {
    mouse_tool *m = self;
    if (atomic_exchange_explicit(&m->restart, 0, memory_order_relaxed)) {
        m->offset = time_ns;
    }
    if (atomic_load_explicit(&m->paused, memory_order_relaxed)) {
        m->offset += time_ns - m->last;
    }
    m->last = time_ns;
    if (atomic_load_explicit(&m->use_mouse, memory_order_relaxed)) {
        return m->host.read(m->host.self, time_ns, state);
    }
    return m->inner.read(m->inner.self, time_ns - m->offset, state);
}

/// What the inner device feels: the force, or nothing while the mouse leads.
static pal_status write_one(void *self, int64_t time_ns, const pal_tool_force *force) {
    mouse_tool *m = self;
    const pal_tool_force nothing = {0};
    if (m->inner.write == NULL) {
        return PALPATE_OK;
    }
    int mouse = atomic_load_explicit(&m->use_mouse, memory_order_relaxed);
    return m->inner.write(m->inner.self, time_ns - m->offset, mouse ? &nothing : force);
}

static void close_both(void *self) {
    mouse_tool *m = self;
    if (m->inner.close != NULL) {
        m->inner.close(m->inner.self);
    }
    if (m->host.close != NULL) {
        m->host.close(m->host.self);
    }
}

/// Orientation that turns the local z axis to `z` (unit).
static void turn_z(const double z[3], double q[4]) {
    if (z[2] < -1.0 + 1e-12) {
        q[0] = q[2] = q[3] = 0.0;
        q[1] = 1.0;
        return;
    }
    double w = 1.0 + z[2], size = sqrt(w * w + z[0] * z[0] + z[1] * z[1]);
    q[0] = w / size;
    q[1] = -z[1] / size;
    q[2] = z[0] / size;
    q[3] = 0.0;
}

pal_pose mouse_tool_pose(const pal_tool_def *tool, const double point[3], const double normal[3],
                         double depth) {
    pal_pose pose;
    double reach = tool->shape == PALPATE_SHAPE_POINT ? 0.0 : tool->radius;
    if (tool->shape == PALPATE_SHAPE_CAPSULE) {
        reach += 0.5 * tool->length;
    }
    for (int d = 0; d < 3; d++) {
        pose.position[d] = point[d] + (reach - depth) * normal[d];
    }
    turn_z(normal, pose.orientation);
    return pose;
}

mouse_tool *mouse_tool_create(const pal_device *inner, const pal_tool_def *tool, pal_device *out) {
    mouse_tool *m = calloc(1, sizeof *m);
    pal_pose start = {.orientation = {1.0, 0.0, 0.0, 0.0}};
    if (m == NULL) {
        return NULL;
    }
    memcpy(start.position, tool->start, sizeof start.position);
    m->inner = *inner;
    if (pal_device_host_create(&start, &m->host, NULL) != PALPATE_OK) {
        free(m);
        return NULL;
    }
    memset(out, 0, sizeof *out);
    out->abi = PALPATE_DEVICE_ABI;
    out->self = m;
    out->spec = inner->spec;
    out->open = open_both;
    out->read = read_one;
    out->write = write_one;
    out->close = close_both;
    return m;
}

void mouse_tool_free(mouse_tool *m) {
    free(m);
}

void mouse_tool_select(mouse_tool *m, int mouse) {
    atomic_store_explicit(&m->use_mouse, mouse, memory_order_relaxed);
}

void mouse_tool_pause(mouse_tool *m, int paused) {
    atomic_store_explicit(&m->paused, paused, memory_order_relaxed);
}

void mouse_tool_restart(mouse_tool *m) {
    atomic_store_explicit(&m->restart, 1, memory_order_relaxed);
}

void mouse_tool_set(mouse_tool *m, const pal_pose *pose) {
    pal_device_host_set(&m->host, pose, 0);
}

int mouse_tool_pick(const pal_model *model, const double origin[3], const double direction[3],
                    double point[3], double normal[3]) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    const double *x = pal_model_positions(model);
    const int32_t *triangle = pal_model_triangles(model);
    double best = (double)INFINITY;
    for (int32_t t = 0; t < info.triangle_count; t++) {
        // Moeller, Trumbore 1997
        const double *a = x + 3 * (size_t)triangle[3 * t], *b = x + 3 * (size_t)triangle[3 * t + 1];
        const double *c = x + 3 * (size_t)triangle[3 * t + 2];
        double e[3], f[3], s[3];
        for (int d = 0; d < 3; d++) {
            e[d] = b[d] - a[d];
            f[d] = c[d] - a[d];
            s[d] = origin[d] - a[d];
        }
        double p[3] = {direction[1] * f[2] - direction[2] * f[1],
                       direction[2] * f[0] - direction[0] * f[2],
                       direction[0] * f[1] - direction[1] * f[0]};
        double q[3] = {s[1] * e[2] - s[2] * e[1], s[2] * e[0] - s[0] * e[2],
                       s[0] * e[1] - s[1] * e[0]};
        double det = e[0] * p[0] + e[1] * p[1] + e[2] * p[2];
        if (!(det > 0.0)) { // the back of a triangle, or seen from its side
            continue;
        }
        double u = (s[0] * p[0] + s[1] * p[1] + s[2] * p[2]) / det;
        double v = (direction[0] * q[0] + direction[1] * q[1] + direction[2] * q[2]) / det;
        double at = (f[0] * q[0] + f[1] * q[1] + f[2] * q[2]) / det;
        if (u < 0.0 || v < 0.0 || u + v > 1.0 || at <= 0.0 || at >= best) {
            continue;
        }
        best = at;
        double n[3] = {e[1] * f[2] - e[2] * f[1], e[2] * f[0] - e[0] * f[2],
                       e[0] * f[1] - e[1] * f[0]};
        double size = sqrt(n[0] * n[0] + n[1] * n[1] + n[2] * n[2]);
        for (int d = 0; d < 3; d++) {
            point[d] = origin[d] + at * direction[d];
            normal[d] = n[d] / size;
        }
    }
    return isfinite(best);
}
