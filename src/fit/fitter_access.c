/* fitter_access.c - reads and changes a fitter between two steps, for the public interface. */
#include "fitter.h"

#include <math.h>
#include <string.h>

#include "../io/cameras_json.h"
#include "../io/model_file.h"
#include "moving_average.h"
#include "ranks.h"
#include "refine.h"
#include "schedule.h"
#include "select_merge.h"

/* Mean of the known losses of the last steps; 0: none is known. */
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
                           .seconds = sf_fit_seconds(f),
                           .gaussians = sf_is_shared(f) ? f->shared_count : f->model->count,
                           .steps_per_second = f->steps_per_second,
                           .level = f->level,
                           .sh_degree = f->sh_degree,
                           .warm_start = f->warm_start,
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

/* Puts the Gaussians of all ranks in the place of this rank's. */
static sf_status gather(const sf_fitter *f, sf_model **model) {
    sf_model *part = *model;
    sf_status status = sf_ranks_gather(f, part, NULL, model);
    if (status) *model = NULL;
    sf_model_destroy(&part);
    return status;
}

sf_status sf_fitter_snapshot_part(const sf_fitter *f, sf_model **part) {
    sf_status status = sf_model_copy(f->model, f->model->count, part);
    if (status) return status;
    sf_take_moving_average(f, *part);
    sf_merges_undo(&f->merges, *part);
    sf_model_set_unit(*part, 0);
    return SF_OK;
}

sf_status sf_fitter_snapshot(const sf_fitter *f, sf_model **model) {
    sf_status status = sf_fitter_snapshot_part(f, model);
    if (!status && sf_is_shared(f)) status = gather(f, model);
    return status;
}

sf_status sf_fitter_save_model(const sf_fitter *f, const char *path, const sf_model_file_options *options) {
    sf_model_file_options o = options ? *options : sf_model_file_options_default();
    sf_model_format format;
    sf_model *model = NULL;
    sf_status status = sf_model_file_check(f->ctx, path, &o, &format);
    if (!status) status = sf_fitter_snapshot_part(f, &model);
    if (!status && sf_is_shared(f) && format == SF_MODEL_PLY) {
        status = sf_ranks_save_ply(f, model, path, &o);
    } else {
        if (!status && sf_is_shared(f)) status = gather(f, &model);
        if (!status && sf_is_first_rank(f)) status = sf_model_save_as(model, path, &o);
    }
    sf_model_destroy(&model);
    return status;
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
    if (sf_camera_check(&camera))
        return sf_fail(f->ctx, SF_ERR_ARGUMENT, "pose: of view %u: not a rotation and a finite translation",
                       id);
    state->given = camera;
    memcpy(state->R_cw, R_cw, sizeof state->R_cw);
    memcpy(state->t_cw, t_cw, sizeof state->t_cw);
    return SF_OK;
}

static void refine_saved(void *views, uint32_t id, sf_camera *camera) { sf_refine_camera(views, id, camera); }

sf_status sf_fitter_save_cameras(const sf_fitter *f, const char *path, int world) {
    sf_view_states views = f->views;
    return sf_save_cameras(f->scene, refine_saved, &views, path, world);
}

sf_status sf_fitter_get_exposure(const sf_fitter *f, uint32_t id, double gain[3], double bias[3]) {
    const sf_view_state *state = sf_view_state_of(&f->views, id);
    if (!state && sf_learns_views(f))
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
