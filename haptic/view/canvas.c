/// @file canvas.c  The picture: surface coloured by displacement, tools, force arrows, overlay.
///
/// OpenGL 3.3 core. One dynamic vertex buffer for the surface (corners with their own normals), one
/// static one with three unit solids (sphere, cylinder, cone) that tools and arrows are made of,
/// one texture for the overlay drawn by cairo.
#include "haptic/view/view.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include <cglm/cglm.h>
#include <epoxy/gl.h>

#include "haptic/base/error.h"
#include "haptic/view/surface_mesh.h"

enum { SLICES = 32, STACKS = 16, COLOURS = 64 };
typedef enum solid { SOLID_SPHERE, SOLID_CYLINDER, SOLID_CONE, SOLID_COUNT } solid;

struct pal_canvas {
    pal_surface_mesh mesh;
    double center[3], size; ///< of the rest shape: bounding box centre and diagonal
    GLuint program, overlay_program, background_program;
    GLuint surface_array, surface_buffer, solid_array, solid_buffer, empty_array, texture;
    GLint first[SOLID_COUNT], count[SOLID_COUNT];
    uint8_t *overlay;
    int overlay_width, overlay_height;
    mat4 view, projection;
    int width, height;
};

static const char surface_vertex[] =
    "#version 330 core\n"
    "layout(location=0) in vec3 position; layout(location=1) in vec3 normal;\n"
    "layout(location=2) in float value;\n"
    "uniform mat4 model, view, projection; uniform mat3 turn;\n"
    "out vec3 eye_normal, eye_position; out float shade_value;\n"
    "void main() { vec4 p = view * model * vec4(position, 1.0);\n"
    "  eye_position = p.xyz; eye_normal = turn * normal; shade_value = value;\n"
    "  gl_Position = projection * p; }\n";
static const char surface_fragment[] =
    "#version 330 core\n"
    "in vec3 eye_normal, eye_position; in float shade_value; out vec4 colour;\n"
    "uniform float range; uniform vec3 flat_colour; uniform int use_scale;\n"
    "uniform vec3 scale[64];\n"
    "void main() {\n"
    "  vec3 n = normalize(eye_normal); if (!gl_FrontFacing) n = -n;\n"
    "  vec3 e = normalize(-eye_position);\n"
    "  vec3 key = normalize(vec3(0.4, 0.7, 0.8)), fill = normalize(vec3(-0.8, 0.2, 0.4));\n"
    "  vec3 base = flat_colour;\n"
    "  if (use_scale == 1) { float t = clamp(shade_value / range, 0.0, 1.0) * 63.0;\n"
    "    int i = int(min(t, 62.0)); base = mix(scale[i], scale[i + 1], t - float(i));\n"
    "  }\n"
    "  float light = 0.28 + 0.62 * max(dot(n, key), 0.0) + 0.22 * max(dot(n, fill), 0.0);\n"
    "  float shine = pow(max(dot(n, normalize(key + e)), 0.0), 40.0);\n"
    "  colour = vec4(base * light + 0.18 * shine, 1.0); }\n";
static const char screen_vertex[] =
    "#version 330 core\n"
    "out vec2 at;\n"
    "void main() { vec2 p = vec2((gl_VertexID << 1) & 2, gl_VertexID & 2); at = p;\n"
    "  gl_Position = vec4(p * 2.0 - 1.0, 0.0, 1.0); }\n";
static const char background_fragment[] = "#version 330 core\n"
                                          "in vec2 at; out vec4 colour;\n"
                                          "void main() { colour = vec4(mix(vec3(0.78, 0.81, 0.86), "
                                          "vec3(0.96, 0.97, 0.99), at.y), 1.0); }\n";
static const char overlay_fragment[] =
    "#version 330 core\n"
    "in vec2 at; out vec4 colour; uniform sampler2D picture;\n"
    "void main() { colour = texture(picture, vec2(at.x, 1.0 - at.y)); }\n";

static GLuint compile(GLenum kind, const char *source, pal_error *error) {
    GLuint shader = glCreateShader(kind);
    GLint ok = 0;
    glShaderSource(shader, 1, &source, NULL);
    glCompileShader(shader);
    glGetShaderiv(shader, GL_COMPILE_STATUS, &ok);
    if (!ok) {
        char log[512] = "";
        glGetShaderInfoLog(shader, sizeof log, NULL, log);
        (void)pal_fail(error, PALPATE_ERROR_SYSTEM, "the OpenGL driver refuses a shader: %.300s",
                       log);
        glDeleteShader(shader);
        return 0;
    }
    return shader;
}

static GLuint link_program(const char *vertex, const char *fragment, pal_error *error) {
    GLuint v = compile(GL_VERTEX_SHADER, vertex, error);
    GLuint f = v ? compile(GL_FRAGMENT_SHADER, fragment, error) : 0;
    GLuint program = 0;
    if (v && f) {
        GLint ok = 0;
        program = glCreateProgram();
        glAttachShader(program, v);
        glAttachShader(program, f);
        glLinkProgram(program);
        glGetProgramiv(program, GL_LINK_STATUS, &ok);
        if (!ok) {
            (void)pal_fail(error, PALPATE_ERROR_SYSTEM, "the OpenGL driver cannot link a program");
            glDeleteProgram(program);
            program = 0;
        }
    }
    glDeleteShader(v);
    glDeleteShader(f);
    return program;
}

/// Point of a unit solid of revolution around z at height parameter s in [0,1] and angle a.
static void solid_point(solid kind, double s, double a, float *out) {
    double r = 1.0, z = s, nr = 1.0, nz = 0.0;
    if (kind == SOLID_SPHERE) {
        r = sin(M_PI * s);
        z = -cos(M_PI * s);
        nr = r;
        nz = z;
    } else if (kind == SOLID_CONE) {
        r = 1.0 - s;
        nz = nr = sqrt(0.5);
    }
    float p[7] = {(float)(r * cos(a)),  (float)(r * sin(a)), (float)z, (float)(nr * cos(a)),
                  (float)(nr * sin(a)), (float)nz,           0.0F};
    memcpy(out, p, sizeof p);
}

static pal_status build_solids(pal_canvas *c, pal_error *error) {
    size_t total = (size_t)SOLID_COUNT * STACKS * SLICES * 6;
    float *data = malloc(total * PALPATE_CORNER_FLOATS * sizeof *data);
    if (data == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    GLint at = 0;
    for (int kind = 0; kind < SOLID_COUNT; kind++) {
        int stacks = kind == SOLID_SPHERE ? STACKS : 1;
        c->first[kind] = at;
        for (int i = 0; i < stacks; i++) {
            for (int j = 0; j < SLICES; j++) {
                static const int corner[6][2] = {{0, 0}, {0, 1}, {1, 1}, {0, 0}, {1, 1}, {1, 0}};
                for (int k = 0; k < 6; k++) {
                    solid_point((solid)kind, (i + corner[k][0]) / (double)stacks,
                                2.0 * M_PI * (j + corner[k][1]) / SLICES,
                                data + (size_t)at * PALPATE_CORNER_FLOATS);
                    at++;
                }
            }
        }
        c->count[kind] = at - c->first[kind];
    }
    glGenVertexArrays(1, &c->solid_array);
    glGenBuffers(1, &c->solid_buffer);
    glBindVertexArray(c->solid_array);
    glBindBuffer(GL_ARRAY_BUFFER, c->solid_buffer);
    glBufferData(GL_ARRAY_BUFFER, (GLsizeiptr)((size_t)at * PALPATE_CORNER_FLOATS * sizeof *data),
                 data, GL_STATIC_DRAW);
    free(data);
    return PALPATE_OK;
}

static void corner_layout(void) {
    GLsizei stride = PALPATE_CORNER_FLOATS * (GLsizei)sizeof(float);
    for (GLuint i = 0; i < 3; i++) {
        glEnableVertexAttribArray(i);
        glVertexAttribPointer(i, i < 2 ? 3 : 1, GL_FLOAT, GL_FALSE, stride,
                              (const char *)0 + 3 * i * sizeof(float));
    }
}

pal_camera pal_camera_default(const pal_model *model) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    pal_camera camera = {.azimuth = -1.0, .elevation = 0.6, .distance = 1.75};
    const pal_runtime_config *runtime = pal_model_runtime(model);
    int aimed = runtime->tool_count > 0 && runtime->tools[0].has_start;
    for (int d = 0; d < 3; d++) {
        camera.center[d] = 0.5 * (info.bounds_min[d] + info.bounds_max[d]);
        if (aimed) {
            camera.center[d] = 0.5 * (camera.center[d] + runtime->tools[0].start[d]);
            camera.distance = 1.15;
        }
    }
    return camera;
}

pal_status pal_canvas_create(const pal_model *model, pal_canvas **out, pal_error *error) {
    *out = NULL;
    pal_canvas *c = calloc(1, sizeof *c);
    if (c == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    pal_model_info info;
    pal_model_get_info(model, &info);
    double square = 0.0;
    for (int d = 0; d < 3; d++) {
        double extent = info.bounds_max[d] - info.bounds_min[d];
        c->center[d] = 0.5 * (info.bounds_min[d] + info.bounds_max[d]);
        square += extent * extent;
    }
    c->size = sqrt(square);
    pal_status status = pal_surface_mesh_create(model, &c->mesh, error);
    if (status == PALPATE_OK) {
        c->program = link_program(surface_vertex, surface_fragment, error);
        c->overlay_program = link_program(screen_vertex, overlay_fragment, error);
        c->background_program = link_program(screen_vertex, background_fragment, error);
        if (!c->program || !c->overlay_program || !c->background_program) {
            status = PALPATE_ERROR_SYSTEM;
        }
    }
    if (status == PALPATE_OK) {
        status = build_solids(c, error);
    }
    if (status != PALPATE_OK) {
        pal_canvas_free(c);
        return status;
    }
    corner_layout();
    glGenVertexArrays(1, &c->surface_array);
    glGenBuffers(1, &c->surface_buffer);
    glBindVertexArray(c->surface_array);
    glBindBuffer(GL_ARRAY_BUFFER, c->surface_buffer);
    corner_layout();
    glGenVertexArrays(1, &c->empty_array);
    glGenTextures(1, &c->texture);
    *out = c;
    return PALPATE_OK;
}

void pal_canvas_free(pal_canvas *c) {
    if (c == NULL) {
        return;
    }
    if (c->program) {
        GLuint arrays[3] = {c->surface_array, c->solid_array, c->empty_array};
        GLuint buffers[2] = {c->surface_buffer, c->solid_buffer};
        glDeleteVertexArrays(3, arrays);
        glDeleteBuffers(2, buffers);
        glDeleteTextures(1, &c->texture);
        glDeleteProgram(c->program);
        glDeleteProgram(c->overlay_program);
        glDeleteProgram(c->background_program);
    }
    free(c->overlay);
    pal_surface_mesh_clear(&c->mesh);
    free(c);
}

static void set_matrix(GLuint program, const char *name, mat4 m) {
    glUniformMatrix4fv(glGetUniformLocation(program, name), 1, GL_FALSE, (const float *)m);
}

/// Draw one solid with a model matrix, in a plain colour.
static void draw_solid(pal_canvas *c, solid kind, mat4 model, const float colour[3]) {
    mat4 eye;
    mat3 turn;
    glm_mat4_mul(c->view, model, eye);
    glm_mat4_pick3(eye, turn);
    glm_mat3_inv(turn, turn);
    glm_mat3_transpose(turn);
    set_matrix(c->program, "model", model);
    glUniformMatrix3fv(glGetUniformLocation(c->program, "turn"), 1, GL_FALSE, (const float *)turn);
    glUniform3fv(glGetUniformLocation(c->program, "flat_colour"), 1, colour);
    glDrawArrays(GL_TRIANGLES, c->first[kind], c->count[kind]);
}

/// The matrix that puts the unit solid's z axis along `axis` (unit) from `at`, scaled (r, r,
/// length).
static void along(const double at[3], const double axis[3], double r, double length, mat4 m) {
    vec3 z = {(float)axis[0], (float)axis[1], (float)axis[2]}, x, y;
    glm_vec3_ortho(z, x);
    glm_vec3_normalize(x);
    glm_vec3_cross(z, x, y);
    glm_mat4_identity(m);
    for (int d = 0; d < 3; d++) {
        m[0][d] = (float)r * x[d];
        m[1][d] = (float)r * y[d];
        m[2][d] = (float)length * z[d];
        m[3][d] = (float)at[d];
    }
}

static void draw_ball(pal_canvas *c, const double at[3], double r, const float colour[3]) {
    const double up[3] = {0.0, 0.0, 1.0};
    mat4 m = GLM_MAT4_IDENTITY_INIT;
    along(at, up, r, r, m);
    draw_solid(c, SOLID_SPHERE, m, colour);
}

/// The handle points along the tool's local +z (its own axis is -z).
static void draw_tool(pal_canvas *c, const pal_tool_def *tool, const pal_pose *pose) {
    static const float metal[3] = {0.62F, 0.65F, 0.70F}, grip[3] = {0.25F, 0.28F, 0.33F};
    const double *q = pose->orientation;
    double axis[3] = {2.0 * (q[1] * q[3] + q[0] * q[2]), 2.0 * (q[2] * q[3] - q[0] * q[1]),
                      1.0 - 2.0 * (q[1] * q[1] + q[2] * q[2])};
    double r = tool->shape == PALPATE_SHAPE_POINT ? 0.008 * c->size : tool->radius;
    double shaft = fmin(0.4 * r, 0.006 * c->size);
    mat4 m = GLM_MAT4_IDENTITY_INIT;
    if (tool->shape == PALPATE_SHAPE_CAPSULE) {
        double a[3], b[3];
        for (int d = 0; d < 3; d++) {
            a[d] = pose->position[d] - 0.5 * tool->length * axis[d];
            b[d] = pose->position[d] + 0.5 * tool->length * axis[d];
        }
        along(a, axis, r, tool->length, m);
        draw_solid(c, SOLID_CYLINDER, m, metal);
        draw_ball(c, a, r, metal);
        draw_ball(c, b, r, metal);
        return;
    }
    if (tool->shape == PALPATE_SHAPE_POINT) { // a needle: its tip is the tool's origin
        double back[3], flip[3];
        for (int d = 0; d < 3; d++) {
            back[d] = pose->position[d] + 3.0 * r * axis[d];
            flip[d] = -axis[d];
        }
        along(back, flip, r, 3.0 * r, m);
        draw_solid(c, SOLID_CONE, m, metal);
        along(back, axis, shaft, 0.45 * c->size, m);
        draw_solid(c, SOLID_CYLINDER, m, grip);
        return;
    }
    draw_ball(c, pose->position, r, metal);
    along(pose->position, axis, shaft, 0.45 * c->size, m);
    draw_solid(c, SOLID_CYLINDER, m, grip);
}

/// The force on the tool, from its contact centroid; length saturates gently with the force.
static int draw_force(pal_canvas *c, const pal_tool_force *f, const pal_pose *pose, double tip[3]) {
    static const float red[3] = {0.85F, 0.16F, 0.12F};
    double size =
        sqrt(f->force[0] * f->force[0] + f->force[1] * f->force[1] + f->force[2] * f->force[2]);
    if (!(size > 1e-6)) {
        return 0;
    }
    const double *from = f->contact_count > 0 ? f->centroid : pose->position;
    double length = c->size * (0.06 + 0.34 * size / (size + 0.5)), r = 0.010 * c->size, u[3],
           neck[3];
    for (int d = 0; d < 3; d++) {
        u[d] = f->force[d] / size;
        neck[d] = from[d] + 0.78 * length * u[d];
        tip[d] = from[d] + length * u[d];
    }
    mat4 m = GLM_MAT4_IDENTITY_INIT;
    along(from, u, r, 0.78 * length, m);
    draw_solid(c, SOLID_CYLINDER, m, red);
    along(neck, u, 2.6 * r, 0.22 * length, m);
    draw_solid(c, SOLID_CONE, m, red);
    return 1;
}

static void set_camera(pal_canvas *c, const pal_camera *camera, int width, int height) {
    vec3 center, eye, up = {0.0F, 0.0F, 1.0F};
    double distance = camera->distance * c->size;
    double ce = cos(camera->elevation);
    double offset[3] = {ce * cos(camera->azimuth), ce * sin(camera->azimuth),
                        sin(camera->elevation)};
    for (int d = 0; d < 3; d++) {
        center[d] = (float)camera->center[d];
        eye[d] = (float)(camera->center[d] + distance * offset[d]);
    }
    glm_lookat(eye, center, up, c->view);
    glm_perspective(0.62F, (float)width / (float)height, (float)(0.02 * distance),
                    (float)(distance + 3.0 * c->size), c->projection);
    c->width = width;
    c->height = height;
}

static void draw_surface(pal_canvas *c, double range) {
    static const float skin[3] = {0.82F, 0.65F, 0.60F};
    mat4 identity;
    mat3 turn;
    glm_mat4_identity(identity);
    glm_mat4_pick3(c->view, turn);
    glBindVertexArray(c->surface_array);
    glBindBuffer(GL_ARRAY_BUFFER, c->surface_buffer);
    glBufferData(
        GL_ARRAY_BUFFER,
        (GLsizeiptr)(3 * (size_t)c->mesh.triangle_count * PALPATE_CORNER_FLOATS * sizeof(float)),
        c->mesh.corner, GL_STREAM_DRAW);
    set_matrix(c->program, "model", identity);
    glUniformMatrix3fv(glGetUniformLocation(c->program, "turn"), 1, GL_FALSE, (const float *)turn);
    glUniform3fv(glGetUniformLocation(c->program, "flat_colour"), 1, skin);
    glUniform1f(glGetUniformLocation(c->program, "range"), (float)range);
    glUniform1i(glGetUniformLocation(c->program, "use_scale"), 1);
    glDrawArrays(GL_TRIANGLES, 0, 3 * c->mesh.triangle_count);
    glUniform1i(glGetUniformLocation(c->program, "use_scale"), 0);
}

static void draw_overlay(pal_canvas *c, const pal_caption *caption, double range,
                         const pal_label *labels, int count) {
    if (c->overlay_width != c->width || c->overlay_height != c->height) {
        free(c->overlay);
        c->overlay = malloc(4 * (size_t)c->width * (size_t)c->height);
        c->overlay_width = c->width;
        c->overlay_height = c->height;
    }
    if (c->overlay == NULL) {
        c->overlay_width = 0;
        return; // a picture without its legend is better than none
    }
    pal_overlay_draw(c->overlay, c->width, c->height, caption, range, labels, count);
    glDisable(GL_DEPTH_TEST);
    glEnable(GL_BLEND);
    glBlendFunc(GL_ONE, GL_ONE_MINUS_SRC_ALPHA);
    glUseProgram(c->overlay_program);
    glActiveTexture(GL_TEXTURE0);
    glBindTexture(GL_TEXTURE_2D, c->texture);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MIN_FILTER, GL_NEAREST);
    glTexParameteri(GL_TEXTURE_2D, GL_TEXTURE_MAG_FILTER, GL_NEAREST);
    glPixelStorei(GL_UNPACK_ALIGNMENT, 4);
    glTexImage2D(GL_TEXTURE_2D, 0, GL_RGBA8, c->width, c->height, 0, GL_BGRA,
                 GL_UNSIGNED_INT_8_8_8_8_REV, c->overlay);
    glBindVertexArray(c->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glDisable(GL_BLEND);
}

/// Pixel of a body point in the last drawing.
static void project(const pal_canvas *c, const double p[3], double *x, double *y) {
    vec4 clip, at = {(float)p[0], (float)p[1], (float)p[2], 1.0F};
    mat4 view = GLM_MAT4_IDENTITY_INIT, projection = GLM_MAT4_IDENTITY_INIT, both;
    memcpy(view, c->view, sizeof view);
    memcpy(projection, c->projection, sizeof projection);
    glm_mat4_mul(projection, view, both);
    glm_mat4_mulv(both, at, clip);
    *x = 0.5 * (1.0 + (double)clip[0] / (double)clip[3]) * c->width;
    *y = 0.5 * (1.0 - (double)clip[1] / (double)clip[3]) * c->height;
}

void pal_canvas_draw(pal_canvas *c, const pal_frame *frame, const pal_runtime_config *tools,
                     const pal_camera *camera, const pal_caption *caption, int width, int height) {
    pal_surface_mesh_update(&c->mesh, frame);
    set_camera(c, camera, width, height);
    double range = caption->range > 0.0 ? caption->range : pal_round_up((double)c->mesh.largest);
    glViewport(0, 0, width, height);
    glDisable(GL_DEPTH_TEST);
    glClear(GL_COLOR_BUFFER_BIT | GL_DEPTH_BUFFER_BIT);
    glUseProgram(c->background_program);
    glBindVertexArray(c->empty_array);
    glDrawArrays(GL_TRIANGLES, 0, 3);
    glEnable(GL_DEPTH_TEST);
    glUseProgram(c->program);
    float scale[COLOURS][3];
    for (int i = 0; i < COLOURS; i++) {
        double rgb[3];
        pal_colour(i / (COLOURS - 1.0), rgb);
        for (int k = 0; k < 3; k++) {
            scale[i][k] = (float)rgb[k];
        }
    }
    glUniform3fv(glGetUniformLocation(c->program, "scale"), COLOURS, &scale[0][0]);
    set_matrix(c->program, "view", c->view);
    set_matrix(c->program, "projection", c->projection);
    draw_surface(c, range);
    pal_label labels[PALPATE_TOOLS_MAX];
    int label_count = 0;
    glBindVertexArray(c->solid_array);
    for (int32_t t = 0; frame != NULL && t < frame->tool_count; t++) {
        double tip[3];
        draw_tool(c, &tools->tools[t], &frame->tool_pose[t]);
        if (draw_force(c, &frame->tool_force[t], &frame->tool_pose[t], tip)) {
            const double *f = frame->tool_force[t].force;
            pal_label *label = &labels[label_count++];
            project(c, tip, &label->x, &label->y);
            (void)snprintf(label->text, sizeof label->text, "%.3g N",
                           sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
        }
    }
    draw_overlay(c, caption, range, labels, label_count);
}

double pal_canvas_largest(const pal_canvas *c) {
    return (double)c->mesh.largest;
}

void pal_canvas_ray(const pal_canvas *c, double x, double y, double origin[3],
                    double direction[3]) {
    mat4 view = GLM_MAT4_IDENTITY_INIT, projection = GLM_MAT4_IDENTITY_INIT, both, inverse;
    memcpy(view, c->view, sizeof view);
    memcpy(projection, c->projection, sizeof projection);
    glm_mat4_mul(projection, view, both);
    glm_mat4_inv(both, inverse);
    vec4 ends[2];
    for (int i = 0; i < 2; i++) {
        vec4 clip = {(float)(2.0 * x / c->width - 1.0), (float)(1.0 - 2.0 * y / c->height),
                     i == 0 ? -1.0F : 1.0F, 1.0F};
        glm_mat4_mulv(inverse, clip, ends[i]);
    }
    double size = 0.0;
    for (int d = 0; d < 3; d++) {
        origin[d] = (double)(ends[0][d] / ends[0][3]);
        direction[d] = (double)(ends[1][d] / ends[1][3]) - origin[d];
        size += direction[d] * direction[d];
    }
    for (int d = 0; d < 3; d++) {
        direction[d] /= sqrt(size);
    }
}
