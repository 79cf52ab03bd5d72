/* live.c - splatfit live: fits the scene in front of a camera. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

#include "live.h"
#include "live_progress.h"
#include "live_source.h"

static const arg_option own_options[] = {
    {"output", 'o', "FILE",
     "the model to write: a .ply, .spz, .splat, .glb or .sog; written every --save-every and at the end"},
    {"seconds", 0, "S",
     "end after S seconds, for which the schedule is planned; default: no end, until Ctrl-C"},
    {"board", 0, "NAME",
     "take poses from a board of AprilTags: a4-36h11, letter-36h11, a3-36h11 or a board's .json (a4-36h11)"},
    {"tag-size", 0, "MM",
     "the measured side of the board's black squares, if it was printed at another scale"},
    {"poses", 0, "FROM",
     "where poses come from: pictures (the pictures alone); board (see --board); frames (the frames' own, as "
     "simulated cameras have); file:PATH, unix:PATH or udp:ADDRESS:PORT with lines of time x y z qx qy qz "
     "qw, "
     "camera to world; default: a board if one is seen, else pictures"},
    {"scale", 0, "S",
     "with poses from pictures alone: the distance from the first camera to what it sees, in the unit that "
     "is "
     "wanted (1); a board that is seen later makes the unit metres"},
    {"pose-sigma", 0, "DEG,UNITS",
     "standard deviations of poses from outside: degrees, world units; default: 0.57 degrees and 0.01 of the "
     "distance to the scene"},
    {"lens", 0, "FILE",
     "the camera's calibration (of splatfit calibrate, OpenCV, COLMAP); find: find it from the pictures, "
     "even "
     "where the source tells one; default: as the source tells, else found"},
    {"downscale", 0, "N",
     "box-average the frames by N, 1..16 (1; of folders so that no side is longer than 640 px)"},
    {"track-rate", 0, "HZ", "most frames to track in a second (12; of a video's own seconds 15)"},
    {"keyframe-gap", 0, "X",
     "a frame becomes a keyframe where, compared with every keyframe, the camera has moved by this fraction "
     "of the distance to the scene or turned by this angle in rad, 0.001..1; the first 60 need less (0.07)"},
    {"steps-per-frame", 0, "N",
     "for a source that is not in real time: track every frame and do N training steps after each; such a "
     "run can be repeated; 0: as time allows (0; of videos and folders 6, unless --seconds is given)"},
    {"keyframes", 0, "N", "most keyframes (300)"},
    {"thermal", 0, "DIR",
     "folder of the kernel's thermal state; while the kernel throttles the processor, the fit rests for a "
     "part of the time; none: do not check (/sys)"},
    {"save-every", 0, "S", "seconds between two writings of the model; 0: only at the end (60)"},
    {"trajectory", 0, "FILE",
     "write the camera's path: time x y z qx qy qz qw a line, camera to world (TUM)"},
    {"cameras", 0, "FILE|PROJECT",
     "write the keyframes' cameras, as refined, at the end: to this cameras.json, or with points and "
     "pictures as "
     "a COLMAP project, which fit reads; none: write no such file"},
    {"listen", 0, "ADDRESS:PORT",
     "serve a page with pictures, figures and the model there; none: serve no page (127.0.0.1:8090 where "
     "that is free)"},
    {"token", 0, "TEXT",
     "a secret that the page's address must contain; default: random, but no token on a loopback address"},
    {"log", 0, "FILE", "write the options, the progress over time and the result as JSON"},
    {"progress", 0, "auto|plain|json|none", "auto, plain, json (one object a line) or none (auto)"},
    {0},
};

/* What lies on the simulated table. */
#define SIMULATED       "sim:studio-board"
#define SIMULATED_BOARD "a3-36h11"
#define SIMULATED_TAG_M 0.08

typedef struct live_run {
    const args *a;
    const char *output, *project; /* project NULL: none is written */
    double seconds, save_every, next_save, tag_size, track_rate, gap, scale;
    int downscale, keyframes, per_frame;
    sf_context *ctx, *source_ctx;
    sf_source *source;
    sf_board *board;
    sf_path *path;
    double sigma_degrees, sigma_units; /* of its poses; 0: not told */
    uint64_t asked, found;             /* frames, and those that the path had a pose for */
    int64_t first_ns, last_ns;         /* of them */
    sf_live_options options;
    sf_live *live;
    progress_line line;
    live_path tracked;
    json_t *curve;
    double next_sample;
    page page;
    int stopped;
} live_run;

/* The fit that a signal stops. */
static sf_live *volatile running;

static void cancel(void) {
    if (running) sf_live_cancel(running);
}

/* 1. The command line */

static int usage(const char *option, const char *value, const char *what) {
    args_error(&command_live, "%s: \"%s\" %s", option, value, what);
    return EXIT_USAGE;
}

static int read_real(const live_run *r, const char *name, double least, double most, double *value) {
    const char *text = args_value(r->a, name);
    char *end, option[32], what[64];
    if (!text) return 0;
    double read = strtod(text, &end);
    if (end != text && !*end && read >= least && read <= most) {
        *value = read;
        return 0;
    }
    snprintf(option, sizeof option, "--%s", name);
    snprintf(what, sizeof what, "is not a number in %g..%g", least, most);
    return usage(option, text, what);
}

static int read_options(live_run *r) {
    r->save_every = 60, r->downscale = 1, r->keyframes = 300, r->track_rate = 12, r->gap = 0.07;
    int error = read_real(r, "seconds", 0.1, 1e7, &r->seconds);
    if (!error) error = read_real(r, "save-every", 0, 1e7, &r->save_every);
    if (!error) error = read_real(r, "tag-size", 1, 1e4, &r->tag_size);
    if (!error) error = read_real(r, "track-rate", 0.1, 1000, &r->track_rate);
    if (!error) error = read_real(r, "keyframe-gap", 0.001, 1, &r->gap);
    if (!error) error = read_real(r, "scale", 1e-9, 1e9, &r->scale);
    if (!error) error = args_int(r->a, "downscale", 1, 16, &r->downscale);
    if (!error) error = args_int(r->a, "keyframes", 8, 100000, &r->keyframes);
    if (!error) error = args_int(r->a, "steps-per-frame", 0, 1000000, &r->per_frame);
    if (!error && args_value(r->a, "time_limit"))
        error = usage("--time-limit", args_value(r->a, "time_limit"), "is --seconds here");
    return error;
}

enum { ASKED_ENOUGH = 30, FEW_FOUND = 10 /* fewer than one in so many */ };

/* Of a path whose poses are of other times than nearly all frames. text: "" where that is not so. */
static void describe_times(const live_run *r, char *text, size_t size) {
    sf_path_info info = {.poses = 0};
    *text = 0;
    if (!r->path || !r->asked || FEW_FOUND * r->found >= r->asked) return;
    sf_path_describe(r->path, &info);
    if (info.poses)
        snprintf(
            text, size,
            "%llu of %llu frames, of %.3f to %.3f s, have a pose: the poses are of %.3f to %.3f s, where "
            "seconds of the frames' clock are wanted (?offset=S in their name adds S)",
            (unsigned long long)r->found, (unsigned long long)r->asked, 1e-9 * (double)r->first_ns,
            1e-9 * (double)r->last_ns, 1e-9 * (double)info.first_ns, 1e-9 * (double)info.last_ns);
}

static void count_pose(live_run *r, int64_t time_ns, int found) {
    char text[256];
    if (!r->asked++) r->first_ns = time_ns;
    r->last_ns = time_ns;
    r->found += found != 0;
    if (r->asked != ASKED_ENOUGH || args_value(r->a, "quiet")) return;
    describe_times(r, text, sizeof text);
    if (*text) fprintf(stderr, "warning: %s: %s\n", args_value(r->a, "poses"), text);
}

/* As sf_pose_fn. */
static sf_status pose_at(void *user, int64_t time_ns, double R_cw[9], double t_cw[3],
                         double information[36]) {
    live_run *r = user;
    double turn = r->sigma_degrees / 57.29577951308232;
    for (int i = 0; i < 36; i++) information[i] = 0;
    for (int i = 0; i < 6 && turn > 0; i++)
        information[7 * i] = i < 3 ? pow(r->sigma_units, -2) : pow(turn, -2);
    sf_status status = sf_path_at(r->path, time_ns, R_cw, t_cw);
    count_pose(r, time_ns, !status);
    return status;
}

static int open_path(live_run *r, const char *name) {
    const char *sigma = args_value(r->a, "pose-sigma");
    char rest;
    if (sigma &&
        (sscanf(sigma, "%lf,%lf%c", &r->sigma_degrees, &r->sigma_units, &rest) != 2 ||
         !(r->sigma_degrees > 0 && r->sigma_units > 0 && isfinite(r->sigma_degrees + r->sigma_units))))
        return usage("--pose-sigma", sigma, "is not DEGREES,UNITS, both above 0");
    if (sf_path_open(r->ctx, name, &r->path)) return app_fail(r->a, r->ctx);
    r->options.pose = pose_at;
    r->options.pose_user = r;
    return 0;
}

static int read_poses(live_run *r) {
    const char *from = args_value(r->a, "poses"), *board = args_value(r->a, "board");
    double tag_m = r->tag_size / 1000;
    r->options.from_pictures = !from || !strcmp(from, "pictures");
    if (from && !strcmp(from, "frames"))
        r->options.own_poses = 1;
    else if (from && strchr(from, ':')) {
        int error = open_path(r, from);
        if (error) return error;
    } else if (from && strcmp(from, "board") != 0 && strcmp(from, "pictures") != 0)
        return usage("--poses", from, "is none of pictures, board, frames, file:..., unix:..., udp:...");
    if (from && strcmp(from, "board") != 0 && !board) return 0;
    if (!board && !strncmp(r->a->positional[0], SIMULATED, strlen(SIMULATED)))
        board = SIMULATED_BOARD, tag_m = SIMULATED_TAG_M;
    if (sf_board_open(r->ctx, board ? board : "a4-36h11", tag_m, &r->board)) return app_fail(r->a, r->ctx);
    r->options.board = r->board;
    return 0;
}

static int read_thermal(live_run *r) {
    const char *folder = args_value(r->a, "thermal");
    struct stat st;
    if (!folder) return 0;
    if (!strcmp(folder, "none"))
        r->options.thermal = NULL;
    else if (stat(folder, &st) || !S_ISDIR(st.st_mode))
        return usage("--thermal", folder, "is neither a folder nor none");
    else
        r->options.thermal = folder;
    return 0;
}

static int open_source(live_run *r) {
    int error = app_context(r->a, &r->source_ctx); /* its own: it fails on another thread */
    if (!error) error = live_open_source(r->a, r->source_ctx, &r->options, &r->source);
    return error;
}

/* Where nobody asked for a board, a build that finds none starts from pictures. */
static int create(live_run *r) {
    sf_status status = sf_live_create(r->ctx, r->source, &r->options, &r->live);
    if (status == SF_ERR_UNSUPPORTED && r->options.from_pictures && !args_value(r->a, "board")) {
        r->options.board = NULL;
        status = sf_live_create(r->ctx, r->source, &r->options, &r->live);
    }
    return status ? app_fail(r->a, r->ctx) : 0;
}

/* The project is a folder, and any cameras.json a file as the others are. */
static int check_outputs(const live_run *r) {
    static const char *const outputs[] = {"trajectory", "log", "cameras"};
    int error = app_check_outputs(r->a, r->ctx, r->output, outputs, r->project ? 2 : 3);
    return !error && r->project ? live_check_project(r->a, r->project) : error;
}

static int prepare(live_run *r) {
    int error = app_context(r->a, &r->ctx);
    if (!error) error = read_options(r);
    r->options = sf_live_options_default();
    if (!error) error = app_fit_options(r->a, r->ctx, &r->options.fit);
    r->options.fit.time_limit = r->seconds;
    r->options.downscale = r->downscale;
    r->options.track_rate = r->track_rate;
    r->options.keyframe_gap = r->gap;
    r->options.keyframes_most = r->keyframes;
    r->options.scale = r->scale;
    r->options.steps_per_frame = r->per_frame;
    if (!error) error = read_thermal(r);
    if (!error) error = progress_start(&r->line, r->a, stdout);
    r->project = live_project(r->a);
    if (!error) error = check_outputs(r);
    if (!error) error = read_poses(r);
    if (!error) error = open_source(r);
    if (!error) error = create(r);
    if (!error) error = page_open(&r->page, r->a, r->ctx);
    return error;
}

/* 2. What is written */

static int save_model(live_run *r) {
    sf_model *model = NULL;
    sf_similarity world;
    sf_status status = sf_live_snapshot(r->live, &model);
    if (!status && !sf_live_get_world(r->live, &world)) status = sf_model_transform(model, &world);
    if (!status) status = app_save_model(r->a, model, r->output);
    sf_model_destroy(&model);
    if (!status) return 0;
    progress_break(&r->line);
    return app_fail(r->a, r->ctx);
}

static void save_now_and_then(live_run *r, const sf_live_progress *p) {
    if (!(r->save_every > 0) || !p->has_fit || p->seconds < r->next_save) return;
    if (r->next_save > 0) (void)save_model(r); /* said; the next one may do better */
    r->next_save = p->seconds + r->save_every;
}

static json_t *log_json(live_run *r, const sf_live_progress *p) {
    path_error error;
    json_t *result = live_progress_json(p);
    json_object_set_new(result, "peak_memory_mb", json_real(app_peak_memory()));
    if (path_compare(&r->tracked, p->own_world, &error)) {
        json_object_set_new(result, "pose_error_degrees", json_real(error.degrees));
        json_object_set_new(result, "pose_error_distance", json_real(error.distance));
        if (p->own_world) json_object_set_new(result, "similarity", path_similarity_json(&error));
    }
    json_t *keyframes;
    if (keyframes_compare(r->live, p->own_world, &error, &keyframes)) {
        json_object_set_new(result, "keyframe_error_degrees", json_real(error.degrees));
        json_object_set_new(result, "keyframe_error_distance", json_real(error.distance));
    }
    json_object_set_new(result, "keyframe_errors", keyframes);
    return json_pack("{s:s, s:s, s:i, s:o, s:o, s:O, s:o}", "version", sf_version(), "isa",
                     sf_context_isa(r->ctx), "threads", sf_context_threads(r->ctx), "source",
                     app_json_text(r->a->positional[0]), "options", app_options_json(&r->options.fit),
                     "curve", r->curve, "result", result);
}

static void print_own_world(const live_run *r, const sf_live_progress *p) {
    sf_similarity world;
    if (!sf_live_get_world(r->live, &world))
        printf("unit and frame are those of the board");
    else if (r->scale > 0)
        printf("the first camera was %g units from what it saw", r->scale);
    else
        printf("the unit is the distance from the first camera to what it saw");
    printf("; focal length %.1f px\n", p->focal_length);
}

static void print_result(const live_run *r, const sf_live_progress *p) {
    path_error error;
    if (args_value(r->a, "quiet") || r->line.kind == PROGRESS_JSON) return;
    printf("%s after %.1f s: %llu frames looked at, %llu with a pose, lost %llu times; %zu keyframes, %zu of "
           "them held out\n",
           r->stopped ? "stopped" : "done", p->seconds, (unsigned long long)p->looked_at,
           (unsigned long long)p->tracked, (unsigned long long)p->lost, p->keyframes, p->held_out);
    if (p->has_fit)
        printf("wrote %s: %zu Gaussians after %lld steps (peak memory %.0f MB)\n", r->output,
               p->fit.gaussians, (long long)p->fit.step, app_peak_memory());
    if (isfinite(p->held_out_psnr))
        printf("held out, at the poses as tracked: PSNR %.2f dB (with exposure corrected: %.2f dB)\n",
               p->held_out_psnr, p->held_out_psnr_corrected);
    if (p->own_world) print_own_world(r, p);
    if (path_compare(&r->tracked, p->own_world, &error))
        printf("poses against the frames' own%s, medians: %.3f degrees, %.4g off\n",
               p->own_world ? " (after the similarity that fits best)" : "", error.degrees, error.distance);
    if (keyframes_compare(r->live, p->own_world, &error, NULL))
        printf("keyframes the same, medians: %.3f degrees, %.4g off; at most %.3f degrees, %.4g\n",
               error.degrees, error.distance, error.most_degrees, error.most_distance);
}

static int say_no_model(const live_run *r, const sf_live_progress *p) {
    char times[256];
    describe_times(r, times, sizeof times);
    if (*times) return app_say(r->a, args_value(r->a, "poses"), times);
    return app_say(r->a, r->a->positional[0],
                   p->looked_at ? "no model: no pose was found from enough places: move sideways before "
                                  "something with depth, "
                                  "show it a board (splatfit board), or give --poses"
                                : "no frame came: is the camera there, and free? (splatfit devices)");
}

/* The model first, whatever comes after. */
static int finish(live_run *r) {
    page_close(&r->page);
    sf_live_progress p;
    sf_live_get_progress(r->live, &p);
    const char *cameras = app_output(r->a, "cameras"), *log = app_output(r->a, "log");
    int error = 0;
    if (p.has_fit)
        error = save_model(r);
    else
        error = say_no_model(r, &p);
    if (!error) print_result(r, &p);
    int written = path_write(&r->tracked, r->a, r->ctx, r->live);
    if (!error) error = written;
    if (!error && r->project && sf_live_save_project(r->live, r->project)) error = app_fail(r->a, r->ctx);
    if (!error && cameras && !r->project &&
        sf_live_save_cameras(r->live, cameras, args_value(r->a, "world") != NULL))
        error = app_fail(r->a, r->ctx);
    if (log) {
        written = app_write_json(r->a, r->ctx, log, log_json(r, &p));
        if (!error) error = written;
    }
    return !error && r->stopped ? 128 + r->stopped : error;
}

/* The page's buttons. A model that cannot be written is said, and the fit goes on. */
static void obey(live_run *r) {
    switch (page_command(&r->page)) {
    case PAGE_PAUSE:
        sf_live_pause(r->live, 1);
        break;
    case PAGE_GO_ON:
        sf_live_pause(r->live, 0);
        break;
    case PAGE_SAVE:
        (void)save_model(r);
        break;
    case PAGE_RESET:
        sf_live_reset(r->live);
        break;
    case PAGE_LOCK:
        sf_live_lock_exposure(r->live, 1);
        break;
    case PAGE_UNLOCK:
        sf_live_lock_exposure(r->live, 0);
        break;
    case PAGE_NOTHING:
        break;
    }
}

static int loop(live_run *r) {
    for (;;) {
        sf_live_progress p;
        sf_status status = sf_live_step(r->live);
        int error = path_note(&r->tracked, r->a, r->live);
        sf_live_get_progress(r->live, &p);
        live_show(&r->line, &p, status != SF_OK);
        if (p.seconds >= r->next_sample) {
            json_array_append_new(r->curve, live_progress_json(&p));
            r->next_sample = p.seconds + 0.5;
        }
        if (status == SF_ERR_CANCELLED) r->stopped = app_stopped_by();
        if (status) progress_break(&r->line);
        if (status && status != SF_ERR_END && status != SF_ERR_CANCELLED) error = app_fail(r->a, r->ctx);
        if (status || error) return error;
        obey(r);
        if (page_due(&r->page, p.seconds)) page_show(&r->page, r->live, live_progress_json(&p));
        save_now_and_then(r, &p);
    }
}

static int run(const args *a) {
    const char *output = args_value(a, "output");
    live_run r = {.a = a, .output = output ? output : "scene.ply", .curve = json_array()};
    int error = prepare(&r);
    if (!error) {
        running = r.live;
        app_catch_signals(cancel);
        error = loop(&r);
        int saved = finish(&r); /* also after a failure: what was fitted so far is kept */
        if (!error) error = saved;
    }
    running = NULL;
    sf_live_destroy(&r.live);
    sf_source_close(&r.source);
    sf_board_close(&r.board);
    sf_path_close(&r.path);
    page_close(&r.page);
    path_free(&r.tracked);
    json_decref(r.curve);
    sf_context_destroy(&r.source_ctx);
    sf_context_destroy(&r.ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, world_options, common_options, NULL};

const command command_live = {
    .name = "live",
    .synopsis = "SOURCE -o scene.ply [OPTIONS]",
    .summary =
        "Fits the scene in front of a camera while it moves. SOURCE is v4l2:/dev/video0, libcamera:0, a "
        "pipe:, a simulated camera (splatfit capture --help), a video that ffmpeg reads or a folder of "
        "frames "
        "in order. SIGINT and SIGTERM end it "
        "and write the model. Defaults of a live fit that differ from splatfit fit: exposure 1, "
        "validate 0, size cap, max_gaussians 40000.",
    .tables = tables,
    .least = 1,
    .most = 1,
    .with_fit_options = 1,
    .run = run,
};
