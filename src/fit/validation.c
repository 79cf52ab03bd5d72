/* validation.c - the views that are kept out of the training to stop and to choose by.
 *
 * They come from the training views: those that the project holds out are for the user's figures alone, and
 * no fit looks at them.
 */
#include "validation.h"

#include <math.h>

#include "refine.h"
#include "restore_point.h"
#include "schedule.h"

/* Validations in a run, and the gain in dB that counts as one. */
#define INTERVAL 0.04
#define GAIN     0.01

/* What is lost on the way to the last validation, in dB, without which the rates fall on the model as it is:
 * less is the noise of single views, which settles. */
#define FALL 0.3
/* Length of an early cool-down: COOL_DOWN_PART of the time to the best model, at least COOL_DOWN_LEAST of the
 * run.
 */
#define COOL_DOWN_PART  0.25
#define COOL_DOWN_LEAST 0.05

enum {
    FEWEST = 3,          /* training views of which a target may have one */
    PATIENT_STEPS = 100, /* without a gain that no run gives up before, however short */
    STEPS_OF_VIEW = 10   /* between two validations, for each view: they are to cost little */
};

void sf_forget_best_model(sf_validation *v) { v->best_psnr = NAN; }

/* The first `count` of the list are kept out now; what was best on others is no measure for them. */
static void keep_out(sf_fitter *f, size_t count) {
    if (count != f->validation.count) sf_forget_best_model(&f->validation);
    f->validation.count = count;
}

static void drop_gone(sf_fitter *f) {
    size_t kept = 0;
    for (size_t i = 0; i < f->validation.count; i++) {
        sf_view *view = sf_scene_retain_id(f->scene, f->validation.ids[i]);
        if (view) f->validation.ids[kept++] = f->validation.ids[i];
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
    if (every < 2 || f->validation.merged) return SF_OK;
    drop_gone(f);
    while (first < count && ids[first] <= f->validation.newest_id) first++;
    if (first == count) return SF_OK;
    size_t had = f->validation.count, kept = had;
    sf_status status = sf_grow(f->ctx, &f->validation.ids, &f->validation.capacity, had, had + count - first,
                               sizeof *f->validation.ids);
    if (status) return status;
    for (size_t i = first; i < count; i++) /* the middle one of n: projects hold out the first */
        if (f->validation.assigned++ % every == every / 2 && count >= fewest(f))
            f->validation.ids[kept++] = ids[i];
    if (!kept && count >= fewest(f)) f->validation.ids[kept++] = ids[first + (count - first) / 2];
    keep_out(f, kept);
    return SF_OK;
}

sf_status sf_assign_views(sf_fitter *f, const uint32_t *ids, size_t count) {
    sf_status status = deal(f, ids, count);
    if (!status && count && ids[count - 1] > f->validation.newest_id)
        f->validation.newest_id = ids[count - 1];
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

sf_status sf_measure_validation(sf_fitter *f, double *psnr, size_t *views) {
    sf_status status = SF_OK;
    *psnr = 0, *views = 0;
    for (size_t i = 0; i < f->validation.count && !status; i++) {
        sf_view *view = sf_is_blurred(&f->blur, f->validation.ids[i])
                            ? NULL
                            : sf_scene_retain_id(f->scene, f->validation.ids[i]);
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

/* When growth and coarse pictures are over. */
static double learned_by(const sf_fitter *f) {
    const sf_fit_options *o = &f->options;
    return o->pyramid_levels && !f->warm_start ? fmax(o->densify_end, o->pyramid_end) : o->densify_end;
}

/* Whether the run has learned what it can: nothing was gained for long, and neither more Gaussians nor finer
 * pictures were to come meanwhile. Before that a view may well lose for a while what it gains in the end. */
static int is_hopeless(const sf_fitter *f, double fraction) {
    double patience = f->options.patience;
    if (!(patience > 0) || fraction >= f->cool_down.from) return 0;
    return fraction > fmax(f->validation.best_fraction, learned_by(f)) + patience &&
           f->step >= f->validation.best_step + PATIENT_STEPS;
}

/* Whether nothing can come of watching on: the newest look is the best, so that patience would last until the
 * rates fall anyway. Each view is worth more in the training then. */
static int is_safe(const sf_fitter *f, double fraction) {
    return f->validation.best_step == f->step && fraction > learned_by(f) &&
           fraction + f->options.patience >= f->cool_down.from;
}

static sf_status look(sf_fitter *f, double fraction) {
    double psnr, target = f->options.target_psnr;
    size_t views;
    f->validation.next_fraction = fraction + INTERVAL;
    drop_gone(f);
    f->validation.next_step = f->step + STEPS_OF_VIEW * (int64_t)f->validation.count;
    sf_status status = sf_measure_validation(f, &psnr, &views);
    if (status || !views) return status;
    f->validation.psnr = psnr;
    if (!(psnr <= f->validation.best_psnr + GAIN)) {
        status = sf_save_restore_point(f);
        if (status) return status;
        f->validation.best_psnr = psnr, f->validation.best_fraction = fraction,
        f->validation.best_step = f->step;
    }
    if (is_hopeless(f, fraction))
        sf_cool_down_early(f, fraction, fmax(COOL_DOWN_PART * f->validation.best_fraction, COOL_DOWN_LEAST));
    if (target > 0 && psnr >= target) f->end = SF_FIT_TARGET;
    return SF_OK;
}

/* The rates fall, and the views of validation are trained on: the model is to have seen all there is. It is
 * the present one, unless that has lost more than the noise that will settle. */
static sf_status merge_back(sf_fitter *f) {
    double most = sf_cools_down_early(f) ? 0 : FALL;
    sf_status status = SF_OK;
    if (f->restore.model && f->validation.psnr < f->validation.best_psnr - most)
        status = sf_go_to_restore_point(f);
    if (status) return status;
    sf_model_destroy(&f->restore.model);
    f->validation.merged = 1;
    return SF_OK;
}

static int why_over(const sf_fitter *f) {
    if (sf_cools_down_early(f)) return SF_FIT_VALIDATION;
    return f->options.steps > 0 && f->step >= f->options.steps ? SF_FIT_COMPLETE : SF_FIT_TIME;
}

/* What has learned nothing yet is not worth a look. */
static int is_time(const sf_fitter *f, double fraction) {
    if (fraction < INTERVAL && !f->warm_start) return 0;
    return fraction >= f->validation.next_fraction && f->step >= f->validation.next_step;
}

int sf_validation_chooses(const sf_validation *v) { return v->count && !v->merged && !isnan(v->best_psnr); }

sf_status sf_validation_step(sf_fitter *f, double fraction) {
    int watching = f->validation.count && !f->validation.merged, over = fraction >= sf_end_of_run(f);
    sf_status status = SF_OK;
    if (f->end == SF_FIT_TARGET) return SF_ERR_END;
    f->end = SF_FIT_GOES_ON;                               /* an ended run may have got more time */
    int joins = watching && !(f->options.target_psnr > 0); /* a target is looked for to the end */
    if (watching && (over || is_time(f, fraction) || (joins && fraction >= f->cool_down.from))) {
        status = look(f, fraction);
        if (status) return status;
    }
    if (over && !f->end) f->end = why_over(f);
    if (f->end && watching && f->restore.model && f->validation.psnr < f->validation.best_psnr)
        status = sf_go_to_restore_point(f);
    if (!f->end && joins && (fraction >= f->cool_down.from || is_safe(f, fraction))) status = merge_back(f);
    return status ? status : f->end ? SF_ERR_END : SF_OK;
}
