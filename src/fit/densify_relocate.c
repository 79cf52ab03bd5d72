/* densify_relocate.c - Gaussians as samples (Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain
 * Monte Carlo"): faint ones move to live ones, and noise lets them look around.
 */
#include "densify_relocate.h"

#include <math.h>
#include <string.h>

#include "../base/hash.h"
#include "opacity.h"
#include "remove.h"
#include "reorder.h"

/* The noise of a Gaussian of opacity o is 1 / (1 + exp(GATE_SLOPE (o - GATE_OPACITY))) of the full one, and
 * none where that is below GATE_LEAST. */
#define GATE_SLOPE   100.0
#define GATE_OPACITY 0.005
#define GATE_LEAST   1e-4

/* N Gaussians of opacity o in one place are 1 - (1 - o g)^N: at the middle the one of before. Along a line
 * its integral is that of sum_k C(N, k) (-1)^(k-1) o^k g^k, and the integral of g^k is that of g over
 * sqrt(k). */
double sf_relocated_opacity(double opacity, uint32_t n, double *shrink) {
    double each = -expm1(log1p(-opacity) / n), term = 1, sum = 0;
    for (uint32_t k = 1; k <= n; k++) {
        term *= each * (double)(n - k + 1) / k;
        sum += (k % 2 ? term : -term) / sqrt(k);
        if (term < 1e-17) break; /* they fall: where they still rise they are larger */
    }
    *shrink = opacity / sum;
    return each;
}

/* Gaussian i becomes one of n of its kind. */
static void correct(sf_fitter *f, size_t i, uint32_t n) {
    const sf_params *p = &f->model->params;
    double opacity = fmin(sf_sigmoid((double)p->field[SF_FIELD_logit_opacity][i]), 0.9999), shrink;
    sf_set_opacity(p, i, (float)sf_relocated_opacity(opacity, n, &shrink));
    for (int k = 0; k < 3; k++) *sf_value(p, SF_FIELD_log_scale, i, k) += (float)log(shrink);
    sf_optimizer_restart(&f->moments, f->model, i);
}

/* Of a place that nobody has come to yet. */
#define NOBODY UINT32_MAX

typedef struct relocation {
    size_t count, places; /* Gaussians before and afterwards */
    size_t moving;
    double *until;         /* [count] sum of the opacities of live ones up to here */
    uint32_t *copies;      /* [count] how many come to this one */
    sf_remap_entry *place; /* [places] */
    uint32_t *where;       /* [places] */
} relocation;

static void free_relocation(sf_context *ctx, relocation *r) {
    sf_free(ctx, r->until);
    sf_free(ctx, r->copies);
    sf_free(ctx, r->place);
    sf_free(ctx, r->where);
}

static sf_status make_relocation(const sf_fitter *f, size_t more, relocation *r) {
    size_t count = f->model->count, places = count + more;
    *r = (relocation){.count = count,
                      .places = places,
                      .until = sf_alloc(f->ctx, count, sizeof *r->until),
                      .copies = sf_calloc(f->ctx, count, sizeof *r->copies),
                      .place = sf_alloc(f->ctx, places, sizeof *r->place),
                      .where = sf_alloc(f->ctx, places, sizeof *r->where)};
    if (r->until && r->copies && r->place && r->where) return SF_OK;
    free_relocation(f->ctx, r);
    return SF_ERR_MEMORY;
}

/* Who lives and who moves. */
static void find_places(const sf_fitter *f, relocation *r) {
    float faintest = sf_min_logit_opacity(f);
    double sum = 0;
    for (size_t i = 0; i < r->places; i++) {
        int lives = i < r->count && sf_is_kept(f, i, faintest);
        if (lives) sum += (double)sf_sigmoidf(f->model->params.field[SF_FIELD_logit_opacity][i]);
        if (i < r->count) r->until[i] = sum;
        r->place[i].from = lives ? (uint32_t)i : NOBODY;
        r->moving += !lives;
    }
}

/* The first Gaussian up to which the opacities sum to more than `sum`: a live one. */
static uint32_t find_source(const relocation *r, double sum) {
    size_t first = 0, end = r->count - 1;
    while (first < end) {
        size_t middle = first + (end - first) / 2;
        if (r->until[middle] > sum)
            end = middle;
        else
            first = middle + 1;
    }
    return (uint32_t)first;
}

static sf_status relocate(sf_fitter *f, relocation *r, double sum) {
    for (size_t k = 0; k < r->places; k++) {
        sf_remap_entry *place = &r->place[k];
        if (place->from == NOBODY) {
            place->from = find_source(r, sum * sf_rng_uniform(&f->rng));
            r->copies[place->from]++;
        }
        place->degree = (uint8_t)sf_degree_of(f->model, place->from);
    }
    sf_status status = sf_reorder(f, r->place, r->places, r->where);
    for (size_t k = 0; k < r->places && !status; k++) {
        uint32_t copies = r->copies[r->place[k].from];
        if (copies) correct(f, r->where[k], copies + 1);
    }
    return status;
}

sf_status sf_relocate(sf_fitter *f, size_t more) {
    relocation r;
    if (!f->model->count) return SF_OK;
    sf_status status = make_relocation(f, more, &r);
    if (status) return status;
    find_places(f, &r);
    double sum = r.until[r.count - 1];
    if (sum > 0 && r.moving) status = relocate(f, &r, sum);
    free_relocation(f->ctx, &r);
    return status;
}

/* A Gaussian's noise in a step: of no other draw, so that no order matters. */
static sf_rng noise_of(const sf_fitter *f, size_t i) {
    const uint64_t counter[2] = {(uint64_t)f->step, i};
    sf_rng rng;
    sf_rng_seed(&rng, sf_hash((uint64_t)f->options.seed, counter, sizeof counter));
    return rng;
}

/* Covariance times a standard normal vector: along each axis a normal number times the square scale. */
static void disturb(const sf_fitter *f, size_t i, double strength) {
    const sf_params *p = &f->model->params;
    sf_rng rng = noise_of(f, i);
    float move[3] = {0, 0, 0};
    for (int axis = 0; axis < 3; axis++) {
        float direction[3];
        double scale = exp((double)*sf_value(p, SF_FIELD_log_scale, i, axis));
        float step = (float)(strength * scale * scale * sf_rng_normal(&rng));
        sf_axis_of(p, i, axis, direction);
        for (int k = 0; k < 3; k++) move[k] += step * direction[k];
    }
    for (int k = 0; k < 3; k++)
        if (!isfinite(*sf_value(p, SF_FIELD_mean, i, k) + move[k])) return;
    for (int k = 0; k < 3; k++) *sf_value(p, SF_FIELD_mean, i, k) += move[k];
}

void sf_inject_noise(sf_fitter *f, double strength, size_t first, size_t end) {
    const float *logit = f->model->params.field[SF_FIELD_logit_opacity];
    size_t last = end * SF_LANES < f->model->count ? end * SF_LANES : f->model->count;
    for (size_t i = first * SF_LANES; i < last; i++) {
        double gate = 1 / (1 + exp(GATE_SLOPE * ((double)sf_sigmoidf(logit[i]) - GATE_OPACITY)));
        if (gate >= GATE_LEAST) disturb(f, i, gate * strength);
    }
}
