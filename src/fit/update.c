/* update.c - one step of the optimiser. */
#include "fitter.h"

#include <math.h>

typedef struct update_job {
    sf_fitter *fitter;
    sf_adam step[SF_FIELD_COUNT];
    float most_ratio; /* logarithm of the greatest aspect; 0: no limit */
} update_job;

/* The longest axis at most `aspect` times the middle one: needles fit one view and hurt the others. */
static void limit_aspect(float *log_scale, size_t i, float most_ratio) {
    float s[3];
    for (int k = 0; k < 3; k++) s[k] = log_scale[sf_at(i, 3, k)];
    int longest = s[0] >= s[1] ? (s[0] >= s[2] ? 0 : 2) : (s[1] >= s[2] ? 1 : 2);
    float middle = fmaxf(s[(longest + 1) % 3], s[(longest + 2) % 3]);
    if (s[longest] > middle + most_ratio) log_scale[sf_at(i, 3, longest)] = middle + most_ratio;
}

/* Within what a model's file may hold. */
static void limit_scale(float *log_scale, size_t i) {
    for (int k = 0; k < 3; k++) {
        float *s = &log_scale[sf_at(i, 3, k)];
        *s = fminf(fmaxf(*s, -SF_LOG_SCALE_MOST), SF_LOG_SCALE_MOST);
    }
}

static void gather_statistics(sf_fitter *f, size_t i) {
    if (f->workspace.state[i] != SF_SEEN) return;
    f->screen_sum[i] += (double)f->workspace.screen[i];
    f->screen_seen[i]++;
}

static void update_blocks(void *job_pointer, const sf_params *grads, size_t first, size_t end) {
    const update_job *job = job_pointer;
    sf_fitter *f = job->fitter;
    for (int field = 0; field < SF_FIELD_COUNT; field++) {
        if (!sf_field_stored(field, f->sh_degree)) continue; /* a band not in use has no gradient */
        size_t block = (size_t)sf_field_components(field) * SF_LANES, at = first * block;
        f->ctx->kernels->adam(f->model->params.field[field] + at, grads->field[field], f->m.field[field] + at,
                              f->v.field[field] + at, (end - first) * block, &job->step[field]);
    }
    float *log_scale = f->model->params.field[SF_FIELD_log_scale];
    for (size_t i = first * SF_LANES; i < end * SF_LANES && i < f->model->count; i++) {
        limit_scale(log_scale, i);
        if (job->most_ratio > 0) limit_aspect(log_scale, i, job->most_ratio);
        gather_statistics(f, i);
    }
}

sf_status sf_update(sf_fitter *f, double fraction) {
    const sf_fit_options *o = &f->options;
    double t = (double)f->step + 1;
    update_job job = {.fitter = f, .most_ratio = o->max_aspect > 0 ? (float)log(o->max_aspect) : 0.0f};
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        job.step[field] = (sf_adam){
            .rate = (float)(sf_scheduled_rate(f, fraction, field) / (1 - pow(o->adam_beta1, t))),
            .beta1 = (float)o->adam_beta1,
            .beta2 = (float)o->adam_beta2,
            .v_scale = (float)(1 / (1 - pow(o->adam_beta2, t))),
            .epsilon = (float)o->adam_epsilon,
        };
    return sf_stage_project_bwd(&f->workspace, NULL, update_blocks, &job);
}

void sf_update_background(sf_fitter *f, const double *gradient) {
    const sf_fit_options *o = &f->options;
    double t = (double)f->step + 1;
    for (int k = 0; k < 3; k++) {
        if (!isfinite(gradient[k])) continue;
        double *m = &f->background_m[k], *v = &f->background_v[k];
        *m = o->adam_beta1 * *m + (1 - o->adam_beta1) * gradient[k];
        *v = o->adam_beta2 * *v + (1 - o->adam_beta2) * gradient[k] * gradient[k];
        double rate = o->lr_background / (1 - pow(o->adam_beta1, t));
        double moved =
            f->background[k] - rate * *m / (sqrt(*v / (1 - pow(o->adam_beta2, t))) + o->adam_epsilon);
        f->background[k] = fmin(fmax(moved, 0), 1);
    }
}
