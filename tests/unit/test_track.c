/* test_track.c - the pose of a picture against a model. */
#include "../testing.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "pose/track.h"

enum { WIDTH = 160, HEIGHT = 120, PIXELS = WIDTH * HEIGHT, GAUSSIANS = 1500 };

static double uniform(uint64_t *state) {
    *state = *state * 6364136223846793005u + 1442695040888963407u;
    return (double)(*state >> 33) / 2147483648.0;
}

/* A wall of soft patches at a depth of 3 to 4, with a few before it; its colours change slowly and quickly.
 */
static sf_model *wall(sf_context *ctx) {
    sf_model *model;
    uint64_t state = 7;
    assert_ok(ctx, sf_model_create(ctx, GAUSSIANS, 0, &model));
    for (size_t i = 0; i < GAUSSIANS; i++) {
        int near = i % 50 == 0;
        float x = (float)(5 * uniform(&state) - 2.5), y = (float)(4 * uniform(&state) - 2);
        const float mean[3] = {x, y, near ? 2.2f : 3.5f + 0.3f * sinf(2 * x)};
        const float quat[4] = {1, 0, 0, 0}, opacity = 3;
        float log_scale[3], sh[3];
        for (int k = 0; k < 3; k++) log_scale[k] = logf((float)(0.06 + 0.06 * uniform(&state)));
        for (int k = 0; k < 3; k++)
            sh[k] = (float)(0.9 * sin(1.9 * x + k) * cos(1.4 * y - 2 * k) + 1.2 * uniform(&state) - 0.6);
        sf_gaussians from = {(float *)mean, (float *)quat, log_scale, (float *)&opacity, sh};
        assert_int_equal(sf_model_set(model, i, 1, &from), SF_OK);
    }
    return model;
}

static sf_camera camera_at(const double twist[6]) {
    sf_camera camera = {
        .width = WIDTH, .height = HEIGHT, .fx = 130, .fy = 130, .cx = WIDTH / 2.0, .cy = HEIGHT / 2.0};
    sf_rigid pose = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}};
    sf_rigid_move(&pose, twist);
    memcpy(camera.R_cw, pose.R, sizeof pose.R);
    memcpy(camera.t_cw, pose.t, sizeof pose.t);
    return camera;
}

typedef struct fixture {
    sf_context *ctx;
    sf_model *model;
    sf_renderer *renderer;
    sf_tracker *tracker;
    sf_camera camera; /* the picture's */
    sf_rigid truth;
    float rgb[3 * PIXELS], plane[3][PIXELS];
} fixture;

static fixture *create(int threads) {
    fixture *f = calloc(1, sizeof *f);
    const double twist[6] = {0.1, -0.05, 0.2, 0.05, -0.1, 0.03};
    assert_non_null(f);
    f->ctx = test_context_threads(threads);
    f->model = wall(f->ctx);
    f->camera = camera_at(twist);
    memcpy(f->truth.R, f->camera.R_cw, sizeof f->truth.R);
    memcpy(f->truth.t, f->camera.t_cw, sizeof f->truth.t);
    assert_ok(f->ctx, sf_renderer_create(f->ctx, &f->renderer));
    assert_ok(f->ctx, sf_tracker_create(f->ctx, &f->tracker));
    sf_image_out out = {.rgb = f->rgb};
    assert_ok(f->ctx, sf_render(f->renderer, f->model, &f->camera, NULL, &out));
    return f;
}

static void destroy(fixture *f) {
    sf_tracker_destroy(&f->tracker);
    sf_renderer_destroy(&f->renderer);
    sf_model_destroy(&f->model);
    sf_context_destroy(&f->ctx);
    free(f);
}

/* What a camera makes of the drawing: gain, bias, noise. */
static void take(fixture *f, double gain, double bias, double noise) {
    uint64_t state = 99;
    float *const plane[3] = {f->plane[0], f->plane[1], f->plane[2]};
    for (int i = 0; i < PIXELS; i++)
        for (int c = 0; c < 3; c++) {
            double hiss = noise * (uniform(&state) + uniform(&state) + uniform(&state) - 1.5) * 2;
            f->plane[c][i] = (float)(gain * (double)f->rgb[3 * i + c] + bias + hiss);
        }
    assert_ok(f->ctx, sf_tracker_take(f->tracker, &f->camera, plane, WIDTH));
}

static sf_track track_from(fixture *f, const double twist[6], const sf_track_prior *prior,
                           sf_track_guess how) {
    sf_render_options options = sf_render_options_default();
    sf_rigid guess = f->truth;
    sf_track track;
    sf_rigid_move(&guess, twist);
    assert_ok(f->ctx, sf_track_picture(f->tracker, f->model, &options, &guess, prior, how, &track));
    return track;
}

/* Degrees and world units off the truth. */
static void off_truth(const fixture *f, const sf_track *track, double *degrees, double *distance) {
    double twist[6];
    sf_rigid_twist(&f->truth, &track->pose, twist);
    *degrees = sqrt(twist[3] * twist[3] + twist[4] * twist[4] + twist[5] * twist[5]) * 57.29578;
    *distance = sqrt(twist[0] * twist[0] + twist[1] * twist[1] + twist[2] * twist[2]);
}

static void finds_the_pose_of_a_near_guess(void **state) {
    (void)state;
    fixture *f = create(2);
    const double off[6] = {0.05, -0.04, 0.06, 0.02, 0.03, -0.02};
    double degrees, distance;
    take(f, 1, 0, 0);
    sf_track track = track_from(f, off, NULL, SF_GUESS_NEAR);
    off_truth(f, &track, &degrees, &distance);
    print_message("clean: %.4f degrees, %.5f of a depth of 3.5; agreement %.4f\n", degrees, distance,
                  track.agreement);
    assert_true(degrees < 0.06 && distance < 0.005);
    assert_true(track.agreement > 0.999 && track.seen > 0.5 && track.rms < 0.005);
    take(f, 0.7, 0.1, 0.03);
    track = track_from(f, off, NULL, SF_GUESS_NEAR);
    off_truth(f, &track, &degrees, &distance);
    print_message("darker, with noise: %.4f degrees, %.5f; gain %.3f, bias %.3f\n", degrees, distance,
                  track.gain, track.bias);
    assert_true(degrees < 0.08 && distance < 0.006);
    assert_true(fabs(track.gain - 0.7) < 0.02 && fabs(track.bias - 0.1) < 0.01);
    destroy(f);
}

static void far_guesses_need_the_coarse_start(void **state) {
    (void)state;
    fixture *f = create(2);
    const double off[6] = {0.15, 0.1, -0.1, -0.05, 0.06, 0.05};
    double degrees, distance;
    take(f, 1, 0, 0);
    sf_track track = track_from(f, off, NULL, SF_GUESS_FAR);
    off_truth(f, &track, &degrees, &distance);
    print_message("from far: %.4f degrees, %.5f\n", degrees, distance);
    assert_true(degrees < 0.06 && distance < 0.005);
    destroy(f);
}

/* The standard deviations that it states are those that are seen over many draws of noise, to a factor of 3.
 */
static void a_prior_counts_as_much_as_it_knows(void **state) {
    (void)state;
    fixture *f = create(2);
    const double off[6] = {0.02, 0, 0, 0, 0.01, 0};
    sf_track_prior prior = {.pose = f->truth};
    double degrees, distance;
    sf_rigid_move(&prior.pose, (double[6]){0.1, 0, 0, 0, 0, 0});
    take(f, 1, 0, 0.02);
    for (int i = 0; i < 6; i++) prior.information[7 * i] = 1; /* knows to 1 unit: nothing */
    sf_track track = track_from(f, off, &prior, SF_GUESS_NEAR);
    off_truth(f, &track, &degrees, &distance);
    assert_true(degrees < 0.08 && distance < 0.006);
    for (int i = 0; i < 6; i++) prior.information[7 * i] = 1e12;
    track = track_from(f, off, &prior, SF_GUESS_NEAR);
    off_truth(f, &track, &degrees, &distance);
    assert_true(fabs(distance - 0.1) < 1e-3);
    assert_true(track.covariance[0] < 1.1e-12);
    destroy(f);
}

static void says_when_there_is_nothing_to_see(void **state) {
    (void)state;
    fixture *f = create(1);
    const double away[6] = {0, 0, 0, 0, 3, 0}, none[6] = {0};
    take(f, 1, 0, 0);
    sf_track track = track_from(f, away, NULL, SF_GUESS_FAR);
    assert_true(track.seen < 0.05);
    take(f, 0, 0.02, 0.005); /* a covered lens */
    track = track_from(f, none, NULL, SF_GUESS_NEAR);
    assert_true(track.agreement < 0.3);
    destroy(f);
}

static void threads_do_not_matter(void **state) {
    (void)state;
    const double off[6] = {0.05, -0.04, 0.06, 0.02, 0.03, -0.02};
    sf_track track[2];
    for (int i = 0; i < 2; i++) {
        fixture *f = create(i ? 3 : 1);
        take(f, 0.9, 0, 0.02);
        memset(&track[i], 0, sizeof track[i]);
        track[i] = track_from(f, off, NULL, SF_GUESS_NEAR);
        destroy(f);
    }
    assert_memory_equal(&track[0].pose, &track[1].pose, sizeof track[0].pose);
    assert_memory_equal(track[0].covariance, track[1].covariance, sizeof track[0].covariance);
}

static void twists_lead_from_pose_to_pose(void **state) {
    (void)state;
    uint64_t draw = 3;
    for (int round = 0; round < 50; round++) {
        sf_rigid a = {.R = {1, 0, 0, 0, 1, 0, 0, 0, 1}}, b, back, whole;
        double twist[6], found[6];
        for (int k = 0; k < 6; k++) twist[k] = 2 * uniform(&draw) - 1;
        sf_rigid_move(&a, twist);
        b = a;
        for (int k = 0; k < 6; k++) twist[k] = (2 * uniform(&draw) - 1) * (round % 3 ? 1.5 : 1e-9);
        sf_rigid_move(&b, twist);
        sf_rigid_twist(&a, &b, found);
        for (int k = 0; k < 6; k++) assert_true(fabs(found[k] - twist[k]) < 1e-12);
        sf_rigid_invert(&a, &back);
        sf_rigid_compose(&back, &a, &whole);
        double center[3];
        sf_rigid_center(&a, center);
        for (int k = 0; k < 3; k++) assert_true(fabs(center[k] - back.t[k]) < 1e-12);
        for (int k = 0; k < 9; k++) assert_true(fabs(whole.R[k] - (k % 4 == 0)) < 1e-12);
        for (int k = 0; k < 3; k++) assert_true(fabs(whole.t[k]) < 1e-12);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(finds_the_pose_of_a_near_guess),
        cmocka_unit_test(far_guesses_need_the_coarse_start),
        cmocka_unit_test(a_prior_counts_as_much_as_it_knows),
        cmocka_unit_test(says_when_there_is_nothing_to_see),
        cmocka_unit_test(threads_do_not_matter),
        cmocka_unit_test(twists_lead_from_pose_to_pose),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
