/* capture.c - splatfit capture: from a camera or another source of frames to a folder of pictures. */
#include <errno.h>
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "record.h"

static const arg_option own_options[] = {
    {"output", 'o', "DIR", "the folder to write: DIR/images, DIR/frames.json"},
    {"frames", 0, "N", "end after N pictures; default: when the source ends, or on Ctrl-C"},
    {"seconds", 0, "S", "end after S seconds of frames"},
    {"every", 0, "N", "keep one of every N frames (1)"},
    {"sharpest", 0, NULL, "keep the sharpest of every N frames, not the first"},
    {"format", 0, "jpg|png|raw",
     "jpg (frames that come as JPEG are written unchanged), png, or raw: the frame's own bytes (jpg)"},
    {"quality", 0, "Q", "quality of JPEGs that are encoded here, 1..100 (95)"},
    {"downscale", 0, "N", "box-average the pictures by N, 1..64 (1)"},
    {"lens", 0, "FILE",
     "the camera's calibration (of splatfit calibrate, OpenCV, COLMAP), written to frames.json"},
    {"wait", 0, "S", "give up after S seconds without a frame (30)"},
    {"force", 0, NULL, "write over an older recording in DIR"},
    {0},
};

/* How long one wait for a frame lasts: so soon is Ctrl-C noticed. */
enum { WAIT_MS = 200 };

/* What one run of the command holds. */
typedef struct capture {
    const args *a;
    record_options options;
    double seconds; /* of frames; 0: no limit */
    int wait;       /* s */
    json_t *lens;
    sf_context *ctx;
    sf_source *source;
    record *record;
    progress_line line;
    double began, first_frame, last_frame; /* on the monotonic clock, s */
    int64_t first_ns;                      /* of the first frame */
    uint64_t taken;
    char error[1024]; /* why the source ended; "": it did not fail */
} capture;

/* 1. The command line */

static int usage(const char *option, const char *what) {
    args_error(&command_capture, "%s: %s", option, what);
    return EXIT_USAGE;
}

static int read_seconds(capture *c) {
    const char *text = args_value(c->a, "seconds");
    char *end;
    if (!text) return 0;
    c->seconds = strtod(text, &end);
    if (end != text && !*end && c->seconds > 0 && c->seconds <= 1e9) return 0;
    return args_error(&command_capture, "--seconds: \"%s\" is not a number above 0", text), EXIT_USAGE;
}

static int read_format(capture *c) {
    static const char *const names[] = {"jpg", "png", "raw"};
    const char *text = args_value(c->a, "format");
    int format = 0;
    while (text && format < 3 && strcmp(text, names[format]) != 0) format++;
    if (format == 3) return usage("--format", "none of jpg, png, raw");
    c->options.format = (record_format)format;
    if (format != RECORD_JPG && args_value(c->a, "quality")) return usage("--quality", "is for --format jpg");
    if (format == RECORD_RAW && c->options.downscale > 1)
        return usage("--downscale", "cannot be given beside --format raw");
    return 0;
}

static int read_options(capture *c) {
    const args *a = c->a;
    int frames = 0;
    c->options = (record_options){.folder = args_value(a, "output"),
                                  .source = a->positional[0],
                                  .quality = 95,
                                  .downscale = 1,
                                  .every = 1,
                                  .sharpest = args_value(a, "sharpest") != NULL,
                                  .force = args_value(a, "force") != NULL};
    c->wait = 30;
    if (!c->options.folder) return usage("--output", "is missing: the folder to write");
    int error = args_int(a, "frames", 1, 100000000, &frames);
    if (!error) error = args_int(a, "every", 1, 1000000, &c->options.every);
    if (!error) error = args_int(a, "quality", 1, 100, &c->options.quality);
    if (!error) error = args_int(a, "downscale", 1, 64, &c->options.downscale);
    if (!error) error = args_int(a, "wait", 1, 1000000, &c->wait);
    if (!error) error = read_seconds(c);
    if (!error) error = read_format(c);
    if (!error && c->options.sharpest && c->options.every == 1)
        error = usage("--sharpest", "needs --every of 2 or more");
    c->options.most = (uint64_t)frames;
    return error;
}

/* As transforms.json has it, for the pictures that are written. */
static json_t *lens_json(const sf_lens *lens, const sf_source_info *info, int downscale) {
    double n = downscale;
    return json_pack("{s:s, s:i, s:i, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f, s:f}", "camera_model", "OPENCV",
                     "w", (int)info->width / downscale, "h", (int)info->height / downscale, "fl_x",
                     lens->fx / n, "fl_y", lens->fy / n, "cx", lens->cx / n, "cy", lens->cy / n, "k1",
                     lens->k1, "k2", lens->k2, "p1", lens->p1, "p2", lens->p2, "k3", lens->k3);
}

static int read_lens(capture *c) {
    sf_lens lens = {0};
    int error = app_lens(c->a, c->ctx, c->source, &lens);
    if (!error && lens.fx > 0)
        c->options.lens = c->lens = lens_json(&lens, &c->options.info, c->options.downscale);
    return error;
}

/* 2. Frames */

static void show(capture *c, int at_once) {
    char text[192];
    record_counts r;
    sf_source_counts s;
    double seconds = app_seconds() - c->began;
    if (!progress_due(&c->line, seconds, at_once)) return;
    record_count(c->record, &r);
    sf_source_count(c->source, &s);
    int n = snprintf(text, sizeof text, "%.1f s  frames %llu  %.1f/s  kept %llu", seconds,
                     (unsigned long long)s.given, (double)s.given / (seconds > 0 ? seconds : 1),
                     (unsigned long long)r.kept);
    const struct {
        const char *name;
        uint64_t count;
    } lost[] = {{"dropped", s.dropped + r.dropped}, {"damaged", s.damaged + r.undecodable}};
    for (int i = 0; i < 2; i++)
        if (lost[i].count)
            n += snprintf(text + n, sizeof text - (size_t)n, "  %s %llu", lost[i].name,
                          (unsigned long long)lost[i].count);
    progress_text(&c->line, text);
}

/* Whether the seconds that were asked for are over, by the frames' own times; by the clock where a live
 * source gives none. */
static int is_over(const capture *c, const sf_frame *frame) {
    if (!(c->seconds > 0)) return 0;
    if (!frame) return c->options.info.live && c->taken && app_seconds() - c->first_frame >= c->seconds + 1;
    return (double)(frame->time_ns - c->first_ns) * 1e-9 >= c->seconds;
}

/* One frame, or a while without one. 0: there will be none, or none more is wanted. */
static int take_one(capture *c) {
    sf_frame frame;
    sf_status status = sf_source_next(c->source, WAIT_MS, &frame);
    if (status == SF_ERR_TIMEOUT) {
        if (app_seconds() - c->last_frame < c->wait) return !is_over(c, NULL);
        snprintf(c->error, sizeof c->error, "%s: no frame for %d s", c->options.source, c->wait);
        return 0;
    }
    if (status) {
        if (status != SF_ERR_END) snprintf(c->error, sizeof c->error, "%s", sf_last_error(c->ctx));
        return 0;
    }
    c->last_frame = app_seconds();
    if (!c->taken++) {
        c->first_ns = frame.time_ns;
        c->first_frame = c->last_frame;
    }
    int over = is_over(c, &frame);
    if (!over) record_put(c->record, &frame);
    sf_source_release(c->source, &frame);
    return !over;
}

static void take_frames(capture *c) {
    c->began = c->last_frame = app_seconds();
    c->line.last = 0; /* the first line comes when there is something to say */
    while (!app_stopped_by() && record_wants(c->record) && take_one(c)) show(c, 0);
    show(c, 1);
    progress_break(&c->line);
}

/* 3. Begin and end */

static int prepare(capture *c) {
    int error = read_options(c);
    if (!error) error = progress_start(&c->line, c->a, stdout);
    if (!error) error = app_context(c->a, &c->ctx);
    if (error) return error;
    sf_status status = sf_source_open(c->ctx, c->options.source, &c->source);
    if (status) {
        app_fail(c->a, c->ctx);
        return status == SF_ERR_ARGUMENT ? EXIT_USAGE : EXIT_FAILED;
    }
    sf_source_describe(c->source, &c->options.info);
    int smaller =
        c->options.info.width < c->options.info.height ? c->options.info.width : c->options.info.height;
    if (c->options.downscale > smaller)
        return usage("--downscale", "more than a side of the source's frames");
    error = read_lens(c);
    return error ? error : record_start(c->a, &c->options, &c->record);
}

static void announce(const capture *c) {
    const sf_source_info *info = &c->options.info;
    if (args_value(c->a, "quiet")) return;
    printf("%s: %s, %dx%d %s", c->options.source, info->name, (int)info->width, (int)info->height,
           sf_pixel_format_name(info->format));
    if (info->frames_per_second > 0) printf(", %.4g frames a second", info->frames_per_second);
    printf("%s\n", info->live ? ", live" : "");
    fflush(stdout);
}

static void print_result(const capture *c, const sf_source_counts *s, const record_counts *r) {
    if (args_value(c->a, "quiet")) return;
    printf(
        "wrote %s: %llu pictures of %llu frames; passed over %llu, dropped %llu, skipped %llu, damaged %llu",
        c->options.folder, (unsigned long long)r->kept, (unsigned long long)s->given,
        (unsigned long long)r->passed_over, (unsigned long long)s->dropped, (unsigned long long)s->skipped,
        (unsigned long long)(s->damaged + r->undecodable));
    printf(", dropped by the writer %llu, reopened %llu\n", (unsigned long long)r->dropped,
           (unsigned long long)s->reopened);
}

/* Of several failures the first one is told. */
static int finish(capture *c) {
    sf_source_counts s;
    record_counts r;
    sf_source_count(c->source, &s);
    int error = record_finish(&c->record, &s, &r);
    if (!error && *c->error) {
        error = args_error(c->a->command, "%s", c->error);
    }
    if (!error && !r.kept && !app_stopped_by())
        error = app_say(c->a, c->options.source, "gave no frame that could be kept");
    print_result(c, &s, &r);
    return error ? error : app_stopped_by() ? 128 + app_stopped_by() : 0;
}

static int run(const args *a) {
    capture c = {.a = a};
    int error = prepare(&c);
    if (!error) {
        announce(&c);
        app_catch_signals(NULL);
        take_frames(&c);
        error = finish(&c);
    }
    sf_source_close(&c.source);
    json_decref(c.lens);
    sf_context_destroy(&c.ctx);
    return error;
}

static const arg_option *const tables[] = {own_options, common_options, NULL};

const command command_capture = {
    .name = "capture",
    .synopsis = "SOURCE -o DIR [OPTIONS]",
    .summary =
        "Records pictures from a source of frames. SOURCE is v4l2:/dev/videoN, libcamera:N (splatfit devices "
        "lists both), folder:DIR, pipe:- (YUV4MPEG2, JPEGs; with "
        "?size=WxH&format=NAME plain pixels), pipe:FILE or sim:studio; src/capture/README.md lists the "
        "options of each. SIGINT, SIGTERM and SIGHUP end the recording in good order.",
    .tables = tables,
    .least = 1,
    .most = 1,
    .run = run,
};
