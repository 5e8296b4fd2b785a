/// @file precompute.c  The offline stage in one direction: scene -> cloud -> discretization ->
/// factor -> compliance -> certificate -> model (design section 3).
#include <palpate/precompute.h>

#include <cblas.h>
#include <math.h>
#include <pthread.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/utsname.h>

#include "haptic/base/error.h"
#include "src/base/seconds.h"
#include "src/certificate/certificate.h"
#include "src/cloud/cloud.h"
#include "src/solution/compliance.h"
#include "src/store/compress.h"
#include "src/certificate/error_estimate.h"
#include "src/solution/factor.h"
#include "src/solution/memory_plan.h"
#include "src/store/model_cache.h"
#include "src/store/model_fill.h"
#include "src/precompute.h"
#include "src/scene/scene.h"
#include "src/cloud/scene_check.h"
#include "src/cloud/skin.h"

static int cancelled(const pal_progress *progress, const char *stage) {
    return progress != NULL && progress->call != NULL &&
           progress->call(progress->user, stage, -1.0, -1.0) != 0;
}

static void describe_build(pal_model_info *info, const pal_factor_report *factor,
                           const pal_compliance_report *compliance) {
    struct utsname host;
    struct rusage usage;
    char machine[160] = "unknown host";
    if (uname(&host) == 0) {
        (void)snprintf(machine, sizeof machine, "%.40s %.60s %.20s", host.sysname, host.release,
                       host.machine);
    }
    (void)snprintf(
        info->provenance, sizeof info->provenance,
        "palpate %s; %s; factor %.3g M entries, %.3g Gflop; refinement steps %d; compiler %s; %s",
        pal_version(), factor->kind, 1e-6 * (double)factor->nonzeros, 1e-9 * factor->flops,
        compliance->refined, __VERSION__, machine);
    if (getrusage(RUSAGE_SELF, &usage) == 0) {
        info->peak_bytes = 1024u * (uint64_t)usage.ru_maxrss;
    }
}

static uint64_t block_bytes(const pal_model *model) {
    uint64_t t = 3 * (uint64_t)model->info.column_count;
    return 8 * t * t + pal_model_row_bytes(model) + 8 * t * 3 * (uint64_t)model->info.probe_count;
}

pal_status pal_build_on_cloud(pal_scene *scene, const pal_cloud *cloud, const pal_skin_source *skin,
                              const pal_node_sets *sets, const pal_progress *progress,
                              pal_model *model, pal_error *error) {
    pal_system system = {0};
    pal_factor *factor = NULL;
    pal_factor_report factor_report = {0};
    pal_compliance_report solve_report = {0};
    pal_offline_seconds *seconds = &model->info.seconds;
    uint8_t *fixed = malloc((size_t)cloud->node_count + 1);
    pal_probe_weights *probes = calloc((size_t)scene->probe_count + 1, sizeof *probes);
    pal_status status = PALPATE_OK;
    if (fixed == NULL || probes == NULL) {
        status = pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    } else {
        for (int32_t i = 0; i < cloud->node_count; i++) {
            fixed[i] = (sets->flags[i] & PALPATE_NODE_FIXED) != 0;
        }
        status = pal_model_fill(scene, cloud, sets, model, probes, error);
    }
    if (status == PALPATE_OK) {
        status = pal_skin_fill(scene, skin, cloud, model, error);
    }
    if (status == PALPATE_OK) {
        status = pal_memory_plan_check(&model->info, error);
    }
    double begin = pal_seconds_now();
    if (status == PALPATE_OK && cancelled(progress, "assemble")) {
        status = pal_fail(error, PALPATE_ERROR_CANCELLED, "cancelled before assembly");
    }
    if (status == PALPATE_OK) {
        status =
            pal_discretize(cloud, fixed, scene->poisson, &scene->method, progress, &system, error);
        (void)snprintf(model->info.method_options, sizeof model->info.method_options, "%s",
                       system.options);
        seconds->assemble = pal_seconds_now() - begin;
    }
    if (status == PALPATE_OK) {
        begin = pal_seconds_now();
        status = pal_factor_create_beside(&system.matrix, system.positive,
                                          pal_memory_plan_blocks(&model->info), progress, &factor,
                                          &factor_report, error);
        seconds->factor = pal_seconds_now() - begin;
    }
    if (status == PALPATE_OK) {
        begin = pal_seconds_now();
        status = pal_compliance_solve(&system, factor, scene->young, cloud->length, probes,
                                      progress, model, &solve_report, error);
        seconds->solve = pal_seconds_now() - begin;
    }
    pal_factor_free(factor);
    if (status == PALPATE_OK) {
        begin = pal_seconds_now();
        status = pal_certify(&system, &factor_report, &solve_report, cloud->length,
                             (pal_repair)scene->symmetrize, progress, model, error);
        seconds->certify = pal_seconds_now() - begin;
    }
    if (status == PALPATE_OK) {
        begin = pal_seconds_now();
        status = pal_compress(model, scene->store_tolerance, progress, error);
        seconds->solve += pal_seconds_now() - begin;
    }
    if (status == PALPATE_OK) {
        describe_build(&model->info, &factor_report, &solve_report);
        model->info.bytes = block_bytes(model);
    }
    pal_system_clear(&system);
    free(probes);
    free(fixed);
    return status;
}

/// OpenBLAS's threads wait by spinning: on a machine that does anything else they cost more than
/// they bring, and their sums depend on the number of cores. Our own threads use the cores instead.
/// The setting is the process's, so calls that overlap share it: the first saves it, the last
/// restores it.
static pthread_mutex_t blas_lock = PTHREAD_MUTEX_INITIALIZER;
static int blas_users, blas_threads;

static void enter_one_blas_thread(void) {
    pthread_mutex_lock(&blas_lock);
    if (blas_users++ == 0) {
        blas_threads = openblas_get_num_threads();
        openblas_set_num_threads(1);
    }
    pthread_mutex_unlock(&blas_lock);
}

static void leave_one_blas_thread(void) {
    pthread_mutex_lock(&blas_lock);
    if (--blas_users == 0) {
        openblas_set_num_threads(blas_threads);
    }
    pthread_mutex_unlock(&blas_lock);
}

static pal_status precompute_with_one_blas_thread(pal_scene *scene, const pal_progress *progress,
                                                  pal_model **out, pal_error *error);

static void start_quiet(pal_error *error) {
    if (error != NULL) {
        error->message[0] = 0;
    }
}

/// The contract of an error: no model unless it only fails its certificate, and always a message (a
/// warning that found no memory left none).
static pal_status settle(pal_status status, pal_model **out, pal_error *error) {
    if (status != PALPATE_OK && status != PALPATE_ERROR_CERTIFICATE) {
        pal_model_free(*out);
        *out = NULL;
    }
    return status == PALPATE_ERROR_MEMORY && error != NULL && error->message[0] == 0
               ? pal_fail(error, status, "out of memory")
               : status;
}

pal_status pal_precompute(pal_scene *scene, const pal_progress *progress, pal_model **out,
                          pal_error *error) {
    start_quiet(error);
    enter_one_blas_thread();
    pal_status status = precompute_with_one_blas_thread(scene, progress, out, error);
    leave_one_blas_thread();
    return settle(status, out, error);
}

/// Cloud, discretization, factor, compliance, certificate of one scene.
static pal_status build_model(pal_scene *scene, const pal_progress *progress, pal_model **out,
                              pal_error *error) {
    *out = NULL;
    double begin = pal_seconds_now();
    pal_cloud cloud = {0};
    pal_skin_source skin = {0};
    pal_node_sets sets = {0};
    pal_model *model = pal_model_new();
    if (model == NULL) {
        return pal_fail(error, PALPATE_ERROR_MEMORY, "out of memory");
    }
    pal_status status = pal_scene_hash(scene, model->info.hash, error);
    if (status == PALPATE_OK && cancelled(progress, "cloud")) {
        status = pal_fail(error, PALPATE_ERROR_CANCELLED, "cancelled before the cloud");
    }
    if (status == PALPATE_OK) {
        status = pal_cloud_build(scene, progress, &cloud, &skin, error);
    }
    if (status == PALPATE_OK) {
        status = pal_scene_select_nodes(scene, &cloud, &sets, error);
        model->info.seconds.cloud = pal_seconds_now() - begin;
    }
    if (status == PALPATE_OK) {
        status = pal_build_on_cloud(scene, &cloud, &skin, &sets, progress, model, error);
    }
    if (status == PALPATE_OK) {
        model->info.seconds.total = pal_seconds_now() - begin;
        status = pal_model_check(model, error);
    }
    pal_node_sets_clear(&sets);
    pal_skin_clear(&skin);
    pal_cloud_clear(&cloud);
    if (status != PALPATE_OK) {
        pal_model_free(model);
        return status;
    }
    *out = model;
    return PALPATE_OK;
}

/// The same on a coarser cloud, for the estimate of the error. Only cancelling is an error here:
/// without a second cloud the model is as good as before, and says that nothing was estimated.
static pal_status estimate_error(pal_scene *scene, const pal_progress *progress, pal_model *model,
                                 pal_error *error) {
    pal_scene coarse_scene;
    pal_model *coarse = NULL;
    pal_error why = {0};
    double begin = pal_seconds_now();
    pal_status status = pal_estimate_scene(scene, &coarse_scene, &why);
    if (status == PALPATE_OK) {
        status = build_model(&coarse_scene, progress, &coarse, &why);
        pal_estimate_scene_clear(&coarse_scene);
    }
    if (status == PALPATE_OK) {
        model->info.certificate.estimated_error = pal_estimate_error(model, coarse);
    }
    pal_model_free(coarse);
    double took = pal_seconds_now() - begin;
    model->info.seconds.certify += took;
    model->info.seconds.total += took;
    if (status == PALPATE_ERROR_CANCELLED) {
        return pal_fail(error, status, "%s", why.message);
    }
    return status == PALPATE_OK
               ? PALPATE_OK
               : pal_scene_warn(scene, NULL, "the discretization error is not estimated: %s",
                                why.message);
}

/// The scene's warnings from number `first` on go with the model: who takes it from the cache, or
/// from its file alone, reads them too. Whole lines, as many as there is room for.
static void keep_warnings(const pal_scene *scene, int32_t first, pal_model_info *info) {
    size_t used = 0;
    for (int32_t i = first; i < scene->warning_count; i++) {
        size_t length = strlen(scene->warning[i]);
        if (used + length + 2 > sizeof info->warnings) {
            continue;
        }
        if (used > 0) {
            info->warnings[used++] = '\n';
        }
        memcpy(info->warnings + used, scene->warning[i], length + 1);
        used += length;
    }
}

static pal_status precompute_with_one_blas_thread(pal_scene *scene, const pal_progress *progress,
                                                  pal_model **out, pal_error *error) {
    pal_model *model = NULL;
    int32_t warned = scene->warning_count;
    *out = NULL;
    pal_status status = build_model(scene, progress, &model, error);
    if (status == PALPATE_OK && scene->estimate && scene->patch_count > 0) {
        status = estimate_error(scene, progress, model, error);
    }
    if (status != PALPATE_OK) {
        pal_model_free(model);
        return status;
    }
    *out = model;
    const pal_model_info *info = &model->info;
    if (info->field_tolerance > 0 && info->field_error > info->field_tolerance) {
        status = pal_scene_warn(
            scene, NULL,
            "store.tolerance: %g is asked for, double precision errs by %.1e over sampled "
            "contacts; fields are single precision: use 1e-6 or more",
            info->field_tolerance, info->field_error);
        if (status != PALPATE_OK) {
            return status;
        }
    }
    keep_warnings(scene, warned, &model->info);
    const pal_certificate *c = &model->info.certificate;
    if (!c->pass && scene->certify_warn) {
        return pal_scene_warn(scene, NULL, "the model does not pass its certificate: %s",
                              c->reason);
    }
    if (!c->pass) {
        return pal_fail(
            error, PALPATE_ERROR_CERTIFICATE,
            "the model does not pass its certificate: %s; to write it all the same, set "
            "certify: warn",
            c->reason);
    }
    return PALPATE_OK;
}

static pal_status through_cache(pal_scene *scene, const pal_progress *progress, pal_model **out,
                                int *was_cached, pal_error *error) {
    char path[4096], hash[65];
    if (was_cached != NULL) {
        *was_cached = 0;
    }
    *out = NULL;
    pal_status status = pal_scene_hash(scene, hash, error);
    if (status != PALPATE_OK) {
        return status;
    }
    pal_error cache_error = {0};
    int have_path = pal_cache_path(scene, path, sizeof path, &cache_error) == PALPATE_OK;
    if (have_path && pal_cache_load(path, hash, out, NULL) == PALPATE_OK) {
        (*out)->runtime = scene->runtime;
        if (was_cached != NULL) {
            *was_cached = 1;
        }
        return PALPATE_OK;
    }
    status = pal_precompute(scene, progress, out, error);
    if (status != PALPATE_OK) {
        return status;
    }
    // a cache that cannot be written costs time, not correctness: say so and go on
    if (cancelled(progress, "write")) {
        pal_model_free(*out);
        *out = NULL;
        return pal_fail(error, PALPATE_ERROR_CANCELLED, "cancelled before the model was written");
    }
    if (!have_path) {
        return pal_scene_warn(scene, NULL, "the model is not cached: %s", cache_error.message);
    }
    if (pal_cache_save(*out, path, &cache_error) != PALPATE_OK) {
        return pal_scene_warn(scene, NULL, "the model is not cached: %s", cache_error.message);
    }
    return PALPATE_OK;
}

pal_status pal_precompute_cached(pal_scene *scene, const pal_progress *progress, pal_model **out,
                                 int *was_cached, pal_error *error) {
    start_quiet(error);
    return settle(through_cache(scene, progress, out, was_cached, error), out, error);
}
