/* fit.c - the loop: a view, a picture of it, the loss, the gradients, an update; now and then growth. */
#include "fitter.h"

#include <math.h>
#include <string.h>

#include "../base/clock.h"
#include "../base/pool.h"
#include "../io/cameras_json.h"
#include "../scene/first.h"
#include "select.h"
#include "refine.h"
#include "select_merge.h"

enum {
    ROUNDS = 3,            /* to time a step */
    LEAST_GAUSSIANS = 1000 /* that a fit without a model to go on from begins with, if so many are allowed */
};

static sf_status choose_start(sf_fitter *f, const sf_model *from) {
    const sf_fit_options *o = &f->options;
    if (from) {
        int degree = from->sh_degree > o->sh_degree ? from->sh_degree : (int)o->sh_degree;
        if (from->count > (size_t)o->max_gaussians)
            return sf_fail(f->ctx, SF_ERR_ARGUMENT,
                           "max_gaussians: %lld is less than the %zu of the model gone on from",
                           (long long)o->max_gaussians, from->count);
        f->warm_start = 1;
        sf_status status = sf_fitter_plan_memory(f, from->count, degree);
        if (status) return status;
        return sf_model_copy_whole(from, degree, &f->model);
    }
    size_t least = o->max_gaussians < LEAST_GAUSSIANS ? (size_t)o->max_gaussians : LEAST_GAUSSIANS;
    sf_status status = sf_fitter_plan_memory(f, least, (int)o->sh_degree);
    if (status) return status;
    sf_first_options first = {.from = (sf_first)o->first,
                              .max_gaussians = (size_t)o->max_gaussians,
                              .random_count = (size_t)o->init_random,
                              .sh_degree = (int)o->sh_degree,
                              .opacity = o->init_opacity,
                              .scale = o->init_scale,
                              .extent = f->extent,
                              .nearest = (double)f->near_plane};
    return sf_first_gaussians(f->scene, &first, &f->rng, &f->model);
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

/* How many of them are trained on; they come first. */
static size_t without_validation(const sf_fitter *f, uint32_t *ids, size_t count) {
    size_t kept = 0;
    for (size_t i = 0; i < count; i++)
        if (!sf_is_in_validation(f, ids[i])) ids[kept++] = ids[i];
    return kept;
}

/* Whether something is learned of each view. */
static int learns_views(const sf_fitter *f) {
    return f->options.exposure || f->options.refine_poses || f->options.refine_intrinsics;
}

/* Views that came or went are no measure for those before. */
static void note_views(sf_fitter *f, size_t count) {
    if (f->sampler.views_before && count != f->sampler.views_before) sf_recovery_forget(f);
    f->sampler.views_before = count;
}

/* Of all training views, ascending, what is known of each is made ready, and those that are trained on stay.
 */
static sf_status meet_views(sf_fitter *f, uint32_t *ids, size_t *count) {
    note_views(f, *count);
    sf_status status = sf_assign_views(f, ids, *count);
    *count = without_validation(f, ids, *count);
    if (!status && learns_views(f)) status = sf_view_states_sync(&f->views, f->scene, ids, *count);
    if (!status && f->options.refine_poses)
        (f->options.hold_two_poses ? sf_hold_two : sf_hold_mean)(&f->views);
    return status;
}

/* Place k of a pass over n views, so that those one after another are far apart: multiples of the golden
 * ratio leave no large gap anywhere, here in the order of their fractions. */
static size_t spread(size_t k, size_t n) {
    double mine = fmod((double)k * SF_GOLDEN, 1);
    size_t rank = 0;
    for (size_t j = 0; j < n; j++) rank += fmod((double)j * SF_GOLDEN, 1) < mine;
    return rank;
}

/* Views of one time or file name mostly stand side by side. The first pass begins at a place that is drawn,
 * and each at one far from those before, so that every view comes back after like times. */
static sf_status spread_order(sf_fitter *f) {
    size_t n = f->sampler.count;
    if (n < 2) return SF_OK;
    uint32_t *order = sf_alloc(f->ctx, n, sizeof *order);
    if (!order) return SF_ERR_MEMORY;
    size_t start = (size_t)(f->sampler.start * (double)n);
    for (size_t k = 0; k < n; k++) order[k] = f->sampler.ids[(start + spread(k, n)) % n];
    sf_free(f->ctx, f->sampler.ids);
    f->sampler.ids = order;
    f->sampler.start = fmod(f->sampler.start + SF_GOLDEN, 1);
    return SF_OK;
}

static sf_status begin_pass(sf_fitter *f) {
    sf_free(f->ctx, f->sampler.ids);
    f->sampler.at = f->sampler.count = 0;
    sf_status status = sf_scene_training_ids(f->scene, &f->sampler.ids, &f->sampler.count);
    if (!status) status = meet_views(f, f->sampler.ids, &f->sampler.count);
    if (!status) {
        sf_skip_blurred_views(f);
        status = spread_order(f);
    }
    if (status) f->sampler.count = 0; /* the pass has not begun */
    return status;
}

/* The pass goes on with these, and then with what it has left. */
static sf_status insert_views(sf_fitter *f, const uint32_t *ids, size_t count) {
    size_t left = f->sampler.count - f->sampler.at;
    uint32_t *order = sf_alloc(f->ctx, f->sampler.count + count, sizeof *order);
    if (!order) return SF_ERR_MEMORY;
    memcpy(order, f->sampler.ids, f->sampler.at * sizeof *order);
    memcpy(order + f->sampler.at, ids, count * sizeof *order);
    memcpy(order + f->sampler.at + count, f->sampler.ids + f->sampler.at, left * sizeof *order);
    sf_free(f->ctx, f->sampler.ids);
    f->sampler.ids = order, f->sampler.count += count;
    return SF_OK;
}

/* Views that came since the pass began are next. They are not kept waiting for its end; nor does it begin
 * anew with them, for where they come one after another it would be left to chance which of the others are
 * ever seen again. */
static sf_status take_newcomers(sf_fitter *f) {
    uint32_t *ids, newest = f->validation.newest_id;
    size_t count, first = 0;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &count);
    if (status) return status;
    if (count && ids[count - 1] > newest) {
        status = meet_views(f, ids, &count);
        while (first < count && ids[first] <= newest) first++;
        if (!status && first < count) status = insert_views(f, ids + first, count - first);
    }
    sf_free(f->ctx, ids);
    return status;
}

/* The next training view, each once a pass, those far apart after one another; views that came are next, and
 * those that went are passed over. The reference is the caller's. */
static sf_status next_view(sf_fitter *f, sf_view **view) {
    sf_status status = f->sampler.count ? take_newcomers(f) : SF_OK;
    for (int passes = 0; passes < 2 && !status;) {
        if (f->sampler.at == f->sampler.count) {
            status = begin_pass(f);
            passes++;
            continue;
        }
        *view = sf_scene_retain_id(f->scene, f->sampler.ids[f->sampler.at++]);
        if (*view && (*view)->split == SF_SPLIT_TRAIN) return SF_OK;
        sf_view_release(*view);
    }
    return status ? status : sf_fail(f->ctx, SF_ERR_EMPTY, "scene: no training view is left");
}

typedef struct target_job {
    sf_workspace *ws;
    const sf_kernels *kernels;
    const sf_view *view;
    int factor;
} target_job;

static void target_task(void *job_pointer, size_t row, int thread) {
    (void)thread;
    const target_job *job = job_pointer;
    sf_workspace *ws = job->ws;
    size_t width = (size_t)job->view->camera.width, height = (size_t)job->view->camera.height;
    size_t from = row * (size_t)job->factor * width, to = row * ws->stride;
    const uint8_t *weight = job->view->weight ? job->view->weight + from : NULL;
    for (size_t ch = 0; ch < SF_CHANNELS; ch++)
        job->kernels->unpack(job->view->rgb + ch * width * height + from, weight, width, job->factor,
                             ws->target[ch] + to, ws->eye.width);
    if (weight) job->kernels->unpack(NULL, weight, width, job->factor, ws->weight + to, ws->eye.width);
}

/* The picture to compare with, and the sum of its weights. */
static double load_target(sf_fitter *f, const sf_view *view, int factor) {
    sf_workspace *ws = &f->workspace;
    target_job job = {ws, f->ctx->kernels, view, factor};
    sf_pool_run(f->ctx->pool, (size_t)ws->eye.height, target_task, &job);
    ws->has_weight = view->weight != NULL;
    double sum = (double)ws->eye.width * ws->eye.height;
    if (ws->has_weight) {
        sum = 0;
        for (int y = 0; y < ws->eye.height; y++)
            for (int x = 0; x < ws->eye.width; x++)
                sum += (double)ws->weight[(size_t)y * ws->stride + (size_t)x];
    }
    return sum;
}

static void set_step_background(sf_fitter *f) {
    for (int k = 0; k < 3; k++)
        f->step_background[k] = f->options.background == SF_BACKGROUND_RANDOM ? (float)sf_rng_uniform(&f->rng)
                                                                              : (float)f->background[k];
}

/* What a step's loss says about all but the Gaussians. */
typedef struct step_grads {
    double background[3], exposure[6], camera[SF_CAMERA_SUMS];
} step_grads;

sf_status sf_draw_view(sf_fitter *f, const sf_view *view, const sf_view_state *state, double *weight_sum) {
    sf_workspace *ws = &f->workspace;
    sf_camera camera = view->camera;
    int exposed = state && f->options.exposure;
    sf_refine_camera(&f->views, view->id, &camera);
    camera = sf_camera_downscaled(&camera, 1 << f->level);
    sf_status status = sf_workspace_look(ws, &camera, f->near_plane);
    if (!status) sf_workspace_reduced(ws, 1 << f->level);
    if (!status) status = sf_workspace_loss_room(ws);
    if (!status) status = sf_stage_project(ws, f->model, f->sh_degree, f->model->antialiased);
    if (!status) status = sf_stage_bin(ws);
    if (!status && exposed) status = sf_exposure_room(&f->exposure, ws);
    if (status) return status;
    sf_stage_blend(ws, f->step_background, 0);
    *weight_sum = load_target(f, view, 1 << f->level);
    if (!(*weight_sum > 0)) return SF_ERR_EMPTY; /* masked altogether: nothing to learn from it */
    if (exposed) sf_expose(&f->exposure, ws, state);
    return SF_OK;
}

/* Everything of a step up to what each pair of Gaussian and tile adds to the gradients. state: of the view,
 * NULL where nothing is learned of it. */
static sf_status differentiate(sf_fitter *f, const sf_view *view, sf_view_state *state, sf_loss_value *loss,
                               step_grads *d) {
    sf_workspace *ws = &f->workspace;
    int exposed = state && f->options.exposure;
    double weight_sum;
    sf_status status = sf_draw_view(f, view, state, &weight_sum);
    if (status) return status;
    if (state) sf_note_depth(state, ws, f->extent);
    sf_stage_loss(ws, f->options.lambda_dssim, f->options.huber_delta, weight_sum, 0, 1, loss);
    if (exposed) sf_expose_bwd(&f->exposure, ws, state, d->exposure);
    status = sf_stage_blend_bwd(ws);
    if (!status && f->options.background == SF_BACKGROUND_AUTO)
        status = sf_stage_background_bwd(ws, d->background);
    return status;
}

/* All that a step teaches beside the Gaussians. */
static void update_beside(sf_fitter *f, sf_view_state *state, const step_grads *d, double fraction) {
    const sf_fit_options *o = &f->options;
    double decay = f->recovery.lr_scale * pow(o->lr_camera_final, fraction);
    if (o->background == SF_BACKGROUND_AUTO) sf_update_background(f, fraction, d->background);
    if (!state) return;
    if (o->exposure)
        sf_exposure_update(&f->views, state, d->exposure, o,
                           f->recovery.lr_scale * pow(o->lr_exposure_final, fraction));
    if (o->refine_poses && fraction >= o->refine_start)
        sf_refine_pose(state, d->camera, o, decay * o->lr_pose);
    if (o->refine_intrinsics) sf_refine_focal(&f->views, state, d->camera + 6, o, decay * o->lr_focal);
}

/* Seconds of a step of a training view at full resolution, but for the update. */
static sf_status time_step(sf_fitter *f, double *seconds) {
    const sf_rng before = f->rng; /* a run that repeats this one's plan does not come here */
    const double start_before = f->sampler.start;
    sf_view *view;
    sf_status status = next_view(f, &view);
    *seconds = INFINITY;
    for (int round = 0; round < ROUNDS && !status; round++) { /* the first makes room */
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

/* A run that time alone ends is planned for as many steps as it seems to have. */
static sf_status make_plan(sf_fitter *f) {
    const sf_fit_options *o = &f->options;
    double planned = (double)o->steps, seconds = 0;
    if (!o->steps && !o->plan_steps) {
        sf_status status = time_step(f, &seconds);
        if (status) return status;
        planned = sf_steps_in(f, o->time_limit - (sf_clock() - f->start), seconds);
    }
    sf_plan_schedule(f, planned);
    if (!o->validate) f->validation.count = 0; /* too short for it, after all */
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
    f->cool_down.from = options->lr_settle;
    f->cool_down.length = 1 - options->lr_settle;
    *out = f;
    return SF_OK;
}

/* Pictures that were all taken from one place say nothing of depths. */
static void warn_of_one_place(sf_fitter *f) {
    if (f->warm_start || !sf_scene_in_one_place(f->scene)) return;
    sf_log(f->ctx, SF_LOG_WARNING,
           "scene: all training pictures are from one place: they do not determine the depth");
}

/* The views that there are at the start. */
static sf_status take_up_first(sf_fitter *f) {
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
    status = take_up_first(f);
    if (!status) status = choose_start(f, from);
    if (!status) {
        warn_of_one_place(f);
        f->model->antialiased = options->antialiased || (from && from->antialiased);
        f->first_count = f->model->count;
        status = make_plan(f);
    }
    size_t most = status ? 0 : sf_planned_count(f, 1);
    if (!status) status = sf_fitter_start_room(f, most);
    if (!status) status = sf_fitter_sort(f);
    if (status) sf_fitter_destroy(out);
    return status;
}

void sf_fitter_destroy(sf_fitter **fitter_pointer) {
    sf_fitter *f = *fitter_pointer;
    if (!f) return;
    sf_model_destroy(&f->model);
    sf_model_destroy(&f->restore.model);
    sf_average_free(f);
    sf_optimizer_destroy(f->ctx, &f->moments);
    sf_free(f->ctx, f->densify.gradient_sum);
    sf_free(f->ctx, f->densify.visible_count);
    sf_merges_free(f);
    sf_free(f->ctx, f->sampler.ids);
    sf_free(f->ctx, f->validation.ids);
    sf_free(f->ctx, f->blur.ids);
    sf_free(f->ctx, f->trace.ticks);
    sf_view_states_free(&f->views, f->ctx);
    sf_exposure_free(&f->exposure, f->ctx);
    sf_workspace_free(&f->workspace);
    sf_free(f->ctx, f);
    *fitter_pointer = NULL;
}

/* A loss that is not finite tells nothing beyond the warning, and a view that is masked altogether has none:
 * the one before stands for it, NAN where none was known yet. */
static void note_progress(sf_fitter *f, double loss) {
    double before = f->step ? f->losses[(f->step - 1) % SF_LOSS_WINDOW] : NAN;
    f->losses[f->step % SF_LOSS_WINDOW] = isfinite(loss) ? loss : before;
    f->step++;
    double now = sf_clock();
    if (now - f->rate_time >= 1 || f->steps_per_second == 0) {
        f->steps_per_second = (double)(f->step - f->rate_step) / fmax(now - f->rate_time, 1e-9);
        if (now - f->rate_time >= 1) f->rate_time = now, f->rate_step = f->step;
    }
}

sf_status sf_fitter_step(sf_fitter *f) {
    if (atomic_load(&f->cancelled)) return SF_ERR_CANCELLED;
    double fraction = sf_next_fraction(f);
    sf_status status = sf_validation_step(f, fraction);
    if (status == SF_ERR_END && sf_drop_not_finite(f)) status = SF_ERR_MEMORY;
    if (!status) status = sf_recovery_step(f);
    if (!status) status = sf_measure_blur(f, fraction);
    if (status) return status;
    sf_view *view;
    status = next_view(f, &view);
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
    if (!status && f->recovery.count > diverged) status = SF_ERR_EMPTY; /* of a model that is no more */
    if (!status) status = sf_update(f, fraction, with_camera ? d.camera : NULL);
    if (status && status != SF_ERR_EMPTY) return status;
    if (!status) {
        update_beside(f, state, &d, fraction);
        f->skipped_values += f->workspace.not_finite;
    }
    note_progress(f, loss.loss);
    if (f->workspace.not_finite) (void)sf_drop_not_finite(f); /* left out, where there is no memory for it */
    if (sf_densification_is_due(f, fraction) || sf_selection_is_due(f, fraction)) {
        sf_fitter_watch_memory(f);
        sf_densify_and_prune(f, fraction);
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

/* Of the last steps, as far as it is known; 0: of none. */
static double mean_loss(const sf_fitter *f) {
    double sum = 0, known = 0;
    for (int64_t i = 0; i < f->step && i < SF_LOSS_WINDOW; i++)
        if (!isnan(f->losses[i])) sum += f->losses[i], known++;
    return known > 0 ? sum / known : 0;
}

void sf_fitter_get_progress(const sf_fitter *f, sf_fit_progress *p) {
    *p = (sf_fit_progress){.step = f->step,
                           .steps = f->options.steps,
                           .fraction = sf_fraction(f),
                           .seconds = sf_clock() - f->start,
                           .gaussians = f->model->count,
                           .steps_per_second = f->steps_per_second,
                           .level = f->level,
                           .sh_degree = f->sh_degree,
                           .gone_on = f->warm_start,
                           .skipped_values = f->skipped_values,
                           .diverged = f->recovery.count,
                           .validation_psnr = f->validation.psnr,
                           .best_step = f->validation.best_step,
                           .end = (sf_fit_end)f->end};
    p->loss = mean_loss(f);
    double left = INFINITY;
    double end = sf_end_of_run(f), ahead = fmax(end - p->fraction, 0);
    if (f->options.steps > 0 && f->steps_per_second > 0)
        left = ahead * (double)f->options.steps / f->steps_per_second * sf_cost_ahead(f, p->fraction);
    if (f->options.time_limit > 0) left = fmin(left, f->options.time_limit * end - p->seconds);
    p->eta_seconds = fmax(left, 0);
    for (int k = 0; k < 3; k++) p->background[k] = (float)f->background[k];
    sf_refinement(&f->views, &p->turned_degrees, &p->moved_depths, &p->focal_change);
}

void sf_fitter_cancel(sf_fitter *f) { atomic_store(&f->cancelled, 1); }
void sf_fitter_resume(sf_fitter *f) { atomic_store(&f->cancelled, 0); }

void sf_fitter_skip_time(sf_fitter *f, double seconds) {
    f->start += seconds;
    f->rate_time += seconds;
}

sf_status sf_fitter_snapshot(const sf_fitter *f, sf_model **model) {
    sf_status status = sf_model_copy(f->model, f->model->count, model);
    if (status) return status;
    sf_take_moving_average(f, *model);
    sf_merges_undo(&f->merges, *model);
    return SF_OK;
}

sf_status sf_fitter_get_camera(const sf_fitter *f, uint32_t id, sf_camera *camera) {
    sf_view *view = sf_scene_retain_id(f->scene, id);
    if (!view) return sf_fail(f->ctx, SF_ERR_ARGUMENT, "id: no view %u in the scene", id);
    *camera = view->camera;
    sf_view_release(view);
    sf_refine_camera(&f->views, id, camera);
    return SF_OK;
}

sf_status sf_fitter_hold_pose(sf_fitter *f, uint32_t id) {
    sf_view_state *state = sf_view_state_of(&f->views, id);
    if (!state) return sf_fail(f->ctx, SF_ERR_ARGUMENT, "id: no training view %u was taken up", id);
    state->held = 1;
    memcpy(state->R_cw, state->given.R_cw, sizeof state->R_cw); /* a step may have moved it */
    memcpy(state->t_cw, state->given.t_cw, sizeof state->t_cw);
    return SF_OK;
}

sf_status sf_fitter_set_pose(sf_fitter *f, uint32_t id, const double R_cw[9], const double t_cw[3]) {
    sf_view_state *state = sf_view_state_of(&f->views, id);
    if (!state) return sf_fail(f->ctx, SF_ERR_ARGUMENT, "id: no training view %u was taken up", id);
    sf_camera camera = state->given;
    memcpy(camera.R_cw, R_cw, sizeof camera.R_cw);
    memcpy(camera.t_cw, t_cw, sizeof camera.t_cw);
    if (sf_camera_check(&camera)) return sf_fail(f->ctx, SF_ERR_ARGUMENT, "pose: of view %u: is none", id);
    state->given = camera;
    memcpy(state->R_cw, R_cw, sizeof state->R_cw);
    memcpy(state->t_cw, t_cw, sizeof state->t_cw);
    return SF_OK;
}

static void refine_saved(void *views, uint32_t id, sf_camera *camera) { sf_refine_camera(views, id, camera); }

sf_status sf_fitter_save_cameras(const sf_fitter *f, const char *path) {
    sf_view_states views = f->views;
    return sf_save_cameras(f->scene, refine_saved, &views, path);
}

sf_status sf_fitter_get_exposure(const sf_fitter *f, uint32_t id, double gain[3], double bias[3]) {
    const sf_view_state *state = sf_view_state_of(&f->views, id);
    if (!state && learns_views(f))
        return sf_fail(f->ctx, SF_ERR_ARGUMENT, "id: no training view %u was taken up", id);
    for (int k = 0; k < 3; k++) {
        gain[k] = state ? exp(state->log_gain[k]) : 1;
        bias[k] = state ? state->bias[k] : 0;
    }
    return SF_OK;
}
sf_status sf_fitter_set_exposure(sf_fitter *f, uint32_t id, const double gain[3], const double bias[3]) {
    sf_view_state *state = sf_view_state_of(&f->views, id);
    if (!state) return sf_fail(f->ctx, SF_ERR_ARGUMENT, "id: no training view %u was taken up", id);
    for (int k = 0; k < 3; k++)
        if (!(gain[k] > 0 && isfinite(gain[k]) && isfinite(bias[k])))
            return sf_fail(f->ctx, SF_ERR_ARGUMENT, "exposure: a gain of %g and a bias of %g", gain[k],
                           bias[k]);
    for (int k = 0; k < 3; k++) state->log_gain[k] = log(gain[k]), state->bias[k] = bias[k];
    return SF_OK;
}

void sf_fitter_get_options(const sf_fitter *f, sf_fit_options *options) { *options = f->options; }

void sf_fitter_render_options(const sf_fitter *f, sf_render_options *options) {
    *options = sf_render_options_default();
    options->near_plane = f->near_plane;
    for (int k = 0; k < 3; k++) options->background[k] = (float)f->background[k];
}

sf_status sf_fitter_render(sf_fitter *f, const sf_camera *camera, const sf_image_out *out) {
    sf_render_options options;
    sf_fitter_render_options(f, &options);
    const sf_model *model = sf_fitter_average_model(f);
    sf_status status = sf_forward(&f->workspace, model, camera, &options, out->depth != NULL);
    if (!status) sf_copy_out(&f->workspace, out);
    return status;
}
