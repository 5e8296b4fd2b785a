/// @file output.c  What commands print: JSON (jansson) or text for people.
#include "haptic/program/program.h"

#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

static int print_failed = 0; // a result did not get out

void print_json(json_t *object) {
    if (json_dumpf(object, stdout, JSON_INDENT(1) | JSON_REAL_PRECISION(12)) != 0) {
        (void)fprintf(stderr, "palpate: the result cannot be written as JSON\n");
        print_failed = 1;
    }
    (void)putchar('\n');
    (void)fflush(stdout);
    json_decref(object);
}

int print_finish(int status) {
    static int said = 0;
    if (!said && (fflush(stdout) != 0 || ferror(stdout))) {
        (void)fprintf(stderr, "palpate: standard output cannot be written: %s\n", strerror(errno));
        print_failed = said = 1;
    }
    return status == 0 && print_failed ? 1 : status;
}

json_t *json_text(const char *text) {
    json_t *whole = json_string(text);
    if (whole != NULL) {
        return whole;
    }
    size_t length = strlen(text), n = 0;
    char *clean = malloc(3 * length + 1); // U+FFFD is three bytes
    if (clean == NULL) {
        return json_null();
    }
    for (size_t i = 0; i < length;) {
        size_t take = 0;
        for (size_t k = 1; k <= 4 && take == 0 && i + k <= length; k++) {
            json_t *piece = json_stringn(text + i, k);
            take = piece != NULL ? k : 0;
            json_decref(piece);
        }
        memcpy(clean + n, take > 0 ? text + i : "\357\277\275", take > 0 ? take : 3);
        n += take > 0 ? take : 3;
        i += take > 0 ? take : 1;
    }
    whole = json_stringn(clean, n);
    free(clean);
    return whole;
}

static const char *error_text(pal_status status, const pal_error *error) {
    return error != NULL && error->message[0] != '\0' ? error->message : pal_status_text(status);
}

json_t *json_error(pal_status status, const pal_error *error) {
    return json_pack("{s:s,s:o}", "status", pal_status_name(status), "message",
                     json_text(error_text(status, error)));
}

int report_error(const common_options *options, pal_status status, const pal_error *error) {
    progress_end();
    (void)fprintf(stderr, "%s: %s\n", options->command, error_text(status, error));
    if (options->json) {
        print_json(json_pack("{s:o}", "error", json_error(status, error)));
    }
    if (status == PALPATE_ERROR_CANCELLED && interrupt_signal() != 0) {
        return 128 + interrupt_signal();
    }
    return 1;
}

int large_move(const pal_model *model, const char *option, double move, char *text, size_t size) {
    pal_model_info info;
    pal_model_get_info(model, &info);
    double body = 0.0;
    for (int d = 0; d < 3; d++) {
        body = fmax(body, info.bounds_max[d] - info.bounds_min[d]);
    }
    (void)snprintf(text, size,
                   "%s is %.3g m, %.3g %% of the body's %.3g m: the answer is linear, far beyond "
                   "small strain (lengths are in metres)",
                   option, move, 100.0 * move / body, body);
    return move > 0.2 * body;
}

/// JSON has no NaN or infinity: null.
static json_t *number(double v) {
    return isfinite(v) ? json_real(v) : json_null();
}

json_t *json_vector3(const double v[3]) {
    return json_pack("[o,o,o]", number(v[0]), number(v[1]), number(v[2]));
}

json_t *json_certificate(const pal_certificate *c) {
    json_t *o = json_object();
    json_object_set_new(o, "pass", json_boolean(c->pass));
    json_object_set_new(o, "passive", json_boolean(c->passive));
    json_object_set_new(o, "symmetrized", json_boolean(c->symmetrized));
    json_object_set_new(o, "reciprocity", number(c->reciprocity));
    json_object_set_new(o, "force_change", number(c->force_change));
    json_object_set_new(o, "min_eigenvalue_ratio", number(c->min_eigenvalue_ratio));
    json_object_set_new(o, "min_eigenvalue", number(c->min_eigenvalue));
    json_object_set_new(o, "max_eigenvalue", number(c->max_eigenvalue));
    json_object_set_new(o, "solve_residual", number(c->solve_residual));
    json_object_set_new(o, "rcond", number(c->rcond));
    json_object_set_new(o, "force_balance",
                        c->force_balance < 0 ? json_null() : number(c->force_balance));
    json_object_set_new(o, "stencil_condition", number(c->mls_worst_condition));
    json_object_set_new(o, "stencil_worst_point", json_vector3(c->mls_worst_point));
    json_object_set_new(o, "stencils_grown", json_integer(c->mls_grown));
    json_object_set_new(o, "estimated_error",
                        c->estimated_error < 0 ? json_null() : number(c->estimated_error));
    json_object_set_new(o, "loop_energy",
                        c->loop_energy < 0 ? json_null() : number(c->loop_energy));
    json_object_set_new(o, "loop_energy_raw",
                        c->loop_energy_raw < 0 ? json_null() : number(c->loop_energy_raw));
    json_object_set_new(o, "reason", json_string(c->reason));
    return o;
}

json_t *json_info(const pal_model *model) {
    static const char *const precision[] = {"double", "single", "half", "scaled"};
    pal_model_info i;
    pal_model_get_info(model, &i);
    json_t *o = json_object();
    json_object_set_new(o, "nodes", json_integer(i.node_count));
    json_object_set_new(o, "surface", json_integer(i.surface_count));
    json_object_set_new(o, "interior", json_integer(i.node_count - i.surface_count));
    json_object_set_new(o, "touchable", json_integer(i.touchable_count));
    json_object_set_new(o, "columns", json_integer(i.column_count));
    json_object_set_new(o, "stored", json_integer(i.row_count));
    json_object_set_new(o, "fixed", json_integer(i.fixed_count));
    json_object_set_new(o, "method", json_text(i.method));
    json_object_set_new(o, "method_options", json_text(i.method_options));
    json_object_set_new(o, "precision", json_string(precision[i.precision]));
    json_object_set_new(o, "bytes", json_integer((json_int_t)i.bytes));
    json_object_set_new(o, "rows",
                        json_pack("{s:s,s:I,s:i,s:i,s:o,s:o,s:o}", "form",
                                  i.row_clusters > 0 ? "bases" : precision[i.precision], "bytes",
                                  (json_int_t)i.row_bytes, "clusters", (int)i.row_clusters, "rank",
                                  (int)i.row_rank, "tolerance", number(i.field_tolerance), "error",
                                  i.field_us > 0 ? number(i.field_error) : json_null(), "field_us",
                                  i.field_us > 0 ? number(i.field_us) : json_null()));
    json_object_set_new(o, "peak_bytes", json_integer((json_int_t)i.peak_bytes));
    json_object_set_new(o, "seconds",
                        json_pack("{s:f,s:f,s:f,s:f,s:f,s:f}", "cloud", i.seconds.cloud, "assemble",
                                  i.seconds.assemble, "factor", i.seconds.factor, "solve",
                                  i.seconds.solve, "certify", i.seconds.certify, "total",
                                  i.seconds.total));
    json_object_set_new(o, "spacing",
                        json_pack("{s:f,s:f,s:f}", "min", i.spacing_min, "mean", i.spacing_mean,
                                  "max", i.spacing_max));
    json_object_set_new(
        o, "material",
        json_pack("{s:f,s:f,s:f}", "young", i.young, "poisson", i.poisson, "density", i.density));
    json_object_set_new(o, "volume", number(i.volume));
    json_object_set_new(o, "bounds",
                        json_pack("[o,o]", json_vector3(i.bounds_min), json_vector3(i.bounds_max)));
    json_t *patches = json_object(), *probes = json_object(), *tools = json_array();
    for (int32_t p = 0; p < i.patch_count; p++) {
        int32_t count = 0;
        const char *name = pal_model_patch(model, p, NULL, &count);
        json_object_set_new(patches, name, json_integer(count));
    }
    for (int32_t p = 0; p < i.probe_count; p++) {
        double x[3];
        const char *name = pal_model_probe(model, p, x);
        json_object_set_new(probes, name, json_vector3(x));
    }
    const pal_runtime_config *runtime = pal_model_runtime(model);
    for (int32_t t = 0; t < runtime->tool_count; t++) {
        json_array_append_new(tools, json_string(runtime->tools[t].name));
    }
    json_object_set_new(o, "patches", patches);
    json_object_set_new(o, "probes", probes);
    json_object_set_new(o, "tools", tools);
    json_object_set_new(o, "skin_vertices", json_integer(i.skin_count));
    json_object_set_new(o, "hash", json_text(i.hash));
    json_object_set_new(o, "provenance", json_text(i.provenance));
    json_object_set_new(o, "certificate", json_certificate(&i.certificate));
    return o;
}

void print_certificate(const pal_certificate *c) {
    (void)printf("certificate    %s\n", c->pass ? "passes" : "DOES NOT PASS");
    if (!c->pass) {
        (void)printf("  reason       %s\n", c->reason);
    }
    (void)printf("  passive      %s\n",
                 c->passive ? "yes (symmetric and positive definite)" : "no");
    (void)printf("  reciprocity  %.2e before %s\n", c->reciprocity,
                 c->symmetrized ? "symmetrizing" : "any repair (stored as it is)");
    if (c->force_change >= 0) {
        (void)printf(
            "  force change %.2e at worst by symmetrizing, over the patches and sampled contacts\n",
            c->force_change);
    }
    (void)printf("  eigenvalues  %.3e ... %.3e m/N (ratio %.2e)\n", c->min_eigenvalue,
                 c->max_eigenvalue, c->min_eigenvalue_ratio);
    (void)printf("  residual     %.1e worst of the sampled columns, rcond %.1e\n",
                 c->solve_residual, c->rcond);
    if (c->force_balance >= 0) {
        (void)printf("  balance      %.1e: support reaction against applied force\n",
                     c->force_balance);
    }
    (void)printf("  stencils     worst condition %.1e at (%.4g, %.4g, %.4g) m, %d grown\n",
                 c->mls_worst_condition, c->mls_worst_point[0], c->mls_worst_point[1],
                 c->mls_worst_point[2], c->mls_grown);
    if (c->estimated_error >= 0) {
        (void)printf("  error        %.1f %% of the force, estimated discretization error\n",
                     100.0 * c->estimated_error);
    }
    if (c->loop_energy >= 0) {
        (void)printf("  loops        %.1e of the stored energy returned per closed tool loop (raw "
                     "block %.1e)\n",
                     c->loop_energy, c->loop_energy_raw);
    }
}

void print_info(const pal_model *model) {
    static const char *const precision[] = {"double", "single", "half", "scaled"};
    pal_model_info i;
    pal_model_get_info(model, &i);
    (void)printf("nodes          %d (%d surface, %d interior), %d fixed, %d touchable, %d stored\n",
                 i.node_count, i.surface_count, i.node_count - i.surface_count, i.fixed_count,
                 i.touchable_count, i.row_count);
    (void)printf("spacing        %.3g / %.3g / %.3g mm (min / mean / max)\n", 1e3 * i.spacing_min,
                 1e3 * i.spacing_mean, 1e3 * i.spacing_max);
    (void)printf("body           %.4g cm^3, E %.4g Pa, nu %.4g\n", 1e6 * i.volume, i.young,
                 i.poisson);
    (void)printf("method         %s (%s)\n", i.method, i.method_options);
    (void)printf("compliance     %.1f MB; peak memory %.0f MB\n", 1e-6 * (double)i.bytes,
                 1e-6 * (double)i.peak_bytes);
    if (i.row_clusters > 0) {
        (void)printf("rows           %.1f MB: %d clusters with bases of rank %d together, 16-bit\n",
                     1e-6 * (double)i.row_bytes, i.row_clusters, i.row_rank);
    } else {
        (void)printf("rows           %.1f MB, every row in %s precision\n",
                     1e-6 * (double)i.row_bytes, precision[i.precision]);
    }
    if (i.field_us > 0) {
        (void)printf(
            "field          %.1e of the largest displacement off at worst over sampled contacts%s, "
            "about %.0f us for 45 touched nodes\n",
            i.field_error, i.field_tolerance > 0 ? " (chosen by store.tolerance)" : "", i.field_us);
    }
    (void)printf("seconds        cloud %.2f, assemble %.2f, factor %.2f, solve %.2f, certify %.2f, "
                 "total %.2f\n",
                 i.seconds.cloud, i.seconds.assemble, i.seconds.factor, i.seconds.solve,
                 i.seconds.certify, i.seconds.total);
    for (int32_t p = 0; p < i.patch_count; p++) {
        int32_t count = 0;
        const char *name = pal_model_patch(model, p, NULL, &count);
        (void)printf("patch          %s: %d nodes\n", name, count);
    }
    for (int32_t p = 0; p < i.probe_count; p++) {
        double x[3];
        const char *name = pal_model_probe(model, p, x);
        (void)printf("probe          %s at (%g, %g, %g)\n", name, x[0], x[1], x[2]);
    }
    const pal_runtime_config *runtime = pal_model_runtime(model);
    for (int32_t t = 0; t < runtime->tool_count; t++) {
        (void)printf("tool           %s\n", runtime->tools[t].name);
    }
    print_certificate(&i.certificate);
    (void)printf("hash           %s\n", i.hash);
    (void)printf("made by        %s\n", i.provenance);
}
