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
    const char *no_set; ///< why --set is refused; NULL: it is taken
    int override_count;
    const char *overrides[OVERRIDES_MAX];
} common_options;

/// argp child: --json, --set, --quiet; its input is a common_options. plain_argp for the commands
/// that build no scene: they refuse --set with `no_set`.
extern const struct argp common_argp, plain_argp;

/// Parse "N,N,..." into v. @return how many; 0 when one is no finite number or there are more
/// than max
int parse_numbers(const char *text, double *v, int max);

/// Parse "X,Y,Z" into v. @return 0 when it is not three finite numbers
int parse_vector(const char *text, double v[3]);

/// Seconds of `option`: more than 0 and up to 1e7, or any with signed_too; else argp_error.
double parse_time(const char *text, const char *option, int signed_too, struct argp_state *state);

/// Parse a whole number from low to high. @return 0 when it is none
int parse_integer(const char *text, int low, int high, int *v);

/// "WIDTHxHEIGHT" of --size, each 64 to 4096; else argp_error.
void parse_size(const char *text, int *width, int *height, struct argp_state *state);

/// The one argument of a command, a path; for the default of its parser. @return as argp's parsers
/// @param what  "SCENE or MODEL"  @param hint  one sentence for who gave none
error_t parse_path(int key, char *arg, struct argp_state *state, const char **path,
                   const char *what, const char *hint);

/// The one argument of commands on a recording.
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
/// A command that builds: `path` must not be a model. @return PALPATE_OK; _ARGUMENT, _IO
pal_status source_must_be_scene(const char *path, pal_error *error);
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
/// From here on a signal ends the process at once, one that arrived before too: for the part of a
/// command that has nothing to clean up.
void interrupt_restore(void);
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
/// A text that somebody else wrote as JSON: bytes that are not UTF-8 become U+FFFD.
json_t *json_text(const char *text);
/// {"status": ..., "message": ...} of an error.
json_t *json_error(pal_status status, const pal_error *error);
/// Small strain ends somewhere: what a linear answer beyond it is worth must be said.
/// @param option  "--by"  @param move  [m]  @return 1 with the warning in text, else 0
int large_move(const pal_model *model, const char *option, double move, char *text, size_t size);
json_t *json_vector3(const double v[3]);
json_t *json_info(const pal_model *model);
json_t *json_certificate(const pal_certificate *c);
void print_info(const pal_model *model);
void print_certificate(const pal_certificate *c);

#endif
