/* prune.c - splatfit prune: a model taken down to what its scene needs. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "training_log.h"

static const arg_option own_options[] = {
    {"output", 'o', "FILE", "the model to write"},
    {"loss", 0, "DB", "how much the PSNR of the training views may fall, for example 0.1dB (0.1)"},
    {"to", 0, "N", "instead, leave exactly N Gaussians, whatever the PSNR, with their SH bands"},
    {"random", 0, NULL, "remove Gaussians at random, as a baseline for comparisons"},
    {"keep-sh", 0, NULL, "remove no bands of the spherical harmonics"},
    {"refit", 0, "STEPS",
     "try deeper cuts, fit for STEPS steps after each, and keep a cut if the PSNR recovers (0)"},
    {"seed", 0, "N", "seed of --random and --refit (1)"},
    {"log", 0, "FILE", "write the figures before and after as JSON, for splatfit chart"},
    {"label", 0, "TEXT", "name of this run in charts, for the log"},
    {"background", 0, "COLOR", "black, white or R,G,B in 0..1 (black)"},
    {"near-plane", 0, "X", "cull Gaussians nearer than X, world units; default: as a fit of the project"},
    {0},
};

/* A model and its figures. */
typedef struct figures {
    size_t gaussians;
    json_t *facts; /* as app_log_model says */
    evaluation train, test;
} figures;

typedef struct prune_run {
    const args *a;
    sf_context *ctx;
    sf_scene *scene;
    sf_model *model, *pruned;
    sf_prune_options options;
    sf_prune_result result;
    app_drawer drawer;
    figures before, after;
    training_log training;
} prune_run;

static int wrong(const prune_run *r, const char *option, const char *text, const char *what) {
    args_error(r->a->command, "--%s: \"%s\" %s", option, text, what);
    return EXIT_USAGE;
}

/* "0.1dB", "0.1 dB" or "0.1". */
static int read_loss(prune_run *r) {
    const char *text = args_value(r->a, "loss");
    if (!text) return 0;
    char *end;
    double loss = strtod(text, &end);
    if (end != text && *end == ' ') end++;
    if (end == text || (*end && strcmp(end, "dB") != 0) || !(loss >= 0 && loss <= 100))
        return wrong(r, "loss", text, "is not a number of dB in 0..100");
    r->options.loss = loss;
    return 0;
}

static int read_options(prune_run *r) {
    const args *a = r->a;
    int to = 0, refit = 0, seed = 1, error = read_loss(r);
    if (!error) error = args_int(a, "to", 1, 2147483647, &to);
    if (!error) error = args_int(a, "refit", 0, 100000000, &refit);
    if (!error) error = args_int(a, "seed", 0, 2147483647, &seed);
    if (error) return error;
    static const char *const apart[][2] = {{"loss", "to"}, {"refit", "random"}};
    for (size_t i = 0; i < sizeof apart / sizeof *apart; i++)
        if (args_value(a, apart[i][0]) && args_value(a, apart[i][1])) {
            args_error(a->command, "--%s: cannot be given beside --%s", apart[i][0], apart[i][1]);
            return EXIT_USAGE;
        }
    r->options.keep = (size_t)to;
    r->options.refit_steps = refit;
    r->options.seed = (uint64_t)seed;
    r->options.random = args_value(a, "random") != NULL;
    r->options.keep_sh = args_value(a, "keep-sh") != NULL;
    return 0;
}

static int check_outputs(const prune_run *r) {
    static const char *const others[] = {"log"};
    const char *output = args_value(r->a, "output");
    if (output) return app_check_outputs(r->a, r->ctx, output, others, 1);
    app_say(r->a, "-o FILE", "is needed: the model to write");
    return EXIT_USAGE;
}

static int look(prune_run *r, const sf_model *model, const char *path, figures *f) {
    double began = app_seconds();
    r->drawer.model = model;
    f->gaussians = sf_model_count(model);
    f->facts = json_object();
    app_log_model(f->facts, model, path);
    sf_status status =
        app_evaluate_drawn(r->ctx, r->scene, r->a, "train", app_draw_model, &r->drawer, &f->train);
    if (!status)
        status = app_evaluate_drawn(r->ctx, r->scene, r->a, "test", app_draw_model, &r->drawer, &f->test);
    r->training.evaluating += app_seconds() - began;
    return status ? app_fail(r->a, r->ctx) : 0;
}

static void print_row(FILE *out, const char *name, const figures *f) {
    fprintf(out, "%-7s %10zu %12lld", name, f->gaussians,
            (long long)json_integer_value(json_object_get(f->facts, "parameters")));
    json_t *bytes = json_object_get(f->facts, "bytes");
    if (bytes)
        fprintf(out, " %12lld", (long long)json_integer_value(bytes));
    else
        fprintf(out, " %12s", "-");
    fprintf(out, " %10.3f dB", f->train.psnr);
    if (f->test.views) fprintf(out, " %10.3f dB   %.4f", f->test.psnr, f->test.ssim);
    fprintf(out, "\n");
}

static void print_result(const prune_run *r) {
    FILE *out = strcmp(args_value(r->a, "output"), "-") ? stdout : stderr; /* the model may go there */
    if (args_value(r->a, "quiet")) return;
    fprintf(out, "%-7s %10s %12s %12s %13s %13s   %s\n", "", "Gaussians", "parameters", "bytes", "trained on",
            r->after.test.views ? "held out" : "", r->after.test.views ? "SSIM" : "");
    print_row(out, "before", &r->before);
    print_row(out, "after", &r->after);
}

static void log_figures(json_t *result, const figures *f) {
    json_object_update(result, f->facts);
    json_object_set_new(result, "train_psnr", json_real(f->train.psnr));
    json_object_set_new(result, "train_ssim", json_real(f->train.ssim));
    if (!f->test.views) return;
    json_object_set_new(result, "psnr", json_real(f->test.psnr));
    json_object_set_new(result, "ssim", json_real(f->test.ssim));
}

/* As that of a fit, of which charts take it for the end. */
static int write_log(prune_run *r) {
    const char *path = app_output(r->a, "log");
    const sf_prune_options *o = &r->options;
    if (!path) return 0;
    json_t *before = json_object(), *result = json_object();
    log_figures(before, &r->before);
    log_figures(result, &r->after);
    json_object_set_new(result, "steps", json_integer(o->refit_steps));
    json_object_set_new(result, "renders", json_integer((json_int_t)r->result.renders));
    json_object_set_new(result, "before", before);
    json_t *log = json_pack("{s:s, s:o, s:o, s:s, s:{}, s:{s:f, s:I, s:b, s:b, s:I, s:I}, s:o}", "version",
                            sf_version(), "model", app_json_text(r->a->positional[0]), "project",
                            app_json_text(r->a->positional[1]), "series", o->random ? "random" : "pruned",
                            "scene", "options", "loss", o->loss, "to", (json_int_t)o->keep, "random",
                            o->random, "keep_sh", o->keep_sh, "refit", (json_int_t)o->refit_steps, "seed",
                            (json_int_t)o->seed, "result", result);
    if (log) training_log_write(&r->training, log, r->pruned, &r->after.test);
    return app_write_json(r->a, r->ctx, path, log);
}

static int prepare(prune_run *r) {
    const args *a = r->a;
    int error = read_options(r);
    if (!error) error = app_context(a, &r->ctx);
    if (!error) error = check_outputs(r);
    if (!error) error = app_load_model(a, r->ctx, a->positional[0], &r->model);
    if (!error && !sf_model_count(r->model)) error = app_say(a, a->positional[0], "holds no Gaussian");
    if (!error && r->options.keep > sf_model_count(r->model)) {
        char what[96];
        snprintf(what, sizeof what, "holds %zu Gaussians, less than --to %zu", sf_model_count(r->model),
                 r->options.keep);
        error = app_say(a, a->positional[0], what);
    }
    if (!error) error = app_load(a, r->ctx, a->positional[1], &r->scene);
    if (!error) sf_scene_place_model(r->scene, r->model);
    if (!error) error = app_render_options(a, &r->drawer.options);
    if (!error && sf_renderer_create(r->ctx, &r->drawer.renderer)) error = app_fail(a, r->ctx);
    if (!error) error = training_log_start(&r->training, r->ctx, r->scene, NULL, app_draw_model);
    r->options.render = r->drawer.options;
    return error;
}

static int prune(prune_run *r) {
    const char *output = args_value(r->a, "output");
    int error = look(r, r->model, r->a->positional[0], &r->before);
    if (!error && sf_prune(r->ctx, r->scene, r->model, &r->options, &r->pruned, &r->result))
        error = app_fail(r->a, r->ctx);
    if (!error && app_save_model(r->a, r->pruned, output)) error = app_fail(r->a, r->ctx);
    if (error) return error;
    sf_fit_progress end = {.step = r->options.refit_steps,
                           .gaussians = sf_model_count(r->pruned),
                           .sh_degree = sf_model_sh_degree(r->pruned)};
    training_log_stop(&r->training, &end);
    error = look(r, r->pruned, output, &r->after);
    if (!error) print_result(r);
    return error ? error : write_log(r);
}

static void free_figures(figures *f) {
    json_decref(f->facts);
    json_decref(f->train.list);
    json_decref(f->test.list);
}

static int run(const args *a) {
    prune_run r = {.a = a, .options = sf_prune_options_default()};
    training_log_begin(&r.training, a);
    int error = prepare(&r);
    if (!error) error = prune(&r);
    free_figures(&r.before);
    free_figures(&r.after);
    training_log_free(&r.training);
    sf_renderer_destroy(&r.drawer.renderer);
    sf_model_destroy(&r.pruned);
    sf_model_destroy(&r.model);
    sf_scene_destroy(&r.scene);
    sf_context_destroy(&r.ctx);
    return error;
}

static const arg_option *const tables[] = {own_options,  model_options,  world_options, compensation_options,
                                           load_options, common_options, NULL};

const command command_prune = {
    .name = "prune",
    .synopsis = "MODEL PROJECT --loss 0.1dB -o OUT [OPTIONS]",
    .summary = "Removes the Gaussians and SH bands of a model that its scene needs least. MODEL, of splatfit "
               "or another trainer, loses its least important Gaussians, then bands of its spherical "
               "harmonics, as many as the PSNR of the project's training views allows. The PSNR is measured "
               "by rendering. Held-out views are reported, never used.",
    .tables = tables,
    .least = 2,
    .most = 2,
    .run = run,
};
