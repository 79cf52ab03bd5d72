/* test_ranks_compare.c - the quality of a fit's renders, which several ranks measure in bands. */
#include "ranks_fixture.h"

#include <math.h>
#include <string.h>

#include "fit/compare.h"
#include "fit/fitter.h"

enum { MOST = 4, WIDTH = 96, HEIGHT = 72, PIXELS = WIDTH * HEIGHT, VIEWS = 3 };

#define PROJECT "sim:studio?width=96&height=72&frames=9"

/* As the bands say, as the whole picture says, and as validation says. */
typedef struct compare_job {
    sf_quality banded[MOST][VIEWS], whole[MOST][VIEWS];
    double validated[MOST][VIEWS];
    sf_status of_masked[MOST], of_none[MOST];
    double designed[MOST][2];
} compare_job;

/* Views of the scene's first picture: with a mask whose weights rise from left to right and are 0 in the
 * upper third, and wholly masked. */
static sf_status add_masked(sf_scene *scene, uint32_t ids[2]) {
    sf_view_info view;
    float rgb[3 * PIXELS];
    uint8_t bytes[3 * PIXELS], mask[PIXELS];
    sf_status status = sf_scene_get_view(scene, 0, &view);
    if (!status) status = sf_scene_get_pixels(scene, view.id, rgb, NULL);
    for (int i = 0; i < 3 * PIXELS; i++) bytes[i] = (uint8_t)lrintf(255 * rgb[i]);
    for (int i = 0; i < PIXELS; i++)
        mask[i] = (uint8_t)(i / WIDTH < HEIGHT / 3 ? 0 : 255 * (i % WIDTH) / WIDTH);
    sf_pixels pixels = {bytes, 3 * WIDTH, mask};
    if (!status) status = sf_scene_add_view(scene, "masked", &view.camera, &pixels, SF_SPLIT_TEST, &ids[0]);
    memset(mask, 0, sizeof mask);
    if (!status) status = sf_scene_add_view(scene, "nothing", &view.camera, &pixels, SF_SPLIT_TEST, &ids[1]);
    return status;
}

static sf_status measure(sf_context *ctx, sf_scene *scene, sf_fitter *f, uint32_t id, sf_quality *whole) {
    float rgb[3 * PIXELS], truth[3 * PIXELS], weight[PIXELS];
    sf_renderer *renderer = NULL;
    sf_camera camera;
    sf_status status = sf_renderer_create(ctx, &renderer);
    if (!status) status = sf_fitter_get_camera(f, id, &camera);
    if (!status) status = sf_fitter_render(f, &camera, &(sf_image_out){.rgb = rgb});
    if (!status) status = sf_scene_get_pixels(scene, id, truth, weight);
    if (!status) status = sf_compare(renderer, WIDTH, HEIGHT, rgb, truth, weight, whole);
    sf_renderer_destroy(&renderer);
    return status;
}

static sf_status measure_views(sf_context *ctx, sf_scene *scene, sf_fitter *f, int rank, compare_job *job) {
    uint32_t masked[2];
    sf_status status = add_masked(scene, masked);
    for (size_t i = 0; i < VIEWS && !status; i++) {
        sf_view_info info = {.id = masked[0]};
        if (i < VIEWS - 1) status = sf_scene_get_view(scene, i, &info);
        if (!status) status = sf_fitter_compare(f, info.id, &job->banded[rank][i]);
        if (!status) status = measure(ctx, scene, f, info.id, &job->whole[rank][i]);
        sf_view *view = sf_scene_retain_id(scene, info.id);
        if (!status) status = sf_view_psnr(f, view, &job->validated[rank][i]);
        sf_view_release(view);
    }
    sf_quality none;
    job->of_masked[rank] = sf_fitter_compare(f, masked[1], &none);
    job->of_none[rank] = sf_fitter_compare(f, masked[1] + 1000, &none);
    return status;
}

static sf_status run(sf_context *ctx, int rank, void *user) {
    compare_job *job = user;
    sf_scene *scene = NULL;
    sf_fitter *f = NULL;
    sf_fit_options options = sf_fit_options_default();
    options.steps = 1000;
    options.max_gaussians = 3000;
    sf_status status = sf_scene_load(ctx, PROJECT, NULL, &scene);
    if (!status) status = sf_fitter_create(ctx, scene, NULL, &options, &f);
    for (int step = 0; step < 20 && !status; step++) status = sf_fitter_step(f);
    if (f) f->sh_degree = f->model->sh_degree; /* validation draws what is learned by now */
    if (!status && ctx->cluster) job->designed[rank][0] = ctx->cluster->designed;
    if (!status) status = measure_views(ctx, scene, f, rank, job);
    if (!status && ctx->cluster) job->designed[rank][1] = ctx->cluster->designed;
    sf_fitter_destroy(&f);
    sf_scene_destroy(&scene);
    return status;
}

static void test_bands_and_whole_pictures(void **state) {
    (void)state;
    static compare_job job;
    for (int ranks = 1; ranks <= MOST; ranks++) {
        memset(&job, 0, sizeof job);
        assert_int_equal(ranks_run(ranks, 2, run, &job), SF_OK);
        for (int r = 0; r < ranks; r++) {
            for (int i = 0; i < VIEWS; i++) {
                const sf_quality *banded = &job.banded[r][i], *whole = &job.whole[r][i];
                assert_true(banded->psnr > 5 && banded->ssim > 0 && banded->ssim < 1);
                assert_true(fabs(banded->psnr - whole->psnr) < 1e-4);
                assert_true(fabs(banded->ssim - whole->ssim) < 1e-5);
                assert_true(fabs(banded->psnr_corrected - whole->psnr_corrected) < 1e-4);
                assert_true(fabs(job.validated[r][i] - whole->psnr) < 1e-4);
            }
            /* The same bits on all ranks, which decide by them. */
            assert_memory_equal(job.banded[r], job.banded[0], sizeof job.banded[0]);
            assert_memory_equal(job.validated[r], job.validated[0], sizeof job.validated[0]);
            assert_int_equal(job.of_masked[r], SF_ERR_EMPTY);
            assert_int_equal(job.of_none[r], SF_ERR_ARGUMENT);
            assert_true(job.designed[r][0] == job.designed[r][1]); /* of steps alone */
        }
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(test_bands_and_whole_pictures)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
