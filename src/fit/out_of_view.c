/* out_of_view.c - see out_of_view.h. */
#include "out_of_view.h"

#include "../base/pool.h"

int sf_skips_out_of_view(const sf_fitter *f) {
    return f->moments.format == SF_MOMENTS_FLOAT && !(f->moments.mean_kept > 0) &&
           f->options.densify != SF_DENSIFY_RELOCATE;
}

/* The moments fall step by step, as Adam lowers them: one power of beta2 would be rounded otherwise, and the
 * result would depend on how often they are brought up to date. */
static void catch_up(const sf_fitter *f, size_t block) {
    uint32_t *steps = &f->out_of_view.steps[block / SF_PROJECT_BLOCKS];
    size_t blocks = sf_blocks(f->model->count);
    size_t end = block + SF_PROJECT_BLOCKS < blocks ? block + SF_PROJECT_BLOCKS : blocks;
    if (*steps) sf_optimizer_decay_second(&f->moments, block, end, (float)f->options.adam_beta2, *steps);
    *steps = 0;
}

void sf_note_in_view(const sf_fitter *f, size_t block, int in_view) {
    if (in_view)
        catch_up(f, block);
    else
        f->out_of_view.steps[block / SF_PROJECT_BLOCKS]++;
}

static void catch_up_task(void *fitter_pointer, size_t task, int thread) {
    (void)thread;
    const sf_fitter *const *f = fitter_pointer;
    catch_up(*f, task * SF_PROJECT_BLOCKS);
}

void sf_update_second_moments(const sf_fitter *f) {
    size_t blocks = sf_blocks(f->model->count);
    if (!sf_skips_out_of_view(f)) return;
    sf_pool_run(f->ctx->pool, (blocks + SF_PROJECT_BLOCKS - 1) / SF_PROJECT_BLOCKS, catch_up_task, &f);
}
