/* validate.c - the views that are kept out of the training to stop and to choose by.
 *
 * They come from the training views: those that the project holds out are for the user's figures alone, and
 * no fit looks at them.
 */
#include "fitter.h"

#include <math.h>
#include <string.h>

#include "refine.h"
#include "trial.h"

/* Validations in a run, and the gain in dB that counts as one. */
#define INTERVAL 0.04
#define GAIN     0.01

/* What is lost on the way to the last validation, in dB, without which the rates fall on the model as it is:
 * less is the noise of single views, which settles. */
#define FALL 0.3
/* What a run that settles early settles for: such a part of what it took to its best model, and at least
 * that part of the run. */
#define SETTLE_PART  0.25
#define SETTLE_LEAST 0.05

enum {
    FEWEST = 3,          /* training views of which a target may have one */
    PATIENT_STEPS = 100, /* without a gain that no run gives up before, however short */
    STEPS_OF_VIEW = 10   /* between two validations, for each view: they are to cost little */
};

int sf_validates(const sf_fitter *f, uint32_t id) {
    size_t i = 0;
    while (i < f->kept_out_count && f->kept_out[i] != id) i++;
    return !f->joined && i < f->kept_out_count;
}

void sf_forget_best(sf_fitter *f) { f->best_psnr = NAN; }

/* The first `count` of the list are kept out now; what was best on others is no measure for them. */
static void keep_out(sf_fitter *f, size_t count) {
    if (count != f->kept_out_count) sf_forget_best(f);
    f->kept_out_count = count;
}

static void drop_gone(sf_fitter *f) {
    size_t kept = 0;
    for (size_t i = 0; i < f->kept_out_count; i++) {
        sf_view *view = sf_scene_retain_id(f->scene, f->kept_out[i]);
        if (view) f->kept_out[kept++] = f->kept_out[i];
        sf_view_release(view);
    }
    keep_out(f, kept);
}

/* Every so many-th is kept out; before there is a plan, those that one may have. */
static int64_t dealt_out(const sf_fitter *f) {
    return f->options.validate < 0 ? SF_VALIDATE_EVERY : f->options.validate;
}

/* The fewest training views of which some are kept out: where one is a large part of them, the model misses
 * it more than it can gain. A target needs one all the same. */
static size_t fewest(const sf_fitter *f) {
    size_t every = (size_t)dealt_out(f);
    return f->options.target_psnr > 0 && every > FEWEST ? FEWEST : every;
}

/* A view that is kept out or trained on does not change sides: what comes later is dealt with when it comes.
 */
static sf_status deal(sf_fitter *f, const uint32_t *ids, size_t count) {
    const int64_t every = dealt_out(f);
    size_t first = 0;
    if (every < 2 || f->joined) return SF_OK;
    drop_gone(f);
    while (first < count && ids[first] <= f->newest) first++;
    if (first == count) return SF_OK;
    size_t had = f->kept_out_count, kept = had;
    sf_status status =
        sf_grow(f->ctx, &f->kept_out, &f->kept_out_capacity, had, had + count - first, sizeof *f->kept_out);
    if (status) return status;
    for (size_t i = first; i < count; i++) /* the middle one of n: projects hold out the first */
        if (f->taken_up++ % every == every / 2 && count >= fewest(f)) f->kept_out[kept++] = ids[i];
    if (!kept && count >= fewest(f)) f->kept_out[kept++] = ids[first + (count - first) / 2];
    keep_out(f, kept);
    return SF_OK;
}

sf_status sf_take_up(sf_fitter *f, const uint32_t *ids, size_t count) {
    sf_status status = deal(f, ids, count);
    if (!status && count && ids[count - 1] > f->newest) f->newest = ids[count - 1];
    return status;
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

sf_status sf_view_psnr(sf_fitter *f, const sf_view *view, double *psnr) {
    sf_render_options options;
    sf_camera camera = view->camera;
    double squares = 0, weights = 0;
    sf_fitter_render_options(f, &options);
    options.sh_degree = f->sh_degree;
    sf_refine_camera(&f->views, view->id, &camera);
    sf_status status = sf_forward(&f->workspace, f->model, &camera, &options, 0);
    if (status) return status;
    compare(&f->workspace, view, &squares, &weights);
    *psnr = weights > 0 ? sf_psnr_of(squares / (3 * weights)) : NAN;
    return SF_OK;
}

sf_status sf_validate(sf_fitter *f, double *psnr, size_t *views) {
    sf_status status = SF_OK;
    *psnr = 0, *views = 0;
    for (size_t i = 0; i < f->kept_out_count && !status; i++) {
        sf_view *view =
            sf_is_blurred(f, f->kept_out[i]) ? NULL : sf_scene_retain_id(f->scene, f->kept_out[i]);
        double of_view;
        if (!view) continue;
        status = sf_view_psnr(f, view, &of_view);
        sf_view_release(view);
        if (status || isnan(of_view)) continue;
        *psnr += of_view;
        ++*views;
    }
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
sf_status sf_keep_best(sf_fitter *f) {
    if (!f->best || !suits(f->best, f->model)) {
        sf_model *best;
        sf_status status = sf_model_copy(f->model, f->model->capacity[0], &best);
        if (status) return status;
        sf_model_destroy(&f->best);
        f->best = best;
    } else {
        sf_model_assign(f->best, f->model);
    }
    memcpy(f->best_background, f->background, sizeof f->background);
    sf_trials_undo(&f->trials, f->best);
    return SF_OK;
}

/* The best model comes back; what the optimiser and growth knew belongs to the other one. */
sf_status sf_bring_back(sf_fitter *f) {
    sf_status status = sf_fitter_room(f, f->best->banded);
    if (status) return status;
    f->trials.count = 0; /* the best one has none */
    sf_model_assign(f->model, f->best);
    sf_moments_forget_all(&f->moments, f->model);
    memset(f->screen_sum, 0, f->model->count * sizeof *f->screen_sum);
    memset(f->screen_seen, 0, f->model->count * sizeof *f->screen_seen);
    memcpy(f->background, f->best_background, sizeof f->background);
    f->validation_psnr = f->best_psnr;
    f->adam_before = f->step;
    return SF_OK;
}

/* When growth and coarse pictures are over. */
static double learned_by(const sf_fitter *f) {
    const sf_fit_options *o = &f->options;
    return o->pyramid_levels && !f->gone_on ? fmax(o->grow_end, o->pyramid_end) : o->grow_end;
}

/* Whether the run has learned what it can: nothing was gained for long, and neither more Gaussians nor finer
 * pictures were to come meanwhile. Before that a view may well lose for a while what it gains in the end. */
static int is_hopeless(const sf_fitter *f, double fraction) {
    double patience = f->options.patience;
    if (!(patience > 0) || fraction >= f->settle_from) return 0;
    return fraction > fmax(f->best_fraction, learned_by(f)) + patience &&
           f->step >= f->best_step + PATIENT_STEPS;
}

/* Whether nothing can come of watching on: the newest look is the best, so that patience would last until the
 * rates fall anyway. Each view is worth more in the training then. */
static int is_safe(const sf_fitter *f, double fraction) {
    return f->best_step == f->step && fraction > learned_by(f) &&
           fraction + f->options.patience >= f->settle_from;
}

static void settle_early(sf_fitter *f, double fraction) {
    f->settle_from = fraction;
    f->settle_for = fmin(f->settle_for, fmax(SETTLE_PART * f->best_fraction, SETTLE_LEAST));
}

static sf_status look(sf_fitter *f, double fraction) {
    double psnr, target = f->options.target_psnr;
    size_t views;
    f->next_validation = fraction + INTERVAL;
    drop_gone(f);
    f->next_look = f->step + STEPS_OF_VIEW * (int64_t)f->kept_out_count;
    sf_status status = sf_validate(f, &psnr, &views);
    if (status || !views) return status;
    f->validation_psnr = psnr;
    if (!(psnr <= f->best_psnr + GAIN)) {
        status = sf_keep_best(f);
        if (status) return status;
        f->best_psnr = psnr, f->best_fraction = fraction, f->best_step = f->step;
    }
    if (is_hopeless(f, fraction)) settle_early(f, fraction);
    if (target > 0 && psnr >= target) f->end = SF_FIT_TARGET;
    return SF_OK;
}

/* The rates fall, and the views of validation are trained on: the model is to have seen all there is. It is
 * the present one, unless that has lost more than the noise that will settle. */
static sf_status join(sf_fitter *f) {
    double most = sf_settles_early(f) ? 0 : FALL;
    sf_status status = SF_OK;
    if (f->best && f->validation_psnr < f->best_psnr - most) status = sf_bring_back(f);
    if (status) return status;
    sf_model_destroy(&f->best);
    f->joined = 1;
    f->order_at = f->order_count; /* a pass over all of them begins */
    return SF_OK;
}

static int why_over(const sf_fitter *f) {
    if (sf_settles_early(f)) return SF_FIT_VALIDATION;
    return f->options.steps > 0 && f->step >= f->options.steps ? SF_FIT_COMPLETE : SF_FIT_TIME;
}

/* What has learned nothing yet is not worth a look. */
static int is_time(const sf_fitter *f, double fraction) {
    if (fraction < INTERVAL && !f->gone_on) return 0;
    return fraction >= f->next_validation && f->step >= f->next_look;
}

sf_status sf_consider(sf_fitter *f, double fraction) {
    int watching = f->kept_out_count && !f->joined, over = fraction >= sf_end_of_run(f);
    sf_status status = SF_OK;
    if (f->end == SF_FIT_TARGET) return SF_ERR_END;
    f->end = SF_FIT_GOES_ON;                               /* an ended run may have got more time */
    int joins = watching && !(f->options.target_psnr > 0); /* a target is looked for to the end */
    if (watching && (over || is_time(f, fraction) || (joins && fraction >= f->settle_from))) {
        status = look(f, fraction);
        if (status) return status;
    }
    if (over && !f->end) f->end = why_over(f);
    if (f->end && watching && f->best && f->validation_psnr < f->best_psnr) status = sf_bring_back(f);
    if (f->end) sf_trials_end(f);
    if (!f->end && joins && (fraction >= f->settle_from || is_safe(f, fraction))) status = join(f);
    return status ? status : f->end ? SF_ERR_END : SF_OK;
}
