/* test_ranks_merges.c - tentative merges of a fit on several ranks: each rank's own, judged together. */
#include "ranks_fixture.h"

#include <string.h>

#include "fit/fitter.h"
#include "fit/select_merge.h"

enum { MOST = 3 };

#define PROJECT "sim:studio?width=96&height=72&frames=9"

typedef struct merge_job {
    double attributed[MOST], squares[MOST], holding[MOST];
    size_t merges[MOST], restored[MOST], left[MOST];
    int same[MOST];
} merge_job;

static double attributed_now(const sf_importance *w) {
    double sum = 0;
    for (size_t i = 0; i < w->count; i++) sum += (double)w->attributed[i].now;
    return sum;
}

/* A checkpoint brings each rank its merges back. */
static sf_status reload(sf_context *ctx, sf_scene *scene, const sf_fitter *f, int rank, merge_job *job) {
    sf_fitter *again = NULL;
    sf_status status = sf_fitter_save(f, test_path("merges.checkpoint"));
    (void)sf_cluster_most(ctx->cluster, 0); /* it is whole when rank 0 is here */
    if (!status) status = sf_fitter_load(ctx, scene, test_path("merges.checkpoint"), NULL, &again);
    if (!status) {
        job->restored[rank] = again->merges.count;
        job->same[rank] = again->merges.count == f->merges.count && again->merges.on_ranks &&
                          !memcmp(again->merges.list, f->merges.list, f->merges.count * sizeof(sf_merge));
    }
    sf_fitter_destroy(&again);
    return status;
}

static sf_status merge_pairs(sf_context *ctx, int rank, void *user) {
    merge_job *job = user;
    sf_scene *scene = NULL;
    sf_fitter *f = NULL;
    sf_importance w = {0};
    sf_fit_options options = sf_fit_options_default();
    options.steps = options.densify_every = 1000;
    options.max_gaussians = 3000;
    options.merge = 0.5;
    options.pyramid_levels = 0;
    sf_status status = sf_scene_load(ctx, PROJECT, NULL, &scene);
    if (!status) status = sf_fitter_create(ctx, scene, NULL, &options, &f);
    for (int k = 0; k < 20 && !status; k++) status = sf_fitter_step(f);
    if (!status) status = sf_measure_importance(f, 0, &w);
    if (!status) status = sf_merges_begin(f, &w);
    sf_importance_free(ctx, &w);
    for (int k = 0; k < 3 && !status; k++) status = sf_fitter_step(f);
    if (!status) status = reload(ctx, scene, f, rank, job);
    if (!status) status = sf_measure_importance(f, 0, &w);
    if (!status) {
        job->merges[rank] = f->merges.count;
        job->attributed[rank] = attributed_now(&w);
        job->squares[rank] = w.errors.squares;
        sf_merges_decide(f, &w, 1e9, 0);
        for (size_t i = 0; i < w.count; i++) job->holding[rank] += f->densify.gradient_sum[i] < 0;
        job->left[rank] = f->merges.count + (size_t)f->merges.on_ranks;
    }
    sf_importance_free(ctx, &w);
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    return status;
}

static void test_merges(void **state) {
    (void)state;
    static merge_job job;
    assert_int_equal(ranks_run(MOST, 1, merge_pairs, &job), SF_OK);
    double attributed = 0;
    for (int r = 0; r < MOST; r++) {
        attributed += job.attributed[r];
        assert_true(job.merges[r] > 10 && job.same[r]);
        assert_int_equal(job.restored[r], job.merges[r]);
        assert_true(job.holding[r] == (double)job.merges[r]);
        assert_int_equal(job.left[r], 0);
        assert_true(job.squares[r] == job.squares[0]);
    }
    /* the error of a tile is shared out once among the merged Gaussians of all ranks */
    print_message("merges %zu %zu %zu; attributed %.3f of the error\n", job.merges[0], job.merges[1],
                  job.merges[2], attributed / job.squares[0]);
    assert_true(attributed > 0.5 * job.squares[0] && attributed < 1.0001 * job.squares[0]);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_merges)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
