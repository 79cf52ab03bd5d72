/* update.c - one step of the optimizer. */
#include "update.h"

#include <math.h>
#include <string.h>

#include "../scene/gaussian_math.h"
#include "adam.h"
#include "densify_relocate.h"
#include "local_units.h"
#include "out_of_view.h"
#include "schedule.h"

typedef struct update_job {
    sf_fitter *fitter;
    sf_adam step[SF_FIELD_COUNT];
    uint32_t key[SF_FIELD_COUNT]; /* seed of the stochastic rounding of moments */
    float most_ratio, most_scale; /* logarithms of the greatest aspect and scale */
    float fade, shrink;           /* decay in this step: of logits, times the opacity; of log-scales */
    double noise;                 /* strength of the noise of densify_relocate.c */
    int skips;                    /* whether groups out of view stay as they are (out_of_view.h) */
} update_job;

static float least_of(float a, float b) { return a < b ? a : b; }
static float most_of(float a, float b) { return a > b ? a : b; }

/* Limits the log-scales of a block: to the range that files allow, to the greatest scale, and the longest
 * axis to the greatest ratio to the middle one. Needles and very large Gaussians fit one view and hurt
 * others; removing them would leave a hole until others fill it. No branches or calls, so that compilers
 * vectorise it. */
static void limit_scales(float *block, float most_ratio, const float *most_scale) {
    float *x = block, *y = block + SF_LANES, *z = block + 2 * SF_LANES;
    for (int k = 0; k < 3 * SF_LANES; k++)
        block[k] = most_of(least_of(block[k], most_scale[k % SF_LANES]), SF_LOG_SCALE_LEAST_TRAINED);
    for (int i = 0; i < SF_LANES; i++) {
        float middle = most_of(least_of(x[i], y[i]), least_of(most_of(x[i], y[i]), z[i]));
        float most = middle + most_ratio;
        x[i] = least_of(x[i], most), y[i] = least_of(y[i], most), z[i] = least_of(z[i], most);
    }
}

/* The greatest log-scales of a block's lanes, where a unit is known. quick: a lower bound, which takes no
 * logarithms: log(x) < log(2) (e + 1), with e the exponent of x. */
static void greatest_scales(const update_job *job, size_t block, int quick, float *most) {
    const float *inverse = job->fitter->units.inverse + block * SF_LANES;
    size_t left = job->fitter->model->count - block * SF_LANES;
    for (size_t k = 0; k < SF_LANES; k++) {
        float unit = k < left ? inverse[k] : 0;
        float above = quick      ? 0.6932f * ((float)(sf_bits_of(unit) >> 23) - 125.9f)
                      : unit > 0 ? logf(unit)
                                 : 0;
        most[k] = unit > 0 ? least_of(job->most_scale - above, SF_LOG_SCALE_MOST) : SF_LOG_SCALE_MOST;
    }
}

static void limit_block(const update_job *job, float *log_scales, size_t block) {
    float most[SF_LANES], above = -INFINITY;
    greatest_scales(job, block, 1, most);
    for (size_t k = 0; k < 3 * SF_LANES; k++)
        above = most_of(log_scales[k] - most[k % SF_LANES], above); /* NaN is not above */
    if (above > 0) greatest_scales(job, block, 0, most);
    limit_scales(log_scales, job->most_ratio, most);
}

/* A step of the means of one block. Adam takes them in local units: the gradient times the unit, and from 0,
 * so that the step alone is rounded. */
static void move_means(const update_job *job, float *mean, const float *grads, size_t block) {
    _Alignas(64) float local[3 * SF_LANES], step[3 * SF_LANES] = {0};
    const sf_fitter *f = job->fitter;
    float unit[SF_LANES];
    for (size_t k = 0; k < SF_LANES; k++) {
        size_t i = block * SF_LANES + k;
        unit[k] = i < f->model->count ? sf_unit_of(f, i) : 0;
    }
    for (size_t k = 0; k < 3 * SF_LANES; k++) local[k] = grads[k] * unit[k % SF_LANES];
    sf_optimizer_step(&f->moments, f->ctx->kernels,
                      (sf_value_range){SF_FIELD_mean, 3 * SF_LANES * block, 3 * SF_LANES}, step, local,
                      &job->step[SF_FIELD_mean], job->key[SF_FIELD_mean]);
    for (size_t k = 0; k < 3 * SF_LANES; k++) mean[k] += step[k] * unit[k % SF_LANES];
}

static void gather_statistics(sf_fitter *f, size_t first, size_t end) {
    const uint8_t *state = f->workspace.state;
    for (size_t i = first; i < end; i++) {
        uint32_t seen = state[i] == SF_SEEN;
        f->densify.gradient_sum[i] += seen ? (double)f->workspace.screen[i] : 0;
        f->densify.visible_count[i] += seen;
    }
}

/* Decay of opacities and scales. It is decoupled from Adam, which would turn the least gradient into whole
 * steps where no other acts. Only visible Gaussians decay: those that few views see must not fade while other
 * views are drawn. */
static void regularise(const update_job *job, size_t first, size_t end) {
    const sf_fitter *f = job->fitter;
    const sf_params *p = &f->model->params;
    for (size_t i = first; i < end; i++) {
        if (f->workspace.state[i] != SF_SEEN) continue;
        float *logit = &p->field[SF_FIELD_logit_opacity][i];
        *logit -= job->fade * sf_sigmoidf(*logit);
        for (int axis = 0; axis < 3; axis++) *sf_value(p, SF_FIELD_log_scale, i, axis) -= job->shrink;
    }
}

/* Calls `part` for all fields with a moving average, also of invisible blocks: momentum moves them. */
static void around_mean(const sf_fitter *f, size_t first, size_t end,
                        void (*part)(const sf_optimizer_state *, int, size_t, size_t, const float *)) {
    for (int field = 0; sf_has_momentum(field); field++) {
        size_t block = (size_t)sf_field_components(field) * SF_LANES, at = first * block;
        part(&f->moments, field, at, (end - first) * block, f->model->params.field[field] + at);
    }
}

/* One step of Adam for some blocks. */
static void step_blocks(const update_job *job, const sf_params *grads, size_t first, size_t end, int seen) {
    sf_fitter *f = job->fitter;
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        /* no gradient: a band that these blocks lack, or that is not in use yet */
        if (!grads->field[field] || !sf_field_stored(field, f->sh_degree)) continue;
        size_t block = (size_t)sf_field_components(field) * SF_LANES, at = first * block;
        if (!seen && !sf_has_momentum(field)) continue; /* nothing would change */
        if (field == SF_FIELD_mean) {
            for (size_t b = first; b < end; b++)
                move_means(job, f->model->params.field[field] + b * block,
                           grads->field[field] + (b - first) * block, b);
            continue;
        }
        sf_optimizer_step(&f->moments, f->ctx->kernels, (sf_value_range){field, at, (end - first) * block},
                          f->model->params.field[field] + at, grads->field[field], &job->step[field],
                          job->key[field]);
    }
}

static void limit_blocks(const update_job *job, size_t first, size_t end) {
    float *log_scale = job->fitter->model->params.field[SF_FIELD_log_scale];
    for (size_t block = first; block < end; block++)
        limit_block(job, log_scale + 3 * SF_LANES * block, block);
}

static void update_some(const update_job *job, const sf_params *grads, size_t first, size_t end) {
    sf_fitter *f = job->fitter;
    size_t last = end * SF_LANES < f->model->count ? end * SF_LANES : f->model->count;
    int seen = memchr(f->workspace.state + first * SF_LANES, SF_SEEN, last - first * SF_LANES) != NULL;
    if (seen) sf_note_units(f, first, end);
    around_mean(f, first, end, sf_mean_open);
    step_blocks(job, grads, first, end, seen);
    if (job->fade > 0 || job->shrink > 0) regularise(job, first * SF_LANES, last);
    limit_blocks(job, first, end);
    if (job->noise > 0) sf_inject_noise(f, job->noise, first, end);
    around_mean(f, first, end, sf_mean_close);
    if (seen) gather_statistics(f, first * SF_LANES, last);
}

/* A step without gradients. */
static void update_without(const update_job *job, size_t first, size_t end) {
    enum { MOST_COMPONENTS = 4 };
    _Alignas(64) float zeros[MOST_COMPONENTS * SF_LANES * SF_GRAD_BLOCKS] = {0};
    sf_params none = {{NULL}};
    for (int field = 0; sf_has_momentum(field); field++) none.field[field] = zeros;
    for (size_t until; first < end; first = until) {
        until = first + SF_GRAD_BLOCKS < end ? first + SF_GRAD_BLOCKS : end;
        update_some(job, &none, first, until);
    }
}

static void update_blocks(void *job_pointer, const sf_params *grads, size_t first, size_t end) {
    const update_job *job = job_pointer;
    if (job->skips && first % SF_PROJECT_BLOCKS == 0) sf_note_in_view(job->fitter, first, grads != NULL);
    if (grads)
        update_some(job, grads, first, end);
    else if (!job->skips)
        update_without(job, first, end);
}

/* Seed of the rounding of moments of a field in this step: a function of seed, step and field, so that it
 * need not be stored. */
static uint32_t rounding_key(const sf_fitter *f, int field) {
    sf_rng rng;
    sf_rng_seed(&rng, (uint64_t)f->options.seed);
    sf_rng_seed(&rng, rng.s[0] + (uint64_t)f->step * SF_FIELD_COUNT + (uint64_t)field);
    return (uint32_t)(rng.s[0] >> 32);
}

sf_status sf_update(sf_fitter *f, double fraction, double *d_camera) {
    const sf_fit_options *o = &f->options;
    double t = (double)(f->step - f->optimizer_restart) + 1;
    update_job job = {.fitter = f,
                      .most_ratio = o->max_aspect > 0 ? (float)log(o->max_aspect) : INFINITY,
                      .most_scale = INFINITY,
                      .fade =
                          (float)(o->reg_opacity * sf_scheduled_rate(f, fraction, SF_FIELD_logit_opacity)),
                      .shrink = (float)(o->reg_scale * sf_scheduled_rate(f, fraction, SF_FIELD_log_scale))};
    if (o->max_scale > 0) job.most_scale = (float)log(o->max_scale);
    if (o->densify == SF_DENSIFY_RELOCATE)
        job.noise = o->relocate_noise * sf_scheduled_rate(f, fraction, SF_FIELD_mean);
    job.skips = sf_skips_out_of_view(f);
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        job.key[field] = rounding_key(f, field);
        double start = sf_has_momentum(field) ? 1 - pow(o->adam_beta1, t) : 1;
        job.step[field] = (sf_adam){
            .rate = (float)(sf_scheduled_rate(f, fraction, field) / start),
            .beta1 = (float)o->adam_beta1,
            .beta2 = (float)o->adam_beta2,
            .v_scale = (float)(1 / (1 - pow(o->adam_beta2, t))),
            .epsilon = (float)o->adam_epsilon,
        };
    }
    sf_status status = sf_stage_project_bwd(&f->workspace, d_camera, update_blocks, &job);
    for (int k = 0; d_camera && k < 3; k++) d_camera[k] = ldexp(d_camera[k], -f->model->unit);
    return status;
}

void sf_update_background(sf_fitter *f, double fraction, const double *gradient) {
    double step[3], rate = sf_cooled_rate(f, fraction, f->options.lr_background * f->options.lr_boost);
    sf_small_moments moments = {f->background_m, f->background_v};
    sf_adam_small(&f->options, rate, f->step + 1, 3, gradient, moments, step);
    for (int k = 0; k < 3; k++) f->background[k] = fmin(fmax(f->background[k] - step[k], 0), 1);
}
