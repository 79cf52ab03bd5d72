/* snippet.c - the library in one breath, as the README shows it: each call returns an sf_status, which
 * counts. */
#include <splatfit/splatfit.h>

int main(int argc, char **argv) {
    if (argc < 3) return 2;
    /* README: begin */
    sf_context *ctx = NULL;
    sf_scene *scene = NULL;
    sf_fitter *fitter = NULL;
    sf_model *model = NULL;
    sf_status status = sf_context_create(&ctx, NULL);
    if (!status)
        status = sf_scene_load(ctx, argv[1], NULL, &scene); /* or sf_scene_add_view with your pixels */
    if (!status) status = sf_fitter_create(ctx, scene, NULL, NULL, &fitter);
    if (!status) status = sf_fitter_run(fitter, NULL, NULL); /* or call sf_fitter_step in your own loop */
    if (!status) status = sf_fitter_snapshot(fitter, &model);
    if (!status) status = sf_model_save(model, argv[2]);
    /* README: end */
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
    return status != SF_OK;
}
