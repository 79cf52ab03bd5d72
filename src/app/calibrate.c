/* calibrate.c - splatfit calibrate: a camera's lens from frames of a board of AprilTags. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "app.h"

static const arg_option own_options[] = {
    {"board", 0, "NAME", "a4-36h11, letter-36h11, a3-36h11, or a description, FILE.json (a4-36h11)"},
    {"tag-size", 0, "MM",
     "the measured side of a tag's black square, mm; default: as in the board's description"},
    {"output", 'o', "FILE", "write the calibration, JSON"},
    {"frames", 0, "N", "use at most N frames; default: all; of a live source, until its views suffice"},
    {"fix-aspect", 0, NULL, "one focal length: fx = fy"},
    {"fix-center", 0, NULL, "the principal point is the picture's middle"},
    {"radial", 0, "N", "0: no radial distortion, 1: k1, 2: k1 and k2 (2)"},
    {"no-tangential", 0, NULL, "no tangential distortion: p1 = p2 = 0"},
    {"decimate", 0, "N", "search for tags in pictures reduced by N, 1..8: faster (1)"},
    {"convert", 0, "FILE", "instead: read OpenCV's YAML, COLMAP's cameras or JSON, and write it with -o"},
    {0},
};

enum { WAIT_MS = 200, WAIT_S = 30 };

typedef struct attempt {
    const args *a;
    const char *source_name;
    int frames_most, decimate; /* 0: no limit */
    double tag_size;           /* m; 0: the board's */
    sf_calibrate_options options;
    sf_context *ctx;
    sf_source *source;
    sf_source_info info;
    sf_detector *detector;
    sf_observations *observations; /* from the first frame on */
    int32_t width, height;         /* px */
    size_t frames, with_board, damaged;
    sf_board_corner *before; /* of the last frame, while the source is live */
    size_t before_count;
    progress_line line;
    double began, last_frame; /* on the monotonic clock, s */
} attempt;

/* 1. The command line */

static int read_tag_size(attempt *s) {
    const char *text = args_value(s->a, "tag-size");
    char *end;
    if (!text) return 0;
    s->tag_size = strtod(text, &end) / 1e3;
    if (end != text && !*end && s->tag_size >= 0.001 && s->tag_size <= 10) return 0;
    args_error(s->a->command, "--tag-size: \"%s\" is not a number of millimetres in 1..10000", text);
    return EXIT_USAGE;
}

static int read_options(attempt *s) {
    const args *a = s->a;
    s->options = sf_calibrate_options_default();
    s->options.fix_aspect = args_value(a, "fix-aspect") != NULL;
    s->options.fix_center = args_value(a, "fix-center") != NULL;
    s->options.tangential = args_value(a, "no-tangential") == NULL;
    s->decimate = 1;
    int error = args_int(a, "radial", 0, 2, &s->options.radial);
    if (!error) error = args_int(a, "decimate", 1, 8, &s->decimate);
    if (!error) error = args_int(a, "frames", 1, 100000000, &s->frames_most);
    return error ? error : read_tag_size(s);
}

static int fail(const attempt *s, sf_status status) {
    app_fail(s->a, s->ctx);
    return status == SF_ERR_ARGUMENT ? EXIT_USAGE : EXIT_FAILED;
}

static int open_all(attempt *s) {
    const char *name = args_value(s->a, "board");
    sf_board *board = NULL;
    sf_status status = sf_board_open(s->ctx, name ? name : "a4-36h11", s->tag_size, &board);
    if (!status) status = sf_detector_create(s->ctx, board, s->decimate, &s->detector);
    size_t corners = board ? 4 * board->count : 0;
    sf_board_close(&board);
    if (!status) status = sf_source_open(s->ctx, s->source_name, &s->source);
    if (status) return fail(s, status);
    s->before = calloc(corners, sizeof *s->before);
    if (!s->before) return app_say(s->a, "board", "out of memory");
    sf_source_describe(s->source, &s->info);
    return 0;
}

/* 2. Frames */

static void show(attempt *s, int at_once) {
    char text[192];
    double seconds = app_seconds() - s->began;
    if (!progress_due(&s->line, seconds, at_once)) return;
    const char *advice = s->observations ? sf_observations_advice(s->observations) : NULL;
    snprintf(text, sizeof text, "frames %zu  with board %zu  views %zu  coverage %.0f %%%s%s", s->frames,
             s->with_board, s->observations ? sf_observations_count(s->observations) : 0,
             s->observations ? 100 * sf_observations_coverage(s->observations) : 0, advice ? "  " : "",
             advice ? advice : "");
    progress_text(&s->line, text);
}

/* Of a camera in use: whether the board stood still since the frame before, to 1/300 of the picture's width.
 * A moving one is blurred, and bent by a shutter that rolls. */
static int stands_still(attempt *s, const sf_board_corner *corners, size_t count) {
    double most = 0;
    int still = count == s->before_count;
    for (size_t i = 0; i < count && still; i++) {
        const sf_board_corner *b = &s->before[i];
        still = b->id == corners[i].id;
        most = fmax(most, hypot(b->pixel[0] - corners[i].pixel[0], b->pixel[1] - corners[i].pixel[1]));
    }
    memcpy(s->before, corners, count * sizeof *corners);
    s->before_count = count;
    return still && most < s->width / 300.0;
}

static sf_status look_at(attempt *s, const sf_frame *frame) {
    const sf_board_corner *corners;
    size_t count;
    int taken;
    if (!s->observations) {
        s->width = frame->width;
        s->height = frame->height;
        sf_status status = sf_observations_create(s->ctx, frame->width, frame->height, &s->observations);
        if (status) return status;
    }
    s->frames++;
    sf_status status = sf_detector_find_in_frame(s->detector, frame, &corners, &count);
    if (status == SF_ERR_FORMAT) { /* a JPEG that was cut off: the next one may be whole */
        s->damaged++;
        return SF_OK;
    }
    s->with_board += count > 0;
    if (status || (s->info.live && !stands_still(s, corners, count))) return status;
    return sf_observations_offer(s->observations, corners, count, &taken);
}

static int wrong_size(const attempt *s, const sf_frame *frame) {
    char text[128];
    if (!s->observations || (frame->width == s->width && frame->height == s->height)) return 0;
    snprintf(text, sizeof text, "frame %zu: %d x %d px after frames of %d x %d: one camera, one size",
             s->frames, (int)frame->width, (int)frame->height, (int)s->width, (int)s->height);
    return app_say(s->a, s->source_name, text);
}

static int wants_more(const attempt *s) {
    if (app_stopped_by() || (s->frames_most && s->frames >= (size_t)s->frames_most)) return 0;
    return !(s->info.live && s->observations && !sf_observations_advice(s->observations));
}

/* One frame, or a while without one. *over: there will be none. 0 or an exit code. */
static int take_one(attempt *s, int *over) {
    sf_frame frame;
    sf_status status = sf_source_newest(s->source, WAIT_MS, &frame);
    *over = status == SF_ERR_END;
    if (*over) return 0;
    if (status == SF_ERR_TIMEOUT)
        return app_seconds() - s->last_frame < WAIT_S
                   ? 0
                   : app_say(s->a, s->source_name,
                             "no frame for 30 s: is the camera there, and free? (splatfit devices)");
    if (status) return app_fail(s->a, s->ctx);
    s->last_frame = app_seconds();
    int error = wrong_size(s, &frame);
    if (!error && look_at(s, &frame)) error = app_fail(s->a, s->ctx);
    sf_source_release(s->source, &frame);
    return error;
}

static int take_frames(attempt *s) {
    int error = 0, over = 0;
    s->began = s->last_frame = app_seconds();
    while (!error && !over && wants_more(s)) {
        error = take_one(s, &over);
        show(s, 0);
    }
    if (!error) show(s, 1);
    progress_break(&s->line);
    return error;
}

/* 3. What came out */

static void print_parameter(const char *name, double value, double sigma, const char *unit, int decimals) {
    printf("%s  %12.*f", name, decimals, value);
    if (sigma > 0)
        printf(" +- %.*f", decimals, sigma);
    else if (value == 0)
        printf("   not estimated");
    printf("%s%s\n", *unit ? " " : "", sigma > 0 || value != 0 ? unit : "");
}

static void print_lens(const sf_calibration *c) {
    const sf_lens *l = &c->lens, *d = &c->sigma;
    printf("camera of %d x %d px\n", (int)c->width, (int)c->height);
    print_parameter("fx", l->fx, d->fx, "px", 3);
    print_parameter("fy", l->fy, d->fy, "px", 3);
    print_parameter("cx", l->cx, d->cx, "px", 3);
    print_parameter("cy", l->cy, d->cy, "px", 3);
    print_parameter("k1", l->k1, d->k1, "", 6);
    print_parameter("k2", l->k2, d->k2, "", 6);
    print_parameter("p1", l->p1, d->p1, "", 6);
    print_parameter("p2", l->p2, d->p2, "", 6);
    if (l->k3 != 0) print_parameter("k3", l->k3, d->k3, "", 6); /* of a file; never estimated */
}

static void print_fit(const attempt *s, const sf_calibration *c) {
    printf("reprojection error %.3f px rms; worst view %.3f px\n", c->rms, c->worst_rms);
    printf("%zu views of %zu frames with the board, %zu rejected; %zu corners, %zu rejected\n", c->views,
           s->with_board, c->views_rejected, c->corners, c->corners_rejected);
    printf("coverage %.0f %% of 8 x 6 cells; tilts of up to %.0f degrees\n", 100 * c->coverage, c->tilt_most);
}

/* Standard output is the calibration's where that goes there. */
static int is_silent(const args *a) {
    const char *path = args_value(a, "output");
    return args_value(a, "quiet") || (path && !strcmp(path, "-"));
}

static int save(const args *a, sf_context *ctx, const sf_calibration *c) {
    const char *path = args_value(a, "output");
    if (!path) return 0;
    if (sf_calibration_save(ctx, c, path)) return app_fail(a, ctx);
    if (!is_silent(a)) printf("wrote %s\n", path);
    return 0;
}

static int conclude(attempt *s) {
    sf_calibration c;
    if (!s->with_board)
        return app_say(s->a, s->source_name,
                       "no frame shows a tag of the board: is --board the one that was printed?");
    if (sf_calibrate(s->observations, &s->options, &c)) return app_fail(s->a, s->ctx);
    if (!is_silent(s->a)) {
        print_lens(&c);
        print_fit(s, &c);
        const char *advice = sf_observations_advice(s->observations);
        if (advice) printf("would be better: %s\n", advice);
        if (s->damaged) printf("%zu frames could not be decoded\n", s->damaged);
    }
    return save(s->a, s->ctx, &c);
}

static int calibrate(attempt *s) {
    int error = open_all(s);
    if (!error) {
        app_catch_signals(NULL);
        error = take_frames(s);
    }
    return error ? error : conclude(s);
}

static int convert(const attempt *s, const char *path) {
    sf_calibration c;
    if (sf_calibration_load(s->ctx, path, &c)) return app_fail(s->a, s->ctx);
    if (!is_silent(s->a)) print_lens(&c);
    return save(s->a, s->ctx, &c);
}

static int run(const args *a) {
    attempt s = {.a = a, .source_name = a->positional[0]};
    const char *path = args_value(a, "convert");
    if (!path == !s.source_name) {
        app_say(a, "SOURCE, --convert FILE", "one of the two is needed");
        return EXIT_USAGE;
    }
    int error = read_options(&s);
    if (!error) error = progress_start(&s.line, a, is_silent(a) ? stderr : stdout);
    if (!error && args_value(a, "output")) error = app_check_output(a, args_value(a, "output"));
    if (!error) error = app_context(a, &s.ctx);
    if (!error) error = path ? convert(&s, path) : calibrate(&s);
    free(s.before);
    sf_observations_destroy(&s.observations);
    sf_detector_destroy(&s.detector);
    sf_source_close(&s.source);
    sf_context_destroy(&s.ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, common_options, NULL};

const command command_calibrate = {
    .name = "calibrate",
    .synopsis = "SOURCE [-o camera.json] [OPTIONS]",
    .summary =
        "Calibrates a camera by frames of a board that splatfit board draws. SOURCE as for capture; says "
        "what "
        "is missing while it looks, and ends with the source, or, where it is live, when the views suffice, "
        "or by SIGINT. src/pose/README.md tells how to hold the board.",
    .tables = tables,
    .least = 0,
    .most = 1,
    .run = run,
};
