/* ransac.c - see ransac.h. */
#include "ransac.h"

#include <math.h>
#include <string.h>

#include "../base/rng.h"

enum { BLOCK = 64 }; /* items whose errors are computed at a time */

typedef struct search {
    const sf_ransac_problem *p;
    const sf_ransac_options *o;
    double *squared, *weights; /* [count] */
    sf_ransac_result *best;
} search;

/* The cost of a model, its errors in squared[]; infinite as soon as it is above `most`. */
static double cost_of(const search *s, const double *model, double most) {
    double cost = 0, scale = 1 / (s->o->threshold * s->o->threshold);
    for (size_t begin = 0; begin < s->p->count; begin += BLOCK) {
        size_t end = begin + BLOCK < s->p->count ? begin + BLOCK : s->p->count;
        s->p->errors(s->p->user, model, begin, end, s->squared + begin);
        for (size_t i = begin; i < end; i++) {
            double part = s->squared[i] * scale;
            cost += part < 1 ? part : 1; /* not a number: 1 */
        }
        if (cost >= most) return INFINITY;
    }
    return cost;
}

/* A model whose errors are in squared[] becomes the best one. */
static void take(search *s, const double *model, double cost) {
    double most = s->o->threshold * s->o->threshold;
    memcpy(s->best->model, model, sizeof *model * (size_t)s->p->model_size);
    s->best->cost = cost;
    s->best->count = 0;
    for (size_t i = 0; i < s->p->count; i++) s->best->count += s->squared[i] <= most;
}

/* Refits the best model to its inliers: first to those of a wider threshold, last of its own. */
static void optimize(search *s) {
    static const double widths[] = {2, 1.5, 1, 1, 1};
    for (size_t k = 0; k < sizeof widths / sizeof *widths; k++) {
        double model[SF_MODEL_MOST], most = pow(widths[k] * s->o->threshold, 2), before = s->best->cost;
        memcpy(model, s->best->model, sizeof model);
        if (!isfinite(cost_of(s, model, INFINITY))) return;
        for (size_t i = 0; i < s->p->count; i++) s->weights[i] = s->squared[i] <= most;
        if (!s->p->refit(s->p->user, s->weights, model)) continue;
        double cost = cost_of(s, model, s->best->cost);
        if (cost < s->best->cost) take(s, model, cost);
        if (widths[k] == 1 && !(s->best->cost < 0.999 * before)) break;
    }
}

static void draw_sample(sf_rng *rng, size_t count, int size, uint32_t *sample) {
    for (int i = 0; i < size; i++) {
        int again = 1;
        while (again) {
            sample[i] = (uint32_t)sf_rng_below(rng, count);
            again = 0;
            for (int k = 0; k < i; k++) again |= sample[k] == sample[i];
        }
    }
}

/* Samples to draw until one of inliers alone is among them with the wanted confidence. */
static double samples_needed(const search *s) {
    size_t inliers = s->best->count > s->o->least_count ? s->best->count : s->o->least_count;
    double share = fmin((double)inliers / (double)s->p->count, 1);
    double all = pow(share, s->p->sample_size);
    if (all >= 1) return 1;
    return all > 0 ? log(1 - s->o->confidence) / log1p(-all) : INFINITY;
}

void sf_ransac(const sf_ransac_problem *p, const sf_ransac_options *o, double *scratch, uint8_t *inliers,
               sf_ransac_result *best) {
    search s = {p, o, scratch, scratch + p->count, best};
    double models[SF_MODELS_MOST * SF_MODEL_MOST];
    sf_rng rng;
    *best = (sf_ransac_result){.cost = (double)p->count};
    if (inliers) memset(inliers, 0, p->count);
    if (p->count < (size_t)p->sample_size || p->count < o->least_count) return;
    sf_rng_seed(&rng, o->seed);
    for (; best->samples < o->most; best->samples++) {
        uint32_t sample[SF_SAMPLE_MOST];
        int improved = 0;
        if (best->samples >= o->least && best->samples >= samples_needed(&s)) break;
        draw_sample(&rng, p->count, p->sample_size, sample);
        int found = p->solve(p->user, sample, models);
        for (int k = 0; k < found; k++) {
            const double *model = models + (size_t)(k * p->model_size);
            double cost = cost_of(&s, model, best->cost);
            if (!(cost < best->cost)) continue;
            take(&s, model, cost);
            improved = 1;
        }
        if (improved) optimize(&s);
    }
    if (best->count < o->least_count) best->count = 0;
    if (!best->count || !inliers) return;
    cost_of(&s, best->model, INFINITY);
    for (size_t i = 0; i < p->count; i++) inliers[i] = s.squared[i] <= o->threshold * o->threshold;
}
