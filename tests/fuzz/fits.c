/* fits.c - targets checkpoint, options: what a fit is gone on with, and made by. */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/memory.h"
#include "fit/options.h"
#include "fuzz.h"

/* The scene is kept from input to input: its context must be known to fuzz_begin first. */
static sf_scene *scene;

static void close_scene(void) { sf_scene_destroy(&scene); }

static sf_scene *open_scene(sf_context *ctx) {
    if (scene) return scene;
    scene = fuzz_scene(ctx);
    atexit(close_scene);
    return scene;
}

/* The fit goes on for two steps, and can be written again. */
static void go_on(sf_context *ctx, sf_fitter *fitter) {
    sf_status status = SF_OK;
    sf_model *model;
    for (int i = 0; i < 2 && !status; i++) status = sf_fitter_step(fitter);
    fuzz_went_well(ctx, status == SF_ERR_END ? SF_OK : status, "");
    FUZZ_CHECK(!sf_fitter_snapshot(fitter, &model), "snapshot: %s", sf_last_error(ctx));
    sf_model_destroy(&model);
    FUZZ_CHECK(!sf_fitter_save(fitter, fuzz_path("again.fit")), "save: %s", sf_last_error(ctx));
}

/* What a fit takes is by its options: what it forecasts must hold. */
int fuzz_checkpoint(const uint8_t *data, size_t size) {
    enum { ALLOWED = 64 << 20 };
    open_scene(fuzz_begin(size, (size_t)1 << 30, 0));
    sf_context *ctx = fuzz_begin(size, ALLOWED, 8);
    const char *path = fuzz_file("in.fit", data, size);
    sf_fit_options options;
    sf_fitter *fitter = NULL;
    int well = fuzz_went_well(ctx, sf_checkpoint_options(ctx, path, &options), path);
    if (well) {
        options.memory = (int64_t)sf_memory_resident() + ALLOWED;
        well = fuzz_went_well(ctx, sf_fitter_load(ctx, scene, path, &options, &fitter), "");
    }
    if (well) go_on(ctx, fitter);
    sf_fitter_destroy(&fitter);
    fuzz_end();
    return well;
}

/* A value that was taken comes back as it was, and is within its range. */
static void set(sf_context *ctx, sf_fit_options *options, const char *name, const char *value) {
    char text[64], again[64];
    if (!fuzz_went_well(ctx, sf_fit_options_set(ctx, options, name, value), "")) return;
    FUZZ_CHECK(!sf_fit_options_get(options, name, text, sizeof text), "%s: cannot be had", name);
    FUZZ_CHECK(!sf_fit_options_set(ctx, options, name, text), "%s: %s is not taken back", name, text);
    sf_fit_options_get(options, name, again, sizeof again);
    FUZZ_CHECK(!strcmp(text, again), "%s: %s became %s", name, text, again);
}

/* Lines "name value". */
int fuzz_options(const uint8_t *data, size_t size) {
    enum { MOST = 4096 };
    char text[MOST + 1];
    sf_context *ctx = fuzz_begin(size, 1 << 16, 1);
    sf_fit_options options = sf_fit_options_default();
    snprintf(text, sizeof text, "%.*s", size < MOST ? (int)size : MOST, (const char *)data);
    for (char *line = text, *next; *line; line = next) {
        next = line + strcspn(line, "\n");
        if (*next) *next++ = 0;
        char *value = strchr(line, ' ');
        if (value) *value++ = 0;
        if (value)
            set(ctx, &options, line, value);
        else
            fuzz_went_well(ctx, sf_fit_options_preset(ctx, line, &options), "preset");
    }
    sf_status status = sf_fit_options_check(ctx, &options);
    int zero = !options.steps && !(options.time_limit > 0);
    FUZZ_CHECK(!status || zero, "check: %s", sf_last_error(ctx));
    fuzz_end();
    return !status;
}
