/* feed_frames.c - fits pictures that are in memory, with their cameras, step by step: feed_frames MODEL
 * [STEPS].
 *
 * The pictures here come from the simulated camera; with sf_scene_add_view they could come from anywhere.
 */
#include <stdio.h>
#include <stdlib.h>

#include <splatfit/splatfit.h>

/* A frame as a view: its pixels are copied, so it can be given back right after. */
static sf_status add_frame(sf_scene *scene, const sf_frame *frame) {
    const sf_pixels pixels = {.rgb = frame->plane[0], .stride = frame->stride[0]};
    if (frame->format != SF_PIXEL_RGB24 || !frame->has_camera) return SF_ERR_UNSUPPORTED;
    return sf_scene_add_view(scene, NULL, &frame->camera, &pixels, SF_SPLIT_TRAIN, NULL);
}

static sf_status add_frames(sf_context *ctx, sf_scene *scene) {
    sf_source *source = NULL;
    sf_frame frame;
    sf_status status = sf_source_open(ctx, "sim:studio?width=128&height=96&frames=24", &source);
    while (!status && !(status = sf_source_next(source, -1, &frame))) {
        status = add_frame(scene, &frame);
        sf_source_release(source, &frame);
    }
    sf_source_close(&source);
    return status == SF_ERR_END ? SF_OK : status;
}

/* A loop of one's own: between two steps views may come and go, and the model may be looked at. */
static sf_status fit(sf_context *ctx, sf_scene *scene, int steps, const char *path) {
    sf_fit_options options = sf_fit_options_default();
    sf_fitter *fitter = NULL;
    sf_model *model = NULL;
    sf_fit_progress progress = {0};
    options.steps = steps;
    sf_status status = sf_fitter_create(ctx, scene, NULL, &options, &fitter);
    while (!status) status = sf_fitter_step(fitter);
    if (status == SF_ERR_END) status = sf_fitter_snapshot(fitter, &model);
    if (!status) status = sf_model_save(model, path);
    if (fitter) sf_fitter_get_progress(fitter, &progress);
    if (!status) printf("loss %.4f, %zu Gaussians\n", progress.loss, progress.gaussians);
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    return status;
}

int main(int argc, char **argv) {
    sf_context *ctx = NULL;
    sf_scene *scene = NULL;
    if (argc < 2) {
        fprintf(stderr, "usage: feed_frames MODEL [STEPS]\n");
        return 2;
    }
    sf_status status = sf_context_create(&ctx, NULL);
    if (!status) status = sf_scene_create(ctx, &scene);
    if (!status) status = add_frames(ctx, scene);
    if (!status) status = fit(ctx, scene, argc > 2 ? atoi(argv[2]) : 300, argv[1]);
    if (status) fprintf(stderr, "feed_frames: %s\n", ctx ? sf_last_error(ctx) : sf_status_text(status));
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return status != SF_OK;
}
