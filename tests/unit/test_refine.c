/* test_refine.c - poses and focal lengths that are off, and what a fit makes of them. */
#include "disturb.h"

#include <jansson.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

#define STUDIO "sim:studio?width=160&height=120&frames=24"

/* Of the error of small pictures, of which a tenth of a degree is a third of a pixel; larger ones give more.
 */
static const double LEAST_RECOVERED = 0.7;

static void skip_if_quick(void) {
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and this takes thousands of steps");
}

static sf_fit_options small_fit(int64_t steps) {
    sf_fit_options options = sf_fit_options_default();
    options.validate = 0;
    options.size = SF_SIZE_CAP;
    options.steps = steps;
    options.max_gaussians = 4000;
    return options;
}

typedef struct fitting {
    sf_context *ctx;
    sf_scene *scene;
    sf_fitter *fitter;
    test_cameras c;
    sf_camera refined[TEST_MOST_VIEWS];
    sf_fit_progress progress;
} fitting;

/* Runs a fit of the studio, its cameras disturbed as `c` says. */
static fitting run(const char *studio, test_cameras c, const sf_fit_options *options, int threads) {
    fitting f = {.ctx = test_context_threads(threads), .c = c};
    f.scene = test_changed_scene(f.ctx, studio, test_disturb, &f.c);
    assert_ok(f.ctx, sf_fitter_create(f.ctx, f.scene, NULL, options, &f.fitter));
    assert_ok(f.ctx, sf_fitter_run(f.fitter, NULL, NULL));
    sf_fitter_get_progress(f.fitter, &f.progress);
    test_cameras_of(f.ctx, f.scene, f.fitter, &f.c, f.refined);
    return f;
}

static void end(fitting *f) {
    sf_fitter_destroy(&f->fitter);
    sf_scene_destroy(&f->scene);
    sf_context_destroy(&f->ctx);
}

static void poses_are_recovered(void **state) {
    (void)state;
    skip_if_quick();
    sf_fit_options options = small_fit(2500);
    options.refine_poses = 1;
    fitting f = run(STUDIO, test_disturbance(0.5, 0.01, 1), &options, 2);
    test_pose_error before = test_pose_error_of(f.c.given, f.c.truth, f.c.count),
                    after = test_pose_error_of(f.refined, f.c.truth, f.c.count);
    print_message("%.3f degrees, then %.3f; %.4f depths, then %.4f; moved by %.3f and %.4f in the median\n",
                  before.degrees, after.degrees, before.depths, after.depths, f.progress.turned_degrees,
                  f.progress.moved_depths);
    assert_true(before.degrees > 0.3 && before.depths > 0.005);
    assert_true(after.degrees <= (1 - LEAST_RECOVERED) * before.degrees);
    assert_true(after.depths <= (1 - LEAST_RECOVERED) * before.depths);
    assert_true(f.progress.turned_degrees > 0.2 && f.progress.moved_depths > 0.002);
    end(&f);
}

static void perfect_poses_cost_little(void **state) {
    (void)state;
    skip_if_quick();
    enum { SEEDS = 2 }; /* one alone strays by 0.05 dB */
    double fall = 0;
    for (int seed = 1; seed <= SEEDS; seed++) {
        double psnr[2];
        for (int refine = 0; refine < 2; refine++) {
            sf_fit_options options = small_fit(1000);
            options.refine_poses = refine;
            options.seed = seed;
            fitting f = run(STUDIO, test_disturbance(0, 0, 1), &options, 2);
            psnr[refine] = test_held_out(f.ctx, f.scene, f.fitter).psnr;
            end(&f);
        }
        print_message("perfect poses: %.2f dB, refined %.2f dB\n", psnr[0], psnr[1]);
        fall += (psnr[0] - psnr[1]) / SEEDS;
    }
    /* 0.1 dB in pictures as small as these, with 24 views: what is free follows their noise */
    assert_true(fall <= 0.15);
}

/* The picture gives the focal length away where poses are known. */
static void focal_length_is_recovered(void **state) {
    (void)state;
    skip_if_quick();
    static const double zooms[] = {1.05, 0.95};
    for (int i = 0; i < 2; i++) {
        sf_fit_options options = small_fit(1000);
        options.refine_intrinsics = 1;
        fitting f = run(STUDIO, test_disturbance(0, 0, zooms[i]), &options, 2);
        double fx = f.refined[0].fx / f.c.truth[0].fx, fy = f.refined[0].fy / f.c.truth[0].fy;
        print_message("focal length %.4f of the true one, then %.4f, %.4f\n", zooms[i], fx, fy);
        assert_true(fabs(fx - 1) <= 0.2 * 0.05 && fabs(fy - 1) <= 0.2 * 0.05);
        assert_true(fabs((1 + f.progress.focal_change) * zooms[i] - (fx + fy) / 2) < 1e-4);
        end(&f);
    }
}

/* Every training view of one lens has the same focal length, and so have held-out ones. Two training views
 * keep their poses; held-out ones follow their neighbours by less than these moved at most. What is saved is
 * what the fitter says; the scene's own stay. */
static void cameras_are_told(void **state) {
    (void)state;
    sf_fit_options options = small_fit(60);
    options.refine_poses = options.refine_intrinsics = options.fix_gauge = 1;
    fitting f = run("sim:studio?width=64&height=48&frames=12", test_disturbance(0.5, 0.01, 1), &options, 2);
    const char *path = test_path("cameras.json");
    assert_ok(f.ctx, sf_fitter_save_cameras(f.fitter, path, 0));
    json_t *list = json_load_file(path, 0, NULL);
    sf_scene_info info;
    int held = 0, moved = 0;
    double most = 0, followed = 0, corrected = 0;
    sf_scene_get_info(f.scene, &info);
    assert_int_equal(json_array_size(list), info.views);
    for (size_t i = 0; i < info.views; i++) {
        sf_view_info view;
        sf_camera camera;
        double from[3], to[3], away = 0;
        assert_ok(f.ctx, sf_scene_get_view(f.scene, i, &view));
        assert_ok(f.ctx, sf_fitter_get_camera(f.fitter, view.id, &camera));
        assert_ok(f.ctx, (sf_status)sf_camera_check(&camera));
        assert_true(camera.fx == f.refined[0].fx && camera.fx != view.camera.fx);
        int same = !memcmp(camera.R_cw, view.camera.R_cw, sizeof camera.R_cw) &&
                   !memcmp(camera.t_cw, view.camera.t_cw, sizeof camera.t_cw);
        double now[3], before[3], gap = 0;
        sf_camera_center(&camera, now);
        sf_camera_center(&view.camera, before);
        for (int k = 0; k < 3; k++) gap += (now[k] - before[k]) * (now[k] - before[k]);
        double *farthest = view.split == SF_SPLIT_TEST ? &followed : &corrected;
        *farthest = fmax(*farthest, sqrt(gap));
        if (view.split != SF_SPLIT_TEST) {
            held += same;
            moved += !same;
        }
        json_t *saved = json_array_get(list, i), *position = json_object_get(saved, "position");
        sf_camera_center(&camera, from);
        for (size_t k = 0; k < 3; k++) to[k] = json_real_value(json_array_get(position, k));
        for (int k = 0; k < 3; k++) away = fmax(away, fabs(from[k] - to[k]));
        most = fmax(most, away);
        assert_true(fabs(json_real_value(json_object_get(saved, "fx")) - camera.fx) < 1e-9 * camera.fx);
    }
    assert_true(followed > 0 && followed < corrected);
    assert_int_equal(held, 2);
    assert_int_equal(held + moved, info.train_views);
    assert_true(most < 1e-9);
    assert_status(f.ctx, sf_fitter_get_camera(f.fitter, 4711, &f.refined[0]), SF_ERR_ARGUMENT);
    assert_error_names(f.ctx, "4711");
    json_decref(list);
    end(&f);
}

/* Exposure, poses and focal lengths are the same to the bit for any number of threads. */
static void same_bytes(void **state) {
    (void)state;
    static const int threads[] = {1, 2, 4};
    sf_camera first[TEST_MOST_VIEWS];
    double loss = 0;
    for (size_t i = 0; i < 3; i++) {
        sf_fit_options options = small_fit(40);
        options.exposure = options.refine_poses = options.refine_intrinsics = 1;
        options.refine_start = 0;
        fitting f = run("sim:studio?width=64&height=48&frames=9", test_disturbance(0.5, 0.01, 1.02), &options,
                        threads[i]);
        if (!i) {
            memcpy(first, f.refined, sizeof first);
            loss = f.progress.loss;
            assert_true(f.progress.turned_degrees > 0 && f.progress.focal_change != 0);
        }
        assert_memory_equal(first, f.refined, f.c.count * sizeof *first);
        assert_true(loss == f.progress.loss);
        end(&f);
    }
}

int main(void) {
    const struct CMUnitTest tests[] = {cmocka_unit_test(cameras_are_told), cmocka_unit_test(same_bytes),
                                       cmocka_unit_test(poses_are_recovered),
                                       cmocka_unit_test(perfect_poses_cost_little),
                                       cmocka_unit_test(focal_length_is_recovered)};
    return cmocka_run_group_tests_name("refine", tests, NULL, NULL);
}
