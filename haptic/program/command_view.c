/// @file command_view.c  palpate view SCENE|MODEL: the running model in a window.
#include "haptic/program/program.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <time.h>

#include <palpate/session.h>

#include "haptic/base/error.h"
#include "haptic/program/mouse_tool.h"
#include "haptic/program/targets.h"
#include "haptic/view/window.h"

enum { HISTORY = 240, KEY_FOR = 0x300, KEY_SNAPSHOT, KEY_MOUSE, KEY_SIZE };

typedef struct options {
    common_options common;
    const char *path, *snapshot;
    double seconds;
    int mouse, width, height;
} options;

static const char help_text[] = "left button     press where the pointer is (mouse tool)\n"
                                "wheel           pressing: deeper or less; else zoom\n"
                                "right button    orbit (or shift + left); middle: move\n"
                                "m               mouse tool or the scene's own device\n"
                                "space           pause;  r  reset;  s  save a picture\n"
                                "u               let a latched watchdog go\n"
                                "h               this help;  q or Esc  quit";

static error_t parse(int key, char *arg, struct argp_state *state) {
    options *o = state->input;
    switch (key) {
    case ARGP_KEY_INIT:
        state->child_inputs[0] = &o->common;
        return 0;
    case KEY_FOR:
        o->seconds = parse_time(arg, "--for", 0, state);
        return 0;
    case KEY_SNAPSHOT:
        o->snapshot = arg;
        return 0;
    case KEY_MOUSE:
        o->mouse = 1;
        return 0;
    case KEY_SIZE:
        parse_size(arg, &o->width, &o->height, state);
        return 0;
    default:
        return parse_path(key, arg, state, &o->path, "SCENE or MODEL",
                          "e.g. palpate view scenes/organ.yaml");
    }
}

static const struct argp_option list[] = {
    {"for", KEY_FOR, "SECONDS", 0, "Close by itself after this time", 1},
    {"snapshot", KEY_SNAPSHOT, "FILE.png", 0,
     "Where the key s and the end of --for save the picture "
     "(default palpate.png)",
     1},
    {"mouse", KEY_MOUSE, NULL, 0, "Start with the mouse as tool", 1},
    {"size", KEY_SIZE, "WxH", 0, "Size of the window (default 960x640)", 1},
    {0}};
static const char doc[] =
    "Show the running model in a window: deformed surface, tools, forces, plots of the last "
    "seconds.\v"
    "The servo runs at its rate beside the window. Without hardware the mouse is a tool: press "
    "with the left "
    "button. h shows the keys.\n\nExample:\n  palpate view scenes/organ.yaml --mouse";

typedef struct viewer {
    const options *o;
    const pal_model *model;
    const pal_runtime_config *runtime;
    pal_session *session;
    pal_window *window;
    pal_canvas *canvas;
    mouse_tool *tool;
    pal_camera camera;
    pal_reader *reader;
    pal_frame frame;
    int have_frame, mouse, paused, help;
    double press_depth, hover[3], normal[3];
    int hovering;
    double force[HISTORY], depth[HISTORY], time[HISTORY], range;
    int history;
    uint64_t frames;
} viewer;

static void push_history(viewer *v) {
    double force = 0.0, depth = 0.0;
    for (int32_t t = 0; t < v->frame.tool_count; t++) {
        const double *f = v->frame.tool_force[t].force;
        force = fmax(force, sqrt(f[0] * f[0] + f[1] * f[1] + f[2] * f[2]));
        depth = fmax(depth, v->frame.tool_force[t].depth);
    }
    if (v->history == HISTORY) {
        memmove(v->force, v->force + 1, (HISTORY - 1) * sizeof v->force[0]);
        memmove(v->depth, v->depth + 1, (HISTORY - 1) * sizeof v->depth[0]);
        memmove(v->time, v->time + 1, (HISTORY - 1) * sizeof v->time[0]);
        v->history--;
    }
    v->force[v->history] = force;
    v->time[v->history] = 1e-9 * (double)v->frame.time_ns;
    v->depth[v->history++] = depth;
}

/// Move the mouse's tool: hover over the surface under the pointer, press while the button is down.
static void move_tool(viewer *v, const pal_window_input *in, double seconds) {
    const pal_tool_def *tool = &v->runtime->tools[0];
    pal_model_info info;
    pal_model_get_info(v->model, &info);
    double size = pow(info.volume, 1.0 / 3.0);
    if (!in->pressing) { // while pressing, the place is kept: the organ does not slip away under
                         // the pointer
        double origin[3], direction[3];
        pal_canvas_ray(v->canvas, in->cursor[0], in->cursor[1], origin, direction);
        v->hovering = mouse_tool_pick(v->model, origin, direction, v->hover, v->normal);
        v->press_depth = fmax(-0.05 * size, v->press_depth - 0.6 * size * seconds);
    } else if (v->hovering) {
        v->press_depth = fmin(0.12 * size, fmax(v->press_depth, -0.02 * size) +
                                               0.06 * size * seconds + 0.01 * size * in->push);
    }
    if (v->hovering) {
        pal_pose pose = mouse_tool_pose(tool, v->hover, v->normal, v->press_depth);
        mouse_tool_set(v->tool, &pose);
    }
}

static void take_input(viewer *v, const pal_window_input *in, double seconds) {
    v->camera.azimuth += in->orbit[0];
    v->camera.elevation = fmin(1.5, fmax(-1.5, v->camera.elevation + in->orbit[1]));
    v->camera.distance = fmin(8.0, fmax(0.3, v->camera.distance * in->zoom));
    pal_model_info info;
    pal_model_get_info(v->model, &info);
    double step = v->camera.distance * pow(info.volume, 1.0 / 3.0);
    v->camera.center[0] += step * in->pan[0] * sin(v->camera.azimuth);
    v->camera.center[1] -= step * in->pan[0] * cos(v->camera.azimuth);
    v->camera.center[2] += step * in->pan[1];
    v->help ^= in->help;
    if (in->pause) {
        v->paused = !v->paused;
        mouse_tool_pause(v->tool, v->paused);
    }
    if (in->reset) {
        mouse_tool_restart(v->tool);
        v->history = 0;
        v->range = 0.0;
        v->camera = pal_camera_default(v->model);
    }
    if (in->unlatch) {
        pal_session_unlatch(v->session);
    }
    if (in->toggle_mouse) {
        v->mouse = !v->mouse;
        mouse_tool_select(v->tool, v->mouse);
    }
    if (v->mouse && !v->paused) {
        move_tool(v, in, seconds);
    }
}

static void draw(viewer *v, int width, int height) {
    char title[512];
    pal_session_report r;
    pal_session_get_report(v->session, &r);
    const char *base = strrchr(v->o->path, '/');
    (void)snprintf(title, sizeof title,
                   "%s\n%llu ticks, %llu missed\ntick %.0f us (p99 %.0f us)\n%s; h: help%s",
                   base != NULL ? base + 1 : v->o->path, (unsigned long long)r.ticks,
                   (unsigned long long)r.missed, r.compute_us.p50, r.compute_us.p99,
                   v->mouse ? "mouse tool" : "the scene's device",
                   r.latched != 0 ? "\nLATCHED after a fault: u lets the force come back" : "");
    pal_caption caption = {.title = title,
                           .range = v->range,
                           .depth_history = v->depth,
                           .force_history = v->force,
                           .history_count = v->history,
                           .history_seconds =
                               v->history > 0 ? v->time[v->history - 1] - v->time[0] : 0.0,
                           .help = v->help ? help_text : NULL,
                           .paused = v->paused};
    pal_canvas_draw(v->canvas, v->have_frame ? &v->frame : NULL, v->runtime, &v->camera, &caption,
                    width, height);
    if (pal_canvas_largest(v->canvas) > v->range) {
        v->range = pal_round_up(pal_canvas_largest(v->canvas));
    }
}

static pal_status save(viewer *v, int width, int height, pal_error *error) {
    uint8_t *rgba = malloc(4 * (size_t)width * (size_t)height);
    if (rgba == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    pal_window_read(v->window, width, height, rgba);
    pal_status status = pal_picture_write_png(
        v->o->snapshot != NULL ? v->o->snapshot : "palpate.png", width, height, rgba, error);
    free(rgba);
    return status;
}

static double now_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

/// Draw at the render rate until the window is closed.
static pal_status loop(viewer *v, pal_error *error) {
    double period = 1.0 / v->runtime->render_rate, begin = now_seconds(), last = begin;
    pal_status status = PALPATE_OK;
    for (int end = 0; !end && status == PALPATE_OK;) {
        pal_window_input in;
        int width = 0, height = 0;
        pal_window_poll(v->window, &in, &width, &height);
        double now = now_seconds();
        take_input(v, &in, now - last);
        last = now;
        if (pal_engine_snapshot(v->reader, &v->frame) == 1) {
            v->have_frame = 1;
            v->frames++;
            if (!v->paused) {
                push_history(v);
            }
        }
        end = in.close || interrupt_signal() != 0 ||
              (v->o->seconds > 0.0 && now - begin >= v->o->seconds);
        if (width > 0 && height > 0) {
            draw(v, width, height);
            if (end && v->o->seconds > 0.0 && v->o->snapshot != NULL) {
                status = save(v, width, height, error);
            } else if (in.snapshot && save(v, width, height, error) != PALPATE_OK) {
                // by hand: said at once, and the session goes on
                (void)fprintf(stderr, "%s: %s\n", v->o->common.command, error->message);
                error->message[0] = '\0';
            }
            pal_window_show(v->window);
        }
        double left = period - (now_seconds() - now);
        if (left > 0.0 && !end) {
            struct timespec pause = {0, (long)(1e9 * fmin(left, 0.5))};
            (void)nanosleep(&pause, NULL);
        }
    }
    return status;
}

/// One device per tool; the first is the mouse's too. A tool without a device is the mouse's alone.
static pal_status create_devices(viewer *v, pal_session_def *def, pal_error *error) {
    pal_status status = PALPATE_OK;
    int32_t made = 0;
    for (; made < v->runtime->tool_count; made++) {
        pal_tool_def tool = v->runtime->tools[made];
        if (tool.device.kind == PALPATE_DEVICE_NONE) {
            tool.device.kind = PALPATE_DEVICE_NULL;
            v->mouse = made == 0 ? 1 : v->mouse;
        }
        pal_device device;
        status = pal_device_create(&tool, def->engine.period, &device, error);
        if (status != PALPATE_OK) {
            break;
        }
        if (made == 0) {
            v->tool = mouse_tool_create(&device, &tool, &def->devices[0]);
            if (v->tool == NULL) {
                device.close(device.self);
                status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
                break;
            }
            mouse_tool_select(v->tool, v->mouse);
        } else {
            def->devices[made] = device;
        }
    }
    for (int32_t k = 0; status != PALPATE_OK && k < made; k++) {
        def->devices[k].close(def->devices[k].self);
    }
    return status;
}

static pal_status start_session(viewer *v, pal_error *error) {
    if (v->runtime->tool_count == 0) {
        return pal_fail(error, PALPATE_ERROR_SCENE,
                        "%s: no tools: `view` needs at least one in `tools`", v->o->path);
    }
    pal_session_def def = pal_session_default_def();
    def.engine.tools = v->runtime->tools;
    def.engine.tool_count = v->runtime->tool_count;
    def.engine.max_contacts = v->runtime->max_contacts;
    def.engine.field_by = v->runtime->field_by;
    def.engine.watchdog = v->runtime->watchdog;
    def.engine.contact_law = v->runtime->contact_law;
    def.engine.contact_points = v->runtime->contact_points;
    def.engine.period = 1.0 / v->runtime->servo_rate;
    def.render_rate = 0.0; // this thread draws
    pal_status status = create_devices(v, &def, error);
    if (status != PALPATE_OK) {
        return status;
    }
    status = pal_session_create(v->model, &def, &v->session, error);
    if (status != PALPATE_OK) {
        for (int32_t t = 0; t < v->runtime->tool_count; t++) {
            def.devices[t].close(def.devices[t].self);
        }
        return status;
    }
    v->reader = pal_engine_reader(pal_session_engine(v->session), 0);
    return pal_session_start(v->session, error);
}

int command_view(int argc, char **argv) {
    options o = {.common = {.command = "palpate view"}, .width = 960, .height = 640};
    const struct argp_child children[] = {{&common_argp, 0, NULL, 0}, {0}};
    const struct argp argp = {list, parse, "SCENE|MODEL", doc, children, NULL, NULL};
    (void)argp_parse(&argp, argc, argv, 0, NULL, &o);
    pal_error error = {0};
    source s;
    interrupt_install();
    pal_status status = target_check("--snapshot", o.snapshot, ".png", o.path, &error);
    if (status == PALPATE_OK) {
        status = source_open(o.path, &o.common, 0, &s, &error);
    }
    if (status != PALPATE_OK) {
        return report_error(&o.common, status, &error);
    }
    source_print_warnings(&s, &o.common);
    viewer v = {.o = &o, .model = s.model, .runtime = pal_model_runtime(s.model), .mouse = o.mouse};
    v.camera = pal_camera_default(s.model);
    status = pal_window_create(o.width, o.height, "Palpate", &v.window, &error);
    if (status == PALPATE_OK) {
        status = pal_canvas_create(s.model, &v.canvas, &error);
    }
    if (status == PALPATE_OK) {
        status = start_session(&v, &error);
    }
    if (status == PALPATE_OK) {
        status = loop(&v, &error);
        pal_session_request_stop(v.session);
        pal_status finished = pal_session_finish(v.session, status == PALPATE_OK ? &error : NULL);
        status = status == PALPATE_OK ? finished : status;
    }
    pal_session_report r = {0};
    if (v.session != NULL) {
        pal_session_get_report(v.session, &r);
    }
    pal_session_free(v.session);
    mouse_tool_free(v.tool);
    pal_canvas_free(v.canvas);
    pal_window_free(v.window);
    source_close(&s);
    if (status != PALPATE_OK) {
        return report_error(&o.common, status, &error);
    }
    if (o.common.json) {
        print_json(json_pack("{s:I,s:I,s:I,s:f}", "ticks", (json_int_t)r.ticks, "missed",
                             (json_int_t)r.missed, "frames", (json_int_t)v.frames, "peak_force",
                             r.peak_force));
    } else {
        (void)printf(
            "%llu ticks, %llu missed; %llu pictures drawn; peak force %.4f N on the tool\n",
            (unsigned long long)r.ticks, (unsigned long long)r.missed, (unsigned long long)v.frames,
            r.peak_force);
    }
    return interrupt_signal() != 0 ? 128 + interrupt_signal() : 0;
}
