/* test_reconstruct.c - a folder of photos becomes cameras, whose truth is known; what is refused. */
#include "testing.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>

#include "base/linear.h"
#include "base/statistics.h"

#include <splatfit/sfm.h>

#define STUDIO "sim:studio?width=320&height=240&frames=24"
enum { PHOTOS = 24, VALUES = 3 * 320 * 240 };

/* The studio's pictures as photos of a folder, whose path is returned. */
static const char *write_photos(sf_context *ctx, const char *folder, sf_scene *scene, size_t first,
                                size_t end) {
    static float rgb[VALUES];
    char path[1024];
    mkdir(test_path(folder), 0777);
    for (size_t i = first; i < end; i++) {
        sf_view_info view = test_view_info(scene, i);
        assert_ok(ctx, sf_scene_get_pixels(scene, view.id, rgb, NULL));
        snprintf(path, sizeof path, "%s/%02zu.png", test_path(folder), i);
        assert_ok(ctx, sf_write_png(ctx, path, 320, 240, rgb));
    }
    return test_path(folder);
}

/* Degrees between what turns camera a into camera b, here and in truth. */
static double turn_between(const sf_reconstruction_photo *a, const sf_reconstruction_photo *b,
                           const sf_camera *true_a, const sf_camera *true_b) {
    double back[9], here[9], there[9], trace = 0;
    for (int k = 0; k < 9; k++) back[k] = a->R_cw[3 * (k % 3) + k / 3];
    sf_mat3_mul(b->R_cw, back, here);
    for (int k = 0; k < 9; k++) back[k] = true_a->R_cw[3 * (k % 3) + k / 3];
    sf_mat3_mul(true_b->R_cw, back, there);
    for (int k = 0; k < 9; k++) trace += here[k] * there[k];
    return acos(fmin(fmax((trace - 1) / 2, -1), 1)) * 57.29577951308232;
}

static void center_of(const sf_reconstruction_photo *photo, double center[3]) {
    for (int k = 0; k < 3; k++)
        center[k] = -(photo->R_cw[k] * photo->t_cw[0] + photo->R_cw[3 + k] * photo->t_cw[1] +
                      photo->R_cw[6 + k] * photo->t_cw[2]);
}

static double distance(const double a[3], const double b[3]) {
    double d[3] = {a[0] - b[0], a[1] - b[1], a[2] - b[2]};
    return sqrt(sf_dot3(d, d));
}

/* The frame and the unit are arbitrary: what is compared is between cameras. */
static void compare(const sf_reconstruction *r, sf_scene *scene, double most_turn) {
    double turns[PHOTOS], ratios[PHOTOS];
    sf_reconstruction_photo first, photo;
    sf_view_info truth = test_view_info(scene, 0);
    assert_int_equal(sf_reconstruction_get_photo(r, 0, &first), SF_OK);
    for (size_t i = 1; i < PHOTOS; i++) {
        sf_view_info view = test_view_info(scene, i);
        double a[3], b[3], true_a[3], true_b[3];
        assert_int_equal(sf_reconstruction_get_photo(r, i, &photo), SF_OK);
        assert_true(photo.placed);
        assert_true(photo.observations >= 20 && photo.observations <= photo.features);
        turns[i - 1] = turn_between(&first, &photo, &truth.camera, &view.camera);
        center_of(&first, a), center_of(&photo, b);
        sf_camera_center(&truth.camera, true_a), sf_camera_center(&view.camera, true_b);
        ratios[i - 1] = distance(a, b) / distance(true_a, true_b);
    }
    assert_true(sf_median(turns, PHOTOS - 1) < most_turn);
    double unit = sf_median(ratios, PHOTOS - 1);
    for (size_t i = 0; i < PHOTOS - 1; i++) assert_true(fabs(ratios[i] / unit - 1) < 0.02);
    assert_true(fabs(photo.lens.fx / truth.camera.fx - 1) < 0.01);
    assert_int_equal(sf_reconstruction_get_photo(r, PHOTOS, &photo), SF_ERR_ARGUMENT);
}

static void test_studio(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, STUDIO, NULL), *again;
    sf_reconstruction *r;
    sf_reconstruction_info info;
    assert_ok(ctx, sf_sfm_run(ctx, write_photos(ctx, "studio", scene, 0, PHOTOS), NULL, &r));
    sf_reconstruction_get_info(r, &info);
    assert_int_equal(info.photos, PHOTOS);
    assert_int_equal(info.placed, PHOTOS);
    assert_true(info.points > 300 && info.observations > 3 * info.points);
    assert_true(info.error > 0 && info.error < 1);
    compare(r, scene, 0.1);
    mkdir(test_path("project"), 0777);
    mkdir(test_path_in("project", "sparse"), 0777);
    mkdir(test_path_in("project", "sparse/0"), 0777);
    write_photos(ctx, "project/images", scene, 0, PHOTOS);
    assert_ok(ctx, sf_reconstruction_save_colmap(r, test_path_in("project", "sparse/0")));
    again = test_load_scene(ctx, test_path("project"), NULL);
    assert_int_equal(test_scene_info(again).views, PHOTOS);
    assert_int_equal(test_scene_info(again).points, info.points);
    sf_scene_destroy(&again);
    sf_reconstruction_destroy(&r);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Through a wide lens, opposite walls have so many matches that they were taken for one; pairs of pictures
 * through a long lens vote for half of its focal length. */
static void test_other_lenses(void **state) {
    (void)state;
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and what runs is the studio's");
    static const char *const lenses[] = {STUDIO "&fov=110", STUDIO "&fov=30"};
    for (size_t i = 0; i < sizeof lenses / sizeof *lenses; i++) {
        sf_context *ctx = test_context();
        sf_scene *scene = test_load_scene(ctx, lenses[i], NULL);
        sf_reconstruction *r;
        assert_ok(ctx, sf_sfm_run(ctx, write_photos(ctx, "lens", scene, 0, PHOTOS), NULL, &r));
        compare(r, scene, 0.3);
        sf_reconstruction_destroy(&r);
        sf_scene_destroy(&scene);
        sf_context_destroy(&ctx);
    }
}

/* Some frames of a camera that looks at one place from one height: pairs of them hardly tell its focal
 * length, and a map that begins with one far too short ends there, with fewer points. */
static void test_uneven_frames(void **state) {
    (void)state;
    static const size_t frames[] = {2,  4,  9,  12, 13, 15, 16, 18, 19, 22, 23, 24, 25, 26, 27,
                                    28, 29, 32, 33, 34, 36, 38, 39, 40, 47, 48, 51, 52, 56, 59};
    if (test_is_quick()) test_skip("SPLATFIT_QUICK is set, and what runs is the studio's");
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, "sim:studio?width=320&height=240&frames=60", NULL);
    sf_reconstruction *r;
    sf_reconstruction_photo photo;
    for (size_t i = 0; i < sizeof frames / sizeof *frames; i++)
        write_photos(ctx, "uneven", scene, frames[i], frames[i] + 1);
    assert_ok(ctx, sf_sfm_run(ctx, test_path("uneven"), NULL, &r));
    for (size_t i = 0; !sf_reconstruction_get_photo(r, i, &photo); i++) {
        assert_true(photo.placed);
        assert_true(fabs(photo.lens.fx / test_view_info(scene, 0).camera.fx - 1) < 0.01);
    }
    sf_reconstruction_destroy(&r);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void assert_same(const sf_reconstruction *a, const sf_reconstruction *b, size_t photos) {
    sf_reconstruction_photo x, y;
    for (size_t i = 0; i < photos; i++) {
        assert_int_equal(sf_reconstruction_get_photo(a, i, &x), SF_OK);
        assert_int_equal(sf_reconstruction_get_photo(b, i, &y), SF_OK);
        assert_int_equal(x.placed, y.placed);
        assert_memory_equal(&x.lens, &y.lens, sizeof x.lens);
        assert_memory_equal(x.R_cw, y.R_cw, sizeof x.R_cw);
        assert_memory_equal(x.t_cw, y.t_cw, sizeof x.t_cw);
    }
}

/* The same bytes for 1 and 3 threads; pairs are those of photos that are alike. */
static void test_threads(void **state) {
    (void)state;
    enum { FEW = 8 };
    sf_sfm_options sfm = sf_sfm_options_default();
    sfm.all_pairs = 0;
    sf_reconstruction *r[2];
    sf_context *ctx = test_context(), *others[2];
    sf_scene *scene = test_load_scene(ctx, STUDIO, NULL);
    char folder[1024];
    snprintf(folder, sizeof folder, "%s", write_photos(ctx, "few", scene, 0, FEW));
    for (int i = 0; i < 2; i++) {
        sf_context_options options = {0};
        options.threads = i ? 3 : 1;
        assert_int_equal(sf_context_create(&others[i], &options), SF_OK);
        assert_ok(others[i], sf_sfm_run(others[i], folder, &sfm, &r[i]));
    }
    assert_same(r[0], r[1], FEW);
    for (int i = 0; i < 2; i++) {
        sf_reconstruction_destroy(&r[i]);
        sf_context_destroy(&others[i]);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void assert_refused(sf_context *ctx, const char *folder, const sf_sfm_options *options,
                           sf_status status, const char *part) {
    sf_reconstruction *r = (sf_reconstruction *)ctx;
    assert_status(ctx, sf_sfm_run(ctx, folder, options, &r), status);
    assert_null(r);
    assert_error_names(ctx, part);
}

static int stop(void *user, sf_sfm_stage stage, size_t done, size_t all) {
    (void)done;
    (void)all;
    return stage == *(sf_sfm_stage *)user;
}

static void test_refusals(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = test_load_scene(ctx, STUDIO, NULL);
    char folder[1024];
    assert_refused(ctx, test_path("nowhere"), NULL, SF_ERR_IO, "nowhere");
    mkdir(test_path("empty"), 0777);
    assert_refused(ctx, test_path("empty"), NULL, SF_ERR_EMPTY, "holds no photos");
    assert_refused(ctx, write_photos(ctx, "one", scene, 0, 1), NULL, SF_ERR_EMPTY, "one photo alone");
    test_write(test_path_in("empty", "a.png"), "no picture", 10);
    test_write(test_path_in("empty", "b.png"), "no picture", 10);
    assert_refused(ctx, test_path("empty"), NULL, SF_ERR_EMPTY, "a.png");
    snprintf(folder, sizeof folder, "%s", write_photos(ctx, "apart", scene, 0, 1));
    write_photos(ctx, "apart", scene, 12, 13); /* from the other side */
    assert_refused(ctx, folder, NULL, SF_ERR_EMPTY, "");
    sf_sfm_options options = sf_sfm_options_default();
    options.side = 63;
    assert_refused(ctx, folder, &options, SF_ERR_ARGUMENT, "side: 63 is not in 64..28000");
    options = sf_sfm_options_default();
    options.features = 10;
    assert_refused(ctx, folder, &options, SF_ERR_ARGUMENT, "features: 10 is not in 100..1000000");
    options = sf_sfm_options_default();
    options.all_pairs = -1;
    assert_refused(ctx, folder, &options, SF_ERR_ARGUMENT, "all_pairs: -1 is not in 0..1000000");
    options = sf_sfm_options_default();
    options.sequence = -1;
    assert_refused(ctx, folder, &options, SF_ERR_ARGUMENT, "sequence: -1 is not in 0..1000000");
    options = sf_sfm_options_default();
    options.error = 0;
    assert_refused(ctx, folder, &options, SF_ERR_ARGUMENT, "error: 0 px");
    options = sf_sfm_options_default();
    options.focal = NAN;
    assert_refused(ctx, folder, &options, SF_ERR_ARGUMENT, "focal: ");
    snprintf(folder, sizeof folder, "%s", write_photos(ctx, "cancelled", scene, 0, 6));
    for (sf_sfm_stage stage = SF_SFM_FEATURES; stage < SF_SFM_STAGES; stage++) {
        sf_reconstruction *r;
        options = sf_sfm_options_default();
        options.progress = stop, options.user = &stage;
        assert_int_equal(sf_sfm_run(ctx, folder, &options, &r), SF_ERR_CANCELLED);
        assert_null(r);
    }
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_studio),        cmocka_unit_test(test_other_lenses),
        cmocka_unit_test(test_uneven_frames), cmocka_unit_test(test_threads),
        cmocka_unit_test(test_refusals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
