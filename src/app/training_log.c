/* training_log.c - the training log of fit: held-out quality at given times, snapshots, a clock without
 * these. */
#define _XOPEN_SOURCE 700 /* realpath */
#include "training_log.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "../bench/clocks.h"
#include "ranks.h"

const arg_option training_log_options[] = {
    {"eval-every", 0, "N", "evaluate the held-out views every N steps, for the log's curve"},
    {"eval-at", 0, "LIST", "and at these seconds since the program's start, for example 1,2,5,10"},
    {"eval-views", 0, "N", "evaluate at most N views of a split, evenly spread (all)"},
    {"snapshots", 0, "DIR", "write the first held-out view at 1, 2, 5, 10, 30 and 60 s as PNG"},
    {"eval-train", 0, NULL, "also evaluate the training views at the end, for the log's result"},
    {"label", 0, "TEXT", "name of this run in charts, for the log"},
    {0},
};

static const int snapshot_at[] = {1, 2, 5, 10, 30, 60}; /* s */
enum { SNAPSHOTS = sizeof snapshot_at / sizeof *snapshot_at };

/* Longest over middle axis from which a Gaussian counts as a needle. */
#define NEEDLE_ASPECT 100.0

void training_log_begin(training_log *w, const args *a) {
    *w = (training_log){.a = a, .start = sf_clock(), .curve = json_array()};
    bench_machine_describe(&w->machine, 0);
}

double training_log_seconds(const training_log *w) { return sf_clock() - w->start - w->evaluating; }

/* Seconds above 0 in ascending order, separated by commas. */
static int read_times(training_log *w) {
    const char *list = args_value(w->a, "eval-at"), *at = list;
    for (double before = 0; at; w->eval_times++) {
        char *end;
        double seconds = strtod(at, &end);
        if (end == at || (*end && *end != ',') || !(seconds > before) || !isfinite(seconds) ||
            w->eval_times == EVALUATION_TIMES) {
            args_error(w->a->command, "--eval-at: \"%s\" is not a list of up to %d ascending seconds", list,
                       (int)EVALUATION_TIMES);
            return EXIT_USAGE;
        }
        w->eval_at[w->eval_times] = before = seconds;
        at = *end ? end + 1 : NULL;
    }
    return 0;
}

int training_log_read(training_log *w) {
    int error = args_int(w->a, "eval-every", 1, 1000000000, &w->eval_every);
    if (!error) error = args_int(w->a, "eval-views", 1, 1000000000, &w->eval_views);
    return error ? error : read_times(w);
}

int training_log_start(training_log *w, sf_context *ctx, sf_scene *scene, sf_fitter *fitter, app_draw draw) {
    w->ctx = ctx;
    w->scene = scene;
    w->fitter = fitter;
    w->draw = draw;
    w->machine.threads = sf_context_threads(ctx);
    const char *folder = args_value(w->a, "snapshots");
    if (folder) w->snapshots = json_array();
    int error = folder && app_is_first_rank(ctx) ? app_make_folder(w->a, folder) : 0;
    w->setup = training_log_seconds(w);
    return error;
}

/* JSON has no word for what is not finite. */
static json_t *json_number(double value) { return isfinite(value) ? json_real(value) : json_null(); }

static void set_quality(json_t *point, const evaluation *e) {
    if (!e->views) return;
    json_object_set_new(point, "psnr", json_number(e->psnr));
    json_object_set_new(point, "ssim", json_number(e->ssim));
}

static void add_point(training_log *w, const sf_fit_progress *p, double seconds, const evaluation *e) {
    json_t *point = json_pack("{s:I, s:f, s:o, s:I, s:i, s:i}", "step", (json_int_t)p->step, "seconds",
                              seconds, "loss", json_number(p->loss), "gaussians", (json_int_t)p->gaussians,
                              "level", p->level, "sh_degree", p->sh_degree);
    set_quality(point, e);
    json_array_append_new(w->curve, point);
}

sf_status training_log_first_held_out(sf_scene *scene, sf_view_info *view) {
    sf_scene_info info;
    sf_scene_get_info(scene, &info);
    for (size_t i = 0; i < info.views; i++)
        if (!sf_scene_get_view(scene, i, view) && view->split == SF_SPLIT_TEST) return SF_OK;
    return sf_scene_get_view(scene, 0, view);
}

/* "DIR/NAME"; free() it. */
static char *in_folder(const char *folder, const char *name) {
    size_t room = strlen(folder) + strlen(name) + 2;
    char *path = malloc(room);
    if (path) snprintf(path, room, "%s/%s", folder, name);
    return path;
}

/* How the log names a file: from its own folder on where the file lies in there, else in full. */
static json_t *name_from_log(const training_log *w, const char *path) {
    const char *log = args_value(w->a, "log");
    char *folder = log ? app_folder(log) : NULL, *full = realpath(path, NULL);
    char *base = folder ? realpath(*folder ? folder : ".", NULL) : NULL;
    size_t n = base ? strlen(base) : 0;
    int below = full && n && !strncmp(full, base, n) && full[n] == '/';
    json_t *name = app_json_text(below ? full + n + 1 : full ? full : path);
    free(folder);
    free(base);
    free(full);
    return name;
}

/* The picture that the snapshots show, once; then the view as the fit has it. */
static sf_status write_snapshot(training_log *w, int second, double seconds) {
    sf_view_info view;
    sf_quality quality = {0};
    char name[32] = "picture.png";
    const char *folder = args_value(w->a, "snapshots");
    sf_status status = training_log_first_held_out(w->scene, &view);
    if (second) snprintf(name, sizeof name, "%ds.png", second);
    char *path = in_folder(folder, name);
    if (!path) return SF_ERR_MEMORY;
    if (!status)
        status = app_write_view(w->ctx, w->scene, &view, second ? w->draw : NULL, w->fitter, path, &quality);
    if (!status) {
        json_t *entry = json_pack("{s:i, s:f, s:o, s:o}", "second", second, "seconds", seconds, "view",
                                  app_json_text(view.name), "file", name_from_log(w, path));
        if (second) json_object_set_new(entry, "psnr", json_number(quality.psnr));
        json_array_append_new(w->snapshots, entry);
    }
    free(path);
    return status;
}

/* Moments that have come since the last look; of several the last one counts. */
static int times_due(const training_log *w, double seconds) {
    int due = w->eval_done;
    while (due < w->eval_times && w->eval_at[due] <= seconds) due++;
    return due;
}

static int snapshots_due(const training_log *w, double seconds) {
    int due = w->snapshots_done;
    while (w->snapshots && due < SNAPSHOTS && snapshot_at[due] <= seconds) due++;
    return due;
}

static sf_status measure(void *fitter, const sf_view_info *view, sf_quality *quality) {
    return sf_fitter_compare(fitter, view->id, quality);
}

sf_status training_log_evaluate(training_log *w, const char *split, evaluation *e) {
    double began = sf_clock();
    e->most = w->eval_views;
    sf_status status = app_evaluate(w->scene, w->a, split, measure, w->fitter, e);
    w->evaluating += sf_clock() - began;
    return status;
}

static void look(training_log *w, int evaluate, int snapshots, double seconds, evaluation *e) {
    double began = sf_clock();
    e->most = w->eval_views;
    if (evaluate) w->status = app_evaluate(w->scene, w->a, "test", measure, w->fitter, e);
    if (!w->status && snapshots && !w->snapshots_done) w->status = write_snapshot(w, 0, seconds);
    if (!w->status && snapshots) w->status = write_snapshot(w, snapshot_at[snapshots - 1], seconds);
    if (app_has_ranks(w->ctx)) w->status = (sf_status)app_most_of_ranks(w->ctx, w->status);
    double took = sf_clock() - began;
    w->evaluating += took;
    sf_fitter_skip_time(w->fitter, took);
}

/* Of several ranks all evaluate at the same step: what the first says counts. */
static double seconds_of_ranks(const training_log *w) {
    double seconds = training_log_seconds(w);
    if (!app_has_ranks(w->ctx) || !(w->eval_times || w->snapshots)) return seconds;
    if (!app_is_first_rank(w->ctx)) seconds = 0;
    app_sum_over_ranks(w->ctx, &seconds, 1);
    return seconds;
}

void training_log_step(training_log *w, const sf_fit_progress *p) {
    double seconds = seconds_of_ranks(w);
    int times = times_due(w, seconds), snapshots = snapshots_due(w, seconds);
    int evaluate = times > w->eval_done || (w->eval_every && p->step % w->eval_every == 0);
    evaluation e = {0};
    if (w->status) return;
    if (evaluate || snapshots > w->snapshots_done)
        look(w, evaluate, snapshots > w->snapshots_done ? snapshots : 0, seconds, &e);
    w->eval_done = times;
    w->snapshots_done = snapshots;
    if (e.views || p->fraction >= w->next_sample) {
        add_point(w, p, seconds, &e);
        w->next_sample = p->fraction + 0.01;
    }
    json_decref(e.list);
}

static json_t *last_point(const training_log *w) {
    size_t n = json_array_size(w->curve);
    return n ? json_array_get(w->curve, n - 1) : NULL;
}

void training_log_stop(training_log *w, const sf_fit_progress *p) {
    w->seconds = training_log_seconds(w);
    w->machine.load_end = bench_machine_load();
    json_t *last = last_point(w);
    if (!last || json_integer_value(json_object_get(last, "step")) < p->step)
        add_point(w, p, w->seconds, &(evaluation){0});
}

/* Gaussians whose longest axis is more than NEEDLE_ASPECT times the middle one. */
static size_t count_needles(const sf_model *model) {
    enum { AT_ONCE = 256 };
    float scales[3 * AT_ONCE];
    size_t count = sf_model_count(model), needles = 0;
    for (size_t from = 0; from < count; from += AT_ONCE) {
        size_t n = count - from < AT_ONCE ? count - from : AT_ONCE;
        if (sf_model_get(model, from, n, &(sf_gaussians){.log_scales = scales})) break; /* in range: never */
        for (size_t i = 0; i < n; i++) {
            double a = (double)scales[3 * i], b = (double)scales[3 * i + 1], c = (double)scales[3 * i + 2];
            double longest = fmax(a, fmax(b, c)), middle = fmax(fmin(a, b), fmin(fmax(a, b), c));
            needles += longest - middle > log(NEEDLE_ASPECT);
        }
    }
    return needles;
}

/* The project's own name: of sim:studio without its settings, of a file that of its folder. */
static json_t *scene_name(const char *project) {
    char name[256];
    size_t n = strcspn(project, "?");
    while (n > 1 && project[n - 1] == '/') n--;
    for (int folder = 0;; folder = 1) {
        size_t from = n;
        while (from && project[from - 1] != '/') from--;
        snprintf(name, sizeof name, "%.*s", (int)(n - from), project + from);
        size_t length = strlen(name);
        if (folder || !from || length < 5 || strcmp(name + length - 5, ".json")) return app_json_text(name);
        n = from - 1;
    }
}

static json_t *machine_json(const training_log *w) {
    const bench_machine *m = &w->machine;
    return json_pack("{s:o, s:i, s:i, s:s, s:f, s:f}", "cpu", app_json_text(m->cpu), "cpus", m->cpus,
                     "threads", m->threads, "isa", sf_context_isa(w->ctx), "load_start", m->load_start,
                     "load_end", m->load_end);
}

static void log_scene(const training_log *w, json_t *scene) {
    sf_view_info view;
    json_object_set_new(scene, "name", scene_name(w->a->positional[w->a->positionals - 1]));
    if (training_log_first_held_out(w->scene, &view)) return;
    json_object_set_new(scene, "width", json_integer(view.camera.width));
    json_object_set_new(scene, "height", json_integer(view.camera.height));
}

/* Of the model at the end, of which each rank has a part. */
static void log_model(const training_log *w, json_t *result, const sf_model *part) {
    const char *output = args_value(w->a, "output");
    double all[] = {(double)sf_model_count(part), (double)count_needles(part)};
    app_log_parts(w->ctx, result, part, output ? output : FIT_OUTPUT);
    app_sum_over_ranks(w->ctx, all, 2);
    json_object_set_new(result, "needles", json_real(all[0] > 0 ? all[1] / all[0] : 0));
}

void training_log_write(training_log *w, json_t *log, const sf_model *model, const evaluation *end) {
    static const char *const given[] = {"label", "preset"};
    json_t *result = json_object_get(log, "result"), *seed = json_object_get(log, "options");
    seed = json_object_get(seed, "seed");
    for (size_t i = 0; i < sizeof given / sizeof *given; i++) {
        const char *text = args_value(w->a, given[i]);
        if (text) json_object_set_new(log, given[i], app_json_text(text));
    }
    json_object_set(log, "seed", seed);
    json_object_set_new(log, "machine", machine_json(w));
    log_scene(w, json_object_get(log, "scene"));
    set_quality(last_point(w), end);
    json_object_set(log, "curve", w->curve);
    if (w->snapshots) json_object_set(log, "snapshots", w->snapshots);
    json_object_set_new(result, "seconds", json_real(w->seconds));
    json_object_set_new(result, "setup_seconds", json_real(w->setup));
    json_object_set_new(result, "evaluation_seconds", json_real(w->evaluating));
    if (model) log_model(w, result, model);
}

void training_log_free(training_log *w) {
    json_decref(w->curve);
    json_decref(w->snapshots);
}
