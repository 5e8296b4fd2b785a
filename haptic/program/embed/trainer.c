/// @file trainer.c  A small trainer: a host that owns its loops and its mesh, and embeds
/// libpalpate.
///
/// Not part of the program: it is built against the installed headers and `pkg-config palpate` only
/// (`make trainer`, tests/program/test_install.sh), as a simulator from elsewhere would be.
///
///   servo thread   its own, 1 kHz against absolute deadlines: hand pose in, force out (one tick)
///   main thread    its own render loop, 60 Hz: newest frame -> displacement and normals at the
///                  vertices of its own textured mesh -> vertex buffer, ready for the graphics card
///
/// The mesh is the host's: an OBJ file that the scene named with `skin: {file: ...}` when the model
/// was made. Palpate knows its vertices (`v` lines) by their number in the file; texture
/// coordinates never enter the model. As on every graphics card, a vertex with two texture
/// coordinates (a seam) is two entries of the buffer, both moved by the one skin vertex they come
/// from.
#include <errno.h>
#include <math.h>
#include <pthread.h>
#include <stdatomic.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <palpate/palpate.h>

enum { SERVO_HZ = 1000, RENDER_HZ = 60 };

// ---- The host's mesh
// -------------------------------------------------------------------------------

/// One entry of the vertex buffer, as it would go to the graphics card.
typedef struct vertex {
    float position[3], normal[3], texture[2];
} vertex;

typedef struct mesh {
    int count, corner_count, point_count;
    vertex *buffer; ///< (count)
    int *point;     ///< (count) the skin vertex that moves this entry
    int *corner;    ///< (corner_count) three entries of the buffer per triangle
    double *rest;   ///< (point_count x 3) rest positions of the file's `v` lines, times the scale
} mesh;

static void mesh_clear(mesh *m) {
    free(m->buffer);
    free(m->point);
    free(m->corner);
    free(m->rest);
    *m = (mesh){0};
}

static int mesh_alloc(mesh *m, size_t points, size_t corners) {
    m->rest = calloc(3 * points + 1, sizeof *m->rest);
    m->buffer = calloc(points + corners + 1, sizeof *m->buffer);
    m->point = calloc(points + corners + 1, sizeof *m->point);
    m->corner = calloc(corners + 1, sizeof *m->corner);
    return m->rest != NULL && m->buffer != NULL && m->point != NULL && m->corner != NULL;
}

/// The corners of a triangle, `v`, `v/vt`, `v/vt/vn` or `v//vn` each; vt 0: without.
static int face_read(const char *at, int v[3], int vt[3]) {
    for (int k = 0; k < 3; k++) {
        char *end;
        v[k] = (int)strtol(at, &end, 10);
        vt[k] = 0;
        if (end == at) {
            return 0;
        }
        if (end[0] == '/' && end[1] != '/') {
            vt[k] = (int)strtol(end + 1, &end, 10);
        }
        at = end + strcspn(end, " \t\r\n");
    }
    return at[strspn(at, " \t\r\n")] == '\0'; // a fourth corner: no triangle
}

/// The host's own loader: v, vt and triangles; that is all this one needs.
static int mesh_load(mesh *m, const char *path, double scale) {
    FILE *in = fopen(path, "r");
    char line[512];
    size_t points = 0, textures = 0, corners = 0;
    while (in != NULL && fgets(line, sizeof line, in) != NULL) {
        points += strncmp(line, "v ", 2) == 0;
        textures += strncmp(line, "vt ", 3) == 0;
        corners += strncmp(line, "f ", 2) == 0 ? 3 : 0;
    }
    float *texture = calloc(2 * textures + 1, sizeof *texture);
    int *used =
        calloc(points + corners + 1, sizeof *used); // texture coordinate of each entry; 0: none yet
    int *next = calloc(points + corners + 1, sizeof *next); // further entries of the same point
    int ok = in != NULL && texture != NULL && used != NULL && next != NULL &&
             mesh_alloc(m, points, corners);
    m->point_count = m->count = (int)points;
    if (in != NULL) {
        rewind(in);
    }
    for (size_t p = 0, t = 0; ok && fgets(line, sizeof line, in) != NULL;) {
        double *x = m->rest + 3 * p;
        int v[3], vt[3];
        if (strncmp(line, "v ", 2) == 0) {
            ok = sscanf(line + 2, "%lf %lf %lf", x, x + 1, x + 2) == 3;
            x[0] *= scale, x[1] *= scale, x[2] *= scale;
            m->point[p] = (int)p;
            p++;
        } else if (strncmp(line, "vt ", 3) == 0) {
            ok = sscanf(line + 3, "%f %f", texture + 2 * t, texture + 2 * t + 1) == 2;
            t++;
        } else if (strncmp(line, "f ", 2) == 0) {
            ok = face_read(line + 2, v, vt);
            for (int k = 0; ok && k < 3; k++) {
                ok = v[k] >= 1 && (size_t)v[k] <= p && vt[k] >= 0 && (size_t)vt[k] <= t;
                int entry = v[k] - 1; // the first texture coordinate takes the point's own entry
                while (ok && used[entry] != 0 && used[entry] != vt[k]) {
                    if (next[entry] == 0) {
                        m->point[m->count] = v[k] - 1;
                        next[entry] = m->count++;
                    }
                    entry = next[entry];
                }
                if (ok) {
                    used[entry] = vt[k];
                    if (vt[k] > 0) {
                        memcpy(m->buffer[entry].texture, texture + 2 * (vt[k] - 1),
                               sizeof m->buffer[entry].texture);
                    }
                    m->corner[m->corner_count++] = entry;
                }
            }
        }
    }
    if (in != NULL) {
        (void)fclose(in);
    }
    free(texture);
    free(used);
    free(next);
    return ok;
}

/// Without a mesh of its own the host draws what the model gives it.
static int mesh_from_model(mesh *m, const pal_model *model, int points) {
    int32_t triangles;
    const int32_t *triangle = pal_model_skin_triangles(model, &triangles);
    if (!mesh_alloc(m, (size_t)points, 3 * (size_t)triangles)) {
        return 0;
    }
    m->point_count = m->count = points;
    memcpy(m->rest, pal_model_skin_positions(model), 3 * (size_t)points * sizeof *m->rest);
    for (int i = 0; i < points; i++) {
        m->point[i] = i;
    }
    for (int i = 0; i < 3 * triangles; i++) {
        m->corner[m->corner_count++] = triangle[i];
    }
    return 1;
}

/// The model must have been made with this mesh: same vertices in the same order.
static int mesh_fits(const mesh *m, const pal_model *model, int points) {
    const double *x = pal_model_skin_positions(model);
    int fits = m->point_count == points;
    for (int i = 0; fits && i < 3 * points; i++) {
        fits = fabs(m->rest[i] - x[i]) <= 1e-9 + 1e-6 * fabs(x[i]);
    }
    return fits;
}

/// For anything that can show a textured OBJ: the buffer as it is now.
static int mesh_write(const mesh *m, const char *path) {
    FILE *out = fopen(path, "w");
    for (int i = 0; out != NULL && i < m->count; i++) {
        const vertex *v = m->buffer + i;
        (void)fprintf(out, "v %.9g %.9g %.9g\nvt %.9g %.9g\nvn %.6g %.6g %.6g\n",
                      (double)v->position[0], (double)v->position[1], (double)v->position[2],
                      (double)v->texture[0], (double)v->texture[1], (double)v->normal[0],
                      (double)v->normal[1], (double)v->normal[2]);
    }
    for (int c = 0; out != NULL && c < m->corner_count; c++) {
        int n = m->corner[c] + 1;
        (void)fprintf(out, "%s%d/%d/%d%s", c % 3 == 0 ? "f " : " ", n, n, n,
                      c % 3 == 2 ? "\n" : "");
    }
    return out != NULL && fclose(out) == 0;
}

// ---- The servo thread
// ------------------------------------------------------------------------------

typedef struct servo {
    pal_engine *engine;
    const pal_tool_def *tool;
    double depth; ///< of the press [m]
    int ticks, missed;
    pal_tool_force peak; ///< the tick with the largest force
    uint32_t fault;      ///< PALPATE_FAULT_* met on the way
    atomic_int done;
} servo;

/// What a real host reads from its device: press over 0.5 s, then go round in a circle of 2 mm.
static pal_tool_state hand(const servo *s, int tick) {
    double t = (double)tick / SERVO_HZ,
           press = s->depth * (t < 0.5 ? 0.5 - 0.5 * cos(M_PI * t / 0.5) : 1.0);
    double a[3], b[3], round = t < 0.5 ? 0.0 : 2.0 * M_PI * (t - 0.5);
    const double *n = s->tool->axis;
    int least = fabs(n[0]) < 0.6 ? 0 : 1;
    for (int c = 0; c < 3; c++) {
        a[c] = (c == least) - n[least] * n[c];
    }
    double length = sqrt(a[0] * a[0] + a[1] * a[1] + a[2] * a[2]);
    pal_tool_state state = {.orientation = {1, 0, 0, 0}};
    for (int c = 0; c < 3; c++) {
        int p = (c + 1) % 3, q = (c + 2) % 3;
        b[c] = (n[p] * a[q] - n[q] * a[p]) / length;
        state.position[c] = s->tool->start[c] + press * n[c] +
                            0.002 * ((cos(round) - 1.0) * a[c] / length + sin(round) * b[c]);
    }
    return state;
}

static void *servo_run(void *argument) {
    servo *s = argument;
    const long period = 1000000000L / SERVO_HZ;
    struct timespec next, now;
    (void)clock_gettime(CLOCK_MONOTONIC, &next);
    double largest = -1.0;
    for (int tick = 0; tick < s->ticks; tick++) {
        pal_tool_state state = hand(s, tick);
        pal_tool_force force;
        s->fault |= pal_engine_tick(s->engine, &state, &force);
        // a real host writes force.force to its device here
        double f = sqrt(force.force[0] * force.force[0] + force.force[1] * force.force[1] +
                        force.force[2] * force.force[2]);
        if (f > largest) {
            largest = f;
            s->peak = force;
        }
        next.tv_nsec += period;
        next.tv_sec += next.tv_nsec / 1000000000L;
        next.tv_nsec %= 1000000000L;
        (void)clock_gettime(CLOCK_MONOTONIC, &now);
        double late =
            (double)(now.tv_sec - next.tv_sec) + 1e-9 * (double)(now.tv_nsec - next.tv_nsec);
        if (late > 0.0) { // no catch-up burst: count and go on from here
            s->missed += 1 + (int)(late * SERVO_HZ);
            next = now;
        }
        (void)clock_nanosleep(CLOCK_MONOTONIC, TIMER_ABSTIME, &next, NULL);
    }
    atomic_store(&s->done, 1);
    return NULL;
}

// ---- The render loop
// -------------------------------------------------------------------------------

/// Newest frame -> vertex buffer. @return 1 when there was a new one
static int update(const pal_model *model, pal_reader *reader, mesh *m, float *u, float *normal) {
    pal_frame frame;
    if (pal_engine_snapshot(reader, &frame) != 1 ||
        pal_model_skin(model, &frame, u, normal) != PALPATE_OK) {
        return 0;
    }
    for (int i = 0; i < m->count; i++) {
        size_t at = 3 * (size_t)m->point[i];
        for (size_t c = 0; c < 3; c++) {
            m->buffer[i].position[c] = (float)(m->rest[at + c] + (double)u[at + c]);
            m->buffer[i].normal[c] = normal[at + c];
        }
    }
    return 1; // a real host uploads m->buffer here and draws m->corner
}

static void print_result(const servo *s, const mesh *m, int frames) {
    const double *axis = s->tool->axis;
    double along = 0.0, deepest = 0.0, shortest = 2.0, longest = 0.0;
    for (int c = 0; c < 3; c++) {
        along += s->peak.force[c] * axis[c];
    }
    for (int i = 0; i < m->count; i++) {
        double down = 0.0, square = 0.0;
        for (int c = 0; c < 3; c++) {
            down += ((double)m->buffer[i].position[c] - m->rest[3 * m->point[i] + c]) * axis[c];
            square += (double)m->buffer[i].normal[c] * (double)m->buffer[i].normal[c];
        }
        deepest = fmax(deepest, down);
        shortest = fmin(shortest, sqrt(square));
        longest = fmax(longest, sqrt(square));
    }
    (void)printf("ticks %d\nmissed %d\nframes %d\n", s->ticks, s->missed, frames);
    (void)printf("force_along_axis %.6g\npeak_contacts %d\nfault %#x\n", along,
                 (int)s->peak.contact_count, (unsigned)s->fault);
    (void)printf("depth %.6g\ndeepest_vertex %.6g\n", s->depth, deepest);
    (void)printf("vertices %d\nskin_vertices %d\nnormal_lengths %.6f %.6f\n", m->count,
                 m->point_count, shortest, longest);
}

static int run(const pal_model *model, pal_engine *engine, servo *s, mesh *m) {
    float *u = calloc(3 * (size_t)m->point_count + 1, sizeof *u);
    float *normal = calloc(3 * (size_t)m->point_count + 1, sizeof *normal);
    pal_reader *reader = pal_engine_reader(engine, 0);
    pthread_t thread;
    int frames = 0;
    int ok = u != NULL && normal != NULL && pthread_create(&thread, NULL, servo_run, s) == 0;
    if (ok) {
        const struct timespec pause = {0, 1000000000L / RENDER_HZ};
        while (!atomic_load(&s->done)) {
            frames += update(model, reader, m, u, normal);
            (void)nanosleep(&pause, NULL);
        }
        (void)pthread_join(thread, NULL);
        frames += update(model, reader, m, u, normal);
        print_result(s, m, frames);
    }
    free(u);
    free(normal);
    return ok;
}

int main(int argc, char **argv) {
    if (argc < 2) {
        (void)fprintf(stderr, "usage: trainer MODEL [SECONDS [MESH.obj SCALE [OUT.obj]]]\n");
        return 2;
    }
    pal_error error = {0};
    pal_model *model = NULL;
    pal_engine *engine = NULL;
    mesh m = {0};
    int ok = pal_model_load(argv[1], &model, &error) == PALPATE_OK;
    if (ok && pal_model_runtime(model)->tool_count < 1) {
        ok = 0;
        (void)snprintf(error.message, sizeof error.message, "%.500s: the model has no tool",
                       argv[1]);
    }
    if (ok) {
        pal_model_info info;
        pal_model_get_info(model, &info);
        pal_engine_def def = pal_engine_default_def();
        def.tools = pal_model_runtime(model)->tools;
        def.tool_count = 1;
        ok = pal_engine_create(model, &def, &engine, &error) == PALPATE_OK;
        servo s = {.engine = engine, .tool = def.tools, .depth = 0.004};
        double seconds = argc > 2 ? strtod(argv[2], NULL) : 2.0;
        s.ticks = (int)(seconds * SERVO_HZ);
        int loaded = ok && (argc > 4 ? mesh_load(&m, argv[3], strtod(argv[4], NULL))
                                     : mesh_from_model(&m, model, info.skin_count));
        if (ok && (!loaded || !mesh_fits(&m, model, info.skin_count))) {
            ok = 0;
            (void)snprintf(
                error.message, sizeof error.message,
                "%.500s: not the triangle mesh that the model was made with; name it in the scene: "
                "skin: {file: ..., scale: ...}",
                argc > 3 ? argv[3] : argv[1]);
        }
        ok = ok && run(model, engine, &s, &m) && (argc <= 5 || mesh_write(&m, argv[5]));
    }
    if (!ok) {
        (void)fprintf(stderr, "trainer: %s\n",
                      error.message[0] != '\0' ? error.message : strerror(errno));
    }
    mesh_clear(&m);
    pal_engine_free(engine);
    pal_model_free(model);
    return ok ? 0 : 1;
}
