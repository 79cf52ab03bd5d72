/* options.c - the options that several subcommands take, and what they say. */
#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

const arg_option common_options[] = {
    {"threads", 0, "N",
     "number of threads; default: as many as the affinity mask and the control group allow"},
    {"cores", 0, "LIST", "run on these processors only, for example 0-2,5; the number of threads follows"},
    {"isa", 0, "NAME", "kernel level (see info --cpu); default: the best one here"},
    {"quiet", 'q', NULL, "print errors only"},
    {"help", 'h', NULL, "print this"},
    {0},
};

const arg_option load_options[] = {
    {"images", 0, "NAME", "folder of the pictures in the project, for example images_4"},
    {"downscale", 0, "N", "box-average the pictures by N, 1..64 (1)"},
    {"hold-out", 0, "N", "every N-th view in name order is held out and only evaluated; 0: none (8)"},
    {"test-list", 0, "FILE", "hold out the pictures named in FILE, one a line, instead"},
    {"sub-model", 0, "N", "of several models, COLMAP's sparse/N or OpenSfM's N-th; default: the largest"},
    {"masks", 0, "DIR",
     "folder of masks, in which black is ignored; default: masks in the project, if it exists"},
    {"no-masks", 0, NULL, "ignore all masks"},
    {"alpha", 0, "NAME",
     "alpha channels: mask (transparent pixels are ignored), blend (over --background), ignore, auto: blend "
     "for Blender's transforms_train.json, else mask (auto)"},
    {0},
};

const arg_option render_options[] = {
    {"split", 0, "test|train|all", "which views: test (held out), train or all"},
    {"background", 0, "COLOR", "black, white or R,G,B in 0..1 (black)"},
    {"near-plane", 0, "X",
     "cull Gaussians nearer than X, world units; default: chosen for each view, as in a fit"},
    {0},
};

const arg_option model_options[] = {
    {"spz-frame", 0, "own|rub",
     "axes of a .spz: own, as the file states or else as in a .ply; rub (right, up, back): y and z are "
     "negated when reading or writing (own)"},
    {0},
};

const arg_option world_options[] = {
    {"world", 0, NULL,
     "write coordinates of the world, as floats, where the model's are relative to an origin near it"},
    {0},
};

const arg_option compensation_options[] = {
    {"antialiased", 0, "yes|no",
     "whether the model was fitted with opacity compensation; overrides its file (as the file states)"},
    {0},
};

/* Which of two words an option has: 0 the first, which goes for none, 1 the second. 0 or an exit code. */
static int read_word(const args *a, const char *name, const char *first, const char *second, int *is_second) {
    const char *text = args_value(a, name);
    *is_second = text && !strcmp(text, second);
    if (!text || *is_second || !strcmp(text, first)) return 0;
    args_error(a->command, "--%s: \"%s\" is neither %s nor %s", name, text, first, second);
    return EXIT_USAGE;
}

static int has_table(const args *a, const arg_option *wanted) {
    const arg_option *const *table = a->command->tables;
    while (*table && *table != wanted) table++;
    return *table != NULL;
}

int app_model_options(const args *a, sf_model_file_options *options) {
    int is_rub, is_no, error = read_word(a, "spz-frame", "own", "rub", &is_rub);
    if (!error && has_table(a, compensation_options))
        error = read_word(a, "antialiased", "yes", "no", &is_no);
    options->world = has_table(a, world_options) && args_value(a, "world");
    if (!error) options->spz_frame = is_rub ? SF_SPZ_FRAME_RUB : SF_SPZ_FRAME_OWN;
    return error;
}

static sf_model_file_options options_to_save(const args *a) {
    sf_model_file_options options = sf_model_file_options_default();
    options.world = args_value(a, "world") != NULL;
    return options;
}

sf_status app_save_model(const args *a, const sf_model *model, const char *path) {
    sf_model_file_options options = options_to_save(a);
    return sf_model_save_as(model, path, &options);
}

sf_status app_save_fitted(const args *a, const sf_fitter *fitter, const char *path) {
    sf_model_file_options options = options_to_save(a);
    return sf_fitter_save_model(fitter, path, &options);
}

int app_load_model(const args *a, sf_context *ctx, const char *path, sf_model **model) {
    return app_load_part(a, ctx, path, 0, 1, model);
}

int app_load_shown(const args *a, sf_context *ctx, const char *path, sf_model **model) {
    int error = app_load_model(a, ctx, path, model);
    if (!error && !sf_model_count(*model) && !args_value(a, "quiet"))
        fprintf(stderr, "warning: %s: holds no Gaussians: only the background is seen\n", path);
    return error;
}

int app_load_part(const args *a, sf_context *ctx, const char *path, int part, int parts, sf_model **model) {
    sf_model_file_options options = sf_model_file_options_default();
    const char *antialiased = has_table(a, compensation_options) ? args_value(a, "antialiased") : NULL;
    int error = app_model_options(a, &options);
    options.part = part, options.parts = parts;
    if (!error && sf_model_load_as(ctx, path, &options, model)) error = app_fail(a, ctx);
    if (!error && antialiased) sf_model_set_antialiased(*model, !strcmp(antialiased, "yes"));
    return error;
}

/* What is blended stands before the background that is fitted or rendered; one that a fit draws or finds is
 * black there. */
static int alpha_options(const args *a, sf_load_options *options) {
    static const char *const names[] = {"auto", "mask", "blend", "ignore"};
    const char *alpha = args_value(a, "alpha"), *background = args_value(a, "background");
    float color[3];
    if (background && app_color(background, color)) memcpy(options->background, color, sizeof color);
    for (int i = 0; alpha && i < 4; i++) {
        if (strcmp(alpha, names[i]) != 0) continue;
        options->alpha = (sf_alpha)i;
        return 0;
    }
    if (!alpha) return 0;
    args_error(a->command, "--alpha: \"%s\" is none of auto, mask, blend, ignore", alpha);
    return EXIT_USAGE;
}

static int read_load_options(const args *a, sf_load_options *options) {
    *options = sf_load_options_default();
    options->masks = args_value(a, "masks");
    options->no_masks = args_value(a, "no-masks") != NULL;
    options->images = args_value(a, "images");
    options->test_list = args_value(a, "test-list");
    int error = args_int(a, "downscale", 1, 64, &options->downscale);
    if (!error) error = args_int(a, "hold-out", 0, 1000000, &options->hold_out);
    if (!error) error = args_int(a, "sub-model", 0, 1000000, &options->sub_model);
    return error ? error : alpha_options(a, options);
}

int app_load_within(const args *a, sf_context *ctx, const char *path, int64_t memory, sf_scene **scene) {
    sf_load_options options;
    int error = read_load_options(a, &options);
    options.memory = memory;
    return error ? error : app_load_caught(a, ctx, path, &options, scene);
}

int app_load(const args *a, sf_context *ctx, const char *path, sf_scene **scene) {
    return app_load_within(a, ctx, path, 0, scene);
}

int app_load_cameras(const args *a, sf_context *ctx, const char *path, sf_scene **scene) {
    sf_load_options options;
    int error = read_load_options(a, &options);
    options.no_pixels = 1;
    return error ? error : app_load_caught(a, ctx, path, &options, scene);
}

int app_color(const char *text, float color[3]) {
    if (!strcmp(text, "black") || !strcmp(text, "white")) {
        for (int k = 0; k < 3; k++) color[k] = text[0] == 'w';
        return 1;
    }
    for (int k = 0; k < 3; k++) {
        char *end;
        double value = strtod(text, &end);
        if (end == text || *end != (k < 2 ? ',' : 0) || !(value >= 0 && value <= 1)) return 0;
        color[k] = (float)value;
        text = end + 1;
    }
    return 1;
}

int app_render_options(const args *a, sf_render_options *options) {
    *options = sf_render_options_default();
    const char *near_plane = args_value(a, "near-plane"), *background = args_value(a, "background");
    if (background && !app_color(background, options->background)) {
        args_error(a->command, "--background: \"%s\" is neither black, white nor R,G,B in 0..1", background);
        return EXIT_USAGE;
    }
    if (!near_plane) return 0;
    char *end;
    double value = strtod(near_plane, &end);
    if (end == near_plane || *end || !(value > 0 && isfinite(value))) {
        args_error(a->command, "--near-plane: \"%s\" is not a number above 0", near_plane);
        return EXIT_USAGE;
    }
    options->near_plane = (float)value;
    return 0;
}

static const char *split_or(const args *a, const char *otherwise) {
    const char *split = args_value(a, "split");
    return split ? split : otherwise;
}

int app_refuse_load_options(const args *a, const char *what) {
    for (const arg_option *o = load_options; o->name; o++) {
        if (!args_value(a, o->name)) continue;
        args_error(a->command, "--%s: goes with a project, not with %s", o->name, what);
        return EXIT_USAGE;
    }
    return 0;
}

int app_split_check(const args *a) {
    const char *split = split_or(a, "all");
    if (!strcmp(split, "test") || !strcmp(split, "train") || !strcmp(split, "all")) return 0;
    args_error(a->command, "--split: \"%s\" is none of test, train, all", split);
    return EXIT_USAGE;
}

int app_split_wants(const args *a, const char *otherwise, sf_split split) {
    const char *wanted = split_or(a, otherwise);
    return !strcmp(wanted, "all") || !strcmp(wanted, split == SF_SPLIT_TEST ? "test" : "train");
}

int app_lens(const args *a, sf_context *ctx, const sf_source *source, sf_lens *lens) {
    const char *path = args_value(a, "lens");
    sf_calibration known;
    sf_source_info info;
    if (!path) return 0;
    if (sf_calibration_load(ctx, path, &known)) return app_fail(a, ctx);
    sf_source_describe(source, &info);
    if (known.width && (known.width != info.width || known.height != info.height)) {
        return args_error(a->command,
                          "%s: size: %d x %d is not the source's %d x %d: give the lens of this size, or "
                          "?size= of the source",
                          path, (int)known.width, (int)known.height, (int)info.width, (int)info.height);
    }
    *lens = known.lens;
    return 0;
}
