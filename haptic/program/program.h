/// @file program.h  The `palpate` program: its commands and what they share.
///
/// The program links libpalpate only. The offline library (SuiteSparse, libyaml; GPL parts)
/// is opened by offline_open() when a command is given a scene, so that `run MODEL` loads nothing
/// GPL.
#ifndef PALPATE_PROGRAM_H
#define PALPATE_PROGRAM_H

#include <argp.h>
#include <signal.h>

#include <jansson.h>

#include <palpate/model.h>
#include <palpate/precompute.h>
#include <palpate/scene.h>

/// ---- Commands: each returns the process's exit status -----------------------------------------
int command_precompute(int argc, char **argv);
int command_info(int argc, char **argv);
int command_press(int argc, char **argv);
int command_indent(int argc, char **argv);
int command_schema(int argc, char **argv);
int command_run(int argc, char **argv);
int command_view(int argc, char **argv);
int command_doctor(int argc, char **argv);
int command_recover(int argc, char **argv);
int command_replay(int argc, char **argv);
int command_plot(int argc, char **argv);

/// ---- Options every command takes (options.c) ---------------------------------------------------
enum { OVERRIDES_MAX = 256 };
typedef struct common_options {
    const char *command; ///< "palpate press"
    int json;
    int quiet;
    int override_count;
    const char *overrides[OVERRIDES_MAX];
} common_options;

/// argp child: --json, --set, --quiet; its input is a common_options.
extern const struct argp common_argp;

/// Parse "X,Y,Z" into v. @return 0 when it is not three finite numbers
int parse_vector(const char *text, double v[3]);

/// Parse "WIDTHxHEIGHT". @return 0 when it is not two numbers of 64 to 4096
int parse_size(const char *text, int *width, int *height);

/// The one argument of commands on a recording; for the default of their parsers. @return as argp's
/// parsers
error_t parse_recording(int key, char *arg, struct argp_state *state, const char **path);

/// ---- Scene or model (source.c) -----------------------------------------------------------------
/// What a command works on: a model, and the scene it came from when one was given.
typedef struct source {
    pal_model *model;
    pal_scene *scene; ///< NULL for a model file
    int was_cached;
    int passed; ///< 0: the certificate does not pass (the model is there to be looked at)
    char certificate_message[1024];
} source;

/// Open SCENE (through the cache, with progress) or MODEL.
/// @param allow_failing  1: a model that fails its certificate is returned with passed = 0
pal_status source_open(const char *path, const common_options *options, int allow_failing,
                       source *out, pal_error *error);
void source_close(source *s);
/// The scene's warnings on stderr, once.
void source_print_warnings(const source *s, const common_options *options);
json_t *source_warnings_json(const source *s);

/// ---- The offline library, opened on demand (offline.c)
/// -------------------------------------------
typedef struct offline_api {
    __typeof__(&pal_scene_load) scene_load;
    __typeof__(&pal_scene_free) scene_free;
    __typeof__(&pal_scene_runtime) scene_runtime;
    __typeof__(&pal_scene_warning_count) scene_warning_count;
    __typeof__(&pal_scene_warning) scene_warning;
    __typeof__(&pal_scene_schema) scene_schema;
    __typeof__(&pal_scene_scale_spacing) scene_scale_spacing;
    __typeof__(&pal_precompute) precompute;
    __typeof__(&pal_precompute_cached) precompute_cached;
    __typeof__(&pal_cache_path) cache_path;
    __typeof__(&pal_cache_find) cache_find;
} offline_api;
/// @return the table, or NULL with a message (library missing)
const offline_api *offline_open(pal_error *error);

/// ---- Progress and interruption (progress.c)
/// ------------------------------------------------------ Install SIGINT/SIGTERM handlers that only
/// set a flag.
void interrupt_install(void);
/// The signal that arrived, or 0.
int interrupt_signal(void);
/// SIGUSR1 asks for a dump; without this it ends the process.
void dump_install(void);
/// 1 once for each burst of SIGUSR1 that arrived.
int dump_signal(void);
/// A progress callback that draws a line with time left on a terminal's stderr.
pal_progress progress_line(const common_options *options);
void progress_end(void);

/// ---- Output (output.c)
/// ---------------------------------------------------------------------------- Print the one JSON
/// object and free it.
void print_json(json_t *object);
/// The exit status after all was printed: `status`, but never 0 when a result did not get out (a
/// full disk, a value that JSON cannot hold).
int print_finish(int status);
/// Report an error on stderr (and as {"error": ...} on stdout with --json). @return exit status
int report_error(const common_options *options, pal_status status, const pal_error *error);
json_t *json_vector3(const double v[3]);
json_t *json_info(const pal_model *model);
json_t *json_certificate(const pal_certificate *c);
void print_info(const pal_model *model);
void print_certificate(const pal_certificate *c);

#endif
