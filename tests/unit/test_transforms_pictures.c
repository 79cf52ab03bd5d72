/* test_transforms_pictures.c - which pictures a transforms.json means: smaller copies, and their lens. */
#include "transforms_fixture.h"

#include <math.h>
#include <string.h>
#include <sys/stat.h>

#define ONE     "'frames':[" FRAME("images/a.png", IDENTITY) "]}"
#define LENGTHS "'fl_x':20,'fl_y':21,'cx':12.5,'cy':8.25,"

/* A project whose pictures images_2/ alone holds, of half the size. */
static void make_smaller(sf_context *ctx, const char *project) {
    float rgb[3 * PIXELS / 4];
    for (size_t i = 0; i < sizeof rgb / sizeof *rgb; i++) rgb[i] = 0.5f;
    mkdir(test_path(project), 0777);
    mkdir(test_path_in(project, "images_2"), 0777);
    assert_ok(ctx, sf_write_png(ctx, test_path_in(project, "images_2/a.png"), WIDTH / 2, HEIGHT / 2, rgb));
}

/* The lens of the only view, which is of half the size. */
static void assert_halved(sf_scene *scene, double fx, double fy, double cx, double cy) {
    sf_camera c = test_view_info(scene, 0).camera;
    double got[4] = {c.fx, c.fy, c.cx, c.cy}, expected[4] = {fx, fy, cx, cy};
    assert_int_equal(test_scene_info(scene).views, 1);
    assert_int_equal(c.width, WIDTH / 2);
    assert_int_equal(c.height, HEIGHT / 2);
    for (int i = 0; i < 4; i++)
        if (!(fabs(got[i] - expected[i]) <= 1e-9)) fail_msg("%d: %.17g is not %.17g", i, got[i], expected[i]);
    sf_scene_destroy(&scene);
}

/* As ns-process-data leaves it where the large pictures were removed. */
static void test_smaller_copies_alone(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    make_smaller(ctx, "smaller");
    test_log_clear();
    assert_halved(transforms_load_json(ctx, "smaller", "{" LENS ONE), 10, 10.5, 6.25, 4.125);
    transforms_assert_log("there is no images/: the pictures of images_2/ are taken");
    assert_halved(transforms_load_json(ctx, "smaller", "{'camera_angle_x':0.8," ONE), 6 / tan(0.4),
                  6 / tan(0.4), 6, 4);
    transforms_assert_refused(ctx, "smaller", "{" LENGTHS ONE, SF_ERR_FORMAT, "frames[0]: w: is missing");
    mkdir(test_path_in("smaller", "images"), 0777); /* but not the picture */
    transforms_assert_refused(ctx, "smaller", "{" LENS ONE, SF_ERR_EMPTY, "images/a.png: No such file");
    sf_context_destroy(&ctx);
}

/* A lens without a size is that of the picture that the file names, not of the copy that is taken. */
static void test_lens_of_the_named_picture(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_load_options smaller = transforms_train_all();
    smaller.images = "images_2";
    transforms_make_project(ctx, "sizes");
    make_smaller(ctx, "sizes");
    transforms_write_json("sizes", "transforms.json", "{" LENGTHS ONE);
    assert_halved(test_load_scene(ctx, test_path("sizes"), &smaller), 10, 10.5, 6.25, 4.125);
    transforms_write_json("sizes", "transforms.json",
                          "{" LENGTHS "'frames':[" FRAME("images/a", IDENTITY) "]}");
    assert_halved(test_load_scene(ctx, test_path("sizes"), &smaller), 10, 10.5, 6.25, 4.125);
    sf_context_destroy(&ctx);
}

static void test_option_without_effect_is_refused(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    sf_scene *scene;
    sf_load_options options = transforms_train_all();
    options.images = "images_2";
    transforms_make_project(ctx, "other");
    assert_int_equal(rename(test_path_in("other", "images"), test_path_in("other", "train")), 0);
    transforms_write_json("other", "transforms.json",
                          "{" LENS "'frames':[" FRAME("train/a.png", IDENTITY) "]}");
    assert_status(ctx, sf_scene_load(ctx, test_path("other"), &options, &scene), SF_ERR_ARGUMENT);
    assert_error_names(ctx, "images: images_2: no file_path begins with images/");
    sf_context_destroy(&ctx);
}

static void test_flag_is_true_or_false(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "flag");
    transforms_assert_refused(ctx, "flag", "{" LENS "'is_fisheye':1,'k1':0.1," ONE, SF_ERR_FORMAT,
                              "frames[0]: is_fisheye: is not true or false");
    sf_scene_info info;
    sf_scene *scene = transforms_load_json(ctx, "flag", "{" LENS "'is_fisheye':false," ONE);
    info = test_scene_info(scene);
    assert_int_equal(info.views, 1);
    assert_string_equal(test_view_info(scene, 0).lens, "PINHOLE");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* The file of the training views, named itself, is read as its folder is: with its held-out views, and
 * blended. */
static void test_file_of_training_views(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "lego");
    transforms_write_json("lego", "transforms_train.json",
                          "{'camera_angle_x':0.7,'frames':[" FRAME("./images/b", IDENTITY) "," FRAME(
                              "./images/c", IDENTITY) "]}");
    transforms_write_json("lego", "transforms_test.json",
                          "{'camera_angle_x':0.7,'frames':[" FRAME("./images/a", IDENTITY) "]}");
    sf_scene *scene = test_load_scene(ctx, test_path_in("lego", "transforms_train.json"), NULL);
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_int_equal(test_scene_info(scene).test_views, 1);
    assert_int_equal(test_view_info(scene, 0).split, SF_SPLIT_TEST);
    assert_string_equal(test_scene_info(scene).kind, "Blender");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

/* Found where one file alone differs in ending and case; else it is missing. */
static void test_near_names(void **state) {
    (void)state;
    sf_context *ctx = test_context();
    transforms_make_project(ctx, "near");
    transforms_write_picture(ctx, test_path("near/images/D.JPEG"), 0.5f);
    transforms_write_picture(ctx, test_path("near/images/c.jpg"), 0.5f);
    sf_scene *scene = transforms_load_json(
        ctx, "near",
        "{" LENS "'frames':[" FRAME("images/a.png", IDENTITY) "," FRAME("images/B.jpg", IDENTITY) "," FRAME(
            "images/C.PNG", IDENTITY) "," FRAME("images/d.png", IDENTITY) "]}");
    assert_int_equal(test_scene_info(scene).views, 3);
    assert_int_equal(test_scene_info(scene).skipped_missing, 1);
    transforms_assert_log("2 pictures have another ending or another case on disk");
    transforms_assert_log("images/C.PNG");
    sf_scene_destroy(&scene);
    sf_context_destroy(&ctx);
}

int main(void) {
    const struct CMUnitTest tests[] = {
        cmocka_unit_test(test_near_names),
        cmocka_unit_test(test_smaller_copies_alone),
        cmocka_unit_test(test_lens_of_the_named_picture),
        cmocka_unit_test(test_option_without_effect_is_refused),
        cmocka_unit_test(test_flag_is_true_or_false),
        cmocka_unit_test(test_file_of_training_views),
    };
    return cmocka_run_group_tests(tests, NULL, NULL);
}
