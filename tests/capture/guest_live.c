/* guest_live.c - a live fit of what a camera's driver gives: the simulated board, shown to the kernel's, and
 * the same room without a board. */
#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

#include <splatfit/calibrate.h>
#include <splatfit/live.h>

#include <linux/videodev2.h>

#include "base/statistics.h"
#include "guest.h"
#include "vivid.h"

/* The first frames of a walk with a board in view; the driver has no size so small, so a pixel becomes a
 * square of them there, and the live fit averages them again. */
#define SHOWN "sim:studio-board?width=240&height=160&fps=0&frames=240"
/* The same without a board, from its side. */
#define SHOWN_ALONE "sim:studio?width=180&height=120&frames=100"
#define TAKEN       "v4l2:" VIVID_CAPTURE "?size=720x480&format=RGB24"

enum {
    WIDTH = 720,
    HEIGHT = 480,
    FRAMES = 18,
    FRAMES_ALONE = 13,
    STEPS = 40,
    STEPS_ALONE = 15,
    MOST = 3000,
    SECONDS = 400,
    SECONDS_ALONE = 600
};

#define TAG_M      0.08
#define ALONE_DEG  1.5
#define ALONE_PART 0.06 /* of the distance */
#define ALONE_DB   14.0 /* after fewer steps */
#define WRONG_DEG  0.5
#define WRONG_M    0.02
#define LEAST_DB   18.0
#define SAVED      "/tmp/scene.ply"
#define DEGREES    57.29577951308232

/* How many pixels of the driver's a frame's pixel is wide. */
static int scale_of(const sf_frame *frame) {
    int scale = WIDTH / frame->width;
    check(frame->format == SF_PIXEL_RGB24 && frame->width * scale == WIDTH && frame->height * scale == HEIGHT,
          "a simulated frame of %dx%d, %s", (int)frame->width, (int)frame->height,
          sf_pixel_format_name(frame->format));
    return scale;
}

static void enlarge(const sf_frame *frame, uint8_t *rgb) {
    size_t scale = (size_t)scale_of(frame);
    for (size_t y = 0; y < HEIGHT; y++)
        for (size_t x = 0; x < WIDTH; x++)
            for (size_t c = 0; c < 3; c++)
                rgb[3 * (y * WIDTH + x) + c] =
                    frame->plane[0][y / scale * frame->stride[0] + 3 * (x / scale) + c];
}

static sf_lens lens_of(const sf_frame *frame) {
    const sf_camera *c = &frame->camera;
    double scale = scale_of(frame);
    return (sf_lens){.fx = scale * c->fx, .fy = scale * c->fy, .cx = scale * c->cx, .cy = scale * c->cy};
}

/* From pictures alone where `board` is NULL. */
static sf_live *begin(sf_source *camera, const sf_board *board, const sf_frame *frame) {
    sf_live *live;
    sf_live_options o = sf_live_options_default();
    o.board = board;
    o.lens = lens_of(frame);
    o.downscale = scale_of(frame);
    o.track_rate = 2; /* the emulated processors have little time */
    o.hold_out = 4;
    o.fit.max_gaussians = MOST;
    sf_status status = sf_live_create(guest_context(), camera, &o, &live);
    if (status == SF_ERR_UNSUPPORTED) skip("not built with libapriltag");
    check(status == SF_OK, "%s", sf_last_error(guest_context()));
    return live;
}

static sf_live_progress play(sf_live *live, uint64_t looks, int64_t steps) {
    sf_live_progress p;
    sf_live_get_progress(live, &p);
    while (p.looked_at < looks || p.fit.step < steps) {
        sf_status status = sf_live_step(live);
        check(status == SF_OK, "%s: %s", sf_status_text(status), sf_last_error(guest_context()));
        sf_live_get_progress(live, &p);
    }
    return p;
}

static double degrees_apart(const sf_camera *a, const sf_camera *b) {
    double trace = 0;
    for (int k = 0; k < 9; k++) trace += a->R_cw[k] * b->R_cw[k];
    return acos(fmin(fmax((trace - 1) / 2, -1), 1)) * DEGREES;
}

static double metres_apart(const sf_camera *a, const sf_camera *b) {
    double from[3], to[3], squares = 0;
    sf_camera_center(a, from);
    sf_camera_center(b, to);
    for (int k = 0; k < 3; k++) squares += (from[k] - to[k]) * (from[k] - to[k]);
    return sqrt(squares);
}

static void check_model(sf_live *live, size_t gaussians) {
    sf_model *model, *saved;
    check(sf_live_snapshot(live, &model) == SF_OK && sf_model_save(model, SAVED) == SF_OK &&
              sf_model_load(guest_context(), SAVED, &saved) == SF_OK,
          "%s", sf_last_error(guest_context()));
    check(sf_model_count(saved) == gaussians && gaussians > MOST / 4, "%zu Gaussians, %zu saved", gaussians,
          sf_model_count(saved));
    sf_model_destroy(&model);
    sf_model_destroy(&saved);
}

/* Each frame is shown until it was looked at for certain: of two looks the second began after it was put. */
static void model(void) {
    sf_context *own; /* the camera's: its frames are taken in on a thread of the live fit's */
    sf_context_options options = {.threads = 1};
    sf_source *camera, *shown;
    sf_board *board;
    sf_frame frame;
    sf_live *live = NULL;
    sf_live_frame seen;
    sf_live_progress p = {0};
    double degrees[FRAMES], metres[FRAMES];
    uint8_t *rgb = malloc((size_t)3 * WIDTH * HEIGHT);
    alarm(SECONDS); /* in place of what is usual */
    shown = open_source(SHOWN);
    check(rgb && sf_context_create(&own, &options) == SF_OK, "out of memory");
    check(sf_board_open(guest_context(), "a3-36h11", TAG_M, &board) == SF_OK, "%s",
          sf_last_error(guest_context()));
    vivid_loop(VIVID_CAPTURE, VIVID_OUTPUT, WIDTH, HEIGHT);
    vivid_feed *feed = vivid_feed_open(VIVID_OUTPUT, V4L2_PIX_FMT_RGB24, SF_PIXEL_RGB24, WIDTH, HEIGHT);
    check(sf_source_open(own, TAKEN, &camera) == SF_OK, "%s", sf_last_error(own));
    for (int i = 0; i < FRAMES; i++) {
        next_frame(shown, -1, &frame);
        enlarge(&frame, rgb);
        vivid_feed_show(feed, rgb);
        if (!live) live = begin(camera, board, &frame);
        p = play(live, p.looked_at + 2, 0);
        sf_live_get_frame(live, &seen);
        check(i == 0 || seen.from != SF_POSE_NONE, "frame %d has no pose", i);
        degrees[i] = degrees_apart(&seen.camera, &frame.camera);
        metres[i] = metres_apart(&seen.camera, &frame.camera);
        sf_source_release(shown, &frame);
    }
    p = play(live, 0, STEPS);
    double off = sf_median(degrees, FRAMES), away = sf_median(metres, FRAMES);
    printf("%llu looks, %zu keyframes, %lld steps, %zu Gaussians, %.2f degrees and %.1f mm off (medians), "
           "held out %.2f dB, the first %.2f\n",
           (unsigned long long)p.looked_at, p.keyframes, (long long)p.fit.step, p.fit.gaussians, off,
           1e3 * away, p.held_out_psnr_corrected, p.first_psnr);
    check(p.lost == 0 && p.keyframes > 5, "lost %d times, %zu keyframes", (int)p.lost, p.keyframes);
    check(off < WRONG_DEG && away < WRONG_M, "poses are off by %.2f degrees, %.3f m", off, away);
    check(p.held_out_psnr_corrected > LEAST_DB && p.first_psnr > LEAST_DB, "held out %.2f dB, the first %.2f",
          p.held_out_psnr_corrected, p.first_psnr);
    check_model(live, p.fit.gaussians);
    sf_live_destroy(&live);
    sf_board_close(&board);
    sf_source_close(&camera);
    sf_context_destroy(&own);
    vivid_feed_close(feed);
    sf_source_close(&shown);
    free(rgb);
}

/* The median error of poses after the similarity between them: degrees, and parts of the distance, which is
 * the map's unit. */
static void measure(const sf_camera *found, const sf_camera *truth, size_t count, double *off, double *away) {
    double degrees[FRAMES_ALONE], parts[FRAMES_ALONE];
    sf_similarity s;
    check(sf_similarity_between(found, truth, count, &s), "%zu poses tell no similarity", count);
    for (size_t i = 0; i < count; i++) {
        sf_camera c = found[i];
        sf_camera_transform(&c, &s);
        degrees[i] = degrees_apart(&c, &truth[i]), parts[i] = metres_apart(&c, &truth[i]) / s.scale;
    }
    *off = sf_median(degrees, count), *away = sf_median(parts, count);
}

/* Without a board: the map begins with the camera's motion. */
static void model_alone(void) {
    if (getenv("quick")) skip("quick tests: it takes minutes");
    sf_context *own;
    sf_context_options options = {.threads = 1};
    sf_source *camera, *shown;
    sf_frame frame;
    sf_live *live = NULL;
    sf_live_frame seen;
    sf_live_progress p = {0};
    sf_camera found[FRAMES_ALONE], truth[FRAMES_ALONE];
    size_t count = 0;
    double off, away;
    uint8_t *rgb = malloc((size_t)3 * WIDTH * HEIGHT);
    alarm(SECONDS_ALONE);
    shown = open_source(SHOWN_ALONE);
    check(rgb && sf_context_create(&own, &options) == SF_OK, "out of memory");
    vivid_loop(VIVID_CAPTURE, VIVID_OUTPUT, WIDTH, HEIGHT);
    vivid_feed *feed = vivid_feed_open(VIVID_OUTPUT, V4L2_PIX_FMT_RGB24, SF_PIXEL_RGB24, WIDTH, HEIGHT);
    check(sf_source_open(own, TAKEN, &camera) == SF_OK, "%s", sf_last_error(own));
    for (int i = 0; i < FRAMES_ALONE; i++) {
        next_frame(shown, -1, &frame);
        enlarge(&frame, rgb);
        vivid_feed_show(feed, rgb);
        if (!live) live = begin(camera, NULL, &frame);
        p = play(live, p.looked_at + 2, 0);
        sf_live_get_frame(live, &seen);
        if (p.has_fit && seen.from != SF_POSE_NONE) found[count] = seen.camera, truth[count++] = frame.camera;
        sf_source_release(shown, &frame);
    }
    check(p.has_fit && p.own_world && count >= 5, "%zu poses, %s", count, p.has_fit ? "fits" : "no fit");
    p = play(live, 0, STEPS_ALONE);
    measure(found, truth, count, &off, &away);
    printf("%llu looks, %zu keyframes, %zu poses %.2f degrees and %.2f %% of the distance off (medians), "
           "%lld steps, %zu Gaussians, held out %.2f dB\n",
           (unsigned long long)p.looked_at, p.keyframes, count, off, 100 * away, (long long)p.fit.step,
           p.fit.gaussians, p.held_out_psnr_corrected);
    check(p.lost == 0 && p.keyframes > 5, "lost %d times, %zu keyframes", (int)p.lost, p.keyframes);
    check(off < ALONE_DEG && away < ALONE_PART, "poses are off by %.2f degrees, %.3f", off, away);
    check(p.held_out_psnr_corrected > ALONE_DB, "held out %.2f dB", p.held_out_psnr_corrected);
    check_model(live, p.fit.gaussians);
    sf_live_destroy(&live);
    sf_source_close(&camera);
    sf_context_destroy(&own);
    vivid_feed_close(feed);
    sf_source_close(&shown);
    free(rgb);
}

const guest_test live_tests[] = {{"model", model}, {"model_alone", model_alone}, {0}};
