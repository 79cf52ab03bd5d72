/* common.c - what the subcommands share. */
#include <signal.h>
#include <time.h>
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <strings.h>
#include <sys/resource.h>
#include <sys/stat.h>
#include <unistd.h>

#include "app.h"

const arg_option common_options[] = {
    {"threads", 0, "N", "threads to use; default: what the affinity mask and the control group allow"},
    {"cores", 0, "LIST", "run on these processors alone, for example 0-2,5; the number of threads follows"},
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
    {"masks", 0, "DIR", "folder of masks, black is ignored; default: masks in the project, where it is"},
    {"no-masks", 0, NULL, "read no masks"},
    {"alpha", 0, "NAME",
     "alpha channels: mask (transparent is ignored), blend (over --background), ignore, auto: blend for "
     "Blender's "
     "transforms_train.json, else mask (auto)"},
    {0},
};

const arg_option render_options[] = {
    {"split", 0, "test|train|all", "views: test (held out), train or all"},
    {"background", 0, "COLOR", "black, white or R,G,B in 0..1 (black)"},
    {"near-plane", 0, "X", "cull Gaussians nearer than X, world units; default: as a fit of the project"},
    {0},
};

const arg_option model_options[] = {
    {"spz-frame", 0, "own|rub",
     "axes in a .spz: own, as the file says or else as in a .ply, or rub (right, up, back): y and z are "
     "negated on the way (own)"},
    {0},
};

const arg_option compensation_options[] = {
    {"antialiased", 0, "yes|no",
     "whether the model was fitted with opacity compensation, whatever its file says (as it says)"},
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
    if (!error) options->spz_frame = is_rub ? SF_SPZ_FRAME_RUB : SF_SPZ_FRAME_OWN;
    return error;
}

int app_load_model(const args *a, sf_context *ctx, const char *path, sf_model **model) {
    sf_model_file_options options = sf_model_file_options_default();
    const char *antialiased = has_table(a, compensation_options) ? args_value(a, "antialiased") : NULL;
    int error = app_model_options(a, &options);
    if (!error && sf_model_load_as(ctx, path, &options, model)) error = app_fail(a, ctx);
    if (!error && antialiased) sf_model_set_antialiased(*model, !strcmp(antialiased, "yes"));
    return error;
}

int app_fail(const args *a, const sf_context *ctx) {
    const char *message = sf_last_error(ctx);
    return args_error(a->command, "%s", *message ? message : "out of memory");
}

int app_say(const args *a, const char *subject, const char *what) {
    return args_error(a->command, "%s: %s", subject, what);
}

static int log_is_held;

void app_hold_log(int hold) { log_is_held = hold; }

static void print_log(void *user, sf_log_level level, const char *message) {
    (void)user;
    if (log_is_held) return;
    if (level < SF_LOG_INFO) return;
    int colored = level == SF_LOG_WARNING && args_colored(stderr);
    fprintf(stderr, "%s%s%s%s\n", colored ? "\033[1;33m" : "", level == SF_LOG_WARNING ? "warning: " : "",
            colored ? "\033[0m" : "", message);
}

int app_context(const args *a, sf_context **ctx) {
    sf_context_options options = {.isa = args_value(a, "isa")};
    if (!args_value(a, "quiet")) options.log = print_log;
    int error = args_int(a, "threads", 1, 256, &options.threads);
    if (!error) error = app_cores(a);
    if (error) return error;
    sf_status status = sf_context_create(ctx, &options);
    if (!status) return 0;
    if (status == SF_ERR_ARGUMENT || status == SF_ERR_UNSUPPORTED) {
        const char *isa = options.isa ? options.isa : getenv("SPLATFIT_ISA");
        char usable[128] = "";
        sf_isa_info info;
        for (size_t i = 0, n = 0; !sf_isa_describe(i, &info) && n < sizeof usable; i++)
            if (info.usable) n += (size_t)snprintf(usable + n, sizeof usable - n, " %s", info.name);
        args_error(a->command, "isa: \"%s\" is none of this machine's:%s", isa ? isa : "", usable);
        return EXIT_USAGE;
    }
    return app_say(a, "cannot start", sf_status_text(status));
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

/* Below, beside the signals. */
static int load(const args *a, sf_context *ctx, const char *path, const sf_load_options *options,
                sf_scene **scene);

int app_load(const args *a, sf_context *ctx, const char *path, sf_scene **scene) {
    sf_load_options options = sf_load_options_default();
    options.masks = args_value(a, "masks");
    options.no_masks = args_value(a, "no-masks") != NULL;
    options.images = args_value(a, "images");
    options.test_list = args_value(a, "test-list");
    int error = args_int(a, "downscale", 1, 64, &options.downscale);
    if (!error) error = args_int(a, "hold-out", 0, 1000000, &options.hold_out);
    if (!error) error = args_int(a, "sub-model", 0, 1000000, &options.sub_model);
    if (!error) error = alpha_options(a, &options);
    const char *memory = args_value(a, "memory");
    sf_fit_options fit = sf_fit_options_default();
    if (!error && memory && sf_fit_options_set(ctx, &fit, "memory", memory)) error = app_fail(a, ctx);
    if (error) return error;
    options.memory = fit.memory;
    return load(a, ctx, path, &options, scene);
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

int app_render_options(const args *a, sf_scene *scene, sf_render_options *options) {
    *options = sf_render_options_default();
    sf_scene_info info;
    if (scene) {
        sf_scene_get_info(scene, &info);
        options->near_plane = (float)(sf_fit_options_default().near_plane * info.extent);
    }
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

int app_names_model(const char *path) {
    const char *dot = strrchr(path, '.');
    return dot && (!strcasecmp(dot, ".ply") || !strcasecmp(dot, ".spz") || !strcasecmp(dot, ".splat") ||
                   !strcasecmp(dot, ".glb") || !strcasecmp(dot, ".gltf") || !strcasecmp(dot, ".sog"));
}

char *app_folder(const char *path) {
    const char *slash = strrchr(path, '/');
    size_t n = slash ? (size_t)(slash - path) + 1 : 0;
    char *folder = malloc(n + 1);
    if (!folder) return NULL;
    memcpy(folder, path, n);
    folder[n] = 0;
    return folder;
}

int app_make_folders(const args *a, const char *path) {
    char *part = malloc(strlen(path) + 1);
    if (!part) return app_say(a, path, "out of memory");
    strcpy(part, path);
    for (char *c = part + 1; *part && *c; c++) {
        if (*c != '/') continue;
        *c = 0;
        if (mkdir(part, 0777) && errno != EEXIST) {
            app_say(a, part, strerror(errno));
            free(part);
            return EXIT_FAILED;
        }
        *c = '/';
    }
    free(part);
    return 0;
}

int app_make_folder(const args *a, const char *path) {
    struct stat st;
    if (!*path) return app_say(a, "\"\"", "is not the name of a folder");
    int error = app_make_folders(a, path);
    if (error) return error;
    if (mkdir(path, 0777) && errno != EEXIST) return app_say(a, path, strerror(errno));
    if (!stat(path, &st) && !S_ISDIR(st.st_mode)) return app_say(a, path, strerror(ENOTDIR));
    return access(path, W_OK | X_OK) ? app_say(a, path, strerror(errno)) : 0;
}

int app_check_output(const args *a, const char *path) {
    struct stat st;
    if (!*path) return app_say(a, "\"\"", "is not the name of a file");
    if (!strcmp(path, "-")) return 0;
    if (!stat(path, &st)) {
        if (S_ISDIR(st.st_mode)) return app_say(a, path, "is a folder");
        if (!S_ISREG(st.st_mode)) return access(path, W_OK) ? app_say(a, path, strerror(errno)) : 0;
    } else if (errno != ENOENT) {
        return app_say(a, path, strerror(errno)); /* its parent is a file, for example */
    } else if (!lstat(path, &st)) {
        return app_say(a, path, "is a symbolic link to nothing");
    }
    char *folder = app_folder(path);
    if (!folder) return app_say(a, path, "out of memory");
    int error = access(*folder ? folder : ".", W_OK | X_OK) ? errno : 0;
    if (error) app_say(a, path, strerror(error));
    free(folder);
    return error ? EXIT_FAILED : 0;
}

const char *app_output(const args *a, const char *name) {
    const char *path = args_value(a, name);
    return path && strcmp(path, "none") ? path : NULL;
}

int app_check_model(const args *a, sf_context *ctx, const char *path) {
    int error = app_check_output(a, path);
    if (error || !sf_model_check_name(ctx, path)) return error;
    app_fail(a, ctx);
    return EXIT_USAGE;
}

int app_check_outputs(const args *a, sf_context *ctx, const char *output, const char *const *names, int n) {
    for (int i = -1; i < n; i++) {
        const char *path = i < 0 ? output : app_output(a, names[i]);
        int error = !path ? 0 : i < 0 ? app_check_model(a, ctx, path) : app_check_output(a, path);
        if (error) return error;
        for (int k = -1; k < i && path; k++) {
            const char *other = k < 0 ? output : app_output(a, names[k]);
            if (!other || strcmp(path, other) || !strcmp(path, "/dev/null")) continue;
            app_say(a, path, "is named for two outputs");
            return EXIT_USAGE;
        }
    }
    return 0;
}

size_t app_pose_header(char line[APP_POSE_LINE]) {
    return (size_t)snprintf(line, APP_POSE_LINE, "# time x y z qx qy qz qw, camera to world\n");
}

size_t app_pose_line(char line[APP_POSE_LINE], double time, const double c[3], const double q[4]) {
    int n = snprintf(line, APP_POSE_LINE, "%.6f %.6f %.6f %.6f %.7f %.7f %.7f %.7f\n", time, c[0], c[1], c[2],
                     q[1], q[2], q[3], q[0]);
    return n < APP_POSE_LINE ? (size_t)n : 0; /* of values beyond all sense */
}

json_t *app_json_text(const char *text) {
    json_t *string = json_string(text);
    if (string) return string;
    char *plain = malloc(strlen(text) + 1);
    if (!plain) return NULL;
    strcpy(plain, text);
    for (char *c = plain; *c; c++)
        if ((unsigned char)*c > 127) *c = '?';
    string = json_string(plain);
    free(plain);
    return string;
}

json_t *app_json_numbers(const double *values, int count) {
    json_t *list = json_array();
    for (int i = 0; i < count; i++) json_array_append_new(list, json_real(values[i]));
    return list;
}

json_t *app_json_pose(const sf_camera *c) {
    return json_pack("{s:o, s:o, s:f, s:f, s:f, s:f, s:i, s:i}", "R_cw", app_json_numbers(c->R_cw, 9), "t_cw",
                     app_json_numbers(c->t_cw, 3), "fx", c->fx, "fy", c->fy, "cx", c->cx, "cy", c->cy,
                     "width", (int)c->width, "height", (int)c->height);
}

int app_rising(const void *a, const void *b) {
    double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

int app_write_json(const args *a, sf_context *ctx, const char *path, json_t *json) {
    char *text = json ? json_dumps(json, JSON_INDENT(1)) : NULL;
    json_decref(json);
    if (!text) return app_say(a, path, "out of memory");
    size_t n = strlen(text);
    text[n] = '\n'; /* in place of the 0 */
    sf_status status = sf_write_file(ctx, path, text, n + 1);
    free(text);
    return status ? app_fail(a, ctx) : 0;
}

static volatile sig_atomic_t stopped_by;
static void (*when_stopped)(void);
static struct timespec when_first; /* the first signal came; written and read in the handler alone */

/* Seconds after the first signal in which another is taken for the same: timeout(1), say, signals the program
 * and then its whole group. */
static const double SAME_SIGNAL = 1;

static void on_signal(int number) {
    struct timespec now;
    clock_gettime(CLOCK_MONOTONIC, &now);
    if (!stopped_by) {
        stopped_by = number;
        when_first = now;
        if (when_stopped) when_stopped();
    } else if ((double)(now.tv_sec - when_first.tv_sec) + 1e-9 * (double)(now.tv_nsec - when_first.tv_nsec) >
               SAME_SIGNAL) {
        signal(number, SIG_DFL);
        raise(number);
    }
}

/* The handler is not interrupted by another of these, so what it keeps needs no lock. */
static struct sigaction caught_action(void) {
    struct sigaction action = {.sa_handler = on_signal, .sa_flags = SA_RESTART};
    sigemptyset(&action.sa_mask);
    sigaddset(&action.sa_mask, SIGINT);
    sigaddset(&action.sa_mask, SIGTERM);
    sigaddset(&action.sa_mask, SIGHUP);
    return action;
}

void app_catch_signals(void (*fn)(void)) {
    const struct sigaction action = caught_action();
    when_stopped = fn;
    sigaction(SIGINT, &action, NULL);
    sigaction(SIGTERM, &action, NULL);
    struct sigaction before;
    if (!sigaction(SIGHUP, NULL, &before) && before.sa_handler != SIG_IGN) /* under nohup it goes on */
        sigaction(SIGHUP, &action, NULL);
}

int app_stopped_by(void) { return stopped_by; }

static sf_context *volatile loads; /* the context that loads a scene */

static void cancel_loads(void) { sf_scene_cancel_loads(loads); }

/* A signal ends the program as if it were not caught, but after the load, which leaves no unpacked archive.
 */
static int load(const args *a, sf_context *ctx, const char *path, const sf_load_options *options,
                sf_scene **scene) {
    enum { CAUGHT = 3 };
    static const int caught[CAUGHT] = {SIGINT, SIGTERM, SIGHUP};
    const struct sigaction action = caught_action();
    struct sigaction before[CAUGHT];
    loads = ctx;
    when_stopped = cancel_loads;
    for (int i = 0; i < CAUGHT; i++)
        if (!sigaction(caught[i], NULL, &before[i]) && before[i].sa_handler != SIG_IGN)
            sigaction(caught[i], &action, NULL);
    sf_status status = sf_scene_load(ctx, path, options, scene);
    for (int i = 0; i < CAUGHT; i++) sigaction(caught[i], &before[i], NULL);
    when_stopped = NULL;
    if (stopped_by) raise(stopped_by);
    return status ? app_fail(a, ctx) : 0;
}

double app_seconds(void) {
    struct timespec t;
    clock_gettime(CLOCK_MONOTONIC, &t);
    return (double)t.tv_sec + 1e-9 * (double)t.tv_nsec;
}

double app_peak_memory(void) {
    struct rusage usage;
    return getrusage(RUSAGE_SELF, &usage) ? 0 : (double)usage.ru_maxrss / 1024;
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
