/* fit.c - splatfit fit: from a project to a model. */
#include <signal.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/stat.h>

#include "app.h"

static const arg_option own_options[] = {
    {"output", 'o', "FILE", "the model to write, an INRIA .ply; - for standard output (splat.ply)"},
    {"from", 0, "MODEL", "go on from a model, of splatfit or others: full resolution from the first step"},
    {"cameras", 0, "FILE", "cameras.json to write; none for none (beside the model)"},
    {"log", 0, "FILE", "write every hyperparameter, the curve and the result as JSON"},
    {"eval-every", 0, "N", "evaluate the held-out views every N steps, for the log's curve"},
    {"compare", 0, "FILE", "write a held-out picture and its render side by side, as PNG"},
    {"progress", 0, "KIND", "auto, plain, json (one object a line) or none (auto)"},
    {0},
};

/* The fit that a signal stops. */
static sf_fitter *volatile running;
static volatile sig_atomic_t stopped_by;

static void on_signal(int number) {
    stopped_by = number;
    if (running) sf_fitter_cancel(running);
}

/* The first signal ends the run in good order; the second one ends the program. */
static void catch_signals(void) {
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = (int)(SA_RESETHAND | SA_RESTART)};
    sigemptyset(&action.sa_mask);
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
}

/* What one run of the command holds. */
typedef struct fit_run {
    const args *a;
    const char *output;
    FILE *out; /* for people: standard output, or standard error where the model goes to standard output */
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
    sf_fit_options options;
    progress_line line;
    int eval_every;
    json_t *curve;
    int stopped;        /* the number of the signal that ended the run early; 0: none */
    double seconds;     /* that the steps took */
    double next_sample; /* fraction of the run at which the curve gets its next point */
    sf_status eval_status;
} fit_run;

static sf_status draw(void *user, const sf_camera *camera, float *rgb) {
    sf_image_out out = {.rgb = rgb};
    return sf_fitter_render(user, camera, &out);
}

/* --background R,G,B stands for the option color and its three components. */
static int set_background(fit_run *r, const char *text) {
    float color[3];
    if (!app_color(text, color)) {
        app_say(r->a, "--background", "neither R,G,B in 0..1 nor black, white, random or auto");
        return EXIT_USAGE;
    }
    r->options.background = SF_BACKGROUND_COLOR;
    r->options.background_red = (double)color[0];
    r->options.background_green = (double)color[1];
    r->options.background_blue = (double)color[2];
    return 0;
}

static int set_option(fit_run *r, const char *name, const char *text) {
    if (!strcmp(name, "background") && strchr(text, ',')) return set_background(r, text);
    if (!sf_fit_options_set(r->ctx, &r->options, name, text)) return 0;
    app_fail(r->a, r->ctx);
    return EXIT_USAGE;
}

static int read_options(fit_run *r) {
    r->options = sf_fit_options_default();
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        const char *text = args_value(r->a, info.name);
        int error = text ? set_option(r, info.name, text) : 0;
        if (error) return error;
    }
    if (r->options.time_limit > 0 && !args_value(r->a, "steps")) r->options.steps = 0;
    if (!r->options.steps && !(r->options.time_limit > 0)) {
        app_say(r->a, "--steps", "0 needs --time-limit");
        return EXIT_USAGE;
    }
    return args_int(r->a, "eval-every", 1, 1000000000, &r->eval_every);
}

static void add_sample(fit_run *r, const sf_fit_progress *p, double psnr) {
    json_t *point = json_pack("{s:I, s:f, s:f, s:I, s:i, s:i}", "step", (json_int_t)p->step, "seconds",
                              p->seconds, "loss", p->loss, "gaussians", (json_int_t)p->gaussians, "level",
                              p->level, "sh_degree", p->sh_degree);
    if (psnr > 0) json_object_set_new(point, "psnr", json_real(psnr));
    json_array_append_new(r->curve, point);
}

static void on_progress(void *user, const sf_fit_progress *p) {
    fit_run *r = user;
    progress_show(&r->line, p, 0);
    double psnr = 0;
    if (r->eval_every && p->step % r->eval_every == 0 && !r->eval_status) {
        evaluation e;
        r->eval_status = app_evaluate(r->ctx, r->scene, r->a, "test", draw, r->fitter, &e);
        psnr = e.psnr;
        json_decref(e.list);
    }
    if (psnr > 0 || p->fraction >= r->next_sample) {
        add_sample(r, p, psnr);
        r->next_sample = p->fraction + 0.01;
    }
}

static json_t *options_json(const sf_fit_options *options) {
    json_t *object = json_object();
    sf_option_info info;
    for (size_t i = 0; !sf_fit_option_info(i, &info); i++) {
        char text[64];
        sf_fit_options_get(options, info.name, text, sizeof text);
        json_t *value = info.kind == SF_KIND_ENUM   ? json_string(text)
                        : info.kind == SF_KIND_REAL ? json_real(strtod(text, NULL))
                                                    : json_integer(strtoll(text, NULL, 10));
        json_object_set_new(object, info.name, value);
    }
    return object;
}

/* The most memory that the process has had resident, in MB. */
static double peak_memory(void) {
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) ? 0 : (double)usage.ru_maxrss / 1024;
}

static json_t *log_json(fit_run *r, const evaluation *e) {
    sf_scene_info scene;
    sf_fit_progress p;
    sf_scene_get_info(r->scene, &scene);
    sf_fitter_get_progress(r->fitter, &p);
    json_t *result = json_pack("{s:I, s:f, s:f, s:I, s:f, s:[f,f,f], s:I, s:b}", "steps", (json_int_t)p.step,
                               "seconds", r->seconds, "peak_memory_mb", peak_memory(), "gaussians",
                               (json_int_t)p.gaussians, "loss", p.loss, "background", (double)p.background[0],
                               (double)p.background[1], (double)p.background[2], "skipped_values",
                               (json_int_t)p.skipped_values, "complete", !r->stopped);
    if (e->views) {
        json_object_set_new(result, "psnr", json_real(e->psnr));
        json_object_set_new(result, "ssim", json_real(e->ssim));
        json_object_set(result, "views", e->list);
    }
    return json_pack("{s:s, s:s, s:i, s:o, s:{s:I, s:I, s:I, s:f}, s:o, s:O, s:o}", "version", sf_version(),
                     "isa", sf_context_isa(r->ctx), "threads", sf_context_threads(r->ctx), "project",
                     app_json_text(r->a->positional[0]), "scene", "train_views",
                     (json_int_t)scene.train_views, "test_views", (json_int_t)scene.test_views, "points",
                     (json_int_t)scene.points, "extent", scene.extent, "options", options_json(&r->options),
                     "curve", r->curve, "result", result);
}

static int is_file(const char *path) {
    struct stat st;
    return strcmp(path, "-") && !stat(path, &st) && S_ISREG(st.st_mode);
}

/* cameras.json beside the model, or where --cameras says; nothing for a model that went down a pipe. */
static int write_cameras(const fit_run *r) {
    const char *asked = args_value(r->a, "cameras");
    if (asked) {
        if (!strcmp(asked, "none")) return 0;
        return sf_scene_save_cameras(r->scene, asked) ? app_fail(r->a, r->ctx) : 0;
    }
    if (!is_file(r->output)) return 0;
    char *folder = app_folder(r->output), *path = folder ? malloc(strlen(folder) + 16) : NULL;
    int error = 0;
    if (path) sprintf(path, "%scameras.json", folder);
    if (!path || sf_scene_save_cameras(r->scene, path)) error = app_fail(r->a, r->ctx);
    free(folder);
    free(path);
    return error;
}

/* The first held-out view and its render. */
static int write_comparison(const fit_run *r) {
    const char *path = args_value(r->a, "compare");
    if (!path) return 0;
    sf_scene_info info;
    sf_view_info view = {0};
    sf_scene_get_info(r->scene, &info);
    size_t i = 0;
    while (i < info.views && !sf_scene_get_view(r->scene, i, &view) && view.split != SF_SPLIT_TEST) i++;
    if (i == info.views && sf_scene_get_view(r->scene, 0, &view)) return app_fail(r->a, r->ctx);
    return app_write_pair(r->ctx, r->scene, &view, draw, r->fitter, path) ? app_fail(r->a, r->ctx) : 0;
}

static void print_result(fit_run *r, const evaluation *e) {
    sf_fit_progress p;
    sf_fitter_get_progress(r->fitter, &p);
    if (args_value(r->a, "quiet") || r->line.kind == PROGRESS_JSON) return;
    fprintf(r->out, "%s after %lld steps in %.1f s (%.1f ms a step, peak memory %.0f MB)\n",
            r->stopped ? "stopped" : "done", (long long)p.step, r->seconds,
            1e3 * r->seconds / (double)(p.step ? p.step : 1), peak_memory());
    fprintf(r->out, "wrote %s: %zu Gaussians\n", r->output, p.gaussians);
    if (p.skipped_values)
        fprintf(r->out, "left out %llu times: Gaussians with values that were not finite\n",
                (unsigned long long)p.skipped_values);
    if (e->views)
        fprintf(r->out, "held out, %zu views: PSNR %.2f dB, SSIM %.4f\n", e->views, e->psnr, e->ssim);
    if (r->options.background == SF_BACKGROUND_AUTO)
        fprintf(r->out, "background %.4f,%.4f,%.4f: give it to eval and render as --background\n",
                (double)p.background[0], (double)p.background[1], (double)p.background[2]);
}

static int save_model(const fit_run *r) {
    sf_model *model = NULL;
    sf_status status = sf_fitter_snapshot(r->fitter, &model);
    if (!status) status = sf_model_save(model, r->output);
    sf_model_destroy(&model);
    return status ? app_fail(r->a, r->ctx) : 0;
}

/* The model first, whatever comes after. */
static int finish(fit_run *r) {
    evaluation e = {.list = json_array()};
    int error = save_model(r);
    if (!error) error = write_cameras(r);
    if (!error && !r->stopped) {
        json_decref(e.list);
        if (app_evaluate(r->ctx, r->scene, r->a, "test", draw, r->fitter, &e)) error = app_fail(r->a, r->ctx);
    }
    if (!error) print_result(r, &e);
    if (!error) error = write_comparison(r);
    const char *log = args_value(r->a, "log");
    if (!error && log) error = app_write_json(r->a, r->ctx, log, log_json(r, &e));
    json_decref(e.list);
    if (!error && r->stopped) error = 128 + r->stopped;
    return error;
}

/* Each output can be written, and none is named twice. */
static int check_outputs(const fit_run *r) {
    static const char *const names[] = {"output", "log", "compare", "cameras"};
    enum { OUTPUTS = sizeof names / sizeof *names };
    const char *paths[OUTPUTS];
    for (int i = 0; i < OUTPUTS; i++) {
        paths[i] = i ? args_value(r->a, names[i]) : r->output;
        if (!paths[i] || (i && !strcmp(paths[i], "none"))) paths[i] = NULL;
        for (int k = 0; k < i && paths[i]; k++)
            if (paths[k] && !strcmp(paths[i], paths[k]) && strcmp(paths[i], "/dev/null")) {
                app_say(r->a, paths[i], "is named for two outputs");
                return EXIT_USAGE;
            }
        int error = paths[i] ? app_check_output(r->a, paths[i]) : 0;
        if (error) return error;
    }
    return 0;
}

static int prepare(fit_run *r) {
    const char *from_path = args_value(r->a, "from");
    sf_model *from = NULL;
    int error = app_context(r->a, &r->ctx);
    if (!error) error = read_options(r);
    if (!error) error = progress_start(&r->line, r->a, r->out);
    if (!error) error = check_outputs(r);
    if (!error && from_path && sf_model_load(r->ctx, from_path, &from)) error = app_fail(r->a, r->ctx);
    if (!error && from && !sf_model_count(from))
        error = app_say(r->a, from_path, "holds no Gaussian to go on from");
    if (!error) error = app_load(r->a, r->ctx, r->a->positional[0], &r->scene);
    if (!error && sf_fitter_create(r->ctx, r->scene, from, &r->options, &r->fitter))
        error = app_fail(r->a, r->ctx);
    sf_model_destroy(&from);
    return error;
}

static void announce(const fit_run *r) {
    sf_scene_info info;
    sf_fit_progress p;
    if (args_value(r->a, "quiet") || r->line.kind == PROGRESS_JSON) return;
    sf_scene_get_info(r->scene, &info);
    sf_fitter_get_progress(r->fitter, &p);
    fprintf(r->out, "%s: %zu training views, %zu held out, %zu points; %zu first Gaussians, %d threads, %s\n",
            r->a->positional[0], info.train_views, info.test_views, info.points, p.gaussians,
            sf_context_threads(r->ctx), sf_context_isa(r->ctx));
    fflush(r->out);
}

static int run(const args *a) {
    const char *output = args_value(a, "output");
    fit_run r = {.a = a, .output = output ? output : "splat.ply", .curve = json_array()};
    r.out = strcmp(r.output, "-") ? stdout : stderr;
    int error = prepare(&r);
    if (!error) {
        announce(&r);
        running = r.fitter;
        catch_signals();
        sf_status status = sf_fitter_run(r.fitter, on_progress, &r);
        sf_fit_progress p;
        sf_fitter_get_progress(r.fitter, &p);
        r.seconds = p.seconds;
        progress_show(&r.line, &p, 1);
        progress_break(&r.line);
        add_sample(&r, &p, 0);
        if (status == SF_ERR_CANCELLED)
            r.stopped = (int)stopped_by;
        else if (status || r.eval_status)
            error = app_fail(a, r.ctx);
        int saved = finish(&r); /* also after a failure: what was fitted so far is kept */
        if (!error) error = saved;
    }
    running = NULL;
    json_decref(r.curve);
    sf_fitter_destroy(&r.fitter);
    sf_scene_destroy(&r.scene);
    sf_context_destroy(&r.ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, load_options, common_options, NULL};

const command command_fit = {
    .name = "fit",
    .synopsis = "PROJECT -o splat.ply [OPTIONS]",
    .summary = "Fits a model to a project. PROJECT is a COLMAP folder, a transforms.json or its folder, or "
               "the embedded "
               "scene sim:studio. SIGINT and SIGTERM write the model so far.",
    .tables = tables,
    .least = 1,
    .most = 1,
    .with_fit_options = 1,
    .run = run,
};
