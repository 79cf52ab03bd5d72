/* fit.c - the loop of steps: view, render, loss, gradients, update; densification and selection between
 * steps. */
#include "fit.h"

#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../render/shard.h"
#include "../scene/init.h"
#include "blur.h"
#include "misplaced.h"
#include "densify.h"
#include "draw_view.h"
#include "memory.h"
#include "moving_average.h"
#include "options.h"
#include "out_of_view.h"
#include "ranks.h"
#include "ranks_divide.h"
#include "recovery.h"
#include "refine.h"
#include "remove.h"
#include "reorder.h"
#include "restore_point.h"
#include "sampler.h"
#include "schedule.h"
#include "select.h"
#include "select_merge.h"
#include "time_trace.h"
#include "update.h"
#include "validation.h"

enum {
    ROUNDS = 3,            /* renders to time a step */
    LEAST_GAUSSIANS = 1000 /* initial Gaussians of a cold start that must fit into memory */
};

/* The unit of the model that is trained: about the size of the scene, so that a fit does not depend on the
 * world's unit. */
static int unit_of(const sf_fitter *f) { return ilogb(f->extent); }

/* Of a cold start. */
static sf_status plan_cold_memory(sf_fitter *f) {
    const sf_fit_options *o = &f->options;
    size_t least = o->max_gaussians < LEAST_GAUSSIANS ? (size_t)o->max_gaussians : LEAST_GAUSSIANS;
    return sf_fitter_plan_memory(f, least, (int)o->sh_degree);
}

sf_status sf_fit_memory(sf_context *ctx, sf_scene *scene, const sf_fit_options *options,
                        sf_memory_bill *bill) {
    sf_fit_options defaults = sf_fit_options_default();
    sf_fitter *f;
    sf_status status = sf_fitter_create_empty(ctx, scene, options ? options : &defaults, &f);
    if (!status) status = plan_cold_memory(f);
    if (!status) *bill = f->bill;
    sf_fitter_destroy(&f);
    return status;
}

static sf_status choose_start(sf_fitter *f, const sf_model *from) {
    const sf_fit_options *o = &f->options;
    if (from) {
        int degree = from->sh_degree > o->sh_degree ? from->sh_degree : (int)o->sh_degree;
        size_t count = sf_count_from(f, from);
        if (count > (size_t)o->max_gaussians)
            return sf_fail(f->ctx, SF_ERR_ARGUMENT,
                           "max_gaussians: %lld is less than the %zu of the model gone on from",
                           (long long)o->max_gaussians, count);
        f->warm_start = 1;
        sf_status status = sf_fitter_plan_memory(f, count, degree);
        if (status) return status;
        /* without a rate, bands that a Gaussian lacks stay 0 */
        status = o->lr_sh_rest > 0 || degree > from->sh_degree ? sf_model_copy_whole(from, degree, &f->model)
                                                               : sf_model_copy(from, from->count, &f->model);
        if (!status) sf_scene_place_model(f->scene, f->model);
        if (!status) sf_model_set_unit(f->model, unit_of(f));
        return status;
    }
    sf_status status = plan_cold_memory(f);
    if (status) return status;
    sf_init_options first = {.from = (sf_init)o->init,
                             .max_gaussians = (size_t)o->max_gaussians,
                             .random_count = (size_t)o->init_random,
                             .sh_degree = (int)o->sh_degree,
                             .opacity = o->init_opacity,
                             .scale = o->init_scale,
                             .unit = unit_of(f),
                             .extent = f->extent,
                             .nearest = f->near_plane > 0 ? (double)f->near_plane : 0.04 * f->extent};
    status = sf_init_gaussians(f->scene, &first, &f->rng, &f->model);
    if (!status) memcpy(f->model->origin, f->scene->origin, sizeof f->model->origin);
    return status;
}

static void choose_background(sf_fitter *f) {
    const sf_fit_options *o = &f->options;
    double white = o->background == SF_BACKGROUND_WHITE, color[3] = {white, white, white};
    if (o->background == SF_BACKGROUND_AUTO) color[0] = color[1] = color[2] = 0.5;
    if (o->background == SF_BACKGROUND_COLOR) {
        color[0] = o->background_red;
        color[1] = o->background_green;
        color[2] = o->background_blue;
    }
    memcpy(f->background, color, sizeof color);
}

static void set_step_background(sf_fitter *f) {
    for (int k = 0; k < 3; k++)
        f->step_background[k] = f->options.background == SF_BACKGROUND_RANDOM ? (float)sf_rng_uniform(&f->rng)
                                                                              : (float)f->background[k];
}

/* Gradients of a step, but those of the Gaussians. */
typedef struct step_grads {
    double background[3], exposure[6], camera[SF_CAMERA_SUMS];
} step_grads;

/* A step up to the gradients of each pair of Gaussian and tile. state: of the view; NULL: nothing is learned
 * of it. */
static sf_status differentiate(sf_fitter *f, const sf_view *view, sf_view_state *state, sf_loss_value *loss,
                               step_grads *d) {
    sf_workspace *ws = &f->workspace;
    int exposed = state && f->options.exposure;
    double weight_sum;
    uint64_t before = sf_ranks_sent(f);
    ws->band_only = 1; /* of several ranks each needs but its band of the picture */
    sf_status status = sf_draw_view(f, view, state, &weight_sum);
    if (status) {
        ws->band_only = 0;
        return status;
    }
    if (state) sf_note_depth(state, ws, f->extent);
    sf_stage_loss(ws, f->options.lambda_dssim, f->options.huber_delta, weight_sum, 0, 1, loss);
    if (exposed) sf_expose_bwd(&f->exposure, ws, state, d->exposure);
    status = sf_stage_blend_bwd(ws);
    if (!status && f->options.background == SF_BACKGROUND_AUTO)
        status = sf_stage_background_bwd(ws, d->background);
    ws->band_only = 0;
    sf_ranks_count_step(f, before);
    return status;
}

/* Updates all that is learned but the Gaussians. */
static void update_others(sf_fitter *f, sf_view_state *state, const step_grads *d, double fraction) {
    const sf_fit_options *o = &f->options;
    double decay = f->recovery.lr_scale * pow(o->lr_camera_final, fraction);
    if (o->background == SF_BACKGROUND_AUTO) sf_update_background(f, fraction, d->background);
    if (!state) return;
    if (o->exposure)
        sf_exposure_update(&f->views, state, d->exposure, o,
                           f->recovery.lr_scale * pow(o->lr_exposure_final, fraction));
    if (o->refine_poses && fraction >= o->refine_start) sf_refine_pose(state, d->camera, decay * o->lr_pose);
    if (o->refine_intrinsics) sf_refine_focal(&f->views, state, d->camera + 6, o, decay * o->lr_focal);
}

/* Seconds of a step at full resolution, without the update. */
static sf_status time_step(sf_fitter *f, double *seconds) {
    /* all is restored: a run that replays a time trace does not time a step */
    const sf_rng before = f->rng;
    const double start_before = f->sampler.start;
    sf_view *view;
    sf_status status = sf_next_view(f, &view);
    *seconds = INFINITY;
    for (int round = 0; round < ROUNDS && !status; round++) { /* the first allocates */
        sf_loss_value loss;
        step_grads d;
        double start = sf_clock();
        status = differentiate(f, view, NULL, &loss, &d);
        *seconds = fmin(*seconds, sf_clock() - start);
        if (status == SF_ERR_EMPTY) status = SF_OK;
    }
    if (!status) sf_view_release(view);
    f->sampler.at = f->sampler.count = 0;
    f->rng = before, f->sampler.start = start_before;
    return status;
}

/* Plans the schedule. A run that time alone ends is planned for an estimated number of steps. */
static sf_status make_plan(sf_fitter *f) {
    const sf_fit_options *o = &f->options;
    double planned = (double)o->steps, seconds = 0;
    if (!o->steps && !o->plan_steps) {
        sf_status status = time_step(f, &seconds);
        if (status) return status;
        planned = sf_steps_in(f, o->time_limit - (sf_clock() - f->start), seconds);
        planned = sf_of_first_rank(f, planned);
    }
    sf_plan_schedule(f, planned);
    if (!o->validate) f->validation.count = 0; /* the run is too short for validation */
    return SF_OK;
}

sf_status sf_fitter_create_empty(sf_context *ctx, sf_scene *scene, const sf_fit_options *options,
                                 sf_fitter **out) {
    *out = NULL;
    sf_status status = sf_fit_options_check(ctx, options);
    if (status) return status;
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    if (!info.train_views) return sf_fail(ctx, SF_ERR_EMPTY, "scene: no training view");

    sf_fitter *f = sf_calloc(ctx, 1, sizeof *f);
    if (!f) return SF_ERR_MEMORY;
    f->ctx = ctx;
    f->scene = scene;
    f->options = *options;
    if (options->target_psnr > 0 && options->validate < 2) f->options.validate = SF_VALIDATE_EVERY;
    f->extent = options->extent > 0 ? options->extent : info.extent;
    f->near_plane = (float)(options->near_plane * f->extent);
    f->start = f->rate_time = sf_clock();
    atomic_init(&f->cancelled, 0);
    sf_rng_seed(&f->rng, (uint64_t)options->seed);
    f->sampler.start = sf_rng_uniform(&f->rng);
    sf_workspace_init(&f->workspace, ctx);
    choose_background(f);
    f->validation.psnr = f->validation.best_psnr = NAN;
    f->recovery.lr_scale = 1;
    f->cool_down.from = options->cool_down;
    f->cool_down.length = 1 - options->cool_down;
    *out = f;
    status = sf_ranks_check(f);
    if (!status) status = sf_shard_create(&f->workspace);
    if (status) sf_fitter_destroy(out);
    return status;
}

/* Warns about pictures from one place: they do not determine depths. */
static void warn_of_one_place(sf_fitter *f) {
    if (f->warm_start || !sf_scene_in_one_place(f->scene)) return;
    sf_log(f->ctx, SF_LOG_WARNING,
           "scene: all training pictures are from one place: they do not determine the depth");
}

/* How the Gaussians of the model to start from were drawn decides what their opacities mean. */
static void tell_compensation(const sf_fitter *f, const sf_model *from) {
    if (!from || from->antialiased == f->options.antialiased) return;
    if (from->antialiased)
        sf_log(f->ctx, SF_LOG_INFO,
               "the model to start from is marked as antialiased (mip): the fit is so too (where the mark is "
               "wrong, splatfit convert --antialiased no takes it away)");
    else
        sf_log(f->ctx, SF_LOG_WARNING,
               "antialiased: the model to start from is not marked so: its opacities are taken as they are, "
               "and small Gaussians begin fainter than they were");
}

/* Takes up the views that the scene has at the start. */
static sf_status take_up_views(sf_fitter *f) {
    uint32_t *ids;
    size_t count;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &count);
    if (status) return status;
    status = sf_assign_views(f, ids, count);
    sf_free(f->ctx, ids);
    if (!status && f->options.target_psnr > 0 && !f->validation.count)
        sf_log(f->ctx, SF_LOG_WARNING, "target_psnr: too few training views to look for it: %zu", count);
    return status;
}

sf_status sf_fitter_create(sf_context *ctx, sf_scene *scene, const sf_model *from,
                           const sf_fit_options *options, sf_fitter **out) {
    sf_fit_options defaults = sf_fit_options_default();
    if (!options) options = &defaults;
    sf_status status = sf_fitter_create_empty(ctx, scene, options, out);
    if (status) return status;
    sf_fitter *f = *out;
    if (sf_scene_is_unread(scene))
        status = sf_fail(ctx, SF_ERR_ARGUMENT, "scene: its pictures were not read (no_pixels)");
    if (!status) status = take_up_views(f);
    if (!status) status = choose_start(f, from);
    if (!status) {
        warn_of_one_place(f);
        tell_compensation(f, from);
        f->model->antialiased = options->antialiased || (from && from->antialiased);
        f->first_count = f->model->count;
        f->shared_count = f->first_count;
        status = sf_ranks_divide(f, from);
    }
    if (!status) status = make_plan(f);
    size_t most = status ? 0 : sf_room_of_rank(f, sf_planned_count(f, 1));
    if (!status) status = sf_fitter_start_room(f, most);
    if (!status) status = sf_fitter_sort(f);
    if (status) sf_fitter_destroy(out);
    return status;
}

void sf_fitter_destroy(sf_fitter **fitter_pointer) {
    sf_fitter *f = *fitter_pointer;
    if (!f) return;
    sf_model_destroy(&f->model);
    sf_drop_restore_point(f);
    sf_average_free(f);
    sf_optimizer_destroy(f->ctx, &f->moments);
    sf_free(f->ctx, f->densify.gradient_sum);
    sf_free(f->ctx, f->densify.visible_count);
    sf_free(f->ctx, f->units.inverse);
    sf_free(f->ctx, f->out_of_view.steps);
    sf_merges_free(f);
    sf_free(f->ctx, f->sampler.ids);
    sf_free(f->ctx, f->validation.ids);
    sf_free(f->ctx, f->blur.ids);
    sf_free(f->ctx, f->misplaced.ids);
    sf_free(f->ctx, f->trace.ticks);
    sf_view_states_free(&f->views, f->ctx);
    sf_exposure_free(&f->exposure, f->ctx);
    sf_free(f->ctx, f->band_pixels);
    sf_shard_empty(&f->workspace);
    sf_workspace_free(&f->workspace);
    sf_shard_destroy(&f->workspace);
    sf_free(f->ctx, f);
    *fitter_pointer = NULL;
}

/* Records the loss. A loss that is not finite, or that of a wholly masked view, is replaced by the one
 * before, NAN at the first step. */
static void record_progress(sf_fitter *f, double loss) {
    double before = f->step ? f->losses[(f->step - 1) % SF_LOSS_WINDOW] : NAN;
    f->losses[f->step % SF_LOSS_WINDOW] = isfinite(loss) ? loss : before;
    f->step++;
    double now = sf_clock();
    if (now - f->rate_time >= 1 || f->steps_per_second == 0) {
        f->steps_per_second = (double)(f->step - f->rate_step) / fmax(now - f->rate_time, 1e-9);
        if (now - f->rate_time >= 1) f->rate_time = now, f->rate_step = f->step;
    }
}

/* Validates. If the views of validation are merged into the training, a pass over all views begins. */
static sf_status validate(sf_fitter *f, double fraction) {
    int merged = f->validation.merged;
    sf_status status = sf_validation_step(f, fraction);
    if (f->end) {
        sf_merges_undo_all(f);
        f->merges.on_ranks = 0;
    }
    if (f->validation.merged && !merged) sf_sampler_restart(&f->sampler);
    return status;
}

/* Finds blurred views and begins a pass without them. If some are in validation, the best PSNR is no longer
 * comparable. */
static sf_status find_blurred_views(sf_fitter *f, double fraction) {
    size_t k = f->blur.count;
    sf_status status = sf_measure_blur(f, fraction);
    for (; k < f->blur.count; k++) {
        if (sf_is_in_validation(&f->validation, f->blur.ids[k]))
            sf_forget_best_model(&f->validation);
        else
            sf_sampler_restart(&f->sampler);
    }
    return status;
}

/* Likewise. Views in validation stay there: what they lose is the same for every model. */
static sf_status find_misplaced_views(sf_fitter *f, double fraction) {
    size_t known = f->misplaced.count;
    sf_status status = sf_find_misplaced_views(f, fraction);
    if (f->misplaced.count > known) sf_sampler_restart(&f->sampler);
    return status;
}

void sf_select_and_densify(sf_fitter *f, double fraction) {
    sf_update_second_moments(f);
    int selecting = sf_selection_is_due(f, fraction), changed = 0;
    sf_status status = selecting ? sf_select_step(f, fraction, &changed) : SF_OK;
    if (changed) sf_forget_best_model(&f->validation);
    int densifying = !selecting || (sf_densification_is_due(f, fraction) && !f->densify.ended);
    /* during tentative merges the Gaussians keep their indices */
    if (densifying && !status && !sf_has_merges(f)) {
        status = sf_densify_step(f, fraction);
        if (!status) (void)sf_fitter_sort(f); /* without memory for sorting only the speed suffers */
    }
    if (status) sf_densify_end(f);
    sf_densify_clear(&f->densify, f->model->count);
}

sf_status sf_fitter_step(sf_fitter *f) {
    if (sf_ranks_begin_step(f)) return SF_ERR_CANCELLED;
    double fraction = sf_fraction_at(f, sf_next_time_fraction(f));
    sf_status status = validate(f, fraction);
    if (status == SF_ERR_END && sf_remove_not_finite(f)) status = SF_ERR_MEMORY;
    if (status == SF_ERR_END) { /* room for what is written now */
        f->shared_count = sf_total(f, f->model->count);
        sf_shard_empty(&f->workspace);
        sf_workspace_free(&f->workspace);
    }
    if (!status) status = sf_recovery_step(f, sf_validation_chooses(&f->validation));
    if (!status) status = find_blurred_views(f, fraction);
    if (!status) status = find_misplaced_views(f, fraction);
    if (status) return status;
    sf_view *view;
    status = sf_next_view(f, &view);
    if (status) return status;
    f->level = sf_scheduled_level(f, fraction, view->camera.width, view->camera.height);
    f->sh_degree = sf_scheduled_degree(f, fraction);
    set_step_background(f);

    sf_loss_value loss = {.loss = NAN};
    step_grads d;
    sf_view_state *state = sf_view_state_of(&f->views, view->id);
    int with_camera = f->options.refine_poses || f->options.refine_intrinsics;
    status = differentiate(f, view, state, &loss, &d);
    sf_view_release(view);
    int64_t diverged = f->recovery.count;
    if (!status && !isfinite(loss.loss)) status = sf_recover(f, loss.loss);
    if (!status && f->recovery.count > diverged)
        status = SF_ERR_EMPTY; /* the gradients are of the model before the return */
    if (!status) status = sf_update(f, fraction, with_camera ? d.camera : NULL);
    if (status && status != SF_ERR_EMPTY) return status;
    if (!status) {
        update_others(f, state, &d, fraction);
        f->skipped_values += f->workspace.not_finite;
    }
    record_progress(f, loss.loss);
    if (f->workspace.not_finite)
        (void)sf_remove_not_finite(f); /* without memory they stay, and are not drawn */
    if (sf_densification_is_due(f, fraction) || sf_selection_is_due(f, fraction)) {
        sf_fitter_watch_memory(f);
        sf_select_and_densify(f, fraction);
    }
    return SF_OK;
}

sf_status sf_fitter_run(sf_fitter *f, sf_fit_callback callback, void *user) {
    for (;;) {
        sf_status status = sf_fitter_step(f);
        if (status) return status == SF_ERR_END ? SF_OK : status;
        if (!callback) continue;
        sf_fit_progress progress;
        sf_fitter_get_progress(f, &progress);
        callback(user, &progress);
    }
}

void sf_fitter_cancel(sf_fitter *f) { atomic_store(&f->cancelled, 1); }
void sf_fitter_resume(sf_fitter *f) { atomic_store(&f->cancelled, 0); }

void sf_fitter_skip_time(sf_fitter *f, double seconds) {
    f->start += seconds;
    f->rate_time += seconds;
}
