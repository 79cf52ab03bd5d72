/* validate.c - the views that are kept out of the training to stop and to choose by.
 *
 * They come from the training views: those that the project holds out are for the user's figures alone, and
 * no fit looks at them.
 */
#include "fitter.h"

#include <math.h>

/* Validations in a run, and the gain in dB that counts as one. */
#define INTERVAL 0.04
#define GAIN     0.01

int sf_validates(const sf_fitter *f, uint32_t id) {
    /* by the id, so that a view never changes sides; the last of n: projects hold out the first */
    return f->options.validate > 1 && id % (uint64_t)f->options.validate == (uint64_t)f->options.validate / 2;
}

/* Sum of the weighted squares of what is drawn against the view, and of the weights. */
static void compare(const sf_workspace *ws, const sf_view *view, double *squares, double *weights) {
    size_t width = (size_t)view->camera.width, height = (size_t)view->camera.height;
    for (size_t y = 0; y < height; y++)
        for (size_t x = 0; x < width; x++) {
            size_t at = y * width + x;
            double weight = view->weight ? view->weight[at] / 255.0 : 1;
            for (size_t ch = 0; ch < SF_CHANNELS; ch++) {
                double value = (double)ws->rgb[ch][y * ws->stride + x];
                double error = fmin(fmax(value, 0), 1) - view->rgb[ch * width * height + at] / 255.0;
                *squares += weight * error * error;
            }
            *weights += weight;
        }
}

static sf_status view_psnr(sf_fitter *f, const sf_view *view, double *psnr) {
    sf_render_options options;
    double squares = 0, weights = 0;
    sf_fitter_render_options(f, &options);
    options.sh_degree = f->sh_degree;
    sf_status status = sf_forward(&f->workspace, f->model, &view->camera, &options, 0);
    if (status) return status;
    compare(&f->workspace, view, &squares, &weights);
    *psnr = weights > 0 ? -10 * log10(fmax(squares / (3 * weights), 1e-10)) : NAN;
    return SF_OK;
}

sf_status sf_validate(sf_fitter *f, double *psnr, size_t *views) {
    uint32_t *ids;
    size_t count;
    sf_status status = sf_scene_training_ids(f->scene, &ids, &count);
    if (status) return status;
    *psnr = 0, *views = 0;
    for (size_t i = 0; i < count && !status; i++) {
        sf_view *view = sf_validates(f, ids[i]) ? sf_scene_retain_id(f->scene, ids[i]) : NULL;
        double of_view;
        if (!view) continue;
        status = view_psnr(f, view, &of_view);
        sf_view_release(view);
        if (status || isnan(of_view)) continue;
        *psnr += of_view;
        ++*views;
    }
    sf_free(f->ctx, ids);
    if (*views) *psnr /= (double)*views;
    return status;
}

/* Whether there is room, and no more than the model itself has. */
static int suits(const sf_model *best, const sf_model *model) {
    for (int band = 0; band <= model->sh_degree; band++)
        if (best->capacity[band] < model->banded[band] || best->capacity[band] > model->capacity[band])
            return 0;
    return 1;
}

/* The model as it is becomes the best one. */
static sf_status keep(sf_fitter *f) {
    if (!f->best || !suits(f->best, f->model)) {
        sf_model *best;
        sf_status status = sf_model_copy(f->model, f->model->capacity[0], &best);
        if (status) return status;
        sf_model_destroy(&f->best);
        f->best = best;
        return SF_OK;
    }
    sf_model_assign(f->best, f->model);
    return SF_OK;
}

/* The best model comes back; what the optimiser knew belongs to the other one. */
static sf_status bring_back(sf_fitter *f) {
    sf_status status = sf_fitter_room(f, f->best->banded);
    if (status) return status;
    sf_model_assign(f->model, f->best);
    sf_moments_forget_all(&f->moments, f->model);
    f->validation_psnr = f->best_psnr;
    return SF_OK;
}

sf_status sf_consider(sf_fitter *f, double fraction) {
    const sf_fit_options *o = &f->options;
    if (f->ended) return SF_ERR_END;
    if (o->validate < 2 || (fraction < sf_end_of_run(f) && fraction < f->next_validation)) return SF_OK;
    f->next_validation = fraction + INTERVAL;
    double psnr;
    size_t views;
    sf_status status = sf_validate(f, &psnr, &views);
    if (status || !views) return status;
    f->validation_psnr = psnr;
    if (!(psnr <= f->best_psnr + GAIN)) {
        status = keep(f);
        if (status) return status;
        f->best_psnr = psnr, f->best_fraction = fraction;
    }
    int hopeless = o->patience > 0 && fraction > f->best_fraction + o->patience && fraction > o->grow_end;
    if (hopeless && fraction < f->settle_from) f->settle_from = fraction;
    int ended = fraction >= sf_end_of_run(f) || (o->target_psnr > 0 && psnr >= o->target_psnr);
    if (ended && psnr < f->best_psnr) status = bring_back(f);
    if (status) return status;
    f->ended = ended;
    return ended ? SF_ERR_END : SF_OK;
}
