/* remove.c - removes Gaussians that are marked, too faint or not finite. */
#include "remove.h"

#include <math.h>

#include "../base/pool.h"
#include "../scene/gaussian_math.h"
#include "reorder.h"
#include "select_merge.h"

float sf_min_logit_opacity(const sf_fitter *f) {
    double opacity = f->options.prune_opacity;
    return opacity > 0 ? sf_logitf(fminf((float)opacity, 0.999f)) : -INFINITY;
}

int sf_is_kept(const sf_fitter *f, size_t i, float min_logit) {
    const sf_params *p = &f->model->params;
    for (int field = 0; field < SF_FIELD_COUNT; field++)
        for (int c = 0; i < f->model->banded[sf_field_band(field)] && c < sf_field_components(field); c++)
            if (!isfinite(*sf_value(p, field, i, c))) return 0;
    return p->field[SF_FIELD_logit_opacity][i] >= min_logit && !(f->densify.gradient_sum[i] < 0);
}

enum { TASK_BLOCKS = 256 };

typedef struct finite_job {
    const sf_fitter *fitter;
    uint8_t *finite; /* [whole blocks] */
} finite_job;

/* Whether all values of each Gaussian are finite. Lanes that lack a band hold 0. Without branches, so that
 * compilers vectorise it. */
static void finite_task(void *job_pointer, size_t task, int thread) {
    (void)thread;
    const finite_job *job = job_pointer;
    const sf_model *m = job->fitter->model;
    size_t end =
        (task + 1) * TASK_BLOCKS < sf_blocks(m->count) ? (task + 1) * TASK_BLOCKS : sf_blocks(m->count);
    for (size_t b = task * TASK_BLOCKS; b < end; b++) {
        uint32_t most[SF_LANES] = {0};
        for (int field = 0; field < SF_FIELD_COUNT; field++) {
            int n = sf_field_components(field);
            if (b >= sf_blocks(m->banded[sf_field_band(field)])) continue;
            const float *block = m->params.field[field] + b * SF_LANES * (size_t)n;
            for (int c = 0; c < n; c++)
                for (int i = 0; i < SF_LANES; i++) {
                    uint32_t size = sf_bits_of(block[c * SF_LANES + i]) & 0x7fffffffu;
                    most[i] = size > most[i] ? size : most[i];
                }
        }
        for (size_t i = 0; i < SF_LANES; i++) job->finite[b * SF_LANES + i] = most[i] < 0x7f800000u;
    }
}

/* The Gaussians whose values are all finite; freed by the caller. */
static uint8_t *find_finite(const sf_fitter *f) {
    size_t blocks = sf_blocks(f->model->count);
    finite_job job = {f, sf_alloc(f->ctx, blocks + 1, SF_LANES)};
    if (job.finite) sf_pool_run(f->ctx->pool, (blocks + TASK_BLOCKS - 1) / TASK_BLOCKS, finite_task, &job);
    return job.finite;
}

static sf_status list_kept(const sf_fitter *f, float min_logit, sf_remap_entry *entries, size_t *kept) {
    const float *logit = f->model->params.field[SF_FIELD_logit_opacity];
    uint8_t *finite = find_finite(f);
    *kept = 0;
    if (!finite) return SF_ERR_MEMORY;
    for (size_t i = 0; i < f->model->count; i++)
        if (finite[i] && logit[i] >= min_logit && !(f->densify.gradient_sum[i] < 0))
            entries[(*kept)++] = (sf_remap_entry){(uint32_t)i, (uint8_t)sf_degree_of(f->model, i)};
    sf_free(f->ctx, finite);
    return SF_OK;
}

sf_status sf_list_kept(const sf_fitter *f, sf_remap_entry *entries, size_t *kept) {
    return list_kept(f, sf_min_logit_opacity(f), entries, kept);
}

/* Removes the Gaussians that sf_is_kept does not keep. degrees: NULL or [count], new SH degrees. */
static sf_status remove_below(sf_fitter *f, float min_logit, const uint8_t *degrees) {
    size_t kept = 0, count = f->model->count, lowered = 0;
    sf_remap_entry *entries = sf_alloc(f->ctx, count, sizeof *entries);
    if (!entries) return SF_ERR_MEMORY;
    sf_status status = list_kept(f, min_logit, entries, &kept);
    for (size_t k = 0; k < kept && degrees; k++) {
        uint8_t degree = degrees[entries[k].from];
        if (degree < entries[k].degree) entries[k].degree = degree, lowered++;
    }
    if (!status && (kept < count || lowered)) status = sf_reorder(f, entries, kept, NULL);
    sf_free(f->ctx, entries);
    return status;
}

sf_status sf_remove_marked(sf_fitter *f, const uint8_t *degrees) {
    return remove_below(f, sf_min_logit_opacity(f), degrees);
}

sf_status sf_remove_not_finite(sf_fitter *f) {
    size_t had = f->model->count, finite = 0;
    while (finite < had && sf_is_kept(f, finite, -INFINITY)) finite++;
    if (finite == had) return SF_OK;
    sf_merges_undo_all(f); /* the merges refer to indices, which change */
    sf_status status = remove_below(f, -INFINITY, NULL);
    if (f->model->count < had)
        sf_log(f->ctx, SF_LOG_WARNING,
               "step %lld: removed %zu of %zu Gaussians with values that are not finite", (long long)f->step,
               had - f->model->count, had);
    return status;
}
