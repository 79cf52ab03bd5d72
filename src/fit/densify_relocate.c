/* densify_relocate.c - Gaussians as samples (Kheradmand et al. 2024, "3D Gaussian Splatting as Markov Chain
 * Monte Carlo"): faint Gaussians move to live ones, and noise explores.
 */
#include "densify_relocate.h"

#include <math.h>
#include <string.h>

#include "../base/hash.h"
#include "local_units.h"
#include "opacity.h"
#include "ranks.h"
#include "remove.h"
#include "reorder.h"

/* The noise of a Gaussian of opacity o is scaled by 1 / (1 + exp(GATE_SLOPE (o - GATE_OPACITY))), and is 0
 * where that is below GATE_LEAST. */
#define GATE_SLOPE   100.0
#define GATE_OPACITY 0.005
#define GATE_LEAST   1e-4

/* N Gaussians of opacity o at one place render as 1 - (1 - o g)^N, g: the Gaussian function. o keeps the
 * value at the centre. The integral along a line is that of sum_k C(N, k) (-1)^(k-1) o^k g^k, and the
 * integral of g^k is that of g over sqrt(k). */
double sf_relocated_opacity(double opacity, uint32_t n, double *shrink) {
    double each = -expm1(log1p(-opacity) / n), term = 1, sum = 0;
    for (uint32_t k = 1; k <= n; k++) {
        term *= each * (double)(n - k + 1) / k;
        sum += (k % 2 ? term : -term) / sqrt(k);
        if (term < 1e-17) break; /* terms fall from here on: rising ones are larger than this */
    }
    *shrink = opacity / sum;
    return each;
}

/* Sets opacity and scales of Gaussian i, one of n copies. */
static void share_opacity(sf_fitter *f, size_t i, uint32_t n) {
    const sf_params *p = &f->model->params;
    double opacity = fmin(sf_sigmoid((double)p->field[SF_FIELD_logit_opacity][i]), 0.9999), shrink;
    sf_set_opacity(p, i, (float)sf_relocated_opacity(opacity, n, &shrink));
    for (int k = 0; k < 3; k++) *sf_value(p, SF_FIELD_log_scale, i, k) += (float)log(shrink);
    sf_optimizer_restart(&f->moments, f->model, i);
}

/* The source of an entry that is not drawn yet. */
#define NOT_DRAWN UINT32_MAX

typedef struct relocation {
    size_t count, entries; /* count: Gaussians before, entries: afterwards */
    size_t drawn;          /* entries whose source is drawn */
    double *cumulative;    /* [count] cumulative sum of the opacities of live Gaussians */
    uint32_t *copies;      /* [count] how many are relocated to this one */
    sf_remap_entry *entry; /* [entries] */
    uint32_t *moved_to;    /* [entries] */
} relocation;

static void free_relocation(sf_context *ctx, relocation *r) {
    sf_free(ctx, r->cumulative);
    sf_free(ctx, r->copies);
    sf_free(ctx, r->entry);
    sf_free(ctx, r->moved_to);
}

static sf_status make_relocation(const sf_fitter *f, size_t more, relocation *r) {
    size_t count = f->model->count, entries = count + more;
    *r = (relocation){.count = count,
                      .entries = entries,
                      .cumulative = sf_alloc(f->ctx, count, sizeof *r->cumulative),
                      .copies = sf_calloc(f->ctx, count, sizeof *r->copies),
                      .entry = sf_alloc(f->ctx, entries, sizeof *r->entry),
                      .moved_to = sf_alloc(f->ctx, entries, sizeof *r->moved_to)};
    if (r->cumulative && r->copies && r->entry && r->moved_to) return SF_OK;
    free_relocation(f->ctx, r);
    return SF_ERR_MEMORY;
}

/* Marks the entries to draw: faint Gaussians and new ones. Sums the opacities of the others. */
static void mark_entries(const sf_fitter *f, relocation *r) {
    float faintest = sf_min_logit_opacity(f);
    double sum = 0;
    for (size_t i = 0; i < r->entries; i++) {
        int lives = i < r->count && sf_is_kept(f, i, faintest);
        if (lives) sum += (double)sf_sigmoidf(f->model->params.field[SF_FIELD_logit_opacity][i]);
        if (i < r->count) r->cumulative[i] = sum;
        r->entry[i].from = lives ? (uint32_t)i : NOT_DRAWN;
        r->drawn += !lives;
    }
}

/* The first Gaussian whose cumulative sum is above `sum`: a live one. */
static uint32_t find_source(const relocation *r, double sum) {
    size_t first = 0, end = r->count - 1;
    while (first < end) {
        size_t middle = first + (end - first) / 2;
        if (r->cumulative[middle] > sum)
            end = middle;
        else
            first = middle + 1;
    }
    return (uint32_t)first;
}

static sf_status relocate(sf_fitter *f, relocation *r, double sum) {
    sf_rng *rng = sf_rng_of_rank(f);
    for (size_t k = 0; k < r->entries; k++) {
        sf_remap_entry *entry = &r->entry[k];
        if (entry->from == NOT_DRAWN) {
            entry->from = find_source(r, sum * sf_rng_uniform(rng));
            r->copies[entry->from]++;
        }
        entry->degree = (uint8_t)sf_degree_of(f->model, entry->from);
    }
    sf_status status = sf_reorder(f, r->entry, r->entries, r->moved_to);
    for (size_t k = 0; k < r->entries && !status; k++) {
        uint32_t copies = r->copies[r->entry[k].from];
        if (copies) share_opacity(f, r->moved_to[k], copies + 1);
    }
    return status;
}

sf_status sf_relocate(sf_fitter *f, size_t more) {
    relocation r;
    if (!f->model->count) return SF_OK;
    sf_status status = make_relocation(f, more, &r);
    if (status) return status;
    mark_entries(f, &r);
    double sum = r.cumulative[r.count - 1];
    if (sum > 0 && r.drawn) status = relocate(f, &r, sum);
    free_relocation(f->ctx, &r);
    return status;
}

/* The generator of a Gaussian's noise in a step, from seed, step and index: independent of the order of
 * threads. */
static sf_rng noise_of(const sf_fitter *f, size_t i) {
    const uint64_t counter[2] = {(uint64_t)f->step, sf_place_of(f, i)};
    sf_rng rng;
    sf_rng_seed(&rng, sf_hash((uint64_t)f->options.seed, counter, sizeof counter));
    return rng;
}

/* Adds covariance times a standard normal vector to the mean: along each axis a normal number times the
 * squared scale. */
static void inject_noise(const sf_fitter *f, size_t i, double strength) {
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
        double unit = (double)sf_unit_of(f, i);
        if (gate >= GATE_LEAST && unit > 0) inject_noise(f, i, gate * strength / unit);
    }
}
