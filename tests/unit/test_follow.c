/* test_follow.c - single steps of poses; views that are not trained on follow those that are. */
#include "../testing.h"

#include <math.h>
#include <string.h>

#include "base/linear.h"
#include "base/rng.h"
#include "fit/fitter.h"
#include "fit/follow.h"
#include "fit/refine.h"

enum { VIEWS = 20, DEPTH = 3 };

static sf_view_state states[VIEWS];
static const sf_view_states views = {.states = states, .count = VIEWS};

/* A camera on an arc about the world's middle, looking there. */
static sf_camera camera_at(double angle) {
    sf_camera c = {.width = 60,
                   .height = 40,
                   .fx = 50,
                   .fy = 50,
                   .cx = 30,
                   .cy = 20,
                   .R_cw = {cos(angle), 0, sin(angle), 0, 1, 0, -sin(angle), 0, cos(angle)},
                   .t_cw = {0, 0, DEPTH}};
    return c;
}

static void place_views(void) {
    for (int i = 0; i < VIEWS; i++) {
        sf_camera c = camera_at(0.08 * i);
        states[i] = (sf_view_state){.id = (uint32_t)(2 * i), .given = c, .depth = DEPTH};
        memcpy(states[i].R_cw, c.R_cw, sizeof c.R_cw);
        memcpy(states[i].t_cw, c.t_cw, sizeof c.t_cw);
        states[i].pose.steps = 1;
    }
}

/* The pose of a camera that moves with the world x' = exp(turn) x + shift. */
static void move_with_world(const double turn[3], const double shift[3], double R_cw[9], double t_cw[3]) {
    double E[9], R[9], back[9], moved[3];
    sf_rotation_exp(turn, E);
    for (int k = 0; k < 9; k++) back[k] = E[k % 3 * 3 + k / 3];
    sf_mat3_mul(R_cw, back, R);
    sf_mat3_vec(R, shift, moved);
    memcpy(R_cw, R, sizeof R);
    for (int k = 0; k < 3; k++) t_cw[k] -= moved[k];
}

/* Degrees between the poses, and the distance of their centres. */
static void compare(const sf_camera *a, const sf_camera *b, double *degrees, double *distance) {
    double back[9], turn[9], axis[3], p[3], q[3];
    for (int k = 0; k < 9; k++) back[k] = b->R_cw[k % 3 * 3 + k / 3];
    sf_mat3_mul(a->R_cw, back, turn);
    sf_rotation_log(turn, axis);
    sf_camera_center(a, p);
    sf_camera_center(b, q);
    *degrees = sqrt(sf_dot3(axis, axis)) * 57.29577951308232;
    *distance = sqrt(pow(p[0] - q[0], 2) + pow(p[1] - q[1], 2) + pow(p[2] - q[2], 2));
}

/* What moves all training views alike moves the others too, whatever it is. */
static void a_common_motion_is_followed(void **state) {
    (void)state;
    static const double turn[3] = {0.02, -0.01, 0.03}, shift[3] = {0.1, -0.05, 0.02};
    double degrees, distance;
    place_views();
    for (int i = 0; i < VIEWS; i++) move_with_world(turn, shift, states[i].R_cw, states[i].t_cw);
    sf_camera camera = camera_at(0.6), given = camera, expected = camera;
    sf_follow_neighbours(&views, &camera);
    move_with_world(turn, shift, expected.R_cw, expected.t_cw);
    compare(&camera, &given, &degrees, &distance);
    assert_true(degrees > 2 && distance > 0.05);
    compare(&camera, &expected, &degrees, &distance);
    assert_true(degrees < 1e-6 && distance < 1e-9);
}

/* Corrections of single views, which have nothing in common, move the others by a small part of them: the
 * mean of eight would be 0.35. */
static void chance_is_not_followed(void **state) {
    (void)state;
    sf_rng rng;
    double turned = 0, moved = 0, degrees, distance;
    enum { TRIALS = 200 };
    sf_rng_seed(&rng, 3);
    for (int trial = 0; trial < TRIALS; trial++) {
        place_views();
        for (int i = 0; i < VIEWS; i++) {
            double turn[3], shift[3];
            for (int k = 0; k < 3; k++)
                turn[k] = 0.01 * sf_rng_normal(&rng), shift[k] = 0.03 * sf_rng_normal(&rng);
            move_with_world(turn, shift, states[i].R_cw, states[i].t_cw);
        }
        sf_camera camera = camera_at(0.6), given = camera;
        sf_follow_neighbours(&views, &camera);
        compare(&camera, &given, &degrees, &distance);
        turned += degrees * degrees / TRIALS, moved += distance * distance / TRIALS;
    }
    double turn_part = sqrt(turned) / (0.01 * sqrt(3) * 57.29577951308232);
    print_message("of independent corrections %.2f are followed\n", turn_part);
    assert_true(turn_part > 0 && turn_part < 0.3);
    assert_true(moved > 0);
}

/* Nothing to follow: the camera stays as it is, to the byte. */
static void few_views_are_not_followed(void **state) {
    (void)state;
    static const double turn[3] = {0.02, 0, 0}, shift[3] = {0.1, 0, 0};
    sf_camera given = camera_at(0.6), camera = given;
    place_views();
    sf_follow_neighbours(&views, &camera); /* no view was corrected */
    assert_memory_equal(&camera, &given, sizeof given);
    for (int i = 0; i < VIEWS; i++) {
        move_with_world(turn, shift, states[i].R_cw, states[i].t_cw);
        states[i].pose.steps = i < 3;
    }
    sf_follow_neighbours(&views, &camera);
    assert_memory_equal(&camera, &given, sizeof given);
    states[3].pose.steps = 1;
    sf_follow_neighbours(&views, &camera);
    assert_memory_not_equal(&camera, &given, sizeof given);
}

/* How far 20 steps of rate 0.001 turn a camera, in radians, whose gradients change sign every `every` steps.
 */
static double turned_by(int every) {
    place_views();
    states[0].pose.steps = 0;
    for (int i = 0; i < 20; i++) {
        const double gradient[6] = {i / every % 2 ? -0.5 : 0.5};
        sf_refine_pose(&states[0], gradient, 0.001);
    }
    return states[0].turned_deg / 57.29577951308232;
}

/* A pose whose gradients are noise hardly moves; one that is off is as fast as the rate allows. */
static void noise_comes_to_rest(void **state) {
    (void)state;
    double drift = turned_by(100), noise = turned_by(1);
    print_message("20 steps of 0.001: %.5f one way, %.5f to and fro\n", drift, noise);
    assert_true(drift > 0.008 && drift <= 0.02);
    assert_true(noise > 0 && noise < 0.0005);
}

static void bad_gradients_are_left_out(void **state) {
    (void)state;
    const double bad[6] = {0, 0, 0, NAN, 1, 1};
    place_views();
    sf_view_state before = states[0];
    sf_refine_pose(&states[0], bad, 0.001);
    assert_memory_equal(&before, &states[0], sizeof before);
}

/* Views of validation are trained on in the end, and everything is learned of them too; until then they are
 * looked at where their neighbours went. */
static void views_of_validation_are_learned(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_fitter *fitter;
    assert_ok(ctx, sf_scene_load(ctx, "sim:studio?width=64&height=48&frames=20", NULL, &scene));
    sf_fit_options options = sf_fit_options_default();
    options.steps = 200, options.max_gaussians = 2000, options.validate = 5;
    options.refine_poses = options.exposure = 1, options.refine_start = 0;
    assert_ok(ctx, sf_fitter_create(ctx, scene, NULL, &options, &fitter));
    for (int i = 0; i < 60; i++) assert_ok(ctx, sf_fitter_step(fitter));
    assert_true(fitter->validation.count > 1 && !fitter->validation.merged);
    uint32_t kept_out = fitter->validation.ids[0];
    assert_null(sf_view_state_of(&fitter->views, kept_out));
    assert_ok(ctx, sf_fitter_run(fitter, NULL, NULL));
    assert_true(fitter->validation.merged);
    const sf_view_state *view = sf_view_state_of(&fitter->views, kept_out);
    assert_non_null(view);
    assert_true(view->pose.steps > 0 && view->exposure.steps > 0);
    for (size_t i = 1; i < fitter->views.count; i++)
        assert_true(fitter->views.states[i].id > fitter->views.states[i - 1].id);
    sf_fitter_destroy(&fitter);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(a_common_motion_is_followed), cmocka_unit_test(chance_is_not_followed),
        cmocka_unit_test(few_views_are_not_followed),  cmocka_unit_test(noise_comes_to_rest),
        cmocka_unit_test(bad_gradients_are_left_out),  cmocka_unit_test(views_of_validation_are_learned)};
    return cmocka_run_group_tests_name("follow", tests, NULL, NULL);
}
