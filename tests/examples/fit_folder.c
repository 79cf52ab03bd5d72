/* fit_folder.c - fits a model to a project and writes it: fit_folder PROJECT MODEL [STEPS]. */
#include <stdio.h>
#include <stdlib.h>

#include <splatfit/splatfit.h>

static void show(void *user, const sf_fit_progress *p) {
    (void)user;
    if (p->step % 100 == 0) printf("step %lld, %zu Gaussians\n", (long long)p->step, p->gaussians);
}

/* From PROJECT to MODEL. What fails stops the rest, and is told by the context. */
static sf_status fit(sf_context *ctx, const char *project, const char *path, const sf_fit_options *options) {
    sf_scene *scene = NULL;
    sf_fitter *fitter = NULL;
    sf_model *model = NULL;
    sf_status status = sf_scene_load(ctx, project, NULL, &scene);
    if (!status) status = sf_fitter_create(ctx, scene, NULL, options, &fitter);
    if (!status) status = sf_fitter_run(fitter, show, NULL);
    if (!status) status = sf_fitter_snapshot(fitter, &model);
    if (!status) status = sf_model_save(model, path);
    sf_model_destroy(&model);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    return status;
}

int main(int argc, char **argv) {
    sf_context *ctx;
    if (argc < 3) {
        fprintf(stderr, "usage: fit_folder PROJECT MODEL [STEPS]\n");
        return 2;
    }
    sf_status status = sf_context_create(&ctx, NULL);
    if (status) {
        fprintf(stderr, "fit_folder: %s\n", sf_status_text(status));
        return 1;
    }
    sf_fit_options options = sf_fit_options_default();
    if (argc > 3) status = sf_fit_options_set(ctx, &options, "steps", argv[3]);
    if (!status) status = fit(ctx, argv[1], argv[2], &options);
    if (status) fprintf(stderr, "fit_folder: %s\n", sf_last_error(ctx));
    sf_context_destroy(&ctx);
    return status != SF_OK;
}
