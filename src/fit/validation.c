/* validation.c - training views kept out of the training, to choose the best model and to end the run early.
 *
 * They are taken from the training views. The test views of the project are for the user's evaluation only;
 * no fit reads them.
 */
#include "validation.h"

#include <math.h>

#include "compare.h"
#include "restore_point.h"
#include "schedule.h"

/* INTERVAL: part of the run between two validations. GAIN: least rise of the PSNR in dB that makes a model
 * the best. */
#define INTERVAL 0.04
#define GAIN     0.01

/* At the cool-down the present model is kept unless its PSNR is lower than the best by more than FALL, in dB:
 * smaller losses are gradient noise, which the cool-down removes. */
#define FALL 0.3
/* Length of an early cool-down: COOL_DOWN_PART of the time to the best model, at least COOL_DOWN_LEAST of the
 * run.
 */
#define COOL_DOWN_PART  0.25
#define COOL_DOWN_LEAST 0.05

enum {
    FEWEST = 3,          /* the fewest training views of which one is kept out for a target PSNR */
    PATIENT_STEPS = 100, /* a run goes on for at least this many after the best model */
    STEPS_OF_VIEW = 10   /* between two validations, for each view: bounds the cost of validation */
};

void sf_forget_best_model(sf_validation *v) { v->best_psnr = NAN; }

/* Leaves the first `count` views of the list in validation. The best PSNR on other views is not comparable.
 */
static void set_count(sf_fitter *f, size_t count) {
    if (count != f->validation.count) sf_forget_best_model(&f->validation);
    f->validation.count = count;
}

static void drop_removed(sf_fitter *f) {
    size_t kept = 0;
    for (size_t i = 0; i < f->validation.count; i++) {
        sf_view *view = sf_scene_retain_id(f->scene, f->validation.ids[i]);
        if (view) f->validation.ids[kept++] = f->validation.ids[i];
        sf_view_release(view);
    }
    set_count(f, kept);
}

/* Every n-th view is kept out; the default before the schedule is planned. */
static int64_t validation_interval(const sf_fitter *f) {
    return f->options.validate < 0 ? SF_VALIDATE_EVERY : f->options.validate;
}

/* The fewest training views of which some are kept out: of few views the model misses one more than
 * validation can gain. A target PSNR needs one all the same. */
static size_t fewest(const sf_fitter *f) {
    size_t every = (size_t)validation_interval(f);
    return f->options.target_psnr > 0 && every > FEWEST ? FEWEST : every;
}

/* Assigns new views to validation or training. A view never changes sides. */
static sf_status assign(sf_fitter *f, const uint32_t *ids, size_t count) {
    const int64_t every = validation_interval(f);
    size_t first = 0;
    if (every < 2 || f->validation.merged) return SF_OK;
    drop_removed(f);
    while (first < count && ids[first] <= f->validation.newest_id) first++;
    if (first == count) return SF_OK;
    size_t had = f->validation.count, kept = had;
    sf_status status = sf_grow(f->ctx, &f->validation.ids, &f->validation.capacity, had, had + count - first,
                               sizeof *f->validation.ids);
    if (status) return status;
    /* the middle one of each n: projects often hold out the first for tests */
    for (size_t i = first; i < count; i++)
        if (f->validation.assigned++ % every == every / 2 && count >= fewest(f))
            f->validation.ids[kept++] = ids[i];
    if (!kept && count >= fewest(f)) f->validation.ids[kept++] = ids[first + (count - first) / 2];
    set_count(f, kept);
    return SF_OK;
}

sf_status sf_assign_views(sf_fitter *f, const uint32_t *ids, size_t count) {
    sf_status status = assign(f, ids, count);
    if (!status && count && ids[count - 1] > f->validation.newest_id)
        f->validation.newest_id = ids[count - 1];
    return status;
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

/* The fraction at which densification and coarse pictures have ended. */
static double refined_by(const sf_fitter *f) {
    const sf_fit_options *o = &f->options;
    return o->pyramid_levels && !f->warm_start ? fmax(o->densify_end, o->pyramid_end) : o->densify_end;
}

/* Whether to cool down early: no gain for `patience`, and densification and coarse pictures had ended before.
 * Until then the PSNR may fall for a while and rise in the end. */
static int is_out_of_patience(const sf_fitter *f, double fraction) {
    double patience = f->options.patience;
    if (!(patience > 0) || fraction >= f->cool_down.from) return 0;
    return fraction > fmax(f->validation.best_fraction, refined_by(f)) + patience &&
           f->step >= f->validation.best_step + PATIENT_STEPS;
}

/* Whether more validation is useless: the newest model is the best one, so patience would last until the
 * cool-down anyway. Training on the views gains more then. */
static int needs_no_more(const sf_fitter *f, double fraction) {
    return f->validation.best_step == f->step && fraction > refined_by(f) &&
           fraction + f->options.patience >= f->cool_down.from;
}

static sf_status validate(sf_fitter *f, double fraction) {
    double psnr, target = f->options.target_psnr;
    size_t views;
    f->validation.next_fraction = fraction + INTERVAL;
    drop_removed(f);
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
    if (is_out_of_patience(f, fraction))
        sf_cool_down_early(f, fraction, fmax(COOL_DOWN_PART * f->validation.best_fraction, COOL_DOWN_LEAST));
    if (target > 0 && psnr >= target) f->end = SF_FIT_TARGET;
    return SF_OK;
}

/* The restore point is rounded, so that its PSNR is measured again. */
static sf_status go_back(sf_fitter *f) {
    double psnr;
    size_t views;
    sf_status status = sf_go_to_restore_point(f);
    if (!status) status = sf_measure_validation(f, &psnr, &views);
    if (!status && views) f->validation.psnr = psnr;
    return status;
}

/* Merges the views of validation back into training when the cool-down begins. The model is the present one
 * unless its PSNR fell by more than FALL; before an early cool-down it is the best one. */
static sf_status merge_back(sf_fitter *f) {
    double most = sf_cools_down_early(f) ? 0 : FALL;
    sf_status status = SF_OK;
    if (sf_has_restore_point(f) && f->validation.psnr < f->validation.best_psnr - most) status = go_back(f);
    if (status) return status;
    sf_drop_restore_point(f);
    f->validation.merged = 1;
    return SF_OK;
}

static int why_over(const sf_fitter *f) {
    if (sf_cools_down_early(f)) return SF_FIT_VALIDATION;
    return f->options.steps > 0 && f->step >= f->options.steps ? SF_FIT_COMPLETE : SF_FIT_TIME;
}

/* No validation at the very start of a cold start. */
static int is_due(const sf_fitter *f, double fraction) {
    if (fraction < INTERVAL && !f->warm_start) return 0;
    return fraction >= f->validation.next_fraction && f->step >= f->validation.next_step;
}

int sf_validation_chooses(const sf_validation *v) { return v->count && !v->merged && !isnan(v->best_psnr); }

sf_status sf_validation_step(sf_fitter *f, double fraction) {
    int validates = f->validation.count && !f->validation.merged, over = fraction >= sf_end_of_run(f);
    sf_status status = SF_OK;
    if (f->end == SF_FIT_TARGET) return SF_ERR_END;
    f->end = SF_FIT_GOES_ON;                                  /* an ended run may have been extended */
    int merging = validates && !(f->options.target_psnr > 0); /* a target PSNR needs validation to the end */
    if (validates && (over || is_due(f, fraction) || (merging && fraction >= f->cool_down.from))) {
        status = validate(f, fraction);
        if (status) return status;
    }
    if (over && !f->end) f->end = why_over(f);
    if (f->end && validates && sf_has_restore_point(f) && f->validation.psnr < f->validation.best_psnr)
        status = go_back(f);
    if (!f->end && merging && (fraction >= f->cool_down.from || needs_no_more(f, fraction)))
        status = merge_back(f);
    return status ? status : f->end ? SF_ERR_END : SF_OK;
}
