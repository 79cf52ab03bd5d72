/* test_polycam.c - the folders that Polycam's raw export makes. */
#include "transforms_fixture.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>

enum { SIDE = 48, BORDER = 15 };

/* The camera's right is the world's z, its up y, its back -x; its centre is (1, 2, 3). */
#define POSE                                                                                                 \
    "'t_00':0,'t_01':0,'t_02':-1,'t_03':1,'t_10':0,'t_11':1,'t_12':0,'t_13':2,'t_20':1,'t_21':0,'t_22':0,"

static void make_folder(const char *project, const char *name) {
    char path[256];
    snprintf(path, sizeof path, "%s%s", project, name);
    mkdir(test_path(path), 0777);
}

/* One camera with fx and its picture, of one grey, in keyframes/[corrected_]cameras and images. */
static void add(sf_context *ctx, const char *project, const char *kind, const char *time, double fx) {
    static float rgb[3 * SIDE * SIDE];
    char folder[64], text[1024], name[512];
    for (int i = 0; i < 3 * SIDE * SIDE; i++) rgb[i] = 0.5f;
    make_folder(project, "");
    make_folder(project, "/keyframes");
    snprintf(folder, sizeof folder, "/keyframes/%simages", kind);
    make_folder(project, folder);
    snprintf(name, sizeof name, "%s%s/%s.jpg", project, folder, time);
    assert_ok(ctx, sf_write_png(ctx, test_path(name), SIDE, SIDE, rgb));
    snprintf(folder, sizeof folder, "/keyframes/%scameras", kind);
    make_folder(project, folder);
    snprintf(text, sizeof text,
             "{'fx':%g,'fy':41,'cx':23.5,'cy':24.25,'width':48,'height':48,'blur_score':90.5,'neighbors':[1],"
             "'timestamp':%s," POSE "'t_23':3}",
             fx, time);
    snprintf(name, sizeof name, "keyframes/%scameras/%s.json", kind, time);
    transforms_write_json(project, name, text);
}

static sf_scene *load(sf_context *ctx, const char *project, const sf_load_options *options) {
    sf_scene *scene = NULL;
    char path[1024];
    snprintf(path, sizeof path, "%s", test_path(project));
    assert_ok(ctx, sf_scene_load(ctx, path, options, &scene));
    return scene;
}

/* How many pixels of the first view count, and whether those in the middle do. */
static int count_weights(sf_context *ctx, const sf_load_options *options) {
    static float weight[SIDE * SIDE];
    int count = 0;
    sf_scene *scene = load(ctx, "border", options);
    sf_view_info view = test_view_info(scene, 0);
    assert_ok(ctx, sf_scene_get_pixels(scene, view.id, NULL, weight));
    for (int i = 0; i < view.camera.width * view.camera.height; i++) count += weight[i] == 1.0f;
    assert_true(weight[(view.camera.height / 2) * view.camera.width + view.camera.width / 2] == 1.0f);
    sf_scene_destroy(&scene);
    return count;
}

static void test_black_border(void **state) {
    (void)state;
    enum { INSIDE = SIDE - 2 * BORDER };
    sf_context *ctx = test_context();
    sf_load_options options = transforms_train_all();
    add(ctx, "border", "corrected_", "1000", 40);
    assert_int_equal(count_weights(ctx, &options), INSIDE * INSIDE);
    options.downscale = 3; /* 5 of 16 pixels from each side */
    assert_int_equal(count_weights(ctx, &options), INSIDE * INSIDE / 9);
    options = transforms_train_all();
    options.no_masks = 1;
    assert_int_equal(count_weights(ctx, &options), SIDE * SIDE);
    sf_context_destroy(&ctx);
}

static void test_corrected_cameras(void **state) {
    (void)state;
    static const double R[9] = {0, 0, 1, 0, -1, 0, 1, 0, 0}, center[3] = {1, 2, 3};
    sf_context *ctx = test_context();
    sf_load_options options = transforms_train_all();
    add(ctx, "both", "", "1000", 39);
    add(ctx, "both", "", "2000", 39);
    add(ctx, "both", "", "3000", 39);
    add(ctx, "both", "corrected_", "1000", 40);
    add(ctx, "both", "corrected_", "2000", 42);
    sf_scene *scene = load(ctx, "both", &options);
    sf_scene_info info = test_scene_info(scene);
    assert_int_equal(info.views, 2);
    assert_string_equal(info.kind, "Polycam");
    sf_view_info view = test_view_info(scene, 1);
    assert_string_equal(view.name, "2000.jpg");
    const double got[] = {view.camera.fx, view.camera.fy, view.camera.cx, view.camera.cy};
    const double expected[] = {42, 41, 23.5, 24.25};
    for (int i = 0; i < 4; i++) assert_true(fabs(got[i] - expected[i]) < 1e-9);
    for (int i = 0; i < 9; i++) assert_true(fabs(view.camera.R_cw[i] - R[i]) < 1e-9);
    double at[3];
    sf_camera_center(&view.camera, at);
    for (int k = 0; k < 3; k++) assert_true(fabs(at[k] - center[k]) < 1e-9);
    transforms_assert_log("keyframes/corrected_images is taken; 15 pixels along each side are ignored");
    sf_scene_destroy(&scene);
    scene = load(ctx, "both/keyframes", &options);
    assert_int_equal(test_scene_info(scene).views, 2);
    assert_true(fabs(test_view_info(scene, 1).camera.fx - 42) < 1e-9);
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

static void test_raw_cameras(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options options = transforms_train_all();
    add(ctx, "raw", "", "1000", 39);
    sf_scene *scene = load(ctx, "raw", &options);
    assert_true(fabs(test_view_info(scene, 0).camera.fx - 39) < 1e-9);
    transforms_assert_log("without corrected pictures and cameras");
    sf_scene_destroy(&scene);
    add(ctx, "raw", "corrected_", "1000", 40);
    options.images = "keyframes/images";
    scene = load(ctx, "raw", &options);
    assert_true(fabs(test_view_info(scene, 0).camera.fx - 39) < 1e-9);
    sf_scene_destroy(&scene);
    options.images = "photos";
    assert_status(ctx, sf_scene_load(ctx, test_path("raw"), &options, &scene), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "images: photos: the pictures of Polycam's export are in");
    sf_context_destroy(&ctx);
}

static void test_refusals(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene = NULL;
    add(ctx, "lacks", "corrected_", "1000", 40);
    transforms_write_json("lacks", "keyframes/corrected_cameras/1000.json",
                          "{'fx':1,'fy':1,'cx':1,'cy':1,'width':48,'height':48," POSE "'t_24':3}");
    assert_status(ctx, sf_scene_load(ctx, test_path("lacks"), NULL, &scene), SF_ERR_FORMAT);
    assert_error_names(ctx, "corrected_cameras/1000.json: t_23: is missing");
    transforms_write_json("lacks", "keyframes/corrected_cameras/1000.json", "{'fx':1,'width':48.5}");
    assert_status(ctx, sf_scene_load(ctx, test_path("lacks"), NULL, &scene), SF_ERR_FORMAT);
    assert_error_names(ctx, "width: 48.5 is not a whole number");
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_corrected_cameras),
        cmocka_unit_test(test_black_border),
        cmocka_unit_test(test_raw_cameras),
        cmocka_unit_test(test_refusals),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
