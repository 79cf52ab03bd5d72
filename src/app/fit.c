/* fit.c - splatfit fit: from a project to a model. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "photo_project.h"
#include "ranks.h"
#include "training_log.h"

static const arg_option own_options[] = {
    {"output", 'o', "FILE",
     "the model to write, an INRIA .ply, or a .spz, .splat, .glb or .sog by its name; - for standard output "
     "(splat.ply)"},
    {"from", 0, "MODEL",
     "start from a model, of splatfit or another trainer; full resolution from the first step"},
    {"freeze", 0, NULL,
     "with --from: steps do all of their work and the Gaussians stay as they are, to measure steps and "
     "quality of "
     "exactly that model"},
    {"cameras", 0, "FILE",
     "write the cameras, with refined poses, as INRIA's cameras.json; none: write no such file (beside the "
     "model: splat.cameras.json of splat.ply)"},
    {"preset", 0, "draft|standard|high",
     "the defaults of all hyperparameters: draft (seconds), standard (a minute) or high (minutes) "
     "(standard)"},
    {"lens", 0, "FILE",
     "of photos without cameras: their calibration, kept as it is (of splatfit calibrate, OpenCV, COLMAP)"},
    {"log", 0, "FILE", "write every hyperparameter, the curve and the result as JSON"},
    {"compare", 0, "FILE", "write a held-out picture and its render side by side, as PNG"},
    {"checkpoint", 0, "FILE", "write a checkpoint to FILE from time to time and at the end, for --resume"},
    {"checkpoint-every", 0, "S", "seconds between checkpoints; 0: after each step (60)"},
    {"resume", 0, "FILE", "continue from a checkpoint, with the same result as a run without the break"},
    {"replay", 0, "FILE", "repeat the run that wrote this log, to the byte, even if time limited it"},
    {"progress", 0, "auto|plain|json|none", "auto, plain, json (one object a line) or none (auto)"},
    {0},
};

/* Of a time limit, what is left for steps however long the pictures took to read. */
#define LEAST_TIME 0.1

/* The fit that a signal stops. */
static sf_fitter *volatile running;

/* In the handler of a signal. */
static void cancel(void) {
    if (running) sf_fitter_cancel(running);
}

/* What one run of the command holds. */
typedef struct fit_run {
    const args *a;
    const char *output;
    FILE *out; /* for people: standard output, or standard error where the model goes to standard output */
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
    sf_fit_options options; /* as asked; the fitter has those in force: its max_gaussians may be lower */
    progress_line line;
    training_log training;
    int stopped;      /* the number of the signal that ended the run early; 0: none */
    double seconds;   /* that the steps took */
    evaluation train; /* of --eval-train */
    json_t *replay;   /* the log of the run that is repeated */
    int checkpoint_every;
    double next_checkpoint; /* seconds of the fit */
    int checkpoint_error;
} fit_run;

/* Held-out views by their poses as given, or, where poses are refined, as they follow their neighbours'. */
static sf_status draw(void *user, const sf_view_info *view, float *rgb) {
    sf_image_out out = {.rgb = rgb};
    sf_camera camera;
    sf_status status = sf_fitter_get_camera(user, view->id, &camera);
    return status ? status : sf_fitter_render(user, &camera, &out);
}

/* What holds where no option says otherwise. */
static int first_options(fit_run *r) {
    const char *resume = args_value(r->a, "resume"), *replay = args_value(r->a, "replay");
    const char *preset = args_value(r->a, "preset"), *other = resume ? "--resume" : "--replay";
    const char *const beside[] = {resume ? "from" : NULL, resume ? "replay" : NULL,
                                  resume || replay ? "preset" : NULL};
    for (int i = 0; i < 3; i++)
        if (beside[i] && args_value(r->a, beside[i])) {
            args_error(r->a->command, "--%s: cannot be given beside %s", beside[i], other);
            return EXIT_USAGE;
        }
    if (sf_fit_options_preset(r->ctx, preset ? preset : "standard", &r->options)) {
        app_fail(r->a, r->ctx);
        return EXIT_USAGE;
    }
    if (resume) return sf_checkpoint_options(r->ctx, resume, &r->options) ? app_fail(r->a, r->ctx) : 0;
    int error = replay ? replay_open(r->a, &r->replay) : 0;
    return !error && replay ? replay_options(r->a, r->ctx, r->replay, &r->options) : error;
}

static int read_options(fit_run *r) {
    int failed = first_options(r);
    if (failed) return failed;
    failed = app_fit_options(r->a, r->ctx, &r->options);
    if (failed) return failed;
    if (args_value(r->a, "time_limit") && r->options.time_limit > 0 && !args_value(r->a, "steps"))
        r->options.steps = 0;
    if (!r->options.steps && !(r->options.time_limit > 0)) {
        app_say(r->a, "--steps", "0 needs --time-limit");
        return EXIT_USAGE;
    }
    r->checkpoint_every = 60;
    int error = args_int(r->a, "checkpoint-every", 0, 1000000000, &r->checkpoint_every);
    return error ? error : training_log_read(&r->training);
}

/* A checkpoint that cannot be written leaves the last one, and is tried again in time; what is wrong is said
 * once until it is mended. */
static void write_checkpoint(fit_run *r, const sf_fit_progress *p) {
    const char *path = app_output(r->a, "checkpoint");
    if (!path) return;
    sf_status status = sf_fitter_save(r->fitter, path);
    if (status && !r->checkpoint_error) {
        progress_break(&r->line);
        app_fail(r->a, r->ctx);
    }
    r->checkpoint_error = status ? EXIT_FAILED : 0;
    r->next_checkpoint = p->seconds + r->checkpoint_every;
}

static void on_progress(void *user, const sf_fit_progress *p) {
    fit_run *r = user;
    progress_show(&r->line, p, 0);
    training_log_step(&r->training, p);
    if (p->seconds >= r->next_checkpoint) write_checkpoint(r, p);
}

/* Why the run ended, in a word. */
static const char *end_word(const fit_run *r, const sf_fit_progress *p) {
    static const char *const words[SF_FIT_END_COUNT] = {[SF_FIT_GOES_ON] = "failure",
                                                        [SF_FIT_COMPLETE] = "complete",
                                                        [SF_FIT_TIME] = "time",
                                                        [SF_FIT_TARGET] = "target",
                                                        [SF_FIT_VALIDATION] = "validation"};
    return r->stopped ? "signal" : words[p->end];
}

static void print_end(const fit_run *r, const sf_fit_progress *p) {
    if (r->stopped)
        fprintf(r->out, "stopped: signal %d\n", r->stopped);
    else if (p->end == SF_FIT_VALIDATION)
        fprintf(r->out, "stopped: validation gained nothing since step %lld\n", (long long)p->best_step);
    else if (p->end == SF_FIT_TARGET)
        fprintf(r->out, "target reached: %.2f dB in validation\n", p->validation_psnr);
    else
        fprintf(r->out, "%s\n", end_word(r, p));
}

static json_t *log_json(fit_run *r, const evaluation *e) {
    sf_scene_info scene;
    sf_fit_progress p;
    sf_scene_get_info(r->scene, &scene);
    sf_fitter_get_progress(r->fitter, &p);
    json_t *result = json_pack("{s:I, s:f, s:f, s:I, s:f, s:[f,f,f], s:I, s:b}", "steps", (json_int_t)p.step,
                               "fit_seconds", r->seconds, "peak_memory_mb", app_peak_memory(), "gaussians",
                               (json_int_t)p.gaussians, "loss", p.loss, "background", (double)p.background[0],
                               (double)p.background[1], (double)p.background[2], "skipped_values",
                               (json_int_t)p.skipped_values, "complete", !r->stopped);
    json_object_set_new(result, "end", json_string(end_word(r, &p)));
    if (isfinite(p.validation_psnr)) { /* where views are kept out to validate */
        json_object_set_new(result, "best_step", json_integer(p.best_step));
        json_object_set_new(result, "validation_psnr", json_real(p.validation_psnr));
    }
    if (r->options.refine_poses || r->options.refine_intrinsics)
        json_object_set_new(result, "refinement",
                            json_pack("{s:f, s:f, s:f}", "turned_degrees", p.turned_degrees, "moved_depths",
                                      p.moved_depths, "focal_change", p.focal_change));
    if (r->train.views) {
        json_object_set_new(result, "train_psnr", json_real(r->train.psnr));
        json_object_set_new(result, "train_ssim", json_real(r->train.ssim));
    }
    if (e->views) {
        json_object_set_new(result, "psnr", json_real(e->psnr));
        json_object_set_new(result, "ssim", json_real(e->ssim));
        json_object_set_new(result, "psnr_corrected", json_real(e->psnr_corrected));
        json_object_set(result, "views", e->list);
        json_object_set_new(result, "held_out_evaluated", json_integer((json_int_t)e->views));
    }
    sf_fit_options in_force;
    sf_fitter_get_options(r->fitter, &in_force);
    json_t *log = json_pack(
        "{s:s, s:s, s:i, s:o, s:{s:I, s:I, s:I, s:f, s:o}, s:o, s:b, s:o, s:o}", "version", sf_version(),
        "isa", sf_context_isa(r->ctx), "threads", sf_context_threads(r->ctx), "project",
        app_json_text(r->a->positional[0]), "scene", "train_views", (json_int_t)scene.train_views,
        "test_views", (json_int_t)scene.test_views, "points", (json_int_t)scene.points, "extent",
        scene.extent, "fingerprint", replay_scene_json(r->scene), "options", app_options_json(&in_force),
        "warm_start", p.warm_start, "plan", replay_plan_json(r->fitter), "result", result);
    sf_model *model = NULL;
    sf_status status = sf_fitter_snapshot_part(r->fitter, &model);
    if (status && app_has_ranks(r->ctx)) sf_cluster_abort(r->ctx, EXIT_FAILED); /* the others would wait */
    if (log) training_log_write(&r->training, log, status ? NULL : model, e);
    sf_model_destroy(&model);
    return log;
}

static int is_file(const char *path) {
    struct stat st;
    return strcmp(path, "-") && !stat(path, &st) && S_ISREG(st.st_mode);
}

/* Beside the model and named after it, or where --cameras says; nothing for a model that went down a pipe. */
static int write_cameras(const fit_run *r) {
    const char *asked = app_output(r->a, "cameras");
    int world = args_value(r->a, "world") != NULL;
    if (!app_is_first_rank(r->ctx)) return 0;
    if (asked) return sf_fitter_save_cameras(r->fitter, asked, world) ? app_fail(r->a, r->ctx) : 0;
    if (args_value(r->a, "cameras")) return 0;
    if (!is_file(r->output)) return 0;
    char *path = app_cameras_beside(r->output);
    if (!path) return app_say(r->a, r->output, "out of memory");
    int error = sf_fitter_save_cameras(r->fitter, path, world) ? app_fail(r->a, r->ctx) : 0;
    free(path);
    return error;
}

/* The first held-out view and its render. */
static int write_comparison(const fit_run *r) {
    const char *path = app_output(r->a, "compare");
    if (!path) return 0; /* else each of several ranks draws its band */
    sf_view_info view;
    if (training_log_first_held_out(r->scene, &view)) return app_fail(r->a, r->ctx);
    return app_write_pair(r->ctx, r->scene, &view, draw, r->fitter, path) ? app_fail(r->a, r->ctx) : 0;
}

/* A line about an evaluation. */
typedef struct eval_line {
    fit_run *r;
    const char *of; /* "held-out" or "training" */
    double start;
} eval_line;

static int on_evaluated(void *user, size_t done, size_t all) {
    const eval_line *e = user;
    progress_line *line = &e->r->line;
    char text[96];
    snprintf(text, sizeof text, "evaluating: %zu of %zu %s views", done, all, e->of);
    if (line->kind != PROGRESS_JSON && progress_due(line, app_seconds() - e->start, 0))
        progress_text(line, text);
    return app_has_ranks(e->r->ctx) ? 0 : app_stopped_by(); /* not all ranks need notice it at once */
}

/* Views of the model that is done; a signal ends it. 0 or an exit code. */
static int evaluate(fit_run *r, const char *split, evaluation *e) {
    eval_line line = {r, strcmp(split, "test") ? "training" : "held-out", app_seconds()};
    e->progress = on_evaluated;
    e->user = &line;
    r->line.last = 0;
    sf_status status = training_log_evaluate(&r->training, split, e);
    progress_break(&r->line);
    if (status == SF_ERR_CANCELLED) r->stopped = app_stopped_by(), e->views = 0;
    return status && status != SF_ERR_CANCELLED ? app_fail(r->a, r->ctx) : 0;
}

/* "N", or "N of M" where not all were evaluated. */
static const char *count_text(const evaluation *e, char text[48]) {
    snprintf(text, 48, e->most && e->of > (size_t)e->most ? "%zu of %zu" : "%zu", e->views, e->of);
    return text;
}

static void print_result(fit_run *r, const evaluation *e) {
    sf_fit_progress p;
    char count[48];
    sf_fitter_get_progress(r->fitter, &p);
    if (args_value(r->a, "quiet") || r->line.kind == PROGRESS_JSON) return;
    fprintf(r->out, "%s after %lld steps in %.1f s (%.1f ms a step, peak memory %.0f MB)\n",
            r->stopped ? "stopped" : "done", (long long)p.step, r->seconds,
            1e3 * r->seconds / (double)(p.step ? p.step : 1), app_peak_memory());
    fprintf(r->out, "wrote %s: %zu Gaussians\n", r->output, p.gaussians);
    if (p.skipped_values)
        fprintf(r->out, "left out %llu times: Gaussians with values that were not finite\n",
                (unsigned long long)p.skipped_values);
    if (p.diverged)
        fprintf(r->out, "diverged %lld times, and went on from an earlier model\n", (long long)p.diverged);
    if (e->views)
        fprintf(r->out,
                "held out, %s views: PSNR %.2f dB, SSIM %.4f (PSNR with exposure corrected: %.2f dB)\n",
                count_text(e, count), e->psnr, e->ssim, e->psnr_corrected);
    if (r->train.views)
        fprintf(r->out, "trained on, %s views: PSNR %.2f dB, SSIM %.4f\n", count_text(&r->train, count),
                r->train.psnr, r->train.ssim);
    if (r->options.refine_poses)
        fprintf(r->out,
                "poses corrected, in the median by %.3f degrees and %.2f %% of depth; held-out ones follow "
                "those beside them\n",
                p.turned_degrees, 100 * p.moved_depths);
    if (r->options.refine_intrinsics)
        fprintf(r->out, "focal length corrected by %+.2f %%\n", 100 * p.focal_change);
    if (r->options.background == SF_BACKGROUND_AUTO)
        fprintf(r->out, "background %.4f,%.4f,%.4f: give it to eval and render as --background\n",
                (double)p.background[0], (double)p.background[1], (double)p.background[2]);
    print_end(r, &p);
    app_print_ranks(r->ctx, r->out, (long long)p.step);
}

static int save_model(const fit_run *r) {
    return app_save_fitted(r->a, r->fitter, r->output) ? app_fail(r->a, r->ctx) : 0;
}

/* The model first, whatever comes after. */
static int finish(fit_run *r) {
    evaluation e = {.list = json_array()};
    int error = save_model(r);
    if (!error) error = write_cameras(r);
    if (!error && !r->stopped) {
        json_decref(e.list);
        error = evaluate(r, "test", &e);
    }
    if (!error && !r->stopped && args_value(r->a, "eval-train")) error = evaluate(r, "train", &r->train);
    if (!error) print_result(r, &e);
    if (!error) error = write_comparison(r);
    const char *log = app_output(r->a, "log");
    json_t *written = !error && log ? log_json(r, &e) : NULL;
    if (written && !app_is_first_rank(r->ctx))
        json_decref(written);
    else if (!error && log)
        error = app_write_json(r->a, r->ctx, log, written);
    json_decref(e.list);
    if (!error && r->stopped) error = 128 + r->stopped;
    return error;
}

/* The time limit is the program's: what reading the pictures took is gone. */
static void count_setup(fit_run *r) {
    if (args_value(r->a, "resume") || r->replay || !(r->options.time_limit > 0)) return;
    double left = r->options.time_limit - training_log_seconds(&r->training);
    r->options.time_limit =
        left > LEAST_TIME * r->options.time_limit ? left : LEAST_TIME * r->options.time_limit;
}

static int make_fitter(fit_run *r, const sf_model *from) {
    const char *resume = args_value(r->a, "resume");
    count_setup(r);
    sf_status status = resume ? sf_fitter_load(r->ctx, r->scene, resume, &r->options, &r->fitter)
                              : sf_fitter_create(r->ctx, r->scene, from, &r->options, &r->fitter);
    if (status) return app_fail(r->a, r->ctx);
    sf_fit_progress p;
    sf_fitter_get_progress(r->fitter, &p);
    r->next_checkpoint = p.seconds + r->checkpoint_every;
    return 0;
}

/* Whether the memory holds fewer Gaussians than were asked for. */
static int lowered(const fit_run *r) {
    sf_fit_options options;
    sf_fitter_get_options(r->fitter, &options);
    return options.max_gaussians < r->options.max_gaussians;
}

/* The memory of a checkpoint or a log is the fit's: the pictures are held to what this run was given. */
static int load_scene(fit_run *r) {
    int64_t memory = args_value(r->a, "memory") ? r->options.memory : 0;
    const char *path = r->a->positional[0];
    char *found = NULL;
    int known = !sf_sfm_find_photos(path) && !sf_film_is(path), error = 0;
    if (!known || app_has_ranks(r->ctx)) error = app_find_cameras_once(r->a, r->ctx, known, r->out, &found);
    if (!error && known && args_value(r->a, "lens"))
        error = app_say(r->a, path, "--lens is for photos or a video without cameras, which this is not");
    if (!error && known && app_is_first_rank(r->ctx) && !args_value(r->a, "quiet"))
        error = project_tell_change(r->a, r->ctx, path);
    if (!error) error = app_load_within(r->a, r->ctx, found ? found : path, memory, &r->scene);
    free(found);
    return error;
}

static int prepare(fit_run *r) {
    const char *from_path = args_value(r->a, "from");
    sf_model *from = NULL;
    size_t count = 0;
    static const char *const outputs[] = {"log", "compare", "cameras", "checkpoint"};
    int error = app_context(r->a, &r->ctx);
    if (!error) error = app_join(r->a, r->ctx);
    if (!error) r->out = app_rank_out(r->ctx, r->out);
    if (!error) error = read_options(r);
    if (!error) error = progress_start(&r->line, r->a, r->out);
    if (!error && app_is_first_rank(r->ctx))
        error = app_check_outputs(r->a, r->ctx, r->output, outputs, sizeof outputs / sizeof *outputs);
    if (!error && from_path) error = app_load_from(r->a, r->ctx, from_path, &from, &count);
    if (!error) error = app_freeze(r->a, r->ctx, from, count, &r->options);
    if (!error) error = load_scene(r);
    /* what its own pictures lack is said; the fit's warnings are those of rank 0 */
    if (!error && !app_is_first_rank(r->ctx)) app_hold_log(1);
    if (!error && r->replay) error = replay_check(r->a, r->ctx, r->replay, r->scene);
    if (!error) error = make_fitter(r, from);
    if (!error && r->replay && lowered(r))
        error = app_say(r->a, "memory", "too little for the max_gaussians of the run that is repeated");
    if (!error && r->replay) error = replay_follow(r->a, r->ctx, r->replay, r->fitter);
    if (!error) error = training_log_start(&r->training, r->ctx, r->scene, r->fitter, draw);
    sf_model_destroy(&from);
    return error;
}

static void print_memory(const fit_run *r) {
    const double mega = 1048576;
    sf_memory_bill b;
    sf_fit_options options;
    sf_fitter_get_memory(r->fitter, &b);
    sf_fitter_get_options(r->fitter, &options);
    fprintf(
        r->out,
        "memory: about %.0f MB of %.0f for %lld Gaussians: program and pictures %.0f, Gaussians and their "
        "moments %.0f, tile lists %.0f, planes %.0f, results %.0f\n",
        (double)b.total / mega, (double)b.budget / mega, (long long)options.max_gaussians,
        (double)b.before / mega, (double)b.gaussians / mega, (double)b.lists / mega, (double)b.planes / mega,
        (double)b.results / mega);
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
    print_memory(r);
    if (args_value(r->a, "resume"))
        fprintf(r->out, "going on after step %lld, %.1f s\n", (long long)p.step, p.seconds);
    fflush(r->out);
}

static int run(const args *a) {
    const char *output = args_value(a, "output");
    fit_run r = {.a = a, .output = output ? output : FIT_OUTPUT};
    training_log_begin(&r.training, a);
    r.out = strcmp(r.output, "-") ? stdout : stderr;
    int error = prepare(&r);
    if (!error) {
        announce(&r);
        running = r.fitter;
        app_catch_signals(cancel);
        sf_status status = sf_fitter_run(r.fitter, on_progress, &r);
        sf_fit_progress p;
        sf_fitter_get_progress(r.fitter, &p);
        r.seconds = p.seconds;
        progress_show(&r.line, &p, 1);
        progress_break(&r.line);
        training_log_stop(&r.training, &p);
        if (status == SF_ERR_CANCELLED)
            r.stopped = (int)app_most_of_ranks(r.ctx, app_stopped_by());
        else if (status || r.training.status)
            error = app_fail(a, r.ctx);
        write_checkpoint(&r, &p);
        int saved = finish(&r); /* also after a failure: what was fitted so far is kept */
        if (!error) error = saved;
        if (!error) error = r.checkpoint_error;
    }
    running = NULL;
    error = app_part(r.ctx, error);
    json_decref(r.train.list);
    training_log_free(&r.training);
    json_decref(r.replay);
    sf_fitter_destroy(&r.fitter);
    sf_scene_destroy(&r.scene);
    sf_context_destroy(&r.ctx);
    return error;
}

static const arg_option *const tables[] = {own_options,  training_log_options, model_options, world_options,
                                           load_options, common_options,       NULL};

const command command_fit = {
    .name = "fit",
    .synopsis = "PROJECT -o splat.ply [OPTIONS]",
    .summary = "Fits a model to a project. PROJECT is a COLMAP folder, a transforms.json or its folder, a "
               "folder of photos or a video, whose cameras are found first, or the embedded scene "
               "sim:studio. SIGINT "
               "and SIGTERM write the model so far, and the checkpoint that "
               "--checkpoint names.",
    .tables = tables,
    .least = 1,
    .most = 1,
    .with_fit_options = 1,
    .run = run,
};
