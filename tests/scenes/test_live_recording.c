/* test_live_recording.c - a live fit of a real recording, held to structure from motion of the same frames:
 * where its keyframes are, and how good the model is. In steps a frame, not in real time: it can be repeated.
 */
#include "../testing.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#include "base/statistics.h"

#include <splatfit/calibrate.h>
#include <splatfit/live.h>

enum { FRAMES = 99, STEPS_PER_FRAME = 6, DOWNSCALE = 2, TAGS = 12, COLUMNS = 4, MOST_KEYFRAMES = FRAMES };

/* The recording's board (m) and camera (px): its README. */
#define TAG_M      0.0955
#define PITCH_M    0.1204
#define MOST_OFF   0.3   /* degrees, median */
#define WORST_OFF  0.6   /* degrees, of any keyframe */
#define MOST_MOVED 0.005 /* m, median: 0.5 % of the metre to what is seen */
#define MOST_LESS  2.0   /* dB */
#define DEGREES    57.29577951308232

static const sf_lens lens = {.fx = 607.178, .fy = 607.234, .cx = 321.391, .cy = 241.918};

/* The keyframes: where the live fit and structure from motion have them, and which frames they are of. */
typedef struct keyframes {
    sf_camera live[MOST_KEYFRAMES], reference[MOST_KEYFRAMES];
    size_t frame[MOST_KEYFRAMES], count;
} keyframes;

static sf_board *make_board(sf_context *ctx) {
    const char *path = test_path("board.json");
    sf_board *board;
    FILE *f = fopen(path, "w");
    assert_non_null(f);
    fprintf(f, "{\"name\": \"recording\", \"family\": \"tag36h11\", \"tag_size_m\": %g, \"tags\": [", TAG_M);
    for (int i = 0; i < TAGS; i++)
        fprintf(f, "%s{\"id\": %d, \"x_m\": %g, \"y_m\": %g}", i ? ", " : "", i, PITCH_M * (i % COLUMNS),
                PITCH_M * (double)(i / COLUMNS));
    fprintf(f, "]}\n");
    assert_int_equal(fclose(f), 0);
    assert_ok(ctx, sf_board_open(ctx, path, 0, &board));
    return board;
}

/* Plays the recording to its end; which frames became keyframes. */
static void play(sf_context *ctx, sf_live *live, keyframes *k) {
    sf_live_frame frame;
    sf_live_progress p;
    sf_status status;
    k->count = 0;
    while ((status = sf_live_step(live)) != SF_ERR_END) {
        assert_ok(ctx, status);
        sf_live_get_progress(live, &p);
        sf_live_get_frame(live, &frame);
        assert_true(p.keyframes <= MOST_KEYFRAMES);
        while (k->count < p.keyframes) k->frame[k->count++] = (size_t)frame.number - 1;
    }
    assert_true(k->count >= 8);
}

static double dot(const double *a, const double *b, size_t stride) {
    return a[0] * b[0] + a[stride] * b[stride] + a[2 * stride] * b[2 * stride];
}

static double angle(double trace) { return acos(fmin(fmax((trace - 1) / 2, -1), 1)) * DEGREES; }

/* Q (row-major): world of the live fit to that of structure from motion, as keyframe i has it. */
static void worlds(const keyframes *k, size_t i, double Q[9]) {
    for (int r = 0; r < 3; r++)
        for (int c = 0; c < 3; c++) Q[3 * r + c] = dot(k->reference[i].R_cw + r, k->live[i].R_cw + c, 3);
}

/* Degrees that the keyframes are off where the worlds are turned as i has it. */
static void turned_off(const keyframes *k, size_t i, double off[]) {
    double Q[9], P[9];
    worlds(k, i, Q);
    for (size_t j = 0; j < k->count; j++) {
        worlds(k, j, P);
        off[j] = angle(dot(Q, P, 1) + dot(Q + 3, P + 3, 1) + dot(Q + 6, P + 6, 1));
    }
}

/* The worlds differ by one rigid motion: its turn is that of the keyframe that suits the others best, its
 * shift the median. */
static void hold_poses(const keyframes *k) {
    double off[MOST_KEYFRAMES], shift[3][MOST_KEYFRAMES], Q[9], least = INFINITY;
    size_t best = 0;
    for (size_t i = 0; i < k->count; i++) {
        turned_off(k, i, off);
        double now = sf_median(off, k->count);
        if (now < least) least = now, best = i;
    }
    worlds(k, best, Q);
    for (size_t i = 0; i < k->count; i++) {
        double a[3], b[3];
        sf_camera_center(&k->live[i], a);
        sf_camera_center(&k->reference[i], b);
        for (int c = 0; c < 3; c++) shift[c][i] = b[c] - dot(Q + (ptrdiff_t)3 * c, a, 1);
    }
    double by[3], moved[MOST_KEYFRAMES];
    for (int c = 0; c < 3; c++) {
        memcpy(moved, shift[c], k->count * sizeof *moved);
        by[c] = sf_median(moved, k->count);
    }
    for (size_t i = 0; i < k->count; i++)
        moved[i] =
            sqrt(pow(shift[0][i] - by[0], 2) + pow(shift[1][i] - by[1], 2) + pow(shift[2][i] - by[2], 2));
    turned_off(k, best, off);
    double middle = sf_median(off, k->count), worst = sf_ranked(off, k->count, k->count - 1);
    double away = sf_median(moved, k->count);
    print_message(
        "%zu keyframes, off structure from motion by %.3f degrees and %.2f mm (medians), %.2f degrees at "
        "most\n",
        k->count, middle, 1e3 * away, worst);
    assert_true(middle <= MOST_OFF);
    assert_true(worst <= WORST_OFF);
    assert_true(away <= MOST_MOVED);
}

/* As the live fit has it, with the poses of structure from motion: what it held out is held out, all other
 * frames are trained on. */
static sf_quality fit_offline(sf_context *ctx, sf_scene *all, const int held_out[FRAMES]) {
    sf_scene *scene;
    sf_scene_info info;
    sf_view_info view;
    sf_fitter *fitter;
    sf_fit_options options = sf_live_options_default().fit;
    options.steps = FRAMES * STEPS_PER_FRAME;
    sf_scene_get_info(all, &info);
    float *xyz = malloc(3 * info.points * sizeof *xyz);
    uint8_t *rgb = malloc(3 * info.points);
    assert_true(xyz && rgb);
    assert_ok(ctx, sf_scene_create(ctx, &scene));
    for (size_t i = 0; i < FRAMES; i++) {
        assert_ok(ctx, sf_scene_get_view(all, i, &view));
        test_copy_view(ctx, all, view, scene, held_out[i] ? SF_SPLIT_TEST : SF_SPLIT_TRAIN);
    }
    assert_int_equal(sf_scene_get_points(all, 0, info.points, xyz, rgb), info.points);
    assert_ok(ctx, sf_scene_add_points(scene, info.points, xyz, rgb));
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    sf_status status;
    while (!(status = sf_fitter_step(fitter))) {
    }
    assert_status(ctx, status, SF_ERR_END);
    sf_quality quality = test_held_out(ctx, scene, fitter);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    free(xyz);
    free(rgb);
    return quality;
}

static void is_as_good_as_offline(void **state) {
    (void)state;
    char name[512];
    sf_context *ctx = test_context(), *source_ctx = test_context_threads(1);
    sf_source *source;
    sf_live *live;
    sf_scene *all;
    sf_live_progress p;
    static keyframes k;
    int held_out[FRAMES] = {0};

    snprintf(name, sizeof name, "%s/rbt-tagboard", test_data());
    sf_load_options load = sf_load_options_default();
    load.downscale = DOWNSCALE;
    assert_ok(ctx, sf_scene_load(ctx, name, &load, &all));
    snprintf(name, sizeof name, "folder:%s/rbt-tagboard/images?fps=0", test_data());
    assert_ok(source_ctx, sf_source_open(source_ctx, name, &source));
    sf_board *board = make_board(ctx);
    sf_live_options options = sf_live_options_default();
    options.board = board;
    options.lens = lens;
    options.downscale = DOWNSCALE;
    options.steps_per_frame = STEPS_PER_FRAME;
    options.fit.steps = FRAMES * STEPS_PER_FRAME;
    assert_ok(ctx, sf_live_create(ctx, source, &options, &live));
    play(ctx, live, &k);

    for (size_t i = 0; i < k.count; i++) {
        sf_view_info view, there;
        assert_ok(ctx, sf_scene_get_view(sf_live_scene(live), i, &view));
        assert_true(k.frame[i] < FRAMES);
        assert_ok(ctx, sf_scene_get_view(all, k.frame[i], &there));
        k.live[i] = view.camera, k.reference[i] = there.camera;
        held_out[k.frame[i]] = view.split == SF_SPLIT_TEST;
    }
    hold_poses(&k);
    sf_live_get_progress(live, &p);
    sf_quality offline = fit_offline(ctx, all, held_out);
    print_message(
        "%zu of them held out: %.2f dB, exposure corrected %.2f; offline, of all other frames: %.2f, %.2f\n",
        p.held_out, p.held_out_psnr, p.held_out_psnr_corrected, offline.psnr, offline.psnr_corrected);
    assert_true(p.held_out >= 2);
    assert_true(p.held_out_psnr >= offline.psnr - MOST_LESS);
    assert_true(p.held_out_psnr_corrected >= offline.psnr_corrected - MOST_LESS);

    sf_live_destroy(&live);
    sf_board_close(&board);
    sf_source_close(&source);
    sf_scene_destroy(&all);
    sf_context_destroy(&source_ctx);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(is_as_good_as_offline)};
    return cmocka_run_group_tests(tests, NULL, NULL);
}
